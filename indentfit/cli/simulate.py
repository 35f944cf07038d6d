"""`indentfit simulate`: the curves of a case at given parameters, and its stress fields."""

from typing import TYPE_CHECKING

import click

from indentfit.cli.command import Command
from indentfit.cli.completion import keys
from indentfit.cli.progress import progress
from indentfit.cli.speech import warn
from indentfit.cli.stopping import stopping
from indentfit.errors import IndentfitError, Stopped

if TYPE_CHECKING:
    from indentfit.case import Case
    from indentfit.runs.simulated import SimulatedCase


@click.command(cls=Command, short_help="Compute the curves of a case, and its stresses.")
@click.argument("case", type=click.Path(), default="case.toml")
@click.option("--set", "overrides", multiple=True, metavar="KEY=VALUE", shell_complete=keys, help="Replace a key of the case.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@click.option("-o", "--output", type=click.Path(), metavar="DIR", help="Write a result folder.")
@click.option("--overwrite", is_flag=True, help="Replace an earlier result folder.")
@click.option("--vtu", is_flag=True, help="Write the fields at the last displacement, too (needs -o).")
@click.option("--series", is_flag=True, help="Write the fields at every step, as a series for ParaView (needs -o).")
@click.option("--whole", is_flag=True, help="Write the fields of the whole sample, completed from its solved part (needs -o).")
def command(
    case: str,
    overrides: tuple[str, ...],
    as_json: bool,
    output: str | None,
    overwrite: bool,
    vtu: bool,
    series: bool,
    whole: bool,
) -> None:
    """Compute the force-displacement curves of the case file CASE.

    A parameter that the case leaves free has its start value; give another one by --set material.NAME.start=VALUE.
    """
    # imported when the command runs: --help and completion are quick without
    from indentfit.experiment.measured import read_case
    from indentfit.report.folder import json_text, refuse_existing

    needing = {"--vtu": vtu, "--series": series, "--whole": whole, "--overwrite": overwrite}
    if output is None and any(needing.values()):
        raise click.UsageError(f"{next(name for name, given in needing.items() if given)} needs -o DIR")
    read = read_case(case, overrides)
    if output is not None:
        refuse_existing(output, overwrite)
    warn(read.warnings())
    simulated, error = _simulated(read)
    if simulated is not None and output is not None:
        from indentfit.report.fields import FieldChoice
        from indentfit.report.study_folder import write_simulation

        choice = FieldChoice(series=series, whole=whole) if vtu or series or whole else None
        write_simulation(simulated, output, choice, overwrite)
    if simulated is not None:
        click.echo(json_text(simulated.as_json()) if as_json else simulated.summary())
    if simulated is not None and output is not None and not as_json:
        click.echo(f"written   {output}")
    if error is not None:
        raise error


def _simulated(case: "Case") -> "tuple[SimulatedCase | None, IndentfitError | None]":
    """The simulated case, with its progress on stderr; or as far as it goes, where it failed or was stopped, and the error."""
    from indentfit.runs.forward import simulate

    with stopping() as stop, progress("simulate", total=1) as step:

        def report(note: str, share: float) -> None:
            if stop():
                raise Stopped("stopped as asked; the computed part of the curves was kept", stop())
            step(share, note)

        try:
            return simulate(case, progress=report), None
        except IndentfitError as error:
            return error.part, error
