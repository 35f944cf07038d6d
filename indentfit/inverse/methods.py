"""The methods that a case can ask for: a global search and its polish, or least squares from several starts."""

from collections.abc import Callable
from dataclasses import dataclass

from scipy.stats import qmc

from indentfit.case import Fit
from indentfit.inverse import evolution, genetic
from indentfit.inverse.exploration import MANY, Exploration, GlobalSearch, Watched, explore
from indentfit.inverse.generations import Search, parameters_of
from indentfit.inverse.least_squares import multi_start
from indentfit.inverse.local import Optimum
from indentfit.inverse.polish import polish
from indentfit.inverse.problem import InverseProblem
from indentfit.inverse.progress import SILENT, Progress
from indentfit.inverse.settings import sized

SHARE_OF_SEARCH = 0.8  # of the progress, where a polish follows
PEOPLE, GENERATIONS = 8, 4  # of a search on the forward model itself, by default
STARTS_TRIED = 3  # starts of least squares besides the start values
SEARCHES_OF_MANY = 3  # local searches of a problem with many parameters


@dataclass(frozen=True, eq=False)
class Solved:
    """The end of a method: the optimum, the exploration of the whole ranges, and a sentence about the search."""

    optimum: Optimum
    exploration: Exploration
    said: str


def solve(problem: InverseProblem, model: Watched, options: Fit, progress: Progress = SILENT) -> Solved:
    """Solve an inverse problem by the method that `options` names.

    Parameters
    ----------
    problem : InverseProblem
    model : Watched
    options : Fit
        The case's [fit].
    progress : Progress

    Returns
    -------
    Solved
    """
    return METHODS[options.method](problem, model, options, progress)


def global_search(problem: InverseProblem, model: Watched, options: Fit, progress: Progress = SILENT) -> Solved:
    """A global search, on a surrogate where the parameters are few, then Gauss-Newton on equation (1) from its best."""
    search, name = SEARCHES[options.method]
    learnable = not options.direct and bool(problem.searched)
    if learnable and len(problem.free) > MANY:
        many = f"{len(problem.free)} free parameters"
        if options.method == "ga":
            solved = local_search(problem, model, options, progress)
            return Solved(solved.optimum, solved.exploration, f"{many} are many for a surrogate: {solved.said}")
        name += f" on the forward model itself, {many} being many for a surrogate"
    exploration = _explored(problem, model, options, search, progress.part(0, SHARE_OF_SEARCH))
    went = exploration.search
    said = f"{name}: {went.message}"
    if went.best is None:
        message = f"the mechanics failed at every point tried{_cause(model)}"
        return Solved(Optimum(None, None, False, message, went.history), exploration, said)
    trusted = exploration.surrogate if exploration.reached else None
    end = polish(problem, model, went.best, options.tolerance, progress.part(SHARE_OF_SEARCH, 1), trusted)
    reached = end.best.objective if end.best else went.best.objective
    said += f"; then Gauss-Newton on equation (1) from its best, {len(end.history)} steps, "
    said += f"{went.best.objective:.6g} to {reached:.6g} mN"
    optimum = Optimum(end.best, end.derivatives, end.success, end.message, (*went.history, *end.history))
    return Solved(optimum, exploration, said)


def local_search(problem: InverseProblem, model: Watched, options: Fit, progress: Progress = SILENT) -> Solved:
    """Least squares from the best of the start values and of other starts over the ranges."""
    few = len(problem.free) <= MANY
    searches = options.starts or (1 if few else SEARCHES_OF_MANY)
    others = STARTS_TRIED if few else 2 * len(problem.free)
    starts = [problem.start]
    if problem.searched:
        places = qmc.LatinHypercube(len(problem.searched), seed=options.seed).random(max(others, searches - 1))
        starts += [parameters_of(problem, place) for place in places]
    end = multi_start(problem, model, starts, searches, options.tolerance, progress)
    said = f"least squares, {len(starts)} starts tried, searched from the best {searches}, {len(end.history)} steps"
    return Solved(end, Exploration(None, Search(end.best, (), ""), equation_one=False), said)


def _explored(problem: InverseProblem, model: Watched, options: Fit, search: GlobalSearch, progress: Progress) -> Exploration:
    """The global search on a surrogate, or on the model itself where the case asks for a direct search or parameters are many."""
    if not options.direct and problem.searched and len(problem.free) <= MANY:
        return explore(problem, model, options, search, progress)
    return Exploration(None, search(problem, model, sized(options, PEOPLE, GENERATIONS), progress))


def _cause(model: Watched) -> str:
    return f", at last: {model.failures[-1].cause}" if model.failures else ""


SEARCHES: dict[str, tuple[GlobalSearch, str]] = {
    "ga": (genetic.search, "genetic algorithm"),
    "differential_evolution": (evolution.differential_evolution, "differential evolution"),
    "cma": (evolution.cma, "CMA-ES"),
}
METHODS: dict[str, Callable[[InverseProblem, Watched, Fit, Progress], Solved]] = {
    **dict.fromkeys(SEARCHES, global_search),
    "least_squares": local_search,
}
