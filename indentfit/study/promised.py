"""The 95 % intervals that a fit of the tests of a design is expected to state.

A fit does not know the noise: it learns its size, and perhaps its correlation, from the residuals of each curve, and its squares
have weights that are not those of the variances. Both make its intervals wider than Fisher's information promises. With J the
derivatives of a curve, w the weight of its squares and s the standard deviation of its points,

    H = sum w J^T J,   V = sum w^2 s^2 f^2 J^T J,   covariance = (H V^-1 H + prior)^-1

where f is the factor by which an unknown noise widens the intervals of so many points, in the median (`learning`). Single fits
state other intervals: one that learns too small a noise a narrower one, one whose residuals look correlated a wider one (`spread`).
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from indentfit.arrays import Array
from indentfit.inference.identifiability import quantiles
from indentfit.inference.noise import errors

NORMAL = 1.959964  # the 97.5 % quantile of the normal density
DRAWN, MOST = 99, 100  # draws of noise; points from which on a fit knows the noise
SPAN = (0.05, 0.95)  # quantiles between which an interval is told to lie
SEEN = 1e-12  # of the largest eigenvalue: directions of less information are not seen


@dataclass(frozen=True, eq=False)
class Evidence:
    """What the points of one curve, or of one field of displacements, tell.

    Parameters
    ----------
    information : array (p, p)
        Fisher's, with the noise known.
    size, noise : float
        Root mean square of the curve, and the standard deviation of a point, in the curve's unit.
    points : int
    weight : float
        Of the test in the objective; 0 where a fit weighs by the stated variances, as it does displacements.
    pressed : bool
        Whether the curve is that of an indentation.
    learnt : bool
        Whether the fit has to learn the noise from the residuals.
    """

    information: Array
    size: float = 1.0
    noise: float = 1.0
    points: int = 1
    weight: float = 0.0
    pressed: bool = True
    learnt: bool = False


def half_widths(evidence: Sequence[Evidence], prior: Array, squares: bool) -> Array:
    """Half widths (p,) of the expected 95 % intervals of p parameters.

    Parameters
    ----------
    evidence : sequence of Evidence
    prior : array (p, p)
        Information before all tests.
    squares : bool
        Whether the fit minimises the weighted squares, or equation (1), whose squares weigh in inverse proportion to the misfit.
    """
    return _widths(evidence, prior, squares, [learning(each.points, len(prior)) if each.learnt else 1.0 for each in evidence])


def spread(evidence: Sequence[Evidence], prior: Array, squares: bool) -> Array:
    """Half widths (2, p) at the quantiles SPAN of what single fits state, over those in the median: each learns the noise of its
    curves from its own residuals. Arguments as of `half_widths`."""
    rng, p = np.random.default_rng(0), len(prior)
    factors = [rng.permutation(learned(each.points, p)) if each.learnt else np.ones(DRAWN) for each in evidence]
    rows = np.array([_widths(evidence, prior, squares, drawn) for drawn in zip(*factors, strict=True)])
    return np.asarray(np.quantile(rows, SPAN, axis=0) / np.median(rows, axis=0))


def _widths(evidence: Sequence[Evidence], prior: Array, squares: bool, factors: Sequence[float]) -> Array:
    """Half widths (p,) where the noise of each curve widens intervals by a factor."""
    loads = _loads(evidence, squares)
    scale = 1 / np.sqrt(np.diag(prior))
    H, V = np.zeros_like(prior), np.zeros_like(prior)
    for load, each, factor in zip(loads, evidence, factors, strict=True):
        own = scale[:, None] * each.information * scale
        H, V = H + load * own, V + (load * factor) ** 2 * own
    values, vectors = np.linalg.eigh(H)
    seen = vectors[:, values > SEEN * max(values[-1], 1e-300)]
    half = seen @ (seen.T @ H @ seen)
    known = half @ np.linalg.solve(seen.T @ V @ seen, half.T) if seen.size else H
    covar = np.linalg.inv(known + scale[:, None] * prior * scale)
    return np.asarray(NORMAL * scale * np.sqrt(np.diag(covar)))


def _loads(evidence: Sequence[Evidence], squares: bool) -> Array:
    """The weight of each residual's square times its variance: the same for all where a fit weighs by the variances."""
    weighed = [each for each in evidence if each.weight]
    alike = all(each.pressed for each in weighed)
    loads = {}
    for each in weighed:
        share = each.noise * (1.0 if alike else weighed[0].size / max(each.size, 1e-300))
        loads[id(each)] = each.weight / each.points * (share**2 if squares else share)
    usual = float(np.mean(list(loads.values()))) if loads else 1.0
    return np.array([loads.get(id(each), usual) / usual for each in evidence])


def learning(points: int, parameters: int) -> float:
    """The factor, in the median over draws of white noise, by which the 95 % intervals of a fit that has to learn the noise of its
    points are wider than with the noise known."""
    return max(float(np.median(learned(points, parameters))), 1.0)


@functools.cache
def learned(points: int, parameters: int) -> Array:
    """These factors (DRAWN,) for each draw of the noise; of a curve whose parameters change it as powers of the depth do."""
    if points > MOST:
        return np.ones(DRAWN)
    number = max(min(parameters, points - 2), 1)
    depth = np.arange(1, points + 1) / points
    shapes, _ = np.linalg.qr(depth[:, None] ** np.arange(1, number + 1))
    rng, widths = np.random.default_rng(0), []
    for _ in range(DRAWN):
        noise = rng.standard_normal(points)
        _, known = errors([shapes], [shapes @ (shapes.T @ noise) - noise], [1.0])
        widths.append(np.median(quantiles(known.freedom) * np.sqrt(np.diag(known.covar))))
    return np.array(widths) / NORMAL
