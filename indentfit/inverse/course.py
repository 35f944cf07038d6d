"""The record of a search for the result of a fit: its steps, and how well its surrogate predicted runs."""

from collections.abc import Mapping
from dataclasses import dataclass, replace


@dataclass(frozen=True)
class HistoryStep:
    """One step of a search.

    Parameters
    ----------
    phase : str
        Name of the search: "ga", "polish", "least_squares", ...
    step : int
        Number of the step in its phase, from 1.
    objective : float or None
        Equation (1) of the best point so far, mN; None before the first run that succeeded.
    runs : int
        Number of runs of the forward model until this step.
    """

    phase: str
    step: int
    objective: float | None
    runs: int

    def at(self, runs: int) -> "HistoryStep":
        """The same step with another number of runs: a search on a surrogate counts the runs before it."""
        return replace(self, runs=runs)


@dataclass(frozen=True)
class Proof:
    """A prediction of the surrogate at a point that was not run before, compared with a run there.

    Parameters
    ----------
    parameters : dict of name -> value
    error : float or None
        Root mean square difference between predicted and simulated forces of all tests, mN; None where the run failed.
    allowed : float or None
        The largest error with which the prediction counts as right, mN.
    """

    parameters: Mapping[str, float | str]
    error: float | None
    allowed: float | None

    @property
    def right(self) -> bool:
        """Whether the run agrees with the prediction."""
        return self.error is not None and self.allowed is not None and self.error <= self.allowed


@dataclass(frozen=True)
class SurrogateFacts:
    """Facts about the surrogate of a search, for the result.

    Parameters
    ----------
    runs, failed : int
        Number of sets of parameters to which the surrogate was fitted, and number of sets that failed.
    degree : int
        Total degree of its polynomials.
    left_out_error : float
        Root mean square error of each run predicted from all others, as a share of the run's misfit.
    held_out : tuple of Proof
        Predictions at points that were not run before, in the order of their runs.
    reached : bool
        Whether one of these predictions was right.
    """

    runs: int
    failed: int
    degree: int
    left_out_error: float | None
    held_out: tuple[Proof, ...] = ()
    reached: bool = False
