"""The interface of a deformable body to the solver: a Protocol for bricks, and for a body in a meridian plane."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import scipy.sparse as sp

from indentfit.arrays import Array, Ints
from indentfit.fibres import Fibre
from indentfit.material import Material

Bulk = float | Array
"""A bulk modulus, kPa: of all elements, or of each of them, (n_el, 1)."""


def per_element(bulk: Bulk, n_el: int) -> Array:
    """The bulk modulus of each element, (n_el,), kPa."""
    return np.ascontiguousarray(np.broadcast_to(np.ravel(bulk), n_el), dtype=float)


@dataclass(frozen=True, eq=False)
class Volumetric:
    """How a body resists a change of its volume.

    Parameters
    ----------
    kappa : float, or array (n_el, 1), kPa
        Bulk modulus.
    rest : float, or array (n_el, 1), kPa
        Pressure of the untouched body, where that was stretched; tension is positive.
    """

    kappa: Bulk
    rest: Bulk = 0.0

    def pressure(self, theta: Array, means: Array) -> Array:
        """Pressure modes (n_el, n_m) of the modes of J and of 1, each (n_el, n_m)."""
        return self.kappa * (theta - means) + self.rest * means


def volumetric(kappa: Bulk | Volumetric) -> Volumetric:
    """A Volumetric as it is; that of a body without pressure at rest from its bulk modulus."""
    return kappa if isinstance(kappa, Volumetric) else Volumetric(kappa)


def per_mode(bulk: Bulk, means: Array) -> Bulk:
    """The bulk modulus of each pressure mode, (n_el * n_m,), kPa, of means (n_el, n_m); a number remains one."""
    return bulk if isinstance(bulk, float | int) else np.broadcast_to(bulk, means.shape).ravel()


@dataclass(frozen=True)
class BodyState:
    """Kinematics of a body at given displacements.

    Attributes
    ----------
    I : array (4, n_el * n_q) or (7, n_el * n_q)
        Isochoric invariants I1, I2, I4, I5 at the integration points, and I6, I7, I8 where there are two families of fibres.
    theta : array (n_el, n_m)
        Pressure modes of J.
    valid : bool
        Whether J > 0 everywhere.
    """

    I: Array
    theta: Array
    valid: bool


class Body(Protocol):
    """A meshed body of a nearly incompressible hyperelastic solid, without material, load or state.

    The unknowns are displacements u (n,), mm, k of them at each node, and pressure modes (n_el, n_m) that are eliminated element
    by element; tension is positive. All methods are pure: the same arguments give the same numbers, bit by bit.

    Attributes
    ----------
    copies : int
        How many of this body the whole sample is made of.
    dofs : array (n_el, n_n, k)
        Degrees of freedom of each element.
    volume : array (n_el,), mm^3
        Volume of each element.
    means : array (n_el, n_m)
        Pressure modes of the constant 1, which theta equals at rest.
    indptr, indices : arrays
        CSR pattern of the tangent, sorted, with a full diagonal.
    """

    copies: int
    dofs: Ints
    volume: Array
    means: Array
    indptr: Ints
    indices: Ints

    @property
    def n_dofs(self) -> int:
        """Number of displacements."""
        ...

    def held(self, base: str, motions: frozenset[str] = frozenset(), ends: bool = False) -> Ints:
        """Dofs held at zero by symmetry, by a base that is "sliding" or "bonded", to hold rigid motions (fem.symmetry), and where
        the sample's ends are held along x."""
        ...

    def points(self) -> Array:
        """Points (3 or 2, n / k) of the nodes that have unknowns, mm."""
        ...

    def unfolded(self, u: Array) -> "tuple[Body, Array]":
        """The body of all nodes, and its displacements, of displacements u (n,); itself and u, unless it is tied (fem.tied)."""
        ...

    def corners(self, u: Array) -> tuple[Array, Array]:
        """Points (3, n) of the elements' corners, and their displacements (3, n), mm."""
        ...

    def state(self, u: Array, fibre: Fibre) -> BodyState:
        """Invariants and dilatation at displacements u (n,), with the direction of the fibres (3,) at rest, or
        those of two families (2, 3).

        Displacements that turn an element inside out raise no exception: the state is then not valid.
        """
        ...

    def pressure(self, state: BodyState, kappa: Bulk | Volumetric) -> Array:
        """Pressure modes (n_el, n_m) of a state, kappa (theta - means) and the pressure at rest, in kPa times the modes' own
        unit."""
        ...

    def residual(self, u: Array, state: BodyState, material: Material, pressure: Array, fibre: Fibre) -> Array:
        """Internal forces (n,), mN, of a material at given pressure modes, which need not be those of the state."""
        ...

    def forces(self, u: Array, gradient: Array, pressure: Array, fibre: Fibre) -> Array:
        """Internal forces (n,), mN, of an energy's derivatives by the invariants (4, n_el * n_q), kPa, and of pressure modes.

        The forces are linear in both, so that derivatives by parameters come from the same function.
        """
        ...

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
        """Forces and tangent of one Newton iteration.

        Parameters
        ----------
        pressure : array (n_el, n_m)
            The iterated pressure modes, for the geometric part of the tangent.
        bulk : float, kPa
            Bulk modulus of the tangent, where it differs from kappa (fem.linear.multigrid).

        Returns
        -------
        forces (n,), mN, at the pressure modes that follow from u, and CSR values (nnz,) of the consistent tangent, mN/mm
        """
        ...

    def dilatation_map(self, u: Array) -> Array:
        """Derivative of the pressure modes of J by each element's displacements, (n_el, n_m, n_n, k)."""
        ...

    def stress(self, u: Array, state: BodyState, material: Material, pressure: Array, fibre: Fibre) -> Array:
        """Cauchy stresses at the integration points, (6, n_el, n_q), kPa, in the order xx yy zz xy yz xz."""
        ...

    def deformation(self, u: Array) -> Array:
        """Deformation gradients at the integration points, (n_el, n_q, 3, 3)."""
        ...

    def prestress(self, S: Array) -> tuple[Array, Array]:
        """Internal forces (n,), mN, of second Piola-Kirchhoff stresses S (n_el, n_q, 3, 3), kPa, on the body at rest, and CSR
        values (nnz,), mN/mm, of the derivative of these forces by the displacements, which is constant."""
        ...

    def matrix(self, values: Array) -> sp.csr_matrix:
        """The CSR matrix (n, n) of values (nnz,), which shares the body's pattern."""
        ...
