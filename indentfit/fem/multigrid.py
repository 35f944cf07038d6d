"""The preconditioner for large meshes: one V-cycle of smoothed aggregation, pyamg's hierarchy and our own smoother.

Gauss-Seidel by node, forwards and backwards, in single precision and on threads. The rows are cut into RANGES, however many
threads there are; ranges that are not coupled are swept at once. So the result is the same, bit by bit, on any number of threads.
"""

import itertools

import numpy as np

from indentfit.fem.compiled import THREADS, compiled, on_threads

RANGES = 8  # of rows, swept one by one or, where they are not coupled, at once
WORTH_THREADS = 4_000_000  # values of a level's matrix from which a second thread pays


class Cycle:
    """r (n,) -> one V-cycle's approximation of A⁻¹ r.

    matrix: A (n, n), symmetric, BSR with a block of three for each node; near_null: rigid-body modes (n, 6).
    """

    def __init__(self, matrix, near_null):
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

    def __call__(self, r):
        return self._solve(0, r.astype(np.float32)).astype(float)

    def _solve(self, depth, b):
        if depth == len(self._levels):
            return self._coarsest @ b
        level = self._levels[depth]
        x = np.zeros_like(b)
        level.smooth(x, b)
        x += level.prolong @ self._solve(depth + 1, level.restrict @ level.residual(x, b))
        level.smooth(x, b)
        return x


class _Level:
    def __init__(self, level):
        A = level.A
        self.prolong, self.restrict = level.P.astype(np.float32), level.P.T.tocsr().astype(np.float32)
        self._sweep, self._residual = _KERNELS[A.blocksize[0]]
        self._indptr, self._indices, self._values = A.indptr, A.indices, np.ascontiguousarray(A.data.transpose(0, 2, 1), np.float32)
        self._inverse = _inverse_diagonal(A)
        self._groups = _independent(A)
        self._threads = THREADS if A.data.size > WORTH_THREADS else 1

    def smooth(self, x, b):
        """One symmetric sweep, in place."""
        for step in (1, -1):
            self._run(self._sweep, self._groups[::step], step, self._indptr, self._indices, self._values, self._inverse, b, x)

    def residual(self, x, b):
        """b - A x."""
        r = np.empty_like(b)
        self._run(self._residual, self._groups, self._indptr, self._indices, self._values, b, x, r)
        return r

    def _run(self, kernel, groups, *arguments):
        for group in groups:
            on_threads(self._threads, lambda rows: kernel(*rows, *arguments), group)


def _independent(A):
    """Groups of ranges (first, stop) of a BSR matrix' rows: those of a group are not coupled."""
    rows = A.shape[0] // A.blocksize[0]
    taken, groups = np.zeros(rows, dtype=np.int64), []
    for first, stop in itertools.pairwise(np.linspace(0, rows, RANGES + 1).astype(int)):
        used = np.bitwise_or.reduce(taken[A.indices[A.indptr[first] : A.indptr[stop]]], initial=0)
        group = next(n for n in range(RANGES) if not used >> n & 1)
        taken[first:stop] = 1 << group
        groups += [[]] if group == len(groups) else []
        groups[group].append((first, stop))
    return groups


def _inverse_diagonal(A):
    """Inverses (rows, s, s) of a BSR matrix' diagonal blocks."""
    blocks = np.zeros((A.shape[0] // A.blocksize[0], *A.blocksize))
    rows = np.repeat(np.arange(blocks.shape[0]), np.diff(A.indptr))
    on = rows == A.indices
    blocks[rows[on]] = A.data[on]
    return np.ascontiguousarray(np.linalg.pinv(blocks, rcond=1e-10, hermitian=True), np.float32)


def _kernels(size):
    """The loops for blocks of a size, which the compiler then knows: (sweep, residual)."""

    @compiled(fastmath=True)
    def sweep(first, stop, step, indptr, indices, values, inverse, b, x):
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
    def residual(first, stop, indptr, indices, values, b, x, r):
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

    return sweep, residual


_KERNELS = {size: _kernels(size) for size in (3, 6)}  # displacements; rigid-body modes of an aggregate
