"""The raw record of a rig: displacement and force over time, as the sensors recorded them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from indentfit.arrays import Array
from indentfit.errors import RecordError

CHANNELS = ("time", "displacement", "force")
FEWEST = 50  # samples of a record


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

    @property
    def interval(self) -> float:
        """Time between two samples, s: the median."""
        return float(np.median(np.diff(self.time)))
