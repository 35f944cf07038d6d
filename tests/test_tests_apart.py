"""Tests whose smooth residuals ask for different parameters: the explained parts count by how far they are apart."""

import numpy as np
import pytest

from indentfit.case import Range
from indentfit.curve import Curve
from indentfit.inference import joint
from indentfit.inference.joint import ModelError
from indentfit.inference.smooth_misfit import apart_at
from indentfit.inverse.exploration import Watched
from indentfit.inverse.objective import Target
from indentfit.inverse.problem import InverseProblem
from indentfit.inverse.wide import widened_problem
from indentfit.runs.forward import Evaluation

DEPTH = np.linspace(0.0132, 0.33, 25)
LINES = [np.column_stack([DEPTH, k * DEPTH**2]) for k in (1, 3)]


class Lines:
    """a d + b d^2 and a d + 3 b d^2."""

    runs, failures = 0, ()

    def differentiable(self):
        return frozenset()

    def evaluate(self, points, report=None, sensitivities=()):
        return [Evaluation(dict(p), tuple(X @ [p["a"], p["b"]] for X in LINES), None, 0.0, ({}, {})) for p in points]


def fitted(seed):
    """A fit to both lines, with smooth errors of their own."""
    rng, u = np.random.default_rng(seed), DEPTH / DEPTH[-1]
    root = np.linalg.cholesky(np.exp(-0.5 * np.subtract.outer(u, u) ** 2 / 0.4**2) + 1e-3 * np.eye(25))
    forces = [X @ [90.0, 60.0] + 0.3 * root @ rng.standard_normal(25) for X in LINES]
    tests = tuple(Target(name, Curve(DEPTH, force), 0.5) for name, force in zip("tu", forces, strict=True))
    problem = InverseProblem(tests, {"a": 50.0, "b": 50.0}, {n: Range(start=50, min=0, max=200) for n in "ab"}, None)
    return joint.joint_fit(widened_problem(problem, ()), (), Watched(Lines()), ModelError.none(50), 0)


@pytest.mark.parametrize("seed", [900, 903])
def test_smooth_tests_are_not_further_apart_than_their_covariance_says(seed):
    """The intervals of the second set left out both true parameters."""
    fit = fitted(seed)
    assert fit.posterior.noise.smooth is not None
    more = apart_at(fit.posterior, fit.mode.z)
    assert np.trace(more) < 0.1 * np.trace(fit.posterior.noise.smooth)


def test_the_parameters_of_such_a_set_are_held():
    fit = fitted(903)
    values, errors = 200 * fit.mode.z, 200 * np.sqrt(np.diag(fit.mode.covar))
    assert (np.abs(values - [90, 60]) < 1.96 * errors).all()
