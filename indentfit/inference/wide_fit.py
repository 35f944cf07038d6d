"""A fit with uncertain inputs: a joint fit under each alternative, their mixture, and what the result says of it.

Inputs with a prior are coordinates (`joint`). The base has two values: each is fitted, and weighed by its evidence; the interval of
a parameter is that of the mixture, and may be in pieces.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.linalg import block_diag

from indentfit.arrays import Array
from indentfit.case import Case
from indentfit.case.messages import Fault, line
from indentfit.case.search import Fit
from indentfit.case.unknown import faults_in_time
from indentfit.errors import CaseError
from indentfit.inference import draws, mixture
from indentfit.inference.discrepancy import law_error
from indentfit.inference.draws import Draws, drawn, undrawn
from indentfit.inference.joint import (
    BEATEN,
    LIMIT,
    ROUNDS,
    JointFit,
    ModelError,
    fitted,
    held_out,
    joint_fit,
    objective_of,
    prediction_errors,
)
from indentfit.inference.joint_profiles import JointPath, joint_profiles
from indentfit.inference.noise import effective
from indentfit.inference.plain import Interval
from indentfit.inference.posterior import Climber
from indentfit.inference.profiles import BELIED, SURE, apart, as_predicted, near
from indentfit.inference.result import ConfirmedPoint
from indentfit.inverse.derivatives import Underivable, evaluate_at_reference
from indentfit.inverse.exploration import Exploration, Watched
from indentfit.inverse.generations import Search
from indentfit.inverse.local import Optimum
from indentfit.inverse.mesh_correction import mesh_error_at
from indentfit.inverse.methods import SEARCHES, Solved
from indentfit.inverse.problem import Candidate, InverseProblem
from indentfit.inverse.progress import SILENT, Progress
from indentfit.inverse.surrogate import learn
from indentfit.inverse.wide import MOST, UncertainInput, alternatives, listed_inputs, uncertain_inputs, widened_problem
from indentfit.runs.copied import in_copy
from indentfit.runs.forward import Evaluation, Report

CONCERNS = 25.0  # growth of chi2 beyond which the curves rule a place out, so that an error of its prediction matters no more
UNPROVED = "the optimum was not proved by a run"
BESIDE = 0.14  # of a piece's width: intervals follow profiles so far beside the smallest set, and stay within 1.3 of its width
SCOUTS = 400  # particles that weigh the alternatives before runs at the ends of their profiles
FARTHER = 1.1  # growth of the objective by which runs at ends of profiles may not move an optimum with smooth residuals
SLIT = 0.1  # of the whole set's width: narrower gaps between its pieces are filled


@dataclass(frozen=True, eq=False)
class WideAlternative:
    """One alternative: its changes of the case, its probability before and after the fit, its fit, the profiles of the free
    parameters, and draws of its posterior."""

    name: str
    changes: dict[str, Any]
    prior: float
    fit: JointFit
    paths: dict[int, JointPath]
    draws: Draws
    probability: float = 1.0
    confirmed: Mapping[int, tuple[ConfirmedPoint, ...]] | None = None

    def interval(self, n: int, several: bool = False) -> Interval:
        """The outermost ends of the 95 % set of free parameter n as if this alternative were certain, in units of the range;
        several: whether it is one of several."""
        parts = pieces_of([replace(self, probability=1.0)], n, several)
        return parts[0][0], parts[-1][1]


@dataclass(frozen=True, eq=False)
class WideFit:
    """All alternatives of a fit, the most probable first, and the error of the mesh."""

    problem: InverseProblem
    alternatives: tuple[WideAlternative, ...]
    mesh: ModelError
    elements: int | None

    @property
    def best(self) -> WideAlternative:
        """The most probable alternative."""
        return self.alternatives[0]

    def candidate(self) -> Candidate:
        """The optimum of the best alternative: its point, and the curves with offset, gain and correction for the mesh."""
        return _candidate(self.problem, self.best.fit)

    def derivatives(self) -> tuple[Array, ...]:
        """Derivatives of these curves by the free parameters, mN per range, one array (n, n_free) for each test."""
        curves = self.best.fit.posterior.curves
        J = curves.at(self.best.fit.mode.z)[1][:, : len(curves.free)]
        return tuple(J[rows] for rows in curves.slices)

    @property
    def reached(self) -> bool:
        """Whether runs proved the optimum of every alternative that is not improbable, since intervals are those of all these."""
        return all(known.fit.reached for known in self.alternatives if known.probability > 1 - mixture.CERTAIN)

    def solved(self) -> Solved:
        """The end of the fit as that of a method."""
        fit = self.best.fit
        message = "the surrogate's prediction at the optimum was proved" if self.reached else UNPROVED
        optimum = Optimum(self.candidate(), self.derivatives(), self.reached, message, fit.history)
        coordinates = ", ".join(known.point or known.name for known in fit.posterior.curves.inputs)
        said = f"joint search on a surrogate of {len(fit.surrogate.training)} runs over the parameters"
        said += f" and {coordinates}" if coordinates else ""
        return Solved(optimum, Exploration(fit.surrogate, Search(optimum.best, fit.history, message), equation_one=False), said)

    @property
    def by_draws(self) -> bool:
        """Whether intervals are those of draws: every alternative that is not improbable has enough of them."""
        return enough_draws(self.alternatives)

    def pieces(self, n: int) -> tuple[Interval, ...]:
        """The 95 % set of free parameter n, in its unit."""
        name = list(self.problem.free)[n]
        value = self.problem.value
        return tuple((value(name, a), value(name, b)) for a, b in pieces_of(self.alternatives, n))

    def deviation(self, n: int) -> float | None:
        """The standard deviation of free parameter n, in its unit, over the draws of all alternatives; None for too few draws.

        It is that of the curves' linearisation only where the inputs act linearly as far as their priors go.
        """
        if not enough_draws(self.alternatives):
            return None
        name = list(self.problem.free)[n]
        values = [[self.problem.value(name, float(unit)) for unit in known.draws.places[:, n]] for known in self.alternatives]
        shares = np.concatenate([known.probability * known.draws.shares for known in self.alternatives])
        middle = np.average(np.concatenate(values), weights=shares)
        return float(np.sqrt(np.average((np.concatenate(values) - middle) ** 2, weights=shares)))


def _candidate(problem: InverseProblem, fit: JointFit) -> Candidate:
    curves = fit.posterior.curves
    force = curves.at(fit.mode.z)[0]
    return replace(problem, scale=None).judge(curves.point(fit.mode.z), tuple(force[rows] for rows in curves.slices))


def pieces_of(alternatives: Sequence[WideAlternative], n: int, several: bool = False) -> tuple[Interval, ...]:
    """The 95 % set of free parameter n, in units of the range, the most probable alternative first; several: whether there are
    others beside them.

    It is the smallest set that holds 95 % of the posterior, and what the profiles allow within 14 % of a piece's width beside it.
    The posterior alone holds truths as often as the priors draw them; a truth where a prior ends, such as a contact without any
    friction, would lie just outside. Where one uncertain number is all that is not known (of all tests, or of each), the end of its
    prior is likely enough for an interval that follows the profile to its ends; a corner of several priors is not. Where a density
    is normal, profiles allow no more.
    Where there are too few effective draws the set is the mixture of profiles. It reaches to the optimum, whose value the result
    states.
    """
    known, shares = [each.draws for each in alternatives], [each.probability for each in alternatives]
    joined = mixture.pieces([each.paths[n] for each in alternatives], np.array(shares))
    if enough_draws(alternatives):
        parts = draws.pieces(known, shares, n)
        beside = [(low - BESIDE * (high - low), high + BESIDE * (high - low)) for low, high in parts]
        names = {known.name for known in alternatives[0].fit.posterior.curves.inputs}
        alone = not several and len(alternatives) == len(names) == 1
        joined = mixture.union(parts, joined if alone else mixture.common(beside, joined))
    return without_slits(reaching(joined, float(alternatives[0].fit.mode.z[n])))


def without_slits(pieces: Sequence[Interval]) -> tuple[Interval, ...]:
    """Pieces in rising order, joined where a gap is narrower than SLIT of the whole: draws make such gaps by chance."""
    ordered = sorted(pieces)
    joined, narrow = [ordered[0]], SLIT * (max(high for _, high in ordered) - ordered[0][0])
    for low, high in ordered[1:]:
        if low - joined[-1][1] < narrow:
            joined[-1] = joined[-1][0], max(high, joined[-1][1])
        else:
            joined.append((low, high))
    return tuple(joined)


def enough_draws(alternatives: Sequence[WideAlternative]) -> bool:
    """Whether every alternative that is not improbable has enough effective draws."""
    return all(known.draws.enough for known in alternatives if known.probability > 1 - mixture.CERTAIN)


def reaching(joined: Sequence[Interval], value: float) -> tuple[Interval, ...]:
    """Pieces of which the nearest is extended to a value that lies in none of them."""
    gaps = [max(low - value, value - high, 0.0) for low, high in joined]
    near = int(np.argmin(gaps))
    return tuple((min(low, value), max(high, value)) if n == near else (low, high) for n, (low, high) in enumerate(joined))


def widens(case: Case, problem: InverseProblem) -> bool:
    """Whether the uncertain inputs of a case can be coordinates of a fit, or its alternatives: there are some, or the law's misfit
    has a scale, and a surrogate is possible. Raises CaseError where no surrogate is possible and an input has a list of
    alternatives, or the law's misfit a scale."""
    inputs, tried = uncertain_inputs(case), alternatives(case)
    if case.fit.discrepancy.stated is not None:
        _require_smooth(case, problem, inputs)
        return True
    if not inputs and len(tried) == 1:
        return False
    relaxes = problem.kernel is not None
    if relaxes and len(tried) == 1 and not any(known.point for known in inputs):
        return False  # contact points and gains alone: the intervals are linear in them
    coordinates = len(widened_problem(problem, inputs).solved)
    possible = _learnable(case.fit) and (relaxes or coordinates > 0) and coordinates <= MOST
    lists = [name for name, _, _ in listed_inputs(case) if name != "base"]
    if lists and not possible:
        low, high = getattr(case.fit.uncertain, lists[0]).numbers
        said = (
            "a list of alternatives is fitted on surrogates: these need a free parameter beside the scale of the force (at most "
            f"{MOST} with the inputs), a method among {', '.join(SEARCHES)}, and profiles; or give uniform = [{low:g}, {high:g}]"
        )
        raise CaseError([f"fit.uncertain.{lists[0]}: {said}"])
    faults = list(faults_in_time(case.fit, ", ".join(SEARCHES))) if relaxes and not possible else []
    if faults:
        raise CaseError([line(case.path, fault) for fault in faults])
    return possible


def _require_smooth(case: Case, problem: InverseProblem, inputs: Sequence[UncertainInput]) -> None:
    """Raise CaseError where the law's misfit cannot be a term of the fit."""
    options, key = case.fit, ("fit", "discrepancy", "scale")
    coordinates, faults = len(widened_problem(problem, tuple(inputs)).solved), []
    if problem.kernel is not None:
        faults.append("is of elastic curves, and this material relaxes; remove the table")
    if any(test.kind == "field" for test in case.tests):
        faults.append("is of forces, and the case has measured displacements; remove the table, or take out test.field")
    if not _learnable(options):
        faults.append(f"acts in fits on surrogates; give fit.method one of {', '.join(SEARCHES)}, profiles = true and no direct")
    if coordinates > MOST:
        faults.append(f"acts in fits of at most {MOST} free parameters and uncertain inputs beside the scale; give some as numbers")
    if faults:
        raise CaseError([line(case.path, Fault(key, options.discrepancy.stated, f"the law's misfit {text}")) for text in faults])


def _learnable(options: Fit) -> bool:
    return options.method in SEARCHES and not options.direct and options.profiles


def wide_fit(
    case: Case,
    problem: InverseProblem,
    model: Watched,
    progress: Progress = SILENT,
    near: Callable[[Case, Mapping[str, float]], object] | None = None,
) -> WideFit | None:
    """The fit of a case whose inputs are uncertain; None where the mechanics fails too often.

    Parameters
    ----------
    case : Case
        One that `widens`.
    problem : InverseProblem
    model : Watched
    progress : Progress
    near : function
        Called with the case and with the point of the optimum before the last draws, where one alternative is certain.

    Returns
    -------
    WideFit or None
    """
    inputs = uncertain_inputs(case)
    size = sum(test.curve.force.size for test in problem.tests)
    stated = alternatives(case)
    parts = [progress.part(0.8 * n / len(stated), 0.8 * (n + 1) / len(stated)) for n in range(len(stated))]
    tried: list[WideAlternative] = []
    mesh, elements = ModelError.none(size, law_error(case, problem.tests)), None
    for (name, changes, prior), part in zip(stated, parts, strict=True):
        wide = widened_problem(replace(problem, start={**problem.start, **changes}), inputs)
        unknown = elements is None and bool(case.fit.uncertain.mesh and case.indentations)
        fit = joint_fit(wide, inputs, model, mesh, case.fit.seed, part, ROUNDS if unknown else LIMIT)
        if fit is not None and unknown:
            mesh, elements = mesh_error(case, fit, model)
            fit = _with_mesh(fit, mesh, model, case.fit.seed, part)
        if fit is None:
            continue
        scouts = drawn(fit, case.fit.seed, SCOUTS) if len(stated) > 1 else undrawn(fit)
        tried.append(WideAlternative(name, changes, prior, fit, joint_profiles(fit, shown=0), scouts))
    if not tried:
        return None
    weighed = weighed_alternatives(tried)
    ends = _telling_ends(weighed)
    shares = [progress.part(0.8 + 0.2 * n / len(weighed), 0.8 + 0.2 * (n + 1) / len(weighed)) for n in range(len(weighed))]
    pairs = zip(weighed, ends, shares, strict=True)
    proved = []
    for known, wanted, share in pairs:
        last = _ends_proved(known, wanted, model, case.fit.seed, share)
        if near is not None and known.probability >= mixture.CERTAIN:
            near(case, _candidate(problem, last.fit).parameters)
        paths = in_copy(joint_profiles, last.fit)
        proved.append(replace(last, draws=drawn(last.fit, case.fit.seed), paths=paths()))
    return WideFit(problem, tuple(weighed_alternatives(proved)), mesh, elements)


def weighed_alternatives(alternatives: Sequence[WideAlternative]) -> list[WideAlternative]:
    """The alternatives with their probabilities, the most probable first: by the evidence of draws, by Laplace's method where one
    has too few draws, and by the sizes of the residuals where these are surely smooth."""
    if by_residuals(alternatives):
        evidences = _logs_by_residuals([known.fit for known in alternatives])
    else:
        by_draws = all(known.draws.enough for known in alternatives)
        evidences = [known.draws.log_evidence if by_draws else known.fit.log_evidence() for known in alternatives]
    shares = mixture.probabilities([known.prior for known in alternatives], evidences)
    weighed = [replace(known, probability=float(share)) for known, share in zip(alternatives, shares, strict=True)]
    return sorted(weighed, key=_improbable)


def by_residuals(alternatives: Sequence[WideAlternative]) -> bool:
    """Whether alternatives are weighed by the sizes of their residuals: the evidence is for one whose residuals are surely smooth,
    or that is twice as far from the points as another: a wrong base with 57 % of misfit was certain beside the right one, of 1 %.
    Where the evidence is for one whose residuals are noise, it needs no other rule."""
    sizes = [objective_of(known.fit) for known in alternatives]
    likely = int(np.argmax([known.draws.log_evidence for known in alternatives]))
    smooth = alternatives[likely].fit.posterior.noise.smooth is not None
    return smooth or min(sizes) < BEATEN * sizes[likely]


def _logs_by_residuals(fits: Sequence[JointFit]) -> list[float]:
    """Logarithms of the likelihoods of alternatives by the sizes of their residuals, each test with as many independent points as
    under the alternative that leaves most.

    Residuals that are surely smooth are the law's misfit. Each alternative has its own covariance of these, and the evidence is the
    larger, the farther an alternative is from the points, or the smoother its residuals are: a bonded base with residuals of 0.41
    and 0.60 mN had the probability 1 beside a sliding one with 0.15 and 0.46 mN.
    """
    rhos = np.array([fit.posterior.noise.rho for fit in fits]).min(axis=0)
    errors = np.max([np.diag(fit.posterior.noise.model) for fit in fits], axis=0)  # an alternative is not worse for its own doubt
    logs = []
    for fit in fits:
        curves = fit.posterior.curves
        squares = (curves.at(fit.mode.z)[0] - curves.measured()) ** 2 + errors
        tests = zip(curves.slices, fit.posterior.noise.trust, rhos, fit.posterior.used, strict=True)
        sizes = [effective(trust.size, rho) * np.log(np.mean(trust**2 * squares[rows])) for rows, trust, rho, used in tests if used]
        matrix, centre = fit.posterior.prior_rows()
        logs.append(-0.5 * float(np.sum(sizes) + np.sum((matrix @ fit.mode.z - centre) ** 2)))
    return logs


def _telling_ends(weighed: Sequence[WideAlternative]) -> list[list[tuple[int, Array]]]:
    """Coordinates and places of those ends of profiles, for each alternative, that are ends of the mixture's intervals: the
    outermost ends of the alternatives that are not improbable. Runs at the other ends would tell the result little, and so would
    those at a bound of the range, where the interval ends anyway."""
    counted = [n for n, known in enumerate(weighed) if known.probability > 1 - mixture.CERTAIN]
    ends: list[list[tuple[int, Array]]] = [[] for _ in weighed]
    for k in weighed[0].paths:
        for side, outermost in ((0, min), (1, max)):
            n = outermost(counted, key=[known.paths[k].interval[side] for known in weighed].__getitem__)
            if weighed[n].paths[k].interval[side] != float(side):
                ends[n].append((k, weighed[n].paths[k].ends()[side]))
    return ends


def _improbable(alternative: WideAlternative) -> float:
    return -alternative.probability


def _with_mesh(fit: JointFit, mesh: ModelError, model: Watched, seed: int, progress: Progress) -> JointFit | None:
    """The fit with the error of the mesh; an optimum that was not proved without this error may be proved beside it, and one that
    was may have moved."""
    again = _again(fit, mesh.with_surrogate_of(fit.error), seed) if fit.reached else fit
    if again.reached:
        return again
    curves = fit.posterior.curves
    return joint_fit(curves.problem, curves.inputs, model, mesh, seed, progress.part(0.8, 1), LIMIT, fit)


def _again(fit: JointFit, error: ModelError, seed: int) -> JointFit:
    """The same fit with other errors of the model, without a run."""
    curves = fit.posterior.curves
    changed = fitted(curves.problem, curves.inputs, fit.surrogate, error, seed)
    return replace(changed, proofs=fit.proofs, history=fit.history)


def mesh_error(case: Case, fit: JointFit, model: Watched) -> tuple[ModelError, int | None]:
    """The error of the forces by the mesh, and the number of elements of the second mesh; none where a run for it fails."""
    curves = fit.posterior.curves
    size = curves.measured().size
    place = fit.proofs[-1].parameters if fit.reached else curves.point(fit.mode.z)  # a run that is known, where it is as good
    try:
        error = mesh_error_at(case, curves.problem, model, place)
    except Underivable:
        return ModelError.none(size, fit.error.law), None
    covar = block_diag(*error.covar) * case.fit.uncertain.mesh**2
    return ModelError(np.concatenate(error.correction), np.asarray(covar, dtype=float), law=fit.error.law), error.elements


def _ends_proved(
    known: WideAlternative, ends: Sequence[tuple[int, Array]], model: Watched, seed: int, progress: Progress
) -> WideAlternative:
    """The alternative on a surrogate that has learnt runs at ends of its profiles, and what the runs say of earlier profiles. Where
    these runs move the optimum, it is proved again. Its profiles and draws are still the earlier ones."""
    fit = known.fit
    curves = fit.posterior.curves
    if not ends:
        return known
    proofs = _ends_run(known, ends, model, progress.of_runs("runs at the ends of profiles"))
    confirmed = {k: tuple(proof.end for proof in proofs if proof.number == k) for k in known.paths}
    surrogate = learn(curves.problem, model.known, exact=True) or fit.surrogate
    telling = [proof for proof in proofs if proof.own and proof.end.chi2 is not None and proof.end.chi2 <= CONCERNS]
    errors = prediction_errors(fit, [curves.point(proof.place) for proof in telling], [proof.run for proof in telling])
    last = _again(replace(fit, surrogate=surrogate), held_out(fit.error, errors, earlier=len(fit.proofs)), seed)
    if fit.posterior.noise.smooth is not None and objective_of(last) > FARTHER * objective_of(fit):
        last = fit  # smooth residuals tell their level so little that a small change of the surrogate may lead away from the points
    if fit.reached and not last.reached:  # the runs moved the optimum away from the place that was proved
        last = joint_fit(curves.problem, curves.inputs, model, last.error, seed, progress.part(0.9, 1), LIMIT, last) or last
    return replace(known, fit=last, confirmed=confirmed)


@dataclass(frozen=True, eq=False)
class _EndRun:
    """A run at the end of the profile of a free parameter (its number), or at an end of another one near it (not its own)."""

    number: int
    place: Array
    run: Evaluation
    end: ConfirmedPoint
    own: bool


def _ends_run(known: WideAlternative, ends: Sequence[tuple[int, Array]], model: Watched, report: Report) -> list[_EndRun]:
    """Runs at ends of profiles (number of the free parameter, place), as in fits whose inputs are exact: ends that are near each
    other share a run; of those that the surrogate predicts surely, the least sure one is run, and others only where a run was not
    as predicted."""
    fit, roots = known.fit, {n: float(np.sqrt(known.paths[n].limit)) for n, _ in ends}
    numbers = fit.posterior.curves.solved_numbers
    widths = np.ptp(np.vstack([path.places for path in known.paths.values()]), axis=0)[numbers]
    separate = apart([z[numbers] for _, z in ends], widths)
    nearest = [near(z[numbers], separate, widths) for _, z in ends]
    first = [nearest.index(k) for k in range(len(separate))]  # the end at which each run is made
    doubts = [_doubt(fit, ends[n][1]) / roots[ends[n][0]] for n in first]
    wanted = [k for k, doubt in enumerate(doubts) if doubt > SURE] or [int(np.argmax(doubts))]
    proofs = _runs_at(fit, ends, nearest, [(k, first[k]) for k in wanted], model, report)
    allowed = {first[k]: max(SURE, BELIED * doubts[k]) for k in wanted}
    own = [(ends[n][0], proof.end) for n, proof in proofs.items() if proof.own]
    right = [as_predicted(end, share * roots[k]) for (k, end), share in zip(own, allowed.values(), strict=True)]
    if len(wanted) < len(first) and not all(right):
        others = [(k, n) for k, n in enumerate(first) if k not in wanted]
        proofs |= _runs_at(fit, ends, nearest, others, model, report)
    return [proofs[n] for n in sorted(proofs)]


def _runs_at(
    fit: JointFit,
    ends: Sequence[tuple[int, Array]],
    nearest: Sequence[int | None],
    wanted: Sequence[tuple[int, int]],
    model: Watched,
    report: Report,
) -> dict[int, _EndRun]:
    """What runs say of ends, by their numbers: wanted are the number of each run and that of the end at which it is made, and the
    runs of all ends are given."""
    curves = fit.posterior.curves
    ran = evaluate_at_reference(curves.problem, model, [curves.point(ends[n][1]) for _, n in wanted], report)
    proofs = {}
    for (k, at), run in zip(wanted, ran, strict=True):
        place = ends[at][1]
        for n, (number, _) in enumerate(ends):
            if nearest[n] == k:
                proofs[n] = _EndRun(number, place, run, _confirmed(fit, number, place, run), n == at)
    return proofs


def _doubt(fit: JointFit, z: Array) -> float:
    """The error of the root of chi2 at a place by the jackknife; infinite where a run alone determines the surrogate there."""
    curves, climber = fit.posterior.curves, Climber(fit.posterior)
    place, force, size = curves.searched_units(z), curves.at(z)[0], climber.rows.size
    lost = fit.surrogate.spread(place)
    if not np.isfinite(lost).all():
        return np.inf
    predicted = fit.surrogate.curves(place[None])[0]
    relative = np.divide(lost, predicted, out=np.zeros_like(lost), where=predicted != 0)
    residuals, off = climber.residuals(z)[0], (relative * force)[:, climber.rows] @ climber.W.T
    growth = max(float(residuals @ residuals) - fit.mode.chi2, 1.0)
    shifts = (np.abs(off @ residuals[:size]) + 0.5 * np.sum(off**2, axis=1)) / np.sqrt(growth)
    return float(np.sqrt(np.sum(shifts**2)))


def _confirmed(fit: JointFit, n: int, z: Array, run: Evaluation) -> ConfirmedPoint:
    """What a run at a place of the profile of free parameter n says of the chi2 there."""
    curves, climber = fit.posterior.curves, Climber(fit.posterior)
    point = curves.point(z)
    value = point[curves.free[n]]
    if run.forces is None:
        return ConfirmedPoint(value, None, None, run.cause, point)
    residuals = climber.residuals(z)[0]
    predicted = float(residuals @ residuals)
    off = prediction_errors(fit, [point], [run])[0] * curves.measured()
    residuals[: climber.rows.size] -= climber.W @ off[climber.rows]
    chi2 = max(float(residuals @ residuals) - fit.mode.chi2, 0.0)
    return ConfirmedPoint(value, chi2, max(predicted - fit.mode.chi2, 0.0), None, point)
