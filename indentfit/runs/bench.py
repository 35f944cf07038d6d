"""One run of the forward model at a time: one test at a set of parameters, within its limit of time, with its failures recorded.

A run does not depend on the runs before it, nor on the process that computes it, so results are the same, bit by bit, with any
number of workers. The imports of this module decide the key of a run (runs/closure.py).
"""

import contextlib
import ctypes
import math
import time
from collections.abc import Iterator

import numpy as np

from indentfit.arrays import Array, Bools
from indentfit.compiled import libraries
from indentfit.errors import ConvergenceError, InputError, MaterialError, OutOfTime
from indentfit.fem.deadline import Deadline
from indentfit.fem.linear.choice import choice
from indentfit.fem.linear.pardiso import THREADS_PAY
from indentfit.fem.result import TestResult
from indentfit.fem.same_mesh import served_by
from indentfit.fem.setup import Press, Setup
from indentfit.fem.simulate import Model
from indentfit.material import blamed, typed
from indentfit.runs.mechanics import Mechanics
from indentfit.runs.points import split_point
from indentfit.runs.run import Run, RunRequest, out_of_time
from indentfit.runs.specimen import SpecimenModel

FIRST, FIRST_BULK = "mu / 2 * (I1 - 3)", 1e3  # energy and bulk modulus, kPa, of the solution that comes before all runs
OTHERS = 3  # models that are kept beside those of the tests, if they are small
MEMORY = "out of memory, twice"
M_TRIM_THRESHOLD, M_MMAP_THRESHOLD = -1, -3  # malloc.h of glibc


class Bench:
    """Ready models, on which requests are run one after the other; a model is made anew after a run that was broken off.

    The last models are kept: one for each sample and indenter of the tests and, where they are small, some more, so that runs on
    another base find theirs again. Runs that differ in friction share theirs.

    Parameters
    ----------
    mechanics : Mechanics
    limit : float, s
        Processor time that a run may take. The solver's loops check it; the parent process ends code that never returns to these
        loops (runs/watch.py).
    """

    def __init__(self, mechanics: Mechanics, limit: float = math.inf) -> None:
        self.mechanics, self.limit = mechanics, limit
        self._models: list[Model] = []  # the last one was used last
        self._own = len({mechanics.of(test).tests[0].name for test in range(len(mechanics.tests))})
        with contextlib.suppress(InputError, OSError):  # a run meets it again
            choice(mechanics.solver.linear)  # loads the library: `run` limits the threads of those alone that are loaded
        _keep_memory()

    def ready(self, test: int = 0) -> Model | SpecimenModel:
        """The model of a test; making it takes seconds."""
        with self._used(self.mechanics.of(test)) as model:
            return model

    def run(self, request: RunRequest) -> Run:
        """The Run of a request. An exception from the code of a material becomes the run's cause.

        Parameters
        ----------
        request : RunRequest

        Returns
        -------
        Run

        Raises
        ------
        MemoryError
        """
        started = time.perf_counter()
        with libraries().limit(limits=1):
            try:
                result, pressed = self._result(request)
            except OutOfTime:
                return out_of_time(self.limit)
            except (ConvergenceError, MaterialError) as error:
                return Run(None, " ".join(str(error).split()), time.perf_counter() - started, {})
        force = _with_seen(_where(pressed, result.force), result.seen)
        seconds, facts = time.perf_counter() - started, result.facts.as_json()
        if not np.isfinite(force).all():
            return Run(None, "its force is not a finite number", seconds, facts)
        names = request.sensitivities
        return Run(force, None, seconds, facts, _of_all(names, result, pressed) if names else None)

    def run_at_last(self, request: RunRequest) -> Run:
        """The Run of a request, tried again where memory ran out."""
        for _ in range(2):
            with contextlib.suppress(MemoryError):
                return self.run(request)
        return Run(None, MEMORY, 0.0, {}, lost=True)

    def _result(self, request: RunRequest) -> tuple[TestResult, Bools]:
        """The TestResult of a request, and the displacements of the test at which the indenter presses; before contact, F = 0."""
        law, test = self.mechanics.law, self.mechanics.tests[request.test]
        at = split_point(law, request.parameters)
        mechanics = self.mechanics.changed(at.changes).of(request.test)
        with blamed(law):
            material, depths = law(**at.parameters), test.depths - (0.0 if test.specimen else at.offset)
            kappa = mechanics.material.bulk_moduli(material)
        pressed = depths > 0
        in_time = test.in_time(mechanics.material)
        fibres = mechanics.fibres(test)
        observed = None if test.observed is None else test.observed.later(at.offset)
        way = fibres.angle, fibres.dip, fibres.families
        press = Press(material, kappa, way[0], depths[pressed], "", request.sensitivities, in_time, *way[1:], observed)
        with self._used(mechanics) as model:
            return model.run(press, None, Deadline(self.limit)), pressed

    @contextlib.contextmanager
    def _used(self, mechanics: Mechanics) -> Iterator[Model | SpecimenModel]:
        """The model of mechanics, kept unless a run on it is broken off."""
        specimen = mechanics.tests[0].specimen
        if specimen is not None:
            yield SpecimenModel(specimen)
            return
        model = self._taken(mechanics.setup)
        try:
            yield model
        except (ConvergenceError, MaterialError):
            self._keep(model)  # its run has failed, but was not broken off
            raise
        self._keep(model)

    def _taken(self, setup: Setup) -> Model:
        """A model of a setup: one of those that are kept, which is not among them any more, or a new one."""
        for number in reversed(range(len(self._models))):
            model = served_by(self._models[number], setup)
            if model is not None:
                del self._models[number]
                return model
        return ready_model(setup)

    def _keep(self, model: Model) -> None:
        most = self._own + (OTHERS if model.body.n_dofs < THREADS_PAY else 0)
        self._models = [*self._models, model][-most:]


def _keep_memory() -> None:
    """Let glibc keep the memory that a run frees for the next run, because returning and requesting pages takes 4 to 6 % of a run,
    and more with every further worker. Allocators of other systems are not changed."""
    with contextlib.suppress(AttributeError, OSError, TypeError):
        libc = ctypes.CDLL(None)
        libc.mallopt(M_MMAP_THRESHOLD, 32 * 2**20)  # as large as glibc allows
        libc.mallopt(M_TRIM_THRESHOLD, 2**30)


def ready_model(setup: Setup) -> Model:
    """The Model of a setup, after one linear solution.

    The first solution fixes the order of elimination of the linear solver, which depends on the numbers in the matrix: with the
    same first solution in every process, later runs agree in every process. It is that of a gel under the untouched indenter, so
    that it depends on the mesh alone.

    Parameters
    ----------
    setup : Setup

    Returns
    -------
    Model
    """
    model, gel = Model(setup), typed(FIRST, ["mu"])(mu=1.0)
    with contextlib.suppress(ConvergenceError, MaterialError):
        model.stiffness(gel, FIRST_BULK, 0)
    return model


def _where(pressed: Bools, values: Array | float) -> Array:
    """Values at the depths pressed, and 0 at the others, (n,)."""
    everywhere = np.zeros(pressed.size)
    everywhere[pressed] = values
    return everywhere


def _of_all(names: tuple[str, ...], result: TestResult, pressed: Bools) -> dict[str, Array]:
    """Name -> derivatives of the forces; NaN, where the model has none, records that they were requested."""
    given, seen_by = result.sensitivities or {}, result.seen_by or {}
    nothing = None if result.seen is None else np.full(result.seen.size, np.nan)
    return {name: _with_seen(_where(pressed, given.get(name, np.nan)), seen_by.get(name, nothing)) for name in names}


def _with_seen(forces: Array, seen: Array | None) -> Array:
    """Forces, and behind them the displacements that were seen."""
    return forces if seen is None else np.concatenate([forces, seen])
