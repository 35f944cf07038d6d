"""A linear system in its parts: body, contact and dilatation."""

from dataclasses import dataclass, field

import numpy as np
import scipy.sparse as sp

from indentfit.arrays import Array


@dataclass(frozen=True)
class Tangent:
    """The matrix K (n, n) of one linear solve, K = whole + (kappa - bulk) Bᵀ B.

    Parameters
    ----------
    whole : CSR matrix (n, n), mN/mm
        Body and contact, with sorted indices and a full diagonal.
    body : CSR matrix (n, n), mN/mm
        The part that is factorised, symmetric; all of `whole` where it is not given.
    contact : array (n_s, n_s), mN/mm
        The contact's part on the solver's surface dofs, dense.
    dilatation : CSR matrix (n_p, n)
        B, the derivative of the pressure modes of J by the displacements.
    kappa : float, or array (n_p,), kPa
        Bulk modulus; an array has that of each pressure mode.
    bulk : float, or array (n_p,), kPa
        The bulk modulus that `whole` and `body` are assembled with.
    mu : float, or array (n_p,), kPa
        A shear modulus.
    """

    whole: sp.csr_matrix
    body: sp.csr_matrix | None = field(default=None, repr=False)
    contact: Array | None = field(default=None, repr=False)
    dilatation: sp.csr_matrix | None = field(default=None, repr=False)
    kappa: float | Array = 0.0
    bulk: float | Array = 0.0
    mu: float | Array = 0.0

    @property
    def factorised(self) -> sp.csr_matrix:
        """The part that a factor is made of."""
        return self.whole if self.body is None else self.body

    def product(self, x: Array) -> Array:
        """K x (n,)."""
        if self.dilatation is None or self.as_stiff:
            return self.whole @ x
        rest = np.reshape(self.kappa - self.bulk, (-1, *(1,) * (x.ndim - 1)))
        return self.whole @ x + self.dilatation.T @ (rest * (self.dilatation @ x))

    @property
    def as_stiff(self) -> bool:
        """Whether the matrix is assembled with the bulk modulus itself."""
        return bool(np.all(self.bulk == self.kappa))
