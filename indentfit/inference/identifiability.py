"""How well the curves determine the parameters: errors, correlation, singular values, and a verdict in words.

Everything here is linear around the optimum; `profiles` looks beyond. The residuals stand for noise, of its own size and
smoothness in each test. Where the model cannot follow the curves they are no noise, and the errors say how far the
parameters may move before the misfit grows by about as much as it has, not where the truth lies.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.stats import t as student

from indentfit.inference.noise import CurveNoise, Errors, errors
from indentfit.inverse.least_squares import stacked
from indentfit.inverse.objective import rmse, sum_of_squares

NOTE = "errors and intervals take the residuals for noise; where the model misfits the curves, they are not"
MISFIT = "the residuals are smooth: mostly misfit of the model and not noise; few points count as independent, intervals are wide"
SMOOTH = 0.5  # autocorrelation of neighbouring points from which the residuals are mostly misfit
CONFIDENCE = 0.95
DETERMINED = 0.2  # half an interval over the value
WEAKLY = 2 / 3  # half an interval over its middle: a factor of five between its ends
AT_BOUND = 1e-3  # of the range: scipy's method comes near a bound without reaching it
EXACT = 1e-3  # of the worst test's RMSE: equation (1) weighs no test as if its own were less


@dataclass(frozen=True)
class Identifiability:
    """What the derivatives at the optimum say, in the order of the free parameters.

    stderr (n,), interval (n, 2) within the bounds, in the parameters' units (nan, and the bounds, where undetermined);
    covar (n, n); correlation (n, n); singular_values (n,) falling, mN, of the misfits' derivatives by the parameters
    relative to their values (to their ranges at a bound); directions (n, n), a row for each; redchi: the residual
    variance of one point, mN^2; at_bound: "lower", "upper" or "" each; quantile (n,): of Student's t, 97.5 %; noise: of the
    tests that have a weight; weights: of these tests' squared residuals in the estimate; errors: as of `noise.errors`.
    """

    stderr: np.ndarray
    interval: np.ndarray
    covar: np.ndarray
    correlation: np.ndarray
    singular_values: np.ndarray
    directions: np.ndarray
    redchi: float
    at_bound: tuple[str, ...]
    verdicts: tuple[str, ...]
    quantile: np.ndarray = field(repr=False)
    noise: CurveNoise = field(repr=False)
    weights: tuple[float, ...] = field(repr=False)
    errors: Errors = field(repr=False)


def identifiability(problem, candidate, slopes, equation_one=False):
    """Identifiability of an InverseProblem at a Candidate, from the derivatives of its curves, mN per range of a parameter.

    equation_one: whether the candidate minimises that, or the sum of squares; near an optimum of equation (1) the squares
    of each test weigh in inverse proportion to its RMSE.
    """
    tests, names = problem.tests, list(problem.free)
    ranges = np.array([problem.range(name) for name in names])
    values = np.array([candidate.parameters[name] for name in names])
    weights = weights_of(problem, candidate, equation_one)
    heavy = [n for n, weight in enumerate(weights) if weight]
    residuals = [candidate.forces[n] - tests[n].curve.force for n in heavy]
    noise, found = errors([slopes[n] / ranges for n in heavy], residuals, [weights[n] for n in heavy])
    stderr = np.sqrt(np.diag(found.covar))
    quantile = quantiles(found.freedom)
    with np.errstate(invalid="ignore"):
        half = stderr * quantile
        correlation = found.covar / np.outer(stderr, stderr)
    half = np.where(np.isfinite(half), half, np.inf)
    interval = clipped(np.column_stack([values - half, values + half]), problem)
    at_bound = tuple(_at_bound(u) for u in problem.units(candidate.parameters))
    sizes = np.where(np.array(at_bound) == "", np.abs(values) / ranges, 1.0)
    _, singular_values, directions = np.linalg.svd(stacked(tests, slopes) * sizes, full_matrices=False)
    return Identifiability(
        stderr=np.where(np.isfinite(stderr), stderr, np.nan),
        interval=interval,
        covar=found.covar,
        correlation=correlation,
        singular_values=singular_values,
        directions=_signed(directions),
        redchi=_redchi(problem, candidate),
        at_bound=at_bound,
        verdicts=tuple(verdict(v, i, b, at) for v, i, b, at in zip(values, interval, problem.free.values(), at_bound, strict=True)),
        quantile=quantile,
        noise=noise,
        weights=tuple(weights),
        errors=found,
    )


def weights_of(problem, candidate, equation_one):
    """What each test's sum of squared residuals weighs in an estimate near a Candidate, 1/mN^2 up to a common factor."""
    sizes = np.ones(len(problem.tests))
    if equation_one:
        sizes = np.array([rmse(test, force) for test, force in zip(problem.tests, candidate.forces, strict=True)])
        sizes = np.maximum(sizes, max(EXACT * sizes.max(), 1e-12))
    return [test.weight / test.curve.force.size / size for test, size in zip(problem.tests, sizes, strict=True)]


def widened(problem, candidate, known, covar):
    """The Identifiability of a Candidate with a further covariance (n, n) of its estimates, from errors of another kind.

    Degrees of freedom by Welch and Satterthwaite, infinite for what is stated (GUM, JCGM 100:2008, G.4).
    """
    whole = known.errors.covar + covar
    with np.errstate(invalid="ignore", divide="ignore"):
        freedom = known.errors.freedom * (np.diag(whole) / np.diag(known.errors.covar)) ** 2
    freedom = np.where(np.isnan(freedom), known.errors.freedom, freedom)
    quantile = quantiles(freedom)
    half = np.sqrt(np.diag(whole)) * quantile
    half = np.where(np.isfinite(half), half, np.inf)
    values = np.array([candidate.parameters[name] for name in problem.free])
    interval = clipped(np.column_stack([values - half, values + half]), problem)
    return replace(known, errors=replace(known.errors, covar=whole, freedom=freedom), quantile=quantile, interval=interval)


def quantiles(freedom):
    """97.5 % quantiles of Student's t, infinite where there is no freedom."""
    with np.errstate(invalid="ignore"):
        found = student.ppf((1 + CONFIDENCE) / 2, freedom)
    return np.where(np.isfinite(found), found, np.inf)


def clipped(interval, problem):
    """Intervals (n, 2) of the free parameters, within their bounds."""
    low, high = np.array([[bounds.min, bounds.max] for bounds in problem.free.values()]).T
    return np.clip(interval, low[:, None], high[:, None])


def verdict(value, interval, bounds, at_bound):
    """How well a parameter is determined, in words; interval: of 95 %, within the bounds (a Range), in its unit."""
    place = f"at its {at_bound} bound; " if at_bound else ""
    low, high = interval
    within = f"any value in {low:.3g}-{high:.3g} fits within the noise"
    if low <= bounds.min and high >= bounds.max:
        return f"{place}not determined by these curves: {within}"
    half = max(value - low, high - value)
    share = half / abs(value) if value else np.inf
    if at_bound and not share <= DETERMINED:
        return f"{place}the curves ask for a value beyond it, or leave it open: {within}"
    if share <= DETERMINED:
        return f"{place}determined (+-{_percent(share)} %)"
    if high - low <= WEAKLY * abs(high + low):
        return f"weakly determined: {low:.3g} to {high:.3g}"
    return f"not determined by these curves: {within}"


def noise_of(problem, known):
    """The noise in plain numbers, test -> sigma (mN), autocorrelation, effective and real number of points."""
    heavy = [test.name for test, weight in zip(problem.tests, known.weights, strict=True) if weight]
    rows = zip(known.noise.sigma, known.noise.autocorrelation, known.noise.effective, known.noise.points, strict=True)
    keys = ("sigma", "autocorrelation", "effective_points", "points")
    return {name: dict(zip(keys, row, strict=True)) for name, row in zip(heavy, rows, strict=True)}


def _redchi(problem, candidate):
    used = sum(test.curve.force.size for test in problem.tests if test.weight)
    freedom = used - len(problem.free)
    mean_weight = sum(test.weight for test in problem.tests) / used  # of one point, so that it is in mN^2
    return sum_of_squares(problem.tests, candidate.forces) / freedom / mean_weight if freedom > 0 else np.nan


def _percent(share):
    return f"{100 * share:.2g}" if share >= 0.001 else "0.1 or less"


def _at_bound(unit):
    return "lower" if unit < AT_BOUND else "upper" if unit > 1 - AT_BOUND else ""


def _signed(directions):
    """Each row with its largest entry positive: the sign of a singular vector means nothing."""
    largest = np.abs(directions).argmax(axis=1)
    return directions * np.sign(directions[np.arange(len(directions)), largest])[:, None]
