"""Tests without an indenter: a specimen in simple shear, or under uniaxial or biaxial stretch, whose state is homogeneous.

Strains and stresses count positive both in tension and in compression; `test.loading` says which of the two it is. The strain of a
test in shear is the amount of shear.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from indentfit.arrays import Array
from indentfit.axes import INDENTATION, MOTION, Axes
from indentfit.material import HomogeneousState

if TYPE_CHECKING:
    from indentfit.case.tables import Test

OF_INDENTATIONS = ("angle", "dip", "record", "depth", "rate", "ramp", "hold", "control", "force", "sample", "indenter", "field")
OF_SPECIMENS = ("fibres", "families", "loading", "ratio", "area", "length", "diameter", "plates", "strain", "stress")
OF_DISCS = ("diameter", "plates")
TALLEST = 2.0  # height of a bonded disc, in diameters
ARTICLE = {
    "indentation": "an indentation",
    "shear": "a shear test",
    "uniaxial": "a uniaxial test",
    "biaxial": "a biaxial test",
    "compression": "a compression between plates",
}


@dataclass(frozen=True)
class BondedDisc:
    """A disc between plates to which it is bonded, whose state is not homogeneous (`fem.compression`).

    Parameters
    ----------
    diameter, height : float, mm
    """

    diameter: float
    height: float


@dataclass(frozen=True)
class Specimen:
    """A specimen under a load.

    Parameters
    ----------
    state : HomogeneousState or BondedDisc
    area : float, mm^2
        Area on which the force acts; 1 where stresses are measured.
    length : float, mm
        Length that the displacement is a share of; 1 where strains are measured.
    """

    state: HomogeneousState | BondedDisc
    area: float = 1.0
    length: float = 1.0

    @property
    def words(self) -> str:
        """The state in words."""
        state = self.state
        if isinstance(state, BondedDisc):
            return "compression between bonded plates"
        if state.kind == "shear":
            return "simple shear"
        ratio = f", ratio of strains {state.ratio:g}" if state.kind == "biaxial" and state.ratio != 1 else ""
        return f"{state.kind} {'tension' if state.sign > 0 else 'compression'}{ratio}"

    def strains(self, displacement: Array) -> Array:
        """Strains (n,) at displacements (n,), mm."""
        return displacement / self.length


def specimen_of(test: Test) -> Specimen | None:
    """The Specimen of a test; None for an indentation."""
    if test.kind == "indentation" or test.kind == "field":
        return None
    if test.kind == "compression":
        return _disc_of(test)
    sign = -1 if test.loading == "compression" else 1
    state = HomogeneousState(test.kind, test.fibres or "along", sign, 1.0 if test.ratio is None else test.ratio, test.cauchy)
    state = replace(state, families=test.families) if test.families is not None else state
    return Specimen(state, test.area or 1.0, test.length or 1.0)


def _disc_of(test: Test) -> Specimen:
    """A disc between plates; the state of one that slides on them is homogeneous."""
    diameter, height, fibres = test.diameter or 1.0, test.length or 1.0, test.fibres or "along"
    state = HomogeneousState("uniaxial", fibres, -1, families=test.families)
    return Specimen(state if test.plates == "sliding" else BondedDisc(diameter, height), math.pi * diameter**2 / 4, height)


def axes_of(test: Test) -> Axes:
    """What the curve of a test shows."""
    if test.kind == "indentation":
        return INDENTATION
    if test.kind == "field":
        return MOTION
    if test.kind == "compression":
        return INDENTATION
    return Axes("strain" if test.length is None else "displacement", "stress" if test.area is None else "force")


def loading_of(test: Test) -> str:
    """How the specimen of a test is loaded, for the reader of its curve; empty for an indentation."""
    if test.kind == "compression":
        return "compression"
    return "" if test.kind in ("indentation", "field") else test.loading or ("shear" if test.kind == "shear" else "tension")


def disagreements(test: Test) -> Iterator[tuple[str, str]]:
    """(key, what is wrong) of keys that do not go with the kind of a test."""
    given, name = test.model_fields_set, ARTICLE.get(test.kind or "", "a test of this kind")
    if test.kind is None:
        return
    for key in OF_SPECIMENS if test.kind == "indentation" else OF_INDENTATIONS:
        if key in given and dict(test)[key] != ():  # a list that stays empty is as good as none
            yield key, f"does not belong to {name}; {REMEDY.get(key, 'remove it, or give test.kind')}"
    if test.kind == "indentation":
        return
    yield from _of_disc(test)
    if test.kind == "compression":
        return
    if test.kind == "shear" and "loading" in given:
        yield "loading", "does not belong to a shear test, which has no tension or compression; remove it"
    if test.kind != "shear" and "loading" not in given:
        yield "loading", f"missing; {name} is in tension or in compression: give which"
    if test.kind != "biaxial" and "ratio" in given:
        yield "ratio", f"does not belong to {name}; remove it"
    if test.kind == "uniaxial" and test.fibres == "normal":
        yield "fibres", "must be 'along' or 'across' in a uniaxial test, which has no plane"
    if test.families is not None and test.fibres == "normal":
        yield "fibres", "must be 'along' or 'across' with two families, which lie in the plane of shear or of two stretches"
    if test.cauchy and test.area is not None:
        yield "stress", "the curve holds forces, because test.area is given; remove one of the two keys"
    if test.loading == "compression" and test.strain is not None and test.strain >= 1:
        yield "strain", "must be below 1 in compression: the stretch, 1 - strain, must stay above 0"


def _of_disc(test: Test) -> Iterator[tuple[str, str]]:
    """(key, what is wrong) of the keys of a disc between plates."""
    given, name = test.model_fields_set, ARTICLE.get(test.kind or "", "a test of this kind")
    if test.kind != "compression":
        yield from ((key, f"does not belong to {name}; remove it") for key in OF_DISCS if key in given)
        return
    for key, meaning in (("diameter", "the diameter of the disc"), ("length", "the height of the undeformed disc")):
        if key not in given:
            yield key, f"missing; give {meaning}, mm"
    if "plates" not in given:
        yield (
            "plates",
            "missing; say whether the disc slides on the plates or is bonded to them (several times stiffer)",
        )
    for key in ("area", "ratio", "stress"):
        if key in given:
            text = {"area": "follows from the diameter", "ratio": f"does not belong to {name}"}.get(key, "the curve holds forces")
            yield key, f"{text}; remove it"
    if test.loading == "tension":
        yield "loading", "plates compress; remove it, or give kind = 'uniaxial'"
    if test.fibres == "normal":
        yield "fibres", "must be 'along' (the axis of the disc) or 'across' it"
    if test.plates == "bonded" and test.fibres is not None:
        yield "fibres", "fibres in a bonded disc are not solved: they buckle, or break its symmetry; give sliding plates"
    if test.plates == "bonded" and test.families is not None:
        yield "families", "two families of fibres break the symmetry of a bonded disc, and are not solved; give sliding plates"
    if test.plates == "bonded" and test.length and test.diameter and test.length > TALLEST * test.diameter:
        text = f"must be at most {TALLEST:g} diameters: a taller bonded disc may buckle, which is not solved; give sliding plates"
        yield "length", text
    if test.strain is not None and test.strain >= 1:
        yield "strain", "must be below 1: the stretch, 1 - strain, must stay above 0"


REMEDY = {
    "families": "give sample.families",
    "angle": "give test.fibres: along, across or normal",
    "dip": "give test.fibres: along, across or normal",
    "depth": "give test.strain",
    "record": "give test.curve (indentfit process FILE makes one of a record)",
    "sample": "give test.area and test.length where forces and displacements were measured",
    "rate": "such a test is elastic here; remove it",
    "ramp": "such a test is elastic here; remove it",
    "hold": "such a test is elastic here; remove it",
    "control": "such a test is elastic here; remove it",
    "indenter": "remove it: no indenter touches the specimen",
    "field": "displacements are measured beside an indentation; remove it",
}
