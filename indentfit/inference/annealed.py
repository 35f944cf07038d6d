"""Draws of the density of a joint fit by sequential Monte Carlo (Del Moral et al. 2006) along falling noise.

Particles begin as draws of the priors, beside independent noise as large as the forces themselves. This noise falls level by level
to none; at each level particles are drawn again by their weights and then moved by Metropolis steps. A power of the density in its
place would fail where the noise of the curves has no known size: at some power, few particles find the narrow places of little
noise, and all others die at once.

A Metropolis step proposes the coordinates that change the solution, or those of the noise, by differences between particles (ter
Braak 2006), and draws the scale of the forces and offsets from the normal density that the curves then leave them, in which the
curves are nearly linear. The thin directions of the density lie mostly along these.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import log_ndtr, logsumexp, ndtr, ndtri

from indentfit.arrays import Array, Bools, Ints
from indentfit.inference.density import Covariances, Density

PARTICLES = 1000
BEGINNINGS = tuple(
    4.0**n for n in range(12)
)  # noises beside, over the largest forces, of which the least is taken that leaves enough
KEPT = 0.5  # effective share of the particles after a level
TRIED = 250  # particles on which the next level is tried
STEPS, LAST = 2, 12  # pairs of moves at each level, and those that are kept of the last one
SETTLING = 4  # pairs of moves at the last level before these
ACCEPTED = 0.25  # share of proposals at which the sizes of moves aim
WHOLE = 0.1  # share of the moves by a whole difference between particles
REDRAWN = 0.5  # share of the moves of the noise that draw correlations of tests again
LARGEST = 8.0  # of normal coordinates


@dataclass(frozen=True, eq=False)
class Annealed:
    """Places (m, n + 2 tests) of equal weight, their effective number, and the logarithm of the evidence."""

    places: Array
    effective: float
    log_evidence: float


@dataclass(frozen=True, eq=False)
class _Particles:
    """Particles: places (m, d), the same as normal coordinates (m, d), shapes of their curves (m, N), whether the mechanics fails
    there, logarithm of the density, and that of the density from which the linear coordinates are drawn."""

    places: Array
    u: Array
    shapes: Array
    failed: Bools
    log: Array
    log_linear: Array

    def of(self, which: Ints | slice) -> "_Particles":
        """Some of the particles."""
        return _Particles(*(getattr(self, name)[which] for name in self.__dataclass_fields__))

    def put(self, which: Ints, other: "_Particles", chosen: Bools) -> None:
        """Replace particles by the chosen ones of as many others."""
        for name in self.__dataclass_fields__:
            getattr(self, name)[which[chosen]] = getattr(other, name)[chosen]


def annealed(density: Density, seed: int, particles: int = PARTICLES) -> Annealed | None:
    """Draws of a density; None where the mechanics fails at nearly all places.

    Parameters
    ----------
    density : Density
    seed : int
    particles : int

    Returns
    -------
    Annealed or None
    """
    walk = _Walk(density, np.random.default_rng(seed))
    started = _started(walk, particles)
    if started is None:
        return None
    known, evidence, fall = *started, 0.5
    while walk.beside:
        known, gained, fall = _lower(walk, known, fall)
        evidence += gained
        for _ in range(STEPS):
            walk.move(known)
    for _ in range(SETTLING):
        walk.move(known)
    kept = []
    for _ in range(LAST):
        walk.move(known)
        kept.append(known.places.copy())
    if not np.isfinite(evidence):
        return None
    effective = min(_effective(np.array(kept)[..., : density.curves.size]), _distinct(np.concatenate(kept)))
    return Annealed(np.concatenate(kept), effective, evidence)


def _started(walk: "_Walk", particles: int) -> tuple[_Particles, float] | None:
    """Particles by the priors beside large noise, and the logarithm of the evidence there."""
    density, rng = walk.density, walk.rng
    u = rng.standard_normal((particles, density.size))
    places = ndtr(u)
    shapes, failed = density.shapes(places[:, : density.curves.size])
    for walk.beside in BEGINNINGS:
        known = walk.completed(places, u, shapes, failed)
        weights = known.log - known.log_linear
        if not np.isfinite(weights).any():
            return None
        if _share(weights) >= KEPT * np.mean(~failed):
            break
    return known.of(_drawn(weights, rng)), float(logsumexp(weights) - np.log(particles))


def _lower(walk: "_Walk", known: _Particles, fall: float) -> tuple[_Particles, float, float]:
    """Particles at the next level, the gain of the logarithm of the evidence, and the logarithm by which the noise has fallen."""
    some, last = known.of(slice(TRIED)), walk.beside
    walk.beside, weights = 0.0, np.full(len(known.log), -np.inf)
    if _share(walk.log(some, 0.0) - some.log) >= KEPT:
        weights = walk.log(known, 0.0) - known.log
    if not _share(weights) >= 0.5 * KEPT:
        for _ in range(3):
            share = _share(walk.log(some, last * np.exp(-fall)) - some.log)
            fall *= float(np.clip(np.sqrt(np.log(KEPT) / np.log(np.clip(share, 1e-3, 0.98))), 0.3, 3.0))
        walk.beside = last * np.exp(-fall)
        weights = walk.log(known, walk.beside) - known.log
        while _share(weights) < 0.5 * KEPT:
            fall /= 2
            walk.beside = last * np.exp(-fall)
            weights = walk.log(known, walk.beside) - known.log
    lower = replace(known, log=known.log + weights).of(_drawn(weights, walk.rng))
    return walk.again(lower), float(logsumexp(weights) - np.log(len(weights))), fall


def _share(weights: Array) -> float:
    """The effective number of log weights (m,), over their number; 0 where all are -inf or one is no number."""
    most = weights.max()
    if not np.isfinite(most):
        return 0.0
    shares = np.exp(weights - most)
    return float(shares.sum() ** 2 / np.sum(shares**2) / len(shares))


def _drawn(weights: Array, rng: np.random.Generator) -> Ints:
    """Numbers of particles drawn by log weights, evenly, in random order."""
    number = len(weights)
    total = np.cumsum(np.exp(weights - logsumexp(weights)))
    picked = np.searchsorted(total, (np.arange(number) + rng.random()) / number)
    return rng.permutation(np.minimum(picked, number - 1))


def _effective(steps: Array) -> float:
    """Effective number of draws: places (steps, m, n) of m particles that move, for the coordinate that moves least."""
    number, particles = steps.shape[:2]
    apart = steps - steps.mean(axis=(0, 1))
    variance = np.maximum(np.mean(apart**2, axis=(0, 1)), 1e-300)
    sums = np.ones(steps.shape[2])
    for lag in range(1, number):
        known = np.mean(apart[lag:] * apart[:-lag], axis=(0, 1)) / variance
        sums += 2 * (1 - lag / number) * np.maximum(known, 0.0)
    return float(number * particles / sums.max())


def _distinct(places: Array) -> float:
    """Effective number of places (m, n) of which some are the same: particles that share an ancestor, or that have not moved."""
    shares = np.unique(places, axis=0, return_counts=True)[1] / len(places)
    return float(1 / np.sum(shares**2))


class _Walk:
    """Metropolis moves of particles under the noise `beside`, whose sizes follow the share of accepted proposals."""

    def __init__(self, density: Density, rng: np.random.Generator) -> None:
        self.density, self.rng, self.beside = density, rng, 0.0
        n, tests = density.curves.size, len(density.used)
        self.linear = np.array(density.linear, dtype=int)
        self.solved = np.array([k for k in range(n) if k not in density.linear], dtype=int)
        self.sigmas, self.kinds = np.arange(n, n + tests), np.arange(n + tests, n + 2 * tests)
        self.sized = np.concatenate([self.sigmas, np.arange(n + 2 * tests, density.size)])
        self.stepped = np.setdiff1d(np.arange(density.size), self.linear)  # by moves; the linear ones are drawn
        self.others = np.setdiff1d(self.stepped, self.kinds)  # kinds are drawn again, in moves of the noise alone
        self.at_mode = density.kinds_at_mode()
        self.sizes = {"solved": 1.0, "others": 1.0, "noise": 1.0}

    def log(self, known: _Particles, beside: float) -> Array:
        """Logarithm of the density of particles under a noise beside."""
        forces = self.density.moved(known.shapes, known.places[:, : self.density.curves.size])
        log = self.density.of_forces(forces, known.places, self.density.covariances(known.places, beside))
        return np.where(known.failed, -np.inf, log)

    def completed(self, places: Array, u: Array, shapes: Array, failed: Bools) -> _Particles:
        """Particles whose linear coordinates are drawn, given all others."""
        places, n = places.copy(), self.density.curves.size
        noises = self.density.covariances(places, self.beside)
        log_linear = np.zeros(len(places))
        if self.linear.size:
            centre, root = self._conditional(places, shapes, noises)
            places[:, self.linear] = _truncated(centre, root, self.rng)
            log_linear = _log_truncated(places[:, self.linear], centre, root)
        log = self.density.of_forces(self.density.moved(shapes, places[:, :n]), places, noises)
        return _Particles(places, u, shapes, failed, np.where(failed, -np.inf, log), log_linear)

    def again(self, known: _Particles) -> _Particles:
        """The same particles with the density of their linear coordinates under the present noise."""
        if not self.linear.size:
            return known
        centre, root = self._conditional(known.places, known.shapes, self.density.covariances(known.places, self.beside))
        return replace(known, log_linear=_log_truncated(known.places[:, self.linear], centre, root))

    def _conditional(self, places: Array, shapes: Array, noises: Covariances) -> tuple[Array, Array]:
        """Centre (m, k) and Cholesky factor (m, k, k) of the normal density of the linear coordinates, given all others."""
        density = self.density
        z = places[:, : density.curves.size].copy()
        z[:, self.linear] = 0.5  # the middle of the ranges of offsets, whose priors are about none
        if density.scaled is not None:  # the scale of least squares, about which offsets change the curves linearly
            z[:, density.scaled] = density.of_scale(shapes)
        centre, root = self._linearised(z, shapes, noises)
        if self.linear.size > int(density.scaled is not None):  # offsets bend the curves: the slopes are those near the centre
            z[:, self.linear] = np.clip(centre, 0, 1)
            centre, root = self._linearised(z, shapes, noises)
        return centre, root

    def _linearised(self, z: Array, shapes: Array, noises: Covariances) -> tuple[Array, Array]:
        """The same by the slopes at coordinates z (m, n)."""
        density, rows = self.density, self.density.rows
        forces, slopes = density.moved_with_slopes(shapes, z)
        products = noises.products(np.concatenate([(forces[:, rows] - density.y)[:, None], slopes[:, :, rows]], axis=1))
        P = density.P[:, self.linear]
        known = products[:, 1:, 1:] + P.T @ P + 1e-3 * np.eye(self.linear.size)
        ahead = products[:, 1:, 0] + (z @ density.P.T - density.centre) @ P
        covar = np.linalg.inv(known)
        return z[:, self.linear] - np.einsum("mij,mj->mi", covar, ahead), np.linalg.cholesky(covar)

    def move(self, known: _Particles) -> None:
        """A pair of moves of all particles: of what changes the solution, and of the noise."""
        kinds = ["solved" if self.rng.random() < 0.5 else "others"] if self.solved.size else []
        for kind in (*kinds, "noise"):
            order = self.rng.permutation(len(known.log))
            halves = np.array_split(order, 2)
            taken = [self._moved(kind, known, own, other) for own, other in (halves, halves[::-1])]
            self.sizes[kind] = float(np.clip(self.sizes[kind] * np.exp(2 * (np.mean(taken) - ACCEPTED)), 0.05, 4.0))

    def _moved(self, kind: str, known: _Particles, own: Ints, other: Ints) -> float:
        """Move some particles by what others show; the share of moves that are accepted."""
        before = known.of(own)
        u = before.u.copy()
        drawn = self._by_noise(u, known.u[other]) if kind == "noise" else self._by_differences(kind, u, known.u[other])
        places = before.places.copy()
        places[:, self.stepped] = ndtr(u[:, self.stepped])
        n = self.density.curves.size
        curves = (before.shapes, before.failed) if kind == "noise" else self.density.shapes(places[:, :n])
        there = self.completed(places, u, *curves)
        priors = 0.5 * np.sum(u[:, self.others] ** 2 - before.u[:, self.others] ** 2, axis=1)
        stepped = np.isnan(drawn)
        with np.errstate(invalid="ignore"):
            gain = (there.log - there.log_linear) - (before.log - before.log_linear) - np.where(stepped, priors, drawn)
        taken = np.log(self.rng.random(len(own))) < np.where(np.isnan(gain), -np.inf, gain)
        known.put(own, there, taken)
        return float(taken[stepped].mean()) if stepped.any() else ACCEPTED

    def _by_differences(self, kind: str, u: Array, others: Array) -> Array:
        """Move normal coordinates by differences between two of the other particles; all are steps."""
        moving = self.solved if kind == "solved" else self.others
        m, rng = len(u), self.rng
        first = rng.integers(len(others), size=m)
        second = (first + 1 + rng.integers(len(others) - 1, size=m)) % len(others)
        usual = self.sizes[kind] * 2.38 / np.sqrt(2 * moving.size) * np.exp(0.5 * rng.standard_normal(m))
        share = np.where(rng.random(m) < WHOLE, 1.0, usual)[:, None]
        u[:, moving] += share * (others[first] - others[second])[:, moving] + 1e-3 * rng.standard_normal((m, moving.size))
        np.clip(u, -LARGEST, LARGEST, out=u)
        return np.full(m, np.nan)

    def _by_noise(self, u: Array, others: Array) -> Array:
        """Move sizes of the noises of some tests, or draw correlations of some again. For the latter, the logarithm of the density
        of this draw over that of its reverse, (m,), where sizes count as places; no number for the steps of the former."""
        m, rng, sized = len(u), self.rng, self.sized
        again = rng.random(m) < REDRAWN
        wide = self.sizes["noise"] * np.exp(0.5 * rng.standard_normal((m, 1)))
        chosen = ~again[:, None] & (rng.random((m, sized.size)) < max(0.5, 1.5 / sized.size))
        u[:, sized] += chosen * wide * others[:, sized].std(axis=0) * rng.standard_normal((m, sized.size))
        np.clip(u, -LARGEST, LARGEST, out=u)
        drawn = np.full(m, np.nan)
        scatter = wide * ndtr(others[:, self.sigmas]).std(axis=0)
        drawn[again] = self._drawn_again(u, np.flatnonzero(again), scatter)
        return drawn

    def _drawn_again(self, u: Array, which: Ints, scatter: Array) -> Array:
        """Draw correlations of the noises of some tests of some particles: half of them about as probable as they are at the fit's
        mode, the others all equally probable. The size goes along as it does there, and a little beside that: noise of a small size
        and a strong correlation, or the reverse, is improbable."""
        rng, log, tests = self.rng, np.zeros(which.size), self.kinds.size
        chosen = rng.random((which.size, tests)) < 0.5
        chosen[np.arange(which.size), rng.integers(tests, size=which.size)] = True
        for n, (noise, (sizes, shares)) in enumerate(zip(self.density.noises, self.at_mode, strict=True)):
            rows, shares = which[chosen[:, n]], 0.5 * shares + 0.5 / shares.size
            before = noise.kinds(ndtr(u[rows, self.kinds[n]]))
            after = rng.choice(shares.size, rows.size, p=shares)
            low, high = noise.ends(np.arange(shares.size))
            u[rows, self.kinds[n]] = ndtri(low[after] + rng.random(rows.size) * (high - low)[after])
            size = ndtr(u[rows, self.sigmas[n]]) + sizes[after] - sizes[before] + scatter[rows, n] * rng.standard_normal(rows.size)
            u[rows, self.sigmas[n]] = ndtri(np.clip(size, 0, 1))
            dense = np.log(shares / (high - low))
            log[chosen[:, n]] += np.where((size > 0) & (size < 1), dense[after] - dense[before], np.inf)
        np.clip(u, -LARGEST, LARGEST, out=u)
        return log


def _truncated(centre: Array, root: Array, rng: np.random.Generator) -> Array:
    """Draws (m, k) of normal coordinates, one after another within 0 and 1."""
    x, steps = np.empty_like(centre), np.zeros_like(centre)
    for k, (middle, size) in enumerate(_conditionals(centre, root, steps)):
        sign, low, high = _within(middle, size)
        share = ndtr(low) + (ndtr(high) - ndtr(low)) * rng.random(len(centre))
        x[:, k] = np.clip(middle + sign * size * ndtri(np.clip(share, 1e-300, 1 - 1e-16)), 0, 1)
        steps[:, k] = (x[:, k] - middle) / size
    return x


def _log_truncated(x: Array, centre: Array, root: Array) -> Array:
    """Logarithm of the density of these draws, (m,), up to a constant of the number of coordinates."""
    steps, log = np.zeros_like(centre), np.zeros(len(centre))
    for k, (middle, size) in enumerate(_conditionals(centre, root, steps)):
        steps[:, k] = (x[:, k] - middle) / size
        _, low, high = _within(middle, size)
        within = log_ndtr(high) + np.log1p(-np.exp(np.minimum(log_ndtr(low) - log_ndtr(high), -1e-16)))
        log -= 0.5 * steps[:, k] ** 2 + np.log(size) + within + 0.5 * np.log(2 * np.pi)
    return log


def _within(middle: Array, size: Array) -> tuple[Array, Array, Array]:
    """The ends 0 and 1 in sizes from the middle, mirrored (sign -1) where the middle is low: lower tails have more digits."""
    sign = np.where(middle < 0.5, -1.0, 1.0)
    ends = (0 - middle) / size, (1 - middle) / size
    return sign, np.where(sign > 0, ends[0], -ends[1]), np.where(sign > 0, ends[1], -ends[0])


def _conditionals(centre: Array, root: Array, steps: Array) -> Iterator[tuple[Array, Array]]:
    """Middle and size of each coordinate, given the steps of those before it."""
    for k in range(centre.shape[1]):
        yield centre[:, k] + np.einsum("mi,mi->m", root[:, k, :k], steps[:, :k]), root[:, k, k]
