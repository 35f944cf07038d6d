"""Shapes of samples: one class for each, which alone knows its keys, its outline and its words.

A third party's shape registers with `SHAPES.register` or in the entry-point group `indentfit.samples`. It may use the keys of the
case's table [sample]; another key would have to be a field of that table first.
"""

from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np

from indentfit.arrays import Array
from indentfit.digits import sizes
from indentfit.shapes import Registry


@dataclass(frozen=True)
class Circle:
    """The outline of a round sample in the (x, z) plane; radius in mm."""

    radius: float

    @property
    def extent(self) -> tuple[float, float]:
        """Full size along x and along z, mm."""
        return 2 * self.radius, 2 * self.radius

    @property
    def inscribed(self) -> float:
        """Radius of the largest circle about the middle that lies inside, mm."""
        return self.radius

    @property
    def reach(self) -> float:
        """Longest way from the middle to a side along an axis, mm."""
        return self.radius

    @property
    def diagonal(self) -> float:
        """Angle from the x axis at which the part of the outline that faces x meets the part that faces z, rad."""
        return np.pi / 4

    @property
    def circles(self) -> tuple[float, ...]:
        """Radii of the arcs of the outline about the middle, mm."""
        return (self.radius,)

    def facing(self, axis: str, angles: Array) -> Array:
        """Points (2, n) of the outline, mm, at angles from the x axis, rad, in the part that faces an axis, "x" or "z"."""
        return self.radius * np.array([np.cos(angles), np.sin(angles)])


@dataclass(frozen=True)
class Rectangle:
    """The outline of a sample with four straight sides; half-lengths along x and along z in mm. `Circle` has the same members."""

    half_length: float
    half_width: float

    @property
    def extent(self) -> tuple[float, float]:
        """Full size along x and along z, mm."""
        return 2 * self.half_length, 2 * self.half_width

    @property
    def inscribed(self) -> float:
        """Radius of the largest circle about the middle that lies inside, mm."""
        return min(self.half_length, self.half_width)

    @property
    def reach(self) -> float:
        """Longest way from the middle to a side along an axis, mm."""
        return max(self.half_length, self.half_width)

    @property
    def diagonal(self) -> float:
        """Angle from the x axis to the corner, rad."""
        return float(np.arctan2(self.half_width, self.half_length))

    @property
    def circles(self) -> tuple[float, ...]:
        """Radii of the arcs of the outline: none."""
        return ()

    def facing(self, axis: str, angles: Array) -> Array:
        """Points (2, n) of the side that an axis, "x" or "z", meets, mm.

        The last of the angles belongs to the corner. The angles' tangents become shares of the side, so that the last point is
        exactly the corner in spite of round-off in the angle.
        """
        if axis == "x":
            return np.array([np.full_like(angles, self.half_length), self.half_width * np.tan(angles) / np.tan(angles[-1])])
        across = np.pi / 2 - angles
        return np.array([self.half_length * np.tan(across) / np.tan(across[-1]), np.full_like(angles, self.half_width)])


Outline = Circle | Rectangle


def outside(points: Array, outline: Outline, thickness: float) -> Array:
    """How far points (m, 3) lie outside of a sample, mm, (m,); 0 inside."""
    x, y, z = np.abs(points[:, 0]), points[:, 1], np.abs(points[:, 2])
    if isinstance(outline, Circle):
        sideways = np.hypot(x, z) - outline.radius
    else:
        sideways = np.maximum(x - outline.half_length, z - outline.half_width)
    return np.asarray(np.maximum.reduce([sideways, -y, y - thickness, np.zeros(len(points))]))


def inside(points: Array, outline: Outline, thickness: float) -> Array:
    """Points (m, 3) moved onto the surface of a sample where they lie outside, mm."""
    x, y, z = points.T
    y = np.clip(y, 0.0, thickness)
    if isinstance(outline, Circle):
        inwards = np.minimum(1.0, outline.radius / np.maximum(np.hypot(x, z), 1e-300))
        return np.column_stack([x * inwards, y, z * inwards])
    width = outline.half_length, outline.half_width
    return np.column_stack([np.clip(x, -width[0], width[0]), y, np.clip(z, -width[1], width[1])])


class SampleShape(Protocol):
    """The shape of a sample, a right prism along y: all that meshes, messages and reports ask of a sample's shape.

    A shape is a frozen dataclass (see `shapes.Registry` for what its fields are), so that it can be compared and hashed.
    """

    name: ClassVar[str]
    """Value of sample.shape in a case, and the word of reports."""

    @property
    def outline(self) -> Outline:
        """The outline in the (x, z) plane, centred on the axis of indentation. Meshes know circles and rectangles."""
        ...

    def words(self) -> str:
        """The shape and its sizes, such as "disc, diameter 14 mm"."""
        ...


SHAPES: Registry[SampleShape] = Registry("sample", "indentfit.samples")


@SHAPES.register
@dataclass(frozen=True)
class Disc:
    """A flat cylinder with a diameter in mm."""

    name: ClassVar[str] = "disc"
    diameter: float

    @property
    def outline(self) -> Circle:
        """A circle."""
        return Circle(self.diameter / 2)

    def words(self) -> str:
        """The shape and its diameter."""
        return f"disc, diameter {sizes(self.diameter)}"


@SHAPES.register
@dataclass(frozen=True)
class Block:
    """A cuboid; length along x and width along z in mm."""

    name: ClassVar[str] = "block"
    length: float
    width: float

    @property
    def outline(self) -> Rectangle:
        """A rectangle."""
        return Rectangle(self.length / 2, self.width / 2)

    def words(self) -> str:
        """The shape and its sizes along x and z."""
        return f"block, {sizes(self.length, self.width)} (x, z)"
