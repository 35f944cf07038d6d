"""The manifest of a set of replicates: a CSV with a row for each record."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path

from indentfit.errors import RecordError
from indentfit.experiment.formats.encodings import decoded
from indentfit.experiment.record import RawRecord
from indentfit.units import unit_factor

COLUMNS = ("sample", "direction", "file", "thickness", "diameter")
NEEDED = ("sample", "file")
DIRECTIONS = {"0": 0, "90": 90, "parallel": 0, "perpendicular": 90}
LENGTHS = ("thickness", "diameter")
LONGEST_HEADER = 80  # letters of a header that a message quotes


@dataclass(frozen=True, eq=False)
class Entry:
    """One record of a set: a row of a manifest, or the same facts in memory.

    Attributes
    ----------
    sample : str
    direction : int or None, degrees
        Angle between the fibres and the strip: 0 or 90; None where it is not known, or the tissue has no fibres.
    path : Path or None
        The file of the record.
    thickness, diameter : float or None, mm
        Sizes of the sample.
    row : int
        Row of the manifest, from 1; 0 without a manifest.
    problem : str or None
        Why the row cannot be used, one line.
    record : RawRecord or None
        The record itself, in place of a file.
    others : dict
        Header -> text of the columns of a manifest that have no meaning here, such as a group of samples.
    """

    sample: str
    direction: int | None = None
    path: Path | None = None
    thickness: float | None = None
    diameter: float | None = None
    row: int = 0
    problem: str | None = None
    record: RawRecord | None = None
    others: dict[str, str] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """Name of the record in tables: sample and direction."""
        return self.sample + ("" if self.direction is None else f" {self.direction}°")

    @property
    def group(self) -> int | None:
        """Direction of the group in whose statistics the record counts: all rows of a manifest without directions are one group, 0;
        None for a record that belongs to no set."""
        return 0 if self.direction is None and self.row else self.direction


@dataclass(frozen=True)
class _Columns:
    """Place of each column in the rows of a manifest, the factor of each length to mm, and places of the other columns."""

    places: dict[str, int]
    factors: dict[str, float]
    others: dict[str, int]


def read_manifest(path: str | Path) -> list[Entry]:
    """The entries of a manifest.

    Columns: sample, direction (0, 90, parallel, perpendicular; no such column for tissue without fibres), file (relative to the
    manifest), thickness and diameter (mm, or with a unit in the header: thickness_um). Other columns are kept as they are.

    Parameters
    ----------
    path : path of the CSV

    Returns
    -------
    list of Entry
        One for each row; a row that cannot be used has a `problem`.

    Raises
    ------
    RecordError
        The manifest itself cannot be read.
    """
    path = Path(path)
    lines = _lines(path)
    separator = next((mark for mark in "\t;" if mark in lines[0]), ",")
    columns = _columns(path, [cell.strip() for cell in next(csv.reader([lines[0]], delimiter=separator))])
    rows = csv.reader(io.StringIO("\n".join(lines[1:])), delimiter=separator)
    return once_each(_entry(path, row, number, columns) for number, row in enumerate(rows, start=2))


def _lines(path: Path) -> list[str]:
    """The lines of a manifest that are neither empty nor comments: a header and at least one row."""
    try:
        text = decoded(path.read_bytes(), path=path)
    except OSError as error:
        raise RecordError(f"{path}: cannot be read ({error.strerror}); name a CSV with the columns {', '.join(COLUMNS)}") from None
    lines = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]
    if len(lines) < 2:
        raise RecordError(f"{path}: no rows; a manifest needs a header {','.join(COLUMNS)} and a row for each record")
    return lines


def _columns(path: Path, header: list[str]) -> _Columns:
    """The columns that a header names; RecordError where it lacks one, or names one twice."""
    columns = _Columns({}, {}, {})
    for n, cell in enumerate(header):
        name, _, unit = cell.lower().partition("_")
        if name not in COLUMNS:
            columns.others.update({cell: n} if cell else {})
            continue
        if name in columns.places:
            raise RecordError(f"{path}: two columns of {name}; keep one")
        columns.places[name] = n
        if name in LENGTHS:
            columns.factors[name] = _factor(path, cell.lower(), unit)
    missing = [name for name in NEEDED if name not in columns.places]
    if missing:
        shown = ",".join(header)[:LONGEST_HEADER]
        raise RecordError(f"{path}: no column {missing[0]}; the header must be {','.join(COLUMNS)}, it is {shown}")
    return columns


def _factor(path: Path, cell: str, unit: str) -> float:
    try:
        return unit_factor(unit or "mm", "mm")
    except ValueError as error:
        raise RecordError(f"{path}: column {cell!r} {error}") from None


def _entry(path: Path, row: list[str], number: int, columns: _Columns) -> Entry:
    """The entry of a row, with a problem where the row cannot be used."""
    cells = {name: " ".join(row[n].splitlines()).strip() if n < len(row) else "" for name, n in columns.places.items()}
    directed, asked = "direction" in columns.places, cells.get("direction", "")
    others = {name: row[n].strip() if n < len(row) else "" for name, n in columns.others.items()}
    entry = Entry(cells["sample"], DIRECTIONS.get(_direction(asked)), path.parent / cells["file"], row=number, others=others)
    direction = f", {asked or 'no direction'}" if directed else ""
    where = f"{path}: row {number} ({cells['sample'] or 'no sample'}{direction})"
    if missing := [name for name in ("sample", *(("direction",) if directed else ()), "file") if not cells[name]]:
        return replace(entry, problem=f"{where}: no {missing[0]}; fill it in")
    if directed and entry.direction is None:
        return replace(entry, problem=f"{where}: direction {cells['direction']!r} must be 0, 90, parallel or perpendicular")
    lengths = {name: _length(cells[name], factor) for name, factor in columns.factors.items() if cells[name]}
    if wrong := [name for name, length in lengths.items() if length is None]:
        return replace(entry, problem=f"{where}: {wrong[0]} {cells[wrong[0]]!r} must be a positive number; correct it")
    return replace(entry, thickness=lengths.get("thickness"), diameter=lengths.get("diameter"))


def _direction(text: str) -> str:
    word = text.lower().removesuffix("deg").strip(" -_°")
    return {"0.0": "0", "90.0": "90"}.get(word, word)


def _length(text: str, factor: float) -> float | None:
    """A length in mm; None where the text is not a positive number."""
    try:
        length = float(f"{float(text.replace(',', '.')) * factor:.15g}")  # so that 3300 um is exactly 3.3 mm
    except ValueError:
        return None
    return length if 0 < length < float("inf") else None


def once_each(entries: Iterable[Entry]) -> list[Entry]:
    """The entries; the second entry of one sample and direction gets a problem, because the sample would count twice."""
    seen: dict[tuple[str, int | None], Entry] = {}
    checked = []
    for entry in entries:
        earlier = entry if entry.problem else seen.setdefault((entry.sample, entry.direction), entry)
        checked.append(entry if earlier is entry else replace(entry, problem=_repeats(entry, earlier)))
    return checked


def _repeats(entry: Entry, earlier: Entry) -> str:
    if entry.row:
        direction = "" if entry.direction is None else f", {entry.direction}"
        return f"{entry.path}: row {entry.row} repeats {entry.sample}{direction} of row {earlier.row}; remove one"
    return f"{entry.name}: another record has this sample and direction; remove one"
