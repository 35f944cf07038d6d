"""The methods that a case can ask for: a global search and its polish, or least squares from several starts."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from scipy.stats import qmc

from indentfit.case import Fit
from indentfit.digits import quantity
from indentfit.inverse import evolution, genetic
from indentfit.inverse.exploration import MANY, Exploration, GlobalSearch, Watched, explore
from indentfit.inverse.generations import Search, by_objective, judged, parameters_of
from indentfit.inverse.least_squares import least_squares, multi_start
from indentfit.inverse.local import Optimum
from indentfit.inverse.mesh_correction import MeshCorrection
from indentfit.inverse.polish import polish
from indentfit.inverse.problem import Candidate, InverseProblem
from indentfit.inverse.progress import SILENT, Progress
from indentfit.inverse.settings import sized
from indentfit.inverse.surrogate import learn

SHARE_OF_SEARCH = 0.8  # of the progress, where a polish follows
PEOPLE, GENERATIONS = 8, 4  # of a search on the forward model itself, by default
STARTS_TRIED = 3  # starts of least squares besides the start values
SEARCHES_OF_MANY = 3  # local searches of a problem with many parameters


@dataclass(frozen=True, eq=False)
class Solved:
    """The end of a method.

    Parameters
    ----------
    optimum : Optimum
    exploration : Exploration
        That of the whole ranges.
    said : str
        A sentence about the search.
    model : Watched or None
        The model of the optimum, where it is not the one that the method was given: its curves are corrected for the mesh.
    """

    optimum: Optimum
    exploration: Exploration
    said: str
    model: Watched | None = None


def solve(
    problem: InverseProblem,
    model: Watched,
    options: Fit,
    progress: Progress = SILENT,
    correction: MeshCorrection | None = None,
) -> Solved:
    """Solve an inverse problem by the method that `options` names.

    Parameters
    ----------
    problem : InverseProblem
    model : Watched
    options : Fit
        The case's [fit].
    progress : Progress
    correction : MeshCorrection
        Once the search on the case's mesh has found its best place, the curves are corrected for the mesh, and the optimum is that
        of the corrected curves.

    Returns
    -------
    Solved
    """
    return METHODS[options.method](problem, model, options, progress, correction or MeshCorrection())


def global_search(
    problem: InverseProblem,
    model: Watched,
    options: Fit,
    progress: Progress = SILENT,
    correction: MeshCorrection = MeshCorrection(),  # noqa: B008
) -> Solved:
    """A global search, on a surrogate where the parameters are few, then Gauss-Newton on equation (1) from its best."""
    search, name = SEARCHES[options.method]
    learnable = not options.direct and bool(problem.searched)
    if learnable and len(problem.elastic.free) > MANY:
        many = f"{len(problem.elastic.free)} free parameters"
        if options.method == "ga":
            solved = local_search(problem, model, options, progress, correction)
            return replace(solved, said=f"{many} are many for a surrogate: {solved.said}")
        name += f" on the forward model itself, {many} being many for a surrogate"

    def correct(parameters: Mapping[str, float]) -> None:  # its runs are known when the search ends there
        MeshCorrection(correction.case).of(problem, model, parameters)

    exploration = _explored(problem, model, options, search, progress.part(0, SHARE_OF_SEARCH), correct)
    went = exploration.search
    said = f"{name}: {went.message}"
    if went.best is None:
        message = f"the mechanics failed at every point tried{_cause(model)}"
        return Solved(Optimum(None, None, False, message, went.history), exploration, said)
    model = correction.of(problem, model, went.best.parameters)
    exploration = corrected_exploration(problem, model, exploration) if correction.error else exploration
    return _polished(problem, model, Solved(Optimum(None, None, False, "", went.history), exploration, said), options, progress)


def solved_again(problem: InverseProblem, model: Watched, solved: Solved, options: Fit, progress: Progress = SILENT) -> Solved:
    """The end of a method whose curves have been corrected for the mesh since, from its optimum.

    Parameters
    ----------
    problem : InverseProblem
    model : Watched
        Corrected.
    solved : Solved
        With a best Candidate.
    options : Fit
    progress : Progress

    Returns
    -------
    Solved
    """
    optimum, exploration = solved.optimum, solved.exploration
    assert optimum.best is not None  # the caller has seen to that
    if exploration.equation_one:
        from_here = replace(exploration, search=replace(exploration.search, best=optimum.best))
        start = replace(solved, exploration=corrected_exploration(problem, model, from_here))
        return _polished(problem, model, start, options, progress)
    again = least_squares(problem, model, optimum.best.parameters, options.tolerance, progress)
    message = optimum.message if again.success else again.message
    again = replace(again, message=message, history=(*optimum.history, *again.history))
    return replace(solved, optimum=again, model=model)


def _polished(problem: InverseProblem, model: Watched, solved: Solved, options: Fit, progress: Progress) -> Solved:
    """The end of a global search by Gauss-Newton on equation (1), from the best place of its exploration."""
    exploration = solved.exploration
    start = exploration.search.best
    assert start is not None  # the caller has seen to that
    trusted = exploration.surrogate if exploration.reached else None
    end = polish(problem, model, start, options.tolerance, progress.part(SHARE_OF_SEARCH, 1), trusted)
    reached = end.best.objective if end.best else start.objective
    said = f"{solved.said}; then Gauss-Newton on equation (1) from its best, {len(end.history)} steps, "
    said += f"{quantity(start.objective, 'mN', 6)} to {quantity(reached, 'mN', 6)}"
    optimum = Optimum(end.best, end.derivatives, end.success, end.message, (*solved.optimum.history, *end.history))
    return Solved(optimum, exploration, said, model)


def corrected_exploration(problem: InverseProblem, model: Watched, exploration: Exploration) -> Exploration:
    """An exploration whose curves have been corrected for the mesh since: its best place is looked for again on its surrogate, and
    run; no other run is made.

    Parameters
    ----------
    problem : InverseProblem
    model : Watched
        Corrected.
    exploration : Exploration
        With a best Candidate.

    Returns
    -------
    Exploration
    """
    first = exploration.search.best
    assert first is not None  # the caller has seen to that
    best, *rivals = judged(problem, model, [known.parameters for known in (first, *exploration.rivals)])
    surrogate = learn(problem, model.known) if exploration.surrogate else None
    if surrogate is not None and best is not None and exploration.reached:
        moved = polish(problem, surrogate, best).best or best
        best = min([best, *_run(problem, model, [moved.parameters])], key=by_objective)
        surrogate = learn(problem, model.known) or surrogate
    return replace(
        exploration,
        surrogate=surrogate,
        search=replace(exploration.search, best=best),
        rivals=tuple(rival for rival in rivals if rival),
    )


def _run(problem: InverseProblem, model: Watched, points: list[dict[str, float]]) -> list[Candidate]:
    return [candidate for candidate in judged(problem, model, points) if candidate]


def local_search(
    problem: InverseProblem,
    model: Watched,
    options: Fit,
    progress: Progress = SILENT,
    correction: MeshCorrection = MeshCorrection(),  # noqa: B008
) -> Solved:
    """Least squares from the best of the start values and of other starts over the ranges."""
    few = len(problem.elastic.free) <= MANY
    searches = options.starts or (1 if few else SEARCHES_OF_MANY)
    others = STARTS_TRIED if few else 2 * len(problem.elastic.free)
    starts = [problem.start]
    if problem.searched:
        places = qmc.LatinHypercube(len(problem.searched), seed=options.seed).random(max(others, searches - 1))
        starts += [parameters_of(problem, place) for place in places]
    end = multi_start(problem, model, starts, searches, options.tolerance, progress)
    said = f"least squares, {len(starts)} starts tried, searched from the best {searches}, {len(end.history)} steps"
    solved = Solved(end, Exploration(None, Search(end.best, (), ""), equation_one=False), said)
    if end.best is None:
        return solved
    model = correction.of(problem, model, end.best.parameters)
    return solved_again(problem, model, solved, options, progress) if correction.error else solved


def _explored(
    problem: InverseProblem,
    model: Watched,
    options: Fit,
    search: GlobalSearch,
    progress: Progress,
    meanwhile: Callable[[Mapping[str, float]], object],
) -> Exploration:
    """The global search on a surrogate, or on the model itself where the case asks for a direct search or parameters are many."""
    if not options.direct and problem.searched and len(problem.elastic.free) <= MANY:
        return explore(problem, model, options, search, progress, meanwhile)
    return Exploration(None, search(problem, model, sized(options, PEOPLE, GENERATIONS), progress))


def _cause(model: Watched) -> str:
    return f", at last: {model.failures[-1].cause}" if model.failures else ""


SEARCHES: dict[str, tuple[GlobalSearch, str]] = {
    "ga": (genetic.search, "genetic algorithm"),
    "differential_evolution": (evolution.differential_evolution, "differential evolution"),
    "cma": (evolution.cma, "CMA-ES"),
}
METHODS: dict[str, Callable[[InverseProblem, Watched, Fit, Progress, MeshCorrection], Solved]] = {
    **dict.fromkeys(SEARCHES, global_search),
    "least_squares": local_search,
}
