"""The inversion: from a case to parameters, their errors, and the history of the search."""

import importlib.metadata
import platform
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from indentfit.arrays import Array
from indentfit.case import Case
from indentfit.case.draining import draining
from indentfit.case.laws import has_fibres, shear_parameter
from indentfit.case.uses import require_case
from indentfit.compiled import one_blas_thread
from indentfit.curve import Curve
from indentfit.digits import quantity
from indentfit.fem.facts import MeshFacts, SolveFacts, said_of_paths, said_of_tries
from indentfit.inference.accepted import accepted
from indentfit.inference.certainty import Certainty, certainty
from indentfit.inference.identifiability import Identifiability
from indentfit.inference.misfit import misfits, no_fit, recording
from indentfit.inference.moduli import moduli
from indentfit.inference.refinement import Refined, refined
from indentfit.inference.result import UNKNOWN, FitFailure, FitResult, FitSolver, Numbers, ParameterEstimate
from indentfit.inference.sampling import PosteriorSamples, facts_of_samples, samples_of
from indentfit.inference.seen import far_from_model
from indentfit.inference.to_model import Beside, Models, unless_far, unless_holds_differ
from indentfit.inference.verdicts import conclusions
from indentfit.inference.wide_certainty import wide_certainty
from indentfit.inference.wide_fit import WideFit, wide_fit
from indentfit.inverse.exploration import Watched
from indentfit.inverse.mesh_correction import MeshCorrection
from indentfit.inverse.methods import Solved, solve
from indentfit.inverse.objective import Target, rmse
from indentfit.inverse.problem import Candidate, InverseProblem
from indentfit.inverse.progress import Progress
from indentfit.inverse.wide import of_records, uncertain_inputs, with_offset_of_records
from indentfit.runs.closed_form import OF_LAW, OF_MISFIT, closed_forms, left_out
from indentfit.runs.forward import Evaluation
from indentfit.runs.ledger import Ledger
from indentfit.runs.parted import Parted
from indentfit.runs.pieces import Piece, mesh_of
from indentfit.runs.points import UNITS
from indentfit.runs.pool import RunPool
from indentfit.runs.relaxing import BULK, Relaxing, elastic_case, with_bulk

Change = Callable[[InverseProblem, Mapping[str, float]], InverseProblem | None]  # another problem at parameters, or none
PACKAGES = ("indentfit", "numpy", "scipy", "scikit-fem", "numba", "pymoo")
MESH_NOTE = "the error of the mesh is not in the intervals (fit.uncertain.mesh = 0); compare with a finer mesh"
NO_SAMPLES = (
    "no samples of the posterior: they need a surrogate in at least one parameter beside the scale, and uncertain inputs that are "
    "its coordinates"
)
SHARE_OF_WIDE = 0.95  # share of a fit whose inputs are coordinates
CONTACT = (
    "the standard deviation of each contact point is that which its record tells ({of}); fit.uncertain.offset would state another"
)
NO_FIT = "not determined: the model cannot follow the curves"
OF_UNKNOWN_BULK = 50.0  # bulk ratio at which the share of the bulk modulus in the force is known, where the ratio is unknown
LESS = 0.9  # of the bulk ratio at the optimum: where the low end of its interval is below that, the viscoelastic model is run there
WORSE = 1.2  # times the objective: the viscoelastic model on a coarse mesh errs, mostly at a rounded edge without friction
CORRECTIONS = 3  # fits that are made again, at most, with forces that come nearer to those of the viscoelastic model
SHARE_OF_FIT = 0.75  # share of the search in the progress; the rest is that of `certainty`


def fit(
    case: Case,
    progress: Callable[[float, str], object] | None = None,
    ledger: Ledger | None = None,
    cluster: str | None = None,
    stop: Callable[[], int] | None = None,
    near: Callable[[Case, Mapping[str, float]], object] | None = None,
) -> FitResult:
    """Fit the free parameters of a case to its curves.

    Scripts need `if __name__ == "__main__":` where more than one process works, see `runs.processes`.

    Parameters
    ----------
    case : Case
        The case, whose [fit] names the method, the number of processes and the uncertain inputs.
    progress : function
        Called with the share of the work that is done, and a note.
    ledger, cluster, stop
        As `RunPool` takes them.
    near : function
        Called with the case and with the parameters and changed inputs of the optimum once the search has ended: what proves the
        optimum may still move it.

    Returns
    -------
    FitResult
        A fit that does not converge raises no error; its `success` is False.

    Raises
    ------
    CaseError
        There is nothing to fit.
    MeshError
    Stopped, WorkerError, LedgerError
        As `RunPool.evaluate` raises them.
    """
    require_case(case)
    return fit_with_runs(case, progress, ledger, cluster, stop, near).result


@dataclass(frozen=True, eq=False)
class FitWithRuns:
    """A fit with what it was made of, so that other curves of the same law can be predicted.

    Parameters
    ----------
    result : FitResult
    problem : InverseProblem
    solved : Solved
    wide : WideFit or None
        The joint fit, where uncertain inputs are coordinates.
    runs : tuple of Evaluation
        All runs of the search, at the reference of the scale.
    """

    result: FitResult
    problem: InverseProblem
    solved: Solved
    wide: WideFit | None
    runs: tuple[Evaluation, ...]


def fit_with_runs(
    case: Case,
    progress: Callable[[float, str], object] | None = None,
    ledger: Ledger | None = None,
    cluster: str | None = None,
    stop: Callable[[], int] | None = None,
    near: Callable[[Case, Mapping[str, float]], object] | None = None,
) -> FitWithRuns:
    """The fit of a case with its runs; arguments and errors are those of `fit`."""
    started = time.perf_counter()
    ready = accepted(case)  # refuses what cannot be fitted before any worker is started
    given, run, case, problem = case, ready.averaged.case, ready.case, ready.problem
    whole, stated = Progress(progress), with_offset_of_records(case)
    elastic = elastic_case(run)
    if ledger is not None and elastic is not given:
        ledger = ledger.of(elastic)
    with RunPool(elastic, ledger=ledger, cluster=cluster, stop=stop) as pool, one_blas_thread():
        problem = _with_bulk(case, problem, pool, problem.start)
        model = Parted.of(pool, elastic) if problem.kernel is None else Relaxing(pool, problem.kernel)
        watched = Watched(model)
        wide = wide_fit(case, problem, watched, whole.part(0, SHARE_OF_WIDE), near) if ready.widens else None
        correction = MeshCorrection(case if case.fit.uncertain.mesh and case.indentations else None)
        part = whole.part(0, SHARE_OF_FIT)
        solved = wide.solved() if wide is not None else solve(problem, watched, case.fit, part, correction)
        models = Models(case)
        # a wide fit knows how the share of the bulk modulus depends on its inputs
        changes: list[Change] = [partial(_with_other_bulk, case, pool)] if wide is None else []
        first = problem, model, watched, correction, wide, solved
        for changed in changes + [models.corrected] * CORRECTIONS:
            best = solved.optimum.best
            there = changed(problem, best.parameters) if best is not None else None
            if there is not None and there.kernel is not None:
                problem, model = there, Relaxing(pool, there.kernel)
                watched, correction = Watched(model), MeshCorrection(correction.case)
                wide = wide_fit(case, problem, watched, whole.part(0, SHARE_OF_WIDE), near) if wide is not None else None
                solved = wide.solved() if wide is not None else solve(problem, watched, case.fit, part, correction)
        if _worse(solved.optimum.best, first[-1].optimum.best):  # the model's ratio is not that of the sample
            problem, model, watched, correction, wide, solved = first
        if near is not None and solved.optimum.best is not None:
            near(case, solved.optimum.best.parameters)
        samples = samples_of(case, problem, watched, wide) if case.fit.posterior else None
        watched, finer = solved.model or watched, Refined(solved)
        gross = _no_fit(case, problem, solved.optimum.best, watched)
        if gross is not None:
            known = Certainty()
        elif wide is not None:
            known = wide_certainty(stated, problem, watched, solved, wide)
        else:
            finer = refined(case, problem, watched, solved, correction, whole.part(SHARE_OF_FIT, SHARE_OF_FIT))
            solved, watched = finer.solved, finer.solved.model or watched
            known = certainty(stated, problem, watched, solved, whole.part(SHARE_OF_FIT, 1))
        work = _Work(ready.pieces, pool, _facts_near(watched, problem, solved.optimum.best), finer)
    result = _with_samples(_result(case, problem, solved, known, work, models), samples)
    if gross is not None:
        result = without_meaning(result, gross)
    said = (*result.conclusions, *ready.shallower.said)
    notes = (*ready.averaged.said, *result.notes)
    result = replace(result, conclusions=said, notes=notes, seconds=time.perf_counter() - started)
    if run is not ready.uncut:
        result = replace(result, whole_case=given, case_hash=ready.uncut.hash)
    return FitWithRuns(result, problem, solved, wide, tuple(watched.known))


def _with_bulk(case: Case, problem: InverseProblem, pool: RunPool, parameters: Mapping[str, float]) -> InverseProblem:
    """The problem whose kernel counts the shares of the bulk modulus at these parameters, where they matter."""
    if problem.kernel is None:
        return problem
    point, ratio = problem.at_reference(parameters), case.material.bulk_over_shear
    if ratio is not None and any(known.point == BULK for known in uncertain_inputs(case)):
        point[BULK] = min(ratio, OF_UNKNOWN_BULK)
    return replace(problem, kernel=with_bulk(problem.kernel, case, point, pool))


def _with_other_bulk(case: Case, pool: RunPool, problem: InverseProblem, parameters: Mapping[str, float]) -> InverseProblem | None:
    """The problem of `_with_bulk`; None where that is nearly the same."""
    there = _with_bulk(case, problem, pool, parameters)
    return there if there.kernel is not None and problem.kernel is not None and there.kernel.differs(problem.kernel) else None


def _worse(best: Candidate | None, before: Candidate | None) -> bool:
    """Whether an optimum misses the curves by clearly more than one before it did."""
    return before is not None and (best is None or best.objective > WORSE * before.objective)


def _with_samples(result: FitResult, samples: PosteriorSamples | None) -> FitResult:
    """The result with samples of its posterior."""
    if samples is None:
        asked = result.case is not None and result.case.fit.posterior
        return replace(result, notes=(*result.notes, NO_SAMPLES)) if asked else result
    intervals = {name: result.parameters[name].interval for name in result.free}
    units = [result.parameters[n].unit if n in result.free else unit for n, unit in zip(samples.names, samples.units, strict=True)]
    samples = replace(samples, units=tuple(units))
    return replace(result, posterior=facts_of_samples(samples, intervals), samples=samples)


def without_meaning(result: FitResult, why: str) -> FitResult:
    """A result whose misfit is gross: no fit, and no parameter is determined.

    Parameters
    ----------
    result : FitResult
    why : str

    Returns
    -------
    FitResult
    """
    known = {name: _undetermined(estimate) for name, estimate in result.parameters.items()}
    beside = {name: _undetermined(estimate) for name, estimate in result.moduli.items()}
    return replace(result, success=False, message=f"no fit: {why}", no_fit=why, parameters=known, moduli=beside)


def _undetermined(known: ParameterEstimate) -> ParameterEstimate:
    return known if known.fixed else replace(known, verdict=NO_FIT, limited_by="misfit")


def _no_fit(case: Case, problem: InverseProblem, best: Candidate | None, watched: Watched) -> str | None:
    """Why the optimum is no fit; None where it is one, or where there is no optimum."""
    known = has_fibres(case.law) and "fibre_angle" not in case.fit.uncertain.fitted
    return no_fit(problem, best, watched.known, known) if best else None


@dataclass(frozen=True, eq=False)
class _Work:
    """The pieces and pool of a fit, the facts of its runs at the optimum, one for each test, and its finest mesh."""

    pieces: list[Piece]
    pool: RunPool
    facts: tuple[SolveFacts, ...]
    finer: Refined

    def solver(self, case: Case) -> FitSolver:
        return FitSolver(
            linear=self.pieces[0].model.solver.name if self.pieces else "none",
            assembly=case.solver.assembly,
            workers=self.pool.workers,
            run_seconds=self.pool.seconds,
            loose_steps=sum(test.loose_steps for test in self.facts),
            penalty_error=max((abs(test.penalty_error) for test in self.facts), default=None),
            edge_slip=max((abs(test.edge_slip) for test in self.facts), default=None),
        )

    def mesh(self) -> MeshFacts:
        """The facts of the finest meshes behind the result."""
        if self.finer.factor is None:
            return mesh_of(self.pieces)
        return mesh_of([piece.refined(self.finer.factor) for piece in self.pieces])

    def failures(self) -> tuple[FitFailure, ...]:
        return tuple(FitFailure(failure.parameters, failure.cause or "") for failure in self.pool.failures)

    def notes(self, case: Case) -> tuple[str, ...]:
        mesh = () if case.fit.uncertain.mesh or not case.indentations else (MESH_NOTE,)
        tries = said_of_tries(zip([test.name for test in case.tests], self.facts, strict=False))
        return (*_weights_of_points(case), *mesh, *self.finer.notes, *_of_records(case), *tries)


def _of_records(case: Case) -> Iterator[str]:
    """A note where the error of the contact point is that of the records."""
    known = [(test.name, size) for test, size in zip(case.tests, of_records(case), strict=True) if size]
    if known:
        yield CONTACT.format(of=", ".join(f"{name} {quantity(size, 'mm', 2)}" for name, size in known))


def _weights_of_points(case: Case) -> Iterator[str]:
    """What weighs the points of each curve that states standard deviations."""
    for test, curve in zip(case.tests, case.curves, strict=True):
        if curve is not None and curve.sd is not None:
            low, high = curve.sd.min(), curve.sd.max()
            yield (
                f"{test.name}: its points count by the inverse squares of their stated standard deviations, {low:.3g} to "
                f"{high:.3g} {curve.shown.up_unit}; RMSE and misfit are so weighted, and the noise counts as at least that large"
            )


def _facts_near(watched: Watched, problem: InverseProblem, best: Candidate | None) -> tuple[SolveFacts, ...]:
    """The facts of the runs that are nearest to the optimum, one for each test."""
    if best is None:
        return ()
    point = problem.at_reference(best.parameters)
    texts = {name: value for name, value in point.items() if isinstance(value, str)}
    numbers = [name for name in point if name not in texts]
    runs = [known for known in watched.known if known.forces and known.parameters.keys() == point.keys()]
    runs = [known for known in runs if all(known.parameters[name] == value for name, value in texts.items())]
    if not runs:
        return ()
    places, place = (
        np.array([[each[name] for name in numbers] for each in known], dtype=float)
        for known in ([known.parameters for known in runs], [point])
    )
    apart = np.abs(places - place) / np.maximum(np.ptp(places, axis=0), 1e-300)
    nearest = runs[int(np.argmin(apart.max(axis=1, initial=0.0)))]
    return tuple(SolveFacts.from_json(facts) for facts in nearest.facts)


def _result(case: Case, problem: InverseProblem, solved: Solved, known: Certainty, work: _Work, models: Models) -> FitResult:
    optimum, findings = solved.optimum, known.findings
    best, of_noise = optimum.best, known.known
    beside = models.beside(problem, best.parameters) if best else Beside()
    holds = tuple(draining(case))
    estimates = unless_holds_differ(unless_far(known.estimates, beside.differences), problem, holds)
    known = _judged(known, estimates, len({test.test for test in problem.tests}))
    result = FitResult(
        method=case.fit.method,
        seed=case.fit.seed,
        success=optimum.success,
        message=f"{solved.said}; {optimum.message}",
        parameters=_parameters(case, best.parameters if best else problem.start, known.estimates),
        free=tuple(problem.free),
        objective=best.objective if best else None,
        sum_of_squares=best.sum_of_squares if best else None,
        rmse=_rmse(problem, best),
        misfit=misfits(problem, best) if best else {},
        nfev=work.pool.evaluations,
        runs=work.pool.runs,
        reused=work.pool.reused,
        history=optimum.history,
        failures=work.failures(),
        notes=(*known.notes, *work.notes(case), *beside.words),
        solver=work.solver(case),
        mesh=work.mesh(),
        refined=work.finer.factor,
        case_hash=case.hash,
        title=case.title,
        versions={name: importlib.metadata.version(name) for name in PACKAGES} | {"python": platform.python_version()},
        noise=known.noise,
        profiles=findings.profiles,
        bootstrap=findings.bootstrap,
        tests_alone=findings.tests_alone,
        weights_scan=findings.weights_scan,
        uncertain=known.uncertain,
        rivals=known.rivals,
        surrogate=known.surrogate,
        predicted=known.predicted,
        published=known.published,
        conclusions=(
            *known.conclusions,
            *far_from_model(beside.differences, by_mesh=beside.by_mesh),
            *_at_least_bulk(models, problem, best, known),
            *holds,
            *said_of_paths(zip([test.name for test in case.tests], work.facts, strict=False)),
        ),
        taken_as_known=known.taken_as_known,
        law_misfit=known.law_misfit,
        recording=tuple(recording(case)),
        curves=_curves(problem, best),
        case=case,
    )
    return _with_moduli(case, result if of_noise is None else _with_covariance(result, of_noise))


def _judged(known: Certainty, estimates: dict[str, ParameterEstimate], curves: int) -> Certainty:
    """A Certainty with other verdicts, and the sentences on what so many curves determine with them."""
    before, after = (conclusions(each, curves, known.published) for each in (known.estimates, estimates))
    if before == after:
        return replace(known, estimates=estimates)
    place = known.conclusions.index(before[0])
    rest = tuple(sentence for sentence in known.conclusions if sentence not in before)
    return replace(known, estimates=estimates, conclusions=(*rest[:place], *after, *rest[place:]))


def _at_least_bulk(models: Models, problem: InverseProblem, best: Candidate | None, known: Certainty) -> Iterator[str]:
    """A sentence where the viscoelastic model is far from the hereditary integral at the low end of the bulk ratio's interval."""
    share = known.uncertain.inputs.get("bulk_ratio")
    if problem.kernel is None or best is None or share is None or share.interval is None or share.fitted is None:
        return
    low = share.interval[0]
    if low < LESS * share.fitted:
        beside = models.beside(problem, {**best.parameters, BULK: low})
        yield from far_from_model(
            beside.differences, f"at a bulk ratio of {low:.3g}, the low end of its interval, ", beside.by_mesh
        )


def _with_moduli(case: Case, result: FitResult) -> FitResult:
    """The result with the moduli that its parameters mean, and those of the measured curves by closed forms."""
    values = {name: known.value for name, known in result.parameters.items()}
    shear_modulus = case.law(**{name: values[name] for name in case.law.parameters}).shear_modulus
    forms = closed_forms(case, result.measured, shear_modulus, {**result.uncertain.at, **values})
    said = [(name, form.beside(shear_modulus, result.measured[name].deepest)) for name, form in forms.items()]
    said += [(name, form.at_the_end(shear_modulus, result.curves[name])) for name, form in forms.items() if name in result.curves]
    notes = (*result.notes, *(f"{name}: {why}" for name, why in said if why and result.objective is not None))
    notes = (*notes, *left_out(case))
    result = replace(result, moduli=moduli(case, result), closed_forms=forms, notes=notes)
    return replace(result, conclusions=(*result.conclusions, *_beside_layers(case, result, shear_modulus)))


def _beside_layers(case: Case, result: FitResult, shear_modulus: float) -> Iterator[str]:
    """A sentence for each curve whose elastic layer has a modulus outside of the interval of the fitted shear modulus."""
    name = shear_parameter(case.law)
    known = result.parameters[name] if name else result.moduli.get("mu", result.moduli.get("G"))
    if known is None or known.fixed or known.interval is None or result.objective is None:
        return
    for test, form in result.closed_forms.items():
        if test not in result.curves or test not in result.misfit:
            continue
        if said := form.outside(test, shear_modulus, known.interval, result.curves[test], result.misfit[test].relative):
            yield said + (OF_MISFIT if said.endswith(OF_LAW) and case.fit.discrepancy.stated is None else "")


def _with_covariance(result: FitResult, known: Identifiability) -> FitResult:
    return replace(
        result,
        redchi=_number(known.redchi),
        covar=_table(known.covar),
        correlation=_table(known.correlation),
        singular_values=_numbers(known.singular_values),
        directions=_table(known.directions),
    )


def _parameters(case: Case, values: dict[str, float], estimates: dict[str, ParameterEstimate]) -> dict[str, ParameterEstimate]:
    """Name -> estimate, first the parameters in the order of the model, then fitted inputs."""
    units = {name: parameter.unit for name, parameter in case.law.parameters.items()}
    units |= {name: UNITS[name] for name in case.fit.uncertain.fitted}
    if case.relaxation is not None and case.relaxation.free:
        units |= {name: "s" if name.startswith("tau") else "1" for name in case.relaxation.parameters}
    parameters = {}
    for name, unit in units.items():
        if name in estimates:
            parameters[name] = replace(estimates[name], unit=unit)
        elif name in case.fitted:
            bounds = case.fitted[name]
            parameters[name] = ParameterEstimate(
                values[name], unit, start=bounds.start, min=bounds.min, max=bounds.max, verdict=UNKNOWN
            )
        else:
            parameters[name] = ParameterEstimate(values[name], unit, fixed=True)
    return parameters


def _rmse(problem: InverseProblem, best: Candidate | None) -> dict[str, float]:
    if best is None:
        return {}
    return {test.name: rmse(test, force) for test, force in zip(problem.tests, best.forces, strict=True)}


def _curves(problem: InverseProblem, best: Candidate | None) -> dict[str, Curve]:
    if best is None:
        return {}
    pairs = list(zip(problem.tests, best.forces, strict=True))
    if not problem.segmented:
        relaxes = problem.kernel is not None
        return {
            test.name: Curve(test.curve.displacement, F, time=test.curve.time if relaxes else None, axes=test.curve.axes)
            for test, F in pairs
        }
    names = dict.fromkeys(test.test for test in problem.tests)
    return {name: _joined([pair for pair in pairs if pair[0].test == name]) for name in names}


def _joined(segments: Sequence[tuple[Target, Array]]) -> Curve:
    """The curve of a test with these forces in its segments."""
    depth, force = (np.concatenate(part) for part in zip(*((test.curve.displacement, F) for test, F in segments), strict=True))
    times = [test.curve.time for test, _ in segments if test.curve.time is not None]
    return Curve(depth, force, time=np.concatenate(times) if times else None)


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _numbers(row: Array) -> Numbers:
    return tuple(_number(value) for value in row)


def _table(array: Array) -> tuple[Numbers, ...]:
    return tuple(_numbers(row) for row in array)
