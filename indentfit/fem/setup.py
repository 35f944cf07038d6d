"""What the forward model is given: what one mesh is made for, and one indentation to compute on it. Neither is a whole case."""

from dataclasses import dataclass

from indentfit.arrays import Array
from indentfit.case.tables import Indenter, Mesh, Sample, Solver
from indentfit.material import Material


@dataclass(frozen=True)
class Setup:
    """What one mesh and its contact are made for.

    Parameters
    ----------
    sample : Sample
    indenter : Indenter
    mesh : Mesh
    solver : Solver
        The tables of a case.
    depth : float, mm
        Largest depth that the indenter will reach.
    """

    sample: Sample
    indenter: Indenter
    mesh: Mesh
    solver: Solver
    depth: float


@dataclass(frozen=True, eq=False)
class Press:
    """One indentation to compute.

    Parameters
    ----------
    material : Material
    kappa : float, kPa
        Bulk modulus.
    angle : int, degrees
        Between the fibres and x, the indenter's long side: 0 or 90.
    depths : array (n,), mm
        Depths at which the force is asked for, rising, above zero.
    name : str
        Name of the test, for messages.
    sensitivities : names
        What the force is to be differentiated by: parameters of the material (the bulk modulus then follows the shear modulus),
        "friction", "bulk_ratio" (bulk modulus over shear modulus) and "offset" (depth of the contact point, mm).
    """

    material: Material
    kappa: float
    angle: int
    depths: Array
    name: str = ""
    sensitivities: tuple[str, ...] = ()
