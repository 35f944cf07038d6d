"""The result folder of the fits of a set of samples, with a folder of each sample."""

from pathlib import Path

from indentfit.errors import OutputError
from indentfit.inference.per_sample import PerSample
from indentfit.report.fit_folder import fill_fit
from indentfit.report.folder import result_folder, write_json
from indentfit.report.html import write_report
from indentfit.report.per_sample import write_samples_table


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
                fill_fit(folder / summary.folder, fitted.result, fields=False)
        fill_samples(folder, result)


def fill_samples(folder: Path, result: PerSample) -> None:
    """Write the table, the JSON file and the page of all samples into a folder that exists."""
    write_json(folder / "per_sample.json", result.as_json())
    write_samples_table(folder / "per_sample.csv", result)
    write_report(folder)
