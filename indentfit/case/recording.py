"""The table of raw records: how a lab's files hold displacement, force and time, and how they become curves."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, PlainValidator, WithJsonSchema

from indentfit.case.quantities import Finite, Length, Line, Positive, Quantity, Share, Unit, as_tuple, is_number, refusal
from indentfit.case.section import Section
from indentfit.units import number_in

CHANNELS = ("displacement", "force", "time")
Stiffness = Annotated[Positive, Quantity("mN/mm")]
Compliance = Annotated[Positive, Quantity("mm/mN")]
Force = Annotated[Positive, Quantity("mN")]
METHODS = ("piecewise", "threshold", "variance_ratio", "first", "extrapolated", "force")
CONTACTS = "'piecewise', 'threshold' or 'variance_ratio', which search for it, 'first', 'extrapolated' or 'force'"
ZEROS = ("auto", "approach", "sensor")


def _pair(value: Any, low: float) -> tuple[Any, Any] | None:
    """Two rising numbers from `low` on, or None where the value is anything else."""
    if not isinstance(value, list | tuple) or len(value) != 2 or not all(map(is_number, value)):
        return None
    return (value[0], value[1]) if low <= value[0] < value[1] else None


def _rate(value: Any) -> float | str:
    number = value
    if isinstance(value, str) and value != "unknown":
        try:
            number = number_in("Hz", value)
        except ValueError as error:
            raise refusal(f'{error}, or "unknown"') from None
    if value == "unknown":
        return "unknown"
    if not is_number(number) or number <= 0:
        raise refusal('must be above 0, or "unknown" where the file has no times; correct it')
    return float(number)


def _contact(value: Any) -> float | str:
    if isinstance(value, str):
        if value in METHODS:
            return value
        raise refusal(f"must be {CONTACTS}, or a displacement in mm")
    if not is_number(value):
        raise refusal("must be a displacement in mm, or the name of a method")
    return float(value)


def _zero(value: Any) -> str | tuple[float, float]:
    times = _pair(value, 0.0)
    if isinstance(value, str) and value in ZEROS:
        return value
    if times is None:
        raise refusal(f"must be {', '.join(map(repr, ZEROS))}, or two times in s that rise, such as [0.0, 1.0]")
    return times


def _rows(value: Any) -> tuple[int, int]:
    pair = _pair(value, 1)
    if pair is None or not all(isinstance(number, int) for number in pair):
        raise refusal("must be two row numbers that rise, such as [1, 5000]")
    return pair


def _times(value: Any) -> tuple[float, float]:
    pair = _pair(value, 0.0)
    if pair is None:
        raise refusal("must be two times in s that rise, such as [0.0, 10.0]")
    return pair


def _name_or_number(value: Any) -> int | str:
    if isinstance(value, int) and not isinstance(value, bool) and value >= 0:
        return value
    if isinstance(value, str) and value.strip() and value.isprintable():
        return value
    raise refusal("must be a number from 0, or a name")


def _cycle(value: Any) -> int | str:
    if value == "last" or (isinstance(value, int) and not isinstance(value, bool) and value >= 1):
        return value
    raise refusal('must be a number from 1, or "last"')


NUMBER_OR_TEXT = {"anyOf": [{"type": "number"}, {"type": "string"}]}
PAIR = {"type": "array", "items": {"type": "number"}, "minItems": 2, "maxItems": 2}
RateOrUnknown = Annotated[float | str, PlainValidator(_rate), WithJsonSchema(NUMBER_OR_TEXT), Unit("Hz")]
Contact = Annotated[float | str, PlainValidator(_contact), WithJsonSchema(NUMBER_OR_TEXT)]
Zero = Annotated[str | tuple[float, float], PlainValidator(_zero), WithJsonSchema({"anyOf": [{"enum": [*ZEROS]}, PAIR]})]
Rows = Annotated[tuple[int, int], PlainValidator(_rows), WithJsonSchema(PAIR)]
Times = Annotated[tuple[float, float], PlainValidator(_times), WithJsonSchema(PAIR), Unit("s")]
NameOrNumber = Annotated[int | str, PlainValidator(_name_or_number), WithJsonSchema(NUMBER_OR_TEXT)]
Cycle = Annotated[int | str, PlainValidator(_cycle), WithJsonSchema(NUMBER_OR_TEXT)]


class RecordChannel(Section):
    """How a column of a raw record becomes a quantity: sign * gain * value + offset, in `unit`."""

    column: Annotated[int, Field(ge=1)] | Line | None = Field(
        default=None, examples=["force_V"], description="name of the column, or its number from 1"
    )
    minus: Annotated[int, Field(ge=1)] | Line | None = Field(
        default=None,
        examples=["Cantilever"],
        description="name or number of a column that is subtracted, such as the deflection of the cantilever",
    )
    gain: Positive | None = Field(default=None, examples=[24.0], description="`unit` per unit of the column")
    sign: Literal[1, -1] = Field(default=1, description="-1 where the column falls under load")
    offset: Finite = Field(default=0.0, description="added after the gain, in `unit`")
    unit: Line | None = Field(
        default=None, examples=["mN"], description="unit of the quantity; by default that of the column's header"
    )


class Record(Section):
    """How the raw records of the tests are read, and turned into curves."""

    place = "record"

    displacement: RecordChannel = Field(
        default=RecordChannel.untouched(),
        examples=[{"column": "displacement_V", "gain": 6.0, "sign": -1, "unit": "mm"}],
        description="table of the displacement: column, gain, sign, offset and unit",
    )
    force: RecordChannel = Field(
        default=RecordChannel.untouched(),
        examples=[{"column": "force_V", "gain": 24.0, "sign": -1, "unit": "mN"}],
        description="table of the force: column, gain, sign, offset and unit",
    )
    time: RecordChannel = Field(
        default=RecordChannel.untouched(), examples=[{"column": "time_s"}], description="table of the time, where there is no rate"
    )
    rate: RateOrUnknown | None = Field(
        default=None, examples=[1000.0], description='sampling rate; "unknown" counts rows in place of seconds'
    )
    skip_rows: int = Field(default=0, ge=0, description="rows to skip above the table and its header")
    sheet: Annotated[int, Field(ge=1)] | Line | None = Field(
        default=None, examples=[1], description="sheet of a workbook, name or number"
    )
    sheets: Literal["first", "all"] | None = Field(
        default=None, examples=["all"], description='"all": every sheet of a workbook is a record of its own'
    )
    block: NameOrNumber | None = Field(
        default=None, examples=[2], description="number or name of one table, of a file that holds several; by default all"
    )
    segment: NameOrNumber | None = Field(
        default=None,
        examples=["approach"],
        description='segment of the record: "approach", "retract", or a value of its column of segments or stages; by default all',
    )
    cycle: Cycle | None = Field(
        default=None, examples=["last"], description='loading cycle of the record, from 1, or "last"; by default the first'
    )
    rows: Rows | None = Field(default=None, examples=[[1, 5000]], description="first and last row of numbers that are used")
    times: Times | None = Field(default=None, examples=[[0.0, 10.0]], description="first and last time that is used")
    preset: Line | None = Field(
        default=None,
        examples=["mach1"],
        description="name of an instrument's preset, or its file; by default that which recognises the file",
    )
    encoding: Line | None = Field(
        default=None, examples=["utf-16"], description="encoding, where it is not recognised: utf-8, utf-16, gbk, latin-1"
    )
    stiffness: Stiffness | None = Field(
        default=None,
        examples=[19.0],
        description="stiffness of the cantilever or load cell; force over stiffness is subtracted from the displacement",
    )
    compliance: Compliance | None = Field(
        default=None,
        examples=[1e-6],
        description="compliance of the frame; compliance times force is subtracted from the displacement",
    )
    contact: Contact = Field(
        default="piecewise",
        description='contact point: a method that searches for it; "first" sample; "extrapolated" by the law of the indenter from '
        'a record that begins in contact; "force": where the force reaches contact_force; or a displacement in mm',
    )
    contact_force: Force | None = Field(
        default=None, examples=[0.05], description='force at the contact point where contact = "force"'
    )
    zero: Zero = Field(
        default="auto",
        examples=["sensor"],
        description='zero of the force: of the "approach", of the "sensor", or the mean force between two times in s; "auto" takes '
        "the approach where the record has one",
    )
    radius: Length | None = Field(
        default=None,
        examples=[0.5],
        description="radius of the sphere, for the Hertz modulus; by default that which the file states",
    )
    max_depth: Length | None = Field(default=None, examples=[0.1], description="depth at which the curve is cut")
    max_force: Force | None = Field(default=None, examples=[5.0], description="force at which the curve is cut")
    max_radius: Annotated[float, Field(gt=0, le=10)] | None = Field(
        default=None, examples=[0.2], description="depth over radius at which the curve is cut"
    )
    turning: Annotated[float, Field(ge=0, le=0.5)] = Field(
        default=0.0, description="share of the depth before the turning point that is left out"
    )
    indenter: Literal["flat", "sphere", "cone"] | None = Field(
        default=None, examples=["flat"], description="end of the indenter, for the contact point; by default that of [indenter]"
    )
    filter: Annotated[float, Field(gt=0, le=0.3)] = Field(default=0.1, description="length of the filter over the ramp's duration")
    points: int = Field(default=25, ge=5, le=10_000, description="points of a curve")
    strains: Annotated[tuple[Share, ...], BeforeValidator(as_tuple)] = Field(
        default=(0.02, 0.05, 0.1), description="strains (depth over thickness) at which `process` reports the force"
    )
    prony_terms: Literal[0, 1, 2, 3, "auto"] = Field(default=2, description='terms of the Prony series, 0 to 3, or "auto"')

    def disagreements(self) -> Iterator[tuple[str, str]]:
        """The method "force" without the force."""
        if self.contact == "force" and self.contact_force is None:
            yield "contact_force", 'missing; contact = "force" needs it: the force at the contact point, mN'
