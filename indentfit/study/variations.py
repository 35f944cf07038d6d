"""Variations of a sweep: keys of the case with the values that each takes, and the cases that follow from them."""

import itertools
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from indentfit.case import Case, Range, Test, require_indentations
from indentfit.errors import CaseError
from indentfit.experiment.measured import changed_case

PERCENT = re.compile(r"(?:\+-|\+/-|±)\s*(\d+\.?\d*|\.\d+)\s*%")
SPAN = re.compile(r"([^:]+):([^:]+):(\d+)")
MOST_POINTS = 10_000

Vary = Mapping[str, Sequence[float | str]] | Sequence[str]
"""Key of the case -> its values, or texts such as "indenter.friction=0.2,0.3" or "material.mu=+-15%"."""


@dataclass(frozen=True)
class Variation:
    """One key of the case and its values, in the form of `--set KEY=VALUE`."""

    key: str
    values: tuple[str, ...]


@dataclass(frozen=True)
class SweepPlan:
    """The cases that a sweep computes: the case itself, then each point, as (values as written, Case)."""

    variations: tuple[Variation, ...]
    grid: bool
    points: tuple[tuple[dict[str, str], Case], ...]

    @property
    def cases(self) -> list[Case]:
        return [case for _, case in self.points]


def plan_sweep(case: Case, vary: Vary, grid: bool = False) -> SweepPlan:
    """The plan of a sweep over keys of a case, of whose tests the indentations are computed.

    Parameters
    ----------
    case : Case
    vary : mapping of key to values, or texts KEY=VALUES
    grid : bool
        Whether every combination of the values is planned, instead of one key at a time.

    Returns
    -------
    SweepPlan

    Raises
    ------
    CaseError
        The error's text has one line for each key or value that the case cannot have.
    """
    require_indentations(case, "a sweep")
    texts = [f"{key}={','.join(map(_text, values))}" for key, values in vary.items()] if isinstance(vary, Mapping) else vary
    variations = tuple(variation(case, text) for text in texts)
    combinations = _combinations(variations, grid)
    points = (({}, case), *zip(combinations, _cases(case, combinations), strict=True))
    return SweepPlan(variations, grid, tuple((values, changed.of_indentations) for values, changed in points))


def variation(case: Case, text: str) -> Variation:
    """The Variation of a text KEY=LIST (`0.2,0.3`), KEY=FIRST:LAST:NUMBER (evenly spaced) or KEY=+-PERCENT% of the case's value.

    Raises
    ------
    CaseError
        The text is not a variation.
    """
    name, equals, asked = (part.strip() for part in text.partition("="))
    where = f"--vary {text}"
    if not equals or not name or not asked:
        raise CaseError(f"{where}: write KEY=VALUES, such as indenter.friction=0.2,0.3 or material.mu=+-15%")
    if name.partition(".")[0] == "fit":
        raise CaseError(f"{where}: a key of the search does not change a force; vary another key")
    values = _values(case, name, asked, where)
    if "" in values:
        raise CaseError(f"{where}: a value is missing between the commas; take the extra comma away")
    return Variation(name, tuple(dict.fromkeys(values)))


def number(value: str) -> float | None:
    """The number that a value of a Variation states; None for a word."""
    try:
        return float(value)
    except ValueError:
        return None


def own_value(case: Case, name: str) -> float | str | None:
    """The case's own value of a key; None where the case has no value."""
    layer, _, key = name.removeprefix("sample.layer.").partition(".")
    known = next((table for table in case.sample.layer if table.name == layer), None)
    if known is not None:
        number = case.start_values().get(f"{layer}.{key.removeprefix('parameters.').removesuffix('.start')}", dict(known).get(key))
        return number if isinstance(number, int | float | str) else None
    section, _, rest = name.partition(".")
    parameter = rest.removeprefix("parameters.").removesuffix(".start")
    if section == "material" and parameter in case.start_values():
        return case.start_values()[parameter]
    if section == "material" and parameter in case.material.parameters:  # young, which is no parameter of the law
        given = case.material.parameters[parameter]
        return given.start if isinstance(given, Range) else given
    if section == "test":
        return _of_test(case, rest)
    value = getattr(getattr(case, section, None), rest, None)
    return value if isinstance(value, int | float | str) and not isinstance(value, Range) else None


def _of_test(case: Case, rest: str) -> float | str | None:
    if len(case.tests) == 1 and rest in Test.model_fields:  # as `case.overrides` reads it
        rest = f"0.{rest}"
    for n, test in enumerate(case.tests):
        for label in (test.name, str(n)):
            if rest.startswith(label + "."):
                table, _, key = rest[len(label) + 1 :].rpartition(".")
                owner = {"": test, "sample": case.sample_of(test), "indenter": case.indenter_of(test)}.get(table)
                value = getattr(owner, key, None)
                return value if isinstance(value, int | float | str) else None
    return None


def _values(case: Case, name: str, asked: str, where: str) -> list[str]:
    if match := PERCENT.fullmatch(asked):
        own, share = _own_number(case, name, where), float(match[1]) / 100
        return [_text(own * (1 - share)), _text(own * (1 + share))]
    if match := SPAN.fullmatch(asked):
        return _span(where, *match.groups())
    return [part.strip() for part in _split(asked)]


def _own_number(case: Case, name: str, where: str) -> float:
    own = own_value(case, name)
    if isinstance(own, bool) or not isinstance(own, int | float) or not own:
        shown = "no value" if own is None else f"the value {own!r}"
        raise CaseError(f"{where}: the case has {shown} for this key, and a percentage needs a number; give a list of values")
    return float(own)


def _span(where: str, first: str, last: str, count: str) -> list[str]:
    low, high = number(first), number(last)
    if low is None or high is None or not 2 <= int(count) <= MOST_POINTS:
        raise CaseError(f"{where}: a range is FIRST:LAST:NUMBER, two numbers and how many values, such as 0.2:0.5:4")
    return [_text(value) for value in np.linspace(low, high, int(count))]


def _split(text: str) -> list[str]:
    """Parts between commas that are not within brackets or quotes."""
    parts, depth, quote = [""], 0, ""
    for letter in text:
        quote = "" if letter == quote else letter if letter in "\"'" and not quote else quote
        depth += 0 if quote else (letter in "[{") - (letter in "]}")
        if letter == "," and not depth and not quote:
            parts.append("")
        else:
            parts[-1] += letter
    return parts


def _text(value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:.10g}"


def _combinations(variations: Sequence[Variation], grid: bool) -> list[dict[str, str]]:
    """The keys and values of each point."""
    if grid:
        keys = [varied.key for varied in variations]
        return [dict(zip(keys, values, strict=True)) for values in itertools.product(*(varied.values for varied in variations))]
    return [{varied.key: value} for varied in variations for value in varied.values]


def _cases(case: Case, combinations: Sequence[Mapping[str, str]]) -> list[Case]:
    """The Case of each point; the error names every wrong point before any run."""
    if len(combinations) > MOST_POINTS:
        raise CaseError(f"--grid: {len(combinations):,} points are too many; give fewer values")
    cases, faults = [], []
    for values in combinations:
        try:
            cases.append(changed_case(case, [f"{key}={value}" for key, value in values.items()]))
        except CaseError as error:
            faults += error.faults
    if faults:
        raise CaseError([line.replace("(--set)", "(--vary)") for line in dict.fromkeys(faults)])
    return cases
