"""The search on a surrogate: runs placed where they teach most, a global search on what they taught, and its proof.

First runs determine a polynomial best; then the surrogate's own optimum is predicted, run, and added, until a prediction
was right within a stated share of the misfit. Only then does the global search speak, and its winner and rivals are run.
"""

from dataclasses import dataclass, field

import numpy as np
from scipy.stats import qmc

from indentfit.inverse.derivatives import asked, evaluate_at_reference, given_by, may_bring_sensitivities
from indentfit.inverse.generations import Search, judged, parameters_of
from indentfit.inverse.least_squares import polish
from indentfit.inverse.problem import Candidate
from indentfit.inverse.surrogate import Surrogate, design_points, learn

MANY = 4  # free parameters up to which a surrogate is worth its runs
ERROR = 0.02  # of the misfit: what the surrogate may be wrong by at a run that it has not seen
FINEST = 3e-4  # of the measured forces' root mean square: finer the solver itself is not
ROUNDS = 8  # of prediction and proof, at most
SCANNED = 1024  # places
KNOWN = 2e-3  # of the ranges: nearer to a run there is nothing to prove
RIVAL, APART = 1.25, 0.05  # a rival's objective at most, relative to the best; its distance, of the ranges
RIVALS = 2
PEOPLE, GENERATIONS = 80, 60  # of a search on the surrogate, where the case does not say
SHARE_OF_DESIGN = 0.6  # of the progress


@dataclass(frozen=True)
class Exploration:
    """surrogate (None where the search was on the model itself, or too few runs succeeded); search: the Search, its best run on
    the true model; rivals: other optima, run; facts: of the surrogate, for the result; equation_one: what the search made
    least, else the sum of squares."""

    surrogate: Surrogate | None
    search: Search
    rivals: tuple[Candidate, ...] = ()
    facts: dict = field(default_factory=dict)
    equation_one: bool = True


class Watched:
    """A Pool that remembers its evaluations, for a surrogate to learn from."""

    def __init__(self, pool):
        self.pool, self.known = pool, []

    def evaluate(self, points, progress=None, sensitivities=()):
        found = asked(self.pool, points, progress, sensitivities)
        self.known += found
        return found

    def __getattr__(self, name):
        return getattr(self.pool, name)


def explore(problem, pool, options, search, progress):
    """Exploration of an InverseProblem; search: of `genetic` or `evolution`; pool: Watched. progress: called with (share, note)."""
    _first_runs(problem, pool, options, progress)
    surrogate = learn(problem, pool.known)
    if surrogate is None:
        return Exploration(None, Search(None, [], "too few runs succeeded"))
    held_out: list[dict] = []
    for number in range(ROUNDS):
        progress(SHARE_OF_DESIGN + (1 - SHARE_OF_DESIGN) * number / ROUNDS, f"surrogate of {len(surrogate.samples)} runs")
        proofs = _prove(problem, pool, surrogate, _worth_proving(problem, surrogate, options))
        held_out += reversed(proofs)  # that of the optimum last, which decides
        surrogate = learn(problem, pool.known)
        if _is_proved(proofs[0]):
            break
    found = search(problem, surrogate, _large(options))
    best, *rivals = _optima(problem, surrogate, [found.best, *_scan(problem, surrogate, options.seed)[: RIVALS + 1]])
    confirmed = [one for one in judged(problem, pool, [c.parameters for c in [best, *rivals]]) if one]
    confirmed = sorted([*confirmed, *_best_known(problem, pool)], key=lambda one: one.objective)
    message = f"{found.message} on a surrogate of {len(surrogate.samples)} runs"
    search_ = Search(confirmed[0], [{**row, "runs": pool.runs} for row in found.history], message)
    surrogate = learn(problem, pool.known)
    return Exploration(surrogate, search_, tuple(confirmed[1 : 1 + len(rivals)]), facts_of(surrogate, held_out))


def facts_of(surrogate, held_out=()):
    """What the result says of a Surrogate; held_out: its errors at runs that it had not seen."""
    return {
        "runs": len(surrogate.samples),
        "failed": len(surrogate.failed),
        "degree": surrogate.degree,
        "left_out_error": surrogate.error,  # of each run predicted from the others, as a share of its misfit
        "held_out": list(held_out),
        "reached": any(_is_proved(one) for one in held_out),
    }


def scanned(problem, surrogate, seed=0):
    """Places (m, d) all over the ranges that lie nowhere near a failure, and the sums of squares there at best scale."""
    places = qmc.Sobol(len(problem.searched), seed=seed).random(SCANNED)
    places = places[~surrogate.near_failure(places)]
    curves = surrogate.curves(places)
    weights = np.concatenate([np.full(t.curve.force.size, t.weight / t.curve.force.size) for t in problem.tests])
    target = np.concatenate([t.curve.force for t in problem.tests])
    scale = np.ones(len(places))
    if problem.scale:
        bounds = problem.free[problem.scale]
        scale = (curves * weights) @ target / np.maximum((curves**2) @ weights, 1e-300)
        scale = np.clip(scale, bounds.min / problem.reference, bounds.max / problem.reference)
    return places, ((scale[:, None] * curves - target) ** 2) @ weights


def _first_runs(problem, pool, options, progress):
    """The start values and the design, which is smaller where runs can bring sensitivities; where none did, the larger one too."""
    report = lambda done, total: progress(SHARE_OF_DESIGN * done / total, f"{total} first runs")  # noqa: E731
    d, hoped = len(problem.searched), may_bring_sensitivities(problem, pool)
    found = evaluate_at_reference(problem, pool, [problem.start, *_designed(problem, hoped, options)], report)
    if hoped and not any(len(given_by(problem, one)) == d for one in found):
        evaluate_at_reference(problem, pool, _designed(problem, False, options), report)


def _designed(problem, slopes, options):
    return [parameters_of(problem, place) for place in design_points(len(problem.searched), slopes, options.seed)]


def _worth_proving(problem, surrogate, options):
    """The surrogate's optimum, where that was not run already, and the places among the good ones that are farthest from all
    runs: two in all, for a round of one leaves a worker idle at its end."""
    known = np.array([sample.place for sample in surrogate.samples])
    wanted = []
    for best in _optima(problem, surrogate, _scan(problem, surrogate, options.seed)[:3]):
        if not wanted and _distance(_place(problem, best.parameters), known) > KNOWN:
            wanted.append(best.parameters)
            known = np.vstack([known, _place(problem, best.parameters)])
    places, squares = scanned(problem, surrogate, options.seed)
    places = places[squares <= 1.5**2 * squares.min()]
    while len(wanted) < 2:
        farthest = max(places, key=lambda place: _distance(place, known))
        wanted.append(parameters_of(problem, farthest))
        known = np.vstack([known, farthest])
    return wanted


def _prove(problem, pool, surrogate, points):
    """Run what the surrogate predicts: of each point its error there, mN, rms over all points, and what is allowed."""
    predicted = evaluate_at_reference(problem, surrogate, points)
    ran = evaluate_at_reference(problem, pool, points)
    return [_proof(problem, *one) for one in zip(points, predicted, ran, strict=True)]


def _proof(problem, parameters, predicted, ran):
    if ran.forces is None:
        return {"parameters": dict(parameters), "error": None, "allowed": None}
    candidate = problem.judge_best_scale(parameters, ran.forces)
    factor = candidate.parameters[problem.scale] / problem.reference if problem.scale else 1.0
    difference = factor * (np.concatenate(predicted.forces) - np.concatenate(ran.forces))
    size = np.sqrt(np.mean(np.concatenate([test.curve.force for test in problem.tests]) ** 2))
    misfit = np.sqrt(candidate.sum_of_squares / sum(test.weight for test in problem.tests))
    error = float(np.sqrt(np.mean(difference**2)))
    return {"parameters": candidate.parameters, "error": error, "allowed": float(max(ERROR * misfit, FINEST * size))}


def _is_proved(proof):
    return proof["error"] is not None and proof["error"] <= proof["allowed"]


def _scan(problem, surrogate, seed):
    """Candidates on the surrogate, best first, no two near each other."""
    places, squares = scanned(problem, surrogate, seed)
    chosen: list = []
    for place in places[np.argsort(squares)]:
        if len(chosen) < 8 and all(np.abs(place - other).max() > 4 * APART for other in chosen):
            chosen.append(place)
    return [c for c in judged(problem, surrogate, [parameters_of(problem, place) for place in chosen]) if c]


def _optima(problem, surrogate, starts):
    """Different optima of equation (1) on the surrogate, best first, those that rival the best."""
    ends = sorted((polish(problem, surrogate, start).best for start in starts if start), key=lambda one: one.objective)
    chosen = ends[:1]
    for end in ends[1:]:
        far = all(np.abs(problem.units(end.parameters) - problem.units(o.parameters)).max() > APART for o in chosen)
        if far and end.objective <= RIVAL * ends[0].objective and len(chosen) <= RIVALS:
            chosen.append(end)
    return chosen


def _best_known(problem, pool):
    """The best of all runs so far: a search's result is never worse than what was seen on its way."""
    candidates = [problem.judge_best_scale(e.parameters, e.forces) for e in pool.known if e.forces is not None]
    return [min(candidates, key=lambda one: one.objective)]


def _large(options):
    sizes = {"population": options.population or PEOPLE, "generations": options.generations or GENERATIONS}
    return options.model_copy(update=sizes)


def _place(problem, parameters):
    return problem.units(parameters)[[list(problem.free).index(name) for name in problem.searched]]


def _distance(place, others):
    return float(np.abs(others - place).max(axis=1).min())
