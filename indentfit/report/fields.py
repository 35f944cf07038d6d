"""The folder fields/ of a result: VTU files of each test, a series of them for ParaView, and pictures for the report."""

import importlib.metadata
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

from indentfit.case import Case
from indentfit.case.laws import has_fibres
from indentfit.errors import ConvergenceError
from indentfit.fem.equilibrium import Equilibrium
from indentfit.fem.fields import Fields, recover
from indentfit.fem.result import TestResult
from indentfit.fem.simulate import Model
from indentfit.fibre_map import FibreMap
from indentfit.fibres import fibre_of
from indentfit.material import Material, laws_of
from indentfit.report.folder import write_json
from indentfit.report.mirror import whole
from indentfit.report.stress_plots import COMPONENTS, Shown, displacement_picture, peak_words, peaks, stress_picture
from indentfit.report.vtu import Origin, file_names, write_vtu
from indentfit.runs.pieces import pieces_of, together
from indentfit.runs.points import case_at

PICTURES = "pictures.json"  # what the report shows
CUT = "seen from outside of its cut face"
VIEWS = {  # what the pictures show of each part of the sample, and whence
    "quarter": ("quarter sample", "seen from outside of both planes of symmetry"),
    "half": ("half sample", CUT),
    "mirror_x": ("half sample", "seen from outside of its plane of symmetry"),
    "mirror_z": ("half sample", "seen from outside of its plane of symmetry"),
    "whole": ("half of the whole sample", CUT),
    "completed": ("whole sample", "completed by the images of the part that was solved"),
}
SEVERAL = "parts of samples"
COLLECTION = """<?xml version="1.0"?>
<VTKFile type="Collection" version="0.1">
  <Collection>
{}  </Collection>
</VTKFile>
"""


@dataclass(frozen=True)
class FieldChoice:
    """The fields of a simulation that are written: at the last depth, as a series of all steps, mirrored to the whole sample."""

    vtu: bool = True
    series: bool = False
    whole: bool = False


@dataclass(frozen=True)
class Solved:
    """Simulated tests with their model, their material and its bulk modulus, kPa, or that of each layer."""

    model: Model
    material: Material
    kappa: float | tuple[float, ...]
    tests: Sequence[TestResult]

    def fields(self, test: TestResult, mirror: bool, equilibrium: Equilibrium | None = None) -> Fields:
        """Fields of a test at one of its equilibria, by default the last; mirror: of the whole sample."""
        fields = recover(self.model, test, self.material, self.kappa, equilibrium)
        return whole(fields) if mirror else fields

    def origin(self, test: TestResult, equilibrium: Equilibrium | None = None) -> Origin:
        """What the fields of a test were computed from, for their file."""
        law, values = type(self.material), self.material.values
        numbers = {
            name + ("" if known.unit in ("", "1") else f"_{known.unit}"): float(values[name])
            for name, known in law.parameters.items()
        }
        kappas = (
            {"kappa_kPa": self.kappa}
            if not isinstance(self.kappa, tuple)
            else {f"{name}.kappa_kPa": kappa for name, kappa in zip(laws_of(law), self.kappa, strict=True)}
        )
        numbers |= {**kappas, "depth_mm": (equilibrium or test.last).depth}
        texts = {"test": test.name, "material": law.__name__, "indentfit": importlib.metadata.version("indentfit")}
        if not has_fibres(law):
            return Origin(numbers, texts)
        numbers |= {"angle_deg": float(test.angle), "dip_deg": float(test.dip)}
        families = () if isinstance(test.families, FibreMap) else test.families or ()
        for name, (angle, dip) in zip(("first", "second"), families, strict=False):
            numbers |= {f"{name}_family_angle_deg": float(angle), f"{name}_family_dip_deg": float(dip)}
        return Origin(numbers, texts, fibre_of(test.angle, test.dip, test.families))

    def shown(self, test: TestResult, fields: Fields, mirror: bool) -> Shown:
        """A test as pictures show it; a whole sample would be hidden by the indenter, which is left out there."""
        model = test.model or self.model
        indenter = None if mirror else model.setup.indenter.geometry
        fibre = fibre_of(test.angle, test.dip, test.families) if has_fibres(type(self.material)) else None
        return Shown(
            test.name, test.angle, fields, indenter, float(test.displacement[-1]), fibre, test.dip, not mirror, test.families
        )


def write_fields(folder: Path, solved: Solved, choice: FieldChoice = FieldChoice()) -> None:
    """Write VTU files and pictures of simulated tests into a new folder.

    A series holds every equilibrium on the way, as NAME.pvd with the indenter's displacement (mm) in place of the time.
    """
    folder.mkdir()
    names = file_names([test.name for test in solved.tests])
    shown = []
    for test, name in zip(solved.tests, names, strict=True):
        fields = solved.fields(test, choice.whole)
        shown.append(solved.shown(test, fields, choice.whole))
        if choice.vtu:
            write_vtu(folder / f"{name}.vtu", fields, solved.origin(test))
        if choice.series:
            write_series(folder, name, solved, test, choice.whole)
    write_pictures(folder, shown, choice.whole)


def write_stresses_at(folder: Path, case: Case, point: dict[str, Any], refined: float | None) -> str | None:
    """Run a case at a point, and write the stresses there into the folder; returns why there are none, in words.

    Parameters
    ----------
    folder : Path
    case : Case
    point : dict of name -> value
        Parameters and changed inputs.
    refined : float or None
        Factor on the fineness of the case's mesh, that of the finest mesh of the fit.
    """
    there, material = case_at(case, point), case.law(**{name: point[name] for name in case.law.parameters})
    pieces = [piece.refined(refined) if refined else piece for piece in pieces_of(there)]
    try:
        for piece in pieces:
            piece.solve(material)
    except ConvergenceError as error:
        return f"no stress pictures: {error}"
    kappa = there.material.bulk_moduli(material)
    simulation = together(there, pieces)
    assert simulation is not None  # every piece is solved
    write_fields(folder, Solved(pieces[0].model, material, kappa, simulation.tests))
    return None


def write_series(folder: Path, name: str, solved: Solved, test: TestResult, mirror: bool = False) -> None:
    """NAME.pvd, a collection of a VTU file in NAME/ for each equilibrium of a test."""
    (folder / name).mkdir()
    entries = []
    for n, equilibrium in enumerate(test.path):
        file = f"{name}/{name}-{n:03d}.vtu"
        write_vtu(folder / file, solved.fields(test, mirror, equilibrium), solved.origin(test, equilibrium))
        entries.append(f'    <DataSet timestep="{equilibrium.depth:.9g}" part="0" file={quoteattr(file)}/>\n')
    (folder / f"{name}.pvd").write_text(COLLECTION.format("".join(entries)), encoding="utf-8")


def write_pictures(folder: Path, shown: Sequence[Shown], mirror: bool = False) -> None:
    """PNG pictures of tests, one for each component, with their captions for the report."""
    seen = list(dict.fromkeys(VIEWS["completed" if mirror else test.fields.part] for test in shown))
    sample, view = seen[0] if len(seen) == 1 else (SEVERAL, "; ".join(map(" ".join, seen)))
    displacement_picture(shown, folder / "displacement.png")
    pictures = [
        {
            "file": "displacement.png",
            "caption": f"Vertical displacement of the deformed {sample}, to scale, {view}.{_drawn_with(shown)}",
            "alt": f"Vertical displacement, largest under the indenter. {'; '.join(map(_sinks, shown))}",
        }
    ]
    rows = {test.name: peaks(test.fields) for test in shown}
    for n, component in enumerate(COMPONENTS):
        stress_picture(component, shown, folder / f"stress-{component}.png")
        sizes = "; ".join(f"{test.name}: {row['smallest']:.3g} to {row['largest']:.3g} kPa"
            for test in shown if (row := rows[test.name][n]))  # fmt: skip
        pictures.append({
            "file": f"stress-{component}.png",
            "caption": f"Cauchy stress {component} (kPa); 1 % of the nodes lie beyond the scale.",
            "alt": f"Cauchy stress {component} on the deformed {sample}. {sizes}",
        })  # fmt: skip
    tables = [
        {"test": test.name, "angle": None if test.fibre is None else test.angle, "rows": rows[test.name],
            "words": peak_words(rows[test.name])}
        for test in shown
    ]  # fmt: skip
    write_json(folder / PICTURES, {"pictures": pictures, "peaks": tables})


def _sinks(test: Shown) -> str:
    sinks = test.fields.displacement[:, 1]
    return f"{test.name}: {sinks.min():.3g} to {sinks.max():.3g} mm"


def _drawn_with(shown: Sequence[Shown]) -> str:
    """What the pictures show beside the sample."""
    fibres = " Dark lines on the top follow the fibres." if any(test.fibre is not None for test in shown) else ""
    return f"{' Grey: the indenter.' if any(test.indenter is not None for test in shown) else ''}{fibres}"
