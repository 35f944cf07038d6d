"""The law that a [material] table asks for: an installed class, a class in a file, or a typed energy.

Also its parameters by the law's own names, where the table gives Young's modulus."""

from __future__ import annotations

import functools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from indentfit.case.fibre_file import TURNED_BLOCK
from indentfit.case.materials import LayersChoice, MaterialChoice
from indentfit.case.tables import Mesh, Range, Sample
from indentfit.errors import CaseError, MaterialError
from indentfit.fibre_map import FibreMap
from indentfit.fibres import Direction, Families, Kept
from indentfit.material import (
    FIRST_FAMILY,
    SECOND_FAMILY,
    Layered,
    Material,
    exchangeable,
    laws_of,
    layered,
    load,
    sharing,
    trial_values,
    typed,
)
from indentfit.samples import Circle

YOUNG = "young"  # the word for Young's modulus among the parameters
OF_FIBRES = {*FIRST_FAMILY, *SECOND_FAMILY}  # invariants that depend on a direction
TRIALS = 3  # sets of parameters at which the shear modulus is compared with a parameter


def open_law(model: str | None, energy: str | None, names: Sequence[str], folder: Path) -> type[Material]:
    """The class of a material.

    Parameters
    ----------
    model : str or None
        Name of an installed material, or file.py:Class relative to `folder`; None where the table has an energy.
    energy : str or None, kPa
        Formula of the energy.
    names : sequence of str
        Parameters of the energy.
    folder : path

    Returns
    -------
    class of Material

    Raises
    ------
    MaterialError, OSError
        The class cannot be found or loaded, or the energy cannot be used.
    """
    if energy is not None:
        return typed(energy, tuple(names))
    assert model is not None  # a [material] table has a model or an energy
    if plugin := plugin_file(model, folder):
        return load(f"{plugin}:{model.rpartition(':')[2]}")
    return _installed(model)


def law_of_choice(choice: MaterialChoice, folder: Path) -> type[Material]:
    """The class that a table [material] asks for, or that of the materials of layers; raises as `open_law` does."""
    if isinstance(choice, LayersChoice):
        return layered({layer.name: law_of_choice(layer.choice, folder) for layer in choice.layers})
    return sharing(open_law(choice.model, choice.energy, tuple(choice.parameters), folder), choice.shared)


@functools.cache
def _installed(name: str) -> type[Material]:
    return load(name)


def plugin_file(model: str | None, folder: Path) -> Path | None:
    """The file of a model given as file.py:Class, relative to the case; None for an installed model."""
    file, colon, _ = (model or "").rpartition(":")
    return (folder / file).resolve() if colon and file.endswith(".py") else None


def plugin_files(choice: MaterialChoice, folder: Path) -> dict[str, Path]:
    """Model as the case names it -> its file, of each law that the case takes from a file."""
    models = [layer.model for layer in choice.layers] if isinstance(choice, LayersChoice) else [choice.model]
    return {model: file for model in models if model and (file := plugin_file(model, folder))}


def has_fibres(law: type[Material]) -> bool:
    """Whether the energy depends on the direction of fibres."""
    return bool(OF_FIBRES & set(law.invariants))


def kept_by(law: type[Material], mesh: Mesh, fibres: Direction) -> Kept:
    """The part of the sample that decides on the rest in a test, as far as its fibres and the wish of the mesh matter: tests with
    the same part can share a mesh."""
    if not has_fibres(law):
        return "quarter"
    return "whole" if mesh.symmetry == "whole" else fibres.kept


def families_of(law: type[Material], sample: Sample) -> Families | None:
    """The two families of fibres of a sample; None for a law without a second family, or where the sample does not tell them."""
    if not law.two_families or sample.families is None:
        return None
    first, second = zip(sample.families, sample.family_dips or (0.0, 0.0), strict=True)
    return first, second


def fibres_in(choice: MaterialChoice, law: type[Material], sample: Sample, direction: Direction) -> Direction:
    """The direction of the fibres in a test, as the sample has them, of the one that the test states.

    Raises
    ------
    CaseError
        The test would turn a block on which directions were measured.
    """
    if isinstance(sample.directions, FibreMap) and has_fibres(law):
        if direction.angle % 180 and not isinstance(sample.geometry.outline, Circle):
            raise CaseError([f"test.angle = {direction.angle:g}: {TURNED_BLOCK}"])
        return direction.on(sample.directions, sample.fibre_angle)
    turned = direction.turned(sample.fibre_angle)
    families = families_of(law, sample)
    if families is None:
        return turned
    fixed = {name: value for name, value in choice.parameters.items() if not isinstance(value, Range)}
    alike = (_exchangeable(part, _of_layer(name, part, fixed)) for name, part in laws_of(law).items())  # type: ignore[arg-type]
    return replace(turned, families=families, alike=all(alike))


def _of_layer(name: str, law: type[Material], fixed: Mapping[str, float]) -> tuple[tuple[str, float], ...]:
    """The fixed parameters of a layer by their own names; of a sample without layers, those of its material."""
    whole = {f"{name}.{own}" if name else own: own for own in law.parameters}
    return tuple((whole[key], value) for key, value in fixed.items() if key in whole)


@functools.cache
def _exchangeable(law: Any, fixed: tuple[tuple[str, float], ...]) -> bool:
    return exchangeable(law, fixed)


def shear_parameter(law: type[Material]) -> str | None:
    """The parameter that is the small-strain shear modulus itself, whatever the values of the others; None for a law without one,
    and for a law with fibres, which has several shear moduli."""
    return None if has_fibres(law) or issubclass(law, Layered) else _shear_parameter(law)  # type: ignore[arg-type]


@functools.cache
def _shear_parameter(law: Any) -> str | None:
    rng = np.random.default_rng(0)
    names = set(law.parameters)
    try:
        for _ in range(TRIALS):
            material = law(**trial_values(law.parameters, rng))
            names = {name for name in names if abs(material.values[name] / material.shear_modulus - 1) < 1e-9}
    except (MaterialError, ArithmeticError):
        return None
    return next(iter(names), None) if len(names) == 1 else None


def own_parameters(choice: MaterialChoice, law: type[Material]) -> dict[str, float | Range]:
    """The parameters of a [material] table by the names of the law: `young` becomes the shear modulus."""
    given = choice.parameters
    if isinstance(choice, LayersChoice):
        own = {layer.name: own_parameters(layer.choice, laws_of(law)[layer.name]) for layer in choice.layers}
        return {f"{name}.{parameter}": value for name, values in own.items() for parameter, value in values.items()}
    if YOUNG not in given or YOUNG in law.parameters:
        return given
    name = shear_parameter(law)
    if name is None or name in given:
        return given
    others = {key: value for key, value in given.items() if key != YOUNG}
    return {**others, name: _shear_moduli(choice, given[YOUNG])}


def _shear_moduli(choice: MaterialChoice, young: float | Range) -> float | Range:
    """The shear modulus, or its range, of Young's modulus or the range of Young's modulus."""
    if not isinstance(young, Range):
        return choice.shear_modulus_of(young)
    start, low, high = (choice.shear_modulus_of(value) for value in (young.start, young.min, young.max))
    return Range.model_construct(start=start, min=low, max=high)


def isotropic_moduli(choice: MaterialChoice, law: type[Material], values: Mapping[str, float]) -> dict[str, float]:
    """Small-strain moduli of a material without fibres: the shear modulus where no parameter is it, E, both in kPa, and nu. The
    shear modulus is called mu, but G where the law has another parameter mu, as that of Arruda and Boyce has.

    Parameters
    ----------
    choice : MaterialChoice
        It says how compressible the material is.
    law : class of Material
    values : mapping of the law's parameters to values

    Returns
    -------
    dict of str to float
        Empty for a material with fibres, which has no single Young's modulus. Those of a layer are called LAYER.E and so on.
    """
    if isinstance(choice, LayersChoice):
        return dict(_moduli_of_layers(choice, law, values))
    if has_fibres(law):
        return {}
    mu = law(**{name: values[name] for name in law.parameters}).shear_modulus
    nu = choice.poisson_ratio_at(mu)
    own = {} if shear_parameter(law) else {"G" if "mu" in law.parameters else "mu": mu}
    return {**own, "E": 2 * mu * (1 + nu), "nu": nu}


def _moduli_of_layers(choice: LayersChoice, law: type[Material], values: Mapping[str, float]) -> Iterator[tuple[str, float]]:
    for layer in choice.layers:
        own = {name.partition(".")[2]: value for name, value in values.items() if name.startswith(f"{layer.name}.")}
        moduli = isotropic_moduli(layer.choice, laws_of(law)[layer.name], own)
        yield from ((f"{layer.name}.{name}", value) for name, value in moduli.items())
