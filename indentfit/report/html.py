"""report.html of a result folder: the case, the results with their certainty, and the command that repeats them.

The page is made from the folder alone, so that it can be drawn again later and elsewhere.
"""

import os
from dataclasses import replace
from pathlib import Path

import jinja2

from indentfit.errors import OutputError
from indentfit.inference.per_sample import PerSample
from indentfit.inference.population_fit import Population
from indentfit.inference.result import FitResult
from indentfit.report.html_comparison import comparison_page
from indentfit.report.html_design import design_page
from indentfit.report.html_fit import fit_page
from indentfit.report.html_population import population_page
from indentfit.report.html_process import process_page
from indentfit.report.html_samples import per_sample_page
from indentfit.report.html_simulation import simulation_page
from indentfit.report.html_studies import mesh_check_page, sweep_page
from indentfit.report.page import Page, render
from indentfit.report.schema import DAMAGE, Stored, read_result
from indentfit.report.stored_process import StoredProcess
from indentfit.study.compare import Comparison
from indentfit.study.design import Design
from indentfit.study.mesh_check import MeshCheck
from indentfit.study.sweep import Sweep


def write_report(folder: str | Path) -> Path:
    """Write report.html into a result folder, whole or not at all.

    Returns
    -------
    Path
        The path of the page.

    Raises
    ------
    OutputError
        The folder is not a result folder, is damaged, or has an unknown version.
    """
    folder = Path(folder)
    try:
        stored = read_result(folder)
        text = render(_dated(_page(stored), stored)).encode("utf-8")
    except OutputError:
        raise
    except (*DAMAGE, jinja2.TemplateError) as error:
        what = " ".join(f"{type(error).__name__}: {error}".split())[:200]
        raise OutputError(f"{folder}: its result file is damaged or not complete ({what}); run the command again") from error
    path, partial = folder / "report.html", folder / ".report.html.partial"
    try:
        partial.write_bytes(text)
        os.replace(partial, path)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror or error}); choose another folder") from error
    return path


def _dated(page: Page, stored: Stored) -> Page:
    """The page with the day of its result, and the version that computed it, beside its kind."""
    version = f"indentfit {stored.versions['indentfit']}" if "indentfit" in stored.versions else ""
    return replace(page, kind=", ".join(word for word in (page.kind, stored.written, version) if word))


def _page(stored: Stored) -> Page:
    result = stored.result
    if isinstance(result, FitResult):
        return fit_page(stored, result)
    if isinstance(result, Sweep):
        return sweep_page(stored, result)
    if isinstance(result, MeshCheck):
        return mesh_check_page(stored, result)
    if isinstance(result, Design):
        return design_page(stored, result)
    if isinstance(result, Comparison):
        return comparison_page(stored, result)
    if isinstance(result, Population):
        return population_page(stored, result)
    if isinstance(result, PerSample):
        return per_sample_page(stored, result)
    return process_page(stored, result) if isinstance(result, StoredProcess) else simulation_page(stored, result)
