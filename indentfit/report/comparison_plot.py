"""The figure of a comparison of laws."""

import itertools
from collections.abc import Mapping, Sequence

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from indentfit.arrays import Array
from indentfit.digits import Scale
from indentfit.report.plots import TICKS, Place, _label, save
from indentfit.report.style import COLOURS, COLUMN, DASHES, STYLE

LEAST = 3.0  # %: half the height of the axes at least
TIMES = 4.0  # height over what the best law leaves: laws that are far off leave the axes
MOST_TESTS = 4  # panels
SHORTEST = 28  # letters of a law's name beside its bar


def laws(
    depths: Mapping[str, Array],
    left: Mapping[str, Mapping[str, Array]],
    bars: Sequence[tuple[str, float]],
    threshold: float,
    path: Place = None,
) -> Figure:
    """What each law leaves of each curve, and how far its log evidence is below the best.

    depths: test -> displacements, mm; left: test -> law -> fitted minus measured force, percent of the largest; bars: (law, log
    evidence below the best), best first; threshold: dashed line. Saves path.svg and path.png and returns the figure.
    """
    tests = list(depths)[:MOST_TESTS]
    scale = Scale.of([float(value) for name in tests for value in depths[name]], "mm")
    looks = dict(zip([law for law, _ in bars], itertools.cycle(zip(COLOURS, DASHES, strict=True)), strict=False))
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(2 * COLUMN, 0.62 * COLUMN + 0.12 * len(bars)), layout="constrained")
        FigureCanvasAgg(figure)
        panels = figure.subplots(1, len(tests) + 1, squeeze=False)[0]
        for axes, name in zip(panels, tests, strict=False):
            _curves(axes, name, scale, depths[name], left[name], looks)
        panels[0].set_ylabel("Fitted − measured force\n(% of the largest)")
        _bars(panels[-1], bars, threshold, looks)
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper left", ncols=3, handlelength=2.8)
        save(figure, path)
    return figure


Looks = Mapping[str, tuple[str, object]]


def _curves(axes: Axes, name: str, scale: Scale, depth: Array, left: Mapping[str, Array], looks: Looks) -> None:
    best = next(iter(left.values()), np.zeros(1))
    top = max(LEAST, TIMES * float(np.abs(best).max()))
    top = min(top, max(LEAST, 1.1 * max(float(np.abs(row).max()) for row in left.values())))
    for n, (law, row) in enumerate(left.items()):
        colour, dashes = looks[law]
        axes.plot(depth * scale.factor, row, color=colour, linestyle=dashes, label=_label(law), zorder=5 - 0.1 * n)  # type: ignore[arg-type]
    axes.axhline(0, color="0.4", linewidth=0.6, zorder=0)
    axes.set_ylim(-top, top)
    axes.set_xlim(left=0)
    axes.set_title(_label(name), fontsize=8)
    axes.set_xlabel(f"Displacement ({scale.symbol})")
    axes.xaxis.set_major_locator(MaxNLocator(5, steps=TICKS))


def _bars(axes: Axes, bars: Sequence[tuple[str, float]], threshold: float, looks: Looks) -> None:
    values = [below for _, below in bars]
    names = [law if len(law) <= SHORTEST else f"{law[: SHORTEST - 1]}…" for law, _ in bars]
    drawn = axes.barh(range(len(bars)), values, color=[looks[law][0] for law, _ in bars], height=0.65)
    axes.bar_label(drawn, fmt="%.1f", padding=2, fontsize=6.5)
    axes.axvline(threshold, color="0.4", linewidth=0.8, linestyle=DASHES[1])
    axes.set_yticks(range(len(bars)), [_label(name) for name in names])
    axes.invert_yaxis()
    axes.set_xlim(0, max(1.2 * max(values), 1.5 * threshold))
    axes.tick_params(axis="y", length=0)
    axes.set_xlabel("Log evidence below best\n(dashed: less cannot tell)")
    axes.xaxis.set_major_locator(MaxNLocator(4, steps=TICKS))
