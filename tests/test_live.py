"""The page of a running fit: what it reads from the ledger of another process, and whom the server answers."""

import http.client
import re
import socket
import subprocess
import sys

import pytest
from click.testing import CliRunner
from fixtures.cases import straight_curve, tiny_case

from indentfit.cli import main
from indentfit.experiment.measured import read_case
from indentfit.report.live import LiveFit, fragment
from indentfit.report.live_server import served
from indentfit.runs.ledger import Ledger
from indentfit.runs.onlooking import runs_so_far
from indentfit.runs.run import Run


@pytest.fixture
def case(tmp_path):
    straight_curve(tmp_path / "parallel.csv", 70)
    return read_case(tiny_case(tmp_path, mesh={"elements": 60}))


def forces_at(case, mu):
    """A model whose forces are 10 mu times the displacement, for mu in kPa: the measured 70 mN/mm ask for 7 kPa."""
    depths = case.curves[0].displacement
    return Run(10 * mu * depths, None, 1.0, {})


def test_the_best_set_of_a_ledger_is_that_of_the_truth(case, tmp_path):
    with Ledger(tmp_path / "ledger.sqlite", case) as ledger:
        fit = LiveFit(case, tmp_path / "ledger.sqlite")
        fit.look()
        assert fit.best is None and "0 runs so far" in fragment(fit)
        start = {**case.start_values(), "mu": 2.0}
        ledger.add(start, case.tests[0], forces_at(case, 2.0))
        fit.look()
        # forces are proportional to mu: the run tells of every mu
        assert fit.best.values["mu"] == pytest.approx(7.0, rel=1e-6)
        assert fit.best.error < 1e-6
        ledger.add({**start, "mu": 3.0}, case.tests[0], Run(None, "lost contact", 1.0, {}))
        fit.look()
        assert (fit.runs, fit.failed, len(fit.sets)) == (2, 1, 1)
    text = fragment(fit)
    assert "2 runs so far, of which 1 gave no curve" in text and text.count("<svg") == 3  # fit, residuals, profile of mu


def test_a_ledger_that_cannot_be_read_now_gives_no_runs(tmp_path):
    assert runs_so_far(tmp_path / "none.sqlite") == []
    (tmp_path / "half.sqlite").write_bytes(b"SQLite format 3\0" + bytes(50))
    assert runs_so_far(tmp_path / "half.sqlite") == []


def answer(address, path="/", host=None):
    name, port = re.match(r"http://([\d.]+):(\d+)/", address).groups()
    line = http.client.HTTPConnection(name, int(port), timeout=10)
    line.request("GET", path, headers={"Host": host} if host else {})
    reply = line.getresponse()
    text = reply.read().decode()
    line.close()
    return reply.status, text, reply.headers


def test_the_page_is_for_this_machine_and_ends_with_its_block():
    with served("gel <b>", lambda: "<p>so far</p>") as address:
        assert address.startswith("http://127.0.0.1:")
        status, page, headers = answer(address)
        assert status == 200 and "<p>so far</p>" in page and "<h1>gel &lt;b&gt;</h1>" in page
        assert "default-src 'none'" in headers["Content-Security-Policy"]
        assert not re.findall(r"(?:src|href)=", page)  # nothing is fetched from elsewhere
        assert answer(address, "/now")[1] == "<p>so far</p>"
        assert answer(address, "/../pyproject.toml")[0] == 404
        assert answer(address, host="other.example:80")[0] == 403
        port = int(address.rstrip("/").rpartition(":")[2])
    with pytest.raises(OSError), socket.create_connection(("127.0.0.1", port), timeout=2):
        pass


def test_the_page_beside_a_fit_ends_with_its_standard_input(case, tmp_path):
    words = [sys.executable, "-P", "-m", "indentfit", "watch", str(case.path), "-o", str(tmp_path / "out"), "--child"]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as page:
        address = page.stdout.readline().strip()
        assert "no set of parameters is complete yet" in answer(address)[1]
        page.stdin.close()
        assert page.wait(20) == 0


def test_the_page_runs_no_code_that_the_fit_refuses_to_run(tmp_path, monkeypatch):
    started = []

    def refuse(words, **_):
        started.append(words)
        raise OSError("no process here")

    monkeypatch.setattr(subprocess, "Popen", refuse)
    for options in ([], ["--no-plugins"]):
        CliRunner().invoke(main, [*options, "fit", str(tmp_path / "none.toml"), "--live"])
    assert ["--no-plugins" in words for words in started] == [False, True]
