"""A block so wide that its shape hardly changes the force is solved in the meridian plane, as the disc of the same area.

A block lies between the disc inscribed in its outline and the disc around it, and the force grows with the sample's width. So the
forces of these two discs bound the force of the block. The forces are those of a flat punch as wide as the contact at the largest
depth, at small strain: a linear problem, which is solved in a fifth of a second.
"""

import functools
import math
from collections.abc import Collection

import numpy as np

from indentfit.case.tables import Indenter, Mesh, Sample, Solver
from indentfit.errors import MeshError
from indentfit.fem.setup import DiscForBlock, Press, Setup
from indentfit.fem.simulate import Model
from indentfit.fem.symmetry import PARTS, symmetry_of
from indentfit.fibres import Kept
from indentfit.material import Material, load
from indentfit.samples import Rectangle

SMALL = 1e-3  # depth of the punch over its radius
STIFFEST = (
    1e3  # bulk over shear modulus: the sides matter most to a sample that keeps its volume, and all runs need the same choice
)
WIDEST = 0.9  # of the inscribed disc: a wider contact is that of a block


def setup_for(
    sample: Sample,
    indenter: Indenter,
    mesh: Mesh,
    solver: Solver,
    law: type[Material],
    depth: float,
    fibres: Collection[Kept] = (),
    shaped: bool = False,
) -> Setup:
    """The Setup of a case: its symmetry, and the disc in place of a wide block.

    Parameters
    ----------
    sample, indenter, mesh, solver : tables of a case
    law : class of the material
    depth : float, mm
        Largest depth of the tests.
    fibres : symmetries that the fibres of the tests keep
    shaped : bool
        Whether the sample's own shape is needed, because displacements of its points are wanted.

    Returns
    -------
    Setup

    Raises
    ------
    MeshError
        The case asks for an axisymmetric solution and is not axisymmetric; the text says why.
    """
    sample = sample.stretched
    disc = None if mesh.symmetry in PARTS or shaped else _disc_if_round(sample, indenter, mesh, solver, law, depth)
    if disc is not None and disc.effect <= mesh.wanted_error:
        return Setup(disc.sample(sample), indenter, mesh, solver, depth, "axisymmetric", (sample, disc))
    if disc is not None and mesh.symmetry == "axisymmetric":
        raise MeshError(
            f'mesh.symmetry = "axisymmetric": the sample is not round, and its shape changes the force by up to {disc.effect:.1%}; '
            'leave the key out, write "quarter", or allow as much by mesh.error'
        )
    return Setup(sample, indenter, mesh, solver, depth, symmetry_of(sample, indenter, mesh, solver, law, fibres))


def _disc_if_round(
    sample: Sample, indenter: Indenter, mesh: Mesh, solver: Solver, law: type[Material], depth: float
) -> DiscForBlock | None:
    """The disc in place of a block where everything else of the case is axisymmetric. A block with layers remains a block: how far
    the load spreads in it, and so how much its sides matter, depends on the parameters. So does one whose ends are held."""
    disc = DiscForBlock(2 * sample.geometry.outline.inscribed, 0.0).sample(sample)
    if sample.layer or sample.prestretch is not None or symmetry_of(disc, indenter, Mesh(), solver, law) != "axisymmetric":
        return None
    return disc_for(sample, indenter, depth)


def disc_for(block: Sample, indenter: Indenter, depth: float) -> DiscForBlock | None:
    """The disc in place of a block; None where the sample is not a block, or the contact does not fit on the inscribed disc.

    Parameters
    ----------
    block, indenter : tables of a case
    depth : float, mm
        Largest depth of the tests.

    Returns
    -------
    DiscForBlock or None
    """
    return _disc_under(block, indenter.geometry.partition(depth).half_width)


@functools.lru_cache(maxsize=256)
def _disc_under(block: Sample, radius: float) -> DiscForBlock | None:
    """The disc in place of a block under a contact of a radius, mm."""
    outline = block.geometry.outline
    if not isinstance(outline, Rectangle) or radius > WIDEST * outline.inscribed:
        return None
    around = math.hypot(outline.half_length, outline.half_width)
    inner, outer = (_force(block, radius, size) for size in (outline.inscribed, around))
    area = 4 * outline.half_length * outline.half_width
    return DiscForBlock(2 * math.sqrt(area / math.pi), abs(outer / inner - 1))


def _force(block: Sample, radius: float, size: float) -> float:
    """Force of a flat punch of a radius on a disc of radius `size`, both in mm, at small strain and unit shear modulus."""
    disc, punch = DiscForBlock(2 * size, 0.0).sample(block), Indenter(shape="cylinder", diameter=2 * radius, friction=0)
    depth = SMALL * radius
    model = Model(Setup(disc, punch, Mesh(elements=100), Solver(), depth, "axisymmetric"))
    return float(model.run(Press(load("neo_hookean")(mu=1.0), STIFFEST, 0, np.array([depth / 2, depth]))).force[-1])
