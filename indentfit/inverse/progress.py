"""How far a long computation is, told to whoever waits for it."""

from collections.abc import Callable
from dataclasses import dataclass

Report = Callable[[int, int], None]  # called with (runs done, runs asked for)


@dataclass(frozen=True)
class Progress:
    """Tells a share of the whole and a note to `listener`, called with (share, note); parts of the whole are Progress too."""

    listener: Callable[[float, str], object] | None = None
    low: float = 0.0
    high: float = 1.0

    def __call__(self, share: float, note: str = "") -> None:
        if self.listener is not None:
            self.listener(self.low + (self.high - self.low) * share, note)

    def part(self, low: float, high: float) -> "Progress":
        """The Progress of what takes this one from `low` to `high`, both shares of it."""
        width = self.high - self.low
        return Progress(self.listener, self.low + low * width, self.low + high * width)

    def of_runs(self, note: str) -> Report:
        """What a ForwardModel calls after each run, where runs are all that this Progress waits for."""

        def report(done: int, total: int) -> None:
            self(done / total, note)

        return report


SILENT = Progress()
