"""Quantiles of mixtures of normal densities: of draws each of which leaves a normal error."""

import numpy as np
from scipy.special import ndtr

from indentfit.arrays import Array

HALVED = 45  # times: the interval in which a quantile is sought
FAR = 6.0  # standard deviations beyond all means, where it begins


def quantiles(means: Array, sds: Array, shares: tuple[float, ...] = (0.025, 0.5, 0.975)) -> tuple[Array, ...]:
    """Quantiles of mixtures of equally probable normal densities.

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
    ends: list[Array] = []
    for share in shares:
        low, high = (means - FAR * sds).min(axis=0), (means + FAR * sds).max(axis=0)
        for _ in range(HALVED):
            middle = (low + high) / 2
            below = ndtr((middle - means) / sds).mean(axis=0) < share
            low, high = np.where(below, middle, low), np.where(below, high, middle)
        ends.append(np.asarray((low + high) / 2))
    return tuple(ends)
