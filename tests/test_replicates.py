"""Manifests and statistics of replicates."""

import csv
import importlib.util
import re
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from indentfit.case import Record, RecordChannel
from indentfit.errors import RecordError
from indentfit.experiment.manifest import Entry, read_manifest
from indentfit.experiment.outcomes import Outcome, process_all
from indentfit.experiment.replicates import mean_curves, outliers, spread, statistics

CASE = Path(__file__).parent.parent / "cases" / "rig_records"
_spec = importlib.util.spec_from_file_location("make_records", CASE / "make_records.py")
make_records = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(make_records)
LAYOUT = Record(
    displacement=RecordChannel(column="displacement_V", gain=6.0, sign=-1, offset=30.0, unit="mm"),
    force=RecordChannel(column="force_V", gain=24.0, sign=-1, unit="mN"),
    rate=1000.0,
)
HEADER = "sample,direction,file,thickness_mm,diameter_mm\n"


@pytest.fixture(scope="module")
def replicates(tmp_path_factory):
    """The manifest of 12 synthetic samples in two directions, and their true stiffnesses (12, 2)."""
    folder = tmp_path_factory.mktemp("replicates")
    true = make_records.stiffnesses()
    make_records.write_records(folder, [(f"S{n}", 3.3, *k) for n, k in enumerate(true)], hold=0.3)
    return folder / "manifest.csv", true


def test_the_drawn_stiffnesses_have_the_paper_s_moments():
    k0, k90 = make_records.stiffnesses().T
    assert (k0.mean(), k90.mean()) == pytest.approx((72.9, 170.5), rel=1e-3)
    assert ((k90 / k0).mean(), (k90 / k0).std(ddof=1)) == pytest.approx((2.83, 1.32), rel=1e-3)


def test_twelve_samples_in_two_directions_give_back_the_means_the_ratio_and_the_p_value(replicates):
    """Means within 1.5 % (a noisy ramp of 0.35 s), their ratio within 2 %, p-values within a fifth of a decade of the truth's."""
    manifest, true = replicates
    outcomes = process_all(read_manifest(manifest), LAYOUT)
    result = statistics(outcomes)
    k0, k90 = true.T
    assert [result.stiffness[d].n for d in (0, 90)] == [12, 12]
    assert result.stiffness[0].mean == pytest.approx(72.9, rel=0.015)
    assert result.stiffness[90].mean == pytest.approx(170.5, rel=0.015)
    assert result.stiffness[0].sd == pytest.approx(k0.std(ddof=1), rel=0.05)
    assert result.stiffness[90].sd == pytest.approx(k90.std(ddof=1), rel=0.05)
    assert result.ratio.mean == pytest.approx(2.83, rel=0.02)
    assert result.ratio.sd == pytest.approx(1.32, rel=0.05)
    p = {difference.test: difference.p for difference in result.differences}
    truth = {
        "paired t-test": stats.ttest_rel(k90, k0).pvalue,
        "Wilcoxon signed-rank test": stats.wilcoxon(k90, k0).pvalue,
        "unpaired t-test (Student, equal variances)": stats.ttest_ind(k90, k0).pvalue,
        "unpaired t-test (Welch)": stats.ttest_ind(k90, k0, equal_var=False).pvalue,
    }
    assert set(p) == set(truth)
    assert all(value < 0.001 for value in p.values())  # as the paper
    assert [np.log10(p[name]) for name in truth] == pytest.approx([np.log10(value) for value in truth.values()], abs=0.2)
    truth = {(row["sample"], int(row["direction"])): row for row in csv.DictReader((manifest.parent / "truth.csv").open())}
    contacts = [
        (outcome.processed.contact, float(truth[outcome.entry.sample, outcome.entry.direction]["contact_mm"]))
        for outcome in outcomes
    ]
    errors = np.array([abs(contact.displacement - true) for contact, true in contacts])
    assert np.median(errors) < 0.005
    assert sum(errors <= [contact.uncertainty for contact, _ in contacts]) >= 19  # of 24: 95 % less three standard deviations
    means = mean_curves(outcomes)
    for direction in (0, 90):
        assert means[direction].count == 12
        slope = np.polyfit(means[direction].displacement, means[direction].force, 1)[0]
        assert slope == pytest.approx(result.stiffness[direction].mean, rel=0.02)
    assert means[90].parabola.curvature > 3 * means[0].parabola.curvature  # the paper's reason for a quadratic target


def test_statistics_are_those_of_a_worked_example():
    """Student's sleep records of 1908 (R's `sleep`): paired t = 4.0621, p = 0.002833; Student's 1.8608, p = 0.07919; Welch's p =
    0.07939.
    """
    first = [0.7, -1.6, -0.2, -1.2, -0.1, 3.4, 3.7, 0.8, 0.0, 2.0]
    second = [1.9, 0.8, 1.1, 0.1, -0.1, 4.4, 5.5, 1.6, 4.6, 3.4]
    result = statistics(outcomes_of({0: first, 90: second}, shift=10))  # away from 0: ratios are taken, too
    t = {difference.test: (difference.statistic, difference.p) for difference in result.differences}
    assert t["paired t-test"] == pytest.approx((4.0621, 0.002833), rel=1e-3)
    assert t["unpaired t-test (Student, equal variances)"] == pytest.approx((1.8608, 0.07919), rel=1e-3)
    assert t["unpaired t-test (Welch)"] == pytest.approx((1.8608, 0.07939), rel=1e-3)
    paired = next(difference for difference in result.differences if difference.test == "paired t-test")
    assert paired.interval == pytest.approx((0.7001142, 2.4598858), rel=1e-5)


def outcomes_of(values, shift=0.0):
    """Outcomes with nothing but a stiffness."""

    class Line:
        def __init__(self, slope):
            self.line = type("line", (), {"slope": slope})

    return [
        Outcome(Entry(f"S{n}", direction, Path("x")), Line(value + shift))
        for direction, column in values.items()
        for n, value in enumerate(column)
    ]


def test_an_interval_of_the_mean_is_student_s():
    """Nine values with mean 10 and standard deviation 3: 10 -+ 2.306 (t of 8 degrees of freedom, tables) x 1."""
    values = np.arange(9.0) - 4
    values = 10 + 3 * values / values.std(ddof=1)
    moments = spread({str(n): value for n, value in enumerate(values)})
    assert (moments.mean, moments.sd, moments.stderr) == pytest.approx((10, 3, 1))
    assert moments.interval == pytest.approx((10 - 2.306, 10 + 2.306), abs=5e-4)


def test_outliers_are_named_but_counted():
    named = {f"S{n}": value for n, value in enumerate([10, 11, 12, 11, 10, 12, 30.0])}
    assert outliers(named) == ("S6",)
    assert spread(named).n == 7
    assert spread(named).mean == pytest.approx(96 / 7)
    assert outliers({"a": 1.0, "b": 1.1, "c": 50.0}) == ()  # of three, none can be told


def test_a_sample_measured_in_one_direction_counts_there_only():
    outcomes = outcomes_of({0: [10, 11, 12], 90: [21, 20, 25, 30]})
    result = statistics(outcomes)
    assert (result.stiffness[0].n, result.stiffness[90].n, result.ratio.n) == (3, 4, 3)
    assert {difference.test: difference.n for difference in result.differences}["unpaired t-test (Welch)"] == (4, 3)
    assert statistics(outcomes_of({0: [10, 11]})).ratio is None
    alone = statistics(outcomes_of({0: [10], 90: [20]}))
    assert alone.ratio.mean == 2 and alone.differences == ()


def test_every_row_that_cannot_be_read_is_named_and_the_others_are_processed(tmp_path):
    good = (CASE / "records" / "S1_parallel.csv").resolve()
    (tmp_path / "short.csv").write_text("displacement_V,force_V\n1,2\n1,2\n1,2\n")
    rows = [
        f"A,0,{good},3.3,14",
        "B,0,none.csv,3.3,14",
        "C,45,x.csv,3.3,14",
        "D,perpendicular,short.csv,3.3,14",
        f"E,0,{good},thick,14",
        f"F,90deg,{good},-1,14",
        ",0,x.csv,3.3,14",
        f"A,parallel,{good},3.3,14",
        "G,0",
    ]
    (tmp_path / "manifest.csv").write_text(HEADER + "\n".join(rows))
    outcomes = process_all(read_manifest(tmp_path / "manifest.csv"), LAYOUT)
    assert [outcome.entry.sample for outcome in outcomes if outcome.processed] == ["A"]
    told = [outcome.problem for outcome in outcomes[1:]]
    for text, words in zip(
        told,
        (
            "none.csv: no such file",
            "row 4 .*45",
            "short.csv.*3 rows",
            "row 6 .*'thick'",
            "row 7 .*'-1'",
            "row 8 .*no sample",
            "row 9 repeats A, 0 of row 2",
            "row 10 .*no file",
        ),
        strict=True,
    ):
        assert re.search(words, text), text


def test_a_manifest_in_other_units_and_separators_is_the_same(tmp_path):
    (tmp_path / "m.csv").write_text("Sample;Direction;File;thickness_um;Diameter\n1;0;a.csv;3300;14,5\n", encoding="utf-8")
    (entry,) = read_manifest(tmp_path / "m.csv")
    assert (entry.sample, entry.direction, entry.thickness, entry.diameter) == ("1", 0, 3.3, 14.5)
    assert entry.path == tmp_path / "a.csv"


def test_a_manifest_without_a_needed_column_is_refused(tmp_path):
    for text, words in (("sample,direction\nA,0\n", "no column file"), (HEADER, "no rows"), ("", "no rows")):
        (tmp_path / "m.csv").write_text(text)
        with pytest.raises(RecordError, match=words):
            read_manifest(tmp_path / "m.csv")
    with pytest.raises(RecordError, match="cannot be read"):
        read_manifest(tmp_path / "none.csv")
