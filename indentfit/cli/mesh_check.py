"""`indentfit mesh-check`: how exact the mesh of a case is, and which mesh would be exact enough."""

from pathlib import Path

import click

from indentfit.cli.command import Command
from indentfit.cli.completion import keys
from indentfit.cli.progress import progress
from indentfit.cli.speech import say, warn
from indentfit.errors import CaseError, ConvergenceError


@click.command("mesh-check", cls=Command, short_help="Say how exact a mesh is, and what exactness costs.")
@click.argument("case", type=click.Path(), default="case.toml")
@click.option("--sizes", metavar="LIST", help="Element sizes, mm, such as 0.8,0.6,0.5,0.4 (as mesh.size).")
@click.option("--elements", metavar="LIST", help="Numbers of elements, such as 60,100,180,300 (as mesh.elements).")
@click.option("--error", "wanted", default=2.0, show_default=True, metavar="PERCENT", help="Largest error that is wanted.")
@click.option("--mesh-only", is_flag=True, help="Leave contact penalty, load steps and edge radius out.")
@click.option("--refit", is_flag=True, help="Fit the free parameters anew on each mesh, too: this takes long.")
@click.option("--set", "overrides", multiple=True, metavar="KEY=VALUE", shell_complete=keys, help="Replace a key of the case.")
@click.option("-o", "--output", type=click.Path(), metavar="DIR", help="Result folder; by default CASEFOLDER-mesh-check.")
@click.option("--overwrite", is_flag=True, help="Replace an earlier result folder; its runs are used again.")
@click.option("--json", "as_json", is_flag=True, help="Print result.json.")
def command(
    case: str,
    sizes: str | None,
    elements: str | None,
    wanted: float,
    mesh_only: bool,
    refit: bool,
    overrides: tuple[str, ...],
    output: str | None,
    overwrite: bool,
    as_json: bool,
) -> None:
    """Compute the case file CASE on a family of meshes: errors of its forces, and what each mesh costs.

    Without --sizes and --elements, the family has six meshes, from a fifth to three and a half times the case's number of
    elements. A parameter that the case leaves free has its start value. A check that was killed goes on where it stopped when the
    same command is given again.
    """
    # imported when the command runs: --help and completion are quick without
    from indentfit.case import require_fittable
    from indentfit.experiment.measured import read_case
    from indentfit.report.conduct import Place
    from indentfit.report.folder import json_text, refuse_existing
    from indentfit.report.lasting import study_in_folder
    from indentfit.report.study_folder import fill_study
    from indentfit.runs.start import prepare
    from indentfit.study.mesh_check import run_mesh_check
    from indentfit.study.mesh_family import own_checks, own_family, parse_family, plan_mesh_check
    from indentfit.study.runs import Execution

    if not 0 < wanted < 100:
        raise CaseError(f"--error {wanted:g}: must be percents above 0 and below 100")
    read = read_case(case, overrides)
    prepare()  # each mesh is measured by a process of its own, which need not import all libraries again
    family = parse_family("sizes", sizes) if sizes else []
    family += parse_family("elements", elements) if elements else []
    if refit:
        require_fittable(read)
    plan = plan_mesh_check(read, family or own_family(read), {} if mesh_only else own_checks(read))
    place = Place(output or f"{Path(case).resolve().parent.name or 'case'}-mesh-check", overwrite)
    refuse_existing(place.output, overwrite)
    warn(read.warnings())
    with (
        study_in_folder(read, plan.cases, place, say, [], "check") as study,
        progress("mesh-check", total=1) as step,
    ):
        result = run_mesh_check(plan, wanted / 100, refit, Execution(ledger=study.ledger, progress=step))
        written = fill_study(study.folder, result)
    click.echo(json_text(written) if as_json else f"{result.summary()}\nwritten   {place.output}")
    if all(mesh.measured.cause for mesh in result.meshes):
        raise ConvergenceError(f"every mesh failed; the first: {result.meshes[0].measured.cause}")
