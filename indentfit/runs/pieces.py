"""The pieces of a case in the process that asks: a model for each different sample and indenter of its tests.

A case whose tests all have the sample and the indenter of the case has one piece, the case itself.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from indentfit.case import Case
from indentfit.errors import IndentfitError
from indentfit.fem.facts import MeshFacts, SolverFacts
from indentfit.fem.mesh_error import InTime, with_mesh_errors
from indentfit.fem.meshing import resized
from indentfit.fem.result import Simulation, TestResult
from indentfit.fem.setup import Press, Setup
from indentfit.fem.simulate import Model
from indentfit.material import Material
from indentfit.runs.points import press_of, setup_of

Curve = Callable[..., None]  # called with (name of a test, share of it that is done), and `tries` as `Model.simulate` does


@dataclass
class Piece:
    """Tests on one sample and indenter, with their model.

    Attributes
    ----------
    case : Case
        Of these tests alone.
    setup : Setup
    model : Model
    simulation : Simulation or None
        What has been solved so far.
    """

    case: Case
    setup: Setup
    model: Model
    simulation: Simulation | None = None

    def presses(self, material: Material) -> list[Press]:
        """The Press of each test, on a material."""
        return [press_of(self.case, test, material) for test in self.case.tests]

    def solve(self, material: Material, progress: Curve | None = None, time_limit: float = math.inf) -> Simulation:
        """The curves of the tests, each within a limit of processor time, s. Where they fail, or are stopped, `simulation` holds
        the part that there is."""
        try:
            self.simulation = self.model.simulate(self.presses(material), progress, time_limit)
        except IndentfitError as error:
            self.simulation = error.part if isinstance(error.part, Simulation) else None
            raise
        return self.simulation

    def refined(self, factor: float) -> "Piece":
        """These tests on a mesh whose elements are narrower by a factor; nothing of it is solved."""
        setup = resized(self.setup, 1 / factor)
        return Piece(self.case, setup, Model(setup))

    def state_errors(self, material: Material, progress: Curve | None = None, in_time: InTime | None = None) -> None:
        """State the errors of the curves by the mesh, in `simulation`; of those over time where it is said how they are solved."""
        if self.simulation is not None:
            self.simulation = with_mesh_errors(self.simulation, self.setup, self.presses(material), progress, in_time)


def pieces_of(case: Case) -> list[Piece]:
    """The pieces of a case. Raises MeshError where one of them cannot be meshed, before anything is solved."""
    setups = [(piece, setup_of(piece)) for piece in case.pieces]
    return [Piece(piece, setup, Model(setup)) for piece, setup in setups]


def mesh_of(pieces: Sequence[Piece]) -> MeshFacts:
    """The facts of the meshes of pieces together."""
    return MeshFacts.together([(", ".join(test.name for test in piece.case.tests), piece.model.mesh_facts()) for piece in pieces])


def together(case: Case, pieces: Sequence[Piece], specimens: Sequence[TestResult] = ()) -> Simulation | None:
    """The simulations of pieces, and tests without an indenter, as that of their case, the tests in its order; None where nothing
    is solved."""
    solved = [piece for piece in pieces if piece.simulation is not None]
    if len(pieces) == 1 and solved and not specimens:
        return solved[0].simulation
    tests = tuple(_in_order(case, solved, specimens))
    if not tests:
        return None
    facts, name = [test.facts for test in tests], solved[0].model.solver.name if solved else "none"
    seconds = sum(piece.model.setup_seconds for piece in solved)
    solver = SolverFacts.of(facts, name, case.solver.assembly, seconds)
    return Simulation(tests, mesh_of(solved), solver)


def _in_order(case: Case, solved: Sequence[Piece], specimens: Sequence[TestResult]) -> Iterator[TestResult]:
    known = {test.name: test for piece in solved if piece.simulation is not None for test in piece.simulation.tests}
    known |= {test.name: test for test in specimens}
    yield from (known[test.name] for test in case.tests if test.name in known)
