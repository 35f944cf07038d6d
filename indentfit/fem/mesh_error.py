"""The error of the force by the mesh: estimated for each curve by a second mesh.

The forces F of a mesh, and G of a mesh whose elements are RATIO times as wide, approach the same limit, so that |F - G| measures
the error of F. Its rate differs between contacts, and the end of a contact that grows passes the elements one by one, so that F -
G may be small by chance at one depth. The band that is stated is therefore FACTOR times the largest |F - G| so far along the
curve, and at least FLOOR of the force. Where no mesh with clearly fewer elements can be had, G is that of a finer mesh, which
lies nearer: the band is then RATIO^ORDER times as wide. At large strain elements of the meridian plane fold up at a sharp edge,
mesh by mesh, and the force has no limit that meshes show: there the band is at least FOLDS times the depth over the indenter's
half-width. Bricks hold a growing contact by its nodes: there the band is at least NODES times the squared width of the elements
at the contact's edge over that of the contact at each depth, which is much at the first depths.

The constants were chosen so that the band holds the error in 95 % of contacts whose exact forces, or forces on much finer meshes,
are known (tests/campaigns/mesh_error.py, tests/test_references.py); those of eight-node bricks are the theory's, an error in
proportion to the size.
"""

import functools
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from indentfit.arrays import Array
from indentfit.case.tables import Mesh
from indentfit.errors import ConvergenceError
from indentfit.fem.mesh import edge_width
from indentfit.fem.meshing import count, size
from indentfit.fem.result import ForceError, Simulation, TestResult
from indentfit.fem.setup import Press, Setup
from indentfit.fem.simulate import Model
from indentfit.indenters import Band, Rings, has_sharp_edge

RATIO = {"axisymmetric": 2.0, "quarter": 1.4}
FACTOR = {("axisymmetric", "q2p1"): 1.0, ("quarter", "q2p1"): 1.0, ("quarter", "q1p0"): 2.5}
ORDER = {"q2p1": 1.5, "q1p0": 1.0}
FEWER = 0.75  # share of the elements that a coarser mesh may have at most
FLOOR = {("axisymmetric", "q2p1"): 2e-3, ("quarter", "q2p1"): 5e-3, ("quarter", "q1p0"): 1e-2}  # of the force
NODES = {Rings: 0.15, Band: 0.9}  # spheres and wedges on bricks, against the meridian plane and against finer bricks
FOLDS = {"free": 0.06, "stick": 0.13}  # by another code's curve (axi_punch_a0.5_stick_bonded), and by finer and finer meshes
FOLDING = "elements fold up at the sharp edge at this depth; state the edge's radius, indenter.edge_radius"


def with_mesh_errors(
    simulation: Simulation, setup: Setup, presses: Sequence[Press], progress: Callable[[str, float], None] | None = None
) -> Simulation:
    """A simulation whose tests state the error of their forces by the mesh.

    Parameters
    ----------
    simulation : Simulation
    setup, presses
        Those of the simulation.
    progress : called with (name of a test, share of the second solution that is done)

    Returns
    -------
    Simulation
        A test whose second solution fails has the cause in place of its error.
    """
    other, factor = second(setup)
    model = Model(other)
    tests = []
    for press, test in zip(presses, simulation.tests, strict=True):
        report = functools.partial(progress, press.name) if progress else None
        try:
            result = model.run(replace(press, sensitivities=()), report)
        except ConvergenceError as error:
            tests.append(replace(test, mesh_error=f"the second mesh for its estimate was not solved: {error}"))
            continue
        tests.append(replace(test, mesh_error=force_error(test, result, factor, setup)))
    return replace(simulation, tests=tuple(tests))


def second(setup: Setup) -> tuple[Setup, float]:
    """The setup with the second mesh of the estimate, and the factor from the change of the force to the band."""
    ratio, element = RATIO[setup.symmetry], setup.solver.element
    factor = FACTOR[setup.symmetry, element]
    coarse = _resized(setup, ratio)
    if count(coarse) <= FEWER * count(setup):
        return coarse, factor
    return _resized(setup, 1 / ratio), factor * ratio ** ORDER[element]


def _resized(setup: Setup, factor: float) -> Setup:
    return replace(setup, mesh=Mesh(symmetry=setup.mesh.symmetry, size=factor * size(setup)))


def force_error(test: TestResult, other: TestResult, factor: float, setup: Setup) -> ForceError:
    """The stated error of a test's forces, from those of the second mesh."""
    change = factor * np.maximum.accumulate(np.abs(other.force - test.force))
    shape = setup.block[1].effect if setup.block else 0.0
    floor = FLOOR[setup.symmetry, setup.solver.element] + shape
    least, folds = floor + _few_nodes(setup, test.displacement), _folds(setup) * test.displacement
    remark = FOLDING if folds[-1] > 2 * floor else ""
    return ForceError(
        np.maximum.accumulate(np.maximum(change, np.maximum(least, folds) * np.abs(test.force))), other.facts.elements, remark
    )


def _few_nodes(setup: Setup, depths: Array) -> Array:
    """The least relative error (n,) of bricks under a contact that grows: at small depths the contact meets few of their nodes."""
    shape = setup.indenter.geometry
    if setup.symmetry == "axisymmetric" or shape.edge_radius is not None:
        return np.zeros(len(depths))
    width = edge_width(setup.sample, setup.indenter, setup.mesh, setup.solver.element, setup.depth)
    contacts = [shape.partition(float(depth)) for depth in depths]
    return np.array([min(NODES[type(contact)] * (width / contact.half_width) ** 2, 1.0) for contact in contacts])


def _folds(setup: Setup) -> float:
    """The least relative error of the force per depth, 1/mm, by a sharp edge."""
    shape = setup.indenter.geometry
    if setup.symmetry != "axisymmetric" or not has_sharp_edge(shape):
        return 0.0
    return FOLDS["stick" if setup.indenter.friction == "stick" else "free"] / shape.half_width
