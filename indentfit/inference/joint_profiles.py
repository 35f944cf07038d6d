"""Profiles of a joint fit: one coordinate is moved while all others, parameters and uncertain inputs, are fitted again."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from indentfit.arrays import Array
from indentfit.inference.joint import JointFit
from indentfit.inference.plain import Interval
from indentfit.inference.posterior import Climber
from indentfit.inference.profiles import BEYOND, LEAST, SHOWN, end_of_profile

OTHERS = 2  # other maxima from which each value of a profile is tried


@dataclass(frozen=True, eq=False)
class JointPath:
    """The profile of one coordinate.

    Parameters
    ----------
    units : array (m,)
        Values in units of the range.
    chi2 : array (m,)
        Growth of chi2.
    limit : float
        Largest chi2 within the interval.
    interval : (low, high), units of the range
    places : array (m, n)
        All coordinates along the profile.
    """

    units: Array
    chi2: Array
    limit: float
    interval: Interval
    places: Array

    def ends(self) -> Array:
        """The places at both ends of the interval, (2, n)."""
        return np.array([self.places[int(np.argmin(np.abs(self.units - end)))] for end in self.interval])


class JointWalk:
    """A walk along the profile of one coordinate; visited places are remembered, and other maxima are tried on the way. The
    coordinates `held` keep their values at the optimum; `limit` is the largest chi2 within the interval, by default the fit's."""

    def __init__(self, fit: JointFit, n: int, held: Collection[int] = (), limit: float | None = None) -> None:
        self.climber, self.n, self.fixed = Climber(fit.posterior), n, (n, *held)
        self.least, self.limit = fit.mode.chi2, float(fit.quantiles[n] ** 2) if limit is None else limit
        self.walked: dict[float, tuple[float, Array]] = {float(fit.mode.z[n]): (fit.mode.chi2, fit.mode.z)}
        near = [mode.z for mode in fit.others if mode.chi2 < fit.mode.chi2 + 25]
        self.others = [] if held else near[:OTHERS]
        self.value = float(fit.mode.z[n])

    def profile(self, shown: int = SHOWN) -> JointPath:
        """The JointPath of the coordinate, with a number of values to be shown beside those that its ends take."""
        ends = self.ends()
        reach = BEYOND * max(ends[1] - ends[0], LEAST)
        for unit in np.linspace(max(ends[0] - reach, 0.0), min(ends[1] + reach, 1.0), shown):
            self.chi2(float(unit))
        units = np.array([u for u in sorted(self.walked) if ends[0] - 1.01 * reach <= u <= ends[1] + 1.01 * reach])
        chi2 = np.array([max(self.chi2(float(unit)), 0.0) for unit in units])
        places = np.array([self.walked[float(unit)][1] for unit in units])
        return JointPath(units, chi2, self.limit, (ends[0], ends[1]), places)

    def ends(self) -> Interval:
        """The interval, in units of the range."""
        for other in self.others:
            self.chi2(float(other[self.n]))
        low, high = (end_of_profile(self.chi2, self.value, bound, self.limit) for bound in (0.0, 1.0))
        return low, high

    def chi2(self, unit: float) -> float:
        """Growth of chi2 at a value of the coordinate, from the nearest visited place and the other maxima."""
        if unit not in self.walked:
            nearest = self.walked[min(self.walked, key=lambda known: abs(known - unit))][1]
            ends = [self._climbed(start, unit) for start in (nearest, *self.others)]
            z, chi2 = min(ends, key=_chi2)
            self.walked[unit] = (chi2, z)
        return self.walked[unit][0] - self.least

    def _climbed(self, start: Array, unit: float) -> tuple[Array, float]:
        z = start.copy()
        z[self.n] = unit
        return self.climber.climb(z, self.fixed)


def joint_profiles(fit: JointFit, numbers: Sequence[int] | None = None, shown: int = SHOWN) -> dict[int, JointPath]:
    """The profiles of coordinates, by their numbers; by default of the free parameters. `shown` is as of `JointWalk.profile`."""
    wanted = range(len(fit.posterior.curves.free)) if numbers is None else numbers
    return {n: JointWalk(fit, n).profile(shown) for n in wanted}


def _chi2(end: tuple[Array, float]) -> float:
    return end[1]
