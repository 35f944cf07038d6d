"""The raw records in a table of columns: each quantity's column is found, calibrated and converted to s, mm and mN."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from indentfit.arrays import Array, Ints
from indentfit.case import Record, RecordChannel
from indentfit.digits import quantity
from indentfit.errors import RecordError
from indentfit.experiment.formats.cantilever import with_force
from indentfit.experiment.formats.choice import (
    chosen_column,
    column_name,
    column_unit,
    deflection_column,
    named_column,
    other_travels,
    piezo_column,
    stage_column,
)  # fmt: skip
from indentfit.experiment.formats.stated import stated
from indentfit.experiment.formats.table import Table
from indentfit.experiment.formats.words import ALIASES, ELECTRIC, KIND, TARGETS, has_power, is_height, rank_of
from indentfit.experiment.record import CUT_OFF, FEWEST, RawRecord, Stated
from indentfit.units import unit_factor

FEWEST_READ = 20  # rows of numbers that are read at all; a record needs FEWEST
ALIKE = 0.9  # correlation of a deflection with the force that it measures
OF_CANTILEVERS = ("nN", "pN")  # units of forces that only the bending of a cantilever measures
SMALL = 1e-3  # mN: forces of a range below it are measured in the same way, in whatever unit
FLAT = 0.05  # share of the rise of a force that stays at first
TRAVEL = 2  # rank of the first words (`words.WORDS`) that name the travel of a stage, and not an indentation


@dataclass(frozen=True)
class _Source:
    """A table with its file, its settings, and what its lines of text state."""

    path: Path
    table: Table
    settings: Record
    stated: Stated

    def label(self, place: int) -> str:
        return column_name(self.table, place)


@dataclass(frozen=True, eq=False)
class _Taken:
    """The values (n,) of a quantity, in words where they come from, and what deserves a look."""

    values: Array
    words: str
    notes: tuple[str, ...] = ()


def records(path: Path, table: Table, settings: Record) -> list[RawRecord]:
    """The raw records in a table: several where its time begins anew.

    Columns and units that the settings do not name follow from the header. Rows without numbers are left out, with a note.

    Parameters
    ----------
    path : path
        The file of the table: the name of the record.
    table : Table
    settings : Record
        The [record] table: columns, calibration and sampling rate.

    Returns
    -------
    list of RawRecord

    Raises
    ------
    RecordError
        The table is not a record. The error's text is one line with the file, what is wrong and the remedy.
    """
    _require_rows(path, len(table.values))
    known = stated(table.above)
    source = _Source(path, with_force(table, known, settings), settings, known)
    travel = _travel(source)
    force = _force(source)
    displacement = _displacement(source, travel, force.values)
    time = _time(source)
    columns = np.array([time.values, displacement.values, force.values])
    good = np.isfinite(columns).all(axis=0)
    _require_rows(path, int(np.count_nonzero(good)))
    left_out = () if good.all() else (f"{np.count_nonzero(~good):,} rows without numbers were left out",)
    notes = table.notes + left_out + _cut_off(source, len(table.values)) + displacement.notes + force.notes + time.notes
    words = f"time {time.words}, displacement {displacement.words}, force {force.words}"
    whole = _Whole(columns[:, good], np.flatnonzero(good), _stages(source), notes, words)
    return [_record(source, whole, begin, end) for begin, end in _tests(source, whole)]


def _require_rows(path: Path, rows: int) -> None:
    if rows < FEWEST_READ:
        raise RecordError(
            f"{path}: {rows} rows of numbers; a record needs at least {FEWEST} (a curve of fewer points, counted from contact, "
            "needs no processing: name it as the curve of a test in a case)"
        )


def _cut_off(source: _Source, rows: int) -> tuple[str, ...]:
    """A note where the header tells of clearly more samples than the table has rows."""
    told = source.stated.samples
    return (f"{CUT_OFF}{told} points, and {rows} rows follow: the file is cut off",) if told and rows < 0.9 * told else ()


@dataclass(frozen=True, eq=False)
class _Whole:
    """All rows of a table: channels (3, n), their rows in the table (n,), their stages, the notes, and what was taken."""

    channels: Array
    rows: Ints
    stages: list[str] | None
    notes: tuple[str, ...]
    words: str


def _record(source: _Source, whole: _Whole, begin: int, end: int) -> RawRecord:
    """The record of the rows from `begin` to `end`, its times from 0 and each above the last."""
    time, displacement, force = whole.channels[:, begin:end]
    time, repeated = _spread(time - time[0])
    notes = whole.notes if begin == 0 else ()
    if repeated:
        notes = (*notes, f"{repeated:,} times are given twice and were spread evenly")
    stages = None if whole.stages is None else tuple(whole.stages[row] for row in whole.rows[begin:end])
    displacement, force, turned = _signed(source.settings, displacement, force)
    timed = source.settings.rate != "unknown" and not (source.settings.rate is None and whole.words.startswith("time of rows"))
    return RawRecord(time, displacement, force, str(source.path), notes + turned, whole.words, source.stated, stages, timed)


def _tests(source: _Source, whole: _Whole) -> list[tuple[int, int]]:
    """Begin and end of each test in a table: a time that falls back to its beginning begins another test."""
    time = whole.channels[0]
    back = np.flatnonzero(np.diff(time) < 0) + 1
    edges = [0, *map(int, back), time.size]
    pieces = list(pairwise(edges))
    interval = float(np.median(np.abs(np.diff(time))))
    if back.size and (min(end - begin for begin, end in pieces) < FEWEST or (time[back] > time[0] + 2 * interval).any()):
        n = int(back[0])
        row = source.table.first + int(whole.rows[n])
        raise RecordError(f"{source.path}: row {row}: the time {time[n]:g} s comes after {time[n - 1]:g} s; check record.time")
    if np.ptp(time) == 0:
        raise RecordError(f"{source.path}: the time is {time[0]:g} s throughout; check record.time")
    return pieces


def _spread(time: Array) -> tuple[Array, int]:
    """Times (n,) with those that repeat spread evenly up to the next, and how many repeat."""
    first = np.append(True, np.diff(time) > 0)
    if first.all():
        return time, 0
    starts = np.flatnonzero(first)
    step = float(np.median(np.diff(time[starts]))) if starts.size > 1 else 1.0
    counts = np.diff(np.append(starts, time.size))
    last = time[starts[-1]] + step * counts[-1] / max(float(np.median(counts)), 1.0)
    places = np.append(starts, time.size)
    return np.interp(np.arange(time.size), places, np.append(time[starts], last)), int(np.count_nonzero(~first))


def _signed(settings: Record, displacement: Array, force: Array) -> tuple[Array, Array, tuple[str, ...]]:
    """Displacement and force positive in compression: both are turned where the file counts both as in tension."""
    given = {"sign", "gain"} & (settings.displacement.model_fields_set | settings.force.model_fields_set)
    rest = float(np.median(force[: max(3, force.size // 50)]))
    down, up = rest - float(force.min()), float(force.max()) - rest
    if not given and _rises_against_the_travel(displacement, force - rest, up, down):
        return -displacement, force, ("the displacement falls while the force rises: its sign was turned",)
    if given or down < 4 * max(up, 0.0) or down < 4 * max(rest, 0.0):
        return displacement, force, ()
    deepest = int(np.argmin(force))
    if displacement[deepest] >= displacement[0] - 0.25 * np.ptp(displacement):
        return displacement, force, ()
    return -displacement, -force, ("force and displacement fall under load, as testers count compression: both signs were turned",)


def _rises_against_the_travel(displacement: Array, force: Array, up: float, down: float) -> bool:
    """Whether a force that stays at first, and then rises, does so while the displacement falls: that counts away from the sample.

    A retraction whose force counts the other way round begins with its largest changes, and is none of these.
    """
    deepest, travel = int(np.argmax(force)), float(np.ptp(displacement))
    if up < 4 * max(down, 0.0) or deepest < FEWEST_READ or displacement[deepest] > displacement.min() + 0.1 * travel:
        return False
    approach = displacement[0] - displacement[: deepest + 1]
    early = approach < 0.2 * approach[-1]
    stays = float(np.median(np.abs(force[: deepest + 1][early])))
    return bool(displacement[0] >= displacement.max() - 0.1 * travel and stays < FLAT * up and approach[-1] > 0.5 * travel)


# Which column, and which unit


def _force(source: _Source) -> _Taken:
    place = chosen_column(source.path, source.table, "force", source.settings.force)
    values, unit = _calibrated(source, place, "force", source.settings.force)
    return _Taken(values, f"{source.label(place)!r}{_in(source, place, unit)}")


@dataclass(frozen=True, eq=False)
class _Travel:
    """The travel of the indenter: its column, the column that was subtracted from it, its values (n,), mm, and words for them."""

    place: int
    minus: int | None
    values: Array
    words: str


def _travel(source: _Source) -> _Travel:
    """The travel of a column, less the deflection of a cantilever where the file or the settings have one."""
    channel, piezo, deflection = source.settings.displacement, piezo_column(source.table), deflection_column(source.table)
    place, minus = piezo, deflection
    if channel.column is not None or channel.minus is not None or place is None or minus is None:
        place = chosen_column(source.path, source.table, "displacement", channel)
        minus = None
    if channel.minus is not None:
        minus = named_column(source.path, source.table, "record.displacement.minus", channel.minus)
    _require_apart(source, place)
    minus = _bends(source, place) if minus is None and channel.column is None else minus
    values, unit = _calibrated(source, place, "displacement", _facing(source, place))
    words = f"{source.label(place)!r}{_in(source, place, unit)}"
    if minus is not None:
        values = values - _calibrated(source, minus, "displacement", RecordChannel())[0]
        words += f" minus {source.label(minus)!r}"
    return _Travel(place, minus, values, words)


def _bends(source: _Source, place: int) -> int | None:
    """The deflection of a cantilever beside its height, where it rises with the force; None where it does not, or there is none."""
    deflection, table = deflection_column(source.table), source.table
    told = (source.settings.stiffness, source.settings.compliance, source.stated.stiffness) != (None, None, None)
    if deflection is None or told or not any(map(is_height, table.labels(place))) or _is_indentation(source, place):
        return None
    force = table.values[:, chosen_column(source.path, table, "force", source.settings.force)]
    good = np.isfinite(force) & np.isfinite(table.values[:, deflection])
    alike = np.corrcoef(force[good], table.values[good, deflection])[0, 1] if np.ptp(force[good]) else 0.0
    return deflection if alike > ALIKE else None


def _is_indentation(source: _Source, place: int) -> bool:
    """Whether a column is named as the indentation itself, or the separation of tip and sample."""
    ranks = [rank[0] for label in source.table.labels(place) if (rank := rank_of(label, "displacement"))]
    return bool(ranks) and min(ranks) == 0


def _displacement(source: _Source, travel: _Travel, force: Array) -> _Taken:
    """The displacement of the indenter into the sample: its travel less what the instrument gives way."""
    stiffness = _stiffness(source, travel)
    values, bent = _unbent(source, travel, force, stiffness)
    notes = () if stiffness else tuple(_travel_notes(source, travel))
    return _Taken(values, travel.words + bent, (*notes, *_other_travels(source, travel)))


def _other_travels(source: _Source, travel: _Travel) -> Iterator[str]:
    """A note where the file has travels of two sensors, of which nobody chose one."""
    if source.settings.displacement.column is not None or travel.minus is not None:
        return
    others = [source.label(n) for n in other_travels(source.table, travel.place)]
    if others:
        yield (
            f"{', '.join(map(repr, others))} moves otherwise than {source.label(travel.place)!r}, which was taken: give "
            "record.displacement.column, the sensor that is nearest to the sample"
        )


def _require_apart(source: _Source, place: int) -> None:
    if place == chosen_column(source.path, source.table, "force", source.settings.force):
        raise RecordError(f"{source.path}: displacement and force are the same column {place + 1}; give record.force.column")


def _facing(source: _Source, place: int) -> RecordChannel:
    """The channel of the displacement; a height or gap falls toward the sample: its sign is turned unless the settings give one."""
    channel = source.settings.displacement
    if any(map(is_height, source.table.labels(place))) and "sign" not in channel.model_fields_set and _falls(source, place):
        return channel.model_copy(update={"sign": -1})
    return channel


def _falls(source: _Source, place: int) -> bool:
    """Whether a height is small where the force is largest; some programs count it the other way round."""
    force = source.table.values[:, chosen_column(source.path, source.table, "force", source.settings.force)]
    height = source.table.values[:, place]
    good = np.isfinite(height) & np.isfinite(force)
    if not good.any():
        return True
    sign = -1 if source.settings.force.sign < 0 else 1
    there = float(height[good][np.argmax(sign * force[good])])
    return there <= (float(height[good].min()) + float(height[good].max())) / 2


def _stiffness(source: _Source, travel: _Travel) -> float | None:
    """Stiffness, mN/mm, of the cantilever or load cell that is subtracted: that of the settings, or of the file for a travel."""
    if travel.minus is not None:
        return None
    if source.settings.stiffness is None and source.settings.compliance is None and _is_travel(source, travel.place):
        return source.stated.stiffness
    return source.settings.stiffness


def _unbent(source: _Source, travel: _Travel, force: Array, stiffness: float | None) -> tuple[Array, str]:
    """The travel less what cantilever, load cell and frame give way, and that in words."""
    settings, words, values = source.settings, "", travel.values
    if stiffness is not None:
        values, words = values - force / stiffness, f" minus force / {stiffness:.4g} mN/mm"
    if settings.compliance is not None:
        values, words = values - force * settings.compliance, f"{words} minus force * {settings.compliance:.4g} mm/mN"
    return values, words


def _is_travel(source: _Source, place: int) -> bool:
    """Whether a column is named as the travel of a piezo or a stage."""
    ranks = [rank for label in source.table.labels(place) if (rank := rank_of(label, "displacement"))]
    return bool(ranks) and min(ranks)[0] > TRAVEL


def _travel_notes(source: _Source, travel: _Travel) -> Iterator[str]:
    """Notes where the bending of a cantilever is not subtracted from a travel: that of a column, or one that was not stated."""
    place, deflection = travel.place, deflection_column(source.table)
    indentation = _is_indentation(source, place)
    if deflection is not None and travel.minus is None and not indentation:
        yield (
            f"the file has a column {source.label(deflection)!r} that is not subtracted from {source.label(place)!r}: the travel "
            "is more than the indentation; give record.displacement.minus"
        )
    elif deflection is None and not indentation and source.settings.compliance is None and (small := _of_a_cantilever(source)):
        yield (
            f"forces {small} are measured by what a cantilever bends, and {source.label(place)!r} may hold that "
            "bending: give record.stiffness, the cantilever's spring constant; no need where the column is the indentation itself"
        )


def _of_a_cantilever(source: _Source) -> str:
    """How small the forces are, in words, where only the bending of a cantilever measures such; empty where they are larger."""
    if _force_unit(source) in OF_CANTILEVERS:
        return f"in {_force_unit(source)}"
    force = _calibrated(
        source, chosen_column(source.path, source.table, "force", source.settings.force), "force", source.settings.force
    )
    return f"below {quantity(SMALL, 'mN')}" if np.nanmax(force[0]) - np.nanmin(force[0]) < SMALL else ""


def _force_unit(source: _Source) -> str | None:
    channel = source.settings.force
    return channel.unit or column_unit(source.table, chosen_column(source.path, source.table, "force", channel))


def _in(source: _Source, place: int, unit: str) -> str:
    told = column_unit(source.table, place) == unit and not any(map(has_power, source.table.labels(place)))
    return "" if told else f" in {unit}"


def _calibrated(source: _Source, place: int, name: str, channel: RecordChannel) -> tuple[Array, str]:
    """The values of a column in mm, mN or s, and the unit that they were in."""
    target, path = TARGETS[name], source.path
    unit = channel.unit or (target if channel.gain is not None else column_unit(source.table, place))
    if unit is None and name == "time" and source.table.clock:
        unit = "s"
    if unit is None:
        powers = [label for label in source.table.labels(place) if has_power(label)]
        why = f"{powers[0]!r} can mean two units" if powers else f"the header does not give the unit of the {name}"
        raise RecordError(f"{path}: {why}; give record.{name}.unit, such as {target!r}{', and its gain' if powers else ''}")
    if unit in ELECTRIC:
        raise RecordError(f"{path}: the {name} is in {unit}; give record.{name}.gain, {target} per {unit}")
    if unit == "step":
        raise RecordError(f"{path}: the {name} is in steps; give record.{name}.gain, {target} per step")
    values = channel.sign * (1.0 if channel.gain is None else channel.gain) * source.table.values[:, place] + channel.offset
    try:
        return values * unit_factor(ALIASES.get(unit, unit), target), unit
    except ValueError as error:
        raise RecordError(f"{path}: record.{name}.unit {error}") from None


def _time(source: _Source) -> _Taken:
    """Times of the rows, s, from the first: by the sampling rate, or by a column, or counted."""
    table, settings, path = source.table, source.settings, source.path
    rows = np.arange(len(table.values), dtype=float)
    if isinstance(settings.rate, float):
        return _Taken(rows / settings.rate, f"by {settings.rate:g} Hz")
    told = any(rank_of(label, "time") for place in range(table.width) for label in table.labels(place))
    told = told or any(_is_clock(table, place) for place in range(table.width))
    if settings.rate == "unknown" or (settings.time.column is None and not told and stage_column(table) is not None):
        note = "the file has no times: rows are counted in place of seconds, so that velocities and relaxation times mean nothing"
        return _Taken(rows, "of rows, counted", (note,))
    if settings.time.column is None and not told and source.stated.rate is not None:
        return _Taken(rows / source.stated.rate, f"by {source.stated.rate:.6g} Hz, as the file states")
    if settings.time.column is None and not told:
        raise RecordError(
            f'{path}: no column of time and no sampling rate; give record.rate in Hz (or "unknown"), or record.time.column'
        )
    place = chosen_column(path, table, "time", settings.time)
    time, unit = _calibrated(source, place, "time", settings.time)
    if not np.isfinite(time).any():
        raise RecordError(f"{path}: the column of time holds no numbers; give record.rate in Hz, or record.time.column")
    return _Taken(time - time[np.isfinite(time)][0], f"{source.label(place)!r}{_in(source, place, unit)}")


def _is_clock(table: Table, place: int) -> bool:
    """Whether a column that no known word names has a unit of time and rises from row to row."""
    values = table.values[:, place]
    values = values[np.isfinite(values)]
    rises = values.size > FEWEST_READ and bool((np.diff(values) >= 0).all()) and values[-1] > values[0]
    return rises and KIND.get(column_unit(table, place) or "") == "time"


def _stages(source: _Source) -> list[str] | None:
    """The stage of each row, where the table has a column of them."""
    place = stage_column(source.table)
    if place is None:
        return None
    if place in source.table.texts:
        return list(source.table.texts[place])
    return [f"{value:g}" for value in source.table.values[:, place]]
