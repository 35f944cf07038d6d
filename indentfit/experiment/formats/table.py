"""Columns of numbers below a header, as text files and workbooks hold them."""

from __future__ import annotations

from dataclasses import dataclass

from indentfit.arrays import Array


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
    """

    header: list[list[str]]
    values: Array
    first: int
    notes: tuple[str, ...] = ()

    @property
    def width(self) -> int:
        """Number of columns."""
        return int(self.values.shape[1])

    def labels(self, column: int) -> list[str]:
        """The header's texts above a column (from 0), beginning with the text nearest to the numbers."""
        return [row[column] for row in reversed(self.header) if len(row) == self.width and row[column]]
