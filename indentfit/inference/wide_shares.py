"""The inputs of a WideFit after the fit, and the part of each parameter's interval that each of them makes.

The share of an input is the part of the squared width of a parameter's profile that would vanish if the input were known to have
its value at the optimum: both widths are those of profiles, so a share holds where an input acts far from the optimum only, or in
one direction, such as a friction that matters where little is left of it. The interval of an input is that of its profile too.
"""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace

import numpy as np

from indentfit.arrays import Array
from indentfit.case import Case
from indentfit.inference.density import Density
from indentfit.inference.joint import JointFit
from indentfit.inference.joint_profiles import JointPath, JointWalk, joint_profiles
from indentfit.inference.plain import Interval
from indentfit.inference.posterior import Climber, Mode, NoiseModel
from indentfit.inference.shares import DISCREPANCY, AlternativeFit, InputShare, NoiseShare, UncertainInputs
from indentfit.inference.wide_fit import WideAlternative, WideFit
from indentfit.inverse.objective import rmse
from indentfit.inverse.wide import UncertainInput, listed_inputs


def uncertain_in(case: Case, fit: WideFit) -> UncertainInputs:
    """The inputs with their values after the fit, and their shares in the parameters' variances under the best alternative."""
    joint, names = fit.best.fit, list(fit.problem.free)
    curves, covar = joint.posterior.curves, joint.mode.covar
    p = len(names)
    ranges = _ranges(fit)
    sd = np.sqrt(np.diag(covar))
    rows: dict[str, InputShare] = {}
    paths = joint_profiles(joint, range(p, curves.size), shown=0)
    whole = [fit.best.paths[k] for k in range(p)]
    for n, known in enumerate(curves.inputs, start=p):
        effect = ranges * covar[:p, n] / sd[n]
        share = _vanishing(joint, whole, [n])
        rows[_label(case, known)] = InputShare(
            value=known.value,
            sd=known.prior.sd,
            effect=_named(names, effect),
            share=_named(names, share),
            prior=known.prior.words(known.unit),
            fitted=known.value_at(float(joint.mode.z[n])),
            interval=span_of(joint, n, paths[n].interval),
            unit=known.unit,
        )
    rows |= _of_mesh(fit, whole)
    rows |= _of_law(fit, whole)
    rows |= _of_alternatives(case, fit, names)
    at = {known.point: known.value_at(float(joint.mode.z[n])) for n, known in enumerate(curves.inputs, start=p) if known.point}
    drawn = [fit.deviation(n) for n in range(p)]
    linear = (ranges * sd[:p]).tolist()
    total = {name: error if known is None else known for name, known, error in zip(names, drawn, linear, strict=True)}
    alone = _without_law(_without_mesh(fit, joint))
    noise = NoiseShare(_named(names, 1 - _vanishing(alone, whole, range(p, curves.size))))
    return UncertainInputs(rows, noise, dict(total), {**at, **fit.best.changes}, tuple(_alternatives(fit)))


def _label(case: Case, known: UncertainInput) -> str:
    return known.name if known.test is None else f"{known.name} ({case.tests[known.test].name})"


def _vanishing(joint: JointFit, whole: Sequence[JointPath], held: Collection[int]) -> Array:
    """The part of the squared width of each free parameter's interval in the whole fit that is missing where coordinates are held,
    or under the errors of `joint`. Both intervals have the limit of the whole fit: with fewer errors the noise alone would decide
    the limit, which may be far larger where few points tell the noise."""
    widths = np.array(
        [[np.ptp(JointWalk(joint, k, held, path.limit).ends()), np.ptp(path.interval)] for k, path in enumerate(whole)]
    )
    return np.asarray(1 - np.minimum(widths[:, 0] / np.maximum(widths[:, 1], 1e-300), 1.0) ** 2)


def _without_mesh(fit: WideFit, joint: JointFit) -> JointFit:
    """A joint fit as if the correction for the mesh left no error."""
    noise, force = joint.posterior.noise, joint.posterior.curves.measured()
    return _under(joint, replace(noise, model=noise.model - fit.mesh.mesh * np.outer(force, force)))


def _without_law(joint: JointFit) -> JointFit:
    """A joint fit as if the law had no misfit."""
    noise = joint.posterior.noise
    return joint if noise.law is None else _under(joint, replace(noise, law=None))


def _under(joint: JointFit, noise: NoiseModel) -> JointFit:
    """A joint fit under another noise, at the optimum near its own."""
    without = replace(joint.posterior, noise=noise)
    climber = Climber(without)
    z, chi2 = climber.climb(joint.mode.z)
    return replace(joint, posterior=without, mode=Mode(z, chi2, climber.covar(z)), others=())


def _of_mesh(fit: WideFit, whole: Sequence[JointPath]) -> dict[str, InputShare]:
    """The share of what the correction for the mesh leaves."""
    if fit.elements is None:
        return {}
    effect, share = _of_errors(fit, _without_mesh(fit, fit.best.fit), whole)
    sd = float(np.sqrt(np.max(np.diag(fit.mesh.mesh))))
    return {"mesh": InputShare(0.0, sd, effect, share, fit.elements)}


def _of_law(fit: WideFit, whole: Sequence[JointPath]) -> dict[str, InputShare]:
    """The share of the law's misfit, where the case states one."""
    law = fit.best.fit.posterior.noise.law
    if law is None:
        return {}
    effect, share = _of_errors(fit, _without_law(fit.best.fit), whole)
    if law.ends is None:
        return {DISCREPANCY: InputShare(0.0, law.scale, effect, share, prior=f"{law.scale:.2g} of the largest force")}
    prior = f"{law.ends[0]:g} to {law.ends[1]:g} of the largest force"
    return {DISCREPANCY: InputShare(0.0, law.scale, effect, share, None, None, prior, law.scale, scale_interval(fit.best))}


def scale_interval(known: WideAlternative) -> Interval:
    """The 95 % interval of an unknown scale of the law's misfit, between equal tails of the draws."""
    scales = Density(known.fit).scale(known.draws.places)
    order = np.argsort(scales)
    low, high = np.interp([0.025, 0.975], np.cumsum(known.draws.shares[order]), scales[order])
    return float(low), float(high)


def _of_errors(
    fit: WideFit, without: JointFit, whole: Sequence[JointPath]
) -> tuple[dict[str, float | None], dict[str, float | None]]:
    """The effect on each parameter of errors of the curves that `without` lacks, and their share."""
    names, covar = list(fit.problem.free), np.diag(fit.best.fit.mode.covar)
    spread = np.sqrt(np.maximum(covar - np.diag(without.mode.covar), 0.0))[: len(names)] * _ranges(fit)
    return _named(names, spread), _named(names, _vanishing(without, whole, []))


def _of_alternatives(case: Case, fit: WideFit, names: Sequence[str]) -> dict[str, InputShare]:
    """The part of each parameter's variance that is between the values of each input that is known as alternatives."""
    inner = np.diag(fit.best.fit.mode.covar)[: len(names)] * _ranges(fit) ** 2
    rows = {}
    for name, key, own in listed_inputs(case):
        levels = [str(known.changes.get(key, own)) for known in fit.alternatives]
        weights = np.array([known.probability for known in fit.alternatives])
        modes = np.array([[fit.problem.value(*pair) for pair in zip(names, k.fit.mode.z, strict=False)] for k in fit.alternatives])
        distinct = list(dict.fromkeys(levels))
        if len(distinct) < 2:
            continue
        shares, means = [], []
        for level in distinct:
            here = np.array([other == level for other in levels])
            shares.append(weights[here].sum())
            means.append(np.average(modes[here], axis=0, weights=np.maximum(weights[here], 1e-300)))
        middle = np.average(means, axis=0, weights=shares)
        between = np.average((np.array(means) - middle) ** 2, axis=0, weights=shares)
        change = means[1] - means[0] if distinct[0] == str(own) else means[0] - means[1]
        stated = getattr(case.fit.uncertain, name)
        rows[name] = InputShare(
            value=own,
            sd=None,
            effect=_named(names, change),
            share=_named(names, between / (inner + between)),
            probability=stated if name == "base" else None,
            prior=None if name == "base" else stated.words(),
        )
    return rows


def _alternatives(fit: WideFit) -> Iterator[AlternativeFit]:
    """What each alternative found, where there are several."""
    for known in fit.alternatives if len(fit.alternatives) > 1 else ():
        joint = known.fit
        curves = joint.posterior.curves
        point, force = curves.point(joint.mode.z), curves.at(joint.mode.z)[0]
        sizes = {t.name: rmse(t, force[rows]) for t, rows in zip(curves.problem.tests, curves.slices, strict=True)}
        intervals = {name: span_of(joint, n, known.interval(n, several=True)) for n, name in enumerate(curves.free)}
        values = {name: point[name] for name in curves.free}
        yield AlternativeFit(known.name, known.prior, known.probability, values, intervals, sizes)


def _ranges(fit: WideFit) -> Array:
    """The derivatives of the free parameters by their units at the optimum, (p,)."""
    joint = fit.best.fit
    return fit.problem.per_units(joint.posterior.curves.point(joint.mode.z))


def values_of(fit: JointFit, n: int, units: Array) -> list[float]:
    """Values of coordinate n, in its unit."""
    curves = fit.posterior.curves
    if n >= len(curves.free):
        return [curves.inputs[n - len(curves.free)].value_at(float(unit)) for unit in units]
    return [curves.problem.value(curves.free[n], float(unit)) for unit in units]


def span_of(fit: JointFit, n: int, interval: Interval) -> Interval:
    low, high = values_of(fit, n, np.array(interval))
    return low, high


def _named(names: Sequence[str], values: Array) -> dict[str, float | None]:
    return {name: (float(value) if np.isfinite(value) else None) for name, value in zip(names, values, strict=True)}
