"""The tables and figures of a Sweep."""

import csv
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from indentfit.curve import Curve
from indentfit.report import study_plots
from indentfit.report.vtu import file_names
from indentfit.study.sweep import Sweep, SweepPoint

LENGTHS = ("diameter", "length", "width", "thickness", "edge_radius", "tip_radius", "size", "depth", "max_step")  # keys in mm
UNITS_OF_TIME = {"rate": "mm/s", "ramp": "s", "hold": "s"}
MEASURES = ("force_mN", "stiffness_mN_per_mm", "force_change", "stiffness_change", "rmse_mN")

Units = Callable[[str], str]
"""Parameter of the material -> its unit."""


def write_tables(folder: Path, sweep: Sweep) -> None:
    """curves.csv, points.csv and sensitivities.csv of a sweep."""
    keys, points = [varied.key for varied in sweep.variations], list(enumerate(sweep.every_point))
    table(
        folder / "curves.csv",
        ["point", *keys, "test", "displacement_mm", "force_mN"],
        (
            [n, *(point.values.get(key, "") for key in keys), name, d, F]
            for n, point in points
            for name, test in (point.tests or {}).items()
            for d, F in zip(test.curve.displacement.tolist(), test.curve.force.tolist(), strict=True)
        ),
    )
    table(
        folder / "points.csv",
        ["point", *keys, "test", *MEASURES, "cause"],
        (
            [n, *(point.values.get(key, "") for key in keys), name, *_measures(point, name), point.cause or ""]
            for n, point in points
            for name in sweep.tests
        ),
    )
    if sweep.sensitivities:
        rows = [asdict(sensitivity) for sensitivity in sweep.sensitivities]
        table(folder / "sensitivities.csv", list(rows[0]), ([_given(value) for value in row.values()] for row in rows))


def draw(folder: Path, sweep: Sweep) -> None:
    """Save the figures: one for each key, and the ranking; or one of the grid."""
    if sweep.grid:
        grid_figure(sweep, sweep.tests, sweep.unit, folder / "grid")
        return
    keys = [varied.key for varied in sweep.variations]
    for key, stem in zip(keys, file_names([key.replace(".", "-") for key in keys]), strict=True):
        key_figure(sweep, key, sweep.tests, sweep.unit, folder / f"sweep-{stem}")
        rate_figure(sweep, key, folder / f"stiffness-{stem}")
    ranking_figure(sweep, folder / "sensitivities")


def overview(sweep: Sweep, path: str | Path | None = None) -> Figure | None:
    """The figure of a whole sweep: the grid, or the keys by what they do; None where there is nothing to draw."""
    return grid_figure(sweep, sweep.tests, sweep.unit, path) if sweep.grid else ranking_figure(sweep, path)


def key_figure(sweep: Sweep, key: str, tests: dict[str, float], units: Units, path: str | Path | None = None) -> Figure | None:
    """Curves at each value of a key, a panel for each test (name -> angle); None where there is nothing to draw."""
    mine = sorted((p for p in sweep.points if key in p.values and p.tests), key=lambda p: _place(p.numbers[key]))
    if not sweep.base.tests or not mine:
        return None
    points = [(point.values[key], _curves(point)) for point in mine]
    plain = all(point.numbers[key] is not None and _is_number(point.values[key]) for point in mine)
    label = with_unit(key, units) if plain else key
    return study_plots.curves_by_value(label, tests, (own_words(sweep, key), _curves(sweep.base)), points, path)


def rate_figure(sweep: Sweep, key: str, path: str | Path | None = None) -> Figure | None:
    """Stiffness of each test against a rate, or the duration of a ramp; None for another key, or where fewer than two values were
    computed."""
    last = key.rpartition(".")[2]
    if not key.startswith("test.") or last not in UNITS_OF_TIME:
        return None
    known = [(point.numbers[key], point.tests) for point in sweep.points if set(point.values) == {key} and point.tests]
    own = sweep.own[key]
    known += [(own, sweep.base.tests)] if isinstance(own, float) and sweep.base.tests else []
    rows = {
        number: {test: result.stiffness for test, result in tests.items()}
        for number, tests in known
        if number is not None and tests
    }
    label = f"{key} ({UNITS_OF_TIME[last]})"
    return study_plots.stiffness_by_rate(label, sweep.tests, list(rows.items()), path) if len(rows) > 1 else None


def ranking_figure(sweep: Sweep, path: str | Path | None = None) -> Figure | None:
    """Keys by what they do; None where there is nothing to rank."""
    rows = [(sensitivity.key, sensitivity.test, sensitivity.force_span) for sensitivity in sweep.sensitivities]
    return study_plots.ranked(rows, sweep.tests, path) if rows else None


def grid_figure(sweep: Sweep, tests: dict[str, float], units: Units, path: str | Path | None = None) -> Figure | None:
    """Last forces over the grid; None where every point failed."""
    keys = [varied.key for varied in sweep.variations]
    points = [
        (
            [point.values[key] for key in keys],
            [point.numbers[key] for key in keys],
            None if point.tests is None else {name: test.force for name, test in point.tests.items()},
        )
        for point in sweep.points
    ]
    if all(forces is None for *_, forces in points):
        return None
    return study_plots.forces_on_grid([with_unit(key, units) for key in keys], points, tests, path)


def with_unit(key: str, units: Units) -> str:
    """A key of the case with the unit of its values in brackets, where it has one."""
    section, _, name = key.partition(".")
    unit = units(name.removeprefix("parameters.").removesuffix(".start")) if section == "material" else "1"
    if key == "material.kappa":
        unit = "kPa"
    elif section != "material" and name.rpartition(".")[2] in LENGTHS:
        unit = "mm"
    elif section == "test" and name.rpartition(".")[2] in UNITS_OF_TIME:
        unit = UNITS_OF_TIME[name.rpartition(".")[2]]
    return key if unit in ("", "1") else f"{key} ({unit})"


def own_words(sweep: Sweep, key: str) -> str:
    """The case's own value of a key."""
    value = sweep.own[key]
    return "default" if value is None else f"{value:.6g}" if isinstance(value, float) else str(value)


def table(path: Path, header: Sequence[str], rows: Iterable[Sequence[Any]]) -> None:
    """Write one table as CSV."""
    with open(path, "w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header)
        writer.writerows(rows)


def _measures(point: SweepPoint, name: str) -> list[Any]:
    if point.tests is None:
        return [""] * len(MEASURES)
    measures = point.tests[name].as_json()
    return [_given(measures[measure]) for measure in MEASURES]


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _place(number: float | None) -> float:
    """Numbers in their order, words behind them."""
    return float("inf") if number is None else number


def _curves(point: SweepPoint) -> dict[str, Curve]:
    return {name: test.curve for name, test in (point.tests or {}).items()}


def _given(value: Any) -> Any:
    return "" if value is None else value
