"""The result of `process`: records with curves, contact points, stiffnesses and relaxation, and their statistics."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

from indentfit.case import Record
from indentfit.curve import Curve
from indentfit.experiment.file_case import FileCase
from indentfit.experiment.mean_case import MeanCase
from indentfit.experiment.outcomes import Outcome, usable
from indentfit.experiment.processed import ProcessedRecord
from indentfit.experiment.replicates import MeanCurve, Statistics


@dataclass(frozen=True, eq=False, repr=False)
class ProcessResult:
    """Processed records and their statistics.

    Attributes
    ----------
    outcomes : tuple of Outcome
        The outcome of each record in the order given: processed, or with its problem.
    settings : Record
        The [record] table.
    statistics : Statistics
        Statistics of the stiffness per direction; empty where no direction is known.
    means : dict
        Direction -> mean curve.
    """

    outcomes: tuple[Outcome, ...]
    settings: Record
    statistics: Statistics
    means: Mapping[int, MeanCurve]

    @functools.cached_property
    def records(self) -> dict[str, ProcessedRecord]:
        """Name -> the record with its contact point, stiffness and relaxation, of every record that could be used."""
        return {outcome.name: outcome.processed for outcome in usable(self.outcomes)}

    @functools.cached_property
    def curves(self) -> dict[str, Curve]:
        """Name -> loading curve, of every record that could be used."""
        return {name: record.curve for name, record in self.records.items()}

    @property
    def problems(self) -> dict[str, str]:
        """Name -> why the record could not be used, one line."""
        return {outcome.name: outcome.problem for outcome in self.outcomes if outcome.problem is not None}

    @property
    def notes(self) -> tuple[str, ...]:
        """Unusual properties of records, each with the name of the record."""
        return tuple(f"{name}: {note}" for name, record in self.records.items() for note in record.notes)

    def as_json(self) -> dict[str, Any]:
        """The content of summary.json in the result folder."""
        from indentfit.report.records import process_facts

        return process_facts(self)

    def summary(self) -> str:
        """The result in words, as the command prints it."""
        from indentfit.report.records import process_lines

        return "\n".join(process_lines(self))

    def plot(self, name: str | None = None) -> Any:
        """The matplotlib Figure of the record with this name; without a name, of the replicates, or of the first record."""
        from indentfit.report.record_figures import process_figure

        return process_figure(self, name)

    def write(
        self, folder: str | Path, figures: bool | None = None, overwrite: bool = False, case: MeanCase | FileCase | None = None
    ) -> None:
        """Write the result folder.

        Parameters
        ----------
        folder : path
            The new folder.
        figures : bool or None
            Draw the page, and a figure of each record; None draws those of no more than 12, with the poorest ratings.
        overwrite : bool
            Replace an earlier result folder.
        case : MeanCase or FileCase
            Write a case of the mean curves, or of the records alone, too.

        Raises
        ------
        OutputError
            The folder exists already, or cannot be written.
        """
        from indentfit.report.record_folder import write_process

        write_process(self, folder, figures, overwrite, case)

    def __repr__(self) -> str:
        spreads = self.statistics.stiffness.items()
        stiffness = "".join(f"; {direction}°: {spread.mean:.4g} mN/mm, n = {spread.n}" for direction, spread in spreads)
        return f"ProcessResult({len(self.records)} of {len(self.outcomes)} records{stiffness})"

    def _repr_html_(self) -> str:
        return f"<pre>{escape(self.summary())}</pre>"
