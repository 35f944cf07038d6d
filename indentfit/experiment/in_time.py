"""The curve of a raw record with times: its ramp and its hold, as averages of samples.

The ramp is averaged over equal steps of time, the hold over steps in proportion to the time since the ramp's end, so that a decay
over many decades has as many points in each. What follows a hold, such as the retraction, is left out.
"""

from __future__ import annotations

import numpy as np

from indentfit.arrays import Array, Ints
from indentfit.case import Record
from indentfit.curve import MIN_POINTS, Curve
from indentfit.errors import RecordError
from indentfit.experiment.processed import ProcessedRecord
from indentfit.motion import HELD

RETRACTS = "the record goes on after its {kept}, with a motion that is left out: {seconds:.3g} s of {whole:.3g} s are fitted"


def curve_in_time(known: ProcessedRecord, settings: Record) -> Curve:
    """The `Curve` of a record with the times of its points.

    Parameters
    ----------
    known : ProcessedRecord
    settings : Record
        It gives the number of points of the ramp, and of the hold.

    Returns
    -------
    Curve

    Raises
    ------
    RecordError
        The record has no times.
    """
    record, contact, stop = known.record, known.contact, known.ramp.stop
    if not record.timed:
        raise RecordError(f"{record.name}: has no times, which a material that relaxes needs; give record.rate")
    start, end = contact.index, _end_of_hold(known)
    depth = record.displacement - contact.displacement
    force = record.force - contact.free(record.time, known.ramp.displacement)
    cut = start + known.displacement.size  # limits of depth or force end the curve there
    ends = [_even(record.time, start, min(cut, stop), settings.points)]
    if cut >= stop and end > stop + 1:
        ends.append(_growing(record.time, stop, end, settings.points))
    first, counts = _bins(np.concatenate(ends), ends[-1][-1])
    time, depth, force = (np.add.reduceat(values[: ends[-1][-1]], first) / counts for values in (record.time, depth, force))
    deep = depth > 0
    if np.count_nonzero(deep) < MIN_POINTS:
        raise RecordError(
            f"{record.name}: fewer than {MIN_POINTS} averages lie below the contact point; record.points may be larger"
        )
    notes, last = tuple[str, ...](), record.time.size
    if cut >= stop and last - end > 0.02 * (last - start):
        kept = "hold" if end > stop + 1 else "ramp"
        notes = (RETRACTS.format(kept=kept, seconds=record.time[end - 1] - record.time[start], whole=np.ptp(record.time[start:])),)
    return Curve(depth[deep], force[deep], notes, known.curve.contact, time=time[deep])


def _end_of_hold(known: ProcessedRecord) -> int:
    """The first sample after the hold; the end of the ramp where no hold follows."""
    ramp = known.ramp
    deepest = float(np.median(ramp.displacement[ramp.stop - 1 : ramp.stop + max(ramp.length, 1)]))
    allowed = 2 * HELD * (deepest - known.contact.displacement)
    left = np.abs(ramp.displacement[ramp.stop :] - deepest) > allowed
    return ramp.stop + (int(np.argmax(left)) if left.any() else left.size)


def _even(time: Array, start: int, stop: int, points: int) -> Ints:
    """Numbers of samples that bound averages over equal steps of time; the last is `stop`."""
    return np.append(np.searchsorted(time, np.linspace(time[start], time[stop - 1], points + 1)[:-1]), stop)


def _growing(time: Array, start: int, stop: int, points: int) -> Ints:
    """Numbers of samples that bound averages over steps in proportion to the time since the start; the last is `stop`."""
    since = time[start:stop] - time[start - 1]
    return np.append(start + np.searchsorted(since, np.geomspace(since[0], since[-1], points + 1)[:-1]), stop)


def _bins(bounds: Ints, stop: int) -> tuple[Ints, Ints]:
    """First samples and numbers of samples of averages that are not empty."""
    first = np.unique(bounds[bounds < stop])
    return first, np.diff(np.append(first, stop))
