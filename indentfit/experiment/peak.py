"""The largest force of a loading, by a filter that removes noise and ringing and keeps the peak, or by a fit where noise is large."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter

from indentfit.arrays import Array
from indentfit.experiment.contact_point import ContactPoint
from indentfit.experiment.loading import Ramp, filtered
from indentfit.experiment.noise import covariance, noise_in

LONGEST = 0.05  # of the duration of the ramp: longer than a period of the rig's ringing
SHORTEST = 5  # samples
CLEARLY_SHORTER = 2.0  # a filter that is not, lets the same noise pass
STEADY = 0.0025  # share of the peak: the scatter of the filtered force that is allowed
OTHER = 0.01  # share of the peak by which a larger force of the record is worth a note
FITTED = 0.2  # of the duration of the ramp: the end of the loading, whose fit gives the peak of a noisy record
SURE = 3.0  # standard errors
SIGMA_95 = 1.96


@dataclass(frozen=True)
class Peak:
    """The largest force of a loading, mN, and its standard error, mN, by the scatter of the samples."""

    force: float
    stderr: float


def peak_of(ramp: Ramp, start: int, force: Array) -> Peak:
    """The `Peak` of a loading.

    The filter is the shortest after which the force scatters by less than 0.25 % of its peak in the ramp, so that a sharp peak is
    kept where the record is quiet. Where none is, a parabola is fitted to the end of the loading: the largest of noisy values is
    too large.

    Parameters
    ----------
    ramp : Ramp
    start : int
        First sample in contact.
    force : array (n,), mN
        The whole record, not filtered, counted from the force's zero.

    Returns
    -------
    Peak
    """
    stop = ramp.stop + round(0.5 * ramp.samples)
    longest = LONGEST * ramp.samples
    smooth = filtered(force[:stop], longest)
    length, fit = float(SHORTEST), _fitted(ramp, start, force)
    while length < longest / CLEARLY_SHORTER:
        shorter = filtered(force[:stop], length)
        scatter = float(np.std((shorter - smooth)[ramp.low : ramp.high]))
        if scatter < STEADY * smooth[start:].max():
            largest = float(shorter[start:].max())
            return Peak(largest, max(scatter, min(abs(largest - fit.force), fit.stderr)))
        length *= 1.6
    return fit


def _fitted(ramp: Ramp, start: int, force: Array) -> Peak:
    """The force at the end of loading by a parabola over time."""
    begin = max(start, ramp.stop - max(15, round(FITTED * ramp.samples)))
    age = (ramp.record.time[begin : ramp.stop] - ramp.record.time[ramp.stop - 1]) / ramp.duration
    terms = np.column_stack([np.ones_like(age), age, age**2])
    values = np.linalg.lstsq(terms, force[begin : ramp.stop], rcond=None)[0]
    spread = covariance(terms, noise_in(force[begin : ramp.stop] - terms @ values))
    return Peak(float(values[0]), float(np.sqrt(max(spread[0, 0], 0.0))))


def peak_notes(ramp: Ramp, peak: Peak, force: Array, contact: ContactPoint) -> Iterator[str]:
    """A note where the record holds a larger force than the peak of the loading, and where noise or baseline blur the peak."""
    largest = float(median_filter(force, size=5, mode="nearest").max())
    scatter = float(np.std((force - ramp.force - np.median(force - ramp.force))[ramp.low : ramp.high]))
    if largest > (1 + OTHER) * peak.force + 4 * scatter:
        yield f"the largest force of the record, {largest:.4g} mN, is above the peak of the loading, {peak.force:.4g} mN"
    error = float(np.hypot(peak.stderr, contact.zero_error / SIGMA_95))
    if SURE * error > OTHER * peak.force:
        cause = "the baseline" if contact.zero_error / SIGMA_95 > peak.stderr else "the noise"
        yield f"the peak is uncertain by {SIGMA_95 * error / peak.force:.1%} (95 %) because of {cause}"
