"""The table of a material's relaxation, and the motion of a test in time."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import BeforeValidator, Field

from indentfit.case.quantities import Positive, Quantity, Unit, as_tuple
from indentfit.case.section import Section, known
from indentfit.hereditary import RelaxationFunction, fractional, prony

Seconds = Annotated[Positive, Quantity("s")]
Velocity = Annotated[Positive, Quantity("mm/s")]
SPAN = 1e-3, 10.0  # times in which a fractional function is exact: of the ramp's duration, and of the time at the hold's end


class Relaxation(Section):
    """How the stress relaxes in time (quasi-linear viscoelasticity): G(t)/G_inf = 1 + sum g exp(-t/tau), or on the base
    "instantaneous" G(t)/G_0 = 1 - sum g (1 - exp(-t/tau)). The pressure of a nearly incompressible sample does not relax."""

    place = "material.relaxation"

    base: Literal["long_term", "instantaneous"] = Field(
        default="long_term",
        description="the modulus that the parameters of the material give: after infinite time (long_term), or at once",
    )
    g: Annotated[tuple[Positive, ...], BeforeValidator(as_tuple)] = Field(
        examples=[[0.8, 0.5]], description="share of each term, over the modulus of the base"
    )
    tau: Annotated[tuple[Seconds, ...], BeforeValidator(as_tuple), Unit("s")] = Field(
        examples=[[0.5, 5.0]], description="time of each term"
    )
    order: Annotated[float, Field(ge=0.05, le=0.95, allow_inf_nan=False)] | None = Field(
        default=None,
        examples=[0.3],
        description="order of a fractional (power-law) function in place of exponentials: exp(-t/tau) becomes the Mittag-Leffler "
        "function of -(t/tau)^order; g and tau then have one value each",
    )

    def disagreements(self) -> Iterator[tuple[str, str]]:
        if not known(self.g, self.tau):
            return
        if not self.g:
            yield "g", "must have at least one share"
        elif len(self.g) != len(self.tau):
            yield "tau", f"must have as many times as g has shares: {len(self.g)}"
        elif self.order is not None and len(self.g) != 1:
            yield "order", "needs one share and one time"
        if self.base == "instantaneous" and sum(self.g) >= 1:
            yield "g", "must sum to less than 1 on the base instantaneous; nothing would be left after long times"

    def words(self) -> str:
        """The function in words."""
        over = "G_inf" if self.base == "long_term" else "G_0"
        kind = "exponentials" if self.order is None else f"fractional of order {self.order:g}"
        shares, times = (", ".join(f"{value:g}" for value in values) for values in (self.g, self.tau))
        modulus = "long-term" if self.base == "long_term" else "instantaneous"
        return f"g {shares} of {over}, tau {times} s, {kind}; the parameters are {modulus} moduli, and forces those of a ramp"

    def function(self, ramp: float, end: float) -> RelaxationFunction:
        """The function m(t) for a test.

        Parameters
        ----------
        ramp : float, s
            Duration of the ramp.
        end : float, s
            The longest time that is asked for.

        Returns
        -------
        RelaxationFunction
        """
        if self.order is None:
            return prony(self.g, self.tau, self.base)
        return fractional(self.g[0], self.tau[0], self.order, self.base, SPAN[0] * ramp, SPAN[1] * end)
