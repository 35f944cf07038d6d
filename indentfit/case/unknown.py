"""Inputs that a case calls "unknown" or leaves out: each gets a stated prior, and a value at which single runs are made."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from indentfit.case.materials import BULK
from indentfit.case.messages import Fault
from indentfit.case.priors import Prior
from indentfit.case.search import Fit, Uncertain
from indentfit.case.section import Section

UNKNOWN = "unknown"


@dataclass(frozen=True)
class Ignorance:
    """What stands for an input that is unknown.

    Parameters
    ----------
    table, key : str
        The key of the case.
    name : str
        The key in [fit.uncertain].
    value : float or str
        Where single runs are made.
    prior : Prior or float
        The prior, or for the base the probability of the other one.
    """

    table: str
    key: str
    name: str
    value: float | str
    prior: Prior | float

    @property
    def words(self) -> str:
        """The prior in words."""
        return self.prior.words() if isinstance(self.prior, Prior) else "both values, equally probable"


IGNORANCE = (
    Ignorance("indenter", "friction", "friction", 0.5, Prior.model_construct(uniform=(0.0, 1.0))),
    Ignorance("material", "bulk_ratio", "bulk_ratio", 1000.0, Prior.model_construct(log_uniform=(20.0, 5000.0))),
    Ignorance("sample", "base", "base", "sliding", 0.5),
)
IN_TIME = (
    "where the material relaxes, an unknown input is fitted on surrogates only: these need profiles, and a method among {methods}; "
    "change these, or give a value, with its standard deviation in fit.uncertain.{name}"
)


def faults_in_time(options: Fit, methods: str) -> Iterator[Fault]:
    """Inputs that a fit of a material that relaxes cannot take as unknown where it has no surrogate: its intervals are linear in an
    input's error then. `methods` names those that have surrogates."""
    for known in IGNORANCE:
        if isinstance(known.prior, Prior) and getattr(options.uncertain, known.name) == known.prior:
            yield Fault((known.table, known.key), UNKNOWN, IN_TIME.format(name=known.name, methods=methods))


def with_priors(tables: Mapping[str, Any], tests: Sequence[Any]) -> dict[str, Any]:
    """Tables in which no key is "unknown" or left out any more: [fit.uncertain] holds the priors instead.

    A key that every test has for itself needs no prior, and gets a value only.

    Parameters
    ----------
    tables : mapping of name -> Section or None
        "sample", "indenter", "material" and "fit", where they are known.
    tests : sequence of tests, as values or dictionaries

    Returns
    -------
    dict of name -> Section or None
    """
    changed = dict(tables)
    unknown = [known for known in IGNORANCE if _is_unknown(tables.get(known.table), known.key)]
    if not unknown:
        return changed
    fit = tables.get("fit") or Fit.untouched()
    uncertain = fit.uncertain or Uncertain.untouched()
    for known in unknown:
        table = tables[known.table]
        if not getattr(table, "layers", ()):
            changed[known.table] = table.model_copy(update={known.key: known.value})
        if all_have_own(tests, known.table, known.key):
            continue
        if getattr(uncertain, known.name) is None:
            uncertain = uncertain.model_copy(update={known.name: known.prior})
    changed["fit"] = fit.model_copy(update={"uncertain": uncertain})
    return changed


def all_have_own(tests: Sequence[Any], table: str, key: str) -> bool:
    """Whether there are tests, values or dictionaries, and each has its own value of a key of a table."""
    return bool(tests) and all(_get(_get(test, table), key) is not None for test in tests)


def _is_unknown(table: Section | None, key: str) -> bool:
    """Whether a table is there, and calls a key unknown or leaves it out."""
    if table is None or (key != BULK[0] and not table.model_fields_set):
        return False  # an untouched table belongs to a case without indentations
    if layers := getattr(table, "layers", ()):
        return all(getattr(layer, name, None) is None for layer in layers for name in BULK)
    value = getattr(table, key)
    if value is None and key == BULK[0]:
        return all(getattr(table, name) is None for name in BULK)
    return value is None or value == UNKNOWN


def _get(table: Any, key: str) -> Any:
    return table.get(key) if isinstance(table, Mapping) else getattr(table, key, None)
