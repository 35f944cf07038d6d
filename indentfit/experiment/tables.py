"""Columns of numbers out of a lab's file: separated or fixed text in the encodings of vendors' programs, or a workbook.

The separator, the decimal mark, the encoding and the rows of the header are told from the file itself; numbers are parsed by NumPy,
workbooks by python-calamine (extra `xlsx`).
"""

from __future__ import annotations

import codecs
import io
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from indentfit.errors import RecordError
from indentfit.experiment.workbook import sheet_rows

WORKBOOKS = (".xlsx", ".xlsm", ".xlsb", ".xls", ".ods")
MARKS = {
    codecs.BOM_UTF8: "utf-8-sig",
    codecs.BOM_UTF32_LE: "utf-32",
    codecs.BOM_UTF32_BE: "utf-32",
    codecs.BOM_UTF16_LE: "utf-16",
    codecs.BOM_UTF16_BE: "utf-16",
}
LOOKED_AT = 400  # lines that the first row of numbers may come after
MISSING = ("", "nan", "na", "n/a", "null")
NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?|[-+]?(nan|inf)", re.ASCII | re.IGNORECASE)
COMMA_NUMBER = re.compile(r"[-+]?(\d+(,\d+)?|,\d+)([eE][-+]?\d+)?", re.ASCII)
FORMS = [
    (separator, number)
    for separator in ("\t", ";", ",", None)
    for number in (NUMBER, COMMA_NUMBER)
    if (separator, number) != (",", COMMA_NUMBER)
]


@dataclass(frozen=True, eq=False)
class Table:
    """`header`: rows above the numbers, each a list of cells; `values`: the numbers (rows, columns), NaN where a cell is empty.

    first: number of the first row of numbers in the file, from 1; notes: what was left out.
    """

    header: list[list[str]]
    values: np.ndarray
    first: int
    notes: tuple[str, ...] = ()

    def labels(self, column):
        """The header's texts above a column (from 0), nearest to the numbers first."""
        width = self.values.shape[1]
        return [row[column] for row in reversed(self.header) if len(row) == width and row[column]]


def read_table(path, skip_rows=0, sheet=None, encoding=None):
    """The `Table` of a file. skip_rows: rows to pass over; sheet: name or number (from 1) in a workbook; encoding: where it
    cannot be told.

    Raises RecordError, one line with the file, the row and the remedy.
    """
    path = Path(path)
    try:
        if not path.exists():
            raise RecordError(f"{path}: no such file; check the path")
        if not path.is_file():
            raise RecordError(f"{path}: not a file; name a file of records")
        if path.suffix.lower() in WORKBOOKS:
            return _workbook(path, skip_rows, sheet)
        raw = path.read_bytes()
    except (OSError, ValueError) as error:  # a name that is too long, or holds a zero byte
        raise RecordError(f"{str(path)[:200]}: cannot be read ({getattr(error, 'strerror', None) or error})") from error
    return _from_text(path, decoded(raw, encoding, path), skip_rows)


def decoded(raw, encoding=None, path="text"):
    """Text of a file's bytes: by byte-order mark, as UTF-16 without one, as UTF-8, as GBK, or else as Latin-1.

    GBK writes each foreign letter as two bytes above 127; Latin-1 texts have such bytes alone. Raises RecordError where a named
    encoding is unknown or does not fit.
    """
    marked = next((name for mark, name in MARKS.items() if raw.startswith(mark)), None)
    for name in [encoding] if encoding else [marked] if marked else _likely(raw):
        try:
            return raw.decode(name)
        except LookupError:
            raise RecordError(f"{path}: record.encoding = {encoding!r} is no encoding; try utf-8, utf-16, gbk or latin-1") from None
        except UnicodeDecodeError:
            continue
    raise RecordError(f"{path}: not text in {encoding or marked}; give record.encoding (utf-8, utf-16, gbk, latin-1)")


def _likely(raw):
    start = raw[:4000]
    if start and start.count(0) > 0.2 * len(start):
        return ["utf-16-le" if start[1:200:2].count(0) > start[0:200:2].count(0) else "utf-16-be"]
    pairs = all(len(run) % 2 == 0 for run in re.findall(rb"[\x81-\xfe]+", raw))
    return ["utf-8", *(["gb18030"] if pairs else []), "latin-1"]


def _from_text(path, text, skip_rows):
    lines = text.splitlines()
    while lines and not lines[-1].strip():
        lines.pop()
    if not lines:
        raise RecordError(f"{path}: the file is empty; it needs columns of displacement and force")
    rows = [line if line.strip() else None for line in lines[: skip_rows + LOOKED_AT]]
    fits = ((_first_numbers(rows, skip_rows, separator, number), separator, number) for separator, number in FORMS)
    (first, _), separator, number = min(fits, key=lambda one: one[0])  # the first of equals
    if first == np.inf:
        raise RecordError(f"{path}: no rows of numbers within {LOOKED_AT} lines; export columns of text, or give record.skip_rows")
    header = [_cells(row, separator) for row in rows[skip_rows:first] if row]
    width, body, notes = len(_cells(lines[first], separator)), lines[first:], []
    if len(body) > 1 and len(_cells(body[-1], separator)) < width:
        body.pop()
        notes.append("the last line is cut off: left out")
    return Table(header, _numbers(path, body, separator, number, first), first + 1, tuple(notes))


def _first_numbers(rows, skip_rows, separator, number):
    """Index of the first row of numbers, read with a separator and a form of numbers, and how many of its cells are none.

    The index is infinite where there is no such row.
    """
    kinds = [tuple(bool(number.fullmatch(cell)) for cell in _cells(row, separator)) for row in rows if row is not None]
    places = [n for n, row in enumerate(rows) if row is not None]
    for n, (place, kind) in enumerate(zip(places, kinds, strict=True)):
        following = kinds[n : n + 20]
        if place >= skip_rows and sum(kind) >= 2 and following.count(kind) >= 0.8 * len(following):
            return place, kind.count(False)
    return np.inf, 0


def _cells(row, separator):
    return [cell.strip().strip('"').strip() for cell in row.strip(" \r\n").split(separator)]


def _numbers(path, body, separator, number, first):
    """Values (rows, columns) of the lines of numbers; NumPy's parser, or line by line where cells are empty or not numbers."""
    kind = [bool(number.fullmatch(cell)) for cell in _cells(body[0], separator)]
    text = "\n".join(body).replace('"', "")
    if number is COMMA_NUMBER:
        text = text.replace(",", ".")
    columns = np.flatnonzero(kind)
    values = np.full((0, len(kind)), np.nan)
    try:
        found = np.loadtxt(io.StringIO(text), delimiter=separator, usecols=columns.tolist(), ndmin=2, comments=None)
        values = np.full((len(found), len(kind)), np.nan)
        values[:, columns] = found
    except ValueError:
        lines = [(n, line) for n, line in enumerate(body, start=first + 1) if line.strip()]
        values = np.array([_row(f"{path}: line {n}", _cells(line, separator), number, kind) for n, line in lines])
    return values


def _row(where, cells, number, kind):
    if len(cells) != len(kind):
        raise RecordError(f"{where}: {len(cells)} columns, the first row of numbers has {len(kind)}; correct or remove the line")
    wrong = [cell for cell, numeric in zip(cells, kind, strict=True) if numeric and cell and not number.fullmatch(cell)]
    if wrong and wrong[0].strip("-").lower() not in MISSING:
        raise RecordError(f"{where}: {wrong[0][:40]!r} is not a number; correct or remove the line")
    return [
        float(cell.replace(",", ".")) if numeric and number.fullmatch(cell) else np.nan
        for cell, numeric in zip(cells, kind, strict=True)
    ]


def _workbook(path, skip_rows, sheet):
    """The Table of a sheet of a workbook."""
    rows = sheet_rows(path, sheet)
    kinds = [[isinstance(cell, int | float) and not isinstance(cell, bool) for cell in row] for row in rows]
    first = next((n for n in range(skip_rows, len(rows)) if sum(kinds[n]) >= 2), None)
    if first is None:
        raise RecordError(f"{path}: no row of numbers in the sheet; give record.sheet, or store numbers as numbers, not as text")
    values = [
        [
            float(cell) if numeric else _cell(f"{path}: row {n}", cell, wanted)
            for cell, numeric, wanted in zip(row, kind, kinds[first], strict=True)
        ]
        for n, (row, kind) in enumerate(zip(rows[first:], kinds[first:], strict=True), start=first + 1)
    ]
    header = [[str(cell).strip() for cell in row] for row in rows[skip_rows:first] if any(cell != "" for cell in row)]
    return Table(header, np.array(values), first + 1)


def _cell(where, cell, wanted):
    if wanted and cell != "":
        raise RecordError(f"{where}: {str(cell)[:40]!r} is not a number; correct or remove the row")
    return np.nan
