"""A force-displacement curve, and its CSV file in and out.

The file has one header line and at least two columns, `displacement_UNIT` and `force_UNIT`, in any order;
other columns are read over. Columns are separated by commas or tabs, or by semicolons, and only then may
numbers have a decimal comma. Lines that begin with `#` and empty lines are skipped. The force is that of the
full sample, positive in compression; displacements are positive into the sample and rise from line to line.
"""

from __future__ import annotations

import functools
import io
import math
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .errors import CurveError

MIN_POINTS = 5
UNITS = {"displacement": "mm", "force": "mN"}
NAMES_OF_UNITS = re.compile(r"[^\W\d_]+(_[^\W\d_]+)*(\^?-?\d)?([*/·][^\W\d_]+(\^?-?\d)?)*")


@dataclass(frozen=True, eq=False)
class Curve:
    """One indentation: `displacement` in mm and full-sample `force` in mN, both of shape (n,), read-only."""

    displacement: np.ndarray
    force: np.ndarray

    def __post_init__(self):
        for name in UNITS:
            values = np.array(getattr(self, name), dtype=float)
            values.flags.writeable = False
            object.__setattr__(self, name, values)
        if self.displacement.ndim != 1 or self.displacement.shape != self.force.shape:
            raise CurveError(
                f"a curve needs one force for each displacement; got arrays of shape "
                f"{self.displacement.shape} and {self.force.shape}"
            )


def read_curve(path):
    """The `Curve` of a CSV file, in mm and mN.

    Raises CurveError, one line with the file, the line number, the value and the remedy, where the file is
    not such a table, holds fewer than 5 points, or its displacements do not rise.
    """
    path = Path(path)
    lines = list(_lines(path))
    if not lines:
        raise CurveError(f"{path}: the file is empty; it needs a header displacement_mm,force_mN and numbers below")
    number, header = lines.pop(0)
    separator = _separator(header)
    places = _columns(f"{path}: line {number}", _cells(header, separator))
    points = [_point(f"{path}: line {number}", _cells(line, separator), places, separator) for number, line in lines]
    _require_loading(path, [number for number, _ in lines], points)
    displacement, force = np.array(points).T
    return Curve(np.maximum(displacement, 0.0), force)


def write_curve(path, curve):
    """Write a `Curve` as CSV with the header displacement_mm,force_mN; the numbers read back exactly."""
    rows = [f"{d!r},{f!r}\n" for d, f in zip(curve.displacement.tolist(), curve.force.tolist(), strict=True)]
    try:
        Path(path).write_text("displacement_mm,force_mN\n" + "".join(rows), encoding="utf-8", newline="\n")
    except OSError as error:
        raise CurveError(f"{path}: cannot be written ({error.strerror}); choose another place") from error


@functools.cache
def unit_factor(unit, target):
    """What a number in `unit` is multiplied by to be in `target` (both strings that pint knows).

    Raises ValueError, a phrase to put after the name of what has the unit, where it is unknown or of another kind.
    """
    if unit == target:
        return 1.0
    import pint  # a quarter of a second, and only needed for other units

    if not NAMES_OF_UNITS.fullmatch(unit):
        raise ValueError(f"has no readable unit ({_shown(unit)}); use {target}")
    try:
        factor = _registry().Quantity(1.0, unit).to(target).magnitude
    except pint.DimensionalityError:
        raise ValueError(f"is in {unit}, which cannot be turned into {target}; give it in {target}") from None
    except Exception:  # pint's parser has many ways to say that it does not know a unit
        raise ValueError(f"has the unknown unit {_shown(unit)}; use {target}") from None
    return float(f"{factor:.14g}")


@functools.cache
def _registry():
    import pint

    return pint.UnitRegistry()


def _lines(path):
    """Number and text of each line that says something."""
    for number, line in enumerate(io.StringIO(_text(path), newline=None), start=1):
        if line.strip() and not line.lstrip().startswith("#"):
            yield number, line.rstrip("\n")


def _text(path):
    try:
        if not path.exists():
            raise CurveError(f"{path}: no such file; check the path")
        if not path.is_file():
            raise CurveError(f"{path}: not a file; name a CSV file")
        raw = path.read_bytes()
    except (OSError, ValueError) as error:
        raise CurveError(f"{path}: cannot be read ({getattr(error, 'strerror', None) or error})") from error
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw[: error.start].count(b"\n") + 1
        raise CurveError(f"{path}: line {line}: not UTF-8 text; export it as 'CSV UTF-8'") from None


def _separator(header):
    return next((mark for mark in ";\t" if mark in header), ",")


def _cells(line, separator):
    return [cell.strip().strip('"').strip() for cell in line.split(separator)]


def _columns(where, header):
    """Column and factor of the displacement and of the force, from a header such as displacement_um,force_N."""
    places = []
    for quantity, target in UNITS.items():
        found = [(place, cell) for place, cell in enumerate(header) if cell.lower().startswith(quantity + "_")]
        if len(found) != 1:
            reason = f"{len(found)} columns of {quantity}" if found else f"no column {quantity}_{target}"
            raise CurveError(
                f"{where}: header {_shown(','.join(header))} has {reason}; "
                "it must be displacement_mm,force_mN (other units by name: displacement_um, force_N)"
            )
        place, cell = found[0]
        try:
            places.append((place, unit_factor(cell[len(quantity) + 1 :], target)))
        except ValueError as error:
            raise CurveError(f"{where}: column {_shown(cell)} {error}") from None
    return len(header), *places


def _point(where, cells, places, separator):
    """Displacement and force of one line, in mm and mN."""
    width, *columns = places
    if len(cells) != width:
        hint = "; with decimal commas, separate the columns by semicolons" if separator == "," else ""
        raise CurveError(f"{where}: {_shown(separator.join(cells))} has {len(cells)} columns, the header {width}{hint}")
    return [_number(where, cells[place], separator, factor) for place, factor in columns]


def _number(where, text, separator, factor):
    try:
        if "_" in text:
            raise ValueError
        value = float(text.replace(",", ".") if separator == ";" else text) * factor
    except ValueError:
        raise CurveError(f"{where}: {_shown(text)} is not a number; correct or remove the line") from None
    if not math.isfinite(value):
        raise CurveError(f"{where}: {_shown(text)} is not a finite number; correct or remove the line")
    return value


def _require_loading(path, numbers, points):
    """Refuse what is not the loading part of one indentation, naming the first line that is wrong."""
    if len(points) < MIN_POINTS:
        raise CurveError(f"{path}: {len(points)} points; a curve needs at least {MIN_POINTS}")
    displacement, force = np.array(points).T
    where = [f"{path}: line {number}" for number in numbers]
    if not (displacement > 0).any():
        raise CurveError(
            f"{where[-1]}: displacement {displacement[-1]:g} mm: none is positive; "
            "they are positive into the sample, change the sign"
        )
    if displacement[0] < -1e-9 * np.abs(displacement).max():
        raise CurveError(
            f"{where[0]}: displacement {displacement[0]:g} mm is negative; start at the contact point, "
            "displacements positive into the sample"
        )
    for n in np.flatnonzero(np.diff(np.maximum(displacement, 0.0)) <= 0)[:1] + 1:
        wrong = f"comes after {displacement[n - 1]:g} mm; sort the lines and keep the loading only"
        if displacement[n] == displacement[n - 1]:
            wrong = "is given twice; keep one of the two lines"
        raise CurveError(f"{where[n]}: displacement {displacement[n]:g} mm {wrong}")
    if not force.any():
        raise CurveError(f"{path}: every force is zero; check the force column")
    if force[-1] <= 0:
        raise CurveError(
            f"{where[-1]}: force {force[-1]:g} mN at the deepest point is not positive; compression is positive, "
            "change the sign if your load cell counts otherwise"
        )


def _shown(text):
    """A value as it is quoted in a message: on one line and short."""
    return repr(text if len(text) <= 60 else text[:57] + "...")
