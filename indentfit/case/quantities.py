"""Types of the numbers and texts in a case file: each converts, checks and describes one kind of value."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, Literal, get_args

from pydantic import AfterValidator, BeforeValidator, Field, PlainValidator, WithJsonSchema
from pydantic.fields import FieldInfo
from pydantic_core import PydanticCustomError, core_schema

from indentfit.case.slips import not_printable
from indentfit.errors import InputError, suggestion
from indentfit.shapes import Registry
from indentfit.units import number_in

ASKED = "?"  # stands in a template for a value that only the experimenter knows


@dataclass(frozen=True)
class Quantity:
    """Marks a number with its unit: a string with another unit, such as "3300 um", is converted to that unit."""

    unit: str

    def __get_pydantic_core_schema__(self, source: Any, inner: Callable[[Any], Any]) -> Any:
        return core_schema.no_info_before_validator_function(self._number, inner(source))

    def __get_pydantic_json_schema__(self, schema: Any, inner: Callable[[Any], Any]) -> dict[str, Any]:
        return {"anyOf": [inner(schema), {"type": "string", "description": f"a number with a unit that converts to {self.unit}"}]}

    def _number(self, value: Any) -> Any:
        if not isinstance(value, str):
            return value
        try:
            return number_in(self.unit, value)
        except ValueError as error:
            raise refusal(str(error)) from None


@dataclass(frozen=True)
class Shape:
    """Marks the name of a shape of a registry."""

    shapes: Registry[Any]

    def __get_pydantic_core_schema__(self, source: Any, inner: Callable[[Any], Any]) -> Any:
        return core_schema.no_info_plain_validator_function(self._name)

    def __get_pydantic_json_schema__(self, schema: Any, inner: Callable[[Any], Any]) -> dict[str, Any]:
        return {"type": "string", "enum": list(self.shapes.names())}

    def _name(self, value: Any) -> str:
        try:
            if isinstance(value, str) and self.shapes.find(value):
                return value
        except InputError as error:
            raise refusal(str(error)) from None
        names = self.shapes.names()
        raise refusal(f"must be {', '.join(map(repr, names[:-1]))} or {names[-1]!r}{suggestion(value, names)}")


@dataclass(frozen=True)
class Unit:
    """Marks a plain number with its unit, for the reference; nothing is converted."""

    unit: str


def unit_of(*annotations: Any) -> str:
    """The unit that marks a number, empty where no unit does."""
    for part in annotations:
        if isinstance(part, Quantity | Unit):
            return part.unit
        if inner := unit_of(*getattr(part, "__metadata__", ()), *(() if isinstance(part, str) else get_args(part))):
            return inner
    return ""


def meaning(field: FieldInfo) -> str:
    """The description of a key, with its unit."""
    unit, (head, semicolon, tail) = unit_of(*field.metadata, field.annotation), (field.description or "").partition(";")
    return f"{head}{f', {unit}' if unit else ''}{semicolon}{tail}"


def refusal(text: str, kind: str = "fault") -> PydanticCustomError:
    """The error by which a validator refuses a value: what is wrong and what to do."""
    return PydanticCustomError(kind, "{text}", {"text": text})  # type: ignore[arg-type]  # pydantic asks for a literal


def is_number(value: Any) -> bool:
    """Whether a value is a finite number, and not true or false."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:
        return False


def _friction(value: Any) -> float | str:
    if isinstance(value, str) and value in ("stick", "unknown"):
        return value
    if not is_number(value) or not 0 <= value <= 10:
        raise refusal('must be a coefficient from 0 to 10, "stick" for no slip at all, or "unknown"')
    return float(value)


def _bulk_ratio(value: Any) -> float | str:
    if isinstance(value, str) and value == "unknown":
        return value
    if not is_number(value) or value <= 0:
        raise refusal('must be above 0, or "unknown"')
    return float(value)


def _angle(value: Any) -> float:
    """An angle; a whole number stays one, as reports show it."""
    if not is_number(value) or not 0 <= value < 180:
        raise refusal("must be at least 0 and below 180, the degrees from the indenter's long side to the fibres")
    return int(value) if value == int(value) else float(value)


def _dip(value: Any) -> float:
    if not is_number(value) or not -90 <= value <= 90:
        raise refusal("must be from -90 to 90, the degrees between the fibres and the plane of the sample")
    return float(value)


def _turn(value: Any) -> float:
    if not is_number(value) or not -180 <= value <= 180:
        raise refusal("must be from -180 to 180, the degrees by which the fibres are turned")
    return float(value)


def _pair(low: float, high: float, meaning: str) -> Callable[[Any], tuple[float, float]]:
    """A reader of the angles of two families of fibres."""

    def read(value: Any) -> tuple[float, float]:
        numbers = tuple(value) if isinstance(value, list | tuple) else ()
        if len(numbers) != 2 or not all(is_number(number) and low <= number <= high for number in numbers):
            raise refusal(f"must be two numbers from {low:g} to {high:g}, such as [40, -40]: {meaning}, in degrees")
        return float(numbers[0]), float(numbers[1])

    return read


def one_line(text: str) -> str:
    """A text that is printable on one line; a refusal otherwise."""
    if not text.strip() or not text.isprintable():
        raise refusal(not_printable(text))
    return text


def _printable(text: str) -> str:
    if text and not text.isprintable():
        raise refusal("must be text on one line of at most 200 characters")
    return text


def as_tuple(value: Any) -> Any:
    """A list as a tuple, any other value unchanged."""
    return tuple(value) if isinstance(value, list) else value


def _odds(value: Any) -> Any:
    """Even odds for true, none for false."""
    return {True: 0.5, False: None}[value] if isinstance(value, bool) else value


ODDS = {"anyOf": [{"type": "number", "exclusiveMinimum": 0, "exclusiveMaximum": 1}, {"type": "boolean"}]}
STICK = {"anyOf": [{"type": "number", "minimum": 0, "maximum": 10}, {"enum": ["stick", "unknown"]}]}
ANGLE = {"type": "number", "minimum": 0, "exclusiveMaximum": 180}
DIP = {"type": "number", "minimum": -90, "maximum": 90}
TURN = {"type": "number", "minimum": -180, "maximum": 180}
PAIR = {"type": "array", "items": {"type": "number"}, "minItems": 2, "maxItems": 2}
RATIO = {"anyOf": [{"type": "number", "exclusiveMinimum": 0}, {"const": "unknown"}]}

Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Share = Annotated[float, Field(gt=0, lt=1, allow_inf_nan=False)]
Length = Annotated[Positive, Quantity("mm")]
Radius = Annotated[NotNegative, Quantity("mm")]
HalfAngle = Annotated[float, Field(ge=5, lt=90, allow_inf_nan=False), Unit("degrees")]
Pressure = Annotated[Positive, Quantity("kPa")]
Force = Annotated[Positive, Quantity("mN")]
Rate = Annotated[Positive, Quantity("Hz")]
Friction = Annotated[float | Literal["stick", "unknown"], PlainValidator(_friction), WithJsonSchema(STICK)]
BulkRatio = Annotated[float | Literal["unknown"], PlainValidator(_bulk_ratio), WithJsonSchema(RATIO)]
Angle = Annotated[int | float, PlainValidator(_angle), WithJsonSchema(ANGLE), Unit("degrees")]
Dip = Annotated[float, PlainValidator(_dip), WithJsonSchema(DIP), Unit("degrees")]
Turn = Annotated[float, PlainValidator(_turn), WithJsonSchema(TURN), Unit("degrees")]
FamilyAngles = Annotated[
    tuple[float, float],
    BeforeValidator(_pair(-180, 180, "the angle of each family of fibres from the direction that a test states")),
    WithJsonSchema(PAIR),
    Unit("degrees"),
]
FamilyDips = Annotated[
    tuple[float, float],
    BeforeValidator(_pair(-90, 90, "the angle by which each family of fibres rises out of the plane of the sample")),
    WithJsonSchema(PAIR),
    Unit("degrees"),
]
Odds = Annotated[Share | None, BeforeValidator(_odds), WithJsonSchema(ODDS)]
Line = Annotated[str, AfterValidator(one_line)]
Title = Annotated[str, AfterValidator(_printable), Field(max_length=200)]
