"""The parent's watch over a worker process whose run never returns to the loops that check its deadline.

Such a run is in an endless loop of a law, or in a call that waits for ever. The parent measures the processor time of the child, so
that a busy machine ends no run early, and as a last resort the wall-clock time, for a child that sleeps.
"""

import contextlib
import os
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future, wait
from typing import TypeVar

import psutil

from indentfit.errors import OutOfTime

GRACE, SHARE_OF_GRACE = 2.0, 0.5  # s, and share of the limit: processor time beyond it, for the solver to check its deadline
PATIENCE, SHARE_OF_PATIENCE = 60.0, 10.0  # s, and multiple of the limit: wall-clock time after which a sleeping child is ended
LOOK = 0.5  # s between two checks of a process on itself
LONGEST_LOOK = 2.0  # s: a longer gap between two checks means that the machine slept, or that the parent was stopped

Result = TypeVar("Result")


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


def watched(work: Callable[[], Result], limit: float) -> Result:
    """The result of `work`, which runs in a thread of its own: for a worker whose parent is not ours, as one of Dask's.

    A thread cannot be ended, so one that is overdue is left behind, and its process is of no further use.

    Parameters
    ----------
    work : function without arguments
    limit : float, s
        Processor time that the work may take.

    Returns
    -------
    result of `work`

    Raises
    ------
    OutOfTime
        The work is overdue, and goes on.
    """
    answer: Future[Result] = Future()
    watch = Watch(os.getpid(), limit)
    threading.Thread(target=_answer, args=(work, answer), name="run", daemon=True).start()
    while not wait([answer], LOOK).done:
        if watch.is_overdue():
            raise OutOfTime(limit)
    return answer.result()


def _answer(work: Callable[[], Result], answer: "Future[Result]") -> None:
    try:
        answer.set_result(work())
    except BaseException as error:
        answer.set_exception(error)
