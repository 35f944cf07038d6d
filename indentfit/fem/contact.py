"""Contact with a rigid indenter: unilateral, Coulomb friction with elastic slip, integrated on the facets of the top.

The indenter is a signed distance g(x) (positive outside) that moves down by the indentation depth. At a point of the
footprint with gradient n = dg/dx, moved by x - c relative to the indenter,

    pressure   p = max(0, p0 - e g)                         (nominal, on the undeformed area)
    friction   T = (1 - n n) (T0 + e_t (x - c - anchor)),  |T| <= f p   (radial return)
    traction on the body  p n - T

p0 and T0 are the multipliers of an augmented Lagrangian that is advanced once with each step: they take over the last
step's p and T and their rates, while the anchor of a sticking point stays where the point began to stick. What the
springs e and e_t still give way is therefore a step's departure from the straight path, not the whole traction; its
effect on the force is reported with every result (`Contact.penalty_error`). The springs can so be soft enough for a short Newton
iteration: stiffer ones make points chatter between stick and slip.

The points are the facets' nodes (trapezoidal rule; Simpson's on quadratic facets): one point, one state, so no element is
asked to stick and slip at once.

Friction "stick" under a sharp edge ties the footprint to the indenter: a point that may let go while it carries friction has
no continuous law. Where the contact grows (sphere, rounded edge, beside the footprint) "stick" is a friction coefficient of STICK.

A sharp edge (edge_radius = 0) has no normal. There the material face of the initial footprint is the candidate: flat,
unilateral, free to slip. A rounded edge is a signed distance in the current configuration.

Two things keep a corner of the surface from folding up where the body itself would not:
- On a face of radius r a point under the pressure p that sticks has the stiffness e_t - p / r against rolling off: the normal turns
  away under it. Springs of e_t + GRIP p0 / r hold what real friction holds; softer ones let the whole edge buckle.
- Where a strip overhangs the sample, the sample's side rolls up against it (as in upsetting between rough plates), so the side
  below the strip is a candidate too.
"""

from dataclasses import dataclass, field

import numpy as np

from indentfit.indenters import UP, has_sharp_edge

NORMAL, TANGENTIAL = 3e2, 1e2  # springs e and e_t in units of shear modulus / thickness
STICK = 10.0
GRIP = 3.0  # tangential stiffness at a curved face, in units of pressure over radius: the pressure may grow in a step
RULE = {"q1p0": np.array([1 / 2, 0, 1 / 2]), "q2p1": np.array([1 / 6, 4 / 6, 1 / 6])}  # weights at the ends and in the middle


@dataclass(frozen=True)
class Springs:
    """Stiffnesses of the contact against penetration and slip, kPa/mm."""

    normal: float
    tangential: float

    def scaled(self, share):
        return Springs(self.normal * share, self.tangential * share)


@dataclass(frozen=True)
class History:
    """Multipliers p0 (n_f, n_q) and T0 (n_f, n_q, 3) in kPa and the anchors (n_f, n_q, 3) in mm, in the indenter's frame."""

    pressure: np.ndarray
    friction: np.ndarray
    anchor: np.ndarray


@dataclass(frozen=True)
class Touch:
    """The contact at one displacement: pressure (n_f, n_q) and friction (n_f, n_q, 3) in kPa, and what follows.

    place: positions in the indenter's frame, mm; normal, bend: gradient and Hessian of the gap; traction: of the body on the
    indenter, T - p n, kPa; D: its derivative (n_f, n_q, 3, 3) by the position; touching, slipping: (n_f, n_q) of bool;
    history: the one it started from; unilateral: (n_f, 1) of bool, False where a point is tied.
    """

    place: np.ndarray
    gap: np.ndarray
    normal: np.ndarray
    bend: np.ndarray | None = field(repr=False)
    pressure: np.ndarray
    friction: np.ndarray
    traction: np.ndarray
    touching: np.ndarray
    slipping: np.ndarray
    history: History = field(repr=False)
    unilateral: np.ndarray = field(repr=False)
    D: np.ndarray | None = field(repr=False)

    def advanced(self, rate=None, step=0.0):
        """History for a step of the depth in mm: multipliers extrapolated with the traction's rate (n_f, n_q, 3), kPa/mm.

        A point that slips, or does not touch, is anchored where it is now.
        """
        moved = (self.slipping | ~self.touching)[..., None]
        anchor = np.where(moved, self.place, self.history.anchor)
        if rate is None:
            return History(self.pressure, self.friction, anchor)
        along = np.einsum("fqi,fqi->fq", rate, self.normal)
        pressure = self.pressure - step * along
        friction = self.friction + step * (rate - along[..., None] * self.normal) * ~moved
        return History(np.where(self.unilateral, np.maximum(pressure, 0), pressure), friction, anchor)


@dataclass(frozen=True)
class Change:
    """How a touch changes with something: derivatives of its fields and, as a History, of the history that it started from."""

    place: np.ndarray
    normal: np.ndarray
    pressure: np.ndarray
    friction: np.ndarray
    traction: np.ndarray
    history: History = field(repr=False)

    def advanced(self, touch, rate, rate_change, step):
        """Derivative of `touch.advanced(rate, step)`, where the rate changes by rate_change (n_f, n_q, 3)."""
        moved = (touch.slipping | ~touch.touching)[..., None]
        anchor = np.where(moved, self.place, self.history.anchor)
        n, dn = touch.normal, self.normal
        along, change = _dot(rate, n), _dot(rate_change, n) + _dot(rate, dn)
        pressure = (self.pressure - step * change) * (~touch.unilateral | (touch.pressure - step * along > 0))
        turned = rate_change - change[..., None] * n - along[..., None] * dn
        return History(pressure, self.friction + step * turned * ~moved, anchor)


class Contact:
    """The facets of a quarter sample that may touch one indenter: the footprint, then the side that it overhangs.

    solid: fem.element.Solid; indenter: the case's table; friction: number or "stick"; thickness in mm.
    X: contact points (n_f, n_q, 3), mm, and dofs (n_f, n_q, 3) of the nodes they are; weights: their areas (n_f, n_q), mm^2;
    surface: dofs (n_s,) that the contact acts on, rising; under: (n_f,) of bool, the footprint.
    """

    def __init__(self, solid, indenter, thickness):
        parts = [solid.mesh.boundaries[name] for name in ("footprint", "overhung")]
        facets, self.under = np.concatenate(parts), np.arange(sum(map(len, parts))) < len(parts[0])
        elements, nodes, areas = _nodes(solid, facets)
        self.thickness, self.shape = thickness, indenter.geometry
        sticks = indenter.friction == "stick"
        self.tied = self.under[:, None] & (has_sharp_edge(self.shape) and sticks)
        self.friction = STICK if sticks else float(indenter.friction)
        self.curvature = self.shape.curvature
        self.dofs, self.n_dofs = solid.dofs[elements, nodes], solid.n_dofs
        self.X = np.ascontiguousarray(np.moveaxis(solid.basis.doflocs[:, self.dofs[..., 0]], 0, -1))
        counts = self.under[:, None] | (self.X[..., 1] < thickness * (1 - 1e-9))  # the top's nodes belong to the footprint alone
        self.weights = np.ascontiguousarray(areas * counts)
        self.surface, places = np.unique(self.dofs, return_inverse=True)
        self._places = places.reshape(self.dofs.shape)
        block = 3 * solid.positions[elements, nodes, nodes]
        self._entries = (solid.indptr[self.dofs] + block[..., None])[..., None] + np.arange(3)

    def rest(self):
        """History of the untouched sample."""
        return History(np.zeros(self.weights.shape), np.zeros_like(self.X), self.X)

    def no_change(self):
        """Derivative of the untouched sample's history, which depends on nothing."""
        return History(np.zeros(self.weights.shape), np.zeros_like(self.X), np.zeros_like(self.X))

    def field(self, u):
        """Displacements (n_f, n_q, 3) at the contact points."""
        return u[self.dofs]

    def touch(self, u, depth, history, springs, derivative=True):
        """Contact at displacements u (n,) and a depth in mm, after a history, with Springs."""
        place = self.X + self.field(u) + depth * UP
        gap, n, H = self.shape.distance(place, self.thickness)
        p = history.pressure - springs.normal * gap
        touching = (p >= 0) | self.tied
        p = np.where(touching, p, 0.0)
        pull = self._pull(place, history, springs, touching)
        trial = pull - np.einsum("fqi,fqi->fq", pull, n)[..., None] * n
        size = np.sqrt(np.einsum("fqi,fqi->fq", trial, trial))
        limit = np.where(self.tied, np.inf, self.friction * p)
        slipping = touching & (size > limit)
        size = np.where(size > 0, size, 1.0)
        T = np.where(slipping, limit / size, 1.0)[..., None] * trial if slipping.any() else trial
        grip = self._grip(springs, history.pressure)
        D = self._derivative(springs.normal, grip, n, H, p, pull, trial, size, slipping, touching) if derivative else None
        return Touch(place, gap, n, H, p, T, T - p[..., None] * n, touching, slipping, history, ~self.tied, D)

    def _grip(self, springs, pressure):
        """Stiffness (n_f, n_q) against slip, kPa/mm, at a history's pressure; linear in both."""
        return springs.tangential + GRIP * self.curvature * pressure

    def _pull(self, place, history, springs, touching):
        """Friction (n_f, n_q, 3) that sticking would need."""
        if self.friction == 0:
            return np.zeros_like(place)
        grip = self._grip(springs, history.pressure)[..., None]
        return (history.friction + grip * (place - history.anchor)) * touching[..., None]

    def _derivative(self, normal, grip, n, H, p, pull, trial, size, slipping, touching):
        """D = d(T - p n)/dx, consistent with the radial return."""
        nn = n[..., :, None] * n[..., None, :]
        D = touching[..., None, None] * normal * nn
        if H is not None:
            D = D - p[..., None, None] * H
        if self.friction == 0:
            return D
        stick = grip[..., None, None] * (np.eye(3) - nn)
        if H is not None:
            pn = np.einsum("fqi,fqi->fq", pull, n)
            stick = stick - pn[..., None, None] * H - n[..., :, None] * np.einsum("fqi,fqij->fqj", pull, H)[..., None, :]
        if slipping.any():
            f, m = self.friction, trial / size[..., None]
            turn = stick - m[..., :, None] * np.einsum("fqi,fqij->fqj", m, stick)[..., None, :]
            slip = (f * p / size)[..., None, None] * turn - f * normal * m[..., :, None] * n[..., None, :]
            stick = np.where(slipping[..., None, None], slip, stick)
        return D + touching[..., None, None] * stick

    def change(self, touch, springs, spring_change, friction_change, history, place):
        """Change of a touch: derivatives by something that changes springs and friction, the history (a History) and the
        places (n_f, n_q, 3) so; contact states stay."""
        n, H, touching = touch.normal, touch.bend, touch.touching
        dn = np.zeros_like(place) if H is None else np.einsum("fqij,fqj->fqi", H, place)
        p = history.pressure - spring_change.normal * touch.gap - springs.normal * _dot(n, place)
        p = np.where(touching, p, 0.0)
        if self.friction == 0:
            T = np.zeros_like(place)
        else:
            pull = self._pull(touch.place, touch.history, springs, touching)
            grip, grip_change = self._grip(springs, touch.history.pressure), self._grip(spring_change, history.pressure)
            dpull = history.friction + grip_change[..., None] * (touch.place - touch.history.anchor)
            dpull = (dpull + grip[..., None] * (place - history.anchor)) * touching[..., None]
            along = _dot(pull, n)[..., None]
            T = dpull - (_dot(dpull, n) + _dot(pull, dn))[..., None] * n - along * dn
            if touch.slipping.any():
                trial = pull - along * n
                size = np.sqrt(_dot(trial, trial))[..., None]
                m = trial / np.where(size > 0, size, 1.0)
                turn = (T - m * _dot(m, T)[..., None]) / np.where(size > 0, size, 1.0)
                limit = friction_change * touch.pressure + self.friction * p
                slip = limit[..., None] * m + (self.friction * touch.pressure)[..., None] * turn
                T = np.where(touch.slipping[..., None], slip, T)
        traction = T - p[..., None] * n - touch.pressure[..., None] * dn
        return Change(place, dn, p, T, traction, history)

    def stiffness_change(self, touch, spring_change):
        """Derivative of the D of an untouched sample, whose pressures and friction are zero."""
        n = touch.normal
        nn = n[..., :, None] * n[..., None, :]
        tangential = spring_change.tangential if self.friction else 0.0
        return touch.touching[..., None, None] * (spring_change.normal * nn + tangential * (np.eye(3) - nn))

    def residual(self, touch):
        """Nodal forces (n,) of the contact in the residual, mN."""
        return self.spread(touch.traction)

    def spread(self, traction):
        """Nodal forces (n,) of tractions (n_f, n_q, 3)."""
        out = np.zeros(self.n_dofs)
        np.add.at(out, self.dofs, self.weights[..., None] * traction)
        return out

    def add_tangent(self, touch, values):
        """Adds the contact's tangent to the CSR data of the solid's; returns it as a dense matrix on the dofs `surface`, mN/mm."""
        blocks = self.weights[..., None, None] * touch.D
        dense = np.zeros((self.surface.size,) * 2)
        np.add.at(values, self._entries, blocks)
        np.add.at(dense, (self._places[..., :, None], self._places[..., None, :]), blocks)
        return dense

    def by_depth(self, touch):
        """Derivative (n,) of the contact's residual by the depth at fixed displacements, mN/mm."""
        return self.spread(touch.D @ UP)

    def force(self, touch):
        """Force on the indenter that the quarter carries, mN, positive when pressing."""
        return self.total(touch.traction)

    def total(self, traction):
        """Upward force of tractions (n_f, n_q, 3) on the indenter, mN."""
        return float(np.sum(self.weights * traction[..., 1]))

    def rate(self, touch, v):
        """Change (n_f, n_q, 3) of the traction on the indenter with the depth, kPa/mm; v (n,): du/d(depth)."""
        return np.einsum("fqij,fqj->fqi", touch.D, self.field(v) + UP)

    def penalty_error(self, touch, rate, springs):
        """Force of the quarter that the springs' give withholds, mN, to first order.

        By reciprocity a motion r imposed on the contact changes the force by the integral of r . dt/d(depth).
        """
        give = (touch.pressure - touch.history.pressure) / springs.normal
        grip = self._grip(springs, touch.history.pressure)[..., None]
        slip = (touch.friction - touch.history.friction) / grip * ~touch.slipping[..., None]
        r = (slip - give[..., None] * touch.normal) * touch.touching[..., None]
        return float(np.sum(self.weights[..., None] * r * rate))


def _dot(a, b):
    return np.einsum("fqi,fqi->fq", a, b)


def _nodes(solid, facets):
    """Elements (n_f, 1) of facets, the numbers (n_f, n_q) that their nodes have there, and the nodes' shares of the area, mm^2."""
    mesh, places = solid.mesh, solid.basis.elem.elem.doflocs  # (n_n, 3) of the reference element
    elements = mesh.f2t[0, facets]
    sides = [(axis, np.flatnonzero(places[:, axis] == at)) for axis in range(3) for at in (0, 1)]
    nodes, areas = (np.empty((len(facets), len(sides[0][1])), dtype=kind) for kind in (int, float))
    corners = np.sort(mesh.facets[:, facets], axis=0)
    for axis, on in sides:
        vertices = on[on < mesh.t.shape[0]]
        here = np.all(np.sort(mesh.t[vertices][:, elements], axis=0) == corners, axis=0)
        DF = solid.basis.mapping.DF(places[on].T, tind=elements[here])  # (3, 3, n_f, n_q)
        a, b = (np.moveaxis(DF[:, other], 0, -1) for other in range(3) if other != axis)
        share = np.prod([RULE[solid.element][(2 * places[on, other]).astype(int)] for other in range(3) if other != axis], axis=0)
        nodes[here], areas[here] = on, np.linalg.norm(np.cross(a, b), axis=-1) * share
    return elements[:, None], nodes, areas
