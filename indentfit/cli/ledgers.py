"""The ledger of a command that takes long: opened with its lock, filled with runs of earlier results, and what is said of it."""

import contextlib
from pathlib import Path

import click

from ..errors import LedgerError, Stopped, WorkerError
from ..report.folder import LEDGER
from ..runs.ledger import Ledger


@contextlib.contextmanager
def opened(folder, case, resume, earlier, reuse, others=()):
    """Context that gives the Ledger of a case, and of others like it, in a folder, with the runs that they can use of `earlier`
    results, where those have any, and of the folder `reuse`; taken away again where nothing came into it."""
    path = Path(folder) / LEDGER
    if resume and not path.exists():
        click.echo(f"note: there is no unfinished fit in {folder}; it starts from its beginning", err=True)
    with Ledger(path, case, resume and path.exists(), others) as ledger:
        try:
            for result in earlier:
                if (result / LEDGER).is_file():
                    _take_over(ledger, result / LEDGER, False)
            if reuse is not None:
                _take_over(ledger, Path(reuse) / LEDGER, True)
            for remark in ledger.remarks:
                click.echo(f"warning: {remark}", err=True)
            yield ledger
        except BaseException:
            if not ledger.has_own:
                ledger.close()
                path.unlink(missing_ok=True)
            raise


@contextlib.contextmanager
def saying_what_is_kept(ledger, what="fit", remedy="--resume"):
    """Context in which what ends a command early says what it leaves, and what goes on from there."""
    try:
        yield
    except Stopped as error:
        raise Stopped(f"the {what} was {error}; {_kept(ledger, remedy)}", error.number) from error
    except WorkerError as error:
        raise WorkerError(f"{error}; {_kept(ledger, remedy)}") from error
    except KeyboardInterrupt as error:
        raise Stopped(f"the {what} was stopped at once; {_kept(ledger, remedy)}") from error


def saying_what_was_done(ledger):
    """Says how many runs an earlier run of the same command has left."""
    if ledger.has_own:
        click.echo(f"resumed: {len(ledger)} runs are there from an earlier run", err=True)


def _take_over(ledger, source, needed):
    """Runs of another ledger; says how many. One that is only replaced does not end the command if it cannot be read."""
    try:
        taken = ledger.take_over(source)
    except LedgerError as error:
        if needed:
            raise
        click.echo(f"warning: {error}", err=True)
        return
    none = "; none is of the same mechanics, material, depths and versions" if not taken else ""
    if taken or needed:
        click.echo(f"note: {taken} runs taken over from {source}{none}", err=True)


def _kept(ledger, remedy):
    return f"{len(ledger)} runs are kept, {remedy} goes on from there" if len(ledger) else "nothing was run yet"
