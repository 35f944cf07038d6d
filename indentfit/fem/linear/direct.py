"""Direct factors: that of an earlier tangent K0 = A0 + kappa B0ᵀ B0, taken apart so that what changes most never makes it useless.

The factor solves the earlier form with pressures as well, x = K0⁻¹ (f + kappa B0ᵀ g), p = kappa (B0 x - g). The change of B from B0
then counts once, not times kappa; without this a step of 1 % strain spoils a factor at kappa/mu = 1000. So 2 to 8 steps of
GMRES, a forward and a backward solve each, do where a factorisation costs as much as 30.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp

from indentfit.arrays import Array
from indentfit.fem.linear.factor import Apply, Moduli, OnSurface
from indentfit.fem.linear.tangent import Tangent

MAX_KRYLOV = 15  # GMRES steps on a stale factor before a new one is cheaper
STIFFEST = 1e4  # bulk over shear modulus that a factor holds; GMRES adds the rest
SCHUR = 1.0  # shear moduli in the pressures' Schur complement
HOPELESS = 0.5  # share of the residual that may be left after the first three of them


class DirectFactoriser:
    """What PARDISO and SuperLU have in common as a Factoriser: how long a factor of theirs is used."""

    patience, stale_patience, hopeless = 30, MAX_KRYLOV, HOPELESS
    dear = False

    def bulk(self, kappa: float, mu: float) -> float:
        """kappa, but at most STIFFEST times mu: factors in single precision lose the isochoric part under a larger one."""
        return min(kappa, STIFFEST * mu)

    def weary(self, steps: int) -> float:
        """Never: a new factor costs more than all the steps that it could save."""
        return np.inf


@dataclass(frozen=True)
class DirectFactor:
    """A Factor of an earlier tangent.

    Parameters
    ----------
    bulk : float, or array (n_p,), kPa
        Bulk modulus with which the earlier tangent was assembled.
    dilatation : CSR matrix (n_p, n)
        B0, that of the earlier tangent.
    inverse : tangent -> (r (n,) or (k, n) -> x alike)
        The earlier body, with the contact of a tangent where the library can bring it in, inverted.
    inverse_around : OnSurface -> (r (n,) -> x (n,)), or None
        The earlier body inverted, with the contact's dofs moved by a function.
    light : bool
    only_for : Tangent, or None
        The earlier tangent, where a new factor costs less than the steps that this one would take on another.
    """

    bulk: float | Array
    dilatation: sp.csr_matrix | None = field(repr=False)
    inverse: Callable[[Tangent], Apply] = field(repr=False)
    inverse_around: Callable[[OnSurface], Apply] | None = field(default=None, repr=False)
    light: bool = False
    only_for: Tangent | None = field(default=None, repr=False)

    def outdated(self, tangent: Tangent) -> bool:
        """Where the factor is that of another tangent, and a new one is cheap."""
        return self.only_for is not None and tangent is not self.only_for

    def inverse_of(self, tangent: Tangent) -> Apply | None:
        """As the protocol says; None where the form with pressures is needed."""
        return self.inverse(tangent) if tangent.dilatation is None or tangent.as_stiff else None

    def preconditioner(self, tangent: Tangent) -> Apply:
        """The earlier form, with pressures where the tangent has them."""
        apply = self.inverse(tangent)
        return apply if tangent.dilatation is None else self._mixed(apply, tangent.kappa, tangent.bulk, tangent.mu)

    @property
    def goes_around(self) -> bool:
        """Not where a new factor is cheap and this one holds a part of the bulk modulus only: the iteration would be slow."""
        slow = self.only_for is not None and not self.only_for.as_stiff
        return self.inverse_around is not None and self.dilatation is not None and not slow

    def around(self, solve: OnSurface, kappa: Moduli, bulk: Moduli, mu: Moduli) -> Apply:
        """The form with pressures, with the contact's dofs moved by a function."""
        assert self.inverse_around is not None
        return self._mixed(self.inverse_around(solve), kappa, bulk, mu)

    @cached_property
    def _transposed(self) -> Any:
        assert self.dilatation is not None
        return self.dilatation.T

    def _mixed(self, apply: Apply, kappa: Moduli, tangent_bulk: Moduli, mu: Moduli) -> Apply:
        """The form with pressures of an inverse, for a tangent with these moduli."""
        if self.dilatation is None:
            return apply
        B, bulk = self.dilatation, self.bulk
        n, BT = B.shape[1], self._transposed
        rest = np.maximum(0.0, 1 - bulk / kappa) / (bulk + SCHUR * mu)  # flexibility that the factor lacks
        enough = np.logical_and(np.greater_equal(bulk, tangent_bulk), np.equal(tangent_bulk, kappa))
        flexibility = np.where(enough, 1 / bulk, 1 / kappa + rest)

        def with_pressures(r: Array) -> Array:
            g = r[n:] / kappa
            v = apply(r[:n] + BT @ (bulk * g))
            return np.concatenate([v, (B @ v - g) / (flexibility * kappa)])

        return with_pressures
