"""The commands on the smallest case: each ends well and says what it should. The first thing to run after any change."""

import json

import pytest
from click.testing import CliRunner
from fixtures.cases import CASES

from indentfit.cli import main

pytestmark = pytest.mark.quick

QUICK = str(CASES / "quickstart" / "case.toml")
COARSE = ("--set", "mesh.elements=20", "--set", "fit.workers=1", "--set", "fit.profiles=false")


def command(*words):
    done = CliRunner().invoke(main, [str(word) for word in words])
    assert done.exit_code == 0, done.output
    return done.stdout


def test_a_case_is_valid():
    assert "free parameters: mu, zeta, phi" in command("validate", QUICK)


def test_a_fit_is_near_its_known_truth_and_is_drawn(tmp_path):
    folder = tmp_path / "result"
    result = json.loads(command("fit", QUICK, *COARSE, "-o", folder, "--json"))
    assert result["success"]
    assert result["parameters"]["mu"]["value"] == pytest.approx(1.2, rel=0.25)
    assert "mu" in (folder / "report.html").read_text()
    command("report", folder)


def test_a_sweep_and_a_simulation_run(tmp_path):
    words = (QUICK, "--set", "mesh.elements=20")
    assert len(json.loads(command("simulate", *words, "--json"))["tests"]) == 2
    command("sweep", *words, "--vary", "indenter.friction=0.2", "-o", tmp_path / "sweep")
