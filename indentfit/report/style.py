"""How figures look: sizes of a journal's column, colours that the colour-blind can tell apart."""

from typing import Any

PIXELS = 1.6  # of a page, for a point of a figure: text of 8 points is 13 pixels high, on every figure
DOTS = 220  # of an inch of the pictures of stresses
# Runs of equal pixels alone (zlib's strategy 3): 5 to 19 % larger files than by the usual level 6, in 0.3 to 0.7 of its time.
PNG = {"compress_level": 1, "compress_type": 3}
COLUMN = 90 / 25.4  # inches: one column of a journal
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000")  # Okabe and Ito 2008
MARKERS = ("o", "s", "^", "D", "v", "P", "X")
DASHES = ("-", (0, (5, 1.5)), (0, (1, 1)), (0, (5, 1.5, 1, 1.5)), (0, (3, 1)), (0, (7, 2)), (0, (1, 2)))
STYLE: dict[Any, Any] = {  # matplotlib types its keys
    "font.family": "sans-serif",
    "font.size": 8,
    "axes.labelsize": 8,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "axes.titlesize": 8,
    "figure.titlesize": 8,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.major.size": 2.5,
    "ytick.major.size": 2.5,
    "legend.fontsize": 8,
    "legend.frameon": False,
    "lines.linewidth": 1.0,
    "lines.markersize": 3.4,
    "savefig.dpi": 400,
    "svg.hashsalt": "indentfit",  # the same figure is the same file
}
