"""A parametric bootstrap on a surrogate: the scatter of estimates under the noise that the residuals show."""

import numpy as np

from indentfit.arrays import Array, Ints
from indentfit.inference.identifiability import Identifiability
from indentfit.inference.many import ManyCurves, Problems
from indentfit.inference.noise import draw
from indentfit.inference.result import BootstrapError
from indentfit.inverse.derivatives import evaluate_at_reference
from indentfit.inverse.problem import Candidate, InverseProblem
from indentfit.inverse.surrogate import Surrogate

DRAWS = 200


def bootstrap(
    problem: InverseProblem, surrogate: Surrogate, candidate: Candidate, known: Identifiability, seed: int, draws: int = DRAWS
) -> dict[str, BootstrapError]:
    """Standard errors and 95 % intervals (percentiles) of estimates from curves with new draws of the noise.

    Parameters
    ----------
    problem : InverseProblem
    surrogate : Surrogate
    candidate : Candidate
        The place at which the surrogate gives the curves without noise.
    known : Identifiability
        The candidate's identifiability, with the noise.
    seed, draws : int

    Returns
    -------
    dict of name -> BootstrapError
    """
    x = problem.units(candidate.parameters)
    forces = evaluate_at_reference(problem, surrogate, [candidate.parameters])[0].forces or ()
    there = problem.scaled(candidate.parameters, forces)
    rng, heavy = np.random.default_rng(seed), [n for n, weight in enumerate(known.weights) if weight]
    roots = np.concatenate([np.sqrt(w) * test.curve.trust for test, w in zip(problem.tests, known.weights, strict=True)])
    targets = np.empty((draws, roots.size))
    for row in targets:
        drawn = list(there)
        for n, noise in zip(heavy, known.noise, strict=True):
            drawn[n] = drawn[n] + draw(noise, rng) / problem.tests[n].curve.trust
        row[:] = np.concatenate(drawn)
    on = ManyCurves(problem, surrogate)

    def residuals(places: Array, numbers: Ints) -> Array:
        return roots * (on.curves(places) - targets[numbers])

    def slopes(places: Array, numbers: Ints) -> Array:
        return roots[:, None] * on.slopes(places)

    estimates, _ = Problems(residuals, slopes).minimised(np.tile(x, (draws, 1)))
    values = np.array([problem.values(problem.parameters(row)) for row in estimates])
    low, high = np.percentile(values, [2.5, 97.5], axis=0)
    rows = zip(problem.free, values.std(axis=0, ddof=1), low, high, strict=True)
    return {name: BootstrapError(float(stderr), (float(lower), float(upper))) for name, stderr, lower, upper in rows}
