"""What would make tests agree that contradict each other: a wrong contact point and a wrong factor are told apart."""

import re

import numpy as np
import pytest

from indentfit.case import Range
from indentfit.curve import Curve
from indentfit.inference import joint
from indentfit.inference.consistency import agreement, predictions
from indentfit.inference.joint import ModelError
from indentfit.inference.joint_consistency import joint_agreement, joint_predictions
from indentfit.inverse.exploration import Watched
from indentfit.inverse.objective import Target
from indentfit.inverse.problem import InverseProblem
from indentfit.inverse.surrogate import learn
from indentfit.inverse.wide import widened_problem
from indentfit.runs.forward import Evaluation

DEPTH = np.linspace(0.02, 0.6, 24)
FREE = {"mu": Range(start=1.0, min=0.1, max=10.0), "a": Range(start=1.0, min=0.0, max=5.0)}


def force(depth, mu=1.0, a=2.0):
    """A curve as under a sphere, of a law that stiffens."""
    d = np.maximum(depth, 0.0)
    return mu * 40 * d**1.5 * (1 + a * d)


class Model:
    """A ForwardModel in closed form."""

    runs, failures = 0, ()

    def differentiable(self):
        return frozenset()

    def evaluate(self, points, report=None, sensitivities=()):
        return [Evaluation(dict(p), (force(DEPTH, **p), force(DEPTH, **p)), None, 0.0, ({}, {})) for p in points]


def problem_of(second, third=None):
    """The problem of a right curve a, another one b, and perhaps a third one, each with 1 % noise."""
    rng, curves = np.random.default_rng(3), [force(DEPTH), second, *([] if third is None else [third])]
    noisy = [curve + 0.01 * curve.max() * rng.standard_normal(curve.size) for curve in curves]
    tests = tuple(Target(name, Curve(DEPTH, curve), 1.0) for name, curve in zip("abc", noisy, strict=False))
    return InverseProblem(tests, {"mu": 1.0, "a": 1.0}, FREE, "mu")


def said_of(second, pressed=(True, True), third=None):
    """The sentence of a fit by least squares."""
    problem = problem_of(second, third)
    tests = problem.tests
    points = [{"mu": 1.0, "a": float(a)} for a in np.linspace(0, 5, 6)]
    forces = [tuple(force(DEPTH, **point) for _ in tests) for point in points]
    runs = [Evaluation(point, curves, None, 0.0, tuple({} for _ in tests)) for point, curves in zip(points, forces, strict=True)]
    surrogate, x = learn(problem, runs), problem.units({"mu": 1.0, "a": 2.0})
    common = [[] for _ in tests]
    return agreement(problem, surrogate, x, common, predictions(problem, surrogate, x, common, 0), [*pressed, True])


def test_a_late_contact_is_told_with_its_size():
    said = said_of(force(DEPTH - 0.03))
    late, _ = map(float, re.findall(r"(\d+) um", said))
    assert "the contact point of b were" in said and "um later, or that of a" in said and "forces" not in said
    assert late == pytest.approx(30, abs=3)


def test_a_stiffer_sample_is_told_with_its_factor():
    said = said_of(1.3 * force(DEPTH))
    assert "contact point" not in said
    less, more = map(float, re.findall(r"(\d+)%", said))
    assert "b were" in said and less == pytest.approx(100 * (1 - 1 / 1.3), abs=1.5) and more == pytest.approx(30, abs=2.5)


@pytest.mark.parametrize(("second", "said"), [(force(DEPTH - 0.03), "um later"), (1.3 * force(DEPTH), "% smaller")])
def test_a_joint_fit_tells_them_apart_too(second, said):
    problem = problem_of(second)
    fit = joint.joint_fit(widened_problem(problem, ()), (), Watched(Model()), ModelError.none(2 * DEPTH.size), 0)
    used = ([True, False], [False, True])
    alone = [joint.fitted(fit.posterior.curves.problem, (), fit.surrogate, fit.error, 0, counted) for counted in used]
    told = joint_agreement(fit, alone, joint_predictions(fit, alone, 0), [True, True])
    assert said in told and ("forces" in told) == ("smaller" in said) and ("contact point" in told) == ("later" in said)


def test_the_one_of_three_tests_that_is_wrong_is_named():
    said = said_of(force(DEPTH - 0.03), third=force(DEPTH))
    assert "the contact point of b were" in said and " of a " not in said and " of c " not in said


def test_no_contact_point_is_blamed_where_there_is_none_and_nothing_where_tests_agree():
    assert "contact point" not in said_of(force(DEPTH - 0.03), pressed=(False, False))
    assert said_of(force(DEPTH)) == ""
