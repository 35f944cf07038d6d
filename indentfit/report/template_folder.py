"""The folder that `indentfit init` writes: a commented case with example curves, or one for an indenter and a user's files."""

import json
import re
import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from indentfit import indenters
from indentfit.case.keys import keys
from indentfit.case.laws import YOUNG, has_fibres, open_law, shear_parameter
from indentfit.case.reference import json_schema
from indentfit.case.starter import SCHEMA, OwnCase, OwnLayer, OwnTest, starter, unanswered
from indentfit.case.template import template, toml_value
from indentfit.curve import Curve, not_loading_only, read_curve, write_curve
from indentfit.errors import InputError, OutputError
from indentfit.material import Material
from indentfit.shapes import keys_of
from indentfit.study.law_ranges import usual_range

STIFFNESS = {"parallel": 72.9, "perpendicular": 170.5}  # mN/mm, means of Feng et al. 2017
WITH_FIBRES, WITHOUT = "transversely_isotropic", "neo_hookean"
LAYER_NAME = re.compile("[A-Za-z][A-Za-z0-9_]{0,39}")
TABLES = ("sample", "indenter", "material", "mesh", "solver", "test", "fit", "record")
USUAL_MODULUS = 10.0  # kPa, shear modulus of soft tissue where nothing is known
DECADES = 1000.0  # by which a modulus may be larger or smaller than where a search of unknown stiffness starts
NEAR = 30.0  # the same, where the curve and the sizes tell the stiffness roughly


@dataclass(frozen=True)
class Asked:
    """What a user asks `init` for.

    Attributes
    ----------
    indenter : str
        Name of a shape.
    curves, records : paths of files, which are copied into the folder
    material : str or None
        None for the usual law: with fibres under an indenter with a long side.
    told : mapping of keys, such as "sample.thickness", to values
    layers : sequence of (name, law or None)
        Layers of the sample, from the top one; None for the usual law.
    """

    indenter: str
    curves: Sequence[Path] = ()
    records: Sequence[Path] = ()
    material: str | None = None
    told: Mapping[str, Any] | None = None
    layers: Sequence[tuple[str, str | None]] = ()


def write_template(folder: str | Path) -> Path:
    """Write case.toml with every key, and the curves that it names.

    Parameters
    ----------
    folder : path
        The folder must be new or empty.

    Returns
    -------
    Path
        The case file.

    Raises
    ------
    OutputError
        The folder holds something, or cannot be written.
    """
    displacement = np.round(0.33 * np.arange(1, 26) / 25, 6)
    curves = {name: Curve(displacement, np.round(stiffness * displacement, 6)) for name, stiffness in STIFFNESS.items()}
    folder = Path(folder)
    _require_free(folder)
    try:
        (folder / "curves").mkdir(parents=True, exist_ok=True)
        _write(folder, f"#:schema ./{SCHEMA}\n{template()}")
        for name, curve in curves.items():
            write_curve(folder / "curves" / f"{name}.csv", curve)
    except OSError as error:
        raise OutputError(f"{folder}: cannot be written ({error.strerror}); choose another folder") from error
    return folder / "case.toml"


def write_own_case(folder: str | Path, asked: Asked) -> tuple[Path, list[str]]:
    """Write case.toml for one indenter, and copies of the user's files beside it.

    Parameters
    ----------
    folder : path
        The folder must be new or empty.
    asked : Asked

    Returns
    -------
    Path
        The case file.
    list of str
        The keys that the user has to fill in.

    Raises
    ------
    OutputError
        The folder holds something, or cannot be written.
    InputError
        A curve cannot be read, a law is not known, or a key that is told does not exist.
    """
    folder, text = Path(folder), _text(asked)
    _require_free(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        _write(folder, text)
        for file in (*asked.curves, *asked.records):
            shutil.copyfile(file, folder / file.name)
    except OSError as error:
        raise OutputError(f"{folder}: cannot be written ({error.strerror}); choose another folder") from error
    return folder / "case.toml", unanswered(text)


def _write(folder: Path, text: str) -> None:
    (folder / "case.toml").write_text(text, encoding="utf-8", newline="\n")
    (folder / SCHEMA).write_text(json.dumps(json_schema(), indent=1) + "\n", encoding="utf-8", newline="\n")


def _text(asked: Asked) -> str:
    told, curves = dict(asked.told or {}), [read_curve(file) for file in asked.curves]
    _require_files(asked)
    shape = indenters.SHAPES.find(asked.indenter)
    long = shape is not None and "length" in keys_of(shape)
    model = asked.material or str(told.get("material.model") or (WITH_FIBRES if long else WITHOUT))
    law = open_law(model, None, (), Path())
    tests = [OwnTest(name, curve=file.name) for name, file in _names(asked.curves)]
    tests += [OwnTest(name, record=file.name) for name, file in _names(asked.records)]
    modulus = _modulus(asked.indenter, told, curves)
    layers = [_layer(name, own or model, modulus) for name, own in asked.layers]
    _require_layers(asked)
    parameters = dict(_parameters(law, modulus))
    told = {key: value for key, value in told.items() if key != "material.model"}
    fibres = any(layer.fibres for layer in layers) if layers else has_fibres(law)
    held = not layers and any(curve.time is not None and not_loading_only(curve) for curve in curves)
    return starter(OwnCase(asked.indenter, model, parameters, fibres, tests or [OwnTest("press")], told, layers, held))


def _layer(name: str, model: str, modulus: float | None) -> OwnLayer:
    """A layer of a law; by the laws of its own shear modulus, since no table of layers takes Young's."""
    law = open_law(model, None, (), Path())
    return OwnLayer(name, model, dict(_parameters(law, modulus, young=False)), has_fibres(law))


def _require_layers(asked: Asked) -> None:
    """Refuse layers that no case can have, before anything is written."""
    names = [name for name, _ in asked.layers]
    for n, name in enumerate(names):
        if not LAYER_NAME.fullmatch(name):
            raise InputError(f"--layer {name}: a layer's name is a letter, then letters, digits or _; at most 40")
        if name in names[:n] or name in TABLES:
            raise InputError(
                f"--layer {name}: {'twice' if name in names[:n] else 'a table of a case has that name'}; choose another"
            )


def _require_files(asked: Asked) -> None:
    """Refuse records that are not there, and two files of one name, of which one would be lost."""
    files = [*asked.curves, *asked.records]
    for n, file in enumerate(files):
        if not file.is_file():
            raise InputError(f"{file}: no such file; check the path")
        if file.name in [other.name for other in files[:n]]:
            raise InputError(f"{file}: another file is called {file.name} too; rename one of them")


def _names(files: Sequence[Path]) -> list[tuple[str, Path]]:
    return [(file.stem[:60].strip() or "press", file) for file in files]


def _parameters(law: type[Material], modulus: float | None, young: bool = True) -> Iterator[tuple[str, tuple[str, str]]]:
    """Each parameter of a law with its range in TOML and a comment; Young's modulus where it is the only one."""
    if young and list(law.parameters) == [shear_parameter(law)]:
        start = 3 * (modulus or USUAL_MODULUS)
        yield YOUNG, (_range(*_about(start, NEAR if modulus else DECADES)), "kPa: Young's modulus")
        return
    for name, parameter in law.parameters.items():
        bounds = usual_range(law, name, modulus or USUAL_MODULUS)
        text = _range(bounds.start, bounds.min, bounds.max)
        if parameter.scale:  # found exactly, whatever the range
            text = _range(*_about(modulus or USUAL_MODULUS, NEAR if modulus else DECADES))
        unit = f"{parameter.unit}: " if parameter.unit not in ("", "1") else ""
        yield name, (text, f"{unit}{parameter.meaning}")


def _about(value: float, factor: float) -> tuple[float, float, float]:
    start = float(f"{value:.2g}")
    return start, float(f"{start / factor:.2g}"), float(f"{start * factor:.2g}")


def _range(start: float, low: float, high: float) -> str:
    return toml_value({"start": start, "min": low, "max": high})


def _modulus(indenter: str, told: Mapping[str, Any], curves: Sequence[Curve]) -> float | None:
    """The shear modulus, kPa, of a half-space under a flat punch as wide as the contact: right within a factor of a few. None where
    the curve or the sizes of the indenter are not told."""
    sizes: dict[str, Any] = {"shape": indenter}
    for facts in keys():
        value = told.get(facts.key)
        if facts.table == "indenter" and isinstance(value, int | float) and not isinstance(value, bool):
            sizes[facts.name] = float(value)
    if "radius" in sizes:
        sizes["diameter"] = 2 * sizes["radius"]
    shape = indenters.SHAPES.make(sizes)
    if shape is None or not curves:
        return None
    deepest = int(np.argmax(curves[0].displacement))
    depth, force = float(curves[0].displacement[deepest]), float(curves[0].force[deepest])
    contact = shape.partition(depth)
    half_length = getattr(contact, "half_length", contact.half_width)
    return force / (8 * depth * float(np.sqrt(contact.half_width * min(half_length, 20 * contact.half_width))))


def _require_free(folder: Path) -> None:
    """Refuse a folder with something in it: nothing is ever overwritten."""
    try:
        if folder.exists() and not folder.is_dir():
            raise OutputError(f"{folder}: a file has that name; choose another folder")
        if folder.is_dir() and any(folder.iterdir()):
            raise OutputError(f"{folder}: the folder exists and is not empty; choose another one")
    except (OSError, ValueError) as error:
        raise OutputError(f"{folder}: cannot be used ({error}); choose another folder") from error
