"""The force curves of one law all over its ranges, as comparisons of laws and predictions need them: no run is made.

A place z holds all coordinates in units of their ranges, 0 to 1: the free parameters, then uncertain inputs where the fit has made
them coordinates. Parameters are uniform over their ranges; inputs have the priors that the case states.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from indentfit.arrays import Array
from indentfit.inference.fit import FitWithRuns
from indentfit.inference.posterior import Curves
from indentfit.inference.residual_noise import Moves, smoothed
from indentfit.inverse.problem import InverseProblem
from indentfit.inverse.surrogate import Surrogate, learn, linearised
from indentfit.inverse.wide import OF_CURVES, prior_of

TRUSTED = 0.1  # largest error of a surrogate of runs that were made for no surrogate, over the misfit
MANY_PLACES = 512  # of a scan of curves with inputs, which are computed one after another


class LawCurves(Protocol):
    """Curves of one law under one alternative of the case."""

    @property
    def names(self) -> tuple[str, ...]:
        """The free parameters, in the order of the first coordinates."""

    @property
    def size(self) -> int:
        """The number of coordinates."""

    @property
    def scanned(self) -> int:
        """The number of places that a scan may take."""

    def forces(self, places: Array) -> Array:
        """The forces of all tests in a row, (m, N) mN, at places (m, size)."""

    def log_prior(self, places: Array) -> Array:
        """Logarithm of the prior density at places, (m,); -inf where the mechanics failed."""

    def scaled(self, places: Array, target: Array, weights: Array) -> Array:
        """The places, each with the scale (if the law has one) at which its forces are nearest to the target, (N,) mN."""

    def values(self, places: Array) -> Array:
        """The free parameters at places, (m, p), in their units."""

    def start(self) -> Array:
        """The place of the fit's own optimum."""

    @property
    def moves(self) -> Moves:
        """Changes of each test's curve by one standard deviation of uncertain inputs that are no coordinates."""


@dataclass(frozen=True, eq=False)
class PlainCurves:
    """Curves of a law whose free parameters are the only coordinates.

    Parameters
    ----------
    problem : InverseProblem
    surrogate : Surrogate or None
        None for a law whose only free parameter is the scale.
    shape : array (N,), mN
        The curve at the reference of the scale, where there is no surrogate.
    optimum : array (p,), units of the ranges
    moves : for each test the changes of its curve by one standard deviation of uncertain inputs
    """

    problem: InverseProblem
    surrogate: Surrogate | None
    shape: Array
    optimum: Array
    moves: Moves = ()

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self.problem.free)

    @property
    def size(self) -> int:
        return len(self.problem.free)

    @property
    def scanned(self) -> int:
        return 2048

    def forces(self, places: Array) -> Array:
        return self._factors(places)[:, None] * self._at_reference(places)

    def log_prior(self, places: Array) -> Array:
        inside = np.all((places >= 0) & (places <= 1), axis=1)
        if self.surrogate is not None:
            inside &= ~self.surrogate.near_failure(places[:, self.problem.searched_numbers])
        return np.where(inside, 0.0, -np.inf)

    def scaled(self, places: Array, target: Array, weights: Array) -> Array:
        problem = self.problem
        if problem.scale is None:
            return places
        curves, changed = self._at_reference(places), places.copy()
        factor = (curves * weights) @ target / np.maximum((curves**2) @ weights, 1e-300)
        bounds = problem.free[problem.scale]
        unit = (factor * problem.reference - bounds.min) / problem.range(problem.scale)
        changed[:, problem.number(problem.scale)] = np.clip(unit, 0, 1)
        return changed

    def values(self, places: Array) -> Array:
        low = np.array([bounds.min for bounds in self.problem.free.values()])
        return np.asarray(low + places * self.problem.ranges)

    def start(self) -> Array:
        return self.optimum

    def _at_reference(self, places: Array) -> Array:
        if self.surrogate is None:
            return np.tile(self.shape, (len(places), 1))
        return self.surrogate.curves(places[:, self.problem.searched_numbers])

    def _factors(self, places: Array) -> Array:
        problem = self.problem
        if problem.scale is None:
            return np.ones(len(places))
        unit = places[:, problem.number(problem.scale)]
        value = problem.free[problem.scale].min + unit * problem.range(problem.scale)
        return np.asarray(value / problem.reference)


@dataclass(frozen=True, eq=False)
class WideCurves:
    """Curves of a law whose coordinates are its free parameters and uncertain inputs."""

    curves: Curves
    optimum: Array
    moves: Moves = ()  # inputs are coordinates

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self.curves.free)

    @property
    def size(self) -> int:
        return self.curves.size

    @property
    def scanned(self) -> int:
        return MANY_PLACES

    def forces(self, places: Array) -> Array:
        return np.array([self.curves.at(z)[0] for z in places])

    def log_prior(self, places: Array) -> Array:
        inside = np.all((places >= 0) & (places <= 1), axis=1)
        density = np.where(inside, 0.0, -np.inf)
        for n, known in enumerate(self.curves.inputs, start=len(self.curves.free)):
            if known.prior.spread is not None:  # normal over units; cut off at the ends, where little is left
                low, high = known.ends
                width = known.prior.spread / (high - low)
                centre = (known.prior.center - low) / (high - low)
                density = density - 0.5 * ((places[:, n] - centre) / width) ** 2 - np.log(width * np.sqrt(2 * np.pi))
        return np.asarray(density)

    def scaled(self, places: Array, target: Array, weights: Array) -> Array:
        problem = self.curves.problem
        if problem.scale is None:
            return places
        bounds, changed = problem.free[problem.scale], places.copy()
        n, width = self.names.index(problem.scale), bounds.max - bounds.min
        here = bounds.min + places[:, n] * width
        curves = self.forces(places) / np.maximum(here, 1e-300)[:, None]
        value = (curves * weights) @ target / np.maximum((curves**2) @ weights, 1e-300)
        changed[:, n] = np.clip((value - bounds.min) / width, 0, 1)
        return changed

    def values(self, places: Array) -> Array:
        problem, p = self.curves.problem, len(self.names)
        low = np.array([problem.free[name].min for name in self.names])
        return np.asarray(low + places[:, :p] * np.array([problem.range(name) for name in self.names]))

    def start(self) -> Array:
        return self.optimum


def alternatives_of(fitted: FitWithRuns) -> list[tuple[float, LawCurves]]:
    """The curves of a fitted law under each alternative of the case, with the probability that the case gives the alternative.

    Parameters
    ----------
    fitted : FitWithRuns

    Returns
    -------
    list of (float, LawCurves)
        Empty where the search has found no optimum.
    """
    if fitted.wide is not None:
        known = fitted.wide.alternatives
        return [(each.prior, WideCurves(each.fit.posterior.curves, each.fit.mode.z)) for each in known]
    plain = _plain(fitted)
    return [] if plain is None else [(1.0, plain)]


def _plain(fitted: FitWithRuns) -> PlainCurves | None:
    problem, best = fitted.problem, fitted.solved.optimum.best
    if best is None:
        return None
    shape = np.concatenate(best.forces) / problem.factor(best.parameters)
    units = np.clip(problem.units(best.parameters), 0, 1)
    if not problem.searched:
        return PlainCurves(problem, None, shape, units, _moves(fitted))
    surrogate = fitted.solved.exploration.surrogate and learn(problem, fitted.runs)
    if surrogate is None and fitted.solved.optimum.derivatives is not None:
        surrogate = _learned(fitted) or linearised(problem, best, fitted.solved.optimum.derivatives)
    return None if surrogate is None else PlainCurves(problem, surrogate, shape, units, _moves(fitted))


def _moves(fitted: FitWithRuns) -> Moves:
    """The changes of each test's curve by the contact point and the gain of the load cell, where the case says how uncertain these
    are: a law without searched parameters has no other place for them."""
    case = fitted.result.case
    assert case is not None  # `fit` has set it
    offset, gain = (prior_of(case, name, 0.0) for name in OF_CURVES)
    rows = []
    for test in fitted.problem.tests:
        force = smoothed(test.curve.displacement, test.curve.force)
        slope = np.gradient(force, test.curve.displacement) if force.size > 1 else force
        rows.append([known.sd * row for known, row in ((offset, slope), (gain, force)) if known is not None and known.sd])
    return rows


def _learned(fitted: FitWithRuns) -> Surrogate | None:
    """The surrogate of a search that made none by itself, where its runs are enough to trust it."""
    surrogate = learn(fitted.problem, fitted.runs)
    return surrogate if surrogate is not None and surrogate.error <= TRUSTED else None
