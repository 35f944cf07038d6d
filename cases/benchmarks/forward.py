"""Forward curves of the benchmark problems, at small strain, by closed forms and by discretisations that are not indentfit's.

Units: mm, kPa, mN. Nothing here imports indentfit.
"""

from collections.abc import Callable

import numpy as np
from scipy.special import ellipe, ellipk, j0, j1
from skfem import Basis, BilinearForm, ElementHex2, ElementVector, MeshHex, condense, solve
from skfem.helpers import ddot, sym_grad

RINGS, WAVES = 240, 600


def hertz(young: float, nu: float, radius: float, depth: np.ndarray) -> np.ndarray:
    """A sphere on a half-space (Hertz 1881): F = 4/3 E / (1 - nu^2) sqrt(R) d^1.5."""
    return 4 / 3 * young / (1 - nu**2) * np.sqrt(radius) * depth**1.5


def cone(young: float, nu: float, half_angle: float, depth: np.ndarray) -> np.ndarray:
    """A cone on a half-space (Sneddon 1965, Int J Eng Sci 3:47): F = 2 / pi E / (1 - nu^2) tan(half angle) d^2."""
    return 2 / np.pi * young / (1 - nu**2) * np.tan(np.radians(half_angle)) * depth**2


def punch(young: float, nu: float, a: float, depth: np.ndarray) -> np.ndarray:
    """A smooth flat punch on a half-space (Sneddon 1965): F = 2 a E / (1 - nu^2) d."""
    return 2 * a * young / (1 - nu**2) * depth


def sticking_punch(young: float, nu: float, a: float, depth: np.ndarray) -> np.ndarray:
    """A flat punch that sticks to a half-space (Mossakovskii 1954): F = 4 a G ln(3 - 4 nu) / (1 - 2 nu) d."""
    shear = young / (2 * (1 + nu))
    return 4 * a * shear * np.log(3 - 4 * nu) / (1 - 2 * nu) * depth


def layer(young: float, nu: float, thickness: float, bonded: bool, shape: Callable[[np.ndarray], np.ndarray], reach: float,
          depth: np.ndarray) -> np.ndarray:  # fmt: skip
    """A smooth round indenter on a layer: rings of constant pressure, whose displacements are those on a half-space (elliptic
    integrals) and a smooth correction for the base (an integral over wave numbers); pressures are kept above zero.

    shape(r) : height of the indenter's face above its lowest point; reach: largest radius of the contact.
    """
    edges = reach * np.sin(np.linspace(0, np.pi / 2, RINGS + 1))  # narrow rings at the edge
    middles, areas = (edges[1:] + edges[:-1]) / 2, np.pi * np.diff(edges**2)
    factor = (1 - nu) * 2 * (1 + nu) / young  # (1 - nu) / G
    discs = _disc(middles, edges) - _base(middles, edges, thickness, bonded, nu)
    matrix = factor * (discs[:, 1:] - discs[:, :-1])
    return np.array([_force(matrix, areas, d - shape(middles)) for d in depth])


def _disc(r: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Integral of a J1(w a) J0(w r) / w over w: the half-space under a disc of unit pressure."""
    a = np.maximum(edges[None, :], 1e-12)
    r = r[:, None]
    inside, outside = np.minimum(r / a, 1) ** 2, np.minimum(a / r, 1 - 1e-15) ** 2
    return 2 / np.pi * np.where(r < a, a * ellipe(inside), r * (ellipe(outside) - (1 - outside) * ellipk(outside)))


def _base(r: np.ndarray, edges: np.ndarray, thickness: float, bonded: bool, nu: float) -> np.ndarray:
    """The same integral of 1 - L, where L is the compliance of the layer over that of the half-space (Lebedev and Ufliand 1958)."""
    nodes, weights = np.polynomial.legendre.leggauss(WAVES)
    x = 15 * (nodes + 1)  # up to 30, where 1 - L is 1e-24
    kappa = 3 - 4 * nu
    if bonded:
        compliance = (2 * kappa * np.sinh(2 * x) - 4 * x) / (2 * kappa * np.cosh(2 * x) + 4 * x**2 + 1 + kappa**2)
    else:
        compliance = (np.cosh(2 * x) - 1) / (np.sinh(2 * x) + 2 * x)
    w, weights = x / thickness, 15 * weights / thickness
    return np.einsum("q,rq,qa->ra", weights * (1 - compliance) / w, j0(np.outer(r, w)), edges * j1(np.outer(w, edges)))


def _force(matrix: np.ndarray, areas: np.ndarray, wanted: np.ndarray) -> float:
    touching = wanted > 0
    while touching.any():
        pressure = np.linalg.solve(matrix[np.ix_(touching, touching)], wanted[touching])
        if pressure.min() >= 0:
            return float(pressure @ areas[touching])
        touching[np.flatnonzero(touching)[pressure < 0]] = False
    return 0.0


def strip_stiffness(stiffness: np.ndarray, size: tuple[float, float, float], width: float, cells: int = 6) -> float:
    """Force over depth (mN/mm) of a smooth, sharp strip across the whole length of a block on a smooth base: linear elasticity by
    quadratic bricks of displacements on the quarter block, whose size along x, y, z is given.

    stiffness : array (3, 3, 3, 3), kPa; the strip lies along x, with `width` along z.
    """
    length, height, across = size[0] / 2, size[1], size[2] / 2
    half = width / 2
    near = half * (1 - np.geomspace(1, 0.01, cells)) / 0.99
    beyond = half + (across - half) * (np.geomspace(0.003, 1, 2 * cells) - 0.003) / 0.997
    z = np.unique(np.round([*near, *beyond], 12))
    y = height * (1 - (np.geomspace(0.01, 1, 2 * cells) - 0.01) / 0.99)[::-1]
    mesh = MeshHex.init_tensor(np.linspace(0, length, 4), y, z)
    basis = Basis(mesh, ElementVector(ElementHex2()), intorder=4)

    @BilinearForm
    def energy(u, v, _):
        return ddot(np.einsum("ijkl,kl...->ij...", stiffness, sym_grad(u)), sym_grad(v))

    matrix = energy.assemble(basis)
    x, direction = basis.doflocs, np.empty(basis.N, dtype=int)
    for component, numbers in enumerate(basis.split_indices()):
        direction[numbers] = component

    def at(axis: int, place: float) -> np.ndarray:
        return np.isclose(x[axis], place, atol=1e-9)

    held = (at(0, 0) & (direction == 0)) | (at(2, 0) & (direction == 2)) | (at(1, 0) & (direction == 1))
    pressed = at(1, height) & (x[2] <= half + 1e-9) & (direction == 1)
    u = np.zeros(basis.N)
    u[pressed] = -1.0
    u = solve(*condense(matrix, np.zeros(basis.N), x=u, D=np.flatnonzero(held | pressed)))
    return float(4 * u @ (matrix @ u))


def isotropic(young: float, nu: float) -> np.ndarray:
    """The stiffness of an isotropic material."""
    one = np.eye(3)
    shear, lame = young / (2 * (1 + nu)), young * nu / ((1 + nu) * (1 - 2 * nu))
    return lame * np.einsum("ij,kl->ijkl", one, one) + shear * (
        np.einsum("ik,jl->ijkl", one, one) + np.einsum("il,jk->ijkl", one, one)
    )


def with_fibres(mu: float, zeta: float, phi: float, bulk: float, fibre: np.ndarray) -> np.ndarray:
    """The stiffness at rest of mu/2 [(I1 - 3) + zeta (I4 - 1)^2 + phi (I5 - I4^2)] with isochoric invariants and a bulk modulus.

    In the deviatoric strain e: energy mu e:e + 2 mu zeta (a.e.a)^2 + 2 mu phi (|e a|^2 - (a.e.a)^2), because I4 - 1 = 2 a.e.a, and
    I5 - I4^2 = 4 (|e a|^2 - (a.e.a)^2) at second order.
    """
    one, along = np.eye(3), np.outer(fibre, fibre)
    pairs = np.einsum("ik,jl->ijkl", one, one)
    same = (pairs + np.einsum("il,jk->ijkl", one, one)) / 2
    deviator = same - np.einsum("ij,kl->ijkl", one, one) / 3
    ends = np.einsum("ij,kl->ijkl", along, along)
    sheared = (
        np.einsum("ik,jl->ijkl", along, one) + np.einsum("jl,ik->ijkl", along, one)
        + np.einsum("il,jk->ijkl", along, one) + np.einsum("jk,il->ijkl", along, one)
    ) / 4  # fmt: skip
    inner = 2 * mu * same + 4 * mu * zeta * ends + 4 * mu * phi * (sheared - ends)
    isochoric = np.einsum("ijab,abcd,cdkl->ijkl", deviator, inner, deviator)
    return isochoric + bulk * np.einsum("ij,kl->ijkl", one, one)
