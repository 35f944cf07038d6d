"""Samples of the density over parameters and uncertain inputs, on the surrogate of a fit, by emcee (Foreman-Mackey et al. 2013).

Size (uniform in its logarithm) and correlation of the noise of each test are coordinates too, and an unknown scale of the law's
misfit, and so are integrated out. Walkers begin at draws of the posterior (`draws`) and live in coordinates u whose normal
distribution function is the place, so that the bounds of the ranges are far away. Half of their steps are proposals from a mixture
that follows these draws, whatever the walker's place; with steps between walkers alone, a chain over unknown inputs was correlated
over 1,000 steps.
Several alternatives, such as two bases, are sampled each; a draw of the result is one of theirs, by their probabilities. This
module needs `indentfit[posterior]`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from scipy.special import ndtr

from indentfit.arrays import Array, Ints
from indentfit.case import Case
from indentfit.errors import CaseError
from indentfit.inference.bridge import normal, over_u
from indentfit.inference.density import Density
from indentfit.inference.draws import Draws, drawn
from indentfit.inference.joint import JointFit, ModelError, fitted
from indentfit.inference.plain import Interval
from indentfit.inference.posterior import Curves
from indentfit.inference.shares import PosteriorFacts
from indentfit.inference.t_mixture import Mixture, followed
from indentfit.inference.wide_fit import WideFit, mesh_error
from indentfit.inverse.exploration import Watched
from indentfit.inverse.problem import InverseProblem
from indentfit.inverse.surrogate import learn

STEPS, MOST_STEPS = 1000, 12_000  # of each walker: between two looks at the correlation of its steps, and at most
LONG = 30.0  # autocorrelation times of a chain that is long enough
BURNT = 5.0  # autocorrelation times at the beginning that are thrown away
DRAWS = 500  # of each chain that are kept, evenly spaced
WALKERS = 5  # for each coordinate
CONFIDENCE = 0.95


@dataclass(frozen=True, eq=False)
class PosteriorSamples:
    """Samples of the posterior.

    Parameters
    ----------
    names, units : tuple of str
        The free parameters, then the uncertain inputs.
    values : array (chains, draws, n)
    log_density : array (chains, draws)
    alternative : array of int (chains, draws)
        The number of each draw's alternative.
    alternatives : tuple of str
    noise : array (chains, draws, tests), mN
        Standard deviation of each test's noise.
    tests : tuple of str
    acceptance : float
    correlated : float
        Largest autocorrelation time of a coordinate, in steps of a walker.
    steps : int
        Steps of each walker.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Array
    log_density: Array
    alternative: Ints
    alternatives: tuple[str, ...]
    noise: Array
    tests: tuple[str, ...]
    acceptance: float
    correlated: float
    steps: int

    @property
    def long_enough(self) -> bool:
        """Whether the chains are long beside the correlation of their steps."""
        return self.steps >= LONG * self.correlated

    def of(self, name: str) -> Array:
        """All draws of a parameter or input, (m,)."""
        return np.asarray(self.values[..., self.names.index(name)].ravel())

    def interval(self, name: str) -> Interval:
        """The shortest interval that holds 95 % of the draws."""
        return shortest(self.of(name))


def shortest(draws: Array, share: float = CONFIDENCE) -> Interval:
    """The shortest interval that holds a share of draws (m,)."""
    ordered = np.sort(draws)
    held = int(np.ceil(share * ordered.size))
    widths = ordered[held - 1 :] - ordered[: ordered.size - held + 1]
    first = int(np.argmin(widths))
    return float(ordered[first]), float(ordered[first + held - 1])


def require_emcee() -> Any:
    """The module emcee. Raises CaseError where it is not installed."""
    try:
        import emcee
    except ImportError:
        raise CaseError("fit.posterior: emcee is not installed; pip install 'indentfit[posterior]', or leave the key out") from None
    return emcee


def samples_of(case: Case, problem: InverseProblem, model: Watched, wide: WideFit | None) -> PosteriorSamples | None:
    """Samples of the posterior of a fit.

    Parameters
    ----------
    case : Case
    problem : InverseProblem
    model : Watched
        With the runs of the fit.
    wide : WideFit or None
        None where no uncertain input is a coordinate of the fit.

    Returns
    -------
    PosteriorSamples or None
        None where no surrogate can be had, or where uncertain inputs are not coordinates.

    Raises
    ------
    CaseError
        emcee is not installed.
    """
    if wide is not None:
        known = wide.alternatives
        draws = [k.draws for k in known]
        return sampled([k.fit for k in known], [k.probability for k in known], [k.name for k in known], case.fit.seed, draws)
    if set(case.fit.uncertain.given) - {"mesh"} or not problem.searched or (surrogate := learn(problem, model.known)) is None:
        return None
    seed = case.fit.seed
    fit = fitted(problem, (), surrogate, ModelError.none(sum(test.curve.force.size for test in problem.tests)), seed)
    if case.fit.uncertain.mesh:
        mesh, _ = mesh_error(case, fit, model)
        fit = fitted(problem, (), surrogate, mesh.with_surrogate_of(fit.error), seed)
    return sampled([fit], [1.0], ["case"], seed)


def facts_of_samples(samples: PosteriorSamples, intervals: Mapping[str, Interval | None]) -> PosteriorFacts:
    """What a result says of samples, beside the intervals of the fit."""
    between = {name: samples.interval(name) for name in samples.names}
    wider = {
        name: (own[1] - own[0]) / (between[name][1] - between[name][0])
        for name, own in intervals.items()
        if own is not None and name in between
    }
    return PosteriorFacts(
        medians={name: float(np.median(samples.of(name))) for name in samples.names},
        intervals=between,
        wider=wider,
        draws=int(samples.log_density.size),
        steps=samples.steps,
        correlated=samples.correlated if np.isfinite(samples.correlated) else None,
        long_enough=samples.long_enough,
    )


def sampled(
    fits: Sequence[JointFit],
    probabilities: Sequence[float],
    names: Sequence[str],
    seed: int,
    draws: Sequence[Draws] | None = None,
) -> PosteriorSamples:
    """Samples of a mixture of joint fits.

    Parameters
    ----------
    fits : sequence of JointFit
        With the same coordinates.
    probabilities : sequence of float
    names : sequence of str
        Of the fits.
    seed : int
    draws : sequence of Draws
        At which walkers begin; by default they are made.

    Returns
    -------
    PosteriorSamples

    Raises
    ------
    CaseError
        emcee is not installed.
    """
    emcee, curves = require_emcee(), fits[0].posterior.curves
    counted = [n for n, share in enumerate(probabilities) if share > 1e-3]
    begin = [draws[n] if draws is not None else drawn(fits[n], seed + n) for n in counted]
    chains = [_chain(emcee, fits[n], known, seed + n) for n, known in zip(counted, begin, strict=True)]
    shares = np.array([probabilities[n] for n in counted])
    shape = chains[0].log_density.shape
    chosen = np.random.default_rng(seed).choice(len(counted), size=shape, p=shares / shares.sum())
    inputs = [known.name if known.test is None else f"{known.name} ({_test(curves, known.test)})" for known in curves.inputs]
    return PosteriorSamples(
        names=(*curves.free, *inputs),
        units=(*("1" for _ in curves.free), *(known.unit for known in curves.inputs)),
        values=_picked(np.array([chain.values for chain in chains]), chosen),
        log_density=_picked(np.array([chain.log_density for chain in chains])[..., None], chosen)[..., 0],
        alternative=np.array(counted)[chosen],
        alternatives=tuple(names),
        noise=_picked(np.array([chain.noise for chain in chains]), chosen),
        tests=tuple(t.name for t, used in zip(curves.problem.tests, fits[0].posterior.used, strict=True) if used),
        acceptance=float(np.mean([chain.acceptance for chain in chains])),
        correlated=max(chain.correlated for chain in chains),
        steps=min(chain.steps for chain in chains),
    )


def _test(curves: Curves, number: int) -> str:
    return list(dict.fromkeys(test.test for test in curves.problem.tests))[number]


def _picked(values: Array, chosen: Ints) -> Array:
    """Of values (alternatives, chains, draws, n), those of the chosen alternatives (chains, draws)."""
    return np.asarray(np.take_along_axis(values, chosen[None, ..., None], axis=0)[0])


@dataclass(frozen=True, eq=False)
class Chain:
    """The chains of one alternative: values (chains, draws, n) in their units, log density, noise, and how well they mixed."""

    values: Array
    log_density: Array
    noise: Array
    acceptance: float
    correlated: float
    steps: int


def _chain(emcee: Any, fit: JointFit, known: Draws, seed: int) -> Chain:
    density = Density(fit)
    starts = _starts(density, known, WALKERS * density.size, np.random.default_rng(seed))
    mixture = followed(normal(known.places), np.random.default_rng(seed))
    moves = [(emcee.moves.StretchMove(), 0.5), (emcee.moves.MHMove(_Independent(mixture)), 0.5)]
    sampler = emcee.EnsembleSampler(len(starts), density.size, partial(over_u, density), vectorize=True, moves=moves)
    state = emcee.State(starts, random_state=np.random.RandomState(seed % 2**32).get_state())
    correlated = np.inf
    while sampler.iteration < MOST_STEPS and sampler.iteration < LONG * correlated:
        state = sampler.run_mcmc(state, STEPS, skip_initial_state_check=True)
        correlated = float(np.max(sampler.get_autocorr_time(quiet=True, tol=0)))
        correlated = correlated if np.isfinite(correlated) else np.inf
    burnt = int(min(BURNT * correlated, sampler.iteration / 2)) if np.isfinite(correlated) else sampler.iteration // 2
    kept = np.linspace(burnt, sampler.iteration - 1, DRAWS).astype(int)
    u = sampler.get_chain()[kept].swapaxes(0, 1)
    places = ndtr(u)
    return Chain(
        density.values(places[..., : density.curves.size]),
        sampler.get_log_prob()[kept].T + 0.5 * np.sum(u**2, axis=2),  # of the places
        density.sigma(places),
        float(np.mean(sampler.acceptance_fraction)),
        correlated,
        sampler.iteration,
    )


@dataclass(frozen=True, eq=False)
class _Independent:
    """Proposals of emcee's that do not depend on the place of a walker, with the ratio of densities that makes them fair."""

    mixture: Mixture

    def __call__(self, u: Array, rng: np.random.RandomState) -> tuple[Array, Array]:
        new = rng.permutation(self.mixture.drawn(len(u), rng))
        return new, self.mixture.log(u) - self.mixture.log(new)


def _starts(density: Density, known: Draws, walkers: int, rng: np.random.Generator) -> Array:
    """Where walkers begin, over u: draws by their weights, a little apart, (walkers, n + 2 tests), or one column more."""
    u = normal(known.places[rng.choice(len(known.shares), walkers, p=known.shares)])
    apart = u + 1e-3 * rng.standard_normal(u.shape)  # walkers that begin at one place would not leave each other
    return np.where(np.isfinite(over_u(density, apart))[:, None], apart, u)
