"""Noise that is correlated and changes its size, such as that of a load cell that rings on a moving stage.

Least squares that treat such noise as white state standard errors that are far too small.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import log

import numpy as np
from scipy.linalg import matmul_toeplitz
from scipy.ndimage import uniform_filter1d
from scipy.signal import lfilter, lfiltic

from indentfit.arrays import Array

ORDER = 12  # of the autoregressive process, at most
LOCAL = 101  # samples over which the size of the noise is averaged


@dataclass(frozen=True, eq=False)
class CorrelatedNoise:
    """Noise whose size changes along the record and whose samples are correlated.

    Attributes
    ----------
    scale : array (n,)
        Local standard deviation.
    correlation : array (n,)
        Correlation with the k-th next sample.
    weights : array (order,)
        Coefficients of the autoregression.
    """

    scale: Array
    correlation: Array
    weights: Array


def noise_in(residual: Array) -> CorrelatedNoise:
    """The noise in a residual: an autoregression by the Yule-Walker equations, its order by Schwarz's criterion.

    Akaike's criterion takes chance for correlation in one of five quiet records, and states errors that are too small by a fifth.

    Parameters
    ----------
    residual : array (n,)

    Returns
    -------
    CorrelatedNoise
    """
    n = residual.size
    scale = np.sqrt(uniform_filter1d(residual**2, min(LOCAL, n), mode="nearest"))
    unit = residual / np.maximum(scale, 1e-300 + 1e-9 * scale.max())
    most = min(ORDER, n // 10)
    moments = np.array([unit[: n - lag] @ unit[lag:] for lag in range(most + 1)]) / n
    weights = _autoregression(moments, most, n)
    return CorrelatedNoise(scale, _correlation(moments, weights, n), weights)


def _correlation(moments: Array, weights: Array, n: int) -> Array:
    """Correlation (n,) of an autoregression: the moments that it was made of, and then its own recursion."""
    known = moments[: weights.size + 1] / (moments[0] or 1.0)
    if n <= known.size or not weights.size:
        return np.append(known, np.zeros(max(n - known.size, 0)))[:n]
    poles = np.append(1.0, -weights)
    further, _ = lfilter([1.0], poles, np.zeros(n - known.size), zi=lfiltic([1.0], poles, known[:0:-1]))
    return np.concatenate([known, further])


def covariance(jacobian: Array, noise: CorrelatedNoise) -> Array:
    """Covariance of least-squares values: the sandwich estimate from their scores.

    Parameters
    ----------
    jacobian : array (n, p)
    noise : CorrelatedNoise
        The noise in the n residuals.

    Returns
    -------
    array (p, p)
        Infinite on the diagonal where no residual depends on a value.
    """
    n, p = jacobian.shape
    lengths = np.linalg.norm(jacobian, axis=0)
    unknown = lengths == 0
    lengths[unknown] = 1.0
    columns = jacobian / lengths  # of one length: units do not matter
    bread = np.linalg.pinv(columns.T @ columns, hermitian=True)
    sized = columns * noise.scale[:, None]
    white = not noise.weights.size
    meat = sized.T @ (sized if white else matmul_toeplitz((noise.correlation, noise.correlation), sized))
    spread = bread @ meat @ bread * n / max(n - p, 1) / lengths[:, None] / lengths
    spread[unknown, unknown] = np.inf
    return spread


def _autoregression(moments: Array, most: int, n: int) -> Array:
    """Coefficients (order,) of least Schwarz's criterion, by the recursion of Levinson and Durbin over the orders up to `most`."""
    known: list[float] = moments.tolist()  # of a dozen numbers Python's own sums are quicker than those of arrays
    weights: list[float] = []
    variance, price = known[0], log(n)
    best, least = weights, n * log(max(variance, 1e-300)) + price
    for order in range(1, most + 1):
        last = (known[order] - sum(w * m for w, m in zip(weights, known[order - 1 : 0 : -1], strict=True))) / max(variance, 1e-300)
        weights = [*(w - last * back for w, back in zip(weights, weights[::-1], strict=True)), last]
        variance *= max(1.0 - last**2, 1e-15)
        criterion = n * log(max(variance, 1e-300)) + price * (order + 1)
        if criterion < least:
            best, least = weights, criterion
    return np.array(best)
