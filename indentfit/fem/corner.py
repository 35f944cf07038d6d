"""The mesh of a meridian plane round the sharp edge of a flat punch: rings of quadrilaterals about the corner, in a graded rest.

Stress and strain grow at the corner as one over the root of the distance, and under a deep punch the sample winds round the corner.
Rings about it turn as a whole: their elements keep their shape where those of a rectangular mesh fold up. Each ring is wider than
the last by a factor, up to the block in which the rings lie.

Where the sample slips under the edge, the innermost quadrilaterals are squares. Where it sticks, the half-circle below the face
opens to three quarters of a circle beside the wall, and squares at the corner, two of which meet there, were drawn out into
needles, which buckled from one step to the next. There the innermost quadrilaterals are kites between rays from the corner, each of
which turns by a small angle only, and the rings change from half-circles to the outline of the block. A kite eight times as wide as
a square gives the same force.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from indentfit.arrays import Array

BLOCK = 0.3  # half-width of the block of rings, of the least of punch radius, thickness and the sample's rest beside the punch
LEAST_RING = 1.5  # the block's half-width is at least so many times that of the squares, or the length of the kites, at the corner
POINTED = 1.12  # length of a kite's diagonal from the corner, over that of its sides: longer ones buckle sooner

Sideways = Callable[[float, float, float], Array]
Down = Callable[[float, float], Array]


@dataclass(frozen=True)
class Corner:
    """The corner of a punch's edge on a meridian plane.

    Parameters
    ----------
    radius : float, mm
        Of the punch.
    reach, thickness : floats, mm
        Radius and thickness of the sample.
    top : float, mm
        Thickness of the layer that the punch touches, in which the block lies.
    width : float, mm
        Wanted width of the elements at the corner.
    divisions : int
        Elements along half of a ring's side: a ring has four times as many.
    growth : float
        A ring is wider than the last one by the factor 1 + growth.
    sticks : bool
        Whether the sample sticks under the edge.
    """

    radius: float
    reach: float
    thickness: float
    top: float
    width: float
    divisions: int
    growth: float
    sticks: bool = False

    @property
    def block(self) -> float:
        """Half-width of the block of rings, mm."""
        return BLOCK * min(self.radius, self.top, self.reach - self.radius)

    @property
    def core(self) -> float:
        """Half-width of the squares at the corner, or length of the kites' sides, mm."""
        return min(self.width if self.sticks else self.divisions * self.width, self.block / LEAST_RING)

    def patches(self, sideways: Sideways, down: Down) -> list[Array]:
        """Patches that fill the meridian plane, each an array (2, m, n) of points (r, y), mm.

        Parameters
        ----------
        sideways, down : functions
            Radii from the second argument to the third, and distances below the block from 0 to the second argument, mm, graded
            from the width at the block that is the first argument.
        """
        n, block = self.divisions, self.block
        width = block / n
        inner, outer = sideways(width, 0.0, self.radius - block), sideways(width, self.radius + block, self.reach)
        below = self.thickness - block - down(width, self.thickness - block)[::-1]
        inner[0], outer[-1], below[0] = 0.0, self.reach, 0.0
        middle, upper = self._around(block)
        inner[-1], outer[0], below[-1] = middle[0], middle[-1], upper[0]  # the same floats, so that the patches merge
        heights = np.concatenate([below, upper[1:]])
        rest = [_tensor(inner, heights), _tensor(outer, heights), _tensor(middle, below)]
        if not self.sticks:
            return [*rest, self._rings(), _tensor(*self._around(self.core))]
        rings = self._round_rings()
        return [*rest, rings, *self._kites(rings[:, :, 0])]

    def _around(self, half_width: float) -> tuple[Array, Array]:
        """Radii and heights of the points on the sides of a ring's outline."""
        n = self.divisions
        radii = self.radius + np.linspace(-half_width, half_width, 2 * n + 1)
        return radii, self.thickness - np.linspace(half_width, 0.0, n + 1)

    def _widths(self) -> Array:
        """Half-widths of the rings' outlines, mm, from the inside."""
        number = max(1, round(np.log(self.block / self.core) / np.log(1 + self.growth)))
        widths = np.geomspace(self.core, self.block, number + 1)
        widths[0], widths[-1] = self.core, self.block
        return widths

    def _rings(self) -> Array:
        return np.stack([_outline(*self._around(width)) for width in self._widths()], axis=2)

    def _round_rings(self) -> Array:
        """Rings from the kites to the block: the innermost outline alternates between the kites' sides and their points."""
        corner, last = np.array([[self.radius], [self.thickness]]), _outline(*self._around(self.block))
        angles = np.linspace(0, np.pi, last.shape[1])
        circle, shares = -np.array([np.cos(angles), np.sin(angles)]), np.linspace(0, 1, self._widths().size)
        circle[1, [0, -1]] = 0.0
        pointed = np.where(np.arange(angles.size) % 2, POINTED, 1.0)
        square = (last - corner) / self.block
        outlines = [corner + w * ((1 - s) * circle + s * square) for w, s in zip(self._widths(), shares, strict=True)]
        return np.stack([corner + self.core * circle * pointed, *outlines[1:-1], last], axis=2)

    def _kites(self, outline: Array) -> list[Array]:
        """The quadrilaterals (2, 2, 2) between the corner and the innermost outline (2, n)."""
        corner = np.array([self.radius, self.thickness])
        sides = zip(outline.T[:-2:2], outline.T[1::2], outline.T[2::2], strict=True)
        return [np.moveaxis(np.array([[corner, start], [end, point]]), 2, 0) for start, point, end in sides]


def _tensor(radii: Array, heights: Array) -> Array:
    return np.array(np.meshgrid(radii, heights, indexing="ij"))


def _outline(radii: Array, heights: Array) -> Array:
    """The points (2, m) along the left side from the top, the lower side, and the right side to the top."""
    left, right = np.full(heights.size, radii[0]), np.full(heights.size, radii[-1])
    low = np.full(radii.size, heights[0])
    r = np.concatenate([left, radii[1:-1], right])
    y = np.concatenate([heights[::-1], low[1:-1], heights])
    return np.array([r, y])
