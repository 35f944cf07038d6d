"""The case that `indentfit init` writes for one indenter and a user's own files: only the keys that this user needs.

Sizes that only the experimenter knows are written as "?", which every command refuses with the key, its unit and its meaning.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from indentfit import indenters
from indentfit.case.keys import KeyFacts, keys
from indentfit.case.quantities import ASKED
from indentfit.case.template import row, toml_value
from indentfit.errors import InputError, suggestion
from indentfit.shapes import keys_of, needed_by

SCHEMA = "case.schema.json"
HEAD = """\
#:schema ./{schema}
# A case for indentfit. Put your value where "?" stands, then, in this folder:
#     indentfit validate     every error at once
#     indentfit simulate     the curves at the start values, beside the measured ones
#     indentfit fit          the parameters
#
# Plain lengths are in mm, forces in mN, moduli in kPa; a string may carry another unit: "330 um", "1490 Pa".
# More keys: `indentfit guide`, page "Keys of a case file".
"""
SHORT = {  # what a beginner needs to know of a key, in place of its whole meaning
    "sample.shape": '"disc", or "block" with length and width in place of diameter',
    "sample.base": '"bonded" (glued, grown, cast), "sliding", or "unknown": a fit then tries both',
    "indenter.friction": 'a coefficient (0: none), "stick", or "unknown": a fit then goes over 0 to 1, with more runs',
    "indenter.edge_radius": "mm: radius of the edge; 0 is sharp",
    "indenter.radius": "mm: radius of the sphere; or diameter = ...",
    "material.model": "`indentfit materials` lists the laws; `indentfit materials NAME` describes one",
    "material.poisson_ratio": 'Poisson\'s ratio; or bulk_ratio = "unknown", which a fit then goes over',
    "material.bulk_ratio": 'bulk modulus over shear modulus; or "unknown": a fit then goes over 20 to 5000',
    "material.relaxation.terms": "exponentials that are fitted, with their times; more where the misfit of the hold asks for them",
    "test.angle": "degrees from the indenter's long side to the fibres: 0 along it, 90 across it",
    "test.curve": "displacement and force in a CSV file, relative to this file",
    "test.record": "the instrument's own file, relative to this file, read as [record] says",
    "test.depth": 'mm: depth to simulate; for a fit put curve = "my.csv" in its place',
}
RELAXATION = "material.relaxation"
HELD = "the stress relaxes in time: the fit follows ramp, hold and rate"
ROUNDED = ("edge_radius", "tip_radius")  # sharp, until the user says otherwise
ONE_OF = (  # forms of one number, of which a case has one
    ("indenter.radius", "indenter.diameter"),
    ("material.poisson_ratio", "material.bulk_ratio", "material.kappa"),
    ("sample.layer.poisson_ratio", "sample.layer.bulk_ratio"),
)


@dataclass(frozen=True)
class OwnTest:
    """A test of the case: its name, and its curve or raw record, a file's name; with neither it has a depth to be told."""

    name: str
    curve: str | None = None
    record: str | None = None


@dataclass(frozen=True)
class OwnLayer:
    """A layer of the sample: its name and its law, with parameters as those of an `OwnCase`."""

    name: str
    model: str
    parameters: Mapping[str, tuple[str, str]]
    fibres: bool


@dataclass(frozen=True)
class OwnCase:
    """What a user states about the case to be written.

    Attributes
    ----------
    indenter : str
        Name of a shape.
    model : str
        Name of a law, or file.py:Class.
    parameters : mapping of names to (text in TOML, comment)
    fibres : bool
        Whether the law has fibres, so that tests need an angle.
    tests : sequence of OwnTest
    told : mapping of keys, such as "sample.thickness", to values
        Keys of a layer begin with its name: "skin.thickness".
    layers : sequence of OwnLayer
        From the top one; none where the sample is one material, which is then `model`.
    held : bool
        Whether a curve has a hold or a retraction, which a fit follows where the material relaxes.
    """

    indenter: str
    model: str
    parameters: Mapping[str, tuple[str, str]]
    fibres: bool
    tests: Sequence[OwnTest]
    told: Mapping[str, Any] = field(default_factory=dict)
    layers: Sequence[OwnLayer] = ()
    held: bool = False


def starter(own: OwnCase) -> str:
    """The text of case.toml.

    Raises
    ------
    InputError
        A key that is told does not exist, or has no place in the text.
    """
    known = {facts.key: facts for facts in keys()}
    layers = tuple(f"{layer.name}." for layer in own.layers)
    for key in own.told:
        if key.startswith("sample.layer"):
            raise InputError(f"--set {key}: name the layers by --layer NAME, from the top one, and set theirs as NAME.thickness")
        if key not in known and not key.startswith(("material.parameters.", "fit.uncertain.", "record.", *layers)):
            raise InputError(f"--set {key}: no key of a case{suggestion(key, known)}; `indentfit guide` lists them")
    text = HEAD.format(schema=SCHEMA) + "\n" + "\n".join(_rows(own, known)) + "\n"
    written = tomllib.loads(text)
    written |= {layer["name"]: layer | layer["parameters"] for layer in written["sample"].get("layer", ())}
    for key in own.told:
        if not (_has(written, key) or _has(written, key.replace("material.", "material.parameters.", 1))):
            raise InputError(f"--set {key}: it has no place here; write it into the new case.toml (`indentfit guide` shows it)")
    return text


def _has(tree: Any, key: str) -> bool:
    """Whether a tree of TOML has a key, in each of the tests where it is one of theirs."""
    name, _, rest = key.partition(".")
    if isinstance(tree, list):
        return all(_has(each, key) for each in tree)
    return isinstance(tree, dict) and name in tree and (not rest or _has(tree[name], rest))


def unanswered(text: str) -> list[str]:
    """The keys of a case's text that still hold "?"."""
    table, asked = "", []
    for line in text.splitlines():
        if line.startswith("["):
            table = line.partition("]")[0].strip("[")
        elif line.partition("#")[0].rstrip().endswith(f'= "{ASKED}"'):
            asked.append(f"{table}.{line.partition(' ')[0]}")
    return asked


def _rows(own: OwnCase, known: Mapping[str, KeyFacts]) -> Iterator[str]:
    title = ", ".join([own.indenter, *(test.curve or test.record or "" for test in own.tests)]).strip(", ")
    yield f"title = {toml_value(own.told.get('title', title[:200]))}"
    yield from ("", "[sample]", *_table("sample", _of_sample(own), own.told, known))
    for n, layer in enumerate(own.layers):
        yield from _of_layer(layer, n == len(own.layers) - 1, own.told, known)
    yield from ("", "[indenter]", *_table("indenter", _of_indenter(own), own.told, known))
    if not own.layers:
        yield from ("", "[material]", *_table("material", {"model": own.model, **_bulk(own.fibres)}, own.told, known))
        yield from ("", *row("[material.parameters]", "a number is fixed; start, min and max make a parameter free"))
        for name, (value, comment) in own.parameters.items():
            told = own.told.get(f"material.parameters.{name}", own.told.get(f"material.{name}"))
            yield from row(f"{name} = {value if told is None else toml_value(told)}", comment)
        yield from _of_relaxation(own, known)
    for test in own.tests:
        yield from ("", "[[test]]", *_table("test", _of_test(test, own), own.told, known))
    yield from _further_tables(own, known)


def _of_relaxation(own: OwnCase, known: Mapping[str, KeyFacts]) -> Iterator[str]:
    """The table of a material that relaxes, where the user tells a key of it or a curve asks for it."""
    told = [key for key in own.told if key.startswith(f"{RELAXATION}.")]
    if told or own.held:
        given = {f"{RELAXATION}.g", f"{RELAXATION}.tau"} & set(told)
        values = {"base": "long_term", **({} if given else {"terms": 1})}
        yield from ("", *row(f"[{RELAXATION}]", HELD), *_table(RELAXATION, values, own.told, known))


def _bulk(fibres: bool) -> dict[str, Any]:
    return {"bulk_ratio": 1000} if fibres else {"poisson_ratio": 0.499}


def _of_layer(layer: OwnLayer, last: bool, told: Mapping[str, Any], known: Mapping[str, KeyFacts]) -> Iterator[str]:
    """The table of a layer, with its parameters."""
    own = {f"sample.layer{key.removeprefix(layer.name)}": value for key, value in told.items() if key.startswith(f"{layer.name}.")}
    values = {"name": layer.name, "thickness": ASKED, **({} if last else {"interface": "bonded"}), "model": layer.model}
    yield from ("", "[[sample.layer]]", *_table("sample.layer", {**values, **_bulk(layer.fibres)}, own, known))
    yield from row("[sample.layer.parameters]", f"called {layer.name}.{next(iter(layer.parameters))} by commands and results")
    for name, (value, comment) in layer.parameters.items():
        asked = own.get(f"sample.layer.parameters.{name}", own.get(f"sample.layer.{name}"))
        yield from row(f"{name} = {value if asked is None else toml_value(asked)}", comment)


def _of_sample(own: OwnCase) -> dict[str, Any]:
    sizes = ("length", "width") if own.told.get("sample.shape") == "block" else ("diameter",)
    return {"shape": "disc", **dict.fromkeys((*sizes, "thickness", "base"), ASKED)}


def _of_indenter(own: OwnCase) -> dict[str, Any]:
    """The keys that the shape needs, its edge's or tip's radius where it has one, and friction."""
    shape: Any = indenters.SHAPES.find(own.indenter)
    sizes = {"radius": ASKED} if shape.end == "sphere" else {key: ASKED for key in keys_of(shape) if key in needed_by(shape)}
    rounded = {key: 0 for key in keys_of(shape) if key in ROUNDED}
    return {"shape": own.indenter, **sizes, **rounded, "friction": "unknown"}


def _of_test(test: OwnTest, own: OwnCase) -> dict[str, Any]:
    source = {"curve": test.curve, "record": test.record}
    given = {key: value for key, value in source.items() if value}
    if not given and not {"test.curve", "test.record"} & set(own.told):
        given = {"depth": ASKED}
    return {"name": test.name, **({"angle": ASKED} if own.fibres else {}), **given}


def _table(table: str, values: Mapping[str, Any], told: Mapping[str, Any], known: Mapping[str, KeyFacts]) -> Iterator[str]:
    """The keys of a table with what the user has told, each with a comment; a key of which another form is told is left out."""
    further = {key.removeprefix(f"{table}."): value for key, value in told.items() if key.startswith(f"{table}.")}
    further = {key: value for key, value in further.items() if "." not in key and f"{table}.{key}" in known}
    others = {key for forms in ONE_OF for key in forms if not {*forms}.isdisjoint({*told} - {key})}
    for key, value in {**values, **further}.items():
        if f"{table}.{key}" in others and f"{table}.{key}" not in told:
            continue
        facts = known[f"{table}.{key}"]
        unit = f"{facts.unit}: " if facts.unit else ""
        yield from row(f"{key} = {toml_value(value)}", SHORT.get(facts.key, f"{unit}{facts.meaning}"))


def _further_tables(own: OwnCase, known: Mapping[str, KeyFacts]) -> Iterator[str]:
    """Tables of which the user has told keys, and those that a record needs."""
    for table in ("mesh", "fit", "solver"):
        if lines := list(_table(table, {}, own.told, known)):
            yield from ("", f"[{table}]", *lines)
    if any(test.record for test in own.tests):
        yield from (
            "",
            *row("[record]", "how the record is read; most files need no key: `indentfit process FILE` shows what is read"),
        )
        told = {key.partition(".")[2]: value for key, value in own.told.items() if key.startswith("record.")}
        yield from (f"{key} = {toml_value(value)}" for key, value in told.items())
        if not told:
            yield '# displacement = { column = "Depth", unit = "um" }'
            yield '# force = { column = "Load", unit = "uN" }'
    yield ""
    yield "# How well are inputs known? Uncertain ones widen the intervals as they should."
    uncertain = {key.removeprefix("fit.uncertain."): v for key, v in own.told.items() if key.startswith("fit.uncertain.")}
    yield "[fit.uncertain]" if uncertain else "# [fit.uncertain]"
    yield from (f"{key} = {toml_value(value)}" for key, value in uncertain.items())
    for key, value in (("thickness", 0.1), ("offset", 0.01)):
        if key not in uncertain:
            yield from row(f"# {key} = {value}", f"mm, a standard deviation: {known[f'fit.uncertain.{key}'].meaning.split(';')[0]}")
