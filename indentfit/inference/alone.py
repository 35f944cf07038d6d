"""Fits with one test alone, and fits under other weights of the tests, on a surrogate."""

import numpy as np

from indentfit.arrays import Array
from indentfit.inference.estimate import best_on
from indentfit.inference.identifiability import Identifiability, identifiability, limit_of, widened
from indentfit.inference.profiles import profiles
from indentfit.inference.result import AloneEstimate, TestAlone, WeightsFit
from indentfit.inference.verdicts import reached, verdict
from indentfit.inverse.derivatives import Underivable, curve_derivatives, evaluate_at_reference
from indentfit.inverse.exploration import Watched
from indentfit.inverse.objective import rmse
from indentfit.inverse.problem import Candidate, InverseProblem
from indentfit.inverse.surrogate import Surrogate, learn

WEIGHTS = np.linspace(0, 1, 11)


def alone(problem: InverseProblem, model: Watched, surrogate: Surrogate, seed: int, forces: float = 0.0) -> dict[str, TestAlone]:
    """The parameters that each test determines alone.

    One test follows its curve far more closely than all tests together do, so that the surrogate's error, which was small beside
    their misfit, may be as large as the misfit of the test alone. So the model is run at the optimum of each fit, the surrogate is
    fitted to these runs too, and the residuals of the run, not of its prediction, are the noise.

    Parameters
    ----------
    problem : InverseProblem
    model : Watched
        Runs prove the optimum of each fit.
    surrogate : Surrogate
    seed : int
    forces : float
        Relative standard deviation common to all forces of a test, such as that by the mesh; the intervals include it.

    Returns
    -------
    dict of test -> TestAlone
        Tests without derivatives are left out.
    """
    singles = [problem.weighted([float(n == k) for k in range(len(problem.tests))]) for n in range(len(problem.tests))]
    predicted = [best_on(single, surrogate, seed) for single in singles]
    runs = evaluate_at_reference(problem, model, [best.parameters for best in predicted])
    surrogate = learn(problem, model.known) or surrogate
    fits = {}
    for n, (single, test, guess, known_run) in enumerate(zip(singles, problem.tests, predicted, runs, strict=True)):
        run = single.judge_best_scale(guess.parameters, known_run.forces) if known_run.forces is not None else None
        best = run or guess
        try:
            slopes = curve_derivatives(single, surrogate, single.units(best.parameters))
        except Underivable:
            continue
        known = identifiability(single, best, slopes)
        move = forces * known.errors.estimator[0] @ best.forces[n]
        known = widened(single, best, known, np.outer(move, move))
        proven = run.objective / test.scale if run else None
        fits[test.name] = TestAlone(guess.objective / test.scale, proven, _estimates(single, surrogate, best, known))
    return fits


def scan_weights(problem: InverseProblem, surrogate: Surrogate, seed: int) -> tuple[WeightsFit, ...]:
    """Fits of two tests under other weights, by equation (1) on the surrogate; none where there are not two tests."""
    return tuple(_weighted(problem, surrogate, seed, weight) for weight in (WEIGHTS if len(problem.tests) == 2 else ()))


def _estimates(problem: InverseProblem, surrogate: Surrogate, best: Candidate, known: Identifiability) -> dict[str, AloneEstimate]:
    estimates, limit = {}, limit_of(known.noise)
    for n, (name, profile) in enumerate(profiles(problem, surrogate, best, known).items()):
        value, bounds = best.parameters[name], problem.free[name]
        said = verdict(value, profile.interval, bounds, reached(known.at_bound[n], value, profile.interval, bounds), limit)
        estimates[name] = AloneEstimate(best.parameters[name], profile.interval, said)
    return estimates


def _weighted(problem: InverseProblem, surrogate: Surrogate, seed: int, weight: float | Array) -> WeightsFit:
    weights = (float(f"{1 - weight:.6g}"), float(f"{weight:.6g}"))
    other = problem.weighted(weights)
    best = best_on(other, surrogate, seed)
    sizes = {test.name: rmse(test, force) for test, force in zip(other.tests, best.forces, strict=True)}
    return WeightsFit(weights, {name: best.parameters[name] for name in problem.free}, sizes)
