"""Result folders of version 0.1, stored in tests/baseline/results-0.1, are still read: `indentfit report` draws their pages."""

import json
import math
import shutil
from html import unescape
from pathlib import Path
from pkgutil import resolve_name

import pytest
from click.testing import CliRunner
from matplotlib.text import Text

from indentfit.cli import main
from indentfit.digits import plainly
from indentfit.report.html import PAGES
from indentfit.report.schema import CLASSES, StoredSimulation
from indentfit.report.typeset import typeset
from indentfit.runs.simulated import SimulatedCase
from indentfit.study.sweep import Sweep

pytestmark = pytest.mark.quick

OLD = Path(__file__).parent / "baseline" / "results-0.1"


# the signs of a typeset page, and how they are typed
TYPED = {"\N{NO-BREAK SPACE}": " ", "−": "-", "±": "+-", "μ": "mu", "ζ": "zeta", "φ": "phi"}


@pytest.fixture
def drawn(tmp_path):
    """drawn(folder) -> (what the stored JSON says, the text of the page that `report` makes of the folder)."""

    def drawn(folder, file="result.json"):
        shutil.copytree(OLD / folder, tmp_path / "old")
        done = CliRunner().invoke(main, ["report", str(tmp_path / "old")])
        assert done.exit_code == 0, done.output
        page = unescape((tmp_path / "old" / "report.html").read_text(encoding="utf-8"))
        for sign, typed in TYPED.items():
            page = page.replace(sign, typed)
        return json.loads((OLD / folder / file).read_text(encoding="utf-8")), page

    return drawn


@pytest.mark.parametrize("folder", ["fit", "per_sample/S1"])
def test_a_fit_of_version_0_1(drawn, folder):
    result, page = drawn(folder)
    assert result["format_version"] == 1
    for name, parameter in result["parameters"].items():
        if parameter["fixed"]:
            assert name in page and f"{parameter['value']:.5g}" in page
        else:
            decimals = 1 - math.floor(math.log10(parameter["stderr"]))  # two digits of the error
            assert name in page and f"{parameter['value']:.{decimals}f}" in page
            assert parameter["verdict"] in page
            assert " to ".join(f"{end:.{decimals}f}" for end in parameter["interval"]) in page
    assert f"{result['objective']:.4g} mN" in page and result["case_hash"] in page
    course = sum(step["objective"] is not None for step in result["history"]) > 1
    assert page.count("<svg") == 1 + course + len(result["profiles"])
    assert all(f"Profile of {name}" in page for name in result["profiles"])


def test_a_simulation_of_version_0_1(drawn):
    result, page = drawn("simulation", "simulation.json")
    assert result["format"] == "indentfit.simulation/1"
    for test in result["tests"]:
        assert test["name"] in page and f"{test['force_mN'][-1]:.5g}" in page
    assert "disc" in page and "strip" in page and str(result["mesh"]["dofs"]) in page.replace(",", "")


@pytest.mark.parametrize(("folder", "figures"), [("sweep", 1 + 2 * 2), ("grid", 2)])
def test_a_sweep_of_version_0_1(drawn, folder, figures):
    result, page = drawn(folder)
    assert result["format"] == "indentfit.sweep/1" and len(result["points"]) == 4
    for point in result["points"]:
        assert ", ".join(f"{key} = {value}" for key, value in point["values"].items()) in page
        for test in point["tests"].values():
            assert f"{test['force_mN']:.4g}" in page and f"{100 * test['force_change']:+.2f} %" in page
    for row in result["sensitivities"]:
        assert f"{100 * row['force_span']:.3g} %" in page
    assert page.count("<svg") == figures


def test_the_plot_of_a_sweep_that_was_read_names_the_units():
    figure = Sweep.from_json(json.loads((OLD / "grid" / "result.json").read_text(encoding="utf-8"))).plot()
    assert "material.mu (kPa)" in [text.get_text() for text in figure.findobj(Text)]


def test_a_mesh_check_of_version_0_1(drawn):
    result, page = drawn("mesh_check")
    assert result["format"] == "indentfit.mesh-check/1" and len(result["changes"]) == 9
    assert typeset(result["verdict"]) in page
    for mesh in result["meshes"]:
        assert mesh["asked"] in page and f"{mesh['dofs']:,}" in page
    for quantity in result["quantities"]:
        assert f"{quantity['approach']['value']:.5g}" in page
    for change in result["changes"]:
        assert all(f"{100 * share:+.2f} %" in page for share in change["changes"].values())
    assert page.count("<svg") == 1 + len(result["quantities"])


def test_a_design_of_version_0_1(drawn):
    result, page = drawn("design", "design.json")
    assert "format" not in result and len(result["candidates"]) == 36
    best = result["candidates"][0]
    assert f"Best for {result['worst']}: {best['change']}, angle {best['angle']}°" in page
    for test in result["candidates"]:
        assert (test["change"] or "as the case is") in page
        assert all(plainly(1.959964 * error) in page for error in test["stderr"].values())  # half widths, not known to 0.1
    assert result["case_hash"] in page and page.count("<svg") == 1


def test_fits_of_samples_of_version_0_1(drawn):
    result, page = drawn("per_sample", "per_sample.json")
    assert result["format"] == "indentfit.per_sample/1"
    for sample in result["samples"]:
        mu = sample["parameters"]["mu"]
        assert f"{mu['value']:.4g} +- {mu['stderr']:.2g}" in page and f"{sample['folder']}/report.html" in page
    spread = result["spread"]["mu"]
    assert f"{spread['mean']:.4g} +- {spread['sd']:.3g} (SD) kPa" in page and page.count("<svg") == 1


def test_processed_records_of_version_0_1(drawn):
    result, page = drawn("process", "summary.json")
    assert result["format"] == "indentfit.records/1" and "4 of 4 records could be used" in page
    for record in result["records"]:
        line, contact = record["linear"], record["contact"]
        assert f"{record['sample']} {record['direction']}°" in page
        assert f"{line['slope']:.4g} +- {line['stderr']:.2g}" in page
        assert f"{contact['displacement']:.4f} +- {contact['uncertainty']:.4f}" in page
    for spread in (*result["stiffness_mN_per_mm"].values(), result["ratio_90_to_0"]):
        assert f"{spread['mean']:.4g}" in page and " to ".join(f"{end:.4g}" for end in spread["interval"]) in page
    assert all(difference["test"] in page and f"{difference['p']:.3g}" in page for difference in result["differences"])


@pytest.mark.parametrize("tag", CLASSES)
def test_the_class_of_a_tag_is_the_one_that_writes_it(tag):
    kind = resolve_name(CLASSES[tag])
    assert tag == (SimulatedCase if kind is StoredSimulation else kind).FORMAT


def test_every_result_has_a_page():
    assert {name.partition(":")[2] for name in CLASSES.values()} == set(PAGES)
    assert all(callable(resolve_name(f"indentfit.report.{page}")) for page in PAGES.values())
