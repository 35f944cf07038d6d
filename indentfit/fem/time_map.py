"""The map from elastic forces over the depth to the forces of a relaxing material over time.

For a test under displacement control whose stress relaxes by one function m, the deformation is nearly the elastic one at each
depth, and the force is the hereditary integral of the elastic force F_e:

    F(t) = integral from 0 to t of m(t - s) dF_e(d(s)).

That holds while the contact does not shrink. Under a flat end the contact keeps its size in a retraction, and the integral holds
until the force is gone. Under a round end the contact shrinks. Its size at the time t is then that of an earlier time t1 of the
loading, for which the integral from t1 to t of m(t - s) dd(s) vanishes, and the force is the integral that ends at t1 (Ting 1966,
J Appl Mech 33:845). Hereditary integrals are linear in F_e, which is known on a grid of depths.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from indentfit.arrays import Array, Ints
from indentfit.compiled import compiled
from indentfit.hereditary import DENSE, RelaxationFunction
from indentfit.motion import SHORTEST_STEP, Motion

Interpolation = Callable[[Array], Array]  # depths (m,) -> weights (m, n_grid) of elastic forces on the grid


@dataclass(frozen=True, eq=False)
class TimeMap:
    """The map from elastic forces on a grid of depths to the forces of a relaxing material at times.

    Parameters
    ----------
    time : array (N,), s
        Times from contact on, dense enough for hereditary integrals.
    depth : array (N,), mm
        Depths at these times.
    basis : array (N, n_grid)
        Elastic forces at these times from those on the grid.
    at : array (n,)
        The numbers of the times that are asked for.
    turn : int
        The number of the time after which the indenter retracts; the last where it does not.
    shrinks : bool
        Whether the contact shrinks in a retraction.
    """

    time: Array
    depth: Array
    basis: Array = field(repr=False)
    at: Ints
    turn: int
    shrinks: bool

    @classmethod
    def of(cls, motion: Motion, times: Array, interpolation: Interpolation, shrinks: bool) -> TimeMap:
        """The map of a motion.

        Parameters
        ----------
        motion : Motion
        times : array (n,), s
            Times at which forces are asked for.
        interpolation : function
            Depths (m,) -> weights (m, n_grid).
        shrinks : bool
            Whether the contact shrinks in a retraction: under a round end.
        """
        dense = [np.array([0.0])]
        most = motion.deepest / DENSE
        pairs = zip(motion.time[:-1], motion.time[1:], np.abs(np.diff(motion.depth)), strict=True)
        for start, end, change in pairs:
            dense.append(np.linspace(start, end, max(int(np.ceil(change / most)), 1) + 1)[1:])
        time = np.unique(np.concatenate([*dense, np.asarray(times, dtype=float)]))
        time = time[np.append(True, np.diff(time) > SHORTEST_STEP)]
        depth = np.interp(time, motion.time, motion.depth)
        at = np.searchsorted(time, np.asarray(times) - SHORTEST_STEP).clip(0, time.size - 1)
        turn = int(np.searchsorted(time, motion.time[motion.turn] - SHORTEST_STEP)) if motion.retracts else time.size - 1
        return cls(time, depth, interpolation(depth), np.asarray(at), turn, shrinks)

    @property
    def retracts(self) -> bool:
        """Whether forces in a retraction are asked for: those before it know nothing of it."""
        return bool((self.at > self.turn).any())

    def forces(self, elastic: Array, function: RelaxationFunction) -> Array:
        """Forces (..., n), mN, from elastic forces (..., n_grid), mN, and a relaxation function."""
        rows = np.asarray(elastic, dtype=float).reshape(-1, self.basis.shape[1]) @ self.basis.T
        if self.retracts:
            total = self._retracting(rows, function)
        else:
            histories, _ = self._histories(rows, function)
            relaxing = np.array(function.shares) @ histories.reshape(len(histories), -1)
            total = function.long_term * rows[:, self.at] + relaxing.reshape(histories.shape[1:])
        return np.asarray(total.reshape(*np.shape(elastic)[:-1], self.at.size))

    def by_term(self, elastic: Array, function: RelaxationFunction) -> tuple[Array, Array]:
        """The part of each term of a function in the force, over its share, and the derivative of this part by the term's time.

        Parameters
        ----------
        elastic : array (n_grid,), mN
        function : RelaxationFunction

        Returns
        -------
        array (n_terms, n), mN; array (n_terms, n), mN/s
        """
        histories, slopes = self._histories((self.basis @ elastic)[None], function)
        return histories[:, 0], slopes[:, 0]

    def elastic(self, elastic: Array) -> Array:
        """Elastic forces (n,) at the times that are asked for."""
        return np.asarray((self.basis @ elastic)[self.at])

    def _histories(self, rows: Array, function: RelaxationFunction) -> tuple[Array, Array]:
        return _integrals(np.diff(self.time), np.ascontiguousarray(rows), np.array(function.times), self.at)

    def _retracting(self, rows: Array, function: RelaxationFunction) -> Array:
        """Forces (m, n) of a motion that goes back, from elastic forces (m, N)."""
        shares, times, steps = np.array(function.shares), np.array(function.times), np.diff(self.time)
        late, rows = np.flatnonzero(self.at > self.turn), np.ascontiguousarray(rows)
        if self.shrinks:
            before = np.minimum(self.at, self.turn)
            histories, _ = _integrals(steps, rows, times, before)
            total = function.long_term * rows[:, before] + np.tensordot(shares, histories, 1)
            moments = self.at[late]
            total[:, late] = _shrinking(steps, rows, self.depth, shares, times, function.long_term, self.turn, moments)
            return np.asarray(total)
        both = np.concatenate([rows, self.depth[None]])
        histories, _ = _integrals(steps, np.ascontiguousarray(both), times, np.arange(self.time.size))
        whole = function.long_term * both + np.tensordot(shares, histories, 1)
        total = whole[:-1, self.at]
        gone = np.minimum.accumulate(whole[-1][self.turn :]) <= 0  # contact that is lost stays lost
        total[:, late] = np.where(gone[self.at[late] - self.turn], 0.0, total[:, late])
        return np.asarray(total)


@compiled()
def _shrinking(
    steps: Any, rows: Any, depth: Any, shares: Any, times: Any, long_term: Any, turn: Any, moments: Any
) -> Any:  # pragma: no cover
    """Forces (m, n) of rows of elastic forces (m, N) at numbers of times (n,) after the turn, by Ting's rule.

    The contact at t has the size that it had at t1, for which the integrals of m(t - s) dd(s) up to t1 and up to t are equal; the
    force is the integral of m(t - s) dF_e(s) up to t1.
    """
    k, m, n, last = times.size, rows.shape[0], moments.size, moments.max()
    forces, own, size = np.zeros((m, n)), np.zeros((k, m, turn + 1)), np.zeros((k, last + 1))
    since = np.zeros(last + 1)
    for j in range(last):
        since[j + 1] = since[j] + steps[j]
    for i in range(k):
        dt = decay = gain = 0.0
        size[i, 0] = depth[0]
        own[i, :, 0] = rows[:, 0]
        for j in range(1, last + 1):
            if abs(steps[j - 1] - dt) > 1e-9 * dt:
                dt = steps[j - 1]
                lost = -np.expm1(-dt / times[i])
                decay, gain = 1.0 - lost, lost / (dt / times[i])
            size[i, j] = decay * size[i, j - 1] + gain * (depth[j] - depth[j - 1])
            if j <= turn:
                for row in range(m):
                    own[i, row, j] = decay * own[i, row, j - 1] + gain * (rows[row, j] - rows[row, j - 1])
    begun = np.zeros((k, turn + 1))  # what is left of them at the turn, of each end
    for i in range(k):
        for j in range(turn + 1):
            left = np.exp(-(since[turn] - since[j]) / times[i])
            begun[i, j] = left * size[i, j]
            own[i, :, j] *= left
    ahead = np.zeros(k)
    for number in range(n):
        at = moments[number]
        wanted = long_term * depth[at]
        for i in range(k):
            wanted += shares[i] * size[i, at]
            ahead[i] = shares[i] * np.exp(-(since[at] - since[turn]) / times[i])
        if wanted <= 0:
            continue
        low = high = long_term * depth[0] + (ahead * begun[:, 0]).sum()
        j = 0
        while high < wanted and j < turn:
            j += 1
            low, value = high, long_term * depth[j]
            for i in range(k):
                value += ahead[i] * begun[i, j]
            high = max(high, value)
        if j == 0:
            j, low = 1, high
        part = min(max((wanted - low) / (high - low), 0.0), 1.0) if high > low else 1.0
        for row in range(m):
            first, end = long_term * rows[row, j - 1], long_term * rows[row, j]
            for i in range(k):
                first += ahead[i] * own[i, row, j - 1]
                end += ahead[i] * own[i, row, j]
            forces[row, number] = first + part * (end - first)
    return forces


@compiled()
def _integrals(steps: Any, rows: Any, times: Any, at: Any) -> Any:  # pragma: no cover
    """Hereditary integrals of exp(-t / tau) for each time tau (k,) and each row (m, N) at the numbers `at` (n,), (k, m, n), and
    their derivatives by tau."""
    k, m, n = times.size, rows.shape[0], at.size
    values, slopes = np.zeros((k, m, n)), np.zeros((k, m, n))
    last = at.max() if n else 0
    order = np.argsort(at)
    now, ahead = np.zeros(m), np.zeros(m)
    for i in range(k):
        tau, dt = times[i], 0.0
        decay = gain = d_decay = d_gain = 0.0
        now[:] = rows[:, 0]
        ahead[:] = 0.0
        taken = 0
        for j in range(last + 1):
            if j:
                if abs(steps[j - 1] - dt) > 1e-9 * dt:  # many steps are as long as the one before
                    dt = steps[j - 1]
                    x = dt / tau
                    lost = -np.expm1(-x)
                    decay, gain = 1.0 - lost, lost / x
                    d_decay, d_gain = decay * x / tau, (gain - decay) / tau
                for row in range(m):
                    change = rows[row, j] - rows[row, j - 1]
                    ahead[row] = decay * ahead[row] + d_decay * now[row] + d_gain * change
                    now[row] = decay * now[row] + gain * change
            while taken < n and at[order[taken]] == j:
                for row in range(m):
                    values[i, row, order[taken]] = now[row]
                    slopes[i, row, order[taken]] = ahead[row]
                taken += 1
    return values, slopes
