"""The density of parameters and uncertain inputs, given the curves: on a surrogate, with priors, noise and the mesh's error.

A place z holds all coordinates in units of their ranges: the free parameters first, then the uncertain inputs. The curves there are

    (1 + gain) (1 + mesh) F(d - offset; parameters, inputs),

and chi2 is that of their residuals, under noise that is correlated along each curve and under the errors of the mesh and of the
surrogate, and that of the inputs under their priors.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular
from scipy.linalg.lapack import dgesv

from indentfit.arrays import Array, Ints
from indentfit.inference.discrepancy import LawError
from indentfit.inference.explained import Explained
from indentfit.inference.noise import autocorrelation, correlations
from indentfit.inverse.problem import InverseProblem
from indentfit.inverse.surrogate import Surrogate
from indentfit.inverse.wide import UncertainInput

ROUNDS = 12  # of the estimate of the noise
FINEST = 3e-4  # of a curve's largest force: the least noise, since computed curves wave by as much from step to step
POWERS = (1.0, 1.5, 2.0, 2.5, 3.0, 4.0)  # of the depth: what a curve is made of between its points
FIRST_DAMPING, EASE = 1e-3, 5.0  # of the steps of a search, and the factor by which good and bad steps change it
MOST_STEPS = 60
TOLERANCE = 3e-4  # of chi2: a search ends where a step promises no more


@dataclass(frozen=True, eq=False)
class Shift:
    """The shift of one curve along its depth: the change of a function of POWERS of the depth, fitted to the curve."""

    depth: Array
    fitted: Array  # (b, n): from a curve to its coefficients

    @classmethod
    def of(cls, depth: Array) -> "Shift":
        """The Shift of a curve at the depths (n,)."""
        return cls(depth, np.asarray(np.linalg.pinv(basis(depth, depth.size)[0]), dtype=float))

    def by(self, offset: float) -> tuple[Array, Array]:
        """Operators (n, n) on a curve F: F(d - offset), and its derivative by the offset."""
        if offset == 0:
            here = basis(self.depth, self.depth.size)
            return np.eye(self.depth.size), -here[1] @ self.fitted
        before, there = basis(self.depth, self.depth.size), basis(self.depth - offset, self.depth.size)
        return np.eye(self.depth.size) + (there[0] - before[0]) @ self.fitted, -there[1] @ self.fitted


def basis(depth: Array, points: int) -> tuple[Array, Array]:
    """Powers of the depths (..., n) and their derivatives, (..., n, b); 0 before contact."""
    powers = np.array(POWERS[: max(1, min(len(POWERS), points - 1))])
    d = np.maximum(depth, 0.0)[..., None]
    slopes = np.where(d > 0, powers * np.maximum(d, 1e-12) ** (powers - 1), 0.0)
    return d**powers, slopes


@dataclass(frozen=True, eq=False)
class Curves:
    """The curves of all tests, in a row, as a function of the place.

    Parameters
    ----------
    problem : InverseProblem
        The problem whose free parameters are widened by the inputs that change the solution.
    surrogate : Surrogate
    inputs : tuple of UncertainInput
        Those of the free parameters at the end of `problem.free` first, then those of single tests.
    mesh : array (N,)
        Relative correction of the forces for the mesh.
    """

    problem: InverseProblem
    surrogate: Surrogate
    inputs: tuple[UncertainInput, ...]
    shifts: tuple[Shift, ...]
    mesh: Array

    @classmethod
    def of(cls, problem: InverseProblem, surrogate: Surrogate, inputs: tuple[UncertainInput, ...], mesh: Array) -> "Curves":
        """The curves of a problem; where the material relaxes, the shifts are those of the elastic forces of each test."""
        depths = [t.curve.displacement for t in problem.tests] if problem.kernel is None else problem.kernel.depths
        return cls(problem, surrogate, inputs, tuple(Shift.of(depth) for depth in depths), mesh)

    @cached_property
    def free(self) -> list[str]:
        """The free parameters, without inputs."""
        solved = {known.point for known in self.inputs}
        return [name for name in self.problem.free if name not in solved]

    @property
    def size(self) -> int:
        """The number of coordinates."""
        return len(self.free) + len(self.inputs)

    @cached_property
    def slices(self) -> list[slice]:
        """The part of the row that each test is."""
        ends = np.cumsum([0, *(test.curve.force.size for test in self.problem.tests)]).tolist()
        return [slice(a, b) for a, b in pairwise(ends)]

    @cached_property
    def of_tests(self) -> list[list[slice]]:
        """The parts of the row that each test of the case is: one, or one for each segment in time."""
        names = list(dict.fromkeys(test.test for test in self.problem.tests))
        pairs = list(zip(self.problem.tests, self.slices, strict=True))
        return [[rows for test, rows in pairs if test.test == name] for name in names]

    def point(self, z: Array) -> dict[str, float]:
        """Parameters and changed inputs at a place, as the forward model takes them."""
        units = self._units(z)[0]
        return self.problem.parameters([*units])

    def searched_units(self, z: Array) -> Array:
        """The searched parameters at a place, in units of their ranges, as the surrogate takes them."""
        return np.asarray(self._units(z)[0][self.problem.searched_numbers])

    def place(self, point: Mapping[str, Any]) -> Array:
        """The place of parameters and inputs; inputs of single tests are at their centres."""
        units = dict(zip(self.problem.free, self.problem.units(point), strict=True))
        parts = [units[name] for name in self.free]
        for known in self.inputs:
            value = point[known.point] if known.point else known.prior.value(known.prior.center)
            parts.append(known.unit_of(value))
        return np.clip(np.array(parts), 0, 1)

    def _units(self, z: Array) -> tuple[Array, Array]:
        """The free parameters of the widened problem in units of their ranges, (n,), and their derivatives by z."""
        units = z[self.columns].copy()
        ahead = np.ones(units.size)
        for n, column in enumerate(self.columns):
            if column < len(self.free):
                continue
            known = self.inputs[column - len(self.free)]
            value, (low, high) = known.value_at(float(units[n])), known.ends
            units[n] = (value - known.low) / (known.high - known.low)
            ahead[n] = (high - low) * (value if known.logarithmic else 1.0) / (known.high - known.low)
        return units, ahead

    @cached_property
    def columns(self) -> Ints:
        """The coordinate of each free parameter of the widened problem."""
        points = [known.point for known in self.inputs]
        free = self.free
        return np.array([free.index(n) if n in free else len(free) + points.index(n) for n in self.problem.free], dtype=int)

    def at(self, z: Array) -> tuple[Array, Array]:
        """The curves (N,) and their derivatives (N, n) at a place."""
        force, J = self._solved(z)
        first = len(self.free)
        for n, known in enumerate(self.inputs):
            if known.test is None or (known.name == "offset" and self.problem.kernel is not None):
                continue
            column, (low, high) = first + n, known.ends
            for rows in self.of_tests[known.test]:
                if known.name == "offset":
                    moved, slope = self.shifts[known.test].by(known.value_at(z[column]))
                    J[rows, column] = slope @ force[rows] * (high - low)
                    J[rows] = np.where(np.arange(J.shape[1]) == column, J[rows], moved @ J[rows])
                    force[rows] = moved @ force[rows]
                else:
                    gain = 1 + known.value_at(z[column])
                    J[rows] *= gain
                    J[rows, column] = force[rows] * (high - low)
                    force[rows] *= gain
        return force, J

    @cached_property
    def _offsets(self) -> dict[int, int]:
        """The number of each test whose contact point is uncertain -> that of the input."""
        return {known.test: k for k, known in enumerate(self.inputs) if known.name == "offset" and known.test is not None}

    def _solved(self, z: Array) -> tuple[Array, Array]:
        """Curves and derivatives before offset and gain, with the correction for the mesh."""
        problem, (units, ahead) = self.problem, self._units(z)
        searched = problem.searched_numbers
        columns, offsets = self.columns, self._offsets
        if problem.kernel is not None and offsets:
            values = dict.fromkeys(range(len(self.shifts)), 0.0)
            values |= {test: self.inputs[k].value_at(z[len(self.free) + k]) for test, k in offsets.items()}
            moves, ahead_of = zip(*(shift.by(values[n]) for n, shift in enumerate(self.shifts)), strict=True)
            curves, slopes, by_offset = self.surrogate.at_moved(units[searched], moves, ahead_of)
        else:
            curves, slopes = self.surrogate.at(units[searched])
            offsets, by_offset = {}, np.zeros((0, curves.size))
        J, factor = np.zeros((curves.size, self.size)), 1.0
        if problem.scale is not None:
            n = list(problem.free).index(problem.scale)
            factor = (problem.free[problem.scale].min + units[n] * problem.range(problem.scale)) / problem.reference
            J[:, columns[n]] = curves * problem.range(problem.scale) / problem.reference
        for k, n in enumerate(searched):
            J[:, columns[n]] = factor * slopes[k] * ahead[n]
        for test, number in offsets.items():
            low, high = self.inputs[number].ends
            J[:, len(self.free) + number] = factor * by_offset[test] * (high - low)
        return factor * curves * (1 + self.mesh), J * (1 + self.mesh)[:, None]

    @property
    def solved_numbers(self) -> list[int]:
        """The coordinates whose change needs a run: all but the scale, the relaxation, offsets and gains."""
        points, solved = [known.point for known in self.inputs], set(self.problem.solved)
        return [n for n, name in enumerate([*self.free, *points]) if name in solved]

    def measured(self) -> Array:
        """The measured forces, (N,)."""
        return np.concatenate([test.curve.force for test in self.problem.tests])


@dataclass(frozen=True, eq=False)
class NoiseModel:
    """What makes the residuals: white or correlated noise of each test, errors of the model (N, N), mN^2, and the law's misfit,
    where the case states it.

    `trust` holds the factors (n,) of each test that make points equally noisy (`Curve.trust`), `stated` the standard deviation of
    a point that its curve states: what exceeds sigma is independent noise. `explained` is what the coordinates can explain of each
    test's noise, none before there is an optimum, and `smooth` what smooth residuals may have made of that beyond the noise, (N, N)
    (`smooth_misfit`).
    """

    sigma: Array
    rho: Array
    model: Array
    trust: tuple[Array, ...]
    stated: Array
    law: LawError | None = None
    explained: tuple[Explained, ...] = ()
    smooth: Array | None = None

    @property
    def errors(self) -> Array:
        """Covariance of all that is no noise: errors of the model, smooth residuals, and the law's misfit, (N, N)."""
        return self.known if self.law is None else self.known + self.law.covar

    @property
    def known(self) -> Array:
        """The same without the law's misfit."""
        return self.model if self.smooth is None else self.model + self.smooth

    def shape(self, test: int) -> Array:
        """Covariance of the noise of a test whose sigma is 1, (n, n)."""
        trust = self.trust[test]
        return self.correlations(test) / np.outer(trust, trust)

    def correlations(self, test: int) -> Array:
        """Correlations of the noise of a test at points that its trust makes equally noisy, (n, n)."""
        known = correlations(self.trust[test].size, self.rho[test])
        return self.explained[test].apart(known) if self.explained else known

    def covar(self, slices: Sequence[slice]) -> Array:
        """Covariance of the residuals, (N, N)."""
        covar = self.errors.copy()
        for n, (rows, sigma) in enumerate(zip(slices, self.sigma, strict=True)):
            covar[rows, rows] += sigma**2 * self.shape(n)
            covar[rows, rows] += np.diag(max(self.stated[n] ** 2 - sigma**2, 0.0) / self.trust[n] ** 2)
        return covar


@dataclass(frozen=True, eq=False)
class Posterior:
    """The density of places, under a NoiseModel; `used` says which tests count."""

    curves: Curves
    noise: NoiseModel
    used: tuple[bool, ...]

    @property
    def rows(self) -> Array:
        """The numbers of the forces that count."""
        parts = [np.arange(rows.start, rows.stop) for rows, used in zip(self.curves.slices, self.used, strict=True) if used]
        return np.concatenate(parts)

    def whitener(self) -> Array:
        """The inverse of the Cholesky factor of the covariance of the rows."""
        covar = self.noise.covar(self.curves.slices)[np.ix_(self.rows, self.rows)]
        L = np.linalg.cholesky(covar)
        return solve_triangular(L, np.eye(len(L)), lower=True)

    def log_volume(self) -> float:
        """Logarithm of the determinant of the covariance of the rows."""
        covar = self.noise.covar(self.curves.slices)[np.ix_(self.rows, self.rows)]
        return float(np.linalg.slogdet(covar)[1])

    def law_at(self, z: Array) -> Array:
        """What the residuals at z show of the law's misfit, (N,) mN; none where it is no term of the fit, or in tests that do not
        count."""
        shown, law, rows = np.zeros(self.curves.measured().size), self.noise.law, self.rows
        if law is not None:
            covar = self.noise.covar(self.curves.slices)[np.ix_(rows, rows)]
            left = (self.curves.measured() - self.curves.at(z)[0])[rows]
            shown[rows] = law.covar[np.ix_(rows, rows)] @ cho_solve(cho_factor(covar), left)
        return shown

    def prior_rows(self) -> tuple[Array, Array]:
        """Matrix and centre of the residuals of normal priors: matrix @ z - centre, (k, n) and (k,)."""
        matrix, centres, first = [], [], len(self.curves.free)
        for n, known in enumerate(self.curves.inputs):
            if known.prior.spread is not None:
                low, high = known.ends
                row = np.zeros(self.curves.size)
                row[first + n] = (high - low) / known.prior.spread
                matrix.append(row)
                centres.append((known.prior.center - low) / known.prior.spread)
        return np.array(matrix).reshape(-1, self.curves.size), np.array(centres)


@dataclass(frozen=True, eq=False)
class Mode:
    """A place of largest density, with the covariance of the places about it by linear theory."""

    z: Array
    chi2: float
    covar: Array


class Climber:
    """Searches for places of least chi2 of one Posterior; what does not depend on the place is computed once."""

    def __init__(self, posterior: Posterior) -> None:
        self.posterior, self.curves = posterior, posterior.curves
        self.rows, self.W = posterior.rows, posterior.whitener()
        self.P, self.centre = posterior.prior_rows()
        self.y = self.curves.measured()[self.rows]

    def residuals(self, z: Array) -> tuple[Array, Array]:
        """Residuals whose squares add up to chi2, and their derivatives."""
        force, J = self.curves.at(z)
        residuals = np.concatenate([self.W @ (force[self.rows] - self.y), self.P @ z - self.centre])
        return residuals, np.concatenate([self.W @ J[self.rows], self.P])

    def climb(self, z: Array, fixed: Collection[int] = ()) -> tuple[Array, float]:
        """The place of least chi2 near z, and its chi2; the coordinates `fixed` keep their values."""
        moving = np.array([n for n in range(z.size) if n not in fixed], dtype=int)
        if not moving.size:
            left = self.residuals(z)[0]
            return z.copy(), float(left @ left)
        z = np.clip(z, 0, 1) if not fixed else np.where(np.isin(np.arange(z.size), moving), np.clip(z, 0, 1), z)
        residuals, J = self.residuals(z)
        chi2, damping = float(residuals @ residuals), FIRST_DAMPING
        for _ in range(MOST_STEPS):
            step = _box_step(J[:, moving], residuals, z[moving], damping)
            trial = z.copy()
            trial[moving] = np.clip(z[moving] + step, 0, 1)
            promised = chi2 - float(np.sum((residuals + J @ (trial - z)) ** 2))
            if promised <= TOLERANCE:
                break
            there, slopes = self.residuals(trial)
            gain = (chi2 - float(there @ there)) / promised
            if gain > 0:
                z, residuals, J, chi2 = trial, there, slopes, float(there @ there)
            damping = damping / EASE if gain > 0.5 else damping * (EASE if gain > 0.1 else 4 * EASE)
        return z, chi2

    def covar(self, z: Array) -> Array:
        """Covariance of the coordinates by linear theory at z; large for coordinates that nothing determines."""
        J = self.residuals(z)[1]
        return np.asarray(np.linalg.inv(J.T @ J + 1e-6 * np.eye(z.size)), dtype=float)


def _box_step(J: Array, residuals: Array, z: Array, damping: float) -> Array:
    """The step of Levenberg and Marquardt from z within the box 0..1: coordinates that it would push through a bound stop there,
    and the others make up for that."""
    A, g = J.T @ J, J.T @ residuals
    diagonal = np.einsum("ii->i", A)
    diagonal *= 1 + damping
    diagonal += damping * (1e-9 * diagonal.sum() + 1e-12)
    step = _solution(A, -g)
    free = np.ones(z.size, dtype=bool)
    for _ in range(z.size):
        ends = z + step
        beyond = free & ((ends < 0) | (ends > 1))
        if not beyond.any():
            break
        step[beyond] = np.clip(ends[beyond], 0, 1) - z[beyond]
        free &= ~beyond
        own, others = np.flatnonzero(free), np.flatnonzero(~free)
        if own.size:
            rows = A[own]
            step[own] = _solution(rows[:, own], -g[own] - rows[:, others] @ step[others])
    return np.asarray(step)


def _solution(A: Array, b: Array) -> Array:
    """x with A x = b, as `numpy.linalg.solve` gives and raises it, without its checks, which take longer for a few unknowns."""
    x, wrong = dgesv(A, b)[2:]
    if wrong:
        raise np.linalg.LinAlgError("Singular matrix")
    return np.asarray(x)


def noise_at(posterior: Posterior, z: Array) -> NoiseModel:
    """The noise of each test that the residuals at z show, beside the errors of the model: largest restricted likelihood, by EM."""
    curves, noise = posterior.curves, posterior.noise
    force, J = curves.at(z)
    P = posterior.prior_rows()[0]
    floors = np.array([FINEST * np.abs(t.curve.force).max() for t in curves.problem.tests])
    left = force - curves.measured()

    def sized(noise: NoiseModel) -> NoiseModel:
        for _ in range(ROUNDS):
            noise = _step(posterior, noise, left, J, P, floors)
        return noise

    for _ in range(3):
        noise = sized(noise)
        rho = _correlated(posterior, noise, left, J, P)
        if np.allclose(rho, noise.rho, atol=1e-2):
            return noise
        noise = replace(noise, rho=rho)
    return sized(noise)  # the size belongs to the correlation


def _projection(posterior: Posterior, noise: NoiseModel, J: Array, P: Array) -> tuple[Array, Array]:
    """Inverse of the covariance of the used rows, and the same without what the coordinates explain."""
    rows = posterior.rows
    inverse = cho_solve(cho_factor(noise.covar(posterior.curves.slices)[np.ix_(rows, rows)]), np.eye(rows.size))
    A = np.linalg.inv(J[rows].T @ inverse @ J[rows] + P.T @ P + 1e-6 * np.eye(J.shape[1]))
    return inverse, inverse - inverse @ J[rows] @ A @ J[rows].T @ inverse


def _step(posterior: Posterior, noise: NoiseModel, r: Array, J: Array, P: Array, floors: Array) -> NoiseModel:
    """One step of EM, and of the unknown scale of the law's misfit."""
    rows = posterior.rows
    inverse, left = _projection(posterior, noise, J, P)
    weighted, sigma, done = inverse @ r[rows], noise.sigma.copy(), 0
    law = noise.law
    if law is not None and law.ends is not None:  # a step of the algorithm of Zhou et al. (2019, J Comput Graph Stat 28:350)
        roots = law.roots[rows]
        shown, expected = np.sum((roots.T @ weighted) ** 2), np.sum(roots * (left @ roots))
        law = law.scaled(float(shown / max(expected, 1e-300)) ** 0.25)
    for k, (part, used) in enumerate(zip(posterior.curves.slices, posterior.used, strict=True)):
        n = part.stop - part.start
        if not used:
            continue
        here = slice(done, done + n)
        R, done = noise.shape(k), done + n
        variance = noise.sigma[k] ** 2
        squares = variance**2 * weighted[here] @ R @ weighted[here]
        spread = n * variance - variance**2 * np.trace(R @ left[here, here])
        sigma[k] = max(np.sqrt(max(squares + spread, 0.0) / n), floors[k])
    return replace(noise, sigma=sigma, law=law)


def _correlated(posterior: Posterior, noise: NoiseModel, r: Array, J: Array, P: Array) -> Array:
    """Autocorrelation of the noise of each test."""
    rows, rho, done = posterior.rows, noise.rho.copy(), 0
    inverse, left = _projection(posterior, noise, J, P)
    weighted = inverse @ r[rows]
    for k, (part, used) in enumerate(zip(posterior.curves.slices, posterior.used, strict=True)):
        n = part.stop - part.start
        if used:
            here = slice(done, done + n)
            R, trust = noise.sigma[k] ** 2 * noise.correlations(k), noise.trust[k]
            rho[k] = autocorrelation(R @ (left[here, here] / np.outer(trust, trust)), R @ (weighted[here] / trust))
            done += n
    return rho
