"""The words of the field: Poisson's ratio, Young's modulus, radius, and samples without fibres, which have no direction."""

import math

import pytest
from fixtures.cases import FIBRES, straight_curve, tiny_case

from indentfit import elastic
from indentfit.case import Indenter, MaterialChoice
from indentfit.case.laws import own_parameters, shear_parameter
from indentfit.errors import CaseError
from indentfit.experiment.measured import read_case
from indentfit.material import load, typed
from indentfit.runs.key import Inputs
from indentfit.runs.mechanics import mechanics_of

pytestmark = pytest.mark.quick

GEL = {"shape": "sphere", "diameter": 5.0, "friction": 0.0}
PUNCH = {"indenter": {"shape": "cylinder", "width": None, "length": None, "diameter": 2.0}}


def gel_case(folder, **tables):
    straight_curve(folder / "parallel.csv", 3.0)
    return tiny_case(folder, **(PUNCH | tables))


def faults(path, *overrides):
    with pytest.raises(CaseError) as caught:
        read_case(path, overrides)
    return "\n".join(caught.value.faults)


# Poisson's ratio


@pytest.mark.parametrize(("nu", "ratio"), [(0.0, 2 / 3), (0.3, 13 / 6), (0.45, 29 / 3), (0.499, 499.66666666), (0.5, math.inf)])
def test_poisson_s_ratio_is_a_bulk_ratio(nu, ratio):
    assert elastic.bulk_ratio(nu) == pytest.approx(ratio, rel=1e-9)
    assert elastic.poisson_ratio(ratio) == pytest.approx(nu, rel=1e-9)
    choice = MaterialChoice(model="neo_hookean", parameters={"mu": 2.0}, poisson_ratio=nu)
    assert choice.bulk_over_shear == pytest.approx(ratio)
    assert choice.poisson_ratio_at(2.0) == pytest.approx(nu, rel=1e-9)


def test_poisson_s_ratio_and_its_bulk_ratio_have_the_same_runs(tmp_path):
    by_ratio = read_case(gel_case(tmp_path), ["material.bulk_ratio=2.1666666666666665"])
    by_nu = read_case(gel_case(tmp_path), ["material.poisson_ratio=0.3"])
    assert (by_nu.material.bulk_ratio, by_nu.material.kappa) == (None, None)
    assert by_nu.material.bulk_modulus(3.0) == pytest.approx(6.5, rel=1e-12)
    assert Inputs(by_nu).origin == Inputs(by_ratio).origin


def test_one_word_for_the_bulk_modulus(tmp_path):
    path = gel_case(tmp_path, material={"bulk_ratio": 100.0, "poisson_ratio": 0.3})
    assert "material.poisson_ratio = 0.3: material.bulk_ratio is given too; keep one of them" in faults(path)
    path = gel_case(tmp_path, material={"kappa": 100.0, "poisson_ratio": 0.3})
    assert "material.poisson_ratio = 0.3: material.kappa is given too" in faults(path)
    assert read_case(path, ["material.bulk_ratio=20"]).material.bulk_over_shear == 20.0  # an override takes all rivals out
    assert "must be at most 0.5" in faults(path, "material.poisson_ratio=0.51")


def test_a_changed_bulk_ratio_replaces_poisson_s_ratio(tmp_path):
    case = read_case(gel_case(tmp_path, material={"poisson_ratio": 0.3}))
    there = mechanics_of(case).changed({"material.bulk_ratio": 50.0})
    assert there.material.bulk_modulus(2.0) == 100.0


def test_poisson_s_ratio_is_refused_where_there_are_fibres(tmp_path):
    path = gel_case(tmp_path, material={**FIBRES, "poisson_ratio": 0.45})
    assert "material.poisson_ratio = 0.45: the material has fibres, and no single Poisson's ratio" in faults(path)


def test_a_stated_poisson_s_ratio_is_no_mistake(tmp_path):
    """Nor is a bulk ratio of 2.16667, which is nu = 0.3; 20 (nu = 0.475) may be one."""
    path = gel_case(tmp_path)
    assert any("nearly incompressible" in line for line in read_case(path, ["material.bulk_ratio=20"]).warnings())
    assert read_case(path, ["material.bulk_ratio=2.16667"]).warnings() == []
    assert read_case(path, ["material.poisson_ratio=0.3"]).warnings() == []


# Young's modulus


def test_young_stands_for_the_shear_modulus(tmp_path):
    path = gel_case(tmp_path, material={"poisson_ratio": 0.3, "parameters": {"young": {"start": 2.6, "min": 0.26, "max": 26.0}}})
    case = read_case(path)
    assert list(case.fitted) == ["mu"]
    bounds = case.free["mu"]
    assert (bounds.start, bounds.min, bounds.max) == pytest.approx((1.0, 0.1, 10.0), rel=1e-12)
    assert case.start_values() == pytest.approx({"mu": 1.0})
    fixed = read_case(path, ["material.young=5200 Pa"])
    assert not fixed.free and fixed.start_values()["mu"] == pytest.approx(2.0, rel=1e-12)


def test_young_beside_a_bulk_modulus(tmp_path):
    path = gel_case(tmp_path, material={"kappa": 20.0, "parameters": {"young": 6.0}})
    mu = read_case(path).start_values()["mu"]
    assert 9 * 20.0 * mu / (3 * 20.0 + mu) == pytest.approx(6.0, rel=1e-12)
    assert "must stay below 9 kappa = 180 kPa" in faults(path, "material.young=180")


def test_young_and_the_shear_modulus_contradict_each_other(tmp_path):
    path = gel_case(tmp_path, material={"parameters": {"young": 6.0, "mu": 2.0}})
    assert "material.parameters.young = 6.0: mu is given too; keep one of them" in faults(path)


def test_the_bounds_of_young_are_checked_in_the_user_s_word(tmp_path):
    path = gel_case(tmp_path, material={"parameters": {"young": {"start": 6.0, "min": 7.0, "max": 9.0}}})
    assert "material.parameters.young.start = 6.0: is below min = 7" in faults(path)


def test_young_needs_a_law_whose_shear_modulus_is_a_parameter(tmp_path):
    assert shear_parameter(load("neo_hookean")) == "mu"
    assert shear_parameter(typed("mu/(2*b)*(exp(b*(I1-3))-1)", ["mu", "b"])) == "mu"
    assert shear_parameter(load("mooney_rivlin")) is None
    assert shear_parameter(load("transversely_isotropic")) is None
    path = gel_case(tmp_path, material={"model": "mooney_rivlin", "parameters": {"young": 3.0, "c01": 0.2}})
    assert "material.parameters.young = 3.0: unknown parameter" in faults(path)


def test_a_parameter_of_a_law_that_is_called_young_is_that_parameter():
    law = typed("young/6*(I1-3)", ["young"])
    choice = MaterialChoice(energy="young/6*(I1-3)", parameters={"young": 3.0})
    assert own_parameters(choice, law) == {"young": 3.0}


@pytest.mark.parametrize(
    ("override", "hint"),
    [
        ("material.nu=0.3", "did you mean poisson_ratio? Poisson's ratio nu stands for bulk_ratio = 2 (1 + nu) / (3 (1 - 2 nu))"),
        ("material.parameters.E=3", "did you mean young? Young's modulus E stands for the shear modulus E / (2 (1 + nu))"),
        ("material.young=3", "give young among [material.parameters]"),
        ("sample.radius=7", "did you mean diameter?"),
        ("sample.height=7", "did you mean thickness?"),
    ],
)
def test_other_words_have_a_hint(tmp_path, override, hint):
    assert hint in faults(gel_case(tmp_path), override)


# Radius


def test_a_radius_stands_for_the_diameter(tmp_path):
    assert Indenter(shape="sphere", radius=2.5, friction=0.0).geometry == Indenter(**GEL).geometry
    case = read_case(gel_case(tmp_path), ["indenter.radius=500 um"])
    assert (case.indenter.diameter, case.indenter.geometry.half_width) == (None, 0.5)
    assert case.indenter.with_key("diameter", 3.0).geometry.half_width == 1.5
    assert case.indenter.with_key("radius", 3.0).geometry.half_width == 3.0
    by_radius = gel_case(tmp_path, indenter={**PUNCH["indenter"], "diameter": None, "radius": 1.0})
    back = read_case(by_radius, ["indenter.shape=strip", "indenter.width=1", "indenter.length=20"])
    assert back.indenter.geometry.half_width == 0.5


def test_a_radius_is_refused_where_it_says_nothing(tmp_path):
    path = gel_case(tmp_path, indenter={**PUNCH["indenter"], "radius": 1.0})
    assert "indenter.radius = 1.0: indenter.diameter is given too; keep one of them" in faults(path)
    strip = tiny_case(tmp_path, indenter={"radius": 1.0})
    assert "indenter.radius = 1.0: does not belong to a strip; remove it" in faults(strip)
    neither = gel_case(tmp_path, indenter={**PUNCH["indenter"], "diameter": None})
    assert "indenter.diameter: missing; a cylinder needs it" in faults(neither)


def test_a_fault_of_a_size_names_the_key_that_was_given(tmp_path):
    path = gel_case(tmp_path, indenter={**PUNCH["indenter"], "diameter": None, "radius": 7.0})
    assert "indenter.radius = 7.0: " in faults(path)
    assert "indenter.diameter" not in faults(path)


# Samples without fibres


def test_a_sample_without_fibres_needs_no_angle(tmp_path):
    path = gel_case(tmp_path, test=[{"name": "press", "curve": "parallel.csv"}])
    case = read_case(path)
    assert (case.tests[0].angle, case.tests[0].direction) == (None, 0)
    assert Inputs(case).of({}, case.tests[0])["angle"] == 0


def test_a_sample_with_fibres_needs_an_angle(tmp_path):
    path = gel_case(tmp_path, material=FIBRES, test=[{"name": "press", "curve": "parallel.csv"}])
    assert "test.press.angle: missing; the material has fibres" in faults(path)


@pytest.mark.parametrize(
    ("energy", "parameters"),
    [
        ("c1*(I1-3) + c2*(I1-3)^2", {"c1": {"start": 1.0, "min": 0.1, "max": 9.0}, "c2": {"start": 0.1, "min": 0.0, "max": 9.0}}),
        (
            "-mu*Jm/2*log(1-(I1-3)/Jm)",
            {"mu": {"start": 1.0, "min": 0.1, "max": 9.0}, "Jm": {"start": 2.0, "min": 0.1, "max": 99.0}},
        ),
        (
            "mu/(2*b)*(exp(b*(I1-3))-1)",
            {"mu": {"start": 1.0, "min": 0.1, "max": 9.0}, "b": {"start": 2.0, "min": 0.01, "max": 99.0}},
        ),
    ],
)
def test_no_warning_of_fibres_where_there_are_none(tmp_path, energy, parameters):
    path = gel_case(tmp_path, material={"model": None, "energy": energy, "parameters": parameters})
    assert read_case(path).warnings() == []


def test_one_direction_of_a_sample_with_fibres_is_warned_of(tmp_path):
    assert any("curves of one direction" in line for line in read_case(gel_case(tmp_path, material=FIBRES)).warnings())


def test_only_samples_with_fibres_are_warned_of_depths_to_half_of_the_thickness_under_a_sphere(tmp_path):
    """Without fibres 75 of 76 round contacts are solved between 40 and 50 % of the thickness (tests/campaigns/round.py)."""
    deep = {"sample.thickness": 0.5, "sample.diameter": 8, "indenter.diameter": 4}
    gel, fibrous = (
        read_case(gel_case(tmp_path, **tables), [f"{key}={value}" for key, value in deep.items()]).warnings()
        for tables in ({}, {"material": FIBRES})
    )
    assert not any("equilibrium" in line for line in gel)
    assert any("beyond 40 % equilibrium may not be found" in line for line in fibrous)
