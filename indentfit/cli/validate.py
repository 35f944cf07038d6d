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

    The command prints the case in words, with what keeps `fit` and the studies from using it. A case with faults ends with 2: the
    command prints each fault on a line.
    """
    # imported when the command runs: --help and completion are quick without
    from indentfit.case import asks_for_more, refusals
    from indentfit.experiment.measured import read_case
    from indentfit.report.case_text import case_facts, case_lines

    try:
        read = read_case(case, overrides)
        refused = refusals(read)
        if "fit" not in refused and asks_for_more(read):
            from indentfit.inference.accepted import accepted  # takes seconds to import, and few cases need it

            accepted(read)
    except CaseError as error:
        if as_json:
            click.echo(json.dumps({"case": case, "valid": False, "faults": error.faults}, indent=2))
        raise
    if as_json:
        click.echo(json.dumps({"case": case, "valid": True, **case_facts(read), "refused": refused}, indent=2))
        return
    click.echo("\n".join(case_lines(read)))
    for reason in dict.fromkeys(reason for reasons in refused.values() for reason in reasons):
        click.echo(f"  not for   {', '.join(name for name, reasons in refused.items() if reason in reasons)}: {reason}")
    for warning in read.warnings():
        click.echo(f"warning: {warning}", err=True)
