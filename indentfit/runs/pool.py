"""Many runs of the forward model at once, each only once: from the ledger, or else on the workers.

The unit of work is one test at one set of parameters, so that two cores stay busy whatever the size of a population.
Which process a run falls to, when it ends, or whether it comes from the ledger, changes no number. Scripts that call
this need the usual `if __name__ == "__main__":`, since workers are spawned.
"""

import os
from dataclasses import dataclass

import numpy as np

from indentfit.errors import Stopped
from indentfit.runs.bench import Bench
from indentfit.runs.cluster import Cluster
from indentfit.runs.processes import Processes
from indentfit.runs.run import Run

RECENT = 500  # runs that are asked how long the next ones may take


@dataclass(frozen=True)
class Evaluation:
    """All tests at one set of parameters; `forces` is None and `cause` says why where one of them failed.

    sensitivities: for each test, name -> derivatives of its forces, mN per unit of the parameter, shape (n,), of those
    that were asked for and that the forward model could give; None where none were asked for, or it has none at all.
    lost: the cause is the machine's (memory, time, a killed process) and not the mechanics'.
    """

    parameters: dict[str, float]
    forces: tuple[np.ndarray, ...] | None
    cause: str | None
    seconds: float
    facts: tuple[dict, ...]
    sensitivities: tuple[dict[str, np.ndarray], ...] | None = None
    lost: bool = False


class Pool:
    """Evaluates sets of parameters of a case, each only once; to be used in a `with` block.

    workers: processes, by default as many as the case says, or cores; one is this process itself. ledger: where runs
    are looked up and kept. cluster: None, "local", or the address of a Dask scheduler. stop: called before a run is
    begun; the number of the signal that asks to stop, else 0.
    `runs` counts the runs of the forward model that were needed, `reused` those of them that were in the ledger,
    `failures` holds every failed evaluation.
    """

    def __init__(self, case, workers=None, ledger=None, cluster=None, stop=None):
        self.case, self.ledger, self.cluster, self.stop = case, ledger, cluster, stop or (lambda: 0)
        self._asked = workers or case.fit.workers or cores()
        self.runs, self.reused, self.seconds, self.failures = 0, 0, 0.0, []
        self._known: dict[tuple, list[Run]] = {}
        self._workers = None

    def __enter__(self):
        return self

    def __exit__(self, kind, *_):
        self.close(now=kind is not None)

    def close(self, now=False):
        """End the workers; `now` does not wait for what they are doing."""
        self._asked = self.workers
        workers, self._workers = self._workers, None
        if workers is not None:
            workers.close(now)

    @property
    def workers(self):
        """The number of runs that are done at once."""
        return self._workers.number if self._workers else self._asked

    @property
    def evaluations(self):
        """The number of different sets of parameters that were run."""
        return len({key for key, _ in self._known})

    def evaluate(self, points, report=None, sensitivities=()):
        """Evaluations of a list of parameters (name -> value), in its order.

        report: called with (runs done, runs asked for). sensitivities: names of the parameters by which derivatives of
        the forces are wanted too. Failures of the mechanics are recorded, never raised. Raises Stopped, WorkerError
        and LedgerError; what was run until then is in the ledger.
        """
        names = tuple(sorted(sensitivities))
        wanted = [(_key(point), test) for point in points for test in range(len(self.case.tests))]
        missing = [unit for unit in dict.fromkeys(wanted) if self._find(unit, names) is None]
        if missing:
            self._run(missing, names, report)
        evaluations = [self._evaluation(point, names) for point in points]
        for evaluation in evaluations:
            if evaluation.cause and evaluation.parameters not in [known.parameters for known in self.failures]:
                self.failures.append(evaluation)
        return evaluations

    def _run(self, units, names, report):
        """Run units, or take them from the ledger."""
        total, left = len(units), dict.fromkeys(units)
        for unit in units:
            if run := self.ledger and self.ledger.find(dict(unit[0]), self.case.tests[unit[1]], names):
                del left[unit]
                self.reused += 1
                self._learn(unit, run)
        if left and not self.stop():
            self._workers = self._workers or self._hired()
            for unit, run in self._workers.solve(self._longest_first(left), names, self.stop):
                if self.ledger is not None:
                    self.ledger.add(dict(unit[0]), self.case.tests[unit[1]], run)
                del left[unit]
                self._learn(unit, run)
                if report:
                    report(total - len(left), total)
        if left:
            raise Stopped("stopped before its end", self.stop())

    def _hired(self):
        limit = self.case.fit.time_limit
        if self.cluster:
            return Cluster(self.case, self.cluster, self._asked, limit)
        return Processes(self.case, self._asked, limit) if self._asked > 1 else _Here(self.case, limit)

    def _find(self, unit, names):
        return next((run for run in self._known.get(unit, ()) if run.serves(names)), None)

    def _learn(self, unit, run):
        self._known.setdefault(unit, []).append(run)
        self.runs += 1
        self.seconds += run.seconds

    def _longest_first(self, units):
        """Units in the order of what is to be expected of them, the longest first, so that no core idles at the end: what the
        nearest run of the test took; before there is one, how deep it goes, and across the fibres before along them (more slip)."""
        ran = [(test, dict(key), runs[0].seconds) for (key, test), runs in list(self._known.items())[-RECENT:]]

        def expected(unit):
            point, test = dict(unit[0]), unit[1]
            nearest = min(((_apart(point, other), took) for of, other, took in ran if of == test), default=(0.0, np.inf))
            return nearest[1], float(self.case.outputs(self.case.tests[test])[-1]), self.case.tests[test].angle

        return sorted(units, key=expected, reverse=True)

    def _evaluation(self, point, names):
        runs = [self._find((_key(point), test), names) for test in range(len(self.case.tests))]
        named = zip(self.case.tests, runs, strict=True)
        causes = [f"test {test.name!r}: {run.cause}" for test, run in named if run.cause]
        seconds, facts = sum(run.seconds for run in runs), tuple(run.facts for run in runs)
        if causes:
            return Evaluation(dict(point), None, "; ".join(causes), seconds, facts, lost=any(run.lost for run in runs))
        derivatives = tuple(_finite(run.sensitivities, names) for run in runs) if names else None
        return Evaluation(dict(point), tuple(run.force for run in runs), None, seconds, facts, derivatives)


class _Here:
    """This process as the only worker."""

    number = 1

    def __init__(self, case, limit):
        self.bench = Bench(case, limit)

    def solve(self, units, names, stopping):
        for unit in units:
            if stopping():
                return
            yield unit, self.bench.run_at_last(unit, names)

    def close(self, now=False):
        pass


def cores():
    """The number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _finite(sensitivities, names):
    return {name: sensitivities[name] for name in names if np.isfinite(sensitivities[name]).all()}


def _apart(one, other):
    """How different two points are: the sum of relative differences, 1 for what only one of them has or is in words."""
    pairs = [(one.get(name), other.get(name)) for name in one.keys() | other.keys()]
    return sum(_relative(a, b) for a, b in pairs if a != b)


def _relative(a, b):
    return 1.0 if a is None or b is None or isinstance(a, str) else abs(a - b) / (abs(a) + abs(b))


def _key(point):
    return tuple(point.items())
