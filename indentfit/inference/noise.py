"""The noise that the residuals show, and the errors of the parameters under that noise.

Each test has noise of its own size and, where its residuals are correlated, an autocorrelation. The noise is AR(1). The coefficient
that is told is that under which the residuals of such a fit would be as smooth as the residuals are. Errors go over all
coefficients, by their probabilities (`Correlated`), unless the residuals are surely smooth: few residuals seldom show whether they
are correlated. Before the residuals speak, noise is white with the probability WHITE; otherwise the logarithm of the length over
which it decorrelates is uniform, from none to the whole test. A curve that states standard deviations states independent points:
its noise is white with the probability STATED_WHITE, unless residuals are too large, or too small, for that. Smooth residuals are
mostly misfit of the model: the errors are then only an honest width for the part of the curves that the model cannot follow, and a
note says so.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq
from scipy.special import stdtr
from scipy.stats import chi2
from scipy.stats import t as student

from indentfit.arrays import Array
from indentfit.inference.quantiles import quantile
from indentfit.inference.result import CurveNoise

SIGNIFICANT = 1.645  # an autocorrelation within so many standard errors of zero counts as zero
LARGER = 0.95  # probability below which residuals are larger than a stated noise by chance, or more correlated than they look
DRAWN = 999  # draws of independent noise, with which the smoothness of residuals is compared
FEWEST = 4  # points of a test whose noise may be correlated
WHITE, SLAB = 0.75, 6  # prior probability of white noise, and the number of equally probable correlations beside it
STATED_WHITE = 0.95  # the same where the curve states standard deviations, which are those of independent points
UNLIKELY = 0.01  # probability of white noise below which residuals are surely smooth
SMALLEST = 1e-12  # of the forces: smaller residuals count as zero
SINGULAR = 1e-8  # of the largest singular value: smaller singular values count as zero
CONFIDENCE = 0.975  # quantile at which errors are those of the mixture of all correlations


@dataclass(frozen=True, eq=False)
class Errors:
    """Errors of the estimates of p parameters.

    Parameters
    ----------
    covar : array (p, p)
    plain : array (p, p)
        (J^T W J)^-1.
    typical : float
        The ratio of plain to covar, over all directions that change the curves.
    freedom : array (p,)
        Degrees of freedom by Welch and Satterthwaite.
    estimator : tuple of arrays (p, n)
        The map from small changes of each curve to changes of the estimates.
    added : array (p, p)
        The part of covar that is not of the noise.
    """

    covar: Array
    plain: Array
    typical: float
    freedom: Array
    estimator: tuple[Array, ...]
    added: Array


def errors(
    slopes: Sequence[Array], residuals: Sequence[Array], weights: Sequence[float], stated: Sequence[float] | None = None
) -> tuple[tuple[CurveNoise, ...], Errors]:
    """Noise of the curves, and errors of the estimate that minimises sum w |r|^2 over the tests.

    The covariance is that of this estimator under the noise that the residuals show (a "sandwich"), not that of the best estimator.

    Parameters
    ----------
    slopes : sequence of arrays (n, p), mN per unit of each parameter
    residuals : sequence of arrays (n,), mN
    weights : sequence of float, above 0
    stated : sequence of float, mN
        Standard deviation of a point that the curve itself states, 0 where none is. It counts as known, unless the residuals are
        significantly larger: a few residuals that are larger by chance would widen every interval. What exceeds the noise of the
        residuals is independent noise beside it.

    Returns
    -------
    tuple of CurveNoise, one for each test; Errors
    """
    J = np.concatenate([np.sqrt(w) * s for w, s in zip(weights, slopes, strict=True)])
    plain = inverse(J)
    A = _seen(J)
    B = [w * A @ s.T for w, s in zip(weights, slopes, strict=True)]
    M = [
        [(np.eye(len(r)) if k == j else 0.0) - s @ B[j] for j in range(len(B))]
        for k, (s, r) in enumerate(zip(slopes, residuals, strict=True))
    ]
    rho = [autocorrelation(M[k][k], r) for k, r in enumerate(residuals)]
    R = [correlations(len(r), coefficient) for r, coefficient in zip(residuals, rho, strict=True)]
    variance, freedom = _variances(M, R, residuals)
    sizes = _as_stated(variance, freedom, np.zeros(len(R)) if stated is None else np.square(stated))
    variance, freedom = _known(variance, freedom, np.zeros(len(R)) if stated is None else np.square(stated))
    known = [Correlated.of(s, r, told, size) for s, r, told, size in zip(slopes, residuals, rho, sizes, strict=True)]
    made = [_made(b, told, over_all, degrees) for b, told, over_all, degrees in zip(B, R, known, freedom, strict=True)]
    more = np.fmax(np.square(np.zeros(len(R)) if stated is None else stated) - np.nan_to_num(variance), 0.0)
    parts = np.array([v * np.diag(C) for v, C in zip(variance, made, strict=True)])  # (tests, p)
    of_stated = np.array([m * np.sum(b**2, axis=1) for m, b in zip(more, B, strict=True)])
    covar = sum((v * C + m * b @ b.T for v, m, b, C in zip(variance, more, B, made, strict=True)), np.zeros_like(plain))
    typical = np.linalg.matrix_rank(A) / max(np.trace(J.T @ J @ covar), 1e-300)
    covar = np.where(np.isfinite(plain), covar, plain)
    with np.errstate(invalid="ignore", divide="ignore"):
        welch = (parts + of_stated).sum(axis=0) ** 2 / (parts**2 / np.array(freedom)[:, None]).sum(axis=0)
    total = np.inf if more.any() else sum(freedom)
    welch = np.where(np.isfinite(welch), np.minimum(welch, total), total)
    noise = tuple(
        CurveNoise(
            sigma,
            coefficient,
            effective(len(r), coefficient),
            len(r),
            whiteness(M[k][k], r),
            float(np.sqrt(more[k])),
            fewest(len(r), known[k].rhos, known[k].shares),
        )
        for k, (sigma, coefficient, r) in enumerate(zip(np.sqrt(variance).tolist(), rho, residuals, strict=True))
    )
    return noise, Errors(covar, plain, float(typical), welch, tuple(B), np.zeros_like(plain))


def _made(B: Array, told: Array, known: "Correlated", freedom: float) -> Array:
    """Covariance (p, p) of what the noise of a test, whose variance under the told correlation is 1, makes of the parameters:
    B (p, n) times the noise.

    It goes over all correlations, each with its probability, so that the 97.5 % quantile of Student's t times the standard
    deviation is the 97.5 % quantile of their mixture, whose tails are longer. Of residuals that are surely smooth it is that of the
    told correlation, where parameters are less certain under that: misfit of the model is no AR(1) noise, and its likelihood takes
    it for a weaker correlation than its smoothness tells.
    """
    of_told, of_all = B @ told @ B.T, B @ known.mean @ B.T
    sizes = np.sqrt(known.sizes[:, None] * np.array([np.einsum("in,nm,im->i", B, R, B) for R in known.correlations]))
    degrees = max(freedom, 1.0)
    factor = _quantiles(known.shares, sizes, degrees) / student.ppf(CONFIDENCE, degrees)
    factor = factor / np.sqrt(np.maximum(np.diag(of_all), 1e-300))
    of_all = of_all * np.outer(factor, factor)
    first, second = np.diag(of_told), np.diag(of_all)
    less = np.sum(first / np.maximum(first + second, 1e-300)) > len(first) / 2
    return of_told if less and known.shares[0] < UNLIKELY else of_all


def _quantiles(shares: Array, sizes: Array, freedom: float) -> Array:
    """The 97.5 % quantiles (p,) of mixtures of Student's t about zero, with scales sizes (k, p) and shares (k,)."""
    low, high = (student.ppf(CONFIDENCE, freedom) * end for end in (sizes.min(axis=0), sizes.max(axis=0)))
    scales = np.maximum(sizes, 1e-300)
    return quantile(lambda at: shares @ stdtr(freedom, at / scales), low, high, CONFIDENCE)


@dataclass(frozen=True, eq=False)
class Correlated:
    """The possible correlations of the noise of one test, white noise first, given its residuals.

    Parameters
    ----------
    rhos : array (k,)
    shares : array (k,)
        Their probabilities.
    sizes : array (k,)
        The variance of the noise under each, over that under the told correlation.
    points : int
    """

    rhos: Array
    shares: Array
    sizes: Array
    points: int

    @classmethod
    def of(cls, slopes: Array, residuals: Array, told: float, variance: float = 0.0) -> "Correlated":
        """The correlations of residuals (n,) by their restricted likelihood, with the size of the noise integrated out, uniform in
        its logarithm (Harville 1974, Biometrika 61:383), or with the variance of a point that is known, where it is above 0.

        Only what slopes (n, p) cannot make is looked at: there the residuals are the test's own noise, whatever other tests do to
        the parameters.
        """
        n = len(residuals)
        U, sizes, _ = np.linalg.svd(slopes, full_matrices=False)
        made = U[:, sizes > SINGULAR * sizes.max(initial=0.0)]
        left = residuals - made @ (made.T @ residuals)
        if n < FEWEST or n - made.shape[1] < 2 or not np.any(np.abs(left) > SINGULAR * np.abs(residuals).max()):
            return cls(np.array([told]), np.ones(1), np.ones(1), n)
        rhos = possible(n)
        pairs = np.array([_likelihood(made, left, rho, variance) for rho in (*rhos, told)])
        white = STATED_WHITE if variance else WHITE
        prior = np.array([white, *np.full(SLAB, (1 - white) / SLAB)])
        logs = np.log(prior) + pairs[:-1, 0]
        shares = np.exp(logs - logs.max())
        return cls(rhos, shares / shares.sum(), pairs[:-1, 1] / pairs[-1, 1], n)

    @property
    def correlations(self) -> Array:
        """The correlations of the points under each, (k, n, n)."""
        return np.array([correlations(self.points, rho) for rho in self.rhos])

    @property
    def mean(self) -> Array:
        """The mean covariance of noise whose variance under the told correlation is 1, (n, n)."""
        return np.asarray(np.tensordot(self.shares * self.sizes, self.correlations, axes=1))


def _likelihood(made: Array, left: Array, rho: float, known: float = 0.0) -> tuple[float, float]:
    """Logarithm of the restricted likelihood of residuals left (n,) beside independent shapes made (n, p), and the variance of the
    AR(1) noise: that which is known, where it is above 0."""
    Q, R = np.linalg.qr(_white(made, rho))
    white = _white(left[:, None], rho)[:, 0]
    white = white - Q @ (Q.T @ white)
    n, freedom = left.size, left.size - made.shape[1]
    squares = float(white @ white)
    volume = (n - 1) * np.log1p(-(rho**2)) / 2 + np.log(np.abs(np.diag(R))).sum()
    if known:
        return float(-volume - squares / known / 2), known
    return float(-volume - freedom / 2 * np.log(squares)), squares / freedom


def _white(rows: Array, rho: float) -> Array:
    """Rows (n, k) from which AR(1) noise of n equally spaced points comes out independent, of variance 1."""
    return np.vstack([rows[:1], (rows[1:] - rho * rows[:-1]) / np.sqrt(1 - rho**2)])


def possible(n: int) -> Array:
    """The correlations rho that the noise of n points may have: none, then SLAB steps to the largest, evenly in the logarithm of
    1 - rho, and so in that of the length over which the noise decorrelates."""
    slab = 1 - (1 - most_correlated(n)) ** ((np.arange(SLAB) + 0.5) / SLAB) if n >= FEWEST else np.zeros(0)
    return np.array([0.0, *slab])


def _known(variance: Array, freedom: Sequence[float], stated: Array) -> tuple[Array, list[float]]:
    """Variances and degrees of freedom, where those that curves state count as known unless residuals are larger by more than
    chance."""
    with np.errstate(invalid="ignore", divide="ignore"):
        most = stated * chi2.ppf(LARGER, freedom) / freedom
    known = (stated > 0) & ~(variance > most)
    degrees = [np.inf if as_stated else own for as_stated, own in zip(known, freedom, strict=True)]
    return np.where(known, np.minimum(variance, stated), variance), degrees


def _as_stated(variance: Array, freedom: Sequence[float], stated: Array) -> Array:
    """The variances that curves state, where residuals are neither larger nor smaller by more than chance; 0 for other curves.

    A stated size tells more of the correlation than residuals alone: correlated noise of that size would leave smaller ones.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        least, most = (stated * chi2.ppf(share, freedom) / freedom for share in (1 - LARGER, LARGER))
    return np.where((variance >= least) & (variance <= most), stated, 0.0)


def whiteness(M: Array, residuals: Array) -> float:
    """The probability that the residuals, M times independent noise, have the lag-1 correlation that they show, or more.

    Parameters
    ----------
    M : array (n, n)
    residuals : array (n,)

    Returns
    -------
    float
        By DRAWN draws of the noise; 1 where there are no residuals.
    """
    if len(residuals) < 4 or not residuals.any() or np.trace(M @ M.T) < 1e-9:
        return 1.0
    drawn = np.random.default_rng(0).standard_normal((DRAWN, len(residuals))) @ M.T
    expected = np.sum(drawn[:, 1:] * drawn[:, :-1], axis=1) / np.maximum(np.sum(drawn**2, axis=1), 1e-300)
    return float((1 + np.sum(expected >= residuals[1:] @ residuals[:-1] / (residuals @ residuals))) / (1 + DRAWN))


def draw(noise: CurveNoise, rng: np.random.Generator) -> Array:
    """One draw of the noise of one curve, mN, (n,)."""
    root = np.linalg.cholesky(correlations(noise.points, noise.autocorrelation) + 1e-12 * np.eye(noise.points))
    drawn = (noise.sigma or 0.0) * root @ rng.standard_normal(noise.points)
    return drawn + noise.stated * rng.standard_normal(noise.points) if noise.stated else drawn


def correlations(n: int, rho: float) -> Array:
    """AR(1) correlations of n equally spaced points, (n, n)."""
    steps = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    return float(rho) ** steps if rho else np.eye(n)


def inverse(J: Array) -> Array:
    """(J^T J)^-1; infinite for parameters in a direction that does not change the curves."""
    _, singular_values, directions = np.linalg.svd(J, full_matrices=False)
    n = J.shape[1]
    seen = singular_values > SINGULAR * singular_values[0]
    covar = _seen(J)
    hidden = np.linalg.norm(np.eye(n) - directions[seen].T @ directions[seen], axis=0) > 1e-6
    covar[hidden] = covar[:, hidden] = np.nan
    covar[hidden, hidden] = np.inf
    return covar


def _seen(J: Array) -> Array:
    """The pseudo-inverse of J^T J, without the directions that do not change the curves."""
    _, singular_values, directions = np.linalg.svd(J, full_matrices=False)
    seen = singular_values > SINGULAR * singular_values[0]
    return (directions[seen].T / singular_values[seen] ** 2) @ directions[seen]


def autocorrelation(M: Array, residuals: Array) -> float:
    """The AR(1) coefficient under which the residuals, M times the noise, are expected to have the observed lag-1 product."""
    n = len(residuals)
    if n < FEWEST or not residuals.any():
        return 0.0
    shown = residuals[1:] @ residuals[:-1] / (residuals @ residuals)

    def expected(rho: float) -> float:
        V = M @ correlations(n, rho) @ M.T
        return np.trace(V, offset=1) / np.trace(V)

    most = most_correlated(n)
    if np.trace(M @ M.T) < 1e-9 or shown - expected(0.0) < SIGNIFICANT / np.sqrt(n):
        return 0.0
    return most if shown >= expected(most) else float(brentq(lambda rho: expected(rho) - shown, 0.0, most, xtol=1e-6))


def most_correlated(n: int) -> float:
    """The largest AR(1) coefficient of n points: their noise decorrelates within the test, or the test would determine nothing."""
    return float(np.exp(-1 / n))


def _variances(M: list[list[Array]], R: list[Array], residuals: Sequence[Array]) -> tuple[Array, list[float]]:
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


def effective(n: int, rho: float) -> float:
    """The number of independent points whose mean has the variance of that of n points with this correlation."""
    return n / float(correlations(n, rho).sum() / n)


def fewest(n: int, rhos: Array, shares: Array) -> float:
    """The least effective number of n points that is not improbable: under the correlation that is exceeded with a probability of
    5 %, where correlations rhos (k,) have the probabilities shares (k,)."""
    order = np.argsort(rhos)
    held = np.cumsum(shares[order])
    return effective(n, float(rhos[order][min(int(np.searchsorted(held, LARGER * held[-1])), held.size - 1)]))
