"""The parts of results as plain numbers, lists and dictionaries."""

from dataclasses import fields, is_dataclass
from typing import Any

Interval = tuple[float, float]
NOT_IN_JSON = ("curves", "case", "samples")


def plain_fields(value: Any) -> dict[str, Any]:
    """The fields of a dataclass as plain numbers, lists and dictionaries."""
    return {known.name: _plain(getattr(value, known.name)) for known in fields(value) if known.name not in NOT_IN_JSON}


def _plain(value: Any) -> Any:
    if is_dataclass(value):
        return value.as_json() if hasattr(value, "as_json") else plain_fields(value)
    if isinstance(value, dict):
        return {name: _plain(inner) for name, inner in value.items()}
    return [_plain(inner) for inner in value] if isinstance(value, tuple | list) else value
