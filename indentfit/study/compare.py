"""Laws against each other: which law do the curves of a case prefer, and by how much?

Each law is fitted as `fit` does it. Its evidence is the density of the curves under it, integrated over its parameters on the
surrogate of the fit's runs, with every parameter uniform over its range, and with the same priors of the noise for all laws.
Occam's razor is in it: a law of more parameters spreads its density over more curves. The out-of-sample errors need no prior.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from statistics import median
from typing import Any, ClassVar

import numpy as np
from pydantic import InstanceOf, TypeAdapter
from scipy.interpolate import PchipInterpolator
from scipy.special import logsumexp

from indentfit.case import Case, Range, require_comparable, require_fittable
from indentfit.case.uses import require_case
from indentfit.curve import Curve
from indentfit.errors import CaseError, ConvergenceError, IndentfitError, LedgerError, Stopped, WorkerError
from indentfit.experiment.measured import changed_case
from indentfit.inference.evidence import Evidence, evidence, under_another_noise
from indentfit.inference.fit import FitWithRuns, fit_with_runs
from indentfit.inference.law_choice import THRESHOLD, Choice, Weighed, choose
from indentfit.inference.law_curves import LawCurves, alternatives_of
from indentfit.inference.nested import NestedEvidence, nested_evidence, require_dynesty
from indentfit.inference.out_of_sample import out_of_sample
from indentfit.inference.residual_noise import unknown_noise
from indentfit.inference.verdicts import reached
from indentfit.inverse.objective import best_scale
from indentfit.inverse.problem import inverse_problem
from indentfit.material import parts_of
from indentfit.study.law_ranges import is_own, law_case, owner_of
from indentfit.study.runs import Execution, evaluate_cases

Interval = tuple[float, float]
AT_BOUND = 1e-3  # of the range
MULTIPLES = (
    0.05,
    0.2,
    0.5,
    1.0,
    2.0,
    5.0,
    20.0,
)  # of the shear modulus of a layer's own law, where that of its curves is looked for
REFERENCE = ("material.model=neo_hookean", "material.parameters={ mu = { start = 1.0, min = 0.5, max = 2.0 } }", "fit.published={}")


@dataclass(frozen=True)
class LawParameter:
    """One free parameter of a law: its value at the largest density, its 95 % interval, and its range, the prior."""

    value: float
    unit: str
    interval: Interval
    min: float
    max: float
    at_bound: str | None = None


@dataclass(frozen=True)
class LawFit:
    """One law of a comparison.

    Parameters
    ----------
    law : str
        The law as it was asked for.
    parameters : dict of name -> LawParameter
        The free parameters; the others have the case's values.
    log_evidence, laplace, without_mesh : float or None
        Logarithm of the evidence (natural; the density of the forces in mN), the same by Laplace's method alone, and the same as if
        the mesh were exact. None where the law could not be fitted.
    nested, nested_error : float or None
        The log evidence by nested sampling and its standard error, where it was asked for: `log_evidence` is then this one.
    probability : float
        Of the law among those that were asked for, each as probable as the others before.
    misfit : dict of test -> RMSE over the largest force
    left_out : dict of part -> error of its prediction, over the largest force
        The deep third of the curves predicted from the rest, and each test from the others.
    systematic : bool
        Whether residuals of a test are systematic, and not noise.
    sets, runs : int
        Sets of parameters, and solves of one test, that the fit needed.
    effective : float
        Effective number of draws of the integral.
    cause : str or None
        Why there is no fit, or why its misfit is gross.
    """

    law: str
    parameters: dict[str, LawParameter] = field(default_factory=dict)
    log_evidence: float | None = None
    laplace: float | None = None
    without_mesh: float | None = None
    nested: float | None = None
    nested_error: float | None = None
    probability: float = 0.0
    misfit: dict[str, float] = field(default_factory=dict)
    left_out: dict[str, float] = field(default_factory=dict)
    systematic: bool = False
    sets: int = 0
    runs: int = 0
    effective: float | None = None
    cause: str | None = None
    curves: dict[str, InstanceOf[Curve]] = field(default_factory=dict)

    def as_json(self) -> dict[str, Any]:
        """The law's keys in result.json."""
        known = asdict(replace(self, curves={}))
        return {**known, "curves": {name: curve.force.tolist() for name, curve in self.curves.items()}}


@dataclass(frozen=True, repr=False, eq=False)
class Comparison:
    """Laws compared on the curves of a case.

    Parameters
    ----------
    laws : tuple of LawFit
        The most probable first.
    preferred : str or None
        The law that the curves prefer; None where they cannot tell.
    rivals : tuple of str
        The laws among which the curves cannot tell.
    sentence : str
        The conclusion in words.
    threshold : float
        Least difference of log evidences that counts.
    mesh : float
        Relative standard deviation of the forces by the mesh, of all laws.
    modulus : float or None, kPa
        Shear modulus of the curves, with which automatic ranges were made.
    measured : dict of test -> Curve
    case : Case or None
        None for a comparison that was read from result.json.
    layer : str or None
        The name of the layer whose laws these are.
    """

    FORMAT: ClassVar[str] = "indentfit.comparison/2"

    title: str
    case_hash: str
    laws: tuple[LawFit, ...]
    preferred: str | None
    rivals: tuple[str, ...]
    sentence: str
    threshold: float
    mesh: float
    modulus: float | None
    measured: dict[str, Curve]
    case: Case | None = None
    layer: str | None = None

    def as_json(self) -> dict[str, Any]:
        """The stable keys of a comparison's result.json, under the tag `format`."""
        plain = {name: getattr(self, name) for name in ("title", "case_hash", "preferred", "rivals", "sentence", "threshold")}
        curves = {
            name: {"displacement_mm": curve.displacement.tolist(), "force_mN": curve.force.tolist()}
            for name, curve in self.measured.items()
        }
        laws = [law.as_json() for law in self.laws]
        known = {"mesh": self.mesh, "modulus_kPa": self.modulus, **({"layer": self.layer} if self.layer else {})}
        return {"format": self.FORMAT, **plain, **known, "measured": curves, "laws": laws}

    @classmethod
    def from_json(cls, value: Mapping[str, Any]) -> "Comparison":
        """The comparison that result.json holds."""
        measured = {name: Curve(curve["displacement_mm"], curve["force_mN"]) for name, curve in value["measured"].items()}
        laws = []
        for law in value["laws"]:
            curves = {name: Curve(measured[name].displacement, force) for name, force in law["curves"].items()}
            laws.append(TypeAdapter(LawFit).validate_python({**law, "curves": curves}))
        same = {name: value[name] for name in ("title", "case_hash", "preferred", "sentence", "threshold", "mesh")}
        whose, modulus = value.get("layer"), value["modulus_kPa"]
        return cls(**same, laws=tuple(laws), rivals=tuple(value["rivals"]), modulus=modulus, measured=measured, layer=whose)

    def summary(self) -> str:
        """The comparison in words, as the command prints it."""
        from indentfit.report.comparison import comparison_lines

        return "\n".join(comparison_lines(self))

    def plot(self, path: str | Path | None = None) -> Any:
        """The matplotlib Figure of all laws; saved as SVG and PNG where a path is given."""
        from indentfit.report.comparison import comparison_figure

        return comparison_figure(self, path)

    def write(self, folder: str | Path, overwrite: bool = False) -> None:
        """Write the result folder. Raises OutputError where the folder exists already, or cannot be written."""
        from indentfit.report.comparison_folder import write_comparison

        write_comparison(self, folder, overwrite)

    def __repr__(self) -> str:
        return f"Comparison({self.title!r}: {self.sentence})"


def compare(
    case: Case,
    materials: Sequence[str],
    ranges: Mapping[str, Mapping[str, Range]] | None = None,
    execution: Execution | None = None,
    nested: bool = False,
    layer: str | None = None,
) -> Comparison:
    """Compare laws on the curves of a case.

    Parameters
    ----------
    case : Case
    materials : sequence of str
        At least two laws: names of installed laws, file.py:Class, or typed energies. The law of the case itself keeps the
        parameters and ranges that the case gives it; those of others are all free.
    ranges : mapping of law -> mapping of parameter -> Range
        Ranges in place of the automatic ones.
    execution : Execution
        Ledger, cluster, stop and progress of the runs.
    nested : bool
        Whether the evidences are those of nested sampling (dynesty, the extra `nested`), not of Laplace's method and draws.
    layer : str
        The name of the layer whose laws are compared, where the sample has layers; the others keep theirs, and their free
        parameters are fitted under each law.

    Returns
    -------
    Comparison
        A law that cannot be fitted is shown with its cause.

    Raises
    ------
    CaseError
        A law cannot be found or used, there is nothing to fit, or dynesty is not installed.
    ConvergenceError
        No law could be fitted.
    """
    require_case(case)
    return run_comparison(plan_comparison(case, materials, ranges or {}, nested, layer), execution or Execution())


@dataclass(frozen=True, eq=False)
class ComparisonPlan:
    """What is compared: the case, each law with its case, the shear modulus of the curves, whether by nested sampling, and the
    layer whose laws these are."""

    case: Case
    laws: tuple[tuple[str, Case], ...]
    modulus: float | None
    nested: bool = False
    layer: str | None = None


def plan_comparison(
    case: Case,
    materials: Sequence[str],
    ranges: Mapping[str, Mapping[str, Range]],
    nested: bool = False,
    layer: str | None = None,
) -> ComparisonPlan:
    """The plan of a comparison; arguments and errors are those of `compare`. One run tells the stiffness of the curves."""
    if nested:
        require_dynesty()
    laws = list(dict.fromkeys(materials))
    if len(laws) < 2:
        raise CaseError(["--materials: name at least two different laws, with commas between, such as neo_hookean,ogden"])
    if unknown := set(ranges) - set(laws):
        raise CaseError([f"a range is given for {sorted(unknown)[0]!r}, which is not among the laws: {', '.join(laws)}"])
    require_comparable(case)
    owner_of(case, layer)
    needed = any(not is_own(case, law, layer) for law in laws)
    if needed:  # wrong names end here, before anything is solved
        for law in laws:
            law_case(case, law, 1.0, ranges.get(law, {}), layer)
    modulus = (curves_modulus(case) if layer is None else layers_modulus(case, layer)) if needed else None
    cases = tuple((law, law_case(case, law, modulus, ranges.get(law, {}), layer)) for law in laws)
    for _, each in cases:
        require_fittable(each)
    return ComparisonPlan(case, cases, modulus, nested, layer)


def curves_modulus(case: Case) -> float:
    """The shear modulus, kPa, with which a neo-Hookean sample follows the curves of a case best.

    Raises
    ------
    ConvergenceError
        The neo-Hookean sample cannot be solved.
    """
    reference = changed_case(case, REFERENCE)
    (run,) = evaluate_cases([reference], Execution(workers=1))
    if run.forces is None:
        raise ConvergenceError(f"the stiffness of the curves is not known, since a neo-Hookean sample of 1 kPa failed: {run.cause}")
    factor = best_scale(inverse_problem(reference).tests, run.forces)
    if not factor > 0:
        raise CaseError(["the curves have no stiffness: their forces fall with the depth; check signs and units"])
    return factor


def layers_modulus(case: Case, layer: str) -> float:
    """The shear modulus, kPa, with which a neo-Hookean layer follows the curves of a case best, while the others have their start
    values: to some 10 %, from runs at multiples of that of the layer's own law.

    Raises
    ------
    ConvergenceError
        No such sample can be solved.
    """
    own = dict(zip((each.name for each in case.sample.layer), parts_of(case.law(**case.start_values())), strict=True))[layer]
    start, table = own.shear_modulus, f"sample.layer.{layer}"
    moduli = start * np.array(MULTIPLES)
    cases = [
        changed_case(case, [f"{table}.model=neo_hookean", f"{table}.parameters={{ mu = {modulus!r} }}", "fit.published={}"])
        for modulus in moduli.tolist()
    ]
    runs = evaluate_cases(cases, Execution(workers=1))
    solved = [n for n, run in enumerate(runs) if run.forces is not None]
    if len(solved) < 2:
        raise ConvergenceError(
            f"the stiffness of layer {layer} is not known: as a neo-Hookean one of {start:.3g} kPa, {runs[0].cause}"
        )
    logs, fine = np.log(moduli[solved]), np.linspace(np.log(moduli[solved[0]]), np.log(moduli[solved[-1]]), 201)
    squares = np.zeros(fine.size)
    for n, curve in enumerate(curve for curve in case.curves if curve is not None):
        rows = np.array([(runs[k].forces or ())[n] for k in solved])
        between = PchipInterpolator(logs, rows)(fine)
        squares += np.sum((between - curve.force) ** 2, axis=1) / np.sum(curve.force**2)
    return float(np.exp(fine[int(np.argmin(squares))]))


def run_comparison(plan: ComparisonPlan, execution: Execution) -> Comparison:
    """The Comparison of a plan.

    Raises
    ------
    ConvergenceError
        No law could be fitted.
    """
    fits: dict[str, FitWithRuns | str] = {}
    for n, (law, case) in enumerate(plan.laws):
        fits[law] = _fitted(case, execution, _part(execution.progress, n / len(plan.laws), 0.95 / len(plan.laws), law))
    if all(isinstance(fitted, str) for fitted in fits.values()):
        raise ConvergenceError(f"no law could be fitted; the first: {next(iter(fits.values()))}")
    mesh = mesh_of([fitted for fitted in fits.values() if not isinstance(fitted, str)])
    execution.progress(0.95, "evidences")
    known = [_law_fit(law, fitted, mesh, plan) for law, fitted in fits.items()]
    laws = ranked(known)
    choice = choice_of(laws)
    return Comparison(
        title=plan.case.title,
        case_hash=plan.case.hash,
        laws=laws,
        preferred=choice.preferred,
        rivals=choice.rivals,
        sentence=choice.sentence,
        threshold=THRESHOLD,
        mesh=mesh,
        modulus=plan.modulus,
        measured=next(fitted.result.measured for fitted in fits.values() if not isinstance(fitted, str)),
        case=plan.case,
        layer=plan.layer,
    )


def mesh_of(fits: Sequence[FitWithRuns]) -> float:
    """The relative standard deviation of the forces by the mesh, for all laws: the median of what their fits have found."""
    deviations = [share.sd for fitted in fits if (share := fitted.result.uncertain.inputs.get("mesh")) and share.sd is not None]
    return float(median(deviations)) if deviations else 0.0


def ranked(laws: Sequence[LawFit]) -> tuple[LawFit, ...]:
    """The laws with their probabilities, the most probable first, those without a fit last."""
    logs = np.array([-math.inf if law.log_evidence is None else law.log_evidence for law in laws])
    shares = np.exp(logs - logsumexp(logs))
    weighed = [replace(law, probability=float(share)) for law, share in zip(laws, shares, strict=True)]
    return tuple(weighed[n] for n in np.argsort(-logs, kind="stable"))


def choice_of(laws: Sequence[LawFit]) -> Choice:
    """The choice among laws by their evidences."""
    return choose(
        {
            law.law: Weighed(
                law.log_evidence, law.without_mesh, max(law.misfit.values(), default=0.0), law.systematic, len(law.parameters)
            )
            for law in laws
            if law.log_evidence is not None and law.without_mesh is not None
        }
    )


def _part(progress: Callable[[float, str], object], start: float, share: float, law: str) -> Callable[..., None]:
    def report(done: float, note: str = "") -> None:
        progress(start + share * done, f"{law}; {note}")

    return report


def _fitted(case: Case, execution: Execution, report: Callable[..., None]) -> FitWithRuns | str:
    """The fit of one law, or the cause of its absence."""
    try:
        fitted = fit_with_runs(case, report, execution.ledger_of(case), execution.cluster, execution.stop)
    except (LedgerError, Stopped, WorkerError):
        raise
    except IndentfitError as error:
        return " ".join(str(error).split())
    return fitted if alternatives_of(fitted) else fitted.result.message


def _law_fit(law: str, fitted: FitWithRuns | str, mesh: float, plan: ComparisonPlan) -> LawFit:
    """The law with its evidence and its predictions."""
    seed = plan.case.fit.seed
    if isinstance(fitted, str):
        return LawFit(law, cause=fitted)
    alternatives = alternatives_of(fitted)
    whole, exact, curves, known = total_evidence(fitted, alternatives, mesh, seed)
    sampled = total_nested(fitted, alternatives, mesh, seed) if plan.nested else None
    if sampled is not None:
        whole, exact = sampled.log, exact + sampled.log - whole
    force = curves.forces(known.best[None])[0]
    parts, tests = {}, fitted.problem.tests
    for test, row in zip(tests, np.split(force, np.cumsum([test.curve.force.size for test in tests])[:-1]), strict=True):
        parts[test.name] = Curve(test.curve.displacement, row)
    return LawFit(
        law=law,
        parameters=_parameters(fitted, curves, known),
        log_evidence=whole,
        laplace=known.laplace,
        without_mesh=exact,
        nested=None if sampled is None else sampled.log,
        nested_error=None if sampled is None else sampled.error,
        misfit={test.name: _misfit(test.curve, parts[test.name]) for test in tests},
        left_out=out_of_sample(fitted.problem, curves, mesh, seed),
        systematic=any(noise.systematic for noise in fitted.result.noise.values()),
        sets=fitted.result.nfev,
        runs=fitted.result.runs,
        effective=known.effective,
        cause=fitted.result.no_fit,
        curves=parts,
    )


def total_evidence(
    fitted: FitWithRuns, alternatives: Sequence[tuple[float, LawCurves]], mesh: float, seed: int
) -> tuple[float, float, LawCurves, Evidence]:
    """The log evidence of a law over all alternatives of the case, the same as if the mesh were exact, and the best alternative's
    curves and Evidence."""
    logs, exact, weighed = [], [], []
    for share, curves in alternatives:
        prior, noise = math.log(max(share, 1e-300)), unknown_noise(fitted.problem, mesh, moves=curves.moves)
        known = evidence(curves, noise, seed)
        without = unknown_noise(fitted.problem, 0.0, moves=curves.moves)
        logs.append(prior + known.log)
        exact.append(prior + (under_another_noise(known, curves, noise, without, seed) if mesh else known.log))
        weighed.append((curves, known))
    curves, known = weighed[int(np.argmax(logs))]
    return float(logsumexp(logs)), float(logsumexp(exact)), curves, known


def total_nested(fitted: FitWithRuns, alternatives: Sequence[tuple[float, LawCurves]], mesh: float, seed: int) -> NestedEvidence:
    """The log evidence of a law over all alternatives of the case, by nested sampling."""
    integrals = [
        nested_evidence(curves, unknown_noise(fitted.problem, mesh, moves=curves.moves), seed) for _, curves in alternatives
    ]
    logs = np.array([math.log(max(share, 1e-300)) + each.log for (share, _), each in zip(alternatives, integrals, strict=True)])
    total = float(logsumexp(logs))
    errors = np.exp(logs - total) * [each.error for each in integrals]
    return NestedEvidence(total, float(np.linalg.norm(errors)), sum(each.calls for each in integrals))


def _misfit(measured: Curve, fitted: Curve) -> float:
    return float(np.sqrt(np.mean((fitted.force - measured.force) ** 2)) / np.abs(measured.force).max())


def _parameters(fitted: FitWithRuns, curves: LawCurves, known: Evidence) -> dict[str, LawParameter]:
    units = {name: estimate.unit for name, estimate in fitted.result.parameters.items()}
    values, best = curves.values(known.places), curves.values(known.best[None])[0]
    rows = {}
    for n, name in enumerate(curves.names):
        bounds = fitted.problem.free[name]
        low, high = known.quantiles(values[:, n], (0.025, 0.975)).tolist()
        low, high = min(low, float(best[n])), max(high, float(best[n]))  # a density that is highest near a bound is one-sided
        near = "lower" if known.best[n] < AT_BOUND else "upper" if known.best[n] > 1 - AT_BOUND else ""
        bound = reached(near, float(best[n]), (low, high), bounds)
        rows[name] = LawParameter(float(best[n]), units.get(name, "1"), (low, high), bounds.min, bounds.max, bound or None)
    return rows
