"""`Parameter`: one constant of a material, with its unit, its meaning and the values that it admits."""

import math
from dataclasses import dataclass
from typing import Any

from indentfit.errors import MaterialError


@dataclass(frozen=True)
class Parameter:
    """One constant of a material: a class-level field of a `Material`.

    Parameters
    ----------
    unit : str
        "kPa", or "1" for a pure number.
    meaning : str
        What the parameter does, in words.
    min, max : float or None, in the unit
        Inclusive bounds of the admissible values.
    scale : bool
        The whole energy is proportional to the parameter.
    """

    unit: str
    meaning: str
    min: float | None = None
    max: float | None = None
    scale: bool = False

    def __get__(self, instance: object, owner: type | None = None) -> Any:
        # A material's own value hides its class's parameter, so this method only answers for the class.
        if instance is not None:
            raise AttributeError("this material has not been given its values")
        return self

    def admitted(self, value: Any, where: str) -> float:
        """The value as a float.

        Parameters
        ----------
        value : anything, in the unit
        where : str
            Material and parameter, for the message.

        Raises
        ------
        MaterialError
            The value is not a finite number within the bounds.
        """
        number = _finite(value, where)
        if self.min is not None and number < self.min:
            raise MaterialError(f"{where} = {number:g} {self.unit} is below its minimum {self.min:g}")
        if self.max is not None and number > self.max:
            raise MaterialError(f"{where} = {number:g} {self.unit} is above its maximum {self.max:g}")
        return number


def _finite(value: Any, where: str) -> float:
    """The value as a finite float, else MaterialError."""
    if isinstance(value, (bool, str)):
        raise MaterialError(f"{where} must be a number, not {value!r}")
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError):
        raise MaterialError(f"{where} must be a number, not {value!r}") from None
    if not math.isfinite(number):
        raise MaterialError(f"{where} must be finite, not {number}")
    return number
