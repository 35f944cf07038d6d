"""The contact point: the displacement at which the indenter first touches the sample, by published methods, with its uncertainty.

`piecewise` (the default): baseline and a polynomial that leaves it at the contact point, by least squares (Rudoy et al. 2010, J R
Stat Soc C 59:573; for a flat punch of degree 1, and 2 for the tissue's stiffening; for a sphere of degree 1.5, as Hertz has it,
and 2.5). `threshold`: where the filtered force exceeds the baseline's mean by n standard deviations and stays there (Lin,
Dimitriadis, Horkay 2007, J Biomech Eng 129:430 review such rules). `variance_ratio`: where the variance after a point most
exceeds that before it (Gavara 2016, Sci Rep 6:21267). tests/campaigns/contact_point.py compares them on simulated records; by its
evidence `piecewise` is the default. Its uncertainty takes the polynomial for granted: of a toe, as of a tilted or uneven sample,
it knows nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.signal import lfilter
from scipy.stats import norm

from indentfit.errors import RecordError
from indentfit.experiment.loading import filtered, noise_of, odd
from indentfit.experiment.noise import CorrelatedNoise, covariance, noise_in

CONFIDENCE = 0.9  # of the interval that an uncertainty is half of
POWERS = {"flat": (1.0, 2.0), "sphere": (1.5, 2.5)}  # of the displacement beyond contact, for each kind of indenter
MOST_SAMPLES = 4000  # in a fit: longer stretches are thinned by block means
BASELINE = 3.0  # ramps' durations of baseline that are looked at
GRID = 80  # contact points tried before the search
TRIALS = 60  # simulated records behind the uncertainty of the methods without one of their own
SIGMAS = 5.0  # threshold


@dataclass(frozen=True)
class ContactPoint:
    """Where contact begins: `displacement` of the record, mm, at sample `index`, and half of its 90 % interval, `uncertainty`, mm.

    baseline (mN, at time 0 of the record) and drift (mN/s) are the force without contact; noise: standard deviation of the force
    about the model, mN.
    """

    displacement: float
    uncertainty: float
    index: int
    baseline: float
    drift: float
    noise: float
    method: str


def find_contact_point(ramp, method="piecewise", indenter="flat"):
    """The `ContactPoint` of a Ramp by one of METHODS, under an indenter of POWERS. Raises RecordError where there is no contact."""
    stretch, powers = _stretch(ramp), POWERS[indenter]
    model = _fit(stretch, powers)
    _require_a_kink(ramp, stretch, model)
    rule = METHODS[method]
    if rule is None:
        place, uncertainty = model.contact, norm.ppf((1 + CONFIDENCE) / 2) * model.stderr
    else:
        place = rule(stretch, stretch.force)
        uncertainty = _uncertainty(stretch, model, rule, place)
    behind = np.flatnonzero(ramp.displacement[: ramp.high] < place)
    index = int(behind[-1]) + 1 if behind.size else 0
    drift = float(model.coefficients[1]) if stretch.drifts else 0.0
    return ContactPoint(
        float(place), float(uncertainty), index, float(model.coefficients[0]), drift, float(np.std(model.residual)), method
    )


@dataclass(frozen=True, eq=False)
class _Stretch:
    """The part of a record that a contact point is looked for in: baseline and loading, thinned to a few thousand samples.

    time s, displacement (filtered) mm, force mN: (n,); half: sample with half of the force; length: of the filter, samples;
    quiet: number of samples at the start that surely lie before contact; blur: standard error of the filtered displacement, mm.
    """

    time: np.ndarray
    displacement: np.ndarray
    force: np.ndarray
    half: int
    length: int
    quiet: int
    blur: float
    drifts: bool


@dataclass(frozen=True, eq=False)
class _Model:
    """Baseline and polynomial with a contact point, fitted: coefficients (baseline, [drift], one for each power), residual (n,)."""

    powers: tuple[float, ...]
    contact: float
    stderr: float
    coefficients: np.ndarray
    residual: np.ndarray
    noise: CorrelatedNoise


def _stretch(ramp):
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
    # a quadratic filter of m points leaves 9 / (4 m) of the variance of white noise; vibration it averages out
    blur = 1.5 * noise_of(record.displacement[part]) / np.sqrt(ramp.length)
    # in a shorter baseline, drift cannot be told from noise, and in so short a time it does no harm
    drifts = low - 0.2 * samples / thin >= samples / thin
    return _Stretch(time, displacement, force, half, odd(ramp.length / thin), max(5, low // 2), float(blur), bool(drifts))


def _fit(stretch, powers):
    """The _Model of least squares: the contact point by search, everything else linear."""
    x = stretch.displacement
    places = np.linspace(x.min(), x[stretch.half], GRID)
    misfits = [_misfit(place, stretch, powers) for place in places]
    best = int(np.argmin(misfits))
    bounds = places[max(best - 1, 0)], places[min(best + 1, GRID - 1)]
    place = minimize_scalar(_misfit, bounds=bounds, args=(stretch, powers), method="bounded", options={"xatol": 1e-5}).x
    terms = _terms(place, stretch, powers)
    coefficients = np.linalg.lstsq(terms, stretch.force, rcond=None)[0]
    residual = stretch.force - terms @ coefficients
    noise = noise_in(residual)
    beyond, touching = np.maximum(x - place, 0.0), np.heaviside(x - place, 0.0)
    by_place = -touching * sum(m * c * beyond ** (m - 1) for m, c in zip(powers, coefficients[-len(powers) :], strict=True))
    spread = np.maximum(np.diag(covariance(np.column_stack([terms, by_place]), noise)), 1e-300)
    return _Model(powers, float(place), float(np.hypot(np.sqrt(spread[-1]), stretch.blur)), coefficients, residual, noise)


def _terms(place, stretch, powers):
    """Columns of the linear part (n, .): baseline, its drift where there is any, powers of the displacement beyond contact."""
    beyond = np.maximum(stretch.displacement - place, 0.0)
    drift = [stretch.time] if stretch.drifts else []
    return np.column_stack([np.ones_like(beyond), *drift, *(beyond**m for m in powers)])


def _misfit(place, stretch, powers):
    terms = _terms(place, stretch, powers)
    residual = stretch.force - terms @ np.linalg.lstsq(terms, stretch.force, rcond=None)[0]
    return residual @ residual


def _require_a_kink(ramp, stretch, model):
    """Refuse a force that changes at one rate all along: drift, or a record that begins in contact."""
    straight = np.column_stack([np.ones_like(stretch.time), stretch.time])
    rest = stretch.force - straight @ np.linalg.lstsq(straight, stretch.force, rcond=None)[0]
    if rest @ rest < 2 * (model.residual @ model.residual) and model.contact - stretch.displacement.min() < 3 * model.stderr:
        raise RecordError(
            f"{ramp.record.name}: no contact point: the force changes at one rate from the first sample on, as by drift or in "
            "contact all along; start recording before contact, or remove the record"
        )
    powers = np.array(model.powers)
    if model.coefficients[-powers.size :] @ np.ptp(stretch.displacement) ** powers <= 0:
        raise RecordError(
            f"{ramp.record.name}: no contact point: the force does not rise with the displacement; check the channels"
        )


def _threshold(stretch, force):
    """Displacement where the filtered force exceeds the baseline by 5 standard deviations, for a filter's length at least."""
    smooth = filtered(force, stretch.length)
    time, quiet = stretch.time, stretch.quiet
    line = np.polyfit(time[:quiet], smooth[:quiet], 1 if stretch.drifts else 0)
    above = smooth - np.polyval(line, time)
    over = above > SIGMAS * max(float(np.std(above[:quiet])), 1e-9)
    held = np.convolve(over, np.ones(stretch.length), "full")[stretch.length - 1 :] >= stretch.length - 0.5
    return stretch.displacement[int(np.argmax(held))] if held.any() else stretch.displacement[stretch.half]


def _variance_ratio(stretch, force):
    """Displacement where the variance of the force in a window after it, over that in one before it, is largest."""
    width = max(5, min(2 * stretch.length, stretch.quiet))
    first, second = (np.concatenate([[0.0], np.cumsum((force - force[0]) ** power)]) for power in (1, 2))
    mean, square = ((total[width:] - total[:-width]) / width for total in (first, second))
    variance = np.maximum(square - mean**2, 0.0)
    floor = 1e-6 * variance.max()
    ratio = variance[width:] / (variance[:-width] + floor)
    return stretch.displacement[width + int(np.argmax(ratio[: max(1, stretch.half - width)]))]


def _uncertainty(stretch, model, method, place):
    """Half of the 90 % interval of another method, mm: its error, bias and spread, on records simulated from the fitted model."""
    scale, weights = model.noise.scale, model.noise.weights
    rng = np.random.default_rng(0)  # the same record gives the same answer
    smooth = stretch.force - model.residual
    white = rng.standard_normal((TRIALS, 200 + scale.size))
    noise = lfilter([1.0], np.append(1.0, -weights), white, axis=1)[:, 200:]
    noise *= scale / noise.std()
    errors = [abs(method(stretch, smooth + one) - model.contact) for one in noise]
    within = norm.ppf((1 + CONFIDENCE) / 2) * model.stderr
    return max(float(np.quantile(errors, CONFIDENCE)), abs(place - model.contact)) + within


METHODS = {"piecewise": None, "threshold": _threshold, "variance_ratio": _variance_ratio}  # None: the fit of the model itself
