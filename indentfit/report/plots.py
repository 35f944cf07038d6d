"""Figures, as SVG and PNG: drawn without a display, for one column of a journal."""

import itertools
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from .style import COLOURS, COLUMN, DASHES, MARKERS, STYLE

MARKED = 13  # about that many markers on a curve: more would run together


def force_displacement(measured, simulated, path):
    """Measured curves as markers, simulated ones as lines, and below them simulated minus measured where both are given.

    measured, simulated: lists of (name of the test, Curve); a test has one colour in both. Saves path.svg and
    path.png (any ending of `path` is replaced) and returns the figure.
    """
    names = list(dict.fromkeys(name for name, _ in [*simulated, *measured]))
    looks = dict(zip(names, itertools.cycle(zip(COLOURS, MARKERS, DASHES, strict=True)), strict=False))
    pairs = [(name, dict(measured)[name], curve) for name, curve in simulated if name in dict(measured)]
    with matplotlib.rc_context(STYLE):
        figure, upper, lower = _axes(bool(pairs), names)
        for name, curve in simulated:
            colour, _, dashes = looks[name]
            upper.plot(*_from_origin(curve), color=colour, linestyle=dashes, zorder=2)
        for name, curve in measured:
            upper.plot(curve.displacement, curve.force, markevery=_every(curve), zorder=3, **_markers(looks[name]))
        for name, given, curve in pairs:
            colour, _, _ = looks[name]
            displacement, difference = residual(given, curve)
            lower.plot(displacement, difference, color=colour, linewidth=0.7)
            lower.plot(displacement, difference, markevery=_every(given), **_markers(looks[name]))
        _finish(figure, upper, lower, names, looks, bool(measured), bool(simulated))
        save(figure, path)
    return figure


def residual(measured, simulated):
    """Displacements that both curves reach, of the measured one (n,), and simulated minus measured force there (n,)."""
    d, F = _from_origin(simulated)
    within = measured.displacement <= d[-1] * (1 + 1e-9)
    return measured.displacement[within], np.interp(measured.displacement, d, F)[within] - measured.force[within]


def save(figure, path):
    """Write the figure as SVG and as PNG; the same figure gives the same bytes."""
    path = Path(path)
    figure.savefig(path.with_suffix(".svg"), metadata={"Date": None})
    figure.savefig(path.with_suffix(".png"), metadata={"Software": None})


def _axes(with_residuals, names):
    height = (0.84 if with_residuals else 0.68) * COLUMN + 0.15 * len(names)
    figure = Figure(figsize=(COLUMN, height), layout="constrained")
    FigureCanvasAgg(figure)
    if not with_residuals:
        return figure, figure.add_subplot(), None
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(2.6, 1))
    return figure, upper, lower


def _from_origin(curve):
    """Displacement and force, with the untouched sample, where the force is zero, in front."""
    d, F = curve.displacement, curve.force
    return (d, F) if d[0] <= 0 else (np.concatenate([[0.0], d]), np.concatenate([[0.0], F]))


def _every(curve):
    return max(1, round(curve.force.size / MARKED))


def _markers(look):
    colour, marker, _ = look
    return {"linestyle": "none", "marker": marker, "color": colour, "markerfacecolor": "white", "markeredgewidth": 0.8}


def _finish(figure, upper, lower, names, looks, with_measured, with_simulated):
    upper.set_ylabel("Force (mN)")
    upper.set_xlim(left=0)
    upper.set_ylim(bottom=min(0.0, upper.dataLim.y0))
    for axes in filter(None, (upper, lower)):
        axes.xaxis.set_major_locator(MaxNLocator(6, steps=[1, 2, 2.5, 5, 10]))
    upper.yaxis.set_major_locator(MaxNLocator(6, steps=[1, 2, 2.5, 5, 10]))
    if lower is not None:
        lower.axhline(0, color="0.4", linewidth=0.6, zorder=0)
        lower.set_ylabel("Simulated −\nmeasured (mN)")
        lower.yaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 2.5, 5, 10]))
        figure.align_ylabels([upper, lower])
    (lower or upper).set_xlabel("Displacement (mm)")
    _legend(figure, names, looks, with_measured, with_simulated)


def _legend(figure, names, looks, with_measured, with_simulated):
    """Above the axes: a line for each test in its colour and, where both kinds are drawn, what line and marker mean."""
    handles, labels = [], []
    for name in names:
        colour, marker, dashes = looks[name]
        line = {"color": colour, "linestyle": dashes if with_simulated else "none"}
        handles.append(Line2D([], [], **(_markers(looks[name]) | line if with_measured else line)))
        labels.append(_label(name))
    columns = 2 if max(map(len, names)) <= 20 and len(names) > 1 else 1
    figure.legend(handles, labels, loc="outside upper left", ncols=columns, handlelength=2.6, borderaxespad=0.2)


def _label(name):
    """A name as matplotlib takes it: no formulas in it, and not hidden because of a leading underscore."""
    name = name if len(name) <= 48 else name[:45] + "..."
    return (" " if name.startswith("_") else "") + name.replace("$", r"\$")
