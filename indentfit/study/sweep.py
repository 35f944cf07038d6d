"""Sweeps: the change of a case's force curves with its keys, varied one at a time about the case, or on a grid.

Changes are of the force at the last displacement and of the stiffness, which is, as in the source paper (J Mech Behav
Biomed Mater 65:490), the slope of the straight line fitted to the curve.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from indentfit.arrays import Array
from indentfit.case import Case
from indentfit.case.uses import require_case
from indentfit.curve import Curve
from indentfit.runs.forward import Evaluation
from indentfit.study.refit import Refit, refits
from indentfit.study.runs import Execution, evaluate_cases
from indentfit.study.variations import SweepPlan, Variation, Vary, own_value, plan_sweep

FLAT = 1e-3  # of the force: a smaller change is within the errors of the solver and its contact


@dataclass(frozen=True)
class TestPoint:
    """The result of one test at one point of a sweep.

    Parameters
    ----------
    force : float, mN
        Force at the last displacement.
    stiffness : float, mN/mm
    force_change, stiffness_change : float or None
        Changes against the case itself, as shares; None for the case itself.
    rmse : float or None, mN
        Misfit to the measured curve; None where the test has no measured curve.
    curve : Curve
    equivalent : float or None
        The last force over that of an elastic material of the given moduli: the factor on these that makes an elastic material as
        stiff at this rate. None where the material does not relax.
    """

    __test__: ClassVar[bool] = False  # not a test of pytest's

    force: float
    stiffness: float
    force_change: float | None
    stiffness_change: float | None
    rmse: float | None
    curve: Curve = field(repr=False)
    equivalent: float | None = None

    def as_json(self) -> dict[str, Any]:
        return {
            "force_mN": self.force,
            "stiffness_mN_per_mm": self.stiffness,
            "force_change": self.force_change,
            "stiffness_change": self.stiffness_change,
            "rmse_mN": self.rmse,
            **({} if self.equivalent is None else {"equivalent_modulus": self.equivalent}),
            "displacement_mm": self.curve.displacement.tolist(),
            "forces_mN": self.curve.force.tolist(),
        }

    @classmethod
    def from_json(cls, value: Mapping[str, Any]) -> "TestPoint":
        curve = Curve(value["displacement_mm"], value["forces_mN"])
        changes = value["force_change"], value["stiffness_change"]
        return cls(
            value["force_mN"], value["stiffness_mN_per_mm"], *changes, value["rmse_mN"], curve, value.get("equivalent_modulus")
        )


@dataclass(frozen=True)
class SweepPoint:
    """The case with some keys at other values: the results of its tests, or the cause of their failure.

    Parameters
    ----------
    values : dict of key -> value as written
    numbers : dict of key -> value in the units of the case, None where the value is a word
    tests : dict of test -> TestPoint, or None
    cause : str or None
    seconds : float
    """

    values: dict[str, str]
    numbers: dict[str, float | None]
    tests: dict[str, TestPoint] | None
    cause: str | None
    seconds: float

    @property
    def label(self) -> str:
        """The point in words."""
        return ", ".join(f"{key} = {value}" for key, value in self.values.items()) or "the case"

    def as_json(self) -> dict[str, Any]:
        tests = None if self.tests is None else {name: test.as_json() for name, test in self.tests.items()}
        return {"values": self.values, "numbers": self.numbers, "tests": tests, "cause": self.cause, "seconds": self.seconds}

    @classmethod
    def from_json(cls, value: Mapping[str, Any]) -> "SweepPoint":
        tests = value["tests"] and {name: TestPoint.from_json(test) for name, test in value["tests"].items()}
        return cls(dict(value["values"]), dict(value["numbers"]), tests, value["cause"], value["seconds"])


@dataclass(frozen=True)
class Sensitivity:
    """The effect of one key on one test.

    Parameters
    ----------
    force_span, stiffness_span : float
        Spread over the values of the key, as shares of the case's own force and stiffness.
    elasticity : float or None
        d ln(force) / d ln(value), where the values are positive numbers.
    trend : str
        Trend of the force with the value: "rises", "falls", "flat", "turns", or "unordered" for words.
    """

    key: str
    test: str
    force_span: float
    stiffness_span: float
    elasticity: float | None
    trend: str


@dataclass(frozen=True, repr=False, eq=False)
class Sweep:
    """A sweep: the case itself (`base`), the points around it or on the grid, and the sensitivities to the keys.

    Parameters
    ----------
    variations : tuple of Variation
    sensitivities : tuple of Sensitivity
        In the order of the largest spread of the force that a key makes in any test; empty on a grid.
    tests : dict of test -> angle, degrees
    parameters : dict of name -> value
        Parameters of the material, in their units.
    own : dict of key -> the case's own value
    refits : tuple of Refit
        The parameters fitted anew at each point, if requested.
    units : dict of parameter of the material -> unit, "1" for none
    case : Case or None
        None for a sweep that was read from result.json.
    """

    FORMAT: ClassVar[str] = "indentfit.sweep/2"

    title: str
    case_hash: str
    grid: bool
    variations: tuple[Variation, ...]
    base: SweepPoint
    points: tuple[SweepPoint, ...]
    sensitivities: tuple[Sensitivity, ...]
    tests: dict[str, float]
    parameters: dict[str, float]
    own: dict[str, float | str | None]
    refits: tuple[Refit, ...] = ()
    units: dict[str, str] = field(default_factory=dict)
    case: Case | None = None

    def unit(self, parameter: str) -> str:
        """The unit of a parameter of the material, "1" for none."""
        return self.units.get(parameter, "1")

    @property
    def every_point(self) -> tuple[SweepPoint, ...]:
        """The case itself, then the points."""
        return self.base, *self.points

    def as_json(self) -> dict[str, Any]:
        """The stable keys of a sweep's result.json, under the tag `format`."""
        return {
            "format": self.FORMAT,
            "title": self.title,
            "case_hash": self.case_hash,
            "grid": self.grid,
            "tests": self.tests,
            "parameters": self.parameters,
            "variations": {varied.key: list(varied.values) for varied in self.variations},
            "own": self.own,
            "base": self.base.as_json(),
            "points": [point.as_json() for point in self.points],
            "refits": [asdict(refit) for refit in self.refits],
            "sensitivities": [asdict(sensitivity) for sensitivity in self.sensitivities],
        }

    @classmethod
    def from_json(cls, value: Mapping[str, Any]) -> "Sweep":
        """The sweep that result.json holds, in the form of this version or of 0.1."""
        same = {key: value[key] for key in ("title", "case_hash", "grid", "tests", "parameters", "own")}
        return cls(
            **same,
            variations=tuple(Variation(key, tuple(values)) for key, values in value["variations"].items()),
            base=SweepPoint.from_json(value["base"]),
            points=tuple(map(SweepPoint.from_json, value["points"])),
            sensitivities=tuple(Sensitivity(**sensitivity) for sensitivity in value["sensitivities"]),
            refits=tuple(map(Refit.from_json, value.get("refits", ()))),
            units=dict((value.get("case") or {}).get("units", {})),  # the table `case` of the same file holds them
        )

    def summary(self) -> str:
        """The sweep in words, as the command prints it."""
        from indentfit.report.study_text import sweep_lines

        return "\n".join(sweep_lines(self))

    def plot(self, path: str | Path | None = None) -> Any:
        """The matplotlib Figure of the keys' effects, or of the grid; saved as SVG and PNG where a path is given."""
        from indentfit.report.sweep import overview

        return overview(self, path)

    def write(self, folder: str | Path, overwrite: bool = False) -> None:
        """Write the result folder. Raises OutputError where the folder exists already, or cannot be written."""
        from indentfit.report.study_folder import write_study

        write_study(self, folder, overwrite)

    def __repr__(self) -> str:
        failed = sum(point.tests is None for point in self.every_point)
        keys = ", ".join(varied.key for varied in self.variations)
        return f"Sweep({self.title!r}: {len(self.points)} points over {keys}{f'; {failed} failed' if failed else ''})"

    def _repr_html_(self) -> str:
        from indentfit.report.study_text import html_table, sweep_rows

        return html_table(repr(self), sweep_rows(self))


def sweep(case: Case, vary: Vary, grid: bool = False, refit: bool = False, execution: Execution | None = None) -> Sweep:
    """Force curves of a case with some of its keys at other values.

    Parameters
    ----------
    case : Case
        The case; a free parameter has its start value.
    vary : mapping of keys to values, or texts
        `{"indenter.friction": [0.2, 0.5]}`, or texts KEY=VALUES as `indentfit sweep --vary` takes them.
    grid : bool
        Whether every combination of values is computed, instead of one key at a time.
    refit : bool
        Whether the free parameters are also fitted anew at each point, to the indentations.
    execution : Execution
        Workers, ledger and progress of the runs; by default this machine's cores, without a ledger.

    Returns
    -------
    Sweep
        The sweep, which records failed points with their cause.

    Raises
    ------
    CaseError
        The case does not have a key, or cannot have a value.
    """
    require_case(case)
    return run_sweep(plan_sweep(case, vary, grid), refit, execution or Execution())


def run_sweep(plan: SweepPlan, refit: bool, execution: Execution) -> Sweep:
    """The Sweep of a SweepPlan; the other arguments are those of `sweep`."""
    evaluations = evaluate_cases(plan.cases, execution)
    (_, case), *others = plan.points
    base = _point({}, case, evaluations[0], None)
    points = tuple(
        _point(values, changed, evaluation, base) for (values, changed), evaluation in zip(others, evaluations[1:], strict=True)
    )
    ranked = () if plan.grid else _ranked([s for varied in plan.variations for s in _sensitivities(case, varied, base, points)])
    return Sweep(
        title=case.title,
        case_hash=case.hash,
        grid=plan.grid,
        variations=plan.variations,
        base=base,
        points=points,
        sensitivities=ranked,
        tests={test.name: test.direction for test in case.tests},
        parameters=case.start_values(),
        own={varied.key: own_value(case, varied.key) for varied in plan.variations},
        refits=_refits(plan, execution) if refit else (),
        units={name: parameter.unit for name, parameter in case.law.parameters.items()},
        case=case,
    )


def stiffness(curve: Curve) -> float:
    """Slope of the straight line fitted to a curve, mN/mm."""
    return float(np.polyfit(curve.displacement, curve.force, 1)[0]) if curve.force.size > 1 else float("nan")


def _refits(plan: SweepPlan, execution: Execution) -> tuple[Refit, ...]:
    """The fits of the case itself and of each point; a varied parameter is held."""
    labels = [", ".join(f"{key} = {value}" for key, value in values.items()) or "the case" for values, _ in plan.points]
    return refits(list(zip(labels, plan.cases, strict=True)), execution)


def _point(values: dict[str, str], case: Case, evaluation: Evaluation, base: SweepPoint | None) -> SweepPoint:
    numbers = {key: number if isinstance(number := own_value(case, key), int | float) else None for key in values}
    if evaluation.forces is None:
        return SweepPoint(values, numbers, None, evaluation.cause, evaluation.seconds)
    tests = {}
    elastic = (None,) * len(case.tests) if evaluation.elastic is None else evaluation.elastic.forces or ()
    for test, measured, force, slow in zip(case.tests, case.curves, evaluation.forces, elastic, strict=True):
        own = None if base is None or base.tests is None else base.tests.get(test.name)
        known = _test_point(Curve(case.outputs(test), force), measured, own)
        tests[test.name] = known if slow is None else replace(known, equivalent=float(force[-1] / slow[-1]))
    return SweepPoint(values, numbers, tests, None, evaluation.seconds)


def _test_point(curve: Curve, measured: Curve | None, own: TestPoint | None) -> TestPoint:
    last, slope = float(curve.force[-1]), stiffness(curve)
    misfit = None
    if measured is not None and measured.force.size == curve.force.size:  # not those over ramp and hold
        misfit = float(np.sqrt(np.mean((curve.force - measured.force) ** 2)))
    return TestPoint(
        force=last,
        stiffness=slope,
        force_change=None if own is None else last / own.force - 1,
        stiffness_change=None if own is None else slope / own.stiffness - 1,
        rmse=misfit,
        curve=curve,
    )


def _sensitivities(case: Case, varied: Variation, base: SweepPoint, points: Sequence[SweepPoint]) -> Iterator[Sensitivity]:
    """Sensitivity of each test to one key; empty where fewer than two values, with the case's own, were computed."""
    mine = [(point.numbers[varied.key], point.tests) for point in points if set(point.values) == {varied.key} and point.tests]
    own = own_value(case, varied.key)
    if base.tests is None or not mine:
        return
    mine.append((own if isinstance(own, int | float) else None, base.tests))
    for test in case.tests:
        pairs = [(value, tests[test.name]) for value, tests in mine]
        numbers = [(value, result.force) for value, result in pairs if value is not None]
        yield Sensitivity(
            varied.key,
            test.name,
            float(np.ptp([result.force for _, result in pairs])) / abs(base.tests[test.name].force),
            float(np.ptp([result.stiffness for _, result in pairs])) / abs(base.tests[test.name].stiffness),
            _elasticity(numbers),
            _trend(numbers),
        )


def _elasticity(numbers: Iterable[tuple[float, float]]) -> float | None:
    """Slope of ln(force) over ln(value), by least squares."""
    pairs: Array = np.array(sorted(set(numbers))).reshape(-1, 2)
    values, forces = pairs.T
    if np.unique(values).size < 2 or values.min() <= 0 or forces.min() <= 0:
        return None
    return float(np.polyfit(np.log(values), np.log(forces), 1)[0])


def _trend(numbers: Iterable[tuple[float, float]]) -> str:
    """The trend of the force with the value: "rises" or "falls" throughout, "flat", "turns", or "unordered" for words."""
    ordered = sorted(set(numbers))
    if len({value for value, _ in ordered}) < 2:
        return "unordered"
    steps = np.diff([force for _, force in ordered])
    if abs(steps).sum() < FLAT * abs(ordered[0][1]):
        return "flat"
    return "rises" if (steps > 0).all() else "falls" if (steps < 0).all() else "turns"


def _ranked(sensitivities: Sequence[Sensitivity]) -> tuple[Sensitivity, ...]:
    """Sensitivities in falling order of the keys' largest effect on any test."""
    spans = {key: max(s.force_span for s in sensitivities if s.key == key) for key in {s.key for s in sensitivities}}
    return tuple(sorted(sensitivities, key=lambda s: -spans[s.key]))
