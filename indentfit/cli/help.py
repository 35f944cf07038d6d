"""`indentfit help`: the help of a command, as `indentfit COMMAND --help` prints it."""

import click

from indentfit.cli.command import Command
from indentfit.errors import InputError, suggestion


@click.command(cls=Command, short_help="Show the help of a command.")
@click.argument("name", required=False, metavar="[COMMAND]")
@click.pass_context
def command(context: click.Context, name: str | None) -> None:
    """Show the help of COMMAND, or of indentfit as a whole."""
    group = context.parent
    assert group is not None and isinstance(group.command, click.Group)  # the command is one of a group
    if name is None:
        click.echo(group.get_help())
        return
    known = group.command.get_command(group, name)
    if known is None:
        names = group.command.list_commands(group)
        raise InputError(f"no command {name!r}{suggestion(name, names)}; the commands are: {', '.join(names)}")
    click.echo(known.get_help(click.Context(known, info_name=name, parent=group)))
