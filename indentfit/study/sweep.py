"""How the force curves of a case change with its keys: one at a time about the case itself, or on a grid.

Changes are of the force at the last displacement and of the stiffness, which is, as in the source paper (J Mech Behav
Biomed Mater 65:490), the slope of the straight line fitted to the curve.
"""

import itertools
import re
from dataclasses import asdict, dataclass, field

import numpy as np

from indentfit.case import Case, Range
from indentfit.curve import Curve
from indentfit.errors import CaseError
from indentfit.experiment.measured import changed_case
from indentfit.inverse.objective import rmse
from indentfit.study.refit import Refit, refits
from indentfit.study.runs import evaluate

FORMAT = "indentfit.sweep/1"
PERCENT = re.compile(r"(?:\+-|\+/-|±)\s*(\d+\.?\d*|\.\d+)\s*%")
SPAN = re.compile(r"([^:]+):([^:]+):(\d+)")
MOST_POINTS = 10_000
FLAT = 1e-3  # of the force: less than the solver and its contact are exact to


@dataclass(frozen=True)
class Variation:
    """One key of the case and the values that it takes, as they are written after `--set KEY=`."""

    key: str
    values: tuple[str, ...]


@dataclass(frozen=True)
class TestPoint:
    """One test at one point: force at the last displacement, mN, stiffness, mN/mm, their changes against the case as it
    is (shares), and the misfit to its measured curve, mN; None where there is none."""

    __test__ = False  # not a test of pytest's

    force: float
    stiffness: float
    force_change: float | None
    stiffness_change: float | None
    rmse: float | None
    curve: Curve = field(repr=False)


@dataclass(frozen=True)
class Plan:
    """What a sweep computes: the case as it is, then each point, as (values as written, Case)."""

    variations: tuple[Variation, ...]
    grid: bool
    points: tuple[tuple[dict[str, str], Case], ...]

    @property
    def cases(self):
        return [case for _, case in self.points]


@dataclass(frozen=True)
class Point:
    """The case with some keys at other values: what its tests gave (name -> TestPoint), or the cause why nothing.

    values: as written; numbers: in the units of the case, None where a value is a word.
    """

    values: dict[str, str]
    numbers: dict[str, float | None]
    tests: dict[str, TestPoint] | None
    cause: str | None
    seconds: float


@dataclass(frozen=True)
class Sensitivity:
    """What one key does to one test: the spread of force and stiffness over its values, as shares of the case's own, the
    elasticity, d ln(force) / d ln(value), where the values are positive numbers, and the trend of the force over them."""

    key: str
    test: str
    force_span: float
    stiffness_span: float
    elasticity: float | None
    trend: str


@dataclass(frozen=True)
class Sweep:
    """A sweep: the case as it is (`base`), the points around it or on the grid, and the keys by what they do.

    Sensitivities are ordered by the largest force_span of a key among the tests; a grid has none. own: the case's own
    value of each key.
    """

    title: str
    case_hash: str
    grid: bool
    variations: tuple[Variation, ...]
    base: Point
    points: tuple[Point, ...]
    sensitivities: tuple[Sensitivity, ...]
    tests: dict[str, int]
    parameters: dict[str, float]
    own: dict[str, float | str | None]
    refits: tuple[Refit, ...] = ()

    def as_json(self):
        """The stable keys of a sweep's result.json."""
        return {
            "format": FORMAT,
            "title": self.title,
            "case_hash": self.case_hash,
            "grid": self.grid,
            "tests": self.tests,
            "parameters": self.parameters,
            "variations": {one.key: list(one.values) for one in self.variations},
            "own": self.own,
            "base": _point_json(self.base),
            "points": [_point_json(point) for point in self.points],
            "refits": [asdict(one) for one in self.refits],
            "sensitivities": [asdict(one) for one in self.sensitivities],
        }


def plan(case, texts, grid=False):
    """Plan of a sweep of a Case over texts KEY=VALUES; every combination of them on a grid.

    Raises CaseError where a key or a value is not one of the case's, a line for each.
    """
    variations = tuple(variation(case, text) for text in texts)
    combinations = _combinations(variations, grid)
    return Plan(variations, grid, (({}, case), *zip(combinations, _cases(case, combinations), strict=True)))


def sweep(planned, ledger=None, workers=None, cluster=None, stop=None, progress=None):
    """Sweep of a Plan; the other arguments are those of `study.runs.evaluate`, and so is what is raised."""
    found = evaluate(planned.cases, ledger, workers, cluster, stop, progress)
    (_, case), *others = planned.points
    own = _point({}, case, found[0], None)
    points = tuple(_point(values, one, evaluation, own) for (values, one), evaluation in zip(others, found[1:], strict=True))
    ranked = () if planned.grid else _ranked([s for one in planned.variations for s in _sensitivities(case, one, own, points)])
    tests = {test.name: test.angle for test in case.tests}
    values = {one.key: _own_value(case, one.key) for one in planned.variations}
    return Sweep(case.title, case.hash, planned.grid, planned.variations, own, points, ranked, tests, case.start_values(), values)


def refitted(planned, ledger=None, cluster=None, stop=None, progress=None):
    """Refits of the case as it is and of each point of a Plan; a varied parameter is held."""
    labels = [", ".join(f"{key} = {value}" for key, value in values.items()) or "the case" for values, _ in planned.points]
    return refits(list(zip(labels, planned.cases, strict=True)), ledger, cluster, stop, progress)


# ---- values ------------------------------------------------------------------------------------------------------


def variation(case, text):
    """The Variation of a text KEY=LIST (`0.2,0.3`), KEY=FIRST:LAST:NUMBER (evenly spaced) or KEY=+-PERCENT% of its value.

    Raises CaseError in one line.
    """
    name, equals, asked = (part.strip() for part in text.partition("="))
    where = f"--vary {text}"
    if not equals or not name or not asked:
        raise CaseError(f"{where}: write KEY=VALUES, such as indenter.friction=0.2,0.3 or material.mu=+-15%")
    if name.partition(".")[0] == "fit":
        raise CaseError(f"{where}: a key of the search does not change a force; vary another key")
    if match := PERCENT.fullmatch(asked):
        own, share = _own_number(case, name, where), float(match[1]) / 100
        values = [_text(own * (1 - share)), _text(own * (1 + share))]
    elif match := SPAN.fullmatch(asked):
        values = _span(where, *match.groups())
    else:
        values = [part.strip() for part in _split(asked)]
    if "" in values:
        raise CaseError(f"{where}: a value is missing between the commas; take the extra comma away")
    return Variation(name, tuple(dict.fromkeys(values)))


def number(value):
    """The number that a value of a Variation is written as, or None."""
    try:
        return float(value)
    except ValueError:
        return None


def _own_number(case, name, where):
    """The number that the case itself has for a key."""
    found = _own_value(case, name)
    if isinstance(found, bool) or not isinstance(found, int | float) or not found:
        shown = "no value" if found is None else f"the value {found!r}"
        raise CaseError(f"{where}: the case has {shown} for it, and percents of that mean nothing; give a list of values")
    return float(found)


def _own_value(case, name):
    section, _, rest = name.partition(".")
    if section == "material" and rest.removeprefix("parameters.").removesuffix(".start") in case.start_values():
        return case.start_values()[rest.removeprefix("parameters.").removesuffix(".start")]
    if section == "test":
        for n, test in enumerate(case.tests):
            for label in (test.name, str(n)):
                if rest.startswith(label + "."):
                    return getattr(test, rest[len(label) + 1 :], None)
        return None
    value = getattr(getattr(case, section, None), rest, None)
    return None if isinstance(value, Range) or callable(value) else value


def _span(where, first, last, count):
    low, high = number(first), number(last)
    if low is None or high is None or not 2 <= int(count) <= MOST_POINTS:
        raise CaseError(f"{where}: a range is FIRST:LAST:NUMBER, two numbers and how many values, such as 0.2:0.5:4")
    return [_text(value) for value in np.linspace(low, high, int(count))]


def _split(text):
    """Parts between commas that are not within brackets or quotes."""
    parts, depth, quote = [""], 0, ""
    for letter in text:
        quote = "" if letter == quote else letter if letter in "\"'" and not quote else quote
        depth += 0 if quote else (letter in "[{") - (letter in "]}")
        if letter == "," and not depth and not quote:
            parts.append("")
        else:
            parts[-1] += letter
    return parts


def _text(value):
    return f"{value:.10g}"


def _combinations(variations, grid):
    """The keys and values of each point."""
    if grid:
        keys = [one.key for one in variations]
        return [dict(zip(keys, one, strict=True)) for one in itertools.product(*(one.values for one in variations))]
    return [{one.key: value} for one in variations for value in one.values]


def _cases(case, combinations):
    """The Case of each point; every wrong one is named before any is run."""
    if len(combinations) > MOST_POINTS:
        raise CaseError(f"--grid: {len(combinations):,} points are too many; give fewer values")
    cases, problems = [], []
    for values in combinations:
        try:
            cases.append(changed_case(case, [f"{key}={value}" for key, value in values.items()]))
        except CaseError as error:
            problems += error.faults
    if problems:
        raise CaseError([line.replace("(--set)", "(--vary)") for line in dict.fromkeys(problems)])
    return cases


# ---- what the runs say -------------------------------------------------------------------------------------------


def stiffness(curve):
    """Slope of the straight line fitted to a curve, mN/mm."""
    return float(np.polyfit(curve.displacement, curve.force, 1)[0]) if curve.force.size > 1 else float("nan")


def _point(values, case: Case, evaluation, own):
    if evaluation.forces is None:
        return Point(values, _numbers(case, values), None, evaluation.cause, evaluation.seconds)
    tests = {}
    for test, measured, force in zip(case.tests, case.curves, evaluation.forces, strict=True):
        curve = Curve(case.outputs(test), force)
        given = None if own is None or own.tests is None else own.tests.get(test.name)
        slope = stiffness(curve)
        tests[test.name] = TestPoint(
            force=float(force[-1]),
            stiffness=slope,
            force_change=given and float(force[-1]) / given.force - 1,
            stiffness_change=given and slope / given.stiffness - 1,
            rmse=None if measured is None else rmse(_Measured(measured), force),
            curve=curve,
        )
    return Point(values, _numbers(case, values), tests, None, evaluation.seconds)


def _numbers(case, values):
    return {key: own if isinstance(own := _own_value(case, key), int | float) else None for key in values}


@dataclass(frozen=True)
class _Measured:
    curve: Curve


def _sensitivities(case, one, own, points):
    """Sensitivity of each test to one key; none where fewer than two values, the case's own among them, were computed."""
    mine = [point for point in points if set(point.values) == {one.key} and point.tests is not None]
    own_number = _numbers(case, [one.key])[one.key]
    if own.tests is None or not mine:
        return
    for test in case.tests:
        pairs = [(point.numbers[one.key], point.tests[test.name]) for point in mine]
        pairs.append((own_number, own.tests[test.name]))
        forces = np.array([point.force for _, point in pairs])
        slopes = np.array([point.stiffness for _, point in pairs])
        numbers = [(x, point.force) for x, point in pairs if x is not None]
        yield Sensitivity(
            one.key,
            test.name,
            float(np.ptp(forces)) / abs(own.tests[test.name].force),
            float(np.ptp(slopes)) / abs(own.tests[test.name].stiffness),
            _elasticity(numbers),
            _trend(numbers),
        )


def _elasticity(numbers):
    """Slope of ln(force) over ln(value), by least squares."""
    x, F = np.array(sorted(set(numbers))).reshape(-1, 2).T
    if np.unique(x).size < 2 or x.min() <= 0 or F.min() <= 0:
        return None
    return float(np.polyfit(np.log(x), np.log(F), 1)[0])


def _trend(numbers):
    """Whether the force "rises" or "falls" with the value throughout, is "flat", "turns", or "unordered" as words are."""
    ordered = sorted(set(numbers))
    if len({x for x, _ in ordered}) < 2:
        return "unordered"
    steps = np.diff([force for _, force in ordered])
    if abs(steps).sum() < FLAT * abs(ordered[0][1]):
        return "flat"
    return "rises" if (steps > 0).all() else "falls" if (steps < 0).all() else "turns"


def _ranked(found):
    """Keys in falling order of what they do to the test that they do most to."""
    largest = {one.key: max(other.force_span for other in found if other.key == one.key) for one in found}
    return tuple(sorted(found, key=lambda one: -largest[one.key]))


def _point_json(point):
    tests = point.tests and {
        name: {
            "force_mN": one.force,
            "stiffness_mN_per_mm": one.stiffness,
            "force_change": one.force_change,
            "stiffness_change": one.stiffness_change,
            "rmse_mN": one.rmse,
            "displacement_mm": one.curve.displacement.tolist(),
            "forces_mN": one.curve.force.tolist(),
        }
        for name, one in point.tests.items()
    }
    return {"values": point.values, "numbers": point.numbers, "tests": tests, "cause": point.cause, "seconds": point.seconds}
