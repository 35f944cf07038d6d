"""Forward runs of many variants of a case: on the worker processes of a fit, and through its ledger."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from typing import Any

from indentfit.case import Case, require_known_motions
from indentfit.runs.forward import Evaluation
from indentfit.runs.ledger import Ledger
from indentfit.runs.mechanics import indentation_of
from indentfit.runs.points import case_at
from indentfit.runs.pool import RunPool
from indentfit.runs.relaxing import BULK, MATTERS, BulkShares, elastic_case, ramp_kernel, relaxed

TABLES = ("sample", "indenter", "mesh", "solver", "material")
NOT_OF_A_POINT = ("model", "energy", "parameters", "relaxation")  # of the material: what its class is, and a table

Point = dict[str, Any]


def _silent(share: float, note: str = "") -> None:
    """No progress is shown."""


@dataclass(frozen=True)
class Execution:
    """The execution of a study's runs: workers, ledger, stop and progress.

    Parameters
    ----------
    workers : int or None
        Number of processes; by default that of the case, or of the cores.
    ledger : Ledger or None
        The ledger of the runs, which was opened for all cases of the study.
    cluster : str or None
        "local", or the address of a Dask scheduler.
    stop : function or None
        Called before a run is begun; returns the number of the signal that asks to stop, else 0.
    progress : function
        Called with (share done, note).
    """

    workers: int | None = None
    ledger: Ledger | None = None
    cluster: str | None = None
    stop: Callable[[], int] | None = None
    progress: Callable[[float, str], object] = _silent

    def ledger_of(self, case: Case) -> Ledger | None:
        """The ledger's view of one of its cases."""
        return None if self.ledger is None else self.ledger.of(case)

    def part(self, begin: float, end: float) -> "Execution":
        """This execution for a part of a study, whose progress goes from one share of the whole to another."""

        def report(share: float, note: str = "") -> None:
            self.progress(begin + (end - begin) * share, note)

        return replace(self, progress=report)


def evaluate_cases(cases: Sequence[Case], execution: Execution) -> list[Evaluation]:
    """Evaluations of the tests of each case, at its fixed parameters and the start values of its free ones.

    Failures of the mechanics are recorded in the evaluations, never raised. Where a material relaxes, the runs are elastic, and
    forces are those of the ramp: another rate needs no run.

    Raises
    ------
    Stopped, WorkerError, LedgerError
    CaseError
        A test has a held force, and no curve.
    """
    for case in cases:
        require_known_motions(case, "a sweep")
    by_bulk = {n for n, case in enumerate(cases) if _compressible(case)}
    elastic = evaluate_elastic(cases, execution, by_bulk)
    return [_in_ramp(case, evaluation) for case, evaluation in zip(cases, elastic, strict=True)]


def evaluate_elastic(cases: Sequence[Case], execution: Execution, by_bulk: Collection[int] = ()) -> list[Evaluation]:
    """Evaluations as of `evaluate_cases`, without relaxation: where a material relaxes, forces are elastic, on a grid of depths.

    by_bulk: numbers of cases whose runs also bring the derivative by the bulk modulus.

    Raises
    ------
    Stopped, WorkerError, LedgerError
    """
    groups = _groups([elastic_case(case.of_forces) for case in cases])
    evaluations: dict[int, Evaluation] = {}
    total, before = sum(len(points) * len(first.tests) for first, points in groups), 0
    for first, points in groups:
        report = _counting(execution, before, total)
        with RunPool(first, execution.workers, execution.ledger_of(first), execution.cluster, execution.stop) as pool:
            asked = [BULK] if not points.keys().isdisjoint(by_bulk) else []
            evaluations |= zip(points, pool.evaluate(list(points.values()), report, asked), strict=True)
        before += len(points) * len(first.tests)
    return [evaluations[n] for n in range(len(cases))]


def _in_ramp(case: Case, evaluation: Evaluation) -> Evaluation:
    """The evaluation with the forces of the ramp, where the material relaxes."""
    kernel = ramp_kernel(case)
    if kernel is None:
        return evaluation
    ratio = case.material.bulk_over_shear
    if _compressible(case) and ratio is not None:
        kernel = replace(kernel, bulk=BulkShares.of(evaluation, ratio))
    return relaxed(kernel, evaluation.parameters, replace(evaluation, sensitivities=None), ())


def _compressible(case: Case) -> bool:
    """Whether a material relaxes whose bulk modulus, which does not, has a share in the force."""
    ratio = case.material.bulk_over_shear
    return case.material.relaxation is not None and ratio is not None and ratio < MATTERS


def _counting(execution: Execution, before: int, total: int) -> Callable[[int, int], None]:
    def report(done: int, _: int) -> None:
        execution.progress((before + done) / total, f"{before + done} of {total} runs")

    return report


def _groups(cases: Sequence[Case]) -> list[tuple[Case, dict[int, Point]]]:
    """(Case, {number: point}) for each pool that is needed: the numbers of the cases that are this one at a point."""
    groups: list[tuple[Case, dict[int, Point]]] = []
    for n, case in enumerate(cases):
        for first, points in groups:
            if point := _point(first, case):
                points[n] = point
                break
        else:
            groups.append((case, {n: dict(case.start_values())}))
    return groups


def _point(first: Case, case: Case) -> Point | None:
    """The point (name -> value) at which the first case has the forces of another case; None where such a point does not exist,
    because tests, material or the sample's shape differ."""
    changed = {}
    for table in TABLES:
        old, new = getattr(first, table), getattr(case, table)
        for name in type(new).model_fields:
            if name not in NOT_OF_A_POINT and getattr(new, name) != getattr(old, name):
                changed[f"{table}.{name}"] = getattr(new, name)
    point = case.start_values() | dict(sorted(changed.items(), key=lambda pair: pair[1] is not None))  # a mesh has one key
    there = case_at(first, point)
    return point if _decided(there) == _decided(case) else None


def _decided(case: Case) -> tuple[list[dict[str, Any]], list[tuple[float, float, list[float], float | None, list[Any]]]]:
    """All that decides the forces of a case, without its parameters."""
    tables = [getattr(case, table).model_dump(exclude={"parameters"}) for table in TABLES]
    tests = [indentation_of(case, test) for test in case.tests]
    own = [[table and table.model_dump() for table in (test.sample, test.indenter)] for test in tests]
    return tables, [
        (test.angle, test.dip, test.depths.tolist(), test.rate, [*keys, test.specimen])
        for test, keys in zip(tests, own, strict=True)
    ]
