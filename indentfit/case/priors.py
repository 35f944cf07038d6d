"""Priors: what is known about an uncertain input before the fit."""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterator
from typing import Annotated, Any

from pydantic import BeforeValidator, Field

from indentfit.case.quantities import Finite, Positive, Quantity, as_tuple
from indentfit.case.section import Section

REACH = 3.0  # standard deviations of a normal prior within which an input is looked for

Pair = Annotated[tuple[Finite, Finite], BeforeValidator(as_tuple)]
Lengths = Annotated[
    tuple[Annotated[Finite, Quantity("mm")], Annotated[Finite, Quantity("mm")]], BeforeValidator(as_tuple), Quantity("mm")
]
PositivePair = Annotated[tuple[Positive, Positive], BeforeValidator(as_tuple)]
Values = Annotated[tuple[Finite, ...], BeforeValidator(as_tuple)]
LengthValues = Annotated[tuple[Annotated[Finite, Quantity("mm")], ...], BeforeValidator(as_tuple), Quantity("mm")]
MOST_VALUES = 4  # alternatives of one input, each of which is a fit of its own
FORMS = {
    "normal": "[mean, standard deviation]",
    "log_normal": "[median, factor of one standard deviation]",
    "uniform": "[least, largest]",
    "log_uniform": "[least, largest], uniform in the logarithm",
    "values": "[one, another, ...], alternatives",
}


class Prior(Section):
    """What is known about an uncertain input: a normal, log-normal, uniform or log-uniform distribution, or a list of alternatives,
    each as probable as the others."""

    normal: Pair | None = Field(default=None, examples=[[0.5, 0.1]], description="mean and standard deviation")
    log_normal: PositivePair | None = Field(
        default=None, examples=[[1000, 2]], description="median, and the factor that one standard deviation is"
    )
    uniform: Pair | None = Field(default=None, examples=[[0, 1]], description="least and largest value")
    log_uniform: PositivePair | None = Field(
        default=None, examples=[[20, 5000]], description="least and largest value, uniform in the logarithm"
    )
    values: Values | None = Field(
        default=None, examples=[[0, 0.3]], description="alternatives, each of which is fitted and weighed by its evidence"
    )

    @classmethod
    def about(cls, mean: float, sd: float) -> Prior:
        """The normal prior of a mean and a standard deviation."""
        return cls(normal=(float(mean), float(sd)))

    @property
    def form(self) -> str:
        """The name of the distribution."""
        return next(name for name in FORMS if getattr(self, name) is not None)

    @property
    def numbers(self) -> tuple[float, float]:
        """The two numbers of the distribution; of a list of alternatives the least and the largest."""
        if self.values is not None:
            return min(self.values), max(self.values)
        pair: tuple[float, float] = getattr(self, self.form)
        return pair

    @property
    def logarithmic(self) -> bool:
        """Whether the distribution is one of the logarithm."""
        return self.form.startswith("log")

    def coordinate(self, value: float) -> float:
        """The value, or its logarithm where the distribution is one of the logarithm."""
        return math.log(value) if self.logarithmic else value

    def value(self, coordinate: float) -> float:
        """The inverse of `coordinate`."""
        return math.exp(coordinate) if self.logarithmic else coordinate

    @property
    def center(self) -> float:
        """Mean, or middle, of the coordinate."""
        a, b = self.numbers
        return self.coordinate(a) if "normal" in self.form else (self.coordinate(a) + self.coordinate(b)) / 2

    @property
    def spread(self) -> float | None:
        """Standard deviation of the coordinate of a normal or log-normal prior; None for a uniform one."""
        if "normal" not in self.form:
            return None
        return math.log(self.numbers[1]) if self.logarithmic else self.numbers[1]

    @property
    def sd(self) -> float:
        """Standard deviation of the input, in its unit; that of a log-normal or log-uniform prior to first order at its centre."""
        if self.values is not None:
            return statistics.pstdev(self.values)
        a, b = (self.coordinate(number) for number in self.numbers)
        wide = self.spread if self.spread is not None else (b - a) / math.sqrt(12)
        return wide * (self.value(self.center) if self.logarithmic else 1.0)

    def bounds(self, least: float = -math.inf) -> tuple[float, float]:
        """Values between which the input is looked for: those of a uniform prior, else REACH standard deviations each way."""
        if self.spread is None:
            low, high = self.numbers
        else:
            low, high = (self.value(self.center + side * REACH * self.spread) for side in (-1, 1))
        return max(low, least), high

    def log_density(self, coordinate: float, least: float = -math.inf) -> float:
        """Logarithm of the density at a coordinate, normalised within the `bounds`."""
        low, high = (self.coordinate(bound) for bound in self.bounds(least))
        if self.spread is None:
            return -math.log(high - low)
        z, ends = (coordinate - self.center) / self.spread, [(bound - self.center) / self.spread for bound in (low, high)]
        within = (math.erf(ends[1] / math.sqrt(2)) - math.erf(ends[0] / math.sqrt(2))) / 2
        return -(z**2) / 2 - math.log(math.sqrt(2 * math.pi) * self.spread * within)

    def words(self, unit: str = "") -> str:
        """The distribution in words, with a unit."""
        unit = f" {unit}" if unit not in ("", "1") else ""
        if self.values is not None:
            return " or ".join(f"{value:g}{unit}" for value in self.values)
        a, b = self.numbers
        if self.form == "normal":
            return f"{a:.4g} +- {b:.3g}{unit}"
        if self.form == "log_normal":
            return f"{a:.4g}{unit}, within a factor of {b:.3g}"
        return f"{a:g} to {b:g}{unit}" + (" in the logarithm" if self.logarithmic else "")

    def disagreements(self) -> Iterator[tuple[str, str]]:
        given = [name for name in FORMS if getattr(self, name, None) is not None]
        if len(given) != 1:
            yield (given or ["normal"])[-1], "give one of " + ", ".join(f"{name} = {text}" for name, text in FORMS.items())
            return
        if self.values is not None:
            if not 2 <= len(set(self.values)) == len(self.values) <= MOST_VALUES:
                yield "values", f"give 2 to {MOST_VALUES} different values"
            return
        a, b = self.numbers
        if self.form == "normal" and b <= 0:
            yield "normal", "its standard deviation must be above 0"
        elif self.form == "log_normal" and b <= 1:
            yield "log_normal", "its factor must be above 1, such as 2"
        elif "uniform" in self.form and a >= b:
            yield self.form, "its first number must be below its second"


class PriorOfLength(Prior):
    """A Prior of a length, whose numbers may carry a unit."""

    normal: Lengths | None = Field(default=None, examples=[[0, 0.01]], description="mean and standard deviation")
    uniform: Lengths | None = Field(default=None, examples=[[-0.01, 0.01]], description="least and largest value")
    values: LengthValues | None = Field(
        default=None, examples=[[3.2, 3.4]], description="alternatives, each of which is fitted and weighed by its evidence"
    )


def prior_or_none(value: Any, kind: type[Prior]) -> Prior | None:
    """The Prior that a table of a case states, or None where the table states something else."""
    if isinstance(value, Prior):
        return value
    return kind.model_validate(value) if isinstance(value, dict) and (set(FORMS) & set(value)) else None
