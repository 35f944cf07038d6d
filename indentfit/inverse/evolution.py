"""Two more global searches under equation (1): scipy's differential evolution, and CMA-ES of pycma (N. Hansen)."""

import warnings

import numpy as np
from scipy.optimize import differential_evolution as scipys
from scipy.stats import qmc

from indentfit.inverse.generations import Generations, only_scale, start_row

FIRST_STEP = 0.3  # of the ranges, CMA-ES


def differential_evolution(problem, pool, options, progress=None):
    """Search of an InverseProblem's parameters by differential evolution, a whole generation at once; options as of `genetic`."""
    if not problem.searched:
        return only_scale(problem, pool)
    people = Generations(problem, pool, options.generations, "differential_evolution", progress)
    n, message = len(problem.searched), f"all {options.generations} generations done"
    size = max(options.population, 5)  # scipy needs five
    first = qmc.LatinHypercube(n, seed=options.seed).random(size)
    first[0] = start_row(problem)
    found = scipys(
        lambda rows: people.judge(rows.T),
        [(0.0, 1.0)] * n,
        init=first,
        maxiter=max(options.generations - 1, 1),  # the first population is one too
        tol=0,
        atol=options.tolerance * 1e-2,
        seed=options.seed,
        polish=False,
        updating="deferred",
        vectorized=True,
        callback=lambda intermediate_result: people.settled(intermediate_result.population, options.tolerance),
    )
    if found.nit < options.generations - 1:
        message = f"the population settled in generation {found.nit + 1}"
    return people.result(message)


def cma(problem, pool, options, progress=None):
    """Search of an InverseProblem's parameters by CMA-ES from its start values, within the bounds; options as of `genetic`."""
    if not problem.searched:
        return only_scale(problem, pool)
    people = Generations(problem, pool, options.generations, "cma", progress)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # pycma speaks of optional plots
        import cma as pycma

        one = len(problem.searched) == 1  # pycma refuses a single variable: a second one that does nothing
        start = np.resize(start_row(problem), 2) if one else start_row(problem)
        strategy = pycma.CMAEvolutionStrategy(start, FIRST_STEP, _settings(options))
        while not strategy.stop():
            rows = strategy.ask()
            strategy.tell(rows, people.judge(np.array(rows)[:, : len(problem.searched)]).tolist())
    return people.result(f"ended by {', '.join(strategy.stop())} after {len(people.history)} generations")


def _settings(options):
    return {
        "bounds": [0, 1],
        "popsize": options.population,
        "maxiter": options.generations,
        "seed": options.seed + 1,  # 0 would be the clock
        "tolfun": options.tolerance,
        "tolx": 1e-5,
        "verbose": -9,
        "verb_log": 0,
    }
