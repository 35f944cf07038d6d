"""The inversion: from a case to parameters, their errors, and how the search went."""

import importlib.metadata
import platform
import time
from dataclasses import replace

import numpy as np
from scipy.stats import qmc

from indentfit.case import require_fittable
from indentfit.curve import Curve
from indentfit.fem.facts import SolveFacts, said_of_tries
from indentfit.fem.simulate import Model
from indentfit.inference.certainty import certainty
from indentfit.inference.result import FitResult
from indentfit.inverse import evolution, genetic
from indentfit.inverse.exploration import MANY, Exploration, Watched, explore
from indentfit.inverse.generations import Search, parameters_of
from indentfit.inverse.least_squares import Optimum, multi_start, polish
from indentfit.inverse.objective import rmse
from indentfit.inverse.problem import inverse_problem
from indentfit.runs.points import UNITS, setup_of
from indentfit.runs.pool import RunPool

PACKAGES = ("indentfit", "numpy", "scipy", "scikit-fem", "numba", "pymoo")
MESH_NOTE = "the error of the mesh is not in the intervals (fit.uncertain.mesh = 0); compare with a finer mesh"
SHARE_OF_FIT = 0.75  # of the progress; the rest is what follows from it
SHARE_OF_SEARCH = 0.8  # of the progress, where a polish follows
PEOPLE, GENERATIONS = 8, 4  # of a search on the forward model itself, where the case does not say
STARTS_TRIED = 3  # besides the start values, least squares
SEARCHES_OF_MANY = 3  # local searches where the parameters are many


def fit(case, progress=None, ledger=None, cluster=None, stop=None):
    """FitResult of a case: its free parameters by `case.fit.method`, on `case.fit.workers` processes.

    progress: called with (share done, note). ledger, cluster, stop: as those of `RunPool`. Raises CaseError where there is
    nothing to fit, MeshError, and what `RunPool.evaluate` raises; a fit that does not converge is no error but `success`
    False. Scripts need `if __name__ == "__main__":`, see `workers`.
    """
    require_fittable(case)
    started, problem = time.perf_counter(), inverse_problem(case)
    model = Model(setup_of(case))  # refuses a mesh that cannot be, before any worker is started
    with RunPool(case, ledger=ledger, cluster=cluster, stop=stop) as workers:
        pool = Watched(workers)
        report = progress or (lambda share, note: None)
        part = lambda share, note: report(SHARE_OF_FIT * share, note)  # noqa: E731
        optimum, exploration, said = METHODS[case.fit.method](problem, pool, case.fit, part)
        rest = lambda share, note: report(SHARE_OF_FIT + (1 - SHARE_OF_FIT) * share, note)  # noqa: E731
        conclusions = certainty(case, problem, pool, optimum, exploration, rest)
        facts = _facts_at(pool, problem, optimum)
    solver = _solver(model, case, pool, facts)
    tries = list(said_of_tries(zip([test.name for test in case.tests], facts, strict=False)))
    return _result(case, problem, optimum, said, conclusions, pool, solver, model.mesh_facts().as_json(), tries, started)


def _global(problem, pool, options, progress):
    """A global search, on a surrogate where the parameters are few, then Gauss-Newton on equation (1) from its best."""
    search, name = SEARCHES[options.method]
    if not options.direct and problem.searched and len(problem.free) > MANY:
        if options.method == "ga":
            optimum, exploration, said = _least_squares(problem, pool, options, progress)
            return optimum, exploration, f"{len(problem.free)} free parameters are many for a surrogate: {said}"
        name += f" on the forward model itself, {len(problem.free)} free parameters being many for a surrogate"
    on_surrogate = not options.direct and problem.searched and len(problem.free) <= MANY
    most = lambda share, note: progress(SHARE_OF_SEARCH * share, note)  # noqa: E731
    if on_surrogate:
        exploration = explore(problem, pool, options, search, most)
    else:
        exploration = Exploration(None, search(problem, pool, _small(options), most))
    found = exploration.search
    said = f"{name}: {found.message}"
    if found.best is None:
        message = f"the mechanics failed at every point tried{_cause(pool)}"
        return Optimum(None, None, False, message, found.history), exploration, said
    trusted = exploration.surrogate if exploration.facts.get("reached") else None
    end = polish(problem, pool, found.best, options.tolerance, _rest(progress), trusted)
    improved = f"{found.best.objective:.6g} to {end.best.objective:.6g} mN"
    said += f"; then Gauss-Newton on equation (1) from its best, {len(end.history)} steps, {improved}"
    optimum = Optimum(end.best, end.derivatives, end.success, end.message, [*found.history, *end.history])
    return optimum, exploration, said


def _least_squares(problem, pool, options, progress):
    """From the start values and from others over the ranges, the best of them first."""
    few = len(problem.free) <= MANY
    searches = options.starts or (1 if few else SEARCHES_OF_MANY)
    others = STARTS_TRIED if few else 2 * len(problem.free)
    starts = [problem.start]
    if problem.searched:
        places = qmc.LatinHypercube(len(problem.searched), seed=options.seed).random(max(others, searches - 1))
        starts += [parameters_of(problem, place) for place in places]
    found = multi_start(problem, pool, starts, searches, options.tolerance, progress)
    said = f"least squares, {len(starts)} starts tried, searched from the best {searches}, {len(found.history)} steps"
    return found, Exploration(None, Search(found.best, [], ""), equation_one=False), said


SEARCHES = {
    "ga": (genetic.search, "genetic algorithm"),
    "differential_evolution": (evolution.differential_evolution, "differential evolution"),
    "cma": (evolution.cma, "CMA-ES"),
}
METHODS = {**dict.fromkeys(SEARCHES, _global), "least_squares": _least_squares}


def _small(options):
    """A population for searches where each member costs a run of the forward model."""
    sizes = {"population": options.population or PEOPLE, "generations": options.generations or GENERATIONS}
    return options.model_copy(update=sizes)


def _rest(progress):
    return lambda share, note: progress(SHARE_OF_SEARCH + (1 - SHARE_OF_SEARCH) * share, note)


def _cause(pool):
    return f", at last: {pool.failures[-1].cause}" if pool.failures else ""


def _facts_at(pool, problem, optimum):
    """The SolveFacts of the runs at the optimum, one for each test; these runs are known already."""
    if optimum.best is None:
        return ()
    evaluation = pool.evaluate([problem.at_reference(optimum.best.parameters)])[0]
    return tuple(SolveFacts.from_json(facts) for facts in evaluation.facts)


def _solver(model, case, pool, facts):
    worst = {key: max((abs(getattr(test, key)) for test in facts), default=None) for key in ("penalty_error", "edge_slip")}
    return {
        "linear": model.solver.name,
        "assembly": case.solver.assembly,
        "workers": pool.workers,
        "run_seconds": pool.seconds,
        "loose_steps": sum(test.loose_steps for test in facts),
        **worst,
    }


def _result(case, problem, optimum, said, conclusions, pool, solver, mesh, tries, started):
    best, tests = optimum.best, problem.tests
    found, known = conclusions
    more = {key: value for key, value in found.items() if key not in ("parameters", "notes")}
    known_keys = dict(
        method=case.fit.method,
        seed=case.fit.seed,
        success=optimum.success,
        message=f"{said}; {optimum.message}",
        parameters=_parameters(case, best.parameters if best else problem.start, known, found.get("parameters", {})),
        free=list(problem.free),
        objective=best and best.objective,
        sum_of_squares=best and best.sum_of_squares,
        rmse={test.name: rmse(test, force) for test, force in zip(tests, best.forces, strict=True)} if best else {},
        redchi=known and _number(known.redchi),
        covar=known and _numbers(known.covar),
        correlation=known and _numbers(known.correlation),
        singular_values=known and _numbers(known.singular_values),
        directions=known and _numbers(known.directions),
        nfev=pool.evaluations,
        runs=pool.runs,
        reused=pool.reused,
        seconds=time.perf_counter() - started,
        history=optimum.history,
        failures=[{"parameters": failure.parameters, "cause": failure.cause} for failure in pool.failures],
        notes=[*found.get("notes", []), *([] if case.fit.uncertain.mesh else [MESH_NOTE]), *tries],
        solver=solver,
        mesh=mesh,
        case_hash=case.hash,
        title=case.title,
        versions={name: importlib.metadata.version(name) for name in PACKAGES} | {"python": platform.python_version()},
        **{{"summary": "conclusions"}.get(key, key): value for key, value in more.items()},
    )
    known_keys["summary"] = known_keys.pop("conclusions", [])
    return replace(FitResult.from_json(known_keys), curves=_curves(tests, best), case=case)


def _parameters(case, values, known, certain):
    """name -> what is known of it, in the order of the model; certain: its interval and verdict."""
    free, found = list(case.fitted), {}
    units = {name: parameter.unit for name, parameter in case.law.parameters.items()}
    units |= {name: UNITS[name] for name in case.fit.uncertain.fitted}
    unknown = {"interval": None, "verdict": "not known: the fit stopped before its errors were found"}
    for name, unit in units.items():
        found[name] = {"value": values[name], "unit": unit, "fixed": name not in free}
        if name in free:
            bounds, n = case.fitted[name], free.index(name)
            found[name] |= {
                "start": bounds.start,
                "min": bounds.min,
                "max": bounds.max,
                "stderr": known and _number(known.stderr[n]),
                "at_bound": known and (known.at_bound[n] or None),
                **certain.get(name, unknown),
            }
    return found


def _curves(tests, best):
    if best is None:
        return {}
    return {test.name: Curve(test.curve.displacement, force) for test, force in zip(tests, best.forces, strict=True)}


def _number(value):
    return float(value) if np.isfinite(value) else None


def _numbers(array):
    return [_numbers(row) if np.ndim(row) else _number(row) for row in array]
