"""`indentfit process`, a case that names raw records, and `fit --per-sample`: what they print, what they write and how they end."""

import csv
import json
import os
import re
import shutil
import tomllib
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from fixtures.cases import tiny_case

from indentfit.case.template import template
from indentfit.cli import main
from indentfit.curve import Curve, read_curve, write_curve
from indentfit.errors import CaseError, OutputError
from indentfit.experiment.measured import read_case
from indentfit.experiment.processed import process_record
from indentfit.experiment.reading import read_record
from indentfit.experiment.rig import Rig, SensorNoise
from indentfit.experiment.specimens import read_groups, read_specimens
from indentfit.fem.simulate import Model
from indentfit.inference.fit import fit
from indentfit.inference.per_sample import PerSample, SampleFit, sample_cases
from indentfit.inverse.wide import uncertain_inputs, with_offset_of_records

CASE = Path(__file__).parent.parent / "cases" / "rig_records"
RECORD = CASE / "records" / "S1_parallel.csv"
TRUTH = {row["direction"]: row for row in csv.DictReader((CASE / "truth.csv").read_text().splitlines())}
TABLE = ["--record", str(CASE / "record.toml")]


@pytest.fixture(autouse=True)
def inside(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def run(*arguments, command="process"):
    return CliRunner().invoke(main, [command, *map(str, arguments)])


@pytest.fixture
def manifest(tmp_path):
    """Three samples in both directions, one of whose files is missing: straight curves of 60 k and 120 k mN/mm, k = 1, 1.1, 1.2."""
    d = np.linspace(0, 0.3, 40)[1:]
    rng, rows = np.random.default_rng(0), ["sample,direction,file,thickness,diameter"]
    for n in range(3):
        for direction, slope in ((0, 60.0), (90, 120.0)):
            rig = Rig(hold=0.3, noise=SensorNoise(vibration=(0.1, 0.001)))
            record, _ = rig.run(Curve(d, slope * (1 + 0.1 * n) * d), rng)
            table = np.column_stack([record.time, record.displacement, record.force])
            np.savetxt(
                tmp_path / f"{n}_{direction}.csv",
                table,
                delimiter=",",
                header="time_s,displacement_mm,force_mN",
                comments="",
                fmt="%.4f",
            )
            rows.append(f"S{n},{direction},{n}_{direction}.csv,{3 + 0.1 * n:g},14")
    rows.append("S9,0,lost.csv,3,14")
    (tmp_path / "manifest.csv").write_text("\n".join(rows) + "\n")
    return tmp_path / "manifest.csv"


def test_a_raw_record_becomes_a_curve_a_table_figures_and_a_page(tmp_path):
    result = run(RECORD, *TABLE, "--thickness", 3.3, "-o", "out")
    assert result.exit_code == 0, result.stderr
    assert "written     out" in result.stdout
    files = {path.relative_to(tmp_path / "out").as_posix() for path in (tmp_path / "out").rglob("*") if path.is_file()}
    assert files == {
        "curves/S1_parallel.csv",
        "figures/S1_parallel.svg",
        "figures/S1_parallel.png",
        "stiffness.csv",
        "summary.json",
        "report.html",
    }
    (row,) = csv.DictReader((tmp_path / "out" / "stiffness.csv").read_text().splitlines())
    true = TRUTH["0"]
    assert float(row["stiffness_mN_per_mm"]) == pytest.approx(float(true["stiffness_mN_per_mm"]), rel=0.03)
    assert float(row["contact_mm"]) == pytest.approx(float(true["contact_mm"]), abs=0.01)
    assert float(row["depth_mm"]) == pytest.approx(float(true["depth_mm"]), abs=0.01)
    assert float(row["strain_rate_per_s"]) == pytest.approx(0.2, rel=0.03)
    assert row["status"] == "ok" and float(row["force_mN_at_0.05"]) > 0
    curve = read_curve(tmp_path / "out" / "curves" / "S1_parallel.csv")
    assert curve.displacement.size == 25
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["format"] == "indentfit.process/2"
    assert summary["records"][0]["contact"]["method"] == "piecewise"


@pytest.mark.usefixtures("undrawn")
def test_json_goes_to_stdout_alone():
    result = run(RECORD, *TABLE, "--json", "--no-figures", "-o", "out")
    assert json.loads(result.stdout)["records"][0]["status"] == "ok"
    assert json.loads(result.stdout) == json.loads(Path("out/summary.json").read_text())


@pytest.mark.usefixtures("undrawn")
def test_a_sidecar_beside_the_records_is_used_and_said():
    shutil.copytree(CASE / "records", "rig")
    shutil.copy(CASE / "record.toml", "rig/record.toml")
    result = run("rig/S1_parallel.csv", "--no-figures", "-o", "out")
    assert result.exit_code == 0
    assert "record.toml" in result.stderr
    Path("rig/record.toml").write_text("rate = 1000.0\n[force]\ngain = 24.0\n")
    result = run("rig/S1_parallel.csv", "--no-figures", "-o", "other")
    assert (result.exit_code, Path("other").exists()) == (2, False)
    assert "rig/record.toml: there is no table [record]" in result.stderr


@pytest.mark.usefixtures("undrawn")
def test_a_case_made_of_a_record_knows_no_friction_that_nobody_stated():
    keys = ["record.rate=1000", "record.displacement={gain=6,sign=-1}", "record.force={gain=24,sign=-1}"]
    keys += ["sample.diameter=14", "sample.thickness=3", "sample.base=bonded", "indenter.shape=cylinder", "indenter.diameter=2"]
    words = [word for key in keys for word in ("--set", key)]
    for stated, friction in ((), "unknown"), (("--set", "indenter.friction=0.1"), 0.1):
        result = run(RECORD, *words, *stated, "--case", "--no-figures", "-o", "out", "--overwrite")
        assert result.exit_code == 0, result.stderr
        assert tomllib.loads(Path("out/case.toml").read_text())["indenter"]["friction"] == friction


@pytest.mark.usefixtures("undrawn")
def test_a_calibration_can_be_given_by_set():
    keys = ["record.rate=1000", "record.displacement={gain=6,sign=-1}", "record.force.gain=24", "record.force.sign=-1"]
    result = run(RECORD, *(word for key in keys for word in ("--set", key)), "--no-figures", "-o", "out")
    assert result.exit_code == 0, result.stderr
    for key, text in (
        ("record.force.gian=1", "did you mean gain"),
        ("sample.thickness=1", "only keys of [record]"),
        ("record.rate=-1", "above 0"),
    ):
        result = run(RECORD, "--set", key, "-o", "other")
        assert result.exit_code == 2 and text in result.stderr


def test_a_bad_record_is_one_line_and_exit_code_2_and_nothing_is_written():
    Path("three.csv").write_text("time_s,displacement_mm,force_mN\n0,0,0\n1,1,1\n2,2,2\n")
    result = run("three.csv", "-o", "out")
    assert result.exit_code == 2
    (line,) = result.stderr.strip().splitlines()
    assert line.startswith("error: three.csv: 3 rows of numbers; a record needs at least 50 (")
    assert not Path("out").exists()
    both = run("three.csv", "none.csv", "-o", "out")
    assert both.exit_code == 2 and len(both.stderr.strip().splitlines()) == 2


@pytest.mark.usefixtures("undrawn")
def test_a_bad_record_among_good_ones_is_flagged(manifest):
    result = run("-m", manifest, "--no-figures", "-o", "out")
    assert result.exit_code == 0
    assert re.search(r"warning: left out: .*lost\.csv: no such file", result.stderr)
    rows = list(csv.DictReader(Path("out/stiffness.csv").read_text().splitlines()))
    assert [row["status"] for row in rows] == ["ok"] * 6 + ["failed"]
    assert "lost.csv" in rows[-1]["notes"] and rows[-1]["stiffness_mN_per_mm"] == ""
    summary = json.loads(Path("out/summary.json").read_text())
    assert summary["stiffness_mN_per_mm"]["0"]["mean"] == pytest.approx(66, rel=0.02)
    assert summary["ratio_90_to_0"]["mean"] == pytest.approx(2, rel=0.03)
    assert "ratio       90° / 0°" in result.stdout
    means = list(csv.DictReader(Path("out/mean_curves.csv").read_text().splitlines()))
    assert [(row["direction"], row["n"]) for row in means] == [("0", "3")] * 25 + [("90", "3")] * 25
    last = means[24]
    assert float(last["force_mN"]) == pytest.approx(66 * float(last["displacement_mm"]), rel=0.02)
    assert float(last["sd_mN"]) == pytest.approx(6 * float(last["displacement_mm"]), rel=0.1)  # SD of 60, 66, 72 is 6


@pytest.mark.usefixtures("undrawn")
def test_an_earlier_result_is_not_overwritten_unasked():
    arguments = [RECORD, *TABLE, "--no-figures", "-o", "out"]
    assert run(*arguments).exit_code == 0
    again = run(*arguments)
    assert again.exit_code == 2 and "--overwrite" in again.stderr
    assert run(*arguments, "--overwrite").exit_code == 0


def test_the_page_is_one_file_with_every_text_escaped(manifest):
    text = manifest.read_text().replace("S9", "<script>alert(1)</script> & $x$")
    manifest.write_text(text.replace("S2,", '"S2 <b>",'))
    result = run("-m", manifest, "-o", "out")
    assert result.exit_code == 0, result.stderr
    page = Path("out/report.html").read_text()
    assert "<script" not in page and "&lt;script&gt;" in page and "S2 &lt;b&gt;" in page
    assert not re.search(r"""(src|href)=["'](?!data:|#)""", page)  # a link within the page loads nothing
    assert page.count("<svg ") == 7  # six records and the replicates
    assert Path("out/figures/replicates.svg").is_file()


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["--manifest", "m.csv", "x.csv"],
        ["x.csv", "--case"],
        ["x.csv", "--base", "c"],
        ["-m", "m.csv", "--case", "--target", "45=mean"],
    ],
)
def test_options_that_do_not_go_together_are_refused(arguments):
    assert run(*arguments).exit_code == 2


# Cases of records


def test_a_case_that_names_raw_records_has_their_curves():
    case = read_case(CASE / "case.toml")
    for test, curve in zip(case.tests, case.curves, strict=True):
        true = TRUTH[str(test.angle)]
        assert curve.displacement.size == 25
        assert curve.displacement[-1] == pytest.approx(float(true["depth_mm"]), abs=0.008)
        slope = np.polyfit(curve.displacement, curve.force, 1)[0]
        assert slope == pytest.approx(float(true["stiffness_mN_per_mm"]), rel=0.03)


def test_a_case_with_a_sphere_looks_for_contact_as_hertz_has_it():
    keys = ["indenter={shape='sphere',diameter=20,friction=0.5}"]
    sphere = read_case(CASE / "case.toml", keys)
    as_told = read_case(CASE / "case.toml", ["record.indenter=sphere"])
    assert np.array_equal(sphere.curves[0].force, as_told.curves[0].force)
    assert not np.array_equal(sphere.curves[0].force, read_case(CASE / "case.toml").curves[0].force)


def test_the_hash_of_a_case_is_that_of_its_curves_wherever_they_come_from(tmp_path):
    """The same curve, named as a record or as a curve, is the same case; another calibration is another."""
    named = read_case(CASE / "case.toml")
    for test, curve in zip(named.tests, named.curves, strict=True):
        write_curve(tmp_path / f"{test.name}.csv", curve)
    keys = [f'test.{test.name}.curve={json.dumps(str(tmp_path / test.name))[:-1]}.csv"' for test in named.tests]
    assert read_case(CASE / "case.toml", keys).hash == named.hash
    assert read_case(CASE / "case.toml", ["record.force.gain=25"]).hash != named.hash


def test_the_error_of_a_contact_point_goes_from_the_record_into_the_fit(tmp_path):
    """Half of the 95 % interval over 1.96, through the curve's file too; what the case says of the offset goes before it."""
    named = read_case(CASE / "case.toml")
    stated = (
        process_record(read_record(CASE / named.tests[0].record, named.record), settings=named.record).contact.uncertainty / 1.96
    )
    assert 0 < stated < 0.05
    write_curve(tmp_path / "curve.csv", named.curves[0])
    assert read_curve(tmp_path / "curve.csv").contact == named.curves[0].contact == pytest.approx(stated)
    inputs = uncertain_inputs(named)
    assert [(known.name, known.test) for known in inputs] == [("offset", 0), ("offset", 1)]
    assert inputs[0].prior.numbers == pytest.approx((0, stated))
    own = read_case(CASE / "case.toml", ["fit.uncertain.offset=0.02"])
    assert [known.prior.numbers for known in uncertain_inputs(own)] == [(0, 0.02), (0, 0.02)]
    assert with_offset_of_records(own) is own
    assert with_offset_of_records(named).fit.uncertain.offset == max(curve.contact for curve in named.curves)


def test_errors_of_records_are_errors_of_the_case():
    for key, text in (
        ("test.parallel.record=none.csv", "test.parallel.record"),
        ("record.displacement.sign=1", "record.displacement.sign"),
        ("record.force.unit=kPa", "record.force.unit is in kPa"),
        ("record.contact=guess", "'piecewise', 'threshold' or 'variance_ratio'"),
        ("record.displacement.column=0", "record.displacement.column"),
    ):
        result = run(CASE / "case.toml", "--set", key, command="validate")
        assert result.exit_code == 2 and text in result.stderr, result.stderr


@pytest.mark.usefixtures("undrawn")
def test_a_fit_starts_from_the_rig_s_files_and_its_folder_can_be_run_again():
    """A neo-Hookean strip on quick elements: what the curves of `process` give, the raw records give; the copy is complete.

    A law without fibres cannot follow both directions: its misfit of 40 % is no fit, exit code 4, and the result is written."""
    keys = [
        "material={model='neo_hookean',bulk_ratio=1000,parameters={mu={start=1,min=0.1,max=20}}}",
        "solver.element=q1p0",
        "fit.workers=1",
    ]
    words = [word for key in keys for word in ("--set", key)]
    result = run(CASE / "case.toml", *words, "-o", "out", "--json", command="fit")
    assert result.exit_code == 4 and "40% of the largest force" in result.stderr
    mu = json.loads(result.stdout)["parameters"]["mu"]["value"]
    copy = read_case("out/case.toml", keys)
    assert copy.hash == read_case(CASE / "case.toml", keys).hash
    assert fit(copy).parameters["mu"].value == pytest.approx(mu, rel=1e-9)


@pytest.fixture
def made(manifest):
    """A case made from the manifest by --case."""
    Path("base").mkdir()
    base = tiny_case(
        Path("base"),
        sample={"diameter": 10.0, "thickness": 5.0},
        mesh={"elements": 40},
        material={"parameters": {"mu": {"start": 1.0, "min": 0.1, "max": 20.0}}},
        test=[{"name": "unused", "angle": 0, "depth": 0.1}],
    )
    result = run("-m", manifest, "--no-figures", "--case", "--base", base, "--target", "90=quadratic", "-o", "set")
    assert result.exit_code == 0, result.stderr
    return Path("set/case.toml")


@pytest.mark.usefixtures("undrawn")
def test_a_case_made_from_a_manifest_goes_straight_into_fit(made):
    tree = tomllib.loads(made.read_text())
    assert tree["sample"]["thickness"] == pytest.approx(3.1)  # mean of 3, 3.1, 3.2
    assert tree["sample"]["diameter"] == 14
    case = read_case(made)
    assert [(test.name, test.angle) for test in case.tests] == [("parallel", 0), ("perpendicular", 90)]
    slopes = [np.polyfit(curve.displacement, curve.force, 1)[0] for curve in case.curves]
    assert slopes == pytest.approx([66, 132], rel=0.02)
    result = run(made, "--set", "test.perpendicular.weight=0", "-o", "out", command="fit")
    assert result.exit_code == 0, result.stderr


@pytest.mark.usefixtures("undrawn")
def test_each_sample_is_fitted_on_its_own_and_the_spread_is_reported(made):
    """Weights leave the 0-degree curve; each mu is what a fit of its curve alone gives."""
    keys = ("test.perpendicular.weight=0", "test.parallel.weight=1")
    words = [word for key in keys for word in ("--set", key)]
    result = run(made, *words, "--per-sample", "-o", "each", "--json", command="fit")
    assert result.exit_code == 0, result.stderr
    written = json.loads(result.stdout)
    assert [sample["sample"] for sample in written["samples"]] == ["S0", "S1", "S2"]
    assert [sample["thickness_mm"] for sample in written["samples"]] == [3.0, 3.1, 3.2]
    mu = [sample["parameters"]["mu"]["value"] for sample in written["samples"]]
    assert written["spread"]["mu"]["n"] == 3
    assert written["spread"]["mu"]["mean"] == pytest.approx(np.mean(mu))
    assert written["spread"]["mu"]["sd"] == pytest.approx(np.std(mu, ddof=1))
    alone = [*keys, 'test.parallel.curve="curves/S2_0.csv"', 'test.perpendicular.curve="curves/S2_90.csv"', "sample.thickness=3.2"]
    last = fit(read_case(made, alone))
    assert last.parameters["mu"].value == pytest.approx(mu[2], rel=1e-9)
    result = PerSample.of([SampleFit("S2", last.case, last), SampleFit("S3", problem="it tears")], ["S2", ""])
    result.write("from_python")
    assert set(os.listdir("from_python")) == set(os.listdir("each")) - {"S0", "S1"}
    assert {"result.json", "fit.svg", "report.html"} <= set(os.listdir("from_python/S2"))
    with pytest.raises(OutputError, match="from_python"):
        result.write("from_python")
    with pytest.raises(OutputError, match="read from a file"):
        PerSample.from_json(result.as_json()).write("again")
    rows = list(csv.DictReader(Path("each/per_sample.csv").read_text().splitlines()))
    assert [float(row["mu"]) for row in rows] == pytest.approx(mu)
    assert Path("each/S1/result.json").is_file() and Path("each/S1/fit.svg").is_file()
    assert run(made, *words, "--per-sample", "-o", "each", command="fit").exit_code == 2  # nothing is overwritten unasked


@pytest.mark.usefixtures("undrawn")
def test_a_stopped_fit_of_samples_is_resumed_with_the_same_numbers(made, monkeypatch):
    """Stopped within the second of three samples: the first costs no run again, nothing differs in the end."""
    words = ("--set", "test.perpendicular.weight=0", "--per-sample", "--json")
    whole = json.loads(run(made, *words, "-o", "whole", command="fit").stdout)
    runs, model = [], Model.run

    def few(self, *arguments, **more):
        runs.append(1)
        if len(runs) == 11:  # 7 of the first sample: of the model made ready, both tests, and both with a model of another mesh
            raise KeyboardInterrupt
        return model(self, *arguments, **more)

    with monkeypatch.context() as patch:
        patch.setattr(Model, "run", few)
        stopped = run(made, *words, "-o", "each", command="fit")
    assert stopped.exit_code == 130 and "--resume" in stopped.stderr
    assert not Path("each").exists()
    refused = run(made, *words, "-o", "each", command="fit")
    assert refused.exit_code == 2 and "--resume" in refused.stderr
    other = run(made, "-o", "each", "--resume", command="fit")
    assert other.exit_code == 2 and "--per-sample" in other.stderr and len(other.stderr.splitlines()) == 1
    resumed = run(made, *words, "-o", "each", "--resume", command="fit")
    assert resumed.exit_code == 0, resumed.stderr
    assert json.loads(resumed.stdout) == whole
    first, second, last = (json.loads(Path(f"each/S{n}/result.json").read_text()) for n in range(3))
    assert first["reused"] == first["runs"] and 0 < second["reused"] < second["runs"] and last["reused"] == 0
    again = run(made, *words, "-o", "again", "--reuse", "each", command="fit")
    assert json.loads(again.stdout) == whole
    assert json.loads(Path("again/S2/result.json").read_text())["reused"] == last["runs"]


def test_per_sample_without_its_table_says_what_writes_it(made):
    table = made.parent / "replicates.csv"
    lines = table.read_text().splitlines()
    table.write_text("\n".join(line for line in lines if not line.startswith("S1,90")) + "\n")
    result = run(made, "--per-sample", command="fit")
    assert result.exit_code == 2 and "sample S1 has no curve of direction 90" in result.stderr
    table.unlink()
    result = run(made, "--per-sample", command="fit")
    assert result.exit_code == 2 and "process --case" in result.stderr


def test_a_set_of_a_gel_needs_no_directions(manifest, tmp_path):
    """mean stiffness of 60, 66 and 72 mN/mm: 66."""
    rows = [row.split(",") for row in manifest.read_text().splitlines() if ",90," not in row and "lost" not in row]
    plain = manifest.with_name("plain.csv")
    groups = ["Group", "treated", "control", "treated"]
    plain.write_text("\n".join(",".join([row[0], *row[2:], group]) for row, group in zip(rows, groups, strict=True)) + "\n")
    gel = tmp_path / "gel.toml"
    gel.write_text(
        template().replace("transversely_isotropic", "neo_hookean").replace("zeta =", "# zeta =").replace("phi =", "# phi =")
    )
    result = run("-m", plain, "--case", "-o", "set", "--base", gel)
    assert result.exit_code == 0, result.stderr
    summary = json.loads(Path("set/summary.json").read_text())
    assert summary["stiffness_mN_per_mm"]["0"]["mean"] == pytest.approx(66.0, rel=0.01)
    (test,) = read_case("set/case.toml").tests
    assert (test.name, test.angle) == ("press", None)
    specimens = read_specimens("set/replicates.csv")
    assert [specimen.curves for specimen in specimens] == [{None: f"curves/S{n}.csv"} for n in range(3)]
    assert read_groups("set/replicates.csv", "Group") == {"S0": "treated", "S1": "control", "S2": "treated"}
    (name, case), *_ = sample_cases("set/case.toml", specimens)
    assert name == "S0" and case.curves[0].force[-1] == pytest.approx(60.0 * case.curves[0].displacement[-1], rel=0.05)
    with pytest.raises(CaseError, match=r"test\.press\.angle: missing; the material has fibres"):
        read_case("set/case.toml", ["material.model=transversely_isotropic", "material.parameters={mu=1,zeta=1,phi=1}"])


def test_a_folder_stands_for_the_files_in_it(tmp_path):
    folder = tmp_path / "rig" / "records"
    folder.mkdir(parents=True)
    for name in ("S1_parallel.csv", "S1_perpendicular.csv"):
        shutil.copy(CASE / "records" / name, folder)
    (folder / "README.md").write_text("notes")
    (folder / "figures").mkdir()
    shutil.copy(CASE / "record.toml", tmp_path / "rig")  # beside the folder, as in the shipped case
    done = run(folder, "--no-figures", "-o", "out")
    assert done.exit_code == 0 and "reading as" in done.stderr and "left out" not in done.stderr, done.output
    assert [record["sample"] for record in json.loads(Path("out/summary.json").read_text())["records"]] == [
        "S1_parallel",
        "S1_perpendicular",
    ]
    listed = run(folder, "--list")
    assert listed.exit_code == 0 and "S1_perpendicular.csv" in listed.stdout
    none = run(folder / "figures")
    assert none.exit_code == 2 and "a folder without files that may be records" in none.stderr
    assert not Path("figures-processed").exists()


def test_a_case_given_as_a_record_is_called_what_it_is():
    done = run(CASE / "case.toml")
    assert done.exit_code == 2 and "a file of settings, no record" in done.stderr and "`indentfit fit`" in done.stderr
