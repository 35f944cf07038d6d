"""The command line: `indentfit COMMAND`, one module of this package for each command.

A command's module is imported when that command runs, so that `--help` is quick. Whatever goes wrong ends here: an
IndentfitError as its own lines on stderr with its own exit code, a usage error with 2, Ctrl-C with 130, a bug with 1.
"""

import errno
import gc
import importlib
import os
import sys
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from indentfit.cli.command import Command
from indentfit.cli.speech import PLACE, Voice, say
from indentfit.errors import CaseError, IndentfitError, InputError, MaterialError

COMMANDS = {
    "init": "Write a commented case to start from.",
    "validate": "Show every error of a case, or what it says.",
    "process": "Turn raw records into curves and stiffnesses.",
    "simulate": "Compute the curves of a case, and its stresses.",
    "fit": "Find the parameters that its curves ask for.",
    "watch": "Show a running fit as a page on this machine.",
    "compare": "Say which of several laws the curves prefer.",
    "predict": "Predict another test from a fit, with bands.",
    "design": "Say which test to do next.",
    "sweep": "Vary keys of a case: curves and ranked sensitivities.",
    "mesh-check": "Say how exact a mesh is, and what exactness costs.",
    "report": "Draw the report of a result folder again.",
    "materials": "List, describe or check materials.",
    "guide": "Open the guide, or print a page of it.",
    "schema": "Print the JSON schema of a case, for editors.",
    "help": "Show the help of a command.",
}
INTERRUPTED = 130
COLLECTED = 50_000  # new containers before Python looks for garbage: by its usual 700 a command does that a twelfth of its time


class Commands(click.Group):
    """Commands by name, each the click command `command` of the module of that name, imported when it is run."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> Command | None:
        if cmd_name not in COMMANDS:
            return None
        command = importlib.import_module(f"{__name__}.{cmd_name.replace('-', '_')}").command
        assert isinstance(command, Command), f"{cmd_name} would run the code of others without asking"
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))

    def invoke(self, ctx: click.Context) -> Any:
        try:
            return super().invoke(ctx)
        except IndentfitError as error:
            _say(error, ctx.params["debug"])
            ctx.exit(error.exit_code)
        except KeyboardInterrupt:
            click.echo("interrupted", err=True)
            ctx.exit(INTERRUPTED)
        except (click.ClickException, click.exceptions.Exit, click.Abort):
            raise
        except MemoryError:
            click.echo("error: out of memory; a coarser mesh (mesh.elements) and fewer workers need less", err=True)
            ctx.exit(3)
        except OSError as error:
            if error.errno == errno.EPIPE:
                raise  # the reader of the output has gone: click ends quietly
            _say(_of_system(error), ctx.params["debug"])
            ctx.exit(2)
        except ImportError as error:
            what = f"a library cannot be loaded ({' '.join(str(error).split())})"
            _say(InputError(f"{what}; mend the installation, or give it more memory"), ctx.params["debug"])
            ctx.exit(2)
        except Exception as error:
            _report(error, ctx.params["debug"])
            ctx.exit(1)


@click.group(cls=Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.option("--debug", is_flag=True, help="Show the traceback of an error.")
@click.option("--no-plugins", is_flag=True, help="Refuse materials that are not indentfit's own: run no code of others.")
@click.option("-q", "--quiet", is_flag=True, help="Say no notes and no progress; warnings and errors stay.")
@click.option("-v", "--verbose", is_flag=True, help="Say the progress each second.")
@click.option("--log", type=click.Path(), metavar="FILE", help="Append all that is said, with its time, to FILE.")
@click.option("--no-color", is_flag=True, help="Use no colours (the variable NO_COLOR does the same).")
@click.version_option(None, "-V", "--version", package_name="indentfit", message="%(prog)s %(version)s")
@click.pass_context
def main(
    context: click.Context, debug: bool, no_plugins: bool, quiet: bool, verbose: bool, log: str | None, no_color: bool
) -> None:
    """Material parameters of soft tissue from indentation, by inverse finite elements."""
    if quiet and verbose:
        raise click.UsageError("--quiet and --verbose contradict each other: give one of them")
    if no_color:
        os.environ["NO_COLOR"] = "1"  # what rich, and workers, look at
    gc.set_threshold(COLLECTED, *gc.get_threshold()[1:])
    known = Voice(quiet, verbose, Path(log) if log is not None else None)
    known.write(f"indentfit {' '.join(sys.argv[1:])}")
    context.meta[PLACE] = known
    context.obj = _refused if no_plugins else _announced()  # a `Command` asks it before code of others runs


def _refused(code: str) -> None:
    raise MaterialError(f"{code} is not run, because of --no-plugins; leave that out if you trust it, or name another material")


def _announced() -> Callable[[str], None]:
    """A function that names foreign code on stderr before that code is run, each only once."""
    known: set[str] = set()

    def announce(code: str) -> None:
        if code not in known:
            known.add(code)
            say(f"note: the material runs {code}", always=True)

    return announce


def _of_system(error: OSError) -> InputError:
    """The error of the system in words, where no other part of indentfit has put it into words."""
    place = error.filename or "the working folder"
    return InputError(f"{place}: {error.strerror or error}; see that this place exists and has room, then give the command again")


def _say(error: IndentfitError, debug: bool) -> None:
    """The lines of an expected error on stderr."""
    if debug:
        traceback.print_exception(error)
    for line in error.faults if isinstance(error, CaseError) else [str(error)]:
        say(f"error: {' '.join(line.splitlines())}", always=True)


def _report(error: Exception, debug: bool) -> None:
    """One line on stderr for an error that nobody foresaw; its traceback only when asked for."""
    if debug:
        traceback.print_exception(error)
    what = " ".join(f"{type(error).__name__}: {error}".split())
    say(f"error: a bug in indentfit ({what}); please report it, and what `indentfit --debug ...` adds", always=True)
