"""What a WideFit says: estimates with their intervals, shares of the inputs, single tests, and notes."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from indentfit.arrays import Array
from indentfit.case import Case
from indentfit.inference.certainty import Certainty, Findings, mesh_size, published_comparison
from indentfit.inference.identifiability import MISFIT, NOTE, Identifiability, identifiability, limit_of
from indentfit.inference.inputs import CORRECTED, Solution
from indentfit.inference.joint import JointFit, fitted, joint_profiles
from indentfit.inference.joint_consistency import joint_predictions
from indentfit.inference.limits import Limit, limits
from indentfit.inference.noise import whiteness
from indentfit.inference.plain import Interval
from indentfit.inference.posterior import Climber
from indentfit.inference.result import AloneEstimate, CurveNoise, ParameterEstimate, Profile, TestAlone
from indentfit.inference.shares import AlternativeFit, InputShare, NoiseShare, UncertainInputs
from indentfit.inference.verdicts import against_each_other, conclusions, contradictions, verdict
from indentfit.inference.what_if import taken_as_known
from indentfit.inference.wide_fit import WideAlternative, WideFit
from indentfit.inverse.exploration import Watched, facts_of
from indentfit.inverse.methods import Solved
from indentfit.inverse.objective import rmse
from indentfit.inverse.problem import InverseProblem
from indentfit.inverse.wide import UncertainInput

COORDINATES = (
    "uncertain inputs are coordinates of the fit: intervals are profiles over parameters and inputs, under the inputs' priors"
)
UNPROVED = (
    "the surrogate's prediction at the optimum was not proved by a run to a fifth of a standard error: intervals are doubtful"
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
    uncertain = _uncertain(case, fit)
    noise = _noise(fit)
    limited = limits(uncertain, noise, problem.free, mesh_size(case, model))
    singles = _singles(case, fit)
    alone = _alone(fit, singles)
    predicted = joint_predictions(fit.best.fit, singles, case.fit.seed)
    estimates = {name: _estimate(fit, n, known, uncertain, limited[name]) for n, name in enumerate(problem.free)}
    estimates = against_each_other(estimates, predicted, alone)
    at_inputs = replace(problem, start={**problem.start, **uncertain.at})  # type: ignore[dict-item]
    published = published_comparison(Solution(case, at_inputs, model, best, known), estimates)
    return Certainty(
        known=known,
        estimates=estimates,
        findings=Findings(profiles=profiles, tests_alone=alone),
        noise=noise,
        uncertain=uncertain,
        surrogate=facts_of(fit.best.fit.surrogate, fit.best.fit.proofs),
        predicted=predicted,
        published=published,
        conclusions=(*contradictions(predicted), *conclusions(estimates, len(problem.tests), published), *_preferred(fit)),
        notes=tuple(_notes(fit)),
        taken_as_known=taken_as_known(case),
    )


def _values(fit: JointFit, n: int, units: Array) -> list[float]:
    """Values of coordinate n, in its unit."""
    curves = fit.posterior.curves
    if n >= len(curves.free):
        return [curves.inputs[n - len(curves.free)].value_at(float(unit)) for unit in units]
    bounds = curves.problem.free[curves.free[n]]
    return [float(bounds.min + unit * (bounds.max - bounds.min)) for unit in units]


def _span(fit: JointFit, n: int, interval: Interval) -> Interval:
    low, high = _values(fit, n, np.array(interval))
    return low, high


def _profile(fit: WideFit, n: int) -> Profile:
    """The profile under the most probable alternative."""
    best = fit.best
    path = best.paths[n]
    confirmed = (best.confirmed or {}).get(n, ())
    values = tuple(_values(best.fit, n, path.units))
    return Profile(values, tuple(path.chi2.tolist()), path.limit, _span(best.fit, n, path.interval), confirmed)


def _estimate(fit: WideFit, n: int, known: Identifiability, uncertain: UncertainInputs, limit: Limit) -> ParameterEstimate:
    name = list(fit.problem.free)[n]
    bounds, pieces = fit.problem.free[name], fit.pieces(n)
    value = _values(fit.best.fit, n, fit.best.fit.mode.z[[n]])[0]
    error, total = float(known.stderr[n]), uncertain.stderr_total[name]
    interval: Interval = (pieces[0][0], pieces[-1][1])
    half = fit.best.fit.quantile * (total or np.inf)
    return ParameterEstimate(
        value=value,
        unit="1",
        start=bounds.start,
        min=bounds.min,
        max=bounds.max,
        stderr=error if np.isfinite(error) else None,
        at_bound=known.at_bound[n] or None,
        interval=interval,
        interval_linear=(max(value - half, bounds.min), min(value + half, bounds.max)),
        verdict=verdict(value, interval, bounds, known.at_bound[n], limit),
        limited_by="bound" if known.at_bound[n] else limit.cause,
        stderr_total=total,
        pieces=pieces if len(pieces) > 1 else None,
    )


def _uncertain(case: Case, fit: WideFit) -> UncertainInputs:
    """The inputs with their values after the fit, and their shares in the parameters' variances under the best alternative."""
    joint, names = fit.best.fit, list(fit.problem.free)
    curves, covar = joint.posterior.curves, joint.mode.covar
    p = len(names)
    ranges = fit.problem.ranges
    sd = np.sqrt(np.diag(covar))
    rows: dict[str, InputShare] = {}
    paths = joint_profiles(joint, range(p, curves.size))
    for n, known in enumerate(curves.inputs, start=p):
        effect = ranges * covar[:p, n] / sd[n]
        share = (covar[:p, n] / sd[:p] / sd[n]) ** 2
        span = _span(joint, n, paths[n].interval)
        rows[_label(case, known)] = InputShare(
            value=known.value,
            sd=known.prior.sd,
            effect=_named(names, effect),
            share=_named(names, share),
            prior=known.prior.words(known.unit),
            fitted=known.value_at(float(joint.mode.z[n])),
            interval=span,
            unit=known.unit,
        )
    rows |= _of_mesh(fit, names)
    rows |= _of_base(case, fit, names)
    alone = np.diag(np.linalg.inv(np.linalg.inv(covar)[:p, :p]))
    at = {known.point: known.value_at(float(joint.mode.z[n])) for n, known in enumerate(curves.inputs, start=p) if known.point}
    total = {name: float(error) for name, error in zip(names, ranges * sd[:p], strict=True)}
    noise = NoiseShare(_named(names, alone / sd[:p] ** 2))
    return UncertainInputs(rows, noise, dict(total), {**at, **fit.best.changes}, tuple(_alternatives(fit)))


def _label(case: Case, known: UncertainInput) -> str:
    return known.name if known.test is None else f"{known.name} ({case.tests[known.test].name})"


def _of_mesh(fit: WideFit, names: Sequence[str]) -> dict[str, InputShare]:
    """The share of what the correction for the mesh leaves."""
    if fit.elements is None:
        return {}
    joint = fit.best.fit
    noise = joint.posterior.noise
    force = joint.posterior.curves.measured()
    left = fit.mesh.mesh * np.outer(force, force)
    without = replace(joint.posterior, noise=replace(noise, model=noise.model - left))
    p = len(names)
    gone = 1 - np.diag(Climber(without).covar(joint.mode.z))[:p] / np.diag(joint.mode.covar)[:p]
    sd = float(np.sqrt(np.max(np.diag(fit.mesh.mesh))))
    spread = np.sqrt(np.maximum(gone, 0.0) * np.diag(joint.mode.covar)[:p]) * fit.problem.ranges
    return {"mesh": InputShare(0.0, sd, _named(names, spread), _named(names, np.maximum(gone, 0.0)), fit.elements)}


def _of_base(case: Case, fit: WideFit, names: Sequence[str]) -> dict[str, InputShare]:
    """The parameters' changes on the other base, by the fit there."""
    own = [known for known in fit.alternatives if not known.changes]
    other = [known for known in fit.alternatives if known.changes]
    if not own or not other:
        return {}
    change = (other[0].fit.mode.z - own[0].fit.mode.z)[: len(names)] * fit.problem.ranges
    odds = own[0].probability * other[0].probability
    variance = np.diag(fit.best.fit.mode.covar)[: len(names)] * fit.problem.ranges**2
    share = odds * change**2 / (variance + odds * change**2)
    base = case.sample.base
    return {"base": InputShare(base, None, _named(names, change), _named(names, share), probability=case.fit.uncertain.base)}


def _alternatives(fit: WideFit) -> Iterator[AlternativeFit]:
    """What each alternative found, where there are several."""
    for known in fit.alternatives if len(fit.alternatives) > 1 else ():
        joint = known.fit
        curves = joint.posterior.curves
        point, force = curves.point(joint.mode.z), curves.at(joint.mode.z)[0]
        sizes = {t.name: rmse(t, force[rows]) for t, rows in zip(curves.problem.tests, curves.slices, strict=True)}
        intervals = {name: _span(joint, n, known.paths[n].interval) for n, name in enumerate(curves.free)}
        values = {name: point[name] for name in curves.free}
        yield AlternativeFit(known.name, known.prior, known.probability, values, intervals, sizes)


def _noise(fit: WideFit) -> dict[str, CurveNoise]:
    joint = fit.best.fit
    curves, noises = joint.posterior.curves, {}
    left = curves.at(joint.mode.z)[0] - curves.measured()
    for n, test in enumerate(fit.problem.tests):
        size, rho = test.curve.force.size, float(joint.posterior.noise.rho[n])
        if joint.posterior.used[n]:
            sigma = float(joint.posterior.noise.sigma[n])
            noises[test.name] = CurveNoise(
                sigma, rho, size * (1 - rho) / (1 + rho), size, whiteness(np.eye(size), left[curves.slices[n]])
            )
    return noises


def _singles(case: Case, fit: WideFit) -> list[JointFit | None]:
    """The fit to each test alone, on the surrogate of the best alternative; None for a test without weight, or a single one."""
    tests, joint = fit.problem.tests, fit.best.fit
    if len(tests) < 2:
        return [None for _ in tests]
    problem, inputs = joint.posterior.curves.problem, joint.posterior.curves.inputs
    ones = [[k == n for k in range(len(tests))] for n in range(len(tests))]
    return [
        fitted(problem, inputs, joint.surrogate, joint.error, case.fit.seed, used) if test.weight else None
        for test, used in zip(tests, ones, strict=True)
    ]


def _alone(fit: WideFit, singles: Sequence[JointFit | None]) -> dict[str, TestAlone]:
    """The parameters that each test determines alone."""
    limit = limit_of(tuple(_noise(fit).values()))
    alone = {}
    for n, (test, single) in enumerate(zip(fit.problem.tests, singles, strict=True)):
        if single is None:
            continue
        curves = single.posterior.curves
        force = curves.at(single.mode.z)[0][curves.slices[n]]
        rows = {}
        for k, path in joint_profiles(single).items():
            name = curves.free[k]
            value, span = _values(single, k, single.mode.z[[k]])[0], _span(single, k, path.interval)
            rows[name] = AloneEstimate(value, span, verdict(value, span, fit.problem.free[name], "", limit))
        alone[test.name] = TestAlone(rmse(test, force), None, rows)
    return alone


def _preferred(fit: WideFit) -> Iterator[str]:
    """Which alternative the curves prefer."""
    if len(fit.alternatives) > 1:
        said = ", ".join(f"{known.name} with probability {known.probability:.2g}" for known in fit.alternatives)
        yield f"alternatives, each fitted and weighed by its evidence: {said}"


def _notes(fit: WideFit) -> Iterator[str]:
    yield NOTE
    yield COORDINATES
    if fit.elements is not None:
        sd = float(np.sqrt(np.max(np.diag(fit.mesh.mesh))))
        yield CORRECTED.format(most=np.abs(fit.mesh.correction).max(), elements=fit.elements, sd=sd)
    if not fit.best.fit.reached:
        yield UNPROVED
    if any(known.systematic for known in _noise(fit).values()):
        yield MISFIT
    best: WideAlternative = fit.best
    if best.changes:
        yield f"the values are those under {best.name}, the most probable alternative, and not those of the case"


def _named(names: Sequence[str], values: Array) -> dict[str, float | None]:
    return {name: (float(value) if np.isfinite(value) else None) for name, value in zip(names, values, strict=True)}
