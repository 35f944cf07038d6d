"""Least squares: Gauss-Newton under the sum of squares, within bounds and a trust region, in units of the ranges."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import scipy.optimize

from indentfit.arrays import Array
from indentfit.inverse.derivatives import Underivable, evaluate_at_reference, last_cause
from indentfit.inverse.local import RESOLVED, SHORTEST, WIDEST, Course, Optimum, stacked
from indentfit.inverse.objective import misfit, sum_of_squares
from indentfit.inverse.problem import Candidate, InverseProblem
from indentfit.inverse.progress import SILENT, Progress
from indentfit.runs.forward import ForwardModel

EVALUATIONS = 40  # largest number of evaluations of the curves, without those for derivatives
SHARE_OF_STARTS = 0.2  # of the progress


def least_squares(
    problem: InverseProblem,
    model: ForwardModel,
    start: Mapping[str, Any],
    tolerance: float = 1e-6,
    progress: Progress = SILENT,
) -> Optimum:
    """Optimum of the sum of w RMSE^2, by Gauss-Newton within bounds and a trust region.

    The scale parameter follows every step exactly (variable projection, Golub and Pereyra 1973). This removes the narrow valley
    between the scale and the other parameters, along which other methods creep. A failed run shortens the step; a failed start or
    derivative ends the search.

    Parameters
    ----------
    problem : InverseProblem
    model : ForwardModel
    start : dict of name -> value
    tolerance : float
        Relative fall of the sum of squares that a step must promise.
    progress : Progress

    Returns
    -------
    Optimum
    """
    course = Course(problem, model, "least_squares", _by_squares, progress)
    best = course.candidate(problem.units(start))
    if best is None:
        return _no_start(model)
    radius, message, success = WIDEST, f"still moving after {EVALUATIONS} evaluations", False
    nothing = RESOLVED**2 * sum_of_squares(problem.tests, [0 * force for force in best.forces])
    try:
        for _ in range(EVALUATIONS):
            x = problem.units(best.parameters)
            step, promised = _step(problem, best, course.derivatives(x), radius)
            if promised <= max(tolerance * best.sum_of_squares, nothing) or np.abs(step).max() < SHORTEST:
                message, success = "no step would lower the sum of squares", True
                break
            trial = course.candidate(np.clip(x + step, 0, 1))
            trial = trial and _with_best_scale(problem, trial)
            gain = best.sum_of_squares - trial.sum_of_squares if trial else -np.inf
            length = np.abs(step).max()
            radius = max(radius, 2 * length) if gain > 0.25 * promised else length / (2 if trial else 4)
            best = trial if trial and gain > 0 else best
        return course.ended(best, course.derivatives(problem.units(best.parameters)), success, message)
    except Underivable as failure:
        return course.ended(best, None, False, str(failure))


def multi_start(
    problem: InverseProblem,
    model: ForwardModel,
    starts: Sequence[Mapping[str, Any]],
    searches: int,
    tolerance: float = 1e-6,
    progress: Progress = SILENT,
) -> Optimum:
    """Optimum of the sum of squares: the best of several local searches.

    Every start (name -> value) is run once, at its best scale; `searches` local searches begin at the starts with the least sums of
    squares.
    """
    report = progress.part(0, SHARE_OF_STARTS).of_runs("starts")
    tried = evaluate_at_reference(problem, model, starts, report)
    pairs = zip(starts, tried, strict=True)
    candidates = [problem.judge_best_scale(point, known.forces) for point, known in pairs if known.forces]
    if not candidates:
        return _no_start(model)
    candidates.sort(key=_by_squares)
    ends = [least_squares(problem, model, candidate.parameters, tolerance, progress) for candidate in candidates[:searches]]
    best = min(ends, key=_squares_at_end)
    history = tuple(step for end in ends for step in end.history)
    agree = sum(_squares_at_end(end) <= 1.01 * _squares_at_end(best) for end in ends)
    said = f"; {agree} of {len(ends)} searches ended there" if len(ends) > 1 else ""
    return replace(best, message=best.message + said, history=history)


def _no_start(model: ForwardModel) -> Optimum:
    return Optimum(None, None, False, f"the mechanics failed at the start values: {last_cause(model)}", ())


def _by_squares(candidate: Candidate) -> float:
    return candidate.sum_of_squares


def _squares_at_end(end: Optimum) -> float:
    return end.best.sum_of_squares if end.best else np.inf


def _step(problem: InverseProblem, candidate: Candidate, slopes: tuple[Array, ...], radius: float) -> tuple[Array, float]:
    """The step within bounds and radius that minimises the sum of squares of the linearised curves, and the promised fall."""
    x = problem.units(candidate.parameters)
    A = stacked(problem.tests, slopes)
    b = -np.concatenate([misfit(test, force) for test, force in zip(problem.tests, candidate.forces, strict=True)])
    low, high = np.minimum(np.maximum(-x, -radius), -1e-12), np.maximum(np.minimum(1 - x, radius), 1e-12)
    if problem.scale:  # the scale follows every step exactly
        n = problem.number(problem.scale)
        low[n], high[n] = -x[n] - 1e-12, 1 - x[n] + 1e-12
    step = scipy.optimize.lsq_linear(A, b, (low, high), tol=1e-14).x
    return step, float(b @ b - np.sum((A @ step - b) ** 2))


def _with_best_scale(problem: InverseProblem, candidate: Candidate) -> Candidate:
    """The Candidate at the scale that minimises the sum of squares, within the scale's bounds."""
    if not problem.scale:
        return candidate
    triples = [
        (t.of_square / len(f) * t.curve.trust**2, f, t.curve.force) for t, f in zip(problem.tests, candidate.forces, strict=True)
    ]
    factor = sum((w * f) @ target for w, f, target in triples) / sum((w * f) @ f for w, f, target in triples)
    bounds, value = problem.free[problem.scale], candidate.parameters[problem.scale]
    scaled = float(np.clip(factor * value, bounds.min, bounds.max))
    forces = [force * problem.reference / value for force in candidate.forces]
    return problem.judge({**candidate.parameters, problem.scale: scaled}, forces)
