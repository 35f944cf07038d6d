"""States of the contact as frozen values: springs, multipliers and anchors, pressures and tractions, and their derivatives."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from indentfit.arrays import Array, Bools
from indentfit.indenters import UP


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
    """The contact's memory at the start of a step: multipliers p0 (n_f, n_q) and T0 (n_f, n_q, 3) in kPa, anchors (n_f, n_q, 3) and
    the places at the step's start (n_f, n_q, 3), mm, in the indenter's frame."""

    pressure: Array
    friction: Array
    anchor: Array
    start: Array


@dataclass(frozen=True)
class Stride:
    """A step of the depth and the one before it, mm, 0 where there is none; and whether a point that comes to touch within the step
    is anchored where it touches, not where it was before."""

    step: float = 0.0
    last: float = 0.0
    ahead: bool = True


NO_STRIDE = Stride()


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
    derivative : function
        What makes `stiffness`, where it is asked for: most states are those of a search along a line.
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
    derivative: Callable[[], Array] = field(repr=False)

    @functools.cached_property
    def stiffness(self) -> Array:
        """Derivative (n_f, n_q, 3, 3), kPa/mm, of the traction by the position."""
        return self.derivative()

    def advanced(self, rate: Array | None = None, stride: Stride = NO_STRIDE) -> History:
        """History for a step of the depth: multipliers extrapolated with the traction's rate.

        A point that slips is anchored where it is now. One that does not touch is anchored where it will touch if it moves on as in
        the step before: anchored where it is now, it would rub along the indenter before it touches.

        Parameters
        ----------
        rate : array (n_f, n_q, 3), kPa/mm, or None
            Derivative of the traction by the depth; with None, the multipliers are not extrapolated.
        stride : Stride

        Returns
        -------
        History
        """
        anchor = np.where(self.slipping[..., None], self.place, self.history.anchor)
        anchor = np.where(self.touching[..., None], anchor, self.place + self.until_touch(stride)[..., None] * self.motion(stride))
        start = self.place if stride.step else self.history.start
        if rate is None:
            return History(self.pressure, self.friction, anchor, start)
        along = dot(rate, self.normal)
        pressure = self.pressure - stride.step * along
        moved = (self.slipping | ~self.touching)[..., None]
        friction = self.friction + stride.step * (rate - along[..., None] * self.normal) * ~moved
        return History(np.where(self.unilateral, np.maximum(pressure, 0), pressure), friction, anchor, start)

    def motion(self, stride: Stride) -> Array:
        """Motion (n_f, n_q, 3) of points that do not touch yet: as in the step before; at rest the sample does not move."""
        if not stride.ahead:
            return np.zeros_like(self.place)
        if not stride.last:
            return np.broadcast_to(stride.step * UP, self.place.shape)
        return (stride.step / stride.last) * (self.place - self.history.start)

    def until_touch(self, stride: Stride) -> Array:
        """Share (n_f, n_q) of a step after which the points touch; 1 where they do not."""
        nearer = -dot(self.motion(stride), self.normal)
        return np.divide(self.gap, nearer, out=np.ones_like(self.gap), where=(nearer > self.gap) & (self.gap > 0))


@dataclass(frozen=True)
class ContactChange:
    """The derivative of a ContactState by one quantity: derivatives of its fields and, as a History, of its history."""

    place: Array
    normal: Array
    pressure: Array
    friction: Array
    traction: Array
    history: History = field(repr=False)

    def advanced(self, state: ContactState, rate: Array, rate_change: Array, stride: Stride) -> History:
        """Derivative of `state.advanced(rate, stride)`, where the rate changes by rate_change (n_f, n_q, 3)."""
        moved = (state.slipping | ~state.touching)[..., None]
        anchor = np.where(state.slipping[..., None], self.place, self.history.anchor)
        anchor = np.where(state.touching[..., None], anchor, self._anchor_ahead(state, stride))
        start = self.place if stride.step else self.history.start
        n, dn = state.normal, self.normal
        along, change = dot(rate, n), dot(rate_change, n) + dot(rate, dn)
        pressure = (self.pressure - stride.step * change) * (~state.unilateral | (state.pressure - stride.step * along > 0))
        turned = rate_change - change[..., None] * n - along[..., None] * dn
        return History(pressure, self.friction + stride.step * turned * ~moved, anchor, start)

    def _anchor_ahead(self, state: ContactState, stride: Stride) -> Array:
        """Derivative (n_f, n_q, 3) of the anchor of a point that may touch within the next step."""
        share, motion = state.until_touch(stride), state.motion(stride)
        longer = stride.step / stride.last if stride.last and stride.ahead else 0.0
        further = longer * (self.place - self.history.start)
        nearer = -dot(motion, state.normal)
        later = dot(state.normal, self.place) + share * (dot(further, state.normal) + dot(motion, self.normal))
        share_change = np.divide(later, nearer, out=np.zeros_like(share), where=share < 1)
        return self.place + share_change[..., None] * motion + share[..., None] * further


def dot(a: Array, b: Array) -> Array:
    """Scalar products (n_f, n_q) of vectors (n_f, n_q, 3)."""
    return np.einsum("fqi,fqi->fq", a, b)
