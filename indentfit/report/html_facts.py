"""Common parts of the pages of fits and of simulations: facts about mesh, solver and work, and the stress pictures."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from indentfit.report.html_case import number, percent
from indentfit.report.page import Figures, Part, Section, Table, Text, image
from indentfit.runs.closed_form import ClosedForm

STRESSES = (
    "Cauchy stresses at the last displacement, averaged at the nodes; at a sharp edge they grow without limit as the mesh is "
    "refined."
)
CLOSED = ("Test", "Layer: E (kPa)", "Layer: mu (kPa)", "Half-space: E (kPa)", "Half-space: mu (kPa)", "Half-space by", "To (mm)")
PEAKS = (
    "Component", "Largest (kPa)", "Smallest (kPa)", "Largest magnitude (kPa)", "Exceeded at 1 % of nodes (kPa)",
    "Place, undeformed x, y, z (mm)",
)  # fmt: skip
SHARES = ("penalty_error", "edge_slip", "residual_error")
FACTS = {
    "elements": "Elements of the mesh",
    "dofs": "Degrees of freedom",
    "element": "Element (q2p1: quadratic, linear pressure; q1p0: mean dilatation)",
    "smallest_mm": "Size of the smallest element (mm)",
    "linear": "Linear solver",
    "assembly": "Assembly",
    "workers": "Worker processes",
    "run_seconds": "Time of all runs (s)",
    "loose_steps": "Loose steps (accepted at a residual above the tolerance)",
    "penalty_error": "Penalty error of the contact, share of the force, added back",
    "residual_error": "Largest residual, share of the force, added back where its effect is known",
    "edge_slip": "Slip across the sharp edge, share of the half-width",
    "nfev": "Sets of parameters",
    "runs": "Solves of one test",
    "seconds": "Time (s)",
    "method": "Method of the search",
    "seed": "Seed",
    "newton_iterations": "Newton iterations",
    "wall_seconds": "Time of the runs (s)",
    "setup_seconds": "Time of the set-up (s)",
}


def facts_table(caption: str, facts: Mapping[str, Any]) -> Table:
    """A row for each fact (name -> number or word)."""
    rows = tuple(
        (FACTS.get(name, name.replace("_", " ").capitalize()), percent(value) if name in SHARES else number(value, 5))
        for name, value in facts.items()
        if value not in (None, "")
    )
    return Table(caption, ("What", "Value"), rows)


def stress_sections(folder: Path) -> list[Section]:
    """The section of the stress pictures in a result folder's fields/, if there are any."""
    index = folder / "fields" / "pictures.json"
    if not index.is_file():
        return []
    listed = json.loads(index.read_text(encoding="utf-8"))
    figures = tuple(
        image(folder / "fields" / picture["file"], picture["caption"], picture["alt"])
        for picture in listed["pictures"]
        if _is_beside(folder / "fields", picture["file"])
    )
    parts: list[Part] = [Figures(figures), Text(STRESSES)]
    for peaks in listed["peaks"]:
        rows = tuple(map(_peak_row, peaks["rows"]))
        angle = "" if peaks["angle"] is None else f" ({peaks['angle']}°)"
        parts += [Table(f"Peak stresses, {peaks['test']}{angle}", PEAKS, rows), Text(peaks["words"])]
    return [Section("stresses", "Displacements and stresses", tuple(parts))]


def _is_beside(folder: Path, name: str) -> bool:
    return "/" not in name and "\\" not in name and (folder / name).is_file()


def _peak_row(peak: Mapping[str, Any]) -> tuple[str, ...]:
    numbers = (number(peak[name]) for name in ("largest", "smallest", "magnitude", "usual"))
    return (peak["component"], *numbers, peak["place"])


def closed_table(forms: Mapping[str, ClosedForm]) -> list[Part]:
    """The moduli of each test's curve by closed forms; nothing where no test has one."""
    rows = tuple(
        (
            name,
            *(number(mu) for mu in (form.young(form.layer), form.layer, form.young(form.half_space), form.half_space)),
            form.formula,
            number(form.depth),
        )
        for name, form in forms.items()
    )
    if not rows:
        return []
    first = next(iter(forms.values()))
    words = (
        f"Closed forms assume small strain, no friction and a layer much wider than the contact; here with a {first.base} base and "
        f"Poisson's ratio {number(first.poisson_ratio)}{first.of_time()}."
    )
    return [Table("Moduli of the same curves at small depth by closed forms", CLOSED, rows), Text(words)]
