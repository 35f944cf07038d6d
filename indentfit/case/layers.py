"""The layers of a sample as a case has them: faults that only they can have, and their places in messages and overrides."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

from indentfit.case.materials import Layer, LayersChoice
from indentfit.case.messages import MISSING, Fault, Key
from indentfit.errors import suggestion

if TYPE_CHECKING:
    from indentfit.case.faults import Parts

OF_LAYERS = ("sample", "layer")  # the key that holds the list of layers


def with_materials(tables: dict[str, Any], layers: Sequence[Any]) -> dict[str, Any]:
    """Tables of a case, with the materials of its layers in place of the table [material] where it has layers."""
    if not layers or tables.get("material") is not None:
        return tables
    made = [layer if isinstance(layer, Layer) else Layer.model_validate(layer) for layer in layers]
    return {**tables, "material": LayersChoice.of(made)}


def faults_of_layers(parts: Parts) -> Iterator[Fault]:
    """Faults of what does not go with the layers of a sample."""
    sample = parts.sample
    if sample is None or not sample.layer:
        return
    if parts.material is not None and not isinstance(parts.material, LayersChoice):
        yield Fault(("material",), MISSING, "each layer has a material of its own; remove this table, or [[sample.layer]]")
    for label, test in enumerate(parts.tests):
        if test is None:
            continue
        name = test.name or str(label)
        if test.kind not in (None, "indentation"):
            text = "needs one homogeneous material, and the sample has layers; remove this test, or [[sample.layer]]"
            yield Fault(("test", name, "kind"), test.kind, text)
    if parts.fit is not None and parts.fit.prior is not None:
        for key, value in parts.fit.prior.given.items():
            text = "is the modulus of one material, and the sample has layers; give a range of the layer's parameter in its place"
            yield Fault(("fit", "prior", key), list(value), text)


def tables_of_layers(tree: dict[str, Any]) -> list[Any]:
    """The tables of layers in the tree of a file; empty where it has no list of them."""
    sample = tree.get("sample")
    layers = sample.get("layer") if isinstance(sample, dict) else None
    return layers if isinstance(layers, list) else []


def label_of(tables: Sequence[Any], number: int) -> str:
    """The name of a layer in messages: its own, or its number from the top."""
    keys = tables[number] if number < len(tables) else None
    name = keys.get("name") if isinstance(keys, dict) else None
    return name if isinstance(name, str) and name else str(number + 1)


def named(key: Key, tables: Sequence[Any]) -> Key:
    """The path of a key, with the name of a layer in place of its number."""
    if key[:2] != OF_LAYERS or len(key) < 3 or not isinstance(key[2], int):
        return key
    return (*OF_LAYERS, label_of(tables, key[2]), *key[3:])


def path_in_layers(tree: dict[str, Any], name: str) -> Key | None:
    """Steps through the tree to a key of a layer that an override names, "sample.layer.NAME.KEY" or "NAME.KEY", where KEY may be a
    parameter; None where it names no layer. Raises LookupError for the name of a layer that is none."""
    rest = name.removeprefix("sample.layer.")
    tables = tables_of_layers(tree)
    names = [label_of(tables, number) for number in range(len(tables))]
    if tables and rest != name and rest.partition(".")[0] not in names:
        raise LookupError(f"no such layer; write NAME.KEY{suggestion(rest.partition('.')[0], names)} (layers: {', '.join(names)})")
    for number in range(len(tables)):
        label, _, key = rest.partition(".")
        if label == label_of(tables, number) and key and isinstance(tables[number], dict):
            steps = tuple(key.split("."))
            known = steps[0] in Layer.model_fields
            return (*OF_LAYERS, number, *(steps if known else ("parameters", *steps)))
    return None
