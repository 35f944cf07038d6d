"""Points: parameters of the material, and inputs of the case that a run changes.

A point (name -> value) may name inputs that are fitted (UNITS), and keys of the case by their dotted names, such as
"sample.base": runs on another mesh or base are sent to the workers and kept in the ledger like all others.
"""

from dataclasses import dataclass
from typing import Any

from indentfit.arrays import Array
from indentfit.case import Case, Mesh, Test
from indentfit.fem.setup import Press, Setup
from indentfit.material import Material
from indentfit.runs.run import Point

UNITS = {"friction": "1", "bulk_ratio": "1", "thickness": "mm", "offset": "mm"}
KEYS = {"friction": "indenter.friction", "bulk_ratio": "material.bulk_ratio", "thickness": "sample.thickness"}
OF_MODEL = ("sample.", "indenter.", "mesh.", "solver.")  # keys that another model has to be made for


@dataclass(frozen=True)
class SplitPoint:
    """A point, split into changed inputs and material parameters.

    Parameters
    ----------
    case : Case
        The case with the point's inputs in place.
    parameters : dict of name -> value
        The parameters of the material.
    offset : float, mm
        Displacement of the contact point.
    same_model : bool
        Whether the model of the unchanged case will do, because only bulk modulus and displacements change.
    """

    case: Case
    parameters: dict[str, float]
    offset: float
    same_model: bool

    def outputs(self, test: Test) -> Array:
        """Displacements of a test from the contact point, mm, (n,)."""
        return self.case.outputs(test) - self.offset


def split_point(case: Case, point: Point) -> SplitPoint:
    """Split a point into changed inputs and material parameters; a name that the material has as a parameter is one."""
    own = case.law.parameters
    inputs = {name: value for name, value in point.items() if name not in own and _is_input(name)}
    parameters = {name: value for name, value in point.items() if name not in inputs}
    offset = inputs.pop("offset", 0.0)
    keys = {KEYS.get(name, name): value for name, value in inputs.items()}
    for key, value in keys.items():
        case = with_key(case, key, value)
    return SplitPoint(case, parameters, offset, not any(key.startswith(OF_MODEL) for key in keys))


def with_key(case: Case, key: str, value: Any) -> Case:
    """The case with another value of a key ("table.key"); a mesh is made anew from that key alone."""
    table, name = key.split(".")
    changed = Mesh(**{name: value}) if table == "mesh" else getattr(case, table).model_copy(update={name: value})
    return case.model_copy(update={table: changed})


def _is_input(name: str) -> bool:
    return name in UNITS or "." in name


def setup_of(case: Case) -> Setup:
    """The Setup of a case: its mesh is made for the deepest of its tests."""
    depth = max(float(case.outputs(test)[-1]) for test in case.tests)
    return Setup(case.sample, case.indenter, case.mesh, case.solver, depth)


def press_of(case: Case, test: Test, material: Material) -> Press:
    """The Press that one test of a case is, on a material."""
    kappa = case.material.bulk_modulus(material.shear_modulus)
    return Press(material, kappa, test.angle, case.outputs(test), test.name)
