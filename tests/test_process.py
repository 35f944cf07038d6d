"""`process` from Python: records in memory or in files, a live result, and the folder that it writes."""

import json
from pathlib import Path
from types import SimpleNamespace

import matplotlib.figure
import numpy as np
import pytest
from scipy.signal import lfilter

import indentfit
from indentfit.case import Record
from indentfit.curve import Curve, read_curve
from indentfit.errors import OutputError, RecordError
from indentfit.experiment.file_case import FileCase
from indentfit.experiment.judgement import Judgement
from indentfit.experiment.manifest import Entry
from indentfit.experiment.mean_case import MeanCase
from indentfit.experiment.process import process
from indentfit.experiment.processed import process_record
from indentfit.experiment.record import RawRecord
from indentfit.experiment.rig import Rig, SensorNoise
from indentfit.report.record_folder import drawn_names

CASE = Path(__file__).parent.parent / "cases" / "rig_records"
SLOPES = {0: 60.0, 90: 120.0}  # mN/mm


@pytest.fixture(scope="module")
def records():
    """Direction -> record of a straight curve of SLOPES, 0.3 mm deep, on a quiet rig with a hold."""
    d = np.linspace(0, 0.3, 40)[1:]
    rig = Rig(hold=2.0, noise=SensorNoise(vibration=(0.05, 0.0005)))
    return {angle: rig.run(Curve(d, slope * d), np.random.default_rng(angle))[0] for angle, slope in SLOPES.items()}


@pytest.fixture(scope="module")
def replicates(records):
    """Both directions of one sample, and a record of nothing but zeros."""
    flat = RawRecord(np.arange(100.0), np.zeros(100), np.zeros(100), "flat")
    entries = [Entry("S1", angle, thickness=3.0, diameter=14.0, record=record) for angle, record in records.items()]
    return process([*entries, Entry("S2", 0, record=flat)])


def test_a_record_in_memory_becomes_a_live_result(records):
    raw = records[0]
    result = indentfit.process(RawRecord(raw.time, raw.displacement, raw.force, "run 1"), thickness=3.0)
    assert result.records["run 1"].line.slope == pytest.approx(60, rel=0.02)
    assert result.curves["run 1"].displacement[-1] == pytest.approx(0.3, abs=0.01)
    assert result.records["run 1"].strain_rate == pytest.approx(1 / 3, rel=0.02)
    assert repr(result) == "ProcessResult(1 of 1 records)"
    assert result.summary().splitlines()[2].startswith("run 1 ")


def test_a_record_that_cannot_be_used_does_not_stop_the_others(replicates):
    assert list(replicates.records) == ["S1 0°", "S1 90°"]
    assert list(replicates.problems) == ["S2 0°"] and "the displacement is 0 throughout" in replicates.problems["S2 0°"]
    assert replicates.statistics.ratio.mean == pytest.approx(2, rel=0.03)
    assert repr(replicates).startswith("ProcessResult(2 of 3 records; 0°: ") and "\n" not in repr(replicates)


def test_the_json_begins_with_its_format_and_is_what_the_folder_holds(replicates, tmp_path):
    replicates.write(tmp_path / "out", figures=False)
    written = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert next(iter(written)) == next(iter(replicates.as_json())) == "format"
    assert written["format"] == "indentfit.process/2"
    assert [record["status"] for record in written["records"]] == ["ok", "ok", "failed"]
    for record, curve in zip(written["records"], replicates.curves.values(), strict=False):
        assert np.array_equal(read_curve(tmp_path / "out" / record["curve"]).force, curve.force)
    with pytest.raises(OutputError, match="overwrite"):
        replicates.write(tmp_path / "out", figures=False)
    replicates.write(tmp_path / "out", figures=False, overwrite=True)


def test_a_figure_of_a_record_or_of_the_replicates(replicates):
    whole, record = replicates.plot(), replicates.plot("S1 90°")
    assert isinstance(whole, matplotlib.figure.Figure) and len(whole.axes) == 3
    name, rating = record.get_suptitle().splitlines()
    assert name == "S1 90°" and rating.startswith("good: noise ")
    with pytest.raises(RecordError, match="no record 'S3'; the records are S1 0°, S1 90°"):
        replicates.plot("S3")


def test_the_summary_in_a_notebook_is_escaped(records):
    result = process(Entry("<b>S</b>", 0, record=records[0]))
    assert "<b>" not in result._repr_html_() and "&lt;b&gt;S&lt;/b&gt; 0°" in result._repr_html_()


def test_a_case_of_the_mean_curves_needs_directions(records, replicates, tmp_path):
    with pytest.raises(OutputError, match="no record has a direction"):
        process(records[0]).write(tmp_path / "none", figures=False, case=MeanCase.read())
    assert not (tmp_path / "none").exists()
    replicates.write(tmp_path / "set", figures=False, case=MeanCase.read(targets={90: "linear"}))
    case = indentfit.read_case(tmp_path / "set" / "case.toml")
    assert [test.angle for test in case.tests] == [0, 90]
    assert case.sample.thickness == 3.0
    line = case.curves[1]
    np.testing.assert_allclose(line.force / line.displacement, line.force[0] / line.displacement[0], rtol=1e-9)


def test_files_and_a_manifest_give_the_same_numbers():
    """The manifest of the case, and its two files as entries, with the settings as a file."""
    settings = CASE / "record.toml"
    by_manifest = process(manifest=CASE / "manifest.csv", settings=settings)
    files = [CASE / "records" / f"S1_{name}.csv" for name in ("parallel", "perpendicular")]
    by_files = process(files, settings=settings)
    assert list(by_files.records) == ["S1_parallel", "S1_perpendicular"]
    for named, alone in zip(by_manifest.records.values(), by_files.records.values(), strict=True):
        assert named.line == alone.line and named.contact == alone.contact


def test_names_stay_apart(records):
    result = process([records[0], records[90], records[90]])
    assert list(result.records) == ["simulated rig", "simulated rig (2)", "simulated rig (3)"]


def test_the_same_sample_and_direction_twice_is_refused(records):
    result = process([Entry("S1", 0, record=records[0]), Entry("S1", 0, record=records[0])])
    assert len(result.records) == 1 and "another record has this sample and direction" in result.outcomes[1].problem


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({}, "either records or a manifest"),
        ({"records": "a.csv", "manifest": "m.csv"}, "either records or a manifest"),
        ({"records": ["a.csv", "b.csv"]}, "a.csv: no such file.*\nb.csv: no such file"),
        ({"records": Entry("S1", 0)}, "S1 0°: neither a file nor a record"),
    ],
)
def test_what_cannot_be_processed_at_all_is_an_error(arguments, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(RecordError, match=message):
        process(**arguments)


def test_of_many_records_the_poorest_are_drawn():
    """Of more than 12 records, figures are drawn of those with the poorest ratings, unless all are wanted or none."""
    rating = dict(zip("abcdefghijklmnopqrstuvwxyz", ["good", "fair", "poor"] * 9, strict=False))
    records = {name: SimpleNamespace(judgement=Judgement(text, ())) for name, text in rating.items()}
    result = SimpleNamespace(records=records)
    drawn = drawn_names(result, None)
    assert drawn == list("bcefhiklorux")  # the 8 that are poor, and the first 4 that are fair
    assert drawn_names(result, True) == list(records) and drawn_names(result, False) == []


def test_a_case_tells_process_its_indenter():
    """The contact point and Hertz's modulus go by the end that --case is told; what [record] states is kept."""
    told = FileCase.of(["indenter.shape=sphere", "indenter.radius=0.25"]).reading(Record())
    assert (told.indenter, told.radius) == ("sphere", 0.25)
    assert FileCase.of(["indenter.shape=cylinder", "indenter.diameter=6"]).reading(Record()).indenter == "flat"
    assert FileCase.of(["indenter.shape=sphere", "indenter.radius=1"]).reading(Record(radius=0.5)).radius == 0.5


@pytest.mark.parametrize("age", [0.05, 0.3, 3.0])
def test_the_peak_of_a_test_in_steps_with_holds_is_that_of_its_last_step(age):
    """Four steps of 0.25 s and holds of 1.5 s, in which half of the force relaxes: peaks were 4 to 15 % too low, those of a fit
    over steps and holds."""
    time = np.arange(2280) / 300
    corners = [0, 0.6, 0.85, 2.35, 2.6, 4.1, 4.35, 5.85, 6.1, 7.6]
    place = np.interp(time, corners, [-0.6, 0, 0.25, 0.25, 0.5, 0.5, 0.75, 0.75, 1, 1])
    elastic = np.maximum(place, 0) ** 1.5
    relaxing = lfilter([1.0], [1.0, -np.exp(-1 / 300 / age)], np.diff(elastic, prepend=0))
    force = 0.5 * elastic + 0.5 * relaxing
    noise = 0.003 * force.max() * np.random.default_rng(5).standard_normal(time.size)
    record = process_record(RawRecord(time, place, force + noise, "steps"), settings=Record(indenter="sphere"))
    assert record.peak == pytest.approx(force.max(), rel=0.01) and record.peak_uncertainty < 0.012 * force.max()
    assert record.ramp.stop / 300 == pytest.approx(6.1, abs=0.02) and record.ramp.pauses
    assert record.velocity == pytest.approx(1.0, rel=0.05)
