"""Runs on a Dask cluster, existing or started on this machine: the same numbers, from other processes.

This module needs the extra `indentfit[cluster]`. dask.distributed sends objects by pickle between the processes of the cluster.
Anyone who can reach the scheduler can run code on its workers, so only the address that the user gave is used.
"""

import contextlib
import logging
import os
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from typing import Any

from indentfit.errors import OutOfTime, WorkerError
from indentfit.runs.bench import Bench
from indentfit.runs.key import Inputs
from indentfit.runs.mechanics import Mechanics
from indentfit.runs.run import Run, RunRequest, out_of_time
from indentfit.runs.start import deaf_to_interrupts
from indentfit.runs.watch import watched

LOCAL = "local"
PATIENCE = 30  # seconds to find the scheduler, and for it to have a worker
POLL = 0.01  # s between two looks for an ended run


class Cluster:
    """The workers of a Dask cluster: a Pool.

    Parameters
    ----------
    mechanics : Mechanics
    address : str
        Address of the scheduler ("tcp://host:8786"), or "local" for a cluster that is started on this machine.
    number : int
        Number of workers of a cluster that is started on this machine.
    limit : float, s
        Processor time that a run may take.
    """

    def __init__(self, mechanics: Mechanics, address: str, number: int, limit: float) -> None:
        self.mechanics, self.address, self.limit = mechanics, address, limit
        self.origin = Inputs(mechanics).origin
        self._dask = _distributed()
        self._own: Any = None
        self._client: Any = None
        try:
            with deaf_to_interrupts():
                self._connect(number)
        except BaseException:
            self.close()
            raise

    @property
    def _option(self) -> str:
        """The option that the user gave, for messages."""
        return "--cluster local" if self.address == LOCAL else f"--scheduler {self.address[:100]}"

    @property
    def number(self) -> int:
        """Number of simultaneous runs: one for each worker."""
        with self._there():
            return max(len(self._client.nthreads()), 1)

    def solve(self, requests: Iterable[RunRequest], stopping: Callable[[], object]) -> Iterator[tuple[RunRequest, Run]]:
        """Yield (request, Run) in the order in which the runs end; no run begins once stopping() is true.

        Dask runs the requests of a lost worker again, on another one. Raises WorkerError where the scheduler is lost.
        """
        queue = iter(requests)
        futures: dict[str, tuple[Any, RunRequest]] = {}
        course = self._dask.as_completed(loop=self._client.loop)

        def submit() -> None:
            while len(futures) < self.number and not stopping() and (request := next(queue, None)):
                future = self._submit(request)
                futures[future.key] = future, request
                course.add(future)

        try:
            submit()
            while futures:
                future, request = futures.pop(self._next(course).key)
                run = self._run(future)
                submit()  # before the caller stores the ended run, so that no worker waits for the disk
                yield request, run
        finally:
            with contextlib.suppress(Exception):  # the scheduler may be gone
                for future, _ in futures.values():
                    future.cancel()

    def close(self, now: bool = False) -> None:
        """Disconnect from the cluster, and end a cluster that was started here."""
        client, own, self._client, self._own = self._client, self._own, None, None
        for connected in (client, own):
            if connected is not None:
                with contextlib.suppress(Exception):  # it may be gone already
                    connected.close(timeout=0 if now else 5)

    def _connect(self, number: int) -> None:
        logging.getLogger("distributed").setLevel(logging.CRITICAL)  # indentfit's own message reports a failure in one line
        try:
            if self.address == LOCAL:
                self._own = self._dask.LocalCluster(
                    n_workers=number, threads_per_worker=1, host="127.0.0.1", dashboard_address=None, memory_limit=0,
                    silence_logs=logging.CRITICAL,
                )  # fmt: skip
            self._client = self._dask.Client(self._own or self.address, timeout=PATIENCE, set_as_default=False)
        except (OSError, ValueError, TypeError) as error:
            raise WorkerError(f"{self._option}: no Dask scheduler answers there ({str(error)[:200]}); check the address") from error
        try:
            self._client.wait_for_workers(1, timeout=PATIENCE)
        except (OSError, TimeoutError) as error:
            raise WorkerError(f"{self._option}: the cluster has no workers; start some with `dask worker`") from error

    def _submit(self, request: RunRequest) -> Any:
        with self._there():
            return self._client.submit(run_there, self.mechanics, request, self.limit, self.origin, pure=False)

    def _next(self, course: Any) -> Any:
        """The next future that ends. Raises WorkerError after PATIENCE seconds without a worker: Dask would wait."""
        last_seen = time.monotonic()
        while True:
            with self._there():
                looked = time.monotonic()
                while time.monotonic() < looked + NEWS:
                    if course.has_ready():
                        return next(course)
                    time.sleep(POLL)
                if self._client.nthreads():
                    last_seen = time.monotonic()
            if time.monotonic() > last_seen + PATIENCE:
                what = f"the cluster has had no workers for {PATIENCE} s (lost, or left with a run that never came back)"
                raise WorkerError(f"{self._option}: {what}; start some with `dask worker`, best with a nanny")

    def _run(self, future: Any) -> Run:
        with self._there():
            error = future.exception()
            if error is None:
                return future.result()
        if isinstance(error, OutOfTime):
            return out_of_time(self.limit)
        if isinstance(error, self._dask.scheduler.KilledWorker):
            cause = "its workers were lost, one after the other (out of memory, or killed)"
            return Run(None, cause, 0.0, {}, lost=True)
        if future.status == "cancelled" or isinstance(error, self._dask.CancelledError):
            raise self._gone(error) from error
        raise error

    @contextlib.contextmanager
    def _there(self) -> Iterator[None]:
        """Context in which every error of Dask means that the scheduler is lost."""
        try:
            yield
        except Exception as error:
            raise self._gone(error) from error

    def _gone(self, error: BaseException) -> WorkerError:
        return WorkerError(f"{self._option}: the scheduler was lost ({type(error).__name__}: {str(error)[:100]})")


def _distributed() -> Any:
    try:
        import distributed

        return distributed
    except ImportError:
        raise WorkerError("Dask is not installed; pip install 'indentfit[cluster]'") from None


# In the worker's process

NEWS = 1.0  # s for news of a worker to reach the scheduler
FAIR = 1e-4  # s between two changes of the thread, so that an endless loop delays the news as little as possible
AGAIN = 0.2  # s before a request that came to a leaving worker is sent back
OVERDUE = 75  # exit code of a worker that left because its run never came back

_lock = threading.Lock()  # a model does one run at a time, whatever the number of a worker's threads
_benches: dict[str, Bench] = {}
_leaving: set[str] = set()  # addresses of the workers of this process that a run that never comes back occupies


def run_there(mechanics: Mechanics, request: RunRequest, limit: float, origin: str) -> Run:
    """The Run of a request, on this worker's own bench.

    A worker whose run never comes back tells that by its error, which the scheduler keeps, and leaves the cluster in good order, so
    that no other request is blamed for the loss of the worker. Its nanny starts another worker; where it has none, the cluster has
    one worker less.
    """
    dask = _distributed()
    worker = dask.get_worker()
    with _lock:
        if worker.address in _leaving:
            time.sleep(AGAIN)
            raise dask.Reschedule
        bench = _bench(mechanics, limit, origin)
        try:
            return watched(partial(bench.run_at_last, request), limit)
        except OutOfTime:
            _leaving.add(worker.address)
            _benches.clear()
            threading.Thread(target=_leave, args=(worker, worker.get_current_task()), daemon=True).start()
            raise


def _bench(mechanics: Mechanics, limit: float, origin: str) -> Bench:
    """The bench of a case, ready, because a model is made, and its loops are compiled, outside the time of a run."""
    if origin not in _benches:
        if Inputs(mechanics).origin != origin:
            raise WorkerError("the cluster's workers have other versions of indentfit, its libraries or the material")
        _benches.clear()
        _benches[origin] = Bench(mechanics, limit)
        with contextlib.suppress(MemoryError):  # the run tries again
            _benches[origin].ready()
    return _benches[origin]


def _leave(worker: Any, key: str) -> None:
    """Once the error of the task `key` is out, let the scheduler take its worker out of the cluster, and place other tasks anew.

    The process is ended only where a nanny starts another, for it may be the user's own.
    """
    has_nanny, worker.nanny = worker.nanny is not None, None  # a nanny that is told that its worker leaves would leave with it
    sys.setswitchinterval(FAIR)
    until = time.monotonic() + PATIENCE
    while (task := worker.state.tasks.get(key)) and task.state == "executing" and time.monotonic() < until:
        time.sleep(AGAIN)
    time.sleep(NEWS)
    worker.loop.add_callback(worker.scheduler.retire_workers, workers=[worker.address], close_workers=False, remove=True)
    time.sleep(NEWS)
    if has_nanny:
        os._exit(OVERDUE)
