"""The inverse problem: the tests, the free parameters, and the one that the force is proportional to."""

from dataclasses import dataclass, replace

import numpy as np

from indentfit.case import Case, Range
from indentfit.curve import Curve
from indentfit.inverse.objective import Target, best_scale, equation_one, sum_of_squares


@dataclass(frozen=True)
class Candidate:
    """Parameters with their curves and how good they are: `objective` is equation (1), mN."""

    parameters: dict[str, float]
    forces: tuple[np.ndarray, ...]
    objective: float
    sum_of_squares: float


@dataclass(frozen=True)
class InverseProblem:
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


def inverse_problem(case: Case) -> InverseProblem:
    """The inverse problem of a case that `case.require_fittable` lets pass."""
    curves = [(test, curve) for test, curve in zip(case.tests, case.curves, strict=True) if curve is not None]
    tests = tuple(Target(test.name, curve, float(test.weight or 0.0)) for test, curve in curves)
    start = case.start_values() | {name: bounds.start for name, bounds in case.fit.uncertain.fitted.items()}
    return InverseProblem(tests, start, case.fitted, *scale_of(case), differences_of(case))


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
