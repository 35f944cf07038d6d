"""The points at which contact is integrated: the nodes of facets, each with its share of the facet's area."""

from typing import NamedTuple

import numpy as np

from indentfit.arrays import Array, Ints
from indentfit.fem.element import Solid

RULE = {"q1p0": np.array([1 / 2, 0, 1 / 2]), "q2p1": np.array([1 / 6, 4 / 6, 1 / 6])}  # weights at the ends and in the middle


class FacetNodes(NamedTuple):
    """Nodes of facets: their elements (n_f, 1), the numbers (n_f, n_q) that the nodes have there, and areas (n_f, n_q), mm^2."""

    elements: Ints
    nodes: Ints
    areas: Array


def facet_nodes(solid: Solid, facets: Ints) -> FacetNodes:
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
