"""Many samples as one population: the mean and the between-sample spread of each parameter, without what noise makes of them.

The logarithm of each parameter is normal over the samples, with a mean for each group and one standard deviation (between samples)
for all groups; before the curves, means are uniform in the logarithm, and standard deviations uniform up to WIDEST. Each sample
brings the density of its own curves (on the surrogate of its fit, the noise integrated out), as weighted draws, so that noise is
not counted as variability, and no run is needed (Hogg, Myers, Bovy 2010, Astrophys J 725:2166). Errors that all samples share, such
as those of the mesh and of the rig's friction, widen the interval of the mean, and not the spread.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.special import logsumexp
from scipy.stats import multivariate_t

from indentfit.arrays import Array
from indentfit.inference.plain import Interval

WIDEST = 3.0  # largest standard deviation of a logarithm between samples
DRAWS, ROUNDS, ENOUGH = 2000, 12, 400  # of the means and spreads: draws of a round, rounds, effective draws after which they end
HEAVY = 5.0  # degrees of freedom of the tails of the draws
OF_SAMPLE = 1000  # draws of each sample's parameters
SHOWN = 200  # draws of means and spreads under which each sample is estimated again
FEWEST = 3  # samples
LEVELS = (0.025, 0.975)


@dataclass(frozen=True, eq=False)
class SampleDraws:
    """The density of one sample's curves over its parameters.

    Parameters
    ----------
    name, group : str
    logs : array (m, p)
        Draws of the parameters' logarithms.
    weights : array (m,)
        Their weights, under a density that is uniform in the logarithms.
    """

    name: str
    group: str
    logs: Array
    weights: Array

    @classmethod
    def of(cls, name: str, group: str, values: Array, shares: Array, seed: int) -> "SampleDraws":
        """The draws (m, p) of a posterior whose prior is uniform in the parameters, with their shares (m,)."""
        positive = np.all(values > 0, axis=1)
        logs = np.log(np.where(positive[:, None], values, 1.0))
        # the shares are those of a density uniform in the values, which is the value itself in its logarithm
        weights = np.where(positive, shares * np.exp(-np.sum(logs - logs[int(np.argmax(shares))], axis=1)), 0.0)
        if not weights.any():
            return cls(name, group, logs[:1], np.ones(1))
        chosen = np.random.default_rng(seed).choice(len(weights), OF_SAMPLE, p=weights / weights.sum())
        return cls(name, group, logs[chosen], np.full(OF_SAMPLE, 1 / OF_SAMPLE))


@dataclass(frozen=True)
class Known:
    """A quantity with its 95 % interval."""

    value: float
    interval: Interval


@dataclass(frozen=True)
class PopulationParameter:
    """One parameter over a population.

    Parameters
    ----------
    unit : str
    mean : dict of group -> Known, in the unit
        The mean over all samples that there could be.
    sd : Known, share of the mean
        Standard deviation between samples.
    """

    unit: str
    mean: dict[str, Known]
    sd: Known


@dataclass(frozen=True)
class Contrast:
    """The ratio of the means of two groups in one parameter, and the probability that the ratio is above 1."""

    parameter: str
    group: str
    reference: str
    ratio: Known
    above: float


@dataclass(frozen=True)
class Hierarchy:
    """The population: its parameters, the contrasts of its groups, and each sample's values given all samples (shrunken)."""

    parameters: dict[str, PopulationParameter]
    contrasts: tuple[Contrast, ...] = ()
    shrunken: dict[str, dict[str, Known]] = field(default_factory=dict)


def hierarchy(
    samples: Sequence[SampleDraws], units: Mapping[str, str], shared: Mapping[str, float], reference: str, seed: int
) -> Hierarchy:
    """The Hierarchy of samples.

    Parameters
    ----------
    samples : sequence of SampleDraws
        At least FEWEST.
    units : mapping of parameter -> unit, in the order of the draws' columns
    shared : mapping of parameter -> float
        Relative standard deviation of the parameter by errors that all samples share.
    reference : str
        The group with which the others are compared.
    seed : int

    Returns
    -------
    Hierarchy
    """
    groups = list(dict.fromkeys([reference, *(sample.group for sample in samples)]))
    model = _Model(tuple(samples), tuple(groups), len(units))
    rng = np.random.default_rng(seed)
    draws = model.posterior(rng)
    means, sds = model.split(draws)  # (m, g, p), (m, p)
    shift = rng.standard_normal((len(draws), len(units))) * np.array([shared.get(name, 0.0) for name in units])
    parameters, contrasts = {}, []
    for k, (name, unit) in enumerate(units.items()):
        natural = np.exp(means[:, :, k] + 0.5 * sds[:, k, None] ** 2 + shift[:, k, None])
        spread = np.sqrt(np.expm1(sds[:, k] ** 2))
        parameters[name] = PopulationParameter(
            unit, {group: _known(natural[:, g]) for g, group in enumerate(groups)}, _known(spread)
        )
        for g, group in enumerate(groups[1:], start=1):
            ratio = np.exp(means[:, g, k] - means[:, 0, k])
            contrasts.append(Contrast(name, group, reference, _known(ratio), float(np.mean(ratio > 1))))
    return Hierarchy(parameters, tuple(contrasts), model.shrunken(draws[:SHOWN], list(units)))


def _known(draws: Array) -> Known:
    low, middle, high = np.quantile(draws, (LEVELS[0], 0.5, LEVELS[1])).tolist()
    return Known(middle, (low, high))


@dataclass(frozen=True, eq=False)
class _Model:
    """Means of the groups and logarithms of the spreads as coordinates: (g * p means, p logarithms)."""

    samples: tuple[SampleDraws, ...]
    groups: tuple[str, ...]
    p: int

    def split(self, places: Array) -> tuple[Array, Array]:
        """Means (m, g, p) of the logarithms, and standard deviations (m, p)."""
        cut = len(self.groups) * self.p
        return places[:, :cut].reshape(len(places), len(self.groups), self.p), np.exp(places[:, cut:])

    def log_density(self, places: Array) -> Array:
        """Logarithm of the density at places, (m,)."""
        means, sds = self.split(places)
        total = np.log(sds).sum(axis=1)  # uniform in the standard deviation, whose logarithm is the coordinate
        for sample in self.samples:
            total = total + logsumexp(self._terms(sample, means, sds), axis=0)
        return np.where(np.all(sds < WIDEST, axis=1), total, -np.inf)

    def _terms(self, sample: SampleDraws, means: Array, sds: Array) -> Array:
        """Logarithms of weight times normal density of each draw of a sample, (draws, m)."""
        mean = means[:, self.groups.index(sample.group)]
        x = sample.logs
        squares = (x**2) @ (1 / sds**2).T - 2 * x @ (mean / sds**2).T + np.sum((mean / sds) ** 2, axis=1)
        return np.asarray(np.log(sample.weights)[:, None] - 0.5 * squares - np.log(sds).sum(axis=1))

    def posterior(self, rng: np.random.Generator) -> Array:
        """Draws of the coordinates from their posterior, (DRAWS, n), by adaptive importance sampling."""
        centre, covar = self._start()
        effective, kept = 0.0, np.tile(centre, (DRAWS, 1))
        wider = 2.0
        for _ in range(ROUNDS):
            kind = multivariate_t(centre, wider * covar * (HEAVY - 2) / HEAVY, df=HEAVY)
            places = np.reshape(kind.rvs(DRAWS, random_state=rng), (DRAWS, centre.size))
            weights = self.log_density(places) - np.reshape(kind.logpdf(places), -1)
            shares = np.exp(weights - logsumexp(weights))
            number = float(1 / np.sum(shares**2))
            if number > effective:
                effective, kept = number, places[rng.choice(DRAWS, DRAWS, p=shares)]
            if effective >= ENOUGH:
                break
            soft = np.exp(0.5 * (weights - weights.max())) if number < 0.05 * DRAWS else shares
            soft = soft / soft.sum()
            centre = soft @ places
            apart = places - centre
            covar = (apart * soft[:, None]).T @ apart + 1e-8 * np.eye(centre.size)
            wider = 1.3
        return kept

    def _start(self) -> tuple[Array, Array]:
        """The moments of the samples' own means, as a first guess."""
        own = np.array([np.average(sample.logs, axis=0, weights=sample.weights) for sample in self.samples])
        inner = np.array([np.average((s.logs - m) ** 2, axis=0, weights=s.weights) for s, m in zip(self.samples, own, strict=True)])
        member = np.array([[sample.group == group for group in self.groups] for sample in self.samples], dtype=float)
        counts = np.maximum(member.sum(axis=0), 1.0)
        means = (member.T @ own) / counts[:, None]
        left = own - member @ means
        variance = np.sum(left**2, axis=0) / max(len(own) - len(self.groups), 1)
        between = np.maximum(variance - np.median(inner, axis=0), 0.1 * variance + 1e-6)
        centre = np.concatenate([means.ravel(), 0.5 * np.log(between)])
        of_means = (variance[None] / counts[:, None] + 1e-8).ravel()
        of_spreads = 0.5 / max(len(own) - len(self.groups), 1) * (variance / between) ** 2
        return centre, np.diag(np.concatenate([of_means, np.minimum(of_spreads, 1.0)]))

    def shrunken(self, places: Array, names: Sequence[str]) -> dict[str, dict[str, Known]]:
        """Each sample's parameters given all samples."""
        means, sds = self.split(places)
        known = {}
        for sample in self.samples:
            terms = self._terms(sample, means, sds)
            weights = np.exp(terms - logsumexp(terms, axis=0)).mean(axis=1)
            known[sample.name] = {name: _weighted(sample.logs[:, k], weights) for k, name in enumerate(names)}
        return known


def _weighted(logs: Array, weights: Array) -> Known:
    order = np.argsort(logs)
    shares = np.cumsum(weights[order]) / weights.sum()
    low, middle, high = np.exp(np.interp((LEVELS[0], 0.5, LEVELS[1]), shares, logs[order])).tolist()
    return Known(middle, (low, high))


def pooled_sd(values: Array, groups: Sequence[str]) -> float | None:
    """The plain standard deviation of single fits over the mean, pooled over groups; None for too few samples."""
    kinds = list(dict.fromkeys(groups))
    if len(values) <= len(kinds):
        return None
    labels = np.array(groups)
    squares = sum(float(np.sum((values[labels == kind] / values[labels == kind].mean() - 1) ** 2)) for kind in kinds)
    return math.sqrt(squares / (len(values) - len(kinds)))
