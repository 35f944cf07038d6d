"""The linear solves of Newton's iteration: few factorisations, many uses of each.

The tangent of a nearly incompressible body in contact is K = A + kappa Bᵀ B + C: its isochoric part, the dilatation B of each
element, and the contact. GMRES solves it in the form with the pressures, [A + C, Bᵀ; B, -1/kappa], with one of two preconditioners.

Direct (PARDISO, SuperLU): a factor of an earlier K0 = A0 + kappa B0ᵀ B0, taken apart so that what changes most never makes it
useless.
- It solves the earlier form with pressures as well, x = K0⁻¹ (f + kappa B0ᵀ g), p = kappa (B0 x - g). The change of B from B0 then
  counts once, not times kappa; without this a step of 1 % strain spoils a factor at kappa/mu = 1000.
- PARDISO factorises in single precision, half the memory to read at each use, for GMRES takes out what that leaves. It gives the
  body's Schur complement S on the dofs of the contact, and S + C is factorised, dense, at every iteration:
  points may stick, slip or lift off without a new factor. (SuperLU's factor includes the contact that it was made with.)
So 2 to 8 steps of GMRES, a forward and a backward solve each, do where a factorisation costs as much as 30.

Iterative (pyamg): the augmented Lagrangian's block form. A + gamma Bᵀ B, gamma = SOFT shear moduli, is soft enough for smoothed
aggregation with the rigid-body modes, and makes the pressures' Schur complement nearly diagonal, 1/kappa + 1/(gamma + 3 mu). The
matrix is assembled with gamma in kappa's place, and has the contact as a symmetric one that is as stiff. Steps of GMRES grow little
with the mesh and with kappa (tests/test_linear.py).
"""

import contextlib
import ctypes
import importlib.metadata
import os
import sys
from dataclasses import dataclass, field

import numpy as np
import scipy.linalg as dense
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from indentfit.errors import ConvergenceError, InputError

MAX_KRYLOV = 15  # GMRES steps on a stale factor before a new one is cheaper
HOPELESS = 0.5  # what of the residual may be left after the first three of them
TOLERANCE = 1e-4  # relative residual of one solve inside a Newton iteration
OUTDATED = 5  # nodes of the contact in another state than the hierarchy's: each costs a step or two, a hierarchy 20
SOFT, SCHUR = 20.0, 3.0  # gamma and the body's own share in the pressures' Schur complement, in shear moduli
THREADS_PAY = 20_000  # dofs from which the solver library's threads gain more than they cost
# Dofs from which multigrid needs less time and memory: than PARDISO, and than SuperLU.
LARGE, LARGE_WITHOUT_PARDISO = 150_000, 20_000


@dataclass(frozen=True)
class Tangent:
    """A linear system in its parts.

    whole: (n, n), CSR with sorted indices and a full diagonal; body: the part that is factorised, symmetric (default: all of it);
    contact: C (n_s, n_s), dense, on the solver's surface dofs; dilatation: B (n_p, n), CSR; kappa: bulk modulus, kPa;
    bulk: the one that `whole` and `body` are assembled with: K = whole + (kappa - bulk) Bᵀ B; mu: a shear modulus, kPa.
    """

    whole: sp.csr_matrix
    body: sp.csr_matrix | None = field(default=None, repr=False)
    contact: np.ndarray | None = field(default=None, repr=False)
    dilatation: sp.csr_matrix | None = field(default=None, repr=False)
    kappa: float = 0.0
    bulk: float = 0.0
    mu: float = 0.0

    def product(self, x):
        """K x."""
        if self.dilatation is None or self.bulk == self.kappa:
            return self.whole @ x
        return self.whole @ x + self.dilatation.T @ ((self.kappa - self.bulk) * (self.dilatation @ x))


@dataclass
class Counts:
    """How much work the solver did."""

    factorizations: int = 0
    solves: int = 0
    krylov_iterations: int = 0


class LinearSolver:
    """Solves with tangents of one sparsity pattern.

    kind: "auto", "pardiso", "superlu" or "pyamg"; `name` says which one is used.
    near_null: rigid-body modes (n, 6) for pyamg; surface: dofs (n_s,) that the contact acts on; n_dofs: for the choice of "auto".
    """

    def __init__(self, kind="auto", near_null=None, surface=(), n_dofs=0):
        self.name = choice(kind, n_dofs)
        self.counts = Counts()
        surface = np.asarray(surface, dtype=int)
        makers = {"pardiso": lambda: _Pardiso(surface), "superlu": _SuperLU, "pyamg": lambda: _Multigrid(near_null, surface)}
        self._factor = makers[self.name]()
        self._fresh, self._steps_when_new = False, 0

    def bulk(self, kappa, mu):
        """The bulk modulus, kPa, that tangents should be assembled with."""
        return self._factor.bulk(kappa, mu)

    def forget(self):
        """Factorise again at the next solve."""
        self._fresh = False

    def solve(self, tangent, b, tolerance=None, enough=0.0):
        """x with |K x - b| <= tolerance |b|, b (n,); the default is what an iteration of Newton's needs.

        enough: the norm of K x - b that is small enough for Newton's own end; a solver whose steps are dear stops there.
        Raises ConvergenceError when the matrix is singular or holds NaN.
        """
        self.counts.solves += 1
        size = np.linalg.norm(b)
        if size == 0:
            return np.zeros_like(b)
        tolerance = tolerance or max(TOLERANCE, min(0.1, self._factor.dear * enough / size))
        if not (np.isfinite(size) and np.isfinite(tangent.whole.data.sum())):
            raise ConvergenceError("the tangent or the residual holds NaN or infinity")
        if self._fresh and not self._factor.outdated(tangent):
            x, count, ok = self._krylov(tangent, b, tolerance, self._factor.stale_patience)
            self._fresh = count <= self._factor.weary(self._steps_when_new)
            if ok:
                return x
        self._factorize(tangent)
        x, self._steps_when_new, ok = self._krylov(tangent, b, tolerance, self._factor.patience)
        if not ok and (sharper := self._factor.sharper()):
            self._factor, self._fresh = sharper, False
            return self.solve(tangent, b, tolerance)
        if not ok:
            raise ConvergenceError("the linear system could not be solved (singular tangent: lost support or instability)")
        return x

    def _factorize(self, tangent):
        self.counts.factorizations += 1
        self._fresh = False
        try:
            self._factor.factorize(tangent)
        except (RuntimeError, ValueError, np.linalg.LinAlgError) as error:
            raise ConvergenceError(f"{self.name} could not factorise the tangent ({error})") from error
        self._fresh = True

    def _krylov(self, tangent, b, tolerance, steps):
        """x, the steps it took and whether it is a solution, from GMRES on the form with pressures where the tangent has them."""
        form = _Condensed(tangent) if tangent.dilatation is None else _Mixed(tangent)
        x, count, ok = _gmres(form, self._factor.preconditioner(tangent), b, tolerance, steps, self._factor.hopeless)
        self.counts.krylov_iterations += count
        return x, count, ok


class _Condensed:
    """The system as it is."""

    def __init__(self, tangent):
        self.tangent = tangent

    def extended(self, b):
        return b

    def product(self, x):
        return self.tangent.product(x)

    def displacements(self, x):
        return x


class _Mixed:
    """The system with the pressures as unknowns of their own, (n + n_p,).

    Pressures are scaled by kappa: a residual of theirs then counts with about the force that it stands for.
    """

    def __init__(self, tangent):
        self.tangent, self.B, self.BT = tangent, tangent.dilatation, tangent.dilatation.T
        self.n = tangent.whole.shape[0]

    def extended(self, b):
        return np.concatenate([b, np.zeros(self.B.shape[0])])

    def product(self, x):
        kappa, bulk = self.tangent.kappa, self.tangent.bulk
        v, p = x[: self.n], x[self.n :] * kappa
        swell = self.B @ v
        return np.concatenate([self.tangent.whole @ v + self.BT @ (p - bulk * swell), kappa * swell - p])

    def displacements(self, x):
        return x[: self.n]


def _gmres(form, precondition, b, tolerance, steps, hopeless):
    """x, the number of steps and whether |K x - b| <= tolerance |b|: right-preconditioned GMRES (Saad and Schultz 1986).

    hopeless: share of the residual that may be left after three steps. The estimate is that of the form's own residual;
    where it is reached the true one is looked at, and the estimate sharpened.
    """
    r = form.extended(b)
    size = np.linalg.norm(r)
    wanted, passes = tolerance * size, 1 if tolerance >= TOLERANCE else 2  # Gram-Schmidt twice: sensitivities ask for 1e-9
    basis, corrections = np.empty((steps + 1, r.size)), np.empty((steps, r.size))  # memory is taken as rows are written
    basis[0] = r / size
    H, rotations, rhs = np.zeros((steps + 1, steps)), [], np.zeros(steps + 1)
    rhs[0], aim, x = size, wanted, np.zeros_like(b)
    for j in range(steps):
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
        elif j == 2 and left > hopeless * size:
            break
    return x, j + 1, False


def _rotate(H, rotations, rhs, j):
    """Givens rotations that keep H triangular, applied to its column j and to the right-hand side."""
    for i, (c, s) in enumerate(rotations):
        H[i, j], H[i + 1, j] = c * H[i, j] + s * H[i + 1, j], -s * H[i, j] + c * H[i + 1, j]
    length = np.hypot(H[j, j], H[j + 1, j])
    c, s = (H[j, j] / length, H[j + 1, j] / length) if length else (1.0, 0.0)
    rotations.append((c, s))
    H[j, j], H[j + 1, j] = length, 0.0
    rhs[j], rhs[j + 1] = c * rhs[j], -s * rhs[j]


# ---- the factors -------------------------------------------------------------------------------------------------


def choice(kind, n_dofs=0):
    """Name of the solver that "auto" stands for at a number of dofs: PARDISO where it is installed, else SuperLU; pyamg for large
    meshes.

    Raises InputError for "pardiso" where it is not installed.
    """
    if kind not in ("auto", "pardiso"):
        return kind
    os.getcwd()  # raises where the working folder is gone: MKL ends the process there
    with contextlib.suppress(ImportError, OSError):
        _pypardiso()
        return "pyamg" if kind == "auto" and n_dofs > LARGE else "pardiso"
    if kind == "pardiso":
        raise InputError('solver.linear = "pardiso": pypardiso is not installed here; use "auto" or "superlu"')
    return "pyamg" if n_dofs > LARGE_WITHOUT_PARDISO else "superlu"


def _pypardiso():
    """pypardiso, told where pip has put MKL: it would start ldconfig, a compiler and a linker to find it."""
    if "PYPARDISO_MKL_RT" not in os.environ and "pypardiso" not in sys.modules:
        with contextlib.suppress(importlib.metadata.PackageNotFoundError):
            for file in importlib.metadata.files("mkl") or ():
                if "mkl_rt" in file.name:
                    os.environ["PYPARDISO_MKL_RT"] = os.path.realpath(file.locate())
    return importlib.import_module("pypardiso")


class _Direct:
    """A stale factor as a preconditioner.

    Subclasses have _factorize(tangent), and _apply(tangent) -> (r -> (stale body and contact)⁻¹ r).
    """

    patience, stale_patience, hopeless = 30, MAX_KRYLOV, HOPELESS
    dear = False

    def bulk(self, kappa, mu):
        return kappa

    def weary(self, steps):
        """Steps of GMRES after which the factor shall be made anew, when it took so many just after it was made."""
        return np.inf  # a factor costs more than all it could save

    def outdated(self, tangent):
        """Whether a new factor is known to be cheaper."""
        return False

    def sharper(self):
        """The same with more exact factors, or None."""
        return None

    def factorize(self, tangent):
        self._factorize(tangent)
        self._kappa, self._B = tangent.kappa, tangent.dilatation

    def preconditioner(self, tangent):
        apply = self._apply(tangent)
        if tangent.dilatation is None:
            return apply
        n, kappa, kappa0, B, BT = tangent.whole.shape[0], tangent.kappa, self._kappa, self._B, self._B.T

        def with_pressures(r):
            g = r[n:] / kappa
            v = apply(r[:n] + BT @ (kappa0 * g))
            return np.concatenate([v, (B @ v - g) * (kappa0 / kappa)])

        return with_pressures


class _Pardiso(_Direct):
    """MKL PARDISO, symmetric indefinite, with the Schur complement of the body on the contact's dofs.

    One symbolic analysis for the pattern, then numerical factorisations only. pypardiso finds and loads the library; its
    classes have no Schur complement and copy the pattern at every call, so the routine is called from here.
    """

    _ANALYSIS, _FACTOR, _SOLVE, _FORWARD, _BACKWARD, _RELEASE = 11, 22, 33, 331, 333, -1
    _SYMMETRIC_INDEFINITE = -2

    def __init__(self, surface, kind=np.float32):
        os.getcwd()  # as above: MKL loads its parts late
        self._routine = _pypardiso().PyPardisoSolver()._mkl_pardiso
        self._surface = surface
        self._handle = np.zeros(64, dtype=np.int64)
        self._settings = np.zeros(64, dtype=np.int32)
        # own values; METIS; perturb pivots below 1e-8; Bunch-Kaufman pivots
        self._settings[[0, 1, 9, 20]] = 1, 2, 8, 1
        self._settings[35] = 2 if surface.size else 0  # Schur complement together with the whole factor
        self._kind, self._settings[27] = kind, kind is np.float32
        self._upper = None

    def sharper(self):
        return _Pardiso(self._surface, np.float64) if self._kind is np.float32 else None

    def _factorize(self, tangent):
        body = tangent.whole if tangent.body is None else tangent.body
        first = self._upper is None
        if first:
            self._analyse(body)
            self._settings[23] = body.shape[0] >= THREADS_PAY  # two-level factors: threads share in their use, not only in making
        self._values = body.data[self._upper].astype(self._kind)
        if first:
            self._call(self._ANALYSIS)
        S = self._call(self._FACTOR)[: self._surface.size**2]
        self._interface = _Interface(S.reshape(self._surface.size, self._surface.size).astype(float))

    def _apply(self, tangent):
        if tangent.contact is None or not self._surface.size:
            return lambda r: self._call(self._SOLVE, r)[: r.size]
        surface, together = self._surface, self._interface.inverse(tangent.contact)

        def apply(r):
            x = self._call(self._FORWARD, r)[: r.size]
            x[surface] = together(x[surface])
            return self._call(self._BACKWARD, x)[: r.size]

        return apply

    def _analyse(self, body):
        n = body.shape[0]
        rows = np.repeat(np.arange(n, dtype=np.int32), np.diff(body.indptr))
        self._upper = np.flatnonzero(body.indices >= rows)
        lengths = np.bincount(rows[self._upper], minlength=n)
        self._indptr = (np.concatenate([[0], np.cumsum(lengths)]) + 1).astype(np.int32)
        self._indices = body.indices[self._upper].astype(np.int32) + 1
        self._marks = np.zeros(n, dtype=np.int32)
        self._marks[self._surface] = 1

    def _call(self, phase, b=None):
        n = self._indptr.size - 1
        x = np.zeros(max(n, self._surface.size**2 if phase == self._FACTOR else 0), dtype=self._kind)
        b = np.zeros(n, dtype=self._kind) if b is None else b.astype(self._kind)
        error = ctypes.c_int32(0)

        def number(value):
            return ctypes.byref(ctypes.c_int32(value))

        def place(array, kind=ctypes.c_int32):
            return array.ctypes.data_as(ctypes.POINTER(kind))

        self._routine(
            place(self._handle, ctypes.c_int64), number(1), number(1), number(self._SYMMETRIC_INDEFINITE), number(phase), number(n),
            place(self._values), place(self._indptr), place(self._indices), place(self._marks), number(1), place(self._settings),
            number(0), place(b), place(x), ctypes.byref(error),
        )  # fmt: skip
        if error.value:
            raise RuntimeError(f"PARDISO error {error.value} in phase {phase}")
        return x

    def __del__(self):
        if getattr(self, "_upper", None) is not None:
            with contextlib.suppress(Exception):
                self._call(self._RELEASE)


class _Interface:
    """The dense system S + C on the surface: factors at some C, and a correction on the dofs where it has changed since.

    From one iteration to the next few points stick, slip or lift off
    (Woodbury: (M + E D Eᵀ)⁻¹ = M⁻¹ - M⁻¹ E (1 + D Eᵀ M⁻¹ E)⁻¹ D Eᵀ M⁻¹).
    """

    UNCHANGED = 1e-3  # change of an entry, of the largest, that is left to GMRES
    FEW = 0.15  # share of the dofs up to which the correction is cheaper than new factors

    def __init__(self, S):
        self.S, self.C = S, None

    def inverse(self, C):
        """r -> (S + C)⁻¹ r, up to small changes of C; infinities where it is singular, which the caller's residual shows."""
        change = None if self.C is None else C - self.C
        dofs = None if change is None else np.flatnonzero(np.abs(change).max(axis=0) > self.UNCHANGED * np.abs(C).max(initial=0))
        if dofs is None or dofs.size > self.FEW * C.shape[0]:
            lu, pivots, _ = dense.lapack.dgetrf(self.S + C)
            self.C, self._lu = C, (lu, pivots)
            return self._solved
        if not dofs.size:
            return self._solved
        unit = np.zeros((C.shape[0], dofs.size))
        unit[dofs, np.arange(dofs.size)] = 1
        W, D = self._solved(unit), change[np.ix_(dofs, dofs)]
        small = dense.lapack.dgetrf(np.eye(dofs.size) + D @ W[dofs])[:2]

        def corrected(r):
            x = self._solved(r)
            return x - W @ dense.lu_solve(small, D @ x[dofs], check_finite=False)

        return corrected

    def _solved(self, r):
        with np.errstate(all="ignore"):
            return dense.lu_solve(self._lu, r, check_finite=False)


class _SuperLU(_Direct):
    def _factorize(self, tangent):
        options = {"SymmetricMode": True}
        self._lu = spla.splu(tangent.whole.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.01, options=options)

    def _apply(self, tangent):
        return self._lu.solve


class _Multigrid:
    """One V-cycle on body and contact at gamma, and the pressures' Schur complement as a diagonal.

    Friction that slips makes the contact unsymmetric: its tangential force follows the pressure. A smoother diverges on that, or
    nearly so. The cycle has a symmetric contact that gives each node as large a force; the turn is left to GMRES.
    """

    patience, stale_patience, hopeless = 200, 120, np.inf
    dear = True  # even so TOLERANCE is not 1e-3, which saves a fifth of the steps: not every path is then a direct solver's

    def __init__(self, near_null, surface):
        self._near_null, self._nodes = near_null, surface[::3] // 3
        self._contact = np.zeros((self._nodes.size, 3, 3))

    def sharper(self):
        return None

    def bulk(self, kappa, mu):
        return min(kappa, SOFT * mu)

    def weary(self, steps):
        return 1.3 * steps  # the body has moved far from the hierarchy's

    def outdated(self, tangent):
        """Whether so many points stick, slip or touch that did not that a new hierarchy is cheaper than the steps they take."""
        if tangent.contact is None or not self._nodes.size:
            return False
        new = self._stretched(tangent.contact)
        size = np.maximum(np.abs(new).max(axis=(1, 2)), np.abs(self._contact).max(axis=(1, 2)))
        return np.sum(np.abs(new - self._contact).max(axis=(1, 2)) > 0.1 * size) > OUTDATED

    def factorize(self, tangent):
        from indentfit.fem.multigrid import Cycle

        self._cycle = Cycle(self._symmetric(tangent), self._near_null)

    def _symmetric(self, tangent):
        """The body with a symmetric contact, a BSR matrix of nodes."""
        if tangent.contact is None or not self._nodes.size:
            return sp.bsr_matrix(tangent.whole, blocksize=(3, 3))
        matrix = sp.bsr_matrix(tangent.whole if tangent.body is None else tangent.body, blocksize=(3, 3))
        rows = np.repeat(np.arange(matrix.shape[0] // 3), np.diff(matrix.indptr))
        self._contact = self._stretched(tangent.contact)
        matrix.data[np.flatnonzero(rows == matrix.indices)[self._nodes]] += self._contact
        return matrix

    def _stretched(self, contact):
        """The symmetric factors (n_n, 3, 3) of the polar decompositions of a contact's blocks: its points are nodes."""
        each = np.arange(self._nodes.size)
        _, stretch, axes = np.linalg.svd(contact.reshape(each.size, 3, each.size, 3)[each, :, each])
        return np.einsum("nki,nk,nkj->nij", axes, stretch, axes)

    def preconditioner(self, tangent):
        if tangent.dilatation is None:
            return self._cycle
        n, kappa, bulk, B, BT = tangent.whole.shape[0], tangent.kappa, tangent.bulk, tangent.dilatation, tangent.dilatation.T
        flexibility = 1 / kappa + 1 / (bulk + SCHUR * tangent.mu)

        def with_pressures(r):
            g = r[n:] / kappa
            v = self._cycle(r[:n] + BT @ (bulk * g))
            return np.concatenate([v, (B @ v - g) / (flexibility * kappa)])

        return with_pressures


def rigid_body_modes(points):
    """The six rigid-body modes (3 n, 6) of n nodes at points (3, n), dofs interleaved."""
    x, y, z = points
    modes = np.zeros((points.shape[1], 3, 6))
    modes[:, 0, 0] = modes[:, 1, 1] = modes[:, 2, 2] = 1
    modes[:, 0, 3], modes[:, 1, 3] = -y, x
    modes[:, 1, 4], modes[:, 2, 4] = -z, y
    modes[:, 2, 5], modes[:, 0, 5] = -x, z
    return modes.reshape(-1, 6)
