"""Units and digits of lengths and forces in words and tables, by the size of the numbers: small ones stay readable."""

import math
from collections.abc import Iterable
from dataclasses import dataclass

SYMBOLS = {"um": "µm", "uN": "µN", "uPa": "µPa"}
STEPS = {
    "kPa": (("kPa", 1.0), ("Pa", 1e3)),
    "mm": (("mm", 1.0), ("um", 1e3), ("nm", 1e6)),
    "mN": (("mN", 1.0), ("uN", 1e3), ("nN", 1e6)),
    "mN/mm": (("mN/mm", 1.0), ("uN/mm", 1e3), ("nN/mm", 1e6)),
}
LEAST = 0.05  # a largest number below this, in a unit, is told in the next smaller unit


@dataclass(frozen=True)
class Scale:
    """The unit and the decimals of a column of numbers.

    Parameters
    ----------
    unit : str
        The unit of the texts.
    factor : float
        Number in `unit` of a number of 1 in mm, mN or mN/mm.
    decimals : int
    """

    unit: str
    factor: float
    decimals: int

    @classmethod
    def of(cls, values: Iterable[float], unit: str, digits: int = 4) -> "Scale":
        """The scale of numbers in "mm" or "mN", or in a unit that is kept; the largest number shows so many digits."""
        sizes = [abs(value) for value in values if math.isfinite(value) and value]
        largest = max(sizes, default=1.0)
        steps = STEPS.get(unit, ((unit, 1.0),))
        name, factor = next((step for step in steps if largest * step[1] >= LEAST), steps[-1])
        return cls(name, factor, max(0, digits - 1 - _power(largest * factor)))

    @property
    def symbol(self) -> str:
        """The unit as figures and pages show it."""
        return SYMBOLS.get(self.unit, self.unit)

    def text(self, value: float) -> str:
        """A number of the column, in the column's unit."""
        return f"{value * self.factor:.{self.decimals}f}"

    def text_with_error(self, value: float, error: float) -> str:
        """A number with its error, which shows two digits at least."""
        scaled = error * self.factor
        decimals = self.decimals if not (math.isfinite(scaled) and scaled > 0) else max(self.decimals, 1 - _power(scaled))
        return f"{value * self.factor:.{decimals}f} +- {scaled:.{decimals}f}"


def fixed(value: float | None, digits: int = 3) -> str:
    """A number with three decimals, or with more where it shows fewer than so many digits with three; a dash for None."""
    if value is None:
        return "–"
    if not (math.isfinite(value) and value):
        return f"{value:.3f}"
    return f"{value:.{max(3, digits - 1 - _power(value))}f}"


def plainly(value: float, digits: int = 3) -> str:
    """A number with so many digits, in full where its size is between 0.0001 and ten million: 5000, not 5e+03."""
    if not math.isfinite(value) or not 1e-4 <= abs(value) < 1e7:
        return f"{value:.{digits}g}"
    power = _power(value)
    text = f"{round(value, digits - 1 - power):.{max(0, digits - 1 - power)}f}"
    return text.rstrip("0").rstrip(".") if "." in text else text


def quantity(value: float, unit: str, digits: int = 4) -> str:
    """A single number with the unit that suits its size, such as "120 nN"."""
    scale = Scale.of([value], unit)
    return f"{plainly(value * scale.factor, digits)} {scale.unit}"


def sizes(*lengths: float) -> str:
    """Lengths in mm as words, in the unit that suits the largest, such as "8 x 6 mm" or "5 um"."""
    scale = Scale.of(lengths, "mm")
    return f"{' x '.join(plainly(length * scale.factor, 6) for length in lengths)} {scale.unit}"


def _power(value: float) -> int:
    """The power of ten of the first digit, after rounding to three digits."""
    return int(f"{abs(value):.2e}".partition("e")[2])
