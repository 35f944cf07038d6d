"""The forward model of a case: the curves of all its tests at given parameters."""

from indentfit.fem.simulate import Model
from indentfit.runs.points import press_of, setup_of


def simulate(case, parameters=None, progress=None):
    """Simulation of every test of a case, at given parameters (name -> value) or at its start values.

    progress: called with (test name, share of its depth done). Raises ConvergenceError.
    """
    material = case.law(**(parameters or case.start_values()))
    return Model(setup_of(case)).simulate(presses_of(case, material), progress)


def presses_of(case, material):
    """The Press of each test of a case, on a material."""
    return [press_of(case, test, material) for test in case.tests]
