"""What is compiled: kept where only this user writes, and the same in Python, where nothing is compiled."""

import os
import subprocess
import sys
from pathlib import Path

import numba
import numpy as np
import pytest
from threadpoolctl import threadpool_info

from indentfit import compiled
from indentfit.compiled import one_blas_thread

TESTS = Path(__file__).parent
SIMULATION = """
import sys
sys.path.insert(0, {tests!r})
from fixtures.cases import white_matter
from indentfit.fem import element
from indentfit.fem.simulate import Model
from indentfit.fem.setup import Press
from indentfit.runs.points import setup_of
keys = "mesh.elements=20", "solver.element={element}", "solver.tolerance=1e-8"
case = white_matter(*keys, "test=[{{name='a',angle=90,depth=0.03,points=2}}]")
model = Model(setup_of(case))
assert type(element._gather).__name__ == {kind!r}
press = Press(case.law(**case.start_values()), 1490.0, 90, [0.015, 0.03], sensitivities=("mu", "zeta"))
run = model.run(press)
print(*run.force, *run.sensitivities["mu"], *run.sensitivities["zeta"])
"""


def simulated(element, python):
    program = SIMULATION.format(tests=str(TESTS), element=element, kind="function" if python else "CPUDispatcher")
    environment = os.environ | ({"NUMBA_DISABLE_JIT": "1"} if python else {})
    done = subprocess.run([sys.executable, "-P", "-c", program], capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stderr
    return np.array(done.stdout.split(), float)


@pytest.mark.parametrize("element", ["q1p0"])
def test_the_compiled_loop_and_the_same_in_python_agree(element):
    """Force and sensitivities of a whole indentation; they differ by the order of sums only."""
    np.testing.assert_allclose(simulated(element, True), simulated(element, False), rtol=1e-9)


def refusing(real):
    """numba.njit as it is where no folder of Numba's own can be written."""

    def njit(*words, cache=False, **options):
        if cache and not numba.config.CACHE_DIR:
            raise RuntimeError("cannot cache function: no locator available")
        return real(*words, cache=cache, **options)

    return njit


@pytest.fixture
def nowhere(monkeypatch, tmp_path):
    """No folder to write in but a temporary one."""
    monkeypatch.setattr(numba.config, "CACHE_DIR", "")
    monkeypatch.setattr(numba, "njit", refusing(numba.njit))
    monkeypatch.setattr(compiled.tempfile, "gettempdir", lambda: str(tmp_path))
    return tmp_path / f"indentfit-compiled-{os.getuid()}"


def twice(x):
    return 2 * x


def test_without_another_place_it_is_kept_in_a_private_temporary_folder(nowhere):
    assert compiled.compiled()(twice)(21) == 42
    assert nowhere.stat().st_mode & 0o777 == 0o700 and list(nowhere.rglob("*.nbi"))


@pytest.mark.parametrize("what", ["open to others", "a link", "a file"])
def test_what_somebody_else_may_have_put_there_is_not_run(nowhere, what):
    if what == "open to others":
        nowhere.mkdir()
        nowhere.chmod(0o777)
    elif what == "a link":
        (nowhere.parent / "theirs").mkdir(mode=0o700)
        nowhere.symlink_to(nowhere.parent / "theirs")
    else:
        nowhere.write_text("")
    assert compiled.private_place() is None
    assert compiled.compiled()(twice)(21) == 42 and not numba.config.CACHE_DIR


def test_openblas_has_one_thread_where_that_is_wanted():
    def threads():
        return {pool["num_threads"] for pool in threadpool_info() if pool["internal_api"] == "openblas"}

    before = threads()
    with one_blas_thread():
        assert threads() <= {1}
    assert threads() == before
