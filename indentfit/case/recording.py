"""The table of raw records: how a lab's files hold displacement, force and time, and how they become curves."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BeforeValidator, Field

from indentfit.case.quantities import Finite, Line, Positive, Rate, Share, as_tuple
from indentfit.case.section import Section

CHANNELS = ("displacement", "force", "time")


class RecordChannel(Section):
    """How a column of a raw record becomes a quantity: sign * gain * value + offset, in `unit`."""

    column: Annotated[int, Field(ge=1)] | Line | None = Field(
        default=None, examples=["force_V"], description="name of the column, or its number from 1"
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
    rate: Rate | None = Field(default=None, examples=[1000.0], description="sampling rate")
    skip_rows: int = Field(default=0, ge=0, description="rows to skip above the table and its header")
    sheet: Annotated[int, Field(ge=1)] | Line | None = Field(
        default=None, examples=[1], description="sheet of a workbook, name or number"
    )
    encoding: Line | None = Field(
        default=None, examples=["utf-16"], description="encoding, where it is not recognised: utf-8, utf-16, gbk, latin-1"
    )
    contact: Literal["piecewise", "threshold", "variance_ratio"] = Field(
        default="piecewise", description="method of the contact point"
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
