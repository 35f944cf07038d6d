"""Records in text files: columns of numbers with separators or of fixed width, as instruments' programs export them.

The separator, the decimal mark, the encoding and the rows of the header are recognised from the file; NumPy parses the numbers.
"""

from __future__ import annotations

import io
import re
from pathlib import Path

import numpy as np

from indentfit.arrays import Array
from indentfit.case import Record
from indentfit.errors import RecordError
from indentfit.experiment.formats.columns import raw_record
from indentfit.experiment.formats.encodings import decoded
from indentfit.experiment.formats.table import Table
from indentfit.experiment.record import RawRecord

LINES_SEARCHED = 400  # the first row of numbers must be among them
MISSING = ("", "nan", "na", "n/a", "null")
NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?|[-+]?(nan|inf)", re.ASCII | re.IGNORECASE)
COMMA_NUMBER = re.compile(r"[-+]?(\d+(,\d+)?|,\d+)([eE][-+]?\d+)?", re.ASCII)
Form = tuple[str | None, re.Pattern[str]]  # the separator (None: blanks), and how a number is written
FORMS: list[Form] = [
    (separator, number)
    for separator in ("\t", ";", ",", None)
    for number in (NUMBER, COMMA_NUMBER)
    if (separator, number) != (",", COMMA_NUMBER)
]


class TextFormat:
    """Text in columns. Every file that no other format recognises is read as text."""

    def reads(self, path: Path) -> bool:
        return True

    def read(self, path: Path, settings: Record) -> RawRecord:
        text = decoded(path.read_bytes(), settings.encoding, path)
        return raw_record(path, text_table(path, text, settings.skip_rows), settings)


def text_table(path: Path, text: str, skip_rows: int) -> Table:
    """The `Table` that a text holds.

    Parameters
    ----------
    path : path
        The file, for messages.
    text : str
    skip_rows : int
        Lines to skip.

    Returns
    -------
    Table

    Raises
    ------
    RecordError
        The text holds no table. The error's text is one line with the file and the remedy.
    """
    lines = text.splitlines()
    while lines and not lines[-1].strip():
        lines.pop()
    if not lines:
        raise RecordError(f"{path}: the file is empty; it needs columns of displacement and force")
    rows = [line if line.strip() else None for line in lines[: skip_rows + LINES_SEARCHED]]
    fits = [(_first_numbers(rows, skip_rows, form), form) for form in FORMS]
    (first, _), form = min(fits, key=lambda fit: fit[0])  # the first of equals
    if first == len(rows):
        raise RecordError(
            f"{path}: no rows of numbers within {LINES_SEARCHED} lines; export columns of text, or give record.skip_rows"
        )
    return _table(path, lines, skip_rows, first, form)


def _first_numbers(rows: list[str | None], skip_rows: int, form: Form) -> tuple[int, int]:
    """Index of the first row of numbers, read in a form, and how many of its cells are not numbers.

    The index is the number of rows where none is a row of numbers.
    """
    separator, number = form
    kinds = [tuple(bool(number.fullmatch(cell)) for cell in _cells(row, separator)) for row in rows if row is not None]
    places = [n for n, row in enumerate(rows) if row is not None]
    for n, (place, kind) in enumerate(zip(places, kinds, strict=True)):
        following = kinds[n : n + 20]
        if place >= skip_rows and sum(kind) >= 2 and following.count(kind) >= 0.8 * len(following):
            return place, kind.count(False)
    return len(rows), 0


def _table(path: Path, lines: list[str], skip_rows: int, first: int, form: Form) -> Table:
    """The Table of lines whose numbers begin at index `first`; a last line that is cut off is left out."""
    separator, _ = form
    header = [_cells(row, separator) for row in lines[skip_rows:first] if row.strip()]
    body = lines[first:]
    notes: tuple[str, ...] = ()
    if len(body) > 1 and len(_cells(body[-1], separator)) < len(_cells(body[0], separator)):
        body.pop()
        notes = ("the last line is cut off and was left out",)
    return Table(header, _numbers(path, body, form, first), first + 1, notes)


def _cells(row: str, separator: str | None) -> list[str]:
    return [cell.strip().strip('"').strip() for cell in row.strip(" \r\n").split(separator)]


def _numbers(path: Path, body: list[str], form: Form, first: int) -> Array:
    """Values (rows, columns) of lines: by NumPy's parser, or line by line where cells are empty or hold no numbers."""
    separator, number = form
    kind = [bool(number.fullmatch(cell)) for cell in _cells(body[0], separator)]
    try:
        return _parsed(body, form, kind)
    except ValueError:
        lines = [(n, line) for n, line in enumerate(body, start=first + 1) if line.strip()]
        return np.array([_row(f"{path}: line {n}", _cells(line, separator), number, kind) for n, line in lines])


def _parsed(body: list[str], form: Form, kind: list[bool]) -> Array:
    """Values of lines whose cells in columns of `kind` True are all numbers; ValueError where they are not."""
    separator, number = form
    text = "\n".join(body).replace('"', "")
    if number is COMMA_NUMBER:
        text = text.replace(",", ".")
    columns = np.flatnonzero(kind)
    numbers = np.loadtxt(io.StringIO(text), delimiter=separator, usecols=columns.tolist(), ndmin=2, comments=None)
    values = np.full((len(numbers), len(kind)), np.nan)
    values[:, columns] = numbers
    return values


def _row(where: str, cells: list[str], number: re.Pattern[str], kind: list[bool]) -> list[float]:
    """The values of one line; RecordError where it is too short or long, or holds a word among its numbers."""
    if len(cells) != len(kind):
        raise RecordError(f"{where}: {len(cells)} columns, the first row of numbers has {len(kind)}; correct or remove the line")
    wrong = [cell for cell, numeric in zip(cells, kind, strict=True) if numeric and cell and not number.fullmatch(cell)]
    if wrong and wrong[0].strip("-").lower() not in MISSING:
        raise RecordError(f"{where}: {wrong[0][:40]!r} is not a number; correct or remove the line")
    return [
        float(cell.replace(",", ".")) if numeric and number.fullmatch(cell) else np.nan
        for cell, numeric in zip(cells, kind, strict=True)
    ]
