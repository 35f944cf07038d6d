"""Common parts of the local searches: their end, and the evaluations on their way."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from indentfit.arrays import Array
from indentfit.digits import quantity
from indentfit.inverse.course import HistoryStep
from indentfit.inverse.derivatives import brings_sensitivities, curve_derivatives, evaluate_at_reference
from indentfit.inverse.objective import Target
from indentfit.inverse.problem import Candidate, InverseProblem
from indentfit.inverse.progress import SILENT, Progress
from indentfit.runs.forward import ForwardModel

RESOLVED = 1e-5  # of the measured forces' root mean square: smaller changes of the objective are noise
WIDEST = 0.5  # of the ranges: the first trust region
SHORTEST = 1e-4  # of the ranges: a search ends at a shorter step


@dataclass(frozen=True)
class Optimum:
    """The end of a local search.

    Parameters
    ----------
    best : Candidate or None
        None where not even the start could be evaluated.
    derivatives : tuple of arrays (n, n_free), or None
        Derivatives of the curves there, mN per range of a free parameter, one for each test; None where they failed.
    success : bool
    message : str
        Why the search ended.
    history : tuple of HistoryStep
    """

    best: Candidate | None
    derivatives: tuple[Array, ...] | None
    success: bool
    message: str
    history: tuple[HistoryStep, ...]


class Course:
    """The evaluations of one local search, remembered, and their derivatives.

    `value` is the function that the search minimises; `phase` is the name of the search in the history.
    """

    def __init__(
        self,
        problem: InverseProblem,
        model: ForwardModel,
        phase: str,
        value: Callable[[Candidate], float],
        progress: Progress = SILENT,
    ) -> None:
        self.problem, self.model, self.phase, self.value, self.progress = problem, model, phase, value, progress
        self.best: Candidate | None = None
        self.history: list[HistoryStep] = []

    def candidate(self, x: Array) -> Candidate | None:
        """The Candidate at x, (n_free,), or None where the mechanics failed."""
        parameters = self.problem.parameters(x)
        evaluation = evaluate_at_reference(self.problem, self.model, [parameters], self._report)[0]
        if evaluation.forces is None:
            return None
        candidate = self.problem.judge(parameters, evaluation.forces)
        if self.best is None or self.value(candidate) < self.value(self.best):
            self.best = candidate
        if not self.history or self.history[-1].runs < self.model.runs:
            self.history.append(HistoryStep(self.phase, len(self.history) + 1, self.best.objective, self.model.runs))
        return candidate

    def derivatives(self, x: Array, surrogate: ForwardModel | None = None) -> tuple[Array, ...]:
        """Derivatives of the curves at x, mN per range, an array (n, n_free) for each test.

        A surrogate, if given, supplies derivatives that would need runs of their own. Raises Underivable.
        """
        if surrogate is not None and not brings_sensitivities(self.problem, self.model, x):
            return curve_derivatives(self.problem, surrogate, x)
        return curve_derivatives(self.problem, self.model, x, self._report)

    def ended(self, best: Candidate, derivatives: tuple[Array, ...] | None, success: bool, message: str) -> Optimum:
        """The Optimum at the end of this course."""
        return Optimum(best, derivatives, success, message, tuple(self.history))

    def _report(self, done: int, total: int) -> None:
        share = 1 - 0.7 ** (1 + len(self.history) / 2)  # the number of steps is not known beforehand
        note = f"{self.phase.replace('_', ' ')}" + (f", objective {quantity(self.best.objective, 'mN')}" if self.best else "")
        self.progress(share, note)


def stacked(tests: Sequence[Target], slopes: Sequence[Array]) -> Array:
    """Derivatives of the misfits of all tests, (N, n_free), from those of their curves."""
    weighted = [np.sqrt(t.of_square / t.curve.force.size) * t.curve.trust[:, None] * d for t, d in zip(tests, slopes, strict=True)]
    return np.concatenate(weighted)
