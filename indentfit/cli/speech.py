"""What commands say on stderr beside their result, and in the file of --log."""

import contextlib
import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import click

PLACE = "indentfit.voice"  # of the Voice in click's context


@dataclass(frozen=True)
class Voice:
    """How much a command says.

    Attributes
    ----------
    quiet : bool
        Notes and progress are left out; warnings and errors never are.
    verbose : bool
        Progress is told each second.
    log : Path or None
        A file that gets every line with its time.
    """

    quiet: bool = False
    verbose: bool = False
    log: Path | None = None

    def write(self, line: str) -> None:
        """Append a line to the log, where there is one."""
        if self.log is not None:
            with self.log.open("a", encoding="utf-8") as file:
                file.write(f"{time.strftime('%Y-%m-%dT%H:%M:%S')} {line}\n")

    def say(self, line: str, always: bool = False) -> None:
        """Print a line and log it; a quiet command only logs it, unless it must always be said. A full disk stops no command."""
        with contextlib.suppress(OSError):
            self.write(line)
        if always or not self.quiet:
            click.echo(line, err=True)


def voice() -> Voice:
    """The Voice of the running command; the usual one outside of a command."""
    context = click.get_current_context(silent=True)
    known = context.meta.get(PLACE) if context is not None else None
    return known if isinstance(known, Voice) else Voice()


def say(line: str, always: bool = False) -> None:
    """Print a line, as `Voice.say` does."""
    voice().say(line, always)


def warn(warnings: Iterable[str]) -> None:
    """Print each warning of a case."""
    for warning in warnings:
        say(f"warning: {warning}", always=True)
