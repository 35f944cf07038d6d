"""Values between the equilibria of a path, as functions of the depth.

Under a flat face the force begins in proportion to the depth d, under a cone as d^2: the cubic spline through all equilibria
follows both. Under a sphere the force begins as d^1.5, which no spline through steps of an eighth of the depth follows. There the
spline is that of the value over d^1.5, against sqrt(d), since the next terms of a layer's force are powers of the contact radius.

Interpolants are linear in the values, so that curves and their derivatives agree. Tangents would not improve them: where points of
the contact begin to slip, the curve's tangent jumps, and 8 steps of values alone are within 1e-4 of the largest force.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from indentfit.arrays import Array

SMOOTH = 1.0  # power of the depth by which values begin to grow that a cubic spline can follow
POWERS = {"flat": SMOOTH, "sphere": 1.5, "cone": SMOOTH}  # by indenters.IndenterShape.end


class Interpolant:
    """Values (...) as a function of the depth, from those of equilibria; zero at depth zero.

    Parameters
    ----------
    depths : array (n,), mm
        Rising, from 0.
    values : sequence of n arrays (...)
    power : float
        One of POWERS.
    """

    def __init__(self, depths: Sequence[float] | Array, values: Sequence[Any], power: float = SMOOTH) -> None:
        x, y = np.asarray(depths, dtype=float), np.asarray(values, dtype=float)
        self._depths, self._values = x, y
        self._power = power if x.size > 2 else SMOOTH
        if self._power == SMOOTH:
            self._spline = CubicSpline(x, y, axis=0)
            return
        self._spline = CubicSpline(np.sqrt(x[1:]), y[1:] / _like(x[1:] ** power, y), axis=0, bc_type=_ends(x.size - 1))

    def __call__(self, depths: Array) -> Array:
        """Values (m, ...) at depths (m,), mm."""
        if self._power == SMOOTH:
            return np.asarray(self._spline(depths))
        share, _ = self._share(np.sqrt(depths))
        return share * _like(depths**self._power, share)

    def slope(self, depths: Array) -> Array:
        """Derivatives (m, ...) by the depth, 1/mm, at depths (m,), mm."""
        if self._power == SMOOTH:
            return np.asarray(self._spline(depths, 1))
        root = np.sqrt(depths)
        share, change = self._share(root)
        grown = self._power * _like(root ** (2 * self._power - 2), share)
        return grown * share + 0.5 * _like(root ** (2 * self._power - 1), share) * change

    def doubt(self, depths: Array) -> Array:
        """Share (m,) by which values may err between the equilibria, at depths (m,), mm: how far two other interpolants differ.

        Before the first step that is a parabola through the first three, in place of a line; it is 0 for the power SMOOTH, and on
        paths of fewer steps. From the first step on it is a spline through the logarithms, which follows powers and exponentials of
        the depth: by 0.01 % on gels, by 1 % and more where the force of a steep law doubles within a step. Logarithms need positive
        values: it begins behind the last equilibrium whose value is not, and up to there the doubt is that of all of the value, 1.
        """
        depths = np.asarray(depths, dtype=float)
        return np.where(depths < self._depths[1], self._doubt_before(depths), self._doubt_between(depths))

    def _doubt_before(self, depths: Array) -> Array:
        if self._power == SMOOTH or self._depths.size < 4:
            return np.zeros(depths.size)
        root, x = np.sqrt(depths), self._spline.x[:3]
        parabola = np.asarray(np.polyval(np.polyfit(x, self._spline(x), 2), root), dtype=float)
        return _apart(parabola, self._share(root)[0])

    def _doubt_between(self, depths: Array) -> Array:
        begins = int(np.max(np.flatnonzero(self._values <= 0), initial=0)) + 1
        x, y = self._depths[begins:], self._values[begins:]
        if x.size < 4:
            return np.zeros(depths.size) if begins <= 1 else np.ones(depths.size)
        logarithms = CubicSpline(np.log(x), np.log(y))
        return np.where(depths < x[0], 1.0, _apart(np.exp(logarithms(np.log(np.maximum(depths, x[0])))), self(depths)))

    def _share(self, root: Array) -> tuple[Array, Array]:
        """The value over the power of the depth, and its derivative by sqrt(depth), at sqrt(depths) (m,).

        Before the first step the value over the power is linear.
        """
        first = np.maximum(root, self._spline.x[0])
        share, change = np.asarray(self._spline(first)), np.asarray(self._spline(first, 1))
        return share + _like(root - first, share) * change, change


def _like(factors: Array, values: Array) -> Array:
    """Factors (m,) in a shape that multiplies values (m, ...)."""
    return factors.reshape(-1, *(1,) * (values.ndim - 1))


def _apart(other: Array, own: Array) -> Array:
    """How far other values (m,) differ from the own ones, over these; 1 where these are 0."""
    return np.divide(np.abs(other - own), np.abs(own), out=np.ones_like(own), where=own != 0)


def _ends(n: int) -> str:
    """Condition at the ends of a spline through n points."""
    return "not-a-knot" if n > 3 else "natural"
