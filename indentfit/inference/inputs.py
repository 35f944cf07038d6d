"""Uncertain inputs of the model, and the effect of their errors on the parameters.

Friction, bulk ratio, thickness and the contact point (`offset`: the depth by which contact begins later, F(d - offset)) change
the curves. An estimate follows such a change as it follows noise, linearly: d theta = - estimator . dF/d input. The derivatives
are those of the mechanics where it has them, otherwise differences of runs with the input changed. `force` is an error common to
all forces of a test; `mesh` is what the correction for the mesh (inverse.mesh_correction) leaves of its error, a smooth function of
the depth. `base` has two values only: its effect is the change of the parameters on the other base, whose probability the case
states.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import scipy.optimize

from indentfit.arrays import Array
from indentfit.case import Case
from indentfit.inference.identifiability import Identifiability
from indentfit.inference.shares import InputShare
from indentfit.inverse.derivatives import Underivable, derivatives_at, last_cause
from indentfit.inverse.mesh_correction import Corrected, mesh_error_at
from indentfit.inverse.problem import Candidate, InverseProblem
from indentfit.inverse.wide import OTHER_BASE
from indentfit.runs.forward import ForwardModel
from indentfit.runs.points import KEYS, case_at

EXACT = ("friction", "bulk_ratio", "offset")  # inputs by which the mechanics can differentiate
STEP = 0.05  # relative step of an input, for differences
LEAST_FRICTION = 0.02  # step of a small friction coefficient
CORRECTED = (
    "the curves are corrected for the mesh by up to {most:.1%}, by a mesh of about {elements} elements; +- {sd:.2%} stays uncertain"
)
NOT_CORRECTED = "the curves are not corrected for the mesh, whose error of +- {sd:.2%} is in the intervals: {remark}"


@dataclass(frozen=True, eq=False)
class Solution:
    """A solved inverse problem, whose inputs may be uncertain: the case, the problem, the model, and the best Candidate with its
    Identifiability by the noise alone."""

    case: Case
    problem: InverseProblem
    model: ForwardModel
    best: Candidate
    known: Identifiability

    def estimators(self) -> Iterator[tuple[int, Array]]:
        """The number of each test that has a weight, and the map from changes of its curve to those of the estimates, (p, n)."""
        heavy = [n for n, weight in enumerate(self.known.weights) if weight]
        return zip(heavy, self.known.errors.estimator, strict=True)


@dataclass(frozen=True, eq=False)
class Moves:
    """The effect of the error of one input on the estimates.

    Parameters
    ----------
    rows : array (k, p)
        Changes of the estimates, a row for each independent error of one standard deviation.
    share : InputShare
        Facts about the input; its effect and share are filled in by `shares`.
    effect : array (p,) or None
        The change that the result states, where it differs from that of the rows.
    """

    rows: Array
    share: InputShare
    effect: Array | None = None

    def stated(self) -> Array:
        """The change of each parameter that the result states, (p,)."""
        if self.effect is not None:
            return self.effect
        return self.rows[0] if len(self.rows) == 1 else np.linalg.norm(self.rows, axis=0)


@dataclass(frozen=True, eq=False)
class Shares:
    """The shares of uncertain inputs in the errors.

    Parameters
    ----------
    covar : array (p, p)
        Covariance by all inputs together.
    rows : dict of input -> InputShare
        Every test has an error of its own by `force` and by `mesh`; the stated effect is the root of the sum of squares.
    noise : dict of name -> share of the noise in the parameter's variance
    missing : dict of input -> why there is no share
    """

    covar: Array
    rows: dict[str, InputShare]
    noise: dict[str, float | None] = field(default_factory=dict)
    missing: dict[str, str] = field(default_factory=dict)


def shares(solution: Solution) -> Shares:
    """The shares of the uncertain inputs of a case in the errors of its parameters."""
    moves, missing = {}, {}
    for name, spread in solution.case.fit.uncertain.given.items():
        if name == "mesh" and not solution.case.indentations:
            continue
        try:
            moves[name] = MOVES[name](solution, spread) if name in MOVES else _of_input(solution, name, spread)
        except Underivable as failure:
            missing[name] = str(failure)
    own = np.diag(solution.known.errors.covar)
    covar = sum((move.rows.T @ move.rows for move in moves.values()), np.zeros_like(solution.known.errors.covar))
    variance = own + np.diag(covar)
    whole = np.where(variance > 0, variance, 1.0)
    names = list(solution.problem.free)
    rows = {}
    for name, move in moves.items():
        share = _named(names, (move.rows**2).sum(axis=0) / whole)
        rows[name] = replace(move.share, effect=_named(names, move.stated()), share=share)
    return Shares(covar, rows, _named(names, own / whole), missing)


def _of_force(solution: Solution, spread: float) -> Moves:
    """An error common to all forces of a test."""
    tests = solution.problem.tests  # displacements have no error of the load cell
    rows = spread * np.array([0 * B[:, 0] if tests[n].moves else B @ solution.best.forces[n] for n, B in solution.estimators()])
    return Moves(rows, InputShare(1.0, spread))


def _of_mesh(solution: Solution, spread: float) -> Moves:
    """What the correction for the mesh leaves: independent smooth errors of each test; where the curves are not corrected, the
    correction is an error too."""
    model, best = solution.model, solution.best
    corrected = isinstance(model, Corrected)
    error = model.error if isinstance(model, Corrected) else mesh_error_at(solution.case, solution.problem, model, best.parameters)
    rows = []
    for n, B in solution.estimators():
        errors = error.independent(n) if corrected else np.vstack([error.independent(n), error.correction[n]])
        rows.append(spread * (errors * best.forces[n]) @ B.T)
    return Moves(np.concatenate(rows), InputShare(0.0, spread * error.sd, elements=error.elements))


def _of_base(solution: Solution, spread: float) -> Moves:
    """The parameters on the other base: a Gauss-Newton step within the bounds, from the curves there to the fitted curves."""
    problem, best, known = solution.problem, solution.best, solution.known
    base = solution.case.sample.base
    slopes, forces = derivatives_at(problem, solution.model, {**best.parameters, "sample.base": OTHER_BASE[base]})
    heavy = [n for n, weight in enumerate(known.weights) if weight]
    roots = [np.sqrt(known.weights[n]) * problem.tests[n].curve.trust for n in heavy]
    A = np.concatenate([root[:, None] * slopes[n] for root, n in zip(roots, heavy, strict=True)])
    b = np.concatenate([root * (best.forces[n] - forces[n]) for root, n in zip(roots, heavy, strict=True)])
    x = problem.units(best.parameters)
    effect = problem.per_units(best.parameters) * scipy.optimize.lsq_linear(A, b, (-x - 1e-12, 1 - x + 1e-12), tol=1e-14).x
    return Moves(np.sqrt(spread) * effect[None], InputShare(base, None, probability=spread), effect)


def _of_input(solution: Solution, name: str, spread: float) -> Moves:
    slopes = input_derivatives(solution.case, solution.problem, solution.model, solution.best, name)
    move = -spread * np.sum([B @ slopes[n] for n, B in solution.estimators()], axis=0)
    return Moves(move[None], InputShare(value_of(solution.case, solution.best, name), spread))


MOVES: dict[str, Callable[[Solution, float], Moves]] = {"force": _of_force, "mesh": _of_mesh, "base": _of_base}


def value_of(case: Case, best: Candidate, name: str) -> float:
    """The value of an uncertain input at a Candidate; the offset of the contact point is that of the curves."""
    if name == "offset":
        return 0.0
    table, key = KEYS[name].split(".")
    return getattr(getattr(case_at(case, best.parameters), table), key)


def input_derivatives(case: Case, problem: InverseProblem, model: ForwardModel, best: Candidate, name: str) -> Sequence[Array]:
    """Derivatives of the curves by an uncertain input.

    Parameters
    ----------
    case, problem, model
    best : Candidate
    name : str
        The input: a name of `runs.points.UNITS`.

    Returns
    -------
    sequence of arrays (n,), mN per unit of the input, one for each test

    Raises
    ------
    Underivable
    """
    exact = _exact(case, problem, model, best, name) if name in EXACT else None
    if exact is not None:
        return exact
    value = value_of(case, best, name)
    step = max(STEP * value, LEAST_FRICTION if name == "friction" else 0.0)
    low, high = value - min(step, value), value + step
    pair = _changed(problem, model, best, [{KEYS[name]: low}, {KEYS[name]: high}])
    return [(b - a) / (high - low) for a, b in zip(*pair, strict=True)]


def _exact(case: Case, problem: InverseProblem, model: ForwardModel, best: Candidate, name: str) -> tuple[Array, ...] | None:
    """The mechanics' own sensitivities, or None where it has none; one run computes those by all uncertain inputs."""
    wanted = tuple(other for other in EXACT if other in case.fit.uncertain.given or other == name)
    run = model.evaluate([problem.at_reference(best.parameters)], sensitivities=wanted)[0]
    if not run.sensitivities or not all(name in given for given in run.sensitivities):
        return None
    return problem.scaled(best.parameters, [given[name] for given in run.sensitivities])


def _changed(
    problem: InverseProblem, model: ForwardModel, best: Candidate, changes: Sequence[Mapping[str, Any]]
) -> list[tuple[Array, ...]]:
    """Curves of a Candidate under changes of its case (key -> value), a tuple for each change. Raises Underivable."""
    runs = model.evaluate([problem.at_reference({**best.parameters, **change}) for change in changes])
    curves = [problem.scaled(best.parameters, run.forces) for run in runs if run.forces is not None]
    if len(curves) < len(runs):
        raise Underivable(last_cause(model))
    return curves


def _named(names: Sequence[str], values: Array) -> dict[str, float | None]:
    return {name: (float(value) if np.isfinite(value) else None) for name, value in zip(names, values, strict=True)}
