"""Small strain of an incompressible law with fibres in one or two directions: Young's moduli along any axis.

F = exp(e) with tr e = 0 changes I4 by 2 a.e a, I5 by 4 a.e a, I8 by 2 a.e b to first order. With no stress at rest, to second order

    psi = m tr e^2 + 4 psi_5 |e a|^2 + 4 psi_7 |e b|^2 + 1/2 sum over pairs of psi_xy dI_x dI_y,

where m is the shear modulus without fibres, 2 (psi_1 + psi_2). `Material.moduli` has the closed form for one family.
"""

import numpy as np

from indentfit.arrays import Array
from indentfit.material.kinematics import families

# An orthonormal basis (6, 3, 3) of symmetric tensors.
PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))
BASIS = np.zeros((6, 3, 3))
for _row, (_i, _k) in enumerate(PAIRS):
    BASIS[_row, _i, _k] = BASIS[_row, _k, _i] = 1.0 if _i == _k else np.sqrt(0.5)


def stiffness(m: float, gradient: Array, hessian: Array, fibres: Array) -> Array:
    """K (6, 6), kPa: psi is e.K e / 2 of isochoric strains e in `BASIS`; m: shear modulus without fibres, kPa."""
    K, slopes = 2 * m * np.eye(6), [np.zeros(6), np.zeros(6)]  # of I1 and I2, which do not change to first order
    for number, a in enumerate(families(fibres)):
        Ea = BASIS @ a
        K += 8 * gradient[3 + 2 * number] * Ea @ Ea.T
        slopes += [2 * Ea @ a, 4 * Ea @ a]
    if len(fibres) == 2:
        slopes.append(2 * BASIS @ fibres[1] @ fibres[0])
    L, H = np.array(slopes), np.array(hessian, copy=True)
    H[:2] = H[:, :2] = 0
    return np.asarray(K + L.T @ H @ L)


def young(m: float, gradient: Array, hessian: Array, fibres: Array, axis: Array) -> float:
    """Young's modulus along an axis (3,), kPa: the least energy of an isochoric strain of 1 along it, twice."""
    K = stiffness(m, gradient, hessian, fibres)
    B = np.array([np.einsum("kii->k", BASIS), BASIS @ axis @ axis])
    whole = np.block([[K, B.T], [B, np.zeros((2, 2))]])
    e = np.linalg.solve(whole, np.array([0, 0, 0, 0, 0, 0, 0, 1.0]))[:6]
    return float(e @ K @ e)


def moduli_of_two(m: float, gradient: Array, hessian: Array) -> dict[str, float]:
    """Moduli, kPa, of a law with two families of fibres at right angles: mu without fibres, and Young's along both and normal."""
    axes = np.eye(3)
    along = {
        name: young(m, gradient, hessian, axes[:2], axis) for name, axis in zip(("first", "second", "normal"), axes, strict=True)
    }
    return {"mu": m, **{f"E_{name}": value for name, value in along.items()}}
