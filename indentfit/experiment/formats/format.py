"""The interface of a file format from which raw records are read."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol

from indentfit.case import Record
from indentfit.experiment.record import RawRecord


class Format(Protocol):
    """A kind of file: it recognises its files, and turns one of them into a raw record.

    `reads` may look at the name of the file and at its first bytes. `read` gives the whole record in s, mm and mN, calibrated as
    the [record] table says, with a note on everything that was left out. `read` raises RecordError, whose text is one line with the
    file, what is wrong and the remedy; it need not catch an OSError of the system.
    """

    def reads(self, path: Path) -> bool:
        """Whether the file at `path`, which exists, is of this kind."""
        ...

    def read(self, path: Path, settings: Record) -> RawRecord:
        """The raw record that the file holds."""
        ...
