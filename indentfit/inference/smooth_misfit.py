"""The noise at an optimum of a joint fit: what the coordinates explain of it, and what smooth residuals may have made of that.

Residuals that are surely smooth are mostly the law's misfit. Their likelihood as AR(1) noise tells its size from the steps between
neighbouring points, which a smooth misfit has not, so that an input or parameter seems the better known, the smoother the misfit
is. The size that counts is that of the residuals themselves, under the correlation that is as smooth as they are, as in a fit
whose inputs are known (`noise.errors`). What of it the steps do not tell is misfit, and few degrees of freedom tell its size; the
rest is noise, whose size is a coordinate of the posterior.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag, eigh
from scipy.optimize import minimize_scalar
from scipy.stats import norm
from scipy.stats import t as student

from indentfit.arrays import Array
from indentfit.inference.explained import Explained, explained
from indentfit.inference.noise import CONFIDENCE, SLAB, UNLIKELY, WHITE, correlations, possible
from indentfit.inference.posterior import FINEST, Posterior, noise_at

UNIFORM = 12.0  # inverse of the variance of a uniform density over a range
ELSEWHERE = 0.01  # what the other tests' knowledge of the coordinates counts: a test is asked unless they know ten times as much
OWN = 0.5  # share from which a direction is one that the test tells
APART = 0.5  # least number of differences between tests that tell how far they are apart
FEWEST = 3  # directions of a test beside these that tell whether it is smooth


def under_noise_at(posterior: Posterior, z: Array) -> Posterior:
    """The posterior under the noise that the residuals at a place show."""
    noise = noise_at(_with(posterior, explained=explained_at(posterior, z)), z)
    sized = _with(replace(posterior, noise=noise), explained=explained_at(replace(posterior, noise=noise), z), smooth=None)
    smooth = smooth_at(sized, z)
    if smooth is None:
        return sized
    apart = _with(sized, smooth=smooth)
    return _with(apart, smooth=smooth + apart_at(apart, z))


def _with(posterior: Posterior, **changes: object) -> Posterior:
    return replace(posterior, noise=replace(posterior.noise, **changes))  # type: ignore[arg-type]


def explained_at(posterior: Posterior, z: Array) -> tuple[Explained, ...]:
    """What the coordinates explain of the noise of each test about a place, beside what priors and the other tests tell of them."""
    curves, noise = posterior.curves, posterior.noise
    slopes, P = curves.at(z)[1], posterior.prior_rows()[0]
    sizes = np.maximum(noise.sigma, noise.stated)
    J = [slopes[rows] * (trust / size)[:, None] for rows, trust, size in zip(curves.slices, noise.trust, sizes, strict=True)]
    told = [rows.T @ rows if used else np.zeros((z.size, z.size)) for rows, used in zip(J, posterior.used, strict=True)]
    prior = np.diag(np.where(P.any(axis=0), 0.0, UNIFORM)) + P.T @ P
    return tuple(explained(rows, prior + ELSEWHERE * (sum(told) - own)) for rows, own in zip(J, told, strict=True))


def smooth_at(posterior: Posterior, z: Array) -> Array | None:
    """Covariance (N, N), mN^2, of what smooth residuals at a place may have made of the explained parts of their tests, beyond what
    the AR(1) noise makes; None where no residuals are surely smooth."""
    curves, noise, blocks = posterior.curves, posterior.noise, []
    left = curves.measured() - curves.at(z)[0]
    for k, rows in enumerate(curves.slices):
        n, even = rows.stop - rows.start, np.outer(noise.trust[k], noise.trust[k])
        beside = max(noise.stated[k] ** 2 - noise.sigma[k] ** 2, 0.0) * np.eye(n)
        least = FINEST * float(np.abs(curves.problem.tests[k].curve.force).max())
        more = None
        if posterior.used[k] and noise.rho[k] > 0:
            test = _Residuals.of(left[rows] * noise.trust[k], noise.explained[k], noise.errors[rows, rows] * even + beside, least)
            more = test.more(float(noise.rho[k])) if test is not None else None
        blocks.append(np.zeros((n, n)) if more is None else more / even)
    covar = np.asarray(block_diag(*blocks))
    return covar if covar.any() else None


def apart_at(posterior: Posterior, z: Array) -> Array:
    """Covariance (N, N), mN^2, by which tests with smooth residuals lie further apart at a place than all covariances say.

    What the coordinates explain of one test alone, another test may ask for differently. Where the squares of these differences are
    more than their number, the explained parts count as larger by that ratio (Birge 1932, Phys Rev 40:207).
    """
    curves, noise = posterior.curves, posterior.noise
    (force, slopes), P, covar = curves.at(z), posterior.prior_rows()[0], noise.covar(curves.slices)
    more = np.zeros_like(covar)
    assert noise.smooth is not None
    own = [
        (rows, part)
        for rows, known, trust, used in zip(curves.slices, noise.explained, noise.trust, posterior.used, strict=True)
        if used and (part := known.directions[:, known.shares >= OWN] / trust[:, None]).size
    ]
    if len(own) < 2:
        return more
    D = np.zeros((force.size, sum(part.shape[1] for _, part in own)))
    for (rows, part), end in zip(own, np.cumsum([part.shape[1] for _, part in own]), strict=True):
        D[rows, end - part.shape[1] : end] = part
    within, J, left = D.T @ covar @ D, D.T @ slopes, D.T @ (force - curves.measured())
    inverse = np.linalg.inv(within)
    beside = inverse - inverse @ J @ np.linalg.solve(J.T @ inverse @ J + P.T @ P + 1e-6 * np.eye(z.size), J.T @ inverse)
    number = float(np.trace(beside @ within))
    ratio = float(left @ beside @ left) / number if number > APART else 1.0
    for rows, part in own:
        if ratio > 1 and noise.smooth[rows, rows].any():
            Q = np.linalg.qr(part)[0]
            onto = Q @ Q.T
            more[rows, rows] = (ratio - 1) * onto @ covar[rows, rows] @ onto
    return more


@dataclass(frozen=True, eq=False)
class _Residuals:
    """Residuals of one test with equally noisy points: the directions (n, r) that the coordinates explain, all others (n, m), the
    residuals in these (m,), the errors (m, m) beside the noise there, and the least standard deviation of the noise."""

    own: Array
    others: Array
    left: Array
    beside: Array
    least: float

    @classmethod
    def of(cls, left: Array, known: Explained, errors: Array, least: float) -> "_Residuals | None":
        """The residuals (n,) of a test; None where too few directions or too little noise are left to tell anything."""
        own = known.directions[:, known.shares >= OWN]
        others = np.linalg.qr(own, mode="complete")[0][:, own.shape[1] :]
        seen = others.T @ left
        if not own.size or seen.size < FEWEST or np.sqrt(np.mean(seen**2)) <= least:
            return None
        return cls(own, others, seen, others.T @ errors @ others, least)

    def more(self, told: float) -> Array | None:
        """What residuals of the told correlation may have made of the explained directions beyond the AR(1) noise, (n, n).

        Of their squares the part that AR(1) noise of the size of their steps has counts as noise, what is beyond that as misfit.
        Student's t, by which few squares may be too small, goes with the misfit alone: draws and profiles know it of the noise.
        """
        rhos = possible(self.others.shape[0])
        known = [self._likelihood(rho) for rho in rhos]
        logs = np.log([WHITE, *np.full(SLAB, (1 - WHITE) / SLAB)]) + [log for log, _ in known]
        shares = np.exp(logs - logs.max())
        shares /= shares.sum()
        if shares[0] >= UNLIKELY:
            return None
        R = self._within(self.others, told)
        variance = float(self.left @ self.left - np.trace(self.beside)) / np.trace(R)
        if variance <= 0:
            return None
        longer = student.ppf(CONFIDENCE, max(np.trace(R) ** 2 / np.sum(R**2), 1.0)) / norm.ppf(CONFIDENCE)
        made = [share * size * self._within(self.own, rho) for share, (_, size), rho in zip(shares, known, rhos, strict=True)]
        by_steps, of_told = np.sum(made, axis=0), self._likelihood(told)[1]
        larger = max((of_told * self._within(self.own, told), by_steps), key=np.trace)
        by_size = larger * (1 + longer**2 * max(variance / of_told - 1, 0.0))
        values, vectors = eigh(by_size - by_steps)
        root = self.own @ (vectors * np.sqrt(np.maximum(values, 0.0)))
        return np.asarray(root @ root.T)

    def _within(self, directions: Array, rho: float) -> Array:
        """Covariance of AR(1) noise of variance 1 in directions (n, k), (k, k)."""
        return np.asarray(directions.T @ correlations(len(directions), rho) @ directions)

    def _likelihood(self, rho: float) -> tuple[float, float]:
        """The largest restricted likelihood of AR(1) noise beside the errors, its logarithm, and the variance of the noise."""
        R = self._within(self.others, rho)
        errors, vectors = eigh(self.beside, R)
        squares = (vectors.T @ self.left) ** 2
        volume = float(np.linalg.slogdet(R)[1])

        def cost(log: float) -> float:
            variances = np.exp(2 * log) + np.maximum(errors, 0.0)
            return float(np.sum(np.log(variances) + squares / variances)) + volume

        ends = np.log(self.least), np.log(max(np.sqrt(squares.max()), 2 * self.least))
        best = minimize_scalar(cost, bounds=ends, method="bounded")
        return -0.5 * float(best.fun), float(np.exp(2 * best.x))
