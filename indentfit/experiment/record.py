"""What a rig recorded: displacement and force over time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from indentfit.errors import RecordError

CHANNELS = ("time", "displacement", "force")


@dataclass(frozen=True, eq=False)
class RawRecord:
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
