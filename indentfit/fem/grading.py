"""Widths of elements along one direction: fine at the indenter's edge and at the top, coarse far away."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass, replace
from operator import attrgetter

import numpy as np

from indentfit.arrays import Array


@dataclass(frozen=True)
class Grading:
    """Element widths of one mesh.

    Parameters
    ----------
    size : float, mm
        Width far from the contact's edge.
    edge : float, mm
        Width at the contact's edge.
    slope : float, mm/mm
        Growth of the width with each mm from the edge.
    rim : float, mm
        Width where a strip leaves the sample.
    long : float
        Factor on the widths of elements along a strip.
    least : int
        Number of elements on each side of the edge, at least.
    parts : int
        Number of equal elements into which the one at the contact's edge is divided.
    base : Grading or None
        Grading of the base mesh, whose numbers of elements this mesh scales; None for the base mesh itself.
    """

    size: float
    edge: float
    slope: float
    rim: float
    long: float = 1.0
    least: int = 2
    parts: int = 1
    base: Grading | None = None

    def width(self, distance: Array) -> Array:
        """Wanted width of elements at distances (n,) from the contact's edge; all in mm."""
        return np.minimum(self.size, self.edge + self.slope * np.asarray(distance))

    def along(self, width_at_end: Callable[[Grading], float]) -> Grading:
        """The grading along a strip; `width_at_end` gives the width of elements at the strip's end, mm, for a Grading."""
        base = self.base and self.base.along(width_at_end)
        return replace(self, size=self.long * self.size, edge=width_at_end(self), slope=self.long * self.slope, base=base)


def graded(start: float, stop: float, grading: Grading, at: float, least: int = 1) -> Array:
    """Positions from start to stop, whose spacing follows the grading's width at the distance from `at`.

    The number of elements is that of the base mesh times the ratio of the two gradings, rounded. The first spacing at `at` follows
    the ratio before rounding, and the other spacings compensate. So the spacing at the singular edge, which decides the error, is
    the same function of the size on every mesh.

    Parameters
    ----------
    start, stop : float, mm
    grading : Grading
    at : float, mm
        Place of the edge: start or stop.
    least : int
        Number of elements at least.

    Returns
    -------
    array (n + 1,), mm
    """
    fine, count = _elements_up_to(start, stop, grading, at)
    wanted = count[-1] * _rounding(start, stop, grading, at, least)
    number = max(least, round(wanted))
    share = np.linspace(0, 1, number + 1)
    if number > 1 and (round(wanted) == number or (number == 2 and wanted > 1.1)):  # else more than wanted, spread evenly
        first = np.clip((number / wanted - 1 / number) / (1 - 1 / number), 0.5, 5 / 3)  # so that share[1] is 1 / wanted
        share = first * share + (1 - first) * share**2
    nodes = np.interp(count[-1] * (share if at == start else 1 - share[::-1]), count, fine)
    nodes[0], nodes[-1] = start, stop
    first = 0 if at == start else nodes.size - 2
    between = np.linspace(nodes[first], nodes[first + 1], grading.parts + 1)[1:-1]
    return np.insert(nodes, first + 1, between)


def continued(start: float, stop: float, grading: Grading, least: int = 1) -> Array:
    """Positions from start to stop, whose spacing follows the grading's width at the distance from 0, which lies before start, mm;
    the number of elements as `graded` takes it."""
    fine, count = _elements_up_to(start, stop, grading, 0.0)
    number = max(least, round(count[-1] * _rounding(start, stop, grading, 0.0, least)))
    nodes = np.interp(np.linspace(0, count[-1], number + 1), count, fine)
    nodes[0], nodes[-1] = start, stop
    return nodes


def _elements_up_to(start: float, stop: float, grading: Grading, at: float) -> tuple[Array, Array]:
    """Points between start and stop, and the number of elements of the wanted width from start to each, a fraction."""
    fine = np.linspace(start, stop, 4001)
    density = 1 / grading.width(np.abs(fine - at))
    return fine, np.concatenate([[0], np.cumsum((density[1:] + density[:-1]) / 2 * np.diff(fine))])


@functools.lru_cache(maxsize=256)
def _elements(start: float, stop: float, grading: Grading, at: float) -> float:
    """The number of elements of the wanted width between start and stop; a search of a size asks often for those of one base."""
    return float(_elements_up_to(start, stop, grading, at)[1][-1])


def _rounding(start: float, stop: float, grading: Grading, at: float, least: int) -> float:
    """The factor that makes the number of elements of the base mesh whole; 1 where `least` raises that number."""
    count = _elements(start, stop, grading.base or grading, at)
    number = np.ceil(count - 1e-9)
    return number / count if number >= least else 1.0


def across(half_width: float, end: float, grading: Grading) -> tuple[Array, Array]:
    """Positions from 0 to half_width and from there to end, mm, fine on both sides of half_width."""
    inner = graded(0, half_width, grading, at=half_width, least=grading.least)
    return inner, graded(half_width, end, grading, at=half_width, least=grading.least)


def along(half_length: float, end: float, grading: Grading) -> Array:
    """Positions along a strip from 0 to end, mm: fine at the sample's end where the strip overhangs it, else at the strip's end."""
    if half_length >= end * (1 - 1e-6):
        return graded(0, end, grading.along(attrgetter("rim")), at=end, least=2)
    inner, outer = across(half_length, end, grading.along(attrgetter("edge")))
    return np.concatenate([inner, outer[1:]])
