"""Exact sensitivities: the converged load path differentiated by parameters, contact and friction history included.

At each equilibrium R(u, theta, h) = 0 the tangent K = dR/du is factorised already, so the derivative by theta costs one
back-substitution,

    K u' = - dR/dtheta - dR/dh h',

where h are the contact's multipliers and anchors. They follow from the steps before, and their derivatives h' by the same
rules (direct differentiation of a path-dependent problem: Michaleris, Tortorelli and Vidal 1994). The discrete path is
differentiated: with the same steps, central differences tend to these derivatives.
"""

import functools
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from indentfit.arrays import Array
from indentfit.fem.body import BodyState, Volumetric
from indentfit.fem.contact import ContactFace
from indentfit.fem.contact_state import ContactChange, ContactState, History, Springs, Stride
from indentfit.fem.deadline import Deadline
from indentfit.fem.directions import Direction
from indentfit.fem.equations import Linearisation
from indentfit.fem.linear.solver import LinearSolver
from indentfit.indenters import UP

ACCURACY = 1e-9  # relative residual of the linear solves
AGREEMENT = 2.0  # factor between the penalty errors by the tangent and by secants, up to which they agree
AT_REST = 1e-6  # mm per mm of depth: a motion so small that the body's forces are linear in it


@dataclass(frozen=True, eq=False)
class PathDerivatives:
    """Derivatives of an equilibrium by each Direction; the directions are the first axis.

    Attributes
    ----------
    force : array (n_d,), mN
        Derivatives of the quarter's force, from `since` on with those of the penalty error.
    changes : tuple of ContactChange
        Derivatives of the contact's state.
    rates : tuple of arrays (n_f, n_q, 3)
        Derivatives of the rate of the contact's traction.
    stiffness : array (n_d,), mN/mm
        Derivatives of the stiffness, at rest only.
    seen : array (n_d, m), or None
        Derivatives of the displacements that are seen (`Loading.seen`).
    moves, courses : arrays (n_d, n), or None
        Derivatives of the displacements and of `Equilibrium.course`, where layers slide whose points follow.
    """

    force: Array
    changes: tuple[ContactChange, ...] = field(repr=False)
    rates: tuple[Array, ...] = field(repr=False)
    stiffness: Array | None = None
    seen: Array | None = field(default=None, repr=False)
    moves: Array | None = field(default=None, repr=False)
    courses: Array | None = field(default=None, repr=False)

    def since(
        self, before: "PathDerivatives", step: float, secants: "Secants | None", springs: Sequence[Springs]
    ) -> "PathDerivatives":
        """These derivatives with the rates of the secant from the derivatives `before`, a step of the depth (mm) earlier, and with
        those of the penalty error by `secants`; `springs` are the derivatives of the contact's springs."""
        pairs = zip(self.changes, before.changes, strict=True)
        rates = tuple((here.traction - there.traction) / step for here, there in pairs)
        withheld = np.zeros(len(rates)) if secants is None else secants.changes(self.changes, springs, rates, before.rates)
        courses = None if self.moves is None or before.moves is None else (self.moves - before.moves) / step
        return replace(self, rates=rates, force=self.force + withheld, courses=courses)

    def advanced(self, contact: ContactState, rate: Array, stride: Stride) -> tuple[History, ...]:
        """Derivatives of `contact.advanced(rate, stride)`: a History for each Direction."""
        return tuple(change.advanced(contact, rate, rates, stride) for change, rates in zip(self.changes, self.rates, strict=True))


@dataclass(frozen=True, eq=False)
class Secants:
    """The penalty error at the end of a step with the traction's rate by secants of the path, in place of that by the tangent: its
    derivatives are exact, and need no derivative of the tangent. Both disagree where the surface has folded or snapped within the
    step, and in the first step of a contact that grows; the penalty error is then left in the force.

    Attributes
    ----------
    face : ContactFace
    contact : ContactState
        The state at the end of the step.
    springs : Springs
    rate, last_rate : array (n_f, n_q, 3), kPa/mm
        Rates of the traction in this step and in the last one.
    ahead : float
        The traction's rate at the end of the step is rate + ahead (rate - last_rate).
    """

    face: ContactFace
    contact: ContactState
    springs: Springs
    rate: Array = field(repr=False)
    last_rate: Array = field(repr=False)
    ahead: float

    @functools.cached_property
    def penalty_error(self) -> float:
        """The penalty error, mN."""
        return self.face.penalty_error(self.contact, self._at_end(self.rate, self.last_rate), self.springs)

    def agree(self, by_tangent: float) -> bool:
        """Whether the penalty error by the tangent is the same within a factor of AGREEMENT."""
        by_secants = self.penalty_error
        return bool(by_secants and 1 / AGREEMENT < by_tangent / by_secants < AGREEMENT)

    def changes(
        self, changes: Sequence[ContactChange], springs: Sequence[Springs], rates: Sequence[Array], last_rates: Sequence[Array]
    ) -> Array:
        """Derivatives (n_d,), mN, of the penalty error, from those of the state, of the springs and of both rates."""
        at_end = self._at_end(self.rate, self.last_rate)
        each = zip(changes, springs, rates, last_rates, strict=True)
        return np.array(
            [
                self.face.penalty_error_change(self.contact, at_end, self.springs, change, self._at_end(rate, last), stiffer)
                for change, stiffer, rate, last in each
            ]
        )

    def _at_end(self, rate: Array, last: Array) -> Array:
        return rate + self.ahead * (rate - last)


def path_derivatives(
    there: Linearisation, solver: LinearSolver, deadline: Deadline, at_rest: Array | None = None
) -> PathDerivatives:
    """PathDerivatives of an equilibrium whose increment has the changes of its history.

    Parameters
    ----------
    there : Linearisation
        The equilibrium's linearisation.
    solver : LinearSolver
    deadline : Deadline
    at_rest : array (n,) or None
        du/dd of the untouched sample, if the equilibrium is the untouched sample: the rates are then those of its tangent.

    Returns
    -------
    PathDerivatives
    """
    increment = there.increment
    face, fixed = increment.equations.face, increment.equations.fixed
    ways, histories = increment.loading.directions, increment.changes or ()
    here = [_Along(there, way, history, number) for number, (way, history) in enumerate(zip(ways, histories, strict=True))]

    def solved(forces: Sequence[Array]) -> Array:
        """Displacements (n_d, n) that balance changes of the forces (n,)."""
        return solver.solve_each(there.tangent, -np.array([fixed.freed(each) for each in forces]), ACCURACY, deadline)

    moves = solved([each.forces() for each in here])
    along = tuple(each.change(du) for each, du in zip(here, moves, strict=True))
    force = np.array([face.total(change.traction) for change in along])
    seen = None if increment.loading.seen is None else np.asarray((increment.loading.seen @ moves.T).T)
    kept = moves if increment.equations.follow else None
    if at_rest is None:
        rates = tuple(np.zeros_like(change.traction) for change in along)  # `since`
        return PathDerivatives(force, along, rates, seen=seen, moves=kept)
    start = [_AlongAtRest(there, way, at_rest) for way in ways]
    courses = solved([each.forces() for each in start])
    rates = tuple(each.rate(du) for each, du in zip(start, courses, strict=True))
    stiffness = np.array([face.total(rate) for rate in rates])
    return PathDerivatives(force, along, rates, stiffness, seen, kept, None if kept is None else courses)


@dataclass(frozen=True, eq=False)
class _Along:
    """An equilibrium along one Direction, with the change of the contact's history."""

    there: Linearisation
    way: Direction
    history: History
    number: int

    def forces(self) -> Array:
        """Derivative (n,) of the residual at fixed u."""
        there, held, increment = self.there, self._contact(np.zeros_like(self.there.contact.place)), self.there.increment
        forces = _body_forces(there, self.way, there.at.u, there.state) + increment.equations.face.spread(held.traction)
        if increment.led is None:
            return forces
        return forces + increment.equations.slid_forces(there.at.u, increment.led, self.number, increment.loading.kappa)

    def change(self, du: Array) -> ContactChange:
        """Change of the contact with displacements du (n,)."""
        return self._contact(self.there.increment.equations.face.field(du))

    def _contact(self, place: Array) -> ContactChange:
        increment = self.there.increment
        springs = increment.loading.springs
        stiffer = springs.scaled(self.way.springs)
        return increment.equations.face.change(self.there.contact, springs, stiffer, self.way.friction, self.history, place)


def _body_forces(there: Linearisation, way: Direction, u: Array, state: BodyState) -> Array:
    """Derivative (n,) of the body's internal forces at fixed u."""
    body, fibre = there.increment.equations.body, there.increment.loading.fibre
    if way.turned:
        loading = there.increment.loading
        material, pressure = loading.material, body.pressure(state, loading.volumetric)
        return sum(
            (weight * body.residual(u, body.state(u, turned), material, pressure, turned) for weight, turned in way.turned),
            np.zeros_like(u),
        )
    gradient = np.zeros_like(state.I) if way.gradient is None else way.gradient(state.I)
    return body.forces(u, gradient, body.pressure(state, Volumetric(way.kappa, way.rest)), fibre)


@dataclass(frozen=True, eq=False)
class _AlongAtRest:
    """The untouched sample along one Direction; motion (n,): du/dd."""

    there: Linearisation
    way: Direction
    motion: Array = field(repr=False)

    def forces(self) -> Array:
        """Derivative (n,), by the direction, of the residual's derivative by the depth."""
        increment = self.there.increment
        body, face, loading = increment.equations.body, increment.equations.face, increment.loading
        small = AT_REST * self.motion
        return _body_forces(self.there, self.way, small, body.state(small, loading.fibre)) / AT_REST + face.spread(self._held())

    def rate(self, change: Array) -> Array:
        """Change of the traction's rate, with that of the motion (n,)."""
        return self._held() + np.einsum("fqij,fqj->fqi", self.there.contact.stiffness, self._face.field(change))

    def _held(self) -> Array:
        """Change of the traction's rate at fixed motion."""
        springs = self.there.increment.loading.springs.scaled(self.way.springs)
        D = self._face.stiffness_change(self.there.contact, springs)
        return np.einsum("fqij,fqj->fqi", D, self._face.field(self.motion) + UP)

    @property
    def _face(self) -> ContactFace:
        return self.there.increment.equations.face
