"""Checks of a record: dead and saturated channels, missing samples."""

from __future__ import annotations

import numpy as np

from indentfit.digits import quantity
from indentfit.errors import RecordError
from indentfit.experiment.loading import Ramp, longest_run
from indentfit.experiment.record import FEWEST, RawRecord

STUCK = 0.04  # share of the ramp during which a channel may read exactly its largest value
CLIPPED = 4  # samples of exactly the largest force in a record whose forces do not repeat
JUMP = 0.05  # share of the ramp's duration, or of its depth, that a gap may hide


def require_channels(record: RawRecord) -> None:
    """Refuse a record with too few samples, or with a channel that never changes.

    Parameters
    ----------
    record : RawRecord

    Raises
    ------
    RecordError
    """
    if record.time.size < FEWEST:
        raise RecordError(f"{record.name}: {record.time.size} rows of numbers; a record needs at least {FEWEST}")
    for name in ("displacement", "force"):
        values = getattr(record, name)
        if np.ptp(values) == 0:
            raise RecordError(f"{record.name}: the {name} is {values[0]:g} throughout; check the channel and its column")


def require_whole(ramp: Ramp) -> tuple[str, ...]:
    """Notes on a record that can be used.

    Parameters
    ----------
    ramp : Ramp

    Returns
    -------
    tuple of str

    Raises
    ------
    RecordError
        Samples of the loading are missing, or a sensor is at the end of its range.
    """
    _require_unsaturated(ramp)
    return (*_clipped(ramp.record), *_require_no_gap(ramp))


def _clipped(record: RawRecord) -> tuple[str, ...]:
    """A note where a force that else never repeats reads its largest value again and again: the sensor's range may end there."""
    force = record.force
    top = int(np.count_nonzero(force == force.max()))
    repeats = np.count_nonzero(np.diff(force[force < force.max()]) == 0)
    if top < CLIPPED or repeats > 0.02 * force.size:
        return ()
    largest = quantity(float(force.max()), "mN", 6)
    return (f"the force may be saturated: {top} samples read its largest value, {largest}; its peak may be cut off",)


def _require_unsaturated(ramp: Ramp) -> None:
    """Refuse a channel that repeats exactly its largest value while the other channel goes on: the sensor's range ends there."""
    record, part = ramp.record, slice(ramp.low, ramp.stop)
    for name, other in (("force", "displacement"), ("displacement", "force")):
        values = getattr(record, name)
        begin, end = longest_run(values[part] == values[: ramp.stop].max())
        if begin == end:
            continue
        moved = getattr(ramp, other)[part]
        share = (moved[end - 1] - moved[begin]) / np.ptp(moved)
        if end - begin > max(5, STUCK * ramp.samples) and share > STUCK:
            raise RecordError(
                f"{record.name}: the {name} is saturated: {end - begin} samples read {values[: ramp.stop].max():g} "
                f"{'mN' if name == 'force' else 'mm'} while the {other} rises; use a wider range, or remove the record"
            )


def _require_no_gap(ramp: Ramp) -> tuple[str, ...]:
    """Refuse a ramp in which samples are missing; note samples that are missing elsewhere."""
    record = ramp.record
    gaps = np.diff(record.time) - record.interval
    wide = gaps > 0.5 * record.interval
    inside = np.flatnonzero(wide[ramp.low : ramp.stop - 1]) + ramp.low
    if inside.size and (gaps[inside].max() > JUMP * ramp.duration or gaps[inside].sum() > 2 * JUMP * ramp.duration):
        worst = inside[np.argmax(gaps[inside])]
        raise RecordError(
            f"{record.name}: samples are missing in the ramp: {gaps[inside].sum():.3g} s of {ramp.duration:.3g} s; the longest "
            f"gap is after {record.time[worst]:.4g} s; repeat the record, or remove it"
        )
    _require_no_jump(ramp)
    if wide.any():
        return (f"samples are missing at {np.count_nonzero(wide)} places, {gaps[wide].sum():.3g} s in all",)
    return ()


def _require_no_jump(ramp: Ramp) -> None:
    """Refuse a displacement that jumps: samples are missing although the times have no gap."""
    record, steps = ramp.record, 5
    begin = max(0, ramp.low - steps)
    part = record.displacement[begin : ramp.stop]
    moved = part[steps:] - part[:-steps]
    beyond = np.abs(moved - np.median(moved))
    changes = np.abs(np.diff(part))
    resolution = float(changes[changes > 0].min(initial=np.inf))
    noise = max(1.4826 * float(np.median(beyond)), resolution if np.isfinite(resolution) else 0.0)
    worst = int(np.argmax(beyond))
    if beyond[worst] > max(8 * noise, JUMP * np.ptp(part)):
        raise RecordError(
            f"{record.name}: the displacement jumps by {quantity(float(moved[worst]), 'mm', 3)} within {steps} samples at "
            f"{record.time[begin + worst]:.4g} s: samples are missing or wrong, or the stage is far faster there; choose a part by "
            "record.times, repeat the record, or remove it"
        )
