"""Indenters whose contact grows with the depth: the sphere, the cone, and the wedge, which is a strip with a point."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from indentfit.arrays import Array, Bools
from indentfit.digits import sizes
from indentfit.indenters.distances import Flank, from_ball_on_shaft, from_drawn_out, from_revolved
from indentfit.indenters.fit import other_sizes, too_wide
from indentfit.indenters.shape import SHAPES, Band, Distance, End, Rings

REACH = 1.5  # of a sphere's radius: material from beside the sphere, which the surface's sinking draws to its shaft


@SHAPES.register
@dataclass(frozen=True)
class Sphere:
    """A sphere with a diameter in mm. From its middle upwards it goes on as a shaft of its diameter."""

    name: ClassVar[str] = "sphere"
    end: ClassVar[End] = "sphere"
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
        """A sphere whose section at the height of the sample's top is too wide."""
        sunk = min(depth, self.diameter / 2)
        yield from _imprint_too_wide("diameter", 2 * math.sqrt(max(sunk * (self.diameter - sunk), 0.0)), depth, min(extent))

    def partition(self, depth: float) -> Rings:
        """The contact by Hertz, of radius sqrt(R depth)."""
        radius = self.diameter / 2
        return Rings(min(np.sqrt(radius * depth), radius))

    def may_touch(self, x: Array, z: Array) -> Bools:
        """All points below the sphere, and those beside it that the sinking surface draws to the shaft."""
        return np.hypot(x, z) < REACH * self.diameter / 2

    def distance(self, x: Array, bottom: float) -> Distance:
        """Distance from the sphere's middle, or above it from the axis, less the radius."""
        return from_ball_on_shaft(self.diameter / 2, x, bottom)

    def motion_off_edge(self, x: Array, u: Array) -> Array:
        """A sphere has no edge: no point lies on it."""
        return np.zeros(0)

    def words(self) -> str:
        """The shape and its diameter."""
        return f"sphere, diameter {sizes(self.diameter)}"

    def variants(self, extent: tuple[float, float]) -> Iterator[tuple[str, float]]:
        """Half and twice the diameter."""
        yield from other_sizes("diameter", self.diameter, min(extent))


class _OnFlank:
    """What a cone and a wedge share: the contact ends on the flank, not at an edge, so that no point lies on an edge."""

    half_angle: float
    tip_radius: float

    @property
    def across(self) -> float | None:
        """Width between the flank's ends, mm; None where the flank has no end."""
        raise NotImplementedError

    @property
    def flank(self) -> Flank:
        """The outline."""
        return Flank(math.radians(self.half_angle), self.tip_radius, self.across / 2 if self.across else math.inf)

    @property
    def half_width(self) -> float:
        """Half of the width between the flank's ends, or the tip's radius where the flank has no end, mm."""
        return self.across / 2 if self.across else self.tip_radius

    @property
    def edge_radius(self) -> None:
        """There is no edge."""
        return None

    @property
    def curvature(self) -> float:
        """Curvature of the tip, 1/mm; the straight flank has none, and material cannot roll off a sharp tip."""
        return 1 / self.tip_radius if self.tip_radius else 0.0

    def motion_off_edge(self, x: Array, u: Array) -> Array:
        """No point lies on an edge."""
        return np.zeros(0)

    def variants(self, extent: tuple[float, float]) -> Iterator[tuple[str, float]]:
        """A blunter and a sharper indenter."""
        yield from _other_angles(self.half_angle)


@SHAPES.register
@dataclass(frozen=True)
class Cone(_OnFlank):
    """A cone with a rounded tip.

    half_angle is the angle between the axis and the flank in degrees, tip_radius the radius of a ball that blends tangentially into
    the flank, mm, and diameter that of the shaft at which the flank ends, mm; without it the flank is as long as it need be.
    """

    name: ClassVar[str] = "cone"
    end: ClassVar[End] = "cone"
    half_angle: float
    tip_radius: float = 0.0
    diameter: float | None = None

    @property
    def across(self) -> float | None:
        """The diameter."""
        return self.diameter

    def faults(self) -> Iterator[tuple[str, str]]:
        """A tip that is wider than the shaft."""
        yield from _tip_too_wide(self.flank, "diameter", self.diameter)

    def faults_on(self, extent: tuple[float, float], depth: float) -> Iterator[tuple[str, str]]:
        """A flank that ends below the sample's top, or whose section at the height of the top is too wide."""
        yield from _flank_ends(self.flank, "diameter", depth)
        yield from _imprint_too_wide("half_angle", 2 * _section(self.flank, depth), depth, min(extent))

    def partition(self, depth: float) -> Rings:
        """The contact on a half-space: Sneddon's radius 2 / pi depth tan(half_angle), or with a tip that of a blunt cone."""
        return Rings(_contact(depth, self.flank, self._depth_of))

    def _depth_of(self, a: float) -> float:
        """Depth at which a blunt cone's contact on a half-space has the radius a: Briscoe et al. 1994 (J Phys D 27:1156)."""
        flank, b = self.flank, self.flank.blend
        if a <= b:
            return a * a / self.tip_radius
        rounded = (a - math.sqrt(a * a - b * b)) / self.tip_radius if b else 0.0
        return a * (math.acos(b / a) / math.tan(flank.angle) + rounded)

    def may_touch(self, x: Array, z: Array) -> Bools:
        """All points below the flank, and beside it those that the sinking surface draws to the shaft."""
        return np.hypot(x, z) < REACH * self.flank.shaft

    def distance(self, x: Array, bottom: float) -> Distance:
        """Distance from the nearest of tip, flank and shaft."""
        return from_revolved(self.flank, x, bottom)

    def words(self) -> str:
        """The shape, its angle and tip, and where its flank ends."""
        return f"cone, {_words_of_flank(self.flank)}" + (f", diameter {sizes(self.diameter)}" if self.diameter else "")


@SHAPES.register
@dataclass(frozen=True)
class Wedge(_OnFlank):
    """A bar with a wedge's point, whose line lies along x: a strip with a flank. It must overhang the sample along x.

    half_angle is the angle between the plane of symmetry and the flank in degrees, tip_radius the radius of a cylinder that blends
    tangentially into the flank, mm; length along x, and width along z at which the flank ends, mm; without a width the flank is as
    long as it need be.
    """

    name: ClassVar[str] = "wedge"
    end: ClassVar[End] = "flat"
    half_angle: float
    length: float
    tip_radius: float = 0.0
    width: float | None = None

    @property
    def across(self) -> float | None:
        """The width."""
        return self.width

    def faults(self) -> Iterator[tuple[str, str]]:
        """A tip that is wider than the bar."""
        yield from _tip_too_wide(self.flank, "width", self.width)

    def faults_on(self, extent: tuple[float, float], depth: float) -> Iterator[tuple[str, str]]:
        """A wedge that ends on the sample, a flank that ends below the sample's top, or one that is too wide there."""
        if self.length < extent[0]:
            yield (
                "length",
                f"the ends of a wedge are sharp and cannot press; make it longer than the sample, {sizes(extent[0])} along x",
            )
        yield from _flank_ends(self.flank, "width", depth)
        yield from _imprint_too_wide("half_angle", 2 * _section(self.flank, depth), depth, extent[1])

    def partition(self, depth: float) -> Band:
        """The width that the flank has at two thirds of the depth, because the surface sinks in beside the wedge."""
        return Band(self.length / 2, max(_section(self.flank, 2 / 3 * depth), 1e-3 * depth))

    def may_touch(self, x: Array, z: Array) -> Bools:
        """All points below the flank, and beside it those that the sinking surface draws to the bar's sides."""
        return (x < self.length / 2) & (z < REACH * self.flank.shaft)

    def distance(self, x: Array, bottom: float) -> Distance:
        """Distance from the nearest of tip, flank and side."""
        return from_drawn_out(self.flank, x, bottom)

    def words(self) -> str:
        """The shape, its length, its angle and tip, and where its flank ends."""
        width = f", width {sizes(self.width)} (z)" if self.width else ""
        return f"wedge, {sizes(self.length)} long (x), {_words_of_flank(self.flank)}{width}"


# What several shapes have in common


def _imprint_too_wide(key: str, width: float, depth: float, across: float) -> Iterator[tuple[str, str]]:
    for _, text in too_wide(key, width, across):
        yield key, f"the imprint at {sizes(depth)} is {sizes(width)} wide, {text}"


def _tip_too_wide(flank: Flank, key: str, width: float | None) -> Iterator[tuple[str, str]]:
    if width is not None and flank.blend >= flank.shaft:
        yield (
            "tip_radius",
            f"the tip alone is {sizes(2 * flank.blend)} wide, and the indenter's {key} {sizes(width)}; make it smaller",
        )


def _flank_ends(flank: Flank, key: str, depth: float) -> Iterator[tuple[str, str]]:
    if flank.height < depth:
        ends = f"the flank ends {sizes(flank.height)} above the tip, below the top at {sizes(depth)}"
        yield key, f"{ends}; its edge cannot press: enlarge it"


def _section(flank: Flank, height: float) -> float:
    """Half-width at a height above the lowest point, mm."""
    drop = flank.tip * (1 - math.sin(flank.angle))
    if height < drop:
        return math.sqrt(height * (2 * flank.tip - height))
    return min(flank.blend + (height - drop) * math.tan(flank.angle), flank.shaft)


def _contact(depth: float, flank: Flank, depth_of: Callable[[float], float]) -> float:
    """The contact's half-width at a depth, where `depth_of` gives the depth of a half-width; both in mm."""
    if depth <= 0:
        return 0.0
    low, high = 0.0, max(depth * math.tan(flank.angle), flank.blend) + math.sqrt(flank.tip * depth)
    for _ in range(50):
        middle = (low + high) / 2
        low, high = (middle, high) if depth_of(middle) < depth else (low, middle)
    return min(high, flank.shaft)


def _words_of_flank(flank: Flank) -> str:
    tip = f"tip radius {sizes(flank.tip)}" if flank.tip else "sharp tip"
    return f"half-angle {math.degrees(flank.angle):g} degrees, {tip}"


def _other_angles(angle: float) -> Iterator[tuple[str, float]]:
    """Angles half-way to a needle and to a flat face."""
    yield from (("half_angle", changed) for changed in (angle / 2, (90 + angle) / 2) if 10 <= changed <= 85)
