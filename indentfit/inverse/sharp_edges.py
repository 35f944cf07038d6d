"""Points of a curve that no mesh computes well: those at which the surface has folded in at a sharp edge.

The force under a sharp edge that slides errs with the square of the depth, on every mesh (`fem.mesh_error`). A fit takes the points
up to the depth at which this error reaches the one that the mesh is made for, and says which it leaves out: deeper points would
decide the fit by what is known least about them.
"""

from dataclasses import dataclass

import numpy as np

from indentfit.case import Case
from indentfit.errors import CaseError
from indentfit.fem.mesh_error import unfolded_depth
from indentfit.runs.points import setup_of

FEWEST = 4  # points that a curve must have left; all of them are fitted otherwise
LEFT_OUT = "not all points are fitted: "
FOLDED = "folded points are fitted: "
SAID = (
    LEFT_OUT
    + "{test} to {depth:.3g} mm, its first {kept} of {points} points; beyond, the surface folds in at the sharp edge, and no "
    "mesh keeps the error of the force within {error:.2g} (state the edge's radius, indenter.edge_radius, to fit all)"
)

ALL_FITTED = (
    FOLDED + "{test} beyond {depth:.3g} mm, where the surface folds in at the sharp edge and no mesh keeps the error of the force "
    "within {error:.2g}; {why} (state the edge's radius, indenter.edge_radius)"
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
    setups = {test.name: setup_of(piece) for piece in case.pieces for test in piece.tests}
    curves, said = list(case.curves), []
    for n, (test, curve) in enumerate(zip(case.tests, case.curves, strict=True)):
        setup = setups.get(test.name)
        if curve is None or setup is None:
            continue
        depth = unfolded_depth(setup)
        kept = np.flatnonzero(curve.displacement <= depth * (1 + 1e-9))
        facts = {"test": test.name, "depth": depth, "error": setup.mesh.wanted_error}
        if kept.size == curve.force.size:
            continue
        if case.relaxation is not None:
            said.append(ALL_FITTED.format(**facts, why="a curve in time is fitted whole"))
        elif kept.size < FEWEST:
            said.append(ALL_FITTED.format(**facts, why=f"too few of its points, {kept.size}, lie above that depth"))
        elif test.field:
            text = f"test.{test.name}.field: the surface of this test folds in at the sharp edge beyond {depth:.3g} mm; state"
            raise CaseError([f"{text} indenter.edge_radius, so that all points can be fitted, or remove the field"])
        else:
            curves[n] = part = curve.part(kept)
            facts["depth"] = float(part.displacement[-1])
            said.append(SAID.format(**facts, kept=kept.size, points=curve.force.size))
    cut = any(now is not before for now, before in zip(curves, case.curves, strict=True))
    return Shallower(case.model_copy(update={"curves": tuple(curves)}) if cut else case, tuple(said))
