"""Where a command's runs are made: on this machine, or on a Dask cluster."""

from collections.abc import Callable
from typing import Any, TypeVar

import click

Decorated = TypeVar("Decorated", bound=Callable[..., Any])


def options(command: Decorated) -> Decorated:
    """The options --cluster and --scheduler of a command."""
    for option in (
        click.option("--scheduler", metavar="ADDRESS", help="Run on the Dask cluster whose scheduler is at tcp://HOST:PORT."),
        click.option("--cluster", type=click.Choice(["local"]), help="Run on a Dask cluster that is started on this machine."),
    ):
        command = option(command)
    return command


def chosen(cluster: str | None, scheduler: str | None) -> str | None:
    """The word "local", the address of a scheduler, or None. Raises click.UsageError where both are given, or no address is."""
    if cluster and scheduler:
        raise click.UsageError("--cluster starts a cluster, --scheduler uses one: give one of them")
    if scheduler == "":  # an empty text is a variable that a script has not set: it must not pass for the absent option
        raise click.UsageError("--scheduler needs an address, as tcp://HOST:PORT")
    return cluster or scheduler
