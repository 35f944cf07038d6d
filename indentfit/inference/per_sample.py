"""One fit for each sample of a set: the same case with the sample's own curves and size; then the spread of the parameters."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from pydantic import TypeAdapter

from indentfit.case import Case, require_fittable
from indentfit.case.laws import has_fibres
from indentfit.errors import CaseError, ConvergenceError
from indentfit.experiment.measured import read_case
from indentfit.experiment.specimens import Specimen
from indentfit.inference.fit import FitWithRuns, fit_with_runs
from indentfit.inference.result import FitResult, ParameterEstimate
from indentfit.runs.ledger import Ledger
from indentfit.shapes import keys_of


@dataclass(frozen=True, eq=False)
class SampleFit:
    """The fit of one sample: its case and result, and its runs, or one line on the problem that prevented the fit."""

    sample: str
    case: Case | None = None
    result: FitResult | None = None
    problem: str | None = None
    whole: FitWithRuns | None = None


@dataclass(frozen=True)
class ParameterSpread:
    """One free parameter over the samples whose fits converged: number of samples, mean, standard deviation (None for a single
    sample), least and largest value, in the parameter's unit ("1" for a pure number)."""

    unit: str
    n: int
    mean: float
    sd: float | None
    min: float
    max: float

    def as_json(self) -> dict[str, Any]:
        """The keys of the spread in per_sample.json."""
        return asdict(self)

    def __str__(self) -> str:
        unit = f" {self.unit}" if self.unit not in ("", "1") else ""
        sd = "" if self.sd is None else f" +- {self.sd:.3g} (SD)"
        return f"{self.mean:.4g}{sd}{unit}"


@dataclass(frozen=True)
class SampleSummary:
    """One sample of a set: the parameters of its fit, or the problem that prevented the fit.

    Parameters
    ----------
    folder : str
        Name of the sample's own result folder.
    success : bool
        Whether the fit converged.
    objective : float or None, mN
        Equation (1).
    thickness, diameter : float or None, mm
        Sizes of the sample.
    problem : str or None
    """

    sample: str
    folder: str = ""
    success: bool = False
    parameters: dict[str, ParameterEstimate] = field(default_factory=dict)
    objective: float | None = None
    thickness: float | None = None
    diameter: float | None = None
    problem: str | None = None

    @property
    def free(self) -> tuple[str, ...]:
        """Names of the parameters that were fitted."""
        return tuple(name for name, parameter in self.parameters.items() if not parameter.fixed)

    @classmethod
    def of(cls, fitted: SampleFit, folder: str) -> "SampleSummary":
        """The summary of a SampleFit that is written into a folder of that name."""
        if fitted.result is None:
            return cls(fitted.sample, problem=fitted.problem)
        result, sample = fitted.result, fitted.case and fitted.case.sample
        sizes = (sample.thickness, sample.diameter) if sample else (None, None)
        return cls(fitted.sample, folder, result.success, dict(result.parameters), result.objective, *sizes)

    def as_json(self) -> dict[str, Any]:
        """The sample's keys in per_sample.json."""
        if self.problem is not None:
            return {"sample": self.sample, "problem": self.problem}
        return {
            "sample": self.sample,
            "folder": self.folder,
            "success": self.success,
            "parameters": {name: parameter.as_json() for name, parameter in self.parameters.items()},
            "objective": self.objective,
            "thickness_mm": self.thickness,
            "diameter_mm": self.diameter,
        }

    @classmethod
    def from_json(cls, value: Mapping[str, Any]) -> "SampleSummary":
        """The summary that `as_json` wrote."""
        if "problem" in value:
            return cls(value["sample"], problem=value["problem"])
        parameters = TypeAdapter(dict[str, ParameterEstimate]).validate_python(value["parameters"])
        sizes = value["thickness_mm"], value["diameter_mm"]
        return cls(value["sample"], value["folder"], value["success"], parameters, value["objective"], *sizes)


@dataclass(frozen=True, repr=False)
class PerSample:
    """The fits of a set of samples, and the spread of each free parameter over those that converged."""

    FORMAT: ClassVar[str] = "indentfit.per_sample/2"

    samples: tuple[SampleSummary, ...]
    spread: dict[str, ParameterSpread]
    fits: tuple[SampleFit, ...] = field(default=(), compare=False)  # empty for a result that was read from per_sample.json

    @property
    def free(self) -> tuple[str, ...]:
        """Names of the parameters that were fitted."""
        return next((summary.free for summary in self.samples if summary.free), ())

    @classmethod
    def of(cls, fits: Sequence[SampleFit], folders: Sequence[str]) -> "PerSample":
        """The fits of samples, each with the name of its own result folder."""
        samples = tuple(SampleSummary.of(fitted, folder) for fitted, folder in zip(fits, folders, strict=True))
        return cls(samples, parameter_spread(fits), tuple(fits))

    def as_json(self) -> dict[str, Any]:
        """The stable keys of per_sample.json, under the tag `format`."""
        samples = [summary.as_json() for summary in self.samples]
        return {"format": self.FORMAT, "samples": samples, "spread": {name: over.as_json() for name, over in self.spread.items()}}

    @classmethod
    def from_json(cls, value: Mapping[str, Any]) -> "PerSample":
        """What per_sample.json holds, in the form of this version or of 0.1."""
        spread = {name: ParameterSpread(**over) for name, over in value["spread"].items()}
        return cls(tuple(map(SampleSummary.from_json, value["samples"])), spread)

    def summary(self) -> str:
        """The fits in words, as the command prints them."""
        from indentfit.report.per_sample import sample_lines

        return "\n".join(sample_lines(self))

    def plot(self, path: str | Path | None = None) -> Any:
        """The matplotlib Figure of the parameters of all samples; saved as SVG and PNG where a path is given."""
        from indentfit.report.per_sample import samples_figure

        return samples_figure(self, path)

    def write(self, folder: str | Path, overwrite: bool = False) -> None:
        """Write the result folder, with a folder of each sample. Raises OutputError where it cannot be written."""
        from indentfit.report.samples_folder import write_samples

        write_samples(self, folder, overwrite)

    def __repr__(self) -> str:
        spread = ", ".join(f"{name} = {over}" for name, over in self.spread.items())
        return f"PerSample({len(self.samples)} samples: {spread or 'no fit converged'})"


def sample_cases(path: str | Path, specimens: Sequence[Specimen], overrides: Sequence[str] = ()) -> list[tuple[str, Case]]:
    """The case of each specimen: a case file with the specimen's own curves, thickness and diameter.

    Parameters
    ----------
    path : path
        The case file.
    specimens : sequence of Specimen
        The rows of replicates.csv.
    overrides : sequence of str
        KEY=VALUE.

    Returns
    -------
    list of (name of the specimen, Case)

    Raises
    ------
    CaseError
        A specimen lacks a direction of the case (its fit would use another specimen's curve), or two tests have the same direction.
    """
    pooled = read_case(path, overrides)
    if any(test.field for test in pooled.tests):
        raise CaseError(f"{path}: test.field: each sample has displacements of its own; fit each with a case of its own")
    tests: dict[float | None, str] = {test.direction: test.name for test in pooled.tests}
    if len(tests) < len(pooled.tests):
        raise CaseError(f"{path}: two tests have the same angle; --per-sample needs one test for each direction")
    cases = []
    for specimen in specimens if has_fibres(pooled.law) else [_turned(specimen, tests) for specimen in specimens]:
        if missing := [direction for direction in tests if direction not in specimen.curves]:
            raise CaseError(f"{path}: sample {specimen.name} has no curve of direction {missing[0]}; remove it from the table")
        case = read_case(path, (*overrides, *_own_keys(specimen, pooled, tests)))
        require_fittable(case)
        cases.append((specimen.name, case))
    return cases


def _turned(specimen: Specimen, tests: Mapping[Any, str]) -> Specimen:
    """A specimen of a material without fibres: its only curve is that of the only test, whatever direction the table gives."""
    if len(tests) == len(specimen.curves) == 1:
        return replace(specimen, curves=dict(zip(tests, specimen.curves.values(), strict=True)))
    return specimen


def _own_keys(specimen: Specimen, pooled: Case, tests: Mapping[Any, str]) -> list[str]:
    keys = [f"test.{name}.curve={_quoted(specimen.curves[angle])}" for angle, name in tests.items()]
    keys += [f"sample.thickness={specimen.thickness!r}"] if specimen.thickness else []
    if specimen.diameter and "diameter" in keys_of(type(pooled.sample.geometry)):
        keys.append(f"sample.diameter={specimen.diameter!r}")
    return keys


def fit_sample(
    name: str,
    case: Case,
    progress: Callable[[float, str], object] | None = None,
    ledger: Ledger | None = None,
    cluster: str | None = None,
    stop: Callable[[], int] | None = None,
) -> SampleFit:
    """The SampleFit of one of `sample_cases`; a ConvergenceError becomes its problem. The other arguments are those of `fit`."""
    try:
        whole = fit_with_runs(case, progress, ledger, cluster, stop)
        return SampleFit(name, case, whole.result, whole=whole)
    except ConvergenceError as error:
        return SampleFit(name, case, None, str(error))


def parameter_spread(fits: Sequence[SampleFit]) -> dict[str, ParameterSpread]:
    """Name -> ParameterSpread of each free parameter over the fits that converged."""
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
