"""Records in texts of LabChart (ADInstruments): names and units of the channels stand in lines of keys above each block of rows.

Layout: lines `key= <tab> a value for each channel` (Interval=, ChannelTitle=, Range=, UnitName= and others), then rows of the time
since the block's start and a number for each channel.
"""

from __future__ import annotations

import re
from pathlib import Path

from indentfit.case import Record
from indentfit.experiment.formats.encodings import decoded
from indentfit.experiment.formats.table import Table
from indentfit.experiment.formats.text import text_tables

FIRST = (b"Interval=", b"\xef\xbb\xbfInterval=", b"\xff\xfeI\x00n\x00")
KEY = re.compile(r"(\w+)=\t(.*)")


class LabchartFormat:
    """Texts of LabChart, recognised by their first words."""

    def reads(self, path: Path) -> bool:
        with path.open("rb") as file:
            return file.read(12).startswith(FIRST)

    def tables(self, path: Path, settings: Record) -> list[Table]:
        return text_tables(path, plain(decoded(path.read_bytes(), settings.encoding, path)), settings.skip_rows)


def plain(text: str) -> str:
    """A text of LabChart with one header above each of its blocks in place of the lines of keys."""
    lines: list[str] = []
    keys: dict[str, list[str]] = {}
    for line in text.splitlines():
        key = KEY.fullmatch(line)
        if key:
            keys[key[1]] = [cell.strip() for cell in key[2].split("\t")]
            continue
        if keys:
            lines += ["", _header(keys, line)]
            keys = {}
        lines.append(line)
    return "\n".join(lines)


def _header(keys: dict[str, list[str]], row: str) -> str:
    """The names of the columns of a block with their units; the first is time, where the first row has a number for it."""
    titles, units = keys.get("ChannelTitle", []), keys.get("UnitName", [])
    units = [*units, *[""] * (len(titles) - len(units))]
    names = [f"{title} ({unit})" if unit and unit != "*" else title for title, unit in zip(titles, units, strict=False)]
    return "\t".join(["Time (s)", *names] if len(row.rstrip().split("\t")) > len(names) else names)
