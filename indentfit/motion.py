"""The motion of an indenter in time, and the force on it where the rig controls that."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from indentfit.arrays import Array
from indentfit.hereditary import DENSE, Ramp

HELD = 0.02  # of the largest depth: what the depth of a hold may drift
ARRIVED = 0.98  # of the largest depth: the ramp ends there
START = 0.2  # of the largest depth: the first part of a ramp, whose rate tells when contact began
SHORTEST_STEP = 1e-12  # s


@dataclass(frozen=True, eq=False)
class Motion:
    """Depths of an indenter over time, linear between the times.

    Parameters
    ----------
    time : array (m,), s
        Rising, from the moment of contact, 0.
    depth : array (m,), mm
        From 0.
    loaded : float, s, or None
        Where the force is controlled, the moment at which it has arrived; the motion after it is creep, and counts as a hold.
    """

    time: Array
    depth: Array
    loaded: float | None = None

    @classmethod
    def measured(cls, time: Array, displacement: Array, force: Array | None = None) -> tuple[Motion, Array]:
        """The motion of a measured curve, and the times (n,) of its points since contact.

        Where the curve begins at a depth above zero, contact began earlier, by the rate of the first part of the ramp.

        Parameters
        ----------
        time : array (n,), s
        displacement : array (n,), mm
        force : array (n,), mN, or None
            Where the force is controlled.
        """
        time, depth = np.asarray(time, dtype=float), np.maximum(np.asarray(displacement, dtype=float), 0.0)
        late = depth[0] / _first_rate(time, depth) if depth[0] > 0 else 0.0
        own = time - time[0] + late
        loaded = None if force is None else float(own[int(np.argmax(force >= ARRIVED * np.max(force)))])
        if late <= SHORTEST_STEP:
            return cls(own, depth, loaded), own
        return cls(np.concatenate([[0.0], own]), np.concatenate([[0.0], depth]), loaded), own

    @classmethod
    def ramped(cls, ramp: Ramp) -> Motion:
        """The motion of a ramp and a hold."""
        ends = [0.0, ramp.seconds, *([ramp.end] if ramp.hold else [])]
        return cls(np.array(ends), ramp.depth_at(np.array(ends)))

    @property
    def deepest(self) -> float:
        """The largest depth, mm."""
        return float(self.depth.max())

    @property
    def turn(self) -> int:
        """The number of the time after which the indenter retracts; the last time where it does not."""
        late = np.flatnonzero(self.depth >= (1 - HELD) * self.deepest)
        return int(late[-1])

    @property
    def retracts(self) -> bool:
        """Whether the indenter goes back by more than the drift of a hold."""
        return self.turn < self.time.size - 1

    @property
    def reverses(self) -> bool:
        """Whether the indenter goes back before its turn by more than the drift of a hold, or ahead again after it."""
        ahead, back = self.depth[: self.turn + 1], self.depth[self.turn :]
        allowed = HELD * self.deepest
        return bool((np.maximum.accumulate(ahead) - ahead > allowed).any() or (back - np.minimum.accumulate(back) > allowed).any())

    @property
    def ramp(self) -> Ramp:
        """The ramp at constant rate and the hold that are nearest to the motion before its turn."""
        if self.loaded:
            return Ramp(self.deepest, self.loaded, max(float(self.time[self.turn]) - self.loaded, 0.0))
        time, depth = self.time[: self.turn + 1], self.depth[: self.turn + 1]
        arrived = int(np.argmax(depth >= ARRIVED * self.deepest))
        held = depth[arrived:]
        level = float(np.median(held)) if time[-1] > 1.2 * time[arrived] and held.size > 2 else self.deepest
        moment = float(np.interp(ARRIVED * level, depth[: arrived + 1], time[: arrived + 1]))
        seconds = min(moment / ARRIVED, float(time[-1])) if moment > 0 else float(time[-1])
        hold = float(time[-1]) - seconds
        return Ramp(level, seconds, hold if hold > 1e-3 * seconds else 0.0)


@dataclass(frozen=True, eq=False)
class Load:
    """The force on an indenter over time, linear between the times, which does not fall.

    Parameters
    ----------
    time : array (m,), s
        Rising, from the moment of contact, 0.
    force : array (m,), mN
        From 0, of the whole sample.
    arrived : float, s
        The moment at which the force is there; what comes after it is creep.
    """

    time: Array
    force: Array
    arrived: float

    @classmethod
    def ramped(cls, force: float, seconds: float, hold: float = 0.0) -> Load:
        """A ramp to a force, mN, and a hold."""
        ends = [0.0, seconds, *([seconds + hold] if hold else [])]
        return cls(np.array(ends), np.array([0.0, force, force][: len(ends)]), seconds)

    @classmethod
    def measured(cls, time: Array, force: Array) -> Load:
        """The load of a measured curve up to where it is taken off.

        Parameters
        ----------
        time : array (n,), s
            Rising, since contact.
        force : array (n,), mN
            What it scatters is smoothed by the rising function that is nearest to it in least squares.
        """
        from scipy.optimize import isotonic_regression

        time, force = np.asarray(time, dtype=float), np.asarray(force, dtype=float)
        last = int(np.flatnonzero(force >= (1 - HELD) * force.max())[-1])
        rising = np.maximum(isotonic_regression(force[: last + 1]).x, 0.0)
        time = time[: last + 1]
        arrived = float(time[int(np.argmax(rising >= ARRIVED * rising[-1]))])
        if time[0] > SHORTEST_STEP:
            time, rising = np.append(0.0, time), np.append(0.0, rising)
        return cls(time, rising, arrived)

    @property
    def end(self) -> float:
        """The last time, s."""
        return float(self.time[-1])

    def at(self, time: Array) -> Array:
        """Forces, mN, at times (...), s."""
        return np.asarray(np.interp(time, self.time, self.force))

    def times(self, moments: Array) -> Array:
        """Times (n,), s, from 0, that are dense enough for hereditary integrals, with moments (m,), s, among them."""
        rise = np.linspace(0.0, self.arrived, DENSE + 1)
        rest = self.arrived + np.geomspace(self.arrived / DENSE, max(self.end - self.arrived, self.arrived / DENSE), 2 * DENSE)
        times = np.unique(np.concatenate([rise, rest, self.time, np.asarray(moments, dtype=float), [self.end]]))
        return times[times <= self.end]


def _first_rate(time: Array, depth: Array) -> float:
    """Rate of the first part of a ramp, mm/s: the line through its points that is best in least squares."""
    end = max(int(np.argmax(depth >= START * depth.max() + depth[0])), 1)
    t, d = time[: end + 1] - time[: end + 1].mean(), depth[: end + 1]
    rate = float(t @ d / (t @ t))
    return rate if rate > 0 else float((depth.max() - depth[0]) / max(time[int(np.argmax(depth))] - time[0], SHORTEST_STEP))
