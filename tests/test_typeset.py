"""How reports write digits, Greek letters and signs, and how pictures draw stresses and indenters."""

import warnings

import numpy as np
import pytest

from indentfit.case.tables import Indenter
from indentfit.inference.plain import by_error, span, with_error
from indentfit.inference.result import ConfirmedPoint, Profile
from indentfit.report.indenter_outline import outline
from indentfit.report.page import marked
from indentfit.report.plots import corrected
from indentfit.report.stress_plots import stress_range
from indentfit.report.typeset import symbol, typeset

pytestmark = pytest.mark.quick


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (1.20191, 0.0027, "1.2019"), (0.93364, 0.27, "0.93"), (12345.6, 678.0, "12350"), (12345.6, 20.0, "12346"),
        (0.0, 0.1, "0.00"), (1.5, 0.0996, "1.50"), (3.14159, None, "3.1416"), (3.14159, np.inf, "3.1416"),
        (2.5e-9, 1e-10, "0.00000000250"),
    ],
)  # fmt: skip
def test_a_number_has_the_digits_that_its_error_leaves_it(value, error, text):
    assert by_error(value, error) == text


def test_a_number_and_its_error_have_the_same_decimals():
    assert with_error(212.0, 2.7) == "212.0 +- 2.7"
    assert with_error(0.0609, 0.003) == "0.0609 +- 0.0030"
    assert with_error(87.62, float("nan")) == "87.62 +- nan"


def test_both_ends_of_an_interval_have_the_same_digits():
    assert span((1.196, 1.20752)) == "1.1960 to 1.2075"
    assert span((0.4475, 1.62)) == "0.45 to 1.62"
    assert span((2.0, 2.0)) == "2 to 2"


@pytest.mark.parametrize(
    ("written", "shown"),
    [
        ("mu = 1.2, zeta and phi.", "μ = 1.2, ζ and φ."), ("alpha1, alpha_2", "α₁, α₂"),
        ("an order 0.5 <= p <= 2.1", "an order 0.5 ≤ p ≤ 2.1"),
        ("psi = mu/2 (I1 - 3)", "ψ = μ/2 (I1 - 3)"),
        ("-0.089 to -1", "−0.089 to −1"), ("+-0.47 %", "±0.47 %"), ("2 x 20 mm", "2 × 20 mm"),
        ("9 um, 5 uN of 3 users", "9 µm, 5 µN of 3 users"),
        ("0.1% of 5 %, below 3%.", "0.1 % of 5 %, below 3 %."), ("a%20b.csv", "a%20b.csv"),
        ("R2 0.99, 3 mN^2", "R² 0.99, 3 mN²"),
        ("1.5e-05", "1.5 × 10⁻⁵"), ("curves/mu-test.csv", "curves/mu-test.csv"), ("fit.uncertain.mu", "fit.uncertain.mu"),
        ("2026-11-28", "2026-11-28"), ("--phi=3", "--phi=3"), ("a7e1f-3", "a7e1f-3"), ("number", "number"),
    ],
)  # fmt: skip
def test_pages_write_greek_letters_and_true_signs_but_leave_names_of_files_keys_and_dates(written, shown):
    assert typeset(written) == shown


def test_code_is_not_typeset():
    assert marked("mu by `--set material.mu=-1`") == "μ by <code>--set material.mu=-1</code>"
    assert symbol("Ginf_G0") == "Ginf_G0"


def test_a_profile_is_drawn_through_the_runs_that_confirm_it():
    values = np.linspace(1, 3, 21)
    runs = (ConfirmedPoint(1.0, 5.0, 4.0), ConfirmedPoint(3.0, 3.5, 4.0), ConfirmedPoint(2.5, None, None, "failed"))
    profile = Profile(tuple(values), tuple(4 * (values - 2) ** 2), 4.0, (1.0, 3.0), runs)
    drawn = corrected(profile, 2.0)
    assert drawn[0] == pytest.approx(5.0) and drawn[-1] == pytest.approx(3.5) and drawn[10] == pytest.approx(0.0)
    near = Profile(profile.values, profile.chi2, 4.0, (1.0, 3.0), (ConfirmedPoint(2.6, 0.2, 4.0),))  # the surrogate: 1.44
    low = corrected(near, 2.0)
    assert low[16] == pytest.approx(0.2) and low[-1] == pytest.approx(4.0 - 1.24)
    assert (np.diff(low[10:]) > 0).all() and np.allclose(low[:10], 4 * (values[:10] - 2) ** 2)
    bare = Profile(tuple(values), tuple(4 * (values - 2) ** 2), 4.0, (1.0, 3.0), ())
    assert np.allclose(corrected(bare, 2.0), 4 * (values - 2) ** 2)


def test_the_range_of_stresses_has_zero_in_it_and_is_that_of_the_test_with_the_largest():
    weak, strong = -np.linspace(0, 1, 1001), -np.linspace(0, 3, 1001)
    low, high = stress_range([weak, strong])
    assert high == 0 and low == pytest.approx(-3 * 0.995, rel=1e-3)
    assert stress_range([np.zeros(5)])[0] < 0


@pytest.mark.parametrize(
    ("keys", "height"),
    [
        ({"shape": "sphere", "diameter": 4}, lambda s: 2 - np.sqrt(4 - s**2)),
        ({"shape": "cylinder", "diameter": 4}, lambda s: 0 * s),
        ({"shape": "cone", "half_angle": 60, "diameter": 6}, lambda s: s / np.tan(np.radians(60))),
        ({"shape": "strip", "width": 4, "length": 10}, lambda s: 0 * s),
    ],
)
def test_the_outline_of_an_indenter_is_its_shape_at_its_depth(keys, height):
    nodes = np.array([[0, 0, 0], [8, 5, 0], [0, 5, 8.0]])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        cap, across, along = outline(Indenter(friction=0, **keys).geometry, 1.0, nodes).faces
    for face, axis in ((across, 2), (along, 0)):
        profile = face[:-2]
        assert np.allclose(profile[:, 1] - 4.0, height(profile[:, axis]), atol=1e-6)
        assert np.all(face[:, 2 - axis] == 0) and face[:, 1].max() == cap[:, 1].max() == pytest.approx(5.75)
