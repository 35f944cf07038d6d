"""What the residuals say about the noise, and what that noise does to the parameters.

Each test has noise of its own size and, where its residuals say so, an autocorrelation: AR(1), whose coefficient is the one
under which residuals of such a fit would be as smooth as these are. Smooth residuals are mostly misfit of the model: then
this is no more than an honest width for what the model cannot follow, and a note says so.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

SIGNIFICANT = 1.645  # standard errors of an autocorrelation from zero: below, the noise counts as independent
SMALLEST = 1e-12  # of the forces: residuals below are zero
SINGULAR = 1e-8  # of the largest singular value


@dataclass(frozen=True)
class CurveNoise:
    """Of each test that counts: sigma, mN, autocorrelation of neighbours, effective number of points, number of points."""

    sigma: tuple[float, ...]
    autocorrelation: tuple[float, ...]
    effective: tuple[float, ...]
    points: tuple[int, ...]

    def draw(self, rng):
        """One draw of the noise of each test, mN."""
        return tuple(
            s * np.linalg.cholesky(correlations(n, r) + 1e-12 * np.eye(n)) @ rng.standard_normal(n)
            for s, r, n in zip(self.sigma, self.autocorrelation, self.points, strict=True)
        )


@dataclass(frozen=True)
class Errors:
    """covar (p, p) of the estimates; plain (p, p) = (J^T W J)^-1; freedom (p,), by Welch and Satterthwaite; estimator: the
    matrices (p, n) that turn small changes of each curve into those of the estimates; typical: plain over covar, over all
    directions that the curves see."""

    covar: np.ndarray
    plain: np.ndarray
    typical: float
    freedom: np.ndarray
    estimator: tuple[np.ndarray, ...]


def errors(slopes, residuals, weights):
    """(CurveNoise, Errors) of an estimate that minimises sum w |r|^2 over the tests.

    slopes: (n, p) for each test, mN per unit of each parameter; residuals: (n,), mN; weights: one number each, above 0.
    The covariance is that of this estimator under the noise found, not of the best one (a "sandwich").
    """
    J = np.concatenate([np.sqrt(w) * s for w, s in zip(weights, slopes, strict=True)])
    plain = inverse(J)
    A = _seen(J)
    B = [w * A @ s.T for w, s in zip(weights, slopes, strict=True)]
    M = [
        [np.eye(len(r)) * (k == j) - s @ B[j] for j in range(len(B))]
        for k, (s, r) in enumerate(zip(slopes, residuals, strict=True))
    ]
    rho = [_autocorrelation(M[k][k], r) for k, r in enumerate(residuals)]
    R = [correlations(len(r), one) for r, one in zip(residuals, rho, strict=True)]
    variance, freedom = _variances(M, R, residuals)
    parts = np.array([v * np.einsum("in,nm,im->i", b, r, b) for v, b, r in zip(variance, B, R, strict=True)])  # (tests, p)
    covar = sum(v * b @ r @ b.T for v, b, r in zip(variance, B, R, strict=True))
    typical = np.linalg.matrix_rank(A) / max(np.trace(J.T @ J @ covar), 1e-300)
    covar = np.where(np.isfinite(plain), covar, plain)
    with np.errstate(invalid="ignore", divide="ignore"):
        welch = parts.sum(axis=0) ** 2 / (parts**2 / np.array(freedom)[:, None]).sum(axis=0)
    total = sum(freedom)
    welch = np.where(np.isfinite(welch), np.minimum(welch, total), total)
    effective = [len(r) / _inflation(len(r), one) for r, one in zip(residuals, rho, strict=True)]
    noise = CurveNoise(tuple(np.sqrt(variance).tolist()), tuple(rho), tuple(effective), tuple(len(r) for r in residuals))
    return noise, Errors(covar, plain, typical, welch, tuple(B))


def correlations(n, rho):
    """AR(1) correlations of n equally spaced points, (n, n)."""
    steps = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    return float(rho) ** steps if rho else np.eye(n)


def inverse(J):
    """(J^T J)^-1; infinite for parameters in a direction that the curves do not see."""
    _, singular_values, directions = np.linalg.svd(J, full_matrices=False)
    n = J.shape[1]
    seen = singular_values > SINGULAR * singular_values[0]
    found = _seen(J)
    hidden = np.linalg.norm(np.eye(n) - directions[seen].T @ directions[seen], axis=0) > 1e-6
    found[hidden] = found[:, hidden] = np.nan
    found[hidden, hidden] = np.inf
    return found


def _seen(J):
    """The pseudo-inverse of J^T J, without the directions that the curves do not see."""
    _, singular_values, directions = np.linalg.svd(J, full_matrices=False)
    seen = singular_values > SINGULAR * singular_values[0]
    return (directions[seen].T / singular_values[seen] ** 2) @ directions[seen]


def _autocorrelation(M, residuals):
    """The AR(1) coefficient under which the fit's residuals, M times the noise, would have the lag-1 product found."""
    n = len(residuals)
    if n < 4 or not residuals.any():
        return 0.0
    found = residuals[1:] @ residuals[:-1] / (residuals @ residuals)

    def expected(rho):
        V = M @ correlations(n, rho) @ M.T
        return np.trace(V, offset=1) / np.trace(V)

    most = float(np.exp(-1 / n))  # the noise of one test forgets itself within the test, or nothing could be learnt
    if np.trace(M @ M.T) < 1e-9 or found - expected(0.0) < SIGNIFICANT / np.sqrt(n):
        return 0.0
    return most if found >= expected(most) else float(brentq(lambda rho: expected(rho) - found, 0.0, most, xtol=1e-6))


def _variances(M, R, residuals):
    """Noise variance of each test, mN^2, unbiased under its correlations, and its degrees of freedom."""
    tests = range(len(R))
    squares = np.array([r @ r for r in residuals])
    traces = np.array([[np.einsum("nm,mk,nk->", M[k][j], R[j], M[k][j]) for j in tests] for k in tests])
    own = np.diag(traces)
    freedom = []
    for k in tests:
        V = M[k][k] @ R[k] @ M[k][k].T
        freedom.append(float(np.trace(V) ** 2 / max(np.sum(V * V.T), 1e-300)) if own[k] > 1e-9 else 0.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        alone = np.where(own > 1e-9, squares / own, np.nan)
    try:
        together = np.linalg.solve(traces, squares)
    except np.linalg.LinAlgError:
        return alone, freedom
    return (together if (together >= 0).all() and np.isfinite(alone).all() else alone), freedom


def _inflation(n, rho):
    """How much the variance of a mean of n points grows by their correlation."""
    return float(correlations(n, rho).sum() / n)
