"""A Dask cluster: nobody else is spoken to than the scheduler whose address is given, and a wrong address is said in one line."""

import gc
import json
import subprocess
import sys
import time

import pytest
from click.testing import CliRunner
from fixtures.cases import CASES, tiny_case

from indentfit.cli import main
from indentfit.errors import WorkerError
from indentfit.experiment.measured import read_case
from indentfit.runs import cluster as clusters
from indentfit.runs.mechanics import mechanics_of
from indentfit.runs.run import RunRequest

distributed = pytest.importorskip("distributed")

CASE = CASES / "quickstart" / "case.toml"
WATCHED = """
import json, socket, sys

seen = {"connected": set(), "asked": set(), "listening": set(), "started": set()}

def watch(event, words):
    if event == "socket.connect" and words[0].family != socket.AF_UNIX and words[0].type == socket.SOCK_STREAM:
        seen["connected"].add("%s:%s" % words[1][:2])
    elif event in ("socket.getaddrinfo", "socket.gethostbyname"):
        seen["asked"].add(str(words[0]))
    elif event == "socket.bind":
        seen["listening"].add(str(words[1]))
    elif event in ("subprocess.Popen", "os.fork", "os.posix_spawn", "os.system") and words[0] != "uname":  # by `platform`
        seen["started"].add(str(words))

sys.addaudithook(watch)

import multiprocessing
from indentfit.experiment.measured import read_case
from indentfit.runs.pool import RunPool

if __name__ == "__main__":
    case = read_case(sys.argv[1], ["mesh.elements=30"])
    with RunPool(case, cluster=sys.argv[2]) as pool:
        (evaluation,) = pool.evaluate([case.start_values()])
        seen["started"] |= {str(child) for child in multiprocessing.active_children()}
    assert evaluation.cause is None, evaluation.cause
    print(json.dumps({what: sorted(places) for what, places in seen.items()}))
"""


@pytest.fixture(autouse=True)
def no_client_is_left():
    """A client that could not connect ends when it is collected; within the start of the next one that is a deadlock in Dask."""
    yield
    gc.collect()


def test_with_an_address_nobody_else_is_connected_to_and_nothing_is_started(tmp_path):
    """The interpreter's own audit of a program that runs on a cluster: every stream socket, name, bound port and process."""
    (tmp_path / "watched.py").write_text(WATCHED)
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, protocol="tcp", host="127.0.0.1", dashboard_address=None,
        silence_logs=50,
    ) as there:  # fmt: skip
        words = [sys.executable, "-P", tmp_path / "watched.py", CASE, there.scheduler_address]
        done = subprocess.run(words, capture_output=True, text=True, timeout=120, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    address = there.scheduler_address.removeprefix("tcp://")
    seen = json.loads(done.stdout)
    assert set(seen.pop("asked")) <= {"127.0.0.1"}
    assert seen == {"connected": [address], "listening": [], "started": []}


def test_a_cluster_whose_last_worker_leaves_is_waited_for_no_longer_than_patience(tmp_path, monkeypatch):
    """Dask itself would wait for another worker without end."""
    monkeypatch.setattr(clusters, "PATIENCE", 2)
    case = read_case(tiny_case(tmp_path, test=[{"name": "parallel", "angle": 0, "depth": 0.1, "points": 2}]))
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, protocol="tcp", host="127.0.0.1", dashboard_address=None,
        silence_logs=50,
    ) as there:  # fmt: skip
        pool = clusters.Cluster(mechanics_of(case), there.scheduler_address, 1, 60.0)
        there.scale(0)
        until = time.monotonic() + 30
        while there.scheduler.workers and time.monotonic() < until:
            time.sleep(0.05)
        with pytest.raises(WorkerError, match="no workers for 2 s") as error:
            list(pool.solve([RunRequest((("mu", 1.0),), 0)], bool))
        pool.close(now=True)
    assert "\n" not in str(error.value) and there.scheduler_address in str(error.value)


@pytest.mark.parametrize(
    "address",
    [
        "tcp://127.0.0.1:9", "127.0.0.1:9", "tcp://127.0.0.1", "tcp://", "tcp://127.0.0.1:99999", "tcp://127.0.0.1:port",
        "http://127.0.0.1:9", "inproc://1.2.3.4/5/6", "no-such-host.invalid:8786", "\u202e:1", "a b", "x" * 5000,
    ],
)  # fmt: skip
def test_a_wrong_address_is_one_line_and_leaves_nothing(address, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(clusters, "PATIENCE", 1)
    done = CliRunner().invoke(main, ["fit", str(CASE), "--set", "mesh.elements=30", "--scheduler", address])
    said = [line for line in done.stderr.splitlines() if not line.startswith("warning: ")]
    assert done.exit_code == 2 and len(said) == 1, done.stderr
    assert said[0].startswith(f"error: --scheduler {address[:50]}") and len(said[0]) < 500
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("command", [["fit"], ["sweep", "--vary", "indenter.friction=0.2"]], ids=lambda command: command[0])
def test_an_address_without_text_is_refused_and_not_taken_for_none(tmp_path, monkeypatch, command):
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(main, [*command, str(CASE), "--set", "mesh.elements=30", "--scheduler", ""])
    assert done.exit_code == 2 and "--scheduler" in done.stderr and list(tmp_path.iterdir()) == []


def test_no_other_kind_of_cluster_is_started():
    done = CliRunner().invoke(main, ["fit", str(CASE), "--cluster", "somewhere"])
    assert done.exit_code == 2 and "'somewhere' is not 'local'" in done.stderr
