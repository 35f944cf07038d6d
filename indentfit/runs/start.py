"""The start of processes: spawned, or forked from a server that has imported and compiled what every run needs.

A spawned worker imports 1.3 s (processor time) of libraries and loads the compiled element loop once more. `prepare` starts a
server that does both once, while the command reads and imports on; each worker is then a copy of the server, which shares its
memory. Only a command of the program `indentfit` prepares a server. A script that imports the package spawns its workers, so that
a worker always has the environment of the script at that moment.

This module needs the standard library alone: it runs before the libraries of the command are imported.
"""

import contextlib
import multiprocessing
import os
import signal
import sys
from collections.abc import Iterator
from multiprocessing import resource_tracker
from multiprocessing.context import BaseContext
from typing import TYPE_CHECKING

from indentfit.machine import cores

if TYPE_CHECKING:
    from indentfit.case import Case

PREPARED = "indentfit.runs.prepared"  # the module that the server imports
THREAD_VARIABLES = ("MKL_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")
SAFE_PATH = "PYTHONSAFEPATH"  # without it, the server would import files of the working folder

_prepared: list[int] = []  # process that prepared a server


def prepare() -> None:
    """Start the server that workers of this process are forked from, in the background; on other systems than Linux nothing.

    Forked processes are safe on Linux alone: libraries of macOS hold threads, and Windows cannot fork. Where the server cannot be
    started, workers are spawned.
    """
    if not sys.platform.startswith("linux") or is_prepared():
        return
    from multiprocessing import forkserver

    with contextlib.suppress(OSError, ValueError), one_thread(), deaf_to_interrupts(), _variables({SAFE_PATH: "1"}):
        forkserver.set_forkserver_preload([PREPARED])
        forkserver.ensure_running()
        _prepared.append(os.getpid())


def prepare_for(case: "Case", cluster: str | None = None, points: bool = False) -> None:
    """Prepare a server where the runs of a case will be given to more than one process of this machine.

    Parameters
    ----------
    case : Case
    cluster : str or None
        The cluster that computes the runs in the place of this machine.
    points : bool
        Whether the runs are of many variants of the case, as those of a sweep, and not of one fit.
    """
    if case.indentations and not cluster and (case.fit.workers or cores()) > 1 and (points or _has_many_runs(case)):
        prepare()


def _has_many_runs(case: "Case") -> bool:
    """Whether a fit of the case has runs for several workers: a single test whose force is only scaled is run once on each mesh."""
    uncertain = set(case.fit.uncertain.given) - {"mesh"}
    return len(case.tests) > 1 or bool(set(case.free) - {case.law.scale}) or bool(uncertain)


def is_prepared() -> bool:
    """Whether processes of this one are forked from a server."""
    return os.getpid() in _prepared


def context() -> BaseContext:
    """The context that starts processes: that of the server where this process has prepared one, else that which spawns."""
    return multiprocessing.get_context("forkserver" if is_prepared() else "spawn")


@contextlib.contextmanager
def one_thread() -> Iterator[None]:
    """Environment in which a new process starts its numerical libraries with one thread."""
    with _variables(dict.fromkeys(THREAD_VARIABLES, "1")):
        yield


@contextlib.contextmanager
def deaf_to_interrupts() -> Iterator[None]:
    """Context in which Ctrl-C does not reach the processes and threads that are started; the parent receives it afterwards."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    resource_tracker.ensure_running()  # Python would start the tracker before the first process, and unblock the signal again
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextlib.contextmanager
def _variables(values: dict[str, str]) -> Iterator[None]:
    """Environment with the values of some variables."""
    before = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
