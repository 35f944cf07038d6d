"""Inputs of the forward model: the Setup of one mesh, and the Press, one indentation to compute. Neither is a whole case."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from indentfit.arrays import Array
from indentfit.case.relaxation import Relaxation
from indentfit.case.tables import Indenter, Mesh, Sample, Solver
from indentfit.fem.observation import Observed
from indentfit.fem.symmetry import PARTS, Part, Symmetry
from indentfit.fibre_map import FibreMap
from indentfit.fibres import Families, Fibre, fibre_of
from indentfit.hereditary import Ramp, RelaxationFunction
from indentfit.indenters import Rings, has_sharp_edge
from indentfit.material import Material


@dataclass(frozen=True)
class DiscForBlock:
    """The disc in place of a block: its diameter, mm, and the largest relative change of the force by the block's shape."""

    diameter: float
    effect: float

    def sample(self, block: Sample) -> Sample:
        """The block's table with the disc in its place."""
        return Sample(shape="disc", diameter=self.diameter, thickness=block.thickness, base=block.base)

    def words(self, block: Sample) -> str:
        """What is solved in place of what, for reports."""
        return (
            f"the {block.geometry.words()} is solved as a disc of diameter {self.diameter:.4g} mm: the shape of the block changes "
            f"the force by at most {self.effect:.2%}"
        )


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
    symmetry : Symmetry
        Which part of the sample is meshed (fem.symmetry).
    block : tuple of (Sample, DiscForBlock), or None
        The block in whose place `sample` is a disc (fem.wide_block).
    """

    sample: Sample
    indenter: Indenter
    mesh: Mesh
    solver: Solver
    depth: float
    symmetry: Symmetry = "quarter"
    block: tuple[Sample, DiscForBlock] | None = None

    @property
    def in_plane(self) -> bool:
        """Whether the meridian plane is meshed, not a part of the sample with bricks."""
        return self.symmetry == "axisymmetric"

    @property
    def grown_from(self) -> Literal["axisymmetric", "quarter"]:
        """What the mesh is made of: the meridian plane, or the quarter from which every other part is grown."""
        return "axisymmetric" if self.in_plane else "quarter"

    @property
    def part(self) -> Part:
        """The part of the sample that is meshed with bricks; where the meridian plane is meshed, that which is shown."""
        return PARTS["quarter" if self.in_plane else self.symmetry]

    @property
    def quarters(self) -> int:
        """How many quarters of the sample are meshed; 1 in the meridian plane."""
        return 1 if self.in_plane else 4 // self.part.copies

    @property
    def rubs(self) -> bool:
        """Whether points come to touch one by one under friction: the force depends a little on the steps of the depth then."""
        return self.indenter.geometry.edge_radius is None and self.indenter.friction != 0

    @property
    def ties_round(self) -> bool:
        """Whether the sample is tied to the face of a round punch with a sharp edge."""
        shape = self.indenter.geometry
        return self.indenter.friction == "stick" and has_sharp_edge(shape) and isinstance(shape.partition(self.depth), Rings)

    @property
    def remark(self) -> str:
        """What is solved in place of the sample, in words; empty where the sample itself is."""
        return "" if self.block is None else self.block[1].words(self.block[0])


@dataclass(frozen=True)
class InTime:
    """A ramp at constant rate on a material that relaxes.

    Parameters
    ----------
    rate : float, mm/s
    relaxation : Relaxation
        The table of the case.
    """

    rate: float
    relaxation: Relaxation

    def ramp(self, depth: float, hold: float = 0.0) -> tuple[Ramp, RelaxationFunction]:
        """The ramp to a depth, mm, with a hold, s, and the relaxation function on these times."""
        ramp = Ramp(depth, depth / self.rate, hold)
        return ramp, self.relaxation.function(ramp.seconds, ramp.end)

    def forces(self, depths: Array, elastic: Callable[[Array], Array]) -> Array:
        """Forces at depths of the ramp, from elastic ones: the hereditary integral.

        Parameters
        ----------
        depths : array (n,), mm
        elastic : function
            Elastic forces (m, ...) at depths (m,).

        Returns
        -------
        array (n, ...)
        """
        ramp, function = self.ramp(float(depths[-1]))
        times = ramp.times(depths / self.rate)
        return function.integral(times, elastic(ramp.depth_at(times)))[np.searchsorted(times, depths / self.rate)]


@dataclass(frozen=True, eq=False)
class Press:
    """One indentation to compute.

    Parameters
    ----------
    material : Material
    kappa : float or tuple of float, kPa
        Bulk modulus; of each layer, from the top, where the sample has layers.
    angle : float, degrees
        Angle between the fibres and x, the indenter's long side, in the plane of the sample.
    depths : array (n,), mm
        Depths at which the force is requested, in rising order, above zero.
    name : str
        Name of the test, for messages.
    sensitivities : names
        Quantities by which the force is differentiated: parameters of the material (the bulk modulus follows the shear modulus),
        "friction", "bulk_ratio" (bulk modulus over shear modulus), "offset" (depth of the contact point, mm) and "fibre_angle"
        (angle about y by which the fibres are turned, degrees).
    in_time : InTime, or None
        How fast the indenter moves, and how the material relaxes; None where the material is elastic.
    dip : float, degrees
        Angle of the fibres out of the plane of the sample.
    families : Families, FibreMap or None
        Two families of fibres about the direction of `angle`, for a law that has two; or directions on points of the sample, which
        is turned by `angle`.
    observed : Observed, or None
        Displacements of the sample that are requested beside the force.
    """

    material: Material
    kappa: float | tuple[float, ...]
    angle: float
    depths: Array
    name: str = ""
    sensitivities: tuple[str, ...] = ()
    in_time: InTime | None = None
    dip: float = 0.0
    families: Families | FibreMap | None = None
    observed: Observed | None = None

    @property
    def kappas(self) -> tuple[float, ...]:
        """Bulk modulus of each layer, kPa; of a sample without layers its own."""
        return self.kappa if isinstance(self.kappa, tuple) else (self.kappa,)

    @property
    def fibre(self) -> Fibre:
        """Direction of the fibres at rest, (3,), or (2, 3) of two families, or a map of them."""
        return self.turned(0.0)

    def turned(self, angle: float) -> Fibre:
        """Direction of the fibres at rest, (3,) or (2, 3), or a map of them, turned about y by an angle, degrees."""
        return fibre_of(self.angle + angle, self.dip, self.families)


def young_across(material: Material, fibre: Fibre) -> float:
    """Young's modulus across the indenter, kPa; of one family between those along and across the fibres, of a map at their mean."""
    if material.two_families and not isinstance(fibre, FibreMap):
        return material.young_modulus(fibre, np.array([0.0, 0.0, 1.0]))
    moduli = material.moduli()
    vectors = fibre.at(fibre.own_places) if isinstance(fibre, FibreMap) else fibre
    across = np.mean(vectors[2] ** 2)  # 1 where the fibres run across the indenter, 0 where they run along it
    return float(across * moduli["E_along"] + (1 - across) * moduli["E_across"])
