"""Processed records in numbers: as text, as a table of stiffnesses, as JSON."""

import csv
import importlib.metadata
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from indentfit.digits import Scale, quantity
from indentfit.experiment.hertz import Hertz
from indentfit.experiment.outcomes import Outcome, usable
from indentfit.experiment.process_result import ProcessResult
from indentfit.experiment.processed import ProcessedRecord
from indentfit.experiment.relaxation import Prony
from indentfit.experiment.replicates import Difference, MeanCurve, Spread, Statistics
from indentfit.inference.plain import with_error
from indentfit.report.vtu import file_names

FORMAT = "indentfit.process/2"
Cell = str | float | int | None
COLUMNS: dict[str, Callable[[ProcessedRecord], Cell]] = {
    "stiffness_mN_per_mm": lambda record: record.line.slope,
    "stiffness_stderr": lambda record: record.line.stderr,
    "r_squared": lambda record: record.line.r_squared,
    "quadratic_mN_per_mm2": lambda record: record.parabola.curvature,
    "quadratic_slope_mN_per_mm": lambda record: record.parabola.slope,
    "quadratic_r_squared": lambda record: record.parabola.r_squared,
    "contact_mm": lambda record: record.contact.displacement,
    "contact_uncertainty_mm": lambda record: record.contact.uncertainty,
    "velocity_mm_per_s": lambda record: record.velocity,
    "strain_rate_per_s": lambda record: record.strain_rate,
    "depth_mm": lambda record: record.depth,
    "peak_mN": lambda record: record.peak,
    "peak_uncertainty_mN": lambda record: record.peak_uncertainty,
    "modulus_ratio": lambda record: record.relaxation.ratio if record.relaxation else None,
}
SAMPLE = ("sample", "direction", "file", "status", "thickness_mm", "diameter_mm")


def curve_files(result: ProcessResult) -> dict[str, str]:
    """Name of each usable record -> the CSV of its curve, relative to the result folder; safe names, no two alike."""
    stems = file_names([name.replace("°", "").replace(" ", "_") for name in result.records])
    return {name: f"curves/{stem}.csv" for name, stem in zip(result.records, stems, strict=True)}


def outlier_names(statistics: Statistics) -> set[str]:
    """Names of the records whose stiffness lies far from the others of their direction, with and without the direction."""
    names = [(sample, direction) for direction, spread in statistics.stiffness.items() for sample in spread.outliers]
    return {f"{sample} {direction}°" for sample, direction in names} | {sample for sample, _ in names}


# Tables


def write_stiffness(path: Path, result: ProcessResult) -> None:
    """Write stiffness.csv: a row for each record; one that cannot be used has its problem in the last column."""
    strains, outlying = result.settings.strains, outlier_names(result.statistics)
    forces = [f"force_mN_at_{strain:g}" for strain in strains]
    with open(path, "w", encoding="utf-8", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow([*SAMPLE, *COLUMNS, *forces, "outlier", "notes"])
        for outcome in result.outcomes:
            outlier = "yes" if outcome.name in outlying else ""
            table.writerow([*map(_blank, [*_sample(outcome), *_numbers(outcome, strains)]), outlier, _remarks(outcome)])


def _sample(outcome: Outcome) -> list[Cell]:
    """The cells of SAMPLE."""
    entry = outcome.entry
    status = "ok" if outcome.processed else "failed"
    return [entry.sample, entry.direction, _file(outcome), status, entry.thickness, entry.diameter]


def _file(outcome: Outcome) -> str | None:
    return None if outcome.entry.path is None else str(outcome.entry.path)


def _numbers(outcome: Outcome, strains: Sequence[float]) -> list[Cell]:
    """The cells of COLUMNS and of the forces at strains; empty where the record cannot be used."""
    record = outcome.processed
    if record is None:
        return [None] * (len(COLUMNS) + len(strains))
    return [*(column(record) for column in COLUMNS.values()), *(record.forces.get(strain) for strain in strains)]


def _remarks(outcome: Outcome) -> str:
    return outcome.problem or ("; ".join(outcome.processed.notes) if outcome.processed else "")


def _blank(value: Cell) -> str | int:
    return "" if value is None else f"{value:.10g}" if isinstance(value, float) else value


def write_means(path: Path, means: Mapping[int, MeanCurve]) -> None:
    """Write the mean curves, direction -> MeanCurve, with their standard deviations, as one CSV."""
    with open(path, "w", encoding="utf-8", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(["direction", "displacement_mm", "force_mN", "sd_mN", "n"])
        for direction, mean in means.items():
            columns = (mean.displacement.tolist(), mean.force.tolist(), mean.sd.tolist())
            table.writerows([direction, *row, mean.count] for row in zip(*columns, strict=True))


# JSON


def process_facts(result: ProcessResult) -> dict[str, Any]:
    """What summary.json holds."""
    files = curve_files(result)
    return {
        "format": FORMAT,
        "indentfit": importlib.metadata.version("indentfit"),
        "record": result.settings.model_dump(mode="json"),
        "records": [_outcome_facts(outcome, files) for outcome in result.outcomes],
        **_statistics_facts(result.statistics),
        "mean_curves": {str(direction): _mean_facts(mean) for direction, mean in result.means.items()},
    }


def _outcome_facts(outcome: Outcome, files: Mapping[str, str]) -> dict[str, Any]:
    """One record: where it comes from, and its numbers or its problem."""
    entry = outcome.entry
    facts = {
        "sample": entry.sample,
        "direction": entry.direction,
        "file": _file(outcome),
        "thickness_mm": entry.thickness,
        "diameter_mm": entry.diameter,
        "status": "ok" if outcome.processed else "failed",
        "problem": outcome.problem,
    }
    if outcome.processed is None:
        return facts | {"curve": None}
    return facts | _record_facts(outcome.processed) | {"curve": files[outcome.name]}


def _record_facts(record: ProcessedRecord) -> dict[str, Any]:
    time = record.record.time
    return {
        "contact": asdict(record.contact),
        "window_s": [float(time[record.window.start]), float(time[record.window.stop - 1])],
        "velocity_mm_per_s": record.velocity,
        "strain_rate_per_s": record.strain_rate,
        "depth_mm": record.depth,
        "peak_mN": record.peak,
        "peak_uncertainty_mN": record.peak_uncertainty,
        "filter_s": record.ramp.length * record.record.interval,
        "linear": asdict(record.line),
        "quadratic": asdict(record.parabola),
        "force_mN_at_strain": {f"{strain:g}": force for strain, force in record.forces.items()},
        "relaxation": record.relaxation and asdict(record.relaxation),
        "hertz": record.hertz and asdict(record.hertz),
        "taken": record.record.taken,
        "rating": str(record.judgement),
        "notes": list(record.notes),
    }


def _statistics_facts(statistics: Statistics) -> dict[str, Any]:
    return {
        "stiffness_mN_per_mm": {str(direction): asdict(spread) for direction, spread in statistics.stiffness.items()},
        "ratio_90_to_0": statistics.ratio and asdict(statistics.ratio),
        "differences": [asdict(difference) for difference in statistics.differences],
    }


def _mean_facts(mean: MeanCurve) -> dict[str, Any]:
    return {
        "displacement_mm": mean.displacement,
        "force_mN": mean.force,
        "sd_mN": mean.sd,
        "n": mean.count,
        "linear": asdict(mean.line),
        "quadratic": asdict(mean.parabola),
    }


# Text


def process_lines(result: ProcessResult) -> Iterator[str]:
    """The result in words: a line for each record, for each hold, and for each of the statistics."""
    yield from _record_lines(result)
    yield from more_lines(result)


def more_lines(result: ProcessResult) -> Iterator[str]:
    """The holds and the statistics in words."""
    for outcome in usable(result.outcomes):
        yield from _source_lines(outcome.name, outcome.processed)
    for outcome in usable(result.outcomes):
        if outcome.processed.relaxation:
            yield f"relaxation  {outcome.name}: {relaxation_words(outcome.processed.relaxation)}"
    yield from _statistics_lines(result.statistics)


def _source_lines(name: str, record: ProcessedRecord) -> Iterator[str]:
    """What was taken from the file, how contact and zero were found, the Hertz modulus, and the rating of the record."""
    contact = record.contact
    if record.record.taken:
        where = f"contact {contact.method}, zero {quantity(contact.baseline, 'mN')}"
        yield f"taken       {name}: {record.record.taken}; {where}"
    if record.hertz:
        yield f"Hertz       {name}: {hertz_words(record.hertz)}"
    yield f"rating      {name}: {record.judgement}"


def hertz_words(hertz: Hertz) -> str:
    """A Hertz modulus in words, with its theory's limits."""
    scale = Scale.of([hertz.modulus], "kPa")
    value = f"E/(1-nu^2) = {scale.text_with_error(hertz.modulus, hertz.interval)} {scale.unit} (95 %)"
    sphere = f"sphere of radius {quantity(hertz.radius, 'mm')}, half-space"
    return f"{value}, E = {quantity(0.75 * hertz.modulus, 'kPa')} if incompressible; {sphere}"


def _record_lines(result: ProcessResult) -> Iterator[str]:
    """A table of the records; those that cannot be used have no numbers."""
    outlying = outlier_names(result.statistics)
    good = [outcome.processed for outcome in usable(result.outcomes)]
    depth, peak = Scale.of((record.depth for record in good), "mm"), Scale.of((record.peak for record in good), "mN")
    rows = [["record", "stiffness", "R2", "contact", "velocity", "depth", "peak", ""]]
    rows.append(["", "mN/mm", "", depth.unit, f"{depth.unit}/s", depth.unit, peak.unit, ""])
    for outcome in result.outcomes:
        cells = _cells(outcome.processed, depth, peak) if outcome.processed else ["failed", *[""] * 5]
        rows.append([outcome.name, *cells, "outlier?" if outcome.name in outlying else ""])
    widths = [max(len(row[n]) for row in rows) for n in range(len(rows[0]))]
    for row in rows:
        yield "  ".join(f"{cell:<{width}}" for cell, width in zip(row, widths, strict=True)).rstrip()


def _cells(record: ProcessedRecord, depth: Scale, peak: Scale) -> list[str]:
    return [
        with_error(record.line.slope, record.line.stderr),
        f"{record.line.r_squared:.4f}",
        depth.text_with_error(record.contact.displacement, record.contact.uncertainty),
        f"{record.velocity * depth.factor:.3g}",
        depth.text(record.depth),
        peak.text_with_error(record.peak, record.peak_uncertainty),
    ]


def relaxation_words(series: Prony) -> str:
    """A Prony series in words: the ratio of the moduli, and each share with its time."""
    columns = zip(series.shares, series.shares_stderr, series.times, series.times_stderr, strict=True)
    terms = ", ".join(
        f"{with_error(share, share_stderr)} at {with_error(time, time_stderr)} s"
        for share, share_stderr, time, time_stderr in columns
    )
    others = ", ".join(f"{other:.3f} with {n}" for n, other in series.by_terms.items() if n != len(series.shares))
    ratio, count = with_error(series.ratio, series.ratio_stderr), len(series.shares)
    return f"Ginf/G0 = {ratio} with {count} Prony terms ({others}); shares {terms}"


def _statistics_lines(statistics: Statistics) -> Iterator[str]:
    for direction, spread in statistics.stiffness.items():
        yield f"stiffness   {direction}°: {_mean(spread)} mN/mm, n = {spread.n}{_interval(spread.interval)}{_outliers(spread)}"
    if statistics.ratio:
        spread = statistics.ratio
        yield f"ratio       90° / 0°, per sample: {_mean(spread)}, n = {spread.n}{_interval(spread.interval)}{_outliers(spread)}"
    yield from map(_difference_line, statistics.differences)


def _difference_line(difference: Difference) -> str:
    between = f"; difference{_interval(difference.interval)[1:]} mN/mm" if difference.interval else ""
    return f"difference  {difference.test}, {difference_size(difference)}: p = {difference.p:.3g}{between}"


def difference_size(difference: Difference) -> str:
    """How many values a test of a difference compares: pairs, or the numbers of both directions."""
    first, second = difference.n
    return f"{first} pairs" if difference.test.startswith(("paired", "Wilcoxon")) else f"{first} + {second}"


def _mean(spread: Spread) -> str:
    return f"{spread.mean:.4g}" + (f" +- {spread.sd:.3g} (SD)" if spread.n > 1 else "")


def _interval(interval: tuple[float, float]) -> str:
    return f", 95 % interval {interval[0]:.4g} to {interval[1]:.4g}" if interval[0] == interval[0] else ""


def _outliers(spread: Spread) -> str:
    return f"; outliers, which every number counts: {', '.join(spread.outliers)}" if spread.outliers else ""
