"""The intervals that a design expects of a fit: weights that are not those of the variances, and noise that has to be learned."""

import numpy as np
import pytest
from scipy.stats import chi2, truncnorm
from scipy.stats import t as student

from indentfit.case import Range
from indentfit.study.design import _open
from indentfit.study.further import Known
from indentfit.study.promised import NORMAL, Evidence, half_widths, learning, spread

pytestmark = pytest.mark.quick
X = np.linspace(0.1, 1, 25)
J = np.column_stack([X, X**2])
WEAK = np.diag([1e-9, 1e-9])  # a prior that says nothing


def test_known_noise_and_its_weights_give_fishers_information():
    evidence = [Evidence(J.T @ J / 0.04), Evidence(J.T @ J / 0.01)]
    exact = NORMAL * np.sqrt(np.diag(np.linalg.inv(J.T @ J * 125)))
    assert half_widths(evidence, WEAK, squares=True) == pytest.approx(exact, rel=1e-6)


@pytest.mark.parametrize("squares", [True, False])
def test_weights_of_a_fit_cost_what_draws_of_its_noise_show(squares):
    """Two curves, the second with a tenth of the noise, whose squares weigh alike, or in inverse proportion to their misfit."""
    noises, designs = [0.3, 0.03], [J, J[:, ::-1] + 0.2]
    evidence = [Evidence(J.T @ J / s**2, 1.0, s, 25, 1.0) for J, s in zip(designs, noises, strict=True)]
    rng, estimates = np.random.default_rng(0), []
    roots = [1.0 if squares else s**-0.5 for s in noises]
    A = np.concatenate([root * J for root, J in zip(roots, designs, strict=True)])
    for _ in range(3000):
        rows = [root * s * rng.standard_normal(25) for root, s in zip(roots, noises, strict=True)]
        estimates.append(np.linalg.lstsq(A, np.concatenate(rows), rcond=None)[0])
    assert half_widths(evidence, WEAK, squares) == pytest.approx(NORMAL * np.std(estimates, axis=0), rel=0.05)


def test_displacements_weigh_by_their_variances_beside_the_forces():
    """Counted as the forces are on average, they add Fisher's information to that of one curve."""
    evidence = [Evidence(J.T @ J / 0.04, 1.0, 0.2, 25, 0.7), Evidence(J.T @ J / 0.01)]
    exact = NORMAL * np.sqrt(np.diag(np.linalg.inv(J.T @ J * 125)))
    assert half_widths(evidence, WEAK, squares=True) == pytest.approx(exact, rel=1e-6)


def test_what_no_test_sees_has_the_priors_width():
    one = np.column_stack([X, 0 * X])
    found = half_widths([Evidence(one.T @ one / 0.01, 1.0, 0.1, 25, 1.0)], np.diag([1.0, 12 / 5**2]), squares=True)
    assert found[1] == pytest.approx(NORMAL * 5 / 12**0.5, rel=1e-6)


def test_noise_that_has_to_be_learned_widens_at_least_as_students_t():
    for points in (5, 12, 24):
        assert student.ppf(0.975, points - 1) / NORMAL < learning(points, 1) < 2
    assert learning(5, 1) > learning(12, 1) > learning(24, 1)
    assert learning(1000, 3) == 1.0


def test_single_fits_state_intervals_as_wide_as_the_noise_that_they_learn():
    """Below the median those of the square root of chi-square; above it the residuals of some fits look correlated."""
    own = [Evidence(J.T @ J / 0.04, 1.0, 0.2, 25, 1.0, learnt=learnt) for learnt in (True, False)]
    low, high = spread(own[:1], WEAK, squares=True)
    by_size = np.sqrt(chi2.ppf([0.05, 0.95], 23) / chi2.median(23))
    assert low == pytest.approx(by_size[0], rel=0.1)
    assert np.all(high > 1.2 * by_size[1])
    assert spread(own[1:], WEAK, squares=True) == pytest.approx(1.0)


def test_what_an_estimate_leaves_open_lies_at_quantiles_of_a_normal_density_within_the_range():
    """One parameter, by scipy; and two, of which only the sum is known: the values move along the difference."""
    ranges = {"phi": Range(start=1.0, min=0.0, max=5.0)}
    found = [one["phi"] for one in _open({"phi": 1.0, "mu": 7.0}, ranges, np.array([[1.5**2]]))]
    assert sorted(found) == pytest.approx(truncnorm.ppf([0.05, 0.5, 0.95], -1 / 1.5, 4 / 1.5, 1.0, 1.5).tolist(), rel=1e-6)
    assert _open({"phi": 1.0}, ranges, np.array([[0.01**2]])) == []
    ranges["zeta"] = Range(start=2.0, min=0.0, max=5.0)
    known = np.linalg.inv(np.array([[1.0, 1.0], [1.0, 1.0]]) * 1e4 + 0.5 * np.eye(2))
    rows = _open({"phi": 1.0, "zeta": 2.0}, ranges, known)
    assert [row["phi"] + row["zeta"] for row in rows] == pytest.approx([3.0] * 3, abs=1e-3)
    assert np.ptp([row["phi"] for row in rows]) > 1


def test_at_the_bound_all_that_is_left_open_lies_within_the_range():
    ranges = {"phi": Range(start=1.0, min=0.0, max=5.0)}
    assert all(0.0 < one["phi"] < 5.0 for one in _open({"phi": 0.0}, ranges, np.array([[1.0]])))


def evidence_at(*noises):
    """Of a curve at each place, whose noise differs from place to place; empty where there is none."""
    return tuple((Evidence(J.T @ J / s**2, 1.0, s, 25, 1.0),) if s else () for s in noises)


def test_values_without_evidence_are_counted_and_shift_no_others():
    """Four places, the last of which decides the span: where the own tests or a further one fail at another, the parameters count
    with the others, and where they fail at all others, no span is told."""

    def known(*noises):
        return Known(({"a": 1.0, "b": 1.0},) * len(noises), ("a", "b"), WEAK, evidence_at(*noises), True, 0.1, 0.1, 0.1)

    whole, gone = known(0.1, 0.2, 0.3, 0.9).promised(), known(0.1, 0.2, None, 0.9).promised()
    assert (whole.unsolved, gone.unsolved) == (0, 1)
    assert gone[:2] == known(0.1, 0.1, 0.2, 0.9).promised()[:2]
    further = evidence_at(0.1, None, None, 0.5)
    assert known(0.1, 0.2, 0.3, 0.9).promised(further).unsolved == 2
    assert known(0.1, None, 0.3, 0.9).promised(evidence_at(0.1, 0.2, None, 0.5)).unsolved == 2
    none = known(0.1, 0.2, 0.3, 0.9).promised(evidence_at(0.1, None, None, None))
    assert (none.unsolved, none.between) == (3, None)
    assert known(0.1).promised() == (known(0.1).promised().half_width, None, 0)
