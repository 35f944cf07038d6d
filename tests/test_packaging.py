"""What is installed: a wheel holds every module and page of the package, and the materials as indentfit.materials."""

import os
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent


def of_the_tree():
    """Files that a wheel must hold, by their names there."""
    kinds = (".py", ".pyi", ".html", ".css", ".md", ".toml")
    package = {path.relative_to(ROOT).as_posix() for path in (ROOT / "indentfit").rglob("*") if path.suffix in kinds}
    package |= {path.relative_to(ROOT).as_posix() for path in (ROOT / "indentfit").rglob("py.typed")}
    materials = {f"indentfit/{path.relative_to(ROOT).as_posix()}" for path in (ROOT / "materials").rglob("*.py")}
    return package | materials


def test_the_wheel_holds_every_file_of_the_package(tmp_path):
    source = tmp_path / "source"  # a copy: what earlier builds left in the tree is not to be found
    source.mkdir()
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source)
    for name in ("indentfit", "materials"):
        shutil.copytree(ROOT / name, source / name, ignore=shutil.ignore_patterns("__pycache__"))
    command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", str(tmp_path), str(source)]
    subprocess.run(command, check=True, capture_output=True, timeout=300)
    (wheel,) = tmp_path.glob("*.whl")
    with zipfile.ZipFile(wheel) as file:
        held = {name for name in file.namelist() if name.startswith("indentfit/")}
    assert held == of_the_tree()


def test_python_m_indentfit_is_the_command():
    done = subprocess.run([sys.executable, "-m", "indentfit", "--version"], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0
    assert done.stdout.startswith("indentfit ")


@pytest.mark.guide
@pytest.mark.parametrize("command", ["pipx install .", "uv tool install ."])
def test_the_commands_of_the_readme_install_the_tool(command, tmp_path):
    assert f"\n    {command}\n" in (ROOT / "README.md").read_text()
    tool = command.partition(" ")[0]
    if shutil.which(tool) is None:
        pytest.skip(f"pip install {tool}")
    source = tmp_path / "source"
    shutil.copytree(ROOT, source, ignore=shutil.ignore_patterns(".venv", ".git", "__pycache__", "build", "*.egg-info"))
    places = {"PIPX_HOME": "home", "PIPX_BIN_DIR": "bin", "UV_TOOL_DIR": "tools", "UV_TOOL_BIN_DIR": "bin", "UV_CACHE_DIR": "cache"}
    environment = os.environ | {name: str(tmp_path / place) for name, place in places.items()}
    subprocess.run(command.split(), cwd=source, env=environment, check=True, capture_output=True, timeout=600)
    done = subprocess.run([str(tmp_path / "bin" / "indentfit"), "--version"], capture_output=True, text=True, timeout=60)
    assert done.stdout.startswith("indentfit ")


ON_CONDA = {"matplotlib": "matplotlib-base"}  # names that differ


def test_the_release_has_one_version_and_the_conda_recipe_the_requirements_of_the_package():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    recipe, version = (ROOT / ".ci" / "conda" / "recipe.yaml").read_text(), project["version"]
    assert f'version: "{version}"' in recipe and f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text()
    assert f"\n## [{version}] - " in (ROOT / "CHANGELOG.md").read_text()
    run = re.search(r"\n  run:\n(.*?)\n  run_constraints:\n(.*?)\n\n", recipe, re.DOTALL)
    listed = dict(re.findall(r"- ([\w-]+) (>=[\d.]+)", run[1] + run[2]))
    wanted = dict(re.match(r"([\w-]+)(>=[\d.]+)", line).groups() for line in project["dependencies"])
    assert listed == {ON_CONDA.get(name, name): least for name, least in wanted.items()}


def test_rattler_build_renders_the_recipe():
    """rattler-build is what conda-forge builds with: it refuses keys, selectors and requirements that it does not understand."""
    rattler = pytest.importorskip("rattler_build", reason="pip install py-rattler-build")
    recipe = rattler.Stage0Recipe.from_yaml((ROOT / ".ci" / "conda" / "recipe.yaml").read_text())
    (variant,) = recipe.render(rattler.VariantConfig.from_yaml("python_min: ['3.11']\n"))
    assert "indentfit" in str(variant)
    with pytest.raises(rattler.RattlerBuildError):
        rattler.Stage0Recipe.from_yaml("schema_version: 1\npackage: {name: x, version: '1'}\nrequirement: {run: [python]}\n")
