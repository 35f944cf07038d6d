"""The density of parameters, uncertain inputs and noises on the surrogate of a joint fit, at many places at once.

A place holds the coordinates of the fit in units of their ranges, then two coordinates for each test whose forces count: first
those of all tests for the logarithm of the standard deviation of the noise, in units of its range, then those for the correlation
of neighbouring points. The last one is the scale of the law's misfit, where the curves are to tell it. All
coordinates lie between 0 and 1, and are uniform there before the curves and the normal priors speak.
Below WHITE the noise is white, above that the correlation grows in SLAB steps (`noise.possible`) to the largest under which a
test still decorrelates: residuals that are smooth by what the model cannot follow may look white at the optimum, and no other place
could then compete.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import eigh

from indentfit.arrays import Array, Bools, Ints
from indentfit.inference.explained import Explained
from indentfit.inference.joint import JointFit
from indentfit.inference.noise import SLAB, WHITE, correlations, possible
from indentfit.inference.posterior import FINEST, POWERS, NoiseModel, Shift

ALIKE = 0.8  # probability that the noises of a case's tests are alike
NEGLIGIBLE = 0.1  # errors of the model along a direction, over the least noise, that are left out
STEP = 1e-3  # of a range, for derivatives by coordinates in which curves are nearly linear


class Density:
    """Logarithm of the density at places (m, n + 2 tests), or (m, n + 2 tests + 1) with an unknown scale of the law's misfit."""

    def __init__(self, fit: JointFit) -> None:
        self.fit, self.posterior, self.curves = fit, fit.posterior, fit.posterior.curves
        self.used = [n for n, used in enumerate(self.posterior.used) if used]
        law = self.posterior.noise.law
        self.law = law if law is not None and law.ends is not None else None
        self.size = self.curves.size + 2 * len(self.used) + (self.law is not None)
        self.rows = self.posterior.rows
        self.P, self.centre = self.posterior.prior_rows()
        self.y = self.curves.measured()[self.rows]
        most = np.array([np.abs(self.curves.problem.tests[n].curve.force).max() for n in self.used])
        self.lowest, self.highest = np.log(FINEST * most), np.log(most)
        self.noises = self._noises()

    def _noises(self) -> list["_Noise"]:
        """The noise of each test that counts, with the errors of the model at its points."""
        of_law = self._of_law()
        B, noises, done = np.hstack([self._directions(), of_law]), [], 0
        self.of_law = of_law.shape[1]
        for n in self.used:
            trust = self.posterior.noise.trust[n]
            here, done = slice(done, done + trust.size), done + trust.size
            known = self.posterior.noise.explained
            apart = known[n] if known else Explained.none(trust.size)
            noises.append(_Noise.of(here, trust, float(self.posterior.noise.stated[n]), B[here], apart))
        return noises

    def _directions(self) -> Array:
        """Errors of the model, and the law's misfit of a known scale: columns (N, r) whose squares add up to their covariance."""
        noise = self.posterior.noise
        model = (noise.known if self.law is not None else noise.errors)[np.ix_(self.rows, self.rows)]
        return self._counted(model, 1.0)

    def _of_law(self) -> Array:
        """The law's misfit of an unknown scale: columns (N, r) whose squares add up to its covariance at scale 1."""
        if self.law is None or self.law.ends is None:
            return np.zeros((self.rows.size, 0))
        roots = self.law.roots[self.rows]
        return self._counted(roots @ roots.T, self.law.ends[1])

    def _counted(self, covar: Array, scale: float) -> Array:
        """Columns whose squares add up to a covariance (N, N), without those that are negligible beside the noise at a scale."""
        values, vectors = eigh(covar)
        counted = values > (NEGLIGIBLE * np.exp(self.lowest.min()) / scale) ** 2
        return np.asarray(vectors[:, counted] * np.sqrt(values[counted]))

    def scale(self, places: Array) -> Array:
        """The scale of the law's misfit at places (..., n + 2 tests + 1), (...)."""
        assert self.law is not None
        return self.law.at(places[..., -1])

    def noise_at(self, place: Array, sigma: Array) -> NoiseModel:
        """The noise at a place (n + 2 tests,) whose standard deviations are sigma (tests,)."""
        noise, first = self.posterior.noise, self.curves.size + len(self.used)
        sigmas, rhos = noise.sigma.copy(), noise.rho.copy()
        for k, (n, known) in enumerate(zip(self.used, self.noises, strict=True)):
            sigmas[n], rhos[n] = sigma[k], known.known[int(known.kinds(place[[first + k]])[0])].rho
        law = noise.law if self.law is None else replace(self.law, scale=float(self.scale(place)))
        return replace(noise, sigma=sigmas, rho=rhos, law=law)

    def sigma(self, places: Array) -> Array:
        """Standard deviations of the noises at places (..., n + 2 tests), (..., tests) mN."""
        first = self.curves.size
        return np.asarray(np.exp(self.lowest + places[..., first : first + len(self.used)] * (self.highest - self.lowest)))

    def rho(self, places: Array) -> Array:
        """Correlations of neighbouring points at places (m, n + 2 tests), (m, tests)."""
        first = self.curves.size + len(self.used)
        of_test = [
            np.array([kind.rho for kind in noise.known])[noise.kinds(places[:, first + k])] for k, noise in enumerate(self.noises)
        ]
        return np.array(of_test).T

    def kinds_at_mode(self) -> list[tuple[Array, Array]]:
        """For each test and each correlation (kinds,) of its noise: the coordinate of the size that the residuals at the fit's mode
        have under it, and about how probable it is there."""
        left, known = self.y - self.curves.at(self.fit.mode.z)[0][self.rows], []
        for noise, low, high in zip(self.noises, self.lowest, self.highest, strict=True):
            sizes = np.maximum([kind.sizes for kind in noise.known], 1e-9)
            squares = np.mean([(kind.turn @ left[noise.rows]) ** 2 for kind in noise.known] / sizes, axis=1)
            logs = np.clip(0.5 * np.log(squares + 1e-300), low, high)
            first, last = noise.ends(np.arange(len(sizes)))
            odds = np.log(last - first) - left[noise.rows].size * logs - 0.5 * np.log(sizes).sum(axis=1)
            shares = np.exp(odds - odds.max())
            known.append(((logs - low) / (high - low), shares / shares.sum()))
        return known

    def place(self, z: Array) -> Array:
        """The place of coordinates z (n,) with the noise of the fit, (n + 2 tests,)."""
        sigma = np.log(self.posterior.noise.sigma[self.used])
        kinds = [noise.coordinate(rho) for noise, rho in zip(self.noises, self.posterior.noise.rho[self.used], strict=True)]
        scale = [] if self.law is None else [self.law.unit]
        return np.clip(np.concatenate([z, (sigma - self.lowest) / (self.highest - self.lowest), kinds, scale]), 0, 1)

    def __call__(self, places: Array) -> Array:
        inside = ((places >= 0) & (places <= 1)).all(axis=1)
        log = np.full(len(places), -np.inf)
        if inside.any():
            forces, failed = self.forces(places[inside][:, : self.curves.size])
            log[inside] = np.where(failed, -np.inf, self.of_forces(forces, places[inside], self.covariances(places[inside])))
        return log

    def of_forces(self, forces: Array, places: Array, noises: "Covariances") -> Array:
        """Logarithm of the density at places (m, n + 2 tests) whose curves are the forces (m, N) and whose noises are given."""
        left = forces[:, self.rows] - self.y
        priors = np.sum((places[:, : self.curves.size] @ self.P.T - self.centre) ** 2, axis=1)
        return np.asarray(noises.log - 0.5 * (noises.products(left[:, None])[:, 0, 0] + priors))

    def covariances(self, places: Array, beside: float = 0.0) -> "Covariances":
        """Covariances of the residuals at places (m, n + 2 tests), with independent noise beside them: a share of each test's
        largest force, or a standard deviation for each place, (m,)."""
        sigma, more = self.sigma(places), np.broadcast_to(np.square(beside), (len(places),))
        r, first = self.noises[0].errors.shape[1], self.curves.size + len(self.used)
        factors = np.ones((len(places), r))
        if self.law is not None:
            factors[:, r - self.of_law :] = self.scale(places)[:, None]
        white, log, parts = np.ones((len(places), len(self.noises)), dtype=bool), np.zeros(len(places)), []
        inner = np.zeros((len(places), r * r))
        for n, noise in enumerate(self.noises):
            kinds = noise.kinds(places[:, first + n])
            white[:, n] = kinds == 0
            for kind in np.unique(kinds):
                here, known = np.flatnonzero(kinds == kind), noise.known[kind]
                variances = noise.variances(int(kind), sigma[here, n]) + np.exp(2 * self.highest[n]) * more[here, None]
                log[here] -= 0.5 * np.sum(np.log(variances), axis=1)
                inner[here] += (1 / variances) @ known.products
                parts.append((here, noise.rows, known, variances))
        told = [len(noise.known) > 1 for noise in self.noises]
        if any(told):
            log += alike(white[:, told])
        inner = inner.reshape(len(places), r, r)
        if self.law is not None:
            inner = inner * factors[:, :, None] * factors[:, None, :]
        inner[:, range(r), range(r)] += 1
        root = np.linalg.cholesky(inner)
        log -= np.log(np.einsum("mii->mi", root)).sum(axis=1)
        return Covariances(log, parts, np.ascontiguousarray(root.transpose(1, 2, 0)), factors)

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
        shapes, failed = self.shapes(z)
        return self.moved(shapes, z), failed

    def shapes(self, z: Array) -> tuple[Array, Bools]:
        """The curves at coordinates (m, n) before the scale, the gains and (but where the material relaxes) the offsets."""
        curves, problem = self.curves, self.curves.problem
        own = self.values(z)
        values = dict(zip([*curves.free, *(k.point or "" for k in curves.inputs)], own.T, strict=False))
        given = dict(zip(curves.free, z.T, strict=False))
        by_name = [given[n] if n in given else (values[n] - problem.free[n].min) / problem.range(n) for n in problem.free]
        places = np.column_stack(by_name)[:, problem.searched_numbers]
        forces = (curves.surrogate.curves(places) if problem.kernel is None else self._relaxed(places, own)) * (1 + curves.mesh)
        return forces, curves.surrogate.near_failure(places)

    def moved(self, shapes: Array, z: Array) -> Array:
        """Curves (m, N) of these shapes with scale, offsets and gains of coordinates (m, n)."""
        own = self.values(z)
        forces = self._moved_unscaled(shapes, own)
        return forces if self.scaled is None else forces * (own[:, [self.scaled]] / self.curves.problem.reference)

    def _moved_unscaled(self, shapes: Array, own: Array) -> Array:
        """Curves (m, N) of these shapes with offsets and gains of coordinates (m, n) in their units."""
        forces = shapes.copy()
        for n, name, test in self._of_tests():
            for rows in self.curves.of_tests[test]:
                if name == "offset":
                    forces[:, rows] += _moved(self.curves.shifts[test], own[:, n], forces[:, rows])
                else:
                    forces[:, rows] *= 1 + own[:, [n]]
        return forces

    def _of_tests(self) -> Iterator[tuple[int, str, int]]:
        """Number of each coordinate that acts on the curve of a single test, name of the input, and number of the test."""
        for n, known in enumerate(self.curves.inputs, start=len(self.curves.free)):
            if known.test is not None and (known.name != "offset" or self.curves.problem.kernel is None):
                yield n, known.name, known.test

    @cached_property
    def scaled(self) -> int | None:
        """The number of the coordinate in which the forces are linear."""
        scale = self.curves.problem.scale
        return None if scale is None else list(self.curves.free).index(scale)

    @cached_property
    def linear(self) -> list[int]:
        """The coordinates in which the curves are linear, or nearly so: scale and offsets. A gain does what the scale does: drawn
        one after the other within their ranges, the two would leave each other no room."""
        return [*([] if self.scaled is None else [self.scaled]), *(n for n, name, _ in self._of_tests() if name == "offset")]

    def of_scale(self, shapes: Array) -> Array:
        """The coordinate of the scale, (m,), at which shapes (m, N) are nearest to the curves."""
        problem, shapes = self.curves.problem, shapes[:, self.rows]
        assert problem.scale is not None
        factor = (shapes @ self.y) / np.maximum(np.sum(shapes**2, axis=1), 1e-300)
        return np.clip((factor * problem.reference - problem.free[problem.scale].min) / problem.range(problem.scale), 0, 1)

    def moved_with_slopes(self, shapes: Array, z: Array) -> tuple[Array, Array]:
        """The curves (m, N) of shapes, and their derivatives (m, k, N) by the coordinates `linear`."""
        own, problem = self.values(z), self.curves.problem
        unscaled = self._moved_unscaled(shapes, own)
        factor = 1.0 if self.scaled is None else own[:, [self.scaled]] / problem.reference
        slopes = np.zeros((len(z), len(self.linear), unscaled.shape[1]))
        if self.scaled is not None:
            slopes[:, 0] = unscaled * (problem.range(list(self.curves.free)[self.scaled]) / problem.reference)
        offsets = [(n, test) for n, name, test in self._of_tests() if name == "offset"]
        if offsets:  # each acts on the curves of its own test only
            ahead = z.copy()
            ahead[:, [n for n, _ in offsets]] += STEP
            slope = factor * (self._moved_unscaled(shapes, self.values(ahead)) - unscaled) / STEP
            for n, test in offsets:
                for rows in self.curves.of_tests[test]:
                    slopes[:, self.linear.index(n), rows] = slope[:, rows]
        return factor * unscaled, slopes

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


def alike(white: Bools) -> Array:
    """Logarithm of the prior probability that the noises of tests (m, tests) are white, or are not, over that of independent tests.

    The tests of a case mostly come from one rig: with the probability ALIKE their noises are all white, or all correlated.
    """
    tests = white.shape[1]
    every, none = white.all(axis=1), ~white.any(axis=1)
    one_kind = np.where(every, WHITE ** (1 - tests), np.where(none, (1 - WHITE) ** (1 - tests), 0.0))
    return np.asarray(np.log(ALIKE * one_kind + 1 - ALIKE))


@dataclass(frozen=True, eq=False)
class Covariances:
    """Covariances of the residuals at places.

    Parameters
    ----------
    log : array (m,)
        Logarithm of the prior of the noises' kinds, less half of that of the determinants.
    parts : for each noise and kind: numbers of the places, rows of the test, the kind, and variances
    root : array (r, r, m)
        Cholesky factors of the errors of the model, over the noise.
    factors : array (m, r)
        On these errors.
    """

    log: Array
    parts: Sequence[tuple[Ints, slice, "_Kind", Array]]
    root: Array
    factors: Array

    def products(self, rows: Array) -> Array:
        """Rows (m, q, N) multiplied by each other over the covariances, (m, q, q)."""
        m, q = rows.shape[:2]
        squares, seen = np.zeros((m, q, q)), np.zeros((m, q, len(self.root)))
        for here, part, known, variances in self.parts:
            turned = (rows[here, :, part].reshape(-1, known.turn.shape[0]) @ known.turn.T).reshape(len(here), q, -1)
            weighted = turned / variances[:, None]
            squares[here] += turned @ weighted.swapaxes(1, 2)
            seen[here] += (weighted.reshape(len(here) * q, -1) @ known.errors).reshape(len(here), q, -1)
        seen, told = np.ascontiguousarray((seen * self.factors[:, None]).transpose(2, 0, 1)), np.zeros((seen.shape[2], m, q))
        for n in range(len(told)):  # forward substitution of all places at once
            told[n] = (seen[n] - np.einsum("jm,jmq->mq", self.root[n, :n], told[:n])) / self.root[n, n][:, None]
        return np.asarray(squares - np.einsum("rmp,rmq->mpq", told, told))


@dataclass(frozen=True, eq=False)
class _Kind:
    """One correlation of a test's noise: under `turn` (n, n) the noise is independent, with the variances `sizes` (n,) if its sigma
    is 1; the errors of the model there (n, r), and their products with each other (n, r * r)."""

    rho: float
    turn: Array
    sizes: Array
    errors: Array
    products: Array

    @classmethod
    def of(cls, rho: float, trust: Array, errors: Array, explained: Explained) -> "_Kind":
        sizes, vectors = eigh(explained.apart(correlations(trust.size, rho)))
        turn = vectors.T * trust
        turned = turn @ errors
        return cls(rho, turn, sizes, turned, (turned[:, :, None] * turned[:, None, :]).reshape(trust.size, -1))


@dataclass(frozen=True, eq=False)
class _Noise:
    """The noise of one test: its rows among those that count, the standard deviation that the curve states, the errors of the model
    (n, r), and its possible correlations, white noise first."""

    rows: slice
    stated: float
    errors: Array
    known: tuple[_Kind, ...]

    @classmethod
    def of(cls, rows: slice, trust: Array, stated: float, errors: Array, explained: Explained) -> "_Noise":
        known = tuple(_Kind.of(float(rho), trust, errors, explained) for rho in possible(trust.size))
        return cls(rows, stated, errors, known)

    def kinds(self, coordinate: Array) -> Ints:
        """Numbers of the correlations at values of their coordinate, (m,)."""
        if len(self.known) == 1:
            return np.zeros(coordinate.size, dtype=int)
        step = np.floor((coordinate - WHITE) / (1 - WHITE) * SLAB).astype(int)
        return np.where(coordinate < WHITE, 0, 1 + np.clip(step, 0, SLAB - 1))

    def ends(self, kinds: Ints) -> tuple[Array, Array]:
        """First and last value of the coordinate of each of these correlations, (m,)."""
        if len(self.known) == 1:
            return np.zeros(kinds.size), np.ones(kinds.size)
        step = (1 - WHITE) / SLAB
        return np.where(kinds == 0, 0.0, WHITE + (kinds - 1) * step), np.where(kinds == 0, WHITE, WHITE + kinds * step)

    def coordinate(self, rho: float) -> float:
        """The middle of the values of the coordinate whose correlation is nearest to rho."""
        kind = int(np.argmin([abs(known.rho - rho) for known in self.known]))
        return WHITE / 2 if kind == 0 else WHITE + (1 - WHITE) * (kind - 0.5) / SLAB

    def variances(self, kind: int, sigma: Array) -> Array:
        """Variances (m, n) of the noise; what a curve states beyond sigma is independent noise."""
        beside = np.maximum(self.stated**2 - sigma**2, 0.0)
        return np.asarray(sigma[:, None] ** 2 * self.known[kind].sizes + beside[:, None])


def _moved(shift: Shift, offsets: Array, forces: Array) -> Array:
    """Changes of curves (m, n) by offsets (m,)."""
    coefficients = forces @ shift.fitted.T
    change = _powers(shift.depth - offsets[:, None], coefficients.shape[1]) - _powers(shift.depth[None], coefficients.shape[1])
    return np.asarray(np.einsum("bmn,mb->mn", change, coefficients))


def _powers(depth: Array, number: int) -> Array:
    """The first of POWERS of depths (m, n), (number, m, n), as `basis`; all are multiples of one half."""
    root = np.sqrt(np.maximum(depth, 0.0))
    raised = [root, root * root]
    while len(raised) < 2 * POWERS[number - 1]:
        raised.append(raised[-1] * root)
    return np.array([raised[round(2 * power) - 1] for power in POWERS[:number]])
