"""The genetic algorithm of pymoo under equation (1), each generation evaluated at once.

The scale parameter is not searched for: its best value for given other parameters is found exactly.
"""

import numpy as np
from pymoo.algorithms.soo.nonconvex.ga import GA
from pymoo.core.problem import Problem as Box
from pymoo.operators.crossover.sbx import SBX
from pymoo.operators.mutation.pm import PM
from scipy.stats import qmc

from indentfit.inverse.generations import Generations, Search, only_scale, start_row
from indentfit.inverse.problem import InverseProblem
from indentfit.inverse.progress import SILENT, Progress
from indentfit.inverse.settings import SearchSettings
from indentfit.runs.forward import ForwardModel


def search(problem: InverseProblem, model: ForwardModel, settings: SearchSettings, progress: Progress = SILENT) -> Search:
    """Search of the parameters of an inverse problem by genetic algorithm.

    Parameters
    ----------
    problem : InverseProblem
    model : ForwardModel
        Runs, or a surrogate.
    settings : SearchSettings
    progress : Progress

    Returns
    -------
    Search
    """
    if not problem.searched:
        return only_scale(problem, model)
    algorithm = _algorithm(problem, settings)
    people = Generations(problem, model, settings.generations, "ga", progress)
    for generation in range(1, settings.generations + 1):
        offspring = algorithm.ask()
        algorithm.tell(infills=offspring.set("F", people.judge(offspring.get("X"))[:, None]))
        if people.settled(algorithm.pop.get("X"), settings.tolerance):
            return people.result(f"the population settled in generation {generation}")
    return people.result(f"all {settings.generations} generations done")


def _algorithm(problem: InverseProblem, settings: SearchSettings) -> GA:
    """pymoo's algorithm in units of the ranges; its first population is a Latin hypercube and the start values."""
    n = len(problem.searched)
    first = qmc.LatinHypercube(n, seed=settings.seed).random(settings.population)
    first[0] = start_row(problem)
    algorithm = GA(
        pop_size=settings.population,
        sampling=first,
        crossover=SBX(prob=0.9, eta=10),
        mutation=PM(prob=0.9, prob_var=1 / n, eta=15),
        eliminate_duplicates=True,
        seed=settings.seed,
    )
    box = Box(n_var=n, n_obj=1, xl=np.zeros(n), xu=np.ones(n))
    algorithm.setup(box, termination=("n_gen", settings.generations + 1))
    return algorithm
