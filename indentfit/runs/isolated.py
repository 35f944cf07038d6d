"""One function call in a process of its own: a fresh one, so that its processor time and memory can be measured, or one beside
other work. The caller survives the death of the process."""

import contextlib
import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.context import BaseContext
from pathlib import Path
from typing import Any, TypeVar

from indentfit.runs.start import context, deaf_to_interrupts, one_thread

Returned = TypeVar("Returned")

DIED = "its process was killed (out of memory?)"


class Died(Exception):
    """The process ended before the call did."""


def isolated(function: Callable[..., Returned], *arguments: Any) -> Returned:
    """The value of function(*arguments), called in a new process that may use all cores. Raises Died, and every exception of the
    function."""
    with _called(multiprocessing.get_context("spawn"), function, *arguments, environment=contextlib.nullcontext()) as value:
        return value()


@contextlib.contextmanager
def beside(function: Callable[..., Returned], *arguments: Any) -> Iterator[Callable[[], Returned]]:
    """Context beside which function(*arguments) is called in a process of its own, started as workers are.

    The context gives a function that waits for the value; it raises Died, and every exception of the function. The process is
    ended where the block fails.
    """
    with _called(context(), function, *arguments, environment=one_thread()) as value:
        yield value


@contextlib.contextmanager
def _called(
    start: BaseContext,
    function: Callable[..., Returned],
    *arguments: Any,
    environment: contextlib.AbstractContextManager[object],
) -> Iterator[Callable[[], Returned]]:
    """Context as of `beside`; the environment is that of the process' start alone."""
    with ProcessPoolExecutor(1, start, initializer=begin_as_child) as executor:
        try:
            with environment, deaf_to_interrupts():
                future = executor.submit(function, *arguments)

            def value() -> Returned:
                try:
                    return future.result()
                except BrokenProcessPool as error:
                    raise Died(DIED) from error

            yield value
        except BaseException:
            for process in list((executor._processes or {}).values()):
                process.terminate()
            raise


def peak_memory() -> int:
    """Largest memory that this process has held so far, in bytes."""
    status = Path("/proc/self/status")
    if status.exists():  # getrusage would include the parent process there
        line = next(line for line in status.read_text().splitlines() if line.startswith("VmHWM:"))
        return int(line.split()[1]) * 1024
    import resource  # not on Windows

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)


def available_memory() -> int | None:
    """Memory that a new process can have, bytes: that of the machine or of its control group; None where it is unknown."""
    limits = []
    table = Path("/proc/meminfo")
    if table.exists():
        line = next((line for line in table.read_text().splitlines() if line.startswith("MemAvailable:")), None)
        limits += [int(line.split()[1]) * 1024] if line else []
    limit, used = Path("/sys/fs/cgroup/memory.max"), Path("/sys/fs/cgroup/memory.current")
    if limit.exists() and used.exists() and (text := limit.read_text().strip()).isdigit():
        limits.append(int(text) - int(used.read_text()))
    if not limits and hasattr(os, "sysconf") and "SC_PHYS_PAGES" in os.sysconf_names:
        limits.append(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    return min(limits, default=None)


def begin_as_child() -> None:
    """In a process that works for another one: be deaf to Ctrl-C, which is for the parent; end at SIGTERM, or with the parent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
    os._exit(1)
