"""Curves that state a standard deviation for each force: points weigh by the inverse squares, in the fit and in its errors."""

import numpy as np
import pytest
from fixtures.cases import tiny_case
from scipy.linalg import null_space
from scipy.stats import binom, multivariate_normal

from indentfit import fit
from indentfit.curve import Curve, read_curve, write_curve
from indentfit.errors import CaseError, CurveError
from indentfit.experiment.measured import read_case
from indentfit.inference.noise import SLAB, STATED_WHITE, Correlated, correlations, errors, possible
from indentfit.inverse.objective import Target, best_scale, rmse
from indentfit.runs.forward import simulate

pytestmark = pytest.mark.quick
DEPTH = np.linspace(0.02, 0.2, 10)


def rows(deviations, header="displacement_mm,force_mN,force_sd_mN"):
    return header + "\n" + "".join(f"{d},{10 * d},{sd}\n" for d, sd in zip(DEPTH.tolist(), deviations, strict=True))


@pytest.mark.parametrize(
    ("header", "factor"),
    [
        ("displacement_mm,force_mN,force_sd_mN", 1.0),
        ("displacement_mm,force_mN,force_sd_uN", 1e-3),
        ("displacement_mm,force_mN,Force SD (N)", 1e3),
        ("displacement_mm,force_mN,force_std_mN", 1.0),
        ("Displacement (mm),Load (mN),Load error (gf)", 9.80665),
    ],
)
def test_a_column_of_standard_deviations_is_read_in_its_unit(tmp_path, header, factor):
    (tmp_path / "curve.csv").write_text(rows(range(1, 11), header))
    curve = read_curve(tmp_path / "curve.csv")
    np.testing.assert_allclose(curve.sd, factor * np.arange(1, 11), rtol=1e-12)
    assert curve.notes == ()
    write_curve(tmp_path / "again.csv", curve)
    np.testing.assert_array_equal(read_curve(tmp_path / "again.csv").sd, curve.sd)


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        (rows([0, *range(1, 10)]), "line 2: standard deviation 0 mN must be above zero"),
        (rows([1] * 4 + [-1] + [1] * 5), "line 6: standard deviation -1 mN must be above zero"),
        (rows([1] * 9 + [1e-4]), "line 11: standard deviation 0.0001 mN is below 0.001 of the median, 1 mN"),
        (rows([1] * 9 + ["nan"]), "line 11: 'nan' is not a finite number"),
        (rows([1] * 10, "displacement_mm,force_mN,force_sd_mm"), "column 'force_sd_mm'"),
        (rows([1] * 10, "force_sd_mN,force_mN,force_std_mN"), "no column displacement_mm"),
    ],
)
def test_a_deviation_that_cannot_be_a_weight_is_refused(tmp_path, text, wanted):
    (tmp_path / "curve.csv").write_text(text)
    with pytest.raises(CurveError) as caught:
        read_curve(tmp_path / "curve.csv")
    assert wanted in str(caught.value) and "\n" not in str(caught.value)


def test_deviations_of_a_curve_in_memory():
    with pytest.raises(CurveError, match="one sd for each force"):
        Curve(DEPTH, 10 * DEPTH, sd=[1.0])
    with pytest.raises(CurveError, match="the sd of a curve must be numbers"):
        Curve(DEPTH, 10 * DEPTH, sd=["?"] * 10)
    curve = Curve(DEPTH, 10 * DEPTH, sd=list(range(1, 11)))
    assert np.mean(curve.trust**2) == pytest.approx(1.0)
    np.testing.assert_allclose(curve.trust * curve.sd, curve.stated_noise)
    assert Curve(DEPTH, 10 * DEPTH).trust.tolist() == [1.0] * 10


def test_the_scale_and_its_error_are_those_of_weighted_least_squares():
    """One slope through the origin: s = sum(x y / sd^2) / sum(x^2 / sd^2), with variance 1 / sum(x^2 / sd^2) (Gauss)."""
    rng = np.random.default_rng(3)
    x, sd = np.linspace(1, 10, 400), np.geomspace(0.01, 1.0, 400)
    y = 2 * x + sd * rng.standard_normal(400)
    curve = Curve(x, y, sd=sd)
    exact, variance = np.sum(x * y / sd**2) / np.sum(x**2 / sd**2), 1 / np.sum(x**2 / sd**2)
    assert best_scale([Target("a", curve, 1.0)], [x]) == pytest.approx(exact, rel=1e-12)
    noise, known = errors([curve.trust[:, None] * x[:, None]], [curve.trust * (exact * x - y)], [1.0], [curve.stated_noise])
    assert known.covar[0, 0] == pytest.approx(variance, rel=0.15) and known.covar[0, 0] >= variance * (1 - 1e-9)
    smooth = 0.003 * np.sin(x)  # a small misfit whose smoothness says nothing of the stated noise
    _, quiet = errors([curve.trust[:, None] * x[:, None]], [curve.stated_noise * smooth], [1.0], [curve.stated_noise])
    assert quiet.covar[0, 0] == pytest.approx(variance, rel=0.02) and quiet.freedom[0] > 100
    (loud,), doubled = errors([curve.trust[:, None] * x[:, None]], [3 * curve.trust * (exact * x - y)], [1.0], [curve.stated_noise])
    assert doubled.covar[0, 0] == pytest.approx(9 * variance, rel=0.3)  # residuals louder than stated count
    assert loud.sigma > 2 * noise[0].sigma
    assert rmse(Target("a", curve, 1.0), x * exact) == pytest.approx(curve.stated_noise, rel=0.1)


def test_a_stated_size_tells_of_the_correlation_by_the_normal_density_of_what_the_slopes_cannot_make():
    """The density of contrasts, combinations of the points that no parameter moves, under each correlation (Harville 1974)."""
    rng, slopes, sd = np.random.default_rng(6), np.column_stack([DEPTH, DEPTH**2]), 0.3
    residuals = sd * rng.standard_normal(10)
    known = Correlated.of(slopes, residuals, 0.0, sd**2)
    contrasts = null_space(slopes.T).T
    densities = [
        multivariate_normal.pdf(contrasts @ residuals, cov=sd**2 * contrasts @ correlations(10, rho) @ contrasts.T)
        for rho in possible(10)
    ]
    shares = np.array([STATED_WHITE, *np.full(SLAB, (1 - STATED_WHITE) / SLAB)]) * densities
    assert known.shares == pytest.approx(shares / shares.sum(), rel=1e-9)
    assert known.sizes == pytest.approx(np.ones(1 + SLAB))  # the size is known, whatever the correlation


def slopes_with_errors(noise, sd):
    """(slopes, standard errors, quantiles) of lines y = 2 x through noise (m, n), of curves that state sd."""
    x, rows = np.linspace(0.2, 1, noise.shape[1]), []
    for row in noise:
        slope = float(x @ (2 * x + row) / (x @ x))
        _, known = errors([x[:, None]], [(slope - 2) * x - row], [1.0], [sd])
        rows.append((slope, known.covar[0, 0] ** 0.5))
    return np.array(rows).T


def test_a_stiffness_of_five_points_that_state_5_percent_is_known_to_5_percent():
    """Independent noise: sd^2 / sum(x^2) (Gauss) within 5 % in the median; coverage within the binomial 99 % band."""
    sd, x = 0.2, np.linspace(0.2, 1, 5)
    slope, error = slopes_with_errors(sd * np.random.default_rng(7).standard_normal((300, 5)), sd)
    assert np.median(error) == pytest.approx(sd / np.linalg.norm(x), rel=0.05)
    low, high = binom.interval(0.99, 300, 0.95)
    assert low <= np.count_nonzero(abs(slope - 2) < 1.96 * error) <= high


def test_residuals_that_are_surely_smooth_widen_stated_deviations():
    """40 points under a correlation of 0.8, whose slope has 2.2 times the error of independent ones: intervals say so."""
    noise = 0.2 * np.random.default_rng(8).standard_normal((60, 40)) @ np.linalg.cholesky(correlations(40, 0.8)).T
    slope, error = slopes_with_errors(noise, 0.2)
    assert np.median(error) > 1.7 * 0.2 / np.linalg.norm(np.linspace(0.2, 1, 40))
    assert np.count_nonzero(abs(slope - 2) < 2 * error) >= 50


@pytest.mark.parametrize("uncertain", [{}, {"friction": {"uniform": [0.0, 0.5]}}], ids=["known", "unknown friction"])
def test_a_fit_follows_the_points_that_it_can_trust(tmp_path, uncertain):
    """The deeper half of a curve is 20 % too high, and states 50 times the uncertainty: the fit has the other's modulus. The curve
    is one of the case's own mesh, so that the mesh has no error."""
    write_curve(tmp_path / "parallel.csv", Curve(DEPTH, 10 * DEPTH))
    path = tiny_case(
        tmp_path, fit={"method": "least_squares", "workers": 1, "what_if": False, "uncertain": {**uncertain, "mesh": 0.0}}
    )
    exact = simulate(read_case(path), {"mu": 2.0}, mesh_error=False).curves["parallel"].force
    wrong = np.where(DEPTH > 0.1, 1.2, 1.0) * exact
    sd = np.where(DEPTH > 0.1, 0.5, 0.01) * exact[-1]
    write_curve(tmp_path / "parallel.csv", Curve(DEPTH, wrong, sd=sd))
    case = read_case(path)
    assert case.warnings() == []
    result = fit(case)
    known = result.parameters["mu"]
    assert known.value == pytest.approx(2.0, rel=0.005 if not uncertain else 0.03)
    assert known.interval[0] < 2.0 < known.interval[1]
    assert any("inverse squares of their stated standard deviations" in note for note in result.notes)
    plain = Curve(DEPTH, wrong)
    write_curve(tmp_path / "parallel.csv", plain)
    assert read_case(path).hash != case.hash
    if not uncertain:
        assert fit(read_case(path)).parameters["mu"].value > 2.2


def test_a_fault_in_a_deviation_names_case_and_key(tmp_path):
    path = tiny_case(tmp_path)
    (tmp_path / "parallel.csv").write_text(rows([0] * 10))
    with pytest.raises(CaseError, match=r"test\.parallel\.curve = .*line 2: standard deviation 0 mN must be above zero"):
        read_case(path)
