"""Fits to one loading curve: a straight line, a parabola, and a curve of a few points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import isotonic_regression

from indentfit.arrays import Array
from indentfit.curve import Curve
from indentfit.experiment.noise import covariance, noise_in


@dataclass(frozen=True)
class Line:
    """The straight line force = slope * displacement + intercept through n samples.

    The slope is in mN/mm and has the standard error `stderr`; the intercept is in mN; `r_squared` is R2.
    """

    slope: float
    stderr: float
    intercept: float
    r_squared: float
    n: int


@dataclass(frozen=True)
class Parabola:
    """The parabola force = curvature * displacement^2 + slope * displacement, in mN/mm^2 and mN/mm, with standard errors and R2."""

    curvature: float
    slope: float
    curvature_stderr: float
    slope_stderr: float
    r_squared: float


def linear_fit(displacement: Array, force: Array) -> Line:
    """The `Line` of least squares through samples.

    Parameters
    ----------
    displacement : array (n,), mm
    force : array (n,), mN

    Returns
    -------
    Line
        Its standard error allows for correlated noise.
    """
    x = displacement - displacement.mean()
    slope = x @ force / (x @ x)
    intercept = force.mean() - slope * displacement.mean()
    residual = force - slope * displacement - intercept
    stderr = _errors(np.column_stack([np.ones_like(x), x]), residual)[1]
    return Line(float(slope), float(stderr), float(intercept), _r_squared(force, residual), x.size)


def quadratic_fit(displacement: Array, force: Array) -> Parabola:
    """The `Parabola` of least squares through the contact point, of samples.

    Parameters
    ----------
    displacement : array (n,), mm
    force : array (n,), mN

    Returns
    -------
    Parabola
    """
    terms = np.column_stack([displacement**2, displacement])
    coefficients = np.linalg.lstsq(terms, force, rcond=None)[0]
    residual = force - terms @ coefficients
    curvature, slope = coefficients.tolist()
    errors = _errors(terms, residual)
    return Parabola(curvature, slope, float(errors[0]), float(errors[1]), _r_squared(force, residual))


def resampled(displacement: Array, force: Array, points: int, depth: float | None = None) -> Curve:
    """The `Curve` of a few points at equal steps of displacement.

    Isotonic regression makes the displacements rise; forces between samples are interpolated.

    Parameters
    ----------
    displacement, force : array (n,), mm and mN
        Samples from contact on.
    points : int
        Number of points.
    depth : float, mm
        Displacement of the last point; by default that of the deepest sample.

    Returns
    -------
    Curve
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


def _errors(terms: Array, residual: Array) -> Array:
    """Standard errors (p,) of least-squares coefficients of columns (n, p)."""
    if np.ptp(residual) <= 1e-12 * max(1.0, np.abs(terms).max()):
        return np.zeros(terms.shape[1])
    return np.sqrt(np.maximum(np.diag(covariance(terms, noise_in(residual))), 0.0))


def _r_squared(force: Array, residual: Array) -> float:
    about = force - force.mean()
    return float(1 - (residual @ residual) / (about @ about)) if about.any() else float("nan")
