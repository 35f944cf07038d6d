"""Principal stretches as invariants: sums over the three stretches, with their derivatives by I1 and I2.

The squares z of the principal stretches of Cb are the roots of p(z) = z^3 - I1 z^2 + I2 z - 1, because det Cb = 1. Single stretches
have no finite derivatives where two are equal, as at rest; a sum S = f(l1) + f(l2) + f(l3) of a smooth f has: it is a contour
integral of f'(z) log p(z), so that with g = df/dz

    dS/dI1 = [z^2 g],  dS/dI2 = -[z g],  d2S/dI1^2 = {z^4 g},  d2S/dI1 dI2 = -{z^3 g},  d2S/dI2^2 = {z^2 g},

where [ ] is the divided difference on z1, z2, z3 and { } the one on the same points, each counted twice. All five are linear in the
Taylor coefficients of f at centres of clusters of roots, with weights that depend on I1 and I2 only:

- three roots close together: one series around their mean I1/3, whose weights follow from I1 and I2 without any root;
- two roots close together: one series around their mean, and value and slope of g at the third root;
- roots apart: value and slope of g at each.

No gap between roots is a divisor unless it is large, and round-off in I1 and I2 does no more than a change of I1 and I2 of that
size. So the element loop and the forms meet principal stretches as functions of I1 and I2 (`tests/test_stretches.py`: how exact).
Divided differences: de Boor 2005, Surv Approx Theory 1:46.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from indentfit.arrays import Array, Ints
from indentfit.material.series import Power, Series

STRETCHES = ("l1", "l2", "l3")
"""Principal stretches of Cb = J^(-2/3) F^T F; an energy is a function of sums over them, such as l1**a + l2**a + l3**a."""

VALUE, FIRST, SECOND = slice(0, 1), slice(1, 3), slice(3, 6)
ROWS = (1, 3, 6)  # S; and its first; and its second derivatives by I1, I2: 11, 12, 22
BLOCK = 2048  # points that are worked on at once, so that their weights stay in the processor's cache
COMPILED_FROM = 64  # points from which compiled code is worth its import
NEAR = 0.03  # of the spread 3 - I2 / c^2 of three roots around their mean c: all within about 0.2 c of it
PAIR = 0.02  # of the square of half the gap of two roots over their mean
TERMS, PAIR_TERMS = 28, 24  # highest powers of the series around three roots and around two


@dataclass(frozen=True, eq=False)
class Piece:
    """The share of one cluster of roots in sums at some points.

    Parameters
    ----------
    at : array of int (m,)
        The points.
    centre : array (m,)
        Centre c of the cluster.
    weights : array (rows, order + 1, m)
        Weight of each coefficient of the series of f in u, z = c (1 + u), in the sum and its derivatives.
    """

    at: Ints
    centre: Array
    weights: Array

    def shares(self, function: Callable[[Power], Any]) -> Array:
        """Shares (rows, m) in the sum of a function of the stretch, and in its derivatives."""
        series = function(Power(self.centre, 0.5, self.weights.shape[1] - 1))
        if not isinstance(series, Series):  # a constant
            return self.weights[:, 0] * series
        return np.einsum("rkm,km->rm", self.weights, series.terms)


def sums(functions: Sequence[Callable[[Power], Any]], I1: Array, I2: Array, derivatives: int) -> Array:
    """Sums over the three principal stretches, with their derivatives by I1 and I2.

    Parameters
    ----------
    functions : sequence of functions
        Each of one stretch, given as a series.
    I1, I2 : arrays (n,)
        Isochoric invariants. Where they belong to no deformation, the sums are nan.
    derivatives : int
        0, 1 or 2: how far to differentiate.

    Returns
    -------
    array (len(functions), 1, 3 or 6, n)
        S; dS/dI1, dS/dI2; d2S/dI1^2, d2S/dI1 dI2, d2S/dI2^2.
    """
    out = np.zeros((len(functions), ROWS[derivatives], I1.size))
    with np.errstate(all="ignore"):
        for start in range(0, I1.size, BLOCK):
            block = slice(start, start + BLOCK)
            _add_block(functions, I1[block], I2[block], out[:, :, block], derivatives)
    return out


def _add_block(functions: Sequence[Callable[[Power], Any]], I1: Array, I2: Array, out: Array, derivatives: int) -> None:
    """Adds the sums of some points to out, sorted out by the distances of their roots."""
    spread = 3 - I2 / (I1 / 3) ** 2
    near = np.abs(spread) <= NEAR
    if near.any():
        at = np.flatnonzero(near)
        c, P = I1[at] / 3, spread[at]
        if at.size >= COMPILED_FROM:
            out[:, :, at] = _compiled_near(functions, c, P, derivatives)
        else:
            _add(functions, _triple(at, c, P, derivatives), out)
    if not near.all():
        at = np.flatnonzero(~near)
        for piece in _apart(at, I1[at], I2[at], derivatives):
            _add(functions, piece, out)


def _add(functions: Sequence[Callable[[Power], Any]], piece: Piece, out: Array) -> None:
    for k, function in enumerate(functions):
        out[k, :, piece.at] += piece.shares(function).T


def _compiled_near(functions: Sequence[Callable[[Power], Any]], c: Array, P: Array, derivatives: int) -> Array:
    """What `_triple` gives, at many points."""
    from indentfit.material.near import near_sums

    variable = Power(c, 0.5, TERMS)
    terms = np.zeros((len(functions), TERMS + 1, c.size))
    for k, function in enumerate(functions):
        series = function(variable)
        terms[k] = series.terms if isinstance(series, Series) else [[series]] + [[0.0]] * TERMS
    out = np.empty((len(functions), ROWS[derivatives], c.size))
    near_sums(c, P, terms, out)
    return out


def _triple(at: Ints, c: Array, P: Array, derivatives: int) -> Piece:
    """Three roots around their mean c: u^3 = P u + Q of their deviations u."""
    Q = 1 / c**3 - 1 + P
    powers = _recurrence([3 + 0 * P, 0 * P, 2 * P], [(2, P), (3, Q)], TERMS + 1)
    weights = np.zeros((ROWS[derivatives], TERMS + 1, at.size))
    weights[0] = powers
    if derivatives:
        single = _recurrence([0 * P, 0 * P, 1 + 0 * P], [(2, P), (3, Q)], TERMS + 2)
        _fill_first(weights, single, c)
    if derivatives > 1:
        twice = [(2, 2 * P), (3, 2 * Q), (4, -(P**2)), (5, -2 * P * Q), (6, -(Q**2))]
        double = _recurrence([*[0 * P] * 5, 1 + 0 * P], twice, TERMS + 4)
        _fill_second(weights, double, c)
    return Piece(at, c, weights)


def _recurrence(first: list[Array], steps: list[tuple[int, Array]], length: int) -> Array:
    """first, then up to the length the sum of factor * (the entry so many places before)."""
    terms = np.zeros((length, first[0].size))
    terms[: len(first)] = first
    for n in range(len(first), length):
        for back, factor in steps:
            if back <= n:
                terms[n] += factor * terms[n - back]
    return terms


def _fill_first(weights: Array, a: Array, c: Array) -> None:
    """Rows of the first derivatives, from divided differences a[n] of u^n (order + 1 of them) on the roots."""
    order = np.arange(1, weights.shape[1])[:, None]
    once = a[:-1] + a[1:]  # of (1 + u) u^n
    twice = once[:-1] + once[1:]
    weights[1, 1:] = order * twice[: len(order)] / c
    weights[2, 1:] = -order * once[: len(order)] / c**2


def _fill_second(weights: Array, b: Array, c: Array) -> None:
    """Rows of the second derivatives, from divided differences b[n] of u^n on the roots, each counted twice."""
    order = np.arange(1, weights.shape[1])[:, None]
    raised = b
    for row, power in ((None, 1), (5, 2), (4, 3), (3, 4)):
        raised = raised[:-1] + raised[1:]  # of (1 + u)^power u^n
        if row is not None:
            weights[row, 1:] = (-1) ** power * order * raised[: len(order)] * c ** (power - 6.0)


def _apart(at: Ints, I1: Array, I2: Array, derivatives: int) -> Iterator[Piece]:
    """A root apart from the two others, and these, together or one by one."""
    alone, total, product = _isolated(I1, I2)
    c = total / 2
    R = 1 - product / c**2  # the square of half the gap of the pair, over its mean
    yield _simple(at, alone, (alone - c) ** 2 - c**2 * R, 2 * (alone - c), derivatives)
    together = np.abs(R) <= PAIR
    if together.any():
        m = together
        yield _pair(at[m], c[m], R[m], alone[m] / c[m] - 1, derivatives)
    if not together.all():
        m = ~together
        half = c[m] * np.sqrt(R[m])
        for root, gap in ((c[m] + half, 2 * half), (c[m] - half, -2 * half)):
            yield _simple(at[m], root, gap * (root - alone[m]), gap + root - alone[m], derivatives)


def _isolated(I1: Array, I2: Array) -> tuple[Array, Array, Array]:
    """The root whose ratio to its neighbour is largest, and sum and product of the other two, each to round-off.

    p(1) = I2 - I1 tells whether the middle root is above 1, where the smallest root is the isolated one: then 1/z are the roots of
    the polynomial with I1 and I2 exchanged.
    """
    swapped = I2 > I1
    a, b = np.where(swapped, I2, I1), np.where(swapped, I1, I2)
    c = a / 3
    s = np.sqrt((3 - b / c**2) / 3)
    cosine = np.clip((1 / c**3 - 1 + 3 * s**2) / (2 * s**3), -1, 1)
    z = c * (1 + 2 * s * np.cos(np.arccos(cosine) / 3))  # the largest root
    z = z - (((z - a) * z + b) * z - 1) / ((3 * z - 2 * a) * z + b)
    total = b - 1 / z
    return np.where(swapped, 1 / z, z), np.where(swapped, total, total / z), np.where(swapped, z, 1 / z)


def _simple(at: Ints, z: Array, q: Array, slope: Array, derivatives: int) -> Piece:
    """One root z; q and slope: the product of its distances from the other two, and the derivative of that product by z."""
    weights = np.zeros((ROWS[derivatives], derivatives + 1, at.size))
    weights[0, 0] = 1
    if derivatives:
        weights[1, 1], weights[2, 1] = z / q, -1 / q
    if derivatives > 1:
        for row, k in ((3, 4), (4, 3), (5, 2)):
            weights[row, 1] = (-1) ** k * z ** (k - 2.0) * (k - 2 * z * slope / q) / q**2
            weights[row, 2] = (-1) ** k * 2 * z ** (k - 2.0) / q**2
    return Piece(at, z, weights)


def _pair(at: Ints, c: Array, R: Array, v: Array, derivatives: int) -> Piece:
    """Two roots c (1 + u) with u^2 = R, the third at u = v: divided differences of u^n / (u - v) and of u^n / (u - v)^2."""
    m = np.arange((PAIR_TERMS + 6) // 2)[:, None]
    powers = R ** m.astype(float)
    D = 1 / (R - v**2)
    weights = np.zeros((ROWS[derivatives], PAIR_TERMS + 1, at.size))
    weights[0, 0::2] = 2 * powers[: PAIR_TERMS // 2 + 1]
    if derivatives:
        _fill_first(weights, _alternate(D * powers, v * D * powers), c)
    if derivatives > 1:
        lower = m * np.concatenate([0 * powers[:1], powers[:-1]])  # the derivative of R^m
        even = 2 * v * D**2 * (lower - 2 * D * powers)
        odd = D**2 * ((R + v**2) * (lower - 2 * D * powers) + powers)
        _fill_second(weights, _alternate(even, odd), c)
    return Piece(at, c, weights)


def _alternate(even: Array, odd: Array) -> Array:
    """even[0], odd[0], even[1], ..."""
    return np.stack([even, odd], axis=1).reshape(-1, even.shape[1])
