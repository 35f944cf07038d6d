"""Inputs of the forward model: the Setup of one mesh, and the Press, one indentation to compute. Neither is a whole case."""

from dataclasses import dataclass

from indentfit.arrays import Array
from indentfit.case.tables import Indenter, Mesh, Sample, Solver
from indentfit.fem.symmetry import Symmetry
from indentfit.material import Material


@dataclass(frozen=True)
class Setup:
    """The tables and the depth for which one mesh and its contact are made.

    Parameters
    ----------
    sample : Sample
    indenter : Indenter
    mesh : Mesh
    solver : Solver
        The tables of a case.
    depth : float, mm
        Largest depth that the indenter will reach.
    symmetry : "quarter" or "axisymmetric"
        Which part of the sample is meshed (fem.symmetry).
    """

    sample: Sample
    indenter: Indenter
    mesh: Mesh
    solver: Solver
    depth: float
    symmetry: Symmetry = "quarter"


@dataclass(frozen=True, eq=False)
class Press:
    """One indentation to compute.

    Parameters
    ----------
    material : Material
    kappa : float, kPa
        Bulk modulus.
    angle : int, degrees
        Angle between the fibres and x, the indenter's long side: 0 or 90.
    depths : array (n,), mm
        Depths at which the force is requested, in rising order, above zero.
    name : str
        Name of the test, for messages.
    sensitivities : names
        Quantities by which the force is differentiated: parameters of the material (the bulk modulus follows the shear modulus),
        "friction", "bulk_ratio" (bulk modulus over shear modulus) and "offset" (depth of the contact point, mm).
    """

    material: Material
    kappa: float
    angle: int
    depths: Array
    name: str = ""
    sensitivities: tuple[str, ...] = ()
