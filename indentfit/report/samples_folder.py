"""The result folder of the fits of a set of samples, with a folder of each sample."""

import csv
from pathlib import Path

from indentfit.errors import OutputError
from indentfit.inference.per_sample import PerSample
from indentfit.inference.population_fit import Population
from indentfit.report.fit_folder import fill_fit
from indentfit.report.folder import result_folder, stamped, write_json
from indentfit.report.html import write_report
from indentfit.report.per_sample import write_samples_table
from indentfit.report.population import population_figure, population_rows, shrunken_rows


def write_samples(result: PerSample, path: str | Path, overwrite: bool = False) -> None:
    """Write the folder of all samples and, in it, the result folder of each fit, whole or not at all.

    Raises
    ------
    OutputError
        The folder exists already or cannot be written, or the result was read from a file.
    """
    if len(result.fits) < len(result.samples):
        raise OutputError(f"{path}: this result was read from a file, without its fits; copy its folder instead")
    with result_folder(path, overwrite) as folder:
        for summary, fitted in zip(result.samples, result.fits, strict=True):
            if fitted.result:
                (folder / summary.folder).mkdir()
                fill_fit(folder / summary.folder, fitted.result, None)
        fill_samples(folder, result)


def fill_samples(folder: Path, result: PerSample) -> None:
    """Write the table, the JSON file and the page of all samples into a folder that exists."""
    write_json(folder / "per_sample.json", stamped(result.as_json()))
    write_samples_table(folder / "per_sample.csv", result)
    write_report(folder)


def fill_population(folder: Path, result: Population) -> None:
    """Write the tables, the JSON file, the figure and the page of a population into a folder that exists."""
    write_json(folder / "result.json", stamped(result.as_json()))
    write_samples_table(folder / "per_sample.csv", result.per_sample)
    if result.hierarchy is not None:
        population_figure(result, folder / "population")
        for name, rows in (("population", population_rows(result)), ("shrunken", shrunken_rows(result))):
            with open(folder / f"{name}.csv", "w", encoding="utf-8", newline="") as file:
                csv.writer(file, lineterminator="\n").writerows(rows)
    write_report(folder)
