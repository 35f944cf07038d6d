"""A loading in stages: where the stage pauses, and the part of the record in which the contact point is sought.

Contact is sought before the first pause by which the force has clearly risen. Where an earlier pause may lie in contact, under the
noise, the samples of the pauses are cut out, and the force that a pause lost by relaxation is given back after it: by a linear
viscoelastic law the force is then that of one loading without pauses, less what relaxes during the loading itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from indentfit.arrays import Array
from indentfit.errors import RecordError
from indentfit.experiment.contact_point import Approach, fitted_approach
from indentfit.experiment.loading import Ramp, find_ramp, noise_of
from indentfit.experiment.record import RawRecord

PAUSE = 0.05  # share of the loading's samples during which the stage stays, in a pause
STAYS = 0.005  # share of the travel within which the stage stays
PROGRESS = 0.05  # share of the travel before and after a pause
FEWEST = 10  # samples of a line before and after a pause

Pauses = Sequence[tuple[int, int]]


RELAXES = 0.03  # share of its force that a pause loses, from which it is worth a note
SURELY = 3.0  # standard errors
GIVES_WAY = 0.02  # share of the peak by which the force is lower after the loading where a sample gives way
DEEP = 0.5  # share of the depth from which these forces count


@dataclass(frozen=True, eq=False)
class FirstStage:
    """The part of a staged loading that shows contact: the sample where it ends, its approach, and how far errors of what was given
    back for the pauses move the contact point, mm."""

    stop: int
    approach: Approach
    doubt: float = 0.0


def first_stage(ramp: Ramp, filter_share: float, indenter: str | None) -> FirstStage | None:
    """The `FirstStage` of a ramp; None where the loading has no pause in contact."""
    pauses = pauses_of(ramp)
    if not pauses:
        return None
    for count, stop in enumerate([*(begin for begin, _ in pauses), ramp.stop]):
        try:
            part = find_ramp(ramp.record.part(slice(0, stop)), filter_share)
        except RecordError:
            continue
        approach = fitted_approach(part, indenter)
        earliest = approach.model.contact - 2 * approach.model.stderr
        touching = [pause for pause in pauses[:count] if ramp.displacement[pause[0]] > earliest]
        if touching:
            return _joined(ramp, touching, stop, filter_share, indenter) or FirstStage(stop, approach)
        return FirstStage(stop, approach) if stop < ramp.stop else None
    return None


def pauses_of(ramp: Ramp) -> list[tuple[int, int]]:
    """Begin and end of the pauses of the stage between two parts of the loading."""
    d = ramp.displacement[: ramp.stop]
    window = max(5, round(PAUSE * d.size))
    if d.size < 4 * window:
        return []
    travel = float(np.ptp(d))
    still = np.abs(d[window:] - d[:-window]) < max(STAYS * travel, 3 * noise_of(ramp.record.displacement) / np.sqrt(ramp.length))
    begun, goes_on = d[: still.size] - d[0] > PROGRESS * travel, d[-1] - d[: still.size] > PROGRESS * travel
    edges = np.flatnonzero(np.diff(np.concatenate([[0], (still & begun & goes_on).astype(int), [0]])))
    return [(int(begin), int(end) - 1 + window) for begin, end in zip(edges[::2], edges[1::2], strict=True)]


def relaxed(ramp: Ramp, start: int, free: float) -> float:
    """The largest share of its force that the stage loses in a pause after the sample `start`; 0 where noise explains it.

    free: the force without contact, mN.
    """
    shares = [0.0]
    for begin, end in pauses_of(ramp):
        if begin > start:
            lost, stderr, above = *_lost(ramp, (begin, end)), float(ramp.force[begin]) - free
            shares.append(lost / above if above > 0 and lost > SURELY * stderr else 0.0)
    return max(shares)


def gives_way(ramp: Ramp, free: Array, contact: float) -> bool:
    """Whether the force after the loading is lower than at the same depths in it: the sample relaxes, or keeps a deformation.

    free: the force without contact (n,), mN; contact: its displacement, mm.
    """
    last = ramp.stop + round(ramp.samples)
    depth, force = ramp.displacement[:last] - contact, ramp.record.force[:last] - free[:last]
    loading = slice(ramp.low, ramp.stop)
    rising, peak = np.maximum.accumulate(depth[loading]), float(ramp.force[ramp.stop - 1] - free[ramp.stop - 1])
    after = np.flatnonzero(depth[ramp.stop :] > DEEP * rising[-1]) + ramp.stop
    if after.size < FEWEST or peak <= 0:
        return False
    lower = np.interp(depth[after], rising, ramp.force[loading] - free[loading]) - force[after]
    return float(lower.mean()) > GIVES_WAY * peak + SURELY * noise_of(ramp.record.force) / float(np.sqrt(after.size))


def _joined(ramp: Ramp, pauses: Pauses, stop: int, filter_share: float, indenter: str | None) -> FirstStage | None:
    """The stage up to the sample `stop` with its pauses cut out; None where that is no loading."""
    lost = [_lost(ramp, pause) for pause in pauses]
    given = np.array([force for force, _ in lost])
    try:
        approach = fitted_approach(find_ramp(_without(ramp.record, pauses, given, stop), filter_share), indenter)
        moved = [
            fitted_approach(find_ramp(_without(ramp.record, pauses, given + change, stop), filter_share), indenter)
            for change in np.diag([stderr for _, stderr in lost])
        ]
    except RecordError:
        return None
    return FirstStage(stop, approach, float(np.linalg.norm([rival.model.contact - approach.model.contact for rival in moved])))


def _without(record: RawRecord, pauses: Pauses, given: Array, stop: int) -> RawRecord:
    """The record up to the sample `stop` without pauses, its force raised after each by what is given back, mN."""
    time, force, kept = record.time.copy(), record.force.copy(), np.ones(record.time.size, dtype=bool)
    for (begin, end), more in zip(pauses, given, strict=True):
        time[end:] -= record.time[end] - record.time[begin]
        force[end:] += more
        kept[begin:end] = False
    kept[stop:] = False
    return replace(replace(record, time=time, force=force, uneven=None).part(kept), name=record.name)


def _lost(ramp: Ramp, pause: tuple[int, int]) -> tuple[float, float]:
    """By how much the force falls in a pause, mN, and the standard error: by straight lines before it and in its second half."""
    begin, end = pause
    before = slice(max(0, begin - max(FEWEST, ramp.length)), begin)
    within = slice((begin + end) // 2, end)
    sides = [_line_at(ramp.record, part, at) for part, at in ((before, begin), (within, end - 1))]
    return sides[0][0] - sides[1][0], float(np.hypot(sides[0][1], sides[1][1]))


def _line_at(record: RawRecord, part: slice, sample: int) -> tuple[float, float]:
    """The force, mN, at a sample by a straight line over time through a part, and its standard error, mN."""
    age = record.time[part] - record.time[sample]
    terms = np.column_stack([np.ones_like(age), age / max(float(np.ptp(age)), 1e-300)])
    values = np.linalg.lstsq(terms, record.force[part], rcond=None)[0]
    rest = record.force[part] - terms @ values
    spread = np.linalg.pinv(terms.T @ terms) * float(rest @ rest) / max(age.size - 2, 1)
    return float(values[0]), float(np.sqrt(spread[0, 0]))
