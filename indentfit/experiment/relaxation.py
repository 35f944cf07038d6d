"""Stress relaxation: the force of a hold as a Prony series that takes the ramp before the hold into account.

With the relaxation G(t) / G0 = 1 - sum g_i (1 - exp(-t / tau_i)) and a ramp of duration T at constant rate, the force at a time t
after the ramp's end is F0 [1 - sum g_i (1 - (tau_i / T) (1 - exp(-T / tau_i)) exp(-t / tau_i))], where F0 is the force that an
infinitely fast ramp would have reached (Boltzmann's integral over the ramp). A hold does not show what relaxed during the ramp, and
gels relax over many decades of time: fits with more terms give a higher G0. `by_terms` therefore lists the ratio for each number of
terms.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.optimize import least_squares

from indentfit.arrays import Array

BINS = 240  # averages of a hold, at equal steps of the logarithm of time
MOST_TERMS = 3
SETTLING = 0.5  # durations of the ramp after its end: the rig rings then, and these samples are left out
Values = Sequence[float] | Array


@dataclass(frozen=True)
class Prony:
    """A Prony series fitted to a hold, with standard errors.

    Attributes
    ----------
    instantaneous : float, mN
        F0.
    shares : tuple of float
        g_i, shares of G0.
    times : tuple of float, s
        tau_i, in rising order.
    ratio : float
        Ginf / G0.
    rmse : float, mN
        Root mean square error of the averaged hold.
    bic : float
        Schwarz's criterion.
    ramp : float, s
        Duration of the ramp.
    by_terms : dict
        Number of terms -> ratio.
    """

    instantaneous: float
    instantaneous_stderr: float
    shares: tuple[float, ...]
    shares_stderr: tuple[float, ...]
    times: tuple[float, ...]
    times_stderr: tuple[float, ...]
    ratio: float
    ratio_stderr: float
    rmse: float
    bic: float
    ramp: float
    by_terms: dict[int, float] = field(default_factory=dict)

    def force(self, time: Array) -> Array:
        """Force (n,), mN, at times (n,), s, after the end of the ramp."""
        return _force(np.asarray(time, dtype=float), self.instantaneous, self.shares, self.times, self.ramp)


def fit_prony(time: Array, force: Array, ramp: float, terms: int | str = 2) -> Prony:
    """The `Prony` series of a hold.

    Parameters
    ----------
    time : array (n,), s
        Time from the end of the ramp.
    force : array (n,), mN
    ramp : float, s
        Duration of the ramp.
    terms : int or "auto"
        Number of terms, 1 to 3; "auto" takes the number with the least Bayesian information criterion.

    Returns
    -------
    Prony

    Raises
    ------
    ValueError
        The hold is too short, or the number of terms is impossible.
    """
    if terms != "auto" and terms not in range(1, MOST_TERMS + 1):
        raise ValueError(f"a Prony series of {terms} terms; 1 to {MOST_TERMS} are possible")
    time, force = np.asarray(time, dtype=float), np.asarray(force, dtype=float)
    settled = time > SETTLING * ramp
    if np.count_nonzero(settled) < 50 or time[-1] < 2 * ramp:
        raise ValueError(f"a hold of {time[-1]:.3g} s after a ramp of {ramp:.3g} s is too short for a Prony series")
    times, forces = _averaged(time[settled], force[settled])
    fits = {n: _fit(times, forces, ramp, n) for n in range(1, MOST_TERMS + 1)}
    chosen = min(fits.values(), key=lambda fit: fit.bic) if isinstance(terms, str) else fits[terms]
    return replace(chosen, by_terms={n: fit.ratio for n, fit in fits.items()})


def _averaged(time: Array, force: Array) -> tuple[Array, Array]:
    """Means of time and force (m,) in bins of equal ratio."""
    edges = np.unique(np.searchsorted(time, np.geomspace(time[0], time[-1], BINS)))
    counts = np.diff(np.append(edges, time.size))
    return np.add.reduceat(time, edges) / counts, np.add.reduceat(force, edges) / counts


def _force(time: Array, instantaneous: float, shares: Values, times: Values, ramp: float) -> Array:
    lost = sum(g * (1 - (tau / ramp) * -np.expm1(-ramp / tau) * np.exp(-time / tau)) for g, tau in zip(shares, times, strict=True))
    return instantaneous * (1 - lost)


def _fit(time: Array, force: Array, ramp: float, terms: int) -> Prony:
    """Bounded least squares in F0, the shares and the logarithms of the times; equal weights in logarithmic time."""
    shortest, longest = ramp, 2 * time[-1]  # times that are shorter than the ramp cannot be fitted
    starts = np.geomspace(shortest, longest / 6, terms + 2)[1:-1]
    start = np.concatenate([[force[0]], np.full(terms, 0.5 * (1 - force[-1] / force[0]) / terms + 1e-3), np.log(starts)])
    low = np.concatenate([[0.1 * force.max()], np.zeros(terms), np.full(terms, np.log(shortest))])
    high = np.concatenate([[10 * force.max()], np.ones(terms), np.full(terms, np.log(longest))])

    def residual(values: Array) -> Array:
        return _force(time, values[0], values[1 : 1 + terms], np.exp(values[1 + terms :]), ramp) - force

    solution = least_squares(residual, np.clip(start, low + 1e-9, high - 1e-9), bounds=(low, high), x_scale="jac")
    covariance = _covariance(solution.jac, solution.fun)
    return _prony(solution.x, covariance, solution.fun, terms, ramp)


def _covariance(jacobian: Array, residual: Array) -> Array:
    """Covariance of the values: a sandwich with Bartlett weights over 12 averages, because neighbouring averages are correlated."""
    n, p = jacobian.shape
    bread = np.linalg.pinv(jacobian.T @ jacobian)
    scores = jacobian * residual[:, None]
    meat, reach = scores.T @ scores, 12
    for lag in range(1, reach + 1):
        shifted = (1 - lag / (reach + 1)) * scores[lag:].T @ scores[:-lag]
        meat += shifted + shifted.T
    return bread @ meat @ bread * n / max(n - p, 1)


def _prony(values: Array, covariance: Array, residual: Array, terms: int, ramp: float) -> Prony:
    """The series of fitted values: F0, shares, logarithms of times."""
    order = np.argsort(values[1 + terms :])
    shares, times = values[1 : 1 + terms][order], np.exp(values[1 + terms :][order])
    errors = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    n = residual.size
    sum_of_shares = np.zeros(values.size)
    sum_of_shares[1 : 1 + terms] = 1.0
    return Prony(
        instantaneous=float(values[0]),
        instantaneous_stderr=float(errors[0]),
        shares=tuple(shares.tolist()),
        shares_stderr=tuple(errors[1 : 1 + terms][order].tolist()),
        times=tuple(times.tolist()),
        times_stderr=tuple((times * errors[1 + terms :][order]).tolist()),
        ratio=float(1 - shares.sum()),
        ratio_stderr=float(np.sqrt(np.maximum(sum_of_shares @ covariance @ sum_of_shares, 0.0))),
        rmse=float(np.sqrt(np.mean(residual**2))),
        bic=float(n * np.log(np.maximum(np.mean(residual**2), 1e-300)) + values.size * np.log(n)),
        ramp=float(ramp),
    )
