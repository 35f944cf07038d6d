"""The preconditioner for large meshes: multigrid on body and contact, in the augmented Lagrangian's block form.

A + gamma Bᵀ B, gamma = SOFT shear moduli, is soft enough for smoothed aggregation with the rigid-body modes, and makes the
pressures' Schur complement nearly diagonal, 1/kappa + 1/(gamma + 3 mu). The matrix is assembled with gamma in kappa's place, and
has the contact as a symmetric one that is as stiff. Steps of GMRES grow little with the mesh and with kappa (tests/test_linear.py).

The cycle is one V-cycle of smoothed aggregation: pyamg's hierarchy and our own smoother, Gauss-Seidel by node, forwards and
backwards, in single precision and on threads. The rows are cut into RANGES, however many threads there are; ranges that are not
coupled are swept at once. So the result is the same, bit by bit, on any number of threads.
"""

import itertools
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import numpy as np
import scipy.sparse as sp

from indentfit.arrays import Array, Ints
from indentfit.compiled import THREADS, compiled, on_threads
from indentfit.fem.linear.factor import Apply, Moduli, OnSurface
from indentfit.fem.linear.tangent import Tangent

OUTDATED = 5  # nodes of the contact in another state than the hierarchy's: each costs a step or two, a hierarchy 20
SOFT, SCHUR = 20.0, 3.0  # gamma and the body's own share in the pressures' Schur complement, in shear moduli
RANGES = 8  # of rows, swept one by one or, where they are not coupled, at once
WORTH_THREADS = 4_000_000  # values of a level's matrix from which a second thread pays
Rows = tuple[int, int]  # first and stop of a range of rows


class Multigrid:
    """A Factoriser whose factors are V-cycles.

    Friction that slips makes the contact unsymmetric: its tangential force follows the pressure. A smoother diverges on that, or
    nearly so. The cycle has a symmetric contact that gives each node as large a force; the turn is left to GMRES.

    near_null: rigid-body modes (n, 6); surface: dofs (n_s,) of the nodes that the contact acts on.
    """

    name = "pyamg"
    patience, stale_patience, hopeless = 200, 120, np.inf
    dear = True  # even so krylov.TOLERANCE is not 1e-3, which saves a fifth of the steps: not every path is then a direct solver's

    def __init__(self, near_null: Array | None, surface: Ints) -> None:
        self._near_null, self._nodes = near_null, surface[::3] // 3

    def sharper(self) -> None:
        """None."""
        return None

    def bulk(self, kappa: float, mu: float) -> float:
        """gamma."""
        return min(kappa, SOFT * mu)

    def weary(self, steps: int) -> float:
        """A third more: the body has then moved far from the hierarchy's."""
        return 1.3 * steps

    def factorize(self, tangent: Tangent) -> "MultigridFactor":
        """A hierarchy for the body with a symmetric contact."""
        if tangent.contact is None or not self._nodes.size:
            return MultigridFactor(Cycle(sp.bsr_matrix(tangent.whole, blocksize=(3, 3)), self._near_null), self._nodes)
        matrix, contact = sp.bsr_matrix(tangent.factorised, blocksize=(3, 3)), stretched(tangent.contact)
        rows = np.repeat(np.arange(matrix.shape[0] // 3), np.diff(matrix.indptr))
        matrix.data[np.flatnonzero(rows == matrix.indices)[self._nodes]] += contact
        return MultigridFactor(Cycle(matrix, self._near_null), self._nodes, contact)


@dataclass(frozen=True, eq=False)
class MultigridFactor:
    """One V-cycle on body and contact at gamma, and the pressures' Schur complement as a diagonal.

    nodes: those that the contact acts on (n_n,); contact: the symmetric one (n_n, 3, 3), mN/mm, that the cycle was made with.
    """

    cycle: "Cycle" = field(repr=False)
    nodes: Ints
    contact: Array | None = None
    light, goes_around, dilatation = False, False, None

    def around(self, solve: OnSurface, kappa: Moduli, bulk: Moduli, mu: Moduli) -> Apply:
        """It does not go around: there is no Schur complement."""
        raise NotImplementedError

    def inverse_of(self, tangent: Tangent) -> None:
        """None: a cycle is far from the inverse."""
        return None

    def outdated(self, tangent: Tangent) -> bool:
        """Whether so many points stick, slip or touch that did not that a new hierarchy is cheaper than the steps they take."""
        if tangent.contact is None or not self.nodes.size:
            return False
        new = stretched(tangent.contact)
        old = np.zeros_like(new) if self.contact is None else self.contact
        size = np.maximum(np.abs(new).max(axis=(1, 2)), np.abs(old).max(axis=(1, 2)))
        return bool(np.sum(np.abs(new - old).max(axis=(1, 2)) > 0.1 * size) > OUTDATED)

    def preconditioner(self, tangent: Tangent) -> Apply:
        """The cycle, and with pressures their Schur complement after it."""
        if tangent.dilatation is None:
            return self.cycle
        n, kappa, bulk, B, BT = tangent.whole.shape[0], tangent.kappa, tangent.bulk, tangent.dilatation, tangent.dilatation.T
        flexibility = 1 / kappa + 1 / (bulk + SCHUR * tangent.mu)

        def with_pressures(r: Array) -> Array:
            g = r[n:] / kappa
            v = self.cycle(r[:n] + BT @ (bulk * g))
            return np.concatenate([v, (B @ v - g) / (flexibility * kappa)])

        return with_pressures


def stretched(contact: Array) -> Array:
    """The symmetric factors (n_n, 3, 3) of the polar decompositions of a dense contact's diagonal blocks: its points are nodes."""
    each = np.arange(contact.shape[0] // 3)
    _, stretch, axes = np.linalg.svd(contact.reshape(each.size, 3, each.size, 3)[each, :, each])
    return np.einsum("nki,nk,nkj->nij", axes, stretch, axes)


def rigid_body_modes(points: Array) -> Array:
    """The six rigid-body modes (3 n, 6) of n nodes at points (3, n), dofs interleaved."""
    x, y, z = points
    modes = np.zeros((points.shape[1], 3, 6))
    modes[:, 0, 0] = modes[:, 1, 1] = modes[:, 2, 2] = 1
    modes[:, 0, 3], modes[:, 1, 3] = -y, x
    modes[:, 1, 4], modes[:, 2, 4] = -z, y
    modes[:, 2, 5], modes[:, 0, 5] = -x, z
    return modes.reshape(-1, 6)


class Cycle:
    """r (n,) -> one V-cycle's approximation of A⁻¹ r.

    matrix: A (n, n), symmetric, BSR with a block of three for each node; near_null: rigid-body modes (n, 6).
    """

    def __init__(self, matrix: sp.bsr_matrix, near_null: Array | None) -> None:
        import pyamg

        drawn = np.random.get_state()
        np.random.seed(0)  # pyamg estimates spectral radii from random vectors: the same ones each time
        try:
            levels = pyamg.smoothed_aggregation_solver(
                matrix,
                B=near_null,
                strength=("symmetric", {"theta": 0.0}),
                smooth="jacobi",
                improve_candidates=None,
                max_coarse=100,
            ).levels
        finally:
            np.random.set_state(drawn)
        self._levels = [_Level(level) for level in levels[:-1]]
        self._coarsest = np.linalg.pinv(levels[-1].A.toarray()).astype(np.float32)

    def __call__(self, r: Array) -> Array:
        return self._solve(0, r.astype(np.float32)).astype(float)

    def _solve(self, depth: int, b: Any) -> Any:
        if depth == len(self._levels):
            return self._coarsest @ b
        level = self._levels[depth]
        x = np.zeros_like(b)
        level.smooth(x, b)
        x += level.prolong @ self._solve(depth + 1, level.restrict @ level.residual(x, b))
        level.smooth(x, b)
        return x


class _Level:
    """One level of a pyamg hierarchy, in single precision, its rows cut into groups of ranges that are not coupled."""

    def __init__(self, level: Any) -> None:
        A = level.A
        self.prolong, self.restrict = level.P.astype(np.float32), level.P.T.tocsr().astype(np.float32)
        self._loops = _KERNELS[A.blocksize[0]]
        self._indptr, self._indices, self._values = A.indptr, A.indices, np.ascontiguousarray(A.data.transpose(0, 2, 1), np.float32)
        self._inverse = _inverse_diagonal(A)
        self._groups = _independent(A)
        self._threads = THREADS if A.data.size > WORTH_THREADS else 1

    def smooth(self, x: Any, b: Any) -> None:
        """One symmetric sweep, in place."""
        for step in (1, -1):
            self._run(self._loops.sweep, self._groups[::step], step, self._indptr, self._indices, self._values, self._inverse, b, x)

    def residual(self, x: Any, b: Any) -> Any:
        """b - A x."""
        r = np.empty_like(b)
        self._run(self._loops.residual, self._groups, self._indptr, self._indices, self._values, b, x, r)
        return r

    def _run(self, kernel: Callable[..., None], groups: Iterable[list[Rows]], *arguments: Any) -> None:
        for group in groups:
            on_threads(self._threads, lambda rows: kernel(*rows, *arguments), group)


def _independent(A: sp.bsr_matrix) -> list[list[Rows]]:
    """Groups of ranges (first, stop) of a BSR matrix' rows: those of a group are not coupled."""
    rows = A.shape[0] // A.blocksize[0]
    taken = np.zeros(rows, dtype=np.int64)
    groups: list[list[Rows]] = []
    for first, stop in itertools.pairwise(np.linspace(0, rows, RANGES + 1).astype(int)):
        used = np.bitwise_or.reduce(taken[A.indices[A.indptr[first] : A.indptr[stop]]], initial=0)
        group = next(n for n in range(RANGES) if not used >> n & 1)
        taken[first:stop] = 1 << group
        groups += [[]] if group == len(groups) else []
        groups[group].append((first, stop))
    return groups


def _inverse_diagonal(A: sp.bsr_matrix) -> Any:
    """Inverses (rows, s, s) of a BSR matrix' diagonal blocks."""
    blocks = np.zeros((A.shape[0] // A.blocksize[0], *A.blocksize))
    rows = np.repeat(np.arange(blocks.shape[0]), np.diff(A.indptr))
    on = rows == A.indices
    blocks[rows[on]] = A.data[on]
    return np.ascontiguousarray(np.linalg.pinv(blocks, rcond=1e-10, hermitian=True), np.float32)


def _kernels(size: int) -> SimpleNamespace:
    """The loops `sweep` and `residual` for blocks of a size, which the compiler then knows."""

    @compiled(fastmath=True)
    def sweep(first: Any, stop: Any, step: Any, indptr: Any, indices: Any, values: Any, inverse: Any, b: Any, x: Any) -> None:
        left = np.empty(size, dtype=np.float32)
        for place in range(stop - first):
            i = first + place if step > 0 else stop - 1 - place
            for a in range(size):
                left[a] = b[size * i + a]
            for k in range(indptr[i], indptr[i + 1]):
                j = indices[k]
                if j != i:
                    for c in range(size):
                        value = x[size * j + c]
                        for a in range(size):
                            left[a] -= values[k, c, a] * value
            for a in range(size):
                x[size * i + a] = 0
            for c in range(size):
                for a in range(size):
                    x[size * i + a] += inverse[i, c, a] * left[c]

    @compiled(fastmath=True)
    def residual(first: Any, stop: Any, indptr: Any, indices: Any, values: Any, b: Any, x: Any, r: Any) -> None:
        left = np.empty(size, dtype=np.float32)
        for i in range(first, stop):
            for a in range(size):
                left[a] = b[size * i + a]
            for k in range(indptr[i], indptr[i + 1]):
                for c in range(size):
                    value = x[size * indices[k] + c]
                    for a in range(size):
                        left[a] -= values[k, c, a] * value
            for a in range(size):
                r[size * i + a] = left[a]

    return SimpleNamespace(sweep=sweep, residual=residual)


_KERNELS = {size: _kernels(size) for size in (3, 6)}  # displacements; rigid-body modes of an aggregate
