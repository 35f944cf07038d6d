"""The misfit of simulated curves to measured curves, and the best scale of simulated forces.

Where a curve states the standard deviations of its forces, each residual counts by `Curve.trust`: the mean of the squared factors
is 1, so that RMSEs stay forces of the usual size.

Equation (1) of the source paper (J Mech Behav Biomed Mater 65:490) is the weighted SUM of the tests' root mean
square errors; least squares minimises the weighted sum of their squares. Both are reported, each under its name.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from indentfit.arrays import Array
from indentfit.axes import MOTION
from indentfit.curve import Curve

HALVINGS = 100  # of the interval in which a best factor lies: more than the digits of a number need


@dataclass(frozen=True)
class Target:
    """The measured curve of one test, or of one segment of it in time, and its weight in the objective.

    Parameters
    ----------
    name : str
    curve : Curve
    weight : float
    segment_of : str
        The name of the test of which this is a segment (its ramp, its hold, its retraction); empty for a whole test.
    scale : float
        Factor that makes residuals comparable of tests that measure different things, such as the force on an indenter and a
        stress: 1 where all tests are indentations. RMSEs are those of the curve itself.
    """

    name: str
    curve: Curve
    weight: float
    segment_of: str = ""
    scale: float = 1.0

    @property
    def test(self) -> str:
        """The name of the test."""
        return self.segment_of or self.name

    @property
    def moves(self) -> bool:
        """Whether the curve shows displacements of the sample, and not forces."""
        return self.curve.shown == MOTION

    @property
    def of_rmse(self) -> float:
        """Weight of the RMSE."""
        return self.weight * self.scale

    @property
    def of_square(self) -> float:
        """Weight of the squared RMSE."""
        return self.weight * self.scale**2


def misfit(test: Target, force: Array) -> Array:
    """Force residuals of one test, mN, (n,), scaled so that their squares sum to w RMSE^2."""
    return np.sqrt(test.of_square / test.curve.force.size) * test.curve.trust * (force - test.curve.force)


def rmse(test: Target, force: Array) -> float:
    """Root mean square error of one test.

    Parameters
    ----------
    test : Target
    force : array (n,), mN
        Simulated force at the displacements of `test.curve`.

    Returns
    -------
    float, mN
    """
    return float(_rmses(test, force))


def _rmses(test: Target, forces: Array) -> Array:
    """`rmse` of curves (..., n), mN, (...)."""
    return np.asarray(np.sqrt(np.mean((test.curve.trust * (forces - test.curve.force)) ** 2, axis=-1)))


def equation_one(tests: Sequence[Target], forces: Sequence[Array]) -> float:
    """Equation (1) of the source paper: the weighted sum of the tests' RMSEs, mN.

    Parameters
    ----------
    tests : sequence of Target
    forces : sequence of arrays (n,), mN
        Simulated forces of each test.

    Returns
    -------
    float, mN
    """
    return float(objectives(tests, forces)[0])


def sum_of_squares(tests: Sequence[Target], forces: Sequence[Array]) -> float:
    """The weighted sum of the tests' squared RMSEs, mN^2."""
    return float(objectives(tests, forces)[1])


def objectives(tests: Sequence[Target], forces: Sequence[Array]) -> tuple[Array, Array]:
    """Equation (1), mN, and the sum of squares, mN^2, each (...), of simulated forces (..., n), mN, of each test."""
    sizes = [_rmses(test, force) for test, force in zip(tests, forces, strict=True)]
    return (
        np.asarray(sum(test.of_rmse * size for test, size in zip(tests, sizes, strict=True))),
        np.asarray(sum(test.of_square * size**2 for test, size in zip(tests, sizes, strict=True))),
    )


def best_scale(tests: Sequence[Target], forces: Sequence[Array], low: float = 0.0, high: float = np.inf) -> float:
    """`best_scales` of one curve (n,), mN, of each test."""
    return float(best_scales(tests, [force[None] for force in forces], low, high)[0])


def best_scales(tests: Sequence[Target], forces: Sequence[Array], low: float = 0.0, high: float = np.inf) -> Array:
    """The factors with which factor * forces minimises equation (1), of many curves at once.

    Equation (1) is convex in the factor. Its minimum lies between the best factors of the single tests, where its slope changes
    sign; it may also lie at the best factor of a test whose curve is then reproduced exactly.

    Parameters
    ----------
    tests : sequence of Target
    forces : sequence of arrays (m, n), mN
        m simulated curves of each test.
    low, high : float
        Bounds of the factors.

    Returns
    -------
    array (m,)
    """
    parts = [_part(test, force) for test, force in zip(tests, forces, strict=True) if test.weight]
    alone = np.array([part.best for part in parts])  # (tests, m)
    below, above = alone.min(axis=0), alone.max(axis=0)
    for _ in range(HALVINGS):
        middle = (below + above) / 2
        rises = np.asarray(sum(part.slope(middle) for part in parts)) > 0
        below, above = np.where(rises, below, middle), np.where(rises, middle, above)
        if np.all(above - below <= np.spacing(np.abs(middle))):
            break
    candidates = np.concatenate([alone, [(below + above) / 2]])
    values = np.asarray(sum(part.value(candidates) for part in parts))
    return np.clip(candidates[values.argmin(axis=0), np.arange(candidates.shape[1])], low, high)


@dataclass(frozen=True, eq=False)
class _Part:
    """One test in equation (1) as a function of the factor s: |s f - target|^2 is (size (s - best))^2 + left^2, of m curves f.

    weight: weight of the norm; size (m,): norms of the curves; best (m,): best factors of the test alone; left (m,): remaining
    norms at those factors.
    """

    weight: float
    size: Array
    best: Array
    left: Array

    def value(self, factor: Array) -> Array:
        """The test's term of equation (1) at factors (..., m)."""
        return np.asarray(self.weight * np.hypot(self.size * (factor - self.best), self.left))

    def slope(self, factor: Array) -> Array:
        """The derivatives of the term at factors (m,)."""
        away = self.size * (factor - self.best)
        norm = np.hypot(away, self.left)
        return np.asarray(self.weight * self.size * away / np.where(norm > 0, norm, 1.0))


def _part(test: Target, forces: Array) -> _Part:
    forces, target = test.curve.trust * forces, test.curve.trust * test.curve.force
    size = np.linalg.norm(forces, axis=1)
    best = (forces @ target) / np.where(size > 0, size, 1.0) ** 2
    left = np.linalg.norm(best[:, None] * forces - target, axis=1)
    return _Part(test.of_rmse / np.sqrt(forces.shape[1]), size, best, left)
