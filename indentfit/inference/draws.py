"""Draws of the posterior on a fit's surrogate (by `annealed`), and the intervals that they make."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from indentfit.arrays import Array
from indentfit.inference.annealed import PARTICLES, annealed
from indentfit.inference.bridge import bridged
from indentfit.inference.density import Density
from indentfit.inference.joint import JointFit
from indentfit.inference.plain import Interval

SHARE = 0.95  # of the posterior that an interval holds
MET = 0.1  # standard error of the evidence by bridge sampling, above which that of the particles' levels is taken (about 0.25)
ENOUGH = 400.0  # effective number of draws below which they make no interval
CELLS = 600  # of a range of draws, in which their density is counted
SMOOTH = 0.8  # width of the kernel of this density, over that of Silverman's rule
DIP = 0.6  # of the density at the ends of two pieces: a shallower dip between them is the scatter of draws, and they are one piece


@dataclass(frozen=True, eq=False)
class Draws:
    """Draws under one alternative, with weights.

    Parameters
    ----------
    places : array (m, n + 2 tests), or with one more column
        See `Density`.
    shares : array (m,)
        Their weights, which add up to 1.
    effective : float
        Effective number of draws: fewer than all where the particles have moved little between them.
    log_evidence : float
        Logarithm of the density of the curves, up to a constant that alternatives share.
    """

    places: Array
    shares: Array
    effective: float
    log_evidence: float

    @property
    def enough(self) -> bool:
        """Whether there are enough to tell the ends of an interval."""
        return self.effective >= ENOUGH

    def interval(self, n: int) -> Interval:
        """The outermost ends of the smallest set of coordinate n that holds 95 %, in units of its range."""
        parts = pieces([self], [1.0], n)
        return parts[0][0], parts[-1][1]


def drawn(fit: JointFit, seed: int, particles: int = PARTICLES) -> Draws:
    """Draws of the posterior of a joint fit.

    Parameters
    ----------
    fit : JointFit
    seed : int
    particles : int
        Particles that make them.

    Returns
    -------
    Draws
        One draw, at the fit's mode, where the mechanics fails at nearly all places.
    """
    density = Density(fit)
    known = annealed(density, seed, particles)
    if known is None:
        return undrawn(fit)
    number = len(known.places)
    log_evidence, error = bridged(density, known.places, known.effective, np.random.default_rng(seed))
    return Draws(known.places, np.full(number, 1 / number), known.effective, log_evidence if error <= MET else known.log_evidence)


def undrawn(fit: JointFit) -> Draws:
    """One draw, at the mode of a joint fit: too few to make an interval."""
    return Draws(Density(fit).place(fit.mode.z)[None], np.ones(1), 1.0, -np.inf)


def pieces(alternatives: Sequence[Draws], probabilities: Sequence[float], n: int, share: float = SHARE) -> tuple[Interval, ...]:
    """The pieces of the smallest set of values of a coordinate that holds a share of the mixture of alternatives.

    Parameters
    ----------
    alternatives : sequence of Draws
    probabilities : sequence of float
    n : int
        The coordinate.
    share : float

    Returns
    -------
    tuple of (low, high), in units of the range, in rising order
    """
    kernels = [_kernel(known.places[:, n], known.shares, known.effective) for known in alternatives]
    counted = [k for k, share in enumerate(probabilities) if share > 1e-3]
    ends = [_span(alternatives[k].places[:, n], alternatives[k].shares, 5 * kernels[k]) for k in counted]
    grid = np.unique(np.concatenate([np.linspace(low, high, CELLS + 1) for low, high in ends]))
    width = np.diff(grid)
    mass = np.sum([probabilities[k] * _mass(alternatives[k], n, kernels[k], grid) for k in counted], axis=0)
    density = mass / np.maximum(width, 1e-300)
    cells = _smallest(density, mass, share)
    return tuple((float(grid[first]), float(grid[last])) for first, last in cells)


def _smallest(density: Array, mass: Array, share: float) -> list[tuple[int, int]]:
    """First and last edges of the runs of cells, joined over shallow dips, that hold a share of the mass at the highest level of
    the density: joined at the level at which the cells alone hold it, they would hold more, where a long tail is flat."""
    levels = np.sort(density)[::-1]
    wanted, first, last = share * float(mass.sum()), 0, density.size - 1
    while first < last:
        middle = (first + last) // 2
        if sum(mass[a:b].sum() for a, b in _joined(density, levels[middle])) >= wanted:
            last = middle
        else:
            first = middle + 1
    return _joined(density, levels[last])


def _joined(density: Array, level: float) -> list[tuple[int, int]]:
    """Runs of cells (first, last + 1) of at least a density, joined where the dip between them is shallow."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], (density >= level).astype(int), [0]]))).reshape(-1, 2).tolist()
    joined = [edges[0]]
    for first, last in edges[1:]:
        if density[joined[-1][1] : first].min() > DIP * level:
            joined[-1][1] = last
        else:
            joined.append([first, last])
    return [(first, last) for first, last in joined]


def _kernel(values: Array, shares: Array, effective: float) -> float:
    """Width of the kernel of a density of weighted values."""
    order = np.argsort(values)
    low, high = np.interp([0.25, 0.75], np.cumsum(shares[order]), values[order])
    mean = shares @ values
    spread = float(np.sqrt(shares @ (values - mean) ** 2))
    narrow = min(spread, float(high - low) / 1.34) or spread
    return max(SMOOTH * 0.9 * narrow * effective**-0.2, 1e-9)


def _span(values: Array, shares: Array, margin: float) -> Interval:
    """Where weighted values lie, but for one in 100,000 at either end, with a margin, within the range."""
    order = np.argsort(values)
    low, high = np.interp([1e-5, 1 - 1e-5], np.cumsum(shares[order]), values[order])
    return max(float(low) - margin, 0.0), min(float(high) + margin, 1.0)


def _mass(known: Draws, n: int, kernel: float, grid: Array) -> Array:
    """What each cell of a grid holds of the smooth density of weighted draws, whose kernels are mirrored at 0 and 1."""
    values = known.places[:, n]
    fine = np.linspace(*_span(values, known.shares, 5 * kernel), CELLS + 1)
    counts = np.histogram(values, fine, weights=known.shares)[0]
    centres = (fine[1:] + fine[:-1]) / 2
    held = np.flatnonzero(counts)
    centres, counts = centres[held], counts[held]
    low, high = centres < 6 * kernel, centres > 1 - 6 * kernel
    centres = np.concatenate([centres, -centres[low], 2 - centres[high]])
    counts = np.concatenate([counts, counts[low], counts[high]])
    return np.diff(ndtr((grid[:, None] - centres) / kernel) @ counts)
