"""The error of the force by the mesh: estimated for each curve by a second, coarser mesh.

The forces F of a mesh, and G of a mesh whose elements are COARSER times as wide, approach the same limit, so that |F - G| measures
the error of F. Its rate differs between contacts, and the end of a contact that grows passes the elements one by one, so that F - G
may be small by chance at one depth. The band that is stated is therefore FACTOR times the largest |F - G| so far along the curve,
and at least FLOOR of the force. At large strain a sharp edge that is free to slide folds into the sample, mesh by mesh, and the
force has no limit that meshes show: there the band is at least FOLDS times the depth over the indenter's half-width.

The constants were chosen so that the band holds the error in 95 % of contacts whose exact forces, or forces on much finer meshes,
are known (tests/campaigns/mesh_error.py).
"""

import functools
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from indentfit.case.tables import Mesh
from indentfit.errors import ConvergenceError
from indentfit.fem.meshing import size
from indentfit.fem.result import ForceError, Simulation, TestResult
from indentfit.fem.setup import Press, Setup
from indentfit.fem.simulate import Model
from indentfit.indenters import has_sharp_edge

COARSER = {"axisymmetric": 2.0, "quarter": 1.4}
FACTOR = {"axisymmetric": 1.0, "quarter": 0.7}
FLOOR = 2e-3
FOLDS = 0.06
FOLDING = "a sharp edge that is free to slide folds into the sample at this depth; state the edge's radius, indenter.edge_radius"


def with_mesh_errors(
    simulation: Simulation, setup: Setup, presses: Sequence[Press], progress: Callable[[str, float], None] | None = None
) -> Simulation:
    """A simulation whose tests state the error of their forces by the mesh.

    Parameters
    ----------
    simulation : Simulation
    setup, presses
        Those of the simulation.
    progress : called with (name of a test, share of the coarser solution that is done)

    Returns
    -------
    Simulation
        A test whose coarser solution fails has the cause in place of its error.
    """
    coarse = Model(coarser(setup))
    tests = []
    for press, test in zip(presses, simulation.tests, strict=True):
        report = functools.partial(progress, press.name) if progress else None
        try:
            result = coarse.run(replace(press, sensitivities=()), report)
        except ConvergenceError as error:
            tests.append(replace(test, mesh_error=f"the coarser mesh for its estimate was not solved: {error}"))
            continue
        tests.append(replace(test, mesh_error=force_error(test, result, setup)))
    return replace(simulation, tests=tuple(tests))


def coarser(setup: Setup) -> Setup:
    """The setup with the coarser mesh of the estimate."""
    wider = COARSER[setup.symmetry] * size(setup)
    return replace(setup, mesh=Mesh(symmetry=setup.mesh.symmetry, size=wider))


def force_error(test: TestResult, coarse: TestResult, setup: Setup) -> ForceError:
    """The stated error of a test's forces, from those of the coarser mesh."""
    change = FACTOR[setup.symmetry] * np.maximum.accumulate(np.abs(coarse.force - test.force))
    shape = setup.block[1].effect if setup.block else 0.0
    least, folds = (FLOOR + shape) * np.abs(test.force), _folds(setup) * test.displacement * np.abs(test.force)
    remark = FOLDING if folds[-1] > 2 * least[-1] else ""
    return ForceError(np.maximum.reduce([change, least, folds]), coarse.facts.elements, remark)


def _folds(setup: Setup) -> float:
    """The least relative error of the force per depth, 1/mm, by a sharp edge that is free to slide."""
    shape = setup.indenter.geometry
    free = has_sharp_edge(shape) and setup.indenter.friction != "stick"
    return FOLDS / shape.half_width if free else 0.0
