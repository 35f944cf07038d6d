"""The pages of a fit and of a simulation."""

import csv
import json

import numpy as np

from indentfit.inference.result import FitResult

from ..curve import Curve
from . import plots, study_plots
from .html_case import again_section, case_words, number, percent, tests_table
from .page import Figures, Lines, Page, Part, Section, Table, Text, drawn, image
from .text import effect_of_base, share_rows

STRESSES = (
    "Cauchy stresses at the last displacement, averaged at the nodes; at a sharp edge they grow without limit as the mesh is "
    "refined."
)


def fit_page(folder, result):
    """Page of a fit's result folder."""
    sections = [
        _what(result),
        _parameters(result),
        _curves(folder, result),
        _identifiability(result),
        _search(result),
        *stress_sections(folder),
        _solver(result),
        again_section(folder, result, "fit"),
    ]
    return Page(
        result["title"] or "Fit", "Inverse finite-element fit", _headline(result), _lead(result), result["success"], tuple(sections)
    )


def simulation_page(folder, result):
    """Page of a simulation's result folder."""
    case = result.get("case")
    parts: list[Part] = [Lines(case_words(case)), tests_table(case, "Tests")] if case else []
    parameters = tuple((name, number(value, 6)) for name, value in result["parameters"].items())
    parts.append(Table("Parameters of the material", ("Parameter", "Value"), parameters))
    simulated = [(test["name"], Curve(test["displacement_mm"], test["force_mN"])) for test in result["tests"]]
    figure = plots.force_displacement([], simulated, None)
    rows = [
        (
            test["name"],
            str(test["angle"]),
            number(test["force_mN"][-1], 5),
            number(test["displacement_mm"][-1]),
            percent(test["facts"]["penalty_error"]),
        )
        for test in result["tests"]
    ]
    forces: list[Part] = [
        Figures((drawn(figure, "Force of the full sample against displacement.", _alt_of_curves(simulated)),)),
        Table(
            "Forces at the last displacement",
            ("Test", "Angle (°)", "Force (mN)", "Displacement (mm)", "Penalty error"),
            tuple(rows),
        ),
    ]
    sections = [
        Section("what", "What was computed", tuple(parts)),
        Section("forces", "Forces", tuple(forces)),
        *stress_sections(folder),
        Section("solver", "Mesh and solver", (_facts("Mesh and solver", {**result["mesh"], **result["solver"]}),)),
        again_section(folder, result, "simulate"),
    ]
    ends = "; ".join(f"{name}: {curve.force[-1]:.4g} mN at {curve.displacement[-1]:.3g} mm" for name, curve in simulated)
    return Page(result["title"] or "Simulation", "Finite-element simulation", "Computed.", f"{ends}.", True, tuple(sections))


def stress_sections(folder):
    """The section of the stress pictures in a result folder's fields/, if there are any."""
    index = folder / "fields" / "pictures.json"
    if not index.is_file():
        return []
    listed = json.loads(index.read_text(encoding="utf-8"))
    figures = tuple(
        image(folder / "fields" / one["file"], one["caption"], one["alt"])
        for one in listed["pictures"]
        if (folder / "fields" / one["file"]).is_file() and "/" not in one["file"] and "\\" not in one["file"]
    )
    parts: list[Part] = [Figures(figures), Text(STRESSES)]
    for peaks in listed["peaks"]:
        rows = tuple(
            (
                one["component"],
                number(one["largest"]),
                number(one["smallest"]),
                number(one["magnitude"]),
                number(one["usual"]),
                one["place"],
            )
            for one in peaks["rows"]
        )
        header = (
            "Component",
            "Largest (kPa)",
            "Smallest (kPa)",
            "Largest magnitude (kPa)",
            "Exceeded at 1 % of nodes (kPa)",
            "Where, undeformed x, y, z (mm)",
        )
        parts += [Table(f"Peak stresses, {peaks['test']} ({peaks['angle']}°)", header, rows), Text(peaks["words"])]
    return [Section("stresses", "Displacements and stresses", tuple(parts))]


def _headline(result):
    return "The fit converged." if result["success"] else "The fit did not converge."


def _lead(result):
    """What was found, in a sentence."""
    free = [result["parameters"][name] | {"name": name} for name in result["free"]]
    words = [f"{one['name']} = {number(one['value'])}{_unit(one['unit'], ' ')}" for one in free]
    clear = [one["name"] for one in free if one["verdict"].startswith("determined")]
    unclear = [one["name"] for one in free if one["name"] not in clear]
    end = f" The curves determine {_and(clear)}." if clear else " The curves determine none of these."
    if clear and unclear:
        end = f" The curves determine {_and(clear)}, but not {_and(unclear)} well."
    return f"{', '.join(words)}.{end}"


def _and(words):
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


def _what(result):
    case = result.get("case")
    parts: list[Part] = [
        Text(f"The free parameters {', '.join(result['free'])} were fitted to {len(result['rmse']) or 'the'} measured curves.")
    ]
    if case:
        parts += [Lines(case_words(case)), tests_table(case, "Curves that were fitted, with their weights in the objective")]
    return Section("what", "What was fitted to what", tuple(parts))


def _parameters(result):
    rows = []
    for name, one in result["parameters"].items():
        value, unit = number(one["value"], 5), _unit(one["unit"]) or "–"
        if one["fixed"]:
            rows.append((name, value, unit, "–", "fixed", "–", "–", "–"))
            continue
        interval = one["interval"] and " to ".join(number(x) for x in one["interval"])
        bounds = f"{number(one['min'])} to {number(one['max'])}"
        rows.append(
            (
                name,
                value,
                unit,
                interval or "unknown",
                one["verdict"],
                *(number(x, 2) if x is not None else "unknown" for x in (one["stderr"], one.get("stderr_total", one["stderr"]))),
                bounds,
            )
        )
    header = ("Parameter", "Value", "Unit", "95 % interval", "Verdict", "Error by noise", "Total standard error", "Searched")
    return Section(
        "parameters",
        "Parameters",
        (
            Table("Parameters, their errors, and what these say", header, tuple(rows)),
            *(Text(f"{note[:1].upper()}{note[1:]}.") for note in result["notes"]),
        ),
    )


def _curves(folder, result):
    measured, simulated = read_fitted(folder / "curves.csv") if (folder / "curves.csv").is_file() else ([], [])
    parts: list[Part] = []
    if simulated:
        figure = plots.force_displacement(measured, simulated, None)
        caption = "Measured (marks) and fitted (lines) force of the full sample against displacement; below, what is left over."
        parts.append(Figures((drawn(figure, caption, _alt_of_fit(result, measured, simulated)),)))
    else:
        parts.append(Text("There are no fitted curves: the mechanics failed wherever they were tried.", warning=True))
    rows = tuple((name, number(value)) for name, value in result["rmse"].items())
    if rows:
        parts.append(Table("Root mean square error of each test", ("Test", "RMSE (mN)"), rows))
    if result["objective"] is not None:
        parts.append(
            Text(
                f"Objective, the weighted sum of the tests' RMSEs: {number(result['objective'])} mN. "
                f"Weighted sum of their squares: {number(result['sum_of_squares'])} mN²."
            )
        )
    return Section("fit", "The fit", tuple(parts))


def read_fitted(path):
    """Measured and fitted curves of a fit's curves.csv: two lists of (test, Curve)."""
    rows: dict[str, list] = {}
    with open(path, encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            rows.setdefault(row["test"], []).append(
                [float(row[key] or "nan") for key in ("displacement_mm", "force_mN", "measured_force_mN")]
            )
    columns = {name: np.array(numbers).T for name, numbers in rows.items()}
    measured = [(name, Curve(d, given)) for name, (d, _, given) in columns.items() if not np.isnan(given).any()]
    return measured, [(name, Curve(d, force)) for name, (d, force, _) in columns.items()]


def _identifiability(result):
    free = result["free"]
    parts: list[Part] = []
    if result.get("summary"):
        parts.append(Lines(tuple(f"{one[:1].upper()}{one[1:]}" for one in result["summary"])))
    if result["correlation"] and len(free) > 1:
        rows = tuple((name, *(number(x, 2) for x in row)) for name, row in zip(free, result["correlation"], strict=True))
        parts.append(Table("Correlation of the parameters' errors; near 1 or -1, only a combination is known", ("", *free), rows))
    if result["singular_values"]:
        rows = tuple(
            (str(n), number(value, 3), ", ".join(f"{name} {x:+.2f}" for name, x in zip(free, row, strict=True)))
            for n, (value, row) in enumerate(zip(result["singular_values"], result["directions"], strict=True), start=1)
        )
        header = ("Number", "Singular value (mN)", "Direction, in shares of the values")
        parts.append(
            Table("What the curves see, from most to least: change of the misfit by a relative change of parameters", header, rows)
        )
    parts += _profiles(result) + _tests_alone(result) + _uncertain(result) + _weights_scan(result)
    if not parts:
        parts = [Text("Not known: the fit stopped before the errors of its parameters were found.", warning=True)]
    return Section("identifiability", "What the curves determine", tuple(parts))


def _profiles(result):
    """Figures of the profiles, where a result has them: name -> values, chi2, limit, interval, confirmed."""
    figures = []
    for name, one in (result.get("profiles") or {}).items():
        if not one.get("values") or name not in result["parameters"]:
            continue
        best = result["parameters"][name]
        figure = study_plots.profile(f"{name}{_unit(best['unit'], ' (', ')')}", one, best["value"])
        alt = f"Profile of {name}, least at {number(best['value'])}, its 95 % interval {_between(one['interval'])}"
        caption = (
            f"Profile of {name}: χ² above its least when {name} is held at a value and the others are fitted again. "
            "Shaded: the 95 % interval; dashed: its limit; vertical line: the optimum; circles: runs at the ends."
        )
        figures.append(drawn(figure, caption, alt))
    return [Figures(tuple(figures))] if figures else []


def _tests_alone(result):
    """What each test alone would determine, where a result has it: test -> rmse, parameters (value, interval, verdict)."""
    rows = []
    for test, found in (result.get("tests_alone") or {}).items():
        for name, one in found["parameters"].items():
            rows.append((test, name, number(one["value"]), _between(one["interval"]), one.get("verdict", "–")))
    if not rows:
        return []
    for name in result["free"]:
        one = result["parameters"][name]
        rows.append(("all together", name, number(one["value"]), _between(one["interval"]), one["verdict"]))
    header = ("Curves", "Parameter", "Value", "95 % interval", "Verdict")
    return [Table("What each test alone determines, and all together", header, tuple(rows))]


def _between(interval):
    return "unknown" if interval is None else " to ".join(number(x) for x in interval)


def _uncertain(result):
    """What makes the errors: the noise, the mesh, and inputs that are not known exactly, where a result has them."""
    uncertain, free = FitResult.from_json(result).uncertain, result["free"]
    rows = tuple((words, *shares) for words, shares in share_rows(uncertain, free))
    if not rows:
        return []
    said = effect_of_base(uncertain)
    header = ("Error", *(f"Share of {name}" for name in free))
    return [
        Table("What makes the error of each parameter: shares of its variance", header, rows),
        *([Text(f"{said[:1].upper()}{said[1:]}.")] if said else []),
    ]


def _weights_scan(result):
    """Fits under other weights of the two tests, where a result has them."""
    scan, free = result.get("weights_scan"), result["free"]
    if not scan:
        return []
    tests = list(scan[0]["rmse"])
    rows = tuple(
        (*map(number, one["weights"]), *(number(one["parameters"][k]) for k in free), *(number(one["rmse"][k], 3) for k in tests))
        for one in scan
    )
    header = (*(f"Weight of {name}" for name in tests), *free, *(f"RMSE {name} (mN)" for name in tests))
    return [Table("What other weights of the tests in the objective would find", header, rows)]


def _search(result):
    parts: list[Part] = [Text(f"{result['message'][:1].upper()}{result['message'][1:]}.")]
    steps = [row for row in result["history"] if row.get("objective") is not None]
    if len(steps) > 1:
        figure = study_plots.course([row["objective"] for row in steps], [str(row.get("phase", "")) for row in steps])
        caption = "Best objective so far (mN) over the steps of the search."
        alt = (
            f"The objective falls from {number(steps[0]['objective'])} to {number(steps[-1]['objective'])} mN in {len(steps)} steps"
        )
        parts.append(Figures((drawn(figure, caption, alt),)))
    rivals = result.get("rivals") or []
    if rivals:
        rows = tuple(
            (str(n), *(number(one["parameters"][k]) for k in result["free"]), number(one["objective"]))
            for n, one in enumerate(rivals, 1)
        )
        parts.append(Table("Other optima that were found", ("Number", *result["free"], "Objective (mN)"), rows))
    failures = result["failures"]
    if failures:
        rows = tuple(
            (str(n), ", ".join(f"{k} {number(v)}" for k, v in one["parameters"].items()), one["cause"])
            for n, one in enumerate(failures, 1)
        )
        parts.append(Table("Points where the mechanics failed", ("Number", "Parameters", "Cause"), rows[:50]))
    return Section("search", "How the search went", tuple(parts))


def _solver(result):
    counts = {name: result[name] for name in ("method", "seed", "nfev", "runs", "seconds")}
    return Section(
        "solver", "Mesh and solver", (_facts("Mesh, solver and work", {**result["mesh"], **result["solver"], **counts}),)
    )


FACTS = {
    "elements": "Elements of the quarter sample",
    "dofs": "Degrees of freedom",
    "element": "Element (q2p1: quadratic, linear pressure; q1p0: mean dilatation)",
    "smallest_mm": "Size of the smallest element (mm)",
    "linear": "Linear solver",
    "assembly": "Assembly",
    "workers": "Worker processes",
    "run_seconds": "Time of all runs (s)",
    "loose_steps": "Steps left at a loose residual",
    "penalty_error": "Share of the force that the contact penalty withholds",
    "edge_slip": "Slip across the sharp edge, share of the half-width",
    "nfev": "Sets of parameters",
    "runs": "Solves of one test",
    "seconds": "Time (s)",
    "method": "Method of the search",
    "seed": "Seed",
    "newton_iterations": "Newton iterations",
    "wall_seconds": "Time of the runs (s)",
    "setup_seconds": "Time of the set-up (s)",
}


def _facts(caption, facts):
    rows = tuple(
        (
            FACTS.get(name, name.replace("_", " ").capitalize()),
            percent(value) if name in ("penalty_error", "edge_slip") else number(value, 5),
        )
        for name, value in facts.items()
        if not isinstance(value, dict | list)
    )
    return Table(caption, ("What", "Value"), rows)


def _unit(unit, before="", after=""):
    return "" if unit in ("", "1") else f"{before}{unit}{after}"


def _alt_of_curves(simulated):
    ends = "; ".join(f"{name} rises to {curve.force[-1]:.3g} mN at {curve.displacement[-1]:.3g} mm" for name, curve in simulated)
    return f"Force against displacement: {ends}"


def _alt_of_fit(result, measured, simulated):
    given = dict(measured)
    words = []
    for name, curve in simulated:
        if name in given:
            ends = f"measured {given[name].force[-1]:.3g} mN and fitted {curve.force[-1]:.3g} mN at {curve.displacement[-1]:.3g} mm"
            words.append(f"{name}: {ends}, RMSE {number(result['rmse'].get(name), 3)} mN")
    return f"Measured and fitted force against displacement. {'; '.join(words)}"
