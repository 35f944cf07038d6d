"""Facts about a solution besides its forces: the work that it took, its errors, and the state of the contact."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any

from indentfit.digits import quantity
from indentfit.fem.symmetry import PARTS

MAY_BE_OFF = "forces may be off by more than the stated error (give a smaller depth)"
UNSTABLE = "the law loses its stability in "
ORDER = ("axisymmetric", *PARTS)  # of falling symmetry

NEAR = 0.25  # difference from the number of elements that a case asks for, that is not mentioned


@dataclass(frozen=True)
class SolveFacts:
    """Facts of one test's solution.

    Parameters
    ----------
    tries : int
        1, or more where the usual contact and mesh did not converge; `first_failure` then gives the reason.
    elements : int
    steps, cutbacks : int
        Steps of the depth, and how often a step was repeated with half its length.
    newton_iterations : int
    loose_steps : int
        Steps that were accepted at a residual above the tolerance (see fem/relaxation.py).
    largest_residual : float
        The largest residual of the loose steps, over the contact forces.
    factorizations, solves, krylov_iterations : int
        Work of the linear solver.
    wall_seconds : float, s
    penalty_error : float
        Share of the last force that is missing because of the contact springs' deflection; `force` has it added back where the
        path is smooth (sensitivity.Secants).
    residual_error : float
        Largest share of the force that a step's remaining residual withholds, by the tangent; it is added back, unless the tangent
        is nearly singular (`Equilibrium.wild`).
    edge_slip : float
        Largest motion of the material under a sharp edge away from the edge, as a share of the indenter's half-width; 0 where
        the edge is rounded.
    touching, slipping : float
        Shares of the points under the indenter that touch the indenter, and that slip, at the last depth.
    first_failure : str or None
        Also, of a curve that was solved at the first try, how far the faces of layers that slide are apart.
    unstable_from : float or None, mm
        Depth of the first step at which the law does not resist one more shear at some point; None where it does, or where it
        has fibres.
    unstable : float
        Share of the integration points where it does not, at the last depth.
    """

    tries: int = 1
    elements: int = 0
    steps: int = 0
    cutbacks: int = 0
    newton_iterations: int = 0
    loose_steps: int = 0
    largest_residual: float = 0.0
    factorizations: int = 0
    solves: int = 0
    krylov_iterations: int = 0
    wall_seconds: float = 0.0
    penalty_error: float = 0.0
    residual_error: float = 0.0
    edge_slip: float = 0.0
    touching: float = 0.0
    slipping: float = 0.0
    first_failure: str | None = None
    unstable_from: float | None = None
    unstable: float = 0.0

    def as_json(self) -> dict[str, Any]:
        """Stable keys, as in `simulate --json` and in the ledger; first_failure only where the first try failed, and the keys of
        an unstable law only where it is that."""
        left_out = {"first_failure"} if self.first_failure is None else set()
        left_out |= {"unstable_from", "unstable"} if self.unstable_from is None else set()
        return {key: value for key, value in asdict(self).items() if key not in left_out}

    @classmethod
    def from_json(cls, facts: Mapping[str, Any]) -> "SolveFacts":
        """The facts that `as_json` wrote; keys of other versions are left out."""
        return cls(**{field.name: facts[field.name] for field in fields(cls) if field.name in facts})


@dataclass(frozen=True)
class MeshFacts:
    """Numbers of a mesh.

    Parameters
    ----------
    elements, dofs : int
    element : "q1p0" or "q2p1"
    smallest_mm : float, mm
        Cube root of the smallest element's volume.
    symmetry : Symmetry
        Which part of the sample was meshed (fem.symmetry); of several meshes, that with the least symmetry.
    remark : str
        What was solved in place of the sample (fem.wide_block); empty where the sample itself was.
    """

    elements: int
    dofs: int
    element: str
    smallest_mm: float
    symmetry: str = "quarter"
    remark: str = ""

    @classmethod
    def none(cls) -> "MeshFacts":
        """No mesh: no test is an indentation."""
        return cls(0, 0, "", 0.0, remark="no indentation to mesh; a disc bonded between plates has a mesh of its own")

    @classmethod
    def together(cls, meshes: Sequence[tuple[str, "MeshFacts"]]) -> "MeshFacts":
        """The facts of several meshes, each with the names of its tests: sums of elements and dofs, and a remark with each mesh."""
        if not meshes:
            return cls.none()
        if len(meshes) == 1:
            return meshes[0][1]
        own = [f"{tests} {mesh.elements:,} elements, {mesh.part}{mesh.remark and ', ' + mesh.remark}" for tests, mesh in meshes]
        facts = [mesh for _, mesh in meshes]
        return cls(
            elements=sum(mesh.elements for mesh in facts),
            dofs=sum(mesh.dofs for mesh in facts),
            element=facts[0].element,
            smallest_mm=min(mesh.smallest_mm for mesh in facts),
            symmetry=max((mesh.symmetry for mesh in facts), key=ORDER.index),
            remark=f"each sample, indenter and symmetry has a mesh of its own: {'; '.join(own)}",
        )

    @property
    def part(self) -> str:
        """The part of the sample that was meshed, in words."""
        return "axisymmetric, meridian plane" if self.symmetry == "axisymmetric" else PARTS[self.symmetry].words

    def as_json(self) -> dict[str, Any]:
        """Stable keys; remark only where there is one."""
        return {key: value for key, value in asdict(self).items() if key != "remark" or value}


@dataclass(frozen=True)
class SolverFacts:
    """Facts of all tests of a simulation together: sums of work and time, the largest errors; `SolveFacts` describes each fact.

    Parameters
    ----------
    linear, assembly : str
        The linear solver's library, and how the body was assembled.
    setup_seconds : float, s
        Time to set up mesh, bases and pattern.
    """

    linear: str
    assembly: str
    steps: int
    cutbacks: int
    loose_steps: int
    newton_iterations: int
    factorizations: int
    solves: int
    krylov_iterations: int
    wall_seconds: float
    setup_seconds: float
    penalty_error: float
    residual_error: float
    edge_slip: float

    @classmethod
    def of(cls, tests: Iterable[SolveFacts], linear: str, assembly: str, setup_seconds: float) -> "SolverFacts":
        """The facts of several tests on one model."""
        tests = tuple(tests)
        return cls(
            linear=linear,
            assembly=assembly,
            steps=sum(facts.steps for facts in tests),
            cutbacks=sum(facts.cutbacks for facts in tests),
            loose_steps=sum(facts.loose_steps for facts in tests),
            newton_iterations=sum(facts.newton_iterations for facts in tests),
            factorizations=sum(facts.factorizations for facts in tests),
            solves=sum(facts.solves for facts in tests),
            krylov_iterations=sum(facts.krylov_iterations for facts in tests),
            wall_seconds=sum(facts.wall_seconds for facts in tests),
            setup_seconds=setup_seconds,
            penalty_error=max((abs(facts.penalty_error) for facts in tests), default=0.0),
            residual_error=max((facts.residual_error for facts in tests), default=0.0),
            edge_slip=max((facts.edge_slip for facts in tests), default=0.0),
        )

    def as_json(self) -> dict[str, Any]:
        """Stable keys."""
        return asdict(self)


def said_of_tries(tests: Iterable[tuple[str, SolveFacts]]) -> Iterator[str]:
    """A sentence for each of the tests, (name, facts), that was not solved at the first try."""
    for name, facts in tests:
        if facts.tries > 1:
            mesh = f"a mesh of {facts.elements} elements"
            yield f"test {name!r} was solved at try {facts.tries}, on {mesh}; the first try: {facts.first_failure}"
        elif facts.first_failure is not None:
            yield f"test {name!r}: {facts.first_failure}; {MAY_BE_OFF}"


def said_of_paths(tests: Iterable[tuple[str, SolveFacts]]) -> Iterator[str]:
    """Sentences for each of the tests, (name, facts), that has loose steps, or in whose sample the law loses its stability."""
    for name, facts in tests:
        if facts.loose_steps:
            number = "1 step is" if facts.loose_steps == 1 else f"{facts.loose_steps} steps are"
            yield (
                f"test {name!r}: {number} loose: accepted with up to {facts.largest_residual:.2%} of the contact force unbalanced, "
                f"by which a force may err by {facts.residual_error:.2%}"
            )
        if facts.unstable_from is not None:
            yield (
                f"{UNSTABLE}test {name!r}: from {quantity(facts.unstable_from, 'mm', 3)} on, its shear stress falls as the shear "
                f"grows ({facts.unstable:.1%} of the sample's points at the last depth); strain may gather in bands there, and "
                "forces may depend on the mesh by more than the stated error; check the law's parameters, or end the curve before"
            )


def not_as_asked(asked: int | None, elements: int) -> str:
    """That a mesh of about the wanted number of elements cannot be had, where it is far from the number; otherwise empty."""
    if asked is None or abs(elements - asked) <= NEAR * asked:
        return ""
    return f"mesh.elements = {asked} cannot be had: the nearest mesh has {elements} elements"
