"""`indentfit sweep`: what each key of a case does to its force curves."""

from dataclasses import replace
from pathlib import Path

import click

from indentfit.case import require_fittable
from indentfit.experiment.measured import read_case

from ..errors import ConvergenceError
from ..report.folder import clear, json_text, lasting_folder, refuse_existing
from ..report.text_studies import sweep_lines
from ..study.sweep import plan, refitted, sweep
from . import clusters
from .ledgers import opened, saying_what_is_kept
from .mesh_check import AGAIN, resumed
from .progress import progress
from .stopping import stopping


@click.command(short_help="Vary keys of a case: curves and ranked sensitivities.")
@click.argument("case", type=click.Path())
@click.option(
    "--vary", "asked", multiple=True, required=True, metavar="KEY=VALUES",
    help="0.2,0.3,0.5 (a list), 0.2:0.5:4 (four values evenly spaced) or +-15% (of the case's own); may be repeated.",
)  # fmt: skip
@click.option("--grid", is_flag=True, help="Every combination, instead of one key at a time.")
@click.option("--refit", is_flag=True, help="Fit the free parameters anew at each of them, too: long.")
@click.option("--set", "overrides", multiple=True, metavar="KEY=VALUE", help="Replace a key of the case.")
@click.option("--workers", type=click.IntRange(1, 1024), metavar="N", help="Processes; by default one for each core.")
@click.option("-o", "--output", type=click.Path(), metavar="DIR", help="Result folder; by default CASEFOLDER-sweep.")
@click.option("--overwrite", is_flag=True, help="Replace an earlier result folder; its runs are used again.")
@click.option("--reuse", type=click.Path(), metavar="DIR", help="Use the runs of this result folder too, such as a fit's.")
@clusters.options
@click.option("--json", "as_json", is_flag=True, help="Print result.json.")
def command(case, asked, grid, refit, overrides, workers, output, overwrite, reuse, cluster, scheduler, as_json):
    """Compute the curves of the case file CASE with some of its keys at other values.

    A parameter that the case leaves free has its start value. A point that fails is shown with its cause and the rest
    stands. Every run is kept at once, as those of a fit: a sweep that was stopped or killed goes on where it was when the
    same command is given again. Runs that a fit has made already are taken from CASEFOLDER-result, where that is its folder.
    """
    where = clusters.chosen(cluster, scheduler)
    read = read_case(case, (*overrides, *([f"fit.workers={workers}"] if workers else [])))
    planned = plan(read, asked, grid)
    if refit:
        require_fittable(read)
    name = read.path.resolve().parent.name or "case"
    output = output or f"{name}-sweep"
    earlier = [refuse_existing(output, overwrite), Path(f"{name}-result")]
    for warning in read.warnings():
        click.echo(f"warning: {warning}", err=True)
    with (
        stopping() as stop,
        lasting_folder(output, overwrite) as folder,
        opened(folder, read, False, earlier, reuse, planned.cases) as ledger,
        saying_what_is_kept(ledger, "sweep", AGAIN),
    ):
        clear(folder)
        resumed(ledger)
        how = {"ledger": ledger, "cluster": where, "stop": stop}
        with progress("sweep", total=1) as step:
            result = sweep(planned, **how, progress=lambda done, all_: step(done / all_, f"{done} of {all_} runs"))
        if refit:
            with progress("refit", total=1) as step:
                result = replace(result, refits=refitted(planned, **how, progress=step))
        written = _write(folder, read, result)
    click.echo(json_text(written) if as_json else "\n".join([*sweep_lines(result), f"written   {output}"]))
    if all(point.tests is None for point in (result.base, *result.points)):
        raise ConvergenceError(f"every point of the sweep failed; the first: {result.base.cause}")


def _write(folder, case, result):
    from ..report import sweep as drawing  # matplotlib is slow to import
    from ..report.studies import write_study

    return write_study(folder, case, result, drawing)
