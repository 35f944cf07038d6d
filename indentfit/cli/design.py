"""`indentfit design`: which further test would determine the worst parameter best."""

import click

from indentfit.cli.command import Command
from indentfit.cli.completion import keys
from indentfit.cli.progress import progress
from indentfit.cli.speech import warn


@click.command(cls=Command, short_help="Say which test to do next.")
@click.argument("case", type=click.Path(), default="case.toml")
@click.option("--set", "overrides", multiple=True, metavar="KEY=VALUE", shell_complete=keys, help="Replace a key of the case.")
@click.option("--result", type=click.Path(), metavar="DIR", help="Take the parameters of this result folder.")
@click.option("--noise", type=click.FloatRange(min=0, min_open=True), metavar="MN", help="Standard deviation of a force, mN.")
@click.option(
    "--view-noise", type=click.FloatRange(min=0, min_open=True), metavar="MM", help="That of a displacement in a side view."
)
@click.option("--estimated", is_flag=True, help="Count what the parameters leave open, as with --result.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@click.option("-o", "--output", type=click.Path(), metavar="DIR", help="Write a result folder with a plot.")
@click.option("--overwrite", is_flag=True, help="Replace an earlier result folder.")
def command(
    case: str,
    overrides: tuple[str, ...],
    result: str | None,
    noise: float | None,
    view_noise: float | None,
    estimated: bool,
    as_json: bool,
    output: str | None,
    overwrite: bool,
) -> None:
    """Rank further tests by how well they, together with those of CASE, would determine its worst parameter.

    Each candidate changes one thing: depth, angle, indenter, friction; or a camera sees a side of the sample; or it is a test of
    another kind: shear, tension, compression. The parameters are the case's start values, or those of --result, which count as an
    estimate: what its tests leave open is tried, too. The noise is 1 % of the largest force, and 1.5 % of the largest depth in a
    side view, unless --noise and --view-noise say otherwise.
    """
    # imported when the command runs: --help and completion are quick without
    from indentfit.case import require_designable
    from indentfit.experiment.measured import read_case
    from indentfit.report.folder import json_text, refuse_existing
    from indentfit.report.schema import fitted_parameters
    from indentfit.runs.start import prepare_for
    from indentfit.study.design import design
    from indentfit.study.runs import Execution

    if output is None and overwrite:
        raise click.UsageError("--overwrite needs -o DIR")
    read = read_case(case, overrides)
    require_designable(read)
    parameters = fitted_parameters(result, read) if result else None
    if output is not None:
        refuse_existing(output, overwrite)
    prepare_for(read, points=True)
    warn(read.warnings())
    with progress("design", total=1) as step:
        designed = design(
            read, parameters, noise, Execution(progress=step), view_noise, estimated=estimated or parameters is not None
        )
    if output is not None:
        designed.write(output, overwrite)
    click.echo(json_text(designed.as_json()) if as_json else designed.summary())
    if output is not None and not as_json:
        click.echo(f"written   {output}")
