"""The loading part of a record: where the ramp is, how fast it is, and where its velocity is constant."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import convolve1d, median_filter
from scipy.signal import savgol_filter

from indentfit.arrays import Array, Bools
from indentfit.digits import quantity
from indentfit.errors import RecordError
from indentfit.experiment.record import RawRecord

FILTER = 0.1  # length of the filter, as a share of the ramp's duration
VELOCITY_FILTER = 0.2
SAME_VELOCITY = 0.15  # relative change of velocity that still counts as constant
PLATEAU = 0.005  # share of the force within which a controlled force is held
HELD = 0.15  # durations of the ramp for which it is held at least
CREEP = 0.003  # share of the travel that the displacement then creeps
RISES_LESS = 0.25  # share of the rise under a stage that goes as far, by which the force may change while it is held
PAUSED = 0.05  # share of the samples between 20 and 80 % of the force from which a stage that stays pauses
STAYS = 0.005  # share of the travel between them within which it stays
RISES = 0.1  # share of the rise of the force from which it rises in a part
SLOW = 0.5  # of the velocity before, at which the stage slows down
REPEATS = 0.3  # share of the samples that may repeat the one before in a force that is held
BY_NOISE = 4.0  # standard deviations of the filtered force within which it is held
SHORTEST_FILTER = 5  # samples
STEADY, FEWEST_STEADY = 0.02, 5  # share of the ramp, and samples, over which a velocity that ends is looked at
FEWEST = 20  # samples of a ramp that can be filtered at all
HINGE_SAMPLES = 200  # of the two straight lines that show the slope of the baseline
HINGES = 35  # places where the two lines may meet
HINGE_RIDGE = 1e-13  # keeps the equations solvable where hardly a sample lies behind
SLOPED = 0.04  # share of the rise in contact by which the force changes before contact where the baseline slopes
CONTACT_SLOPE = 0.35  # of the slope in contact: a steeper beginning may be contact itself
HINGED = 0.25  # share of the variance that two straight lines may leave


@dataclass(frozen=True, eq=False)
class Ramp:
    """The loading part of a record.

    Attributes
    ----------
    record : RawRecord
    low, high, stop : int
        Samples with 20 % and 80 % of the force, and the first sample after the loading.
    length : int
        Samples that the filter covers.
    velocity : float, mm/s
        Mean velocity between `low` and `high`.
    displacement, force : array (n,), mm and mN
        The whole record, filtered (Savitzky-Golay, quadratic, without shift in time).
    rest : float, mN
        Median force of the first samples.
    peak : float, mN
        Largest filtered force until `stop`, above `rest` and the slope of the baseline.
    slope : float, mN/mm
        Slope of a baseline that rises or falls clearly over the travel before contact; 0 where none does.
    pauses : tuple of (begin, end)
        Samples between `low` and `high` during which the stage stays, as in a test of steps and holds.
    held : tuple of (begin, end)
        Samples after the loading during which a controlled force is held, and the displacement creeps; (0, 0) where none is.
    """

    record: RawRecord
    low: int
    high: int
    stop: int
    length: int
    velocity: float
    displacement: Array
    force: Array
    rest: float
    peak: float
    slope: float = 0.0
    pauses: tuple[tuple[int, int], ...] = ()
    held: tuple[int, int] = (0, 0)

    @property
    def raised(self) -> Array:
        """The filtered force (n,), mN, above `rest` and the slope of the baseline."""
        return self.force - self.rest - self.slope * (self.displacement - self.displacement[0])

    @property
    def samples(self) -> float:
        """Number of samples of the whole ramp, estimated from its duration."""
        return self.duration / self.record.interval

    @property
    def duration(self) -> float:
        """Duration of the whole ramp without pauses, s, by the time in which the force rises from 20 % to 80 %."""
        paused = sum(end - begin for begin, end in self.pauses) * self.record.interval if self.pauses else 0.0
        return float(self.record.time[self.high] - self.record.time[self.low] - paused) / 0.6

    @property
    def last(self) -> Ramp:
        """The last stage of a ramp with pauses; the ramp itself where it has none."""
        if not self.pauses:
            return self
        begin = self.pauses[-1][1]
        low, high = (begin + round(share * (self.stop - begin)) for share in (0.2, 0.8))
        return self if high - low < SHORTEST_FILTER else replace(self, low=low, high=high, pauses=())


def find_ramp(record: RawRecord, filter_share: float = FILTER) -> Ramp:
    """The `Ramp` of a raw record: the force rises from 20 % to 80 % in it; the loading ends where the stage then stops or turns.

    Parameters
    ----------
    record : RawRecord
    filter_share : float
        Length of the filter over the duration of the ramp.

    Returns
    -------
    Ramp

    Raises
    ------
    RecordError
        The force does not rise, or the displacement falls while the force rises.
    """
    size, slope = min(9, record.force.size), baseline_slope(record)
    force = median_filter(record.force, size=size, mode="nearest")
    if slope:
        travel = median_filter(record.displacement, size=size, mode="nearest")
        force = force - slope * (travel - travel[0])
    rest = float(np.median(force[: max(10, min(50, force.size // 20))]))
    low, high = _rise(record, force - rest)
    high = _in_last_stage(record.displacement, force, low, high)
    pauses = pauses_between(record.displacement, force, low, high)
    samples = (high - low - sum(end - begin for begin, end in pauses)) / 0.6
    if samples < FEWEST:
        raise RecordError(f"{record.name}: the ramp has about {samples:.0f} samples; it needs {FEWEST}, record at a higher rate")
    displacement, smooth = (filtered(channel, filter_share * samples) for channel in (record.displacement, record.force))
    paused = sum(end - begin for begin, end in pauses) * record.interval if pauses else 0.0
    velocity = float((displacement[high] - displacement[low]) / (record.time[high] - record.time[low] - paused))
    if velocity <= 0:
        raise RecordError(
            f"{record.name}: the displacement goes backwards ({quantity(velocity, 'mm', 3)}/s) while the force rises; "
            "it must rise into the sample, change record.displacement.sign"
        )
    noise = 1.5 * noise_of(record.force) / float(np.sqrt(odd(filter_share * samples)))
    held = _held(record, displacement, smooth, high, samples, noise)
    stop = held[0] + 1 if any(held) else _end(record, displacement, velocity, high, samples)
    length = odd(filter_share * samples)
    ramp = Ramp(record, low, high, stop, length, velocity, displacement, smooth, rest, 0.0, slope, pauses, held)
    return replace(ramp, peak=float(ramp.raised[low:stop].max()))


def pauses_between(displacement: Array, force: Array, low: int, high: int) -> tuple[tuple[int, int], ...]:
    """Begin and end of the parts between two samples during which the stage stays; none where noise hides them.

    The force (n,), mN, does not rise in them: it would where the displacement (n,), mm, is at the end of its range.
    """
    part = displacement[low : high + 1]
    window = max(SHORTEST_FILTER, round(PAUSED * part.size))
    if part.size < 4 * window:
        return ()
    travel, noise = float(np.ptp(part)), noise_of(part)
    within = max(STAYS * travel, 6 * noise)
    if within > 0.25 * PAUSED * travel:
        return ()
    still = np.abs(part[window:] - part[:-window]) < within
    edges = np.flatnonzero(np.diff(np.concatenate([[0], still.astype(int), [0]])))
    parts = [(low + int(begin), low + int(end) - 1 + window) for begin, end in zip(edges[::2], edges[1::2], strict=True)]
    rise = RISES * float(np.ptp(force[low : high + 1]))
    return tuple((begin, end) for begin, end in parts if force[end] - force[begin] < rise)


def baseline_slope(record: RawRecord) -> float:
    """Slope of the force over the travel before contact, mN/mm, by two straight lines; 0 where it is small or may be contact."""
    deepest = int(np.argmax(record.displacement)) + 1
    thin = max(1, deepest // HINGE_SAMPLES)
    count = deepest // thin * thin
    x, force = (values[:count].reshape(-1, thin).mean(axis=1) for values in (record.displacement, record.force))
    span = float(np.ptp(x))
    if x.size < FEWEST or span == 0:
        return 0.0
    x = (x - x.min()) / span
    places = np.linspace(0.1, 0.95, HINGES)
    squares, slopes, added = _hinges(x, force, places)
    best = int(np.argmin(squares))
    square, slope, more, place = (float(values[best]) for values in (squares, slopes, added, places))
    slight = abs(slope) * place < SLOPED * more * (1 - place) or abs(slope) > CONTACT_SLOPE * more
    return 0.0 if slight or square > HINGED * float(np.sum((force - force.mean()) ** 2)) else slope / span


def _hinges(x: Array, force: Array, places: Array) -> tuple[Array, Array, Array]:
    """Two straight lines that meet at each of the places (m,): sums of squares, slopes of the first, and what the second adds."""
    beyond = np.maximum(x - places[:, None], 0.0)
    terms = np.stack([np.ones_like(beyond), np.broadcast_to(x, beyond.shape), beyond], axis=1)
    square = terms @ terms.transpose(0, 2, 1) + HINGE_RIDGE * x.size * np.eye(3)
    values = np.linalg.solve(square, (terms @ force)[:, :, None])[:, :, 0]
    residual = force - (values[:, None, :] @ terms)[:, 0]
    return np.einsum("ij,ij->i", residual, residual), values[:, 1], values[:, 2]


def steady_end(ramp: Ramp) -> int:
    """The sample after which the stage clearly slows down before it stops or turns; `ramp.stop` where it stops at once.

    A sample that relaxes resists less there than at the velocity before, at the same depth.
    """
    record, width = ramp.record, max(FEWEST_STEADY, round(STEADY * ramp.samples))
    part = record.displacement[ramp.last.low : ramp.stop]
    between = ramp.last.high - ramp.last.low - width
    if part.size < 4 * width or between < width:
        return ramp.stop
    velocity = (part[width:] - part[:-width]) / width
    usual = float(np.median(velocity[:between]))
    if usual <= 0 or 1.5 * noise_of(record.displacement) / width > 0.1 * usual:
        return ramp.stop
    steady = np.flatnonzero(velocity >= (1 - SAME_VELOCITY) * usual)
    end = ramp.last.low + int(steady[-1]) + width if steady.size else ramp.stop
    slows = ramp.stop - end > width and float(velocity[-width:].min()) < SLOW * usual
    return max(end, ramp.high) if slows else ramp.stop


def constant_velocity(ramp: Ramp, start: int) -> tuple[slice, float]:
    """The longest section of a ramp in which the velocity is constant within 15 %.

    Parameters
    ----------
    ramp : Ramp
    start : int
        First sample to look at: that of contact.

    Returns
    -------
    slice, float
        The samples of the section, and its velocity in mm/s; where none covers a fifth of the ramp, those between 20 % and 80 % of
        the force.
    """
    record = ramp.record
    length = min(odd(VELOCITY_FILTER * ramp.samples), len(record.time))
    velocity = savgol_filter(record.displacement, length, 1, deriv=1, delta=record.interval)
    moves = np.ones(velocity.size, dtype=bool)
    for begin, end in ramp.pauses:
        moves[begin:end] = False
    usual = float(np.median(velocity[ramp.low : ramp.high][moves[ramp.low : ramp.high]]))
    steady = np.abs(velocity[start : ramp.stop] - usual) <= SAME_VELOCITY * abs(usual)
    begin, end = longest_run(steady)
    if end - begin < max(FEWEST / 2, 0.2 * ramp.samples):
        begin, end = max(ramp.low - start, 0), ramp.high - start
    window = slice(start + begin, start + end)
    slope = np.polyfit(record.time[window] - record.time[window.start], record.displacement[window], 1)[0]
    return window, float(slope)


def filtered(values: Array, length: float) -> Array:
    """Values (n,) after a Savitzky-Golay filter, quadratic and without shift in time, over about `length` samples.

    It is SciPy's `savgol_filter`, whose least squares take more time than the filter does; those of a parabola are known.
    """
    length = min(odd(length), values.size - 1 + values.size % 2)
    half = length // 2
    age = np.arange(-half, half + 1.0)
    second, fourth = float(np.sum(age**2)), float(np.sum(age**4))
    smooth = convolve1d(
        np.asarray(values, dtype=float), (fourth - second * age**2) / (length * fourth - second**2), mode="constant"
    )
    for part, inside in ((slice(None, length), slice(None, half)), (slice(-length, None), slice(-half, None))):
        smooth[inside] = _parabola(age, values[part], second, fourth)[inside]
    return smooth


def _parabola(age: Array, values: Array, second: float, fourth: float) -> Array:
    """The parabola of least squares of values (n,) at ages (n,) about 0; second, fourth: the sums of the ages' powers."""
    count, slope = age.size, float(age @ values) / second
    total, square = float(values.sum()), float(age**2 @ values)
    determinant = count * fourth - second**2
    return (total * fourth - square * second) / determinant + slope * age + (count * square - second * total) / determinant * age**2


def odd(length: float) -> int:
    """The odd number of samples that is nearest to the length of a filter."""
    return max(SHORTEST_FILTER, 2 * round((length - 1) / 2) + 1)


def _rise(record: RawRecord, force: Array) -> tuple[int, int]:
    """The samples where the force last passes 20 % of its largest value and then first reaches 80 %."""
    _require_contact(record, force)
    peak = float(force.max())
    high = int(np.argmax(force >= 0.8 * peak))
    below = np.flatnonzero(force[:high] < 0.2 * peak)
    if not below.size:
        raise RecordError(
            f"{record.name}: no baseline: the indenter is in contact from the first sample on; start recording before contact"
        )
    return int(below[-1]), high


def _in_last_stage(displacement: Array, force: Array, low: int, high: int) -> int:
    """The sample `high`, or one in the last step of a test in steps and holds, where the stage goes on from a pause after it."""
    deepest = float(displacement.max())
    travel = deepest - float(displacement[low])
    top = int(np.argmax(displacement >= deepest - STAYS * travel))
    if top <= high or displacement[high:top].min(initial=deepest) < displacement[high] - 4 * STAYS * travel:
        return high
    later = [end for _, end in pauses_between(displacement, force, low, top) if high < end < top - SHORTEST_FILTER]
    if not later or force[top] < force[high : later[-1]].max():
        return high
    return later[-1] + round(0.8 * (top - later[-1]))


def _require_contact(record: RawRecord, force: Array) -> None:
    """Refuse a force that does not rise clearly above its noise, or that falls instead."""
    deepest = int(np.argmax(record.displacement))
    noise, peak = noise_of(record.force), float(force.max())
    lowest = float(force[: deepest + 1].min())
    pressed = float(np.median(force[max(0, deepest - deepest // 20) : deepest + 1]))  # where the indenter is deepest
    if peak >= 8 * noise and peak >= 0.5 * -lowest:
        return
    if -lowest > max(8 * noise, 2 * peak) and pressed < 0.5 * lowest:
        raise RecordError(
            f"{record.name}: the force falls to {quantity(lowest, 'mN', 3)} under load; "
            "compression is positive, change record.force.sign"
        )
    raise RecordError(
        f"{record.name}: no contact: the force never rises clearly above its noise "
        f"(by {quantity(max(peak, 0), 'mN', 3)}, noise {quantity(noise, 'mN', 3)}); check the channel, or remove the record"
    )


def noise_of(values: Array) -> float:
    """Standard deviation of white noise in slowly changing values (n,), from their second differences, robust against steps."""
    second = np.diff(values, 2)
    return float(np.median(np.abs(second - np.median(second))) / 0.6745 / np.sqrt(6)) if second.size else 0.0


def _end(record: RawRecord, displacement: Array, velocity: float, high: int, samples: float) -> int:
    """Index after the last sample of loading: the deepest place of the stage once the stage has slowed down after `high`."""
    step = max(1, round(0.05 * samples))
    ahead = displacement[high + step :] - displacement[high : displacement.size - step]
    slow = np.flatnonzero(ahead < 0.3 * velocity * step * record.interval)
    if not slow.size:
        return displacement.size
    begin = high + int(slow[0])
    near = displacement[begin : begin + 3 * step]
    return begin + int(np.argmax(near >= near.max() - 0.005 * velocity * samples * record.interval)) + 1


def _held(record: RawRecord, displacement: Array, force: Array, high: int, samples: float, noise: float) -> tuple[int, int]:
    """First sample, and that after the last, of a controlled force that is held while the displacement creeps; (0, 0) without one.

    A stage that stops ends the creep, and one that goes on raises the force.

    displacement, force (n,), mm and mN: filtered, the force with a standard deviation `noise`, mN.
    """
    none, rise = (0, 0), float(force[high:].max() - force[:high].min())
    within = PLATEAU * rise
    near = force[high:] >= force[high:].max() - within - 2 * BY_NOISE * noise
    begin = high + int(np.argmax(near))
    end = high + int(np.argmin(np.append(near[begin - high :], False))) + begin - high
    level = float(np.median(force[begin:end]))
    begin = begin + int(np.argmax(force[begin:end] >= level - within))
    rounds = round(0.5 * FILTER * samples)  # samples at a corner that the filter rounds
    inside = slice(begin + rounds, end if end == force.size else end - rounds)
    third = (inside.stop - inside.start) // 3
    if end - begin < HELD * samples or third < SHORTEST_FILTER or begin <= high:
        return none
    changes, blurs = [], []
    for values in (displacement, record.force):
        part = values[inside]
        changes.append(float(part[-third:].mean() - part[:third].mean()))
        blurs.append(noise_of(values) * float(np.sqrt(2 / third)))
    creep = changes[0] - BY_NOISE * blurs[0]
    stiffness = (level - force[high]) / max(float(displacement[begin] - displacement[high]), 1e-300)
    held = abs(changes[1]) < min(RISES_LESS * stiffness * creep, within) + BY_NOISE * blurs[1] < stiffness * creep
    repeats = np.count_nonzero(np.diff(record.force[begin:end]) == 0)  # at the end of the sensor's range
    creeps = creep > CREEP * float(displacement[begin] - displacement[:high].min())
    return (begin, end) if held and creeps and repeats < REPEATS * (end - begin) else none


def longest_run(steady: Bools) -> tuple[int, int]:
    """First sample of the longest run of True, and the sample after the last; (0, 0) where nothing is True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], steady.astype(int), [0]])))
    if not edges.size:
        return 0, 0
    begins, ends = edges[::2], edges[1::2]
    longest = int(np.argmax(ends - begins))
    return int(begins[longest]), int(ends[longest])
