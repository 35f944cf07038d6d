"""Laws of one layer against each other, while the other layers keep theirs."""

import json

import pytest
from click.testing import CliRunner
from fixtures.cases import CASES, white_matter

from indentfit import compare
from indentfit.cli import main
from indentfit.errors import CaseError
from indentfit.experiment.measured import read_case
from indentfit.study.compare import Comparison, layers_modulus, plan_comparison
from indentfit.study.law_ranges import law_case

SKIN = CASES / "skin" / "case.toml"
COARSE = ("mesh.elements=120", "fit.workers=1", "test.large.weight=0.5", "test.small.weight=0.5")


def test_the_law_of_one_layer_is_replaced_and_the_others_stay():
    case = read_case(SKIN)
    other = law_case(case, "yeoh", 10.0, {}, "skin")
    assert [layer.model for layer in other.sample.layer] == ["yeoh", "neo_hookean"]
    assert set(other.free) == {"skin.c10", "skin.c20", "skin.c30", "fat.mu"}
    assert other.free["fat.mu"] == case.free["fat.mu"]
    assert other.free["skin.c10"].max == pytest.approx(25.0)  # 2.5 times the modulus of the curves
    own = law_case(case, "neo_hookean", None, {}, "skin")
    assert own.free == case.free


@pytest.mark.parametrize(
    ("layer", "said"),
    [(None, "such as --layer skin (layers: skin, fat)"), ("skim", "did you mean skin?"), ("bone", "(layers: skin, fat)")],
)
def test_a_layer_has_to_be_named_and_known(layer, said):
    with pytest.raises(CaseError) as refused:
        plan_comparison(read_case(SKIN), ["neo_hookean", "yeoh"], {}, layer=layer)
    assert said in str(refused.value) and "\n" not in str(refused.value)


def test_a_sample_without_layers_has_none_to_name():
    with pytest.raises(CaseError, match="the sample has no layers"):
        plan_comparison(white_matter(), ["neo_hookean", "yeoh"], {}, layer="skin")


def test_the_command_refuses_in_one_line_with_exit_code_2():
    done = CliRunner().invoke(main, ["compare", str(SKIN), "--materials", "neo_hookean,yeoh"])
    assert done.exit_code == 2 and len(done.stderr.splitlines()) == 1 and "--layer skin" in done.stderr


def test_the_modulus_of_a_layer_is_that_of_its_synthetic_curves():
    """README: the curves are those of a skin of 11.7 kPa on fat of 0.67 kPa; the case starts at 20 kPa."""
    case = read_case(SKIN, [*COARSE, "fat.mu=0.67"])
    assert layers_modulus(case, "skin") == pytest.approx(11.7, rel=0.1)


@pytest.mark.campaign
def test_synthetic_curves_do_not_prefer_a_wrong_law_of_the_layer(tmp_path):
    """The truth is neo-Hookean; an exponential law (Demiray and Fung) that begins as it does is never preferred to it."""
    found = compare(read_case(SKIN, ["fit.workers=2"]), ["neo_hookean", "yeoh"], layer="skin")
    assert found.preferred in (None, "neo_hookean")
    known = {law.law: law for law in found.laws}["neo_hookean"]
    assert known.parameters["skin.mu"].interval[0] < 11.7 < known.parameters["skin.mu"].interval[1]
    again = Comparison.from_json(json.loads(json.dumps(found.as_json())))
    assert (again.layer, again.sentence) == ("skin", found.sentence)
