"""Inputs that a case calls "unknown": each gets a stated prior, and a value at which single runs are made."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from pydantic import BaseModel

from indentfit.case.messages import Fault
from indentfit.case.priors import Prior
from indentfit.case.search import Fit, Uncertain

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


IGNORANCE = (
    Ignorance("indenter", "friction", "friction", 0.5, Prior.model_construct(uniform=(0.0, 1.0))),
    Ignorance("material", "bulk_ratio", "bulk_ratio", 1000.0, Prior.model_construct(log_uniform=(20.0, 5000.0))),
    Ignorance("sample", "base", "base", "sliding", 0.5),
)
IN_TIME = (
    "cannot be fitted over all its values where the material relaxes; give a value, with its standard deviation in "
    "fit.uncertain.{name}, or fit at two values; or fit the ramp alone, without [material.relaxation]"
)


def faults_in_time(options: Fit) -> Iterator[Fault]:
    """Inputs that a fit of a material that relaxes cannot take as unknown: its intervals are linear in an input's error."""
    for known in IGNORANCE:
        if isinstance(known.prior, Prior) and getattr(options.uncertain, known.name) == known.prior:
            yield Fault((known.table, known.key), UNKNOWN, IN_TIME.format(name=known.name))


def with_priors(tables: dict[str, Any]) -> dict[str, Any]:
    """Tables, as values or dictionaries, in which no key is "unknown" any more: [fit.uncertain] holds the priors instead.

    Parameters
    ----------
    tables : dict of name -> table
        "sample", "indenter", "material" and "fit", where they are known.

    Returns
    -------
    dict of name -> table
    """
    unknown = [known for known in IGNORANCE if _get(tables.get(known.table), known.key) == UNKNOWN]
    if not unknown:
        return tables
    fit = tables.get("fit") or Fit.untouched()
    uncertain = _get(fit, "uncertain") or Uncertain.untouched()
    changed = dict(tables)
    for known in unknown:
        changed[known.table] = _with(changed[known.table], known.key, known.value)
        if _get(uncertain, known.name) is None:
            uncertain = _with(uncertain, known.name, known.prior)
    changed["fit"] = _with(fit, "uncertain", uncertain)
    return changed


def _get(table: Any, key: str) -> Any:
    return table.get(key) if isinstance(table, dict) else getattr(table, key, None)


def _with(table: Any, key: str, value: Any) -> Any:
    if isinstance(table, BaseModel):
        return table.model_copy(update={key: value})
    return {**table, key: value}
