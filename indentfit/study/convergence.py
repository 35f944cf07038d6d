"""Discretisation error of a quantity computed on several meshes: observed order, extrapolation, error bands.

Two published methods, side by side:

- `fitted`: least squares over the whole family, f(h) = f0 + C h^p, and its uncertainty of each mesh (Eca and Hoekstra
  2014, J Comput Phys 262:104-130). The fit tolerates the scatter of meshes that are not nested, and reports where it does
  not. Their uncertainty is a rule of thumb that grows without limit where the order cannot be observed. `fitted` also gives
  the 95 % profile interval of f0 under the same fit, with the order free between its bounds; the tests measure the coverage
  of this interval. Where the order is not believed, the interval is widened by three distances of the finest mesh from the
  limit of a first order.
- `grid_convergence_index`: Roache's index from the three finest meshes by the procedure of Celik et al. 2008 (J Fluids
  Eng 130:078001), which holds only where the three change in one direction.

Element sizes h (n,) in mm, values f (n,) in any unit; the order of the meshes does not matter.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq, minimize_scalar
from scipy.special import fdtri

from indentfit.arrays import Array

SMALLEST_ORDER, LARGEST_ORDER = 0.5, 2.1  # an observed order beyond these bounds is not believed (Eca and Hoekstra)
RELIABLE, UNRELIABLE = 1.25, 3.0  # safety factors
EDGE_ORDER = 1.0  # order of the force under a singular edge, for elements of any degree
SEARCHED = (0.05, 8.0)  # range of orders that is searched


@dataclass(frozen=True)
class Approach:
    """f(h) = value + sum of coefficients times h^exponents, with the standard deviation of its fit.

    Parameters
    ----------
    value : float
        The value at zero size.
    coefficients, exponents : tuples of float
    deviation : float
    order : float or None
        The observed order; None where it is not believed, and fixed exponents replace it.
    raw_order : float
        The order of the best fit, whether it is believed or not.
    reliable : bool
        Whether order and scatter allow the smaller safety factor of Eca and Hoekstra.
    interval : (low, high)
        Interval of the value at zero size, 95 % or widened.
    uncertainty : array (n,)
        Half-width of each mesh's band by Eca and Hoekstra, in the order given.
    """

    value: float
    coefficients: tuple[float, ...]
    exponents: tuple[float, ...]
    deviation: float
    order: float | None
    raw_order: float
    reliable: bool
    interval: tuple[float, float]
    uncertainty: Array

    def band(self, f: ArrayLike) -> Array:
        """Largest errors (n,) of the meshes' own values f (n,): their distances from the far end of the interval."""
        return np.abs(np.subtract.outer(np.asarray(f), self.interval)).max(axis=1)

    def at(self, h: ArrayLike) -> Array:
        """Fitted values at element sizes h, mm."""
        size = np.asarray(h, dtype=float)
        return self.value + np.sum([c * size**p for c, p in zip(self.coefficients, self.exponents, strict=True)], axis=0)

    @classmethod
    def from_json(cls, value: Mapping[str, Any]) -> "Approach":
        tuples = {name: tuple(value[name]) for name in ("coefficients", "exponents", "interval")}
        return cls(**{**value, **tuples, "uncertainty": np.array(value["uncertainty"], dtype=float)})


@dataclass(frozen=True)
class Index:
    """Roache's grid convergence index of the finest of three meshes.

    Parameters
    ----------
    order, extrapolated : float or None
        Observed order, and value at zero size.
    index : float or None
        A share of the finest mesh's value.
    kind : str
        "monotone"; or "oscillatory" or "diverging", where the numbers are None.
    """

    order: float | None
    extrapolated: float | None
    index: float | None
    kind: str


def fitted(h: ArrayLike, f: ArrayLike) -> Approach:
    """The Approach of values on several meshes to zero element size.

    Parameters
    ----------
    h : array (n,), mm
        Element sizes, n >= 4.
    f : array (n,)
        Values.

    Returns
    -------
    Approach
    """
    h, f = np.asarray(h, dtype=float), np.asarray(f, dtype=float)
    free = _best_power(h, f)
    order = free.exponents[0]
    if SMALLEST_ORDER <= order <= LARGEST_ORDER:
        best, believed = free, order
    else:
        choices = [(1.0,), (2.0,)] if order > LARGEST_ORDER else [(1.0,), (2.0,), (1.0, 2.0)]
        best, believed = min((_least_squares(h, f, p) for p in choices), key=lambda fit: fit.deviation), None
    spread = np.ptp(f) / (f.size - 1)
    reliable = believed is not None and best.deviation < spread
    return Approach(
        best.value, best.coefficients, best.exponents, best.deviation, believed, order, reliable,
        _interval(h, f) if believed else _widened(h, f), _uncertainty(best, h, f, spread, reliable),
    )  # fmt: skip


def grid_convergence_index(h: ArrayLike, f: ArrayLike) -> Index | None:
    """The Index of the three finest meshes.

    Parameters
    ----------
    h : array (n,), mm
        Element sizes.
    f : array (n,)
        Values.

    Returns
    -------
    Index or None
        None for fewer than three meshes, or equal sizes.
    """
    h, f = np.asarray(h, dtype=float), np.asarray(f, dtype=float)
    if np.unique(h).size < 3:
        return None
    finest = np.argsort(h)[:3]
    (h1, h2, h3), (f1, f2, f3) = h[finest], f[finest]
    e21, e32 = f2 - f1, f3 - f2
    if not e21 or e32 / e21 <= 0:
        return Index(None, None, None, "oscillatory")
    order = _celik_order(h2 / h1, h3 / h2, e32 / e21)
    if order is None:
        return Index(None, None, None, "diverging")
    growth = (h2 / h1) ** order - 1
    return Index(order, float(f1 - e21 / growth), float(RELIABLE * abs(e21 / f1) / growth), "monotone")


@dataclass(frozen=True)
class _Fit:
    value: float
    coefficients: tuple[float, ...]
    exponents: tuple[float, ...]
    deviation: float


def _best_power(h: Array, f: Array) -> _Fit:
    """The fit over all orders, with the exponent of least deviation: a scan, then a refinement around its best."""
    orders = np.geomspace(*SEARCHED, 60)
    deviations = [_least_squares(h, f, (p,)).deviation for p in orders]
    n = int(np.argmin(deviations))
    low, high = orders[max(n - 1, 0)], orders[min(n + 1, orders.size - 1)]
    best = minimize_scalar(
        lambda p: _least_squares(h, f, (p,)).deviation, bounds=(low, high), method="bounded", options={"xatol": 1e-9}
    )
    return _least_squares(h, f, (float(best.x),), extra=1)


def _least_squares(h: Array, f: Array, exponents: tuple[float, ...], extra: int = 0) -> _Fit:
    """Least squares weighted by 1/h, so that fine meshes count more; `extra`: fitted numbers beside the coefficients."""
    weights = 1 / h / np.sum(1 / h)
    columns = np.column_stack([np.ones_like(h), *(h**p for p in exponents)])
    root = np.sqrt(weights)
    solution = np.linalg.lstsq(columns * root[:, None], f * root, rcond=None)[0]
    squares = np.sum(weights * (f - columns @ solution) ** 2)
    freedom = max(h.size - columns.shape[1] - extra, 1)
    deviation = float(np.sqrt(h.size * squares / freedom))
    return _Fit(float(solution[0]), tuple(map(float, solution[1:])), tuple(map(float, exponents)), deviation)


def _interval(h: Array, f: Array) -> tuple[float, float]:
    """95 % interval of f0 by the profile of the weighted sum of squares, the order free between its bounds."""
    weights = h.size / h / np.sum(1 / h)
    freedom = max(h.size - 3, 1)
    fits = []
    for p in np.linspace(SMALLEST_ORDER, LARGEST_ORDER, 65):
        columns = np.column_stack([np.ones_like(h), h**p]) * np.sqrt(weights)[:, None]
        solution = np.linalg.lstsq(columns, f * np.sqrt(weights), rcond=None)[0]
        squares = np.sum((f * np.sqrt(weights) - columns @ solution) ** 2)
        fits.append((solution[0], squares, np.linalg.inv(columns.T @ columns)[0, 0]))
    value, squares, share = np.array(fits).T
    largest = squares.min() * (1 + fdtri(1, freedom, 0.95) / freedom)
    half = np.sqrt(np.maximum(largest - squares, 0) * share)
    allowed = squares <= largest
    return float((value - half)[allowed].min()), float((value + half)[allowed].max())


def _widened(h: Array, f: Array) -> tuple[float, float]:
    """The interval where no order could be observed, which includes Roache's safety factor about the finest mesh's value."""
    low, high = _interval(h, f)
    finest = float(f[np.argmin(h)])
    half = UNRELIABLE * abs(finest - _least_squares(h, f, (EDGE_ORDER,)).value)
    return min(low, finest - half), max(high, finest + half)


def _uncertainty(fit: _Fit, h: Array, f: Array, spread: float, reliable: bool) -> Array:
    """Half-widths (n,) by equations (17) and (18) of Eca and Hoekstra."""
    model = fit.value + sum(c * h**p for c, p in zip(fit.coefficients, fit.exponents, strict=True))
    error, scatter = np.abs(model - fit.value), np.abs(f - model)
    if fit.deviation < spread or not spread:
        return (RELIABLE if reliable else UNRELIABLE) * error + fit.deviation + scatter
    return UNRELIABLE * fit.deviation / spread * (error + fit.deviation + scatter)


def _celik_order(r21: float, r32: float, ratio: float) -> float | None:
    """The p of e32 / e21 = r21^p (r32^p - 1) / (r21^p - 1); None where no order above zero fits."""

    def gap(p: float) -> float:
        return np.log(np.expm1(p * np.log(r32)) / np.expm1(p * np.log(r21))) + p * np.log(r21) - np.log(ratio)

    low, high = 1e-3, 20.0
    return float(brentq(gap, low, high)) if gap(low) * gap(high) < 0 else None
