"""The tables of a case file as frozen values: sample, indenter, mesh, material, tests and solver, in mm, mN and kPa.

The unit, default, choices and meaning of each key are written here, in `search` and in `recording`, and nowhere else: the template
that `init` writes, the reference page and the JSON schema are generated from these fields.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping
from copy import copy
from typing import Annotated, Any, ClassVar, Literal, TypeVar

import numpy as np
from pydantic import BeforeValidator, Field, PlainValidator, WithJsonSchema, create_model
from pydantic.fields import FieldInfo

from indentfit import indenters, samples
from indentfit.arrays import Array, Ints
from indentfit.case import specimen
from indentfit.case.fibre_file import FibreFile
from indentfit.case.materials import Layer as Layer
from indentfit.case.materials import MaterialChoice as MaterialChoice
from indentfit.case.materials import layers_disagree
from indentfit.case.measured_field import MeasuredField, one_or_many
from indentfit.case.quantities import (
    Angle,
    Dip,
    FamilyAngles,
    FamilyDips,
    Force,
    Friction,
    HalfAngle,
    Length,
    Line,
    NotNegative,
    Positive,
    Quantity,
    Radius,
    Shape,
    Turn,
    as_tuple,
    one_line,
    refusal,
)
from indentfit.case.ranges import Range as Range
from indentfit.case.relaxation import Seconds, Velocity
from indentfit.case.section import Section, either, known
from indentfit.case.solving import Solver as Solver
from indentfit.curve import Curve
from indentfit.material import Fibres, Kind
from indentfit.shapes import Registry, keys_of

MESH_ERRORS = (0.001, 0.1)  # range of the errors by the mesh that a case may ask for
USUAL_MESH_ERROR = 0.01
Table = TypeVar("Table", bound=Section)
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
    base: Literal["sliding", "bonded", "unknown"] = Field(
        default="unknown",
        examples=["sliding"],
        description="support of the sample: the sample slides on it, or is bonded to it (the force can differ by half); "
        "if unknown, or left out, a fit tries both",
    )
    fibre_angle: Turn = Field(
        default=0.0, description="angle by which the sample's fibres are turned from the angles that the tests state"
    )
    families: FamilyAngles | None = Field(
        default=None,
        examples=[[40, -40]],
        description="angles of two families of fibres from the direction that a test's angle states, for materials with two",
    )
    family_dips: FamilyDips | None = Field(
        default=None,
        examples=[[0, 0]],
        description="angles by which these two families rise out of the sample's plane, towards the indenter; 0 by default",
    )
    directions: FibreFile | None = Field(
        default=None,
        examples=["fibres.csv"],
        description="CSV file of directions of fibres on points of the sample, relative to the case file, such as from imaging: "
        "columns x, z, and y where they change with the height, each with its unit, and angle_deg (and dip_deg) or ax, ay, az; "
        "axes are those of a test of angle 0, and tests of other angles turn the sample. For materials with one family",
    )
    prestretch: Annotated[float, Field(ge=1, le=2, allow_inf_nan=False)] | None = Field(
        default=None,
        examples=[1.05],
        description="stretch of a block along x before the indentation; its ends at x = +-length/2 are held there from then on, "
        "and may narrow. Sizes are those before the stretch, depths count from the stretched sample; 1 holds the ends only",
    )
    layer: Annotated[tuple[Layer, ...], BeforeValidator(as_tuple)] = Field(
        default=(), description="list of layers, the top one first, each with its own material; in place of the table [material]"
    )

    @property
    def interfaces(self) -> tuple[float, ...]:
        """Depths of the interfaces between layers below the top, mm. Where a run changes the thickness of the sample, all layers
        change in proportion."""
        total = sum(layer.thickness for layer in self.layer)
        depths = itertools.accumulate(layer.thickness * self.thickness / total for layer in self.layer)
        return tuple(depths)[:-1]

    @property
    def slides(self) -> tuple[float, ...]:
        """Heights above the base of the interfaces whose layers slide on each other, mm, from the top."""
        pairs = zip(self.layer, self.interfaces, strict=False)  # the last layer lies on the base
        return tuple(self.thickness - depth for layer, depth in pairs if layer.interface == "sliding")

    @property
    def top_thickness(self) -> float:
        """Thickness of the layer that the indenter touches, mm; of a sample without layers its own."""
        return min((*self.interfaces, self.thickness))

    def layer_at(self, height: Array) -> Ints:
        """Numbers (n,) of the layers, from 0 at the top, at heights (n,) above the base, mm."""
        return np.searchsorted(np.array(self.interfaces), self.thickness - height)

    @property
    def stretched(self) -> Sample:
        """The sample after its prestretch, which keeps its volume; itself without one."""
        if self.prestretch is None or self.prestretch == 1:
            return self
        narrower = self.prestretch**-0.5
        factors = {"length": self.prestretch, "width": narrower, "thickness": narrower}
        return self.model_copy(update={key: factor * dict(self)[key] for key, factor in factors.items() if dict(self)[key]})

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
        shape = self.geometry_if_right()
        if self.prestretch is not None and shape is not None and not isinstance(shape.outline, samples.Rectangle):
            yield "prestretch", f"a {shape.name} has no ends that could be held; give a block, or remove it"
        if self.layer:
            yield from layers_disagree(self.layer, self.thickness)


class Indenter(Section):
    """The rigid indenter, centred on the sample; a strip's long side lies along x."""

    place = "indenter"
    rivals = either("diameter", "radius")

    shape: Annotated[str, Shape(indenters.SHAPES)] = Field(description="shape of the indenter")
    width: Length | None = Field(
        default=None, examples=[2.0], description="size of the strip along z; of a wedge where its flank ends, if it does"
    )
    length: Length | None = Field(
        default=None, examples=[20.0], description="size of the strip along x; it may overhang the sample, and a wedge must"
    )
    diameter: Length | None = Field(
        default=None,
        examples=[2.0],
        description="diameter of the flat cylinder or of the sphere; of a cone where its flank ends, if it does",
    )
    radius: Length | None = Field(default=None, examples=[1.0], description="radius, instead of the diameter")
    half_angle: HalfAngle | None = Field(
        default=None, examples=[70.0], description="angle between the axis of a cone, or the middle plane of a wedge, and its flank"
    )
    tip_radius: Radius = Field(
        default=0.0, examples=[0.05], description="radius of the tip of a cone or wedge, tangential to the flank; 0 is sharp"
    )
    edge_radius: Radius = Field(default=0.0, description="radius of the edge; 0 is sharp")
    friction: Friction = Field(
        default="unknown",
        examples=[0.5],
        description='friction coefficient, "stick" for no slip at all, or "unknown" (0 to 1), as it is where it is left out',
    )

    @property
    def geometry(self) -> indenters.IndenterShape:
        """The shape with its sizes."""
        shape = self.geometry_if_right()
        assert shape is not None  # `disagreements` has seen to that
        return shape

    def geometry_if_right(self) -> indenters.IndenterShape | None:
        """The shape with its sizes, None where a key of it is not right."""
        return indenters.SHAPES.make(keys_of_shape(dict(self)))

    def word_for(self, key: str) -> str:
        """The key of this table that gives a size of the shape: a diameter may be given by the radius."""
        return "radius" if key == "diameter" and self.diameter is None and self.radius is not None else key

    def disagreements(self) -> Iterator[tuple[str, str]]:
        for key, text in self.of_shape(indenters.SHAPES):
            if not (key == "diameter" and "radius" in self.model_fields_set):
                yield key, text
        if "radius" in self.model_fields_set:
            yield from self._faults_of_radius()
        if shape := self.geometry_if_right():
            yield from ((self.word_for(key), text) for key, text in shape.faults())

    def _faults_of_radius(self) -> Iterator[tuple[str, str]]:
        """A radius beside a diameter, or of a shape that has none."""
        shape = indenters.SHAPES.find_or_none(dict(self).get("shape"))
        if "diameter" in self.model_fields_set:
            yield "radius", "indenter.diameter is given too; keep one of them"
        elif shape is not None and not {"diameter", "radius"} & set(keys_of(shape)):
            yield "radius", f"does not belong to a {shape.name}; remove it"


def keys_of_shape(keys: Mapping[str, Any]) -> dict[str, Any]:
    """The keys of an [indenter] table by the names that shapes have for them: a radius becomes a diameter."""
    radius = keys.get("radius")
    return {**keys, "diameter": 2 * radius} if radius is not None and keys.get("diameter") is None else dict(keys)


def _own_keys_of(table: type[Section]) -> Callable[[type[Table]], type[Table]]:
    """Give a class the keys of a table, none of them needed: a test has the keys in which it differs from the case."""

    def with_keys(model: type[Table]) -> type[Table]:
        keys: dict[str, Any] = {}
        for name, field in table.model_fields.items():
            if name == "layer":  # layers are those of all tests
                continue
            kind: Any = Annotated[(field.annotation, *field.metadata)] if field.metadata else field.annotation
            keys[name] = (kind | None, _not_needed(field))
        return create_model(model.__name__, __base__=model, __module__=model.__module__, __doc__=model.__doc__, **keys)

    return with_keys


def _not_needed(field: FieldInfo) -> FieldInfo:
    """The same key without a need or a default; its type, with all that is checked of it, is written beside it."""
    free = copy(field)
    free.default, free.default_factory, free.metadata = None, None, []
    return free


class OwnTable(Section):
    """Keys in which the piece or the indenter of one test differs from the case's own."""

    shapes: ClassVar[Registry[Any]]

    def over(self, table: Table) -> Table:
        """The table of a test: the case's, with these keys in place of its own. With another shape, sizes are not taken over.

        Raises
        ------
        ValidationError, CaseError
            The keys do not make a table.
        """
        given = {key: getattr(self, key) for key in self.model_fields_set}
        kept = {key: value for key, value in dict(table).items() if key in table.model_fields_set and value is not None}
        return type(table).model_validate({key: value for key, value in kept.items() if not self.replaces(key, table)} | given)

    def replaces(self, key: str, table: Section) -> bool:
        """Whether these keys stand in place of a key of the case's table."""
        given, rivals, shape = self.model_fields_set, table.rivals.get(key, frozenset()), dict(table).get("shape")
        another_shape = "shape" in given and dict(self)["shape"] != shape
        return key in given or bool(rivals & given) or (another_shape and bool({key, *rivals} & self.shapes.all_keys()))

    def disagreements(self) -> Iterator[tuple[str, str]]:
        for key in self.model_fields_set:
            if dict(self).get(key) == "unknown":
                table = self.place.rpartition(".")[2]
                yield key, f"must be known for a single test; [{table}] can call it unknown for all tests that take it from there"


@_own_keys_of(Sample)
class OwnSample(OwnTable):
    """The sample of this test, where it differs: the keys that are given replace those of [sample]; with another shape, its sizes
    must be given."""

    place = "test.sample"
    shapes = samples.SHAPES


@_own_keys_of(Indenter)
class OwnIndenter(OwnTable):
    """The indenter of this test, where it differs: the keys that are given replace those of [indenter]; with another shape, its
    sizes must be given."""

    place = "test.indenter"
    shapes = indenters.SHAPES


class Mesh(Section):
    """The mesh; without `size` and `elements` the mesh is chosen for an error of the force."""

    place = "mesh"
    rivals = either("size", "elements", "error")

    size: Length | None = Field(default=None, examples=[0.4], description=SIZE)
    elements: int | None = Field(
        default=None,
        ge=20,
        le=2_000_000,
        examples=[3000],
        description="approximate number of elements of a quarter sample; without size and elements, the mesh is chosen by `error`",
    )

    error: float | None = Field(
        default=None,
        ge=MESH_ERRORS[0],
        le=MESH_ERRORS[1],
        examples=[0.003],
        description="error of the largest force that the mesh may cause, as a share; 0.01 where neither size nor elements is given",
    )

    symmetry: Literal["auto", "axisymmetric", "quarter", "half", "whole"] = Field(
        default="auto",
        description="solve in the meridian plane (round sample, round indenter, no fibres), or a quarter, a half or the whole of "
        "the sample; auto: the least of these that the fibres allow",
    )

    @property
    def default(self) -> bool:
        """Whether the mesh is chosen by its error."""
        return self.size is None and self.elements is None

    @property
    def wanted_error(self) -> float:
        """The error of the force, as a share, that a mesh without `size` and `elements` is chosen for."""
        return self.error or USUAL_MESH_ERROR

    def disagreements(self) -> Iterator[tuple[str, str]]:
        given = [key for key in ("size", "elements", "error") if getattr(self, key, None) is not None]
        for key in given[1:]:
            yield key, f"mesh.{given[0]} is given too; keep one of them"


def _file_or_curve(value: Any) -> str | Curve | None:
    if value is None or isinstance(value, Curve):
        return value
    if not isinstance(value, str):
        raise refusal(
            "must be text in quotes; give the CSV file of the measured curve, relative to the case file, or in Python a Curve"
        )
    return one_line(value)


class Test(Section):
    """One test, an indentation or a homogeneous state: a measured curve, a raw record, or only a depth or strain to simulate."""

    __test__ = False  # not a test of pytest's

    place = "test"
    rivals: ClassVar[dict[str, frozenset[str]]] = {
        "curve": frozenset({"depth", "points", "record", "strain", "force"}),
        "record": frozenset({"depth", "points", "curve", "force"}),
        "depth": frozenset({"curve", "record"}),
        "strain": frozenset({"curve"}),
        "rate": frozenset({"ramp"}),
        "ramp": frozenset({"rate"}),
    }

    name: Annotated[Line, Field(max_length=60)] = Field(examples=["parallel"], description="name of the test")
    kind: Literal["indentation", "compression"] | Kind = Field(
        default="indentation", description="indentation; a disc between two plates; simple shear; or uniaxial or biaxial stretch"
    )
    angle: Angle | None = Field(
        default=None, examples=[0], description="angle from x, the indenter's long side, to the fibres; not needed without fibres"
    )
    dip: Dip = Field(default=0.0, description="angle by which the fibres rise out of the sample's plane, towards the indenter")
    curve: Annotated[
        str | Curve | None, PlainValidator(_file_or_curve), WithJsonSchema({"anyOf": [{"type": "string"}, {"type": "null"}]})
    ] = Field(
        default=None,
        examples=["curves/parallel.csv"],
        description="CSV file of the measured curve, relative to the case file; its header is displacement_mm,force_mN (without an "
        "indenter also strain or stretch, and stress_kPa)",
    )
    record: Line | None = Field(
        default=None,
        examples=["records/parallel.csv"],
        description="raw record of the rig, instead of a curve, read as [record] says; relative to the case file",
    )
    depth: Length | None = Field(default=None, examples=[0.33], description="depth to simulate, instead of a curve")
    points: int = Field(default=25, ge=1, le=10_000, description="number of points to simulate, with a depth or a strain")
    rate: Velocity | None = Field(
        default=None, examples=[0.66], description="velocity of the indenter in the ramp, for a material with [material.relaxation]"
    )
    ramp: Seconds | None = Field(
        default=None, examples=[0.5], description="duration of the ramp to the last displacement, instead of rate"
    )
    hold: Seconds | None = Field(default=None, examples=[5.0], description="duration of the hold after the ramp, to simulate")
    force: Force | None = Field(
        default=None, examples=[5.0], description="force of the hold, to simulate creep with control force, to test.depth at most"
    )
    control: Literal["displacement", "force"] | None = Field(
        default=None, examples=["displacement"], description="what the rig controls: displacement (default), or force"
    )
    weight: NotNegative | None = Field(
        default=None, examples=[0.5], description="weight in the objective; by default 1 / number of tests"
    )
    synthetic: bool = Field(default=False, description="whether the curve was computed, not measured; reports then say so")
    fibres: Fibres | None = Field(
        default=None,
        examples=["along"],
        description="fibres without an indenter: along the shear, or the measured axis; across it, in the plane of shear or of two "
        "stretches; or normal to that plane",
    )
    families: FamilyAngles | None = Field(
        default=None,
        examples=[[30, -30]],
        description="angles of two families of fibres from the direction that `fibres` names, without an indenter, in the plane of "
        "shear or of two stretches, in the sense of a turn from the axis along to the one across; for materials with two families",
    )
    loading: Literal["tension", "compression"] | None = Field(
        default=None,
        examples=["tension"],
        description="direction of a uniaxial or biaxial test, in which strains and stresses are positive (a file of a compression "
        "may have them negative)",
    )
    ratio: NotNegative | None = Field(
        default=None, examples=[1.0], description="strain across over strain along, of a biaxial test; 1 by default"
    )
    area: Annotated[Positive, Quantity("mm^2")] | None = Field(
        default=None, examples=[100.0], description="area of the undeformed specimen, where forces are measured"
    )
    length: Length | None = Field(
        default=None, examples=[3.0], description="length of the undeformed specimen (in shear its thickness), for displacements"
    )
    diameter: Length | None = Field(
        default=None, examples=[8.0], description="diameter of the disc between plates, undeformed; length is its height"
    )
    plates: Literal["sliding", "bonded"] | None = Field(
        default=None, examples=["sliding"], description="the disc slides on the plates, or is bonded to them (glued, or it sticks)"
    )
    strain: Positive | None = Field(default=None, examples=[0.2], description="largest strain to simulate, instead of a curve")
    stress: Literal["nominal", "cauchy"] | None = Field(
        default=None,
        examples=["nominal"],
        description="stress of the curve: force over the undeformed area (nominal, the default), or over the deformed one (cauchy)",
    )
    sample: OwnSample | None = Field(default=None, description="keys of the sample of this test, where it is another one")
    indenter: OwnIndenter | None = Field(default=None, description="keys of the indenter of this test, where it is another one")
    field: Annotated[tuple[MeasuredField, ...], BeforeValidator(one_or_many)] = Field(
        default=(), description="list of displacements of the sample that were measured beside the force"
    )

    @property
    def direction(self) -> float:
        """The angle, degrees; 0 where the material has no fibres and the case gives no angle."""
        return 0 if self.angle is None else self.angle

    @property
    def cauchy(self) -> bool:
        """Whether the stress is force over the deformed area."""
        return self.stress == "cauchy"

    @property
    def largest(self) -> float | None:
        """The largest displacement to simulate without a curve, mm; a strain counts as the displacement of the length."""
        return self.depth if self.strain is None else self.strain * (self.length or 1.0)

    def rate_to(self, depth: float) -> float | None:
        """Velocity in a ramp to a depth (mm), mm/s; None where the test has no ramp in time."""
        return depth / self.ramp if self.ramp is not None else self.rate

    def __init__(self, name: str | None = None, /, **keys: Any) -> None:
        super().__init__(**({} if name is None else {"name": name}), **keys)

    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]  # see Section

    def disagreements(self) -> Iterator[tuple[str, str]]:
        given = self.model_fields_set
        yield from specimen.disagreements(self)
        sources = [key for key in ("curve", "record", "depth", "strain") if key in given]
        if len(sources) > 1:
            yield sources[-1], f"a {sources[0]} is given too; keep one of them"
        if not sources and self.kind == "indentation":
            yield "curve", "missing; give the file of the measured curve, or of its raw record (record), or depth (mm)"
        elif not sources:
            yield "curve", "missing; give the file of the measured curve, or the largest strain to simulate (strain)"
        if known(self.rate, self.ramp):
            yield "ramp", "a rate is given too; keep one of them"
        if self.hold is not None and not {"rate", "ramp"} & given:
            yield "hold", "needs the ramp before it; give test.rate or test.ramp"
        if {"curve", "record"} & given and "points" in given:
            yield "points", "belongs to a test with a depth or a strain; the points of a curve are those of its file"
