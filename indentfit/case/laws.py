"""The law that a [material] table asks for: an installed class, a class in a file, or a typed energy."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from pathlib import Path

from indentfit.material import Material, load, typed


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


@functools.cache
def _installed(name: str) -> type[Material]:
    return load(name)


def plugin_file(model: str | None, folder: Path) -> Path | None:
    """The file of a model given as file.py:Class, relative to the case; None for an installed model."""
    file, colon, _ = (model or "").rpartition(":")
    return (folder / file).resolve() if colon and file.endswith(".py") else None
