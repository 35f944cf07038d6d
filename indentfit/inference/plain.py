"""The parts of results as plain numbers, lists and dictionaries."""

import math
from dataclasses import fields, is_dataclass
from typing import Any

Interval = tuple[float, float]
NOT_IN_JSON = ("curves", "case", "whole_case", "samples")
MOST = 12  # decimals of a number


def by_error(value: float, error: float | None, digits: int = 5) -> str:
    """A number with as many decimals as its standard error has with two digits; with so many digits where it has no error."""
    if error is None or not (math.isfinite(error) and error > 0 and math.isfinite(value)):
        return f"{value:.{digits}g}"
    decimals = 1 - math.floor(math.log10(float(f"{error:.1e}")))
    return f"{value:.{min(decimals, MOST)}f}" if decimals >= 0 else f"{round(value, decimals):.0f}"


def with_error(value: float, error: float) -> str:
    """A number with its standard error: both with the decimals that the error has with two digits."""
    return f"{by_error(value, error)} +- {by_error(error, error)}"


def span(interval: Interval) -> str:
    """A 95 % interval with the digits that its width has."""
    low, high = interval
    return f"{by_error(low, (high - low) / 4, 3)} to {by_error(high, (high - low) / 4, 3)}"


def plain_fields(value: Any) -> dict[str, Any]:
    """The fields of a dataclass as plain numbers, lists and dictionaries."""
    return {known.name: _plain(getattr(value, known.name)) for known in fields(value) if known.name not in NOT_IN_JSON}


def _plain(value: Any) -> Any:
    if is_dataclass(value):
        return value.as_json() if hasattr(value, "as_json") else plain_fields(value)
    if isinstance(value, dict):
        return {name: _plain(inner) for name, inner in value.items()}
    return [_plain(inner) for inner in value] if isinstance(value, tuple | list) else value
