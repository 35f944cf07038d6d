"""`indentfit mesh-check`: how exact the mesh of a case is, and which mesh would be exact enough."""

from dataclasses import replace

import click

from indentfit.case import require_fittable
from indentfit.experiment.measured import read_case

from ..errors import CaseError, ConvergenceError
from ..report.folder import clear, json_text, lasting_folder, refuse_existing
from ..report.text_studies import mesh_check_lines
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
    click.echo(json_text(written) if as_json else "\n".join([*mesh_check_lines(result), f"written   {output}"]))
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
