"""Figures, as SVG and PNG: drawn without a display, for one column of a journal."""

from __future__ import annotations

import itertools
import textwrap
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from indentfit.arrays import Array
from indentfit.axes import INDENTATION, MOTION
from indentfit.curve import Curve
from indentfit.inference.result import FitResult, ParameterEstimate, Profile
from indentfit.report.digits import CurveScale
from indentfit.report.style import COLOURS, COLUMN, DASHES, MARKERS, PNG, STYLE
from indentfit.report.typeset import symbol, typeset

if TYPE_CHECKING:  # a drawing process need not load the search
    from indentfit.study.design import Design

Named = Sequence[tuple[str, Curve]]  # tests by name
Place = str | Path | None  # saved with the endings .svg and .png, nowhere for None
Look = tuple[str, str, Any]  # colour, marker, dashes
Looks = dict[str, Look]

TICKS = (1, 2, 2.5, 5, 10)
SHORT = 24  # letters of a name that leave room for another column of the legend
MARKED = 30  # approximate number of markers on a curve: more would touch each other
WIDEST_LABEL = 52  # letters
SMALL = {"markersize": 2.4, "markeredgewidth": 0.6}


def force_displacement(measured: Named, simulated: Named, path: Place, synthetic: Collection[str] = ()) -> Figure:
    """Measured curves as markers, simulated ones as lines; below, simulated minus measured where both are given. Of curves with
    times, the loading is shown.

    measured, simulated: lists of (name of the test, Curve); a test has one colour in both. synthetic: names of the tests whose
    curves were computed and not measured. Saves path.svg and path.png (any ending of `path` is replaced) and returns the figure.
    """
    simulated, measured = ([(name, curve) for name, curve in curves if curve.shown != MOTION] for curves in (simulated, measured))
    if own := {name for name, _ in measured if name in synthetic and len(synthetic) < len(measured)}:
        simulated, measured = (
            [(f"{name} (synthetic)" if name in own else name, curve) for name, curve in curves] for curves in (simulated, measured)
        )
    marks = "synthetic" if synthetic and not own else "measured"
    simulated, measured = ([(name, curve.loading) for name, curve in curves] for curves in (simulated, measured))
    shown = list(dict.fromkeys(curve.shown for _, curve in (*simulated, *measured))) or [INDENTATION]
    names = list(dict.fromkeys(name for name, _ in [*simulated, *measured]))
    dashes = ("-",) * len(COLOURS) if measured else DASHES  # markers distinguish the tests, so that dashes are not needed
    looks = dict(zip(names, itertools.cycle(zip(COLOURS, MARKERS, dashes, strict=True)), strict=False))
    paired = {name for name, _ in simulated} & {name for name, _ in measured}
    with matplotlib.rc_context(STYLE):
        figure, panels = _axes(bool(paired), names, len(shown))
        for axes, (upper, lower) in zip(shown, panels, strict=True):
            ours, given = ([(name, curve) for name, curve in curves if curve.shown == axes] for curves in (simulated, measured))
            _draw(upper, lower, given, ours, looks)
        drawn = [kind for kind, curves in ((marks, measured), ("simulated", simulated)) if curves]
        _legend(figure, names, looks, drawn)
        save(figure, path)
    return figure


def _draw(upper: Axes, lower: Axes | None, measured: Named, simulated: Named, looks: Looks) -> None:
    """The curves that show the same quantities."""
    scale = CurveScale.of(curve for _, curve in (*simulated, *measured))
    simulated, measured = ([(name, scale.scaled(curve)) for name, curve in curves] for curves in (simulated, measured))
    for name, curve in simulated:
        colour, _, style = looks[name]
        upper.plot(*_from_origin(curve), color=colour, linestyle=style, zorder=3)
    for name, curve in measured:
        upper.plot(curve.displacement, curve.force, markevery=_every(curve), zorder=2, **_markers(looks[name]))
    for name, given, curve in [(name, dict(measured)[name], curve) for name, curve in simulated if name in dict(measured)]:
        colour, _, _ = looks[name]
        assert lower is not None  # there are pairs
        displacement, difference = residual(given, curve)
        lower.plot(displacement, difference, color=colour, linewidth=0.5)
        lower.plot(displacement, difference, markevery=_every(given), **_markers(looks[name]) | SMALL)
    _finish((upper, lower))
    _label_units(upper, lower, scale)


def profile(name: str, known: Profile, parameter: ParameterEstimate) -> Figure:
    """The profile likelihood of one parameter: chi2 against its value, the limit of 95 %, and the runs."""
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(COLUMN, 0.62 * COLUMN), layout="constrained")
        FigureCanvasAgg(figure)
        axes = figure.add_subplot()
        _profile(axes, name, known, parameter)
        axes.set_ylabel("χ² above the least")
    return figure


def profiles(result: FitResult, path: Place = None) -> Figure:
    """Profile likelihoods of a fit, one panel for each parameter: chi2 against its value, the limit of 95 %, and the runs."""
    columns = min(len(result.profiles), 3)
    rows = -(-len(result.profiles) // columns)
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(COLUMN * (0.45 + 0.55 * columns), 0.62 * COLUMN * rows), layout="constrained")
        FigureCanvasAgg(figure)
        axes = figure.subplots(rows, columns, squeeze=False).ravel()
        for ax, (name, profile) in zip(axes, result.profiles.items(), strict=False):
            _profile(ax, name, profile, result.parameters[name])
        for ax in axes[len(result.profiles) :]:
            ax.set_axis_off()
        for ax in axes[::columns]:
            ax.set_ylabel("χ² above the least")
        save(figure, path)
    return figure


def _profile(ax: Axes, name: str, profile: Profile, parameter: ParameterEstimate) -> None:
    chi2 = corrected(profile, parameter.value)
    top = 2 * profile.limit if profile.limit else max(float(np.nanmax(chi2)), 1e-12)
    ax.plot(profile.values, chi2, color=COLOURS[0])
    if profile.limit:
        ax.axhline(profile.limit, color="0.4", linewidth=0.6, linestyle=DASHES[1])
    for ends in parameter.pieces or (parameter.interval or profile.interval,) if profile.joint else (profile.interval,):
        ax.axvspan(*ends, color=COLOURS[0], alpha=0.12, linewidth=0)
    ax.axvline(parameter.value, color="0.4", linewidth=0.6)
    # a marker is not clipped: one far above the axes would leave no room for them
    runs = [(point.value, point.chi2) for point in profile.confirmed if point.chi2 is not None and point.chi2 <= top]
    if runs:  # markers without any, not clipped, count as one at the figure's corner
        marks = _markers((COLOURS[1], "o", "")) | {"zorder": 3}
        ax.plot([value for value, _ in runs], [height for _, height in runs], **marks)
    ax.set_ylim(-0.04 * top, top)
    unit = "" if parameter.unit in ("", "1") else f" ({parameter.unit})"
    ax.set_xlabel(_label(symbol(name)) + unit)
    ax.xaxis.set_major_locator(MaxNLocator(5, steps=TICKS))


def corrected(profile: Profile, best: float) -> Array:
    """chi2 (n,) of a profile, by the surrogate, moved to the runs that confirm it.

    Between the optimum and the nearest run on its side it is multiplied by their ratio, so that it rises as before; farther out
    it is moved by the runs' differences, linear between them, and by the last one's beyond it.
    """
    values = np.array(profile.values, dtype=float)
    chi2 = np.array([np.nan if value is None else value for value in profile.chi2], dtype=float)
    known = np.isfinite(chi2)
    if not known.any():
        return chi2
    drawn = chi2.copy()
    for sign in (-1, 1):
        side = sign * (values - best) > 0
        confirmed = [(point.value, point.chi2) for point in profile.confirmed if point.chi2 is not None]
        runs = sorted((sign * (value - best), value, height) for value, height in confirmed if sign * (value - best) > 0)
        if not runs or not side.any():
            continue
        away, guesses = np.array([run[0] for run in runs]), np.interp([run[1] for run in runs], values[known], chi2[known])
        off = np.array([run[2] for run in runs]) - guesses
        distances = np.abs(values[side] - best)
        share = np.minimum(chi2[side] / guesses[0], 1.0) if guesses[0] > 0 else np.minimum(distances / away[0], 1.0)
        within = distances < away[0]
        drawn[side] = chi2[side] + np.where(within, share * off[0], np.interp(distances, away, off))
    return np.maximum(drawn, 0.0)


def correlations(names: Sequence[str], matrix: Sequence[Sequence[float | None]], path: Place) -> Figure:
    """The correlation matrix of the estimates, (n, n), each entry with its number. Saves as above."""
    values = np.array([[np.nan if x is None else x for x in row] for row in matrix], dtype=float)
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(0.75 * COLUMN, 0.6 * COLUMN), layout="constrained")
        FigureCanvasAgg(figure)
        ax = figure.add_subplot()
        image = ax.imshow(values, vmin=-1, vmax=1, cmap="RdBu_r")
        for (i, j), value in np.ndenumerate(values):
            text = "?" if np.isnan(value) else typeset(f"{value:.2f}")
            ax.text(j, i, text, ha="center", va="center", color="white" if abs(value) > 0.6 else "black")
        ax.set_xticks(range(len(names)), [_label(symbol(name)) for name in names])
        ax.set_yticks(range(len(names)), [_label(symbol(name)) for name in names])
        ax.tick_params(length=0)
        figure.colorbar(image, label="correlation", ticks=[-1, 0, 1])
        save(figure, path)
    return figure


def designs(design: Design, path: Place = None, shown: int = 12) -> Figure:
    """Bars: half width of the worst parameter's 95 % interval with each further test, best above; the dashed line is without."""
    worst = design.worst
    rows = [(test, widths[worst]) for test in design.candidates if (widths := design.widths(test))][:shown][::-1]
    names = [test.words if test.angle is None else f"{test.words}, {test.angle}°, {test.depth:.3g} mm" for test, _ in rows]
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(1.4 * COLUMN, 0.25 * COLUMN + 0.2 * len(rows)), layout="constrained")
        FigureCanvasAgg(figure)
        ax = figure.add_subplot()
        ax.barh(range(len(rows)), [error for _, error in rows], color=COLOURS[0], height=0.65)
        ax.axvline((design.widths() or {})[worst], color="0.4", linewidth=0.8, linestyle=DASHES[1])
        ax.set_yticks(range(len(rows)), [_label(name) for name in names])
        ax.xaxis.set_major_locator(MaxNLocator(4, steps=TICKS))
        ax.set_xlabel(f"Half width of the 95 % interval of {_label(symbol(worst))}")
        save(figure, path)
    return figure


def residual(measured: Curve, simulated: Curve) -> tuple[Array, Array]:
    """Displacements that both curves reach, of the measured one (n,), and simulated minus measured force there (n,)."""
    d, F = _from_origin(simulated)
    within = measured.displacement <= d[-1] * (1 + 1e-9)
    return measured.displacement[within], np.interp(measured.displacement, d, F)[within] - measured.force[within]


def save(figure: Figure, path: Place) -> None:
    """Write the figure as SVG and as PNG; the same figure gives the same bytes. Nothing where the path is None."""
    if path is None:
        return
    path = Path(path)
    figure.savefig(path.with_suffix(".svg"), metadata={"Date": None})
    figure.set_layout_engine("none")  # the places of everything are those of the SVG from now on
    figure.savefig(path.with_suffix(".png"), metadata={"Software": None}, pil_kwargs=PNG)


def _axes(with_residuals: bool, names: Sequence[str], columns: int) -> tuple[Figure, list[tuple[Axes, Axes | None]]]:
    """A figure with upper and lower axes for each kind of curves."""
    height = (0.84 if with_residuals else 0.68) * COLUMN + 0.15 * _legend_lines(names)
    figure = Figure(figsize=(COLUMN * (1 + 0.8 * (columns - 1)), height), layout="constrained")
    FigureCanvasAgg(figure)
    if not with_residuals:
        return figure, [(axes, None) for axes in figure.subplots(1, columns, squeeze=False)[0]]
    rows = figure.subplots(2, columns, sharex="col", height_ratios=(2.6, 1), squeeze=False)
    return figure, list(zip(*rows, strict=True))


def _legend_lines(names: Sequence[str]) -> int:
    return max(2, sum(1 + len(name) // WIDEST_LABEL for name in names)) + 2 * (max(map(len, names)) > SHORT)


def _from_origin(curve: Curve) -> tuple[Array, Array]:
    """Displacement and force, with the untouched sample, where the force is zero, in front."""
    d, F = curve.displacement, curve.force
    return (d, F) if d[0] <= 0 else (np.concatenate([[0.0], d]), np.concatenate([[0.0], F]))


def _every(curve: Curve) -> int:
    return max(1, round(curve.force.size / MARKED))


def _markers(look: Look) -> dict[str, Any]:
    colour, marker, _ = look
    edge = {"markerfacecolor": "white", "markeredgewidth": 0.7}
    return {"linestyle": "none", "marker": marker, "color": colour, "clip_on": False, **edge}


def _finish(axes: tuple[Axes, Axes | None]) -> None:
    """Axes from the origin, with few ticks."""
    upper, lower = axes
    upper.set_xlim(left=0)
    upper.set_ylim(bottom=min(0.0, upper.dataLim.y0))
    upper.yaxis.set_major_locator(MaxNLocator(6, steps=TICKS))
    bottom = upper if lower is None else lower
    bottom.xaxis.set_major_locator(MaxNLocator(7, steps=TICKS))
    if lower is not None:
        lower.axhline(0, color="0.4", linewidth=0.6, zorder=0)
        lower.margins(y=0.15)
        lower.yaxis.set_major_locator(MaxNLocator(4, steps=TICKS))


def _label_units(upper: Axes, lower: Axes | None, scale: CurveScale) -> None:
    """What the axes show, in their units."""
    upper.set_ylabel(scale.up)
    (upper if lower is None else lower).set_xlabel(scale.across)
    if lower is not None:
        lower.set_ylabel(f"Residual\n({scale.force.symbol})")
        upper.figure.align_ylabels([upper, lower])


def _legend(figure: Figure, names: Sequence[str], looks: Looks, drawn: Sequence[str]) -> None:
    """Legend above the axes: the look of each test, and beside the tests, or below long names, the meaning of markers and lines."""
    tests = [(_example(looks[name], drawn), _label(name)) for name in names]
    marks = {"linestyle": "none", **_markers(("0.3", "o", ""))}
    kinds: dict[str, dict[str, Any]] = {"measured": marks, "synthetic": marks, "simulated": {"color": "0.3"}}
    meanings = [(Line2D([], [], **kinds[kind]), kind) for kind in drawn if len(drawn) > 1]
    rows, columns = [*tests, *meanings], 1
    if max(map(len, names)) <= SHORT:  # side by side: both columns padded to the same length
        height, columns = max(len(tests), len(meanings)), 2
        blank = (Line2D([], [], linestyle="none"), "")
        rows = [row for part in (tests, meanings) for row in part + [blank] * (height - len(part))]
    handles, labels = zip(*rows, strict=True)
    figure.legend(handles, labels, loc="outside upper left", ncols=columns, handlelength=2.8, borderaxespad=0.2)


def _example(look: Look, drawn: Sequence[str]) -> Line2D:
    colour, _, dashes = look
    line = {"color": colour, "linestyle": dashes if "simulated" in drawn else "none"}
    return Line2D([], [], **((_markers(look) | line) if {"measured", "synthetic"} & {*drawn} else line))


def _label(name: str) -> str:
    """A name as matplotlib takes it: not too wide, no formula in it, and not hidden for a leading underscore."""
    return (" " if name.startswith("_") else "") + "\n".join(textwrap.wrap(name, WIDEST_LABEL)).replace("$", r"\$")
