"""What a fit needs before its first run, and everything that it refuses until then."""

from __future__ import annotations

from dataclasses import dataclass

from indentfit.case import Case
from indentfit.case.field_tests import with_field_tests
from indentfit.case.prior_tests import with_prior_tests
from indentfit.case.uses import require_fittable
from indentfit.errors import CaseError
from indentfit.inference.sampling import require_emcee
from indentfit.inference.wide_fit import widens
from indentfit.inverse.dense_curves import Averaged, averaged
from indentfit.inverse.problem import InverseProblem, inverse_problem
from indentfit.inverse.sharp_edges import Shallower, without_folds
from indentfit.runs.pieces import Piece, pieces_of


@dataclass(frozen=True, eq=False)
class Accepted:
    """A case that a fit accepts.

    Parameters
    ----------
    uncut : Case
        With tests of the moduli that it states beforehand.
    shallower : Shallower
        Without the points beyond which a surface folds in at a sharp edge.
    averaged : Averaged
        That case, with means of neighbours in the place of dense curves.
    case : Case
        The same, with measured displacements as tests of their own.
    problem : InverseProblem
    widens : bool
        Whether uncertain inputs are coordinates of the fit.
    pieces : list of Piece
        With their meshes.
    """

    uncut: Case
    shallower: Shallower
    averaged: Averaged
    case: Case
    problem: InverseProblem
    widens: bool
    pieces: list[Piece]


def accepted(case: Case) -> Accepted:
    """The `Accepted` of a case; nothing is solved.

    Raises
    ------
    CaseError
        The case can be simulated but not fitted; the error's text has one line for each fault.
    MeshError
        A sample and an indenter cannot be meshed.
    """
    uncut = with_prior_tests(case)
    require_fittable(with_field_tests(uncut))
    shallower = without_folds(uncut)
    few = averaged(shallower.case)
    case = with_field_tests(few.case)
    if case.fit.posterior:
        require_emcee()
    problem = inverse_problem(case)
    wide = widens(case, problem)
    if case is not few.case and wide:
        uncertain = ", ".join(f"fit.uncertain.{name}" for name in case.fit.uncertain.given if name != "mesh")
        raise CaseError(
            [
                f"{uncertain or 'fit.uncertain'}: inputs are not fitted beside displacements yet; state them as known (an input "
                "that is left out is unknown), or take out test.field"
            ]
        )
    return Accepted(uncut, shallower, few, case, problem, wide, pieces_of(case))
