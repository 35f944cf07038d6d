"""Isochoric invariants of a deformation, and their derivatives by the deformation gradient."""

import numpy as np

from indentfit.arrays import Array

INVARIANTS = ("I1", "I2", "I4", "I5")
"""Invariants of Cb = J^(-2/3) F^T F: I1 = tr Cb, I2 = (I1^2 - tr Cb^2) / 2, I4 = a0.Cb a0, I5 = a0.Cb^2 a0."""

REST = np.array([3.0, 3.0, 1.0, 1.0])
"""Values of the invariants in the undeformed state, shape (4,)."""

DEGREES = (2, 4, 2, 4)
"""Degree of each invariant, before it is made isochoric, in the deformation gradient."""


def invariants(F: Array, a0: Array) -> Array:
    """The isochoric invariants.

    Parameters
    ----------
    F : array (3, 3, ...)
        Deformation gradients.
    a0 : array (3, ...)
        Unit fibre directions in the undeformed state.

    Returns
    -------
    array (4, ...), in the order of `INVARIANTS`
    """
    C = np.einsum("ki...,kj...->ij...", F, F) * determinant(F) ** (-2 / 3)
    Ca, trace = np.einsum("ij...,j...->i...", C, a0), np.einsum("ii...->...", C)
    second = (trace**2 - np.einsum("ij...,ij...->...", C, C)) / 2
    return np.stack([trace, second, np.einsum("i...,i...->...", a0, Ca), np.einsum("i...,i...->...", Ca, Ca)])


def invariant_gradients(F: Array, a0: Array) -> Array:
    """Derivatives dI/dF of the isochoric invariants.

    Parameters
    ----------
    F, a0 : arrays (3, 3, ...) and (3, ...)
        As `invariants` takes them.

    Returns
    -------
    array (4, 3, 3, ...)
    """
    J, I = determinant(F), invariants(F, a0)
    C = np.einsum("ki...,kj...->ij...", F, F)
    Ca, Fa = np.einsum("ij...,j...->i...", C, a0), np.einsum("ij...,j...->i...", F, a0)
    FC, FCa = np.einsum("ij...,jk...->ik...", F, C), np.einsum("ij...,j...->i...", F, Ca)
    inverse = np.moveaxis(np.linalg.inv(np.moveaxis(F, (0, 1), (-2, -1))), (-2, -1), (1, 0))  # F^-T
    full = [2 * F, 2 * (np.einsum("ii...->...", C) * F - FC), 2 * _outer(Fa, a0), 2 * (_outer(Fa, Ca) + _outer(FCa, a0))]
    return np.stack([J ** (-n / 3) * D - n / 3 * i * inverse for n, D, i in zip(DEGREES, full, I, strict=True)])


def determinant(F: Array) -> Array:
    """det F, shape (...), of deformation gradients, shape (3, 3, ...)."""
    return np.linalg.det(np.moveaxis(F, (0, 1), (-2, -1)))


def _outer(x: Array, y: Array) -> Array:
    return np.einsum("i...,j...->ij...", x, y)
