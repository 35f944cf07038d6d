"""The choice of columns: which column of a table holds a quantity, and in which unit."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from indentfit.arrays import Array
from indentfit.case import RecordChannel
from indentfit.errors import RecordError
from indentfit.experiment.formats.table import Table
from indentfit.experiment.formats.words import (
    ELECTRIC,
    KIND,
    is_at_the_tip,
    is_axial,
    is_backwards,
    is_corrected,
    is_deflection,
    is_height,
    is_measured,
    is_stage,
    rank_of,
    unit_of_label,
    without_unit,
)

LONGEST_LIST = 300  # letters of the columns that a message lists
OTHERWISE = 0.01  # share of the travel by which another sensor's travel differs clearly
REACH = 5.0  # ratio of travels of the indenter by two sensors
Rank = tuple[int, ...]  # smaller is better


def chosen_column(path: Path, table: Table, quantity: str, channel: RecordChannel) -> int:
    """Index of the column of a quantity: the settings give its name or number, or it follows from header, unit and motion.

    Parameters
    ----------
    path : path
        The file, for messages.
    table : Table
    quantity : str
        "time", "displacement" or "force".
    channel : RecordChannel

    Returns
    -------
    int

    Raises
    ------
    RecordError
        No column, or no single one, holds the quantity.
    """
    if channel.column is not None:
        return named_column(path, table, f"record.{quantity}.column", channel.column)
    ranks = {n: rank for n in range(table.width) if (rank := _rank(table, n, quantity)) is not None}
    ranks = ranks or _by_unit(table, quantity)
    best = [n for n, rank in ranks.items() if rank == min(ranks.values())]
    for suits in (lambda n: not is_way_back(table, n), lambda n: moves(table, n)):
        best = [n for n in best if suits(n)] or best
    if len(best) > 1 and _alike(table, best):
        best = best[:1]
    for is_kind in (is_axial, is_measured, is_corrected, is_at_the_tip):
        named = [n for n in best if any(map(is_kind, table.labels(n)))] if len(best) > 1 else []
        best = named if len(named) == 1 else best
    if len(best) == 1:
        return best[0]
    what = f"{len(best) or 'no'} columns of {quantity}"
    raise RecordError(f"{path}: {what}; give record.{quantity}.column, a name or a number of: {listed_columns(table)}")


def named_column(path: Path, table: Table, key: str, wanted: int | str) -> int:
    """Index of the column of a name, with or without its unit, or of a number from 1."""
    if isinstance(wanted, int):
        if 1 <= wanted <= table.width:
            return wanted - 1
        raise RecordError(f"{path}: {key} = {wanted}: the file has {table.width} columns, counted from 1")
    matches = [n for n in range(table.width) if any(_is_named(label, wanted) for label in table.labels(n))]
    if len(matches) == 1:
        return matches[0]
    count = f"{len(matches) or 'no'} such columns"
    raise RecordError(f"{path}: {key} = {wanted!r}: {count}; give {key}, a name or a number of: {listed_columns(table)}")


def column_unit(table: Table, place: int) -> str | None:
    """The unit that a column's header gives, None where it gives none."""
    return next((unit for label in table.labels(place) if (unit := unit_of_label(label))), None)


def column_name(table: Table, place: int) -> str:
    """A column as a message names it: the texts of its header, or its number."""
    return " ".join(reversed(table.labels(place))) or f"column {place + 1}"


def deflection_column(table: Table) -> int | None:
    """The one column of lengths that holds the deflection of a cantilever and moves; None where there is none."""
    places = [n for n in range(table.width) if any(map(is_deflection, table.labels(n))) and moves(table, n)]
    places = [n for n in places if not is_way_back(table, n)]
    lengths = [n for n in places if KIND.get(column_unit(table, n) or "") == "displacement"]
    return lengths[0] if len(lengths) == 1 else None


def piezo_column(table: Table) -> int | None:
    """The one column of lengths that holds the travel of a piezo or a stage and moves; None where there is none."""
    places = [n for n in range(table.width) if any(label.strip().casefold().startswith("piezo") for label in table.labels(n))]
    lengths = [n for n in places if KIND.get(column_unit(table, n) or "") == "displacement" and moves(table, n)]
    return lengths[0] if len(lengths) == 1 else None


def is_way_back(table: Table, place: int) -> bool:
    """Whether a column holds the way back of a quantity whose way to the sample another column holds."""
    if not any(map(is_backwards, table.labels(place))):
        return False
    return any(
        n != place and column_unit(table, n) == column_unit(table, place) and not any(map(is_backwards, table.labels(n)))
        for n in range(table.width)
    )


def stage_column(table: Table) -> int | None:
    """The first column whose header names segments or stages and that holds several values; None where there is none."""
    for n in range(table.width):
        if any(map(is_stage, table.labels(n))) and column_unit(table, n) is None:
            return n
    return None


def other_travels(table: Table, place: int) -> list[int]:
    """Columns of lengths that move as far as the column at `place`, within a factor of REACH, and not as it does: another sensor's.

    A column that holds the same motion, counted from elsewhere or the other way round, is none of them.
    """
    own = table.values[:, place]
    others = []
    for n in range(table.width):
        unit, labels = column_unit(table, n), table.labels(n)
        if (
            n == place
            or unit != column_unit(table, place)
            or is_way_back(table, n)
            or any(is_deflection(label) or is_height(label) for label in labels)
        ):
            continue
        values, span = table.values[:, n], _span(own)
        apart = min(_span(values - own), _span(values + own))
        if apart > OTHERWISE * span and span / REACH < _span(values) < REACH * span:
            others.append(n)
    return others


def listed_columns(table: Table) -> str:
    """The columns with their numbers and labels, for a message."""
    listed = "; ".join(f"{n + 1}: {' '.join(reversed(table.labels(n))) or 'no header'}" for n in range(table.width))
    return listed if len(listed) <= LONGEST_LIST else f"{listed[: LONGEST_LIST - 3]}..."


def _is_named(label: str, wanted: str) -> bool:
    return wanted.casefold().strip() in (label.casefold(), without_unit(label).casefold())


def _rank(table: Table, place: int, quantity: str) -> Rank | None:
    """How well a column fits a quantity: by its unit, by whether it moves, by its words; None where it does not."""
    labels = table.labels(place)
    ranks = [rank for label in labels if (rank := rank_of(label, quantity)) is not None]
    unit = column_unit(table, place)
    kind = KIND.get(unit or "")
    if not ranks or (kind not in (None, quantity)) or any(map(is_deflection, labels)):
        return None
    if kind is None and quantity == "displacement" and any(map(is_stage, labels)):
        return None
    unsuited = 2 if unit in ELECTRIC else int(unit is None)
    still = int(not moves(table, place)) if quantity != "force" else 0
    return (unsuited, still, *min(ranks))


def _by_unit(table: Table, quantity: str) -> dict[int, Rank]:
    """Columns that move and have a unit of the quantity, whatever their names: enough where there is one of them."""
    places = [n for n in range(table.width) if KIND.get(column_unit(table, n) or "") == quantity and moves(table, n)]
    # a deflection in units of force is the force of the cantilever, one in units of length is no displacement of the indenter
    return {n: (0,) for n in places if quantity == "force" or not any(map(is_deflection, table.labels(n)))}


def has_column(table: Table, quantity: str) -> bool:
    """Whether a column has words of a quantity, or a unit of it and moves."""
    return any(_rank(table, n, quantity) is not None for n in range(table.width)) or bool(_by_unit(table, quantity))


def moves(table: Table, place: int) -> bool:
    """Whether the numbers of a column differ."""
    values = table.values[:, place]
    values = values[np.isfinite(values)]
    return bool(values.size and np.ptp(values) > 1e-9 * max(float(np.abs(values).max()), 1e-300))


def _alike(table: Table, places: list[int]) -> bool:
    """Whether columns hold the same numbers but for a constant, within a thousandth of their range, in the same unit."""
    if len({column_unit(table, n) for n in places}) > 1:
        return False
    first = table.values[:, places[0]]
    spans = [_span(table.values[:, n] - first) for n in places[1:]]
    return all(span <= 1e-3 * _span(first) for span in spans)


def _span(values: Array) -> float:
    values = values[np.isfinite(values)]
    return float(np.ptp(values)) if values.size else float("inf")
