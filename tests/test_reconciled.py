"""What would make tests agree that contradict each other: a wrong contact point and a wrong factor are told apart."""

import re

import numpy as np
import pytest

from indentfit.case import Range
from indentfit.curve import Curve
from indentfit.inference.consistency import agreement, predictions
from indentfit.inverse.objective import Target
from indentfit.inverse.problem import InverseProblem
from indentfit.inverse.surrogate import learn
from indentfit.runs.forward import Evaluation

DEPTH = np.linspace(0.02, 0.6, 24)
FREE = {"mu": Range(start=1.0, min=0.1, max=10.0), "a": Range(start=1.0, min=0.0, max=5.0)}


def force(depth, mu=1.0, a=2.0):
    """A curve as under a sphere, of a law that stiffens."""
    d = np.maximum(depth, 0.0)
    return mu * 40 * d**1.5 * (1 + a * d)


def said_of(second, pressed=(True, True), third=None):
    """The sentence on a right curve a, another one b, and perhaps a third one, each with 1 % noise."""
    rng, curves = np.random.default_rng(3), [force(DEPTH), second, *([] if third is None else [third])]
    noisy = [curve + 0.01 * curve.max() * rng.standard_normal(curve.size) for curve in curves]
    tests = tuple(Target(name, Curve(DEPTH, curve), 1.0) for name, curve in zip("abc", noisy, strict=False))
    problem = InverseProblem(tests, {"mu": 1.0, "a": 1.0}, FREE, "mu")
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


def test_the_one_of_three_tests_that_is_wrong_is_named():
    said = said_of(force(DEPTH - 0.03), third=force(DEPTH))
    assert "the contact point of b were" in said and " of a " not in said and " of c " not in said


def test_no_contact_point_is_blamed_where_there_is_none_and_nothing_where_tests_agree():
    assert "contact point" not in said_of(force(DEPTH - 0.03), pressed=(False, False))
    assert said_of(force(DEPTH)) == ""
