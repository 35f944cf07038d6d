"""The solid: residual and tangent of a nearly incompressible hyperelastic body in one compiled loop.

The energy of an element is  sum_q w psi(I1, I2, I4, I5) + kappa/2 ∫ (ΠJ - 1)^2,  psi of the isochoric invariants (also I6, I7
and I8, in loops of their own, of a law with two families of fibres) and ΠJ the
projection of J on the element's pressure modes: its mean for the eight-node brick (mean dilatation, Q1-P0, what Abaqus
calls C3D8H), its linear part for the 27-node brick (Q2-P1). The projection is condensed, the pressure stays an unknown of the
Newton iteration: it enters the tangent as iterated, not as kappa (ΠJ - 1), which is what makes the iteration short at
kappa/mu = 1000 (Simo, Taylor and Pister 1985; the same weak form in plain scikit-fem forms: `forms.py`).

The loop is written on scikit-fem's bases and dof maps, with an element's nodes padded to full registers. At 38,760 bricks a tangent
takes 0.12 s on one thread and 0.07 s on two, as form decorators 18 s (tests/benchmarks/forward.py).
"""

import functools
from collections.abc import Callable, Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import scipy.sparse as sp
from skfem import Basis, ElementHex1, ElementHex2, ElementVector
from skfem.element import BOUNDARY_ELEMENT_MAP
from skfem.mapping import MappingIsoparametric

from indentfit.arrays import Array, Ints
from indentfit.compiled import THREADS, compiled, on_stack, on_threads
from indentfit.fem.body import BodyState, Bulk, Volumetric, per_element, volumetric
from indentfit.fem.symmetry import PARTS, Part
from indentfit.fibre_map import FibreMap
from indentfit.fibres import Fibre
from indentfit.material import Material, checked_derivatives

ELEMENTS = {
    "q1p0": (ElementHex1, 2, 1),
    "q2p1": (ElementHex2, 4, 4),
}  # scikit-fem element, quadrature order, pressure modes
NORMALS = {"x0": "u^1", "z0": "u^3"}  # component of the displacements that is normal to a plane of symmetry
SAME_END = 1e-9  # relative difference of the places of a sample's end, by round-off
LANES = 8  # doubles in the widest registers: the nodes of an element are padded to a multiple with shape functions that are zero
INVARIANTS_OF = {1: 4, 2: 7}  # numbers of invariants by the number of families of fibres
MAPS = 8  # of fibres whose directions at the integration points are kept
FEW = 3 * 64  # coordinates of places of the reference element at which values of shape functions are kept
RANGES = 16  # of elements, that are looped over one by one or, where they share no node, at once
WORTH_THREADS = 200_000  # integration points times nodes of an element from which a second thread pays
XX, YY, ZZ, XY, YZ, XZ = range(6)  # order of stress components everywhere
_FAST = {"error_model": "numpy", "fastmath": {"contract", "reassoc", "nsz", "arcp"}}
_kernel, _inlined = compiled(**_FAST), compiled(inline="always", **_FAST)


@functools.lru_cache(maxsize=4096)
def _at(kind: type, shape: tuple[int, ...], places: bytes, i: int) -> tuple[Array, Array]:
    """The shape function i of a kind of element and its slopes, at places of the reference element that are given as bytes."""
    values: tuple[Array, Array] = kind().lbasis(np.frombuffer(places).reshape(shape), i)
    return values


def _remembering(kind: type) -> Any:
    """scikit-fem's element, whose shape functions are evaluated once at the same places.

    A mapping asks for each of them at the same few places for every entry of the Jacobian, which took a third of the time that the
    set-up of a model took. Processes that are forked share the values.
    """
    element, own = kind(), kind()
    element.lbasis = lambda X, i: _at(kind, X.shape, X.astype(float).tobytes(), i) if X.size <= FEW else own.lbasis(X, i)
    return element


class Solid:
    """A meshed sample, its scikit-fem basis and the sparsity pattern of its tangent; no material, no load.

    basis: scikit-fem vector basis with displacement dofs (n,), mm
    nodes: numbers (n_el, n_n) of the elements' nodes; signs: 1 for each of their dofs (see fem.tied)
    indptr, indices: CSR pattern of the tangent (n, n), sorted, its diagonal present
    """

    def __init__(self, mesh: Any, element: str = "q1p0", part: Part = PARTS["quarter"]) -> None:
        kind, order, n_modes = ELEMENTS[element]
        self.element, self.mesh, self.part, self.copies = element, mesh, part, part.copies
        shape = _remembering(kind)
        mapping = MappingIsoparametric(mesh, _remembering(mesh.elem), BOUNDARY_ELEMENT_MAP[mesh.elem]())
        self.basis = Basis(mesh, ElementVector(shape), mapping, intorder=order)
        scalar = self.basis.with_element(shape)
        self.dofs = np.ascontiguousarray(self.basis.element_dofs.T.reshape(mesh.nelements, -1, 3).astype(np.int32))
        grads = np.array([scalar.basis[i][0].grad for i in range(scalar.Nbfun)])  # (n_n, 3, n_el, n_q)
        self.grads = np.zeros((mesh.nelements, grads.shape[3], 3, -(-scalar.Nbfun // LANES) * LANES))
        self.grads[..., : scalar.Nbfun] = grads.transpose(2, 3, 1, 0)
        self._loops = functools.partial(_kernels, scalar.Nbfun, n_modes)
        self.weights = np.ascontiguousarray(self.basis.dx)
        self.volume = self.weights.sum(axis=1)
        self.modes = pressure_modes(np.asarray(self.basis.global_coordinates()), self.weights, n_modes)
        self.means = np.einsum("emq,eq->em", self.modes, self.weights)  # modes of the constant 1
        self.nodes, self.signs = self.dofs[:, :, 0] // 3, np.ones(self.dofs.shape)
        self.indptr, self.indices, self.positions = sparsity(self.nodes, self.basis.N // 3, 3)
        self._mapped: dict[FibreMap, Array] = {}
        self._threads = THREADS if self.grads.size // 3 > WORTH_THREADS else 1
        groups = _independent(self.nodes, self.basis.N // 3)
        self._groups = groups if self._threads > 1 else [[np.concatenate([elements for group in groups for elements in group])]]

    def held(self, base: str, motions: frozenset[str] = frozenset(), ends: bool = False) -> Ints:
        """Dofs held at zero: normal motion on the planes of symmetry, the base's normal motion or all of it, one dof for each
        rigid motion that is held (fem.symmetry), and with `ends` the motion along x of the sample's ends."""
        held = [self.basis.get_dofs(plane).all([NORMALS[plane]]) for plane in self.part.planes]
        held.append(self.basis.get_dofs("base").all(["u^2"] if base == "sliding" else None))
        if ends:
            x = np.abs(self.points()[0])
            held.append(3 * np.flatnonzero(x > x.max() * (1 - SAME_END)))
        return np.concatenate([*held, self._holding(motions)]) if motions else np.concatenate(held)

    def _holding(self, motions: frozenset[str]) -> Ints:
        """Dofs that hold rigid motions: of the point of the top on the axis, and for the turn of the top's last point along x."""
        x, y, z = self.points()
        beside = np.abs(z) + (y.max() - y)  # the distance from the top's line along x
        middle, end = int(np.argmin(beside + np.abs(x))), int(np.argmin(beside - x))
        dofs = {"x": 3 * middle, "z": 3 * middle + 2, "turn": 3 * end + 2}
        return np.array([dofs[motion] for motion in sorted(motions)], dtype=int)

    def points(self) -> Array:
        """Points (3, n_v) of the nodes, mm."""
        return self.basis.doflocs[:, ::3]

    def unfolded(self, u: Array) -> "tuple[Solid, Array]":
        """The body of all nodes, and its displacements: this one and u (n,)."""
        return self, u

    def corners(self, u: Array) -> tuple[Array, Array]:
        """Points (3, n) of the elements' corners, and their displacements (3, n), mm."""
        dofs = self.basis.nodal_dofs
        return self.basis.doflocs[:, dofs[0]], u[dofs]

    @property
    def n_dofs(self) -> int:
        return self.basis.N

    def _loop(self, fibre: Fibre) -> tuple[SimpleNamespace, Array]:
        """The loops for the directions of one family of fibres (3,), of two (2, 3) or of a map, and these directions: a family, a
        point, a component. Where they are the same everywhere, they stand at one point."""
        fibres = self.directions(fibre)
        return self._loops(INVARIANTS_OF[len(fibres)]), fibres

    def directions(self, fibre: Fibre) -> Array:
        """Directions (k, 1, 3) of the fibres' k families; of a map those at the integration points, (1, n_el * n_q, 3)."""
        if not isinstance(fibre, FibreMap):
            return np.ascontiguousarray(np.atleast_2d(fibre)[:, None])
        if fibre not in self._mapped:
            if len(self._mapped) >= MAPS:
                self._mapped.clear()
            points = np.asarray(self.basis.global_coordinates()).reshape(3, -1)
            self._mapped[fibre] = np.ascontiguousarray(fibre.at(points).T[None])
        return self._mapped[fibre]

    def state(self, u: Array, fibre: Fibre) -> BodyState:
        """Invariants and dilatation at displacements u (n,) with the fibre direction (3,), or those of two families (2, 3)."""
        loop, fibres = self._loop(fibre)
        I, theta = np.empty((INVARIANTS_OF[len(fibres)], self.weights.size)), np.zeros(self.means.shape)
        smallest = self._run(loop.kinematics, u, self.dofs, self.grads, self.weights, self.modes, fibres, I, theta)
        return BodyState(I, theta, bool(min(smallest) > 0))

    def pressure(self, state: BodyState, kappa: Bulk | Volumetric) -> Array:
        """Pressure modes (n_el, n_m) that belong to a state, tension positive"""
        return volumetric(kappa).pressure(state.theta, self.means)

    def residual(self, u: Array, state: BodyState, material: Material, pressure: Array, fibre: Fibre) -> Array:
        """Internal forces (n,), mN, at given pressure modes."""
        return self.forces(u, checked_derivatives(material, "gradient", state.I), pressure, fibre)

    def forces(self, u: Array, gradient: Array, pressure: Array, fibre: Fibre) -> Array:
        """Internal forces (n,), mN, of an energy's derivatives (4, n_el * n_q) by the invariants and of pressure modes: linear in
        both."""
        loop, fibres = self._loop(fibre)
        out, d1 = np.zeros(self.n_dofs), np.ascontiguousarray(gradient)
        self._run(loop.residual, u, self.dofs, self.grads, self.weights, self.modes, fibres, pressure, d1, out)
        return out

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
        """Internal forces (n,) at the pressure modes that follow from u, and CSR data (nnz,) of the consistent tangent.

        pressure (n_el, n_m) is the iterated one, for the geometric part of the tangent; bulk: bulk modulus of the tangent, where it
        shall not be kappa (fem.linear).
        """
        out, values = np.zeros(self.n_dofs), np.zeros(self.indices.size)
        d1, d2 = checked_derivatives(material, "gradient", state.I), checked_derivatives(material, "hessian", state.I)
        target, (loop, fibres) = self.pressure(state, kappa), self._loop(fibre)
        self._run(
            loop.tangent, u, self.dofs, self.grads, self.weights, self.modes, fibres, pressure, target,
            per_element(volumetric(kappa).kappa if bulk is None else bulk, len(self.dofs)),
            d1, d2, self.indptr, self.positions, out, values,
        )  # fmt: skip
        return out, values

    def dilatation_map(self, u: Array) -> Array:
        """Derivative of the pressure modes of J by the element's displacements, (n_el, n_m, n_n, 3)."""
        B = np.empty((*self.means.shape, *self.dofs.shape[1:]))
        self._run(self._loops(INVARIANTS_OF[1]).dilatation_map, u, self.dofs, self.grads, self.weights, self.modes, B)
        return B

    def stress(self, u: Array, state: BodyState, material: Material, pressure: Array, fibre: Fibre) -> Array:
        """Cauchy stresses at the integration points, (6, n_el, n_q), kPa, in the order xx yy zz xy yz xz."""
        d1 = checked_derivatives(material, "gradient", state.I)
        stress, (loop, fibres) = np.empty((6, *self.weights.shape)), self._loop(fibre)
        self._run(loop.cauchy, u, self.dofs, self.grads, self.modes, fibres, pressure, d1, stress)
        return stress

    def deformation(self, u: Array) -> Array:
        """F at the integration points, (n_el, n_q, 3, 3)."""
        return np.eye(3) + (self.grads[..., : self.dofs.shape[1]] @ u[self.dofs][:, None]).swapaxes(2, 3)

    def prestress(self, S: Array) -> tuple[Array, Array]:
        """Internal forces (n,), mN, of second Piola-Kirchhoff stresses S (n_el, n_q, 3, 3) at rest, and CSR values (nnz,) of their
        derivative, which is constant."""
        grads = self.grads[..., : self.dofs.shape[1]]
        pull = (self.weights[..., None, None] * S) @ grads
        K = rows(pull).swapaxes(1, 2) @ rows(grads)
        return scattered(self, pull.sum(axis=1).swapaxes(1, 2), [K, K, K])

    def matrix(self, values: Array) -> sp.csr_matrix:
        """The tangent as a scipy CSR matrix that shares the cached pattern."""
        return sp.csr_matrix((values, self.indices, self.indptr), shape=(self.n_dofs,) * 2, copy=False)

    def _run(self, kernel: Callable[..., Any], *arguments: Any) -> list[Any]:
        """What a kernel(elements, *arguments) returns of each range of elements. Those of a group run at once: they share no node,
        so that sums are the same, bit by bit, on any number of threads; on one thread a single call takes them in that order."""
        results: list[Any] = []
        for group in self._groups:
            results += on_threads(self._threads, lambda elements: kernel(elements, *arguments), group)
        return results


def pressure_modes(points: Array, weights: Array, n_modes: int) -> Array:
    """Pressure modes (n_el, n_m, n_q), orthonormal on each element: constant, then linear in the coordinates."""
    modes = [np.ones_like(weights)]
    if n_modes > 1:
        centre = np.einsum("ieq,eq->ie", points, weights) / weights.sum(axis=1)
        modes += list(points - centre[:, :, None])
    done: list[Array] = []
    for mode in modes:
        for other in done:
            mode = mode - (mode * other * weights).sum(axis=1)[:, None] * other
        done.append(mode / np.sqrt((mode**2 * weights).sum(axis=1))[:, None])
    return np.ascontiguousarray(np.array(done).transpose(1, 0, 2))


def sparsity(nodes: Ints, n_nodes: int, k: int) -> tuple[Ints, Ints, Ints]:
    """CSR pattern of k x k blocks, k displacements at a node, and for each pair of an element's nodes the place of its block in the
    row of blocks."""
    n_el, n = nodes.shape
    rows = np.repeat(nodes, n, axis=1).ravel()
    cols = np.tile(nodes, (1, n)).ravel()
    blocks = sp.coo_matrix((np.ones(rows.size, dtype=np.int8), (rows, cols)), shape=(n_nodes, n_nodes)).tocsr()
    blocks.sort_indices()
    lengths = np.diff(blocks.indptr)
    starts = np.concatenate([[0], np.cumsum(np.repeat(lengths * k, k))])
    expanded = (k * blocks.indices[:, None] + np.arange(k)).astype(np.int32)
    indices = np.concatenate(
        [expanded[a:b].ravel() for a, b in zip(np.repeat(blocks.indptr[:-1], k), np.repeat(blocks.indptr[1:], k), strict=True)]
    )
    keys = np.repeat(np.arange(n_nodes, dtype=np.int64), lengths) * n_nodes + blocks.indices
    places = np.searchsorted(keys, rows.astype(np.int64) * n_nodes + cols) - blocks.indptr[rows]
    return starts.astype(np.int32), indices, places.reshape(n_el, n, n).astype(np.int32)


def rows(values: Array) -> Array:
    """The integration points and components of values (n_el, n_q, k, n) as rows, (n_el, n_q * k, n)."""
    return values.reshape(len(values), -1, values.shape[-1])


def scattered(body: Any, forces: Array, stiffness: Sequence[Array]) -> tuple[Array, Array]:
    """Forces (n,) and CSR values (nnz,) of a body from those of its elements: forces (n_el, n_n, k), and for each of the k
    displacements of a node a stiffness (n_el, n_n, n_n) that acts on this displacement alone."""
    out, values = np.zeros(body.n_dofs), np.zeros(body.indices.size)
    out += np.bincount(body.dofs.ravel(), forces.ravel(), body.n_dofs)
    for i, K in enumerate(stiffness):
        at = body.indptr[body.dofs[:, :, i]][:, :, None] + len(stiffness) * body.positions + i
        values += np.bincount(at.ravel(), K.ravel(), values.size)
    return out, values


def _independent(nodes: Ints, n_nodes: int) -> list[list[Ints]]:
    """Groups of ranges of elements: those of a group have no node in common."""
    taken = np.zeros(n_nodes, dtype=np.int64)
    groups: list[list[Ints]] = []
    for elements in np.array_split(np.arange(len(nodes)), RANGES):
        here = nodes[elements].ravel()
        used = np.bitwise_or.reduce(taken[here], initial=0)
        group = next(n for n in range(RANGES) if not used >> n & 1)
        taken[here] |= 1 << group
        groups += [[]] if group == len(groups) else []
        groups[group].append(elements)
    return groups


# ---- the compiled loop -------------------------------------------------------------------------------------------


@_inlined
def _gather(u: Any, dofs: Any, ue: Any) -> None:
    """Displacements ue (3, n_p) of one element's nodes, zero beyond them."""
    for n in range(dofs.shape[0]):
        for i in range(3):
            ue[i, n] = u[dofs[n, i]]


@_inlined
def _gradient(ue: Any, grads: Any, F: Any) -> Any:
    """F = 1 + grad u of one integration point; returns J. ue, grads (3, n_p)."""
    for i in range(3):
        x, y, z = 0.0, 0.0, 0.0
        for n in range(grads.shape[1]):
            x += ue[i, n] * grads[0, n]
            y += ue[i, n] * grads[1, n]
            z += ue[i, n] * grads[2, n]
        F[i, 0], F[i, 1], F[i, 2] = x, y, z
        F[i, i] += 1.0
    return (
        F[0, 0] * (F[1, 1] * F[2, 2] - F[1, 2] * F[2, 1])
        - F[0, 1] * (F[1, 0] * F[2, 2] - F[1, 2] * F[2, 0])
        + F[0, 2] * (F[1, 0] * F[2, 1] - F[1, 1] * F[2, 0])
    )


@_inlined
def _inverse(F: Any, J: Any, G: Any) -> None:
    """G = inverse of F with determinant J."""
    for i in range(3):
        for k in range(3):
            a, b, c, d = (k + 1) % 3, (k + 2) % 3, (i + 1) % 3, (i + 2) % 3
            G[i, k] = (F[a, c] * F[b, d] - F[a, d] * F[b, c]) / J


@_inlined
def _strain(F: Any, J: Any, fibre: Any, b: Any, a: Any, c: Any) -> None:
    """Isochoric left Cauchy-Green tensor b, current fibre a and c = b a."""
    s = J ** (-1.0 / 3.0)
    for i in range(3):
        a[i] = s * (F[i, 0] * fibre[0] + F[i, 1] * fibre[1] + F[i, 2] * fibre[2])
        for k in range(3):
            b[i, k] = s * s * (F[i, 0] * F[k, 0] + F[i, 1] * F[k, 1] + F[i, 2] * F[k, 2])
    for i in range(3):
        c[i] = b[i, 0] * a[0] + b[i, 1] * a[1] + b[i, 2] * a[2]


_PAIRS = np.array([[0, 0], [1, 1], [2, 2], [0, 1], [1, 2], [0, 2]])
_VOIGT = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2]])


@_inlined
def _directions(b: Any, a: Any, c: Any, I1: Any, m: Any) -> None:
    """Rows of m (4, 6): the push-forward of dI/dCb for I1, I2, I4, I5."""
    for s in range(6):
        i, k = _PAIRS[s, 0], _PAIRS[s, 1]
        m[0, s] = b[i, k]
        m[1, s] = I1 * b[i, k] - (b[i, 0] * b[0, k] + b[i, 1] * b[1, k] + b[i, 2] * b[2, k])
        m[2, s] = a[i] * a[k]
        m[3, s] = a[i] * c[k] + c[i] * a[k]


@_inlined
def _second_family(F: Any, J: Any, fibre: Any, b: Any, a2: Any, c2: Any) -> None:
    """The second family's current fibre a2 and c2 = b a2."""
    s = J ** (-1.0 / 3.0)
    for i in range(3):
        a2[i] = s * (F[i, 0] * fibre[0] + F[i, 1] * fibre[1] + F[i, 2] * fibre[2])
    for i in range(3):
        c2[i] = b[i, 0] * a2[0] + b[i, 1] * a2[1] + b[i, 2] * a2[2]


@_inlined
def _directions_of_two(a: Any, a2: Any, c2: Any, m: Any) -> None:
    """Rows 4 to 6 of m (7, 6): the push-forward of dI/dCb for I6, I7, I8."""
    for s in range(6):
        i, k = _PAIRS[s, 0], _PAIRS[s, 1]
        m[4, s] = a2[i] * a2[k]
        m[5, s] = a2[i] * c2[k] + c2[i] * a2[k]
        m[6, s] = 0.5 * (a[i] * a2[k] + a2[i] * a[k])


@_inlined
def _kirchhoff_of_two(m: Any, d1: Any, p: Any, tau: Any) -> Any:
    """As `_kirchhoff`, of seven invariants."""
    for s in range(6):
        tau[s] = 0.0
        for x in range(7):
            tau[s] += 2.0 * d1[x, p] * m[x, s]
    trace = tau[0] + tau[1] + tau[2]
    for s in range(3):
        tau[s] -= trace / 3.0
    return trace


@_inlined
def _kirchhoff(m: Any, d1: Any, p: Any, tau: Any) -> Any:
    """Fictitious stress 2 sum psi_a m_a in tau, made deviatoric; returns its trace."""
    for s in range(6):
        tau[s] = 2.0 * (d1[0, p] * m[0, s] + d1[1, p] * m[1, s] + d1[2, p] * m[2, s] + d1[3, p] * m[3, s])
    trace = tau[0] + tau[1] + tau[2]
    for s in range(3):
        tau[s] -= trace / 3.0
    return trace


@_inlined
def _at_point(modes: Any, q: Any, values: Any) -> Any:
    """Sum of an element's modes (n_m, n_q) times values (n_m,) at one integration point."""
    p = 0.0
    for k in range(modes.shape[0]):
        p += modes[k, q] * values[k]
    return p


@_inlined
def _add_force(g: Any, t: Any, w: Any, n_p: Any, fe: Any) -> None:
    """Adds w t . grad N to the forces fe (3, n_p) of one element; g (3, n_p) spatial gradients."""
    for i in range(3):
        x, y, z = w * t[_VOIGT[i, 0]], w * t[_VOIGT[i, 1]], w * t[_VOIGT[i, 2]]
        for n in range(n_p):
            fe[i, n] += x * g[0, n] + y * g[1, n] + z * g[2, n]


@_inlined
def _scatter_force(dofs: Any, fe: Any, out: Any) -> None:
    for n in range(dofs.shape[0]):
        for i in range(3):
            out[dofs[n, i]] += fe[i, n]


@_inlined
def _spatial(grads: Any, G: Any, g: Any) -> None:
    """Spatial gradients g = F^-T grads, (3, n_p)."""
    for i in range(3):
        for n in range(grads.shape[1]):
            g[i, n] = grads[0, n] * G[0, i] + grads[1, n] * G[1, i] + grads[2, n] * G[2, i]


@_inlined
def _moduli(b: Any, a: Any, c: Any, m: Any, d1: Any, d2: Any, p: Any, tau: Any, trace: Any, h: Any, D: Any) -> None:
    """Isochoric spatial tangent D (6, 6) of the Kirchhoff stress tau (deviatoric) whose fictitious stress has that trace; h (4, 6)
    is scratch."""
    for x in range(4):
        for s in range(6):
            h[x, s] = d2[x, 0, p] * m[0, s] + d2[x, 1, p] * m[1, s] + d2[x, 2, p] * m[2, s] + d2[x, 3, p] * m[3, s]
    for s in range(6):
        for t in range(s + 1):
            v = h[0, s] * m[0, t] + h[1, s] * m[1, t] + h[2, s] * m[2, t] + h[3, s] * m[3, t]
            i, k, j, l = _PAIRS[s, 0], _PAIRS[s, 1], _PAIRS[t, 0], _PAIRS[t, 1]
            if d1[1, p] != 0.0:
                v += d1[1, p] * (b[i, k] * b[j, l] - 0.5 * (b[i, j] * b[k, l] + b[i, l] * b[k, j]))
            if d1[3, p] != 0.0:
                v += (
                    d1[3, p] * 0.5 * (a[i] * b[k, j] * a[l] + a[i] * b[k, l] * a[j] + a[k] * b[i, j] * a[l] + a[k] * b[i, l] * a[j])
                )
            D[s, t] = 4.0 * v
            D[t, s] = 4.0 * v
    _projected(tau, trace, D)


@_inlined
def _moduli_of_two(b: Any, a: Any, a2: Any, m: Any, d1: Any, d2: Any, p: Any, tau: Any, trace: Any, h: Any, D: Any) -> None:
    """As `_moduli`, of seven invariants; h (7, 6) is scratch."""
    for x in range(7):
        for s in range(6):
            h[x, s] = 0.0
            for y in range(7):
                h[x, s] += d2[x, y, p] * m[y, s]
    for s in range(6):
        for t in range(s + 1):
            v = 0.0
            for x in range(7):
                v += h[x, s] * m[x, t]
            i, k, j, l = _PAIRS[s, 0], _PAIRS[s, 1], _PAIRS[t, 0], _PAIRS[t, 1]
            v += d1[1, p] * (b[i, k] * b[j, l] - 0.5 * (b[i, j] * b[k, l] + b[i, l] * b[k, j]))
            v += d1[3, p] * 0.5 * (a[i] * b[k, j] * a[l] + a[i] * b[k, l] * a[j] + a[k] * b[i, j] * a[l] + a[k] * b[i, l] * a[j])
            v += (
                d1[5, p]
                * 0.5
                * (a2[i] * b[k, j] * a2[l] + a2[i] * b[k, l] * a2[j] + a2[k] * b[i, j] * a2[l] + a2[k] * b[i, l] * a2[j])
            )
            D[s, t] = 4.0 * v
            D[t, s] = 4.0 * v
    _projected(tau, trace, D)


@_inlined
def _projected(tau: Any, trace: Any, D: Any) -> None:
    """Makes D (6, 6), of the fictitious stress, the tangent of the deviatoric one."""
    for s in range(6):  # deviatoric projection from both sides
        v = (D[0, s] + D[1, s] + D[2, s]) / 3.0
        for t in range(3):
            D[t, s] -= v
    for s in range(6):
        v = (D[s, 0] + D[s, 1] + D[s, 2]) / 3.0
        for t in range(3):
            D[s, t] -= v
    for s in range(3):
        D[s, s] += 2.0 / 3.0 * trace
        D[s + 3, s + 3] += 1.0 / 3.0 * trace
        for t in range(3):
            D[s, t] -= 2.0 / 9.0 * trace
        for t in range(6):
            D[s, t] -= 2.0 / 3.0 * tau[t]
            D[t, s] -= 2.0 / 3.0 * tau[t]


@_inlined
def _add_stiffness(g: Any, D: Any, tau: Any, w: Any, n_n: Any, n_p: Any, Dg: Any, sg: Any, K: Any) -> None:
    """Adds w (grad N_n . D . grad N_o + grad N_n . tau . grad N_o 1) to K (n_n, 3, 3, n_p), for o <= n and up to the next full
    register; Dg (6, 3, n_p) and sg (3, n_p) are scratch."""
    for i in range(3):
        for s in range(6):
            x, y, z = w * D[s, _VOIGT[i, 0]], w * D[s, _VOIGT[i, 1]], w * D[s, _VOIGT[i, 2]]
            for n in range(n_p):
                Dg[s, i, n] = x * g[0, n] + y * g[1, n] + z * g[2, n]
        x, y, z = w * tau[_VOIGT[i, 0]], w * tau[_VOIGT[i, 1]], w * tau[_VOIGT[i, 2]]
        for n in range(n_p):
            sg[i, n] = x * g[0, n] + y * g[1, n] + z * g[2, n]
    T = on_stack((3, 3, 3))
    for n in range(n_n):
        for i in range(3):
            for k in range(3):
                for j in range(3):
                    T[i, k, j] = Dg[_VOIGT[k, j], i, n]
            for j in range(3):
                T[i, i, j] += sg[j, n]
        for o in range((n // LANES + 1) * LANES):  # all nine rows at once: gradients are loaded once, a third of the time less
            x, y, z = g[0, o], g[1, o], g[2, o]
            for i in range(3):
                for k in range(3):
                    K[n, i, k, o] += T[i, k, 0] * x + T[i, k, 1] * y + T[i, k, 2] * z


@_inlined
def _add_bulk(B: Any, kappa: Any, n_n: Any, K: Any) -> None:
    """Adds kappa B B of each pressure mode, as `_add_stiffness` does; B (n_m, 3, n_p)."""
    for n in range(n_n):
        width = (n // LANES + 1) * LANES
        for i in range(3):
            for j in range(3):
                for k in range(B.shape[0]):
                    v = kappa * B[k, i, n]
                    for o in range(width):
                        K[n, i, j, o] += v * B[k, j, o]


@_inlined
def _scatter_stiffness(dofs: Any, positions: Any, indptr: Any, K: Any, values: Any) -> None:
    """Adds the lower half of one element's tangent, and its mirror image, to the CSR data."""
    for n in range(dofs.shape[0]):
        x, y, z = indptr[dofs[n, 0]], indptr[dofs[n, 1]], indptr[dofs[n, 2]]
        for o in range(n + 1):
            at = 3 * positions[n, o]
            for k in range(3):
                values[x + at + k] += K[n, 0, k, o]
                values[y + at + k] += K[n, 1, k, o]
                values[z + at + k] += K[n, 2, k, o]
        for o in range(n + 1, dofs.shape[0]):
            at = 3 * positions[n, o]
            for k in range(3):
                values[x + at + k] += K[o, k, 0, n]
                values[y + at + k] += K[o, k, 1, n]
                values[z + at + k] += K[o, k, 2, n]


@_inlined
def _add_dilatation(g: Any, modes: Any, q: Any, v: Any, n_p: Any, Be: Any) -> None:
    """Adds v mode . grad N to the derivative Be (n_m, 3, n_p) of an element's pressure modes of J."""
    for k in range(modes.shape[0]):
        for i in range(3):
            for n in range(n_p):
                Be[k, i, n] += v * modes[k, q] * g[i, n]


def loops_of(element: str) -> SimpleNamespace:
    """The loops over bricks of an element, for laws of one family of fibres."""
    kind, _, n_modes = ELEMENTS[element]
    return _kernels(len(kind.doflocs), n_modes, INVARIANTS_OF[1])


@functools.cache
def _kernels(N_N: int, N_M: int, N_I: int) -> SimpleNamespace:
    """The loops over elements of N_N nodes and N_M pressure modes for laws of N_I invariants: 4, or 7 with a second family of
    fibres. The compiler drops what belongs to the other kind of law. Their scratch is on the stack, of a size that the compiler
    knows; bounds of inner loops it must not know: it would unroll what it should do in full registers."""
    N_P = -(-N_N // LANES) * LANES

    @_kernel
    def kinematics(elements: Any, u: Any, dofs: Any, grads: Any, weights: Any, modes: Any, fibres: Any, I: Any, theta: Any) -> Any:
        n_q, many = weights.shape[1], fibres.shape[1] > 1
        F, b, a, c = on_stack((3, 3)), on_stack((3, 3)), on_stack((3,)), on_stack((3,))
        a2, c2 = on_stack((3,)), on_stack((3,))
        ue = on_stack((3, N_P))
        ue[:] = 0
        smallest = np.inf
        for e in elements:
            _gather(u, dofs[e], ue)
            for q in range(n_q):
                J = _gradient(ue, grads[e, q], F)
                if not (smallest <= J):
                    smallest = J
                _strain(F, J, fibres[0, (e * n_q + q) * many], b, a, c)
                I1 = b[0, 0] + b[1, 1] + b[2, 2]
                bb = 0.0
                for i in range(3):
                    for k in range(3):
                        bb += b[i, k] * b[i, k]
                p = e * n_q + q
                I[0, p] = I1
                I[1, p] = 0.5 * (I1 * I1 - bb)
                I[2, p] = a[0] * a[0] + a[1] * a[1] + a[2] * a[2]
                I[3, p] = a[0] * c[0] + a[1] * c[1] + a[2] * c[2]
                if N_I == 7:
                    _second_family(F, J, fibres[1, (e * n_q + q) * many], b, a2, c2)
                    I[4, p] = a2[0] * a2[0] + a2[1] * a2[1] + a2[2] * a2[2]
                    I[5, p] = a2[0] * c2[0] + a2[1] * c2[1] + a2[2] * c2[2]
                    I[6, p] = a[0] * a2[0] + a[1] * a2[1] + a[2] * a2[2]
                for m in range(N_M):
                    theta[e, m] += weights[e, q] * modes[e, m, q] * J
        return smallest

    @_kernel
    def residual(
        elements: Any, u: Any, dofs: Any, grads: Any, weights: Any, modes: Any, fibres: Any, pressure: Any, d1: Any, out: Any
    ) -> None:
        n_q, n_p, many = weights.shape[1], grads.shape[3], fibres.shape[1] > 1
        F, G, b, a, c = on_stack((3, 3)), on_stack((3, 3)), on_stack((3, 3)), on_stack((3,)), on_stack((3,))
        m, tau, a2, c2 = on_stack((N_I, 6)), on_stack((6,)), on_stack((3,)), on_stack((3,))
        ue, g, fe = on_stack((3, N_P)), on_stack((3, N_P)), on_stack((3, N_P))
        ue[:] = 0
        for e in elements:
            _gather(u, dofs[e], ue)
            fe[:] = 0.0
            for q in range(n_q):
                J = _gradient(ue, grads[e, q], F)
                _inverse(F, J, G)
                _strain(F, J, fibres[0, (e * n_q + q) * many], b, a, c)
                _directions(b, a, c, b[0, 0] + b[1, 1] + b[2, 2], m)
                if N_I == 7:
                    _second_family(F, J, fibres[1, (e * n_q + q) * many], b, a2, c2)
                    _directions_of_two(a, a2, c2, m)
                    _kirchhoff_of_two(m, d1, e * n_q + q, tau)
                else:
                    _kirchhoff(m, d1, e * n_q + q, tau)
                p = _at_point(modes[e], q, pressure[e])
                for s in range(3):
                    tau[s] += J * p
                _spatial(grads[e, q], G, g)
                _add_force(g, tau, weights[e, q], n_p, fe)
            _scatter_force(dofs[e], fe, out)

    @_kernel
    def tangent(
        elements: Any, u: Any, dofs: Any, grads: Any, weights: Any, modes: Any, fibres: Any, pressure: Any, target: Any, kappa: Any,
        d1: Any, d2: Any, indptr: Any, positions: Any, out: Any, values: Any,
    ) -> None:  # fmt: skip
        n_q, n_p, many = weights.shape[1], grads.shape[3], fibres.shape[1] > 1
        F, G, b, a, c = on_stack((3, 3)), on_stack((3, 3)), on_stack((3, 3)), on_stack((3,)), on_stack((3,))
        m, h, tau, total, D = on_stack((N_I, 6)), on_stack((N_I, 6)), on_stack((6,)), on_stack((6,)), on_stack((6, 6))
        a2, c2 = on_stack((3,)), on_stack((3,))
        ue, g, fe = on_stack((3, N_P)), on_stack((3, N_P)), on_stack((3, N_P))
        Dg, sg = on_stack((6, 3, N_P)), on_stack((3, N_P))
        K, B = on_stack((N_N, 3, 3, N_P)), on_stack((N_M, 3, N_P))
        ue[:] = 0
        for e in elements:
            _gather(u, dofs[e], ue)
            K[:] = 0.0
            B[:] = 0.0
            fe[:] = 0.0
            for q in range(n_q):
                w = weights[e, q]
                J = _gradient(ue, grads[e, q], F)
                _inverse(F, J, G)
                _strain(F, J, fibres[0, (e * n_q + q) * many], b, a, c)
                _directions(b, a, c, b[0, 0] + b[1, 1] + b[2, 2], m)
                if N_I == 7:
                    _second_family(F, J, fibres[1, (e * n_q + q) * many], b, a2, c2)
                    _directions_of_two(a, a2, c2, m)
                    trace = _kirchhoff_of_two(m, d1, e * n_q + q, tau)
                    _moduli_of_two(b, a, a2, m, d1, d2, e * n_q + q, tau, trace, h, D)
                else:
                    trace = _kirchhoff(m, d1, e * n_q + q, tau)
                    _moduli(b, a, c, m, d1, d2, e * n_q + q, tau, trace, h, D)
                p, aim = _at_point(modes[e], q, pressure[e]), _at_point(modes[e], q, target[e])
                for s in range(6):
                    total[s] = tau[s] + (J * aim if s < 3 else 0.0)
                _spatial(grads[e, q], G, g)
                _add_force(g, total, w, n_p, fe)
                for s in range(3):  # J p (1x1 - 2 I) of the iterated pressure
                    tau[s] += J * p
                    D[s + 3, s + 3] -= J * p
                    for t in range(3):
                        D[s, t] += J * p if s != t else -J * p
                _add_dilatation(g, modes[e], q, w * J, n_p, B)
                _add_stiffness(g, D, tau, w, N_N, n_p, Dg, sg, K)
            _add_bulk(B, kappa[e], N_N, K)
            _scatter_force(dofs[e], fe, out)
            _scatter_stiffness(dofs[e], positions[e], indptr, K, values)

    @_kernel
    def dilatation_map(elements: Any, u: Any, dofs: Any, grads: Any, weights: Any, modes: Any, B: Any) -> None:
        n_q, n_p = weights.shape[1], grads.shape[3]
        F, G, ue, g, Be = on_stack((3, 3)), on_stack((3, 3)), on_stack((3, N_P)), on_stack((3, N_P)), on_stack((N_M, 3, N_P))
        ue[:] = 0
        for e in elements:
            _gather(u, dofs[e], ue)
            Be[:] = 0.0
            for q in range(n_q):
                J = _gradient(ue, grads[e, q], F)
                _inverse(F, J, G)
                _spatial(grads[e, q], G, g)
                _add_dilatation(g, modes[e], q, weights[e, q] * J, n_p, Be)
            for k in range(N_M):
                for n in range(N_N):
                    for i in range(3):
                        B[e, k, n, i] = Be[k, i, n]

    @_kernel
    def cauchy(elements: Any, u: Any, dofs: Any, grads: Any, modes: Any, fibres: Any, pressure: Any, d1: Any, stress: Any) -> None:
        n_q, many = grads.shape[1], fibres.shape[1] > 1
        F, b, a, c = on_stack((3, 3)), on_stack((3, 3)), on_stack((3,)), on_stack((3,))
        m, tau, ue, a2, c2 = on_stack((N_I, 6)), on_stack((6,)), on_stack((3, N_P)), on_stack((3,)), on_stack((3,))
        ue[:] = 0
        for e in elements:
            _gather(u, dofs[e], ue)
            for q in range(n_q):
                J = _gradient(ue, grads[e, q], F)
                _strain(F, J, fibres[0, (e * n_q + q) * many], b, a, c)
                _directions(b, a, c, b[0, 0] + b[1, 1] + b[2, 2], m)
                if N_I == 7:
                    _second_family(F, J, fibres[1, (e * n_q + q) * many], b, a2, c2)
                    _directions_of_two(a, a2, c2, m)
                    _kirchhoff_of_two(m, d1, e * n_q + q, tau)
                else:
                    _kirchhoff(m, d1, e * n_q + q, tau)
                p = _at_point(modes[e], q, pressure[e])
                for s in range(6):
                    stress[s, e, q] = tau[s] / J + (p if s < 3 else 0.0)

    return SimpleNamespace(kinematics=kinematics, residual=residual, tangent=tangent, dilatation_map=dilatation_map, cauchy=cauchy)
