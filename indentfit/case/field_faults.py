"""Faults of measured displacements: points outside of the sample, depths beyond the test, standard deviations that are missing."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from indentfit.case.faults import Parts, depth_of, labels, own_table
from indentfit.case.measured_field import MeasuredField, half_width
from indentfit.case.messages import Fault, Key
from indentfit.case.tables import Test
from indentfit.displacements import Displacements
from indentfit.samples import Circle, Outline, outside

FARTHEST = 1.5  # of the indenter's displacement: as far as a point of the outline may lie from the undeformed one
INTO = 0.01  # of the thickness: as far outside as a point of the sample's surface may be measured


def faults_of_fields(parts: Parts) -> Iterator[Fault]:
    """Faults of measured displacements that cannot belong to their test."""
    names = labels([test and test.name for test in parts.tests])
    for label, test, curve in zip(names, parts.tests, parts.curves, strict=True):
        if test is None or not test.field or test.kind != "indentation":
            continue
        if parts.material is not None and parts.material.relaxation is not None:
            text = "is not taken where the material relaxes; remove [material.relaxation], or the field"
            yield Fault(("test", label, "field"), "...", text)
            continue
        sample, indenter = own_table(parts.sample, test.sample), own_table(parts.indenter, test.indenter)
        shape = sample.geometry_if_right() if sample is not None else None
        for n, field in enumerate(test.field):
            place: Key = ("test", label, "field", n if len(test.field) > 1 else field.label)
            if isinstance(field.file, str) or sample is None or shape is None or indenter is None:
                continue
            yield from _of_names(place, test, n)
            yield from _of_one(place, field, field.file, shape.outline, float(sample.thickness), depth_of(test, curve))
            if field.file.round and not isinstance(shape.outline, Circle):
                yield Fault((*place, "file"), field.file.file, "gives radii, but the sample is not round; give x and z")


def _of_names(place: Key, test: Test, n: int) -> Iterator[Fault]:
    if test.field[n].label in [other.label for other in test.field[:n]]:
        yield Fault((*place, "name"), test.field[n].label, "is the name of two fields of the test; give each its own")


def _of_outline(
    place: Key, seen: Displacements, extent: tuple[float, float], thickness: float, deepest: float | None
) -> Iterator[Fault]:
    """The fault of a point that is farther from the undeformed outline than the indenter can have moved it."""
    assert seen.places is not None  # it was put on the sample
    away = np.linalg.norm(seen.places - seen.points, axis=1)
    n, most = int(np.argmax(away)), FARTHEST * (thickness if deepest is None else deepest)
    if away[n] > most:
        where = ", ".join(f"{value:.4g}" for value in seen.places[n, seen.section])
        width = extent[1 if seen.across == 0 else 0]
        text = (
            f"{seen.line(n)}: ({where}) mm lies {away[n]:.3g} mm from the outline of the undeformed sample, {width:.4g} mm "
            f"wide and {thickness:.4g} mm high; the indenter moves no part of it by more than {most:.3g} mm: check the units, and "
            "where positions are counted from"
        )
        yield Fault((*place, "file"), seen.file, text)


def _of_one(
    place: Key, field: MeasuredField, points: Displacements, outline: Outline, thickness: float, deepest: float | None
) -> Iterator[Fault]:
    if field.sd is None and np.isnan(points.sd).any():
        text = (
            f"has no standard deviation ({points.line(int(np.argmax(np.isnan(points.sd))))}); add a column sd_um, or set field.sd"
        )
        yield Fault((*place, "file"), points.file, text)
    if field.outline != (points.across is not None):
        text = "holds displacements; remove field.outline" if field.outline else "holds points of an outline; set field.outline"
        yield Fault((*place, "file"), points.file, text)
        return
    if points.across is not None:
        seen = points.outline_on(half_width(points, outline), thickness)
        yield from _of_outline(place, seen, outline.extent, thickness, deepest)
    elif not points.values.any():
        yield Fault((*place, "file"), points.file, "every displacement is zero; check the columns of the displacements")
    beyond = outside(points.points, outline, thickness)
    n = int(np.argmax(beyond))
    if points.across is None and beyond[n] > INTO * thickness:
        where, extent = ", ".join(f"{value:.4g}" for value in points.points[n]), outline.extent
        text = (
            f"{points.line(n)}: the point ({where}) mm lies {beyond[n]:.3g} mm outside the sample, {extent[0]:.4g} x "
            f"{thickness:.4g} x {extent[1]:.4g} mm about (0, {thickness / 2:.4g}, 0); check the units of the positions, and where "
            "they are counted from"
        )
        yield Fault((*place, "file"), points.file, text)
    if deepest is None:
        return
    depths = points.known(None, field.depth, deepest).depths
    n = int(np.argmax(depths))
    if not depths.min() > 0:
        yield Fault((*place, "file"), points.file, f"{points.line(int(np.argmin(depths)))}: the depth must be above 0")
    elif depths[n] > deepest * (1 + 1e-9):
        text = f"{points.line(n)}: was seen at a depth of {depths[n]:.4g} mm, and the test goes to {deepest:.4g} mm"
        yield Fault((*place, "file"), points.file, text)
