"""Which symmetry a case is solved with: in the meridian plane where everything is round, else a quarter of the sample."""

from typing import Literal

from indentfit.case.tables import Indenter, Mesh, Sample, Solver
from indentfit.errors import MeshError
from indentfit.indenters import Rings
from indentfit.material import STRETCHES, Material
from indentfit.samples import Circle

Symmetry = Literal["axisymmetric", "quarter"]
ISOTROPIC = {"I1", "I2", *STRETCHES}


def symmetry_of(sample: Sample, indenter: Indenter, mesh: Mesh, solver: Solver, law: type[Material]) -> Symmetry:
    """The symmetry that a case asks for, or for "auto" the most that it has.

    Raises
    ------
    MeshError
        The case asks for an axisymmetric solution and is not axisymmetric; the text says why.
    """
    if mesh.symmetry == "quarter":
        return "quarter"
    broken = _broken_by(sample, indenter, solver, law)
    if broken and mesh.symmetry == "axisymmetric":
        raise MeshError(f'mesh.symmetry = "axisymmetric": {broken}; leave the key out, or write "quarter"')
    return "quarter" if broken else "axisymmetric"


def _broken_by(sample: Sample, indenter: Indenter, solver: Solver, law: type[Material]) -> str:
    """What breaks the symmetry about the axis, in words; nothing where it holds."""
    if not isinstance(sample.geometry.outline, Circle):
        return "the sample is not round"
    if not isinstance(indenter.geometry.partition(0.0), Rings):
        return "the indenter is not round"
    if fibres := set(law.invariants) - ISOTROPIC:
        return f"the material has fibres across the axis ({', '.join(sorted(fibres))})"
    if solver.element != "q2p1" or solver.assembly != "compiled":
        return "an axisymmetric solution takes the element q2p1 and the compiled assembly"
    return ""
