"""Writing a case that was made from values to files: case.toml, its curves, and the file of its material."""

from __future__ import annotations

import shutil
from pathlib import Path, PurePath
from typing import Any

import tomli_w

from indentfit.case.curves import file_for
from indentfit.case.laws import plugin_files
from indentfit.case.whole import Case
from indentfit.curve import write_curve
from indentfit.displacements import write_displacements
from indentfit.errors import OutputError
from indentfit.fibre_map import FibreMap, write_fibre_map


def case_toml(case: Case) -> str:
    """The text of a case file with the same content as a case; the text names the files of curves and does not hold them.

    Parameters
    ----------
    case : Case

    Returns
    -------
    str
    """
    return tomli_w.dumps(case_tree(case))


def case_tree(case: Case) -> dict[str, Any]:
    """The tables of a case as a file holds them, without keys that have their default value."""
    excluded = {"path", "overrides", "curves"}
    tree = case.without_fields.model_dump(mode="json", by_alias=True, exclude_defaults=True, exclude=excluded)
    if case.sample.layer:
        tree.pop("material")  # it is that of the layers
    for place, (name, _) in maps_of(case).items():
        table = tree["sample"] if place is None else tree["test"][place]["sample"]
        table["directions"] = name
    return {name: table for name, table in _without_none(tree).items() if table != {}}


def maps_of(case: Case) -> dict[int | None, tuple[str, FibreMap]]:
    """The directions of fibres on points: of the case (None) or the number of a test -> the name of the file and the map. Maps that
    differ have names that differ."""
    tables: dict[int | None, Any] = {None: case.sample}
    tables |= {n: test.sample for n, test in enumerate(case.without_fields.tests)}
    maps = {place: table.directions for place, table in tables.items() if table and isinstance(table.directions, FibreMap)}
    names: dict[str, FibreMap] = {}
    for fibres in maps.values():
        path, number = PurePath(fibres.file), 1
        while names.get(name := fibres.file if number == 1 else f"{path.with_suffix('')}-{number}{path.suffix}", fibres) != fibres:
            number += 1
        names[name] = fibres
    of_map = {fibres: name for name, fibres in names.items()}
    return {place: (of_map[fibres], fibres) for place, fibres in maps.items()}


def write_case(case: Case, folder: str | Path) -> Path:
    """Write case.toml, the curves that it names, and the file of the material; the written case has the same hash.

    Parameters
    ----------
    case : Case
    folder : path

    Returns
    -------
    Path
        The path of case.toml.

    Raises
    ------
    OutputError
        The folder cannot be written.
    """
    case = case.without_fields
    folder, tree, taken = Path(folder), case_tree(case), set[str]()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for test, curve in zip(tree["test"], case.curves, strict=True):
            if curve is not None:
                test.pop("record", None)  # the curve that the record became is written
                test["curve"] = file_for(test["name"], taken)
                (folder / test["curve"]).parent.mkdir(parents=True, exist_ok=True)
                write_curve(folder / test["curve"], curve)
        for test, given in zip(tree["test"], case.tests, strict=True):
            for table, field in zip(test.get("field", ()), given.field, strict=True):
                table["name"], table["file"] = field.label, file_for(f"{given.name}-{field.label}", taken)
                (folder / table["file"]).parent.mkdir(parents=True, exist_ok=True)
                write_displacements(folder / table["file"], field.points)
        for place, (name, fibres) in maps_of(case).items():
            table = tree["sample"] if place is None else tree["test"][place]["sample"]
            table["directions"] = file_for(PurePath(name).stem, taken)
            (folder / table["directions"]).parent.mkdir(parents=True, exist_ok=True)
            write_fibre_map(folder / table["directions"], fibres)
        for model, plugin in plugin_files(case.material, case.folder).items():
            (folder / "plugins").mkdir(parents=True, exist_ok=True)
            shutil.copyfile(plugin, folder / "plugins" / plugin.name)
            for table in (tree.get("material", {}), *tree["sample"].get("layer", ())):
                if table.get("model") == model:
                    table["model"] = f"plugins/{plugin.name}:{model.rpartition(':')[2]}"
        (folder / "case.toml").write_text(tomli_w.dumps(tree), encoding="utf-8", newline="\n")
    except OSError as error:
        raise OutputError(f"{folder}: cannot be written ({error.strerror}); choose another folder") from error
    return folder / "case.toml"


def _without_none(value: Any) -> Any:
    """Tables without the keys whose value is None."""
    if isinstance(value, dict):
        return {key: _without_none(inner) for key, inner in value.items() if inner is not None}
    return [_without_none(inner) for inner in value] if isinstance(value, list) else value
