"""Newton's iteration with the consistent tangent; each step is shortened until the residual is acceptable."""

from dataclasses import dataclass

import numpy as np

from indentfit.arrays import Array
from indentfit.fem.contact_first import approached
from indentfit.fem.controls import Controls, Work
from indentfit.fem.equations import Increment, Iterate, Linearisation
from indentfit.fem.equilibrium import Equilibrium, equilibrium_of
from indentfit.fem.linear.solver import LinearSolver

MAX_ITERATIONS, HARD = 15, 3
SHARES = np.array([1.0, 0.5, 0.25, 0.1, 0.02])  # shares of a step, tried one after the other
GROWTH = 2.0  # factor by which the residual may grow in each of the first iterations
INVERTED = "an element turned inside out"


@dataclass(frozen=True)
class Newton:
    """Newton's iteration of one run: its linear solver, that of the derivatives (`exact`), its controls, and its count of work."""

    solver: LinearSolver
    exact: LinearSolver
    controls: Controls
    work: Work

    def equilibrium(
        self, increment: Increment, at: Iterate, most: int = MAX_ITERATIONS, rests: Equilibrium | None = None
    ) -> tuple[Equilibrium, int]:
        """The Equilibrium of an increment from an iterate near it, and the number of iterations; `contact_first` is tried before,
        unless the indenter moves and the body winds round its edge.

        Where the indenter rests at the depth of another equilibrium, `rests`, that of `contact_first` keeps the motion of that one,
        and no tangent is made.

        Raises
        ------
        ConvergenceError
            No equilibrium after `most` iterations, or after HARD steps in a row that were shortened to less than half, or that lead
            farther away than the iterations left can go on the increment's leash.
        OutOfTime
        """
        wound = rests is None and increment.equations.face.winds
        near = None if wound else approached(increment, at, self.solver, self.controls)
        if near is not None and rests is not None:
            return rests.rested(near.here, increment, self.solver.dilatation), near.iterations
        at, before = (at, 0) if near is None else (near.at, near.iterations)
        hard, tolerance, merit = 0, self.controls.tolerance, None
        for iteration in range(most):
            here = self.linearised(increment, at)
            if here.balanced(tolerance):
                return self.settled(here), before + iteration
            self.work.iterations += 1
            enough = 0.1 * tolerance * here.contact_force
            du = self.solver.solve(here.tangent, -here.residual, enough=enough, deadline=self.controls.deadline)
            searched = line_search(here, du, iteration, before=merit)
            at, merit = searched.at, searched.merit
            crawls = searched.longest * (most - iteration) < 1
            hard = hard + 1 if searched.share < 0.5 or crawls else 0
            if hard == HARD:
                break
        raise here.failure(here.share, iteration)

    def linearised(self, increment: Increment, at: Iterate) -> Linearisation:
        """Residual and tangent at an iterate. Raises OutOfTime."""
        self.controls.deadline.check()
        return increment.linearised(at)

    def settled(self, here: Linearisation, at_rest: bool = False) -> Equilibrium:
        """The Equilibrium at a linearisation that is converged."""
        return equilibrium_of(here, self.solver, self.exact, self.controls.deadline, at_rest)


@dataclass(frozen=True)
class Searched:
    """What a line search ends with: the iterate, its share of the longest allowed step, its residual, mN, and the longest share of
    the whole step that is allowed."""

    at: Iterate
    share: float
    merit: float
    longest: float


def line_search(
    here: Linearisation,
    du: Array,
    iteration: int,
    growth: float = GROWTH,
    before: float | None = None,
) -> Searched:
    """The iterate after the longest of the SHARES of a step with an acceptable residual.

    No step moves a point by more than the increment's leash, because near an instability Newton's step is far too long.

    Parameters
    ----------
    du : array (n,), mm
        The whole step.
    iteration : int
        After the fourth, the residual has to fall.
    growth : float
        Growth of the residual that is acceptable in the first four iterations.
    before : float, mN
        The residual at the linearisation, where it is known.

    Returns
    -------
    Searched

    Raises
    ------
    ConvergenceError
        Every step turns an element inside out.
    """
    increment, at, change = here.increment, here.at, here.change(du)
    before = increment.merit(at) if before is None else before
    tried = []
    longest = min(1.0, increment.leash / max(np.abs(du).max(), 1e-300))
    for share in longest * SHARES:
        merit = increment.merit(at.moved(share, change))
        tried.append((merit, -share))
        if merit < (1.0 if iteration > 3 else growth) * before:
            break
    else:
        merit, share = min(tried)
        share = -share
    if not np.isfinite(merit):
        raise here.failure(np.inf, iteration, INVERTED)
    return Searched(at.moved(share, change), share / longest, merit, longest)
