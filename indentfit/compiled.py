"""Compilation by Numba: where compiled code is stored if the installation and the home folder are read-only, and threads."""

import inspect
import math
import os
import stat
import sys
import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba.extending import intrinsic
from numba.np.arrayobj import populate_array
from threadpoolctl import ThreadpoolController

_settings: Any = numba.config  # made from the environment: mypy does not see its fields
THREADS: int = _settings.NUMBA_NUM_THREADS


def compiled(**options: Any) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Decorator that compiles a function at its first call, and stores the compiled code for later processes where possible.

    The code is stored in Numba's own place, else in `private_place()`.

    Parameters
    ----------
    **options
        Further options of numba.njit.
    """

    def decorate(function: Callable[..., Any]) -> Callable[..., Any]:
        try:
            return numba.njit(cache=True, nogil=True, **options)(function)
        except RuntimeError:  # Numba: "no locator available"
            place = private_place()
            if place is None:
                return numba.njit(nogil=True, **options)(function)
            _settings.CACHE_DIR = str(place)
            return numba.njit(cache=True, nogil=True, **options)(function)

    return decorate


def is_stored(function: Any) -> bool:
    """Whether compiled code of a function of `compiled` is stored, since its source was last changed, or cannot be."""
    place = getattr(getattr(function, "stats", None), "cache_path", None)
    if place is None:
        return True
    source, name = Path(inspect.getfile(function.py_func)), function.py_func.__name__
    stored = [index.stat().st_mtime for index in Path(place).glob(f"{source.stem}.*{name}-*.nbi")]
    return max(stored, default=0.0) > source.stat().st_mtime


def private_place() -> Path | None:
    """A subfolder of the system's temporary folder that only this user can write, because its content is executed; or None."""
    if not hasattr(os, "getuid"):
        return None
    place = Path(tempfile.gettempdir()) / f"indentfit-compiled-{os.getuid()}"
    try:
        place.mkdir(mode=0o700, exist_ok=True)
        status = place.lstat()
    except OSError:
        return None
    ours = stat.S_ISDIR(status.st_mode) and status.st_uid == os.getuid() and not status.st_mode & 0o077
    return place if ours else None


def _on_stack(typingctx: Any, shape: Any) -> Any:
    """An array of doubles of a constant shape, not initialised, on the stack of the compiled function that calls it.

    The compiler knows that such arrays share no memory with any other. For those of numpy.empty it does not, and guards every
    inner loop with comparisons of addresses: the element loop then takes twice as long.
    """
    if not all(isinstance(length, numba.types.IntegerLiteral) for length in shape):
        return None  # Numba asks again with constants
    lengths = [length.literal_value for length in shape]
    kind = numba.types.Array(numba.types.float64, len(lengths), "C")

    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        with builder.goto_entry_block():  # `cgutils.alloca_once` would store zeros, number by number in machine code
            block = builder.alloca(ir.ArrayType(ir.DoubleType(), math.prod(lengths)))
        block.align = 64
        array = context.make_array(kind)(context, builder)
        strides = [8 * math.prod(lengths[n + 1 :]) for n in range(len(lengths))]
        populate_array(
            array,
            data=builder.bitcast(block, array.data.type),
            shape=[context.get_constant(numba.types.intp, n) for n in lengths],
            strides=[context.get_constant(numba.types.intp, n) for n in strides],
            itemsize=context.get_constant(numba.types.intp, 8),
            meminfo=None,
        )
        return array._getvalue()

    return kind(shape), code


on_stack: Any = np.empty if _settings.DISABLE_JIT else intrinsic(_on_stack)


def on_threads(number: int, work: Callable[[Any], Any], parts: Sequence[Any]) -> list[Any]:
    """[work(part) for each part], on a number of threads; compiled functions release the interpreter's lock."""
    return list(_threads(number).map(work, parts)) if number > 1 else [work(part) for part in parts]


@cache
def _threads(number: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(number, thread_name_prefix="compiled")


def one_blas_thread() -> AbstractContextManager[Any]:
    """Context in which NumPy's OpenBLAS has one thread. Its threads wait actively: the many products of small matrices of a fit
    take a twelfth more processor time with two, and those of relaxation functions of many terms ten times. Results are also the
    same with any number of cores. The limit is that of the process: where two fits run in threads, the first that ends lifts it."""
    return libraries().select(internal_api="openblas").limit(limits=1)


def libraries() -> ThreadpoolController:
    """The libraries with threads of their own. The search for them takes 1.4 ms: it is made anew where a module was imported."""
    return _libraries(len(sys.modules))


@lru_cache(maxsize=1)
def _libraries(_modules: int) -> ThreadpoolController:
    return ThreadpoolController()
