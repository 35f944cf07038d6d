"""Meshes of the meridian plane of half a disc below a plate: a fan of quadrilaterals about the plate's rim, in a graded rest.

The stress is singular at the rim of a bonded plate, and the side below it turns up until it lies against the plate. Two elements
meet in the rim, so that each of them opens from 45 to 90 degrees where one alone would become flat.
"""

import functools

import numpy as np
from skfem import MeshQuad

from indentfit.arrays import Array
from indentfit.fem.bricks import merge

BLOCK, CORE = 0.4, 0.1  # size of the fan, and of its two innermost elements, of the radius or half of the height, the less
SECTORS = 4  # elements round the rim, outside the innermost two
RING = 1.2  # a ring is wider than the last one by RING times the angle of a sector
SLOPE, FAR = 0.5, 0.4  # growth of the widths outside the fan, and the largest of them, in the same unit
SAME = 1e-9


@functools.lru_cache(maxsize=8)
def disc_mesh(radius: float, height: float, finer: int = 1) -> MeshQuad:
    """Mesh of the meridian plane of a disc below the plate at its top.

    Parameters
    ----------
    radius, height : float, mm
        The height is that of the half above the plane of symmetry.
    finer : int
        Divides the widths of the elements.

    Returns
    -------
    MeshQuad
        Points (r, y), mm, with the boundaries top, base (the plane of symmetry), axis and side.
    """
    size, rim = min(radius, height), np.array([radius, height])
    sectors, block = SECTORS * finer, BLOCK * size
    rings = _rings(rim, CORE / finer * size, block, sectors)
    inner, outer = rings[:, :, 0], rings[:, :, -1]
    core = [_kite(rim, inner[:, n : n + 3]) for n in range(0, sectors, 2)]
    heights, radii = outer[1, : sectors // 2 + 1][::-1], outer[0, sectors // 2 :]
    width, far = 2 * block / sectors, FAR / finer * size
    left = radii[0] - _grown(width, radii[0], far)[::-1]
    below = heights[0] - _grown(width, heights[0], far)[::-1]
    left[0], below[0] = 0.0, 0.0
    rest = [np.array(np.meshgrid(r, y, indexing="ij")) for r, y in ((left, heights), (left, below), (radii, below))]
    return merge([rings, *core, *rest], SAME).with_boundaries(
        {
            "top": lambda x: x[1] > height * (1 - 1e-9),
            "base": lambda x: x[1] < 1e-9 * height,
            "axis": lambda x: x[0] < 1e-9 * radius,
            "side": lambda x: x[0] > radius * (1 - 1e-9),
        }
    )


def _rings(rim: Array, core: float, block: float, sectors: int) -> Array:
    """Points (2, sectors + 1, n) of rings about the rim, from the plate to the side: circles that become a square."""
    angles = np.linspace(0, np.pi / 2, sectors + 1)
    arc = -np.array([np.cos(angles), np.sin(angles)])
    arc[0, -1] = arc[1, 0] = 0.0
    square = arc / np.abs(arc).max(axis=0)
    number = max(1, round(np.log(block / core) / np.log(1 + RING * angles[1])))
    shares = np.clip(2 * np.linspace(0, 1, number + 1) - 1, 0, 1)
    sizes = np.geomspace(core, block, number + 1)
    rings = [rim[:, None] + size * ((1 - share) * arc + share * square) for size, share in zip(sizes, shares, strict=True)]
    return np.stack(rings, axis=2)


def _kite(rim: Array, ends: Array) -> Array:
    """Patch (2, 2, 2) of one element between the rim and three points (2, 3) round it."""
    return np.stack([np.stack([rim, ends[:, 0]], axis=1), np.stack([ends[:, 2], ends[:, 1]], axis=1)], axis=2)


def _grown(width: float, end: float, far: float) -> Array:
    """Distances from 0 to an end, whose spacing grows from a width to the width far away."""
    places = [0.0]
    while places[-1] < end * (1 - 1e-9):
        places.append(places[-1] + min(width + SLOPE * places[-1], far))
    return np.array(places) / places[-1] * end
