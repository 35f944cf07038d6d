"""Solves with the tangents of one path: a factor is made, used by GMRES for as long as it serves, and made anew."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

from indentfit.arrays import Array, Ints
from indentfit.errors import ConvergenceError
from indentfit.fem.deadline import NEVER, Deadline
from indentfit.fem.linear import krylov
from indentfit.fem.linear.choice import choice
from indentfit.fem.linear.factor import Apply, Factor, Factoriser, Moduli, OnSurface
from indentfit.fem.linear.tangent import Tangent

REFINEMENTS = 5  # of solutions by a factor in single precision, which gains five digits or so in each
# A refined solution may end with a residual this many times larger than one of GMRES: a factor takes the errors of all motions
# away alike, and derivatives are then exact to 3e-7, where GMRES leaves those of soft motions (stiffnesses of strips 4 % off).
OF_REFINED = 1e3


@dataclass(frozen=True)
class LinearWork:
    """How much work a solver did."""

    factorizations: int = 0
    solves: int = 0
    krylov_iterations: int = 0

    def plus(self, other: "LinearWork") -> "LinearWork":
        """This work and another's."""
        return LinearWork(
            self.factorizations + other.factorizations,
            self.solves + other.solves,
            self.krylov_iterations + other.krylov_iterations,
        )

    def since(self, before: "LinearWork") -> "LinearWork":
        """The work that was done since an earlier count."""
        return LinearWork(
            self.factorizations - before.factorizations,
            self.solves - before.solves,
            self.krylov_iterations - before.krylov_iterations,
        )


class LinearSolver:
    """Solves with tangents of one sparsity pattern.

    `name` says which library is used, `work` how much was done.

    Parameters
    ----------
    kind : "auto", "pardiso", "superlu" or "pyamg"
    near_null : array (n, 6)
        Rigid-body modes, for pyamg.
    surface : dofs (n_s,)
        Those that the contact acts on.
    n_dofs : int
        Size of the system, for the choice of "auto".
    small : bool
        Whether factors are small, as those of a plane are: they may be in double precision.
    held : dofs (n_h,)
        Those whose rows and columns are zero beside the diagonal.

    Raises
    ------
    InputError
        For "pardiso" where it is not installed.
    """

    def __init__(
        self,
        kind: str = "auto",
        near_null: Array | None = None,
        surface: Ints | Sequence[int] = (),
        n_dofs: int = 0,
        small: bool = False,
        held: Ints | Sequence[int] = (),
    ) -> None:
        self.work = LinearWork()
        on_surface, at_rest = np.asarray(surface, dtype=int), np.asarray(held, dtype=int)
        self._factoriser = _factoriser(choice(kind, n_dofs), near_null, on_surface, at_rest, small)
        self._usual = self._factoriser
        self._factor: Factor | None = None
        self._steps_when_new = 0

    @property
    def name(self) -> str:
        return self._factoriser.name

    def bulk(self, kappa: float, mu: float) -> float:
        """The bulk modulus, kPa, that tangents should be assembled with."""
        return self._factoriser.bulk(kappa, mu)

    def begin(self) -> None:
        """Begin a run as if none had been before it: without a factor, and without the sharper ones that an earlier run needed."""
        self._factoriser, self._factor = self._usual, None

    def forget(self) -> None:
        """Factorise again at the next solve."""
        self._factor = None

    def refresh(self) -> bool:
        """Whether the next solve makes a new factor: because there is none, or the one at hand is light."""
        if self._factor is not None and self._factor.light:
            self._factor = None
        return self._factor is None

    def borrow(self, other: "LinearSolver | None") -> None:
        """Use the factor of another solver of the same tangents next; with None, make a new one."""
        self._factor = None if other is None else other._factor

    def renew(self, tangent: Tangent) -> None:
        """Make a new factor, of a tangent. Raises ConvergenceError where the matrix is singular."""
        self._factor = None
        self._factor = self._factorised(tangent)

    @property
    def goes_around(self) -> bool:
        """Whether there is a factor at hand that serves `around`."""
        return self._factor is not None and self._factor.goes_around

    @property
    def dilatation(self) -> sp.csr_matrix:
        """The dilatation (n_p, n) of the tangent whose factor is at hand."""
        assert self._factor is not None and self._factor.dilatation is not None
        return self._factor.dilatation

    def around(self, solve: OnSurface, kappa: Moduli, bulk: Moduli, mu: Moduli) -> Apply:
        """`Factor.around` of the factor at hand."""
        assert self._factor is not None
        self._did(krylov_iterations=1)
        return self._factor.around(solve, kappa, bulk, mu)

    def sharpen(self) -> bool:
        """Make more exact factors from now on; False where the library has none."""
        sharper = self._factoriser.sharper()
        if sharper is None:
            return False
        self._factoriser, self._factor = sharper, None
        return True

    def solve(
        self, tangent: Tangent, b: Array, tolerance: float | None = None, enough: float = 0.0, deadline: Deadline = NEVER
    ) -> Array:
        """The solution of K x = b.

        Parameters
        ----------
        tangent : Tangent
        b : array (n,), mN
        tolerance : float
            Of the residual, relative to b; the default is what an iteration of Newton's needs.
        enough : float, mN
            Norm of K x - b that is small enough for Newton's own end; a library whose steps are dear stops there.
        deadline : Deadline

        Returns
        -------
        x (n,), mm, with |K x - b| <= tolerance |b|

        Raises
        ------
        ConvergenceError
            Where the matrix is singular or holds NaN.
        OutOfTime
        """
        self._did(solves=1)
        size = float(np.linalg.norm(b))
        if size == 0:
            return np.zeros_like(b)
        wanted = tolerance or max(krylov.TOLERANCE, min(0.1, self._factoriser.dear * enough / size))
        if not (np.isfinite(size) and np.isfinite(tangent.whole.data.sum())):
            raise ConvergenceError("the tangent or the residual holds NaN or infinity")
        x = self._with_old_factor(tangent, b, wanted, deadline.check)
        return self._with_new_factor(tangent, b, wanted, deadline) if x is None else x

    def solve_each(self, tangent: Tangent, forces: Array, tolerance: float, deadline: Deadline = NEVER) -> Array:
        """The solutions (k, n) of K x = b for several b (k, n), as `solve` gives and raises them.

        The factor at hand, if there is one, is that of the tangent: its solutions are refined, all at once, and where they do not
        become exact enough GMRES is used.
        """
        if not forces.any():
            return np.zeros_like(forces)
        if self._factor is None:
            self.renew(tangent)
        assert self._factor is not None
        inverse = self._factor.inverse_of(tangent)
        x = None if inverse is None else self._refined(inverse, tangent, forces, tolerance, deadline)
        if x is None:
            x = np.array([self.solve(tangent, b, tolerance, deadline=deadline) for b in forces])
        return x

    def _refined(self, inverse: Apply, tangent: Tangent, forces: Array, tolerance: float, deadline: Deadline) -> Array | None:
        """Solutions (k, n) by iterative refinement, or None where they do not become exact enough."""
        enough = OF_REFINED * tolerance * np.linalg.norm(forces, axis=1)
        x, left = np.zeros_like(forces), forces
        for _ in range(REFINEMENTS):
            deadline.check()
            x = x + inverse(left)
            left = forces - [tangent.product(row) for row in x]  # SciPy takes twice as long for several columns at once
            self._did(krylov_iterations=len(forces))
            if np.all(np.linalg.norm(left, axis=1) <= enough):
                self._did(solves=len(forces))
                return x
        return None

    def _with_old_factor(self, tangent: Tangent, b: Array, tolerance: float, check: Callable[[], None]) -> Array | None:
        """The solution by the factor at hand, or None where there is none or it has served its time."""
        if self._factor is None or self._factor.outdated(tangent):
            return None
        limits = krylov.Limits(self._factoriser.stale_patience, self._factoriser.hopeless, check)
        x, steps, solved = self._krylov(self._factor, tangent, b, tolerance, limits)
        if steps > self._factoriser.weary(self._steps_when_new):
            self._factor = None
        return x if solved else None

    def _with_new_factor(self, tangent: Tangent, b: Array, tolerance: float, deadline: Deadline) -> Array:
        self._factor = None  # its memory is free for the next one
        self._factor = self._factorised(tangent)
        limits = krylov.Limits(self._factoriser.patience, self._factoriser.hopeless, deadline.check)
        x, self._steps_when_new, solved = self._krylov(self._factor, tangent, b, tolerance, limits)
        if solved:
            return x
        if self.sharpen():
            return self.solve(tangent, b, tolerance, deadline=deadline)
        raise ConvergenceError("the linear system could not be solved (singular tangent: lost support or instability)")

    def _factorised(self, tangent: Tangent) -> Factor:
        self._did(factorizations=1)
        try:
            return self._factoriser.factorize(tangent)
        except (RuntimeError, ValueError, np.linalg.LinAlgError) as error:
            raise ConvergenceError(f"{self.name} could not factorise the tangent ({error})") from error

    def _krylov(
        self, factor: Factor, tangent: Tangent, b: Array, tolerance: float, limits: krylov.Limits
    ) -> tuple[Array, int, bool]:
        """x, the steps that GMRES took, and whether x is a solution."""
        x, steps, solved = krylov.gmres(krylov.form_of(tangent), factor.preconditioner(tangent), b, tolerance, limits)
        self._did(krylov_iterations=steps)
        return x, steps, solved

    def _did(self, factorizations: int = 0, solves: int = 0, krylov_iterations: int = 0) -> None:
        work = self.work
        self.work = replace(
            work,
            factorizations=work.factorizations + factorizations,
            solves=work.solves + solves,
            krylov_iterations=work.krylov_iterations + krylov_iterations,
        )


def _factoriser(name: str, near_null: Array | None, surface: Ints, held: Ints, small: bool) -> Factoriser:
    """The library of a name; each is loaded where it is used only."""
    if name == "pardiso":
        from indentfit.fem.linear.pardiso import Pardiso

        return Pardiso(surface, held, small=small)
    if name == "pyamg":
        from indentfit.fem.linear.multigrid import Multigrid

        return Multigrid(near_null, surface)
    from indentfit.fem.linear.superlu import SuperLU

    return SuperLU()
