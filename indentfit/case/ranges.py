"""A free parameter of a case: where its search starts, and its bounds."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, ClassVar

from pydantic import Field

from indentfit.case.quantities import Finite, is_number, refusal
from indentfit.case.section import Section, known

HALF_TURN = 180.0  # degrees after which fibres have the same direction


class Range(Section):
    """A free parameter: where a search starts, and its bounds, in the parameter's unit."""

    start: Finite = Field(description="value to start from")
    min: Finite = Field(description="lower bound")
    max: Finite = Field(description="upper bound")

    scale: ClassVar[float | None] = None
    """What half an interval is compared with, to say how well the parameter is determined; None for the value itself."""

    def disagreements(self) -> Iterator[tuple[str, str]]:
        if known(self.min, self.max) and self.min >= self.max:
            yield "min", f"must be below max = {self.max:g}; for a fixed parameter give just the number"
        elif known(self.start, self.min) and self.start < self.min:
            yield "start", f"is below min = {self.min:g}; start between the bounds"
        elif known(self.start, self.max) and self.start > self.max:
            yield "start", f"is above max = {self.max:g}; start between the bounds"


class RangeOfAngle(Range):
    """A free angle of fibres, degrees: an interval is compared with half of the way from along to across, because 0 is no special
    value, and after 180 degrees the directions come again."""

    scale: ClassVar[float | None] = 45.0

    def disagreements(self) -> Iterator[tuple[str, str]]:
        yield from super().disagreements()
        if known(self.min, self.max) and self.max - self.min > HALF_TURN:
            yield "max", "goes through the same directions twice: it must be at most 180 degrees above min"


def fixed_or_range(value: Any, _: Any) -> float | Range:
    """A number as it is, a table as a Range."""
    if isinstance(value, Range):
        return value
    if isinstance(value, dict):
        return Range.model_validate(value)
    if not is_number(value):
        raise refusal("must be a finite number, or {start = ..., min = ..., max = ...} to be fitted")
    return float(value)
