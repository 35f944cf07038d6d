"""Reading a case file into a `Case`: TOML, overrides, units, and every fault at once.

Quantities are plain numbers in the unit that the reference of keys states, or strings with a unit ("3.3 mm"). Reading runs no code
that a case names. A caller that needs the material's class, and the curves of raw records, passes `Openers` (experiment.measured).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Protocol, TypeVar

from pydantic import TypeAdapter, ValidationError

from indentfit.case.empty_tables import faults_of_empty_tables
from indentfit.case.families import faults_of_families
from indentfit.case.faults import (
    Parts,
    faults_across,
    faults_of_absence,
    faults_of_fibres,
    faults_of_parameters,
    faults_of_stiffness,
    faults_of_turn,
    labels,
    own_table,
)
from indentfit.case.field_faults import faults_of_fields
from indentfit.case.keys import SECTIONS
from indentfit.case.laws import YOUNG
from indentfit.case.layers import OF_LAYERS, label_of, named, tables_of_layers, with_materials
from indentfit.case.materials import LayersChoice
from indentfit.case.messages import MISSING, Fault, Key, key_of, line, unknown, wording
from indentfit.case.overrides import Tree, override, table_of, tests_of
from indentfit.case.recording import Record
from indentfit.case.section import Section
from indentfit.case.specimen import loading_of
from indentfit.case.tables import MaterialChoice, Test
from indentfit.case.toml import tree_of
from indentfit.case.unknown import with_priors
from indentfit.case.whole import Case
from indentfit.case.write import case_tree, maps_of
from indentfit.curve import Curve, read_curve
from indentfit.displacements import Displacements, read_displacements
from indentfit.errors import CaseError, CurveError, MaterialError, RecordError
from indentfit.fibre_map import FibreMap, read_fibre_map
from indentfit.material import Layered, Material, layered, sharing
from indentfit.units import number_in

KEYS = ("title", *SECTIONS, "test")
NEEDED = ("sample", "indenter", "material")
OF_INDENTER = ("sample", "indenter")  # needed where a test is an indentation
SPECIMENS = ("compression", "shear", "uniaxial", "biaxial")
OPTIONAL = ("mesh", "fit", "solver", "record")
Table = TypeVar("Table", bound=Section)


class Openers(Protocol):
    """Opens the class of the material and the raw records that a case names."""

    def law(self, model: str | None, energy: str | None, names: Sequence[str], folder: Path) -> type[Material]:
        """The class of a material; raises MaterialError or OSError."""

    def curve(self, file: Path, record: Record, timed: bool = False) -> Curve:
        """The curve of a raw record, read as the table [record] says: the loading, or with times the ramp and the hold; raises
        RecordError."""


def read_case_file(path: str | Path, overrides: Sequence[str] = (), openers: Openers | None = None) -> Case:
    """The `Case` of a TOML file, with `overrides` in place of its keys.

    Parameters
    ----------
    path : path
        The case file; names of other files in it are relative to its folder.
    overrides : sequence of str
        KEY=VALUE, such as "indenter.friction=0.2".
    openers : Openers or None
        With None, no plugin and no raw record is opened: the parameters are not compared with the material's and must be plain
        numbers, and the curve of a test with a raw record is None.

    Returns
    -------
    Case

    Raises
    ------
    CaseError
        The error's text has one line for each fault: file, key, value, what is wrong and what to do.
    """
    path = Path(path)
    tree = tree_of(path)
    given, faults = override(tree, overrides)
    faults += faults_of_empty_tables(tree)
    parts = _parts(tree, Sources(path.parent, openers), faults)
    _raise(faults, path, tree, given)
    return Case.of_parts(parts, path, overrides)


def override_case(case: Case, overrides: Sequence[str], openers: Openers | None = None) -> Case:
    """The case with `overrides` in place of its keys.

    Parameters
    ----------
    case : Case
        A case that was read from a file: the file is read again with the case's own overrides and these. Or a case that was
        made from values, whose curves are kept.
    overrides, openers
        As `read_case_file` takes them.

    Returns
    -------
    Case

    Raises
    ------
    CaseError
        The error's text has one line for each fault.
    """
    if case.path is not None:
        return read_case_file(case.path, (*case.overrides, *overrides), openers)
    tree = case_tree(case)
    curves = {
        test.curve: curve for test, curve in zip(case.tests, case.curves, strict=True) if isinstance(test.curve, str) and curve
    }
    fields = {own.points.file: own.points for test in case.tests for own in test.field}
    maps = dict(maps_of(case).values())
    given, faults = override(tree, overrides)
    parts = _parts(tree, Sources(case.folder, openers, curves, fields, maps), faults)
    _raise(faults, None, tree, given)
    return Case.of_parts(parts, None, ())


@dataclass(frozen=True)
class Sources:
    """Where a case finds what it names: the folder of its files, openers of materials and records, and curves in memory."""

    folder: Path
    openers: Openers | None = None
    curves: Mapping[str, Curve] = field(default_factory=dict)
    fields: Mapping[str, Displacements] = field(default_factory=dict)
    maps: Mapping[str, FibreMap] = field(default_factory=dict)

    def fibres(self, name: str) -> FibreMap:
        """The directions of fibres in a file, or those of a map in memory that is called so."""
        return self.maps[name] if name in self.maps else replace(read_fibre_map(self.folder / name), file=name)

    def displacements(self, name: str, outline: bool) -> Displacements:
        if name in self.fields:
            return self.fields[name]
        return replace(read_displacements(self.folder / name, outline), file=name)

    def curve(self, name: str, loading: str) -> Curve:
        return self.curves[name] if name in self.curves else read_curve(self.folder / name, loading)


def read_record_table(path: str | Path | None, overrides: Sequence[str] = ()) -> Record:
    """The [record] table of a TOML file.

    Parameters
    ----------
    path : path or None
        A case file, or a file with this table alone; with None the table is made of the overrides.
    overrides : sequence of str
        KEY=VALUE.

    Returns
    -------
    Record

    Raises
    ------
    CaseError
        The error's text has one line for each fault.
    """
    tree = tree_of(Path(path)) if path is not None else {"record": {}}
    if "record" not in tree:
        raise CaseError([f"{path}: there is no table [record]; begin with the line [record], and call its tables [record.force]"])
    tree = {"record": tree["record"]}
    given, faults = override(tree, overrides)
    faults += [Fault((key,), tree[key], "only keys of [record] can be set here") for key in tree if key != "record"]
    table = _section(Record, ("record",), tree["record"], faults)
    if faults or table is None:
        raise CaseError([line(path or "options", fault, given) for fault in faults])
    return table


def _raise(faults: list[Fault], path: Path | None, tree: Tree, given: set[Key]) -> None:
    """Raise a CaseError with a line for each fault, where there are any."""
    if not faults:
        return
    names, layers = dict(enumerate(labels(_names(tests_of(tree))))), tables_of_layers(tree)
    given = {named(key, layers) for key in given}
    given = {tuple(names[step] if isinstance(step, int) else step for step in key) for key in given}
    faults = [fault._replace(key=named(fault.key, layers)) for fault in faults]
    raise CaseError(list(dict.fromkeys(line(path, fault, given) for fault in faults)))


# Tables


def _parts(tree: Tree, sources: Sources, faults: list[Fault]) -> Parts:
    """The parts of a case that can be read; the faults of the others are appended to `faults`."""
    faults += [Fault((key,), tree[key], unknown(key, KEYS, sections=SECTIONS)) for key in tree if key not in KEYS]
    title = _title(tree, faults)
    law = _laws_of_layers(tree, sources, faults) if tables_of_layers(tree) else _law(table_of(tree, "material"), sources, faults)
    if not tables_of_layers(tree):
        _convert_parameters(table_of(tree, "material"), law, faults)
    absent = [name for name in OF_INDENTER if name not in tree and not _asks_for_indenter(tree)]
    sections: dict[str, Any] = {name: SECTIONS[name].untouched() for name in absent}
    sections |= {
        name: _section(model, (name,), _keys(tree, name), faults)
        for name, model in SECTIONS.items()
        if name not in absent and not (name == "material" and name not in tree and tables_of_layers(tree))
    }
    sections["sample"] = sample = _with_map(sections.get("sample"), ("sample",), sources, faults)
    sections = with_materials({"material": None, **sections}, (sample and sample.layer) or ())
    tests = [keys for keys in tests_of(tree) if isinstance(keys, dict) and keys.get("kind") not in SPECIMENS]
    sections = with_priors(sections, tests)
    parts = Parts(title, **sections)  # type: ignore[arg-type]
    faults += _faults_of_material(parts.material, law, faults)
    parts = parts.with_tests(*_tests_and_curves(tree, sources, parts, faults))
    faults += [*faults_of_turn(parts.fit, law), *faults_of_fibres(parts.material, law, parts.tests)]
    named = list(zip(labels([test and test.name for test in parts.tests]), parts.tests, strict=True))
    faults += faults_of_families(parts.material, law, parts.sample, named)
    if not _asks_for_indenter(tree):
        faults += faults_of_absence(parts, tree)
    faults += [*faults_across(parts), *faults_of_fields(parts)]
    return parts


def _asks_for_indenter(tree: Tree) -> bool:
    """Whether a test is an indentation, or may be one."""
    tests = tests_of(tree)
    return not tests or any(not isinstance(keys, dict) or keys.get("kind", "indentation") not in SPECIMENS for keys in tests)


def _keys(tree: Tree, name: str) -> Any:
    return tree.get(name, MISSING if name in NEEDED else {})


def _title(tree: Tree, faults: list[Fault]) -> str:
    title = tree.get("title", "")
    if not isinstance(title, str) or len(title) > 200 or (title and not title.isprintable()):
        faults.append(Fault(("title",), title, "must be text on one line of at most 200 characters"))
    return title


def _record_of(test: Test | None, parts: Parts) -> Record | None:
    """The table [record] for a test, with the end of the test's indenter where the table does not state it."""
    indenter = own_table(parts.indenter, test.indenter) if test and test.kind == "indentation" else None
    shape = indenter.geometry_if_right() if indenter else None
    if parts.record is None or parts.record.indenter is not None or shape is None or shape.end == "flat":
        return parts.record
    return parts.record.model_copy(update={"indenter": shape.end})


def _section(model: type[Table], place: Key, keys: Any, faults: list[Fault]) -> Table | None:
    """One table as its model; a key that has a fault is None."""
    if keys is MISSING:
        faults.append(Fault(place, MISSING, f"missing; add a table [{place[0]}]"))
        return None
    if not isinstance(keys, dict):
        faults.append(Fault(place, keys, f"must be a table; write [{place[0]}]"))
        return None
    if not keys and place[0] in OPTIONAL:
        return model.untouched()
    try:
        return model.model_validate(keys)
    except ValidationError as error:
        wrong = error.errors(include_url=False)
    known = {fault.key for fault in faults}
    for flaw in wrong:
        inner = key_of(flaw)
        value = flaw["input"] if inner[-1] in _inmost(keys, inner) else MISSING
        if (*place, *inner) not in known:
            faults.append(Fault((*place, *inner), value, wording(model, flaw, SECTIONS)))
    part = _what_is_right(model, keys, {str(flaw["loc"][0]) for flaw in wrong})
    if not any(flaw["type"] == "disagreement" and len(flaw["loc"]) == 1 for flaw in wrong):
        faults += [Fault((*place, key), keys.get(key, MISSING), text) for key, text in part.disagreements()]
    return part


def _inmost(keys: Any, steps: Key) -> dict[Any, Any]:
    """The table that holds the last step."""
    for step in steps[:-1]:
        inner = keys[step] if isinstance(keys, list) and isinstance(step, int) and step < len(keys) else {}
        keys = keys.get(step, {}) if isinstance(keys, dict) else inner
    return keys if isinstance(keys, dict) else {}


def _what_is_right(model: type[Table], keys: Tree, wrong: set[str]) -> Table:
    """The keys that are each correct, in a model that was not checked as a whole."""
    values: dict[str, Any] = dict.fromkeys(model.model_fields)
    for key, info in model.model_fields.items():
        if key in wrong:
            continue
        if key in keys:
            kind: Any = Annotated[(info.annotation, key, *info.metadata)]  # the key only fills an empty list
            values[key] = TypeAdapter(kind).validate_python(keys[key])
        elif not info.is_required():
            values[key] = info.get_default(call_default_factory=True)
    return model.model_construct(_fields_set=set(keys), **values)


# The material


def _laws_of_layers(tree: Tree, sources: Sources, faults: list[Fault]) -> type[Material] | None:
    """The class of the materials of layers, whose parameters are converted; None where one of them cannot be opened."""
    laws, tables = {}, tables_of_layers(tree)
    for number, keys in enumerate(tables):
        if not isinstance(keys, dict):
            continue
        place = (*OF_LAYERS, number)
        laws[label_of(tables, number)] = law = _law(keys, sources, faults, place)
        _convert_parameters(keys, law, faults, place)
    known = {name: law for name, law in laws.items() if law is not None}
    return layered(known) if len(known) == len(tables) else None


def _law(keys: Tree, sources: Sources, faults: list[Fault], place: Key = ("material",)) -> type[Material] | None:
    """The class that a [material] table asks for; None without openers, and with a fault where the class cannot be opened."""
    model, energy, parameters = keys.get("model"), keys.get("energy"), keys.get("parameters")
    if sources.openers is None or (model is None) == (energy is None):
        return None
    key, named = ("model", model) if energy is None else ("energy", energy)
    if not isinstance(named, str) or not named.strip() or not named.isprintable():
        return None
    try:
        law = sources.openers.law(model, energy, tuple(parameters) if isinstance(parameters, dict) else (), sources.folder)
    except (MaterialError, OSError) as error:
        faults.append(Fault((*place, key), named, str(error)))
        return None
    return _shared(keys.get("shared"), law, faults, place)


def _shared(names: Any, law: type[Material], faults: list[Fault], place: Key) -> type[Material] | None:
    """The law with the parameters that its families share; None, with a fault, where they cannot share them."""
    if not isinstance(names, (list, tuple)) or not all(isinstance(name, str) for name in names):
        return law  # left out, or a fault that the table itself tells
    try:
        return sharing(law, tuple(names))
    except MaterialError as error:
        faults.append(Fault((*place, "shared"), list(names), str(error)))
        return None


def _convert_parameters(material: Tree, law: type[Material] | None, faults: list[Fault], where: Key = ("material",)) -> None:
    """Turn strings with a unit among the parameters of a material into numbers in the law's unit."""
    parameters = material.get("parameters")
    if not isinstance(parameters, dict):
        return
    for name, value in parameters.items():
        unit = law.parameters[name].unit or "kPa" if law and name in law.parameters else "kPa" if name == YOUNG else None
        table, keys = (value, tuple(value)) if isinstance(value, dict) else (parameters, (name,))
        for key in keys:
            if not isinstance(table[key], str):
                continue
            try:
                table[key] = _number(unit, table[key])
            except ValueError as error:
                place = (*where, "parameters", name) + ((key,) if table is value else ())
                faults.append(Fault(place, table[key], str(error)))
                table[key] = MISSING


def _number(unit: str | None, text: str) -> float:
    """The number of a parameter; without the law the parameter's unit is unknown, and a text with a unit is refused."""
    if unit is None:
        raise ValueError("has a unit, but the material that could tell the parameter's own unit is not opened; give a plain number")
    return number_in(unit, text)


def _faults_of_material(choice: MaterialChoice | None, law: type[Material] | None, known: Iterable[Fault]) -> list[Fault]:
    """Faults of the parameters; where these have none, faults of the stiffness that the parameters give."""
    if law is None or choice is None or issubclass(law, Layered) != isinstance(choice, LayersChoice):
        return []
    faults = list(faults_of_parameters(choice, law))
    if faults or any(fault.key[0] == "material" or fault.key[:2] == OF_LAYERS for fault in known):
        return faults
    return list(faults_of_stiffness(choice, law))


# Tests and curves


def _tests_and_curves(
    tree: Tree, sources: Sources, parts: Parts, faults: list[Fault]
) -> tuple[list[Test | None], list[Curve | None]]:
    tables = tree.get("test", MISSING)
    if tables is MISSING or tables == []:
        faults.append(Fault(("test",), MISSING, "missing; add a table [[test]] for each test"))
        return [], []
    if not isinstance(tables, list):
        faults.append(Fault(("test",), tables, "must be a list of tables; write [[test]] in double brackets"))
        return [], []
    tests, curves = [], []
    for label, keys in zip(labels(_names(tables)), tables, strict=True):
        test = _with_fields(_section(Test, ("test", label), keys, faults), label, sources, faults)
        tests.append(test)
        timed = parts.material is not None and parts.material.relaxation is not None
        curves.append(_curve(test, label, _record_of(test, parts), timed, sources, faults) if test else None)
    return tests, curves


def _with_map(sample: Any, place: Key, sources: Sources, faults: list[Fault]) -> Any:
    """The sample, of a case or a test, with the directions of its fibres in the place of their file."""
    if sample is None or not isinstance(sample.directions, str):
        return sample
    try:
        return sample.with_key("directions", sources.fibres(sample.directions))
    except CurveError as error:
        faults.append(Fault((*place, "directions"), sample.directions, str(error)))
        return sample


def _with_fields(test: Test | None, label: str, sources: Sources, faults: list[Fault]) -> Test | None:
    """The test with the displacements of its fields, and the directions of its sample's fibres, in the place of their files."""
    if test is None:
        return test
    if test.sample is not None:
        test = test.model_copy(update={"sample": _with_map(test.sample, ("test", label, "sample"), sources, faults)})
    if not test.field:
        return test
    read = []
    for own in test.field:
        try:
            points = sources.displacements(own.file, own.outline) if isinstance(own.file, str) else own.file
        except CurveError as error:
            faults.append(Fault(("test", label, "field", "file"), own.file, str(error)))
            continue
        read.append(own.model_copy(update={"file": points}))
    return test.model_copy(update={"field": tuple(read)})


def _names(tables: Sequence[Any]) -> list[Any]:
    return [keys.get("name") if isinstance(keys, dict) else None for keys in tables]


def _curve(test: Test, label: str, record: Record | None, timed: bool, sources: Sources, faults: list[Fault]) -> Curve | None:
    """The curve of a test from its file or raw record; None where the test names neither, or the file cannot be read."""
    try:
        if test.record and record and not any(fault.key[0] == "record" for fault in faults):
            return sources.openers.curve(sources.folder / test.record, record, timed) if sources.openers else None
        return sources.curve(test.curve, loading_of(test)) if isinstance(test.curve, str) else None
    except (RecordError, CurveError) as error:
        key = "record" if isinstance(error, RecordError) else "curve"
        faults.append(Fault(("test", label, key), getattr(test, key), str(error)))
        return None
