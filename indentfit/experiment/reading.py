"""Reading a lab's file as raw records, with the format that recognises the file."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from indentfit.case import Record
from indentfit.errors import RecordError
from indentfit.experiment.formats.afm import AfmFormat
from indentfit.experiment.formats.columns import records
from indentfit.experiment.formats.format import Format
from indentfit.experiment.formats.labchart import LabchartFormat
from indentfit.experiment.formats.labview import LabviewFormat
from indentfit.experiment.formats.presets import LOOKED_AT, Preset, preset_of
from indentfit.experiment.formats.table import Table
from indentfit.experiment.formats.text import TextFormat
from indentfit.experiment.formats.workbook import WorkbookFormat
from indentfit.experiment.record import RawRecord

WORKBOOK = WorkbookFormat()
# the first that recognises a file reads it
FORMATS: tuple[Format, ...] = (WORKBOOK, AfmFormat(), LabviewFormat(), LabchartFormat(), TextFormat())


def read_record(path: str | Path, settings: Record | None = None) -> RawRecord:
    """The one `RawRecord` of a file, in s, mm and mN.

    Parameters
    ----------
    path : path
        Text in columns, a workbook, or a file of an atomic force microscope.
    settings : Record
        The [record] table: columns, calibration, sampling rate; by default all of these follow from the header of the file.

    Returns
    -------
    RawRecord

    Raises
    ------
    RecordError
        The file cannot be read as a record, or holds several. The error's text is one line with the file, what is wrong and the
        remedy.
    """
    read = read_records(path, settings)
    if len(read) > 1:
        names = ", ".join(f"{n}: {record.name.removeprefix(str(path)).strip()}" for n, record in enumerate(read[:8], start=1))
        raise RecordError(f"{path}: the file holds {len(read)} records; give record.block, a number or a name of {names}")
    return read[0]


def read_records(path: str | Path, settings: Record | None = None) -> list[RawRecord]:
    """The `RawRecord`s of a file, or those that `record.block` chooses; each is named after the file and its table.

    Parameters
    ----------
    path : path
    settings : Record

    Returns
    -------
    list of RawRecord
        At least one.

    Raises
    ------
    RecordError
        No table of the file is a record, or there is no such block.
    """
    path, settings = Path(path), settings or Record()
    _require_file(path)
    try:
        return _read(path, settings)
    except RecordError:
        if not WORKBOOK.reads(path) or settings.sheet is not None or settings.sheets is not None:
            raise
        return _sheets(path, settings)


def _sheets(path: Path, settings: Record) -> list[RawRecord]:
    """The records of all sheets of a workbook whose first sheet is none; the error of the first sheet where none is."""
    try:
        read = _read(path, settings.model_copy(update={"sheets": "all"}))
    except RecordError:
        return _read(path, settings)
    note = f'the first sheet is no record: every sheet was looked at, and {len(read)} records found (record.sheets = "all")'
    return [replace(read[0], notes=(note, *read[0].notes)), *read[1:]]


def _read(path: Path, settings: Record) -> list[RawRecord]:
    """The records of a file as the settings say."""
    tables, settings, preset = tables_of(path, settings)
    return _named(_records(path, _chosen(path, tables, settings.block), settings), preset)


def tables_of(path: Path, settings: Record) -> tuple[list[Table], Record, Preset | None]:
    """The tables of a file, less those that a preset skips, the settings with those of the preset, and the preset."""
    try:
        tables = next(format for format in FORMATS if format.reads(path)).tables(path, settings)
    except OSError as error:
        raise _unreadable(path, error) from error
    preset = preset_of(path, _start(tables), settings)
    if preset is not None:
        settings, tables = preset.applied(settings), _without_skipped(path, tables, preset, settings)
    return tables, settings, preset


def _start(tables: Sequence[Table]) -> str:
    """Text at the beginning of a file: above its first table."""
    return "\n".join((*tables[0].above, *(" ".join(row) for row in tables[0].header[-2:])))[:LOOKED_AT] if tables else ""


def _without_skipped(path: Path, tables: list[Table], preset: Preset, settings: Record) -> list[Table]:
    """The tables that the preset does not skip; all of them where a block is chosen, or where none would be left."""
    kept = [table for table in tables if table.name not in preset.skip]
    if settings.block is not None or len(kept) == len(tables):
        return tables
    skipped = ", ".join(dict.fromkeys(table.name for table in tables if table.name in preset.skip))
    if not kept:
        short = next((note for note in tables[0].notes if note.startswith("a table of ")), None)
        if short is None:
            return tables
        raise RecordError(
            f"{path}: {short}, and the other tables, {skipped}, move the stage only; record.block = 1 reads the first"
        )
    note = f"{len(tables) - len(kept)} tables that move the stage only were left out: {skipped}"
    return [replace(kept[0], notes=(*kept[0].notes, note)), *kept[1:]]


def _chosen(path: Path, tables: list[Table], block: int | str | None) -> list[Table]:
    if block is None or block == "all":
        return tables
    if isinstance(block, int):
        if 1 <= block <= len(tables):
            return [tables[block - 1]]
        raise RecordError(f"{path}: record.block = {block}: the file has {len(tables)} tables, counted from 1")
    chosen = [table for table in tables if table.name.casefold() == block.strip().casefold()]
    if not chosen:
        names = ", ".join(dict.fromkeys(table.name or "no name" for table in tables))
        raise RecordError(f"{path}: record.block = {block!r}: no such table; the tables are {names[:200]}")
    return chosen


def _records(path: Path, tables: list[Table], settings: Record) -> list[RawRecord]:
    """The records of tables; a table that is no record is left out with a note where another is one."""
    read: list[RawRecord] = []
    problems: list[str] = []
    for n, table in enumerate(tables, start=1):
        label = (table.name or f"table {n}") if len(tables) > 1 else ""
        try:
            read += [replace(record, name=f"{path} {label}".strip()) for record in records(path, table, settings)]
        except RecordError as error:
            problems.append(str(error).removeprefix(f"{path}: ") if len(tables) > 1 else str(error))
    if not read:
        raise RecordError(problems[0] if len(tables) == 1 else f"{path}: {problems[0]}")
    counts = Counter(problems)
    notes = tuple(
        f"{f'{count} tables were' if count > 1 else 'a table was'} left out: {problem}" for problem, count in counts.items()
    )
    return [replace(read[0], notes=read[0].notes + notes), *read[1:]]


def _named(read: list[RawRecord], preset: Preset | None) -> list[RawRecord]:
    """The records with the preset in what was taken, and with numbers where several have one name."""
    words = f"{preset.name}: " if preset else ""
    names = [record.name for record in read]
    numbered = [f"{name} ({n})" if names.count(name) > 1 else name for n, name in enumerate(names, start=1)]
    return [replace(record, name=name, taken=words + record.taken) for record, name in zip(read, numbered, strict=True)]


def _require_file(path: Path) -> None:
    try:
        exists, is_file = path.exists(), path.is_file()
    except (OSError, ValueError) as error:  # the name is too long, or holds a zero byte
        raise _unreadable(path, error) from error
    if not exists:
        raise RecordError(f"{path}: no such file; check the path")
    if not is_file:
        raise RecordError(f"{path}: not a file; name a file of records")
    if path.suffix.lower() == ".toml":
        raise RecordError(
            f"{path}: a file of settings, no record; name the instrument's files (`indentfit fit` reads those of a case)"
        )


def _unreadable(path: Path, error: OSError | ValueError) -> RecordError:
    return RecordError(f"{str(path)[:200]}: cannot be read ({getattr(error, 'strerror', None) or error}); check the path")
