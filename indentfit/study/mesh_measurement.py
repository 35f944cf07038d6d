"""The tests of a case on one mesh: their forces and their cost, measured in a process of its own."""

import contextlib
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from indentfit.arrays import Array
from indentfit.case import Case
from indentfit.errors import ConvergenceError, IndentfitError, MeshError
from indentfit.fem.linear.pardiso import THREADS_PAY
from indentfit.fem.meshing import size
from indentfit.fem.result import Simulation
from indentfit.fem.simulate import Model
from indentfit.runs.isolated import DIED, Died, beside, isolated, peak_memory
from indentfit.runs.ledger import Ledger
from indentfit.runs.pieces import pieces_of, together
from indentfit.runs.points import press_of, setup_of
from indentfit.runs.run import Run
from indentfit.study.mesh_family import estimate
from indentfit.study.runs import Execution

MEASURED = (
    "measured"  # mark among a run's parameters: the run had a process of its own, whose time and memory are among the run's facts
)


@dataclass(frozen=True)
class Measured:
    """The tests of a case on one mesh: their forces and their cost; `cause` instead of forces where the tests failed.

    Parameters
    ----------
    elements, dofs : int
    h : float or None, mm
        Element size; None where the mesh failed.
    forces : tuple of arrays (n,), mN, or None
        One array for each test.
    newton_iterations, factorizations, loose_steps : int
    tries : int
        1, or more where the usual contact and mesh did not converge.
    penalty_error : float
        Share of the force that is missing because of the contact springs' deflection.
    cpu_seconds : float
        Processor time of all tests, without the set-up.
    setup_seconds : float
    memory : int, bytes
        Peak memory.
    cause : str or None
    """

    elements: int
    dofs: int
    h: float | None
    forces: tuple[Array, ...] | None
    newton_iterations: int = 0
    factorizations: int = 0
    loose_steps: int = 0
    tries: int = 0
    penalty_error: float = 0.0
    cpu_seconds: float = 0.0
    setup_seconds: float = 0.0
    memory: int = 0
    cause: str | None = None

    @property
    def counts(self) -> bool:
        """Whether the mesh counts as one of the family."""
        return self.forces is not None and self.tries == 1

    def as_json(self) -> dict[str, Any]:
        forces = None if self.forces is None else [force.tolist() for force in self.forces]
        return {**asdict(replace(self, forces=None)), "forces": forces}

    @classmethod
    def from_json(cls, value: Mapping[str, Any]) -> "Measured":
        forces = value["forces"] and tuple(np.array(force, dtype=float) for force in value["forces"])
        return cls(forces=forces, **{name: value[name] for name in cls.__dataclass_fields__ if name != "forces" and name in value})


def measure_all(cases: Sequence[Case], execution: Execution) -> list[Measured]:
    """Measured of each case, one after the other, each in a process of its own; progress by estimated cost."""
    costs = costs_of(cases)
    known = []
    for n, case in enumerate(cases):
        ledger = execution.ledger_of(case)
        measured = _recorded(case, ledger)
        if measured is None:
            execution.progress(costs[:n].sum() / costs.sum(), f"mesh {n + 1} of {len(cases)}")
            measured = _measured(case)
            if ledger is not None and measured.cause != DIED:  # what kills a process is the machine's fault
                _keep(case, ledger, measured)
        known.append(measured)
    return known


def costs_of(cases: Sequence[Case]) -> Array:
    """What each case costs (n,), in units of its own."""
    return np.array([estimate(case)[1] ** (4 / 3) for case in cases])


def is_small(case: Case) -> bool:
    """Whether a second thread would not pay: the processes of such meshes have one."""
    return estimate(case)[1] < THREADS_PAY


def measure(case: Case) -> Measured:
    """Every test of a case, computed in this process. Raises ConvergenceError."""
    _compile(case)
    started = time.process_time()
    pieces, material = pieces_of(case), case.law(**case.start_values())
    ready = time.process_time()
    for piece in pieces:
        piece.solve(material)
    simulation = together(case, pieces)
    assert simulation is not None  # every piece is solved
    return _of_simulation(case, simulation, ready - started, time.process_time() - ready)


def _of_simulation(case: Case, simulation: Simulation, setup_seconds: float, cpu_seconds: float) -> Measured:
    solver = simulation.solver
    return Measured(
        elements=simulation.mesh.elements,
        dofs=simulation.mesh.dofs,
        h=float(np.mean([size(setup_of(piece)) for piece in case.pieces])),
        forces=tuple(test.force for test in simulation.tests),
        newton_iterations=solver.newton_iterations,
        factorizations=solver.factorizations,
        loose_steps=solver.loose_steps,
        tries=max(test.facts.tries for test in simulation.tests),
        penalty_error=solver.penalty_error,
        cpu_seconds=cpu_seconds,
        setup_seconds=setup_seconds,
        memory=peak_memory(),
    )


def _recorded(case: Case, ledger: Ledger | None) -> Measured | None:
    """The stored measurement of a case: its forces are in a run of each test, the other numbers in the facts of that run."""
    if ledger is None:
        return None
    runs = [ledger.find(case.start_values() | {MEASURED: True}, test) for test in case.tests]
    known = [run for run in runs if run is not None]
    if len(known) < len(runs):
        return None
    failed = any(run.force is None for run in known)
    return Measured.from_json({**known[0].facts, "forces": None if failed else [r.force for r in known], "cause": known[0].cause})


def _keep(case: Case, ledger: Ledger, measured: Measured) -> None:
    facts = {name: value for name, value in measured.as_json().items() if name not in ("forces", "cause")}
    forces = measured.forces or (None,) * len(case.tests)
    for test, force in zip(case.tests, forces, strict=True):
        ledger.add(case.start_values() | {MEASURED: True}, test, Run(force, measured.cause, measured.cpu_seconds, facts))


def _measured(case: Case) -> Measured:
    """Measured of a case in a process of its own, with the cause of its failure in place of forces."""
    elements, dofs, _ = estimate(case)
    try:
        if not is_small(case):
            return isolated(measure, case)
        with beside(measure, case) as value:
            return value()
    except (IndentfitError, Died) as error:
        cause = DIED if isinstance(error, Died) else " ".join(str(error).split())
        return Measured(elements, dofs, None, None, cause=cause)


def _compile(case: Case) -> None:
    """Run a small mesh to a small depth, so that the time of compilation is not counted."""
    small = case.model_copy(update={"mesh": type(case.mesh)(elements=20)})
    for piece in small.pieces:
        with contextlib.suppress(ConvergenceError, MeshError):
            press = press_of(piece, piece.tests[0], piece.law(**piece.start_values()))
            Model(setup_of(piece)).run(replace(press, depths=1e-3 * press.depths[-1:]))
