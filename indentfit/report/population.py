"""A population of samples as text and as a figure."""

from collections.abc import Iterator
from typing import Any

from indentfit.inference.population import Known
from indentfit.inference.population_fit import ALL, Population
from indentfit.report.study_text import aligned

WHAT = (
    "mean and spread are those of the population, with 95 % intervals; noise, and errors that all samples share, are not counted "
    "as spread; the plain spread of the single fits has them in it"
)

UNKNOWN = "not determined"


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
    """A sentence for each parameter that most samples do not determine, and one where draws are few."""
    if result.hierarchy is not None and result.hierarchy.rough:
        yield f"the population rests on {result.hierarchy.effective:.0f} effective draws: take its intervals for rough"
    for name in result.weak:
        yield (
            f"{name} is determined in {result.told[name]} of {len(result.groups) - len(result.left_out)} samples, so its spread "
            "between samples is not told: single curves that say little of a parameter may seem to differ in it"
        )


def population_rows(result: Population) -> list[list[str]]:
    """A header and a row for each parameter: the mean of each group, the spread between samples, the plain spread."""
    assert result.hierarchy is not None  # asked for by those that have seen to it
    groups = list(next(iter(result.hierarchy.parameters.values())).mean)
    heads = [f"mean{'' if group == ALL else f' of {group}'}" for group in groups]
    rows = [["parameter", *heads, "between samples (sd)", "plain sd"]]
    for name in result.hierarchy.parameters:
        plain = result.plain.get(name)
        means = [mean_of(result, name, group) for group in groups]
        rows.append([name, *means, spread_of(result, name), "–" if plain is None else f"{plain:.0%}"])
    return rows


def mean_of(result: Population, name: str, group: str) -> str:
    """The mean of a group with its interval and unit; the interval alone where most samples do not determine the parameter."""
    assert result.hierarchy is not None
    known = result.hierarchy.parameters[name]
    unit = "" if known.unit in ("", "1") else f" {known.unit}"
    low, high = known.mean[group].interval
    return f"{low:.3g} to {high:.3g}{unit}" if name in result.weak else f"{words(known.mean[group])}{unit}"


def spread_of(result: Population, name: str) -> str:
    """The spread between samples with its interval; no number where most samples do not determine the parameter."""
    assert result.hierarchy is not None
    return UNKNOWN if name in result.weak else percents(result.hierarchy.parameters[name].sd)


def contrast_rows(result: Population) -> list[list[str]]:
    """A header and a row for each contrast of two groups; no numbers where most samples do not determine the parameter."""
    assert result.hierarchy is not None
    rows = [["parameter", "groups", "ratio of means", "probability that it is above 1"]]
    for known in result.hierarchy.contrasts:
        said = [words(known.ratio), f"{known.above:.3g}"]
        said = [UNKNOWN] * 2 if known.parameter in result.weak else said
        rows.append([known.parameter, f"{known.group} / {known.reference}", *said])
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
