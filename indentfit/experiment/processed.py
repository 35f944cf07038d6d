"""Processing of one raw record: its loading curve, stiffness and relaxation."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from indentfit.arrays import Array
from indentfit.case import Record
from indentfit.curve import MIN_POINTS, Curve
from indentfit.digits import quantity
from indentfit.errors import RecordError
from indentfit.experiment.assumptions import contradictions, widened_by_gaps
from indentfit.experiment.contact import locate_contact
from indentfit.experiment.contact_point import METHODS, ContactPoint, is_too_uncertain
from indentfit.experiment.fine_travel import with_fine_travel
from indentfit.experiment.hertz import Hertz, hertz_modulus
from indentfit.experiment.judgement import CONTACT, Judgement, judged
from indentfit.experiment.loading import Ramp, constant_velocity, find_ramp
from indentfit.experiment.peak import peak_notes, peak_of, peak_uncertainty
from indentfit.experiment.record import RawRecord
from indentfit.experiment.relaxation import Prony, fit_prony
from indentfit.experiment.selection import selected
from indentfit.experiment.soundness import require_channels, require_whole
from indentfit.experiment.stiffness import Line, Parabola, linear_fit, quadratic_fit, resampled

STANDARD = 1.96  # standard deviations in half of a 95 % interval
SHORTEST_HOLD = 2.0  # durations of the ramp: a relaxation is fitted to longer holds
FEWEST_LEFT = 10  # samples within limits of depth and force
WIDE = CONTACT[1]  # of the depth, for half of the interval of the contact point: the rating of every record says a smaller one


@dataclass(frozen=True, eq=False)
class ProcessedRecord:
    """A raw record with all that is computed from it. Displacements and forces are counted from the contact point.

    Attributes
    ----------
    record : RawRecord
    ramp : Ramp
    contact : ContactPoint
    window : slice
        Samples of constant velocity.
    velocity : float, mm/s
    depth : float, mm
        Largest displacement until the end of loading.
    peak : float, mN
        Largest force.
    peak_uncertainty : float, mN
        Half of the 95 % interval of the largest force: noise, zero, and a drift that the approach does not show.
    displacement, force : array (n,), mm and mN
        Filtered samples from contact to the end of loading.
    curve : Curve
        The loading at equal steps of displacement.
    line, parabola : Line, Parabola
        Fits within the window.
    thickness : float or None, mm
        Thickness of the sample.
    forces : dict
        Strain (displacement over thickness) -> force, mN.
    relaxation : Prony or None
        Prony series of the hold; None where there is no hold, or too short a hold.
    hertz : Hertz or None
        Hertz modulus, where the radius of a sphere is known.
    notes : tuple of str
        Unusual properties of the record.
    contradicted : bool
        Whether it contradicts what contact point and peak assume; notes say how.
    """

    record: RawRecord
    ramp: Ramp
    contact: ContactPoint
    window: slice
    velocity: float
    depth: float
    peak: float
    peak_uncertainty: float
    displacement: Array
    force: Array
    curve: Curve
    line: Line
    parabola: Parabola
    thickness: float | None = None
    forces: dict[float, float] = field(default_factory=dict)
    relaxation: Prony | None = None
    hertz: Hertz | None = None
    notes: tuple[str, ...] = ()
    contradicted: bool = False

    @property
    def judgement(self) -> Judgement:
        """The rating of the record in words."""
        return judged(self.ramp, self.contact, self.depth, self.peak, self.contradicted)

    @property
    def strain_rate(self) -> float | None:
        """Velocity over thickness, 1/s."""
        return self.velocity / self.thickness if self.thickness else None


def process_record(record: RawRecord, thickness: float | None = None, settings: Record | None = None) -> ProcessedRecord:
    """The loading curve, stiffness and relaxation of one raw record.

    Parameters
    ----------
    record : RawRecord
    thickness : float, mm
        Thickness of the sample, for strains.
    settings : Record
        The [record] table: method of the contact point, filter, points of the curve, strains, terms of the Prony series.

    Returns
    -------
    ProcessedRecord

    Raises
    ------
    RecordError
        The record cannot be used. The error's text is one line with the name of the record, what is wrong and the remedy.
    """
    settings = _with_stated(settings or Record(), record)
    record = selected(record, settings)
    require_channels(record)
    record = with_fine_travel(record)
    ramp = find_ramp(record, settings.filter)
    notes = record.notes + require_whole(ramp)
    located = locate_contact(ramp, settings)
    contact, notes = located.contact, notes + located.notes + _contradicted(settings, record)
    window, velocity = constant_velocity(ramp, contact.index)
    zeroed, loading = _zeroed(ramp, contact), slice(contact.index, ramp.stop)
    displacement, force = _limited(record, zeroed.displacement[loading], zeroed.force[loading], settings)
    depth = float(displacement.max())
    contact, gaps = widened_by_gaps(ramp, contact, depth)
    _require_depth(record, depth, contact)
    peak = peak_of(ramp, contact, zeroed.unfiltered, settings.indenter)
    radius = settings.radius if settings.indenter == "sphere" else None
    against = tuple(contradictions(ramp, contact, depth, peak.force, radius))
    return ProcessedRecord(
        record=record,
        ramp=ramp,
        contact=contact,
        window=window,
        velocity=velocity,
        depth=depth,
        peak=peak.force,
        peak_uncertainty=peak_uncertainty(peak, contact),
        displacement=displacement,
        force=force,
        curve=replace(_curve(displacement, force, settings.points, contact), contact=_deviation(contact)),
        line=linear_fit(zeroed.displacement[window], zeroed.unfiltered[window]),
        parabola=quadratic_fit(zeroed.displacement[window], zeroed.unfiltered[window]),
        thickness=thickness,
        forces=_forces(displacement, force, thickness, settings.strains),
        relaxation=_relaxation(ramp, zeroed.unfiltered, contact, settings.prony_terms),
        hertz=_hertz(zeroed, depth, settings),
        notes=(
            *notes,
            *gaps,
            *_notes(ramp, contact, depth, thickness),
            *against,
            *peak_notes(ramp, peak, zeroed.unfiltered, contact),
        ),
        contradicted=bool(against),
    )


def _with_stated(settings: Record, record: RawRecord) -> Record:
    """The settings with what the file states of the indenter where they say nothing."""
    radius = settings.radius or record.stated.radius
    end = settings.indenter or ("sphere" if radius else None)
    return settings.model_copy(update={"radius": radius, "indenter": end})


def _contradicted(settings: Record, record: RawRecord) -> tuple[str, ...]:
    """A note where the file states another radius of the sphere than the settings."""
    told, stated = settings.radius, record.stated.radius
    if not told or not stated or abs(told - stated) <= 0.01 * stated:
        return ()
    return (f"record.radius is {quantity(told, 'mm')}, and the file states {quantity(stated, 'mm')}: check which sphere was used",)


@dataclass(frozen=True, eq=False)
class _Zeroed:
    """A whole record counted from the contact point: filtered displacement (n,), mm, and force (n,), filtered and not, mN."""

    displacement: Array
    force: Array
    unfiltered: Array


def _zeroed(ramp: Ramp, contact: ContactPoint) -> _Zeroed:
    free = contact.free(ramp.record.time, ramp.displacement)
    return _Zeroed(
        displacement=ramp.displacement - contact.displacement, force=ramp.force - free, unfiltered=ramp.record.force - free
    )


def _require_depth(record: RawRecord, depth: float, contact: ContactPoint) -> None:
    """Refuse a record whose contact point is too uncertain for its depth."""
    if is_too_uncertain(contact, depth):
        raise RecordError(
            f"{record.name}: the contact point is uncertain by {quantity(contact.uncertainty, 'mm', 3)}, and the indentation is "
            f"only {quantity(depth, 'mm', 3)} deep; the record is too noisy: repeat or remove the record"
        )


def _limited(record: RawRecord, displacement: Array, force: Array, settings: Record) -> tuple[Array, Array]:
    """The samples of the loading up to the limits of depth and force, and without the turning point."""
    depths = [settings.max_depth, settings.max_radius and settings.radius and settings.max_radius * settings.radius]
    if settings.max_radius and not settings.radius:
        raise RecordError(f"{record.name}: record.max_radius needs the radius of the sphere; give record.radius")
    deepest = min([float(displacement.max()) * (1 - settings.turning), *(depth for depth in depths if depth)])
    stop = int(np.argmax(displacement > deepest)) if (displacement > deepest).any() else displacement.size
    if settings.max_force and (force[:stop] > settings.max_force).any():
        stop = int(np.argmax(force > settings.max_force))
    if stop < FEWEST_LEFT:
        raise RecordError(f"{record.name}: the limits of depth and force leave {stop} samples; {FEWEST_LEFT} are needed")
    return displacement[:stop], force[:stop]


def _curve(displacement: Array, force: Array, points: int, contact: ContactPoint) -> Curve:
    """The loading at equal steps of displacement; no point lies before the first sample of a record that begins in contact."""
    curve = resampled(displacement, force, points)
    measured = curve.displacement >= displacement.min()
    if contact.method in METHODS or np.count_nonzero(measured) < MIN_POINTS:
        return curve
    return Curve(curve.displacement[measured], curve.force[measured])


def _deviation(contact: ContactPoint) -> float | None:
    """Standard deviation of the contact point, mm; None where it is not known."""
    sd = contact.uncertainty / STANDARD
    return float(sd) if 0 < sd < np.inf else None


def _hertz(zeroed: _Zeroed, depth: float, settings: Record) -> Hertz | None:
    """The Hertz modulus of the loading to the depth of the curve, where the radius of a sphere is known."""
    if settings.indenter != "sphere" or not settings.radius:
        return None
    stop = int(np.argmax(zeroed.displacement >= depth)) + 1
    return hertz_modulus(zeroed.displacement[:stop], zeroed.unfiltered[:stop], settings.radius)


def _forces(displacement: Array, force: Array, thickness: float | None, strains: tuple[float, ...]) -> dict[float, float]:
    """Strain -> force, mN, for the strains that the loading reaches."""
    if not thickness:
        return {}
    curve = resampled(displacement, force, 400)
    inside = [strain for strain in strains if strain * thickness <= curve.displacement[-1] * (1 + 1e-3)]
    return {
        strain: float(np.interp(strain * thickness, np.append(0, curve.displacement), np.append(0, curve.force)))
        for strain in inside
    }


def _relaxation(ramp: Ramp, unfiltered: Array, contact: ContactPoint, terms: int | str) -> Prony | None:
    """The Prony series of the hold, or None where there is no hold, or too short a hold."""
    record = ramp.record
    held = record.time[-1] - record.time[ramp.stop - 1]
    if terms == 0 or held < SHORTEST_HOLD * ramp.duration or not _stays(ramp):
        return None
    begin = ramp.stop
    duration = float(record.time[ramp.stop - 1] - record.time[contact.index])
    try:
        return fit_prony(record.time[begin:] - record.time[ramp.stop - 1], unfiltered[begin:], duration, terms)
    except ValueError:
        return None


def _stays(ramp: Ramp) -> bool:
    """Whether the stage stays at the end of the ramp: a hold, not an unloading."""
    after = ramp.displacement[ramp.stop :]
    depth = ramp.displacement[ramp.stop - 1] - ramp.displacement[ramp.low]
    return bool(np.ptp(after) < 0.1 * depth)


def _notes(ramp: Ramp, contact: ContactPoint, depth: float, thickness: float | None) -> Iterator[str]:
    """One line for each unusual property of the record."""
    if contact.index < ramp.length and contact.method in METHODS:
        yield "contact begins soon after the start of the record: the baseline is short"
    if contact.uncertainty > WIDE * depth:
        yield f"the contact point is uncertain by {contact.uncertainty / depth:.0%} of the depth"
    if thickness and depth > 0.5 * thickness:
        yield f"the indentation is {depth / thickness:.0%} of the thickness deep: check units and thickness"
