"""Contact with a rigid indenter: unilateral, Coulomb friction with elastic slip, integrated on the facets of the top.

The indenter is a signed distance g(x) (positive outside) that moves down by the indentation depth. At a point of the
footprint with gradient n = dg/dx and penetration -g > 0,

    pressure   p = e (-g)                                        (nominal, on the undeformed area)
    friction   T = T_old + e (1 - n n) (dx - dc), |T| <= f p      (radial return; dx, dc: this step's motion of body, indenter)
    traction on the body  p n - T

with one penalty e for both. The penalty is made harmless by being large (see PENALTY) and its error is reported with every
result: for small 1/e the energy of the contact springs is the energy that is missing in the body, so its derivative by the
depth is the force that is missing (`Touch.energy`).

A sharp edge (edge_radius = 0) has no normal. There the material face of the initial footprint is the only candidate: flat,
unilateral, free to slip. A rounded edge is a signed distance in the current configuration.
"""

from dataclasses import dataclass, field

import numba
import numpy as np
from skfem import FacetBasis

PENALTY = 1e5  # e = PENALTY * shear modulus / thickness
_DOWN, _UP = np.array([0.0, -1.0, 0.0]), np.array([0.0, 1.0, 0.0])


@dataclass(frozen=True)
class History:
    """What friction remembers of the last equilibrium: positions x (n_f, n_q, 3) mm, friction T (n_f, n_q, 3) kPa, depth mm."""

    x: np.ndarray
    friction: np.ndarray
    depth: float


@dataclass(frozen=True)
class Touch:
    """The contact at one displacement: pressure (n_f, n_q) and friction (n_f, n_q, 3) in kPa, and what follows.

    D: derivative (n_f, n_q, 3, 3) of the traction by the position; slipping, touching: (n_f, n_q) of bool;
    x: current positions, mm; traction: of the indenter on the body reversed, -(p n - T).
    """

    x: np.ndarray
    depth: float
    gap: np.ndarray
    normal: np.ndarray
    pressure: np.ndarray
    friction: np.ndarray
    traction: np.ndarray
    slipping: np.ndarray
    D: np.ndarray | None = field(repr=False)

    @property
    def touching(self):
        return self.pressure > 0

    @property
    def history(self):
        return History(self.x, self.friction, self.depth)


class Contact:
    """The facets of a quarter sample that may touch one indenter.

    solid: fem.element.Solid; indenter: the case's table; friction: number or "stick"; thickness in mm.
    """

    def __init__(self, solid, indenter, thickness):
        order = 5 if solid.element == "q1p0" else 7
        facets = solid.mesh.boundaries["footprint"]
        basis = FacetBasis(solid.mesh, type(solid.basis.elem.elem)(), facets=facets, intorder=order)
        self.thickness, self.indenter = thickness, indenter
        self.friction = np.inf if indenter.friction == "stick" else float(indenter.friction)
        shape = np.array([basis.basis[i][0].value for i in range(basis.Nbfun)])  # (n_n, n_f, n_q)
        self.shape = np.ascontiguousarray(np.broadcast_to(shape, (basis.Nbfun, *basis.dx.shape)).transpose(1, 2, 0))
        self.weights = np.ascontiguousarray(basis.dx)
        self.X = np.ascontiguousarray(np.moveaxis(np.asarray(basis.global_coordinates()), 0, -1))
        self.owners = np.ascontiguousarray(basis.tind.astype(np.int32))
        self.dofs = solid.dofs[self.owners]
        self.positions = solid.positions[self.owners]
        self.indptr, self.n_dofs = solid.indptr, solid.n_dofs

    def rest(self):
        """History of the untouched sample."""
        return History(self.X, np.zeros_like(self.X), 0.0)

    def field(self, u):
        """Displacements (n_f, n_q, 3) at the contact points."""
        return np.einsum("fqn,fni->fqi", self.shape, u[self.dofs])

    def touch(self, u, depth, history, penalty, derivative=True):
        """Contact at displacements u (n,) and a depth in mm, after a history; penalty in kPa/mm."""
        x = self.X + self.field(u)
        gap, n, H = signed_distance(self.indenter, x, self.thickness - depth)
        touching = gap <= 0
        p = np.where(touching, -penalty * gap, 0.0)
        pull, T, slipping, m, size = self._stick_or_slip(x, depth, history, penalty, n, p, touching)
        D = self._derivative(penalty, n, H, p, pull, slipping, m, size, touching) if derivative else None
        return Touch(x, depth, gap, n, p, T, T - p[..., None] * n, slipping, D)

    def _stick_or_slip(self, x, depth, history, penalty, n, p, touching):
        """Trial pull, friction by radial return, where it slips, its direction and the trial's size."""
        if self.friction == 0:
            zero = np.zeros_like(x)
            return zero, zero, np.zeros(p.shape, dtype=bool), zero, np.ones_like(p)
        motion = x - history.x + (depth - history.depth) * _UP
        pull = (history.friction + penalty * motion) * touching[..., None]
        trial = pull - np.einsum("fqi,fqi->fq", pull, n)[..., None] * n
        size = np.sqrt(np.einsum("fqi,fqi->fq", trial, trial))
        slipping = touching & (size > self.friction * p) if np.isfinite(self.friction) else np.zeros_like(touching)
        m = trial / np.where(size > 0, size, 1.0)[..., None]
        T = np.where(slipping[..., None], np.where(slipping, self.friction * p if np.isfinite(self.friction) else 0, 0)[..., None] * m, trial)
        return pull, T, slipping, m, np.where(size > 0, size, 1.0)

    def _derivative(self, penalty, n, H, p, pull, slipping, m, size, touching):
        """D = d(T - p n)/dx, consistent with the radial return."""
        eye = np.eye(3)
        nn = n[..., :, None] * n[..., None, :]
        D = touching[..., None, None] * penalty * nn
        curved = H is not None
        if curved:
            D = D - p[..., None, None] * H
        if self.friction == 0:
            return D
        trial = penalty * (eye - nn)
        if curved:
            pn = np.einsum("fqi,fqi->fq", pull, n)
            trial = trial - pn[..., None, None] * H - n[..., :, None] * np.einsum("fqi,fqij->fqj", pull, H)[..., None, :]
        friction = trial
        if slipping.any():
            f = self.friction
            along = m[..., :, None] * m[..., None, :]
            turn = np.einsum("fqij,fqjk->fqik", eye - along, trial)
            slip = (f * p / size)[..., None, None] * turn - f * penalty * m[..., :, None] * n[..., None, :]
            friction = np.where(slipping[..., None, None], slip, trial)
        return D + touching[..., None, None] * friction

    def residual(self, touch):
        """Nodal forces (n,) of the contact in the residual, mN."""
        out = np.zeros(self.n_dofs)
        forces = np.einsum("fqn,fqi->fni", self.shape * self.weights[..., None], touch.traction)
        np.add.at(out, self.dofs.ravel(), forces.ravel())
        return out

    def add_tangent(self, touch, values):
        """Adds the contact's tangent to the CSR data of the solid's."""
        blocks = np.einsum("fqn,fqm,fqij->fnmij", self.shape * self.weights[..., None], self.shape, touch.D, optimize=True)
        _scatter(blocks, self.dofs, self.positions, self.indptr, values)

    def by_depth(self, touch):
        """Derivative (n,) of the contact's residual by the depth at fixed displacements, mN/mm."""
        out = np.zeros(self.n_dofs)
        change = np.einsum("fqn,fqi->fni", self.shape * self.weights[..., None], touch.D @ _UP)
        np.add.at(out, self.dofs.ravel(), change.ravel())
        return out

    def force(self, touch):
        """Force on the indenter that the quarter carries, mN, positive when pressing."""
        return float(np.sum(self.weights * touch.traction[..., 1]))

    def stiffness(self, touch, v):
        """dF/d(depth) of the quarter, mN/mm, when the displacements change by v (n,) per mm."""
        change = np.einsum("fqij,fqj->fqi", touch.D, self.field(v) + _UP)
        return float(np.sum(self.weights * change[..., 1]))

    def energy(self, touch, penalty):
        """Energy in the contact springs of the quarter, mN mm: what the penalty takes from the body."""
        squares = touch.pressure**2 + np.einsum("fqi,fqi->fq", touch.friction, touch.friction)
        return float(np.sum(self.weights * squares) / (2 * penalty))


@numba.njit(cache=True, nogil=True)
def _scatter(blocks, dofs, positions, indptr, values):
    for f in range(blocks.shape[0]):
        for n in range(blocks.shape[1]):
            for o in range(blocks.shape[1]):
                for i in range(3):
                    row = indptr[dofs[f, n, i]] + 3 * positions[f, n, o]
                    for k in range(3):
                        values[row + k] += blocks[f, n, o, i, k]


# ---- indenters as signed distances -------------------------------------------------------------------------------


def signed_distance(indenter, x, bottom):
    """Gap, its gradient and Hessian at points x (..., 3) of an indenter whose lowest point is at y = bottom.

    Returns g (...), n (..., 3) and H (..., 3, 3), or None for H where the face is flat.
    """
    if indenter.shape == "sphere":
        return _sphere(indenter.diameter / 2, x, bottom)
    if not indenter.edge_radius:
        return bottom - x[..., 1], np.broadcast_to(_DOWN, x.shape), None
    if indenter.shape == "cylinder":
        return _rounded_cylinder(indenter.diameter / 2, indenter.edge_radius, x, bottom)
    return _rounded_strip(indenter.length / 2, indenter.width / 2, indenter.edge_radius, x, bottom)


def _sphere(R, x, bottom):
    away = x - np.array([0.0, bottom + R, 0.0])
    distance = np.sqrt(np.einsum("...i,...i->...", away, away))
    n = away / distance[..., None]
    return distance - R, n, (np.eye(3) - n[..., :, None] * n[..., None, :]) / distance[..., None, None]


def _rounded_strip(a, b, r, x, bottom):
    """Distance to a bar with half-lengths a (x) and b (z): r less than the distance to its core."""
    away = np.stack(
        [
            np.sign(x[..., 0]) * np.maximum(np.abs(x[..., 0]) - (a - r), 0),
            np.minimum(x[..., 1] - (bottom + r), 0),
            np.sign(x[..., 2]) * np.maximum(np.abs(x[..., 2]) - (b - r), 0),
        ],
        axis=-1,
    )
    return _from_core(away, np.zeros_like(away), r, x, bottom)


def _rounded_cylinder(a, r, x, bottom):
    rho = np.hypot(x[..., 0], x[..., 2])
    beyond = np.maximum(rho - (a - r), 0)
    safe = np.where(rho > 0, rho, 1.0)
    radial = np.stack([x[..., 0] / safe, np.zeros_like(rho), x[..., 2] / safe], axis=-1)
    away = beyond[..., None] * radial + np.minimum(x[..., 1] - (bottom + r), 0)[..., None] * _UP
    hoop = np.stack([-radial[..., 2], np.zeros_like(rho), radial[..., 0]], axis=-1)
    return _from_core(away, hoop * np.sqrt(beyond / safe)[..., None], r, x, bottom, radial)


def _from_core(away, hoop, r, x, bottom, radial=None):
    """Distance, gradient and Hessian from the vector away from the core; inside the core the flat face counts."""
    distance = np.sqrt(np.einsum("...i,...i->...", away, away))
    inside = distance == 0
    n = np.where(inside[..., None], _DOWN, away / np.where(inside, 1.0, distance)[..., None])
    g = np.where(inside, bottom - x[..., 1], distance - r)
    if radial is None:
        free = np.eye(3) * (away != 0)[..., None, :]
    else:
        out = np.einsum("...i,...i->...", away, radial) != 0
        free = out[..., None, None] * radial[..., :, None] * radial[..., None, :]
        free = free + (away[..., 1] != 0)[..., None, None] * _UP[:, None] * _UP
    H = (free - n[..., :, None] * n[..., None, :] + hoop[..., :, None] * hoop[..., None, :]) / np.where(inside, np.inf, distance)[..., None, None]
    return g, n, H
