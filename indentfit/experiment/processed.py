"""Processing of one raw record: its loading curve, stiffness and relaxation."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from indentfit.arrays import Array
from indentfit.case import Record
from indentfit.curve import Curve
from indentfit.errors import RecordError
from indentfit.experiment.contact_point import ContactPoint, find_contact_point
from indentfit.experiment.loading import Ramp, constant_velocity, filtered, find_ramp
from indentfit.experiment.record import RawRecord
from indentfit.experiment.relaxation import Prony, fit_prony
from indentfit.experiment.soundness import require_channels, require_whole
from indentfit.experiment.stiffness import Line, Parabola, linear_fit, quadratic_fit, resampled

SHORTEST_HOLD = 2.0  # durations of the ramp: a relaxation is fitted to longer holds
PEAK_FILTER = 0.05  # of the duration of the ramp: short enough to keep the peak, and longer than a period of the rig's ringing


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
    notes : tuple of str
        Unusual properties of the record.
    """

    record: RawRecord
    ramp: Ramp
    contact: ContactPoint
    window: slice
    velocity: float
    depth: float
    peak: float
    displacement: Array
    force: Array
    curve: Curve
    line: Line
    parabola: Parabola
    thickness: float | None = None
    forces: dict[float, float] = field(default_factory=dict)
    relaxation: Prony | None = None
    notes: tuple[str, ...] = ()

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
    settings = settings or Record()
    require_channels(record)
    ramp = find_ramp(record, settings.filter)
    notes = record.notes + require_whole(ramp)
    contact = find_contact_point(ramp, settings.contact, settings.indenter or "flat")
    window, velocity = constant_velocity(ramp, contact.index)
    zeroed, loading = _zeroed(ramp, contact), slice(contact.index, ramp.stop)
    displacement, force = zeroed.displacement[loading], zeroed.force[loading]
    depth = float(displacement.max())
    _require_depth(record, depth, contact)
    return ProcessedRecord(
        record=record,
        ramp=ramp,
        contact=contact,
        window=window,
        velocity=velocity,
        depth=depth,
        peak=_peak(ramp, contact, zeroed.unfiltered),
        displacement=displacement,
        force=force,
        curve=resampled(displacement, force, settings.points),
        line=linear_fit(zeroed.displacement[window], zeroed.unfiltered[window]),
        parabola=quadratic_fit(zeroed.displacement[window], zeroed.unfiltered[window]),
        thickness=thickness,
        forces=_forces(displacement, force, thickness, settings.strains),
        relaxation=_relaxation(ramp, zeroed.unfiltered, contact, settings.prony_terms),
        notes=(*notes, *_notes(ramp, contact, depth, thickness)),
    )


@dataclass(frozen=True, eq=False)
class _Zeroed:
    """A whole record counted from the contact point: filtered displacement (n,), mm, and force (n,), filtered and not, mN."""

    displacement: Array
    force: Array
    unfiltered: Array


def _zeroed(ramp: Ramp, contact: ContactPoint) -> _Zeroed:
    time = ramp.record.time
    return _Zeroed(
        displacement=ramp.displacement - contact.displacement,
        force=ramp.force - contact.baseline - contact.drift * time,
        unfiltered=ramp.record.force - contact.baseline - contact.drift * time,
    )


def _require_depth(record: RawRecord, depth: float, contact: ContactPoint) -> None:
    """Refuse a record whose contact point is too uncertain for its depth."""
    if depth < 3 * contact.uncertainty:
        raise RecordError(
            f"{record.name}: the contact point is uncertain by {contact.uncertainty:.3g} mm, and the indentation is only "
            f"{depth:.3g} mm deep; the record is too noisy: repeat or remove the record"
        )


def _peak(ramp: Ramp, contact: ContactPoint, unfiltered: Array) -> float:
    """Largest force, mN, after a filter that removes noise and keeps the peak."""
    stop = ramp.stop + round(0.5 * ramp.samples)
    return float(filtered(unfiltered[:stop], PEAK_FILTER * ramp.samples)[contact.index :].max())


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
    if contact.index < ramp.length:
        yield "contact begins soon after the start of the record: the baseline is short"
    if contact.uncertainty > 0.05 * depth:
        yield f"the contact point is uncertain by {contact.uncertainty / depth:.0%} of the depth"
    if thickness and depth > 0.5 * thickness:
        yield f"the indentation is {depth / thickness:.0%} of the thickness deep: check units and thickness"
