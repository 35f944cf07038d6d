"""One solve of the forward model: the request, and the run that answers it."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from indentfit.arrays import Array

Point = Mapping[str, Any]  # parameters, and changed inputs of the case: name -> value


@dataclass(frozen=True)
class RunRequest:
    """A request for one solve of the forward model: the unit of work of a pool.

    Parameters
    ----------
    point : tuple of (name, value)
        All parameters, and the changed inputs of the case.
    test : int
        Number of the test within the case.
    sensitivities : tuple of str
        Names by which the force is differentiated.
    """

    point: tuple[tuple[str, Any], ...]
    test: int
    sensitivities: tuple[str, ...] = ()

    @property
    def parameters(self) -> dict[str, Any]:
        """The point as a dictionary: name -> value."""
        return dict(self.point)

    @property
    def subject(self) -> tuple[tuple[tuple[str, Any], ...], int]:
        """Point and test, without the sensitivities."""
        return self.point, self.test


@dataclass(frozen=True)
class Run:
    """The forces of one test at one set of parameters, or the cause of their absence.

    Parameters
    ----------
    force : array (n,), mN, or None
    cause : str or None
        Why the run has no force.
    seconds : float
        Duration of the run.
    facts : dict
        The solver's facts about the run.
    sensitivities : dict of name -> array (n,), or None
        Derivatives of the force by the requested names, mN per unit; None where none were requested.
    lost : bool
        The cause lies with the machine (memory, time, a killed process) and not with the mechanics.
    """

    force: Array | None
    cause: str | None
    seconds: float
    facts: dict[str, Any]
    sensitivities: Mapping[str, Array] | None = None
    lost: bool = False

    def serves(self, names: Iterable[str]) -> bool:
        """Whether this run can stand for a run with the sensitivities `names`; a failed run always can."""
        return self.force is None or set(names) <= set(self.sensitivities or ())


def out_of_time(limit: float) -> Run:
    """The Run that was ended at its limit of processor time, s."""
    cause = f"not solved within {limit:g} s; a larger fit.time_limit allows more"
    return Run(None, cause, limit, {}, lost=True)
