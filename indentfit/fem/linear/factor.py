"""What a linear solver's library must offer: a Factoriser, and the Factor that it makes of a tangent."""

from collections.abc import Callable
from typing import Protocol

import scipy.sparse as sp

from indentfit.arrays import Array
from indentfit.fem.linear.tangent import Tangent

Moduli = float | Array  # kPa, of the whole body or of each pressure mode (n_p,)
Apply = Callable[[Array], Array]  # r -> an approximation of K⁻¹ r, in the form with the pressures where the tangent has them


Inverse = Callable[[Array], Apply]  # C (n_s, n_s) -> b -> (S + C)⁻¹ b, for the Schur complement S of a body on the contact's dofs
# S (n_s, n_s), its Inverse, and b (n_s,) -> displacements (n_s,) of the contact's dofs, by any law that S and the contact obey
OnSurface = Callable[[Array, Inverse, Array], Array]


class Factor(Protocol):
    """An approximate inverse made of one tangent, which preconditions solves with this tangent and with later ones.

    A factor is used until its Factoriser makes the next one.
    """

    def outdated(self, tangent: Tangent) -> bool:
        """Whether a new factor is known to be cheaper than the steps of GMRES that this one would take on the tangent."""
        ...

    def preconditioner(self, tangent: Tangent) -> Apply:
        """The approximate inverse for a tangent.

        It maps residuals (n,) to solutions (n,) where the tangent has no dilatation, else (n + n_p,) to (n + n_p,) in the form
        of `krylov.Mixed`. A tangent that cannot be inverted gives infinities or NaN, not an error: the residual shows them.
        """
        ...

    def inverse_of(self, tangent: Tangent) -> Apply | None:
        """The inverse, up to the factor's precision, of the tangent that the factor was made of, for many right-hand sides (k, n);
        None where it is no good as such."""
        ...

    @property
    def dilatation(self) -> sp.csr_matrix | None:
        """That of the tangent that the factor was made of."""
        ...

    @property
    def light(self) -> bool:
        """Whether each equilibrium shall have a factor of its own, for its derivatives and for the step that follows."""
        ...

    @property
    def goes_around(self) -> bool:
        """Whether the factor has a Schur complement on the contact's dofs."""
        ...

    def around(self, solve: OnSurface, kappa: Moduli, bulk: Moduli, mu: Moduli) -> Apply:
        """As the preconditioner of a tangent with these moduli, but the motion of the contact's dofs is what `solve` makes of it.
        For a factor that goes around only."""
        ...


class Factoriser(Protocol):
    """A library, or a method, that makes factors of tangents of one sparsity pattern.

    name: as in the case's solver table. patience: steps of GMRES on a new factor before the solve fails; stale_patience: on an
    older one before a new one is made; hopeless: share of the residual that may be left after three steps; dear: whether
    steps cost so much that a solve may stop at what Newton's iteration needs.
    """

    name: str
    patience: int
    stale_patience: int
    hopeless: float
    dear: bool

    def bulk(self, kappa: float, mu: float) -> float:
        """The bulk modulus, kPa, that tangents shall be assembled with, for the body's own, kappa, and a shear modulus, mu."""
        ...

    def weary(self, steps: int) -> float:
        """Steps of GMRES after which the factor shall be made anew, where it took `steps` just after it was made."""
        ...

    def factorize(self, tangent: Tangent) -> Factor:
        """The Factor of a tangent. Raises RuntimeError, ValueError or LinAlgError where the matrix is singular."""
        ...

    def sharper(self) -> "Factoriser | None":
        """The same library with more exact factors, or None where there are none."""
        ...
