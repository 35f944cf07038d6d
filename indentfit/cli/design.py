"""`indentfit design`: which further test would determine the worst parameter best."""

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

from indentfit.cli.command import Command
from indentfit.cli.progress import progress
from indentfit.cli.speech import warn
from indentfit.errors import CaseError

if TYPE_CHECKING:
    from indentfit.case import Case


@click.command(cls=Command, short_help="Say which test to do next.")
@click.argument("case", type=click.Path())
@click.option("--set", "overrides", multiple=True, metavar="KEY=VALUE", help="Replace a key of the case.")
@click.option("--result", type=click.Path(), metavar="DIR", help="Take the parameters of this result folder.")
@click.option("--noise", type=click.FloatRange(min=0, min_open=True), metavar="MN", help="Standard deviation of a force, mN.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@click.option("-o", "--output", type=click.Path(), metavar="DIR", help="Write a result folder with a plot.")
@click.option("--overwrite", is_flag=True, help="Replace an earlier result folder.")
def command(
    case: str,
    overrides: tuple[str, ...],
    result: str | None,
    noise: float | None,
    as_json: bool,
    output: str | None,
    overwrite: bool,
) -> None:
    """Rank further tests by how well they, together with those of CASE, would determine its worst parameter.

    Each candidate changes one thing: depth, angle, indenter, friction. The parameters are the case's start values, or those
    of --result. The noise is 1 % of the largest force unless --noise says otherwise.
    """
    # imported when the command runs: --help and completion are quick without
    from indentfit.experiment.measured import read_case
    from indentfit.report.folder import json_text, refuse_existing
    from indentfit.study.design import design
    from indentfit.study.runs import Execution

    if output is None and overwrite:
        raise click.UsageError("--overwrite needs -o DIR")
    read = read_case(case, overrides)
    if not read.free:
        raise CaseError([f"{case}: material.parameters: no parameter is free; give at least one as {{start, min, max}}"])
    parameters = _parameters(read, result) if result else read.start_values()
    if output is not None:
        refuse_existing(output, overwrite)
    warn(read.warnings())
    with progress("design", total=1) as step:
        designed = design(read, parameters, noise, Execution(progress=step))
    if output is not None:
        designed.write(output, overwrite)
    click.echo(json_text(designed.as_json()) if as_json else designed.summary())
    if output is not None and not as_json:
        click.echo(f"written   {output}")


def _parameters(case: "Case", folder: str) -> dict[str, float]:
    """The parameters of a result folder, which must be those of the case's material."""
    path = Path(folder) / "result.json"
    try:
        held = json.loads(path.read_text(encoding="utf-8"))["parameters"]
        values = {name: float(held[name]["value"]) for name in case.law.parameters}
    except OSError as error:
        raise CaseError([f"{path}: cannot be read ({error.strerror}); name the folder of a fit"]) from error
    except (ValueError, KeyError, TypeError) as error:
        kind = case.material.model or "this energy"
        raise CaseError([f"{path}: holds no parameters of {kind}; name the folder of a fit of this case"]) from error
    return {
        name: min(max(value, case.free[name].min), case.free[name].max) if name in case.free else value
        for name, value in values.items()
    }
