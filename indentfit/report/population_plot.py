"""The figure of a population of samples."""

import matplotlib
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from indentfit.inference.population_fit import ALL, Population
from indentfit.report.plots import Place, _label, save
from indentfit.report.style import COLOURS, COLUMN, STYLE

APART = 0.16  # between the marks of one sample
MOST_NAMES = 20  # samples whose names are written


def population(result: Population, path: Place = None) -> Figure:
    """A panel for each parameter: every sample alone (open marks) and given all samples (filled), the mean of each group with its
    95 % interval (dark band), and one standard deviation between samples (light band; none where most samples do not determine the
    parameter). Saves path.svg and path.png."""
    assert result.hierarchy is not None  # there is no figure of too few samples
    names = list(result.hierarchy.parameters)
    with matplotlib.rc_context(STYLE):
        width = max(1.0, 0.035 * len(result.hierarchy.shrunken) * len(names)) * COLUMN
        figure = Figure(figsize=(max(width, 0.75 * COLUMN * len(names)), 0.85 * COLUMN), layout="constrained")
        FigureCanvasAgg(figure)
        for axes, name in zip(figure.subplots(1, len(names), squeeze=False)[0], names, strict=True):
            _panel(axes, result, name)
        every = [pair for axes in figure.axes for pair in zip(*axes.get_legend_handles_labels(), strict=True)]
        labels, handles = zip(*{label: handle for handle, label in reversed(every)}.items(), strict=True)
        figure.legend(handles, labels, loc="outside upper left", ncols=2 if len(names) == 1 else 4)
        save(figure, path)
    return figure


def _panel(axes: Axes, result: Population, name: str) -> None:
    assert result.hierarchy is not None
    known, shrunken = result.hierarchy.parameters[name], result.hierarchy.shrunken
    order = sorted(shrunken, key=lambda sample: list(known.mean).index(result.groups[sample]))
    singles = {summary.sample: summary.parameters[name] for summary in result.per_sample.samples if summary.parameters}
    for g, (group, mean) in enumerate(known.mean.items()):
        at = [n for n, sample in enumerate(order) if result.groups[sample] == group]
        ends, colour = (min(at) - 0.5, max(at) + 0.5), COLOURS[g % len(COLOURS)]
        first = g == 0
        axes.fill_between(ends, *mean.interval, color=colour, alpha=0.30, linewidth=0, label="mean, 95 %" if first else None)
        if name not in result.weak:
            low, high = mean.value * (1 - known.sd.value), mean.value * (1 + known.sd.value)
            axes.fill_between(
                ends, low, high, color=colour, alpha=0.10, linewidth=0, label="± sd between samples" if first else None
            )
            axes.plot(ends, [mean.value] * 2, color=colour)
        if group != ALL:
            axes.text(
                sum(ends) / 2, 1.0, _label(group), transform=axes.get_xaxis_transform(), ha="center", color=colour, fontsize=7
            )
        for n in at:
            single, given = singles[order[n]], shrunken[order[n]][name]
            said = first and n == at[0]
            _mark(axes, n - APART, single.value, single.interval, colour, "white", "alone" if said else None)
            _mark(axes, n + APART, given.value, given.interval, colour, colour, "given all samples" if said else None)
    unit = "" if known.unit in ("", "1") else f" ({known.unit})"
    axes.set_ylabel(f"{_label(name)}{unit}")
    axes.set_ylim(bottom=0)
    named = order if len(order) <= MOST_NAMES else []
    axes.set_xticks(range(len(named)), [_label(sample) for sample in named], rotation=90)
    axes.tick_params(axis="x", length=0)


def _mark(
    axes: Axes, x: float, value: float, interval: tuple[float, float] | None, colour: str, face: str, label: str | None
) -> None:
    low, high = interval or (value, value)
    axes.plot([x, x], [low, high], color=colour, linewidth=0.6)
    axes.plot([x], [value], "o", color=colour, markerfacecolor=face, markeredgewidth=0.7, markersize=3, label=label)
