"""One raw record to its loading curve, stiffness and facts."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from indentfit.case import Record
from indentfit.curve import Curve
from indentfit.errors import RecordError
from indentfit.experiment.contact_point import ContactPoint, find_contact_point
from indentfit.experiment.loading import Ramp, constant_velocity, filtered, find_ramp
from indentfit.experiment.record import RawRecord
from indentfit.experiment.relaxation import Prony, fit_prony
from indentfit.experiment.soundness import require_channels, require_whole
from indentfit.experiment.stiffness import Line, Parabola, linear_fit, quadratic_fit, resampled

SHORTEST_HOLD = 2.0  # durations of the ramp, for a relaxation to be fitted
PEAK_FILTER = 0.05  # of the ramp's duration: shorter than for the curve, not to cut the peak off, but longer than the rig rings


@dataclass(frozen=True, eq=False)
class ProcessedRecord:
    """A record and what it amounts to.

    window: samples of constant velocity; velocity mm/s; depth mm, to the end of loading; peak: largest force, mN; curve: from
    contact, at equal steps; line and parabola: fits within the window; forces: strain -> mN; relaxation: of the hold, or None;
    strain_rate 1/s. displacement, force: filtered samples from contact to the end of loading (n,), from contact, mm and mN.
    notes: what deserves a look.
    """

    record: RawRecord
    ramp: Ramp
    contact: ContactPoint
    window: slice
    velocity: float
    depth: float
    peak: float
    displacement: np.ndarray
    force: np.ndarray
    curve: Curve
    line: Line
    parabola: Parabola
    thickness: float | None = None
    forces: dict[float, float] = field(default_factory=dict)
    relaxation: Prony | None = None
    notes: tuple[str, ...] = ()

    @property
    def strain_rate(self):
        return self.velocity / self.thickness if self.thickness else None


def process_record(record, thickness=None, table=None):
    """`ProcessedRecord` of a RawRecord; thickness of the sample in mm, for strains; `table` is the [record] table of a case.

    Raises RecordError, one line that names the record, what is wrong with it and the remedy.
    """
    table = table or Record()
    require_channels(record)
    ramp = find_ramp(record, table.filter)
    notes = record.notes + require_whole(ramp)
    contact = find_contact_point(ramp, table.contact, table.indenter or "flat")
    window, velocity = constant_velocity(ramp, contact.index)
    unfiltered = record.force - contact.baseline - contact.drift * record.time
    force = ramp.force - contact.baseline - contact.drift * record.time
    displacement = ramp.displacement - contact.displacement
    loading = slice(contact.index, ramp.stop)
    depth = float(displacement[loading].max())
    _require_depth(record, depth, contact)
    return ProcessedRecord(
        record=record,
        ramp=ramp,
        contact=contact,
        window=window,
        velocity=velocity,
        depth=depth,
        peak=_peak(ramp, contact, unfiltered),
        displacement=displacement[loading],
        force=force[loading],
        curve=resampled(displacement[loading], force[loading], table.points),
        line=linear_fit(displacement[window], unfiltered[window]),
        parabola=quadratic_fit(displacement[window], unfiltered[window]),
        thickness=thickness,
        forces=_forces(displacement[loading], force[loading], thickness, table.strains),
        relaxation=_relaxation(ramp, unfiltered, contact, table.prony_terms),
        notes=(*notes, *_notes(ramp, contact, depth, thickness)),
    )


def _require_depth(record, depth, contact):
    if depth < 3 * contact.uncertainty:
        raise RecordError(
            f"{record.name}: the contact point is known to {contact.uncertainty:.3g} mm only, where the sample is indented by "
            f"{depth:.3g} mm; the record is too noisy: repeat it, or remove it"
        )


def _peak(ramp, contact, unfiltered):
    """Largest force, mN, with the noise, but not the peak, filtered away."""
    stop = ramp.stop + round(0.5 * ramp.samples)
    return float(filtered(unfiltered[:stop], PEAK_FILTER * ramp.samples)[contact.index :].max())


def _forces(displacement, force, thickness, strains):
    if not thickness:
        return {}
    curve = resampled(displacement, force, 400)
    inside = [strain for strain in strains if strain * thickness <= curve.displacement[-1] * (1 + 1e-3)]
    return {
        strain: float(np.interp(strain * thickness, np.append(0, curve.displacement), np.append(0, curve.force)))
        for strain in inside
    }


def _relaxation(ramp, unfiltered, contact, terms):
    """The Prony series of the hold, where there is one that is long enough."""
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


def _stays(ramp):
    """Whether the stage stays where the ramp ended: a hold, not an unloading."""
    after = ramp.displacement[ramp.stop :]
    depth = ramp.displacement[ramp.stop - 1] - ramp.displacement[ramp.low]
    return bool(np.ptp(after) < 0.1 * depth)


def _notes(ramp, contact, depth, thickness):
    """What deserves a look, one line each."""
    if contact.index < ramp.length:
        yield "contact begins with the record: there is little baseline before it"
    if contact.uncertainty > 0.05 * depth:
        yield f"the contact point is uncertain by {contact.uncertainty / depth:.0%} of the depth"
    if thickness and depth > 0.5 * thickness:
        yield f"indented by {depth / thickness:.0%} of the thickness: check units and thickness"
