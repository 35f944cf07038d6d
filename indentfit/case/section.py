"""What every table of a case is: a frozen value with strict types, no unknown keys, and keys that agree."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, ValidationError, model_validator
from pydantic_core import InitErrorDetails

from indentfit.case.quantities import meaning, refusal
from indentfit.errors import CaseError
from indentfit.shapes import Registry

if TYPE_CHECKING:
    from indentfit.case.messages import Key


class Section(BaseModel):
    """One table of the case. A table that is made in memory with faults raises CaseError, with a line for each fault.

    Attributes
    ----------
    place : str
        Name of the table in the file.
    rivals : mapping of a key to other keys
        Keys that say the same in other words, or the contrary: a table has one of them.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, defer_build=True)  # built when first used
    place: ClassVar[str] = ""
    rivals: ClassVar[Mapping[str, frozenset[str]]] = {}

    def __init__(self, /, **keys: Any) -> None:
        try:
            super().__init__(**keys)
        except ValidationError as error:
            from indentfit.case.messages import lines  # here, because the wording of faults decides no curve (see runs/closure.py)

            raise CaseError(lines(type(self), error, tuple(self.place.split(".")) if self.place else ())) from None

    # pydantic makes an inner table without __init__, so that the error of the outer table lists the faults of both.
    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]

    @classmethod
    def untouched(cls) -> Self:
        """The table with every key at its default, made without building validators."""
        return cls.model_construct()

    def with_key(self, key: str, value: Any) -> Self:
        """The table with another value of a key, and without the rivals of that key; the value is not checked."""
        others = self.rivals.get(key, frozenset()) if value is not None else frozenset()
        return self.model_copy(update={key: value, **dict.fromkeys(others)})

    def disagreements(self) -> Iterator[tuple[str, str]]:
        """(key, what is wrong) for keys that are each correct but contradict each other; a key with a fault of its own is None."""
        yield from ()

    @model_validator(mode="before")
    @classmethod
    def _plain_numbers(cls, keys: Any) -> Any:
        """Numbers of NumPy as numbers of Python."""
        if not isinstance(keys, dict):
            return keys
        return {key: value.item() if isinstance(value, np.generic) else value for key, value in keys.items()}

    @model_validator(mode="after")
    def _agree(self) -> Section:
        raise_disagreements(type(self), [((key,), getattr(self, key), text) for key, text in self.disagreements()])
        return self

    def of_shape(self, shapes: Registry[Any]) -> Iterator[tuple[str, str]]:
        """Disagreements of the given keys with the shape that the key `shape` names: keys of other shapes, and missing keys."""
        known_keys, name = type(self).model_fields, dict(self).get("shape")
        values = {key: value for key, value in dict(self).items() if key in self.model_fields_set}
        for key, missing in shapes.disagreements(name, values, {key: field.default for key, field in known_keys.items()}):
            if key not in known_keys:
                yield "shape", f"needs the key {key}, which the table [{self.place}] does not have; ask the author of this shape"
            elif missing:
                yield key, f"missing; a {name} needs it: {meaning(known_keys[key])}"
            else:
                yield key, f"does not belong to a {name}; remove it"


def either(*keys: str) -> dict[str, frozenset[str]]:
    """The rivals of keys of which a table has one."""
    return {key: frozenset(keys) - {key} for key in keys}


def raise_disagreements(model: type[BaseModel], faults: Sequence[tuple[Key, Any, str]]) -> None:
    """Raise pydantic's ValidationError with each (key, value, what is wrong), where there are any."""
    details = [
        InitErrorDetails(type=refusal(text, "disagreement"), loc=tuple(key), input=value)  # type: ignore[typeddict-item]
        for key, value, text in faults
    ]
    if details:
        raise ValidationError.from_exception_data(model.__name__, details)


def known(*values: object) -> bool:
    """Whether no value is None, which stands for a value with a fault of its own."""
    return all(value is not None for value in values)
