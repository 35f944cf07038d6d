"""Curves of many points, averaged for a fit: an instrument may write thousands, and what a fit costs grows with their square.

Neighbours are averaged in equal numbers, so that all means have the same noise. A smooth curve whose points lie about evenly loses
nothing by that: its bend within a group of a hundredth of the depth changes a mean by 5e-5 of the largest force under a sphere, and
by 4e-4 of a force that grows as exp(10 d / depth). Noise of single points becomes that of means; noise that neighbours share stays.
Curves whose points are crowded (a slow beginning), curves in time, which jump, and tests with measured displacements are fitted as
they are.
"""

from dataclasses import dataclass

import numpy as np

from indentfit.arrays import Array, Ints
from indentfit.case import Case
from indentfit.curve import Curve

MOST = 100  # means of a curve, at most
DENSE = 150  # points from which a curve is averaged
SPAN = 0.02  # of all displacements: the most that a group may span
SAID = (
    "{test}: its {points:,} points are fitted as {means} means of {each} neighbours; noise, residuals and misfit are those of means"
)


@dataclass(frozen=True)
class Averaged:
    """A case with curves that are not dense, and what is said of each that was."""

    case: Case
    said: tuple[str, ...] = ()


def averaged(case: Case) -> Averaged:
    """The case with means of neighbours in the place of dense curves; the case itself where none is.

    Parameters
    ----------
    case : Case

    Returns
    -------
    Averaged
    """
    curves, said = list(case.curves), []
    for n, (test, curve) in enumerate(zip(case.tests, case.curves, strict=True)):
        if curve is None or case.relaxation is not None or test.field or curve.loading is not curve:
            continue
        each = -(-curve.force.size // MOST)
        if curve.force.size > DENSE and _widest(curve, each) <= SPAN:
            curves[n] = means = means_of(curve, each)
            said.append(SAID.format(test=test.name, points=curve.force.size, means=means.force.size, each=each))
    return Averaged(case.model_copy(update={"curves": tuple(curves)}), tuple(said)) if said else Averaged(case)


def means_of(curve: Curve, each: int) -> Curve:
    """The curve of means of neighbours, weighted as the points are; a standard deviation becomes that of a mean.

    Parameters
    ----------
    curve : Curve
    each : int
        Points of a group; the last ones hold one less where the number of points asks for it.

    Returns
    -------
    Curve
    """
    groups = _groups(curve, each)
    weights = np.ones(curve.force.size) if curve.sd is None else curve.sd**-2

    def mean(values: Array) -> Array:
        return np.array([np.average(values[group], weights=weights[group]) for group in groups])

    sd = None if curve.sd is None else np.array([weights[group].sum() ** -0.5 for group in groups])
    time = None if curve.time is None else mean(curve.time)
    return Curve(mean(curve.displacement), mean(curve.force), curve.notes, curve.contact, sd, time, curve.axes)


def _groups(curve: Curve, each: int) -> list[Ints]:
    """Numbers of the neighbours that are averaged."""
    return np.array_split(np.arange(curve.force.size), -(-curve.force.size // each))


def _widest(curve: Curve, each: int) -> float:
    """The largest part of all displacements that a group spans."""
    return float(max(np.ptp(curve.displacement[group]) for group in _groups(curve, each)) / np.ptp(curve.displacement))
