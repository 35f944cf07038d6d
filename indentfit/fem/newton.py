"""Equilibrium along the indentation: steps of depth, Newton with a full linearisation, cutback and regrowth.

A step starts from the tangent prediction u + du/dd * step (one solve with the factor at hand) and is repeated with half its
length when Newton fails. The curve between the steps is a spline, so the outputs asked for do not decide how many are taken.
"""

import contextlib
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import scipy.sparse as sp

from indentfit.errors import ConvergenceError
from indentfit.fem import sensitivity
from indentfit.fem.deadline import NEVER, Deadline
from indentfit.fem.linear.tangent import Tangent

MAX_ITERATIONS = 15
NEARLY_STILL, FEW = 0.1, 6  # damping below which Newton is tried from a relaxed state, and iterations that it is given there
MAX_RELAXED, MAX_IMPLICIT = 120, 8  # iterations of a relaxation, and of one of its steps of time
WARY = 2  # steps of time in which the dampers stay above those with which one has just failed
EASED = 1e-2  # reduction of the residual that ends a step of time
STIFFEST_DAMPER = 1e6  # in units of shear modulus times size
LOOSE = 5e-3  # residual, of the contact force, at which points that chatter may be left; counted and reported
WITHHELD, MAX_AUGMENTATIONS = 2e-3, 3  # share of the force that the springs may withhold
LEASH = 0.03  # largest motion of a point in one iteration, of the last depth
SOFTER = 1 / 3  # what a cutback makes of the contact springs; their error is reported
FIRST_STEPS = 8  # steps to the last depth when nothing goes wrong
SMALLEST_STEP = 1e-2  # of the last depth; where this is not enough, other springs or another mesh are cheaper than more halvings
INVERTED = "an element turned inside out"
EASY, HARD = 6, 10  # iterations below which the step grows, above which it shrinks
RELAXED = HARD - 1  # what a relaxation counts as: the snap is over, and the next step may be as long


@dataclass
class Counts:
    """Steps, cutbacks and Newton iterations of one run; steps that were left at a residual above the tolerance, and the largest."""

    steps: int = 0
    cutbacks: int = 0
    iterations: int = 0
    loose_steps: int = 0
    largest_residual: float = 0.0


@dataclass(frozen=True)
class Controls:
    """How a path is followed: relative residual of an equilibrium, largest step in mm, the Deadline, and what is told of progress:
    called with the share of the last depth that is done."""

    tolerance: float
    max_step: float = np.inf
    deadline: Deadline = NEVER
    progress: Callable[[float], None] | None = None


@dataclass(frozen=True)
class Load:
    """What one run of a model is made of: material, bulk modulus kPa and the one to assemble tangents with (fem.linear), fibre
    direction (3,), contact springs, and the Directions (fem.sensitivity) that it is differentiated by."""

    material: object
    kappa: float
    bulk: float
    fibre: np.ndarray
    springs: object
    directions: tuple = ()

    def softened(self):
        return replace(self, springs=self.springs.scaled(SOFTER))

    def stiffened(self, springs):
        """Back towards the springs that a softened load began with."""
        if self.springs.normal >= springs.normal * SOFTER:
            return replace(self, springs=springs)
        return replace(self, springs=self.springs.scaled(1 / SOFTER))


@dataclass(frozen=True)
class Equilibrium:
    """A converged step: depth mm, displacements u (n,) mm, pressure modes, contact, force mN and dF/dd mN/mm of the quarter.

    penalty_error: force withheld by the contact springs, mN; residual_error: force that the residual left over
    stands for, mN; direction: du/dd (n,); rate: of the contact's traction since
    the last step (at rest: its tangent), which the next step's multipliers follow; slopes: derivatives by the load's
    directions, None where the steps left the differentiable path.
    """

    depth: float
    u: np.ndarray
    pressure: np.ndarray
    touch: object
    force: float
    stiffness: float
    penalty_error: float
    residual_error: float
    direction: np.ndarray = field(repr=False)
    rate: np.ndarray = field(repr=False)
    slopes: sensitivity.Slopes | None = field(default=None, repr=False)

    def since(self, here):
        """This step with the traction's rate, and its changes, since the step `here`."""
        step = self.depth - here.depth
        rate = (self.touch.traction - here.touch.traction) / step
        return replace(self, rate=rate, slopes=self.slopes and self.slopes.since(here.slopes, step))


def indent(body, contact, fixed, load, solver, depths, controls, counts):
    """Equilibria from zero to the last of the depths (mm, rising); the first one is the untouched sample.

    body: fem.element.Solid or fem.forms.FormSolid; fixed: constrained dofs; solver: fem.linear.LinearSolver;
    counts: Counts, added to. Raises ConvergenceError where no smaller step helps, and OutOfTime.
    """
    last = float(depths[-1])
    largest = min(controls.max_step, last / FIRST_STEPS)
    springs = load.springs
    step, path = largest, [untouched(body, contact, fixed, load, solver)]
    while path[-1].depth < last * (1 - 1e-12):
        controls.deadline.check()
        here = path[-1]
        step = min(step, largest, last - here.depth)
        depth = last if here.depth + 1.01 * step > last else here.depth + step
        try:
            relax = depth - here.depth < 0.6 * largest
            there, iterations = _step(body, contact, fixed, load, solver, here, depth, LEASH * last, controls, counts, relax)
        except ConvergenceError as error:
            counts.cutbacks += 1
            step = (depth - here.depth) / 2
            load = load.softened() if relax else load
            solver.forget()
            if step < SMALLEST_STEP * last:
                raise ConvergenceError(error.cause, depth, counts.steps + 1, error.iteration) from error
            continue
        counts.steps += 1
        load = load.stiffened(springs)
        there = _augmented(body, contact, fixed, load, solver, there, LEASH * last, controls, counts)
        path.append(there.since(here))
        if controls.progress is not None:
            controls.progress(depth / last)
        if iterations <= EASY:
            step *= 1.5
        elif iterations >= HARD:
            step = max(step / 1.5, SMALLEST_STEP * last)
    return path


def _augmented(body, contact, fixed, load, solver, there, leash, controls, counts):
    """The step solved again at its depth with its own multipliers while the springs withhold too much of the force."""
    for _ in range(MAX_AUGMENTATIONS):
        if abs(there.penalty_error) <= WITHHELD * abs(there.force):
            break
        try:
            there, _ = _step(body, contact, fixed, load, solver, there, there.depth, leash, controls, counts)
        except ConvergenceError:
            break  # the larger penalty error is reported
    return there


def untouched(body, contact, fixed, load, solver):
    """The state before indentation, with the direction and stiffness in which it leaves."""
    u = np.zeros(body.n_dofs)
    state = body.state(u, load.fibre)
    pressure = body.pressure(state, load.kappa)
    system = _System(body, contact, fixed, load, contact.rest(), 0.0, changes=tuple(contact.no_change() for _ in load.directions))
    system.assemble(u, pressure)
    return system.equilibrium(u, solver, at_rest=True)


def _step(body, contact, fixed, load, solver, here, depth, leash, controls, counts, relax=True):
    """The equilibrium at a depth from the tangent prediction, and how many iterations it took: by Newton, else relaxed."""
    history = here.touch.advanced(here.rate, depth - here.depth)
    changes = here.slopes and here.slopes.advanced(here.touch, here.rate, depth - here.depth)
    system = _System(body, contact, fixed, load, history, depth, leash, changes)
    u, pressure = _predicted(system, here, depth)
    try:
        return _newton(system, u, pressure, solver, controls, counts)
    except ConvergenceError as first:
        if not relax:
            raise
        solver.forget()
        try:
            return _relaxed(system, u, pressure, solver, controls, counts)
        except ConvergenceError as error:
            raise (first if INVERTED in first.cause else error) from None  # what came first says more than the residual left


def _newton(system, u, pressure, solver, controls, counts, most=MAX_ITERATIONS):
    hard = 0
    for iteration in range(most):
        controls.deadline.check()
        size, scale = system.assemble(u, pressure)
        if size <= controls.tolerance * scale:
            return system.equilibrium(u, solver), iteration
        counts.iterations += 1
        du = solver.solve(system.tangent, -system.residual, enough=0.1 * controls.tolerance * scale)
        u, pressure, share = _line_search(system, u, pressure, du, iteration)
        hard = hard + 1 if share < 0.5 else 0
        if hard == 3:
            break
    raise system.failure(size / scale, iteration)


def _relaxed(system, u, pressure, solver, controls, counts):
    """The equilibrium reached from u by overdamped motion: nodal dampers, implicit steps of time that grow as they get easy.

    Where the tangent loses definiteness (surface folding at the sample's rim, fibres buckling at the indenter's edge, points about
    to slip) a Newton step points anywhere. With dampers each step of time has a solution near the last one, and the motion ends
    in a stable equilibrium of the undamped body. The contact's history goes along with it, as in a slow experiment. What is left
    of the residual after MAX_RELAXED iterations is accepted up to LOOSE, counted, and its share of the force reported.
    """
    start, damping, history = counts.iterations, 1.0, (system.history, system.changes)
    failed, wary = 0.0, 0
    best = (np.inf, u, pressure, *history)
    while counts.iterations - start < MAX_RELAXED and damping < STIFFEST_DAMPER:
        controls.deadline.check()
        size, scale = system.assemble(u, pressure)
        if not np.isfinite(size):
            break
        if size < best[0] * scale:
            best = size / scale, u, pressure, system.history, system.changes
        if size <= controls.tolerance * scale:
            return _settled(system, u, pressure, history, solver, controls, counts), RELAXED
        moved = _moved(system, u, pressure, damping, solver, counts, controls.tolerance * scale)
        if moved is None:
            failed, wary = damping, WARY
            damping *= 4
            continue
        u, pressure, iterations = moved
        system.history, system.changes = system.touch.advanced(), None
        damping /= 4 if iterations <= 2 else 2 if iterations <= 3 else 1
        if wary:
            damping, wary = max(damping, 2 * failed), wary - 1
        if iterations <= 2 and damping < NEARLY_STILL:  # what is left is the multipliers' own slow convergence
            with contextlib.suppress(ConvergenceError):
                return _settled(system, u, pressure, history, solver, controls, counts), RELAXED
    size, u, pressure, system.history, system.changes = best
    system.assemble(u, pressure)
    if size > LOOSE:
        raise system.failure(size, counts.iterations - start)
    counts.loose_steps += 1
    counts.largest_residual = max(counts.largest_residual, size)
    return system.equilibrium(u, solver), MAX_ITERATIONS


def _settled(system, u, pressure, history, solver, controls, counts):
    """The equilibrium near a relaxed one that belongs to the history (and its changes) the step began with, where there is one:
    it can be differentiated; else the relaxed history's. Raises ConvergenceError where Newton finds neither."""
    relaxed = system.history, system.changes
    system.history, system.changes = history
    try:
        return _newton(system, u, pressure, solver, controls, counts, FEW)[0]
    except ConvergenceError:
        system.history, system.changes = relaxed
        return _newton(system, u, pressure, solver, controls, counts, FEW)[0]


def _moved(system, u, pressure, damping, solver, counts, enough):
    """Displacements, pressures and iterations of one implicit step of the damped motion from u, or None where it fails.

    The system is assembled at u; enough: norm of the residual below which nothing is left to do.
    """
    dampers, start = damping * system.load.material.shear_modulus * system.fixed.sizes, u
    for iteration in range(MAX_IMPLICIT):
        if iteration:
            system.assemble(u, pressure)
        residual = system.residual + dampers * (u - start)
        residual[system.fixed.dofs] = 0
        size = np.linalg.norm(residual)
        if iteration == 0:
            first = size
        elif size <= max(EASED * first, 0.1 * enough):
            return u, pressure, iteration
        counts.iterations += 1
        du = solver.solve(system.damped(dampers), -residual)
        try:
            u, pressure, _ = _line_search(system, u, pressure, du, 0, 1.2, lambda v: dampers * (v - start))
        except ConvergenceError:
            return None
    return None


def _predicted(system, here, depth):
    """Displacements and pressures on the path's tangent, on a shorter piece of it where that would invert an element."""
    for share in (1.0, 0.5, 0.25, 0.0):
        u = here.u + share * (depth - here.depth) * here.direction
        state = system.body.state(u, system.load.fibre)
        if state.valid:
            return u, here.pressure + system.linear_pressure(system.body.dilatation_map(here.u), u - here.u)
    raise ConvergenceError(INVERTED, depth)


def _line_search(system, u, pressure, du, iteration, growth=2.0, dampers=None):
    """Displacements and pressures after the longest of the steps 1, 1/2, ... that the residual stands, and its share.

    No step moves a point by more than the leash: near an instability Newton points far away. dampers: u -> their forces (n,).
    """
    change = system.pressure_change(u, pressure, du)
    before = system.merit(u, pressure, dampers)
    tried = []
    longest = min(1.0, system.leash / max(np.abs(du).max(), 1e-300))
    for share in longest * np.array([1.0, 0.5, 0.25, 0.1, 0.02]):
        merit = system.merit(u + share * du, pressure + share * change, dampers)
        tried.append((merit, -share))
        if merit < (1.0 if iteration > 3 else growth) * before:
            break
    else:
        merit, share = min(tried)
        share = -share
    if not np.isfinite(merit):
        raise system.failure(np.inf, iteration, INVERTED)
    return u + share * du, pressure + share * change, share / longest


class _System:
    """Residual and tangent of body and contact at one depth."""

    def __init__(self, body, contact, fixed, load, history, depth, leash=np.inf, changes=()):
        self.body, self.contact, self.fixed, self.load = body, contact, fixed, load
        self.history, self.depth, self.leash, self.changes = history, depth, leash, changes

    def failure(self, size, iteration, cause=None):
        """ConvergenceError that tells what the contact did when the iteration ended."""
        touch = self.touch
        state = f"{int(touch.touching.sum())} of {touch.gap.size} contact points touch, {int(touch.slipping.sum())} slip"
        cause = cause or f"residual still {size:.1e} of the contact force after {iteration + 1} iterations"
        return ConvergenceError(f"{cause} ({state}); try a coarser mesh or an edge radius", self.depth, iteration=iteration)

    def damped(self, dampers):
        """The tangent with dampers (n,), mN/mm, at the dofs."""
        whole, body = self.tangent.whole.data.copy(), self.tangent.body.data.copy()
        whole[self.fixed.diagonal] += dampers
        body[self.fixed.diagonal] += dampers
        return replace(self.tangent, whole=self.body.matrix(whole), body=self.body.matrix(body))

    def assemble(self, u, pressure):
        """Sets residual and tangent at u; returns the norms of the residual and of the contact forces."""
        load = self.load
        state = self.body.state(u, load.fibre)
        self.state = state
        residual, values = self.body.tangent(u, state, load.material, pressure, load.kappa, load.fibre, load.bulk)
        self.touch = self.contact.touch(u, self.depth, self.history, load.springs)
        forces = self.contact.residual(self.touch)
        residual += forces
        self.fixed.constrain(residual, values)
        whole = values.copy()
        dense = self.fixed.without(self.contact.add_tangent(self.touch, whole), self.contact.surface)
        self.fixed.restore(whole, values)
        self.dilatation = self.body.dilatation_map(u)
        B = self.fixed.dilatation(self.dilatation)
        self.residual = residual
        whole, body = self.body.matrix(whole), self.body.matrix(values)
        self.tangent = Tangent(whole, body, dense, B, load.kappa, load.bulk, load.material.shear_modulus)
        return np.linalg.norm(residual), np.linalg.norm(forces)

    def merit(self, u, pressure, dampers=None):
        """Norm of the residual at given pressures, with the forces of dampers (u -> (n,)); infinite where an element inverts."""
        state = self.body.state(u, self.load.fibre)
        if not state.valid:
            return np.inf
        with np.errstate(all="ignore"):
            residual = self.body.residual(u, state, self.load.material, pressure, self.load.fibre)
        residual += self.contact.residual(self.contact.touch(u, self.depth, self.history, self.load.springs, False))
        if dampers is not None:
            residual += dampers(u)
        residual[self.fixed.dofs] = 0
        size = float(np.linalg.norm(residual))
        return size if np.isfinite(size) else np.inf

    def linear_pressure(self, dilatation, du):
        """Change of the pressure modes along du, linearised: dilatation is the body's dilatation_map."""
        return self.load.kappa * np.einsum("emni,eni->em", dilatation, du[self.body.dofs])

    def pressure_change(self, u, pressure, du):
        """Newton's change of the iterated pressures that goes with du."""
        return self.body.pressure(self.state, self.load.kappa) - pressure + self.linear_pressure(self.dilatation, du)

    def equilibrium(self, u, solver, at_rest=False):
        """The converged step at u with its tangent direction and stiffness, and its slopes by the load's directions."""
        by_depth = self.contact.by_depth(self.touch)
        by_depth[self.fixed.dofs] = 0
        differentiated = self.load.directions and self.changes
        if differentiated:
            solver.forget()  # many solves with this tangent, to an accuracy that a stale factor reaches slowly
        # what the prediction of a step needs little of, a stiffness that is asked for and derivatives of the path need whole
        direction = solver.solve(self.tangent, -by_depth, sensitivity.ACCURACY if at_rest or differentiated else None)
        rate = self.contact.rate(self.touch, direction)
        return Equilibrium(
            depth=self.depth,
            u=u,
            pressure=self.body.pressure(self.state, self.load.kappa),
            touch=self.touch,
            force=self.contact.force(self.touch),
            stiffness=self.contact.total(rate),
            penalty_error=self.contact.penalty_error(self.touch, rate, self.load.springs),
            residual_error=float(self.residual @ direction),
            direction=direction,
            rate=rate,
            slopes=(
                self.load.directions
                and self.changes
                and sensitivity.at_equilibrium(self, u, solver, direction if at_rest else None)
            )
            or None,
        )


class Fixed:
    """Dofs (n_fixed,) held at zero, as identity rows and columns of the tangent; and where its diagonal is.

    diagonal: places (n,) of the diagonal in the CSR data; sizes: cube root of each dof's share of the volume, mm.
    """

    def __init__(self, body, dofs):
        self.dofs = np.unique(dofs)
        held = np.zeros(body.n_dofs, dtype=bool)
        held[self.dofs] = True
        rows = np.repeat(np.arange(body.n_dofs, dtype=np.int32), np.diff(body.indptr))
        self._entries = np.flatnonzero(held[rows] | held[body.indices])
        self._is_held = held
        n_el, n_m = body.means.shape
        columns = np.broadcast_to(body.dofs.reshape(n_el, 1, -1), (n_el, n_m, body.dofs[0].size)).astype(np.int32)
        self._columns, self._moving = columns.ravel(), ~held[columns.ravel()]
        self._starts = np.arange(n_el * n_m + 1, dtype=np.int32) * body.dofs[0].size
        self.diagonal = np.flatnonzero(rows == body.indices)
        self._held, self._free = self.diagonal[held], self.diagonal[~held]
        shares = np.zeros(body.n_dofs)
        np.add.at(shares, body.dofs, (body.volume / body.dofs.shape[1])[:, None, None])
        self.sizes = np.cbrt(shares)

    def dilatation(self, values):
        """CSR matrix (n_el * n_m, n) of a dilatation map (n_el, n_m, n_n, 3) that the held dofs have no part in."""
        shape = (self._starts.size - 1, self._is_held.size)
        return sp.csr_matrix((values.ravel() * self._moving, self._columns, self._starts), shape=shape, copy=False)

    def freed(self, values):
        """Values (n, ...) with those of the held dofs zeroed, in place."""
        values[self.dofs] = 0
        return values

    def without(self, matrix, dofs):
        """A dense matrix on dofs with the held ones' rows and columns zeroed, in place."""
        held = np.flatnonzero(self._is_held[dofs])
        matrix[held], matrix[:, held] = 0, 0
        return matrix

    def restore(self, values, constrained):
        """Puts the held rows and columns of CSR data `constrained` into `values`."""
        values[self._entries] = constrained[self._entries]

    def constrain(self, residual, values):
        """Zeroes the held rows and columns in place and puts a typical stiffness on their diagonal."""
        residual[self.dofs] = 0
        values[self._entries] = 0
        values[self._held] = np.mean(np.abs(values[self._free]))
