"""Other stretches of the parameters' ranges, where the surrogate of a widened problem does not follow the runs near its optimum."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from indentfit.arrays import Array
from indentfit.inverse.polynomials import USUAL_BETA
from indentfit.inverse.surrogate import Surrogate, learn
from indentfit.runs.forward import Evaluation

BETAS = (USUAL_BETA, 100.0, 1000.0)  # stretches (see `polynomials.warp`): a range of 1000 has its logarithm with the last


def otherwise_stretched(surrogate: Surrogate, runs: Sequence[Evaluation]) -> Surrogate:
    """The surrogate whose stretches of the parameters' ranges predict the runs near the optimum best, each from all others.

    Usual stretches serve parameters in which curves are linear. The curves of a limit, such as Gent's, go by its reciprocal: the
    runs at the low end of a wide range then leave nothing right elsewhere, and no proof succeeds.

    Parameters
    ----------
    surrogate : Surrogate
        Of a widened problem.
    runs : sequence of Evaluation

    Returns
    -------
    Surrogate
        The same one where no other stretch is better.
    """
    best = surrogate
    for name in surrogate.problem.searched:
        if best.problem.warps.get(name, USUAL_BETA) < USUAL_BETA:
            continue  # an uncertain input, with its own warp
        for beta in BETAS:
            problem = replace(best.problem, warps={**best.problem.warps, name: beta})
            other = learn(problem, runs, exact=True)
            if other is not None and _left_out(other) < _left_out(best):
                best = other
    return best


def errors_left_out(surrogate: Surrogate) -> tuple[Array, Array] | None:
    """Errors (m, N), mN, of the prediction of each run from all others, and what each counts (m,), the more the nearer it is to the
    optimum: in all 1. None where no run can be left out."""
    if surrogate.fitted.left_out is None:
        return None
    weights = np.array([run.weight for run in surrogate.training])
    return surrogate.fitted.left_out / weights[:, None], weights**4 / np.sum(weights**4)


def _left_out(surrogate: Surrogate) -> float:
    """Mean square of the errors of predictions of each run from all others, mN^2."""
    known = errors_left_out(surrogate)
    return np.inf if known is None else float(known[1] @ np.mean(known[0] ** 2, axis=1))
