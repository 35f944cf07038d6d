"""The largest force of a loading: by a filter that removes noise and ringing and keeps the peak, or by a fit to noisy forces."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import median_filter

from indentfit.arrays import Array
from indentfit.digits import quantity
from indentfit.experiment.baselines import HiddenDrift, criterion, more_powers
from indentfit.experiment.contact_point import ContactPoint
from indentfit.experiment.loading import Ramp, filtered, noise_of
from indentfit.experiment.noise import CorrelatedNoise, covariance, noise_in
from indentfit.experiment.piecewise import POWERS, independent, rounded, solved, step_of

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
FEW = 4.0  # samples through which a stage may slow down that turns at once
ROUND = 0.6  # of the time through which a stage slows down: the longest filter that keeps the force's rounded peak
# In the middle of that time a stage that slows down evenly has an eighth of this way ahead, and one that is a little slower near
# its turn, as where the bending of a cantilever is taken off, almost half of it.
STILL_AHEAD = 0.3
CHANCE = 4.0  # standard deviations by which the largest of many filtered forces lies above the others by chance
SLOWS = 0.01  # share of the ramp's duration through which a stage may slow down that turns at once
STOPPED = 2.5  # standard errors by which the last samples of a record lie behind a stage that moves on
SURE = 3.0  # standard errors
RARELY = 0.0027  # probability that a normal error is larger than SURE standard errors
FOLLOWS = 25.0  # excess of squares, in squares of noise, below which the indenter's law follows the end of the loading
FAR = 3.0  # standard errors within which the laws and the polynomial agree
ORDERS = (2, 3)  # of polynomials over time at the end of the loading
NEGLIGIBLE = 1e-3  # weight of a law
SIGMA_95 = 1.96


@dataclass(frozen=True)
class Peak:
    """The largest force of a loading, mN, and its standard error, mN, by the scatter of the samples."""

    force: float
    stderr: float


def peak_of(ramp: Ramp, contact: ContactPoint, force: Array, indenter: str | None = None) -> Peak:
    """The `Peak` of a loading.

    The filter is the shortest after which the force scatters by less than 0.25 % of its peak in the ramp, so that a sharp peak is
    kept where the record is quiet. Where none is, a polynomial is fitted to the end of the loading, or laws of powers to the whole
    loading where they agree with the polynomial: the largest of noisy values is too large.

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
    peak = _peak(ramp, contact, force, indenter)
    step = step_of(force[: ramp.stop])
    return replace(peak, stderr=float(np.hypot(peak.stderr, rounded(step, contact.noise**2)))) if step else peak


def _peak(ramp: Ramp, contact: ContactPoint, force: Array, indenter: str | None) -> Peak:
    if any(ramp.held):
        return _held(ramp, force)
    staged, ramp = bool(ramp.pauses), ramp.last
    start = ramp.low if staged else contact.index
    stop = ramp.stop + round(0.5 * ramp.samples)
    longest = LONGEST * ramp.samples
    smooth = filtered(force[:stop], longest)
    length = float(SHORTEST)
    loading = _Loading(ramp, contact, force, _slow_noise(_before(ramp, contact, force)))
    fit, record_end = _fitted(loading, start), ramp.record.time.size
    if fit.turn.slows:
        return _rounded(loading, fit.turn)
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
            surer = fit.error < (AT_ENDS if ends else 1) * scatter or apart > CLEARLY * fit.error
            if scatter > QUIET * largest and surer and apart < BY_NOISE * max(noise, scatter):
                return Peak(fit.force, max(fit.error, 0.5 * scatter))
            return Peak(largest, max(noise, scatter))
        length *= 1.6
    return Peak(fit.force, fit.error)


def _held(ramp: Ramp, force: Array) -> Peak:
    """The level of a force that is held: the mean of its samples, or where they surely change a line back to the first of them."""
    begin, end = ramp.held
    held = force[min(begin + round(ROUNDED * ramp.length), end - FEWEST) : end]
    age = np.arange(held.size) / held.size
    law = _polynomial(age, held, 1)
    spread = covariance(law.terms, noise_in(law.residual))
    change = float(np.polyfit(age, held, 1)[0])
    if abs(change) > SURE * float(np.sqrt(spread[1, 1])):
        return Peak(law.force, float(np.sqrt(spread[0, 0])))
    flat = _polynomial(age, held, 0)
    return Peak(flat.force, float(np.sqrt(covariance(flat.terms, noise_in(flat.residual))[0, 0])))


def _rounded(loading: _Loading, turn: _Turn) -> Peak:
    """The largest force where the stage slows down before it turns, by a filter shorter than that time, which keeps the peak.

    The sample relaxes while the stage slows down, and no law of the loading before knows by how much.
    """
    ramp, noise = loading.ramp, max(loading.contact.noise, noise_of(loading.force))  # the fit's samples may be means of blocks
    count = round(turn.slows / ramp.record.interval)
    first, last = np.searchsorted(ramp.record.time, [turn.time - turn.slows, turn.time + turn.slows])
    begin = max(0, first - count)
    force, inside = loading.force[begin : last + count], slice(first - begin, last - begin)
    # a quadratic filter of m samples lets 9 / (4 m) of the variance pass
    needed = (1.5 * noise / (0.5 * STEADY * float(force.max()))) ** 2
    length = min(max(SHORTEST, needed), ROUND * count)
    long, short = (filtered(force, share * length)[inside] for share in (1.0, 0.5))
    left = 1.5 * noise / float(np.sqrt(max(length, SHORTEST)))
    top, steady = int(np.argmax(long)), int(np.argmax(filtered(force, ROUND * count)[inside]))
    if long[top] - long[steady] < CHANCE * left:  # the largest of many noisy forces is too large
        top = steady
    return Peak(float(long[top]), float(np.hypot(left, long[top] - short[top])))


@dataclass(frozen=True, eq=False)
class _Loading:
    """A ramp with its contact point, the whole force (n,), mN, counted from its zero, and the noise before contact if slow."""

    ramp: Ramp
    contact: ContactPoint
    force: Array
    slow: CorrelatedNoise | None

    def variance(self, law: _Law) -> float:
        """Variance of a law's force at the end, mN^2, by its residual or by slow noise, whichever is larger.

        A parabola at the end of a loading takes slow noise for its own, and leaves a residual that knows nothing of it.
        """
        noises = [noise_in(law.residual)]
        if self.slow is not None:
            n = law.residual.size
            correlation = np.append(self.slow.correlation, np.zeros(n))[:n]
            noises.append(CorrelatedNoise(np.full(n, float(np.sqrt(np.mean(self.slow.scale**2)))), correlation, self.slow.weights))
        part = slice(law.summed)
        return max(0.0, *(float(covariance(law.terms, noise)[part, part].sum()) for noise in noises))


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
    """Where the stage ends its loading: time, s, displacement of the record, mm, and its standard error, mm.

    slows: how long the stage slows down before it turns or stops, s; 0 where it keeps its velocity to the end.
    """

    time: float
    place: float
    blur: float
    slows: float = 0.0


@dataclass(frozen=True, eq=False)
class _End:
    """The end of a loading by polynomials over time: its force, mN, the standard error, the samples, and their mean there.

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
    """The force at the end of loading, which begins at the sample `start`, by a parabola and a cubic over time."""
    ramp, force = loading.ramp, loading.force
    stop = max(ramp.stop - round(ROUNDED * ramp.length), start + FEWEST)
    begin = max(start, stop - max(15, round(FITTED * ramp.samples)))
    turn = _turn(ramp, begin, stop)
    stop = _before_turn(ramp, begin, stop, turn)
    age = (ramp.record.time[begin:stop] - turn.time) / ramp.duration
    fits = [_polynomial(age, force[begin:stop], order) for order in ORDERS]
    weights = _weights(fits, loading)
    weights = weights if weights.any() else np.eye(len(fits))[0]
    peak, stderr = _mean(fits, weights, loading)
    values = force[begin:stop] - np.einsum("i,ij->j", weights, [fit.residual for fit in fits])
    rate = abs(float(np.polyfit(age, values, 2)[1])) / ramp.duration / max(abs(ramp.velocity), 1e-300)  # over the travel, mN/mm
    return _End(peak, stderr, slice(begin, stop), values, turn, rate * turn.blur)


def _before_turn(ramp: Ramp, begin: int, stop: int, turn: _Turn) -> int:
    """The sample to which the stage keeps its velocity before it turns; `stop` where it slows down earlier."""
    record = ramp.record
    last = int(np.searchsorted(record.time, turn.time, "right"))
    half = slice((begin + stop) // 2, stop)
    line = np.polyfit(record.time[half] - turn.time, record.displacement[half], 1)
    beside = np.abs(record.displacement[stop:last] - np.polyval(line, record.time[stop:last] - turn.time))
    allowed = max(SURE * noise_of(record.displacement), SHARP * abs(ramp.velocity * ramp.duration))
    return stop + int(np.argmax(np.append(beside > allowed, True)))


def _polynomial(age: Array, force: Array, order: int) -> _Law:
    """A polynomial over the age (n,), which is 0 at the end of loading."""
    terms = age[:, None] ** np.arange(order + 1)
    values = np.linalg.lstsq(terms, force, rcond=None)[0]
    return _Law(float(values[0]), terms, force - terms @ values, 1)


def _surer(end: _End, loading: _Loading, indenter: str | None) -> _End:
    """The end of a loading by laws of powers, fitted to all of it, where the polynomial at its end does not contradict them.

    The laws are those of the contact point: the indenter's two powers, and more. Their mean by weights of Akaike is taken, with the
    scatter among them (Burnham, Anderson 2002, Model Selection and Multimodel Inference, ch. 4).
    """
    ramp, contact, force = loading.ramp, loading.contact, loading.force
    part = slice(contact.index, end.part.stop)
    depth = end.turn.place - contact.displacement
    beyond = np.maximum(ramp.displacement[part] - contact.displacement, 0.0) / depth
    powers = min(
        (POWERS[name] for name in ([indenter] if indenter else POWERS)),
        key=lambda known: _square(_law(beyond, force[part], known).residual),
    )
    laws = [_law(beyond, force[part], known) for known in (*more_powers(powers), (*powers, powers[-1] + 1, powers[-1] + 2))]
    weights = _weights(laws, loading)
    rest = force[end.part] - end.values
    if not weights.any():
        return end
    residual = np.einsum("i,ij->j", weights, [law.residual for law in laws])
    law, stderr = _mean(laws, weights, loading)
    apart = abs(law - end.force)
    excess = _square(residual[end.part.start - part.start :]) / max(_square(rest), 1e-300) - 1
    if excess * independent(noise_in(rest)) > FOLLOWS or stderr > end.stderr:
        return end
    if apart > FAR * _scatter(end.stderr, stderr):
        return replace(end, stderr=float(np.hypot(end.stderr, 0.5 * apart)))  # by chance, or no law holds
    return replace(end, force=law, stderr=stderr)


def _weights(laws: list[_Law], loading: _Loading) -> Array:
    """Weights (p,) of laws by Akaike's criterion, corrected for few independent samples; zeros where they are too few for any."""
    squares = np.array([_square(law.residual) for law in laws])
    least = int(np.argmin(squares))
    samples = laws[least].residual.size
    share = independent(loading.slow) / loading.slow.correlation.size if loading.slow else 1.0
    count = min(independent(noise_in(laws[least].residual)), share * samples)
    gains = np.array([-0.5 * (square / max(squares[least], 1e-300) - 1) * count for square in squares])
    gains -= [criterion(law.terms.shape[1] + 1, count) for law in laws]
    if not np.isfinite(gains).any():
        return np.zeros(len(laws))
    weights = np.exp(gains - gains.max())
    return weights / weights.sum()


def _mean(laws: list[_Law], weights: Array, loading: _Loading) -> tuple[float, float]:
    """The mean of the laws' forces at the deepest place, mN, and its standard error with the scatter among them."""
    kept = [(law, weight) for law, weight in zip(laws, weights.tolist(), strict=True) if weight > NEGLIGIBLE]
    total = sum(weight for _, weight in kept)
    mean = sum(weight * law.force for law, weight in kept) / total
    squares = [loading.variance(law) + (law.force - mean) ** 2 for law, _ in kept]
    return mean, float(np.sqrt(sum(weight * square for (_, weight), square in zip(kept, squares, strict=True)) / total))


def _scatter(wide: float, narrow: float) -> float:
    """Standard deviation of the difference between an estimate and a surer one of the same samples, by both standard errors."""
    return float(np.sqrt(max(wide**2 - narrow**2, (0.5 * wide) ** 2)))


@dataclass(frozen=True, eq=False)
class _Law:
    """A law fitted to a loading: the force at its end, mN, the terms (n, p), and the residual (n,), mN.

    summed: how many of the first coefficients make the force at the end.
    """

    force: float
    terms: Array
    residual: Array
    summed: int


def _law(beyond: Array, force: Array, powers: tuple[float, ...]) -> _Law:
    """The law of powers of the depth (n,), 1 at the deepest place."""
    terms = np.column_stack([beyond**power for power in powers])
    values = solved(terms, force)
    return _Law(float(values.sum()), terms, force - terms @ values, values.size)


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
    time = float(record.time[stop - 1] + np.clip(ahead, 0.0, most))
    return _Turn(time, deepest, blur, _slowing(ramp, begin, stop, time))


def _slowing(ramp: Ramp, begin: int, stop: int, turn: float) -> float:
    """How long the stage slows down about the time at which it would turn at the velocity of a line, s; 0 where it does not.

    A stage that slows down evenly through a time s lies behind the line by v t^2 / (2 s), in sum v s^2 / 48 until it would turn.
    """
    record = ramp.record
    half = slice(begin, (begin + stop) // 2)
    line = np.polyfit(record.time[half] - record.time[stop - 1], record.displacement[half], 1)
    deepest = float(record.displacement[stop:].max())
    turn = record.time[stop - 1] + (deepest - line[1]) / line[0]
    begin = max(0, stop - ramp.length)
    part = slice(begin, int(np.searchsorted(record.time, turn, "right")))
    behind = np.polyval(line, record.time[part] - record.time[stop - 1]) - record.displacement[part]
    stderr = noise_of(record.displacement) * float(np.sqrt(2 * behind.size))
    area = (float(behind.sum()) - SURE * stderr) * record.interval
    slows = float(np.sqrt(max(48 * area / line[0], 0.0))) if line[0] > 0 else 0.0
    if slows <= max(FEW * record.interval, SLOWS * ramp.duration):
        return 0.0
    near = SURE * noise_of(record.displacement) + SHARP * abs(ramp.velocity * ramp.duration)
    end = stop + int(np.argmax(record.displacement[stop:] >= deepest - near))
    before = np.searchsorted(record.time, record.time[min(end, record.time.size - 1)] - 0.5 * slows)
    left = deepest - float(np.mean(record.displacement[max(0, before - 2) : before + 3]))
    return slows if left < STILL_AHEAD * line[0] * slows else 0.0


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
        most = max(contact.hidden.largest(RARELY, error), contact.hidden.reach(error)) / peak.force
        yield f"the peak may be off by {most:.1%}: the baseline is too short, or too noisy, to rule out a drift of this size"


def _may_drift(hidden: HiddenDrift, size: float, error: float) -> bool:
    """Whether a drift may change the peak by more than a size, mN: as drifts are, or as the approach alone tells."""
    return hidden.beyond(size, error) > RARELY or hidden.reach(error) > size


def peak_uncertainty(peak: Peak, contact: ContactPoint) -> float:
    """Half of the 95 % interval of the peak, mN: of its noise, of the zero, and of a drift that the approach does not show."""
    error = _error(peak, contact)
    return max(SIGMA_95 * error, contact.hidden.reach(error) if contact.hidden else 0.0)


def _error(peak: Peak, contact: ContactPoint) -> float:
    """Standard error of the peak with that of its zero, mN."""
    return float(np.hypot(peak.stderr, contact.zero_error / SIGMA_95))
