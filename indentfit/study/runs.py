"""Forward runs of many variants of a case on the worker processes, each kept as soon as it is finished."""

import importlib.metadata
import math
from dataclasses import dataclass

import numpy as np

from indentfit.case import Case, Fit
from indentfit.inverse.workers import Pool, cores


@dataclass(frozen=True)
class Outcome:
    """All tests of one variant: forces, mN, one array (n,) for each test, or None and the cause why there are none."""

    forces: tuple[np.ndarray, ...] | None
    cause: str | None
    seconds: float


def evaluate(cases, kept, workers=None, progress=None):
    """Outcomes of the tests of each Case, at its fixed parameters and the start values of its free ones.

    kept: mapping of what is finished already, added to after each variant that was not lost; workers: processes, by default
    those of the case. progress: called with (variants done, variants). Failures of the mechanics are outcomes, never raised.
    """
    bare = [forward(case) for case in cases]
    keys = [key(case) for case in bare]
    missing = {k: case for k, case in zip(keys, bare, strict=True) if k not in kept}
    done, total, lost = len(set(keys)) - len(missing), len(set(keys)), {}
    for group in _of_equal_model(missing):
        first = next(case for case in bare if _model_key(case) == _model_key(group[0][1]))
        with Pool(first, workers or cases[0].fit.workers or cores()) as pool:
            for chunk in _chunks(group, math.ceil(pool.workers / len(first.tests))):
                found = pool.evaluate([case.start_values() for _, case in chunk])
                for (k, _), evaluation in zip(chunk, found, strict=True):
                    (lost if evaluation.lost else kept)[k] = _record(evaluation)
                done += len(chunk)
                if progress:
                    progress(done, total)
    return [_outcome(lost[k] if k in lost else kept[k]) for k in keys]


def forward(case: Case) -> Case:
    """The case with nothing that its forces do not depend on: parameters are numbers, weights 1, the search the default."""
    material = case.material.model_copy(update={"parameters": case.start_values()})
    tests = tuple(test.model_copy(update={"weight": 1.0}) for test in case.tests)
    return case.model_copy(update={"material": material, "tests": tests, "fit": Fit(time_limit=case.fit.time_limit)})


def key(case, what="run"):
    """What the forces of a `forward` case are kept under; an earlier version's are not taken."""
    return f"{what} {importlib.metadata.version('indentfit')} {case.hash}"


def _of_equal_model(missing):
    """Lists of (key, case) that differ in material parameters only, so that one pool of ready models runs them."""
    groups: dict[str, list] = {}
    for k, case in missing.items():
        groups.setdefault(_model_key(case), []).append((k, case))
    return list(groups.values())


def _model_key(case):
    return case.model_copy(update={"material": case.material.model_copy(update={"parameters": {}})}).hash


def _chunks(items, size):
    """Few enough at a time that little is lost when the study is killed, and enough that no worker waits."""
    return [items[n : n + size] for n in range(0, len(items), size)]


def _record(evaluation):
    forces = evaluation.forces
    return {
        "forces_mN": None if forces is None else [force.tolist() for force in forces],
        "cause": evaluation.cause,
        "seconds": evaluation.seconds,
    }


def _outcome(record):
    forces = record["forces_mN"]
    return Outcome(None if forces is None else tuple(map(np.array, forces)), record["cause"], record["seconds"])
