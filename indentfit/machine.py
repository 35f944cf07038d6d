"""The machine that this process runs on: its cores, and other Python processes on it. The standard library is enough for it."""

import contextlib
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path


def cores() -> int:
    """The number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextlib.contextmanager
def python_beside(code: str) -> Iterator[None]:
    """Context beside which another Python process runs some code, with the modules of this one; the context waits for its end.

    Its errors are not heard, and it never looks for garbage: it is for short work. No process is begun where this one has one core,
    or is a program with Python inside.
    """
    if cores() < 2 or not Path(sys.executable or "").name.startswith("python"):
        yield
        return
    whole, nothing = f"import gc, sys; gc.disable(); sys.path[:] = {sys.path!r}; {code}", subprocess.DEVNULL
    with subprocess.Popen([sys.executable, "-c", whole], stdin=nothing, stdout=nothing, stderr=nothing):
        yield
