"""What in a record contradicts the assumptions under which its contact point, zero and peak are computed, in notes.

The force is zero up to contact and rises by one law after it; both channels belong to the same moments; the sensor's range holds
all forces. A membrane before the tissue, a slip, a slow sensor, or one that reads no negative forces break these, and the
intervals of contact and peak do not know of it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.ndimage import median_filter, uniform_filter1d

from indentfit.arrays import Array
from indentfit.digits import quantity
from indentfit.experiment.contact_point import ContactPoint
from indentfit.experiment.loading import Ramp, noise_of

LATE, LATE_SIGMA = 0.03, 6.0  # share of the peak, and noises of a mean, by which a force rises after the displacement has stopped
ARRIVED = 0.002  # share of the depth within which the displacement is at its end
SIDE = 0.02  # share of the loading on each side of a jump
FEWEST = 5  # samples of such a side
JUMPS, JUMP_SIGMA = 0.04, 8.0  # share of the peak, and scatters, from which a jump of the force is told
EARLY, EARLY_SIGMA = 0.003, 6.0  # share of the peak, and scatters of means, by which the force before contact exceeds its zero
BEFORE = (0.03, 0.1)  # shares of the depth, of the stretches before contact that are looked at
BLOCKS = 6  # such stretches without contact that show the scatter of their means
RAIL, ALIKE = 0.1, 0.5  # share of the approach at the least force; share of distinct numbers among the others
MISSING = 0.01  # share of the depth from which a gap at contact counts


def contradictions(ramp: Ramp, contact: ContactPoint, depth: float, peak: float, radius: float | None) -> Iterator[str]:
    """One line for each assumption that a record contradicts.

    Parameters
    ----------
    ramp : Ramp
    contact : ContactPoint
    depth : float, mm
    peak : float, mN
    radius : float or None, mm
        Of a sphere.

    Returns
    -------
    iterator of str
    """
    above = ramp.record.force - contact.free(ramp.record.time, ramp.displacement)
    yield from _early(ramp, contact, above, depth, peak)
    yield from _rail(ramp, contact)
    yield from _jump(ramp, contact, above, peak)
    yield from _late(ramp, contact, above, depth, peak)
    if radius and depth > radius:
        yield (
            f"the indentation is {depth / radius:.3g} radii of the sphere deep, where Hertz's theory does not hold: check units "
            "and radius"
        )


def widened_by_gaps(ramp: Ramp, contact: ContactPoint, depth: float) -> tuple[ContactPoint, tuple[str, ...]]:
    """The contact point with an interval that holds every place among missing samples where it may lie, and a note on it."""
    record = ramp.record
    wide = np.flatnonzero(np.diff(record.time[: ramp.high]) > 1.5 * record.interval)
    begin, end = record.displacement[wide], record.displacement[wide + 1]  # the filtered ones are smeared over the gap
    low, high = contact.displacement - contact.uncertainty, contact.displacement + contact.uncertainty
    there = (begin < high) & (end > low) & (end - begin > MISSING * depth)
    if not there.any():
        return contact, ()
    begin, end = begin[there].min(), end[there].max()
    reach = max(contact.uncertainty, contact.displacement - float(begin), float(end) - contact.displacement)
    note = (
        f"samples are missing about contact, over {quantity(float(end - begin), 'mm', 3)}: the contact point may lie anywhere there"
    )
    return replace(contact, uncertainty=reach), (note,)


def _early(ramp: Ramp, contact: ContactPoint, above: Array, depth: float, peak: float) -> Iterator[str]:
    """A note where the force before the interval of the contact point is higher than without contact."""
    end = int(np.searchsorted(ramp.displacement[: contact.index], contact.displacement - contact.uncertainty))
    for share in BEFORE:
        begin = int(np.searchsorted(ramp.displacement[:end], contact.displacement - contact.uncertainty - share * depth))
        size = end - begin
        blocks = begin // size if size >= FEWEST else 0
        if blocks < BLOCKS:
            continue
        means = above[begin - blocks * size : begin].reshape(blocks, size).mean(axis=1)
        scatter = max(float(np.std(means, ddof=1)), contact.noise / np.sqrt(size))
        rise = float(above[begin:end].mean())
        if rise > EARLY * peak and rise > EARLY_SIGMA * scatter:
            yield (
                f"the force is higher by {rise / peak:.1%} of the peak before the contact point than without contact: a first, "
                f"softer contact may lie more than {quantity(share * depth, 'mm', 2)} before"
            )
            return


def _rail(ramp: Ramp, contact: ContactPoint) -> Iterator[str]:
    """A note where much of the approach reads exactly the least force, and the other samples are of no coarse converter."""
    force = ramp.record.force[: contact.index]
    if force.size < BLOCKS * FEWEST:
        return
    least = float(ramp.record.force.min())
    others = force[force > least]
    share = 1 - others.size / force.size
    if others.size and share > RAIL and np.unique(others).size > ALIKE * others.size:
        yield (
            f"{share:.0%} of the samples before contact read exactly {quantity(least, 'mN')}, the least force: the sensor's range "
            "may end there, and zero and contact may be wrong"
        )


def _jump(ramp: Ramp, contact: ContactPoint, above: Array, peak: float) -> Iterator[str]:
    """A note where the force jumps within the loading: the lines through both sides of a sample meet it at different forces."""
    force = median_filter(above[contact.index : ramp.stop], FEWEST, mode="nearest")
    side = max(FEWEST, round(SIDE * force.size))
    if force.size < 4 * side:
        return
    ends = np.arange(side) - (side - 1) / 2
    weights = 1 / side + ends * (side / 2) / np.sum(ends**2)  # of a line through a side, at its end
    left = np.convolve(force, weights[::-1], "valid")[: -side or None]
    right = np.convolve(force, weights, "valid")[side:]
    jumps = right - left
    scatter = 1.4826 * float(np.median(np.abs(jumps - np.median(jumps))))
    worst = int(np.argmax(np.abs(jumps)))
    if abs(jumps[worst]) > max(JUMPS * peak, JUMP_SIGMA * scatter):
        time = ramp.record.time[contact.index + worst + side]
        place = f"{time:.4g} s" if ramp.record.timed else f"row {time + 1:.0f}"
        yield (
            f"the force jumps by {jumps[worst] / peak:+.0%} of the peak at {place}, within the loading: a slip, a crack or a "
            "knock; the peak and what lies beyond may belong to another contact"
        )


def _late(ramp: Ramp, contact: ContactPoint, above: Array, depth: float, peak: float) -> Iterator[str]:
    """A note where the force goes on rising after the displacement has reached its end."""
    record = ramp.record
    noise = noise_of(record.displacement)
    end = contact.displacement + depth
    arrived = np.flatnonzero(record.displacement >= end - max(ARRIVED * depth, 2 * noise))
    if not arrived.size:
        return
    first = int(arrived[0])
    leaves = np.flatnonzero(record.displacement[first:] < end - 0.5 * depth)
    last = first + int(leaves[0]) if leaves.size else record.time.size
    size = max(FEWEST, round(0.2 * SIDE * ramp.samples))
    if last - first < 3 * size:
        return
    means = uniform_filter1d(above[first:last], size, mode="nearest")
    highest = int(np.argmax(means[size:-size])) + size
    rise = float(means[highest] - above[first : first + size].mean())
    moved = float(np.median(record.displacement[first + highest - size // 2 : first + highest + size // 2 + 1])) - end
    if moved > max(2 * ARRIVED * depth, 2 * noise) or rise < max(LATE * peak, LATE_SIGMA * contact.noise / np.sqrt(size)):
        return
    reached = int(np.argmax(means >= means[highest] - 0.1 * rise))
    lag = float(record.time[first + reached] - record.time[first])
    off = quantity(lag * abs(ramp.last.velocity), "mm", 2)
    yield (
        f"the force goes on rising by {rise / peak:.0%} of the peak for {lag:.2g} s after the displacement has stopped: the sensor "
        f"is slow, or the channels are apart in time, and contact and depth may be off by {off}"
    )
