"""Forces over time as a table and as a figure."""

import csv
from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from indentfit.arrays import Array
from indentfit.curve import Curve
from indentfit.fem.result import TimeCurve
from indentfit.report.digits import CurveScale, Scale
from indentfit.report.plots import save
from indentfit.report.style import COLOURS, COLUMN, DASHES, MARKERS, STYLE

Named = Sequence[tuple[str, Curve]]
Times = Mapping[str, TimeCurve]  # by the names of the tests


def write_time_curves(path: str | PathLike[str], curves: Times) -> None:
    """Write forces over time as one CSV with the columns test, time_s, displacement_mm, force_mN."""
    with open(path, "w", encoding="utf-8", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(["test", "time_s", "displacement_mm", "force_mN"])
        for name, curve in curves.items():
            rows = zip(curve.time.tolist(), curve.displacement.tolist(), curve.force.tolist(), strict=True)
            table.writerows([name, *row] for row in rows)


def force_over_time(curves: Times, path: str | Path | None) -> Figure:
    """Force against time, from the first contact on; saved as SVG and PNG where a path is given."""
    scale = CurveScale.of(Curve(curve.displacement, curve.force) for curve in curves.values()).force
    return _over_time({name: (curve.time, curve.force) for name, curve in curves.items()}, "Force", scale, path)


def depth_over_time(curves: Times, path: str | Path | None) -> Figure:
    """Displacement against time under a force that is held, from the first contact on; saved as SVG and PNG where a path is
    given."""
    scale = CurveScale.of(Curve(curve.displacement, curve.force) for curve in curves.values()).displacement
    return _over_time({name: (curve.time, curve.displacement) for name, curve in curves.items()}, "Displacement", scale, path)


def _over_time(lines: Mapping[str, tuple[Array, Array]], what: str, scale: Scale, path: str | Path | None) -> Figure:
    """Lines over time, each from zero."""
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(COLUMN, 0.62 * COLUMN), layout="constrained")
        FigureCanvasAgg(figure)
        ax = figure.add_subplot()
        for n, (name, (time, values)) in enumerate(lines.items()):
            time, values = np.append(0.0, time), np.append(0.0, values) * scale.factor
            ax.plot(
                time, values, color=COLOURS[n % len(COLOURS)], linestyle=DASHES[n % len(DASHES)], label=name.replace("$", r"\$")
            )
        ax.set_xlim(left=0)
        ax.set_ylim(bottom=min(0.0, ax.dataLim.y0))
        ax.xaxis.set_major_locator(MaxNLocator(7))
        ax.set_xlabel("Time since contact (s)")
        ax.set_ylabel(f"{what} ({scale.symbol})")
        figure.legend(loc="outside upper left", ncols=2, handlelength=2.8)
        save(figure, path)
    return figure


def fit_over_time(measured: Named, fitted: Named, path: str | Path | None) -> Figure:
    """Measured forces as markers and fitted ones as lines, against the time since the first point of each test; saved as SVG and
    PNG where a path is given. Tests without times are left out.

    measured, fitted: lists of (name of the test, Curve).
    """
    timed = [(name, curve) for name, curve in fitted if curve.time is not None]
    scale, given = CurveScale.of(curve for _, curve in (*timed, *measured)), dict(measured)
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(COLUMN, 0.62 * COLUMN), layout="constrained")
        FigureCanvasAgg(figure)
        ax = figure.add_subplot()
        for n, (name, curve) in enumerate(timed):
            assert curve.time is not None
            colour, time = COLOURS[n % len(COLOURS)], curve.time - curve.time[0]
            ax.plot(time, curve.force * scale.force.factor, color=colour, label=name.replace("$", r"\$"), zorder=3)
            if name in given:
                marks: dict[str, Any] = {
                    "marker": MARKERS[n % len(MARKERS)],
                    "markersize": 3,
                    "linestyle": "none",
                    "markerfacecolor": "none",
                }
                ax.plot(time, given[name].force * scale.force.factor, color=colour, **marks)
        ax.set_xlim(left=0)
        ax.set_ylim(bottom=min(0.0, ax.dataLim.y0))
        ax.xaxis.set_major_locator(MaxNLocator(7))
        ax.set_xlabel("Time (s)")
        ax.set_ylabel(f"Force ({scale.force.symbol})")
        figure.legend(loc="outside upper left", ncols=2, handlelength=2.8)
        save(figure, path)
    return figure
