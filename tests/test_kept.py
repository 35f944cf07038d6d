"""Curves of raw records that are kept between commands: never an answer for a record, setting, preset or code that has changed."""

import json

import numpy as np
import pytest
from fixtures.cases import CASES

from indentfit.case import Record
from indentfit.curve import Curve
from indentfit.errors import RecordError
from indentfit.experiment import kept
from indentfit.experiment.kept import kept_curve
from indentfit.experiment.measured import read_case
from indentfit.experiment.processed import process_record
from indentfit.experiment.reading import read_record

CURVE = Curve([0.1, 1 / 3, 0.5], [0.0, np.pi, 1e-300], ("a note",), 1 / 7, [0.1, 0.2, 1 / 3])


@pytest.fixture
def bench(tmp_path, monkeypatch):
    """A record in a folder, a small package as the code, and a process that counts its calls."""
    monkeypatch.setenv("INDENTFIT_CACHE", str(tmp_path / "cache"))
    (tmp_path / "code" / "room").mkdir(parents=True)
    (tmp_path / "code" / "room" / "module.py").write_text("A = 1\n")
    monkeypatch.setattr(kept, "HOME", tmp_path / "code")
    (tmp_path / "records").mkdir()
    (tmp_path / "records" / "r.csv").write_text("1,2\n")
    return Bench(tmp_path)


class Bench:
    def __init__(self, folder):
        self.folder, self.record, self.calls = folder, folder / "records" / "r.csv", 0

    def process(self):
        self.calls += 1
        return CURVE

    def runs(self, settings=None):
        """Whether the record is processed, not answered from what is kept."""
        before = self.calls
        curve = kept_curve(self.record, settings or Record(rate=10.0), self.process)
        assert np.array_equal(curve.displacement, CURVE.displacement) and np.array_equal(curve.force, CURVE.force)
        assert (curve.notes, curve.contact) == (CURVE.notes, CURVE.contact) and np.array_equal(curve.sd, CURVE.sd)
        return self.calls > before

    def files(self):
        return list((self.folder / "cache" / "curves").glob("*"))


def test_a_record_is_processed_once_and_its_curve_is_kept_bit_by_bit(bench):
    assert bench.runs() and not bench.runs()
    assert len(bench.files()) == 1


@pytest.mark.parametrize(
    "change",
    [
        lambda bench: bench.record.write_text("1,3\n"),
        lambda bench: (bench.record.parent / "lab.preset.toml").write_text('name = "lab"'),
        lambda bench: (bench.folder / "code" / "room" / "module.py").write_text("A = 2\n"),
        lambda bench: (bench.folder / "code" / "another.py").write_text(""),
        lambda bench: (bench.folder / "code" / "room" / "module.py").rename(bench.folder / "code" / "module.py"),
    ],
    ids=["record", "preset", "code", "new module", "moved module"],
)
def test_a_change_of_what_the_curve_follows_from_processes_the_record_again(bench, change):
    assert bench.runs()
    change(bench)
    assert bench.runs() and not bench.runs()


def test_each_setting_has_its_own_curve_also_one_that_is_set_to_its_default(bench):
    """A preset of the instrument gives the keys that are not set."""
    default = Record().points
    channel = {"column": "a", "gain": 1.0}
    settings = [
        Record(rate=10.0), Record(rate=11.0), Record(rate=10.0, points=default), Record(rate=10.0, preset="own.toml"),
        Record(rate=10.0, force=channel), Record(rate=10.0, force={**channel, "unit": "mN"}),
    ]  # fmt: skip
    (bench.record.parent / "own.toml").write_text("a")
    assert all(bench.runs(each) for each in settings)
    assert not any(bench.runs(each) for each in settings)
    (bench.record.parent / "own.toml").write_text("b")
    assert bench.runs(settings[3])


def test_another_version_of_a_library_processes_the_record_again(bench, monkeypatch):
    assert bench.runs()
    monkeypatch.setattr(kept, "version", lambda name: "0.0.1")
    assert bench.runs()


def test_presets_that_code_of_others_makes_keep_nothing(bench, monkeypatch):
    monkeypatch.setattr(kept, "entry_points", lambda group: ["another package's"])
    assert bench.runs() and bench.runs()


@pytest.mark.parametrize(
    "spoil", [lambda text: text[:20], lambda text: text.replace("0.5", "0.6"), lambda text: "[]", lambda text: ""]
)
def test_a_damaged_curve_is_no_answer(bench, spoil):
    assert bench.runs()
    (file,) = bench.files()
    file.write_text(spoil(file.read_text()))
    assert bench.runs() and not bench.runs()


def test_a_record_that_changes_while_it_is_processed_is_not_kept(bench):
    def process():
        bench.record.write_text("later\n")
        return CURVE

    kept_curve(bench.record, Record(), process)
    assert not bench.files()


def test_a_record_that_cannot_be_used_is_refused_each_time(bench):
    def process():
        raise RecordError("no record")

    for _ in range(2):
        with pytest.raises(RecordError):
            kept_curve(bench.record, Record(), process)
    assert not bench.files()


@pytest.mark.parametrize("folder", ["", "/dev/null/nowhere"])
def test_without_a_folder_nothing_is_kept_and_nothing_is_said(bench, monkeypatch, folder):
    monkeypatch.setenv("INDENTFIT_CACHE", folder)
    assert bench.runs() and bench.runs()


def test_the_oldest_curves_go_where_there_are_too_many(bench, monkeypatch):
    monkeypatch.setattr(kept, "MOST", 2)
    for rate in (1.0, 2.0, 3.0):
        bench.runs(Record(rate=rate))
    assert len(bench.files()) == 2


def test_the_kept_curve_of_a_case_is_that_of_its_record():
    case = read_case(CASES / "rig_records" / "case.toml")
    again = read_case(case.path)
    for test, curve in zip(again.tests, again.curves, strict=True):
        settings = case.record.model_copy(update={"indenter": "flat"})
        fresh = process_record(read_record(case.folder / test.record, settings), settings=settings).curve
        assert json.dumps(fresh.force.tolist()) == json.dumps(curve.force.tolist())
        assert json.dumps(fresh.displacement.tolist()) == json.dumps(curve.displacement.tolist())
