"""The commented case that `indentfit init` writes: every key with an example, its unit, choices and meaning, from the tables."""

from __future__ import annotations

import json
import textwrap
from collections.abc import Iterator, Mapping
from typing import Any

from indentfit.case.keys import TABLES, KeyFacts, facts_of_keys
from indentfit.case.section import Section
from indentfit.case.tables import MaterialChoice, Test
from indentfit.material import load

WIDTH = 120
COLUMN = 34  # where comments begin
HEAD = """\
# A case for indentfit. Change it to your experiment, then:
#     indentfit validate case.toml     every error at once
#     indentfit simulate case.toml     curves at the start values
#     indentfit fit case.toml          the parameters
#
# Lengths are in mm, forces in mN, pressures and moduli in kPa; a string may carry another unit: "330 um", "1490 Pa".
# A key that is commented out has a default, or is an alternative to another key.

title = ""
"""
RANGES = {"mu": (1, 0.1, 10), "zeta": (3, 0, 20), "phi": (1, 0, 5)}
START: dict[str, dict[str, Any]] = {  # the keys that are not commented out: a disc pressed by a sharp strip
    "sample": {"shape": "disc", "diameter": 14, "thickness": 3.3, "base": "sliding"},
    "indenter": {"shape": "strip", "width": 2, "length": 20, "edge_radius": 0, "friction": 0.5},
    "material": {"model": "transversely_isotropic", "bulk_ratio": 1000},
    "test": {"name": "parallel", "angle": 0, "curve": "curves/parallel.csv"},
    "fit": {"method": "ga", "seed": 0},
}
SECOND_TEST = {"name": "perpendicular", "angle": 90, "curve": "curves/perpendicular.csv"}
OPTIONAL = ("record",)  # tables that are commented out as a whole


def template() -> str:
    """The text of case.toml; its two curves are curves/parallel.csv and curves/perpendicular.csv."""
    return HEAD + "\n" + "\n".join(line for model in TABLES for line in _table(model))


def _table(model: type[Section]) -> Iterator[str]:
    """A table with all its keys, and an empty line below it."""
    behind = "# " if model.place in OPTIONAL else ""
    start, keys = START.get(model.place, {}), [key for key in facts_of_keys(model) if key.table == model.place]
    yield from comment_lines((model.__doc__ or "").split("\n\n")[0])
    yield f"{behind}[[test]]" if model is Test else f"{behind}[{model.place}]"
    for key in keys:
        if not key.kind.startswith("table") and not key.inner:
            yield from _key(key, start.get(key.name), behind)
    for key in keys:
        if key.inner and behind:
            yield from row(f"# {key.name} = {toml_value(key.example)}", key.meaning)
        elif key.inner:
            yield from ("", *_inner(key.inner, key.several))
        elif key.kind == "table" and model is not MaterialChoice:
            yield from (
                "",
                *row(f"# [{key.key}]", key.meaning),
                *(f"# {name} = {toml_value(value)}" for name, value in key.example.items()),
            )
    if model is MaterialChoice:
        yield from ("", *_parameters())
    if model is Test:
        yield from ("", "[[test]]", *(f"{name} = {toml_value(value)}" for name, value in SECOND_TEST.items()))
    yield ""


def _inner(model: type[Section], several: bool) -> Iterator[str]:
    """A table inside of another, commented out; `several`: it is one of a list."""
    yield from comment_lines((model.__doc__ or "").split("\n\n")[0])
    yield f"# [[{model.place}]]" if several else f"# [{model.place}]"
    for key in facts_of_keys(model):
        yield from _key(key, None, "# ")


def _parameters() -> Iterator[str]:
    """The parameters of the material of the template, with the unit and the meaning that the material gives them."""
    yield from row("[material.parameters]", "a number is fixed; start, min and max make it free")
    for name, parameter in load(START["material"]["model"]).parameters.items():
        start, low, high = RANGES[name]
        unit = f"{parameter.unit}, " if parameter.unit not in ("", "1") else ""
        yield from row(f"{name} = {{ start = {start}, min = {low}, max = {high} }}", f"{unit}{parameter.meaning}")


def _key(key: KeyFacts, value: Any, behind: str) -> Iterator[str]:
    """One key: with the value of the template, or commented out with its example."""
    text = f"{key.name} = {toml_value(key.example if value is None else value)}"
    unit = f"{key.unit}: " if key.unit else ""
    options = f"; one of {', '.join(map(str, key.choices))}" if key.choices else ""
    default = f"; by default {toml_value(key.default)}" if key.default is not None and key.default != key.example else ""
    yield from row(text if value is not None else f"# {text}", f"{unit}{key.meaning}{options}{default}")


def row(text: str, comment: str) -> Iterator[str]:
    """A line with a comment beside it, continued below; the comment stands above a long line."""
    if len(text) + len(comment) > WIDTH - 3 and len(text) >= COLUMN:
        yield from (*comment_lines(comment), text)
        return
    first, *rest = textwrap.wrap(comment, WIDTH - COLUMN - 2)
    yield f"{text:<{COLUMN - 1}} # {first}"
    yield from (f"{'#':<{COLUMN}}  {line}" for line in rest)


def comment_lines(text: str) -> Iterator[str]:
    yield from (f"# {line}" for line in textwrap.wrap(" ".join(text.split()), WIDTH))


def toml_value(value: Any) -> str:
    """A value as TOML writes it."""
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{name} = {toml_value(inner)}" for name, inner in value.items()) + " }"
    if isinstance(value, float) and not isinstance(value, bool):
        return f"{value:g}"
    return json.dumps(list(value) if isinstance(value, tuple) else value, ensure_ascii=False)
