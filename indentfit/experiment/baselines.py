"""Which baseline and which stretch of a record the contact point is fitted with, and what rivals of that fit leave in doubt.

The simplest baseline that the force before contact holds to is taken. A stretch up to a share of the largest force is fitted: the
longest whose contact point agrees with those of the shorter ones, so that a law that the powers do not hold to at depth does not
move contact (Lepski 1991, Theory Probab Appl 35:454, chooses a bandwidth in this way). No sample follows two powers: laws with
more stand beside them, by weights of Akaike (Burnham, Anderson 2002, Model Selection and Multimodel Inference, ch. 4).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import exp, sqrt

import numpy as np
from scipy.special import ndtr

from indentfit.arrays import Array
from indentfit.experiment.loading import filtered
from indentfit.experiment.piecewise import (
    GRID,
    POWERS,
    SEARCHED,
    Baseline,
    Piecewise,
    Stretch,
    fit_of,
    independent,
    solution,
    solved,
)

SHARES = (0.5, 0.25)  # of the largest force: the shorter stretches
AGREE = 3.0  # standard errors within which the contact points of two stretches agree
MISFIT = 40.0  # excess of squares over those of a fit to the shorter stretch alone, in squares of noise: more than five values take
FEWEST_BEYOND = 12  # samples beyond contact of a shorter stretch
SURE = {
    "law": 8.0,
    "drift": 8.0,
    "decay": 15.0,
    "waves": 30.0,
    "toe": 300.0,
}  # F ratio from which a third power, drift, decay or waves are no noise; or no toe
LEAST_WAVE = 0.004  # of the largest force: smaller waves and decays are noise
PERIODS = 40  # periods of waves that are tried
HIDDEN = 0.15  # of the samples up to half of the force, before contact: fewer may be none
SHORTEST_WAVE = 0.15  # of the travel up to half of the force, where contact is hidden
FEW_PERIODS = 10
LONGEST_WAVE = 1.4  # of the travel before contact
DECAYS = (0.05, 0.1, 0.2, 0.35, 0.6, 1.0)  # time constants that are tried, of the duration of the stretch
WORTH = {"decay": 0.9, "waves": 0.6}  # share of the squares that a baseline may leave to be fitted
SCREENED = 200  # samples with which baselines are screened
DYING = (0.35, 0.05)  # of the duration of the stretch: time constants from which that of a drift is sought that dies out
# Kinds of drifts before the record is seen: standard deviation, of the rise in contact, during the loading; and probability
HIDDEN_DRIFTS = ((0.002, 0.2), (0.01, 0.05))
LARGEST_RATIO = 200.0  # an F ratio above it is as sure
# A tip may be so sharp that the ball at its end does not show; the first power is then that of a cone from the first sample on.
SHARP = {"cone": ((2.0, 3.0), (2.0, 3.0, 4.0), (2.0, 2.5, 3.0))}
FALLS = 0.002  # share of the largest force by which that of a fit may fall on its way
TELLING = 0.15  # of the depth: the travel before contact that tells a drift
SIZES = 400  # of a drift that are tried
SURELY = 3.0  # standard errors
CERTAIN = 1.96  # standard deviations in half of a 95 % interval


@dataclass(frozen=True)
class HiddenDrift:
    """A drift that the force does not show.

    kinds: for each kind of drift its probability, and mean and standard deviation, mN, of how much it would change the force
    without contact at the end of loading. There is no drift with the probability that is left.
    fitted: that change by a drift of any size, mN, as fitted to the force, and its standard error.
    """

    kinds: tuple[tuple[float, float, float], ...]
    fitted: tuple[float, float] = (0.0, 0.0)

    def reach(self, error: float) -> float:
        """How far, mN, the force may be off at the end of loading (95 %), whatever the size of the drift.

        error: mN, standard error of that force without a drift.
        """
        change, stderr = self.fitted
        return abs(change) + CERTAIN * float(np.hypot(stderr, error))

    def beyond(self, size: float, error: float) -> float:
        """Probability that drift and a normal error with a standard deviation, mN, together exceed a size, mN, either way."""
        none = (1 - sum(probability for probability, _, _ in self.kinds), 0.0, 0.0)
        return sum(
            probability * _outside(size, mean, float(np.hypot(scatter, error)))
            for probability, mean, scatter in (none, *self.kinds)
        )

    def largest(self, probability: float, error: float) -> float:
        """The size, mN, that both together exceed with a probability."""
        sizes = np.linspace(0.0, max(abs(mean) + 5 * float(np.hypot(scatter, error)) for _, mean, scatter in self.kinds), SIZES)
        return float(sizes[int(np.argmax([self.beyond(size, error) < probability for size in sizes]))])


def _outside(size: float, mean: float, scatter: float) -> float:
    """Probability that a normal value exceeds a size either way."""
    scatter = max(scatter, 1e-300)
    return float(ndtr((mean - size) / scatter) + ndtr((-mean - size) / scatter))


@dataclass(frozen=True)
class Doubt:
    """How far rivals that fit as well, or nearly, put the contact point, mm, and the zero at the end of loading, mN, from a fit;
    and the drift that the force does not show, or None where one is ruled out or not looked for.

    shorter: how far fits to shorter stretches put the contact point, mm; noise may explain it, and so may a law of another form."""

    contact: float = 0.0
    zero: float = 0.0
    hidden: HiddenDrift | None = None
    shorter: float = 0.0


def fitted(stretch: Stretch, ends: tuple[str, ...]) -> tuple[Piecewise, Doubt]:
    """The fit of the end that fits best, and the `Doubt` because of other ends, waves and drifts that fit as well."""
    coarse = stretch.thinned(SEARCHED)
    best = _closest(coarse, ends)
    base, doubt = _with_baseline(coarse, POWERS[best])
    fit, shorter = _chosen(stretch, base.powers, base.baseline)
    if len(ends) > 1:
        doubt = replace(doubt, contact=max(doubt.contact, _beyond(fit, coarse, ends, best)))
    return _weighed(fit, best, replace(doubt, shorter=shorter))


def _closest(stretch: Stretch, ends: tuple[str, ...]) -> str:
    """The end whose two powers fit best, beside a drift where the baseline is long enough to tell one."""
    if len(ends) == 1:
        return ends[0]
    baseline = Baseline("drift" if stretch.drifts else "constant")
    return min(ends, key=lambda end: _square(fit_of(stretch, POWERS[end], baseline).residual))


def _weighed(fit: Piecewise, end: str, doubt: Doubt) -> tuple[Piecewise, Doubt]:
    """The best of the fits of an end's two powers and of more, and the doubt with the spread of all of them under their weights.

    Powers that rise by halves are those of a layer under a sphere; one above the last is that of a law that stiffens or softens; a
    law has them all. Where the force shows none of these, each has a share of the weight still: a law may differ by less than the
    noise shows.
    """
    nested = more_powers(POWERS[end])
    fits = [fit if law == fit.powers else fit_of(fit.stretch, law, fit.baseline) for law in (*nested, *SHARP.get(end, ()))]
    # more powers that fit worse are a search that went astray
    astray = [rival.powers in nested and _ratio(fits[0], rival) < 0 for rival in fits]
    kept = [not lost and _after_a_baseline(rival) and _rises(rival) for rival, lost in zip(fits, astray, strict=True)]
    fits = [rival for rival, sound in zip(fits, kept, strict=True) if sound or rival is fits[0]]
    closest = min(fits, key=lambda rival: _square(rival.residual))
    gains = np.array([-0.5 * _ratio(rival, closest) - _price(rival, independent(closest.noise)) for rival in fits])
    if not np.isfinite(gains).any():
        return fit, doubt
    weights = np.exp(gains - gains.max())
    weights /= weights.sum()
    best = fits[int(np.argmax(weights))]
    squares = [rival.stderr**2 + (rival.contact - best.contact) ** 2 for rival in fits]
    spread = max(float(weights @ np.array(squares)) - best.stderr**2, 0.0)
    return best, replace(doubt, contact=float(np.hypot(doubt.contact, CERTAIN * np.sqrt(spread))))


def _after_a_baseline(fit: Piecewise) -> bool:
    """Whether contact is surely later than the first sample: a law of many powers may take the whole record for contact."""
    return fit.contact - float(fit.stretch.displacement.min()) > SURELY * fit.stderr


def _rises(fit: Piecewise) -> bool:
    """Whether the force rises from contact on: powers of both signs may fall first, and no sample does that under an indenter."""
    depth = float(fit.stretch.displacement.max()) - fit.contact
    beyond = np.linspace(0.0, max(depth, 0.0), GRID)
    force = sum(c * beyond**power for power, c in zip(fit.powers, fit.coefficients[-len(fit.powers) :], strict=True))
    return bool(np.max(np.maximum.accumulate(force) - force) <= FALLS * abs(float(force[-1])))


def more_powers(powers: tuple[float, ...]) -> list[tuple[float, ...]]:
    """The two powers of an end, and laws of more: of a layer, of a sample that stiffens or softens, and of all of them."""
    halves = (powers[0], powers[0] + 0.5, powers[0] + 1.0)
    return list(dict.fromkeys([powers, _richer(powers), halves, tuple(sorted({*halves, *_richer(powers)}))]))


def _price(fit: Piecewise, samples: float) -> float:
    """What the values of a fit cost; the contact point and the size of the noise are two of them."""
    return criterion(fit.coefficients.size + 2, samples)


def criterion(values: int, samples: float) -> float:
    """What the values of a fit cost by Akaike's criterion, corrected for few independent samples, which slow noise leaves."""
    left = samples - values - 1
    return values + values * (values + 1) / left if left > 0 else np.inf


def _richer(powers: tuple[float, ...]) -> tuple[float, ...]:
    """The powers of a law that stiffens or softens."""
    return (*powers, powers[-1] + 1.0)


def _beyond(fit: Piecewise, coarse: Stretch, ends: tuple[str, ...], best: str) -> float:
    """How far the ends that the samples do not tell from the best one put the contact point from it, mm."""
    share = fit.stretch.time.size / coarse.time.size
    within = coarse.until(min(coarse.time.size, max(20, int(np.searchsorted(coarse.time, fit.stretch.time[-1], "right")))))
    rivals = {end: fit_of(within, POWERS[end], fit.baseline) for end in ends}
    least, most = _square(rivals[best].residual), 0.0
    for end in ends:
        excess = (_square(rivals[end].residual) / least - 1) * independent(rivals[best].noise)
        if end != best and excess < AGREE**2 and share > 0:
            most = max(most, abs(rivals[end].contact - rivals[best].contact))
    return most


def _chosen(stretch: Stretch, powers: tuple[float, ...], baseline: Baseline) -> tuple[Piecewise, float]:
    """The fit of the longest stretch whose contact point agrees with those of the shorter ones, and how far off these are, mm."""
    fits = [fit_of(stretch, powers, baseline)]
    rise = fits[0].residual.size and stretch.force - fits[0].free(stretch.time, stretch.displacement)
    smooth = filtered(np.asarray(rise), max(5, stretch.length // 2))
    for share in SHARES:
        above = np.flatnonzero(smooth >= share * smooth.max())
        stop = int(above[0]) if above.size else stretch.time.size
        beyond = np.count_nonzero(stretch.displacement[:stop] > fits[0].contact)
        if beyond < FEWEST_BEYOND or stop < 30:
            break
        fits.append(fit_of(stretch.until(stop), powers, baseline))
    for n, wide in enumerate(fits):
        if all(_agree(wide, narrow) for narrow in fits[n + 1 :]):
            return wide, max((abs(narrow.contact - wide.contact) for narrow in fits[n + 1 :]), default=0.0)
    return fits[-1], 0.0


def _agree(wide: Piecewise, narrow: Piecewise) -> bool:
    """Whether two fits differ by no more than noise explains: in the contact point, or in the misfit to the shorter stretch."""
    scatter = np.sqrt(max(narrow.stderr**2 - wide.stderr**2, (0.3 * narrow.stderr) ** 2))
    within = wide.residual[: narrow.residual.size]
    excess = (_square(within) / max(_square(narrow.residual), 1e-300) - 1) * independent(narrow.noise)
    return bool(abs(wide.contact - narrow.contact) <= AGREE * scatter or excess < MISFIT)


def _with_baseline(stretch: Stretch, powers: tuple[float, ...]) -> tuple[Piecewise, Doubt]:
    """The fit with the simplest baseline that the force before contact holds to, and what stays in doubt.

    Long waves that may be a toe of the contact are not fitted: they put contact in doubt.
    """
    fit, doubt = _straight(stretch, powers)
    dying, doubt = _bent(fit, doubt) if fit.baseline.kind == "drift" else (fit, doubt)
    hidden = stretch.drifts and _is_hidden(fit)
    if not stretch.drifts or not (hidden or _uneven(fit)):
        return dying, doubt
    if fit.baseline.kind == "constant" and not stretch.short:
        fit = fit_of(stretch, fit.powers, Baseline("drift"))
    rivals = [fit_of(stretch, powers, rival) for rival in (_waves(stretch) if hidden else _rivals(fit))]
    sure = [rival for rival in rivals if _ratio(fit, rival) > SURE[rival.baseline.kind]]
    best = min(sure, key=lambda rival: _square(rival.residual), default=dying)
    if best is dying:
        return dying, doubt
    if _may_be_a_toe(fit, best):
        return fit, replace(doubt, contact=max(doubt.contact, abs(best.contact - fit.contact)))
    return best, Doubt()


def _is_hidden(fit: Piecewise) -> bool:
    """Whether hardly a sample lies before the fitted contact point of a record with an approach: waves may be taken for contact."""
    before = np.count_nonzero(fit.stretch.displacement < fit.contact)
    return bool(before < HIDDEN * fit.stretch.half)


def _waves(stretch: Stretch) -> list[Baseline]:
    """Waves of the periods that the approach may show."""
    travel = float(stretch.displacement[stretch.half] - stretch.displacement.min())
    return [Baseline("waves", period) for period in np.geomspace(SHORTEST_WAVE * travel, travel, FEW_PERIODS)]


def _rivals(fit: Piecewise) -> list[Baseline]:
    """Decays and waves that promise to explain the residual of a fit."""
    stretch = fit.stretch
    span, travel = float(np.ptp(stretch.time)), float(np.ptp(stretch.displacement))
    decays = [Baseline("decay", span * share) for share in DECAYS]
    shortest = travel * max(12 / stretch.time.size, 0.03)
    longest = LONGEST_WAVE * (fit.contact - float(stretch.displacement.min()))
    waves = [Baseline("waves", period) for period in np.geomspace(min(shortest, longest), longest, PERIODS)]
    return [rival for kind in (decays, waves) for rival in _promising(fit, kind)]


def _may_be_a_toe(fit: Piecewise, best: Piecewise) -> bool:
    """Whether waves are longer than the travel before contact tells, and do not leave noise alone."""
    seen = best.contact - float(fit.stretch.displacement.min())
    return best.baseline.kind == "waves" and best.baseline.scale > LONGEST_WAVE * seen and _ratio(fit, best) < SURE["toe"]


def _straight(stretch: Stretch, powers: tuple[float, ...]) -> tuple[Piecewise, Doubt]:
    """The fit with a drift where the force shows one, else with a constant baseline; and the doubt because of the other.

    The doubt is the spread of both fits under the weights of Schwarz's criterion, that of an unseen drift no less than UNSEEN.
    """
    still = fit_of(stretch, powers, Baseline("constant"))
    if not stretch.drifts:
        return still, Doubt()
    fit, freer = fit_of(stretch, powers, Baseline("drift")), fit_of(stretch, _richer(powers), still.baseline)
    # a law that stiffens would be taken for a drift
    surely = _ratio(still, freer) > max(SURE["law"], _ratio(still, fit))
    if surely and _after_a_baseline(freer) and _rises(freer):
        still, fit = freer, fit_of(stretch, freer.powers, Baseline("drift"))
    ratio = _ratio(still, fit)
    last = (stretch.time[-1:], stretch.displacement[-1:])
    apart = float(fit.free(*last)[0] - still.free(*last)[0])
    weight = 1 / (1 + np.sqrt(independent(fit.noise)) * np.exp(-min(ratio, LARGEST_RATIO) / 2))  # of the drift
    if ratio > SURE["drift"]:
        reach = float(np.sqrt(1 - weight)) * CERTAIN
        return fit, Doubt(reach * abs(fit.contact - still.contact), reach * abs(apart))
    first, deepest = float(stretch.displacement.min()), float(stretch.displacement.max())
    if still.contact - first < TELLING * (deepest - still.contact):
        return still, Doubt()
    return still, _hidden_drift(fit)


def _hidden_drift(fit: Piecewise) -> Doubt:
    """The doubt because of a drift that the force does not show: small ones are common and large ones rare (HIDDEN_DRIFTS).

    Contact point and zero follow the rate as they do in the covariance of the fit. Nobody expects a drift that no force shows to be
    as large as a short approach allows.
    """
    stretch, variance = fit.stretch, float(fit.spread[1, 1])
    touching = float(stretch.time[-1] - stretch.time[stretch.displacement < fit.contact].max(initial=stretch.time[0]))
    rise = float(stretch.force[-1] - fit.free(stretch.time[-1:], stretch.displacement[-1:])[0])
    if variance <= 0 or touching <= 0:
        return Doubt()
    rate, place = float(fit.coefficients[1]), float(fit.spread[-1, 1]) / variance
    zero = float(fit.spread[0, 1]) / variance + float(stretch.time[-1])
    kinds = _posterior([(probability, size * rise / touching) for size, probability in HIDDEN_DRIFTS], rate, variance)
    square = sum(probability * (mean**2 + scatter**2) for probability, mean, scatter in kinds)
    changes = tuple((probability, mean * zero, scatter * abs(zero)) for probability, mean, scatter in kinds)
    hidden = HiddenDrift(changes, fitted=(rate * zero, sqrt(variance) * abs(zero)))
    return Doubt(CERTAIN * float(np.sqrt(square)) * abs(place), hidden=hidden)


def _posterior(prior: list[tuple[float, float]], rate: float, variance: float) -> list[tuple[float, float, float]]:
    """Probability, mean and standard deviation of the rate of each kind of drift, by the rate that was fitted and its variance.

    prior: probability and standard deviation of the rate of each kind, before the record is seen; without a drift the rate is 0.
    """
    kept = [size**2 / (size**2 + variance) for _, size in prior]
    odds = [
        probability * sqrt(1 - share) * exp(min(0.5 * share * rate**2 / variance, LARGEST_RATIO))
        for (probability, _), share in zip(prior, kept, strict=True)
    ]
    whole = sum(odds) + 1 - sum(probability for probability, _ in prior)
    return [(chance / whole, share * rate, sqrt(share * variance)) for chance, share in zip(odds, kept, strict=True)]


def _bent(fit: Piecewise, doubt: Doubt) -> tuple[Piecewise, Doubt]:
    """The fit with a drift that dies out in place of a straight one, where the force shows it; else how far it would move both,
    beside the doubt that there is."""
    stretch = fit.stretch
    last = (stretch.time[-1:], stretch.displacement[-1:])
    contacts, zeros = [0.0], [0.0]
    for share in DYING:
        bent = fit_of(stretch, fit.powers, Baseline("decay", share * float(np.ptp(stretch.time))))
        ratio = _ratio(fit, bent)
        if ratio > SURE["decay"]:
            return bent, Doubt()
        if ratio >= -AGREE:
            contacts.append(abs(bent.contact - fit.contact))
            zeros.append(abs(float(bent.free(*last)[0] - fit.free(*last)[0])))
    return fit, replace(doubt, contact=float(np.hypot(doubt.contact, max(contacts))), zero=float(np.hypot(doubt.zero, max(zeros))))


def _uneven(fit: Piecewise) -> bool:
    """Whether the force before contact leaves the baseline by more than is worth a look."""
    before = fit.residual[fit.stretch.displacement < fit.contact]
    smooth = filtered(before, max(5, before.size // 20)) if before.size > 20 else before[:0]
    return bool(smooth.size and smooth.std() > LEAST_WAVE * float(np.ptp(fit.stretch.force)))


def _promising(fit: Piecewise, rivals: list[Baseline]) -> list[Baseline]:
    """The two baselines, far from each other, that explain most of the residual while contact moves a little, if it is much."""
    stretch = fit.stretch.thinned(SCREENED)
    jacobian = solution(fit.contact, stretch, fit.powers, fit.baseline)[2]
    known = np.linalg.qr(jacobian / np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300))[0]
    rest = stretch.force - known @ (known.T @ stretch.force)
    left = np.array([_left(rest, rival.more(stretch.time, stretch.displacement), known) for rival in rivals])
    best = int(np.argmin(left))
    far = np.abs(np.arange(len(rivals)) - best) > len(rivals) // 8
    second = int(np.argmin(np.where(far, left, np.inf)))
    return [rivals[n] for n in (best, second) if left[n] < WORTH[rivals[n].kind] * _square(rest)]


def _left(rest: Array, more: Array, known: Array) -> float:
    """Sum of squares that more columns (n, .) leave of a residual (n,), which is orthogonal to the known directions (n, .)."""
    columns = more - known @ (known.T @ more)
    return _square(rest - columns @ solved(columns, rest))


def _ratio(fit: Piecewise, rival: Piecewise) -> float:
    """F ratio of the smaller sum of squares of a rival, with as many samples as its residual has independent ones."""
    return (_square(fit.residual) / max(_square(rival.residual), 1e-300) - 1) * independent(rival.noise)


def _square(values: Array) -> float:
    return float(values @ values)
