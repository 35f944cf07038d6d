"""What a measured curve shows, before any solve, about the way it was recorded: a preload, adhesion, or a wrong sign."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from indentfit.arrays import Array
from indentfit.curve import Curve
from indentfit.digits import quantity

LEAST = 0.02  # of the largest force: a smaller force at zero displacement, or below zero, is not mentioned
CLEAR = 4.0  # standard deviations of one point: a smaller force may be noise
FIRST = 0.25  # share of the depth in which the first forces lie
CONTACT = 2.0  # standard deviations of the contact point: an earlier contact within them is no doubt; the fit's intervals hold it
EXTRAPOLATED = 0.4  # share of the depth from which the force at zero displacement is extrapolated
FEWEST = 6  # points for this
PRELOAD = (
    "the force at zero displacement is {force}, {share:.0%} of the largest: a preload, an offset of the load cell, or a "
    "contact point that was taken too late"
)
OF_CURVE = (
    "subtract the offset of the force, or count displacements from first contact (fit.uncertain.offset = {{ start = {start:.2g}, "
    "min = {low:.2g}, max = 0 }} fits an earlier contact point)"
)
OF_RECORD = (
    'say what the force\'s zero is ([record] zero) and where contact is ([record] contact = "extrapolated", "force" or a number of '
    "mm), or let the fit find it (fit.uncertain.offset = {{ start = {start:.2g}, min = {low:.2g}, max = 0 }})"
)
ADHESION = (
    "its first forces are negative, down to {force} ({share:.0%} of the largest): adhesion, a zero of the load cell that is "
    "off, or a wrong sign"
)
OF_ADHESION = "the model has no adhesion: leave these points out or correct the zero"


@dataclass(frozen=True)
class CurveDoubt:
    """Something in the measured curve of a test that no model here can follow: what is seen, and what to do about it.

    is_preload : whether it is a force at zero displacement, which an earlier contact point explains.
    """

    test: str
    seen: str
    remedy: str
    is_preload: bool = True

    def __str__(self) -> str:
        return f"test.{self.test}: {self.seen}; {self.remedy}"


def doubts(name: str, curve: Curve, recorded: bool = False) -> Iterator[CurveDoubt]:
    """One CurveDoubt for each thing in a measured curve that no model here can follow.

    Parameters
    ----------
    name : str
        The test.
    curve : Curve
    recorded : bool
        Whether the curve comes from a raw record, whose zero and contact point the table [record] gives.

    Yields
    ------
    CurveDoubt
    """
    largest, noise = float(np.abs(curve.force).max()), noise_of_points(curve.force)
    least = max(LEAST * largest, CLEAR * noise)
    first = curve.force[curve.displacement <= FIRST * curve.displacement[-1]]
    if first.size and first.min() < -least:
        yield CurveDoubt(
            name,
            ADHESION.format(force=quantity(float(first.min()), "mN", 3), share=-first.min() / largest),
            OF_ADHESION,
            is_preload=False,
        )
        return
    force, error = force_at_zero(curve)
    if force > max(least, CLEAR * error):
        earlier = _earlier(curve, force)
        if curve.contact is not None and earlier <= CONTACT * curve.contact:
            return
        remedy = (OF_RECORD if recorded else OF_CURVE).format(start=-earlier, low=-3 * earlier)
        yield CurveDoubt(name, PRELOAD.format(force=quantity(force, "mN", 3), share=force / largest), remedy)


def force_at_zero(curve: Curve) -> tuple[float, float]:
    """The force at zero displacement with its standard error, mN: the first force of a curve that begins there, otherwise
    extrapolated by a parabola through the first points; nan where these are too few."""
    d, force = curve.displacement, curve.force
    if d[0] == 0:
        return float(force[0]), noise_of_points(force)
    near = d <= max(EXTRAPOLATED * d[-1], d[min(FEWEST, d.size) - 1])
    if near.sum() < FEWEST or d[near][-1] > 0.6 * d[-1]:
        return np.nan, np.nan
    powers = np.vander(d[near] / d[-1], 3, increasing=True)
    coefficients, *_ = np.linalg.lstsq(powers, force[near], rcond=None)
    left = force[near] - powers @ coefficients
    variance = left @ left / (near.sum() - 3)
    return float(coefficients[0]), float(np.sqrt(variance * np.linalg.inv(powers.T @ powers)[0, 0]))


def noise_of_points(force: Array) -> float:
    """Standard deviation of one point's noise, mN, from the median of the second differences, which a smooth curve hardly has."""
    return float(1.4826 * _median(np.abs(np.diff(force, 2))) / np.sqrt(6)) if force.size > 3 else 0.0


def _median(values: Array) -> float:
    """np.median, which imports numpy.ma: that takes longer than the other checks of a case together."""
    ordered = np.sort(values)
    return float(ordered[(values.size - 1) // 2] + ordered[values.size // 2]) / 2


def _earlier(curve: Curve, force: float) -> float:
    """The depth by which contact came before zero displacement, mm, by the slope of the first points."""
    few = min(FEWEST, curve.force.size)
    slope = np.polyfit(curve.displacement[:few], curve.force[:few], 1)[0]
    return float(min(force / slope, curve.displacement[-1])) if slope > 0 else float(curve.displacement[-1])
