"""The shipped hydrogel under a sphere: its truth comes back through `fit`, with default settings."""

import json
import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from fixtures.cases import CASES

from indentfit.experiment.measured import read_case
from indentfit.inference.fit import _with_moduli, fit
from indentfit.inference.moduli import moduli
from indentfit.inference.shares import InputShare, UncertainInputs

GEL = CASES / "hydrogel_sphere" / "case.toml"
MU = 9.0 / (2 * 1.499)
FOUND = {"bulk_ratio": 25.0, "sample.base": "sliding", "thickness": 4.2}  # inputs at an optimum, as runs take them
STATED = {"material.bulk_ratio": 25.0, "sample.base": "sliding", "sample.thickness": 4.2}
SECONDS = 15.0  # of CPU, in all, with compiled code cached


@pytest.fixture(scope="module")
def fitted():
    return fit(read_case(GEL))


def test_the_truth_comes_back(fitted):
    known = fitted.parameters["mu"]
    assert known.value == pytest.approx(MU, rel=0.01)
    assert known.verdict.startswith("determined")
    low, high = known.interval
    assert low < MU < high
    assert (high - low) / 2 <= 0.03 * known.value
    young = fitted.moduli["E"]
    assert young.value == pytest.approx(9.0, rel=0.01) and young.interval[0] < 9.0 < young.interval[1]


def test_moduli_of_an_unknown_bulk_ratio_are_those_after_the_fit_and_hold_its_interval(fitted):
    """E = 2 mu (1 + nu), nu = (3 k - 2) / (6 k + 2) for a bulk modulus of k shear moduli."""

    def nu(k):
        return (3 * k - 2) / (6 * k + 2)

    share = InputShare(1000.0, None, prior="20 to 5000 in the logarithm", fitted=25.0, interval=(20.0, 5000.0))
    found = moduli(fitted.case, replace(fitted, uncertain=UncertainInputs({"bulk_ratio": share})))
    mu = fitted.parameters["mu"]
    assert (found["nu"].value, *found["nu"].interval) == pytest.approx((nu(25), nu(20), nu(5000)))
    assert not found["nu"].fixed and found["nu"].verdict == "from the bulk ratio"
    assert found["E"].value == pytest.approx(2 * mu.value * (1 + nu(25)))
    assert found["E"].interval == pytest.approx((2 * mu.interval[0] * (1 + nu(20)), 2 * mu.interval[1] * (1 + nu(5000))))


def test_the_closed_forms_stand_beside_it(fitted):
    form = fitted.closed_forms["press"]
    assert form.formula == "Hertz" and form.base == "bonded"
    assert form.layer == pytest.approx(MU, rel=form.scatter + 0.07)  # noise, and large strain at 0.2 radii
    assert form.half_space > 1.1 * form.layer


def test_closed_forms_take_unknown_inputs_as_the_fit_found_them(fitted):
    """Those of a case that states these values: Poisson's ratio, base and thickness."""
    found = _with_moduli(fitted.case, replace(fitted, uncertain=UncertainInputs(at=FOUND))).closed_forms["press"]
    stated = _with_moduli(read_case(GEL, [f"{key}={value}" for key, value in STATED.items()]), fitted).closed_forms["press"]
    assert found == stated
    assert (found.poisson_ratio, found.base) == (pytest.approx((3 * 25 - 2) / (6 * 25 + 2)), "sliding")
    assert found.layer > 1.05 * fitted.closed_forms["press"].layer


def test_the_noise_of_the_curve_is_the_stated_one(fitted):
    (curve,) = read_case(GEL).curves
    residuals = curve.force - fitted.curves["press"].force
    assert np.std(residuals) == pytest.approx(0.01 * curve.force.max(), rel=0.35)  # of 25 draws


@pytest.mark.campaign
def test_the_whole_command_takes_a_quarter_of_a_minute(tmp_path):
    command = [sys.executable, "-m", "indentfit", "fit", str(GEL), "--json", "-o"]
    before = os.times()
    for name in ("compiles", "cached"):
        before = os.times()
        done = subprocess.run([*command, str(tmp_path / name)], capture_output=True, text=True, check=True)
    used = os.times()
    assert json.loads(done.stdout)["parameters"]["mu"]["value"] == pytest.approx(MU, rel=0.01)
    assert used.children_user - before.children_user + used.children_system - before.children_system <= SECONDS
