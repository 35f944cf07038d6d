"""The search on a surrogate: first runs, runs that prove the surrogate's predictions, and a global search on the surrogate.

The first runs are at the places that determine a polynomial best. Then the model is run at the surrogate's own optimum, and the
surrogate is fitted to the run too; this repeats until the prediction error at the optimum is below a stated share of the misfit.
Only then does the global search use the surrogate; its best point and rival optima are run.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import qmc

from indentfit.arrays import Array
from indentfit.case import Fit
from indentfit.inverse.course import Proof, SurrogateFacts
from indentfit.inverse.derivatives import evaluate_at_reference, given_by, may_bring_sensitivities
from indentfit.inverse.generations import Search, by_objective, judged, parameters_of
from indentfit.inverse.polish import polish
from indentfit.inverse.polynomials import design_points, warp
from indentfit.inverse.problem import Candidate, InverseProblem
from indentfit.inverse.progress import SILENT, Progress
from indentfit.inverse.settings import SearchSettings, sized
from indentfit.inverse.surrogate import Surrogate, learn
from indentfit.runs.copied import in_copy
from indentfit.runs.forward import Evaluation, ForwardModel, Report

MANY = 4  # largest number of free parameters for which a surrogate is worth its runs
ERROR = 0.02  # largest error of a prediction that counts as right, over the misfit
FINEST = 3e-4  # the solver's own error, over the measured forces' root mean square
ROUNDS = 8  # largest number of rounds of prediction and proof
OF_ROUND = 2  # runs of a round: one point of two tests, or two of a single one
SCANNED = 1024  # places of a scan
SHOWN = 8  # largest number of optima of a scan
KNOWN = 2e-3  # of the ranges: a place nearer to a run needs no proof
TWIN = 1e-4  # of the ranges: that run stands for an optimum so near to it, since the polish goes on from there
RIVAL, APART = 1.25, 0.05  # a rival's objective at most, relative to the best; its distance, of the ranges
RIVALS = 2
PEOPLE, GENERATIONS = 80, 60  # of a search on the surrogate, by default
SHARE_OF_DESIGN = 0.6  # of the progress
HOPELESS = 2.0  # least misfit predicted near the stiffest first run, over the best predicted: from it on the run is left out
CORNER = 0.5  # size of that neighbourhood, of the polynomials' variables, which go from -1 to 1

GlobalSearch = Callable[[InverseProblem, ForwardModel, SearchSettings, Progress], Search]


@dataclass(frozen=True, eq=False)
class Exploration:
    """The exploration of the whole ranges before the local search.

    Parameters
    ----------
    surrogate : Surrogate or None
        None where the search was on the model itself, or too few runs succeeded.
    search : Search
        The global search, whose best Candidate was run on the true model.
    rivals : tuple of Candidate
        Other optima, which were run too.
    facts : SurrogateFacts or None
    equation_one : bool
        Whether the search minimised equation (1); else the sum of squares.
    """

    surrogate: Surrogate | None
    search: Search
    rivals: tuple[Candidate, ...] = ()
    facts: SurrogateFacts | None = None
    equation_one: bool = True

    @property
    def reached(self) -> bool:
        """Whether runs proved the surrogate's predictions right."""
        return self.facts is not None and self.facts.reached


class Watched:
    """A ForwardModel that remembers the evaluations of another ForwardModel, so that a surrogate can be fitted to them."""

    def __init__(self, model: ForwardModel) -> None:
        self.model = model
        self.known: list[Evaluation] = []

    @property
    def runs(self) -> int:
        """Runs of the mechanics."""
        return self.model.runs

    @property
    def failures(self) -> Sequence[Evaluation]:
        """Evaluations that failed."""
        return self.model.failures

    @property
    def evaluations(self) -> int:
        """The number of different sets of parameters that were evaluated."""
        return len({tuple(known.run.parameters.items()) for known in self.known})

    def differentiable(self) -> frozenset[str]:
        """Names whose sensitivities the model can give."""
        return self.model.differentiable()

    def evaluate(
        self, points: Sequence[Mapping[str, Any]], report: Report | None = None, sensitivities: Collection[str] = ()
    ) -> list[Evaluation]:
        """Evaluations of points by the model, which are remembered."""
        evaluations = self.model.evaluate(points, report, sensitivities)
        self.known += evaluations
        return evaluations


def explore(
    problem: InverseProblem,
    model: Watched,
    options: Fit,
    search: GlobalSearch,
    progress: Progress = SILENT,
    meanwhile: Callable[[Mapping[str, float]], object] | None = None,
) -> Exploration:
    """Explore the ranges of an inverse problem by a global search on a surrogate.

    Parameters
    ----------
    problem : InverseProblem
    model : Watched
    options : Fit
        Seed, population and generations as in the case's [fit].
    search : function
        `genetic.search`, or a search of `evolution`.
    progress : Progress
    meanwhile : function
        Called beside the global search with the parameters of the best run, which proved the surrogate's prediction: mostly the
        search ends there.

    Returns
    -------
    Exploration
    """
    _first_runs(problem, model, options, progress.part(0, SHARE_OF_DESIGN))
    surrogate = learn(problem, model.known)
    if surrogate is None:
        return Exploration(None, Search(None, (), "too few runs succeeded"))
    surrogate, held_out = _proved(problem, model, surrogate, options, progress.part(SHARE_OF_DESIGN, 1))
    spent = model.runs
    waited = in_copy(search, problem, surrogate, sized(options, PEOPLE, GENERATIONS), SILENT)
    if meanwhile is not None and held_out[-1].right:
        meanwhile(_best_known(problem, model).parameters)
    searched = waited()
    best, *rivals = _optima(problem, surrogate, [searched.best, *_scan(problem, surrogate, options.seed)[: RIVALS + 1]])
    confirmed = sorted([*_confirmed(problem, model, [best, *rivals]), _best_known(problem, model)], key=by_objective)
    message = f"{searched.message} on a surrogate of {len(surrogate.training)} runs"
    history = tuple(step.at(spent) for step in searched.history)
    surrogate = learn(problem, model.known) or surrogate
    facts = facts_of(surrogate, held_out)
    first = confirmed[0]
    others = [run for run in confirmed if np.abs(problem.units(run.parameters) - problem.units(first.parameters)).max() > APART]
    return Exploration(surrogate, Search(first, history, message), tuple(others[: len(rivals)]), facts)


def _confirmed(problem: InverseProblem, model: Watched, optima: Sequence[Candidate]) -> list[Candidate]:
    """Runs at optima; a run that is known stands for an optimum beside it."""
    twins = [_twin(problem, model, optimum) for optimum in optima]
    runs = judged(problem, model, [optimum.parameters for optimum, twin in zip(optima, twins, strict=True) if twin is None])
    return [known for known in (*twins, *runs) if known is not None]


def _twin(problem: InverseProblem, model: Watched, optimum: Candidate) -> Candidate | None:
    """The run within TWIN of an optimum, if there is one. There is none where the material relaxes: the runs were judged at other
    values of the parameters that change no run."""
    place, runs = problem.place(optimum.parameters), _on_own_mesh(problem, model)
    if problem.kernel is not None or not place.size:
        return None
    nearest = min(runs, key=lambda run: float(np.abs(problem.place(run.parameters) - place).max()))
    if np.abs(problem.place(nearest.parameters) - place).max() > TWIN:
        return None
    return problem.judge_best_scale(nearest.parameters, nearest.forces or ())


def _on_own_mesh(problem: InverseProblem, model: Watched) -> list[Evaluation]:
    """The runs so far without those on another mesh, which are there for the error of the mesh."""
    return [run for run in model.known if run.forces is not None and run.parameters.keys() == problem.start.keys()]


def facts_of(surrogate: Surrogate, held_out: Sequence[Proof] = ()) -> SurrogateFacts:
    """Facts about a Surrogate and about its predictions at points that were not run before."""
    return SurrogateFacts(
        runs=len(surrogate.training),
        failed=len(surrogate.failed),
        degree=surrogate.degree,
        left_out_error=surrogate.error,
        held_out=tuple(held_out),
        reached=any(proof.right for proof in held_out),
    )


def scanned(problem: InverseProblem, surrogate: Surrogate, seed: int = 0) -> tuple[Array, Array]:
    """Places (m, d) all over the ranges, away from failures, and the sums of squares (m,) there at the best scale."""
    places = qmc.Sobol(len(problem.searched), seed=seed).random(SCANNED)
    places = places[~surrogate.near_failure(places)]
    curves = surrogate.curves(places)
    weights = np.concatenate([t.curve.trust**2 * t.of_square / t.curve.force.size for t in problem.tests])
    target = np.concatenate([test.curve.force for test in problem.tests])
    scale = np.ones(len(places))
    if problem.scale:
        scale = (curves * weights) @ target / np.maximum((curves**2) @ weights, 1e-300)
        scale = np.clip(scale, *problem.factor_bounds())
    return places, ((scale[:, None] * curves - target) ** 2) @ weights


def _first_runs(problem: InverseProblem, model: Watched, options: Fit, progress: Progress) -> None:
    """Run the start values and the designed points; if runs may give sensitivities and none does, run the larger design too."""
    hoped = may_bring_sensitivities(problem, model)
    points = [problem.start, *_designed(problem, hoped, options)]
    first, last = _with_stiffest_last(problem, points) if hoped else (points, [])
    evaluations = evaluate_at_reference(problem, model, first, progress.of_runs("first runs"))
    if hoped and not any(len(given_by(problem, known)) == len(problem.searched) for known in evaluations):
        evaluate_at_reference(problem, model, [*last, *_designed(problem, False, options)], progress.of_runs("first runs"))
    elif last and not _corner_is_hopeless(problem, model, options.seed):
        evaluate_at_reference(problem, model, last, progress.of_runs("first runs"))


def _with_stiffest_last(
    problem: InverseProblem, points: list[dict[str, float]]
) -> tuple[list[dict[str, float]], list[dict[str, float]]]:
    """Points without the one at the upper ends of all ranges, and that one. It is the stiffest, so its run takes longest (stiff
    fibres fold on the way, which takes ten times the iterations of others), and in most problems it is far from every optimum."""
    d = len(problem.solved)
    stiffest = [point for point in points if d > 1 and np.all(problem.place(point)[:d] > 1 - KNOWN)]
    return [point for point in points if point not in stiffest], stiffest


def _corner_is_hopeless(problem: InverseProblem, model: Watched, seed: int) -> bool:
    """Whether the surrogate of the runs so far predicts that no place near the stiffest corner of the ranges is near an optimum:
    it needs no run there then, and where a later surrogate predicts otherwise, the model is run at the predicted optimum."""
    surrogate = learn(problem, model.known)
    if surrogate is None:
        return False
    places, squares = scanned(problem, surrogate, seed)
    near = np.all(warp(surrogate.of_runs(places), surrogate.fitted.betas) > 1 - CORNER, axis=1)
    return bool(near.any() and squares[near].min() > HOPELESS**2 * squares.min())


def _designed(problem: InverseProblem, slopes: bool, options: Fit) -> list[dict[str, float]]:
    d, start = len(problem.solved), problem.place(problem.start)
    places = design_points(d, slopes, options.seed) if d else np.zeros((0, 0))
    return [parameters_of(problem, np.concatenate([place, start[d:]])) for place in places]


def _proved(
    problem: InverseProblem, model: Watched, surrogate: Surrogate, options: Fit, progress: Progress
) -> tuple[Surrogate, list[Proof]]:
    """The surrogate after rounds of prediction and proof, and the proofs; the proof of the optimum is the last of each round."""
    held_out: list[Proof] = []
    for number in range(ROUNDS):
        progress(number / ROUNDS, f"surrogate of {len(surrogate.training)} runs")
        proofs = _prove(problem, model, surrogate, _worth_proving(problem, surrogate, options))
        held_out += reversed(proofs)
        surrogate = learn(problem, model.known) or surrogate
        if proofs[0].right:
            break
    return surrogate, held_out


def _worth_proving(problem: InverseProblem, surrogate: Surrogate, options: Fit) -> list[dict[str, float]]:
    """The points of a round: the surrogate's optimum, unless it was run already, and good places that are farthest from all runs,
    for OF_ROUND runs at least. More points made the intervals of all tests together no better: with three times the runs they
    were the same within 0.3 %."""
    known = surrogate.known_places()
    wanted: list[dict[str, float]] = []
    for best in _optima(problem, surrogate, _scan(problem, surrogate, options.seed)[:3]):
        if not wanted and surrogate.distance(problem.place(best.parameters), known) > KNOWN:
            wanted.append(best.parameters)
            known = np.vstack([known, surrogate.of_runs(problem.place(best.parameters))])
    if not problem.solved:
        return [_scan(problem, surrogate, options.seed)[0].parameters]
    places, squares = scanned(problem, surrogate, options.seed)
    places = places[squares <= 1.5**2 * squares.min()]
    while len(wanted) * len(problem.tests) < OF_ROUND:
        farthest = places[int(np.argmax([surrogate.distance(place, known) for place in places]))]
        wanted.append(parameters_of(problem, farthest))
        known = np.vstack([known, surrogate.of_runs(farthest)])
    return wanted


def _prove(problem: InverseProblem, model: Watched, surrogate: Surrogate, points: list[dict[str, float]]) -> list[Proof]:
    """Run points, and compare the surrogate's prediction with the run at each point."""
    predicted = evaluate_at_reference(problem, surrogate, points)
    ran = evaluate_at_reference(problem, model, points)
    return [_proof(problem, point, guess, run) for point, guess, run in zip(points, predicted, ran, strict=True)]


def _proof(problem: InverseProblem, parameters: dict[str, float], predicted: Evaluation, ran: Evaluation) -> Proof:
    if ran.forces is None:
        return Proof(dict(parameters), None, None)
    candidate = problem.judge_best_scale(parameters, ran.forces)
    factor = problem.factor(candidate.parameters)
    pairs = zip(problem.tests, predicted.forces or (), ran.forces, strict=True)
    difference = factor * np.concatenate([test.scale * (there - force) for test, there, force in pairs])
    size = np.sqrt(np.mean(np.concatenate([test.scale * test.curve.force for test in problem.tests]) ** 2))
    misfit = np.sqrt(candidate.sum_of_squares / sum(test.weight for test in problem.tests))
    error = float(np.sqrt(np.mean(difference**2)))
    return Proof(candidate.parameters, error, float(max(ERROR * misfit, FINEST * size)))


def _scan(problem: InverseProblem, surrogate: Surrogate, seed: int) -> list[Candidate]:
    """Candidates on the surrogate, best first, no two near each other."""
    places, squares = scanned(problem, surrogate, seed)
    chosen: list[Array] = []
    for place in places[np.argsort(squares)]:
        if len(chosen) < SHOWN and all(np.abs(place - other).max() > 4 * APART for other in chosen):
            chosen.append(place)
    candidates = judged(problem, surrogate, [parameters_of(problem, place) for place in chosen])
    return [candidate for candidate in candidates if candidate]


def _optima(problem: InverseProblem, surrogate: Surrogate, starts: Sequence[Candidate | None]) -> list[Candidate]:
    """Different optima of equation (1) on the surrogate that rival the best optimum, best first."""
    polished = [polish(problem, surrogate, start).best for start in starts if start]
    ends = sorted((end for end in polished if end), key=by_objective)
    chosen = ends[:1]
    for end in ends[1:]:
        far = all(np.abs(problem.units(end.parameters) - problem.units(other.parameters)).max() > APART for other in chosen)
        if far and end.objective <= RIVAL * ends[0].objective and len(chosen) <= RIVALS:
            chosen.append(end)
    return chosen


def _best_known(problem: InverseProblem, model: Watched) -> Candidate:
    """The best of all runs so far, so that the result of a search is never worse than a run on its way."""
    runs = _on_own_mesh(problem, model)
    return min((problem.judge_best_scale(run.parameters, run.forces or ()) for run in runs), key=by_objective)
