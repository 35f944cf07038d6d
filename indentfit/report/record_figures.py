"""Figures of processed records: each with its contact point and window, and the three panels of Feng et al. 2017, figure 4."""

import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from indentfit.report.style import COLOURS, COLUMN, STYLE

MOST_POINTS = 3000  # of a line: more than a printed column resolves
GREY = "0.6"


def record_figure(outcome):
    """Figure of an Outcome: force and displacement over time, force over displacement, and the hold where it was fitted."""
    done = outcome.processed
    panels = 3 if done.relaxation else 2
    with matplotlib.rc_context(STYLE):
        figure, axes = _figure(panels)
        _over_time(axes[0], done)
        _over_displacement(axes[1], done)
        if done.relaxation:
            _hold(axes[2], done)
        figure.suptitle(_plain(outcome.name), fontsize=8)
    return figure


def replicate_figure(outcomes, statistics, means):
    """Figure of replicates: (a) a typical curve of each direction with its line, (b) stiffnesses, (c) mean curves with fits."""
    with matplotlib.rc_context(STYLE):
        figure, (typical, bars, mean) = _figure(3)
        for n, direction in enumerate(statistics.stiffness):
            _typical(typical, outcomes, statistics, direction, COLOURS[n])
            _mean(mean, means[direction], direction, COLOURS[n])
        _stiffnesses(bars, outcomes, statistics)
        for axes, letter in zip((typical, bars, mean), "abc", strict=True):
            axes.set_title(f"({letter})", loc="left", fontsize=8)
        for axes in (typical, mean):
            _label_curve(axes)
            axes.legend()
    return figure


def _figure(panels):
    figure = Figure(figsize=(panels * 0.95 * COLUMN, 0.8 * COLUMN), layout="constrained")
    FigureCanvasAgg(figure)
    return figure, figure.subplots(1, panels)


def _thinned(*columns):
    step = max(1, len(columns[0]) // MOST_POINTS)
    return [column[::step] for column in columns]


def _over_time(axes, done):
    """The ramp and as much again before and after it, raw and filtered, with contact and window."""
    record, ramp = done.record, done.ramp
    margin = round(ramp.samples)
    part = slice(max(0, done.contact.index - margin), ramp.stop + margin)
    force = record.force[part] - done.contact.baseline - done.contact.drift * record.time[part]
    time = record.time[part]
    axes.axvspan(record.time[done.window.start], record.time[done.window.stop - 1], color="0.92", label="constant velocity")
    axes.plot(*_thinned(time, force), color=GREY, linewidth=0.5)
    axes.plot(*_thinned(time, ramp.force[part] - record.force[part] + force), color=COLOURS[0], label="force")
    axes.axvline(record.time[done.contact.index], color=COLOURS[1], linewidth=0.8, label="contact")
    axes.set_xlabel("Time (s)")
    axes.set_ylabel("Force (mN)")
    other = axes.twinx()
    other.spines["right"].set_visible(True)
    other.plot(
        *_thinned(time, ramp.displacement[part] - done.contact.displacement), color=COLOURS[2], linestyle="--", linewidth=0.8
    )
    other.set_ylabel("Displacement (mm), dashed")
    axes.legend(loc="upper left")


def _over_displacement(axes, done):
    record, start = done.record, max(0, done.contact.index - round(0.5 * done.ramp.samples))
    part = slice(start, done.ramp.stop)
    force = record.force - done.contact.baseline - done.contact.drift * record.time
    displacement = done.ramp.displacement - done.contact.displacement
    axes.plot(displacement[part], force[part], ".", color=GREY, markersize=1.5, label="record")
    axes.plot(done.curve.displacement, done.curve.force, "o", color=COLOURS[0], markerfacecolor="white", label="curve")
    d = displacement[done.window][[0, -1]]
    axes.plot(d, done.line.slope * d + done.line.intercept, color="black", label=f"{done.line.slope:.4g} mN/mm")
    reach = done.contact.uncertainty
    axes.axvspan(-reach, reach, color=COLOURS[1], alpha=0.3, linewidth=0, label=f"contact ± {1e3 * reach:.1f} µm")
    _label_curve(axes)
    axes.legend()


def _hold(axes, done):
    record, ramp = done.record, done.ramp
    time = record.time[ramp.stop :] - record.time[ramp.stop - 1]
    force = record.force[ramp.stop :] - done.contact.baseline - done.contact.drift * record.time[ramp.stop :]
    some = np.unique(np.geomspace(1, time.size, MOST_POINTS).astype(int)) - 1
    axes.semilogx(time[some], force[some], ".", color=GREY, markersize=1.5)
    series = done.relaxation
    label = f"{len(series.shares)} terms, $G_\\infty/G_0$ = {series.ratio:.3f}"
    axes.semilogx(time[some], series.force(time[some]), color=COLOURS[1], label=label)
    axes.set_xlabel("Time of the hold (s)")
    axes.set_ylabel("Force (mN)")
    axes.legend()


def _typical(axes, outcomes, statistics, direction, colour):
    """The record whose stiffness is nearest to the median."""
    group = [one for one in outcomes if one.processed and one.entry.direction == direction]
    one = min(group, key=lambda one: abs(one.processed.line.slope - statistics.stiffness[direction].median))
    done = one.processed
    axes.plot(*_thinned(done.displacement, done.force), color=colour, label=f"{direction}°, {_plain(one.entry.sample)}")
    d = done.ramp.displacement[done.window][[0, -1]] - done.contact.displacement
    axes.plot(d, done.line.slope * d + done.line.intercept, color="black", linewidth=1.4)


def _stiffnesses(axes, outcomes, statistics):
    for n, (direction, spread) in enumerate(statistics.stiffness.items()):
        axes.bar(n, spread.mean, color=COLOURS[n], alpha=0.35, width=0.6)
        if spread.n > 1:
            axes.errorbar(n, spread.mean, spread.sd, color="black", capsize=3, linewidth=0.8)
        group = [one for one in outcomes if one.processed and one.entry.direction == direction]
        places = n + 0.18 * np.linspace(-1, 1, len(group)) if len(group) > 1 else [n]
        for place, one in zip(places, group, strict=True):
            marker = "x" if one.entry.sample in spread.outliers else "o"
            axes.plot(place, one.processed.line.slope, marker, color=COLOURS[n], markersize=2.6)
    axes.set_xticks(range(len(statistics.stiffness)), [f"{one}°" for one in statistics.stiffness])
    axes.set_ylabel("Stiffness (mN/mm)")
    if statistics.differences:
        axes.set_title(f"p = {statistics.differences[0].p:.2g}, {statistics.differences[0].test}", fontsize=6)


def _mean(axes, mean, direction, colour):
    d = mean.displacement
    axes.fill_between(d, mean.force - mean.sd, mean.force + mean.sd, color=colour, alpha=0.15, linewidth=0)
    axes.plot(d, mean.force, "o", color=colour, markerfacecolor="white", label=f"{direction}°: mean ± SD, n = {mean.count}")
    for kind, dashes in (("linear", "-"), ("quadratic", "--")):
        axes.plot(d, mean.target(kind).force, linestyle=dashes, color=colour, label=kind if colour == COLOURS[0] else None)


def _label_curve(axes):
    axes.set_xlabel("Displacement (mm)")
    axes.set_ylabel("Force (mN)")


def _plain(name):
    """A name as matplotlib takes it: no formula in it, and not too long."""
    return (" " if name.startswith("_") else "") + name[:40].replace("$", r"\$")
