"""Worker processes on this machine, each with one unit at a time, so that it is known what was lost with one.

Objects go between them by pickle, over pipes that nobody else can reach. Scripts that start them need the usual
`if __name__ == "__main__":`, since they are spawned.
"""

import contextlib
import multiprocessing
import os
import signal
import threading
import time
import traceback
from collections import deque
from dataclasses import dataclass
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Any

from indentfit.errors import WorkerError
from indentfit.runs.bench import Bench, too_long
from indentfit.runs.run import Run

THREAD_VARIABLES = ("MKL_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")
START = 600.0  # seconds for a process to start: to import, to compile the element loop once, and to mesh
STILLBORN = 3  # processes that die one after the other before they are ready: no use to start more
TICK = 1.0  # seconds between two looks at the clock
READY, MEMORY = "ready", "memory"


@dataclass
class _Worker:
    """A process, our end of its pipe, and the unit it is at."""

    process: BaseProcess
    pipe: Connection
    unit: tuple | None = None
    started: float = 0.0
    ready: bool = False


class Processes:
    """Up to `number` worker processes for a case; `limit`: seconds that a run may take."""

    def __init__(self, case, number, limit):
        self.case, self.number, self.limit = case, number, limit
        self._workers: list[_Worker] = []
        self._stillborn = 0

    def solve(self, units, names, stopping):
        """Yield (unit, Run) of each unit, in the order in which they end; nothing is begun once stopping() is true.

        A unit that was lost with its worker is run again, each alone: where memory is short, it has all of it. A
        second loss is its failure. Raises WorkerError where no process can be started.
        """
        lost = yield from self._share(units, names, self.number, stopping)
        for unit in lost:
            again = yield from self._share([unit], names, 1, stopping)
            for one, how in again.items():
                yield one, Run(None, f"its worker process was lost twice ({how})", 0.0, {}, lost=True)

    def close(self, now=False):
        """End the processes; those at work are not waited for with `now`."""
        workers, self._workers = self._workers, []
        for worker in workers:
            if now or worker.unit is not None:
                worker.process.kill()
            worker.pipe.close()  # an idle process ends with it
        for worker in workers:
            worker.process.join(5)
            if worker.process.is_alive():
                worker.process.kill()

    def _share(self, units, names, number, stopping):
        """Yield (unit, Run); returns the units that were lost, each with how."""
        queue = deque(units)
        lost: dict[tuple, str] = {}
        while True:
            if not stopping():
                self._give_out(queue, names, number)
            busy = [worker for worker in self._workers if worker.unit is not None]
            if not busy:
                return lost
            wait([worker.pipe for worker in busy], timeout=TICK)
            ended: list[tuple[Any, Any]] = [(worker.unit, self._heard(worker)) for worker in busy]
            if not stopping():
                self._give_out(queue, names, number)  # before the caller writes down what ended: nobody waits for the disk
            for unit, heard in ended:
                if isinstance(heard, Run):
                    yield unit, heard
                elif heard:
                    lost[unit] = heard

    def _give_out(self, queue, names, number):
        """A unit for each idle process, and for new ones as long as there are fewer than `number`."""
        self._workers = [worker for worker in self._workers if worker.unit is not None or worker.process.is_alive()]
        for worker in self._workers:
            if queue and worker.unit is None:
                self._give(worker, queue, names)
        while queue and sum(worker.unit is not None for worker in self._workers) < number:
            self._workers.append(_started(self.case))
            self._give(self._workers[-1], queue, names)

    def _give(self, worker, queue, names):
        with contextlib.suppress(OSError):  # one that has just died is found out when it is listened to
            worker.pipe.send((queue[0], names))
        worker.unit, worker.started = queue.popleft(), time.monotonic()

    def _heard(self, worker):
        """The Run that a process sends, how its unit was lost, or None where there is nothing new."""
        try:
            if worker.pipe.poll():
                return self._message(worker, worker.pipe.recv())
        except (EOFError, OSError):
            return self._dead(worker)
        if not worker.process.is_alive() and not worker.pipe.poll():
            return self._dead(worker)
        if time.monotonic() - worker.started > (self.limit if worker.ready else START):
            self._drop(worker)
            return too_long(self.limit) if worker.ready else f"not ready after {START:g} s"
        return None

    def _message(self, worker, message):
        if message == READY:
            worker.ready, worker.started, self._stillborn = True, time.monotonic(), 0
            return None
        if message == MEMORY:
            self._drop(worker)
            return "out of memory"
        worker.unit = None
        if isinstance(message, Run):
            return message
        raise RuntimeError(message)  # a bug, with its traceback

    def _dead(self, worker):
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

    def _drop(self, worker):
        worker.process.kill()
        worker.process.join(5)
        worker.pipe.close()
        worker.unit = None
        self._workers = [other for other in self._workers if other is not worker]


def _started(case):
    """A new process. Ctrl-C reaches all processes of a terminal: it is for the parent to say what shall end."""
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=_serve, args=(case, theirs), daemon=True)
    try:
        with one_thread(), deaf_to_interrupts():
            process.start()
    except OSError as error:
        raise WorkerError(f"no worker process can be started ({error.strerror or error}); try --workers 1") from error
    theirs.close()
    return _Worker(process, ours, started=time.monotonic())


@contextlib.contextmanager
def one_thread():
    """Environment in which a new process starts its numerical libraries with one thread."""
    before = {name: os.environ.get(name) for name in THREAD_VARIABLES}
    os.environ.update(dict.fromkeys(THREAD_VARIABLES, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


@contextlib.contextmanager
def deaf_to_interrupts():
    """Context in which processes and threads are started that Ctrl-C does not reach; one that comes now is not lost."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    resource_tracker.ensure_running()  # Python starts it with the first process, and opens the ear to Ctrl-C again before that
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


# In the worker's process


def _serve(case, pipe):
    """Run units until the pipe is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    bench = Bench(case)
    with contextlib.suppress(EOFError, OSError):
        try:
            bench.ready()
            pipe.send(READY)
            while True:
                pipe.send(bench.run(*pipe.recv()))
        except MemoryError:
            pipe.send(MEMORY)
        except (EOFError, OSError):
            raise
        except Exception:
            pipe.send(traceback.format_exc())


def _end_with_parent():
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
    os._exit(1)
