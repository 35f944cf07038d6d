"""The page of processed records."""

import functools
import math
from collections.abc import Iterator
from pathlib import Path

from indentfit.digits import Scale
from indentfit.experiment.judgement import RATINGS
from indentfit.experiment.replicates import Spread
from indentfit.report.html_case import CITATION, number
from indentfit.report.page import Figures, Lines, Page, Part, Picture, Section, Table, Text, image, vector_image
from indentfit.report.records import difference_size, outlier_names, relaxation_words
from indentfit.report.schema import Stored
from indentfit.report.stored_process import StoredProcess, StoredRecord

RECORDS = (
    "Record", "Rating", "Stiffness (mN/mm)", "R²", "Contact (mm)", "Velocity (mm/s)", "Strain rate (1/s)", "Depth (mm)",
    "Peak (mN)", "G∞/G0", "Remarks",
)  # fmt: skip
HERTZ = "E/(1-ν²) by Hertz (kPa)"
SPREADS = ("Of", "Records", "Mean", "Standard deviation", "95 % interval of the mean", "Median", "Outliers")
DIFFERENCES = ("Test", "Number", "p", "95 % interval of the difference (mN/mm)")
ERRORS = (
    "The uncertainty of a contact point and of a peak is half of its 95 % interval, that of a stiffness one standard error, that "
    "of a Hertz modulus half of the 95 % interval by the scatter of the samples alone. Outliers are shown, and every number counts "
    "them."
)
LARGEST = 400_000  # bytes of an SVG that is put into the page; a larger one is shown as PNG
DRAWN = (
    "{name}: force (grey: raw) and displacement over time with the contact point; force over displacement with the fitted line; "
    "the hold with its Prony series, where there is one."
)


def process_page(stored: Stored, result: StoredProcess) -> Page:
    """Page of the result folder of `process`."""
    number_of_records = len(result.records) + len(result.problems)
    headline = f"{len(result.records)} of {number_of_records} records could be used."
    stiffness = result.statistics.stiffness.items()
    lead = "; ".join(f"{direction}°: stiffness {number(spread.mean)} mN/mm, n = {spread.n}" for direction, spread in stiffness)
    sections = [_records(result), *_statistics(stored.folder, result), *_relaxations(result), *_pictures(stored.folder, result)]
    sections.append(Section("cite", "To cite", (Text(f"{CITATION}."),)))
    end = f"{lead}." if lead else ""
    return Page("Processed records", "Raw records of a rig", headline, end, not result.problems, tuple(sections))


def _records(result: StoredProcess) -> Section:
    outlying = outlier_names(result.statistics)
    known = result.records.values()
    depth, peak = Scale.of((record.depth for record in known), "mm"), Scale.of((record.peak for record in known), "mN")
    rows = [_row(name, record, name in outlying, depth, peak) for name, record in result.records.items()]
    hertz = any(record.hertz for record in known)
    units = {"(mm)": f"({depth.symbol})", "(mm/s)": f"({depth.symbol}/s)", "(mN)": f"({peak.symbol})"}
    heads = tuple(functools.reduce(lambda head, unit: head.replace(*unit), units.items(), head) for head in RECORDS)
    if hertz:
        heads = (*heads[:-1], HERTZ, heads[-1])
        rows = [(*row[:-1], _hertz(record), row[-1]) for row, record in zip(rows, known, strict=True)]
    parts: list[Part] = [Text(ERRORS), *_ratings(result), Table("Records that could be used", heads, tuple(rows))]
    if result.problems:
        parts.append(Table("Records that could not be used", ("Record", "Problem"), tuple(result.problems.items())))
    return Section("records", "Records", tuple(parts))


def _ratings(result: StoredProcess) -> Iterator[Text]:
    """How many records are good, fair and poor."""
    words = [_rating(record) for record in result.records.values()]
    counts = [f"{words.count(rating)} {rating}" for rating in RATINGS if rating in words]
    if counts:
        yield Text(f"Rated {', '.join(counts)}: by noise, drift, the approach, and how well the contact point is known.")


def _rating(record: StoredRecord) -> str:
    return record.rating.partition(":")[0] or "–"


def _hertz(record: StoredRecord) -> str:
    if record.hertz is None:
        return "–"
    return f"{number(record.hertz[0])} ± {number(record.hertz[1], 2)}"


def _row(name: str, record: StoredRecord, outlying: bool, depth: Scale, peak: Scale) -> tuple[str, ...]:
    remarks = [*(["outlier?"] if outlying else []), *record.notes]
    return (
        name,
        _rating(record),
        f"{number(record.slope)} ± {number(record.slope_stderr, 2)}",
        f"{record.r_squared:.4f}",
        depth.text_with_error(record.contact, record.contact_uncertainty).replace("+-", "±"),
        number(record.velocity * depth.factor, 3),
        number(record.strain_rate, 3),
        depth.text(record.depth),
        _peak(record, peak),
        "–" if record.relaxation is None else f"{record.relaxation.ratio:.3f}",
        "; ".join(remarks) or "–",
    )


def _peak(record: StoredRecord, scale: Scale) -> str:
    if record.peak_uncertainty is None:
        return number(record.peak * scale.factor)
    return scale.text_with_error(record.peak, record.peak_uncertainty).replace("+-", "±")


def _statistics(folder: Path, result: StoredProcess) -> Iterator[Section]:
    """Spreads and differences of the directions, with the figure of the replicates; nothing where no direction is known."""
    statistics = result.statistics
    if not statistics.stiffness:
        return
    rows = [_spread_row(f"stiffness, {direction}° (mN/mm)", spread) for direction, spread in statistics.stiffness.items()]
    rows += [_spread_row("ratio 90° / 0°, per sample", statistics.ratio)] if statistics.ratio else []
    parts: list[Part] = [Table("Stiffness by direction", SPREADS, tuple(rows))]
    if statistics.differences:
        tests = ((test.test, difference_size(test), number(test.p, 3), _between(test.interval)) for test in statistics.differences)
        parts.append(Table("Tests of the difference between the directions", DIFFERENCES, tuple(tests)))
    caption = "A typical curve of each direction with its line; stiffness of each record; mean curves with their fits."
    alt = "Stiffness by direction. " + "; ".join(f"{row[0]}: {row[2]}" for row in rows)
    if picture := _picture(folder, "replicates", caption, alt):
        parts.append(Figures((picture,)))
    yield Section("statistics", "Statistics", tuple(parts))


def _spread_row(what: str, spread: Spread) -> tuple[str, ...]:
    numbers = number(spread.mean), _known(spread.sd), _between(spread.interval), number(spread.median)
    return (what, str(spread.n), *numbers, ", ".join(spread.outliers) or "–")


def _known(value: float) -> str:
    return number(None if math.isnan(value) else value, 3)


def _between(interval: tuple[float, float] | None) -> str:
    return "–" if interval is None or math.isnan(interval[0]) else f"{number(interval[0])} to {number(interval[1])}"


def _relaxations(result: StoredProcess) -> Iterator[Section]:
    lines = [f"{name}: {relaxation_words(record.relaxation)}" for name, record in result.records.items() if record.relaxation]
    if lines:
        yield Section("relaxation", "Relaxation", (Text("Prony series fitted to the holds:"), Lines(tuple(lines))))


def _pictures(folder: Path, result: StoredProcess) -> Iterator[Section]:
    """The figures of the records, where they were drawn."""
    pictures = []
    for name, record in result.records.items():
        alt = f"Record {name}: contact at {record.contact:.4f} mm, stiffness {record.slope:.4g} mN/mm"
        pictures.append(_picture(folder, Path(record.curve).stem, f"{DRAWN.format(name=name)}{_judged(record)}", alt))
    if shown := tuple(picture for picture in pictures if picture):
        yield Section("figures", "Figures of the records", (Figures(shown),))


def _judged(record: StoredRecord) -> str:
    """The rating of a record, how its contact point was found, and what was taken from the file, for the caption of its figure."""
    rating = f" Rating: {record.rating}." if record.rating else ""
    taken = f" Taken: {record.taken}; contact {record.method.replace('_', ' ')}." if record.taken else ""
    return rating + taken


def _picture(folder: Path, stem: str, caption: str, alt: str) -> Picture | None:
    path = folder / "figures" / f"{stem}.png"
    vectors = path.with_suffix(".svg")
    if vectors.is_file() and vectors.stat().st_size < LARGEST:
        return vector_image(vectors, caption, alt)
    return image(path, caption, alt) if path.is_file() else None
