"""The result of a fit: parameters with their errors, and the findings from which these follow, as frozen values.

Units: mm, mN, kPa, s. None stands for an unknown value.
"""

import html
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, ClassVar

from pydantic import InstanceOf, TypeAdapter

from indentfit.case import Case
from indentfit.case.doubts import CurveDoubt
from indentfit.curve import Curve
from indentfit.digits import quantity
from indentfit.fem.facts import MeshFacts
from indentfit.inference.agreement import CurveMisfit, TestPrediction
from indentfit.inference.law_misfit import LawMisfit
from indentfit.inference.plain import NOT_IN_JSON, Interval, plain_fields
from indentfit.inference.shares import PosteriorFacts, UncertainInputs, WhatIf
from indentfit.inverse.course import HistoryStep, SurrogateFacts
from indentfit.runs.closed_form import ClosedForm

Numbers = tuple[float | None, ...]
SMOOTH = 0.5  # autocorrelation of neighbouring points from which residuals may be misfit
FEW, MANY = 15, 20  # points: fewer than FEW never tell how correlated their noise is, and MANY do enough
UNTOLD = 0.5  # of the effective number of points: where fewer are not improbable, a note says so
UNLIKELY = 0.01  # probability below which smooth residuals are no independent noise
UNKNOWN = "not known: the fit stopped before its errors were found"


@dataclass(frozen=True)
class ParameterEstimate:
    """One parameter of the material, or one input that was fitted: its value and how well the curves determine it.

    Parameters
    ----------
    value : float, in `unit`
    unit : str
        "1" for a pure number.
    fixed : bool
        Whether the case gave the value; all fields below are then None.
    start, min, max : float
        Start value and bounds of the search.
    stderr : float
        Standard error by the noise of the curves alone.
    stderr_total : float
        Standard error by noise, uncertain inputs and the mesh together; None where only the noise is known.
    interval : (low, high)
        95 % interval with all stated errors: by draws of the posterior where uncertain inputs are coordinates of the fit,
        by the profile where the result has it, otherwise by linear theory.
    interval_linear : (low, high)
        95 % interval by linear theory.
    at_bound : "lower", "upper" or None
    verdict : str
        How well the curves determine the parameter, in words.
    limited_by : str
        What limits the parameter: "noise", "misfit" (of the law), "mesh", the name of an uncertain input, "bound", "tests" (which
        contradict each other), or "search" (which did not end at a proved optimum).
    """

    value: float
    unit: str
    fixed: bool = False
    start: float | None = None
    min: float | None = None
    max: float | None = None
    stderr: float | None = None
    at_bound: str | None = None
    interval: Interval | None = None
    interval_linear: Interval | None = None
    verdict: str | None = None
    stderr_total: float | None = None
    pieces: tuple[Interval, ...] | None = None
    limited_by: str | None = None

    @property
    def total(self) -> float | None:
        """The standard error by all known errors: `stderr_total`, or `stderr` where only the noise is known."""
        return self.stderr if self.stderr_total is None else self.stderr_total

    def as_json(self) -> dict[str, Any]:
        """The keys of the parameter in result.json, without those whose value is None."""
        if self.fixed:
            return {"value": self.value, "unit": self.unit, "fixed": True}
        known = plain_fields(self)
        dropped = [name for name in ("stderr_total", "interval_linear", "pieces", "limited_by") if known[name] is None]
        return {name: value for name, value in known.items() if name not in dropped}

    def __str__(self) -> str:
        unit = "" if self.unit in ("", "1") else f" {self.unit}"
        between = "" if self.interval is None else f" ({self.interval[0]:.3g} to {self.interval[1]:.3g})"
        return f"{self.value:.4g}{unit}{between}"


@dataclass(frozen=True)
class CurveNoise:
    """The noise of one test that its residuals show.

    Parameters
    ----------
    sigma : float, mN
    autocorrelation : float
        Correlation of neighbouring points; 0 where the residuals look independent.
    effective_points, points : float, int
        Number of independent points with the same information, and number of points.
    white : float
        Probability that residuals of independent noise are as smooth as these.
    stated : float, mN
        Independent noise beside it, by which the standard deviations that the curve states exceed `sigma`.
    fewest_points : float or None
        The least number of independent points that is not improbable (5 %): few points seldom show how correlated they are. None in
        results that do not state it.
    """

    sigma: float | None
    autocorrelation: float
    effective_points: float
    points: int
    white: float = 1.0
    stated: float = 0.0
    fewest_points: float | None = None

    @property
    def untold(self) -> bool:
        """Whether the residuals leave open how correlated they are."""
        return self.fewest_points is not None and self.fewest_points < UNTOLD * self.effective_points

    @property
    def few(self) -> bool:
        """Whether the points are too few to tell how correlated their noise is, so that intervals are short where it is."""
        return self.points < MANY and (self.untold or self.points < FEW) and not self.systematic

    @property
    def systematic(self) -> bool:
        """Whether the residuals are mostly misfit of the model, and not noise; smooth residuals below the noise that the curve
        states are no misfit that matters."""
        below = self.sigma is not None and self.stated > self.sigma
        return self.autocorrelation > SMOOTH and self.white < UNLIKELY and not below


@dataclass(frozen=True)
class ConfirmedPoint:
    """A run at the end of a profile: chi2 by the run, chi2 that the surrogate predicted, or the cause of the run's failure."""

    value: float
    chi2: float | None
    predicted: float | None
    cause: str | None = None
    parameters: Mapping[str, float | str] = field(default_factory=dict)


@dataclass(frozen=True)
class Profile:
    """Profile likelihood of one parameter: the others are fitted again at each of its values.

    Parameters
    ----------
    values : (m,), in the parameter's unit
    chi2 : (m,)
        Growth of the weighted squares, 1 at one standard error near the optimum.
    limit : float or None
        Largest chi2 within the 95 % interval; None where chi2 has no bound.
    interval : (low, high)
    confirmed : tuple of ConfirmedPoint
        Runs of the forward model at the ends of the interval.
    joint : bool
        Whether uncertain inputs are coordinates of the fit: the profile is then that under the most probable alternative, on a
        surrogate that has learnt these runs, and the interval of the parameter may be that of draws.
    """

    values: tuple[float, ...]
    chi2: tuple[float | None, ...]
    limit: float | None
    interval: Interval
    confirmed: tuple[ConfirmedPoint, ...] = ()
    joint: bool = False


@dataclass(frozen=True)
class BootstrapError:
    """Standard error and 95 % interval (percentiles) of one parameter over a parametric bootstrap."""

    stderr: float
    interval: Interval


@dataclass(frozen=True)
class AloneEstimate:
    """One parameter by one test alone."""

    value: float
    interval: Interval
    verdict: str = "–"


@dataclass(frozen=True)
class TestAlone:
    """A fit with one test alone: its RMSE on the surrogate and by a run at its optimum, mN, and its parameters."""

    __test__: ClassVar[bool] = False

    rmse: float
    confirmed_rmse: float | None
    parameters: dict[str, AloneEstimate]


@dataclass(frozen=True)
class WeightsFit:
    """A fit under other weights of the tests: its parameters, and the RMSE of each test, mN."""

    weights: tuple[float, ...]
    parameters: dict[str, float]
    rmse: dict[str, float]


@dataclass(frozen=True)
class RivalOptimum:
    """Another optimum that the search found: the free parameters, and equation (1) there, mN."""

    parameters: dict[str, float]
    objective: float


@dataclass(frozen=True)
class PublishedComparison:
    """Published parameters that the case names: their objective on these curves, mN, and whether each lies in its interval.

    `error` is how far the objective may be off, mN, where the surrogate gave it; None where a run did.
    """

    parameters: dict[str, float]
    objective: float | None
    inside: dict[str, bool]
    error: float | None = None


@dataclass(frozen=True)
class FitFailure:
    """A point at which the mechanics failed, and the cause."""

    parameters: Mapping[str, float | str]
    cause: str


@dataclass(frozen=True)
class FitSolver:
    """Facts about the solver in the runs of a fit.

    Parameters
    ----------
    linear, assembly : str
    workers : int
    run_seconds : float
        Duration of all runs.
    loose_steps : int
        Number of loose steps (see fem/relaxation.py) at the optimum.
    penalty_error : float or None
        Penalty error (see fem/contact.py) at the optimum, share of the force, worst test.
    edge_slip : float or None
        Slip across the sharp edge at the optimum, share of the half-width, worst test.
    """

    linear: str
    assembly: str
    workers: int
    run_seconds: float
    loose_steps: int = 0
    penalty_error: float | None = None
    edge_slip: float | None = None


@dataclass(frozen=True, repr=False, eq=False)
class FitResult:
    """The result of `fit`.

    Parameters
    ----------
    parameters : dict of name -> ParameterEstimate
        Parameters in the order of the model; `free` gives the order of `covar`, `correlation`, `singular_values`, `directions`.
    objective : float, mN
        Equation (1), the weighted sum of the tests' RMSEs.
    sum_of_squares : float, mN^2
        Weighted sum of the squared RMSEs.
    rmse : dict of test -> mN
    misfit : dict of test -> CurveMisfit
    no_fit : str or None
        Why the fit is none, where its misfit is gross; `success` is then False.
    redchi : float, mN^2
        Residual variance of one point.
    covar, correlation : (n_free, n_free)
    singular_values : (n_free,), mN
        Change of the misfit by a relative change of the parameters along each row of `directions`, in falling order.
    nfev, runs, reused : int
        Number of sets of parameters that were evaluated, of solves of one test, and of solves that came from the ledger.
    noise, profiles, bootstrap, tests_alone, weights_scan, uncertain, rivals, surrogate, published
        Empty or None where the case does not ask for them, or they could not be computed.
    predicted : dict of test -> TestPrediction
        Each test predicted from the others; empty for a single test.
    refined : float or None
        By what factor the mesh whose runs corrected the curves is finer than that of the case; None where the fit refined none.
    conclusions : tuple of sentences
        The parameters that these curves determine (the key `summary` of result.json).
    moduli : dict of name -> ParameterEstimate
        E, nu, and mu (or G, where another parameter is called mu) where no parameter is the shear modulus, of a material without
        fibres.
    recording : tuple of CurveDoubt
        What the curves show of a preload or of adhesion, and what to do about it, where no input of the fit stands for it.
    closed_forms : dict of test -> ClosedForm
        Moduli of the measured curves by closed forms, where the indenter has one.
    taken_as_known : tuple of WhatIf
        Inputs that the case gives as exact, with the parameters at other values of them.
    posterior : PosteriorFacts or None
        What samples of the posterior say (`fit.posterior`).
    law_misfit : LawMisfit or None
        The law's own misfit with bands of the curves, where the case makes it a term of the fit (`fit.discrepancy`).
    curves : dict of test -> Curve
        The fitted curves (not part of result.json).
    samples : inference.sampling.PosteriorSamples or None
        The samples themselves (not part of result.json).
    case : Case or None
        The fitted case; None for a result that was read from result.json.
    whole_case : Case or None
        The case with all points of its curves, where not all were fitted.
    """

    FORMAT: ClassVar[str] = "indentfit.fit/2"

    method: str
    seed: int
    success: bool
    message: str
    parameters: dict[str, ParameterEstimate]
    free: tuple[str, ...]
    objective: float | None
    sum_of_squares: float | None
    rmse: dict[str, float]
    misfit: dict[str, CurveMisfit] = field(default_factory=dict)
    no_fit: str | None = None
    redchi: float | None = None
    covar: tuple[Numbers, ...] | None = None
    correlation: tuple[Numbers, ...] | None = None
    singular_values: Numbers | None = None
    directions: tuple[Numbers, ...] | None = None
    nfev: int = 0
    runs: int = 0
    reused: int = 0
    seconds: float = 0.0
    history: tuple[HistoryStep, ...] = ()
    failures: tuple[FitFailure, ...] = ()
    notes: tuple[str, ...] = ()
    solver: FitSolver | None = None
    mesh: MeshFacts | None = None
    refined: float | None = None
    case_hash: str = ""
    title: str = ""
    versions: dict[str, str] = field(default_factory=dict)
    noise: dict[str, CurveNoise] = field(default_factory=dict)
    profiles: dict[str, Profile] = field(default_factory=dict)
    bootstrap: dict[str, BootstrapError] = field(default_factory=dict)
    tests_alone: dict[str, TestAlone] = field(default_factory=dict)
    weights_scan: tuple[WeightsFit, ...] = ()
    uncertain: UncertainInputs = field(default_factory=UncertainInputs)
    rivals: tuple[RivalOptimum, ...] = ()
    surrogate: SurrogateFacts | None = None
    predicted: dict[str, TestPrediction] = field(default_factory=dict)
    published: PublishedComparison | None = None
    conclusions: tuple[str, ...] = ()
    taken_as_known: tuple[WhatIf, ...] = ()
    posterior: PosteriorFacts | None = None
    law_misfit: LawMisfit | None = None
    moduli: dict[str, ParameterEstimate] = field(default_factory=dict)
    closed_forms: dict[str, ClosedForm] = field(default_factory=dict)
    recording: tuple[CurveDoubt, ...] = ()
    curves: dict[str, InstanceOf[Curve]] = field(default_factory=dict)
    samples: Any = None
    case: InstanceOf[Case] | None = None
    whole_case: InstanceOf[Case] | None = None

    def as_json(self) -> dict[str, Any]:
        """The stable keys of result.json, under the tag `format`."""
        known = {RENAMED.get(name, name): value for name, value in plain_fields(self).items() if name not in NOT_IN_JSON}
        return {"format": self.FORMAT, **known}

    @classmethod
    def from_json(cls, value: Mapping[str, Any]) -> "FitResult":
        """The result that result.json holds, in the form of this version or of 0.1; keys that 0.1 did not have are empty.

        Raises
        ------
        ValueError
            The value is not a result of a fit.
        """
        known = {field.name: RENAMED.get(field.name, field.name) for field in fields(cls) if field.name not in NOT_IN_JSON}
        empty: tuple[Any, ...] = (None, {}, [])
        given = {name: value[key] for name, key in known.items() if key in value and (value[key] not in empty or name in NEEDED)}
        return TypeAdapter(cls).validate_python(given)

    def summary(self, scan_weights: bool = False) -> str:
        """The result in words, as the command prints it; `scan_weights` adds fits under other weights of the tests."""
        from indentfit.report.text import fit_lines

        return "\n".join(fit_lines(self, scan_weights))

    def plot(self, path: str | Path | None = None) -> Any:
        """The matplotlib Figure of measured and fitted curves; saved as SVG and PNG where a path is given."""
        from indentfit.report.plots import force_displacement

        synthetic = self.case.synthetic if self.case else ()
        return force_displacement(list(self.measured.items()), list(self.curves.items()), path, synthetic)

    def write(self, folder: str | Path, fields: bool = True, overwrite: bool = False) -> None:
        """Write the result folder.

        Parameters
        ----------
        folder : path
        fields : bool
            Whether one more run computes the stresses at the optimum.
        overwrite : bool
            Whether an earlier result folder is replaced.

        Raises
        ------
        OutputError
            The folder exists already, or cannot be written.
        """
        from indentfit.report.fit_folder import write_fit

        write_fit(self, folder, fields, overwrite)

    @property
    def measured(self) -> dict[str, Curve]:
        """The measured curves by the names of their tests; empty for a result without its case."""
        if self.case is None:
            return {}
        pairs = zip(self.case.tests, self.case.curves, strict=True)
        return {test.name: curve for test, curve in pairs if curve is not None}

    def __repr__(self) -> str:
        values = ", ".join(f"{name} = {self.parameters[name]}" for name in self.free)
        end = "no objective" if self.objective is None else f"objective {quantity(self.objective, 'mN', 3)}"
        return f"FitResult({self.title!r}: {values}; {'' if self.success else 'not converged; '}{end})"

    def _repr_html_(self) -> str:
        rows = "".join(f"<tr>{''.join(f'<td>{html.escape(cell)}</td>' for cell in row)}</tr>" for row in self._rows())
        end = "" if self.objective is None else f" objective {quantity(self.objective, 'mN')}"
        caption = html.escape(f"{self.title or 'Fit'}:{'' if self.success else ' not converged;'}{end}")
        heads = "".join(f"<th>{head}</th>" for head in ("parameter", "value", "unit", "standard error", "95 % interval", "verdict"))
        return f"<table><caption>{caption}</caption><thead><tr>{heads}</tr></thead><tbody>{rows}</tbody></table>"

    def _rows(self) -> Iterator[tuple[str, ...]]:
        for name, known in (*self.parameters.items(), *self.moduli.items()):
            unit = "" if known.unit in ("", "1") else known.unit
            if known.fixed:
                yield name, f"{known.value:.5g}", unit, "", "", "fixed"
                continue
            error = "unknown" if known.total is None else f"{known.total:.2g}"
            pieces = known.pieces or (() if known.interval is None else (known.interval,))
            between = " or ".join(f"{low:.4g} to {high:.4g}" for low, high in pieces) or "unknown"
            yield name, f"{known.value:.5g}", unit, error, between, known.verdict or ""


RENAMED = {"conclusions": "summary"}  # names of fields whose key in result.json is another
NEEDED = ("objective", "sum_of_squares", "rmse", "parameters", "free", "title")  # keys that may be None or empty
