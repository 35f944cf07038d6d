"""Nothing let in: no code runs that the case does not name and the user does not see, and no page can run any."""

import ast
import base64
import hashlib
import inspect
import re
import sys

import pytest
from click.testing import CliRunner
from fixtures.cases import CASES

from indentfit import material
from indentfit.cli import main
from indentfit.errors import MaterialError

PLUGIN = """
import sys
print("PLUGIN RAN", file=sys.stderr)
from indentfit.material import Material, Parameter

class Mine(Material):
    '''psi = mu/2 (I1 - 3)'''
    mu = Parameter("kPa", "shear modulus", min=0)

    def energy(self, I1):
        return self.mu / 2 * (I1 - 3)
"""


def run(*words):
    return CliRunner().invoke(main, list(map(str, words)))


@pytest.fixture
def case(tmp_path):
    """A case with a plugin beside it, which tells when it runs."""
    text = (CASES / "quickstart" / "case.toml").read_text()
    head, tail = text[: text.index("[material]")], text[text.index("[[test]]") :]
    (tmp_path / "case.toml").write_text(
        head + '[material]\nmodel = "mine.py:Mine"\nparameters = { mu = 1 }\nbulk_ratio = 1000\n\n' + tail
    )
    (tmp_path / "mine.py").write_text(PLUGIN)
    (tmp_path / "curves").mkdir()
    for path in (CASES / "quickstart" / "curves").glob("*.csv"):
        (tmp_path / "curves" / path.name).write_bytes(path.read_bytes())
    return tmp_path / "case.toml"


def test_the_code_that_a_case_names_is_named_once_and_before_it_runs(case):
    done = run("validate", case)
    assert done.exit_code == 0 and done.stderr.count("note: the material runs the Python code in") == 1
    assert done.stderr.index(str(case.parent / "mine.py")) < done.stderr.index("PLUGIN RAN")


@pytest.mark.parametrize("command", ["validate", "simulate", "fit", "sweep", "mesh-check", "design"])
def test_no_command_runs_the_code_of_a_file_with_no_plugins(case, command):
    words = {"sweep": ["--vary", "material.mu=1,2"]}.get(command, [])
    done = run("--no-plugins", command, case, *words)
    assert done.exit_code == 2 and "PLUGIN RAN" not in done.stderr
    (line,) = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
    assert "case.toml: material.model" in line and "mine.py is not run, because of --no-plugins" in line
    assert not list(case.parent.glob("*result*"))


def test_code_that_ran_before_is_refused_all_the_same(case):
    assert run("validate", case).exit_code == 0
    assert run("--no-plugins", "validate", case).exit_code == 2
    assert run("validate", case).exit_code == 0


def test_materials_refuses_a_file_and_knows_its_own_with_no_plugins(case):
    done = run("--no-plugins", "materials", "check", f"{case.parent}/mine.py:Mine")
    assert done.exit_code == 2 and "PLUGIN RAN" not in done.stderr and "--no-plugins" in done.stderr
    assert run("--no-plugins", "materials", "check", "neo_hookean").exit_code == 0


def test_the_material_of_another_package_is_refused_with_no_plugins_and_ours_are_not(tmp_path, monkeypatch):
    (tmp_path / "foreign.py").write_text(PLUGIN)
    place = tmp_path / "foreign-1.dist-info"
    place.mkdir()
    (place / "METADATA").write_text("Metadata-Version: 2.1\nName: foreign\nVersion: 1\n")
    (place / "entry_points.txt").write_text("[indentfit.materials]\nforeign = foreign:Mine\nneo_hookean = foreign:Mine\n")
    monkeypatch.syspath_prepend(tmp_path)
    refused = run("--no-plugins", "materials")
    assert refused.exit_code == 0 and "foreign" not in sys.modules
    assert re.search(r"^foreign +BROKEN: the installed foreign:Mine is not run", refused.stdout, re.M)
    assert re.search(r"^neo_hookean +mu: ", refused.stdout, re.M)
    allowed = run("materials", "foreign")
    assert allowed.exit_code == 0 and "note: the material runs the installed foreign:Mine" in allowed.stderr
    assert material.load("neo_hookean").__module__ == "indentfit.materials.neo_hookean"
    sys.modules.pop("foreign", None)


@pytest.mark.parametrize(
    "energy",
    [
        "mu/2*((I1-3) + k*(I4-1)^2)",
        "mu*(exp(k*positive(I4-1)^2) - 1) + mu*(I1-3)",
        "mu*(I1-3) + mu*log(cosh(I1-3)+tanh(k)) + mu*abs(I2-3)^3 + sinh(I5)^2*1e-3*(I4-1)^2",
    ],
)
def test_what_is_compiled_from_a_typed_energy_holds_arithmetic_and_named_functions_only(energy):
    """The source that SymPy writes and executes, read again: every name is an argument, a common part, or a known function."""
    derived = material.require_derivable(material.typed(energy, ["mu", "k"]))
    numbers = {"exp", "log", "sqrt", "sinh", "cosh", "tanh", "positive", "step", "abs"}
    for compiled in derived:
        (function,) = ast.parse(inspect.getsource(compiled.function)).body
        own = {one.arg for one in function.args.args}
        own |= {node.id for node in ast.walk(function) if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)}
        used = {node.id for node in ast.walk(function) if isinstance(node, ast.Name)}
        assert used <= own | numbers and len(own & {"mu", "k"}) == 0  # not even the parameters' names are in it
        kinds = (ast.Attribute, ast.Subscript, ast.Import, ast.Lambda, ast.JoinedStr, ast.Await, ast.ListComp)
        assert not any(isinstance(node, kinds) for node in ast.walk(function))


@pytest.mark.parametrize("name", ["mu); import os; (", "__import__", "mu\nimport os", "os.system", "ｍｕ"])
def test_a_parameters_name_cannot_smuggle_code_into_what_is_compiled(name):
    with pytest.raises(MaterialError, match="cannot be called"):
        material.typed("mu*(I1-3)", ["mu", name])


def test_the_page_of_processed_records_allows_its_own_style_and_nothing_else(tmp_path):
    records = CASES / "rig_records"
    done = run("process", "--manifest", records / "manifest.csv", "--record", records / "record.toml", "-o", tmp_path / "out")
    assert done.exit_code == 0, done.stderr
    page = (tmp_path / "out" / "report.html").read_text()
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', page)[1]
    style = re.search(r"<style>(.*?)</style>", page, re.S)[1]
    digest = base64.b64encode(hashlib.sha256(style.encode()).digest()).decode()
    parts = dict(part.split(maxsplit=1) for part in policy.split("; "))
    assert parts == {
        "default-src": "'none'", "img-src": "data:", "style-src": f"'sha256-{digest}'", "base-uri": "'none'",
        "form-action": "'none'",
    }  # fmt: skip
    page = page.replace(' xmlns="http://www.w3.org/2000/svg"', "")  # a name, which nothing loads
    assert not re.search(r"<script|\son\w+=|\sstyle=|javascript:|https?://", page, re.I)
