"""Progress of a long computation, as a share of the whole with a note."""

from collections.abc import Callable
from dataclasses import dataclass

from indentfit.runs.forward import Report


@dataclass(frozen=True)
class Progress:
    """Progress of a computation: a call passes the share of the whole and a note to `listener`; parts of it are Progress too."""

    listener: Callable[[float, str], object] | None = None
    low: float = 0.0
    high: float = 1.0

    def __call__(self, share: float, note: str = "") -> None:
        if self.listener is not None:
            self.listener(self.low + (self.high - self.low) * share, note)

    def part(self, low: float, high: float) -> "Progress":
        """The Progress of a part of the computation, from the share `low` of the whole to the share `high`."""
        width = self.high - self.low
        return Progress(self.listener, self.low + low * width, self.low + high * width)

    def of_runs(self, note: str) -> Report:
        """The function that a ForwardModel calls after each run, for a computation that consists of runs only."""

        def report(done: int, total: int) -> None:
            self(done / total, note)

        return report


SILENT = Progress()
