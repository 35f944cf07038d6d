"""Pictures of the deformed sample: displacement and Cauchy stresses on its surface and on its planes of symmetry.

Drawn by matplotlib alone, without a display: the quarter sample (x >= 0, z >= 0) is seen from outside of both planes of
symmetry, so that the material under the indenter is visible. Deformation is to scale.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
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
from matplotlib.tri import LinearTriInterpolator, Triangulation
from skfem.io.meshio import HEX_MAPPING

from indentfit.arrays import Array, Ints
from indentfit.fem.fields import Fields
from indentfit.fibre_map import FibreMap
from indentfit.fibres import Families, Fibre, words
from indentfit.indenters.shape import IndenterShape
from indentfit.report.indenter_outline import Outline, outline
from indentfit.report.plots import TICKS, _label
from indentfit.report.style import COLUMN, DOTS, PNG, STYLE

Peak = dict[str, Any]
SIDES = {"quarter": (), "half": (0,), "mirror_x": (2,), "mirror_z": (0,), "whole": (0,)}  # axes of which pictures show both sides

COMPONENTS = ("xx", "yy", "zz", "xy", "yz", "xz")  # in the order of fem.fields
EYE = np.array([-0.70, 0.62, -1.0])  # from the sample towards the eye
LIMIT = 99.0  # percent of the nodes whose values are within the colours' range: edges are singular
LINES = 9  # of fibres on the top of the sample
INK, GREY = "0.1", "0.35"
PANEL, SIDE, BAR = 0.57, 0.02, 0.9  # height of a sample, margin, length of the bar of colours: shares of the width
BELOW, THICK = 0.6, 0.1  # height of the bar of colours with its numbers and label, and of itself, inches
TITLE, LINE = 0.2, 0.14  # height of a title of one line, and of each further line, inches
# Edges by their corners and faces by theirs, in VTK's order of the nodes of a 27-node brick
EDGES = ((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7))
FACES = ((0, 3, 7, 4), (1, 2, 6, 5), (0, 1, 5, 4), (3, 2, 6, 7), (0, 1, 2, 3), (4, 5, 6, 7))


@dataclass(frozen=True, eq=False)
class Shown:
    """A test as pictures show it.

    Parameters
    ----------
    name : str
    angle, dip : float, degrees
        Direction of the fibres.
    fields : Fields
    indenter : IndenterShape or None
        The indenter that is drawn, at the depth of the fields, mm; None leaves it out.
    depth : float
    fibre : array (3,), (2, 3), FibreMap or None
        Direction of the fibres in the undeformed sample, of one family or of two.
    cut : bool
        Whether half of a whole sample is left out, so that one sees what is under the indenter.
    families : Families or None
        Angles and dips of two families of fibres.
    """

    name: str
    angle: float
    fields: Fields
    indenter: IndenterShape | None = None
    depth: float = 0.0
    fibre: Fibre | None = None
    dip: float = 0.0
    cut: bool = True
    families: Families | FibreMap | None = None

    @property
    def words(self) -> str:
        """The test's name, with the direction of its fibres where it has any."""
        return self.name if self.fibre is None else f"{self.name} ({words(self.angle, self.dip, self.families)})"

    @cached_property
    def drawn(self) -> Fields:
        """The fields that are drawn."""
        return self.fields.pictured if self.cut else self.fields

    @cached_property
    def view(self) -> "View":
        """The sample as the eye sees it, the same for the pictures of all components."""
        return _view(self)


@dataclass(frozen=True, eq=False)
class View:
    """The visible surface of a deformed sample, the far parts first.

    Parameters
    ----------
    flat : array (n, 2), mm
        Nodes in the plane of the picture.
    triangles : array (t, 3) of nodes
    edges : array (q, 5, 2), mm
        Outlines of the faces of the elements.
    fibres : list of arrays (m, 2), mm
    indenter : Outline or None
    seen_as : array (3, 2)
        What the picture shows of x, y and z: to the right and up.
    """

    flat: Array
    triangles: Ints
    edges: Array
    fibres: list[Array]
    indenter: Outline | None
    seen_as: Array


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


def surface(elements: Ints) -> Ints:
    """Quads (m, 4) of nodes, turned outwards, that cover the boundary of bricks (n, 8 or 27) in scikit-fem's order.

    A face of a 27-node brick gives four.
    """
    cells = elements[:, HEX_MAPPING[: elements.shape[1]]]
    corners = np.concatenate([cells[:, list(face)] for face in FACES])
    centre = np.tile(np.arange(len(cells)), 6)
    _, first, count = np.unique(np.sort(corners, axis=1), axis=0, return_index=True, return_counts=True)
    outer = np.sort(first[count == 1])
    if elements.shape[1] == 8:
        return corners[outer]
    quads = []
    for place in outer:
        number, cell = place // len(cells), cells[centre[place]]
        face = FACES[number]
        middle = [8 + _edge(face[n], face[(n + 1) % 4]) for n in range(4)]
        for n in range(4):
            quads.append(cell[[face[n], middle[n], 20 + number, middle[n - 1]]])
    return np.array(quads)


def _edge(a: int, b: int) -> int:
    return next(n for n, edge in enumerate(EDGES) if set(edge) == {a, b})


def _view(test: Shown) -> View:
    fields = test.drawn
    x = fields.nodes + fields.displacement
    quads = surface(fields.elements)
    towards = EYE / np.linalg.norm(EYE)
    right = np.cross([0.0, 1.0, 0.0], towards)
    right /= np.linalg.norm(right)
    seen_as = np.column_stack([right, np.cross(towards, right)])
    middle = x[quads].mean(axis=1)
    normal = _normals(x, quads) * _outwards(fields.nodes, quads)[:, None]
    seen = normal @ towards > 1e-12
    quads = quads[seen][np.argsort(middle[seen] @ towards)]
    flat = x @ seen_as
    triangles = np.stack([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]], axis=1).reshape(-1, 3)
    fibres = [] if test.fibre is None or isinstance(test.fibre, FibreMap) else list(np.atleast_2d(test.fibre))
    lines = [line @ seen_as for fibre in fibres for line in _fibres(fields, fibre)]
    indenter = None if test.indenter is None else outline(test.indenter, test.depth, fields.nodes, SIDES[fields.part])
    return View(flat, triangles, flat[quads[:, [0, 1, 2, 3, 0]]], lines, indenter, seen_as)


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


def _fibres(fields: Fields, fibre: Array) -> list[Array]:
    """Lines (n, 3) on the deformed top along the fibres, at equal distances; nothing for fibres that do not lie in the top."""
    nodes = fields.nodes
    top = nodes[:, 1] > nodes[:, 1].max() - 1e-6 * np.ptp(nodes[:, 1])
    quads = surface(fields.elements)
    quads = quads[top[quads].all(axis=1)]
    plane = nodes[:, [0, 2]]
    along = np.array([fibre[0], fibre[2]])
    if np.linalg.norm(along) < 1e-6 or not quads.size:
        return []
    along /= np.linalg.norm(along)
    across = np.array([-along[1], along[0]])
    triangles = Triangulation(plane[:, 0], plane[:, 1], np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]))
    moved = [LinearTriInterpolator(triangles, values) for values in (nodes + fields.displacement).T]
    (first, last), (low, high) = ((np.min(plane[top] @ way), np.max(plane[top] @ way)) for way in (along, across))
    steps = np.linspace(first, last, 120)[:, None] * along
    lines = []
    for place in np.linspace(low, high, LINES + 2)[1:-1]:
        line = np.column_stack([by(*(steps + place * across).T).filled(np.nan) for by in moved])
        lines.append(line[np.isfinite(line[:, 0])])
    return [line for line in lines if len(line) > 1]


def _draw_indenter(axes: Axes, drawn: Outline, seen_as: Array) -> None:
    """The indenter above the sample, as clear as glass: the cut faces and the top of its quarters."""
    for face in drawn.faces:
        axes.fill(*(face @ seen_as).T, facecolor=GREY, alpha=0.18, edgecolor="none", zorder=4)
        axes.plot(*(face[[*range(len(face)), 0]] @ seen_as).T, color=GREY, linewidth=0.5, zorder=5)


def _normals(x: Array, quads: Ints) -> Array:
    a, b, c, d = (x[quads[:, n]] for n in range(4))
    return np.cross(c - a, d - b)


def _outwards(nodes: Array, quads: Ints) -> Array:
    """1 or -1, the sign with which a quad's normal points out of the undeformed sample, which is convex (a deformed one is not)."""
    from_middle = nodes[quads].mean(axis=1) - nodes.mean(axis=0)
    return np.sign(np.einsum("ij,ij->i", _normals(nodes, quads), from_middle))


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
