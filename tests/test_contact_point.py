"""Contact points on simulated records whose truth is known: the study of tests/campaigns/contact_point.py in short."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter, savgol_filter
from scipy.stats import binom

from indentfit.case import Record
from indentfit.errors import RecordError
from indentfit.experiment.baselines import HiddenDrift
from indentfit.experiment.contact_point import METHODS, find_contact_point
from indentfit.experiment.loading import constant_velocity, filtered, find_ramp
from indentfit.experiment.noise import covariance, noise_in
from indentfit.experiment.processed import process_record
from indentfit.experiment.record import RawRecord
from indentfit.experiment.rig import Rig, SensorNoise

_spec = importlib.util.spec_from_file_location("contact_point", Path(__file__).parent / "campaigns" / "contact_point.py")
study = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(study)


@pytest.mark.campaign
def test_contact_is_found_within_micrometres_at_the_noise_of_the_phantoms_and_its_uncertainty_is_honest():
    error, stated = 1e3 * study.trials(study.sample_curve("gelatin"), Rig(), "piecewise", 500).T
    assert np.median(np.abs(error)) < 5
    assert np.quantile(np.abs(error), 0.95) < 20
    assert 0.925 <= np.mean(np.abs(error) <= stated) <= 0.975  # 99 % of binomial draws about 95 %


@pytest.mark.parametrize("kind", study.RIGS)
def test_the_default_method_is_the_best_or_as_good_in_every_trouble(kind):
    """The evidence for the default: its 95 % quantile is below 20 um, and at most 2 um above another method's."""
    wide = {}
    for method in METHODS:
        error, _ = 1e3 * study.trials(study.sample_curve("along"), study.RIGS[kind], method, 12, seed=1).T
        wide[method] = np.quantile(np.abs(error), 0.95)
    assert wide["piecewise"] < 20
    assert wide["piecewise"] < min(wide["threshold"], wide["variance_ratio"]) + 2


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("sample", study.SAMPLES)
def test_without_noise_every_method_finds_contact_within_its_reach(method, sample):
    """Within the filter's blur (a tenth of the ramp's depth) for the rules, within 2 um for the fit."""
    still = Rig(approach_velocity=0.5, noise=SensorNoise(force=1e-4, displacement=1e-6, vibration=(0, 0), resolution=(0, 0)))
    ((error, _),) = study.trials(study.sample_curve(sample), still, method, 1)
    assert abs(error) < (0.002 if method == "piecewise" else 0.1 * study.SAMPLES[sample][2])


def test_under_a_sphere_the_force_rises_by_hertz():
    """40 records: the exponents of Hertz find contact within 5 um (median), those of a flat punch are 10 to 30 um off."""
    sphere = study.trials(study.sample_curve("sphere"), Rig(), "piecewise", 40, indenter="sphere")
    error, stated = 1e3 * sphere.T
    assert np.median(np.abs(error)) < 5
    assert np.mean(np.abs(error) <= stated) > 0.8
    flat = study.trials(study.sample_curve("sphere"), Rig(), "piecewise", 10)
    assert 0.010 < np.median(np.abs(flat[:, 0])) < 0.030


def test_contact_does_not_depend_on_the_zeros_of_the_sensors():
    record, truth = Rig().run(study.sample_curve("along"), np.random.default_rng(3))
    moved = RawRecord(record.time, record.displacement - 17.0, record.force + 250.0)
    here, there = find_contact_point(find_ramp(record)), find_contact_point(find_ramp(moved))
    assert there.displacement + 17.0 == pytest.approx(here.displacement, abs=1e-5)
    assert there.uncertainty == pytest.approx(here.uncertainty, rel=1e-3)
    assert here.displacement == pytest.approx(truth, abs=0.01)


def test_drift_of_the_load_cell_is_told_from_contact():
    """2 mN/s over a baseline of 2 s: twice the force at which contact would be guessed from a constant baseline."""
    record, truth = Rig(rest=2.0, noise=SensorNoise(drift=2.0)).run(study.sample_curve("along"), np.random.default_rng(5))
    contact = find_contact_point(find_ramp(record))
    assert contact.displacement == pytest.approx(truth, abs=0.01)
    assert contact.drift == pytest.approx(2.0, abs=0.3)


def test_the_window_is_where_the_stage_moves_at_one_velocity():
    """A stage that starts and stops over a tenth of the ramp: the window lies between, and its velocity is the stage's."""
    rate, velocity = 1000.0, 0.7
    time = np.arange(3000) / rate
    speed = velocity * np.interp(time, [0.5, 0.55, 1.05, 1.1], [0, 1, 1, 0])
    displacement = np.cumsum(speed) / rate
    force = 60 * np.maximum(displacement - 0.05, 0)
    noise = np.random.default_rng(0).standard_normal((2, time.size))
    ramp = find_ramp(RawRecord(time, displacement + 0.002 * noise[0], force + 0.02 * noise[1]))
    contact = find_contact_point(ramp)
    window, steady = constant_velocity(ramp, contact.index)
    assert steady == pytest.approx(velocity, rel=0.02)
    assert time[window.start] > 0.5
    assert time[window.stop] < 1.1
    assert time[window.stop] - time[window.start] > 0.35
    assert time[ramp.stop] == pytest.approx(1.09, abs=0.02)


def test_a_slow_approach_is_not_part_of_the_window():
    record, truth = Rig(approach_velocity=0.1, velocity=1.0).run(study.sample_curve("along"), np.random.default_rng(1))
    ramp = find_ramp(record)
    window, velocity = constant_velocity(ramp, find_contact_point(ramp).index)
    assert velocity == pytest.approx(1.0, rel=0.03)
    assert record.displacement[window.start] > truth


def test_the_filter_is_without_shift_in_time():
    """A straight ramp stays where it is."""
    record, _ = Rig(noise=SensorNoise(vibration=(0, 0))).run(study.sample_curve("gelatin"), np.random.default_rng(2))
    ramp = find_ramp(record)
    inside = slice(ramp.low, ramp.high)
    assert np.mean(ramp.displacement[inside] - record.displacement[inside]) == pytest.approx(0, abs=5e-4)
    assert ramp.length * record.interval < 0.15 * ramp.duration


@pytest.mark.parametrize("after", ["unloading", "nothing"])
def test_loading_ends_where_the_stage_turns_or_the_record_stops(after):
    record, truth = Rig(hold=0.0).run(study.sample_curve("along"), np.random.default_rng(4))
    channels = [record.displacement, record.force]
    if after == "unloading":
        channels = [np.concatenate([channel, channel[::-1]]) for channel in channels]
    done = process_record(RawRecord(np.arange(channels[0].size) / 1000, *channels))
    assert done.relaxation is None
    assert done.contact.displacement == pytest.approx(truth, abs=0.01)
    assert done.depth == pytest.approx(0.33, abs=0.01)
    assert abs(done.ramp.stop - record.time.size) < 0.03 * done.ramp.samples


def test_a_record_of_drift_alone_has_no_contact_point():
    time = np.arange(3000) / 1000
    noise = np.random.default_rng(0).standard_normal((2, time.size))
    record = RawRecord(time, 0.3 * time + 0.002 * noise[0], 2 * time + 0.02 * noise[1], name="drift.csv")
    with pytest.raises(RecordError, match=r"drift\.csv: no contact point"):
        find_contact_point(find_ramp(record))


@pytest.mark.parametrize(("samples", "length"), [(5, 7), (20, 33), (501, 41)])
def test_the_filter_is_that_of_savitzky_and_golay(samples, length):
    values = np.random.default_rng(5).standard_normal(samples).cumsum() + 3
    expected = savgol_filter(values, min(length, samples - 1 + samples % 2), 2)
    np.testing.assert_allclose(filtered(values, length), expected, rtol=0, atol=1e-11)


def retracted(rng, samples=400, noise=0.01):
    """A punch that is pressed in by 1 mm and drawn out at once: 1 mN/mm, contact at 0 mm."""
    time = np.arange(4 * samples) / samples
    travel = 1 - np.abs(time - 2)
    return RawRecord(time, travel, np.maximum(travel, 0) + noise * rng.standard_normal(time.size), "retracted.csv")


def test_a_stage_that_turns_at_once_loses_nothing_of_its_peak():
    """A filter of the travel rounds the corner: records lost 0.2 to 0.36 % of their peaks, which noise hides in each."""
    rng = np.random.default_rng(6)
    off = [process_record(retracted(rng), settings=Record(indenter="flat")).peak - 1 for _ in range(25)]
    assert abs(np.mean(off)) < 0.0016  # three standard errors of the mean at 0.27 % of scatter


def test_a_hidden_drift_and_noise_exceed_a_size_as_often_as_draws_do():
    """A drift of 0.4 +- 0.2 mN with probability 0.3, one of -1 +- 0.5 mN with 0.1, and an error of 0.3 mN, in 400,000 draws."""
    hidden, rng = HiddenDrift(((0.3, 0.4, 0.2), (0.1, -1.0, 0.5))), np.random.default_rng(0)
    kind = rng.choice(3, 400_000, p=(0.6, 0.3, 0.1))
    drawn = np.array([0.0, 0.4, -1.0])[kind] + np.array([0.0, 0.2, 0.5])[kind] * rng.standard_normal(kind.size)
    whole = np.abs(drawn + 0.3 * rng.standard_normal(kind.size))
    for size in (0.2, 0.5, 1.0, 1.5):
        assert hidden.beyond(size, 0.3) == pytest.approx(np.mean(whole > size), abs=0.002)
    assert hidden.largest(0.05, 0.3) == pytest.approx(np.quantile(whole, 0.95), abs=0.03)


def test_a_value_that_no_residual_depends_on_is_unknown():
    jacobian = np.column_stack([np.ones(100), np.zeros(100)])
    spread = covariance(jacobian, noise_in(np.random.default_rng(0).standard_normal(100)))
    assert spread[0, 0] == pytest.approx(0.01, rel=0.4) and spread[1, 1] == np.inf and spread[0, 1] == 0


def test_samples_far_apart_before_contact_are_no_slow_noise():
    """A tenth of the samples before contact: its interval is that of the samples, not of values interpolated between them."""
    rng, widths, held = np.random.default_rng(7), [], 0
    for _ in range(25):
        record = retracted(rng)
        kept = (np.arange(record.time.size) % 10 == 0) | (record.displacement > 0)
        thinned = RawRecord(*(getattr(record, name)[kept] for name in ("time", "displacement", "force")))
        contact = process_record(thinned, settings=Record(indenter="flat", segment="approach")).contact
        widths.append(contact.uncertainty)
        held += abs(contact.displacement) <= contact.uncertainty
    assert np.median(widths) < 0.0075  # 0.0065 without the laws of more powers; interpolated values gave 0.0087 then
    assert held >= 21  # 99 % of binomial draws at 95 %


def test_a_sharp_cone_on_a_sample_that_stiffens_or_relaxes_has_its_contact_within_the_interval():
    """Forces d^2 exp(d) and d^2 (1 + exp(-d / 0.15)), neither of which is fitted: half of such contacts were outside, by up to
    three half-widths, while the laws began with the power 1.5 of the ball at a cone's end. A 95 % interval holds 17 of 20 and more
    in 98 of 100 draws."""
    rng, held, wide = np.random.default_rng(41), 0, 0
    for law in (lambda d: d**2 * np.exp(d), lambda d: d**2 * (1 + np.exp(-d / 0.15))) * 10:
        d = np.linspace(-1.0, 1.0, 600)
        force = law(np.maximum(d, 0)) / law(1.0) + 0.005 * rng.standard_normal(d.size)
        contact = process_record(RawRecord(np.arange(d.size) / 100, d, force, "r"), settings=Record(indenter="cone")).contact
        held += abs(contact.displacement) <= contact.uncertainty
        wide += contact.uncertainty > 0.1
    assert held >= 17 and not wide


def test_the_interval_of_a_peak_holds_drifts_that_noise_hides():
    """A drift of half a per cent of the peak, either way, under 0.8 % of noise and an approach of half of the depth."""
    rng, held, widths = np.random.default_rng(43), 0, []
    for sign in (-1, 1) * 8:
        d = np.linspace(-0.5, 1.0, 600)
        force = np.maximum(d, 0) ** 1.5 + 0.005 * sign * d + 0.008 * rng.standard_normal(d.size)
        record = process_record(RawRecord(np.arange(d.size) / 100, d, force, "r"), settings=Record(indenter="sphere"))
        held += abs(record.peak - 1) <= record.peak_uncertainty
        widths.append(record.peak_uncertainty)
    assert held >= 14 and np.median(widths) < 0.02


@pytest.mark.parametrize(("noise", "seed"), [(0.02, 1), (0.05, 0)])
def test_a_contact_point_is_warned_of_where_its_interval_makes_a_record_poor(noise, seed):
    """Every record's rating says the interval; one of 15 quiet records had a warning of 5 to 10 % of the depth beside it."""
    t, rng = np.arange(600) * 0.01, np.random.default_rng(seed)
    force = 100 * np.maximum((t - 3) / 3, 0) ** 2 + 100 * noise * rng.standard_normal(t.size)
    done = process_record(RawRecord(t, t - 3, force, "cone"), settings=Record(indenter="cone"))
    share = done.contact.uncertainty / done.depth
    assert f"contact within {share:.1%} of the depth" in str(done.judgement)
    assert (share > 0.05) and done.judgement.rating == ("poor" if share > 0.1 else "fair") == ("fair" if noise == 0.02 else "poor")
    assert any("contact point is uncertain" in note for note in done.notes) == (share > 0.1)


def test_slow_noise_that_hides_how_a_sample_stiffens_puts_contact_in_doubt():
    """Sixteen records under a cone of a sample that stiffens as exp(2 x): the interval of 95 % held 7 of 16 contacts."""
    t, pole = np.arange(800) / 400, np.exp(-1 / 40)
    force = np.maximum(t - 1, 0) ** 2 * np.exp(2 * (t - 2))
    held = []
    for seed in range(100, 116):
        rng = np.random.default_rng(seed)
        slow = lfilter([1.0], [1.0, -pole], rng.standard_normal(t.size + 500))[500:] * np.sqrt(1 - pole**2)
        noisy = force + 3e-3 * slow + 1e-3 * rng.standard_normal(t.size)
        try:
            done = process_record(RawRecord(t, t - 1, 100 * noisy, "stiff"), settings=Record(indenter="cone"))
        except RecordError:
            continue  # too uncertain
        held.append(abs(done.contact.displacement) <= done.contact.uncertainty)
    assert len(held) >= 13 and sum(held) >= binom.ppf(0.005, len(held), 0.95)
