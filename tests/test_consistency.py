"""Tests against each other: each predicted from the others, on a surrogate of the curves of `formula`."""

import numpy as np
import pytest
from fixtures.formulas import TRUTH, Formula, bent, formula, problem

from indentfit.case import Fit
from indentfit.inference.agreement import TestPrediction
from indentfit.inference.consistency import predictions
from indentfit.inference.estimate import estimate
from indentfit.inference.result import AloneEstimate, ParameterEstimate, TestAlone
from indentfit.inference.verdicts import against_each_other, contradictions
from indentfit.inverse import genetic
from indentfit.inverse.exploration import Watched, explore
from indentfit.inverse.surrogate import learn


@pytest.fixture(scope="module")
def learned():
    whole, pool = problem(bent(1, 0.05)), Watched(Formula())
    explore(whole, pool, Fit(), genetic.search)
    return whole, learn(whole, pool.known)


def predicted(learned, forces, common=((), ())):
    whole, surrogate = learned
    problem = whole.measured(forces)
    x, _ = estimate(problem, surrogate, problem.weights, problem.units(TRUTH))
    return predictions(problem, surrogate, x, common, 0)


def noisy(rng, across=1.0):
    along, perpendicular = formula(**TRUTH)
    return [force + 0.3 * rng.standard_normal(force.size) for force in (along, across * perpendicular)]


def test_tests_of_one_material_do_not_contradict_each_other(learned):
    """Twelve draws of white noise: one in a hundred may be called a contradiction."""
    rng = np.random.default_rng(0)
    found = [predicted(learned, noisy(rng)) for _ in range(12)]
    assert sum(known.contradicts for tests in found for known in tests.values()) <= 1
    assert np.median([known.p for tests in found for known in tests.values()]) > 0.2


def test_a_test_that_no_shared_parameters_follow_contradicts_and_a_stated_error_reconciles_it(learned):
    """Across, forces twice as large: mu may follow, but then along does not, and zeta and phi bend the curves."""
    forces = noisy(np.random.default_rng(1), across=2.0)
    found = predicted(learned, forces)
    assert all(known.contradicts for known in found.values())
    assert found["perpendicular"].off > 0 > found["parallel"].off
    wide = [[0.5 * force] for force in forces]  # a load cell that may be wrong by half
    assert not any(known.contradicts for known in predicted(learned, forces, wide).values())


def test_a_single_test_is_not_predicted(learned):
    whole, surrogate = learned
    assert predictions(whole.weighted((1.0, 0.0)), surrogate, whole.units(TRUTH), ((), ()), 0) == {}


def test_where_tests_contradict_each_other_no_parameter_is_determined():
    known = {"mu": ParameterEstimate(1.2, "kPa", interval=(1.1, 1.3), verdict="determined (+-8 %); limited by the noise")}
    alone = {
        name: TestAlone(0.1, 0.1, {"mu": AloneEstimate(value, (value - 0.1, value + 0.1))})
        for name, value in (("a", 1.2), ("b", 2.5))
    }
    wrong, right = TestPrediction(0.01, 0.5), TestPrediction(0.3, 0.5)
    assert against_each_other(known, {"a": right, "b": right}, alone) == known
    changed = against_each_other(known, {"a": right, "b": wrong}, alone)["mu"]
    assert changed.limited_by == "tests"
    assert changed.verdict == "not determined: the tests contradict each other (alone: 1.1 to 1.3 by a, 2.4 to 2.6 by b)"
    assert contradictions({"a": right, "b": wrong}) == (
        "the tests contradict each other: b is 50% above what the others predict (p at most 0.01)",
    )
    assert contradictions({"a": right}) == ()
