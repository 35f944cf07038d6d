"""The law's own misfit as a term of a fit: a smooth error of each test's curve that vanishes at small strains.

The error of a force F at the depth d, of at most D in the test, is

    scale F (d / D)^q g(d / D),

where F is a smooth curve through the measured forces, and g is a Gaussian process of standard deviation 1 and correlation
1/2 + 1/2 exp(-(x - x')^2 / 2 length^2) (Kennedy and O'Hagan 2001, J R Stat Soc B 63:425). The half that does not depend on the
distance is a misfit that goes on as it begins: laws mostly part further as strains grow, and under a sphere such a misfit is nearly
a factor, which no curve tells from the modulus. The density of an unknown scale is uniform (Gelman 2006, Bayesian Anal 1:515): one
that is uniform in the logarithm makes a large misfit that looks like a factor improbable beside a small one.

Elastic laws of one small-strain modulus differ the less, the smaller the strains, and strains grow as the depth over the half-width
of the contact: q = 1 under a flat face and without an indenter, 1/2 under a sphere, and 0 under a cone, whose strains are as large
at every depth. By this, parameters keep their meaning at small strains, where a misfit of any form would take its part of them
(Brynjarsdottir and O'Hagan 2014, Inverse Probl 30:114007). The errors of different tests are independent.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag, eigh
from scipy.optimize import nnls

from indentfit.arrays import Array
from indentfit.case import Case, Test
from indentfit.case.search import SCALES
from indentfit.curve import Curve
from indentfit.inverse.objective import Target

GROWTH = {"flat": 1.0, "sphere": 0.5, "cone": 0.0}  # power of the depth with which strains grow under an indenter's end
SMALL_STRAIN = 0.01  # of a test without an indenter: the law is exact below
POWERS = (1.0, 1.5, 2.0, 3.0, 4.0)  # of the depth, of which a smooth force curve is made
KEPT = 0.5  # of the variance: a misfit that goes on as it begins
LEFT = 1e-8  # of the largest variance: directions of less are left out


@dataclass(frozen=True, eq=False)
class LawError:
    """The law's misfit at the points of all tests in a row.

    Parameters
    ----------
    roots : array (N, q), mN
        Errors at scale 1, independent of each other, whose squares add up to the covariance.
    scale : float
    ends : (low, high) or None
        Between which an unknown scale lies, uniformly; None where the case states the scale.
    """

    roots: Array
    scale: float
    ends: tuple[float, float] | None = None

    @property
    def covar(self) -> Array:
        """Covariance of the errors, (N, N)."""
        return np.asarray(self.scale**2 * self.roots @ self.roots.T)

    def at(self, units: Array) -> Array:
        """Unknown scales at their coordinates, which are uniform between 0 and 1 before the curves speak."""
        assert self.ends is not None
        low, high = self.ends
        return np.asarray(low + units * (high - low))

    @property
    def unit(self) -> float:
        """The coordinate of an unknown scale."""
        assert self.ends is not None
        low, high = self.ends
        return (self.scale - low) / (high - low)

    def scaled(self, factor: float) -> "LawError":
        """The errors with another scale, within its ends."""
        assert self.ends is not None  # a stated scale stays as it is
        return replace(self, scale=float(np.clip(self.scale * factor, *self.ends)))


def law_error(case: Case, tests: Sequence[Target]) -> LawError | None:
    """The LawError of a case that states one, at the points of its tests.

    Parameters
    ----------
    case : Case
    tests : sequence of Target
        One for each test of the case.

    Returns
    -------
    LawError or None
    """
    stated, length = case.fit.discrepancy.stated, case.fit.discrepancy.reach
    if stated is None:
        return None
    roots = block_diag(
        *(_roots(x, q, length, smooth(target.curve)) for (x, q), target in zip(places(case, tests), tests, strict=True))
    )
    if stated == "unknown":
        return LawError(roots, float(np.sqrt(SCALES[0] * SCALES[1])), SCALES)
    return LawError(roots, float(stated))


def places(case: Case, tests: Sequence[Target]) -> list[tuple[Array, float]]:
    """The points of each test over its largest depth, (n,), and the power with which its strains grow; at small strains all 0."""
    points = []
    for test, target in zip(case.tests, tests, strict=True):
        depth = np.abs(target.curve.displacement)
        largest = float(depth.max())
        own = test.kind not in ("indentation", "compression")
        x = np.zeros(depth.size) if own and largest <= SMALL_STRAIN else depth / largest
        points.append((x, growth(case, test)))
    return points


def growth(case: Case, test: Test) -> float:
    """The power of the depth with which the strains of a test grow."""
    return GROWTH[case.indenter_of(test).geometry.end] if test.kind == "indentation" else 1.0


def covariances(x: Array, other: Array, q: float, length: float) -> Array:
    """Covariance at scale 1 of the relative errors at depths x (n,) and others (m,), over the largest depth, (n, m)."""
    near = KEPT + (1 - KEPT) * np.exp(-0.5 * (np.subtract.outer(x, other) / length) ** 2)
    return np.asarray(near * np.outer(_size(x, q), _size(other, q)))


def _size(x: Array, q: float) -> Array:
    """The standard deviation at scale 1; none at depth 0, where there is no force."""
    return np.where(x > 0, np.maximum(x, 1e-300) ** q, 0.0)


def smooth(curve: Curve) -> Array:
    """The force of a smooth curve through a measured one, mN, at its points: powers of the depth that only push, or only pull.

    Forces near zero depth are mostly noise, and no law errs in proportion to that.
    """
    depth = np.abs(curve.displacement)
    sign = 1.0 if float(curve.force @ depth) >= 0 else -1.0
    powers = (depth[:, None] / depth.max()) ** np.array(POWERS)
    return np.asarray(sign * powers @ nnls(powers, sign * curve.force)[0])


def _roots(x: Array, q: float, length: float, force: Array) -> Array:
    values, vectors = eigh(covariances(x, x, q, length) * np.outer(force, force))
    counted = values > LEFT * max(float(values.max()), 1e-300)
    return np.asarray(vectors[:, counted] * np.sqrt(values[counted]))
