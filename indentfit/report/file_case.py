"""The case of records alone, written beside their curves."""

from pathlib import Path

import tomli_w

from indentfit.curve import write_curve
from indentfit.errors import CaseError
from indentfit.experiment.file_case import FileCase
from indentfit.experiment.in_time import curve_in_time
from indentfit.experiment.measured import read_case
from indentfit.experiment.outcomes import usable
from indentfit.experiment.process_result import ProcessResult
from indentfit.experiment.processed import ProcessedRecord
from indentfit.report.records import curve_files

HEAD = """\
# Made by `indentfit process FILE --case`:
#     indentfit fit case.toml
# Lengths in mm, forces in mN, moduli in kPa. Friction is "unknown" unless it is stated: a fit then goes over 0 to 1.
"""


def write_file_case(folder: Path, result: ProcessResult, case: FileCase) -> list[str]:
    """Write case.toml into a folder that holds the curves of the records.

    Returns
    -------
    list of str
        What the case presumes, one line each.

    Raises
    ------
    RecordError
        Keys that the file cannot know are missing.
    CaseError
        A key that was given is wrong.
    """
    good = usable(result.outcomes)
    files = curve_files(result)
    if case.in_time:
        files = {outcome.name: _in_time(folder, files[outcome.name], outcome.processed, result) for outcome in good}
    tree = case.tree(good, result.settings.radius, files)
    taken = "".join(f"# {outcome.name}: {_taken(outcome.processed.record.taken)}\n" for outcome in good)
    (folder / "case.toml").write_text(f"{HEAD}{taken}\n{tomli_w.dumps(tree)}", encoding="utf-8")
    try:
        read_case(folder / "case.toml")
    except CaseError as error:  # the folder has a temporary name, which nobody knows
        raise CaseError([line.replace(f"{folder / 'case.toml'}: ", "--case: ") for line in error.faults]) from None
    return list(case.presumed(good))


def _in_time(folder: Path, file: str, known: ProcessedRecord, result: ProcessResult) -> str:
    """Write the curve of a record with its times, ramp and hold, beside that of its loading; its file."""
    name = f"{file.removesuffix('.csv')}_in_time.csv"
    write_curve(folder / name, curve_in_time(known, result.settings))
    return name


def _taken(text: str) -> str:
    return " ".join(text.split()) or "a record in memory"
