"""The curves of a joint fit at many places at once, and searches from many of them, each for measured forces of its own: what
`Curves.at` and `Climber.climb` do place by place."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from indentfit.arrays import Array, Ints
from indentfit.inference.many import ManyCurves, Problems
from indentfit.inference.posterior import Climber, Curves, Shift, basis


@dataclass(frozen=True, eq=False)
class ManyPlaces:
    """The curves at many places.

    Parameters
    ----------
    curves : Curves
    """

    curves: Curves

    def forces(self, z: Array) -> Array:
        """The curves (m, N), mN, at places (m, n)."""
        if self.curves.problem.kernel is not None:
            return np.array([self.curves.at(place)[0] for place in z])
        forces = self._solved.curves(self._units(z)[0]) * (1 + self.curves.mesh)
        for n, rows, shift in self._of_tests():
            value = self._values(n, z)
            forces[:, rows] = forces[:, rows] * (1 + value) if shift is None else _moved(shift, value, forces[:, rows])
        return forces

    def slopes(self, z: Array) -> Array:
        """Their derivatives (m, N, n) by the coordinates."""
        curves = self.curves
        if curves.problem.kernel is not None:
            return np.array([curves.at(place)[1] for place in z])
        units, ahead = self._units(z)
        forces = self._solved.curves(units) * (1 + curves.mesh)
        J = np.zeros((*forces.shape, curves.size))
        J[:, :, curves.columns] = self._solved.slopes(units) * (1 + curves.mesh)[:, None] * ahead[:, None]
        for n, rows, shift in self._of_tests():
            value, (low, high) = self._values(n, z), curves.inputs[n - len(curves.free)].ends
            if shift is None:
                J[:, rows] *= 1 + value[:, :, None]
                J[:, rows, n] = forces[:, rows] * (high - low)
                forces[:, rows] *= 1 + value
            else:
                J[:, rows] = np.array([_moved(shift, value, J[:, rows, k]) for k in range(curves.size)]).transpose(1, 2, 0)
                J[:, rows, n] = _slope(shift, value, forces[:, rows]) * (high - low)
                forces[:, rows] = _moved(shift, value, forces[:, rows])
        return J

    @cached_property
    def _solved(self) -> ManyCurves:
        """The curves of the widened problem, before offsets and gains."""
        return ManyCurves(self.curves.problem, self.curves.surrogate)

    def _units(self, z: Array) -> tuple[Array, Array]:
        """The free parameters of the widened problem in units of their ranges, (m, n_free), and their derivatives by z."""
        columns, first = self.curves.columns, len(self.curves.free)
        units, ahead = z[:, columns].copy(), np.ones((len(z), columns.size))
        for n, column in enumerate(columns):
            if column >= first:
                known = self.curves.inputs[column - first]
                value, (low, high) = self._values(column, z)[:, 0], known.ends
                units[:, n] = (value - known.low) / (known.high - known.low)
                ahead[:, n] = (high - low) * (value if known.logarithmic else 1.0) / (known.high - known.low)
        return units, ahead

    def _values(self, n: int, z: Array) -> Array:
        """The values (m, 1) of coordinate n, an input, in its unit."""
        known = self.curves.inputs[n - len(self.curves.free)]
        low, high = known.ends
        at = low + z[:, [n]] * (high - low)
        return np.exp(at) if known.logarithmic else at

    def _of_tests(self) -> Iterator[tuple[int, slice, Shift | None]]:
        """Number of each coordinate that acts on the curve of a single test, the curve's part of the row, and its Shift; None where
        the coordinate is a gain."""
        for n, known in enumerate(self.curves.inputs, start=len(self.curves.free)):
            if known.test is not None:
                for rows in self.curves.of_tests[known.test]:
                    yield n, rows, self.curves.shifts[known.test] if known.name == "offset" else None


def chi2_at(climber: Climber, z: Array) -> Array:
    """chi2 (m,) at places (m, n)."""
    left = (ManyPlaces(climber.curves).forces(z)[:, climber.rows] - climber.y) @ climber.W.T
    return np.asarray(np.sum(left**2, axis=1) + np.sum((z @ climber.P.T - climber.centre) ** 2, axis=1))


def least_chi2(climber: Climber, starts: Array, measured: Array) -> Array:
    """The least chi2 (m,) near each of many places, each with measured forces of its own.

    Parameters
    ----------
    climber : Climber
    starts : array (m, n)
    measured : array (m, k)
        The k forces that count, mN.

    Returns
    -------
    array (m,)
    """
    many, rows, W, P = ManyPlaces(climber.curves), climber.rows, climber.W, climber.P

    def residuals(z: Array, numbers: Ints) -> Array:
        return np.hstack([(many.forces(z)[:, rows] - measured[numbers]) @ W.T, z @ P.T - climber.centre])

    def slopes(z: Array, numbers: Ints) -> Array:
        return np.concatenate([W @ many.slopes(z)[:, rows], np.broadcast_to(P, (len(z), *P.shape))], axis=1)

    return Problems(residuals, slopes).minimised(starts)[1]


def _moved(shift: Shift, offsets: Array, forces: Array) -> Array:
    """Curves (m, N) of one test, moved by offsets (m, 1), mm."""
    powers = basis(shift.depth - offsets, shift.depth.size)[0] - basis(shift.depth, shift.depth.size)[0]
    return forces + np.einsum("mnb,mb->mn", powers, forces @ shift.fitted.T)


def _slope(shift: Shift, offsets: Array, forces: Array) -> Array:
    """Derivatives of the moved curves (m, N) by the offsets, mN/mm."""
    return -np.einsum("mnb,mb->mn", basis(shift.depth - offsets, shift.depth.size)[1], forces @ shift.fitted.T)
