"""States of the contact as frozen values: springs, multipliers and anchors, pressures and tractions, and their derivatives."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from indentfit.arrays import Array, Bools


@dataclass(frozen=True)
class Springs:
    """Stiffnesses of the contact against penetration and slip, kPa/mm."""

    normal: float
    tangential: float

    def scaled(self, share: float) -> Springs:
        """Springs that are `share` times as stiff."""
        return Springs(self.normal * share, self.tangential * share)


@dataclass(frozen=True)
class History:
    """The contact's memory at the start of a step: multipliers p0 (n_f, n_q) and T0 (n_f, n_q, 3) in kPa, and anchors
    (n_f, n_q, 3), mm, in the indenter's frame."""

    pressure: Array
    friction: Array
    anchor: Array


@dataclass(frozen=True)
class ContactState:
    """The contact at one displacement, at facets n_f and their points n_q.

    Parameters
    ----------
    place : array (n_f, n_q, 3), mm
        Positions in the indenter's frame.
    gap : array (n_f, n_q), mm
    normal : array (n_f, n_q, 3)
        Gradient of the gap.
    bend : array (n_f, n_q, 3, 3), 1/mm, or None
        Hessian of the gap; None where the face is flat.
    pressure : array (n_f, n_q), kPa
    friction : array (n_f, n_q, 3), kPa
    traction : array (n_f, n_q, 3), kPa
        Traction of the body on the indenter, T - p n.
    touching, slipping : arrays of bool (n_f, n_q)
    history : History
        The history at the start of the step.
    unilateral : array of bool (n_f, 1)
        False where a point is tied.
    D : array (n_f, n_q, 3, 3), kPa/mm, or None
        Derivative of the traction by the position; None where `touch` was called without it.
    """

    place: Array
    gap: Array
    normal: Array
    bend: Array | None = field(repr=False)
    pressure: Array
    friction: Array
    traction: Array
    touching: Bools
    slipping: Bools
    history: History = field(repr=False)
    unilateral: Bools = field(repr=False)
    D: Array | None = field(repr=False)

    @property
    def stiffness(self) -> Array:
        """D, in a state that has it."""
        assert self.D is not None
        return self.D

    def advanced(self, rate: Array | None = None, step: float = 0.0) -> History:
        """History for a step of the depth: multipliers extrapolated with the traction's rate.

        A point that slips, or does not touch, is anchored where it is now.

        Parameters
        ----------
        rate : array (n_f, n_q, 3), kPa/mm, or None
            Derivative of the traction by the depth; with None, the multipliers are not extrapolated.
        step : float, mm

        Returns
        -------
        History
        """
        moved = (self.slipping | ~self.touching)[..., None]
        anchor = np.where(moved, self.place, self.history.anchor)
        if rate is None:
            return History(self.pressure, self.friction, anchor)
        along = dot(rate, self.normal)
        pressure = self.pressure - step * along
        friction = self.friction + step * (rate - along[..., None] * self.normal) * ~moved
        return History(np.where(self.unilateral, np.maximum(pressure, 0), pressure), friction, anchor)


@dataclass(frozen=True)
class ContactChange:
    """The derivative of a ContactState by one quantity: derivatives of its fields and, as a History, of its history."""

    place: Array
    normal: Array
    pressure: Array
    friction: Array
    traction: Array
    history: History = field(repr=False)

    def advanced(self, state: ContactState, rate: Array, rate_change: Array, step: float) -> History:
        """Derivative of `state.advanced(rate, step)`, where the rate changes by rate_change (n_f, n_q, 3)."""
        moved = (state.slipping | ~state.touching)[..., None]
        anchor = np.where(moved, self.place, self.history.anchor)
        n, dn = state.normal, self.normal
        along, change = dot(rate, n), dot(rate_change, n) + dot(rate, dn)
        pressure = (self.pressure - step * change) * (~state.unilateral | (state.pressure - step * along > 0))
        turned = rate_change - change[..., None] * n - along[..., None] * dn
        return History(pressure, self.friction + step * turned * ~moved, anchor)


def dot(a: Array, b: Array) -> Array:
    """Scalar products (n_f, n_q) of vectors (n_f, n_q, 3)."""
    return np.einsum("fqi,fqi->fq", a, b)
