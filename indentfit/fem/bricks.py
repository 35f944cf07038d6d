"""Bricks of a plane mesh and the heights of its layers: with eight nodes, or quadratic ones whose edges follow circles."""

from collections.abc import Sequence

import numpy as np
from skfem import MeshHex, MeshHex2, MeshQuad

from indentfit.arrays import Array, Ints

# Distance from the top of the first nodes of quadratic bricks on a side that may roll up against a strip, over the thickness of the
# top layer: an element is as fine as its nodes, and the fields are singular at that corner. With 0.3 instead of 0.5 the side rolls
# up, with a snap, only where fibres are half as stiff again (zeta of 10 instead of 6), and the rim can be finer.
MIDDLE = 0.3


def merge(patches: Sequence[Array], same: float = 1e-6) -> MeshQuad:
    """One MeshQuad of (x, z) from patches (2, m, n); points closer than `same` times the mesh's extent are merged."""
    points, cells, offset = [], [], 0
    for patch in patches:
        m, n = patch.shape[1:]
        number = np.arange(m * n).reshape(m, n) + offset
        cell = np.array([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]]).reshape(4, -1)
        points.append(patch.reshape(2, -1))
        cells.append(cell)
        offset += m * n
    p, t = np.hstack(points), np.hstack(cells)
    keys = np.round(p / (same * np.abs(p).max())).astype(np.int64)
    _, first, inverse = np.unique(keys, axis=1, return_index=True, return_inverse=True)
    t = inverse.reshape(-1)[t]
    p = p[:, first]
    negative = _areas(p, t) < 0
    t[:, negative] = t[::-1, negative]
    return MeshQuad(np.ascontiguousarray(p), np.ascontiguousarray(t))


def _areas(p: Array, t: Ints) -> Array:
    x, z = p[:, t]
    return 0.5 * ((x[2] - x[0]) * (z[3] - z[1]) - (x[3] - x[1]) * (z[2] - z[0]))


def extrude(plane: MeshQuad, heights: Array) -> MeshHex:
    """MeshHex of a MeshQuad in (x, z) and the heights of its layers along y."""
    n, layers = plane.p.shape[1], heights.size
    x, z = plane.p
    p = np.array([np.tile(x, layers), np.repeat(heights, n), np.tile(z, layers)])
    a, b, c, d = (plane.t[:, None, :] + n * np.arange(layers - 1)[None, :, None]).reshape(4, -1)
    return MeshHex(p, np.array([a, d, a + n, b, d + n, c, b + n, c + n]))


def quadratic(mesh: MeshHex, circles: Sequence[float] = (), rolls: Ints | Sequence[int] = (), closest: float = 0.0) -> MeshHex2:
    """Quadratic bricks of an extruded mesh. Faces and bricks follow their edges (transfinite).

    Parameters
    ----------
    mesh : MeshHex
    circles : radii about the y axis, mm
        An edge between two points of one circle follows this circle.
    rolls : array (n,)
        Facets that may roll up against the indenter. Their first nodes below the top are at MIDDLE of the top layer, or at the
        distance `closest` from the top where MIDDLE is nearer to the top, but not below the layer's middle.
    closest : float, mm

    Returns
    -------
    MeshHex2
    """
    finer = MeshHex2.from_mesh(mesh)
    p, dofs = finer.p.copy(), finer.dofs
    ends = mesh.p[:, mesh.edges]
    edges = ends.mean(axis=1)
    radii = np.hypot(ends[0], ends[2])
    for radius in circles:
        on = np.all(np.abs(radii - radius) < 1e-9 * radius, axis=0)
        edges[::2, on] *= radius / np.hypot(edges[0, on], edges[2, on])
    low, high = np.unique(mesh.p[1])[-2:]
    rim = np.unique(mesh.f2e[:, rolls])
    rim = rim[(ends[1, :, rim].min(axis=1) == low) & (ends[1, :, rim].max(axis=1) == high)]
    edges[1, rim] = high - max(MIDDLE * (high - low), min(closest, (high - low) / 2))
    faces = edges[:, mesh.f2e].sum(axis=1) / 2 - mesh.p[:, mesh.facets].sum(axis=1) / 4
    bricks = faces[:, mesh.t2f].sum(axis=1) / 2 - edges[:, mesh.t2e].sum(axis=1) / 4 + mesh.p[:, mesh.t].sum(axis=1) / 8
    for numbers, values in ((dofs.edge_dofs, edges), (dofs.facet_dofs, faces), (dofs.interior_dofs, bricks)):
        p[:, numbers[0]] = values
    return MeshHex2(p, mesh.t).with_boundaries(mesh.boundaries or {})
