"""Worker processes on this machine, each with one request at a time, so that the request of a lost process is known.

Objects pass between the processes by pickle, over private pipes. A script that starts the processes needs the usual
`if __name__ == "__main__":` (runs/start.py says how they are started).
"""

import contextlib
import multiprocessing
import os
import signal
import threading
import time
import traceback
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Any

from indentfit.errors import WorkerError
from indentfit.runs.bench import Bench
from indentfit.runs.mechanics import Mechanics
from indentfit.runs.run import Run, RunRequest, out_of_time
from indentfit.runs.start import context, deaf_to_interrupts, one_thread
from indentfit.runs.watch import Watch

START = 600.0  # seconds for a process to start: to import, to compile the element loop once, and to mesh
STILLBORN = 3  # no more processes are started after so many that died one after the other before they were ready
TICK = 1.0  # seconds between two checks of the clock
READY, MEMORY = "ready", "memory"


@dataclass
class _Worker:
    """A process, the parent's end of its pipe, and its present request."""

    process: BaseProcess
    pipe: Connection
    watch: Watch
    request: RunRequest | None = None
    ready: bool = False
    started: float = field(default_factory=time.monotonic)


class Processes:
    """Up to `number` worker processes for a case: a Pool.

    Parameters
    ----------
    mechanics : Mechanics
    number : int
    limit : float, s
        Processor time that a run may take.
    """

    def __init__(self, mechanics: Mechanics, number: int, limit: float) -> None:
        self.mechanics, self.number, self.limit = mechanics, number, limit
        self._workers: list[_Worker] = []
        self._stillborn = 0

    def solve(self, requests: Iterable[RunRequest], stopping: Callable[[], object]) -> Iterator[tuple[RunRequest, Run]]:
        """Yield (request, Run) in the order in which the runs end; no run begins once stopping() is true.

        A request that was lost with its worker is run again, without others beside it, so that it has all of the memory. A request
        that is lost twice has failed. Raises WorkerError where no process can be started.
        """
        lost = yield from self._share(requests, self.number, stopping)
        for request in lost:
            lost_again = yield from self._share([request], 1, stopping)
            for how in lost_again.values():
                yield request, Run(None, f"its worker process was lost twice ({how})", 0.0, {}, lost=True)

    def close(self, now: bool = False) -> None:
        """End the processes; `now` does not wait for running requests."""
        workers, self._workers = self._workers, []
        for worker in workers:
            if now or worker.request is not None:
                worker.process.kill()
            worker.pipe.close()  # an idle process ends when its pipe is closed
        for worker in workers:
            worker.process.join(5)
            if worker.process.is_alive():
                worker.process.kill()

    def _share(
        self, requests: Iterable[RunRequest], number: int, stopping: Callable[[], object]
    ) -> Generator[tuple[RunRequest, Run], None, dict[RunRequest, str]]:
        """Yield (request, Run); returns the lost requests, each with the way in which it was lost."""
        queue = deque(requests)
        lost: dict[RunRequest, str] = {}
        while True:
            if not stopping():
                self._give_out(queue, number)
            busy = [(worker, worker.request) for worker in self._workers if worker.request is not None]
            if not busy:
                return lost
            wait([worker.pipe for worker, _ in busy], timeout=TICK)
            ended = [(request, self._heard(worker)) for worker, request in busy]
            if not stopping():
                self._give_out(queue, number)  # before the caller stores the ended run, so that no process waits for the disk
            for request, heard in ended:
                if isinstance(heard, Run):
                    yield request, heard
                elif heard:
                    lost[request] = heard

    def _give_out(self, queue: deque[RunRequest], number: int) -> None:
        """Give a request to each idle process, and to new processes as long as there are fewer than `number`."""
        self._workers = [worker for worker in self._workers if worker.request is not None or worker.process.is_alive()]
        for worker in self._workers:
            if queue and worker.request is None:
                _give(worker, queue.popleft())
        while queue and sum(worker.request is not None for worker in self._workers) < number:
            self._workers.append(_started(self.mechanics, self.limit))
            _give(self._workers[-1], queue.popleft())

    def _heard(self, worker: _Worker) -> Run | str | None:
        """The Run that a process sends, or how its request was lost, or None without news."""
        try:
            if worker.pipe.poll():
                return self._message(worker, worker.pipe.recv())
        except (EOFError, OSError):
            return self._dead(worker)
        if not worker.process.is_alive() and not worker.pipe.poll():
            return self._dead(worker)
        if not worker.ready and time.monotonic() - worker.started > START:
            self._drop(worker)
            return f"not ready after {START:g} s"
        if worker.ready and worker.watch.is_overdue():
            self._drop(worker)
            return out_of_time(self.limit)
        return None

    def _message(self, worker: _Worker, message: Any) -> Run | str | None:
        if message == READY:
            worker.ready, self._stillborn = True, 0
            worker.watch.begin()
            return None
        if message == MEMORY:
            self._drop(worker)
            return "out of memory"
        worker.request = None
        if isinstance(message, Run):
            return message
        raise RuntimeError(message)  # a bug, with its traceback

    def _dead(self, worker: _Worker) -> str:
        self._drop(worker)
        if not worker.ready:
            self._stillborn += 1
        if self._stillborn >= STILLBORN:
            raise WorkerError(
                f"worker processes die at their start (exit code {worker.process.exitcode}): out of memory, or a script "
                'without `if __name__ == "__main__":`; try --workers 1'
            )
        code = worker.process.exitcode
        return f"killed by signal {-code}, perhaps for want of memory" if code and code < 0 else f"exit code {code}"

    def _drop(self, worker: _Worker) -> None:
        worker.process.kill()
        worker.process.join(5)
        worker.pipe.close()
        worker.request = None
        self._workers = [other for other in self._workers if other is not worker]


def _give(worker: _Worker, request: RunRequest) -> None:
    with contextlib.suppress(OSError):  # `_heard` notices a process that has just died
        worker.pipe.send(request)
    worker.request = request
    worker.watch.begin()


def _started(mechanics: Mechanics, limit: float) -> _Worker:
    """A new process, deaf to Ctrl-C, which reaches all processes of a terminal: the parent alone decides what ends."""
    begin = context()
    ours, theirs = begin.Pipe()
    process = begin.Process(target=_serve, args=(mechanics, theirs, limit), daemon=True)  # type: ignore[attr-defined]
    try:
        with one_thread(), deaf_to_interrupts():
            process.start()
    except (OSError, EOFError) as error:
        what = getattr(error, "strerror", None) or str(error) or "the server of processes has ended"
        raise WorkerError(f"no worker process can be started ({what}); try --workers 1") from error
    theirs.close()
    return _Worker(process, ours, Watch(process.pid, limit))


# In the worker's process


def _serve(mechanics: Mechanics, pipe: Connection, limit: float) -> None:
    """Run requests until the pipe is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    bench = Bench(mechanics, limit)
    with contextlib.suppress(EOFError, OSError):
        try:
            bench.ready()
            pipe.send(READY)
            while True:
                pipe.send(bench.run(pipe.recv()))
        except MemoryError:
            pipe.send(MEMORY)
        except (EOFError, OSError):
            raise
        except Exception:
            pipe.send(traceback.format_exc())


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
    os._exit(1)
