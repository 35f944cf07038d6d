"""The tables and figures of a sweep's result folder, from what its result.json holds."""

import csv

from ..curve import Curve
from . import study_plots
from .vtu import file_names

LENGTHS = ("diameter", "length", "width", "thickness", "edge_radius", "size", "depth", "max_step")  # keys in mm
MEASURES = ("force_mN", "stiffness_mN_per_mm", "force_change", "stiffness_change", "rmse_mN")


def write_tables(folder, result):
    """curves.csv, points.csv and sensitivities.csv of a sweep."""
    keys, points = list(result["variations"]), [result["base"], *result["points"]]
    table(
        folder / "curves.csv",
        ["point", *keys, "test", "displacement_mm", "force_mN"],
        (
            [n, *(point["values"].get(key, "") for key in keys), name, d, F]
            for n, point in enumerate(points)
            for name, one in (point["tests"] or {}).items()
            for d, F in zip(one["displacement_mm"], one["forces_mN"], strict=True)
        ),
    )
    table(
        folder / "points.csv",
        ["point", *keys, "test", *MEASURES, "cause"],
        (
            [n, *(point["values"].get(key, "") for key in keys), name, *cells, point["cause"] or ""]
            for n, point in enumerate(points)
            for name in result["tests"]
            for cells in [[_given(point["tests"] and point["tests"][name][measure]) for measure in MEASURES]]
        ),
    )
    if result["sensitivities"]:
        names = list(result["sensitivities"][0])
        table(folder / "sensitivities.csv", names, ([_given(one[name]) for name in names] for one in result["sensitivities"]))


def draw(folder, result):
    """Save the figures: one for each key, and the ranking; or one of the grid."""
    if result["grid"]:
        grid_figure(result, result["tests"], folder / "grid")
        return
    stems = file_names([key.replace(".", "-") for key in result["variations"]])
    for key, stem in zip(result["variations"], stems, strict=True):
        key_figure(result, key, result["tests"], folder / f"sweep-{stem}")
    ranking_figure(result, folder / "sensitivities")


def key_figure(result, key, tests, path=None):
    """Curves at each value of a key, a panel for each test (name -> angle); None where there is nothing to draw."""
    mine = sorted((p for p in result["points"] if key in p["values"] and p["tests"]), key=lambda p: _place(p["numbers"][key]))
    if not result["base"]["tests"] or not mine:
        return None
    points = [(point["values"][key], _curves(point)) for point in mine]
    plain = all(point["numbers"][key] is not None and _is_number(point["values"][key]) for point in mine)
    label = with_unit(result, key) if plain else key
    return study_plots.curves_by_value(label, tests, (own_words(result, key), _curves(result["base"])), points, path)


def ranking_figure(result, path=None):
    """Keys by what they do; None where there is nothing to rank."""
    rows = [(one["key"], one["test"], one["force_span"]) for one in result["sensitivities"]]
    return study_plots.ranked(rows, result["tests"], path) if rows else None


def grid_figure(result, tests, path=None):
    """Last forces over the grid; None where every point failed."""
    keys = list(result["variations"])
    points = [
        (
            [point["values"][key] for key in keys],
            [point["numbers"][key] for key in keys],
            point["tests"] and {name: one["force_mN"] for name, one in point["tests"].items()},
        )
        for point in result["points"]
    ]
    if all(forces is None for *_, forces in points):
        return None
    return study_plots.forces_on_grid([with_unit(result, key) for key in keys], points, tests, path)


def with_unit(result, key):
    """A key of the case with the unit of its values in brackets, where it has one."""
    section, _, name = key.partition(".")
    parameter = name.removeprefix("parameters.").removesuffix(".start")
    unit = ((result.get("case") or {}).get("units") or {}).get(parameter, "1") if section == "material" else "1"
    if key == "material.kappa":
        unit = "kPa"
    elif section != "material" and name.rpartition(".")[2] in LENGTHS:
        unit = "mm"
    return key if unit in ("", "1") else f"{key} ({unit})"


def own_words(result, key):
    """The case's own value of a key."""
    value = result["own"][key]
    return "default" if value is None else f"{value:.6g}" if isinstance(value, float) else str(value)


def table(path, header, rows):
    """Write one table as CSV."""
    with open(path, "w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header)
        writer.writerows(rows)


def _is_number(text):
    try:
        float(text)
    except ValueError:
        return False
    return True


def _place(number):
    """Numbers in their order, words behind them."""
    return float("inf") if number is None else number


def _curves(point):
    return {name: Curve(one["displacement_mm"], one["forces_mN"]) for name, one in point["tests"].items()}


def _given(value):
    return "" if value is None else value
