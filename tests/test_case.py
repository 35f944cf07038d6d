"""The case file: what it may say, what `--set` changes, and what a result depends on."""

import pickle
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from indentfit.case import Case, Indenter, MaterialChoice, Range, Sample, Test, read_case_file, require_fittable
from indentfit.errors import CaseError
from indentfit.experiment.measured import read_case

pytestmark = pytest.mark.quick

CASES = Path(__file__).parent.parent / "cases"
PAPER = CASES / "white_matter_2017" / "case.toml"


def problems(*overrides, path=PAPER):
    """What is said about a case with these overrides, without the file's name; empty if it is valid."""
    try:
        read_case(path, overrides)
    except CaseError as error:
        assert all(line.startswith(str(path)) and line.isprintable() for line in error.faults)
        return [line.removeprefix(str(path)).removeprefix(" (--set)").removeprefix(": ") for line in error.faults]
    return []


@pytest.fixture
def copy(tmp_path):
    """A copy of the paper's case, to be changed."""
    shutil.copytree(PAPER.parent, tmp_path / "case")
    return tmp_path / "case" / "case.toml"


# What the shipped cases say


@pytest.mark.parametrize("name", ["white_matter_2017", "white_matter_small_strain", "quickstart", "rig_records", "hydrogel_sphere"])
def test_a_shipped_case_is_valid_without_warnings(name):
    case = read_case(CASES / name / "case.toml")
    assert case.warnings() == []
    require_fittable(case)


def test_the_paper_s_case_is_the_paper_s_experiment():
    case = read_case(PAPER)
    assert case.sample.geometry.outline.extent == (14.0, 14.0)
    assert (case.sample.thickness, case.sample.base) == (3.3, "sliding")
    assert (case.indenter.geometry.half_width, case.indenter.length, case.indenter.friction) == (1.0, 20.0, 0.5)
    assert [test.angle for test in case.tests] == [0, 90]
    assert [test.weight for test in case.tests] == [0.5, 0.5]
    assert case.mesh.default
    assert case.material.bulk_modulus(1.49) == 1490.0
    for curve, stiffness in zip(case.curves, (72.9, 170.5), strict=True):
        np.testing.assert_allclose(curve.displacement, 0.33 * np.arange(1, 26) / 25, atol=1e-9)
        np.testing.assert_allclose(curve.force, stiffness * curve.displacement, atol=1e-6)


def test_the_small_strain_case_goes_to_five_percent_of_the_thickness():
    case = read_case(CASES / "white_matter_small_strain" / "case.toml")
    for curve, stiffness in zip(case.curves, (27.84, 67.18), strict=True):
        assert curve.displacement[-1] == pytest.approx(0.05 * case.sample.thickness, rel=1e-9)
        np.testing.assert_allclose(curve.force, stiffness * curve.displacement, atol=1e-6)


def test_every_shipped_case_says_where_it_comes_from():
    folders = [folder for folder in CASES.iterdir() if folder.is_dir()]
    assert {"white_matter_2017", "white_matter_small_strain", "quickstart"} <= {folder.name for folder in folders}
    for folder in folders:
        assert (folder / "README.md").stat().st_size > 300


# Free and fixed parameters


def test_free_parameters_come_in_the_order_of_the_model():
    parameters = "material.parameters={phi={start=1,min=0,max=5}, zeta=3, mu={start=2,min=1,max=4}}"
    case = read_case(PAPER, [parameters])
    assert list(case.free) == ["mu", "phi"]
    assert case.free["mu"] == Range(start=2.0, min=1.0, max=4.0)
    assert list(case.start_values().items()) == [("mu", 2.0), ("zeta", 3.0), ("phi", 1.0)]


def test_a_case_without_free_parameters_is_valid_but_cannot_be_fitted():
    case = read_case(PAPER, ["material.mu=1", "material.zeta=1", "material.phi=1", "test.parallel.depth=0.3"])
    with pytest.raises(CaseError) as caught:
        require_fittable(case)
    assert [line.removeprefix(f"{PAPER}: ").split(":")[0] for line in caught.value.faults] == [
        "material.parameters",
        "test.parallel.curve",
    ]


def test_a_fit_needs_some_weight():
    with pytest.raises(CaseError, match="every weight is 0"):
        require_fittable(read_case(PAPER, ["test.parallel.weight=0", "test.perpendicular.weight=0"]))


def test_outputs_are_those_of_the_curve_or_evenly_down_to_the_depth():
    case = read_case(PAPER, ["test.parallel.depth=0.2", "test.parallel.points=4"])
    np.testing.assert_allclose(case.outputs(case.tests[0]), [0.05, 0.1, 0.15, 0.2], rtol=1e-14)
    assert case.outputs(case.tests[1]) is case.curves[1].displacement


def test_weights_are_shared_where_none_is_given(copy):
    copy.write_text(copy.read_text().replace("weight = 0.5", ""))
    assert [test.weight for test in read_case(copy).tests] == [0.5, 0.5]


# Units


@pytest.mark.parametrize(
    ("override", "expected"),
    [
        ("sample.thickness=3.3 mm", 3.3),
        ("sample.thickness='3.3mm'", 3.3),
        ("sample.thickness=3300 um", 3.3),
        ("sample.thickness=3300 µm", 3.3),
        ("sample.thickness=0.33 cm", 3.3),
        ("sample.thickness=3.3e-3 m", 3.3),
        ("sample.thickness=4", 4.0),
    ],
)
def test_a_length_may_carry_its_unit(override, expected):
    assert read_case(PAPER, [override]).sample.thickness == pytest.approx(expected, rel=1e-13)


@pytest.mark.parametrize("value", ["1.49", "1.49 kPa", "1490 Pa", "0.00149 MPa", "1490 N/m^2", "1.49 mN/mm^2"])
def test_a_parameter_may_carry_its_unit(value):
    fixed = read_case(PAPER, [f"material.mu={value}"])
    start = read_case(PAPER, [f"material.mu.start={value}"])
    assert fixed.start_values()["mu"] == pytest.approx(1.49, rel=1e-13)
    assert start.free["mu"].start == pytest.approx(1.49, rel=1e-13)


# Overrides


@pytest.mark.parametrize(
    ("override", "value"),
    [
        ("indenter.friction=0.2", lambda case: case.indenter.friction == 0.2),
        ("indenter.friction=stick", lambda case: case.indenter.friction == "stick"),
        ('indenter.friction="stick"', lambda case: case.indenter.friction == "stick"),
        (" sample.base = bonded ", lambda case: case.sample.base == "bonded"),
        ("material.parameters.mu=1.2", lambda case: case.material.parameters["mu"] == 1.2),
        ("material.mu=1.2", lambda case: case.material.parameters["mu"] == 1.2),
        ("material.parameters.mu.max=5", lambda case: case.free["mu"].max == 5.0),
        ("test.parallel.weight=0.3", lambda case: case.tests[0].weight == 0.3),
        ("test.1.weight=0.3", lambda case: case.tests[1].weight == 0.3),
        ("test.parallel.depth=0.2", lambda case: case.curves[0] is None and case.tests[0].depth == 0.2),
        ("mesh.elements=300", lambda case: case.mesh.elements == 300 and not case.mesh.default),
        ("material.kappa=2000", lambda case: case.material.bulk_modulus(1.0) == 2000.0),
        ("material.model=neo_hookean", None),
        ("title=a = b", lambda case: case.title == "a = b"),
        ("solver.assembly=forms", lambda case: case.solver.assembly == "forms"),
    ],
)
def test_an_override_replaces_any_key(override, value):
    if value is None:
        assert problems(override)  # the file's zeta and phi are not its parameters
        assert not problems(override, "material.parameters={mu=1}")
    else:
        assert value(read_case(PAPER, [override]))


def test_an_override_takes_its_rival_out_of_the_file(copy):
    text = copy.read_text().replace("[mesh]", "[mesh]\nsize = 0.5 #")
    copy.write_text(text)
    assert read_case(copy).mesh.size == 0.5
    assert read_case(copy, ["mesh.elements=200"]).mesh.size is None
    assert problems("mesh.elements=200", "mesh.size=1", path=copy)


def test_another_shape_takes_the_sizes_of_the_old_one_out():
    case = read_case(PAPER, ["sample.shape=block", "sample.length=10", "sample.width=12"])
    assert case.sample.geometry.outline.extent == (10.0, 12.0)
    case = read_case(PAPER, ["indenter.shape=sphere", "indenter.diameter=4"])
    assert (case.indenter.geometry.half_width, case.indenter.width) == (2.0, None)


def test_a_typed_energy_replaces_the_model():
    case = read_case(PAPER, ["material.energy=G/2*(I1-3)", "material.parameters={G={start=1,min=0.1,max=9}}"])
    assert case.material.model is None
    assert case.law(**case.start_values()).shear_modulus == pytest.approx(1.0)
    assert pickle.loads(pickle.dumps(case)).hash == case.hash


# What is refused: one line for each key, naming it

WRONG = {
    "sample.thickness=-3.3": "sample.thickness = -3.3: must be above 0",
    "sample.thickness=0": "sample.thickness = 0: must be above 0",
    "sample.thickness=nan": "sample.thickness = NaN: must be a finite number",
    "sample.thickness=inf": "sample.thickness = Infinity: must be a finite number",
    "sample.thickness=true": "sample.thickness = true: must be a number",
    "sample.thickness=[3.3]": "sample.thickness = [3.3]: must be a number",
    "sample.thickness='3.3'": 'sample.thickness = "3.3": must be a number in mm',
    "sample.thickness=3.3 kPa": 'sample.thickness = "3.3 kPa": is in kPa, which cannot be converted to mm',
    "sample.thickness=3.3 mn": 'sample.thickness = "3.3 mn": ',
    "sample.thickness=3.3 foo": "unknown unit 'foo'; use mm",
    "sample.thickness=3 m**99999": "has no readable unit",
    "sample.thickness=1" + "0" * 400: "sample.thickness = 1000",
    "sample.thicknes=3.3": "sample.thicknes = 3.3: unknown key; did you mean thickness?",
    "sample.friction=0.5": "sample.friction = 0.5: unknown key here; it belongs to [indenter]",
    "sample.shape=ball": "sample.shape = \"ball\": must be 'disc' or 'block'",
    "sample.base=glued": "must be 'sliding', 'bonded' or 'unknown'",
    "sample.length=14": "sample.length = 14.0: does not belong to a disc",
    "sample=3": "sample = 3: must be a table",
    "smaple.base=bonded": "unknown key; did you mean sample?",
    "indenter.width=14": "indenter.width = 14.0: too wide for the sample of 14 mm",
    "indenter.width=-2": "indenter.width = -2: must be above 0",
    "indenter.edge_radius=1.1": "indenter.edge_radius = 1.1: must not exceed half",
    "indenter.edge_radius=-0.1": "indenter.edge_radius = -0.1: must be at least 0",
    "indenter.friction=-0.1": "indenter.friction = -0.1: must be a coefficient",
    "indenter.friction=nan": "indenter.friction = NaN: must be a coefficient",
    "indenter.friction=slick": 'indenter.friction = "slick": must be a coefficient',
    "indenter.friction=true": "indenter.friction = true: must be a coefficient",
    "mesh.size=5": "mesh.size = 5.0: exceeds the thickness",
    "mesh.size=0": "mesh.size = 0: must be above 0",
    "mesh.elements=0": "mesh.elements = 0: must be at least 20",
    "mesh.elements=300.5": "mesh.elements = 300.5: must be a whole number",
    "material.model=transverse_isotropic": "did you mean 'transversely_isotropic'",
    "material.model=nothing_like_it": "no material 'nothing_like_it'; installed: arruda_boyce, demiray_fung, fung_orthotropic, ",
    "material.model=none.py:Mine": 'material.model = "none.py:Mine": no material file',
    "material.model=3": "material.model = 3: must be text in quotes",
    "material.kappa=0": "material.kappa = 0: must be above 0",
    "material.bulk_ratio=-1": "material.bulk_ratio = -1: must be above 0",
    "material.energy=__import__('os')": "material.energy = ",
    "material.parameters.muu=1": "material.parameters.muu = 1.0: unknown parameter; did you mean mu?",
    "material.mu=-1": "material.parameters.mu = -1.0: the model needs at least 0",
    "material.mu=0": "shear modulus of 0 kPa",
    "material.mu=nan": "material.parameters.mu = NaN: must be a finite number",
    "material.mu=true": "material.parameters.mu = true: must be a finite number",
    "material.mu=1 mm": "is in mm, which cannot be converted to kPa",
    "material.zeta=1 Pa": "must be a plain number",
    "material.zeta.min=-1": "material.parameters.zeta.min = -1.0: the model needs at least 0",
    "material.mu.min=11": "material.parameters.mu.min = 11.0: must be below max = 10",
    "material.mu.min=10": "material.parameters.mu.min = 10.0: must be below max = 10",
    "material.mu.start=11": "material.parameters.mu.start = 11.0: is above max = 10",
    "material.mu.start=0.01": "material.parameters.mu.start = 0.01: is below min = 0.1",
    "material.mu.strat=1": "material.parameters.mu.strat = 1: unknown key; did you mean start?",
    "test.parallel.angle=180": "test.parallel.angle = 180: must be at least 0 and below 180",
    "test.parallel.angle=false": "test.parallel.angle = false: must be at least 0 and below 180",
    "test.parallel.curve=none.csv": 'test.parallel.curve = "none.csv": ',
    "test.parallel.curve=.": "not a file",
    "test.parallel.depth=1.7": "test.parallel.depth = 1.7: goes 1.7 mm deep; it must not exceed half",
    "test.parallel.depth=-0.1": "test.parallel.depth = -0.1: must be above 0",
    "test.parallel.points=5": "test.parallel.points = 5: belongs to a test with a depth",
    "test.parallel.weight=-1": "test.parallel.weight = -1: must be at least 0",
    "test.paralel.weight=1": "no such test; write test.NAME.KEY; did you mean parallel?",
    "test.7.weight=1": "test.7.weight = 1: no such test",
    "test.perpendicular.name=parallel": 'test.1.name = "parallel": another test has this name',
    "test=3": "test = 3: must be a list of tables",
    "fit.method=genetic": "fit.method = \"genetic\": must be 'ga', 'least_squares', 'differential_evolution' or 'cma'",
    "fit.seed=-1": "fit.seed = -1: must be at least 0",
    "fit.workers=0": "fit.workers = 0: must be at least 1",
    "solver.linear=mumps": "must be 'auto', 'pardiso', 'superlu' or 'pyamg'",
    "title=3": "title = 3: must be text",
    "frobnicate=1": "frobnicate = 1: unknown key; known here: ",
    "frobnicate": '--set = "frobnicate": write KEY=VALUE',
    "=1": "write KEY=VALUE",
    "path=elsewhere": 'path = "elsewhere": unknown key',
    "curves=3": "curves = 3: unknown key",
}


@pytest.mark.parametrize("override", WRONG, ids=lambda text: text[:40])
def test_a_wrong_value_is_refused_in_one_line(override):
    (line,) = problems(override)
    assert WRONG[override] in line
    assert len(line) < 300


def test_half_of_the_thickness_is_deep_enough_and_a_sphere_goes_on_as_its_shaft():
    assert not problems("test.parallel.depth=1.65")
    assert not problems("indenter.shape=sphere", "indenter.diameter=0.5")


def test_a_large_sphere_is_as_wide_as_its_imprint():
    # Imprint at 0.33 mm of a sphere of 40 mm: 2 sqrt(0.33 x 39.67) = 7.2 mm, of 200 mm: 16 mm on a sample of 14 mm.
    assert not problems("indenter.shape=sphere", "indenter.diameter=40")
    assert problems("indenter.shape=sphere", "indenter.diameter=200")


def test_every_error_is_listed_at_once(copy):
    text = copy.read_text()
    for old, new in {
        "thickness = 3.3 ": "thickness = -3.3 ",
        "width = 2 ": "width = 20 ",
        "friction = 0.5": "frictoin = 0.5",
        "min = 0.1, max = 10": "min = 10, max = 0.1",
        "angle = 90": "angle = 245",
        "parallel.csv": "lost.csv",
        'method = "ga"': 'method = "gas"',
    }.items():
        assert old in text
        text = text.replace(old, new, 1)
    copy.write_text(text)
    keys = {line.split(" = ")[0].split(":")[0] for line in problems(path=copy)}
    assert keys == {
        "sample.thickness",
        "indenter.width",
        "indenter.frictoin",
        "material.parameters.mu.min",
        "test.perpendicular.angle",
        "test.parallel.curve",
        "fit.method",
    }


def test_what_is_missing_is_named(tmp_path):
    (tmp_path / "case.toml").write_text("[sample]\nshape = 'block'\n[material]\n[[test]]\n")
    keys = {line.split(":")[0] for line in problems(path=tmp_path / "case.toml")}
    assert keys == {
        "sample.length",
        "sample.width",
        "sample.thickness",
        "indenter",
        "material.model",
        "test.0.name",
        "test.0.curve",
    }


@pytest.mark.parametrize("content", ["", "# nothing\n", "\ufeff"])
def test_an_empty_case_is_answered_with_what_it_needs(tmp_path, content):
    (tmp_path / "case.toml").write_text(content, encoding="utf-8")
    lines = problems(path=tmp_path / "case.toml")
    assert [line.split(":")[0] for line in lines] == ["sample", "indenter", "material", "test"]


def test_models_hold_their_rules_without_a_file():
    with pytest.raises(CaseError, match=r"^sample\.diameter: missing; a disc needs it"):
        Sample(shape="disc", thickness=3.3, base="sliding")
    with pytest.raises(CaseError, match="below max"):
        Range(start=1.0, min=2.0, max=1.0)
    with pytest.raises(CaseError, match="keep one"):
        MaterialChoice(model="neo_hookean", parameters={"mu": 1.0}, kappa=1e3, bulk_ratio=1e3)
    parts = {
        "sample": Sample(shape="disc", diameter=14.0, thickness=3.3, base="sliding"),
        "indenter": Indenter(shape="strip", width=2.0, length=20.0, friction="stick"),
        "tests": (Test(name="a", angle=0, depth=0.33),),
    }
    case = Case(material=MaterialChoice(model="neo_hookean", parameters={"mu": 1.0}, bulk_ratio=1000.0), **parts)
    assert (case.material.bulk_ratio, case.tests[0].weight) == (1000.0, 1.0)
    with pytest.raises(ValidationError, match="frozen"):
        case.title = "new"
    with pytest.raises(CaseError, match=r"^material\.parameters\.muh = 1\.0: unknown parameter; did you mean mu"):
        Case(material=MaterialChoice(model="neo_hookean", parameters={"muh": 1.0}), **parts)


# The hash


SAME = ["title=other", "fit.workers=1", "sample.thickness=3300 um", "material.mu.start=1.0"]
OTHER = ["fit.seed=1", "sample.thickness=3.31", "material.mu.start=1.1", "test.0.depth=0.33"]


@pytest.mark.parametrize("override", SAME)
def test_the_hash_is_that_of_what_a_result_depends_on(override):
    assert read_case(PAPER, [override]).hash == read_case(PAPER).hash


@pytest.mark.parametrize("override", OTHER)
def test_the_hash_changes_with_what_a_result_depends_on(override):
    assert read_case(PAPER, [override]).hash != read_case(PAPER).hash


def test_the_hash_knows_the_curve_s_numbers_and_not_its_file(copy):
    before = read_case(copy).hash
    assert before == read_case(PAPER).hash
    curve = copy.parent / "curves" / "parallel.csv"
    curve.write_text("# a comment\n" + curve.read_text())
    assert read_case(copy).hash == before
    curve.write_text(curve.read_text().replace("0.96228", "0.96229"))
    assert read_case(copy).hash != before


# Plugins and warnings

PLUGIN = '''
from indentfit.material import Material, Parameter

class Mine(Material):
    """psi = mu/2 (I1 - 3)."""
    mu = Parameter("kPa", "shear modulus", min=0, scale=True)

    def energy(self, I1):
        return self.mu / 2 * (I1 - 3)
'''


def test_the_hash_of_a_case_that_runs_code_knows_the_code(copy):
    (copy.parent / "mine.py").write_text(PLUGIN)
    overrides = ["material.model=mine.py:Mine", "material.parameters={mu={start=1,min=0.1,max=9}}"]
    case = read_case(copy, overrides)
    before = case.hash
    (copy.parent / "mine.py").write_text(PLUGIN.replace("mu / 2", "mu / 2.0"))
    assert read_case(copy, overrides).hash != before


def test_a_broken_plugin_is_refused_in_one_line(copy):
    (copy.parent / "mine.py").write_text("1 / 0\n")
    (line,) = problems("material.model=mine.py:Mine", path=copy)
    assert 'material.model = "mine.py:Mine": ' in line
    assert "ZeroDivisionError" in line


def test_a_low_bulk_modulus_is_warned_of():
    # The stiffest modulus at the start is E along the fibres, mu (3 + 4 zeta) = 15 kPa [physics.md 2].
    assert any("15 kPa" in line for line in read_case(PAPER, ["material.bulk_ratio=149"]).warnings())
    assert not read_case(PAPER, ["material.bulk_ratio=151"]).warnings()


@pytest.mark.parametrize(("indenter", "said"), [
    ("{shape='sphere',diameter='40 um',friction=0}", "15 times the half-width of the sphere, 0.02 mm; check the units"),
    ("{shape='cylinder',radius=0.05,friction=0}", "6 times the half-width of the cylinder"),
    ("{shape='sphere',radius=0.06,friction=0}", ""),
    ("{shape='cone',half_angle=30,tip_radius=0.01,friction=0}", ""),
])  # fmt: skip
def test_an_indenter_that_sinks_in_by_many_radii_is_warned_of(indenter, said):
    sphere = CASES / "hydrogel_sphere" / "case.toml"
    test = "test=[{name='press',depth=0.3,points=3}]"
    warnings = [line for line in read_case(sphere, [f"indenter={indenter}", test]).warnings() if "check the units" in line]
    assert len(warnings) == bool(said) and all(said in line for line in warnings)


def test_a_test_whose_forces_are_small_beside_the_others_is_warned_of():
    """Such as a small bead's curve beside a large one's: with errors in mN it has no say. The named weights give it one."""
    (said,) = (line for line in read_case(PAPER, ["test.parallel.weight=0.01"]).warnings() if "hardly counts" in line)
    assert said.startswith("test.parallel hardly counts in equation (1)")
    weights = re.findall(r"test\.\w+\.weight = [\d.]+", said)
    assert len(weights) == 2
    assert not read_case(PAPER, [known.replace(" ", "") for known in weights]).warnings()
    assert not read_case(PAPER, ["test.parallel.weight=0.01", "fit.discrepancy.scale=0.02"]).warnings()


def test_a_deep_test_and_a_single_direction_are_warned_of():
    (deep,) = read_case(PAPER, ["test.parallel.depth=0.7"]).warnings()
    assert "21%" in deep
    (single,) = read_case(PAPER, ["test.parallel.angle=90"]).warnings()
    assert "every test has angle 90" in single


def test_the_numbers_of_a_case_are_read_without_running_its_code_or_its_records(copy):
    (copy.parent / "mine.py").write_text("raise SystemExit('this code was run')\n")
    overrides = ["material.model=mine.py:Mine", "material.parameters={mu={start=1,min=0.1,max=9}}", "test.parallel.record=raw.csv"]
    case = read_case_file(copy, overrides)
    assert (case.material.model, case.curves[0], len(case.curves[1].force)) == ("mine.py:Mine", None, 25)
    with pytest.raises(CaseError, match="this code was run"):
        read_case(copy, overrides)
    with pytest.raises(CaseError, match="give a plain number"):
        read_case_file(copy, [*overrides, "material.mu.start=1 kPa"])


@pytest.mark.parametrize("name", ["white_matter_2017", "quickstart"])
def test_validating_an_installed_law_loads_no_heavy_library(name):
    heavy = "scipy", "sympy", "numba", "pint", "skfem", "pandas", "matplotlib", "indentfit.experiment.process", "indentfit.fem"
    script = f"""
import sys
from indentfit.cli.validate import command
command([{str(CASES / name / "case.toml")!r}], standalone_mode=False)
print([name for name in {heavy} if name in sys.modules])
"""
    done = subprocess.run([sys.executable, "-P", "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"
