"""A force-displacement curve, and its CSV file in and out.

The file has a header and at least two columns, `displacement_UNIT` and `force_UNIT` (or `Displacement (mm)`, `Load (gf)`; see
`headers`), in any order. A column such as `force_sd_mN` or `Force SD (mN)` holds the standard deviation of each force, and a column
such as `time_s` or `Time (ms)` the time of each point: a curve with times may go on over a hold and a retraction. Other columns
are ignored, and named in the curve's notes where they hold a retraction, or standard deviations of the displacement. Columns are
separated by commas, tabs or blanks, or by semicolons, and only then may numbers have a decimal comma. Lines that begin with `#` and
empty lines are skipped, but for `# contact point +- 0.003 mm (standard deviation)`, which `process` writes as the last line. The
force is that of the full sample, positive in compression; displacements are positive into the sample and rise from line to line.

A test without an indenter may have a column `strain`, `strain_percent` or `stretch` in place of the displacement, and `stress_kPa`
in place of the force. In memory its strains and stresses are positive both in tension and in compression, as the test says; in a
file of a test in compression they, its displacements and its forces may all be negative.
"""

from __future__ import annotations

import io
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from indentfit.arrays import Array, Ints
from indentfit.axes import INDENTATION, Axes, Translation
from indentfit.errors import CurveError
from indentfit.headers import UNITS, Header, cells_of, columns_of, find_header, separator_of, shown, with_units_below
from indentfit.units import unit_factor

MIN_POINTS = 5
TIME = re.compile(r"(?:time|t)(?P<rest>|[_(\[\s].*)", re.IGNORECASE)
CONTACT = re.compile(r"^# contact point \+- (?P<sd>\d[\d.]*(?:e-?\d+)?) mm \(standard deviation\)\s*$", re.MULTILINE)
SMALLEST_SD = 1e-3  # of the median: a single point with a smaller standard deviation would decide a fit


@dataclass(frozen=True, eq=False)
class Curve:
    """One indentation, read-only.

    Attributes
    ----------
    displacement : array (n,), mm
        Displacement of the indenter into the sample, from the contact point. Lists and columns of a pandas frame are converted.
    force : array (n,), mN
        Force on the full sample, positive in compression.
    notes : tuple of str
        What a reader should know of the file: columns that were left out.
    contact : float or None, mm
        Standard deviation of the contact point, where the record of the curve tells it.
    sd : array (n,), mN, or None
        Standard deviation of each force, where it is known: points weigh by the inverse squares.
    time : array (n,), s, or None
        Rising times of the points, from any moment on; only a material that relaxes takes notice of them.
    axes : Axes or None
        What displacement and force are, where that is known; a strain is the displacement of a length of 1 mm, a stress in kPa the
        force on 1 mm^2.

    Raises
    ------
    CurveError
        They hold other values than numbers, or different numbers of values.
    """

    displacement: Array
    force: Array
    notes: tuple[str, ...] = ()
    contact: float | None = None
    sd: Array | None = None
    time: Array | None = None
    axes: Axes | None = None

    def __post_init__(self) -> None:
        for name in (*UNITS, "sd", "time"):
            if getattr(self, name) is None:
                continue
            try:
                values = np.array(getattr(self, name), dtype=float)
            except (TypeError, ValueError) as error:
                raise CurveError(f"the {name} of a curve must be numbers ({error}); correct or remove the other values") from None
            values.flags.writeable = False
            object.__setattr__(self, name, values)
        if self.displacement.ndim != 1 or self.displacement.shape != self.force.shape:
            raise CurveError(
                f"a curve needs one force for each displacement; got arrays of shape "
                f"{self.displacement.shape} and {self.force.shape}"
            )
        for name, own in (("sd", self.sd), ("time", self.time)):
            if own is not None and own.shape != self.force.shape:
                shapes = f"{self.force.shape} and {own.shape}"
                raise CurveError(f"a curve needs one {name} for each force; got arrays of shape {shapes}")

    @property
    def columns(self) -> list[Array]:
        """Displacements, forces, and standard deviations where they are known."""
        return [self.displacement, self.force, *([] if self.sd is None else [self.sd])]

    @property
    def stated_noise(self) -> float:
        """The standard deviation, mN, of a point of mean weight; 0 where none is known."""
        return 0.0 if self.sd is None else float(1 / np.sqrt(np.mean(1 / self.sd**2)))

    @property
    def trust(self) -> Array:
        """Factors (n,) on the residuals: in inverse proportion to the standard deviations, with 1 as the mean of their squares."""
        return np.ones(self.force.size) if self.sd is None else self.stated_noise / self.sd

    def with_force(self, force: Array) -> Curve:
        """Other forces with the displacements, standard deviations and times of this curve."""
        return Curve(self.displacement, force, (), self.contact, self.sd, self.time, self.axes)

    @property
    def shown(self) -> Axes:
        """What displacement and force are, in texts and figures."""
        return self.axes or INDENTATION

    @property
    def loading(self) -> Curve:
        """The part of the curve in which each point is deeper than all before it; the curve itself where it has no times."""
        if self.time is None:
            return self
        before = np.maximum.accumulate(np.concatenate([[-1.0], self.displacement[:-1]]))
        deeper = self.displacement > before
        return self if deeper.all() else self.part(np.flatnonzero(deeper))

    def part(self, numbers: Ints) -> Curve:
        """The curve of some of the points, by their numbers."""
        sd, time = (None if values is None else values[numbers] for values in (self.sd, self.time))
        return Curve(self.displacement[numbers], self.force[numbers], self.notes, self.contact, sd, time, self.axes)

    @property
    def deepest(self) -> float:
        """The largest displacement, mm."""
        return float(self.displacement.max())

    def __repr__(self) -> str:
        axes = self.shown
        last = f" to {axes.at(self.displacement[-1])} and {self.force[-1]:.4g} {axes.up_unit}" if self.displacement.size else ""
        return f"Curve({self.displacement.size} points{last})"


def read_curve(path: str | Path, loading: str = "") -> Curve:
    """The `Curve` of a CSV file, in mm and mN.

    Parameters
    ----------
    path : path of a file in the form that this module describes
    loading : "tension", "compression" or "shear"
        How a specimen without an indenter is loaded; empty for an indentation.

    Returns
    -------
    Curve

    Raises
    ------
    CurveError
        The file is not such a table, holds fewer than 5 points, or its displacements do not rise. The error's text is one line
        with the file, the line number, the value and the remedy.
    """
    path = Path(path)
    text = _text(path)
    lines = list(_lines(text))
    if not lines:
        raise CurveError(f"{path}: the file is empty; it needs a header displacement_mm,force_mN and numbers below")
    translation = _translated(path, lines) if loading else None
    header, separator = _header(path, lines)
    points = [_point(f"{path}: line {number}", cells_of(line, separator), header, separator) for number, line in lines]
    numbers = [number for number, _ in lines]
    time, missing = _times(path, header.cells, lines, separator)
    if translation is not None and points:
        points = translation.points(points, loading == "compression")
    axes = translation.axes if translation is not None else INDENTATION
    _require_loading(path, numbers, points, time, axes)
    displacement, force, *sd = np.array(points).T
    for n, text_of_fault in _not_deviations(sd[0] if sd else None, axes):
        raise CurveError(f"{path}: line {lines[n][0]}: {text_of_fault}")
    stated = CONTACT.search(text)
    contact = float(stated["sd"]) if stated else None
    deviations = sd[0] if sd else None
    known = axes if translation is not None else None
    return Curve(np.maximum(displacement, 0.0), force, (*header.notes, *missing), contact or None, deviations, time, known)


def _translated(path: Path, lines: list[tuple[int, str]]) -> Translation:
    """What the first line says of strains and stresses; in the lines their names become those of displacements and forces."""
    number, text = lines[0]
    separator = separator_of(text)
    translation = Translation.of(f"{path}: line {number}", cells_of(text, separator))
    lines[0] = number, separator.join(translation.cells)
    return translation


def _header(path: Path, lines: list[tuple[int, str]]) -> tuple[Header, str]:
    """The header and the separator of a file's lines, of which those above the numbers are taken away."""
    place = find_header(lines)
    number, text = lines[place]
    separator = separator_of(text)
    cells = cells_of(text, separator)
    below = with_units_below(cells, lines[place + 1][1], separator) if len(lines) > place + 1 else None
    del lines[: place + (1 if below is None else 2)]
    header = columns_of(f"{path}: line {number}", below or cells)
    return (replace(header, notes=(f"{place} lines above the header are skipped", *header.notes)) if place else header), separator


def require_loading(curve: Curve) -> None:
    """Refuse a curve in memory that is not the loading part of one indentation, or with times an indentation with its hold.

    Parameters
    ----------
    curve : Curve

    Raises
    ------
    CurveError
        The error's text names the point that is at fault, counted from 0.
    """
    displacement, force = curve.displacement, curve.force
    if len(displacement) < MIN_POINTS:
        raise CurveError(f"{len(displacement)} points; a curve needs at least {MIN_POINTS}")
    if not (np.isfinite(displacement).all() and np.isfinite(force).all()):
        raise CurveError("holds numbers that are not finite; leave these points out")
    for n, text in _not_loading(displacement, force, curve.time, curve.shown):
        raise CurveError(text if n is None else f"point {n}: {text}")
    for n, text in _not_deviations(curve.sd, curve.shown):
        raise CurveError(f"point {n}: {text}")


def not_loading_only(curve: Curve) -> str:
    """Why a curve is not the loading part of an indentation alone: its first point that is not deeper than the one before it; empty
    where each is."""
    texts = _not_rising(curve.displacement, timed=curve.time is not None)
    return next((text if curve.time is None else f"at {curve.time[n]:g} s {text}" for n, text in texts), "")


def write_curve(path: str | Path, curve: Curve) -> None:
    """Write a `Curve` as CSV with the header displacement_mm,force_mN (force_sd_mN, time_s); `read_curve` reads exactly the same
    numbers.

    Parameters
    ----------
    path : path of the file, which is overwritten
    curve : Curve

    Raises
    ------
    CurveError
        The file cannot be written.
    """
    columns, (across, up) = curve.columns, curve.shown.header
    header = ",".join((across, up, up.replace("_", "_sd_"))[: len(columns)])
    if curve.time is not None:
        columns, header = [*columns, curve.time], f"{header},time_s"
    rows = [",".join(map(repr, row)) + "\n" for row in zip(*(column.tolist() for column in columns), strict=True)]
    rows += [f"# contact point +- {float(curve.contact)!r} mm (standard deviation)\n"] if curve.contact else []
    try:
        Path(path).write_text(f"{header}\n{''.join(rows)}", encoding="utf-8", newline="\n")
    except OSError as error:
        raise CurveError(f"{path}: cannot be written ({error.strerror}); choose another place") from error


def _lines(text: str) -> Iterator[tuple[int, str]]:
    """Number and text of each line that is neither empty nor a comment."""
    for number, line in enumerate(io.StringIO(text, newline=None), start=1):
        if line.strip() and not line.lstrip().startswith("#"):
            yield number, line.rstrip("\n")


def _text(path: Path) -> str:
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


def _not_deviations(sd: Array | None, axes: Axes) -> Iterator[tuple[int, str]]:
    """The first standard deviation that cannot be a weight, as (number of its point, what is wrong)."""
    if sd is None:
        return
    wrong = ~(np.isfinite(sd) & (sd > 0))
    if wrong.any():
        n = int(np.argmax(wrong))
        text = (
            f"must be above zero: a {axes.up} without an error would have all of the weight; leave the line out, or give its error"
        )
        yield n, f"standard deviation {sd[n]:g} {axes.up_unit} {text}"
    elif sd.min() < SMALLEST_SD * np.median(sd):
        n = int(np.argmin(sd))
        median = f"{np.median(sd):.3g} {axes.up_unit}"
        text = f"is below {SMALLEST_SD:g} of the median, {median}: this point alone would decide a fit; give its error"
        yield n, f"standard deviation {sd[n]:.3g} {axes.up_unit} {text}"


def _point(where: str, cells: list[str], header: Header, separator: str) -> list[float]:
    """Displacement and force of one line, in mm and mN."""
    if len(cells) != header.width:
        hint = "; with decimal commas, separate the columns by semicolons" if separator == "," else ""
        raise CurveError(f"{where}: {shown(separator.join(cells))} has {len(cells)} columns, the header {header.width}{hint}")
    return [_number(where, cells[place], separator, factor) for place, factor in header.columns]


def _number(where: str, text: str, separator: str, factor: float) -> float:
    try:
        if "_" in text:
            raise ValueError
        value = float(text.replace(",", ".") if separator == ";" else text) * factor
    except ValueError:
        raise CurveError(f"{where}: {shown(text)} is not a number; correct or remove the line") from None
    if not math.isfinite(value):
        raise CurveError(f"{where}: {shown(text)} is not a finite number; correct or remove the line")
    return value


def _times(path: Path, header: Sequence[str], lines: list[tuple[int, str]], separator: str) -> tuple[Array | None, list[str]]:
    """Times of the points in s, where a column tells them; and a note where the column cannot be used."""
    places = [(place, match["rest"].strip("()[] _")) for place, cell in enumerate(header) if (match := TIME.fullmatch(cell))]
    if len(places) != 1:
        return None, [f"{len(places)} columns of time are left out; keep one of them"] if places else []
    (place, unit), where = places[0], f"the column {shown(header[places[0][0]])} is left out"
    try:
        factor = unit_factor(unit or "s", "s")
    except ValueError as error:
        return None, [f"{where}: it {error}"]
    values = []
    for number, line in lines:
        try:
            values.append(_number(f"{path}: line {number}", cells_of(line, separator)[place], separator, factor))
        except CurveError:
            return None, [f"{where}: line {number} has no number"]
    for n in np.flatnonzero(np.diff(values) <= 0)[:1] + 1:
        return None, [f"{where}: line {lines[n][0]} is not later than the line before it"]
    return np.array(values), []


def _require_loading(path: Path, numbers: list[int], points: list[list[float]], time: Array | None, axes: Axes) -> None:
    """Refuse points that are not the loading part of one indentation, or with times not an indentation with its hold; the error
    names the first wrong line."""
    if len(points) < MIN_POINTS:
        raise CurveError(f"{path}: {len(points)} points; a curve needs at least {MIN_POINTS}")
    displacement, force = np.array(points).T[:2]
    for n, text in _not_loading(displacement, force, time, axes):
        raise CurveError(f"{path}: line {numbers[n]}: {text}" if n is not None else f"{path}: {text}")


def _not_loading(
    displacement: Array, force: Array, time: Array | None = None, axes: Axes = INDENTATION
) -> Iterator[tuple[int | None, str]]:
    """What is wrong with the loading part of an indentation, or with times of an indentation with its hold and retraction, with the
    point's index where one is at fault."""
    unit, start, positive = " mm", "the contact point", "into the sample"
    if axes.across == "strain":
        unit, start, positive = "", "zero", "in the direction of test.loading (a compression may have negative ones)"
    if not (displacement > 0).any():
        text = (
            f"{axes.across} {displacement[-1]:g}{unit}: none is positive; {axes.across}s are positive {positive}, change the sign"
        )
        yield len(displacement) - 1, text
    if displacement[0] < -1e-9 * np.abs(displacement).max():
        text = f"is negative; start at {start}, {axes.across}s positive {positive}"
        yield 0, f"{axes.across} {displacement[0]:g}{unit} {text}"
    if time is None:
        yield from _not_rising(displacement, axes)
    elif not np.isfinite(time).all():
        yield int(np.argmin(np.isfinite(time))), "the time is not a finite number; leave the point out"
    elif (np.diff(time) <= 0).any():
        n = int(np.argmax(np.diff(time) <= 0)) + 1
        yield n, f"time {time[n]:g} s comes after {time[n - 1]:g} s; times must rise"
    if not force.any():
        yield None, f"every {axes.up} is zero; check the {axes.up} column"
    deepest = len(force) - 1 if time is None else int(np.argmax(displacement))
    if force[deepest] <= 0:
        at = "at the deepest point is not positive; compression is positive, change the sign if your load cell counts otherwise"
        if axes != INDENTATION:
            at = f"at the largest {axes.across} is not positive; it must point in the direction of the loading"
        yield deepest, f"{axes.up} {force[deepest]:g} {axes.up_unit} {at}"


def _not_rising(displacement: Array, axes: Axes = INDENTATION, timed: bool = False) -> Iterator[tuple[int, str]]:
    """The first point of a loading, `timed` or not, that is not deeper than the one before it."""
    unit = " mm" if axes.across == "displacement" else ""
    for n in map(int, np.flatnonzero(np.diff(np.maximum(displacement, 0.0)) <= 0)[:1] + 1):
        wrong = f"comes after {displacement[n - 1]:g}{unit}; sort the lines and keep the loading only"
        if _rests(displacement, n):
            wrong = "is held from here on; keep the loading before it" + (
                "" if timed else ", or add a column time_s to fit the hold"
            )
        elif _turns(displacement, n):
            wrong = f"comes after {displacement[n - 1]:g}{unit}: from here on the indenter goes back; keep the loading before it"
        elif displacement[n] == displacement[n - 1]:
            wrong = "is given twice; keep one of the two lines"
        yield n, f"{axes.across} {displacement[n]:g}{unit} {wrong}"


def _rests(displacement: Array, n: int) -> bool:
    """Whether the points from n on begin with a hold of the largest depth: several at that of the one before, and none deeper."""
    held = displacement[n - 1 : n + 3]
    return bool(held.size == 4 and held[0] > 0 and np.all(held == held[0]) and not np.any(displacement > held[0]))


def _turns(displacement: Array, n: int) -> bool:
    """Whether the points from n on are those of an unloading: several, none of which is deeper than the one before it."""
    return bool(len(displacement) - n > 3 and np.all(np.diff(displacement[n - 1 :]) <= 0))
