"""Further tests, with the information that each would give: indentations, side views of them, and tests of other kinds.

Each further indentation differs from the case in one key, and is tried at both angles and at several depths, from one run. The run
as the case is brings the displacements of the sample's sides, too. Where the material relaxes, other rates and other holds need no
run. Tests of other kinds are homogeneous states, or discs between plates.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from indentfit.arrays import Array
from indentfit.case import Case, Range, Test
from indentfit.case.families import faults_of_families
from indentfit.case.in_time import GRID
from indentfit.case.laws import has_fibres
from indentfit.curve import Curve
from indentfit.digits import sizes
from indentfit.errors import DesignError, IndentfitError
from indentfit.hereditary import Ramp
from indentfit.inverse.derivatives import Underivable, curve_derivatives, evaluate_at_reference
from indentfit.inverse.objective import Target
from indentfit.inverse.problem import InverseProblem, differences_of, scale_of
from indentfit.runs.mechanics import sizes_of_fields
from indentfit.runs.parted import Parted
from indentfit.runs.pool import RunPool
from indentfit.samples import Circle
from indentfit.study import views
from indentfit.study.in_time import Curves, InTime
from indentfit.study.promised import Evidence, half_widths, spread
from indentfit.study.runs import Execution

DEPTHS = (0.5, 1.0, 1.5)  # of the case's largest depth
DEEPEST = 0.2  # of the thickness: equilibria at larger depths may not be found
POINTS = 24  # points of each further test
ANGLES, OBLIQUE = (0, 90), 45  # degrees
TURN = "fibre_angle"
STRAIN = 0.2  # of tests of other kinds
FLAT = 0.5  # height of a disc between plates, in diameters
WORDS = {"shear": "simple shear", "uniaxial": "tension"}
EFFORTS = {  # what a further test needs
    "as it is": "the same rig",
    "variant": "another indenter or lubrication",
    "rate": "the same rig, {seconds:.3g} s",
    "shear": "a specimen of its own and a shear rig",
    "uniaxial": "a strip of tissue, clamped",
    "sliding": "a disc of its own between wet plates",
    "bonded": "a disc of its own, glued between plates",
}

Values = Mapping[str, float]


@dataclass(frozen=True)
class FurtherTest:
    """One further test, with the standard errors by this test and the tests of the case together.

    Parameters
    ----------
    change : str
        The changed key of the case, what is seen beside the force, or the test of another kind; empty for no change.
    angle : float, degrees, or None for a test of another kind
    depth : float, mm, or None for a test of another kind
    stderr : dict of parameter -> standard error, in the parameter's unit, or None
    cause : str or None
        Why there is no standard error.
    kind : str
        Kind of the test.
    effort : str
        What the test needs that the tests of the case do not.
    solves : int or None
        Number of solutions by finite elements that the test adds to each step of a fit; None in files of earlier versions.
    half_width : dict of parameter -> half width, or None
        Half width of the 95 % interval that a fit with this test is expected to state; None in files of earlier versions.
    between : dict of parameter -> (least, largest), or None
        Half widths between which 90 % of single fits are expected to state theirs, where the parameters are an estimate by the
        tests of the case that leaves much open.
    unsolved : int
        Number of the values that the estimate leaves open at which there is no solution of the test; the half width and the span
        are those at the others, and at the estimate.
    """

    change: str
    angle: float | None
    depth: float | None
    stderr: dict[str, float] | None
    cause: str | None = None
    kind: str = "indentation"
    effort: str = ""
    solves: int | None = None
    half_width: dict[str, float] | None = None
    between: dict[str, tuple[float, float]] | None = None
    unsolved: int = 0

    @property
    def words(self) -> str:
        return self.change or "as the case is"

    @property
    def whole_words(self) -> str:
        """The test in words, with its angle and depth."""
        return self.words if self.angle is None else f"{self.words}, angle {self.angle}°, to {self.depth:.3g} mm"


Rows = tuple[tuple[Evidence, ...], ...]  # evidence at each place; empty where there is none


class Promise(NamedTuple):
    """Intervals that a fit is expected to state, as those of a `FurtherTest`."""

    half_width: dict[str, float]
    between: dict[str, tuple[float, float]] | None
    unsolved: int


@dataclass(frozen=True)
class Known:
    """The state before a further test.

    Parameters
    ----------
    places : tuple of mappings of name to value
        The parameters, and values over which the tests of the case leave them open.
    names : tuple of str
        Of the parameters that are to be determined.
    prior : array (p, p)
        Information before all tests.
    own : tuple of tuples of Evidence
        That of the case's own tests, at each place; the first, the parameters', is never empty.
    squares : bool
        Whether fits minimise squares, or equation (1).
    noise : float, mN
    share : float
        The noise over the largest force.
    view_noise : float, mm
        Standard deviation of a displacement in a side view.
    """

    places: tuple[Values, ...]
    names: tuple[str, ...]
    prior: Array
    own: Rows
    squares: bool
    noise: float
    share: float
    view_noise: float

    def stderr(self, evidence: Rows = ()) -> dict[str, float]:
        """Standard errors by Fisher's information, with the evidence of further tests."""
        every = (*self.own[0], *(evidence[0] if evidence else ()))
        covar = np.linalg.inv(self.prior + sum(each.information for each in every))
        return dict(zip(self.names, np.sqrt(np.diag(covar)).tolist(), strict=True))

    def promised(self, evidence: Rows = ()) -> Promise:
        """Half widths of the expected 95 % intervals at the parameters; or, where values are left open, the median over those, and
        the span of what single fits state: over these values, and over the noise that each learns. Where some of these values have
        no evidence, the parameters themselves count with the others; where none has, there is no span."""
        more = evidence or ((),) * len(self.own)
        every = [(*own, *new) if own and (new or not evidence) else () for own, new in zip(self.own, more, strict=True)]
        first, solved = every[0], [each for each in every[1:] if each]
        unsolved = len(self.places) - 1 - len(solved)
        at = [*([first] if unsolved or not solved else []), *solved]
        rows = np.array([half_widths(each, self.prior, self.squares) for each in at])
        middle = np.median(rows, axis=0)
        told = dict(zip(self.names, middle.tolist(), strict=True))
        if not solved:
            return Promise(told, None, unsolved)
        open_logs = np.log(np.array([rows.min(axis=0), rows.max(axis=0)]) / middle)
        learnt_logs = np.log(spread(first, self.prior, self.squares))
        low, high = middle * np.exp(np.array([[-1.0], [1.0]]) * np.hypot(open_logs, learnt_logs))
        return Promise(told, dict(zip(self.names, zip(low.tolist(), high.tolist(), strict=True), strict=True)), unsolved)


@dataclass(frozen=True, eq=False)
class Told:
    """A further test without its errors, and what it tells at each place; None where it failed."""

    test: FurtherTest
    evidence: Rows | None


@dataclass(frozen=True, eq=False)
class Forces:
    """The curves of tests, and the displacements of their measured fields, each with derivatives."""

    curves: list[Curves]
    fields: list[Curves] = field(default_factory=list)


def further_tests(case: Case, in_time: InTime | None, known: Known, execution: Execution) -> tuple[list[Told], int]:
    """Further tests of all kinds, with their information, and the number of runs."""
    variants, told, runs = list(_variants(case)), list[Told](), 0
    for n, (change, variant) in enumerate(variants):
        execution.progress(n / len(variants), change or "as the case is")
        further, used = _indentations(change, variant, in_time, known, execution)
        told += further
        runs += used
    if in_time is not None or case.sample.layer:
        return told, runs  # materials that relax, and layers, have indentations only
    return told + [_of_specimen(case, test, known, execution) for test in _specimens(case)], runs


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


def _indentations(change: str, variant: Case, in_time: InTime | None, known: Known, execution: Execution) -> tuple[list[Told], int]:
    """The further tests of one variant, at all angles and depths, from one run each to the deepest; and the number of runs."""
    deepest = max(float(variant.outputs(test)[-1]) for test in variant.indentations)
    allowed = [factor for factor in DEPTHS if factor * deepest <= DEEPEST * variant.sample.thickness] or [DEPTHS[0]]
    cause, used, angles = "", 0, angles_of(variant)
    points, effort, seen = GRID if in_time else 6 * POINTS, EFFORTS["variant" if change else "as it is"], not (change or in_time)
    while allowed:
        tests = tuple(Test(name=f"{angle}", angle=angle, depth=allowed[-1] * deepest, points=points) for angle in angles)
        depths = [factor * deepest for factor in allowed]
        tried = variant.model_copy(update={"tests": tests, "curves": (None,) * len(tests)})
        tried = views.with_views(tried, depths) if seen else tried
        try:
            with RunPool(tried, execution.workers, None, execution.cluster, execution.stop) as pool:
                forces = forces_at(tried, pool, known.places)
                used += pool.runs
        except IndentfitError as error:
            cause = str(error)
            allowed = allowed[:-1]  # at a smaller depth, equilibrium may be found
            continue
        told = _joined(
            [list(_at_depths(change, tried, there.curves, depths, in_time, known, effort)) if there else [] for there in forces]
        )
        if seen:
            told += _joined([list(_seen(tried, there, depths, known)) if there else [] for there in forces])
        if in_time is not None and not change:
            depth = min(deepest, allowed[-1] * deepest)
            told += _joined([list(_at_rates(tried, there.curves, depth, in_time, known)) if there else [] for there in forces])
        return told, used
    failed = [FurtherTest(change, angle, deepest, None, cause, effort=effort, solves=1) for angle in angles]
    return [Told(test, None) for test in failed], used


def _joined(rows: Sequence[Sequence[tuple[FurtherTest, tuple[Evidence, ...]]]]) -> list[Told]:
    """The further tests of the first place, each with its evidence at all places."""
    return [Told(test, tuple(row[n][1] if row else () for row in rows)) for n, (test, _) in enumerate(rows[0])]


def evidence_of(curve: Curves, noise: float | Array, weight: float = 1.0, pressed: bool = True, learnt: bool = True) -> Evidence:
    """What a curve tells whose points have standard deviations of one size, or of one for each point."""
    size, typical = float(np.sqrt(np.mean(curve.forces**2))), float(np.mean(np.square(noise) ** -1.0) ** -0.5)
    return Evidence(curve.information(noise), size, typical, curve.forces.size, weight, pressed, learnt)


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
    change: str, case: Case, curves: Sequence[Curves], depths: Sequence[float], in_time: InTime | None, known: Known, effort: str
) -> Iterator[tuple[FurtherTest, tuple[Evidence, ...]]]:
    for test, curve in zip(case.tests, curves, strict=True):
        for depth in depths:
            rows = (
                curve.to(depth, POINTS)
                if in_time is None
                else in_time.ramped(curve, Ramp(depth, depth / in_time.rate, in_time.hold))
            )
            further = FurtherTest(change, test.direction, depth, None, effort=effort, solves=1)
            yield further, (evidence_of(rows, known.noise),)


def _seen(case: Case, forces: Forces, depths: Sequence[float], known: Known) -> Iterator[tuple[FurtherTest, tuple[Evidence, ...]]]:
    """Further tests as the case is, with one of the sample's sides in view at their deepest; the run of the force has them too."""
    curves = dict(zip([test.name for test in case.tests], forces.curves, strict=True))
    for test, view in views.views_in(case, depths, [(rows.forces, rows.slopes) for rows in forces.fields]):
        force = evidence_of(curves[test.name].to(view.depth, POINTS), known.noise)
        for kind in (views.MARKERS, views.OUTLINE):
            words, effort = views.words_of(case, view.axis, kind), f"{EFFORTS['as it is']}, {views.EFFORTS[kind]}"
            further = FurtherTest(words, test.direction, view.depth, None, kind="side view", effort=effort, solves=1)
            yield further, (force, Evidence(view.information(kind, known.view_noise)))


def _at_rates(
    case: Case, curves: Sequence[Curves], depth: float, in_time: InTime, known: Known
) -> Iterator[tuple[FurtherTest, tuple[Evidence, ...]]]:
    """Further tests as the case is, in ramps of other durations and with other holds: they need no run."""
    for test, curve in zip(case.tests, curves, strict=True):
        for ramp in in_time.ramps(depth):
            rows = in_time.ramped(curve, ramp)
            words = f"ramp of {ramp.seconds:.2g} s, " + (f"hold of {ramp.hold:.3g} s" if ramp.hold else "no hold")
            effort = EFFORTS["rate"].format(seconds=ramp.end)
            further = FurtherTest(words, test.direction, depth, None, effort=effort, solves=1)
            yield further, (evidence_of(rows, known.noise),)


def _specimens(case: Case) -> Iterator[Test]:
    """Tests of other kinds: shear, tension and compression, in each direction that a law with fibres can tell."""
    fibrous = has_fibres(case.law)
    along = ("along", "across", "normal") if fibrous else ("along",)
    keys: dict[str, Any] = {"points": POINTS, "strain": STRAIN}
    if case.law.two_families:
        yield from _specimens_of_two(case, keys)
        return
    for fibres in along:
        yield Test(f"shear {fibres}", kind="shear", fibres=fibres, **keys)
    for fibres in along[:2]:
        yield Test(f"tension {fibres}", kind="uniaxial", loading="tension", fibres=fibres, **keys)
    for fibres in along[:2]:
        yield Test(f"compression {fibres}", kind="compression", plates="sliding", fibres=fibres, **_disc(case), **keys)
    if not fibrous:
        yield Test("bonded compression", kind="compression", plates="bonded", **_disc(case), **keys)


def _disc(case: Case) -> dict[str, float]:
    """The sizes of a disc between plates that is as thick as the sample, mm."""
    thickness = float(case.sample.thickness)
    return {"length": thickness, "diameter": thickness / FLAT}


def _specimens_of_two(case: Case, keys: Mapping[str, Any]) -> Iterator[Test]:
    """Tests of other kinds of a material with two families in the plane of the sample, along and across their common direction;
    tension and compression only where they do not shear the specimen."""
    families = case.sample.families
    if families is None or any(case.sample.family_dips or ()):
        return
    for fibres in ("along", "across"):
        own = {"fibres": fibres, "families": families, **keys}
        yield Test(f"shear {fibres}", kind="shear", **own)
        tension = Test(f"tension {fibres}", kind="uniaxial", loading="tension", **own)
        disc = Test(f"compression {fibres}", kind="compression", plates="sliding", **_disc(case), **own)
        for test in (tension, disc):
            if not any(faults_of_families(case.material, case.law, None, [(test.name, test)])):
                yield test


def _of_specimen(case: Case, test: Test, known: Known, execution: Execution) -> Told:
    """A further test of another kind, whose stresses have the share of noise that the forces have."""
    words = WORDS.get(test.kind or "", f"compression between {test.plates} plates")
    words += f", fibres {test.fibres}" if has_fibres(case.law) else ""
    effort, solves = EFFORTS[test.plates or test.kind or ""], int(test.plates == "bonded")
    tried = case.model_copy(update={"tests": (test,), "curves": (None,)})
    words = f"{words}, to a strain of {test.strain:g}"
    further = FurtherTest(words, None, None, None, kind=test.kind or "", effort=effort, solves=solves)
    try:
        with RunPool(tried, execution.workers, None, execution.cluster, execution.stop) as pool:
            curves = [there.curves[0] if there else None for there in forces_at(tried, pool, known.places)]
    except IndentfitError as error:
        return Told(replace(further, cause=str(error)), None)
    noise = [known.share * float(np.abs(curve.forces).max()) if curve else 0.0 for curve in curves]
    pairs = zip(curves, noise, strict=True)
    return Told(further, tuple((evidence_of(curve, sd, pressed=False),) if curve else () for curve, sd in pairs))


def forces_at(case: Case, pool: RunPool, places: Sequence[Values]) -> list[Forces | None]:
    """`forces_of` at several places; None where a place other than the first has none. Raises DesignError."""
    every: list[Forces | None] = [forces_of(case, pool, places[0])]
    for place in places[1:]:
        try:
            every.append(forces_of(case, pool, place))
        except IndentfitError:
            every.append(None)
    return every


def forces_of(case: Case, pool: RunPool, parameters: Values) -> Forces:
    """The curves of every test and the displacements of every field of a case, with derivatives (n, n_free) per unit of a
    parameter. Raises DesignError."""
    problem, model = _problem(case, parameters), Parted.of(pool, case)
    ranges = np.array([problem.range(name) for name in problem.free])
    try:
        slopes = [J / ranges for J in curve_derivatives(problem, model, problem.units(parameters))]
    except Underivable as failure:
        raise DesignError(f"no design without derivatives: {failure}") from failure
    evaluation = evaluate_at_reference(problem, model, [parameters])[0]
    assert evaluation.forces is not None  # there were derivatives
    rows = problem.scaled(parameters, evaluation.forces)
    shapes = [case.indenter_of(test).geometry if test.kind == "indentation" else None for test in case.tests]
    number = len(case.tests)
    triples = zip(case.tests, rows[:number], slopes[:number], shapes, strict=True)
    fields = [Curves(np.arange(1.0, row.size + 1), row, J) for row, J in zip(rows[number:], slopes[number:], strict=True)]
    return Forces([Curves(case.outputs(test), force, J, shape) for test, force, J, shape in triples], fields)


def _problem(case: Case, parameters: Values) -> InverseProblem:
    """An InverseProblem whose tests have only displacements: enough for derivatives."""
    rows = [(test.name, case.outputs(test)) for test in case.tests]
    seen = [(test.name, np.arange(1.0, size + 1)) for test in case.tests for size in sizes_of_fields(case, test)]
    tests = tuple(Target(name, Curve(outputs, outputs), 1.0) for name, outputs in rows + seen)
    scale, reference = scale_of(case)
    return InverseProblem(tests, dict(parameters), free_of(case), scale, reference, differences_of(case))


def free_of(case: Case) -> dict[str, Range]:
    """What further tests are to determine: the free parameters, and the angle of the fibres where the fit finds it."""
    return {**case.free, **turn_of(case)}


def turn_of(case: Case) -> dict[str, Range]:
    """The range of the fibres' angle where a fit finds it and the material does not relax; nothing otherwise."""
    fitted = case.fit.uncertain.fitted
    return {TURN: fitted[TURN]} if TURN in fitted and case.relaxation is None else {}
