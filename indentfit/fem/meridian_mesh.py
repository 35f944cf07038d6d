"""Meshes of the meridian plane of a round sample, sized by the contact: fine where the contact's end passes, and at a sharp edge.

Under an indenter whose contact grows, the contact's end passes every radius up to that at the largest depth: elements are there a
CONTACT-th of that radius wide, so that the force is right along the whole path, and grow away from it. At the sharp edge of a flat
punch the stress is singular: elements grow from EDGE times the punch's radius (or the thickness, where that is less). The constants
were chosen by comparison with exact elastic layers and with another code's large strains (tests/test_axisymmetric.py).

All widths are in proportion to the mesh's scale. SCALE is that of the usual error of the force, 1 %, and keeps 0.3 % on most exact
elastic layers; the scale falls with the wanted error as its power SHRINK (measured by tests/campaigns/mesh_error.py).
"""

import functools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from skfem import MeshQuad

from indentfit.arrays import Array
from indentfit.case.tables import USUAL_MESH_ERROR, Indenter, Mesh, Sample
from indentfit.indenters import IndenterShape

SCALE, SHRINK = 1.0, 0.6
CONTACT = 8.0  # elements along the contact's radius at the largest depth
BEYOND = 1.2  # of that radius, which elements of this width reach to: the sample's surface sinks in before it touches
EDGE = 0.02  # width at a sharp edge, of the punch's radius or of the thickness, the less
ROUND = 4.0  # elements along a rounded edge
SLOPE = 0.5  # growth of the widths with the distance
DEPTHS = 12.0  # under a sharp edge, narrower elements than the depth over DEPTHS fold up
FAR = 0.4  # largest width, of the thickness; in the radial direction far from the contact, of the radius
FINEST = 1e-6  # place nearest to an end, and least width, of a line's length


@dataclass(frozen=True)
class _Task:
    """What a mesh is made for: radius, thickness and largest depth, mm, and the indenter."""

    radius: float
    thickness: float
    shape: IndenterShape
    depth: float

    @classmethod
    def of(cls, sample: Sample, indenter: Indenter, depth: float) -> "_Task":
        return cls(sample.geometry.outline.reach, sample.thickness, indenter.geometry, depth)

    @property
    def contact(self) -> float:
        """Radius of the contact at the largest depth, mm."""
        return self.shape.partition(self.depth).half_width


def meridian_mesh(sample: Sample, indenter: Indenter, mesh: Mesh, depth: float) -> MeshQuad:
    """Mesh of the meridian plane of a round sample under a round indenter.

    Parameters
    ----------
    sample, indenter, mesh : tables of a case
    depth : float, mm
        Largest depth.

    Returns
    -------
    MeshQuad
        Points (r, y), mm, with the boundaries top, base, axis and footprint (the edges of the top that may touch).
    """
    task = _Task.of(sample, indenter, depth)
    radii, heights = _lines(task, _scale(task, mesh))
    plane, top = MeshQuad.init_tensor(radii, heights), task.thickness * (1 - 1e-9)
    return plane.with_boundaries(
        {
            "top": lambda x: x[1] > top,
            "base": lambda x: x[1] < task.thickness - top,
            "axis": lambda x: x[0] < 1e-9 * task.radius,
            "footprint": lambda x: (x[1] > top) & task.shape.may_touch(x[0], np.zeros_like(x[0])),
        }
    )


def count_meridian(sample: Sample, indenter: Indenter, mesh: Mesh, depth: float) -> int:
    """Number of elements that `meridian_mesh` would make of the same arguments."""
    task = _Task.of(sample, indenter, depth)
    return _count(task, _scale(task, mesh))


def size_of_meridian(sample: Sample, indenter: Indenter, mesh: Mesh, depth: float) -> float:
    """Width of the elements at the contact's end, mm, to which all other widths are proportional."""
    task = _Task.of(sample, indenter, depth)
    return _scale(task, mesh) * _finest(task)


def _scale(task: _Task, mesh: Mesh) -> float:
    if mesh.size is not None:
        return mesh.size / _finest(task)
    if mesh.elements is not None:
        return _scale_for(task, mesh.elements)
    return SCALE * (mesh.wanted_error / USUAL_MESH_ERROR) ** SHRINK


@functools.lru_cache(maxsize=256)
def _scale_for(task: _Task, elements: int) -> float:
    """The scale whose mesh has the number of elements nearest to the one that is asked for, by bisection."""
    low, high = np.log(1e-2), np.log(50.0)
    for _ in range(40):
        middle = (low + high) / 2
        low, high = (middle, high) if _count(task, float(np.exp(middle))) > elements else (low, middle)
    return min((float(np.exp(low)), float(np.exp(high))), key=lambda scale: abs(_count(task, scale) - elements))


def _count(task: _Task, scale: float) -> int:
    radii, heights = _lines(task, scale)
    return (radii.size - 1) * (heights.size - 1)


def _finest(task: _Task) -> float:
    """Width at the contact's end of the mesh of scale 1, mm."""
    if task.shape.edge_radius == 0:
        return EDGE * min(task.contact, task.thickness)
    finest = task.contact / CONTACT
    return min(finest, task.shape.edge_radius / ROUND) if task.shape.edge_radius else finest


def _lines(task: _Task, scale: float) -> tuple[Array, Array]:
    """Radii and heights of the mesh lines, mm; a line is on the circle of a flat punch."""
    a, R, h, edge = task.contact, task.radius, task.thickness, scale * _finest(task)
    if task.shape.edge_radius == 0:
        edge = max(edge, task.depth / DEPTHS)
    far_r, far_y = scale * max(FAR * h, FAR * a), scale * FAR * h
    if task.shape.edge_radius is None:
        radii = _spaced(0, R, lambda r: np.minimum(edge + SLOPE * np.maximum(r - BEYOND * a, 0), far_r))
    else:
        begin = a - task.shape.edge_radius  # of the rounded edge, over which the contact's end moves
        inner = _spaced(0, a, lambda r: np.minimum(edge + SLOPE * np.maximum(begin - r, 0), far_r))
        radii = np.concatenate([inner, _spaced(a, R, lambda r: np.minimum(edge + SLOPE * (r - a), far_r))[1:]])
    heights = h - _spaced(0, h, lambda t: np.minimum(edge + SLOPE * t, far_y))[::-1]
    heights[0], heights[-1] = 0.0, h
    return radii, heights


def _spaced(start: float, stop: float, width: Callable[[Array], Array]) -> Array:
    """Positions from start to stop with a spacing that follows a width, a function of the position."""
    near = np.geomspace(FINEST, 0.5, 1000)  # as close to both ends as a sharp edge of a small punch on a wide sample asks for
    fine = start + (stop - start) * np.concatenate([[0.0], near, 1 - near[-2::-1], [1.0]])
    density = 1 / np.maximum(width(fine), FINEST * (stop - start))
    count = np.concatenate([[0], np.cumsum((density[1:] + density[:-1]) / 2 * np.diff(fine))])
    number = max(2, int(np.ceil(count[-1] - 1e-9)))
    places = np.interp(np.linspace(0, count[-1], number + 1), count, fine)
    places[0], places[-1] = start, stop
    return places
