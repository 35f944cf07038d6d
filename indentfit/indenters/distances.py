"""Signed distances of points from faces of indenters, with their gradients and Hessians."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from indentfit.arrays import Array, Bools
from indentfit.indenters.shape import UP, Distance

_DOWN = np.array([0.0, -1.0, 0.0])


def from_plane(x: Array, bottom: float) -> Distance:
    """Distance from a horizontal plane at the height `bottom`."""
    return Distance(bottom - x[..., 1], np.broadcast_to(_DOWN, x.shape), None)


def from_upright_punch(a: float, x: Array, bottom: float) -> Distance:
    """Distance from a punch of radius a with an upright wall and a sharp edge, of points beside its face.

    Inside, the nearest of the wall and the face counts. Outside it is the larger distance from the two, which is the true one but
    for points off the edge.
    """
    rho = np.hypot(x[..., 0], x[..., 2])
    safe = np.where(rho > 0, rho, 1.0)
    outwards = np.stack([x[..., 0] / safe, np.zeros_like(rho), x[..., 2] / safe], axis=-1)
    beside, below = rho - a, bottom - x[..., 1]
    wall = beside > below
    gap, n = np.where(wall, beside, below), np.where(wall[..., None], outwards, _DOWN)
    hoop = np.stack([-outwards[..., 2], np.zeros_like(rho), outwards[..., 0]], axis=-1)
    return Distance(gap, n, (wall / safe)[..., None, None] * _square(hoop))


def from_rounded_bar(half_lengths: tuple[float, float], r: float, x: Array, bottom: float) -> Distance:
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


def from_rounded_cylinder(a: float, r: float, x: Array, bottom: float) -> Distance:
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


def from_ball_on_shaft(radius: float, x: Array, bottom: float) -> Distance:
    """Distance from a ball, and above its middle from a shaft of the ball's diameter: both lie about one vertical half-line."""
    away = x - np.array([0.0, bottom + radius, 0.0])
    above = away[..., 1] > 0
    away[..., 1] = np.where(above, 0.0, away[..., 1])
    length = np.sqrt(np.einsum("...i,...i->...", away, away))
    free = np.eye(3) - above[..., None, None] * UP[:, None] * UP
    with np.errstate(divide="ignore", invalid="ignore"):  # no normal on the line itself: an iterate that strays there is refused
        n = away / length[..., None]
        return Distance(length - radius, n, (free - _square(n)) / length[..., None, None])


@dataclass(frozen=True)
class Flank:
    """Half of the outline of a point: a circle, blended tangentially into a straight flank, which may end at a shaft.

    Parameters
    ----------
    angle : float, rad
        Between the axis and the flank.
    tip : float, mm
        Radius of the circle; 0 for a sharp tip.
    shaft : float, mm
        Half-width at which the flank ends, and the outline goes on parallel to the axis; infinite where the flank never ends.
    """

    angle: float
    tip: float
    shaft: float = np.inf

    @property
    def blend(self) -> float:
        """Half-width at which the tip becomes the flank, mm."""
        return self.tip * float(np.cos(self.angle))

    @property
    def height(self) -> float:
        """Height of the flank's end above the lowest point, mm."""
        return self.tip * float(1 - np.sin(self.angle)) + (self.shaft - self.blend) / float(np.tan(self.angle))

    def near(self, across: Array, height: Array) -> "Near":
        """The distance of points at (...) mm from the axis and at heights (...) above the lowest point, in their plane."""
        sin, cos = np.sin(self.angle), np.cos(self.angle)
        up = height - self.tip  # from the middle of the tip's circle
        along, gap = across * sin + up * cos, across * cos - up * sin - self.tip
        flank = Near(gap, np.full_like(gap, cos), np.full_like(gap, -sin), np.zeros_like(gap))
        if np.isfinite(self.shaft):
            flank = self._with_shaft(flank, along, across, height)
        if not self.tip:
            return flank
        length = np.maximum(np.hypot(across, up), 1e-300)
        tip = Near(length - self.tip, across / length, up / length, 1 / length)
        return tip.where(along <= 0, flank)

    def _with_shaft(self, flank: "Near", along: Array, across: Array, height: Array) -> "Near":
        """The flank, the corner at its end, or the shaft: the farthest face counts inside, the nearest point outside."""
        shaft = Near(across - self.shaft, np.ones_like(across), np.zeros_like(across), np.zeros_like(across))
        out, up = across - self.shaft, height - self.height
        length = np.maximum(np.hypot(out, up), 1e-300)
        corner = Near(length, out / length, up / length, 1 / length)
        end = (self.shaft - self.blend) / np.sin(self.angle)
        beside = shaft.where(np.where(flank.gap > 0, up > 0, shaft.gap > flank.gap), flank)
        return corner.where((along > end) & (up <= 0) & (flank.gap > 0), beside)


class Near(NamedTuple):
    """Distances (...) in a plane, mm, their gradients across and along the axis, and the curvatures of their level lines, 1/mm."""

    gap: Array
    across: Array
    up: Array
    curvature: Array

    def where(self, here: Bools, other: "Near") -> "Near":
        """These values where `here` is true, elsewhere those of another."""
        return Near(*(np.where(here, mine, others) for mine, others in zip(self, other, strict=True)))


def from_revolved(flank: Flank, x: Array, bottom: float) -> Distance:
    """Distance from the body that an outline sweeps about the axis. Points on the axis below a sharp tip see it flat."""
    rho = np.hypot(x[..., 0], x[..., 2])
    near = flank.near(rho, x[..., 1] - bottom)
    safe = np.where(rho > 0, rho, 1.0)
    radial = np.stack([np.where(rho > 0, x[..., 0] / safe, 1.0), np.zeros_like(rho), x[..., 2] / safe], axis=-1)
    hoop = np.stack([-radial[..., 2], np.zeros_like(rho), radial[..., 0]], axis=-1)
    round_about = np.where(rho > 0, near.across / safe, near.curvature)
    n, bend = _bent(near, radial)
    n = np.where((rho == 0)[..., None], _DOWN, n)
    return Distance(near.gap, n, bend + round_about[..., None, None] * _square(hoop))


def from_drawn_out(flank: Flank, x: Array, bottom: float) -> Distance:
    """Distance from the prism that an outline sweeps along x. Points in the middle below a sharp tip see it flat."""
    near = flank.near(np.abs(x[..., 2]), x[..., 1] - bottom)
    radial = np.where(x[..., 2] < 0, -1.0, 1.0)[..., None] * np.array([0.0, 0.0, 1.0])
    n, bend = _bent(near, radial)
    return Distance(near.gap, np.where((x[..., 2] == 0)[..., None], _DOWN, n), bend)


def _bent(near: Near, radial: Array) -> tuple[Array, Array]:
    """Gradients (..., 3), and the part of the Hessians (..., 3, 3) in the planes of the axis and the unit vectors `radial`."""
    n = near.across[..., None] * radial + near.up[..., None] * UP
    tangent = near.across[..., None] * UP - near.up[..., None] * radial
    return n, near.curvature[..., None, None] * _square(tangent)


def _length_and_direction(away: Array) -> tuple[Array, Array, Bools]:
    """Lengths and directions of vectors (..., 3) from a core, and which of them are zero: inside, where the flat face counts."""
    distance = np.sqrt(np.einsum("...i,...i->...", away, away))
    inside = distance == 0
    return distance, np.where(inside[..., None], _DOWN, away / np.where(inside, 1.0, distance)[..., None]), inside


def _square(v: Array) -> Array:
    """v v of vectors (..., 3)."""
    return v[..., :, None] * v[..., None, :]
