"""Refits: the change of the fitted parameters with a key of the case, or with its mesh, by one whole fit for each value."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from indentfit.case import Case, require_fittable
from indentfit.errors import IndentfitError, LedgerError, Stopped, WorkerError
from indentfit.study.runs import Execution


@dataclass(frozen=True)
class RefitEstimate:
    """A fitted parameter: value and standard error (None where not known) in the unit."""

    value: float
    stderr: float | None
    unit: str


@dataclass(frozen=True)
class Refit:
    """One fit under a changed key or on another mesh.

    Parameters
    ----------
    label : str
        The change in words.
    parameters : dict of name -> RefitEstimate
        The free parameters.
    objective : float or None, mN
    success : bool
        Whether the fit converged.
    cause : str or None
        Why the fit is missing.
    """

    label: str
    parameters: dict[str, RefitEstimate]
    objective: float | None
    success: bool
    cause: str | None

    @classmethod
    def from_json(cls, value: Mapping[str, Any]) -> "Refit":
        estimates = {name: RefitEstimate(**estimate) for name, estimate in value["parameters"].items()}
        return cls(value["label"], estimates, value["objective"], value["success"], value["cause"])


def refits(labelled: Sequence[tuple[str, Case]], execution: Execution) -> tuple[Refit, ...]:
    """The Refit of each (label, Case), on the workers of its `fit`.

    A fit that is in the ledger already costs no run of the forward model.

    Raises
    ------
    CaseError
        A case has nothing to fit; no case is fitted then.
    Stopped, WorkerError, LedgerError
    """
    for _, case in labelled:
        require_fittable(case)
    return tuple(
        _refit(label, case, execution, _part(execution.progress, n / len(labelled), 1 / len(labelled), label))
        for n, (label, case) in enumerate(labelled)
    )


def _part(progress: Callable[[float, str], object], start: float, share: float, label: str) -> Callable[..., None]:
    """Progress of one fit as a part of all of them."""

    def report(done: float, note: str = "") -> None:
        progress(start + share * done, f"{label}; {note}")

    return report


def _refit(label: str, case: Case, execution: Execution, report: Callable[..., None]) -> Refit:
    from indentfit.inference.fit import fit  # here: a study without refits needs no inference, half a second of imports

    try:
        result = fit(case, report, execution.ledger_of(case), execution.cluster, execution.stop)
    except (LedgerError, Stopped, WorkerError):
        raise
    except IndentfitError as error:
        return Refit(label, {}, None, False, " ".join(str(error).split()))
    if result.objective is None:
        return Refit(label, {}, None, False, result.message)
    estimates = {
        name: RefitEstimate(result.parameters[name].value, result.parameters[name].stderr, result.parameters[name].unit)
        for name in result.free
    }
    return Refit(label, estimates, result.objective, result.success, None)
