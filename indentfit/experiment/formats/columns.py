"""The raw record in a table of columns: each quantity's column is found, calibrated and converted to s, mm and mN."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from indentfit.arrays import Array
from indentfit.case import Record, RecordChannel
from indentfit.errors import RecordError
from indentfit.experiment.formats.table import Table
from indentfit.experiment.record import FEWEST, RawRecord
from indentfit.units import unit_factor

TARGETS = {"time": "s", "displacement": "mm", "force": "mN"}
WORDS = {  # vendors' headers begin with these
    "time": ("time", "zeit", "temps", "时间", "t"),
    "displacement": ("displacement", "disp", "position", "extension", "stroke", "indentation", "weg", "位移"),
    "force": ("force", "load", "kraft", "力", "载荷"),
}
LENGTHS = ("nm", "um", "µm", "μm", "mm", "cm", "m", "in")
FORCES = ("uN", "µN", "μN", "mN", "cN", "N", "kN", "gf", "kgf", "lbf")
TIMES = ("ms", "s", "min")
ELECTRIC = ("V", "mV")
UNITS = (*LENGTHS, *FORCES, *TIMES, *ELECTRIC)
ALIASES = {"g": "gf", "kg": "kgf", "sec": "s", "μm": "um", "µm": "um", "μN": "uN", "µN": "uN"}
LONGEST_LIST = 300  # letters of the columns that a message lists


def raw_record(path: Path, table: Table, settings: Record) -> RawRecord:
    """The `RawRecord` in a table.

    Columns and units that the settings do not name follow from the header. Rows without numbers are left out, with a note.

    Parameters
    ----------
    path : path
        The file of the table: the name of the record.
    settings : Record
        The [record] table: columns, calibration and sampling rate.

    Returns
    -------
    RawRecord

    Raises
    ------
    RecordError
        The table is not a record. The error's text is one line with the file, what is wrong and the remedy.
    """
    places = {name: _column(path, table, name, channel) for name, channel in _channels(settings).items()}
    if places["displacement"] == places["force"]:
        raise RecordError(f"{path}: displacement and force are the same column {places['force'] + 1}; give record.force.column")
    time = _time(path, table, settings)
    measured = [_calibrated(path, table, places[name], name, channel) for name, channel in _channels(settings).items()]
    columns = np.array([time, *measured])
    good = np.isfinite(columns).all(axis=0)
    if np.count_nonzero(good) < FEWEST:
        raise RecordError(f"{path}: {np.count_nonzero(good)} rows of numbers; a record needs at least {FEWEST}")
    _require_rising_time(path, table, columns[0, good])
    left_out = () if good.all() else (f"{np.count_nonzero(~good):,} rows without numbers were left out",)
    seconds, displacement, force = columns[:, good]
    return RawRecord(seconds, displacement, force, str(path), table.notes + left_out)


def _channels(settings: Record) -> dict[str, RecordChannel]:
    return {"displacement": settings.displacement, "force": settings.force}


def _require_rising_time(path: Path, table: Table, time: Array) -> None:
    back = np.flatnonzero(np.diff(time) <= 0)
    if back.size:
        n = int(back[0]) + 1
        raise RecordError(f"{path}: row {table.first + n}: the time {time[n]:g} s comes after {time[n - 1]:g} s; check record.time")


# Which column


def _column(path: Path, table: Table, name: str, channel: RecordChannel) -> int:
    """Index of the column of a quantity: the settings give the column's name or number, or it follows from the header."""
    if isinstance(channel.column, int):
        return _numbered(path, table, name, channel.column)
    matches = [n for n in range(table.width) if any(_names(label, name, channel.column) for label in table.labels(n))]
    if len(matches) == 1:
        return matches[0]
    count = str(len(matches) or "no")
    what = f"record.{name}.column = {channel.column!r}: {count} such columns" if channel.column else f"{count} columns of {name}"
    raise RecordError(f"{path}: {what}; give record.{name}.column, a name or a number of: {_listed(table)}")


def _numbered(path: Path, table: Table, name: str, number: int) -> int:
    if 1 <= number <= table.width:
        return number - 1
    raise RecordError(f"{path}: record.{name}.column = {number}: the file has {table.width} columns, counted from 1")


def _names(label: str, name: str, wanted: str | None) -> bool:
    """Whether a label is the wanted label, with or without its unit; where none is wanted, whether it begins like the quantity."""
    if wanted is None:
        return _begins(label, WORDS[name])
    return wanted.casefold().strip() in (label.casefold(), _without_unit(label).casefold())


def _begins(label: str, words: tuple[str, ...]) -> bool:
    first = re.split(r"[\W\d_]+", label.strip().casefold(), maxsplit=1)[0]
    return any(first == word or (len(word) > 1 and first.startswith(word)) for word in words)


def _without_unit(label: str) -> str:
    return re.sub(r"\s*[\[(（].*?[\])）]\s*$", "", label).strip()


def _listed(table: Table) -> str:
    """The columns with their numbers and labels, for a message."""
    listed = "; ".join(f"{n + 1}: {' '.join(reversed(table.labels(n))) or 'no header'}" for n in range(table.width))
    return listed if len(listed) <= LONGEST_LIST else f"{listed[: LONGEST_LIST - 3]}..."


# Which unit


def _calibrated(path: Path, table: Table, place: int, name: str, channel: RecordChannel) -> Array:
    """The values of a column in mm, mN or s."""
    target = TARGETS[name]
    unit = channel.unit or (target if channel.gain is not None else _unit(table, place))
    if unit is None:
        raise RecordError(f"{path}: the header does not give the unit of the {name}; give record.{name}.unit, such as {target!r}")
    if unit in ELECTRIC:
        raise RecordError(f"{path}: the {name} is in {unit}; give record.{name}.gain, {target} per {unit}")
    values = channel.sign * (1.0 if channel.gain is None else channel.gain) * table.values[:, place] + channel.offset
    try:
        return values * unit_factor(ALIASES.get(unit, unit), target)
    except ValueError as error:
        raise RecordError(f"{path}: record.{name}.unit {error}") from None


def _unit(table: Table, place: int) -> str | None:
    """The unit that a column's header gives: in brackets, after an underline, comma or slash, or in a row of its own."""
    for label in table.labels(place):
        in_brackets = re.findall(r"[\[(（]\s*([^\])）]*?)\s*[\])）]", label)
        at_the_end = re.findall(r"(?:_|,\s*|/\s*|\s)([^\W\d]+)$", label)
        for text in (*in_brackets, *at_the_end, label):
            unit = ALIASES.get(text, text)
            if unit in UNITS:
                return unit
    return None


def _time(path: Path, table: Table, settings: Record) -> Array:
    """Times of the rows, s, from the first: by the sampling rate, or by a column."""
    if settings.rate is not None:
        return np.arange(len(table.values)) / settings.rate
    told = any(_begins(label, WORDS["time"]) for place in range(table.width) for label in table.labels(place))
    if settings.time.column is None and not told:
        raise RecordError(f"{path}: no column of time and no sampling rate; give record.rate in Hz, or record.time.column")
    time = _calibrated(path, table, _column(path, table, "time", settings.time), "time", settings.time)
    if not np.isfinite(time).any():
        raise RecordError(f"{path}: the column of time holds no numbers; give record.rate in Hz, or record.time.column")
    return time - time[np.isfinite(time)][0]
