"""Chebyshev polynomials of a total degree in warped parameters, and the places that determine such a polynomial best.

Each range is stretched at its lower end, u -> t = 2 log(1 + beta u) / log(1 + beta) - 1, since stiffness enters curves by ratios.
"""

from itertools import product
from typing import Any

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray
from scipy.stats import qmc

from indentfit.arrays import Array

USUAL_BETA = 10.0  # beta of the first runs
SPARE = 1.15  # least number of rows of a fit for each coefficient
OF_SLOPES = 0.3  # weight of a derivative by t relative to a value
LEVELS = 5  # levels of each parameter in the grid from which the first runs are chosen
DRAWN = 128  # further places, drawn at random, from which the first runs are chosen


def warp(u: Array, betas: Array) -> Array:
    """Places in units of the ranges, (..., d), as the polynomials' variables, -1..1."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return 2 * np.where(betas > 0, np.log1p(betas * u) / np.log1p(betas), u) - 1


def unwarp(t: Array, betas: Array) -> Array:
    """The inverse of `warp`."""
    half = (t + 1) / 2
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(betas > 0, np.expm1(half * np.log1p(betas)) / betas, half)


def stretch(places: Array, betas: Array) -> Array:
    """dt/du, (m, d), at places in units of the ranges."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(betas > 0, 2 * betas / ((1 + betas * places) * np.log1p(betas)), 2.0)


def powers(d: int, degree: int) -> list[tuple[int, ...]]:
    """The degrees by each of d variables of every polynomial up to a total degree."""
    return [degrees for degrees in product(range(degree + 1), repeat=d) if sum(degrees) <= degree]


def values(places: Array, betas: Array, degree: int) -> Array:
    """The polynomials at places (m, d) in units of the ranges, (m, coefficients)."""
    vanders = chebyshev.chebvander(warp(places, betas), degree)  # (m, d, degree + 1)
    return _products(vanders, len(betas), degree)


def by_t(places: Array, betas: Array, degree: int) -> list[Array]:
    """Derivatives of the polynomials by each t, a list of (m, coefficients)."""
    vanders = chebyshev.chebvander(warp(places, betas), degree)
    D = np.zeros((degree + 1, degree + 1))
    D[:, :-1] = chebyshev.chebder(np.eye(degree + 1)).T if degree else 0
    derivatives = []
    for k in range(len(betas)):
        derived = vanders.copy()
        derived[:, k] = vanders[:, k] @ D.T
        derivatives.append(_products(derived, len(betas), degree))
    return derivatives


def by_units(places: Array, betas: Array, degree: int) -> list[Array]:
    """Derivatives of the polynomials by each parameter in units of its range, a list of (m, coefficients)."""
    ahead = stretch(places, betas)
    return [ahead[:, [k]] * A for k, A in enumerate(by_t(places, betas, degree))]


def design_points(d: int, slopes: bool, seed: int, degree: int | None = None) -> Array:
    """Places of the first runs: those that determine a polynomial best (D-optimal).

    Parameters
    ----------
    d : int
        Number of searched parameters.
    slopes : bool
        Whether runs give sensitivities; fewer runs are then enough.
    seed : int
    degree : int or None
        Total degree of the polynomial; by default 3, or 4 where sensitivities of few parameters come with the runs.

    Returns
    -------
    array (n, d), units of the ranges
    """
    degree = degree or (4 if slopes and d < 3 else 3)
    size = len(powers(d, degree))
    n = int(np.ceil(SPARE * size)) if not slopes else int(np.ceil(1.5 * size / (1 + d)))
    levels = (1 - np.cos(np.pi * np.arange(LEVELS) / (LEVELS - 1))) / 2
    grid = np.array(list(product(levels, repeat=d))) if d < 5 else np.zeros((0, d))
    places = np.concatenate([grid, qmc.Sobol(d, seed=seed).random(DRAWN)])
    plain = np.zeros(d)  # the polynomial's own variable; turned into units at the end
    own = values(places, plain, degree)
    derived = [OF_SLOPES * A / 2 for A in by_units(places, plain, degree)] if slopes else []
    chosen = _most_telling(np.stack([own, *derived], axis=1), n)
    return unwarp(2 * places[chosen] - 1, np.full(d, USUAL_BETA))


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
    degrees = np.array(powers(d, degree))
    products = np.ones((len(vanders), len(degrees)))
    for k in range(d):
        products *= vanders[:, k, degrees[:, k]]
    return products
