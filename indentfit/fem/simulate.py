"""The forward model: from a setup and its presses to force-displacement curves, with what they cost and how exact they are."""

import contextlib
import functools
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace

import numpy as np
from scipy.interpolate import CubicSpline
from threadpoolctl import ThreadpoolController

from indentfit.curve import Curve
from indentfit.errors import ConvergenceError
from indentfit.fem.constraints import Fixed
from indentfit.fem.contact import NORMAL, TANGENTIAL, Contact, Springs
from indentfit.fem.controls import Controls, Work
from indentfit.fem.deadline import NEVER, Deadline
from indentfit.fem.directions import OFFSET, directions
from indentfit.fem.element import Solid
from indentfit.fem.equations import Equations, Loading
from indentfit.fem.linear.choice import choice
from indentfit.fem.linear.multigrid import rigid_body_modes
from indentfit.fem.linear.pardiso import THREADS_PAY
from indentfit.fem.linear.solver import LinearSolver
from indentfit.fem.mesh import quarter
from indentfit.fem.newton import Newton
from indentfit.fem.path import indent, untouched
from indentfit.fem.setup import Press, Setup
from indentfit.material import blamed

QUARTERS = 4
SHARP = 10.0  # contact springs under a sharp edge, in units of NORMAL and TANGENTIAL: soft ones let it slip where it should stick
# After a failure: contact springs, width of the elements at the mesh's rim, and number of elements, in the usual ones.
SECOND_TRIES = ((1.0, 2.0, 1.0), (1.0, 1.0, 0.5), (5.0, 1.0, 1.0), (5.0, 2.0, 1.0), (0.2, 2.0, 1.0))
RIGID = 1e3  # contact springs of a linear solve, in units of the usual ones
FIBRES = {0: np.array([1.0, 0.0, 0.0]), 90: np.array([0.0, 0.0, 1.0])}


@dataclass(frozen=True)
class TestResult:
    """One simulated test: its curve at the outputs asked for (full-sample force) and the facts of its solution.

    penalty_error: share of the last force that the contact penalty takes away; residual_error: largest share of the force that
    a step's unbalanced residual stands for; edge_slip: largest motion of the material
    under a sharp edge away from it, as a share of the indenter's half-width (0 where the edge is rounded);
    sensitivities: name -> dF/dname (n,) mN per unit, as asked for, None where the path could not be differentiated;
    last: the last equilibrium, path: all of them, model: the Model they belong to, for
    stresses and files (fem.fields). facts["tries"]: 1, or more where the usual contact and mesh did not converge.
    """

    __test__ = False  # not a test of pytest's

    name: str
    angle: int
    displacement: np.ndarray
    force: np.ndarray
    facts: dict = field(default_factory=dict)
    sensitivities: dict[str, np.ndarray] | None = None
    last: object = field(default=None, repr=False)
    path: tuple = field(default=(), repr=False)
    model: object = field(default=None, repr=False)

    @property
    def curve(self):
        return Curve(self.displacement, self.force)


@dataclass(frozen=True)
class Simulation:
    """All tests of a case, its mesh and the solver's facts."""

    tests: tuple[TestResult, ...]
    mesh: dict
    solver: dict

    def as_json(self):
        """The stable keys of `simulate --json`."""
        return {
            "tests": [
                {
                    "name": test.name,
                    "angle": test.angle,
                    "displacement_mm": test.displacement.tolist(),
                    "force_mN": test.force.tolist(),
                    "facts": test.facts,
                }
                for test in self.tests
            ],
            "mesh": self.mesh,
            "solver": self.solver,
        }


def said_of_tries(tests):
    """A sentence for each of the tests, (name, facts), that was not solved at the first try."""
    for name, facts in tests:
        if facts.get("tries", 1) > 1:
            mesh = f"a mesh of {facts['elements']} elements"
            yield f"test {name!r} was solved at try {facts['tries']}, on {mesh}; the first one: {facts['first_failure']}"


class Model:
    """A meshed sample with its indenter, ready to be run with many materials: mesh, bases and pattern are set up once."""

    def __init__(self, setup: Setup, rim: float = 1.0) -> None:
        self.setup, self.rim = setup, rim
        started = time.perf_counter()
        self.mesh = quarter(setup.sample, setup.indenter, setup.mesh, setup.solver.element, setup.depth, rim)
        self.body = _body(self.mesh, setup.solver)
        self.contact = Contact(self.body, setup.indenter, setup.sample.thickness)
        self.fixed = Fixed(self.body, _held(self.body.basis, setup.sample.base))
        kind = choice(setup.solver.linear, self.body.n_dofs)
        modes = self.fixed.freed(rigid_body_modes(self.body.basis.doflocs[:, ::3])) if kind == "pyamg" else None
        self.solver = LinearSolver(kind, modes, self.contact.surface)
        self.equations = Equations(self.body, self.contact, self.fixed)
        self.setup_seconds = time.perf_counter() - started

    def simulate(self, presses: Sequence[Press], progress: Callable[[str, float], None] | None = None) -> Simulation:
        """Simulation of several presses; progress: called with (name of the press, share of its depth done)."""
        tests = []
        for press in presses:
            report = functools.partial(progress, press.name) if progress else None
            tests.append(self.run(press, report))
        return Simulation(tuple(tests), self.mesh_facts(), self._sum(tests))

    def run(self, press: Press, progress: Callable[[float], None] | None = None, deadline: Deadline | None = None) -> TestResult:
        """TestResult of one press; progress: called with the share of the depth done.

        Raises ConvergenceError, OutOfTime once the deadline has passed, InputError for an unknown name among the sensitivities.
        """
        press = replace(press, depths=np.asarray(press.depths, dtype=float))
        options = self.setup.solver
        controls = Controls(options.tolerance, options.max_step or np.inf, deadline or NEVER, progress)
        with _threads(self.body.n_dofs), blamed(type(press.material)):
            return self._tried(press, controls)

    def _tried(self, press, controls):
        """The TestResult of the first try that is solved: a sharp corner that folds up on one mesh, or slips under soft contact
        springs, often does not with others. Raises the first try's ConvergenceError where none is."""
        try:
            return self._run(1.0, press, controls)
        except ConvergenceError as error:
            for number, (stiffer, rim, share) in enumerate(SECOND_TRIES, start=2):
                with contextlib.suppress(ConvergenceError):
                    found = self._coarser(rim, share)._run(stiffer, press, controls)
                    return replace(found, facts={**found.facts, "tries": number, "first_failure": str(error)})
            raise

    def _coarser(self, rim, share):
        """This model, or one whose mesh is coarser: where the strip leaves the sample, or all of it by a share of the elements."""
        if rim == self.rim and share == 1:
            return self
        setup = self.setup
        if share < 1:
            mesh = setup.mesh.model_copy(update={"size": None, "elements": round(share * self.mesh.nelements)})
            setup = replace(setup, mesh=mesh)
        return Model(setup, rim)  # made anew: no run depends on those before it

    def _run(self, stiffer, press, controls):
        started = time.perf_counter()
        material, kappa, angle, depths, name = press.material, press.kappa, press.angle, press.depths, press.name
        sensitivities = tuple(press.sensitivities)
        work, before = Work(), self.solver.work
        springs = self._springs(material, angle).scaled(stiffer)
        bulk = self.solver.bulk(kappa, material.shear_modulus)
        ways = self._directions(sensitivities, material, kappa, angle)
        loading = Loading(material, kappa, bulk, FIBRES[angle], springs, ways)
        self.solver.forget()
        try:
            path = indent(self.equations, loading, Newton(self.solver, controls, work), depths)
        except ConvergenceError as error:
            unstable = material.unstable and f"; the material is not stable at small strain ({material.unstable})"
            cause = error.cause + (unstable or "")
            raise ConvergenceError(_of_test(name, cause), error.displacement, error.step, error.iteration) from error
        _require_contact(path, name)
        facts = {
            "tries": 1,
            "elements": int(self.mesh.nelements),
            "steps": work.steps,
            "cutbacks": work.cutbacks,
            "newton_iterations": work.iterations,
            "loose_steps": work.loose_steps,
            "largest_residual": work.largest_residual,
            **asdict(self.solver.work.since(before)),
            "wall_seconds": time.perf_counter() - started,
            "penalty_error": path[-1].penalty_error / max(path[-1].force, 1e-300),
            "residual_error": max(abs(point.residual_error) / point.force for point in path[1:]),
            "edge_slip": self._edge_slip(path[-1]),
            "touching": float(path[-1].contact.touching[self.contact.under].mean()),
            "slipping": float(path[-1].contact.slipping[self.contact.under].mean()),
        }
        force = QUARTERS * interpolate(path, [point.force for point in path], depths)
        slopes = self._sensitivities(sensitivities, loading.directions, path, depths)
        return TestResult(name, angle, depths, force, facts, slopes, path[-1], tuple(path), self)

    def _directions(self, names, material, kappa, angle):
        def stiffness(material):
            return self._springs(material, angle).normal

        friction = np.inf if self.contact.tied.any() else self.contact.friction
        return directions(names, material, kappa, stiffness, friction)

    def _sensitivities(self, names, directions, path, depths):
        """name -> (n,) of the names asked for, None where the path left the differentiable."""
        found = {}
        if directions:
            if any(point.derivatives is None for point in path):
                return None
            rows = QUARTERS * interpolate(path, [point.derivatives.force for point in path], depths).T
            found = dict(zip((way.name for way in directions), rows, strict=True))
        if OFFSET in names:
            forces = [point.force for point in path]
            found[OFFSET] = -QUARTERS * CubicSpline([point.depth for point in path], forces)(depths, 1)
        return {name: found[name] for name in names}

    def stiffness(self, material, kappa, angle):
        """Small-strain stiffness of the full sample, mN/mm, under a flat indenter that slips freely or sticks."""
        springs = self._springs(material, angle).scaled(RIGID)  # one linear solve: nothing can chatter
        loading = Loading(material, kappa, self.solver.bulk(kappa, material.shear_modulus), FIBRES[angle], springs)
        newton = Newton(self.solver, Controls(self.setup.solver.tolerance), Work())
        self.solver.forget()
        return QUARTERS * untouched(self.equations, loading, newton).stiffness

    def _springs(self, material, angle):
        """Contact springs in proportion to the sample's stiffness: under a sharp edge, where the traction is singular, SHARP times
        its shear modulus, else that under the indenter, which fibres across it raise."""
        moduli, indenter = material.moduli(), self.contact.indenter
        young = moduli["E_along"] if angle == 90 else moduli["E_across"]
        sharp = indenter.shape != "sphere" and not indenter.edge_radius
        modulus = SHARP * material.shear_modulus if sharp else (material.shear_modulus + young / 3) / 2
        stiffness = self.setup.solver.penalty * modulus / self.setup.sample.thickness
        return Springs(NORMAL * stiffness, TANGENTIAL * stiffness)

    def mesh_facts(self):
        return {
            "elements": int(self.mesh.nelements),
            "dofs": int(self.body.n_dofs),
            "element": self.body.element,
            "smallest_mm": float(np.min(self.body.volume) ** (1 / 3)),
        }

    def _sum(self, tests):
        totals = (
            "steps",
            "cutbacks",
            "loose_steps",
            "newton_iterations",
            "factorizations",
            "solves",
            "krylov_iterations",
            "wall_seconds",
        )
        return {
            "linear": self.solver.name,
            "assembly": self.setup.solver.assembly,
            **{key: sum(test.facts[key] for test in tests) for key in totals},
            "setup_seconds": self.setup_seconds,
            "penalty_error": max(abs(test.facts["penalty_error"]) for test in tests),
            "residual_error": max(test.facts["residual_error"] for test in tests),
            "edge_slip": max(test.facts["edge_slip"] for test in tests),
        }

    def _edge_slip(self, equilibrium):
        indenter = self.contact.indenter
        if indenter.shape == "sphere" or indenter.edge_radius:
            return 0.0
        corners = self.body.basis.nodal_dofs
        (x, y, z), u = self.body.basis.doflocs[:, corners[0]], equilibrium.u[corners]
        top = y > self.setup.sample.thickness * (1 - 1e-9)
        if indenter.shape == "strip":
            half, at, out = indenter.width / 2, z, u[2]
        else:
            half, at = indenter.diameter / 2, np.hypot(x, z)
            out = (u[0] * x + u[2] * z) / np.where(at > 0, at, 1)
        return float(np.max(np.abs(out[top & (np.abs(at - half) < 1e-6 * half)])) / half)


def _threads(n_dofs):
    """Context in which libraries use as many threads as pay: one on small meshes, and on large ones all but those of NumPy's
    OpenBLAS. They wait for their next vector at full speed, in the way of the solver's threads: a path takes 1.5 times as long."""
    pools = ThreadpoolController()
    return (pools if n_dofs < THREADS_PAY else pools.select(internal_api="openblas")).limit(limits=1)


def _require_contact(path, name):
    """Raise ConvergenceError where no point of the indenter touches the sample although it was moved into it."""
    for step, point in enumerate(path[1:], start=1):
        if not point.contact.touching.any():
            cause = "the indenter has lost contact: no point of it touches the sample; check its shape, and the material's signs"
            raise ConvergenceError(_of_test(name, cause), point.depth, step)


def _of_test(name, cause):
    return f"test {name!r}: {cause}" if name else cause


def _body(mesh, options):
    if options.assembly == "forms":
        from indentfit.fem.forms import FormSolid

        return FormSolid(mesh, options.element)
    return Solid(mesh, options.element)


def _held(basis, base):
    """Dofs held at zero: normal motion on the planes of symmetry, the base's normal motion or all of it."""
    component = {"x0": "u^1", "z0": "u^3"}
    held = [basis.get_dofs(plane).all([name]) for plane, name in component.items()]
    held.append(basis.get_dofs("base").all(["u^2"] if base == "sliding" else None))
    return np.concatenate(held)


def interpolate(path, values, depths):
    """Values (n_d, ...) of a path's equilibria at depths (n,) mm: the cubic spline through all of them.

    Linear in the values, so that curves and their derivatives agree. Tangents would not make it better: where points of the
    contact begin to slip, the curve's tangent jumps, and 8 steps of values alone are within 1e-4 of the largest force.
    """
    return CubicSpline([point.depth for point in path], values, axis=0)(depths)
