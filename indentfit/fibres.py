"""Directions of fibres, and the symmetries of a centred indenter on its sample that fibres of a direction keep.

Axes: x is the indenter's long side, y the axis of indentation. A direction and its opposite are the same fibres.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from indentfit.arrays import Array
from indentfit.errors import MeshError
from indentfit.fibre_map import FibreMap

Kept = Literal["quarter", "half", "mirror_x", "mirror_z", "whole"]
"""What of the sample decides on the rest: a quarter (mirror planes x = 0 and z = 0), a half (turned by 180 degrees about y, it is
the other half), the half beside the mirror plane x = 0 or z = 0, or nothing less than the whole."""

SAME_LINE = 1e-12  # how far the cosine of two directions may be from 1
TURNED = 17.3205  # degrees: an angle of no symmetry, for fibres that a fit turns
PART_WORDS: dict[Kept, str] = {
    "quarter": "quarter sample",
    "half": "half sample, tied to itself by a turn of 180 degrees",
    "mirror_x": "half sample beside the mirror plane x = 0",
    "mirror_z": "half sample beside the mirror plane z = 0",
    "whole": "whole sample",
}


def direction(angle: float, dip: float = 0.0) -> Array:
    """Unit vector (3,) along fibres, exact where it is an axis.

    Parameters
    ----------
    angle : float, degrees
        Angle from x in the plane of the sample, towards z.
    dip : float, degrees
        Angle out of that plane, towards y.
    """
    return np.array([_cos(dip) * _cos(angle), _cos(dip - 90), _cos(dip) * _cos(angle - 90)])


Families = tuple[tuple[float, float], tuple[float, float]]
"""Two families of fibres: angle of each from a common direction in the plane of the sample, and its dip, degrees."""


Fibre = Array | FibreMap
"""Directions of fibres in a sample: (3,) of one family, (2, 3) of two, or a map of them."""


def fibre_of(angle: float, dip: float = 0.0, families: Families | FibreMap | None = None) -> Fibre:
    """The directions of the fibres in a test: those of a map, turned by the angle, or as `directions` has them."""
    return families.turned(angle) if isinstance(families, FibreMap) else directions(angle, dip, families)


def directions(angle: float, dip: float = 0.0, families: Families | None = None) -> Array:
    """Unit vectors along fibres: (3,) of one family as `direction` has it, or (2, 3) of two.

    Parameters
    ----------
    angle, dip : float, degrees
        Of one family; of two, the angle is that of their common direction, and the dip is not used.
    families : Families or None
    """
    return direction(angle, dip) if families is None else np.stack([direction(angle + own, dips) for own, dips in families])


def kept_by_two(fibres: Array, alike: bool) -> Kept:
    """The symmetry that two families of fibres keep.

    Parameters
    ----------
    fibres : array (2, 3)
        Their directions.
    alike : bool
        Whether the two may change places, because they are of the same kind.
    """
    a, b = fibres
    turn, mirror_x, mirror_z = (
        (_same(a * signs, a) and _same(b * signs, b)) or (alike and _same(a * signs, b))
        for signs in (np.array([-1, 1, -1]), np.array([-1, 1, 1]), np.array([1, 1, -1]))
    )
    if mirror_x and mirror_z:
        return "quarter"
    if turn:
        return "half"
    return "mirror_x" if mirror_x else "mirror_z" if mirror_z else "whole"


def kept_by_map(fibres: FibreMap) -> Kept:
    """The symmetry that directions on points keep, at the points and their images."""
    places = fibres.own_places
    turn, mirror_x, mirror_z = (fibres.keeps(image, places) for image in ("turn", "x", "z"))
    if mirror_x and mirror_z:
        return "quarter"
    if turn:
        return "half"
    return "mirror_x" if mirror_x else "mirror_z" if mirror_z else "whole"


def _same(a: Array, b: Array) -> bool:
    """Whether two unit vectors are along the same line."""
    return bool(abs(abs(float(a @ b)) - 1) < SAME_LINE)


def kept(angle: float, dip: float = 0.0) -> Kept:
    """The symmetry that fibres at an angle and a dip, in degrees, keep."""
    along_x, along_y, along_z = (bool(component) for component in direction(angle, dip))
    crossing_x, crossing_z = along_x and (along_y or along_z), along_z and (along_x or along_y)  # mirror planes that are broken
    if not crossing_x and not crossing_z:
        return "quarter"
    if not along_y:
        return "half"
    if crossing_x and crossing_z:
        return "whole"
    return "mirror_z" if crossing_x else "mirror_x"


@dataclass(frozen=True)
class Direction:
    """The direction of the fibres in a test.

    Parameters
    ----------
    angle, dip : float, degrees
    turns : bool
        Whether a fit turns them about y, so that no symmetry may be used that only the angle keeps.
    families : Families, FibreMap or None
        Two families of fibres about the direction `angle`, or directions on points of the sample that is turned by `angle`.
    alike : bool
        Whether the two are of the same kind.
    """

    angle: float
    dip: float = 0.0
    turns: bool = False
    families: Families | FibreMap | None = None
    alike: bool = False

    @property
    def kept(self) -> Kept:
        """The symmetry that the fibres keep."""
        if isinstance(self.families, FibreMap):
            return kept_by_map(self.families.turned(self.angle + (TURNED if self.turns else 0.0)))
        if self.families is not None:
            return kept_by_two(directions(self.angle + (TURNED if self.turns else 0.0), 0.0, self.families), self.alike)
        return kept(45.0 if self.turns else self.angle, self.dip)

    def turned(self, angle: float) -> "Direction":
        """The direction turned about y by an angle, degrees."""
        return replace(self, angle=(self.angle + angle) % 180) if angle else self

    def on(self, fibres: FibreMap, angle: float) -> "Direction":
        """The direction with a map in its place, on a sample that is turned by a further angle, degrees."""
        return replace(self, angle=self.angle + angle, families=fibres)


def part_for(directions: Iterable[Kept], asked: str = "auto") -> Kept:
    """The part of the sample to be solved.

    Parameters
    ----------
    directions : symmetries that the directions of the fibres keep, one by one
    asked : str
        mesh.symmetry of a case: "quarter", "half" or "whole"; with others it is the least that the directions keep together.
        A half is the one that they keep.

    Raises
    ------
    MeshError
        The fibres break the symmetry of the part that is asked for.
    """
    broken = set(directions) - {"quarter"}
    least: Kept = "whole" if len(broken) > 1 else broken.pop() if broken else "quarter"
    if asked == "whole":
        return "whole"
    if asked in ("quarter", "half") and least == "whole":
        text = "fibres that dip at an angle to the indenter's long side, or differ in two such families, leave no symmetry"
        raise MeshError(f'mesh.symmetry = "{asked}": {text}; leave the key out, or write "whole"')
    if asked == "quarter" and least != "quarter":
        text = "fibres neither along nor across the indenter's long side break the symmetry of a quarter"
        raise MeshError(f'mesh.symmetry = "quarter": {text}; leave the key out, or write "half"')
    return "half" if asked == "half" and least == "quarter" else least


def words(angle: float, dip: float = 0.0, families: Families | FibreMap | None = None) -> str:
    """A direction for people, such as "30°" or "30°, dipping 45°"; of two families "0°, families at 41° and -41°"."""
    if isinstance(families, FibreMap):
        return f"{angle:g}°, {families.words}"
    if families is not None:
        return f"{angle:g}°, families at {' and '.join(words(*family) for family in families)} from there"
    return f"{angle:g}°" + (f", dipping {dip:g}°" if dip else "")


def _cos(degrees: float) -> float:
    """Cosine that is exact at multiples of 90 degrees."""
    turn = degrees % 360
    return {0.0: 1.0, 90.0: 0.0, 180.0: -1.0, 270.0: 0.0}.get(turn, math.cos(math.radians(turn)))
