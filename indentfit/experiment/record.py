"""The raw record of a rig: displacement and force over time, as the sensors recorded them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from indentfit.arrays import Array, Bools
from indentfit.errors import RecordError

CHANNELS = ("time", "displacement", "force")
FEWEST = 50  # samples of a record
CUT_OFF = "the header tells of "  # begins the note on a file that holds fewer samples than its header says


@dataclass(frozen=True)
class Stated:
    """What a file states: radius of the sphere, mm, stiffness of cantilever or load cell, mN/mm, number of samples, Poisson's ratio
    of the sample, deflection of the cantilever, mm, per V, and sampling rate, Hz."""

    radius: float | None = None
    stiffness: float | None = None
    samples: int | None = None
    poisson: float | None = None
    sensitivity: float | None = None
    rate: float | None = None


@dataclass(frozen=True, eq=False)
class RawRecord:
    """The samples that a rig recorded in one run. The zeros of displacement and force are those of the sensors.

    Parameters
    ----------
    time : array (n,), s
    displacement : array (n,), mm
        Rises while the indenter moves into the sample.
    force : array (n,), mN
        Rises in compression.
    name : str
        The file, or another name, for messages.
    notes : tuple of str
        A note on everything that was left out or repaired when the file was read.
    taken : str
        What was taken from the file, one line: columns, units, signs, table; empty for a record in memory.
    stated : Stated
    stages : tuple of str, or None
        The stage or segment of each sample, where the file has a column of them.
    timed : bool
        Whether the times are times; rows are counted where a file has none.
    uneven : RawRecord or None
        The measured samples, where this record is interpolated at even steps of time.

    Raises
    ------
    RecordError
        The three arrays differ in length.
    """

    time: Array
    displacement: Array
    force: Array
    name: str = ""
    notes: tuple[str, ...] = ()
    taken: str = ""
    stated: Stated = Stated()
    stages: tuple[str, ...] | None = None
    timed: bool = True
    uneven: RawRecord | None = None

    def __post_init__(self) -> None:
        for channel in CHANNELS:
            values = np.array(getattr(self, channel), dtype=float)
            values.flags.writeable = False
            object.__setattr__(self, channel, values)
        if self.time.ndim != 1 or not self.time.shape == self.displacement.shape == self.force.shape:
            shapes = ", ".join(str(getattr(self, channel).shape) for channel in CHANNELS)
            raise RecordError(f"{self.name}: time, displacement and force must have one length; their shapes are {shapes}")

    def __repr__(self) -> str:
        return f"RawRecord({self.name!r}, {self.time.size} samples)"

    def part(self, kept: slice | Bools, note: str = "") -> RawRecord:
        """The record of some of the samples; a note says which."""
        stages = None if self.stages is None else tuple(np.asarray(self.stages, dtype=object)[kept])
        channels = {channel: getattr(self, channel)[kept] for channel in CHANNELS}
        return replace(self, **channels, stages=stages, notes=(*self.notes, *([note] if note else [])))

    @property
    def interval(self) -> float:
        """Time between two samples, s: the median."""
        return float(np.median(np.diff(self.time)))
