"""`indentfit validate`: every input error at once, before any solve, or else what the case says."""

import json

import click

from indentfit.cli.command import Command
from indentfit.cli.completion import keys
from indentfit.errors import CaseError


@click.command(cls=Command, short_help="Show every error of a case, or what it says.")
@click.argument("case", type=click.Path(), default="case.toml")
@click.option("--set", "overrides", multiple=True, metavar="KEY=VALUE", shell_complete=keys, help="Replace a key of the case.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def command(case: str, overrides: tuple[str, ...], as_json: bool) -> None:
    """Check the case file CASE and the curves it names.

    The command prints the case in words. A case with faults ends with 2: the command prints each fault on a line.
    """
    # imported when the command runs: --help and completion are quick without
    from indentfit.experiment.measured import read_case
    from indentfit.report.case_text import case_facts, case_lines

    try:
        read = read_case(case, overrides)
    except CaseError as error:
        if as_json:
            click.echo(json.dumps({"case": case, "valid": False, "faults": error.faults}, indent=2))
        raise
    if as_json:
        click.echo(json.dumps({"case": case, "valid": True, **case_facts(read)}, indent=2))
        return
    click.echo("\n".join(case_lines(read)))
    for warning in read.warnings():
        click.echo(f"warning: {warning}", err=True)
