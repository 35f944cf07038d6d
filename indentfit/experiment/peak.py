"""The largest force of a loading, by a filter that removes noise and ringing and keeps the peak."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.ndimage import median_filter

from indentfit.arrays import Array
from indentfit.experiment.loading import Ramp, filtered

LONGEST = 0.05  # of the duration of the ramp: longer than a period of the rig's ringing
SHORTEST = 5  # samples
STEADY = 0.0025  # share of the peak: the scatter of the filtered force that is allowed
OTHER = 0.01  # share of the peak by which a larger force of the record is worth a note


def peak_force(ramp: Ramp, start: int, force: Array) -> float:
    """Largest force of a loading.

    The filter is the shortest after which the force scatters by less than 0.25 % of its peak in the ramp, so that a sharp peak is
    kept where the record is quiet.

    Parameters
    ----------
    ramp : Ramp
    start : int
        First sample in contact.
    force : array (n,), mN
        The whole record, not filtered, counted from the force's zero.

    Returns
    -------
    float, mN
    """
    stop = ramp.stop + round(0.5 * ramp.samples)
    longest = LONGEST * ramp.samples
    smooth = filtered(force[:stop], longest)
    length = float(SHORTEST)
    while length < longest:
        shorter = filtered(force[:stop], length)
        if np.std((shorter - smooth)[ramp.low : ramp.high]) < STEADY * smooth[start:].max():
            return float(shorter[start:].max())
        length *= 1.6
    return float(smooth[start:].max())


def peak_notes(ramp: Ramp, peak: float, force: Array) -> Iterator[str]:
    """A note where the record holds a force that is larger than the peak of the loading, beyond noise."""
    largest = float(median_filter(force, size=5, mode="nearest").max())
    scatter = float(np.std((force - ramp.force - np.median(force - ramp.force))[ramp.low : ramp.high]))
    if largest > (1 + OTHER) * peak + 4 * scatter:
        yield f"the largest force of the record, {largest:.4g} mN, is above the peak of the loading, {peak:.4g} mN"
