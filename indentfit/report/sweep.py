"""The tables and figures of a sweep's result folder."""

import csv

from . import study_plots
from .vtu import file_names


def write_tables(folder, result):
    """curves.csv, points.csv and sensitivities.csv of a study.sweep.Sweep."""
    keys = [one.key for one in result.variations]
    table(
        folder / "curves.csv",
        ["point", *keys, "test", "displacement_mm", "force_mN"],
        (
            [n, *(point.values.get(key, "") for key in keys), name, d, F]
            for n, point in enumerate((result.base, *result.points))
            for name, one in (point.tests or {}).items()
            for d, F in zip(one.curve.displacement.tolist(), one.curve.force.tolist(), strict=True)
        ),
    )
    measures = ("force", "stiffness", "force_change", "stiffness_change", "rmse")
    table(
        folder / "points.csv",
        ["point", *keys, "test", "force_mN", "stiffness_mN_per_mm", "force_change", "stiffness_change", "rmse_mN", "cause"],
        (
            [n, *(point.values.get(key, "") for key in keys), name, *cells, point.cause or ""]
            for n, point in enumerate((result.base, *result.points))
            for name in result.tests
            for cells in [[_given(getattr(point.tests[name], m)) if point.tests else "" for m in measures]]
        ),
    )
    if result.sensitivities:
        names = ("key", "test", "force_span", "stiffness_span", "elasticity", "trend")
        rows = ([_given(getattr(one, name)) for name in names] for one in result.sensitivities)
        table(folder / "sensitivities.csv", names, rows)


def draw(folder, result):
    """The figures: one for each key, and the ranking; or one of the grid. Returns [(file name, caption)]."""
    if result.grid:
        return _draw_grid(folder, result)
    drawn = []
    stems = file_names([one.key.replace(".", "-") for one in result.variations])
    for one, stem in zip(result.variations, stems, strict=True):
        mine = sorted((p for p in result.points if one.key in p.values), key=lambda p: p.numbers[one.key] or 0)
        points = [
            (point.values[one.key], {name: test.curve for name, test in point.tests.items()})
            for point in mine
            if point.tests is not None
        ]
        if result.base.tests is None or not points:
            continue
        own = (_own(result.own[one.key]), {name: test.curve for name, test in result.base.tests.items()})
        study_plots.curves_by_value(one.key, result.tests, own, points, folder / f"sweep-{stem}")
        drawn.append((f"sweep-{stem}", f"Force against displacement at each value of {one.key}."))
    if result.sensitivities:
        rows = [(one.key, one.test, one.force_span) for one in result.sensitivities]
        study_plots.ranked(rows, result.tests, folder / "sensitivities")
        drawn.append(("sensitivities", "Keys by the spread of the force at the last displacement over their values."))
    return drawn


def _own(value):
    return "default" if value is None else f"{value:.6g}" if isinstance(value, float) else str(value)


def _draw_grid(folder, result):
    keys = [one.key for one in result.variations]
    points = [
        (
            [point.values[key] for key in keys],
            [point.numbers[key] for key in keys],
            point.tests and {name: one.force for name, one in point.tests.items()},
        )
        for point in result.points
    ]
    if all(forces is None for *_, forces in points):
        return []
    study_plots.forces_on_grid(keys, points, result.tests, folder / "grid")
    return [("grid", "Force at the last displacement over the grid.")]


def table(path, header, rows):
    """Write one table as CSV."""
    with open(path, "w", encoding="utf-8", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(header)
        table.writerows(rows)


def _given(value):
    return "" if value is None else value
