"""The points at which contact is integrated: the nodes of bricks' facets, or Gauss points on a meridian's edge.

Where a node is a point, the node has one state, so no element of a three-dimensional face has to stick and slip at once. In the
meridian plane the end of a round contact moves through the elements: with several points in each edge the force grows smoothly.
"""

from typing import NamedTuple, Protocol

import numpy as np

from indentfit.arrays import Array, Bools, Ints
from indentfit.fem.element import Solid
from indentfit.fem.meridian import Meridian
from indentfit.fem.sliding import Sliding
from indentfit.fem.tied import Tied

RULE = {"q1p0": np.array([1 / 2, 0, 1 / 2]), "q2p1": np.array([1 / 6, 4 / 6, 1 / 6])}  # weights at the ends and in the middle


GAUSS = 4  # points on each edge of a meridian


class ContactPoints(Protocol):
    """Where contact is integrated, and how its points hang on the body's displacements.

    X: points (n_f, n_q, 3), mm; weights: their areas (n_f, n_q), mm^2, of one copy of the body; spacing: distance (n_f,) between
    the facets' nodes, mm; under: (n_f,) of bool, the facets of the top; surface: dofs (n_s,) that the contact acts on, rising.
    """

    X: Array
    weights: Array
    spacing: Array
    under: Bools
    surface: Ints

    def field(self, u: Array) -> Array:
        """Displacements (n_f, n_q, 3), mm, at the points, of those of all nodes u (n,)."""
        ...

    def spread(self, traction: Array) -> Array:
        """Nodal forces (n,), mN, of tractions (n_f, n_q, 3), kPa."""
        ...

    def add_stiffness(self, stiffness: Array, values: Array | None) -> Array:
        """Add the tangent of stiffnesses (n_f, n_q, 3, 3), kPa/mm, to CSR values (nnz,), where they are given.

        Returns
        -------
        array (n_s, n_s), mN/mm
            The tangent as a dense matrix on the dofs `surface`.
        """
        ...

    def nodal_mean(self, pressure: Array) -> Array:
        """Means (n_v,) at the body's nodes, by area, of a quantity (n_f, n_q) at the points; zero at nodes without."""
        ...


class NodePoints:
    """The nodes of the facets of bricks that may touch: the footprint, the surface beside it, the side that the indenter overhangs.

    Parameters
    ----------
    solid : Solid, Tied or Sliding
        Its mesh has the boundaries footprint, beside and overhung.
    thickness : float, mm
    """

    def __init__(self, solid: Solid | Tied | Sliding, thickness: float) -> None:
        parts = [solid.mesh.boundaries[name] for name in ("footprint", "beside", "overhung")]
        facets, self.under = np.concatenate(parts), np.arange(sum(map(len, parts))) < len(parts[0])
        elements, nodes, areas = facet_nodes(solid, facets)
        self.dofs, self.n_dofs = solid.dofs[elements, nodes], solid.n_dofs
        self._signs, self._nodes, self._n_nodes = solid.signs[elements, nodes], solid.nodes[elements, nodes], solid.basis.N // 3
        self.X = np.ascontiguousarray(np.moveaxis(solid.basis.doflocs[:, 3 * self._nodes], 0, -1))
        side = np.arange(len(facets)) >= len(facets) - len(parts[-1])
        counts = ~side[:, None] | (self.X[..., 1] < thickness * (1 - 1e-9))  # the top's nodes belong to the top's facets alone
        self.weights = np.ascontiguousarray(areas * counts)
        self.spacing = np.sqrt(areas.sum(axis=1)) / (np.sqrt(areas.shape[1]) - 1)
        self.surface, places = np.unique(self.dofs, return_inverse=True)
        self._places = places.reshape(self.dofs.shape)
        block = 3 * solid.positions[elements, nodes, nodes]
        self._entries = (solid.indptr[self.dofs] + block[..., None])[..., None] + np.arange(3)

    def field(self, u: Array) -> Array:
        return self._signs * u[self.dofs]

    def spread(self, traction: Array) -> Array:
        out = np.zeros(self.n_dofs)
        np.add.at(out, self.dofs, self._signs * (self.weights[..., None] * traction))
        return out

    def add_stiffness(self, stiffness: Array, values: Array | None) -> Array:
        blocks = self._signs[..., :, None] * self._signs[..., None, :] * (self.weights[..., None, None] * stiffness)
        dense = np.zeros((self.surface.size,) * 2)
        if values is not None:
            np.add.at(values, self._entries, blocks)
        np.add.at(dense, (self._places[..., :, None], self._places[..., None, :]), blocks)
        return dense

    def nodal_mean(self, pressure: Array) -> Array:
        return _mean(self._nodes, pressure, self.weights, self._n_nodes)


class EdgePoints:
    """Gauss points on the edges of a meridian's top that may touch, in the plane z = 0.

    Parameters
    ----------
    body : Meridian or Sliding
        Its mesh has the boundaries footprint and beside.
    """

    def __init__(self, body: Meridian | Sliding) -> None:
        parts = [body.mesh.boundaries[name] for name in ("footprint", "beside")]
        facets = np.concatenate(parts)
        elements, nodes = body.mesh.f2t[0, facets], _edge_nodes(body, facets)
        dofs = body.dofs[elements[:, None], nodes]  # (n_f, 3, 2): the edge's ends, then its middle
        places, weights = np.polynomial.legendre.leggauss(GAUSS)
        x = (places + 1) / 2
        self._shape = np.stack([(1 - x) * (1 - 2 * x), x * (2 * x - 1), 4 * x * (1 - x)], axis=1)  # (n_q, 3)
        nodal = np.moveaxis(body.basis.doflocs[:, dofs[..., 0]], 0, -1)  # (n_f, 3, 2)
        plane = np.einsum("qa,fai->fqi", self._shape, nodal)
        length = np.linalg.norm(nodal[:, 1] - nodal[:, 0], axis=1)
        self.X = np.ascontiguousarray(np.concatenate([plane, np.zeros((*plane.shape[:2], 1))], axis=2))
        self.weights = np.pi * length[:, None] * weights * plane[..., 0]  # 2 pi r times half of the length
        self.spacing, self.under = length / 2, np.arange(len(facets)) < len(parts[0])
        self.n_dofs, self._dofs = body.n_dofs, dofs
        self.surface, at = np.unique(dofs, return_inverse=True)
        self._places = at.reshape(len(facets), 6)
        rows = (
            body.indptr[dofs][:, :, :, None]
            + 2 * body.positions[elements[:, None, None], nodes[:, :, None], nodes[:, None, :]][:, :, None]
        )
        self._entries = (rows[..., None] + np.arange(2)).reshape(len(facets), 6, 6)

    def field(self, u: Array) -> Array:
        moved = np.zeros_like(self.X)
        moved[..., :2] = np.einsum("qa,fai->fqi", self._shape, u[self._dofs])
        return moved

    def spread(self, traction: Array) -> Array:
        out = np.zeros(self.n_dofs)
        np.add.at(out, self._dofs, np.einsum("fq,qa,fqi->fai", self.weights, self._shape, traction[..., :2]))
        return out

    def add_stiffness(self, stiffness: Array, values: Array | None) -> Array:
        n_f = len(self._dofs)
        blocks = np.einsum("fq,qa,qb,fqij->faibj", self.weights, self._shape, self._shape, stiffness[..., :2, :2]).reshape(
            n_f, 6, 6
        )
        dense = np.zeros((self.surface.size,) * 2)
        if values is not None:
            np.add.at(values, self._entries, blocks)
        np.add.at(dense, (self._places[:, :, None], self._places[:, None, :]), blocks)
        return dense

    def nodal_mean(self, pressure: Array) -> Array:
        nearness = np.maximum(1 - 2 * np.abs(np.array([0, 1, 0.5]) - self._x()[:, None]), 0)  # (n_q, 3)
        weights = np.einsum("fq,qa->fqa", self.weights, nearness)
        nodes = np.broadcast_to(self._dofs[:, None, :, 0] // 2, weights.shape)
        return _mean(nodes, np.broadcast_to(pressure[..., None], weights.shape), weights, self.n_dofs // 2)

    def _x(self) -> Array:
        return (np.polynomial.legendre.leggauss(GAUSS)[0] + 1) / 2


def _mean(nodes: Ints, values: Array, weights: Array, n_nodes: int) -> Array:
    total = np.bincount(nodes.ravel(), weights=(weights * values).ravel(), minlength=n_nodes)
    area = np.bincount(nodes.ravel(), weights=weights.ravel(), minlength=n_nodes)
    return np.divide(total, area, out=np.zeros(n_nodes), where=area > 0)


def _edge_nodes(body: Meridian | Sliding, facets: Ints) -> Ints:
    """Numbers (n_f, 3) within their elements of the facets' nodes: the ends, by their radius, then the middle."""
    mesh, places = body.mesh, body.basis.elem.elem.doflocs  # (9, 2) of the reference element
    corners = mesh.t[:, mesh.f2t[0, facets]]  # (4, n_f)
    ends = [
        sorted(np.flatnonzero(np.isin(corner, mesh.facets[:, f])), key=lambda n: mesh.p[0, corner[n]])
        for corner, f in zip(corners.T, facets, strict=True)
    ]
    middle = [np.flatnonzero(np.all(np.isclose(places, places[[a, b]].mean(axis=0)), axis=1))[0] for a, b in ends]
    return np.column_stack([np.array(ends), middle])


class FacetNodes(NamedTuple):
    """Nodes of facets: their elements (n_f, 1), the numbers (n_f, n_q) that the nodes have there, and areas (n_f, n_q), mm^2."""

    elements: Ints
    nodes: Ints
    areas: Array


def facet_nodes(solid: Solid | Tied | Sliding, facets: Ints) -> FacetNodes:
    """The nodes of facets (n_f,) of a body's surface, by the trapezoidal rule, or Simpson's on quadratic facets."""
    mesh, places = solid.mesh, solid.basis.elem.elem.doflocs  # (n_n, 3) of the reference element
    elements = mesh.f2t[0, facets]
    sides = [(axis, np.flatnonzero(places[:, axis] == at)) for axis in range(3) for at in (0, 1)]
    nodes, areas = np.empty((len(facets), len(sides[0][1])), dtype=int), np.empty((len(facets), len(sides[0][1])))
    corners = np.sort(mesh.facets[:, facets], axis=0)
    for axis, on in sides:
        vertices = on[on < mesh.t.shape[0]]
        here = np.all(np.sort(mesh.t[vertices][:, elements], axis=0) == corners, axis=0)
        DF = solid.basis.mapping.DF(places[on].T, tind=elements[here])  # (3, 3, n_f, n_q)
        a, b = (np.moveaxis(DF[:, other], 0, -1) for other in range(3) if other != axis)
        share = np.prod([RULE[solid.element][(2 * places[on, other]).astype(int)] for other in range(3) if other != axis], axis=0)
        nodes[here], areas[here] = on, np.linalg.norm(np.cross(a, b), axis=-1) * share
    return FacetNodes(elements[:, None], nodes, areas)
