"""Many runs of the forward model at once: worker processes with one solver thread each.

The unit of work is one test at one set of parameters, so that two cores stay busy whatever the size of a population.
A run does not depend on those before it, nor on which process it falls to, so results are the same, bit by bit, with
any number of workers. Scripts that call this need the usual `if __name__ == "__main__":`, since workers are spawned.
"""

import contextlib
import multiprocessing
import os
import signal
import threading
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits

from indentfit.errors import ConvergenceError, MaterialError
from indentfit.fem.simulate import Model
from indentfit.inverse.inputs import setting

THREAD_VARIABLES = ("MKL_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")
DIED = "its worker process died twice (out of memory, or killed)"


@dataclass(frozen=True)
class Run:
    """One test at one set of parameters: its forces, mN, shape (n,), or the cause why there are none."""

    force: np.ndarray | None
    cause: str | None
    seconds: float
    facts: dict


@dataclass(frozen=True)
class Evaluation:
    """All tests at one set of parameters; `forces` is None and `cause` says why where one of them failed."""

    parameters: dict[str, float]
    forces: tuple[np.ndarray, ...] | None
    cause: str | None
    seconds: float
    facts: tuple[dict, ...]


class Pool:
    """Evaluates sets of parameters of a case, each only once; to be used in a `with` block.

    `runs` counts the runs of the forward model, `failures` holds every failed evaluation.
    """

    def __init__(self, case, workers=None):
        self.case, self.workers = case, workers or case.fit.workers or cores()
        self.runs, self.seconds, self.failures = 0, 0.0, []
        self._known: dict[tuple, Run] = {}
        self._executor = None
        self._model = None

    def __enter__(self):
        return self

    def __exit__(self, kind, *_):
        self.close(now=kind is not None)

    def close(self, now=False):
        """End the workers; `now` does not wait for what they are doing."""
        executor, self._executor = self._executor, None
        if executor is None:
            return
        processes = list((getattr(executor, "_processes", None) or {}).values())
        executor.shutdown(wait=not now, cancel_futures=True)
        for process in processes if now else ():
            process.terminate()

    @property
    def evaluations(self):
        """The number of different sets of parameters that were run."""
        return len({key for key, _ in self._known})

    def evaluate(self, points, progress=None):
        """Evaluations of a list of parameters (name -> value), in its order.

        progress: called with (runs done, runs asked for). Failures of the mechanics are recorded, never raised.
        """
        wanted = [(_key(point), test) for point in points for test in range(len(self.case.tests))]
        missing = [unit for unit in dict.fromkeys(wanted) if unit not in self._known]
        done = iter(range(1, len(missing) + 1))

        def finished(unit, run):
            self._known[unit] = run
            self.runs += 1
            self.seconds += run.seconds
            if progress:
                progress(next(done), len(missing))

        if self.workers == 1:
            self._run_here(missing, finished)
        else:
            self._run_there(missing, finished)
        evaluations = [self._evaluation(point) for point in points]
        for evaluation in evaluations:
            if evaluation.cause and evaluation.parameters not in [known.parameters for known in self.failures]:
                self.failures.append(evaluation)
        return evaluations

    def _evaluation(self, point):
        runs = [self._known[_key(point), test] for test in range(len(self.case.tests))]
        causes = [run.cause for run in runs if run.cause]
        forces = None if causes else tuple(run.force for run in runs if run.force is not None)
        seconds = sum(run.seconds for run in runs)
        return Evaluation(dict(point), forces, "; ".join(causes) or None, seconds, tuple(run.facts for run in runs))

    def _run_here(self, units, finished):
        for unit in units:
            with threadpool_limits(1):
                self._model = self._model or ready_model(self.case)
                finished(unit, run(self._model, self.case, *unit))

    def _run_there(self, units, finished):
        """A lost worker takes its pool along: try all again on a fresh one, then each alone to find the culprit."""
        for _ in range(2):
            units = self._submit(units, finished)
            if not units:
                return
        for unit in units:
            if self._submit([unit], finished):
                finished(unit, Run(None, f"test {self.case.tests[unit[1]].name!r}: {DIED}", 0.0, {}))

    def _submit(self, units, finished):
        """Run the units on the workers; returns those that were lost with a worker."""
        lost = []
        try:
            self._executor = self._executor or _executor(self.case, min(self.workers, max(len(units), 2)))
            with _one_thread():  # workers are started by the first submission and inherit this
                futures = {self._executor.submit(_work, unit): unit for unit in units}
        except BrokenProcessPool:
            self.close(now=True)
            return units
        for future in as_completed(futures):
            try:
                finished(futures[future], future.result())
            except BrokenProcessPool:
                lost.append(futures[future])
        if lost:
            self.close(now=True)
        return [unit for unit in units if unit in lost]


def cores():
    """The number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def ready_model(case):
    """The Model of a case, run once.

    The first run fixes the order of elimination of the linear solver, which depends on the numbers in the matrix:
    with the same first run everywhere, every later run is the same everywhere.
    """
    model = Model(case)
    with contextlib.suppress(ConvergenceError, MaterialError):
        material = case.material_class(**case.start_values())
        depth = case.outputs(case.tests[0])[-1] * 1e-3
        model.run(material, case.material.bulk_modulus(material.shear_modulus), case.tests[0].angle, [depth])
    return model


def run(model, case, key, number):
    """The Run of test `number` of a case at the parameters of a key."""
    started, test = time.perf_counter(), case.tests[number]
    force, cause, facts = None, None, {}
    try:
        at = setting(case, dict(key))
        model = model if at.same_model else ready_model(at.case)
        material, depths = at.case.material_class(**at.parameters), at.outputs(test)
        kappa = at.case.material.bulk_modulus(material.shear_modulus)
        pressed = depths > 0  # before contact there is no force
        result = model.run(material, kappa, test.angle, depths[pressed], test.name)
        force, facts = np.zeros(depths.size), result.facts
        force[pressed] = result.force
        if not np.isfinite(force).all():
            force, cause = None, f"test {test.name!r}: its force is not a finite number"
    except (ConvergenceError, MaterialError) as error:
        cause = " ".join(str(error).split())
    return Run(force, cause, time.perf_counter() - started, facts)


def _key(point):
    return tuple(point.items())


# In the worker's process


_here: dict = {}


def _work(unit):
    _here["model"] = _here.get("model") or ready_model(_here["case"])
    return run(_here["model"], _here["case"], *unit)


def _begin(case):
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # Ctrl-C ends a worker without a traceback; the parent reports it
    threading.Thread(target=_end_with_parent, daemon=True).start()
    _here["case"] = case
    _here["limits"] = threadpool_limits(1)


def _end_with_parent():
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
    os._exit(1)


# In the parent's


def _executor(case, workers):
    return ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), initializer=_begin, initargs=(case,))


@contextlib.contextmanager
def _one_thread():
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
