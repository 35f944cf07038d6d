"""Reading a case completely: the class of its material, its curves, and its raw records as curves."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from indentfit.case import Case, Openers, Record, override_case, read_case_file
from indentfit.case.laws import open_law
from indentfit.curve import Curve
from indentfit.material import Material


def read_case(path: str | Path, overrides: Sequence[str] = ()) -> Case:
    """The `Case` of a TOML file with its material, curves and raw records, and with `overrides` in place of its keys.

    Parameters
    ----------
    path : path
        The case file; names of other files in it are relative to its folder.
    overrides : sequence of str
        KEY=VALUE, such as "indenter.friction=0.2".

    Returns
    -------
    Case

    Raises
    ------
    CaseError
        The error's text has one line for each fault: file, key, value, what is wrong and what to do.
    """
    return read_case_file(path, overrides, Opened())


def changed_case(case: Case, overrides: Sequence[str]) -> Case:
    """The case with `overrides` in place of its keys.

    Parameters
    ----------
    case : Case
        Read from a file, or made from values.
    overrides : sequence of str
        KEY=VALUE.

    Returns
    -------
    Case

    Raises
    ------
    CaseError
        The error's text has one line for each fault.
    """
    return override_case(case, overrides, Opened())


class Opened(Openers):
    """Opens materials, which may run a file that the case names, and raw records."""

    def law(self, model: str | None, energy: str | None, names: Sequence[str], folder: Path) -> type[Material]:
        return open_law(model, energy, names, folder)

    def curve(self, file: Path, record: Record, timed: bool = False) -> Curve:
        from indentfit.experiment.kept import kept_curve  # few cases have records

        # a case tells the end of its indenter; [record] holds it where it is not flat
        settings = record if record.indenter else record.model_copy(update={"indenter": "flat"})
        return kept_curve(file, settings, lambda: _processed(file, settings, timed), timed)


def _processed(file: Path, record: Record, timed: bool) -> Curve:
    from indentfit.experiment.in_time import curve_in_time
    from indentfit.experiment.processed import process_record  # SciPy's signals take a second to import
    from indentfit.experiment.reading import read_record

    known = process_record(read_record(file, record), settings=record)
    return curve_in_time(known, record) if timed else known.curve
