"""The key `directions` of a sample: the file of directions of fibres on points, or these directions themselves."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import PlainSerializer, PlainValidator, WithJsonSchema

from indentfit.case.quantities import one_line, refusal
from indentfit.fibre_map import FibreMap

TURNED_BLOCK = (
    "would turn the block on which the directions were measured; give 0, and in a test of another sample a file of its own "
    "(test.sample.directions)"
)


def _file_or_map(value: Any) -> str | FibreMap:
    if isinstance(value, FibreMap):
        return value
    if not isinstance(value, str):
        raise refusal(
            "must be text in quotes; give the CSV file of the directions, relative to the case file, or in Python a FibreMap"
        )
    return one_line(value)


def _plain(value: str | FibreMap) -> Any:
    return value if isinstance(value, str) else value.as_lists()


FibreFile = Annotated[
    str | FibreMap, PlainValidator(_file_or_map), PlainSerializer(_plain, when_used="json"), WithJsonSchema({"type": "string"})
]
