"""Displacements of single points of a sample, extracted from a solution by shape functions.

A point lies anywhere in the whole undeformed sample. Where a part of the sample is meshed, the point and the direction in which its
displacement is measured are folded into the part by the symmetry of the part. Each measured component is then a row of numbers by
which the displacements u (n,) of the body are multiplied, and derivatives of the displacements by anything are multiplied by the
same row.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.sparse as sp

from indentfit.arrays import Array, Ints
from indentfit.errors import MeshError
from indentfit.fem.symmetry import Part
from indentfit.outlines import Trace

CHUNK = 256  # points that are looked for at once
ITERATIONS = 25  # of Newton's method for the place of a point within an element
OUTSIDE = 1.0  # of an element's size: how far beyond the mesh, whose sides may be polygons, shape functions are continued


@dataclass(frozen=True, eq=False)
class Observed:
    """Components of displacements that are measured in one test.

    Parameters
    ----------
    points : array (m, 3)
        x and z in mm, y as a share of the thickness, of the whole undeformed sample; a point is given once for each component.
    directions : array (m, 3)
        Unit vectors along which the displacement counts positive.
    groups, shares : arrays (m,)
        The group to which each component belongs, and its share in the mean of that group.
    depths : array (g,), mm
        Displacement of the indenter at which each group was measured.
    pieces : tuple of (int, Trace or None)
        The number of groups of each field, and what makes distances of its displacements, where the field is an outline; without
        any, all groups are of fields of displacements.
    """

    points: Array
    directions: Array
    groups: Ints
    shares: Array
    depths: Array
    pieces: tuple[tuple[int, Trace | None], ...] = ()

    @classmethod
    def single(cls, points: Array, directions: Array, depths: Array) -> "Observed":
        """Components that are not averaged."""
        return cls(points, directions, np.arange(len(points)), np.ones(len(points)), depths)

    @classmethod
    def together(cls, parts: "Sequence[Observed]") -> "Observed":
        """The components of several fields, in a row."""
        starts = np.cumsum([0, *(part.depths.size for part in parts)])
        groups = np.concatenate([part.groups + start for part, start in zip(parts, starts, strict=False)])
        points, directions, shares, depths = (
            np.concatenate([getattr(part, name) for part in parts]) for name in ("points", "directions", "shares", "depths")
        )
        pieces = [piece for part in parts for piece in (part.pieces or ((part.depths.size, None),))]
        return cls(points, directions, groups, shares, depths, tuple(pieces))

    def traced(self, seen: Array, by_name: dict[str, Array]) -> tuple[Array, dict[str, Array]]:
        """What was measured, and its derivatives, from the displacements (g,) of the groups and theirs."""
        if all(trace is None for _, trace in self.pieces):
            return seen, by_name
        ends = np.cumsum([size for size, _ in self.pieces])[:-1]
        traces, parts = [trace for _, trace in self.pieces], np.split(seen, ends)
        values = [part if trace is None else trace.apparent(part) for trace, part in zip(traces, parts, strict=True)]
        changed = {}
        for name, row in by_name.items():
            rows = zip(traces, parts, np.split(row, ends), strict=True)
            changed[name] = np.concatenate([by if trace is None else trace.change(part, by) for trace, part, by in rows])
        return np.concatenate(values), changed

    def later(self, offset: float) -> "Observed":
        """The same components where contact begins at a depth, mm."""
        return replace(self, depths=self.depths - offset)

    @property
    def key(self) -> bytes:
        """What decides which displacements are seen."""
        parts = (self.points, self.directions, self.groups, self.shares)
        traces = b"".join(trace.key for _, trace in self.pieces if trace is not None)
        return b"".join(np.ascontiguousarray(part).tobytes() for part in parts) + traces


def rows_of(body: Any, part: Part | None, observed: Observed, thickness: float) -> sp.csr_matrix:
    """The matrix (g, n) that gives the measured means of components from displacements u (n,) of a body.

    Parameters
    ----------
    body : Body
        With its basis: bricks, tied bricks or the meridian plane.
    part : Part or None
        The part of the sample that the body is; None where it is the meridian plane.
    observed : Observed
    thickness : float, mm

    Returns
    -------
    CSR matrix (g, n)

    Raises
    ------
    MeshError
        A point lies outside the mesh.
    """
    points = observed.points * [1.0, thickness, 1.0]
    points, directions = in_plane(points, observed.directions) if part is None else folded(points, observed.directions, part)
    unique, which = np.unique(points, axis=0, return_inverse=True)
    elements, values = _located(body, unique)
    elements, values, which = elements[which.ravel()], values[which.ravel()], which.ravel()
    dofs = body.dofs[elements]  # (m, n_n, k)
    signs = getattr(body, "signs", None)
    entries = values[:, :, None] * directions[:, None, :]
    if signs is not None:
        entries = entries * signs[elements]
    m, width = len(dofs), dofs.shape[1] * dofs.shape[2]
    rows = np.repeat(np.arange(m), width)
    single = sp.csr_matrix((entries.reshape(m, -1).ravel(), (rows, dofs.reshape(m, -1).ravel())), shape=(m, body.n_dofs))
    means = sp.csr_matrix((observed.shares, (observed.groups, np.arange(m))), shape=(observed.depths.size, m))
    return sp.csr_matrix(means @ single)


def folded(points: Array, directions: Array, part: Part) -> tuple[Array, Array]:
    """Points (m, 3) and directions (m, 3) of the whole sample as those of a part of it."""
    signs = np.ones_like(points)
    if part.tied:
        turned = points[:, 2] < 0
        signs[turned] = [-1.0, 1.0, -1.0]
    for axis, plane in ((0, "x0"), (2, "z0")):
        if plane in part.planes:
            signs[points[:, axis] < 0, axis] = -1.0
    return signs * points, signs * directions


def in_plane(points: Array, directions: Array) -> tuple[Array, Array]:
    """Points (m, 2) and directions (m, 2) of the whole sample as radius and height in the meridian plane."""
    radius = np.hypot(points[:, 0], points[:, 2])
    outwards = np.divide(points[:, [0, 2]], radius[:, None], out=np.zeros((len(points), 2)), where=radius[:, None] > 0)
    radial = np.sum(outwards * directions[:, [0, 2]], axis=1)
    return np.column_stack([radius, points[:, 1]]), np.column_stack([radial, directions[:, 1]])


def _located(body: Any, points: Array) -> tuple[Ints, Array]:
    """For each point (m, k) its element, and the values (m, n_n) of the element's shape functions there."""
    k = points.shape[1]
    nodes, shapes = body.basis.doflocs[:, ::k], _Shapes(body)
    corners = nodes[:, body.nodes]  # (k, n_el, n_n)
    owner, tried = _near(corners.min(axis=2).T, corners.max(axis=2).T, points)
    inner = shapes.place(corners[:, tried], points[owner])
    off = np.maximum(np.maximum(-inner, inner - 1), 0).max(axis=1)
    order = np.lexsort((off, owner))
    first = order[np.searchsorted(owner[order], np.arange(len(points)))]  # of each point, the element that it is farthest in
    chosen, best, place = tried[first], off[first], inner[first]
    if best.max(initial=0.0) > OUTSIDE:
        n = int(np.argmax(best))
        where = ", ".join(f"{value:.4g}" for value in points[n])
        raise MeshError(f"the point ({where}) mm of a field lies outside the mesh")
    return chosen, shapes.values(place)


def _near(low: Array, high: Array, points: Array) -> tuple[Ints, Ints]:
    """Pairs of a point (m, k) and an element whose box, from `low` to `high` (n_el, k), holds it; where none does, the nearest."""
    sizes, owners, elements = high - low, [], []
    for start in range(0, len(points), CHUNK):
        part = points[start : start + CHUNK, None]
        away = np.max(np.maximum(low - part, part - high) / sizes, axis=2)  # in sizes of the element
        near = away <= np.maximum(OUTSIDE, away.min(axis=1) + 1e-9)[:, None]
        owner, element = np.nonzero(near)
        owners.append(owner + start)
        elements.append(element)
    return np.concatenate(owners), np.concatenate(elements)


class _Shapes:
    """The shape functions of a body's elements, on the unit square or cube."""

    def __init__(self, body: Any) -> None:
        self.element, self.number = body.basis.elem.elem, body.nodes.shape[1]

    def values(self, places: Array) -> Array:
        """(m, n_n) at places (m, k)."""
        return np.array([np.broadcast_to(self.element.lbasis(places.T, i)[0], len(places)) for i in range(self.number)]).T

    def slopes(self, places: Array) -> Array:
        """Derivatives (m, n_n, k) at places (m, k)."""
        parts = [self.element.lbasis(places.T, i)[1] for i in range(self.number)]
        rows = [[np.broadcast_to(slope, len(places)) for slope in part] for part in parts]
        return np.asarray(np.array(rows).transpose(2, 0, 1))

    def place(self, corners: Array, points: Array) -> Array:
        """The places (m, k) at which elements of nodes (k, m, n_n) have points (m, k), by Newton's method; far off where not."""
        places = np.full(points.shape, 0.5)
        for _ in range(ITERATIONS):
            off = points - np.einsum("mn,kmn->mk", self.values(places), corners)
            J = np.einsum("mnj,kmn->mkj", self.slopes(places), corners)
            singular = np.abs(np.linalg.det(J)) < 1e-300
            J[singular] = np.eye(points.shape[1])
            step = np.linalg.solve(J, off[..., None])[..., 0]
            places = np.clip(places + np.clip(step, -0.5, 0.5), -1.0, 2.0)
            if np.abs(step).max(initial=0.0) < 1e-13:
                break
        off = points - np.einsum("mn,kmn->mk", self.values(places), corners)
        lost = np.abs(off).max(axis=1) > 1e-9 * np.ptp(corners, axis=2).max(axis=0)
        return np.where(lost[:, None], 9.0, places)
