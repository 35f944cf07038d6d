"""What one loading curve amounts to: its straight line and its parabola, forces at strains, and a curve of a few points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import isotonic_regression

from ..curve import Curve


@dataclass(frozen=True)
class Line:
    """force = slope * displacement + intercept: slope (mN/mm), its standard error, intercept (mN), R2, number of samples n."""

    slope: float
    stderr: float
    intercept: float
    r_squared: float
    n: int


@dataclass(frozen=True)
class Parabola:
    """force = curvature * displacement^2 + slope * displacement, mN/mm^2 and mN/mm, with standard errors, and R2."""

    curvature: float
    slope: float
    curvature_stderr: float
    slope_stderr: float
    r_squared: float


def linear_fit(displacement, force):
    """The `Line` of least squares through samples (n,), mm and mN; its standard error takes the noise as correlated (see `correlated`)."""
    x = displacement - displacement.mean()
    slope = x @ force / (x @ x)
    intercept = force.mean() - slope * displacement.mean()
    residual = force - slope * displacement - intercept
    stderr = correlated(np.column_stack([np.ones_like(x), x]), residual)[1]
    return Line(float(slope), float(stderr), float(intercept), _r_squared(force, residual), x.size)


def quadratic_fit(displacement, force):
    """The `Parabola` through the contact point, of least squares, of samples (n,), mm and mN."""
    terms = np.column_stack([displacement**2, displacement])
    coefficients = np.linalg.lstsq(terms, force, rcond=None)[0]
    residual = force - terms @ coefficients
    curvature, slope = (float(one) for one in coefficients)
    errors = correlated(terms, residual)
    return Parabola(curvature, slope, float(errors[0]), float(errors[1]), _r_squared(force, residual))


def correlated(terms, residual):
    """Standard errors (p,) of least-squares coefficients of columns (n, p), where neighbouring residuals (n,) are alike.

    Newey and West 1987 (Econometrica 55:703), with Bartlett weights over as many neighbours as the residual stays correlated.
    """
    n, p = terms.shape
    bread = np.linalg.pinv(terms.T @ terms)
    power = np.abs(np.fft.rfft(residual, 2 * n)) ** 2
    covariance = np.fft.irfft(power)[:n]
    small = np.flatnonzero(covariance < 0.1 * covariance[0])
    reach = min(int(small[0]) * 3 if small.size else n // 4, n // 4) if covariance[0] > 0 else 0
    scores = terms * residual[:, None]
    meat = scores.T @ scores
    for lag in range(1, reach + 1):
        shifted = (1 - lag / (reach + 1)) * scores[lag:].T @ scores[:-lag]
        meat += shifted + shifted.T
    return np.sqrt(np.maximum(np.diag(bread @ meat @ bread), 0.0) * n / max(n - p, 1))


def resampled(displacement, force, points, depth=None):
    """`Curve` of n points at equal steps of displacement, from samples (n,) from contact on; depth: of the last one, mm.

    The displacements are made to rise, by isotonic regression; forces between samples are interpolated.
    """
    rising = isotonic_regression(displacement).x
    place, first = np.unique(rising, return_index=True)
    counts = np.diff(np.append(first, rising.size))
    mean = np.add.reduceat(force, first) / counts
    depth = float(place[-1]) if depth is None else min(depth, float(place[-1]))
    at = depth * np.arange(1, points + 1) / points
    if place[0] > 0:
        place, mean = np.append(0.0, place), np.append(0.0, mean)
    return Curve(at, np.interp(at, place, mean))


def _r_squared(force, residual):
    about = force - force.mean()
    return float(1 - (residual @ residual) / (about @ about)) if about.any() else float("nan")
