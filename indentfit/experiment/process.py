"""Raw records to curves, stiffnesses and their statistics, from files or from arrays in memory."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from indentfit.case import Record, read_record_table
from indentfit.errors import RecordError
from indentfit.experiment.folders import record_files
from indentfit.experiment.manifest import Entry, once_each, read_manifest
from indentfit.experiment.outcomes import AfterRecord, Outcome, process_all
from indentfit.experiment.process_result import ProcessResult
from indentfit.experiment.reading import read_records
from indentfit.experiment.record import RawRecord
from indentfit.experiment.replicates import mean_curves, statistics

Source = str | Path | RawRecord | Entry


def process(
    records: Source | Sequence[Source] = (),
    manifest: str | Path | None = None,
    thickness: float | None = None,
    settings: Record | str | Path | None = None,
    progress: AfterRecord | None = None,
) -> ProcessResult:
    """Curves, contact points, stiffnesses and relaxation of raw records, and the statistics of replicates.

    A record that cannot be used does not stop the others: `problems` of the result says why.

    Parameters
    ----------
    records : file, folder, RawRecord, Entry, or a sequence of them
        A folder stands for the files in it. An Entry holds the sample and the direction too, so that its record counts in the
        statistics.
    manifest : path
        In place of records: a CSV with the columns sample, direction, file, thickness, diameter.
    thickness : float, mm
        Thickness of the samples of files and raw records, for strains; an Entry and a manifest have thicknesses of their own.
    settings : Record, or path of a TOML file with a table [record]
        Columns, calibration and sampling rate of the files; methods of the analysis.
    progress : function
        Called after each record with the number of records that are done and the name of the sample.

    Returns
    -------
    ProcessResult

    Raises
    ------
    RecordError
        No record can be used. The error's text has one line for each record.
    CaseError
        The table [record] has faults.

    Examples
    --------
    >>> result = process(RawRecord(time, displacement, force), thickness=3.3)
    >>> result.curves, result.summary()
    """
    settings = settings if isinstance(settings, Record) else read_record_table(settings)
    outcomes = process_all(entries_of(records, manifest, thickness, settings), settings, progress)
    _require_a_usable_record(outcomes)
    return ProcessResult(tuple(outcomes), settings, statistics(outcomes), mean_curves(outcomes, settings.points))


def entries_of(
    records: Source | Sequence[Source], manifest: str | Path | None, thickness: float | None, settings: Record
) -> list[Entry]:
    """The entries of `process`: one for each record of each source, or of a manifest; files of several records are read."""
    given = [records] if isinstance(records, str | Path | RawRecord | Entry) else list(records)
    sources = [file for source in given for file in (record_files([source]) if isinstance(source, str | Path) else [source])]
    if bool(sources) == (manifest is not None):
        raise RecordError("process needs either records or a manifest; give one of them")
    return read_manifest(manifest) if manifest is not None else once_each(_entries(sources, thickness, settings))


def _entries(sources: Sequence[Source], thickness: float | None, settings: Record) -> Iterator[Entry]:
    """An entry for each record of each source.

    Files with the same name are named with their folders; a repeated name gets a number.
    """
    names = [Path(source).name for source in sources if isinstance(source, str | Path)]
    given: Counter[str] = Counter()
    for source in sources:
        if isinstance(source, Entry):
            yield source
            continue
        name = _name(source, names)
        given[name] += 1
        label = name if given[name] == 1 else f"{name} ({given[name]})"
        if isinstance(source, RawRecord):
            yield Entry(label, thickness=thickness, record=source)
        else:
            yield from _of_file(Entry(label, path=Path(source), thickness=thickness), settings)


def _of_file(entry: Entry, settings: Record) -> Iterator[Entry]:
    """An entry for each record of a file, named after its table where the file holds several."""
    try:
        read = read_records(str(entry.path), settings)
    except RecordError as error:
        yield replace(entry, problem=str(error))
        return
    for record in read:
        label = record.name.removeprefix(str(entry.path)).strip() if len(read) > 1 else ""
        yield replace(entry, sample=f"{entry.sample} {label}".strip(), record=record)


def _name(source: str | Path | RawRecord, names: list[str]) -> str:
    """The name of a raw record, or of its file: without suffix, or the whole path where two files share a name."""
    if isinstance(source, RawRecord):
        return source.name or "record"
    path = Path(source)
    return path.stem if names.count(path.name) == 1 else str(source)


def _require_a_usable_record(outcomes: list[Outcome]) -> None:
    problems = [outcome.problem for outcome in outcomes if outcome.problem is not None]
    if len(problems) == len(outcomes):
        raise RecordError("\n".join(" ".join(problem.splitlines()) for problem in problems))
