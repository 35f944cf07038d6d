"""How the fitted parameters themselves move when a key of the case, or its mesh, is another: one whole fit for each."""

from dataclasses import dataclass

from indentfit.case import require_fittable
from indentfit.errors import IndentfitError, LedgerError, Stopped, WorkerError
from indentfit.inference.fit import fit
from indentfit.inference.result import ParameterEstimate


@dataclass(frozen=True)
class Refit:
    """One fit: name -> value and standard error (None where not known) of the free parameters, and its objective, mN.

    label: what was changed; cause: why there is no fit, or None; success: whether it converged.
    """

    label: str
    parameters: dict[str, dict]
    objective: float | None
    success: bool
    cause: str | None


def refits(labelled, ledger=None, cluster=None, stop=None, progress=None):
    """Refit of each (label, Case), on the workers of its `fit`; progress: called with (share done, note).

    ledger: a Ledger with the cases among its own, or None: a fit that was finished once costs no run of the forward model.
    Raises CaseError where a case has nothing to fit, before any is fitted, and what `RunPool.evaluate` raises.
    """
    for _, case in labelled:
        require_fittable(case)
    found = []
    for n, (label, case) in enumerate(labelled):
        report = progress and (lambda share, note="", n=n, label=label: progress((n + share) / len(labelled), f"{label}; {note}"))
        found.append(_refit(label, case, report, None if ledger is None else ledger.of(case), cluster, stop))
    return tuple(found)


def _refit(label, case, report, ledger, cluster, stop):
    try:
        result = fit(case, report, ledger, cluster, stop)
    except (LedgerError, Stopped, WorkerError):
        raise
    except IndentfitError as error:
        return Refit(label, {}, None, False, " ".join(str(error).split()))
    if result.objective is None:
        return Refit(label, {}, None, False, result.message)
    parameters = {name: _known(result.parameters[name]) for name in result.free}
    return Refit(label, parameters, result.objective, result.success, None)


def _known(parameter: ParameterEstimate) -> dict:
    return {"value": parameter.value, "stderr": parameter.stderr, "unit": parameter.unit}
