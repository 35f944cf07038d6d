"""The package as it is used from a notebook: the public names, and the example of the guide."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from fixtures.two_layers import Layers

import indentfit

PAGE = Path(indentfit.__file__).parent / "guide" / "python.md"
STUB = Path(indentfit.__file__).with_name("__init__.pyi")
# k of a bonded layer, a/h = 2 / 3.3. Hayes et al. 1972 have 2.213 at 0.6 and 2.860 at 0.8 for nu = 0.5, between them 2.231; the
# example's bulk ratio of 1000 is nu = 0.4995. Hankel's transform meets Hayes' table (tests/test_layered.py).
NU = 0.4995
HAYES = Layers((0.3, 0.7), (1.0, 1.0), (NU, NU)).punch(2 / 3.3) * (1 - NU) / 4 / (2 / 3.3)


def in_a_new_process(text, folder):
    environment = {**os.environ, "MPLBACKEND": "agg"}
    done = subprocess.run([sys.executable, "-c", text], cwd=folder, env=environment, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_every_public_name_of_the_stub_is_there(tmp_path):
    names = re.findall(r" as (\w+)$", STUB.read_text(), flags=re.M)
    assert len(names) > 20
    for name in names:
        assert getattr(indentfit, name).__name__ == name
    assert set(names) == set(indentfit.__all__) <= set(dir(indentfit))


def test_importing_the_package_imports_none_of_the_libraries(tmp_path):
    heavy = ["numpy", "scipy", "sympy", "numba", "matplotlib", "skfem", "pydantic", "pint"]
    said = in_a_new_process(
        f"import sys, indentfit; indentfit.__version__; print([n for n in {heavy} if n in sys.modules])", tmp_path
    )
    assert said.strip() == "[]"


def test_the_example_of_the_guide_finds_the_modulus_of_the_elastic_layer(tmp_path):
    """A frictionless flat punch on a bonded layer: F = 4 G a w k / (1 - nu); the example's force belongs to G = 0.60 kPa."""
    example = re.search(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)[1]
    said = in_a_new_process(example + "\nprint('END', mu.value, *mu.interval)", tmp_path)
    value, low, high = map(float, said.rsplit("END", 1)[1].split())
    assert pytest.approx(2.231, rel=2e-3) == HAYES
    G = 21.4 * (1 - NU) / (4 * 2 * HAYES)
    assert low < G < high
    assert abs(value / G - 1) < 0.1
    assert {"result.json", "report.html", "case.toml", "fit.png"} <= {path.name for path in (tmp_path / "gel-result").iterdir()}
    again = indentfit.read_case(tmp_path / "gel-result" / "case.toml")
    assert again.curves[0].force[-1] == 21.4 * 0.3


@pytest.mark.parametrize(
    "call",
    [
        indentfit.fit,
        indentfit.simulate,
        indentfit.mesh_check,
        indentfit.design,
        lambda case: indentfit.sweep(case, {"material.mu": [1, 2]}),
        lambda case: indentfit.compare(case, ["ogden", "yeoh"]),
    ],
)
@pytest.mark.parametrize(("given", "shown"), [("case.toml", "'case.toml'"), ({"sample": {}}, "a dict")])
def test_what_is_no_case_is_told_how_to_make_one(call, given, shown):
    with pytest.raises(indentfit.IndentfitError, match=rf"^{shown} is no Case; indentfit.read_case\(PATH\) reads a case file"):
        call(given)
