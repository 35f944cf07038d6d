"""The effect of uncertain inputs on a result: their shares in the errors, and the alternatives that were fitted."""

from dataclasses import dataclass, field
from typing import Any

from indentfit.inference.plain import Interval, plain_fields

DISCREPANCY = "discrepancy"  # the source of errors that is the law's misfit, where the case states one
BY_RESIDUALS = "by the size of its residuals, which are smooth and so tell little"  # how alternatives are weighed, mostly not


@dataclass(frozen=True)
class InputShare:
    """The effect of the uncertainty of one input on the parameters.

    Parameters
    ----------
    value : float or str
        The value of the input in the case.
    sd : float or None
        Standard deviation of the input; None for the base, which has a `probability` instead.
    effect : dict of name -> change of the parameter
        Change by one standard deviation of the input; for the base, change by the other base.
    share : dict of name -> share of the parameter's variance
    elements : int or None
        For the mesh: number of elements of the mesh with which the case's mesh was compared.
    probability : float or None
        For the base: probability that the other base is the true one, before the fit.
    prior : str or None
        What the case states about an input that was a coordinate of the fit, in words.
    fitted, interval : float and (low, high), or None
        For such an input: its value at the optimum, and its 95 % interval after the fit. The shares are then the parts of the
        squared width of the parameter's interval that would vanish if the input were known, and the effects are those of its
        standard deviation after the fit.
    unit : str or None
    """

    value: float | str
    sd: float | None
    effect: dict[str, float | None] = field(default_factory=dict)
    share: dict[str, float | None] = field(default_factory=dict)
    elements: int | None = None
    probability: float | None = None
    prior: str | None = None
    fitted: float | None = None
    interval: Interval | None = None
    unit: str | None = None

    def as_json(self) -> dict[str, Any]:
        """The keys of the input in result.json, without those whose value is None."""
        return {name: value for name, value in plain_fields(self).items() if value is not None or name == "sd"}


@dataclass(frozen=True)
class NoiseShare:
    """The share of the noise of the curves in each parameter's variance."""

    share: dict[str, float | None]


@dataclass(frozen=True)
class AlternativeFit:
    """One of several alternatives, such as a base, each of which was fitted.

    Parameters
    ----------
    name : str
        Such as "base = bonded".
    prior, probability : float
        Its probability before and after the fit.
    parameters : dict of name -> value
    intervals : dict of name -> (low, high)
        95 % intervals under this alternative.
    rmse : dict of test -> mN
    """

    name: str
    prior: float
    probability: float
    parameters: dict[str, float]
    intervals: dict[str, Interval]
    rmse: dict[str, float]


@dataclass(frozen=True)
class UncertainInputs:
    """The sources of the parameters' errors: uncertain inputs (with the mesh) and noise; and the total standard errors.

    Parameters
    ----------
    inputs : dict of name -> InputShare
    noise : NoiseShare or None
    stderr_total : dict of name -> standard error
    at : dict of name -> value
        Inputs of the forward model at the optimum, as `runs.points` takes them, where they are not those of the case.
    alternatives : tuple of AlternativeFit
        The most probable first.
    """

    inputs: dict[str, InputShare] = field(default_factory=dict)
    noise: NoiseShare | None = None
    stderr_total: dict[str, float | None] = field(default_factory=dict)
    at: dict[str, float | str] = field(default_factory=dict)
    alternatives: tuple[AlternativeFit, ...] = ()

    def as_json(self) -> dict[str, Any]:
        """The keys in result.json; empty where no input is uncertain."""
        known = {} if self.noise is None else plain_fields(self)
        return {name: value for name, value in known.items() if value or name not in ("at", "alternatives")}


@dataclass(frozen=True)
class WhatIf:
    """An input that the case gives as exact, and the parameters at a plausible other value of it.

    Parameters
    ----------
    input : str
    taken, other : str
        The case's value and the other value, with their units.
    parameters : dict of name -> value, or None
        The free parameters at the other value; None where these were not computed.
    """

    input: str
    taken: str
    other: str
    parameters: dict[str, float] | None = None


@dataclass(frozen=True)
class PosteriorFacts:
    """What samples of the posterior say, beside the profiles.

    Parameters
    ----------
    medians : dict of parameter or input -> value
    intervals : dict of parameter or input -> (low, high)
        The shortest intervals that hold 95 % of the draws.
    wider : dict of parameter -> float
        Width of the fit's interval over that of the posterior.
    draws, steps : int
        Number of draws that are kept, and of steps of each walker.
    correlated : float or None
        Largest autocorrelation time of a coordinate, in steps.
    long_enough : bool
        Whether the chains are long beside it.
    """

    medians: dict[str, float]
    intervals: dict[str, Interval]
    wider: dict[str, float]
    draws: int
    steps: int
    correlated: float | None
    long_enough: bool
