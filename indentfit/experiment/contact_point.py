"""The contact point: the displacement at which the indenter first touches the sample, by published methods.

`piecewise` (the default): baseline and a polynomial that leaves the baseline at the contact point, by least squares (Rudoy et al.
2010, J R Stat Soc C 59:573; powers 1 and, for the tissue's stiffening, 2 for a flat punch; 1.5, as in Hertz's theory, and 2.5 for
a sphere; `piecewise.py`). `threshold`: the filtered force exceeds the mean of the baseline by n standard deviations there, and
stays above (Lin, Dimitriadis, Horkay 2007, J Biomech Eng 129:430 review such rules). `variance_ratio`: the ratio of the variance of
the force after the point to the variance before it is largest (Gavara 2016, Sci Rep 6:21267). tests/campaigns/contact_point.py
compares the methods on simulated records; on this evidence `piecewise` is the default; tests/campaigns/records.py tests its
interval on the kinds of records that instruments make. The stated uncertainty presumes that the polynomial holds close to contact:
it does not cover a toe region, as a tilted or uneven sample has.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.signal import lfilter
from scipy.stats import t as student

from indentfit.arrays import Array, Bools
from indentfit.errors import RecordError
from indentfit.experiment.baselines import Doubt, HiddenDrift, fitted
from indentfit.experiment.loading import SHORTEST_FILTER, Ramp, filtered
from indentfit.experiment.noise import noise_in
from indentfit.experiment.piecewise import POWERS, Piecewise, Stretch, independent, solved, stretch_of

CONFIDENCE = 0.95  # a stated uncertainty is half of this interval
SHORTEST_TRAVEL = 0.01  # of the depth: a record with less of an approach begins in contact
SAME_SLOPE = 0.35  # of the force before and after the fitted contact point, in a record that begins in contact
NEARLY = 0.7  # of the slope after it, the slope before a fitted contact point that is none, by the noise alone
PULL = 6.0  # standard deviations of the noise by which the force falls below the baseline where the sample pulls
TRIALS = 60  # simulated records that give the uncertainty of the methods `threshold` and `variance_ratio`
ON_TRUST = 0.45  # share of the change of the force without contact during the loading, where it cannot be seen, that is in doubt
SURELY = 3.0  # standard errors from which a drift is one
SLOW = 0.3  # share of the samples that are independent, below which noise is slow
FEWEST_BEFORE = 40  # samples before contact that tell its noise
OF_NOISE = 3.0  # half widths of contact's interval by noise alone: no longer a move of contact counts
EVEN = 0.95 * np.sqrt(3.0)  # standard deviations in half of a 95 % interval of an error that is evenly spread, as of rounding
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
    form : str
        Of the force without contact: "constant", "drift", "decay" (it dies out in time) or "waves" (in the travel).
    scale : float
        Time constant of the decay, s, or period of the waves, mm.
    amplitudes : tuple of float, mN
        Of the decay at time 0; of cosine and sine of the waves.
    zero_error : float, mN
        Half of the 95 % interval of the force without contact at the end of loading, if there is no hidden drift.
    hidden : HiddenDrift or None
        The drift that the force does not show.
    stretch : tuple of float, mm
        First and last displacement of the record that baseline and polynomial were fitted to; empty without a fit.
    """

    displacement: float
    uncertainty: float
    index: int
    baseline: float
    drift: float
    noise: float
    method: str
    form: str = "constant"
    scale: float = 0.0
    amplitudes: tuple[float, ...] = ()
    zero_error: float = 0.0
    hidden: HiddenDrift | None = None
    stretch: tuple[float, ...] = ()

    def free(self, time: Array, displacement: Array) -> Array:
        """Force without contact (n,), mN, at times, s, and displacements of the record, mm."""
        force = self.baseline + self.drift * time
        if self.form == "decay":
            return force + self.amplitudes[0] * np.exp(-time / self.scale)
        if self.form == "waves":
            angle = 2 * np.pi * displacement / self.scale
            return force + self.amplitudes[0] * np.cos(angle) + self.amplitudes[1] * np.sin(angle)
        return force


Rule = Callable[[Stretch, Array], float]  # the displacement at contact, by a stretch and forces (n,) in place of its own


def find_contact_point(ramp: Ramp, method: str = "piecewise", indenter: str | None = "flat") -> ContactPoint:
    """The `ContactPoint` of a ramp.

    Parameters
    ----------
    ramp : Ramp
    method : str
        One of METHODS.
    indenter : str or None
        One of POWERS: "flat", "sphere", or "cone", which has a ball as its tip; None where it is not known.

    Raises
    ------
    RecordError
        There is no contact.
    """
    return fitted_approach(ramp, indenter).point(method)


def is_too_uncertain(contact: ContactPoint, depth: float) -> bool:
    """Whether a contact point says too little of an indentation to a depth, mm."""
    return depth < 3 * contact.uncertainty


@dataclass(frozen=True, eq=False)
class Approach:
    """A ramp with the baseline and polynomial that were fitted to it, and what rivals of the fit leave in doubt."""

    ramp: Ramp
    stretch: Stretch
    model: Piecewise
    doubt: Doubt

    def point(self, method: str) -> ContactPoint:
        """The `ContactPoint` by a method; RecordError where there is no contact."""
        _require_a_kink(self.ramp, self.model)
        return _point(self, method)

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
        # close to contact the force may rise already, where the law of the powers does not hold
        before = x < x.min() + 0.7 * self.travel()
        after = (x >= self.model.contact) & (x <= self.model.contact + reach)
        if np.count_nonzero(before) < 5 or np.count_nonzero(after) < 5:
            return True
        slopes = [float(np.polyfit(x[part], force[part], 1)[0]) if np.ptp(x[part]) else 0.0 for part in (before, after)]
        rise = slopes[0] * self.travel()
        scatter = float(np.std(self.model.residual)) / np.sqrt(self.stretch.length)
        return slopes[0] > SAME_SLOPE * slopes[1] and rise > 4 * scatter

    def may_be_missing(self) -> bool:
        """Whether the travel before contact is too short to tell that the force does not rise there as it does after contact."""
        x, force = self.stretch.displacement, self.stretch.force
        before, after = x < self.model.contact, (x >= self.model.contact) & (x <= self.model.contact + self.travel())
        if min(np.count_nonzero(before), np.count_nonzero(after)) < 3 or not np.ptp(x[before]) or not np.ptp(x[after]):
            return True
        slope, rises = (float(np.polyfit(x[part], force[part], 1)[0]) for part in (before, after))
        spread = float(np.sqrt(np.sum((x[before] - x[before].mean()) ** 2)))
        stderr = float(np.std(self.model.residual)) * float(np.sqrt(self.stretch.displacement.size / self.independent())) / spread
        return slope + 2 * stderr * float(np.hypot(1.0, NEARLY)) > NEARLY * rises

    def independent(self) -> float:
        """How many independent samples the noise leaves."""
        return independent(self.model.noise)

    def moves_in_slow_noise(self) -> float:
        """How far the contact point moves with the fitted depth, mm, where the noise is so slow that it may hide the sample's law.

        A shorter stretch has noise of its own: what exceeds OF_NOISE times `reach` counts as that. 0 where the noise before
        contact is not slow (a law that the powers do not follow leaves a slow residual behind contact), and where fewer than
        FEWEST_BEFORE samples before contact do not tell whether it is.
        """
        before = self.model.residual[self.model.stretch.displacement < self.model.contact]
        if before.size < FEWEST_BEFORE or independent(noise_in(before - before.mean())) >= SLOW * before.size:
            return 0.0
        return min(self.doubt.shorter, OF_NOISE * reach(self.model))

    def pull(self) -> float:
        """How far the force falls below the baseline close to contact, mN: an adhesive sample pulls; 0 where noise explains it.

        Filters of several lengths look for it: a long one sees a pull under noise, a short one how deep a brief pull is.
        """
        stretch, depth = self.stretch, self.depth()
        above = stretch.force - self.model.free(stretch.time, stretch.displacement)
        near = np.abs(stretch.displacement - self.model.contact) < 0.3 * depth
        if min(np.count_nonzero(near), np.count_nonzero(~near)) < stretch.length:
            return 0.0
        lengths = {SHORTEST_FILTER, max(SHORTEST_FILTER, stretch.length // 4), stretch.length}
        return max(self._lowest(above, near, length) for length in lengths)

    def _lowest(self, above: Array, near: Bools, length: int) -> float:
        """How far a force above the baseline (n,), filtered, falls below it near contact; 0 where noise explains it."""
        smooth = filtered(self.model.residual, length)  # the ringing of a stage in motion counts as noise
        away = ~near[: smooth.size]
        scatter = smooth[away].std() if away.any() else smooth.std()
        lowest = -float(filtered(above, length)[near].min())
        return lowest if lowest > PULL * scatter else 0.0


def fitted_approach(ramp: Ramp, indenter: str | None = "flat") -> Approach:
    """The `Approach` of a ramp under the end of an indenter, one of POWERS, or under that which fits best where it is not known."""
    stretch = stretch_of(ramp)
    model, doubt = fitted(stretch, (indenter,) if indenter else tuple(POWERS))
    return Approach(ramp, stretch, model, doubt)


def places_by_rules(ramp: Ramp) -> dict[str, float]:
    """Method -> displacement at contact, mm, of the methods that are rules, to compare with the fit."""
    stretch = stretch_of(ramp)
    return {method: float(rule(stretch, stretch.force)) for method, rule in METHODS.items() if rule is not None}


def _point(approach: Approach, method: str) -> ContactPoint:
    ramp, model, rule = approach.ramp, approach.model, METHODS[method]
    place = model.contact if rule is None else rule(approach.stretch, approach.stretch.force)
    uncertainty = reach(model) if rule is None else _uncertainty(approach.stretch, model, rule, place)
    behind = np.flatnonzero(ramp.displacement[: ramp.high] < place)
    index = int(behind[-1]) + 1 if behind.size else 0
    return ContactPoint(
        displacement=float(place),
        uncertainty=float(np.hypot(uncertainty, approach.doubt.contact)),
        index=index,
        noise=float(np.std(model.residual)),
        method=method,
        zero_error=float(np.linalg.norm([_quantile(model) * model.free_error(), ON_TRUST * _changes(model), approach.doubt.zero])),
        hidden=approach.doubt.hidden,
        stretch=(float(model.stretch.displacement.min()), float(model.stretch.displacement.max())),
        **_free_force(model),
    )


def _changes(model: Piecewise) -> float:
    """How far the fitted force without contact changes between contact and the end of the loading, where it surely changes, mN."""
    stretch = model.stretch
    free = model.free(stretch.time, stretch.displacement)
    touching = free[stretch.displacement >= model.contact]
    if model.baseline.kind == "constant" or not touching.size:
        return 0.0
    if model.baseline.kind == "drift" and abs(model.coefficients[1]) < SURELY * float(np.sqrt(model.spread[1, 1])):
        return 0.0
    return float(np.ptp(touching))


def _free_force(model: Piecewise) -> dict[str, Any]:
    """The attributes of a contact point that say what the force is without contact."""
    kind, scale, values = model.baseline.kind, model.baseline.scale, model.coefficients.tolist()
    told = {"baseline": values[0], "drift": values[1] if kind in ("drift", "waves") else 0.0, "form": kind, "scale": scale}
    if kind == "decay":
        return {**told, "amplitudes": (values[1] * float(np.exp(model.stretch.time[0] / scale)),)}
    return {**told, "amplitudes": tuple(values[2:4])} if kind == "waves" else told


def _require_a_kink(ramp: Ramp, model: Piecewise) -> None:
    """Refuse a force that changes at one rate throughout: drift, or a record that begins in contact."""
    stretch = model.stretch
    straight = np.column_stack([np.ones_like(stretch.time), stretch.time])
    rest = stretch.force - straight @ solved(straight, stretch.force)
    if rest @ rest < 2 * (model.residual @ model.residual) and model.contact - stretch.displacement.min() < 3 * model.stderr:
        raise RecordError(
            f"{ramp.record.name}: no contact point: the force changes at one rate from the first sample on, because of drift or "
            "of contact throughout; start recording before contact, or remove the record"
        )
    powers = np.array(model.powers)
    if model.coefficients[-powers.size :] @ max(float(stretch.displacement.max()) - model.contact, 0.0) ** powers <= 0:
        raise RecordError(
            f"{ramp.record.name}: no contact point: the force does not rise with the displacement; check the channels"
        )


def _threshold(stretch: Stretch, force: Array) -> float:
    """Displacement where the filtered force exceeds the baseline by 5 standard deviations for a filter's length."""
    smooth = filtered(force, stretch.length)
    time, quiet = stretch.time, stretch.quiet
    line = np.polyfit(time[:quiet], smooth[:quiet], 1 if stretch.drifts else 0)
    above = smooth - np.polyval(line, time)
    over = above > SIGMAS * max(float(np.std(above[:quiet])), 1e-9 * float(np.ptp(above)))
    held = np.convolve(over, np.ones(stretch.length), "full")[stretch.length - 1 :] >= stretch.length - 0.5
    return stretch.displacement[int(np.argmax(held))] if held.any() else stretch.displacement[stretch.half]


def _variance_ratio(stretch: Stretch, force: Array) -> float:
    """Displacement with the largest ratio of the variances of the force in a window after it and in a window before it."""
    width = max(5, min(2 * stretch.length, stretch.quiet))
    first, second = (np.concatenate([[0.0], np.cumsum((force - force[0]) ** power)]) for power in (1, 2))
    mean, square = ((total[width:] - total[:-width]) / width for total in (first, second))
    variance = np.maximum(square - mean**2, 0.0)
    floor = 1e-6 * variance.max()
    ratio = variance[width:] / (variance[:-width] + floor)
    return stretch.displacement[width + int(np.argmax(ratio[: max(1, stretch.half - width)]))]


def reach(model: Piecewise) -> float:
    """Half of the 95 % interval of the fitted contact point, mm."""
    by_noise = np.sqrt(max(model.stderr**2 - model.rounding**2, 0.0))
    return float(np.hypot(_quantile(model) * by_noise, EVEN * model.rounding))


def _quantile(model: Piecewise) -> float:
    """Student's quantile for half of a 95 % interval, with the independent samples that a correlated noise leaves."""
    freedom = max(independent(model.noise) - model.coefficients.size - 1, 3.0)
    return float(student.ppf((1 + CONFIDENCE) / 2, freedom))


def _uncertainty(stretch: Stretch, model: Piecewise, rule: Rule, place: float) -> float:
    """Half of the 95 % interval of a rule, mm: bias and spread of the rule on records simulated from the fitted model."""
    scale, weights = model.noise.scale, model.noise.weights
    rng = np.random.default_rng(0)  # the same record gives the same uncertainty
    smooth = model.stretch.force - model.residual
    white = rng.standard_normal((TRIALS, 200 + scale.size))
    noise = lfilter([1.0], np.append(1.0, -weights), white, axis=1)[:, 200:]
    noise *= scale / noise.std()
    errors = [abs(rule(model.stretch, smooth + added) - model.contact) for added in noise]
    return max(float(np.quantile(errors, CONFIDENCE)), abs(place - model.contact)) + reach(model)


# None: the fit of the model itself
METHODS: dict[str, Rule | None] = {"piecewise": None, "threshold": _threshold, "variance_ratio": _variance_ratio}
