"""One point taken apart: what of it takes the place of the case's own inputs, and what are parameters of the material.

A point (name -> value) may name inputs that are fitted (UNITS), and keys of the case by their dotted names, such as
"sample.base": runs on another mesh or base are sent to the workers and kept in the ledger like all others.
"""

from dataclasses import dataclass

from indentfit.case import Mesh
from indentfit.fem.setup import Press, Setup

UNITS = {"friction": "1", "bulk_ratio": "1", "thickness": "mm", "offset": "mm"}
KEYS = {"friction": "indenter.friction", "bulk_ratio": "material.bulk_ratio", "thickness": "sample.thickness"}
OF_MODEL = ("sample.", "indenter.", "mesh.", "solver.")  # keys that another model has to be made for


@dataclass(frozen=True)
class Setting:
    """One point taken apart: the case with the point's inputs in place, the parameters of the material, the offset in mm, and
    whether the model of the case as it was will do (only kappa and displacements are others)."""

    case: object
    parameters: dict[str, float]
    offset: float
    same_model: bool

    def outputs(self, test):
        """Displacements of a test from the contact point, mm, (n,)."""
        return self.case.outputs(test) - self.offset


def setting(case, point):
    """The Setting of a point (name -> value): its inputs, as far as the material has no parameter of that name, leave it."""
    found = {name: value for name, value in point.items() if name not in case.law.parameters and _is_input(name)}
    parameters = {name: value for name, value in point.items() if name not in found}
    offset = found.pop("offset", 0.0)
    keys = {KEYS.get(name, name): value for name, value in found.items()}
    for key, value in keys.items():
        case = with_key(case, key, value)
    return Setting(case, parameters, offset, not any(key.startswith(OF_MODEL) for key in keys))


def with_key(case, key, value):
    """The case with another value of a key ("table.key"); a mesh is made anew from it."""
    table, name = key.split(".")
    found = Mesh(**{name: value}) if table == "mesh" else getattr(case, table).model_copy(update={name: value})
    return case.model_copy(update={table: found})


def _is_input(name):
    return name in UNITS or "." in name


def setup_of(case) -> Setup:
    """The Setup of a case: its mesh is made for the deepest of its tests."""
    depth = max(float(case.outputs(test)[-1]) for test in case.tests)
    return Setup(case.sample, case.indenter, case.mesh, case.solver, depth)


def press_of(case, test, material) -> Press:
    """The Press that one test of a case is, on a material."""
    kappa = case.material.bulk_modulus(material.shear_modulus)
    return Press(material, kappa, test.angle, case.outputs(test), test.name)
