"""What a rig recorded: displacement and force over time, and how a lab's file holds them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import RecordError

CHANNELS = ("time", "displacement", "force")
STRAINS = (0.02, 0.05, 0.1)


@dataclass(frozen=True, eq=False)
class Record:
    """One run of the rig: `time` s, `displacement` mm (rising into the sample), `force` mN (rising in compression), each (n,).

    The zeros of displacement and force are those of the sensors; `notes` says what was left out or repaired on the way in.
    Raises RecordError where the three do not have one length.
    """

    time: np.ndarray
    displacement: np.ndarray
    force: np.ndarray
    name: str = ""
    notes: tuple[str, ...] = ()

    def __post_init__(self):
        for channel in CHANNELS:
            values = np.array(getattr(self, channel), dtype=float)
            values.flags.writeable = False
            object.__setattr__(self, channel, values)
        if self.time.ndim != 1 or not self.time.shape == self.displacement.shape == self.force.shape:
            shapes = ", ".join(str(getattr(self, channel).shape) for channel in CHANNELS)
            raise RecordError(f"{self.name}: time, displacement and force must have one length; their shapes are {shapes}")

    @property
    def interval(self):
        """Time between two samples, s: the median."""
        return float(np.median(np.diff(self.time)))


@dataclass(frozen=True)
class Channel:
    """How a column becomes a quantity: sign * gain * value + offset, in `unit`.

    column: name in a header row, or number from 1; None lets the header tell. unit None is that of the header.
    """

    column: str | int | None = None
    gain: float | None = None
    sign: int = 1
    offset: float = 0.0
    unit: str | None = None


@dataclass(frozen=True)
class Layout:
    """How a lab's file holds a record. rate in Hz, or `time`, a column; skip_rows: lines before the table; sheet: of a workbook.

    encoding, separator and decimal mark None are told from the file.
    """

    displacement: Channel = Channel()
    force: Channel = Channel()
    rate: float | None = None
    time: Channel = Channel()
    skip_rows: int = 0
    sheet: str | int | None = None
    encoding: str | None = None


@dataclass(frozen=True)
class Options:
    """How records are processed. contact: a method of `contact.METHODS`; indenter: "flat" or "sphere"; points: of the curve;
    filter: its length over the ramp's duration; strains: of the thickness, at which forces are wanted; prony_terms: 1 to 3,
    "auto", or 0 for none.
    """

    contact: str = "piecewise"
    indenter: str = "flat"
    points: int = 25
    filter: float = 0.1
    strains: tuple[float, ...] = STRAINS
    prony_terms: int | str = 2
