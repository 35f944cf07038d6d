"""The tutorial of a law of one's own does what it says: its blocks are run in their order."""

import json
import re
import shlex
import shutil

import pytest
from click.testing import CliRunner
from fixtures.cases import CASES

from indentfit.cli import main
from indentfit.curve import read_curve

pytestmark = pytest.mark.guide
FOLDER = CASES / "own_material"
PAGE = CASES.parent / "indentfit" / "guide" / "own_law.md"
BLOCK = re.compile(r"```(python|sh)\n(.*?)```", re.DOTALL)


@pytest.fixture(scope="module")
def after(tmp_path_factory):
    """The folder after every block of the page was run, with the case and its curve, but the model from the page alone."""
    folder = tmp_path_factory.mktemp("tutorial")
    for name in ("case.toml", "curve.csv"):
        shutil.copyfile(FOLDER / name, folder / name)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for language, text in BLOCK.findall(PAGE.read_text(encoding="utf-8")):
            if language == "python":
                (folder / "demiray.py").write_text(text, encoding="utf-8")
                continue
            for line in text.splitlines():
                program, *words = shlex.split(line)
                assert program == "indentfit"
                done = CliRunner().invoke(main, words)
                assert done.exit_code == 0, f"{line}\n{done.output}"
    return folder


def test_the_model_on_the_page_is_the_one_beside_it(after):
    assert (after / "demiray.py").read_text() == (FOLDER / "demiray.py").read_text()


def test_the_curve_is_that_of_the_known_parameters_and_the_fit_comes_back_to_them(after):
    measured = read_curve(after / "curve.csv")
    known = json.loads((after / "known" / "simulation.json").read_text())["tests"][0]["force_mN"]
    assert measured.force == pytest.approx(known, abs=1e-3, rel=1e-3)
    found = json.loads((after / "fitted" / "result.json").read_text())["parameters"]
    assert found["mu"]["value"] == pytest.approx(1.4, rel=0.01) and found["b"]["value"] == pytest.approx(6, rel=0.03)


def test_the_page_of_the_fit_says_what_material_it_was(after):
    text = (after / "fitted" / "report.html").read_text()
    assert 'alttext="psi = mu / (2 b) [exp(b (I1 - 3)) - 1]"' in text and "demiray.py:Demiray" in text
