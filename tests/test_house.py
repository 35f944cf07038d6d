"""The house of the project: a module imports only from rooms above its own, and names say what things are."""

import ast
import graphlib
import re
from pathlib import Path

import numpy as np
import pytest

pytestmark = pytest.mark.quick

HOUSE = Path(__file__).parent.parent / "indentfit"
ROOMS = (
    "arrays", "machine", "compiled", "errors", "units", "digits", "headers", "axes", "curve", "outlines", "point_tables",
    "displacements", "fibre_map", "elastic", "hereditary", "motion", "fibres", "material", "shapes", "indenters", "samples",
    "layer", "case", "experiment", "fem", "runs", "inverse", "inference", "study", "report", "cli",
)  # fmt: skip
DRAWING = {"matplotlib", "jinja2", "meshio"}
# Live results know how they are shown and written: methods that import a function of report when they are called.
LAZY = {
    "experiment/process_result.py": {
        "indentfit.report.record_figures.process_figure", "indentfit.report.record_folder.write_process",
        "indentfit.report.records.process_facts", "indentfit.report.records.process_lines",
    },
    "inference/result.py": {
        "indentfit.report.fit_folder.write_fit", "indentfit.report.plots.force_displacement", "indentfit.report.text.fit_lines",
    },
    "inference/per_sample.py": {
        "indentfit.report.per_sample.sample_lines", "indentfit.report.per_sample.samples_figure",
        "indentfit.report.samples_folder.write_samples",
    },
    "inference/population_fit.py": {
        "indentfit.report.population.population_figure", "indentfit.report.population.population_lines",
    },
    "runs/simulated.py": {
        "indentfit.report.fields.FieldChoice", "indentfit.report.plots.force_displacement",
        "indentfit.report.study_folder.write_simulation", "indentfit.report.text.simulation_lines",
    },
    "study/compare.py": {
        "indentfit.report.comparison.comparison_figure", "indentfit.report.comparison.comparison_lines",
        "indentfit.report.comparison_folder.write_comparison",
    },
    "study/sweep.py": {
        "indentfit.report.study_folder.write_study", "indentfit.report.study_text.html_table",
        "indentfit.report.study_text.sweep_lines", "indentfit.report.study_text.sweep_rows", "indentfit.report.sweep.overview",
    },
    "study/mesh_check.py": {
        "indentfit.report.mesh_check.convergence_figure", "indentfit.report.study_folder.write_study",
        "indentfit.report.study_text.html_table", "indentfit.report.study_text.mesh_check_lines",
        "indentfit.report.study_text.mesh_rows",
    },
    "study/design.py": {
        "indentfit.report.plots.designs", "indentfit.report.study_folder.write_design", "indentfit.report.study_text.design_lines",
        "indentfit.report.study_text.design_rows", "indentfit.report.study_text.html_table",
    },
    "study/predict.py": {"indentfit.report.prediction.prediction_lines"},
}  # fmt: skip
MODULES = sorted(HOUSE.rglob("*.py"))
MATERIALS = sorted((HOUSE.parent / "materials").glob("*.py"))
TESTS = sorted(Path(__file__).parent.glob("test_*.py"))


def imports(path, package):
    """Full dotted names that a module imports, wherever in it."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            home = package.split(".")[: len(package.split(".")) + 1 - node.level] if node.level else []
            base = ".".join([*home, *([node.module] if node.module else [])])
            yield from (f"{base}.{alias.name}" for alias in node.names)


def package_of(path):
    return ".".join(path.relative_to(HOUSE.parent).parent.parts)


def rooms_used(path):
    for name in set(imports(path, package_of(path))) - LAZY.get(str(path.relative_to(HOUSE)), set()):
        first, _, rest = name.partition(".")
        if first == "indentfit" and rest.split(".")[0] in ROOMS:
            yield rest.split(".")[0]


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(HOUSE)))
def test_a_module_imports_only_from_rooms_above_it(path):
    room = path.relative_to(HOUSE).with_suffix("").parts[0]
    if room in ("__init__", "packages"):
        assert not list(rooms_used(path))
        return
    room = "cli" if room == "__main__" else room
    assert room in ROOMS, f"{room} is no room of the house"
    below = [other for other in rooms_used(path) if ROOMS.index(other) > ROOMS.index(room)]
    assert not below, f"{path.name} imports from {below}"


@pytest.mark.parametrize("place", LAZY)
def test_lazy_imports_stand_in_functions_and_are_all_made(place):
    tree = ast.parse((HOUSE / place).read_text(encoding="utf-8"))
    above = {node.module for node in tree.body if isinstance(node, ast.ImportFrom)}
    assert not above & {name.rpartition(".")[0] for name in LAZY[place]}
    assert LAZY[place] <= set(imports(HOUSE / place, package_of(HOUSE / place)))


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(HOUSE)))
def test_only_reports_draw(path):
    if path.relative_to(HOUSE).parts[0] != "report":
        assert not DRAWING & {name.partition(".")[0] for name in imports(path, package_of(path))}


def test_other_rooms_know_of_materials_what_the_room_gives_out():
    inner = {f"indentfit.material.{path.stem}" for path in (HOUSE / "material").glob("*.py")} - {"indentfit.material.__init__"}
    outside = [path for path in MODULES + MATERIALS if (HOUSE / "material") not in path.parents]
    for path in outside:
        used = set(imports(path, package_of(path) if path in MODULES else "indentfit.materials"))
        assert not [name for name in used if name in inner or name.rpartition(".")[0] in inner], path.name


def test_no_module_of_materials_needs_itself():
    """Each imports only from modules that can be read before it, so that no order of imports meets a half-read module."""
    needs = {
        f"indentfit.material.{path.stem}": {name.rpartition(".")[0] for name in imports(path, package_of(path))}
        for path in (HOUSE / "material").glob("*.py")
        if path.stem != "__init__"
    }
    while needs:
        ready = {name for name, others in needs.items() if not others & needs.keys()}
        assert ready, f"a circle among {sorted(needs)}"
        assert all("indentfit.material" not in needs[name] for name in ready)  # the package itself is read last
        needs = {name: others for name, others in needs.items() if name not in ready}


@pytest.mark.parametrize("path", MATERIALS, ids=lambda path: path.name)
def test_a_material_knows_nothing_but_what_a_material_is(path):
    ours = {name for name in imports(path, "indentfit.materials") if name.startswith("indentfit.")}
    assert all(name.startswith("indentfit.material.") for name in ours)


@pytest.mark.parametrize("path", MODULES + MATERIALS, ids=lambda path: path.name)
def test_names_say_what_things_are(path):
    """Nothing is called data, utils, manager or handler."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    kinds = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)
    names = [path.stem, *(node.name for node in ast.walk(tree) if isinstance(node, kinds))]
    names += [node.id for node in ast.walk(tree) if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)]
    names += [node.arg for node in ast.walk(tree) if isinstance(node, ast.arg)]
    words = {word for name in names for word in name.lower().split("_")}
    assert not words & {"data", "util", "utils", "manager", "handler"}


@pytest.mark.parametrize("path", MODULES + MATERIALS, ids=lambda path: path.name)
def test_a_variable_has_the_name_of_what_it_holds(path):
    tree = ast.parse(path.read_text(encoding="utf-8"))
    names = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)} | {
        node.arg for node in ast.walk(tree) if isinstance(node, ast.arg)
    }
    assert not names & {"one", "found"}


@pytest.mark.parametrize("path", MODULES + MATERIALS, ids=lambda path: path.name)
def test_a_module_says_what_it_is(path):
    text = path.read_text(encoding="utf-8")
    assert not text.strip() or ast.get_docstring(ast.parse(text))


@pytest.mark.parametrize("path", MODULES + MATERIALS, ids=lambda path: path.name)
def test_nothing_that_is_read_is_run_as_code(path):
    """No pickle and its kin anywhere; exec only where a plugin is loaded that the case names."""
    used = {name.partition(".")[0] for name in imports(path, package_of(path) if path in MODULES else "indentfit.materials")}
    assert not used & {"pickle", "marshal", "shelve", "dill", "cloudpickle", "joblib"}
    called = {
        node.func.id
        for node in ast.walk(ast.parse(path.read_text("utf-8")))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
    }
    assert called & {"eval", "exec", "compile"} <= ({"exec", "compile"} if path == HOUSE / "material" / "plugins.py" else set())


@pytest.mark.parametrize("path", TESTS, ids=lambda path: path.name)
def test_no_test_imports_from_another(path):
    """What tests share lives in the package tests/fixtures, and conftest.py says no more than which of it pytest loads."""
    first = {name.partition(".")[0] for name in imports(path, "")}
    assert not first & {"conftest", "tests", *(other.stem for other in TESTS)}


@pytest.mark.parametrize("path", TESTS, ids=lambda path: path.name)
def test_no_test_holds_a_whole_case_as_text(path):
    """The tiny case is written once, from values, by `tiny_case` of tests/fixtures/cases.py."""
    texts = [node.value for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if isinstance(node, ast.Constant)]
    assert not [text for text in texts if isinstance(text, str) and {"sample", "indenter", "mesh"} <= tables(text)]


def tables(text):
    """Names of the tables that a TOML text begins, `[mesh]` or `mesh = {`."""
    return {one or other for one, other in re.findall(r"^\s*(?:\[(\w+)\]|(\w+) = \{)", text, re.M)}


# ---- sizes -------------------------------------------------------------------------------------------------------

COMPILED = {"fem/element.py"}  # a compiled loop, and why it is long is said there
SOLVER = ("fem",)


def functions(path):
    kinds = (ast.FunctionDef, ast.AsyncFunctionDef)
    return [node for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if isinstance(node, kinds)]


def lines_of_code(function):
    """Lines of a function without its docstring."""
    first = function.body[0]
    documented = ast.get_docstring(function) is not None
    return function.end_lineno - function.lineno + 1 - (first.end_lineno - first.lineno + 1 if documented else 0)


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(HOUSE)))
def test_no_file_is_longer_than_500_lines(path):
    if path.relative_to(HOUSE).as_posix() not in COMPILED:
        assert len(path.read_text(encoding="utf-8").splitlines()) <= 500


def test_functions_fit_on_a_part_of_the_screen():
    lengths = np.array([lines_of_code(function) for path in MODULES for function in functions(path)])
    assert np.median(lengths) <= 7
    assert np.percentile(lengths, 90) <= 19


@pytest.mark.parametrize(
    "path", [path for path in MODULES if path.relative_to(HOUSE).parts[0] in SOLVER], ids=lambda path: path.name
)
def test_no_function_of_the_solver_takes_nine_positional_arguments(path):
    """Compiled kernels may: they know arrays and numbers only."""
    for function in functions(path):
        decorators = " ".join(map(ast.unparse, function.decorator_list))
        kernel = any(word in decorators for word in ("kernel", "inlined", "compiled"))
        assert kernel or len(function.args.posonlyargs) + len(function.args.args) < 9, function.name


def test_no_import_goes_round_in_a_circle():
    """The graph of imports at module level; what is imported inside of a function is no part of it."""
    names = {module_name(path): path for path in MODULES}
    graph = {name: {used for used in imports_at_once(path) if used in names} for name, path in names.items()}
    sorter = graphlib.TopologicalSorter(graph)
    sorter.prepare()  # raises CycleError


def module_name(path):
    parts = path.relative_to(HOUSE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imports_at_once(path):
    """Modules that a module imports when it is imported itself, `if TYPE_CHECKING` left out."""
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
