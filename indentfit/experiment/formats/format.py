"""The interface of a file format from which raw records are read."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol

from indentfit.case import Record
from indentfit.experiment.formats.table import Table


class Format(Protocol):
    """A kind of file: it recognises its files, and turns one of them into tables of columns.

    `reads` may look at the name of the file and at its first bytes. `tables` gives every table of the file that may be a record, in
    the file's order, with a note on everything that was left out; `columns.records` finds time, displacement and force in them.
    `tables` raises RecordError, whose text is one line with the file, what is wrong and the remedy; it need not catch an OSError of
    the system.
    """

    def reads(self, path: Path) -> bool:
        """Whether the file at `path`, which exists, is of this kind."""
        ...

    def tables(self, path: Path, settings: Record) -> list[Table]:
        """The tables that the file holds."""
        ...
