"""Records in workbooks (xlsx, xlsm, xlsb, xls, ods), read by python-calamine (extra `xlsx`)."""

from __future__ import annotations

import re
from itertools import pairwise
from pathlib import Path

import numpy as np

from indentfit.case import Record
from indentfit.errors import RecordError
from indentfit.experiment.formats.sheets import Cell, every_sheet, sheet_rows
from indentfit.experiment.formats.table import FEWEST_ROWS, Table

SPELLED = re.compile(r"[-+]?\d+(?:[.,]\d+)?(?:[eE][-+]?\d+)?")  # a number in a cell of text
THOUSANDS = re.compile(r"[-+]?[1-9]\d{0,2},\d{3}")
ENDINGS = (".xlsx", ".xlsm", ".xlsb", ".xls", ".ods")


class WorkbookFormat:
    """Sheets of workbooks, recognised by the suffix of the file's name."""

    def reads(self, path: Path) -> bool:
        return path.suffix.lower() in ENDINGS

    def tables(self, path: Path, settings: Record) -> list[Table]:
        if settings.sheets != "all":
            return [_table(path, "", sheet_rows(path, settings.sheet), settings.skip_rows)]
        sheets = {name: rows for name, rows in every_sheet(path).items() if _first(rows, settings.skip_rows) is not None}
        if not sheets:
            raise RecordError(f"{path}: no sheet has rows of numbers; store numbers as numbers, not as text")
        tables, problems = [], []
        for name, rows in sheets.items():
            try:
                tables.append(_table(path, name, rows, settings.skip_rows))
            except RecordError as error:  # a sheet of results and their averages
                problems.append(error)
        long = [table for table in tables if len(table.values) >= FEWEST_ROWS] or tables[:1]
        if not long:
            raise problems[0]
        return long


def _first(rows: list[list[Cell]], skip_rows: int) -> int | None:
    """Index of the first row with two numbers, None where there is none; a row of settings is followed by no other like it."""
    numbers = [n for n in range(skip_rows, len(rows)) if sum(map(_is_number, rows[n])) >= 2]
    runs = [n for n, after in pairwise(numbers) if after == n + 1]
    return next(iter(runs or numbers), None)


def _table(path: Path, name: str, rows: list[list[Cell]], skip_rows: int) -> Table:
    """The Table of a sheet's rows; rows without any number below the first are left out."""
    first = _first(rows, skip_rows)
    if first is None:
        rows = _numbers_of_texts(rows)
        first = _first(rows, skip_rows)
    if first is None:
        raise RecordError(
            f'{path}: no row of numbers in the sheet; give record.sheet or record.sheets = "all", or store numbers as numbers, not '
            "as text"
        )
    held = [_mostly_numbers(rows[first:], n) for n in range(len(rows[first]))]
    wanted = [_is_number(cell) and numbers for cell, numbers in zip(rows[first], held, strict=True)]
    body = [(n, row) for n, row in enumerate(rows[first:], start=first + 1) if any(map(_is_number, row)) or n == first + 1]
    body, notes = _without_summary(body, wanted)
    values = [[_value(f"{path}: row {n}", cell, number) for cell, number in zip(row, wanted, strict=True)] for n, row in body]
    table = np.array(values)
    table[:, ~np.array(held)] = np.nan
    header = [[str(cell).strip() for cell in row] for row in rows[skip_rows:first] if any(cell != "" for cell in row)]
    above = tuple(" ".join(cell for cell in row if cell) for row in header)
    return Table(header, table, first + 1, notes, name=name, above=above)


def _without_summary(
    body: list[tuple[int, list[Cell]]], wanted: list[bool]
) -> tuple[list[tuple[int, list[Cell]]], tuple[str, ...]]:
    """The numbered rows without a summary, and a note on it: few rows at the end that hold words in columns of numbers."""
    worded = [_words(row, wanted) for _, row in body]
    begin = next((n for n, words in enumerate(worded) if words), len(body))
    if not 0 < len(body) - begin < FEWEST_ROWS or not all(worded[begin:]):
        return body, ()
    rows = f"row {body[begin][0]}" if begin + 1 == len(body) else f"rows {body[begin][0]} to {body[-1][0]}"
    return body[:begin], (f"{rows} ({worded[begin][0][:20]!r}) hold words among numbers and were left out",)


def _words(row: list[Cell], wanted: list[bool]) -> list[str]:
    """The texts of a row in the columns of numbers."""
    return [str(cell) for cell, number in zip(row, wanted, strict=True) if number and cell != "" and not _is_number(cell)]


def _numbers_of_texts(rows: list[list[Cell]]) -> list[list[Cell]]:
    """The rows with their texts that are numbers as numbers; the rows themselves where a comma may mark thousands or decimals."""
    texts = [cell.strip() for row in rows for cell in row if isinstance(cell, str) and SPELLED.fullmatch(cell.strip())]
    commas = [text for text in texts if "," in text]
    pointed = any("." in text for text in texts)
    if commas and (pointed or all(THOUSANDS.fullmatch(text) for text in commas)):
        return rows
    return [[float(str(cell).strip().replace(",", ".")) if _is_spelled(cell) else cell for cell in row] for row in rows]


def _is_spelled(cell: Cell) -> bool:
    return isinstance(cell, str) and SPELLED.fullmatch(cell.strip()) is not None


def _mostly_numbers(rows: list[list[Cell]], column: int) -> bool:
    """Whether a column holds more numbers than words: a few results beside the table are none of it."""
    cells = [row[column] for row in rows if row[column] != ""]
    return 2 * sum(map(_is_number, cells)) > len(cells)


def _is_number(cell: Cell) -> bool:
    return isinstance(cell, int | float) and not isinstance(cell, bool)


def _value(where: str, cell: Cell, wanted: bool) -> float:
    """The number in a cell, NaN in a cell without a number; RecordError for text in a column of numbers."""
    if isinstance(cell, int | float) and not isinstance(cell, bool):
        return float(cell)
    if wanted and cell != "":
        raise RecordError(f"{where}: {str(cell)[:40]!r} is not a number; correct or remove the row")
    return np.nan
