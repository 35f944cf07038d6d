"""`indentfit compare`: which of several laws the curves of a case prefer, by how much, or that they cannot tell."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from indentfit.cli import clusters
from indentfit.cli.command import Command
from indentfit.cli.completion import keys, listed_laws
from indentfit.cli.progress import progress
from indentfit.cli.speech import say, warn
from indentfit.cli.stopping import stopping
from indentfit.errors import CaseError

if TYPE_CHECKING:
    from indentfit.case import Range


@click.command(cls=Command, short_help="Which of several laws the curves prefer.")
@click.argument("case", type=click.Path(), default="case.toml")
@click.option(
    "--materials", "asked", required=True, metavar="LAW,LAW,...", shell_complete=listed_laws,
    help="Installed laws (`indentfit materials`), file.py:Class, or typed energies such as 'mu/2*(I1-3)'.",
)  # fmt: skip
@click.option(
    "--range", "given", multiple=True, metavar="LAW:PARAMETER=LOW:HIGH",
    help="Range of a parameter (mm, mN, kPa) in place of the automatic one; may be repeated.",
)  # fmt: skip
@click.option("--layer", metavar="NAME", help="The layer whose laws are compared, where the sample has layers.")
@click.option("--nested", is_flag=True, help="Compute the evidences by nested sampling; needs indentfit[nested] (dynesty).")
@click.option("--set", "overrides", multiple=True, metavar="KEY=VALUE", shell_complete=keys, help="Replace a key of the case.")
@click.option("--workers", type=click.IntRange(1, 1024), metavar="N", help="Number of processes; by default one for each core.")
@click.option("-o", "--output", type=click.Path(), metavar="DIR", help="Result folder; by default CASEFOLDER-comparison.")
@click.option("--overwrite", is_flag=True, help="Replace an earlier result folder; its runs are used again.")
@click.option("--reuse", type=click.Path(), metavar="DIR", help="Use the runs of this result folder too, such as that of a fit.")
@clusters.options
@click.option("--json", "as_json", is_flag=True, help="Print result.json.")
def command(
    case: str,
    asked: str,
    given: tuple[str, ...],
    layer: str | None,
    nested: bool,
    overrides: tuple[str, ...],
    workers: int | None,
    output: str | None,
    overwrite: bool,
    reuse: str | None,
    cluster: str | None,
    scheduler: str | None,
    as_json: bool,
) -> None:
    """Compare laws on the curves of the case file CASE: each law is fitted, and the laws are weighed by their evidence.

    The evidence of a law is the density of the curves under it, integrated over its parameters, each uniform over its range: the
    ranges of the case for the law of the case, otherwise automatic ones that follow the stiffness of the curves. The size and the
    smoothness of the noise are integrated out. The laws also predict what they were not fitted to: the deep third of the curves,
    and each test from the others. The command says which law the curves prefer and by how much, or that they cannot tell: when
    the log evidences of the best two differ by less than 3 (odds of 20 to 1) once the error of the mesh is counted, or when no law
    follows the curves. With --nested the integral is taken by nested sampling on the same surrogate, in up to minutes for
    each law, and the table shows its standard error. Every run is kept at once: a comparison that was stopped goes on when the same
    command is given again.
    """
    # imported when the command runs: --help and completion are quick without
    from indentfit.experiment.measured import read_case
    from indentfit.inverse.dense_curves import averaged
    from indentfit.report.comparison_folder import fill_comparison
    from indentfit.report.conduct import Place
    from indentfit.report.folder import json_text, refuse_existing
    from indentfit.report.lasting import study_in_folder
    from indentfit.runs.start import prepare_for
    from indentfit.study.compare import plan_comparison, run_comparison
    from indentfit.study.law_ranges import laws_asked
    from indentfit.study.runs import Execution

    where = clusters.chosen(cluster, scheduler)
    read = read_case(case, (*overrides, *([f"fit.workers={workers}"] if workers else [])))
    name = Path(case).resolve().parent.name or "case"
    place = Place(output or f"{name}-comparison", overwrite, reuse=reuse)
    refuse_existing(place.output, overwrite)
    plan = plan_comparison(read, laws_asked(asked), _ranges(given), nested, layer)
    prepare_for(read, where, points=True)
    warn([*read.warnings(), *averaged(read).said])
    others = [each for _, each in plan.laws]
    with (
        stopping() as stop,
        study_in_folder(read, others, place, say, [Path(f"{name}-result")], "comparison") as study,
        progress("compare", total=1) as step,
    ):
        result = run_comparison(plan, Execution(ledger=study.ledger, cluster=where, stop=stop, progress=step))
        written = fill_comparison(study.folder, result)
    click.echo(json_text(written) if as_json else f"{result.summary()}\nwritten   {place.output}")


def _ranges(given: tuple[str, ...]) -> "dict[str, dict[str, Range]]":
    """The ranges by law and parameter."""
    from indentfit.case import Range

    ranges: dict[str, dict[str, Range]] = {}
    for text in given:
        key, _, values = text.partition("=")
        law, _, name = key.rpartition(":")
        try:
            low, high = (float(value) for value in values.split(":"))
        except ValueError:
            raise CaseError([f"--range {text!r}: write LAW:PARAMETER=LOW:HIGH, such as ogden:alpha=2:20"]) from None
        if not law or not low < high:
            raise CaseError([f"--range {text!r}: write LAW:PARAMETER=LOW:HIGH with LOW below HIGH, such as ogden:alpha=2:20"])
        ranges.setdefault(law.strip(), {})[name.strip()] = Range(start=(low + high) / 2, min=low, max=high)
    return ranges
