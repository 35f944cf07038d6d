"""Which points of two faces lie on each other: the places on an upper face that are nearest to points of a lower one.

Both faces are made of facets with the same nodes at rest, and slide on each other. The points belong to the lower facets: with
points of the upper ones forces were up to 0.7 % off, and paths took two to four times as long. Tangents are those by the
coordinates of the lower facet, at rest in the plane, so that those of facets of different sizes and directions can be compared.
"""

from dataclasses import dataclass

import numpy as np

from indentfit.arrays import Array, Bools, Ints

# Facets that slide over others are held between their Gauss points as well, at as many points in a row as they have nodes, by this
# share of the stiffness. Some shapes of a facet vanish at its Gauss points: under pressures that are
# large beside the shear modulus faces folded into each other there.
BETWEEN = 0.02
BESIDE = 0.25  # of a facet's width: how far beyond its ends a point may lie on it, at a rim or a plane of symmetry
NEAR = 0.3  # of a facet's extent: points within so much of the box around it are looked at
ROUNDS = 8  # of the search for the nearest place on a facet
SECOND = 10.0  # a place beyond the end of a facet counts as so many times farther away


@dataclass(frozen=True, eq=False)
class Facing:
    """For each point the number (n_p,) of the upper facet on which it lies, the place (n_p, dim) there, 0 to 1 along each
    coordinate, and whether it lies on one: a rim that has slid beyond the other lies on nothing."""

    facet: Ints
    place: Array
    covered: Bools


@dataclass(frozen=True, eq=False)
class Faces:
    """The two faces of interfaces.

    Attributes
    ----------
    rest : array (n_v, 3), mm
        Places of all nodes of the body at rest.
    lower, upper : arrays (n_f, n_k)
        Nodes of facets that lie on each other at rest, in the same order.
    reached : array (n_f, n_f) of bool
        Upper facets on which points of each lower facet may come to lie.
    dim : int
        Number of a facet's coordinates.
    own : array (n_p,)
        The number of each point's lower facet.
    at_rest : Facing
    shapes : array (1 + dim, n_p, n_k)
        Shape functions of the lower facets at the points, and their derivatives.
    shares : array (n_p,)
        Each point's share of its facet, in units of the facet's coordinates.
    """

    rest: Array
    lower: Ints
    upper: Ints
    reached: Bools
    dim: int
    own: Ints
    at_rest: Facing
    shapes: Array
    shares: Array

    @classmethod
    def of(
        cls, points: Array, lower: Ints, upper: Ints, interface: Ints, reach: float | None = None, between: bool = False
    ) -> "Faces":
        """The faces at points (n_v, dim + 1) at rest. Points of one interface may slide as far as `reach`, mm; without it each
        remains on the facet that it lies on at rest. They are Gauss points of the lower facets, or those by which facets are held
        weakly between these."""
        rest, (n_f, n_k), dim = np.zeros((len(points), 3)), lower.shape, points.shape[1] - 1
        rest[:, : points.shape[1]] = points
        n = round(n_k ** (1 / dim))
        places, shares = _gauss(n - 1, dim)  # more points in a row would lock the faces
        if between:
            places, shares = _gauss(n, dim)
            shares = BETWEEN * shares
        reached = np.eye(n_f, dtype=bool)
        if reach is not None:
            low, high = (end(rest[upper], axis=1) for end in (np.min, np.max))
            away = np.linalg.norm(np.maximum(np.maximum(low[:, None] - high, low - high[:, None]), 0.0), axis=2)
            reached = (away <= reach) & (interface[:, None] == interface)
        own, shapes = np.repeat(np.arange(n_f), len(places)), np.tile(shapes_at(n_k, places), (1, n_f, 1))
        at_rest = Facing(own, np.tile(places, (n_f, 1)), np.ones(own.size, dtype=bool))
        return cls(rest, lower, upper, reached, dim, own, at_rest, shapes, np.tile(shares, n_f))

    @property
    def radius(self) -> Array:
        """The first coordinate (n_p,) of the points at rest, mm."""
        return np.asarray(np.einsum("pn,pn->p", self.shapes[0], self.rest[self.lower[self.own], 0]))

    @property
    def coupled(self) -> Ints:
        """Nodes (m, 2 n_k) of the pairs of facets that may lie on each other, lower ones first."""
        below, above = np.nonzero(self.reached)
        return np.hstack([self.lower[below], self.upper[above]])

    def places(self, moved: Array) -> Array:
        """Places (n_v, 3) of all nodes whose displacements are moved (n_v, dim + 1), mm."""
        x = self.rest.copy()
        x[:, : moved.shape[1]] += moved
        return x

    def shapes_above(self, on: Facing) -> Array:
        """Shape functions (1 + dim, n_p, n_k) of the upper facets on which the points lie, and their derivatives by the coordinates
        of the points' lower facets."""
        shapes = shapes_at(self.upper.shape[1], on.place)
        under, over = (
            np.einsum("apn,pni->pai", known[1:], self.rest[nodes][..., [0, 2][: self.dim]])
            for known, nodes in ((self.shapes, self.lower[self.own]), (shapes, self.upper[on.facet]))
        )
        return np.concatenate([shapes[:1], np.einsum("pab,bpn->apn", under @ np.linalg.inv(over), shapes[1:])])

    def facing(self, moved: Array) -> Facing:
        """On what the points lie, where displacements are moved (n_v, dim + 1), mm."""
        places = self.places(moved)
        x = np.einsum("pn,pni->pi", self.shapes[0], places[self.lower[self.own]])
        above = places[self.upper]
        point, facet = self._pairs(x, above)
        place, away = _nearest(above[facet], x[point], self.dim)
        beyond = np.maximum(np.maximum(-place, place - 1), 0.0).max(axis=1)
        sizes = np.linalg.norm(np.ptp(above[facet], axis=1), axis=1)
        order = np.lexsort((away + SECOND * sizes * beyond, point))
        first = order[np.unique(point[order], return_index=True)[1]]
        return Facing(facet[first], place[first], beyond[first] < BESIDE * (1 - 1e-9))

    def _pairs(self, x: Array, above: Array) -> tuple[Ints, Ints]:
        """Points and upper facets that are near each other; of a point that is near none, the nearest one."""
        low, high = above.min(axis=1), above.max(axis=1)
        away = np.linalg.norm(np.maximum(np.maximum(low - x[:, None], x[:, None] - high), 0.0), axis=2)
        away[~self.reached[self.own]] = np.inf
        near = away <= NEAR * np.linalg.norm(high - low, axis=1)
        near[np.arange(len(x)), away.argmin(axis=1)] = True
        point, facet = np.nonzero(near)
        return point, facet


def _nearest(facets: Array, x: Array, dim: int) -> tuple[Array, Array]:
    """The nearest places (n, dim) on facets (n, n_k, 3) to points x (n, 3), not more than BESIDE beyond their ends, and how far
    away they are (n,), mm."""
    place = np.full((len(x), dim), 0.5)
    for _ in range(ROUNDS):
        shapes = shapes_at(facets.shape[1], place)
        y, tangents = np.einsum("pn,pni->pi", shapes[0], facets), np.einsum("apn,pni->pai", shapes[1:], facets)
        metric = tangents @ tangents.swapaxes(1, 2)
        step = np.linalg.solve(metric, np.einsum("pai,pi->pa", tangents, x - y)[..., None])[..., 0]
        place = np.clip(place + step, -BESIDE, 1 + BESIDE)
    y = np.einsum("pn,pni->pi", shapes_at(facets.shape[1], place)[0], facets)
    return place, np.linalg.norm(x - y, axis=1)


def grid(x: Array, dim: int) -> Array:
    """Places (n, dim) with coordinates among x; the first coordinate changes fastest, as that of a facet's nodes does."""
    return np.stack([part.ravel() for part in np.meshgrid(*[x] * dim, indexing="ij")][::-1], axis=1)


def shapes_at(n_nodes: int, places: Array) -> Array:
    """Shape functions (1 + dim, n_p, n_nodes) of a facet at places (n_p, dim), and their derivatives by the coordinates."""
    dim = places.shape[1]
    n = round(n_nodes ** (1 / dim))
    powers = np.linalg.inv(np.linspace(0, 1, n)[:, None] ** np.arange(n))
    x = places.T[..., None]
    N = (x ** np.arange(n)) @ powers
    dN = (np.arange(n) * x ** np.maximum(np.arange(n) - 1, 0)) @ powers
    if dim == 1:
        return np.array([N[0], dN[0]])
    products = ((N[0], N[1]), (dN[0], N[1]), (N[0], dN[1]))
    return np.array([(second[:, :, None] * first[:, None, :]).reshape(len(places), -1) for first, second in products])


def _gauss(n: int, dim: int) -> tuple[Array, Array]:
    """The Gauss points (n_p, dim) of a facet, n in a row, and their shares (n_p,)."""
    x, w = np.polynomial.legendre.leggauss(n)
    shares = np.asarray(w / 2, dtype=float)
    return grid((x + 1) / 2, dim), shares if dim == 1 else np.kron(shares, shares)
