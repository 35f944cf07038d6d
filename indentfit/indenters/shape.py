"""What a shape of a rigid indenter is: a class that alone knows its keys, its face, what meshes need of it, and its words.

A third party's shape registers with `SHAPES.register` or in the entry-point group `indentfit.indenters`. It may use the keys of the
case's table [indenter]; another key would have to be a field of that table first.

Axes: y is the axis of indentation; the indenter is centred on the axis x = z = 0, above the sample. All lengths in mm.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar, Literal, NamedTuple, Protocol

import numpy as np

from indentfit.arrays import Array, Bools
from indentfit.shapes import Registry

UP = np.array([0.0, 1.0, 0.0])


End = Literal["flat", "sphere", "cone"]


class Distance(NamedTuple):
    """Signed distance of points from an indenter's face, with its derivatives.

    Attributes
    ----------
    gap : array (...), mm
        The distance, positive outside of the indenter.
    normal : array (..., 3)
        Gradient of the distance: unit vectors.
    bend : array (..., 3, 3), 1/mm, or None
        Hessian of the distance; None where the face is flat.
    """

    gap: Array
    normal: Array
    bend: Array | None


@dataclass(frozen=True)
class Band:
    """A rectangular contact; lengths in mm.

    Mesh lines follow the long sides z = half_width, and the ends x = half_length where these lie on the sample. A contact that
    reaches beyond the sample along x overhangs the sample, whose side may then roll up against the indenter (see fem/contact.py).
    """

    half_length: float
    half_width: float

    @property
    def circles(self) -> tuple[float, ...]:
        """Radii of arcs that mesh lines follow: none."""
        return ()


@dataclass(frozen=True)
class Rings:
    """A round contact: mesh lines follow the circle of this radius, mm."""

    radius: float

    @property
    def half_width(self) -> float:
        """The radius, mm."""
        return self.radius

    @property
    def circles(self) -> tuple[float, ...]:
        """Radii of arcs that mesh lines, and the edges of quadratic bricks, follow, mm."""
        return (self.radius,)


class IndenterShape(Protocol):
    """The shape of an indenter: all that the case, meshes, contact, studies and reports ask of an indenter.

    A shape is a frozen dataclass (see `shapes.Registry` for what its fields are), so that it can be compared and hashed. It must
    be symmetric about the planes x = 0 and z = 0, because a quarter of the sample is computed.
    """

    name: ClassVar[str]
    """Value of indenter.shape in a case, and the word of reports."""

    end: ClassVar[End]
    """How the force begins to grow with the depth, for the contact point of a record: as under a flat face, a sphere or a cone."""

    @property
    def half_width(self) -> float:
        """Half of the indenter's shorter side, or its radius, mm."""
        ...

    @property
    def edge_radius(self) -> float | None:
        """Radius of the edge of a flat face, mm; 0 for a sharp edge; None where the face has no edge.

        The contact with a sharp edge is confined to the material face of the footprint, and `distance` is that of the flat face.
        """
        ...

    @property
    def curvature(self) -> float:
        """Largest curvature of the face that material may roll off, 1/mm; 0 for a flat face with a sharp edge."""
        ...

    def faults(self) -> Iterator[tuple[str, str]]:
        """(key, what is wrong and what to do) of keys that do not agree with each other."""
        ...

    def faults_on(self, extent: tuple[float, float], depth: float) -> Iterator[tuple[str, str]]:
        """(key, what is wrong and what to do) where the indenter does not fit on a sample.

        Parameters
        ----------
        extent : (x, z), mm
            Size of the sample along x and z.
        depth : float, mm
            Largest depth of the tests; 0 where it is not known.
        """
        ...

    def partition(self, depth: float) -> Band | Rings:
        """The region of contact at a depth in mm, to whose edge meshes are refined. Meshes know rectangles and circles."""
        ...

    def may_touch(self, x: Array, z: Array) -> Bools:
        """Which points of the top, at x and z (n,) in mm, may come into contact.

        A sharp edge confines the contact to the footprint's material face. A rounded edge, and a shape whose contact grows, can
        also be met by material from beside the footprint.
        """
        ...

    def distance(self, x: Array, bottom: float) -> Distance:
        """Signed distance of points from the indenter.

        Parameters
        ----------
        x : array (..., 3), mm
            Points around the indenter or slightly inside of it.
        bottom : float, mm
            Height y of the indenter's lowest point.
        """
        ...

    def motion_off_edge(self, x: Array, u: Array) -> Array:
        """Motion away from the indenter, mm, of those points that lie on its sharp edge; called only where there is a sharp edge.

        Parameters
        ----------
        x, u : arrays (3, n), mm
            Points of the undeformed top, and their displacements.
        """
        ...

    def words(self) -> str:
        """The shape, its sizes and its edge, such as "sphere, diameter 5 mm"."""
        ...

    def variants(self, extent: tuple[float, float]) -> Iterator[tuple[str, float]]:
        """(key, value) of other sizes to try on a sample of an extent (x, z), one change at a time; all in mm."""
        ...


SHAPES: Registry[IndenterShape] = Registry("indenter", "indentfit.indenters")


def has_sharp_edge(shape: IndenterShape) -> bool:
    """Whether the contact ends at a sharp edge."""
    return shape.edge_radius == 0
