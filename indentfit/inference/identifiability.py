"""Identifiability, that is, how well the curves determine the parameters: errors, correlation, singular values, verdicts.

This module linearises around the optimum; `profiles` does not. The residuals are treated as noise, with a size and smoothness of
its own in each test. Where the model cannot follow the curves, the residuals are misfit and not noise. The errors then state how
far the parameters may move before the misfit doubles approximately, not where the truth lies.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.stats import t as student

from indentfit.arrays import Array
from indentfit.case import Range
from indentfit.inference.limits import Limit
from indentfit.inference.noise import Errors, errors
from indentfit.inference.result import CurveNoise
from indentfit.inference.verdicts import verdict
from indentfit.inverse.local import stacked
from indentfit.inverse.objective import Target, rmse, sum_of_squares
from indentfit.inverse.problem import Candidate, InverseProblem

NOTE = "errors and intervals take the residuals for noise; where the model cannot follow the curves, the residuals are no noise"
UNTOLD = (
    "the {points} points of {test} cannot tell whether their noise is correlated: they look like {most} independent points, but "
    "may be worth only {least} (5 %); intervals count both, and more points would tell"
)
MISFIT = "the residuals are smooth: mostly misfit of the model and not noise; few points count as independent, intervals are wide"
CONFIDENCE = 0.95
AT_BOUND = 1e-3  # of the range: scipy's method comes near a bound without reaching it
CLEAR_OF_BOUND = (3.0, 0.05)  # standard errors, and shares of the value, by which a value in a wide range is clear of a bound
EXACT = 1e-3  # over the worst test's RMSE: least RMSE of a test in the weights that follow from equation (1)


@dataclass(frozen=True, eq=False)
class Identifiability:
    """The identifiability by the derivatives at the optimum, in the order of the n free parameters.

    Parameters
    ----------
    stderr : array (n,)
        Standard errors, in the parameters' units; nan for an undetermined parameter.
    interval : array (n, 2)
        95 % intervals within the bounds; the bounds themselves for an undetermined parameter.
    covar, correlation : arrays (n, n)
    singular_values : array (n,), mN
        Singular values, in falling order, of the misfits' derivatives by the parameters relative to their values (relative to their
        ranges at a bound).
    directions : array (n, n), a row for each singular value
    redchi : float, mN^2
        Residual variance of one point.
    at_bound, verdicts : tuple of str
        "lower", "upper" or ""; and how well each parameter is determined, in words.
    quantile : array (n,)
        97.5 % quantiles of Student's t.
    noise : tuple of CurveNoise
        Noise of the tests that have a weight.
    weights : tuple of float
        Weights of the squared residuals of each test in the estimate.
    errors : Errors
    """

    stderr: Array
    interval: Array
    covar: Array
    correlation: Array
    singular_values: Array
    directions: Array
    redchi: float
    at_bound: tuple[str, ...]
    verdicts: tuple[str, ...]
    quantile: Array = field(repr=False)
    noise: tuple[CurveNoise, ...] = field(repr=False)
    weights: tuple[float, ...] = field(repr=False)
    errors: Errors = field(repr=False)


def identifiability(
    problem: InverseProblem, candidate: Candidate, slopes: Sequence[Array], equation_one: bool = False
) -> Identifiability:
    """Identifiability of an InverseProblem at a Candidate.

    Near an optimum of equation (1) the squares of each test have weights in inverse proportion to the test's RMSE.

    Parameters
    ----------
    problem : InverseProblem
    candidate : Candidate
    derivatives : sequence of arrays (n, n_free), mN per range of a parameter
        Derivatives of the candidate's curves.
    equation_one : bool
        Whether the candidate minimises equation (1), or the sum of squares.

    Returns
    -------
    Identifiability
    """
    tests = problem.tests
    ranges = problem.per_units(candidate.parameters)
    values = problem.values(candidate.parameters)
    weights = weights_of(problem, candidate, equation_one)
    heavy = [n for n, weight in enumerate(weights) if weight]
    noise, errors_of_all = _errors([tests[n] for n in heavy], [slopes[n] / ranges for n in heavy], candidate, heavy, weights)
    stderr = np.sqrt(np.diag(errors_of_all.covar))
    quantile = quantiles(errors_of_all.freedom)
    with np.errstate(invalid="ignore"):
        half = stderr * quantile
        correlation = errors_of_all.covar / np.outer(stderr, stderr)
    half = np.where(np.isfinite(half), half, np.inf)
    interval = clipped(np.column_stack([values - half, values + half]), problem)
    bounds = problem.free.values()
    at_bound = tuple(_at_bound(v, error, b) for v, error, b in zip(values, stderr, bounds, strict=True))
    sizes = np.where(np.array(at_bound) == "", np.abs(values) / ranges, 1.0)
    _, singular_values, directions = np.linalg.svd(stacked(tests, slopes) * sizes, full_matrices=False)
    limit = limit_of(noise)
    return Identifiability(
        stderr=np.where(np.isfinite(stderr), stderr, np.nan),
        interval=interval,
        covar=errors_of_all.covar,
        correlation=correlation,
        singular_values=singular_values,
        directions=_signed(directions),
        redchi=_redchi(problem, candidate),
        at_bound=at_bound,
        verdicts=tuple(verdict(v, i, b, at, limit) for v, i, b, at in zip(values, interval, bounds, at_bound, strict=True)),
        quantile=quantile,
        noise=noise,
        weights=tuple(weights),
        errors=errors_of_all,
    )


def _errors(
    tests: Sequence[Target], slopes: Sequence[Array], candidate: Candidate, heavy: Sequence[int], weights: Sequence[float]
) -> tuple[tuple[CurveNoise, ...], Errors]:
    """Noise and errors, by residuals that are as trustworthy as each other; the estimator is that of changes of the curves."""
    trust = [test.curve.trust for test in tests]
    residuals = [t * (candidate.forces[n] - test.curve.force) for t, n, test in zip(trust, heavy, tests, strict=True)]
    scaled = [t[:, None] * s for t, s in zip(trust, slopes, strict=True)]
    noise, known = errors(scaled, residuals, [weights[n] for n in heavy], [test.curve.stated_noise for test in tests])
    return noise, replace(known, estimator=tuple(B * t for B, t in zip(known.estimator, trust, strict=True)))


def limit_of(noise: Sequence[CurveNoise]) -> Limit:
    """What limits parameters of which only the residuals are known: the law's misfit where residuals are systematic, or noise."""
    return Limit("misfit" if any(known.systematic for known in noise) else "noise")


def weights_of(problem: InverseProblem, candidate: Candidate, equation_one: bool) -> list[float]:
    """Weight of each test's sum of squared residuals in an estimate near a Candidate, 1/mN^2 up to a common factor."""
    sizes = np.ones(len(problem.tests))
    if equation_one:
        sizes = np.array([test.scale * rmse(test, force) for test, force in zip(problem.tests, candidate.forces, strict=True)])
        sizes = np.maximum(sizes, max(EXACT * sizes.max(), 1e-12))
    return [test.of_square / test.curve.force.size / size for test, size in zip(problem.tests, sizes, strict=True)]


def widened(problem: InverseProblem, candidate: Candidate, known: Identifiability, covar: Array) -> Identifiability:
    """The Identifiability of a Candidate with a further covariance (n, n) of its estimates, from errors of another kind.

    The degrees of freedom follow Welch and Satterthwaite; those of stated errors are infinite (GUM, JCGM 100:2008, G.4).
    """
    whole = known.errors.covar + covar
    with np.errstate(invalid="ignore", divide="ignore"):
        freedom = known.errors.freedom * (np.diag(whole) / np.diag(known.errors.covar)) ** 2
    freedom = np.where(np.isnan(freedom), known.errors.freedom, freedom)
    quantile = quantiles(freedom)
    half = np.sqrt(np.diag(whole)) * quantile
    half = np.where(np.isfinite(half), half, np.inf)
    values = problem.values(candidate.parameters)
    interval = clipped(np.column_stack([values - half, values + half]), problem)
    errors = replace(known.errors, covar=whole, freedom=freedom, added=known.errors.added + covar)
    return replace(known, errors=errors, quantile=quantile, interval=interval)


def quantiles(freedom: Array) -> Array:
    """97.5 % quantiles of Student's t, infinite for zero degrees of freedom."""
    with np.errstate(invalid="ignore"):
        quantile = student.ppf((1 + CONFIDENCE) / 2, freedom)
    return np.where(np.isfinite(quantile), quantile, np.inf)


def clipped(interval: Array, problem: InverseProblem) -> Array:
    """Intervals (n, 2) of the free parameters, within their bounds."""
    low, high = np.array([[bounds.min, bounds.max] for bounds in problem.free.values()]).T
    return np.clip(interval, low[:, None], high[:, None])


def noise_of(problem: InverseProblem, known: Identifiability) -> dict[str, CurveNoise]:
    """The noise of each test that has a weight, by the test's name."""
    heavy = [test.name for test, weight in zip(problem.tests, known.weights, strict=True) if weight]
    return dict(zip(heavy, known.noise, strict=True))


def notes_of(noise: Mapping[str, CurveNoise]) -> Iterator[str]:
    """What a result says of the residuals of its tests (test -> CurveNoise): misfit, or a correlation that points leave open."""
    if any(known.systematic for known in noise.values()):
        yield MISFIT
    for name, known in noise.items():
        if known.untold and not known.systematic and known.fewest_points is not None:
            most, least = f"{known.effective_points:.0f}", f"{known.fewest_points:.1f}"
            yield UNTOLD.format(points=known.points, test=name, most=most, least=least)


def _redchi(problem: InverseProblem, candidate: Candidate) -> float:
    used = sum(test.curve.force.size for test in problem.tests if test.weight)
    freedom = used - len(problem.free)
    mean_weight = sum(test.weight for test in problem.tests) / used  # of one point, so that it is in mN^2
    return sum_of_squares(problem.tests, candidate.forces) / freedom / mean_weight if freedom > 0 else np.nan


def _at_bound(value: float, stderr: float, bounds: Range) -> str:
    """The bound to which a value is nearer than a small share of the range. In a wide range, a value that is well known and far
    from the bound by its own size is at no bound."""
    for place, bound in (("lower", bounds.min), ("upper", bounds.max)):
        apart = abs(value - bound)
        clear = apart > CLEAR_OF_BOUND[0] * stderr and apart > CLEAR_OF_BOUND[1] * abs(value)
        if apart < AT_BOUND * (bounds.max - bounds.min) and not clear:
            return place
    return ""


def _signed(directions: Array) -> Array:
    """Each row with its largest entry positive, because the sign of a singular vector is arbitrary."""
    largest = np.abs(directions).argmax(axis=1)
    return directions * np.sign(directions[np.arange(len(directions)), largest])[:, None]
