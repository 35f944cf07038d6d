"""A command that asks before it runs code of others: the materials that a case names."""

from typing import Any

import click

from indentfit.cli.progress import waiting


class Command(click.Command):
    """A click command that runs with the permission that the group has left in its context: `--no-plugins`, or a note."""

    def invoke(self, ctx: click.Context) -> Any:
        with waiting(ctx.info_name or "indentfit"):
            from indentfit.material import foreign_code  # imported here, because --help shall not wait for NumPy

            with foreign_code(ctx.obj):
                return super().invoke(ctx)
