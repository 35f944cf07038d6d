"""The contact point: the displacement at which the indenter first touches the sample, by published methods.

`piecewise` (the default): baseline and a polynomial that leaves the baseline at the contact point, by least squares (Rudoy et al.
2010, J R Stat Soc C 59:573; powers 1 and, for the tissue's stiffening, 2 for a flat punch; 1.5, as in Hertz's theory, and 2.5 for
a sphere). `threshold`: the filtered force exceeds the mean of the baseline by n standard deviations there, and stays above (Lin,
Dimitriadis, Horkay 2007, J Biomech Eng 129:430 review such rules). `variance_ratio`: the ratio of the variance of the force after
the point to the variance before it is largest (Gavara 2016, Sci Rep 6:21267). tests/campaigns/contact_point.py compares the
methods on simulated records; on this evidence `piecewise` is the default. The stated uncertainty presumes that the polynomial
holds: it does not cover a toe region, as a tilted or uneven sample has.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.signal import lfilter
from scipy.stats import norm

from indentfit.arrays import Array
from indentfit.errors import RecordError
from indentfit.experiment.loading import Ramp, filtered, noise_of, odd
from indentfit.experiment.noise import CorrelatedNoise, covariance, noise_in

CONFIDENCE = 0.95  # a stated uncertainty is half of this interval
POWERS = {"flat": (1.0, 2.0), "sphere": (1.5, 2.5), "cone": (1.5, 2.0)}  # of the displacement beyond contact, for each end
MOST_SAMPLES = 4000  # in a fit: longer stretches are thinned by block means
BASELINE = 3.0  # length of the baseline that is used, in durations of the ramp
GRID = 80  # contact points that are tried before the search
SHORTEST_TRAVEL = 0.01  # of the depth: a record with less of an approach begins in contact
SAME_SLOPE = 0.35  # of the force before and after the fitted contact point, in a record that begins in contact
PULL = 6.0  # standard deviations of the noise by which the force falls below the baseline where the sample pulls
TRIALS = 60  # simulated records that give the uncertainty of the methods `threshold` and `variance_ratio`
SIGMAS = 5.0  # standard deviations of the method `threshold`


@dataclass(frozen=True)
class ContactPoint:
    """The beginning of contact in a record.

    Attributes
    ----------
    displacement : float, mm
        Displacement of the record at contact.
    uncertainty : float, mm
        Half of the 95 % interval of the displacement.
    index : int
        First sample in contact.
    baseline : float, mN
        Force without contact at time 0 of the record.
    drift : float, mN/s
        Change of the force without contact.
    noise : float, mN
        Standard deviation of the force about the model.
    method : str
    """

    displacement: float
    uncertainty: float
    index: int
    baseline: float
    drift: float
    noise: float
    method: str


def find_contact_point(ramp: Ramp, method: str = "piecewise", indenter: str = "flat") -> ContactPoint:
    """The `ContactPoint` of a ramp.

    Parameters
    ----------
    ramp : Ramp
    method : str
        One of METHODS.
    indenter : str
        One of POWERS: "flat", "sphere", or "cone", which has a ball as its tip.

    Raises
    ------
    RecordError
        There is no contact.
    """
    return fitted_approach(ramp, indenter).point(method)


@dataclass(frozen=True, eq=False)
class Approach:
    """A ramp with the baseline and polynomial that were fitted to it."""

    ramp: Ramp
    stretch: _Stretch
    model: _Model

    def point(self, method: str) -> ContactPoint:
        """The `ContactPoint` by a method; RecordError where there is no contact."""
        _require_a_kink(self.ramp, self.stretch, self.model)
        return _point(self.ramp, self.stretch, self.model, method)

    def travel(self) -> float:
        """Displacement from the first sample to the fitted contact point, mm."""
        return self.model.contact - float(self.stretch.displacement.min())

    def depth(self) -> float:
        """Displacement from the fitted contact point to the deepest sample, mm."""
        return float(self.stretch.displacement.max()) - self.model.contact

    def is_missing(self) -> bool:
        """Whether the record begins in contact: no travel before the fitted contact point, or the force rises there already."""
        if self.travel() < max(SHORTEST_TRAVEL * self.depth(), 3 * self.model.stderr):
            return True
        x, force = self.stretch.displacement, self.stretch.force
        reach = min(self.travel(), self.depth())
        before, after = x < self.model.contact, (x >= self.model.contact) & (x <= self.model.contact + reach)
        if np.count_nonzero(before) < 5 or np.count_nonzero(after) < 5:
            return True
        slopes = [float(np.polyfit(x[part], force[part], 1)[0]) if np.ptp(x[part]) else 0.0 for part in (before, after)]
        rise = slopes[0] * self.travel()
        scatter = float(np.std(self.model.residual)) / np.sqrt(self.stretch.length)
        return slopes[0] > SAME_SLOPE * slopes[1] and rise > 4 * scatter

    def pull(self) -> float:
        """How far the force falls below the baseline close to contact, mN: an adhesive sample pulls; 0 where noise explains it."""
        x, place, depth = self.stretch.displacement, self.model.contact, self.depth()
        near = np.abs(x - place) < 0.3 * depth
        if min(np.count_nonzero(near), np.count_nonzero(~near)) < self.stretch.length:
            return 0.0
        coefficients = self.model.coefficients
        drift = coefficients[1] * self.stretch.time if self.stretch.drifts else 0.0
        above = filtered(self.stretch.force - coefficients[0] - drift, self.stretch.length)[near]
        scatter = filtered(self.model.residual, self.stretch.length)[
            ~near
        ].std()  # the ringing of a stage in motion counts as noise
        lowest = -float(above.min())
        return lowest if lowest > PULL * scatter else 0.0


def fitted_approach(ramp: Ramp, indenter: str) -> Approach:
    """The `Approach` of a ramp under the end of an indenter, "flat" or "sphere"."""
    stretch = _stretch(ramp)
    return Approach(ramp, stretch, _fit(stretch, POWERS[indenter]))


def _point(ramp: Ramp, stretch: _Stretch, model: _Model, method: str) -> ContactPoint:
    rule = METHODS[method]
    place = model.contact if rule is None else rule(stretch, stretch.force)
    uncertainty = _reach(model) if rule is None else _uncertainty(stretch, model, rule, place)
    behind = np.flatnonzero(ramp.displacement[: ramp.high] < place)
    index = int(behind[-1]) + 1 if behind.size else 0
    drift = float(model.coefficients[1]) if stretch.drifts else 0.0
    return ContactPoint(
        float(place), float(uncertainty), index, float(model.coefficients[0]), drift, float(np.std(model.residual)), method
    )


@dataclass(frozen=True, eq=False)
class _Stretch:
    """The part of a record in which the contact point is searched for: baseline and loading, thinned to a few thousand samples.

    time s, displacement (filtered) mm, force mN: (n,); half: sample with half of the force; length: samples that the filter covers;
    quiet: number of samples at the start that surely lie before contact; blur: standard error of the filtered displacement, mm;
    drifts: whether the baseline is long enough to tell drift from noise.
    """

    time: Array
    displacement: Array
    force: Array
    half: int
    length: int
    quiet: int
    blur: float
    drifts: bool


Rule = Callable[[_Stretch, Array], float]  # the displacement at contact, by a stretch and forces (n,) in place of its own


@dataclass(frozen=True, eq=False)
class _Model:
    """Baseline and polynomial with a contact point, fitted: coefficients (baseline, [drift], one for each power), residual (n,)."""

    powers: tuple[float, ...]
    contact: float
    stderr: float
    coefficients: Array
    residual: Array
    noise: CorrelatedNoise


def _stretch(ramp: Ramp) -> _Stretch:
    record, samples = ramp.record, ramp.samples
    first = max(0, round(ramp.low - (BASELINE + 0.5) * samples))
    thin = max(1, -(-(ramp.stop - first) // MOST_SAMPLES))
    part = slice(ramp.stop - (ramp.stop - first) // thin * thin, ramp.stop)
    time, displacement, force = (
        values[part].reshape(-1, thin).mean(axis=1) for values in (record.time, ramp.displacement, record.force)
    )
    low = (ramp.low - part.start) // thin
    risen = np.flatnonzero(filtered(ramp.force[part], ramp.length) - ramp.rest >= 0.5 * ramp.peak)
    half = int(min(risen[0] // thin if risen.size else len(time) - 1, len(time) - 1))
    # a quadratic filter of m points leaves 9 / (4 m) of the variance of white noise, and removes vibration
    blur = 1.5 * noise_of(record.displacement[part]) / np.sqrt(ramp.length)
    # a shorter baseline does not separate drift from noise, and drift is negligible in so short a time
    drifts = low - 0.2 * samples / thin >= samples / thin
    return _Stretch(time, displacement, force, half, odd(ramp.length / thin), max(5, low // 2), float(blur), bool(drifts))


def _fit(stretch: _Stretch, powers: tuple[float, ...]) -> _Model:
    """The _Model of least squares: the contact point by search, everything else by a linear solve."""
    x = stretch.displacement
    place = _place(stretch, powers)
    terms = _terms(place, stretch, powers)
    coefficients = np.asarray(np.linalg.lstsq(terms, stretch.force, rcond=None)[0], dtype=float)
    residual = stretch.force - terms @ coefficients
    noise = noise_in(residual)
    jacobian = np.column_stack([terms, _by_place(x - place, powers, coefficients)])
    spread = np.maximum(np.diag(covariance(jacobian, noise)), 1e-300)
    return _Model(powers, float(place), float(np.hypot(np.sqrt(spread[-1]), stretch.blur)), coefficients, residual, noise)


def _place(stretch: _Stretch, powers: tuple[float, ...]) -> float:
    """Displacement of least misfit, mm: the best of a grid, then a bounded search about it."""
    x = stretch.displacement
    places = np.linspace(x.min(), x[stretch.half], GRID)
    best = int(np.argmin([_misfit(place, stretch, powers) for place in places]))
    bounds = places[max(best - 1, 0)], places[min(best + 1, GRID - 1)]
    return minimize_scalar(_misfit, bounds=bounds, args=(stretch, powers), method="bounded", options={"xatol": 1e-5}).x


def _by_place(beyond: Array, powers: tuple[float, ...], coefficients: Array) -> Array:
    """Derivative of the model's force (n,) by the contact point; beyond: displacement less that of contact (n,), mm."""
    inside, touching = np.maximum(beyond, 0.0), np.heaviside(beyond, 0.0)
    terms = [m * c * inside ** (m - 1) for m, c in zip(powers, coefficients[-len(powers) :], strict=True)]
    return -touching * sum(terms)


def _terms(place: float, stretch: _Stretch, powers: tuple[float, ...]) -> Array:
    """Columns of the linear part (n, .): baseline, drift if the stretch drifts, powers of the displacement beyond contact."""
    beyond = np.maximum(stretch.displacement - place, 0.0)
    drift = [stretch.time] if stretch.drifts else []
    return np.column_stack([np.ones_like(beyond), *drift, *(beyond**m for m in powers)])


def _misfit(place: float, stretch: _Stretch, powers: tuple[float, ...]) -> float:
    """Sum of squares, mN^2, with the contact point at `place`."""
    terms = _terms(place, stretch, powers)
    residual = stretch.force - terms @ np.linalg.lstsq(terms, stretch.force, rcond=None)[0]
    return float(residual @ residual)


def _require_a_kink(ramp: Ramp, stretch: _Stretch, model: _Model) -> None:
    """Refuse a force that changes at one rate throughout: drift, or a record that begins in contact."""
    straight = np.column_stack([np.ones_like(stretch.time), stretch.time])
    rest = stretch.force - straight @ np.linalg.lstsq(straight, stretch.force, rcond=None)[0]
    if rest @ rest < 2 * (model.residual @ model.residual) and model.contact - stretch.displacement.min() < 3 * model.stderr:
        raise RecordError(
            f"{ramp.record.name}: no contact point: the force changes at one rate from the first sample on, because of drift or "
            "of contact throughout; start recording before contact, or remove the record"
        )
    powers = np.array(model.powers)
    if model.coefficients[-powers.size :] @ np.ptp(stretch.displacement) ** powers <= 0:
        raise RecordError(
            f"{ramp.record.name}: no contact point: the force does not rise with the displacement; check the channels"
        )


def _threshold(stretch: _Stretch, force: Array) -> float:
    """Displacement where the filtered force exceeds the baseline by 5 standard deviations for a filter's length."""
    smooth = filtered(force, stretch.length)
    time, quiet = stretch.time, stretch.quiet
    line = np.polyfit(time[:quiet], smooth[:quiet], 1 if stretch.drifts else 0)
    above = smooth - np.polyval(line, time)
    over = above > SIGMAS * max(float(np.std(above[:quiet])), 1e-9)
    held = np.convolve(over, np.ones(stretch.length), "full")[stretch.length - 1 :] >= stretch.length - 0.5
    return stretch.displacement[int(np.argmax(held))] if held.any() else stretch.displacement[stretch.half]


def _variance_ratio(stretch: _Stretch, force: Array) -> float:
    """Displacement with the largest ratio of the variances of the force in a window after it and in a window before it."""
    width = max(5, min(2 * stretch.length, stretch.quiet))
    first, second = (np.concatenate([[0.0], np.cumsum((force - force[0]) ** power)]) for power in (1, 2))
    mean, square = ((total[width:] - total[:-width]) / width for total in (first, second))
    variance = np.maximum(square - mean**2, 0.0)
    floor = 1e-6 * variance.max()
    ratio = variance[width:] / (variance[:-width] + floor)
    return stretch.displacement[width + int(np.argmax(ratio[: max(1, stretch.half - width)]))]


def _reach(model: _Model) -> float:
    """Half of the 95 % interval of the fitted contact point, mm."""
    return float(norm.ppf((1 + CONFIDENCE) / 2) * model.stderr)


def _uncertainty(stretch: _Stretch, model: _Model, rule: Rule, place: float) -> float:
    """Half of the 95 % interval of a rule, mm: bias and spread of the rule on records simulated from the fitted model."""
    scale, weights = model.noise.scale, model.noise.weights
    rng = np.random.default_rng(0)  # the same record gives the same uncertainty
    smooth = stretch.force - model.residual
    white = rng.standard_normal((TRIALS, 200 + scale.size))
    noise = lfilter([1.0], np.append(1.0, -weights), white, axis=1)[:, 200:]
    noise *= scale / noise.std()
    errors = [abs(rule(stretch, smooth + added) - model.contact) for added in noise]
    return max(float(np.quantile(errors, CONFIDENCE)), abs(place - model.contact)) + _reach(model)


# None: the fit of the model itself
METHODS: dict[str, Rule | None] = {"piecewise": None, "threshold": _threshold, "variance_ratio": _variance_ratio}
