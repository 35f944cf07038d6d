"""Figures of processed records: each with its contact point and window, and the three panels of Feng et al. 2017, figure 4."""

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from indentfit.arrays import Array
from indentfit.errors import RecordError
from indentfit.experiment.outcomes import usable
from indentfit.experiment.process_result import ProcessResult
from indentfit.experiment.processed import ProcessedRecord
from indentfit.experiment.relaxation import Prony
from indentfit.experiment.replicates import MeanCurve
from indentfit.report.style import COLOURS, COLUMN, STYLE

MOST_POINTS = 3000  # of a line: more than a printed column resolves
GREY = "0.6"


def process_figure(result: ProcessResult, name: str | None) -> Figure:
    """Figure of the record of that name; without a name that of the replicates, or of the first record where there are none.

    Raises
    ------
    RecordError
        No usable record has that name.
    """
    if name is None and result.means:
        return replicate_figure(result)
    name = next(iter(result.records)) if name is None else name
    if name not in result.records:
        raise RecordError(f"no record {name!r}; the records are {', '.join(result.records)}")
    return record_figure(name, result.records[name])


def record_figure(name: str, record: ProcessedRecord) -> Figure:
    """Figure of a record: force and displacement over time, force over displacement, and the hold where it was fitted."""
    with matplotlib.rc_context(STYLE):
        figure, axes = _figure(3 if record.relaxation else 2)
        _over_time(axes[0], record)
        _over_displacement(axes[1], record)
        if record.relaxation:
            _hold(axes[2], record, record.relaxation)
        figure.suptitle(_plain(name), fontsize=8)
    return figure


def replicate_figure(result: ProcessResult) -> Figure:
    """Figure of replicates: (a) a typical curve of each direction with its line, (b) stiffnesses, (c) mean curves with fits."""
    with matplotlib.rc_context(STYLE):
        figure, (typical, bars, mean) = _figure(3)
        for colour, direction in zip(COLOURS, result.statistics.stiffness, strict=False):
            _typical(typical, result, direction, colour)
            _mean(mean, result.means[direction], direction, colour)
        _stiffnesses(bars, result)
        for axes, letter in zip((typical, bars, mean), "abc", strict=True):
            axes.set_title(f"({letter})", loc="left", fontsize=8)
        for axes in (typical, mean):
            _label_curve(axes)
            axes.legend()
    return figure


def _figure(panels: int) -> tuple[Figure, list[Axes]]:
    figure = Figure(figsize=(panels * 0.95 * COLUMN, 0.8 * COLUMN), layout="constrained")
    FigureCanvasAgg(figure)
    return figure, list(figure.subplots(1, panels))


def _thinned(*columns: Array) -> list[Array]:
    """Columns (n,) thinned to what a figure can show."""
    step = max(1, len(columns[0]) // MOST_POINTS)
    return [column[::step] for column in columns]


def _over_time(axes: Axes, processed: ProcessedRecord) -> None:
    """The ramp and as much again before and after it, raw and filtered, with contact and window."""
    record, ramp = processed.record, processed.ramp
    margin = round(ramp.samples)
    part = slice(max(0, processed.contact.index - margin), ramp.stop + margin)
    force = record.force[part] - processed.contact.baseline - processed.contact.drift * record.time[part]
    time = record.time[part]
    axes.axvspan(
        record.time[processed.window.start], record.time[processed.window.stop - 1], color="0.92", label="constant velocity"
    )
    axes.plot(*_thinned(time, force), color=GREY, linewidth=0.5)
    axes.plot(*_thinned(time, ramp.force[part] - record.force[part] + force), color=COLOURS[0], label="force")
    axes.axvline(record.time[processed.contact.index], color=COLOURS[1], linewidth=0.8, label="contact")
    axes.set_xlabel("Time (s)")
    axes.set_ylabel("Force (mN)")
    other = axes.twinx()
    other.spines["right"].set_visible(True)
    other.plot(
        *_thinned(time, ramp.displacement[part] - processed.contact.displacement), color=COLOURS[2], linestyle="--", linewidth=0.8
    )
    other.set_ylabel("Displacement (mm), dashed")
    axes.legend(loc="upper left")


def _over_displacement(axes: Axes, processed: ProcessedRecord) -> None:
    record, start = processed.record, max(0, processed.contact.index - round(0.5 * processed.ramp.samples))
    part = slice(start, processed.ramp.stop)
    force = record.force - processed.contact.baseline - processed.contact.drift * record.time
    displacement = processed.ramp.displacement - processed.contact.displacement
    axes.plot(displacement[part], force[part], ".", color=GREY, markersize=1.5, label="record")
    axes.plot(processed.curve.displacement, processed.curve.force, "o", color=COLOURS[0], markerfacecolor="white", label="curve")
    d = displacement[processed.window][[0, -1]]
    axes.plot(d, processed.line.slope * d + processed.line.intercept, color="black", label=f"{processed.line.slope:.4g} mN/mm")
    reach = processed.contact.uncertainty
    axes.axvspan(-reach, reach, color=COLOURS[1], alpha=0.3, linewidth=0, label=f"contact ± {1e3 * reach:.1f} µm")
    _label_curve(axes)
    axes.legend()


def _hold(axes: Axes, processed: ProcessedRecord, series: Prony) -> None:
    record, ramp = processed.record, processed.ramp
    time = record.time[ramp.stop :] - record.time[ramp.stop - 1]
    force = record.force[ramp.stop :] - processed.contact.baseline - processed.contact.drift * record.time[ramp.stop :]
    some = np.unique(np.geomspace(1, time.size, MOST_POINTS).astype(int)) - 1
    axes.semilogx(time[some], force[some], ".", color=GREY, markersize=1.5)
    label = f"{len(series.shares)} terms, $G_\\infty/G_0$ = {series.ratio:.3f}"
    axes.semilogx(time[some], series.force(time[some]), color=COLOURS[1], label=label)
    axes.set_xlabel("Time of the hold (s)")
    axes.set_ylabel("Force (mN)")
    axes.legend()


def _typical(axes: Axes, result: ProcessResult, direction: int, colour: str) -> None:
    """The record whose stiffness is nearest to the median."""
    median = result.statistics.stiffness[direction].median
    group = usable(result.outcomes, direction)
    typical = min(group, key=lambda outcome: abs(outcome.processed.line.slope - median))
    processed = typical.processed
    axes.plot(
        *_thinned(processed.displacement, processed.force), color=colour, label=f"{direction}°, {_plain(typical.entry.sample)}"
    )
    d = processed.ramp.displacement[processed.window][[0, -1]] - processed.contact.displacement
    axes.plot(d, processed.line.slope * d + processed.line.intercept, color="black", linewidth=1.4)


def _stiffnesses(axes: Axes, result: ProcessResult) -> None:
    """Bars of the means with their standard deviations, and a mark for each sample."""
    statistics = result.statistics
    for n, (direction, spread) in enumerate(statistics.stiffness.items()):
        axes.bar(n, spread.mean, color=COLOURS[n], alpha=0.35, width=0.6)
        if spread.n > 1:
            axes.errorbar(n, spread.mean, spread.sd, color="black", capsize=3, linewidth=0.8)
        group = usable(result.outcomes, direction)
        places = n + 0.18 * np.linspace(-1, 1, len(group)) if len(group) > 1 else [n]
        for place, outcome in zip(places, group, strict=True):
            marker = "x" if outcome.entry.sample in spread.outliers else "o"
            axes.plot(place, outcome.processed.line.slope, marker, color=COLOURS[n], markersize=2.6)
    axes.set_xticks(range(len(statistics.stiffness)), [f"{direction}°" for direction in statistics.stiffness])
    axes.set_ylabel("Stiffness (mN/mm)")
    if statistics.differences:
        axes.set_title(f"p = {statistics.differences[0].p:.2g}, {statistics.differences[0].test}", fontsize=6)


def _mean(axes: Axes, mean: MeanCurve, direction: int, colour: str) -> None:
    d = mean.displacement
    axes.fill_between(d, mean.force - mean.sd, mean.force + mean.sd, color=colour, alpha=0.15, linewidth=0)
    axes.plot(d, mean.force, "o", color=colour, markerfacecolor="white", label=f"{direction}°: mean ± SD, n = {mean.count}")
    for kind, dashes in (("linear", "-"), ("quadratic", "--")):
        axes.plot(d, mean.target(kind).force, linestyle=dashes, color=colour, label=kind if colour == COLOURS[0] else None)


def _label_curve(axes: Axes) -> None:
    axes.set_xlabel("Displacement (mm)")
    axes.set_ylabel("Force (mN)")


def _plain(name: str) -> str:
    """A name for matplotlib: its dollar signs are no formula, and it is not too long."""
    return (" " if name.startswith("_") else "") + name[:40].replace("$", r"\$")
