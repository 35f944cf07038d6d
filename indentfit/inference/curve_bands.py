"""Bands of the curves of a fit in which the law's misfit is a term: by draws of parameters, inputs, noise and scale.

Given a draw, the residuals r of the curves are normal, with the covariance C = E + N of errors and noise. What errors e they show
is normal too, with mean E C^-1 r and covariance E - E C^-1 E. Bands are quantiles of the mixture of all draws.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from indentfit.arrays import Array
from indentfit.case import Case
from indentfit.inference.density import Density
from indentfit.inference.discrepancy import smooth
from indentfit.inference.law_misfit import CurveBand, LawMisfit, PosteriorDraws
from indentfit.inference.posterior import NoiseModel
from indentfit.inference.quantiles import normal_quantiles
from indentfit.inference.wide_fit import WideAlternative, WideFit

DRAWN = 400  # draws: a standard deviation is known to 4 % then
KEPT = 25  # points of a test at which the drawn misfit is kept
DIGITS = 5  # of the drawn misfit that are kept


@dataclass(frozen=True, eq=False)
class _Drawn:
    """One draw: its point, noise, and what the residuals say of the law's misfit and of all errors together, at the rows that
    count."""

    alternative: int
    point: dict[str, float]
    noise: NoiseModel
    force: Array
    misfit: tuple[Array, Array]  # mean (N,) and covariance (N, N)
    errors: tuple[Array, Array]


def law_misfit(case: Case, fit: WideFit) -> LawMisfit | None:
    """The law's misfit of a fit; None where the case states none.

    Parameters
    ----------
    case : Case
    fit : WideFit

    Returns
    -------
    LawMisfit or None
    """
    posterior = fit.best.fit.posterior
    law = posterior.noise.law
    if law is None:
        return None
    rng = np.random.default_rng(case.fit.seed)
    drawn = list(_drawn(fit, rng))
    scales = np.array([known.noise.law.scale for known in drawn if known.noise.law is not None])
    tests, done = {}, 0
    parts: dict[str, slice] = {}
    for n, (test, used) in enumerate(zip(fit.problem.tests, posterior.used, strict=True)):
        if used:
            parts[test.name] = slice(done, done := done + test.curve.force.size)
            tests[test.name] = _band(test.curve.displacement, drawn, parts[test.name], [float(k.noise.sigma[n]) for k in drawn])
    low, high = np.quantile(scales, [0.025, 0.975])
    interval = None if law.ends is None else (float(low), float(high))
    return LawMisfit(float(np.median(scales)), interval, case.fit.discrepancy.reach, tests, _draws(fit, drawn, parts, rng))


def _drawn(fit: WideFit, rng: np.random.Generator) -> Iterator[_Drawn]:
    shares = np.array([known.probability for known in fit.alternatives])
    counts = rng.multinomial(DRAWN, shares / shares.sum())
    for number, (known, count) in enumerate(zip(fit.alternatives, counts, strict=True)):
        if count:
            chosen = rng.choice(len(known.draws.shares), size=count, p=known.draws.shares)
            yield from _of_alternative(number, known, known.draws.places[chosen])


def _of_alternative(number: int, known: WideAlternative, places: Array) -> Iterator[_Drawn]:
    density, posterior = Density(known.fit), known.fit.posterior
    curves, rows = posterior.curves, posterior.rows
    forces, sigmas = density.forces(places[:, : curves.size])[0], density.sigma(places)
    for place, force, sigma in zip(places, forces, sigmas, strict=True):
        noise = density.noise_at(place, sigma)
        covar = cho_factor(noise.covar(curves.slices)[np.ix_(rows, rows)])
        left = curves.measured()[rows] - force[rows]
        assert noise.law is not None
        of_law, of_all = (part[np.ix_(rows, rows)] for part in (noise.law.covar, noise.errors))
        shown = [(part @ cho_solve(covar, left), part - part @ cho_solve(covar, part)) for part in (of_law, of_all)]
        yield _Drawn(number, curves.point(place[: curves.size]), noise, force[rows], shown[0], shown[1])


def _band(displacement: Array, drawn: Sequence[_Drawn], rows: slice, sigma: Sequence[float]) -> CurveBand:
    misfits = np.array([k.misfit[0][rows] for k in drawn])
    forces = np.array([k.force[rows] + k.errors[0][rows] for k in drawn])
    of_misfit, of_force = (
        np.sqrt(np.maximum([np.diag(part)[rows] for part in parts], 0.0))
        for parts in ([k.misfit[1] for k in drawn], [k.errors[1] for k in drawn])
    )
    measured = np.hypot(of_force, np.array(sigma)[:, None])
    misfit, force = _between(misfits, of_misfit), _between(forces, of_force)
    rows_of = (displacement, misfits.mean(axis=0), *misfit, forces.mean(axis=0), *force, *_between(forces, measured))
    return CurveBand(*(tuple(row.tolist()) for row in rows_of))


def _between(means: Array, sds: Array) -> tuple[Array, ...]:
    return normal_quantiles(means, sds, (0.025, 0.975))


def _draws(fit: WideFit, drawn: Sequence[_Drawn], parts: dict[str, slice], rng: np.random.Generator) -> PosteriorDraws:
    """The draws, with one curve of the misfit for each."""
    names = list(fit.best.fit.posterior.curves.problem.free)
    misfits = np.array([_one(*known.misfit, rng) for known in drawn])
    places, errors = {}, {}
    tests = {test.name: test for test in fit.problem.tests}
    for name, rows in parts.items():
        depth, force = np.abs(tests[name].curve.displacement), smooth(tests[name].curve)
        kept = np.flatnonzero((depth > 0) & (force != 0))
        kept = kept[np.unique(np.linspace(0, kept.size - 1, min(KEPT, kept.size)).astype(int))]
        places[name] = tuple((depth[kept] / depth.max()).tolist())
        errors[name] = tuple(tuple(float(f"{e:.{DIGITS}g}") for e in row) for row in misfits[:, rows][:, kept] / force[kept])
    numbers = {test.name: n for n, test in enumerate(fit.problem.tests)}
    return PosteriorDraws(
        names=tuple(names),
        values=tuple(tuple(float(known.point[name]) for name in names) for known in drawn),
        changes=tuple(known.changes for known in fit.alternatives),
        alternative=tuple(known.alternative for known in drawn),
        scale=tuple(known.noise.law.scale for known in drawn if known.noise.law is not None),
        noise={name: tuple(float(known.noise.sigma[numbers[name]]) for known in drawn) for name in parts},
        places=places,
        errors=errors,
    )


def _one(mean: Array, covar: Array, rng: np.random.Generator) -> Array:
    """One draw of a normal vector whose covariance may be singular."""
    values, vectors = np.linalg.eigh(covar)
    return np.asarray(mean + vectors @ (np.sqrt(np.maximum(values, 0.0)) * rng.standard_normal(mean.size)))
