"""The page of a fit."""

import csv
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np

from indentfit.axes import INDENTATION, Axes
from indentfit.curve import Curve
from indentfit.digits import Scale, quantity
from indentfit.inference.plain import Interval
from indentfit.inference.result import FitResult, ParameterEstimate
from indentfit.report import plots, study_plots
from indentfit.report.displacement_files import FILE as DISPLACEMENTS
from indentfit.report.displacement_files import arrows, read_displacements, words_of
from indentfit.report.first_screen import alone_words, doubts_of, next_step, pieces_words, value_words
from indentfit.report.html_case import again_section, case_words, number, tests_table
from indentfit.report.html_facts import closed_table, facts_table, stress_sections
from indentfit.report.html_methods import methods_section
from indentfit.report.law_plot import law_misfits
from indentfit.report.page import Beside, Figures, Lines, Page, Part, Section, Table, Text, drawn
from indentfit.report.schema import Stored
from indentfit.report.text import effect_of_base, law_sentences, misfit_scale, said_of_misfit, share_rows, unit_of
from indentfit.report.time_curves import fit_over_time

PARAMETERS = ("Parameter", "Value", "Unit", "95 % interval", "Verdict", "Error by noise", "Total standard error", "Searched")
SYNTHETIC = " The curves are synthetic: they were computed, not measured."
ESTIMATES = ("Parameter", "Value", "95 % interval")
FITTED = "{} (marks) and fitted (lines) force of the full sample against displacement; below, simulated minus {}."
OVER_TIME = "Measured (marks) and fitted (lines) force of the full sample against time since the first point of each test."
LAW_BAND = "By what the force exceeds that of the law: mean (line) and 95 % band (shaded) of each test."
SEEN = "What the curves see, from most to least: change of the misfit by a relative change of parameters"
OF_PROFILES = (
    "A profile holds its parameter at a value and fits all others again. χ² is the growth of the squares of the weighted residuals "
    "in units of the noise, 1 at one standard error. The limit of the 95 % interval is the square of the 97.5 % quantile of "
    "Student's t. It is 3.84 where the noise is well known, and larger where few independent residuals tell it: 4.1 for 40 "
    "degrees of freedom, 6 for 6, 10 for 3. Neighbouring residuals that resemble each other count as fewer."
)
MOST_FAILURES = 50  # in the table

Curves = list[tuple[str, Curve]]


def fit_page(stored: Stored, result: FitResult) -> Page:
    """Page of a fit's result folder."""
    result = result if result.curves else replace(result, curves=dict(_stored_curves(stored)[1]))  # they tell the units
    sections = [
        _first(stored, result),
        _what(stored, result),
        _parameters(result),
        _curves(stored, result),
        _identifiability(result),
        _search(result),
        *_displacements(stored),
        *stress_sections(stored.folder),
        _solver(result),
        *methods_section(stored, result),
        again_section(stored, "fit"),
    ]
    lead = f"{_lead(result)}{SYNTHETIC if stored.synthetic else ''}"
    headline = "The fit converged." if result.success else "The fit did not converge."
    return Page(result.title or "Fit", "Inverse finite-element fit", headline, lead, result.success, tuple(sections))


def _first(stored: Stored, result: FitResult) -> Section:
    """The first screen: estimates beside a small plot of the fit, the doubts, and the next step."""
    free = {name: result.parameters[name] for name in result.free}
    free |= {name: known for name, known in result.moduli.items() if name not in free}
    rows = tuple((f"{name}{_unit(known.unit, ' (', ')')}", value_words(known), pieces_words(known)) for name, known in free.items())
    parts: list[Text | Table] = [Table("Estimates; a parameter at its bound has no value", ESTIMATES, rows)]
    if result.misfit:
        parts.append(Text(f"Misfit: {said_of_misfit(result)}."))
    for doubt in doubts_of(result):
        said = f"{doubt.word.capitalize()}: {doubt.text}."
        parts.append(Text(said.replace("..", "."), warning=True, amber=not doubt.red))
    parts.append(Text(f"Next: {next_step(result)}."))
    measured, fitted = _stored_curves(stored)
    if not fitted:
        return Section("result", "Result", tuple(parts))
    alt = _alt_of_fit(result, measured, fitted)
    figure = plots.force_displacement(measured, fitted, None, stored.synthetic)
    screen: list[Part] = [Beside(tuple(parts), drawn(figure, _fitted_words(stored), alt))]
    if any(curve.time is not None for _, curve in fitted):
        screen.append(Figures((drawn(fit_over_time(measured, fitted, None), OVER_TIME, alt),)))
    return Section("result", "Result", tuple(screen))


def _fitted_words(stored: Stored) -> str:
    given = "synthetic" if stored.synthetic else "measured"
    return FITTED.format(given.capitalize(), given)


def _stored_curves(stored: Stored) -> tuple[Curves, Curves]:
    file = stored.folder / "curves.csv"
    return read_fitted(file) if file.is_file() else ([], [])


def _lead(result: FitResult) -> str:
    """The fitted parameters in a sentence."""
    free = {name: result.parameters[name] for name in result.free}
    words = [_estimate(name, known) for name, known in free.items()]
    clear = [name for name, known in free.items() if (known.verdict or "").startswith("determined")]
    unclear = [name for name in free if name not in clear]
    end = f" The curves determine {_and(clear)}." if clear else " The curves determine none of these."
    if clear and unclear:
        end = f" The curves determine {_and(clear)}, but not {_and(unclear)} well."
    return f"{', '.join(words)}.{end}"


def _estimate(name: str, known: ParameterEstimate) -> str:
    """A parameter with its value; at a bound, the value follows from the bound and not from the curves."""
    value = f"{value_words(known, 4)}{_unit(known.unit, ' ')}"
    return f"{name} {value} (at its {known.at_bound} bound)" if known.at_bound else f"{name} = {value}"


def _and(words: Sequence[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


def _begun(note: str, result: FitResult) -> str:
    """A note as a sentence begins; the name of a test stays as it is."""
    of_test = note.startswith(tuple(f"{name}:" for name in (*result.rmse, *result.measured)))
    return note if of_test else f"{note[:1].upper()}{note[1:]}"


def _what(stored: Stored, result: FitResult) -> Section:
    kind = "synthetic" if stored.synthetic else "measured"
    number = len(stored.case.tests) if stored.case else len(result.rmse)  # a curve in time has several misfits
    curves = f"{number or 'the'} {kind} curve{'' if number == 1 else 's'}"
    free = f"parameters {', '.join(result.free)} were" if len(result.free) > 1 else f"parameter {', '.join(result.free)} was"
    fitted = f"The free {free} fitted to {curves}."
    parts: list[Part] = [Text(fitted)]
    if stored.case:
        caption = "Curves that were fitted, with their weights in the objective"
        parts += [Lines(case_words(stored.case)), tests_table(stored.case, caption)]
    return Section("what", "What was fitted to what", tuple(parts))


def _parameters(result: FitResult) -> Section:
    known = {**result.parameters, **{name: value for name, value in result.moduli.items() if name not in result.parameters}}
    rows = tuple(_parameter_row(name, value, name in result.parameters) for name, value in known.items())
    table = Table("Parameters, their errors, and how well they are determined", PARAMETERS, rows)
    return Section(
        "parameters",
        "Parameters",
        (table, *closed_table(result.closed_forms), *(Text(f"{_begun(note, result)}.") for note in result.notes)),
    )


def _parameter_row(name: str, known: ParameterEstimate, own: bool) -> tuple[str, ...]:
    """The row of a parameter of the law, or of a modulus that follows from these."""
    value, unit = value_words(known), _unit(known.unit) or "–"
    if known.fixed:
        return (name, value, unit, "–", "fixed", "–", "–", "–")
    nothing = "unknown" if own else "–"
    errors = (nothing if error is None else number(error, 2) for error in (known.stderr, known.total))
    bounds = "–" if known.min is None else f"{number(known.min)} to {number(known.max)}"
    return (name, value, unit, pieces_words(known), known.verdict or "", *(["–", "–"] if known.at_bound else errors), bounds)


def _curves(stored: Stored, result: FitResult) -> Section:
    parts: list[Part] = []
    if not _stored_curves(stored)[1]:
        parts.append(Text("There are no fitted curves: the mechanics failed at every point of the search.", warning=True))
    units = {name: curve.shown.up_unit for name, curve in _stored_curves(stored)[1]}
    same = set(units.values()) <= {"mN"}
    scale = misfit_scale(result)
    rows = tuple(
        (name, number(scale.factor * value) if same else quantity(value, units.get(name, "mN")), *_relative(result, name))
        for name, value in result.rmse.items()
    )
    if rows:
        header = (
            "Test",
            f"RMSE ({scale.symbol})" if same else "RMSE",
            "RMSE over the largest force" if same else "RMSE over the largest",
            "R2",
        )
        parts.append(Table("Root mean square error of each test", header, rows))
    if result.objective is not None:
        squares = f"Weighted sum of their squares: {number(scale.factor**2 * (result.sum_of_squares or 0.0))} {scale.symbol}²."
        objective = f"{number(scale.factor * result.objective)} {scale.symbol}"
        parts.append(Text(f"Objective, the weighted sum of the tests' RMSEs: {objective}. {squares}"))
    if result.law_misfit is not None:
        said = tuple(law_sentences(result))
        figure = drawn(law_misfits(result), LAW_BAND, f"Misfit of the law: {'; '.join(said)}")
        parts += [Lines(tuple(f"{sentence[:1].upper()}{sentence[1:]}." for sentence in said)), Figures((figure,))]
    return Section("fit", "The fit", tuple(parts))


def _displacements(stored: Stored) -> list[Section]:
    """Measured and fitted displacements, where a fit has them."""
    fields = read_displacements(stored.folder / DISPLACEMENTS)
    if not fields:
        return []
    figures = tuple(
        drawn(arrows(known), f"{known.test}: displacements of points of the sample, and their residuals.", words)
        for known, words in zip(fields, words_of(fields), strict=True)
    )
    return [Section("displacements", "Displacements of the sample", (Lines(tuple(words_of(fields))), Figures(figures)))]


def _relative(result: FitResult, test: str) -> tuple[str, str]:
    """The misfit of a test over its largest force, and R2; results of earlier versions have neither."""
    known = result.misfit.get(test)
    return ("–", "–") if known is None else (f"{known.relative:.2%}", "–" if known.r2 is None else f"{known.r2:.4f}")


def read_fitted(path: Path) -> tuple[Curves, Curves]:
    """Measured and fitted curves of a fit's curves.csv: two lists of (test, Curve)."""
    rows: dict[str, list[list[float]]] = {}
    shown: dict[str, Axes | None] = {}
    with open(path, encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            axes = Axes("strain" if row.get("strain") else "displacement", "stress" if row.get("stress_kPa") else "force")
            shown[row["test"]] = None if axes == INDENTATION else axes
            across, up = axes.header
            cells = [float(row.get(key) or "nan") for key in (across, up, f"measured_{up}", "time_s")]
            rows.setdefault(row["test"], []).append(cells)
    columns = {name: np.array(numbers).T for name, numbers in rows.items()}
    times = {name: None if np.isnan(known[3]).any() else known[3] for name, known in columns.items()}
    measured = [
        (name, Curve(d, given, time=times[name], axes=shown[name]))
        for name, (d, _, given, _) in columns.items()
        if not np.isnan(given).any()
    ]
    return measured, [(name, Curve(d, force, time=times[name], axes=shown[name])) for name, (d, force, _, _) in columns.items()]


def _identifiability(result: FitResult) -> Section:
    parts: list[Part] = []
    if result.conclusions:
        parts.append(Lines(tuple(f"{sentence[:1].upper()}{sentence[1:]}" for sentence in result.conclusions)))
    parts += _correlation(result) + _directions(result) + _profiles(result) + _tests_alone(result)
    parts += _uncertain(result) + _taken_as_known(result) + _weights_scan(result)
    if not parts:
        parts = [Text("Not known: the fit stopped before the errors of its parameters were found.", warning=True)]
    return Section("identifiability", "What the curves determine", tuple(parts))


def _correlation(result: FitResult) -> list[Part]:
    if not result.correlation or len(result.free) < 2:
        return []
    rows = tuple((name, *(number(x, 2) for x in row)) for name, row in zip(result.free, result.correlation, strict=True))
    caption = "Correlation of the parameters' errors; near 1 or -1, only a combination is known"
    return [Table(caption, ("Parameter", *result.free), rows)]


def _directions(result: FitResult) -> list[Part]:
    if not result.singular_values or not result.directions:
        return []
    scale = misfit_scale(result)
    rows = tuple(
        (
            str(n),
            number(scale.factor * (value or 0.0), 3),
            ", ".join(f"{name} {round(x or 0.0, 2) + 0.0:+.2f}" for name, x in zip(result.free, row, strict=True)),
        )
        for n, (value, row) in enumerate(zip(result.singular_values, result.directions, strict=True), start=1)
    )
    return [Table(SEEN, ("Number", f"Singular value ({scale.symbol})", "Direction, in shares of the values"), rows)]


def _profiles(result: FitResult) -> list[Part]:
    """Figures of the profiles, where a result has them."""
    figures = []
    for name, profile in result.profiles.items():
        if not profile.values or name not in result.parameters:
            continue
        best = result.parameters[name]
        figure = plots.profile(name, profile, best)
        interval = (profile.joint and best.interval) or profile.interval
        alt = f"Profile of {name}, least at {number(best.value)}, its 95 % interval {_between(interval)}"
        circles = "; circles: runs of the model, through which the curve is drawn" if profile.confirmed else ""
        own = "the profile's own limit, which the interval need not meet: it is that of all alternatives, mostly by posterior draws"
        limit = f"; dashed: {own if profile.joint else 'its limit'}, {number(profile.limit, 3)}" if profile.limit else ""
        caption = f"Profile of {name}. Shaded: the 95 % interval{limit}; vertical line: the optimum{circles}."
        figures.append(drawn(figure, caption, alt))
    return [Figures(tuple(figures)), Text(OF_PROFILES)] if figures else []


def _tests_alone(result: FitResult) -> list[Part]:
    """What each test alone would determine, where a result has it."""
    rows = [
        (test, name, alone_words(known), _between(known.interval), known.verdict)
        for test, alone in result.tests_alone.items()
        for name, known in alone.parameters.items()
    ]
    if not rows:
        return []
    for name in result.free:
        together = result.parameters[name]
        rows.append(("all together", name, value_words(together, 4), pieces_words(together), together.verdict or ""))
    header = ("Curves", "Parameter", "Value", "95 % interval", "Verdict")
    return [Table("What each test alone determines, and all together", header, tuple(rows))]


def _uncertain(result: FitResult) -> list[Part]:
    """The sources of the errors (noise, mesh and uncertain inputs), where a result has them."""
    rows = tuple((words, *shares) for words, shares in share_rows(result.uncertain, result.free))
    if not rows:
        return []
    header = ("Error", *(f"Share of {name}" for name in result.free))
    parts: list[Part] = [Table("Sources of the error of each parameter: shares of its variance", header, rows)]
    if effect := effect_of_base(result.uncertain):
        parts.append(Text(f"{effect[:1].upper()}{effect[1:]}."))
    return parts


def _taken_as_known(result: FitResult) -> list[Part]:
    """The inputs that the case gives as exact, and the parameters at other values of them."""
    if not result.taken_as_known:
        return []
    listed = "; ".join(f"{known.input} {known.taken}" for known in result.taken_as_known)
    parts: list[Part] = [Text(f"The case gives these inputs as exact, so that their errors are not in the intervals: {listed}.")]
    rows = tuple(
        (known.input, known.taken, known.other, *(number(known.parameters[name], 3) for name in result.free))
        for known in result.taken_as_known
        if known.parameters is not None
    )
    if rows:
        header = ("Input", "Taken as known", "If it were", *(f"{name} would be" for name in result.free))
        parts.append(Table("The parameters, if an input that is taken as known were another", header, rows))
    if len(rows) < len(result.taken_as_known):
        parts.append(Text("With `--set fit.what_if=true` the fit also tries other values of the other inputs."))
    return parts


def _weights_scan(result: FitResult) -> list[Part]:
    """Fits under other weights of the two tests, where a result has them."""
    if not result.weights_scan:
        return []
    tests = list(result.weights_scan[0].rmse)
    scales = {name: Scale.of((fitted.rmse[name] for fitted in result.weights_scan), unit_of(result, name)) for name in tests}
    rows = tuple(
        (
            *map(number, fitted.weights),
            *(number(fitted.parameters[name]) for name in result.free),
            *(number(scale.factor * fitted.rmse[name], 3) for name, scale in scales.items()),
        )
        for fitted in result.weights_scan
    )
    misfits = (f"RMSE {name} ({scale.symbol})" for name, scale in scales.items())
    header = (*(f"Weight of {name}" for name in tests), *result.free, *misfits)
    return [Table("Fits with other weights of the tests in the objective", header, rows)]


def _search(result: FitResult) -> Section:
    parts: list[Part] = [Text(f"{result.message[:1].upper()}{result.message[1:]}.")]
    steps = [(step.phase, step.objective) for step in result.history if step.objective is not None]
    scale = misfit_scale(result)
    unit = scale.symbol
    if len(steps) > 1:
        figure = study_plots.course([objective for _, objective in steps], [phase for phase, _ in steps], scale)
        first, last = (number(scale.factor * steps[n][1]) for n in (0, -1))
        alt = f"The objective falls from {first} to {last} {unit} in {len(steps)} steps"
        parts.append(Figures((drawn(figure, f"Best objective so far ({unit}) over the steps of the search.", alt),)))
    rivals = tuple(
        (str(n), *(number(rival.parameters[name]) for name in result.free), number(scale.factor * rival.objective))
        for n, rival in enumerate(result.rivals, start=1)
    )
    if rivals:
        parts.append(Table("Other optima that were found", ("Number", *result.free, f"Objective ({unit})"), rivals))
    failures = tuple(
        (str(n), ", ".join(f"{name} {number(value)}" for name, value in failure.parameters.items()), failure.cause)
        for n, failure in enumerate(result.failures[:MOST_FAILURES], start=1)
    )
    if failures:
        parts.append(Table("Points where the mechanics failed", ("Number", "Parameters", "Cause"), failures))
    return Section("search", "How the search went", tuple(parts))


def _solver(result: FitResult) -> Section:
    mesh, solver = (asdict(facts) if facts else {} for facts in (result.mesh, result.solver))
    counts = {name: getattr(result, name) for name in ("method", "seed", "nfev", "runs", "seconds")}
    return Section("solver", "Mesh and solver", (facts_table("Mesh, solver and work", {**mesh, **solver, **counts}),))


def _between(interval: Interval | None) -> str:
    return "unknown" if interval is None else " to ".join(number(x) for x in interval)


def _unit(unit: str, before: str = "", after: str = "") -> str:
    return "" if unit in ("", "1") else f"{before}{unit}{after}"


def _alt_of_fit(result: FitResult, measured: Curves, fitted: Curves) -> str:
    given, words = dict(measured), []
    for name, curve in fitted:
        if name in given:
            axes, last = curve.shown, curve.displacement[-1]
            at = quantity(float(last), "mm", 3) if axes.across == "displacement" else f"a strain of {last:.3g}"
            forces = (quantity(float(force), axes.up_unit, 3) for force in (given[name].force[-1], curve.force[-1]))
            misfit = f", RMSE {quantity(result.rmse[name], axes.up_unit, 3)}" if name in result.rmse else ""
            words.append(f"{name}: measured {next(forces)} and fitted {next(forces)} at {at}{misfit}")
    same = all(curve.shown == INDENTATION for _, curve in fitted)
    return f"Measured and fitted {'force against displacement' if same else 'curves'}. {'; '.join(words)}"
