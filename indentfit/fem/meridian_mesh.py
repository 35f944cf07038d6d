"""Meshes of the meridian plane of a round sample, sized by the contact: fine where the contact's end passes, and at a sharp edge.

Under an indenter whose contact grows, the contact's end passes every radius up to that at the largest depth: elements are there a
CONTACT-th of that radius wide, and no wider than OF_THICKNESS of the sample's thickness, so that the force is right along the whole
path, and grow away from it. A cone's contact begins in proportion to the depth: elements are narrower towards its axis, so that the
contact of the first step has one. At the sharp edge of a flat punch the stress is singular: elements lie in rings about the corner
(`corner`), the innermost of EDGE times the punch's radius (or the thickness, where that is less). The constants were chosen by
comparison with exact elastic layers and with another code's large strains (tests/test_axisymmetric.py).

All widths are in proportion to the mesh's scale. SCALE is that of the usual error of the force, 1 %, and keeps 0.3 % on most exact
elastic layers; the scale falls with the wanted error as its power SHRINK (measured by tests/campaigns/mesh_error.py).
"""

import functools
import itertools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from skfem import MeshQuad

from indentfit.arrays import Array, Bools
from indentfit.case.tables import USUAL_MESH_ERROR, Indenter, Mesh, Sample
from indentfit.fem.bricks import merge
from indentfit.fem.controls import FIRST_DEPTH
from indentfit.fem.corner import Corner
from indentfit.fem.sliding import cut
from indentfit.indenters import IndenterShape, has_sharp_edge

SCALE, SHRINK = 1.0, 0.6
CONTACT = 10.0  # elements along the contact's radius at the largest depth
OF_THICKNESS = 0.2  # width at the contact's end, of the sample's thickness, at most: the pressure falls off over a thickness there
# Elements of this width reach to BEYOND times the radius at which the indenter's surface lies at the sample's height, and to
# BEYOND_THIN times it where that radius is two thicknesses or more. A thin layer whose volume is kept rises beside the indenter and
# touches it beyond that radius (at 1.23 of it where it is 6 thicknesses; the surface just beyond decides where).
BEYOND, BEYOND_THIN = 1.2, 1.45
# Width at a sharp edge, of the punch's radius or of the thickness, the less.
EDGE = 0.02
ROUND = 4.0  # elements along a rounded edge
# Elements along the radius of the first step's contact, which only that of a cone asks for, and growth of the widths with the
# distance from the axis there. Without these the first of 24 forces under a cone was 19 % too small, and the second 5 %.
FIRST_CONTACT, FROM_AXIS = 1.0, 0.25
SLOPE = 0.5  # growth of the widths with the distance
# Elements along half of a side of the rings about a sharp edge, in proportion to the root of 1 / scale, and growth of the widths
# beside the rings. Where the edge sticks, the surface beside it turns up against the wall, by a right angle: with two elements
# along half of a side the force was 0.1 to 0.7 % too large at depths of 0.4 to 1.3 radii, and narrower rings changed nothing.
DIVISIONS = {"free": 2.0, "stick": 4.0}
RING = {"free": 1.75, "stick": 3.5}  # growth of the rings' widths, times the divisions
BESIDE_RINGS = {"free": SLOPE, "stick": 0.8}
# Narrower elements than the depth over DEPTHS fold up at a sharp edge under which the sample slips: meshes of a twelfth to a sixth
# of the depth folded or not, by chance, already at a depth of 8 % of the punch's radius. Where it sticks they take more iterations:
# a sixtieth of the depth four times as many as a twentieth, for forces 0.1 to 0.6 % smaller. This width follows the wanted error.
DEPTHS = {"free": 4.0, "stick": 19.0}
WIDEST_STICKING = 0.06  # of the punch's radius or of the thickness, the less: wider elements at a corner that sticks err by 1 %
OF_LAYER, WIDE = 0.5, 8.0  # width at the contact's end, of the top layer's thickness; and how much narrower it may make elements
FAR = 0.4  # largest width, of the thickness; in the radial direction beside the contact, of its radius, if that is more
# Distance beside the contact, of the thickness or of its radius, the more, up to which FAR holds: farther out a layer hardly moves,
# or moves outwards as one over the radius, and widths grow by OUTWARDS of the distance.
# Width at a bonded base, of the lowest layer's thickness: the shear is largest there where a layer keeps its volume. Without it a
# Demiray law of b = 5, 10, 20 was 1.5, 8 and 26 % too stiff at 30 % of the thickness, and the second mesh did not show it.
BASE = 0.1
CLEAR, OUTWARDS = 2.0, 0.25
COARSEST, COARSEST_SHARP = (
    50.0,
    10.0,
)  # largest scales that are tried for few elements; under a sharp edge wider ones change nothing
SAME = 1e-9  # distance of points that are the same, of the mesh's extent
FINEST = 1e-6  # place nearest to an end, and least width, of a line's length


@dataclass(frozen=True)
class _Task:
    """What a mesh is made for: radius, thickness, depths of interfaces between layers, heights of those that slide, and
    largest depth, mm, the indenter, and whether the base is bonded."""

    radius: float
    thickness: float
    shape: IndenterShape
    depth: float
    sticks: bool
    interfaces: tuple[float, ...] = ()
    slides: tuple[float, ...] = ()
    bonded: bool = False

    @classmethod
    def of(cls, sample: Sample, indenter: Indenter, depth: float) -> "_Task":
        reach, sticks = sample.geometry.outline.reach, indenter.friction == "stick"
        bonded = sample.base == "bonded"
        return cls(reach, sample.thickness, indenter.geometry, depth, sticks, sample.interfaces, sample.slides, bonded)

    @property
    def top(self) -> float:
        """Thickness of the layer that the indenter touches, mm."""
        return min((*self.interfaces, self.thickness))

    @property
    def contact(self) -> float:
        """Radius of the contact at the largest depth, mm."""
        return self.shape.partition(self.depth).half_width

    @property
    def edge(self) -> str:
        """Whether the sample slips freely under a sharp edge, or sticks."""
        return "stick" if self.sticks else "free"

    @property
    def beside(self) -> float:
        """Width of the ring beside a flat face whose surface may come to lie against the punch's wall, mm: none beside a sharp
        edge under which the sample slips, and none where there is no wall."""
        walled = self.shape.edge_radius is not None and (self.sticks or not has_sharp_edge(self.shape))
        return self.depth if walled else 0.0


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
        Points (r, y), mm, with the boundaries top, base, axis, footprint (the edges of the top that may touch the face) and beside
        (those that may touch the wall above the edge).
    """
    task = _Task.of(sample, indenter, depth)
    plane, top = cut(_plane(task, _scale(task, mesh)), task.slides), task.thickness * (1 - 1e-9)
    return plane.with_boundaries(
        {
            "top": lambda x: x[1] > top,
            "base": lambda x: x[1] < task.thickness - top,
            "axis": lambda x: x[0] < 1e-9 * task.radius,
            "footprint": lambda x: (x[1] > top) & task.shape.may_touch(x[0], np.zeros_like(x[0])),
            "beside": lambda x: (x[1] > top) & _beside(task, x[0]),
        }
    )


def _beside(task: _Task, r: Array) -> Bools:
    """Whether points of the top at radii r (n,), mm, lie in the ring beside the footprint."""
    return ~task.shape.may_touch(r, np.zeros_like(r)) & (r < task.contact + task.beside)


def count_meridian(sample: Sample, indenter: Indenter, mesh: Mesh, depth: float) -> int:
    """Number of elements that `meridian_mesh` would make of the same arguments."""
    task = _Task.of(sample, indenter, depth)
    return _count(task, _scale(task, mesh))


def size_of_meridian(sample: Sample, indenter: Indenter, mesh: Mesh, depth: float) -> float:
    """Width of the elements at the contact's end, mm, to which all other widths are proportional."""
    task = _Task.of(sample, indenter, depth)
    return _scale(task, mesh) * _finest(task)


def width_within_contact(sample: Sample, indenter: Indenter, mesh: Mesh, depth: float, radius: Array) -> Array:
    """Width of the elements, mm, at radii (n,), mm, within the contact at the largest depth."""
    task = _Task.of(sample, indenter, depth)
    return _within(task, _scale(task, mesh), radius)


def width_at_corner(sample: Sample, indenter: Indenter, mesh: Mesh, depth: float) -> float:
    """Width of the elements at a sharp edge, over the punch's radius or the top layer's thickness, the less."""
    task = _Task.of(sample, indenter, depth)
    return _corner_width(task, _scale(task, mesh)) / min(task.contact, task.top)


def _within(task: _Task, scale: float, radius: Array) -> Array:
    """Widths within a contact that grows, mm, at radii (n,), mm."""
    return np.minimum(np.maximum(_first(task, scale), FROM_AXIS * radius), scale * _finest(task))


def _first(task: _Task, scale: float) -> float:
    """Width at the axis, mm, under a contact that grows."""
    return scale * min(task.shape.partition(FIRST_DEPTH * task.depth).half_width / FIRST_CONTACT, _finest(task))


def _scale(task: _Task, mesh: Mesh) -> float:
    if mesh.size is not None:
        return mesh.size / _finest(task)
    if mesh.elements is not None:
        return _scale_for(task, mesh.elements)
    return SCALE * (mesh.wanted_error / USUAL_MESH_ERROR) ** SHRINK


@functools.lru_cache(maxsize=256)
def _scale_for(task: _Task, elements: int) -> float:
    """The scale whose mesh has the number of elements nearest to the one that is asked for, by bisection."""
    low, high = np.log(1e-2), np.log(COARSEST_SHARP if has_sharp_edge(task.shape) else COARSEST)
    for _ in range(40):
        middle = (low + high) / 2
        low, high = (middle, high) if _count(task, float(np.exp(middle))) > elements else (low, middle)
    return min((float(np.exp(low)), float(np.exp(high))), key=lambda scale: abs(_count(task, scale) - elements))


def _count(task: _Task, scale: float) -> int:
    if has_sharp_edge(task.shape):
        return sum((patch.shape[1] - 1) * (patch.shape[2] - 1) for patch in _corner(task, scale))
    radii, heights = _lines(task, scale)
    return (radii.size - 1) * (heights.size - 1)


def _plane(task: _Task, scale: float) -> MeshQuad:
    if has_sharp_edge(task.shape):
        return merge(_corner(task, scale), SAME)
    return MeshQuad.init_tensor(*_lines(task, scale))


def _finest(task: _Task) -> float:
    """Width at the contact's end of the mesh of scale 1, mm."""
    if has_sharp_edge(task.shape):
        return EDGE * min(task.contact, task.top)
    finest = min(task.contact / CONTACT, OF_THICKNESS * task.thickness)
    if task.interfaces:
        finest = min(finest, max(OF_LAYER * task.top, finest / WIDE))
    return min(finest, task.shape.edge_radius / ROUND) if task.shape.edge_radius else finest


def _corner(task: _Task, scale: float) -> list[Array]:
    """Patches of the mesh under a sharp edge. A coarser mesh is coarser at the edge too where elements may not be narrower."""
    width, divisions = _corner_width(task, scale), max(1, round(DIVISIONS[task.edge] * scale**-0.5))
    corner = Corner(task.contact, task.radius, task.thickness, task.top, width, divisions, RING[task.edge] / divisions, task.sticks)
    slope = BESIDE_RINGS[task.edge]

    def sideways(width: float, start: float, stop: float) -> Array:
        block = corner.block
        return _spaced(
            start, stop, lambda r: np.minimum(width + slope * (np.abs(r - task.contact) - block), _widest(task, scale, r))
        )

    def down(width: float, end: float) -> Array:
        if not task.interfaces:
            return _spaced(0, end, lambda distance: np.minimum(width + slope * distance, scale * FAR * task.thickness))
        return _downwards(task, scale, lambda depth: width + slope * (depth - corner.block), corner.block) - corner.block

    return corner.patches(sideways, down)


def _corner_width(task: _Task, scale: float) -> float:
    """Width of the elements at a sharp edge, mm."""
    folds = task.depth / DEPTHS[task.edge]
    if task.sticks:
        return scale * max(_finest(task), min(folds, WIDEST_STICKING * min(task.contact, task.top)))
    return max(scale * _finest(task), max(scale, 1.0) * folds)


def _downwards(task: _Task, scale: float, width: Callable[[Array], Array], first: float = 0.0) -> Array:
    """Depths of mesh lines from a first one down to the base, mm, that follow a width, a function of the depth; there is a line on
    each interface, and no layer has fewer elements across than FAR asks for, nor has what lies near it much wider ones."""
    ends = [0.0, *task.interfaces, task.thickness]
    layers = list(itertools.pairwise(ends))

    def narrow(depth: Array) -> Array:
        near = [scale * FAR * (low - high) + SLOPE * np.maximum(np.maximum(high - depth, depth - low), 0.0) for high, low in layers]
        if task.bonded:
            near.append(scale * BASE * (task.thickness - layers[-1][0]) + SLOPE * np.maximum(task.thickness - depth, 0.0))
        return np.minimum(width(depth), np.min(near, axis=0))

    lines = [_spaced(max(high, first), low, narrow) for high, low in layers if low > first]
    return np.concatenate([lines[0], *(more[1:] for more in lines[1:])])


def _widest(task: _Task, scale: float, r: Array) -> Array:
    """Largest widths in the radial direction at radii r (n,), mm."""
    near = max(task.thickness, task.contact)
    beyond = np.maximum(r - task.contact - CLEAR * near, 0.0)
    return scale * FAR * near + min(SLOPE, scale * OUTWARDS) * beyond


def _lines(task: _Task, scale: float) -> tuple[Array, Array]:
    """Radii and heights of the mesh lines, mm; a line is on the circle of a flat punch with a rounded edge."""
    a, R, h, edge = task.contact, task.radius, task.thickness, scale * _finest(task)
    widest = functools.partial(_widest, task, scale)
    top = edge
    if task.shape.edge_radius is None:
        top = _first(task, scale)
        reach = a * (BEYOND + (BEYOND_THIN - BEYOND) * min(max(a / h - 1, 0.0), 1.0))
        radii = _spaced(0, R, lambda r: np.minimum(_within(task, scale, r) + SLOPE * np.maximum(r - reach, 0), widest(r)))
    else:
        begin = a - task.shape.edge_radius  # of the rounded edge, over which the contact's end moves
        inner = _spaced(0, a, lambda r: np.minimum(edge + SLOPE * np.maximum(begin - r, 0), widest(r)))
        radii = np.concatenate([inner, _spaced(a, R, lambda r: np.minimum(edge + SLOPE * (r - a), widest(r)))[1:]])
    heights = h - _downwards(task, scale, lambda t: top + SLOPE * t)[::-1]
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
