"""A population of samples as text and as a figure."""

from collections.abc import Iterator
from typing import Any

from indentfit.inference.population import Known
from indentfit.inference.population_fit import ALL, Population
from indentfit.inference.verdicts import kind_of
from indentfit.report.study_text import aligned

WHAT = (
    "mean and spread are those of the population, with 95 % intervals; noise, and errors that all samples share, are not counted "
    "as spread; the plain spread of the single fits has them in it"
)


def population_lines(result: Population) -> Iterator[str]:
    """A Population in words, line by line."""
    if result.hierarchy is None:
        used = len(result.groups) - len(result.left_out)
        yield f"{used} of {len(result.groups)} samples can be used: too few to be one population"
    else:
        yield from aligned(population_rows(result))
        if result.hierarchy.contrasts:
            yield ""
            yield from aligned(contrast_rows(result))
        yield ""
        yield from aligned(shrunken_rows(result))
        yield from (f"amber     {said}" for said in undetermined(result))
        yield f"note      {WHAT}"
    for sample, why in result.left_out.items():
        yield f"left out  {sample}: {why}"


def undetermined(result: Population) -> Iterator[str]:
    """A sentence for each parameter that most samples do not determine: seen of twelve samples with a spread of 20 %, whose curves
    determined it in none, the interval of the spread was 59 to 4143 %."""
    singles = [known.parameters for known in result.per_sample.samples if known.sample not in result.left_out]
    for name in result.hierarchy.parameters if result.hierarchy else ():
        told = sum(kind_of(known[name]) in ("determined", "weakly determined") for known in singles)
        if 2 * told < len(singles):
            yield (
                f"{name} is determined in {told} of {len(singles)} samples, so trust neither its spread nor its interval: single "
                "curves that say little of a parameter may seem to differ in it"
            )


def population_rows(result: Population) -> list[list[str]]:
    """A header and a row for each parameter: the mean of each group, the spread between samples, the plain spread."""
    assert result.hierarchy is not None  # asked for by those that have seen to it
    groups = list(next(iter(result.hierarchy.parameters.values())).mean)
    heads = [f"mean{'' if group == ALL else f' of {group}'}" for group in groups]
    rows = [["parameter", *heads, "between samples (sd)", "plain sd"]]
    for name, known in result.hierarchy.parameters.items():
        unit = "" if known.unit in ("", "1") else f" {known.unit}"
        means = [f"{words(known.mean[group])}{unit}" for group in groups]
        plain = result.plain.get(name)
        rows.append([name, *means, percents(known.sd), "–" if plain is None else f"{plain:.0%}"])
    return rows


def contrast_rows(result: Population) -> list[list[str]]:
    """A header and a row for each contrast of two groups."""
    assert result.hierarchy is not None
    rows = [["parameter", "groups", "ratio of means", "probability that it is above 1"]]
    for known in result.hierarchy.contrasts:
        rows.append([known.parameter, f"{known.group} / {known.reference}", words(known.ratio), f"{known.above:.3g}"])
    return rows


def shrunken_rows(result: Population) -> list[list[str]]:
    """A header and a row for each sample: its values by its own curves, and given all samples."""
    assert result.hierarchy is not None
    names = list(result.hierarchy.parameters)
    grouped = len(set(result.groups.values())) > 1
    rows = [
        ["sample", *(["group"] if grouped else []), *(cell for name in names for cell in (f"{name} alone", f"{name} given all"))]
    ]
    singles = {summary.sample: summary.parameters for summary in result.per_sample.samples}
    for sample, known in result.hierarchy.shrunken.items():
        cells = [cell for name in names for cell in (f"{singles[sample][name].value:.4g}", words(known[name]))]
        rows.append([sample, *([result.groups[sample]] if grouped else []), *cells])
    return rows


def words(known: Known) -> str:
    """A quantity with its interval."""
    return f"{known.value:.4g} ({known.interval[0]:.3g} to {known.interval[1]:.3g})"


def percents(known: Known) -> str:
    """A share with its interval, in percent."""
    return f"{known.value:.0%} ({known.interval[0]:.0%} to {known.interval[1]:.0%})"


def population_figure(result: Population, path: Any = None) -> Any:
    """The matplotlib Figure of a population: each sample alone and given all samples, and the mean of each group."""
    from indentfit.report import population_plot  # matplotlib is slow to import, and the words above do without

    return population_plot.population(result, path)
