"""What a file holds (`process --list`), the choice of a part of it, and the case that a file becomes (`process FILE --case`)."""

import re

import numpy as np
import pytest
from click.testing import CliRunner

from indentfit.case import Record
from indentfit.cli import main
from indentfit.errors import RecordError
from indentfit.experiment.contents import contents
from indentfit.experiment.measured import read_case
from indentfit.experiment.process import process
from indentfit.experiment.processed import process_record
from indentfit.experiment.reading import read_records
from indentfit.experiment.record import RawRecord

RADIUS, MODULUS, CONTACT = 0.5, 20.0, 0.3  # mm, kPa (E*), mm


def hertz(position):
    return 4 / 3 * MODULUS * np.sqrt(RADIUS) * np.maximum(position - CONTACT, 0) ** 1.5


def record(corners, rate=200, noise=1e-3, seed=0, **more):
    """A record of a sphere along corners (time s, position mm); its force in mN."""
    times, places = np.array(corners).T
    time = np.arange(int(times[-1] * rate)) / rate
    position = np.interp(time, times, places)
    force = hertz(position) + noise * np.random.default_rng(seed).standard_normal(time.size)
    return RawRecord(time, position, force, "drawn", **more)


def written(path, *blocks, header="Time (s);Weg (mm);Kraft (mN)"):
    """Blocks of rows, each below its marker line, as a program with decimal commas writes them."""
    lines = []
    for n, block in enumerate(blocks, start=1):
        rows = zip(block.time, block.displacement, block.force, strict=True)
        lines += [f"Test {n}", header, *(";".join(f"{value:.6f}".replace(".", ",") for value in row) for row in rows), ""]
    path.write_text("\n".join(lines), encoding="utf-16")
    return path


UP_AND_DOWN = [(0, 0), (3, 0.6), (4, 0.6), (7, 0)]
SPHERE = Record(indenter="sphere", radius=RADIUS)


def test_the_list_names_each_test_with_its_segments(tmp_path):
    path = written(tmp_path / "r.txt", record(UP_AND_DOWN), record(UP_AND_DOWN, seed=1))
    first, second = contents(path)
    assert (first.number, first.name, second.name) == (1, "Test 1", "Test 2") and first.rows == 1400
    assert [segment.direction for segment in first.segments] == ["approach", "hold", "retract"]
    approach = first.segments[0]
    assert approach.velocity == pytest.approx(0.2, rel=0.03) and approach.rows[1] == pytest.approx(600, abs=30)
    assert approach.peak == pytest.approx(hertz(0.6), rel=0.01)
    said = CliRunner().invoke(main, ["process", "--list", str(path)])
    assert said.exit_code == 0 and "2 Test 2: 1,400 rows" in said.output and "retract: rows" in said.output
    assert not list(tmp_path.glob("*-processed"))


def test_a_block_is_chosen_by_number_and_by_name(tmp_path):
    path = written(tmp_path / "r.txt", record(UP_AND_DOWN), record(UP_AND_DOWN, seed=1))
    for block in (2, "test 2"):
        (chosen,) = read_records(path, Record(block=block))
        np.testing.assert_allclose(chosen.force, record(UP_AND_DOWN, seed=1).force, atol=1e-6)
    with pytest.raises(RecordError, match="the file has 2 tables"):
        read_records(path, Record(block=3))


CYCLES = [(0, 0), (3, 0.55), (6, 0), (9, 0.575), (12, 0), (15, 0.6), (18, 0)]


@pytest.mark.parametrize(("cycle", "depth"), [(1, 0.25), (2, 0.275), ("last", 0.3)])
def test_a_cycle_is_chosen(cycle, depth):
    done = process_record(record(CYCLES), settings=SPHERE.model_copy(update={"cycle": cycle}))
    assert done.depth == pytest.approx(depth, abs=0.004)
    assert done.contact.displacement == pytest.approx(CONTACT, abs=0.004)


def test_without_a_choice_the_first_cycle_that_reaches_most_of_the_force_is_used_and_a_note_says_so():
    done = process_record(record(CYCLES), settings=SPHERE)
    assert any("3 loading cycles; number 2 is used" in note for note in done.notes)


@pytest.mark.parametrize("segment", ["approach", "retract"])
def test_both_directions_of_an_elastic_record_give_its_modulus(segment):
    done = process_record(record(UP_AND_DOWN), settings=SPHERE.model_copy(update={"segment": segment}))
    assert done.hertz.modulus == pytest.approx(MODULUS, rel=0.02)
    assert abs(done.contact.displacement - CONTACT) <= 2 * done.contact.uncertainty < 0.02


@pytest.mark.parametrize("choice", [{"rows": (1, 620)}, {"times": (0.0, 3.1)}])
def test_rows_and_times_cut_a_record(choice):
    done = process_record(record(UP_AND_DOWN), settings=SPHERE.model_copy(update=choice))
    assert done.record.time[-1] <= 3.1 and done.peak == pytest.approx(hertz(0.6), rel=0.01)


def test_samples_at_uneven_times_give_the_same_modulus():
    even = record(UP_AND_DOWN, rate=1000)
    kept = np.sort(np.random.default_rng(0).choice(even.time.size, 2000, replace=False))
    done = process_record(RawRecord(even.time[kept], even.displacement[kept], even.force[kept]), settings=SPHERE)
    assert done.hertz.modulus == pytest.approx(MODULUS, rel=0.02)
    assert abs(done.contact.displacement - CONTACT) <= 2 * done.contact.uncertainty
    assert "uneven times" in done.record.taken


def test_every_sheet_of_a_workbook_is_a_record(tmp_path):
    openpyxl = pytest.importorskip("openpyxl")
    pytest.importorskip("python_calamine")
    book = openpyxl.Workbook()
    book.active.append(["Results"])
    for n in (1, 2):
        sheet, one = book.create_sheet(f"Specimen {n}"), record(UP_AND_DOWN, rate=40, seed=n)
        for row in (["Prüfzeit", "Standardweg", "Standardkraft"], ["s", "mm", "N"]):
            sheet.append(row)
        for row in zip(one.time, one.displacement, one.force / 1000, strict=True):
            sheet.append([float(value) for value in row])
    book.save(tmp_path / "r.xlsx")
    for settings in (None, Record(sheets="all")):
        outcomes = process(tmp_path / "r.xlsx", settings=settings).outcomes
        assert [outcome.name for outcome in outcomes] == ["r Specimen 1", "r Specimen 2"]
        assert all(outcome.processed.peak == pytest.approx(hertz(0.6), rel=0.01) for outcome in outcomes)
    assert [content.name for content in contents(tmp_path / "r.xlsx")] == ["Specimen 1", "Specimen 2"]


def test_waves_of_the_baseline_are_fitted_and_said():
    """Interference in liquid, 25 % of the peak from top to bottom: the force without contact is told from contact."""
    plain = record([(0, -0.4), (5, 0.6)])
    waves = 0.125 * hertz(0.6) * np.sin(2 * np.pi * plain.displacement / 0.17)
    done = process_record(RawRecord(plain.time, plain.displacement, plain.force + waves), settings=SPHERE)
    assert done.contact.form == "waves" and done.contact.scale == pytest.approx(0.17, rel=0.01)
    assert abs(done.contact.displacement - CONTACT) <= done.contact.uncertainty < 0.01
    assert any("because of the baseline" in note for note in done.notes)


def test_the_end_of_an_indenter_that_is_not_told_is_in_the_interval():
    """A sphere: flat powers alone put contact 0.01 to 0.03 mm too late."""
    for seed in range(4):
        done = process_record(record([(0, 0), (3, 0.6)], seed=seed, noise=0.02))
        assert abs(done.contact.displacement - CONTACT) <= done.contact.uncertainty


def test_a_sensor_at_the_end_of_its_range_in_a_hold_is_noted():
    plain = record(UP_AND_DOWN[:3], noise=0.02)
    top = 0.985 * hertz(0.6)
    done = process_record(RawRecord(plain.time, plain.displacement, np.minimum(plain.force, top)), settings=SPHERE)
    assert any("may be saturated" in note for note in done.notes)


def run(*arguments):
    return CliRunner().invoke(main, ["process", *map(str, arguments), "--no-figures"])


@pytest.mark.parametrize(
    ("line", "told", "ratio", "said"),
    [
        ("Operator: A", (), 0.499, "0.499, as tissue"),
        ("Sample Poisson's ratio :\t0.30", (), 0.3, "0.3, as the file states"),
        ("Poisson ratio\t0,5", (), 0.499, "0.499, as the file states"),
        ("Poisson's ratio: 0.3", ("--set=material.poisson_ratio=0.4", "--set=indenter.friction=0"), 0.4, None),
    ],
)
def test_a_case_says_what_it_presumes(line, told, ratio, said, tmp_path, monkeypatch):
    """Poisson's ratio goes by the experimenter, then the file, then that of tissue; friction is unknown until it is told."""
    monkeypatch.chdir(tmp_path)
    plain = record([(0, 0), (3, 0.4)])
    rows = ("\t".join(f"{value:.6f}" for value in row) for row in zip(plain.time, plain.displacement, plain.force, strict=True))
    (tmp_path / "r.txt").write_text("\n".join([line, "Tip radius (um)\t500", "Time (s)\tDisplacement (mm)\tLoad (mN)", *rows]))
    sample = [f"--set=sample.{key}" for key in ("diameter=10", "thickness=4", "base=unknown")]
    made = run("r.txt", "--case", "-o", "out", *sample, *told)
    assert made.exit_code == 0, made.stderr
    text = (tmp_path / "out" / "case.toml").read_text()
    assert f"poisson_ratio = {ratio}" in text
    assert said in made.stderr if said else "--case:" not in made.stderr
    assert ('friction = "unknown"' in text) == (not told) and 'base = "unknown"' in text


def test_a_file_becomes_a_case_that_asks_only_for_the_sample(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    lines = ["Tip radius (um)\t500", "Time (s)\tDisplacement (mm)\tLoad (mN)"]
    plain = record([(0, 0), (3, 0.4)])
    rows = zip(plain.time, plain.displacement, plain.force, strict=True)
    (tmp_path / "r.txt").write_text("\n".join([*lines, *("\t".join(f"{value:.6f}" for value in row) for row in rows)]))
    asked = run("r.txt", "--case", "-o", "out")
    assert asked.exit_code == 2 and "sample.diameter, sample.thickness, sample.base" in asked.stderr
    assert "indenter" not in asked.stderr.splitlines()[-1]
    told = [f"--set=sample.{key}" for key in ("diameter=10", "thickness=4", "base=bonded")]
    thin = run("r.txt", "--case", "-o", "out", *told, "--set", "sample.thickness=0.05")
    assert (thin.exit_code, "partial" in thin.stderr) == (2, False) and "--case: test.press.curve" in thin.stderr
    made = run("r.txt", "--case", "-o", "out", *told, "--set", "indenter.friction=unknown")
    assert made.exit_code == 0, made.stderr
    case = read_case("out/case.toml")
    assert case.indenter.radius == 0.5 and case.sample.thickness == 4 and case.sample.base == "bonded"
    assert 'friction = "unknown"' in (tmp_path / "out" / "case.toml").read_text()
    assert case.curves[0].displacement[-1] == pytest.approx(0.1, abs=0.003)
    assert case.material.parameters["young"].start == pytest.approx(0.75 * MODULUS, rel=0.03)


def test_sizes_that_a_case_of_a_file_is_told_may_have_units(tmp_path, monkeypatch):
    """The radius counts when contact and modulus are found, too: a text could not be doubled."""
    monkeypatch.chdir(tmp_path)
    plain = record([(0, 0), (3, 0.4)])
    table = np.c_[plain.time, plain.displacement, plain.force]
    np.savetxt("r.csv", table, delimiter=",", header="Time (s),Displacement (mm),Load (mN)", comments="")
    told = [
        "--set=sample.diameter=1 cm",
        "--set=sample.thickness='4000 um'",
        "--set=sample.base=bonded",
        "--set=indenter.shape=sphere",
    ]
    wrong = run("r.csv", "--case", "-o", "out", *told, "--set=indenter.radius=wide")
    assert wrong.exit_code == 2 and "indenter.radius" in wrong.stderr and "bug" not in wrong.stderr
    made = run("r.csv", "--case", "-o", "out", *told, "--set=indenter.radius=500 um")
    assert made.exit_code == 0, made.stderr
    case = read_case("out/case.toml")
    assert (case.sample.diameter, case.sample.thickness, case.indenter.radius) == (10, 4, 0.5)
    assert case.curves[0].displacement[-1] == pytest.approx(0.1, abs=0.003)
    assert case.material.parameters["young"].start == pytest.approx(0.75 * MODULUS, rel=0.03)


@pytest.mark.parametrize("softer", [1.0, 100.0])
def test_the_range_of_the_modulus_holds_that_of_a_soft_first_contact(softer, tmp_path, monkeypatch):
    """A punch of 6 mm that meets a toe region 100 times softer than what follows: a fit of small depths needs its modulus."""
    monkeypatch.chdir(tmp_path)
    time = np.arange(2000) / 500
    depth = np.maximum(time / 4 * 0.7 - 0.2, 0.0)
    stiffness = 60.0  # mN/mm
    force = np.where(depth < 0.1, stiffness / softer * depth, stiffness / softer * 0.1 + stiffness * (depth - 0.1))
    noise = 0.002 * np.random.default_rng(0).standard_normal(time.size)
    np.savetxt(
        "r.csv",
        np.c_[time, time / 4 * 0.7, force + noise],
        delimiter=",",
        header="Time (s),Displacement (mm),Load (mN)",
        comments="",
    )
    told = ["sample.diameter=40", "sample.thickness=20", "sample.base=bonded", "indenter.shape=cylinder", "indenter.diameter=6"]
    made = run("r.csv", "--case", "-o", "out", *(f"--set={key}" for key in told))
    assert made.exit_code == 0, made.stderr
    bounds = read_case("out/case.toml").material.parameters["young"]
    toe = 0.75 * stiffness / softer / 6
    assert bounds.min < 0.2 * toe and bounds.max > 5 * 0.75 * stiffness / 6


def relaxing(shear=2.0, g=0.6, tau=2.0, ramp=1.0, hold=15.0, depth=0.05, radius=1.0):
    """Time s, position mm and force mN of a sphere on an incompressible half-space whose shear modulus relaxes, by the integral of
    Lee and Radok (1960, J Appl Mech 27:438) over fine steps: F = 16/3 sqrt(R) int G(t - s) d(d^1.5)."""
    time = np.arange(0, 1.0 + ramp + hold, 5e-3)
    position = np.interp(time, [0, 1.0 + ramp], [-depth / ramp, depth])
    work = 16 / 3 * shear * np.sqrt(radius) * np.maximum(position, 0) ** 1.5
    excess = np.zeros(time.size)
    for n in range(1, time.size):
        excess[n] = excess[n - 1] * np.exp(-5e-3 / tau) + (work[n] - work[n - 1]) * np.exp(-2.5e-3 / tau)
    force = (1 - g) * work + g * excess
    return time, position, force + 0.003 * force.max() * np.random.default_rng(0).standard_normal(time.size)


def test_a_record_with_a_hold_becomes_a_case_in_time(tmp_path, monkeypatch):
    """Told that the material relaxes, the case has ramp and hold with their times; otherwise it says what it leaves out."""
    monkeypatch.chdir(tmp_path)
    time, position, force = relaxing()
    np.savetxt("r.csv", np.c_[time, position, force], delimiter=",", header="Time (s),Displacement (mm),Load (mN)", comments="")
    told = [f"--set=sample.{key}" for key in ("diameter=40", "thickness=20", "base=bonded")]
    told += [f"--set=indenter.{key}" for key in ("shape=sphere", "radius=1", "friction=0")]
    plain = run("r.csv", "--case", "-o", "plain", *told)
    assert plain.exit_code == 0, plain.stderr
    kept = re.search(r"the force falls in the hold, to ([\d.]+)% in the end.*--set material\.relaxation\.terms=2", plain.stderr)
    assert kept and float(kept[1]) == pytest.approx(40, abs=3)
    assert read_case("plain/case.toml").curves[0].time is None
    made = run("r.csv", "--case", "-o", "out", *told, "--set=material.relaxation.terms=1")
    assert made.exit_code == 0, made.stderr
    assert "falls in the hold" not in made.stderr
    case = read_case("out/case.toml")
    (curve,) = case.curves
    assert case.material.relaxation.terms == 1 and curve.time is not None
    assert curve.displacement.max() == pytest.approx(0.05, rel=0.01) and np.ptp(curve.time) > 13
    for at in (1.5, 2.5, 5.0, 12.0):
        near = int(np.argmin(np.abs(curve.time - at)))
        assert curve.force[near] == pytest.approx(np.interp(curve.time[near], time, force), abs=0.02 * force.max())


def test_a_key_within_a_key_that_has_a_value_is_refused(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "r.csv").write_text("Time (s),Displacement (mm),Load (mN)\n")
    wrong = run("r.csv", "--case", "--set=material.relaxation=2", "--set=material.relaxation.terms=2")
    assert wrong.exit_code == 2 and "relaxation has a value already, and cannot hold terms" in wrong.stderr
