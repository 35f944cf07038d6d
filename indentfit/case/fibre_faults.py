"""What can be wrong with directions of fibres on points: of their places, the law, and the tests on the sample."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from indentfit.arrays import Array
from indentfit.case.fibre_file import TURNED_BLOCK
from indentfit.case.messages import Fault, Key
from indentfit.fibre_map import VAGUE, FibreMap
from indentfit.material import Material
from indentfit.samples import Circle, Outline, outside

INTO = 0.01  # of the thickness: as far outside as a point may lie
GAP = 0.25  # of the smaller size of the sample in its plane: as far as a place of it may be from the nearest point
PLACES = 12  # places along each of two directions in the plane at which a map is judged, at three heights


def places_in(outline: Outline, thickness: float) -> Array:
    """Places (3, n) all over a sample, mm, whose images in the planes of symmetry are among them."""
    along, height = (np.arange(PLACES) + 0.5) / PLACES * 2 - 1, thickness * np.array([0.05, 0.5, 0.95])
    if isinstance(outline, Circle):
        radius, turn = np.meshgrid(outline.radius * np.sqrt(along[along > 0]), np.pi * (along + 1))
        x, z = (radius * np.cos(turn)).ravel(), (radius * np.sin(turn)).ravel()
    else:
        x, z = (part.ravel() for part in np.meshgrid(outline.half_length * along, outline.half_width * along))
    return np.array([np.tile(x, height.size), np.repeat(height, x.size), np.tile(z, height.size)])


def faults_of_map(
    place: Key, fibres: FibreMap, outline: Outline, thickness: float, law: type[Material] | None, fibrous: bool
) -> Iterator[Fault]:
    """Faults of a map of a sample.

    Parameters
    ----------
    place : path of the key
    fibres : FibreMap
    outline : Outline
    thickness : float, mm
    law : class of Material, or None where it cannot be opened
    fibrous : bool
        Whether the law has fibres.
    """
    if law is not None and not fibrous:
        yield Fault(place, fibres.file, "the material has no fibres; remove the key, or choose a law with fibres")
        return
    if law is not None and law.two_families:
        text = "a material with two families of fibres takes no file of directions; give sample.families, or a law with one family"
        yield Fault(place, fibres.file, text)
        return
    points = fibres.points.copy()
    points[:, 1] = np.where(np.isnan(points[:, 1]), 0.5 * thickness, points[:, 1])
    beyond = outside(points, outline, thickness)
    n = int(np.argmax(beyond))
    if beyond[n] > INTO * thickness:
        where, extent = ", ".join(f"{value:.4g}" for value in points[n]), outline.extent
        text = (
            f"{fibres.line(n)}: the point ({where}) mm lies {beyond[n]:.3g} mm outside the sample, {extent[0]:.4g} x "
            f"{thickness:.4g} x {extent[1]:.4g} mm about (0, {thickness / 2:.4g}, 0); check the units of the "
            "positions, and where they are counted from"
        )
        yield Fault(place, fibres.file, text)
        return
    places, least = places_in(outline, thickness), GAP * min(outline.extent)
    far = fibres.distances(places)
    n = int(np.argmax(far))
    if far[n] > least:
        where = ", ".join(f"{value:.3g}" for value in places[:, n])
        text = (
            f"has no point within {far[n]:.3g} mm of ({where}) mm; at most {least:.3g} mm are taken: give points all over the "
            "sample, and check the units of the positions"
        )
        yield Fault(place, fibres.file, text)
        return
    places = np.column_stack([places, fibres.between])
    vague = fibres.vagueness(places)
    n = int(np.argmin(vague))
    if vague[n] < VAGUE:
        where = ", ".join(f"{value:.3g}" for value in places[:, n])
        text = (
            f"its points about ({where}) mm run across each other, so that they have no common direction there; correct or smooth "
            "them, or give more points"
        )
        yield Fault(place, fibres.file, text)


def faults_of_turns(
    place: Key, fibres: FibreMap, outline: Outline, tests: Sequence[tuple[str, Any]], held: bool
) -> Iterator[Fault]:
    """Faults of tests on a sample with a map: a block that would be turned under the indenter, dips, and ends that are held.

    tests : sequence of (label, Test)
    """
    if held:
        yield Fault(place, fibres.file, "a sample with a prestretch takes no file of directions; remove one of the two")
    for label, test in tests:
        if test.dip:
            text = "the file of directions states the dips (dip_deg, or ay); remove the key"
            yield Fault(("test", label, "dip"), test.dip, text)
        if not isinstance(outline, Circle) and test.direction % 180:
            yield Fault(("test", label, "angle"), test.direction, TURNED_BLOCK)
