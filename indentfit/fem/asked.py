"""What is asked of a path: forces and displacements at the depths of a press, and their derivatives."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy.sparse as sp

from indentfit.arrays import Array
from indentfit.fem.directions import OFFSET, Direction
from indentfit.fem.equilibrium import Equilibrium
from indentfit.fem.interpolation import Interpolant
from indentfit.fem.observation import Observed
from indentfit.fem.setup import Press


def seen_along(
    press: Press, observed: Observed, path: Sequence[Equilibrium], rows: sp.csr_matrix, names: Sequence[str]
) -> tuple[Array, dict[str, Array]]:
    """Displacements that are seen, each at its own depth, and their derivatives by the requested names.

    Parameters
    ----------
    press : Press
    observed : Observed
    path : sequence of Equilibrium
    rows : CSR matrix (g, n)
        The rows of `observation.rows_of`.
    names : sequence of str
        The directions of the path, by which displacements were differentiated. The offset needs no direction.

    Returns
    -------
    array (m,), mm; dict of name -> array (m,), mm per unit
    """
    depths = [point.depth for point in path]
    between = Interpolant(depths, [rows @ point.u for point in path])
    places, which = np.unique(np.clip(observed.depths, 0.0, depths[-1]), return_inverse=True)
    each, pressed = np.arange(which.size), observed.depths > 0
    seen = between(places)[which, each]
    by_name = {OFFSET: np.where(pressed, -between.slope(places)[which, each], 0.0)} if OFFSET in press.sensitivities else {}
    known = [point.derivatives.seen for point in path if point.derivatives is not None]
    if names and len(known) == len(path):
        slopes = Interpolant(depths, known)(places)  # (n_places, n_d, g)
        by_name |= {name: slopes[which, n, each] for n, name in enumerate(names)}
    return observed.traced(seen, {name: by_name[name] for name in press.sensitivities if name in by_name})


def sensitivities_along(
    press: Press, ways: Sequence[Direction], path: Sequence[Equilibrium], copies: int, power: float
) -> dict[str, Array] | None:
    """Name -> derivative (n,) of the force, for the requested names; None where the path could not be differentiated."""
    by_name = {}
    if ways:
        forces = [point.derivatives.force for point in path if point.derivatives is not None]
        if len(forces) < len(path):
            return None
        rows = copies * along(path, forces, press, power).T
        by_name = dict(zip((way.name for way in ways), rows, strict=True))
    if OFFSET in press.sensitivities:
        by_name[OFFSET] = -copies * _slopes(path, press, power)
    return {name: by_name[name] for name in press.sensitivities}


def along(path: Sequence[Equilibrium], values: Sequence[Any], press: Press, power: float) -> Array:
    """Values (n_d, ...) at the depths of a press, from elastic values of a path's equilibria, which begin to grow by a power of the
    depth; those of a material that relaxes are hereditary integrals over the ramp."""
    between = Interpolant([point.depth for point in path], values, power)
    return between(press.depths) if press.in_time is None else press.in_time.forces(press.depths, between)


def _slopes(path: Sequence[Equilibrium], press: Press, power: float) -> Array:
    """Derivatives (n_d,) of the path's force by the depth, mN/mm: in a ramp at constant rate a relaxing material's force depends on
    the depth since contact alone."""
    between = Interpolant([point.depth for point in path], [point.whole_force for point in path], power)
    return between.slope(press.depths) if press.in_time is None else press.in_time.forces(press.depths, between.slope)
