"""The largest force of a loading: by a filter that removes noise and ringing and keeps the peak, or by a fit to noisy forces."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import median_filter

from indentfit.arrays import Array
from indentfit.digits import quantity
from indentfit.experiment.baselines import HiddenDrift
from indentfit.experiment.contact_point import ContactPoint
from indentfit.experiment.loading import Ramp, filtered, noise_of
from indentfit.experiment.noise import CorrelatedNoise, covariance, noise_in
from indentfit.experiment.piecewise import POWERS, independent, solved

LONGEST = 0.05  # of the duration of the ramp: longer than a period of the rig's ringing
SHORTEST = 5  # samples
CLEARLY_SHORTER = 2.0  # a filter that is not, lets the same noise pass
STEADY = 0.0025  # share of the peak: the scatter of the filtered force that is allowed
OTHER = 0.01  # share of the peak by which a larger force of the record is worth a note
FITTED = 0.35  # of the duration of the ramp: the end of the loading, whose fit gives the peak of a noisy record
CORNER = 11  # samples of the filter that tells noise in a ramp of few samples
QUIET = 0.0005  # share of the peak: forces that scatter by less have no noise
BY_NOISE = 8.0  # standard deviations within which the largest filtered force agrees with the fit
CLEARLY = 2.0  # standard errors of the fit from which the largest filtered force differs from it
AT_ENDS = 2.0  # ratio of the noise that a quadratic filter lets pass at the end of a record to that within it
FEWEST = 8  # samples of the fit
SHARP = 0.0005  # share of the ramp's travel: noise of the travel that is left where it is filtered
ROUNDED = 0.3  # of the length of the filter: samples at the turning point that the filter rounds, and that are not fitted
FEWEST_BEFORE = 40  # samples before contact that tell its noise
SLOW = 0.5  # share of the samples that are independent, below which noise is slow
STOPPED = 2.5  # standard errors by which the last samples of a record lie behind a stage that moves on
SURE = 3.0  # standard errors
RARELY = 0.0027  # probability that a normal error is larger than SURE standard errors
FOLLOWS = 25.0  # excess of squares, in squares of noise, below which the indenter's law follows the end of the loading
AGREE = 2.5  # standard errors within which the law and that with a power more agree
FAR = 3.0  # standard errors within which the law and the parabola agree
IN_DOUBT = 0.3  # share of the difference of the law from that with a power more that stays in doubt
SIGMA_95 = 1.96
SURE_98 = 2.326  # standard errors in half of a 98 % interval


@dataclass(frozen=True)
class Peak:
    """The largest force of a loading, mN, and its standard error, mN, by the scatter of the samples."""

    force: float
    stderr: float


def peak_of(ramp: Ramp, contact: ContactPoint, force: Array, indenter: str | None = None) -> Peak:
    """The `Peak` of a loading.

    The filter is the shortest after which the force scatters by less than 0.25 % of its peak in the ramp, so that a sharp peak is
    kept where the record is quiet. Where none is, a parabola is fitted to the end of the loading, or the law of the indenter to the
    whole of it where that agrees with the parabola: the largest of noisy values is too large.

    Parameters
    ----------
    ramp : Ramp
    contact : ContactPoint
    force : array (n,), mN
        The whole record, not filtered, counted from the force's zero.
    indenter : str or None
        One of POWERS; None where the end is not known.

    Returns
    -------
    Peak
    """
    staged, ramp = bool(ramp.pauses), ramp.last
    start = ramp.low if staged else contact.index
    stop = ramp.stop + round(0.5 * ramp.samples)
    longest = LONGEST * ramp.samples
    smooth = filtered(force[:stop], longest)
    length = float(SHORTEST)
    loading = _Loading(ramp, contact, force, _slow_noise(_before(ramp, contact, force)))
    fit, record_end = _fitted(loading, start), ramp.record.time.size
    fit = fit if staged else _surer(fit, loading, indenter)  # no law of the indenter follows a force that relaxes in pauses
    if longest < CLEARLY_SHORTER * SHORTEST:
        rough = float(np.std((force[:stop] - filtered(force[:stop], CORNER))[ramp.low : ramp.high]))
        if 2 * rough < STEADY * smooth[start:].max():  # hardly any noise, and a corner of few samples that no filter would keep
            return Peak(float(force[start:stop].max()), rough)
    while length < longest / CLEARLY_SHORTER:
        shorter = filtered(force[:stop], length)
        # both filters let a part of the same noise pass
        scatter = float(np.std((shorter - smooth)[ramp.low : ramp.high]) / np.sqrt(1 - length / longest))
        if scatter < STEADY * smooth[start:].max():
            largest = float(shorter[start:].max())
            ends = ramp.stop > record_end - length  # at the end of a record the filter scatters most
            noise = (AT_ENDS if ends else 1) * scatter
            scatter = max(scatter, float(np.std(shorter[fit.part] - fit.values)))  # ringing may be slower than the filter
            # the largest of many noisy values, as in a hold, is too large; where the stage turns the filter rounds the force
            apart = abs(largest - fit.force)
            surer = ends or fit.error < scatter or apart > CLEARLY * fit.error
            if scatter > QUIET * largest and surer and apart < BY_NOISE * max(noise, scatter):
                return Peak(fit.force, max(fit.error, 0.5 * scatter))
            return Peak(largest, scatter)
        length *= 1.6
    return Peak(fit.force, fit.error)


@dataclass(frozen=True, eq=False)
class _Loading:
    """A ramp with its contact point, the whole force (n,), mN, counted from its zero, and the noise before contact if slow."""

    ramp: Ramp
    contact: ContactPoint
    force: Array
    slow: CorrelatedNoise | None

    def variance(self, terms: Array, residual: Array) -> Array:
        """Covariance of least-squares values of terms (n, p), by their residual or by slow noise, whichever is larger.

        A parabola at the end of a loading takes slow noise for its own, and leaves a residual that knows nothing of it.
        """
        own = covariance(terms, noise_in(residual))
        if self.slow is None:
            return own
        n = residual.size
        correlation = np.append(self.slow.correlation, np.zeros(n))[:n]
        size = float(np.sqrt(np.mean(self.slow.scale**2)))
        seen = covariance(terms, CorrelatedNoise(np.full(n, size), correlation, self.slow.weights))
        return seen if seen.sum() > own.sum() else own


def _before(ramp: Ramp, contact: ContactPoint, force: Array) -> Array:
    """The measured forces (n,) before contact, mN, counted from their zero; force: those of the ramp's record."""
    uneven = ramp.record.uneven
    if uneven is None:
        return force[: contact.index]
    inside = (uneven.time >= ramp.record.time[0]) & (uneven.time < ramp.record.time[contact.index])
    return uneven.force[inside] - contact.free(uneven.time[inside], uneven.displacement[inside])


def _slow_noise(before: Array) -> CorrelatedNoise | None:
    """The noise of the forces (n,) before contact, where few of them are independent; None where it is not slow, or not known."""
    if before.size < FEWEST_BEFORE:
        return None
    noise = noise_in(before - before.mean())
    return noise if independent(noise) < SLOW * before.size else None


@dataclass(frozen=True)
class _Turn:
    """Where the stage ends its loading: time, s, displacement of the record, mm, and its standard error, mm."""

    time: float
    place: float
    blur: float


@dataclass(frozen=True, eq=False)
class _End:
    """The end of a loading by a parabola over time: its force, mN, the standard error, the samples, and the parabola there.

    turn: of the stage; turning: standard error of the force, mN, because noise of the travel hides where the stage turns.
    """

    force: float
    stderr: float
    part: slice
    values: Array
    turn: _Turn
    turning: float

    @property
    def error(self) -> float:
        """The whole standard error, mN."""
        return float(np.hypot(self.stderr, self.turning))


def _fitted(loading: _Loading, start: int) -> _End:
    """The force at the end of loading, which begins at the sample `start`, by a parabola over time."""
    ramp, force = loading.ramp, loading.force
    stop = max(ramp.stop - round(ROUNDED * ramp.length), start + FEWEST)
    begin = max(start, stop - max(15, round(FITTED * ramp.samples)))
    turn = _turn(ramp, begin, stop)
    age = (ramp.record.time[begin:stop] - turn.time) / ramp.duration
    terms = np.column_stack([np.ones_like(age), age, age**2])
    values = np.linalg.lstsq(terms, force[begin:stop], rcond=None)[0]
    spread = loading.variance(terms, force[begin:stop] - terms @ values)
    rate = abs(float(values[1])) / ramp.duration / max(abs(ramp.velocity), 1e-300)  # of the force over the travel, mN/mm
    stderr = float(np.sqrt(max(spread[0, 0], 0.0)))
    return _End(float(values[0]), stderr, slice(begin, stop), terms @ values, turn, rate * turn.blur)


def _surer(end: _End, loading: _Loading, indenter: str | None) -> _End:
    """The end of a loading by the law of the indenter, fitted to the whole loading, where nothing contradicts it.

    What may contradict the law: the parabola at the end, and the law with a power more, which knows the end better than the
    parabola does. How far that one is from the law stays in doubt in part.
    """
    ramp, contact, force = loading.ramp, loading.contact, loading.force
    part = slice(contact.index, end.part.stop)
    depth = end.turn.place - contact.displacement
    beyond = np.maximum(ramp.displacement[part] - contact.displacement, 0.0) / depth
    powers = min(
        (POWERS[name] for name in ([indenter] if indenter else POWERS)), key=lambda known: _misfit(beyond, force[part], known)
    )
    law, freer = (_law(loading, beyond, force[part], known) for known in (powers, (*powers, powers[-1] + 1.0)))
    apart = abs(law.force - end.force)
    rest = force[end.part] - end.values
    excess = _square(law.residual[end.part.start - part.start :]) / max(_square(rest), 1e-300) - 1
    if excess * independent(noise_in(rest)) > FOLLOWS or law.stderr > end.stderr:
        return end
    if apart > FAR * _scatter(end.stderr, law.stderr) or abs(freer.force - law.force) > AGREE * _scatter(freer.stderr, law.stderr):
        return replace(end, stderr=float(np.hypot(end.stderr, 0.5 * apart)))  # by chance, or the law does not hold
    doubt = IN_DOUBT * max(abs(freer.force - law.force), _scatter(freer.stderr, law.stderr))
    return replace(end, force=law.force, stderr=float(np.hypot(law.stderr, doubt)))


def _scatter(wide: float, narrow: float) -> float:
    """Standard deviation of the difference between an estimate and a surer one of the same samples, by both standard errors."""
    return float(np.sqrt(max(wide**2 - narrow**2, (0.5 * wide) ** 2)))


@dataclass(frozen=True, eq=False)
class _Law:
    """A law of powers fitted to a loading: the force at the deepest place, mN, its standard error, and the residual (n,), mN."""

    force: float
    stderr: float
    residual: Array


def _law(loading: _Loading, beyond: Array, force: Array, powers: tuple[float, ...]) -> _Law:
    """The law of powers of the depth (n,), 1 at the deepest place."""
    terms = np.column_stack([beyond**power for power in powers])
    values = solved(terms, force)
    residual = force - terms @ values
    variance = float(loading.variance(terms, residual).sum())  # of the sum of the values
    return _Law(float(values.sum()), float(np.sqrt(max(variance, 0.0))), residual)


def _misfit(beyond: Array, force: Array, powers: tuple[float, ...]) -> float:
    """Sum of squares, mN^2, that a law of powers leaves."""
    terms = np.column_stack([beyond**power for power in powers])
    return _square(force - terms @ solved(terms, force))


def _square(values: Array) -> float:
    return float(values @ values)


def _deepest(ramp: Ramp, stop: int) -> tuple[float, float]:
    """The deepest place of the stage about the end of loading, and its standard error, mm."""
    near = max(3, round(0.5 * ramp.length))
    part = slice(max(0, stop - near), ramp.stop + near)
    displacement = ramp.record.displacement
    noise, slight = noise_of(displacement), SHARP * abs(ramp.velocity * ramp.duration)
    if noise < slight:
        return float(displacement[part].max()), noise  # a filter would round the corner where the stage turns at once
    # a quadratic filter of m samples lets 9 / (4 m) of the variance pass
    length = max(SHORTEST, min(ROUNDED * ramp.length, (1.5 * noise / slight) ** 2))
    return float(filtered(displacement, length)[part].max()), 1.5 * noise / float(np.sqrt(length))


def _turn(ramp: Ramp, begin: int, stop: int) -> _Turn:
    """The end of loading: the end of a record whose stage moves on to its last sample; otherwise where the stage, at the velocity
    that it has before, reaches its deepest place."""
    record, near = ramp.record, max(3, round(0.5 * ramp.length))
    half = slice((begin + stop) // 2, stop)
    line = np.polyfit(record.time[half] - record.time[stop - 1], record.displacement[half], 1)
    noise = noise_of(record.displacement)
    if ramp.stop >= record.time.size:
        late = record.displacement[-SHORTEST:] - np.polyval(line, record.time[-SHORTEST:] - record.time[stop - 1])
        if late.mean() > -STOPPED * noise / np.sqrt(SHORTEST):
            ahead = float(record.time[-1] - record.time[stop - 1])
            return _Turn(float(record.time[-1]), float(np.polyval(line, ahead)), 2 * noise / float(np.sqrt(half.stop - half.start)))
    (deepest, blur), (velocity, last) = _deepest(ramp, stop), line
    ahead = (deepest - last) / velocity if velocity > 0 else 0.0
    most = record.time[min(ramp.stop + near, record.time.size) - 1] - record.time[stop - 1]
    return _Turn(float(record.time[stop - 1] + np.clip(ahead, 0.0, most)), deepest, blur)


def peak_notes(ramp: Ramp, peak: Peak, force: Array, contact: ContactPoint) -> Iterator[str]:
    """A note where the record holds a larger force than the peak of the loading, and where noise or baseline blur the peak."""
    largest = float(median_filter(force, size=5, mode="nearest").max())
    scatter = float(np.std((force - ramp.force - np.median(force - ramp.force))[ramp.low : ramp.high]))
    if largest > (1 + OTHER) * peak.force + 4 * scatter:
        sizes = quantity(largest, "mN"), quantity(peak.force, "mN")
        yield f"the largest force of the record, {sizes[0]}, is above the peak of the loading, {sizes[1]}"
    error = _error(peak, contact)
    if SURE * error > OTHER * peak.force:
        cause = "the baseline" if contact.zero_error / SIGMA_95 > peak.stderr else "the noise"
        yield f"the peak is uncertain by {SIGMA_95 * error / peak.force:.1%} (95 %) because of {cause}"
    elif contact.hidden and _may_drift(contact.hidden, OTHER * peak.force, error):
        most = max(contact.hidden.largest(RARELY, error), contact.hidden.reach(error, SURE_98)) / peak.force
        yield f"the peak may be off by {most:.1%}: the baseline is too short, or too noisy, to rule out a drift of this size"


def _may_drift(hidden: HiddenDrift, size: float, error: float) -> bool:
    """Whether a drift may change the peak by more than a size, mN: as drifts are, or as the approach alone tells."""
    return hidden.beyond(size, error) > RARELY or hidden.reach(error, SURE_98) > size


def peak_uncertainty(peak: Peak, contact: ContactPoint) -> float:
    """Half of the 95 % interval of the peak, mN: of its noise, of the zero, and of a drift that the approach does not show."""
    error = _error(peak, contact)
    return max(SIGMA_95 * error, contact.hidden.reach(error) if contact.hidden else 0.0)


def _error(peak: Peak, contact: ContactPoint) -> float:
    """Standard error of the peak with that of its zero, mN."""
    return float(np.hypot(peak.stderr, contact.zero_error / SIGMA_95))
