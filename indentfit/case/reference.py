"""The reference of the case file, generated from its tables: a page of all keys, and a JSON schema for editors."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

from pydantic.json_schema import models_json_schema

from indentfit.case.keys import SECTIONS, TABLES, KeyFacts, facts_of_keys
from indentfit.case.section import Section
from indentfit.case.tables import Test

NEEDED = ("test",)  # material unless the sample has layers, sample and indenter where a test is an indentation
QUANTITY = {"type": "string", "description": "a number with its unit, such as 1490 Pa"}
INTRODUCTION = """\
# Keys of a case file

A case is a TOML file. Lengths are in mm, forces in mN, pressures and moduli in kPa; where a key has a unit, a string may carry
another one: `"330 um"`, `"1490 Pa"`. A key without a default in a table that a case needs must be given; `--set TABLE.KEY=VALUE`
replaces any key. `title` is text on one line, and changes no result.
"""


def reference_page() -> str:
    """A Markdown page of all keys: unit, default, what a key can be, and its meaning."""
    return INTRODUCTION + "\n" + "\n".join(row for model in TABLES for row in _table(model, model.place))


def json_schema() -> dict[str, Any]:
    """The JSON schema of a case file, for editors."""
    models: list[type[Section]] = [*SECTIONS.values(), Test]
    _, schema = models_json_schema([(model, "validation") for model in models], ref_template="#/$defs/{model}")
    definitions = _without_null(schema["$defs"])
    for name in ("MaterialChoice", "Layer"):
        definitions[name]["properties"]["parameters"]["additionalProperties"]["anyOf"].append(QUANTITY)
    tables: dict[str, Any] = {name: {"$ref": f"#/$defs/{model.__name__}"} for name, model in SECTIONS.items()}
    tables["test"] = {"type": "array", "minItems": 1, "items": {"$ref": "#/$defs/Test"}}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "Case of indentfit",
        "type": "object",
        "properties": {"title": {"type": "string", "maxLength": 200}, **tables},
        "required": list(NEEDED),
        "anyOf": [{"required": ["material"]}, {"required": ["sample"], "properties": {"sample": {"required": ["layer"]}}}],
        "additionalProperties": False,
        "$defs": definitions,
    }


def _without_null(schema: Any) -> Any:
    """A schema without null, which TOML does not have."""
    if isinstance(schema, list):
        return [_without_null(inner) for inner in schema if inner != {"type": "null"}]
    if not isinstance(schema, dict):
        return schema
    inner = {name: _without_null(value) for name, value in schema.items() if not (name == "default" and value is None)}
    alternatives = inner.get("anyOf")
    if isinstance(alternatives, list) and len(alternatives) == 1:
        return {name: value for name, value in inner.items() if name != "anyOf"} | alternatives[0]
    return inner


def _table(model: type[Section], place: str, several: bool = False) -> Iterator[str]:
    """The rows of a table, and of the tables inside of it."""
    keys = [key for key in facts_of_keys(model, place) if key.table == place]
    yield f"## [[{place}]]" if several or model is Test else f"## [{place}]"
    yield from ("", " ".join((model.__doc__ or "").split("\n\n")[0].split()), "")
    yield from ("| key | unit | default | values | meaning |", "|---|---|---|---|---|")
    yield from (_row(key) for key in keys)
    yield ""
    for key in keys:
        if key.inner:
            yield from _table(key.inner, key.key, key.several)


def _row(key: KeyFacts) -> str:
    default = "needed" if key.required else "" if key.default in (None, {}) else f"`{json.dumps(key.default)}`"
    values = key.kind + (f", {key.limits}" if key.limits else "")
    return f"| `{key.name}` | {key.unit} | {default} | {values} | {key.meaning} |"
