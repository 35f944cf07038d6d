"""How far each parameter may move while the others follow: profile likelihoods on the surrogate, proved by runs.

Also on the surrogate: a parametric bootstrap, fits with one test alone, and fits under other weights of the tests.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq, least_squares

from indentfit.inference.identifiability import identifiability, verdict, widened
from indentfit.inverse.derivatives import Underivable, curve_derivatives, evaluate_at_reference
from indentfit.inverse.exploration import scanned
from indentfit.inverse.generations import judged, parameters_of
from indentfit.inverse.least_squares import polish

OUTWARDS = (0.003, 0.01, 0.03, 0.1, 0.2, 0.35, 0.55, 0.8, 1.0)  # of the way from the value to a bound
SHOWN = 17  # values of a profile in the result
BEYOND = 0.3  # of the interval's width: how far the values shown go beyond it
SAME_RUN = 0.1  # of the intervals: ends of profiles this near each other are proved by one run
DRAWS = 200  # of the bootstrap
WEIGHTS = np.linspace(0, 1, 11)


@dataclass(frozen=True)
class Profile:
    """values (m,) of a parameter, chi2 (m,) there, 1 at one standard error near the optimum; limit: what chi2 may be;
    interval: where it is; others (m, n_free): all free parameters along it, units of the ranges."""

    name: str
    values: np.ndarray
    chi2: np.ndarray
    limit: float
    interval: tuple[float, float]
    others: np.ndarray

    def ends(self):
        """The free parameters at both ends of the interval, units of the ranges, (2, n_free)."""
        return np.array([self.others[int(np.argmin(np.abs(self.values - end)))] for end in self.interval])


def profiles(problem, surrogate, candidate, known):
    """Profile of each free parameter, name -> Profile, around a Candidate with its Identifiability."""
    x = estimate(problem, surrogate, known.weights, problem.units(candidate.parameters))[0]
    return {name: _profile(problem, surrogate, known, n, x) for n, name in enumerate(problem.free)}


def chi2_at(problem, surrogate, candidate, known, name, value):
    """chi2 of the profile of one parameter at one value."""
    n, x = list(problem.free).index(name), problem.units(candidate.parameters)
    x, least = estimate(problem, surrogate, known.weights, x)
    there = np.array(x)
    there[n] = (value - problem.free[name].min) / problem.range(name)
    return (estimate(problem, surrogate, known.weights, there, fixed=n)[1] - least) * _factor(known, n)


def prove(problem, pool, surrogate, found, known, candidate, report=None, most=None):
    """Run the ends of profiles (name -> Profile), ends near each other once: name -> rows of value, chi2 there, and what
    the surrogate had predicted before it knew the run. A row holds the cause where the run failed.

    most: runs of all tests to spend, those first that lie farthest from what the surrogate knows; other ends have no row.
    """
    ends = {name: profile.ends() for name, profile in found.items()}
    widths = np.array([np.ptp(profile.interval) / problem.range(name) for name, profile in found.items()])
    points: list = []
    for x in np.concatenate([*ends.values()]):
        if all(np.any(np.abs(x - other) > SAME_RUN * widths) for other in points):
            points.append(x)
    points = _farthest(problem, surrogate, points)[:most]
    runs = evaluate_at_reference(problem, pool, [problem.parameters(x) for x in points], report)
    least = min(_squares(problem, candidate.forces, known.weights), *_least(problem, surrogate, known, candidate))
    rows: dict = {}
    for n, (name, pair) in enumerate(ends.items()):
        factor = _factor(known, n)
        rows[name] = []
        for x in pair if points else ():
            nearest = int(np.argmin([np.abs(x - other).max() for other in points]))
            if np.any(np.abs(x - points[nearest]) > SAME_RUN * widths):
                continue
            parameters, run = problem.parameters(points[nearest]), runs[nearest]
            predicted = problem.scaled(parameters, evaluate_at_reference(problem, surrogate, [parameters])[0].forces or ())
            row = {"value": parameters[name], "parameters": {key: parameters[key] for key in problem.free}}
            if run.forces is None:
                rows[name].append({**row, "chi2": None, "predicted": None, "cause": run.cause})
                continue
            true = _squares(problem, problem.scaled(parameters, run.forces), known.weights)
            guess = _squares(problem, predicted, known.weights) if predicted else np.nan
            chi2 = [float(max(squares - least, 0) * factor) for squares in (true, guess)]
            rows[name].append({**row, "chi2": chi2[0], "predicted": chi2[1]})
    return rows


def bootstrap(problem, surrogate, candidate, known, seed, draws=DRAWS):
    """Parametric bootstrap on the surrogate: name -> stderr and 95 % interval (percentiles) of estimates from curves at
    the Candidate with new draws of the noise found."""
    x = problem.units(candidate.parameters)
    there = problem.scaled(candidate.parameters, evaluate_at_reference(problem, surrogate, [candidate.parameters])[0].forces)
    rng, heavy = np.random.default_rng(seed), [n for n, weight in enumerate(known.weights) if weight]
    found = []
    for _ in range(draws):
        targets = list(there)
        for n, noise in zip(heavy, known.noise.draw(rng), strict=True):
            targets[n] = targets[n] + noise
        found.append(estimate(problem, surrogate, known.weights, x, targets=targets)[0])
    values = np.array([[problem.parameters(one)[name] for name in problem.free] for one in found])
    low, high = np.percentile(values, [2.5, 97.5], axis=0)
    rows = zip(problem.free, values.std(axis=0, ddof=1), low, high, strict=True)
    return {name: {"stderr": float(s), "interval": [float(a), float(b)]} for name, s, a, b in rows}


def alone(problem, pool, surrogate, seed, forces=0.0):
    """Fits with one test alone, test -> rmse, parameters (value, interval by profile, verdict) and the run that proved it.

    forces: relative standard deviation of a test's forces as a whole, as by the mesh; in the intervals.
    """
    found = {}
    for n, test in enumerate(problem.tests):
        single = problem.weighted([float(m == n) for m in range(len(problem.tests))])
        best = best_on(single, surrogate, seed)
        run = judged(single, pool, [best.parameters])[0]
        try:
            slopes = curve_derivatives(single, surrogate, single.units(best.parameters))
        except Underivable:
            continue
        known = identifiability(single, best, slopes)
        move = forces * known.errors.estimator[0] @ best.forces[n]
        known = widened(single, best, known, np.outer(move, move))
        rows = {}
        for name, profile in profiles(single, surrogate, best, known).items():
            at = known.at_bound[list(single.free).index(name)]
            said = verdict(best.parameters[name], profile.interval, single.free[name], at)
            rows[name] = {"value": best.parameters[name], "interval": list(profile.interval), "verdict": said}
        found[test.name] = {"rmse": best.objective, "confirmed_rmse": run and run.objective, "parameters": rows}
    return found


def scan_weights(problem, surrogate, seed):
    """Fits of two tests under other weights: rows of weights, parameters, rmse of each test; equation (1), surrogate."""
    rows = []
    for weight in WEIGHTS if len(problem.tests) == 2 else ():
        weights = [float(f"{1 - weight:.6g}"), float(f"{weight:.6g}")]
        other = problem.weighted(weights)
        best = best_on(other, surrogate, seed)
        sizes = {t.name: float(np.sqrt(np.mean((f - t.curve.force) ** 2))) for t, f in zip(other.tests, best.forces, strict=True)}
        rows.append({"weights": weights, "parameters": {name: best.parameters[name] for name in problem.free}, "rmse": sizes})
    return rows


def best_on(problem, surrogate, seed):
    """The Candidate of least objective on the surrogate, from the best places of a scan."""
    if not problem.searched:
        return judged(problem, surrogate, [problem.start])[0]
    places, squares = scanned(problem, surrogate, seed)
    starts = judged(problem, surrogate, [parameters_of(problem, place) for place in places[np.argsort(squares)[:3]]])
    ends = [polish(problem, surrogate, start).best for start in starts if start]
    return min(ends, key=lambda end: end.objective)


def estimate(problem, surrogate, weights, x, fixed=None, targets=None):
    """(x, sum w |r|^2) that is least from x, (n_free,) in units of the ranges, on the surrogate, within the bounds.

    fixed: number of a parameter that stays where x has it. targets: curves in place of those measured.
    """
    moving = [n for n in range(len(x)) if n != fixed]
    targets = np.concatenate(targets if targets is not None else [test.curve.force for test in problem.tests])
    roots = np.concatenate([np.full(t.curve.force.size, np.sqrt(w)) for t, w in zip(problem.tests, weights, strict=True)])
    searched = [list(problem.free).index(name) for name in problem.searched]
    scale = list(problem.free).index(problem.scale) if problem.scale else None

    def whole(part):
        full = np.array(x, dtype=float)
        full[moving] = part
        return full

    def factor(full):
        if scale is None:
            return 1.0
        return (problem.free[problem.scale].min + full[scale] * problem.range(problem.scale)) / problem.reference

    def residuals(part):
        full = whole(part)
        return roots * (factor(full) * surrogate.curves(full[None, searched])[0] - targets)

    def jacobian(part):
        full, J = whole(part), np.zeros((targets.size, len(x)))
        J[:, searched] = factor(full) * surrogate.slopes(full[None, searched])[0].T
        if scale is not None:
            J[:, scale] = problem.range(problem.scale) / problem.reference * surrogate.curves(full[None, searched])[0]
        return roots[:, None] * J[:, moving]

    if not moving:
        return np.array(x), float(np.sum(residuals([]) ** 2))
    start = np.clip(np.asarray(x)[moving], 0, 1)
    found = least_squares(
        residuals, start, jacobian, bounds=(0, 1), method="dogbox", ftol=1e-10, xtol=1e-8, gtol=1e-12, max_nfev=60
    )
    return whole(found.x), float(2 * found.cost)


# The steps of a profile


def _profile(problem, surrogate, known, n, x):
    name, least = list(problem.free)[n], estimate(problem, surrogate, known.weights, x)[1]
    factor, limit = _factor(known, n), float(known.quantile[n] ** 2)
    walked = {float(x[n]): (least, x)}

    def chi2(unit):
        """From the nearest place walked to; and remembered."""
        if unit not in walked:
            start = np.array(walked[min(walked, key=lambda known: abs(known - unit))][1])
            start[n] = unit
            x_there, squares = estimate(problem, surrogate, known.weights, start, fixed=n)
            walked[unit] = (squares, x_there)
        return (walked[unit][0] - least) * factor

    ends = [_end(chi2, float(x[n]), bound, limit) for bound in (0.0, 1.0)]
    reach = BEYOND * max(ends[1] - ends[0], 1e-6)
    for unit in np.linspace(max(ends[0] - reach, 0.0), min(ends[1] + reach, 1.0), SHOWN):
        chi2(float(unit))
    within = [unit for unit in sorted(walked) if ends[0] - 1.01 * reach <= unit <= ends[1] + 1.01 * reach]
    shown = within[:1]
    for unit in within[1:]:
        if unit in ends or (unit - shown[-1] > 0.01 * reach and shown[-1] != ends[1]):
            shown.append(unit)
    low = problem.free[name].min
    return Profile(
        name,
        np.array([low + unit * problem.range(name) for unit in shown]),
        np.array([max(chi2(unit), 0.0) for unit in shown]),
        limit,
        tuple(float(low + end * problem.range(name)) for end in ends),
        np.array([walked[unit][1] for unit in shown]),
    )


def _end(chi2, value, bound, limit):
    """Where chi2 leaves its limit for good on the way from the value to a bound, or the bound."""
    if not np.isfinite(limit) or abs(bound - value) < 1e-6:
        return bound
    steps = [value, *(value + share * (bound - value) for share in OUTWARDS)]
    inside = [step for step in steps if chi2(step) <= limit]
    last = steps.index(inside[-1]) if inside else 0
    if last == len(steps) - 1:
        return bound
    return float(brentq(lambda unit: chi2(unit) - limit, steps[last], steps[last + 1], xtol=1e-6)) if inside else value


def _farthest(problem, surrogate, points):
    """Points (n_free,) in units of the ranges, those farthest from the surrogate's runs first."""
    known = np.array([sample.place for sample in surrogate.samples])
    columns = [list(problem.free).index(name) for name in problem.searched]
    return sorted(points, key=lambda x: -np.abs(known - x[columns]).max(axis=1).min())


def _factor(known, n):
    """What turns a growth of sum w |r|^2 along a parameter into squared standard errors."""
    with np.errstate(invalid="ignore", divide="ignore"):
        factor = known.errors.plain[n, n] / known.errors.covar[n, n]
    return float(factor if np.isfinite(factor) else known.errors.typical)


def _least(problem, surrogate, known, candidate):
    """The least sum of weighted squares that the surrogate promises near a Candidate, as a tuple."""
    return (estimate(problem, surrogate, known.weights, problem.units(candidate.parameters))[1],)


def _squares(problem, forces, weights):
    return sum(w * float(np.sum((f - t.curve.force) ** 2)) for t, f, w in zip(problem.tests, forces, weights, strict=True))
