"""Reading a lab's file as a raw record, with the format that recognises the file."""

from __future__ import annotations

from pathlib import Path

from indentfit.case import Record
from indentfit.errors import RecordError
from indentfit.experiment.formats.format import Format
from indentfit.experiment.formats.text import TextFormat
from indentfit.experiment.formats.workbook import WorkbookFormat
from indentfit.experiment.record import RawRecord

FORMATS: tuple[Format, ...] = (WorkbookFormat(), TextFormat())  # the first that recognises a file reads it


def read_record(path: str | Path, settings: Record | None = None) -> RawRecord:
    """The `RawRecord` of a file, in s, mm and mN.

    Parameters
    ----------
    path : path
        Text in columns, or a workbook.
    settings : Record
        The [record] table: columns, calibration, sampling rate; by default all of these follow from the header of the file.

    Returns
    -------
    RawRecord

    Raises
    ------
    RecordError
        The file cannot be read as a record. The error's text is one line with the file, what is wrong and the remedy.
    """
    path, settings = Path(path), settings or Record()
    _require_file(path)
    try:
        return next(format for format in FORMATS if format.reads(path)).read(path, settings)
    except OSError as error:
        raise _unreadable(path, error) from error


def _require_file(path: Path) -> None:
    try:
        exists, is_file = path.exists(), path.is_file()
    except (OSError, ValueError) as error:  # the name is too long, or holds a zero byte
        raise _unreadable(path, error) from error
    if not exists:
        raise RecordError(f"{path}: no such file; check the path")
    if not is_file:
        raise RecordError(f"{path}: not a file; name a file of records")


def _unreadable(path: Path, error: OSError | ValueError) -> RecordError:
    return RecordError(f"{str(path)[:200]}: cannot be read ({getattr(error, 'strerror', None) or error}); check the path")
