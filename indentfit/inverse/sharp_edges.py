"""Points of a curve that no mesh computes well: those at which the surface has folded in at a sharp edge.

The force under a sharp edge that slides errs with the square of the depth, on every mesh (`fem.mesh_error`). A fit takes the points
up to the depth at which this error reaches the one that the mesh is made for, and says which it leaves out: deeper points would
decide the fit by what is known least about them.
"""

from dataclasses import dataclass

import numpy as np

from indentfit.case import Case
from indentfit.curve import Curve
from indentfit.fem.mesh_error import unfolded_depth
from indentfit.fem.setup import Setup
from indentfit.runs.points import setup_of

FEWEST = 4  # points that a curve must have left; all of them are fitted otherwise
LEFT_OUT = "not all points are fitted: "
SAID = (
    LEFT_OUT
    + "{test} to {depth:.3g} mm, its first {kept} of {points} points; beyond, the surface folds in at the sharp edge, and no "
    "mesh keeps the error of the force within {error:.2g} (state the edge's radius, indenter.edge_radius, to fit all)"
)


@dataclass(frozen=True)
class Shallower:
    """A case with the points that can be fitted, and what is said of each curve that has lost some."""

    case: Case
    said: tuple[str, ...] = ()


def without_folds(case: Case) -> Shallower:
    """The case with curves that end where a sharp edge begins to fold in; the case itself where none does.

    Parameters
    ----------
    case : Case

    Returns
    -------
    Shallower
    """
    if case.relaxation is not None:
        return Shallower(case)
    setups = {test.name: setup_of(piece) for piece in case.pieces for test in piece.tests}
    curves, said = list(case.curves), []
    for n, (test, curve) in enumerate(zip(case.tests, case.curves, strict=True)):
        setup = setups.get(test.name)
        part = None if curve is None or setup is None else _first_points(curve, setup)
        if part is None or curve is None or setup is None:
            continue
        curves[n] = part
        said.append(
            SAID.format(
                test=test.name,
                depth=part.displacement[-1],
                kept=part.force.size,
                points=curve.force.size,
                error=setup.mesh.wanted_error,
            )
        )
    return Shallower(case.model_copy(update={"curves": tuple(curves)}), tuple(said)) if said else Shallower(case)


def _first_points(curve: Curve, setup: Setup) -> Curve | None:
    """The points of a curve that are kept; None where all are, or where too few would be."""
    kept = np.flatnonzero(curve.displacement <= unfolded_depth(setup) * (1 + 1e-9))
    return None if kept.size == curve.force.size or kept.size < FEWEST else curve.part(kept)
