"""How well the curves determine the parameters: errors, correlation, singular values, and a verdict in words.

Everything here is linear around the optimum and takes the residuals for independent noise of one size. Where the
model cannot follow the curves, the residuals are no noise, and the errors say how far the parameters may move before
the misfit grows by about as much as it has, not where the truth lies.
"""

from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

from indentfit.inverse.least_squares import stacked
from indentfit.inverse.objective import misfit

NOTE = "errors and intervals take the residuals for independent noise; where the model misfits the curves, they are not"
CONFIDENCE = 0.95
DETERMINED, WEAKLY = 0.2, 1.0  # half an interval over the value
AT_BOUND = 1e-3  # of the range: scipy's method comes near a bound without reaching it
SINGULAR = 1e-8  # of the largest singular value


@dataclass(frozen=True)
class Identifiability:
    """What the derivatives at the optimum say, in the order of the free parameters.

    stderr (n,), interval (n, 2) within the bounds, in the parameters' units (nan, and the bounds, where undetermined);
    covar (n, n); correlation (n, n); singular_values (n,) falling, mN, of the misfits' derivatives by the parameters
    relative to their values (to their ranges at a bound); directions (n, n), a row for each; redchi: the residual
    variance of one point, mN^2; at_bound: "lower", "upper" or "" each.
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


def identifiability(problem, candidate, derivatives):
    """Identifiability of a Problem at a Candidate, from the derivatives of its curves, mN per range of a parameter."""
    tests, names = problem.tests, list(problem.free)
    ranges = np.array([problem.free[name].max - problem.free[name].min for name in names])
    low = np.array([problem.free[name].min for name in names])
    values = np.array([candidate.parameters[name] for name in names])
    J = stacked(tests, derivatives)
    residuals = np.concatenate([misfit(t, f) for t, f in zip(tests, candidate.forces, strict=True)])
    used = sum(test.curve.force.size for test in tests if test.weight)
    freedom = max(used - len(names), 0)
    variance = float(residuals @ residuals) / freedom if freedom else np.nan
    covar = variance * _inverse(J) * np.outer(ranges, ranges)
    stderr = np.sqrt(np.diag(covar))
    half = stderr * student.ppf((1 + CONFIDENCE) / 2, freedom) if freedom else np.full(len(names), np.nan)
    half = np.where(np.isfinite(half), half, np.inf)
    interval = np.clip(np.column_stack([values - half, values + half]), low[:, None], (low + ranges)[:, None])
    at_bound = tuple(_at_bound(u) for u in problem.units(candidate.parameters))
    with np.errstate(invalid="ignore"):
        correlation = covar / np.outer(stderr, stderr)
    verdicts = tuple(
        verdict(v, h, b, at) for v, h, b, at in zip(values, half, problem.free.values(), at_bound, strict=True)
    )
    sizes = np.where(np.array(at_bound) == "", np.abs(values) / ranges, 1.0)
    _, singular_values, directions = np.linalg.svd(J * sizes, full_matrices=False)
    mean_weight = sum(t.weight for t in tests) / used  # of one point, so that redchi is in mN^2
    return Identifiability(
        np.where(np.isfinite(stderr), stderr, np.nan), interval, covar, correlation,
        singular_values, _signed(directions), variance / mean_weight, at_bound, verdicts,
    )  # fmt: skip


def verdict(value, half, bounds, at_bound):
    """How well a parameter is determined, in words; half: of its 95 % interval, in its unit; bounds: its Range."""
    place = f"at its {at_bound} bound; " if at_bound else ""
    if value - half <= bounds.min and value + half >= bounds.max:
        size = f"+-{half:.2g} spans" if np.isfinite(half) else "its interval spans"
        return f"{place}not determined by these curves: {size} the whole allowed range"
    share = half / abs(value) if value else np.inf
    if at_bound and not share <= DETERMINED:
        return f"{place}the curves ask for a value beyond it, or leave it open by {half:.2g}"
    if share <= DETERMINED:
        return f"{place}determined (+-{_percent(share)} %)"
    if share <= WEAKLY:
        return f"weakly determined (+-{_percent(share)} %)"
    return f"not determined by these curves: +-{half:.2g} is more than the value itself"


def _percent(share):
    return f"{100 * share:.2g}" if share >= 0.001 else "0.1 or less"


def _at_bound(unit):
    return "lower" if unit < AT_BOUND else "upper" if unit > 1 - AT_BOUND else ""


def _inverse(J):
    """(J^T J)^-1; infinite for parameters in a direction that the curves do not see."""
    _, singular_values, directions = np.linalg.svd(J, full_matrices=False)
    n = J.shape[1]
    seen = singular_values > SINGULAR * singular_values[0]
    inverse = (directions[seen].T / singular_values[seen] ** 2) @ directions[seen]
    hidden = np.linalg.norm(np.eye(n) - directions[seen].T @ directions[seen], axis=0) > 1e-6
    inverse[hidden] = inverse[:, hidden] = np.nan
    inverse[hidden, hidden] = np.inf
    return inverse


def _signed(directions):
    """Each row with its largest entry positive: the sign of a singular vector means nothing."""
    largest = np.abs(directions).argmax(axis=1)
    return directions * np.sign(directions[np.arange(len(directions)), largest])[:, None]
