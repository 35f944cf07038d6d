"""One fit for each sample of a set: the same case with the sample's own curves and size; then the spread of the parameters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from indentfit.case import Case, require_fittable
from indentfit.errors import CaseError, ConvergenceError
from indentfit.experiment.measured import read_case
from indentfit.inference.fit import FitResult, fit
from indentfit.shapes import keys_of


@dataclass(frozen=True, eq=False)
class SampleFit:
    """The fit of one sample: its case and result, or the problem that prevented it, one line."""

    sample: str
    case: Case | None = None
    result: FitResult | None = None
    problem: str | None = None


def sample_cases(path, samples, overrides=()):
    """(sample's name, Case) of each Specimen: the case at `path` with its curves, thickness and diameter. Raises CaseError.

    A test of the case whose direction a sample lacks is an error: it would be fitted to another sample's curve.
    """
    pooled = read_case(path, overrides)
    tests = {test.angle: test.name for test in pooled.tests}
    if len(tests) < len(pooled.tests):
        raise CaseError(f"{path}: two tests have the same angle; --per-sample needs one test for each direction")
    cases = []
    for sample in samples:
        if missing := set(tests) - set(sample.curves):
            raise CaseError(f"{path}: sample {sample.name} has no curve of direction {min(missing)}; remove it from the table")
        keys = [f"test.{name}.curve={_quoted(sample.curves[angle])}" for angle, name in tests.items()]
        keys += [f"sample.thickness={sample.thickness!r}"] if sample.thickness else []
        keys += (
            [f"sample.diameter={sample.diameter!r}"]
            if sample.diameter and "diameter" in keys_of(type(pooled.sample.geometry))
            else []
        )
        case = read_case(path, (*overrides, *keys))
        require_fittable(case)
        cases.append((sample.name, case))
    return cases


def fit_sample(name, case, progress=None, ledger=None, cluster=None, stop=None):
    """The `SampleFit` of one of `sample_cases`; what the mechanics refuse is its problem. Arguments as of `fit`."""
    try:
        return SampleFit(name, case, fit(case, progress, ledger, cluster, stop))
    except ConvergenceError as error:
        return SampleFit(name, case, None, str(error))


def parameter_spread(fits):
    """name -> n, mean, sd, min, max of each free parameter over the fits that converged."""
    good = [one.result for one in fits if one.result and one.result.success]
    if not good:
        return {}
    found = {}
    for name in good[0].free:
        values = np.array([result.parameters[name].value for result in good])
        sd = float(values.std(ddof=1)) if values.size > 1 else None
        found[name] = {
            "unit": good[0].parameters[name].unit,
            "n": values.size,
            "mean": float(values.mean()),
            "sd": sd,
            "min": float(values.min()),
            "max": float(values.max()),
        }
    return found


def _quoted(text):
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'
