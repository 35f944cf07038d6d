"""The genetic algorithm of pymoo under equation (1), each population evaluated at once.

The scale parameter is not searched for: at given others its best value is found exactly.
"""

import numpy as np
from pymoo.algorithms.soo.nonconvex.ga import GA
from pymoo.core.problem import Problem as Box
from pymoo.operators.crossover.sbx import SBX
from pymoo.operators.mutation.pm import PM
from scipy.stats import qmc

from indentfit.inverse.generations import Generations, only_scale, start_row


def search(problem, pool, options, progress=None):
    """Search of an InverseProblem's parameters by genetic algorithm, on a Pool or on a Surrogate.

    options: seed, population, generations and tolerance as in the case's [fit]. progress: called with (share, note).
    """
    if not problem.searched:
        return only_scale(problem, pool)
    algorithm = _algorithm(problem, options)
    people = Generations(problem, pool, options.generations, "ga", progress)
    for generation in range(1, options.generations + 1):
        offspring = algorithm.ask()
        algorithm.tell(infills=offspring.set("F", people.judge(offspring.get("X"))[:, None]))
        if people.settled(algorithm.pop.get("X"), options.tolerance):
            return people.result(f"the population settled in generation {generation}")
    return people.result(f"all {options.generations} generations done")


def _algorithm(problem, options):
    """pymoo's algorithm in units of the ranges; its first population is a Latin hypercube and the start values."""
    n = len(problem.searched)
    first = qmc.LatinHypercube(n, seed=options.seed).random(options.population)
    first[0] = start_row(problem)
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
