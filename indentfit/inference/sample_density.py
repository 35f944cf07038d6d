"""The density of one sample's curves over its parameters, as weighted draws: noise and the sample's own inputs are integrated out.

A population that is narrow beside a sample's own interval meets few draws of the sample's density, and the chance by which it does
so would count as knowledge. So a population is estimated three times: from draws of each sample's own density first, and then twice
from draws half of which are of the population that the estimate before predicts (Hesterberg 1995, Technometrics 37:185).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp
from scipy.stats import multivariate_t

from indentfit.arrays import Array
from indentfit.inference.evidence import Density, Evidence, evidence
from indentfit.inference.law_curves import LawCurves
from indentfit.inference.population import Predicted, SampleDraws
from indentfit.inference.residual_noise import UnknownNoise

HALF = 500  # draws of the sample's own density, and of the population, for each alternative
HEAVY = 5.0  # degrees of freedom of the tails of the draws
WIDER = 1.5  # of the covariance of the draws, over that of the density


@dataclass(frozen=True, eq=False)
class SampleDensity:
    """The density of one sample's curves under each alternative of its case.

    Parameters
    ----------
    name, group : str
    alternatives : sequence of (prior probability, Density, Evidence)
    seed : int
    """

    name: str
    group: str
    alternatives: Sequence[tuple[float, Density, Evidence]]
    seed: int

    @classmethod
    def of(cls, name: str, group: str, known: Sequence[tuple[float, LawCurves, UnknownNoise]], seed: int) -> "SampleDensity":
        """The density under alternatives, each with its prior probability, curves and noise."""
        each = [(prior, Density(curves, noise), evidence(curves, noise, seed)) for prior, curves, noise in known]
        return cls(name, group, each, seed)

    def draws(self) -> SampleDraws:
        """Draws by the sample's own curves."""
        logs = np.array([np.log(prior) + known.log for prior, _, known in self.alternatives])
        odds = np.exp(logs - logsumexp(logs))
        values = np.concatenate([density.curves.values(known.places) for _, density, known in self.alternatives])
        shares = np.concatenate([share * known.shares for share, (_, _, known) in zip(odds, self.alternatives, strict=True)])
        return SampleDraws.of(self.name, self.group, values, shares, self.seed)

    def under(self, predicted: Predicted) -> SampleDraws:
        """Draws half of which are of a population."""
        rng = np.random.default_rng(self.seed)
        drawn = [_drawn(density, known, predicted, rng) for _, density, known in self.alternatives]
        weights = np.concatenate([np.log(prior) + log for (prior, *_), (_, log) in zip(self.alternatives, drawn, strict=True)])
        if not np.isfinite(weights).any():
            return self.draws()
        whole = np.isfinite(weights)
        shares = np.exp(weights[whole] - logsumexp(weights[whole]))
        return SampleDraws(self.name, self.group, np.concatenate([logs for logs, _ in drawn])[whole], shares)


def _drawn(density: Density, known: Evidence, predicted: Predicted, rng: np.random.Generator) -> tuple[Array, Array]:
    """Draws of the logarithms of the parameters (m, p) under one alternative, and the logs of their weights (m,).

    The coordinates are the logarithms and, after them, the places of uncertain inputs. Inputs of draws of the population are normal
    about what the sample's own density says of them at these parameters.
    """
    curves = density.curves
    low = curves.values(np.zeros((1, curves.size)))[0]
    ranges, p = curves.values(np.ones((1, curves.size)))[0] - low, len(low)
    mean, covar = _moments(curves, known)
    own = np.atleast_2d(multivariate_t(mean, WIDER * covar * (HEAVY - 2) / HEAVY, df=HEAVY).rvs(HALF, random_state=rng))
    logs = predicted.draws(HALF, rng)
    x = np.vstack([own.reshape(HALF, mean.size), np.column_stack([logs, np.zeros((HALF, mean.size - p))])])
    inputs = _Conditional.of(mean, WIDER * covar, p)
    x[HALF:, p:] = inputs.at(logs) + rng.standard_normal((HALF, mean.size - p)) @ inputs.root.T
    of_own = np.reshape(multivariate_t(mean, WIDER * covar * (HEAVY - 2) / HEAVY, df=HEAVY).logpdf(x), -1)
    of_predicted = predicted.log_density(x[:, :p]) + inputs.log_density(x)
    places = np.column_stack([(np.exp(np.minimum(x[:, :p], 700.0)) - low) / ranges, x[:, p:]])
    return x[:, :p], density.log(places) - np.logaddexp(of_own, of_predicted)


def _moments(curves: LawCurves, known: Evidence) -> tuple[Array, Array]:
    """Mean (n,) and covariance (n, n) of the density of logarithms and inputs."""
    values = curves.values(known.places)
    used = np.all(values > 0, axis=1) & (known.shares > 0)
    p = values.shape[1]
    x = np.column_stack([np.log(values[used]), known.places[used, p:]])
    shares = known.shares[used] / known.shares[used].sum()
    mean = shares @ x
    apart = x - mean
    return mean, (apart * shares[:, None]).T @ apart + np.diag(np.full(mean.size, 1e-8))


@dataclass(frozen=True, eq=False)
class _Conditional:
    """The normal density of inputs (n - p,) given logarithms (p,)."""

    centre: Array
    p: int
    slope: Array
    root: Array

    @classmethod
    def of(cls, mean: Array, covar: Array, p: int) -> "_Conditional":
        slope = np.asarray(np.linalg.solve(covar[:p, :p], covar[:p, p:]).T, dtype=float)
        left = covar[p:, p:] - slope @ covar[:p, p:]
        return cls(mean, p, slope, np.asarray(np.linalg.cholesky(left + 1e-10 * np.eye(len(left))), dtype=float))

    def at(self, logs: Array) -> Array:
        """The mean of the inputs at logarithms (m, p)."""
        return np.asarray(self.centre[self.p :] + (logs - self.centre[: self.p]) @ self.slope.T)

    def log_density(self, x: Array) -> Array:
        """Logarithm of the density of the inputs in x (m, n), (m,)."""
        left = np.linalg.solve(self.root, (x[:, self.p :] - self.at(x[:, : self.p])).T)
        volume = np.log(np.diag(self.root)).sum() + 0.5 * left.shape[0] * np.log(2 * np.pi)
        return np.asarray(-0.5 * np.sum(left**2, axis=0) - volume)
