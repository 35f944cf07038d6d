"""Sweeps, mesh checks and designs as text for a terminal."""

from collections.abc import Iterable, Iterator, Mapping, Sequence

from indentfit.study.convergence import Approach, Index
from indentfit.study.design import Design, FurtherTest
from indentfit.study.mesh_check import Change, Measured, MeshCheck, Quantity
from indentfit.study.refit import Refit
from indentfit.study.sweep import Point, Sweep

SHOWN = 12  # further tests of a design in its table


def sweep_lines(result: Sweep) -> Iterator[str]:
    """A Sweep in words, line by line: every point, the failures, and the keys by what they do."""
    rows = [["", *(f"{name} ({angle}°)" for name, angle in result.tests.items() for _ in range(2))]]
    rows.append(["point", *(word for _ in result.tests for word in ("force, mN", "stiffness, mN/mm"))])
    points = (result.base, *result.points)
    yield from aligned([*rows, *([point_label(point.values), *_cells(point, result.tests)] for point in points)])
    for point in points:
        if point.cause:
            yield f"failed    {point_label(point.values)}: {point.cause}"
    if result.sensitivities:
        yield ""
        yield from aligned(_sensitivity_rows(result))
    yield from refit_lines(result.refits)


def point_label(values: Mapping[str, str]) -> str:
    """A point of a sweep in words: its keys with their values, or "the case"."""
    return ", ".join(f"{key} = {value}" for key, value in values.items()) or "the case"


def _cells(point: Point, tests: Iterable[str]) -> Iterator[str]:
    """Force and stiffness of each test at a point, with their changes."""
    for name in tests:
        if point.tests is None:
            yield from ("failed", "failed")
            continue
        test = point.tests[name]
        for value, change in ((test.force, test.force_change), (test.stiffness, test.stiffness_change)):
            yield f"{value:.3f}" + ("" if change is None else f" ({change:+.2%})")


def _sensitivity_rows(result: Sweep) -> Iterator[list[str]]:
    yield ["rank", "key", "test", "spread of force", "of stiffness", "elasticity", "force with value"]
    ranks = {key: n for n, key in enumerate(dict.fromkeys(row.key for row in result.sensitivities), start=1)}
    for row in result.sensitivities:
        elasticity = "" if row.elasticity is None else f"{row.elasticity:.3f}"
        spreads = [f"{row.force_span:.2%}", f"{row.stiffness_span:.2%}"]
        yield [str(ranks[row.key]), row.key, row.test, *spreads, elasticity, row.trend]


# ---- mesh check --------------------------------------------------------------------------------------------------


def mesh_check_lines(result: MeshCheck) -> Iterator[str]:
    """A MeshCheck in words, line by line: the meshes, the errors of forces and stiffnesses, the changes, the verdict."""
    names = list(result.tests)
    yield from aligned(_mesh_rows(result, names))
    for asked, mesh in result.meshes:
        if mesh.cause:
            yield f"failed    {asked}: {mesh.cause}"
        elif not mesh.counts:
            yield f"second try {asked}: solved with other springs or on a coarser rim, so not counted as one of the family"
    yield ""
    yield from aligned(_quantity_rows(result.quantities))
    if result.changes:
        yield ""
        yield from aligned(_change_rows(result.changes, names))
    yield ""
    yield f"verdict   {result.verdict}"
    yield from refit_lines(result.refits)


def _mesh_rows(result: MeshCheck, names: Sequence[str]) -> Iterator[list[str]]:
    measured = [name for name in names if any(errors and name in errors for errors in result.rmse)]
    header = ["mesh", "elements", "dofs", "h, mm", "Newton", "CPU, s", "MB", *(f"{name}, mN" for name in names)]
    header += [f"RMSE {name}, mN" for name in measured]
    yield header
    for (asked, mesh), errors in zip(result.meshes, result.rmse, strict=True):
        row = [asked, f"{mesh.elements:,}", f"{mesh.dofs:,}"]
        if mesh.forces is None:
            yield [*row, *["" for _ in header[3:-1]], "failed"]
            continue
        row += [f"{mesh.h:.4f}", *_costs(mesh), *(f"{force[-1]:.3f}" for force in mesh.forces)]
        yield [*row, *(f"{error:.3f}" for error in (errors or {}).values())]


def _costs(mesh: Measured) -> list[str]:
    return [str(mesh.newton_iterations), f"{mesh.cpu_seconds:.2f}", f"{mesh.memory / 1e6:.0f}"]


def _quantity_rows(quantities: Iterable[Quantity]) -> Iterator[list[str]]:
    last = ["95 % interval, or wider", "Eca-Hoekstra of the finest", "order", "GCI of the finest"]
    yield ["test", "quantity", "finest", "at h = 0", *last]
    for quantity in quantities:
        unit = "mN" if quantity.kind == "force" else "mN/mm"
        finest = f"{quantity.values[quantity.h.argmin()]:.3f}" if quantity.h.size else ""
        row = [quantity.test, f"{quantity.kind}, {unit}", finest]
        approach = quantity.approach
        if approach is None:
            yield [*row, "", "", "", "", gci_words(quantity.index)]
            continue
        low, high = approach.interval
        row += [f"{approach.value:.3f}", f"{low:.3f} to {high:.3f}", f"+-{approach.uncertainty[quantity.h.argmin()]:.3f}"]
        yield [*row, order_words(approach), gci_words(quantity.index)]


def order_words(approach: Approach) -> str:
    """The observed order, or the exponents that were taken in its place."""
    if approach.order is not None:
        return f"{approach.order:.2f}"
    taken = " and ".join(f"{p:g}" for p in approach.exponents)
    return f"{approach.raw_order:.2g}, not believed; {taken} taken"


def gci_words(index: Index | None) -> str:
    """Roache's index in words."""
    if index is None:
        return "needs three meshes"
    if index.index is None:
        return f"none: the three finest are {index.kind}"
    return f"{index.index:.2%} (order {index.order:.2f})"


def _change_rows(changes: Iterable[Change], names: Sequence[str]) -> Iterator[list[str]]:
    yield ["key", "value", *(f"change of {name}'s last force" for name in names)]
    for change in changes:
        if change.changes:
            cells = [f"{change.changes[name]:+.3%}" for name in names]
        else:
            cells = [f"failed: {change.cause}", *[""] * (len(names) - 1)]
        yield [change.key, f"{change.value:g}", *cells]


# ---- refits and designs ------------------------------------------------------------------------------------------


def refit_lines(refits: Sequence[Refit]) -> Iterator[str]:
    """Refits as a table, below an empty line; nothing where there are none."""
    if not refits:
        return
    names = list(dict.fromkeys(name for refit in refits for name in refit.parameters))
    rows = [["fitted with", *names, "objective, mN"]]
    for refit in refits:
        if refit.cause:
            rows.append([refit.label, f"failed: {refit.cause}", *[""] * len(names)])
            continue
        end = "" if refit.success else " (not converged)"
        rows.append([refit.label, *(_refitted(refit, name) for name in names), f"{refit.objective:.4g}{end}"])
    yield ""
    yield from aligned(rows)


def _refitted(refit: Refit, name: str) -> str:
    known = refit.parameters.get(name)
    if known is None:
        return "held"
    return f"{known['value']:.4g}" + (f" +- {known['stderr']:.2g}" if known["stderr"] else "")


def design_lines(result: Design) -> Iterator[str]:
    """A Design in words, line by line: the further tests, the best first, and what the best brings."""
    values = ", ".join(f"{name} = {value:.4g}" for name, value in result.parameters.items())
    worst = result.stderr[result.worst]
    yield f"at {values}; noise {result.noise:.3g} mN; {result.runs} runs"
    yield f"the tests of the case leave {result.worst} worst: standard error {worst:.3g}"
    yield ""
    names = list(result.stderr)
    yield "  " + "  ".join([f"{'further test':<20}", "angle", "depth mm", *(f"{'se ' + name:>10}" for name in names)])
    good = [test for test in result.candidates if test.stderr]
    for test in good[:SHOWN]:
        errors = (f"{(test.stderr or {})[name]:>10.3g}" for name in names)
        yield "  " + "  ".join([f"{change_words(test):<20}", f"{test.angle:>5}", f"{test.depth:>8.3g}", *errors])
    for test in result.candidates:
        if test.cause:
            yield f"failed    {test.change}, {test.angle}: {test.cause}"
    for test in good[:1]:
        gain = worst / (test.stderr or {})[result.worst]
        yield ""
        yield (
            f"best for {result.worst}: {change_words(test)}, angle {test.angle}, to {test.depth:.3g} mm: "
            f"its standard error falls {gain:.2g} times"
        )


def change_words(test: FurtherTest) -> str:
    """What a further test changes of the case, in words."""
    return test.change or "as the case is"


def aligned(rows: Iterable[Sequence[str]]) -> Iterator[str]:
    """Lines of a table of words."""
    rows = list(rows)
    widths = [max(len(row[n]) for row in rows) for n in range(len(rows[0]))]
    for row in rows:
        yield "  ".join(f"{cell:<{width}}" for cell, width in zip(row, widths, strict=True)).rstrip()
