"""The density of parameters, uncertain inputs and noises on the surrogate of a joint fit, at many places at once.

A place holds the coordinates of the fit in units of their ranges, then one coordinate for each test whose forces count: the
logarithm of the standard deviation of its noise, in units of its range. All coordinates lie between 0 and 1, and are uniform there
before the curves and the normal priors speak. The correlation of each curve's noise is that of the fit.
"""

from functools import cached_property

import numpy as np
from scipy.linalg import eigh

from indentfit.arrays import Array, Bools
from indentfit.inference.joint import JointFit
from indentfit.inference.noise import correlations
from indentfit.inference.posterior import FINEST, Shift, basis

NEGLIGIBLE = 1e-3  # errors of the model along a direction, over the least noise, that are left out


class Density:
    """Logarithm of the density at places (m, n + tests)."""

    def __init__(self, fit: JointFit) -> None:
        self.fit, self.posterior, self.curves = fit, fit.posterior, fit.posterior.curves
        self.used = [n for n, used in enumerate(self.posterior.used) if used]
        self.size = self.curves.size + len(self.used)
        self.rows = self.posterior.rows
        self.P, self.centre = self.posterior.prior_rows()
        self.y = self.curves.measured()[self.rows]
        most = np.array([np.abs(self.curves.problem.tests[n].curve.force).max() for n in self.used])
        self.lowest, self.highest = np.log(FINEST * most), np.log(most)
        self.parts = np.repeat(np.arange(len(self.used)), [self._points(n) for n in self.used])
        self.rotation, self.sizes = self._eigen()

    def _points(self, test: int) -> int:
        part = self.curves.slices[test]
        return part.stop - part.start

    def _eigen(self) -> tuple[Array, Array]:
        """A matrix (N, N) under which the noise of each test is independent, and the variances it has then if its sigma is 1."""
        rotation, sizes, done = np.zeros((self.rows.size,) * 2), np.ones(self.rows.size), 0
        for n in self.used:
            here, trust = slice(done, done + self._points(n)), self.posterior.noise.trust[n]
            values, vectors = eigh(correlations(trust.size, self.posterior.noise.rho[n]))
            rotation[here, here], sizes[here], done = vectors.T * trust, values, here.stop
        return rotation, sizes

    @cached_property
    def directions(self) -> Array:
        """Errors of the model, under the rotation: columns (N, r) whose squares add up to their covariance."""
        model = self.posterior.noise.model[np.ix_(self.rows, self.rows)]
        values, vectors = eigh(self.rotation @ model @ self.rotation.T)
        least = (NEGLIGIBLE * np.exp(self.lowest.min())) ** 2 * self.sizes.min()
        counted = values > least
        return np.asarray(vectors[:, counted] * np.sqrt(values[counted]))

    @cached_property
    def _squares(self) -> Array:
        """Products of the directions with each other, (N, r * r)."""
        B = self.directions
        return np.asarray((B[:, :, None] * B[:, None, :]).reshape(len(B), -1))

    def sigma(self, places: Array) -> Array:
        """Standard deviations of the noises at places (..., n + tests), (..., tests) mN."""
        return np.asarray(np.exp(self.lowest + places[..., self.curves.size :] * (self.highest - self.lowest)))

    def place(self, z: Array) -> Array:
        """The place of coordinates z (n,) with the noise of the fit, (n + tests,)."""
        sigma = np.log(self.posterior.noise.sigma[self.used])
        return np.clip(np.concatenate([z, (sigma - self.lowest) / (self.highest - self.lowest)]), 0, 1)

    def __call__(self, places: Array) -> Array:
        inside = ((places >= 0) & (places <= 1)).all(axis=1)
        log = np.full(len(places), -np.inf)
        if inside.any():
            log[inside] = self._within(places[inside])
        return log

    def _within(self, places: Array) -> Array:
        z = places[:, : self.curves.size]
        forces, failed = self.forces(z)
        left = (forces[:, self.rows] - self.y) @ self.rotation.T
        variances = self._variances(self.sigma(places))
        B, r = self.directions, self.directions.shape[1]
        inner = (1 / variances) @ self._squares
        M = np.eye(r) + inner.reshape(len(z), r, r)
        L = np.linalg.cholesky(M)
        explained = np.linalg.solve(L, ((left / variances) @ B)[..., None])[..., 0]
        squares = np.sum(left**2 / variances, axis=1) - np.sum(explained**2, axis=1)
        volume = np.sum(np.log(variances), axis=1) + 2 * np.log(np.einsum("mii->mi", L)).sum(axis=1)
        priors = np.sum((z @ self.P.T - self.centre) ** 2, axis=1)
        return np.where(failed, -np.inf, -0.5 * (squares + volume + priors))

    def _variances(self, sigma: Array) -> Array:
        """Variances of the noise under the rotation, (m, N); what a curve states beyond sigma is independent noise."""
        beside = np.maximum(self.posterior.noise.stated[self.used] ** 2 - sigma**2, 0.0)
        return np.asarray(sigma[:, self.parts] ** 2 * self.sizes + beside[:, self.parts])

    def values(self, z: Array) -> Array:
        """Coordinates (..., n) in their units."""
        first, columns = len(self.curves.free), []
        problem = self.curves.problem
        for n, name in enumerate(self.curves.free):
            columns.append(problem.values_at(name, z[..., n]))
        for n, known in enumerate(self.curves.inputs, start=first):
            low, high = known.ends
            at = low + z[..., n] * (high - low)
            columns.append(np.exp(at) if known.prior.logarithmic else at)
        return np.stack(columns, axis=-1)

    def forces(self, z: Array) -> tuple[Array, Bools]:
        """The curves at coordinates (m, n), (m, N), and whether the mechanics failed near each."""
        curves, problem = self.curves, self.curves.problem
        own = self.values(z)
        values = dict(zip([*curves.free, *(k.point or "" for k in curves.inputs)], own.T, strict=False))
        given = dict(zip(curves.free, z.T, strict=False))
        by_name = [given[n] if n in given else (values[n] - problem.free[n].min) / problem.range(n) for n in problem.free]
        places = np.column_stack(by_name)[:, problem.searched_numbers]
        forces = (curves.surrogate.curves(places) if problem.kernel is None else self._relaxed(places, own)) * (1 + curves.mesh)
        if problem.scale is not None:
            forces = forces * (values[problem.scale] / problem.reference)[:, None]
        for n, known in enumerate(curves.inputs, start=len(curves.free)):
            if known.test is None or (known.name == "offset" and problem.kernel is not None):
                continue
            for rows in curves.of_tests[known.test]:
                if known.name == "offset":
                    forces[:, rows] += _moved(curves.shifts[known.test], own[:, n], forces[:, rows])
                else:
                    forces[:, rows] *= 1 + own[:, [n]]
        return forces, curves.surrogate.near_failure(places)

    def _relaxed(self, places: Array, own: Array) -> Array:
        """Curves (m, N) of a material that relaxes, at places of the surrogate; offsets own[:, n] move the elastic curves."""
        curves, surrogate = self.curves, self.curves.surrogate
        kernel = curves.problem.kernel
        assert kernel is not None
        elastic, ends = surrogate.of_kernel(places), np.cumsum([0, *kernel.sizes])
        for n, known in enumerate(curves.inputs, start=len(curves.free)):
            if known.name == "offset" and known.test is not None:
                part = slice(ends[known.test], ends[known.test + 1])
                elastic[:, part] += _moved(curves.shifts[known.test], own[:, n], elastic[:, part])
        return surrogate.relaxed(elastic, places)


def _moved(shift: Shift, offsets: Array, forces: Array) -> Array:
    """Changes of curves (m, n) by offsets (m,)."""
    points = shift.depth.size
    before = basis(shift.depth, points)[0]
    there = basis((shift.depth - offsets[:, None]).ravel(), points)[0].reshape(len(offsets), points, -1)
    return np.asarray(np.einsum("mnb,mb->mn", there - before, forces @ shift.fitted.T))
