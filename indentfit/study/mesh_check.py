"""Mesh-check: the errors of the forces of a case on its mesh and on a family of meshes, and the cost of each mesh.

The force approaches its limit at zero element size h like h^p. Singular edges (a sharp indenter's edge, the place where a strip
leaves the sample) make p about 1 for any element. A mesh that was solved only by a second try, which may be on another mesh, is
shown but not counted. Contact penalty, load step and edge radius are changed one at a time, on the case's own mesh.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from indentfit.arrays import Array
from indentfit.case import Case
from indentfit.case.uses import require_case
from indentfit.curve import Curve
from indentfit.inverse.objective import Target, equation_one, rmse
from indentfit.runs.forward import Evaluation
from indentfit.study.convergence import UNRELIABLE, Approach, Index, fitted, grid_convergence_index
from indentfit.study.mesh_family import MeshCheckPlan, own_checks, own_family, plan_mesh_check
from indentfit.study.mesh_measurement import Measured, costs_of, is_small, measure_all
from indentfit.study.refit import Refit, refits
from indentfit.study.runs import Execution, evaluate_elastic
from indentfit.study.sweep import stiffness

METHOD = (
    "error bands: 95 % profile interval of f0 in f(h) = f0 + C h^p, 0.5 <= p <= 2.1, by least squares over all meshes, and "
    "where the order is not believed also three times the distance of the finest mesh from the limit of p = 1; beside it "
    "the uncertainty of the finest mesh by Eca and Hoekstra 2014 (J Comput Phys 262:104); GCI of the three finest meshes by "
    "Roache and Celik et al. 2008 (J Fluids Eng 130:078001), safety factor 1.25"
)
LEAST_FAMILY = 4
WANTED = 0.02  # largest error of force and stiffness, by default


@dataclass(frozen=True)
class MeshResult:
    """One mesh of the family: its key, its forces and cost, and the misfit of its curves to the measured curves.

    Parameters
    ----------
    asked : str
        "mesh.size=..." or "mesh.elements=...".
    measured : Measured
    rmse : dict of test -> mN, or None
        RMSE of the tests that have a measured curve.
    objective : float or None, mN
        Equation (1), where every test has a measured curve.
    """

    asked: str
    measured: Measured
    rmse: dict[str, float] | None
    objective: float | None

    def as_json(self) -> dict[str, Any]:
        return {"asked": self.asked, **self.measured.as_json(), "rmse_mN": self.rmse, "objective_mN": self.objective}

    @classmethod
    def from_json(cls, value: Mapping[str, Any]) -> "MeshResult":
        return cls(value["asked"], Measured.from_json(value), value["rmse_mN"], value["objective_mN"])


@dataclass(frozen=True)
class Quantity:
    """One number of one test over the family: its values on the meshes that count, and its errors.

    Parameters
    ----------
    test : str
    kind : str
        "force" at the last displacement, mN, or "stiffness", mN/mm.
    h, values : arrays (n,)
    approach : Approach or None
    index : Index or None
    band : (low, high) or None
        Range from the finest mesh's value to the far end of the interval of the value at zero size; None where fewer than
        LEAST_FAMILY meshes count.
    error : array (n,) or None
        Largest error of each mesh, a share of its value.
    """

    test: str
    kind: str
    h: Array
    values: Array
    approach: Approach | None
    index: Index | None
    band: tuple[float, float] | None
    error: Array | None

    @property
    def unit(self) -> str:
        return "mN" if self.kind == "force" else "mN/mm"

    @property
    def finest(self) -> float | None:
        """The value on the finest mesh."""
        return float(self.values[self.h.argmin()]) if self.h.size else None

    @property
    def finest_uncertainty(self) -> float | None:
        """Half-width of the finest mesh's band by Eca and Hoekstra."""
        return None if self.approach is None else float(self.approach.uncertainty[self.h.argmin()])

    @classmethod
    def from_json(cls, value: Mapping[str, Any]) -> "Quantity":
        approach, index, band = value["approach"], value["index"], value["band"]
        arrays = {name: np.array(value[name], dtype=float) for name in ("h", "values")}
        return cls(
            value["test"],
            value["kind"],
            arrays["h"],
            arrays["values"],
            approach and Approach.from_json(approach),
            index and Index(**index),
            band and (band[0], band[1]),
            None if value["error"] is None else np.array(value["error"], dtype=float),
        )


@dataclass(frozen=True)
class Change:
    """One key of contact, steps or edge at another value: the change of each test's last force, a share, or the cause."""

    key: str
    value: float
    changes: dict[str, float] | None
    cause: str | None


@dataclass(frozen=True, repr=False, eq=False)
class MeshCheck:
    """The result of a mesh-check.

    Parameters
    ----------
    tests : dict of test -> angle, degrees
    parameters : dict of name -> value
        Parameters of the material, in their units.
    wanted : float
        Requested largest error of force and stiffness, a share.
    meshes : tuple of MeshResult, from coarse to fine
    quantities : tuple of Quantity
    changes : tuple of Change
    chosen : int or None
        Number of the coarsest mesh whose errors are small enough.
    verdict : str
    refits : tuple of Refit
        The parameters fitted anew on each mesh, if requested.
    case : Case or None
        None for a check that was read from result.json.
    """

    FORMAT: ClassVar[str] = "indentfit.mesh_check/2"

    title: str
    case_hash: str
    tests: dict[str, float]
    parameters: dict[str, float]
    wanted: float
    element: str
    linear: str
    meshes: tuple[MeshResult, ...]
    quantities: tuple[Quantity, ...]
    changes: tuple[Change, ...]
    chosen: int | None
    verdict: str
    refits: tuple[Refit, ...] = ()
    method: str = METHOD
    case: Case | None = None

    def as_json(self) -> dict[str, Any]:
        """The stable keys of a mesh-check's result.json, under the tag `format`."""
        same = ("method", "title", "case_hash", "tests", "parameters", "wanted", "element", "linear", "chosen", "verdict")
        return {
            "format": self.FORMAT,
            **{name: getattr(self, name) for name in same},
            "meshes": [mesh.as_json() for mesh in self.meshes],
            "quantities": [asdict(quantity) for quantity in self.quantities],
            "changes": [asdict(change) for change in self.changes],
            "refits": [asdict(refit) for refit in self.refits],
        }

    @classmethod
    def from_json(cls, value: Mapping[str, Any]) -> "MeshCheck":
        """The check that result.json holds, in the form of this version or of 0.1."""
        same = ("method", "title", "case_hash", "tests", "parameters", "wanted", "element", "linear", "chosen", "verdict")
        return cls(
            **{name: value[name] for name in same},
            meshes=tuple(map(MeshResult.from_json, value["meshes"])),
            quantities=tuple(map(Quantity.from_json, value["quantities"])),
            changes=tuple(Change(**change) for change in value["changes"]),
            refits=tuple(map(Refit.from_json, value.get("refits", ()))),
        )

    def summary(self) -> str:
        """The check in words, as the command prints it."""
        from indentfit.report.study_text import mesh_check_lines

        return "\n".join(mesh_check_lines(self))

    def plot(self, path: str | Path | None = None) -> Any:
        """The matplotlib Figure of the quantities over the element size; saved as SVG and PNG where a path is given."""
        from indentfit.report.mesh_check import convergence_figure

        return convergence_figure(self.quantities, path)

    def write(self, folder: str | Path, overwrite: bool = False) -> None:
        """Write the result folder. Raises OutputError where the folder exists already, or cannot be written."""
        from indentfit.report.study_folder import write_study

        write_study(self, folder, overwrite)

    def __repr__(self) -> str:
        return f"MeshCheck({self.title!r}: {len(self.meshes)} meshes; {self.verdict.partition('. ')[0]})"

    def _repr_html_(self) -> str:
        from indentfit.report.study_text import html_table, mesh_rows

        return html_table(repr(self), mesh_rows(self))


def mesh_check(
    case: Case,
    family: Sequence[str] = (),
    checks: Mapping[str, Sequence[float]] | None = None,
    wanted: float = WANTED,
    refit: bool = False,
    execution: Execution | None = None,
) -> MeshCheck:
    """The errors of a case on a family of meshes, and the cost of each mesh.

    Parameters
    ----------
    case : Case
        The case; a free parameter has its start value.
    family : sequence of "mesh.size=..." or "mesh.elements=..."
        The meshes; by default six meshes around the case's own.
    checks : mapping of keys to values
        Other values of contact penalty, load steps and edge; by default `own_checks(case)`, none for an empty mapping.
    wanted : float
        Largest error of force and stiffness, a share.
    refit : bool
        Whether the free parameters are also fitted anew on each mesh.
    execution : Execution
        Ledger and progress; each mesh of the family is run in a process of its own, with no other beside it.

    Returns
    -------
    MeshCheck
        The check, which records failures of the mechanics with their cause.

    Raises
    ------
    CaseError
    MeshError
        A mesh cannot be made, or does not fit into memory.
    """
    require_case(case)
    plan = plan_mesh_check(case, family or own_family(case), own_checks(case) if checks is None else checks)
    return run_mesh_check(plan, wanted, refit, execution or Execution())


def run_mesh_check(plan: MeshCheckPlan, wanted: float, refit: bool, execution: Execution) -> MeshCheck:
    """The MeshCheck of a MeshCheckPlan; the other arguments are those of `mesh_check`."""
    case = plan.case
    family, others = [on_mesh for _, on_mesh in plan.family], plan.cases[len(plan.family) :]
    costs = costs_of(plan.cases)
    first = float(costs[: len(family)].sum() / costs.sum())
    measured = measure_all(family, execution.part(0.0, first))
    changed = _evaluated(others, execution.part(first, 1.0)) if others else ()
    meshes = tuple(_mesh_results(case, plan, measured))
    quantities = tuple(_quantities(case, [mesh.measured for mesh in meshes]))
    chosen, verdict = _verdict(meshes, quantities, wanted)
    return MeshCheck(
        title=case.title,
        case_hash=case.hash,
        tests={test.name: test.direction for test in case.tests},
        parameters=case.start_values(),
        wanted=wanted,
        element=case.solver.element,
        linear=case.solver.linear,
        meshes=meshes,
        quantities=quantities,
        changes=tuple(_changes(case, changed, plan.others)),
        chosen=chosen,
        verdict=verdict,
        refits=refits(plan.family, execution) if refit else (),
        case=case,
    )


def _mesh_results(case: Case, plan: MeshCheckPlan, measured: Sequence[Measured]) -> Iterator[MeshResult]:
    """One for each different number of elements."""
    known = set()
    for (asked, _), on_mesh in zip(plan.family, measured, strict=False):
        if on_mesh.elements not in known:
            known.add(on_mesh.elements)
            yield MeshResult(asked, on_mesh, *_misfits(case, on_mesh))


def _quantities(case: Case, measured: Sequence[Measured]) -> Iterator[Quantity]:
    computed = [(on_mesh.h, on_mesh.forces) for on_mesh in measured if on_mesh.counts and on_mesh.forces is not None]
    h = np.array([size for size, _ in computed], dtype=float)
    for n, test in enumerate(case.tests):
        curves = [Curve(case.outputs(test), forces[n]) for _, forces in computed]
        yield _quantity(test.name, "force", h, np.array([curve.force[-1] for curve in curves]))
        if case.outputs(test).size > 1:
            yield _quantity(test.name, "stiffness", h, np.array([stiffness(curve) for curve in curves]))


def _quantity(test: str, kind: str, h: Array, values: Array) -> Quantity:
    if h.size < LEAST_FAMILY:
        return Quantity(test, kind, h, values, None, grid_convergence_index(h, values), None, None)
    approach, finest = fitted(h, values), int(np.argmin(h))
    half = approach.band(values)
    band = (min(float(values[finest]), approach.interval[0]), max(float(values[finest]), approach.interval[1]))
    return Quantity(test, kind, h, values, approach, grid_convergence_index(h, values), band, half / np.abs(values))


def _misfits(case: Case, measured: Measured) -> tuple[dict[str, float] | None, float | None]:
    """RMSE of each measured test, mN, and equation (1)'s objective where all were measured."""
    if measured.forces is None or all(curve is None for curve in case.curves):
        return None, None
    targets = [
        (Target(test.name, curve, float(test.weight or 0.0)), force)
        for test, curve, force in zip(case.tests, case.curves, measured.forces, strict=True)
        if curve is not None
    ]
    errors = {target.name: rmse(target, force) for target, force in targets}
    if len(targets) < len(case.tests):
        return errors, None
    return errors, equation_one([target for target, _ in targets], [force for _, force in targets])


def _evaluated(cases: Sequence[Case], execution: Execution) -> Sequence[Measured | Evaluation]:
    """The forces of cases whose cost is not told: those of small meshes are computed by workers, as those of a sweep are."""
    return evaluate_elastic(cases, execution) if all(map(is_small, cases)) else measure_all(cases, execution)


def _changes(case: Case, evaluated: Sequence[Measured | Evaluation], others: Sequence[tuple[str, float, Case]]) -> Iterator[Change]:
    """Changes of the last forces by each key's value against the case itself, which was evaluated first."""
    for (key, value, _), changed in zip(others, evaluated[1:], strict=True):
        own = evaluated[0]
        if changed.forces is None or own.forces is None:
            yield Change(key, value, None, changed.cause or own.cause)
            continue
        pairs = zip(case.tests, changed.forces, own.forces, strict=True)
        yield Change(key, value, {test.name: float(new[-1] / old[-1] - 1) for test, new, old in pairs}, None)


def _verdict(meshes: Sequence[MeshResult], quantities: Sequence[Quantity], wanted: float) -> tuple[int | None, str]:
    """Number of the coarsest mesh whose bands are all within the wanted error, or None; and words."""
    computed = [n for n, mesh in enumerate(meshes) if mesh.measured.counts]
    if len(computed) < LEAST_FAMILY:
        return None, f"no verdict: {len(computed)} meshes of the family were computed, and an error needs {LEAST_FAMILY}"
    worst = np.max([quantity.error for quantity in quantities if quantity.error is not None], axis=0)
    good = [n for n in range(len(computed)) if (worst[n:] <= wanted).all()]
    place = good[0] if good else int(np.argmin(worst))
    mesh = meshes[computed[place]]
    what = f"{mesh.asked} ({mesh.measured.elements:,} elements)"
    if not good:
        return None, (
            f"none of these meshes is exact to {100 * wanted:g} % of force and stiffness with certainty; the best is {what}, "
            f"within {worst[place]:.2%}; ask for finer ones. {_order_verdict(quantities)}"
        )
    return computed[place], (
        f"{what} is the coarsest mesh exact to {100 * wanted:g} % of force and stiffness "
        f"(within {worst[place]:.2%}): {mesh.measured.cpu_seconds:.3g} s of processor time for all tests, "
        f"{mesh.measured.memory / 1e6:.0f} MB. {_order_verdict(quantities)}"
    )


def _order_verdict(quantities: Sequence[Quantity]) -> str:
    """The observed orders of the forces, and whether they are believed, in words."""
    forces = [(q.test, q.approach) for q in quantities if q.kind == "force" and q.approach is not None]
    seen = [f"{approach.order:.2g} ({test})" for test, approach in forces if approach.order]
    unseen = [f"{approach.raw_order:.2g} ({test})" for test, approach in forces if not approach.order]
    words = f"Observed order of the force: {', '.join(seen)}; about 1 is usual where edges are singular" if seen else ""
    if unseen:
        words += "; " if seen else "Order of the force: "
        words += f"{', '.join(unseen)} is not believed, and the band there is widened, as if by a safety factor of {UNRELIABLE:g}"
    return words
