"""Forward runs of many variants of a case: on the worker processes of a fit, and through its ledger."""

from indentfit.runs.points import case_at
from indentfit.runs.pool import RunPool

TABLES = ("sample", "indenter", "mesh", "solver", "material")
NOT_OF_A_POINT = ("model", "energy", "parameters")  # of the material: what its class is


def evaluate(cases, ledger=None, workers=None, cluster=None, stop=None, progress=None):
    """Evaluations of the tests of each Case, at its fixed parameters and the start values of its free ones.

    ledger: a Ledger with the cases among its own, or None; workers, cluster, stop: as those of `RunPool`; progress: called with
    (runs done, runs). Failures of the mechanics are in the evaluations, never raised. Raises what `RunPool.evaluate` raises.
    """
    groups, found = _groups(cases), {}
    total, before = sum(len(points) * len(first.tests) for first, points in groups), 0
    for first, points in groups:
        report = progress and (lambda done, _, before=before: progress(before + done, total))
        with RunPool(first, workers, None if ledger is None else ledger.of(first), cluster, stop) as pool:
            found |= zip(points, pool.evaluate(list(points.values()), report), strict=True)
        before += len(points) * len(first.tests)
    return [found[n] for n in range(len(cases))]


def _groups(cases):
    """(Case, {number: point}) for each pool that is needed: the numbers of the cases that are this one at a point."""
    groups: list[tuple] = []
    for n, case in enumerate(cases):
        for first, points in groups:
            if point := _point(first, case):
                points[n] = point
                break
        else:
            groups.append((case, {n: case.start_values()}))
    return groups


def _point(first, case):
    """The point (name -> value) at which one case is another, as far as forces go; None where there is none: other tests,
    another material, or another shape of the sample are no keys of a point."""
    changed = {}
    for table in TABLES:
        old, new = getattr(first, table), getattr(case, table)
        for name in type(new).model_fields:
            if name not in NOT_OF_A_POINT and getattr(new, name) != getattr(old, name):
                changed[f"{table}.{name}"] = getattr(new, name)
    point = case.start_values() | dict(sorted(changed.items(), key=lambda pair: pair[1] is not None))  # a mesh has one key
    there = case_at(first, point)
    return point if _decided(there) == _decided(case) else None


def _decided(case):
    """What decides the forces of a case, but its parameters."""
    tables = [getattr(case, table).model_dump(exclude={"parameters"}) for table in TABLES]
    return tables, [(test.angle, case.outputs(test).tolist()) for test in case.tests]
