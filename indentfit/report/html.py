"""report.html of a result folder: what was done to what, what came out, how sure it is, and how to get it again.

Everything is read from the folder itself, so that the page can be drawn again later and elsewhere.
"""

import json
import os
from pathlib import Path

import jinja2

from ..errors import IndentfitError, OutputError
from . import html_fit, html_studies
from .page import Page, render

RESULT_FILES = ("result.json", "simulation.json")
KINDS = {
    "fit": html_fit.fit_page,  # of version 0.1
    "indentfit.fit/2": html_fit.fit_page,
    "indentfit.simulation/1": html_fit.simulation_page,
    "indentfit.sweep/1": html_studies.sweep_page,
    "indentfit.mesh-check/1": html_studies.mesh_check_page,
}
# What values of other kinds than promised make of a page.
DAMAGE = (LookupError, TypeError, ValueError, AttributeError, ArithmeticError, RecursionError, IndentfitError, jinja2.TemplateError)


def write_report(folder):
    """Write report.html into a result folder, whole or not at all; returns its path.

    Raises OutputError where the folder is no result folder, or of a version that this one does not know.
    """
    folder = Path(folder)
    result = _result(folder)
    kind = str(result.get("format", "fit" if "format_version" in result else None))
    if kind not in KINDS:
        raise OutputError(f"{folder}: a result of an unknown format ({kind[:60]!r}); use the indentfit that wrote it")
    try:
        page: Page = KINDS[kind](folder, result)
        text = render(page).encode("utf-8")
    except DAMAGE as error:
        what = " ".join(f"{type(error).__name__}: {error}".split())[:200]
        raise OutputError(f"{folder}: its result file is damaged or not complete ({what}); run the command again") from error
    path, partial = folder / "report.html", folder / ".report.html.partial"
    try:
        partial.write_bytes(text)
        os.replace(partial, path)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror or error}); choose another folder") from error
    return path


def _result(folder):
    for name in RESULT_FILES:
        if (folder / name).is_file():
            try:
                found = json.loads((folder / name).read_text(encoding="utf-8"))
            except (ValueError, OSError, RecursionError) as error:
                raise OutputError(f"{folder / name}: cannot be read ({error}); run the command again") from error
            if isinstance(found, dict):
                return found
    raise OutputError(f"{folder}: not a result folder of indentfit: it has no result.json; name the folder of a result")
