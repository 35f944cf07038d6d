"""Common parts of the global searches: a whole generation is judged at once under equation (1), each member at its best scale."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from indentfit.arrays import Array
from indentfit.digits import quantity
from indentfit.inverse.course import HistoryStep
from indentfit.inverse.derivatives import evaluate_at_reference
from indentfit.inverse.problem import Candidate, InverseProblem
from indentfit.inverse.progress import SILENT, Progress
from indentfit.inverse.surrogate import Surrogate
from indentfit.runs.forward import ForwardModel, Report

PENALTY = 1e3  # objective of a failed point over that of the worst successful point, inside the algorithms only
STALLED = 4  # generations without progress that end a search
SPREAD = 1e-3  # of the ranges: a population narrower than this has gathered at one place


@dataclass(frozen=True)
class Search:
    """The outcome of a search.

    Parameters
    ----------
    best : Candidate or None
        None where every point failed.
    history : tuple of HistoryStep
    message : str
        Why the search ended.
    last : tuple of Candidate
        The last generation.
    """

    best: Candidate | None
    history: tuple[HistoryStep, ...]
    message: str
    last: tuple[Candidate, ...] = ()


class Generations:
    """Judges the generations of one search, and keeps its best and its history."""

    def __init__(
        self, problem: InverseProblem, model: ForwardModel, generations: int, phase: str, progress: Progress = SILENT
    ) -> None:
        self.problem, self.model, self.generations, self.phase, self.progress = problem, model, generations, phase, progress
        self.best: Candidate | None = None
        self.history: list[HistoryStep] = []
        self.last: tuple[Candidate, ...] = ()
        self._worst = 0.0

    def judge(self, rows: Array) -> Array:
        """Objectives (m,) of rows (m, n_searched) in units of the ranges; failures count as far worse than all others."""
        points = [parameters_of(self.problem, row) for row in rows]
        candidates = judged(self.problem, self.model, points, self._report())
        self.last = tuple(candidate for candidate in candidates if candidate)
        known = [candidate.objective for candidate in self.last]
        best_so_far = [candidate for candidate in [self.best, *self.last] if candidate]
        self.best = min(best_so_far, key=by_objective, default=None)
        objective = self.best.objective if self.best else None
        self.history.append(HistoryStep(self.phase, len(self.history) + 1, objective, self.model.runs))
        self._worst = max(self._worst, PENALTY * (max(known, default=0.0) + 1.0))
        return np.array([candidate.objective if candidate else self._worst for candidate in candidates])

    def settled(self, rows: Array, tolerance: float) -> bool:
        """Whether the best has not improved for some generations and the population (m, n) has gathered around it."""
        objectives = [step.objective for step in self.history[-1 - STALLED :]]
        if len(objectives) <= STALLED or objectives[0] is None or objectives[-1] is None:
            return False
        still = objectives[0] - objectives[-1] <= tolerance * objectives[-1]
        return bool(still and np.std(rows, axis=0).max() < SPREAD)

    def result(self, message: str) -> Search:
        """The outcome of the search so far."""
        return Search(self.best, tuple(self.history), message, self.last)

    def _report(self) -> Report:
        """Report of the progress within one generation, as a share of the whole search."""
        done = len(self.history)
        note = f"generation {done + 1}" + (f", objective {quantity(self.best.objective, 'mN')}" if self.best else "")
        return self.progress.part(*(min(number / self.generations, 1.0) for number in (done, done + 1))).of_runs(note)


def by_objective(candidate: Candidate) -> float:
    """The key that sorts candidates under equation (1)."""
    return candidate.objective


def only_scale(problem: InverseProblem, model: ForwardModel) -> Search:
    """The outcome where only the scale is free: one run gives its best value, without a search."""
    best = judged(problem, model, [problem.start])[0]
    history = (HistoryStep("scale", 1, best.objective if best else None, model.runs),)
    return Search(best, history, "only the scale parameter is free: found exactly")


def start_row(problem: InverseProblem) -> Array:
    """The start values of the searched parameters, units of the ranges, (n_searched,)."""
    return problem.place(problem.start)


def parameters_of(problem: InverseProblem, row: Array) -> dict[str, float]:
    """All parameters, from the searched parameters in units of their ranges, (n_searched,), and the scale at its start."""
    units = problem.units(problem.start)
    units[problem.searched_numbers] = row
    return problem.parameters(units)


def judged(
    problem: InverseProblem, model: ForwardModel, points: Sequence[Mapping[str, Any]], report: Report | None = None
) -> list[Candidate | None]:
    """The Candidate of each point with its best scale, None where the mechanics failed."""
    if isinstance(model, Surrogate):  # its derivatives can be had later; in time they cost many times what the curves do
        evaluations = model.evaluate([problem.at_reference(point) for point in points], report)
    else:
        evaluations = evaluate_at_reference(problem, model, points, report)
    solved = [known for known in evaluations if known.forces]
    candidates = iter(problem.judge_best_scales([known.parameters for known in solved], [known.forces or () for known in solved]))
    return [next(candidates) if known.forces else None for known in evaluations]
