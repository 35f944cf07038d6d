"""Iteration without tangents: the contact is solved for itself, on the body's last factor.

From one equilibrium to the next the body's tangent changes by a few per cent, but points of the contact stick, slip and lift off.
A Newton iteration linearises both, and friction keeps it going to and fro. Here each iteration solves the contact's own equations
S d + t(u + d) - t(u) = b, nonlinear as they are, on the Schur complement S of the factor at hand, a small dense system. The body's
equations are corrected from one iteration to the next (nonlinear elimination: Lanzkron, Rose and Wilkes 1996, SIAM J Sci Comput
17:538), with Anderson's acceleration (Walker and Ni 2011, SIAM J Numer Anal 49:1715). An iteration costs a residual and one use of
the factor, a fifth of one of Newton's. Where it is slow, a new factor is made; where it leads nowhere, Newton's iteration follows.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from indentfit.arrays import Array
from indentfit.errors import ConvergenceError
from indentfit.fem.contact_state import ContactState
from indentfit.fem.controls import Controls
from indentfit.fem.equations import Balance, Increment, Iterate
from indentfit.fem.linear.factor import Inverse
from indentfit.fem.linear.solver import LinearSolver

MOST, NEW_FACTORS = 24, 2  # iterations, and factors made in them
FOR_A_FACTOR = 4  # iterations of Newton's that the need of a new factor stands for
PATIENCE, PACE = 4, 0.5  # iterations on a factor, after which the residual has to fall by this factor in each, on average
SAFE = 0.9  # share of the tolerance that ends the iteration: its residual is a few per cent off
LOST = 3.0  # growth of the residual, over the smallest, at which the iteration is given up
# Largest motions of a point in one iteration of all and in one on the surface, in units of the increment's leash: the contact is
# solved, not linearised.
LEASH, LEASH_ON_SURFACE = 3.0, 10.0
MOST_ON_SURFACE, SOLVED = 12, 1e-2  # iterations of the contact's own equations, and the share of their residual that may be left
UNSOLVED = 0.3  # share from which on the contact counts as not solved
SHARES = (1.0, 0.5, 0.25, 0.1)  # of a step of the contact's own iteration, tried one after the other


@dataclass(frozen=True)
class Approach:
    """The forces of an iterate whose residual is within the tolerance, and how many steps led there and factors were made."""

    here: Balance
    steps: int
    new_factors: int

    @property
    def at(self) -> Iterate:
        return self.here.at

    @property
    def iterations(self) -> int:
        """The number of Newton's iterations that the way counts as, where the next step's length follows from it."""
        return FOR_A_FACTOR * self.new_factors


def approached(
    increment: Increment, at: Iterate, solver: LinearSolver, controls: Controls, shorter: Sequence[float] = ()
) -> Approach | None:
    """The Approach from an iterate; None where the iteration leads nowhere, or no factor that goes around the contact is at hand.

    shorter: shares of a step that are tried, one after the other, where the whole step leads far away.

    Raises OutOfTime.
    """
    if not solver.goes_around:
        return None
    best, sizes, steps, made, step, shares = None, [], _Steps(), 0, None, list(shorter)
    for steps_made in range(MOST):
        controls.deadline.check()
        here = increment.balance(at, solver.dilatation)
        if here is None or (best is not None and not here.unbalanced < LOST * best.unbalanced):
            if best is None or step is None or not shares:
                return None
            at, sizes, steps = best.at.moved(shares.pop(0), step), [best.unbalanced], _Steps()
            continue
        if here.unbalanced <= SAFE * controls.tolerance * here.contact_force:
            return Approach(here, steps_made, made)
        best = here if best is None or here.unbalanced < best.unbalanced else best
        sizes.append(here.unbalanced)
        slow = len(sizes) > PATIENCE and here.unbalanced > sizes[0] * PACE ** (len(sizes) - 1)
        change = None if slow else _change(increment, here, solver)
        if change is None:
            if made == NEW_FACTORS or not solver.goes_around or not _renewed(solver, increment, best):
                return None
            at, sizes, steps, made = best.at, [], _Steps(), made + 1
            continue
        step, shares = steps.accelerated(change, LEASH * increment.leash), list(shorter)
        at = at.moved(1.0, step)
    return None


def _change(increment: Increment, here: Balance, solver: LinearSolver) -> Iterate | None:
    """What one iteration would do; None where the contact was not solved."""
    loading = increment.loading
    apply = solver.around(_Contact(increment, here).solve, *loading.per_mode(increment.equations.body.means))
    try:
        x = apply(-np.concatenate([here.residual, here.gap.ravel()]))
    except ConvergenceError:
        return None
    n = here.residual.size
    return Iterate(x[:n], loading.kappa * x[n:].reshape(here.gap.shape))


def _renewed(solver: LinearSolver, increment: Increment, here: Balance) -> bool:
    """Whether a new factor could be made of the tangent at an iterate."""
    try:
        solver.renew(increment.linearised(here.at).tangent)
    except ConvergenceError:
        return False
    return True


class _Contact:
    """The contact's own equations near an iterate."""

    def __init__(self, increment: Increment, here: Balance) -> None:
        self._increment, self._here = increment, here
        self._face, self._fixed = increment.equations.face, increment.equations.fixed
        self._start = self._forces(here.contact)

    def solve(self, S: Array, inverse: Inverse, b: Array) -> Array:
        """d (n_s,) with S d + t(u + d) - t(u) = b (n_s,), where t are the contact's forces; inverse: C -> (S + C)⁻¹.

        Raises ConvergenceError where most of b stays unbalanced.
        """
        d, contact, left = np.zeros_like(b), self._here.contact, b
        wanted = np.linalg.norm(b)
        size = wanted
        for _ in range(MOST_ON_SURFACE):
            if size <= SOLVED * wanted:
                break
            step = inverse(self._fixed.without(self._face.add_tangent(contact), self._face.surface))(left)
            if not np.isfinite(step).all():
                break  # S + C is singular
            step *= min(1.0, LEASH_ON_SURFACE * self._increment.leash / max(np.abs(step).max(), 1e-300))
            for share in SHARES:
                moved = d + share * step
                there = self._at(moved)
                rest = b - S @ moved - (self._forces(there) - self._start)
                if np.linalg.norm(rest) < (1 - 0.1 * share) * size:
                    break
            d, contact, left, size = moved, there, rest, np.linalg.norm(rest)
        if not size <= UNSOLVED * wanted:
            raise ConvergenceError("the contact's own equations were not solved", self._increment.depth)
        return d

    def _at(self, d: Array) -> ContactState:
        u = self._here.at.u.copy()
        u[self._face.surface] += d
        return self._increment.contact(u)

    def _forces(self, contact: ContactState) -> Array:
        return self._fixed.freed(self._face.residual(contact))[self._face.surface]


class _Steps:
    """The steps of an iteration on one factor, each accelerated by those before (Anderson)."""

    def __init__(self) -> None:
        self._changes: list[Iterate] = []  # what the iteration would do at each of its iterates
        self._steps: list[Iterate] = []

    def accelerated(self, change: Iterate, leash: float) -> Iterate:
        """The step in place of `change`; it moves no point by more than the leash, mm."""
        step = change
        if self._steps:
            differences = [b.moved(-1.0, a) for a, b in itertools.pairwise([*self._changes, change])]
            shares = np.linalg.lstsq(np.array([d.u for d in differences]).T, change.u, rcond=1e-8)[0]
            for share, earlier, difference in zip(shares, self._steps, differences, strict=True):
                step = step.moved(-share, earlier.moved(1.0, difference))
        longest = np.abs(step.u).max()
        if longest > leash:
            step = Iterate(step.u * (leash / longest), step.pressure * (leash / longest))
        self._changes.append(change)
        self._steps.append(step)
        return step
