"""An indenter as pictures show it: its faces in the planes of symmetry, and its top, of a quarter and of its mirror images."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from indentfit.arrays import Array
from indentfit.indenters.shape import IndenterShape, Rings

POINTS = 40  # of a profile
HALVINGS = 40
ABOVE = 0.15  # of the sample's thickness, above its top: what is shown of the indenter
OVERHANG = 1.06  # of the sample's extent: what is shown of an indenter that is longer


@dataclass(frozen=True, eq=False)
class Outline:
    """Polygons (n, 3) of an indenter, mm."""

    faces: tuple[Array, ...]


def outline(shape: IndenterShape, depth: float, nodes: Array, sides: Iterable[int] = ()) -> Outline:
    """The Outline of an indenter whose lowest point is `depth` (mm) below the top of the undeformed sample of nodes (n, 3): of its
    quarter x, z >= 0, and of the mirror images along the axes `sides` (0 is x, 2 is z)."""
    top, extent = float(nodes[:, 1].max()), np.abs(nodes).max(axis=0)
    bottom, upper = top - depth, top + ABOVE * float(np.ptp(nodes[:, 1]))
    region = shape.partition(max(depth, 1e-9))
    round_shape = isinstance(region, Rings)
    wide = shape.half_width
    long = wide if isinstance(region, Rings) else min(region.half_length, OVERHANG * float(extent[0]))
    across, along = (_cut(shape, axis, reach, (bottom, upper)) for axis, reach in ((2, wide), (0, long)))
    if round_shape:
        reach = float(across[:, 2].max())
        angles = np.linspace(0, np.pi / 2, POINTS)
        rim = np.column_stack([reach * np.cos(angles), np.full(POINTS, upper), reach * np.sin(angles)])
        cap = np.vstack([[0.0, upper, 0.0], rim])
    else:
        x, z = float(along[:, 0].max()), float(across[:, 2].max())
        cap = np.array([[0, upper, 0], [x, upper, 0], [x, upper, z], [0, upper, z]], dtype=float)
    faces = [cap, across, along]
    for axis in sides:
        faces += [face * np.where(np.arange(3) == axis, -1.0, 1.0) for face in faces]
    return Outline(tuple(faces))


def _cut(shape: IndenterShape, axis: int, reach: float, heights: tuple[float, float]) -> Array:
    """The face (n, 3) of the indenter in a plane of symmetry, along x (axis 0) or z (axis 2), between two heights."""
    bottom, upper = heights
    places = reach * np.linspace(0, 1, POINTS) ** 0.5 if reach else np.zeros(1)
    low, high = np.full(places.size, bottom - 1e-9), np.full(places.size, upper)
    points = np.zeros((places.size, 3))
    points[:, axis] = places
    for _ in range(HALVINGS):
        points[:, 1] = (low + high) / 2
        outside = shape.distance(points, bottom).gap > 0
        low, high = np.where(outside, points[:, 1], low), np.where(outside, high, points[:, 1])
    inside = high < upper - 1e-6 * (upper - bottom)
    profile = points[inside]
    profile[:, 1] = high[inside]
    ends = profile[[-1, 0]].copy()
    ends[:, 1] = upper
    ends[1, axis] = 0.0
    return np.vstack([profile, ends])
