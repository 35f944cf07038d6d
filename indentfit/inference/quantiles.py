"""Quantiles of mixtures of densities, of which only the distribution functions are simple."""

from collections.abc import Callable

import numpy as np
from scipy.special import ndtr

from indentfit.arrays import Array

HALVED = 45  # times: the interval in which a quantile is sought
FAR = 6.0  # standard deviations beyond all means, where it begins


def quantile(below: Callable[[Array], Array], low: Array, high: Array, share: float) -> Array:
    """The places (n,) below which n distributions hold a share; `below` gives the shares (n,) below places (n,) between low and
    high."""
    for _ in range(HALVED):
        middle = (low + high) / 2
        less = below(middle) < share
        low, high = np.where(less, middle, low), np.where(less, high, middle)
    return np.asarray((low + high) / 2)


def normal_quantiles(means: Array, sds: Array, shares: tuple[float, ...] = (0.025, 0.5, 0.975)) -> tuple[Array, ...]:
    """Quantiles of mixtures of equally probable normal densities: of draws each of which leaves a normal error.

    Parameters
    ----------
    means, sds : arrays (m, n)
        Of the m parts of n mixtures.
    shares : tuple of float

    Returns
    -------
    tuple of arrays (n,), one for each share
    """
    sds = np.maximum(sds, 1e-12 * np.abs(means).max() + 1e-300)
    low, high = (means - FAR * sds).min(axis=0), (means + FAR * sds).max(axis=0)
    return tuple(quantile(lambda at: ndtr((at - means) / sds).mean(axis=0), low, high, share) for share in shares)
