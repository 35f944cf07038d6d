"""What a WideFit says: estimates with their intervals, shares of the inputs, single tests, and notes."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from indentfit.arrays import Array
from indentfit.case import Case
from indentfit.inference.certainty import Certainty, Findings, mesh_size, published_comparison, published_objective
from indentfit.inference.curve_bands import law_misfit
from indentfit.inference.density import Density
from indentfit.inference.draws import drawn
from indentfit.inference.identifiability import NOTE, Identifiability, identifiability, limit_of, notes_of
from indentfit.inference.inputs import CORRECTED, Solution
from indentfit.inference.joint import JointFit, beaten, fitted
from indentfit.inference.joint_consistency import joint_agreement, joint_predictions
from indentfit.inference.joint_profiles import joint_profiles
from indentfit.inference.limits import Limit, limits
from indentfit.inference.misfit import recording
from indentfit.inference.mixture import CERTAIN
from indentfit.inference.noise import effective, fewest, whiteness
from indentfit.inference.plain import Interval
from indentfit.inference.posterior import Climber
from indentfit.inference.result import AloneEstimate, CurveNoise, ParameterEstimate, Profile, TestAlone
from indentfit.inference.seen import seen_sentences, with_seen
from indentfit.inference.shares import BY_RESIDUALS, UncertainInputs, WhatIf
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
from indentfit.inference.what_if import Again, warnings_of, what_ifs
from indentfit.inference.wide_fit import SCOUTS, WideAlternative, WideFit, by_residuals
from indentfit.inference.wide_shares import span_of, uncertain_in, values_of
from indentfit.inference.zeroed_late import zeroed_late
from indentfit.inverse.exploration import Watched, facts_of
from indentfit.inverse.methods import Solved
from indentfit.inverse.objective import rmse
from indentfit.inverse.problem import InverseProblem
from indentfit.runs.copied import in_copy

COORDINATES = (
    "uncertain inputs are coordinates of the fit: intervals are the smallest sets that hold 95 % of the posterior of parameters, "
    "inputs and noise, by draws on the surrogate ({draws:,} draws, effective number {effective:,.0f}, seed {seed})"
)
PROFILES = (
    "uncertain inputs are coordinates of the fit: intervals are profiles over parameters and inputs, under the inputs' priors, and "
    "so may be too wide: draws of the posterior have an effective number of {effective:.0f} only"
)
OVERLAP = "shares of the variance overlap where sources act alike: each is what would vanish without its source"
NEARER = (
    "a run of the search is less than half as far from the points as these values: the residuals are so smooth that places of such "
    "different misfit are nearly as probable, and the interval holds both; look for what makes the residuals smooth"
)
UNPROVED = (
    "the surrogate's prediction at the optimum was not proved by a run to a third of a standard error: intervals are doubtful"
)


def wide_certainty(case: Case, problem: InverseProblem, model: Watched, solved: Solved, fit: WideFit) -> Certainty:
    """The Certainty of a WideFit.

    Parameters
    ----------
    case, problem, model
    solved : Solved
        With the candidate and derivatives of `fit`.
    fit : WideFit

    Returns
    -------
    Certainty
    """
    best, slopes = solved.optimum.best, solved.optimum.derivatives
    assert best is not None and slopes is not None  # `fit` has both
    narrow = replace(problem, scale=None)
    known = identifiability(narrow, best, slopes)
    profiles = {name: _profile(fit, n) for n, name in enumerate(problem.free)}
    singles = _singles(case, fit)
    waited = _alone(case, fit, singles)
    uncertain = uncertain_in(case, fit)
    at_inputs = replace(problem, start={**problem.start, **uncertain.at})  # type: ignore[dict-item]
    objective = published_objective(Solution(case, at_inputs, model, best, known))
    noise = _noise(fit)
    limited = limits(uncertain, noise, problem.free, mesh_size(case, model))
    predicted = joint_predictions(fit.best.fit, singles, case.fit.seed)
    pressed = [test.kind == "indentation" for test in case.tests]
    reconciling = joint_agreement(fit.best.fit, singles, predicted, pressed)
    estimates = {name: _estimate(fit, n, known, uncertain, limited[name]) for n, name in enumerate(problem.free)}
    alone = waited()
    estimates = unless_proved(against_each_other(estimates, predicted, alone), solved.optimum.success)
    estimates = with_seen(case, unless_in_doubt(estimates, recording(case)), best.parameters)
    alone = alone_unless_in_doubt(alone_unless_proved(alone, solved.optimum.success), recording(case))
    published = published_comparison(case, objective, estimates)
    exact = _what_ifs(case, fit, model, known, estimates)
    return Certainty(
        known=known,
        estimates=estimates,
        findings=Findings(profiles=profiles, tests_alone=alone),
        noise=noise,
        uncertain=uncertain,
        surrogate=facts_of(fit.best.fit.surrogate, fit.best.fit.proofs),
        predicted=predicted,
        published=published,
        conclusions=(
            *contradictions(predicted),
            *((reconciling,) if reconciling else ()),
            *zeroed_late(case, problem, best.forces, [name for name, known in noise.items() if known.systematic]),
            *conclusions(estimates, len({test.test for test in problem.tests}), published),
            *_preferred(fit),
            *seen_sentences(case, best.parameters),
            *warnings_of(exact, estimates),
        ),
        notes=tuple(_notes(case, fit)),
        taken_as_known=exact,
        law_misfit=law_misfit(case, fit),
    )


def _what_ifs(
    case: Case, fit: WideFit, model: Watched, known: Identifiability, estimates: Mapping[str, ParameterEstimate]
) -> tuple[WhatIf, ...]:
    """The inputs that are taken as known, with what the parameters would be at other values of them, under the best alternative:
    the optimum moves over parameters and uncertain inputs."""
    curves, z = fit.best.fit.posterior.curves, fit.best.fit.mode.z
    force = curves.at(z)[0]
    best = replace(curves.problem, scale=None).judge(curves.point(z), [force[rows] for rows in curves.slices])
    telling = any(kind_of(estimate) == "determined" for estimate in estimates.values())
    solution = Solution(case, curves.problem, model, best, known)
    return what_ifs(solution, _fitted_again(fit), telling if case.fit.what_if is None else case.fit.what_if)


def _fitted_again(fit: WideFit) -> Again:
    """The function from curves to the free parameters that fit them best, with the uncertain inputs, from the optimum on."""
    posterior, mode = fit.best.fit.posterior, fit.best.fit.mode
    own = posterior.curves

    def again(measured: list[Array]) -> dict[str, float]:
        curves = replace(own, problem=own.problem.measured(measured))
        values = curves.point(Climber(replace(posterior, curves=curves)).climb(mode.z)[0])
        return {name: values[name] for name in fit.problem.free}

    return again


def _profile(fit: WideFit, n: int) -> Profile:
    """The profile under the most probable alternative."""
    best = fit.best
    path = best.paths[n]
    confirmed = (best.confirmed or {}).get(n, ())
    values = tuple(values_of(best.fit, n, path.units))
    return Profile(values, tuple(path.chi2.tolist()), path.limit, span_of(best.fit, n, path.interval), confirmed, joint=True)


def _estimate(fit: WideFit, n: int, known: Identifiability, uncertain: UncertainInputs, limit: Limit) -> ParameterEstimate:
    name = list(fit.problem.free)[n]
    bounds, pieces = fit.problem.free[name], fit.pieces(n)
    value = values_of(fit.best.fit, n, fit.best.fit.mode.z[[n]])[0]
    total = uncertain.stderr_total[name]
    error = (total if total is not None else np.inf) * float(np.sqrt(fit.best.fit.of_noise[n]))
    interval: Interval = (pieces[0][0], pieces[-1][1])
    half = float(fit.best.fit.quantiles[n]) * (total or np.inf)
    at_bound = reached(known.at_bound[n], value, interval, bounds)
    return ParameterEstimate(
        value=value,
        unit="1",
        start=bounds.start,
        min=bounds.min,
        max=bounds.max,
        stderr=error if np.isfinite(error) else None,
        at_bound=at_bound or None,
        interval=interval,
        interval_linear=(max(value - half, bounds.min), min(value + half, bounds.max)),
        verdict=verdict(value, interval, bounds, at_bound, limit),
        limited_by="bound" if at_bound else limit.cause,
        stderr_total=total,
        pieces=pieces if len(pieces) > 1 else None,
    )


def _noise(fit: WideFit) -> dict[str, CurveNoise]:
    joint = fit.best.fit
    curves, noises = joint.posterior.curves, {}
    left = curves.at(joint.mode.z)[0] - curves.measured() + joint.posterior.law_at(joint.mode.z)
    draws, rhos = fit.best.draws, iter(Density(joint).rho(fit.best.draws.places).T)
    for n, test in enumerate(fit.problem.tests):
        size, rho = test.curve.force.size, float(joint.posterior.noise.rho[n])
        if joint.posterior.used[n]:
            sigma = float(joint.posterior.noise.sigma[n])
            white = whiteness(np.eye(size), left[curves.slices[n]])
            least = fewest(size, next(rhos), draws.shares)
            beside = max(float(joint.posterior.noise.stated[n]) ** 2 - sigma**2, 0.0) ** 0.5
            noises[test.name] = CurveNoise(sigma, rho, effective(size, rho), size, white, beside, least)
    return noises


def _singles(case: Case, fit: WideFit) -> list[JointFit | None]:
    """The fit to each test alone, on the surrogate of the best alternative; None for a test without weight, or a single one."""
    tests, joint = fit.problem.tests, fit.best.fit
    if len(tests) < 2 or fit.problem.segmented:  # the segments of a test are no tests that could contradict each other
        return [None for _ in tests]
    problem, inputs = joint.posterior.curves.problem, joint.posterior.curves.inputs
    ones = [[k == n for k in range(len(tests))] for n in range(len(tests))]
    return [
        fitted(problem, inputs, joint.surrogate, joint.error, case.fit.seed, used) if test.weight else None
        for test, used in zip(tests, ones, strict=True)
    ]


def _alone(case: Case, fit: WideFit, singles: Sequence[JointFit | None]) -> Callable[[], dict[str, TestAlone]]:
    """Begins with the parameters that each test determines alone, and gives a function that waits for them."""
    limit = limit_of(tuple(_noise(fit).values()))
    tests = zip(fit.problem.tests, singles, strict=True)
    begun = {
        test.name: in_copy(_alone_in, case, fit, n, single, limit) for n, (test, single) in enumerate(tests) if single is not None
    }
    return lambda: {name: value() for name, value in begun.items()}


def _alone_in(case: Case, fit: WideFit, n: int, single: JointFit, limit: Limit) -> TestAlone:
    """The parameters that test n determines alone."""
    curves, test = single.posterior.curves, fit.problem.tests[n]
    force = curves.at(single.mode.z)[0][curves.slices[n]]
    rows = {}
    paths, draws = joint_profiles(single, shown=0), drawn(single, case.fit.seed, SCOUTS)
    as_whole = WideAlternative(test.name, {}, 1.0, single, paths, draws)
    for k, name in enumerate(curves.free):
        value, span = values_of(single, k, single.mode.z[[k]])[0], span_of(single, k, as_whole.interval(k))
        rows[name] = AloneEstimate(value, span, verdict(value, span, fit.problem.free[name], "", limit))
    return TestAlone(rmse(test, force), None, rows)


def _preferred(fit: WideFit) -> Iterator[str]:
    """Which alternative the curves prefer."""
    if len(fit.alternatives) > 1:
        said = ", ".join(f"{known.name} with probability {known.probability:.2g}" for known in fit.alternatives)
        how = BY_RESIDUALS if by_residuals(fit.alternatives) else "by its evidence"
        yield f"alternatives, each fitted and weighed {how}: {said}"


def _notes(case: Case, fit: WideFit) -> Iterator[str]:
    yield NOTE
    counted = [known.draws for known in fit.alternatives if known.probability > 1 - CERTAIN]
    effective, draws = min(known.effective for known in counted), sum(known.shares.size for known in counted)
    yield (COORDINATES if fit.by_draws else PROFILES).format(draws=draws, effective=effective, seed=case.fit.seed)
    if fit.elements is not None:
        sd = float(np.sqrt(np.max(np.diag(fit.mesh.mesh))))
        yield CORRECTED.format(most=np.abs(fit.mesh.correction).max(), elements=fit.elements, sd=sd)
    yield OVERLAP
    if not fit.reached:
        yield UNPROVED
    yield from notes_of(_noise(fit))
    best: WideAlternative = fit.best
    if beaten(best.fit):
        yield NEARER
    if best.changes:
        yield f"the values are those under {best.name}, the most probable alternative, and not those of the case"
