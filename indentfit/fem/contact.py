"""Contact with a rigid indenter: unilateral, Coulomb friction with elastic slip, integrated on the facets of the top.

The indenter is a signed distance g(x) (positive outside) that moves down by the indentation depth. At a point of the
footprint with gradient n = dg/dx, moved by x - c relative to the indenter,

    pressure   p = max(0, p0 - e g)                         (nominal, on the undeformed area)
    friction   T = (1 - n n) (T0 + e_t (x - c - anchor)),  |T| <= f p   (radial return)
    traction on the body  p n - T

A point sticks while the force of its tangential spring stays within the limit f p, and slips where the limit is reached.

p0 and T0 are the multipliers of an augmented Lagrangian that is advanced once with each step: they take over the last
step's p and T and their rates, while the anchor of a sticking point stays where the point began to stick. The springs e and e_t
therefore carry only a step's departure from the straight path, not the whole traction. Their deflection lowers the force a little:
this is the *penalty error*, which every result reports and every force has added back (`ContactFace.penalty_error`). So the springs
can be soft enough for few Newton iterations: under stiffer springs points *chatter*, that is, they change between stick and slip,
or between touch and gap, from one iteration to the next.

`contact_points` says where the points lie.

Friction "stick" under a sharp edge ties the footprint to the indenter, because the law of a point that loses contact while it
carries friction is not continuous. Where the contact grows (sphere, rounded edge, beside the footprint) "stick" is a friction
coefficient of STICK, and of STICK_IN_PLANE in the meridian plane. There are two or more equilibria under a large coefficient: a
point at the contact's end, where the pressure is small, pulls the surface along with many times that pressure, or lets go. In the
plane, where such points lie close, short steps then chatter or end in a retry (forces up to 1.2 % off). The hold that a sphere, a
cone and a rounded punch need is smaller: at STICK_IN_PLANE their forces are within 0.05 % of those at 10 where these are found.

A sharp edge (edge_radius = 0) has no normal. There the material face of the initial footprint is the candidate for contact: flat,
unilateral, free to slip. A rounded edge is a signed distance in the current configuration.

Where the footprint is tied and the punch sinks in, the surface beside its sharp edge folds up against the punch's side. In the
meridian plane, not on bricks, this surface is a candidate for contact with that upright wall, which is smooth. Without the wall the
surface would pass into the punch, and the sample would have several equilibria there, whose forces differ by 2 to 3 %.

The surface beside a rounded edge comes to lie against the wall above it, too, from a depth of about six edge radii on. It is a
candidate in the meridian plane, and on bricks under a round punch that is pressed deeper than `mesh.WALL` edge radii. Without it
forces in the plane were up to 3 % off at a depth of 15 edge radii and 12 % at thirty, where bricks were not solved. Strips have no
wall: without it no node passes into them by more than 0.05 % of the depth, forces under a strip longer than the sample are the same
(0.02 %), and one that ends on the sample took five times as long with it and had no second mesh. The error of the friction at the
wall of bricks, which drags new contact (`ContactFace.ahead`), was not measured.

Springs have to be stiff enough for the pressure p, too (`ContactFace.firm`). In a wave of the surface along the face, of wave
number k, the pressure pushes the crests into the springs: it gains p k for each unit of sliding and of sinking in, against the
energies of the springs, e, and of the body, about mu k. So waves grow where p^2 k > 4 e mu, first those of the mesh, whose k is pi
over the distance of the nodes: under soft springs a deep sphere fails on every mesh, and sooner on a finer one.

Two measures keep a corner of the surface from folding up where the body itself would not:
- On a face of radius r a point that sticks under the pressure p has the stiffness e_t - p / r against rolling off: the normal turns
  away under the point. Springs of e_t + GRIP p0 / r hold what real friction holds; under softer springs the whole edge buckles.
- Where a strip overhangs the sample, the sample's side turns up and comes to lie against the strip (*side roll-up*, as in upsetting
  between rough plates): the side below the strip is a candidate for contact too.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from indentfit.arrays import Array, Bools
from indentfit.case import Indenter
from indentfit.fem.contact_points import ContactPoints, EdgePoints
from indentfit.fem.contact_state import ContactChange, ContactState, History, Springs, dot
from indentfit.indenters import UP, Distance, Rings, from_upright_punch, has_sharp_edge

NORMAL, TANGENTIAL = 3e2, 1e2  # springs e and e_t in units of shear modulus / thickness
STICK, STICK_IN_PLANE = 10.0, 1.5
FIRM = np.pi  # least spring e, in units of p^2 over the shear modulus and the distance of the nodes: four times what waves need
OF_WALL = 1e-3  # springs at the wall above a sharp edge that sticks, of those that tie its face
GRIP = 3.0  # tangential stiffness at a curved face, in units of pressure over radius: the pressure may grow in a step


@dataclass(frozen=True)
class _Trial:
    """The start of the radial return: distances, pressures, and the friction with which every touching point would stick.

    pull (n_f, n_q, 3), kPa: this friction before its projection on the face; along: `pull` projected on the face; size (n_f, n_q):
    length of `along`, 1 where it is zero; grip (n_f, n_q), kPa/mm: stiffness against slip.
    """

    distance: Distance
    pressure: Array
    pull: Array
    along: Array
    size: Array
    grip: Array
    touching: Bools
    slipping: Bools


class ContactFace:
    """The points of a body that may touch one indenter: the footprint, the surface beside it, the side that the indenter
    overhangs.

    Parameters
    ----------
    points : ContactPoints
        Where the contact is integrated.
    indenter : Indenter
        The table of a case.
    thickness : float, mm

    Attributes
    ----------
    X : array (n_f, n_q, 3), mm
        Contact points.
    weights : array (n_f, n_q), mm^2
        Areas of the points.
    surface : array (n_s,)
        Dofs that the contact acts on, in rising order.
    under : array (n_f,) of bool
        Whether a facet belongs to the footprint.
    tied : array (n_f, 1) of bool
        Whether the points of a facet are tied to the indenter.
    shape : IndenterShape
    ahead : bool
        Whether a point that comes to touch within a step is anchored where it touches, not where the step began. Not on bricks
        under a flat end: there the face's contact hardly grows, and the few nodes of a side that comes to touch a bar snap with
        such anchors where fibres are stiff. So a point that comes to touch a rounded edge or the wall above it on bricks has
        friction against its motion before it touched, too, for one step; the error was not measured.
    friction : float
        Coefficient of friction.
    winds : bool
        Whether the body winds round a sharp edge, in the meridian plane, as the footprint is tied: it changes shape so much there
        that its last factor leads nowhere (`contact_first`).
    """

    def __init__(self, points: ContactPoints, indenter: Indenter, thickness: float) -> None:
        self.points, self.X, self.weights, self.under, self.surface = points, points.X, points.weights, points.under, points.surface
        self.thickness, self.shape = thickness, indenter.geometry
        self.ahead = isinstance(points, EdgePoints) or self.shape.end != "flat"
        sticks = indenter.friction == "stick"
        self.tied = self.under[:, None] & (has_sharp_edge(self.shape) and sticks)
        self.winds = bool(self.tied.any()) and isinstance(points, EdgePoints)
        upright = has_sharp_edge(self.shape) and isinstance(self.shape.partition(thickness), Rings)
        self._wall = ~self.under[:, None] & upright
        self._share = np.where(self._wall, OF_WALL if sticks else 1.0, 1.0)
        stick = STICK_IN_PLANE if isinstance(points, EdgePoints) else STICK
        self.friction = stick if sticks else float(indenter.friction)
        self.curvature = self.shape.curvature

    def rest(self) -> History:
        """History of the untouched sample."""
        return History(np.zeros(self.weights.shape), np.zeros_like(self.X), self.X, self.X)

    def no_change(self) -> History:
        """Derivative of the untouched sample's history: zero."""
        return History(np.zeros(self.weights.shape), *3 * [np.zeros_like(self.X)])

    def firm(self, springs: Springs, state: ContactState, shear_modulus: float) -> Springs:
        """Springs for the pressures of a state: `springs`, or where these are too soft, as many times doubled as it takes.

        Because a spring is doubled as a whole, it does not change with the pressures from one run to a neighbouring one, and
        derivatives need not follow the pressures.
        """
        if self.tied.all():
            return springs
        weights = self.weights * ~self.tied
        squared = np.sum(weights * state.pressure**2, axis=1) / np.maximum(np.sum(weights, axis=1), 1e-300)
        share = FIRM * np.max(squared / (self.points.spacing * self._share[:, 0])) / (shear_modulus * springs.normal)
        return Springs(springs.normal * 2.0 ** np.ceil(np.log2(share)), springs.tangential) if share > 1 else springs

    def field(self, u: Array) -> Array:
        """Displacements (n_f, n_q, 3), mm, at the contact points, from the displacements u (n,) of all nodes."""
        return self.points.field(u)

    def touch(self, u: Array, depth: float, history: History, springs: Springs) -> ContactState:
        """The contact at displacements u (n,) and a depth, both in mm, after a history."""
        place = self.X + self.field(u) + depth * UP
        trial = self._trial(place, history, springs)
        T, n, p = trial.along, trial.distance.normal, trial.pressure
        if trial.slipping.any():
            limit = self._limit(p)
            T = np.where(trial.slipping, limit / trial.size, 1.0)[..., None] * T
        return ContactState(
            place=place,
            gap=trial.distance.gap,
            normal=n,
            bend=trial.distance.bend,
            pressure=p,
            friction=T,
            traction=T - p[..., None] * n,
            touching=trial.touching,
            slipping=trial.slipping,
            history=history,
            unilateral=~self.tied,
            derivative=functools.partial(self._derivative, trial, self._normal(springs)),
        )

    def _trial(self, place: Array, history: History, springs: Springs) -> _Trial:
        """The trial state at places (n_f, n_q, 3), in which every touching point sticks."""
        distance = self._distance(place)
        n, p = distance.normal, history.pressure - self._normal(springs) * distance.gap
        touching = (p >= 0) | self.tied
        p = np.where(touching, p, 0.0)
        pull = self._pull(place, history, springs, touching)
        along = pull - dot(pull, n)[..., None] * n
        size = np.sqrt(dot(along, along))
        slipping = touching & (size > self._limit(p))
        size = np.where(size > 0, size, 1.0)
        return _Trial(distance, p, pull, along, size, self._grip(springs, history.pressure), touching, slipping)

    def _distance(self, place: Array) -> Distance:
        """Distances of places (n_f, n_q, 3): those of the footprint from the face, of the surface beside it from the wall."""
        face = self.shape.distance(place, self.thickness)
        if not self._wall.any():
            return face
        wall = from_upright_punch(self.shape.half_width, place, self.thickness)
        assert wall.bend is not None  # it is curved
        bend = np.where(self._wall[..., None, None], wall.bend, 0.0 if face.bend is None else face.bend)
        return Distance(np.where(self._wall, wall.gap, face.gap), np.where(self._wall[..., None], wall.normal, face.normal), bend)

    @property
    def _coefficient(self) -> Array:
        """Coefficients of friction (n_f, 1)."""
        return np.where(self._wall, 0.0, self.friction)

    def _normal(self, springs: Springs) -> Array:
        """Stiffness (n_f, 1) against penetration, kPa/mm."""
        return springs.normal * self._share

    def _limit(self, pressure: Array) -> Array:
        """Largest friction (n_f, n_q), kPa, under a pressure."""
        return np.where(self.tied, np.inf, self._coefficient * pressure)

    def _grip(self, springs: Springs, pressure: Array) -> Array:
        """Stiffness (n_f, n_q) against slip, kPa/mm, at a history's pressure; linear in both."""
        return springs.tangential * self._share + GRIP * self.curvature * pressure

    def _pull(self, place: Array, history: History, springs: Springs, touching: Bools) -> Array:
        """Friction (n_f, n_q, 3) that sticking would need."""
        if self.friction == 0:
            return np.zeros_like(place)
        grip = self._grip(springs, history.pressure)[..., None]
        return (history.friction + grip * (place - history.anchor)) * touching[..., None]

    def _derivative(self, trial: _Trial, normal: Array) -> Array:
        """D = d(T - p n)/dx, consistent with the radial return; normal: the springs (n_f, 1), kPa/mm."""
        n, H, p = trial.distance.normal, trial.distance.bend, trial.pressure
        nn = n[..., :, None] * n[..., None, :]
        D = (trial.touching * normal)[..., None, None] * nn
        if H is not None:
            D = D - p[..., None, None] * H
        if self.friction == 0:
            return D
        stick = trial.grip[..., None, None] * (np.eye(3) - nn)
        if H is not None:
            pn = dot(trial.pull, n)
            stick = stick - pn[..., None, None] * H - n[..., :, None] * np.einsum("fqi,fqij->fqj", trial.pull, H)[..., None, :]
        if trial.slipping.any():
            f, m = self._coefficient[..., None, None], trial.along / trial.size[..., None]
            turn = stick - m[..., :, None] * np.einsum("fqi,fqij->fqj", m, stick)[..., None, :]
            slip = f * ((p / trial.size)[..., None, None] * turn - normal[..., None, None] * m[..., :, None] * n[..., None, :])
            stick = np.where(trial.slipping[..., None, None], slip, stick)
        return D + trial.touching[..., None, None] * stick

    def change(
        self, state: ContactState, springs: Springs, spring_change: Springs, friction_change: float, history: History, place: Array
    ) -> ContactChange:
        """Derivative of a state by a quantity that changes springs, friction, history and places, while every point goes on to
        touch or not, and to slip or not.

        Parameters
        ----------
        state : ContactState
        springs : Springs
            The springs of the state.
        spring_change : Springs
        friction_change : float
            Derivative of the coefficient of friction.
        history : History
            Derivative of the state's history.
        place : array (n_f, n_q, 3)
            Derivative of the state's places.

        Returns
        -------
        ContactChange
        """
        n, H = state.normal, state.bend
        dn = np.zeros_like(place) if H is None else np.einsum("fqij,fqj->fqi", H, place)
        p = history.pressure - self._normal(spring_change) * state.gap - self._normal(springs) * dot(n, place)
        p = np.where(state.touching, p, 0.0)
        if self.friction == 0:
            T = np.zeros_like(place)
        else:
            pull = self._pull(state.place, state.history, springs, state.touching)
            dpull = self._pull_change(state, springs, spring_change, history, place)
            along = dot(pull, n)[..., None]
            T = dpull - (dot(dpull, n) + dot(pull, dn))[..., None] * n - along * dn
            if state.slipping.any():
                limit = friction_change * state.pressure * ~self._wall + self._coefficient * p
                T = np.where(state.slipping[..., None], self._slip_change(state, pull - along * n, T, limit), T)
        traction = T - p[..., None] * n - state.pressure[..., None] * dn
        return ContactChange(place, dn, p, T, traction, history)

    def _pull_change(self, state: ContactState, springs: Springs, spring_change: Springs, history: History, place: Array) -> Array:
        """Derivative of `_pull` at a state; `change` describes the arguments."""
        grip, grip_change = self._grip(springs, state.history.pressure), self._grip(spring_change, history.pressure)
        change = history.friction + grip_change[..., None] * (state.place - state.history.anchor)
        return (change + grip[..., None] * (place - history.anchor)) * state.touching[..., None]

    def _slip_change(self, state: ContactState, trial: Array, trial_change: Array, limit_change: Array) -> Array:
        """Derivative of the friction of slipping points, from the changes of their trial friction and of their limit."""
        size = np.sqrt(dot(trial, trial))[..., None]
        m = trial / np.where(size > 0, size, 1.0)
        turn = (trial_change - m * dot(m, trial_change)[..., None]) / np.where(size > 0, size, 1.0)
        return limit_change[..., None] * m + (self._coefficient * state.pressure)[..., None] * turn

    def stiffness_change(self, state: ContactState, spring_change: Springs) -> Array:
        """Derivative (n_f, n_q, 3, 3) of the D of an untouched sample, whose pressures and friction are zero."""
        n = state.normal
        nn = n[..., :, None] * n[..., None, :]
        normal = (self._normal(spring_change) * state.touching)[..., None, None]
        tangential = (spring_change.tangential * self._share * state.touching)[..., None, None] if self.friction else 0.0
        return np.asarray(normal * nn + tangential * (np.eye(3) - nn))

    def residual(self, state: ContactState) -> Array:
        """Nodal forces (n,) of the contact in the residual, mN."""
        return self.spread(state.traction)

    def spread(self, traction: Array) -> Array:
        """Nodal forces (n,), mN, of tractions (n_f, n_q, 3), kPa."""
        return self.points.spread(traction)

    def add_tangent(self, state: ContactState, values: Array | None = None) -> Array:
        """Add the contact's tangent to the CSR values (nnz,) of the body's tangent, where they are given.

        Returns
        -------
        array (n_s, n_s), mN/mm
            The contact's tangent as a dense matrix on the dofs `surface`.
        """
        return self.points.add_stiffness(state.stiffness, values)

    def by_depth(self, state: ContactState) -> Array:
        """Derivative (n,) of the contact's residual by the depth at fixed displacements, mN/mm."""
        return self.spread(state.stiffness @ UP)

    def force(self, state: ContactState) -> float:
        """Force on the indenter that the quarter carries, mN, positive when pressing."""
        return self.total(state.traction)

    def total(self, traction: Array) -> float:
        """Upward force of tractions (n_f, n_q, 3), kPa, on the indenter, mN."""
        return float(np.sum(self.weights * traction[..., 1]))

    def rate(self, state: ContactState, v: Array) -> Array:
        """Change (n_f, n_q, 3) of the traction on the indenter with the depth, kPa/mm; v (n,): du/d(depth)."""
        return np.einsum("fqij,fqj->fqi", state.stiffness, self.field(v) + UP)

    def penalty_error(self, state: ContactState, rate: Array, springs: Springs) -> float:
        """Penalty error: the force of the quarter, mN, that is missing because of the springs' deflection, to first order.

        By reciprocity a motion r imposed on the contact changes the force by the integral of r . dt/d(depth).
        """
        return float(np.sum(self.weights[..., None] * self._deflection(state, springs) * rate))

    def penalty_error_change(
        self, state: ContactState, rate: Array, springs: Springs, change: ContactChange, rate_change: Array, spring_change: Springs
    ) -> float:
        """Derivative of `penalty_error(state, rate, springs)`, from those of its arguments."""
        r, dr = self._deflection(state, springs), self._deflection_change(state, springs, change, spring_change)
        return float(np.sum(self.weights[..., None] * (dr * rate + r * rate_change)))

    def _deflection(self, state: ContactState, springs: Springs) -> Array:
        """Deflection (n_f, n_q, 3), mm, of the springs."""
        give, slip = self._give_and_slip(state, springs)
        return (slip - give[..., None] * state.normal) * state.touching[..., None]

    def _deflection_change(self, state: ContactState, springs: Springs, change: ContactChange, spring_change: Springs) -> Array:
        """Derivative of `_deflection`."""
        give, slip = self._give_and_slip(state, springs)
        dgive = (change.pressure - change.history.pressure - give * self._normal(spring_change)) / self._normal(springs)
        grip, dgrip = self._grip(springs, state.history.pressure), self._grip(spring_change, change.history.pressure)
        dslip = (change.friction - change.history.friction) * ~state.slipping[..., None] - slip * dgrip[..., None]
        moved = dslip / grip[..., None] - dgive[..., None] * state.normal - give[..., None] * change.normal
        return moved * state.touching[..., None]

    def _give_and_slip(self, state: ContactState, springs: Springs) -> tuple[Array, Array]:
        """Deflections of the springs against penetration (n_f, n_q) and against slip (n_f, n_q, 3), mm."""
        give = (state.pressure - state.history.pressure) / self._normal(springs)
        grip = self._grip(springs, state.history.pressure)[..., None]
        return give, (state.friction - state.history.friction) / grip * ~state.slipping[..., None]
