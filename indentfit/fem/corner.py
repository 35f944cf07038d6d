"""The mesh of a meridian plane round the sharp edge of a flat punch: rings of quadrilaterals about the corner, in a graded rest.

Stress and strain grow at the corner as one over the root of the distance, and under a deep punch the sample winds round the corner.
Rings about it turn as a whole: their elements keep their shape where those of a rectangular mesh fold up. The innermost
quadrilaterals are square, each ring outside them wider than the last by a factor, up to the block in which the rings lie.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from indentfit.arrays import Array

BLOCK = 0.3  # half-width of the block of rings, of the least of punch radius, thickness and the sample's rest beside the punch
LEAST_RING = 1.5  # the block's half-width is at least so many times that of the squares at the corner

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
    """

    radius: float
    reach: float
    thickness: float
    top: float
    width: float
    divisions: int
    growth: float

    @property
    def block(self) -> float:
        """Half-width of the block of rings, mm."""
        return BLOCK * min(self.radius, self.top, self.reach - self.radius)

    @property
    def core(self) -> float:
        """Half-width of the squares at the corner, mm."""
        return min(self.divisions * self.width, self.block / LEAST_RING)

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
        return [*rest, self._rings(), _tensor(*self._around(self.core))]

    def _around(self, half_width: float) -> tuple[Array, Array]:
        """Radii and heights of the points on the sides of a ring's outline."""
        n = self.divisions
        radii = self.radius + np.linspace(-half_width, half_width, 2 * n + 1)
        return radii, self.thickness - np.linspace(half_width, 0.0, n + 1)

    def _rings(self) -> Array:
        number = max(1, round(np.log(self.block / self.core) / np.log(1 + self.growth)))
        widths = np.geomspace(self.core, self.block, number + 1)
        widths[0], widths[-1] = self.core, self.block
        return np.stack([_outline(*self._around(width)) for width in widths], axis=2)


def _tensor(radii: Array, heights: Array) -> Array:
    return np.array(np.meshgrid(radii, heights, indexing="ij"))


def _outline(radii: Array, heights: Array) -> Array:
    """The points (2, m) along the left side from the top, the lower side, and the right side to the top."""
    left, right = np.full(heights.size, radii[0]), np.full(heights.size, radii[-1])
    low = np.full(radii.size, heights[0])
    r = np.concatenate([left, radii[1:-1], right])
    y = np.concatenate([heights[::-1], low[1:-1], heights])
    return np.array([r, y])
