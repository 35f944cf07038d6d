"""The table of a set of samples, each with its own curves: what `fit --per-sample` fits one after the other."""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass, field
from pathlib import Path

from indentfit.errors import RecordError

TABLE = "replicates.csv"
COLUMNS = ("sample", "direction", "curve", "thickness_mm", "diameter_mm")


@dataclass(frozen=True)
class Specimen:
    """One sample: its curves (direction -> CSV, relative to the table), thickness and diameter in mm or None."""

    name: str
    curves: dict[int, str] = field(default_factory=dict)
    thickness: float | None = None
    diameter: float | None = None


def write_specimens(path, rows):
    """Write rows of (sample, direction, curve, thickness, diameter)."""
    with open(path, "w", encoding="utf-8", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(COLUMNS)
        for sample, direction, curve, *lengths in rows:
            table.writerow([sample, direction, curve, *("" if length is None else f"{length:.10g}" for length in lengths)])


def read_specimens(path):
    """The `Specimen` of each name in a table, in its order. Raises RecordError, one line with the row and the remedy."""
    path = Path(path)
    try:
        rows = list(csv.DictReader(path.read_text(encoding="utf-8-sig").splitlines()))
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or error
        raise RecordError(f"{path}: cannot be read ({reason}); `indentfit process --case` writes it") from None
    if not rows or set(COLUMNS) - set(rows[0]):
        raise RecordError(f"{path}: it needs the columns {', '.join(COLUMNS)} and a row for each curve")
    samples: dict[str, Specimen] = {}
    for number, row in enumerate(rows, start=2):
        sample = _sample(f"{path}: row {number}", row)
        earlier = samples.setdefault(sample.name, sample)
        if earlier is not sample:
            _require_one_sample(f"{path}: row {number}", earlier, sample)
            earlier.curves.update(sample.curves)
    return list(samples.values())


def _sample(where, row):
    if None in row or None in row.values() or not row["sample"] or not row["curve"] or row["direction"] not in ("0", "90"):
        raise RecordError(f"{where}: it needs a sample, a direction of 0 or 90, and a curve")
    lengths = {}
    for key in ("thickness", "diameter"):
        text = row[f"{key}_mm"]
        try:
            lengths[key] = float(text) if text else None
        except ValueError:
            lengths[key] = math.nan
        if lengths[key] is not None and not 0 < lengths[key] < math.inf:
            raise RecordError(f"{where}: {key}_mm {text[:40]!r} must be a positive number; correct it")
    return Specimen(row["sample"], {int(row["direction"]): row["curve"]}, **lengths)


def _require_one_sample(where, earlier, sample):
    if set(earlier.curves) & set(sample.curves):
        raise RecordError(f"{where}: a second curve of {sample.name} in direction {next(iter(sample.curves))}; remove one")
    if (earlier.thickness, earlier.diameter) != (sample.thickness, sample.diameter):
        raise RecordError(f"{where}: {sample.name} has another thickness or diameter than in the row before; correct one")
