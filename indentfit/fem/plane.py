"""The quarter of the (x, z) plane as patches of quadrilaterals, with mesh lines on the edge of the contact and on the outline."""

import numpy as np

from indentfit.arrays import Array
from indentfit.digits import sizes
from indentfit.errors import MeshError
from indentfit.fem.grading import Grading, across, along, graded
from indentfit.indenters import Band, Rings
from indentfit.samples import Circle, Outline, Rectangle


def patches(outline: Outline, contact: Band | Rings, grading: Grading) -> list[Array]:
    """Patches that fill a quarter of an outline, each an array (2, m, n) of points (x, z), mm.

    Raises
    ------
    MeshError
        The contact leaves no room on the sample.
    """
    if isinstance(contact, Rings):
        return _rings(outline, contact.radius, grading)
    if isinstance(outline, Circle):
        return _band_on_circle(outline.radius, contact, grading)
    return [_band_on_rectangle(outline, contact, grading)]


def _band_on_rectangle(outline: Rectangle, band: Band, grading: Grading) -> Array:
    inner, outer = across(band.half_width, outline.half_width, grading)
    x = along(band.half_length, outline.half_length, grading)
    return np.array(np.meshgrid(x, np.concatenate([inner, outer[1:]]), indexing="ij"))


def _band_on_circle(radius: float, contact: Band, grading: Grading) -> list[Array]:
    """The band of the contact, and the cap beside it as three patches that meet in one inner point.

    Every corner of the cap is nearly a right angle, so no element degenerates where the contact's edge leaves the disc.
    """
    half = contact.half_width
    chord = np.sqrt(radius**2 - half**2)
    if half > 0.9 * radius:
        raise MeshError(f"the indenter is {sizes(2 * half)} wide: too wide to mesh on a disc of diameter {sizes(2 * radius)}")
    x = along(contact.half_length, chord, grading)
    inner, outer = across(half, half + 0.55 * (radius - half), grading)
    split = int(np.clip(np.argmin(np.abs(x - 0.5 * chord)), 1, x.size - 2))
    return [
        _band(radius, x, inner, max(x[split], min(contact.half_length, x[-2]))),  # a line on the strip's end stays straight
        *_cap(radius, x, outer, split),
    ]


def _band(radius: float, x: Array, z: Array, straight: float) -> Array:
    """The patch below the strip, whose lines reach the rim; they are stretched where x is beyond `straight`."""
    patch = np.array(np.meshgrid(x, z, indexing="ij"))
    rim = np.sqrt(radius**2 - z**2)
    stretch = np.clip((x - straight) / (x[-1] - straight), 0, 1)[:, None]
    patch[0] += stretch**2 * (rim - x[-1])[None, :]
    return patch


def _cap(radius: float, x: Array, z: Array, split: int) -> list[Array]:
    """The three patches beside the strip: its edge has the points x, which change the patch at x[split]; z: points beside it."""
    chord, half = x[-1], z[0]
    low, high = np.arcsin(half / radius), np.pi / 2
    shares = (z - half) / (z[-1] - half)
    middle = low + 0.5 * (high - low)
    rise = _arc(radius, low + shares * (middle - low))
    centre = np.array([0.8 * x[split], half + 0.4 * (radius - half)])
    bottom = np.array([x, np.full_like(x, half)])
    left = np.array([np.zeros_like(z), z])
    spoke = _line(bottom[:, split], centre, shares)
    level = _line(left[:, -1], centre, x[: split + 1] / x[split])
    outwards = _line(centre, rise[:, -1], (x[split:] - x[split]) / (chord - x[split]))
    crown = _arc(radius, np.linspace(high, middle, split + 1))
    up = _line(left[:, -1], np.array([0.0, radius]), np.linspace(0, 1, x.size - split))
    return [
        transfinite(bottom[:, : split + 1], level, left, spoke),
        transfinite(bottom[:, split:], outwards, spoke, rise),
        transfinite(level, crown, up, outwards),
    ]


def _rings(outline: Outline, a: float, grading: Grading) -> list[Array]:
    """Three patches inside the circle of radius a, two rings of quadrilaterals from there to the sample's side."""
    if a > 0.95 * outline.inscribed:
        raise MeshError(
            f"the indenter's contact radius {sizes(a)} leaves no room on the sample (half-width {sizes(outline.inscribed)})"
        )
    radii = graded(0, a, grading, at=a, least=3)[::-1]
    core = 0.4 * a
    rings = radii[radii > core * 1.05][::-1]
    around = max(4, int(np.ceil(a * np.pi / 4 / grading.size)), int(np.ceil(4 * np.sqrt(a / grading.size))))
    s = np.linspace(0, 1, around + 1)
    corner = 0.75 * core * np.ones(2)
    diagonal = np.clip(outline.diagonal, np.pi / 8, 3 * np.pi / 8)
    bottom, left = _line(np.zeros(2), np.array([core, 0]), s), _line(np.zeros(2), np.array([0, core]), s)
    right, top = _line(np.array([core, 0]), corner, s), _line(np.array([0, core]), corner, s)
    filled = [transfinite(bottom, top, left, right)]
    reach = graded(a, outline.reach, grading, at=a, least=2)
    for side, axis, first in ((right, "x", 0.0), (top, "z", np.pi / 2)):
        angles = np.linspace(first, diagonal, around + 1)
        shares = np.concatenate([[0], (rings - core) / (a - core)])
        circle = _arc(a, angles)
        inner = side[:, :, None] + (circle - side)[:, :, None] * shares
        wall = outline.facing(axis, angles)
        share = (reach - a) / (reach[-1] - a)
        outer_ring = circle[:, :, None] + (wall - circle)[:, :, None] * share
        filled += [inner, outer_ring]
    return filled


def _arc(radius: float, angles: Array) -> Array:
    return radius * np.array([np.cos(angles), np.sin(angles)])


def _line(start: Array, stop: Array, shares: Array) -> Array:
    return start[:, None] + (stop - start)[:, None] * shares


def transfinite(bottom: Array, top: Array, left: Array, right: Array) -> Array:
    """Grid (2, m, n) that fills four sides: bottom, top (2, m) and left, right (2, n) (Gordon and Hall 1973)."""
    u0, u1, v0, v1 = (_share(side) for side in (bottom, top, left, right))
    du, dv = (u1 - u0)[:, None], (v1 - v0)[None, :]
    u = (u0[:, None] + v0[None, :] * du) / (1 - du * dv)
    v = v0[None, :] + u * dv
    sides = (1 - v) * bottom[:, :, None] + v * top[:, :, None] + (1 - u) * left[:, None, :] + u * right[:, None, :]
    a, b, c, d = (p[:, None, None] for p in (bottom[:, 0], bottom[:, -1], top[:, 0], top[:, -1]))
    return sides - ((1 - u) * (1 - v) * a + u * (1 - v) * b + (1 - u) * v * c + u * v * d)


def _share(side: Array) -> Array:
    """Share of a side's length at each of its points."""
    length = np.concatenate([[0], np.cumsum(np.hypot(*np.diff(side)))])
    return length / length[-1]
