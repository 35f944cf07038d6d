"""Pictures of the deformed sample: displacement and Cauchy stresses on its surface and on its planes of symmetry.

Drawn by matplotlib alone, without a display: the quarter sample (x >= 0, z >= 0) is seen from outside of both planes of
symmetry, so that the material under the indenter is visible. Deformation is to scale.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.colors import Colormap, LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from indentfit.arrays import Array
from indentfit.fem.fields import Fields
from indentfit.report.indenter_outline import Outline
from indentfit.report.plots import TICKS, _label
from indentfit.report.shown import Shown, View
from indentfit.report.style import COLUMN, DOTS, PNG, STYLE

Peak = dict[str, Any]

COMPONENTS = ("xx", "yy", "zz", "xy", "yz", "xz")  # in the order of fem.fields
LIMIT = 99.0  # percent of the nodes whose values are within the colours' range: edges are singular
INK, GREY = "0.1", "0.35"
PANEL, SIDE, BAR = 0.57, 0.02, 0.9  # height of a sample, margin, length of the bar of colours: shares of the width
BELOW, THICK = 0.6, 0.1  # height of the bar of colours with its numbers and label, and of itself, inches
TITLE, LINE = 0.2, 0.14  # height of a title of one line, and of each further line, inches


def displacement_picture(tests: Sequence[Shown], path: Path) -> None:
    """u_y of each test, one above the other on one scale. Saves a PNG."""
    values = [test.drawn.displacement[:, 1] for test in tests]
    low, high = min(map(np.min, values)), max(map(np.max, values))
    _picture(tests, values, Scale("Vertical displacement $u_y$ (mm)", "viridis", low, high, "neither"), path)


def stress_picture(component: str, tests: Sequence[Shown], path: Path) -> None:
    """One Cauchy stress ("xx") of each test, one above the other on one scale, in blue below zero and in red above. Saves a PNG."""
    values = [test.drawn.nodal_stress[:, COMPONENTS.index(component)] for test in tests]
    low, high = stress_range(values)
    _picture(tests, values, Scale(rf"$\sigma_{{{component}}}$ (kPa)", _diverging(low, high), low, high, "both"), path)


def stress_range(values: Sequence[Array]) -> tuple[float, float]:
    """The range of the colours, with zero in it: LIMIT percent of the nodes of the test with the largest values lie within."""
    spare = (100 - LIMIT) / 2
    low = min(0.0, *(float(np.percentile(value, spare)) for value in values))
    high = max(0.0, *(float(np.percentile(value, 100 - spare)) for value in values))
    return (low, high) if high > low else (-1e-12, 1e-12)


@dataclass(frozen=True, eq=False)
class Scale:
    """The scale of colours of a picture."""

    label: str
    ramp: str | Colormap
    low: float
    high: float
    extend: str


def _diverging(low: float, high: float) -> Colormap:
    """Blue to red about white at zero, with equal steps on both sides, and no colour that no value of the range has."""
    size = max(-low, high)
    ends = np.linspace((low / size + 1) / 2, (high / size + 1) / 2, 256)
    return LinearSegmentedColormap.from_list("stress", matplotlib.colormaps["RdBu_r"](ends))


def _picture(tests: Sequence[Shown], values: Sequence[Array], scale: Scale, path: Path) -> None:
    """Tests one above the other, with one bar of colours below.

    Everything stands at places that are known beforehand: matplotlib's own layout would measure every text of a picture twice,
    which takes longer than to draw it.
    """
    names = [_label(test.words) for test in tests]
    titles = [TITLE + LINE * name.count("\n") for name in names]
    panel = PANEL * COLUMN
    height = BELOW + len(tests) * panel + sum(titles)
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(COLUMN, height))
        FigureCanvasAgg(figure)
        top = height
        for test, value, name, title in zip(tests, values, names, titles, strict=True):
            top -= title + panel
            axes = figure.add_axes((SIDE, top / height, 1 - 2 * SIDE, panel / height))
            colours = _draw(axes, test.view, value, scale)
            figure.text(SIDE, (top + panel + TITLE / 3) / height, name, va="bottom")
        place = figure.add_axes(((1 - BAR) / 2, (BELOW - 2 * THICK) / height, BAR, THICK / height))
        bar = figure.colorbar(colours, cax=place, orientation="horizontal", extend=scale.extend)
        bar.set_label(scale.label)
        bar.locator = MaxNLocator(6, steps=TICKS)
        bar.update_ticks()
        figure.savefig(path, dpi=DOTS, facecolor="white", metadata={"Software": None}, pil_kwargs=PNG)


def peaks(fields: Fields) -> list[Peak]:
    """Rows of the peak components table: dictionaries with component, largest, smallest, magnitude, usual (kPa), place (mm).

    usual: the magnitude that 1 % of the nodes exceed, which does not grow without limit at a sharp edge as the mesh is refined.
    """
    rows = []
    for n, component in enumerate(COMPONENTS):
        value = fields.nodal_stress[:, n]
        at = int(np.argmax(np.abs(value)))
        place = ", ".join(f"{x:.2f}" for x in fields.nodes[at])
        rows.append({
            "component": component, "largest": float(value.max()), "smallest": float(value.min()),
            "magnitude": float(abs(value[at])), "usual": float(np.percentile(np.abs(value), LIMIT)), "place": place,
        })  # fmt: skip
    return rows


def peak_words(rows: Sequence[Peak]) -> str:
    """Which normal and which shear stress is the largest, in a sentence."""
    normal = max((row for row in rows if row["component"][0] == row["component"][1]), key=lambda row: row["magnitude"])
    shear = max((row for row in rows if row["component"][0] != row["component"][1]), key=lambda row: row["magnitude"])
    return (
        f"The largest normal stress is {normal['component']} ({normal['magnitude']:.3g} kPa), "
        f"the largest shear stress is {shear['component']} ({shear['magnitude']:.3g} kPa). Without the 1 % of nodes where "
        f"each stress is largest, these are {_usual(rows, True)} and {_usual(rows, False)}."
    )


def _usual(rows: Sequence[Peak], normal: bool) -> str:
    kind = [row for row in rows if (row["component"][0] == row["component"][1]) == normal]
    row = max(kind, key=lambda row: row["usual"])
    return f"{row['component']} ({row['usual']:.3g} kPa)"


def _draw(axes: Axes, view: View, value: Array, scale: Scale) -> Any:
    """The visible surface in the colours of nodal values, with fibres and the indenter. Returns what a bar of colours needs."""
    colours = axes.tripcolor(
        view.flat[:, 0], view.flat[:, 1], np.clip(value, scale.low, scale.high), triangles=view.triangles, shading="gouraud",
        cmap=scale.ramp, vmin=scale.low, vmax=scale.high,
    )  # fmt: skip
    axes.add_collection(LineCollection(list(view.edges), colors="black", linewidths=0.15, alpha=0.2))
    if view.fibres:
        axes.add_collection(LineCollection(view.fibres, colors=INK, linewidths=0.6))
    if view.indenter is not None:
        _draw_indenter(axes, view.indenter, view.seen_as)
    _axes_of_space(axes, view.flat, *view.seen_as.T)
    axes.set_aspect("equal")
    axes.set_axis_off()
    return colours


def _draw_indenter(axes: Axes, drawn: Outline, seen_as: Array) -> None:
    """The indenter above the sample, as clear as glass: the cut faces and the top of its quarters."""
    for face in drawn.faces:
        axes.fill(*(face @ seen_as).T, facecolor=GREY, alpha=0.18, edgecolor="none", zorder=4)
        axes.plot(*(face[[*range(len(face)), 0]] @ seen_as).T, color=GREY, linewidth=0.5, zorder=5)


def _axes_of_space(axes: Axes, flat: Array, right: Array, up: Array) -> None:
    """Three short arrows that say where x, y and z point."""
    span = np.ptp(flat, axis=0).max()
    origin = np.array([flat[:, 0].max() - 0.02 * span, flat[:, 1].min()])
    axes.update_datalim([origin, origin + 0.04 * span])
    axes.autoscale_view()
    for name, direction in (("x", [1, 0, 0]), ("y", [0, 1, 0]), ("z", [0, 0, 1])):
        tip = 0.11 * span * np.array([np.dot(direction, right), np.dot(direction, up)])
        axes.annotate(
            "", tuple(origin + tip), tuple(origin), arrowprops={"arrowstyle": "->", "lw": 0.6, "shrinkA": 0, "shrinkB": 0}
        )
        axes.annotate(name, tuple(origin + 1.35 * tip), ha="center", va="center", annotation_clip=False)
