"""Records that contradict what contact point and peak assume are told so: no number of them comes without a note."""

import numpy as np
import pytest

from indentfit.case import Record
from indentfit.errors import RecordError
from indentfit.experiment.processed import process_record
from indentfit.experiment.record import RawRecord

GAP, DEPTH, RATE = 0.3, 0.15, 0.1  # mm, mm, mm/s
STIFFNESS = 35.6  # mN/mm^1.5
SPHERE = Record(indenter="sphere", radius=1.0)


def approach(depth=DEPTH, count=1500, hold=0):
    """Time s and position mm, counted from contact."""
    time = np.arange(count + hold) * (GAP + depth) / RATE / count
    return time, np.minimum(-GAP + RATE * time, depth)


def hertz(position):
    return STIFFNESS * np.maximum(position, 0) ** 1.5


def done(time, position, force, settings=SPHERE, noise=0.004):
    noisy = force + noise * force.max() * np.random.default_rng(5).standard_normal(force.size)
    return process_record(RawRecord(time, position + GAP, noisy, "drawn"), settings=settings)


def said(record, words):
    return [note for note in record.notes if words in note]


def test_a_record_that_contradicts_nothing_has_no_note():
    time, position = approach(hold=600)
    assert done(time, position, hertz(position)).notes == ()


def test_a_force_that_comes_late_is_told_where_the_stage_stops():
    """60 samples of 3 ms late: contact and depth are off by 18 um."""
    time, position = approach(hold=600)
    late = np.concatenate([np.zeros(60), hertz(position)[:-60]])
    (note,) = said(done(time, position, late), "goes on rising")
    assert "for 0.1" in note and "after the displacement has stopped" in note and "off by 18 um" in note
    back = np.concatenate([position[:1500], position[:1500][::-1]])
    turned = np.concatenate([np.zeros(60), hertz(back)[:-60]])
    times = np.arange(back.size) * (time[1] - time[0])
    assert not said(done(times, back, hertz(back)), "goes on rising")
    assert said(done(times, back, turned), "goes on rising")


@pytest.mark.parametrize(("jump", "words"), [(0.55, "jumps by -"), (1.3, "jumps by +")])
def test_a_jump_of_the_force_within_the_loading_is_told(jump, words):
    """A membrane that gives way, and a knock at the table."""
    time, position = approach()
    force = np.where(position > 0.08, jump, 1.0) * hertz(position)
    assert said(done(time, position, force), words)


def test_a_single_spike_is_no_jump():
    time, position = approach()
    force = hertz(position)
    force[1200] += 0.5 * force.max()
    assert not said(done(time, position, force), "jumps by")


def test_a_soft_membrane_before_the_tissue_is_told():
    """The contact that is found is that of the stiff tissue, 48 um behind that of the membrane, whose force is 1 % of the peak."""
    time, position = approach(depth=0.3)
    force = 5 * np.maximum(position, 0) ** 1.5 + 60 * np.maximum(position - 0.15, 0) ** 1.5
    record = done(time, position, force)
    assert record.contact.displacement - record.contact.uncertainty > GAP
    assert said(record, "a first, softer contact may lie more than")
    assert record.judgement.rating == "fair" and "assumptions are contradicted" in str(record.judgement)


def test_a_sensor_that_reads_no_negative_force_is_told():
    time, position = approach()
    force = np.maximum(hertz(position) + 0.02 * STIFFNESS * 0.058 * np.random.default_rng(1).standard_normal(time.size), 0)
    (note,) = said(done(time, position, force, noise=0.0), "read exactly 0 mN")
    assert 40 < float(note.split("%")[0]) < 60


def test_coarse_steps_of_a_converter_are_no_end_of_its_range():
    time, position = approach()
    step = 0.01 * hertz(position).max()
    force = np.round((hertz(position) + 0.5 * step * np.random.default_rng(1).standard_normal(time.size)) / step) * step
    assert not said(done(time, position, force, noise=0.0), "read exactly")


def test_samples_that_are_missing_about_contact_widen_its_interval():
    """60 um without samples: contact was found 9 um before the truth, +- 4 um."""
    time, position = approach()
    there = np.abs(position) > 0.03
    record = done(time[there], position[there], hertz(position)[there])
    assert abs(record.contact.displacement - GAP) <= record.contact.uncertainty < 0.06
    assert said(record, "samples are missing about contact, over 0.0603 mm")


def test_a_depth_of_many_radii_is_told():
    time, position = approach()
    record = done(time, position, hertz(position), Record(indenter="sphere", radius=0.1))
    assert said(record, "the indentation is 1.5 radii of the sphere deep")


def test_a_stage_that_is_far_faster_at_contact_is_refused_with_its_cause():
    position = np.concatenate([np.linspace(-1, 0.07, 150), np.linspace(0.07, 0.15, 1500)[1:]])
    with pytest.raises(RecordError, match="samples are missing or wrong, or the stage is far faster there"):
        done(np.arange(position.size) * 0.002, position, hertz(position))
