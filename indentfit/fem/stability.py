"""Whether a law without fibres stays stable in a body along a path of equilibria."""

from collections.abc import Sequence

import numpy as np

from indentfit.digits import quantity
from indentfit.fem.body import Body
from indentfit.fem.equilibrium import Equilibrium
from indentfit.fibres import Fibre
from indentfit.indenters import IndenterShape
from indentfit.material import FIRST_FAMILY, SECOND_FAMILY, Material, least_shear_modulus


def remedy(law: Material, start: float | None, shape: IndenterShape) -> str:
    """What to do about a path that ends early, where its law loses its stability from a depth `start` (mm) on, or does not."""
    if law.unstable:
        return f"the material is not stable at small strain ({law.unstable})"
    if start is not None:
        at = quantity(start, "mm", 3)
        return f"the law loses its stability at {at} (its shear stress falls as the shear grows); check its parameters"
    return "try a coarser mesh" + ("" if shape.edge_radius is None else " or an edge radius")


def loss_of_stability(
    body: Body, path: Sequence[Equilibrium], law: Material, placed: Material, fibre: Fibre
) -> tuple[float | None, float]:
    """Where along a path the law no longer resists one more shear at some point of the body.

    Parameters
    ----------
    body : Body
    path : sequence of Equilibrium
        The first one is the untouched sample.
    law, placed : Material
        The law, and the same where the body has it.
    fibre : Fibre

    Returns
    -------
    depth : float or None, mm
        Depth of the first equilibrium at which this is so; None where it is not so at the last one, or the law has fibres.
    share : float
        Share of the integration points at the last equilibrium.
    """
    if {*FIRST_FAMILY, *SECOND_FAMILY} & set(law.invariants):
        return None, 0.0

    def share(point: Equilibrium) -> float:
        return float(np.mean(least_shear_modulus(placed, body.state(point.u, fibre).I) <= 0))

    last = share(path[-1])
    if not last:
        return None, 0.0
    return next(point.depth for point in path if point is path[-1] or share(point)), last
