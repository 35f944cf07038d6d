"""The global search: pymoo's genetic algorithm under equation (1), each population evaluated on the workers.

The scale parameter is not searched for: at given others its best value is found exactly.
"""

from dataclasses import dataclass

import numpy as np
from pymoo.algorithms.soo.nonconvex.ga import GA
from pymoo.core.problem import Problem as Box
from pymoo.operators.crossover.sbx import SBX
from pymoo.operators.mutation.pm import PM
from scipy.stats import qmc

from indentfit.inverse.objective import Candidate

STALLED = 4  # generations without progress that end the search
SPREAD = 1e-3  # of the ranges: a population narrower than this has gathered at one place
PENALTY = 1e3  # a failed point counts as this times the worst that succeeded, inside the algorithm only


@dataclass(frozen=True)
class Search:
    """What a search found: the best Candidate (None where every point failed) and its course."""

    best: Candidate | None
    history: list[dict]
    message: str


def search(problem, pool, options, progress=None):
    """Search of a Problem's parameters by genetic algorithm.

    options: seed, population, generations and tolerance as in the case's [fit]. progress: called with (share, note).
    """
    names = problem.searched
    if not names:
        return _only_scale(problem, pool)
    algorithm = _algorithm(problem, options)
    history, best, message = [], None, f"all {options.generations} generations done"
    for generation in range(1, options.generations + 1):
        offspring = algorithm.ask()
        points = [_parameters(problem, row) for row in offspring.get("X")]
        report = _share_of(generation, options.generations, best, progress)
        candidates = _candidates(problem, pool, points, report)
        algorithm.tell(infills=offspring.set("F", _fitness(candidates)))
        best = min([c for c in [best, *candidates] if c], key=lambda c: c.objective, default=None)
        history.append({"phase": "ga", "step": generation, "objective": best and best.objective, "runs": pool.runs})
        if _settled(history, algorithm.pop.get("X"), options.tolerance):
            message = f"the population settled in generation {generation}"
            break
    return Search(best, history, message)


def _only_scale(problem, pool):
    """No search where only the scale is free: one run gives its best value."""
    best = _candidates(problem, pool, [problem.start], None)[0]
    history = [{"phase": "scale", "step": 1, "objective": best and best.objective, "runs": pool.runs}]
    return Search(best, history, "only the scale parameter is free: found exactly")


def _algorithm(problem, options):
    """pymoo's algorithm in units of the ranges; its first population is a Latin hypercube and the start values."""
    n = len(problem.searched)
    first = qmc.LatinHypercube(n, seed=options.seed).random(options.population)
    first[0] = [problem.units(problem.start)[list(problem.free).index(name)] for name in problem.searched]
    algorithm = GA(
        pop_size=options.population,
        sampling=first,
        crossover=SBX(prob=0.9, eta=10),
        mutation=PM(prob=0.9, prob_var=1 / n, eta=15),
        eliminate_duplicates=True,
        seed=options.seed,
    )
    box = Box(n_var=n, n_obj=1, xl=np.zeros(n), xu=np.ones(n))
    algorithm.setup(box, termination=("n_gen", options.generations + 1))
    return algorithm


def _parameters(problem, row):
    """All parameters, the scale at its reference, at searched ones in units of their ranges."""
    units = problem.units(problem.start)
    units[[list(problem.free).index(name) for name in problem.searched]] = row
    return problem.at_reference(problem.parameters(units))


def _candidates(problem, pool, points, report):
    """The Candidate of each point with its best scale, None where the mechanics failed."""
    evaluations = pool.evaluate([problem.at_reference(point) for point in points], report)
    return [problem.judge_best_scale(e.parameters, e.forces) if e.forces else None for e in evaluations]


def _fitness(candidates):
    """Objectives, shape (n, 1); failures count as far worse than all others, so that they die out."""
    known = [candidate.objective for candidate in candidates if candidate]
    worst = PENALTY * (max(known, default=0.0) + 1.0)
    return np.array([[candidate.objective if candidate else worst] for candidate in candidates])


def _share_of(generation, generations, best, progress):
    """Progress of the runs of one population as (share of the whole search, note)."""
    if progress is None:
        return None
    note = f"generation {generation}" + (f", objective {best.objective:.4g} mN" if best else "")
    return lambda done, total: progress((generation - 1 + done / total) / generations, note)


def _settled(history, population, tolerance):
    """Whether the best has stood still for some generations and the population has gathered around it."""
    objectives = [row["objective"] for row in history[-1 - STALLED :]]
    if len(objectives) <= STALLED or objectives[0] is None:
        return False
    still = objectives[0] - objectives[-1] <= tolerance * objectives[-1]
    return bool(still and population.std(axis=0).max() < SPREAD)
