"""The result folder of `process`."""

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from indentfit.curve import write_curve
from indentfit.errors import OutputError
from indentfit.experiment.file_case import FileCase
from indentfit.experiment.judgement import RATINGS
from indentfit.experiment.mean_case import MeanCase
from indentfit.experiment.process_result import ProcessResult
from indentfit.report.folder import result_folder, stamped, write_json
from indentfit.report.records import curve_files, write_means, write_stiffness

MOST_FIGURES = 12  # of a folder, unless all are wanted: a force map has hundreds of records, and a figure takes half a second


def _ignore(done: int, name: str) -> None:
    pass


@dataclass(frozen=True)
class Listener:
    """Who hears what happens while a folder is written: `warn` gets a line, `drawn` the number of figures and a name."""

    warn: Callable[[str], object] = warnings.warn
    drawn: Callable[[int, str], object] = _ignore


def write_process(
    result: ProcessResult,
    path: str | Path,
    figures: bool | None = None,
    overwrite: bool = False,
    case: MeanCase | FileCase | None = None,
    listener: Listener | None = None,
) -> None:
    """Write the result folder of `process`, whole or not at all: curves, tables, summary.json, figures and page.

    Parameters
    ----------
    result : ProcessResult
    path : path
        The new folder.
    figures : bool or None
        Draw the page, and a figure of each record; None draws those of the MOST_FIGURES records with the poorest ratings.
    overwrite : bool
        Replace an earlier result folder.
    case : MeanCase or FileCase
        Write a case of the mean curves, or of the records alone, too.
    listener : Listener

    Raises
    ------
    OutputError
        The folder exists already or cannot be written, or a case is wanted of records whose direction is not known.
    """
    listener = listener or Listener()
    if isinstance(case, MeanCase) and not result.means:
        raise OutputError(f"{path}: no case can be made, because no record has a direction; give a manifest with directions")
    with result_folder(path, overwrite) as folder:
        _write_tables(folder, result)
        if isinstance(case, FileCase):
            from indentfit.report.file_case import write_file_case

            for presumed in write_file_case(folder, result, case):
                listener.warn(presumed)
        elif case:
            from indentfit.report.record_case import write_case

            for warning in write_case(folder, result, case):
                listener.warn(warning)
        write_json(folder / "summary.json", stamped(result.as_json()))
        if figures is not False:
            from indentfit.report.html import write_report

            _draw(folder, result, drawn_names(result, figures), listener)
            write_report(folder)


def _write_tables(folder: Path, result: ProcessResult) -> None:
    (folder / "curves").mkdir()
    for name, file in curve_files(result).items():
        write_curve(folder / file, result.curves[name])
    write_stiffness(folder / "stiffness.csv", result)
    if result.means:
        write_means(folder / "mean_curves.csv", result.means)


def drawn_names(result: ProcessResult, figures: bool | None) -> list[str]:
    """The names of the records whose figures are drawn: of all records, of none, or of those with the poorest ratings."""
    names = list(result.records) if figures is not False else []
    if figures or len(names) <= MOST_FIGURES:
        return names
    poorest = sorted(names, key=lambda name: -RATINGS.index(result.records[name].judgement.rating))[:MOST_FIGURES]
    return [name for name in names if name in poorest]


def _draw(folder: Path, result: ProcessResult, names: list[str], listener: Listener) -> None:
    """Draw a figure of each record that is named, and one of the replicates."""
    from indentfit.report.plots import save  # imported here, because matplotlib is slow and --no-figures does not need it
    from indentfit.report.record_figures import record_figure, replicate_figure

    (folder / "figures").mkdir()
    files = curve_files(result)
    for n, name in enumerate(names, start=1):
        save(record_figure(name, result.records[name]), folder / "figures" / f"{Path(files[name]).stem}.svg")
        listener.drawn(n, name)
    if result.means:
        save(replicate_figure(result), folder / "figures" / "replicates.svg")
