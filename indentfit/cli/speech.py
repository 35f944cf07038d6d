"""What commands say on stderr beside their result."""

from collections.abc import Iterable

import click


def say(line: str) -> None:
    """A note or a warning, as it is."""
    click.echo(line, err=True)


def warn(warnings: Iterable[str]) -> None:
    """Each warning of a case."""
    for warning in warnings:
        say(f"warning: {warning}")
