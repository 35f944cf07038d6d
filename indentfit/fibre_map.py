"""Directions of fibres that were measured on points of the sample, and their CSV file.

A line of the file is a point of the undeformed sample with the direction of its fibres: columns such as `x_mm`, `z_mm` and `y_mm`
(height above the base; without it, directions are those of the whole depth), and `angle_deg` with `dip_deg` (0 without it), or the
components `ax`, `ay`, `az` of a vector of any length (`ay` is 0 without it). Axes are those of the sample in a test of angle 0: y
is the axis of indentation, x runs along the indenter's long side. A direction and its opposite are the same fibres: between points
the mean of the dyads a a^T counts, of which the direction is the axis of the largest eigenvalue. Lines that begin with `#` and
empty lines are skipped.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from indentfit.arrays import Array, Ints
from indentfit.errors import CurveError
from indentfit.headers import cells_of, separator_of, shown
from indentfit.point_tables import lines_of, number_of, require_cells
from indentfit.units import unit_factor

NEIGHBOURS = 8  # points of which a direction between points is the mean
MOST = 5000  # points between which a map is judged
LEAST = 3  # points that make a map
ALIKE = 1e-3  # sine of the angle between a direction and its image that still counts as the same
VAGUE = 0.1  # difference of the two largest eigenvalues of a mean dyad below which it has no direction
CELL = re.compile(r"(?P<name>angle|dip|a[xyz]|[xyz])(?P<unit>[\s_(\[].*)?", re.IGNORECASE)
NAMES = "x, y, z (position), and angle, dip or ax, ay, az (direction)"
MIRRORS = {"x": np.array([-1.0, 1.0, 1.0]), "z": np.array([1.0, 1.0, -1.0]), "turn": np.array([-1.0, 1.0, -1.0])}


@dataclass(frozen=True, eq=False)
class FibreMap:
    """Directions of fibres on points; read-only, and equal where the numbers are.

    Attributes
    ----------
    points : array (m, 3), mm
        Positions on the undeformed sample: x, height y above the base, z; y is NaN where directions are those of all heights.
    directions : array (m, 3)
        Unit vectors.
    file : str
        The name of the file.
    lines : array (m,) or None
        The line of the file of each point.
    angle : float, degrees
        Angle by which the sample, points and fibres, is turned about y, from x towards z.
    """

    points: Array
    directions: Array
    file: str = "fibres.csv"
    lines: Ints | None = None
    angle: float = 0.0

    def __post_init__(self) -> None:
        for name in ("points", "directions"):
            values = np.array(getattr(self, name), dtype=float)
            if values.ndim != 2 or values.shape[1] != 3:
                raise CurveError(f"{self.file}: points and directions of fibres are arrays (m, 3)")
            values.flags.writeable = False
            object.__setattr__(self, name, values)
        if len(self.points) != len(self.directions) or len(self.points) < LEAST:
            raise CurveError(f"{self.file}: {len(self.points)} points; directions of fibres need at least {LEAST}")
        lengths = np.linalg.norm(self.directions, axis=1)
        if not (np.isfinite(lengths) & (np.abs(lengths - 1) < 1e-9)).all():
            raise CurveError(f"{self.file}: directions of fibres are unit vectors")

    def __eq__(self, other: object) -> bool:
        return isinstance(other, FibreMap) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)

    @cached_property
    def _key(self) -> tuple[bytes, bytes, float]:
        return self.points.tobytes(), self.directions.tobytes(), self.angle

    def line(self, n: int) -> str:
        """Where the point n stands, in words."""
        return f"point {n}" if self.lines is None else f"line {int(self.lines[n])}"

    def as_lists(self) -> list[list[float | None]]:
        """All numbers, as JSON holds them."""
        columns = np.column_stack([self.points, self.directions])
        return [[value if math.isfinite(value) else None for value in row] for row in columns.tolist()]

    def turned(self, angle: float) -> FibreMap:
        """The map of the sample turned further about y, degrees."""
        return replace(self, angle=self.angle + angle) if angle else self

    @property
    def deep(self) -> bool:
        """Whether directions change with the height."""
        return bool(np.isfinite(self.points[:, 1]).all())

    def at(self, places: Array) -> Array:
        """Unit vectors (3, n) at places (3, n), mm, on the undeformed sample below the indenter."""
        _, vectors = np.linalg.eigh(self._means(places))
        return np.ascontiguousarray((self._turn @ vectors[..., -1].T) + 0.0)

    def vagueness(self, places: Array) -> Array:
        """Differences (n,) of the two largest eigenvalues of the mean dyads: 1 where neighbours agree, 0 for no direction."""
        values = np.linalg.eigvalsh(self._means(places))
        return np.asarray(values[:, -1] - values[:, -2])

    def distances(self, places: Array) -> Array:
        """Distances (n,), mm, of places (3, n) from the nearest point."""
        distances, _ = self._tree.query(self._coordinates(places))
        return np.asarray(distances)

    def _means(self, places: Array) -> Array:
        """Mean dyads (n, 3, 3) in the sample's own axes, of its neighbours with the weights ((R - d) / (R d))^2, where d is the
        distance and R that of the first point that does not count (Franke, Nielson 1980): continuous, and the points' own there."""
        count = min(NEIGHBOURS, len(self.points) - 1)
        distances, nearest = self._tree.query(self._coordinates(places), count + 1)
        reach = np.maximum(distances[:, -1:], 1e-12)
        d = np.maximum(distances[:, :-1], 1e-9 * reach)
        weights = ((reach - d) / (reach * d)) ** 2
        lone = ~(weights.sum(axis=1) > 0)  # all neighbours are equally far
        weights[lone] = 1.0
        a = self.directions[nearest[:, :-1]]
        dyads = np.einsum("nk,nki,nkj->nij", weights, a, a)
        return np.asarray(dyads / weights.sum(axis=1)[:, None, None])

    @cached_property
    def _tree(self) -> cKDTree:  # type: ignore[name-defined]  # noqa: F821
        from scipy.spatial import cKDTree  # validate needs none of it without a map

        return cKDTree(self.points[:, self._axes])

    @property
    def _axes(self) -> list[int]:
        return [0, 1, 2] if self.deep else [0, 2]

    @property
    def _turn(self) -> Array:
        c, s = math.cos(math.radians(self.angle)), math.sin(math.radians(self.angle))
        return np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]])

    def _coordinates(self, places: Array) -> Array:
        return np.asarray(self._turn.T @ places).T[:, self._axes]

    def keeps(self, image: str, places: Array) -> bool:
        """Whether the fibres are their own image: in the plane x = 0 or z = 0 ("x", "z"), or turned by 180 degrees about y.

        Parameters
        ----------
        image : str
        places : array (3, n), mm
            Where they are compared.
        """
        signs = MIRRORS[image][:, None]
        along = np.abs((self.at(places) * (signs * self.at(signs * places))).sum(axis=0))
        return bool((along > 1 - ALIKE**2 / 2).all())

    @property
    def own_places(self) -> Array:
        """The points of the map itself (3, m), turned as it is; at the height 0 where directions are those of all heights."""
        return np.asarray(self._turn @ np.nan_to_num(self.points).T)

    @property
    def between(self) -> Array:
        """Places (3, n) in the middle between points and their neighbours, of many points of some of them."""
        count, some = min(4, len(self.points) - 1), np.arange(0, len(self.points), 1 + len(self.points) // MOST)
        _, nearest = self._tree.query(self.points[some][:, self._axes], count + 1)
        points = np.nan_to_num(self.points)
        return np.asarray(self._turn @ ((points[some][:, None] + points[nearest[:, 1:]]) / 2).reshape(-1, 3).T)

    @property
    def words(self) -> str:
        """The map for people."""
        return f"{len(self.points)} directions of {self.file}"


@dataclass(frozen=True)
class _Column:
    """One column: its name, and the factor that converts its numbers to mm or degrees."""

    name: str
    factor: float


def read_fibre_map(path: str | Path) -> FibreMap:
    """The `FibreMap` of a CSV file in the form that this module describes.

    Raises
    ------
    CurveError
        The error's text is one line with the file, the line or the column, and the remedy.
    """
    path = Path(path)
    lines = list(lines_of(path))
    if not lines:
        raise CurveError(f"{path}: the file is empty; it needs a header such as x_mm,z_mm,angle_deg and numbers below")
    number, text = lines[0]
    separator = separator_of(text)
    columns = [_column(f"{path}: line {number}", cell) for cell in cells_of(text, separator)]
    names = [column.name for column in columns]
    _require(f"{path}: line {number}", names)
    table = [_numbers(f"{path}: line {n}", cells_of(line, separator), columns, separator) for n, line in lines[1:]]
    by_name = dict(zip(names, np.array(table).reshape(-1, len(names)).T, strict=True))
    rows = np.array([n for n, _ in lines[1:]], dtype=int)
    nothing = np.zeros(len(rows))
    if "angle" in by_name:
        angle, dip = np.radians(by_name["angle"]), np.radians(by_name.get("dip", nothing))
        vectors = np.column_stack([np.cos(dip) * np.cos(angle), np.sin(dip), np.cos(dip) * np.sin(angle)])
    else:
        vectors = np.column_stack([by_name["ax"], by_name.get("ay", nothing), by_name["az"]])
    lengths = np.linalg.norm(vectors, axis=1)
    for n in np.flatnonzero(~(lengths > 0))[:1]:
        raise CurveError(f"{path}: line {rows[n]}: the direction (0, 0, 0) is none; correct or remove the line")
    points = np.column_stack([by_name["x"], by_name.get("y", np.full(len(rows), math.nan)), by_name["z"]])
    _, first = np.unique(np.nan_to_num(points), axis=0, return_index=True)
    if len(first) < len(points):
        n = int(min(set(range(len(points))) - set(first.tolist())))
        raise CurveError(f"{path}: line {rows[n]}: another line has the same point; keep one of them")
    lengths = np.where(np.abs(lengths - 1) < 1e-12, 1.0, np.maximum(lengths, 1e-300))  # a vector that was written is read as it was
    return FibreMap(points, vectors / lengths[:, None], path.name, rows)


def write_fibre_map(path: str | Path, fibres: FibreMap) -> None:
    """Write a `FibreMap` as CSV; `read_fibre_map` reads the same numbers. Raises OSError."""
    columns = [0, 1, 2] if fibres.deep else [0, 2]
    rows = [",".join([*(f"{'xyz'[axis]}_mm" for axis in columns), "ax", "ay", "az"])]
    for point, vector in zip(fibres.points.tolist(), fibres.directions.tolist(), strict=True):
        rows.append(",".join([*(repr(point[axis]) for axis in columns), *map(repr, vector)]))
    Path(path).write_text("\n".join(rows) + "\n", encoding="utf-8", newline="\n")


def _column(where: str, cell: str) -> _Column:
    match = CELL.fullmatch(cell.strip())
    if match is None:
        raise CurveError(f"{where}: column {shown(cell)} is not known; columns are {NAMES}: rename it, or take it out")
    name, unit = match["name"].lower(), (match["unit"] or "").strip("()[] _")
    if name in ("ax", "ay", "az"):
        if unit:
            raise CurveError(f"{where}: column {shown(cell)} has a unit; components of a direction have none: write {name}")
        return _Column(name, 1.0)
    wanted = "degree" if name in ("angle", "dip") else "mm"
    if not unit:
        units = f"{name}_deg or {name}_rad" if wanted == "degree" else f"{name}_mm or {name}_um"
        raise CurveError(f"{where}: column {shown(cell)} has no unit; write {units}")
    try:
        return _Column(name, unit_factor(unit, wanted))
    except ValueError as error:
        raise CurveError(f"{where}: column {shown(cell)} {error}") from None


def _require(where: str, names: Sequence[str]) -> None:
    """Refuse a header that does not say where points are, and in which direction their fibres run."""
    for name in names:
        if names.count(name) > 1:
            raise CurveError(f"{where}: the header has two columns of {name}; keep one of them")
    for name in ("x", "z"):
        if name not in names:
            raise CurveError(f"{where}: the header has no column {name}_mm, the position; add it")
    vector = {"ax", "ay", "az"} & set(names)
    if "angle" in names and vector:
        raise CurveError(f"{where}: the header has angles and components; give angle (and dip), or ax, ay and az")
    if "angle" not in names and not {"ax", "az"} <= vector:
        raise CurveError(f"{where}: the header has no direction; give a column angle_deg, or ax and az")
    if "dip" in names and "angle" not in names:
        raise CurveError(f"{where}: the header has dips beside components; give ay in their place")


def _numbers(where: str, cells: list[str], columns: Sequence[_Column], separator: str) -> list[float]:
    """The numbers of a line, in mm and degrees."""
    require_cells(where, cells, len(columns))
    return [number_of(where, cell, separator) * column.factor for cell, column in zip(cells, columns, strict=True)]
