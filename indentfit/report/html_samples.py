"""The page of the fits of a set of samples."""

from indentfit.inference.per_sample import PerSample, SampleSummary
from indentfit.report.html_case import number
from indentfit.report.page import Figures, Lines, Page, Part, Section, Table, Text, drawn
from indentfit.report.per_sample import samples_figure
from indentfit.report.schema import Stored

SPREAD = ("Parameter", "Unit", "Samples", "Mean", "Standard deviation", "Least", "Largest")


def per_sample_page(stored: Stored, result: PerSample) -> Page:
    """Page of the result folder of a fit of samples."""
    converged = sum(summary.success for summary in result.samples)
    headline = f"{converged} of {len(result.samples)} fits converged."
    lead = "; ".join(f"{name}: {over}" for name, over in result.spread.items())
    sections = (parameters_section(result), spread_section(result), folders_section(stored, result))
    good = converged == len(result.samples)
    return Page("Fits of samples", "Inverse finite-element fits, one for each sample", headline, f"{lead}.", good, sections)


def parameters_section(result: PerSample) -> Section:
    """The parameters of each sample."""
    header = ("Sample", *result.free, "Objective (mN)", "Thickness (mm)", "Diameter (mm)", "Converged")
    rows = tuple(_row(summary, result) for summary in result.samples)
    parts: list[Part] = [Table("Parameters of each sample with their standard errors", header, rows)]
    if any(summary.parameters for summary in result.samples):
        caption = "Parameters of each sample with their standard errors; dashed: the mean over the fits that converged."
        spread = "; ".join(f"{name} from {over.min:.4g} to {over.max:.4g}" for name, over in result.spread.items())
        parts.append(Figures((drawn(samples_figure(result), caption, f"A mark for each sample. {spread or 'No fit converged'}."),)))
    return Section("parameters", "Parameters", tuple(parts))


def _row(summary: SampleSummary, result: PerSample) -> tuple[str, ...]:
    if summary.problem is not None:
        return (summary.sample, *["–"] * (len(result.free) + 3), summary.problem)
    known = (summary.parameters[name] for name in result.free)
    values = (f"{number(estimate.value)} ± {number(estimate.total, 2)}" for estimate in known)
    sizes = number(summary.objective), number(summary.thickness), number(summary.diameter)
    return (summary.sample, *values, *sizes, "yes" if summary.success else "no")


def spread_section(result: PerSample) -> Section:
    """The plain spread of the fits."""
    rows = tuple(
        (name, "–" if over.unit == "1" else over.unit, str(over.n), *map(number, (over.mean, over.sd, over.min, over.max)))
        for name, over in result.spread.items()
    )
    if not rows:
        return Section("spread", "Spread", (Text("No fit converged, so there is no spread.", warning=True),))
    return Section("spread", "Spread", (Table("Each parameter over the samples whose fits converged", SPREAD, rows),))


def folders_section(stored: Stored, result: PerSample) -> Section:
    """The folders of the fits."""
    there = [summary for summary in result.samples if summary.folder and (stored.folder / summary.folder).is_dir()]
    lines = Lines(tuple(f"{summary.sample}: {summary.folder}/report.html" for summary in there))
    words = Text("Each sample has a result folder of its own with its curves, intervals and case.")
    return Section("samples", "The fit of each sample", (words, lines) if there else (words,))
