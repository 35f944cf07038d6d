"""The meshes that a mesh-check compares, the memory that each needs, and the other keys that the check varies.

The family is one mesh at several sizes: the widths of its elements at the singular edges are a smooth function of the element
size h, mm (`mesh.size`); only its numbers of elements are rounded, so that the meshes are similar, not nested.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from indentfit.case import Case, require_indentations
from indentfit.errors import CaseError, MeshError
from indentfit.experiment.measured import changed_case
from indentfit.fem.linear.choice import choice
from indentfit.fem.meshing import count
from indentfit.runs.isolated import available_memory
from indentfit.runs.points import setup_of

SHARES = (0.2, 0.4, 0.5, 1.0, 2.0, 3.5)  # of the case's number of elements: a wide range of sizes at acceptable cost
FITS = 0.9  # largest share of the free memory that a mesh may need
# Peak memory of a run, bytes: a process with the libraries, and for each dof what element and solver take, which a factor of
# three-dimensional nested dissection makes grow as n^(4/3). Quarter discs of 5,600 to 130,000 dofs took within 6 % of it with
# PARDISO, 27,000 to 28,000 within 16 % with multigrid, which took a quarter less at 411,000; SuperLU's fill is a guess from above.
PROCESS, PER_DOF = 320e6, {"q2p1": 14e3, "q1p0": 5e3}
PER_DOF_FACTOR = {"pardiso": 200.0, "superlu": 1200.0, "pyamg": 100.0}
CHECKS = {
    "solver.penalty": (0.3, 3.0, 10.0),  # factors on the case's own
    "solver.max_step": (1 / 16, 1 / 32, 1 / 64),  # of the largest displacement; a usual path has 4 to 12 steps
    "indenter.edge_radius": (0.2, 0.1, 0.05),  # of the indenter's half-width; a default mesh does not resolve less
}

Checks = Mapping[str, Sequence[float]]


@dataclass(frozen=True)
class MeshCheckPlan:
    """The cases that a mesh-check computes.

    Parameters
    ----------
    case : Case
    family : tuple of (what was asked, Case), from coarse to fine
    others : tuple of (key, value, Case)
        Contact, load steps and edge at other values, on the case's own mesh.
    """

    case: Case
    family: tuple[tuple[str, Case], ...]
    others: tuple[tuple[str, float, Case], ...]

    @property
    def cases(self) -> list[Case]:
        own = [self.case] if self.others else []
        return [case for _, case in self.family] + own + [case for *_, case in self.others]


def plan_mesh_check(case: Case, family: Sequence[str], checks: Checks | None = None) -> MeshCheckPlan:
    """The plan of a mesh-check of a case, of whose tests the indentations are computed.

    Parameters
    ----------
    case : Case
    family : sequence of "mesh.size=..." or "mesh.elements=..."
    checks : mapping of keys to values of contact, load steps and edge, as `own_checks` gives them

    Returns
    -------
    MeshCheckPlan

    Raises
    ------
    CaseError
    MeshError
        A mesh cannot be made, or does not fit into memory; the error's text states the estimate.
    """
    require_indentations(case, "a mesh-check")
    cases = [(asked, changed_case(case, [asked]).of_indentations) for asked in family]
    others = [
        (key, value, changed_case(case, [f"{key}={value:.10g}"]).of_indentations)
        for key, values in (checks or {}).items()
        for value in values
    ]
    case = case.of_indentations
    for asked, changed in cases:
        _refuse_too_large(changed, asked)
    return MeshCheckPlan(case, tuple(sorted(cases, key=lambda pair: estimate(pair[1])[0])), tuple(others))


def own_family(case: Case) -> list[str]:
    """The default family around the case's mesh, as overrides."""
    require_indentations(case, "a mesh-check")
    setups = [setup_of(piece) for piece in case.pieces]
    own = max(count(setup) / setup.quarters for setup in setups)  # mesh.elements is the number of a quarter
    return [f"mesh.elements={max(20, round(share * own))}" for share in SHARES]


def own_checks(case: Case) -> dict[str, list[float]]:
    """Key -> values of contact penalty, load step and edge radius, in the units of the case."""
    deepest = largest_depth(case)
    checks = {
        "solver.penalty": [share * case.solver.penalty for share in CHECKS["solver.penalty"]],
        "solver.max_step": [float(f"{share * deepest:.4g}") for share in CHECKS["solver.max_step"]],
    }
    shape = case.indenter.geometry
    if shape.edge_radius is not None and case.indenter.friction != "stick" and case.shares("indenter", "edge_radius"):
        radii = [share * shape.half_width for share in CHECKS["indenter.edge_radius"]]
        own = shape.edge_radius
        checks["indenter.edge_radius"] = ([0.0, own / 2, own * 2] if own else radii)[:3]
    return checks


def parse_family(option: str, text: str) -> list[str]:
    """Overrides of a family from a text of --sizes ("0.6,0.5 mm") or --elements ("60,100"). Raises CaseError."""
    parts = [part.strip() for part in text.split(",")]
    if "" in parts or len(set(parts)) < 2:
        raise CaseError(f"--{option} {text}: give two or more values, separated by commas")
    return [f"mesh.{'size' if option == 'sizes' else 'elements'}={part}" for part in dict.fromkeys(parts)]


def estimate(case: Case) -> tuple[int, int, float]:
    """Elements, degrees of freedom and peak memory, bytes, of a case, before its mesh is made: of the largest mesh of its tests."""
    elements = max(count(setup_of(piece)) for piece in case.pieces)
    nodes = elements * (8 if case.solver.element == "q2p1" else 1)
    dofs = 3 * nodes * (1 + 1 / nodes ** (1 / 3)) ** 3
    return elements, round(dofs), memory_of(dofs, case.solver.element, case.solver.linear)


def largest_depth(case: Case) -> float:
    """The largest depth of the case's tests, mm: the mesh is made for it."""
    return max(float(case.outputs(test)[-1]) for test in case.indentations)


def memory_of(dofs: float, element: str, linear: str = "auto") -> float:
    """Peak memory of a run, bytes."""
    factor = PER_DOF_FACTOR[choice(linear, round(dofs))]
    return PROCESS + PER_DOF[element] * dofs + factor * dofs ** (4 / 3)


def _refuse_too_large(case: Case, asked: str) -> None:
    elements, dofs, memory = estimate(case)
    free = available_memory()
    if free is not None and memory > FITS * free:
        where = f"{case.path}: " if case.path else ""
        raise MeshError(
            f"{where}{asked.replace('=', ' = ')}: about {elements:,} elements, {dofs:,} degrees of freedom and "
            f"{memory / 1e9:.1f} GB of memory, of which {free / 1e9:.1f} GB are free; ask for a coarser mesh"
        )
