"""A converter of the displacement with coarse steps: the stage moves on within each of them."""

import numpy as np
import pytest

from indentfit.case import Record
from indentfit.experiment.fine_travel import with_fine_travel
from indentfit.experiment.processed import process_record
from indentfit.experiment.record import RawRecord


def coarse(step, hold=0, seed=0):
    """A sphere pressed 0.15 mm after 0.3 mm of approach, 0.3 um a sample; the displacement in whole steps, mm."""
    place = np.append(-0.3 + 0.0003 * np.arange(1500), np.full(hold, 0.15))
    force = 35.6 * np.maximum(place, 0) ** 1.5
    noise = 0.004 * force.max() * np.random.default_rng(seed).standard_normal(place.size)
    return RawRecord(0.003 * np.arange(place.size), np.round(place / step) * step, force + noise, "drawn"), float(force.max())


@pytest.mark.parametrize("hold", [0, 500])
@pytest.mark.parametrize("step", [0.001, 0.002, 0.005])
def test_coarse_steps_of_the_displacement_are_interpolated_and_said(step, hold):
    """Steps of 5 um are 17 samples: they were taken for pauses, and the peak was 1.7 % too low without a word."""
    record, peak = coarse(step, hold)
    done = process_record(record, settings=Record(indenter="sphere", radius=1.0))
    assert done.peak == pytest.approx(peak, rel=0.01) and not done.ramp.pauses
    assert abs(done.contact.displacement) <= done.contact.uncertainty
    assert any(f"the displacement has steps of {1000 * step:g} um" in note for note in done.notes)


@pytest.mark.parametrize("phase", [0.1, 0.5, 0.9])
def test_between_the_middles_of_its_steps_a_stage_is_where_it_was(phase):
    """Rest, motion at one velocity through whole and cut steps, a hold, and the way back."""
    place = np.concatenate([np.full(200, -0.1), np.linspace(-0.1, 0.1, 1000), np.full(300, 0.1), np.linspace(0.1, -0.08, 900)])
    place += phase * 0.004
    record = RawRecord(0.01 * np.arange(place.size), np.round(place / 0.004) * 0.004, place, "drawn")
    moved = with_fine_travel(record)
    inside = np.r_[20:180, 220:1180, 1220:1480, 1520:2380]
    assert np.max(np.abs(moved.displacement - place)[inside]) < 0.0025
    uniform = np.r_[250:1150, 1550:2400]
    assert np.max(np.abs(moved.displacement - place)[uniform]) < 0.0003


def test_a_fine_displacement_and_one_that_jumps_between_two_numbers_by_noise_stay_as_they_are():
    record, _ = coarse(1e-9, 500)
    assert with_fine_travel(record) is record
    noise = 0.002 * np.random.default_rng(0).standard_normal(record.time.size)
    dithered = RawRecord(record.time, np.round((record.displacement + noise) / 0.002) * 0.002, record.force, "drawn")
    assert with_fine_travel(dithered) is dithered
