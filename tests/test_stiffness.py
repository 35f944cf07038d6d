"""What a loading curve amounts to: lines, parabolas, forces at strains, curves of a few points; and relaxation."""

import numpy as np
import pytest
from scipy import stats
from scipy.signal import lfilter

from indentfit.case import Record
from indentfit.curve import Curve, read_curve, write_curve
from indentfit.experiment.processed import process_record
from indentfit.experiment.relaxation import fit_prony
from indentfit.experiment.rig import Rig, SensorNoise
from indentfit.experiment.stiffness import linear_fit, quadratic_fit, resampled

STILL = SensorNoise(force=1e-4, displacement=1e-6, vibration=(0, 0), resolution=(0, 0))


def test_a_line_through_white_noise_is_that_of_textbooks():
    """Against scipy's ordinary regression; the standard error within the scatter of an estimate."""
    rng = np.random.default_rng(0)
    x = np.linspace(0, 0.4, 4000)
    y = 60 * x - 1.5 + 0.3 * rng.standard_normal(x.size)
    line, textbook = linear_fit(x, y), stats.linregress(x, y)
    assert line.slope == pytest.approx(textbook.slope, rel=1e-10)
    assert line.intercept == pytest.approx(textbook.intercept, rel=1e-8)
    assert line.r_squared == pytest.approx(textbook.rvalue**2, rel=1e-10)
    assert line.stderr == pytest.approx(textbook.stderr, rel=0.15)


def test_the_standard_error_of_a_slope_is_its_scatter_where_noise_is_correlated():
    """300 ramps with noise of AR(1), 0.9: the textbook's error is four times too small, ours within a quarter."""
    rng = np.random.default_rng(1)
    x = np.linspace(0, 0.4, 500)
    noise = lfilter([1], [1, -0.9], rng.standard_normal((300, 700)), axis=1)[:, 200:]
    lines = [linear_fit(x, 60 * x + added) for added in noise]
    scatter = np.std([line.slope for line in lines])
    assert np.mean([line.stderr for line in lines]) == pytest.approx(scatter, rel=0.25)
    assert stats.linregress(x, 60 * x + noise[0]).stderr < 0.4 * scatter


def test_a_parabola_through_contact_is_found_exactly():
    x = np.linspace(0, 0.33, 200)
    parabola = quadratic_fit(x, 127 * x**2 + 172 * x)
    assert (parabola.curvature, parabola.slope) == pytest.approx((127, 172), rel=1e-9)
    assert parabola.r_squared == pytest.approx(1, abs=1e-12)


def test_a_curve_of_a_few_points_is_the_record_s_and_reads_back(tmp_path):
    """25 equal steps to the end, rising, on the true curve though the displacements are noisy, and ready for a case."""
    rng = np.random.default_rng(2)
    true = np.linspace(0, 0.33, 3000)
    curve = resampled(true + 0.002 * rng.standard_normal(true.size), 172 * true + 127 * true**2, 25)
    d = curve.displacement
    np.testing.assert_allclose(d, d[-1] * np.arange(1, 26) / 25, rtol=1e-12)
    assert d[-1] == pytest.approx(0.33, abs=0.003)
    np.testing.assert_allclose(curve.force, 172 * d + 127 * d**2, atol=0.5)  # 0.002 mm of noise is 0.35 to 0.5 mN
    write_curve(tmp_path / "curve.csv", curve)
    assert np.array_equal(read_curve(tmp_path / "curve.csv").force, curve.force)


def test_forces_at_strains_are_those_of_the_sample():
    d = np.linspace(0, 0.33, 60)[1:]
    record, _ = Rig(noise=STILL).run(Curve(d, (172 + 127 * d) * d), np.random.default_rng(0))
    done = process_record(record, thickness=3.3, settings=Record(strains=(0.02, 0.05, 0.2)))
    assert set(done.forces) == {0.02, 0.05}  # 20 % was not reached
    for strain, force in done.forces.items():
        x = strain * 3.3
        assert force == pytest.approx((172 + 127 * x) * x, rel=0.02)
    assert done.strain_rate == pytest.approx(1 / 3.3, rel=0.01)


def test_a_prony_series_is_found_again_behind_a_ramp():
    """The rig's convolution (a recursion in time) against the fit's closed form: shares and times within 2 %, F0 within 1 %."""
    d = np.linspace(0, 0.4, 60)[1:]
    rig = Rig(hold=100.0, noise=STILL)
    record, _ = rig.run(Curve(d, 60 * d), np.random.default_rng(0), relaxation=((0.06, 1.5), (0.1, 25.0)))
    series = process_record(record).relaxation
    assert series.shares == pytest.approx((0.06, 0.1), rel=0.02)
    assert series.times == pytest.approx((1.5, 25.0), rel=0.02)
    assert series.ratio == pytest.approx(0.84, abs=0.001)
    assert series.instantaneous == pytest.approx(24.0, rel=0.01)


def test_the_errors_of_a_prony_series_are_its_scatter():
    """25 holds with white noise: the ratio's stated error within a factor of 1.6 of its scatter, the mean within its own error."""
    rng = np.random.default_rng(3)
    t = np.arange(1, 30_000) / 1000
    force = 20 * (1 - 0.1 * (1 - np.exp(-t / 4) * 4 * (1 - np.exp(-0.25))))
    fits = [fit_prony(t, force + 0.3 * rng.standard_normal(t.size), 1.0, 1) for _ in range(25)]
    ratios = np.array([fit.ratio for fit in fits])
    assert abs(ratios.mean() - 0.9) < 3 * ratios.std() / np.sqrt(25)
    assert 1 / 1.6 < np.mean([fit.ratio_stderr for fit in fits]) / ratios.std() < 1.6


def test_the_number_of_terms_is_told_by_the_criterion_or_asked_for():
    t = np.arange(1, 60_000) / 1000
    ramp = 0.5

    def hold(*terms):
        return 20 * (1 - sum(g * (1 - tau / ramp * (1 - np.exp(-ramp / tau)) * np.exp(-t / tau)) for g, tau in terms))

    noise = 0.02 * np.random.default_rng(4).standard_normal(t.size)
    assert len(fit_prony(t, hold((0.1, 5.0)) + noise, ramp, "auto").times) == 1
    assert len(fit_prony(t, hold((0.05, 1.0), (0.1, 12.0)) + noise, ramp, "auto").times) == 2
    assert len(fit_prony(t, hold((0.1, 5.0)) + noise, ramp, 3).times) == 3
    with pytest.raises(ValueError, match="too short"):
        fit_prony(t[:300], noise[:300], ramp)
