"""The folder of a long command: the command opens and locks its ledger there and takes over runs of earlier results; the folder
gets its name once the result is whole. A stopped or killed command leaves its runs, and names the option that continues it."""

import contextlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from indentfit.case import Case
from indentfit.errors import LedgerError, Stopped, WorkerError
from indentfit.report.conduct import Place, Say
from indentfit.report.folder import LEDGER, clear, lasting_folder, refuse_existing
from indentfit.runs.ledger import Ledger


@dataclass(frozen=True)
class Study:
    """The folder that a study fills, and the ledger of its runs."""

    folder: Path
    ledger: Ledger


@contextlib.contextmanager
def study_in_folder(
    case: Case, others: Sequence[Case], place: Place, say: Say, earlier: Sequence[Path], what: str
) -> Iterator[Study]:
    """Context that gives the folder and the ledger of a sweep or a mesh-check; the folder gets its name where the block ends well.

    Parameters
    ----------
    case, others : Case
        The case, and further cases whose runs belong to the ledger.
    place : Place
    say : function
        Called with notes and warnings.
    earlier : sequence of paths
        Further result folders whose runs are used where they fit, beside the one that is replaced.
    what : str
        The word for the study in messages, such as "sweep".

    Raises
    ------
    OutputError, LedgerError, WorkerError, Stopped
    """
    replaced = refuse_existing(place.output, place.overwrite)
    with (
        lasting_folder(place.output, place.overwrite) as folder,
        opened(folder, case, False, [replaced, *earlier], place.reuse, others, say) as ledger,
        saying_what_is_kept(ledger, what, "the same command"),
    ):
        clear(folder)
        if ledger.has_own:
            say(f"resumed: {len(ledger)} runs are there from an earlier run")
        yield Study(folder, ledger)


@contextlib.contextmanager
def opened(
    folder: Path,
    case: Case,
    resume: bool,
    earlier: Iterable[Path],
    reuse: str | None,
    others: Sequence[Case] = (),
    say: Say = print,
) -> Iterator[Ledger]:
    """Context that gives the Ledger of a case in a folder.

    Parameters
    ----------
    folder : Path
    case : Case
    resume : bool
        The ledger of an earlier run of the same command must fit.
    earlier : folders of earlier results, whose runs are taken over where there are any
    reuse : a result folder whose runs are to be taken over
    others : further cases whose runs belong to the ledger
    say : called with notes and warnings

    A ledger that nothing came into is taken away again where the block fails.
    """
    path = Path(folder) / LEDGER
    if resume and not path.exists():
        say(f"note: there is no unfinished fit in {folder}; it starts from its beginning")
    with Ledger(path, case, resume and path.exists(), others) as ledger:
        try:
            for result in earlier:
                if (result / LEDGER).is_file():
                    _take_over(ledger, result / LEDGER, False, say)
            if reuse is not None:
                _take_over(ledger, Path(reuse) / LEDGER, True, say)
            for remark in ledger.remarks:
                say(f"warning: {remark}")
            yield ledger
        except BaseException:
            if not ledger.has_own:
                ledger.close()
                path.unlink(missing_ok=True)
            raise


@contextlib.contextmanager
def saying_what_is_kept(ledger: Ledger, what: str = "fit", remedy: str = "--resume") -> Iterator[None]:
    """Context that adds to the error of a stopped command how many runs are kept, and which option continues the command."""
    try:
        yield
    except Stopped as error:
        raise Stopped(f"the {what} was {error}; {_kept(ledger, remedy)}", error.number) from error
    except WorkerError as error:
        raise WorkerError(f"{error}; {_kept(ledger, remedy)}") from error
    except KeyboardInterrupt as error:
        raise Stopped(f"the {what} was stopped at once; {_kept(ledger, remedy)}") from error


def _take_over(ledger: Ledger, source: Path, needed: bool, say: Say) -> None:
    """Take over the runs of another ledger, and say their number.

    A result that is only replaced may have a ledger that cannot be read: the command then goes on without its runs.
    """
    try:
        taken = ledger.take_over(source)
    except LedgerError as error:
        if needed:
            raise
        say(f"warning: {error}")
        return
    none = "; none is of the same mechanics, material, depths and versions" if not taken else ""
    if taken or needed:
        say(f"note: {taken} runs taken over from {source}{none}")


def _kept(ledger: Ledger, remedy: str) -> str:
    return f"{len(ledger)} runs are kept, {remedy} goes on from there" if len(ledger) else "nothing was run yet"
