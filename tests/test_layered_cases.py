"""Cases whose sample has layers: keys, faults, and names of parameters. tests/test_layered.py has the mechanics."""

import json
import tomllib

import numpy as np
import pytest
from fixtures.cases import CASES

from indentfit import Case, Curve, Test, fit, read_case, simulate
from indentfit.case import Indenter, Sample
from indentfit.case.keys import facts_of_keys
from indentfit.case.tables import Layer
from indentfit.case.template import toml_value
from indentfit.case.write import case_toml, write_case
from indentfit.errors import CaseError
from indentfit.experiment.measured import changed_case
from indentfit.report.html_case import case_words
from indentfit.report.schema import CaseFacts, case_json
from indentfit.study.variations import plan_sweep

SKIN = """
[sample]
shape = "disc"
diameter = "60 mm"
thickness = "11.5 mm"
base = "bonded"

[[sample.layer]]
name = "skin"
thickness = "1.5 mm"
model = "ogden"
parameters = { mu = { start = "20 kPa", min = 2, max = 200 }, alpha = 4 }

[[sample.layer]]
name = "fat"
thickness = "10 mm"
model = "neo_hookean"
poisson_ratio = 0.49
parameters = { young = 4.47 }

[indenter]
shape = "sphere"
radius = 3
friction = 0

[[test]]
name = "press"
depth = 1
"""


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "case.toml"
    path.write_text(SKIN)
    return path


def test_parameters_are_called_by_their_layers(file):
    case = read_case(file)
    assert case.start_values() == {"skin.mu": 20, "skin.alpha": 4, "fat.mu": pytest.approx(4.47 / 2 / 1.49)}
    assert list(case.free) == ["skin.mu"] and case.law.scale is None
    assert case.material.bulk_moduli(case.law(**case.start_values())) == pytest.approx((20e3, 1.5 * 2 * 1.49 / 3 / 0.02))


def test_a_written_case_is_the_same_case(file, tmp_path):
    case = read_case(file)
    assert "material" not in tomllib.loads(case_toml(case))
    assert read_case(write_case(case, tmp_path / "copy")).hash == case.hash
    assert changed_case(case, ["fat.parameters={mu=2}"]).hash != case.hash


def test_a_case_without_layers_keeps_its_hash():
    """That of 0.3.0, of which results are stored."""
    case = Case(
        sample=Sample(shape="disc", diameter=14, thickness=3.3, base="bonded"),
        indenter=Indenter(shape="sphere", radius=1.0, friction=0.0),
        material={"model": "neo_hookean", "bulk_ratio": 1000.0, "parameters": {"mu": 1.0}},
        tests=[Test("press", curve=Curve(np.arange(1, 6) / 10, np.arange(1, 6) * 1.0))],
    )
    assert case.hash.startswith("d90378bc10de106c")
    others = [case.model_copy(update={"fit": case.fit.model_copy(update={"what_if": said})}).hash for said in (True, False)]
    assert len({case.hash, *others}) == 3


def test_a_case_in_memory_has_layers():
    layers = [Layer(name=name, thickness=1.0, model="neo_hookean", parameters={"mu": mu}) for name, mu in (("a", 1.0), ("b", 2.0))]
    case = Case(
        sample=Sample(shape="disc", diameter=14, thickness=2.0, base="bonded", layer=layers),
        indenter=Indenter(shape="sphere", radius=1.0, friction=0.0),
        tests=[Test("press", depth=0.1)],
    )
    assert case.start_values() == {"a.mu": 1.0, "b.mu": 2.0}
    assert case.sample.interfaces == (1.0,)
    thicker = case.sample.with_key("thickness", 4.0)  # as a run with another thickness has it
    assert thicker.interfaces == (2.0,) and list(thicker.layer_at(np.array([0.5, 3.5]))) == [1, 0]


OF_TWO_FAMILIES = [
    "fat.model=holzapfel_own_families",
    "fat.parameters={c=2.0, k1=1.0, k2=1.0, dispersion=0.0, k1_second=1.0, dispersion_second=0.0}",
    "sample.families=[-30.0, 30.0]",
    "test.press.angle=0",
]


@pytest.mark.parametrize(
    "key", [key for key in facts_of_keys(Layer) if key.name not in ("name", "thickness")], ids=lambda key: key.name
)
def test_the_example_of_a_layers_key_is_a_value_that_the_key_takes(file, key):
    if key.name == "shared":
        file.write_text(SKIN.replace("poisson_ratio = 0.49", "bulk_ratio = 50"))
    layer = "skin" if key.name == "interface" else "fat"  # the last layer lies on the base
    beside = {"energy": ["fat.parameters={mu=2}"], "shared": OF_TWO_FAMILIES}.get(key.name, [])
    read_case(file, [*beside, f"{layer}.{key.name}={toml_value(key.example)}"])


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("sample.thickness=10", "sample.thickness = 10.0: the layers add up to 1.5 + 10 = 11.5 mm"),
        ("fat.interface=sliding", "fat is the last one, and lies on the base: sample.base says how; remove its interface"),
        ("fat.thickness=5 cm", "the layers add up to 1.5 + 50 = 51.5 mm"),
        ("fat.name=skin", "two layers are called skin; give each a name of its own"),
        ("fat.name=my fat", "sample.layer.my fat.name = \"my fat\""),
        ("fat.zeta=3", "sample.layer.fat.parameters.zeta = 3.0: unknown parameter; known here: mu, young"),
        ("skin.mu=bla", "sample.layer.skin.parameters.mu = \"bla\": must be a number in kPa"),
        ("skin.mu={start=5, min=7, max=9}", "sample.layer.skin.parameters.mu.start = 5.0: is below min = 7"),
        ("skin.alpha=0", "sample.layer.skin.parameters"),
        ("fat.bulk_ratio=unknown", "sample.layer.fat.bulk_ratio = \"unknown\": must be a number in a layer"),
        ("fat.model=nohooke", "sample.layer.fat.model = \"nohooke\": no material"),
        ("sample.layer.fet.mu=3", "no such layer; ... did you mean fat"),
        ("material.model=neo_hookean", "material: each layer has a material of its own; remove this table"),
        ("test.press.sample={thickness=4}", "test.press.sample.thickness = 4.0: the layers add up to"),
        ("fit.prior.shear=[1, 0.1]", "fit.prior.shear = [1.0, 0.1]: is the modulus of one material"),
        ("material.relaxation={g=[0.3], tau=[2]}", "material: each layer has a material of its own"),
    ],
)  # fmt: skip
def test_a_fault_names_its_layer_its_reason_and_its_remedy(file, override, words):
    with pytest.raises(CaseError) as refused:
        read_case(file, [override])
    for part in words.split(" ... "):
        assert part in str(refused.value)


def test_a_test_without_an_indenter_needs_one_material(file):
    more = SKIN + '[[test]]\nname = "shear"\nkind = "shear"\nstrain = 0.1\n'
    file.write_text(more)
    with pytest.raises(CaseError, match="the sample has layers; remove this test"):
        read_case(file)


def test_a_sweep_varies_a_parameter_by_its_layer(file):
    plan = plan_sweep(read_case(file), ["skin.mu=+-20%", "skin.alpha=2,3", "sample.layer.skin.parameters.mu=+-10%"])
    values = [case.start_values() for case in plan.cases]
    assert [each["skin.mu"] for each in values] == pytest.approx([20, 16, 24, 20, 20, 18, 22])
    assert [each["skin.alpha"] for each in values[3:5]] == [2, 3]


def test_a_report_tells_of_each_layer(file):
    facts = CaseFacts.from_json(json.loads(json.dumps(case_json(read_case(file)))))
    assert facts.sample == "disc, diameter 60 mm, thickness 11.5 mm (layers from the top: skin 1.5 mm, fat 10 mm), bonded base"
    lines = "\n".join(case_words(facts))
    assert "Layer skin, 1.5 mm thick: ogden with a bulk modulus of 1000 shear moduli" in lines
    assert "Layer fat, 10 mm thick: neo hookean with a Poisson's ratio of 0.49" in lines
    assert "Material:" not in lines


@pytest.mark.parametrize(
    ("name", "truth"),
    [("skin", {"skin.mu": 11.7, "fat.mu": 0.67}), ("ligament_quarter_punch", {"mu": 2750.0, "zeta": 29.0, "phi": 0.0})],
)
def test_the_curves_of_a_shipped_case_are_those_of_its_truth(name, truth):
    """Within their noise, 0.5 % of the largest force, and 1 % for the mesh."""
    case = read_case(CASES / name / "case.toml")
    assert all(test.synthetic for test in case.tests)
    simulated = simulate(case, truth, mesh_error=False)
    assert max(simulated.misfits.values()) < 0.01


@pytest.mark.campaign
def test_two_spheres_find_skin_and_fat():
    result = fit(read_case(CASES / "skin" / "case.toml"))
    for name, value in (("skin.mu", 11.7), ("fat.mu", 0.67)):
        known = result.parameters[name]
        assert known.interval[0] < value < known.interval[1]
        assert known.verdict.startswith("determined")
    assert any("the sample has layers" in note for note in result.notes)
