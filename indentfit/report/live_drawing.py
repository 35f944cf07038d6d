"""Small line drawings as SVG text, made in a millisecond: a page that is drawn anew every other second needs no matplotlib."""

from __future__ import annotations

from dataclasses import dataclass
from html import escape

import numpy as np

from indentfit.arrays import Array

WIDTH, HEIGHT = 400, 250
LEFT, RIGHT, TOP, BOTTOM = 62, 10, 26, 44
TICKS = 5
DOT = "m-2 0a2 2 0 1 0 4 0a2 2 0 1 0 -4 0"  # a circle about the point before
MOST = 400  # points of a line
COLOURS = ("#1b1f24", "#0a58a6", "#a02622")


@dataclass(frozen=True, eq=False)
class Line:
    """A line, or dots, with a name in the legend: x and y (n,)."""

    name: str
    x: Array
    y: Array
    dots: bool = False


@dataclass(frozen=True)
class _Frame:
    """The ranges of a drawing."""

    low: tuple[float, float]
    high: tuple[float, float]

    def place(self, x: Array, y: Array) -> tuple[Array, Array]:
        """Pixels of points."""
        across = LEFT + (x - self.low[0]) / (self.high[0] - self.low[0]) * (WIDTH - LEFT - RIGHT)
        down = HEIGHT - BOTTOM - (y - self.low[1]) / (self.high[1] - self.low[1]) * (HEIGHT - TOP - BOTTOM)
        return across, down


def drawing(lines: list[Line], across: str, upward: str, zero: bool = False) -> str:
    """SVG of lines over one pair of axes.

    Parameters
    ----------
    lines : list of Line
    across, upward : str
        Labels of the axes.
    zero : bool
        Whether the line of zero is drawn.
    """
    x, y = (np.concatenate([getattr(line, axis) for line in lines]) for axis in "xy")
    frame = _frame(x, np.append(y, 0.0) if zero else y)
    parts = [*_axes(frame, across, upward)]
    if zero:
        ends, level = frame.place(np.array([frame.low[0], frame.high[0]]), np.zeros(2))
        parts.append(f'<path d="M{ends[0]:.1f} {level[0]:.1f}H{ends[1]:.1f}" fill="none" stroke="#4a525c" stroke-dasharray="4 3"/>')
    for n, line in enumerate(lines):
        parts += _drawn(line, frame, COLOURS[n % len(COLOURS)], n)
    name = escape(f"{upward} over {across}: {', '.join(line.name for line in lines)}", quote=True)
    return (
        f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}" height="{HEIGHT}" role="img" aria-label="{name}" font-size="12" '
        f'font-family="sans-serif">{"".join(parts)}</svg>'
    )


def _frame(x: Array, y: Array) -> _Frame:
    low, high = [], []
    for values in (x, y):
        known = values[np.isfinite(values)]
        least, most = (float(known.min()), float(known.max())) if known.size else (0.0, 1.0)
        margin = 0.05 * (most - least) or 0.05 * abs(most) or 1.0
        low.append(least - margin)
        high.append(most + margin)
    return _Frame((low[0], low[1]), (high[0], high[1]))


def _axes(frame: _Frame, across: str, upward: str) -> list[str]:
    parts = [f'<path d="M{LEFT} {TOP}V{HEIGHT - BOTTOM}H{WIDTH - RIGHT}" fill="none" stroke="#1b1f24"/>']
    for value in _ticks(frame.low[0], frame.high[0]):
        place = frame.place(np.array([value]), np.array([frame.low[1]]))[0][0]
        parts.append(f'<path d="M{place:.1f} {HEIGHT - BOTTOM}v4" fill="none" stroke="#1b1f24"/>')
        parts.append(_word(place, HEIGHT - BOTTOM + 17, f"{value:.4g}", "middle"))
    for value in _ticks(frame.low[1], frame.high[1]):
        place = frame.place(np.array([frame.low[0]]), np.array([value]))[1][0]
        parts.append(f'<path d="M{LEFT} {place:.1f}h-4" fill="none" stroke="#1b1f24"/>')
        parts.append(_word(LEFT - 7, place + 4, f"{value:.4g}", "end"))
    parts.append(_word((LEFT + WIDTH - RIGHT) / 2, HEIGHT - 8, across, "middle"))
    middle = (TOP + HEIGHT - BOTTOM) / 2
    parts.append(
        f'<text transform="translate(13 {middle:.0f}) rotate(-90)" text-anchor="middle" fill="#1b1f24">{escape(upward)}</text>'
    )
    return parts


def _ticks(low: float, high: float) -> list[float]:
    """Round numbers within a range."""
    rough = (high - low) / TICKS
    power = 10.0 ** np.floor(np.log10(rough))
    step = float(next(power * size for size in (1, 2, 5, 10) if power * size >= rough))
    count = np.arange(np.ceil(low / step), np.floor(high / step) + 1)
    return [float(number * step) + 0.0 for number in count]


def _drawn(line: Line, frame: _Frame, colour: str, number: int) -> list[str]:
    kept = np.isfinite(line.x) & np.isfinite(line.y)
    every = max(1, int(np.count_nonzero(kept)) // MOST)
    x, y = frame.place(line.x[kept][::every], line.y[kept][::every])
    points = list(zip(x.tolist(), y.tolist(), strict=True))
    start = LEFT + 150 * number
    if line.dots:
        marks = "".join(f"M{a:.1f} {b:.1f}{DOT}" for a, b in points)
        shape, key = f'fill="{colour}"', f"M{start + 8} 14{DOT}"
    else:
        marks = "M" + "L".join(f"{a:.1f} {b:.1f}" for a, b in points) if points else ""
        shape, key = f'fill="none" stroke="{colour}" stroke-width="1.8"', f"M{start} 14h16"
    return [f'<path d="{marks}" {shape}/>', f'<path d="{key}" {shape}/>', _word(start + 21, 18, line.name, "start")]


def _word(x: float, y: float, text: str, anchor: str) -> str:
    shown = text.replace("-", "−") if text[:1] == "-" else text
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" fill="#1b1f24">{escape(shown)}</text>'
