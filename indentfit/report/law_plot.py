"""Figure of the law's misfit along each curve, with its band, where that is a term of a fit."""

from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from indentfit.curve import Curve
from indentfit.inference.law_misfit import LawMisfit
from indentfit.inference.result import FitResult
from indentfit.report.digits import CurveScale
from indentfit.report.plots import TICKS, save
from indentfit.report.style import COLOURS, COLUMN, STYLE


def law_misfits(result: FitResult, path: str | Path | None = None) -> Figure:
    """A panel for each test: by what the force exceeds the law's, its mean and its 95 % band; saved as SVG and PNG under a path."""
    known: LawMisfit | None = result.law_misfit
    assert known is not None  # or there is nothing to draw
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(COLUMN, 0.55 * COLUMN * len(known.tests)), layout="constrained")
        FigureCanvasAgg(figure)
        panels = figure.subplots(len(known.tests), 1, squeeze=False).ravel()
        for ax, (name, band) in zip(panels, known.tests.items(), strict=True):
            axes = result.curves[name].axes if name in result.curves else None
            low, high, middle = (
                Curve(np.array(band.displacement), np.array(row), axes=axes)
                for row in (band.misfit_low, band.misfit_high, band.misfit)
            )
            scale = CurveScale.of([low, high])
            low, high, middle = scale.scaled(low), scale.scaled(high), scale.scaled(middle)
            ax.fill_between(middle.displacement, low.force, high.force, color=COLOURS[0], alpha=0.2, linewidth=0)
            ax.plot(middle.displacement, middle.force, color=COLOURS[0])
            ax.axhline(0, color="0.4", linewidth=0.6)
            ax.set_xlabel(scale.across)
            ax.set_ylabel(f"Beyond the law ({scale.force.symbol})")
            ax.set_title(name)
            ax.xaxis.set_major_locator(MaxNLocator(5, steps=TICKS))
            ax.yaxis.set_major_locator(MaxNLocator(5, steps=TICKS))
        save(figure, path)
    return figure
