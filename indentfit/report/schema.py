"""What a result folder holds, as objects: one versioned schema for each kind of result, version 0.1 included.

Each kind has the tag "indentfit.KIND/2" under the key `format` of its JSON file. Version 0.1 wrote `format_version: 1` for a fit
and "indentfit.KIND/1" for the others; its files are read too.
"""

import inspect
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Any

from pydantic import ValidationError

from indentfit import indenters, samples
from indentfit.axes import INDENTATION, Axes
from indentfit.case import Case, MaterialChoice, Mesh
from indentfit.case.laws import has_fibres
from indentfit.case.materials import DEFAULT_BULK_RATIO
from indentfit.case.priors import Prior
from indentfit.case.specimen import axes_of
from indentfit.case.tables import Indenter, OwnIndenter, OwnSample, OwnTable, Sample, keys_of_shape
from indentfit.curve import Curve
from indentfit.errors import CaseError, IndentfitError, OutputError
from indentfit.experiment.measured import read_case
from indentfit.fem.facts import MeshFacts, SolveFacts, SolverFacts
from indentfit.fem.result import TimeCurve
from indentfit.inference.result import FitResult
from indentfit.runs.closed_form import ClosedForm
from indentfit.shapes import Registry

if TYPE_CHECKING:
    from indentfit.inference.per_sample import PerSample
    from indentfit.inference.population_fit import Population
    from indentfit.report.stored_process import StoredProcess
    from indentfit.study.compare import Comparison
    from indentfit.study.design import Design
    from indentfit.study.mesh_check import MeshCheck
    from indentfit.study.sweep import Sweep

RESULT_FILES = ("result.json", "simulation.json", "design.json", "per_sample.json", "summary.json")


@dataclass(frozen=True)
class TestFacts:
    """The facts about one test of a case in a report: `curve` or `record` is the file's name, `depth` is in mm.

    A test without an indenter has its kind, loading and fibres in place of the angle, and may have a strain in place of the depth.
    """

    __test__ = False  # not a test of pytest's

    name: str
    angle: str | None
    source: str | None
    points: int
    depth: str
    weight: float | None
    own: str = ""  # sample and indenter of this test, in words, where they are its own
    synthetic: bool = False  # whether its curve was computed


@dataclass(frozen=True)
class CaseFacts:
    """The facts about a case in a report.

    Parameters
    ----------
    sample, indenter : str
        In words.
    mesh, material : tables of the case
    element : str
        "q1p0" or "q2p1".
    tests : tuple of TestFacts
    equation : str
        The energy of the material, with its source.
    units : dict of parameter -> unit
        "1" for none.
    layers : tuple of str
        Each layer of the sample in words, the top one first, with its law and bulk modulus; empty for a sample of one material.
    bulk_doubt : str
        Behind the bulk modulus: by what the bulk ratio is uncertain, in words; empty where it is taken as known.
    """

    sample: str
    indenter: str
    mesh: Mesh
    material: MaterialChoice
    element: str
    tests: tuple[TestFacts, ...]
    equation: str
    units: dict[str, str]
    layers: tuple[str, ...] = ()
    bulk_doubt: str = ""

    @classmethod
    def from_json(cls, value: Mapping[str, Any]) -> "CaseFacts":
        """The facts that `case_json` wrote."""
        return cls(
            sample=_sample_words(value["sample"]) + _doubts(value, "base", "thickness") if value["sample"].get("shape") else "",
            indenter=_indenter_words(value["indenter"], _by_prior(value, "friction")) + _doubts(value, "friction", "size")
            if value["indenter"].get("shape")
            else "",
            mesh=Mesh.model_validate(_given(value["mesh"])),
            material=MaterialChoice.model_validate(_given(value["material"])),
            element=value["solver"]["element"],
            tests=tuple(_test_facts(test, value) for test in value["tests"]),
            equation=value.get("equation", ""),
            units=dict(value.get("units", {})),
            layers=tuple(map(_layer_words, value["sample"].get("layer") or ())),
            bulk_doubt=_doubts(value, "bulk_ratio"),
        )


@dataclass(frozen=True)
class SimulatedTest:
    """One simulated test: its curve, and the facts of its solution."""

    name: str
    angle: float | None
    curve: Curve
    facts: SolveFacts
    in_time: TimeCurve | None = None
    kind: str = "indentation"
    fibres: str | None = None
    dip: float = 0.0

    @property
    def direction(self) -> str:
        """The direction of the fibres, in words."""
        return _angle_words(self.angle, self.dip) if self.kind == "indentation" else f"{self.kind}, {self.fibres or 'no fibres'}"


@dataclass(frozen=True)
class StoredSimulation:
    """A simulation as simulation.json holds it; parameters: name -> value, in their units."""

    title: str
    parameters: dict[str, float]
    tests: tuple[SimulatedTest, ...]
    mesh: MeshFacts
    solver: SolverFacts
    moduli: dict[str, float] = field(default_factory=dict)
    closed_forms: dict[str, ClosedForm] = field(default_factory=dict)
    measured: dict[str, Curve] = field(default_factory=dict)
    misfits: dict[str, float] = field(default_factory=dict)

    @classmethod
    def from_json(cls, value: Mapping[str, Any]) -> "StoredSimulation":
        tests = tuple(
            SimulatedTest(
                test["name"],
                test["angle"],
                _curve(test),
                SolveFacts.from_json(test["facts"]),
                TimeCurve.from_json(test["in_time"]) if "in_time" in test else None,
                test.get("kind", "indentation"),
                test.get("fibres"),
                test.get("dip", 0.0),
            )
            for test in value["tests"]
        )
        facts = MeshFacts(**value["mesh"]), SolverFacts(**value["solver"])
        forms = {name: ClosedForm(**form) for name, form in value.get("closed_forms", {}).items()}
        measured = {name: _curve(c) for name, c in value.get("measured", {}).items()}
        moduli, misfits = value.get("moduli", {}), value.get("misfits", {})
        return cls(value["title"], value["parameters"], tests, *facts, moduli, forms, measured, misfits)


@dataclass(frozen=True)
class Stored:
    """A result as its folder holds it.

    Parameters
    ----------
    folder : Path
    result : FitResult, PerSample, Population, Sweep, MeshCheck, Design, Comparison, StoredSimulation or StoredProcess
    case : CaseFacts or None
    overrides : tuple of "KEY=VALUE"
        Overrides with which the copy of the case is the case that was run.
    case_hash : str or None
    versions : dict of package -> version
    written : str
        The day on which the result was written, "2026-11-28"; empty where that is not known.
    """

    folder: Path
    result: "FitResult | PerSample | Population | Sweep | MeshCheck | Design | Comparison | StoredSimulation | StoredProcess"
    case: CaseFacts | None
    overrides: tuple[str, ...]
    case_hash: str | None
    versions: dict[str, str]
    written: str = ""

    @property
    def synthetic(self) -> tuple[str, ...]:
        """The names of the tests whose curves were computed and not measured."""
        return tuple(test.name for test in self.case.tests if test.synthetic) if self.case else ()

    def unit(self, parameter: str) -> str:
        """The unit of a parameter of the material, "1" for none."""
        return self.case.units.get(parameter, "1") if self.case else "1"


CLASSES = {  # of results by the tag of their format; a command imports only that of the result it reads
    "indentfit.fit/2": "indentfit.inference.result:FitResult",
    "indentfit.sweep/2": "indentfit.study.sweep:Sweep",
    "indentfit.mesh_check/2": "indentfit.study.mesh_check:MeshCheck",
    "indentfit.simulation/2": "indentfit.report.schema:StoredSimulation",
    "indentfit.design/2": "indentfit.study.design:Design",
    "indentfit.comparison/2": "indentfit.study.compare:Comparison",
    "indentfit.per_sample/2": "indentfit.inference.per_sample:PerSample",
    "indentfit.population/2": "indentfit.inference.population_fit:Population",
    "indentfit.process/2": "indentfit.report.stored_process:StoredProcess",
}
FIRST_VERSION = {  # tags of version 0.1
    "indentfit.sweep/1": "indentfit.sweep/2",
    "indentfit.mesh-check/1": "indentfit.mesh_check/2",
    "indentfit.simulation/1": "indentfit.simulation/2",
    "indentfit.per_sample/1": "indentfit.per_sample/2",
    "indentfit.records/1": "indentfit.process/2",
}
# errors that damaged or foreign values in a result file raise
DAMAGE = (LookupError, TypeError, ValueError, AttributeError, ArithmeticError, RecursionError, IndentfitError)
# keys by which 0.1's files without a tag are known
UNTAGGED = {"format_version": "indentfit.fit/2", "candidates": "indentfit.design/2"}


def read_result(folder: str | Path) -> Stored:
    """The result that a folder holds.

    Raises
    ------
    OutputError
        The folder is not a result folder, or has an unknown version.
    LookupError, TypeError, ValueError and their kin
        The result file is damaged.
    """
    folder = Path(folder)
    value = _value(folder)
    tag = str(value.get("format", next((kind for key, kind in UNTAGGED.items() if key in value), None)))
    tag = FIRST_VERSION.get(tag, tag)
    if tag not in CLASSES:
        raise OutputError(f"{folder}: a result of an unknown format ({tag[:60]!r}); use the indentfit that wrote it")
    case = CaseFacts.from_json(value["case"]) if value.get("case") else None
    result = resolve_name(CLASSES[tag]).from_json(value)
    overrides, versions = tuple(value.get("overrides", ())), dict(value.get("versions") or {})
    return Stored(folder, result, case, overrides, value.get("case_hash"), versions, str(value.get("written", ""))[:10])


def fitted_parameters(folder: str | Path, case: Case) -> dict[str, float]:
    """The parameters that a fit of the same material has found, the free ones within the ranges of the case.

    Parameters
    ----------
    folder : path
        The result folder of a fit.
    case : Case

    Returns
    -------
    dict of parameter -> value, in its unit

    Raises
    ------
    CaseError
        The folder holds no fit, or one of another material.
    """
    path = Path(folder) / "result.json"
    kind = case.material.model or "this energy"
    try:
        result = read_result(folder).result
    except (OutputError, *DAMAGE) as error:
        what = f"{type(error).__name__}: {' '.join(str(error).split())[:200]}"
        raise CaseError([f"{path}: cannot be read as the result of a fit ({what}); name the folder of a fit"]) from error
    if not isinstance(result, FitResult) or not set(case.law.parameters) <= set(result.parameters):
        raise CaseError([f"{path}: holds no parameters of {kind}; name the folder of a fit of this case"])
    relaxing = [name for name in (case.relaxation.parameters if case.relaxation else ()) if name in result.parameters]
    values = {name: result.parameters[name].value for name in (*case.law.parameters, *relaxing)}
    return values | {name: min(max(values[name], bounds.min), bounds.max) for name, bounds in case.free.items() if name in values}


def fit_with_case(folder: str | Path, overrides: Sequence[str] = ()) -> tuple[FitResult, Case]:
    """The result of a fit with its case, and that case with some keys replaced.

    Parameters
    ----------
    folder : path
        The result folder of a fit.
    overrides : sequence of "KEY=VALUE"

    Raises
    ------
    CaseError
        The folder holds no fit, or a key or value is wrong.
    """
    path = Path(folder) / "result.json"
    try:
        stored = read_result(folder)
    except (OutputError, *DAMAGE) as error:
        what = f"{type(error).__name__}: {' '.join(str(error).split())[:200]}"
        raise CaseError([f"{path}: cannot be read as the result of a fit ({what}); name the folder of a fit"]) from error
    if not isinstance(stored.result, FitResult):
        raise CaseError([f"{path}: is no result of a fit; name the folder of a fit"])
    file = Path(folder) / "case.toml"
    fitted = read_case(file, stored.overrides)
    deeper = [key.rpartition(".")[0] for key in _keys(overrides) if key.endswith((".depth", ".strain"))]
    kept = [known for known, key in zip(stored.overrides, _keys(stored.overrides), strict=True) if key not in _curves_of(deeper)]
    return replace(stored.result, case=fitted), read_case(file, (*kept, *overrides))


def _keys(overrides: Sequence[str]) -> list[str]:
    return [override.partition("=")[0].strip() for override in overrides]


def _curves_of(tests: Sequence[str]) -> list[str]:
    """The keys of curves of tests, which the depth of a test replaces."""
    return [f"{test}.{key}" for test in tests for key in ("curve", "synthetic")]


def case_json(case: Case) -> dict[str, Any]:
    """The facts about a case in the JSON file of a result: its tables, its tests with their number of points and depth,
    the energy of its material, whether that has fibres, and the units of its parameters."""
    sections = case.model_dump(mode="json", exclude={"path", "overrides", "curves", "tests", "title"})
    tests = [{**_test_json(test), "n": case.points(test), **_end_json(case, test)} for test in case.tests]
    units = {name: parameter.unit for name, parameter in case.law.parameters.items()}
    return {
        **sections,
        "tests": tests,
        "equation": inspect.getdoc(case.law) or "",
        "has_fibres": has_fibres(case.law),
        "units": units,
    }


def _end_json(case: Case, test: Any) -> dict[str, float]:
    """The largest displacement of a test, or its largest strain."""
    last = float(case.outputs(test)[-1])
    return {"depth_mm" if axes_of(test).across == "displacement" else "largest_strain": last}


def _curve(test: Mapping[str, Any]) -> Curve:
    """The curve of a simulated test."""
    axes = Axes("strain" if "strain" in test else "displacement", "stress" if "stress_kPa" in test else "force")
    across, up = axes.header
    return Curve(test[across], test[up], axes=None if axes == INDENTATION else axes)


def _test_json(test: Any) -> dict[str, Any]:
    keys = test.model_dump(mode="json", exclude={"curve"})
    return {**keys, "curve": test.curve if isinstance(test.curve, str) else None}


def _test_facts(test: Mapping[str, Any], case: Mapping[str, Any]) -> TestFacts:
    source = test.get("curve") or test.get("record")
    words = [_own_words(test, case, "sample", OwnSample, Sample, _sample_words)]
    words.append(_own_words(test, case, "indenter", OwnIndenter, Indenter, _indenter_words))
    own = "; ".join(text for text in words if text)
    end = f"{test['depth_mm']:.4g}" if "depth_mm" in test else f"strain {test['largest_strain']:.4g}"
    plain = test["angle"] is None or not case.get("has_fibres", True)
    direction = None if plain else _angle_words(test["angle"], test.get("dip", 0.0))
    if test.get("kind", "indentation") != "indentation":
        direction = ", ".join(test[key] for key in ("kind", "loading", "fibres") if test.get(key))
    return TestFacts(test["name"], direction, source, test["n"], end, test["weight"], own, bool(test.get("synthetic")))


def _angle_words(angle: float | None, dip: float) -> str:
    """An angle in the column of angles, with the dip where the fibres dip."""
    return f"{angle}, dip {dip:g}" if dip else str(angle)


def _own_words(
    test: Mapping[str, Any],
    case: Mapping[str, Any],
    name: str,
    kind: type[OwnTable],
    table: type[Sample] | type[Indenter],
    words: Callable[[Mapping[str, Any]], str],
) -> str:
    """A test's own sample or indenter in words; empty where the test has that of the case."""
    if not test.get(name):
        return ""
    try:
        own: Sample | Indenter = kind.model_validate(_given(test[name])).over(table.model_validate(_given(case[name])))
    except ValidationError:  # the package that offers the shape is not installed
        return f"{name} of its own"
    return words(own.model_dump(mode="json"))


def _sample_words(table: Mapping[str, Any]) -> str:
    layers = ", ".join(f"{layer['name']} {layer['thickness']:.4g} mm" for layer in table.get("layer") or ())
    layered = f" (layers from the top: {layers})" if layers else ""
    stretch = f", stretched {table['prestretch']:g} times along x, its ends held" if table.get("prestretch") else ""
    return f"{_shape_words(samples.SHAPES, table)}, thickness {table['thickness']:.4g} mm{layered}{stretch}, {table['base']} base"


def _layer_words(table: Mapping[str, Any]) -> str:
    nu, ratio = table.get("poisson_ratio"), table.get("bulk_ratio") or DEFAULT_BULK_RATIO
    bulk = f"a bulk modulus of {ratio:.4g} shear moduli" if nu is None else f"a Poisson's ratio of {nu:.4g}"
    law = (table.get("model") or table.get("energy") or "").replace("_", " ")
    return f"{table['name']}, {table['thickness']:.4g} mm thick: {law} with {bulk}"


def _indenter_words(table: Mapping[str, Any], by_prior: bool = False) -> str:
    """The indenter's shape, and its friction where no prior stands in the place of a value."""
    friction = "sticking" if table["friction"] == "stick" else f"friction coefficient {table['friction']:.4g}"
    return f"rigid {_shape_words(indenters.SHAPES, keys_of_shape(table))}{'' if by_prior else f', {friction}'}"


def _by_prior(case: Mapping[str, Any], name: str) -> bool:
    return isinstance(case.get("fit", {}).get("uncertain", {}).get(name), Mapping)


def _doubts(case: Mapping[str, Any], *names: str) -> str:
    """Which inputs of a case are uncertain, and by what: the fit does not take the value that stands before as known."""
    uncertain = case.get("fit", {}).get("uncertain", {})
    return "".join(f"; {name} uncertain ({_prior_words(name, uncertain[name])})" for name in names if uncertain.get(name))


def _prior_words(name: str, stated: Any) -> str:
    if isinstance(stated, Mapping):
        given = _given(stated)
        return f"fitted, {given['min']:g} to {given['max']:g}" if "min" in given else Prior.model_validate(given).words()
    return f"the other one with probability {stated:g}" if name == "base" else f"standard deviation {stated:g}"


def _shape_words(shapes: Registry[Any], table: Mapping[str, Any]) -> str:
    """A shape in its own words; only its name where the package that offers the shape is not installed."""
    shape = shapes.make(table)
    return str(shape.words()) if shape else str(table["shape"])


def _given(table: Mapping[str, Any]) -> dict[str, Any]:
    """The keys of a table that have a value: the stored table also names the keys of other shapes, with null."""
    return {key: value for key, value in table.items() if value is not None}


def _value(folder: Path) -> dict[str, Any]:
    for name in RESULT_FILES:
        if (folder / name).is_file():
            try:
                value = json.loads((folder / name).read_text(encoding="utf-8"))
            except (ValueError, OSError, RecursionError) as error:
                raise OutputError(f"{folder / name}: cannot be read ({error}); run the command again") from error
            if isinstance(value, dict):
                return value
    raise OutputError(f"{folder}: not a result folder of indentfit: it has no result.json; name the folder of a result")
