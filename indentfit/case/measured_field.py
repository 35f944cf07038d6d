"""The table [[test.field]]: displacements of the sample that were measured beside the force."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import PurePath
from typing import Annotated, Any

from pydantic import Field, PlainSerializer, PlainValidator, WithJsonSchema

from indentfit.case.quantities import Length, Line, as_tuple, one_line, refusal
from indentfit.case.section import Section
from indentfit.displacements import Displacements
from indentfit.samples import Outline


def _file_or_displacements(value: Any) -> str | Displacements:
    if isinstance(value, Displacements):
        return value
    if not isinstance(value, str):
        raise refusal(
            "must be text in quotes; give the CSV file of the points, relative to the case file, or in Python Displacements"
        )
    return one_line(value)


def one_or_many(value: Any) -> Any:
    """A table as a tuple of one, a list of tables as a tuple."""
    return (value,) if isinstance(value, dict | MeasuredField) else as_tuple(value)


def _name_of_file(value: str | Displacements) -> str:
    return value if isinstance(value, str) else value.file


class MeasuredField(Section):
    """Displacements of points of the sample that were measured beside the force: markers, tracks of ultrasound, tomography or image
    correlation, or the motion of a side."""

    place = "test.field"

    file: Annotated[
        str | Displacements,
        PlainValidator(_file_or_displacements),
        PlainSerializer(_name_of_file, when_used="json"),
        WithJsonSchema({"type": "string"}),
    ] = Field(
        examples=["curves/side.csv"],
        description="CSV file of the points, relative to the case file; its columns are x, y, z (position on the undeformed "
        "sample, y above the base; or the radius r and y), ux, uy, uz (or ur), sd or ux_sd ..., and depth, each with its unit",
    )
    outline: bool = Field(
        default=False,
        examples=[False],
        description="true: the file holds points on the deformed outline in the section x = 0 (columns z, y), z = 0 (x, y) or of a "
        "round sample (r, y), which are no material points; a round sample's outline is its silhouette, too",
    )
    name: Line | None = Field(
        default=None, examples=["side"], description="name of the field; by default that of the file without its ending"
    )
    sd: Length | None = Field(
        default=None, examples=[0.005], description="standard deviation of a displacement, where the file has no column of it"
    )
    depth: Length | None = Field(
        default=None,
        examples=[0.33],
        description="displacement of the indenter at which the points were seen, where the file has no column of it; by default "
        "the deepest of the test",
    )

    @property
    def label(self) -> str:
        """The name of the field."""
        return self.name or PurePath(_name_of_file(self.file)).stem

    @property
    def points(self) -> Displacements:
        """The displacements, once the case has read them."""
        assert isinstance(self.file, Displacements)  # a case that is read, or made from values, has them
        return self.file


def half_width(points: Displacements, outline: Outline) -> float:
    """Half of the width of the section in which an outline was seen, mm; of other fields, half of the sample's width."""
    return outline.extent[1 if points.across == 0 else 0] / 2


def known_points(fields: Sequence[MeasuredField], deepest: float, outline: Outline, thickness: float) -> list[Displacements]:
    """The measured displacements of fields, with standard deviations and depths for all.

    Parameters
    ----------
    fields : sequence of MeasuredField
    deepest : float, mm
        The deepest displacement of the test.
    outline : Outline
        Of the sample.
    thickness : float, mm
    """
    known = [field.points.known(field.sd, field.depth, deepest) for field in fields]
    return [points.outline_on(half_width(points, outline), thickness) for points in known]
