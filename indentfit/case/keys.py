"""Every key of a case file with its unit, default, choices and meaning, read from the tables: template, reference and options
of commands come from here."""

from __future__ import annotations

import types
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal, Union, get_args, get_origin

from pydantic.fields import FieldInfo

from indentfit.case.quantities import Shape, unit_of
from indentfit.case.recording import Record
from indentfit.case.search import Fit
from indentfit.case.section import Section
from indentfit.case.tables import Indenter, MaterialChoice, Mesh, Sample, Solver, Test

SECTIONS: dict[str, type[Section]] = {
    "sample": Sample,
    "indenter": Indenter,
    "mesh": Mesh,
    "material": MaterialChoice,
    "fit": Fit,
    "solver": Solver,
    "record": Record,
}
TABLES: tuple[type[Section], ...] = (Sample, Indenter, Mesh, MaterialChoice, Test, Fit, Solver, Record)
WORDS = {bool: "true or false", int: "whole number", float: "number", str: "text"}
SIGNS = {"gt": ">", "ge": ">=", "lt": "<", "le": "<="}


@dataclass(frozen=True)
class KeyFacts:
    """One key of a case file.

    Attributes
    ----------
    table, name : str
        As in [table] and `name = ...`.
    unit : str
        Unit of a plain number, empty for a pure number or text.
    choices : tuple
        The values that the key can have, where these are few.
    limits : str
        Bounds of the value, such as "> 0".
    kind, meaning : str
        Type of the value in words, and what the key stands for.
    required : bool
        Whether a case needs the key.
    default, example : Any
        None where the key has no default, or no example.
    inner : Section class or None
        The class of the key's table, where the key is a table.
    several : bool
        Whether the key is a list of such tables.
    """

    table: str
    name: str
    unit: str
    choices: tuple[Any, ...]
    limits: str
    kind: str
    meaning: str
    required: bool
    default: Any
    example: Any
    inner: type[Section] | None
    several: bool = False

    @property
    def key(self) -> str:
        """The dotted name, as `--set` takes it."""
        return f"{self.table}.{self.name}"


def keys() -> Iterator[KeyFacts]:
    """Every key, table by table; the keys of an inner table follow those of the table that holds it."""
    for model in TABLES:
        yield from facts_of_keys(model)


def facts_of_keys(model: type[Section], place: str = "") -> Iterator[KeyFacts]:
    """The keys of one table, and of the tables inside of it."""
    facts = [_facts(place or model.place, name, field) for name, field in model.model_fields.items()]
    yield from facts
    for key in facts:
        if key.inner:
            yield from facts_of_keys(key.inner, key.key)


def choices(key: str) -> tuple[Any, ...]:
    """The values that a key such as "fit.method" can have."""
    return next(facts.choices for facts in keys() if facts.key == key)


def _facts(table: str, name: str, field: FieldInfo) -> KeyFacts:
    parts = list(_parts(field))
    default = None if field.is_required() else field.get_default(call_default_factory=True)  # type: ignore[call-arg]
    inner = next((part for part in parts if isinstance(part, type) and issubclass(part, Section) and part.place != ""), None)
    inner = inner or next(
        (part for part in parts if isinstance(part, type) and type(default) is part and issubclass(part, Section)), None
    )
    shapes = next((part.shapes.names() for part in parts if isinstance(part, Shape)), ())
    return KeyFacts(
        table=table,
        name=name,
        unit=unit_of(*field.metadata, field.annotation),
        choices=shapes or _choices(field.annotation),
        limits=_limits(parts),
        kind=", ".join(f'"{name}"' for name in shapes) or _kind(field.annotation),
        meaning=field.description or "",
        required=field.is_required(),
        default=None if inner else default,
        example=field.examples[0] if field.examples else None if inner else default,
        inner=inner,
        several=inner is not None and any(get_origin(part) is tuple for part in parts),
    )


def _parts(annotation: Any) -> Iterator[Any]:
    """Everything that an annotation, or a field, is made of."""
    if isinstance(annotation, FieldInfo):
        yield from annotation.metadata
        if annotation.annotation is not None:
            yield from _parts(annotation.annotation)
        return
    yield annotation
    for inner in (*get_args(annotation), *getattr(annotation, "__metadata__", ())):
        yield from _parts(inner) if not isinstance(inner, str | int) else ()


def _choices(annotation: Any) -> tuple[Any, ...]:
    """The values of a Literal, or of an optional Literal."""
    kinds = [kind for kind in _alternatives(annotation) if kind is not type(None)]
    return get_args(kinds[0]) if len(kinds) == 1 and get_origin(kinds[0]) is Literal else ()


def _limits(parts: list[Any]) -> str:
    """The bounds of a number."""
    limits: dict[str, str] = {}
    for part in parts:
        for name, sign in SIGNS.items():
            if (bound := getattr(part, name, None)) is not None and not isinstance(part, type):
                limits.setdefault(sign, f"{sign} {bound:g}" if abs(bound) < 1e4 else f"{sign} {bound:,}")
    return ", ".join(limits.values())


def _kind(annotation: Any) -> str:
    """What kind of value a key takes, in words."""
    words = dict.fromkeys(word for kind in _alternatives(annotation) if (word := _word(kind)))
    return " or ".join(words)


def _word(kind: Any) -> str:
    origin = get_origin(kind)
    if origin is Literal:
        return ", ".join(f'"{value}"' if isinstance(value, str) else str(value) for value in get_args(kind))
    if origin is tuple:
        tables = any(isinstance(part, type) and issubclass(part, Section) for part in _parts(get_args(kind)[0]))
        return "list of tables" if tables else "list of numbers"
    if origin is dict or (isinstance(kind, type) and issubclass(kind, Section)):
        return "table"
    return WORDS.get(kind, "")


def _alternatives(annotation: Any) -> Iterator[Any]:
    """The members of a union, without their annotations."""
    if get_origin(annotation) in (Union, types.UnionType):
        for member in get_args(annotation):
            yield from _alternatives(member)
    elif hasattr(annotation, "__metadata__"):
        yield from _alternatives(annotation.__origin__)
    else:
        yield annotation
