"""One solve of the forward model: what is asked for, and what came of it."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from indentfit.arrays import Array

Point = Mapping[str, Any]  # parameters, and changed inputs of the case: name -> value


@dataclass(frozen=True)
class RunRequest:
    """One solve of the forward model that is asked for: the unit of work of a pool.

    Parameters
    ----------
    point : tuple of (name, value)
        All parameters, and the changed inputs of the case.
    test : int
        Number of the test within the case.
    sensitivities : tuple of str
        Names that the force is to be differentiated by.
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
        """Point and test, whatever the force is differentiated by."""
        return self.point, self.test


@dataclass(frozen=True)
class Run:
    """The forces of one test at one set of parameters, or the cause why there are none.

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
        Derivatives of the force by the parameters that were asked for, mN per unit; None where none were asked for.
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
        """Whether this run says what a run with the sensitivities `names` would say; a failed run serves all."""
        return self.force is None or set(names) <= set(self.sensitivities or ())


def out_of_time(limit: float) -> Run:
    """The Run that was given up after its time, in seconds of a processor."""
    cause = f"not solved within {limit:g} s; give it longer with fit.time_limit, if it deserves that"
    return Run(None, cause, limit, {}, lost=True)
