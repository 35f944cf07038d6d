"""Results as text for a terminal."""

import textwrap
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from indentfit.axes import MOTION
from indentfit.case import Case
from indentfit.case.laws import has_fibres, isotropic_moduli
from indentfit.digits import Scale, plainly, quantity
from indentfit.fem.facts import MeshFacts, SolverFacts, said_of_paths, said_of_tries
from indentfit.fem.result import ForceError, Simulation, TestResult, TimeCurve
from indentfit.inference.plain import Interval
from indentfit.inference.result import FitResult
from indentfit.inference.shares import DISCREPANCY, InputShare, NoiseShare, UncertainInputs
from indentfit.inverse.course import SurrogateFacts
from indentfit.material import Material, Parameter
from indentfit.report.digits import CurveScale
from indentfit.report.first_screen import doubts_of, first_lines, pieces_words, value_words
from indentfit.runs.closed_form import ClosedForm, closed_forms, left_out
from indentfit.runs.simulated import SimulatedCase

HEAD, COLUMNS = 10, 80  # columns of the word before a line, and of a whole line

KINDS = {
    ("bricks", "q1p0"): "eight-node bricks",
    ("bricks", "q2p1"): "27-node bricks",
    ("axisymmetric", "q2p1"): "nine-node quadrilaterals",
}


def simulation_lines(simulation: Simulation, case: Case, material: Material) -> Iterator[str]:
    """A Simulation in words, line by line: its curves, then the mesh, the solver and how exact the contact is."""
    yield from _material(case, material)
    yield ""
    for tests in _of_equal_displacement(simulation.tests):
        yield from _table(tests, has_fibres(case.law))
        yield ""
    yield from (f"note      {sentence}" for sentence in left_out(case))
    yield from closed_lines(closed_forms(case, {test.name: test.curve for test in simulation.tests}, material.shear_modulus))
    if isinstance(simulation, SimulatedCase) and simulation.misfits:
        off = ", ".join(f"{name} {100 * share:.3g} %" for name, share in simulation.misfits.items())
        yield f"misfit    {off} of the largest measured force, at these values"
    if isinstance(simulation, SimulatedCase) and simulation.creep_misfits:
        off = ", ".join(f"{name} {100 * share:.3g} %" for name, share in simulation.creep_misfits.items())
        yield f"misfit    {off} of the largest measured depth, at these values"
    yield from _mesh(simulation.mesh)
    for test in simulation.tests:
        yield from mesh_error_lines(test)
        if test.in_time is not None:
            yield from time_lines(test.name, test.in_time)
    yield from _solver(simulation.solver)
    yield from _contact(simulation) if simulation.mesh.elements else ()
    tries = said_of_tries((test.name, test.facts) for test in simulation.tests if not test.unfinished)
    for sentence in (*tries, *said_of_paths((test.name, test.facts) for test in simulation.tests)):
        yield f"note      {sentence}"
    for test in simulation.tests:
        if test.unfinished:
            yield f"note      the curve of test {test.name!r} ends at {test.axes.at(test.displacement[-1])}: {test.unfinished}"


def _material(case: Case, material: Material) -> Iterator[str]:
    parameters = type(material).parameters
    values = ", ".join(
        f"{name} = {getattr(material, name):g}{_unit(parameter)}{_start(name, material, case)}"
        for name, parameter in parameters.items()
    )
    moduli = isotropic_moduli(case.material, case.law, material.values)
    beside = "".join(f", {name} = {value:.4g}{'' if name.endswith('nu') else ' kPa'}" for name, value in moduli.items())
    yield f"{case.material.model or case.material.energy}: {values}{beside}"
    if case.relaxation is not None:
        creep = [test.name for test in case.tests if test.control == "force"]
        of_creep = f"elastic ones, for these moduli, in {', '.join(creep)}"
        which = of_creep if len(creep) == len(case.tests) else f"those of the ramp{f', and {of_creep}' if creep else ''}"
        yield f"relaxes: {case.relaxation.words()}; forces over displacement are {which}"


def _start(name: str, material: Material, case: Case) -> str:
    at_start = name in case.free and material.values[name] == case.free[name].start
    return " (start value)" if at_start else ""


def _unit(parameter: Parameter) -> str:
    return f" {parameter.unit}" if parameter.unit not in ("", "1") else ""


def _of_equal_displacement(tests: Sequence[TestResult]) -> list[list[TestResult]]:
    """The tests in groups that can share a table."""
    groups: list[list[TestResult]] = []
    for test in tests:
        for group in groups:
            if group[0].axes == test.axes and np.array_equal(group[0].displacement, test.displacement):
                group.append(test)
                break
        else:
            groups.append([test])
    return groups


def _table(tests: Sequence[TestResult], fibres: bool) -> Iterator[str]:
    """One line for each displacement, one column of forces for each test, named by its angle where there are fibres."""
    names = [f"{test.name} ({test.direction})" if fibres or test.kind != "indentation" else test.name for test in tests]
    widths = [max(10, len(name)) for name in names]
    scale = CurveScale.of(test.curve for test in tests)
    yield f"  {scale.axes.across:>12}  {scale.axes.up}, {scale.force.unit}"
    heads = (f"{name:>{width}}" for name, width in zip(names, widths, strict=True))
    yield "  " + "  ".join([f"{scale.displacement.unit if scale.displacement.unit != '1' else '':>12}", *heads])
    for n, displacement in enumerate(tests[0].displacement):
        forces = (f"{scale.force.text(test.force[n]):>{width}}" for test, width in zip(tests, widths, strict=True))
        yield "  " + "  ".join([f"{scale.displacement.text(displacement):>12}", *forces])


def _mesh(mesh: MeshFacts) -> Iterator[str]:
    if not mesh.elements:
        yield f"mesh      {mesh.remark}"
        return
    kind = KINDS["axisymmetric" if mesh.symmetry == "axisymmetric" else "bricks", mesh.element]
    smallest = f"smallest element {mesh.smallest_mm:.3g} mm"
    yield f"mesh      {mesh.elements:,} {kind}, {mesh.dofs:,} degrees of freedom, {mesh.part}; {smallest}"
    if mesh.remark:
        yield f"note      {mesh.remark}"


def mesh_error_lines(test: TestResult) -> Iterator[str]:
    """The error of a test's forces by the mesh, as far as it was asked for."""
    error = test.mesh_error
    if isinstance(error, ForceError):
        yield (
            f"error     {test.name}: the mesh errs by at most {error.share(test.force):.1%} of the last force "
            f"{_at_small_depths(error, test)}(95 %, by a mesh of {error.elements:,} elements){error.remark and '; ' + error.remark}"
        )
    elif error is not None:
        yield f"error     {test.name}: the error by the mesh is not known: {error}"


def time_lines(name: str, curve: TimeCurve) -> Iterator[str]:
    """The force of a test over time, line by line: at the ramp's end, at the hold's end, and how it was solved; or its depth, where
    the force is held."""
    if curve.creeps:
        yield from _creep_lines(name, curve)
        return
    ramp, peak, held = _ends(curve)
    yield f"time      {name}: {quantity(peak, 'mN')} at the end of the ramp of {ramp:.4g} s{held}"
    yield f"          {curve.words()}"


def _creep_lines(name: str, curve: TimeCurve) -> Iterator[str]:
    """The depth of a test over time under a force that is held."""
    held = float(curve.force[-1])
    end = int(np.argmax(curve.force >= held * (1 - 1e-9)))
    ramp, last = float(curve.time[end]), float(curve.time[-1])
    there, deepest = (quantity(float(curve.displacement[n]), "mm") for n in (end, -1))
    crept = f", {deepest} after a hold of {last - ramp:.4g} s" if last > ramp else ""
    yield f"creep     {name}: {there} at the end of the ramp of {ramp:.4g} s to {quantity(held, 'mN')}{crept}"
    yield f"          {curve.words()}"
    if curve.ends:
        yield f"note      {name}: {curve.ends}"


def _ends(curve: TimeCurve) -> tuple[float, float, str]:
    """Duration of the ramp (s), the force at its end (mN), and words for the hold."""
    end, turn = np.flatnonzero(curve.displacement >= curve.displacement.max() * (1 - 1e-9))[[0, -1]]  # of the hold
    ramp, last = float(curve.time[end]), float(curve.time[turn])
    held = f", {quantity(float(curve.force[turn]), 'mN')} after a hold of {last - ramp:.4g} s" if last > ramp else ""
    return ramp, float(curve.force[end]), held


def _at_small_depths(error: ForceError, test: TestResult) -> str:
    """The error at other depths, where it is more than twice that of the last force."""
    worst = error.largest_share(test.force)
    return f"and {worst:.0%} of a smaller one " if worst > 2 * error.share(test.force) else ""


def _solver(solver: SolverFacts) -> Iterator[str]:
    loop = "" if solver.assembly == "compiled" else ", assembled by the readable forms"
    yield (
        f"solver    {_count(solver.steps, 'step')} ({_count(solver.cutbacks, 'cutback')}), "
        f"{_count(solver.newton_iterations, 'Newton iteration')}, "
        f"{_count(solver.factorizations, 'factorization')} by {solver.linear}{loop}; "
        f"{solver.wall_seconds + solver.setup_seconds:.1f} s"
    )


def _contact(simulation: Simulation) -> Iterator[str]:
    """How far the contact is from ideal, at the last displacement of each test."""
    for test in simulation.tests:
        facts = test.facts
        edge = f"; edge slip {facts.edge_slip:.2%} of the half-width" if facts.edge_slip else ""
        yield (
            f"contact   {test.name}: penalty error {facts.penalty_error:z.3%} of the force, added back; "
            f"{facts.touching:.0%} of the points touch, {facts.slipping:.0%} slide{edge}"
        )


def _count(number: int, what: str) -> str:
    return f"{number:,} {what}{'' if number == 1 else 's'}"


def fit_lines(result: FitResult, scan_weights: bool = False) -> Iterator[str]:
    """A FitResult in words, line by line; scan_weights: with fits under other weights of the tests."""
    yield from misfit_lines(result)
    yield from _parameter_lines(result)
    yield ""
    yield from first_lines(result)
    yield from closed_lines(result.closed_forms)
    if result.objective is not None:
        scale = misfit_scale(result)
        end, unit, factor = "" if mixed(result) else f" {scale.unit}", scale.unit, scale.factor
        parts = ", ".join(f"{name} {_rmse(result, name, value)}" for name, value in result.rmse.items())
        scaled = ", each as large as the first test's for equal relative errors" if mixed(result) else ""
        size, squares = factor * result.objective, factor**2 * (result.sum_of_squares or 0.0)
        yield f"objective {size:.5g} {unit}, equation (1): weighted sum of the tests' RMSEs ({parts}{end}){scaled}"
        yield f"squares   {squares:.5g} {unit}^2: weighted sum of the squared RMSEs"
    if result.singular_values and result.directions and len(result.free) > 1:
        scale = misfit_scale(result)
        values = " : ".join(f"{scale.factor * (value or 0.0):.3g}" for value in result.singular_values)
        weakest = ", ".join(f"{name} {x:+.2f}" for name, x in zip(result.free, result.directions[-1], strict=True))
        yield f"singular  {values} {scale.unit}; the curves say least about {weakest} (relative)"
    yield from certainty_lines(result)
    yield from law_lines(result)
    yield from posterior_lines(result)
    yield from weights_lines(result) if scan_weights else ()
    yield from _work_lines(result)
    for note in result.notes:
        yield f"note      {note}"


def unit_of(result: FitResult, test: str) -> str:
    """The unit of a test's forces, or stresses."""
    return result.curves[test].shown.up_unit if test in result.curves else "mN"


def misfit_scale(result: FitResult) -> Scale:
    """The unit in which the largest force is told; where kinds differ, all tests are scaled to the first one."""
    unit = next((unit_of(result, test) for test in result.rmse), "mN")
    sizes = [float(np.abs(curve.force).max()) for curve in result.curves.values() if curve.shown.up_unit == unit]
    return Scale.of(sizes or [result.objective or 0.0], unit)


def _rmse(result: FitResult, test: str, value: float) -> str:
    """A test's misfit in the unit of the objective; where the tests have different ones, with its own beside it."""
    if mixed(result):
        return quantity(value, unit_of(result, test))
    return f"{misfit_scale(result).factor * value:.4g}"


def mixed(result: FitResult) -> bool:
    """Whether a test's forces have another unit than mN."""
    return any(unit_of(result, test) != "mN" for test in result.rmse)


def posterior_lines(result: FitResult) -> Iterator[str]:
    """What samples of the posterior say, line by line."""
    known = result.posterior
    if known is None:
        return
    spans = ", ".join(f"{name} {low:.4g} to {high:.4g}" for name, (low, high) in known.intervals.items())
    yield f"posterior {spans} (shortest 95 % intervals)"
    wider = ", ".join(f"{name} {ratio:.2f}" for name, ratio in known.wider.items())
    yield f"posterior width of the intervals above over those of the posterior: {wider}; {known.draws:,} draws are kept"
    if not known.long_enough:
        yield "posterior the chains are short beside the correlation of their steps: take these intervals for rough"


def law_lines(result: FitResult) -> Iterator[str]:
    """What a fit says of the law's own misfit, line by line."""
    for sentence in law_sentences(result):
        yield from _folded("law", sentence)


def law_sentences(result: FitResult) -> Iterator[str]:
    """What a fit says of the law's own misfit, where that is a term of it."""
    known = result.law_misfit
    if known is None:
        return
    size = f"{known.scale:.2g} ({_span(known.interval)})" if known.interval else f"{known.scale:g}, as stated,"
    yield f"the law's misfit has the standard deviation {size} of the force at the largest depth"
    for name, band in known.tests.items():
        unit = unit_of(result, name)
        worst = int(np.argmax(np.abs(band.misfit)))
        most = f"{band.misfit[worst]:+.3g} ({band.misfit_low[worst]:+.3g} to {band.misfit_high[worst]:+.3g}) {unit}"
        end = f"{band.force_low[-1]:.4g} to {band.force_high[-1]:.4g} {unit}"
        where = f"{plainly(band.displacement[worst])} {result.curves[name].shown.across_unit if name in result.curves else 'mm'}"
        yield f"{name}: the law misses the force by {most} at {where.strip()}; the force at the end is {end} (95 %)"


def misfit_lines(result: FitResult) -> Iterator[str]:
    """How far the fitted curves of a FitResult stay from the measured ones, line by line."""
    if result.misfit:
        yield f"misfit    {said_of_misfit(result)}"


def said_of_misfit(result: FitResult) -> str:
    """The misfit of each test in words: the RMSE over the largest force, and R2."""
    parts = [
        f"{name} {known.relative:.2%} of its largest {_what(result, name)}"
        f"{f' (R2 {_r2(known.r2)})' if known.r2 is not None else ''}"
        for name, known in result.misfit.items()
    ]
    return ", ".join(parts)


def _what(result: FitResult, test: str) -> str:
    """What a test measures."""
    moves = test in result.curves and result.curves[test].shown == MOTION
    return "displacement" if moves else "force"


def _r2(value: float) -> str:
    """R2 with as many nines as it has, and one more digit."""
    if value < 0.9 or value >= 1:
        return f"{value:.3g}"
    return f"{value:.{min(int(-np.log10(1 - value)) + 2, 6)}f}"


def _parameter_lines(result: FitResult) -> Iterator[str]:
    """A row for each parameter; noise: its standard error by the residuals; total: with the mesh and uncertain inputs."""
    rows = [["parameter", "value", "noise", "total", "95 % interval", "", "verdict"]]
    for name, known in (*result.parameters.items(), *result.moduli.items()):
        unit = "" if known.unit in ("", "1") else known.unit
        if known.fixed:
            rows.append([name, f"{known.value:.6g}", "", "", "", unit, "fixed"])
            continue
        nothing = "" if name in result.moduli else "unknown"
        errors = [nothing if error is None else f"{error:.2g}" for error in (known.stderr, known.total)]
        errors = ["", ""] if known.at_bound else errors  # no error of a value that is the bound's
        rows.append([name, value_words(known, 6), *errors, pieces_words(known), unit, known.verdict or ""])
    widths = [max(len(row[n]) for row in rows) for n in range(len(rows[0]))]
    for row in rows:
        yield "  ".join(f"{cell:<{width}}" for cell, width in zip(row, widths, strict=True)).rstrip()


def closed_lines(forms: Mapping[str, ClosedForm]) -> Iterator[str]:
    """The moduli of each test by closed forms, to be compared with those of the simulation or the fit."""
    for name, form in forms.items():
        yield from _folded("closed", f"{name}: {form.words()}")


def _folded(head: str, words: str) -> Iterator[str]:
    """Words after the head of a line, in lines of COLUMNS columns at most that break at spaces."""
    indent = " " * HEAD
    yield from textwrap.wrap(
        words, COLUMNS, initial_indent=f"{head:<{HEAD}}", subsequent_indent=indent, break_long_words=False, break_on_hyphens=False
    )


def _work_lines(result: FitResult) -> Iterator[str]:
    yield f"search    {result.message}"
    failed = f", {len(result.failures)} of them failed" if result.failures else ""
    reused = f" ({result.reused} of them from the ledger)" if result.reused else ""
    workers = f", {result.solver.workers} workers" if result.solver else ""
    yield f"work      {result.nfev} sets of parameters{failed}, {result.runs} runs{reused}{workers}, {result.seconds:.1f} s"
    if result.mesh and not result.mesh.elements:
        yield f"mesh      {result.mesh.remark}"
    elif result.mesh:
        penalty = result.solver.penalty_error if result.solver else None
        exact = f"; contact springs withhold {penalty:.2%} of the force, added back" if penalty is not None else ""
        yield f"mesh      {result.mesh.elements:,} elements, {result.mesh.dofs:,} degrees of freedom{exact}"
        if result.mesh.remark:
            yield from _folded("note", result.mesh.remark)


def certainty_lines(result: FitResult) -> Iterator[str]:
    """What a FitResult says about its own certainty, line by line, after its table of parameters."""
    doubted = {doubt.text for doubt in doubts_of(result)}  # these sentences came first
    for sentence in result.conclusions:
        if sentence not in doubted:
            yield f"summary   {sentence}"
    for name, test in result.tests_alone.items():
        parts = ", ".join(f"{key} {_span(alone.interval)}" for key, alone in test.parameters.items())
        size = test.rmse if test.confirmed_rmse is None else test.confirmed_rmse
        yield f"alone     {name}: {parts}; RMSE {quantity(size, unit_of(result, name), 3)}"
    for name, known in result.predicted.items():
        yield f"predicted {name} from the other tests: measured {known.off:+.0%} at the end, p = {known.p:.2g}"
    yield from _shares(result)
    for tried in result.uncertain.alternatives:
        values = ", ".join(f"{key} {tried.parameters[key]:.3g} ({_span(tried.intervals[key])})" for key in result.free)
        yield f"either    {tried.name}, probability {tried.probability:.2g}: {values}"
    yield from _known_lines(result)
    scale = misfit_scale(result)
    for other in result.rivals:
        values = ", ".join(f"{key} = {value:.4g}" for key, value in other.parameters.items())
        yield f"rival     {values}: objective {scale.factor * other.objective:.5g} {scale.unit}"
    if result.surrogate:
        yield f"surrogate {_of_surrogate(result.surrogate, scale)}"


def _known_lines(result: FitResult) -> Iterator[str]:
    """The inputs that the case gives as exact, with the parameters at other values of them."""
    if result.taken_as_known:
        yield f"known     taken as known: {', '.join(f'{known.input} {known.taken}' for known in result.taken_as_known)}"
    for known in result.taken_as_known:
        if known.parameters is not None:
            values = ", ".join(f"{name} {value:.3g}" for name, value in known.parameters.items())
            yield f"what if   {known.input} were {known.other}: {values}"


def weights_lines(result: FitResult) -> Iterator[str]:
    """Fits of a FitResult's two tests under other weights, line by line."""
    if not result.weights_scan:
        yield "weights   no scan: it takes two tests, and a surrogate of all that the search went over (`ga`)"
        return
    tests = list(result.weights_scan[0].rmse)
    scales = {name: Scale.of((fitted.rmse[name] for fitted in result.weights_scan), unit_of(result, name)) for name in tests}
    rows = [("weights of the tests", [*result.free, *(f"RMSE {name}, {scale.unit}" for name, scale in scales.items())])]
    for fitted in result.weights_scan:
        cells = [
            *(f"{fitted.parameters[name]:.4g}" for name in result.free),
            *(f"{scale.factor * fitted.rmse[name]:.3g}" for name, scale in scales.items()),
        ]
        rows.append((" : ".join(f"{weight:g}" for weight in fitted.weights), cells))
    yield from _columns("weights", rows)


def share_rows(uncertain: UncertainInputs, free: Sequence[str]) -> Iterator[tuple[str, list[str]]]:
    """What makes the errors of a fit's parameters: (in words, share of each free parameter's variance, in percent); none where
    only the noise is known. uncertain: as in `FitResult`."""
    if not uncertain.inputs:
        return
    if uncertain.noise:
        yield "noise (residuals)", _percents(uncertain.noise, free)
    for name, share in uncertain.inputs.items():
        yield _of_input(name, share), _percents(share, free)


def effect_of_base(uncertain: UncertainInputs) -> str | None:
    """The sentence that says what the parameters would be on the other base, or None."""
    base = uncertain.inputs.get("base")
    if base is None:
        return None
    changes = ", ".join(f"{key} {change:+.3g}" for key, change in base.effect.items())
    return f"on a {OTHER[str(base.value)]} base instead of a {base.value} base the parameters would change by: {changes}"


OTHER = {"sliding": "bonded", "bonded": "sliding"}


def _of_input(name: str, share: InputShare) -> str:
    if name == "mesh":
        return f"mesh (forces +- {share.sd:.2%}, from a mesh of about {share.elements} elements)"
    if name == DISCREPANCY and share.fitted is None:
        return f"misfit of the law (stated: +- {share.prior})"
    if name == "force":
        return f"force (+- {share.sd:.2%} of each test's)"
    if share.interval is not None and share.fitted is not None:
        unit = "" if share.unit in (None, "1") else f" {share.unit}"
        named = "misfit of the law" if name == DISCREPANCY else name
        return f"{named} (prior {share.prior}; fitted {plainly(share.fitted)}, {_span(share.interval)}{unit})"
    if name == "base":
        return f"base ({share.probability:.0%} that it is {OTHER[str(share.value)]})"
    if share.prior is not None:
        return f"{name} ({share.prior}, each fitted)"
    assert share.sd is not None  # inputs without a distribution of their own have a standard deviation
    if share.unit == "mm":
        scale = Scale.of([float(share.value), share.sd], "mm")
        return f"{name} ({scale.text_with_error(float(share.value), share.sd)} {scale.unit})"
    return f"{name} ({share.value:g} +- {share.sd:.3g})"


def _percents(share: InputShare | NoiseShare, free: Sequence[str]) -> list[str]:
    return [_percent(share.share[name]) for name in free]


def _percent(share: float | None) -> str:
    if share is None:
        return "unknown"
    return "< 0.1%" if 0 < share < 0.0005 else f"{share:.1%}"


def _shares(result: FitResult) -> Iterator[str]:
    rows = list(share_rows(result.uncertain, result.free))
    if rows:
        yield from _columns("errors", [("share of the variance of", result.free), *rows])
    if effect := effect_of_base(result.uncertain):
        yield f"base      {effect}"


def _columns(label: str, rows: Sequence[tuple[str, Sequence[str]]]) -> Iterator[str]:
    """Rows of (words, cells) as lines under a label."""
    first = max(len(words) for words, _ in rows)
    widths = [max(len(cells[n]) for _, cells in rows) for n in range(len(rows[0][1]))]
    for number, (words, cells) in enumerate(rows):
        shown = "  ".join(f"{cell:>{width}}" for cell, width in zip(cells, widths, strict=True))
        yield f"{'' if number else label:<9} {words:<{first}}  {shown}".rstrip()


def _of_surrogate(surrogate: SurrogateFacts, scale: Scale) -> str:
    last = [proof for proof in surrogate.held_out if proof.error is not None][-1:]
    right = "".join(
        f"; off by {scale.factor * (proof.error or 0.0):.2g} {scale.unit} at a run not seen before (allowed "
        f"{scale.factor * (proof.allowed or 0.0):.2g})"
        for proof in last
    )
    failed = f", {surrogate.failed} failed" if surrogate.failed else ""
    return f"degree {surrogate.degree} on {surrogate.runs} sets of parameters{failed}{right}"


def _span(interval: Interval) -> str:
    return f"{plainly(interval[0])} to {plainly(interval[1])}"
