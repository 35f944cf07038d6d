"""report.html of a result folder: the case, the results with their certainty, and the command that repeats them.

The page is made from the folder alone, so that it can be drawn again later and elsewhere.
"""

import os
from dataclasses import replace
from pathlib import Path
from pkgutil import resolve_name

import jinja2

from indentfit.errors import OutputError
from indentfit.report.page import Page, render
from indentfit.report.schema import DAMAGE, Stored, read_result

PAGES = {  # the function that makes the page of a result, by the result's class; only that of the result is imported
    "FitResult": "html_fit:fit_page",
    "Sweep": "html_studies:sweep_page",
    "MeshCheck": "html_studies:mesh_check_page",
    "Design": "html_design:design_page",
    "Comparison": "html_comparison:comparison_page",
    "Population": "html_population:population_page",
    "PerSample": "html_samples:per_sample_page",
    "StoredProcess": "html_process:process_page",
    "StoredSimulation": "html_simulation:simulation_page",
}


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
    made: Page = resolve_name(f"indentfit.report.{PAGES[type(stored.result).__name__]}")(stored, stored.result)
    return made
