"""Many small problems of least squares at once, each within the bounds 0 and 1: fits to drawn curves on a surrogate.

Levenberg's and Marquardt's iteration, with the parameters held that the gradient presses against a bound. All problems take
their steps together, so that an iteration costs a few calls of NumPy for all of them; one that has ended takes no part any more.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from indentfit.arrays import Array, Bools, Ints
from indentfit.inverse.problem import InverseProblem
from indentfit.inverse.surrogate import Surrogate

ITERATIONS = 80  # at most
FALL, STEP = 1e-8, 1e-7  # relative fall of the squares, and step in units of the ranges, that end a problem
FIRST, LEAST, MOST = 1e-3, 1e-9, 1e9  # damping at first, at least, and where a problem is given up
EASED, RAISED = 0.2, 6.0  # factors on the damping after a step that helps, and after one that does not
FLAT = 1e-12  # of the largest diagonal element of the normal equations, so that a direction that changes nothing keeps its place


@dataclass(frozen=True, eq=False)
class Problems:
    """Problems of the same size, told apart by their numbers.

    Parameters
    ----------
    residuals : function of places (m, n) and numbers (m,), giving (m, N)
    slopes : function of the same, giving (m, N, n)
    """

    residuals: Callable[[Array, Ints], Array]
    slopes: Callable[[Array, Ints], Array]

    def minimised(self, starts: Array) -> tuple[Array, Array]:
        """The places (m, n) of least squares near the starts (m, n), and the squares there (m,)."""
        x = np.clip(np.asarray(starts, dtype=float), 0, 1)
        r = self.residuals(x, np.arange(len(x)))
        squares, damping = np.sum(r**2, axis=1), np.full(len(x), FIRST)
        H, g = self._normal(x, np.arange(len(x)), r)
        going = np.arange(len(x))
        for _ in range(ITERATIONS):
            if not going.size:
                break
            trial = np.clip(x[going] + _step(H[going], g[going], damping[going], x[going]), 0, 1)
            tried = self.residuals(trial, going)
            there = np.sum(tried**2, axis=1)
            better = there < squares[going]
            ended = self._ended(x[going], trial, squares[going], there, better) | (damping[going] > MOST)
            moved = going[better]
            x[moved], squares[moved] = trial[better], there[better]
            if moved.size:
                H[moved], g[moved] = self._normal(trial[better], moved, tried[better])
            damping[going] = np.maximum(damping[going] * np.where(better, EASED, RAISED), LEAST)
            going = going[~ended]
        return x, squares

    def _normal(self, x: Array, numbers: Ints, r: Array) -> tuple[Array, Array]:
        """The normal equations: matrices (m, n, n) and gradients (m, n)."""
        J = self.slopes(x, numbers)
        return np.swapaxes(J, 1, 2) @ J, np.einsum("mNn,mN->mn", J, r)

    @staticmethod
    def _ended(x: Array, trial: Array, squares: Array, there: Array, better: Bools) -> Bools:
        little = squares - there <= FALL * squares
        return np.where(better, little, np.abs(trial - x).max(axis=1) <= STEP)


@dataclass(frozen=True, eq=False)
class ManyCurves:
    """Curves of all tests in a row, mN, on a surrogate at many places of the free parameters, in units of their ranges."""

    problem: InverseProblem
    surrogate: Surrogate

    def curves(self, x: Array) -> Array:
        """(m, N) at x (m, n_free)."""
        return self._factors(x)[:, None] * self.surrogate.curves(x[:, self.problem.searched_numbers])

    def slopes(self, x: Array) -> Array:
        """Their derivatives by the units, (m, N, n_free)."""
        problem, places = self.problem, x[:, self.problem.searched_numbers]
        own = self._factors(x)[:, None, None] * np.swapaxes(self.surrogate.slopes(places), 1, 2)
        if problem.scale is None:
            return own
        J = np.empty((*own.shape[:2], x.shape[1]))
        J[:, :, problem.searched_numbers] = own
        J[:, :, problem.number(problem.scale)] = problem.range(problem.scale) / problem.reference * self.surrogate.curves(places)
        return J

    def _factors(self, x: Array) -> Array:
        problem = self.problem
        if problem.scale is None:
            return np.ones(len(x))
        low, high = problem.factor_bounds()
        return np.asarray(low + x[:, problem.number(problem.scale)] * (high - low))


def _step(H: Array, g: Array, damping: Array, x: Array) -> Array:
    """The damped steps (m, n)."""
    held = ((x <= 0) & (g > 0)) | ((x >= 1) & (g < 0))
    diagonal = np.einsum("mnn->mn", H)
    floor = FLAT * np.maximum(diagonal.max(axis=1, keepdims=True), 1e-300)
    A = np.where(held[:, :, None] | held[:, None, :], 0.0, H)
    n = np.arange(x.shape[1])
    A[:, n, n] = np.where(held, 1.0, diagonal + damping[:, None] * np.maximum(diagonal, floor) + floor)
    return np.asarray(-np.linalg.solve(A, np.where(held, 0.0, g)[:, :, None])[:, :, 0])
