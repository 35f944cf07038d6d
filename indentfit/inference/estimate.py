"""Estimates on a surrogate: the parameters that minimise the weighted squares, some of them held."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import least_squares

from indentfit.arrays import Array
from indentfit.inverse.exploration import scanned
from indentfit.inverse.generations import by_objective, judged, parameters_of
from indentfit.inverse.polish import polish
from indentfit.inverse.problem import Candidate, InverseProblem
from indentfit.inverse.surrogate import Surrogate


@dataclass(frozen=True, eq=False)
class _Residuals:
    """Weighted residuals of a surrogate's curves, and their derivatives, by the free parameters in units of their ranges."""

    problem: InverseProblem
    surrogate: Surrogate
    roots: Array
    targets: Array
    kept: dict[bytes, tuple[Array, Array]] = field(default_factory=dict)

    def at(self, x: Array) -> Array:
        """(N,) at x, (n_free,)."""
        curves, _ = self._at(x)
        return self.roots * (self._factor(x) * curves - self.targets)

    def jacobian(self, x: Array) -> Array:
        """(N, n_free) at x, (n_free,)."""
        problem, searched = self.problem, self.problem.searched_numbers
        J, (curves, slopes) = np.zeros((self.targets.size, len(x))), self._at(x)
        J[:, searched] = self._factor(x) * slopes.T
        if problem.scale is not None:
            steepness = problem.range(problem.scale) / problem.reference
            J[:, problem.number(problem.scale)] = steepness * curves
        return self.roots[:, None] * J

    def _at(self, x: Array) -> tuple[Array, Array]:
        """Curves and slopes of the surrogate at x; those at the last place are kept, since a step asks for both."""
        key = x.tobytes()
        if key not in self.kept:
            self.kept.clear()
            self.kept[key] = self.surrogate.at(x[self.problem.searched_numbers])
        return self.kept[key]

    def _factor(self, x: Array) -> float:
        problem = self.problem
        if problem.scale is None:
            return 1.0
        unit = x[problem.number(problem.scale)]
        return (problem.free[problem.scale].min + unit * problem.range(problem.scale)) / problem.reference


def estimate(
    problem: InverseProblem,
    surrogate: Surrogate,
    weights: Sequence[float],
    x: Array,
    fixed: int | None = None,
    targets: Sequence[Array] | None = None,
) -> tuple[Array, float]:
    """The parameters that minimise sum w |r|^2 on a surrogate, within the bounds.

    Parameters
    ----------
    problem : InverseProblem
    surrogate : Surrogate
    weights : sequence of float
        Weights of the squared residuals of each test.
    x : array (n_free,), units of the ranges
        The start of the search.
    fixed : int or None
        Number of a parameter that keeps its value in x.
    targets : sequence of arrays (n,), mN, or None
        Curves in place of the measured ones.

    Returns
    -------
    array (n_free,), units of the ranges; float, the least sum
    """
    moving = [n for n in range(len(x)) if n != fixed]
    wanted = targets if targets is not None else [test.curve.force for test in problem.tests]
    roots = [np.sqrt(w) * test.curve.trust for test, w in zip(problem.tests, weights, strict=True)]
    residuals = _Residuals(problem, surrogate, np.concatenate(roots), np.concatenate(wanted))

    def whole(part: Array) -> Array:
        full = np.array(x, dtype=float)
        full[moving] = part
        return full

    def residuals_of(part: Array) -> Array:
        return residuals.at(whole(part))

    def jacobian_of(part: Array) -> Array:
        return residuals.jacobian(whole(part))[:, moving]

    if not moving:
        return np.array(x), float(np.sum(residuals.at(np.array(x, dtype=float)) ** 2))
    start = np.clip(np.asarray(x)[moving], 0, 1)
    tolerances = {"ftol": 1e-10, "xtol": 1e-8, "gtol": 1e-12}
    ended = least_squares(residuals_of, start, jacobian_of, bounds=(0, 1), method="dogbox", max_nfev=60, **tolerances)
    return whole(ended.x), float(2 * ended.cost)


def best_on(problem: InverseProblem, surrogate: Surrogate, seed: int) -> Candidate:
    """The Candidate of least objective on the surrogate, from the best places of a scan."""
    if not problem.searched:
        return _required(judged(problem, surrogate, [problem.start])[0])
    places, squares = scanned(problem, surrogate, seed)
    starts = judged(problem, surrogate, [parameters_of(problem, place) for place in places[np.argsort(squares)[:3]]])
    ends = [_required(polish(problem, surrogate, start).best) for start in starts if start]
    return min(ends, key=by_objective)


def _required(candidate: Candidate | None) -> Candidate:
    assert candidate is not None, "a surrogate fails only near failed runs, and no scan goes there"
    return candidate
