"""A lab's file into a `RawRecord`: the columns found, calibrated and turned into s, mm and mN."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from indentfit.case import Record
from indentfit.errors import RecordError
from indentfit.experiment.record import RawRecord
from indentfit.experiment.tables import read_table
from indentfit.units import unit_factor

TARGETS = {"time": "s", "displacement": "mm", "force": "mN"}
WORDS = {  # how vendors' headers begin
    "time": ("time", "zeit", "temps", "时间", "t"),
    "displacement": ("displacement", "disp", "position", "extension", "stroke", "indentation", "weg", "位移"),
    "force": ("force", "load", "kraft", "力", "载荷"),
}
UNITS = (
    "nm",
    "um",
    "µm",
    "μm",
    "mm",
    "cm",
    "m",
    "in",
    "uN",
    "µN",
    "μN",
    "mN",
    "cN",
    "N",
    "kN",
    "gf",
    "kgf",
    "lbf",
    "ms",
    "s",
    "min",
    "mV",
    "V",
)
ALIASES = {"g": "gf", "kg": "kgf", "sec": "s", "μm": "um", "µm": "um", "μN": "uN", "µN": "uN"}
ELECTRIC = ("V", "mV")
FEWEST = 50  # samples of a record


def read_record(path, layout=None):
    """The `RawRecord` of a file: text in columns or a workbook, as `layout`, the [record] table of a case, says, in s, mm and mN.

    A column that the layout does not name is told by its header, and so is its unit. Rows without numbers are left out, with a
    note. Raises RecordError, one line with the file, what is wrong and the remedy.
    """
    path, layout = Path(path), layout or Record()
    table = read_table(path, layout.skip_rows, layout.sheet, layout.encoding)
    places = {name: _column(path, table, name, getattr(layout, name)) for name in ("displacement", "force")}
    if places["displacement"] == places["force"]:
        raise RecordError(f"{path}: displacement and force are the same column {places['force'] + 1}; give record.force.column")
    time, notes = _time(path, table, layout), table.notes
    columns = [time, *(_calibrated(path, table, name, places[name], getattr(layout, name)) for name in places)]
    good = np.all(np.isfinite(columns), axis=0)
    if not good.all():
        notes += (f"{np.count_nonzero(~good):,} rows without numbers are left out",)
    if np.count_nonzero(good) < FEWEST:
        raise RecordError(f"{path}: {np.count_nonzero(good)} rows of numbers; a record needs at least {FEWEST}")
    time, displacement, force = (column[good] for column in columns)
    if np.any(np.diff(time) <= 0):
        n = int(np.flatnonzero(np.diff(time) <= 0)[0]) + 1
        raise RecordError(f"{path}: row {table.first + n}: the time {time[n]:g} s comes after {time[n - 1]:g} s; check record.time")
    return RawRecord(time, displacement, force, str(path), notes)


def _column(path, table, name, channel):
    """Index of the column of a channel: the one that the layout names, by name or number, or that the header tells."""
    width = table.values.shape[1]
    wanted = channel.column
    if isinstance(wanted, int):
        if 1 <= wanted <= width:
            return wanted - 1
        raise RecordError(f"{path}: record.{name}.column = {wanted}: the file has {width} columns, counted from 1")
    labels = [table.labels(n) for n in range(width)]
    if wanted is not None:
        found = [n for n in range(width) if any(_same(wanted, label) for label in labels[n])]
    else:
        found = [n for n in range(width) if any(_begins(label, WORDS[name]) for label in labels[n])]
    if len(found) == 1:
        return found[0]
    known = "; ".join(f"{n + 1}: {' '.join(reversed(labels[n])) or 'no header'}" for n in range(width))
    what = (
        f"record.{name}.column = {wanted!r}: {len(found) or 'no'} such columns"
        if wanted
        else f"{len(found) or 'no'} columns of {name}"
    )
    shown = known if len(known) <= 300 else f"{known[:297]}..."
    raise RecordError(f"{path}: {what}; give record.{name}.column, a name or a number of: {shown}")


def _same(wanted, label):
    return wanted.casefold().strip() in (label.casefold(), _bare(label).casefold())


def _begins(label, words):
    first = re.split(r"[\W\d_]+", label.strip().casefold(), maxsplit=1)[0]
    return any(first == word or (len(word) > 1 and first.startswith(word)) for word in words)


def _bare(label):
    """A label without its unit."""
    return re.sub(r"\s*[\[(（].*?[\])）]\s*$", "", label).strip()


def _unit(table, place):
    """The unit that a column's header gives, in brackets, after an underline, comma or slash, or in a row of its own; or None."""
    for label in table.labels(place):
        candidates = (
            re.findall(r"[\[(（]\s*([^\])）]*?)\s*[\])）]", label) + re.findall(r"(?:_|,\s*|/\s*|\s)([^\W\d]+)$", label) + [label]
        )
        for text in candidates:
            unit = ALIASES.get(text, text)
            if unit in UNITS:
                return unit
    return None


def _calibrated(path, table, name, place, channel):
    """The values of a column in mm, mN or s."""
    target, given = TARGETS[name], _unit(table, place)
    unit = channel.unit or (target if channel.gain is not None else given)
    if unit is None:
        raise RecordError(f"{path}: the header does not tell the unit of the {name}; give record.{name}.unit, such as {target!r}")
    if unit in ELECTRIC:
        raise RecordError(f"{path}: the {name} is in {unit}; give record.{name}.gain, {target} per {unit}")
    values = channel.sign * (1.0 if channel.gain is None else channel.gain) * table.values[:, place] + channel.offset
    try:
        return values * unit_factor(ALIASES.get(unit, unit), target)
    except ValueError as error:
        raise RecordError(f"{path}: record.{name}.unit {error}") from None


def _time(path, table, layout):
    """Times of the rows, s, from the first; by the rate, or by a column."""
    n = len(table.values)
    if layout.rate is not None:
        return np.arange(n) / layout.rate
    named = layout.time.column is not None
    told = any(_begins(label, WORDS["time"]) for place in range(table.values.shape[1]) for label in table.labels(place))
    if not named and not told:
        raise RecordError(f"{path}: no column of time and no sampling rate; give record.rate in Hz, or record.time.column")
    time = _calibrated(path, table, "time", _column(path, table, "time", layout.time), layout.time)
    if not np.isfinite(time).any():
        raise RecordError(f"{path}: the column of time holds no numbers; give record.rate in Hz, or record.time.column")
    return time - time[np.isfinite(time)][0]
