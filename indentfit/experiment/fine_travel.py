"""Displacements of a converter with coarse steps, interpolated between them.

While a stage moves through a step its converter shows one number for several samples. In the middle of them the stage is where the
number says; a step is no pause of the stage, and the last of them hides how far it goes. A stage that stays shows one number for
longer, and is left where it is.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from indentfit.arrays import Array
from indentfit.digits import quantity
from indentfit.experiment.record import RawRecord

FEWEST = 10  # steps that are looked at
COARSE = 3.0  # samples of a step from which it is coarse
STAYS = 2.5  # steps of the neighbours: a stage that shows one number for longer stays


def with_fine_travel(record: RawRecord) -> RawRecord:
    """The record with its displacement interpolated between the middles of coarse steps, with a note; itself where it has none.

    Parameters
    ----------
    record : RawRecord

    Returns
    -------
    RawRecord
    """
    displacement = record.displacement
    begins = np.append(0, np.flatnonzero(np.diff(displacement) != 0) + 1)
    ends = np.append(begins[1:], displacement.size)
    lengths = ends - begins
    if begins.size < FEWEST or np.median(lengths[1:-1]) < COARSE:
        return record
    moved = _interpolated(displacement[begins], begins, ends, displacement.size)
    step = float(np.median(np.abs(np.diff(displacement[begins]))))
    note = f"the displacement has steps of {quantity(step, 'mm', 3)}, and was interpolated between their middles"
    return replace(record, displacement=moved, notes=(*record.notes, note))


def _interpolated(levels: Array, begins: Array, ends: Array, count: int) -> Array:
    """Displacements (count,) through levels (m,) that show from sample `begins` to before `ends`."""
    lengths = (ends - begins).astype(float)
    whole = np.concatenate([[max(lengths[:2])], lengths[1:-1], [max(lengths[-2:])]])  # the record cuts the first and the last step
    near = np.minimum(np.append(lengths[1], whole[:-1]), np.append(whole[1:], lengths[-2]))
    stays = lengths > STAYS * near
    first, last = begins + near / 2 - 0.5, ends - near / 2 - 0.5
    middle = (begins + ends - 1) / 2
    places = np.column_stack([np.where(stays, first, middle), np.where(stays, last, middle)])
    values = np.column_stack([levels, levels])
    if stays[0]:
        places[0, 0] = 0
    else:  # the step had begun before the record
        places[0] = last[0]
    if stays[-1]:
        places[-1, 1] = count - 1
    else:
        places[-1] = first[-1]
    at, value = places.ravel(), values.ravel()
    kept = np.append(True, np.diff(at) > 0)
    at, value = at[kept], value[kept]
    samples = np.arange(count, dtype=float)
    moved = np.interp(samples, at, value)
    for outside, (a, b) in ((samples < at[0], (0, 1)), (samples > at[-1], (-2, -1))):
        slope = (value[b] - value[a]) / (at[b] - at[a])
        end = a if a == 0 else b
        moved[outside] = value[end] + slope * (samples[outside] - at[end])
    return moved
