"""Mixtures of Student's t densities that follow draws (Cappe et al. 2008): for a chain's proposals, and for bridge sampling."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular
from scipy.special import gammaln

from indentfit.arrays import Array

PARTS = 6  # of the mixture
FOLLOWED, STEPS = 2000, 6  # draws that a mixture follows, and steps of EM
HEAVY = 8.0  # degrees of freedom of the tails of its parts
WIDER = 1.2  # factor on the covariances of its parts
WHOLE = 0.05  # share of its draws that are standard normal
LARGEST = 8.0  # largest normal coordinate


@dataclass(frozen=True, eq=False)
class Mixture:
    """Student's t densities: centres (k, d), Cholesky factors (k, d, d), shares (k,)."""

    centres: Array
    roots: Array
    shares: Array

    def drawn(self, number: int, rng: np.random.Generator | np.random.RandomState) -> Array:
        """Draws, (number, d), part by part; some are standard normal."""
        counts = rng.multinomial(number, [*(1 - WHOLE) * self.shares, WHOLE])
        d = self.centres.shape[1]
        rows = []
        for centre, root, count in zip(self.centres, self.roots, counts, strict=False):
            stretch = np.sqrt(HEAVY / rng.chisquare(HEAVY, count))
            rows.append(centre + stretch[:, None] * (rng.standard_normal((count, d)) @ root.T))
        rows.append(rng.standard_normal((counts[-1], d)))
        return np.clip(np.vstack(rows), -LARGEST, LARGEST)

    def log(self, u: Array) -> Array:
        """Logarithm of the density at u (m, d)."""
        d = u.shape[1]
        terms = [np.log(share * (1 - WHOLE)) + row for share, row in zip(self.shares, self.parts(u), strict=True)]
        terms.append(np.log(WHOLE) - 0.5 * np.sum(u**2, axis=1) - 0.5 * d * np.log(2 * np.pi))
        return summed(terms)

    def parts(self, u: Array) -> Array:
        """Logarithms of the densities of the parts at u, (k, m)."""
        d, rows = u.shape[1], []
        constant = gammaln((HEAVY + d) / 2) - gammaln(HEAVY / 2) - 0.5 * d * np.log(HEAVY * np.pi)
        for centre, root in zip(self.centres, self.roots, strict=True):
            white = (u - centre) @ solve_triangular(root, np.eye(d), lower=True).T
            squares = np.einsum("md,md->m", white, white)
            rows.append(constant - np.log(np.diag(root)).sum() - 0.5 * (HEAVY + d) * np.log1p(squares / HEAVY))
        return np.array(rows)


def followed(u: Array, rng: np.random.Generator) -> Mixture:
    """A mixture that follows draws u (m, d), by a few steps of EM from draws that lie apart."""
    u = u[rng.choice(len(u), FOLLOWED)]
    d = u.shape[1]
    whole = np.cov(u.T) + 1e-10 * np.eye(d)
    roots = np.repeat(np.linalg.cholesky(whole)[None], PARTS, axis=0)
    mixture = Mixture(u[rng.choice(FOLLOWED, PARTS)], roots, np.full(PARTS, 1 / PARTS))
    for _ in range(STEPS):
        logs = mixture.parts(u) + np.log(mixture.shares)[:, None]
        belongs = np.asarray(np.exp(logs - summed(logs)))
        totals = np.maximum(belongs.sum(axis=1), 1e-9)
        centres: list[Array] = []
        factors: list[Array] = []
        for part, total in zip(belongs, totals, strict=True):
            centre = part @ u / total
            apart = u - centre
            few = 2 * d / (2 * d + total)  # few draws tell a covariance badly
            covar = (1 - few) * ((apart * part[:, None]).T @ apart / total) + few * whole
            factors.append(np.linalg.cholesky(covar + 1e-10 * np.eye(d)))
            centres.append(centre)
        sizes = np.maximum(totals / FOLLOWED, 0.01)
        mixture = Mixture(np.array(centres), np.array(factors), sizes / sizes.sum())
    return Mixture(mixture.centres, WIDER * mixture.roots, mixture.shares)


def summed(logs: Sequence[Array] | Array) -> Array:
    """Logarithm of a sum whose terms have these logarithms, (m,)."""
    rows = np.asarray(logs)
    most = rows.max(axis=0)
    return np.asarray(most + np.log(np.sum(np.exp(rows - most), axis=0)))
