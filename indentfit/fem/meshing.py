"""The mesh of a Setup, whatever its symmetry: its number of elements and its size before it is made."""

from dataclasses import replace

import numpy as np

from indentfit.arrays import Array
from indentfit.case.tables import Mesh
from indentfit.fem import mesh as bricks
from indentfit.fem.meridian_mesh import count_meridian, size_of_meridian, width_within_contact
from indentfit.fem.setup import Setup

DIMENSIONS = {"axisymmetric": 2, "quarter": 3}  # by Setup.grown_from


def count(setup: Setup) -> int:
    """Number of elements of a setup's mesh, without making it."""
    if setup.in_plane:
        return count_meridian(setup.sample, setup.indenter, setup.mesh, setup.depth)
    return setup.quarters * bricks.count(setup.sample, setup.indenter, setup.mesh, setup.solver.element, setup.depth)


def size(setup: Setup) -> float:
    """Size of a setup's mesh, mm: what all widths of its elements are proportional to."""
    if setup.in_plane:
        return size_of_meridian(setup.sample, setup.indenter, setup.mesh, setup.depth)
    return bricks.size(setup.sample, setup.indenter, setup.mesh, setup.solver.element, setup.depth)


def widths_within(setup: Setup, radii: Array) -> Array:
    """Widths of the elements, mm, at radii (n,), mm, within a contact that grows, or on bricks at its edge."""
    if setup.in_plane:
        return width_within_contact(setup.sample, setup.indenter, setup.mesh, setup.depth, radii)
    edge = bricks.edge_width(setup.sample, setup.indenter, setup.mesh, setup.solver.element, setup.depth)
    return np.full(len(radii), edge)


def resized(setup: Setup, factor: float) -> Setup:
    """The setup with a mesh whose elements are `factor` times as wide."""
    return replace(setup, mesh=Mesh(symmetry=setup.mesh.symmetry, size=factor * size(setup)))
