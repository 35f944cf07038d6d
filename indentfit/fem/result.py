"""Results of a simulation: each test's curve with the facts of its solution, and all tests of a case together."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from indentfit.arrays import Array
from indentfit.axes import INDENTATION, Axes
from indentfit.curve import Curve
from indentfit.fem.equilibrium import Equilibrium
from indentfit.fem.facts import MeshFacts, SolveFacts, SolverFacts
from indentfit.fibre_map import FibreMap
from indentfit.fibres import Families, words

if TYPE_CHECKING:
    from indentfit.fem.simulate import Model

UNSOLVED = "the viscoelastic model was not solved on the second mesh"
HALF = 0.5  # of the force at the end of a ramp, or at a turn: a smaller one counts as so large where models are compared


@dataclass(frozen=True, eq=False)
class ForceError:
    """The stated error of a test's forces by the mesh.

    Parameters
    ----------
    band : array (n,), mN
        At each displacement the exact force is within this of the force on the mesh, in 95 of 100 contacts.
    elements : int
        Number of elements of the second mesh, from which the band was estimated.
    remark : str
        Why meshes say little about the error, and what would help; mostly empty.
    correction : array (n,)
        The force times 1 + correction is the best estimate of the force without an error of the mesh.
    left : array (n,)
        Standard deviation of what the correction leaves, relative to the force.
    """

    band: Array
    elements: int
    remark: str
    correction: Array
    left: Array

    def share(self, force: Array) -> float:
        """The band at the last displacement, as a share of the force (n,) there."""
        return float(self.band[-1] / max(abs(force[-1]), 1e-300))

    def largest_share(self, force: Array) -> float:
        """The largest band over the force (n,) at the same displacement."""
        return float(np.max(self.band / np.maximum(np.abs(force), 1e-300)))


@dataclass(frozen=True, eq=False)
class TimeCurve:
    """The force of one test over time, in its ramp, hold and retraction; or its depth, where the rig holds the force.

    Parameters
    ----------
    time : array (n,), s
    displacement : array (n,), mm
    force : array (n,), mN
        Force of the whole sample by the viscoelastic model, where that was solved; otherwise the hereditary integral of the elastic
        force.
    difference : float, or None
        Largest relative difference between the two over the solved steps, as far as it `counts`; None where the viscoelastic model
        was not solved. Under a held force that of the depths.
    cause : str
        Why it was not solved; empty where it was.
    control : str
        What the rig controls: "displacement" or "force".
    ends : str
        Why a creep is not followed to the end of its hold, or the model of a retraction ends early; empty where it does not.
    ratio : function, or None
        Times (n,), s -> force of the viscoelastic model over the hereditary integral; None where it is not known, and under a held
        force.
    by_mesh : float, str, or None
        What the mesh adds to the relative error of the viscoelastic model: the largest change of `ratio` on a second mesh. Under a
        held force the relative error of the depth by the mesh. Or why that is not known; None where it was not asked for.
    in_retraction : float, str, or None
        Largest difference between the model and the rule that fits follow in a retraction, over the force at its start. Or why it
        is not known; None where the indenter does not go back.
    """

    time: Array
    displacement: Array
    force: Array
    difference: float | None = None
    cause: str = ""
    control: str = "displacement"
    ends: str = ""
    ratio: Callable[[Array], Array] | None = field(default=None, repr=False, compare=False)
    by_mesh: float | str | None = None
    in_retraction: float | str | None = None

    @property
    def creeps(self) -> bool:
        """Whether the force is held and the depth creeps."""
        return self.control == "force"

    def words(self) -> str:
        """By which model the force over time, or the depth, was solved, and how far the other one is."""
        if self.creeps and self.difference is not None:
            said = "viscoelastic model; the depth by the elastic force's hereditary integral differs by at most"
            return f"{said} {self.difference:.2%}{self._of_creep_by_mesh()}"
        if self.difference is None:
            return f"hereditary integral of the elastic force; the viscoelastic model was not solved: {self.cause}"
        said = f"viscoelastic model; the hereditary integral of the elastic force differs by at most {self.difference:.2%}"
        return said + self._by_mesh() + self._in_retraction()

    @property
    def largest(self) -> float:
        """The largest difference of the model from the forces of fits, over the force; in a retraction over that at its start."""
        return max(self.difference or 0.0, self.in_retraction if isinstance(self.in_retraction, float) else 0.0)

    def _in_retraction(self) -> str:
        """How far the model is from the rule of fits in a retraction, in words."""
        if self.in_retraction is None:
            return ""
        if isinstance(self.in_retraction, str):
            return f"; the viscoelastic model of the retraction was not solved ({self.in_retraction})"
        told = f"; in the retraction the rule of fits differs by at most {self.in_retraction:.2%} of the force at its start"
        return told + (f"; {self.ends}" if self.ends else "")

    @property
    def error_by_mesh(self) -> float:
        """`by_mesh`; 0 where it is not known."""
        return self.by_mesh if isinstance(self.by_mesh, float) else 0.0

    def _by_mesh(self) -> str:
        """What the mesh adds to the error of the model, in words."""
        if self.by_mesh is None:
            return ""
        if isinstance(self.by_mesh, str):
            return f"; what the mesh adds to this difference is not known ({self.by_mesh})"
        return f", {self.by_mesh:.2%} more or less on the second mesh"

    def counts(self, times: Array) -> Array:
        """The share (n,) of a relative difference at times (n,), s, that counts: in a ramp differences of forces below HALF of its
        last one are measured by that, or under a held force those of depths. A few elements touch there, and these forces hardly
        weigh in a fit."""
        held, solved = (self.force, self.displacement) if self.creeps else (self.displacement, self.force)
        arrived = int(np.argmax(held >= held.max() * (1 - 1e-9)))
        there = np.interp(times, np.append(0.0, self.time), np.append(0.0, solved))
        ahead = np.minimum(there / max(HALF * solved[arrived], 1e-300), 1.0)
        return np.where(times > self.time[arrived], 1.0, ahead)

    def counted(self, times: Array, differences: Array) -> float:
        """The largest of relative differences (n,) at times (n,), s, as far as they count."""
        return float(np.abs(self.counts(times) * differences).max())

    def _of_creep_by_mesh(self) -> str:
        """The error of the depth by the mesh, in words."""
        if isinstance(self.by_mesh, str):
            return f"; its error by the mesh is not known ({self.by_mesh})"
        return (
            "" if self.by_mesh is None else f"; the mesh errs by at most {self.by_mesh:.2%} of the depth (95 %, by a second mesh)"
        )

    def with_second(self, second: "TestResult", factor: float, least: float) -> "TimeCurve":
        """This curve with what its second mesh tells of it: the largest change of `ratio`, times a factor. Under a held force it is
        the change of the depth, and no less than `least`."""
        if self.difference is None:
            return self
        other = second.in_time
        if other is None or other.difference is None:
            return replace(self, by_mesh=f"{UNSOLVED}: {other.cause}" if other is not None and other.cause else UNSOLVED)
        if self.creeps:
            both = self.time <= other.time[-1]  # a creep ends where it reaches the depth of the test
            change = np.interp(self.time, other.time, other.displacement)[both] / self.displacement[both] - 1
            return replace(self, by_mesh=max(factor * self.counted(self.time[both], change), least))
        if self.ratio is None or other.ratio is None:
            return replace(self, by_mesh=UNSOLVED)
        return replace(self, by_mesh=factor * self.counted(self.time, other.ratio(self.time) / self.ratio(self.time) - 1))

    def as_json(self) -> dict[str, Any]:
        """The stable keys of a test's force over time."""
        return {
            "time_s": self.time.tolist(),
            "displacement_mm": self.displacement.tolist(),
            "force_mN": self.force.tolist(),
            "hereditary_integral_differs_by": self.difference,
            **({} if self.by_mesh is None else {"difference_by_mesh": self.by_mesh}),
            **({"not_solved": self.cause} if self.cause else {}),
            **({"control": self.control} if self.creeps else {}),
            **({"ends": self.ends} if self.ends else {}),
            **({} if self.in_retraction is None else {"retraction_differs_by": self.in_retraction}),
        }

    @classmethod
    def from_json(cls, value: Mapping[str, Any]) -> "TimeCurve":
        """The TimeCurve of these keys."""
        time, displacement, force = (np.array(value[key]) for key in ("time_s", "displacement_mm", "force_mN"))
        told = value["hereditary_integral_differs_by"], value.get("not_solved", ""), value.get("control", "displacement")
        by_mesh, in_retraction = value.get("difference_by_mesh"), value.get("retraction_differs_by")
        return cls(time, displacement, force, *told, value.get("ends", ""), by_mesh=by_mesh, in_retraction=in_retraction)


@dataclass(frozen=True, eq=False)
class TestResult:
    """One simulated test.

    Parameters
    ----------
    name : str
    angle : float, degrees
        Angle of the fibres to x, in the plane of the sample.
    displacement : array (n,), mm
        The requested depths.
    force : array (n,), mN
        Force of the whole sample.
    facts : SolveFacts
    sensitivities : dict of name -> array (n,), mN per unit
        Derivatives of the force by the requested names; None where the path could not be differentiated.
    path : tuple of Equilibrium
        Equilibria from the untouched sample to the last depth, for stresses and files (fem.fields).
    model : Model
        The model of the path. It is not the model that was run where a later try solved the test.
    unfinished : str
        Why the curve ends before the last depth that was asked for; empty where it does not.
    mesh_error : ForceError, a cause, or None
        The error of the forces by the mesh (fem.mesh_error), or why it is not known; None where nobody asked for it.
    in_time : TimeCurve, or None
        Force over time, where the material relaxes and time was asked for.
    axes : Axes
        What displacement and force are: strain and stress in some tests without an indenter.
    kind, fibres : str
        Kind of the test, and where it is no indentation the direction of the fibres, if there are any.
    dip : float, degrees
        Angle of the fibres out of the plane of the sample.
    families : Families, FibreMap or None
        Two families of fibres about the direction of `angle`, or directions on points.
    seen : array (m,), mm, or None
        Displacements that were requested beside the force (`Press.observed`).
    seen_by : dict of name -> array (m,), mm per unit
        Their derivatives by the requested names.
    """

    __test__ = False  # not a test of pytest's

    name: str
    angle: float
    displacement: Array
    force: Array
    facts: SolveFacts = field(default_factory=SolveFacts)
    sensitivities: dict[str, Array] | None = None
    path: tuple[Equilibrium, ...] = field(default=(), repr=False)
    model: "Model | None" = field(default=None, repr=False)
    unfinished: str = ""
    mesh_error: ForceError | str | None = field(default=None, repr=False)
    in_time: TimeCurve | None = field(default=None, repr=False)
    axes: Axes = INDENTATION
    kind: str = "indentation"
    fibres: str | None = None
    dip: float = 0.0
    families: Families | FibreMap | None = None
    seen: Array | None = field(default=None, repr=False)
    seen_by: dict[str, Array] | None = field(default=None, repr=False)

    @property
    def curve(self) -> Curve:
        """Force over displacement."""
        return Curve(self.displacement, self.force, axes=None if self.axes == INDENTATION else self.axes)

    @property
    def direction(self) -> str:
        """The direction of the fibres, in words."""
        return (
            words(self.angle, self.dip, self.families)
            if self.kind == "indentation"
            else f"{self.kind}, {self.fibres or 'no fibres'}"
        )

    @property
    def last(self) -> Equilibrium:
        """The equilibrium at the last depth."""
        return self.path[-1]


@dataclass(frozen=True, eq=False)
class Simulation:
    """All tests of a case, its mesh and the facts of their solution."""

    tests: tuple[TestResult, ...]
    mesh: MeshFacts
    solver: SolverFacts

    def as_json(self) -> dict[str, Any]:
        """The stable keys of `simulate --json`."""
        return {
            "tests": [
                {
                    "name": test.name,
                    **_direction(test),
                    test.axes.header[0]: test.displacement.tolist(),
                    test.axes.header[1]: test.force.tolist(),
                    "facts": test.facts.as_json(),
                    **({"unfinished": test.unfinished} if test.unfinished else {}),
                    **_mesh_error(test),
                    **({"in_time": test.in_time.as_json()} if test.in_time else {}),
                }
                for test in self.tests
            ],
            "mesh": self.mesh.as_json(),
            "solver": self.solver.as_json(),
        }


def _direction(test: TestResult) -> dict[str, Any]:
    """The stable keys of a test's direction: the angle of an indentation; kind and fibres of another test."""
    if test.kind == "indentation":
        return {"angle": test.angle, **({"dip": test.dip} if test.dip else {}), **_families(test)}
    return {"angle": None, "kind": test.kind, "fibres": test.fibres}


def _families(test: TestResult) -> dict[str, Any]:
    """The stable key of two families of fibres, angle and dip of each, or of a map, its file."""
    if isinstance(test.families, FibreMap):
        return {"directions": test.families.file}
    return {"families": [list(family) for family in test.families]} if test.families is not None else {}


def _mesh_error(test: TestResult) -> dict[str, Any]:
    """The stable keys of a test's error by the mesh: the band, or why it is not known."""
    error = test.mesh_error
    if isinstance(error, ForceError):
        return {"mesh_error_mN": error.band.tolist(), "mesh_error_from_elements": error.elements}
    return {} if error is None else {"mesh_error_mN": None, "mesh_error_cause": error}
