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
from indentfit.fem.equations import Dampers, Increment, Iterate, Linearisation
from indentfit.fem.equilibrium import Equilibrium
from indentfit.fem.newton import MAX_ITERATIONS, Newton, line_search

NEARLY_STILL, FEW = 0.1, 6  # damping below which Newton's iteration is tried from a relaxed state, and its limit of iterations
MAX_RELAXED, MAX_IMPLICIT = 120, 8  # iterations of a relaxation, and of one of its steps of time
WARY = 2  # steps of time in which the dampers stay above those with which a step has just failed
EASED = 1e-2  # reduction of the residual that ends a step of time
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
    start, first, damping = newton.work.iterations, increment, Damping()
    best = _Rest(np.inf, increment, at)
    while newton.work.iterations - start < MAX_RELAXED and damping.now < STIFFEST_DAMPER:
        here = newton.linearised(increment, at)
        if not np.isfinite(here.unbalanced):
            break
        best = best.or_better(here)
        if here.balanced(newton.controls.tolerance):
            return _settled(newton, first, here.increment, at), RELAXED
        motion = _moved(newton, here, damping.now)
        if motion is None:
            damping = damping.failed()
            continue
        at, increment = motion.there.at, increment.after(motion.there.contact.advanced())
        damping = damping.eased(motion.iterations)
        if motion.iterations <= 2 and damping.now < NEARLY_STILL:  # only the multipliers still converge, slowly
            with contextlib.suppress(ConvergenceError):
                return _settled(newton, first, increment, at), RELAXED
    return _loose(newton, best, newton.work.iterations - start), MAX_ITERATIONS


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
    """The iterate nearest to rest, with its residual as a share of the contact force, and its increment."""

    share: float
    increment: Increment
    at: Iterate

    def or_better(self, here: Linearisation) -> "_Rest":
        if here.share < self.share:
            return _Rest(here.share, here.increment, here.at)
        return self


@dataclass(frozen=True, eq=False)
class _Motion:
    """One implicit step of time: the linearisation where it ended, and its iterations."""

    there: Linearisation
    iterations: int


def _moved(newton: Newton, here: Linearisation, damping: float) -> _Motion | None:
    """One implicit step of the damped motion from a linearisation, or None where it fails."""
    fixed, mu = here.increment.equations.fixed, here.increment.loading.material.shear_modulus
    dampers = Dampers(damping * mu * fixed.sizes, here.at.u)
    at, enough, eased = here.at, newton.controls.tolerance * here.contact_force, np.inf
    for iteration in range(MAX_IMPLICIT):
        if iteration:
            here = newton.linearised(here.increment, at)
        residual = fixed.freed(here.residual + dampers.forces(here.at.u))
        size = float(np.linalg.norm(residual))
        if iteration == 0:
            eased = max(EASED * size, 0.1 * enough)
        elif size <= eased:
            return _Motion(here, iteration)
        newton.work.iterations += 1
        try:
            du = newton.solver.solve(here.damped(dampers), -residual, deadline=newton.controls.deadline)
            at = line_search(here, du, 0, CREEP, dampers).at
        except ConvergenceError:
            return None
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
