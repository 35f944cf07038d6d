"""Sweeps, mesh-checks and designs as text for a terminal, and as small tables for a notebook."""

from __future__ import annotations

import html
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

from indentfit.digits import Scale, sizes
from indentfit.study.convergence import Approach, Index
from indentfit.study.mesh_check import MeshCheck, MeshResult
from indentfit.study.refit import Refit
from indentfit.study.sweep import Sweep, SweepPoint

if TYPE_CHECKING:  # other studies need none of its inference, half a second of imports
    from indentfit.study.design import Design, FurtherPair
    from indentfit.study.further import FurtherTest

Row = list[str]
LEARNS = (
    "intervals are those that fits of curves with white noise are expected to state at these parameters, in the median; where a "
    "fit takes its residuals for correlated, its interval is two to five times as wide"
)
OPEN = (
    "intervals are those that fits of curves with white noise are expected to state, in the median over what the estimate leaves "
    "open; the span is that of single fits, which also learn their noise"
)
UNSOLVED = (
    "{}: no solution at {} of the values that the estimate leaves open: half widths and spans are those at the others and at the "
    "estimate, and may be wider where there is no solution"
)
SHOWN, SHOWN_PAIRS = 12, 3  # further tests in the table of a design, and pairs below it


# ---- sweep -------------------------------------------------------------------------------------------------------


def sweep_lines(sweep: Sweep) -> Iterator[str]:
    """A Sweep in words, line by line."""
    yield from aligned(sweep_rows(sweep))
    for point in sweep.every_point:
        if point.cause:
            yield f"failed    {point.label}: {point.cause}"
    if sweep.sensitivities:
        yield ""
        yield from aligned(_sensitivity_rows(sweep))
    yield from _equivalent_lines(sweep)
    yield from refit_lines(sweep.refits)


def _equivalent_lines(sweep: Sweep) -> Iterator[str]:
    """The moduli with which an elastic material would be as stiff at each point, where the material relaxes."""
    for point in sweep.every_point:
        known = {name: test.equivalent for name, test in (point.tests or {}).items() if test.equivalent is not None}
        if known:
            words = ", ".join(f"{factor:.4g} ({name})" for name, factor in known.items())
            yield f"equivalent {point.label}: an elastic material with moduli {words} times as large has the same last force"


def sweep_rows(sweep: Sweep) -> list[Row]:
    """A row for each point: force and stiffness of each test with their changes."""
    rows = [["", *(f"{name} ({angle}°)" for name, angle in sweep.tests.items() for _ in range(2))]]
    solved = [point.tests for point in sweep.every_point if point.tests is not None]
    scales = {
        name: (
            Scale.of((tests[name].force for tests in solved), "mN", digits=5),
            Scale.of((tests[name].stiffness for tests in solved), "mN/mm", digits=5),
        )
        for name in sweep.tests
    }
    words = (f"{what}, {scale.unit}" for pair in scales.values() for what, scale in zip(("force", "stiffness"), pair, strict=True))
    rows.append(["point", *words])
    return rows + [[point.label, *_point_cells(point, scales)] for point in sweep.every_point]


def _point_cells(point: SweepPoint, scales: Mapping[str, tuple[Scale, Scale]]) -> Row:
    if point.tests is None:
        return ["failed" for _ in scales for _ in range(2)]
    cells = []
    for name, (force, stiffness) in scales.items():
        test = point.tests[name]
        pairs = ((force.text(test.force), test.force_change), (stiffness.text(test.stiffness), test.stiffness_change))
        cells += [text + ("" if change is None else f" ({change:+.2%})") for text, change in pairs]
    return cells


def _sensitivity_rows(sweep: Sweep) -> list[Row]:
    rows = [["rank", "key", "test", "spread of force", "of stiffness", "elasticity", "force with value"]]
    ranks = {key: n for n, key in enumerate(dict.fromkeys(s.key for s in sweep.sensitivities), start=1)}
    for s in sweep.sensitivities:
        elasticity = "" if s.elasticity is None else f"{s.elasticity:.3f}"
        rows.append([str(ranks[s.key]), s.key, s.test, f"{s.force_span:.2%}", f"{s.stiffness_span:.2%}", elasticity, s.trend])
    return rows


# ---- mesh-check --------------------------------------------------------------------------------------------------


def mesh_check_lines(check: MeshCheck) -> Iterator[str]:
    """A MeshCheck in words, line by line."""
    yield from aligned(mesh_rows(check))
    for mesh in check.meshes:
        if mesh.measured.cause:
            yield f"failed    {mesh.asked}: {mesh.measured.cause}"
        elif not mesh.measured.counts:
            yield f"second try {mesh.asked}: solved with other springs or on a coarser rim, so not counted as one of the family"
    yield ""
    yield from aligned(_quantity_rows(check))
    if check.changes:
        yield ""
        yield from aligned(_change_rows(check))
    yield ""
    yield f"verdict   {check.verdict}"
    yield from refit_lines(check.refits)


def mesh_rows(check: MeshCheck) -> list[Row]:
    """A row for each mesh: its size, its cost, the last force of each test, and the misfits to measured curves."""
    names = list(check.tests)
    measured = [name for name in names if any(mesh.rmse and name in mesh.rmse for mesh in check.meshes)]
    solved = [mesh.measured for mesh in check.meshes if mesh.measured.forces is not None]
    sizes_of = Scale.of((facts.h for facts in solved if facts.h), "mm", digits=3)
    last = [[float(facts.forces[n][-1]) for facts in solved if facts.forces is not None] for n in range(len(names))]
    forces = [Scale.of(values, "mN", digits=5) for values in last]
    errors = {}
    for name in measured:
        known = [mesh.rmse[name] for mesh in check.meshes if mesh.rmse and name in mesh.rmse]
        errors[name] = Scale.of((error for error in known if error is not None), "mN", digits=3)
    head = ["mesh", "elements", "dofs", f"h, {sizes_of.unit}", "Newton", "CPU, s", "MB"]
    head += [f"{name}, {scale.unit}" for name, scale in zip(names, forces, strict=True)]
    head += [f"RMSE {name}, {scale.unit}" for name, scale in errors.items()]
    return [head, *(_mesh_row(mesh, len(head), sizes_of, forces, errors) for mesh in check.meshes)]


def _mesh_row(mesh: MeshResult, width: int, sizes_of: Scale, forces: Sequence[Scale], errors: Mapping[str, Scale]) -> Row:
    facts = mesh.measured
    row = [mesh.asked, f"{facts.elements:,}", f"{facts.dofs:,}"]
    if facts.forces is None:
        return [*row, *[""] * (width - 4), "failed"]
    row += [sizes_of.text(facts.h or 0.0), str(facts.newton_iterations), f"{facts.cpu_seconds:.2f}", f"{facts.memory / 1e6:.0f}"]
    row += [scale.text(float(force[-1])) for scale, force in zip(forces, facts.forces, strict=True)]
    given = [(scale, (mesh.rmse or {}).get(name)) for name, scale in errors.items()]
    return row + ["–" if error is None else scale.text(error) for scale, error in given]


def _quantity_rows(check: MeshCheck) -> list[Row]:
    head = ["test", "quantity", "finest", "at h = 0", "95 % interval, or wider", "Eca-Hoekstra of the finest", "order"]
    rows = [[*head, "GCI of the finest"]]
    for quantity in check.quantities:
        finest, approach = quantity.finest, quantity.approach
        scale = Scale.of(map(float, quantity.values), quantity.unit, digits=5)
        row = [quantity.test, f"{quantity.kind}, {scale.unit}", "" if finest is None else scale.text(finest)]
        if approach is None:
            rows.append([*row, "", "", "", "", gci_words(quantity.index)])
            continue
        low, high = approach.interval
        error = "–" if quantity.finest_uncertainty is None else f"+-{scale.factor * quantity.finest_uncertainty:.3g}"
        row += [scale.text(approach.value), f"{scale.text(low)} to {scale.text(high)}", error]
        rows.append([*row, order_words(approach), gci_words(quantity.index)])
    return rows


def _change_rows(check: MeshCheck) -> list[Row]:
    names = list(check.tests)
    rows = [["key", "value", *(f"change of {name}'s last force" for name in names)]]
    for change in check.changes:
        if change.changes:
            cells = [f"{change.changes[name]:+.3%}" for name in names]
        else:
            cells = [f"failed: {change.cause}", *[""] * (len(names) - 1)]
        rows.append([change.key, f"{change.value:g}", *cells])
    return rows


def order_words(approach: Approach) -> str:
    """The observed order, or the exponents that replace it."""
    if approach.order is not None:
        return f"{approach.order:.2f}"
    taken = " and ".join(f"{p:g}" for p in approach.exponents)
    return f"{approach.raw_order:.2g}, not believed; {taken} taken"


def gci_words(index: Index | None) -> str:
    """Roache's index in words."""
    if index is None:
        return "needs three meshes"
    return f"{index.index:.2%} (order {index.order:.2f})" if index.index is not None else f"none: the three finest are {index.kind}"


# ---- refits ------------------------------------------------------------------------------------------------------


def refit_lines(refits: Sequence[Refit]) -> Iterator[str]:
    """Refits as a table, after an empty line; nothing where there are none."""
    if not refits:
        return
    names = list(dict.fromkeys(name for refit in refits for name in refit.parameters))
    yield ""
    scale = refit_scale(refits)
    head = ["fitted with", *names, f"objective, {scale.unit}"]
    yield from aligned([head, *(_refit_row(refit, names, scale) for refit in refits)])


def refit_scale(refits: Sequence[Refit]) -> Scale:
    """The scale of the objectives of refits."""
    return Scale.of((refit.objective for refit in refits if refit.objective is not None), "mN")


def _refit_row(refit: Refit, names: Sequence[str], scale: Scale) -> Row:
    if refit.cause:
        return [refit.label, f"failed: {refit.cause}", *[""] * len(names)]
    cells = []
    for name in names:
        estimate = refit.parameters.get(name)
        error = f" +- {estimate.stderr:.2g}" if estimate and estimate.stderr else ""
        cells.append("held" if estimate is None else f"{estimate.value:.4g}{error}")
    return [refit.label, *cells, f"{scale.factor * (refit.objective or 0.0):.4g}{'' if refit.success else ' (not converged)'}"]


# ---- design ------------------------------------------------------------------------------------------------------


def design_lines(design: Design) -> Iterator[str]:
    """A Design in words, line by line."""
    values = ", ".join(f"{name} = {value:.4g}" for name, value in design.parameters.items())
    noise = Scale.of([design.noise], "mN", digits=3)
    seen = "" if design.view_noise is None else f", {sizes(design.view_noise)} in a side view"
    yield f"at {values}; noise {noise.text(design.noise)} {noise.unit}{seen}; {design.runs} runs"
    now = design.widths() or {}
    yield f"the tests of the case leave {design.worst} worst: a 95 % interval of about +- {now[design.worst]:.3g}" + _span(
        design, design
    )
    yield ""
    yield from (f"  {line}" for line in aligned(design_rows(design)))
    for test in design.candidates:
        if test.cause:
            yield f"failed    {test.whole_words}: {test.cause}"
    best = next((test for test in design.candidates if test.stderr), None)
    if best and (widths := design.widths(best)):
        yield ""
        gain = now[design.worst] / widths[design.worst]
        with_it = f"its interval becomes {gain:.2g} times narrower, about +- {widths[design.worst]:.2g}{_span(design, best)}"
        yield f"best for {design.worst}: {best.whole_words}: {with_it}"
        yield f"needs     {best.effort}" if best.effort else "needs     one more test"
    for pair in design.pairs[:SHOWN_PAIRS]:
        gain = now[design.worst] / (design.widths(pair) or now)[design.worst]
        yield f"pair      {pair.first}; and {pair.second}: {gain:.2g} times narrower" + (
            f"; needs {pair.effort}" if pair.effort else ""
        )
    shown = design.candidates[:SHOWN], design.pairs[:SHOWN_PAIRS]
    yield from (f"note      {remark}" for remark in design_notes(design, *shown))


def design_notes(design: Design, tests: Sequence[FurtherTest], pairs: Sequence[FurtherPair]) -> tuple[str, ...]:
    """What has to be known beside the numbers of a design that shows so many tests and pairs: the meaning of its intervals, and
    where there was no solution."""
    own = [UNSOLVED.format("the tests of the case", design.unsolved)] if design.unsolved else []
    gone = [UNSOLVED.format(test.whole_words, test.unsolved) for test in tests if test.unsolved > design.unsolved]
    both = [UNSOLVED.format(f"{pair.first}; and {pair.second}", pair.unsolved) for pair in pairs if pair.unsolved > design.unsolved]
    return *design.remarks, *own, *gone, *both, OPEN if design.between else LEARNS


def _span(design: Design, judged: Design | FurtherTest) -> str:
    """The half widths of the worst parameter that single fits state, in words; nothing where the design is not at an estimate."""
    if not judged.between:
        return ""
    low, high = judged.between[design.worst]
    return f" ({low:.2g} to {high:.2g} in 90 % of fits)"


def design_rows(design: Design) -> list[Row]:
    """A row for each of the best further tests: its change, angle, depth, half widths of the 95 % intervals with it, the
    finite-element solutions that it adds to each step of a fit, and what it needs."""
    rows = [["further test", "angle", "depth mm", *(f"{name} +-" for name in design.stderr), "solves", "needs"]]
    for test in design.candidates[:SHOWN]:
        if widths := design.widths(test):
            where = ["", ""] if test.angle is None else [str(test.angle), f"{test.depth:.3g}"]
            solves = "" if test.solves is None else str(test.solves)
            rows.append([test.words, *where, *(f"{widths[name]:.3g}" for name in design.stderr), solves, test.effort])
    return rows


# ---- tables ------------------------------------------------------------------------------------------------------


def aligned(rows: Sequence[Row]) -> Iterator[str]:
    """Lines of a table of words."""
    widths = [max(len(row[n]) for row in rows) for n in range(len(rows[0]))]
    for row in rows:
        yield "  ".join(f"{cell:<{width}}" for cell, width in zip(row, widths, strict=True)).rstrip()


def html_table(caption: str, rows: Sequence[Row]) -> str:
    """A small HTML table, for notebooks; its first row is the header."""
    head = "".join(f"<th>{html.escape(cell)}</th>" for cell in rows[0])
    body = "".join(f"<tr>{''.join(f'<td>{html.escape(cell)}</td>' for cell in row)}</tr>" for row in rows[1:])
    return f"<table><caption>{html.escape(caption)}</caption><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
