"""The folder fields/ of a result: VTU files of each test, a series of them for ParaView, and pictures for the report."""

from pathlib import Path
from xml.sax.saxutils import quoteattr

from ..fem.fields import recover
from .folder import write_json
from .mirror import whole
from .stress_plots import displacement_picture, peak_words, peaks, stress_picture
from .vtu import file_names, write_vtu

PICTURES = "pictures.json"  # what the report shows
COLLECTION = """<?xml version="1.0"?>
<VTKFile type="Collection" version="0.1">
  <Collection>
{}  </Collection>
</VTKFile>
"""


def write_fields(folder, model, material, kappa, tests, vtu=True, series=False, mirror=False):
    """Write VTU files and pictures of simulated tests (TestResult) of fem.simulate.Model `model` at their last displacement.

    mirror: of the whole sample, not of the quarter that was computed; series: also every equilibrium on the way, as NAME.pvd with
    the indenter's displacement (mm) in place of the time.
    """
    folder = Path(folder)
    folder.mkdir()
    names = file_names([test.name for test in tests])
    shown = []
    for test, name in zip(tests, names, strict=True):
        fields = _recovered(model, test, material, kappa, mirror)
        shown.append((test.name, test.angle, fields))
        if vtu:
            write_vtu(folder / f"{name}.vtu", fields)
        if series:
            write_series(folder, name, model, material, kappa, test, mirror)
    write_pictures(folder, names, shown, mirror)


def _recovered(model, test, material, kappa, mirror, equilibrium=None):
    fields = recover(model, test, material, kappa, equilibrium)
    return whole(fields) if mirror else fields


def write_series(folder, name, model, material, kappa, test, mirror=False):
    """NAME.pvd, a collection of a VTU file in NAME/ for each equilibrium of a test."""
    (folder / name).mkdir()
    entries = []
    for n, equilibrium in enumerate(test.path):
        file = f"{name}/{name}-{n:03d}.vtu"
        write_vtu(folder / file, _recovered(model, test, material, kappa, mirror, equilibrium))
        entries.append(f'    <DataSet timestep="{equilibrium.depth:.9g}" part="0" file={quoteattr(file)}/>\n')
    (folder / f"{name}.pvd").write_text(COLLECTION.format("".join(entries)), encoding="utf-8")


def write_pictures(folder, names, shown, mirror=False):
    """PNG pictures of (test, angle, Fields), and what the report says of them."""
    sample, view = "quarter sample", "seen from outside of both planes of symmetry"
    if mirror:
        sample, view = "whole sample", "mirrored from its quarter"
    displacement_picture(shown, folder / "displacement.png")
    words = []
    for test, _, fields in shown:
        sinks = fields.displacement[:, 1]
        words.append(f"{test}: {sinks.min():.3g} to {sinks.max():.3g} mm")
    pictures = [
        {
            "file": "displacement.png",
            "caption": f"Vertical displacement of the deformed {sample}, to scale, {view}.",
            "alt": f"Vertical displacement, largest under the indenter. {'; '.join(words)}",
        }
    ]
    tables = []
    for (test, angle, fields), name in zip(shown, names, strict=True):
        rows = peaks(fields)
        stress_picture(test, angle, fields, folder / f"stress-{name}.png")
        pictures.append({
            "file": f"stress-{name}.png",
            "caption": f"Cauchy stresses (kPa) of {test} ({angle}°) on the deformed {sample}; 1 % of the nodes lie beyond "
                "each scale.",
            "alt": f"Six Cauchy stresses of {test}, concentrated at the indenter's edge. {peak_words(rows)}",
        })  # fmt: skip
        tables.append({"test": test, "angle": angle, "rows": rows, "words": peak_words(rows)})
    write_json(folder / PICTURES, {"pictures": pictures, "peaks": tables})
