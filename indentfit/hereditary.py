"""Relaxation functions of quasi-linear viscoelasticity, and hereditary integrals with them.

The relaxation function m(t) is a number that multiplies the elastic stress of a step of strain after the time t. All functions
are sums of decaying exponentials (Prony series)

    m(t) = m_inf + sum_i m_i exp(-t / tau_i),

because a hereditary integral with one exponential needs only its value at the last instant: with x = dt / tau and

    h(t + dt) = exp(-x) h(t) + k(x) (y(t + dt) - y(t)),    k(x) = (1 - exp(-x)) / x,

the integral of m(t - s) dy(s) is m_inf y + sum_i m_i h_i, exactly where y is linear in time within each step (Taylor, Pister and
Goudreau 1970; Simo and Hughes 1998, section 10.3). With the step before it, y may be quadratic over both: k then grows, and the
change of y in the step before is taken off (`RelaxationFunction.steps`). The fractional function is such a sum too, with many
times (`fractional`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from indentfit.arrays import Array

STEP, OF_POLE = 0.6, 0.35  # of a fractional function's rates, in `_rule`: at most, and over the distance of poles
HALVINGS = 40  # of the interval in which that distance lies
NOTHING = 1e-100  # a share: less is none, and its square would be zero
SMALLEST_SHARE = 1e-5  # of a force that does not relax
DENSE = 240  # intervals of a ramp
ROUNDED, FEW = 1e-9, 0.05  # of the time of a corner; of the lifetime of a term: steps so short are summed as a series
NARROW = 1e3  # ratio of rates up to which the eigenvalues of a matrix have enough digits
ROOTS, EXACT = 300, 1e-13  # most steps to the roots of a secular equation, and their relative error
LONGER = 100.0  # times the step before: in such a step y is linear
REACH = 30.0  # of these logarithms, in units of 1 / alpha: beyond, the density is below 1e-13


@dataclass(frozen=True)
class RelaxationFunction:
    """m(t), a Prony series.

    Attributes
    ----------
    long_term : float
        m_inf.
    shares : tuple of float
        m_i.
    times : tuple of float, s
        tau_i.
    """

    long_term: float
    shares: tuple[float, ...]
    times: tuple[float, ...]

    def __call__(self, time: float | Array) -> Array:
        """m at times (...), s, from 0."""
        decays = np.exp(-np.asarray(time, dtype=float)[..., None] / np.array(self.times))
        return self.long_term + decays @ np.array(self.shares)

    @property
    def instantaneous(self) -> float:
        """m(0)."""
        return self.long_term + sum(self.shares)

    @property
    def ratio(self) -> float:
        """m(inf) / m(0)."""
        return self.long_term / self.instantaneous

    def steps(self, dt: float, before: float = np.inf) -> tuple[Array, Array, Array]:
        """The rule of a step of time of each term: h(t + dt) = decay h(t) + gain (y(t + dt) - y(t)) - back (y(t) - y(t - before)).

        Parameters
        ----------
        dt : float, s
        before : float, s
            The step before it; the rule is then exact where y is quadratic over both. By default, and in a step that is more than
            LONGER times as long, y is linear in the step.

        Returns
        -------
        three arrays (n_terms,)
            decay, gain and back.
        """
        before = before if dt <= LONGER * before else np.inf
        x, share = dt / np.array(self.times), dt / (dt + before)
        curved = share * _of_curvature(x)
        return np.exp(-x), -np.expm1(-x) / x + curved, curved * (dt / before)

    def in_series(self, share: float) -> RelaxationFunction:
        """The function of a force of which a share comes from a modulus that does not relax, as of springs in series.

        A force F(mu, kappa) with 1/F = a/mu + b/kappa has the share s = d ln F / d ln kappa = F b / kappa. Where m acts on mu, the
        Laplace transforms m^ and M^ of both functions are related by p M^ = p m^ / (1 - s + s p m^). The rates of M are the
        eigenvalues of diag(r) - v v', with the rates r of m and v_i^2 = s m_i r_i / (1 - s + s m(0)).

        Parameters
        ----------
        share : float
            s, from 0 to below 1, of the elastic force that m = 1 describes.
        """
        kept = np.array(self.shares) > NOTHING
        if share <= SMALLEST_SHARE or not kept.any():
            return self
        rates, number = np.unique(1 / np.array(self.times)[kept], return_inverse=True)  # terms of one time are one term
        shares = np.bincount(number, np.array(self.shares)[kept])
        squares = share * shares * rates / (1 - share + share * self.instantaneous)
        below = _below(rates, squares)
        slower = rates - below
        with np.errstate(divide="ignore"):  # a share too small for its rate to move is none
            steepness = (shares * rates / ((rates - rates[:, None]) + below[:, None]) ** 2).sum(axis=1)
        own = (1 - share) / (share**2 * slower * steepness)
        long_term = self.long_term / (1 - share + share * self.long_term)
        return RelaxationFunction(long_term, tuple(own.tolist()), tuple((1 / slower).tolist()))

    def integral(self, time: Array, values: Array, corner: float | None = None) -> Array:
        """The hereditary integral of m(t - s) dy(s) from the first time on.

        Parameters
        ----------
        time : array (n,), s
            Rising; y is zero before the first time, where it may jump.
        values : array (n, ...)
            y at these times.
        corner : float, s
            y is smooth between the times but for a corner at this one, and taken as quadratic. By default y is linear between them.

        Returns
        -------
        array (n, ...)
        """
        time, values = np.asarray(time, dtype=float), np.asarray(values, dtype=float)
        shares = np.array(self.shares)
        history = np.broadcast_to(values[0], (shares.size, *values[0].shape)).copy()
        total = [self.long_term * values[0] + np.tensordot(shares, history, 1)]
        before, last = np.inf, np.zeros_like(values[0])
        for start, dt, change, now in zip(time[:-1], np.diff(time), np.diff(values, axis=0), values[1:], strict=True):
            rule = self.steps(float(dt), np.inf if is_at(corner, start) else before)
            decay, gain, back = (factor.reshape(-1, *(1,) * now.ndim) for factor in rule)
            history = decay * history + gain * change - back * last
            total.append(self.long_term * now + np.tensordot(shares, history, 1))
            before, last = np.inf if corner is None else float(dt), change
        return np.array(total)


def _below(rates: Array, squares: Array) -> Array:
    """How far below each rate (n,), rising, an eigenvalue of diag(rates) - v v' lies, from the squares of v (n,).

    The eigenvalues lie between the rates. Each is found from the rate above it, so that slow ones beside others that are 14 decades
    faster, as those of fractional functions are, keep their digits; of the whole matrix they would have none.
    """
    if rates[-1] < NARROW * rates[0]:
        v = np.sqrt(squares)
        return np.asarray(rates - np.linalg.eigvalsh(np.diag(rates) - np.outer(v, v)))
    apart, others = rates - rates[:, None], squares * (1 - np.eye(rates.size))
    low, high = np.zeros(rates.size), np.diff(rates, prepend=0.0)
    below = np.minimum(squares, 0.5 * high)
    for step in range(ROOTS):
        rest = (others / (apart + below[:, None])).sum(axis=1)
        deeper = squares / below + rest > 1
        low, high = np.where(deeper, below, low), np.where(deeper, high, below)
        ahead = squares / np.where(rest < 1, 1 - rest, np.inf)
        middle = np.where(low > 0, np.sqrt(low * high), 0.5 * high)
        if np.all(np.abs(ahead - below) <= EXACT * below):
            break
        below = np.where((ahead > low) & (ahead < high) & (step % 3 < 2), ahead, middle)
    return below


def is_at(corner: float | None, time: float) -> bool:
    """Whether a time, s, is that of a corner."""
    return corner is not None and abs(time - corner) <= ROUNDED * corner


def _of_curvature(x: Array) -> Array:
    """The integral of exp(-x w) (1 - 2 w) over w from 0 to 1, (...): what exp(-t / tau) keeps of a slope that grows in a step."""
    small = np.minimum(x, FEW)
    series = small * (1 / 6 - small * (1 / 12 - small * (1 / 40 - small * (1 / 180 - small / 1008))))
    large = np.maximum(x, FEW)
    return np.where(x < FEW, series, (1 + np.exp(-large)) / large + 2 * np.expm1(-large) / large**2)


@dataclass(frozen=True)
class Ramp:
    """Motion of an indenter: a ramp at constant rate, then a hold.

    Attributes
    ----------
    depth : float, mm
        Depth of the hold.
    seconds : float, s
        Duration of the ramp.
    hold : float, s
        Duration of the hold; may be 0.
    """

    depth: float
    seconds: float
    hold: float = 0.0

    @property
    def end(self) -> float:
        """Time at the end of the hold, s."""
        return self.seconds + self.hold

    def depth_at(self, time: float | Array) -> Array:
        """Depth, mm, at times (...), s."""
        return self.depth * np.clip(np.asarray(time, dtype=float) / self.seconds, 0.0, 1.0)

    def times(self, moments: Array | Sequence[float] = ()) -> Array:
        """Times (n,), s, that are dense enough for hereditary integrals: a smooth function of the depth is linear between them.

        Parameters
        ----------
        moments : array (m,), s
            Times that shall be among them.
        """
        rise = np.linspace(0.0, self.seconds, DENSE + 1)
        rest = np.geomspace(self.seconds / DENSE, max(self.hold, self.seconds / DENSE), DENSE)
        times = np.concatenate([rise, self.seconds + rest, np.asarray(moments, dtype=float), [self.end]])
        return np.unique(times[times <= self.end])


def prony(shares: Sequence[float], times: Sequence[float], base: str = "long_term") -> RelaxationFunction:
    """The function of a Prony series.

    Parameters
    ----------
    shares : sequence of float
        g_i.
    times : sequence of float, s
        tau_i.
    base : "long_term" or "instantaneous"
        The elastic stress is the long-term one, m = 1 + sum g_i exp(-t / tau_i), or the instantaneous one,
        m = 1 - sum g_i (1 - exp(-t / tau_i)).

    Returns
    -------
    RelaxationFunction
    """
    return RelaxationFunction(1.0 if base == "long_term" else 1.0 - sum(shares), tuple(shares), tuple(times))


def fractional_in_series(share: float, time: float, order: float, base: str, part: float) -> tuple[float, float]:
    """Share and time of the fractional function that `RelaxationFunction.in_series` makes of one, which is one of the same order.

    With x = (p tau)^alpha, p m^ = (1 + (1 + g) x) / (1 + x) on the long-term base, so that p M^ is one of the same form,
    with the share g (1 - s) / (1 + s g), of (1 + s g) x; on the instantaneous base p m^ = (1 - g + x) / (1 + x), and p M^ is one of
    the same form, with the share g (1 - s) / (1 - s g), of x / (1 - s g).

    Parameters
    ----------
    share : float
        g.
    time : float, s
        tau.
    order : float
        alpha.
    base : "long_term" or "instantaneous"
    part : float
        s, from 0 to below 1, of the elastic force that m = 1 describes.
    """
    stiffer = 1 + part * share if base == "long_term" else 1 - part * share
    return share * (1 - part) / stiffer, time * stiffer ** ((1 if base == "long_term" else -1) / order)


def fractional(share: float, time: float, order: float, base: str, shortest: float, longest: float) -> RelaxationFunction:
    """The function of the fractional Zener model (springs and a spring-pot), a power law between two plateaus.

    m = 1 + g E(-(t / tau)^alpha) on the long-term base, and m = 1 - g (1 - E(-(t / tau)^alpha)) on the instantaneous one, where E
    is the Mittag-Leffler function of order alpha. E is a mixture of exponentials exp(-r t / tau) of density

        K(r) = sin(alpha pi) / pi  r^(alpha - 1) / (r^(2 alpha) + 2 r^alpha cos(alpha pi) + 1)

    (Gorenflo and Mainardi 1997), which the trapezoidal rule sums in log(r), or where K has a narrow peak, near order 1, in a
    coordinate in which it is wide (`_rule`). Rates that are so slow that they do nothing within `longest` add to the long-term
    plateau; rates so fast that they are over within `shortest` are left out.

    Parameters
    ----------
    share : float
        g.
    time : float, s
        tau.
    order : float
        alpha, 0.05 to 0.95.
    base : "long_term" or "instantaneous"
    shortest, longest : float, s
        The times between which the function is needed; its value at zero is that at a hundredth of `shortest`.

    Returns
    -------
    RelaxationFunction
    """
    plateau = 1.0 if base == "long_term" else 1.0 - share
    logs, widths = _rule(order)
    weights = share * widths * _density(logs, order)
    slow, fast = logs < np.log(1e-6 * time / longest), logs > np.log(1e2 * time / shortest)
    kept = ~slow & ~fast
    return RelaxationFunction(plateau + float(weights[slow].sum()), tuple(weights[kept]), tuple(time * np.exp(-logs[kept])))


def _rule(order: float) -> tuple[Array, Array]:
    """Logarithms (n,) of the rates that stand for the others, in units of 1 / tau, and their widths.

    The density has poles at +-i p, p = pi (1 - order) / order. With log r = u - cos(v)^2 tanh u and v - sin(2 v) / 2 = p, the
    function of u has none nearer than +-i v, and near order 1 v is far larger than p: a few rates crowd at the peak.
    """
    pole = np.pi * (1 - order) / order
    low, high = 0.0, np.pi / 2
    for _ in range(HALVINGS if pole < high else 0):
        middle = (low + high) / 2
        low, high = (middle, high) if middle - np.sin(2 * middle) / 2 < pole else (low, middle)
    bend = np.cos(high) ** 2
    step = min(STEP, OF_POLE * max(high, pole))
    u = np.arange(-REACH / order, REACH / order, step)
    flat = np.tanh(u)
    return u - bend * flat, step * (1 - bend * (1 - flat**2))


def _density(logs: Array, order: float) -> Array:
    """r K(r) (n,), the density of the logarithm of the rate r in units of 1 / tau, at logarithms (n,)."""
    return np.sin(order * np.pi) / (2 * np.pi) / (np.cosh(order * logs) + np.cos(order * np.pi))
