"""Fits in their folders: one, one of each sample, and one of a population, each with the ledger of its runs (`lasting`)."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from indentfit.case import Case
from indentfit.errors import OutputError
from indentfit.inference.fit import fit
from indentfit.inference.per_sample import PerSample, SampleFit, fit_sample
from indentfit.inference.result import FitResult
from indentfit.report.conduct import Conduct, Place, Say
from indentfit.report.fit_fields import FitFields
from indentfit.report.fit_folder import fill_fit
from indentfit.report.folder import LEDGER, clear, clear_all_but, lasting_folder, ledgers, refuse_existing, unfinished
from indentfit.report.lasting import opened, saying_what_is_kept
from indentfit.runs.ledger import refuse_in_use
from indentfit.runs.start import is_prepared

if TYPE_CHECKING:
    from indentfit.inference.population_fit import Population


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
