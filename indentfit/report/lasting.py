"""The folder of a long command: the command opens and locks its ledger there and takes over runs of earlier results; the folder
gets its name once the result is whole. A stopped or killed command leaves its runs, and names the option that continues it."""

import contextlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from indentfit.case import Case
from indentfit.errors import LedgerError, OutputError, Stopped, WorkerError
from indentfit.inference.fit import fit
from indentfit.inference.per_sample import PerSample, SampleFit, fit_sample
from indentfit.inference.result import FitResult
from indentfit.report.conduct import Conduct, Place, Say
from indentfit.report.fit_fields import FitFields
from indentfit.report.fit_folder import fill_fit
from indentfit.report.folder import LEDGER, clear, clear_all_but, lasting_folder, ledgers, refuse_existing, unfinished
from indentfit.runs.ledger import Ledger, refuse_in_use
from indentfit.runs.start import is_prepared

if TYPE_CHECKING:
    from indentfit.inference.population_fit import Population


@dataclass(frozen=True)
class Study:
    """The folder that a study fills, and the ledger of its runs."""

    folder: Path
    ledger: Ledger


def refuse_unfinished(place: Place, samples: bool) -> None:
    """Refuse to begin where an earlier fit has not ended.

    Parameters
    ----------
    place : Place
    samples : bool
        Whether this is a fit of samples, which only such a fit can resume.

    Raises
    ------
    OutputError
        An earlier fit was stopped, and is neither resumed nor replaced; or it is of another kind.
    LedgerError
        The earlier fit is still at work.
    """
    rest = unfinished(place.output)
    left = ledgers(rest)
    for ledger in left:
        refuse_in_use(ledger)
    if not left or place.overwrite:
        return
    if not place.resume:
        remedy = "add --resume to go on with it, or --overwrite to start anew"
        raise OutputError(f"{place.output}: an unfinished fit lies in {rest}; {remedy}")
    if samples != (rest / LEDGER not in left):
        kind, remedy = ("one case", "leave out --per-sample") if samples else ("samples", "add --per-sample")
        raise OutputError(f"{place.output}: the unfinished fit in {rest} is of {kind}; {remedy}, or choose another folder")


def fit_in_folder(case: Case, place: Place, conduct: Conduct, fields: bool) -> tuple[FitResult, dict[str, Any]]:
    """Fit a case, and write its result folder.

    Parameters
    ----------
    fields : bool
        With the stresses at the optimum, by one more run.

    Returns
    -------
    FitResult, and what its result.json holds

    Raises
    ------
    OutputError, LedgerError, WorkerError, Stopped
    """
    target = refuse_existing(place.output, place.overwrite)
    with (
        lasting_folder(place.output, place.overwrite) as folder,
        opened(folder, case, place.resume, [target], place.reuse, say=conduct.say) as ledger,
    ):
        clear(folder)
        with FitFields(folder / "fields", apart=is_prepared()) as stresses, saying_what_is_kept(ledger):
            result = fit(case, conduct.progress, ledger, conduct.cluster, conduct.stop, stresses.begin if fields else None)
            conduct.progress(1.0, "stresses at the optimum, pictures and report" if fields else "report")
            return result, fill_fit(folder, result, stresses if fields else None, _warning(conduct.say))


def fit_samples_in_folder(named: Mapping[str, tuple[str, Case]], place: Place, conduct: Conduct) -> PerSample:
    """Fit each sample of a set, with a folder and a ledger for each, and write the result folder of all.

    Parameters
    ----------
    named : name of the sample's folder -> (name of the sample, its Case)

    Raises
    ------
    OutputError, LedgerError, WorkerError, Stopped
    """
    target = refuse_existing(place.output, place.overwrite)
    with lasting_folder(place.output, place.overwrite) as folder:
        fits = _fit_samples(folder, target, named, place, conduct)
        from indentfit.report.samples_folder import fill_samples  # a fit of one sample needs none of it

        result = PerSample.of(fits, list(named))
        fill_samples(folder, result)
    return result


def fit_population_in_folder(
    named: Mapping[str, tuple[str, Case]], place: Place, conduct: Conduct, groups: Mapping[str, str]
) -> "Population":
    """Fit each sample of a set as `fit_samples_in_folder` does, and write the result folder of the population.

    Parameters
    ----------
    groups : sample -> group; empty for one group

    Raises
    ------
    OutputError, LedgerError, WorkerError, Stopped
    """
    from indentfit.inference.population_fit import population  # a fit of one sample needs none of it
    from indentfit.report.samples_folder import fill_population

    target = refuse_existing(place.output, place.overwrite)
    with lasting_folder(place.output, place.overwrite) as folder:
        fits = _fit_samples(folder, target, named, place, conduct)
        seed = next(iter(named.values()))[1].fit.seed
        result = population(fits, PerSample.of(fits, list(named)), groups, seed)
        fill_population(folder, result)
    return result


def _fit_samples(
    folder: Path, target: Path, named: Mapping[str, tuple[str, Case]], place: Place, conduct: Conduct
) -> list[SampleFit]:
    clear_all_but(folder, list(named))
    return [
        _fit_sample(folder / name, target / name, sample, case, place, _part(conduct, n, len(named), sample))
        for n, (name, (sample, case)) in enumerate(named.items())
    ]


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


def _part(conduct: Conduct, n: int, number: int, sample: str) -> Conduct:
    """The conduct of one of several fits: its progress is a part of all."""

    def progress(share: float, note: str = "") -> None:
        conduct.progress((n + share) / number, f"{sample} {note}")

    return Conduct(progress, conduct.stop, conduct.say, conduct.cluster)


def _fit_sample(folder: Path, earlier: Path, sample: str, case: Case, place: Place, conduct: Conduct) -> SampleFit:
    """The fit of one sample, written into its own folder; a fit that was finished before a stop is taken over."""
    folder.mkdir(exist_ok=True)
    reuse = place.reuse
    if reuse and (Path(reuse) / folder.name).is_dir():
        reuse = str(Path(reuse) / folder.name)
    resume = place.resume and (folder / LEDGER).exists()
    with opened(folder, case, resume, [earlier], reuse, say=conduct.say) as ledger:
        clear(folder)
        with saying_what_is_kept(ledger):
            fitted = fit_sample(sample, case, conduct.progress, ledger, conduct.cluster, conduct.stop)
    if fitted.result:
        fill_fit(folder, fitted.result, None, _warning(conduct.say))
    return fitted


def _warning(say: Say) -> Say:
    return lambda text: say(f"warning: {text}")


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
