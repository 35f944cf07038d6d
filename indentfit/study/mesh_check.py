"""How exact the forces of a case are on its mesh, and on a family of meshes, and what that costs.

The family is one mesh at several sizes: the widths of its elements at the singular edges are a smooth function of the element
size h, mm (`mesh.size`), only its numbers of elements are rounded, so that the meshes are similar, not nested. The force approaches
its limit at zero size like h^p; singular edges (a sharp indenter's, a strip's end on the sample's rim) make p about 1 for any
element. A mesh that was solved only by a second try, which may be on another mesh, is shown and not counted. Changes by contact
penalty, load step and edge radius are found one at a time on the case's own mesh.
"""

import time
from dataclasses import asdict, dataclass, replace

import numpy as np

from indentfit.case import Case
from indentfit.curve import Curve
from indentfit.errors import CaseError, ConvergenceError, IndentfitError, MeshError
from indentfit.experiment.measured import changed_case
from indentfit.fem import mesh as meshes
from indentfit.fem.simulate import Model
from indentfit.inverse.objective import Target, equation_one, rmse
from indentfit.runs.forward import presses_of
from indentfit.runs.points import press_of, setup_of
from indentfit.runs.run import Run
from indentfit.study.convergence import UNRELIABLE, Approach, Index, fitted, grid_convergence_index
from indentfit.study.isolated import DIED, Died, available_memory, isolated, peak_memory
from indentfit.study.refit import Refit, refits
from indentfit.study.sweep import stiffness

FORMAT = "indentfit.mesh-check/1"
METHOD = (
    "error bands: 95 % profile interval of f0 in f(h) = f0 + C h^p, 0.5 <= p <= 2.1, by least squares over all meshes, and "
    "where the order is not believed also three times the distance of the finest mesh from the limit of p = 1; beside it "
    "the uncertainty of the finest mesh by Eca and Hoekstra 2014 (J Comput Phys 262:104); GCI of the three finest meshes by "
    "Roache and Celik et al. 2008 (J Fluids Eng 130:078001), safety factor 1.25"
)
SHARES = (0.2, 0.4, 0.5, 1.0, 2.0, 3.5)  # of the case's number of elements: a wide range of sizes, at bearable costs
LEAST_FAMILY = 4
FITS = 0.9  # of the memory that is free
MEASURED = "measured"  # among a run's parameters: done in a process of its own, with what that process needed among its facts
# Peak memory of a run, bytes: a process with the libraries, and for each dof what element and solver take, which a factor of
# three-dimensional nested dissection makes grow as n^(4/3). Quarter discs of 5,600 to 130,000 dofs took within 6 % of it with
# PARDISO, 27,000 to 28,000 within 16 % with multigrid, which took a quarter less at 411,000; SuperLU's fill is a guess from above.
PROCESS, PER_DOF = 320e6, {"q2p1": 14e3, "q1p0": 5e3}
PER_DOF_FACTOR = {"pardiso": 200.0, "superlu": 1200.0, "pyamg": 100.0}
CHECKS = {
    "solver.penalty": (0.3, 3.0, 10.0),  # factors on the case's own
    "solver.max_step": (0.05, 0.025, 0.0125),  # of the largest displacement
    "indenter.edge_radius": (0.2, 0.1, 0.05),  # of the indenter's half-width; a default mesh does not resolve less
}


@dataclass(frozen=True)
class Measured:
    """The tests of a case on one mesh: what they gave, and what they cost; `cause` instead of forces where they failed.

    h: mm, None where it failed; tries: 1, or more where the usual contact and mesh did not converge; forces: mN, an array (n,)
    for each test; cpu_seconds: of all tests, without the set-up; memory: peak, bytes.
    """

    elements: int
    dofs: int
    h: float | None
    forces: tuple[np.ndarray, ...] | None
    newton_iterations: int
    factorizations: int
    loose_steps: int
    tries: int
    penalty_error: float
    cpu_seconds: float
    setup_seconds: float
    memory: int
    cause: str | None

    @property
    def counts(self):
        """Whether it is one of the family."""
        return self.forces is not None and self.tries == 1


@dataclass(frozen=True)
class Quantity:
    """One number of one test over the family: its values on the meshes that count, in their order, and its errors.

    kind: "force" at the last displacement, mN, or "stiffness", mN/mm; band: (low, high), from the finest mesh to the
    far end of where the value at zero size may lie, or None where fewer than LEAST_FAMILY meshes count; error (n,): each mesh's
    largest error, a share of its value.
    """

    test: str
    kind: str
    h: np.ndarray
    values: np.ndarray
    approach: Approach | None
    index: Index | None
    band: tuple[float, float] | None
    error: np.ndarray | None


@dataclass(frozen=True)
class Change:
    """One key of contact, steps or edge at another value: the change of each test's last force, a share, or the cause."""

    key: str
    value: float
    changes: dict[str, float] | None
    cause: str | None


@dataclass(frozen=True)
class MeshCheck:
    """The whole check; `meshes` from coarse to fine as (what was asked, Measured), `chosen`: the verdict's mesh or None."""

    title: str
    case_hash: str
    tests: dict[str, int]
    parameters: dict[str, float]
    wanted: float
    element: str
    linear: str
    meshes: tuple[tuple[str, Measured], ...]
    rmse: tuple[dict[str, float] | None, ...]
    objective: tuple[float | None, ...]
    quantities: tuple[Quantity, ...]
    changes: tuple[Change, ...]
    chosen: int | None
    verdict: str
    refits: tuple[Refit, ...] = ()

    def as_json(self):
        """The stable keys of a mesh-check's result.json."""
        return {
            "format": FORMAT,
            "method": METHOD,
            **{name: getattr(self, name) for name in ("title", "case_hash", "tests", "parameters", "wanted", "element", "linear")},
            "meshes": [
                {"asked": asked, **asdict(one), "rmse_mN": errors, "objective_mN": objective}
                for (asked, one), errors, objective in zip(self.meshes, self.rmse, self.objective, strict=True)
            ],
            "quantities": [asdict(one) for one in self.quantities],
            "changes": [asdict(one) for one in self.changes],
            "chosen": self.chosen,
            "refits": [asdict(one) for one in self.refits],
            "verdict": self.verdict,
        }


@dataclass(frozen=True)
class Plan:
    """What a check computes: the Case, its family of (what was asked, Case) from coarse to fine, and the (key, value, Case) of
    contact, steps and edge."""

    case: Case
    family: tuple[tuple[str, Case], ...]
    others: tuple[tuple[str, float, Case], ...]

    @property
    def cases(self):
        own = [self.case] if self.others else []
        return [one for _, one in self.family] + own + [one for *_, one in self.others]


def plan(case, family, checks=None):
    """Plan of a check of a Case over a family, a list of "mesh.size=..." or "mesh.elements=..."; checks: key -> values of contact,
    steps and edge (`own_checks`).

    Raises CaseError, and MeshError for a mesh that cannot be or that does not fit into memory, with the estimate.
    """
    cases = [(asked, changed_case(case, [asked])) for asked in family]
    others = [(k, v, changed_case(case, [f"{k}={v:.10g}"])) for k, vs in (checks or {}).items() for v in vs]
    for asked, one in cases:
        _refuse_too_large(one, asked)
    return Plan(case, tuple(sorted(cases, key=lambda pair: estimate(pair[1])[0])), tuple(others))


def mesh_check(planned, ledger=None, wanted=0.02, progress=None):
    """MeshCheck of a Plan; wanted: largest error of force and stiffness, a share.

    ledger: a Ledger with the plan's cases among its own, where what is measured is looked up and kept, or None. progress: called
    with (share done, note). Raises LedgerError; failures of the mechanics are in the result.
    """
    case, family = planned.case, planned.family
    found = _measure_all(planned.cases, ledger, progress or (lambda share, note: None))
    family_found = [(asked, one) for (asked, _), one in zip(family, found, strict=False)]
    family_found = [
        pair for n, pair in enumerate(family_found) if pair[1].elements not in [o.elements for _, o in family_found[:n]]
    ]
    quantities = tuple(_quantities(case, [one for _, one in family_found]))
    changes = tuple(_changes(case, found[len(family) :], planned.others))
    chosen, verdict = _verdict(family_found, quantities, wanted)
    fine = [_misfits(case, one) for _, one in family_found]
    return MeshCheck(
        case.title, case.hash, {test.name: test.angle for test in case.tests}, case.start_values(), wanted, case.solver.element,
        case.solver.linear, tuple(family_found), tuple(e for e, _ in fine), tuple(o for _, o in fine), quantities, changes,
        chosen, verdict,
    )  # fmt: skip


def refitted(planned, ledger=None, progress=None):
    """Refits of the case on each mesh of a Plan's family, from coarse to fine: the meshes' error in the parameters themselves."""
    return refits(planned.family, ledger, progress=progress)


def own_family(case):
    """The default family around the case's mesh, as overrides."""
    own = estimate(case)[0]
    return [f"mesh.elements={max(20, round(share * own))}" for share in SHARES]


def own_checks(case):
    """Key -> values of contact penalty, load step and edge radius, in the units of the case."""
    depth = _depth(case)
    found = {
        "solver.penalty": [share * case.solver.penalty for share in CHECKS["solver.penalty"]],
        "solver.max_step": [float(f"{share * depth:.4g}") for share in CHECKS["solver.max_step"]],
    }
    shape = case.indenter.geometry
    own = shape.edge_radius
    if own is not None and case.indenter.friction != "stick":
        radii = [share * shape.half_width for share in CHECKS["indenter.edge_radius"]]
        found["indenter.edge_radius"] = [0.0, own / 2, own * 2] if own else radii
    return found


# ---- memory ------------------------------------------------------------------------------------------------------


def estimate(case):
    """Elements, degrees of freedom and peak memory, bytes, of a case, before its mesh is made."""
    elements = meshes.count(case.sample, case.indenter, case.mesh, case.solver.element, _depth(case))
    nodes = elements * (8 if case.solver.element == "q2p1" else 1)
    dofs = 3 * nodes * (1 + 1 / nodes ** (1 / 3)) ** 3
    return elements, round(dofs), memory_of(dofs, case.solver.element, case.solver.linear)


def _depth(case):
    return max(float(case.outputs(test)[-1]) for test in case.tests)


def memory_of(dofs, element, linear="auto"):
    """Peak memory of a run, bytes."""
    from indentfit.fem.linear.choice import choice

    factor = PER_DOF_FACTOR[choice(linear, dofs)]
    return PROCESS + PER_DOF[element] * dofs + factor * dofs ** (4 / 3)


def _refuse_too_large(case, asked):
    elements, dofs, memory = estimate(case)
    free = available_memory()
    if free is not None and memory > FITS * free:
        raise MeshError(
            f"{case.path}: {asked.replace('=', ' = ')}: about {elements:,} elements, {dofs:,} degrees of freedom and "
            f"{memory / 1e9:.1f} GB of memory, of which {free / 1e9:.1f} GB are free; ask for a coarser mesh"
        )


# ---- runs --------------------------------------------------------------------------------------------------------


def _measure_all(cases, ledger, progress):
    """Measured of each case, one after the other, each in a process of its own; progress by estimated cost."""
    costs = np.array([estimate(case)[1] ** (4 / 3) for case in cases])
    found = []
    for n, case in enumerate(cases):
        own = None if ledger is None else ledger.of(case)
        record = None if own is None else _recorded(case, own)
        if not record:
            progress(costs[:n].sum() / costs.sum(), f"mesh {n + 1} of {len(cases)}")
            record = _measured_or_cause(case)
            if own is not None and record["cause"] != DIED:  # that was the machine's fault, and may not happen again
                _keep(case, own, record)
        forces = record["forces"] and tuple(map(np.array, record["forces"]))
        found.append(Measured(**{**record, "forces": forces}))
    return found


def _recorded(case, ledger):
    """The record of a case that the ledger holds, or None: its forces in a run of each test, the rest in the facts of each."""
    runs = [ledger.find(case.start_values() | {MEASURED: True}, test) for test in case.tests]
    if None in runs:
        return None
    forces = None if any(run.force is None for run in runs) else [run.force for run in runs]
    return {**runs[0].facts, "forces": forces, "cause": runs[0].cause}


def _keep(case, ledger, record):
    facts = {name: value for name, value in record.items() if name not in ("forces", "cause")}
    for test, force in zip(case.tests, record["forces"] or [None] * len(case.tests), strict=True):
        force = None if force is None else np.array(force)
        ledger.add(case.start_values() | {MEASURED: True}, test, Run(force, record["cause"], record["cpu_seconds"], facts))


def _measured_or_cause(case):
    elements, dofs, _ = estimate(case)
    try:
        return isolated(measure, case)
    except (IndentfitError, Died) as error:
        cause = DIED if isinstance(error, Died) else " ".join(str(error).split())
        nothing = dict.fromkeys(("newton_iterations", "factorizations", "loose_steps", "tries", "memory"), 0)
        return {
            "elements": elements, "dofs": dofs, "h": None, "forces": None, **nothing, "penalty_error": 0.0,
            "cpu_seconds": 0.0, "setup_seconds": 0.0, "cause": cause,
        }  # fmt: skip


def measure(case: Case):
    """The record of a Measured, as plain numbers: every test of a case in this process. Raises ConvergenceError."""
    _compile(case)
    started = time.process_time()
    model = Model(setup_of(case))
    ready = time.process_time()
    simulation = model.simulate(presses_of(case, case.law(**case.start_values())))
    solver = simulation.solver
    return {
        "elements": simulation.mesh.elements,
        "dofs": simulation.mesh.dofs,
        "h": float(meshes.size(case.sample, case.indenter, case.mesh, case.solver.element, _depth(case))),
        "forces": [test.force.tolist() for test in simulation.tests],
        "newton_iterations": solver.newton_iterations,
        "factorizations": solver.factorizations,
        "loose_steps": solver.loose_steps,
        "tries": max(test.facts.tries for test in simulation.tests),
        "penalty_error": solver.penalty_error,
        "cpu_seconds": time.process_time() - ready,
        "setup_seconds": ready - started,
        "memory": peak_memory(),
        "cause": None,
    }


def _compile(case):
    """Run a small mesh to a small depth, so that what is compiled on first use is not counted as work."""
    small = case.model_copy(update={"mesh": type(case.mesh)(elements=20)})
    try:
        material = small.law(**small.start_values())
        press = press_of(small, small.tests[0], material)
        Model(setup_of(small)).run(replace(press, depths=1e-3 * press.depths[-1:]))
    except (ConvergenceError, MeshError):
        pass


# ---- what the family says ----------------------------------------------------------------------------------------


def _quantities(case, found):
    computed = [one for one in found if one.counts]
    h = np.array([one.h for one in computed])
    for n, test in enumerate(case.tests):
        curves = [Curve(case.outputs(test), one.forces[n]) for one in computed]
        yield _quantity(test.name, "force", h, np.array([curve.force[-1] for curve in curves]))
        if case.outputs(test).size > 1:
            yield _quantity(test.name, "stiffness", h, np.array([stiffness(curve) for curve in curves]))


def _quantity(test, kind, h, values):
    if h.size < LEAST_FAMILY:
        return Quantity(test, kind, h, values, None, grid_convergence_index(h, values), None, None)
    approach, finest = fitted(h, values), int(np.argmin(h))
    half = approach.band(values)
    band = (min(float(values[finest]), approach.interval[0]), max(float(values[finest]), approach.interval[1]))
    return Quantity(test, kind, h, values, approach, grid_convergence_index(h, values), band, half / np.abs(values))


def _misfits(case, one):
    """RMSE of each measured test, mN, and equation (1)'s objective where all were measured."""
    if one.forces is None or all(curve is None for curve in case.curves):
        return None, None
    targets = [
        (Target(test.name, curve, test.weight), force)
        for test, curve, force in zip(case.tests, case.curves, one.forces, strict=True)
        if curve is not None
    ]
    errors = {target.name: rmse(target, force) for target, force in targets}
    whole = len(targets) == len(case.tests)
    return errors, equation_one(*zip(*targets, strict=True)) if whole else None


def _changes(case, found, others):
    """Change of each key's value against the case as it is, which is found[0]."""
    for (name, value, _), one in zip(others, found[1:], strict=True):
        own = found[0]
        if one.forces is None or own.forces is None:
            yield Change(name, value, None, one.cause or own.cause)
            continue
        pairs = zip(case.tests, one.forces, own.forces, strict=True)
        yield Change(name, value, {test.name: float(new[-1] / old[-1] - 1) for test, new, old in pairs}, None)


def _verdict(found, quantities, wanted):
    """Index among `found` of the coarsest mesh whose bands are all within the wanted error, or None; and words."""
    computed = [n for n, (_, one) in enumerate(found) if one.counts]
    if len(computed) < LEAST_FAMILY:
        return None, f"no verdict: {len(computed)} meshes of the family were computed, and an error needs {LEAST_FAMILY}"
    worst = np.max([one.error for one in quantities], axis=0)
    good = [n for n in range(len(computed)) if (worst[n:] <= wanted).all()]
    best = int(np.argmin(worst))
    orders = _order_verdict(quantities)
    if not good:
        asked, one = found[computed[best]]
        return None, (
            f"none of these meshes is exact to {100 * wanted:g} % of force and stiffness with certainty; the best is {asked} "
            f"({one.elements:,} elements), within {worst[best]:.2%}; ask for finer ones. {orders}"
        )
    asked, one = found[computed[good[0]]]
    return computed[good[0]], (
        f"{asked} ({one.elements:,} elements) is the coarsest mesh exact to {100 * wanted:g} % of force and stiffness "
        f"(within {worst[good[0]]:.2%}): {one.cpu_seconds:.3g} s of processor time for all tests, {one.memory / 1e6:.0f} MB. "
        f"{orders}"
    )


def _order_verdict(quantities):
    """What the observed orders of the forces are worth, in words."""
    forces = [one for one in quantities if one.kind == "force"]
    seen = [f"{one.approach.order:.2g} ({one.test})" for one in forces if one.approach.order]
    unseen = [f"{one.approach.raw_order:.2g} ({one.test})" for one in forces if not one.approach.order]
    words = f"Observed order of the force: {', '.join(seen)}; about 1 is usual where edges are singular" if seen else ""
    if unseen:
        words += "; " if seen else "Order of the force: "
        words += f"{', '.join(unseen)} is not believed, and the band there is widened, as if by a safety factor of {UNRELIABLE:g}"
    return words


def parse(option, text):
    """Overrides of a family: texts of --sizes ("0.6,0.5 mm") or --elements ("60,100")."""
    parts = [part.strip() for part in text.split(",")]
    if "" in parts or len(set(parts)) < 2:
        raise CaseError(f"--{option} {text}: give two or more values, separated by commas")
    return [f"mesh.{'size' if option == 'sizes' else 'elements'}={part}" for part in dict.fromkeys(parts)]
