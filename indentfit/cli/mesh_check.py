"""`indentfit mesh-check`: how exact the mesh of a case is, and which mesh would be exact enough."""

from dataclasses import replace

import click

from indentfit.case import require_fittable
from indentfit.experiment.measured import read_case

from ..errors import CaseError, ConvergenceError
from ..report.folder import clear, json_text, lasting_folder, refuse_existing
from ..study.mesh_check import mesh_check, own_checks, own_family, parse, plan, refitted
from .ledgers import opened, saying_what_is_kept
from .progress import progress

AGAIN = "the same command"


@click.command("mesh-check", short_help="How exact a mesh is, and what that costs.")
@click.argument("case", type=click.Path())
@click.option("--sizes", metavar="LIST", help="Element sizes, mm, such as 0.8,0.6,0.5,0.4 (as mesh.size).")
@click.option("--elements", metavar="LIST", help="Numbers of elements, such as 60,100,180,300 (as mesh.elements).")
@click.option("--error", "wanted", default=2.0, show_default=True, metavar="PERCENT", help="Largest error that is wanted.")
@click.option("--mesh-only", is_flag=True, help="Leave contact penalty, load steps and edge radius out.")
@click.option("--refit", is_flag=True, help="Fit the free parameters anew at each of them, too: long.")
@click.option("--set", "overrides", multiple=True, metavar="KEY=VALUE", help="Replace a key of the case.")
@click.option("-o", "--output", type=click.Path(), metavar="DIR", help="Result folder; by default CASEFOLDER-mesh-check.")
@click.option("--overwrite", is_flag=True, help="Replace an earlier result folder; its runs are used again.")
@click.option("--json", "as_json", is_flag=True, help="Print result.json.")
def command(case, sizes, elements, wanted, mesh_only, refit, overrides, output, overwrite, as_json):
    """Compute the case file CASE on a family of meshes: errors of its forces and what each mesh costs.

    Without --sizes and --elements, six meshes from a third to twice the case's number of elements. A parameter that the
    case leaves free has its start value. A check that was killed goes on where it stopped when the same command is given
    again.
    """
    if not 0 < wanted < 100:
        raise CaseError(f"--error {wanted:g}: must be percents above 0 and below 100")
    read = read_case(case, overrides)
    family = parse("sizes", sizes) if sizes else []
    family += parse("elements", elements) if elements else []
    if refit:
        require_fittable(read)
    planned = plan(read, family or own_family(read), {} if mesh_only else own_checks(read))
    output = output or f"{read.path.resolve().parent.name or 'case'}-mesh-check"
    target = refuse_existing(output, overwrite)
    for warning in read.warnings():
        click.echo(f"warning: {warning}", err=True)
    with (
        lasting_folder(output, overwrite) as folder,
        opened(folder, read, False, [target], None, planned.cases) as ledger,
        saying_what_is_kept(ledger, "check", AGAIN),
    ):
        clear(folder)
        resumed(ledger)
        with progress("mesh-check", total=1) as step:
            result = mesh_check(planned, ledger, wanted / 100, step)
        if refit:
            with progress("refit", total=1) as step:
                result = replace(result, refits=refitted(planned, ledger, step))
        written = _write(folder, read, result)
    click.echo(json_text(written) if as_json else "\n".join([*_lines(result), f"written   {output}"]))
    if all(one.cause for _, one in result.meshes):
        raise ConvergenceError(f"every mesh failed; the first: {result.meshes[0][1].cause}")


def resumed(ledger):
    """Says how many runs are there already."""
    if ledger.has_own:
        click.echo(f"resumed: {len(ledger)} runs are there from an earlier run", err=True)


def _write(folder, case, result):
    from ..report import mesh_check as drawing  # matplotlib is slow to import
    from ..report.studies import write_study

    return write_study(folder, case, result, drawing)


def _lines(result):
    """The check in words, line by line."""
    names = list(result.tests)
    rows = [["mesh", "elements", "dofs", "h, mm", "Newton", "CPU, s", "MB", *(f"{name}, mN" for name in names)]]
    rows[0] += [f"RMSE {name}, mN" for name in names if any(errors and name in errors for errors in result.rmse)]
    for (asked, one), errors in zip(result.meshes, result.rmse, strict=True):
        row = [asked, f"{one.elements:,}", f"{one.dofs:,}"]
        if one.forces is None:
            rows.append([*row, *["" for _ in rows[0][3:-1]], "failed"])
            continue
        row += [f"{one.h:.4f}", str(one.newton_iterations), f"{one.cpu_seconds:.2f}", f"{one.memory / 1e6:.0f}"]
        rows.append([*row, *(f"{force[-1]:.3f}" for force in one.forces), *(f"{e:.3f}" for e in (errors or {}).values())])
    yield from aligned(rows)
    for asked, one in result.meshes:
        if one.cause:
            yield f"failed    {asked}: {one.cause}"
        elif not one.counts:
            yield f"second try {asked}: solved with other springs or on a coarser rim, so not counted as one of the family"
    yield ""
    yield from _quantity_lines(result)
    if result.changes:
        yield ""
        rows = [["key", "value", *(f"change of {name}'s last force" for name in names)]]
        for one in result.changes:
            cells = (
                [f"{one.changes[name]:+.3%}" for name in names]
                if one.changes
                else [f"failed: {one.cause}"] + [""] * (len(names) - 1)
            )
            rows.append([one.key, f"{one.value:g}", *cells])
        yield from aligned(rows)
    yield ""
    yield f"verdict   {result.verdict}"
    yield from refit_lines(result.refits)


def refit_lines(refits):
    """Refits as a table."""
    if not refits:
        return
    names = list(dict.fromkeys(name for one in refits for name in one.parameters))
    rows = [["fitted with", *names, "objective, mN"]]
    for one in refits:
        if one.cause:
            rows.append([one.label, f"failed: {one.cause}", *[""] * len(names)])
            continue
        values = [one.parameters.get(name) for name in names]
        cells = ["held" if v is None else f"{v['value']:.4g}" + (f" +- {v['stderr']:.2g}" if v["stderr"] else "") for v in values]
        rows.append([one.label, *cells, f"{one.objective:.4g}{'' if one.success else ' (not converged)'}"])
    yield ""
    yield from aligned(rows)


def _quantity_lines(result):
    rows = [
        [
            "test",
            "quantity",
            "finest",
            "at h = 0",
            "95 % interval, or wider",
            "Eca-Hoekstra of the finest",
            "order",
            "GCI of the finest",
        ]
    ]
    for one in result.quantities:
        unit = "mN" if one.kind == "force" else "mN/mm"
        row = [one.test, f"{one.kind}, {unit}", f"{one.values[one.h.argmin()]:.3f}" if one.h.size else ""]
        if one.approach is None:
            rows.append([*row, *["" for _ in range(3)], "", gci_words(one.index)])
            continue
        low, high = one.approach.interval
        row += [f"{one.approach.value:.3f}", f"{low:.3f} to {high:.3f}", f"+-{one.approach.uncertainty[one.h.argmin()]:.3f}"]
        rows.append([*row, order_words(one.approach), gci_words(one.index)])
    yield from aligned(rows)


def order_words(approach):
    """The observed order, or what was taken in its place."""
    if approach.order is not None:
        return f"{approach.order:.2f}"
    taken = " and ".join(f"{p:g}" for p in approach.exponents)
    return f"{approach.raw_order:.2g}, not believed; {taken} taken"


def gci_words(index):
    """Roache's index in words."""
    if index is None:
        return "needs three meshes"
    return f"{index.index:.2%} (order {index.order:.2f})" if index.index is not None else f"none: the three finest are {index.kind}"


def aligned(rows):
    """Lines of a table of words."""
    widths = [max(len(row[n]) for row in rows) for n in range(len(rows[0]))]
    for row in rows:
        yield "  ".join(f"{cell:<{width}}" for cell, width in zip(row, widths, strict=True)).rstrip()
