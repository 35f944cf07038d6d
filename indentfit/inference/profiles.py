"""Profile likelihoods on a surrogate: each parameter is moved while the others are fitted again; runs confirm the ends."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from indentfit.arrays import Array
from indentfit.inference.estimate import estimate
from indentfit.inference.identifiability import Identifiability
from indentfit.inference.plain import Interval
from indentfit.inference.result import ConfirmedPoint, Profile
from indentfit.inverse.derivatives import evaluate_at_reference
from indentfit.inverse.problem import Candidate, InverseProblem
from indentfit.inverse.surrogate import Surrogate
from indentfit.runs.forward import Evaluation, ForwardModel, Report

OUTWARDS = (0.003, 0.01, 0.03, 0.1, 0.2, 0.35, 0.55, 0.8, 1.0)  # of the way from the value to a bound
SHOWN = 17  # values of a profile in the result
BEYOND = 0.3  # of the interval's width: range of the shown values beyond the interval
SURE = 0.05  # error of a prediction by the jackknife, over the root of a profile's limit, up to which an end needs no run
BELIED = 2.0  # times its error by the jackknife: where a run is farther from its prediction, and not within SURE, all ends are run
LEAST = 1e-9  # of a range: what lies nearer to a bound is at the bound, and no interval is narrower
SAME_RUN = 0.1  # of the intervals: ends of profiles that are this near each other share a run


@dataclass(frozen=True, eq=False)
class ProfilePath:
    """A profile with the values of the other parameters along it.

    Parameters
    ----------
    values : array (m,)
        Values of the parameter, in its unit.
    chi2 : array (m,)
        Growth of the weighted squares, 1 at one standard error near the optimum.
    limit : float
        Largest chi2 within the interval; infinite where the noise is unknown.
    interval : (low, high)
        Range of values with chi2 below the limit.
    others : array (m, n_free)
        All free parameters, units of the ranges.
    """

    values: Array
    chi2: Array
    limit: float
    interval: Interval
    others: Array

    def ends(self) -> Array:
        """The free parameters at both ends of the interval, units of the ranges, (2, n_free)."""
        return np.array([self.others[int(np.argmin(np.abs(self.values - end)))] for end in self.interval])

    def shown(self, confirmed: tuple[ConfirmedPoint, ...] = ()) -> Profile:
        """The Profile of a result, with the runs at its ends."""
        limit = self.limit if np.isfinite(self.limit) else None
        return Profile(tuple(self.values.tolist()), tuple(self.chi2.tolist()), limit, self.interval, confirmed)


def profiles(problem: InverseProblem, surrogate: Surrogate, candidate: Candidate, known: Identifiability) -> dict[str, ProfilePath]:
    """The profile of each free parameter around a Candidate with its Identifiability."""
    x = estimate(problem, surrogate, known.weights, problem.units(candidate.parameters))[0]
    return {name: _Walk(problem, surrogate, known, n, x).profile() for n, name in enumerate(problem.free)}


def chi2_at(
    problem: InverseProblem, surrogate: Surrogate, candidate: Candidate, known: Identifiability, name: str, value: float
) -> float:
    """chi2 of the profile of one parameter at one value, in its unit."""
    n = problem.number(name)
    x, least = estimate(problem, surrogate, known.weights, problem.units(candidate.parameters))
    there = np.array(x)
    there[n] = problem.unit(name, value)
    return (estimate(problem, surrogate, known.weights, there, fixed=n)[1] - least) * _factor(known, n)


@dataclass(frozen=True, eq=False)
class Proving:
    """The means to prove the ends of profiles: the problem, its optimum, the model and the surrogate.

    Parameters
    ----------
    problem : InverseProblem
    model : ForwardModel
    surrogate : Surrogate
        The surrogate before the runs at the ends, which predicts chi2 there.
    candidate : Candidate
    known : Identifiability
    most : int or None
        Largest number of sets of parameters to run; those farthest from the surrogate's runs come first.
    """

    problem: InverseProblem
    model: ForwardModel
    surrogate: Surrogate
    candidate: Candidate
    known: Identifiability
    most: int | None = None

    def prove(self, paths: Mapping[str, ProfilePath], report: Report | None = None) -> dict[str, tuple[ConfirmedPoint, ...]]:
        """Run the ends of profiles; ends that are near each other share a run, and ends that are not run have no ConfirmedPoint.

        Where the surrogate predicts ends surely enough, the least sure one is run, and the others only where it was not as
        predicted.
        """
        problem = self.problem
        widths = np.array([np.ptp([problem.unit(name, end) for end in path.interval]) for name, path in paths.items()])
        ends = {name: path.ends() for name, path in paths.items()}
        points = self._farthest(apart(np.concatenate([*ends.values()]), widths))[: self.most]
        limits = [path.limit for path in paths.values()]
        doubts = [self._doubt(x, limits) for x in points]
        first = [k for k, doubt in enumerate(doubts) if doubt > SURE] or [int(k) for k in np.argsort(doubts)[-1:]]
        confirmed = self._run([points[k] for k in first], ends, widths, report)
        allowed = [max(SURE, BELIED * doubts[k]) for k in first]
        rows = ((k, point, paths[name].limit) for name, known in confirmed.items() for k, point in known.items())
        right = (as_predicted(point, allowed[k] * np.sqrt(limit)) for k, point, limit in rows)
        if len(first) < len(points) and not all(right):
            confirmed = self._run(points, ends, widths, report)
        return {name: tuple(rows.values()) for name, rows in confirmed.items()}

    def _run(
        self, points: list[Array], ends: Mapping[str, Array], widths: Array, report: Report | None
    ) -> dict[str, dict[int, ConfirmedPoint]]:
        """The ends of each profile that runs at some points prove, by the number of the point."""
        problem = self.problem
        runs = evaluate_at_reference(problem, self.model, [problem.parameters(x) for x in points], report)
        x = problem.units(self.candidate.parameters)
        promised = estimate(problem, self.surrogate, self.known.weights, x)[1]
        least = min(self._squares(self.candidate.forces), promised)
        confirmed: dict[str, dict[int, ConfirmedPoint]] = {}
        for n, (name, pair) in enumerate(ends.items()):
            numbers = [near(end, points, widths) for end in pair]
            confirmed[name] = {k: self._confirmed(n, points[k], runs[k], least) for k in numbers if k is not None}
        return confirmed

    def _doubt(self, x: Array, limits: Sequence[float]) -> float:
        """The error of the root of chi2 at x by the jackknife, over that of the nearest limit."""
        problem = self.problem
        lost = problem.factor(problem.parameters(x)) * self.surrogate.spread(x[problem.searched_numbers])
        by_test = np.split(lost, np.cumsum([test.curve.force.size for test in problem.tests])[:-1], axis=1)
        rows = zip(problem.tests, by_test, self.known.weights, strict=True)
        squares = sum(weight * float(np.sum((test.curve.trust * part) ** 2)) for test, part, weight in rows if weight)
        return float(np.sqrt(squares * max(_factor(self.known, n) / limit for n, limit in enumerate(limits))))

    def _farthest(self, points: list[Array]) -> list[Array]:
        """Points (n_free,) in units of the ranges, those farthest from the surrogate's runs first."""
        known, columns = self.surrogate.known_places(), self.problem.searched_numbers

        def nearness(x: Array) -> float:
            return -self.surrogate.distance(x[columns], known)

        return sorted(points, key=nearness)

    def _confirmed(self, n: int, x: Array, run: Evaluation, least: float) -> ConfirmedPoint:
        """The end of the profile of parameter n that a run at x proves."""
        problem = self.problem
        parameters, name = problem.parameters(x), list(problem.free)[n]
        free = {key: parameters[key] for key in problem.free}
        if run.forces is None:
            return ConfirmedPoint(parameters[name], None, None, run.cause, free)
        guess = evaluate_at_reference(problem, self.surrogate, [parameters])[0].forces
        true, predicted = (
            self._squares(problem.scaled(parameters, forces)) if forces else np.nan for forces in (run.forces, guess)
        )
        factor = _factor(self.known, n)
        chi2, expected = (float(max(squares - least, 0) * factor) for squares in (true, predicted))
        return ConfirmedPoint(parameters[name], chi2, expected, None, free)

    def _squares(self, forces: tuple[Array, ...]) -> float:
        rows = zip(self.problem.tests, forces, self.known.weights, strict=True)
        return sum(weight * float(np.sum((test.curve.trust * (force - test.curve.force)) ** 2)) for test, force, weight in rows)


def as_predicted(point: ConfirmedPoint, allowed: float) -> bool:
    """Whether the run at an end of a profile is as near its prediction as allowed, by the roots of chi2."""
    known = point.chi2 is not None and point.predicted is not None
    return known and bool(abs(np.sqrt(point.chi2) - np.sqrt(point.predicted)) <= allowed)  # type: ignore[arg-type]


def apart(ends: Iterable[Array], widths: Array) -> list[Array]:
    """Ends (n,), of which no two are near each other beside the widths (n,) of the intervals, all in units of the ranges."""
    points: list[Array] = []
    for x in ends:
        if all(np.any(np.abs(x - other) > SAME_RUN * widths) for other in points):
            points.append(x)
    return points


def near(x: Array, points: list[Array], widths: Array) -> int | None:
    """The number of the nearest point, if a run at this point proves the end x too; otherwise None. Arguments as in `apart`."""
    if not points:
        return None
    within = SAME_RUN * np.maximum(widths, 1e-300)
    away = [(np.abs(x - other) / within).max(initial=0.0) for other in points]
    nearest = int(np.argmin(away))
    return None if away[nearest] > 1 else nearest


class _Walk:
    """A walk along the profile of parameter `n` from the optimum x; visited places are remembered."""

    def __init__(self, problem: InverseProblem, surrogate: Surrogate, known: Identifiability, n: int, x: Array) -> None:
        self.problem, self.surrogate, self.known, self.n, self.x = problem, surrogate, known, n, x
        self.name = list(problem.free)[n]
        self.least = estimate(problem, surrogate, known.weights, x)[1]
        self.factor, self.limit = _factor(known, n), float(known.quantile[n] ** 2)
        self.walked = {float(x[n]): (self.least, x)}

    def profile(self) -> ProfilePath:
        value = float(self.x[self.n])
        ends = [end_of_profile(self.chi2, value, bound, self.limit) for bound in (0.0, 1.0)]
        shown = self._shown(ends)
        return ProfilePath(
            np.array([self.problem.value(self.name, unit) for unit in shown]),
            np.array([max(self.chi2(unit), 0.0) for unit in shown]),
            self.limit,
            (float(self.problem.value(self.name, ends[0])), float(self.problem.value(self.name, ends[1]))),
            np.array([self.walked[unit][1] for unit in shown]),
        )

    def chi2(self, unit: float) -> float:
        """chi2 at a value in units of the range, estimated from the nearest visited place."""
        if unit not in self.walked:
            start = np.array(self.walked[min(self.walked, key=lambda known: abs(known - unit))][1])
            start[self.n] = unit
            there, squares = estimate(self.problem, self.surrogate, self.known.weights, start, fixed=self.n)
            self.walked[unit] = (squares, there)
        return (self.walked[unit][0] - self.least) * self.factor

    def _shown(self, ends: list[float]) -> list[float]:
        """Values of the profile for the result: within the interval and a little beyond, with the ends of the interval."""
        reach = BEYOND * max(ends[1] - ends[0], LEAST)
        for unit in np.linspace(max(ends[0] - reach, 0.0), min(ends[1] + reach, 1.0), SHOWN):
            self.chi2(float(unit))
        within = [unit for unit in sorted(self.walked) if ends[0] - 1.01 * reach <= unit <= ends[1] + 1.01 * reach]
        shown = within[:1]
        for unit in within[1:]:
            if unit in ends or unit - shown[-1] > 0.01 * reach:
                shown.append(unit)
        return shown


def end_of_profile(chi2: Callable[[float], float], value: float, bound: float, limit: float) -> float:
    """The value between the optimum and a bound beyond which chi2 stays above its limit; the bound where no such value exists."""
    if not np.isfinite(limit) or abs(bound - value) < LEAST:
        return bound
    steps = [value, *(value + share * (bound - value) for share in OUTWARDS)]
    inside = [step for step in steps if chi2(step) <= limit]
    last = steps.index(inside[-1]) if inside else 0
    if last == len(steps) - 1:
        return bound
    near = max(1e-6 * abs(steps[last + 1] - value), 1e-3 * LEAST)
    return float(brentq(lambda unit: chi2(unit) - limit, steps[last], steps[last + 1], xtol=near)) if inside else value


def _factor(known: Identifiability, n: int) -> float:
    """The factor from a growth of sum w |r|^2 along a parameter to squared standard errors.

    Where other parameters sit at a bound, errors of mesh and inputs that these would take up move this parameter instead. The
    factor is then the smaller of two: with these parameters free, and with them held.
    """
    plain, added = known.errors.plain, known.errors.added
    with np.errstate(invalid="ignore", divide="ignore"):
        noise = plain[n, n] / (known.errors.covar[n, n] - added[n, n])
    noise = float(noise if np.isfinite(noise) else known.errors.typical)
    row = np.eye(len(plain))[n]
    maps, held = [row], [k for k, bound in enumerate(known.at_bound) if bound and k != n]
    if held and np.isfinite(plain).all():
        row = row.copy()
        row[held] = -plain[n, held] @ np.linalg.pinv(plain[np.ix_(held, held)])  # least squares with these parameters held
        maps.append(row)
    return min(_with_added(noise, row, known) for row in maps)


def _with_added(noise: float, row: Array, known: Identifiability) -> float:
    """The factor of the noise, made smaller by the errors of another kind, for the estimate `row` of the free parameters."""
    seen = np.flatnonzero(row)
    part = np.ix_(seen, seen)
    plain, added = (row[seen] @ matrix[part] @ row[seen] for matrix in (known.errors.plain, known.errors.added))
    with np.errstate(invalid="ignore", divide="ignore"):  # without noise, as of curves that the model itself made
        factor = plain / (plain / noise + added) if added > 0 else noise
    return float(factor if np.isfinite(factor) else known.errors.typical)
