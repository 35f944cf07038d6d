"""The record files of ../shared/records, where they are present: what is right for each is said in their README.md."""

from pathlib import Path

import numpy as np
import pytest

from indentfit.case import Record, RecordChannel
from indentfit.errors import RecordError
from indentfit.experiment.process import process

RECORDS = Path(__file__).parents[2] / "shared" / "records"
pytestmark = pytest.mark.skipif(not RECORDS.is_dir(), reason="../shared/records is not here")
SPHERE = Record(indenter="sphere", radius=0.5)


def processed(name, settings=None):
    (outcome,) = process(RECORDS / name, settings=settings).outcomes
    return outcome.processed


def test_chiaro_without_a_table():
    """The program of the instrument states E[eff] = 156.0 Pa; the piezo alone gives 114 to 125 Pa."""
    record = processed("chiaro.txt")
    assert record.hertz.modulus == pytest.approx(0.156, rel=0.03)
    assert "minus 'Cantilever (nm)'" in record.record.taken and record.record.stated.stiffness == pytest.approx(0.019)
    # the tip less the bending is slower near the turn: a filter for a stage that slows down rounded its sharp peak by 7 %
    middle = np.sort(np.lib.stride_tricks.sliding_window_view(record.record.force, 5), axis=1)[:, 2]
    assert record.peak == pytest.approx(middle.max() - record.contact.baseline, rel=0.02)


def test_bluehill_preloaded_without_a_table():
    record = processed("bluehill_preloaded.csv")
    assert record.peak == pytest.approx(19965, rel=0.01) and record.contact.baseline == 0
    assert record.contact.displacement < 0.05 + record.contact.uncertainty
    assert any("no approach" in note for note in record.notes)


@pytest.mark.parametrize("settings", [None, SPHERE])
def test_bioindenter_begins_in_contact(settings):
    """Contact at the first sample; E 755.6 kPa with nu = 0.3."""
    record = processed("bioindenter_layout.TXT", settings)
    assert abs(record.contact.displacement) <= max(record.contact.uncertainty, 1e-6)
    assert record.peak == pytest.approx(1.0, rel=0.01)
    if settings:
        assert record.hertz.modulus * (1 - 0.3**2) == pytest.approx(755.6, rel=0.03)


@pytest.mark.parametrize("settings", [None, SPHERE])
def test_a_record_that_begins_at_a_trigger_force_has_its_contact_before_the_first_sample(settings):
    """Contact 1.01 um before the first sample, by Hertz from 25 uN: 1.0066 um."""
    record = processed("trigger_start.csv", settings)
    assert abs(record.contact.displacement + 0.0010066) <= record.contact.uncertainty
    assert record.contact.baseline == 0 and any("no approach" in note for note in record.notes)
    if settings:
        assert record.hertz.modulus * (1 - 0.3**2) == pytest.approx(755.6, rel=0.03)


def test_staged_steps_with_the_length_of_a_step():
    """Contact lies in stage 0, where the force leaves zero, and not inside the preload of 8 N (rows 1 to 1027)."""
    settings = Record(displacement=RecordChannel(gain=0.00125, unit="mm"))
    record = processed("staged_steps.csv", settings)
    force = record.record.force
    begins = record.ramp.displacement[record.contact.index]
    assert record.contact.index < 1027 and force[record.contact.index] < 0.15 * 8000
    assert begins == pytest.approx(record.contact.displacement, abs=0.01)
    assert record.peak == pytest.approx(force[:4376].max(), rel=0.01)
    with pytest.raises(RecordError, match=r"in steps; give record\.displacement\.gain"):
        process(RECORDS / "staged_steps.csv")


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("hysitron_eoh.txt", r"the header tells of 2995 points, and 55 rows follow: the file is cut off"),
        ("afm_tab.tab", r"the header tells of 4028 points, and 375 rows follow: the file is cut off"),
        ("mach1_blocks.txt", r"a table of 8 rows \(Stress Relaxation\) was left out, and the other tables, Find Contact"),
    ],
)
def test_files_that_are_cut_off_before_contact_say_so(name, words):
    """Their channels are read (the second test), and no contact is invented."""
    with pytest.raises(RecordError, match=words):
        process(RECORDS / name)
