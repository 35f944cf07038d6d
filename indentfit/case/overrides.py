"""Overrides: KEY=VALUE replaces a key of a case file."""

from __future__ import annotations

import functools
import tomllib
from collections.abc import Sequence
from typing import Any

from indentfit import indenters, samples
from indentfit.case.layers import path_in_layers
from indentfit.case.messages import Fault, Key
from indentfit.case.relaxation import Relaxation
from indentfit.case.tables import Indenter, Layer, MaterialChoice, Mesh, Test
from indentfit.errors import suggestion
from indentfit.shapes import Registry, keys_of

Tree = dict[str, Any]

WITH_RIVALS = Indenter, Layer, Mesh, MaterialChoice, Relaxation, Test
RIVALS = {model.place: model.rivals for model in WITH_RIVALS}  # setting a key removes its rivals


def override(tree: Tree, overrides: Sequence[str]) -> tuple[set[Key], list[Fault]]:
    """Put each KEY=VALUE into the tree of a file.

    Parameters
    ----------
    tree : dict
        The tables of the file; changed in place.
    overrides : sequence of str

    Returns
    -------
    given : set of keys
        Paths of the keys that were set.
    faults : list of Fault
    """
    given, faults = set[Key](), []
    for text in overrides:
        name, equals, value = text.partition("=")
        if not equals or not name.strip():
            faults.append(Fault(("--set",), text, "write KEY=VALUE, such as indenter.friction=0.2"))
            continue
        try:
            key = _path_of_key(tree, name.strip())
            _put(tree, key, _value(value.strip()))
        except LookupError as error:
            faults.append(Fault((name.strip(),), _value(value.strip()), error.args[0]))
        else:
            given.add(key)
    for key in given:
        _drop_rivals(tree, key, given)
    return given, faults


def tests_of(tree: Tree) -> list[Any]:
    """The tables of tests; empty where the file has no list of them."""
    tests = tree.get("test")
    return tests if isinstance(tests, list) else []


def table_of(tree: Tree, name: str) -> Tree:
    """The table of a name; an empty one where there is none."""
    table = tree.get(name)
    return table if isinstance(table, dict) else {}


def _value(text: str) -> Any:
    """A TOML value, or else the text itself."""
    try:
        read = tomllib.loads(f"value = {text}")
    except (ValueError, RecursionError):
        return text
    return read["value"] if set(read) == {"value"} else text


def _path_of_key(tree: Tree, name: str) -> Key:
    """Steps through the tree: names of tables, and the number of a test."""
    section, _, rest = name.partition(".")
    if section == "test" and rest:
        return _path_in_test(tree, rest)
    if in_layer := path_in_layers(tree, name):
        return in_layer
    steps = tuple(name.split("."))
    if section == "material" and len(steps) > 1 and steps[1] not in MaterialChoice.model_fields:
        parameters = table_of(tree, "material").get("parameters")
        if isinstance(parameters, dict) and steps[1] in parameters:
            return "material", "parameters", *steps[1:]
    return steps


def _path_in_test(tree: Tree, rest: str) -> Key:
    tests = [test for test in tests_of(tree) if isinstance(test, dict)]
    for number, test in enumerate(tests):
        for label in (test.get("name"), str(number)):
            if isinstance(label, str) and rest.startswith(label + "."):
                steps = rest[len(label) + 1 :].split(".")
                return "test", number, *(int(step) if step.isdigit() else step for step in steps)
    if len(tests) == 1 and rest.split(".")[0] in Test.model_fields:
        return "test", 0, *rest.split(".")
    known = [str(test.get("name", number)) for number, test in enumerate(tests)]
    raise LookupError(f"no such test; write test.NAME.KEY{suggestion(rest.split('.')[0], known)}")


def _put(tree: Any, key: Key, value: Any) -> None:
    *tables, last = key
    for n, step in enumerate(tables):
        if isinstance(tree, list) and not isinstance(step, int):
            raise LookupError(f"{'.'.join(map(str, tables[:n]))} is a list, not a table; check the key")
        inner = tree.setdefault(step, {}) if isinstance(tree, dict) else tree[step]
        if isinstance(inner, int | float) and "parameters" in tables[:-1]:
            raise LookupError(f"{step} is a fixed number; set {'.'.join(map(str, tables))}={{start=..., min=..., max=...}}")
        if not isinstance(inner, dict | list):
            raise LookupError(f"{'.'.join(map(str, tables[: n + 1]))} is not a table; check the key")
        tree = inner
    if not isinstance(tree, dict):
        raise LookupError("write test.NAME.KEY=VALUE")
    tree[last] = value


def _drop_rivals(tree: Tree, key: Key, given: set[Key]) -> None:
    """Remove the keys that an override makes obsolete: mesh.elements removes mesh.size, the shape "block" a disc's diameter."""
    *tables, last = key
    try:
        table: Any = functools.reduce(lambda inner, step: inner[step], tables, tree)  # type: ignore[index]
    except (LookupError, TypeError):
        return  # another override has replaced the whole table
    if not isinstance(table, dict) or last not in table:
        return
    for rival in _rivals(_section_of(tables), str(last), table):
        if (*tables, rival) not in given:
            table.pop(rival, None)


def _section_of(tables: Sequence[str | int]) -> str:
    """The table whose keys a table has: [test.sample] has those of [sample]."""
    if tables[:2] == ["sample", "layer"]:
        return Layer.place
    if tables == ["material", "relaxation"]:
        return Relaxation.place
    own = tables[2:3] if tables[:1] == ["test"] and len(tables) > 2 else tables[:1]
    return str(own[0]) if own else ""


def _rivals(section: str, key: str, table: Tree) -> frozenset[str]:
    """The keys that contradict this key."""
    registries: dict[str, Registry[Any]] = {"sample": samples.SHAPES, "indenter": indenters.SHAPES}
    shapes = registries.get(section)
    shape = shapes.find_or_none(table[key]) if shapes is not None and key == "shape" else None
    if shapes is None or shape is None:
        return RIVALS.get(section, {}).get(key, frozenset())
    others = shapes.all_keys() - set(keys_of(shape))
    return frozenset(others.union(*(RIVALS.get(section, {}).get(other, ()) for other in others)) - set(keys_of(shape)))
