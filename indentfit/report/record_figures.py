"""Figures of processed records: each with its contact point and window, and the three panels of Feng et al. 2017, figure 4."""

import textwrap

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from indentfit.arrays import Array
from indentfit.digits import Scale, quantity
from indentfit.errors import RecordError
from indentfit.experiment.contact_point import METHODS, places_by_rules
from indentfit.experiment.outcomes import usable
from indentfit.experiment.process_result import ProcessResult
from indentfit.experiment.processed import ProcessedRecord
from indentfit.experiment.relaxation import Prony
from indentfit.experiment.replicates import MeanCurve
from indentfit.report.digits import CurveScale
from indentfit.report.style import COLOURS, COLUMN, STYLE

MOST_POINTS = 3000  # of a line: more than a printed column resolves
GREY = "0.6"
TALL = 1.05  # height of a record's figure, with the legends below it, in columns
BELOW = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.22), "ncols": 2}  # a legend that hides no samples


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
        figure, axes = _figure(3 if record.relaxation else 2, TALL)
        _over_time(axes[0], record)
        _over_displacement(axes[1], record)
        if record.relaxation:
            _hold(axes[2], record, record.relaxation)
        figure.suptitle("\n".join([_plain(name), *textwrap.wrap(str(record.judgement), 90)]), fontsize=8)
    return figure


def replicate_figure(result: ProcessResult) -> Figure:
    """Figure of replicates: (a) a typical curve of each direction with its line, (b) stiffnesses, (c) mean curves with fits."""
    with matplotlib.rc_context(STYLE):
        figure, (typical, bars, mean) = _figure(3)
        scale = CurveScale.of(mean.target("linear") for mean in result.means.values())
        for colour, direction in zip(COLOURS, result.statistics.stiffness, strict=False):
            _typical(typical, result, direction, colour, scale)
            _mean(mean, result.means[direction], direction, colour, scale)
        _stiffnesses(bars, result)
        for axes, letter in zip((typical, bars, mean), "abc", strict=True):
            axes.set_title(f"({letter})", loc="left", fontsize=8)
        for axes in (typical, mean):
            _label_curve(axes, scale)
            axes.legend()
    return figure


def _figure(panels: int, height: float = 0.8) -> tuple[Figure, list[Axes]]:
    figure = Figure(figsize=(panels * 0.95 * COLUMN, height * COLUMN), layout="constrained")
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
    force = record.force[part] - processed.contact.free(record.time[part], ramp.displacement[part])
    time = record.time[part]
    scale = CurveScale.of([processed.curve])
    force = scale.force.factor * force
    axes.axvspan(
        record.time[processed.window.start], record.time[processed.window.stop - 1], color="0.92", label="constant velocity"
    )
    axes.plot(*_thinned(time, force), color=GREY, linewidth=0.5)
    filtered = scale.force.factor * (ramp.force[part] - record.force[part]) + force
    axes.plot(*_thinned(time, filtered), color=COLOURS[0], label="force")
    axes.axvline(record.time[processed.contact.index], color=COLOURS[1], linewidth=0.8, label="contact")
    axes.set_xlabel("Time (s)")
    axes.set_ylabel(f"Force ({scale.force.symbol})")
    other = axes.twinx()
    other.spines["right"].set_visible(True)
    depth = scale.displacement.factor * (ramp.displacement[part] - processed.contact.displacement)
    other.plot(*_thinned(time, depth), color=COLOURS[2], linestyle="--", linewidth=0.8)
    other.set_ylabel(f"Displacement ({scale.displacement.symbol}), dashed")
    axes.legend(**BELOW)


def _over_displacement(axes: Axes, processed: ProcessedRecord) -> None:
    record, start = processed.record, max(0, processed.contact.index - round(0.5 * processed.ramp.samples))
    part = slice(start, processed.ramp.stop)
    force = record.force - processed.contact.free(record.time, processed.ramp.displacement)
    displacement = processed.ramp.displacement - processed.contact.displacement
    scale = CurveScale.of([processed.curve])
    long, strong = scale.displacement.factor, scale.force.factor
    axes.plot(long * displacement[part], strong * force[part], ".", color=GREY, markersize=1.5, label="record")
    curve = scale.scaled(processed.curve)
    axes.plot(curve.displacement, curve.force, "o", color=COLOURS[0], markerfacecolor="white", label="curve")
    d = displacement[processed.window][[0, -1]]
    line = strong * (processed.line.slope * d + processed.line.intercept)
    axes.plot(long * d, line, color="black", label=f"{processed.line.slope:.4g} mN/mm")
    reach = processed.contact.uncertainty
    words = quantity(reach, "mm", 2).replace("um", "µm")
    axes.axvspan(-long * reach, long * reach, color=COLOURS[1], alpha=0.3, linewidth=0, label=f"contact ± {words}")
    _judged(axes, processed, long)
    _label_curve(axes, scale)
    axes.legend(**BELOW)


def _judged(axes: Axes, processed: ProcessedRecord, long: float) -> None:
    """The force's zero, the stretch that the contact point was fitted to, and where other methods put it."""
    contact, last = processed.contact, axes.get_xlim()
    axes.axhline(0, color="black", linewidth=0.6, linestyle=":", label="zero of the force")
    if contact.stretch:
        begin, end = (long * (place - contact.displacement) for place in contact.stretch)
        axes.axvspan(max(begin, last[0]), end, ymax=0.03, color=COLOURS[2], alpha=0.5, linewidth=0, label="fitted stretch")
    rules = places_by_rules(processed.ramp) if contact.method in METHODS else {}  # the rules need an approach
    for dashes, (method, place) in zip(("--", "-."), rules.items(), strict=False):
        where = long * (place - contact.displacement)
        if last[0] < where < last[1]:
            axes.axvline(where, color="0.4", linestyle=dashes, linewidth=0.7, label=method.replace("_", " "))
    axes.set_xlim(*last)


def _hold(axes: Axes, processed: ProcessedRecord, series: Prony) -> None:
    record, ramp = processed.record, processed.ramp
    time = record.time[ramp.stop :] - record.time[ramp.stop - 1]
    force = record.force[ramp.stop :] - processed.contact.free(record.time[ramp.stop :], ramp.displacement[ramp.stop :])
    scale = Scale.of([float(np.abs(force).max())], "mN")
    some = np.unique(np.geomspace(1, time.size, MOST_POINTS).astype(int)) - 1
    axes.semilogx(time[some], scale.factor * force[some], ".", color=GREY, markersize=1.5)
    label = f"{len(series.shares)} terms, $G_\\infty/G_0$ = {series.ratio:.3f}"
    axes.semilogx(time[some], scale.factor * series.force(time[some]), color=COLOURS[1], label=label)
    axes.set_xlabel("Time of the hold (s)")
    axes.set_ylabel(f"Force ({scale.symbol})")
    axes.legend()


def _typical(axes: Axes, result: ProcessResult, direction: int, colour: str, scale: CurveScale) -> None:
    """The record whose stiffness is nearest to the median."""
    median = result.statistics.stiffness[direction].median
    group = usable(result.outcomes, direction)
    typical = min(group, key=lambda outcome: abs(outcome.processed.line.slope - median))
    processed = typical.processed
    long, strong = scale.displacement.factor, scale.force.factor
    columns = _thinned(long * processed.displacement, strong * processed.force)
    axes.plot(*columns, color=colour, label=f"{direction}°, {_plain(typical.entry.sample)}")
    d = processed.ramp.displacement[processed.window][[0, -1]] - processed.contact.displacement
    axes.plot(long * d, strong * (processed.line.slope * d + processed.line.intercept), color="black", linewidth=1.4)


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


def _mean(axes: Axes, mean: MeanCurve, direction: int, colour: str, scale: CurveScale) -> None:
    d, strong = scale.displacement.factor * mean.displacement, scale.force.factor
    low, high = strong * (mean.force - mean.sd), strong * (mean.force + mean.sd)
    axes.fill_between(d, low, high, color=colour, alpha=0.15, linewidth=0)
    axes.plot(
        d, strong * mean.force, "o", color=colour, markerfacecolor="white", label=f"{direction}°: mean ± SD, n = {mean.count}"
    )
    for kind, dashes in (("linear", "-"), ("quadratic", "--")):
        axes.plot(d, strong * mean.target(kind).force, linestyle=dashes, color=colour, label=kind if colour == COLOURS[0] else None)


def _label_curve(axes: Axes, scale: CurveScale) -> None:
    axes.set_xlabel(f"Displacement ({scale.displacement.symbol})")
    axes.set_ylabel(f"Force ({scale.force.symbol})")


def _plain(name: str) -> str:
    """A name for matplotlib: its dollar signs are no formula, and it is not too long."""
    return (" " if name.startswith("_") else "") + name[:40].replace("$", r"\$")
