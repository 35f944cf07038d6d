"""Shapes of rigid indenters: one class for each, which alone knows its keys, its face, what meshes need of it, and its words.

A third party's shape registers with `SHAPES.register` or in the entry-point group `indentfit.indenters`. It may use the keys of the
case's table [indenter]; another key would have to be a field of that table first.

Axes: y is the axis of indentation; the indenter is centred on the axis x = z = 0, above the sample. All lengths in mm.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar, Literal, NamedTuple, Protocol

import numpy as np

from indentfit.arrays import Array, Bools
from indentfit.shapes import Registry

WIDEST_INDENTER = 0.9  # of the sample's width: the free border beside a wider indenter is too narrow to mesh and to trust
UP, _DOWN = np.array([0.0, 1.0, 0.0]), np.array([0.0, -1.0, 0.0])


class Distance(NamedTuple):
    """Signed distance of points from an indenter's face, with its derivatives.

    Attributes
    ----------
    gap : array (...), mm
        The distance, positive outside of the indenter.
    normal : array (..., 3)
        Gradient of the distance: unit vectors.
    bend : array (..., 3, 3), 1/mm, or None
        Hessian of the distance; None where the face is flat.
    """

    gap: Array
    normal: Array
    bend: Array | None


@dataclass(frozen=True)
class Band:
    """A rectangular contact; lengths in mm.

    Mesh lines follow the long sides z = half_width, and the ends x = half_length where these lie on the sample. A contact that
    reaches beyond the sample along x overhangs the sample, whose side may then roll up against the indenter (see fem/contact.py).
    """

    half_length: float
    half_width: float

    @property
    def circles(self) -> tuple[float, ...]:
        """Radii of arcs that mesh lines follow: none."""
        return ()


@dataclass(frozen=True)
class Rings:
    """A round contact: mesh lines follow the circle of this radius, mm."""

    radius: float

    @property
    def half_width(self) -> float:
        """The radius, mm."""
        return self.radius

    @property
    def circles(self) -> tuple[float, ...]:
        """Radii of arcs that mesh lines, and the edges of quadratic bricks, follow, mm."""
        return (self.radius,)


class IndenterShape(Protocol):
    """The shape of an indenter: all that the case, meshes, contact, studies and reports ask of an indenter.

    A shape is a frozen dataclass (see `shapes.Registry` for what its fields are), so that it can be compared and hashed. It must
    be symmetric about the planes x = 0 and z = 0, because a quarter of the sample is computed.
    """

    name: ClassVar[str]
    """Value of indenter.shape in a case, and the word of reports."""

    end: ClassVar[Literal["flat", "sphere"]]
    """How the force begins to grow with the depth, for the contact point of a raw record: linearly, or as under a sphere."""

    @property
    def half_width(self) -> float:
        """Half of the indenter's shorter side, or its radius, mm."""
        ...

    @property
    def edge_radius(self) -> float | None:
        """Radius of the edge of a flat face, mm; 0 for a sharp edge; None where the face has no edge.

        The contact with a sharp edge is confined to the material face of the footprint, and `distance` is that of the flat face.
        """
        ...

    @property
    def curvature(self) -> float:
        """Largest curvature of the face that material may roll off, 1/mm; 0 for a flat face with a sharp edge."""
        ...

    def faults(self) -> Iterator[tuple[str, str]]:
        """(key, what is wrong and what to do) of keys that do not agree with each other."""
        ...

    def faults_on(self, extent: tuple[float, float], depth: float) -> Iterator[tuple[str, str]]:
        """(key, what is wrong and what to do) where the indenter does not fit on a sample.

        Parameters
        ----------
        extent : (x, z), mm
            Size of the sample along x and z.
        depth : float, mm
            Largest depth of the tests; 0 where it is not known.
        """
        ...

    def partition(self, depth: float) -> Band | Rings:
        """The region of contact at a depth in mm, to whose edge meshes are refined. Meshes know rectangles and circles."""
        ...

    def may_touch(self, x: Array, z: Array) -> Bools:
        """Which points of the top, at x and z (n,) in mm, may come into contact.

        A sharp edge confines the contact to the footprint's material face. A rounded edge, and a sphere, can also be met by
        material from beside the footprint.
        """
        ...

    def distance(self, x: Array, bottom: float) -> Distance:
        """Signed distance of points from the indenter.

        Parameters
        ----------
        x : array (..., 3), mm
            Points around the indenter or slightly inside of it.
        bottom : float, mm
            Height y of the indenter's lowest point.
        """
        ...

    def motion_off_edge(self, x: Array, u: Array) -> Array:
        """Motion away from the indenter, mm, of those points that lie on its sharp edge; called only where there is a sharp edge.

        Parameters
        ----------
        x, u : arrays (3, n), mm
            Points of the undeformed top, and their displacements.
        """
        ...

    def words(self) -> str:
        """The shape, its sizes and its edge, such as "sphere, diameter 5 mm"."""
        ...

    def variants(self, extent: tuple[float, float]) -> Iterator[tuple[str, float]]:
        """(key, value) of other sizes to try on a sample of an extent (x, z), one change at a time; all in mm."""
        ...


SHAPES: Registry[IndenterShape] = Registry("indenter", "indentfit.indenters")


def has_sharp_edge(shape: IndenterShape) -> bool:
    """Whether the contact ends at a sharp edge."""
    return shape.edge_radius == 0


@SHAPES.register
@dataclass(frozen=True)
class Strip:
    """A bar with a flat face: length along x, width along z, radius of its edges, mm. It may overhang the sample along x."""

    name: ClassVar[str] = "strip"
    end: ClassVar[Literal["flat", "sphere"]] = "flat"
    width: float
    length: float
    edge_radius: float = 0.0

    @property
    def half_width(self) -> float:
        """Half of the width, mm."""
        return self.width / 2

    @property
    def curvature(self) -> float:
        """Curvature of the edge, 1/mm."""
        return _curvature_of_edge(self.edge_radius)

    def faults(self) -> Iterator[tuple[str, str]]:
        """Too large a radius of the edge."""
        yield from _faults_of_edge(self.edge_radius, self.width)

    def faults_on(self, extent: tuple[float, float], depth: float) -> Iterator[tuple[str, str]]:
        """Too wide a strip; its length may exceed the sample's."""
        yield from _too_wide("width", self.width, extent[1])

    def partition(self, depth: float) -> Band:
        """All of the face, whatever the depth."""
        return Band(self.length / 2, self.width / 2)

    def may_touch(self, x: Array, z: Array) -> Bools:
        """The footprint, and half a radius of the edge beside it."""
        return (x < self.length / 2 + self.edge_radius / 2) & (z < self.width / 2 + self.edge_radius / 2)

    def distance(self, x: Array, bottom: float) -> Distance:
        """Distance from the plane of a face with a sharp edge, or from a bar with rounded edges."""
        if not self.edge_radius:
            return _from_plane(x, bottom)
        return _from_rounded_bar((self.length / 2, self.width / 2), self.edge_radius, x, bottom)

    def motion_off_edge(self, x: Array, u: Array) -> Array:
        """Motion along z of the points on the long edge."""
        return u[2][np.abs(x[2] - self.half_width) < 1e-6 * self.half_width]

    def words(self) -> str:
        """The shape, its sizes along z and x, and its edge."""
        return f"strip, {self.width:g} x {self.length:g} mm (z, x), {_words_of_edge(self.edge_radius)}"

    def variants(self, extent: tuple[float, float]) -> Iterator[tuple[str, float]]:
        """Half and twice the width, and a strip that ends on the sample."""
        length, width = extent
        yield from _other_sizes("width", self.width, width)
        if self.length > 0.5 * length:
            yield "length", 0.5 * length


@SHAPES.register
@dataclass(frozen=True)
class Cylinder:
    """An upright cylinder with a flat face: diameter and radius of its edge, mm."""

    name: ClassVar[str] = "cylinder"
    end: ClassVar[Literal["flat", "sphere"]] = "flat"
    diameter: float
    edge_radius: float = 0.0

    @property
    def half_width(self) -> float:
        """The radius, mm."""
        return self.diameter / 2

    @property
    def curvature(self) -> float:
        """Curvature of the edge, 1/mm."""
        return _curvature_of_edge(self.edge_radius)

    def faults(self) -> Iterator[tuple[str, str]]:
        """Too large a radius of the edge."""
        yield from _faults_of_edge(self.edge_radius, self.diameter)

    def faults_on(self, extent: tuple[float, float], depth: float) -> Iterator[tuple[str, str]]:
        """Too wide a cylinder."""
        yield from _too_wide("diameter", self.diameter, min(extent))

    def partition(self, depth: float) -> Rings:
        """All of the face, whatever the depth."""
        return Rings(self.diameter / 2)

    def may_touch(self, x: Array, z: Array) -> Bools:
        """The footprint, and half a radius of the edge beside it."""
        return np.hypot(x, z) < self.diameter / 2 + self.edge_radius / 2

    def distance(self, x: Array, bottom: float) -> Distance:
        """Distance from the plane of a face with a sharp edge, or from a cylinder with a rounded edge."""
        if not self.edge_radius:
            return _from_plane(x, bottom)
        return _from_rounded_cylinder(self.diameter / 2, self.edge_radius, x, bottom)

    def motion_off_edge(self, x: Array, u: Array) -> Array:
        """Radial motion of the points on the edge."""
        away = np.hypot(x[0], x[2])
        radial = (u[0] * x[0] + u[2] * x[2]) / np.where(away > 0, away, 1)
        return radial[np.abs(away - self.half_width) < 1e-6 * self.half_width]

    def words(self) -> str:
        """The shape, its diameter and its edge."""
        return f"cylinder, diameter {self.diameter:g} mm, {_words_of_edge(self.edge_radius)}"

    def variants(self, extent: tuple[float, float]) -> Iterator[tuple[str, float]]:
        """Half and twice the diameter."""
        yield from _other_sizes("diameter", self.diameter, min(extent))


@SHAPES.register
@dataclass(frozen=True)
class Sphere:
    """A sphere with a diameter in mm."""

    name: ClassVar[str] = "sphere"
    end: ClassVar[Literal["flat", "sphere"]] = "sphere"
    diameter: float

    @property
    def half_width(self) -> float:
        """The radius, mm."""
        return self.diameter / 2

    @property
    def edge_radius(self) -> None:
        """A sphere has no edge."""
        return None

    @property
    def curvature(self) -> float:
        """Curvature of the sphere, 1/mm."""
        return 2 / self.diameter

    def faults(self) -> Iterator[tuple[str, str]]:
        """No fault: a sphere has one key, with which no other key can disagree."""
        yield from ()

    def faults_on(self, extent: tuple[float, float], depth: float) -> Iterator[tuple[str, str]]:
        """A sphere that sinks in by half, or whose section at the height of the sample's top is too wide."""
        if depth >= self.diameter / 2:
            yield "diameter", f"the sphere sinks in by half at {depth:g} mm; check the units"
            return
        imprint = 2 * math.sqrt(max(depth * (self.diameter - depth), 0.0))
        yield from _too_wide("diameter", imprint, min(extent))

    def partition(self, depth: float) -> Rings:
        """The contact by Hertz, of radius sqrt(R depth)."""
        radius = self.diameter / 2
        return Rings(min(np.sqrt(radius * depth), radius))

    def may_touch(self, x: Array, z: Array) -> Bools:
        """All points below the sphere."""
        return np.hypot(x, z) < self.diameter / 2

    def distance(self, x: Array, bottom: float) -> Distance:
        """Distance from the centre, less the radius."""
        away = x - np.array([0.0, bottom + self.diameter / 2, 0.0])
        length = np.sqrt(np.einsum("...i,...i->...", away, away))
        n = away / length[..., None]
        return Distance(length - self.diameter / 2, n, (np.eye(3) - n[..., :, None] * n[..., None, :]) / length[..., None, None])

    def motion_off_edge(self, x: Array, u: Array) -> Array:
        """A sphere has no edge: no point lies on it."""
        return np.zeros(0)

    def words(self) -> str:
        """The shape and its diameter."""
        return f"sphere, diameter {self.diameter:g} mm"

    def variants(self, extent: tuple[float, float]) -> Iterator[tuple[str, float]]:
        """Half and twice the diameter."""
        yield from _other_sizes("diameter", self.diameter, min(extent))


# What several shapes have in common


def _curvature_of_edge(radius: float) -> float:
    return 1 / radius if radius else 0.0


def _faults_of_edge(radius: float, width: float) -> Iterator[tuple[str, str]]:
    if 2 * radius > width:
        yield "edge_radius", f"must not exceed half of the indenter's {width:g} mm"


def _too_wide(key: str, width: float, across: float) -> Iterator[tuple[str, str]]:
    room = WIDEST_INDENTER * across
    if width >= room:
        yield key, f"too wide for the sample of {room / WIDEST_INDENTER:g} mm; it must stay below {room:g} mm"


def _words_of_edge(radius: float) -> str:
    return f"edge radius {radius:g} mm" if radius else "sharp edge"


def _other_sizes(key: str, size: float, across: float) -> Iterator[tuple[str, float]]:
    """Half and twice the size, where they leave a free border on a sample that is `across` mm wide."""
    yield from ((key, factor * size) for factor in (0.5, 2.0) if factor * size < WIDEST_INDENTER * across)


# Signed distances


def _from_plane(x: Array, bottom: float) -> Distance:
    return Distance(bottom - x[..., 1], np.broadcast_to(_DOWN, x.shape), None)


def _from_rounded_bar(half_lengths: tuple[float, float], r: float, x: Array, bottom: float) -> Distance:
    """Distance from a bar with half-lengths along x and along z: r less than the distance from the bar's core."""
    a, b = half_lengths
    away = np.stack(
        [
            np.sign(x[..., 0]) * np.maximum(np.abs(x[..., 0]) - (a - r), 0),
            np.minimum(x[..., 1] - (bottom + r), 0),
            np.sign(x[..., 2]) * np.maximum(np.abs(x[..., 2]) - (b - r), 0),
        ],
        axis=-1,
    )
    distance, n, inside = _length_and_direction(away)
    free = np.eye(3) * (away != 0)[..., None, :]
    bend = (free - _square(n)) / np.where(inside, np.inf, distance)[..., None, None]
    return Distance(np.where(inside, bottom - x[..., 1], distance - r), n, bend)


def _from_rounded_cylinder(a: float, r: float, x: Array, bottom: float) -> Distance:
    """Distance from a cylinder of radius a: r less than the distance from the cylinder's core."""
    rho = np.hypot(x[..., 0], x[..., 2])
    beyond = np.maximum(rho - (a - r), 0)
    safe = np.where(rho > 0, rho, 1.0)
    radial = np.stack([x[..., 0] / safe, np.zeros_like(rho), x[..., 2] / safe], axis=-1)
    away = beyond[..., None] * radial + np.minimum(x[..., 1] - (bottom + r), 0)[..., None] * UP
    distance, n, inside = _length_and_direction(away)
    out = np.einsum("...i,...i->...", away, radial) != 0
    free = out[..., None, None] * _square(radial)
    free = free + (away[..., 1] != 0)[..., None, None] * UP[:, None] * UP
    hoop = np.stack([-radial[..., 2], np.zeros_like(rho), radial[..., 0]], axis=-1) * np.sqrt(beyond / safe)[..., None]
    bend = (free - _square(n) + _square(hoop)) / np.where(inside, np.inf, distance)[..., None, None]
    return Distance(np.where(inside, bottom - x[..., 1], distance - r), n, bend)


def _length_and_direction(away: Array) -> tuple[Array, Array, Bools]:
    """Lengths and directions of vectors (..., 3) from a core, and which of them are zero: inside, where the flat face counts."""
    distance = np.sqrt(np.einsum("...i,...i->...", away, away))
    inside = distance == 0
    return distance, np.where(inside[..., None], _DOWN, away / np.where(inside, 1.0, distance)[..., None]), inside


def _square(v: Array) -> Array:
    """v v of vectors (..., 3)."""
    return v[..., :, None] * v[..., None, :]
