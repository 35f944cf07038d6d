"""The materials of a layered sample as one: parameters are called LAYER.PARAMETER, and each point of a body has its layer's law."""

import functools
from collections.abc import Mapping
from typing import Any, ClassVar, cast

import numpy as np

from indentfit.arrays import Array, Ints
from indentfit.errors import MaterialError
from indentfit.material.kinematics import families
from indentfit.material.model import Material


class Layered(Material):
    """The materials of a layered sample, the top one first. It has no energy of its own: a body asks `placed` for the laws of its
    points. Its moduli are those of the top layer, which the indenter touches.

    Attributes
    ----------
    laws : mapping of a layer's name to the class of its material
    parts : tuple of Material
        The materials of the layers.
    """

    laws: ClassVar[Mapping[str, type[Material]]] = {}
    parts: tuple[Material, ...]

    def __init__(self, **values: float) -> None:
        super().__init__(**values)
        parts = (law(**{own: values[f"{name}.{own}"] for own in law.parameters}) for name, law in self.laws.items())
        self.__dict__["parts"] = tuple(parts)

    @property
    def shear_modulus(self) -> float:
        return self.parts[0].shear_modulus

    def moduli(self) -> dict[str, float]:
        return self.parts[0].moduli()

    def young_modulus(self, fibres: Array, axis: Array) -> float:
        return self.parts[0].young_modulus(fibres if self.parts[0].two_families else families(fibres)[0], axis)

    @property
    def unstable(self) -> str:
        """The small-strain moduli of all layers that are not positive, in words; empty where all layers are stable."""
        pairs = ((name, part.unstable) for name, part in zip(self.laws, self.parts, strict=True))
        return "; ".join(f"{name}: {wrong}" for name, wrong in pairs if wrong)

    @classmethod
    def place_of(cls, name: str) -> tuple[int, str]:
        """The number of the layer that a parameter belongs to, and the parameter's name in the layer's law."""
        for number, layer in enumerate(cls.laws):
            if name.startswith(f"{layer}."):
                return number, name[len(layer) + 1 :]
        raise MaterialError(f"no layer has a parameter {name!r}")

    def placed(self, layer: Ints) -> Material:
        """What a body asks of a material, at points (n,) of which the numbers of their layers are known."""
        return cast(Material, _Placed(self, layer))


class _Placed:
    """Materials at the integration points of a body. Arrays of invariants are (k, n), in the order of the points."""

    def __init__(self, material: Layered, layer: Ints) -> None:
        self._material, self._points = material, [np.flatnonzero(layer == n) for n in range(len(material.parts))]
        self.shear_modulus, self.two_families = material.shear_modulus, material.two_families

    def gradient(self, I: Array) -> Array:
        out = np.empty_like(I)
        for part, points in zip(self._material.parts, self._points, strict=True):
            n = len(part.rest)  # a layer whose law has one family knows nothing of the second
            out[:n, points], out[n:, points] = part.gradient(I[:n, points]), 0.0
        return out

    def hessian(self, I: Array) -> Array:
        out = np.zeros((len(I), *I.shape))
        for part, points in zip(self._material.parts, self._points, strict=True):
            n = len(part.rest)
            out[:n, :n, points] = part.hessian(I[:n, points])
        return out

    def parameter_gradient(self, I: Array) -> Array:
        out, first = np.zeros((len(self._material.parameters), *I.shape)), 0
        for part, points in zip(self._material.parts, self._points, strict=True):
            n = len(part.rest)
            own = part.parameter_gradient(I[:n, points])
            out[first : first + len(own), :n, points] = own
            first += len(own)
        return out


def layered(laws: Mapping[str, type[Material]]) -> type[Layered]:
    """The class of the materials of a layered sample.

    Parameters
    ----------
    laws : mapping of a layer's name to the class of its material
        The top layer first.

    Returns
    -------
    class of Layered
        Within one process, the same layers give the same class.
    """
    return _class_of(tuple((name, *vars(law).get("_source", (law,))) for name, law in laws.items()))


@functools.cache
def _class_of(sources: tuple[tuple[Any, ...], ...]) -> type[Layered]:
    """The class of layers, each a name and where a pickle finds its law: the class, or a function with its arguments."""
    laws: dict[str, type[Material]] = {name: source if not rest else source(*rest) for name, source, *rest in sources}
    invariants = dict.fromkeys(invariant for law in laws.values() for invariant in law.invariants)
    words = "; ".join(f"{name}: {' '.join((law.__doc__ or '').split())}" for name, law in laws.items())
    cls: type[Layered] = type("Layers", (Layered,), {"__doc__": words, "laws": laws, "_source": (_class_of, sources)})
    cls.parameters = {f"{name}.{own}": known for name, law in laws.items() for own, known in law.parameters.items()}
    cls.invariants = tuple(invariants)
    cls.two_families = any(law.two_families for law in laws.values())
    cls.perpendicular = any(law.perpendicular for law in laws.values())
    return cls


def parts_of(material: Material) -> tuple[Material, ...]:
    """The materials of the layers, or the one material of a sample without layers."""
    return material.parts if isinstance(material, Layered) else (material,)


def laws_of(law: type[Material]) -> dict[str, type[Material]]:
    """Name -> law of the layers; with an empty name the one law of a sample without layers."""
    return dict(law.laws) if issubclass(law, Layered) else {"": law}
