"""Quantities by which a path can be differentiated: parameters of the material, friction, the bulk ratio, the offset, and the angle
of the fibres."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from indentfit.arrays import Array
from indentfit.errors import InputError
from indentfit.fem.body import Bulk
from indentfit.fem.sliding import TOGETHER
from indentfit.fibres import Fibre
from indentfit.material import Layered, Material, parts_of, rest_pressure_changes

NUDGE = 1e-5  # relative step of the one numerical derivative, that of the springs' stiffness
OFFSET = "offset"  # of the contact point, mm: F(d - offset)
FIBRE_ANGLE = "fibre_angle"  # degrees by which the fibres are turned
# Places, degrees, and weights of the derivative by the fibres' angle at fixed displacements: forces are smooth functions of the
# angle that change over tens of degrees, so that the error of this rule of the fourth order is that of round-off.
TURNS = ((-0.1, 1 / 0.6), (-0.05, -8 / 0.6), (0.05, 8 / 0.6), (0.1, -1 / 0.6))


@dataclass(frozen=True)
class Direction:
    """One quantity by which the path is differentiated, with the changes per unit of it.

    Attributes
    ----------
    gradient : function or None
        I (4, n) -> change (4, n) of the energy's derivatives by the invariants, kPa.
    kappa : float, or array (n_el, 1), kPa
        Change of the bulk modulus.
    springs : float
        Relative change of the contact springs.
    friction : float
        Change of the coefficient of friction.
    turned : tuple of (weight, array (3,))
        Directions of the fibres whose internal forces, times their weights, add up to the change of the forces.
    rest : float, or array (n_el, 1), kPa
        Change of the untouched sample's pressure.
    """

    name: str
    gradient: Callable[[Array], Array] | None = None
    kappa: Bulk = 0.0
    springs: float = 0.0
    friction: float = 0.0
    turned: tuple[tuple[float, Fibre], ...] = ()
    rest: Bulk = 0.0


@dataclass(frozen=True)
class Solids:
    """The material of a run, which may be that of several layers.

    Attributes
    ----------
    material : Material
    placed : Material
        What the body asks of it, which knows the layer of each integration point.
    kappas : tuple of float, kPa
        Bulk modulus of each layer.
    stretch : float or None
        Stretch of the sample along x before the indentation.
    of_elements : function
        Moduli of the layers, and of the interfaces that slide -> modulus of each element (n_el, 1); the number itself, where there
        is one.
    """

    material: Material
    placed: Material
    kappas: tuple[float, ...]
    stretch: float | None
    of_elements: Callable[[Sequence[float], float], Bulk]


def directions(
    names: Iterable[str], solid: Solids, stiffness: Callable[[Material], float], friction: float
) -> tuple[Direction, ...]:
    """The Direction of each name.

    Parameters
    ----------
    names : iterable of str
        Parameters of the material, "friction", "bulk_ratio" (kappa over shear modulus), and "offset" and
        "fibre_angle", which are not among the results (`of_fibre_angle`).
    solid : Solids
    stiffness : function
        Material -> stiffness of the contact springs, whose relative change is found by differences.
    friction : float
        The contact's coefficient of friction; infinite where the contact sticks.

    Returns
    -------
    tuple of Direction

    Raises
    ------
    InputError
        The path cannot be differentiated by one of the names.
    """
    ways = []
    for name in names:
        if name in type(solid.material).parameters:
            ways.append(_of_parameter(name, solid, stiffness))
        elif name == "bulk_ratio":
            ways.append(Direction(name, kappa=solid.of_elements([part.shear_modulus for part in parts_of(solid.material)], 0.0)))
        elif name == "friction" and np.isfinite(friction):
            ways.append(Direction(name, friction=1.0))
        elif name not in (OFFSET, FIBRE_ANGLE):
            known = ", ".join([*type(solid.material).parameters, "friction", "bulk_ratio", OFFSET, FIBRE_ANGLE])
            raise InputError(f"no sensitivity to {name!r} here; known: {known} (friction: where it is a number)")
    return tuple(ways)


def of_fibre_angle(fibre: Callable[[float], Fibre], stiffness: Callable[[Fibre], float]) -> Direction:
    """The Direction of an angle about y, degrees, by which the fibres are turned.

    Parameters
    ----------
    fibre : function
        Angle by which the fibres are turned -> their direction (3,).
    stiffness : function
        Direction of the fibres -> stiffness of the contact springs.
    """
    turned = tuple((weight, fibre(angle)) for angle, weight in TURNS)
    springs = sum(weight * stiffness(there) for weight, there in turned) / stiffness(fibre(0.0))
    return Direction(FIBRE_ANGLE, springs=springs, turned=turned)


def _of_parameter(name: str, solid: Solids, stiffness: Callable[[Material], float]) -> Direction:
    material, placed = solid.material, solid.placed
    row = list(type(material).parameters).index(name)
    number, own = material.place_of(name) if isinstance(material, Layered) else (0, name)
    part, kappas = parts_of(material)[number], [0.0] * len(solid.kappas)
    place, rests = list(type(part).parameters).index(own), [0.0] * len(solid.kappas)
    at_rest = part.parameter_gradient(part.rest)[place]
    if solid.stretch is not None:
        rests[number] = float(rest_pressure_changes(part, solid.stretch)[place])
    stiffer = float(2 * at_rest[:2].sum())
    kappas[number] = solid.kappas[number] / part.shear_modulus * stiffer
    return Direction(
        name,
        gradient=lambda I: placed.parameter_gradient(I)[row],
        kappa=solid.of_elements(kappas, TOGETHER * stiffer if number == 0 else 0.0),
        springs=_relative_change(name, material, stiffness),
        rest=solid.of_elements(rests, 0.0),
    )


def _relative_change(name: str, material: Material, stiffness: Callable[[Material], float]) -> float:
    """Relative change of the springs by a parameter, from differences that stay within its bounds."""
    value, parameter = getattr(material, name), type(material).parameters[name]
    step = NUDGE * max(abs(value), 1e-3)
    low, high = value - step, value + step
    low = value if parameter.min is not None and low < parameter.min else low
    high = value if parameter.max is not None and high > parameter.max else high
    change = stiffness(material.replace(**{name: high})) - stiffness(material.replace(**{name: low}))
    return change / (high - low) / stiffness(material)
