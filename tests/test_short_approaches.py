"""Records that begin in contact, and look like a short approach under noise where the end of the indenter is not known."""

import numpy as np
import pytest

from indentfit.case import Record
from indentfit.experiment.processed import process_record
from indentfit.experiment.record import RawRecord

pytestmark = pytest.mark.quick

BEGINS = 3e-4  # mm in contact
PEAK = 16 / 3 * 2.0 * np.sqrt(5e-3) * (1e-3 + BEGINS) ** 1.5 * 1e3  # of Hertz's sphere of 5 um, G 2 kPa, mN
SOON = "the approach is too short to tell"


def pressed(seed, travel=0.0, offset=0.0):
    """A sphere's record of 400 samples to 1 um, with 0.5 % noise: from a depth on, or after a travel without contact."""
    stage = np.linspace(0, 1e-3 + travel, 400)
    depth = np.maximum(stage - travel + (0.0 if travel else BEGINS), 0.0)
    force = 16 / 3 * 2.0 * np.sqrt(5e-3) * depth**1.5 * 1e3
    force = force + offset + 0.005 * force.max() * np.random.default_rng(seed).standard_normal(force.size)
    return RawRecord(2e3 * stage, stage, force, "pressed")


@pytest.mark.parametrize("seed", [102, 108, 109])
def test_a_short_approach_that_may_be_none_is_told_and_intervals_hold_both(seed):
    """Contact was put 15 to 19 nm behind the start, by at most 10 nm, and rated good."""
    record = process_record(pressed(seed), settings=Record())
    assert abs(record.contact.displacement + BEGINS) < record.contact.uncertainty < 0.3 * record.depth
    assert abs(record.peak - PEAK) < record.peak_uncertainty
    assert any(note.startswith(SOON) and "count as load" in note for note in record.notes)
    assert record.judgement.rating == "poor"


def test_what_the_force_at_the_start_is_may_be_stated():
    offset, load = (process_record(pressed(102), settings=Record(zero=zero)) for zero in ("approach", "sensor"))
    assert 0 < offset.contact.displacement < 3e-5 and not any(SOON in note for note in offset.notes)
    assert load.contact.method == "extrapolated" and abs(load.contact.displacement + BEGINS) < load.contact.uncertainty
    assert load.peak == pytest.approx(PEAK, rel=5e-3)


@pytest.mark.parametrize("seed", range(8))
def test_an_approach_that_is_seen_tells_an_offset(seed):
    record = process_record(pressed(seed, travel=1e-4, offset=0.1 * PEAK), settings=Record())
    assert abs(record.contact.displacement - 1e-4) < 1.5 * record.contact.uncertainty < 4.5e-5
    assert not any(SOON in note for note in record.notes)
