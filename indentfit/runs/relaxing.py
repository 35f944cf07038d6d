"""The forward model of a material that relaxes: elastic runs on a grid of depths, mapped to the measured times.

The parameters of the relaxation need no run: a point with other values of these has the same elastic runs. Forces are linear in the
elastic ones, so sensitivities are mapped in the same way.
"""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from indentfit.arrays import Array
from indentfit.case import Case, Test
from indentfit.case.in_time import GRID, motion_of, ramps_of, segments_of
from indentfit.case.relaxation import ORDERS, Relaxation
from indentfit.curve import Curve
from indentfit.fem.interpolation import POWERS, Interpolant
from indentfit.fem.time_map import TimeMap
from indentfit.hereditary import Ramp, RelaxationFunction
from indentfit.indenters import IndenterShape
from indentfit.motion import Motion
from indentfit.runs.forward import Evaluation, ForwardModel, Report
from indentfit.runs.run import Point

STEP = 1e-2  # of the logarithm of a time, for differences
STEP_OF_ORDER = 2e-3  # of the order of a fractional function, for differences
STEP_OF_SHARE = 1e-4


@dataclass(frozen=True, eq=False)
class Kernel:
    """The map from elastic forces of all tests to forces at the measured times, for any parameters of the relaxation.

    Parameters
    ----------
    relaxation : Relaxation
        The table of the case.
    maps : tuple of TimeMap, one for each curve: a test, or a segment of a test
    ramps : tuple of Ramp, one for each curve
    owners : tuple of int
        The number of the test of each curve.
    depths : tuple of arrays (n_grid,), mm
        The grid of depths of each test.
    """

    relaxation: Relaxation
    maps: tuple[TimeMap, ...]
    ramps: tuple[Ramp, ...]
    owners: tuple[int, ...]
    depths: tuple[Array, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """The parameters of the relaxation, fixed or free."""
        return tuple(self.relaxation.parameters)

    @property
    def free(self) -> tuple[str, ...]:
        """The free parameters of the relaxation."""
        return tuple(self.relaxation.free)

    @property
    def sizes(self) -> list[int]:
        """Numbers of elastic forces of each test."""
        return [depth.size for depth in self.depths]

    def forces(self, elastic: Sequence[Array], values: Mapping[str, Any]) -> tuple[Array, ...]:
        """Forces of each curve.

        Parameters
        ----------
        elastic : sequence of arrays (..., n_grid), mN, one for each test
        values : mapping of name -> value
            It names the parameters of the relaxation, among others.

        Returns
        -------
        tuple of arrays (..., n), mN
        """
        triples = zip(self.maps, self.ramps, self.owners, strict=True)
        return tuple(
            known.forces(elastic[n], self.relaxation.function(ramp.seconds, ramp.end, values)) for known, ramp, n in triples
        )

    def slopes(self, elastic: Sequence[Array], values: Mapping[str, Any], names: Iterable[str]) -> tuple[dict[str, Array], ...]:
        """Derivatives of the forces of each curve by parameters of the relaxation.

        Parameters
        ----------
        elastic : sequence of arrays (n_grid,), mN
        values : mapping of name -> value
        names : parameters of the relaxation

        Returns
        -------
        tuple of dict, name -> array (n,), mN per unit
        """
        names, own = list(names), {name: float(values[name]) for name in self.names}
        triples = zip(self.maps, self.ramps, self.owners, strict=True)
        return tuple(_slopes(known, _Functions(self.relaxation, ramp), elastic[n], own, names) for known, ramp, n in triples)


def kernel_of(case: Case) -> Kernel | None:
    """The Kernel of the measured curves of a case; None where its material does not relax."""
    relaxation = case.relaxation
    if relaxation is None:
        return None
    maps: list[TimeMap] = []
    ramps, owners, depths = list[Ramp](), list[int](), list[Array]()
    for n, (test, curve) in enumerate(zip(case.tests, case.curves, strict=True)):
        assert curve is not None  # a fit has a curve for each test
        known = motion_of(test, curve)
        assert known is not None  # faults of the case see to that
        motion, times = known
        shape = case.indenter_of(test).geometry
        grid = _Grid(curve.deepest, POWERS[shape.end])
        depths.append(_grid(curve.deepest))
        for part in segments_of(motion, times).values():
            maps.append(TimeMap.of(motion, times[part], grid, shape.edge_radius is None))
            ramps.append(motion.ramp)
            owners.append(n)
    return Kernel(relaxation, tuple(maps), tuple(ramps), tuple(owners), tuple(depths))


def kernel_for(relaxation: Relaxation, shape: IndenterShape, deepest: float, motion: Motion, times: Array) -> Kernel:
    """The Kernel of one motion under an indenter, at times (n,), s, from elastic forces on the grid up to a depth, mm."""
    known = TimeMap.of(motion, times, _Grid(deepest, POWERS[shape.end]), shape.edge_radius is None)
    return Kernel(relaxation, (known,), (motion.ramp,), (0,), (_grid(deepest),))


def ramp_kernel(case: Case) -> Kernel | None:
    """The Kernel of the outputs of a case, which its indenter reaches in a ramp at constant rate; None where its material does not
    relax."""
    relaxation, ramps, maps, ideal = case.relaxation, ramps_of(case), [], []
    if relaxation is None:
        return None
    for test in case.tests:
        depths, known = case.outputs(test), ramps[test.name]
        rate, shape = known.depth / known.seconds, case.indenter_of(test).geometry
        ramp = Ramp(float(depths[-1]), float(depths[-1]) / rate)
        grid = _Grid(ramp.depth, POWERS[shape.end])
        maps.append(TimeMap.of(Motion.ramped(ramp), depths / rate, grid, shape.edge_radius is None))
        ideal.append(ramp)
    grids = tuple(_grid(ramp.depth) for ramp in ideal)
    return Kernel(relaxation, tuple(maps), tuple(ideal), tuple(range(len(maps))), grids)


def elastic_case(case: Case) -> Case:
    """The case whose runs are those of a fit or of a sweep: where the material relaxes, elastic runs on a grid of depths."""
    if case.material.relaxation is None:
        return case
    tests = tuple(_elastic_test(test, curve) for test, curve in zip(case.tests, case.curves, strict=True))
    material = case.material.model_copy(update={"relaxation": None})
    return case.model_copy(update={"material": material, "tests": tests, "curves": (None,) * len(tests)})


def _elastic_test(test: Test, curve: Curve | None) -> Test:
    changes: dict[str, Any] = {"rate": None, "ramp": None, "hold": None, "points": GRID}
    if curve is not None:
        changes |= {"curve": None, "record": None, "depth": curve.deepest}
    return test.model_copy(update=changes)


class Relaxing:
    """A ForwardModel whose points have the parameters of the relaxation too: forces are those at the measured times.

    Parameters
    ----------
    model : ForwardModel
        Elastic forces on the grids of depths.
    kernel : Kernel
    """

    def __init__(self, model: ForwardModel, kernel: Kernel) -> None:
        self.model, self.kernel = model, kernel

    @property
    def runs(self) -> int:
        """Runs of the mechanics."""
        return self.model.runs

    @property
    def failures(self) -> Sequence[Evaluation]:
        """Evaluations that failed."""
        return self.model.failures

    def differentiable(self) -> frozenset[str]:
        """Names whose sensitivities the model can give."""
        return self.model.differentiable() | set(self.kernel.names)

    def evaluate(
        self, points: Sequence[Point], report: Report | None = None, sensitivities: Collection[str] = ()
    ) -> list[Evaluation]:
        """Evaluations of points; each has its elastic evaluation."""
        names = self.kernel.names
        elastic = [{name: value for name, value in point.items() if name not in names} for point in points]
        own = [name for name in sensitivities if name not in names]
        evaluations = self.model.evaluate(elastic, report, own)
        ahead = [name for name in sensitivities if name in names]
        return [relaxed(self.kernel, point, known, ahead) for point, known in zip(points, evaluations, strict=True)]


def relaxed(kernel: Kernel, point: Point, elastic: Evaluation, names: Sequence[str]) -> Evaluation:
    """The evaluation of a point from its elastic evaluation.

    Parameters
    ----------
    kernel : Kernel
    point : dict of name -> value
    elastic : Evaluation
    names : sequence of str
        Parameters of the relaxation by which forces are differentiated.

    Returns
    -------
    Evaluation
    """
    if elastic.forces is None:
        return Evaluation(dict(point), None, elastic.cause, elastic.seconds, elastic.facts, lost=elastic.lost, elastic=elastic)
    forces, by_test = kernel.forces(elastic.forces, point), None
    if elastic.sensitivities is not None or names:
        given = elastic.sensitivities or tuple({} for _ in elastic.forces)
        own = kernel.slopes(elastic.forces, point, names) if names else tuple({} for _ in forces)
        by_test = tuple(known | slopes for known, slopes in zip(_mapped(kernel, given, point), own, strict=True))
    return Evaluation(dict(point), forces, None, elastic.seconds, elastic.facts, by_test, elastic=elastic)


def _mapped(kernel: Kernel, given: Sequence[Mapping[str, Array]], point: Point) -> list[dict[str, Array]]:
    """Sensitivities at the measured times from elastic ones."""
    rows = [np.array(list(known.values())).reshape(-1, size) for known, size in zip(given, kernel.sizes, strict=True)]
    pairs = zip(kernel.owners, kernel.forces(rows, point), strict=True)
    return [dict(zip(given[n], mapped, strict=True)) for n, mapped in pairs]


def _grid(deepest: float) -> Array:
    """Depths (GRID,) at which elastic runs have forces, mm, as `Case.outputs` has them."""
    return deepest * np.arange(1, GRID + 1) / GRID


class _Grid:
    """Weights (m, GRID) of the elastic forces on the grid up to a depth, for the force at depths (m,)."""

    def __init__(self, deepest: float, power: float) -> None:
        depths = np.append(0.0, _grid(deepest))
        self._between = Interpolant(depths, list(np.eye(GRID + 1)[:, 1:]), power)

    def __call__(self, depths: Array) -> Array:
        return self._between(np.maximum(depths, 0.0))


@dataclass(frozen=True)
class _Functions:
    """The relaxation functions of one test by the parameters of the relaxation."""

    relaxation: Relaxation
    ramp: Ramp

    def at(self, values: Mapping[str, float]) -> RelaxationFunction:
        return self.relaxation.function(self.ramp.seconds, self.ramp.end, values)


def _slopes(
    known: TimeMap, functions: _Functions, elastic: Array, values: Mapping[str, float], names: Sequence[str]
) -> dict[str, Array]:
    """Derivatives of one test: in closed form for exponentials and a contact that does not shrink, else by differences."""
    relaxation = functions.relaxation
    if known.retracts or relaxation.order is not None:
        return {name: _difference(known, functions, elastic, values, name) for name in names}
    parts, changes = known.by_term(elastic, functions.at(values))
    lost = known.elastic(elastic) if relaxation.base == "instantaneous" else 0.0
    slopes = {}
    for name in names:
        n = int(name.lstrip("gtau")) - 1
        slopes[name] = parts[n] - lost if name.startswith("g") else values[f"g{n + 1}"] * changes[n]
    return slopes


def _difference(known: TimeMap, functions: _Functions, elastic: Array, values: Mapping[str, float], name: str) -> Array:
    value = values[name]
    step = STEP * value if name.startswith("tau") else STEP_OF_ORDER if name == "order" else STEP_OF_SHARE
    low, high = value - step, value + step
    if name == "order":
        low, high = max(low, ORDERS[0]), min(high, ORDERS[1])
    below, above = (known.forces(elastic, functions.at({**values, name: x})) for x in (low, high))
    return (above - below) / (high - low)
