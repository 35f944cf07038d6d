"""Chebyshev polynomials of a total degree in warped parameters, and the places that determine such a polynomial best.

Each range is stretched at its lower end, u -> t = 2 log(1 + beta u) / log(1 + beta) - 1, since stiffness enters curves by ratios.
Inputs whose effect has a limit are warped otherwise. A beta of -1 or below stands for the reciprocal,
t = 2 (1 + b) u / (1 + b u) - 1 with b = -beta, which is linear in 1 / kappa if b = max / min - 1. A beta between -1 and 0 stands
for u that stops growing at c = -beta, u / (1 + (u / c)^6)^(1/6): the force grows so with friction, until the contact sticks.
"""

import functools
import math
from collections.abc import Callable
from itertools import product
from typing import Any

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray
from scipy.stats import qmc

from indentfit.arrays import Array, Ints

USUAL_BETA = 10.0  # beta of the first runs
SHARP = 6.0  # how sharply a clipped range stops growing
SPARE = 1.15  # least number of rows of a fit for each coefficient
OF_SLOPES = 0.3  # weight of a derivative by t relative to a value
LEVELS = 5  # levels of each parameter in the grid from which the first runs are chosen
DRAWN = 128  # further places, drawn at random, from which the first runs are chosen


def warp(u: Array, betas: Array) -> Array:
    """Places in units of the ranges, (..., d), as the polynomials' variables, -1..1."""
    return 2 * _by_kind(betas, (_logarithm, _reciprocal, _clip), u, u) - 1


def unwarp(t: Array, betas: Array) -> Array:
    """The inverse of `warp`."""
    half = (t + 1) / 2
    return _by_kind(betas, (_from_logarithm, _from_reciprocal, _from_clip), half, half)


def stretch(places: Array, betas: Array) -> Array:
    """dt/du, (m, d), at places in units of the ranges."""
    return 2 * _by_kind(betas, (_logarithm_slope, _reciprocal_slope, _clip_slope), places, np.ones_like(places))


Warp = Callable[[Array, Array], Array]


def _by_kind(betas: Array, functions: tuple[Warp, Warp, Warp], x: Array, plain: Array) -> Array:
    """Each column by the function that its beta asks for; `plain` where beta is 0."""
    warped = np.array(plain, dtype=float)
    with np.errstate(all="ignore"):
        for kind, columns, b in _kinds(tuple(betas)):
            warped[..., columns] = functions[kind](x[..., columns], b)
    return warped


@functools.lru_cache(maxsize=1024)
def _kinds(betas: tuple[float, ...]) -> list[tuple[int, Ints, Array]]:
    """Number of the function, columns, and its argument, for each kind among the betas."""
    b = np.array(betas)
    kinds = [(b > 0, 1), (b <= -1, -1), ((b > -1) & (b < 0), -1)]
    return [(n, np.flatnonzero(own), sign * b[own]) for n, (own, sign) in enumerate(kinds) if own.any()]


def _logarithm(u: Array, b: Array) -> Array:
    return np.log1p(b * u) / np.log1p(b)


def _from_logarithm(s: Array, b: Array) -> Array:
    return np.expm1(s * np.log1p(b)) / b


def _logarithm_slope(u: Array, b: Array) -> Array:
    return b / ((1 + b * u) * np.log1p(b))


def _reciprocal(u: Array, b: Array) -> Array:
    return (1 + b) * u / (1 + b * u)


def _from_reciprocal(s: Array, b: Array) -> Array:
    return s / (1 + b - b * s)


def _reciprocal_slope(u: Array, b: Array) -> Array:
    return (1 + b) / (1 + b * u) ** 2


def _clip(u: Array, c: Array) -> Array:
    return u / (1 + (u / c) ** SHARP) ** (1 / SHARP) / _plateau(c)


def _from_clip(s: Array, c: Array) -> Array:
    v = s * _plateau(c)
    return np.minimum(v / np.maximum(1 - (v / c) ** SHARP, 1e-300) ** (1 / SHARP), 1.0)


def _clip_slope(u: Array, c: Array) -> Array:
    return (1 + (u / c) ** SHARP) ** (-1 - 1 / SHARP) / _plateau(c)


def _plateau(c: Array) -> Array:
    return 1 / (1 + c**-SHARP) ** (1 / SHARP)


@functools.lru_cache(maxsize=64)
def powers(d: int, degree: int) -> list[tuple[int, ...]]:
    """The degrees by each of d variables of every polynomial up to a total degree."""
    return [degrees for degrees in product(range(degree + 1), repeat=d) if sum(degrees) <= degree]


def values(places: Array, betas: Array, degree: int) -> Array:
    """The polynomials at places (m, d) in units of the ranges, (m, coefficients)."""
    vanders = _chebyshev(warp(places, betas), degree)
    return _products(vanders, len(betas), degree)


def by_t(places: Array, betas: Array, degree: int) -> list[Array]:
    """Derivatives of the polynomials by each t, a list of (m, coefficients)."""
    vanders, D = _chebyshev(warp(places, betas), degree), _derivation(degree)
    derivatives: list[Array] = []
    for k in range(len(betas)):
        derived = vanders.copy()
        derived[:, k] = vanders[:, k] @ D.T
        derivatives.append(_products(derived, len(betas), degree))
    return derivatives


def _chebyshev(t: Array, degree: int) -> Array:
    """Chebyshev polynomials of each variable, (m, d, degree + 1), at t (m, d)."""
    vanders = np.ones((*t.shape, degree + 1))
    if degree:
        vanders[..., 1], twice = t, 2 * t
        for n in range(2, degree + 1):
            vanders[..., n] = vanders[..., n - 1] * twice - vanders[..., n - 2]
    return vanders


@functools.cache
def _derivation(degree: int) -> Array:
    """Matrix that differentiates Chebyshev polynomials up to a degree."""
    D = np.zeros((degree + 1, degree + 1))
    D[:, :-1] = chebyshev.chebder(np.eye(degree + 1)).T if degree else 0
    return D


def by_units(places: Array, betas: Array, degree: int) -> list[Array]:
    """Derivatives of the polynomials by each parameter in units of its range, a list of (m, coefficients)."""
    ahead = stretch(places, betas)
    return [ahead[:, [k]] * A for k, A in enumerate(by_t(places, betas, degree))]


def at_place(place: Array, betas: Array, degree: int) -> Array:
    """The polynomials at one place (d,) in units of the ranges, and their derivatives by each parameter there, (1 + d,
    coefficients): the same as `values` and `by_units`, for searches that ask place by place."""
    d, (ordinary, derived) = len(betas), _from_powers(degree)
    t, ahead = np.array([_warped(u, beta) for u, beta in zip(place.tolist(), betas.tolist(), strict=True)]).T
    raised = t[:, None] ** np.arange(degree + 1)
    places = _places(d, degree)
    V, slopes = (raised @ ordinary).take(places), (ahead[:, None] * (raised @ derived)).take(places)
    rows = np.ones((1 + d, places.shape[1]))
    for k in range(d):  # each row but the first has the slope of its own parameter, and the values of all others
        rows[1 + k] = rows[0] * slopes[k]
        rows[: 1 + k] *= V[k]
    return rows


@functools.cache
def _from_powers(degree: int) -> tuple[Array, Array]:
    """Matrices that make the Chebyshev polynomials, and their derivatives, of the powers of a number."""
    ordinary = np.array([np.pad(chebyshev.cheb2poly(row), (0, degree + 1))[: degree + 1] for row in np.eye(degree + 1)]).T
    derived = np.zeros_like(ordinary)
    derived[:-1] = np.arange(1, degree + 1)[:, None] * ordinary[1:]
    return ordinary, derived


@functools.cache
def _places(d: int, degree: int) -> Ints:
    """Where the polynomials of each variable stand in a flattened (d, degree + 1), for each product of them, (d, coefficients)."""
    return _degrees(d, degree) + (degree + 1) * np.arange(d)[:, None]


def _warped(u: float, beta: float) -> tuple[float, float]:
    """`warp` and `stretch` of one parameter."""
    if beta > 0:
        whole = math.log1p(beta)
        return 2 * math.log1p(beta * u) / whole - 1, 2 * beta / ((1 + beta * u) * whole)
    if beta <= -1:
        b = -beta
        return 2 * (1 + b) * u / (1 + b * u) - 1, 2 * (1 + b) / (1 + b * u) ** 2
    if beta < 0:
        bent, plateau = 1 + (-u / beta) ** SHARP, (1 + (-beta) ** -SHARP) ** (-1 / SHARP)
        return 2 * u / bent ** (1 / SHARP) / plateau - 1, 2 * bent ** (-1 - 1 / SHARP) / plateau
    return 2 * u - 1, 2.0


@functools.lru_cache(maxsize=64)
def _degrees(d: int, degree: int) -> Ints:
    """The degrees by each variable, (d, coefficients)."""
    return np.array(powers(d, degree)).reshape(-1, d).T


def design_points(d: int, slopes: bool | int, seed: int, degree: int | None = None, betas: Array | None = None) -> Array:
    """Places of the first runs: those that determine a polynomial best (D-optimal).

    Parameters
    ----------
    d : int
        Number of searched parameters.
    slopes : bool or int
        Whether runs give sensitivities, or by how many of the parameters; fewer runs are then enough.
    seed : int
    degree : int or None
        Total degree of the polynomial; by default 3, or 4 where sensitivities of few parameters come with the runs.
    betas : array (d,) or None
        The stretch of each range; by default the usual one.

    Returns
    -------
    array (n, d), units of the ranges
    """
    degree = degree or (4 if slopes and d < 3 else 3)
    size = len(powers(d, degree))
    known = d if slopes is True else int(slopes)
    n = int(np.ceil(SPARE * size)) if not known else int(np.ceil(1.5 * size / (1 + known)))
    levels = (1 - np.cos(np.pi * np.arange(LEVELS) / (LEVELS - 1))) / 2
    grid = np.array(list(product(levels, repeat=d))) if d < 5 else np.zeros((0, d))
    places = np.concatenate([grid, qmc.Sobol(d, seed=seed).random(DRAWN)])
    plain = np.zeros(d)  # the polynomial's own variable; turned into units at the end
    own = values(places, plain, degree)
    derived = [OF_SLOPES * A / 2 for A in by_units(places, plain, degree)[:known]]
    chosen = _most_telling(np.stack([own, *derived], axis=1), n)
    return unwarp(2 * places[chosen] - 1, np.full(d, USUAL_BETA) if betas is None else betas)


def _most_telling(blocks: Array, n: int) -> list[int]:
    """The numbers of n blocks (rows, coefficients); each block in turn adds most to the determinant of the information."""
    chosen: list[int] = []
    M = 1e-6 * np.eye(blocks.shape[2])
    for _ in range(n):
        inverse = np.linalg.inv(M)
        gains = [np.linalg.slogdet(np.eye(block.shape[0]) + block @ inverse @ block.T)[1] for block in blocks]
        gains = [-np.inf if number in chosen else gain for number, gain in enumerate(gains)]
        chosen.append(int(np.argmax(gains)))
        M += blocks[chosen[-1]].T @ blocks[chosen[-1]]
    return chosen


def _products(vanders: NDArray[Any], d: int, degree: int) -> Array:
    degrees = _degrees(d, degree)
    products = np.ones((len(vanders), degrees.shape[1]))
    for k in range(d):
        products *= vanders[:, k, degrees[k]]
    return products
