"""The force of a cantilever, where a file has only its deflection, and states what calibrates it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from indentfit.case import Record
from indentfit.experiment.formats.choice import column_name, column_unit, has_column, moves
from indentfit.experiment.formats.table import Table
from indentfit.experiment.formats.words import KIND, is_deflection
from indentfit.experiment.record import Stated
from indentfit.units import unit_factor


def with_force(table: Table, stated: Stated, settings: Record) -> Table:
    """A table with the force of its cantilever, spring constant times deflection, where it has no column of force.

    Parameters
    ----------
    table : Table
    stated : Stated
        What the lines above the table state: the spring constant, and for a deflection in V the sensitivity.
    settings : Record

    Returns
    -------
    Table
        The table itself where it has a force, or where one of these is not known.
    """
    if settings.force.column is not None or has_column(table, "force"):
        return table
    places = [n for n in range(table.width) if any(map(is_deflection, table.labels(n))) and moves(table, n)]
    stiffness = settings.stiffness or stated.stiffness
    if len(places) != 1 or stiffness is None:
        return table
    unit, place = column_unit(table, places[0]), places[0]
    if unit == "V" and stated.sensitivity is not None:
        factor, how = stated.sensitivity, f"{1e6 * stated.sensitivity:.6g} nm/V, "
    elif KIND.get(unit or "") == "displacement" and unit is not None:
        factor, how = unit_factor(unit, "mm"), ""
    else:
        return table
    deflection = factor * table.values[:, place]
    names = [column_name(table, n) for n in range(table.width)]
    names[place] = "Deflection (mm)"
    values = table.values.copy()
    values[:, place] = deflection
    header = [[*names, f"Force by bending, {how}{stiffness:.6g} N/m (mN)"]]
    return replace(table, header=header, values=np.column_stack([values, stiffness * deflection]))
