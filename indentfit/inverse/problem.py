"""The inverse problem: the tests, the free parameters, and the scale, a parameter to which the force is proportional."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from indentfit.arrays import Array
from indentfit.case import Case, Range, Test
from indentfit.case.in_time import motion_of, segments_of
from indentfit.curve import Curve
from indentfit.inverse.objective import Target, best_scales, objectives
from indentfit.inverse.polynomials import USUAL_BETA
from indentfit.runs.relaxing import Kernel, kernel_of

Values = Mapping[str, Any]  # name -> value of a parameter, or of a key of the case


@dataclass(frozen=True)
class Candidate:
    """Parameters with their curves and their objectives.

    Parameters
    ----------
    parameters : dict of name -> value
    forces : tuple of arrays (n,), mN, one for each test
    objective : float, mN
        Equation (1).
    sum_of_squares : float, mN^2
    """

    parameters: dict[str, float]
    forces: tuple[Array, ...]
    objective: float
    sum_of_squares: float


@dataclass(frozen=True)
class InverseProblem:
    """The search for the free parameters with which simulated curves are nearest to the measured curves of the tests.

    Free parameters are counted in units of their range, 0 at min and 1 at max, in the order of the model; times of relaxation in
    units of their logarithm's range. The forward model is only ever run at one reference value of the scale; forces at other values
    follow exactly. Parameters of the relaxation come last, and need no run.

    Parameters
    ----------
    tests : tuple of Target
    start : dict of name -> value
        All parameters; free parameters have their start values.
    free : dict of name -> Range
    scale : str or None
        The free parameter to which the force is proportional.
    reference : float
        The value of the scale at which the forward model is run.
    differences : tuple of str
        Free parameters by which the mechanics cannot be differentiated.
    warps : dict of name -> float
        The beta (see `polynomials`) of searched inputs whose effect on the force is known to have a certain form.
    kernel : Kernel or None
        The map from elastic forces to those at the measured times, where the material relaxes.
    """

    tests: tuple[Target, ...]
    start: dict[str, float]
    free: dict[str, Range]
    scale: str | None
    reference: float = 1.0
    differences: tuple[str, ...] = ()
    warps: Mapping[str, float] = field(default_factory=dict)
    kernel: Kernel | None = None

    @property
    def searched(self) -> list[str]:
        """The free parameters without the scale."""
        return [name for name in self.free if name != self.scale]

    @property
    def searched_numbers(self) -> list[int]:
        """The numbers of the searched parameters among the free parameters."""
        return [number for number, name in enumerate(self.free) if name != self.scale]

    @property
    def solved(self) -> list[str]:
        """The searched parameters with which the runs change: all but those of the relaxation. They are the first of them."""
        relaxing = self.kernel.free if self.kernel is not None else ()
        return [name for name in self.searched if name not in relaxing]

    @property
    def elastic(self) -> "InverseProblem":
        """The problem of the runs: without the parameters of the relaxation."""
        if self.kernel is None:
            return self
        names = self.kernel.names
        start = {name: value for name, value in self.start.items() if name not in names}
        free = {name: bounds for name, bounds in self.free.items() if name not in names}
        return replace(self, start=start, free=free, kernel=None)

    @property
    def segmented(self) -> bool:
        """Whether tests are parted into segments in time."""
        return any(test.segment_of for test in self.tests)

    @property
    def weights(self) -> list[float]:
        """The weight of the square of one force residual of each test in the sum of squares."""
        return [test.of_square / test.curve.force.size for test in self.tests]

    @property
    def betas(self) -> Array:
        """The usual stretch of the range of each searched parameter (see `polynomials.warp`), (n_searched,)."""
        return np.array([self.warps.get(name, USUAL_BETA) for name in self.searched])

    def number(self, name: str) -> int:
        """The number of a free parameter."""
        return list(self.free).index(name)

    def range(self, name: str) -> float:
        """The width of a free parameter's range, in its unit."""
        return self.free[name].max - self.free[name].min

    @property
    def ranges(self) -> Array:
        """The widths of the ranges of all free parameters, (n_free,), in their units."""
        return np.array([self.range(name) for name in self.free])

    def unit(self, name: str, value: float) -> float:
        """The value of a free parameter in units of its range."""
        bounds = self.free[name]
        if self._by_logarithm(name):
            return float(np.log(value / bounds.min) / np.log(bounds.max / bounds.min))
        return (value - bounds.min) / (bounds.max - bounds.min)

    def value(self, name: str, unit: float) -> float:
        """The inverse of `unit`."""
        bounds = self.free[name]
        if self._by_logarithm(name):
            return float(bounds.min * (bounds.max / bounds.min) ** unit)
        return bounds.min + unit * (bounds.max - bounds.min)

    def values_at(self, name: str, units: Array) -> Array:
        """`value` of units (...)."""
        bounds = self.free[name]
        if self._by_logarithm(name):
            return np.asarray(bounds.min * (bounds.max / bounds.min) ** units)
        return np.asarray(bounds.min + units * (bounds.max - bounds.min))

    def per_unit(self, name: str, parameters: Values) -> float:
        """The derivative of a free parameter by its unit: the width of its range, but for logarithms."""
        if self._by_logarithm(name):
            return float(parameters[name] * np.log(self.free[name].max / self.free[name].min))
        return self.range(name)

    def per_units(self, parameters: Values) -> Array:
        """The derivatives of all free parameters by their units, (n_free,)."""
        return np.array([self.per_unit(name, parameters) for name in self.free])

    def _by_logarithm(self, name: str) -> bool:
        return self.kernel is not None and name.startswith("tau") and name in self.kernel.names

    def values(self, parameters: Values) -> Array:
        """The values of the free parameters, (n_free,), in their units."""
        return np.array([parameters[name] for name in self.free])

    def units(self, parameters: Values) -> Array:
        """The free parameters in units of their ranges, (n_free,)."""
        return np.array([self.unit(name, parameters[name]) for name in self.free])

    def place(self, parameters: Values) -> Array:
        """The searched parameters in units of their ranges, (n_searched,)."""
        return np.array([self.unit(name, parameters[name]) for name in self.searched])

    def parameters(self, units: Sequence[float] | Array) -> dict[str, float]:
        """All parameters by name, from the free parameters in units of their ranges, (n_free,)."""
        values = dict(self.start)
        for unit, (name, bounds) in zip(units, self.free.items(), strict=True):
            value = float(f"{self.value(name, unit):.12g}")  # so that a point that is converted to units and back stays the same
            values[name] = min(max(value, bounds.min), bounds.max)
        return values

    def factor(self, parameters: Values) -> float:
        """The factor from forces at the reference to forces of `parameters`."""
        return parameters[self.scale] / self.reference if self.scale else 1.0

    def factor_bounds(self) -> tuple[float, float]:
        """The least and the largest factor within the bounds of the scale."""
        if self.scale is None:
            return 1.0, 1.0
        return self.free[self.scale].min / self.reference, self.free[self.scale].max / self.reference

    def at_reference(self, parameters: Values) -> dict[str, Any]:
        """The parameters with which the forward model is run: the scale at its reference."""
        return {**parameters, self.scale: self.reference} if self.scale else dict(parameters)

    def scaled(self, parameters: Values, forces: Sequence[Array]) -> tuple[Array, ...]:
        """The curves of `parameters`, from the curves of `at_reference(parameters)`."""
        factor = self.factor(parameters)
        return tuple(factor * force for force in forces)

    def weighted(self, weights: Sequence[float]) -> "InverseProblem":
        """The same problem with other weights of its tests; weight 0 leaves a test out."""
        tests = tuple(replace(test, weight=weight) for test, weight in zip(self.tests, weights, strict=True))
        return replace(self, tests=tests)

    def measured(self, forces: Sequence[Array]) -> "InverseProblem":
        """The same problem with other measured forces, mN, at the same displacements."""
        pairs = zip(self.tests, forces, strict=True)
        return replace(self, tests=tuple(replace(test, curve=test.curve.with_force(force)) for test, force in pairs))

    def judge(self, parameters: Values, forces: Sequence[Array]) -> Candidate:
        """The Candidate of `parameters`, given the curves of their `at_reference`."""
        return self._judged([parameters], [np.asarray(force)[None] for force in forces])[0]

    def judge_best_scale(self, parameters: Values, forces: Sequence[Array]) -> Candidate:
        """The Candidate with the best scale for the other parameters, given the curves of their `at_reference`."""
        return self.judge_best_scales([parameters], [forces])[0]

    def judge_best_scales(self, points: Sequence[Values], forces: Sequence[Sequence[Array]]) -> list[Candidate]:
        """`judge_best_scale` of many points, given the curves of each."""
        if not points:
            return []
        curves = [np.array(of_test) for of_test in zip(*forces, strict=True)]
        if self.scale:
            bounds = self.free[self.scale]
            factors = best_scales(self.tests, curves, *self.factor_bounds())
            values = np.clip(factors * self.reference, bounds.min, bounds.max)
            points = [{**point, self.scale: float(value)} for point, value in zip(points, values, strict=True)]
        return self._judged(points, curves)

    def _judged(self, points: Sequence[Values], curves: Sequence[Array]) -> list[Candidate]:
        """The Candidates of m points, given the curves (m, n) of each test at their `at_reference`."""
        factors = np.array([self.factor(point) for point in points])[:, None]
        scaled = [factors * curve for curve in curves]
        rows = zip(points, zip(*scaled, strict=True), *objectives(self.tests, scaled), strict=True)
        return [Candidate(dict(point), forces, float(objective), float(squares)) for point, forces, objective, squares in rows]


def inverse_problem(case: Case) -> InverseProblem:
    """The inverse problem of a case that `case.require_fittable` accepts."""
    curves = [(test, curve) for test, curve in zip(case.tests, case.curves, strict=True) if curve is not None]
    relaxes, scales = case.relaxation is not None, _scales(curves)
    pairs = zip(curves, scales, strict=True)
    tests = tuple(
        target for (test, curve), scale in pairs for target in (_segments(test, curve) if relaxes else [_whole(test, curve, scale)])
    )
    start = case.start_values() | {name: bounds.start for name, bounds in case.fit.uncertain.fitted.items()}
    kernel = kernel_of(case)
    if kernel is not None:
        start |= kernel.relaxation.numbers
    return InverseProblem(tests, start, case.fitted, *scale_of(case), differences_of(case), kernel=kernel)


def _whole(test: Test, curve: Curve, scale: float = 1.0) -> Target:
    return Target(test.name, curve, float(test.weight or 0.0), scale=scale)


def _segments(test: Test, curve: Curve) -> list[Target]:
    """The segments of a test in time, which share its weight; the whole test where it has one segment only."""
    known = motion_of(test, curve)
    assert known is not None  # faults of the case see to that
    parts = segments_of(*known)
    if len(parts) == 1:
        return [_whole(test, curve)]
    weight = float(test.weight or 0.0) / len(parts)
    return [Target(f"{test.name} ({name})", curve.part(numbers), weight, test.name) for name, numbers in parts.items()]


def _scales(curves: Sequence[tuple[Test, Curve]]) -> list[float]:
    """Factors that make the forces of tests of different kinds as large as those of the first test; 1 among indentations."""
    if all(test.kind == "indentation" for test, _ in curves):
        return [1.0] * len(curves)
    sizes = [float(np.sqrt(np.mean(curve.force**2))) for _, curve in curves]
    return [sizes[0] / size for size in sizes]


def scale_of(case: Case) -> tuple[str | None, float]:
    """The free parameter to which the force is proportional, or None, and its value at which the forward model is run.

    This parameter is the scale of the material's law, if kappa is given as a ratio: pressures, contact stiffness and tolerances are
    then all relative to the shear modulus.
    """
    if any(test.field for test in case.tests):
        return None, 1.0  # displacements do not grow with the scale
    name = case.law.scale
    relative = case.material.kappa is None
    if name is None or not relative or name not in case.free or case.free[name].max <= 0:
        return None, 1.0
    bounds = case.free[name]
    return name, bounds.start if bounds.start > 0 else bounds.max


def differences_of(case: Case) -> tuple[str, ...]:
    """The fitted parameters by which the mechanics cannot be differentiated.

    The mechanics assumes that kappa follows the shear modulus. Where it does not, these are all fitted parameters; otherwise only
    the thickness.
    """
    runs = {**case.free, **case.fit.uncertain.fitted}
    return tuple(runs) if case.material.kappa is not None else tuple({"thickness"} & set(case.fit.uncertain.fitted))
