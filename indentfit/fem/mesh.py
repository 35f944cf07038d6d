"""Quarter samples of bricks: graded towards the indenter's edge and the top, with mesh lines on the footprint.

Axes: y is the indentation axis (base y = 0, top y = thickness), the strip's long side lies along x. The planes x = 0 and
z = 0 are planes of symmetry. All lengths in mm.
"""

import functools
from dataclasses import dataclass, replace

import numpy as np
from skfem import MeshHex, MeshHex2, MeshQuad

from indentfit.errors import MeshError


@dataclass(frozen=True)
class _Family:
    """How the meshes of an element are graded; widths in units of the size.

    An element at the footprint's edge is `edge` wide (less under an indenter that is narrow against the thickness), and its width
    grows with the distance from the edge, by `growth` over 0.3 thicknesses, up to `far`. Along a strip elements are `along`
    times longer, because the fields hardly change there, but `rim` where they leave the sample: that corner is singular too, and
    what is left coarse there costs 1 to 2 % of the force.

    All meshes of a sample are one base mesh, of about `base` elements, at other sizes: its number of elements in each direction
    times one ratio, rounded, with widths at the footprint's edge and at the rim that follow the ratio smoothly (`graded`). Rounding
    each direction on its own would change the edge's width by jumps of up to half, and forces on such meshes approach no limit in
    a recognisable way. order: of the shape functions; default: number of elements where none is asked for.
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
    "q1p0": _Family(order=1, edge=0.15, growth=0.80, far=1.0, along=2.0, rim=0.30, base=180, default=1500),
    "q2p1": _Family(order=2, edge=0.126, growth=0.81, far=3.0, along=1.0, rim=0.225, base=125, default=125),
}
# Where quadratic bricks have their first nodes on the side that may roll up against a strip, in the thickness of the top layer from
# the top: an element is as fine as its nodes, and the fields are singular at that corner. With 0.3 instead of 0.5 the side rolls
# up, with a snap, only where fibres are half as stiff again (zeta of 10 instead of 6), and the rim can be finer.
MIDDLE = 0.3
# Under a sharp edge the strain of the nearest elements grows as they get smaller, until they fold up: where nodes are closer than
# the depth over 16 to 19 (depths of 0.5 to 0.25 mm). No mesh asks for less than the depth over DEPTHS (rounded: 15).
# Nor is an edge that can be made that sharp. At the rim, where the sample's side rolls up against the strip layer by layer, each
# with a snap, elements are as wide as the depth over ROLLS.
DEPTHS, ROLLS = 12, 3


@dataclass(frozen=True)
class _Task:
    """What a mesh is made for: the case's tables, the largest depth, mm, and the element's family."""

    sample: object
    indenter: object
    depth: float
    family: _Family

    @classmethod
    def of(cls, sample, indenter, element, depth):
        return cls(sample, indenter, depth or sample.thickness / 10, FAMILIES[element])


@dataclass(frozen=True)
class Grading:
    """Element widths of one mesh: `size` far from the footprint's edge, `edge` at it, mm, and growing by `slope` mm with each mm.

    rim: where a strip leaves the sample, mm; long: how much wider they are along a strip; least: number of elements on each side of
    the edge; base: the Grading of the mesh that this one is a scaled copy of, None for that mesh itself.
    """

    size: float
    edge: float
    slope: float
    rim: float
    long: float = 1.0
    least: int = 2
    base: "Grading | None" = None

    def width(self, distance):
        """Wanted element width at a distance from the footprint's edge, mm."""
        return np.minimum(self.size, self.edge + self.slope * np.asarray(distance))

    def along(self, edge):
        """The grading along a strip, whose element width at the end is `edge`, a function of a Grading."""
        size, slope, base = self.long * self.size, self.long * self.slope, self.base and self.base.along(edge)
        return replace(self, size=size, edge=edge(self), slope=slope, base=base)


def quarter(sample, indenter, mesh, element="q1p0", depth=None, rim=1.0):
    """Mesh of a quarter sample for a case's `sample`, `indenter` and `mesh` tables; the element decides the grading and the default
    size, the largest depth (mm) how far a sphere's contact will reach; rim: width of elements where a strip leaves the sample, in
    the usual one.

    Returns a MeshHex, or for quadratic bricks a MeshHex2 (see `quadratic`), with the boundaries top, base, x0, z0, footprint (the
    facets of the top that may touch the indenter) and overhung (those of the side that may, below a strip that is longer than the
    sample; else none).
    Raises MeshError where the indenter does not fit on the sample.
    """
    task = _Task.of(sample, indenter, element, depth)
    linear = _quarter(task, size(sample, indenter, mesh, element, depth), rim)
    if task.family.order == 1:
        return linear
    return quadratic(linear, _circles(task), linear.boundaries["overhung"], task.depth / DEPTHS)


def count(sample, indenter, mesh, element="q1p0", depth=None):
    """Number of elements that `quarter` would make, without making them."""
    return _count(_Task.of(sample, indenter, element, depth), size(sample, indenter, mesh, element, depth))


def size(sample, indenter, mesh, element="q1p0", depth=None):
    """Element size of the mesh that `quarter` makes, mm: what all its widths are proportional to."""
    return mesh.size or _size_for(_Task.of(sample, indenter, element, depth), mesh.elements or FAMILIES[element].default)


@functools.lru_cache(maxsize=256)
def _size_for(task, elements):
    """Size at which the mesh has about that many elements: the base's, or the middle of the sizes that have as many."""
    own, coarsest = functools.partial(_count, task), 5 * task.sample.thickness
    nearest = min(_neighbours(own, elements, coarsest), key=lambda size: abs(np.log(own(size) / elements)))
    number = own(nearest)
    base = _base_size(task)
    if elements == task.family.base or own(base) == number:
        return base
    finest = _neighbours(own, number, coarsest)[1]
    middle = np.sqrt(finest * _neighbours(own, number - 1, 1.5 * finest)[0])
    return next(size for size in (middle, finest, nearest) if own(size) == number)  # numbers may fall where sizes do


@functools.lru_cache(maxsize=64)
def _base_size(task):
    """Size of the base mesh: the numbers of its elements in each direction are rounded up, each on its own."""
    own, asked = functools.partial(_count, task, scaled=False), task.family.base
    return min(_neighbours(own, asked, 5 * task.sample.thickness), key=lambda size: abs(np.log(own(size) / asked)))


def _neighbours(number, elements, coarsest):
    """The largest size, mm, whose mesh has more than `elements` elements, and the smallest with no more, by bisection."""
    low, high = np.log(0.01), np.log(coarsest)
    for _ in range(30):
        middle = (low + high) / 2
        if number(np.exp(middle)) > elements:
            low = middle
        else:
            high = middle
    return np.exp(low), np.exp(high)


def _count(task, size, scaled=True):
    """Number of elements at a size, without merging the patches."""
    plane, layers = _parts(task, size, scaled=scaled)
    return sum((patch.shape[1] - 1) * (patch.shape[2] - 1) for patch in plane) * (layers.size - 1)


def _quarter(task, size, rim):
    sample, indenter = task.sample, task.indenter
    plane, layers = _parts(task, size, rim)
    mesh = extrude(merge(plane), layers)
    x, z = footprint(indenter, sample)
    inside = {
        "strip": lambda p: (p[0] < x) & (p[2] < z),
        "cylinder": lambda p: np.hypot(p[0], p[2]) < x,
        "sphere": lambda p: np.hypot(p[0], p[2]) < x,
    }[indenter.shape]
    top, eps = sample.thickness, 1e-9 * sample.thickness
    overhangs = indenter.shape == "strip" and indenter.length / 2 > mesh.p[0].max()
    deepest = top - task.depth  # what is below would have to rise to meet the strip
    lowest = layers[np.searchsorted(layers, deepest, side="right") - 1] if overhangs else top
    return mesh.with_boundaries(
        {
            "top": lambda p: p[1] > top - eps,
            "base": lambda p: p[1] < eps,
            "x0": lambda p: p[0] < eps,
            "z0": lambda p: p[2] < eps,
            "footprint": lambda p: (p[1] > top - eps) & inside(p),
            "overhung": lambda p: (p[1] < top - eps) & (p[1] > lowest) & (p[0] > eps) & (p[2] > eps) & inside(p),
        }
    )


def footprint(indenter, sample):
    """Half-lengths (x, z) of the region of the top that may come into contact, mm.

    A sharp edge confines the contact to the footprint's material face. A rounded one, and a sphere, can also be met
    by material from beside it: half a radius more, but no more than the sample has.
    """
    if indenter.shape == "strip":
        return indenter.length / 2 + indenter.edge_radius / 2, indenter.width / 2 + indenter.edge_radius / 2
    if indenter.shape == "cylinder":
        return (indenter.diameter / 2 + indenter.edge_radius / 2,) * 2
    return (indenter.diameter / 2,) * 2


def _parts(task, size, rim=1.0, scaled=True):
    """Patches of the (x, z) plane, each an array (2, m, n) of points, and the heights of the layers."""
    sample, indenter, grading = task.sample, task.indenter, _grading(task, size, rim)
    if scaled:
        grading = replace(grading, base=_grading(task, _base_size(task), rim))
    layers = sample.thickness - graded(0, sample.thickness, grading, at=0, least=2)[::-1]
    layers[0], layers[-1] = 0.0, sample.thickness
    if indenter.shape == "strip" and sample.shape == "disc":
        return _strip_on_disc(sample.diameter / 2, indenter, grading), layers
    if indenter.shape == "strip":
        return [_strip_on_block(sample, indenter, grading)], layers
    return _round_punch(sample, _radius_to_resolve(task), grading), layers


def _grading(task, size, rim):
    family, reach, indenter = task.family, 0.3 * task.sample.thickness, task.indenter
    half = indenter.width / 2 if indenter.shape == "strip" else _radius_to_resolve(task)
    edge, least = family.edge * size * min(1.0, half / reach), 2
    if indenter.shape != "sphere":
        radius, folds = indenter.edge_radius, family.order * task.depth / DEPTHS
        edge = min(edge, max(radius / 2, edge / 8)) if radius else min(max(edge, folds), size)
        least = 2 if edge > family.edge * size / 2 else 3  # a small radius of the edge holds a mesh line
    slope, narrowest = family.growth * size / reach, task.depth / ROLLS
    return Grading(family.far * size, edge, slope, max(rim * family.rim * size, narrowest), family.along, least)


def _radius_to_resolve(task):
    """Radius at which a round indenter's contact ends: its own, or a sphere's by Hertz at the largest depth."""
    radius = task.indenter.diameter / 2
    return radius if task.indenter.shape == "cylinder" else min(np.sqrt(radius * task.depth), radius)


# ---- one direction -----------------------------------------------------------------------------------------------


def graded(start, stop, grading, at, least=1):
    """Positions from start to stop, whose spacing follows the grading's width at the distance from `at`, its start or stop.

    Their number is that of the base mesh times the ratio of the two gradings, rounded; the first spacing at `at` follows the
    ratio before rounding, and the other ones make up for it: what decides the error, the spacing at the singular edge,
    is then the same function of the size on every mesh.
    """
    fine, count = _elements_up_to(start, stop, grading, at)
    wanted = count[-1] * _rounding(start, stop, grading, at, least)
    number = max(least, round(wanted))
    share = np.linspace(0, 1, number + 1)
    if number > 1 and (round(wanted) == number or (number == 2 and wanted > 1.1)):  # else more than wanted, spread evenly
        first = np.clip((number / wanted - 1 / number) / (1 - 1 / number), 0.5, 5 / 3)  # so that share[1] is 1 / wanted
        share = first * share + (1 - first) * share**2
    nodes = np.interp(count[-1] * (share if at == start else 1 - share[::-1]), count, fine)
    nodes[0], nodes[-1] = start, stop
    return nodes


def _elements_up_to(start, stop, grading, at):
    """Points between start and stop, and the number of elements of the wanted width from start to each, a fraction."""
    fine = np.linspace(start, stop, 4001)
    density = 1 / grading.width(np.abs(fine - at))
    return fine, np.concatenate([[0], np.cumsum((density[1:] + density[:-1]) / 2 * np.diff(fine))])


def _rounding(start, stop, grading, at, least):
    """The factor that makes the number of elements of the base mesh whole; 1 where that has more than its grading asks for."""
    count = _elements_up_to(start, stop, grading.base or grading, at)[1][-1]
    number = np.ceil(count - 1e-9)
    return number / count if number >= least else 1.0


def _across(half_width, end, grading):
    """Positions from 0 to end with a line on half_width, fine on both sides of it."""
    inner = graded(0, half_width, grading, at=half_width, least=grading.least)
    return inner, graded(half_width, end, grading, at=half_width, least=grading.least)


def _along(half_length, end, grading):
    """Positions along the strip: even where it overhangs the sample, else with a line on its end."""
    if half_length >= end * (1 - 1e-6):
        return graded(0, end, grading.along(lambda one: one.rim), at=end, least=2)
    inner, outer = _across(half_length, end, grading.along(lambda one: one.edge))
    return np.concatenate([inner, outer[1:]])


# ---- the plane ---------------------------------------------------------------------------------------------------


def _strip_on_block(sample, indenter, grading):
    inner, outer = _across(indenter.width / 2, sample.width / 2, grading)
    x = _along(indenter.length / 2, sample.length / 2, grading)
    return np.array(np.meshgrid(x, np.concatenate([inner, outer[1:]]), indexing="ij"))


def _strip_on_disc(radius, indenter, grading):
    """A band under the strip, and the cap beside it as three patches that meet in one inner point.

    Every corner of the cap is near 90 deg, so no element degenerates where the strip's edge leaves the disc.
    """
    half = indenter.width / 2
    chord = np.sqrt(radius**2 - half**2)
    if half > 0.9 * radius:
        raise MeshError(f"indenter.width = {2 * half:g} mm: too wide to mesh on a disc of diameter {2 * radius:g} mm")
    x = _along(indenter.length / 2, chord, grading)
    inner, outer = _across(half, half + 0.55 * (radius - half), grading)
    split = int(np.clip(np.argmin(np.abs(x - 0.5 * chord)), 1, x.size - 2))

    band = np.array(np.meshgrid(x, inner, indexing="ij"))
    rim = np.sqrt(radius**2 - inner**2)  # the band's lines reach the rim
    straight = max(x[split], min(indenter.length / 2, x[-2]))  # a line on the strip's end stays straight
    stretch = np.clip((x - straight) / (chord - straight), 0, 1)[:, None]
    band[0] += stretch**2 * (rim - chord)[None, :]

    low, high = np.arcsin(half / radius), np.pi / 2
    shares = (outer - half) / (outer[-1] - half)
    middle = low + 0.5 * (high - low)
    rise = _arc(radius, low + shares * (middle - low))
    centre = np.array([0.8 * x[split], half + 0.4 * (radius - half)])
    bottom = np.array([x, np.full_like(x, half)])
    left = np.array([np.zeros_like(outer), outer])
    spoke = _line(bottom[:, split], centre, shares)
    level = _line(left[:, -1], centre, x[: split + 1] / x[split])
    outwards = _line(centre, rise[:, -1], (x[split:] - x[split]) / (chord - x[split]))
    crown = _arc(radius, np.linspace(high, middle, split + 1))
    up = _line(left[:, -1], np.array([0.0, radius]), np.linspace(0, 1, x.size - split))
    return [
        band,
        transfinite(bottom[:, : split + 1], level, left, spoke),
        transfinite(bottom[:, split:], outwards, spoke, rise),
        transfinite(level, crown, up, outwards),
    ]


def _round_punch(sample, a, grading):
    """Three patches inside the circle of radius a, two rings of quadrilaterals from there to the sample's side."""
    outer = sample.diameter / 2 if sample.shape == "disc" else min(sample.length, sample.width) / 2
    if a > 0.95 * outer:
        raise MeshError(f"the indenter's contact radius {a:g} mm leaves no room on the sample (half-width {outer:g} mm)")
    radii = graded(0, a, grading, at=a, least=3)[::-1]
    core = 0.4 * a
    rings = radii[radii > core * 1.05][::-1]
    around = max(4, int(np.ceil(a * np.pi / 4 / grading.size)), int(np.ceil(4 * np.sqrt(a / grading.size))))
    s = np.linspace(0, 1, around + 1)
    corner = 0.75 * core * np.ones(2)
    diagonal = np.pi / 4 if sample.shape == "disc" else np.arctan2(sample.width, sample.length)
    diagonal = np.clip(diagonal, np.pi / 8, 3 * np.pi / 8)
    bottom, left = _line(np.zeros(2), np.array([core, 0]), s), _line(np.zeros(2), np.array([0, core]), s)
    right, top = _line(np.array([core, 0]), corner, s), _line(np.array([0, core]), corner, s)
    patches = [transfinite(bottom, top, left, right)]
    reach = graded(a, _reach(sample), grading, at=a, least=2)
    for side, first in ((right, 0.0), (top, np.pi / 2)):
        angles = np.linspace(first, diagonal, around + 1)
        shares = np.concatenate([[0], (rings - core) / (a - core)])
        circle = _arc(a, angles)
        inner = side[:, :, None] + (circle - side)[:, :, None] * shares
        wall = _wall(sample, angles, first)
        share = (reach - a) / (reach[-1] - a)
        outer_ring = circle[:, :, None] + (wall - circle)[:, :, None] * share
        patches += [inner, outer_ring]
    return patches


def _reach(sample):
    return sample.diameter / 2 if sample.shape == "disc" else max(sample.length, sample.width) / 2


def _wall(sample, angles, first):
    """Points of the sample's side that belong to angles from the x axis (first = 0) or from the z axis to the diagonal."""
    if sample.shape == "disc":
        return _arc(sample.diameter / 2, angles)
    corner = np.array([sample.length / 2, sample.width / 2])
    if first == 0:
        return np.array([np.full_like(angles, corner[0]), corner[1] * np.tan(angles) / np.tan(angles[-1])])
    return np.array([corner[0] * np.tan(np.pi / 2 - angles) / np.tan(np.pi / 2 - angles[-1]), np.full_like(angles, corner[1])])


def _arc(radius, angles):
    return radius * np.array([np.cos(angles), np.sin(angles)])


def _line(start, stop, shares):
    return start[:, None] + (stop - start)[:, None] * shares


def transfinite(bottom, top, left, right):
    """Grid (2, m, n) that fills four sides: bottom, top (2, m) and left, right (2, n) (Gordon and Hall 1973)."""
    u0, u1, v0, v1 = (_share(side) for side in (bottom, top, left, right))
    du, dv = (u1 - u0)[:, None], (v1 - v0)[None, :]
    u = (u0[:, None] + v0[None, :] * du) / (1 - du * dv)
    v = v0[None, :] + u * dv
    sides = (1 - v) * bottom[:, :, None] + v * top[:, :, None] + (1 - u) * left[:, None, :] + u * right[:, None, :]
    a, b, c, d = (p[:, None, None] for p in (bottom[:, 0], bottom[:, -1], top[:, 0], top[:, -1]))
    return sides - ((1 - u) * (1 - v) * a + u * (1 - v) * b + (1 - u) * v * c + u * v * d)


def _share(side):
    """Share of a side's length at each of its points."""
    length = np.concatenate([[0], np.cumsum(np.hypot(*np.diff(side)))])
    return length / length[-1]


# ---- assembly ----------------------------------------------------------------------------------------------------


def merge(patches):
    """One MeshQuad of (x, z) from patches (2, m, n); points closer than 1e-6 of its extent become one."""
    points, cells, offset = [], [], 0
    for patch in patches:
        m, n = patch.shape[1:]
        number = np.arange(m * n).reshape(m, n) + offset
        cell = np.array([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]]).reshape(4, -1)
        points.append(patch.reshape(2, -1))
        cells.append(cell)
        offset += m * n
    p, t = np.hstack(points), np.hstack(cells)
    keys = np.round(p / (1e-6 * np.abs(p).max())).astype(np.int64)
    _, first, inverse = np.unique(keys, axis=1, return_index=True, return_inverse=True)
    t = inverse.reshape(-1)[t]
    p = p[:, first]
    negative = _areas(p, t) < 0
    t[:, negative] = t[::-1, negative]
    return MeshQuad(np.ascontiguousarray(p), np.ascontiguousarray(t))


def _areas(p, t):
    x, z = p[:, t]
    return 0.5 * ((x[2] - x[0]) * (z[3] - z[1]) - (x[3] - x[1]) * (z[2] - z[0]))


def extrude(plane, heights):
    """MeshHex of a MeshQuad in (x, z) and the heights of its layers along y."""
    n, layers = plane.p.shape[1], heights.size
    x, z = plane.p
    p = np.array([np.tile(x, layers), np.repeat(heights, n), np.tile(z, layers)])
    a, b, c, d = (plane.t[:, None, :] + n * np.arange(layers - 1)[None, :, None]).reshape(4, -1)
    return MeshHex(p, np.array([a, d, a + n, b, d + n, c, b + n, c + n]))


def quadratic(mesh, circles=(), rolls=(), closest=0.0):
    """MeshHex2 of an extruded MeshHex.

    Edges between points of one of the circles (radii about the y axis, mm) follow it. On the facets `rolls`, which may roll up
    against the indenter, the first nodes below the top are at MIDDLE of the top layer or, where that is less than `closest` mm,
    so far, or in the middle. Faces and bricks follow their edges (transfinite).
    """
    finer = MeshHex2.from_mesh(mesh)
    p, dofs = finer.p.copy(), finer.dofs
    ends = mesh.p[:, mesh.edges]
    edges = ends.mean(axis=1)
    radii = np.hypot(ends[0], ends[2])
    for radius in circles:
        on = np.all(np.abs(radii - radius) < 1e-9 * radius, axis=0)
        edges[::2, on] *= radius / np.hypot(edges[0, on], edges[2, on])
    low, high = np.unique(mesh.p[1])[-2:]
    rim = np.unique(mesh.f2e[:, rolls])
    rim = rim[(ends[1, :, rim].min(axis=1) == low) & (ends[1, :, rim].max(axis=1) == high)]
    edges[1, rim] = high - max(MIDDLE * (high - low), min(closest, (high - low) / 2))
    faces = edges[:, mesh.f2e].sum(axis=1) / 2 - mesh.p[:, mesh.facets].sum(axis=1) / 4
    bricks = faces[:, mesh.t2f].sum(axis=1) / 2 - edges[:, mesh.t2e].sum(axis=1) / 4 + mesh.p[:, mesh.t].sum(axis=1) / 8
    for numbers, values in ((dofs.edge_dofs, edges), (dofs.facet_dofs, faces), (dofs.interior_dofs, bricks)):
        p[:, numbers[0]] = values
    return MeshHex2(p, mesh.t).with_boundaries(mesh.boundaries or {})


def _circles(task):
    """Radii that the sample's side and a round footprint follow, mm."""
    side = [task.sample.diameter / 2] if task.sample.shape == "disc" else []
    return side if task.indenter.shape == "strip" else [*side, _radius_to_resolve(task)]
