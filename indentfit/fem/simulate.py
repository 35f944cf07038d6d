"""The forward model: from a setup and its presses to force-displacement curves, with the work and the errors of the solution."""

import functools
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from typing import Any, cast

import numpy as np
import scipy.sparse as sp

from indentfit.compiled import libraries, one_blas_thread
from indentfit.errors import ConvergenceError, IndentfitError, OutOfTime
from indentfit.fem.ahead import compile_ahead
from indentfit.fem.asked import along, seen_along, sensitivities_along
from indentfit.fem.body import Bulk, per_element
from indentfit.fem.constraints import Fixed
from indentfit.fem.contact import NORMAL, TANGENTIAL, ContactFace
from indentfit.fem.contact_state import Springs
from indentfit.fem.controls import Controls, Report, Work, step_of_few
from indentfit.fem.deadline import NEVER, Deadline
from indentfit.fem.directions import FIBRE_ANGLE, Direction, Solids, directions, of_fibre_angle
from indentfit.fem.equations import Equations, Loading
from indentfit.fem.equilibrium import Equilibrium
from indentfit.fem.facts import MAY_BE_OFF, MeshFacts, SolveFacts, SolverFacts, not_as_asked
from indentfit.fem.interpolation import POWERS
from indentfit.fem.linear.choice import choice
from indentfit.fem.linear.multigrid import rigid_body_modes
from indentfit.fem.linear.pardiso import THREADS_PAY
from indentfit.fem.linear.solver import LinearSolver, LinearWork
from indentfit.fem.meshed import meshed_body, slid_too_far
from indentfit.fem.newton import Newton
from indentfit.fem.observation import Observed, rows_of
from indentfit.fem.path import indent, untouched
from indentfit.fem.result import Simulation, TestResult
from indentfit.fem.setup import Press, Setup, young_across
from indentfit.fem.sliding import TOGETHER
from indentfit.fem.stability import loss_of_stability, remedy
from indentfit.fem.steps import first_depth, first_steps, largest_step
from indentfit.fem.symmetry import held_motions
from indentfit.fem.tries import (
    AGAIN_FOLLOWING,
    AGAIN_SECONDS,
    AGAIN_SHARE,
    FINE,
    FINE_ITERATIONS,
    FOLLOWING,
    MUCH_DEEPER,
    SECOND_TRIES,
    SECOND_TRIES_FINE,
    SECOND_TRIES_IN_PLANE,
    SECOND_TRIES_ROUND,
    USUAL,
    Try,
    known_to,
    require_time,
)
from indentfit.fem.viscous import InTime, Moment
from indentfit.fibres import Fibre
from indentfit.indenters import has_sharp_edge
from indentfit.material import Layered, Material, Prestretched, blamed, parts_of, rest_pressure

SHARP = 10.0  # contact springs under a sharp edge, in units of NORMAL and TANGENTIAL: soft ones let it slip where it should stick
# Springs at the points on a meridian's edges, in units of shear modulus / thickness. Stiff ones do not chatter there: the end of
# the contact passes many points in each element. Soft ones let a point sink in by more than the face's bend within an element, and
# the iteration then finds no end of the contact. Under a contact of less than SMALL thicknesses they are stiffer in proportion.
EDGE_NORMAL, EDGE_TANGENTIAL, SMALL = 3e3, 3e2, 0.1
# So are those of bricks and under sharp edges, where the contact is less than SMALL_ELSEWHERE thicknesses: springs of the thickness
# alone gave way under a punch of a hundredth (forces 0.8 % too small), and under a small bead on bricks (14 %).
SMALL_ELSEWHERE = 0.2
# Springs at the points of a round sharp edge that sticks: the points are tied, and elements at the corner may be tiny. Under softer
# ones narrow bricks there folded up (142 iterations, forces 5 % too small to 3 % too large).
TIED = 3e6
GROWING = 5.0  # springs of bricks under a sphere, cone or wedge, in units of NORMAL and TANGENTIAL: soft ones fail at depth
# Largest tolerance in the meridian plane, where an iteration costs little; at sharp edges a loose one passes over the cutbacks that
# keep a sticking edge from folding (1.4 % of the force at 30 % depth).
IN_PLANE, IN_PLANE_SHARP = 1e-4, 1e-6
RIGID = 1e3  # contact springs of a linear solve, in units of the usual ones


class Model:
    """A meshed sample with its indenter, ready to be run with many materials: mesh, bases and pattern are set up once.

    Parameters
    ----------
    setup : Setup
    rim : float
        Width of the elements where the indenter leaves the sample, in units of the usual width.
    follows : str
        Whose points lie on what they have slid on, where layers slide, those of the "lower" or "upper" faces (fem.facing).

    Raises
    ------
    MeshError
        Sample and indenter cannot be meshed as requested.
    InputError
        The linear solver is not installed.
    """

    def __init__(self, setup: Setup, rim: float = 1.0, follows: str = "") -> None:
        self.setup, self.rim = setup, rim
        started = time.perf_counter()
        self.body, points = meshed_body(setup, rim, follows)
        self.mesh = self.body.mesh
        self.layer = setup.sample.layer_at(self.mesh.p[1, self.mesh.t].mean(axis=0))  # number of each element's, from the top
        self.contact = ContactFace(points, setup.indenter, setup.sample.thickness)
        base = setup.sample.base
        motions = held_motions(setup.part, setup.indenter, setup.sample)
        self.fixed = Fixed(self.body, self.body.held(base, motions, setup.sample.prestretch is not None))
        multigrid_in_plane = setup.in_plane and setup.solver.linear == "pyamg"  # which it is not made for
        # factors of a plane's matrices stay small
        kind = choice("auto" if multigrid_in_plane else setup.solver.linear, 0 if setup.in_plane else self.body.n_dofs)
        modes = self.fixed.freed(rigid_body_modes(self.body.points())) if kind == "pyamg" else None
        # the second one is for derivatives: they do not touch the path's factors
        solver = functools.partial(LinearSolver, kind, modes, self.contact.surface, small=setup.in_plane, held=self.fixed.dofs)
        self.solver, self.exact = solver(), solver()
        self.equations = Equations(self.body, self.contact, self.fixed)
        self._observed: tuple[bytes, sp.csr_matrix] = b"", sp.csr_matrix((0, self.body.n_dofs))
        self.setup_seconds = time.perf_counter() - started

    def simulate(
        self, presses: Sequence[Press], progress: Callable[..., None] | None = None, time_limit: float = np.inf
    ) -> Simulation:
        """The Simulation of several presses.

        Parameters
        ----------
        presses : sequence of Press
        progress : function
            Called with the name of the press, the share of its depth that is done, and from a second try on `tries`, its number.
        time_limit : float, s
            Processor time of each press.

        Returns
        -------
        Simulation

        Raises
        ------
        ConvergenceError, OutOfTime
            Its `part` is the Simulation of the tests before, and of this one's curve as far as it was solved.
        """
        tests: list[TestResult] = []
        for press in presses:
            report = functools.partial(progress, press.name) if progress else None
            try:
                tests.append(self.run(press, report, Deadline(time_limit)))
            except IndentfitError as error:
                error.part = self._together([*tests, *([error.part] if isinstance(error.part, TestResult) else [])])
                raise
        return Simulation(tuple(tests), self.mesh_facts(), self._solver_facts(tests))

    def _together(self, tests: Sequence[TestResult]) -> Simulation | None:
        return Simulation(tuple(tests), self.mesh_facts(), self._solver_facts(tests)) if tests else None

    def run(self, press: Press, progress: Report | None = None, deadline: Deadline | None = None) -> TestResult:
        """The TestResult of one press.

        Parameters
        ----------
        press : Press
        progress : Report
        deadline : Deadline

        Returns
        -------
        TestResult

        Raises
        ------
        ConvergenceError
        OutOfTime
            The deadline has passed; there are no second tries then.
        MaterialError
            The code of a plugin's material fails.
        InputError
            A name among the sensitivities is unknown.

        The `part` of the first two, and of what `progress` raises, is the TestResult as far as it goes, or None.
        """
        press = replace(press, depths=np.asarray(press.depths, dtype=float), sensitivities=tuple(press.sensitivities))
        largest = largest_step(self.setup, self.body.n_dofs, self.contact.friction, float(press.depths[-1]))
        steps = largest, first_steps(self.setup), first_depth(self.setup)
        controls = Controls(self._tolerance, *steps, deadline or NEVER, progress)
        with _threads(self.body.n_dofs), blamed(type(press.material)):
            return self._tried(press, controls)

    @property
    def _tolerance(self) -> float:
        in_plane = IN_PLANE_SHARP if has_sharp_edge(self.contact.shape) else IN_PLANE
        return min(self.setup.solver.tolerance, in_plane if self.setup.in_plane else np.inf)

    @property
    def power(self) -> float:
        """The power of the depth by which the force begins to grow."""
        return POWERS[self.contact.shape.end]

    def over_time(
        self, press: Press, path: InTime, progress: Callable[[float], None] | None = None, deadline: Deadline | None = None
    ) -> list[Moment]:
        """The moments of the viscoelastic model along a path in time, as `viscous.press_in_time` or `creep.creep_in_time` gives and
        raises them."""
        largest = self.setup.solver.max_step or step_of_few(self.body.n_dofs, float(press.depths[-1]))
        controls = Controls(self._tolerance, largest, first_steps(self.setup), np.inf, deadline or NEVER, progress)
        loading = self._loading(replace(press, sensitivities=()), self._springs(press.material, press.fibre))
        with _threads(self.body.n_dofs), blamed(type(press.material)):
            return path(self.equations, loading, self._newton(controls))

    def stiffness(self, material: Material, kappa: float, angle: float) -> float:
        """Small-strain stiffness of the whole sample, mN/mm, under a flat indenter that slips freely or sticks."""
        press = Press(material, kappa, angle, np.zeros(0))
        springs = self._springs(material, press.fibre).scaled(RIGID)  # one linear solve: nothing can chatter
        loading = self._loading(press, springs)
        return self.body.copies * untouched(self.equations, loading, self._newton(Controls(self.setup.solver.tolerance))).stiffness

    def mesh_facts(self) -> MeshFacts:
        """Numbers of the mesh."""
        smallest = float(np.min(self.body.weights.sum(axis=1)) ** (1 / 3))
        elements, setup = int(self.mesh.nelements), self.setup
        remarks = [text for text in (setup.remark, not_as_asked(setup.mesh.elements, elements // setup.quarters)) if text]
        return MeshFacts(elements, int(self.body.n_dofs), self.body.element, smallest, setup.symmetry, "; ".join(remarks))

    def _solver_facts(self, tests: Sequence[TestResult]) -> SolverFacts:
        assembly = self.setup.solver.assembly
        return SolverFacts.of((test.facts for test in tests), self.solver.name, assembly, self.setup_seconds)

    def _tried(self, press: Press, controls: Controls) -> TestResult:
        """The TestResult of the first try that is solved: a sharp corner that folds up on one mesh, or slips under soft contact
        springs, often does not with others. Raises the first try's ConvergenceError where every try fails."""
        started = time.process_time()
        first = replace(controls, most_iterations=FINE_ITERATIONS) if self._fine else controls
        try:
            result = self._run(USUAL, press, first)
        except ConvergenceError as error:
            return self._tried_again(press, controls, error, time.process_time() - started, self._second_tries())
        far = slid_too_far(self.body, result.path)
        if far is None:
            return result
        try:
            return self._tried_again(press, controls, far, time.process_time() - started, FOLLOWING)
        except (ConvergenceError, OutOfTime):
            return replace(result, facts=replace(result.facts, first_failure=far.cause))

    def _tried_again(
        self, press: Press, controls: Controls, first: ConvergenceError, seconds: float, tries: Sequence[Try]
    ) -> TestResult:
        """The TestResult of a second try. Raises the first try's error, with the longest curve, where all fail or time runs out."""
        least = AGAIN_FOLLOWING if tries and tries[0].follows else AGAIN_SECONDS
        within = replace(controls, deadline=controls.deadline.sooner(max(least, AGAIN_SHARE * seconds)))
        for number, attempt in enumerate(tries, start=2):
            if controls.progress is not None:
                controls.progress(0.0, number)
                within = replace(within, progress=functools.partial(controls.progress, tries=number))
            try:
                model = self._coarser(attempt)
                result = model._run(attempt, press, within)
                far = None if attempt.follows else slid_too_far(model.body, result.path)
                said = f"{first}; on the mesh of try {number} {far.cause}; {MAY_BE_OFF}" if far else str(first)
                return replace(result, facts=replace(result.facts, tries=number, first_failure=said))
            except (ConvergenceError, OutOfTime) as error:
                require_time(controls.deadline, first)
                if _reach(error.part) > MUCH_DEEPER * _reach(first.part):
                    facts = replace(error.part.facts, tries=number, first_failure=str(first))
                    first.part = replace(error.part, facts=facts, unfinished=str(first))
                if isinstance(error, OutOfTime):
                    break
        raise first

    def _second_tries(self) -> tuple[Try, ...]:
        following = FOLLOWING if self.setup.sample.slides else ()
        if not self.setup.in_plane and self.contact.shape.edge_radius is None:
            return following + SECOND_TRIES_ROUND
        return following + (SECOND_TRIES_IN_PLANE if self.setup.in_plane else SECOND_TRIES_FINE if self._fine else SECOND_TRIES)

    @property
    def _fine(self) -> bool:
        """Whether this is a fine mesh under an indenter with an edge."""
        return not self.setup.in_plane and self.contact.shape.edge_radius is not None and self.body.n_dofs > FINE

    def _coarser(self, attempt: Try) -> "Model":
        """This model, one with a coarser mesh, at the rim where the strip leaves the sample or everywhere, or one that follows."""
        if attempt.rim == self.rim and attempt.elements == 1 and not attempt.follows:
            return self
        setup = self.setup
        if attempt.elements < 1:
            elements = round(attempt.elements * self.mesh.nelements / setup.quarters)
            setup = replace(setup, mesh=setup.mesh.model_copy(update={"size": None, "elements": elements}))
        return Model(setup, attempt.rim, attempt.follows)  # a new model, so that no run depends on the runs before it

    def _run(self, attempt: Try, press: Press, controls: Controls) -> TestResult:
        started, before = time.perf_counter(), self._linear_work
        loading = self._loading(press, self._springs(press.material, press.fibre).scaled(attempt.springs))
        newton = self._newton(replace(controls, first_steps=attempt.steps * controls.first_steps))

        def result(path: Sequence[Equilibrium], press: Press) -> TestResult:
            facts = self._facts(path, newton.work, self._linear_work.since(before), time.perf_counter() - started)
            start, share = self._loses_stability(path, press, loading)
            return self._result(press, path, replace(facts, unstable_from=start, unstable=share), loading)

        try:
            path = indent(self.equations, loading, newton, press.depths)
        except IndentfitError as error:
            end = float(press.depths[-1])
            said = self._explained(error, press, loading) if isinstance(error, ConvergenceError) else known_to(error, end)
            short = _as_far_as(error.part, press)
            said.part = replace(result(error.part, short), unfinished=str(said)) if short is not None else None
            raise said from (error if said is not error else None)
        _require_contact(path, press.name)
        return result(path, press)

    def _result(self, press: Press, path: Sequence[Equilibrium], facts: SolveFacts, loading: Loading) -> TestResult:
        force = self.body.copies * along(path, [point.whole_force for point in path], press, self.power)
        sensitivities = sensitivities_along(press, loading.directions, path, self.body.copies, self.power)
        solved = TestResult(
            press.name,
            press.angle,
            press.depths,
            force,
            facts,
            sensitivities,
            tuple(path),
            self,
            dip=press.dip,
            families=press.families,
        )
        if press.observed is None or loading.seen is None:
            return solved
        seen, seen_by = seen_along(press, press.observed, path, loading.seen, [way.name for way in loading.directions])
        return replace(solved, seen=seen, seen_by=None if sensitivities is None else seen_by)

    def _loses_stability(self, path: Sequence[Equilibrium], press: Press, loading: Loading) -> tuple[float | None, float]:
        return loss_of_stability(self.body, path, press.material, loading.material, press.fibre)

    def _explained(self, error: ConvergenceError, press: Press, loading: Loading) -> ConvergenceError:
        """The error of a path with the test's name, and what may be done about it."""
        start = self._loses_stability(error.part, press, loading)[0] if error.part else None
        cause = f"{error.cause}; {remedy(press.material, start, self.contact.shape)}"
        return ConvergenceError(_of_test(press.name, cause), error.displacement, error.step, error.iteration)

    @property
    def _linear_work(self) -> LinearWork:
        return self.solver.work.plus(self.exact.work)

    def _newton(self, controls: Controls) -> Newton:
        """Newton's iteration of one run, which knows nothing of the runs before it."""
        compile_ahead(self.setup)
        self.solver.begin()
        self.exact.begin()
        return Newton(self.solver, self.exact, controls, Work())

    def _loading(self, press: Press, springs: Springs) -> Loading:
        material, mus = self.placed(press.material), [part.shear_modulus for part in parts_of(press.material)]
        bulks = [self.solver.bulk(kappa, mu) for kappa, mu in zip(press.kappas, mus, strict=True)]
        together = TOGETHER * mus[0]
        pairs = ((press.kappas, together), (bulks, self.solver.bulk(together, mus[0])), (mus, mus[0]))
        kappa, bulk, mu = (self._everywhere(*pair) for pair in pairs)
        ways, rest = self._directions(press, material), self._with_interfaces(self.rest(press.material))
        seen = None if press.observed is None else self._rows(press.observed)
        return Loading(material, kappa, bulk, mu, press.fibre, springs, ways, rest=rest, seen=seen)

    def _rows(self, observed: Observed) -> sp.csr_matrix:
        """The rows of displacements that are requested; those of the last request are kept."""
        key = observed.key
        if self._observed[0] != key:
            part = None if self.setup.in_plane else self.setup.part
            self._observed = key, rows_of(self.body, part, observed, self.setup.sample.thickness)
        return self._observed[1]

    def placed(self, material: Material) -> Material:
        """A material where the body has it: that of layers knows the layer of each integration point, and that of a stretched
        sample its stretch."""
        if isinstance(material, Layered):
            material = material.placed(np.repeat(self.layer, self.body.weights.shape[1]))
        stretch = self.setup.sample.prestretch
        return material if stretch is None else cast(Material, Prestretched(material, stretch))

    def rest(self, material: Material) -> Bulk:
        """The pressure of the untouched sample in each element, kPa."""
        stretch = self.setup.sample.prestretch
        return 0.0 if stretch is None else self.of_elements([rest_pressure(part, stretch) for part in parts_of(material)])

    def of_elements(self, values: Sequence[float]) -> Bulk:
        """A modulus of each element (n_el, 1), of those of the layers; the number itself, where there is one."""
        return values[0] if len(values) == 1 else np.array(values)[self.layer][:, None]

    def _everywhere(self, values: Sequence[float], interfaces: float = 0.0) -> Bulk:
        """A modulus of each element, and of each pair of facets between layers that slide (fem.sliding)."""
        return self._with_interfaces(self.of_elements(values), interfaces)

    def _with_interfaces(self, own: Bulk, value: float = 0.0) -> Bulk:
        """A modulus of each element, and behind it a value for each pair of facets."""
        links = len(self.body.means) - self.mesh.nelements
        if not links:
            return own
        return np.concatenate([per_element(own, self.mesh.nelements), np.full(links, value)])[:, None]

    def _directions(self, press: Press, placed: Material) -> tuple[Direction, ...]:
        def stiffness(material: Material) -> float:
            return self._springs(material, press.fibre).normal

        friction = np.inf if self.contact.tied.any() else self.contact.friction
        solid = Solids(press.material, placed, press.kappas, self.setup.sample.prestretch, self._everywhere)
        ways = directions(press.sensitivities, solid, stiffness, friction)
        if FIBRE_ANGLE not in press.sensitivities:
            return ways
        return (*ways, self._by_fibre_angle(press))

    def _by_fibre_angle(self, press: Press) -> Direction:
        """The Direction of the fibres' angle. Where the part has a mirror plane, the force is an even function of this angle."""
        if not {"turn"} & self.setup.part.motions:
            return Direction(FIBRE_ANGLE)

        def stiffness(fibre: Fibre) -> float:
            return self._springs(press.material, fibre).normal

        return of_fibre_angle(press.turned, stiffness)

    def _springs(self, material: Material, fibre: Fibre) -> Springs:
        """Contact springs in proportion to the sample's stiffness: SHARP times the shear modulus under a sharp edge, where the
        traction is singular; otherwise the stiffness under the indenter, which is higher where fibres run across the indenter."""
        shape = self.contact.shape
        young, sharp = young_across(material, fibre), has_sharp_edge(shape)
        modulus = SHARP * material.shear_modulus if sharp else (material.shear_modulus + young / 3) / 2
        stiffness = self.setup.solver.penalty * modulus / self.setup.sample.thickness
        if self.setup.ties_round:
            return Springs(TIED * stiffness / SHARP, TIED * stiffness / SHARP)
        small = SMALL if self.setup.in_plane and not sharp else SMALL_ELSEWHERE
        stiffness *= max(1.0, small * self.setup.sample.thickness / shape.partition(self.setup.depth).half_width)
        if self.setup.in_plane and not sharp:
            return Springs(EDGE_NORMAL * stiffness, EDGE_TANGENTIAL * stiffness)
        if shape.edge_radius is None:
            stiffness *= GROWING
        return Springs(NORMAL * stiffness, TANGENTIAL * stiffness)

    def _facts(self, path: Sequence[Equilibrium], work: Work, linear: LinearWork, seconds: float) -> SolveFacts:
        last, under = path[-1], self.contact.under
        return SolveFacts(
            elements=int(self.mesh.nelements),
            steps=work.steps,
            cutbacks=work.cutbacks,
            newton_iterations=work.iterations,
            loose_steps=work.loose_steps,
            largest_residual=float(work.largest_residual),
            **asdict(linear),
            wall_seconds=seconds,
            penalty_error=last.penalty_error / max(last.force, 1e-300),
            residual_error=max(abs(point.residual_error) / point.force for point in path[1:]),
            edge_slip=self._edge_slip(last),
            touching=float(last.contact.touching[under].mean()),
            slipping=float(last.contact.slipping[under].mean()),
        )

    def _edge_slip(self, equilibrium: Equilibrium) -> float:
        shape = self.contact.shape
        if not has_sharp_edge(shape):
            return 0.0
        x, u = self.body.corners(equilibrium.u)
        sides = np.where(x < 0, -1, 1)  # shapes know the quarter x, z >= 0
        x, u = sides * x, sides * u
        top = x[1] > self.setup.sample.thickness * (1 - 1e-9)
        return float(np.max(np.abs(shape.motion_off_edge(x[:, top], u[:, top]))) / shape.half_width)


def _threads(n_dofs: int) -> Any:
    """Context in which libraries use one thread on small meshes, and on large meshes all threads but those of NumPy's OpenBLAS.
    OpenBLAS' threads wait actively and slow the solver's threads down: a path takes 1.5 times as long."""
    return libraries().limit(limits=1) if n_dofs < THREADS_PAY else one_blas_thread()


def _reach(part: TestResult | None) -> float:
    """Depth of the last equilibrium of a curve that ended early, mm."""
    return float(part.displacement[-1]) if part is not None else 0.0


def _as_far_as(path: Sequence[Equilibrium] | None, press: Press) -> Press | None:
    """The press as far as a path goes, without sensitivities; None where the path has no step in contact."""
    if path is None or len(path) < 2 or not all(_presses(point) for point in path[1:]):
        return None
    reached = path[-1].depth
    depths = press.depths[press.depths <= reached * (1 + 1e-9)]
    if not depths.size or depths[-1] < reached * (1 - 1e-9):
        depths = np.append(depths, reached)
    return replace(press, depths=depths, sensitivities=())


def _require_contact(path: Sequence[Equilibrium], name: str) -> None:
    """Raise ConvergenceError where no point of the indenter touches the sample although the indenter was moved into it."""
    for step, point in enumerate(path[1:], start=1):
        if not _presses(point):
            cause = "the indenter has lost contact: no point of the sample touches the indenter; check shape and material"
            raise ConvergenceError(_of_test(name, cause), point.depth, step)


def _presses(point: Equilibrium) -> bool:
    """Whether a point of the sample touches the indenter and carries a force: points that only just touch carry none."""
    return bool(point.contact.touching.any()) and point.force > 0


def _of_test(name: str, cause: str) -> str:
    return f"test {name!r}: {cause}" if name else cause
