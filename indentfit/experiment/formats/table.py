"""Columns of numbers below a header, as text files and workbooks hold them."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from indentfit.arrays import Array
from indentfit.experiment.formats.words import KIND, TARGETS, rank_of, unit_in

GOES_ON = 10.0  # steps of time after which a table is no continuation of that before it
FEWEST_ROWS = 20  # of a table that is looked at where a file holds several


@dataclass(frozen=True, eq=False)
class Table:
    """Numbers in columns, and the rows of text above them.

    Attributes
    ----------
    header : list of rows
        The rows above the numbers, each a list of cells.
    values : array (rows, columns)
        The numbers; NaN where a cell is empty or holds text.
    first : int
        Number of the first row of numbers in the file, from 1.
    notes : tuple of str
        A note on everything that was left out.
    name : str
        Name of the table in a file of several tables: a marker line above it, or its sheet; empty where there is none.
    texts : dict
        Column (from 0) -> its cells, for columns of words.
    above : tuple of str
        The lines of text above the table, and above the first table of the file.
    clock : bool
        Whether times were written as those of a clock, and are in seconds now.
    """

    header: list[list[str]]
    values: Array
    first: int
    notes: tuple[str, ...] = ()
    name: str = ""
    texts: Mapping[int, list[str]] = field(default_factory=dict)
    above: tuple[str, ...] = ()
    clock: bool = False

    @property
    def width(self) -> int:
        """Number of columns."""
        return int(self.values.shape[1])

    def labels(self, column: int) -> list[str]:
        """The header's texts above a column (from 0), beginning with the text nearest to the numbers: a unit, then a name."""
        return [row[column] for row in self._nearest_rows if column < len(row) and row[column]]

    @functools.cached_property  # asked for each column and each quantity, of hundreds of tables in a force map
    def _nearest_rows(self) -> list[list[str]]:
        """The row of names, and a row of units below or above it, of the header's rows as wide as the table."""
        rows = [row for row in reversed(self.header) if self._fits(row)]
        units = [row for row in rows[:2] if _is_row_of_units(row)]
        names = next((row for row in rows if not _is_row_of_units(row)), None)
        return [*units, *([names] if names else [])]

    def side_by_side(self) -> list[Table]:
        """The tables of tests whose columns stand side by side, with the same names again and again; the table itself otherwise."""
        held = [n for n in range(self.width) if self.labels(n) or np.isfinite(self.values[:, n]).any()]
        names, count = [tuple(self.labels(n)) for n in held], len(held)
        period = next((n for n in range(2, count // 2 + 1) if count % n == 0 and names[n:] == names[:-n]), 0)
        if not period or not all(names[:period]) or len(set(names[:period])) < period or self.texts:
            return [self]
        return [self._group(held[begin : begin + period], begin // period + 1) for begin in range(0, count, period)]

    def _group(self, columns: list[int], number: int) -> Table:
        """The table of some columns, without the rows after its last numbers, named by the text above its first column."""
        values = self.values[:, columns]
        held = np.flatnonzero(np.isfinite(values).any(axis=1))
        rows = [[*row, *[""] * (self.width - len(row))] for row in self.header if len(row) <= self.width]
        names = [row[columns[0]] for row in rows if row not in self._nearest_rows and row[columns[0]]]
        name = names[-1] if names else f"test {number}"
        header = [[row[n] for n in columns] for row in rows]
        return replace(self, header=header, values=values[: held[-1] + 1 if held.size else 0], name=name)

    def _fits(self, row: list[str]) -> bool:
        """Whether a row of the header has a text for each column; cells that are empty at its end do not count."""
        filled = len(row) - next((n for n, cell in enumerate(reversed(row)) if cell), len(row))
        return (
            filled <= self.width
            and len(row) >= min(self.width, filled)
            and filled >= max(2, self._filled_columns())
            and (not any(map(_is_number, row[: self.width])))
        )

    def _filled_columns(self) -> int:
        """Number of columns up to the last that holds numbers or words."""
        held = [n for n in range(self.width) if n in self.texts or (self.values[:, n] == self.values[:, n]).any()]
        return held[-1] + 1 if held else 0


def joined_tables(tables: list[Table]) -> list[Table]:
    """The tables of a file, those joined that a header in their midst parts: names and units are the same, and the time goes on."""
    joined: list[Table] = []
    for table in tables:
        if joined and _goes_on(joined[-1], table):
            before = joined[-1]
            texts = {n: [*words, *table.texts[n]] for n, words in before.texts.items()}
            joined[-1] = replace(before, values=np.vstack([before.values, table.values]), texts=texts)
        else:
            joined.append(table)
    return joined


def _goes_on(before: Table, table: Table) -> bool:
    """Whether a table is the continuation of that before it: no new text but comments between, the same columns, later times."""
    known = set(before.above)
    between = [line for line in table.above[len(before.above) :] if line.strip()]
    names = [[other.labels(n) for n in range(other.width)] for other in (before, table)]
    if names[0] != names[1] or before.texts.keys() != table.texts.keys():
        return False
    if not all(line in known or line.startswith("#") for line in between):
        return False
    places = [(min(ranks), n) for n in range(table.width) if (ranks := _ranks_of_time(table, n))]
    if not places:
        return False
    time, first = before.values[:, min(places)[1]], float(table.values[0, min(places)[1]])
    time = time[np.isfinite(time)]
    step = float(np.median(np.diff(time))) if time.size > 1 else 0.0
    return 0 < first - time[-1] <= GOES_ON * step


def _ranks_of_time(table: Table, place: int) -> list[tuple[int, int]]:
    return [rank for label in table.labels(place) if (rank := rank_of(label, "time")) is not None]


def long_tables(tables: list[Table]) -> list[Table]:
    """The tables of a file without those that are too short for a record; the first table says which these are."""
    long = [table for table in tables if len(table.values) >= FEWEST_ROWS]
    if not long:
        return tables[:1]
    short = [table for table in tables if len(table.values) < FEWEST_ROWS]
    notes = tuple(f"a table of {len(table.values)} rows{f' ({table.name})' if table.name else ''} was left out" for table in short)
    return [replace(long[0], notes=long[0].notes + notes), *long[1:]]


def _is_row_of_units(row: list[str]) -> bool:
    """Whether every cell is a unit, bare or in brackets, a dash or empty, and at least one is a unit; or some are a unit of length
    and of force, and the others no names of quantities."""
    cells = [cell.strip("[]()（） ") for cell in row]
    others = [cell for cell in cells if not unit_in(cell)]
    if {"displacement", "force"} <= {KIND.get(unit_in(cell) or "") for cell in cells}:
        return not any(rank_of(cell, quantity) for cell in others for quantity in TARGETS)
    return any(unit_in(cell) for cell in cells) and all(not cell or cell in ("-", "%", "1") or _short_unit(cell) for cell in cells)


def _short_unit(cell: str) -> bool:
    return unit_in(cell) is not None or ("/" in cell and len(cell) <= 8) or cell in ("°C", "kPa", "MPa", "Pa", "C")


def _is_number(cell: str) -> bool:
    try:
        float(cell.replace(",", "."))
    except ValueError:
        return False
    return True
