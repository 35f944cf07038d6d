"""Parallel runs of the forward model, each computed only once: a run is taken from the ledger, or computed by a worker.

The unit of work is one test at one set of parameters, so that two cores stay busy whatever the size of a population. No number
depends on the process of a run, the moment of its end, or whether it comes from the ledger. A script that
uses this module needs the usual `if __name__ == "__main__":`.
"""

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from typing import Any, Protocol, Self

import numpy as np

from indentfit.arrays import Array
from indentfit.case import Case
from indentfit.errors import Stopped
from indentfit.machine import cores
from indentfit.material import Material, laws_of
from indentfit.runs.bench import Bench
from indentfit.runs.cluster import Cluster
from indentfit.runs.forward import Evaluation, Report
from indentfit.runs.ledger import Ledger
from indentfit.runs.mechanics import Mechanics, mechanics_of
from indentfit.runs.points import UNITS
from indentfit.runs.processes import Processes
from indentfit.runs.run import Point, Run, RunRequest

RECENT = 500  # latest runs, from which the durations of the next runs are estimated
DIFFERENTIABLE = frozenset(UNITS) - {"thickness"}  # inputs by which the mechanics can differentiate, beside the law's parameters


class Pool(Protocol):
    """Workers for the runs of one case: this process, processes of this machine, or a cluster."""

    @property
    def number(self) -> int:
        """Number of simultaneous runs."""
        ...

    def solve(self, requests: Iterable[RunRequest], stopping: Callable[[], object]) -> Iterator[tuple[RunRequest, Run]]:
        """Yield (request, Run) in the order in which the runs end; no run begins once stopping() is true.

        Every request that was begun ends with a Run, whatever happens to its worker. Raises WorkerError where no worker exists.
        """
        ...

    def close(self, now: bool = False) -> None:
        """End the workers; `now` does not wait for the runs they are at."""
        ...


class InProcess:
    """This process as the only worker: a Pool."""

    number = 1

    def __init__(self, mechanics: Mechanics, limit: float) -> None:
        self.bench = Bench(mechanics, limit)

    def solve(self, requests: Iterable[RunRequest], stopping: Callable[[], object]) -> Iterator[tuple[RunRequest, Run]]:
        for request in requests:
            if stopping():
                return
            yield request, self.bench.run_at_last(request)

    def close(self, now: bool = False) -> None:
        """Nothing needs to be ended."""


class RunPool:
    """A ForwardModel that evaluates points of a case by runs, each computed once; to be used in a `with` block.

    Parameters
    ----------
    case : Case
    workers : int, optional
        Number of processes; by default that of the case, or of the cores. A single worker is this process itself, unless the law
        is foreign code.
    ledger : Ledger, optional
        The ledger in which runs are looked up and kept.
    cluster : str, optional
        "local", or the address of a Dask scheduler.
    stop : function, optional
        Called before a run is begun; returns the number of the signal that asks to stop, else 0.

    Attributes
    ----------
    runs, reused : int
        Number of runs of the forward model that were needed, and number of these that were in the ledger.
    failures : list of Evaluation
        Every failed evaluation.
    """

    def __init__(
        self,
        case: Case,
        workers: int | None = None,
        ledger: Ledger | None = None,
        cluster: str | None = None,
        stop: Callable[[], int] | None = None,
    ) -> None:
        self.case, self.ledger, self.cluster, self.stop = case, ledger, cluster, stop or _never
        self._asked = workers or case.fit.workers or cores()
        self.runs, self.reused, self.seconds = 0, 0, 0.0
        self.failures: list[Evaluation] = []
        self._known: dict[tuple, list[Run]] = {}
        self._workers: Pool | None = None
        self._here: InProcess | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self.close(now=kind is not None)

    def close(self, now: bool = False) -> None:
        """End the workers; `now` does not wait for the runs they are at."""
        self._asked = self.workers
        workers, self._workers = self._workers, None
        if workers is not None:
            workers.close(now)

    @property
    def workers(self) -> int:
        """The number of simultaneous runs."""
        return self._workers.number if self._workers else self._asked

    @property
    def evaluations(self) -> int:
        """The number of different points that were evaluated."""
        return len({point for point, _ in self._known})

    def differentiable(self) -> frozenset[str]:
        """Names whose sensitivities runs can give: parameters of the law, and some inputs."""
        return DIFFERENTIABLE | set(self.case.law.parameters)

    def evaluate(
        self, points: Sequence[Point], report: Report | None = None, sensitivities: Collection[str] = ()
    ) -> list[Evaluation]:
        """Evaluations of points, in their order.

        Parameters
        ----------
        points : sequence of dict, name -> value
        report : called with (runs done, runs asked for)
        sensitivities : names
            Quantities by which the forces are differentiated.

        Returns
        -------
        list of Evaluation
            Failures of the mechanics are recorded in the evaluations, never raised.

        Raises
        ------
        Stopped, WorkerError, LedgerError
            All runs that had ended are in the ledger.
        """
        names = tuple(sorted(sensitivities))
        wanted = [RunRequest(_key(point), test, names) for point in points for test in range(len(self.case.tests))]
        missing = [request for request in dict.fromkeys(wanted) if self._serving(request) is None]
        if missing:
            self._run(missing, report)
        evaluations = [self._evaluation(point, names) for point in points]
        for evaluation in evaluations:
            if evaluation.cause and evaluation.parameters not in [known.parameters for known in self.failures]:
                self.failures.append(evaluation)
        return evaluations

    def _run(self, requests: list[RunRequest], report: Report | None) -> None:
        """Run requests, or take them from the ledger."""
        total, left = len(requests), dict.fromkeys(requests)
        for request in requests:
            if run := self._kept(request):
                del left[request]
                self.reused += 1
                self._learn(request, run)
        if left and not self.stop():
            for request, run in self._pool_for(len(left)).solve(self._longest_first(left), self.stop):
                if self.ledger is not None:
                    self.ledger.add(request.parameters, self.case.tests[request.test], run)
                del left[request]
                self._learn(request, run)
                if report:
                    report(total - len(left), total)
        if left:
            raise Stopped("stopped before its end", self.stop())

    def _kept(self, request: RunRequest) -> Run | None:
        if self.ledger is None:
            return None
        return self.ledger.find(request.parameters, self.case.tests[request.test], request.sensitivities)

    def _pool_for(self, requests: int) -> Pool:
        """The workers, or this process for a single run in the meridian plane: such a run costs less than the start of a worker."""
        if self._workers is None and requests == 1 and not self.cluster and not is_foreign(self.case.law):
            mechanics = mechanics_of(self.case)
            if not self.case.indentations or mechanics.setup.in_plane:
                self._here = self._here or InProcess(mechanics, self.case.fit.time_limit)
                return self._here
        self._workers = self._workers or self._hired()
        return self._workers

    def _hired(self) -> Pool:
        mechanics, limit = mechanics_of(self.case), self.case.fit.time_limit
        if self.cluster:
            return Cluster(mechanics, self.cluster, self._asked, limit)
        if not self.case.indentations and not is_foreign(self.case.law):
            return InProcess(mechanics, limit)  # homogeneous states cost less than a worker
        if self._asked > 1 or is_foreign(self.case.law):
            return Processes(mechanics, self._asked, limit)
        return InProcess(mechanics, limit)

    def _serving(self, request: RunRequest) -> Run | None:
        """The earliest known run that holds all that is requested."""
        return next((run for run in self._known.get(request.subject, ()) if run.serves(request.sensitivities)), None)

    def _learn(self, request: RunRequest, run: Run) -> None:
        self._known.setdefault(request.subject, []).append(run)
        self.runs += 1
        self.seconds += run.seconds

    def _longest_first(self, requests: Iterable[RunRequest]) -> list[RunRequest]:
        """Requests in falling order of their expected durations, so that no core idles at the end.

        The expected duration is that of the nearest known run of the test. Where none is known, deeper tests come first, and tests
        across the fibres, which slip more, come before tests along them.
        """
        ran = [(test, dict(point), runs[0].seconds) for (point, test), runs in list(self._known.items())[-RECENT:]]

        def expected(request: RunRequest) -> tuple[float, float, float]:
            point, test = request.parameters, self.case.tests[request.test]
            nearest = min(((_apart(point, other), took) for of, other, took in ran if of == request.test), default=(0.0, np.inf))
            return nearest[1], float(self.case.outputs(test)[-1]), test.direction

        return sorted(requests, key=expected, reverse=True)

    def _evaluation(self, point: Point, names: tuple[str, ...]) -> Evaluation:
        tests = self.case.tests
        known = [self._serving(RunRequest(_key(point), test, names)) for test in range(len(tests))]
        runs = [run for run in known if run is not None]  # all of them, by now
        causes = [f"test {test.name!r}: {run.cause}" for test, run in zip(tests, runs, strict=True) if run.cause]
        seconds, facts = sum(run.seconds for run in runs), tuple(run.facts for run in runs)
        if causes:
            return Evaluation(dict(point), None, "; ".join(causes), seconds, facts, lost=any(run.lost for run in runs))
        derivatives = tuple(_finite(run, names) for run in runs) if names else None
        forces = tuple(run.force for run in runs if run.force is not None)
        return Evaluation(dict(point), forces, None, seconds, facts, derivatives)


def is_foreign(law: type[Material]) -> bool:
    """Whether a law is third-party code, which may never return, so that its runs need a process that can be ended."""
    laws = laws_of(law).values()
    return any(base.__module__.partition(".")[0] not in ("indentfit", "builtins") for own in laws for base in own.__mro__)


def _never() -> int:
    return 0


def _finite(run: Run, names: tuple[str, ...]) -> dict[str, Array]:
    given = run.sensitivities or {}
    return {name: given[name] for name in names if np.isfinite(given[name]).all()}


def _apart(point: Point, other: Point) -> float:
    """Distance of two points: the sum of relative differences; a value that only one point has, or a text, counts 1."""
    pairs = [(point.get(name), other.get(name)) for name in point.keys() | other.keys()]
    return sum(_relative(a, b) for a, b in pairs if a != b)


def _relative(a: Any, b: Any) -> float:
    return 1.0 if a is None or b is None or isinstance(a, str) else abs(a - b) / (abs(a) + abs(b))


def _key(point: Point) -> tuple[tuple[str, Any], ...]:
    return tuple(point.items())
