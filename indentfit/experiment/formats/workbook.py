"""Records in workbooks (xlsx, xlsm, xlsb, xls, ods), read by python-calamine (extra `xlsx`)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from indentfit.case import Record
from indentfit.errors import RecordError
from indentfit.experiment.formats.columns import raw_record
from indentfit.experiment.formats.sheets import Cell, sheet_rows
from indentfit.experiment.formats.table import Table
from indentfit.experiment.record import RawRecord

ENDINGS = (".xlsx", ".xlsm", ".xlsb", ".xls", ".ods")


class WorkbookFormat:
    """Sheets of workbooks, recognised by the suffix of the file's name."""

    def reads(self, path: Path) -> bool:
        return path.suffix.lower() in ENDINGS

    def read(self, path: Path, settings: Record) -> RawRecord:
        return raw_record(path, _table(path, sheet_rows(path, settings.sheet), settings.skip_rows), settings)


def _table(path: Path, rows: list[list[Cell]], skip_rows: int) -> Table:
    """The Table of a sheet's rows."""
    kinds = [[_is_number(cell) for cell in row] for row in rows]
    first = next((n for n in range(skip_rows, len(rows)) if sum(kinds[n]) >= 2), None)
    if first is None:
        raise RecordError(f"{path}: no row of numbers in the sheet; give record.sheet, or store numbers as numbers, not as text")
    values = [
        [_value(f"{path}: row {n}", cell, wanted) for cell, wanted in zip(row, kinds[first], strict=True)]
        for n, row in enumerate(rows[first:], start=first + 1)
    ]
    header = [[str(cell).strip() for cell in row] for row in rows[skip_rows:first] if any(cell != "" for cell in row)]
    return Table(header, np.array(values), first + 1)


def _is_number(cell: Cell) -> bool:
    return isinstance(cell, int | float) and not isinstance(cell, bool)


def _value(where: str, cell: Cell, wanted: bool) -> float:
    """The number in a cell, NaN in a cell without a number; RecordError for text in a column of numbers."""
    if isinstance(cell, int | float) and not isinstance(cell, bool):
        return float(cell)
    if wanted and cell != "":
        raise RecordError(f"{where}: {str(cell)[:40]!r} is not a number; correct or remove the row")
    return np.nan
