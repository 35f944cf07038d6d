"""Indenters with a flat face: the strip and the upright cylinder, with sharp or rounded edges."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from indentfit.arrays import Array, Bools
from indentfit.digits import sizes
from indentfit.indenters.distances import from_plane, from_rounded_bar, from_rounded_cylinder
from indentfit.indenters.fit import other_sizes, too_wide
from indentfit.indenters.shape import SHAPES, Band, Distance, End, Rings

PLATES = (
    'a disc between plates that cover it is a test of kind = "compression" (keys length, diameter, plates), without an indenter'
)


@SHAPES.register
@dataclass(frozen=True)
class Strip:
    """A bar with a flat face: length along x, width along z, radius of its edges, mm. It may overhang the sample along x."""

    name: ClassVar[str] = "strip"
    end: ClassVar[End] = "flat"
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
        yield from too_wide("width", self.width, extent[1])

    def partition(self, depth: float) -> Band:
        """All of the face, whatever the depth."""
        return Band(self.length / 2, self.width / 2)

    def may_touch(self, x: Array, z: Array) -> Bools:
        """The footprint, and half a radius of the edge beside it."""
        return (x < self.length / 2 + self.edge_radius / 2) & (z < self.width / 2 + self.edge_radius / 2)

    def distance(self, x: Array, bottom: float) -> Distance:
        """Distance from the plane of a face with a sharp edge, or from a bar with rounded edges."""
        if not self.edge_radius:
            return from_plane(x, bottom)
        return from_rounded_bar((self.length / 2, self.width / 2), self.edge_radius, x, bottom)

    def motion_off_edge(self, x: Array, u: Array) -> Array:
        """Motion along z of the points on the long edge."""
        return u[2][np.abs(x[2] - self.half_width) < 1e-6 * self.half_width]

    def words(self) -> str:
        """The shape, its sizes along z and x, and its edge."""
        return f"strip, {sizes(self.width, self.length)} (z, x), {_words_of_edge(self.edge_radius)}"

    def variants(self, extent: tuple[float, float]) -> Iterator[tuple[str, float]]:
        """Half and twice the width, and a strip that ends on the sample."""
        length, width = extent
        yield from other_sizes("width", self.width, width)
        if self.length > 0.5 * length:
            yield "length", 0.5 * length


@SHAPES.register
@dataclass(frozen=True)
class Cylinder:
    """An upright cylinder with a flat face: diameter and radius of its edge, mm."""

    name: ClassVar[str] = "cylinder"
    end: ClassVar[End] = "flat"
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
        """Too wide a cylinder; one that covers all of the sample is a plate."""
        plate = f"; {PLATES}" if self.diameter >= max(extent) else ""
        yield from ((key, text + plate) for key, text in too_wide("diameter", self.diameter, min(extent)))

    def partition(self, depth: float) -> Rings:
        """All of the face, whatever the depth."""
        return Rings(self.diameter / 2)

    def may_touch(self, x: Array, z: Array) -> Bools:
        """The footprint, and half a radius of the edge beside it."""
        return np.hypot(x, z) < self.diameter / 2 + self.edge_radius / 2

    def distance(self, x: Array, bottom: float) -> Distance:
        """Distance from the plane of a face with a sharp edge, or from a cylinder with a rounded edge."""
        if not self.edge_radius:
            return from_plane(x, bottom)
        return from_rounded_cylinder(self.diameter / 2, self.edge_radius, x, bottom)

    def motion_off_edge(self, x: Array, u: Array) -> Array:
        """Radial motion of the points on the edge."""
        away = np.hypot(x[0], x[2])
        radial = (u[0] * x[0] + u[2] * x[2]) / np.where(away > 0, away, 1)
        return radial[np.abs(away - self.half_width) < 1e-6 * self.half_width]

    def words(self) -> str:
        """The shape, its diameter and its edge."""
        return f"cylinder, diameter {sizes(self.diameter)}, {_words_of_edge(self.edge_radius)}"

    def variants(self, extent: tuple[float, float]) -> Iterator[tuple[str, float]]:
        """Half and twice the diameter."""
        yield from other_sizes("diameter", self.diameter, min(extent))


def _curvature_of_edge(radius: float) -> float:
    return 1 / radius if radius else 0.0


def _faults_of_edge(radius: float, width: float) -> Iterator[tuple[str, str]]:
    if 2 * radius > width:
        yield "edge_radius", f"must not exceed half of the indenter's {sizes(width)}"


def _words_of_edge(radius: float) -> str:
    return f"edge radius {sizes(radius)}" if radius else "sharp edge"
