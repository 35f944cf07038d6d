"""A stage that slows down before it stops: what relaxes resists less there, and contact does not move by it."""

import numpy as np
import pytest
from campaigns.records import soft_turn

from indentfit.case import Record
from indentfit.experiment.contact import locate_contact
from indentfit.experiment.contact_point import fitted_approach
from indentfit.experiment.loading import find_ramp, steady_end
from indentfit.experiment.piecewise import stretch_of
from indentfit.experiment.processed import process_record
from indentfit.experiment.record import RawRecord

N = 1200
GAP, DEPTH = 0.8, 1.0


def turned(slows, seed=0, relaxes=0.4, age=0.05):
    """A relaxing cone's record: the stage slows down evenly over `slows` of the ramp and then stops; F = k int G(t - s) d(d^2)."""
    begin = GAP + DEPTH - 0.5 * slows
    time = np.arange(0, begin + slows + 0.6, 1 / N)
    speed = np.interp(time, [0, begin, begin + slows, begin + slows + 9], [1, 1, 0, 0])
    place = np.concatenate([[0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(time))]) - GAP
    elastic = np.maximum(place, 0) ** 2
    excess = np.zeros(time.size)
    for n in range(1, time.size):
        excess[n] = np.exp(-1 / N / age) * excess[n - 1] + relaxes * (elastic[n] - elastic[n - 1])
    force = (1 - relaxes) * elastic + excess
    return RawRecord(time, place, force + 0.003 * np.random.default_rng(seed).standard_normal(time.size), "drawn")


@pytest.mark.parametrize("slows", [0.1, 0.3])
def test_the_fitted_stretch_ends_where_the_stage_slows_down(slows):
    """At 85 % of the velocity: 0.15 of the time that the stage slows down, after it begins to."""
    ramp = find_ramp(turned(slows))
    begin = GAP + DEPTH - 0.5 * slows
    assert ramp.record.time[steady_end(ramp)] == pytest.approx(begin + 0.15 * slows, abs=0.03)
    assert stretch_of(ramp).time[-1] < begin + 0.3 * slows


def test_a_stage_that_stops_at_once_loses_nothing():
    ramp = find_ramp(turned(0.002))
    assert steady_end(ramp) == ramp.stop


def test_a_stage_that_slows_down_does_not_move_contact():
    """Eight records of the campaign of seed 10010 that slow down through 2 to 30 % of the ramp: none of their intervals held the
    truth while the slow end was fitted too, where relaxed forces bend the curve."""
    held = 0
    for number in (12, 27, 33, 102, 142, 145, 174, 193):
        record = soft_turn(np.random.default_rng([10010, number]))
        contact = process_record(record.raw(), settings=Record(**record.settings)).contact
        held += abs(contact.displacement - record.truth.contact) <= contact.uncertainty
    assert held >= 7


@pytest.mark.parametrize("after", ["hold", "retraction"])
@pytest.mark.parametrize("share", [0.0, 0.4])
def test_contact_of_a_sample_that_gives_way_is_as_far_in_doubt_as_it_moves_with_the_depth(after, share):
    """A share of the force relaxes in a tenth of the loading. Its force then follows no law of powers, and of 132 such records the
    intervals left out 15 contact points. An elastic sample of the same noise keeps its interval."""
    time = np.arange(2600) / 1000
    place = np.interp(time, [0, 0.6, 1.6, 2.6], [-0.6, 0, 1, 1 if after == "hold" else 0])
    elastic, excess = np.maximum(place, 0) ** 2, np.zeros(time.size)
    for n in range(1, time.size):
        excess[n] = np.exp(-0.01) * excess[n - 1] + elastic[n] - elastic[n - 1]
    force = (1 - share) * elastic + share * excess + 0.003 * np.random.default_rng(4).standard_normal(time.size)
    ramp = find_ramp(RawRecord(time, place, force, "gives way"))
    approach, contact = fitted_approach(ramp, "cone"), locate_contact(ramp, Record(indenter="cone")).contact
    alone, shorter = approach.point("piecewise").uncertainty, approach.doubt.shorter
    assert shorter > 0.03 * alone
    assert contact.uncertainty == pytest.approx(np.hypot(alone, shorter) if share else alone, rel=1e-9)
