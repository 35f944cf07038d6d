"""Two more global searches under equation (1): SciPy's differential evolution, and CMA-ES of pycma (N. Hansen)."""

import warnings
from typing import Any

import numpy as np
import scipy.optimize
from scipy.stats import qmc

from indentfit.arrays import Array
from indentfit.inverse.generations import Generations, Search, only_scale, start_row
from indentfit.inverse.problem import InverseProblem
from indentfit.inverse.progress import SILENT, Progress
from indentfit.inverse.settings import SearchSettings
from indentfit.runs.forward import ForwardModel

FIRST_STEP = 0.3  # of the ranges, CMA-ES
FEWEST_PEOPLE = 5  # SciPy needs five


def differential_evolution(
    problem: InverseProblem, model: ForwardModel, settings: SearchSettings, progress: Progress = SILENT
) -> Search:
    """Search of the parameters of an inverse problem by differential evolution; `genetic.search` describes the arguments."""
    if not problem.searched:
        return only_scale(problem, model)
    people = Generations(problem, model, settings.generations, "differential_evolution", progress)
    n = len(problem.searched)
    first = qmc.LatinHypercube(n, seed=settings.seed).random(max(settings.population, FEWEST_PEOPLE))
    first[0] = start_row(problem)

    def judge_columns(columns: Array) -> Array:
        return people.judge(columns.T)

    def settled(intermediate_result: Any) -> bool:
        return people.settled(intermediate_result.population, settings.tolerance)

    ended = scipy.optimize.differential_evolution(
        judge_columns,
        [(0.0, 1.0)] * n,
        init=first,
        maxiter=max(settings.generations - 1, 1),  # the first population is a generation too
        tol=0,
        atol=settings.tolerance * 1e-2,
        seed=settings.seed,
        polish=False,
        updating="deferred",
        vectorized=True,
        callback=settled,
    )
    if ended.nit < settings.generations - 1:
        return people.result(f"the population settled in generation {ended.nit + 1}")
    return people.result(f"all {settings.generations} generations done")


def cma(problem: InverseProblem, model: ForwardModel, settings: SearchSettings, progress: Progress = SILENT) -> Search:
    """Search of the parameters of an inverse problem by CMA-ES from its start values; `genetic.search` describes the arguments."""
    if not problem.searched:
        return only_scale(problem, model)
    people = Generations(problem, model, settings.generations, "cma", progress)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # pycma warns that its optional plots are missing
        import cma as pycma

        single = len(problem.searched) == 1  # pycma refuses a single variable: a second one that does nothing
        start = np.resize(start_row(problem), 2) if single else start_row(problem)
        strategy = pycma.CMAEvolutionStrategy(start, FIRST_STEP, _options(settings))
        while not strategy.stop():
            rows = strategy.ask()
            strategy.tell(rows, people.judge(np.array(rows)[:, : len(problem.searched)]).tolist())
    return people.result(f"ended by {', '.join(strategy.stop())} after {len(people.history)} generations")


def _options(settings: SearchSettings) -> dict[str, Any]:
    """pycma's own names for the settings."""
    return {
        "bounds": [0, 1],
        "popsize": settings.population,
        "maxiter": settings.generations,
        "seed": settings.seed + 1,  # 0 would be the clock
        "tolfun": settings.tolerance,
        "tolx": 1e-5,
        "verbose": -9,
        "verb_log": 0,
    }
