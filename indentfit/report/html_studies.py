"""The pages of a sweep and of a mesh-check."""

from .html_case import again_section, case_words, computed, number, percent, signed_percent, tests_table
from .mesh_check import convergence_figure, cost_figure
from .page import Figures, Lines, Page, Part, Section, Table, Text, drawn
from .sweep import grid_figure, key_figure, own_words, ranking_figure, with_unit


def sweep_page(folder, result):
    """Page of a sweep's result folder."""
    failed = [point for point in (result["base"], *result["points"]) if point["tests"] is None]
    sections = [_what(result), _keys(result) if not result["grid"] else _grid(result), _points(result), *_refits(result)]
    if failed:
        rows = tuple((_values(point), point["cause"]) for point in failed)
        sections.append(
            Section("failed", "Points that failed", (Table("Points that failed, with the cause", ("Point", "Cause"), rows),))
        )
    varied = "".join(f" --vary {key}={','.join(values)}" for key, values in result["variations"].items())
    sections.append(again_section(folder, result, f"sweep{' --grid' if result['grid'] else ''}{varied}"))
    count = len(result["points"])
    headline = f"{count - len(failed) + (result['base'] in failed)} of {count} points were computed."
    return Page(result["title"] or "Sweep", "Sweep over keys of the case", headline, _lead(result), not failed, tuple(sections))


def mesh_check_page(folder, result):
    """Page of a mesh-check's result folder."""
    sections = [_what(result), _meshes(result), _errors(result), *_changes(result), *_refits(result)]
    asked = " ".join(f"--{'sizes' if 'size' in one['asked'] else 'elements'}" for one in result["meshes"][:1])
    family = ",".join(one["asked"].partition("=")[2] for one in result["meshes"])
    sections.append(again_section(folder, result, f"mesh-check {asked} {family} --error {100 * result['wanted']:g}"))
    good = result["chosen"] is not None
    headline = "A mesh is exact enough:" if good else "No mesh is certainly exact enough:"
    lead = f"{result['verdict']}."
    return Page(result["title"] or "Mesh check", "Convergence of the mesh", headline, lead, good, tuple(sections))


ELASTICITY = (
    "Elasticity: relative change of the force by a relative change of the value. Stiffness: slope of the line fitted to a curve."
)


# ---- sweep -------------------------------------------------------------------------------------------------------


def _lead(result):
    ranked = list(dict.fromkeys(one["key"] for one in result["sensitivities"]))
    if len(ranked) < 2:
        return ""
    largest = {key: max(one["force_span"] for one in result["sensitivities"] if one["key"] == key) for key in ranked}
    return (
        f"By the spread of the force over the values tried: {' > '.join(f'{key} ({percent(largest[key], 2)})' for key in ranked)}."
    )


def _what(result):
    case = result.get("case")
    parts: list[Part] = []
    if case:
        parts += [Lines(case_words(case)), tests_table(case, "Tests")]
    units = {name: unit for name, unit in ((case or {}).get("units") or {}).items() if unit != "1"}
    rows = tuple((name, number(value, 6), units.get(name) or "–") for name, value in result["parameters"].items())
    parts.append(Table("Parameters of the material", ("Parameter", "Value", "Unit"), rows))
    return Section("what", "What was computed", tuple(parts))


def _keys(result):
    parts: list[Part] = []
    if result["sensitivities"]:
        header = (
            "Key",
            "Test",
            "Spread of the force",
            "Spread of the stiffness",
            "Elasticity of the force",
            "Force with rising value",
        )
        rows = tuple(
            (
                one["key"],
                one["test"],
                percent(one["force_span"]),
                percent(one["stiffness_span"]),
                number(one["elasticity"], 3),
                one["trend"],
            )
            for one in result["sensitivities"]
        )
        alt = "Bars: " + "; ".join(
            f"{one['key']}, {one['test']}: {percent(one['force_span'], 2)}" for one in result["sensitivities"]
        )
        caption = "Keys by the spread of the force at the last displacement over their values."
        figure = ranking_figure(result)
        parts = [Figures((drawn(figure, caption, alt),)), Table("Sensitivities, the strongest key first", header, rows)]
        parts.append(Text(ELASTICITY))
    for key in result["variations"]:
        figures = []
        for name, angle in result["tests"].items():
            figure = key_figure(result, key, {name: angle})
            if figure is None:
                continue
            own = own_words(result, key)
            caption = f"Force against displacement of {name} ({angle}°) at each value of {key}; the case itself has {own}."
            figures.append(drawn(figure, caption, _alt(result, key, name)))
        parts.append(Figures(tuple(figures)))
    return Section("keys", "What each key does", tuple(parts))


def _alt(result, key, name):
    ends = [
        f"{point['values'][key]}: {number(point['tests'][name]['force_mN'])} mN"
        for point in result["points"]
        if key in point["values"] and point["tests"]
    ]
    return f"Force curves of {name} by {key}; at the last displacement {'; '.join(ends)}"


def _grid(result):
    figures = []
    for name, angle in result["tests"].items():
        figure = grid_figure(result, {name: angle})
        if figure is not None:
            caption = f"Force of {name} ({angle}°) at the last displacement over the grid."
            figures.append(drawn(figure, caption, f"{caption} The numbers are in the table below."))
    return Section("grid", "Over the grid", (Figures(tuple(figures)),))


def _points(result):
    tables = []
    for name, angle in result["tests"].items():
        measured = _measured(result, name)
        header = ["Point", "Force (mN)", "Change of the force", "Stiffness (mN/mm)", "Change of the stiffness"]
        header += ["RMSE (mN)"] if measured else []
        rows = []
        for point in (result["base"], *result["points"]):
            one = point["tests"] and point["tests"][name]
            if not one:
                rows.append((_values(point), "failed", *["–"] * (len(header) - 2)))
                continue
            row = [_values(point), computed(one["force_mN"]), signed_percent(one["force_change"])]
            row += [computed(one["stiffness_mN_per_mm"]), signed_percent(one["stiffness_change"])]
            rows.append((*row, *([computed(one["rmse_mN"])] if measured else [])))
        caption = f"{name} ({angle}°): force at the last displacement, and stiffness"
        tables.append(Table(caption, tuple(header), tuple(rows)))
    return Section("points", "Every point", tuple(tables))


def _measured(result, name):
    return any(p["tests"] and p["tests"][name]["rmse_mN"] is not None for p in (result["base"], *result["points"]))


def _values(point):
    return ", ".join(f"{key} = {value}" for key, value in point["values"].items()) or "the case"


# ---- mesh check --------------------------------------------------------------------------------------------------


def _meshes(result):
    names = list(result["tests"])
    measured = [name for name in names if any(one["rmse_mN"] and name in one["rmse_mN"] for one in result["meshes"])]
    header = ("Mesh", "Elements", "Degrees of freedom", "h (mm)", "Newton iterations", "CPU time (s)", "Peak memory (MB)")
    found_header = ("Mesh", *(f"{name}: force (mN)" for name in names), *(f"{name}: RMSE (mN)" for name in measured))
    rows, found = [], []
    for one in result["meshes"]:
        asked = one["asked"] + (" (second try, not counted)" if one.get("tries", 1) > 1 else "")
        row = [asked, f"{one['elements']:,}", f"{one['dofs']:,}"]
        if not one["forces"]:
            rows.append((*row, *["–"] * (len(header) - 4), f"failed: {one['cause']}"))
            continue
        row += [computed(one["h"]), str(one["newton_iterations"])]
        rows.append((*row, computed(one["cpu_seconds"], 3), computed(one["memory"] / 1e6, 3)))
        forces = [computed(force[-1]) for force in one["forces"]]
        found.append((asked, *forces, *(computed(one["rmse_mN"][name]) for name in measured)))
    caption = "The meshes, from coarse to fine, and what they cost; h is the element size (mesh.size)"
    parts: list[Part] = [Table(caption, header, tuple(rows))]
    if found:
        parts.append(Table("What is computed on each mesh, at the last displacement", found_header, tuple(found)))
    figure = cost_figure(result)
    if figure is not None:
        done = [one for one in result["meshes"] if one["forces"]]
        times = f"{number(done[0]['cpu_seconds'], 2)} to {number(done[-1]['cpu_seconds'], 2)} s"
        alt = f"From {done[0]['elements']} to {done[-1]['elements']} elements the processor time goes from {times}"
        parts.append(Figures((drawn(figure, "What is computed on each mesh, and the processor time that it takes.", alt),)))
    return Section("meshes", "The meshes and their cost", tuple(parts))


def _errors(result):
    figures, rows = [], []
    for one in result["quantities"]:
        unit = "mN" if one["kind"] == "force" else "mN/mm"
        finest = one["values"][one["h"].index(min(one["h"]))] if one["h"] else None
        approach, index = one["approach"], one["index"]
        row = [one["test"], f"{one['kind']} ({unit})", computed(finest, 5)]
        if approach:
            row += [computed(approach["value"], 5), _to(approach["interval"]), f"± {computed(_of_finest(one))}", _order(approach)]
        else:
            row += ["–"] * 4
        rows.append((*row, _index(index)))
        figure = convergence_figure([one])
        if figure is not None:
            ends = f"{number(one['values'][0])} to {number(one['values'][-1])} {unit}"
            alt = f"{one['kind']} of {one['test']} from {ends} as the mesh is refined"
            what = f"{one['kind'].capitalize()} of {one['test']} against element size"
            caption = f"{what}, the fitted approach to zero size, and the error band."
            figures.append(drawn(figure, caption, alt))
    header = (
        "Test",
        "Quantity",
        "Finest mesh",
        "At zero size",
        "95 % interval of it, or wider",
        "Eca-Hoekstra of the finest mesh",
        "Observed order",
        "GCI of the finest mesh",
    )
    extrapolated = Table("Last force and stiffness, extrapolated to zero element size", header, tuple(rows))
    parts = (extrapolated, Text(f"Method: {result['method']}."), Figures(tuple(figures)))
    return Section("errors", "Errors of the mesh", parts)


def _changes(result):
    if not result["changes"]:
        return []
    names = list(result["tests"])
    failed = any(one["cause"] for one in result["changes"])
    rows = tuple(
        (
            with_unit(result, one["key"]),
            number(one["value"]),
            *((signed_percent(one["changes"][name]) for name in names) if one["changes"] else ["failed"] * len(names)),
            *([one["cause"] or "–"] if failed else []),
        )
        for one in result["changes"]
    )
    header = ("Key", "Value", *(f"Change of the force of {name}" for name in names), *(["Cause of a failure"] if failed else []))
    return [
        Section(
            "changes",
            "Contact, load steps and edge",
            (Table("Changes of the last force against the case as it is, on its own mesh", header, rows),),
        )
    ]


def _refits(result):
    refits = result.get("refits")
    if not refits:
        return []
    names = list(dict.fromkeys(name for one in refits for name in one["parameters"]))
    rows = []
    for one in refits:
        values = [one["parameters"].get(name) for name in names]
        cells = ["held" if v is None else f"{number(v['value'])} ± {number(v['stderr'], 2)}" for v in values]
        rows.append((one["label"], *cells, number(one["objective"]), one["cause"] or ("yes" if one["success"] else "no")))
    header = ("Fitted with", *names, "Objective (mN)", "Converged")
    return [
        Section(
            "refits", "The parameters fitted anew", (Table("Fitted parameters with their standard errors", header, tuple(rows)),)
        )
    ]


def _of_finest(one):
    return one["approach"]["uncertainty"][one["h"].index(min(one["h"]))]


def _to(pair):
    return f"{computed(pair[0], 5)} to {computed(pair[1], 5)}"


def _order(approach):
    if approach["order"] is not None:
        return number(approach["order"], 3)
    return f"{number(approach['raw_order'], 2)}, not believed; {' and '.join(number(p) for p in approach['exponents'])} taken"


def _index(index):
    if index is None:
        return "needs three meshes"
    if index["index"] is None:
        return f"none: the three finest are {index['kind']}"
    return f"{percent(index['index'])} (order {number(index['order'], 3)})"
