"""What every test needs: one thread per numerical library, and the fixtures of the package `fixtures` beside this file."""

import os

import pytest

for _name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")  # the numerical libraries read it when they are loaded

pytest_plugins = ["fixtures.cases", "fixtures.drawing", "fixtures.strips"]


@pytest.fixture(scope="session", autouse=True)
def own_cache(tmp_path_factory):
    """Curves of raw records are kept in a folder of these tests, not in the user's."""
    os.environ["INDENTFIT_CACHE"] = str(tmp_path_factory.mktemp("cache"))


@pytest.fixture(autouse=True)
def no_server(monkeypatch):
    """Commands that run inside the process of the tests spawn their workers, which then see the environment of their own test."""
    monkeypatch.setattr("indentfit.runs.start.prepare", lambda: None)
