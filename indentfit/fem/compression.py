"""A disc pressed between rigid plates to which it is bonded, by finite elements of the meridian plane.

The middle plane of the disc is a plane of symmetry, so that half of its height is solved: u_y = 0 there, and at the plate u_r = 0
and u_y = -d/2. The side of the disc bulges, and below the rim it turns up and comes to lie against the plate, on which it slips
freely: a point of the side that is g above the plate's plane is pushed back with the pressure (on the undeformed side)

    p = e (g - w/2),  e g^2 / (2 w) where 0 < g < w,

by springs e that are stiff beside the material. Without this contact the side would pass through the plane of the plate, sooner
the narrower the elements are, and its corner would fold up: such displacements are no state of a disc between plates.

Newton's method takes the pressures as unknowns (see `element`), in steps of the strain; the derivatives of the force are those of
the linearised equilibrium. Forces of meshes twice as fine differ by 0.1 %.
"""

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from skfem import Basis, ElementQuad2, ElementVector, FacetBasis

from indentfit.arrays import Array, Ints
from indentfit.errors import NoStateError
from indentfit.fem.body import Volumetric
from indentfit.fem.directions import Direction, Solids, directions
from indentfit.fem.disc_mesh import disc_mesh
from indentfit.fem.meridian import N_N, Meridian
from indentfit.material import NO_EFFECT, Material, Stresses

STEP, SMALLEST = 0.02, 1e-4  # steps of the strain
ITERATIONS, TOLERANCE = 40, 1e-10  # of Newton's method; of the forces at nodes, in those of the shear modulus at the strain
PATIENCE = 8  # iterations after which steps are shortened where that leaves smaller forces
ROUNDING = 1e-5  # the same, below which forces that no longer fall are round-off
SPRING, SOFT = 300.0, 0.01  # e, in shear moduli over the length of a facet; w, in such lengths
POINTS = 7  # order of the quadrature on a facet
SHARES = (1.0, 0.5, 0.25, 0.1, 0.03)  # of a step of Newton's method
LEAST_AREA = 0.2  # of the area ratio of the meridian plane at the nodes: where an element is distorted more, forces are no good
FOLDED = (
    "no equilibrium of the bonded disc was found beyond a compression of {:.4g}: its elements fold up below the rim of the plate, "
    "or the law loses its stability; leave out such large strains, or check the law's parameters"
)
AXIS = np.array([0.0, 1.0, 0.0])  # a direction for the invariants that a law without fibres does not use


def pressed_disc(
    material: Material,
    kappa: float,
    diameter: float,
    height: float,
    strains: Array,
    names: Collection[str] = (),
    bonded: bool = True,
    finer: int = 1,
) -> Stresses:
    """Nominal stresses of a disc between plates.

    Parameters
    ----------
    material : Material
        Without fibres.
    kappa : float, kPa
        Bulk modulus.
    diameter, height : float, mm
    strains : array (n,)
        Shortening over height, in rising order, not negative.
    names : names of sensitivities
        As `HomogeneousState.solve` takes them.
    bonded : bool
        Whether the plates hold the disc; otherwise it slides on them, and the state is homogeneous.
    finer : int
        Divides the widths of the elements.

    Returns
    -------
    Stresses
        Force over the undeformed area, positive.

    Raises
    ------
    NoStateError
        There is no equilibrium at one of the strains, or none was found.
    InputError
        A name among `names` is unknown.
    """
    disc = _Disc(diameter / 2, height / 2, bonded, finer)
    known = Solids(material, material, (kappa,), None, lambda moduli, _: moduli[0])
    stiffness = _stiffness if bonded else lambda _: 1.0
    ways = directions([name for name in names if name not in NO_EFFECT], known, stiffness, np.inf)
    area = np.pi * diameter**2 / 4
    stress = np.zeros(len(strains))
    rows = {name: np.zeros(len(strains)) for name in names}
    u, reached = np.zeros(disc.body.n_dofs), 0.0
    for n, strain in enumerate(np.asarray(strains, dtype=float).tolist()):
        if strain == 0:
            continue
        u, reached = disc.pressed(u, reached, strain, material, kappa), strain
        force, slopes = disc.forces(u, strain, material, kappa, ways)
        stress[n] = force / area
        for name, slope in slopes.items():
            rows[name][n] = slope / area
    return Stresses(stress, rows)


def _stiffness(material: Material) -> float:
    return material.shear_modulus


@dataclass(frozen=True)
class _Touch:
    """The contact of the side with the plate: forces (n,) on the nodes, mN, their derivatives (n, n), mN/mm, and their sum; `rise`
    (n,): derivative of the sum by the displacements."""

    forces: Array
    tangent: sp.csr_matrix
    total: float
    rise: Array


class _Side:
    """The free side of a disc, which may touch the plane of the plate, at points n_q."""

    def __init__(self, body: Meridian, radius: float, height: float) -> None:
        facets = FacetBasis(body.mesh, ElementVector(ElementQuad2()), facets="side", intorder=POINTS)
        shape = facets.dx.shape
        number = np.arange(facets.dx.size).reshape(shape)
        values = [np.broadcast_to(np.asarray(facets.basis[i][0])[1], shape).ravel() for i in range(facets.Nbfun)]
        columns = [np.repeat(facets.element_dofs[i], shape[1]) for i in range(facets.Nbfun)]
        places = (np.tile(number.ravel(), facets.Nbfun), np.concatenate(columns))
        self.rises = sp.csr_matrix((np.concatenate(values), places), shape=(number.size, body.n_dofs))  # u_y at the points
        self.below = height - np.asarray(facets.global_coordinates())[1].ravel()
        self.areas = (facets.dx * 2 * np.pi * radius).ravel()
        self.lengths = np.repeat(facets.dx.sum(axis=1), shape[1])
        self.height = height

    def touch(self, u: Array, strain: float, shear_modulus: float) -> _Touch:
        """The contact at displacements u (n,), under a plate that has moved by the strain times the height."""
        gap, soft = self.rises @ u - self.below + strain * self.height, SOFT * self.lengths
        springs = SPRING * shear_modulus / self.lengths * self.areas
        pushes = springs * np.where(gap < soft, np.maximum(gap, 0.0) ** 2 / (2 * soft), gap - soft / 2)
        slopes = springs * np.clip(gap / soft, 0.0, 1.0)
        tangent = (self.rises.T @ sp.diags(slopes) @ self.rises).tocsr()
        return _Touch(self.rises.T @ pushes, tangent, float(pushes.sum()), self.rises.T @ slopes)


class _Disc:
    """Half of a disc below a plate: its body, its side, and the dofs that the plate moves."""

    def __init__(self, radius: float, height: float, bonded: bool, finer: int) -> None:
        self.height = height
        self.body = body = Meridian(disc_mesh(radius, height, finer))
        self.side = _Side(body, radius, height) if bonded else None
        top = body.basis.get_dofs("top")
        self.moved: Ints = np.asarray(top.all(["u^2"]))
        held = [body.held("sliding"), self.moved, *([top.all(["u^1"])] if bonded else [])]
        self.free = np.setdiff1d(np.arange(body.n_dofs), np.concatenate(held))
        corners = np.array([[0, 1, 1, 0, 0.5, 1, 0.5, 0, 0.5], [0, 0, 1, 1, 0, 0.5, 1, 0.5, 0.5]])
        nodes = Basis(body.mesh, ElementQuad2(), quadrature=(corners, np.ones(N_N)))
        self._slopes = np.array([np.asarray(nodes.basis[i][0].grad) for i in range(N_N)])  # (N_N, 2, n_el, N_N)

    def pressed(self, u: Array, reached: float, strain: float, material: Material, kappa: float) -> Array:
        """Displacements (n,) at a strain, from those at the strain reached, in steps that are halved where none is found."""
        step = STEP
        while reached < strain:
            there = min(reached + step, strain) if strain - reached > 1.001 * step else strain
            trial = self._equilibrium(u, there, material, kappa)
            if trial is None:
                step = (there - reached) / 2
                if step < SMALLEST:
                    raise NoStateError(FOLDED.format(reached))
                continue
            u, reached, step = trial, there, min(STEP, 2 * step)
        return u

    def _equilibrium(self, u: Array, strain: float, material: Material, kappa: float) -> Array | None:
        """Displacements (n,) of equilibrium at a strain, from others; None where Newton's method does not end."""
        body, free, moved = self.body, self.free, self.moved
        size = material.shear_modulus * float(body.volume.sum()) / self.height
        push = np.zeros_like(u)
        push[moved] = -strain * self.height - u[moved]
        pressure, left = body.pressure(body.state(u, AXIS), kappa), np.inf
        for n in range(ITERATIONS):
            balance = self._balance(u, strain, material, pressure, kappa)
            if balance is None:
                return None
            forces, K = balance
            last, left = left, float(np.abs(forces[free]).max()) / size
            if n and (left < TOLERANCE * strain or (left < ROUNDING * strain and left > last / 2)):
                return u if self._sound(u, K) else None
            change = push.copy() if n == 0 else np.zeros_like(u)
            try:
                factor = spla.splu(K[free][:, free].tocsc())
            except RuntimeError:  # singular
                return None
            change[free] = factor.solve(-(forces + K @ change)[free])
            target, B = body.pressure(body.state(u, AXIS), kappa), body.dilatation_map(u)
            turn = target + kappa * np.einsum("emni,eni->em", B, change[body.dofs]) - pressure
            share = self._share(u, change, pressure, turn, strain, material, n)
            if share == 0.0:
                return None
            u, pressure = u + share * change, pressure + share * turn
        return None

    def _balance(
        self, u: Array, strain: float, material: Material, pressure: Array, kappa: float
    ) -> tuple[Array, sp.csr_matrix] | None:
        """Forces (n,) at displacements, and their derivatives (n, n); None where they are not numbers."""
        state = self.body.state(u, AXIS)
        if not state.valid:
            return None
        with np.errstate(all="ignore"):
            forces, values = self.body.tangent(u, state, material, pressure, kappa, AXIS)
        if not (np.isfinite(forces).all() and np.isfinite(values).all()):
            return None
        K = self.body.matrix(values)
        if self.side is None:
            return forces, K
        touch = self.side.touch(u, strain, material.shear_modulus)
        return forces + touch.forces, (K + touch.tangent).tocsr()

    def _share(self, u: Array, change: Array, pressure: Array, turn: Array, strain: float, material: Material, n: int) -> float:
        """The share of a change that leaves no element inside out, and late in the iteration the smallest forces; 0 where there is
        none. The first change moves the plate, and is taken as a whole or not at all."""
        best, least = 0.0, np.inf
        for share in SHARES[:1] if n == 0 else SHARES:
            there = u + share * change
            state = self.body.state(there, AXIS)
            if not state.valid:
                continue
            if n < PATIENCE:
                return share
            with np.errstate(all="ignore"):
                forces = self.body.residual(there, state, material, pressure + share * turn, AXIS)
            if self.side is not None:
                forces = forces + self.side.touch(there, strain, material.shear_modulus).forces
            size = float(np.linalg.norm(forces[self.free]))
            if size < least:
                best, least = share, size
        return best

    def _sound(self, u: Array, K: sp.csr_matrix) -> bool:
        """Whether the elements keep their shape and the tangent is positive definite: a sign of the pivots tells it."""
        F = np.einsum("eni,njeq->eqij", u[self.body.dofs], self._slopes)
        areas = (1 + F[..., 0, 0]) * (1 + F[..., 1, 1]) - F[..., 0, 1] * F[..., 1, 0]
        if areas.min() < LEAST_AREA:
            return False
        K = K[self.free][:, self.free].tocsc()
        factor = spla.splu(K, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
        return bool((factor.U.diagonal() > 0).all())

    def forces(
        self, u: Array, strain: float, material: Material, kappa: float, ways: tuple[Direction, ...]
    ) -> tuple[float, dict[str, float]]:
        """The force on the plate, mN, positive in compression, and its derivatives at a fixed displacement of the plate."""
        body, free, moved = self.body, self.free, self.moved
        state = body.state(u, AXIS)
        pressure = body.pressure(state, kappa)
        internal, values = body.tangent(u, state, material, pressure, kappa, AXIS)
        K, slopes, nothing = body.matrix(values), {}, np.zeros_like(u)
        touch = _Touch(nothing, sp.csr_matrix(K.shape), 0.0, nothing)
        if self.side is not None:
            touch = self.side.touch(u, strain, material.shear_modulus)
        K = (K + touch.tangent).tocsr()
        factor = spla.splu(K[free][:, free].tocsc()) if ways else None
        for way in ways:
            gradient = np.zeros_like(state.I) if way.gradient is None else way.gradient(state.I)
            change = body.forces(u, gradient, body.pressure(state, Volumetric(way.kappa)), AXIS) + way.springs * touch.forces
            motion = np.zeros_like(u)
            assert factor is not None
            motion[free] = -factor.solve(change[free])
            pushed = way.springs * touch.total + float(touch.rise @ motion)
            slopes[way.name] = pushed - float((change + K @ motion)[moved].sum())
        return touch.total - float((internal + touch.forces)[moved].sum()), slopes
