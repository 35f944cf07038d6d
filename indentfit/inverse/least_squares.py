"""The local searches: Gauss-Newton under the sum of squares, and under equation (1).

Both work in units of the parameters' ranges, with the derivatives of `derivatives`.
"""

from dataclasses import dataclass, replace

import numpy as np
import scipy.optimize

from indentfit.inverse.derivatives import Underivable, brings_sensitivities, curve_derivatives, evaluate_at_reference, last_cause
from indentfit.inverse.objective import equation_one, misfit, sum_of_squares
from indentfit.inverse.problem import Candidate

RESOLVED = 1e-5  # of the measured forces' root mean square: smaller changes of the objective mean nothing
EVALUATIONS = 40  # at most, of the curves; their derivatives not counted
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
    """Optimum of the sum of w RMSE^2 from `start` (name -> value), by Gauss-Newton within bounds and a trust region.

    The scale parameter follows every step exactly (variable projection, Golub and Pereyra 1973): a narrow valley between it
    and the others, along which other methods creep, is then none. progress: called with (share, note). A failed run shortens
    the step; a failed start or derivative ends the search.
    """
    course = _Course(problem, pool, progress)
    best = course.candidate(problem.units(start))
    if best is None:
        return Optimum(None, None, False, f"the mechanics failed at the start values: {last_cause(pool)}", [])
    radius, message, success = WIDEST, f"still moving after {EVALUATIONS} evaluations", False
    nothing = RESOLVED**2 * sum_of_squares(problem.tests, [0 * force for force in best.forces])
    try:
        for _ in range(EVALUATIONS):
            x = problem.units(best.parameters)
            step, promised = _step_of_squares(problem, best, course.derivatives(x), x, radius)
            if promised <= max(tolerance * best.sum_of_squares, nothing) or np.abs(step).max() < SHORTEST:
                message, success = "no step would lower the sum of squares", True
                break
            trial = course.candidate(np.clip(x + step, 0, 1))
            trial = trial and _with_best_scale(problem, trial)
            gain = best.sum_of_squares - trial.sum_of_squares if trial else -np.inf
            length = np.abs(step).max()
            radius = max(radius, 2 * length) if gain > 0.25 * promised else length / (2 if trial else 4)
            best = trial if gain > 0 else best
        return Optimum(best, course.derivatives(problem.units(best.parameters)), success, message, course.history)
    except Underivable as failure:
        return Optimum(best, None, False, str(failure), course.history)


def multi_start(problem, pool, starts, searches, tolerance=1e-6, progress=None):
    """Optimum of the sum of squares: the best of `searches` local searches, from the best of `starts` (name -> value).

    Every start is run once, at its best scale; the searches begin where the sum of squares was least.
    """
    tried = evaluate_at_reference(problem, pool, starts, progress and (lambda done, total: progress(0.2 * done / total, "starts")))
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

    def candidate(self, x):
        """The Candidate at x, shape (n_free,), or None where the mechanics failed."""
        parameters = self.problem.parameters(x)
        evaluation = evaluate_at_reference(self.problem, self.pool, [parameters], self.report)[0]
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
            return curve_derivatives(self.problem, surrogate, x)
        return curve_derivatives(self.problem, self.pool, x, self.report)

    def _share(self):
        return 1 - 0.7 ** (1 + len(self.history) / 2)  # how many steps it takes is not known beforehand

    def _note(self):
        return f"{self.phase.replace('_', ' ')}" + (f", objective {self.best.objective:.4g} mN" if self.best else "")


def stacked(tests, slopes):
    """Derivatives of the misfits of all tests, shape (N, n_free), from those of their curves."""
    weighted = [np.sqrt(t.weight / t.curve.force.size) * d for t, d in zip(tests, slopes, strict=True)]
    return np.concatenate(weighted)


def _step_of_squares(problem, candidate, slopes, x, radius):
    """The step that makes the sum of squares of the linearised curves least, and by how much, within bounds and radius."""
    A = stacked(problem.tests, slopes)
    b = -np.concatenate([misfit(t, f) for t, f in zip(problem.tests, candidate.forces, strict=True)])
    low, high = np.minimum(np.maximum(-x, -radius), -1e-12), np.maximum(np.minimum(1 - x, radius), 1e-12)
    if problem.scale:  # it follows by itself
        n = list(problem.free).index(problem.scale)
        low[n], high[n] = -x[n] - 1e-12, 1 - x[n] + 1e-12
    step = scipy.optimize.lsq_linear(A, b, (low, high), tol=1e-14).x
    return step, float(b @ b - np.sum((A @ step - b) ** 2))


def _with_best_scale(problem, candidate):
    """The Candidate at the scale that makes the sum of squares least, within its bounds."""
    if not problem.scale:
        return candidate
    pairs = [(t.weight / len(f), f, t.curve.force) for t, f in zip(problem.tests, candidate.forces, strict=True)]
    factor = sum(w * (f @ target) for w, f, target in pairs) / sum(w * (f @ f) for w, f, target in pairs)
    bounds, value = problem.free[problem.scale], candidate.parameters[problem.scale]
    scaled = float(np.clip(factor * value, bounds.min, bounds.max))
    forces = [force * problem.reference / value for force in candidate.forces]
    return problem.judge({**candidate.parameters, problem.scale: scaled}, forces)


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
