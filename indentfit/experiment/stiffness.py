"""What one loading curve amounts to: its straight line and its parabola, forces at strains, and a curve of a few points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import isotonic_regression

from indentfit.curve import Curve
from indentfit.experiment.noise import covariance, noise_in


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
    """The `Line` of least squares through samples (n,), mm and mN; its standard error takes the noise as correlated."""
    x = displacement - displacement.mean()
    slope = x @ force / (x @ x)
    intercept = force.mean() - slope * displacement.mean()
    residual = force - slope * displacement - intercept
    stderr = _errors(np.column_stack([np.ones_like(x), x]), residual)[1]
    return Line(float(slope), float(stderr), float(intercept), _r_squared(force, residual), x.size)


def quadratic_fit(displacement, force):
    """The `Parabola` through the contact point, of least squares, of samples (n,), mm and mN."""
    terms = np.column_stack([displacement**2, displacement])
    coefficients = np.linalg.lstsq(terms, force, rcond=None)[0]
    residual = force - terms @ coefficients
    curvature, slope = (float(one) for one in coefficients)
    errors = _errors(terms, residual)
    return Parabola(curvature, slope, float(errors[0]), float(errors[1]), _r_squared(force, residual))


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


def _errors(terms, residual):
    """Standard errors (p,) of least-squares coefficients of columns (n, p)."""
    if np.ptp(residual) <= 1e-12 * max(1.0, np.abs(terms).max()):
        return np.zeros(terms.shape[1])
    return np.sqrt(np.maximum(np.diag(covariance(terms, noise_in(residual))), 0.0))


def _r_squared(force, residual):
    about = force - force.mean()
    return float(1 - (residual @ residual) / (about @ about)) if about.any() else float("nan")
