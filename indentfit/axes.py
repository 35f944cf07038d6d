"""What the two columns of a curve are: displacement or strain, and force or stress, each with its unit.

A strain is kept as the displacement of a specimen of length 1 mm, a stress as the force on an area of 1 mm^2, so that all that
handles forces and displacements handles them too; texts, tables and figures name them by what they are.
"""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from indentfit.arrays import Array
from indentfit.errors import CurveError
from indentfit.headers import KINDS, shown
from indentfit.units import unit_factor

NAMED = re.compile(r"(?:shear[_ ])?(?P<name>strain|stretch|stress)(?P<rest>|[_\s(\[].*)", re.IGNORECASE)
NO_UNIT = {"": 1.0, "1": 1.0, "-": 1.0, "mm/mm": 1.0, "%": 0.01, "percent": 0.01}  # of strains and stretches
TARGETS = {"displacement": "mm", "strain": "1", "stretch": "1", "force": "mN", "stress": "kPa", "point": "1", "motion": "mm"}


@dataclass(frozen=True)
class Axes:
    """The quantities of a curve.

    Parameters
    ----------
    across : "displacement" (mm), "strain", or "point", the number of a measured displacement
    up : "force" (mN), "stress" (kPa), or "motion" (mm) of points of a sample
    """

    across: Literal["displacement", "strain", "point"] = "displacement"
    up: Literal["force", "stress", "motion"] = "force"

    @property
    def across_unit(self) -> str:
        """The unit of the first column, "1" for a strain."""
        return TARGETS[self.across]

    @property
    def up_unit(self) -> str:
        """The unit of the second column."""
        return TARGETS[self.up]

    @property
    def header(self) -> tuple[str, str]:
        """The names of both columns with their units, as keys of JSON and heads of CSV files."""
        return "displacement_mm" if self.across == "displacement" else self.across, f"{self.up}_{self.up_unit}"

    def at(self, value: float) -> str:
        """A place on the first axis, in words."""
        if self.across == "point":
            return f"component {value:.0f}"
        return f"{value:.4g} mm" if self.across == "displacement" else f"a strain of {value:.4g}"


INDENTATION = Axes()
MOTION = Axes("point", "motion")


def common(axes: Iterable[Axes]) -> Axes | None:
    """The axes that all curves share; None where they differ."""
    known = set(axes)
    return known.pop() if len(known) == 1 else None


@dataclass(frozen=True)
class Translation:
    """A header of strains, stretches or stresses as one of displacements and forces.

    Parameters
    ----------
    cells : list of str
        The header with displacements and forces.
    axes : Axes
        What the columns are.
    factors : (float, float)
        The factors that convert both columns to strains, or stretches, and kPa.
    stretched : bool
        Whether the first column holds stretches.
    """

    cells: list[str]
    axes: Axes
    factors: tuple[float, float] = (1.0, 1.0)
    stretched: bool = False

    @classmethod
    def of(cls, where: str, header: Sequence[str]) -> "Translation":
        """The Translation of a header; raises CurveError where a unit cannot be converted."""
        cells, names, factors = list(header), set[str](), {"displacement": 1.0, "force": 1.0}
        for n, cell in enumerate(header):
            match = NAMED.fullmatch(cell)
            if match is None:
                continue
            name, words = match["name"].lower(), [word for word in re.split(r"[_\s()\[\]]+", match["rest"]) if word]
            deviates = any(word.lower() in KINDS["deviation"] for word in words)
            unit = "".join(word for word in words if word.lower() not in KINDS["deviation"])
            side, wanted = ("force", "mN") if name == "stress" else ("displacement", "mm")
            cells[n] = f"{side}_sd_{wanted}" if deviates else f"{side}_{wanted}"
            factors[side] = _factor(where, cell, name, unit)
            names.add(name)
        axes = Axes("strain" if names & {"strain", "stretch"} else "displacement", "stress" if "stress" in names else "force")
        return cls(cells, axes, (factors["displacement"], factors["force"]), "stretch" in names)

    def points(self, rows: Sequence[Sequence[float]], compressed: bool) -> list[list[float]]:
        """Rows of displacement, force and its deviation, of a compression with both signs turned where they are negative."""
        table: Array = np.array(rows)
        table[:, 0] *= self.factors[0]
        table[:, 1:] *= self.factors[1]
        if self.stretched:
            table[:, 0] = [float(f"{(1 - value) if compressed else (value - 1):.15g}") for value in table[:, 0]]
        if compressed:
            last = int(np.argmax(np.abs(table[:, 0])))
            for column in (1,) if self.stretched else (0, 1):
                table[:, column] *= -1 if table[last, column] < 0 else 1
        return [list(row) for row in table.tolist()]


def _factor(where: str, cell: str, name: str, unit: str) -> float:
    """The factor that converts a column of strains, stretches or stresses."""
    if name != "stress":
        if unit not in NO_UNIT:
            raise CurveError(f"{where}: column {shown(cell)} has the unit {shown(unit)}; a {name} has none, or percent")
        return NO_UNIT[unit]
    try:
        return unit_factor(unit, "kPa")
    except ValueError as error:
        raise CurveError(f"{where}: column {shown(cell)} {error}") from None
