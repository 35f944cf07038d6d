"""The error of the force by the mesh: estimated for each curve by a second, coarser mesh.

The forces F of a mesh, and G of a mesh whose elements are COARSER times as wide, approach the same limit, so that |F - G| measures the
error of F. Its rate differs between contacts, and the end of a contact that grows passes the elements one by one, so that F - G may be
small by chance at one depth. The band that is stated is therefore FACTOR times the largest |F - G| so far along the curve, and at least
FLOOR of the force. The constants were chosen so that the band holds the error in 95 % of contacts whose exact forces, or
forces on much finer meshes, are known (tests/campaigns/mesh_error.py).
"""

import functools
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from indentfit.arrays import Array
from indentfit.case.tables import Mesh
from indentfit.errors import ConvergenceError
from indentfit.fem.meshing import size
from indentfit.fem.result import ForceError, Simulation, TestResult
from indentfit.fem.setup import Press, Setup
from indentfit.fem.simulate import Model
from indentfit.fem.symmetry import Symmetry

COARSER = {"axisymmetric": 2.0, "quarter": 1.4}
FACTOR = {"axisymmetric": 1.0, "quarter": 1.0}
FLOOR = 1e-3


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
        tests.append(replace(test, mesh_error=force_error(test.force, result, setup.symmetry)))
    return replace(simulation, tests=tuple(tests))


def coarser(setup: Setup) -> Setup:
    """The setup with the coarser mesh of the estimate."""
    wider = COARSER[setup.symmetry] * size(setup)
    return replace(setup, mesh=Mesh(symmetry=setup.mesh.symmetry, size=wider))


def force_error(force: Array, coarse: TestResult, symmetry: Symmetry) -> ForceError:
    """The stated error of forces (n,), mN, by those of the coarser mesh."""
    change = np.maximum.accumulate(np.abs(coarse.force - force))
    band = np.maximum(FACTOR[symmetry] * change, FLOOR * np.abs(force))
    return ForceError(band, coarse.facts.elements)
