"""Intervals of a mixture: the same parameter under several alternatives, each with its profile and its probability."""

from collections.abc import Sequence

import numpy as np
from scipy.stats import chi2 as chi_squared

from indentfit.arrays import Array
from indentfit.inference.joint import CONFIDENCE
from indentfit.inference.joint_profiles import JointPath
from indentfit.inference.plain import Interval

CERTAIN = 0.99  # an alternative of at least this probability counts as certain
GRID = 4001


def probabilities(prior: Sequence[float], log_evidence: Sequence[float]) -> Array:
    """Probabilities of alternatives, (k,), by Bayes' rule.

    Parameters
    ----------
    prior : (k,)
    log_evidence : (k,)

    Returns
    -------
    array (k,)
    """
    logs = np.log(np.asarray(prior)) + np.asarray(log_evidence)
    shares = np.exp(logs - logs.max())
    return np.asarray(shares / shares.sum())


def pieces(paths: Sequence[JointPath], shares: Array) -> tuple[Interval, ...]:
    """The pieces of the smallest set of values that holds a coordinate with a probability of 95 %.

    Parameters
    ----------
    paths : (k,)
        The coordinate's profile under each alternative.
    shares : array (k,)
        Probabilities of the alternatives.

    Returns
    -------
    tuple of (low, high), in units of the range, in rising order
        The interval of the profile itself where one alternative is certain.
    """
    if shares.max() >= CERTAIN:
        return (paths[int(np.argmax(shares))].interval,)
    grid = _grid(paths)
    width = np.gradient(grid)
    density = np.sum([share * _density(path, grid, width) for path, share in zip(paths, shares, strict=True)], axis=0)
    order = np.argsort(-density)
    count = int(np.searchsorted(np.cumsum((density * width)[order]), CONFIDENCE)) + 1
    inside = density >= density[order[min(count, grid.size) - 1]]
    edges = np.flatnonzero(np.diff(np.concatenate([[0], inside.astype(int), [0]])))
    return tuple((float(grid[a]), float(grid[b - 1])) for a, b in edges.reshape(-1, 2))


def union(first: Sequence[Interval], other: Sequence[Interval]) -> tuple[Interval, ...]:
    """The values that lie in either of two sets of intervals, in rising order."""
    joined: list[Interval] = []
    for low, high in sorted([*first, *other]):
        if joined and low <= joined[-1][1]:
            joined[-1] = (joined[-1][0], max(high, joined[-1][1]))
        else:
            joined.append((low, high))
    return tuple(joined)


def common(first: Sequence[Interval], other: Sequence[Interval]) -> tuple[Interval, ...]:
    """The values that lie in both of two sets of intervals, in rising order."""
    pairs = [(max(a[0], b[0]), min(a[1], b[1])) for a in first for b in other]
    return tuple(sorted(pair for pair in pairs if pair[0] <= pair[1]))


def _grid(paths: Sequence[JointPath]) -> Array:
    """Values that resolve every profile, in rising order."""
    spans = [np.linspace(path.units[0], path.units[-1], GRID) for path in paths]
    return np.unique(np.concatenate([*spans, [0.0, 1.0]]))


def _density(path: JointPath, grid: Array, width: Array) -> Array:
    """Density of a profile, its chi2 scaled so that its interval holds as much as that of a normal density."""
    chi2 = np.interp(grid, path.units, path.chi2, left=np.inf, right=np.inf)
    with np.errstate(invalid="ignore"):
        density = np.exp(-0.5 * chi2 * chi_squared.ppf(CONFIDENCE, 1) / path.limit)
    return np.asarray(density / np.sum(density * width))
