"""A point of the path: an equilibrium, with the direction in which the path leaves it."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy.sparse as sp

from indentfit.arrays import Array
from indentfit.fem import sensitivity
from indentfit.fem.contact import ContactFace
from indentfit.fem.contact_state import ContactState, Springs
from indentfit.fem.deadline import Deadline
from indentfit.fem.directions import Direction
from indentfit.fem.equations import Balance, Increment, Iterate, Linearisation
from indentfit.fem.linear.solver import LinearSolver

WILD = 5.0  # motion of a point over that of the last step: a tangent that is nearly singular leads nowhere


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """A converged step; all forces are those of the quarter sample.

    Parameters
    ----------
    depth : float, mm
    u : array (n,), mm
    pressure : array (n_el, n_m)
        Pressure modes.
    contact : ContactState
        State of the contact.
    springs : Springs
        Springs of the contact.
    force : float, mN
        Force of the contact's tractions.
    stiffness : float, mN/mm
        dF/dd.
    penalty_error : float, mN
        Force that is missing because of the contact springs' deflection, by the tangent of the path.
    residual_error : float, mN
        Force that is missing because of the remaining residual.
    withheld : float, mN
        The penalty error by the secants of the path, where these agree with its tangent; elsewhere 0 (`sensitivity.Secants`).
    motion : array (n,), mm/mm
        du/dd.
    course : array (n,), mm/mm
        du/dd of the secant since the last step; at rest the motion. Its derivatives are known, other than the motion's.
    rate : array (n_f, n_q, 3), kPa/mm
        Rate of the contact's traction since the last step (at rest: its tangent), which the next step's multipliers follow.
    step : float, mm
        Depth since the last step; 0 at rest.
    derivatives : PathDerivatives
        Derivatives by the loading's directions; None where the steps left the path that can be differentiated.
    """

    depth: float
    u: Array
    pressure: Array
    contact: ContactState
    springs: Springs
    force: float
    stiffness: float
    penalty_error: float
    residual_error: float
    withheld: float
    motion: Array = field(repr=False)
    course: Array = field(repr=False)
    rate: Array = field(repr=False)
    step: float = 0.0
    derivatives: sensitivity.PathDerivatives | None = field(default=None, repr=False)

    @property
    def at(self) -> Iterate:
        """Displacements and pressure modes."""
        return Iterate(self.u, self.pressure)

    @property
    def whole_force(self) -> float:
        """The force, mN, with what is missing: its error is of the second order in the springs' deflection and the residual. By a
        motion that is wild nobody knows what the residual withholds: nothing is added for it, and the residual error is stated."""
        return self.force + self.withheld + (0.0 if self.wild else self.residual_error)

    @property
    def wild(self) -> bool:
        """Whether the motion is that of a tangent which is nearly singular."""
        return bool(np.abs(self.motion).max() > WILD * max(1.0, np.abs(self.course).max()))

    def rested(self, there: Balance, increment: Increment, dilatation: sp.csr_matrix) -> "Equilibrium":
        """The equilibrium at the same depth that balanced forces are, after a time, with this one's motion; dilatation: that by
        which they are balanced (n_p, n)."""
        face, springs = increment.equations.face, increment.loading.springs
        rate = face.rate(there.contact, self.motion)
        missing = there.residual @ self.motion + there.gap.ravel() @ (dilatation @ self.motion)
        return replace(
            self,
            u=there.at.u,
            pressure=there.at.pressure + there.gap,
            contact=there.contact,
            springs=springs,
            force=face.force(there.contact),
            stiffness=face.total(rate),
            penalty_error=face.penalty_error(there.contact, rate, springs),
            residual_error=float(missing),
            withheld=0.0,
            rate=rate,
            step=0.0,
            derivatives=None,
        )

    def since(self, here: "Equilibrium", face: ContactFace, ways: Sequence[Direction]) -> "Equilibrium":
        """This step with the traction's rate since the step `here`, the penalty error by that rate, and the derivatives of both by
        the directions `ways`."""
        step = self.depth - here.depth
        rate = (self.contact.traction - here.contact.traction) / step
        ahead = step / (step + here.step)  # the rate at the end of the step lies ahead of that of the step's middle
        secants = sensitivity.Secants(face, self.contact, self.springs, rate, here.rate, ahead)
        agree, derivatives = secants.agree(self.penalty_error), None
        if self.derivatives is not None and here.derivatives is not None:
            springs = tuple(self.springs.scaled(way.springs) for way in ways)
            derivatives = self.derivatives.since(here.derivatives, step, secants if agree else None, springs)
        course, withheld = (self.u - here.u) / step, secants.penalty_error if agree else 0.0
        return replace(self, course=course, rate=rate, step=step, withheld=withheld, derivatives=derivatives)


def equilibrium_of(
    there: Linearisation, solver: LinearSolver, exact: LinearSolver, deadline: Deadline, at_rest: bool = False
) -> Equilibrium:
    """The Equilibrium at a converged linearisation: one solve for the motion, one for each direction of the loading.

    Solves for the derivatives have a solver of their own: the path is the same, bit by bit, with and without them.

    Parameters
    ----------
    there : Linearisation
    solver, exact : LinearSolver
        For the motion, and for the derivatives.
    deadline : Deadline
    at_rest : bool
        Whether the linearisation is that of the untouched sample.

    Returns
    -------
    Equilibrium
    """
    increment, contact = there.increment, there.contact
    face, loading = increment.equations.face, increment.loading
    fresh = solver.refresh()
    by_depth = increment.equations.fixed.freed(face.by_depth(contact))
    # a low accuracy of the motion serves to predict a step; a requested stiffness needs full accuracy
    motion = solver.solve(there.tangent, -by_depth, sensitivity.ACCURACY if at_rest else None, deadline=deadline)
    rate = face.rate(contact, motion)
    penalty_error = face.penalty_error(contact, rate, loading.springs)
    derivatives = None
    if loading.directions and increment.changes:
        exact.borrow(solver if fresh else None)  # a stale factor reaches their accuracy slowly
        derivatives = sensitivity.path_derivatives(there, exact, deadline, motion if at_rest else None)
    return Equilibrium(
        depth=increment.depth,
        u=there.at.u,
        pressure=there.pressure,
        contact=contact,
        springs=loading.springs,
        force=face.force(contact),
        stiffness=face.total(rate),
        penalty_error=penalty_error,
        residual_error=float(there.residual @ motion),
        withheld=0.0,
        motion=motion,
        course=motion,
        rate=rate,
        derivatives=derivatives,
    )
