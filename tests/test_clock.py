"""The clock of a run: deadlines strike where a loop looks at them, whatever else goes on, and nothing waits for ever."""

import subprocess
import sys
import threading

import pytest

from indentfit.errors import OutOfTime
from indentfit.fem.deadline import NEVER, Deadline
from indentfit.runs.watch import Watch, watched

# Loops like the solver's, with contexts inside and out: each ends in time or out of time, and afterwards Python runs on.
LOOPS = """
import contextlib, itertools, sys, time
from indentfit.errors import OutOfTime
from indentfit.fem.deadline import Deadline

def turns(number, deadline):
    for turn in range(number):
        with contextlib.suppress(ValueError):
            deadline.check()
        yield turn

@contextlib.contextmanager
def within(deadline):
    try:
        yield deadline
    finally:
        opened.append(-1)

def strike(number):
    for n in range(number):
        opened.append(1)
        try:
            with within(Deadline(2e-5)) as deadline:
                for turn in turns(n % 50 if n % 2 else 10**9, deadline):
                    pass
            ends["done"] += 1
        except OutOfTime:
            ends["late"] += 1

opened, ends = [], {"done": 0, "late": 0}
NUMBER = 10_000
AROUND
assert sum(ends.values()) == NUMBER and sum(opened) == 0, (ends, sum(opened))
assert ends["late"] >= NUMBER // 2, ends
print("whole")
"""
AROUND = {
    "alone": "strike(NUMBER)",
    "beside a busy thread and a busy process": """
import subprocess, threading
beside = subprocess.Popen([sys.executable, "-c", "while True: pass"])
stop = threading.Event()
thread = threading.Thread(target=lambda: [None for _ in iter(stop.is_set, True)], daemon=True)
thread.start()
try:
    strike(NUMBER)
finally:
    stop.set(); thread.join(); beside.kill(); beside.wait()
""",
    "with distributed": "import distributed\nstrike(NUMBER)",
    "with setprofile": "sys.setprofile(lambda *_: None)\nstrike(NUMBER)\nsys.setprofile(None)",
    "with settrace": "sys.settrace(lambda *_: None)\nstrike(NUMBER)\nsys.settrace(None)",
    "with cProfile": "import cProfile\ncProfile.Profile().runcall(strike, NUMBER)",
    "in another thread": "import threading\nt = threading.Thread(target=strike, args=[NUMBER])\nt.start()\nt.join()",
}


@pytest.mark.parametrize("around", AROUND)
def test_ten_thousand_deadlines_strike_and_nothing_waits(around):
    """In a process of its own with a hard end, because what would fail here is that it stands still."""
    if "distributed" in around:
        pytest.importorskip("distributed")
    program = LOOPS.replace("AROUND", AROUND[around])
    done = subprocess.run([sys.executable, "-P", "-c", program], capture_output=True, text=True, timeout=120)
    assert (done.returncode, done.stdout.strip()) == (0, "whole"), done.stderr


def test_a_deadline_counts_processor_time_and_not_sleep():
    import time

    deadline = Deadline(0.05)
    time.sleep(0.1)
    deadline.check()
    NEVER.check()
    with pytest.raises(OutOfTime, match=r"0\.05 s"):
        while True:
            deadline.check()


@pytest.mark.parametrize(("program", "overdue"), [("while True: pass", True), ("import time; time.sleep(60)", False)])
def test_the_watch_over_a_process_counts_its_processor_time(program, overdue, monkeypatch):
    """At most half the patience, so that only processor time can be too much."""
    monkeypatch.setattr("indentfit.runs.watch.GRACE", 0.2)
    with subprocess.Popen([sys.executable, "-c", program]) as child:
        try:
            watch = Watch(child.pid, 0.1)
            said = [wait_and_ask(watch, child) for _ in range(60 if overdue else 8)]
        finally:
            child.kill()
    assert any(said) == overdue


def wait_and_ask(watch, child):
    """Whether the child is overdue after another quarter of a second."""
    with pytest.raises(subprocess.TimeoutExpired):
        child.wait(0.25)
    return watch.is_overdue()


def test_a_child_that_only_sleeps_is_overdue_after_many_times_its_limit(monkeypatch):
    monkeypatch.setattr("indentfit.runs.watch.PATIENCE", 0.1)
    with subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"]) as child:
        try:
            watch = Watch(child.pid, 0.05)
            assert not watch.is_overdue()
            assert [wait_and_ask(watch, child) for _ in range(4)][-1]
        finally:
            child.kill()


def test_a_machine_that_was_asleep_ends_no_run(monkeypatch):
    """Between two looks an hour has passed on the wall."""
    watch, hour = Watch(None, 1.0), [0.0]
    monkeypatch.setattr("indentfit.runs.watch.time.monotonic", lambda: hour[0])
    watch.begin()
    hour[0] += 3600
    assert not watch.is_overdue()


def test_a_process_that_is_gone_is_not_overdue():
    assert not Watch(2**22 + 1, 1.0).is_overdue()


def test_watched_work_gives_its_result_or_its_error_or_is_left_behind(monkeypatch):
    monkeypatch.setattr("indentfit.runs.watch.GRACE", 0.1)
    monkeypatch.setattr("indentfit.runs.watch.LOOK", 0.05)
    released, ended = threading.Event(), threading.Event()

    def endless():
        while not released.is_set():
            pass
        ended.set()

    assert watched(lambda: 3, 1.0) == 3
    with pytest.raises(ZeroDivisionError):
        watched(lambda: 1 / 0, 1.0)
    with pytest.raises(OutOfTime, match=r"0\.1 s"):
        watched(endless, 0.1)
    assert not ended.is_set()
    released.set()
    assert ended.wait(10)
