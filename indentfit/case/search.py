"""The tables of a fit: how parameters are searched for, and which inputs are uncertain."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, PlainValidator, WithJsonSchema, WrapValidator

from indentfit.case.methods import SearchMethod
from indentfit.case.priors import Prior, PriorOfLength, prior_or_none
from indentfit.case.quantities import Finite, Odds, Positive, Quantity, Share, Unit, as_tuple, is_number, refusal
from indentfit.case.ranges import Range, RangeOfAngle
from indentfit.case.section import Section

LEAST_INPUT = {"friction": 0.0, "bulk_ratio": 1.0, "thickness": 1e-3, "size": 1e-3}  # of the inputs that cannot be lower


WANTED = (
    "must be a standard deviation above 0, a prior such as {uniform = [least, largest]} or {normal = [mean, sd]}, or "
    "{start = ..., min = ..., max = ...} to be fitted"
)


def _uncertainty(value: Any, kind: type[Prior]) -> float | Prior | Range:
    if isinstance(value, Range):
        return value
    if prior := prior_or_none(value, kind):
        return prior
    if isinstance(value, dict):
        return Range.model_validate(value)
    if not is_number(value) or value <= 0:
        raise refusal(WANTED)
    return float(value)


def _of_number(value: Any, _: Any) -> float | Prior | Range:
    return _uncertainty(value, Prior)


def _of_length(value: Any, _: Any) -> float | Prior | Range:
    return _uncertainty(value, PriorOfLength)


def _of_angle(value: Any, _: Any) -> RangeOfAngle | None:
    if isinstance(value, Range):
        return RangeOfAngle(**dict(value))
    if value is None:
        return None
    if not isinstance(value, dict):
        raise refusal("must be {start = ..., min = ..., max = ...}: the angle is fitted")
    return RangeOfAngle.model_validate(value)


Spread = Annotated[float | Prior | Range, WrapValidator(_of_number)]
SpreadOfLength = Annotated[float | PriorOfLength | Range, WrapValidator(_of_length), Quantity("mm")]


class Uncertain(Section):
    """Uncertain inputs: each has a prior (a number is the standard deviation about the case's value; or a table with `normal`,
    `log_normal`, `uniform`, `log_uniform` or `values`), over which the intervals of the parameters go; or a range, in which the
    input is fitted together with the parameters."""

    place = "fit.uncertain"

    friction: Spread | None = Field(
        default=None, examples=[0.1], description="standard deviation, prior or range of the friction coefficient"
    )
    bulk_ratio: Spread | None = Field(
        default=None, examples=[200.0], description="standard deviation, prior or range of bulk over shear modulus"
    )
    thickness: SpreadOfLength | None = Field(
        default=None, examples=[0.05], description="standard deviation, prior or range of the thickness"
    )
    size: SpreadOfLength | None = Field(
        default=None,
        examples=[0.01],
        description="standard deviation, or prior, of the indenter's size: the width of a strip, the diameter of others",
    )
    offset: SpreadOfLength | None = Field(
        default=None,
        examples=[0.005],
        description="standard deviation, or prior, of each test's contact point: F(d - offset); a range is one offset of all tests",
    )
    base: Odds = Field(
        default=None,
        examples=[0.3],
        description="probability that the base is not as sample.base says (sliding or bonded); true means 0.5",
    )
    fibre_angle: Annotated[RangeOfAngle | None, WrapValidator(_of_angle), Unit("degrees")] = Field(
        default=None,
        examples=[{"start": 0.0, "min": -45.0, "max": 45.0}],
        description="range of sample.fibre_angle, which is then fitted: the fibres of all tests turn together",
    )
    mesh: Annotated[float, Field(ge=0, le=100, allow_inf_nan=False)] = Field(
        default=1.0,
        description="error of the forces by the mesh: factor on its standard deviation; 0 leaves it and its correction out",
    )
    force: Share | None = Field(
        default=None,
        examples=[0.01],
        description="relative standard deviation common to all forces of a test: calibration of the load cell",
    )

    @property
    def given(self) -> dict[str, float]:
        """Name -> standard deviation (for the base: probability) of the inputs that have one, or a prior."""
        spreads = {name: value.sd if isinstance(value, Prior) else value for name, value in self}
        return {name: value for name, value in spreads.items() if isinstance(value, float) and value}

    @property
    def fitted(self) -> dict[str, Range]:
        """Name -> Range of the inputs that are fitted."""
        return {name: value for name, value in self if isinstance(value, Range)}

    def disagreements(self) -> Iterator[tuple[str, str]]:
        for name, low in LEAST_INPUT.items():
            value = getattr(self, name)
            if isinstance(value, Range) and value.min < low:
                yield name, f"its min must be at least {low:g}; raise it"
            if isinstance(value, Prior) and value.numbers[0] < low:
                yield name, f"its first number must be at least {low:g}; raise it"
        for name in ("offset", "force"):
            value = getattr(self, name)
            if isinstance(value, Prior) and value.values is not None:
                yield name, "a list of alternatives is for friction, bulk_ratio, thickness and size; give one of the other priors"
        if isinstance(self.size, Range):
            yield "size", "must be a standard deviation or a prior"


Modulus = Annotated[Positive, Quantity("kPa")]
KnownModulus = Annotated[tuple[Modulus, Modulus], BeforeValidator(as_tuple), Quantity("kPa")]


class KnownModuli(Section):
    """Small-strain moduli of the same tissue that are known from elsewhere (shear waves, elastography, rheometry), each with its
    standard deviation."""

    place = "fit.prior"

    shear: KnownModulus | None = Field(
        default=None, examples=[[1.2, 0.1]], description="shear modulus and its standard deviation, of a material without fibres"
    )
    young: KnownModulus | None = Field(
        default=None, examples=[[3.6, 0.3]], description="Young's modulus and its standard deviation, of a material without fibres"
    )
    shear_along: KnownModulus | None = Field(
        default=None, examples=[[2.1, 0.1]], description="shear modulus in a plane with the fibres and its standard deviation"
    )
    shear_across: KnownModulus | None = Field(
        default=None, examples=[[1.2, 0.1]], description="shear modulus in the plane across the fibres and its standard deviation"
    )
    young_along: KnownModulus | None = Field(
        default=None, examples=[[20.0, 2.0]], description="Young's modulus along the fibres and its standard deviation"
    )
    young_across: KnownModulus | None = Field(
        default=None, examples=[[4.5, 0.4]], description="Young's modulus across the fibres and its standard deviation"
    )

    @property
    def given(self) -> dict[str, tuple[float, float]]:
        """Name -> value and standard deviation, kPa, of the moduli that are known."""
        return {name: pair for name, pair in self if pair is not None}


LENGTH = 0.5  # of the law's misfit, over the largest depth, where the case gives none
SCALES = (1e-3, 0.3)  # between which an unknown scale of the law's misfit is looked for, uniformly


def _scale(value: Any) -> float | str:
    if value == "unknown":
        return "unknown"
    if not is_number(value) or not 0 < value < 1:
        raise refusal('must be a share of the force, above 0 and below 1, such as 0.02, or "unknown"')
    return float(value)


SCALE = {"anyOf": [{"type": "number", "exclusiveMinimum": 0, "exclusiveMaximum": 1}, {"const": "unknown"}]}
Scale = Annotated[float | Literal["unknown"], PlainValidator(_scale), WithJsonSchema(SCALE)]


class Discrepancy(Section):
    """The law's own misfit as a term of the fit: a smooth error of each curve, which vanishes at small strains."""

    place = "fit.discrepancy"

    scale: Scale | None = Field(
        default=None,
        examples=[0.02],
        description="standard deviation of the law's misfit at the largest depth of a test, over the force there; where it is "
        "'unknown', or the table has a length only, the curves tell it, with a uniform prior from 0.001 to 0.3",
    )
    length: Annotated[float, Field(ge=0.05, le=10, allow_inf_nan=False)] | None = Field(
        default=None,
        examples=[0.5],
        description="length over which the law's misfit changes, over the largest depth of the test; 0.5 by default",
    )

    @property
    def stated(self) -> float | str | None:
        """The scale, "unknown", or None where the misfit is no term of the fit."""
        return "unknown" if self.scale is None and self.length is not None else self.scale

    @property
    def reach(self) -> float:
        """The length."""
        return LENGTH if self.length is None else self.length


class Fit(Section):
    """How the parameters are searched for."""

    place = "fit"

    method: SearchMethod = Field(default="ga", description="method of the search; ga is the genetic algorithm")
    direct: bool = Field(default=False, description="search on the forward model itself, without a surrogate: hundreds of runs")
    seed: int = Field(default=0, ge=0, lt=2**32, description="seed of the random numbers")
    population: int | None = Field(default=None, ge=4, le=10_000, examples=[80], description="individuals of a generation")
    generations: int | None = Field(default=None, ge=1, le=10_000, examples=[60], description="generations at most")
    starts: int | None = Field(
        default=None, ge=1, le=1000, examples=[5], description="local searches of least_squares, at different starts"
    )
    workers: int | None = Field(default=None, ge=1, le=1024, examples=[2], description="processes; by default one for each core")
    time_limit: Annotated[Positive, Unit("s")] = Field(
        default=600.0, description="CPU time that one solve of one test may take before it counts as failed"
    )
    tolerance: Share = Field(default=1e-6, description="relative change of the objective below which the search ends")
    profiles: bool = Field(default=True, description="whether profile likelihoods are computed, where the search had a surrogate")
    posterior: bool = Field(
        default=False,
        description="whether samples of the posterior are drawn on the surrogate (posterior.nc for ArviZ, and a figure); needs "
        "indentfit[posterior]",
    )
    what_if: bool | None = Field(
        default=None,
        examples=[True],
        description="whether one more run for each input that the case gives as exact (friction, base, bulk ratio, thickness, "
        "size) tells what the parameters would be at another value of it; by default where a parameter is determined, except by "
        "least_squares, whose runs are limited",
    )
    published: dict[str, Finite] = Field(
        default_factory=dict,
        examples=[{"mu": 1.49}],
        description="published parameters to compare the result with, such as mu = 1.49",
    )
    uncertain: Uncertain = Field(default=Uncertain.untouched(), description="table of the uncertain inputs")
    prior: KnownModuli = Field(default=KnownModuli.untouched(), description="table of small-strain moduli known from elsewhere")
    discrepancy: Discrepancy = Field(default=Discrepancy.untouched(), description="table of the law's own misfit")
