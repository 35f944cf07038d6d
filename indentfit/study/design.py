"""The next experiment: which further test would determine the worst parameter best, from Fisher's information.

The information of a test at given parameters is sum (dF/dtheta)^2 / sigma^2; the information of several tests adds up. Each further
indentation differs from the case in one key, and is tried at both angles and at several depths; where the material relaxes, also at
other rates and with other holds, which need no run. Tests of other kinds are homogeneous states. The parameters' ranges count as a
weak, uniform prior, so that every standard error is finite.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from indentfit.arrays import Array
from indentfit.case import Case, Range, Test, require_designable
from indentfit.case.families import faults_of_families
from indentfit.case.in_time import GRID
from indentfit.case.laws import has_fibres
from indentfit.case.prior_tests import with_prior_tests
from indentfit.curve import Curve
from indentfit.digits import sizes
from indentfit.errors import DesignError, IndentfitError
from indentfit.hereditary import Ramp
from indentfit.inference.seen import seen_sentences
from indentfit.inverse.derivatives import Underivable, curve_derivatives, evaluate_at_reference
from indentfit.inverse.objective import Target
from indentfit.inverse.problem import InverseProblem, differences_of, scale_of
from indentfit.runs.pool import RunPool
from indentfit.runs.relaxing import elastic_case
from indentfit.samples import Circle
from indentfit.study.in_time import Curves, InTime
from indentfit.study.runs import Execution

NOISE = 0.01  # of the largest force, by default
DEPTHS = (0.5, 1.0, 1.5)  # of the case's largest depth
STRAINS = {"shear": 0.2, "uniaxial": 0.2}  # of tests of other kinds
SPECIMEN_POINTS = 12
BEST, PAIRS = 12, 10  # further tests that are paired, and pairs that are kept
DEEPEST = 0.2  # of the thickness: equilibria at larger depths may not be found
POINTS = 24  # points of each further test
ANGLES, OBLIQUE = (0, 90), 45  # degrees
TURN, RADIAN = "fibre_angle", 57.3  # the error of an angle is judged by degrees in a radian, not by its own size
EFFORTS = {  # what a further test needs
    "as it is": "the same rig",
    "variant": "another indenter or lubrication",
    "rate": "the same rig, {seconds:.3g} s",
    "shear": "a specimen of its own and a shear rig",
    "uniaxial": "a strip of tissue, clamped",
}
AS_KNOWN = (
    "{names}: uncertain in this case, or left out, and taken as known here, at the value that a simulation takes: errors are at "
    "least these, and another test may be the best"
)

Values = Mapping[str, float]


@dataclass(frozen=True)
class FurtherTest:
    """One further test, with the standard errors by this test and the tests of the case together.

    Parameters
    ----------
    change : str
        The changed key of the case, or the test of another kind; empty for no change.
    angle : float, degrees, or None for a test of another kind
    depth : float, mm, or None for a test of another kind
    stderr : dict of parameter -> standard error, in the parameter's unit, or None
    cause : str or None
        Why there is no standard error.
    kind : str
        Kind of the test.
    effort : str
        What the test needs that the tests of the case do not.
    """

    change: str
    angle: float | None
    depth: float | None
    stderr: dict[str, float] | None
    cause: str | None = None
    kind: str = "indentation"
    effort: str = ""

    @property
    def words(self) -> str:
        return self.change or "as the case is"

    @property
    def whole_words(self) -> str:
        """The test in words, with its angle and depth."""
        return self.words if self.angle is None else f"{self.words}, angle {self.angle}°, to {self.depth:.3g} mm"


@dataclass(frozen=True)
class FurtherPair:
    """Two further tests, with the standard errors by both and the tests of the case together."""

    first: str
    second: str
    stderr: dict[str, float]


@dataclass(frozen=True, repr=False, eq=False)
class Design:
    """Further tests, ranked by the standard error of the worst parameter.

    Parameters
    ----------
    parameters : dict of name -> value
        Parameters at which the information was computed.
    noise : float, mN
        Standard deviation of a force.
    stderr : dict of parameter -> standard error by the case's own tests
    worst : str
        The parameter whose standard error is largest, relative to its value.
    candidates : tuple of FurtherTest
        Further tests, the best for `worst` first, failed tests last.
    pairs : tuple of FurtherPair
        The best pairs of further tests.
    runs : int
        Number of runs of the forward model.
    case : Case or None
    remarks : tuple of str
        What the records of the case cannot see of a relaxation; empty where the material is elastic.
    """

    FORMAT: ClassVar[str] = "indentfit.design/2"

    parameters: dict[str, float]
    noise: float
    stderr: dict[str, float]
    worst: str
    candidates: tuple[FurtherTest, ...]
    runs: int
    case: Case | None = None
    remarks: tuple[str, ...] = ()
    pairs: tuple[FurtherPair, ...] = ()

    def as_json(self) -> dict[str, Any]:
        """The stable keys of design.json, under the tag `format`."""
        return {
            "format": self.FORMAT,
            "parameters": self.parameters,
            "noise_mN": self.noise,
            "stderr": self.stderr,
            "worst": self.worst,
            "candidates": [asdict(test) for test in self.candidates],
            "pairs": [asdict(pair) for pair in self.pairs],
            "runs": self.runs,
            **({"remarks": list(self.remarks)} if self.remarks else {}),
        }

    @classmethod
    def from_json(cls, value: Mapping[str, Any]) -> Design:
        """The design that design.json holds, in the form of this version or of 0.1."""
        tests = tuple(FurtherTest(**test) for test in value["candidates"])
        remarks, pairs = tuple(value.get("remarks", ())), tuple(FurtherPair(**pair) for pair in value.get("pairs", ()))
        known = value["parameters"], value["noise_mN"], value["stderr"], value["worst"], tests, value["runs"]
        return cls(*known, remarks=remarks, pairs=pairs)

    def summary(self) -> str:
        """The design in words, as the command prints it."""
        from indentfit.report.study_text import design_lines

        return "\n".join(design_lines(self))

    def plot(self, path: str | Path | None = None) -> Any:
        """The matplotlib Figure of the candidates; saved as SVG and PNG where a path is given."""
        from indentfit.report.plots import designs

        return designs(self, path)

    def write(self, folder: str | Path, overwrite: bool = False) -> None:
        """Write the result folder. Raises OutputError where the folder exists already, or cannot be written."""
        from indentfit.report.study_folder import write_design

        write_design(self, folder, overwrite)

    def __repr__(self) -> str:
        best = next((test for test in self.candidates if test.stderr), None)
        end = f"; best: {best.whole_words}" if best else ""
        return f"Design(worst parameter {self.worst}{end})"

    def _repr_html_(self) -> str:
        from indentfit.report.study_text import design_rows, html_table

        return html_table(repr(self), design_rows(self))


@dataclass(frozen=True)
class _Known:
    """The state before a further test: values of the parameters, their names, information (p, p), noise, mN, and that over the
    largest force."""

    parameters: Values
    names: tuple[str, ...]
    information: Array
    noise: float
    share: float

    def stderr(self, information: Array) -> dict[str, float]:
        """Standard errors with the information of further tests."""
        return dict(zip(self.names, np.sqrt(np.diag(np.linalg.inv(self.information + information))).tolist(), strict=True))


@dataclass(frozen=True, eq=False)
class _Told:
    """A further test without its standard errors, and the information that it gives; None where it failed."""

    test: FurtherTest
    information: Array | None


def design(case: Case, parameters: Values | None = None, noise: float | None = None, execution: Execution | None = None) -> Design:
    """Which further test would determine the worst free parameter of a case best.

    Parameters
    ----------
    case : Case
    parameters : mapping of name to value
        Parameters at which the information is computed; by default the start values.
    noise : float, mN
        Standard deviation of a force; by default 1 % of the largest force of the case's tests. Stresses of tests of other kinds
        have the same share of their largest. Standard deviations that a curve or [fit.prior] states are taken instead.
    execution : Execution
        Progress, workers and cluster of the runs.

    Returns
    -------
    Design

    Raises
    ------
    CaseError
        No parameter of the case is free.
    DesignError
        The case's own tests have no derivatives.
    """
    require_designable(case)
    case = with_prior_tests(case)
    given, execution = dict(parameters or case.start_values()), execution or Execution()
    remarks = tuple(seen_sentences(case, case.relaxation.at(given).numbers)) if case.relaxation else ()
    in_time, elastic = InTime.of(case, given), elastic_case(case)
    given = {**{name: bounds.start for name, bounds in _turn(elastic).items()}, **given}
    values = {name: value for name, value in given.items() if name in case.law.parameters or name in _turn(elastic)}
    if in_time is not None and TURN in case.fit.uncertain.fitted:
        remarks = (*remarks, "the angle of the fibres, which the fit finds, is taken as known here: errors may be larger")
    if doubtful := [name for name in case.fit.uncertain.given if name != "mesh"]:
        remarks = (*remarks, AS_KNOWN.format(names=", ".join(doubtful)))
    own, runs = _own(elastic, values, execution)
    if in_time is not None:
        own = in_time.own(own)
    pressed = [test.kind == "indentation" for test in case.tests]
    largest = max(float(known.forces.max()) for known, press in zip(own, pressed, strict=True) if press)
    noise = noise or NOISE * largest
    sizes = [largest if press else float(np.abs(known.forces).max()) for known, press in zip(own, pressed, strict=True)]
    rows = zip(case.curves, sizes, strict=True)
    stated = [noise / largest * size if curve is None or curve.sd is None else curve.sd for curve, size in rows]
    ranges = {**_free(elastic), **(in_time.relaxation.free if in_time else {})}
    prior = np.diag([12 / (bounds.max - bounds.min) ** 2 for bounds in ranges.values()])
    information = prior + sum(known.information(sd) for known, sd in zip(own, stated, strict=True))
    known = _Known(values, tuple(ranges), information, noise, noise / largest)
    told, used = _told(elastic, in_time, known, execution)
    now, whole = known.stderr(np.zeros_like(prior)), {**values, **(in_time.values if in_time else {})}
    worst = max(now, key=lambda name: now[name] / (RADIAN if name == TURN else abs(whole[name]) or ranges[name].max))
    tests = sorted((_judged(known, further) for further in told), key=lambda test: test.stderr[worst] if test.stderr else np.inf)
    pairs = _pairs(known, told, worst)
    return Design(whole, noise, now, worst, tuple(tests), runs + used, case, remarks, pairs)


def _told(case: Case, in_time: InTime | None, known: _Known, execution: Execution) -> tuple[list[_Told], int]:
    """Further tests of all kinds, with their information, and the number of runs."""
    variants, told, runs = list(_variants(case)), list[_Told](), 0
    for n, (change, variant) in enumerate(variants):
        execution.progress(n / len(variants), change or "as the case is")
        further, used = _further_tests(change, variant, in_time, known, execution)
        told += further
        runs += used
    if in_time is not None or case.sample.layer:
        return told, runs  # materials that relax, and layers, have indentations only
    return told + [_of_specimen(case, test, known, execution) for test in _specimens(case)], runs


def _judged(known: _Known, further: _Told) -> FurtherTest:
    if further.information is None:
        return further.test
    return replace(further.test, stderr=known.stderr(further.information))


def _pairs(known: _Known, told: Sequence[_Told], worst: str) -> tuple[FurtherPair, ...]:
    """The best pairs among the best further tests; the best of each change, angle and kind is paired, not each of its depths."""
    best: dict[tuple[str, float | None], tuple[float, _Told]] = {}
    for further in told:
        if further.information is not None:
            error, key = known.stderr(further.information)[worst], (further.test.change, further.test.angle)
            if key not in best or error < best[key][0]:
                best[key] = (error, further)
    chosen = [further for _, further in sorted(best.values(), key=lambda pair: pair[0])][:BEST]
    pairs = [
        FurtherPair(a.test.whole_words, b.test.whole_words, known.stderr(a.information + b.information))
        for a, b in itertools.combinations(chosen, 2)
        if a.information is not None and b.information is not None
    ]
    return tuple(sorted(pairs, key=lambda pair: pair.stderr[worst])[:PAIRS])


def _variants(case: Case) -> Iterator[tuple[str, Case]]:
    """(the changed key in words, the changed case), with one changed key at a time."""
    yield "", case
    for key, size in case.indenter.geometry.variants(case.sample.geometry.outline.extent):
        yield f"{key} {sizes(size)}", _with_indenter(case, key, size)
    for friction, words in ((0.0, "no friction"), ("stick", "sticking")):
        if case.indenter.friction != friction:
            yield words, _with_indenter(case, "friction", friction)


def _with_indenter(case: Case, key: str, value: float | str) -> Case:
    return case.model_copy(update={"indenter": case.indenter.with_key(key, value)})


def _own(case: Case, parameters: Values, execution: Execution) -> tuple[list[Curves], int]:
    """The curves of the case's own tests with their derivatives, and the number of runs."""
    with RunPool(case, execution.workers, None, execution.cluster, execution.stop) as pool:
        return _curves(case, pool, parameters), pool.runs


def _further_tests(
    change: str, variant: Case, in_time: InTime | None, known: _Known, execution: Execution
) -> tuple[list[_Told], int]:
    """The further tests of one variant, at all angles and depths, from one run each to the deepest; and the number of runs."""
    deepest = max(float(variant.outputs(test)[-1]) for test in variant.indentations)
    allowed = [factor for factor in DEPTHS if factor * deepest <= DEEPEST * variant.sample.thickness] or [DEPTHS[0]]
    cause, used, angles = "", 0, angles_of(variant)
    points, effort = GRID if in_time else 6 * POINTS, EFFORTS["variant" if change else "as it is"]
    while allowed:
        tests = tuple(Test(name=f"{angle}", angle=angle, depth=allowed[-1] * deepest, points=points) for angle in angles)
        tried = variant.model_copy(update={"tests": tests, "curves": (None,) * len(tests)})
        try:
            with RunPool(tried, execution.workers, None, execution.cluster, execution.stop) as pool:
                curves = _curves(tried, pool, known.parameters)
                used += pool.runs
        except IndentfitError as error:
            cause = str(error)
            allowed = allowed[:-1]  # at a smaller depth, equilibrium may be found
            continue
        depths = [factor * deepest for factor in allowed]
        told = list(_at_depths(change, tried, curves, depths, in_time, known, effort))
        if in_time is not None and not change:
            told += _at_rates(tried, curves, min(deepest, allowed[-1] * deepest), in_time, known)
        return told, used
    return [_Told(FurtherTest(change, angle, deepest, None, cause, effort=effort), None) for angle in angles], used


def angles_of(case: Case) -> tuple[int, ...]:
    """The angles between fibres and indenter at which further tests are tried, degrees: also an oblique one where the case has one
    or fits the fibres' angle, because its tests take 2 to 3 times as long."""
    if not has_fibres(case.law):
        return ANGLES[:1]
    if case.sample.directions is not None and not isinstance(case.sample.geometry.outline, Circle):
        return (0,)  # the block on which directions were measured lies as it does
    oblique = "fibre_angle" in case.fit.uncertain.fitted or any(test.direction % 90 for test in case.indentations)
    return (*ANGLES, OBLIQUE) if oblique else ANGLES


def _at_depths(
    change: str, case: Case, curves: Sequence[Curves], depths: Sequence[float], in_time: InTime | None, known: _Known, effort: str
) -> Iterator[_Told]:
    for test, curve in zip(case.tests, curves, strict=True):
        for depth in depths:
            rows = (
                curve.to(depth, POINTS)
                if in_time is None
                else in_time.ramped(curve, Ramp(depth, depth / in_time.rate, in_time.hold))
            )
            yield _Told(FurtherTest(change, test.direction, depth, None, effort=effort), rows.information(known.noise))


def _at_rates(case: Case, curves: Sequence[Curves], depth: float, in_time: InTime, known: _Known) -> Iterator[_Told]:
    """Further tests as the case is, in ramps of other durations and with other holds: they need no run."""
    for test, curve in zip(case.tests, curves, strict=True):
        for ramp in in_time.ramps(depth):
            rows = in_time.ramped(curve, ramp)
            words = f"ramp of {ramp.seconds:.2g} s, " + (f"hold of {ramp.hold:.3g} s" if ramp.hold else "no hold")
            effort = EFFORTS["rate"].format(seconds=ramp.end)
            yield _Told(FurtherTest(words, test.direction, depth, None, effort=effort), rows.information(known.noise))


def _specimens(case: Case) -> Iterator[Test]:
    """Tests of other kinds: shear and tension, in each direction that a law with fibres can tell."""
    along = ("along", "across", "normal") if has_fibres(case.law) else ("along",)
    keys: dict[str, Any] = {"points": SPECIMEN_POINTS}
    if case.law.two_families:
        yield from _specimens_of_two(case, keys)
        return
    for fibres in along:
        yield Test(f"shear {fibres}", kind="shear", fibres=fibres, strain=STRAINS["shear"], **keys)
    for fibres in along[:2]:
        yield Test(f"tension {fibres}", kind="uniaxial", loading="tension", fibres=fibres, strain=STRAINS["uniaxial"], **keys)


def _specimens_of_two(case: Case, keys: Mapping[str, Any]) -> Iterator[Test]:
    """Tests of other kinds of a material with two families in the plane of the sample, along and across their common direction;
    tension only where it does not shear the specimen."""
    families = case.sample.families
    if families is None or any(case.sample.family_dips or ()):
        return
    for fibres in ("along", "across"):
        own = {"fibres": fibres, "families": families, **keys}
        yield Test(f"shear {fibres}", kind="shear", strain=STRAINS["shear"], **own)
        tension = Test(f"tension {fibres}", kind="uniaxial", loading="tension", strain=STRAINS["uniaxial"], **own)
        if not any(faults_of_families(case.material, case.law, None, [(tension.name, tension)])):
            yield tension


def _of_specimen(case: Case, test: Test, known: _Known, execution: Execution) -> _Told:
    """A further test of another kind, whose stresses have the share of noise that the forces have."""
    words = f"{'simple shear' if test.kind == 'shear' else 'tension'}"
    words += f", fibres {test.fibres}" if has_fibres(case.law) else ""
    effort = EFFORTS[test.kind]
    tried = case.model_copy(update={"tests": (test,), "curves": (None,)})
    further = FurtherTest(f"{words}, to a strain of {test.strain:g}", None, None, None, kind=test.kind, effort=effort)
    try:
        with RunPool(tried, execution.workers, None, execution.cluster, execution.stop) as pool:
            (curve,) = _curves(tried, pool, known.parameters)
    except IndentfitError as error:
        return _Told(replace(further, cause=str(error)), None)
    return _Told(further, curve.information(known.share * float(np.abs(curve.forces).max())))


def _curves(case: Case, pool: RunPool, parameters: Values) -> list[Curves]:
    """The curves of every test, with dF/dtheta (n, n_free), mN per unit of a parameter. Raises DesignError."""
    problem = _problem(case, parameters)
    ranges = np.array([problem.range(name) for name in problem.free])
    try:
        slopes = [J / ranges for J in curve_derivatives(problem, pool, problem.units(parameters))]
    except Underivable as failure:
        raise DesignError(f"no design without derivatives: {failure}") from failure
    evaluation = evaluate_at_reference(problem, pool, [parameters])[0]
    assert evaluation.forces is not None  # there were derivatives
    forces = problem.scaled(parameters, evaluation.forces)
    shapes = [case.indenter_of(test).geometry if test.kind == "indentation" else None for test in case.tests]
    triples = zip(case.tests, forces, slopes, shapes, strict=True)
    return [Curves(case.outputs(test), force, J, shape) for test, force, J, shape in triples]


def _problem(case: Case, parameters: Values) -> InverseProblem:
    """An InverseProblem whose tests have only displacements: enough for derivatives."""
    tests = tuple(Target(test.name, Curve(case.outputs(test), case.outputs(test)), 1.0) for test in case.tests)
    scale, reference = scale_of(case)
    return InverseProblem(tests, dict(parameters), _free(case), scale, reference, differences_of(case))


def _free(case: Case) -> dict[str, Range]:
    """What further tests are to determine: the free parameters, and the angle of the fibres where the fit finds it."""
    return {**case.free, **_turn(case)}


def _turn(case: Case) -> dict[str, Range]:
    """The range of the fibres' angle where a fit finds it and the material does not relax; nothing otherwise."""
    fitted = case.fit.uncertain.fitted
    return {TURN: fitted[TURN]} if TURN in fitted and case.relaxation is None else {}
