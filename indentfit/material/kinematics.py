"""Isochoric invariants of a deformation, and their derivatives by the deformation gradient."""

import numpy as np

from indentfit.arrays import Array

INVARIANTS = ("I1", "I2", "I4", "I5")
"""Invariants of Cb = J^(-2/3) F^T F: I1 = tr Cb, I2 = (I1^2 - tr Cb^2) / 2, I4 = a0.Cb a0, I5 = a0.Cb^2 a0."""

SECOND_FAMILY = ("I6", "I7", "I8")
"""Invariants of a second family of fibres b0, behind the others: I6 = b0.Cb b0, I7 = b0.Cb^2 b0, I8 = a0.Cb b0."""

REST = np.array([3.0, 3.0, 1.0, 1.0])
"""Values of the invariants in the undeformed state, shape (4,)."""

REST_OF_TWO = np.array([*REST, 1.0, 1.0, 0.0])
"""The same with a second family of fibres at right angles to the first, shape (7,)."""

DEGREES = (2, 4, 2, 4, 2, 4, 2)
"""Degree of each invariant, before it is made isochoric, in the deformation gradient."""


def invariants(F: Array, a0: Array) -> Array:
    """The isochoric invariants.

    Parameters
    ----------
    F : array (3, 3, ...)
        Deformation gradients.
    a0 : array (3, ...) or (2, 3, ...)
        Unit fibre directions in the undeformed state, of one family or of two.

    Returns
    -------
    array (4, ...), in the order of `INVARIANTS`, or (7, ...) with `SECOND_FAMILY` behind
    """
    C = np.einsum("ki...,kj...->ij...", F, F) * determinant(F) ** (-2 / 3)
    trace = np.einsum("ii...->...", C)
    rows = [trace, (trace**2 - np.einsum("ij...,ij...->...", C, C)) / 2]
    for fibre in families(a0):
        Ca = np.einsum("ij...,j...->i...", C, fibre)
        rows += [np.einsum("i...,i...->...", fibre, Ca), np.einsum("i...,i...->...", Ca, Ca)]
    if len(rows) > len(INVARIANTS):
        rows.append(np.einsum("i...,i...->...", a0[0], Ca))
    return np.stack(rows)


def families(a0: Array) -> tuple[Array, ...]:
    """The directions (3, ...) of each family, of those of one (3, ...) or two (2, 3, ...)."""
    return (a0[0], a0[1]) if len(a0) == 2 else (a0,)


def invariant_gradients(F: Array, a0: Array) -> Array:
    """Derivatives dI/dF of the isochoric invariants.

    Parameters
    ----------
    F, a0 : arrays (3, 3, ...) and (3, ...) or (2, 3, ...)
        As `invariants` takes them.

    Returns
    -------
    array (4, 3, 3, ...) or (7, 3, 3, ...)
    """
    J, I = determinant(F), invariants(F, a0)
    C = np.einsum("ki...,kj...->ij...", F, F)
    FC = np.einsum("ij...,jk...->ik...", F, C)
    inverse = np.moveaxis(np.linalg.inv(np.moveaxis(F, (0, 1), (-2, -1))), (-2, -1), (1, 0))  # F^-T
    full = [2 * F, 2 * (np.einsum("ii...->...", C) * F - FC)]
    for fibre in families(a0):
        Ca, Fa = np.einsum("ij...,j...->i...", C, fibre), np.einsum("ij...,j...->i...", F, fibre)
        FCa = np.einsum("ij...,j...->i...", F, Ca)
        full += [2 * _outer(Fa, fibre), 2 * (_outer(Fa, Ca) + _outer(FCa, fibre))]
    if len(full) > len(INVARIANTS):
        Fa = np.einsum("ij...,j...->i...", F, a0[0])
        full.append(_outer(Fa, a0[1]) + _outer(np.einsum("ij...,j...->i...", F, a0[1]), a0[0]))
    return np.stack([J ** (-n / 3) * D - n / 3 * i * inverse for n, D, i in zip(DEGREES, full, I, strict=False)])


def determinant(F: Array) -> Array:
    """det F, shape (...), of deformation gradients, shape (3, 3, ...)."""
    return np.linalg.det(np.moveaxis(F, (0, 1), (-2, -1)))


def _outer(x: Array, y: Array) -> Array:
    return np.einsum("i...,j...->ij...", x, y)
