"""`indentfit report`: the page of a result folder, drawn again."""

import click

from indentfit.cli.command import Command


@click.command(cls=Command, short_help="Draw the report of a result folder again.")
@click.argument("folder", metavar="DIR", type=click.Path())
def command(folder: str) -> None:
    """Write report.html into DIR, the result folder of another command, from the files in that folder."""
    from indentfit.report.html import write_report  # matplotlib is slow to import

    click.echo(write_report(folder))
