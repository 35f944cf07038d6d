"""Displacements that are held at zero, and the size of each dof's share of a body."""

from typing import Any

import numpy as np
import scipy.sparse as sp

from indentfit.arrays import Array, Ints
from indentfit.fem.body import Body


class Fixed:
    """Dofs (n_fixed,) held at zero, as identity rows and columns of the tangent.

    Attributes
    ----------
    diagonal : array (n,)
        Places of the tangent's diagonal in the CSR values.
    sizes : array (n,), mm
        Cube root of each dof's share of the volume.
    """

    def __init__(self, body: Body, dofs: Ints) -> None:
        self.dofs = np.unique(dofs)
        held = np.zeros(body.n_dofs, dtype=bool)
        held[self.dofs] = True
        rows = np.repeat(np.arange(body.n_dofs, dtype=np.int32), np.diff(body.indptr))
        self._entries = np.flatnonzero(held[rows] | held[body.indices])
        self._is_held = held
        n_el, n_m = body.means.shape
        columns = np.broadcast_to(body.dofs.reshape(n_el, 1, -1), (n_el, n_m, body.dofs[0].size)).astype(np.int32)
        self._columns, self._moving = columns.ravel(), ~held[columns.ravel()]
        self._starts = np.arange(n_el * n_m + 1, dtype=np.int32) * body.dofs[0].size
        self.diagonal = np.flatnonzero(rows == body.indices)
        self._held, self._free = self.diagonal[held], self.diagonal[~held]
        self.sizes = _sizes(body)

    def dilatation(self, values: Array) -> sp.csr_matrix:
        """CSR matrix (n_el * n_m, n) of a dilatation map (n_el, n_m, n_n, k), without the held dofs."""
        shape = (self._starts.size - 1, self._is_held.size)
        return sp.csr_matrix((values.ravel() * self._moving, self._columns, self._starts), shape=shape, copy=False)

    def freed(self, values: Array) -> Array:
        """Values (n, ...) with those of the held dofs zeroed, in place."""
        values[self.dofs] = 0
        return values

    def without(self, matrix: Array, dofs: Ints) -> Array:
        """A dense matrix on dofs with the rows and columns of held dofs zeroed, in place."""
        held = np.flatnonzero(self._is_held[dofs])
        matrix[held], matrix[:, held] = 0, 0
        return matrix

    def restore(self, values: Array, constrained: Array) -> None:
        """Put the held rows and columns of CSR values `constrained` into `values`."""
        values[self._entries] = 0
        values[self._held] = constrained[self._held]

    def constrain(self, residual: Array, values: Array) -> None:
        """Zero the held rows and columns in place and put a typical stiffness on their diagonal."""
        residual[self.dofs] = 0
        values[self._entries] = 0
        values[self._held] = np.mean(np.abs(values[self._free]))


def _sizes(body: Body) -> Any:
    """Cube root (n,) of each dof's share of the volume, mm."""
    shares = np.zeros(body.n_dofs)
    np.add.at(shares, body.dofs, (body.volume / body.dofs.shape[1])[:, None, None])
    return np.cbrt(shares)
