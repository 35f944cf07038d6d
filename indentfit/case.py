"""The case file: everything that a result depends on, as frozen values in mm, mN and kPa.

`read_case` turns a TOML file, the curves it names and the `--set` overrides into a `Case`, or raises one
CaseError that holds a line for every fault it could find. Quantities are plain numbers in the unit stated in
a key's description, or strings with a unit ("3.3 mm"), which are converted here and nowhere else.
"""

from __future__ import annotations

import contextlib
import difflib
import functools
import hashlib
import itertools
import json
import math
import re
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    InstanceOf,
    PlainValidator,
    TypeAdapter,
    ValidationError,
    WrapValidator,
    field_validator,
    model_validator,
)
from pydantic_core import InitErrorDetails, PydanticCustomError

from .curve import Curve, read_curve, unit_factor
from .errors import CaseError, CurveError, MaterialError, RecordError
from .experiment.record import STRAINS, Channel, Layout, Options
from .material import Material, blamed, load, typed

DEFAULT_BULK_RATIO = 1000.0
WIDEST_INDENTER = 0.9  # of the sample: beyond it the free border is too narrow to mesh and to trust
DEEPEST_INDENTATION = 0.5  # of the thickness
MOST_CORNERS = 5  # free parameters whose bounds are combined to look for an unstable material
QUANTITY = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([^\d.\s](?:.*\S)?)\s*", re.ASCII)


def _quantity(unit):
    """Let a number be given as a string with a unit, and turn it into `unit`."""

    def number(value):
        if not isinstance(value, str):
            return value
        try:
            return _number_in(unit, value)
        except ValueError as error:
            raise _refusal(str(error)) from None

    return BeforeValidator(number)


def _number_in(unit, text):
    """The number of a string such as "3.3 mm", in `unit`; where the unit is None, not converted. Raises ValueError."""
    match = QUANTITY.fullmatch(text)
    if unit == "1":
        raise ValueError("must be a plain number, without unit and quotes")
    if not match:
        raise ValueError(f'must be a number in {unit} or a string such as "1.5 {unit}"' if unit else "must be a number")
    factor = unit_factor(match[2], unit) if unit else 1.0
    return float(f"{float(match[1]) * factor:.15g}")  # so that 3300 um is 3.3 mm and not a bit more


def _refusal(text, kind="fault"):
    return PydanticCustomError(kind, "{text}", {"text": text})


def _friction(value):
    if value == "stick":
        return value
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value <= 10:
        raise _refusal('must be a coefficient from 0 to 10, or "stick" for no slip at all')
    return float(value)


def _fixed_or_range(value, _):
    if isinstance(value, Range):
        return value
    if isinstance(value, dict):
        return Range.model_validate(value)
    if isinstance(value, bool) or not isinstance(value, int | float) or not _finite(value):
        raise _refusal("must be a finite number, or {start = ..., min = ..., max = ...} to be fitted")
    return float(value)


def _finite(value):
    try:
        return math.isfinite(value)
    except OverflowError:
        return False


def _not_bool(value):
    if isinstance(value, bool):
        raise _refusal("must be 0 or 90, the degrees between the fibres and the indenter's long side")
    return value


def _one_line(text):
    if not text.strip() or not text.isprintable():
        raise _refusal("must be printable text on one line")
    return text


def _tuple(value):
    return tuple(value) if isinstance(value, list) else value


Finite = Annotated[float, Field(allow_inf_nan=False)]
Length = Annotated[float, _quantity("mm"), Field(gt=0, allow_inf_nan=False)]
Radius = Annotated[float, _quantity("mm"), Field(ge=0, allow_inf_nan=False)]
Pressure = Annotated[float, _quantity("kPa"), Field(gt=0, allow_inf_nan=False)]
Friction = Annotated[float | Literal["stick"], PlainValidator(_friction)]
Angle = Annotated[Literal[0, 90], BeforeValidator(_not_bool)]
Line = Annotated[str, AfterValidator(_one_line)]


class Section(BaseModel):
    """One table of the case file: strict types, no unknown keys, and `faults` where keys must agree."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    def faults(self):
        """(key, what is wrong) for keys that are right alone but not together; a key that is not right is None."""
        yield from ()

    @model_validator(mode="after")
    def _agree(self):
        _raise_faults(type(self), [(key, getattr(self, key), text) for key, text in self.faults()])
        return self

    def _keys_of(self, shape, needed):
        """Faults where keys of another shape are given, or those of this shape are missing."""
        if shape not in needed:
            return
        for key in sorted(set().union(*needed.values())):
            if key in needed[shape] and key not in self.model_fields_set:
                yield key, f"missing; a {shape} needs it: {type(self).model_fields[key].description}"
            elif key not in needed[shape] and key in self.model_fields_set:
                yield key, f"does not belong to a {shape}; remove it"


def _raise_faults(model, faults):
    details = [
        InitErrorDetails(type=_refusal(text, "disagreement"), loc=tuple(key.split(".")), input=value) for key, value, text in faults
    ]
    if details:
        raise ValidationError.from_exception_data(model.__name__, details)


class Sample(Section):
    """The piece of tissue; y is the axis of indentation, x and z lie in its plane."""

    shape: Literal["disc", "block"] = Field(description="shape of the sample")
    diameter: Length | None = Field(default=None, description="diameter of the disc, mm")
    length: Length | None = Field(default=None, description="size of the block along x, mm")
    width: Length | None = Field(default=None, description="size of the block along z, mm")
    thickness: Length = Field(description="thickness of the sample along y, mm")
    base: Literal["sliding", "bonded"] = Field(description="whether the sample slides on its support or is glued to it")

    @property
    def extent(self):
        """Full size along x and along z, mm."""
        return (self.diameter, self.diameter) if self.shape == "disc" else (self.length, self.width)

    def faults(self):
        yield from self._keys_of(self.shape, SHAPES_OF_SAMPLE)


class Indenter(Section):
    """The rigid indenter, centred on the sample; a strip's long side lies along x."""

    shape: Literal["strip", "cylinder", "sphere"] = Field(description="shape of the indenter")
    width: Length | None = Field(default=None, description="size of the strip along z, mm")
    length: Length | None = Field(default=None, description="size of the strip along x, mm; it may overhang the sample")
    diameter: Length | None = Field(default=None, description="diameter of the flat cylinder or of the sphere, mm")
    edge_radius: Radius = Field(default=0.0, description="radius of the edge, mm; 0 is sharp")
    friction: Friction = Field(description='friction coefficient, or "stick"')

    @property
    def half_width(self):
        """Half the width of a strip, the radius of a cylinder or of a sphere, mm."""
        width = self.width if self.shape == "strip" else self.diameter
        assert width is not None  # `faults` has seen to that
        return width / 2

    def faults(self):
        yield from self._keys_of(self.shape, SHAPES_OF_INDENTER)
        if self.shape == "sphere" and self.edge_radius:
            yield "edge_radius", "a sphere has no edge; remove it"
        width = self.width if self.shape == "strip" else self.diameter
        if (
            self.shape in ("strip", "cylinder")
            and width is not None
            and self.edge_radius is not None
            and 2 * self.edge_radius > width
        ):
            yield "edge_radius", f"must not exceed half of the indenter's {width:g} mm"


SHAPES_OF_SAMPLE = {"disc": {"diameter"}, "block": {"length", "width"}}
SHAPES_OF_INDENTER = {"strip": {"width", "length"}, "cylinder": {"diameter"}, "sphere": {"diameter"}}


class Mesh(Section):
    """The mesh of the quarter sample; without either key, the default mesh."""

    size: Length | None = Field(default=None, description="size of the elements, mm: they are smaller at the indenter's edge")
    elements: int | None = Field(default=None, ge=20, le=2_000_000, description="about how many elements")

    @property
    def default(self):
        return self.size is None and self.elements is None

    def faults(self):
        if {"size", "elements"} <= self.model_fields_set:
            yield "elements", "mesh.size is given too; keep one of them"


class Range(Section):
    """A free parameter of the material: where a search starts, and its bounds, in the parameter's unit."""

    start: Finite = Field(description="value to start from")
    min: Finite = Field(description="lower bound")
    max: Finite = Field(description="upper bound")

    def faults(self):
        if _known(self.min, self.max) and self.min >= self.max:
            yield "min", f"must be below max = {self.max:g}; for a fixed parameter give just the number"
        elif _known(self.start, self.min) and self.start < self.min:
            yield "start", f"is below min = {self.min:g}; start between the bounds"
        elif _known(self.start, self.max) and self.start > self.max:
            yield "start", f"is above max = {self.max:g}; start between the bounds"


class MaterialCase(Section):
    """The material: an installed model, `file.py:Class`, or a typed energy, with its parameters."""

    model: Line | None = Field(default=None, description="name of an installed material, or file.py:Class")
    energy: Line | None = Field(default=None, description="energy as a formula in I1, I2, I4, I5 and the parameters, kPa")
    parameters: dict[str, Annotated[float | Range, WrapValidator(_fixed_or_range)]] = Field(
        default_factory=dict, description="parameters, each a number, or {start, min, max} to be fitted"
    )
    bulk_ratio: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = Field(
        default=None, description="bulk modulus over shear modulus"
    )
    kappa: Pressure | None = Field(default=None, description="bulk modulus, kPa")

    @model_validator(mode="before")
    @classmethod
    def _nearly_incompressible(cls, keys):
        if isinstance(keys, dict) and not {"bulk_ratio", "kappa"} & set(keys):
            return {**keys, "bulk_ratio": DEFAULT_BULK_RATIO}
        return keys

    def bulk_modulus(self, shear_modulus):
        """kappa in kPa, for a material of this shear modulus, kPa."""
        return self.bulk_ratio * shear_modulus if self.kappa is None else self.kappa

    def faults(self):
        given = self.model_fields_set
        if {"model", "energy"} <= given:
            yield "energy", "material.model is given too; keep one of them"
        if not {"model", "energy"} & given:
            yield "model", f"missing; give {type(self).model_fields['model'].description}, or material.energy"
        if {"bulk_ratio", "kappa"} <= given:
            yield "kappa", "material.bulk_ratio is given too; keep one of them"


class RecordChannel(Section):
    """How a column of a raw record becomes a quantity: sign * gain * value + offset, in `unit`."""

    column: Annotated[int, Field(ge=1)] | Line | None = Field(default=None, description="name of the column, or its number from 1")
    gain: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = Field(
        default=None, description="`unit` per unit of the column"
    )
    sign: Literal[1, -1] = Field(default=1, description="-1 where the column falls under load")
    offset: Finite = Field(default=0.0, description="added after the gain, in `unit`")
    unit: Line | None = Field(default=None, description="unit of the quantity; by default that of the column's header")

    @property
    def channel(self):
        """The `Channel` of experiment.record."""
        return Channel(self.column, self.gain, self.sign, self.offset, self.unit)


class Record(Section):
    """How the raw records of the tests are read, and turned into curves."""

    displacement: RecordChannel = Field(default=RecordChannel(), description="table of the displacement: column, gain, sign, unit")
    force: RecordChannel = Field(default=RecordChannel(), description="table of the force: column, gain, sign, unit")
    time: RecordChannel = Field(default=RecordChannel(), description="table of the time, where there is no rate")
    rate: Annotated[float, _quantity("Hz"), Field(gt=0, allow_inf_nan=False)] | None = Field(
        default=None, description="sampling rate, Hz"
    )
    skip_rows: int = Field(default=0, ge=0, description="rows before the table, beyond a header")
    sheet: Annotated[int, Field(ge=1)] | Line | None = Field(default=None, description="sheet of a workbook, name or number")
    encoding: Line | None = Field(default=None, description="encoding, where it cannot be told: utf-8, utf-16, gbk, latin-1")
    contact: Literal["piecewise", "threshold", "variance_ratio"] = Field(
        default="piecewise", description="method of the contact point"
    )
    indenter: Literal["flat", "sphere"] | None = Field(
        default=None, description="end of the indenter, for the contact point; in a case that of [indenter]"
    )
    filter: Annotated[float, Field(gt=0, le=0.3)] = Field(default=0.1, description="length of the filter over the ramp's duration")
    points: int = Field(default=25, ge=5, le=10_000, description="points of a curve")
    strains: Annotated[tuple[Annotated[float, Field(gt=0, lt=1)], ...], BeforeValidator(_tuple)] = Field(
        default=STRAINS, description="strains (depth over thickness) at which `process` tells the force"
    )
    prony_terms: Literal[0, 1, 2, 3, "auto"] = Field(default=2, description='terms of the Prony series, 0 to 3, or "auto"')

    @property
    def layout(self):
        """The `Layout` of experiment.record."""
        channels = (self.displacement.channel, self.force.channel)
        return Layout(*channels, self.rate, self.time.channel, self.skip_rows, self.sheet, self.encoding)

    @property
    def options(self):
        """The `Options` of experiment.process."""
        return Options(self.contact, self.indenter or "flat", self.points, self.filter, self.strains, self.prony_terms)


class Test(Section):
    """One indentation: its direction, and the measured curve, the raw record of it, or just a depth to simulate."""

    __test__ = False  # not a test of pytest's

    name: Annotated[Line, Field(max_length=60)] = Field(description="name of the test")
    angle: Angle = Field(description="degrees between the fibres and x, the indenter's long side: 0 or 90")
    curve: Line | None = Field(default=None, description="CSV file of the measured curve, relative to the case file")
    record: Line | None = Field(default=None, description="raw record of the rig, relative to the case file; see [record]")
    depth: Length | None = Field(default=None, description="depth to simulate, mm, where there is no curve")
    points: int = Field(default=25, ge=1, le=10_000, description="number of points to simulate, where there is no curve")
    weight: Annotated[float, Field(ge=0, allow_inf_nan=False)] | None = Field(
        default=None, description="weight in the objective; by default 1 / number of tests"
    )

    def faults(self):
        given = self.model_fields_set
        sources = [key for key in ("curve", "record", "depth") if key in given]
        if len(sources) > 1:
            yield sources[-1], f"a {sources[0]} is given too; keep one of them"
        if not sources:
            yield "curve", "missing; give the file of the measured curve, or of its raw record (record), or depth (mm)"
        if {"curve", "record"} & given and "points" in given:
            yield "points", "belongs to a test with a depth; the points of a curve are those of its file"


def _spread_or_range(value, _):
    if isinstance(value, Range):
        return value
    if isinstance(value, dict):
        return Range.model_validate(value)
    if isinstance(value, bool) or not isinstance(value, int | float) or not _finite(value) or value <= 0:
        raise _refusal("must be a standard deviation above 0, or {start = ..., min = ..., max = ...} to be fitted")
    return float(value)


def _odds(value):
    return {True: 0.5, False: None}[value] if isinstance(value, bool) else value


Spread = Annotated[float | Range, WrapValidator(_spread_or_range)]
SpreadOfLength = Annotated[float | Range, WrapValidator(_spread_or_range), _quantity("mm")]
LEAST_INPUT = {"friction": 0.0, "bulk_ratio": 1.0, "thickness": 1e-3}


class Uncertain(Section):
    """Inputs that are known with some error only: a standard deviation, whose share in the parameters' errors is reported,
    or a range, in which the input is fitted together with the parameters."""

    friction: Spread | None = Field(default=None, description="standard deviation, or range, of the friction coefficient")
    bulk_ratio: Spread | None = Field(default=None, description="standard deviation, or range, of bulk over shear modulus")
    thickness: SpreadOfLength | None = Field(default=None, description="standard deviation, or range, of the thickness, mm")
    offset: SpreadOfLength | None = Field(
        default=None, description="standard deviation, or range, of the contact point, mm: F(d - offset)"
    )

    base: Annotated[Annotated[float, Field(gt=0, lt=1)] | None, BeforeValidator(_odds)] = Field(
        default=None, description="probability that the base is the other of sliding and bonded; true for even odds"
    )
    mesh: Annotated[float, Field(ge=0, le=100, allow_inf_nan=False)] = Field(
        default=1.0, description="standard deviation of the forces by the mesh, in units of Richardson's estimate from half of it"
    )
    force: Annotated[float, Field(gt=0, lt=1, allow_inf_nan=False)] | None = Field(
        default=None, description="standard deviation of each test's forces as a whole: calibration"
    )

    @property
    def given(self):
        """name -> standard deviation (of the base: probability) of the inputs that have one."""
        return {name: value for name, value in self if isinstance(value, float) and value}

    @property
    def fitted(self):
        """name -> Range of the inputs that are fitted."""
        return {name: value for name, value in self if isinstance(value, Range)}

    def faults(self):
        for name, low in LEAST_INPUT.items():
            value = getattr(self, name)
            if isinstance(value, Range) and value.min < low:
                yield name, f"its min must be at least {low:g}; raise it"


class Fit(Section):
    """How the parameters are searched for."""

    method: Literal["ga", "least_squares", "differential_evolution", "cma"] = Field(
        default="ga", description="method of the search"
    )
    direct: bool = Field(default=False, description="search on the forward model itself, without a surrogate")
    seed: int = Field(default=0, ge=0, lt=2**32, description="seed of the random numbers")
    population: int | None = Field(default=None, ge=4, le=10_000, description="individuals of a generation")
    generations: int | None = Field(default=None, ge=1, le=10_000, description="generations at most")
    starts: int | None = Field(default=None, ge=1, le=1000, description="local searches of least_squares, at different starts")
    workers: int | None = Field(default=None, ge=1, le=1024, description="processes; by default one for each core")
    time_limit: Annotated[float, Field(gt=0, allow_inf_nan=False)] = Field(
        default=600.0, description="seconds that one solve of one test may take before it counts as failed"
    )
    tolerance: Annotated[float, Field(gt=0, lt=1, allow_inf_nan=False)] = Field(
        default=1e-6, description="relative change of the objective below which the search ends"
    )
    profiles: bool = Field(default=True, description="profile likelihoods, where the search had a surrogate")
    published: dict[str, Finite] = Field(default_factory=dict, description="published parameters to compare with")
    uncertain: Uncertain = Field(default=Uncertain(), description="inputs known with some error, or fitted")


class Solver(Section):
    """How the mechanics are solved; the defaults suit every case known so far."""

    assembly: Literal["compiled", "forms"] = Field(default="compiled", description="element loop, or the readable forms")
    linear: Literal["auto", "pardiso", "superlu", "pyamg"] = Field(default="auto", description="linear solver")
    element: Literal["q1p0", "q2p1"] = Field(default="q2p1", description="finite element")
    tolerance: Annotated[float, Field(gt=0, le=0.01, allow_inf_nan=False)] = Field(
        default=1e-6, description="relative residual at equilibrium"
    )
    penalty: Annotated[float, Field(gt=0, allow_inf_nan=False)] = Field(default=1.0, description="factor on the contact stiffness")
    max_step: Length | None = Field(default=None, description="largest step of the indenter, mm")


class Case(BaseModel):
    """A whole case. `tests[i]` was measured as `curves[i]` (None where only a depth is given)."""

    model_config = ConfigDict(frozen=True, extra="forbid", validate_by_name=True, validate_by_alias=True)

    title: Annotated[str, Field(max_length=200)] = ""
    sample: Sample
    indenter: Indenter
    mesh: Mesh = Mesh()
    material: MaterialCase
    tests: tuple[Test, ...] = Field(alias="test", min_length=1)
    fit: Fit = Fit()
    solver: Solver = Solver()
    record: Record = Record()
    path: Path = Field(default=Path("case.toml"), description="where the case was read; not a key of the file")
    overrides: tuple[str, ...] = Field(default=(), description="KEY=VALUE that replaced keys of the file")
    curves: tuple[InstanceOf[Curve] | None, ...] = ()

    @field_validator("tests")
    @classmethod
    def _share_the_weight(cls, tests):
        share = 1 / len(tests)
        return tuple(test if test.weight is not None else test.model_copy(update={"weight": share}) for test in tests)

    @model_validator(mode="before")
    @classmethod
    def _no_curves(cls, keys):
        if isinstance(keys, dict) and not keys.get("curves"):
            tests = keys.get("tests") or keys.get("test") or ()
            return {**keys, "curves": (None,) * len(tests)}
        return keys

    @model_validator(mode="after")
    def _agree(self):
        parts = dict(self)
        faults = [*_faults_across(parts), *_faults_of_parameters(self.material, self._material_of_faults())]
        for n, (test, curve) in enumerate(zip(self.tests, self.curves, strict=True)):
            if (test.curve is None and test.record is None) != (curve is None):
                faults.append((("test", str(n), "curve"), test.curve, "not read; use read_case, or give `curves`"))
        _raise_faults(type(self), [(".".join(key), value, text) for key, value, text in faults])
        return self

    def _material_of_faults(self):
        try:
            return self.material_class
        except MaterialError as error:
            raise _refusal(str(error)) from error

    @property
    def material_class(self) -> type[Material]:
        """The class of the material; raises MaterialError where it cannot be loaded."""
        return _material_class(self.material, self.path.parent)

    @property
    def free(self) -> dict[str, Range]:
        """The parameters to be fitted, in the order of the model."""
        values = {name: self.material.parameters[name] for name in self.material_class.parameters}
        return {name: value for name, value in values.items() if isinstance(value, Range)}

    @property
    def fitted(self) -> dict[str, Range]:
        """What a fit searches for: the free parameters, then the uncertain inputs that are to be fitted."""
        return {**self.free, **self.fit.uncertain.fitted}

    def start_values(self) -> dict[str, float]:
        """Every parameter in the order of the model: the fixed number, or where its search starts."""
        return _start_values(self.material, self.material_class)

    def outputs(self, test: Test) -> np.ndarray:
        """Displacements at which the force of `test` is asked for, mm, shape (n,)."""
        curve = self.curves[self.tests.index(test)]
        if curve is not None:
            return curve.displacement
        assert test.depth is not None  # a test without a curve has a depth
        return test.depth * np.arange(1, test.points + 1) / test.points

    @property
    def hash(self) -> str:
        """SHA-256 of everything that a result depends on; not of titles, comments, paths and the number of workers."""
        facts = self.model_dump(
            mode="json",
            exclude={"title": True, "path": True, "overrides": True, "curves": True, "record": True, "fit": {"workers"}},
        )
        for test, curve in zip(facts["tests"], self.curves, strict=True):
            del test["record"]  # what counts is the curve that it was turned into
            test["curve"] = curve and [curve.displacement.tolist(), curve.force.tolist()]
        if plugin := _plugin(self.material.model, self.path.parent):  # what the file says, not where it lies
            code = hashlib.sha256(plugin.read_bytes()).hexdigest()
            facts["material"]["model"] = facts["material"]["model"].rpartition(":")[2] + " " + code
        return hashlib.sha256(json.dumps(facts, sort_keys=True, separators=(",", ":")).encode()).hexdigest()

    def warnings(self) -> list[str]:
        """What is allowed but deserves a second look, one line each."""
        return list(_warnings(self))


def read_case(path, overrides: Sequence[str] = ()) -> Case:
    """The `Case` of a TOML file, its curves read, with `overrides` ("KEY=VALUE") in place of its keys.

    Raises CaseError, which holds one line for each fault: file, key, value, what is wrong and what to do.
    """
    path = Path(path)
    tree = _tree(path)
    asked, problems = _override(tree, overrides)
    parts = _parts(tree, path, problems)
    problems += _faults_across(parts)
    if problems:
        labels = dict(enumerate(_labels(_tests(tree))))
        asked = {tuple(labels.get(step, step) if n == 1 else step for n, step in enumerate(key)) for key in asked}
        lines = [_line(path, problem, asked) for problem in problems]
        raise CaseError(list(dict.fromkeys(lines)))
    return Case(**parts, path=path, overrides=tuple(overrides))


def read_record_table(path, overrides: Sequence[str] = ()) -> Record:
    """The [record] table of a TOML file, a case or one that holds just that; `path` None: of the overrides alone.

    Raises CaseError, which holds one line for each fault.
    """
    tree = _tree(Path(path)) if path is not None else {}
    tree = {"record": tree.get("record", {})}
    asked, problems = _override(tree, overrides)
    problems += [Problem((key,), tree[key], "only keys of [record] can be set here") for key in tree if key != "record"]
    table = _section(Record, ("record",), tree["record"], problems)
    if problems:
        raise CaseError([_line(path or "options", problem, asked) for problem in problems])
    return table


def require_fittable(case):
    """Raise CaseError unless the case has a free parameter and each test a curve, with some weight among them."""
    problems = []
    if not case.free:
        text = "no parameter is free; give at least one as {start = ..., min = ..., max = ...}"
        problems.append(Problem(("material", "parameters"), UNSAID, text))
    for test, curve in zip(case.tests, case.curves, strict=True):
        if curve is None:
            problems.append(Problem(("test", test.name, "curve"), UNSAID, "missing; a fit needs a measured curve"))
    if not sum(test.weight for test in case.tests):
        problems.append(Problem(("test",), UNSAID, "every weight is 0; give at least one test a weight"))
    if problems:
        raise CaseError([_line(case.path, problem, ()) for problem in problems])


class Problem(NamedTuple):
    """One fault of a case file: the key's path, its value, what is wrong and what to do."""

    key: tuple
    value: object
    text: str


UNSAID = object()  # the value of a key that is not there
SECTIONS: dict[str, type[Section]] = {
    "sample": Sample,
    "indenter": Indenter,
    "mesh": Mesh,
    "material": MaterialCase,
    "fit": Fit,
    "solver": Solver,
    "record": Record,
}
KEYS = ("title", *SECTIONS, "test")
CHANNELS = ("displacement", "force", "time")
RIVALS: dict[str, dict[str, set[str]]] = {  # setting a key takes these of the same table out of the file
    "mesh": {"size": {"elements"}, "elements": {"size"}},
    "material": {
        "model": {"energy"},
        "energy": {"model"},
        "kappa": {"bulk_ratio"},
        "bulk_ratio": {"kappa"},
    },
    "test": {"curve": {"depth", "points", "record"}, "record": {"depth", "points", "curve"}, "depth": {"curve", "record"}},
}


# Reading the file


def _tree(path):
    """The tables of a TOML file, or CaseError with the line that is not TOML."""
    text = _text(path)
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise CaseError(f"{path}: nested too deep; a case file has tables and numbers only") from None
    except ValueError as error:
        number, line = _place(str(error), text)
        reason = str(error).split(" (at ")[0]
        twice = re.match(r"Cannot (overwrite|declare|mutate)|Duplicate", reason)
        wrong = f"not TOML ({_short(reason)}); correct it"
        if twice:
            wrong = "this key or table is given twice; keep one of them"
        raise CaseError(_printable(f"{path}: line {number}: {line}: {wrong}")) from None


def _text(path):
    try:
        if path.is_dir():
            inside = path / "case.toml"
            raise CaseError(f"{path}: a folder; name the case file in it" + (f", {inside}" if inside.exists() else ""))
        if not path.exists():
            raise CaseError(f"{path}: no such file; `indentfit init DIR` writes a case to start from")
        if not path.is_file():
            raise CaseError(f"{path}: not a file; name a case file")
        return path.read_bytes().decode("utf-8-sig").replace("\r\n", "\n")
    except UnicodeDecodeError as error:
        line = error.object[: error.start].count(b"\n") + 1
        raise CaseError(f"{path}: line {line}: not UTF-8 text; save the file as UTF-8") from None
    except (OSError, ValueError) as error:
        raise CaseError(f"{path}: cannot be read ({getattr(error, 'strerror', None) or error})") from None


def _place(message, text):
    lines = text.split("\n")
    found = re.search(r"at line (\d+)", message)
    number = int(found[1]) if found else max(n for n, line in enumerate(lines, 1) if line.strip() or n == 1)
    return number, _short(lines[number - 1].strip())


# Overrides


def _override(tree, overrides):
    """Put each KEY=VALUE into the tree. Returns the keys' paths that were set, and problems."""
    asked, problems = set(), []
    for text in overrides:
        name, equals, value = text.partition("=")
        if not equals or not name.strip():
            problems.append(Problem(("--set",), text, "write KEY=VALUE, such as indenter.friction=0.2"))
            continue
        try:
            key = _path_of_key(tree, name.strip())
            _put(tree, key, _value(value.strip()))
        except LookupError as error:
            problems.append(Problem((name.strip(),), _value(value.strip()), error.args[0]))
        else:
            asked.add(key)
    for key in asked:
        _drop_rivals(tree, key, asked)
    return asked, problems


def _value(text):
    """A TOML value, or else the text itself."""
    try:
        found = tomllib.loads(f"value = {text}")
    except (ValueError, RecursionError):
        return text
    return found["value"] if set(found) == {"value"} else text


def _path_of_key(tree, name):
    """Steps through the tree: names of tables, and the number of a test."""
    section, _, rest = name.partition(".")
    if section == "test" and rest:
        tests = [test for test in _tests(tree) if isinstance(test, dict)]
        for number, test in enumerate(tests):
            for label in (test.get("name"), str(number)):
                if isinstance(label, str) and rest.startswith(label + "."):
                    return "test", number, *rest[len(label) + 1 :].split(".")
        known = [str(test.get("name", number)) for number, test in enumerate(tests)]
        raise LookupError(f"no such test; write test.NAME.KEY{_nearest(rest.split('.')[0], known)}")
    steps = tuple(name.split("."))
    if section == "material" and len(steps) > 1 and steps[1] not in MaterialCase.model_fields:
        parameters = _table(tree, "material").get("parameters")
        if isinstance(parameters, dict) and steps[1] in parameters:
            return "material", "parameters", *steps[1:]
    return steps


def _put(tree, key, value):
    *tables, last = key
    for n, step in enumerate(tables):
        if isinstance(tree, list) and not isinstance(step, int):
            raise LookupError(f"{'.'.join(map(str, tables[:n]))} is a list, not a table; check the key")
        inner = tree[step] if isinstance(tree, list) else tree.setdefault(step, {})
        if isinstance(inner, int | float) and tables[:2] == ["material", "parameters"]:
            raise LookupError(f"{step} is a fixed number; set {'.'.join(tables)}={{start=..., min=..., max=...}}")
        if not isinstance(inner, dict | list):
            raise LookupError(f"{'.'.join(map(str, tables[: n + 1]))} is not a table; check the key")
        tree = inner
    if not isinstance(tree, dict):
        raise LookupError("write test.NAME.KEY=VALUE")
    tree[last] = value


def _drop_rivals(tree, key, asked):
    """Take away the key of the file that an override replaces: size by elements, a disc's diameter by a block."""
    *tables, last = key
    try:
        table = functools.reduce(lambda inner, step: inner[step], tables, tree)
    except (LookupError, TypeError):
        return  # another override has replaced the whole table
    if not isinstance(table, dict) or last not in table:
        return
    section = tables[0] if tables else ""
    rivals = RIVALS.get(section, {}).get(last, set())
    needed = {"sample": SHAPES_OF_SAMPLE, "indenter": SHAPES_OF_INDENTER}.get(section)
    if needed and last == "shape" and isinstance(table[last], str) and table[last] in needed:
        rivals = set().union(*needed.values()) - needed[table[last]]
        rivals |= {"edge_radius"} if table[last] == "sphere" else set()
    for rival in rivals:
        if (*tables, rival) not in asked:
            table.pop(rival, None)


def _tests(tree):
    tests = tree.get("test")
    return tests if isinstance(tests, list) else []


def _table(tree, name):
    table = tree.get(name)
    return table if isinstance(table, dict) else {}


# From tables to values


def _parts(tree, path, problems):
    """The fields of a Case, as far as they are right; appends to `problems` what is not."""
    for key in tree:
        if key not in KEYS:
            problems.append(Problem((key,), tree[key], _unknown(key, KEYS)))
    parts: dict[str, Any] = {"title": _title(tree, problems)}
    kind, found = _material_of(_table(tree, "material"), path.parent)
    problems += found
    problems += _parameters_in_plain_numbers(tree, kind)
    for name, model in SECTIONS.items():
        keys = tree.get(name, UNSAID if name in ("sample", "indenter", "material") else {})
        parts[name] = _section(model, (name,), keys, problems)
    if kind:
        wrong = list(_faults_of_parameters(parts["material"], kind))
        if not wrong and not any(problem.key[0] == "material" for problem in problems):
            wrong = list(_faults_of_substance(parts["material"], kind))
        problems += wrong
    record = parts["record"]
    if record and record.indenter is None and parts["indenter"] and parts["indenter"].shape == "sphere":
        record = parts["record"] = record.model_copy(update={"indenter": "sphere"})
    parts["tests"], parts["curves"] = _tests_and_curves(tree, path.parent, record, problems)
    return parts


def _title(tree, problems):
    title = tree.get("title", "")
    if not isinstance(title, str) or len(title) > 200 or (title and not title.isprintable()):
        problems.append(Problem(("title",), title, "must be text on one line of at most 200 characters"))
    return title


def _section(model, place, keys, problems):
    """One table as its model; where it has faults, what of it is right, the rest None."""
    if keys is UNSAID:
        problems.append(Problem(place, UNSAID, f"missing; add a table [{place[0]}]"))
        return None
    if not isinstance(keys, dict):
        problems.append(Problem(place, keys, f"must be a table; write [{place[0]}]"))
        return None
    try:
        return model.model_validate(keys)
    except ValidationError as error:
        wrong = error.errors(include_url=False)
    known = {problem.key for problem in problems}
    for found in wrong:
        inner = found["loc"]
        where = Range if inner[:1] == ("parameters",) and len(inner) == 3 else model
        where = RecordChannel if model is Record and len(inner) > 1 and inner[0] in CHANNELS else where
        value = found["input"] if inner[-1] in _inmost(keys, inner) else UNSAID
        if (*place, *inner) not in known:
            problems.append(Problem((*place, *inner), value, _words(where, found)))
    part = _what_is_right(model, keys, {found["loc"][0] for found in wrong})
    if not any(found["type"] == "disagreement" and len(found["loc"]) == 1 for found in wrong):
        problems += [Problem((*place, key), keys.get(key, UNSAID), text) for key, text in part.faults()]
    return part


def _inmost(keys, steps):
    for step in steps[:-1]:
        keys = keys.get(step, {}) if isinstance(keys, dict) else {}
    return keys if isinstance(keys, dict) else {}


def _what_is_right(model, keys, wrong):
    """The keys that are right alone, in a model that was not checked as a whole."""
    values = dict.fromkeys(model.model_fields)
    for key, field in model.model_fields.items():
        if key in wrong:
            continue
        if key in keys:
            kind: Any = Annotated[(field.annotation, key, *field.metadata)]  # the key only fills an empty list
            values[key] = TypeAdapter(kind).validate_python(keys[key])
        elif not field.is_required():
            values[key] = field.get_default(call_default_factory=True)
    return model.model_construct(_fields_set=set(keys), **values)


def _tests_and_curves(tree, folder, record, problems):
    tables = tree.get("test", UNSAID)
    if tables is UNSAID or tables == []:
        problems.append(Problem(("test",), UNSAID, "missing; add a table [[test]] for each indentation"))
        return (), ()
    if not isinstance(tables, list):
        problems.append(Problem(("test",), tables, "must be a list of tables; write [[test]] in double brackets"))
        return (), ()
    tests, curves = [], []
    for label, keys in zip(_labels(tables), tables, strict=True):
        test = _section(Test, ("test", label), keys, problems)
        tests.append(test)
        if test and test.record and record and not any(problem.key[0] == "record" for problem in problems):
            curves.append(_curve_of_record(("test", label, "record"), test.record, folder, record, problems))
        else:
            curves.append(_curve(("test", label, "curve"), test and test.curve, folder, problems))
    return tuple(tests), tuple(curves)


def _labels(tables):
    """What each test is called in messages: its name, or its number where it has no name of its own."""
    names = [keys.get("name") if isinstance(keys, dict) else None for keys in tables]
    return [name if isinstance(name, str) and name and names.count(name) == 1 else str(n) for n, name in enumerate(names)]


def _curve(key, name, folder, problems):
    if not name:
        return None
    try:
        return read_curve(folder / name)
    except CurveError as error:
        problems.append(Problem(key, name, str(error)))
        return None


def _curve_of_record(key, name, folder, record, problems):
    from .experiment.process import process  # scipy's signals are slow to import, and few cases need them
    from .experiment.reading import read_record

    try:
        return process(read_record(folder / name, record.layout), options=record.options).curve
    except RecordError as error:
        problems.append(Problem(key, name, str(error)))
        return None


# Materials


def _material_of(keys, folder):
    """The class that a [material] table asks for, or None; and problems."""
    model, energy, parameters = keys.get("model"), keys.get("energy"), keys.get("parameters")
    if (model is None) == (energy is None):
        return None, []
    key, given = ("model", model) if energy is None else ("energy", energy)
    if not isinstance(given, str) or not given.strip() or not given.isprintable():
        return None, []
    try:
        return _load(model, energy, tuple(parameters) if isinstance(parameters, dict) else (), folder), []
    except (MaterialError, OSError) as error:
        return None, [Problem(("material", key), given, str(error))]


def _material_class(part, folder):
    return _load(part.model, part.energy, tuple(part.parameters), folder)


def _load(model, energy, names, folder):
    if energy is not None:
        return typed(energy, names)
    if plugin := _plugin(model, folder):
        return load(f"{plugin}:{model.rpartition(':')[2]}")
    return _installed(model)


@functools.cache
def _installed(name):
    return load(name)


def _plugin(model, folder):
    """The file of a model given as file.py:Class, relative to the case; None for an installed model."""
    file, colon, _ = (model or "").rpartition(":")
    return (folder / file).resolve() if colon and file.endswith(".py") else None


def _parameters_in_plain_numbers(tree, kind):
    """Turn strings with a unit among the parameters into numbers in the model's unit; returns problems."""
    parameters = _table(tree, "material").get("parameters")
    if not isinstance(parameters, dict):
        return []
    problems = []
    for name, given in parameters.items():
        unit = kind.parameters[name].unit or "kPa" if kind and name in kind.parameters else None
        table, keys = (given, tuple(given)) if isinstance(given, dict) else (parameters, (name,))
        for key in keys:
            if not isinstance(table[key], str):
                continue
            try:
                table[key] = _number_in(unit, table[key])
            except ValueError as error:
                place = ("material", "parameters", name) + ((key,) if table is given else ())
                problems.append(Problem(place, table[key], str(error)))
                table[key] = UNSAID
    return problems


def _faults_of_parameters(part, kind):
    """Problems where the parameters are not those of the model, or outside its own bounds."""
    given = getattr(part, "parameters", None)
    if given is None or kind is None:
        return
    place = ("material", "parameters")
    for name in given:
        if name not in kind.parameters:
            yield Problem((*place, name), _plain(given[name]), _unknown(name, kind.parameters, "parameter"))
    for name, parameter in kind.parameters.items():
        if name not in given:
            unit = f", {parameter.unit}" if parameter.unit not in ("", "1") else ""
            text = f"missing; give a number, or {{start, min, max}}: {parameter.meaning}{unit}"
            yield Problem((*place, name), UNSAID, text)
            continue
        value = given[name]
        numbers = {(): value} if isinstance(value, float) else {("min",): value.min, ("max",): value.max}
        for key, number in numbers.items():
            if parameter.min is not None and number < parameter.min:
                yield Problem((*place, name, *key), number, f"the model needs at least {parameter.min:g}; raise it")
            if parameter.max is not None and number > parameter.max:
                yield Problem((*place, name, *key), number, f"the model needs at most {parameter.max:g}; lower it")


def _faults_of_substance(part, kind):
    """A problem where the material has no positive stiffness at the start values."""
    try:
        with np.errstate(all="ignore"), blamed(kind):
            moduli = kind(**_start_values(part, kind)).moduli()
        wrong = "" if all(map(math.isfinite, moduli.values())) else "the material has no finite stiffness"
    except ArithmeticError:
        wrong = "the material has no finite stiffness"
    except MaterialError as error:
        wrong = str(error)
    if wrong:
        yield Problem(("material", "parameters"), UNSAID, f"{wrong}; change the start values")


def _start_values(part, kind):
    values = part.parameters
    return {name: values[name].start if isinstance(values[name], Range) else values[name] for name in kind.parameters}


def _plain(value):
    return value.model_dump() if isinstance(value, Range) else value


# Faults across tables


def _faults_across(parts):
    """Problems between tables that are right alone; a table or key that is not right is None."""
    sample, indenter, tests, curves = (parts[name] for name in ("sample", "indenter", "tests", "curves"))
    yield from _equal_names(tests)
    if sample is None:
        return
    depths = [_depth(test, curve) for test, curve in zip(tests, curves, strict=True)]
    if _known(sample.thickness):
        for label, depth, test in zip(_labels([dict(test or {}) for test in tests]), depths, tests, strict=True):
            if depth is not None and depth >= DEEPEST_INDENTATION * sample.thickness:
                key = "depth" if test.depth is not None else "curve"
                text = f"goes {depth:g} mm deep; it must stay below half of the thickness, {sample.thickness:g} mm"
                if depth >= sample.thickness:
                    text = f"goes {depth:g} mm deep, through the sample of {sample.thickness:g} mm: "
                    text += "its unit or sample.thickness is wrong"
                yield Problem(("test", label, key), getattr(test, key), text)
        size = parts["mesh"] and parts["mesh"].size
        if size is not None and size > sample.thickness:
            yield Problem(("mesh", "size"), size, f"exceeds the thickness of {sample.thickness:g} mm; make it smaller")
    yield from _faults_of_uncertain(parts)
    if indenter is not None and all(_known(size) for size in sample.extent):
        yield from _indenter_too_wide(sample, indenter, max((depth for depth in depths if depth), default=0.0))


def _faults_of_uncertain(parts):
    """Problems where an uncertain input is none of this case."""
    uncertain = parts["fit"] and parts["fit"].uncertain
    if uncertain is None:
        return
    indenter, material = parts["indenter"], parts["material"]
    if uncertain.friction is not None and indenter is not None and indenter.friction == "stick":
        text = "the indenter sticks; give indenter.friction a number"
        yield Problem(("fit", "uncertain", "friction"), _plain(uncertain.friction), text)
    if uncertain.bulk_ratio is not None and material is not None and material.kappa is not None:
        text = "material.kappa is given; give material.bulk_ratio instead"
        yield Problem(("fit", "uncertain", "bulk_ratio"), _plain(uncertain.bulk_ratio), text)


def _equal_names(tests):
    names = [test and test.name for test in tests]
    for n, name in enumerate(names):
        if name is not None and name in names[:n]:
            yield Problem(("test", str(n), "name"), name, "another test has this name; give each its own")


def _depth(test, curve):
    return curve.displacement[-1] if curve is not None else test and test.depth


def _indenter_too_wide(sample, indenter, depth):
    x, z = sample.extent
    room = WIDEST_INDENTER * (z if indenter.shape == "strip" else min(x, z))
    key = "width" if indenter.shape == "strip" else "diameter"
    width = getattr(indenter, key)
    if width is None or indenter.shape is None:
        return
    if indenter.shape == "sphere":
        if depth >= width / 2:
            yield Problem(("indenter", key), width, f"the sphere sinks in by half at {depth:g} mm; check the units")
            return
        width = 2 * math.sqrt(max(depth * (width - depth), 0.0))
    if width >= room:
        text = f"too wide for the sample of {room / WIDEST_INDENTER:g} mm; it must stay below {room:g} mm"
        yield Problem(("indenter", key), getattr(indenter, key), text)


def _known(*values):
    return all(value is not None for value in values)


# Warnings


def _warnings(case):
    yield from _warnings_of_instability(case)
    substance = case.material_class(**case.start_values())
    stiffest = max(substance.moduli().values())
    kappa = case.material.bulk_modulus(substance.shear_modulus)
    if kappa < 10 * stiffest:
        yield (
            f"kappa = {kappa:g} kPa is below 10 x the largest small-strain modulus ({stiffest:g} kPa) at the start "
            "values: the tissue is not nearly incompressible; raise material.bulk_ratio unless that is meant"
        )
    for test, curve in zip(case.tests, case.curves, strict=True):
        depth = _depth(test, curve)
        if depth > 0.2 * case.sample.thickness:
            share = depth / case.sample.thickness
            yield f"test.{test.name} goes to {share:.0%} of the thickness; beyond 20 % equilibrium may not be found"
    if len(case.free) > 1 and len({test.angle for test in case.tests}) == 1:
        yield f"every test has angle {case.tests[0].angle}: one direction alone cannot tell the fibre terms apart"


def _warnings_of_instability(case):
    """A warning where the small-strain moduli are not positive, at the start values or at a corner of the bounds."""
    free = list(case.free.items())[:MOST_CORNERS]
    corners = itertools.product(*((one.start, one.min, one.max) for _, one in free))
    for values in itertools.islice(corners, 3**MOST_CORNERS):
        at = case.start_values() | dict(zip((name for name, _ in free), values, strict=True))
        with contextlib.suppress(MaterialError), np.errstate(all="ignore"):
            if wrong := case.material_class(**at).unstable:
                where = ", ".join(f"{name} = {value:g}" for name, value in at.items())
                yield f"material.parameters: not stable at small strain at {where} ({wrong}); change the values or the bounds"
                return


# Messages


def _line(path, problem, asked):
    """file: key = value: what is wrong; what to do."""
    key = ".".join(_short(str(step)) for step in problem.key)
    value = "" if problem.value is UNSAID else f" = {_shown(problem.value)}"
    source = f"{path} (--set)" if any(_same(problem.key, one) for one in asked) else str(path)
    return _printable(f"{source}: {key}{value}: {problem.text}")


def _same(key, asked):
    return tuple(map(str, key))[: len(asked)] == tuple(map(str, asked))


def _shown(value):
    """A value much as TOML writes it, on one line and short."""
    try:
        return _short(json.dumps(value, ensure_ascii=False))
    except (TypeError, ValueError, RecursionError):
        return _short(str(value))


def _short(text):
    return text if len(text) <= 60 else text[:57] + "..."


def _printable(text):
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def _words(model, found):
    """What is wrong and what to do, for one of pydantic's errors."""
    kind, context = found["type"], found.get("ctx", {})
    key = found["loc"][-1]
    field = model.model_fields.get(key)
    wanted = f"give the {field.description}" if field and field.description else "correct it"
    if kind in ("fault", "disagreement"):
        return context["text"]
    if isinstance(found["input"], float) and math.isnan(found["input"]):
        kind = "finite_number"  # not greater and not less than anything: say what it is
    if kind == "extra_forbidden":
        return _unknown(key, model.model_fields)
    if kind == "literal_error":
        choices = re.findall(r"'(.*?)'", context["expected"])
        return f"must be {context['expected']}{_nearest(found['input'], choices)}"
    words = {
        "missing": f"missing; {wanted}",
        "greater_than": f"must be above {context.get('gt')}; {wanted}",
        "greater_than_equal": f"must be at least {context.get('ge')}; {wanted}",
        "less_than": f"must be below {context.get('lt')}; {wanted}",
        "less_than_equal": f"must be at most {context.get('le')}; {wanted}",
        "finite_number": f"must be a finite number; {wanted}",
        "float_type": f"must be a number; {wanted}",
        "int_type": f"must be a whole number; {wanted}",
        "int_from_float": f"must be a whole number; {wanted}",
        "string_type": f"must be text in quotes; {wanted}",
        "string_too_long": f"must have at most {context.get('max_length')} characters; {wanted}",
        "dict_type": f"must be a table; {wanted}",
    }
    return words.get(kind, f"{found['msg'][:1].lower()}{found['msg'][1:]}; {wanted}")


def _unknown(key, known, what="key"):
    if near := _nearest(key, known):
        return f"unknown {what}{near}"
    homes = [name for name, model in SECTIONS.items() if what == "key" and key in model.model_fields]
    if homes:
        return f"unknown {what} here; it belongs to [{homes[0]}]"
    return f"unknown {what}; known here: {', '.join(known)}"


def _nearest(word, known):
    near = difflib.get_close_matches(str(word), [str(name) for name in known], n=1)
    return f"; did you mean {near[0]}?" if near else ""
