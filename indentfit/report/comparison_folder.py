"""The result folder of a comparison of laws."""

import csv
from pathlib import Path
from typing import Any

from indentfit.errors import OutputError
from indentfit.report.comparison import comparison_figure
from indentfit.report.folder import copy_case, result_folder, write_json
from indentfit.report.html import write_report
from indentfit.report.schema import case_json
from indentfit.study.compare import Comparison


def write_comparison(result: Comparison, path: str | Path, overwrite: bool = False) -> None:
    """Write the result folder of a comparison, whole or not at all. Raises OutputError."""
    with result_folder(path, overwrite) as folder:
        fill_comparison(folder, result)


def fill_comparison(folder: Path, result: Comparison) -> dict[str, Any]:
    """Write the files of a comparison into a folder that exists; returns what its result.json holds."""
    if result.case is None:
        raise OutputError(f"{folder}: this result was read from a file, without its case; copy its folder instead")
    again = copy_case(result.case, folder)
    written = {**result.as_json(), "overrides": list(again), "case": case_json(result.case)}
    write_json(folder / "result.json", written)
    _write_curves(folder / "curves.csv", result)
    comparison_figure(result, folder / "laws")
    write_report(folder)
    return written


def _write_curves(path: Path, result: Comparison) -> None:
    """The measured curves with those of each law as CSV."""
    laws = [law for law in result.laws if law.curves]
    with open(path, "w", encoding="utf-8", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(["test", "displacement_mm", "measured_force_mN", *(f"{law.law}_mN" for law in laws)])
        for name, curve in result.measured.items():
            columns = [curve.displacement.tolist(), curve.force.tolist(), *(law.curves[name].force.tolist() for law in laws)]
            table.writerows([name, *row] for row in zip(*columns, strict=True))
