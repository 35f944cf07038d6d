"""The forward model: from parameters to the force curves of all tests of a case.

Searches and inference ask a ForwardModel for curves, whether these come from runs or from a surrogate.
"""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from indentfit.arrays import Array
from indentfit.case import Case
from indentfit.fem.setup import Press
from indentfit.fem.simulate import Model
from indentfit.material import Material
from indentfit.runs.points import press_of, setup_of
from indentfit.runs.run import Point
from indentfit.runs.simulated import SimulatedCase

Report = Callable[[int, int], object]  # called with (runs done, runs asked for)


@dataclass(frozen=True)
class Evaluation:
    """The curves of all tests at one point, or the cause of their absence.

    Parameters
    ----------
    parameters : dict of name -> value
    forces : tuple of arrays (n,), mN, or None
        The forces of each test; None where one of the tests failed.
    cause : str or None
        Which test failed, and why.
    seconds : float
        Duration of all runs.
    facts : tuple of dict
        The solver's facts about each run.
    sensitivities : tuple of dict, or None
        For each test, name -> derivatives of its forces, mN per unit of the parameter, (n,), of those requested names that the
        forward model could give; None where none were requested.
    lost : bool
        The cause lies with the machine (memory, time, a killed process) and not with the mechanics.
    """

    parameters: dict[str, Any]
    forces: tuple[Array, ...] | None
    cause: str | None
    seconds: float
    facts: tuple[dict[str, Any], ...]
    sensitivities: tuple[dict[str, Array], ...] | None = None
    lost: bool = False


class ForwardModel(Protocol):
    """From points to curves: a pool of runs, a surrogate, or a watcher of one of these.

    Attributes
    ----------
    runs : int
        Number of runs of the mechanics that were needed so far.
    failures : sequence of Evaluation
        Each failed evaluation once.
    """

    @property
    def runs(self) -> int: ...

    @property
    def failures(self) -> Sequence[Evaluation]: ...

    def differentiable(self) -> frozenset[str]:
        """Names whose sensitivities `evaluate` can give; a single point may still lack them."""
        ...

    def evaluate(
        self, points: Sequence[Point], report: Report | None = None, sensitivities: Collection[str] = ()
    ) -> list[Evaluation]:
        """Evaluations of points, in their order.

        Parameters
        ----------
        points : sequence of dict, name -> value
        report : called with (runs done, runs asked for)
        sensitivities : names of `differentiable()`
            Quantities by which the forces are differentiated.

        Returns
        -------
        list of Evaluation
            Failures of the mechanics are recorded in the evaluations, never raised.
        """
        ...


def simulate(case: Case, parameters: Point | None = None, progress: Callable[[str, float], None] | None = None) -> SimulatedCase:
    """Every test of a case, simulated at given parameters.

    Parameters
    ----------
    case : Case
    parameters : dict of name -> value
        By default the start values of the case.
    progress : called with (name of a test, share of its depth that is done)

    Returns
    -------
    SimulatedCase

    Raises
    ------
    ConvergenceError
    """
    material, model = case.law(**(parameters or case.start_values())), Model(setup_of(case))
    simulation = model.simulate(presses_of(case, material), progress)
    return SimulatedCase(simulation.tests, simulation.mesh, simulation.solver, case, material, model)


def presses_of(case: Case, material: Material) -> list[Press]:
    """The Press of each test of a case, on a material."""
    return [press_of(case, test, material) for test in case.tests]
