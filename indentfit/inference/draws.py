"""Weighted draws of the posterior on a fit's surrogate, and the intervals that they make.

Draws come from a mixture of Student's t densities that follows the draws before (population Monte Carlo: Cappe et al. 2008; the
weights are those of all rounds' mixtures together: Cornuet et al. 2012). They live in coordinates u whose normal distribution
function is the place, so that the bounds of the ranges are far away and a coordinate of which the curves say nothing is a
standard normal variable.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular
from scipy.special import gammaln, logsumexp, ndtr, ndtri

from indentfit.arrays import Array
from indentfit.inference.density import Density
from indentfit.inference.joint import JointFit, bounded
from indentfit.inference.plain import Interval
from indentfit.inference.posterior import Climber

SHARE = 0.95  # of the posterior that an interval holds
# Draws of each round; rounds at most and at least. Rounds of 5,000 found draws of large weight in the tails of a bar's curves over
# an unknown rig, which no later round followed: 16 effective ones of 89,500 were left, where rounds of 1,500 have 2,500.
ROUND, ROUNDS, FEWEST_ROUNDS = 1500, 30, 3
WANTED, ENOUGH = 2500.0, 400.0  # effective number of draws at which drawing ends, and below which draws make no interval
PARTS = 6  # of the mixture that follows the draws
FOLLOWED, STEPS = 2000, 6  # draws that a mixture follows, and steps of EM
HEAVY = 8.0  # degrees of freedom of the tails of its parts
WIDER = 1.2  # factor on the covariances of its parts
WHOLE = 0.05  # share of the draws from the whole ranges
CELLS = 600  # of a range of draws, in which their density is counted
SMOOTH = 0.8  # width of the kernel of this density, over that of Silverman's rule
DIP = 0.6  # of the density at the ends of two pieces: a shallower dip between them is the scatter of draws, and they are one piece
WORTH = 12.0  # growth of chi2 beyond which another maximum is no part of the first mixture
LARGEST = 8.0  # largest u


@dataclass(frozen=True, eq=False)
class Draws:
    """Weighted draws under one alternative.

    Parameters
    ----------
    places : array (m, n + 2 tests), or with one more column
        See `Density`.
    shares : array (m,)
        Their weights, which add up to 1.
    effective : float
        Effective number of draws: 1 / sum of the squares of the weights.
    log_evidence : float
        Logarithm of the density of the curves, up to a constant that alternatives share.
    mixture : Mixture or None
        The density, over u, from which the last ones were drawn.
    """

    places: Array
    shares: Array
    effective: float
    log_evidence: float
    mixture: "Mixture | None" = None

    @property
    def enough(self) -> bool:
        """Whether there are enough to tell the ends of an interval."""
        return self.effective >= ENOUGH

    def interval(self, n: int) -> Interval:
        """The outermost ends of the smallest set of coordinate n that holds 95 %, in units of its range."""
        parts = pieces([self], [1.0], n)
        return parts[0][0], parts[-1][1]


def drawn(fit: JointFit, seed: int) -> Draws:
    """Weighted draws of the posterior of a joint fit.

    Parameters
    ----------
    fit : JointFit
    seed : int

    Returns
    -------
    Draws
    """
    density, rng = Density(fit), np.random.default_rng(seed)
    mixtures, counts = [_first(fit, density)], [ROUND]
    us, logs, proposed = np.zeros((0, density.size)), np.zeros(0), np.zeros(0)
    while True:
        new = mixtures[-1].drawn(counts[-1], rng)
        logs, us = np.concatenate([logs, over_u(density, new)]), np.vstack([us, new])
        earlier = [known.log(new) + np.log(count) for known, count in zip(mixtures[:-1], counts[:-1], strict=True)]
        before = _summed(earlier) if earlier else np.full(counts[-1], -np.inf)
        last = mixtures[-1].log(us) + np.log(counts[-1])
        proposed = np.logaddexp(np.concatenate([proposed, before]), last) if earlier else last
        weights = logs - proposed + np.log(len(us))
        total = float(logsumexp(weights))
        if not np.isfinite(total):
            return Draws(density.place(fit.mode.z)[None], np.ones(1), 1.0, -np.inf)
        shares = np.exp(weights - total)
        effective = float(1 / np.sum(shares**2))
        if (effective >= WANTED and len(mixtures) >= FEWEST_ROUNDS) or len(mixtures) == ROUNDS:
            evidence = total - float(np.log(len(us))) - 0.5 * density.size * float(np.log(2 * np.pi))
            return Draws(ndtr(us), shares, effective, evidence, mixtures[-1])
        mixtures.append(_followed(us, tempered(weights, 20.0 * density.size), rng))
        counts.append(ROUND)


def over_u(density: Density, u: Array) -> Array:
    """Logarithm of the density over u, (m,), up to a constant."""
    return np.asarray(density(ndtr(u)) - 0.5 * np.sum(u**2, axis=1))


def _summed(logs: Sequence[Array] | Array) -> Array:
    """Logarithm of a sum whose terms have these logarithms, (m,)."""
    rows = np.asarray(logs)
    most = rows.max(axis=0)
    return np.asarray(most + np.log(np.sum(np.exp(rows - most), axis=0)))


def tempered(weights: Array, least: float) -> Array:
    """Shares of draws with log weights (m,), flattened until their effective number is `least`."""
    for power in (1.0, 0.7, 0.5, 0.35, 0.25, 0.15, 0.1, 0.05):
        shares = np.exp(power * (weights - weights.max()))
        shares /= shares.sum()
        if 1 / np.sum(shares**2) >= least:
            break
    return np.asarray(shares)


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
        return _summed(terms)

    def parts(self, u: Array) -> Array:
        """Logarithms of the densities of the parts at u, (k, m)."""
        d, rows = u.shape[1], []
        constant = gammaln((HEAVY + d) / 2) - gammaln(HEAVY / 2) - 0.5 * d * np.log(HEAVY * np.pi)
        for centre, root in zip(self.centres, self.roots, strict=True):
            white = (u - centre) @ solve_triangular(root, np.eye(d), lower=True).T
            squares = np.einsum("md,md->m", white, white)
            rows.append(constant - np.log(np.diag(root)).sum() - 0.5 * (HEAVY + d) * np.log1p(squares / HEAVY))
        return np.array(rows)


def _first(fit: JointFit, density: Density) -> Mixture:
    """The mixture of the Gaussians of linear theory about the maxima of the density."""
    modes = [fit.mode, *(mode for mode in fit.others if mode.chi2 < fit.mode.chi2 + WORTH)]
    climber = Climber(fit.posterior)
    centres, roots, sizes = [], [], []
    spread = 1 / np.sqrt(2 * max(fit.freedom / len(density.used), 1.0)) / (density.highest - density.lowest)
    for mode in modes:
        margin = np.full(density.size, 0.01)
        margin[: mode.z.size] = np.minimum(
            0.01, np.sqrt(np.diag(mode.covar))
        )  # a range may be far wider than what the curves allow
        place = np.clip(density.place(mode.z), margin, 1 - margin)
        u = ndtri(place)
        steepness = np.exp(-0.5 * u**2) / np.sqrt(2 * np.pi)  # of the place by u
        J = climber.residuals(place[: mode.z.size])[1] * steepness[: mode.z.size]
        covar = np.eye(density.size)
        covar[: mode.z.size, : mode.z.size] = np.linalg.inv(J.T @ J + np.eye(mode.z.size))
        for k in range(len(density.used)):
            n = mode.z.size + k
            covar[n, n] = 1 / (1 + (steepness[n] / spread[k]) ** 2)
        u[mode.z.size + len(density.used) :] = 0.0  # all correlations of the noise are tried, and all scales of the law's misfit
        centres.append(u)
        roots.append(np.linalg.cholesky(WIDER**2 * covar))
        sizes.append(-0.5 * mode.chi2 + 0.5 * float(np.linalg.slogdet(bounded(mode.covar, mode.z))[1]))
    shares = np.maximum(np.exp(np.array(sizes) - max(sizes)), 0.02)
    return Mixture(np.array(centres), np.array(roots), shares / shares.sum())


def _followed(u: Array, shares: Array, rng: np.random.Generator) -> Mixture:
    """A mixture that follows weighted draws, by a few steps of EM from draws that lie apart."""
    picked = np.searchsorted(np.cumsum(shares), (np.arange(FOLLOWED) + rng.random()) / FOLLOWED)
    u = u[np.minimum(picked, len(u) - 1)]
    d = u.shape[1]
    whole = np.cov(u.T) + 1e-10 * np.eye(d)
    roots = np.repeat(np.linalg.cholesky(whole)[None], PARTS, axis=0)
    mixture = Mixture(u[rng.choice(FOLLOWED, PARTS)], roots, np.full(PARTS, 1 / PARTS))
    for _ in range(STEPS):
        logs = mixture.parts(u) + np.log(mixture.shares)[:, None]
        belongs = np.asarray(np.exp(logs - _summed(logs)))
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


def pieces(alternatives: Sequence[Draws], probabilities: Sequence[float], n: int, share: float = SHARE) -> tuple[Interval, ...]:
    """The pieces of the smallest set of values of a coordinate that holds a share of the mixture of alternatives.

    Parameters
    ----------
    alternatives : sequence of Draws
    probabilities : sequence of float
    n : int
        The coordinate.
    share : float

    Returns
    -------
    tuple of (low, high), in units of the range, in rising order
    """
    kernels = [_kernel(known.places[:, n], known.shares, known.effective) for known in alternatives]
    counted = [k for k, share in enumerate(probabilities) if share > 1e-3]
    ends = [_span(alternatives[k].places[:, n], alternatives[k].shares, 5 * kernels[k]) for k in counted]
    grid = np.unique(np.concatenate([np.linspace(low, high, CELLS + 1) for low, high in ends]))
    width = np.diff(grid)
    mass = np.sum([probabilities[k] * _mass(alternatives[k], n, kernels[k], grid) for k in counted], axis=0)
    density = mass / np.maximum(width, 1e-300)
    cells = _smallest(density, mass, share)
    return tuple((float(grid[first]), float(grid[last])) for first, last in cells)


def _smallest(density: Array, mass: Array, share: float) -> list[tuple[int, int]]:
    """First and last edges of the runs of cells, joined over shallow dips, that hold a share of the mass at the highest level of
    the density: joined at the level at which the cells alone hold it, they would hold more, where a long tail is flat."""
    levels = np.sort(density)[::-1]
    wanted, first, last = share * float(mass.sum()), 0, density.size - 1
    while first < last:
        middle = (first + last) // 2
        if sum(mass[a:b].sum() for a, b in _joined(density, levels[middle])) >= wanted:
            last = middle
        else:
            first = middle + 1
    return _joined(density, levels[last])


def _joined(density: Array, level: float) -> list[tuple[int, int]]:
    """Runs of cells (first, last + 1) of at least a density, joined where the dip between them is shallow."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], (density >= level).astype(int), [0]]))).reshape(-1, 2).tolist()
    joined = [edges[0]]
    for first, last in edges[1:]:
        if density[joined[-1][1] : first].min() > DIP * level:
            joined[-1][1] = last
        else:
            joined.append([first, last])
    return [(first, last) for first, last in joined]


def _kernel(values: Array, shares: Array, effective: float) -> float:
    """Width of the kernel of a density of weighted values."""
    order = np.argsort(values)
    low, high = np.interp([0.25, 0.75], np.cumsum(shares[order]), values[order])
    mean = shares @ values
    spread = float(np.sqrt(shares @ (values - mean) ** 2))
    narrow = min(spread, float(high - low) / 1.34) or spread
    return max(SMOOTH * 0.9 * narrow * effective**-0.2, 1e-9)


def _span(values: Array, shares: Array, margin: float) -> Interval:
    """Where weighted values lie, but for one in 100,000 at either end, with a margin, within the range."""
    order = np.argsort(values)
    low, high = np.interp([1e-5, 1 - 1e-5], np.cumsum(shares[order]), values[order])
    return max(float(low) - margin, 0.0), min(float(high) + margin, 1.0)


def _mass(known: Draws, n: int, kernel: float, grid: Array) -> Array:
    """What each cell of a grid holds of the smooth density of weighted draws, whose kernels are mirrored at 0 and 1."""
    values = known.places[:, n]
    fine = np.linspace(*_span(values, known.shares, 5 * kernel), CELLS + 1)
    counts = np.histogram(values, fine, weights=known.shares)[0]
    centres = (fine[1:] + fine[:-1]) / 2
    held = np.flatnonzero(counts)
    centres, counts = centres[held], counts[held]
    low, high = centres < 6 * kernel, centres > 1 - 6 * kernel
    centres = np.concatenate([centres, -centres[low], 2 - centres[high]])
    counts = np.concatenate([counts, counts[low], counts[high]])
    return np.diff(ndtr((grid[:, None] - centres) / kernel) @ counts)
