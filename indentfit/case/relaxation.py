"""The table of a material's relaxation, and the motion of a test in time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import BeforeValidator, Field, WrapValidator

from indentfit.case.quantities import Positive, Quantity, Unit, as_tuple, is_number, refusal
from indentfit.case.ranges import Range
from indentfit.case.section import Section, known
from indentfit.hereditary import RelaxationFunction, fractional, fractional_in_series, prony
from indentfit.units import number_in

Seconds = Annotated[Positive, Quantity("s")]
Velocity = Annotated[Positive, Quantity("mm/s")]
SPAN = 1e-3, 10.0  # times in which a fractional function is exact: of the ramp's duration, and of the time at the hold's end
ORDERS = 0.05, 0.95  # of fractional functions
MOST = {"long_term": 10.0, "instantaneous": 0.99}  # upper bounds of shares, where the tool chooses the terms
BEYOND = 2.0  # factor by which times may lie outside of those that the records can see, where the tool chooses the terms


def _number_or_range(value: Any, number: str, least: str, low: float, strict: bool) -> float | Range:
    """A number, or a range, from `low` on."""
    if isinstance(value, dict):
        value = Range.model_validate(value)
    numbers = (value.min,) if isinstance(value, Range) else (value,)
    if not all(is_number(x) for x in numbers):
        raise refusal(f"must be {number}, or {{start = ..., min = ..., max = ...}} to be fitted")
    if any(x <= low if strict else x < low for x in numbers):
        raise refusal(f"must be {least}; raise it" if not isinstance(value, Range) else f"its min must be {least}; raise it")
    return value if isinstance(value, Range) else float(value)


def _share(value: Any, _: Any) -> float | Range:
    if is_number(value) and value == 0:
        raise refusal("must be above 0; leave the term out")
    return _number_or_range(value, "a share above 0", "at least 0", 0.0, strict=False)


def _time(value: Any, _: Any) -> float | Range:
    if isinstance(value, dict):
        value = {key: _seconds(inner) for key, inner in value.items()}
    return _number_or_range(_seconds(value), "a time above 0 s", "above 0", 0.0, strict=True)


def _seconds(value: Any) -> Any:
    """A text with a unit as a number in s; other values unchanged."""
    if not isinstance(value, str):
        return value
    try:
        return number_in("s", value)
    except ValueError as error:
        raise refusal(str(error)) from None


def _order(value: Any, _: Any) -> float | Range | None:
    if value is None:
        return None
    words = f"{ORDERS[0]:g} to {ORDERS[1]:g}"
    order = _number_or_range(value, f"an order from {words}", f"at least {ORDERS[0]:g}", ORDERS[0], strict=False)
    if (order.max if isinstance(order, Range) else order) > ORDERS[1]:
        raise refusal(f"must be an order from {words}; lower it")
    return order


Share = Annotated[float | Range, WrapValidator(_share)]
Time = Annotated[float | Range, WrapValidator(_time)]
Order = Annotated[float | Range | None, WrapValidator(_order)]


@dataclass(frozen=True)
class Window:
    """The times of relaxation that the records of a case can see.

    Parameters
    ----------
    shortest : float, s
        The shortest ramp, where a hold follows; otherwise a tenth of it.
    longest : float, s
        The longest hold, or ramp where no hold follows.
    ramp : float, s
        The shortest ramp.
    hold : float, s
        The longest hold.
    """

    shortest: float
    longest: float
    ramp: float
    hold: float


class Relaxation(Section):
    """How the stress relaxes in time (quasi-linear viscoelasticity): G(t)/G_inf = 1 + sum g exp(-t/tau), or on the base
    "instantaneous" G(t)/G_0 = 1 - sum g (1 - exp(-t/tau)). The pressure of a nearly incompressible sample does not relax."""

    place = "material.relaxation"
    rivals: ClassVar[dict[str, frozenset[str]]] = {
        "terms": frozenset({"g", "tau"}),
        "g": frozenset({"terms"}),
        "tau": frozenset({"terms"}),
    }

    base: Literal["long_term", "instantaneous"] = Field(
        default="long_term",
        description="the modulus that the parameters of the material give: after infinite time (long_term), or at once",
    )
    terms: Annotated[int, Field(ge=1, le=4)] | None = Field(
        default=None,
        examples=[2],
        description="number of terms to be fitted, in place of g and tau: their times start between the ramp and the end of the "
        "hold, in equal ratios",
    )
    g: Annotated[tuple[Share, ...], BeforeValidator(as_tuple)] = Field(
        default=(),
        examples=[[0.8, 0.5]],
        description="share of each term, over the modulus of the base; each a number, or {start, min, max} to be fitted",
    )
    tau: Annotated[tuple[Time, ...], BeforeValidator(as_tuple), Unit("s")] = Field(
        default=(), examples=[[0.5, 5.0]], description="time of each term; each a number, or {start, min, max} to be fitted"
    )
    order: Order = Field(
        default=None,
        examples=[0.3],
        description="order of a fractional (power-law) function in place of exponentials, a number or {start, min, max}: "
        "exp(-t/tau) becomes the Mittag-Leffler function of -(t/tau)^order; g and tau then have one value each",
    )

    def disagreements(self) -> Iterator[tuple[str, str]]:
        if not known(self.g, self.tau):
            return
        number = self.terms or len(self.g)
        if self.terms and (self.g or self.tau):
            yield "terms", f"{'g' if self.g else 'tau'} is given too; keep one of them"
        elif not self.terms and not self.g:
            yield "g", "must have at least one share; or give terms, the number of terms to be fitted"
        elif not self.terms and len(self.g) != len(self.tau):
            yield "tau", f"must have as many times as g has shares: {len(self.g)}"
        elif self.order is not None and number != 1:
            yield "order", "needs one share and one time"
        if self.base == "instantaneous" and sum(_start(share) for share in self.g) >= 1:
            yield "g", "must sum to less than 1 on the base instantaneous; nothing would be left after long times"

    def placed(self, window: Window) -> Relaxation:
        """The table with shares and times in place of `terms`; the table itself where it has none."""
        if not self.terms:
            return self
        n, most = self.terms, MOST[self.base]
        edges = np.geomspace(window.shortest, window.longest, n + 1)
        middles = np.sqrt(edges[1:] * edges[:-1])
        edges[0], edges[-1] = edges[0] / BEYOND, edges[-1] * BEYOND
        times = [_range(t, low, high) for t, low, high in zip(middles, edges[:-1], edges[1:], strict=True)]
        return self.model_copy(update={"terms": None, "g": (_range(0.4 / n, 0.0, most),) * n, "tau": tuple(times)})

    @property
    def parameters(self) -> dict[str, float | Range]:
        """Name -> value or range: g1, g2, ..., tau1, tau2, ..., order."""
        shares = {f"g{n}": value for n, value in enumerate(self.g, 1)}
        times = {f"tau{n}": value for n, value in enumerate(self.tau, 1)}
        return {**shares, **times, **({} if self.order is None else {"order": self.order})}

    @property
    def numbers(self) -> dict[str, float]:
        """Name -> value, or where its search starts, of each parameter."""
        return {name: _start(value) for name, value in self.parameters.items()}

    @property
    def free(self) -> dict[str, Range]:
        """Name -> range of the parameters to be fitted."""
        return {name: value for name, value in self.parameters.items() if isinstance(value, Range)}

    def at(self, values: Mapping[str, Any]) -> Relaxation:
        """The table with numbers: those of `values`, else those where a search starts."""
        numbers = {name: float(values.get(name, _start(value))) for name, value in self.parameters.items()}
        shares, times = (tuple(numbers[f"{key}{n}"] for n in range(1, len(self.g) + 1)) for key in ("g", "tau"))
        return self.model_copy(update={"g": shares, "tau": times, "order": numbers.get("order")})

    def words(self) -> str:
        """The function in words."""
        known = self.at({})
        over = "G_inf" if self.base == "long_term" else "G_0"
        kind = "exponentials" if known.order is None else f"fractional of order {known.order:.4g}"
        shares, times = (", ".join(f"{value:.4g}" for value in values) for values in (known.g, known.tau))
        modulus = "long-term" if self.base == "long_term" else "instantaneous"
        return f"g {shares} of {over}, tau {times} s, {kind}; the parameters are {modulus} moduli"

    def function(self, ramp: float, end: float, values: Mapping[str, Any] | None = None, part: float = 0.0) -> RelaxationFunction:
        """The function m(t) for a test.

        Parameters
        ----------
        ramp : float, s
            Duration of the ramp.
        end : float, s
            The longest time that is asked for.
        values : mapping of name -> value, or None
            Values of parameters, among others; the start values stand for those that it does not name.
        part : float
            Share of the elastic force that does not relax, as of springs in series (`RelaxationFunction.in_series`).

        Returns
        -------
        RelaxationFunction
        """
        given = values or {}
        shares = [given[f"g{n}"] if f"g{n}" in given else _start(share) for n, share in enumerate(self.g, 1)]
        times = [given[f"tau{n}"] if f"tau{n}" in given else _start(time) for n, time in enumerate(self.tau, 1)]
        if self.order is None:
            return prony(shares, times, self.base).in_series(part)
        order = float(given.get("order", _start(self.order)))
        share, time = fractional_in_series(float(shares[0]), float(times[0]), order, self.base, part)
        return fractional(share, time, order, self.base, SPAN[0] * ramp, SPAN[1] * end)


def _start(value: float | Range) -> float:
    return value.start if isinstance(value, Range) else value


def _range(start: float, low: float, high: float) -> Range:
    """A range with readable numbers."""
    low, high = (float(f"{value:.4g}") for value in (low, high))
    return Range.model_construct(start=min(max(float(f"{start:.4g}"), low), high), min=low, max=high)
