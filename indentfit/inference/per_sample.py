"""One fit for each sample of a set: the same case with the sample's own curves and size; then the spread of the parameters."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from indentfit.case import Case, require_fittable
from indentfit.errors import CaseError, ConvergenceError
from indentfit.experiment.measured import read_case
from indentfit.experiment.specimens import Specimen
from indentfit.inference.fit import fit
from indentfit.inference.result import FitResult
from indentfit.runs.ledger import Ledger
from indentfit.shapes import keys_of

Report = Callable[..., object]  # called with (share done, note)


@dataclass(frozen=True, eq=False)
class SampleFit:
    """The fit of one sample: its case and result, or the problem that prevented it, one line."""

    sample: str
    case: Case | None = None
    result: FitResult | None = None
    problem: str | None = None


@dataclass(frozen=True)
class ParameterSpread:
    """One free parameter over the samples whose fits converged: number of samples, mean, standard deviation (None for one sample),
    least and largest value, in the parameter's unit ("1" for none)."""

    unit: str
    n: int
    mean: float
    sd: float | None
    min: float
    max: float

    def as_json(self) -> dict[str, Any]:
        return asdict(self)


def sample_cases(path: str | Path, specimens: Sequence[Specimen], overrides: Sequence[str] = ()) -> list[tuple[str, Case]]:
    """The case of each specimen: that of a file with the specimen's own curves, thickness and diameter.

    Parameters
    ----------
    path : the case file
    specimens : rows of replicates.csv
    overrides : "KEY=VALUE"

    Returns
    -------
    list of (name of the specimen, Case)

    Raises
    ------
    CaseError
        A direction of the case is missing for a specimen (it would be fitted to another specimen's curve), or two tests have one
        direction.
    """
    pooled = read_case(path, overrides)
    tests = {test.angle: test.name for test in pooled.tests}
    if len(tests) < len(pooled.tests):
        raise CaseError(f"{path}: two tests have the same angle; --per-sample needs one test for each direction")
    cases = []
    for specimen in specimens:
        if missing := set(tests) - set(specimen.curves):
            raise CaseError(f"{path}: sample {specimen.name} has no curve of direction {min(missing)}; remove it from the table")
        case = read_case(path, (*overrides, *_own_keys(specimen, pooled, tests)))
        require_fittable(case)
        cases.append((specimen.name, case))
    return cases


def _own_keys(specimen: Specimen, pooled: Case, tests: Mapping[Any, str]) -> list[str]:
    keys = [f"test.{name}.curve={_quoted(specimen.curves[angle])}" for angle, name in tests.items()]
    keys += [f"sample.thickness={specimen.thickness!r}"] if specimen.thickness else []
    if specimen.diameter and "diameter" in keys_of(type(pooled.sample.geometry)):
        keys.append(f"sample.diameter={specimen.diameter!r}")
    return keys


def fit_sample(
    name: str, case: Case, progress: Report | None = None, ledger: Ledger | None = None, cluster: str | None = None,
    stop: Callable[[], int] | None = None,
) -> SampleFit:  # fmt: skip
    """The SampleFit of one of `sample_cases`; what the mechanics refuse is its problem. The other arguments are those of `fit`."""
    try:
        return SampleFit(name, case, fit(case, progress, ledger, cluster, stop))
    except ConvergenceError as error:
        return SampleFit(name, case, None, str(error))


def parameter_spread(fits: Sequence[SampleFit]) -> dict[str, ParameterSpread]:
    """name -> ParameterSpread of each free parameter over the fits that converged."""
    good = [fitted.result for fitted in fits if fitted.result and fitted.result.success]
    spread = {}
    for name in good[0].free if good else ():
        values = np.array([result.parameters[name].value for result in good])
        sd = float(values.std(ddof=1)) if values.size > 1 else None
        extremes = float(values.min()), float(values.max())
        spread[name] = ParameterSpread(good[0].parameters[name].unit, values.size, float(values.mean()), sd, *extremes)
    return spread


def _quoted(text: str) -> str:
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'
