"""MKL PARDISO, with the Schur complement of the body on the contact's dofs.

PARDISO factorises in single precision, half the memory to read at each use, for GMRES takes out what that leaves. It gives the
body's Schur complement S on the dofs of the contact, and S + C is factorised, dense, at every iteration: points may stick, slip or
lift off without a new factor.
"""

import contextlib
import ctypes
import functools
import importlib
import importlib.metadata
import os
import sys
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg as dense
import scipy.sparse as sp

from indentfit.arrays import Array, Bools, Ints
from indentfit.fem.linear.direct import STIFFEST, DirectFactor, DirectFactoriser
from indentfit.fem.linear.factor import Apply, OnSurface
from indentfit.fem.linear.tangent import Tangent

THREADS_PAY = 20_000  # dofs from which the library's threads gain more than they cost
# Numbers of a factor for each dof, up to which making a factor costs less than the 7 to 9 steps that an earlier one would take. In
# the meridian plane a factor of 900 dofs costs as much as 3 steps, one of 6,000 dofs as much as 5; that of bricks costs 30.
CHEAP_FILL = 80
# Up to here each equilibrium has a factor of its own: it serves the derivatives, and saves the next step iterations. A factor of
# 4,000 dofs costs as much as 15 uses of it, one of 28,000 dofs (fill 650) as much as 45.
LIGHT_FILL = 500
# Bulk over shear modulus that a factor in double precision holds: a sample that keeps its volume exactly has 2e5. One that holds a
# part of it, in single precision, took four times as many iterations in the meridian plane, which cannot solve the contact first.
STIFFEST_SMALL = 1e6
ANALYSIS, FACTOR, SOLVE, FORWARD, BACKWARD, RELEASE = 11, 22, 33, 331, 333, -1
SYMMETRIC_INDEFINITE = -2
FILL = 17  # place of the number of non-zeros in the factors among PARDISO's settings


def load() -> Any:
    """pypardiso, told where pip has put MKL: it would start ldconfig, a compiler and a linker to find it.

    Raises
    ------
    ImportError, OSError
        Where pypardiso or MKL is not installed.
    """
    if "PYPARDISO_MKL_RT" not in os.environ and "pypardiso" not in sys.modules:
        with contextlib.suppress(importlib.metadata.PackageNotFoundError):
            for file in importlib.metadata.files("mkl") or ():
                if "mkl_rt" in file.name:
                    os.environ["PYPARDISO_MKL_RT"] = os.path.realpath(file.locate())
    return importlib.import_module("pypardiso")


class Pardiso(DirectFactoriser):
    """Factors of bodies with one sparsity pattern: one symbolic analysis, then numerical factorisations only.

    surface: dofs (n_s,) that the contact acts on; held: dofs (n_h,) whose rows and columns are zero beside the diagonal; kind:
    precision of the factors, np.float32 or np.float64; small: whether factors are so small that those of stiff tangents are made in
    double precision.
    """

    name = "pardiso"

    def __init__(self, surface: Ints, held: Ints, kind: type = np.float32, small: bool = False) -> None:
        os.getcwd()  # raises where the working folder is gone: MKL, which loads its parts late, ends the process there
        self._surface, self._held, self._kind, self._small = surface, held, kind, small
        self._library: _Library | None = None

    def bulk(self, kappa: float, mu: float) -> float:
        """kappa, but at most STIFFEST times mu; small factors hold STIFFEST_SMALL times mu."""
        return min(kappa, STIFFEST_SMALL * mu) if self._small else super().bulk(kappa, mu)

    def sharper(self) -> "Pardiso | None":
        """Double precision instead of single."""
        return Pardiso(self._surface, self._held, np.float64, self._small) if self._kind is np.float32 else None

    def factorize(self, tangent: Tangent) -> DirectFactor:
        """Raises RuntimeError where the matrix is singular."""
        kind = np.float64 if np.any(tangent.bulk > STIFFEST * np.asarray(tangent.mu)) else self._kind
        if self._library is None or self._library.kind is not kind:
            self._library = _Library(_Pattern.of(tangent.factorised, self._surface, self._held), kind)
        library, interface = self._library, _Interface(self._library.factorize(tangent.factorised), kind)
        around = functools.partial(library.inverse_around, interface) if interface.S.size else None
        light = library.fill < LIGHT_FILL
        only_for = tangent if library.fill < CHEAP_FILL else None
        return DirectFactor(
            tangent.bulk, tangent.dilatation, functools.partial(library.inverse, interface), around, light, only_for
        )


@dataclass(frozen=True)
class _Pattern:
    """The upper half of a matrix (n, n) as PARDISO wants it, counted from one: places of its values in the CSR data, pattern, and
    marks of the dofs of the surface. Of held dofs it has the diagonal alone: with their zeros a factor of 4,000 dofs, a tenth of
    them held, takes 1.25 times as long."""

    upper: Ints
    indptr: Any
    indices: Any
    marks: Any
    surface: Ints

    @classmethod
    def of(cls, matrix: sp.csr_matrix, surface: Ints, held: Ints) -> "_Pattern":
        n = matrix.shape[0]
        rows, zero = np.repeat(np.arange(n, dtype=np.int32), np.diff(matrix.indptr)), np.zeros(n, dtype=bool)
        zero[held] = True
        beside = zero[rows] | zero[matrix.indices]
        upper = np.flatnonzero((matrix.indices > rows) & ~beside | (matrix.indices == rows))
        lengths = np.bincount(rows[upper], minlength=n)
        marks = np.zeros(n, dtype=np.int32)
        marks[surface] = 1
        indptr = (np.concatenate([[0], np.cumsum(lengths)]) + 1).astype(np.int32)
        return cls(upper, indptr, matrix.indices[upper].astype(np.int32) + 1, marks, surface)


class _Library:
    """PARDISO at work on one pattern, symmetric indefinite; it holds the last matrix' factor and gives its memory back at the end.

    pypardiso finds and loads the library; its classes have no Schur complement and copy the pattern at every call, so the routine
    is called from here.
    """

    def __init__(self, pattern: _Pattern, kind: type) -> None:
        self._pattern, self.kind, self._analysed = pattern, kind, False
        self._values: Any = np.empty(0, dtype=kind)
        solver = load().PyPardisoSolver()
        self._routine, self._threads = solver._mkl_pardiso, solver.libmkl.mkl_get_max_threads
        self._begin()

    def _begin(self) -> None:
        """Handle, settings and marks as they are before an analysis, which writes into them."""
        pattern, self._analysed_with = self._pattern, self._threads()
        self._handle, self._marks = np.zeros(64, dtype=np.int64), pattern.marks.copy()
        self._settings = np.zeros(64, dtype=np.int32)
        # own values; METIS; perturb pivots below 1e-8; Bunch-Kaufman pivots: those of the diagonal take 0.83 of the time, but
        # fibres across the indenter make tangents indefinite, and a deep run was lost
        self._settings[[0, 1, 9, 20]] = 1, 2, 8, 1
        self._settings[FILL] = -1  # asks for the number
        self._settings[35] = 2 if pattern.surface.size else 0  # Schur complement together with the whole factor
        self._settings[27] = self.kind is np.float32
        self._settings[23] = pattern.marks.size >= THREADS_PAY  # two-level factors: threads share in their use, not only in making
        arrays = pattern.indptr, pattern.indices, self._marks, self._settings
        self._places = _place(self._handle, ctypes.c_int64), *map(_place, arrays)

    @property
    def fill(self) -> float:
        """Numbers in the factor for each dof."""
        return float(self._settings[FILL]) / self._pattern.marks.size

    def factorize(self, matrix: sp.csr_matrix) -> Array:
        """The Schur complement (n_s, n_s) of a matrix, whose factor is held from now on."""
        n_s = self._pattern.surface.size
        self._values = matrix.data[self._pattern.upper].astype(self.kind)
        if self._analysed_with != self._threads():  # MKL crashes where one thread factorises what two have analysed
            if self._analysed:
                self.call(RELEASE)
            self._analysed = False
            self._begin()
        if not self._analysed:
            self.call(ANALYSIS)
            self._analysed = True
        return self.call(FACTOR, size=max(n_s**2, 1))[: n_s**2].reshape(n_s, n_s).astype(float)

    def inverse(self, interface: "_Interface", tangent: Tangent) -> Apply:
        """r -> the inverse of the factorised body with the contact of a tangent."""
        if tangent.contact is None or not self._pattern.surface.size:
            return lambda r: self.call(SOLVE, r)
        return self._moved(interface.inverse(tangent.contact))

    def inverse_around(self, interface: "_Interface", solve: OnSurface) -> Apply:
        """r -> the inverse of the factorised body whose dofs on the surface are moved by a function."""
        return self._moved(functools.partial(solve, interface.S, interface.nearly_exact))

    def _moved(self, on_surface: Apply) -> Apply:
        surface = self._pattern.surface

        def apply(r: Array) -> Array:
            x = self.call(FORWARD, r)
            x[..., surface] = on_surface(x[..., surface])
            return self.call(BACKWARD, x)

        return apply

    def call(self, phase: int, b: Array | None = None, size: int = 1) -> Any:
        """What PARDISO writes in one of its phases, in its own precision: of right-hand sides b (n,) or (k, n) the solutions, else
        numbers (size,). Raises RuntimeError."""
        pattern = self._pattern
        n = pattern.marks.size
        x = np.zeros(max(n, size) if b is None else b.shape, dtype=self.kind)
        b = np.zeros(n, dtype=self.kind) if b is None else np.ascontiguousarray(b, dtype=self.kind)
        error = ctypes.c_int32(0)
        handle, indptr, indices, marks, settings = self._places
        self._routine(
            handle, _number(1), _number(1), _number(SYMMETRIC_INDEFINITE), _number(phase), _number(n), self._values.ctypes.data,
            indptr, indices, marks, _number(b.size // n), settings, _number(0), b.ctypes.data, x.ctypes.data, ctypes.byref(error),
        )  # fmt: skip
        if error.value:
            raise RuntimeError(f"PARDISO error {error.value} in phase {phase}")
        return x

    def __del__(self) -> None:
        if getattr(self, "_analysed", False):
            with contextlib.suppress(Exception):
                self.call(RELEASE)


def _number(value: int) -> Any:
    return ctypes.byref(ctypes.c_int32(value))


def _place(array: Any, kind: Any = ctypes.c_int32) -> Any:
    return array.ctypes.data_as(ctypes.POINTER(kind))


class _Interface:
    """The dense system S + C on the surface: factors at some C, and a correction on the dofs where C has changed since.

    From one iteration to the next few points stick, slip or lift off
    (Woodbury: (M + E D Eᵀ)⁻¹ = M⁻¹ - M⁻¹ E (1 + D Eᵀ M⁻¹ E)⁻¹ D Eᵀ M⁻¹).
    """

    UNCHANGED = 1e-3  # change of an entry, of the largest, that is left to GMRES
    SMALL = 800  # dofs up to which new factors are always cheap
    FEW = 0.15  # share of the dofs up to which the correction is cheaper than new factors

    def __init__(self, S: Array, kind: type = float) -> None:
        self.S, self._kind = S, kind
        self._loaded: _Loaded | None = None
        self._factorised: tuple[Array, Apply] | None = None  # C, and the inverse of S + C

    def inverse(self, C: Array) -> Apply:
        """r -> (S + C)⁻¹ r, up to small changes of C; infinities where it is singular, which the caller's residual shows."""
        if self._factorised is None:
            return self._factorize(C)
        C0, solved = self._factorised
        change = C - C0
        dofs = np.flatnonzero(np.abs(change).max(axis=0) > self.UNCHANGED * np.abs(C).max(initial=0))
        if dofs.size > self.FEW * C.shape[0]:
            return self._factorize(C)
        return _corrected(solved, change[np.ix_(dofs, dofs)], dofs, C.shape[0]) if dofs.size else solved

    def nearly_exact(self, C: Array) -> Apply:
        """r -> (S + C)⁻¹ r, exact where that is cheap."""
        if C.shape[0] > self.SMALL:
            return self.inverse(C)
        if self._factorised is not None and np.array_equal(self._factorised[0], C):
            return self._factorised[1]
        return self._factorize(C)

    def _factorize(self, C: Array) -> Apply:
        places = np.divmod(np.flatnonzero(C != 0), C.shape[1])  # NumPy finds numbers that are not zero six times slower
        loaded = np.zeros(len(C), dtype=bool) if self._loaded is None else self._loaded.marks.copy()
        loaded[places[0]] = loaded[places[1]] = True
        if self._loaded is None or not np.array_equal(loaded, self._loaded.marks):
            self._loaded = _Loaded(self.S, loaded, self._kind)
        self._factorised = C, self._loaded.inverse(C, *places)
        return self._factorised[1]


class _Loaded:
    """S on those dofs that the contact has acted on since S was made; the others are eliminated, once, as C has nothing there.

    Of the dofs under a strip and on the sides that it overhangs two thirds are loaded: a new C then costs a third.
    """

    def __init__(self, S: Array, marks: Bools, kind: type) -> None:
        self.marks, self._kind = marks, kind
        self._on, self._off, self._number = np.flatnonzero(marks), np.flatnonzero(~marks), np.cumsum(marks) - 1
        S = S.astype(kind)  # it is no more exact than PARDISO's numbers
        self._rest, between = _lu(S[np.ix_(self._off, self._off)].T), S[np.ix_(self._off, self._on)]
        self._follow = _solved(self._rest, between)  # how the others move when the loaded dofs do, but for the sign
        self._S = (S[np.ix_(self._on, self._on)] - between.T @ self._follow).T  # symmetric, and in LAPACK's order

    def inverse(self, C: Array, rows: Ints, columns: Ints) -> Apply:
        """r (n,) or (k, n) -> (S + C)⁻¹ r, of C that is zero but for these rows and columns."""
        on, off, loaded = self._on, self._off, self._S.copy(order="F")
        loaded[self._number[rows], self._number[columns]] += C[rows, columns]
        factors = _lu(loaded)

        def solved(r: Array) -> Array:
            r = r.T.astype(self._kind)
            x = np.empty(r.shape)
            with np.errstate(all="ignore"):
                x[on] = moved = _solved(factors, r[on] - self._follow.T @ r[off])
                x[off] = _solved(self._rest, r[off]) - self._follow @ moved
            return x.T

        return solved


def _lu(matrix: Array) -> Any:
    """LU factors of a matrix that LAPACK may overwrite; None where it has no rows."""
    getrf = dense.lapack.sgetrf if matrix.dtype == np.float32 else dense.lapack.dgetrf
    return getrf(matrix, overwrite_a=True)[:2] if matrix.size else None


def _solved(factors: Any, r: Array) -> Array:
    """Solutions (n,) or (n, k) by LU factors of their precision; infinities or NaN where they are singular."""
    if factors is None:
        return r
    getrs = dense.lapack.sgetrs if factors[0].dtype == np.float32 else dense.lapack.dgetrs
    return getrs(*factors, r)[0]


def _corrected(solved: Apply, D: Array, dofs: Ints, n: int) -> Apply:
    """The inverse on n dofs after a change D on some of them."""
    unit = np.zeros((dofs.size, n))
    unit[np.arange(dofs.size), dofs] = 1
    W = solved(unit)
    small = dense.lapack.dgetrf(np.eye(dofs.size) + D @ W[:, dofs].T)[:2]

    def corrected(r: Array) -> Array:
        x = solved(r)
        return x - dense.lu_solve(small, D @ x[..., dofs].T, check_finite=False).T @ W

    return corrected
