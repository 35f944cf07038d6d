"""The parent's watch over a worker process whose run never returns to the loops that check its deadline.

Such a run is in an endless loop of a law, or in a call that waits for ever. The parent measures the processor time of the child, so
that a busy machine ends no run early, and as a last resort the wall-clock time, for a child that sleeps.
"""

import contextlib
import os
import threading
import time
from collections.abc import Iterator

import psutil

GRACE, SHARE_OF_GRACE = 2.0, 0.5  # s, and share of the limit: processor time beyond it, for the solver to check its deadline
PATIENCE, SHARE_OF_PATIENCE = 60.0, 10.0  # s, and multiple of the limit: wall-clock time after which a sleeping child is ended
LOOK = 0.5  # s between two checks of a process on itself
OVERDUE = 75  # exit code of a process that ended itself
LONGEST_LOOK = 2.0  # s: a longer gap between two checks means that the machine slept, or that the parent was stopped


class Watch:
    """Measures how long a process is at its present run.

    Parameters
    ----------
    pid : int
        The process.
    limit : float, s
        Processor time that a run may take.
    """

    def __init__(self, pid: int | None, limit: float) -> None:
        self.limit = limit
        self._process: psutil.Process | None = None
        with contextlib.suppress(psutil.Error, ValueError):
            self._process = psutil.Process(pid)
        self.begin()

    def begin(self) -> None:
        """A run begins now."""
        self._used, self._waited, self._looked = self._processor_time(), 0.0, time.monotonic()

    def is_overdue(self) -> bool:
        """Whether the run has exceeded its time; to be called about every second."""
        now = time.monotonic()
        self._waited += min(now - self._looked, LONGEST_LOOK)
        self._looked = now
        used = self._processor_time() - self._used
        return used > self.limit * (1 + SHARE_OF_GRACE) + GRACE or self._waited > self.limit * SHARE_OF_PATIENCE + PATIENCE

    def _processor_time(self) -> float:
        """Processor time of the process so far, s; 0 for an ended process, which the pool notices by itself."""
        with contextlib.suppress(psutil.Error):
            if self._process is not None:
                times = self._process.cpu_times()
                return times.user + times.system
        return 0.0


@contextlib.contextmanager
def ended_when_overdue(limit: float) -> Iterator[None]:
    """Context in which this process ends itself once a run is overdue: for a worker whose parent is not ours, as one of Dask's.

    Parameters
    ----------
    limit : float, s
        Processor time that the run may take.
    """
    done = threading.Event()

    def look() -> None:
        watch = Watch(os.getpid(), limit)
        while not done.wait(LOOK):
            if watch.is_overdue():
                os._exit(OVERDUE)

    guard = threading.Thread(target=look, name="run's watch", daemon=True)
    guard.start()
    try:
        yield
    finally:
        done.set()
        guard.join()
