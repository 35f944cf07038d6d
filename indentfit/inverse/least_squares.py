"""The local searches: scipy's least squares under the sum of squares, and Gauss-Newton under equation (1).

Both work in units of the parameters' ranges, with the derivatives of `derivatives`.
"""

from dataclasses import dataclass, replace

import numpy as np
import scipy.optimize

from indentfit.inverse.derivatives import Underivable, brings_sensitivities, derivatives, evaluate, last_cause
from indentfit.inverse.objective import Candidate, equation_one, misfit

RESOLVED = 1e-5  # of the measured forces' root mean square: smaller changes of the objective mean nothing
EVALUATIONS = 40  # at most, of the curves; their derivatives not counted
ENDS = {1: "the gradient vanished", 2: "the sum of squares stood still", 3: "the steps became small",
        4: "the sum of squares stood still and the steps became small"}  # fmt: skip
STEPS_OF_POLISH = 20
WIDEST = 0.5  # of the ranges: the first trust region of the polish
SHORTEST = 1e-4  # of the ranges: a shorter step is no step


@dataclass(frozen=True)
class Optimum:
    """Where a local search ended: the Candidate (None where not even its start could be evaluated), the derivatives of
    the curves there, mN per range of a free parameter, one (n, n_free) for each test (None where they failed)."""

    best: Candidate | None
    derivatives: tuple[np.ndarray, ...] | None
    success: bool
    message: str
    history: list[dict]


def least_squares(problem, pool, start, tolerance=1e-6, progress=None):
    """Optimum of the sum of w RMSE^2 from `start` (name -> value), by scipy's dogleg within the bounds,
    which reaches a bound in one step where its other methods creep up to it.

    progress: called with (share, note). A failed run shortens the step; a failed start or derivative ends the search.
    """
    course = _Course(problem, pool, progress)
    first = course.candidate(problem.units(start))
    if first is None:
        return Optimum(None, None, False, f"the mechanics failed at the start values: {last_cause(pool)}", [])
    try:
        found = scipy.optimize.least_squares(
            course.residuals,
            problem.units(first.parameters),
            course.jacobian,
            bounds=(0, 1),
            method="dogbox",
            ftol=tolerance,
            xtol=SHORTEST,
            gtol=1e-12,
            max_nfev=EVALUATIONS,
        )
        slopes = course.derivatives(found.x)
    except Underivable as failure:
        return Optimum(course.best, None, False, str(failure), course.history)
    message = ENDS.get(found.status, f"still moving after {EVALUATIONS} evaluations")
    return Optimum(course.best, slopes, found.status > 0, message, course.history)


def multi_start(problem, pool, starts, searches, tolerance=1e-6, progress=None):
    """Optimum of the sum of squares: the best of `searches` local searches, from the best of `starts` (name -> value).

    Every start is run once, at its best scale; the searches begin where the sum of squares was least.
    """
    tried = evaluate(problem, pool, starts, progress and (lambda done, total: progress(0.2 * done / total, "starts")))
    candidates = [problem.judge_best_scale(point, one.forces) for point, one in zip(starts, tried, strict=True) if one.forces]
    if not candidates:
        return Optimum(None, None, False, f"the mechanics failed at the start values: {last_cause(pool)}", [])
    candidates.sort(key=lambda candidate: candidate.sum_of_squares)
    ends = [least_squares(problem, pool, one.parameters, tolerance, progress) for one in candidates[:searches]]
    best = min(ends, key=lambda end: end.best.sum_of_squares)
    history = [row for end in ends for row in end.history]
    agree = sum(end.best.sum_of_squares <= 1.01 * best.best.sum_of_squares for end in ends)
    said = f"; {agree} of {len(ends)} searches ended there" if len(ends) > 1 else ""
    return replace(best, message=best.message + said, history=history)


def polish(problem, pool, start, tolerance=1e-6, progress=None, surrogate=None):
    """Optimum of equation (1) from the Candidate `start`, by Gauss-Newton on it.

    Each step minimises equation (1) of the linearised curves within the bounds and a trust region, then is tried. A
    surrogate, if given, supplies derivatives that would need runs of their own until it sees no better place.
    """
    course = _Course(problem, pool, progress, "polish", lambda candidate: candidate.objective, start)
    x, best, radius = problem.units(start.parameters), start, WIDEST
    message, success = f"still moving after {STEPS_OF_POLISH} steps", False
    nothing = RESOLVED * equation_one(problem.tests, [0 * force for force in start.forces])
    try:
        for _ in range(STEPS_OF_POLISH):
            step, promised = _step(problem, best, course.derivatives(x, surrogate), x, radius)
            if promised <= max(tolerance * best.objective, nothing) or np.abs(step).max() < SHORTEST:
                if surrogate is not None:
                    surrogate = None  # from here on the true ones, which the end needs anyway
                    continue
                message, success = "no step would lower the objective", True
                break
            trial = course.candidate(np.clip(x + step, 0, 1))
            gain = best.objective - trial.objective if trial else -np.inf
            if gain > 0:
                x, best = np.clip(x + step, 0, 1), trial
            length = np.abs(step).max()
            radius = max(radius, 2 * length) if gain > 0.25 * promised else length / (2 if trial else 4)
        return Optimum(best, course.derivatives(x), success, message, course.history)
    except Underivable as failure:
        return Optimum(best, None, False, str(failure), course.history)


class _Course:
    """The evaluations of one local search, remembered, and their derivatives."""

    def __init__(self, problem, pool, progress, phase="least_squares", value=lambda c: c.sum_of_squares, best=None):
        self.problem, self.pool, self.phase, self.value = problem, pool, phase, value
        self.best, self.history = best, []
        self.report = (lambda done, total: progress(self._share(), self._note())) if progress else None

    def residuals(self, x):
        """Misfits of all tests, shape (N,); NaN where the mechanics failed, which makes scipy shorten its step."""
        candidate = self.candidate(x)
        if candidate is None:
            return np.full(sum(test.curve.force.size for test in self.problem.tests), np.nan)
        return np.concatenate([misfit(t, f) for t, f in zip(self.problem.tests, candidate.forces, strict=True)])

    def jacobian(self, x):
        """Derivatives of the residuals, shape (N, n_free)."""
        return stacked(self.problem.tests, self.derivatives(x))

    def candidate(self, x):
        """The Candidate at x, shape (n_free,), or None where the mechanics failed."""
        parameters = self.problem.parameters(x)
        evaluation = evaluate(self.problem, self.pool, [parameters], self.report)[0]
        if evaluation.forces is None:
            return None
        candidate = self.problem.judge(parameters, evaluation.forces)
        if self.best is None or self.value(candidate) < self.value(self.best):
            self.best = candidate
        if not self.history or self.history[-1]["runs"] < self.pool.runs:
            row = {"phase": self.phase, "step": len(self.history) + 1, "objective": self.best.objective}
            self.history.append({**row, "runs": self.pool.runs})
        return candidate

    def derivatives(self, x, surrogate=None):
        """Derivatives of the curves at x, mN per range, an array (n, n_free) for each test. Raises Underivable."""
        if surrogate is not None and not brings_sensitivities(self.problem, self.pool, x):
            return derivatives(self.problem, surrogate, x)
        return derivatives(self.problem, self.pool, x, self.report)

    def _share(self):
        return 1 - 0.7 ** (1 + len(self.history) / 2)  # how many steps it takes is not known beforehand

    def _note(self):
        return f"{self.phase.replace('_', ' ')}" + (f", objective {self.best.objective:.4g} mN" if self.best else "")


def stacked(tests, slopes):
    """Derivatives of the misfits of all tests, shape (N, n_free), from those of their curves."""
    weighted = [np.sqrt(t.weight / t.curve.force.size) * d for t, d in zip(tests, slopes, strict=True)]
    return np.concatenate(weighted)


def _step(problem, candidate, slopes, x, radius):
    """The step that makes equation (1) of the linearised curves least, and by how much, within bounds and radius.

    A sum of norms, minimised by bounded linear least squares with weights that follow the norms.
    """
    parts = [
        (t.weight / np.sqrt(f.size), f - t.curve.force, d)
        for t, f, d in zip(problem.tests, candidate.forces, slopes, strict=True)
        if t.weight
    ]
    floor = 1e-9 * max(np.linalg.norm(t.curve.force) for t in problem.tests)
    bounds = np.maximum(-x, -radius), np.minimum(1 - x, radius)
    bounds = np.minimum(bounds[0], -1e-12), np.maximum(bounds[1], 1e-12)  # scipy wants room between them

    def value(step):
        return sum(w * np.linalg.norm(r + d @ step) for w, r, d in parts)

    best = step = np.zeros(len(x))
    for _ in range(200):
        weights = [np.sqrt(w / max(np.linalg.norm(r + d @ step), floor)) for w, r, d in parts]
        A = np.concatenate([s * d for s, (_, _, d) in zip(weights, parts, strict=True)])
        b = -np.concatenate([s * r for s, (_, r, _) in zip(weights, parts, strict=True)])
        step = scipy.optimize.lsq_linear(A, b, bounds, tol=1e-14).x
        if value(step) >= value(best) * (1 - 1e-10):
            break
        best = step
    return best, value(np.zeros(len(x))) - value(best)
