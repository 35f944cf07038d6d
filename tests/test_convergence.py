"""Discretisation errors: published numbers, manufactured approaches to a limit, and how often a band holds the truth."""

import numpy as np
import pytest

from indentfit.study.convergence import fitted, grid_convergence_index

SIZES = np.array([1.0, 0.8, 0.65, 0.5, 0.4, 0.3])


def test_the_index_is_that_of_the_published_example():
    """Celik et al. 2008, J Fluids Eng 130:078001, table 1, first column: 18,000, 8,000 and 4,500 cells in two dimensions."""
    h = np.array([1.0, 1.5, 1.5 * 1.333])
    found = grid_convergence_index(h, np.array([6.063, 5.972, 5.863]))
    assert found.order == pytest.approx(1.53, abs=0.02)
    assert found.extrapolated == pytest.approx(6.1685, rel=1e-3)
    assert found.index == pytest.approx(0.022, abs=1e-3)


@pytest.mark.parametrize("order", [0.7, 1.0, 1.5, 2.0])
def test_a_pure_power_is_found_with_its_limit(order):
    found = fitted(SIZES, 70 + 4 * SIZES**order)
    assert found.order == pytest.approx(order, abs=1e-4) and found.reliable
    assert found.value == pytest.approx(70, abs=1e-4)
    assert found.interval == pytest.approx((70, 70), abs=0.06)  # orders of its scan lie 0.025 apart
    assert np.allclose(found.uncertainty, 1.25 * 4 * SIZES**order, rtol=1e-3)  # the safety factor times the error
    index = grid_convergence_index(SIZES, 70 + 4 * SIZES**order)
    assert index.order == pytest.approx(order, rel=1e-6) and index.extrapolated == pytest.approx(70, rel=1e-9)


def test_the_order_of_the_meshes_does_not_matter():
    f = 70 + 4 * SIZES**1.2
    turned = [3, 0, 5, 1, 4, 2]
    a, b = fitted(SIZES, f), fitted(SIZES[turned], f[turned])
    assert a.value == pytest.approx(b.value) and np.allclose(a.uncertainty[turned], b.uncertainty)
    assert grid_convergence_index(SIZES, f) == grid_convergence_index(SIZES[turned], f[turned])


def test_an_order_that_cannot_be_is_not_believed_and_costs_certainty():
    found = fitted(SIZES, 70 + 4 * SIZES**4)
    assert found.order is None and found.raw_order == pytest.approx(4, abs=1e-3) and not found.reliable
    assert found.exponents in ((1.0,), (2.0,))
    assert (np.abs(70 + 4 * SIZES**4 - 70) <= found.band(70 + 4 * SIZES**4)).all()


def test_meshes_that_go_up_and_down_have_no_index():
    assert grid_convergence_index([1, 0.8, 0.6], [1.0, 1.2, 1.1]).kind == "oscillatory"
    assert grid_convergence_index([1, 0.8], [1.0, 1.2]) is None


@pytest.mark.parametrize("scatter", [0.01, 0.1, 0.3])
@pytest.mark.parametrize("order", [0.7, 1.2, 1.8])
def test_bands_hold_the_limit_as_often_as_they_say(scatter, order):
    """The interval in about 95 of 100 families with normal scatter, and the band of the finest mesh at least as often."""
    draws, noise = 150, np.random.default_rng(3)
    weights = 1 / SIZES / np.mean(1 / SIZES)
    held = [0, 0]
    for _ in range(draws):
        f = 70 + 4 * SIZES**order + scatter * noise.standard_normal(SIZES.size) / np.sqrt(weights)
        found = fitted(SIZES, f)
        held[0] += found.interval[0] <= 70 <= found.interval[1]
        held[1] += abs(f[-1] - 70) <= found.band(f)[-1]
    assert held[0] / draws > 0.88 and held[1] / draws > 0.93  # 0.95 less four standard errors of 150 draws
