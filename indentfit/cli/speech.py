"""What commands say on stderr beside their result."""

from collections.abc import Iterable

import click


def say(line: str) -> None:
    """Print a note or a warning unchanged."""
    click.echo(line, err=True)


def warn(warnings: Iterable[str]) -> None:
    """Print each warning of a case."""
    for warning in warnings:
        say(f"warning: {warning}")
