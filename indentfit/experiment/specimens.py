"""The table of a set of specimens, each with its own curves; `fit --per-sample` fits the specimens one after the other."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from indentfit.errors import RecordError

TABLE = "replicates.csv"
COLUMNS = ("sample", "direction", "curve", "thickness_mm", "diameter_mm")


@dataclass(frozen=True)
class Specimen:
    """One piece of tissue with its curves.

    Attributes
    ----------
    name : str
    curves : dict
        Direction (degrees; None where the table gives none, for tissue without fibres) -> CSV file, relative to the table.
    thickness, diameter : float or None, mm
        None where the table has no such size.
    """

    name: str
    curves: dict[int | None, str] = field(default_factory=dict)
    thickness: float | None = None
    diameter: float | None = None


NEEDED = ("sample", "curve", "thickness_mm", "diameter_mm")
DIRECTIONS = {"0": 0, "90": 90, "": None}
Row = tuple[str, int | None, str, float | None, float | None]  # sample, direction, curve, thickness, diameter


def write_specimens(path: str | Path, rows: Sequence[Row], others: Sequence[Mapping[str, str]] = ()) -> None:
    """Write the table, one row for each curve.

    Parameters
    ----------
    path : path
    rows : sequence of Row
    others : sequence of mappings
        Header -> text of further columns, for each row, such as the group of the sample.
    """
    more = [name for name in (others[0] if others else ()) if name not in COLUMNS]
    with open(path, "w", encoding="utf-8", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow([*COLUMNS, *more])
        for n, (sample, direction, curve, *lengths) in enumerate(rows):
            told = ("" if length is None else f"{length:.10g}" for length in lengths)
            cells = [others[n].get(name, "") for name in more]
            table.writerow([sample, "" if direction is None else direction, curve, *told, *cells])


def read_specimens(path: str | Path) -> list[Specimen]:
    """The specimens of a table, in its order.

    Parameters
    ----------
    path : path of the table

    Returns
    -------
    list of Specimen

    Raises
    ------
    RecordError
        The table cannot be used. The error's text is one line with the row, what is wrong and the remedy.
    """
    path = Path(path)
    try:
        rows = list(csv.DictReader(path.read_text(encoding="utf-8-sig").splitlines()))
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or error
        raise RecordError(f"{path}: cannot be read ({reason}); `indentfit process --case` writes it") from None
    if not rows or set(NEEDED) - set(rows[0]):
        text = "and a row for each curve; direction may be left out where the material has no fibres"
        raise RecordError(f"{path}: the table needs the columns {', '.join(COLUMNS)} {text}")
    specimens: dict[str, Specimen] = {}
    for number, row in enumerate(rows, start=2):
        specimen = _specimen(f"{path}: row {number}", row)
        earlier = specimens.setdefault(specimen.name, specimen)
        if earlier is not specimen:
            _require_same_lengths(f"{path}: row {number}", earlier, specimen)
            specimens[specimen.name] = replace(earlier, curves=earlier.curves | specimen.curves)
    return list(specimens.values())


def read_groups(path: str | Path, column: str) -> dict[str, str]:
    """The group of each specimen: a column of the table, or of a manifest, which has the specimens' names in the column `sample`.

    Raises
    ------
    RecordError
        There is no such column, a cell is empty, or a specimen is in two groups. The error's text is one line.
    """
    path = Path(path)
    try:
        rows = list(csv.DictReader(path.read_text(encoding="utf-8-sig").splitlines()))
    except (OSError, UnicodeDecodeError) as error:
        raise RecordError(f"{path}: cannot be read ({getattr(error, 'strerror', None) or error}); check its name") from None
    if not rows or not {"sample", column} <= set(rows[0]):
        known = ", ".join(str(name) for name in (rows[0] if rows else ()))
        raise RecordError(f"{path}: the table has no column {column!r} beside `sample`; it has: {known or 'no rows'}")
    groups: dict[str, str] = {}
    for number, row in enumerate(rows, start=2):
        group = (row[column] or "").strip()
        if not group:
            raise RecordError(f"{path}: row {number}: {column} is empty; give the group of {row['sample']!r}")
        if groups.setdefault(row["sample"], group) != group:
            raise RecordError(
                f"{path}: row {number}: {row['sample']!r} is in two groups ({groups[row['sample']]}, {group}); correct one"
            )
    return groups


def _specimen(where: str, row: dict[str, str]) -> Specimen:
    """The specimen with the one curve of a row."""
    direction = row.get("direction", "")
    if None in row or None in row.values() or not row["sample"] or not row["curve"] or direction not in DIRECTIONS:
        raise RecordError(f"{where}: the row needs a sample, a direction of 0 or 90 (empty without fibres), and a curve")
    thickness, diameter = (_length(where, key, row[key]) for key in ("thickness_mm", "diameter_mm"))
    return Specimen(row["sample"], {DIRECTIONS[direction]: row["curve"]}, thickness, diameter)


def _length(where: str, key: str, text: str) -> float | None:
    """A length, mm, or None where the cell is empty."""
    if not text:
        return None
    try:
        length = float(text)
    except ValueError:
        length = math.nan
    if not 0 < length < math.inf:
        raise RecordError(f"{where}: {key} {text[:40]!r} must be a positive number; correct it")
    return length


def _require_same_lengths(where: str, earlier: Specimen, specimen: Specimen) -> None:
    if set(earlier.curves) & set(specimen.curves):
        direction = next(iter(specimen.curves))
        of = "without a direction" if direction is None else f"in direction {direction}"
        raise RecordError(f"{where}: a second curve of {specimen.name} {of}; remove one")
    if (earlier.thickness, earlier.diameter) != (specimen.thickness, specimen.diameter):
        raise RecordError(f"{where}: {specimen.name} has another thickness or diameter than in an earlier row; correct one")
