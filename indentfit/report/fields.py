"""The folder fields/ of a result: VTU files of each test, a series of them for ParaView, and pictures for the report."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.sax.saxutils import quoteattr

from indentfit.fem.result import TestResult
from indentfit.report.folder import write_json
from indentfit.report.shown import Shown
from indentfit.report.solved import Solved
from indentfit.report.stress_plots import COMPONENTS, displacement_picture, peak_words, peaks, stress_picture
from indentfit.report.vtu import write_vtu

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


def write_fields(folder: Path, solved: Solved, choice: FieldChoice = FieldChoice()) -> None:
    """Write VTU files and pictures of simulated tests into a new folder.

    A series holds every equilibrium on the way, as NAME.pvd with the indenter's displacement (mm) in place of the time.
    """
    folder.mkdir()
    shown = solved.written(folder, choice.vtu, choice.whole)
    if choice.series:
        for test, name in zip(solved.tests, solved.names, strict=True):
            write_series(folder, name, solved, test, choice.whole)
    write_pictures(folder, shown, choice.whole)


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
