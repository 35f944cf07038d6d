"""The solid in a meridian plane: residual and tangent of an axisymmetric body, whole, from nine-node quadrilaterals.

The same energies and the same condensed pressures as `element`: Q2-P1, the pressure linear in the plane and discontinuous between
elements. x is the radius r, y the axis. With radial and axial displacements u_r, u_y the deformation gradient is

    F = [[1 + du_r/dr, du_r/dy, 0], [du_y/dr, 1 + du_y/dy, 0], [0, 0, 1 + u_r/r]],

and every integral is over the ring that a point of the plane stands for, 2 pi r times the area. The law may have no fibres, or
fibres along the axis: any other direction would break the symmetry.
"""

from types import SimpleNamespace
from typing import Any

import numpy as np
import scipy.sparse as sp
from skfem import Basis, ElementQuad2, ElementVector, MeshQuad

from indentfit.arrays import Array, Ints
from indentfit.compiled import compiled, on_stack
from indentfit.fem.body import BodyState, Bulk, Volumetric, per_element, volumetric
from indentfit.fem.element import (
    _at_point,
    _directions,
    _inverse,
    _kirchhoff,
    _moduli,
    _strain,
    pressure_modes,
    rows,
    scattered,
    sparsity,
)
from indentfit.fibres import Fibre
from indentfit.material import Material, checked_derivatives

N_N, N_M, N_D = 9, 3, 18  # nodes, pressure modes and displacements of an element
ORDER = 5  # of the quadrature: the weights hold a factor r
_FAST = {"error_model": "numpy", "fastmath": {"contract", "reassoc", "nsz", "arcp"}}
_kernel, _inlined = compiled(**_FAST), compiled(inline="always", **_FAST)


class Meridian:
    """A meshed meridian plane of a whole round sample: a Body with two displacements at each node.

    Parameters
    ----------
    mesh : MeshQuad
        Of the plane r >= 0; its points are (r, y), mm.
    """

    element, copies = "q2p1", 1

    def __init__(self, mesh: MeshQuad) -> None:
        self.mesh = mesh
        self.basis = Basis(mesh, ElementVector(ElementQuad2()), intorder=ORDER)
        scalar = self.basis.with_element(ElementQuad2())
        self.dofs = np.ascontiguousarray(self.basis.element_dofs.T.reshape(mesh.nelements, N_N, 2).astype(np.int32))
        points = np.asarray(self.basis.global_coordinates())
        radius = points[0]
        self.grads = _gradients(scalar, radius)
        self.weights = np.ascontiguousarray(self.basis.dx * 2 * np.pi * radius)
        self.volume = self.weights.sum(axis=1)
        self.modes = pressure_modes(points, self.weights, N_M)
        self.means = np.einsum("emq,eq->em", self.modes, self.weights)
        self.nodes = self.dofs[:, :, 0] // 2
        self.indptr, self.indices, self.positions = sparsity(self.nodes, self.basis.N // 2, 2)

    @property
    def n_dofs(self) -> int:
        return int(self.basis.N)

    def held(self, base: str, motions: frozenset[str] = frozenset(), ends: bool = False) -> Ints:
        """Dofs held at zero: radial motion on the axis, the base's axial motion or all of it. No other rigid motion is free, and
        there are no ends."""
        on_axis = self.basis.get_dofs("axis").all(["u^1"])
        return np.concatenate([on_axis, self.basis.get_dofs("base").all(["u^2"] if base == "sliding" else None)])

    def points(self) -> Array:
        """Points (2, n_v) of the nodes, (r, y), mm."""
        return self.basis.doflocs[:, ::2]

    def unfolded(self, u: Array) -> "tuple[Meridian, Array]":
        """This body and u (n,)."""
        return self, u

    def corners(self, u: Array) -> tuple[Array, Array]:
        """Points (3, n) of the elements' corners in the plane z = 0, and their displacements (3, n), mm."""
        dofs = self.basis.nodal_dofs
        nothing = np.zeros((1, dofs.shape[1]))
        return np.concatenate([self.basis.doflocs[:, dofs[0]], nothing]), np.concatenate([u[dofs], nothing])

    def state(self, u: Array, fibre: Fibre) -> BodyState:
        I, theta = np.empty((4, self.weights.size)), np.zeros(self.means.shape)
        smallest = LOOPS.kinematics(u, self.dofs, self.grads, self.weights, self.modes, fibre, I, theta)
        return BodyState(I, theta, bool(smallest > 0))

    def pressure(self, state: BodyState, kappa: Bulk | Volumetric) -> Array:
        return volumetric(kappa).pressure(state.theta, self.means)

    def residual(self, u: Array, state: BodyState, material: Material, pressure: Array, fibre: Fibre) -> Array:
        return self.forces(u, checked_derivatives(material, "gradient", state.I), pressure, fibre)

    def forces(self, u: Array, gradient: Array, pressure: Array, fibre: Fibre) -> Array:
        out = np.zeros(self.n_dofs)
        d1 = np.ascontiguousarray(gradient)
        LOOPS.residual(u, self.dofs, self.grads, self.weights, self.modes, fibre, pressure, d1, out)
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
        out, values = np.zeros(self.n_dofs), np.zeros(self.indices.size)
        d1, d2 = checked_derivatives(material, "gradient", state.I), checked_derivatives(material, "hessian", state.I)
        target = self.pressure(state, kappa)
        LOOPS.tangent(
            u, self.dofs, self.grads, self.weights, self.modes, fibre, pressure, target,
            per_element(volumetric(kappa).kappa if bulk is None else bulk, len(self.dofs)),
            d1, d2, self.indptr, self.positions, out, values,
        )  # fmt: skip
        return out, values

    def dilatation_map(self, u: Array) -> Array:
        B = np.zeros((*self.means.shape, N_N, 2))
        LOOPS.dilatation_map(u, self.dofs, self.grads, self.weights, self.modes, B)
        return B

    def stress(self, u: Array, state: BodyState, material: Material, pressure: Array, fibre: Fibre) -> Array:
        """Cauchy stresses at the integration points, (6, n_el, n_q), kPa, in the order xx yy zz xy yz xz in the plane z = 0."""
        d1 = checked_derivatives(material, "gradient", state.I)
        stress = np.empty((6, *self.weights.shape))
        LOOPS.cauchy(u, self.dofs, self.grads, self.modes, fibre, pressure, d1, stress)
        return stress

    def deformation(self, u: Array) -> Array:
        """F at the integration points, (n_el, n_q, 3, 3)."""
        F = np.broadcast_to(np.eye(3), (*self.weights.shape, 3, 3)).copy()
        slopes = self.grads @ u[self.dofs][:, None]  # (n_el, n_q, 3, 2)
        F[..., :2, :2] += slopes[:, :, :2].swapaxes(2, 3)
        F[..., 2, 2] += slopes[:, :, 2, 0]
        return F

    def prestress(self, S: Array) -> tuple[Array, Array]:
        slopes, hoop = self.grads[:, :, :2], self.grads[:, :, 2]
        pull = (self.weights[..., None, None] * S[..., :2, :2]) @ slopes
        around = (self.weights * S[..., 2, 2])[..., None] * hoop
        K = rows(pull).swapaxes(1, 2) @ rows(slopes)
        forces = pull.sum(axis=1).swapaxes(1, 2)
        forces[..., 0] += around.sum(axis=1)
        return scattered(self, forces, [K + around.swapaxes(1, 2) @ hoop, K])

    def matrix(self, values: Array) -> sp.csr_matrix:
        return sp.csr_matrix((values, self.indices, self.indptr), shape=(self.n_dofs,) * 2, copy=False)


def _gradients(scalar: Any, radius: Array) -> Array:
    """Derivatives by r and y, and the value over r, of each node's shape function: (n_el, n_q, 3, N_N)."""
    slopes = np.array([scalar.basis[i][0].grad for i in range(N_N)])  # (n_n, 2, n_el, n_q)
    hoop = np.array([np.broadcast_to(np.asarray(scalar.basis[i][0]), radius.shape) for i in range(N_N)]) / radius
    return np.ascontiguousarray(np.concatenate([slopes, hoop[:, None]], axis=1).transpose(2, 3, 1, 0))


# ---- the compiled loop -------------------------------------------------------------------------------------------


@_inlined
def _gather(u: Any, dofs: Any, ue: Any) -> Any:
    for n in range(N_N):
        ue[0, n] = u[dofs[n, 0]]
        ue[1, n] = u[dofs[n, 1]]


@_inlined
def _gradient(ue: Any, grads: Any, F: Any) -> Any:
    """F = 1 + grad u of one integration point; returns J. ue (2, N_N), grads (3, N_N)."""
    rr, ry, yr, yy, hoop = 0.0, 0.0, 0.0, 0.0, 0.0
    for n in range(N_N):
        rr += ue[0, n] * grads[0, n]
        ry += ue[0, n] * grads[1, n]
        yr += ue[1, n] * grads[0, n]
        yy += ue[1, n] * grads[1, n]
        hoop += ue[0, n] * grads[2, n]
    F[0, 0], F[0, 1], F[0, 2] = 1.0 + rr, ry, 0.0
    F[1, 0], F[1, 1], F[1, 2] = yr, 1.0 + yy, 0.0
    F[2, 0], F[2, 1], F[2, 2] = 0.0, 0.0, 1.0 + hoop
    return (F[0, 0] * F[1, 1] - F[0, 1] * F[1, 0]) * F[2, 2]


@_inlined
def _spatial(grads: Any, G: Any, g: Any) -> Any:
    """Spatial gradients g (3, N_N): by r, by y, and the value over the current radius."""
    for n in range(N_N):
        g[0, n] = grads[0, n] * G[0, 0] + grads[1, n] * G[1, 0]
        g[1, n] = grads[0, n] * G[0, 1] + grads[1, n] * G[1, 1]
        g[2, n] = grads[2, n] * G[2, 2]


@_inlined
def _add_force(g: Any, t: Any, w: Any, dofs: Any, out: Any) -> Any:
    for n in range(N_N):
        out[dofs[n, 0]] += w * (t[0] * g[0, n] + t[3] * g[1, n] + t[2] * g[2, n])
        out[dofs[n, 1]] += w * (t[3] * g[0, n] + t[1] * g[1, n])


@_inlined
def _add_dilatation(g: Any, modes: Any, q: Any, v: Any, B: Any) -> Any:
    """Adds v mode . div N to the derivative B (N_M, N_D) of an element's pressure modes of J."""
    for k in range(N_M):
        for n in range(N_N):
            B[k, 2 * n] += v * modes[k, q] * (g[0, n] + g[2, n])
            B[k, 2 * n + 1] += v * modes[k, q] * g[1, n]


@_inlined
def _add_stiffness(g: Any, D: Any, tau: Any, w: Any, E: Any, DE: Any, K: Any) -> Any:
    """Adds w (E . D . E + grad N . tau . grad N) to K (N_D, N_D); E, DE (4, N_D) are scratch: strains rr, yy, hoop, ry."""
    for n in range(N_N):
        E[0, 2 * n], E[1, 2 * n], E[2, 2 * n], E[3, 2 * n] = g[0, n], 0.0, g[2, n], g[1, n]
        E[0, 2 * n + 1], E[1, 2 * n + 1], E[2, 2 * n + 1], E[3, 2 * n + 1] = 0.0, g[1, n], 0.0, g[0, n]
    for s in range(4):
        for a in range(N_D):
            DE[s, a] = w * (D[s, 0] * E[0, a] + D[s, 1] * E[1, a] + D[s, 2] * E[2, a] + D[s, 3] * E[3, a])
    for a in range(N_D):
        for b in range(N_D):
            K[a, b] += E[0, a] * DE[0, b] + E[1, a] * DE[1, b] + E[2, a] * DE[2, b] + E[3, a] * DE[3, b]
    for n in range(N_N):
        x, y = w * (tau[0] * g[0, n] + tau[3] * g[1, n]), w * (tau[3] * g[0, n] + tau[1] * g[1, n])
        z = w * tau[2] * g[2, n]
        for o in range(N_N):
            v = x * g[0, o] + y * g[1, o]
            K[2 * n, 2 * o] += v + z * g[2, o]
            K[2 * n + 1, 2 * o + 1] += v


@_inlined
def _scatter(dofs: Any, positions: Any, indptr: Any, B: Any, kappa: Any, K: Any, values: Any) -> Any:
    """Adds one element's tangent, K + kappa B B of each pressure mode, to the CSR values."""
    for n in range(N_N):
        for i in range(2):
            a = 2 * n + i
            row = indptr[dofs[n, i]]
            for o in range(N_N):
                at = row + 2 * positions[n, o]
                for j in range(2):
                    v = K[a, 2 * o + j]
                    for k in range(N_M):
                        v += kappa * B[k, a] * B[k, 2 * o + j]
                    values[at + j] += v


@_kernel
def _kinematics(u: Any, dofs: Any, grads: Any, weights: Any, modes: Any, fibre: Any, I: Any, theta: Any) -> Any:
    F, b, a, c, ue = on_stack((3, 3)), on_stack((3, 3)), on_stack((3,)), on_stack((3,)), on_stack((2, 9))
    smallest, n_q = np.inf, weights.shape[1]
    for e in range(weights.shape[0]):
        _gather(u, dofs[e], ue)
        for q in range(n_q):
            J = _gradient(ue, grads[e, q], F)
            if not (smallest <= J):
                smallest = J
            _strain(F, J, fibre, b, a, c)
            I1, bb, p = b[0, 0] + b[1, 1] + b[2, 2], 0.0, e * n_q + q
            for i in range(3):
                for k in range(3):
                    bb += b[i, k] * b[i, k]
            I[0, p], I[1, p] = I1, 0.5 * (I1 * I1 - bb)
            I[2, p] = a[0] * a[0] + a[1] * a[1] + a[2] * a[2]
            I[3, p] = a[0] * c[0] + a[1] * c[1] + a[2] * c[2]
            for m in range(N_M):
                theta[e, m] += weights[e, q] * modes[e, m, q] * J
    return smallest


@_kernel
def _residual(
    u: Any, dofs: Any, grads: Any, weights: Any, modes: Any, fibre: Any, pressure: Any, d1: Any, out: Any
) -> Any:  # fmt: skip
    F, G, b, a, c = on_stack((3, 3)), on_stack((3, 3)), on_stack((3, 3)), on_stack((3,)), on_stack((3,))
    m, tau, ue, g = on_stack((4, 6)), on_stack((6,)), on_stack((2, 9)), on_stack((3, 9))
    n_q = weights.shape[1]
    for e in range(weights.shape[0]):
        _gather(u, dofs[e], ue)
        for q in range(n_q):
            J = _gradient(ue, grads[e, q], F)
            _inverse(F, J, G)
            _strain(F, J, fibre, b, a, c)
            _directions(b, a, c, b[0, 0] + b[1, 1] + b[2, 2], m)
            _kirchhoff(m, d1, e * n_q + q, tau)
            p = _at_point(modes[e], q, pressure[e])
            for s in range(3):
                tau[s] += J * p
            _spatial(grads[e, q], G, g)
            _add_force(g, tau, weights[e, q], dofs[e], out)


@_kernel
def _tangent(
    u: Any, dofs: Any, grads: Any, weights: Any, modes: Any, fibre: Any, pressure: Any, target: Any, kappa: Any, d1: Any, d2: Any,
    indptr: Any, positions: Any, out: Any, values: Any,
) -> Any:  # fmt: skip
    F, G, b, a, c = on_stack((3, 3)), on_stack((3, 3)), on_stack((3, 3)), on_stack((3,)), on_stack((3,))
    m, h, tau, total, D = on_stack((4, 6)), on_stack((4, 6)), on_stack((6,)), on_stack((6,)), on_stack((6, 6))
    ue, g, E, DE = on_stack((2, 9)), on_stack((3, 9)), on_stack((4, 18)), on_stack((4, 18))
    K, B = on_stack((18, 18)), on_stack((3, 18))
    n_q = weights.shape[1]
    for e in range(weights.shape[0]):
        _gather(u, dofs[e], ue)
        K[:] = 0.0
        B[:] = 0.0
        for q in range(n_q):
            w = weights[e, q]
            J = _gradient(ue, grads[e, q], F)
            _inverse(F, J, G)
            _strain(F, J, fibre, b, a, c)
            _directions(b, a, c, b[0, 0] + b[1, 1] + b[2, 2], m)
            trace = _kirchhoff(m, d1, e * n_q + q, tau)
            _moduli(b, a, c, m, d1, d2, e * n_q + q, tau, trace, h, D)
            p, aim = _at_point(modes[e], q, pressure[e]), _at_point(modes[e], q, target[e])
            for s in range(6):
                total[s] = tau[s] + (J * aim if s < 3 else 0.0)
            _spatial(grads[e, q], G, g)
            _add_force(g, total, w, dofs[e], out)
            for s in range(3):  # J p (1x1 - 2 I) of the iterated pressure
                tau[s] += J * p
                D[s + 3, s + 3] -= J * p
                for t in range(3):
                    D[s, t] += J * p if s != t else -J * p
            _add_dilatation(g, modes[e], q, w * J, B)
            _add_stiffness(g, D, tau, w, E, DE, K)
        _scatter(dofs[e], positions[e], indptr, B, kappa[e], K, values)


@_kernel
def _dilatation_map(u: Any, dofs: Any, grads: Any, weights: Any, modes: Any, B: Any) -> Any:
    F, G, ue, g, Be = on_stack((3, 3)), on_stack((3, 3)), on_stack((2, 9)), on_stack((3, 9)), on_stack((3, 18))
    for e in range(weights.shape[0]):
        _gather(u, dofs[e], ue)
        Be[:] = 0.0
        for q in range(weights.shape[1]):
            J = _gradient(ue, grads[e, q], F)
            _inverse(F, J, G)
            _spatial(grads[e, q], G, g)
            _add_dilatation(g, modes[e], q, weights[e, q] * J, Be)
        for k in range(N_M):
            for n in range(N_N):
                B[e, k, n, 0], B[e, k, n, 1] = Be[k, 2 * n], Be[k, 2 * n + 1]


@_kernel
def _cauchy(u: Any, dofs: Any, grads: Any, modes: Any, fibre: Any, pressure: Any, d1: Any, stress: Any) -> Any:
    F, b, a, c = on_stack((3, 3)), on_stack((3, 3)), on_stack((3,)), on_stack((3,))
    m, tau, ue = on_stack((4, 6)), on_stack((6,)), on_stack((2, 9))
    n_q = grads.shape[1]
    for e in range(grads.shape[0]):
        _gather(u, dofs[e], ue)
        for q in range(n_q):
            J = _gradient(ue, grads[e, q], F)
            _strain(F, J, fibre, b, a, c)
            _directions(b, a, c, b[0, 0] + b[1, 1] + b[2, 2], m)
            _kirchhoff(m, d1, e * n_q + q, tau)
            p = _at_point(modes[e], q, pressure[e])
            for s in range(6):
                stress[s, e, q] = tau[s] / J + (p if s < 3 else 0.0)


LOOPS = SimpleNamespace(
    kinematics=_kinematics, residual=_residual, tangent=_tangent, dilatation_map=_dilatation_map, cauchy=_cauchy
)
