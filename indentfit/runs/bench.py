"""One run of the forward model at a time: a test at a set of parameters, whatever happens in it, within its time.

The unit of work is ((name, value), ...) of all parameters and the number of a test. A run does not depend on those
before it, nor on the process that it falls to, so results are the same, bit by bit, with any number of workers.
"""

import contextlib
import ctypes
import threading
import time

import numpy as np
from threadpoolctl import threadpool_limits

from indentfit.errors import ConvergenceError, MaterialError
from indentfit.fem.setup import Press
from indentfit.fem.simulate import Model
from indentfit.material import blamed, typed
from indentfit.runs.points import setting, setup_of
from indentfit.runs.run import Run

FIRST = "mu / 2 * (I1 - 3)"  # the energy of the run that comes before all others
MEMORY = "out of memory, twice"
M_TRIM_THRESHOLD, M_MMAP_THRESHOLD = -1, -3  # malloc.h of glibc


class Bench:
    """A ready model of a case, on which one unit is run after the other; made anew after a run that was broken off.

    limit: seconds that a run may take, None where somebody else sees to that. Python code is broken off in time, a
    call into a library when it comes back.
    """

    def __init__(self, case, limit=None):
        self.case, self.limit = case, limit
        self._model = None
        _keep_memory()

    def ready(self):
        """The model; it takes seconds to make."""
        self._model = self._model or ready_model(self.case)
        return self._model

    def run(self, unit, names=()):
        """The Run of a unit with the sensitivities `names`. Raises MemoryError."""
        finished = False
        try:
            with threadpool_limits(1):
                model = self.ready()
                with _within(self.limit):
                    found = run(model, self.case, unit, names)
                finished = True
                return found
        except _OutOfTime:
            return too_long(self.limit)
        finally:
            self._model = self._model if finished else None

    def run_at_last(self, unit, names=()):
        """The Run of a unit, tried again where memory ran out."""
        for _ in range(2):
            with contextlib.suppress(MemoryError):
                return self.run(unit, names)
        return Run(None, MEMORY, 0.0, {}, lost=True)


def _keep_memory():
    """Let glibc keep the memory that a run frees for the next one: to give pages back and ask for them anew takes 4 to 6 % of a
    run, more with every further worker. Other systems' allocators are left as they are."""
    with contextlib.suppress(AttributeError, OSError, TypeError):
        libc = ctypes.CDLL(None)
        libc.mallopt(M_MMAP_THRESHOLD, 32 * 2**20)  # as large as glibc allows
        libc.mallopt(M_TRIM_THRESHOLD, 2**30)


def ready_model(case):
    """The Model of a case, run once.

    The first run fixes the order of elimination of the linear solver, which depends on the numbers in the matrix:
    with the same first run everywhere, every later run is the same everywhere. It is a small indentation of a gel, so
    that it does not depend on where a search starts.
    """
    model = Model(setup_of(case))
    depth = max(float(case.outputs(test)[-1]) for test in case.tests)
    with contextlib.suppress(ConvergenceError, MaterialError):
        model.run(Press(typed(FIRST, ["mu"])(mu=1.0), case.material.bulk_modulus(1.0), 0, np.array([depth * 1e-3])))
    return model


def run(model, case, unit, names=()):
    """The Run of a unit on a model of the case. What a material from a plugin raises is a cause, not an error."""
    (key, number), started = unit, time.perf_counter()
    test, kind = case.tests[number], case.law
    force, cause, facts, sensitivities = None, None, {}, None
    try:
        at = setting(case, dict(key))
        model = model if at.same_model else ready_model(at.case)
        with blamed(kind):
            material, depths = kind(**at.parameters), at.outputs(test)
            kappa = at.case.material.bulk_modulus(material.shear_modulus)
        pressed = depths > 0  # before contact there is no force
        result = model.run(Press(material, kappa, test.angle, depths[pressed], sensitivities=tuple(names)))
        force, facts = _where(pressed, result.force), result.facts.as_json()
        sensitivities = _of_all(names, result, pressed) if names else None
        if not np.isfinite(force).all():
            force, sensitivities, cause = None, None, "its force is not a finite number"
    except (ConvergenceError, MaterialError) as error:
        cause = " ".join(str(error).split())
    return Run(force, cause, time.perf_counter() - started, facts, sensitivities)


def _where(pressed, values):
    """Values at the depths pressed, (n,) booleans, and 0 at the others."""
    found = np.zeros(pressed.size)
    found[pressed] = values
    return found


def _of_all(names, result, pressed):
    """Name -> derivatives of the forces, NaN where the model has none: so it is known that they were asked for."""
    given = getattr(result, "sensitivities", None) or {}
    return {name: _where(pressed, given.get(name, np.nan)) for name in names}


def too_long(limit):
    """The Run that was broken off after its time."""
    cause = f"not solved within {limit:g} s; give it longer with fit.time_limit, if it deserves that"
    return Run(None, cause, limit, {}, lost=True)


class _OutOfTime(BaseException):
    """Raised within a run by the clock; no `except Exception` on its way stops it."""


@contextlib.contextmanager
def _within(seconds):
    """Context that raises _OutOfTime in its own thread once the time is over, in any thread and on any system.

    An exception that was set is awaited and caught, never taken back: CPython would go on looking for it at every step, and in
    3.11 hang where a debugger, a profiler or a coverage tool traces.
    """
    thread, lock, ended, struck, raised = threading.get_ident(), threading.Lock(), False, False, False

    def end():
        nonlocal struck
        with lock:
            if not ended:
                struck = True
                ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(thread), ctypes.py_object(_OutOfTime))

    if seconds is None:
        yield
        return
    clock = threading.Timer(seconds, end)
    clock.daemon = True
    try:
        clock.start()
    except RuntimeError as error:  # no thread can be started
        raise MemoryError from error
    try:
        yield
    except _OutOfTime:
        raised = True
        raise
    finally:
        try:
            with lock:
                ended = True
            clock.cancel()
            while struck and not raised:
                time.sleep(0)  # it is on its way
        except _OutOfTime:
            clock.cancel()
