"""Units at the edge: numbers in other units, or written with their unit, are converted to mm, mN, kPa and s here."""

from __future__ import annotations

import functools
import re
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pint

NAMES_OF_UNITS = re.compile(r"[^\W\d_]+(_[^\W\d_]+)*(\^?-?\d)?([*/·][^\W\d_]+(\^?-?\d)?)*")
QUANTITY = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([^\d.\s](?:.*\S)?)\s*", re.ASCII)


@functools.cache
def unit_factor(unit: str, target: str) -> float:
    """The factor that converts a number in `unit` to a number in `target`.

    Parameters
    ----------
    unit, target : str
        Names of units that pint knows, such as "um", "N/m^2".

    Returns
    -------
    float

    Raises
    ------
    ValueError
        The unit is unknown or measures another quantity. The text is a phrase; the caller puts the name of the key or column
        in front of it.
    """
    if unit == target:
        return 1.0
    import pint  # takes a quarter of a second, and only foreign units need it

    if not NAMES_OF_UNITS.fullmatch(unit):
        raise ValueError(f"has no readable unit ({_shown(unit)}); use {target}")
    try:
        factor = _registry().Quantity(1.0, unit).to(target).magnitude
    except pint.DimensionalityError:
        raise ValueError(f"is in {unit}, which cannot be converted to {target}; give it in {target}") from None
    except Exception:  # pint's parser has many ways to say that it does not know a unit
        raise ValueError(f"has the unknown unit {_shown(unit)}; use {target}") from None
    return float(f"{factor:.14g}")


def number_in(unit: str, text: str) -> float:
    """The number that a text such as "3.3 mm" states, converted to `unit`.

    Parameters
    ----------
    unit : str
        Name of a unit, "1" for a pure number.
    text : str

    Returns
    -------
    float, in `unit`

    Raises
    ------
    ValueError
        The text is not a number with a unit of that kind. The error's text is a phrase; the caller puts the name of the key
        in front of it.
    """
    if unit == "1":
        raise ValueError("must be a plain number, without unit and quotes")
    match = QUANTITY.fullmatch(text)
    if re.match(r"\s*[-+]?\d+,\d", text):
        raise ValueError(f'has a decimal comma; write a point, "{text.strip().replace(",", ".", 1)}"')
    if not match:
        raise ValueError(f'must be a number in {unit} or a string such as "1.5 {unit}"')
    return float(f"{float(match[1]) * unit_factor(match[2], unit):.15g}")  # so that 3300 um is exactly 3.3 mm


@functools.cache
def _registry() -> pint.UnitRegistry:
    import pint

    return pint.UnitRegistry()


def _shown(text: str) -> str:
    """A unit as a message quotes it: on one line and short."""
    return repr(text if len(text) <= 60 else text[:57] + "...")
