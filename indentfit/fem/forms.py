"""The solid as plain scikit-fem forms: slow and readable, the oracle with which the compiled loop of `element.py` is compared.

Displacements u and a pressure p, discontinuous between elements, such that for all test functions v and q

    ∫ (∂ψ/∂F + p J F⁻ᵀ) : ∇v = 0,    ∫ q (J - 1 - p/κ) = 0,    F = 1 + ∇u,  J = det F.

ψ depends on the isochoric invariants I = J^(-n/3) i, where i is an invariant of C = FᵀF and n its degree in F.
Newton's step (du, dp) solves

    ∫ (∂²ψ/∂F² : ∇du + p ∂(J F⁻ᵀ)/∂F : ∇du) : ∇v + ∫ dp J F⁻ᵀ : ∇v = -∫ (∂ψ/∂F + p J F⁻ᵀ) : ∇v,
    ∫ q J F⁻ᵀ : ∇du - ∫ q dp/κ = -∫ q (J - 1 - p/κ).

p is a sum of modes q_k that are orthonormal on each element, so the second line gives p + dp element by element, which
leaves K = A + κ Σ b_k b_kᵀ with b_k = ∫ q_k J F⁻ᵀ : ∇v, and on the right the pressure that follows from u.

Everything is written on the undeformed body, with the first Piola stress P = ∂ψ/∂F; the compiled loop works with
Kirchhoff stresses and spatial gradients. Forms and loop share only the bases, quadrature and modes.
"""

from typing import Any

import numpy as np
import scipy.sparse as sp
from skfem import BilinearForm, Functional, LinearForm
from skfem.helpers import ddot, det, grad, identity, inv, mul, prod, trace, transpose

from indentfit.arrays import Array
from indentfit.fem.body import BodyState, Bulk, Volumetric, per_element, volumetric
from indentfit.fem.element import Solid
from indentfit.fibre_map import FibreMap
from indentfit.fibres import Fibre
from indentfit.material import Material, families, invariant_gradients, invariants

DEGREES = (2, 4, 2, 4, 2, 4, 2)  # in F, of the invariants I1, I2, I4, I5, I6, I7, I8
DIRECTIONS = np.eye(9).reshape(9, 3, 3, 1, 1)  # the nine components of a second-order tensor


@LinearForm
def internal_forces(v: Any, w: Any) -> Any:
    return ddot(w.P, grad(v))


@BilinearForm
def stiffness(u: Array, v: Any, w: Any) -> Any:
    return ddot(np.einsum("ijkl...,kl...->ij...", w.A, grad(u)), grad(v))


@LinearForm
def dilatation(v: Any, w: Any) -> Any:
    return w.q * ddot(w.cofactor, grad(v))


@Functional
def mode_of_J(w: Any) -> Any:
    return w.q * w.J


class FormSolid(Solid):
    """A meshed sample whose forces and tangent are assembled from the forms above; otherwise like `element.Solid`."""

    def state(self, u: Array, fibre: Fibre) -> BodyState:
        F = self._deformation(u)
        J = det(F)
        theta = [mode_of_J.elemental(self.basis, q=q, J=J) for q in self._modes()]
        with np.errstate(all="ignore"):  # wild displacements: the state is not valid then
            I = invariants(F, self._fibres(fibre)).reshape(-1, self.weights.size)
            return BodyState(I, np.transpose(theta), bool(J.min() > 0))

    def forces(self, u: Array, gradient: Array, pressure: Array, fibre: Fibre) -> Array:
        return internal_forces.assemble(self.basis, P=self._piola(u, gradient, pressure, fibre))

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
        F, p = self._deformation(u), self._field(pressure)
        first, second = self._derivatives(state, material)
        A = stiffness.elemental(self.basis, A=moduli(F, self._fibres(fibre), first, second, p))
        K = A.data.reshape(*A.local_shape, -1)
        moduli_of_elements = per_element(volumetric(kappa).kappa if bulk is None else bulk, len(self.dofs))
        for q in self._modes():
            b = dilatation.elemental(self.basis, q=q, cofactor=cofactor(F)).data.reshape(A.local_shape[0], -1)
            K = K + moduli_of_elements * b[:, None] * b[None, :]
        matrix = sp.coo_matrix((K.ravel(), A.indices), A.shape).tocsr()  # keeps zeros: it has the cached pattern
        return self.residual(u, state, material, self.pressure(state, kappa), fibre), matrix.data

    def dilatation_map(self, u: Array) -> Array:
        C = cofactor(self._deformation(u))
        B = np.array([dilatation.elemental(self.basis, q=q, cofactor=C).tolocal() for q in self._modes()])
        return np.moveaxis(B, 0, 1).reshape(*self.means.shape, -1, 3)

    def stress(self, u: Array, state: BodyState, material: Material, pressure: Array, fibre: Fibre) -> Array:
        F = self._deformation(u)
        P = self._piola(u, material.gradient(state.I), pressure, fibre)
        sigma = np.einsum("ik...,jk...->ij...", P, F) / det(F)
        return np.array([sigma[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))])

    def _fibres(self, fibre: Fibre) -> Array:
        """Directions (3,) or (2, 3), of a map at the integration points (3, n_el, n_q)."""
        if not isinstance(fibre, FibreMap):
            return fibre
        return np.ascontiguousarray(self.directions(fibre)[0].T).reshape(3, *self.weights.shape)

    def _deformation(self, u: Array) -> Any:
        du = grad(self.basis.interpolate(u))
        return identity(du) + du

    def _modes(self) -> Array:
        return np.moveaxis(self.modes, 1, 0)

    def _field(self, pressure: Array) -> Array:
        return np.einsum("em,emq->eq", pressure, self.modes)

    def _derivatives(self, state: BodyState, material: Material) -> tuple[Array, Array]:
        first, second = material.gradient(state.I), material.hessian(state.I)
        return first.reshape(-1, *self.weights.shape), second.reshape(len(first), -1, *self.weights.shape)

    def _piola(self, u: Array, gradient: Array, pressure: Array, fibre: Fibre) -> Any:
        F, first = self._deformation(u), gradient.reshape(-1, *self.weights.shape)
        P = np.einsum("a...,aij...->ij...", first, invariant_gradients(F, self._fibres(fibre)))
        return P + self._field(pressure) * cofactor(F)


def cofactor(F: Any) -> Any:
    """J F⁻ᵀ, the derivative of J by F."""
    return det(F) * transpose(inv(F))


def moduli(F: Any, a0: Array, first: Any, second: Any, p: Any) -> Any:
    """∂P/∂F at a fixed pressure p, shape (3, 3, 3, 3, ...), of an energy with these derivatives by its invariants."""
    D, G, J = invariant_gradients(F, a0), transpose(inv(F)), det(F)
    columns = []
    for H in DIRECTIONS:
        H = H + np.zeros_like(F)
        bend = np.einsum("a...,aij...->ij...", first, invariant_second_derivatives(F, a0, H))
        stretch = np.einsum("ab...,bij...,ij...->a...", second, D, H, optimize=True)
        swell = J * p * (ddot(G, H) * G - product(G, transpose(H), G))
        columns.append(bend + np.einsum("a...,aij...->ij...", stretch, D) + swell)
    return np.moveaxis(np.array(columns).reshape(3, 3, *F.shape), (0, 1), (2, 3))


def invariant_second_derivatives(F: Any, a0: Array, H: Any) -> Any:
    """∂²I/∂F² : H of I1, I2, I4, I5, shape (4, 3, 3, ...), or with I6, I7, I8 (7, 3, 3, ...)."""
    C, dC = product(transpose(F), F), product(transpose(H), F) + product(transpose(F), H)
    full = [  # of the invariants i of C
        2 * H,
        2 * (trace(dC) * F + trace(C) * H - product(H, C) - product(F, dC)),
    ]
    for fibre in families(a0):
        Fa, Ca, Ha, dCa = mul(F, fibre), mul(C, fibre), mul(H, fibre), mul(dC, fibre)
        full += [2 * prod(Ha, fibre), 2 * (prod(Ha, Ca) + prod(Fa, dCa) + prod(mul(H, Ca) + mul(F, dCa), fibre))]
    if len(a0) == 2:
        full.append(prod(mul(H, a0[0]), a0[1]) + prod(mul(H, a0[1]), a0[0]))
    G, scale, GH = transpose(inv(F)), det(F) ** (-1 / 3), ddot(transpose(inv(F)), H)
    turn = product(G, transpose(H), G)  # minus the change of F⁻ᵀ
    out = []
    for n, d2i, I, dI in zip(DEGREES, full, invariants(F, a0), invariant_gradients(F, a0), strict=False):
        out.append(scale**n * d2i - n / 3 * (GH * (dI + n / 3 * I * G) + ddot(dI, H) * G - I * turn))
    return np.array(out)


def product(*tensors: Any) -> Any:
    """Product of second-order tensors, each (3, 3, ...)."""
    first, *rest = tensors
    for tensor in rest:
        first = np.einsum("ik...,kj...->ij...", first, tensor)
    return first
