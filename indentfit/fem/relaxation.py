"""Relaxation: an equilibrium reached by overdamped motion, where Newton's iteration finds none.

Where the tangent loses definiteness (surface folding at the sample's rim, fibres buckling at the indenter's edge, points about
to slip) the direction of a Newton step is arbitrary. With dampers each step of time has a solution near the last one, and the
motion ends in a stable equilibrium of the undamped body. The contact's history follows the motion, as in a slow experiment.

Points of the contact may chatter (fem/contact.py) without end. A residual of at most LOOSE after MAX_RELAXED iterations is
therefore accepted. Such a step is a *loose step*: loose steps are counted, and their share of the force is reported.
"""

import contextlib
from dataclasses import dataclass, replace

import numpy as np

from indentfit.errors import ConvergenceError
from indentfit.fem.contact_first import approached
from indentfit.fem.contact_state import ContactState
from indentfit.fem.equations import Increment, Iterate, Linearisation
from indentfit.fem.equilibrium import Equilibrium
from indentfit.fem.newton import MAX_ITERATIONS, Newton, line_search

NEARLY_STILL, FEW = 0.1, 6  # damping below which Newton's iteration is tried from a relaxed state, and its limit of iterations
MAX_RELAXED, MAX_IMPLICIT = 120, 8  # iterations of a relaxation, and of one of its steps of time
STEP = 0.3  # iterations of Newton's that a step of time counts as, without those that it makes
FAR, SOON = 0.1, 60  # residual, over the contact force, with which a relaxation is given up after so many iterations
IDLE = 40  # iterations without less than BETTER of the least residual, after which a state that is a loose step ends the motion
BETTER = 0.7
LEFT = 5.0  # growth of the residual from which on the state with the least is no rest any more: the motion has only passed it
WARY = 2  # steps of time in which the dampers stay above those with which a step has just failed
EASED, EASED_FIRST = 1e-2, 0.1  # reduction of the residual that ends a step of time, by Newton's iteration and by `contact_first`
STEPS_AS_ONE = 4  # steps of `contact_first` that count as an iteration where the next step of time follows from their number
SHORTER = (0.25, 0.06)  # of a step of `contact_first`, where the whole leads far away
CREEP = 1.2  # factor by which the residual may grow in an iteration of a step of time
STIFFEST_DAMPER = 1e6  # in units of shear modulus times size
LOOSE = 5e-3  # largest residual of a loose step, over the contact force
RELAXED = 9  # iterations that a relaxation counts as, one less than path.HARD: the snap is over, the next step may be as long


def relaxed(newton: Newton, increment: Increment, at: Iterate) -> tuple[Equilibrium, int]:
    """The Equilibrium reached from an iterate by overdamped motion, and the number of iterations that the relaxation counts as.

    Raises
    ------
    ConvergenceError
        The motion does not come to rest.
    OutOfTime
    """
    first, damping, mover = increment, Damping(), _Mover(newton)
    best = _Rest(np.inf, increment, at)
    while mover.effort < MAX_RELAXED and damping.now < STIFFEST_DAMPER:
        here = newton.linearised(increment, at)
        if not np.isfinite(here.unbalanced):
            break
        best = best.or_better(here, mover.effort)
        if here.balanced(newton.controls.tolerance):
            return _settled(newton, first, here.increment, at), RELAXED
        if best.gives_up(here.share, mover.effort):
            break
        motion = mover.moved(here, damping.now)
        if motion is None:
            damping = damping.failed()
            continue
        at, increment = motion.at, increment.after(motion.contact.advanced())
        damping = damping.eased(motion.iterations)
        if motion.iterations <= 2 and damping.now < NEARLY_STILL:  # only the multipliers still converge, slowly
            with contextlib.suppress(ConvergenceError):
                return _settled(newton, first, increment, at), RELAXED
    return _loose(newton, best, int(mover.effort)), MAX_ITERATIONS


@dataclass(frozen=True)
class Damping:
    """Coefficient of the dampers, in units of shear modulus times size, and the last coefficient that failed."""

    now: float = 1.0
    last_failed: float = 0.0
    wary: int = 0

    def failed(self) -> "Damping":
        """Stiffer dampers after a step of time that was not solved."""
        return Damping(4 * self.now, self.now, WARY)

    def eased(self, iterations: int) -> "Damping":
        """Softer dampers, and so longer steps of time, the fewer iterations the last step took."""
        softer = self.now / (4 if iterations <= 2 else 2 if iterations <= 3 else 1)
        if not self.wary:
            return replace(self, now=softer)
        return replace(self, now=max(softer, 2 * self.last_failed), wary=self.wary - 1)


@dataclass(frozen=True, eq=False)
class _Rest:
    """The iterate nearest to rest, with its residual as a share of the contact force, and its increment.

    since: the effort with which the motion came to a residual clearly less than that of any state before.
    """

    share: float
    increment: Increment
    at: Iterate
    since: float = 0.0

    def or_better(self, here: Linearisation, effort: float) -> "_Rest":
        """The iterate that is nearer to rest; a later one, in any case, once the motion has left this one."""
        if here.share > LEFT * self.share:
            return _Rest(here.share, here.increment, here.at, effort)
        if here.share < self.share:
            return _Rest(here.share, here.increment, here.at, effort if here.share <= BETTER * self.share else self.since)
        return self

    def gives_up(self, share: float, effort: float) -> bool:
        """Whether more of the motion leads nowhere: it is far from rest for long, or stays about where it is a loose step."""
        idle = self.share <= LOOSE and effort - self.since > IDLE and share < 2 * self.share
        return idle or (effort > SOON and self.share > FAR)


@dataclass(frozen=True, eq=False)
class _Motion:
    """One implicit step of time: where it ended, the contact there, and its iterations."""

    at: Iterate
    contact: ContactState
    iterations: int


class _Mover:
    """Implicit steps of time, by `contact_first` and, where that leads nowhere, by Newton's iteration.

    effort: what the steps have cost, in iterations of Newton's.
    """

    def __init__(self, newton: Newton) -> None:
        self.effort = 0.0
        self._newton, self._goes_around, self._has_moved = newton, True, False

    def moved(self, here: Linearisation, damping: float) -> _Motion | None:
        """One implicit step of the damped motion from a linearisation, or None where it fails."""
        self.effort += STEP
        damped = here.increment.damped(damping, here.at.u)
        try:
            motion = self._contact_first(damped, here)
            if motion is None and (self._has_moved or not self._goes_around):  # else stiffer dampers are found sooner
                motion = self._by_newton(damped, here)
        except ConvergenceError:
            return None
        self._has_moved = self._has_moved or motion is not None
        return motion

    def _contact_first(self, damped: Increment, here: Linearisation) -> _Motion | None:
        solver, controls = self._newton.solver, self._newton.controls
        if self._goes_around and not solver.goes_around:
            solver.renew(here.damped(damped).tangent)
            self._goes_around = solver.goes_around
        if not self._goes_around or not here.contact_force:
            return None
        enough = max(EASED_FIRST * here.unbalanced, 0.1 * controls.tolerance * here.contact_force)
        near = approached(damped, here.at, solver, replace(controls, tolerance=float(enough / here.contact_force)), SHORTER)
        if near is not None:
            return _Motion(near.at, near.here.contact, 1 + near.steps // STEPS_AS_ONE)
        if not self._has_moved:
            solver.forget()
        return None

    def _by_newton(self, damped: Increment, here: Linearisation) -> _Motion | None:
        """Raises ConvergenceError."""
        newton, at = self._newton, here.at
        enough = max(EASED * here.unbalanced, 0.1 * newton.controls.tolerance * here.contact_force)
        for iteration in range(MAX_IMPLICIT):
            there = newton.linearised(damped, at) if iteration else here.damped(damped)
            if iteration and there.unbalanced <= enough:
                return _Motion(at, there.contact, iteration)
            newton.work.iterations += 1
            self.effort += 1
            du = newton.solver.solve(there.tangent, -there.residual, deadline=newton.controls.deadline)
            at = line_search(there, du, 0, CREEP).at
        return None


def _settled(newton: Newton, first: Increment, relaxed: Increment, at: Iterate) -> Equilibrium:
    """The equilibrium near a relaxed one, if possible with the history at the step's start, because it can then be differentiated;
    otherwise with the relaxed history. Raises ConvergenceError where Newton's iteration finds neither."""
    try:
        return newton.equilibrium(first, at, FEW)[0]
    except ConvergenceError:
        return newton.equilibrium(relaxed, at, FEW)[0]


def _loose(newton: Newton, best: _Rest, iterations: int) -> Equilibrium:
    """The best state of a motion that did not come to rest. Raises ConvergenceError where its residual is above LOOSE."""
    here = best.increment.linearised(best.at)
    if best.share > LOOSE:
        raise here.failure(best.share, iterations)
    newton.work.loose_steps += 1
    newton.work.largest_residual = max(newton.work.largest_residual, best.share)
    return newton.settled(here)
