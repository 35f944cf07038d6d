"""Pictures of the deformed sample: displacement and Cauchy stresses on its surface and on its planes of symmetry.

Drawn by matplotlib alone, without a display: the quarter sample (x >= 0, z >= 0) is seen from outside of both planes of
symmetry, so that the material under the indenter is visible. Deformation is to scale.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from skfem.io.meshio import HEX_MAPPING

from indentfit.arrays import Array, Ints
from indentfit.fem.fields import Fields
from indentfit.report.plots import _label
from indentfit.report.style import COLUMN, STYLE

Shown = Sequence[tuple[str, int, Fields]]  # name of a test, angle in degrees, its fields
Peak = dict[str, Any]

COMPONENTS = ("xx", "yy", "zz", "xy", "yz", "xz")  # in the order of fem.fields
SHOWN = ("xx", "xy", "yy", "yz", "zz", "xz")  # normal stresses on the left, shear stresses on the right
WIDTH, DOTS = 1.25 * COLUMN, 220
EYE = np.array([-0.70, 0.62, -1.0])  # from the sample towards the eye
ARROW = {"arrowstyle": "->", "lw": 0.6, "shrinkA": 0, "shrinkB": 0}
LIMIT = 99.0  # percent of the nodes whose values are within the colours' range: edges are singular
# Edges by their corners and faces by theirs, in VTK's order of the nodes of a 27-node brick
EDGES = ((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7))
FACES = ((0, 3, 7, 4), (1, 2, 6, 5), (0, 1, 5, 4), (3, 2, 6, 7), (0, 1, 2, 3), (4, 5, 6, 7))


def displacement_picture(tests: Shown, path: Path) -> None:
    """u_y of each test (list of (name, angle, Fields)), one above the other on one scale. Saves a PNG."""
    with matplotlib.rc_context(STYLE):
        figure, panels = _panels(len(tests), 1)
        values = [fields.displacement[:, 1] for *_, fields in tests]
        low, high = min(map(np.min, values)), max(map(np.max, values))
        for axes, (name, angle, fields), value in zip(panels, tests, values, strict=True):
            colours = _draw(axes, fields, value, "viridis", low, high)
            axes.set_title(_label(f"{name} ({angle}°)"), fontsize=8, loc="left")
        figure.colorbar(colours, ax=panels, shrink=0.7, aspect=30, label="Displacement $u_y$ (mm)")
        _save(figure, path)


def stress_picture(name: str, angle: int, fields: Fields, path: Path) -> None:
    """The six Cauchy stresses of one test, each with its own scale around zero. Saves a PNG."""
    with matplotlib.rc_context(STYLE):
        figure, panels = _panels(3, 2)
        for axes, component in zip(panels, SHOWN, strict=True):
            value = fields.nodal_stress[:, COMPONENTS.index(component)]
            size = max(np.percentile(np.abs(value), LIMIT), 1e-12)
            colours = _draw(axes, fields, value, "RdBu_r", -size, size)
            bar = figure.colorbar(colours, ax=axes, location="bottom", shrink=0.85, aspect=28, pad=0.02, extend="both")
            bar.set_label(rf"$\sigma_{{{component}}}$ (kPa)")
            bar.locator = matplotlib.ticker.MaxNLocator(4, symmetric=True)
            bar.update_ticks()
        figure.suptitle(_label(f"{name} ({angle}°)"), fontsize=8, x=0.02, ha="left")
        _save(figure, path)


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


def _draw(axes: Axes, fields: Fields, value: Array, ramp: str, low: float, high: float) -> Any:
    """The visible surface in the colours of nodal values, the far parts first. Returns what a colour bar needs."""
    x = fields.nodes + fields.displacement
    quads = surface(fields.elements)
    towards = EYE / np.linalg.norm(EYE)
    right = np.cross([0.0, 1.0, 0.0], towards)
    right /= np.linalg.norm(right)
    up = np.cross(towards, right)
    middle = x[quads].mean(axis=1)
    normal = _normals(x, quads) * _outwards(fields.nodes, quads)[:, None]
    seen = normal @ towards > 1e-12
    quads = quads[seen][np.argsort(middle[seen] @ towards)]
    flat = np.column_stack([x @ right, x @ up])
    triangles = np.stack([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]], axis=1).reshape(-1, 3)
    colours = axes.tripcolor(
        flat[:, 0], flat[:, 1], np.clip(value, low, high), triangles=triangles, shading="gouraud", cmap=ramp, vmin=low, vmax=high
    )
    axes.add_collection(LineCollection(flat[quads[:, [0, 1, 2, 3, 0]]], colors="black", linewidths=0.15, alpha=0.25))
    _axes_of_space(axes, flat, right, up)
    axes.set_aspect("equal")
    axes.set_axis_off()
    return colours


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
    origin = np.array([flat[:, 0].max() - 0.02 * span, flat[:, 1].min() - 0.06 * span])
    axes.update_datalim([origin, origin + 0.04 * span])
    axes.autoscale_view()
    for name, direction in (("x", [1, 0, 0]), ("y", [0, 1, 0]), ("z", [0, 0, 1])):
        tip = 0.11 * span * np.array([np.dot(direction, right), np.dot(direction, up)])
        axes.annotate(
            "", tuple(origin + tip), tuple(origin), arrowprops={"arrowstyle": "->", "lw": 0.6, "shrinkA": 0, "shrinkB": 0}
        )
        axes.annotate(name, tuple(origin + 1.35 * tip), fontsize=7, ha="center", va="center", annotation_clip=False)


def _panels(rows: int, columns: int) -> tuple[Figure, list[Axes]]:
    figure = Figure(figsize=(WIDTH, (0.62 if columns == 1 else 0.52) * WIDTH * rows / columns**0.3), layout="constrained")
    FigureCanvasAgg(figure)
    return figure, list(figure.subplots(rows, columns, squeeze=False).ravel())


def _save(figure: Figure, path: Path) -> None:
    figure.savefig(path, dpi=DOTS, facecolor="white", metadata={"Software": None})
