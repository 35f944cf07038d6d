"""Points: parameters of the material, and inputs of the case that a run changes.

A point (name -> value) may name inputs that are fitted (UNITS), and keys of the case by their dotted names, such as
"sample.base": runs on another mesh or base are computed by the same workers and kept in the same ledger as all others.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from indentfit.fem.setup import Press, Setup
from indentfit.material import Material
from indentfit.runs.mechanics import indentation_of, material_of, mechanics_of, with_key
from indentfit.runs.run import Point

if TYPE_CHECKING:
    from indentfit.case import Case, Test

UNITS = {"friction": "1", "bulk_ratio": "1", "thickness": "mm", "offset": "mm", "fibre_angle": "degrees"}
KEYS = {
    "friction": "indenter.friction",
    "bulk_ratio": "material.bulk_ratio",
    "thickness": "sample.thickness",
    "fibre_angle": "sample.fibre_angle",
}


@dataclass(frozen=True)
class SplitPoint:
    """A point, split into changed inputs and material parameters.

    Parameters
    ----------
    changes : dict of "table.key" -> value
        The changed inputs.
    parameters : dict of name -> value
        The parameters of the material.
    offset : float, mm
        Displacement of the contact point.
    """

    changes: dict[str, Any]
    parameters: dict[str, float]
    offset: float


def split_point(law: type[Material], point: Point) -> SplitPoint:
    """Split a point into changed inputs and material parameters; the name of a parameter of the law is always a parameter."""
    inputs = {name: value for name, value in point.items() if name not in law.parameters and _is_input(name)}
    parameters = {name: value for name, value in point.items() if name not in inputs}
    offset = inputs.pop("offset", 0.0)
    return SplitPoint({KEYS.get(name, name): value for name, value in inputs.items()}, parameters, offset)


def case_at(case: "Case", point: Point) -> "Case":
    """The case with the changed inputs of a point, and the parameters of the relaxation that the point has."""
    relaxation = case.relaxation
    for key, value in split_point(case.law, point).changes.items():
        table, name = key.split(".")
        case = case.model_copy(update={table: with_key(getattr(case, table), name, value)})
    if relaxation is None:
        return case
    return case.model_copy(update={"material": case.material.model_copy(update={"relaxation": relaxation.at(point)})})


def _is_input(name: str) -> bool:
    return name in UNITS or "." in name


def setup_of(case: "Case") -> Setup:
    """The Setup of a case: its mesh is made for the deepest of its tests, which have the same sample and indenter.

    A case whose tests have their own is parted first (`Case.pieces`).
    """
    mechanics = mechanics_of(case)
    if mechanics.of(0) is not mechanics:
        raise ValueError("tests have samples or indenters of their own: ask each piece of the case for its setup")
    return mechanics.setup


def press_of(case: "Case", test: "Test", material: Material) -> Press:
    """The Press that one test of a case is, on a material."""
    kappa = case.material.bulk_moduli(material)
    indentation = indentation_of(case, test)
    in_time = indentation.in_time(material_of(case))
    fibres = case.fibres_of(test)
    way, observed = (fibres.dip, fibres.families), indentation.observed
    return Press(material, kappa, fibres.angle, indentation.depths, test.name, (), in_time, *way, observed)
