"""A point of the path: an equilibrium, with the direction in which the path leaves it."""

from dataclasses import dataclass, field, replace

from indentfit.arrays import Array
from indentfit.fem import sensitivity
from indentfit.fem.contact_state import ContactState
from indentfit.fem.deadline import Deadline
from indentfit.fem.equations import Iterate, Linearisation
from indentfit.fem.linear.solver import LinearSolver


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
    force : float, mN
    stiffness : float, mN/mm
        dF/dd.
    penalty_error : float, mN
        Force that is missing because of the contact springs' deflection.
    residual_error : float, mN
        Force that corresponds to the remaining residual.
    motion : array (n,), mm/mm
        du/dd.
    rate : array (n_f, n_q, 3), kPa/mm
        Rate of the contact's traction since the last step (at rest: its tangent), which the next step's multipliers follow.
    derivatives : PathDerivatives
        Derivatives by the loading's directions; None where the steps left the path that can be differentiated.
    """

    depth: float
    u: Array
    pressure: Array
    contact: ContactState
    force: float
    stiffness: float
    penalty_error: float
    residual_error: float
    motion: Array = field(repr=False)
    rate: Array = field(repr=False)
    derivatives: sensitivity.PathDerivatives | None = field(default=None, repr=False)

    @property
    def at(self) -> Iterate:
        """Displacements and pressure modes."""
        return Iterate(self.u, self.pressure)

    def since(self, here: "Equilibrium") -> "Equilibrium":
        """This step with the traction's rate, and its changes, since the step `here`."""
        step = self.depth - here.depth
        rate = (self.contact.traction - here.contact.traction) / step
        if self.derivatives is None or here.derivatives is None:
            return replace(self, rate=rate, derivatives=None)
        return replace(self, rate=rate, derivatives=self.derivatives.since(here.derivatives, step))


def equilibrium_of(there: Linearisation, solver: LinearSolver, deadline: Deadline, at_rest: bool = False) -> Equilibrium:
    """The Equilibrium at a converged linearisation: one solve for the motion, one for each direction of the loading.

    Parameters
    ----------
    there : Linearisation
    solver : LinearSolver
    deadline : Deadline
    at_rest : bool
        Whether the linearisation is that of the untouched sample.

    Returns
    -------
    Equilibrium
    """
    increment, contact = there.increment, there.contact
    face, loading = increment.equations.face, increment.loading
    by_depth = increment.equations.fixed.freed(face.by_depth(contact))
    differentiated = bool(loading.directions and increment.changes)
    if differentiated:
        solver.forget()  # many solves with this tangent, to an accuracy that a stale factor reaches slowly
    # a low accuracy of the motion serves to predict a step; a requested stiffness and derivatives of the path need full accuracy
    accuracy = sensitivity.ACCURACY if at_rest or differentiated else None
    motion = solver.solve(there.tangent, -by_depth, accuracy, deadline=deadline)
    rate = face.rate(contact, motion)
    return Equilibrium(
        depth=increment.depth,
        u=there.at.u,
        pressure=there.pressure,
        contact=contact,
        force=face.force(contact),
        stiffness=face.total(rate),
        penalty_error=face.penalty_error(contact, rate, loading.springs),
        residual_error=float(there.residual @ motion),
        motion=motion,
        rate=rate,
        derivatives=sensitivity.path_derivatives(there, solver, deadline, motion if at_rest else None) if differentiated else None,
    )
