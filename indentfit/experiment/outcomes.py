"""The records of a set processed one by one: a record that cannot be used does not stop the others."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from indentfit.case import Record
from indentfit.errors import RecordError
from indentfit.experiment.manifest import Entry
from indentfit.experiment.processed import ProcessedRecord, process_record
from indentfit.experiment.reading import read_record
from indentfit.experiment.record import CUT_OFF, RawRecord

AfterRecord = Callable[[int, str], object]  # called with the number of records that are done, and the sample of the last record


@dataclass(frozen=True, eq=False)
class Outcome:
    """An entry with its processed record, or with the problem that prevents it, one line."""

    entry: Entry
    processed: ProcessedRecord | None = None
    problem: str | None = None

    @property
    def name(self) -> str:
        """Name of the record in tables: sample and direction."""
        return self.entry.name


@dataclass(frozen=True, eq=False)
class Usable:
    """An entry whose record could be processed."""

    entry: Entry
    processed: ProcessedRecord

    @property
    def name(self) -> str:
        """Name of the record in tables: sample and direction."""
        return self.entry.name


def process_all(entries: Iterable[Entry], settings: Record | None = None, progress: AfterRecord | None = None) -> list[Outcome]:
    """The outcome of each entry.

    Parameters
    ----------
    entries : iterable of Entry
    settings : Record
        The [record] table, the same for all entries.
    progress : function
        Called after each record.

    Returns
    -------
    list of Outcome
    """
    outcomes = []
    for n, entry in enumerate(entries):
        outcomes.append(_outcome(entry, settings))
        if progress:
            progress(n + 1, entry.sample)
    return outcomes


def usable(outcomes: Iterable[Outcome], direction: int | None = None) -> list[Usable]:
    """The outcomes with a processed record; only those of a direction where a direction is given."""
    return [
        Usable(outcome.entry, outcome.processed)
        for outcome in outcomes
        if outcome.processed and direction in (None, outcome.entry.group)
    ]


def _outcome(entry: Entry, settings: Record | None) -> Outcome:
    if entry.problem:
        return Outcome(entry, problem=entry.problem)
    try:
        record = _raw_record(entry, settings)
    except RecordError as error:
        return Outcome(entry, problem=str(error))
    try:
        return Outcome(entry, process_record(record, entry.thickness, settings))
    except RecordError as error:
        cut = next((f" ({note})" for note in record.notes if note.startswith(CUT_OFF)), "")
        return Outcome(entry, problem=f"{error}{cut}")


def _raw_record(entry: Entry, settings: Record | None) -> RawRecord:
    if entry.record is not None:
        return entry.record
    if entry.path is None:
        raise RecordError(f"{entry.name}: neither a file nor a record in memory; give one of them")
    return read_record(entry.path, settings)
