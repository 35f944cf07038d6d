"""`indentfit design`: which further test would determine the worst parameter best."""

import json
from pathlib import Path

import click

from indentfit.experiment.measured import read_case

from ..errors import CaseError
from ..report.folder import copy_case, json_text, refuse_existing, result_folder, write_json
from ..report.text_studies import design_lines
from ..study.design import design
from .progress import progress


@click.command(short_help="Say which test to do next.")
@click.argument("case", type=click.Path())
@click.option("--set", "overrides", multiple=True, metavar="KEY=VALUE", help="Replace a key of the case.")
@click.option("--result", type=click.Path(), metavar="DIR", help="Take the parameters of this result folder.")
@click.option("--noise", type=click.FloatRange(min=0, min_open=True), metavar="MN", help="Standard deviation of a force, mN.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@click.option("-o", "--output", type=click.Path(), metavar="DIR", help="Write a result folder with a plot.")
@click.option("--overwrite", is_flag=True, help="Replace an earlier result folder.")
def command(case, overrides, result, noise, as_json, output, overwrite):
    """Rank further tests by how well they, together with those of CASE, would determine its worst parameter.

    Each candidate changes one thing: depth, angle, indenter, friction. The parameters are the case's start values, or those
    of --result. The noise is 1 % of the largest force unless --noise says otherwise.
    """
    if output is None and overwrite:
        raise click.UsageError("--overwrite needs -o DIR")
    read = read_case(case, overrides)
    if not read.free:
        raise CaseError([f"{case}: material.parameters: no parameter is free; give at least one as {{start, min, max}}"])
    parameters = _parameters(read, result) if result else read.start_values()
    if output is not None:
        refuse_existing(output, overwrite)
    for warning in read.warnings():
        click.echo(f"warning: {warning}", err=True)
    with progress("design", total=1) as step:
        found = design(read, parameters, noise, step)
    if output is not None:
        _write(output, overwrite, read, found)
    click.echo(json_text(found.as_json()) if as_json else "\n".join(design_lines(found)))
    if output is not None and not as_json:
        click.echo(f"written   {output}")


def _parameters(case, folder):
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


def _write(path, overwrite, case, found):
    from ..report.plots import designs  # matplotlib is slow to import

    with result_folder(path, overwrite) as folder:
        again = copy_case(case, folder)
        write_json(folder / "design.json", {**found.as_json(), "case_hash": case.hash, "overrides": list(again)})
        designs(found.as_json(), Path(folder) / "design")
