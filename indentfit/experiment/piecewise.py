"""A baseline and a polynomial that leaves it at the contact point, fitted to the approach and the loading by least squares.

The polynomial has the powers of the end of the indenter (`POWERS`). The baseline is constant, with a drift where it is long enough
to tell drift from contact; where the force before contact shows it, it dies out in time (`decay`) or waves with the travel
(`waves`), as interference of the laser does in liquid; `baselines` chooses among them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg.lapack import dgesv  # a tenth of the time of NumPy's solution of a few equations
from scipy.optimize import minimize_scalar

from indentfit.arrays import Array
from indentfit.experiment.loading import Ramp, filtered, noise_of, odd, steady_end
from indentfit.experiment.noise import CorrelatedNoise, covariance, noise_in

POWERS = {"flat": (1.0, 2.0), "sphere": (1.5, 2.5), "cone": (1.5, 2.0)}  # of the displacement beyond contact, for each end
MOST_SAMPLES = 4000  # in a fit: longer stretches are thinned by block means
SEARCHED = 600  # samples of the search for the contact point
GRIDDED = 300  # samples of the grid
BASELINE = 3.0  # length of the baseline that is used, in durations of the ramp
DRIFTS = 0.25  # durations of the ramp that a baseline lasts whose drift is told from contact
GRID = 50  # contact points that are tried before the search
BLOCKS = (500, 120)  # numbers of block means whose noise is looked at too: slow noise under white noise
SLIGHT = 0.03  # share of the force of a power that is nearly zero
RIDGE = 1e-13  # keeps normal equations solvable
SHORTEST = 1e-150  # length of a column whose square is a number still
CLEARLY = 1.2  # ratio of variances from which that of block means counts
SHARP = 0.0005  # share of the ramp's travel: noise of the travel that is left where it is filtered
HARMONICS = 50  # of the error of rounding
POLISHING = 8  # steps of Gauss and Newton


@dataclass(frozen=True, eq=False)
class Stretch:
    """The part of a record in which the contact point is searched for: baseline and loading, thinned to a few thousand samples.

    time s, displacement (filtered) mm, force mN: (n,); half: sample with half of the force; length: samples that the filter covers;
    quiet: number of samples at the start that surely lie before contact; blur: standard error of the filtered displacement, mm;
    drifts: whether the baseline is long enough to tell drift from contact; short: whether it is shorter than the ramp;
    step: of the force's converter, mN, 0 where it is fine.
    """

    time: Array
    displacement: Array
    force: Array
    half: int
    length: int
    quiet: int
    blur: float
    drifts: bool
    short: bool = False
    step: float = 0.0

    def until(self, stop: int) -> Stretch:
        """The stretch up to a sample."""
        return replace(
            self,
            time=self.time[:stop],
            displacement=self.displacement[:stop],
            force=self.force[:stop],
            half=min(self.half, stop - 1),
        )

    def thinned(self, most: int) -> Stretch:
        """The stretch by block means of no more than so many samples."""
        thin = -(-self.time.size // most)
        if thin < 2:
            return self
        count = self.time.size // thin * thin
        time, displacement, force = (
            values[self.time.size - count :].reshape(-1, thin).mean(axis=1) for values in (self.time, self.displacement, self.force)
        )
        return replace(
            self,
            time=time,
            displacement=displacement,
            force=force,
            half=min(max(self.half // thin, 1), time.size - 1),
            length=odd(self.length / thin),
        )


@dataclass(frozen=True)
class Baseline:
    """The form of the force without contact.

    kind: "constant", "drift" (in time), "decay" (drift that dies out) or "waves" (drift, and waves in the travel); scale: time
    constant of the decay, s, or period of the waves, mm.
    """

    kind: str = "constant"
    scale: float = 0.0

    def terms(self, time: Array, displacement: Array) -> Array:
        """Columns (n, .) of the baseline's linear coefficients."""
        columns = [np.ones_like(time), *([time] if self.kind in ("drift", "waves") else [])]
        return np.column_stack([*columns, *self.more(time, displacement).T])

    def more(self, time: Array, displacement: Array) -> Array:
        """Columns (n, .) of the decay or the waves."""
        if self.kind == "decay":
            return np.exp(-(time - time[0]) / self.scale)[:, None]
        if self.kind == "waves":
            angle = 2 * np.pi * displacement / self.scale
            return np.column_stack([np.cos(angle), np.sin(angle)])
        return np.zeros((time.size, 0))

    def by_scale(self, time: Array, displacement: Array, coefficients: Array) -> Array:
        """Derivative of the force (n,) by the scale."""
        if self.kind == "decay":
            age = time - time[0]
            return coefficients[1] * np.exp(-age / self.scale) * age / self.scale**2
        angle = 2 * np.pi * displacement / self.scale
        return (coefficients[2] * np.sin(angle) - coefficients[3] * np.cos(angle)) * angle / self.scale


@dataclass(frozen=True, eq=False)
class Piecewise:
    """Baseline and polynomial with a contact point, fitted to a stretch.

    contact, stderr: mm; coefficients: of the baseline's terms, then one for each power; residual (n,), mN; noise: that of the
    residual; spread: covariance of the coefficients and the contact point; rounding: the share of stderr, mm, by the converter.
    """

    stretch: Stretch
    powers: tuple[float, ...]
    baseline: Baseline
    contact: float
    stderr: float
    coefficients: Array
    residual: Array
    noise: CorrelatedNoise
    spread: Array
    rounding: float = 0.0

    def free(self, time: Array, displacement: Array) -> Array:
        """The force without contact (n,), mN, at times and displacements."""
        terms = self.baseline.terms(np.append(self.stretch.time[0], time), np.append(0.0, displacement))[1:]
        return terms @ self.coefficients[: terms.shape[1]]

    def free_error(self) -> float:
        """Standard error of the force without contact at the end of the stretch, mN."""
        last = self.baseline.terms(self.stretch.time[[0, -1]], self.stretch.displacement[[0, -1]])[-1]
        return float(np.sqrt(max(last @ self.spread[: last.size, : last.size] @ last, 0.0)))


def stretch_of(ramp: Ramp) -> Stretch:
    """The `Stretch` of a ramp: of the measured samples, also where the ramp's record is interpolated at even steps of time.

    It ends where the stage slows down before it stops: what relaxes has lower forces there, which would move contact.
    """
    record, samples, stop = ramp.record, ramp.samples, steady_end(ramp)
    first = max(0, round(ramp.low - (BASELINE + 0.5) * samples))
    part = slice(first, stop)
    columns = _measured(ramp, part, _sharp(ramp, part))
    length = ramp.length * columns.shape[1] / (stop - first)
    risen = np.flatnonzero(ramp.raised[part] >= 0.5 * ramp.peak)
    low, half = np.searchsorted(columns[0], record.time[[ramp.low, first + risen[0] if risen.size else stop - 1]])
    thin = max(1, -(-columns.shape[1] // MOST_SAMPLES))
    count = columns.shape[1] // thin
    time, displacement, force = columns[:, columns.shape[1] - count * thin :].reshape(3, count, thin).mean(axis=2)
    # a quadratic filter of m points leaves 9 / (4 m) of the variance of white noise, and removes vibration
    blur = 1.5 * noise_of(record.displacement[part]) / np.sqrt(ramp.length)
    before = (ramp.low - first - 0.2 * samples) / samples
    return Stretch(
        time,
        displacement,
        force,
        int(min(half // thin, count - 1)),
        odd(length / thin),
        max(5, int(low) // thin // 2),
        float(blur),
        bool(before >= DRIFTS),
        bool(before < 1),
        step_of(columns[2]),
    )


def _sharp(ramp: Ramp, part: slice) -> Array:
    """The displacement (n,), mm, of the whole record by the shortest filter that its noise needs, at most that of the ramp.

    A stage that is led by the force moves at once far after contact: a long filter would round this corner, and move contact.
    """
    record = ramp.record
    needed = (1.5 * noise_of(record.displacement[part]) / (SHARP * abs(ramp.velocity) * ramp.duration)) ** 2
    if needed < 1:
        return record.displacement
    return filtered(record.displacement, needed) if needed < ramp.length else ramp.displacement


def _measured(ramp: Ramp, part: slice, displacement: Array) -> Array:
    """Times, s, displacements, mm, and forces, mN, (3, n) of the measured samples in a part of a ramp's record.

    Interpolated forces between two samples far apart depend on each other, and a fit would take them for slow noise.
    """
    record = ramp.record
    if record.uneven is None:
        return np.array([record.time[part], displacement[part], record.force[part]])
    time = record.uneven.time
    inside = (time >= record.time[part.start]) & (time <= record.time[part.stop - 1])
    return np.array([time[inside], np.interp(time[inside], record.time, displacement), record.uneven.force[inside]])


def step_of(force: Array) -> float:
    """Step of the converter, mN, where it is coarse: few values, or many samples that do not change; 0 where it is fine."""
    changes = np.abs(np.diff(force))
    changes = changes[changes > 1e-9 * float(np.ptp(force))]
    if changes.size > 0.7 * (force.size - 1) or not changes.size:
        return 0.0
    return float(np.quantile(changes, 0.02))


# The fit


def fit_of(stretch: Stretch, powers: tuple[float, ...], baseline: Baseline) -> Piecewise:
    """The fit of least squares: the contact point by search, everything else by a linear solve."""
    place, baseline = _polished(_place(stretch, powers, baseline), stretch, powers, baseline)
    terms, coefficients, jacobian = solution(place, stretch, powers, baseline)
    residual = stretch.force - terms @ coefficients
    noise = noise_in(residual)
    spread = _spread(jacobian, residual, noise)
    rounding = _rounding(stretch, jacobian, place, residual)
    stderr = float(np.sqrt(max(spread[-1, -1], 0.0) + stretch.blur**2 + rounding**2))
    return Piecewise(stretch, powers, baseline, float(place), stderr, coefficients, residual, noise, spread, rounding)


def _spread(jacobian: Array, residual: Array, noise: CorrelatedNoise) -> Array:
    """Covariance of the values of a fit: of the samples, or of their block means where slow noise makes it larger there."""
    widest = covariance(jacobian, noise) * _lost(residual.size, jacobian.shape[1], independent(noise))
    for count in BLOCKS:
        thin = residual.size // count
        if thin < 2:
            continue
        kept = residual.size // thin * thin
        means = residual[:kept].reshape(-1, thin).mean(axis=1)
        rows = jacobian[:kept].reshape(-1, thin, jacobian.shape[1]).mean(axis=1)
        slow = noise_in(means)
        spread = covariance(rows, slow) * _lost(means.size, rows.shape[1], independent(slow))
        if np.inf > spread[-1, -1] > CLEARLY * widest[-1, -1]:  # the last few samples, in no block, may be all that are in contact
            widest = spread
    return widest


def solution(place: float, stretch: Stretch, powers: tuple[float, ...], baseline: Baseline) -> tuple[Array, Array, Array]:
    """Terms (n, .) with the contact point at `place`, coefficients, and the Jacobian, whose last columns are scale and place."""
    terms = _terms(place, stretch, powers, baseline)
    coefficients = _coefficients(terms, stretch.force, len(powers))
    scale = [baseline.by_scale(stretch.time, stretch.displacement, coefficients)] if baseline.scale else []
    columns = np.delete(terms, _bounded(place, stretch, powers, coefficients), axis=1)
    return terms, coefficients, np.column_stack([columns, *scale, _by_place(stretch.displacement - place, powers, coefficients)])


def _bounded(place: float, stretch: Stretch, powers: tuple[float, ...], coefficients: Array) -> list[int]:
    """The column of the first power where that is zero or nearly: it would change the force as the contact point does."""
    depth = max(float(stretch.displacement.max()) - place, 0.0)
    shares = coefficients[-len(powers) :] * depth ** np.array(powers)
    alike = len(powers) > 1 and powers[1] == powers[0] + 1 and shares[0] < SLIGHT * abs(float(shares.sum()))
    return [coefficients.size - len(powers)] if alike else []


def _polished(place: float, stretch: Stretch, powers: tuple[float, ...], baseline: Baseline) -> tuple[float, Baseline]:
    """Contact point and baseline after steps of Gauss and Newton for both, where the baseline has a scale."""
    square = _misfit(place, stretch, powers, baseline) if baseline.scale else 0.0
    for _ in range(POLISHING * bool(baseline.scale)):
        terms, coefficients, jacobian = solution(place, stretch, powers, baseline)
        step = solved(jacobian, stretch.force - terms @ coefficients)[-2:]
        scale = baseline.scale + float(np.clip(step[0], -0.2 * baseline.scale, 0.2 * baseline.scale))
        moved, rival = place + float(step[1]), replace(baseline, scale=scale)
        smaller = _misfit(moved, stretch, powers, rival) if stretch.displacement.min() < moved else np.inf
        if smaller > square * (1 - 1e-6):
            break
        place, baseline, square = moved, rival, smaller
    return place, baseline


def _lost(samples: int, values: int, free: float) -> float:
    """Ratio of variances: fitted values take their share of the independent samples, and not of all samples."""
    return max(1.0, free / max(free - values, 1.0) * (samples - values) / samples)


def independent(noise: CorrelatedNoise) -> float:
    """How many independent samples hold as much as those of a correlated noise."""
    n = noise.correlation.size
    return n / max(1.0, 1 + 2 * float(np.sum(noise.correlation[1 : n // 4] * (1 - np.arange(1, n // 4) / n))))


def _rounding(stretch: Stretch, jacobian: Array, place: float, residual: Array) -> float:
    """Standard error of the contact point, mm, because a converter rounds the forces of a quiet baseline to one value.

    Noise of the size of a step makes the mean of rounded forces right (dither; Widrow, Kollar 2008, Quantization Noise).
    """
    if not stretch.step:
        return 0.0
    before = stretch.displacement < place
    lengths = np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300)
    shift = float((np.linalg.pinv(jacobian / lengths) @ before.astype(float))[-1] / lengths[-1])
    scatter = float(np.var(residual[before])) if before.any() else 0.0
    return abs(shift) * rounded(stretch.step, scatter)


def rounded(step: float, scatter: float) -> float:
    """Standard error, mN, of the mean of forces that a converter rounds to a step, mN; scatter: variance of the forces, mN^2."""
    dither = max(scatter - step**2 / 12, 0.0) / step**2  # variance of the noise before it was rounded, in steps
    orders = np.arange(1, HARMONICS + 1)
    left = float(np.sum(np.exp(-((2 * np.pi * orders) ** 2) * dither) / (2 * (np.pi * orders) ** 2)))
    return step * float(np.sqrt(left))


def _places(stretch: Stretch) -> Array:
    x = stretch.displacement
    return np.linspace(x.min(), x[stretch.half], GRID)


def _place(stretch: Stretch, powers: tuple[float, ...], baseline: Baseline) -> float:
    """Displacement of least misfit, mm: the best of a grid, then a bounded search about it, in thinned samples and in all."""
    coarse = stretch.thinned(SEARCHED)
    places = _places(coarse)
    best = int(np.argmin(_misfits(places, stretch.thinned(GRIDDED), powers, baseline)))
    bounds = float(places[max(best - 1, 0)]), float(places[min(best + 1, GRID - 1)])
    place = _searched(coarse, powers, baseline, bounds)
    if coarse is stretch:
        return place
    reach = 0.15 * (bounds[1] - bounds[0])
    return _searched(stretch, powers, baseline, (max(bounds[0], place - reach), min(bounds[1], place + reach)))


def _searched(stretch: Stretch, powers: tuple[float, ...], baseline: Baseline, bounds: tuple[float, float]) -> float:
    tolerance = 1e-6 * float(np.ptp(stretch.displacement))
    arguments = (stretch, powers, baseline.terms(stretch.time, stretch.displacement))
    return float(minimize_scalar(_squares, bounds=bounds, args=arguments, method="bounded", options={"xatol": tolerance}).x)


def _by_place(beyond: Array, powers: tuple[float, ...], coefficients: Array) -> Array:
    """Derivative of the model's force (n,) by the contact point; beyond: displacement less that of contact (n,), mm."""
    inside, touching = np.maximum(beyond, 0.0), np.heaviside(beyond, 0.0)
    terms = [m * c * inside ** (m - 1) for m, c in zip(powers, coefficients[-len(powers) :], strict=True)]
    return -touching * sum(terms)


def _terms(place: float, stretch: Stretch, powers: tuple[float, ...], baseline: Baseline) -> Array:
    """Columns of the linear part (n, .): the baseline's, and powers of the displacement beyond contact."""
    return _joined(place, stretch, powers, baseline.terms(stretch.time, stretch.displacement))


def _joined(place: float, stretch: Stretch, powers: tuple[float, ...], base: Array) -> Array:
    """Columns of a baseline (n, .), and powers of the displacement beyond contact."""
    beyond = np.maximum(stretch.displacement - place, 0.0)
    count = base.shape[1]
    rows = np.empty((count + len(powers), beyond.size))
    rows[:count] = base.T
    for row, power in enumerate(powers, start=count):
        rows[row] = _raised(beyond, power)
    return rows.T


def _raised(values: Array, power: float) -> Array:
    """Values to a power of 1, 1.5, 2 and so on, by products and a root: a tenth of the time of a general power."""
    whole, raised = int(power), values
    for _ in range(whole - 1):
        raised = raised * values
    return raised if power == whole else raised * np.sqrt(values)


def _misfit(place: float, stretch: Stretch, powers: tuple[float, ...], baseline: Baseline) -> float:
    """Sum of squares, mN^2, with the contact point at `place`."""
    return _squares(place, stretch, powers, baseline.terms(stretch.time, stretch.displacement))


def _squares(place: float, stretch: Stretch, powers: tuple[float, ...], base: Array) -> float:
    """Sum of squares, mN^2, with the contact point at `place` and the columns of a baseline (n, .)."""
    terms = _joined(place, stretch, powers, base)
    residual = stretch.force - terms @ _coefficients(terms, stretch.force, len(powers))
    return float(residual @ residual)


def _misfits(places: Array, stretch: Stretch, powers: tuple[float, ...], baseline: Baseline) -> Array:
    """Sums of squares, mN^2, with the contact point at each of the places (m,), by normal equations for all of them at once."""
    base, force = baseline.terms(stretch.time, stretch.displacement), stretch.force
    count, width = base.shape[1], base.shape[1] + len(powers)
    beyond = np.maximum(stretch.displacement[None, :] - places[:, None], 0.0)
    rows = np.stack([_raised(beyond, power) for power in powers], axis=1)
    square, right = np.empty((places.size, width, width)), np.empty((places.size, width))
    square[:, :count, :count], square[:, count:, :count] = base.T @ base, rows @ base
    square[:, :count, count:] = square[:, count:, :count].transpose(0, 2, 1)
    square[:, count:, count:] = rows @ rows.transpose(0, 2, 1)
    right[:, :count], right[:, count:] = base.T @ force, rows @ force
    lengths = np.maximum(np.sqrt(square[:, np.arange(width), np.arange(width)]), SHORTEST)
    square, right = square / (lengths[:, :, None] * lengths[:, None, :]) + RIDGE * np.eye(width), right / lengths
    values = np.linalg.solve(square, right[:, :, None])[:, :, 0] / lengths
    residual = force - values[:, :count] @ base.T - (values[:, None, count:] @ rows)[:, 0]
    return np.asarray(np.einsum("ij,ij->i", residual, residual))


def _coefficients(terms: Array, force: Array, powers: int) -> Array:
    """Coefficients of least squares; that of the first power is not negative, because the force rises at contact.

    Normal equations whose diagonal is 1: columns that are alike share what they explain.
    """
    square, right = terms.T @ terms, terms.T @ force
    lengths = np.maximum(np.sqrt(np.diagonal(square)), SHORTEST)
    square, right = square / (lengths[:, None] * lengths), right / lengths
    square.flat[:: right.size + 1] += RIDGE
    coefficients = dgesv(square, right)[2]
    first = terms.shape[1] - powers
    if powers > 1 and coefficients[first] < 0:
        kept = np.arange(terms.shape[1]) != first
        coefficients = np.zeros(terms.shape[1])
        coefficients[kept] = dgesv(square[np.ix_(kept, kept)], right[kept])[2]
    return coefficients / lengths


def solved(terms: Array, values: Array) -> Array:
    """Coefficients (p,) of least squares of terms (n, p), whatever the units of the terms."""
    lengths = np.maximum(np.linalg.norm(terms, axis=0), 1e-300)
    return np.linalg.lstsq(terms / lengths, values, rcond=None)[0] / lengths
