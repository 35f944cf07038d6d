"""Records in LabVIEW measurement files (.lvm): text whose headers hold the units of the channels and the step of time.

Layout: National Instruments, "Specification for the LabVIEW Measurement File (.lvm)": a header for the file, and one for each
packet of rows, of lines `key <separator> value for each channel`, each ended by `***End_of_Header***`; then a row of names that
begins with X_Value and ends with Comment; then the rows, with a column of X (X_Columns One), one for each channel (Multi), or none.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from indentfit.case import Record
from indentfit.errors import RecordError
from indentfit.experiment.formats.encodings import decoded
from indentfit.experiment.formats.table import Table
from indentfit.experiment.formats.text import text_tables
from indentfit.experiment.formats.words import unit_of_label

FIRST = b"LabVIEW Measurement"
END = "***End_of_Header***"


class LabviewFormat:
    """LabVIEW measurement files, recognised by their first words."""

    def reads(self, path: Path) -> bool:
        with path.open("rb") as file:
            return file.read(len(FIRST) + 4).removeprefix(b"\xef\xbb\xbf").startswith(FIRST)

    def tables(self, path: Path, settings: Record) -> list[Table]:
        return text_tables(path, _plain(path, decoded(path.read_bytes(), settings.encoding, path)), settings.skip_rows)


@dataclass
class _Header:
    """Keys of the headers so far, each with a value for each channel, and whether the rows that follow are numbers."""

    keys: dict[str, list[str]]
    separator: str = "\t"
    rows: int = 0  # of the packet, whose times are counted where it has no column of X
    width: int = 0  # columns of the rows of numbers: a comment may follow

    def take(self, line: str) -> None:
        """Take a line `key <separator> values`."""
        if line.startswith("Separator"):
            self.separator = "," if line.rstrip().endswith("Comma") else "\t"
        key, *values = line.split(self.separator)
        self.keys[key.strip()] = [value.strip() for value in values]

    def value(self, key: str) -> str:
        """The first value of a key, "" where there is none."""
        return next(iter(self.keys.get(key, [])), "")

    @property
    def has_x(self) -> bool:
        """Whether the rows have a column of X."""
        return self.value("X_Columns") != "No"

    def names(self, line: str) -> str:
        """The row of names with a unit for each channel."""
        cells = [cell.strip() for cell in line.split(self.separator)]
        cells = cells[:-1] if cells[-1] == "Comment" else cells
        timed = self.value("X_Dimension") in ("", "Time")
        units = iter(self.keys.get("Y_Unit_Label", []))
        named = [
            ("Time (s)" if timed else cell) if cell == "X_Value" else _with_unit(cell, next(units, ""))
            for cell in (cells if self.has_x else cells[cells[0] == "X_Value" :])
        ]
        self.width = len(named)
        return self.separator.join(named if self.has_x else ["Time (s)", *named])

    def row(self, line: str) -> str:
        """A row of numbers, with its time where it has no column of X, and without a comment."""
        cells = line.rstrip().split(self.separator)
        if self.has_x:
            return self.separator.join(cells[: self.width])
        cells = cells[cells[0] == "" :][: self.width]
        point = self.value("Decimal_Separator") or "."
        start, step = (float((self.value(key) or "0").replace(",", ".")) for key in ("X0", "Delta_X"))
        self.rows += 1
        return self.separator.join([f"{start + step * (self.rows - 1):.12g}".replace(".", point), *cells])


def _with_unit(name: str, unit: str) -> str:
    return f"{name} ({unit})" if unit and unit_of_label(name) is None else name


def _plain(path: Path, text: str) -> str:
    """The text with one row of names and the rows of numbers, on the lines on which they were; other lines are empty.

    Packets whose names are those of the first are one table.
    """
    header, known, lines = _Header({}), "", []
    inside, named = True, False
    for line in text.splitlines():
        if line.startswith(("LabVIEW Measurement", "Channels")):
            inside, named, header.rows = True, False, 0
        if inside or not line.strip():
            inside = inside and not line.startswith(END)
            header.take(line)
            lines.append("")
        elif not named:
            names = header.names(line)
            lines.append("" if names == known else names)
            known, named = names, True
        else:
            lines.append(header.row(line))
    if not header.has_x and not header.value("Delta_X"):
        raise RecordError(f"{path}: the file has neither a column of X nor a Delta_X: export it with X_Columns One")
    return "\n".join(lines)
