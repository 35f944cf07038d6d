"""Many samples as one population: the mean and the between-sample spread of each parameter, without what noise makes of them.

The logarithm of each parameter is normal over the samples, with a mean for each group and one standard deviation (between samples)
for all groups. Before the curves, each of these means is normal about the mean of all samples' own logarithms with the standard
deviation WIDEST, which keeps them finite where curves do not tell a parameter from 0; and standard deviations are half normal with
the scale USUAL: samples seldom differ more than by a factor of seven to either side. Each sample brings the density of its own
curves (on the surrogate of its fit, the noise integrated out), as weighted draws, so that noise is not counted as variability, and
no run is needed (Hogg, Myers, Bovy 2010, Astrophys J 725:2166). Errors that all samples share, such as those of the mesh and of the
rig's friction, widen the intervals of the mean and of each sample, and not the spread.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.special import logsumexp
from scipy.stats import multivariate_t

from indentfit.arrays import Array
from indentfit.inference.log_sum import log_sum
from indentfit.inference.plain import Interval

USUAL, WIDEST = 1.0, 3.0  # standard deviation of a logarithm between samples: scale of its prior, and largest
DRAWS, ROUNDS, ENOUGH = 2000, 12, 400  # of the means and spreads: draws of a round, rounds, effective draws after which they end
LAST = 150_000  # draws times samples of one further round, in which few samples with their long tails get more draws
FEW = 100  # effective draws below which intervals are rough
HEAVY = 5.0  # degrees of freedom of the tails of the draws
OF_SAMPLE = 1000  # draws of each sample's parameters
SHOWN = 200  # draws of means and spreads under which each sample is estimated again
AGAIN = 2  # times that each sample's density is drawn again where the population is
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
        shares = np.where(np.all(values > 0, axis=1), shares, 0.0)
        if not shares.any():
            return cls(name, group, np.zeros((1, values.shape[1])), np.ones(1))
        chosen = np.random.default_rng(seed).choice(len(shares), OF_SAMPLE, p=shares / shares.sum())
        logs = np.log(values[chosen])
        # the draws are those of a density uniform in the values, which is the value itself in its logarithm
        sums = -logs.sum(axis=1)
        return cls(name, group, logs, np.exp(sums - logsumexp(sums)))


@dataclass(frozen=True, eq=False)
class Predicted:
    """The population as it is predicted for one group: a mixture of normal densities of the logarithms, all equally probable.

    Parameters
    ----------
    means, sds : arrays (k, p)
    """

    means: Array
    sds: Array

    def draws(self, number: int, rng: np.random.Generator) -> Array:
        """Draws (number, p)."""
        n = rng.integers(len(self.means), size=number)
        return np.asarray(self.means[n] + self.sds[n] * rng.standard_normal((number, self.means.shape[1])))

    def log_density(self, logs: Array) -> Array:
        """Logarithm of the density at logarithms (m, p), (m,)."""
        precisions = 1 / self.sds**2
        squares = logs**2 @ precisions.T - 2 * logs @ (self.means * precisions).T + np.sum(self.means**2 * precisions, axis=1)
        volumes = np.log(self.sds).sum(axis=1) + 0.5 * logs.shape[1] * np.log(2 * np.pi)
        return log_sum(-0.5 * squares - volumes, axis=1) - np.log(len(self.means))


Again = Callable[[Mapping[str, Predicted]], Sequence[SampleDraws]]


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
    """The population: its parameters, the contrasts of its groups, each sample's values given all samples (shrunken), and the
    effective number of draws from which these come."""

    parameters: dict[str, PopulationParameter]
    contrasts: tuple[Contrast, ...] = ()
    shrunken: dict[str, dict[str, Known]] = field(default_factory=dict)
    effective: float = float(ENOUGH)

    @property
    def rough(self) -> bool:
        """Whether the draws are too few for good intervals."""
        return self.effective < FEW


def hierarchy(
    samples: Sequence[SampleDraws],
    units: Mapping[str, str],
    shared: Mapping[str, float],
    reference: str,
    seed: int,
    again: Again | None = None,
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
    again : function or None
        From the predicted population of each group to draws of the same samples that follow it.

    Returns
    -------
    Hierarchy
    """
    groups = list(dict.fromkeys([reference, *(sample.group for sample in samples)]))
    model = _Model(tuple(samples), tuple(groups), _Frame.of(samples, groups))
    rng = np.random.default_rng(seed)
    draws, effective = model.posterior(rng)
    if again is not None:
        for _ in range(AGAIN):
            model = replace(model, samples=tuple(again(model.predicted(draws[:SHOWN]))))
            draws, effective = model.posterior(rng, draws)
    means, sds = model.split(draws)  # (m, g, p), (m, p)
    common = np.array([shared.get(name, 0.0) for name in units])
    shift = rng.standard_normal((len(draws), len(units))) * common
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
    return Hierarchy(parameters, tuple(contrasts), model.shrunken(draws[:SHOWN], list(units), common, rng), effective)


def _known(draws: Array) -> Known:
    low, middle, high = np.quantile(draws, (LEVELS[0], 0.5, LEVELS[1])).tolist()
    return Known(middle, (low, high))


@dataclass(frozen=True, eq=False)
class _Frame:
    """What each sample's own draws say: the prior's centre, and coordinates in which the means hardly depend on the spreads. (The
    uncertainty of a mean grows with the spread, so that normal draws of both together would miss large spreads.)

    Parameters
    ----------
    centre : array (p,)
        Mean of the samples' own logarithms.
    bases : array (g, p)
        The same of each group; the centre for a group without samples.
    counts : array (g,)
    noise : array (p,)
        Median variance of a sample's own logarithms.
    between : array (p,)
        First guess of the variance between samples.
    """

    centre: Array
    bases: Array
    counts: Array
    noise: Array
    between: Array

    @classmethod
    def of(cls, samples: Sequence[SampleDraws], groups: Sequence[str]) -> "_Frame":
        own, inner = map(np.array, zip(*(_moments(sample) for sample in samples), strict=True))
        member = np.array([[sample.group == group for group in groups] for sample in samples], dtype=float)
        counts, centre = member.sum(axis=0), own.mean(axis=0)
        bases = np.where(counts[:, None] > 0, (member.T @ own) / np.maximum(counts, 1.0)[:, None], centre)
        variance = np.sum((own - member @ bases) ** 2, axis=0) / max(len(own) - len(groups), 1)
        noise = np.median(inner, axis=0)
        return cls(centre, bases, counts, noise, np.maximum(variance - noise, 0.1 * variance + 1e-6))

    def scales(self, sds: Array) -> Array:
        """Standard deviations (m, g, p) of the groups' means given those between samples (m, p)."""
        return 1 / np.sqrt(self.counts[:, None] / (sds**2 + self.noise)[:, None, :] + 1 / WIDEST**2)


def _moments(sample: SampleDraws) -> tuple[Array, Array]:
    """Mean and variance (p,) of a sample's logarithms by its own curves, uniform in the parameters, as its single fit has them."""
    shares = np.log(sample.weights) + sample.logs.sum(axis=1)
    shares = np.exp(shares - logsumexp(shares))
    mean = shares @ sample.logs
    return mean, shares @ (sample.logs - mean) ** 2


@dataclass(frozen=True, eq=False)
class _Model:
    """Means of the groups, as the frame scales them, and logarithms of the spreads as coordinates: (g * p means, p logarithms)."""

    samples: tuple[SampleDraws, ...]
    groups: tuple[str, ...]
    frame: _Frame

    def split(self, places: Array) -> tuple[Array, Array]:
        """Means (m, g, p) of the logarithms, and standard deviations (m, p)."""
        bases = self.frame.bases
        sds = np.exp(places[:, bases.size :])
        return bases + places[:, : bases.size].reshape(-1, *bases.shape) * self.frame.scales(sds), sds

    def log_density(self, places: Array) -> Array:
        """Logarithm of the density at places, (m,)."""
        return np.concatenate([self._log_density(places[n : n + DRAWS]) for n in range(0, len(places), DRAWS)])

    def _log_density(self, places: Array) -> Array:
        means, sds = self.split(places)
        total = np.sum(np.log(sds) - 0.5 * (sds / USUAL) ** 2, axis=1)  # the logarithm of sds is the coordinate
        total += np.sum(np.log(self.frame.scales(sds)) - 0.5 * ((means - self.frame.centre) / WIDEST) ** 2, axis=(1, 2))
        for sample in self.samples:
            total = total + log_sum(self._terms(sample, means, sds), axis=0)
        return np.where(np.all(sds < WIDEST, axis=1), total, -np.inf)

    def _terms(self, sample: SampleDraws, means: Array, sds: Array) -> Array:
        """Logarithms of weight times normal density of each draw of a sample, (draws, m)."""
        mean, x = means[:, self.groups.index(sample.group)], sample.logs
        terms = np.column_stack([x**2, x]) @ np.vstack([-0.5 / sds.T**2, mean.T / sds.T**2])
        terms += np.log(sample.weights)[:, None]
        terms -= 0.5 * np.sum((mean / sds) ** 2, axis=1) + np.log(sds).sum(axis=1)
        return terms

    def posterior(self, rng: np.random.Generator, before: Array | None = None) -> tuple[Array, float]:
        """Draws of the coordinates from their posterior, (m, n), by adaptive importance sampling that begins where the draws of a
        similar posterior are; and their effective number."""
        centre, covar = self._start() if before is None else (before.mean(axis=0), np.atleast_2d(np.cov(before.T)))
        effective, kept, size = 0.0, np.tile(centre, (DRAWS, 1)), DRAWS
        wider = 2.0
        for _ in range(ROUNDS):
            kind = multivariate_t(centre, wider * covar * (HEAVY - 2) / HEAVY, df=HEAVY)
            places = np.reshape(kind.rvs(size, random_state=rng), (size, centre.size))
            weights = self.log_density(places) - np.reshape(kind.logpdf(places), -1)
            shares = np.exp(weights - logsumexp(weights))
            number = float(1 / np.sum(shares**2))
            if number > effective:
                effective, kept = number, places[rng.choice(size, size, p=shares)]
            if size > DRAWS:
                break
            if effective >= ENOUGH:
                size = LAST // len(self.samples)
                if size <= DRAWS:
                    break
            soft = np.exp(0.5 * (weights - weights.max())) if number < 0.05 * DRAWS else shares
            soft = soft / soft.sum()
            centre = soft @ places
            apart = places - centre
            covar = (apart * soft[:, None]).T @ apart + 1e-8 * np.eye(centre.size)
            wider = 1.3
        return kept, effective

    def _start(self) -> tuple[Array, Array]:
        """The frame's moments, as a first guess."""
        frame = self.frame
        freedom = max(len(self.samples) - len(self.groups), 1)
        of_spreads = 0.5 / freedom * ((frame.between + frame.noise) / frame.between) ** 2
        centre = np.concatenate([np.zeros(frame.bases.size), 0.5 * np.log(frame.between)])
        return centre, np.diag(np.concatenate([np.ones(frame.bases.size), np.minimum(of_spreads, 1.0)]))

    def predicted(self, places: Array) -> dict[str, Predicted]:
        """The population of each group, as places of the posterior predict it."""
        means, sds = self.split(places)
        return {group: Predicted(means[:, g], sds) for g, group in enumerate(self.groups)}

    def shrunken(self, places: Array, names: Sequence[str], common: Array, rng: np.random.Generator) -> dict[str, dict[str, Known]]:
        """Each sample's parameters given all samples, with the relative errors (p,) that all samples share."""
        means, sds = self.split(places)
        known = {}
        for sample in self.samples:
            terms = self._terms(sample, means, sds)
            weights = np.exp(terms - log_sum(terms.copy(), axis=0)).mean(axis=1)
            chosen = rng.choice(len(weights), DRAWS, p=weights / weights.sum())
            logs = sample.logs[chosen] + common * rng.standard_normal((DRAWS, len(names)))
            known[sample.name] = {name: _known(np.exp(logs[:, k])) for k, name in enumerate(names)}
        return known


def pooled_sd(values: Array, groups: Sequence[str]) -> float | None:
    """The plain standard deviation of single fits over the mean, pooled over groups; None for too few samples."""
    kinds = list(dict.fromkeys(groups))
    if len(values) <= len(kinds):
        return None
    labels = np.array(groups)
    squares = sum(float(np.sum((values[labels == kind] / values[labels == kind].mean() - 1) ** 2)) for kind in kinds)
    return math.sqrt(squares / (len(values) - len(kinds)))
