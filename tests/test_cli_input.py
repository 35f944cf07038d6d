"""The command line meets wrong input: exit code 2, one line on stderr for each fault, and no traceback."""

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner
from fixtures.cases import FIBRES, straight_curve, tiny_case

from indentfit import cli, material
from indentfit.case.keys import choices
from indentfit.errors import ConvergenceError, FitError, MaterialError
from indentfit.experiment.measured import read_case

CASES = Path(__file__).parent.parent / "cases"
PAPER = CASES / "white_matter_2017" / "case.toml"
HEADER = "displacement_mm,force_mN\n"
ROWS = "".join(f"{n / 20},{n}\n" for n in range(1, 6))


def run(*arguments):
    return CliRunner().invoke(cli.main, [str(argument) for argument in arguments], prog_name="indentfit")


@pytest.fixture
def case(tmp_path):
    """A copy of the paper's case, to be spoilt."""
    shutil.copytree(PAPER.parent, tmp_path / "case")
    return tmp_path / "case" / "case.toml"


def refused(result, *said):
    """Lines on stderr of a run that refused its input, without `error: `; each of `said` is in some line."""
    assert result.exit_code == 2, result.output
    lines = [line for line in result.stderr.splitlines() if not line.startswith("note: ")]
    assert all(line.startswith("error: ") for line in lines)
    assert "Traceback" not in result.output
    for words in said:
        assert any(words in line for line in lines), result.stderr
    return [line.removeprefix("error: ") for line in lines]


# The case file


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("thickness = 3.3", "thickness = -3.3", "sample.thickness = -3.3: must be above 0"),
        ("width = 2 ", "width = 20 ", "indenter.width = 20.0: too wide for the sample of 14 mm"),
        ("min = 0.1, max = 10", "min = 10, max = 0.1", "material.parameters.mu.min = 10.0: must be below max = 0.1"),
        ("start = 3,", "start = 30,", "material.parameters.zeta.start = 30.0: is above max = 20"),
        ("bulk_ratio", "bulk_ration", "material.bulk_ration = 1000: unknown key; did you mean bulk_ratio?"),
        ("[mesh]", "[mush]", "mush = {}: unknown key; did you mean mesh?"),
        ("transversely_", "transversly_", 'material.model = "transversly_isotropic": no material'),
        ('"curves/parallel.csv"', '"lost.csv"', 'test.parallel.curve = "lost.csv": '),
    ],
)
def test_a_wrong_key_or_value_is_named_with_file_and_remedy(case, old, new, said):
    text = case.read_text()
    assert old in text
    case.write_text(text.replace(old, new, 1))
    (line,) = refused(run("validate", case), said)
    assert line.startswith(f"{case}: ")


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("[sample]\nthickness = 3\nthickness = 4\n", "line 3: thickness = 4: this key or table is given twice"),
        ("[sample]\n[mesh]\n[sample]\n", "line 3: [sample]: this key or table is given twice"),
        ("mesh = {size = 1, size = 2}\n", "line 1: mesh = {size = 1, size = 2}: this key or table is given twice"),
        ("[sample]\nthickness =\n", "line 2: thickness =: not TOML"),
        ("[sample\n", "line 1: [sample: not TOML"),
        ("title = 'open\n", "line 1: title = 'open: not TOML"),
        ("just words\n", "line 1: just words: not TOML"),
        ("thickness = " + "9" * 5000 + "\n", "not TOML"),
        ("title = " + "[" * 5000 + "\n", "nested too deep"),
        ("a = 1\n\x1b[31m", "line 2: "),
    ],
)
def test_what_is_not_toml_is_named_with_its_line(case, content, said):
    case.write_text(content)
    (line,) = refused(run("validate", case), said)
    assert line.startswith(f"{case}: ")
    assert line.isprintable()
    assert len(line) < len(str(case)) + 200


def test_a_case_that_is_no_text_is_refused(case):
    case.write_bytes(case.read_bytes().replace(b"title = ", b"title = \xe9"))
    refused(run("validate", case), "not UTF-8 text; save the file as UTF-8")
    case.write_bytes(b"\x00" * 100)
    refused(run("validate", case), "not TOML")


def test_a_case_with_a_byte_order_mark_and_windows_line_ends_is_read(case):
    case.write_bytes(b"\xef\xbb\xbf" + case.read_bytes().replace(b"\n", b"\r\n"))
    assert run("validate", case).exit_code == 0


def test_a_missing_case_and_a_folder_are_refused(case):
    refused(run("validate", case.parent / "none.toml"), "no such file; `indentfit init DIR`")
    refused(run("validate", case.parent), f"a folder; name the case file in it, {case}")
    refused(run("validate", "/dev/null"), "not a file")
    refused(run("validate", "x" * 5000), "cannot be read")


def test_a_case_without_a_friend_s_permission_or_with_odd_names_stays_one_line(case):
    odd = case.with_name("ca\nse.toml")
    case.rename(odd)
    assert run("validate", odd).exit_code == 0
    odd.write_text("[sample]\n'thick\\nness' = 3\n")
    refused(run("validate", odd))


# Curves

WRONG_CURVES = {
    "a wrong header": ("depth,load\n" + ROWS, "line 1: header 'depth,load' has no column displacement_mm"),
    "text in a number column": (HEADER + ROWS + "0.3,abc\n", "line 7: 'abc' is not a number"),
    "NaN": (HEADER + ROWS + "0.3,NaN\n", "line 7: 'NaN' is not a finite number"),
    "unsorted displacements": (HEADER + ROWS + "0.1,7\n", "line 7: displacement 0.1 mm comes after 0.25 mm"),
    "a duplicate displacement": (HEADER + ROWS + "0.25,7\n", "line 7: displacement 0.25 mm is given twice"),
    "too few points": (HEADER + "0.1,1\n0.2,2\n", "2 points; a curve needs at least 5"),
    "an empty file": ("", "the file is empty"),
    "decimal commas": (HEADER + ROWS.replace(".", ","), "with decimal commas, separate the columns by semicolons"),
    "millimetres that are metres": ("displacement_m,force_mN\n" + ROWS, "through the sample"),
}


@pytest.mark.parametrize("name", WRONG_CURVES)
def test_a_wrong_curve_is_named_with_key_file_and_line(case, name):
    content, said = WRONG_CURVES[name]
    (case.parent / "curves" / "parallel.csv").write_text(content)
    (line,) = refused(run("validate", case), said)
    assert line.startswith(f'{case}: test.parallel.curve = "curves/parallel.csv": ')


@pytest.mark.parametrize(
    "content",
    [
        "\ufeff" + HEADER + ROWS,
        (HEADER + ROWS).replace("\n", "\r\n"),
        (HEADER + ROWS).replace(",", ";").replace(".", ","),
        "displacement_um,force_N\n" + "".join(f"{n * 50},{n / 1000}\n" for n in range(1, 6)),
    ],
    ids=["BOM", "CRLF", "semicolons and decimal commas", "other units"],
)
def test_a_curve_from_a_spreadsheet_is_read(case, content):
    (case.parent / "curves" / "parallel.csv").write_text(content, encoding="utf-8", newline="")
    result = run("validate", case)
    assert result.exit_code == 0, result.stderr
    assert "parallel: 0 degrees, 5 points to 0.25 mm" in result.stdout


# validate


def test_validate_lists_every_error_at_once(case):
    text = case.read_text().replace("thickness = 3.3", "thickness = -1").replace("friction = 0.5", "friction = -1")
    case.write_text(text.replace("angle = 90", "angle = 'across'"))
    (case.parent / "curves" / "parallel.csv").unlink()
    lines = refused(run("validate", case, "--set", "fit.sed=3", "--set", "nonsense"))
    keys = [line.split(": ")[1].split(" = ")[0] for line in lines]
    assert sorted(keys) == [
        "--set",
        "fit.sed",
        "indenter.friction",
        "sample.thickness",
        "test.parallel.curve",
        "test.perpendicular.angle",
    ]


def test_validate_says_what_the_case_says():
    result = run("validate", PAPER, "--set", "material.phi=0.7", "--set", "material.bulk_ratio=100")
    assert result.exit_code == 0
    for words in ("diameter 14 mm", "sliding base", "2 x 20", "friction 0.5", "25 points to 0.33 mm", "0.7, fixed"):
        assert words in result.stdout
    assert "free parameters: mu, zeta\n" in result.stdout
    (warning,) = result.stderr.splitlines()
    assert warning.startswith("warning: kappa = 100 kPa is below")


def test_validate_speaks_json(case):
    said = json.loads(run("validate", case, "--json").stdout)
    assert said["valid"]
    assert (said["free"], said["warnings"]) == (["mu", "zeta", "phi"], [])
    assert [test["n"] for test in said["tests"]] == [25, 25]
    result = run("validate", case, "--json", "--set", "sample.thickness=-1")
    refused(result, "sample.thickness = -1")
    said = json.loads(result.stdout)
    assert not said["valid"]
    assert len(said["faults"]) == 1


# init


def test_init_writes_a_case_that_is_valid(tmp_path):
    result = run("init", tmp_path / "new" / "case")
    assert result.exit_code == 0
    path = tmp_path / "new" / "case" / "case.toml"
    assert result.stdout == f"{path}\n"
    result = run("validate", path)
    assert (result.exit_code, result.stderr) == (0, "")


def test_init_overwrites_nothing(tmp_path):
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "mine.txt").write_text("mine")
    refused(run("init", tmp_path / "full"), "exists and is not empty; choose another")
    refused(run("init", tmp_path / "full" / "mine.txt"), "a file has that name")
    refused(run("init", tmp_path / "full" / "mine.txt" / "inside"), "choose another")
    assert [path.name for path in (tmp_path / "full").iterdir()] == ["mine.txt"]
    (tmp_path / "empty").mkdir()
    assert run("init", tmp_path / "empty").exit_code == 0


# materials

BROKEN = """
from indentfit.material import Material, Parameter

class Soft(Material):
    mu = Parameter("kPa", "shear modulus", min=0.1, max=1)
    zeta = Parameter("1", "a term with a stress at rest", min=0.1, max=1)

    def energy(self, I1, I4):
        return -self.mu * (I1 - 3) + self.zeta * (I4 - 1) ** 2
"""


def test_materials_are_listed_and_a_broken_one_harms_only_itself(monkeypatch):
    found = {**material.installed(), "theirs": MaterialError("material 'theirs' cannot be loaded: ImportError: no x")}
    monkeypatch.setattr(material, "installed", lambda: found)
    result = run("materials")
    assert result.exit_code == 0
    for name in ("transversely_isotropic", "neo_hookean", "mooney_rivlin", "holzapfel"):
        assert name in result.stdout
    assert "theirs                  BROKEN: material 'theirs' cannot be loaded" in result.stdout
    assert json.loads(run("materials", "--json").stdout)["neo_hookean"] == {"parameters": ["mu"]}


def test_a_material_is_described_with_its_equation_units_and_bounds():
    result = run("materials", "transversely_isotropic")
    assert result.exit_code == 0
    for words in ("psi = mu/2", "mu    kPa  >= 0", "shear modulus across the fibres", "fibre shear stiffening"):
        assert words in result.stdout
    assert json.loads(run("materials", "neo_hookean", "--json").stdout)["parameters"]["mu"]["unit"] == "kPa"


def test_an_unknown_material_is_refused():
    (line,) = refused(run("materials", "neo_hooke"))
    assert line.startswith("no material 'neo_hooke'; did you mean 'neo_hookean'")
    refused(run("materials", "check", "lost.py:Mine"), "no material file")
    assert run("materials", "check").exit_code == 2
    assert run("materials", "a", "b").exit_code == 2


def test_a_check_that_fails_ends_with_2(tmp_path):
    assert run("materials", "check", "neo_hookean").exit_code == 0
    (tmp_path / "soft.py").write_text(BROKEN)
    result = run("materials", "check", f"{tmp_path}/soft.py:Soft")
    refused(result, "checks failed")
    assert "FAIL" in result.stdout
    (tmp_path / "soft.py").write_text("import nothing_of_that_name\n")
    refused(run("materials", "check", f"{tmp_path}/soft.py:Soft"), "nothing_of_that_name")


# The command line itself


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (ConvergenceError("the element turned inside out", 0.1, 3, 12), 3),
        (FitError("stopped after 3 generations"), 4),
        (ZeroDivisionError("division\nby zero"), 1),
        (MemoryError(), 3),
        (OSError(28, "No space left on device", "/full/result.json"), 2),
        (FileNotFoundError(2, "No such file or directory"), 2),
        (ImportError("libmkl_rt.so.3: cannot allocate\nmemory"), 2),
        (KeyboardInterrupt(), 130),
    ],
)
def test_an_exit_code_says_what_kind_of_failure_it_was(monkeypatch, error, code):
    def fail(*_):
        raise error

    monkeypatch.setattr(material, "installed", fail)
    result = run("materials")
    assert result.exit_code == code
    assert len(result.stderr.splitlines()) == 1
    assert "Traceback" not in result.output
    if code == 1:
        assert "please report" in result.stderr
        assert "Traceback" in run("--debug", "materials").stderr


def test_a_usage_error_ends_with_2():
    for arguments in (["frobnicate"], ["validate"], ["validate", PAPER, "--frobnicate"], ["--frobnicate"]):
        assert run(*arguments).exit_code == 2


def test_help_and_version_are_quick_and_know_every_command():
    result = run("--help")
    assert result.exit_code == 0
    for name in cli.COMMANDS:
        assert f"\n  {name} " in result.stdout
    assert run("--version").stdout.startswith("indentfit, version") or run("--version").stdout.startswith("indentfit ")
    heavy = "numba", "sympy", "scipy", "pymoo", "skfem", "matplotlib", "pydantic"
    script = f"import sys; from indentfit import cli; print([name for name in {heavy} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


HEAVY = (
    "numba", "sympy", "scipy", "pymoo", "skfem", "matplotlib", "pint", "pandas", "dask", "jinja2", "meshio",
    "numpy", "pydantic", "indentfit.case.tables", "indentfit.material",
)  # fmt: skip


@pytest.mark.parametrize("name", cli.COMMANDS)
def test_help_and_completion_of_a_command_import_no_library_that_is_slow(name):
    """They take 0.5 s of CPU at most, and that for one reason: nothing slow is imported."""
    script = f"""import os, sys
from indentfit.cli import main
from click.shell_completion import ShellComplete
for words in (["{name}", "--help"],):
    try:
        main(words)
    except SystemExit:
        pass
names = [item.value for item in ShellComplete(main, {{}}, "indentfit", "_X").get_completions(["{name}"], "--")]
assert "--help" in names, names
print("HEAVY", [name for name in {HEAVY} if name in sys.modules])"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.rstrip().endswith("HEAVY []")


@pytest.mark.parametrize(
    "case", sorted(folder.name for folder in CASES.iterdir() if folder.name not in ("own_material", "benchmarks"))
)
def test_validating_a_case_of_an_installed_material_imports_no_library_that_is_slow(case):
    """Those of raw records from the second time on: their curves are kept."""
    path = CASES / case / "case.toml"
    read_case(path)
    script = f"""import sys
from indentfit.cli import main
try:
    main(["validate", {str(path)!r}])
except SystemExit as end:
    assert end.code == 0
print("HEAVY", [name for name in {HEAVY} if name in sys.modules])"""
    done = subprocess.run([sys.executable, "-P", "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.rstrip().endswith("HEAVY ['numpy', 'pydantic', 'indentfit.case.tables', 'indentfit.material']")


def test_the_choices_of_a_method_are_completed_from_the_case():
    from click.shell_completion import ShellComplete

    items = ShellComplete(cli.main, {}, "indentfit", "_X").get_completions(["fit", "--method"], "")
    assert [item.value for item in items] == list(choices("fit.method"))


def test_every_command_is_a_module_of_its_own_with_the_same_help():
    folder = Path(cli.__file__).parent
    shared = {"--init--", "clusters", "command", "completion", "progress", "reference", "speech", "stopping"}
    modules = {path.stem.replace("_", "-") for path in folder.glob("*.py")} - shared
    assert modules <= set(cli.COMMANDS)
    for name in modules:
        assert run(name, "--help").exit_code == 0


# How much is said


def test_help_is_a_command_too():
    assert run("help").stdout == run("--help").stdout
    assert run("help", "fit").stdout == run("fit", "--help").stdout
    refused(run("help", "fitt"), "no command 'fitt'; did you mean fit?")
    assert run("-V").stdout == run("--version").stdout


def test_a_quiet_command_still_warns_and_refuses(tmp_path):
    path = tiny_case(tmp_path, material=FIBRES)
    straight_curve(tmp_path / "parallel.csv", 3.0)
    said = run("validate", path).stderr
    assert "warning: " in said and run("-q", "validate", path).stderr == said
    refused(run("-q", "validate", tmp_path / "none.toml"), "no such file")
    assert run("init", tmp_path / "a", "--sphere").stderr and not run("-q", "init", tmp_path / "b", "--sphere").stderr
    both = run("-q", "-v", "validate", path)
    assert both.exit_code == 2 and "contradict each other" in both.stderr


def test_a_log_has_the_command_and_all_that_was_said(tmp_path):
    log = tmp_path / "log.txt"
    run("-q", "--log", log, "init", tmp_path / "a", "--sphere")
    run("--log", log, "validate", tmp_path / "a" / "case.toml")
    lines = log.read_text().splitlines()
    assert all(re.match(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d ", line) for line in lines)
    assert any("put your values in place" in line for line in lines) and any("error: " in line for line in lines)
    refused(run("--log", tmp_path / "no" / "log.txt", "help"), "No such file")
