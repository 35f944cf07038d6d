"""Displacements that were measured on a sample beside the force, and their CSV file.

A line of the file is a point of the undeformed sample with one or more components of its displacement: columns such as `x_mm`,
`y (um)`, `z_mm` for its position, `ux_um`, `uy_um`, `uz_um` for its displacement, `ux_sd_um` or `sd_um` for standard deviations,
`depth_mm` for the displacement of the indenter at which it was seen. Axes are those of the sample: y is the height above the base,
the axis of indentation is x = z = 0, x runs along the indenter's long side. A point moves down where uy is negative. `r_mm` stands
for x and z where everything is round, and `ur_um` then for the displacement away from the axis. A cell without a number is a
component that was not measured. Lines that begin with `#` and empty lines are skipped.

A file of an outline holds points of the deformed outline instead, which are no material points: `z_mm`, `y_mm` in the plane x = 0,
`x_mm`, `y_mm` in the plane z = 0, or `r_mm`, `y_mm` where everything is round, with `sd_um` and `depth_mm` as above.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from indentfit.arrays import Array, Ints
from indentfit.digits import sizes
from indentfit.errors import CurveError
from indentfit.headers import cells_of, separator_of, shown
from indentfit.outlines import chain, feet_of
from indentfit.point_tables import lines_of, number_of, require_cells
from indentfit.units import unit_factor

LEAST = 3  # components that make a field
MOST = 400  # components that a fit counts with: of more, neighbours are averaged
AXES = {"x": 0, "y": 1, "z": 2}
UPWARDS = (0.0, 1.0, 0.0)
CELL = re.compile(r"(?P<name>depth|sd|u_?[xyzr]|[xyzr])(?P<sd>[\s_]+sd)?(?P<unit>[\s_(\[].*)?", re.IGNORECASE)
NAMES = "x, y, z or r (position), ux, uy, uz or ur (displacement), ux_sd ... or sd (standard deviation), depth"
NOT_MEASURED = {"", "nan", "-"}


@dataclass(frozen=True, eq=False)
class Displacements:
    """Measured components of displacements, one in each row; read-only.

    Attributes
    ----------
    points : array (m, 3), mm
        Positions on the undeformed sample: x, height y above the base, z.
    directions : array (m, 3)
        Unit vectors along which the components count positive.
    values : array (m,), mm
    sd : array (m,), mm
        Standard deviations; NaN where the file states none.
    depths : array (m,), mm
        Displacements of the indenter; NaN stands for the deepest of the test.
    file : str
        The name of the file.
    lines : array (m,)
        The line of the file of each row.
    round : bool
        Whether positions are given by their radius.
    across : 0, 2 or None
        Where the points lie on the outline of the deformed sample and are no material points, the axis (x or z) across the plane of
        the outline.
    places : array (m, 3), mm, or None
        The points on the deformed outline, once `points` are their feet on the undeformed one (`outline_on`).
    """

    points: Array
    directions: Array
    values: Array
    sd: Array
    depths: Array
    file: str = "displacements.csv"
    lines: Ints | None = None
    round: bool = False
    across: int | None = None
    places: Array | None = None

    def __post_init__(self) -> None:
        for name in ("points", "directions", "values", "sd", "depths"):
            values = np.array(getattr(self, name), dtype=float)
            values.flags.writeable = False
            object.__setattr__(self, name, values)
        m = len(self.values)
        if m < LEAST:
            raise CurveError(f"{self.file}: {m} components of displacements; a field needs at least {LEAST}")
        if any(part.shape != (m, 3) for part in (self.points, self.directions)) or any(
            part.shape != (m,) for part in (self.values, self.sd, self.depths)
        ):
            raise CurveError(f"{self.file}: a field needs a point, a direction, a value, an sd and a depth for each component")

    @classmethod
    def of(
        cls, points: Array, displacements: Array, sd: float | Array, depth: float = math.nan, name: str = "displacements.csv"
    ) -> Displacements:
        """The field of points whose displacements have components along x, y and z.

        Parameters
        ----------
        points : array (n, 3), mm
        displacements : array (n, 3), mm
            NaN where a component was not measured.
        sd : float or array (n, 3), mm
        depth : float, mm
            Displacement of the indenter; by default the deepest of the test.
        name : str

        Returns
        -------
        Displacements
        """
        points, displacements = np.asarray(points, dtype=float), np.asarray(displacements, dtype=float)
        row, axis = np.nonzero(np.isfinite(displacements))
        deviations = np.broadcast_to(np.asarray(sd, dtype=float), displacements.shape)[row, axis]
        return cls(points[row], np.eye(3)[axis], displacements[row, axis], deviations, np.full(row.size, depth), name)

    @classmethod
    def of_outline(
        cls, points: Array, sd: float | Array, depth: float = math.nan, across: str = "x", name: str = "outline.csv"
    ) -> Displacements:
        """The field of points on the outline of the deformed sample, which are no material points.

        Parameters
        ----------
        points : array (n, 2), mm
            Coordinate along the section (z, or x), and height above the base.
        sd : float or array (n,), mm
        depth : float, mm
            Displacement of the indenter; by default the deepest of the test.
        across : "x" or "z"
            The axis across the plane of the outline.
        name : str

        Returns
        -------
        Displacements
        """
        w, y = np.asarray(points, dtype=float).T
        nothing = np.zeros(w.size)
        whole = np.column_stack([nothing, y, w] if across == "x" else [w, y, nothing])
        deviations, depths = (np.broadcast_to(np.asarray(part, dtype=float), w.shape) for part in (sd, depth))
        return cls(whole, np.tile(UPWARDS, (w.size, 1)), nothing, deviations, depths, name, across=AXES[across])

    @property
    def section(self) -> list[int]:
        """The axes along the section of an outline and along the height."""
        return [2 if self.across == 0 else 0, 1]

    def outline_on(self, half_width: float, thickness: float) -> Displacements:
        """The field of an outline as apparent motions of the undeformed outline of a sample, along its normals: feet, normals, and
        distances of the points that were seen."""
        if self.across is None:
            return self
        along, seen = self.section, self.points if self.places is None else self.places
        feet = feet_of(seen[:, along], chain(half_width, thickness))
        points, normals = np.zeros_like(seen), np.zeros_like(seen)
        points[:, along], normals[:, along] = feet.places, feet.normals
        values = np.sum(feet.normals * (seen[:, along] - feet.places), axis=1)
        return replace(self, points=points, directions=normals, values=values, places=seen)

    def known(self, sd: float | None, depth: float | None, deepest: float) -> Displacements:
        """The field with standard deviations and depths where the file has none."""
        deviations = self.sd if sd is None else np.where(np.isnan(self.sd), sd, self.sd)
        depths = np.where(np.isnan(self.depths), deepest if depth is None else depth, self.depths)
        return replace(self, sd=deviations, depths=depths)

    def line(self, n: int) -> str:
        """Where the row n stands, in words."""
        return f"point {n}" if self.lines is None else f"line {int(self.lines[n])}"

    def as_lists(self) -> list[list[float | None]]:
        """All numbers, as JSON holds them."""
        places = self.points if self.places is None else self.places
        columns = np.column_stack([places, self.directions, self.values, self.sd, self.depths])
        return [[value if math.isfinite(value) else None for value in row] for row in columns.tolist()]

    @property
    def groups(self) -> Ints:
        """The number of the group of neighbours to which each row belongs, (m,): of at most MOST rows, each is its own.

        Rows of one direction and one depth are halved along their longest side until the groups are few enough.
        """
        if len(self.values) <= MOST:
            return np.arange(len(self.values))
        directions = np.round(self.directions) if self.across is not None else self.directions  # a side, or the top
        kinds = np.unique(np.round(np.column_stack([directions, self.depths]), 9), axis=0, return_inverse=True)[1].ravel()
        parts = [np.flatnonzero(kinds == kind) for kind in range(kinds.max() + 1)]
        while len(parts) < MOST and max(map(len, parts)) > 1:
            largest = parts.pop(int(np.argmax([len(part) for part in parts])))
            axis = int(np.argmax(np.ptp(self.points[largest], axis=0)))
            order = largest[np.argsort(self.points[largest, axis], kind="stable")]
            parts += [order[: order.size // 2], order[order.size // 2 :]]
        groups = np.zeros(len(self.values), dtype=int)
        for number, part in enumerate(sorted(parts, key=lambda part: int(part.min()))):
            groups[part] = number
        return groups


def averaged(points: Displacements, groups: Ints) -> tuple[Array, Array]:
    """Displacements (g,) and standard deviations (g,) of groups of rows: their means, weighed by the inverse variances."""
    weights = points.sd**-2.0
    total = np.bincount(groups, weights)
    return np.asarray(np.bincount(groups, weights * points.values) / total), np.asarray(total**-0.5)


def shares_of(points: Displacements, groups: Ints) -> Array:
    """The share (m,) of each row in the mean of its group."""
    weights = points.sd**-2.0
    return np.asarray(weights / np.bincount(groups, weights)[groups])


@dataclass(frozen=True)
class _Column:
    """One column: its name, whether it holds standard deviations, and the factor that converts its numbers to mm."""

    name: str
    deviates: bool
    factor: float


def read_displacements(path: str | Path, outline: bool = False) -> Displacements:
    """The `Displacements` of a CSV file in the form that this module describes.

    Parameters
    ----------
    path : path
    outline : bool
        Whether the file holds points on the deformed outline.

    Returns
    -------
    Displacements

    Raises
    ------
    CurveError
        The error's text is one line with the file, the line or the column, and the remedy.
    """
    path = Path(path)
    lines = list(lines_of(path))
    if not lines:
        header = "z_mm,y_mm,sd_um" if outline else "x_mm,y_mm,z_mm,uz_um,sd_um"
        raise CurveError(f"{path}: the file is empty; it needs a header such as {header} and numbers below")
    number, text = lines[0]
    separator = separator_of(text)
    columns = [_column(f"{path}: line {number}", cell) for cell in cells_of(text, separator)]
    (_require_outline if outline else _require)(f"{path}: line {number}", columns)
    table = np.array([_numbers(f"{path}: line {n}", cells_of(line, separator), columns, separator) for n, line in lines[1:]])
    rows = np.array([n for n, _ in lines[1:]], dtype=int)
    return (_outline if outline else _field)(path, columns, table.reshape(-1, len(columns)), rows)


def write_displacements(path: str | Path, field: Displacements) -> None:
    """Write a `Displacements` as CSV, a line for each component; `read_displacements` reads the same numbers.

    Parameters
    ----------
    path : path of the file, which is overwritten
    field : Displacements

    Raises
    ------
    OSError
    """
    if field.across is not None:
        _write_outline(Path(path), field)
        return
    position, axes = (("r", "y"), "ry") if field.round else (("x", "y", "z"), "xyz")
    stated, deep = bool(np.isfinite(field.sd).any()), bool(np.isfinite(field.depths).all())
    header = [*position, *(f"u{axis}" for axis in axes), *(["sd"] if stated else []), *(["depth"] if deep else [])]
    rows = [",".join(f"{name}_mm" for name in header)]
    for n, (point, direction) in enumerate(zip(field.points.tolist(), field.directions, strict=True)):
        along = int(np.argmax(np.abs(direction)))
        value = float(field.values[n] * np.sign(direction[along]))
        moved = [repr(value) if axis == along else "" for axis in range(len(axes))]
        more = [*([repr(float(field.sd[n]))] if stated else []), *([repr(float(field.depths[n]))] if deep else [])]
        rows.append(",".join([*map(repr, point[: len(position)]), *moved, *more]))
    Path(path).write_text("\n".join(rows) + "\n", encoding="utf-8", newline="\n")


def _column(where: str, cell: str) -> _Column:
    match = CELL.fullmatch(cell.strip())
    if match is None:
        raise CurveError(f"{where}: column {shown(cell)} is not known; columns are {NAMES}: rename it, or take it out")
    name, unit = match["name"].lower().replace("_", ""), (match["unit"] or "").strip("()[] _")
    if not unit:
        raise CurveError(f"{where}: column {shown(cell)} has no unit; write {cell.strip()}_mm or {cell.strip()}_um")
    try:
        return _Column(name, bool(match["sd"]), unit_factor(unit, "mm"))
    except ValueError as error:
        raise CurveError(f"{where}: column {shown(cell)} {error}") from None


def _require(where: str, columns: Sequence[_Column]) -> None:
    """Refuse a header that does not say where points are, and how one of their components moves."""
    keys = [(column.name, column.deviates) for column in columns]
    names = [name for name, deviates in keys if not deviates]
    for name, deviates in keys:
        if keys.count((name, deviates)) > 1:
            raise CurveError(f"{where}: the header has two columns of {name}{' sd' if deviates else ''}; keep one of them")
        if deviates and (name not in names or not name.startswith("u")):
            raise CurveError(f"{where}: the header has standard deviations of {name}, but only displacements have them here")
    moved = [name for name in names if name.startswith("u")]
    if not moved:
        raise CurveError(
            f"{where}: the header has no displacement; give a column ux, uy or uz with its unit, such as uz_um (or set "
            "field.outline = true, where these are points of the deformed outline)"
        )
    flat = "r" in names
    if flat and {"x", "z"} & set(names):
        raise CurveError(f"{where}: the header has r beside x or z; give the radius r, or x and z")
    if flat and {"ux", "uz"} & set(moved):
        raise CurveError(f"{where}: positions are radii; name the displacement away from the axis ur, not {moved[0]}")
    if not flat and "ur" in moved:
        raise CurveError(f"{where}: the header has ur without the radius r; give r, or ux and uz")
    for name in ("r", "y") if flat else ("x", "y", "z"):
        if name not in names:
            more = {"y": ", the height above the base (at the top it is the thickness)"}.get(name, ", the distance from the axis")
            raise CurveError(f"{where}: the header has no column {name}_mm{more}; add it")


def _require_outline(where: str, columns: Sequence[_Column]) -> None:
    """Refuse a header that does not say in which plane the points of an outline lie."""
    names = [column.name for column in columns]
    for name in names:
        if names.count(name) > 1:
            raise CurveError(f"{where}: the header has two columns of {name}; keep one of them")
    if moved := [name for name in names if name.startswith("u")]:
        raise CurveError(f"{where}: the header has {moved[0]}; points of an outline have no displacements: remove field.outline")
    if "y" not in names:
        raise CurveError(f"{where}: the header has no column y_mm, the height above the base; add it")
    along = [name for name in names if name in ("x", "z", "r")]
    if len(along) != 1:
        given = f"has {' and '.join(along)}" if along else "has neither"
        raise CurveError(f"{where}: the header {given}; an outline has z (in the plane x = 0), x (in the plane z = 0), or r")


def _numbers(where: str, cells: list[str], columns: Sequence[_Column], separator: str) -> list[float]:
    """The numbers of a line in mm; NaN where a component was not measured."""
    require_cells(where, cells, len(columns))
    values = []
    for cell, column in zip(cells, columns, strict=True):
        if cell.strip().lower() in NOT_MEASURED and (column.name.startswith("u") or column.name == "sd"):
            values.append(math.nan)
            continue
        values.append(number_of(where, cell, separator) * column.factor)
    return values


def _outline(path: Path, columns: Sequence[_Column], table: Array, lines: Ints) -> Displacements:
    by_name = {column.name: table[:, n] for n, column in enumerate(columns)}
    along = next(name for name in by_name if name in ("x", "z", "r"))
    nothing = np.full(len(table), math.nan)
    sd, depths = by_name.get("sd", nothing), by_name.get("depth", nothing)
    for n in np.flatnonzero(np.isfinite(sd) & ~(sd > 0))[:1]:
        raise CurveError(f"{path}: line {lines[n]}: standard deviation {sizes(sd[n])} must be above zero; give its error")
    for n in np.flatnonzero(by_name[along] < 0)[:1] if along == "r" else ():
        raise CurveError(
            f"{path}: line {lines[n]}: the radius is {sizes(by_name[along][n])}; write x or z where sides are told apart"
        )
    points = np.column_stack([by_name[along], by_name["y"]])
    field = Displacements.of_outline(points, sd, across="x" if along == "z" else "z", name=path.name)
    return replace(field, depths=depths, lines=lines, round=along == "r")


def _write_outline(path: Path, field: Displacements) -> None:
    seen = field.points if field.places is None else field.places
    names = ["r" if field.round else "xz"[field.across == 0], "y"]
    columns = list(seen[:, field.section].T)
    for name, values in (("sd", field.sd), ("depth", field.depths)):
        if np.isfinite(values).all():
            names.append(name)
            columns.append(values)
    rows = [",".join(f"{name}_mm" for name in names), *(",".join(map(repr, row)) for row in np.column_stack(columns).tolist())]
    path.write_text("\n".join(rows) + "\n", encoding="utf-8", newline="\n")


def _field(path: Path, columns: Sequence[_Column], table: Array, lines: Ints) -> Displacements:
    by_name = {(column.name, column.deviates): table[:, n] for n, column in enumerate(columns)}
    nothing, flat = np.full(len(table), math.nan), ("r", False) in by_name
    x = by_name[("r" if flat else "x", False)]
    points = np.column_stack([x, by_name["y", False], np.zeros(len(table)) if flat else by_name["z", False]])
    parts = []
    for name in ("ux", "uy", "uz", "ur"):
        if (name, False) not in by_name:
            continue
        values = by_name[name, False]
        sd = by_name.get((name, True), by_name.get(("sd", False), nothing))
        direction = np.eye(3)[AXES.get(name[1], 0)]
        for n in np.flatnonzero(np.isfinite(values)):
            parts.append((int(n), direction, float(values[n]), float(sd[n])))
    parts.sort(key=lambda part: part[0])
    rows = np.array([n for n, *_ in parts], dtype=int)
    sd = np.array([part[3] for part in parts])
    for n in np.flatnonzero(np.isfinite(sd) & ~(sd > 0))[:1]:
        raise CurveError(f"{path}: line {lines[rows[n]]}: standard deviation {sizes(sd[n])} must be above zero; give its error")
    depths = by_name.get(("depth", False), nothing)
    return Displacements(
        points[rows].reshape(-1, 3),
        np.array([part[1] for part in parts]).reshape(-1, 3),
        np.array([part[2] for part in parts]),
        sd,
        depths[rows],
        path.name,
        lines[rows],
        flat,
    )
