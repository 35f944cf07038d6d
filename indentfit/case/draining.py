"""Draining or viscosity: whether the holds of two contacts of different size relax over times in proportion to the contact's area.

A viscous material relaxes over the same times under every contact. Where a pore fluid drains, the time grows with the square of the
way that the fluid goes, and so with the contact's area (Hu, Zhao, Vlassak and Suo 2010, Appl Phys Lett 96:121904). The hold under
the smaller contact is fitted by exponentials of many times, and predicts that under the larger one twice: with the same times, and
with times that are longer by the ratio of the areas. Where neither does, and times of another ratio do, this is told too.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from indentfit.arrays import Array
from indentfit.case.doubts import noise_of_points
from indentfit.case.in_time import motion_of

if TYPE_CHECKING:
    from indentfit.case.whole import Case

FEWEST = 8  # points of a hold
LEAST_RATIO = 1.5  # of two areas
RELAXED = 0.03  # of the force: a hold in which less is lost tells nothing
BETTER, CLEAR = 0.5, 3.0  # misfits: by the areas, over that by the same times; and that by the same times, over the noise
PER_DECADE = 4  # exponentials
FACTORS = np.geomspace(0.1, 10.0, 41)  # ratios of the times that are tried
HOLDS_DIFFER = "holds differ: "
DRAINS = HOLDS_DIFFER + (
    "of test.{small} and test.{large}, that under the larger contact is slower; times in proportion to the contact's area "
    "({ratio:.3g} times as large) predict its force to {by_area:.1%}, the same times to {same:.1%}: this looks like draining of "
    "a pore fluid (poroelasticity), not like viscosity, and no material here drains; do not carry its relaxation over to contacts "
    "of another size"
)
UNLIKE = HOLDS_DIFFER + (
    "times {factor:.2g} times as long as under test.{small} predict the force of test.{large} to {best:.1%}, the same times to "
    "{same:.1%}, and times in proportion to the contact's area ({ratio:.3g} times) are no better: neither one viscosity nor "
    "draining of a pore fluid alone; fit each test alone, and find out what else differs (sample, depth, temperature, how long the "
    "hold is)"
)


@dataclass(frozen=True, eq=False)
class Hold:
    """The measured hold of a test.

    Parameters
    ----------
    name : str
        The test.
    area : float, mm^2
        Square of the half width of the contact: areas in proportion.
    ramp : float, s
        Duration of the ramp before the hold.
    time, force : arrays (n,), s since the ramp's end and mN
    """

    name: str
    area: float
    ramp: float
    time: Array
    force: Array


def draining(case: Case) -> Iterator[str]:
    """A line for each pair of tests whose holds relax as draining does, or otherwise not over the same times, as viscosity does."""
    holds = sorted(_holds(case), key=lambda hold: hold.area)
    for small, large in itertools.combinations(holds, 2):
        ratio = large.area / small.area
        if ratio < LEAST_RATIO:
            continue
        same = _misfit(small, large, 1.0)
        noise = noise_of_points(large.force) / float(large.force.max())
        if same is None or same <= CLEAR * noise:
            continue
        tried = [(misfit, factor) for factor in FACTORS if (misfit := _misfit(small, large, float(factor))) is not None]
        best, factor = min(tried, default=(same, 1.0))
        by_area = _misfit(small, large, ratio)
        names = {"small": small.name, "large": large.name, "ratio": ratio, "same": same}
        if by_area is not None and by_area < max(min(BETTER * same, best / BETTER), 2 * noise):
            yield DRAINS.format(by_area=by_area, **names)
        elif best < max(BETTER * same, 2 * noise):
            yield UNLIKE.format(best=best, factor=factor, **names)


def _holds(case: Case) -> Iterator[Hold]:
    """The holds of a case that relax and have enough points."""
    for test, curve in zip(case.tests, case.curves, strict=True):
        if test.kind != "indentation" or curve is None or curve.time is None:
            continue
        known = motion_of(test, curve)
        assert known is not None  # the curve has times
        motion, times = known
        ramp, ended = motion.ramp, float(motion.time[motion.turn])
        held = (times >= ramp.seconds) & (times <= ended)
        force = curve.force[held]
        if force.size < FEWEST or not 0 < force[-1] < (1 - RELAXED) * force[0]:
            continue
        half_width = case.indenter_of(test).geometry.partition(curve.deepest).half_width
        yield Hold(test.name, half_width**2, ramp.seconds, times[held] - ramp.seconds, force)


def _misfit(small: Hold, large: Hold, factor: float) -> float | None:
    """Root mean square error, over the largest force, with which the hold under the smaller contact predicts that under the larger
    one with times `factor` as long; None where the two have too few such times in common."""
    from scipy.optimize import nnls  # here: no other check of a case needs it

    seen = (large.time >= factor * small.time[0]) & (large.time <= factor * small.time[-1])
    if np.count_nonzero(seen) < FEWEST:
        return None
    low, high = 0.3 * small.time[small.time > 0][0], 3 * small.time[-1]
    times = np.geomspace(low, high, max(int(PER_DECADE * np.log10(high / low)), 2))
    shares, _ = nnls(_decays(small.time, small.ramp, times), small.force)
    shape, force = _decays(large.time[seen], large.ramp, factor * times) @ shares, large.force[seen]
    error = shape * (shape @ force) / (shape @ shape) - force
    return float(np.sqrt(np.mean(error**2)) / force.max())


def _decays(time: Array, ramp: float, times: Array) -> Array:
    """A constant, and the hereditary integrals (n, k) of exponentials in a hold after a ramp of an elastic force of 1."""
    x = ramp / times
    return np.column_stack([np.ones(time.size), -np.expm1(-x) / x * np.exp(-time[:, None] / times)])
