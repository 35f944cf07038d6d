"""The key of a run follows what the run imports: a stored run never answers for code that would compute another."""

import ast
import json
import os
import pickle
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import indentfit.materials
from indentfit.experiment.measured import read_case
from indentfit.runs import closure
from indentfit.runs.key import Inputs, versions
from indentfit.runs.mechanics import mechanics_of
from indentfit.runs.run import RunRequest

HOUSE = Path(__file__).parent.parent / "indentfit"
QUICKSTART = HOUSE.parent / "cases" / "quickstart" / "case.toml"
RUN = closure.of_runs()
NOT_OF_A_RUN = ("report", "cli", "guide", "study", "inverse", "inference", "experiment")  # rooms that no run needs
MODULES_NOT_OF_A_RUN = ("case/messages.py", "case/read.py", "case/template.py", "case/whole.py", "runs/pool.py", "runs/ledger.py")


@pytest.fixture(scope="module")
def copied(tmp_path_factory):
    """A copy of the package's sources that a test may change."""
    home = tmp_path_factory.mktemp("copy") / "indentfit"
    shutil.copytree(HOUSE, home, ignore=shutil.ignore_patterns("__pycache__"))
    return home


def file_of(name, home):
    return closure._file(home, name.partition(".")[2])


def hash_with(file, home, more=b"\n# another comment\n"):
    """The hash of a copy while one of its files says more."""
    whole = file.read_bytes()
    file.write_bytes(whole + more)
    try:
        return closure.of_package(home).hash
    finally:
        file.write_bytes(whole)


# What is in the closure


def test_a_copy_elsewhere_has_the_same_hash(copied):
    assert closure.of_package(copied).hash == RUN.hash


@pytest.mark.parametrize("name", sorted(RUN.sources))
def test_a_change_of_any_module_that_a_run_imports_changes_the_key(copied, name):
    assert hash_with(file_of(name, copied), copied) != RUN.hash


@pytest.mark.parametrize("place", [*NOT_OF_A_RUN, *MODULES_NOT_OF_A_RUN])
def test_a_change_elsewhere_does_not(copied, place):
    files = sorted((copied / place).rglob("*.py")) or [copied / place]
    for file in files if place != "guide" else sorted((copied / place).glob("*.*")):
        assert hash_with(file, copied) == RUN.hash, file


def test_line_ends_of_another_system_do_not(copied):
    file = copied / "fem" / "newton.py"
    whole = file.read_bytes()
    file.write_bytes(whole.replace(b"\n", b"\r\n"))
    assert closure.of_package(copied).hash == RUN.hash
    file.write_bytes(whole)


def test_a_new_import_brings_its_module_in(copied):
    """Also one inside a function, relative, of a module by its package, or by its name as text."""
    (copied / "fem" / "novelty.py").write_text("import tomli_w\n")
    for words in (
        "import indentfit.fem.novelty", "from indentfit.fem import novelty", "from . import novelty", "from .novelty import x",
        "def late():\n    from indentfit.fem import (\n        mesh,\n        novelty,\n    )", "if True: from . import novelty",
        "import importlib\nimportlib.import_module('indentfit.fem.novelty')", "x = 1; import indentfit.fem.novelty",
    ):  # fmt: skip
        whole = (copied / "fem" / "newton.py").read_bytes()
        (copied / "fem" / "newton.py").write_bytes(whole + f"\n{words}\n".encode())
        sources = closure.of_package(copied)
        (copied / "fem" / "newton.py").write_bytes(whole)
        assert "indentfit.fem.novelty" in sources.sources and "tomli_w" in sources.foreign, words
    (copied / "fem" / "novelty.py").unlink()


def test_an_import_for_type_checkers_is_none():
    source = b"from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    import a\nelse:\n    import b\nimport c\n"
    assert [imported.module for imported in closure.imports(source)] == ["typing", "b", "c"]


@pytest.mark.parametrize("path", sorted(HOUSE.rglob("*.py")), ids=lambda path: str(path.relative_to(HOUSE)))
def test_the_quick_reading_of_imports_misses_none(path):
    """Against a walk through the whole syntax tree."""
    source = path.read_bytes()
    assert {*closure.imports(source)} >= {*closure._imported(closure._statements(ast.parse(source).body))}


def test_what_computes_is_a_package_whose_version_is_in_the_key():
    known = versions(read_case(QUICKSTART).law)
    assert {"numpy", "scipy", "skfem", "numba", "sympy", "pypardiso", "mkl", "pyamg", "machine"} <= known.keys()
    assert known["numpy"] and known["skfem"] and known["sympy"]
    assert not known.keys() & {"matplotlib", "click", "jinja2", "rich", "meshio", "ast", "indentfit"}


RAN = """
import pickle, sys
from indentfit.runs.bench import Bench
with open(sys.argv[1], "rb") as file:
    mechanics, request = pickle.load(file)
run = Bench(mechanics).run(request)
assert run.cause is None, run.cause
print(*(name for name in sys.modules if name.startswith("indentfit.")))
"""


@pytest.mark.parametrize(("linear", "assembly"), [("superlu", "forms"), ("pyamg", "compiled")])
def test_every_module_that_a_run_imports_is_in_the_closure(tmp_path, linear, assembly):
    """Asked of a fresh process that gets its case as a worker does."""
    keys = ["mesh.elements=30", f"solver.linear={linear}", f"solver.assembly={assembly}", "material.energy=mu/2*(I1-3)"]
    case = read_case(QUICKSTART, [*keys, "material.parameters={mu=1}"])
    (tmp_path / "case").write_bytes(pickle.dumps((mechanics_of(case), RunRequest((("mu", 1.0),), 0))))
    done = subprocess.run([sys.executable, "-P", "-c", RAN, tmp_path / "case"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert set(done.stdout.split()) <= RUN.sources.keys()


# The law


LAW = """
from indentfit.material import Material, Parameter
from helper_of_a_law import half
class M(Material):
    mu = Parameter('kPa', 'x', min=0)
    def energy(self, I1):
        return self.mu * half() * (I1 - 3)
"""


def origin_with(folder, helper, below="ONE = 1\n"):
    """The hash of a case whose law imports a helper beside it, read in a process of its own."""
    folder.mkdir(exist_ok=True)
    (folder / "m.py").write_text(LAW)
    (folder / "helper_of_a_law.py").write_text(f"from helper_below import ONE\ndef half():\n    return {helper}\n")
    (folder / "helper_below.py").write_text(below)
    program = f"""
import sys
sys.path.insert(0, {str(folder)!r})
from indentfit.experiment.measured import read_case
from indentfit.runs.key import Inputs
print(Inputs(read_case({str(QUICKSTART)!r}, [{f"material.model={folder / 'm.py'}:M"!r}, "material.parameters={{mu=1}}"])).origin)
"""
    done = subprocess.run([sys.executable, "-P", "-c", program], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_a_file_that_a_law_imports_is_in_the_key_wherever_both_lie(tmp_path):
    before = origin_with(tmp_path / "a", "0.5 * ONE")
    assert origin_with(tmp_path / "b", "0.5 * ONE") == before
    assert origin_with(tmp_path / "a", "5.0 * ONE") != before
    assert origin_with(tmp_path / "a", "0.5 * ONE", "ONE = 2\n") != before


def test_an_installed_law_counts_by_its_code_and_that_of_its_bases():
    law = read_case(QUICKSTART).law
    part = closure.of_law(law)
    assert [*part.sources] == [law.__module__]
    assert part.sources[law.__module__] == Path(sys.modules[law.__module__].__file__).read_bytes()
    derived = type("Derived", (law,), {"__module__": __name__})
    assert Inputs(read_case(QUICKSTART)).common["material"]["code"] == [part.hash]
    assert part.hash in [other.hash for other in map(closure.of_law, derived.__mro__[:2])]


# End to end


QUICK = [
    "mesh.elements=24", "solver.element=q1p0", "fit.method=least_squares", "fit.workers=1", "material.zeta=3", "material.phi=0.8",
    "fit.profiles=false",
]  # fmt: skip
PROGRAM = [sys.executable, "-P", "-c", "from indentfit.cli import main; main()", "fit", str(QUICKSTART), "--no-fields", "--json"]


def fitted(folder, *more, home=None):
    environment = os.environ | ({"PYTHONPATH": str(home)} if home else {})
    keys = (word for key in QUICK for word in ("--set", key))
    done = subprocess.run([*PROGRAM, *keys, "-o", str(folder), *more], capture_output=True, text=True, env=environment)
    assert done.returncode in (0, 4), done.stderr
    return json.loads(done.stdout), done.stderr


def package_with_own(file, home):
    """The installed package as links in another home, so that its compiled code serves, but for a copy of one file: its path."""
    installed, folder = Path(indentfit.__file__).parent, (home / "indentfit" / file).parent
    folder.mkdir(parents=True)
    for place in (*installed.iterdir(), Path(indentfit.materials.__file__).parent):
        if place.name not in (folder.name, "__pycache__") and not (home / "indentfit" / place.name).exists():
            (home / "indentfit" / place.name).symlink_to(place)
    for place in (installed / file).parent.glob("*.py*"):
        (folder / place.name).symlink_to(place)
    (home / "indentfit" / file).unlink()
    return Path(shutil.copy2(installed / file, home / "indentfit" / file))


@pytest.mark.campaign  # the keys of the same change are compared above
def test_a_bulk_modulus_computed_otherwise_takes_no_run_of_the_old_ledger(tmp_path):
    """Reported in issue 16: with kappa scaled by 0.01, `fit --reuse` gave the old parameters without a word."""
    before, _ = fitted(tmp_path / "before")
    file = package_with_own("case/materials.py", tmp_path / "home")
    again, said = fitted(tmp_path / "again", "--reuse", str(tmp_path / "before"), home=tmp_path / "home")
    assert again["reused"] == again["runs"] > 0  # the copy itself is the same code
    changed, times = re.subn(r"return (min\(self.bulk_over_shear, .*\) \* shear_modulus)", r"return 0.01 * (\1)", file.read_text())
    assert times == 1
    file.write_text(changed)
    after, said = fitted(tmp_path / "after", "--reuse", str(tmp_path / "before"), home=tmp_path / "home")
    assert after["reused"] == 0 and "note: 0 runs taken over" in said
    assert after["parameters"]["mu"]["value"] != before["parameters"]["mu"]["value"]
