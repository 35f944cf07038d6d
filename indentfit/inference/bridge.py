"""The evidence of a density from its draws, by bridge sampling (Meng, Wong 1996, Stat Sinica 6:831).

Half of the draws are followed by a mixture, whose own draws meet those of the other half. All live in coordinates u whose normal
distribution function is the place, so that the bounds of the ranges are far away.
"""

import numpy as np
from scipy.special import logsumexp, ndtr, ndtri

from indentfit.arrays import Array
from indentfit.inference.density import Density
from indentfit.inference.t_mixture import LARGEST, followed

PROPOSED = 2000  # draws of the mixture, and of the density that meet them
ROUNDS = 100  # of the iteration, which ends earlier where it changes little
LITTLE = 1e-6


def normal(places: Array) -> Array:
    """The coordinates u (m, d) of places."""
    return np.clip(ndtri(places), -LARGEST, LARGEST)


def over_u(density: Density, u: Array) -> Array:
    """Logarithm of the density over u, (m,), up to a constant."""
    return np.asarray(density(ndtr(u)) - 0.5 * np.sum(u**2, axis=1))


def bridged(density: Density, places: Array, effective: float, rng: np.random.Generator) -> tuple[float, float]:
    """Logarithm of the evidence and its standard error, from draws (m, d) of equal weight.

    Parameters
    ----------
    density : Density
    places : array (m, d)
    effective : float
        The number of independent draws that they count as.
    rng : Generator

    Returns
    -------
    float and float
        The error is infinite where the mixture does not meet the draws.
    """
    u = normal(rng.permutation(places))
    half = len(u) // 2
    mixture = followed(u[:half], rng)
    own, other = u[half : half + PROPOSED], mixture.drawn(PROPOSED, rng)
    constant = 0.5 * u.shape[1] * np.log(2 * np.pi)
    l_own, l_other = (over_u(density, known) - constant - mixture.log(known) for known in (own, other))
    share = min(0.5 * effective, len(own)) / (min(0.5 * effective, len(own)) + PROPOSED)
    log, before = float(np.median(l_own)), np.inf
    for _ in range(ROUNDS):
        if not abs(log - before) > LITTLE:
            break
        before = log
        both = [np.logaddexp(np.log(share) + known, np.log1p(-share) + log) for known in (l_own, l_other)]
        log = float(_mean(l_other - both[1]) - _mean(-both[0]))
    both = [np.logaddexp(np.log(share) + known, np.log1p(-share) + log) for known in (l_own, l_other)]
    numbers = min(0.5 * effective, len(own)), PROPOSED
    spreads = [_spread(known) ** 2 / number for known, number in zip((-both[0], l_other - both[1]), numbers, strict=True)]
    error = float(np.sqrt(sum(spreads)))
    return (log, error) if np.isfinite(log) and np.isfinite(error) else (-np.inf, np.inf)


def _mean(logs: Array) -> float:
    """Logarithm of the mean of numbers with these logarithms."""
    return float(logsumexp(logs) - np.log(len(logs)))


def _spread(logs: Array) -> float:
    """Standard deviation of numbers with these logarithms, over their mean."""
    values = np.exp(logs - logs.max())
    return float(values.std() / values.mean())
