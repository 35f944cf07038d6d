"""A fit that is killed, stopped or disturbed: `--resume` ends with the same numbers, and everything else in one line."""

import json
import os
import random
import shutil
import signal
import sqlite3
import subprocess
import sys
import time
from pathlib import Path

import pytest
from click.testing import CliRunner
from fixtures.cases import MU, ZETA, straight_curve, tiny_case, two_tests

from indentfit.cli import main
from indentfit.errors import ConvergenceError
from indentfit.fem.simulate import Model
from indentfit.report import fit_folder
from indentfit.report.folder import LEDGER, unfinished

pytestmark = pytest.mark.usefixtures("undrawn")

MAY_DIFFER = ("seconds", "reused", "solver")  # between a fit and the same one resumed: the solver's facts hold times


@pytest.fixture
def case(tmp_path, monkeypatch):
    """The current folder has a case.toml of two tests."""
    write_case(tmp_path)
    monkeypatch.chdir(tmp_path)


def write_case(folder, **more):
    """A case of two tests; without profiles and the error of the mesh, unless `more` keys of [fit] say so."""
    fit = {"method": "ga", "population": 4, "generations": 3, "profiles": False, "uncertain": {"mesh": 0.0}, **more}
    material = {"model": "transversely_isotropic", "parameters": {"mu": MU, "zeta": ZETA, "phi": 0.5}}
    tiny_case(folder, indenter={"friction": 0.3}, material=material, test=two_tests(across="across"), fit=fit)
    straight_curve(folder / "parallel.csv", 80)
    straight_curve(folder / "across.csv", 150)


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    """The result folder of the fit that nothing disturbs."""
    folder = tmp_path_factory.mktemp("undisturbed")
    write_case(folder)
    done = CliRunner().invoke(main, ["fit", str(folder / "case.toml"), "-o", str(folder / "r"), "--no-fields"])
    assert done.exit_code == 0, done.output
    return folder / "r"


@pytest.fixture
def expected(undisturbed):
    return result(undisturbed)


def run(*arguments):
    return CliRunner().invoke(main, ["fit", "case.toml", "-o", "r", "--no-fields", *arguments])


def started(*arguments):
    """A fit in a process of its own, at work: its unfinished folder has a ledger."""
    command = [sys.executable, "-P", "-c", "from indentfit.cli import main; main()", "fit", "case.toml", "-o", "r", "--no-fields"]
    process = subprocess.Popen([*command, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    end = time.monotonic() + 120
    while not (unfinished("r") / LEDGER).exists() and process.poll() is None and time.monotonic() < end:
        time.sleep(0.01)
    return process


def wait_for_workers(process):
    """Until a fit has started its worker processes: two, behind their server and Python's own tracker of resources."""
    place, end = children(process.pid), time.monotonic() + 60
    time.sleep(0 if place.exists() else 3)  # not on Linux
    while place.exists() and len(descendants(process.pid)) < 4 and time.monotonic() < end:
        time.sleep(0.01)


def children(pid):
    """The file with the children of a process, on Linux."""
    return Path(f"/proc/{pid}/task/{pid}/children")


def descendants(pid):
    """The children of a process, and theirs."""
    try:
        first = children(pid).read_text().split()
    except OSError:
        return []  # it has ended
    return first + [later for child in first for later in descendants(child)]


def result(folder="r"):
    """What result.json holds but times, and the fitted curves."""
    same = {key: value for key, value in written(folder).items() if key not in MAY_DIFFER}
    return same | {"curves.csv": Path(folder, "curves.csv").read_text()}


def without_workers(known):
    """A result without what says how many workers it had."""
    fit = {**known["case"]["fit"], "workers": 0}
    return {**known, "overrides": 0, "case": {**known["case"], "fit": fit}}


def written(folder="r"):
    return json.loads(Path(folder, "result.json").read_text())


def kept():
    """The number of runs in the ledger of the unfinished fit."""
    with sqlite3.connect(unfinished("r") / LEDGER) as file:
        count = file.execute("SELECT count(*) FROM runs").fetchone()[0]
    file.close()
    return count


def stop_after(number, monkeypatch):
    """Let the fit's own process be stopped, as by kill, once so many runs are done."""
    whole, done = Model.run, []

    def run(self, *arguments, **more):
        done.append(1)
        if len(done) == number + 1:
            os.kill(os.getpid(), signal.SIGTERM)
        return whole(self, *arguments, **more)

    monkeypatch.setattr(Model, "run", run)


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.campaign)])
def test_kill_9_at_a_random_moment_then_resume_gives_the_same_numbers(case, undisturbed, expected, seed):
    process = started("--workers", "2" if seed == 0 else "1")
    time.sleep(random.Random(seed).uniform(0, written(undisturbed)["seconds"]))  # one in a process of its own needs longer
    process.kill()
    process.wait()
    if unfinished("r").exists():  # else it was quicker
        done = run("--resume", "--workers", "1")
        assert done.exit_code == 0, done.output
    assert without_workers(result()) == without_workers(expected)
    assert not unfinished("r").exists()


def test_the_first_signal_ends_the_run_at_work_and_resuming_ends_the_fit(case, expected, monkeypatch):
    with monkeypatch.context() as patch:
        stop_after(5, patch)
        stopped = run()
    assert stopped.exit_code == 128 + signal.SIGTERM
    assert stopped.stderr.splitlines()[-1].startswith("error: the fit was stopped")
    assert "6 runs are kept, --resume" in stopped.stderr
    assert not os.path.exists("r")
    assert kept() == 6
    again = run()
    assert again.exit_code == 2
    assert again.stderr.count("\n") == 1
    assert "--resume" in again.stderr
    assert "--overwrite" in again.stderr
    assert run("--resume").exit_code == 0
    assert result() == expected
    assert written()["reused"] == 6
    assert [path for path in os.listdir() if path.startswith(".")] == []


def test_ctrl_c_twice_stops_at_once_and_leaves_no_process(case):
    process = started("--workers", "2", "--set", "mesh.elements=2000")
    wait_for_workers(process)
    workers = descendants(process.pid)
    process.send_signal(signal.SIGINT)
    time.sleep(0.2)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=30)
    assert process.returncode == 130
    assert "a second signal stops at once" in said
    assert said.splitlines()[-1].startswith("error: the fit was stopped at once")
    assert not unfinished("r").exists()  # nothing was done yet
    end = time.monotonic() + 20
    while any(map(alive, workers)) and time.monotonic() < end:
        time.sleep(0.05)
    assert not any(map(alive, workers))


def alive(pid):
    """Whether a process is there, and no zombie."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def test_two_fits_cannot_write_to_one_folder(case):
    process = started("--set", "mesh.elements=2000")
    try:
        for more in ([], ["--resume"], ["--overwrite"]):
            other = run(*more)
            assert other.exit_code == 2
            assert len(other.stderr.splitlines()) == 1
            assert "in use by another run" in other.stderr
        assert process.poll() is None
    finally:
        process.kill()
        process.wait()


@pytest.fixture
def stopped(case, monkeypatch):
    """A fit that was stopped after 4 runs."""
    with monkeypatch.context() as patch:
        stop_after(3, patch)
        assert run().exit_code == 143
    return unfinished("r") / LEDGER


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda path: path.write_bytes(path.read_bytes()[:-5000]), "damaged"),
        (lambda path: path.write_bytes(path.read_bytes()[:18] + b"\7\7" + path.read_bytes()[20:]), "ledger.sqlite"),
    ],
)
def test_a_spoilt_ledger_is_refused_in_one_line_and_overwrite_begins_anew(stopped, spoil, said):
    spoil(stopped)
    refused = run("--resume")
    assert refused.exit_code == 2
    assert len(refused.stderr.splitlines()) == 1
    assert said in refused.stderr
    anew = run("--overwrite")
    assert anew.exit_code == 0, anew.output
    assert result()["success"]


def test_a_run_with_a_flipped_bit_is_run_again(stopped, expected):
    whole = stopped.read_bytes()
    with sqlite3.connect(stopped) as file:
        (force,) = file.execute("SELECT force FROM runs LIMIT 1").fetchone()
    file.close()
    place = whole.index(force) + 6
    stopped.write_bytes(whole[:place] + bytes([whole[place] ^ 1]) + whole[place + 1 :])
    done = run("--resume")
    assert done.exit_code == 0
    assert "1 damaged runs were thrown away" in done.stderr
    assert written()["reused"] == 3
    assert result() == expected


def test_another_case_does_not_resume_it(stopped):
    refused = run("--resume", "--set", "test.across.weight=0.9")
    assert refused.exit_code == 2
    assert "belongs to another case" in refused.stderr
    assert len(refused.stderr.splitlines()) == 1
    assert kept() == 4


def test_resume_without_an_unfinished_fit_says_so_and_begins(case):
    done = run("--resume", "--method", "least_squares")
    assert done.exit_code == 0
    assert "it starts from its beginning" in done.stderr
    assert run("--resume").exit_code == 2  # the result is there


def test_a_second_fit_takes_its_runs_from_the_first(case, tmp_path):
    """Those of the search, of the profiles and of the mesh's error."""
    write_case(tmp_path, profiles=True, uncertain=None)
    assert run().exit_code == 0
    first = written()
    other = CliRunner().invoke(main, ["fit", "case.toml", "-o", "s", "--no-fields", "--reuse", "r", "--json"])
    second = json.loads(other.stdout)
    assert second["reused"] == second["runs"] == first["runs"]
    assert second["parameters"] == first["parameters"]
    replaced = run("--overwrite", "--set", "test.across.weight=0.6", "--set", "fit.profiles=false", "--json")
    assert json.loads(replaced.stdout)["reused"] >= 8
    wrong = CliRunner().invoke(main, ["fit", "case.toml", "-o", "t", "--reuse", "nowhere"])
    assert wrong.exit_code == 2
    assert "nowhere" in wrong.stderr
    assert not unfinished("t").exists()


def test_a_folder_taken_away_under_a_run_ends_in_one_line(case, monkeypatch):
    whole, done = Model.run, []

    def run_and_remove(self, *arguments, **more):
        done.append(1)
        if len(done) == 5:
            shutil.rmtree(unfinished("r"))
        return whole(self, *arguments, **more)

    monkeypatch.setattr(Model, "run", run_and_remove)
    lost = run()
    assert lost.exit_code == 2
    (said,) = (line for line in lost.stderr.splitlines() if not line.startswith("fit: "))  # a slow machine tells its progress too
    assert "r.unfinished" in said


def test_a_disk_that_fills_up_while_the_result_is_written_loses_nothing(case, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(fit_folder, "write_curves", full)
        refused = run()
    assert refused.exit_code == 2
    assert refused.stderr.splitlines()[-1].startswith("error: r: cannot be written (No space left on device)")
    done = run("--resume")
    assert done.exit_code == 0
    found = written()
    assert found["reused"] == found["runs"]


def test_a_mesh_that_cannot_be_leaves_nothing_behind(case, monkeypatch):
    monkeypatch.setattr(Model, "run", lambda *_, **__: (_ for _ in ()).throw(ConvergenceError("it tears", 0.1, 1, 1)))
    assert run().exit_code == 4  # a failure of the mechanics is a result, and is written
    assert not unfinished("r").exists()
    assert run("--overwrite", "--set", "fit.time_limit=-1").exit_code == 2
    assert not unfinished("r").exists()


def test_a_long_or_odd_name_has_its_unfinished_folder_too(case):
    name = "ü b" * 60
    done = CliRunner().invoke(main, ["fit", "case.toml", "-o", name, "--no-fields", "--method", "least_squares"])
    assert done.exit_code == 0, done.output
    assert os.path.exists(f"{name}/{LEDGER}")
    assert unfinished("x" * 200) != unfinished("x" * 201)


def test_one_cluster_at_a_time(case):
    assert run("--cluster", "local", "--scheduler", "tcp://127.0.0.1:1").exit_code == 2
