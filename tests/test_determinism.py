"""The same case, seed and mesh give the same result: on one and two workers, with and without --resume, with every solver."""

import contextlib
import json
import os
import shutil
import signal
import sqlite3
import subprocess
import sys
import time

import numpy as np
import pytest
from fixtures.cases import CASES

from indentfit.experiment.measured import read_case
from indentfit.runs.forward import simulate

QUICK = CASES / "quickstart" / "case.toml"
TINY = ["mesh.elements=30", "material.phi=0.8", "fit.method=ga", "fit.population=6", "fit.generations=3", "fit.seed=7"]
PROGRAM = [sys.executable, "-P", "-c", "from indentfit.cli import main; main()", "fit", str(QUICK), "--no-fields"]
MAY_DIFFER = ("seconds", "reused", "solver", "overrides", "case")  # times, what the ledger saved, workers


def words(workers, output):
    return [*PROGRAM, *(word for key in [*TINY, f"fit.workers={workers}"] for word in ("--set", key)), "-o", str(output)]


def result(folder):
    found = json.loads((folder / "result.json").read_text())
    return {key: value for key, value in found.items() if key not in MAY_DIFFER}, (folder / "curves.csv").read_bytes()


@pytest.fixture(scope="module")
def one(tmp_path_factory):
    folder = tmp_path_factory.mktemp("one") / "out"
    subprocess.run(words(1, folder), check=True, capture_output=True)
    return result(folder)


def test_two_workers_give_the_result_of_one_bit_by_bit_whatever_the_hash_seed(one, tmp_path):
    environment = os.environ | {"PYTHONHASHSEED": "1"}
    subprocess.run(words(2, tmp_path / "out"), check=True, capture_output=True, env=environment)
    assert result(tmp_path / "out") == one


def runs(ledger):
    """The number of runs in a ledger, by a copy (the fit has it for itself) whose last run may not be there to stay."""
    copied = ledger.parent.parent / "copied.sqlite"
    try:
        shutil.copy(ledger, copied)
        with contextlib.closing(sqlite3.connect(copied)) as file:
            return file.execute("SELECT count(*) FROM runs").fetchone()[0]
    except (OSError, sqlite3.Error):  # not there yet, or copied while it was being written
        return 0


@pytest.mark.campaign
def test_a_fit_killed_on_two_workers_and_resumed_on_one_gives_it_bit_by_bit(one, tmp_path):
    ledger, out = tmp_path / ".out.unfinished" / "ledger.sqlite", tmp_path / "out"
    process = subprocess.Popen(words(2, out), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    until = time.monotonic() + 120
    while runs(ledger) < 2 and process.poll() is None and time.monotonic() < until:
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert ledger.exists() and not out.exists()  # killed with some runs done, before its end
    done = subprocess.run([*words(1, out), "--resume"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert json.loads((out / "result.json").read_text())["reused"] > 0
    assert result(out) == one


@pytest.mark.parametrize("element", ["q1p0", "q2p1"])
def test_pardiso_and_superlu_give_forces_within_a_millionth(element):
    """With soft springs: under stiff ones points chatter, a path may take other steps, and splines through those differ by 1e-4.
    Forces of equilibria differ by the residual that is left."""
    pytest.importorskip("pypardiso")
    forces = {}
    for linear in ("pardiso", "superlu"):
        keys = "mesh.elements=60", "solver.penalty=0.2", "solver.tolerance=1e-8"
        case = read_case(QUICK, [*keys, f"solver.element={element}", f"solver.linear={linear}"])
        found = simulate(case)
        assert found.solver.linear == linear
        forces[linear] = np.array([test.force for test in found.tests])
    assert np.abs(forces["superlu"] - forces["pardiso"]).max() <= 1e-6 * np.abs(forces["pardiso"]).max()
