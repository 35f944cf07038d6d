"""`indentfit schema`: the JSON schema of a case file, by which editors complete and check keys."""

import json

import click

from indentfit.cli.command import Command


@click.command(cls=Command, short_help="Print the JSON schema of a case, for editors.")
def command() -> None:
    """Print the JSON schema of a case file.

    Editors with a TOML language server (such as Even Better TOML for VS Code) complete keys and check values by it, where the first
    line of a case is `#:schema ./case.schema.json`. `indentfit init` writes both.
    """
    from indentfit.case.reference import json_schema  # imported here, because --help shall not wait for NumPy

    click.echo(json.dumps(json_schema(), indent=2))
