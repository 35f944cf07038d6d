"""`indentfit sweep`: what each key of a case does to its force curves."""

from pathlib import Path

import click

from indentfit.cli import clusters
from indentfit.cli.command import Command
from indentfit.cli.completion import keys
from indentfit.cli.progress import progress
from indentfit.cli.speech import say, warn
from indentfit.cli.stopping import stopping
from indentfit.errors import ConvergenceError


@click.command(cls=Command, short_help="Vary keys of a case: curves and ranked sensitivities.")
@click.argument("case", type=click.Path(), default="case.toml")
@click.option(
    "--vary", "asked", multiple=True, required=True, metavar="KEY=VALUES", shell_complete=keys,
    help="0.2,0.3,0.5 (a list), 0.2:0.5:4 (four values evenly spaced) or +-15% (of the case's own); may be repeated.",
)  # fmt: skip
@click.option("--grid", is_flag=True, help="Every combination, instead of one key at a time.")
@click.option("--refit", is_flag=True, help="Fit the free parameters anew at each point, too: this takes long.")
@click.option("--set", "overrides", multiple=True, metavar="KEY=VALUE", shell_complete=keys, help="Replace a key of the case.")
@click.option("--workers", type=click.IntRange(1, 1024), metavar="N", help="Number of processes; by default one for each core.")
@click.option("-o", "--output", type=click.Path(), metavar="DIR", help="Result folder; by default CASEFOLDER-sweep.")
@click.option("--overwrite", is_flag=True, help="Replace an earlier result folder; its runs are used again.")
@click.option("--reuse", type=click.Path(), metavar="DIR", help="Use the runs of this result folder too, such as that of a fit.")
@clusters.options
@click.option("--json", "as_json", is_flag=True, help="Print result.json.")
def command(
    case: str,
    asked: tuple[str, ...],
    grid: bool,
    refit: bool,
    overrides: tuple[str, ...],
    workers: int | None,
    output: str | None,
    overwrite: bool,
    reuse: str | None,
    cluster: str | None,
    scheduler: str | None,
    as_json: bool,
) -> None:
    """Compute the curves of the case file CASE with some of its keys at other values.

    A parameter that the case leaves free has its start value. A point that fails is shown with its cause, and the other points
    stand. Every run is kept at once, as the runs of a fit are: a sweep that was stopped or killed goes on where it was when the
    same command is given again. Runs that a fit has made already are taken from CASEFOLDER-result, if that is the fit's folder.
    """
    # imported when the command runs: --help and completion are quick without
    from indentfit.case import require_fittable
    from indentfit.experiment.measured import read_case
    from indentfit.report.conduct import Place
    from indentfit.report.folder import json_text, refuse_existing
    from indentfit.runs.start import prepare_for
    from indentfit.study.variations import plan_sweep

    where = clusters.chosen(cluster, scheduler)
    read = read_case(case, (*overrides, *([f"fit.workers={workers}"] if workers else [])))
    plan = plan_sweep(read, asked, grid)
    if refit:
        require_fittable(read)
    name = Path(case).resolve().parent.name or "case"
    place = Place(output or f"{name}-sweep", overwrite, reuse=reuse)
    refuse_existing(place.output, overwrite)
    prepare_for(read, where, points=True)  # the server imports what workers need while this process imports what the sweep needs
    from indentfit.report.lasting import study_in_folder
    from indentfit.report.study_folder import fill_study
    from indentfit.study.runs import Execution
    from indentfit.study.sweep import run_sweep

    warn(read.warnings())
    with (
        stopping() as stop,
        study_in_folder(read, plan.cases, place, say, [Path(f"{name}-result")], "sweep") as study,
        progress("sweep", total=1) as step,
    ):
        result = run_sweep(plan, refit, Execution(ledger=study.ledger, cluster=where, stop=stop, progress=step))
        written = fill_study(study.folder, result)
    click.echo(json_text(written) if as_json else f"{result.summary()}\nwritten   {place.output}")
    if all(point.tests is None for point in result.every_point):
        raise ConvergenceError(f"every point of the sweep failed; the first: {result.base.cause}")
