"""A fit whose intervals would mostly be the error of its mesh: runs on a finer mesh at the optimum correct all other curves.

The runs of the search stay those of the case's mesh; a finer mesh is run at the optimum only, once or twice. A mesh that the case
states is never refined: a note then says what a finer mesh would cost.
"""

from dataclasses import dataclass, replace

import numpy as np

from indentfit.case import Case
from indentfit.fem.mesh_error import ORDER, RATIO
from indentfit.fem.meshing import count, resized
from indentfit.inference.identifiability import Identifiability, identifiability
from indentfit.inference.inputs import MOVES, Solution
from indentfit.inverse.exploration import Watched
from indentfit.inverse.mesh_correction import Corrected, MeshCorrection
from indentfit.inverse.methods import Solved, solved_again
from indentfit.inverse.problem import InverseProblem
from indentfit.inverse.progress import SILENT, Progress
from indentfit.runs.points import setup_of

DOMINATES = 0.5  # share of a parameter's variance from which the mesh is refined
FINEST = {"axisymmetric": 4.0, "quarter": 1.6}  # largest factor by which elements become narrower
COST = {"axisymmetric": 1.2, "quarter": 1.6}  # power of the number of elements with which the time of a run grows
MOVED = 0.5  # of a standard error: an optimum that moves by less after a finer run needs no other
ROUNDS = 2
REFINED = (
    "the mesh of {own} elements was refined: its error would have been {share:.0%} of the variance of {name}; runs on {finest} "
    "elements at {points} correct all curves"
)
KEPT = (
    "the error of the mesh is {share:.0%} of the variance of {name}; the mesh that the case states is kept: {wanted:,} elements "
    "would have less, and cost about {cost:.2g} times as much"
)


@dataclass(frozen=True, eq=False)
class Refined:
    """A Solved, the factor by which the mesh that corrects its curves is finer, if one does, and what the user should know."""

    solved: Solved
    factor: float | None = None
    notes: tuple[str, ...] = ()


def refined(
    case: Case, problem: InverseProblem, model: Watched, solved: Solved, correction: MeshCorrection, progress: Progress = SILENT
) -> Refined:
    """The Solved on a mesh that is fine enough for its intervals, where the case leaves the choice of the mesh open.

    Parameters
    ----------
    case : Case
    problem : InverseProblem
    model : Watched
        The model of `solved`.
    solved : Solved
    correction : MeshCorrection
        That of `solved`.
    progress : Progress

    Returns
    -------
    Refined
    """
    if not isinstance(model, Corrected) or model.error.remark:  # where a finer mesh errs as much, none is tried
        return Refined(solved)
    name, share, known = _most(case, problem, model, solved)
    if known is None or share <= DOMINATES:
        return Refined(solved)
    kind = "axisymmetric" if all(setup_of(piece).in_plane for piece in case.pieces) else "quarter"
    wanted = (share / (1 - share) if share < 1 else np.inf) ** (0.5 / ORDER[case.solver.element])
    finer = float(np.clip(wanted, min(RATIO[kind], FINEST[kind]), FINEST[kind]))
    if not case.mesh.default:
        own, many = _elements(case), _elements(case, finer)
        said = KEPT.format(share=share, name=name, wanted=many, cost=(many / own) ** COST[kind])
        return Refined(solved, notes=(said,))
    return _with_finer(_Fitted(case, problem, model, solved, known), correction, finer, (name, share), progress)


def _elements(case: Case, finer: float = 1.0) -> int:
    """Number of elements of a mesh whose elements are narrower by a factor; of several meshes, their mean."""
    counts = [count(resized(setup_of(piece), 1 / finer)) for piece in case.pieces]
    return round(sum(counts) / len(counts))


@dataclass(frozen=True, eq=False)
class _Fitted:
    case: Case
    problem: InverseProblem
    model: Watched
    solved: Solved
    known: Identifiability


def _with_finer(fit: _Fitted, correction: MeshCorrection, finer: float, worst: tuple[str, float], progress: Progress) -> Refined:
    """The Solved with curves that runs on a finer mesh correct; the Solved itself where these runs fail."""
    case, problem, solved = fit.case, fit.problem, fit.solved
    finest = _elements(case, finer)
    for number in range(1, ROUNDS + 1):
        best = solved.optimum.best
        assert best is not None  # `refined` has seen to that
        progress(0.0, f"runs on {finest} elements, {number}")
        before = correction.error
        model = correction.of(problem, fit.model, best.parameters, finer)
        if correction.missing:
            correction.error = before
            return Refined(solved, notes=(f"the mesh could not be refined: {correction.missing}",))
        after = solved_again(problem, model, solved, case.fit, progress)
        if after.optimum.best is None or not after.optimum.derivatives:
            break
        step = np.abs(problem.units(after.optimum.best.parameters) - problem.units(best.parameters))
        solved = replace(after, said=solved.said)
        sizes = fit.known.stderr / problem.per_units(best.parameters)
        if not np.any(step > MOVED * np.where(np.isfinite(sizes), sizes, np.inf)):
            break
    points = "the optimum" if number == 1 else f"{number} sets of parameters"
    said = REFINED.format(own=_elements(case), share=worst[1], name=worst[0], finest=finest, points=points)
    return Refined(solved, finer, (said,))


def _most(case: Case, problem: InverseProblem, model: Watched, solved: Solved) -> tuple[str, float, Identifiability | None]:
    """The parameter in whose variance the mesh has the largest share, and that share; an interval that is no wider than the error
    which the case asks of its mesh is good enough, and has no share."""
    best, slopes = solved.optimum.best, solved.optimum.derivatives
    if best is None or not slopes:
        return "", 0.0, None
    known = identifiability(problem, best, slopes, solved.exploration.equation_one)
    moves = MOVES["mesh"](Solution(case, problem, model, best, known), case.fit.uncertain.mesh)
    variance = (moves.rows**2).sum(axis=0)
    own, values = np.diag(known.errors.covar), np.abs(problem.values(best.parameters))
    with np.errstate(invalid="ignore", divide="ignore"):
        shares = np.where(
            known.quantile * np.sqrt(own + variance) > case.mesh.wanted_error * values, variance / (own + variance), 0.0
        )
    shares = np.nan_to_num(shares, nan=0.0, posinf=0.0)
    worst = int(np.argmax(shares))
    return list(problem.free)[worst], float(shares[worst]), known
