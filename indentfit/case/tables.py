"""The tables of a case file as frozen values: sample, indenter, mesh, material, tests and solver, in mm, mN and kPa.

The unit, default, choices and meaning of each key are written here, in `search` and in `recording`, and nowhere else: the template
that `init` writes, the reference page and the JSON schema are generated from these fields.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, Literal

from pydantic import Field, PlainValidator, WithJsonSchema, WrapValidator, model_validator

from indentfit import indenters, samples
from indentfit.case.quantities import (
    Angle,
    Finite,
    Friction,
    Length,
    Line,
    NotNegative,
    Positive,
    Pressure,
    Radius,
    Shape,
    is_number,
    refusal,
)
from indentfit.case.section import Section, known
from indentfit.curve import Curve

DEFAULT_BULK_RATIO = 1000.0
SIZE = (  # the factors are those of fem.mesh.FAMILIES
    "size that all element widths are proportional to; far from the indenter eight-node bricks (solver.element q1p0) are up to 1 "
    "size wide and quadratic bricks (q2p1) up to 3 sizes; at the indenter's edge 0.15 and 0.126 sizes, or less under a narrow one"
)


class Sample(Section):
    """The piece of tissue; y is the axis of indentation, x and z lie in its plane."""

    place = "sample"

    shape: Annotated[str, Shape(samples.SHAPES)] = Field(description="shape of the sample")
    diameter: Length | None = Field(default=None, examples=[14.0], description="diameter of the disc")
    length: Length | None = Field(default=None, examples=[14.0], description="size of the block along x")
    width: Length | None = Field(default=None, examples=[14.0], description="size of the block along z")
    thickness: Length = Field(description="thickness of the sample along y, the axis of indentation")
    base: Literal["sliding", "bonded"] = Field(
        description="support of the sample: the sample slides on it, or is bonded to it; the force can differ by half"
    )

    @property
    def geometry(self) -> samples.SampleShape:
        """The shape with its sizes."""
        shape = self.geometry_if_right()
        assert shape is not None  # `disagreements` has seen to that
        return shape

    def geometry_if_right(self) -> samples.SampleShape | None:
        """The shape with its sizes, None where a key of it is not right."""
        return samples.SHAPES.make(dict(self))

    def disagreements(self) -> Iterator[tuple[str, str]]:
        yield from self.of_shape(samples.SHAPES)


class Indenter(Section):
    """The rigid indenter, centred on the sample; a strip's long side lies along x."""

    place = "indenter"

    shape: Annotated[str, Shape(indenters.SHAPES)] = Field(description="shape of the indenter")
    width: Length | None = Field(default=None, examples=[2.0], description="size of the strip along z")
    length: Length | None = Field(
        default=None, examples=[20.0], description="size of the strip along x; it may overhang the sample"
    )
    diameter: Length | None = Field(default=None, examples=[2.0], description="diameter of the flat cylinder or of the sphere")
    edge_radius: Radius = Field(default=0.0, description="radius of the edge; 0 is sharp")
    friction: Friction = Field(description='friction coefficient, or "stick" for no slip at all')

    @property
    def geometry(self) -> indenters.IndenterShape:
        """The shape with its sizes."""
        shape = self.geometry_if_right()
        assert shape is not None  # `disagreements` has seen to that
        return shape

    def geometry_if_right(self) -> indenters.IndenterShape | None:
        """The shape with its sizes, None where a key of it is not right."""
        return indenters.SHAPES.make(dict(self))

    def disagreements(self) -> Iterator[tuple[str, str]]:
        yield from self.of_shape(indenters.SHAPES)
        if shape := self.geometry_if_right():
            yield from shape.faults()


class Mesh(Section):
    """The mesh of the quarter sample; without either key, the default mesh."""

    place = "mesh"

    size: Length | None = Field(default=None, examples=[0.4], description=SIZE)
    elements: int | None = Field(
        default=None,
        ge=20,
        le=2_000_000,
        examples=[3000],
        description="approximate number of elements; without size and elements, the default mesh is made",
    )

    symmetry: Literal["auto", "axisymmetric", "quarter"] = Field(
        default="auto",
        description="solve in the meridian plane (round sample, round indenter, no fibres) or a quarter of the sample; auto: the "
        "meridian plane where that is possible",
    )

    @property
    def default(self) -> bool:
        """Whether the case asks for no particular mesh."""
        return self.size is None and self.elements is None

    def disagreements(self) -> Iterator[tuple[str, str]]:
        if {"size", "elements"} <= self.model_fields_set:
            yield "elements", "mesh.size is given too; keep one of them"


class Range(Section):
    """A free parameter of the material: where a search starts, and its bounds, in the parameter's unit."""

    start: Finite = Field(description="value to start from")
    min: Finite = Field(description="lower bound")
    max: Finite = Field(description="upper bound")

    def disagreements(self) -> Iterator[tuple[str, str]]:
        if known(self.min, self.max) and self.min >= self.max:
            yield "min", f"must be below max = {self.max:g}; for a fixed parameter give just the number"
        elif known(self.start, self.min) and self.start < self.min:
            yield "start", f"is below min = {self.min:g}; start between the bounds"
        elif known(self.start, self.max) and self.start > self.max:
            yield "start", f"is above max = {self.max:g}; start between the bounds"


def _fixed_or_range(value: Any, _: Any) -> float | Range:
    if isinstance(value, Range):
        return value
    if isinstance(value, dict):
        return Range.model_validate(value)
    if not is_number(value):
        raise refusal("must be a finite number, or {start = ..., min = ..., max = ...} to be fitted")
    return float(value)


class MaterialChoice(Section):
    """The material: an installed model, `file.py:Class`, or a typed energy, with its parameters."""

    place = "material"

    model: Line | None = Field(
        default=None,
        examples=["transversely_isotropic"],
        description="name of an installed material (`indentfit materials` lists them), or file.py:Class, which runs that file",
    )
    energy: Line | None = Field(
        default=None,
        examples=["mu/2*(I1 - 3)"],
        description="energy instead of a model, a formula in I1, I2, I4, I5 and the parameters",
    )
    parameters: dict[str, Annotated[float | Range, WrapValidator(_fixed_or_range)]] = Field(
        default_factory=dict, description="parameters of the material, each a number, or {start, min, max} to be fitted"
    )
    bulk_ratio: Positive | None = Field(
        default=None,
        examples=[DEFAULT_BULK_RATIO],
        description="bulk modulus over shear modulus; without kappa it is 1000 by default",
    )
    kappa: Pressure | None = Field(default=None, examples=[1490.0], description="bulk modulus, instead of bulk_ratio")

    @model_validator(mode="before")
    @classmethod
    def _nearly_incompressible(cls, keys: Any) -> Any:
        if isinstance(keys, dict) and not {"bulk_ratio", "kappa"} & set(keys):
            return {**keys, "bulk_ratio": DEFAULT_BULK_RATIO}
        return keys

    def bulk_modulus(self, shear_modulus: float) -> float:
        """kappa in kPa, for a material of this shear modulus, kPa."""
        if self.kappa is not None:
            return self.kappa
        assert self.bulk_ratio is not None  # one of the two is always there
        return self.bulk_ratio * shear_modulus

    def disagreements(self) -> Iterator[tuple[str, str]]:
        given = self.model_fields_set
        if {"model", "energy"} <= given:
            yield "energy", "material.model is given too; keep one of them"
        if not {"model", "energy"} & given:
            yield "model", f"missing; give the {type(self).model_fields['model'].description}; or give material.energy"
        if {"bulk_ratio", "kappa"} <= given:
            yield "kappa", "material.bulk_ratio is given too; keep one of them"


def _file_or_curve(value: Any) -> str | Curve | None:
    if value is None or isinstance(value, Curve):
        return value
    if not isinstance(value, str):
        raise refusal(
            "must be text in quotes; give the CSV file of the measured curve, relative to the case file, or in Python a Curve"
        )
    if not value.strip() or not value.isprintable():
        raise refusal("must be printable text on one line")
    return value


class Test(Section):
    """One indentation: its direction, and a measured curve, a raw record, or only a depth to simulate."""

    __test__ = False  # not a test of pytest's

    place = "test"

    name: Annotated[Line, Field(max_length=60)] = Field(examples=["parallel"], description="name of the test")
    angle: Angle = Field(examples=[0], description="angle between the fibres and x, the indenter's long side")
    curve: Annotated[
        str | Curve | None, PlainValidator(_file_or_curve), WithJsonSchema({"anyOf": [{"type": "string"}, {"type": "null"}]})
    ] = Field(
        default=None,
        examples=["curves/parallel.csv"],
        description="CSV file of the measured curve, relative to the case file; its header is displacement_mm,force_mN",
    )
    record: Line | None = Field(
        default=None,
        examples=["records/parallel.csv"],
        description="raw record of the rig, instead of a curve, read as [record] says; relative to the case file",
    )
    depth: Length | None = Field(default=None, examples=[0.33], description="depth to simulate, instead of a curve")
    points: int = Field(default=25, ge=1, le=10_000, description="number of points to simulate, with a depth")
    weight: NotNegative | None = Field(
        default=None, examples=[0.5], description="weight in the objective; by default 1 / number of tests"
    )

    def __init__(self, name: str | None = None, /, **keys: Any) -> None:
        super().__init__(**({} if name is None else {"name": name}), **keys)

    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]  # see Section

    def disagreements(self) -> Iterator[tuple[str, str]]:
        given = self.model_fields_set
        sources = [key for key in ("curve", "record", "depth") if key in given]
        if len(sources) > 1:
            yield sources[-1], f"a {sources[0]} is given too; keep one of them"
        if not sources:
            yield "curve", "missing; give the file of the measured curve, or of its raw record (record), or depth (mm)"
        if {"curve", "record"} & given and "points" in given:
            yield "points", "belongs to a test with a depth; the points of a curve are those of its file"


class Solver(Section):
    """How the mechanics are solved; the defaults suit every case that was tested."""

    place = "solver"

    assembly: Literal["compiled", "forms"] = Field(
        default="compiled", description="element loop: compiled, or the readable and slow forms"
    )
    linear: Literal["auto", "pardiso", "superlu", "pyamg"] = Field(default="auto", description="linear solver")
    element: Literal["q1p0", "q2p1"] = Field(
        default="q2p1", description="finite element: eight-node bricks (q1p0) or quadratic ones (q2p1)"
    )
    tolerance: Annotated[float, Field(gt=0, le=0.01, allow_inf_nan=False)] = Field(
        default=1e-6, description="relative residual at equilibrium"
    )
    penalty: Positive = Field(default=1.0, description="factor on the contact stiffness")
    max_step: Length | None = Field(default=None, examples=[0.05], description="largest step of the indenter")
