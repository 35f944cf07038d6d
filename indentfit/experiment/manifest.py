"""The manifest of a set of replicates: a CSV with a row for each record, and the records processed row by row."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass, replace
from pathlib import Path

from indentfit.errors import RecordError
from indentfit.experiment.formats.encodings import decoded
from indentfit.experiment.processed import ProcessedRecord, process_record
from indentfit.experiment.reading import read_record
from indentfit.units import unit_factor

COLUMNS = ("sample", "direction", "file", "thickness", "diameter")
NEEDED = ("sample", "direction", "file")
DIRECTIONS = {"0": 0, "90": 90, "parallel": 0, "perpendicular": 90}
LENGTHS = ("thickness", "diameter")


@dataclass(frozen=True)
class Entry:
    """A row of a manifest: sample, direction (degrees between fibres and strip; None where it is not told), file, lengths in mm."""

    sample: str
    direction: int | None
    path: Path
    thickness: float | None = None
    diameter: float | None = None
    row: int = 0
    problem: str | None = None


@dataclass(frozen=True, eq=False)
class Outcome:
    """An entry, and its record processed, or the problem that prevents it, one line."""

    entry: Entry
    processed: ProcessedRecord | None = None
    problem: str | None = None

    @property
    def name(self):
        """What it is called in tables: sample and direction."""
        return self.entry.sample + ("" if self.entry.direction is None else f" {self.entry.direction}°")


def read_manifest(path):
    """The `Entry` of each row of a manifest: columns sample, direction (0, 90, parallel, perpendicular), file, thickness, diameter.

    Files are relative to the manifest; lengths are in mm, or carry a unit in the header (thickness_um). A row that cannot be used
    has a `problem` that names it; RecordError where the manifest itself cannot be read.
    """
    path = Path(path)
    try:
        text = decoded(path.read_bytes(), path=path)
    except OSError as error:
        raise RecordError(f"{path}: cannot be read ({error.strerror}); name a CSV with the columns {', '.join(COLUMNS)}") from None
    lines = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]
    if len(lines) < 2:
        raise RecordError(f"{path}: no rows; it needs a header {','.join(COLUMNS)} and a row for each record")
    separator = next((mark for mark in "\t;" if mark in lines[0]), ",")
    header = [cell.strip().lower() for cell in next(csv.reader([lines[0]], delimiter=separator))]
    places, factors = _places(path, header)
    rows = csv.reader(io.StringIO("\n".join(lines[1:])), delimiter=separator)
    entries = [_entry(path, row, number, places, factors) for number, row in enumerate(rows, start=2)]
    return _once_each(entries)


def process_all(entries, table=None, progress=None):
    """`Outcome` of each Entry; one that fails does so alone. progress: called with (number done, name)."""
    outcomes = []
    for n, entry in enumerate(entries):
        outcomes.append(_outcome(entry, table))
        if progress:
            progress(n + 1, entry.sample)
    return outcomes


def _outcome(entry, table):
    if entry.problem:
        return Outcome(entry, problem=entry.problem)
    try:
        return Outcome(entry, process_record(read_record(entry.path, table), entry.thickness, table))
    except RecordError as error:
        return Outcome(entry, problem=str(error))


def _places(path, header):
    """Column of each name, and the factor of each length to mm."""
    places, factors = {}, {}
    for n, cell in enumerate(header):
        name, _, unit = cell.partition("_")
        if name not in COLUMNS:
            continue
        if name in places:
            raise RecordError(f"{path}: two columns of {name}; keep one")
        places[name] = n
        if name in LENGTHS:
            try:
                factors[name] = unit_factor(unit or "mm", "mm")
            except ValueError as error:
                raise RecordError(f"{path}: column {cell!r} {error}") from None
    missing = [name for name in NEEDED if name not in places]
    if missing:
        raise RecordError(f"{path}: no column {missing[0]}; the header must be {','.join(COLUMNS)}, it is {','.join(header)[:80]}")
    return places, factors


def _entry(path, row, number, places, factors):
    cells = {name: " ".join(row[n].splitlines()).strip() if n < len(row) else "" for name, n in places.items()}
    entry = Entry(cells["sample"], DIRECTIONS.get(_direction(cells["direction"])), path.parent / cells["file"], row=number)
    where = f"{path}: row {number} ({cells['sample'] or 'no sample'}, {cells['direction'] or 'no direction'})"
    if missing := [name for name in NEEDED if not cells[name]]:
        return replace(entry, problem=f"{where}: no {missing[0]}; fill it in")
    if entry.direction is None:
        return replace(entry, problem=f"{where}: direction {cells['direction']!r} must be 0, 90, parallel or perpendicular")
    for name, factor in factors.items():
        if not cells[name]:
            continue
        try:
            value = float(f"{float(cells[name].replace(',', '.')) * factor:.15g}")  # 3300 um is 3.3 mm and not a bit more
        except ValueError:
            value = float("nan")
        if not 0 < value < float("inf"):
            return replace(entry, problem=f"{where}: {name} {cells[name]!r} must be a positive number")
        entry = replace(entry, thickness=value) if name == "thickness" else replace(entry, diameter=value)
    return entry


def _direction(text):
    word = text.lower().removesuffix("deg").strip(" -_°")
    return {"0.0": "0", "90.0": "90"}.get(word, word)


def _once_each(entries):
    """Refuse the second row of the same sample and direction: it would count twice."""
    seen: dict[tuple, int] = {}
    for n, entry in enumerate(entries):
        key = entry.sample, entry.direction
        if entry.problem is None and key in seen:
            entries[n] = replace(
                entry,
                problem=f"{entry.path}: row {entry.row} repeats {entry.sample}, {entry.direction} of row {seen[key]}; remove one",
            )
        elif entry.problem is None:
            seen[key] = entry.row
    return entries
