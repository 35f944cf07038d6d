"""The likelihood of residuals whose noise is unknown: its size and correlation are integrated out, for each test.

The noise of a test has a size that is log-uniform between SMALLEST and LARGEST of the test's largest force, and a correlation of
neighbouring points that is one of CORRELATIONS, each as probable as the others. An error common to neighbouring forces (by the
mesh) is added, with a stated standard deviation and the smoothness SMOOTHLY. These are priors that do not depend on the law.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular

from indentfit.arrays import Array, Ints
from indentfit.curve import Curve
from indentfit.inference.log_sum import log_sum
from indentfit.inference.noise import correlations
from indentfit.inverse.problem import InverseProblem

SMALLEST, LARGEST, SIZES = 1e-4, 1.0, 121  # of the largest force of a test
CORRELATIONS = (0.0, 0.3, 0.6, 0.85, 0.95)
POWERS = (1.0, 1.5, 2.0, 3.0)  # of the depth, for a curve without its noise
SMOOTHLY = 0.5  # of the depth: length over which the error of the mesh keeps its sign


@dataclass(frozen=True, eq=False)
class Whitened:
    """One test under one correlation of its noise: after `turn`, points are independent with the variances sigma^2 + `shared`."""

    turn: Array
    shared: Array
    log_volume: float


@dataclass(frozen=True, eq=False)
class TestNoise:
    """The unknown noise of one test.

    Parameters
    ----------
    rows : array (n,)
        Numbers of the test's forces in the row of all tests.
    sizes : array (SIZES,), mN
    kinds : tuple of Whitened, one for each correlation
    """

    __test__ = False

    rows: Ints
    sizes: Array
    kinds: tuple[Whitened, ...]

    def log_density(self, residuals: Array) -> Array:
        """Logarithm of the density of residuals (m, N), (m,)."""
        return log_sum(self._table(residuals).reshape(len(residuals), -1), axis=1)

    def whitener(self, residuals: Array) -> Array:
        """The matrix (n, n) that makes residuals (N,) independent with unit variance, under their most probable noise."""
        table = self._table(residuals[None])[0]
        kind, size = np.unravel_index(int(np.argmax(table)), table.shape)
        known = self.kinds[kind]
        return np.asarray(known.turn / np.sqrt(self.sizes[size] ** 2 + known.shared)[:, None])

    def size(self, residuals: Array) -> float:
        """The most probable size of the noise in residuals (N,), mN."""
        table = self._table(residuals[None])[0]
        return float(self.sizes[int(np.argmax(log_sum(table, axis=0)))])

    def _table(self, residuals: Array) -> Array:
        """Logarithm of density times prior for each correlation and size, (m, kinds, sizes)."""
        prior = -np.log(len(self.kinds) * self.sizes.size) - 0.5 * self.rows.size * np.log(2 * np.pi)
        table = np.empty((len(residuals), len(self.kinds), self.sizes.size))
        for kind, known in enumerate(self.kinds):
            variance = self.sizes[:, None] ** 2 + known.shared  # (sizes, n)
            squares = (residuals[:, self.rows] @ known.turn.T) ** 2
            volumes = 0.5 * np.log(variance).sum(axis=1) + known.log_volume - prior
            np.subtract(squares @ (-0.5 / variance).T, volumes, out=table[:, kind])
        return table


@dataclass(frozen=True, eq=False)
class UnknownNoise:
    """The unknown noise of those points of all tests that count."""

    tests: tuple[TestNoise, ...]
    measured: Array

    @property
    def rows(self) -> Ints:
        """Numbers of the forces that count."""
        return np.concatenate([test.rows for test in self.tests])

    def log_likelihood(self, forces: Array) -> Array:
        """Logarithm of the likelihood of curves (m, N), (m,)."""
        residuals = forces - self.measured
        return np.asarray(sum((test.log_density(residuals) for test in self.tests), np.zeros(len(forces))))

    def whiteners(self, force: Array) -> list[tuple[Ints, Array]]:
        """For each test the numbers of its points, and the matrix that whitens residuals under the most probable noise of those of
        a curve (N,)."""
        return [(test.rows, test.whitener(force - self.measured)) for test in self.tests]


Moves = Sequence[Sequence[Array]]  # for each test the changes of its curve by one standard deviation of errors


def unknown_noise(problem: InverseProblem, mesh: float, counted: Sequence[Ints] | None = None, moves: Moves = ()) -> UnknownNoise:
    """The UnknownNoise of the tests of a problem.

    Parameters
    ----------
    problem : InverseProblem
    mesh : float
        Standard deviation of the forces' error by the mesh, relative.
    counted : sequence of arrays
        For each test the numbers of its points that count; by default all of the tests that have a weight.
    moves : for each test a sequence of arrays (n,), mN
        Changes of the whole curve by one standard deviation of further errors, such as that of the contact point.

    Returns
    -------
    UnknownNoise
    """
    tests, start = [], 0
    for n, test in enumerate(problem.tests):
        size = test.curve.force.size
        used = np.arange(size if test.weight else 0) if counted is None else np.asarray(counted[n])
        if used.size:
            shared = mesh_covar(test.curve, mesh) + sum(
                (np.outer(row, row) for row in (moves[n] if moves else ())), np.zeros((size, size))
            )
            tests.append(_test_noise(test.curve, used, start, shared[np.ix_(used, used)]))
        start += size
    return UnknownNoise(tuple(tests), np.concatenate([test.curve.force for test in problem.tests]))


def smoothed(depth: Array, force: Array) -> Array:
    """A curve without its noise: a few powers of the depth, fitted to it. An error in proportion to the noisy forces would explain
    residuals that are the noisy curve itself, of a law without stiffness."""
    powers = np.maximum(depth, 0.0)[:, None] ** np.array(POWERS[: max(1, min(len(POWERS), depth.size // 3))])
    return np.asarray(powers @ np.linalg.lstsq(powers, force, rcond=None)[0])


def mesh_covar(measured: Curve, sd: float) -> Array:
    """Covariance (n, n) of the forces' error by the mesh, of a relative standard deviation."""
    depth = measured.displacement
    smooth = np.exp(-0.5 * (np.subtract.outer(depth, depth) / (SMOOTHLY * depth[-1])) ** 2)
    curve = smoothed(depth, measured.force)
    return np.asarray(sd**2 * np.outer(curve, curve) * smooth)


def _test_noise(measured: Curve, used: Ints, start: int, shared: Array) -> TestNoise:
    force, shape = measured.force, 1 / np.outer(measured.trust, measured.trust)
    kinds = []
    for rho in CORRELATIONS if used.size > 3 else CORRELATIONS[:1]:
        root = np.linalg.cholesky((correlations(force.size, rho) * shape)[np.ix_(used, used)])
        half = solve_triangular(root, shared, lower=True)
        values, vectors = np.linalg.eigh(solve_triangular(root, half.T, lower=True))
        turn = vectors.T @ solve_triangular(root, np.eye(used.size), lower=True)
        kinds.append(Whitened(turn, np.maximum(values, 0.0), float(np.log(np.diag(root)).sum())))
    sizes = np.geomspace(SMALLEST, LARGEST, SIZES) * float(np.abs(force).max())
    return TestNoise(start + used, sizes, tuple(kinds))
