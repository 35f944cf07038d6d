"""The benchmark problems: their forward curves against published limits, their files, and their score."""

import csv
import importlib
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
from fixtures.cases import CASES

from indentfit.experiment.measured import read_case

HERE = CASES / "benchmarks"
DEPTH = np.array([0.01, 0.03])


@pytest.fixture(scope="module")
def tools():
    """The modules of the collection."""
    sys.path.insert(0, str(HERE))
    try:
        yield {name: importlib.import_module(name) for name in ("forward", "problems", "score")}
    finally:
        sys.path.remove(str(HERE))


def test_a_thick_layer_is_a_half_space_and_a_thin_one_is_as_stiff_as_published(tools):
    """Hayes et al. 1972, J Biomech 5:541: F = 4 G a kappa / (1 - nu) of a flat punch."""
    forward = tools["forward"]
    sphere = forward.layer(9, 0.45, 400, True, lambda r: r**2 / 4, 1.0, DEPTH)
    assert np.allclose(sphere, forward.hertz(9, 0.45, 2, DEPTH), rtol=2e-3)
    for bonded, nu, a, kappa in ((True, 0.45, 0.4, 1.599), (True, 0.45, 1.0, 3.091), (False, 0.499999, 1.0, 2.199)):
        ratio = forward.layer(9, nu, 1, bonded, np.zeros_like, a, DEPTH) / forward.punch(9, nu, a, DEPTH)
        assert np.allclose(ratio, kappa, atol=1e-3)


def test_the_punch_that_sticks_is_stiffer_only_where_the_sample_is_compressible(tools):
    forward = tools["forward"]
    assert np.allclose(forward.sticking_punch(9, 0.4999, 1, DEPTH), forward.punch(9, 0.4999, 1, DEPTH), rtol=1e-3)
    assert np.all(forward.sticking_punch(9, 0.3, 1, DEPTH) > 1.02 * forward.punch(9, 0.3, 1, DEPTH))


def test_the_stiffness_with_fibres_has_the_moduli_of_the_law_and_without_them_is_isotropic(tools):
    """mu_along = mu (1 + phi), E_along = (1 + zeta) E_across, as the law says of itself."""
    forward, along = tools["forward"], np.array([1.0, 0, 0])
    assert np.allclose(forward.with_fibres(9 / 2.9, 0, 0, 9 / 0.3, along), forward.isotropic(9, 0.45))
    stiff = forward.with_fibres(1.5, 4.0, 0.7, 1e6, along)
    pairs = ((0, 0), (1, 1), (2, 2))
    compliance = np.linalg.inv([[stiff[(*a, *b)] for b in pairs] for a in pairs])
    assert stiff[0, 1, 0, 1] == pytest.approx(1.5 * 1.7) and stiff[1, 2, 1, 2] == pytest.approx(1.5)
    assert compliance[1, 1] / compliance[0, 0] == pytest.approx(5.0, rel=1e-4)


def test_there_are_twelve_problems_whose_cases_tell_everything_but_the_truth(tools):
    problems = tools["problems"].PROBLEMS
    assert len(problems) == 12 == len({problem.name for problem in problems})
    with open(HERE / "truth.csv", encoding="utf-8") as file:
        truths = list(csv.DictReader(file))
    for problem in problems:
        case = read_case(HERE / problem.name / "case.toml")
        assert case.synthetic == tuple(problem.curves)
        assert {row["parameter"]: float(row["truth"]) for row in truths if row["problem"] == problem.name} == problem.truth
        for name, value in problem.truth.items():
            known = case.free["mu" if name == "E" else name]
            truth = value / (2 * (1 + case.material.poisson_ratio)) if name == "E" else value
            assert known.min < truth < known.max and known.start != pytest.approx(truth, rel=0.05)


@pytest.mark.parametrize("name", ["cone_thick", "late_contact", "sticking_punch"])
def test_the_files_are_those_that_the_generator_writes(tools, tmp_path, name):
    problem = next(problem for problem in tools["problems"].PROBLEMS if problem.name == name)
    tools["problems"].write(problem, tmp_path)
    assert (tmp_path / "case.toml").read_text() == (HERE / name / "case.toml").read_text()
    for curve in problem.curves:
        made, stored = (np.loadtxt(place / f"{curve}.csv", delimiter=",", skiprows=1) for place in (tmp_path, HERE / name))
        assert np.allclose(made, stored, rtol=1e-4)


def test_the_score_counts_intervals_that_miss_and_answers_that_are_missing(tools):
    truths = [{"problem": problem, "parameter": "E", "truth": "9"} for problem in "abc"]
    answers = [
        {"problem": "a", "parameter": "E", "value": "9.9", "low": "9.5", "high": "10", "determined": "yes"},
        {"problem": "b", "parameter": "E", "value": "9", "low": "8", "high": "10", "determined": "no"},
    ]
    table = tools["score"].score(truths, answers)
    assert [row[6] for row in table] == ["NO", "yes", "-"] and table[0][4] == "+10.0"
    assert tools["score"].summary(table).startswith("2 of 3 parameters answered, 1 intervals hold the truth, 1 wrong ones")


def test_the_stored_answers_are_complete_tables():
    for tool, least in (("indentfit", 13), ("closed_forms", 10)):
        with open(HERE / "answers" / f"{tool}.csv", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
        assert len(rows) >= least and all(float(row["low"]) <= float(row["value"]) <= float(row["high"]) for row in rows)


def test_no_forward_curve_is_computed_by_indentfit():
    for name in ("forward.py", "problems.py"):
        assert "import indentfit" not in (HERE / name).read_text() and "from indentfit" not in (HERE / name).read_text()
    assert tomllib.loads((HERE / "strip" / "case.toml").read_text())["title"] == "benchmark: strip"


def test_the_benchmark_of_the_forward_solve_runs():
    """What wraps the solver's parts has their signatures."""
    script = Path(__file__).parent / "benchmarks" / "forward.py"
    done = subprocess.run([sys.executable, str(script), "solve", "--elements", "40"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "dofs, pardiso" in done.stdout or "dofs, superlu" in done.stdout
    assert "factorisation" in done.stdout
