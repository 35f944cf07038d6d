"""`indentfit init`: a commented case with curves, to be changed into one's own."""

import click

from indentfit.cli.command import Command
from indentfit.cli.speech import say


@click.command(cls=Command, short_help="Write a commented case to start from.")
@click.argument("folder", metavar="DIR", type=click.Path())
def command(folder: str) -> None:
    """Write case.toml and example curves into DIR, which must be new or empty."""
    from indentfit.report.template_folder import write_template  # imported here, because --help shall not wait for NumPy

    click.echo(write_template(folder))
    say("the curves are straight lines, an example only: put yours in their place")
