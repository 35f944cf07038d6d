"""Sparse linear solves behind one call: MKL PARDISO where installed, SuperLU, or pyamg.

Factorising dominates everything else, so one factorisation serves many solves: while it is not too old it is the
preconditioner of GMRES on the current matrix, which still gives the current matrix's solution.
"""

import contextlib
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from indentfit.errors import ConvergenceError, InputError

MAX_KRYLOV = 8  # GMRES steps on a stale factor before a new one is cheaper
HOPELESS = 0.3  # relative residual of one solve with a stale factor above which GMRES would take too many steps
TOLERANCE = 1e-4  # relative residual of one solve inside a Newton iteration


@dataclass
class Counts:
    """How much work the solver did."""

    factorizations: int = 0
    solves: int = 0
    krylov_iterations: int = 0


class LinearSolver:
    """Solves with matrices of one sparsity pattern.

    kind: "auto", "pardiso", "superlu" or "pyamg"; `name` says which one is used.
    near_null: rigid-body modes (n, 6) for pyamg.
    """

    def __init__(self, kind="auto", near_null=None):
        self.name = _available(kind)
        self.counts = Counts()
        self._factor = {"pardiso": _Pardiso, "superlu": _SuperLU, "pyamg": lambda: _Pyamg(near_null)}[self.name]()
        self._fresh = False

    def forget(self):
        """Factorise again at the next solve."""
        self._fresh = False

    def solve(self, A, b, tolerance=TOLERANCE):
        """x with |A x - b| <= tolerance |b|, A a CSR matrix with sorted indices and a full diagonal.

        Raises ConvergenceError when the matrix is singular or holds NaN.
        """
        self.counts.solves += 1
        size = np.linalg.norm(b)
        if size == 0:
            return np.zeros_like(b)
        if not (np.isfinite(size) and np.isfinite(A.data.sum())):
            raise ConvergenceError("the tangent or the residual holds NaN or infinity")
        if self._fresh:
            x, ok = self._krylov(A, b, size, tolerance, MAX_KRYLOV)
            if ok:
                return x
        self._factorize(A)
        x, ok = self._krylov(A, b, size, tolerance, self._factor.patience)
        if not ok:
            raise ConvergenceError("the linear system could not be solved (singular tangent: lost support or instability)")
        return x

    def _factorize(self, A):
        self.counts.factorizations += 1
        self._fresh = False
        try:
            self._factor.factorize(A)
        except (RuntimeError, ValueError, np.linalg.LinAlgError) as error:
            raise ConvergenceError(f"{self.name} could not factorise the tangent ({error})") from error
        self._fresh = True

    def _krylov(self, A, b, size, tolerance, steps):
        x = self._factor.solve(b)
        if not np.isfinite(x).all():
            return x, False
        left = np.linalg.norm(A @ x - b) / size
        if left <= tolerance:
            return x, True
        if left > HOPELESS and steps == MAX_KRYLOV:
            return x, False
        M = spla.LinearOperator(A.shape, self._factor.solve, dtype=float)
        counter = _Counter()
        x, _ = spla.gmres(A, b, M=M, rtol=tolerance * 0.5, restart=steps, maxiter=1, callback=counter, callback_type="pr_norm")
        self.counts.krylov_iterations += counter.count
        return x, bool(np.linalg.norm(A @ x - b) <= tolerance * size)


class _Counter:
    def __init__(self):
        self.count = 0

    def __call__(self, _):
        self.count += 1


def _available(kind):
    if kind in ("auto", "pardiso"):
        with contextlib.suppress(ImportError, OSError):
            import pypardiso  # noqa: F401

            return "pardiso"
        if kind == "pardiso":
            raise InputError('solver.linear = "pardiso": pypardiso is not installed here; use "auto" or "superlu"')
        return "superlu"
    return kind


class _Pardiso:
    """MKL PARDISO, unsymmetric; one symbolic analysis for the pattern, then numerical factorisations only."""

    patience = 20

    def __init__(self):
        import pypardiso

        self._error = pypardiso.pardiso_wrapper.PyPardisoError
        self._solver = pypardiso.PyPardisoSolver(mtype=11)
        self._matrix = None

    def factorize(self, A):
        with _as_runtime_error(self._error):
            if self._matrix is None:
                self._solver._check_A(A)
                self._call(A, 11, np.zeros(A.shape[0]))
            self._matrix = A.copy()
            self._call(self._matrix, 22, np.zeros(A.shape[0]))

    def solve(self, b):
        with _as_runtime_error(self._error):
            return self._call(self._matrix, 33, np.ascontiguousarray(b))

    def _call(self, A, phase, b):
        self._solver.set_phase(phase)
        return self._solver._call_pardiso(A, b)

    def __del__(self):
        if getattr(self, "_matrix", None) is not None:
            with contextlib.suppress(Exception):
                self._solver.free_memory(everything=True)


@contextlib.contextmanager
def _as_runtime_error(kind):
    try:
        yield
    except kind as error:
        raise RuntimeError(str(error)) from error


class _SuperLU:
    patience = 20

    def factorize(self, A):
        self._lu = spla.splu(A.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.01, options={"SymmetricMode": True})

    def solve(self, b):
        return self._lu.solve(b)


class _Pyamg:
    """GMRES preconditioned by one V-cycle of smoothed aggregation with the rigid-body modes.

    It treats the pressure only as part of the condensed matrix: expect some hundred iterations at kappa/mu = 1000.
    """

    patience = 600

    def __init__(self, near_null):
        self._near_null = near_null

    def factorize(self, A):
        import pyamg

        blocks = sp.bsr_matrix(A, blocksize=(3, 3))
        levels = pyamg.smoothed_aggregation_solver(
            blocks,
            B=self._near_null,
            strength=("symmetric", {"theta": 0.0}),
            smooth=("energy", {"maxiter": 2, "degree": 1}) if A.shape[0] < 20_000 else "jacobi",
            max_coarse=500,
        )
        self._cycle = levels.aspreconditioner(cycle="V")

    def solve(self, b):
        return self._cycle @ b


def rigid_body_modes(points):
    """The six rigid-body modes (3 n, 6) of n nodes at points (3, n), dofs interleaved."""
    x, y, z = points
    modes = np.zeros((points.shape[1], 3, 6))
    modes[:, 0, 0] = modes[:, 1, 1] = modes[:, 2, 2] = 1
    modes[:, 0, 3], modes[:, 1, 3] = -y, x
    modes[:, 1, 4], modes[:, 2, 4] = -z, y
    modes[:, 2, 5], modes[:, 0, 5] = -x, z
    return modes.reshape(-1, 6)
