"""Calls beside the work of a command: the value, the error, and what happens where a copy is lost or none can be made."""

import os
import signal
import subprocess
import sys
import time

import pytest

from indentfit.errors import CaseError
from indentfit.runs import copied as module
from indentfit.runs.copied import in_copy


@pytest.fixture
def copies(monkeypatch):
    """This process may make copies of itself."""
    monkeypatch.setattr(module, "is_prepared", lambda: True)
    monkeypatch.setattr(module, "cores", lambda: 2)


def process_and(value):
    return os.getpid(), value


def refused(value):
    raise CaseError([f"{value} is refused"])


def killed_in(parent):
    """7, but a copy is killed."""
    if os.getpid() != parent:
        os.kill(os.getpid(), signal.SIGKILL)
    return 7


def test_a_copy_has_the_value_and_ends(copies):
    first, second = in_copy(process_and, "a"), in_copy(process_and, "b")
    (one, a), (other, b) = first(), second()
    assert (a, b) == ("a", "b")
    assert len({one, other, os.getpid()}) == 3
    for process in (one, other):
        with pytest.raises(ProcessLookupError):
            os.kill(process, 0)


def test_the_error_of_a_copy_is_that_of_the_call(copies):
    with pytest.raises(CaseError, match="3 is refused"):
        in_copy(refused, 3)()


def test_a_call_whose_copy_was_killed_is_made_here(copies):
    assert in_copy(killed_in, os.getpid())() == 7


def test_a_value_that_cannot_be_sent_is_an_error_and_no_endless_wait(copies):
    with pytest.raises(Exception, match="pickle"):
        in_copy(lambda: lambda: 0)()


def test_a_call_whose_copy_cannot_be_made_is_made_here(copies, monkeypatch):
    def no_process(self):
        raise BlockingIOError("Resource temporarily unavailable")

    monkeypatch.setattr("multiprocessing.context.ForkProcess.start", no_process)
    assert in_copy(process_and, 1)() == (os.getpid(), 1)


def test_only_a_command_that_has_prepared_its_server_makes_copies():
    assert in_copy(process_and, 1)() == (os.getpid(), 1)


def test_a_copy_does_not_hear_an_interrupt(copies):
    """Ctrl-C reaches all processes of a terminal; the parent alone decides what ends."""
    assert in_copy(interrupted)() == "not heard"


def interrupted():
    os.kill(os.getpid(), signal.SIGINT)
    return "not heard"


PARENT = """
import sys, time
from indentfit.runs import copied
copied.is_prepared, copied.cores = lambda: True, lambda: 2
signal_of_others = __import__("signal").signal
signal_of_others(15, lambda *_: print("noted", flush=True))  # a command only takes note of the first signal

def large():
    print(__import__("os").getpid(), flush=True)
    return bytes(2**20)

value = copied.in_copy(large)
time.sleep(0.5)
WHAT
"""


def parent(what):
    """A process that has made a copy whose value does not fit into a pipe, and the number of the copy."""
    process = subprocess.Popen([sys.executable, "-c", PARENT.replace("WHAT", what)], stdout=subprocess.PIPE, text=True)
    return process, int(process.stdout.readline())


def gone(process, seconds=10.0):
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        try:
            os.kill(process, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.05)
    return False


def test_a_parent_that_does_not_wait_for_its_copy_ends_and_so_does_the_copy():
    """The copy waited for ever for somebody to read its value, and the parent for the copy."""
    process, copy = parent("raise SystemExit(3)")
    try:
        assert process.wait(20) == 3
    finally:
        process.kill()
    assert gone(copy)
    assert "noted" not in process.stdout.read()


def test_a_copy_does_not_outlive_a_parent_that_was_killed():
    process, copy = parent("time.sleep(60)")
    process.kill()
    process.wait()
    assert gone(copy)


def test_a_value_larger_than_a_pipe_arrives(copies):
    assert in_copy(bytes, 2**20)() == bytes(2**20)
