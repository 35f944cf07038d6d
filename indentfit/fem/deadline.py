"""A limit on the processor time of a run, which the solver's own loops check once an iteration."""

import math
import time
from dataclasses import dataclass, field

from indentfit.errors import OutOfTime


@dataclass(frozen=True)
class Deadline:
    """A point of processor time that lies a number of seconds after the making of this object.

    The clock is the processor time of the whole process, so a busy machine ends no run early.
    No exception is thrown into a running thread: a loop calls `check` once an iteration.

    Parameters
    ----------
    seconds : float, s
        Processor time that may pass; infinite where a run may take as long as it needs.
    """

    seconds: float
    _end: float = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_end", time.process_time() + self.seconds)

    def check(self) -> None:
        """Raise OutOfTime once the time is over.

        Raises
        ------
        OutOfTime
        """
        if self._end < math.inf and time.process_time() > self._end:
            raise OutOfTime(self.seconds)

    def sooner(self, seconds: float) -> "Deadline":
        """A deadline that ends after a number of seconds from now, but not later than this one."""
        return Deadline(max(0.0, min(seconds, self._end - time.process_time())))


NEVER = Deadline(math.inf)
