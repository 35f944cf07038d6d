"""The workers: whatever happens to one, or to what it runs, the numbers are the same or the failure is recorded."""

import json
import os
import platform
import signal
import subprocess
import sys
import time
from functools import partial
from multiprocessing import active_children
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from fixtures.cases import CASES, MU, ZETA, straight_curve, tiny_case, two_tests

from indentfit.errors import Stopped, WorkerError
from indentfit.experiment.measured import read_case
from indentfit.fem.facts import SolveFacts
from indentfit.fem.simulate import Model
from indentfit.inference.fit import fit
from indentfit.runs import start
from indentfit.runs.ledger import Ledger
from indentfit.runs.mechanics import mechanics_of
from indentfit.runs.pool import InProcess, RunPool, is_foreign
from indentfit.runs.processes import Processes
from indentfit.runs.run import Run, RunRequest

# Tame up to zeta = 4. Above, what each test asks for happens in the middle of a run.
WILD = """
import os, signal, sys
from pathlib import Path
import numpy as np
from indentfit.material import Material, Parameter

class Wild(Material):
    mu = Parameter("kPa", "shear modulus", min=0, scale=True)
    zeta = Parameter("1", "fibre stiffness", min=0)

    def energy(self, I1, I4):
        return self.mu / 2 * ((I1 - 3) + self.zeta * (I4 - 1) ** 2)

    def gradient(self, I):
        found = super().gradient(I)
        return self.wild(found) if self.zeta > 4 and np.ndim(I) > 1 else found

    def wild(self, found):
        WHAT
"""
TAME, OTHER, BAD = {"mu": 1.0, "zeta": 3.0}, {"mu": 1.0, "zeta": 1.0}, {"mu": 1.0, "zeta": 5.0}
LOOP = "while True: pass"
BARE = "fit.profiles=false", "fit.uncertain.mesh=0"  # a fit is its search
ONE_TEST = "test=[{name='parallel', angle=0, curve='parallel.csv'}]"


@pytest.fixture
def case(tmp_path):
    """case(*overrides, wild=): a case of 2 tests whose material does something wild above zeta = 4."""

    def case(*overrides, wild="return found"):
        path = tiny_case(
            tmp_path,
            material={"model": "wild.py:Wild", "parameters": {"mu": MU, "zeta": ZETA}},
            test=two_tests(across="across"),
            fit={"method": "ga", "population": 4, "generations": 2},
        )
        (tmp_path / "wild.py").write_text(WILD.replace("WHAT", wild.replace("FOLDER", str(tmp_path))))
        straight_curve(tmp_path / "parallel.csv", 80)
        straight_curve(tmp_path / "across.csv", 130)
        return read_case(path, overrides)

    return case


@pytest.fixture
def in_process(monkeypatch):
    """A pool of one worker is this process, also for a law of others: the laws here raise, and then the process goes on."""
    monkeypatch.setattr("indentfit.runs.pool.is_foreign", lambda law: False)


# What a material may do


@pytest.mark.parametrize(
    ("wild", "said"),
    [
        ("raise ZeroDivisionError('by nothing')", "ZeroDivisionError: by nothing"),
        ("sys.exit(3)", "SystemExit: 3"),
        ("return found * np.nan", ""),
        ("return found[:2]", ""),
        ("return found * 1j", ""),
        ("return 'a text'", ""),
        ("return None", ""),
        ("raise MemoryError", "out of memory"),
    ],
)
def test_what_a_material_does_is_a_failure_with_a_cause_and_the_others_go_on(case, in_process, wild, said):
    with RunPool(case(wild=wild)) as pool:
        failed, fine = pool.evaluate([BAD, TAME])
    assert failed.forces is None
    assert failed.cause.startswith("test 'parallel': ")
    assert said in failed.cause
    assert "\n" not in failed.cause
    assert pool.failures == [failed]
    assert np.array_equal(fine.forces[0], tame(case).forces[0])


@pytest.mark.parametrize("wild", [LOOP, pytest.param("import time; time.sleep(1e6)", marks=pytest.mark.campaign)])
def test_one_worker_runs_a_law_of_others_in_a_process_that_can_be_ended(case, monkeypatch, wild):
    """A law's own endless loop, and one that only sleeps and so uses no processor time."""
    monkeypatch.setattr("indentfit.runs.watch.PATIENCE", 3.0)
    with RunPool(case("fit.time_limit=1", ONE_TEST, wild=wild)) as pool:
        failed, fine = pool.evaluate([BAD, TAME])
    assert "not solved within 1 s" in failed.cause and failed.lost
    assert fine.forces is not None


def test_our_own_laws_and_typed_energies_run_in_this_process(case):
    for keys in ([], ["material.parameters={mu=1}", "material.energy=mu/2*(I1-3)"]):
        given = case(*keys, *([] if keys else ["material.model=neo_hookean", "material.parameters={mu=1}"]))
        with RunPool(given) as pool:
            pool.evaluate([{"mu": 1.0}])
            assert isinstance(pool._workers, InProcess)
    assert is_foreign(case().law)


def tame(case):
    """The Evaluation at TAME by nobody but this process."""
    with RunPool(case()) as pool:
        return pool.evaluate([TAME])[0]


@pytest.mark.parametrize(
    ("wild", "said"),
    [
        ("os.kill(os.getpid(), signal.SIGKILL)", "killed by signal 9"),
        (LOOP, "not solved within 1 s"),
    ],
)
def test_a_run_that_ends_its_worker_is_tried_twice_and_the_others_go_on(case, in_process, wild, said):
    where = "open('FOLDER/tries', 'a').write('x')\n        "
    given = case("fit.time_limit=1", wild=where + wild)
    with RunPool(given, 2) as pool:
        failed, fine, other = pool.evaluate([BAD, TAME, OTHER])
        assert pool.evaluate([BAD, TAME])[0] == failed  # and is not tried again
    assert failed.forces is None
    assert said in failed.cause
    assert np.array_equal(fine.forces[1], tame(case).forces[1])
    assert other.forces is not None
    tries = len((given.path.parent / "tries").read_text())
    assert tries == 2 * (1 if wild == LOOP else 2)  # of two tests; what takes too long is not worth another try


def test_a_worker_killed_at_work_changes_nothing(case, in_process):
    """Killed once, in the middle of a run: a mark in the folder says that it has happened."""
    once = "mark = Path('FOLDER/mark'); first = not mark.exists(); mark.touch(); first and os.kill(os.getpid(), 9); return found"
    with RunPool(case(wild=once), 2) as pool:
        after = pool.evaluate([BAD, TAME])
    assert (case().path.parent / "mark").exists()
    with RunPool(case()) as pool:
        undisturbed = pool.evaluate([BAD, TAME])
    for a, b in zip(after, undisturbed, strict=True):
        assert all(np.array_equal(x, y) for x, y in zip(a.forces, b.forces, strict=True))


@pytest.mark.campaign
def test_workers_killed_from_outside_change_nothing(case, in_process):
    points = [{"mu": 1.0, "zeta": 0.25 * n} for n in range(5)]
    with RunPool(case(), 2) as pool:
        done = []

        def report(*share):
            done.append(share)
            if len(done) == 2:
                for worker in pool._workers._workers:
                    os.kill(worker.process.pid, signal.SIGKILL)

        disturbed = pool.evaluate(points, report)
    with RunPool(case()) as pool:
        calm = pool.evaluate(points)
    for a, b in zip(disturbed, calm, strict=True):
        assert all(np.array_equal(x, y) for x, y in zip(a.forces, b.forces, strict=True))
    assert done[-1] == (10, 10)
    assert not pool.failures


SCRIPT = """
import sys
from indentfit.experiment.measured import read_case
from indentfit.runs.pool import RunPool
with RunPool(read_case(sys.argv[1]), 2) as pool:
    pool.evaluate([{"mu": 1.0, "zeta": 3.0}])
"""


def test_a_script_without_its_guard_is_told_so_and_does_not_hang(case, tmp_path):
    (tmp_path / "script.py").write_text(SCRIPT)
    command = [sys.executable, "-P", str(tmp_path / "script.py"), str(case().path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == 1
    assert "WorkerError" in done.stderr.splitlines()[-1]
    assert "__main__" in done.stderr.splitlines()[-1]


PREPARED = """
import json, sys
from pathlib import Path
from indentfit.runs import start
if __name__ == "__main__":
    start.prepare()
    from indentfit.experiment.measured import read_case
    from indentfit.runs.pool import RunPool
    with RunPool(read_case(sys.argv[1]), 2) as pool:
        found = pool.evaluate([{"mu": 1.0, "zeta": 3.0}], sensitivities=["zeta"])
        commands = [Path(f"/proc/{worker.process.pid}/cmdline").read_text() for worker in pool._workers._workers]
        found += pool.evaluate([{"mu": 1.0, "zeta": 5.0}])
    slopes = [slope["zeta"].tolist() for slope in found[0].sensitivities]
    print(json.dumps([[force.tolist() for force in found[0].forces], slopes, found[1].cause, commands]))
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="processes are forked on Linux alone")
def test_workers_forked_from_a_prepared_server_give_the_numbers_of_others_and_are_watched_as_these(case, tmp_path):
    """The server must not import files of the working folder: one of these has the name of a library."""
    (tmp_path / "script.py").write_text(PREPARED)
    (tmp_path / "skfem.py").write_text("raise SystemExit('imported')")
    given = case(wild="os.kill(os.getpid(), 9)")
    command = [sys.executable, "-P", str(tmp_path / "script.py"), str(given.path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    forces, slopes, cause, commands = json.loads(done.stdout)
    assert cause.count("killed by signal 9") == 2
    assert commands and all("forkserver" in command for command in commands)
    with RunPool(case(), 1) as pool:
        (here,) = pool.evaluate([TAME], sensitivities=["zeta"])
    assert forces == [force.tolist() for force in here.forces]
    assert slopes == [slope["zeta"].tolist() for slope in here.sensitivities]


@pytest.mark.parametrize(
    ("name", "overrides", "asked_for", "prepared"),
    [
        ("white_matter_2017", [], {}, True),
        ("white_matter_2017", ["fit.workers=1"], {}, False),
        ("white_matter_2017", [], {"cluster": "local"}, False),
        ("hydrogel_sphere", [], {}, False),
        ("hydrogel_sphere", [], {"points": True}, True),
        ("hydrogel_sphere", ["indenter.friction=unknown"], {}, True),
    ],
)
def test_a_server_is_prepared_where_several_workers_will_have_runs(monkeypatch, name, overrides, asked_for, prepared):
    """A gel whose force is only scaled has one run on each mesh, which takes less than the server."""
    asked = []
    monkeypatch.setattr(start, "prepare", lambda: asked.append(True))
    monkeypatch.setattr(start, "cores", lambda: 2)
    start.prepare_for(read_case(CASES / name / "case.toml", overrides), **asked_for)
    assert bool(asked) == prepared


def test_the_workers_end_with_a_killed_parent(case, tmp_path):
    guarded = SCRIPT.replace("with RunPool", "if __name__ == '__main__':\n  with RunPool").replace("    pool", "      pool")
    (tmp_path / "script.py").write_text(guarded.replace("3.0", "5.0"))
    given = case(wild=f"Path('FOLDER/pid').write_text(str(os.getpid()))\n        {LOOP}")
    parent = subprocess.Popen([sys.executable, "-P", str(tmp_path / "script.py"), str(given.path)])
    try:
        assert within(60, lambda: (tmp_path / "pid").exists() and (tmp_path / "pid").read_text())
    finally:
        parent.kill()
        parent.wait()
    worker = int((tmp_path / "pid").read_text())
    assert within(10, lambda: not alive(worker))


def within(seconds, question):
    """Whether the question is answered with yes within the time."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if question():
            return True
        time.sleep(0.05)
    return False


def alive(pid):
    try:
        os.kill(pid, 0)
    except OSError:
        return False
    try:  # one that nobody has waited for yet is dead all the same
        return open(f"/proc/{pid}/stat").read().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return True


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="a setting of glibc")
@pytest.mark.campaign
def test_memory_that_a_run_frees_is_there_for_the_next():
    """Each page that is given back and asked for again is a fault of the page table: 20,000 to 40,000 in a run otherwise."""
    white_matter = Path(__file__).parents[1] / "cases" / "white_matter_2017" / "case.toml"
    program = f"""
import resource
from indentfit.experiment.measured import read_case
from indentfit.runs.bench import Bench
from indentfit.runs.mechanics import mechanics_of
from indentfit.runs.run import RunRequest
case = read_case({str(white_matter)!r})
place, request = Bench(mechanics_of(case)), RunRequest(tuple(case.start_values().items()), 0)
for _ in range(3):
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    assert place.run(request).force is not None
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
"""
    done = subprocess.run([sys.executable, "-P", "-c", program], capture_output=True, text=True, check=True)
    assert int(done.stdout) < 2000


# The ledger


@pytest.mark.campaign  # the suite's time; tests/test_resume.py has the same through the command
def test_a_second_fit_runs_nothing_that_the_first_has_run(case, tmp_path):
    """The same fit takes all of its runs from the ledger, one with other weights those that it shares."""
    case = partial(case, *BARE)
    with Ledger(tmp_path / "l", case()) as ledger:
        first = fit(case(), ledger=ledger)
        assert first.reused == 0
        assert len(ledger) == first.runs
    with Ledger(tmp_path / "l", case(), resume=True) as ledger:
        second = fit(case(), ledger=ledger)
        assert second.reused == second.runs == first.runs
    assert differences(first, second) <= {"seconds", "reused", "solver"}
    again = case("test.across.weight=0.7", "fit.seed=0", "fit.generations=1")
    with Ledger(tmp_path / "l", again) as ledger:
        third = fit(again, ledger=ledger)
    assert third.reused >= 2 * 4  # the first generation does not depend on the weights
    with RunPool(again) as pool:
        assert fit(again).parameters == third.parameters  # nor do its numbers depend on where they come from
        assert not pool.runs


def differences(one, two):
    one, two = one.as_json(), two.as_json()
    return {key for key in one if one[key] != two[key]}


def test_workers_that_are_asked_to_stop_end_what_they_are_at(case, tmp_path):
    points = [{"mu": 1.0, "zeta": 0.25 * n} for n in range(8)]
    with Ledger(tmp_path / "l", case()) as ledger, RunPool(case(), 2, ledger, stop=lambda: len(ledger) >= 3) as pool:
        with pytest.raises(Stopped):
            pool.evaluate(points)
        assert 3 <= len(ledger) <= 5


# Sensitivities


def test_sensitivities_are_asked_of_the_model_kept_and_found_again(case, in_process, tmp_path, monkeypatch):
    """A model that gives zeta's derivatives only, one of them not finite."""
    calls = []

    def run(self, press, progress=None, deadline=None):
        calls.append(press.sensitivities)
        given = {"zeta": np.full(5, 2.0 if press.angle else np.nan)} if press.sensitivities else None
        return SimpleNamespace(force=np.arange(5.0) + press.angle, facts=SolveFacts(), sensitivities=given, seen=None, seen_by=None)

    monkeypatch.setattr(Model, "run", run)
    with Ledger(tmp_path / "l", case()) as ledger:
        with RunPool(case(), 1, ledger) as pool:
            plain = pool.evaluate([TAME])[0]
            assert plain.sensitivities is None
            along, across = pool.evaluate([TAME], sensitivities=["zeta", "phi"])[0].sensitivities
            assert along == {}
            assert across["zeta"].tolist() == [2.0] * 5
            assert pool.runs == 4
            assert pool.evaluate([TAME], sensitivities=("phi", "zeta"))[0].sensitivities[1].keys() == {"zeta"}
            assert pool.runs == 4
        with RunPool(case(), 1, ledger) as pool:
            assert pool.evaluate([TAME], sensitivities=("zeta",))[0].sensitivities[1]["zeta"].tolist() == [2.0] * 5
            assert (pool.runs, pool.reused) == (2, 2)
    assert calls == [(), (), ("phi", "zeta"), ("phi", "zeta")]


# Order


def test_a_single_run_in_the_plane_starts_no_process_and_several_do(tmp_path):
    straight_curve(tmp_path / "parallel.csv", 3.0)
    ball = {"shape": "sphere", "width": None, "length": None, "diameter": 2.0, "friction": 0.0}
    case = read_case(tiny_case(tmp_path, indenter=ball, solver={"element": "q2p1"}))
    before = set(active_children())
    with RunPool(case, 2) as pool:
        (alone,) = pool.evaluate([{"mu": 1.0}])
        assert set(active_children()) <= before
        (beside, _) = pool.evaluate([{"mu": 2.0}, {"mu": 3.0}])
        assert set(active_children()) - before
    np.testing.assert_allclose(beside.forces[0], 2 * alone.forces[0], rtol=1e-6)


def test_the_longest_runs_are_begun_first(case):
    """What the nearest run of the same test took is expected; without one, the deepest test comes first."""
    pool = RunPool(case())

    def asked(zeta, test, **more):
        return RunRequest(tuple({"mu": 1.0, "zeta": zeta, **more}.items()), test)

    both = pool._longest_first([asked(1.0, 0), asked(1.0, 1)])
    assert [request.test for request in both] == [1, 0]  # as deep: the one across the fibres
    took = {asked(1.0, 0): 1.0, asked(1.0, 1): 3.0, asked(9.0, 0): 2.0, asked(9.0, 1): 50.0}
    for request, seconds in took.items():
        pool._learn(request, Run(None, None, seconds, {}))
    requests = [asked(zeta, test) for zeta in (1.1, 8.0) for test in (0, 1)]
    assert pool._longest_first(requests) == [requests[3], requests[1], requests[2], requests[0]]
    assert pool._longest_first([*requests, asked(1.0, 1, **{"sample.base": "bonded"})])[0] == requests[3]


def test_a_worker_is_given_its_next_run_before_the_last_one_is_written_down(case):
    """The caller looks at what came first while both workers are at work again."""
    requests = [RunRequest(tuple({"mu": 1.0, "zeta": 0.25 * n}.items()), 0) for n in range(6)]
    workers = Processes(mechanics_of(case()), 2, 60)
    try:
        course = workers.solve(requests, lambda: 0)
        next(course)
        assert sum(worker.request is not None for worker in workers._workers) == 2
        assert len(list(course)) == 5
    finally:
        workers.close(now=True)


# Dask


def test_a_dask_cluster_gives_the_same_numbers_also_when_a_worker_is_killed(case, in_process):
    distributed = pytest.importorskip("distributed")
    points = [{"mu": 1.0, "zeta": 0.25 * n} for n in range(10)]
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, host="127.0.0.1", dashboard_address=None, silence_logs=50
        ) as cluster,
        RunPool(case(), cluster=cluster.scheduler_address) as pool,
    ):
        done = []

        def report(*share):
            done.append(share)
            if len(done) == 4:
                os.kill(next(iter(cluster.workers.values())).pid, signal.SIGKILL)

        there = pool.evaluate(points, report)
        assert pool.workers in (1, 2)
        assert not pool.failures
    with RunPool(case()) as pool:
        here = pool.evaluate(points)
    for a, b in zip(there, here, strict=True):
        assert all(np.array_equal(x, y) for x, y in zip(a.forces, b.forces, strict=True))


ENDLESS = """
import json, sys
from indentfit.experiment.measured import read_case
from indentfit.runs.pool import RunPool

if __name__ == "__main__":
    case = read_case(sys.argv[1], ["fit.time_limit=3"])
    points = [{"mu": 1.0, "zeta": zeta} for zeta in json.loads(sys.argv[3])]
    with RunPool(case, int(sys.argv[2]), cluster="local") as pool:
        evaluations = pool.evaluate(points)
    print(json.dumps([[e.cause, e.lost, [force.tolist() for force in e.forces or ()]] for e in evaluations]))
"""


@pytest.mark.parametrize(
    ("number", "zetas"),
    [
        pytest.param(2, [5.0, 3.0], marks=pytest.mark.campaign),
        pytest.param(1, [5.0, 6.0, 7.0, 3.0], marks=pytest.mark.campaign),
        pytest.param(2, [5.0, 3.0, 6.0, 1.0], marks=pytest.mark.campaign),
    ],
)
def test_a_run_that_never_comes_back_is_ended_on_a_cluster_too_and_no_other_is_blamed(case, tmp_path, number, zetas):
    """In a process with a hard end. Each endless run is tried once.

    In the campaign, more workers are lost than Dask allows for a request.
    """
    pytest.importorskip("distributed")
    (tmp_path / "endless.py").write_text(ENDLESS)
    given = case(wild=f"open('FOLDER/tries', 'a').write('x')\n        {LOOP}")
    words = [sys.executable, "-P", tmp_path / "endless.py", given.path, str(number), json.dumps(zetas)]
    done = subprocess.run(words, capture_output=True, text=True, timeout=240)
    assert done.returncode == 0, done.stderr
    with RunPool(case()) as pool:
        here = pool.evaluate([{"mu": 1.0, "zeta": zeta} for zeta in zetas])
    for zeta, evaluation, (cause, lost, forces) in zip(zetas, here, json.loads(done.stdout), strict=True):
        if zeta > 4:
            assert lost and cause.count("not solved within 3 s") == 2 and "worker" not in cause
        else:
            assert cause is None and forces == [force.tolist() for force in evaluation.forces]
    assert len((tmp_path / "tries").read_text()) == 2 * sum(zeta > 4 for zeta in zetas)


@pytest.mark.campaign  # the pool alone is tested above
def test_a_fit_on_a_cluster_whose_worker_is_killed_ends_with_the_numbers_of_local_processes(case):
    distributed = pytest.importorskip("distributed")
    told = []
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, host="127.0.0.1", dashboard_address=None, silence_logs=50
    ) as cluster:

        def progress(share, note):
            told.append(note)
            if len(told) == 6:
                os.kill(next(iter(cluster.workers.values())).pid, signal.SIGKILL)

        there = fit(case(*BARE), progress, cluster=cluster.scheduler_address)
    assert len(told) > 6
    here = fit(case(*BARE, "fit.workers=2"))
    assert there.success
    assert differences(there, here) <= {"seconds", "solver"}


def test_a_scheduler_that_is_not_there_is_an_error_in_one_line(case, monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr("indentfit.runs.cluster.PATIENCE", 1)
    with RunPool(case(), cluster="tcp://127.0.0.1:9") as pool, pytest.raises(WorkerError, match=r"tcp://127.0.0.1:9") as error:
        pool.evaluate([TAME])
    assert "\n" not in str(error.value)


def test_without_dask_the_extra_is_named(case, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with RunPool(case(), cluster="local") as pool, pytest.raises(WorkerError, match=r"indentfit\[cluster\]"):
        pool.evaluate([TAME])


NEWBORN = """
import multiprocessing, os, signal
from indentfit.runs.start import deaf_to_interrupts
if __name__ == "__main__":
    with deaf_to_interrupts():
        process = multiprocessing.get_context("spawn").Process(target=print, args=("ran",))
        process.start()
    os.kill(process.pid, signal.SIGINT)
    process.join()
    print("exit", process.exitcode)
"""


@pytest.mark.skipif(not hasattr(signal, "pthread_sigmask"), reason="signals cannot be held back on this system")
def test_ctrl_c_does_not_reach_the_first_process_while_it_starts(tmp_path):
    """In a program of its own: only with its first process does Python start the tracker that unblocked the signal."""
    (tmp_path / "newborn.py").write_text(NEWBORN)
    done = subprocess.run([sys.executable, tmp_path / "newborn.py"], capture_output=True, text=True, timeout=60)
    assert (done.stdout.split(), done.stderr) == (["ran", "exit", "0"], "")
