"""Where contact begins and what the force's zero is: two questions, each answered by the settings or by the record.

A record with an approach has a baseline: the contact point is where the force leaves it, and the baseline is the force's zero. A
record that begins in contact (a trigger force, a preload) has none: its zero is that of the sensor, and its contact point is
extrapolated by the law of the indenter. A loading in stages (preload, hold, load) is searched in its first stage.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from indentfit.case import Record
from indentfit.digits import quantity
from indentfit.errors import RecordError
from indentfit.experiment.contact_point import ContactPoint, fitted_approach, is_too_uncertain
from indentfit.experiment.extrapolation import extrapolated_contact
from indentfit.experiment.loading import Ramp, noise_of
from indentfit.experiment.stages import RELAXES, FirstStage, first_stage, gives_way, relaxed

FIRST = 5  # samples whose median is the force at which a record begins
PRELOAD = 0.01  # share of the peak at the first sample from which a missing approach is worth a note
FEWEST_INDEPENDENT = 40  # samples; with fewer the noise itself is hardly known
SIGMA_95 = 1.96
PULLED = 0.01  # share of the peak from which a pull at contact is worth a note


@dataclass(frozen=True)
class Located:
    """A contact point with the notes on how it was found."""

    contact: ContactPoint
    notes: tuple[str, ...] = ()


def locate_contact(ramp: Ramp, settings: Record) -> Located:
    """The contact point and the force's zero of a ramp.

    Parameters
    ----------
    ramp : Ramp
    settings : Record
        contact, contact_force, zero, indenter.

    Returns
    -------
    Located

    Raises
    ------
    RecordError
        There is no contact, or the approach that the settings ask for is missing.
    """
    if isinstance(settings.contact, float):
        return Located(_at(ramp, settings, settings.contact, 0.0, "stated"))
    if settings.contact == "first":
        blur = 2 * noise_of(ramp.record.displacement)
        return Located(_at(ramp, settings, float(ramp.displacement[0]), blur, "first"))
    if settings.contact == "force":
        return Located(_at_force(ramp, settings))
    if settings.contact == "extrapolated":
        return _extrapolated(ramp, settings)
    return _searched(ramp, settings)


def _searched(ramp: Ramp, settings: Record) -> Located:
    """The contact point by a method that searches for it, in the first stage of a staged loading."""
    first = first_stage(ramp, settings.filter, settings.indenter)
    approach = first.approach if first else fitted_approach(ramp, settings.indenter)
    notes: tuple[str, ...] = ()
    if approach.is_missing() and settings.zero != "approach":
        if settings.zero != "auto" or not _rests(ramp) or PRELOAD * ramp.peak < ramp.rest < ramp.peak:
            return _without_approach(ramp, settings)
        if abs(ramp.rest) > PRELOAD * ramp.peak:
            notes = (
                f"the record has no approach: the force at rest, {quantity(ramp.rest, 'mN')}, is taken as its zero (record.zero)",
            )
    contact = approach.point(str(settings.contact))
    if settings.zero != "approach" and first is None and approach.may_be_missing():
        begins = float(contact.free(ramp.record.time[:1], ramp.displacement[:1])[0]) - _zero(ramp, settings)
        if PRELOAD * ramp.peak < begins < ramp.peak:
            known = settings.zero != "auto"  # whose zero shows that the record begins in contact
            return _without_approach(ramp, settings) if known else _either_way(ramp, settings, contact, begins)
    contact = _zeroed(ramp, settings, contact)
    if first is not None:
        time = ramp.record.time[first.stop - 1]
        unit = f"{time:.4g} s" if ramp.record.timed else f"row {time + 1:.0f}"
        notes = (
            *notes,
            f"the loading has a pause at {unit}: contact was sought before it",
        )
        contact = _frozen(ramp, contact, first)
        share = relaxed(ramp, contact.index, contact.baseline)
        if share > RELAXES:
            notes = (*notes, f"the force falls by up to {share:.0%} in pauses of the loading: its curve depends on their duration")
    if approach.independent() < FEWEST_INDEPENDENT:
        notes = (
            *notes,
            f"the noise of the force is slow: it leaves {approach.independent():.0f} independent samples for the contact point",
        )
    # Slow noise may hide the sample's law, and one that gives way follows none of powers: contact is as far in doubt as it moves
    # with the depth that is fitted.
    moves = approach.moves_in_slow_noise()
    if first is None and gives_way(ramp, contact.free(ramp.record.time, ramp.displacement), contact.displacement):
        moves = max(moves, approach.doubt.shorter)
    contact = replace(contact, uncertainty=float(np.hypot(contact.uncertainty, moves)))
    pull = approach.pull()
    if pull > PULLED * ramp.peak:
        notes = (
            *notes,
            f"the force falls {quantity(pull, 'mN', 3)} below the baseline at contact: the sample pulls the indenter (adhesion)",
        )
        contact = replace(contact, uncertainty=max(contact.uncertainty, _pulled_over(ramp, contact)))
    return Located(contact, notes)


def _either_way(ramp: Ramp, settings: Record, seen: ContactPoint, begins: float) -> Located:
    """The contact point of a record that begins in contact, or after an approach too short to tell that, with the force, mN, with
    which it begins: by the sensor's zero, with intervals that hold the contact that was seen, too. Where that says too little of
    the contact, the one that was seen, with an interval of the force that holds both."""
    located = _extrapolated(ramp, settings)
    told = f"the approach is too short to tell whether the force rises in it: {quantity(begins, 'mN', 3)} at its start "
    ask = 'give record.zero, "sensor" or "approach"'
    reach = abs(seen.displacement - located.contact.displacement) + seen.uncertainty
    wide = replace(located.contact, uncertainty=max(located.contact.uncertainty, reach), zero_error=begins)
    if is_too_uncertain(wide, float(ramp.displacement[ramp.stop - 1]) - wide.displacement):
        note = f"{told}count as the sensor's offset, and may be a load, with contact before the record; {ask}"
        return Located(replace(seen, zero_error=max(seen.zero_error, begins)), (note,))
    place = quantity(seen.displacement, "mm", 3)
    note = f"{told}count as load; if they are the sensor's offset, contact lies at {place} of the record: {ask}"
    return Located(wide, (*located.notes, note))


def _frozen(ramp: Ramp, contact: ContactPoint, first: FirstStage) -> ContactPoint:
    """A contact point of a first stage whose force without contact stays what it is at contact: a drift is not known through a long
    hold."""
    behind = np.flatnonzero(ramp.displacement[: ramp.high] < contact.displacement)
    index = int(behind[-1]) + 1 if behind.size else 0
    here = slice(index, index + 1)
    baseline = float(contact.free(ramp.record.time[here], ramp.displacement[here])[0])
    uncertainty = float(np.hypot(contact.uncertainty, SIGMA_95 * first.doubt))
    frozen = replace(contact, baseline=baseline, drift=0.0, form="constant", scale=0.0, amplitudes=())
    return replace(frozen, index=index, uncertainty=uncertainty)


def _without_approach(ramp: Ramp, settings: Record) -> Located:
    """The contact point of a record that begins in contact, with a note where its first force is not that without contact."""
    located = _extrapolated(ramp, settings)
    contact = located.contact
    start = float(np.median(ramp.record.force[: max(3, ramp.length // 2)])) - contact.baseline
    if abs(start) < max(PRELOAD * ramp.peak, 3 * contact.noise):
        return Located(contact, (*located.notes, _no_approach(settings)))
    begins = float(np.median(ramp.record.force[:FIRST])) - contact.baseline
    note = f"{_no_approach(settings)}: it begins at {quantity(begins, 'mN', 3)}"
    if _rests(ramp):
        first = float(np.median(ramp.displacement[: max(3, ramp.low // 4)]))
        contact = replace(contact, uncertainty=max(contact.uncertainty, abs(first - contact.displacement)))
        note += "; the stage is at rest then, and whether this is a preload or the sensor's offset cannot be told: give record.zero"
    return Located(contact, (*located.notes, note))


def _no_approach(settings: Record) -> str:
    zero = "the sensor's" if isinstance(settings.zero, str) else "that stated"
    return f"the record has no approach: the zero of the force is {zero}, and contact is extrapolated from the first samples"


def _extrapolated(ramp: Ramp, settings: Record) -> Located:
    contact = extrapolated_contact(ramp, _zero(ramp, settings), settings.indenter)
    if settings.indenter is None and contact.uncertainty > 0:
        return Located(contact, ("the end of the indenter is not known: give record.indenter, or radius, for the contact point",))
    return Located(contact)


def _zero(ramp: Ramp, settings: Record) -> float:
    """The force without contact, mN, where no approach gives it: the mean of the stated times, or the sensor's zero."""
    if isinstance(settings.zero, str):
        return 0.0
    time = ramp.record.time
    inside = (time >= settings.zero[0]) & (time <= settings.zero[1])
    if not inside.any():
        raise RecordError(f"{ramp.record.name}: no sample between {settings.zero[0]:g} and {settings.zero[1]:g} s (record.zero)")
    return float(ramp.record.force[inside].mean())


def _zeroed(ramp: Ramp, settings: Record, contact: ContactPoint) -> ContactPoint:
    """A contact point with the zero that the settings ask for in place of the baseline."""
    if settings.zero in ("auto", "approach"):
        return contact
    return replace(contact, baseline=_zero(ramp, settings), drift=0.0, form="constant", amplitudes=(), zero_error=0.0, hidden=None)


def _at(ramp: Ramp, settings: Record, place: float, uncertainty: float, method: str) -> ContactPoint:
    """The contact point at a displacement that is stated."""
    behind = np.flatnonzero(ramp.displacement[: ramp.high] < place)
    index = int(behind[-1]) + 1 if behind.size else 0
    noise = noise_of(ramp.record.force)
    baseline = _zero(ramp, settings)
    if settings.zero in ("auto", "approach") and index > ramp.length:
        baseline = float(np.median(ramp.record.force[:index]))
    return ContactPoint(place, uncertainty, index, baseline, 0.0, noise, method)


def _at_force(ramp: Ramp, settings: Record) -> ContactPoint:
    """The contact point where the force first stays above a threshold over its zero."""
    if settings.contact_force is None:
        raise RecordError(f'{ramp.record.name}: record.contact = "force" needs record.contact_force, mN')
    zero = ramp.rest if settings.zero == "approach" else _zero(ramp, settings)
    below = np.flatnonzero(ramp.force[: ramp.high] - zero < settings.contact_force)
    index = int(below[-1]) + 1 if below.size else 0
    slope = float(np.gradient(ramp.force)[index]) or 1.0
    step = float(np.gradient(ramp.displacement)[index])
    reach = abs(2 * noise_of(ramp.record.force) / slope * step) + 2 * noise_of(ramp.record.displacement)
    return ContactPoint(float(ramp.displacement[index]), reach, index, zero, 0.0, noise_of(ramp.record.force), "force")


def _rests(ramp: Ramp) -> bool:
    """Whether the stage stays at the beginning of the record."""
    count = max(5, ramp.length // 2)
    moved = float(np.ptp(ramp.displacement[:count]))
    return moved < 0.3 * abs(ramp.velocity) * count * ramp.record.interval


def _pulled_over(ramp: Ramp, contact: ContactPoint) -> float:
    """Displacement, mm, from the fitted contact point to the beginning and the end of the pull, whichever is further."""
    above = ramp.force - contact.free(ramp.record.time, ramp.displacement)
    rises = np.flatnonzero(above[: ramp.high] < 0)
    lowest = int(np.argmin(above[: ramp.high]))
    noise = noise_of(ramp.record.force)
    before = np.flatnonzero(above[:lowest] > -2 * noise)
    places = [int(rises[-1]) if rises.size else lowest, int(before[-1]) if before.size else 0]
    return float(np.max(np.abs(ramp.displacement[places] - contact.displacement)))
