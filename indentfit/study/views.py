"""Side views of further tests: what displacements of points on a sample's side, or its outline, tell beside the force.

Points lie on the middle line of a side, in one column from the base to the top. Markers and tracks show how each point moves in the
picture; an outline shows only how far the side moves along its own normal, because a point on it is no material point.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from indentfit.arrays import Array
from indentfit.case import Case, Test
from indentfit.case.laws import has_fibres
from indentfit.case.measured_field import MeasuredField, known_points
from indentfit.displacements import Displacements, averaged
from indentfit.indenters import Rings
from indentfit.samples import Circle

SIDE_POINTS = 50  # on the height of a side
SEEN = 0.015  # of the case's largest depth: standard deviation of a displacement, by default
AXES = ("x", "z")
NUMBERS = {"x": 0, "z": 2}
MARKERS, OUTLINE = "markers", "outline"
EFFORTS = {
    MARKERS: "a camera at the side, and markers or a pattern that is tracked on it",
    OUTLINE: "a camera at the side, in line with the base",
}


@dataclass(frozen=True, eq=False)
class SideView:
    """What is seen of one side at one depth.

    Attributes
    ----------
    axis : "x" or "z"
        The axis that the side faces.
    depth : float, mm
        Of the indenter.
    points : array (n, 2), mm
        Deformed places along the axis and the height.
    slopes : array (n, 2, p), mm per unit of a parameter
        Derivatives of these places.
    """

    axis: str
    depth: float
    points: Array
    slopes: Array = field(repr=False)

    def information(self, kind: str, sd: float) -> Array:
        """Fisher's information (p, p) of markers, or of an outline, whose points have a standard deviation, mm."""
        rows = self.slopes.reshape(-1, self.slopes.shape[-1]) if kind == MARKERS else self._across()
        return np.asarray(rows.T @ rows / sd**2)

    def _across(self) -> Array:
        """Derivatives (n, p) along the normals of the deformed side."""
        along = np.gradient(self.points, axis=0)
        normals = np.column_stack([along[:, 1], -along[:, 0]]) / np.linalg.norm(along, axis=1)[:, None]
        return np.asarray(np.einsum("ni,nip->np", normals, self.slopes))


def with_views(case: Case, depths: Sequence[float]) -> Case:
    """A case whose tests are all seen from their sides at some depths, mm."""
    sample = case.sample.geometry.outline.extent, float(case.sample.thickness)
    fields = tuple(_seen(axis, sample, depths) for axis in sides_of(case))
    return case.model_copy(update={"tests": tuple(test.model_copy(update={"field": fields}) for test in case.tests)})


def sides_of(case: Case) -> tuple[str, ...]:
    """The sides of a sample that move in different ways, by the axes that they face."""
    outline = case.sample.geometry.outline
    rings = all(isinstance(case.indenter_of(test).geometry.partition(0.0), Rings) for test in case.indentations)
    return AXES[:1] if isinstance(outline, Circle) and rings and not has_fibres(case.law) else AXES


def _seen(axis: str, sample: tuple[tuple[float, float], float], depths: Sequence[float]) -> MeasuredField:
    """The field of one side at all depths: of each point its motion along the axis, and upwards."""
    extent, thickness = sample
    height, nothing = _heights(thickness), np.zeros(SIDE_POINTS)
    out = np.full(SIDE_POINTS, extent[AXES.index(axis)] / 2)
    column = np.column_stack([out, height, nothing] if axis == "x" else [nothing, height, out])
    number = len(depths) * SIDE_POINTS
    moved = np.zeros((number, 3))
    moved[:, 2 - NUMBERS[axis]] = np.nan  # the axis across the picture
    whole = Displacements.of(np.tile(column, (len(depths), 1)), moved, 1.0, name=f"side-{axis}.csv")
    return MeasuredField(file=_at(whole, np.repeat(depths, 2 * SIDE_POINTS)))


def _heights(thickness: float) -> Array:
    return np.linspace(0.02, 0.98, SIDE_POINTS) * thickness


def _at(field: Displacements, depths: Array) -> Displacements:
    return Displacements(field.points, field.directions, field.values, field.sd, depths, field.file)


def views_in(case: Case, depths: Sequence[float], rows: Sequence[tuple[Array, Array]]) -> Iterator[tuple[Test, SideView]]:
    """The SideViews of each test of a case that `with_views` made.

    Parameters
    ----------
    case : Case
    depths : sequence of float, mm
    rows : sequence of (array (m,), array (m, p))
        Displacements, mm, and their derivatives, of each field of each test.
    """
    extent, height = case.sample.geometry.outline.extent, _heights(float(case.sample.thickness))
    known = iter(rows)
    for test in case.tests:
        for axis in sides_of(case):
            moved, slopes = next(known)
            places = np.column_stack([np.full(SIDE_POINTS, extent[AXES.index(axis)] / 2), height])
            parts = zip(depths, np.split(moved, len(depths)), np.split(slopes, len(depths)), strict=True)
            for depth, own, by in parts:
                yield test, SideView(axis, depth, places + own.reshape(-1, 2), by.reshape(SIDE_POINTS, 2, -1))


def deviations_of_fields(case: Case) -> list[Array]:
    """Standard deviations (g,), mm, of the displacements of each measured field of each test of a case."""
    deviations = []
    for test in case.tests:
        sample = case.sample_of(test)
        deepest = float(case.outputs(test)[-1]) if test.field else 0.0
        for points in known_points(test.field, deepest, sample.geometry.outline, float(sample.thickness)):
            deviations.append(averaged(points, points.groups)[1])
    return deviations


def words_of(case: Case, axis: str, kind: str) -> str:
    """A side view in words; a sample whose sides all move alike has no side of an axis."""
    side = f"the side facing {axis}" if len(sides_of(case)) > 1 else "the side"
    return f"{SIDE_POINTS} markers on {side}" if kind == MARKERS else f"outline of {side}"
