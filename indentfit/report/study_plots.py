"""Figures of the studies: curves for each value of a key, effects of keys, convergence of meshes."""

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter, NullLocator

from indentfit.arrays import Array
from indentfit.curve import Curve
from indentfit.digits import Scale
from indentfit.report.digits import CurveScale
from indentfit.report.plots import TICKS, Place, _from_origin, _label, save
from indentfit.report.style import COLOURS, COLUMN, DASHES, MARKERS, STYLE

Tests = Mapping[str, float]  # name -> angle, degrees
AtValue = tuple[str, Mapping[str, Curve]]  # value as written, and the curve of each test
Family = tuple[str, str, Array, Array, Array | None, tuple[float, float] | None]
OnGrid = tuple[Sequence[str], Sequence[float | None], dict[str, float] | None]

WIDE = 2 * COLUMN  # both columns of a journal
LINES = (DASHES[1], DASHES[3], DASHES[4], DASHES[5])  # dots look pale
WIDE_RANGE = 10  # ratio of a quantity's largest to its least value from which its axis is logarithmic
MOST_CURVES = 14  # largest number of curves in one panel that can be distinguished
RAMP, DARKEST, LIGHTEST = "plasma", 0.0, 0.65  # rises in lightness, for the colour-blind too; never too pale to be seen


def curves_by_value(key: str, tests: Tests, own: AtValue, points: Sequence[AtValue], path: Place) -> Figure:
    """Force curves of each test, a panel for each, at each value of one key (figures 8 and 9 of the source paper).

    tests: name -> angle; own, points: (value as written, or None where it is the case's own; {test: Curve}). Saves
    path.svg and path.png and returns the figure.
    """
    shown = [points[n] for n in np.unique(np.linspace(0, len(points) - 1, min(len(points), MOST_CURVES)).astype(int))]
    ramp = matplotlib.colormaps[RAMP](np.linspace(DARKEST, LIGHTEST, len(shown)))
    scale = CurveScale.of(curve for _, curves in (own, *shown) for curve in curves.values())
    with matplotlib.rc_context(STYLE):
        figure, panels = _panels(len(tests))
        for axes, (name, angle) in zip(panels, tests.items(), strict=True):
            axes.plot(
                *_from_origin(scale.scaled(own[1][name])), color="black", linewidth=1.3, zorder=3, label=f"{own[0]} (the case)"
            )
            for (value, curves), colour, dashes in zip(shown, ramp, itertools.cycle(LINES), strict=False):
                axes.plot(
                    *_from_origin(scale.scaled(curves[name])), color=colour, linewidth=1.2, linestyle=dashes, label=_label(value)
                )
            _force_axes(axes, f"{name} ({angle}°)", scale)
        handles, labels = panels[0].get_legend_handles_labels()
        columns = 4 if len(tests) > 1 else 2
        figure.legend(handles, labels, loc="outside lower center", ncols=columns, title=_label(key), handlelength=3.2)
        save(figure, path)
    return figure


def ranked(rows: Sequence[tuple[str, str, float]], tests: Tests, path: Place) -> Figure:
    """Spread of the last force over each key's values, the largest above, a bar for each test (`rows`: (key, test, share))."""
    keys = list(dict.fromkeys(key for key, _, _ in rows))
    with matplotlib.rc_context(STYLE):
        figure, (axes,) = _panels(1, width=1.1 * COLUMN, height=0.9 + 0.3 * len(keys) * max(1, len(tests) / 2))
        thick = 0.8 / len(tests)
        for n, name in enumerate(tests):
            shares = {key: share for key, test, share in rows if test == name}
            at = np.arange(len(keys)) + (n - (len(tests) - 1) / 2) * thick
            bars = axes.barh(
                at, [100 * shares.get(key, 0) for key in keys], height=0.9 * thick, color=COLOURS[n % len(COLOURS)],
                hatch=("", "////", "....", "xxxx")[n % 4], edgecolor="white", linewidth=0.3,
                label=_label(f"{name} ({tests[name]}°)"),
            )  # fmt: skip
            axes.bar_label(bars, fmt="%.2g", padding=2, fontsize=6.5)
        axes.set_yticks(range(len(keys)), [_label(key) for key in keys])
        axes.invert_yaxis()
        axes.margins(x=0.12)
        axes.set_xlabel("Spread of the last force\n(% of that of the case)")
        axes.tick_params(axis="y", length=0)
        figure.legend(loc="outside upper left", ncols=1)
        save(figure, path)
    return figure


def stiffness_by_rate(key: str, tests: Tests, rows: Sequence[tuple[float, Mapping[str, float]]], path: Place) -> Figure:
    """Stiffness of each test against the values of a key of time (`rows`: (value, {test: stiffness in mN/mm})), which are on a
    logarithmic axis."""
    rows = sorted(rows, key=_first)
    with matplotlib.rc_context(STYLE):
        figure, (axes,) = _panels(1)
        for n, (name, angle) in enumerate(tests.items()):
            look: dict[str, Any] = {"color": COLOURS[n % len(COLOURS)], "marker": MARKERS[n % len(MARKERS)]}
            x, y = [value for value, _ in rows], [known[name] for _, known in rows]
            axes.plot(x, y, label=_label(f"{name} ({angle}°)"), markerfacecolor="white", **look)
        axes.set_xscale("log")
        axes.set_ylim(bottom=0)
        axes.set_xlabel(_label(key))
        axes.set_ylabel("Stiffness (mN/mm)")
        figure.legend(loc="outside upper left", ncols=2)
        save(figure, path)
    return figure


def _first(row: tuple[float, Mapping[str, float]]) -> float:
    return row[0]


def forces_on_grid(keys: Sequence[str], points: Sequence[OnGrid], tests: Tests, path: Place) -> Figure:
    """Last force of each test over the first key of a grid, a line for each combination of the others.

    points: list of (values as written, in the order of keys; numbers; {test: force} or None where it failed).
    """
    lines: dict[tuple[str, ...], list[tuple[str, float | None, dict[str, float] | None]]] = {}
    for values, numbers, forces in points:
        lines.setdefault(tuple(values[1:]), []).append((values[0], numbers[0], forces))
    words = any(number is None for line in lines.values() for _, number, _ in line)
    scale = Scale.of((force for _, _, forces in points for force in (forces or {}).values()), "mN")
    with matplotlib.rc_context(STYLE):
        figure, panels = _panels(len(tests))
        looks = itertools.cycle(zip(COLOURS, MARKERS, DASHES, strict=True))
        for (others, line), (colour, marker, dashes) in zip(list(lines.items())[:MOST_CURVES], looks, strict=False):
            for axes, name in zip(panels, tests, strict=True):
                x: list[Any] = [value if words else number for value, number, _ in line]
                y = [np.nan if forces is None else scale.factor * forces[name] for _, _, forces in line]
                label = _label(", ".join(others)) or "force"
                axes.plot(x, y, color=colour, marker=marker, linestyle=dashes, label=label, markerfacecolor="white")
        for axes, (name, angle) in zip(panels, tests.items(), strict=True):
            _title(axes, f"{name} ({angle}°)")
            axes.set_xlabel(_label(keys[0]))
            axes.set_ylabel(f"Force at the last\ndisplacement ({scale.symbol})")
            axes.yaxis.set_major_locator(MaxNLocator(6, steps=TICKS))
            axes.autoscale()
        if len(keys) > 1:
            handles, labels = panels[0].get_legend_handles_labels()
            title = _label(", ".join(keys[1:]))
            figure.legend(handles, labels, loc="outside lower center", ncols=4, title=title, handlelength=3.2)
        save(figure, path)
    return figure


def mesh_convergence(families: Sequence[Family], path: Place) -> Figure:
    """What was computed on each mesh against the mesh's element size, with the fitted approach to zero size and its band.

    families: list of (title, label of the axis, h (n,), values (n,), curve (m, 2) or None, band (2,) or None).
    """
    scale = Scale.of((float(size) for family in families for size in family[2]), "mm")
    with matplotlib.rc_context(STYLE):
        figure, panels = _panels(len(families), rows=-(-len(families) // 2))
        for axes, (title, label, h, values, curve, band) in zip(panels, families, strict=True):
            if band is not None:
                axes.axhspan(*band, color=COLOURS[4], alpha=0.3, linewidth=0, label="error band")
            if curve is not None:
                axes.plot(scale.factor * curve[:, 0], curve[:, 1], color=COLOURS[0], label="fitted approach to zero size")
            axes.plot(
                scale.factor * h,
                values,
                "o",
                color=COLOURS[1],
                markerfacecolor="white",
                markeredgewidth=0.9,
                label="meshes",
                clip_on=False,
            )
            axes.set_xlim(0, 1.05 * scale.factor * max(h))
            axes.margins(y=0.15)
            axes.set_title(_label(title), fontsize=8, loc="left")
            axes.set_xlabel(f"Element size h ({scale.symbol})")
            axes.set_ylabel(label)
            axes.yaxis.set_major_locator(MaxNLocator(5, steps=TICKS))
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=3 if len(families) > 1 else 1)
        save(figure, path)
    return figure


def error_and_cost(h: Array, errors: tuple[str, Mapping[str, Sequence[float]]], seconds: Sequence[float], path: Place) -> Figure:
    """Misfit or force against the mesh's element size, and the CPU time that it takes (figure 10 of the source paper).

    errors: (label of the axis, {name: values (n,)}); seconds (n,).
    """
    label, series = errors
    scale = Scale.of((float(size) for size in h), "mm")
    h = scale.factor * h
    with matplotlib.rc_context(STYLE):
        figure, (axes,) = _panels(1, width=COLUMN, height=0.85 * COLUMN)
        cost = axes.twinx()
        cost.spines["right"].set_visible(True)
        order = np.argsort(h)
        for (name, values), colour, marker in zip(series.items(), COLOURS, MARKERS, strict=False):
            axes.plot(h[order], np.array(values)[order], color=colour, marker=marker, markerfacecolor="white", label=_label(name))
        cost.plot(h[order], np.array(seconds)[order], color="0.35", linestyle=DASHES[2], marker="X", label="CPU time (right)")
        cost.set_yscale("log")
        cost.set_ylabel("CPU time (s)")
        cost.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        cost.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        cost.yaxis.set_minor_formatter(NullFormatter())
        cost.yaxis.set_minor_locator(NullLocator())
        axes.set_ylim(bottom=0)
        axes.set_xlabel(f"Element size h ({scale.symbol})")
        axes.set_ylabel(label)
        figure.legend(loc="outside upper left", ncols=1)
        save(figure, path)
    return figure


def _panels(number: int, rows: int = 1, width: float | None = None, height: float | None = None) -> tuple[Figure, list[Axes]]:
    columns = -(-number // rows)
    width = width or (WIDE if columns > 1 else COLUMN)
    figure = Figure(figsize=(width, height or (0.3 + 0.72 * COLUMN * rows)), layout="constrained")
    FigureCanvasAgg(figure)
    panels = list(figure.subplots(rows, columns, squeeze=False).ravel())
    for spare in panels[number:]:
        spare.set_axis_off()
    return figure, panels[:number]


def _title(axes: Axes, title: str) -> None:
    axes.set_title(_label(title), fontsize=8, loc="left")


def _force_axes(axes: Axes, title: str, scale: CurveScale) -> None:
    _title(axes, title)
    axes.set_xlim(left=0)
    axes.set_ylim(bottom=0)
    axes.set_xlabel(f"Displacement ({scale.displacement.symbol})")
    axes.set_ylabel(f"Force ({scale.force.symbol})")
    axes.xaxis.set_major_locator(MaxNLocator(6, steps=TICKS))
    axes.yaxis.set_major_locator(MaxNLocator(6, steps=TICKS))


def course(objectives: Sequence[float], phases: Sequence[str], scale: Scale | None = None) -> Figure:
    """The best objective, on that scale, after each step of a search; a marker for each phase."""
    with matplotlib.rc_context(STYLE):
        figure, (axes,) = _panels(1, width=COLUMN, height=0.7 * COLUMN)
        scale = scale or Scale.of([min(objectives)], "mN")
        at, values = np.arange(1, len(objectives) + 1), scale.factor * np.minimum.accumulate(objectives)
        axes.plot(at, values, color="0.4", linewidth=0.8)
        for phase, colour, marker in zip(dict.fromkeys(phases), itertools.cycle(COLOURS), itertools.cycle(MARKERS), strict=False):
            mine = np.array([other == phase for other in phases])
            axes.plot(at[mine], values[mine], marker, color=colour, markerfacecolor="white", label=_label(phase) or "step")
        if values.min() > 0 and values[0] > WIDE_RANGE * values[-1]:
            axes.set_yscale("log")
            for part in (axes.yaxis.set_major_formatter, axes.yaxis.set_minor_formatter):
                part(FuncFormatter(lambda value, _: f"{value:g}" if f"{value:.0e}"[0] in "125" else ""))
        else:
            axes.yaxis.set_major_locator(MaxNLocator(5, steps=TICKS))
        axes.margins(x=0.04, y=0.1)  # no marker is cut
        axes.xaxis.set_major_locator(MaxNLocator(6, integer=True))
        axes.set_xlabel("Step of the search")
        axes.set_ylabel(f"Best objective ({scale.symbol})")
        figure.legend(loc="outside upper left", ncols=3)
    return figure
