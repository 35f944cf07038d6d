"""Quantities by which a path can be differentiated: parameters of the material, friction, the bulk ratio, the offset, and the angle
of the fibres."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from indentfit.arrays import Array
from indentfit.errors import InputError
from indentfit.material import REST, Material

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
    kappa : float, kPa
        Change of the bulk modulus.
    springs : float
        Relative change of the contact springs.
    friction : float
        Change of the coefficient of friction.
    turned : tuple of (weight, array (3,))
        Directions of the fibres whose internal forces, times their weights, add up to the change of the forces.
    """

    name: str
    gradient: Callable[[Array], Array] | None = None
    kappa: float = 0.0
    springs: float = 0.0
    friction: float = 0.0
    turned: tuple[tuple[float, Array], ...] = ()


def directions(
    names: Iterable[str], material: Material, kappa: float, stiffness: Callable[[Material], float], friction: float
) -> tuple[Direction, ...]:
    """The Direction of each name.

    Parameters
    ----------
    names
        Parameters of the material, "friction", "bulk_ratio" (kappa over shear modulus), and "offset" and
        "fibre_angle", which are not among the results (`of_fibre_angle`).
    kappa : float, kPa
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
        if name in type(material).parameters:
            ways.append(_of_parameter(name, material, kappa, stiffness))
        elif name == "bulk_ratio":
            ways.append(Direction(name, kappa=material.shear_modulus))
        elif name == "friction" and np.isfinite(friction):
            ways.append(Direction(name, friction=1.0))
        elif name not in (OFFSET, FIBRE_ANGLE):
            known = ", ".join([*type(material).parameters, "friction", "bulk_ratio", OFFSET, FIBRE_ANGLE])
            raise InputError(f"no sensitivity to {name!r} here; known: {known} (friction: where it is a number)")
    return tuple(ways)


def of_fibre_angle(fibre: Callable[[float], Array], stiffness: Callable[[Array], float]) -> Direction:
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


def _of_parameter(name: str, material: Material, kappa: float, stiffness: Callable[[Material], float]) -> Direction:
    row = list(type(material).parameters).index(name)
    at_rest = material.parameter_gradient(REST)[row]
    relative = kappa / material.shear_modulus
    return Direction(
        name,
        gradient=lambda I: material.parameter_gradient(I)[row],
        kappa=relative * float(2 * at_rest[:2].sum()),
        springs=_relative_change(name, material, stiffness),
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
