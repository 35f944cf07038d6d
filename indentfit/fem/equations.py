"""The equations of one increment of the depth, and their linearisation at one iterate.

The unknowns are the displacements u and the pressure modes p of the body. The residual at depth d is the body's internal forces
plus those of the contact, which remembers a History. Everything here is a value: an iteration makes new ones.
"""

from dataclasses import dataclass, field, replace

import numpy as np
import scipy.sparse as sp

from indentfit.arrays import Array
from indentfit.errors import ConvergenceError
from indentfit.fem.body import Body, BodyState, Bulk, Volumetric, per_mode
from indentfit.fem.constraints import Fixed
from indentfit.fem.contact import ContactFace
from indentfit.fem.contact_state import ContactState, History, Springs
from indentfit.fem.directions import Direction
from indentfit.fem.linear.tangent import Tangent
from indentfit.fem.sliding import Sliding
from indentfit.fem.tied import Tied
from indentfit.fibres import Fibre
from indentfit.material import Material

ROUND_OFF = 1e-13  # of the volumes of the elements
SOFTER = 1 / 3  # factor of a cutback on the stiffness of the contact springs; the penalty error is reported


@dataclass(frozen=True, eq=False)
class Equations:
    """The parts of a model that do not change along a path: the body, the face of the contact, and the dofs held at zero."""

    body: Body
    face: ContactFace
    fixed: Fixed

    def sliding_on(self, u: Array) -> "Equations":
        """These equations with layers that slide where they lie at displacements u (n,); themselves without such layers."""
        if not isinstance(self.body, Sliding | Tied):
            return self
        body = self.body.sliding_on(u)
        return self if body is self.body else replace(self, body=body, fixed=Fixed(body, self.fixed.dofs))

    @property
    def follow(self) -> bool:
        """Whether layers slide whose points lie on what they have slid on."""
        cut = self.body.solid if isinstance(self.body, Tied) else self.body
        return isinstance(cut, Sliding) and cut.facets.follows

    def slid_forces(self, u: Array, led: "Led", number: int, kappa: Bulk) -> Array:
        """Change (n,) of the body's forces at displacements u (n,) by the direction of a number, through where points lie."""
        assert isinstance(self.body, Sliding | Tied)
        return self.body.slid_forces(u, led.u, led.changes[number], kappa)


@dataclass(frozen=True, eq=False)
class Led:
    """Displacements u (n,) at which the points of layers that slide have been laid on facets, and their derivatives (n_d, n) by the
    loading's directions."""

    u: Array
    changes: Array


@dataclass(frozen=True, eq=False)
class Memory:
    """Stresses of earlier times that still act on a body: their internal forces are those at rest plus `matrix` times u.

    Parameters
    ----------
    at_rest : array (n,), mN
    matrix : CSR matrix (n, n), mN/mm
        It has the pattern of the body's tangent.
    """

    at_rest: Array
    matrix: sp.csr_matrix = field(repr=False)

    def forces(self, u: Array) -> Array:
        """Internal forces (n,), mN, at displacements u (n,)."""
        return self.at_rest + self.matrix @ u


@dataclass(frozen=True, eq=False)
class Loading:
    """The material, springs and directions of one run of a model.

    Parameters
    ----------
    material : Material
    kappa : float, or array (n_el, 1), kPa
        Bulk modulus; an array where the sample has layers.
    tangent_bulk : float, or array (n_el, 1), kPa
        Bulk modulus with which tangents are assembled (fem.linear).
    mu : float, or array (n_el, 1), kPa
        Shear modulus, as far as linear solvers need one.
    fibre : array (3,)
        Direction of the fibres at rest.
    springs : Springs
        Springs of the contact.
    directions : tuple of Direction
        Quantities by which the path is differentiated.
    memory : Memory, or None
        Stresses of earlier times, of a viscoelastic body (fem.viscous).
    seen : CSR matrix (m, n), or None
        Displacements of which derivatives are kept (fem.observation).
    rest : float, or array (n_el, 1), kPa
        Pressure of the untouched sample, where that was stretched.
    """

    material: Material
    kappa: Bulk
    tangent_bulk: Bulk
    mu: Bulk
    fibre: Fibre
    springs: Springs
    directions: tuple[Direction, ...] = ()
    memory: Memory | None = None
    seen: sp.csr_matrix | None = field(default=None, repr=False)
    rest: Bulk = 0.0

    @property
    def volumetric(self) -> Volumetric:
        """How the body resists a change of its volume."""
        return Volumetric(self.kappa, self.rest)

    def per_mode(self, means: Array) -> tuple[Bulk, Bulk, Bulk]:
        """kappa, tangent_bulk and mu of each pressure mode (n_el * n_m,), where they are not those of the whole body."""
        return per_mode(self.kappa, means), per_mode(self.tangent_bulk, means), per_mode(self.mu, means)

    def softened(self) -> "Loading":
        """This loading with softer springs, as after a cutback."""
        return replace(self, springs=self.springs.scaled(SOFTER))

    def stiffened(self, springs: Springs) -> "Loading":
        """This loading with stiffer springs, but not stiffer than `springs`."""
        if self.springs.normal >= springs.normal * SOFTER:
            return replace(self, springs=springs)
        return replace(self, springs=self.springs.scaled(1 / SOFTER))


@dataclass(frozen=True, eq=False)
class Iterate:
    """Displacements u (n,), mm, and pressure modes (n_el, n_m), which are iterated as unknowns of their own."""

    u: Array
    pressure: Array

    def moved(self, share: float, by: "Iterate") -> "Iterate":
        """This iterate plus a share of the change `by`."""
        return Iterate(self.u + share * by.u, self.pressure + share * by.pressure)


@dataclass(frozen=True, eq=False)
class Dampers:
    """Nodal dampers of one implicit step of time: the forces are coefficients (n,), mN/mm, times the motion from u0 (n,)."""

    coefficients: Array
    u0: Array

    def forces(self, u: Array) -> Array:
        """Forces (n,), mN."""
        return self.coefficients * (u - self.u0)


@dataclass(frozen=True, eq=False)
class Increment:
    """The equations at one depth after one history of the contact.

    Parameters
    ----------
    equations : Equations
    loading : Loading
    depth : float, mm
    history : History
        The contact's memory of the steps before.
    changes : tuple of History, or None
        Derivatives of the history by the loading's directions; None where the path cannot be differentiated any more.
    leash : float, mm
        Largest motion of a point in one iteration.
    led : Led or None
        Where the points of layers that slide have been laid on facets, if the path is differentiated.
    dampers : Dampers or None
        Dampers whose forces belong to the residual.
    """

    equations: Equations
    loading: Loading
    depth: float
    history: History
    changes: tuple[History, ...] | None = ()
    leash: float = np.inf
    led: Led | None = field(default=None, repr=False)
    dampers: Dampers | None = field(default=None, repr=False)

    def after(self, history: History, changes: tuple[History, ...] | None = None) -> "Increment":
        """The same depth after another history."""
        return replace(self, history=history, changes=changes)

    def damped(self, damping: float, u: Array) -> "Increment":
        """The equations of an implicit step of time from displacements u (n,); damping: in units of shear modulus times size."""
        coefficients = damping * self.loading.material.shear_modulus * self.equations.fixed.sizes
        return replace(self, dampers=Dampers(coefficients, u))

    def contact(self, u: Array) -> ContactState:
        """State of the contact at displacements u (n,)."""
        return self.equations.face.touch(u, self.depth, self.history, self.loading.springs)

    def linearised(self, at: Iterate) -> "Linearisation":
        """Residual and tangent at an iterate."""
        body, face, fixed, loading = self.equations.body, self.equations.face, self.equations.fixed, self.loading
        state = body.state(at.u, loading.fibre)
        residual, values = body.tangent(
            at.u, state, loading.material, at.pressure, loading.volumetric, loading.fibre, loading.tangent_bulk
        )
        if loading.memory is not None:
            residual += loading.memory.forces(at.u)
            values += loading.memory.matrix.data
        if self.dampers is not None:
            residual += self.dampers.forces(at.u)
            values[fixed.diagonal] += self.dampers.coefficients
        contact = self.contact(at.u)
        forces = face.residual(contact)
        residual += forces
        fixed.constrain(residual, values)
        whole = values.copy()
        dense = fixed.without(face.add_tangent(contact, whole), face.surface)
        fixed.restore(whole, values)
        dilatation = body.dilatation_map(at.u)
        kappa, bulk, mu = loading.per_mode(body.means)
        tangent = Tangent(
            whole=body.matrix(whole),
            body=body.matrix(values),
            contact=dense,
            dilatation=fixed.dilatation(dilatation),
            kappa=kappa,
            bulk=bulk,
            mu=mu,
        )
        return Linearisation(self, at, state, contact, dilatation, residual, _norm(residual), _norm(forces), tangent)

    def balance(self, at: Iterate, dilatation: sp.csr_matrix) -> "Balance | None":
        """The Balance at an iterate, with the dilatation (n_p, n) of displacements near by; None where an element is inside out."""
        body, face, fixed, loading = self.equations.body, self.equations.face, self.equations.fixed, self.loading
        state = body.state(at.u, loading.fibre)
        if not state.valid:
            return None
        contact = self.contact(at.u)
        forces = face.residual(contact)
        residual = body.residual(at.u, state, loading.material, at.pressure, loading.fibre) + forces
        if loading.memory is not None:
            residual += loading.memory.forces(at.u)
        if self.dampers is not None:
            residual += self.dampers.forces(at.u)
        gap = body.pressure(state, loading.volumetric) - at.pressure
        whole = residual + dilatation.T @ gap.ravel()
        return Balance(at, fixed.freed(residual), gap, contact, _norm(fixed.freed(whole)), _norm(forces))

    def merit(self, at: Iterate) -> float:
        """Norm of the residual, mN, at an iterate; infinite where an element is inside out."""
        body, fibre = self.equations.body, self.loading.fibre
        state = body.state(at.u, fibre)
        if not state.valid:
            return np.inf
        with np.errstate(all="ignore"):
            residual = body.residual(at.u, state, self.loading.material, at.pressure, fibre)
        if self.loading.memory is not None:
            residual += self.loading.memory.forces(at.u)
        residual += self.equations.face.residual(self.contact(at.u))
        if self.dampers is not None:
            residual += self.dampers.forces(at.u)
        residual[self.equations.fixed.dofs] = 0
        size = float(_norm(residual))
        return size if np.isfinite(size) else np.inf

    def linear_pressure(self, dilatation: Array, du: Array) -> Array:
        """Change of the pressure modes along du (n,), linearised; dilatation: the body's dilatation_map."""
        return self.loading.kappa * np.einsum("emni,eni->em", dilatation, du[self.equations.body.dofs])


@dataclass(frozen=True, eq=False)
class Balance:
    """The forces of an increment at one iterate, without their derivative.

    Parameters
    ----------
    at : Iterate
    residual : array (n,), mN
        With the iterated pressures.
    gap : array (n_el, n_m)
        The pressure modes that follow from the displacements, less the iterated ones.
    contact : ContactState
    unbalanced : float, mN
        Norm of the residual with the pressures that follow from the displacements, by the dilatation of displacements near by.
    contact_force : float, mN
        Norm of the contact's nodal forces.
    """

    at: Iterate
    residual: Array = field(repr=False)
    gap: Array = field(repr=False)
    contact: ContactState = field(repr=False)
    unbalanced: np.float64
    contact_force: np.float64


@dataclass(frozen=True, eq=False)
class Linearisation:
    """Residual and tangent of an increment at one iterate, with their parts.

    Parameters
    ----------
    increment : Increment
    at : Iterate
    state : BodyState
        State of the body.
    contact : ContactState
        State of the contact.
    dilatation : array (n_el, n_m, n_n, k)
        Derivative of the pressure modes of J.
    residual : array (n,), mN
    unbalanced : float, mN
        Norm of the residual.
    contact_force : float, mN
        Norm of the contact's nodal forces, to which the residual is compared.
    tangent : Tangent
    """

    increment: Increment
    at: Iterate
    state: BodyState
    contact: ContactState
    dilatation: Array = field(repr=False)
    residual: Array = field(repr=False)
    unbalanced: np.float64
    contact_force: np.float64
    tangent: Tangent = field(repr=False)

    @property
    def share(self) -> float:
        """The residual as a share of the contact force; infinite where nothing touches."""
        return float(self.unbalanced / self.contact_force) if self.contact_force else np.inf

    def balanced(self, tolerance: float) -> bool:
        """Whether the residual is within a share of the contact force.

        Where the iterated pressures agree with the displacements to round-off, the residual with the iterated pressures counts:
        round-off of the volume times a large bulk modulus would never balance.
        """
        enough = tolerance * self.contact_force
        return bool(self.unbalanced <= enough or (self._rounded() and self.increment.merit(self.at) <= enough))

    def _rounded(self) -> bool:
        """Whether the iterated pressures differ from those of the displacements by round-off."""
        floor = ROUND_OFF * np.max(self.increment.loading.kappa) * np.abs(self.increment.equations.body.means).max()
        return bool(np.abs(self.pressure - self.at.pressure).max() <= floor)

    @property
    def pressure(self) -> Array:
        """The pressure modes (n_el, n_m) that follow from the displacements."""
        return self.increment.equations.body.pressure(self.state, self.increment.loading.volumetric)

    def change(self, du: Array) -> Iterate:
        """Newton's change of the iterate: du (n,), and the corresponding change of the iterated pressures."""
        return Iterate(du, self.pressure - self.at.pressure + self.increment.linear_pressure(self.dilatation, du))

    def damped(self, increment: "Increment") -> "Linearisation":
        """The linearisation at the same iterate of this increment with dampers, which have not moved yet."""
        assert increment.dampers is not None
        body, diagonal = increment.equations.body, increment.equations.fixed.diagonal
        whole, factorised = self.tangent.whole.data.copy(), self.tangent.factorised.data.copy()
        whole[diagonal] += increment.dampers.coefficients
        factorised[diagonal] += increment.dampers.coefficients
        return replace(
            self, increment=increment, tangent=replace(self.tangent, whole=body.matrix(whole), body=body.matrix(factorised))
        )

    def failure(self, share: float, iteration: int, cause: str | None = None) -> ConvergenceError:
        """The error of an iteration that ends with a residual of a share of the contact force; it states the contact's state."""
        touching, slipping = int(self.contact.touching.sum()), int(self.contact.slipping.sum())
        state = f"{touching} of {self.contact.gap.size} contact points touch, {slipping} slip"
        cause = cause or f"residual still {share:.1e} of the contact force after {iteration + 1} iterations"
        return ConvergenceError(f"{cause} ({state})", self.increment.depth, iteration=iteration)


def _norm(vector: Array) -> np.float64:
    with np.errstate(over="ignore"):  # of a wild iterate, which is refused
        return np.float64(np.linalg.norm(vector))
