"""What is compiled by Numba, where that is kept when nobody may write to the installation or the home folder, and its threads."""

import os
import stat
import tempfile
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path

import numba

THREADS = numba.config.NUMBA_NUM_THREADS


def compiled(**options):
    """Decorator that compiles a function at its first call, and keeps it for later processes where there is a place for that.

    The places are Numba's own, else `private_place()`. options: further ones of numba.njit.
    """

    def decorate(function):
        try:
            return numba.njit(cache=True, nogil=True, **options)(function)
        except RuntimeError:  # Numba: "no locator available"
            place = private_place()
            if place is None:
                return numba.njit(nogil=True, **options)(function)
            numba.config.CACHE_DIR = str(place)
            return numba.njit(cache=True, nogil=True, **options)(function)

    return decorate


def private_place():
    """A folder in the system's temporary one that only this user can have written, since what is kept there is run; or None."""
    if not hasattr(os, "getuid"):
        return None
    place = Path(tempfile.gettempdir()) / f"indentfit-compiled-{os.getuid()}"
    try:
        place.mkdir(mode=0o700, exist_ok=True)
        found = place.lstat()
    except OSError:
        return None
    ours = stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & 0o077
    return place if ours else None


def on_threads(number, work, parts):
    """[work(part) for each part], on a number of threads; a compiled function lets others run while it does."""
    return list(_threads(number).map(work, parts)) if number > 1 else [work(part) for part in parts]


@cache
def _threads(number):
    return ThreadPoolExecutor(number, thread_name_prefix="compiled")
