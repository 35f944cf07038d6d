"""`indentfit fit`: what it prints, what it writes and how it ends."""

import json
import math
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from click.testing import CliRunner
from fixtures.cases import straight_curve, tiny_case

from indentfit.cli import main
from indentfit.curve import read_curve
from indentfit.errors import ConvergenceError
from indentfit.experiment.measured import read_case
from indentfit.fem.simulate import Model
from indentfit.inference.fit import fit
from indentfit.inference.result import WeightsFit
from indentfit.report import lasting_fit
from indentfit.report.text import weights_lines


@pytest.fixture
def case(tmp_path, monkeypatch):
    """One test of a material with one parameter: a fit costs a single run."""
    (tmp_path / "gel").mkdir()
    straight_curve(tmp_path / "gel" / "parallel.csv", 70)
    path = tiny_case(tmp_path / "gel", mesh={"elements": 60}, fit={"method": "ga"})
    monkeypatch.chdir(tmp_path)
    return path


def run(*arguments):
    return CliRunner().invoke(main, ["fit", *map(str, arguments)])


def test_a_fit_writes_its_folder_and_says_what_it_found(case, tmp_path):
    done = run(case)
    assert done.exit_code == 0, done.output
    folder = tmp_path / "gel-result"
    names = {path.name for path in folder.iterdir()}
    assert {"result.json", "report.html", "fields", "curves.csv", "fit.svg", "fit.png", "case.toml", "parallel.csv"} <= names
    assert (folder / "case.toml").read_text() == case.read_text()
    result = json.loads((folder / "result.json").read_text())
    mu = result["parameters"]["mu"]
    assert mu["min"] <= mu["interval"][0] < mu["value"] < mu["interval"][1] <= mu["max"]
    error = min(mu.get("total", math.inf), (mu["interval"][1] - mu["interval"][0]) / 4)
    assert f"{mu['value']:.{1 - math.floor(math.log10(error))}f} " in done.stdout  # two digits of the error
    assert mu["verdict"] in done.stdout
    assert "gel-result" in done.stdout
    assert "equation (1)" in done.stdout


@pytest.mark.usefixtures("undrawn")
def test_the_json_on_stdout_is_the_one_in_the_folder_and_keeps_its_keys(case, tmp_path):
    done = run(case, "--json", "-o", "r")
    result = json.loads(done.stdout)
    assert result == json.loads((tmp_path / "r" / "result.json").read_text())
    keys = (
        "format method seed success message parameters free objective sum_of_squares rmse misfit no_fit redchi covar "
        "correlation singular_values directions nfev runs reused seconds history failures notes solver mesh case_hash title "
        "versions written recording overrides noise profiles bootstrap tests_alone weights_scan uncertain rivals surrogate "
        "predicted published "
        "summary taken_as_known moduli closed_forms refined case posterior law_misfit"
    )
    assert set(result) == set(keys.split())
    assert result["format"] == "indentfit.fit/2"
    assert result["case_hash"] == read_case(case).hash
    # Equation (1) of the curves in curves.csv, by hand: one test of weight 1.
    rows = [line.split(",") for line in (tmp_path / "r" / "curves.csv").read_text().splitlines()]
    assert rows[0] == ["test", "displacement_mm", "force_mN", "measured_force_mN"]
    squares = [(float(row[2]) - float(row[3])) ** 2 for row in rows[1:]]
    assert result["objective"] == pytest.approx((sum(squares) / len(squares)) ** 0.5, rel=1e-9)
    assert [float(row[3]) for row in rows[1:]] == read_curve(case.parent / "parallel.csv").force.tolist()


@pytest.mark.usefixtures("undrawn")
def test_options_are_keys_of_the_case(case):
    result = json.loads(run(case, "--json", "--method", "least_squares", "--seed", 7).stdout)
    assert (result["method"], result["seed"]) == ("least_squares", 7)
    assert {"fit.method=least_squares", "fit.seed=7"} <= set(result["overrides"])


@pytest.mark.usefixtures("undrawn")
def test_errors_are_told_apart_and_weights_are_shown_where_asked(case):
    """One parameter: its error is the mesh's and the noise's, which together make the whole."""
    done = run(case, "--json", "-o", "r")
    result = json.loads(done.stdout)
    mesh, noise = result["uncertain"]["inputs"]["mesh"]["share"]["mu"], result["uncertain"]["noise"]["share"]["mu"]
    assert mesh > 0 and noise > 0
    assert mesh + noise == pytest.approx(1, rel=1e-9)
    mu = result["parameters"]["mu"]
    assert mu["stderr"] == pytest.approx(noise**0.5 * mu["stderr_total"], rel=1e-9)
    text = run(case, "--overwrite", "-o", "r").stdout
    assert "mesh (forces" in text and f"{mesh:.1%}" in text and "weights" not in text
    assert "weights   no scan" in run(case, "--overwrite", "-o", "r", "--scan-weights").stdout


@pytest.mark.usefixtures("undrawn")
def test_a_scan_of_weights_is_a_table_of_fits():
    rows = [WeightsFit((w, 1 - w), {"mu": 1 + w}, {"a": 1 - w, "b": w}) for w in (0.25, 0.5)]
    lines = list(weights_lines(SimpleNamespace(curves={}, weights_scan=rows, free=["mu"])))
    assert [" ".join(line.split()) for line in lines[1:]] == ["0.25 : 0.75 1.25 0.75 0.25", "0.5 : 0.5 1.5 0.5 0.5"]
    assert "RMSE b, mN" in lines[0]


def test_a_folder_that_exists_is_refused_before_any_run(case, tmp_path, monkeypatch):
    (tmp_path / "gel-result").mkdir()
    monkeypatch.setattr(lasting_fit, "fit", lambda *_, **__: pytest.fail("a run was started"))
    done = run(case)
    assert done.exit_code == 2
    assert "gel-result" in done.stderr
    assert len(done.stderr.splitlines()) == 1


@pytest.mark.parametrize(
    "arguments",
    [
        ["--set", "material.mu=1"],
        ["--set", "test.parallel.depth=0.2"],
        ["--workers", "0"],
        ["--method", "annealing"],
        ["--seed", "-1"],
        ["-o", "no/such/folder"],
    ],
)
def test_wrong_input_ends_with_2_and_leaves_nothing(case, tmp_path, arguments):
    assert run(case, *arguments).exit_code == 2
    assert [path.name for path in tmp_path.iterdir()] == ["gel"]


@pytest.mark.usefixtures("undrawn")
def test_a_fit_that_does_not_converge_ends_with_4_and_is_written(case, tmp_path, monkeypatch):
    def never(self, *_, **__):
        raise ConvergenceError("the gel tears", 0.1, 3, 4)

    monkeypatch.setattr(Model, "run", never)
    done = run(case)
    assert done.exit_code == 4
    assert "the gel tears" in done.stderr
    result = json.loads((tmp_path / "gel-result" / "result.json").read_text())
    assert result["success"] is False
    assert result["objective"] is None
    assert "the gel tears" in result["failures"][0]["cause"]


@pytest.mark.usefixtures("undrawn")
def test_an_earlier_result_is_replaced_when_asked(case):
    assert run(case).exit_code == 0
    assert run(case).exit_code == 2
    assert run(case, "--overwrite").exit_code == 0


@pytest.mark.usefixtures("undrawn")
def test_warnings_go_to_stderr(case):
    done = run(case, "--json", "--set", "material.kappa=5")
    json.loads(done.stdout)
    assert "warning" in done.stderr


def test_a_script_can_fit_without_the_command_line(case):
    result = fit(read_case(case))
    assert result.free == ("mu",)
    assert result.curves["parallel"].force.shape == (5,)


def test_the_quickstart_comes_back_to_its_truth_within_its_intervals(tmp_path):
    quickstart = Path(__file__).parent.parent / "cases" / "quickstart" / "case.toml"
    program = [sys.executable, "-P", "-c", "from indentfit.cli import main; main()"]
    command = [*program, "fit", str(quickstart), "--json", "-o", str(tmp_path / "r")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    parameters = json.loads(done.stdout)["parameters"]
    for name, truth in {"mu": 1.2, "zeta": 3.0, "phi": 0.8}.items():
        low, high = parameters[name]["interval"]
        assert low <= truth <= high
    assert parameters["mu"]["value"] == pytest.approx(1.2, rel=0.01)
