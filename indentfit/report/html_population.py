"""The page of a population of samples."""

from indentfit.inference.population_fit import Population
from indentfit.report.html_samples import folders_section, parameters_section, spread_section
from indentfit.report.page import Figures, Lines, Page, Part, Section, Table, Text, drawn
from indentfit.report.population import (
    WHAT,
    contrast_rows,
    mean_of,
    population_figure,
    population_rows,
    shrunken_rows,
    spread_of,
    undetermined,
)
from indentfit.report.schema import Stored

CAPTION = (
    "Each sample by its own curves (open) and given all samples (filled), with 95 % intervals; the mean of each group with its "
    "95 % interval (dark band), and one standard deviation between samples (light band)."
)


def population_page(stored: Stored, result: Population) -> Page:
    """Page of the result folder of a population."""
    used = len(result.groups) - len(result.left_out)
    good = result.hierarchy is not None
    headline = (
        f"{used} of {len(result.groups)} samples as one population." if good else "The samples are too few to be one population."
    )
    singles = result.per_sample
    sections = (
        *((_population(result),) if good else ()),
        parameters_section(singles),
        spread_section(singles),
        folders_section(stored, singles),
    )
    return Page("Population of samples", "Hierarchical fit of samples", headline, _lead(result), good, sections)


def _lead(result: Population) -> str:
    if result.hierarchy is None:
        return "The single fits are below."
    parts = []
    for name, known in result.hierarchy.parameters.items():
        group = result.reference if result.reference in known.mean else next(iter(known.mean))
        parts.append(f"{name}: mean {mean_of(result, name, group)}, between samples {spread_of(result, name)}")
    return f"{'; '.join(parts)}."


def _population(result: Population) -> Section:
    header, *rows = population_rows(result)
    alt = f"A panel for each parameter. {_lead(result)}"
    parts: list[Part] = [
        Figures((drawn(population_figure(result), CAPTION, alt),)),
        Table("The population: means and spread with 95 % intervals", _heads(header), tuple(map(tuple, rows))),
        *(Text(f"{said}.") for said in undetermined(result)),
        Text(f"{WHAT[:1].upper()}{WHAT[1:]}."),
    ]
    if result.hierarchy and result.hierarchy.contrasts:
        header, *rows = contrast_rows(result)
        parts.append(Table("Contrasts of groups", _heads(header), tuple(map(tuple, rows))))
    header, *rows = shrunken_rows(result)
    parts.append(Table("Each sample by its own curves, and given all samples", _heads(header), tuple(map(tuple, rows))))
    if result.left_out:
        parts.append(Lines(tuple(f"Left out: {sample}, because {why}" for sample, why in result.left_out.items())))
    return Section("population", "The population", tuple(parts))


def _heads(header: list[str]) -> tuple[str, ...]:
    return tuple(f"{cell[:1].upper()}{cell[1:]}" for cell in header)
