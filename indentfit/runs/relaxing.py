"""The forward model of a material that relaxes: elastic runs on a grid of depths, mapped to the measured times.

The parameters of the relaxation need no run: a point with other values of these has the same elastic runs. Forces are linear in the
elastic ones, so sensitivities are mapped in the same way.
"""

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
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

Of = Callable[[Array], Array]  # times (n,), s -> numbers (n,)
BULK = "bulk_ratio"
MOST_OF_BULK = 0.9  # share of the force
ALIKE, LEAST_OF_BULK = 0.1, 1e-3  # differences of these shares that do not matter: relative, and absolute
MATTERS = 1000.0  # bulk ratio below which the share of the bulk modulus is counted
STEP = 1e-2  # of the logarithm of a time, for differences
STEP_OF_ORDER = 2e-3  # of the order of a fractional function, for differences
STEP_OF_SHARE = 1e-4


@dataclass(frozen=True)
class BulkShares:
    """The shares of the elastic forces that come from the bulk modulus, which does not relax.

    Parameters
    ----------
    ratio : float
        The bulk ratio at which they are known.
    shares : tuple of float
        d ln F / d ln kappa of each test, at its deepest point.
    """

    ratio: float
    shares: tuple[float, ...]

    @classmethod
    def of(cls, elastic: Evaluation, ratio: float) -> "BulkShares | None":
        """Those of an elastic evaluation with its sensitivities by the bulk ratio; None where these are not known."""
        known = elastic.sensitivities or ()
        if elastic.forces is None or not known or not all(BULK in by_name for by_name in known):
            return None
        pairs = zip(known, elastic.forces, strict=True)
        shares = [ratio * float(by_name[BULK][-1]) / max(float(force[-1]), 1e-300) for by_name, force in pairs]
        return cls(ratio, tuple(min(max(share, 0.0), MOST_OF_BULK) for share in shares))

    def at(self, test: int, ratio: float | None) -> float:
        """The share of a test at another bulk ratio, as of springs in series."""
        share = self.shares[test]
        return share / (share + (1 - share) * (1.0 if ratio is None else ratio / self.ratio))


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
    bulk : BulkShares or None
        Of each test, where the sample is so compressible that they matter.
    factors : tuple of arrays (n,), one for each curve
        By which the forces of the viscoelastic model differ from the hereditary integral; none where they are not known.
    counts : tuple of arrays (n,), one for each curve
        The shares in which differences of these factors count (`TimeCurve.counts`); none where all count alike.
    """

    relaxation: Relaxation
    maps: tuple[TimeMap, ...]
    ramps: tuple[Ramp, ...]
    owners: tuple[int, ...]
    depths: tuple[Array, ...]
    bulk: BulkShares | None = None
    factors: tuple[Array, ...] = ()
    counts: tuple[Array, ...] = ()

    @property
    def times(self) -> tuple[Array, ...]:
        """The times of each curve (n,), s, since contact."""
        return tuple(known.time[known.at] for known in self.maps)

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
        forces = [known.forces(elastic[n], self._function(ramp, n, values)) for known, ramp, n in triples]
        return tuple(factor * force for factor, force in zip(self._factors, forces, strict=True))

    def differs(self, other: "Kernel") -> bool:
        """Whether the shares of the bulk modulus are others by so much that a fit follows."""
        if self.bulk is None or other.bulk is None:
            return self.bulk is not other.bulk
        pairs = zip(self.bulk.shares, other.bulk.shares, strict=True)
        return any(abs(own - known) > ALIKE * known + LEAST_OF_BULK for own, known in pairs)

    def share(self, test: int, values: Mapping[str, Any]) -> float:
        """The share of a test's elastic force that does not relax, at values of which one may be the bulk ratio."""
        return 0.0 if self.bulk is None else self.bulk.at(test, values.get(BULK))

    def _function(self, ramp: Ramp, test: int, values: Mapping[str, Any]) -> RelaxationFunction:
        return self.relaxation.function(ramp.seconds, ramp.end, values, self.share(test, values))

    def slopes(self, elastic: Sequence[Array], values: Mapping[str, Any], names: Iterable[str]) -> tuple[dict[str, Array], ...]:
        """Derivatives of the forces of each curve by parameters of the relaxation, and by the bulk ratio as far as it changes what
        relaxes.

        Parameters
        ----------
        elastic : sequence of arrays (n_grid,), mN
        values : mapping of name -> value
        names : parameters of the relaxation, or "bulk_ratio"

        Returns
        -------
        tuple of dict, name -> array (n,), mN per unit
        """
        names, own = list(names), {name: float(values[name]) for name in (*self.names, BULK) if name in values}
        triples = zip(self.maps, self.ramps, self.owners, strict=True)
        slopes = [_slopes(known, _Functions(self, ramp, n), elastic[n], own, names) for known, ramp, n in triples]
        pairs = zip(self._factors, slopes, strict=True)
        return tuple({name: factor * slope for name, slope in by_name.items()} for factor, by_name in pairs)

    @property
    def _factors(self) -> Sequence[Array | float]:
        return self.factors or [1.0] * len(self.maps)

    def to_model(self, ratios: Sequence[Of | None], counts: Sequence[Of | None] = ()) -> "Kernel":
        """This kernel with the ratios of the viscoelastic model's forces to the hereditary integrals of each test, functions of the
        time, s; None where a ratio is not known. Their differences count in shares of each test, functions of the time too."""
        factors, shares = self._at_times(ratios), self._at_times(counts or [None] * len(ratios))
        return replace(self, factors=factors, counts=shares)

    def _at_times(self, functions: Sequence[Of | None]) -> tuple[Array, ...]:
        pairs = zip(self.times, self.owners, strict=True)
        return tuple(np.ones(time.size) if (of := functions[n]) is None else of(time) for time, n in pairs)

    def off(self, other: "Kernel") -> dict[int, float]:
        """The number of each test -> the largest relative difference of its factors from those of another kernel, as it counts."""
        sizes: dict[int, float] = {}
        shares = self.counts or other.counts or [1.0] * len(self.maps)
        for n, own, known, share in zip(self.owners, self._factors, other._factors, shares, strict=True):
            sizes[n] = max(sizes.get(n, 0.0), float(np.max(share * np.abs(own / known - 1))))
        return sizes


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


def with_bulk(kernel: Kernel, case: Case, point: Point, model: ForwardModel) -> Kernel:
    """A kernel with the shares of the bulk modulus in the elastic forces at a point, where these matter: one run at most.

    Parameters
    ----------
    kernel : Kernel
    case : Case
    point : dict of name -> value
        It may name the parameters of the relaxation.
    model : ForwardModel
        Elastic forces.
    """
    ratio = point.get(BULK, case.material.bulk_over_shear)
    if ratio is None or (ratio >= MATTERS and BULK not in point) or BULK not in model.differentiable():
        return kernel
    elastic = {name: value for name, value in point.items() if name not in kernel.names}
    return replace(kernel, bulk=BulkShares.of(model.evaluate([elastic], sensitivities=[BULK])[0], float(ratio)))


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
        mapped = _mapped(kernel, given, point)
        if kernel.bulk is not None and BULK in point and all(BULK in known for known in mapped):
            of_kernel = kernel.slopes(elastic.forces, point, [BULK])
            mapped = [known | {BULK: known[BULK] + own[BULK]} for known, own in zip(mapped, of_kernel, strict=True)]
        by_test = tuple(known | slopes for known, slopes in zip(mapped, own, strict=True))
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

    kernel: Kernel
    ramp: Ramp
    test: int

    def at(self, values: Mapping[str, float]) -> RelaxationFunction:
        return self.kernel._function(self.ramp, self.test, values)


def _slopes(
    known: TimeMap, functions: _Functions, elastic: Array, values: Mapping[str, float], names: Sequence[str]
) -> dict[str, Array]:
    """Derivatives of one test: in closed form for exponentials and a contact that does not shrink, else by differences."""
    relaxation = functions.kernel.relaxation
    if known.retracts or relaxation.order is not None or functions.kernel.bulk is not None:
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
    step = STEP * value if name.startswith("tau") or name == BULK else STEP_OF_ORDER if name == "order" else STEP_OF_SHARE
    low, high = value - step, value + step
    if name == "order":
        low, high = max(low, ORDERS[0]), min(high, ORDERS[1])
    below, above = (known.forces(elastic, functions.at({**values, name: x})) for x in (low, high))
    return (above - below) / (high - low)
