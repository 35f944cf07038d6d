"""How far simulated curves are from measured ones, and the parameter that the force is proportional to.

Equation (1) of the source paper (J Mech Behav Biomed Mater 65:490) is the weighted SUM of the tests' root mean
square errors; least squares minimises the weighted sum of their squares. Both are reported, each under its name.
"""

from dataclasses import dataclass, replace
from math import hypot

import numpy as np
from scipy.optimize import brentq

from indentfit.case import Case, Range
from indentfit.curve import Curve


@dataclass(frozen=True)
class Target:
    """What one test measured, and its weight in the objective."""

    name: str
    curve: Curve
    weight: float


def misfit(test, force):
    """Force residuals of one test, mN, shape (n,), scaled so that their squares sum to w RMSE^2."""
    return np.sqrt(test.weight / test.curve.force.size) * (force - test.curve.force)


def rmse(test, force):
    """Root mean square error of one test, mN."""
    return float(np.sqrt(np.mean((force - test.curve.force) ** 2)))


def equation_one(tests, forces):
    """The weighted sum of the tests' RMSEs, mN: equation (1) of the source paper."""
    return sum(test.weight * rmse(test, force) for test, force in zip(tests, forces, strict=True))


def sum_of_squares(tests, forces):
    """The weighted sum of the tests' squared RMSEs, mN^2."""
    return sum(test.weight * rmse(test, force) ** 2 for test, force in zip(tests, forces, strict=True))


def best_scale(tests, forces, low=0.0, high=np.inf):
    """The factor s in low..high that makes s * forces best under equation (1).

    Equation (1) is convex in s and its least lies between the best factors of the single tests, where its slope
    changes sign; it may also lie at one of them, if the curve of that test is met exactly.
    """
    parts = [_part(test, force) for test, force in zip(tests, forces, strict=True) if test.weight]
    alone = [best for _, _, best, _ in parts]

    def value(s):
        return sum(weight * hypot(size * (s - best), left) for weight, size, best, left in parts)

    def slope(s):
        return sum(weight * size**2 * (s - best) / (hypot(size * (s - best), left) or 1.0) for weight, size, best, left in parts)

    candidates, ends = list(alone), (min(alone), max(alone))
    if slope(ends[0]) < 0 < slope(ends[1]):
        candidates.append(brentq(slope, *ends, xtol=1e-300, rtol=1e-14))
    return float(np.clip(min(candidates, key=value), low, high))


def _part(test, force):
    """A test's weight, the norm of its curve, its best factor alone, and what that leaves: |s f - target|^2 is
    (|f| (s - best))^2 + left^2."""
    target, size = test.curve.force, float(np.linalg.norm(force))
    best = float(force @ target) / size**2 if size else 0.0
    return test.weight / np.sqrt(len(force)), size, best, float(np.linalg.norm(best * force - target))


@dataclass(frozen=True)
class Candidate:
    """Parameters with their curves and how good they are: `objective` is equation (1), mN."""

    parameters: dict[str, float]
    forces: tuple[np.ndarray, ...]
    objective: float
    sum_of_squares: float


@dataclass(frozen=True)
class Problem:
    """What is searched: the tests, the free parameters, and the one among them that the force is proportional to.

    Free parameters are counted in units of their range, 0 at min and 1 at max, in the order of the model. The forward
    model is only ever run at one `reference` value of the scale; forces at other values follow exactly.
    """

    tests: tuple[Target, ...]
    start: dict[str, float]
    free: dict[str, Range]
    scale: str | None
    reference: float = 1.0
    differences: tuple[str, ...] = ()  # parameters that the model has no sensitivities of

    @property
    def searched(self):
        """The free parameters that are left to search for, without the scale."""
        return [name for name in self.free if name != self.scale]

    def range(self, name):
        """The width of a free parameter's range, in its unit."""
        return self.free[name].max - self.free[name].min

    def units(self, parameters):
        """The free parameters in units of their ranges, shape (n,)."""
        return np.array([(parameters[name] - r.min) / (r.max - r.min) for name, r in self.free.items()])

    def parameters(self, units):
        """All parameters by name, at free ones given in units of their ranges, shape (n,)."""
        values = dict(self.start)
        for unit, (name, bounds) in zip(units, self.free.items(), strict=True):
            value = bounds.min + unit * (bounds.max - bounds.min)
            value = float(f"{value:.12g}")  # so that a point turned into units and back is the same
            values[name] = min(max(value, bounds.min), bounds.max)
        return values

    def at_reference(self, parameters):
        """The parameters that the forward model is to be run with."""
        return {**parameters, self.scale: self.reference} if self.scale else dict(parameters)

    def scaled(self, parameters, forces):
        """The curves of `parameters` from those of their `at_reference`."""
        factor = parameters[self.scale] / self.reference if self.scale else 1.0
        return tuple(factor * force for force in forces)

    def weighted(self, weights):
        """The same problem with other weights of its tests; weight 0 leaves a test out."""
        tests = tuple(replace(test, weight=w) for test, w in zip(self.tests, weights, strict=True))
        return replace(self, tests=tests)

    def measured(self, forces):
        """The same problem with other measured forces, mN, at the same displacements."""
        pairs = zip(self.tests, forces, strict=True)
        return replace(self, tests=tuple(replace(t, curve=Curve(t.curve.displacement, f)) for t, f in pairs))

    def judge(self, parameters, forces):
        """The Candidate of `parameters`, given the curves of their `at_reference`."""
        forces = self.scaled(parameters, forces)
        return Candidate(dict(parameters), forces, equation_one(self.tests, forces), sum_of_squares(self.tests, forces))

    def judge_best_scale(self, parameters, forces):
        """The Candidate with the best scale for the other parameters, given the curves of their `at_reference`."""
        if self.scale:
            bounds = self.free[self.scale]
            factor = best_scale(self.tests, forces, bounds.min / self.reference, bounds.max / self.reference)
            value = float(np.clip(factor * self.reference, bounds.min, bounds.max))
            parameters = {**parameters, self.scale: value}
        return self.judge(parameters, forces)


def problem_of(case: Case) -> Problem:
    """The inverse problem of a case that `case.require_fittable` lets pass."""
    curves = [(test, curve) for test, curve in zip(case.tests, case.curves, strict=True) if curve is not None]
    tests = tuple(Target(test.name, curve, float(test.weight or 0.0)) for test, curve in curves)
    start = case.start_values() | {name: bounds.start for name, bounds in case.fit.uncertain.fitted.items()}
    return Problem(tests, start, case.fitted, *scale_of(case), differences_of(case))


def scale_of(case):
    """The free parameter that the force is proportional to: the material's scale, where kappa goes with it, or None; and the
    value of it that the forward model is run at.

    Pressures, contact stiffness and tolerances are all relative to the shear modulus; a kappa in kPa is not.
    """
    name = case.law.scale
    relative = case.material.kappa is None
    if not relative or name not in case.free or case.free[name].max <= 0:
        return None, 1.0
    bounds = case.free[name]
    return name, bounds.start if bounds.start > 0 else bounds.max


def differences_of(case):
    """The fitted parameters by which the model cannot be differentiated: all, where kappa does not go with the shear modulus,
    as the model takes it to; otherwise the thickness."""
    return tuple(case.fitted) if case.material.kappa is not None else tuple({"thickness"} & set(case.fit.uncertain.fitted))
