"""Tests against each other in a fit whose uncertain inputs are coordinates; `consistency` explains the statistic.

A test is predicted from the other tests and the priors of the inputs. Its own contact offset and gain keep their priors: these
are errors of the test itself. Errors by the mesh and the surrogate are in the covariance of the curves.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import f as fisher

from indentfit.arrays import Array
from indentfit.inference.agreement import TestPrediction
from indentfit.inference.consistency import DRAWS, ENOUGH, SEEN, UNCLEAR
from indentfit.inference.joint import JointFit, bounded
from indentfit.inference.many_places import ManyPlaces, chi2_at, least_chi2
from indentfit.inference.posterior import Climber, NoiseModel
from indentfit.inference.reconciled import reconciled

CLEAR = 1e-6  # probability by linear theory below which no draw is needed
PROPOSED = 1000  # places from which those of the draws are chosen


def joint_predictions(fit: JointFit, alone: Sequence[JointFit | None], seed: int) -> dict[str, TestPrediction]:
    """Each test predicted from the others.

    Parameters
    ----------
    fit : JointFit
        To all tests.
    alone : for each test the JointFit to it alone, None where the test has no weight
    seed : int

    Returns
    -------
    dict of test -> TestPrediction
        Empty where fewer than two tests have a weight.
    """
    tests = fit.posterior.curves.problem.tests
    heavy, starts = _heavy(alone), _starts(fit, alone)
    if len(heavy) < 2:
        return {}
    own = _under_noise_alone(fit, alone)
    return {tests[n].name: _Prediction.of(own, n, heavy, starts).result(seed) for n in heavy}


def joint_agreement(
    fit: JointFit, alone: Sequence[JointFit | None], predicted: Mapping[str, TestPrediction], pressed: Sequence[bool]
) -> str:
    """What would make tests agree that contradict each other, in a sentence (`reconciled`); empty where none do.

    Parameters
    ----------
    fit, alone
        As of `joint_predictions`.
    predicted : dict of test -> TestPrediction
    pressed : for each test whether it is an indentation
    """
    curves, heavy, starts = fit.posterior.curves, _heavy(alone), _starts(fit, alone)
    tests = curves.problem.tests
    wrong = [n for n in heavy if predicted[tests[n].name].contradicts] if predicted else []
    if not wrong:
        return ""
    own = _under_noise_alone(fit, alone)
    known = {known.test for known in curves.inputs if known.name == "offset"}  # these contact points move already
    each = sum(_best(_Prediction.of(own, n, heavy, starts).alone, starts)[1] for n in heavy)

    def least(measured: list[Array]) -> float:
        there = replace(curves, problem=curves.problem.measured(measured))
        return _best(Climber(replace(own.posterior, curves=there)), starts)[1]

    return reconciled(tests, wrong, [press and n not in known for n, press in enumerate(pressed)], least, each)


def _heavy(alone: Sequence[JointFit | None]) -> list[int]:
    return [n for n, single in enumerate(alone) if single is not None]


def _starts(fit: JointFit, alone: Sequence[JointFit | None]) -> list[Array]:
    return [fit.mode.z, *(mode.z for mode in fit.others[:2]), *(single.mode.z for single in alone if single is not None)]


def _under_noise_alone(fit: JointFit, alone: Sequence[JointFit | None]) -> JointFit:
    """The fit under the noise that the fits to each test leave."""
    freedom = sum(single.freedom for single in alone if single is not None)  # of what tells the size of the noise
    return replace(fit, posterior=replace(fit.posterior, noise=_noise_alone(fit, alone)), freedom=freedom)


def _noise_alone(fit: JointFit, alone: Sequence[JointFit | None]) -> NoiseModel:
    """The noise of each test that the fit to it alone leaves: residuals of the fit to all are large where tests contradict each
    other."""
    noise, slices = fit.posterior.noise, fit.posterior.curves.slices
    sigma, rho, explained, smooth = noise.sigma.copy(), noise.rho.copy(), [*noise.explained], np.zeros_like(noise.model)
    for n, single in enumerate(alone):
        if single is None:
            continue
        known, rows = single.posterior.noise, (slices[n], slices[n])
        sigma[n], rho[n], explained[n] = known.sigma[n], known.rho[n], known.explained[n]
        smooth[rows] = 0.0 if known.smooth is None else known.smooth[rows]
    return replace(noise, sigma=sigma, rho=rho, explained=tuple(explained), smooth=smooth)


@dataclass(frozen=True, eq=False)
class _Prediction:
    """Test n, the others, and all together: searches for the least chi2 of each."""

    fit: JointFit
    n: int
    alone: Climber
    others: Climber
    together: Climber
    starts: tuple[Array, ...]

    @classmethod
    def of(cls, fit: JointFit, n: int, heavy: Sequence[int], starts: Sequence[Array]) -> "_Prediction":
        tests = range(len(fit.posterior.used))
        alone, others, together = (
            Climber(replace(fit.posterior, used=tuple(k in chosen for k in tests)))
            for chosen in ((n,), [k for k in heavy if k != n], heavy)
        )
        curves = fit.posterior.curves
        own = np.zeros(curves.size, dtype=bool)
        own[len(curves.free) :] = [known.test == n for known in curves.inputs]
        kept = np.any(alone.P[:, own] != 0, axis=1)
        alone.P, alone.centre = alone.P[kept], alone.centre[kept]
        others.P, others.centre = others.P[~kept], others.centre[~kept]
        return cls(fit, n, alone, others, together, tuple(starts))

    def result(self, seed: int) -> TestPrediction:
        """What the others predict, and the probability of the measured curve."""
        theirs, left = _best(self.others, self.starts)
        theirs = self._with_own_at_centres(theirs)
        statistic = self._growth([*self.starts, theirs], left)
        rows = self.fit.posterior.curves.slices[self.n]
        predicted, measured = self.fit.posterior.curves.at(theirs)[0][rows][-1], self.alone.y[-1]
        off = float(measured / predicted - 1) if predicted else 0.0
        p = self._by_fisher(statistic)
        if CLEAR < p < UNCLEAR:
            p = self._by_draws(theirs, left, statistic, np.random.default_rng(seed))
        return TestPrediction(p, off)

    def _with_own_at_centres(self, z: Array) -> Array:
        """The place with the test's own offset and gain, of which the other tests tell nothing, at the centres of their priors."""
        z, curves = z.copy(), self.fit.posterior.curves
        for k, known in enumerate(curves.inputs, start=len(curves.free)):
            if known.test == self.n:
                z[k] = known.unit_of(known.prior.value(known.prior.center))
        return z

    def _growth(self, starts: Sequence[Array], left: float) -> float:
        """The growth of chi2 by one place for all tests."""
        own, alone = _best(self.alone, starts)
        return max(_best(self.together, [*starts, own])[1] - alone - left, 0.0)

    def _by_fisher(self, statistic: float) -> float:
        """The probability of the statistic, or more, by linear theory; at least one direction is shared, since where none is there
        would be no statistic, and derivatives at one place do not show what tests share at others."""
        z = self.fit.mode.z
        ranks = [_rank(climber.residuals(z)[1]) for climber in (self.alone, self.others, self.together)]
        shared = max(ranks[0] + ranks[1] - ranks[2], 1)
        return float(fisher.sf(statistic / shared, shared, self.fit.freedom))

    def _by_draws(self, theirs: Array, left: float, statistic: float, rng: np.random.Generator) -> float:
        """The share of curves of the test, drawn from their distribution given the others, that are as far from the prediction."""
        rows = self.fit.posterior.curves.slices[self.n]
        part = slice(*(int(np.searchsorted(self.together.rows, end)) for end in (rows.start, rows.stop)))
        places, root = self._drawn(theirs, left, rng), np.linalg.inv(self.alone.W)
        noise = np.array([root @ rng.standard_normal(root.shape[0]) for _ in places])
        drawn = ManyPlaces(self.fit.posterior.curves).forces(places)[:, rows] + noise
        measured = np.tile(self.together.y, (len(places), 1))
        measured[:, part] = drawn
        # a search that ends early makes the growth larger, and a contradiction less likely
        together = least_chi2(self.together, np.tile(theirs, (len(places), 1)), measured)
        far = np.flatnonzero(together - least_chi2(self.alone, places, drawn) - left >= statistic)
        if len(far) < ENOUGH:
            return (1 + len(far)) / (1 + DRAWS)
        return ENOUGH / float(1 + far[ENOUGH - 1])

    def _drawn(self, theirs: Array, left: float, rng: np.random.Generator) -> Array:
        """DRAWS places from their distribution given the other tests, by importance from a Gaussian about the best one; the test's
        own offset and gain are drawn from their priors."""
        covar = bounded(self.others.covar(theirs), theirs) + 1e-6 * np.eye(theirs.size)
        steps = rng.standard_normal((PROPOSED, theirs.size))
        steps[0] = 0
        proposed = theirs + steps @ np.linalg.cholesky(covar).T
        curves = self.fit.posterior.curves
        for k, known in enumerate(curves.inputs, start=len(curves.free)):
            if known.test == self.n and known.prior.spread is not None:
                low, high = known.ends
                proposed[:, k] = (known.prior.center + known.prior.spread * steps[:, k] - low) / (high - low)
        within = np.all((proposed >= 0) & (proposed <= 1), axis=1)
        within[0] = True
        proposed, steps = np.clip(proposed[within], 0, 1), steps[within]
        own = np.array([False] * len(curves.free) + [known.test == self.n for known in curves.inputs])
        growth = np.maximum(chi2_at(self.others, proposed) - left, 0.0)
        weights = -growth / 2 + 0.5 * np.sum(steps[:, ~own] ** 2, axis=1)
        weights = np.exp(weights - weights.max())
        return proposed[rng.choice(len(proposed), DRAWS, p=weights / weights.sum())]


def _best(climber: Climber, starts: Sequence[Array]) -> tuple[Array, float]:
    """The place of least chi2 from several starts, and its chi2."""
    return min((climber.climb(z) for z in starts), key=_chi2)


def _chi2(end: tuple[Array, float]) -> float:
    return end[1]


def _rank(rows: Array) -> int:
    """The number of directions that whitened derivatives see within the ranges."""
    return int(np.sum(np.linalg.svd(rows, compute_uv=False) > SEEN))
