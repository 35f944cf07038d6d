"""Inputs that a case leaves out: they are unknown, and a fit goes over a stated prior, named in a warning."""

import numpy as np
import pytest
from fixtures.cases import CASES, MU, tiny_case

from indentfit import Case, Curve, Sample, Test, fit, read_case, simulate
from indentfit.inference.what_if import taken_as_known

PRESSES = [{"name": name, "angle": 0, "depth": 0.1, "points": 3} for name in ("a", "b")]


LEFT_OUT = {
    "friction": ({"indenter": {"friction": None}}, "indenter.friction", "0 to 1", "0.5"),
    "base": ({"sample": {"base": None}}, "sample.base", "both values", "sliding"),
    "bulk_ratio": ({"material": {"bulk_ratio": None}}, "material.bulk_ratio", "20 to 5000", "1000"),
}


@pytest.mark.parametrize("name", LEFT_OUT)
def test_a_key_left_out_is_unknown_and_a_warning_names_it_with_its_prior(tmp_path, name):
    """The case that leaves a key out is the case that calls it unknown."""
    tables, key, prior, value = LEFT_OUT[name]
    case = read_case(tiny_case(tmp_path, **tables, test=PRESSES))
    assert case.hash == read_case(case.path, [f"{key}=unknown"]).hash
    stated = read_case(case.path, [f"{key}={value}"])
    assert getattr(stated.fit.uncertain, name) is None and not any(key in line for line in stated.warnings())
    told = [line for line in case.warnings() if line.startswith(key)]
    assert len(told) == 1 and prior in told[0] and f"a simulation takes {value}" in told[0]
    assert getattr(case.fit.uncertain, name) is not None
    assert name not in [known.input for known in taken_as_known(case)]
    assert simulate(case, {"mu": 1.0}).tests[0].curve.force == pytest.approx(simulate(stated, {"mu": 1.0}).tests[0].curve.force)


def test_keys_left_out_in_memory_are_unknown_too():
    case = Case(
        sample=Sample(shape="disc", diameter=14.0, thickness=3.3),
        indenter={"shape": "sphere", "radius": 1.0},
        material={"model": "neo_hookean", "parameters": {"mu": {"start": 1, "min": 0.1, "max": 10}}},
        tests=[Test("press", depth=0.1)],
    )
    uncertain = case.fit.uncertain
    assert (uncertain.base, uncertain.friction.uniform, uncertain.bulk_ratio.log_uniform) == (0.5, (0.0, 1.0), (20.0, 5000.0))
    assert (case.sample.base, case.indenter.friction, case.material.bulk_ratio) == ("sliding", 0.5, 1000.0)
    assert len(case.warnings()) == 3


def test_a_prior_that_the_case_states_stands_in_place_of_that_of_a_left_out_key(tmp_path):
    case = read_case(tiny_case(tmp_path, indenter={"friction": None}, fit={"uncertain": {"friction": 0.1}}, test=PRESSES))
    assert case.fit.uncertain.friction == 0.1


def test_a_key_that_every_test_has_for_itself_may_be_left_out(tmp_path):
    tests = [{**test, "indenter": {"friction": 0.1}} for test in PRESSES]
    case = read_case(tiny_case(tmp_path, indenter={"friction": None}, test=tests))
    assert case.fit.uncertain.friction is None and not case.warnings()
    one = read_case(tiny_case(tmp_path, indenter={"friction": None}, test=[tests[0], PRESSES[1]]))
    assert one.fit.uncertain.friction.uniform == (0.0, 1.0)


def test_a_left_out_bulk_ratio_of_a_material_that_relaxes_is_unknown(tmp_path):
    relaxes = {"bulk_ratio": None, "relaxation": {"g": [0.5], "tau": [1.0]}}
    case = read_case(tiny_case(tmp_path, material=relaxes, test=[{**PRESSES[0], "ramp": 1.0}]))
    assert case.fit.uncertain.bulk_ratio.log_uniform == (20.0, 5000.0) and case.material.bulk_ratio == 1000
    assert any(line.startswith("material.bulk_ratio is unknown or left out: a fit goes over") for line in case.warnings())
    assert read_case(case.path, ["material.bulk_ratio=unknown"]).hash == case.hash


def test_layers_that_all_leave_their_bulk_ratio_out_have_an_unknown_one(tmp_path):
    layers = [{"name": name, "thickness": 1.65, "model": "neo_hookean", "parameters": {"mu": MU}} for name in ("top", "low")]
    case = read_case(tiny_case(tmp_path, sample={"layer": layers}, material=None, test=PRESSES))
    assert case.fit.uncertain.bulk_ratio.log_uniform == (20.0, 5000.0)
    stated = [{**layers[0], "bulk_ratio": 50.0}, layers[1]]
    case = read_case(tiny_case(tmp_path, sample={"layer": stated}, material=None, test=PRESSES))
    assert case.fit.uncertain.bulk_ratio is None
    assert [line for line in case.warnings() if "bulk_ratio" in line] == [
        "sample.layer.low.bulk_ratio is left out: 1000 is taken as known; give it"
    ]


@pytest.mark.parametrize("path", sorted(CASES.rglob("case.toml")), ids=lambda path: path.parent.name)
def test_the_shipped_cases_state_every_input_or_call_it_unknown_on_purpose(path):
    text = path.read_text(encoding="utf-8")
    case = read_case(path)
    for key in ("friction", "base", "bulk_ratio"):
        if getattr(case.fit.uncertain, key) is not None:
            assert f'{key} = "unknown"' in text or f"\n{key} = " in text.partition("[fit.uncertain]")[2]


def test_tests_without_an_indenter_are_fitted_with_a_bulk_ratio_that_nobody_knows(tmp_path):
    """Simple shear does not depend on the bulk ratio: mu is that of the line, whatever the ratio; no mesh has an error."""
    strain = np.linspace(0.02, 0.3, 12)
    noise = 0.01 * np.random.default_rng(2).standard_normal(12)
    case = Case(
        material={"model": "neo_hookean", "parameters": {"mu": {"start": 2, "min": 0.1, "max": 50}}},
        tests=[Test("shear", kind="shear", curve=Curve(strain, 3.0 * strain + noise))],
        fit={"workers": 1},
    )
    fitted = fit(case)
    slope = strain @ (3.0 * strain + noise) / (strain @ strain)
    assert fitted.parameters["mu"].value == pytest.approx(slope, rel=2e-3)
    low, high = fitted.parameters["mu"].interval
    assert low < 3.0 < high and "bulk_ratio" in fitted.uncertain.inputs and "mesh" not in fitted.uncertain.inputs
