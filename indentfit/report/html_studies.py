"""The pages of a sweep and of a mesh-check."""

from collections.abc import Sequence

from indentfit.report.html_case import again_section, case_words, computed, number, percent, signed_percent, tests_table
from indentfit.report.mesh_check import convergence_figure, cost_figure
from indentfit.report.page import Figures, Lines, Page, Part, Picture, Section, Table, Text, drawn
from indentfit.report.schema import Stored
from indentfit.report.study_text import gci_words, refit_scale
from indentfit.report.sweep import grid_figure, key_figure, own_words, ranking_figure, rate_figure, with_unit
from indentfit.study.convergence import Approach
from indentfit.study.mesh_check import MeshCheck, MeshResult, Quantity
from indentfit.study.refit import Refit
from indentfit.study.sweep import Sweep, SweepPoint

ELASTICITY = (
    "Elasticity: relative change of the force by a relative change of the value. Stiffness: slope of the line fitted to a curve."
)
RANKS = ("Key", "Test", "Spread of the force", "Spread of the stiffness", "Elasticity of the force", "Force with rising value")
COSTS = ("Mesh", "Elements", "Degrees of freedom", "h (mm)", "Newton iterations", "CPU time (s)", "Peak memory (MB)")
ERRORS = (
    "Test", "Quantity", "Finest mesh", "At zero size", "95 % interval of it, or wider", "Eca-Hoekstra of the finest mesh",
    "Observed order", "GCI of the finest mesh",
)  # fmt: skip


def sweep_page(stored: Stored, sweep: Sweep) -> Page:
    """Page of a sweep's result folder."""
    failed = [point for point in sweep.every_point if point.tests is None]
    sections = [_what(stored, sweep), _grid(stored, sweep) if sweep.grid else _keys(stored, sweep), _points(sweep)]
    sections += _refits(sweep.refits)
    if failed:
        rows = tuple((point.label, point.cause or "") for point in failed)
        causes = Table("Points that failed, with the cause", ("Point", "Cause"), rows)
        sections.append(Section("failed", "Points that failed", (causes,)))
    varied = "".join(f" --vary {variation.key}={','.join(variation.values)}" for variation in sweep.variations)
    sections.append(again_section(stored, f"sweep{' --grid' if sweep.grid else ''}{varied}"))
    count = len(sweep.points)
    headline = f"{count - len(failed) + (sweep.base in failed)} of {count} points were computed."
    return Page(sweep.title or "Sweep", "Sweep over keys of the case", headline, _lead(sweep), not failed, tuple(sections))


def mesh_check_page(stored: Stored, check: MeshCheck) -> Page:
    """Page of a mesh-check's result folder."""
    sections = [_what(stored, check), _meshes(check), _errors(check), *_changes(stored, check), *_refits(check.refits)]
    asked = " ".join(f"--{'sizes' if 'size' in mesh.asked else 'elements'}" for mesh in check.meshes[:1])
    family = ",".join(mesh.asked.partition("=")[2] for mesh in check.meshes)
    sections.append(again_section(stored, f"mesh-check {asked} {family} --error {100 * check.wanted:g}"))
    good = check.chosen is not None
    headline = "A mesh is exact enough:" if good else "No mesh is certainly exact enough:"
    lead = f"{check.verdict}."
    return Page(check.title or "Mesh check", "Convergence of the mesh", headline, lead, good, tuple(sections))


def _what(stored: Stored, study: Sweep | MeshCheck) -> Section:
    parts: list[Part] = []
    if stored.case:
        parts += [Lines(case_words(stored.case)), tests_table(stored.case, "Tests")]
    units = {name: stored.unit(name) for name in study.parameters}
    rows = tuple((name, number(value, 6), "–" if units[name] == "1" else units[name]) for name, value in study.parameters.items())
    parts.append(Table("Parameters of the material", ("Parameter", "Value", "Unit"), rows))
    return Section("what", "What was computed", tuple(parts))


# ---- sweep -------------------------------------------------------------------------------------------------------


def _lead(sweep: Sweep) -> str:
    ranked = list(dict.fromkeys(sensitivity.key for sensitivity in sweep.sensitivities))
    if len(ranked) < 2:
        return ""
    largest = {key: max(s.force_span for s in sweep.sensitivities if s.key == key) for key in ranked}
    words = " > ".join(f"{key} ({percent(largest[key], 2)})" for key in ranked)
    return f"By the spread of the force over the values tried: {words}."


def _keys(stored: Stored, sweep: Sweep) -> Section:
    parts = _ranking(sweep) if sweep.sensitivities else []
    parts += [Figures(tuple(_key_figures(stored, sweep, varied.key))) for varied in sweep.variations]
    return Section("keys", "What each key does", tuple(parts))


def _ranking(sweep: Sweep) -> list[Part]:
    rows = tuple(
        (s.key, s.test, percent(s.force_span), percent(s.stiffness_span), number(s.elasticity, 3), s.trend)
        for s in sweep.sensitivities
    )
    alt = "Bars: " + "; ".join(f"{s.key}, {s.test}: {percent(s.force_span, 2)}" for s in sweep.sensitivities)
    caption = "Keys by the spread of the force at the last displacement over their values."
    figure = ranking_figure(sweep)
    pictures = (drawn(figure, caption, alt),) if figure else ()
    return [Figures(pictures), Table("Sensitivities, the strongest key first", RANKS, rows), Text(ELASTICITY)]


def _key_figures(stored: Stored, sweep: Sweep, key: str) -> list[Picture]:
    pictures = []
    for name, angle in sweep.tests.items():
        figure = key_figure(sweep, key, {name: angle}, stored.unit)
        if figure is not None:
            own = own_words(sweep, key)
            caption = f"Force against displacement of {name} ({angle}°) at each value of {key}; the case itself has {own}."
            pictures.append(drawn(figure, caption, _alt(sweep, key, name)))
    by_rate = rate_figure(sweep, key)
    if by_rate is not None:
        pictures.append(drawn(by_rate, f"Stiffness against {key}.", _alt_of_rate(sweep, key)))
    return pictures


def _alt_of_rate(sweep: Sweep, key: str) -> str:
    ends = [
        f"{point.values[key]}: {', '.join(f'{name} {number(test.stiffness)} mN/mm' for name, test in point.tests.items())}"
        for point in sweep.points
        if key in point.values and point.tests
    ]
    return f"Stiffness by {key}: {'; '.join(ends)}"


def _alt(sweep: Sweep, key: str, name: str) -> str:
    ends = [
        f"{point.values[key]}: {number(point.tests[name].force)} mN"
        for point in sweep.points
        if key in point.values and point.tests
    ]
    return f"Force curves of {name} by {key}; at the last displacement {'; '.join(ends)}"


def _grid(stored: Stored, sweep: Sweep) -> Section:
    figures = []
    for name, angle in sweep.tests.items():
        figure = grid_figure(sweep, {name: angle}, stored.unit)
        if figure is not None:
            caption = f"Force of {name} ({angle}°) at the last displacement over the grid."
            figures.append(drawn(figure, caption, f"{caption} The numbers are in the table below."))
    return Section("grid", "Over the grid", (Figures(tuple(figures)),))


def _points(sweep: Sweep) -> Section:
    return Section("points", "Every point", tuple(_points_table(sweep, name, angle) for name, angle in sweep.tests.items()))


def _points_table(sweep: Sweep, name: str, angle: float) -> Table:
    measured = any(point.tests and point.tests[name].rmse is not None for point in sweep.every_point)
    header = ["Point", "Force (mN)", "Change of the force", "Stiffness (mN/mm)", "Change of the stiffness"]
    header += ["RMSE (mN)"] if measured else []
    rows = tuple(_point_row(point, name, len(header)) for point in sweep.every_point)
    return Table(f"{name} ({angle}°): force at the last displacement, and stiffness", tuple(header), rows)


def _point_row(point: SweepPoint, name: str, width: int) -> tuple[str, ...]:
    if point.tests is None:
        return (point.label, "failed", *["–"] * (width - 2))
    test = point.tests[name]
    row = [point.label, computed(test.force), signed_percent(test.force_change)]
    row += [computed(test.stiffness), signed_percent(test.stiffness_change), computed(test.rmse)]
    return tuple(row[:width])


# ---- mesh check --------------------------------------------------------------------------------------------------


def _meshes(check: MeshCheck) -> Section:
    names = list(check.tests)
    measured = [name for name in names if any(mesh.rmse and name in mesh.rmse for mesh in check.meshes)]
    caption = "The meshes, from coarse to fine, and their cost; h is the element size (mesh.size)"
    parts: list[Part] = [Table(caption, COSTS, tuple(_cost_row(mesh) for mesh in check.meshes))]
    rows = tuple(row for mesh in check.meshes if (row := _computed_row(mesh, measured)))
    if rows:
        header = ("Mesh", *(f"{name}: force (mN)" for name in names), *(f"{name}: RMSE (mN)" for name in measured))
        parts.append(Table("What is computed on each mesh, at the last displacement", header, rows))
    figure = cost_figure(check)
    if figure is not None:
        done = [mesh.measured for mesh in check.meshes if mesh.measured.forces is not None]
        times = f"{number(done[0].cpu_seconds, 2)} to {number(done[-1].cpu_seconds, 2)} s"
        alt = f"From {done[0].elements} to {done[-1].elements} elements the processor time goes from {times}"
        parts.append(Figures((drawn(figure, "What is computed on each mesh, and the processor time that it takes.", alt),)))
    return Section("meshes", "The meshes and their cost", tuple(parts))


def _asked(mesh: MeshResult) -> str:
    return mesh.asked + (" (second try, not counted)" if mesh.measured.tries > 1 else "")


def _cost_row(mesh: MeshResult) -> tuple[str, ...]:
    facts = mesh.measured
    row = [_asked(mesh), f"{facts.elements:,}", f"{facts.dofs:,}"]
    if facts.forces is None:
        return (*row, *["–"] * (len(COSTS) - 4), f"failed: {facts.cause}")
    row += [computed(facts.h), str(facts.newton_iterations), computed(facts.cpu_seconds, 3)]
    return (*row, computed(facts.memory / 1e6, 3))


def _computed_row(mesh: MeshResult, measured: Sequence[str]) -> tuple[str, ...]:
    if mesh.measured.forces is None:
        return ()
    forces = [computed(float(force[-1])) for force in mesh.measured.forces]
    return (_asked(mesh), *forces, *(computed((mesh.rmse or {})[name]) for name in measured))


def _errors(check: MeshCheck) -> Section:
    table = Table("Last force and stiffness, extrapolated to zero element size", ERRORS, tuple(map(_error_row, check.quantities)))
    figures = tuple(picture for quantity in check.quantities for picture in _convergence(quantity))
    return Section("errors", "Errors of the mesh", (table, Text(f"Method: {check.method}."), Figures(figures)))


def _error_row(quantity: Quantity) -> tuple[str, ...]:
    row = [quantity.test, f"{quantity.kind} ({quantity.unit})", computed(quantity.finest, 5)]
    approach = quantity.approach
    if approach is None:
        return (*row, "–", "–", "–", "–", gci_words(quantity.index))
    low, high = approach.interval
    row += [computed(approach.value, 5), f"{computed(low, 5)} to {computed(high, 5)}", f"± {computed(quantity.finest_uncertainty)}"]
    return (*row, _order(approach), gci_words(quantity.index))


def _order(approach: Approach) -> str:
    if approach.order is not None:
        return number(approach.order, 3)
    return f"{number(approach.raw_order, 2)}, not believed; {' and '.join(number(p) for p in approach.exponents)} taken"


def _convergence(quantity: Quantity) -> list[Picture]:
    figure = convergence_figure([quantity])
    if figure is None:
        return []
    ends = f"{number(float(quantity.values[0]))} to {number(float(quantity.values[-1]))} {quantity.unit}"
    alt = f"{quantity.kind} of {quantity.test} from {ends} as the mesh is refined"
    what = f"{quantity.kind.capitalize()} of {quantity.test} against element size"
    return [drawn(figure, f"{what}, the fitted approach to zero size, and the error band.", alt)]


def _changes(stored: Stored, check: MeshCheck) -> list[Section]:
    if not check.changes:
        return []
    names, rows = list(check.tests), []
    failed = any(change.cause for change in check.changes)
    for change in check.changes:
        cells = [signed_percent(change.changes[name]) for name in names] if change.changes else ["failed"] * len(names)
        cause = [change.cause or "–"] if failed else []
        rows.append((with_unit(change.key, stored.unit), number(change.value), *cells, *cause))
    header = ("Key", "Value", *(f"Change of the force of {name}" for name in names), *(["Cause of a failure"] if failed else []))
    caption = "Changes of the last force against the case as it is, on its own mesh"
    return [Section("changes", "Contact, load steps and edge", (Table(caption, header, tuple(rows)),))]


def _refits(refits: Sequence[Refit]) -> list[Section]:
    if not refits:
        return []
    names = list(dict.fromkeys(name for refit in refits for name in refit.parameters))
    rows, scale = [], refit_scale(refits)
    for refit in refits:
        estimates = [refit.parameters.get(name) for name in names]
        cells = ["held" if known is None else f"{number(known.value)} ± {number(known.stderr, 2)}" for known in estimates]
        rows.append(
            (
                refit.label,
                *cells,
                number(None if refit.objective is None else scale.factor * refit.objective),
                refit.cause or ("yes" if refit.success else "no"),
            )
        )
    header = ("Fitted with", *names, f"Objective ({scale.symbol})", "Converged")
    table = Table("Fitted parameters with their standard errors", header, tuple(rows))
    return [Section("refits", "The parameters fitted anew", (table,))]
