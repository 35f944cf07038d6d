"""Tables of points in CSV files: their lines and numbers, with refusals that name file, line and remedy."""

from __future__ import annotations

import io
import math
from collections.abc import Iterator, Sequence
from pathlib import Path

from indentfit.errors import CurveError
from indentfit.headers import shown


def lines_of(path: Path) -> Iterator[tuple[int, str]]:
    """(number, text) of each line that is neither empty nor a comment. Raises CurveError."""
    try:
        if not path.is_file():
            raise CurveError(f"{path}: no such file; check the path")
        text = path.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError:
        raise CurveError(f"{path}: not UTF-8 text; export it as 'CSV UTF-8'") from None
    except OSError as error:
        raise CurveError(f"{path}: cannot be read ({error.strerror})") from error
    for number, line in enumerate(io.StringIO(text, newline=None), start=1):
        if line.strip() and not line.lstrip().startswith("#"):
            yield number, line.rstrip("\n")


def require_cells(where: str, cells: Sequence[str], columns: int) -> None:
    """Raise CurveError where a line has another number of cells than the header has columns."""
    if len(cells) != columns:
        raise CurveError(f"{where}: has {len(cells)} columns, the header {columns}")


def number_of(where: str, cell: str, separator: str) -> float:
    """The finite number of a cell; beside semicolons a comma is a decimal point. Raises CurveError."""
    try:
        value = float(cell.replace(",", ".") if separator == ";" else cell)
    except ValueError:
        raise CurveError(f"{where}: {shown(cell)} is not a number; correct or remove the line") from None
    if not math.isfinite(value):
        raise CurveError(f"{where}: {shown(cell)} is not a finite number; correct or remove the line")
    return value
