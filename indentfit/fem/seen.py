"""Displacements of points of a sample along a path, at the depths at which they were measured."""

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp

from indentfit.arrays import Array
from indentfit.fem.directions import OFFSET
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
    array (g,), mm; dict of name -> array (g,), mm per unit
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
    return seen, {name: by_name[name] for name in press.sensitivities if name in by_name}
