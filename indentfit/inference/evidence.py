"""The evidence of a law: the density of the measured curves under it, with parameters uniform over their ranges.

Laplace's method finds the places of largest density on the surrogate and the Gaussians about them; draws from these Gaussians (and
some from all over the ranges) then correct the integral by importance sampling, since the Gaussians neither end at the bounds nor
bend. The noise is integrated out (`residual_noise`).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import least_squares
from scipy.special import logsumexp
from scipy.stats import multivariate_t, qmc

from indentfit.arrays import Array, Ints
from indentfit.inference.law_curves import LawCurves
from indentfit.inference.residual_noise import UnknownNoise

STARTS, APART = 6, 0.1  # number of climbs from the best places of a scan; least distance of these places, in units of the ranges
ROUNDS = 3  # of climbs, each under the noise that the last one has left
STEP = 1e-4  # of the ranges, for derivatives of the curves
WIDEST = 12.0  # precision of a uniform density over a range of 1
DRAWS, ROUNDS_OF_DRAWS = 3000, 8  # of each round of importance sampling, whose Gaussian follows the draws before; rounds at most
ENOUGH = 500  # effective number of draws, after which drawing ends
STILL_ENOUGH = 100  # effective number of draws that tell the evidence under another noise too
HEAVY = 5.0  # degrees of freedom of the tails of the draws
EVERYWHERE = 0.1  # share of draws from all over the ranges
WORTH = 12.0  # a mode whose log density is this far below the best is left out


@dataclass(frozen=True, eq=False)
class Evidence:
    """The evidence of a law under one alternative.

    Parameters
    ----------
    log : float
        Logarithm of the density of the measured curves.
    laplace : float
        The same by Laplace's method alone.
    effective : float
        Effective number of draws.
    best : array (size,)
        The place of largest density that was found.
    places, shares : arrays (m, size), (m,)
        Draws of the posterior and their shares of it.
    """

    log: float
    laplace: float
    effective: float
    best: Array
    places: Array
    shares: Array

    def quantiles(self, values: Array, shares: Sequence[float]) -> Array:
        """Quantiles of values (m,) over the posterior."""
        order = np.argsort(values)
        return np.asarray(np.interp(shares, np.cumsum(self.shares[order]), values[order]))


@dataclass(frozen=True, eq=False)
class Peak:
    """A place of large density, with its log density and the covariance of the Gaussian about it."""

    z: Array
    log: float
    covar: Array


@dataclass(frozen=True, eq=False)
class Density:
    """Prior times likelihood of the places of one law."""

    curves: LawCurves
    noise: UnknownNoise

    def log(self, places: Array) -> Array:
        """Logarithm of the density at places, (m,)."""
        values = self.curves.log_prior(places)
        inside = np.isfinite(values)
        if inside.any():
            values[inside] += self.noise.log_likelihood(self.curves.forces(places[inside]))
        return values

    def slopes(self, z: Array) -> Array:
        """Derivatives of the curves at z by the coordinates, (N, size)."""
        steps = np.where(z < 0.5, STEP, -STEP)
        moved = self.curves.forces(np.vstack([z, z + np.diag(steps)]))
        return np.asarray((moved[1:] - moved[0]).T / steps)

    def peak(self, z: Array) -> Peak:
        """The Peak at a place."""
        force, slopes = self.curves.forces(z[None])[0], self.slopes(z)
        J = whitened(slopes.T, self.noise.whiteners(force)).T
        precision = J.T @ J + np.diag(self._curvature(z)) + WIDEST * np.eye(z.size)
        return Peak(z, float(self.log(z[None])[0]), np.asarray(np.linalg.inv(precision)))

    def _curvature(self, z: Array) -> Array:
        """Curvature of the log prior along each coordinate, (size,)."""
        inner = np.clip(z, 0.01, 0.99)
        moves = 0.01 * np.eye(z.size)
        at, ahead, behind = (self.curves.log_prior(np.atleast_2d(x)) for x in (inner, inner + moves, inner - moves))
        curvature = (2 * at - ahead - behind) / 0.01**2
        return np.where(np.isfinite(curvature), np.maximum(curvature, 0.0), 0.0)


def evidence(curves: LawCurves, noise: UnknownNoise, seed: int) -> Evidence:
    """The evidence of a law under one alternative.

    Parameters
    ----------
    curves : LawCurves
    noise : UnknownNoise
    seed : int

    Returns
    -------
    Evidence
    """
    density, rng = Density(curves, noise), np.random.default_rng(seed)
    peaks = find_peaks(density, seed)
    best, laplace = peaks[0], float(logsumexp([_laplace(peak) for peak in peaks]))
    sizes = np.array([_laplace(peak) for peak in peaks])
    of_peaks = [(peak.z, peak.covar, share) for peak, share in zip(peaks, np.exp(sizes - logsumexp(sizes)).tolist(), strict=True)]
    proposal = of_peaks
    log, effective, places, shares = laplace, 0.0, best.z[None], np.ones(1)
    for number in range(ROUNDS_OF_DRAWS):
        if number > 1 and effective >= ENOUGH:
            break
        tried, weights = _drawn(density, proposal, rng)
        if not np.isfinite(weights).any():
            break
        total = float(logsumexp(weights))
        parts = np.exp(weights - total)
        if 1 / np.sum(parts**2) >= effective:
            log, effective, places, shares = total - float(np.log(len(tried))), float(1 / np.sum(parts**2)), tried, parts
        proposal = [*of_peaks, _gaussian_of(tried, parts, best.covar)]
    return Evidence(log, laplace, effective, best.z, places, shares)


def under_another_noise(known: Evidence, curves: LawCurves, before: UnknownNoise, after: UnknownNoise, seed: int) -> float:
    """Logarithm of the evidence under another noise: from the draws of an Evidence where they still tell it, else anew.

    Parameters
    ----------
    known : Evidence
        That under the noise `before`.
    curves : LawCurves
    before, after : UnknownNoise
    seed : int

    Returns
    -------
    float
    """
    drawn = known.shares > 0
    forces = curves.forces(known.places[drawn])
    logs = np.log(known.shares[drawn]) + after.log_likelihood(forces) - before.log_likelihood(forces)
    total = float(logsumexp(logs))
    effective = float(np.exp(2 * total - logsumexp(2 * logs)))
    return known.log + total if effective >= STILL_ENOUGH else evidence(curves, after, seed).log


def find_peaks(density: Density, seed: int) -> list[Peak]:
    """The Peaks of a density, best first: climbs from the best places of a scan, and from the fit's optimum."""
    curves, noise = density.curves, density.noise
    target = noise.measured
    weights = np.zeros(target.size)
    for test in noise.tests:
        weights[test.rows] = 1 / np.abs(target[test.rows]).max() ** 2 / test.rows.size
    places = qmc.Sobol(curves.size, seed=seed).random(curves.scanned)
    places = np.vstack([np.clip(curves.start(), 0, 1), curves.scaled(places, target, weights)])
    values = density.log(places)
    chosen = [places[0]]
    for n in np.argsort(-values[1:]) + 1:
        if len(chosen) <= STARTS and all(np.abs(places[n] - other).max() > APART for other in chosen):
            chosen.append(places[n])
    peaks = sorted((density.peak(climb(density, z)) for z in chosen), key=lambda peak: -peak.log)
    distinct: list[Peak] = []
    for peak in peaks:
        apart = all(np.abs(peak.z - other.z).max() > 0.02 for other in distinct)
        if apart and (not distinct or peak.log > distinct[0].log - WORTH):
            distinct.append(peak)
    return distinct


def climb(density: Density, z: Array) -> Array:
    """A place of larger density near z, within the bounds."""
    best, value = z, float(density.log(z[None])[0])
    for _ in range(ROUNDS):
        residuals = _Residuals(density, density.noise.whiteners(density.curves.forces(best[None])[0]))
        start = np.clip(best, 1e-9, 1 - 1e-9)
        tolerances = {"xtol": 1e-6, "ftol": 1e-6, "max_nfev": 30}
        end = least_squares(residuals.at, start, residuals.jacobian, bounds=(0, 1), method="dogbox", **tolerances).x
        reached = float(density.log(end[None])[0])
        if not reached > value + 1e-3:
            return end if reached > value else best
        best, value = end, reached
    return best


@dataclass(frozen=True, eq=False)
class _Residuals:
    """Whitened residuals of a density's curves, and one whose square is that of the prior."""

    density: Density
    whiteners: list[tuple[Ints, Array]]

    def at(self, x: Array) -> Array:
        return self._rows(x[None])[0]

    def jacobian(self, x: Array) -> Array:
        steps = np.where(x < 0.5, STEP, -STEP)
        rows = self._rows(np.vstack([x, x + np.diag(steps)]))
        return np.asarray(((rows[1:] - rows[0]) / steps[:, None]).T)

    def _rows(self, places: Array) -> Array:
        curves, prior = self.density.curves, self.density.curves.log_prior(places)
        cost = np.where(np.isfinite(prior), np.sqrt(2 * np.maximum(PRIOR_TOP - prior, 0.0)), FAR)
        off = whitened(curves.forces(places) - self.density.noise.measured, self.whiteners)
        return np.column_stack([off, cost])


def whitened(residuals: Array, whiteners: list[tuple[Ints, Array]]) -> Array:
    """Residuals (m, N) under whiteners of `UnknownNoise.whiteners`, (m, n)."""
    return np.concatenate([residuals[:, rows] @ W.T for rows, W in whiteners], axis=1)


PRIOR_TOP = 30.0  # above any log density of priors, so that their residual is real
FAR = 1e3  # residual where the mechanics failed


def _laplace(peak: Peak) -> float:
    return peak.log + 0.5 * (peak.z.size * float(np.log(2 * np.pi)) + float(np.linalg.slogdet(peak.covar)[1]))


Proposal = tuple[Array, Array, float]  # centre, covariance, share


def _drawn(density: Density, proposal: Sequence[Proposal], rng: np.random.Generator) -> tuple[Array, Array]:
    """Draws (m, size) of a mixture of the proposals and of places all over the ranges, with the logs of their weights."""
    shares = np.maximum([share for _, _, share in proposal], 0.02)
    shares *= (1 - EVERYWHERE) / shares.sum()
    kinds = [_StudentT.of(z, covar) for z, covar, _ in proposal]
    counts = rng.multinomial(DRAWS, [*shares, EVERYWHERE])
    size = len(proposal[0][0])
    drawn = [kind.draws(n, rng) for kind, n in zip(kinds, counts, strict=False) if n]
    places = np.vstack([*drawn, rng.random((counts[-1], size))])
    terms = [np.log(share) + kind.log_density(places) for kind, share in zip(kinds, shares, strict=True)]
    whole = np.all((places >= 0) & (places <= 1), axis=1)
    terms.append(np.where(whole, np.log(EVERYWHERE), -np.inf))
    return places, density.log(places) - logsumexp(terms, axis=0)


@dataclass(frozen=True, eq=False)
class _StudentT:
    """Student's distribution with a centre and standard deviations (size,); the other one has the correlations alone.

    In a range of millions one standard deviation may be a millionth of another, and such a covariance counts as singular.
    """

    centre: Array
    sd: Array
    standard: Any

    @classmethod
    def of(cls, centre: Array, covar: Array) -> "_StudentT":
        sd = np.sqrt(np.diag(covar))
        return cls(centre, sd, multivariate_t(np.zeros(sd.size), covar / np.outer(sd, sd) * (HEAVY - 2) / HEAVY, df=HEAVY))

    def draws(self, number: int, rng: np.random.Generator) -> Array:
        drawn = np.reshape(self.standard.rvs(number, random_state=rng), (number, self.sd.size))
        return np.asarray(self.centre + self.sd * drawn)

    def log_density(self, places: Array) -> Array:
        away = (places - self.centre) / self.sd
        return np.asarray(np.reshape(self.standard.logpdf(away), -1) - np.log(self.sd).sum())


def _gaussian_of(places: Array, shares: Array, least: Array) -> Proposal:
    """The Gaussian with the mean and covariance of weighted draws; its share is that of all peaks together."""
    mean = shares @ places
    apart = places - mean
    covar = (apart * shares[:, None]).T @ apart + 1e-3 * np.diag(np.diag(least))
    return mean, covar, 1.0
