"""A body of layers that slide on each other without friction and stay together, as a body.

The mesh is cut where layers slide: each of the two faces has nodes of its own. A point x of the lower face and the point y of the
upper face on which it lies stay in one tangent plane: with the means a, b of both faces' tangents,

    det(a, b, y - x) = 0    (in a meridian plane b is the direction across it),

which is exact up to the third power of how far they slid (the mean of both normals is that of the chord between them). The pairs
are those at rest, or, where that is too far, those of each step (`fem.facing`). The pressure that keeps this is an unknown of the
body like those that keep the volume: each point is one more element, whose "dilatation" is the gap and whose "bulk modulus" is so
large that the gap is nothing. The pressure acts along the mean normal on both faces alike, so that no force and no moment is lost
(Nanson's formula gives the deformed area).
"""

import copy
import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
import scipy.sparse as sp
from scipy.spatial import cKDTree
from skfem import MeshHex, MeshQuad

from indentfit.arrays import Array, Bools, Ints
from indentfit.case.tables import Sample
from indentfit.errors import MeshError
from indentfit.fem.body import BodyState, Bulk, Volumetric, per_element, volumetric
from indentfit.fem.element import Solid, sparsity
from indentfit.fem.facing import Faces, Facing, grid, shapes_at
from indentfit.fem.meridian import Meridian
from indentfit.fibres import Fibre
from indentfit.material import Material

Mesh = TypeVar("Mesh", MeshHex, MeshQuad)
Uncut = TypeVar("Uncut", Solid, Meridian)
TOGETHER = 2e4  # "bulk modulus" of an interface, in units of the top layer's shear modulus: its gap is the pressure over this
NUDGE = 1e-7  # of the sample's extent: how far faces are moved for the derivative by where points lie
SAMPLES = 8  # places in a row on each facet at which that is looked at
SAME = 1e-7  # of the sample's extent: how far apart nodes of both faces may be at rest
LEVI_CIVITA = np.zeros((3, 3, 3))
for _i, _j, _k in itertools.permutations(range(3)):
    LEVI_CIVITA[_i, _j, _k] = (_i - _j) * (_j - _k) * (_k - _i) / 2


def cut(mesh: Mesh, heights: Sequence[float]) -> Mesh:
    """A mesh with two nodes in place of each node at some heights, mm, which are heights of mesh lines; without boundaries."""
    p, t, extent = mesh.p, mesh.t.copy(), np.ptp(mesh.p[1])
    middles = mesh.p[1, mesh.t].mean(axis=0)
    for height in heights:
        own = np.abs(mesh.p[1] - height) < SAME * extent
        twin = np.arange(own.size)
        twin[own] = p.shape[1] + np.arange(np.count_nonzero(own))
        upper = own[mesh.t] & (middles > height)
        t[upper] = twin[mesh.t[upper]]
        p = np.hstack([p, mesh.p[:, own]])
    return type(mesh)(np.ascontiguousarray(p), np.ascontiguousarray(t))


@dataclass(frozen=True, eq=False)
class Facets:
    """Points of lower facets that slide on upper facets, of a body with k displacements at each node.

    Attributes
    ----------
    faces : tuple of Faces
        The first one has the Gauss points of the lower facets; those of the upper ones, with both faces exchanged, where these
        follow. The second one then has the points by which these facets are held between them.
    nodes : array (n_p, 2 n_k)
        Nodes of each point's own facet, then those of the facet on which it lies.
    k : int
    weights : array (3, n_p, 2 n_k)
        What makes of the nodes' places the means of both faces' tangents, and the distance of the faces; nothing of a point that
        lies on nothing.
    scale : array (n_p,)
        The gap mode over the determinant.
    follows : bool
        Whether points lie on what they have slid on, not on what they lay on at rest.
    """

    faces: tuple[Faces, ...]
    nodes: Ints
    k: int
    weights: Array
    scale: Array
    follows: bool

    @classmethod
    def of(
        cls,
        body: "Solid | Meridian",
        heights: Sequence[float],
        thickness: Sequence[float],
        reach: float | None = None,
        follows: str = "",
    ) -> "Facets":
        """The facets at some heights, mm, each with the thickness of the thinner layer beside it, mm; reach: how far points may
        slide that lie on what they have slid on, mm; follows: of which faces the Gauss points are then.

        Raises
        ------
        MeshError
            The mesh is not cut there.
        """
        points, lengths = body.points(), np.asarray(thickness)
        elements = points[1, body.nodes]
        pairs, owner = [], []
        for number, height in enumerate(heights):
            at = np.abs(elements - height) < SAME * np.ptp(points[1])
            touching, below = at.sum(axis=1) > 1, elements.mean(axis=1) < height
            lower, upper = (_facet_nodes(body, np.flatnonzero(touching & side), at) for side in (below, ~below))
            pairs.append(_paired(points, lower, upper))
            owner.append(np.full(len(lower), number))
        lower, upper = np.split(np.concatenate(pairs), 2, axis=1)
        if follows == "upper":
            lower, upper = upper, lower
        interface = np.concatenate(owner)
        faces = [Faces.of(points.T, lower, upper, interface, reach)]
        if reach is not None:
            faces.append(Faces.of(points.T, lower, upper, interface, reach, between=True))
        made = cls._facing(tuple(faces), [part.at_rest for part in faces], len(points), np.empty(0), reach is not None)
        a, b, _ = made._vectors(np.zeros(points.size))
        area = np.linalg.norm(np.cross(a, b), axis=1)
        shares, ring, layers = (
            np.concatenate(known)
            for known in zip(*((part.shares, 2 * np.pi * part.radius, lengths[interface][part.own]) for part in faces), strict=True)
        )
        return replace(made, scale=np.sqrt(shares * (1.0 if len(points) == 3 else ring) / area / layers))

    @classmethod
    def _facing(cls, faces: tuple[Faces, ...], on: Sequence[Facing], k: int, scale: Array, follows: bool) -> "Facets":
        """The facets with each point on what the Facings say."""
        nodes, weights = [], []
        for part, lies in zip(faces, on, strict=True):
            own, other = part.shapes, part.shapes_above(lies)
            tangents = [np.hstack([a, b]) / 2 for a, b in zip(own[1:], other[1:], strict=True)]
            if k == 2:
                tangents.append(np.zeros_like(tangents[0]))
            weights.append(np.array([*tangents, np.hstack([-own[0], other[0]])]) * lies.covered[:, None])
            nodes.append(np.hstack([part.lower[part.own], part.upper[lies.facet]]))
        return cls(faces, np.concatenate(nodes), k, np.concatenate(weights, axis=1), scale, follows)

    @property
    def lies(self) -> Bools:
        """Whether each point (n_p,) lies on a facet."""
        return np.asarray(np.abs(self.weights[2]).max(axis=1) > 0)

    def sliding_on(self, u: Array) -> "Facets":
        """These facets with each point on what it lies on at displacements u (n,); themselves where points do not follow."""
        if not self.follows:
            return self
        on = [part.facing(u.reshape(-1, self.k)) for part in self.faces]
        return self._facing(self.faces, on, self.k, self.scale, True)

    def gaps(self, u: Array) -> Array:
        """The gap modes (n_p,) at displacements u (n,), in the unit of a dilatation's modes."""
        return np.asarray(self.scale * np.linalg.det(np.stack(self._vectors(u), axis=1)))

    def slopes(self, u: Array) -> Array:
        """Their derivatives by the displacements of each point's nodes, (n_p, 2 n_k, k)."""
        a, b, d = self._vectors(u)
        normals = np.array([np.cross(b, d), np.cross(d, a), np.cross(a, b)])[..., : self.k]
        return np.einsum("p,vpn,vpi->pni", self.scale, self.weights, normals)

    def stiffness(self, u: Array, pressure: Array, bulk: Array) -> Array:
        """Derivative (n_p, 2 n_k k, 2 n_k k) of the points' forces, slopes times pressures (n_p,), where a pressure grows with its
        gap by a modulus (n_p,)."""
        a, b, d = vectors = self._vectors(u)
        k, (_, n_p, n) = self.k, self.weights.shape
        normals = np.stack([np.cross(b, d), np.cross(d, a), np.cross(a, b)], axis=1)[..., :k]
        along = self.scale[:, None, None] * normals
        by_vectors = (bulk[:, None, None] * along).reshape(n_p, -1, 1) * along.reshape(n_p, 1, -1)
        by_vectors = by_vectors.reshape(n_p, 3, k, 3, k)
        for first, second, third in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
            turn = np.einsum("ijm,pm->pij", LEVI_CIVITA[:k, :k], (self.scale * pressure)[:, None] * vectors[third])
            by_vectors[:, first, :, second] += turn
            by_vectors[:, second, :, first] -= turn
        weights = np.ascontiguousarray(self.weights.transpose(1, 0, 2))
        half = by_vectors.swapaxes(3, 4).reshape(n_p, -1, 3) @ weights  # (v i j, n)
        half = half.reshape(n_p, 3, k, k, n).swapaxes(3, 4).reshape(n_p, 3, -1)
        return np.asarray(weights.swapaxes(1, 2) @ half).reshape(n_p, n * k, n * k)

    def apart(self, u: Array) -> float:
        """How far apart the faces are, or how far in each other, mm, where each point is compared with what it lies on now: the
        root mean square, weighted by how far the points have moved along y."""
        lower, upper, spacing = self._sampled(u)
        away, over = cKDTree(lower[0]).query(upper[0])
        facing = away < spacing  # a rim that has slid beyond the other lies on nothing
        normals = upper[1][facing] + lower[1][over[facing]]
        distance = np.sum(normals * (upper[0][facing] - lower[0][over[facing]]), axis=1) / np.linalg.norm(normals, axis=1)
        moved = np.abs(upper[2][facing])
        return float(np.sqrt(np.sum(moved * distance**2) / max(moved.sum(), 1e-300)))

    def _sampled(self, u: Array) -> tuple[tuple[Array, Array, Array], tuple[Array, Array, Array], float]:
        """Points (n, 3) all over the lower and the upper faces with their normals and how far they have moved along y, and the
        largest distance of neighbours, mm."""
        dim, faces, sides = self.k - 1, self.faces[0], []
        shapes, *slopes = shapes_at(faces.lower.shape[1], grid((np.arange(SAMPLES) + 0.5) / SAMPLES, dim))
        places = faces.places(u.reshape(-1, self.k))
        for nodes in (faces.lower, faces.upper):
            side = places[nodes]
            tangents = [np.einsum("pn,fni->fpi", slope, side) for slope in slopes]
            across = tangents[1] if dim == 2 else np.broadcast_to([0.0, 0.0, 1.0], tangents[0].shape)
            normals = np.cross(tangents[0], across)
            normals /= np.linalg.norm(normals, axis=2, keepdims=True) * np.sign(normals[..., 1:2])
            points, rest = np.einsum("pn,fni->fpi", shapes, side).reshape(-1, 3), faces.rest[nodes[:, 0], 1]
            sides.append((points, normals.reshape(-1, 3), points[:, 1] - np.repeat(rest, len(shapes))))
        widths = np.ptp(places[faces.lower], axis=1)
        return sides[0], sides[1], float(np.linalg.norm(widths, axis=1).max() / SAMPLES)

    def _vectors(self, u: Array) -> tuple[Array, Array, Array]:
        """Both tangents and the distance of the faces at the points, each (n_p, 3)."""
        a, b, d = np.einsum("vpn,pni->vpi", self.weights, self.faces[0].places(u.reshape(-1, self.k))[self.nodes])
        return a, b if self.k == 3 else b + np.array([0.0, 0.0, 1.0]), d


def _facet_nodes(body: "Solid | Meridian", elements: Ints, at: Any) -> Ints:
    """Nodes (n_f, n_k) of each element's facet among its nodes `at` a height, in the order of the facet's own coordinates."""
    places, rows = body.basis.elem.elem.doflocs, []
    for element in elements:
        own = np.flatnonzero(at[element])
        spread = np.ptp(places[own], axis=0) > 0
        rows.append(body.nodes[element, own[np.lexsort(places[own][:, spread].T)]])
    return np.array(rows)


def _paired(points: Array, lower: Ints, upper: Ints) -> Ints:
    """Nodes (n_f, 2 n_k) of lower facets and of the upper facets that lie on them, in the same order."""
    middles = [points[:, nodes].mean(axis=2).T for nodes in (lower, upper)]
    beside = upper[cKDTree(middles[1]).query(middles[0])[1]]
    away = np.linalg.norm(points[:, lower, None] - points[:, beside][:, :, None], axis=0)
    if lower.shape != upper.shape or away.min(axis=2).max() > SAME * np.ptp(points) or np.any(lower == beside):
        raise MeshError("the mesh of layers that slide is not cut between them")
    return np.hstack([lower, np.take_along_axis(beside, away.argmin(axis=2), axis=1)])


class Sliding:
    """A Body whose layers slide on each other.

    Parameters
    ----------
    body : Solid or Meridian
        Its mesh is cut where layers slide.
    facets : Facets

    Attributes
    ----------
    dofs : array (n_el + n_f, n_n, k)
        Those of the elements, then those of the pairs of facets, each with one of its nodes repeated up to n_n.
    nodes : array (n_el, n_n)
        Of the elements alone.
    """

    def __init__(self, body: "Solid | Meridian", facets: Facets) -> None:
        self.solid, self._n = body, len(body.nodes)
        self.mesh, self.element, self.basis, self.copies = body.mesh, body.element, body.basis, body.copies
        self.weights, self.nodes, self._k = body.weights, body.nodes, facets.k
        self.coupled = _as_cells(facets.faces[0].coupled, body.nodes.shape[1])
        nothing = np.zeros((len(facets.nodes), body.means.shape[1]))
        self.volume, self.means = np.concatenate([body.volume, nothing[:, 0]]), np.concatenate([body.means, nothing])
        cells = np.concatenate([body.nodes, self.coupled])
        self.indptr, self.indices, self.positions = sparsity(cells, body.n_dofs // self._k, self._k)
        self._blocks = _blocks(self.indptr, self.indices, self._k)
        self._places = _places(body.indptr, body.indices, self.indptr, self.indices)
        self._link(facets)

    def _link(self, facets: Facets) -> None:
        """Take the points of facets as elements."""
        self.facets, k, nodes = facets, self._k, facets.nodes
        links = _as_cells(nodes, self.nodes.shape[1])
        self.dofs = np.concatenate([self.solid.dofs, (k * links[..., None] + np.arange(k)).astype(np.int32)])
        self.signs = np.ones(self.dofs.shape)
        self._linked = (k * nodes[..., None] + np.arange(k)).reshape(len(nodes), -1)
        wanted = nodes[:, :, None].astype(np.int64) * (self.indptr.size // k) + nodes[:, None]
        columns = k * (np.searchsorted(self._blocks, wanted) - self.indptr[k * nodes][:, :, None] // k**2)
        entries = self.indptr[self._linked].reshape(*nodes.shape, k, 1, 1) + columns[:, :, None, :, None] + np.arange(k)
        self._entries = entries.ravel()  # ufunc.at is fast along one axis

    def sliding_on(self, u: Array) -> "Sliding":
        """This body with each point of a lower face on what it lies on at displacements u (n,); itself where points do not
        follow."""
        facets = self.facets.sliding_on(u)
        if facets is self.facets:
            return self
        other = copy.copy(self)
        other._link(facets)
        return other

    def slid_forces(self, u: Array, led: Array, change: Array, kappa: Bulk) -> Array:
        """Change (n,) of the forces at fixed u (n,), where the displacements `led` (n,) at which points have been laid on facets
        change by `change`. A point that leaves its facet has no derivative; its share is left out."""
        step = NUDGE * np.ptp(self.facets.faces[0].rest[:, 0]) / max(np.abs(change).max(), 1e-300)
        ahead, behind = (self.facets.sliding_on(led + sign * step * change) for sign in (1, -1))
        stiffness, nodes = per_element(kappa, len(self.dofs))[self._n :], self.facets.nodes
        stay = np.all((ahead.nodes == nodes) & (behind.nodes == nodes), axis=1) & (ahead.lies == behind.lies)
        links = [side.slopes(u) * (stiffness * side.gaps(u))[:, None, None] for side in (ahead, behind)]
        along = np.where(stay[:, None, None], links[0] - links[1], 0.0) / (2 * step)
        return np.bincount(self._linked.ravel(), along.ravel(), self.n_dofs).astype(float, copy=False)

    @property
    def n_dofs(self) -> int:
        return self.solid.n_dofs

    def held(self, base: str, motions: frozenset[str] = frozenset(), ends: bool = False) -> Ints:
        return self.solid.held(base, motions, ends)

    def points(self) -> Array:
        return self.solid.points()

    def unfolded(self, u: Array) -> "tuple[Solid | Meridian, Array]":
        """The body without its interfaces, and u (n,)."""
        return self.solid, u

    def corners(self, u: Array) -> tuple[Array, Array]:
        return self.solid.corners(u)

    def state(self, u: Array, fibre: Fibre) -> BodyState:
        own = self.solid.state(u, fibre)
        gaps = np.zeros((len(self._linked), self.means.shape[1]))
        gaps[:, 0] = self.facets.gaps(u)
        return BodyState(own.I, np.concatenate([own.theta, gaps]), own.valid)

    def pressure(self, state: BodyState, kappa: Bulk | Volumetric) -> Array:
        return volumetric(kappa).pressure(state.theta, self.means)

    def residual(self, u: Array, state: BodyState, material: Material, pressure: Array, fibre: Fibre) -> Array:
        forces = self.solid.residual(u, self._own(state), material, pressure[: self._n], fibre)
        return self._with_links(forces, u, pressure)

    def forces(self, u: Array, gradient: Array, pressure: Array, fibre: Fibre) -> Array:
        return self._with_links(self.solid.forces(u, gradient, pressure[: self._n], fibre), u, pressure)

    def tangent(
        self,
        u: Array,
        state: BodyState,
        material: Material,
        pressure: Array,
        kappa: Bulk | Volumetric,
        fibre: Fibre,
        bulk: Bulk | None = None,
    ) -> tuple[Array, Array]:
        n, law = self._n, volumetric(kappa)
        own = Volumetric(_rows(law.kappa, n), _rows(law.rest, n))
        forces, own_values = self.solid.tangent(
            u, self._own(state), material, pressure[:n], own, fibre, None if bulk is None else _rows(bulk, n)
        )
        values = np.zeros(self.indices.size)
        values[self._places] = own_values
        stiffness = per_element(law.kappa if bulk is None else bulk, len(self.dofs))[n:]
        np.add.at(values, self._entries, self.facets.stiffness(u, pressure[n:, 0], stiffness).ravel())
        return self._with_links(forces, u, self.pressure(state, law)), values

    def dilatation_map(self, u: Array) -> Array:
        slopes = self.facets.slopes(u)
        links = np.zeros((len(slopes), self.means.shape[1], *self.dofs.shape[1:]))
        links[:, 0, : slopes.shape[1]] = slopes
        return np.concatenate([self.solid.dilatation_map(u), links])

    def stress(self, u: Array, state: BodyState, material: Material, pressure: Array, fibre: Fibre) -> Array:
        return self.solid.stress(u, self._own(state), material, pressure[: self._n], fibre)

    def deformation(self, u: Array) -> Array:
        return self.solid.deformation(u)

    def prestress(self, S: Array) -> tuple[Array, Array]:
        forces, own = self.solid.prestress(S)
        values = np.zeros(self.indices.size)
        values[self._places] = own
        return forces, values

    def matrix(self, values: Array) -> sp.csr_matrix:
        return sp.csr_matrix((values, self.indices, self.indptr), shape=(self.n_dofs,) * 2, copy=False)

    def _own(self, state: BodyState) -> BodyState:
        """The state of the elements alone."""
        return BodyState(state.I, state.theta[: self._n], state.valid)

    def _with_links(self, forces: Array, u: Array, pressure: Array) -> Array:
        """Forces (n,) with those of the interfaces' pressures."""
        slopes = self.facets.slopes(u)
        links = slopes * pressure[self._n :, 0, None, None]
        return forces + np.bincount(self._linked.ravel(), links.ravel(), forces.size)


def with_slides(body: Uncut, sample: Sample, reach: float | None = None, follows: str = "") -> Uncut | Sliding:
    """A body with the interfaces at which the sample's layers slide; itself where none do. Points lie on what they have slid on, as
    far as `reach`, mm; without it on what they lay on at rest. Raises MeshError for linear elements, which are held together at one
    point of each facet."""
    if not sample.slides:
        return body
    if body.element != "q2p1":
        raise MeshError(f'solver.element = "{body.element}": layers with interface = "sliding" take "q2p1" only; leave the key out')
    ends = [sample.thickness, *(sample.thickness - depth for depth in sample.interfaces), 0.0]
    thinner = [min(ends[n - 1] - ends[n], ends[n] - ends[n + 1]) for n in (ends.index(height) for height in sample.slides)]
    return Sliding(body, Facets.of(body, sample.slides, thinner, reach, follows))


def _as_cells(nodes: Ints, n: int) -> Ints:
    """Nodes (m, k) of links as those of elements with n nodes: the first one is repeated."""
    cells = np.repeat(nodes[:, :1], n, axis=1)
    cells[:, : nodes.shape[1]] = nodes
    return cells


def _blocks(indptr: Ints, indices: Ints, k: int) -> Array:
    """The numbers row * n + column of the k x k blocks of a CSR pattern with n rows of blocks, in rising order."""
    rows = np.repeat(np.arange(indptr.size - 1), np.diff(indptr))
    first = (rows % k == 0) & (indices % k == 0)
    return (rows[first] // k).astype(np.int64) * (indptr.size // k) + indices[first] // k


def _rows(bulk: Bulk, n: int) -> Bulk:
    """A modulus of the first n elements."""
    return bulk if isinstance(bulk, float | int) else np.ascontiguousarray(bulk[:n])


def _places(indptr: Ints, indices: Ints, wider: Ints, wider_indices: Ints) -> Ints:
    """Places of a pattern's values among those of a wider one; both are sorted."""
    n = indptr.size - 1
    keys = np.repeat(np.arange(n, dtype=np.int64), np.diff(wider)) * n + wider_indices
    return np.searchsorted(keys, np.repeat(np.arange(n, dtype=np.int64), np.diff(indptr)) * n + indices)
