"""The wording of faults: one line for each, with file, key, value, what is wrong and what to do."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, NamedTuple, get_args

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from indentfit.case.quantities import ASKED, meaning
from indentfit.errors import suggestion

Key = tuple[str | int, ...]


class Fault(NamedTuple):
    """One fault of a case: the key's path, its value, what is wrong and what to do."""

    key: Key
    value: object
    text: str


class _Missing:
    """The value of a key that is not there."""


MISSING = _Missing()


def line(source: object, fault: Fault, overridden: Iterable[Key] = ()) -> str:
    """The line of a fault: "file: key = value: what is wrong; what to do".

    Parameters
    ----------
    source : path or None
        The case file; None for a case that was made from values.
    fault : Fault
    overridden : keys
        The keys that `--set` gave.

    Returns
    -------
    str
    """
    key = ".".join(short(str(step)) for step in fault.key)
    value = "" if fault.value is MISSING else f" = {shown(fault.value)}"
    by_option = " (--set)" if any(_begins(fault.key, given) for given in overridden) else ""
    return printable(("" if source is None else f"{source}{by_option}: ") + f"{key}{value}: {fault.text}")


def lines(model: type[BaseModel], error: ValidationError, place: Key = ()) -> list[str]:
    """A line for each fault that pydantic reports of a table made in memory: a value of `model` at `place` of a case."""
    wrong = error.errors(include_url=False)
    faults = [Fault((*place, *key_of(flaw)), _given(flaw), wording(model, flaw)) for flaw in wrong if not _follows(flaw, wrong)]
    return list(dict.fromkeys(line(None, fault) for fault in faults))


def key_of(flaw: ErrorDetails) -> Key:
    """The path, as in a case file, of the key that one of pydantic's errors is about."""
    first, *rest = flaw["loc"] or ("",)
    return ("test" if first == "tests" else first), *rest


def _follows(flaw: ErrorDetails, wrong: list[ErrorDetails]) -> bool:
    """Whether an error only reports an empty list whose items all have errors of their own."""
    others = [other["loc"] for other in wrong if other is not flaw]
    return flaw["type"] == "too_short" and any(loc[: len(flaw["loc"])] == flaw["loc"] for loc in others)


def wording(model: type[BaseModel], flaw: ErrorDetails, sections: Mapping[str, type[BaseModel]] | None = None) -> str:
    """What is wrong and what to do, for one of pydantic's errors; `sections` are all tables, to one of which a key may belong."""
    kind, context, loc = flaw["type"], flaw.get("ctx", {}), flaw["loc"]
    model, key = _innermost(model, loc), str(loc[-1]) if loc else ""
    asked = model.model_fields.get(key) if flaw["input"] == ASKED else None
    if asked:
        return f"put your value in: {meaning(asked)}"
    if kind in ("fault", "disagreement"):
        return context["text"]
    if kind == "extra_forbidden":
        return unknown(key, model.model_fields, sections=sections)
    if kind == "literal_error":
        choices = re.findall(r"'(.*?)'", context["expected"])
        return f"must be {context['expected']}{suggestion(flaw['input'], choices)}"
    if isinstance(flaw["input"], float) and math.isnan(flaw["input"]):
        kind = "finite_number"  # nan is neither greater nor less than a bound: the message names the actual fault
    field = model.model_fields.get("tests" if key == "test" else key)
    wanted = f"give the {meaning(field)}" if field and field.description else "correct it"
    template = WORDS.get(kind)
    said = template.format(**{name: _plain(value) for name, value in context.items()}) if template else _first_small(flaw["msg"])
    return f"{said}; {wanted}"


WORDS = {
    "missing": "missing",
    "greater_than": "must be above {gt}",
    "greater_than_equal": "must be at least {ge}",
    "less_than": "must be below {lt}",
    "less_than_equal": "must be at most {le}",
    "finite_number": "must be a finite number",
    "float_type": "must be a number",
    "int_type": "must be a whole number",
    "int_from_float": "must be a whole number",
    "string_type": "must be text in quotes",
    "string_pattern_mismatch": "must be a letter with letters, digits and _ after it",
    "string_too_long": "must have at most {max_length} characters",
    "dict_type": "must be a table",
    "model_type": "must be a table",
    "tuple_type": "must be a list",
    "too_short": "missing",
}


def unknown(key: str, known: Iterable[str], what: str = "key", sections: Mapping[str, type[BaseModel]] | None = None) -> str:
    """Why a key is not known, and where it may belong."""
    known = list(known)
    word, reason = SAME_AS.get(key.lower(), ("", ""))
    if word in known:
        return f"unknown {what}; did you mean {word}?{reason}"
    if word == "young" and "parameters" in known:
        return f"unknown {what}; give young among [material.parameters].{reason}"
    for name, model in (sections or {}).items():
        if key in model.model_fields:
            return f"unknown {what} here; it belongs to [{name}]"
    if near := suggestion(key, known):
        return f"unknown {what}{near}"
    return f"unknown {what}; known here: {', '.join(known)}"


NU = " Poisson's ratio nu stands for bulk_ratio = 2 (1 + nu) / (3 (1 - 2 nu))"
E = " Young's modulus E stands for the shear modulus E / (2 (1 + nu))"
SAME_AS = {  # other words of the field, in small letters: (the key, its meaning)
    **dict.fromkeys(("nu", "poisson", "poissons_ratio", "poisson_s_ratio", "poissonratio", "v"), ("poisson_ratio", NU)),
    **dict.fromkeys(("e", "e0", "young", "youngs_modulus", "young_modulus", "young_s_modulus", "e_modulus"), ("young", E)),
    **dict.fromkeys(("r", "tip_r", "sphere_radius", "bead_radius", "punch_radius", "a"), ("radius", "")),
    **dict.fromkeys(("d", "dia", "radius"), ("diameter", "")),
    **dict.fromkeys(("h", "height"), ("thickness", "")),
    **dict.fromkeys(("k", "bulk", "bulk_modulus"), ("kappa", "")),
}


def shown(value: object) -> str:
    """A value in the form of TOML, on one line and short."""
    try:
        return short(json.dumps(value, ensure_ascii=False))
    except (TypeError, ValueError, RecursionError):
        return short(str(value))


def short(text: str) -> str:
    """A text, cut to a limited length."""
    return text if len(text) <= 60 else text[:57] + "..."


def printable(text: str) -> str:
    """A text with escapes in place of control characters."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def _begins(key: Key, given: Key) -> bool:
    return tuple(map(str, key))[: len(given)] == tuple(map(str, given))


def _given(flaw: ErrorDetails) -> object:
    """The value that is at fault; MISSING for a missing key, for which pydantic gives the whole table."""
    if flaw["type"] == "missing" or flaw["input"] is None or isinstance(flaw["input"], BaseModel):
        return MISSING
    return flaw["input"]


def _innermost(model: type[BaseModel], loc: Key) -> type[BaseModel]:
    """The model of the table that holds the key at `loc`."""
    for step in loc[:-1]:
        field = model.model_fields.get(str(step))
        inner = next(_models_in(field.annotation), None) if field else None
        model = inner or model
    return model


def _models_in(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for inner in get_args(annotation):
        yield from _models_in(inner)


def _plain(value: object) -> object:
    return f"{value:g}" if isinstance(value, float) else value


def _first_small(text: str) -> str:
    return f"{text[:1].lower()}{text[1:]}"
