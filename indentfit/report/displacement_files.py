"""Measured and fitted displacements of a fit: their file, and arrows on the sample."""

import csv
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from indentfit.arrays import Array
from indentfit.case.field_tests import FieldTest
from indentfit.inference.result import FitResult
from indentfit.report.style import COLOURS, COLUMN, STYLE

FILE = "displacements.csv"
COLUMNS = (
    "test", "depth_mm", "x_mm", "y_mm", "z_mm", "along_x", "along_y", "along_z", "measured_mm", "sd_mm", "fitted_mm",
)  # fmt: skip
VIEWS = ((0, 1), (2, 1), (0, 2))  # pairs of axes, seen from the third
LONGEST = 0.15  # of the extent of the points: the longest arrow
NAMES = "xyz"


@dataclass(frozen=True, eq=False)
class FittedField:
    """The displacements of one field.

    Parameters
    ----------
    test : str
        The name of the field's test.
    points, directions : arrays (g, 3)
        Positions, mm, and unit vectors along which displacements count positive.
    measured, sd, fitted, depths : arrays (g,), mm
    """

    test: str
    points: Array
    directions: Array
    measured: Array
    sd: Array
    fitted: Array
    depths: Array

    @property
    def misfit(self) -> float:
        """Root mean square of the residuals in standard deviations."""
        return float(np.sqrt(np.mean(((self.fitted - self.measured) / self.sd) ** 2)))

    def as_json(self) -> dict[str, float | int]:
        """The keys of the field in result.json."""
        residual = self.measured - self.fitted
        return {
            "components": int(self.measured.size),
            "misfit_in_sd": self.misfit,
            "mean_residual_mm": float(residual.mean()),
            "largest_residual_mm": float(np.abs(residual).max()),
            "largest_displacement_mm": float(np.abs(self.measured).max()),
        }


def fields_of(result: FitResult) -> list[FittedField]:
    """The fields of a fit with their fitted displacements."""
    if result.case is None:
        return []
    pairs = zip(result.case.tests, result.case.curves, strict=True)
    return [
        _field(test, curve.force, np.asarray(curve.sd), result.curves[test.name].force)
        for test, curve in pairs
        if isinstance(test, FieldTest) and curve is not None and test.name in result.curves
    ]


def _field(test: FieldTest, measured: Array, sd: Array, fitted: Array) -> FittedField:
    given, groups = test.displacements, test.displacements.groups
    number = np.bincount(groups)
    means = [np.array([np.bincount(groups, column) / number for column in part.T]).T for part in (given.points, given.directions)]
    return FittedField(test.name, means[0], means[1], measured, sd, fitted, np.bincount(groups, given.depths) / number)


def write_displacements(path: Path, fields: Sequence[FittedField]) -> None:
    """Write the displacements of fields as a CSV file."""
    with open(path, "w", encoding="utf-8", newline="") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(COLUMNS)
        for known in fields:
            table = np.column_stack([known.depths, known.points, known.directions, known.measured, known.sd, known.fitted])
            rows.writerows([known.test, *map(repr, row)] for row in table.tolist())


def read_displacements(path: Path) -> list[FittedField]:
    """The fields of such a file; none where there is no file."""
    if not path.is_file():
        return []
    tables: dict[str, list[list[float]]] = {}
    with open(path, encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            tables.setdefault(row["test"], []).append([float(row[name]) for name in COLUMNS[1:]])
    fields = []
    for test, rows in tables.items():
        table = np.array(rows)
        depths, measured, sd, fitted = table[:, [0, 7, 8, 9]].T
        fields.append(FittedField(test, table[:, 1:4], table[:, 4:7], measured, sd, fitted, depths))
    return fields


def arrows(known: FittedField) -> Figure:
    """Measured and fitted displacements as arrows on the sample, and beside them the residuals."""
    places, measured, fitted = _by_points(known)
    sizes = [float(np.abs(measured[:, list(view)]).sum()) * (1.0 + 0.1 * (1 in view)) for view in VIEWS]
    view = list(VIEWS[int(np.argmax(sizes))])
    extent = float(np.ptp(known.points[:, view], axis=0).max()) or 1.0
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(1.9 * COLUMN, 0.85 * COLUMN), layout="constrained")
        FigureCanvasAgg(figure)
        left, right = figure.subplots(1, 2, sharex=True, sharey=True)
        scale = LONGEST * extent / max(float(np.abs(measured).max()), 1e-12)
        for vectors, colour, name in ((measured, COLOURS[0], "measured"), (fitted, COLOURS[1], "fitted")):
            _arrows(left, places[:, view], vectors[:, view] * scale, colour, name)
        left.set_title(f"displacements, {scale:.3g} times as long")
        left.legend(loc="best")
        residual = measured - fitted
        scale = LONGEST * extent / max(float(np.abs(residual).max()), 1e-12)
        _arrows(right, places[:, view], residual[:, view] * scale, COLOURS[0], "")
        right.set_title(f"measured minus fitted, {scale:.3g} times as long")
        for axes in (left, right):
            axes.set_aspect("equal")
            axes.margins(0.15)
            axes.set_xlabel(f"{NAMES[view[0]]} (mm)")
        left.set_ylabel(f"{NAMES[view[1]]} (mm)")
    return figure


def words_of(fields: Sequence[FittedField]) -> Iterator[str]:
    """How far the fit is from each field, in words."""
    for known in fields:
        largest, off = 1e3 * float(np.abs(known.measured).max()), 1e3 * float(np.abs(known.fitted - known.measured).max())
        yield (
            f"{known.test}: {known.measured.size} displacements of up to {largest:.3g} µm; residuals are {known.misfit:.2f} of "
            f"their standard deviations (root mean square), the largest {off:.2g} µm"
        )


def _by_points(known: FittedField) -> tuple[Array, Array, Array]:
    """Points (n, 3) with their measured and fitted vectors (n, 3), in which components that were not measured are zero."""
    places, which = np.unique(np.column_stack([known.points, known.depths]).round(9), axis=0, return_inverse=True)
    vectors = [np.zeros((len(places), 3)) for _ in range(2)]
    for whole, values in zip(vectors, (known.measured, known.fitted), strict=True):
        np.add.at(whole, which.ravel(), values[:, None] * known.directions)
    return places[:, :3], vectors[0], vectors[1]


def _arrows(axes: Axes, places: Array, vectors: Array, colour: str, name: str) -> None:
    axes.plot(*places.T, ".", color="0.7", markersize=2, zorder=1)
    axes.quiver(
        *places.T, *vectors.T, angles="xy", scale_units="xy", scale=1, color=colour, width=0.004, label=name or None, zorder=2
    )
