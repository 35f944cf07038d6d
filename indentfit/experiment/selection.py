"""The part of a record that is processed: rows, times, a segment, a loading cycle."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np

from indentfit.arrays import Array
from indentfit.case import Record
from indentfit.errors import RecordError
from indentfit.experiment.loading import noise_of
from indentfit.experiment.record import RawRecord

TURN = 0.1  # share of the travel by which the stage must go back before a turn counts
CYCLE = 0.3  # share of the travel that a loading cycle covers
RISE, CLEAR = 0.03, 8.0  # share of the force, and noises, by which the force rises in a loading cycle: first cycles may be small
REACHED = 0.8  # share of the largest force that the cycle reaches which is taken by default
UNEVEN = 0.05  # share of the steps in time that differ by half from the median, from which on sampling is uneven
MOST_FACTOR = 4  # an uneven record is interpolated at no more than so many times its samples


def selected(record: RawRecord, settings: Record) -> RawRecord:
    """The part of a record that the settings choose, at even steps of time.

    Parameters
    ----------
    record : RawRecord
    settings : Record
        rows, times, segment, cycle.

    Returns
    -------
    RawRecord
        With a note on what was left out.

    Raises
    ------
    RecordError
        There is no such part.
    """
    if settings.rows is not None:
        record = _rows(record, settings.rows)
    if settings.times is not None:
        record = _times(record, settings.times)
    if settings.segment is not None:
        record = _segment(record, settings.segment)
    return _cycle(_even(_reversed(record)), settings.cycle)


def _rows(record: RawRecord, rows: tuple[int, int]) -> RawRecord:
    if rows[0] > record.time.size:
        raise RecordError(f"{record.name}: record.rows begins at {rows[0]}; the record has {record.time.size} rows")
    return record.part(slice(rows[0] - 1, rows[1]))


def _times(record: RawRecord, times: tuple[float, float]) -> RawRecord:
    inside = (record.time >= times[0]) & (record.time <= times[1])
    if not inside.any():
        raise RecordError(f"{record.name}: no sample between {times[0]:g} and {times[1]:g} s (record.times)")
    return record.part(inside)


def _segment(record: RawRecord, segment: int | str) -> RawRecord:
    """The samples of a stage of the file, or the loading or the unloading by motion."""
    wanted = str(segment).strip().casefold()
    if record.stages is not None:
        inside = np.array([stage.casefold() == wanted for stage in record.stages])
        if inside.any():
            return record.part(inside)
    deepest = int(np.argmax(record.displacement))
    if wanted in ("approach", "loading"):
        return record.part(slice(0, deepest + 1))
    if wanted in ("retract", "unloading"):
        back = record.part(slice(deepest, None))
        time = back.time[-1] - back.time[::-1]
        note = "the unloading is read backwards, from free to contact"
        turned = replace(back, time=time, displacement=back.displacement[::-1], force=back.force[::-1], stages=None)
        return replace(turned, notes=(*back.notes, note))
    known = ", ".join(dict.fromkeys(record.stages)) if record.stages else 'none; "approach" and "retract" go by motion'
    raise RecordError(f"{record.name}: record.segment = {segment!r}: no such segment; the file's segments are {known[:200]}")


def _reversed(record: RawRecord) -> RawRecord:
    """A record without times whose rows go from contact to free, in the order of loading."""
    displacement, force = record.displacement, record.force
    some = max(3, force.size // 20)
    falls = np.median(force[:some]) > np.median(force[-some:]) + 0.5 * np.ptp(force)
    if record.timed or not falls or np.median(displacement[:some]) < np.median(displacement[-some:]) + 0.5 * np.ptp(displacement):
        return record
    stages = None if record.stages is None else record.stages[::-1]
    note = "the rows go from contact to free and were read backwards"
    return replace(record, displacement=displacement[::-1], force=force[::-1], stages=stages, notes=(*record.notes, note))


def _even(record: RawRecord) -> RawRecord:
    """The record at even steps of time, where its samples are uneven: a few gaps in even samples are left to other checks."""
    steps = np.diff(record.time)
    if record.time.size < 3 or np.mean(np.abs(steps - np.median(steps)) > 0.5 * np.median(steps)) < UNEVEN:
        return record
    duration = float(record.time[-1] - record.time[0])
    count = int(min(MOST_FACTOR * record.time.size, max(record.time.size, duration / max(np.quantile(steps, 0.2), 1e-12))))
    time = np.linspace(record.time[0], record.time[-1], count + 1)
    channels = {name: np.interp(time, record.time, getattr(record, name)) for name in ("displacement", "force")}
    nearest = np.clip(np.searchsorted(record.time, time), 0, record.time.size - 1)
    stages = None if record.stages is None else tuple(record.stages[n] for n in nearest)
    taken = f"{record.taken}; uneven times, interpolated at {count / duration:.4g} Hz".removeprefix("; ")
    return replace(record, time=time, **channels, stages=stages, taken=taken, uneven=record)


def _cycle(record: RawRecord, cycle: int | str | None) -> RawRecord:
    """One loading cycle with its unloading: the chosen one, or the first that reaches 80 % of the largest force, with a note."""
    loadings = loading_cycles(record)
    if isinstance(cycle, int) and cycle > max(1, len(loadings)):
        raise RecordError(f"{record.name}: record.cycle = {cycle}: the record has {len(loadings)} loading cycles")
    if len(loadings) < 2:
        return record
    rest = float(np.median(record.force[: max(3, record.force.size // 50)]))
    rises = [float(record.force[begin : end + 1].max()) - rest for begin, end in loadings]
    first = next(n for n, rise in enumerate(rises) if rise >= REACHED * max(rises))
    number = first if cycle is None else len(loadings) - 1 if cycle == "last" else int(cycle) - 1
    begin = 0 if number == 0 else loadings[number][0]
    end = loadings[number + 1][0] if number + 1 < len(loadings) else record.time.size
    note = f"the record has {len(loadings)} loading cycles; number {number + 1} is used (record.cycle)" if cycle is None else ""
    return record.part(slice(begin, end), note)


def loading_cycles(record: RawRecord) -> list[tuple[int, int]]:
    """First and last sample of each loading: the stage goes forward over a good part of its travel, and the force rises."""
    displacement, force = record.displacement, record.force
    turns = turning_points(displacement, max(TURN * float(np.ptp(displacement)), 6 * noise_of(displacement)))
    forward = [(a, b) for a, b in pairwise(turns) if displacement[b] > displacement[a]]
    travel, rise = CYCLE * float(np.ptp(displacement)), max(RISE * float(np.ptp(force)), CLEAR * noise_of(force))
    return [(a, b) for a, b in forward if displacement[b] - displacement[a] > travel and np.ptp(force[a : b + 1]) > rise]


def turning_points(values: Array, least: float) -> list[int]:
    """Indices where values turn by more than `least`, with the first and the last index."""
    turns, low, high, direction = [0], 0, 0, 0
    known: list[float] = values.tolist()  # single numbers of an array take ten times as long
    for n, value in enumerate(known):
        low, high = (n if value < known[low] else low), (n if value > known[high] else high)
        if direction != 1 and value - known[low] > least:
            turns, direction, high = [*turns, low], 1, n
        elif direction != -1 and known[high] - value > least:
            turns, direction, low = [*turns, high], -1, n
        elif direction == 1 and high == n:
            low = n
        elif direction == -1 and low == n:
            high = n
    last = [high] if direction == 1 else [low] if direction == -1 else []
    return sorted({*turns, *last, values.size - 1})
