"""Draws of the posterior of two curves with correlated noise, against quadrature over sizes and correlations of their noises."""

from dataclasses import replace

import numpy as np
import pytest
from fixtures.line import DEPTH, DESIGN, Line
from scipy.special import logsumexp, ndtr

from indentfit.case import Range
from indentfit.curve import Curve
from indentfit.inference import joint
from indentfit.inference.density import ALIKE, SLAB, WHITE, Density
from indentfit.inference.draws import drawn
from indentfit.inference.joint import ModelError
from indentfit.inference.noise import correlations, possible
from indentfit.inverse.exploration import Watched
from indentfit.inverse.objective import Target
from indentfit.inverse.problem import InverseProblem
from indentfit.inverse.wide import widened_problem

LOW, HIGH = -400.0, 600.0


class Twice(Line):
    """Two tests, both a d + b d^2."""

    def evaluate(self, points, report=None, sensitivities=()):
        return [replace(known, forces=2 * known.forces) for known in super().evaluate(points)]


def fitted(curves):
    free = {name: Range(start=50, min=LOW, max=HIGH) for name in "ab"}
    tests = tuple(Target(name, Curve(DEPTH, force), 0.5) for name, force in zip("tu", curves, strict=True))
    problem = InverseProblem(tests, {"a": 50.0, "b": 50.0}, free, None)
    fit = joint.joint_fit(widened_problem(problem, ()), (), Watched(Twice()), ModelError.none(50), 0)
    noise = replace(fit.posterior.noise, explained=(), smooth=None)  # the density of AR(1) noise as it is
    return replace(fit, posterior=replace(fit.posterior, noise=noise))


def of_one(force):
    """For each correlation and size of the noise of a curve its log density at the least squares with the logarithm of its prior,
    whether it is white, and the normal equations of a and b."""
    parts = []
    for n, rho in enumerate(possible(25)):
        L = np.linalg.cholesky(correlations(25, rho))
        design, y = np.linalg.solve(L, DESIGN), np.linalg.solve(L, force)
        A, b, squares = design.T @ design, design.T @ y, y @ y
        left = float(np.linalg.lstsq(design, y, rcond=None)[1][0]) / 23
        for s in np.linspace(np.log(left) / 2 - 0.8, np.log(left) / 2 + 1.4, 45):
            log = np.log((1 - WHITE) / SLAB if n else WHITE) - 25 * s - np.log(np.diag(L)).sum()
            parts.append((log, n == 0, A / np.exp(2 * s), b / np.exp(2 * s), squares / np.exp(2 * s)))
    return [np.array(column) for column in zip(*parts, strict=True)]


def by_quadrature(curves):
    """The probability that a (0) or b (1) lies below a value, as a function of both."""
    one, other = map(of_one, curves)
    log, A, b, squares = (
        (one[k][:, None] + other[k][None]).reshape(len(one[0]) * len(other[0]), *one[k].shape[1:]) for k in (0, 2, 3, 4)
    )
    white = one[1][:, None].astype(int) + other[1][None]
    alike = np.select([white == 2, white == 0], [1 / WHITE, 1 / (1 - WHITE)], 0.0)
    covar = np.linalg.inv(A)
    middle = np.einsum("mij,mj->mi", covar, b)
    log = log + np.log(ALIKE * alike + 1 - ALIKE).ravel() + 0.5 * (np.einsum("mi,mi->m", middle, b) - squares)
    log = log + 0.5 * np.linalg.slogdet(covar)[1]
    shares = np.exp(log - logsumexp(log))
    return lambda n, value: float(shares @ ndtr((value - middle[:, n]) / np.sqrt(covar[:, n, n])))


@pytest.mark.parametrize("rho", [0.8, 0.0])
def test_draws_of_two_curves_are_those_of_quadrature_whatever_their_noise(rho):
    """Correlations and sizes of noises were seldom drawn together: of two lines under a correlation of 0.8 intervals were 0.5 to
    1.4 times as wide as the density, by the seed, and with 4,000 particles too narrow still. With 1,000 they are 0.7 to 1.3 times
    as wide (standard deviation 0.19 of 12 seeds, 0.33 before); with 4,000 a tenth of the half width and 2 % of the probability."""
    root, rng = np.linalg.cholesky(correlations(25, rho)), np.random.default_rng([7, 0])
    curves = [DESIGN @ [90, 60] + 0.4 * root @ rng.standard_normal(25) for _ in range(2)]
    below, fit = by_quadrature(curves), fitted(curves)
    for seed in range(2):
        known = drawn(fit, seed, 4000)
        for n in range(2):
            ends = LOW + (HIGH - LOW) * np.quantile(known.places[:, n], [0.025, 0.5, 0.975])
            assert [below(n, end) for end in ends] == pytest.approx([0.025, 0.5, 0.975], abs=0.05)
            assert below(n, ends[2]) - below(n, ends[0]) == pytest.approx(0.95, abs=0.02)


def test_a_correlation_lies_where_its_coordinate_says():
    """First and last values of the coordinate belong to the correlation that they bound, and all of them to one."""
    fit = fitted([DESIGN @ [90, 60] + np.random.default_rng(n).standard_normal(25) for n in range(2)])
    noise = Density(fit).noises[0]
    low, high = noise.ends(np.arange(len(noise.known)))
    np.testing.assert_array_equal(noise.kinds((low + high) / 2), np.arange(len(noise.known)))
    assert (low[0], high[-1]) == (0, pytest.approx(1))
    np.testing.assert_allclose(low[1:], high[:-1])
