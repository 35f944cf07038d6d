"""Figure of the fits of a set of samples: the parameters of each sample side by side."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from indentfit.arrays import Array, Bools
from indentfit.report.plots import TICKS, _label, save
from indentfit.report.style import COLOURS, COLUMN, DASHES, STYLE

MOST_COLUMNS = 3  # panels side by side
ROTATED = 6  # samples, from which on their names are upright


@dataclass(frozen=True, eq=False)
class ParameterPanel:
    """One parameter over the samples.

    Parameters
    ----------
    label : str
        Name and unit.
    values, errors : array (n,)
        NaN where the error is not known.
    converged : bools (n,)
    mean : float or None
        Over the fits that converged.
    """

    label: str
    values: Array
    errors: Array
    converged: Bools
    mean: float | None


def parameters_of_samples(names: Sequence[str], panels: Sequence[ParameterPanel], path: str | Path | None) -> Figure:
    """A panel for each parameter with a mark for each sample: full where the fit converged, empty where it did not.

    Saves path.svg and path.png (any ending of `path` is replaced) where a path is given, and returns the figure.
    """
    columns = min(max(len(panels), 1), MOST_COLUMNS)
    rows = max(-(-len(panels) // columns), 1)
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(COLUMN * (0.45 + 0.55 * columns), 0.66 * COLUMN * rows), layout="constrained")
        FigureCanvasAgg(figure)
        axes = figure.subplots(rows, columns, squeeze=False).ravel()
        for ax, panel in zip(axes, panels, strict=False):
            _draw(ax, names, panel)
        for ax in axes[len(panels) :]:
            ax.set_axis_off()
        save(figure, path)
    return figure


def _draw(ax: Axes, names: Sequence[str], panel: ParameterPanel) -> None:
    at = np.arange(len(names))
    ax.errorbar(at, panel.values, np.nan_to_num(panel.errors), linestyle="none", color=COLOURS[0], linewidth=0.8, capsize=2)
    for chosen, face in ((panel.converged, COLOURS[0]), (~panel.converged, "white")):
        if chosen.any():
            ax.plot(at[chosen], panel.values[chosen], "o", color=COLOURS[0], markerfacecolor=face)
    if panel.mean is not None:
        ax.axhline(panel.mean, color="0.4", linewidth=0.8, linestyle=DASHES[1])
    ax.set_xticks(at, [_label(name) for name in names], rotation=90 if len(names) >= ROTATED else 0)
    ax.set_xlim(-0.5, len(names) - 0.5)
    ax.set_ylabel(_label(panel.label))
    ax.yaxis.set_major_locator(MaxNLocator(5, steps=TICKS))
