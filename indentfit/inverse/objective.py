"""How far simulated curves are from measured ones, and the parameter that the force is proportional to.

Equation (1) of the source paper (J Mech Behav Biomed Mater 65:490) is the weighted SUM of the tests' root mean
square errors; least squares minimises the weighted sum of their squares. Both are reported, each under its name.
"""

from dataclasses import dataclass
from math import hypot

import numpy as np
from scipy.optimize import brentq

from indentfit.curve import Curve


@dataclass(frozen=True)
class Target:
    """What one test measured, and its weight in the objective."""

    name: str
    curve: Curve
    weight: float


def misfit(test, force):
    """Force residuals of one test, mN, shape (n,), scaled so that their squares sum to w RMSE^2."""
    return np.sqrt(test.weight / test.curve.force.size) * (force - test.curve.force)


def rmse(test, force):
    """Root mean square error of one test, mN."""
    return float(np.sqrt(np.mean((force - test.curve.force) ** 2)))


def equation_one(tests, forces):
    """The weighted sum of the tests' RMSEs, mN: equation (1) of the source paper."""
    return sum(test.weight * rmse(test, force) for test, force in zip(tests, forces, strict=True))


def sum_of_squares(tests, forces):
    """The weighted sum of the tests' squared RMSEs, mN^2."""
    return sum(test.weight * rmse(test, force) ** 2 for test, force in zip(tests, forces, strict=True))


def best_scale(tests, forces, low=0.0, high=np.inf):
    """The factor s in low..high that makes s * forces best under equation (1).

    Equation (1) is convex in s and its least lies between the best factors of the single tests, where its slope
    changes sign; it may also lie at one of them, if the curve of that test is met exactly.
    """
    parts = [_part(test, force) for test, force in zip(tests, forces, strict=True) if test.weight]
    alone = [best for _, _, best, _ in parts]

    def value(s):
        return sum(weight * hypot(size * (s - best), left) for weight, size, best, left in parts)

    def slope(s):
        return sum(weight * size**2 * (s - best) / (hypot(size * (s - best), left) or 1.0) for weight, size, best, left in parts)

    candidates, ends = list(alone), (min(alone), max(alone))
    if slope(ends[0]) < 0 < slope(ends[1]):
        candidates.append(brentq(slope, *ends, xtol=1e-300, rtol=1e-14))
    return float(np.clip(min(candidates, key=value), low, high))


def _part(test, force):
    """A test's weight, the norm of its curve, its best factor alone, and what that leaves: |s f - target|^2 is
    (|f| (s - best))^2 + left^2."""
    target, size = test.curve.force, float(np.linalg.norm(force))
    best = float(force @ target) / size**2 if size else 0.0
    return test.weight / np.sqrt(len(force)), size, best, float(np.linalg.norm(best * force - target))
