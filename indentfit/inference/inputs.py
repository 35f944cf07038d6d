"""Inputs of the model that are known with some error only: what their error does to the parameters.

Friction, bulk ratio, thickness and the contact point (`offset`: contact begins so much deeper, F(d - offset)) move the
curves; an estimate follows such a move as it follows noise, linearly: d theta = - estimator . dF/d input. Derivatives are
the model's own where it gives them, else differences of runs with the input changed. `force` is an error common to all
forces of a test; `mesh` is one too, its size Richardson's estimate from a mesh of about half as many elements.
`base` has two values only: what the parameters would be on the other one, and the probability of that.
All runs are the workers' and go into the ledger.
"""

from dataclasses import dataclass, field

import numpy as np
import scipy.optimize

from indentfit.case import Mesh
from indentfit.fem.mesh import count
from indentfit.inverse.derivatives import Underivable, derivatives_of, last_cause
from indentfit.runs.points import KEYS, case_at

EXACT = ("friction", "bulk_ratio", "offset")  # what the model differentiates by
STEP = 0.05  # of an input, for differences
LEAST_FRICTION = 0.02  # its step where the friction is small
FEWEST = 20  # elements of a mesh
ORDER = 1.0  # of the force in the size of the elements: at the indenter's edge the traction is singular
ANOTHER = 0.75  # of the elements: a mesh of more is the same one
OTHER_BASE = {"sliding": "bonded", "bonded": "sliding"}


@dataclass(frozen=True)
class Shares:
    """What uncertain inputs add to the errors: covar (p, p) of all of them together; rows: name -> value, sd, effect (change
    of each parameter for one sd; of `force` and `mesh`, which every test has its own of, the root of the sum of squares; of
    `base` for the other one), share (of each parameter's total variance); noise: its share; missing: name -> why there is none.
    """

    covar: np.ndarray
    rows: dict[str, dict]
    noise: dict[str, float | None] = field(default_factory=dict)
    missing: dict[str, str] = field(default_factory=dict)


def shares(case, problem, pool, best, known):
    """Shares of the uncertain inputs of a case in the errors of a Candidate, with its Identifiability."""
    names, moves, facts, missing = list(problem.free), {}, {}, {}
    for name, spread in case.fit.uncertain.given.items():
        try:
            moves[name], facts[name] = MOVES.get(name, _of_input)(case, problem, pool, best, known, name, spread)
        except Underivable as failure:
            missing[name] = str(failure)
    own = np.diag(known.errors.covar)
    covar = sum((one.T @ one for one in moves.values()), np.zeros_like(known.errors.covar))
    variance = own + np.diag(covar)
    part = lambda size: _named(names, size / np.where(variance > 0, variance, 1.0))  # noqa: E731
    rows = {}
    for name, one in moves.items():
        effect = facts[name].pop("effect", one[0] if len(one) == 1 else np.linalg.norm(one, axis=0))
        rows[name] = {**facts[name], "effect": _named(names, effect), "share": part((one**2).sum(axis=0))}
    return Shares(covar, rows, part(own), missing)


# What each moves: rows (k, p) of changes of the estimates, one for each independent error, and facts


def _of_force(case, problem, pool, best, known, name, spread):
    """An error of each test's forces as a whole."""
    return spread * np.array([B @ best.forces[n] for n, B in _estimator(known)]), {"value": 1.0, "sd": spread}


def _of_mesh(case, problem, pool, best, known, name, spread):
    """The same, as large as this mesh's error by Richardson: from the largest change of any test's curve on another mesh (of one
    alone it may be chance) and the order ORDER that an edge leaves."""
    elements = another_mesh(case)
    changed = _forces(problem, pool, best, [{"mesh.elements": elements}])[0]
    number = elements_of(case)
    coarser = (number(case.mesh) / number(Mesh(elements=elements))) ** (ORDER / 3)
    change = max(np.linalg.norm(b - a) / np.linalg.norm(a) for a, b in zip(best.forces, changed, strict=True))
    sd = spread * change / abs(coarser - 1)
    rows, _ = _of_force(case, problem, pool, best, known, name, sd)
    return rows, {"value": 0.0, "sd": float(sd), "elements": elements}


def _of_base(case, problem, pool, best, known, name, spread):
    """What the parameters would be on the other base: a Gauss-Newton step from there, towards the curves fitted, within bounds."""
    other = OTHER_BASE[case.sample.base]
    slopes, forces = derivatives_of(problem, pool, {**best.parameters, "sample.base": other})
    heavy = [n for n, weight in enumerate(known.weights) if weight]
    roots = [np.sqrt(known.weights[n]) for n in heavy]
    A = np.concatenate([root * slopes[n] for root, n in zip(roots, heavy, strict=True)])
    b = np.concatenate([root * (best.forces[n] - forces[n]) for root, n in zip(roots, heavy, strict=True)])
    x, ranges = problem.units(best.parameters), np.array([problem.range(one) for one in problem.free])
    effect = ranges * scipy.optimize.lsq_linear(A, b, (-x - 1e-12, 1 - x + 1e-12), tol=1e-14).x
    return np.sqrt(spread) * effect[None], {"value": case.sample.base, "sd": None, "probability": spread, "effect": effect}


def _of_input(case, problem, pool, best, known, name, spread):
    slopes = derivatives(case, problem, pool, best, name)
    move = -spread * np.sum([B @ slopes[n] for n, B in _estimator(known)], axis=0)
    return move[None], {"value": value_of(case, best, name), "sd": spread}


MOVES = {"force": _of_force, "mesh": _of_mesh, "base": _of_base}


def _estimator(known):
    """(number of a test that counts, what turns a change of its curve into one of the estimates)."""
    return zip([n for n, weight in enumerate(known.weights) if weight], known.errors.estimator, strict=True)


def another_mesh(case):
    """Elements to ask for to get a mesh of about half as many; of the coarsest, of twice as many."""
    number = elements_of(case)
    own = number(case.mesh)
    half = max(own // 2, FEWEST)
    return half if number(Mesh(elements=half)) <= ANOTHER * own else 2 * own


def elements_of(case):
    """Mesh table -> the number of elements that it gives this case."""
    depth = max(float(case.outputs(test)[-1]) for test in case.tests)
    return lambda mesh: count(case.sample, case.indenter, mesh, case.solver.element, depth)


def value_of(case, best, name):
    """The value of an uncertain input at a Candidate; the contact point is what the curves say."""
    if name == "offset":
        return 0.0
    table, key = KEYS[name].split(".")
    return getattr(getattr(case_at(case, best.parameters), table), key)


def derivatives(case, problem, pool, best, name):
    """dF/d input of each test at a Candidate, (n,), mN per unit of the input. Raises Underivable."""
    exact = _exact(case, problem, pool, best, name) if name in EXACT else None
    if exact is not None:
        return exact
    value = value_of(case, best, name)
    step = max(STEP * value, LEAST_FRICTION if name == "friction" else 0.0)
    low, high = value - min(step, value), value + step
    pair = _forces(problem, pool, best, [{KEYS[name]: low}, {KEYS[name]: high}])
    return [(b - a) / (high - low) for a, b in zip(*pair, strict=True)]


def _exact(case, problem, pool, best, name):
    """The model's own sensitivities, or None where it has none; all that are wanted are asked for at once."""
    wanted = tuple(one for one in EXACT if one in case.fit.uncertain.given or one == name)
    run = pool.evaluate([problem.at_reference(best.parameters)], sensitivities=wanted)[0]
    if not run.sensitivities or not all(name in one for one in run.sensitivities):
        return None
    return problem.scaled(best.parameters, [one[name] for one in run.sensitivities])


def _forces(problem, pool, best, changes):
    """Curves of a Candidate under changes of its case (key -> value), a tuple for each of them. Raises Underivable."""
    runs = pool.evaluate([problem.at_reference({**best.parameters, **change}) for change in changes])
    if any(run.forces is None for run in runs):
        raise Underivable(last_cause(pool))
    return [problem.scaled(best.parameters, run.forces) for run in runs]


def _named(names, values):
    return {name: (float(value) if np.isfinite(value) else None) for name, value in zip(names, values, strict=True)}
