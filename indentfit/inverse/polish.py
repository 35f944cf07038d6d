"""The polish: Gauss-Newton on equation (1), a weighted sum of norms, from the best place of a global search."""

import numpy as np
import scipy.optimize

from indentfit.arrays import Array
from indentfit.inverse.derivatives import Underivable
from indentfit.inverse.generations import by_objective
from indentfit.inverse.local import RESOLVED, SHORTEST, WIDEST, Course, Optimum
from indentfit.inverse.objective import equation_one
from indentfit.inverse.problem import Candidate, InverseProblem
from indentfit.inverse.progress import SILENT, Progress
from indentfit.runs.forward import ForwardModel

STEPS = 20  # largest number of steps
REWEIGHTED = 200  # largest number of reweightings in one step


def polish(
    problem: InverseProblem,
    model: ForwardModel,
    start: Candidate,
    tolerance: float = 1e-6,
    progress: Progress = SILENT,
    surrogate: ForwardModel | None = None,
) -> Optimum:
    """Optimum of equation (1) near a Candidate.

    Each step minimises equation (1) of the linearised curves within the bounds and a trust region; a run then tries the step.

    Parameters
    ----------
    problem : InverseProblem
    model : ForwardModel
    start : Candidate
    tolerance : float
        Relative fall of equation (1) that a step must promise.
    progress : Progress
    surrogate : ForwardModel or None
        Supplies derivatives that would need runs of their own, until it predicts no better place.

    Returns
    -------
    Optimum
    """
    course = Course(problem, model, "polish", by_objective, progress)
    course.best = start
    x, best, radius = problem.units(start.parameters), start, WIDEST
    message, success = f"still moving after {STEPS} steps", False
    nothing = RESOLVED * equation_one(problem.tests, [0 * force for force in start.forces])
    try:
        for _ in range(STEPS):
            step, promised = _step(problem, best, course.derivatives(x, surrogate), x, radius)
            if promised <= max(tolerance * best.objective, nothing) or np.abs(step).max() < SHORTEST:
                if surrogate is not None:
                    surrogate = None  # from here on the true derivatives, which the result needs anyway
                    continue
                message, success = "no step would lower the objective", True
                break
            trial = course.candidate(np.clip(x + step, 0, 1))
            gain = best.objective - trial.objective if trial else -np.inf
            if trial and gain > 0:
                x, best = np.clip(x + step, 0, 1), trial
            length = np.abs(step).max()
            radius = max(radius, 2 * length) if gain > 0.25 * promised else length / (2 if trial else 4)
        return course.ended(best, course.derivatives(x), success, message)
    except Underivable as failure:
        return course.ended(best, None, False, str(failure))


def _step(problem: InverseProblem, candidate: Candidate, slopes: tuple[Array, ...], x: Array, radius: float) -> tuple[Array, float]:
    """The step within bounds and radius that minimises equation (1) of the linearised curves, and the promised fall.

    A sum of norms, minimised by bounded linear least squares with weights that follow the norms.
    """
    parts = [
        (test.of_rmse / np.sqrt(force.size), test.curve.trust * (force - test.curve.force), test.curve.trust[:, None] * slope)
        for test, force, slope in zip(problem.tests, candidate.forces, slopes, strict=True)
        if test.weight
    ]
    floor = 1e-9 * max(np.linalg.norm(test.curve.force) for test in problem.tests)
    low, high = np.maximum(-x, -radius), np.minimum(1 - x, radius)
    bounds = np.minimum(low, -1e-12), np.maximum(high, 1e-12)  # scipy wants room between them

    def value(step: Array) -> float:
        return float(sum(w * np.linalg.norm(r + d @ step) for w, r, d in parts))

    best = step = np.zeros(len(x))
    for _ in range(REWEIGHTED):
        weights = [np.sqrt(w / max(np.linalg.norm(r + d @ step), floor)) for w, r, d in parts]
        A = np.concatenate([s * d for s, (_, _, d) in zip(weights, parts, strict=True)])
        b = -np.concatenate([s * r for s, (_, r, _) in zip(weights, parts, strict=True)])
        step = scipy.optimize.lsq_linear(A, b, bounds, method="bvls", tol=1e-14).x
        if value(step) >= value(best) * (1 - 1e-10):
            break
        best = step
    return best, value(np.zeros(len(x))) - value(best)
