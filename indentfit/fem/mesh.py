"""Quarters of samples of bricks, and parts grown from them by mirror images.

The meshes are graded towards the indenter's edge and the top, with mesh lines on the edge of the contact.

Axes: y is the indentation axis (base y = 0, top y = thickness), the strip's long side lies along x. The planes x = 0 and
z = 0 are planes of symmetry of the quarter. All lengths in mm.

The size of a mesh, mm (`mesh.size` of a case, `size` here), is the scale of all its widths: `Family` says how many sizes wide an
element is at the indenter's edge, at the sample's rim and far away.
"""

import functools
import itertools
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from skfem import MeshHex, MeshHex2

from indentfit.arrays import Array, Bools
from indentfit.case import Indenter, Mesh, Sample
from indentfit.case.tables import USUAL_MESH_ERROR
from indentfit.fem.bricks import extrude, merge, quadratic
from indentfit.fem.grading import Grading, continued, graded
from indentfit.fem.plane import patches
from indentfit.fem.sliding import cut
from indentfit.indenters import Band, IndenterShape, Rings, has_sharp_edge
from indentfit.samples import Outline


@dataclass(frozen=True)
class Family:
    """How the meshes of an element are graded; widths in units of the mesh's size.

    An element at the contact's edge is `edge` wide (less under an indenter that is narrow against the thickness), and its width
    grows with the distance from the edge, by `growth` over 0.3 thicknesses, up to `far`. Along a strip elements are `along`
    times longer, because the fields hardly change there, but `rim` where they leave the sample: that corner is singular too, and
    coarse elements there cost 1 to 2 % of the force.

    All meshes of a sample are one base mesh, of about `base` elements, at other sizes: its number of elements in each direction
    times one ratio, rounded, with widths at the contact's edge and at the rim that follow the ratio smoothly (`graded`). Rounding
    each direction on its own would change the edge's width by jumps of up to half, and forces on such meshes approach no limit in
    a recognisable way. order: of the shape functions; default: number of elements of a case that gives neither size nor elements.
    """

    order: int
    edge: float
    growth: float
    far: float
    along: float
    rim: float
    base: int
    default: int


FAMILIES = {  # the defaults take a second or a few
    "q1p0": Family(order=1, edge=0.15, growth=0.80, far=1.0, along=2.0, rim=0.30, base=180, default=1500),
    "q2p1": Family(order=2, edge=0.126, growth=0.81, far=3.0, along=1.0, rim=0.225, base=125, default=125),
}
# Under a sharp edge the strain of the nearest elements grows as they get smaller, until they fold up: where nodes are closer than
# the depth over 16 to 19 (depths of 0.5 to 0.25 mm). No mesh has widths below the depth over DEPTHS (rounded: 15) there.
# Nor can an edge be made that sharp. At the rim, where the sample's side rolls up against the strip layer by layer, each
# with a snap, elements are as wide as the depth over ROLLS.
DEPTHS, ROLLS = 12, 3
FINEST = 0.01  # smallest size of a mesh, mm; on samples thinner than 1 mm, of the thickness
# Elements of a default mesh, over those under a strip: under a round contact, and under a wedge, whose contact grows.
ROUND_DEFAULT, GROWING_DEFAULT = 3.0, 2.5
# The mesh round a sharp punch's edge has to grow from a share of its radius to the sample's: beyond FAR_REACH radii the number of
# elements grows with the reach to the power of REACHES (tests/campaigns/elastic_layer.py --symmetry quarter).
FAR_REACH, REACHES = 24.0, 0.9
# A round contact that grows wider than the thickness ends farther out than on a half-space, in coarser elements: default meshes
# have more elements in all, by up to WIDE_DEFAULT, where its radius there is WIDE thicknesses.
WIDE, WIDE_DEFAULT = (1.2, 1.4), 1.25
# Elements into which each row of quadratic bricks at a round sharp edge that sticks is divided. The meridian plane with the same
# mesh lines has the same forces: with one element in a row they are up to 4.4 % too large at depths to half of the radius, with two
# 1.9 %, with three, which take three times as long, 1.1 %.
TIED_PARTS = 2
WALL = 2.0  # depth, in radii of a rounded edge, from which on the surface beside it may come to lie against the wall above it
GROWTH = 1.2  # power with which the number of elements grows as the wanted error falls
FEWEST = 20


@dataclass(frozen=True)
class _Task:
    """The sample, indenter and depth for which a mesh is made; thickness, largest depth, depths of interfaces
    and heights of those that slide in mm; whether the sample sticks to the indenter."""

    thickness: float
    outline: Outline
    indenter: IndenterShape
    depth: float
    family: Family
    sticks: bool = False
    interfaces: tuple[float, ...] = ()
    slides: tuple[float, ...] = ()

    @property
    def finest(self) -> float:
        """The smallest size that is tried, mm: on thin samples in proportion to the thickness."""
        return FINEST * min(1.0, self.thickness)

    @classmethod
    def of(cls, sample: Sample, indenter: Indenter, element: str, depth: float | None) -> "_Task":
        depth = depth or sample.thickness / 10
        shape, sticks = indenter.geometry, indenter.friction == "stick"
        layers = sample.interfaces, sample.slides
        return cls(sample.thickness, sample.geometry.outline, shape, depth, FAMILIES[element], sticks, *layers)

    @property
    def parts_edge(self) -> bool:
        """Whether the rows of elements at the edge are divided: under a round punch that sticks."""
        ties = self.sticks and has_sharp_edge(self.indenter) and isinstance(self.indenter.partition(self.depth), Rings)
        return ties and self.family.order == 2

    @property
    def undivided(self) -> "_Task":
        """The task whose mesh has these rows undivided."""
        return replace(self, sticks=False)


def quarter(
    sample: Sample,
    indenter: Indenter,
    mesh: Mesh,
    element: str = "q1p0",
    depth: float | None = None,
    rim: float = 1.0,
    grown: tuple[int, ...] = (),
) -> MeshHex | MeshHex2:
    """Mesh of a quarter sample, or of the quarter and its mirror images.

    Parameters
    ----------
    sample, indenter, mesh : tables of a case
    element : str
        Key of FAMILIES; it decides the grading and the default size.
    depth : float, mm
        Largest depth, which decides how wide a sphere's contact is; by default a tenth of the thickness.
    rim : float
        Width of the elements where a strip leaves the sample, in units of the usual width.
    grown : tuple of axes
        Axes (0 is x, 2 is z) along which mirror images are added: one makes a half, both the whole.

    Returns
    -------
    MeshHex, or for quadratic bricks MeshHex2
        A mesh with the boundaries top, base, x0, z0 (empty where the plane lies inside of the mesh), footprint (facets of the top
        that may touch the indenter's face), beside (those that may come to lie against the wall above a round punch's rounded edge)
        and overhung (facets of the side that may touch the indenter, below a strip longer than the sample; otherwise none).

    Raises
    ------
    MeshError
        The indenter does not fit on the sample.
    """
    task = _Task.of(sample, indenter, element, depth)
    linear = _bricks(task, size(sample, indenter, mesh, element, depth), rim, grown)
    if task.family.order == 1:
        return linear
    circles = [*task.outline.circles, *task.indenter.partition(task.depth).circles]
    return quadratic(linear, circles, linear.boundaries["overhung"], task.depth / DEPTHS)


def count(sample: Sample, indenter: Indenter, mesh: Mesh, element: str = "q1p0", depth: float | None = None) -> int:
    """Number of elements of the quarter that `quarter` makes of the same arguments; no mesh is made."""
    return _count(_Task.of(sample, indenter, element, depth), size(sample, indenter, mesh, element, depth))


def size(sample: Sample, indenter: Indenter, mesh: Mesh, element: str = "q1p0", depth: float | None = None) -> float:
    """Size, mm, of the mesh that `quarter` makes of the same arguments: all its widths are proportional to it."""
    task = _Task.of(sample, indenter, element, depth)
    return mesh.size or _size_for(task.undivided, mesh.elements or _default(task, mesh.wanted_error))


def edge_width(sample: Sample, indenter: Indenter, mesh: Mesh, element: str, depth: float) -> float:
    """Width of the elements at the edge of the contact at the largest depth, mm, of the mesh that `quarter` makes."""
    return _grading(_Task.of(sample, indenter, element, depth), size(sample, indenter, mesh, element, depth), 1.0).edge


def _default(task: _Task, error: float) -> int:
    """Number of elements that keeps an error of the force: more under a round contact, whose whole edge is fine, and under a
    contact that grows, because its edge passes all widths."""
    round_contact, grows = isinstance(task.indenter.partition(task.depth), Rings), task.indenter.edge_radius is None
    number = task.family.default * (ROUND_DEFAULT if round_contact else GROWING_DEFAULT if grows else 1.0)
    if round_contact and grows:
        wide = task.indenter.partition(task.depth).half_width / task.thickness
        number *= 1 + (WIDE_DEFAULT - 1) * min(max(wide - WIDE[0], 0.0) / (WIDE[1] - WIDE[0]), 1.0)
    if round_contact and has_sharp_edge(task.indenter):
        number *= max(1.0, task.outline.reach / (FAR_REACH * task.indenter.half_width)) ** REACHES
    return max(FEWEST, round(number * (USUAL_MESH_ERROR / error) ** GROWTH))


@functools.lru_cache(maxsize=256)
def _size_for(task: _Task, elements: int) -> float:
    """Size at which the mesh has about `elements` elements: the base mesh's size, or the middle of the sizes with this number."""
    own, range_of_sizes = functools.partial(_count, task), (task.finest, 5 * task.thickness)
    nearest = min(_neighbours(own, elements, *range_of_sizes), key=lambda size: abs(np.log(own(size) / elements)))
    number = own(nearest)
    base = _base_size(task)
    if elements == task.family.base or own(base) == number:
        return base
    finest = _neighbours(own, number, *range_of_sizes)[1]
    middle = np.sqrt(finest * _neighbours(own, number - 1, task.finest, 1.5 * finest)[0])
    return next(size for size in (middle, finest, nearest) if own(size) == number)  # numbers may fall where sizes do


@functools.lru_cache(maxsize=64)
def _base_size(task: _Task) -> float:
    """Size of the base mesh: the numbers of its elements in each direction are rounded up, each on its own."""
    own, wanted = functools.partial(_count, task, scaled=False), task.family.base
    return min(_neighbours(own, wanted, task.finest, 5 * task.thickness), key=lambda size: abs(np.log(own(size) / wanted)))


def _neighbours(number: Callable[[float], int], elements: int, finest: float, coarsest: float) -> tuple[float, float]:
    """The largest size, mm, whose mesh has more than `elements` elements, and the smallest with no more, by bisection."""
    low, high = np.log(finest), np.log(coarsest)
    for _ in range(30):
        middle = (low + high) / 2
        if number(np.exp(middle)) > elements:
            low = middle
        else:
            high = middle
    return np.exp(low), np.exp(high)


@functools.lru_cache(maxsize=512)
def _count(task: _Task, size: float, scaled: bool = True) -> int:
    """Number of elements at a size, without merging the patches. Bisections for one mesh begin at the same sizes."""
    plane, layers = _parts(task, size, scaled=scaled)
    return sum((patch.shape[1] - 1) * (patch.shape[2] - 1) for patch in plane) * (layers.size - 1)


def _bricks(task: _Task, size: float, rim: float, grown: tuple[int, ...]) -> MeshHex:
    """The mesh of eight-node bricks with its boundaries."""
    plane, layers = _parts(task, size, rim)
    for axis in grown:
        plane = [*plane, *(patch * np.where([axis == 0, axis == 2], -1.0, 1.0)[:, None, None] for patch in plane)]
    mesh = cut(extrude(merge(plane), layers), task.slides)
    top, eps = task.thickness, 1e-9 * task.thickness
    contact = task.indenter.partition(task.depth)
    overhangs = isinstance(contact, Band) and contact.half_length > mesh.p[0].max()
    deepest = top - task.depth  # points below this height would have to rise to meet the strip
    lowest = layers[np.searchsorted(layers, deepest, side="right") - 1] if overhangs else top

    def inside(p: Array) -> Bools:
        return task.indenter.may_touch(np.abs(p[0]), np.abs(p[2]))

    def side(p: Array) -> Bools:
        return np.all([np.abs(p[1] - height) > eps for height in task.slides], axis=0)

    return mesh.with_boundaries(
        {
            "top": lambda p: p[1] > top - eps,
            "base": lambda p: p[1] < eps,
            "x0": lambda p: np.abs(p[0]) < eps,
            "z0": lambda p: np.abs(p[2]) < eps,
            "footprint": lambda p: (p[1] > top - eps) & inside(p),
            "beside": lambda p: (p[1] > top - eps) & ~inside(p) & _beside(task, np.abs(p[0]), np.abs(p[2])),
            "overhung": lambda p: (
                (p[1] < top - eps) & (p[1] > lowest) & (np.abs(p[0]) > eps) & (np.abs(p[2]) > eps) & side(p) & inside(p)
            ),
        }
    )


def _beside(task: _Task, x: Array, z: Array) -> Bools:
    """Which points of the top, at x and z (n,) in mm, may come to lie against the wall above a round punch's rounded edge, by
    their distance from its face."""
    radius, contact = task.indenter.edge_radius, task.indenter.partition(task.depth)
    if not radius or task.depth < WALL * radius or not isinstance(contact, Rings):
        return np.zeros(x.shape, dtype=bool)
    return np.asarray(np.hypot(x, z) < contact.radius + task.depth)


def _parts(task: _Task, size: float, rim: float = 1.0, scaled: bool = True) -> tuple[list[Array], Array]:
    """Patches of the (x, z) plane, each an array (2, m, n) of points, and the heights of the layers."""
    grading = _grading(task, size, rim)
    if scaled:
        grading = replace(grading, base=_grading(task, _base_size(task.undivided), rim))
    return patches(task.outline, task.indenter.partition(task.depth), grading), _heights(task, grading)


def _heights(task: _Task, grading: Grading) -> Array:
    """Heights of the mesh lines, of which there is one on each interface between layers of the sample."""
    first, *rest = (*task.interfaces, task.thickness)
    depths = [graded(0, first, grading, at=0, least=2)]
    depths += [continued(*ends, grading)[1:] for ends in itertools.pairwise((first, *rest))]
    heights = task.thickness - np.concatenate(depths)[::-1]
    heights[0], heights[-1] = 0.0, task.thickness
    return heights


def _grading(task: _Task, size: float, rim: float) -> Grading:
    """The widths of a mesh of a size."""
    family, reach, radius = task.family, 0.3 * task.thickness, task.indenter.edge_radius
    half_width = task.indenter.partition(task.depth).half_width
    edge, least = family.edge * size * min(1.0, half_width / reach), 2
    if radius is not None:
        folds = family.order * task.depth / DEPTHS
        edge = min(edge, max(radius / 2, edge / 8)) if radius else min(max(edge, folds), size)
        least = 2 if edge > family.edge * size / 2 else 3  # a small radius of the edge holds a mesh line
    slope, narrowest = family.growth * size / reach, task.depth / ROLLS
    parts = TIED_PARTS if task.parts_edge else 1
    return Grading(family.far * size, edge, slope, max(rim * family.rim * size, narrowest), family.along, least, parts)
