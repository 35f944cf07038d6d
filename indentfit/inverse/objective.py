"""The misfit of simulated curves to measured curves, and the best scale of simulated forces.

Where a curve states the standard deviations of its forces, each residual counts by `Curve.trust`: the mean of the squared factors
is 1, so that RMSEs stay forces of the usual size.

Equation (1) of the source paper (J Mech Behav Biomed Mater 65:490) is the weighted SUM of the tests' root mean
square errors; least squares minimises the weighted sum of their squares. Both are reported, each under its name.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot

import numpy as np
from scipy.optimize import brentq

from indentfit.arrays import Array
from indentfit.axes import MOTION
from indentfit.curve import Curve


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
    return float(np.sqrt(np.mean((test.curve.trust * (force - test.curve.force)) ** 2)))


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
    return sum(test.of_rmse * rmse(test, force) for test, force in zip(tests, forces, strict=True))


def sum_of_squares(tests: Sequence[Target], forces: Sequence[Array]) -> float:
    """The weighted sum of the tests' squared RMSEs, mN^2."""
    return sum(test.of_square * rmse(test, force) ** 2 for test, force in zip(tests, forces, strict=True))


def best_scale(tests: Sequence[Target], forces: Sequence[Array], low: float = 0.0, high: float = np.inf) -> float:
    """The factor with which factor * forces minimises equation (1).

    Equation (1) is convex in the factor. Its minimum lies between the best factors of the single tests, where its slope changes
    sign; it may also lie at the best factor of a test whose curve is then reproduced exactly.

    Parameters
    ----------
    tests : sequence of Target
    forces : sequence of arrays (n,), mN
    low, high : float
        Bounds of the factor.

    Returns
    -------
    float
    """
    parts = [_part(test, force) for test, force in zip(tests, forces, strict=True) if test.weight]
    alone = [part.best for part in parts]

    def value(factor: float) -> float:
        return sum(part.weight * hypot(part.size * (factor - part.best), part.left) for part in parts)

    def slope(factor: float) -> float:
        return sum(part.slope(factor) for part in parts)

    candidates, ends = list(alone), (min(alone), max(alone))
    if slope(ends[0]) < 0 < slope(ends[1]):
        candidates.append(brentq(slope, *ends, xtol=1e-300, rtol=1e-14))
    return float(np.clip(min(candidates, key=value), low, high))


@dataclass(frozen=True)
class _Part:
    """One test in equation (1) as a function of the factor s: |s f - target|^2 is (size (s - best))^2 + left^2.

    weight: weight of the norm; size: norm of the curve; best: best factor of the test alone; left: remaining norm at that factor.
    """

    weight: float
    size: float
    best: float
    left: float

    def slope(self, factor: float) -> float:
        return self.weight * self.size**2 * (factor - self.best) / (hypot(self.size * (factor - self.best), self.left) or 1.0)


def _part(test: Target, force: Array) -> _Part:
    force, target = test.curve.trust * force, test.curve.trust * test.curve.force
    size = float(np.linalg.norm(force))
    best = float(force @ target) / size**2 if size else 0.0
    return _Part(test.of_rmse / np.sqrt(len(force)), size, best, float(np.linalg.norm(best * force - target)))
