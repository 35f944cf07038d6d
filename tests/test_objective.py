"""The objective by hand: units of the ranges, the scale that is left out of a search, and what a case makes of them."""

from types import SimpleNamespace

import numpy as np
import pytest
from fixtures.cases import white_matter
from numpy.testing import assert_allclose, assert_array_equal

from indentfit.case import Range
from indentfit.curve import Curve
from indentfit.inverse.objective import Target, best_scale
from indentfit.inverse.problem import InverseProblem, differences_of, inverse_problem, scale_of

pytestmark = pytest.mark.quick

D = np.array([0.1, 0.2, 0.4])
ONE, TWO = np.array([1.0, 2.0, 4.0]), np.array([1.0, 3.0, 9.0])
FREE = {"mu": Range(start=3.0, min=2.0, max=6.0), "zeta": Range(start=0.0, min=-1.0, max=4.0)}
START = {"mu": 3.0, "zeta": 0.0, "phi": 0.7}


def target(force, weight=0.5, name="a"):
    return Target(name, Curve(D, force), weight)


def problem(scale="mu", reference=2.0):
    return InverseProblem((target(ONE, 0.75), target(TWO, 0.25, "b")), START, FREE, scale, reference)


# Units of the ranges


def test_free_parameters_are_counted_in_units_of_their_ranges():
    whole = problem()
    assert_allclose(whole.units({"mu": 3.0, "zeta": 0.0, "phi": 9.0}), [0.25, 0.2], rtol=1e-15)
    assert whole.parameters([0.25, 0.2]) == START  # what is not free keeps its value
    assert (whole.range("mu"), whole.range("zeta")) == (4.0, 5.0)
    assert whole.searched == ["zeta"] and problem(scale=None).searched == ["mu", "zeta"]


def test_units_beyond_a_range_mean_its_bound():
    assert problem().parameters([-0.5, 1.5]) == START | {"mu": 2.0, "zeta": 4.0}
    assert problem().parameters([1.5, -0.5]) == START | {"mu": 6.0, "zeta": -1.0}


def test_values_turned_into_units_and_back_are_the_same_to_the_last_bit():
    whole = problem()
    for mu, zeta in np.random.default_rng(0).uniform([2, -1], [6, 4], (300, 2)).round(6).tolist():
        assert whole.parameters(whole.units({"mu": mu, "zeta": zeta})) == START | {"mu": mu, "zeta": zeta}


# The scale


def test_the_model_is_run_at_the_reference_and_its_curves_are_scaled_from_there():
    at = {"mu": 3.0, "zeta": 1.0, "phi": 0.7}
    assert problem().at_reference(at) == at | {"mu": 2.0}
    assert_allclose(problem().scaled(at, (ONE, TWO)), [1.5 * ONE, 1.5 * TWO], rtol=1e-15)
    whole = problem(scale=None)
    assert whole.at_reference(at) == at and whole.at_reference(at) is not at
    assert_array_equal(whole.scaled(at, (ONE, TWO)), [ONE, TWO])


@pytest.mark.parametrize("reference", [2.0, 0.5])
@pytest.mark.parametrize(("wanted", "mu"), [(5.0, 5.0), (2.0, 2.0), (0.6, 2.0), (20.0, 6.0)])
def test_the_best_scale_of_a_problem_counts_from_its_reference_and_keeps_to_its_range(reference, wanted, mu):
    """Measured curves are wanted / reference times those of the reference: the best value is the wanted one, within 2..6."""
    factor = wanted / reference
    whole = problem(reference=reference).measured([factor * ONE, factor * TWO])
    found = whole.judge_best_scale({"mu": 99.0, "zeta": 1.0, "phi": 0.7}, (ONE, TWO))
    assert found.parameters == {"mu": pytest.approx(mu, rel=1e-14), "zeta": 1.0, "phi": 0.7}
    assert_allclose(found.forces, [mu / reference * ONE, mu / reference * TWO], rtol=1e-14)
    off = abs(mu / reference - factor)  # the RMSE of one curve is what it is off, times its own root mean square
    expected = off * (0.75 * np.sqrt(np.mean(ONE**2)) + 0.25 * np.sqrt(np.mean(TWO**2)))
    assert found.objective == pytest.approx(expected, abs=1e-14)


def test_without_a_scale_parameters_are_judged_as_they_are():
    at = {"mu": 5.0, "zeta": 1.0, "phi": 0.7}
    found = problem(scale=None).judge_best_scale(at, (ONE + 2, TWO - 1))
    assert found.parameters == at
    assert found.objective == pytest.approx(0.75 * 2 + 0.25 * 1, rel=1e-14)
    assert found.sum_of_squares == pytest.approx(0.75 * 4 + 0.25 * 1, rel=1e-14)


def test_a_heavier_test_that_one_scale_meets_exactly_decides():
    """Equation (1) has a kink there: 3 against 1 on curves of one size, best scales 1 and 2; least squares would lie between."""
    assert best_scale([target(ONE, 0.75), target(2 * ONE, 0.25)], [ONE, ONE]) == pytest.approx(1.0, rel=1e-14)
    assert best_scale([target(ONE, 0.25), target(2 * ONE, 0.75)], [ONE, ONE]) == pytest.approx(2.0, rel=1e-14)


def test_a_curve_weighs_by_its_rmse_whatever_its_number_of_points():
    """The same curve with each point four times: its weight 0.4 stays below the 0.6 of the other."""
    often = Target("b", Curve(np.linspace(0.1, 0.4, 12), np.repeat(2 * ONE, 4)), 0.4)
    assert best_scale([target(ONE, 0.6), often], [ONE, np.repeat(ONE, 4)]) == pytest.approx(1.0, rel=1e-14)


def test_a_test_without_weight_has_no_say_in_the_scale():
    assert best_scale([target(ONE, 1.0), target(100 * ONE, 0.0)], [ONE, ONE]) == pytest.approx(1.0, rel=1e-14)


def test_a_curve_without_force_harms_no_other():
    """It misses its target whatever the scale, so the scale is that of the other test."""
    assert best_scale([target(3 * ONE), target(TWO)], [ONE, 0 * TWO]) == pytest.approx(3.0, rel=1e-12)
    assert best_scale([target(TWO)], [0 * TWO]) == 0.0


# The same problem with other tests


def test_other_weights_and_other_forces_leave_the_rest_alone():
    whole = problem()
    heavier = whole.weighted([0.1, 0.9])
    assert [test.weight for test in heavier.tests] == [0.1, 0.9]
    other = whole.measured([TWO, ONE])
    assert_array_equal([test.curve.force for test in other.tests], [TWO, ONE])
    assert_array_equal([test.curve.displacement for test in other.tests], [D, D])
    for changed in (heavier, other):
        assert [test.name for test in changed.tests] == ["a", "b"]
        assert (changed.start, changed.free, changed.scale, changed.reference) == (START, FREE, "mu", 2.0)


# What a case asks


def asked(start=1.0, low=0.1, high=10.0, kappa=None, free="mu", fitted=("mu",)):
    """What `scale_of` and `differences_of` look at in a case whose force is proportional to mu."""
    return SimpleNamespace(
        tests=(),
        law=SimpleNamespace(scale="mu"),
        material=SimpleNamespace(kappa=kappa),
        free={free: Range(start=start, min=low, max=high)},
        fitted=dict.fromkeys(fitted),
        fit=SimpleNamespace(uncertain=SimpleNamespace(fitted={name: None for name in fitted if name != free})),
    )


@pytest.mark.parametrize(
    ("keys", "expected"),
    [
        ({}, ("mu", 1.0)),
        ({"start": 0.2, "high": 0.5}, ("mu", 0.2)),
        ({"start": 0.0, "low": 0.0}, ("mu", 10.0)),  # nothing can be run without stiffness
        ({"start": -1.0, "low": -2.0}, ("mu", 10.0)),
        ({"start": -1.0, "low": -2.0, "high": 0.0}, (None, 1.0)),
        ({"kappa": 1000.0}, (None, 1.0)),  # it stays as mu changes
        ({"free": "zeta"}, (None, 1.0)),
    ],
)
def test_the_force_is_proportional_to_a_free_scale_where_kappa_goes_with_it(keys, expected):
    assert scale_of(asked(**keys)) == expected


def test_only_the_thickness_has_no_sensitivity_unless_kappa_stays():
    fitted = ("mu", "friction", "thickness")
    assert differences_of(asked(fitted=fitted)) == ("thickness",)
    assert differences_of(asked()) == ()
    assert differences_of(asked(fitted=fitted, kappa=1000.0)) == fitted


def test_a_case_is_a_problem_of_its_measured_tests_and_all_that_is_free():
    keys = ["material.mu={start=2,min=0.5,max=8}", "fit.uncertain.friction={start=0.4,min=0.1,max=0.8}"]
    case = white_matter(*keys)
    whole = inverse_problem(case)
    assert [(test.name, test.weight) for test in whole.tests] == [(test.name, test.weight) for test in case.tests]
    assert_array_equal(whole.tests[1].curve.force, case.curves[1].force)
    assert whole.start == {"mu": 2.0, "zeta": 4.68, "phi": 0.68, "friction": 0.4}
    assert list(whole.free) == ["mu", "friction"]
    assert (whole.scale, whole.reference, whole.differences) == ("mu", 2.0, ())
