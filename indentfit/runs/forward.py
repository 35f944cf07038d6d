"""The forward model: from parameters to the force curves of all tests of a case.

Searches and inference ask a ForwardModel for curves, whether these come from runs or from a surrogate.
"""

import functools
import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

from indentfit.arrays import Array
from indentfit.case import Case
from indentfit.case.in_time import load_of, motion_of, ramps_of
from indentfit.case.uses import require_case
from indentfit.errors import IndentfitError, OutOfTime
from indentfit.fem.creep import points_of, with_creep
from indentfit.fem.deadline import Deadline
from indentfit.fem.in_time import with_time
from indentfit.fem.result import Simulation, TestResult, TimeCurve
from indentfit.fem.setup import Press
from indentfit.material import Material
from indentfit.runs.pieces import Piece, pieces_of, together
from indentfit.runs.points import case_at, press_of
from indentfit.runs.run import Point
from indentfit.runs.simulated import SimulatedCase
from indentfit.runs.specimen import simulated_specimens

COARSER_SHARE = 0.3  # of the time that a curve and its mesh error take
TIME_SHARE = 0.6  # of the time that a curve and its force over time take
Progress = Callable[[str, float], None]  # called with (what is computed, share of all work that is done)
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
    elastic : Evaluation or None
        The elastic forces on grids of depths from which these follow, where the material relaxes.
    correction : tuple of arrays (n,), or None
        Factors for the error of the mesh that are in the forces, but not in the elastic ones.
    """

    parameters: dict[str, Any]
    forces: tuple[Array, ...] | None
    cause: str | None
    seconds: float
    facts: tuple[dict[str, Any], ...]
    sensitivities: tuple[dict[str, Array], ...] | None = None
    lost: bool = False
    elastic: "Evaluation | None" = None
    correction: tuple[Array, ...] | None = None

    @property
    def run(self) -> "Evaluation":
        """What was run: the elastic evaluation, where the material relaxes."""
        return self.elastic or self


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


def simulate(
    case: Case,
    parameters: Point | None = None,
    progress: Progress | None = None,
    mesh_error: bool = True,
    time_limit: float = math.inf,
    shares: Mapping[str, float] | None = None,
) -> SimulatedCase:
    """Every test of a case, simulated at given parameters.

    Parameters
    ----------
    case : Case
    parameters : dict of name -> value
        By default the start values of the case.
    progress : called with (what is computed, share of all work that is done)
    mesh_error : bool
        Whether a second mesh is solved to state the error of the forces by the mesh.
    time_limit : float, s
        Processor time that each curve may take, and each force over time.
    shares : mapping of test -> share
        Of each elastic force, that which does not relax, in the hereditary integral beside the viscoelastic model; none by default.

    Returns
    -------
    SimulatedCase

    Raises
    ------
    ConvergenceError, OutOfTime
        Its `part`, and that of what `progress` raises, is the SimulatedCase as far as it goes, or None. A force over time that is
        not solved is recorded with its cause.
    """
    require_case(case)
    given = dict(parameters or case.start_values())
    if case.relaxation is not None:
        case = case_at(case, given)
        given = {name: value for name, value in given.items() if name in case.law.parameters}
    material, pieces = case.law(**given), pieces_of(case)
    relaxes = case.material.relaxation is not None
    names = [test.name for test in case.tests]
    parts = _Parts(progress, names, 1 - COARSER_SHARE * mesh_error, 1 - TIME_SHARE * relaxes)
    specimens: list[TestResult] = []
    try:
        specimens.extend(simulated_specimens(case, material, parts.curve))
        for piece in pieces:
            piece.solve(material, parts.curve, time_limit)
            in_time = _InTime(piece.case, parts.in_time, time_limit, shares or {})
            piece.simulation = _over_time(piece, material, in_time)
        for piece in pieces if mesh_error else ():
            piece.state_errors(material, parts.mesh_error, _InTime(piece.case, parts.mesh_error, time_limit, shares or {}))
    except IndentfitError as error:
        error.part = _of_case(case, material, pieces, specimens)
        raise
    simulated = _of_case(case, material, pieces, specimens)
    assert simulated is not None  # or an error was raised
    return simulated


def of_relaxation(
    case: Case, parameters: Point, shares: Mapping[str, float] | None = None
) -> tuple[tuple[str, ...], dict[str, TimeCurve]]:
    """How far the viscoelastic model is from the forces of a fit; nothing where the material is elastic.

    Parameters
    ----------
    case : Case
    parameters : dict of name -> value
        The parameters, and fitted inputs.
    shares : mapping of test -> share
        Of each elastic force, that which does not relax in the forces of the fit; by default none.

    Returns
    -------
    tuple of str
        In words, for each test.
    dict of test -> TimeCurve
        Without those of which the viscoelastic model was not solved.
    """
    there = case_at(case, parameters)
    if there.relaxation is None:
        return (), {}
    words = f"the material relaxes: {there.relaxation.words()}"
    own = {name: value for name, value in parameters.items() if name in case.law.parameters}
    try:
        tests = simulate(there, own, time_limit=case.fit.time_limit, shares=shares).in_time
    except IndentfitError as error:
        remedy = "; a larger fit.time_limit allows more" if isinstance(error, OutOfTime) else ""
        return (words, f"the viscoelastic model was not solved at the optimum: {error}{remedy}"), {}
    known = {name: curve for name, curve in tests.items() if curve.difference is not None}
    kept = ", ".join(f"{name} {share:.2g}" for name, share in (shares or {}).items() if share)
    beside = [f"the bulk modulus does not relax: its share of the elastic force, {kept}, is counted in series"] if kept else []
    return (words, *beside, *(f"{name}: {curve.words()}" for name, curve in tests.items())), known


def _over_time(piece: Piece, material: Material, in_time: "_InTime") -> Simulation | None:
    """The simulation of a piece with the forces over time of tests whose material relaxes."""
    if piece.simulation is None:
        return None
    tests = [in_time(test, press) for test, press in zip(piece.simulation.tests, piece.presses(material), strict=True)]
    return replace(piece.simulation, tests=tuple(tests))


class _InTime:
    """How forces over time of the tests of a case are solved, on any mesh.

    Parameters
    ----------
    case : Case
    progress : called with (name of a test, share of its force over time that is done)
    time_limit : float, s
        Processor time that each force over time may take.
    shares : mapping of test -> share
        Of each elastic force, that which does not relax.
    """

    def __init__(self, case: Case, progress: Callable[[str, float], None], time_limit: float, shares: Mapping[str, float]) -> None:
        self._case, self._progress, self._time_limit, self._shares = case, progress, time_limit, shares
        self._ramps = ramps_of(case)
        self._asked = {test.name: (test, curve) for test, curve in zip(case.tests, case.curves, strict=True)}

    def __call__(self, solved: TestResult, press: Press) -> TestResult:
        """A solved press with its force over time; as it is where the material does not relax."""
        case = self._case
        if case.material.relaxation is None:
            return solved
        name, (asked, curve) = press.name, self._asked[press.name]
        progress, deadline = functools.partial(self._progress, name), Deadline(self._time_limit)
        share = self._shares.get(name, 0.0)
        if (load := load_of(asked, curve)) is not None:
            assert case.relaxation is not None  # the material relaxes
            function, points = case.relaxation.function(load.arrived, load.end), points_of(load, asked.points)
            return with_creep(solved, press, load, function, points, progress, deadline, share)
        motion = motion_of(asked, curve)
        return with_time(solved, press, self._ramps[name].hold, progress, deadline, share, motion and motion[0])


def _of_case(case: Case, material: Material, pieces: Sequence[Piece], specimens: Sequence[TestResult]) -> SimulatedCase | None:
    """The tests as far as they are solved; None where no curve is."""
    simulation = together(case, pieces, specimens)
    if simulation is None:
        return None
    model = pieces[0].model if pieces else None
    return SimulatedCase(simulation.tests, simulation.mesh, simulation.solver, case, material, model)


@dataclass(frozen=True)
class _Parts:
    """Progress of a simulation: the curves of all tests, then their forces over time, then their errors by the mesh."""

    progress: Progress | None
    names: Sequence[str]
    first: float  # share of the work that the curves are, with those over time
    elastic: float  # share of it without those over time

    def curve(self, name: str, share: float, tries: int = 1) -> None:
        self._report(f"{name}{_again(tries)}", self.first * self.elastic * self._share(name, share))

    def in_time(self, name: str, share: float) -> None:
        self._report(f"{name}, over time", self.first * (self.elastic + (1 - self.elastic) * self._share(name, share)))

    def mesh_error(self, name: str, share: float, tries: int = 1) -> None:
        note = f"{name}, error of the mesh{_again(tries)}"
        self._report(note, self.first + (1 - self.first) * self._share(name, share))

    def _share(self, name: str, share: float) -> float:
        return (self.names.index(name) + share) / len(self.names)

    def _report(self, note: str, share: float) -> None:
        if self.progress is not None:
            self.progress(note, share)


def _again(tries: int) -> str:
    return f", try {tries} after a failure" if tries > 1 else ""


def presses_of(case: Case, material: Material) -> list[Press]:
    """The Press of each test of a case, on a material."""
    return [press_of(case, test, material) for test in case.tests]
