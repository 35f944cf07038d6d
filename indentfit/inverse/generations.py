"""What the global searches share: a population judged at once under equation (1), each member at its best scale."""

from dataclasses import dataclass

import numpy as np

from indentfit.inverse.derivatives import evaluate_at_reference
from indentfit.inverse.problem import Candidate

PENALTY = 1e3  # a failed point counts as this times the worst that succeeded, inside the algorithms only
STALLED = 4  # generations without progress that end a search
SPREAD = 1e-3  # of the ranges: a population narrower than this has gathered at one place


@dataclass(frozen=True)
class Search:
    """What a search found: the best Candidate (None where every point failed), its course, and the last population."""

    best: Candidate | None
    history: list[dict]
    message: str
    last: tuple[Candidate, ...] = ()


class Generations:
    """Judges generations of one search, and keeps its best and its history; pool: a Pool or a Surrogate."""

    def __init__(self, problem, pool, generations, phase, progress=None):
        self.problem, self.pool, self.generations, self.phase, self.progress = problem, pool, generations, phase, progress
        self.best, self.history, self.last = None, [], ()
        self._worst = 0.0

    def judge(self, rows):
        """Objectives (m,) of rows (m, n_searched) in units of the ranges; failures count as far worse than all others."""
        points = [parameters_of(self.problem, row) for row in rows]
        candidates = judged(self.problem, self.pool, points, self._report())
        self.last = tuple(candidate for candidate in candidates if candidate)
        known = [candidate.objective for candidate in self.last]
        self.best = min([c for c in [self.best, *self.last] if c], key=lambda c: c.objective, default=None)
        row = {"phase": self.phase, "step": len(self.history) + 1, "objective": self.best and self.best.objective}
        self.history.append({**row, "runs": self.pool.runs})
        self._worst = max(self._worst, PENALTY * (max(known, default=0.0) + 1.0))
        return np.array([candidate.objective if candidate else self._worst for candidate in candidates])

    def settled(self, rows, tolerance):
        """Whether the best has stood still for some generations and the population (m, n) has gathered around it."""
        objectives = [row["objective"] for row in self.history[-1 - STALLED :]]
        if len(objectives) <= STALLED or objectives[0] is None:
            return False
        still = objectives[0] - objectives[-1] <= tolerance * objectives[-1]
        return bool(still and np.std(rows, axis=0).max() < SPREAD)

    def result(self, message):
        return Search(self.best, self.history, message, self.last)

    def _report(self):
        """Progress of the runs of one population as (share of the whole search, note)."""
        if self.progress is None:
            return None
        done = len(self.history)
        note = f"generation {done + 1}" + (f", objective {self.best.objective:.4g} mN" if self.best else "")
        return lambda part, total: self.progress(min((done + part / total) / self.generations, 1.0), note)


def only_scale(problem, pool):
    """No search where only the scale is free: one run gives its best value."""
    best = judged(problem, pool, [problem.start])[0]
    history = [{"phase": "scale", "step": 1, "objective": best and best.objective, "runs": pool.runs}]
    return Search(best, history, "only the scale parameter is free: found exactly")


def start_row(problem):
    """The start values, units of the ranges of the searched parameters."""
    return problem.units(problem.start)[_searched(problem)]


def parameters_of(problem, row):
    """All parameters, the scale at its start, at searched ones in units of their ranges."""
    units = problem.units(problem.start)
    units[_searched(problem)] = row
    return problem.parameters(units)


def judged(problem, pool, points, report=None):
    """The Candidate of each point with its best scale, None where the mechanics failed."""
    evaluations = evaluate_at_reference(problem, pool, points, report)
    return [problem.judge_best_scale(e.parameters, e.forces) if e.forces else None for e in evaluations]


def _searched(problem):
    return [list(problem.free).index(name) for name in problem.searched]
