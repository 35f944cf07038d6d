"""The certainty of a fit: errors, intervals, profiles, bootstrap and conclusions at an optimum."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from indentfit.arrays import Array, Bools
from indentfit.case import Case
from indentfit.fem.mesh_error import ORDER
from indentfit.fem.meshing import DIMENSIONS, count
from indentfit.inference import profiles
from indentfit.inference.agreement import TestPrediction
from indentfit.inference.alone import alone, scan_weights
from indentfit.inference.bootstrap import bootstrap
from indentfit.inference.consistency import agreement, predictions
from indentfit.inference.estimate import estimate
from indentfit.inference.identifiability import NOTE, Identifiability, identifiability, noise_of, notes_of, widened
from indentfit.inference.inputs import CORRECTED, MOVES, NOT_CORRECTED, Solution, input_derivatives, shares
from indentfit.inference.law_misfit import LawMisfit
from indentfit.inference.limits import MeshSize, limits
from indentfit.inference.misfit import recording
from indentfit.inference.plain import Interval
from indentfit.inference.result import (
    BootstrapError,
    ConfirmedPoint,
    CurveNoise,
    ParameterEstimate,
    Profile,
    PublishedComparison,
    RivalOptimum,
    TestAlone,
    WeightsFit,
)
from indentfit.inference.seen import seen_sentences, with_seen
from indentfit.inference.shares import NoiseShare, UncertainInputs, WhatIf
from indentfit.inference.verdicts import (
    against_each_other,
    alone_unless_in_doubt,
    alone_unless_proved,
    conclusions,
    contradictions,
    kind_of,
    reached,
    unless_in_doubt,
    unless_proved,
    verdict,
)
from indentfit.inference.what_if import fitted_again, taken_as_known, warnings_of, what_ifs
from indentfit.inference.zeroed_late import zeroed_late
from indentfit.inverse.course import SurrogateFacts
from indentfit.inverse.derivatives import curve_derivatives, evaluate_at_reference
from indentfit.inverse.exploration import MANY, Exploration, Watched, facts_of
from indentfit.inverse.mesh_correction import Corrected
from indentfit.inverse.methods import Solved
from indentfit.inverse.problem import Candidate, InverseProblem
from indentfit.inverse.progress import SILENT, Progress
from indentfit.inverse.surrogate import Surrogate, learn, linearised
from indentfit.runs.forward import ForwardModel
from indentfit.runs.points import setup_of

TRUSTED = 0.1  # largest error of a surrogate, over the misfit, with which conclusions are drawn from the surrogate
PREDICTED = 0.03  # largest error, over the objective, with which the surrogate gives the objective of published parameters
RIGHT = 0.15  # largest difference between a run and its prediction, over a profile's limit
SOLVES = 12  # sets of parameters that least squares may run, ends of profiles included
UNPROVED = (
    "profiles by a surrogate of the search's {runs} runs; {proved} of their {ends} ends confirmed by runs, since {solves} sets of "
    "parameters are allowed in all; `ga` has no such limit"
)
SURE_OF = "{proved} of the {ends} ends of profiles are runs; of the others the surrogate is sure to 5 % of the limit"
OF_RUNS = "profiles by a surrogate of the search's {runs} runs; {more} more sets of parameters were run to confirm them"
LINEARISED = (
    "profiles and bootstrap use the curves linearised at the optimum, since no surrogate can be trusted, or the parameters are many"
)


@dataclass(frozen=True, eq=False)
class Findings:
    """The profiles of a fit, with the other results from the same surrogate."""

    profiles: dict[str, Profile] = field(default_factory=dict)
    bootstrap: dict[str, BootstrapError] = field(default_factory=dict)
    tests_alone: dict[str, TestAlone] = field(default_factory=dict)
    weights_scan: tuple[WeightsFit, ...] = ()
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Certainty:
    """The certainty of the parameters of a fit.

    Parameters
    ----------
    known : Identifiability or None
        Identifiability by the noise alone. None where no derivatives exist; all other fields are then empty.
    estimates : dict of free parameter -> ParameterEstimate
    findings : Findings
    noise, uncertain, rivals, surrogate, predicted, published, conclusions, notes, law_misfit
        `FitResult` describes these fields.
    """

    known: Identifiability | None = None
    estimates: dict[str, ParameterEstimate] = field(default_factory=dict)
    findings: Findings = field(default_factory=Findings)
    noise: dict[str, CurveNoise] = field(default_factory=dict)
    uncertain: UncertainInputs = field(default_factory=UncertainInputs)
    rivals: tuple[RivalOptimum, ...] = ()
    surrogate: SurrogateFacts | None = None
    predicted: dict[str, TestPrediction] = field(default_factory=dict)
    published: PublishedComparison | None = None
    conclusions: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    taken_as_known: tuple[WhatIf, ...] = ()
    law_misfit: LawMisfit | None = None


def certainty(case: Case, problem: InverseProblem, model: Watched, solved: Solved, progress: Progress = SILENT) -> Certainty:
    """The errors of a solved inverse problem and everything that follows.

    Parameters
    ----------
    case : Case
    problem : InverseProblem
    model : Watched
        The model with the runs of the search; further runs confirm ends of profiles and uncertain inputs.
    solved : Solved
    progress : Progress

    Returns
    -------
    Certainty
    """
    optimum, exploration = solved.optimum, solved.exploration
    if not optimum.derivatives or optimum.best is None:
        return Certainty()
    alone_known = identifiability(problem, optimum.best, optimum.derivatives, exploration.equation_one)
    solution = Solution(case, problem, model, optimum.best, alone_known)
    notes, uncertain = [NOTE, *notes_of(noise_of(problem, alone_known)), *_of_mesh(model)], UncertainInputs()
    if case.fit.uncertain.given:
        progress(0.0, "uncertain inputs")
        solution, uncertain, missing = with_inputs(solution)
        notes += [f"the error by {name} is not in the intervals: {why}" for name, why in missing.items()]
    findings, facts = Findings(), exploration.facts
    if case.fit.profiles:
        progress(0.0, "profiles")
        findings, facts = _profiled(solution, model, solved, uncertain, progress)
    predicted, reconciling = _predicted(solution, model, solved, uncertain)
    estimates = against_each_other(_estimates(solution, alone_known, findings, uncertain), predicted, findings.tests_alone)
    estimates = unless_in_doubt(unless_proved(estimates, optimum.success), recording(case))
    singles = alone_unless_in_doubt(alone_unless_proved(findings.tests_alone, optimum.success), recording(case))
    findings = replace(findings, tests_alone=singles)
    estimates = with_seen(case, estimates, optimum.best.parameters)
    there = published_objective(solution, _learned(problem, model, exploration) if problem.searched else None)
    published = published_comparison(case, there, estimates)
    noise = noise_of(problem, alone_known)
    exact = _what_ifs(solution, model, exploration, estimates)
    return Certainty(
        known=alone_known,
        estimates=estimates,
        findings=findings,
        noise=noise,
        uncertain=uncertain,
        rivals=tuple(RivalOptimum(_free(problem, rival), rival.objective) for rival in exploration.rivals),
        surrogate=facts,
        predicted=predicted,
        published=published,
        conclusions=(
            *contradictions(predicted),
            *reconciling,
            *zeroed_late(case, problem, optimum.best.forces, _systematic(noise)),
            *conclusions(estimates, len({test.test for test in problem.tests}), published),
            *seen_sentences(case, optimum.best.parameters),
            *warnings_of(exact, estimates),
        ),
        notes=(*notes, *findings.notes),
        taken_as_known=exact,
    )


def with_inputs(solution: Solution) -> tuple[Solution, UncertainInputs, dict[str, str]]:
    """The solution with intervals that include the errors of uncertain inputs.

    Parameters
    ----------
    solution : Solution

    Returns
    -------
    Solution
    UncertainInputs
        The effect of each input.
    dict
        Input -> why its error is not in the intervals.
    """
    added = shares(solution)
    wider = widened(solution.problem, solution.best, solution.known, added.covar)
    total = np.sqrt(np.diag(wider.errors.covar))
    pairs = zip(solution.problem.free, total, strict=True)
    stderr = {name: float(error) if np.isfinite(error) else None for name, error in pairs}
    uncertain = UncertainInputs(added.rows, NoiseShare(added.noise), stderr)
    return replace(solution, known=wider), uncertain, added.missing


def coverage(
    problem: InverseProblem, surrogate: Surrogate, truth: dict[str, float], sigma: Sequence[float], draws: int, seed: int = 0
) -> Bools:
    """Whether the profile intervals of least-squares fits contain the true parameters.

    Parameters
    ----------
    problem : InverseProblem
    surrogate : Surrogate
    truth : dict of name -> value
        The true parameters, at which the surrogate gives the curves; white noise is added to them.
    sigma : sequence of float, mN
        Standard deviation of the noise in each test.
    draws, seed : int

    Returns
    -------
    array of bool (draws, n_free)
    """
    exact = problem.scaled(truth, evaluate_at_reference(problem, surrogate, [truth])[0].forces or ())
    rng, x, inside = np.random.default_rng(seed), problem.units(truth), []
    for _ in range(draws):
        forces = [force + s * rng.standard_normal(force.size) for force, s in zip(exact, sigma, strict=True)]
        inside.append(holds(problem.measured(forces), surrogate, truth, x))
    return np.array(inside)


def holds(problem: InverseProblem, surrogate: Surrogate, truth: dict[str, float], x: Array) -> list[bool]:
    """Whether each profile interval of a fit on the surrogate, started at x in units of the ranges, contains the truth."""
    parameters = problem.parameters(estimate(problem, surrogate, problem.weights, x)[0])
    best = problem.judge(parameters, evaluate_at_reference(problem, surrogate, [parameters])[0].forces or ())
    known = identifiability(problem, best, curve_derivatives(problem, surrogate, problem.units(parameters)))
    return [
        bool(profiles.chi2_at(problem, surrogate, best, known, name, truth[name]) <= known.quantile[n] ** 2)
        for n, name in enumerate(problem.free)
    ]


def linear_findings(
    problem: InverseProblem, best: Candidate, derivatives: Sequence[Array], known: Identifiability, seed: int
) -> Findings:
    """Profiles and bootstrap of the curves linearised at the optimum, without a run: within the bounds, exact in the scale."""
    surrogate = linearised(problem, best, derivatives)
    paths = profiles.profiles(problem, surrogate, best, known)
    return Findings(
        profiles={name: path.shown() for name, path in paths.items()},
        bootstrap=bootstrap(problem, surrogate, best, known, seed),
        notes=(LINEARISED,) if problem.searched else (),
    )


def _profiled(
    solution: Solution, model: Watched, solved: Solved, uncertain: UncertainInputs, progress: Progress
) -> tuple[Findings, SurrogateFacts | None]:
    """The Findings, from a surrogate where a surrogate can be trusted, and the facts of that surrogate."""
    problem, exploration, options = solution.problem, solved.exploration, solution.case.fit
    surrogate = _learned(problem, model, exploration)
    if surrogate is None:
        slopes = solved.optimum.derivatives or ()
        return linear_findings(problem, solution.best, slopes, solution.known, options.seed), exploration.facts
    facts = exploration.facts or facts_of(surrogate)
    if not exploration.equation_one:
        most = max(SOLVES - model.evaluations - bool(options.published), 0)
        return _findings(solution, model, surrogate, most, progress), facts
    spent = model.evaluations
    fits = {}
    if problem.solved or (
        len(problem.tests) > 1 and not problem.segmented
    ):  # also for a single test, because its run improves the surrogate
        fits = alone(problem, model, surrogate, options.seed, _of_forces(uncertain))
    findings = _findings(solution, model, surrogate, None, progress)
    findings = replace(findings, tests_alone=fits if len(problem.tests) > 1 and not problem.segmented else {})
    last = learn(problem, model.known) or surrogate
    findings = replace(findings, weights_scan=() if problem.segmented else scan_weights(problem, last, options.seed))
    if exploration.surrogate is None:
        said = OF_RUNS.format(runs=len(surrogate.training), more=model.evaluations - spent)
        findings = replace(findings, notes=(*findings.notes, said))
    return findings, facts


def _learned(problem: InverseProblem, model: Watched, exploration: Exploration) -> Surrogate | None:
    """The surrogate of all runs so far; None where it cannot be trusted, or where the parameters are too many for a surrogate."""
    surrogate = learn(problem, model.known) if len(problem.elastic.free) <= MANY else None
    trusted = surrogate is not None and (exploration.reached or surrogate.error <= TRUSTED)
    return surrogate if trusted else None


def _systematic(noise: Mapping[str, CurveNoise]) -> list[str]:
    return [name for name, known in noise.items() if known.systematic]


def _what_ifs(
    solution: Solution, model: Watched, exploration: Exploration, estimates: Mapping[str, ParameterEstimate]
) -> tuple[WhatIf, ...]:
    """The inputs that are taken as known, with what the parameters would be at other values of them: by runs where the case asks
    for these, and by default where a parameter is determined, whose interval it may leave, and sets of runs are not limited."""
    problem, options = solution.problem, solution.case.fit
    if not options.profiles:
        return taken_as_known(solution.case)
    surrogate = _learned(problem, model, exploration) if problem.searched else learn(problem, model.known, exact=True)
    if surrogate is None:
        return taken_as_known(solution.case)
    telling = exploration.equation_one and any(kind_of(known) == "determined" for known in estimates.values())
    return what_ifs(solution, fitted_again(solution, surrogate), telling if options.what_if is None else options.what_if)


def _predicted(
    solution: Solution, model: Watched, solved: Solved, uncertain: UncertainInputs
) -> tuple[dict[str, TestPrediction], tuple[str, ...]]:
    """Each test predicted from the others, on the surrogate of all runs, or on the curves linearised at the optimum, and a sentence
    on what would make tests agree that contradict each other."""
    problem, best = solution.problem, solution.best
    if problem.segmented:  # the segments of a test are no tests that could contradict each other
        return {}, ()
    surrogate = _learned(problem, model, solved.exploration) or linearised(problem, best, solved.optimum.derivatives or ())
    sd = _of_forces(uncertain)
    pairs = zip(problem.tests, best.forces, strict=True)
    common: list[list[Array]] = [[] if test.moves else [sd * force] for test, force in pairs]
    for name, share in uncertain.inputs.items():
        if name not in MOVES and share.sd is not None:
            slopes = input_derivatives(solution.case, problem, solution.model, best, name)
            for rows, slope in zip(common, slopes, strict=True):
                rows.append(share.sd * slope)
    x = problem.units(best.parameters)
    predicted = predictions(problem, surrogate, x, common, solution.case.fit.seed)
    pressed = [test.kind == "indentation" for test in solution.case.tests]
    said = agreement(problem, surrogate, x, common, predicted, pressed)
    return predicted, (said,) if said else ()


def _of_forces(uncertain: UncertainInputs) -> float:
    """Relative standard deviation common to all forces of a test, by the mesh and by the stated error of the force."""
    mesh, force = (uncertain.inputs[name].sd or 0.0 if name in uncertain.inputs else 0.0 for name in ("mesh", "force"))
    return float(np.hypot(mesh, force))


def _findings(solution: Solution, model: Watched, surrogate: Surrogate, most: int | None, progress: Progress) -> Findings:
    """Profiles, confirmed by runs at their ends (at most `most` sets of parameters), and the bootstrap."""
    problem, best, known = solution.problem, solution.best, solution.known
    first = profiles.profiles(problem, surrogate, best, known)
    proving = profiles.Proving(problem, model, surrogate, best, known, most)
    confirmed = proving.prove(first, progress.part(0, 0.9).of_runs("runs at the ends of profiles"))
    surrogate = learn(problem, model.known) or surrogate
    last = profiles.profiles(problem, surrogate, best, known) if problem.solved or problem.kernel is None else first
    notes = []
    wrong = [name for name, points in confirmed.items() if not all(_right(point, last[name].limit) for point in points)]
    if wrong:
        notes.append(f"the profiles of {', '.join(wrong)} were predicted badly at their ends, and corrected by the runs there")
    proved = sum(len(points) for points in confirmed.values())
    if most is not None:
        notes.append(UNPROVED.format(runs=len(surrogate.training), solves=SOLVES, proved=proved, ends=2 * len(last)))
    elif proved < 2 * len(last):
        notes.append(SURE_OF.format(proved=proved, ends=2 * len(last)))
    progress(0.95, "bootstrap")
    return Findings(
        profiles={name: path.shown(confirmed[name]) for name, path in last.items()},
        bootstrap=bootstrap(problem, surrogate, best, known, solution.case.fit.seed),
        notes=tuple(notes),
    )


def _right(point: ConfirmedPoint, limit: float) -> bool:
    if point.chi2 is None or point.predicted is None or not np.isfinite(point.predicted):
        return False
    return bool(abs(np.sqrt(point.chi2) - np.sqrt(point.predicted)) <= RIGHT * np.sqrt(limit))


def _of_mesh(model: ForwardModel) -> list[str]:
    if not isinstance(model, Corrected):
        return []
    error = model.error
    if not error.most:
        return [NOT_CORRECTED.format(sd=error.sd, remark=error.remark or "two meshes give the same curves")]
    return [CORRECTED.format(most=error.most, elements=error.elements, sd=error.sd), *([error.remark] if error.remark else [])]


def _free(problem: InverseProblem, candidate: Candidate) -> dict[str, float]:
    return {name: candidate.parameters[name] for name in problem.free}


def _estimates(
    solution: Solution, alone_known: Identifiability, findings: Findings, uncertain: UncertainInputs
) -> dict[str, ParameterEstimate]:
    """Each free parameter with its interval, by its profile if it has one, widened by uncertain inputs."""
    problem, best, known = solution.problem, solution.best, solution.known
    mesh = mesh_size(solution.case, solution.model) if "mesh" in uncertain.inputs else None
    limited = limits(uncertain, noise_of(problem, alone_known), problem.free, mesh)
    estimates = {}
    for n, (name, bounds) in enumerate(problem.free.items()):
        linear: Interval = (float(known.interval[n, 0]), float(known.interval[n, 1]))
        interval = findings.profiles[name].interval if name in findings.profiles else linear
        error, at_bound = float(alone_known.stderr[n]), reached(known.at_bound[n], best.parameters[name], interval, bounds)
        estimates[name] = ParameterEstimate(
            value=best.parameters[name],
            unit="1",
            start=bounds.start,
            min=bounds.min,
            max=bounds.max,
            stderr=error if np.isfinite(error) else None,
            at_bound=at_bound or None,
            interval=interval,
            interval_linear=linear,
            verdict=verdict(best.parameters[name], interval, bounds, at_bound, limited[name]),
            stderr_total=uncertain.stderr_total.get(name),
            limited_by="bound" if at_bound else limited[name].cause,
        )
    return estimates


def mesh_size(case: Case, model: ForwardModel) -> MeshSize | None:
    """The number of elements of the finest mesh behind the curves, and the power of it with which the force's error falls; None
    where no test is an indentation."""
    if not case.indentations:
        return None
    setups = [setup_of(piece) for piece in case.pieces]
    own = round(sum(count(setup) for setup in setups) / len(setups))
    dimensions = max(DIMENSIONS[setup.grown_from] for setup in setups)
    elements = model.error.finest if isinstance(model, Corrected) else own
    return MeshSize(elements, ORDER[case.solver.element] / dimensions)


def published_objective(solution: Solution, surrogate: Surrogate | None = None) -> tuple[float | None, float | None]:
    """The objective of the published parameters that the case names for these curves, mN, and its error, by a surrogate that knows
    it within PREDICTED, else by a run, whose error is None; None where none are named or the run fails."""
    published = solution.case.fit.published
    if not published:
        return None, None
    point = {**solution.best.parameters, **published}
    if surrogate is not None and set(published) <= set(solution.problem.free):
        predicted = _predicted_objective(solution.problem, surrogate, point)
        if predicted is not None:
            return predicted
    run = evaluate_at_reference(solution.problem, solution.model, [point])[0]
    return solution.problem.judge(point, run.forces).objective if run.forces else None, None


def published_comparison(
    case: Case, objective: tuple[float | None, float | None], estimates: dict[str, ParameterEstimate]
) -> PublishedComparison | None:
    """The published parameters that the case names, with their `published_objective`, and whether each lies in its interval."""
    published = case.fit.published
    if not published:
        return None
    intervals = {name: estimates[name].interval for name in published if name in estimates}
    inside = {name: bool(between[0] <= published[name] <= between[1]) for name, between in intervals.items() if between}
    return PublishedComparison(dict(published), objective[0], inside, objective[1])


def _predicted_objective(problem: InverseProblem, surrogate: Surrogate, point: dict[str, float]) -> tuple[float, float] | None:
    """The objective of a point by a surrogate, mN, and how far the jackknife says that it may be off; None where that is much."""
    place = problem.place(point)
    (forces,) = (run.forces for run in evaluate_at_reference(problem, surrogate, [point]))
    if forces is None or np.any((place < 0) | (place > 1)) or surrogate.near_failure(place[None])[0]:
        return None
    objective = problem.judge(point, forces).objective
    lost = problem.factor(point) * surrogate.spread(place)
    parts = np.split(lost, np.cumsum([test.curve.force.size for test in problem.tests])[:-1], axis=1)
    rows = zip(problem.tests, parts, strict=True)
    error = sum(test.of_rmse * float(np.sqrt(np.sum((test.curve.trust * part) ** 2) / part.shape[1])) for test, part in rows)
    return (objective, error) if error <= PREDICTED * objective else None
