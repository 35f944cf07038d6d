"""GMRES, preconditioned from the right, on a tangent as it is or with the pressures as unknowns of their own."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import scipy.linalg as dense
import scipy.sparse as sp

from indentfit.arrays import Array
from indentfit.fem.linear.tangent import Tangent

TOLERANCE = 1e-4  # relative residual of one solve inside a Newton iteration


@dataclass(frozen=True)
class Limits:
    """When GMRES gives up: after so many steps; where more than the share `hopeless` of the residual is left after three of
    them; and when `check`, called at each step, raises."""

    steps: int
    hopeless: float
    check: Callable[[], None]


class Form(Protocol):
    """The unknowns that GMRES iterates on."""

    tangent: Tangent

    def extended(self, b: Array) -> Array:
        """The right-hand side of the form for forces b (n,)."""
        ...

    def product(self, x: Array) -> Array:
        """The form's matrix times x."""
        ...

    def displacements(self, x: Array) -> Array:
        """The displacements (n,) among the unknowns."""
        ...


def form_of(tangent: Tangent) -> Form:
    """With the pressures where the tangent has a dilatation."""
    return Condensed(tangent) if tangent.dilatation is None else Mixed(tangent, tangent.dilatation)


class Condensed:
    """The system as it is."""

    def __init__(self, tangent: Tangent) -> None:
        self.tangent = tangent

    def extended(self, b: Array) -> Array:
        return b

    def product(self, x: Array) -> Array:
        return self.tangent.product(x)

    def displacements(self, x: Array) -> Array:
        return x


class Mixed:
    """The system with the pressures as unknowns of their own, (n + n_p,).

    Pressures are scaled by kappa: a residual of theirs then counts with about the force that it stands for.
    """

    def __init__(self, tangent: Tangent, dilatation: sp.csr_matrix) -> None:
        self.tangent, self._B, self._BT = tangent, dilatation, dilatation.T
        self._n = tangent.whole.shape[0]

    def extended(self, b: Array) -> Array:
        return np.concatenate([b, np.zeros(self._B.shape[0])])

    def product(self, x: Array) -> Array:
        kappa, bulk = self.tangent.kappa, self.tangent.bulk
        v, p = x[: self._n], x[self._n :] * kappa
        swell = self._B @ v
        return np.concatenate([self.tangent.whole @ v + self._BT @ (p - bulk * swell), kappa * swell - p])

    def displacements(self, x: Array) -> Array:
        return x[: self._n]


def gmres(
    form: Form, precondition: Callable[[Array], Array], b: Array, tolerance: float, limits: Limits
) -> tuple[Array, int, bool]:
    """Right-preconditioned GMRES (Saad and Schultz 1986, SIAM J Sci Stat Comput 7:856).

    The estimate of the residual is that of the form's own; where it is small enough the true one is looked at, and the estimate
    sharpened.

    Returns
    -------
    x (n,), the number of steps, and whether |K x - b| <= tolerance |b|
    """
    r, steps = form.extended(b), limits.steps
    size = np.linalg.norm(r)
    wanted, passes = tolerance * size, 1 if tolerance >= TOLERANCE else 2  # Gram-Schmidt twice: sensitivities ask for 1e-9
    basis, corrections = np.empty((steps + 1, r.size)), np.empty((steps, r.size))  # memory is taken as rows are written
    basis[0] = r / size
    H, rhs = np.zeros((steps + 1, steps)), np.zeros(steps + 1)
    rotations: list[tuple[float, float]] = []
    rhs[0], aim, x = size, wanted, np.zeros_like(b)
    for j in range(steps):
        limits.check()
        z = precondition(basis[j])
        w = form.product(z)
        corrections[j] = z
        for _ in range(passes):
            shares = basis[: j + 1] @ w
            w -= shares @ basis[: j + 1]
            H[: j + 1, j] += shares
        H[j + 1, j] = np.linalg.norm(w)
        if not np.isfinite(H[: j + 2, j]).all():
            return x, j + 1, False
        happy = H[j + 1, j] <= 1e-14 * size * np.abs(H[: j + 1, j]).max()
        basis[j + 1] = w if happy else w / H[j + 1, j]
        _rotate(H, rotations, rhs, j)
        left = abs(rhs[j + 1])
        if left <= aim or happy or j + 1 == steps:
            y = dense.solve_triangular(H[: j + 1, : j + 1], rhs[: j + 1])
            x = form.displacements(y @ corrections[: j + 1])
            true = np.linalg.norm(form.tangent.product(x) - b)
            if true <= wanted:
                return x, j + 1, True
            if happy or not np.isfinite(true):
                break
            aim = 0.3 * left
        elif j == 2 and left > limits.hopeless * size:
            break
    return x, j + 1, False


def _rotate(H: Array, rotations: list[tuple[float, float]], rhs: Array, j: int) -> None:
    """Givens rotations that keep H triangular, applied to its column j and to the right-hand side."""
    for i, (c, s) in enumerate(rotations):
        H[i, j], H[i + 1, j] = c * H[i, j] + s * H[i + 1, j], -s * H[i, j] + c * H[i + 1, j]
    length = np.hypot(H[j, j], H[j + 1, j])
    c, s = (H[j, j] / length, H[j + 1, j] / length) if length else (1.0, 0.0)
    rotations.append((c, s))
    H[j, j], H[j + 1, j] = length, 0.0
    rhs[j], rhs[j + 1] = c * rhs[j], -s * rhs[j]
