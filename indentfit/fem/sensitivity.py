"""Exact sensitivities: the converged load path differentiated by parameters, contact and friction history included.

At each equilibrium R(u, theta, h) = 0 the tangent K = dR/du is factorised already, so the derivative by theta costs one
back-substitution,

    K u' = - dR/dtheta - dR/dh h',

where h are the contact's multipliers and anchors. They follow from the steps before, and their derivatives h' by the same
rules (direct differentiation of a path-dependent problem: Michaleris, Tortorelli and Vidal 1994). What is differentiated is the
discrete path: with the same steps, central differences tend to these derivatives.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from indentfit.errors import InputError
from indentfit.fem.contact import UP, Change
from indentfit.material import REST

ACCURACY = 1e-9  # relative residual of the linear solves
NUDGE = 1e-5  # relative step of the one numerical derivative, that of the springs' stiffness
AT_REST = 1e-6  # mm per mm of depth: a motion so small that the body's forces are linear in it
OFFSET = "offset"  # of the contact point, mm: F(d - offset)


@dataclass(frozen=True)
class Direction:
    """One quantity that the path is differentiated by, and what changes with it per unit.

    gradient: I (4, n) -> change (4, n) of the energy's derivatives by the invariants, kPa, or None; kappa: of the bulk modulus;
    springs: relative change of the contact springs; friction: of the coefficient of friction.
    """

    name: str
    gradient: Callable | None = None
    kappa: float = 0.0
    springs: float = 0.0
    friction: float = 0.0


@dataclass(frozen=True)
class Slopes:
    """Derivatives of an equilibrium by each Direction, first axis: force (n_d,) of the quarter, mN; the touch's changes; the
    changes of the traction's rate (n_f, n_q, 3); at rest also of the stiffness (n_d,), mN/mm."""

    force: np.ndarray
    changes: tuple[Change, ...] = field(repr=False)
    rates: tuple[np.ndarray, ...] = field(repr=False)
    stiffness: np.ndarray | None = None

    def since(self, before, step):
        """With the rates that belong to the secant from the slopes `before`, a step of the depth (mm) earlier."""
        pairs = zip(self.changes, before.changes, strict=True)
        return replace(self, rates=tuple((here.traction - there.traction) / step for here, there in pairs))

    def advanced(self, touch, rate, step):
        """Derivatives of `touch.advanced(rate, step)`: a History for each Direction."""
        return tuple(change.advanced(touch, rate, rates, step) for change, rates in zip(self.changes, self.rates, strict=True))


def directions(names, material, kappa, stiffness, friction):
    """Directions of names: parameters of the material, "friction", "bulk_ratio" (kappa / mu), and "offset", which needs none.

    stiffness: material -> stiffness of the contact springs, whose relative change is found by differences; friction: the
    contact's coefficient. Raises InputError for other names.
    """
    found = []
    for name in names:
        if name in type(material).parameters:
            found.append(_of_parameter(name, material, kappa, stiffness))
        elif name == "bulk_ratio":
            found.append(Direction(name, kappa=material.shear_modulus))
        elif name == "friction" and np.isfinite(friction):
            found.append(Direction(name, friction=1.0))
        elif name != OFFSET:
            known = ", ".join([*type(material).parameters, "friction", "bulk_ratio", OFFSET])
            raise InputError(f"no sensitivity to {name!r} here; known: {known} (friction: where it is a number)")
    return tuple(found)


def _of_parameter(name, material, kappa, stiffness):
    row = list(type(material).parameters).index(name)
    at_rest = material.parameter_gradient(REST)[row]
    relative = kappa / material.shear_modulus
    return Direction(
        name,
        gradient=lambda I: material.parameter_gradient(I)[row],
        kappa=relative * float(2 * at_rest[:2].sum()),
        springs=_relative_change(name, material, stiffness),
    )


def _relative_change(name, material, stiffness):
    """Relative change of the springs by a parameter, from differences that stay within its bounds."""
    value, parameter = getattr(material, name), type(material).parameters[name]
    step = NUDGE * max(abs(value), 1e-3)
    low, high = value - step, value + step
    low, high = (value if parameter.min is not None and low < parameter.min else low), high
    if parameter.max is not None and high > parameter.max:
        high = value
    change = stiffness(material.replace(**{name: high})) - stiffness(material.replace(**{name: low}))
    return change / (high - low) / stiffness(material)


# ---- along the path ----------------------------------------------------------------------------------------------


def at_equilibrium(system, u, solver, at_rest=None):
    """Slopes of the equilibrium u of a system (newton._System) whose history changes by `system.changes`.

    at_rest: du/dd (n,) of the untouched sample, where this is it: its rates are then those of its tangent.
    """
    found = [_along(system, way, history, u, solver) for way, history in zip(system.load.directions, system.changes, strict=True)]
    force = np.array([system.contact.total(change.traction) for change in found])
    if at_rest is None:
        return Slopes(force, tuple(found), tuple(np.zeros_like(change.traction) for change in found))  # `since` sets them
    rates = tuple(_rate_at_rest(system, way, at_rest, solver) for way in system.load.directions)
    return Slopes(force, tuple(found), rates, np.array([system.contact.total(rate) for rate in rates]))


def _along(system, way, history, u, solver):
    """Change of the touch at an equilibrium u along one Direction, the history changing with it."""
    load, contact, touch = system.load, system.contact, system.touch

    def change(place):
        return contact.change(touch, load.springs, load.springs.scaled(way.springs), way.friction, history, place)

    held = change(np.zeros_like(touch.place))
    du = _solve(system, solver, _body_forces(system, way, u, system.state) + contact.spread(held.traction))
    return change(contact.field(du))


def _body_forces(system, way, u, state):
    """Derivative (n,) of the body's internal forces at fixed u."""
    load, body = system.load, system.body
    gradient = np.zeros_like(state.I) if way.gradient is None else way.gradient(state.I)
    return body.forces(u, gradient, body.pressure(state, way.kappa), load.fibre)


def _rate_at_rest(system, way, direction, solver):
    """Change of the traction's rate of the untouched sample, whose tangent is that of its rest."""
    contact, touch = system.contact, system.touch
    small = AT_REST * direction
    springs = system.load.springs.scaled(way.springs)
    D = contact.stiffness_change(touch, springs)
    moved = contact.field(direction) + UP
    load_vector = _body_forces(system, way, small, system.body.state(small, system.load.fibre)) / AT_REST
    held = np.einsum("fqij,fqj->fqi", D, moved)
    change = _solve(system, solver, load_vector + contact.spread(held))
    return held + np.einsum("fqij,fqj->fqi", touch.D, contact.field(change))


def _solve(system, solver, load_vector):
    load_vector[system.fixed.dofs] = 0
    return solver.solve(system.tangent, -load_vector, ACCURACY)
