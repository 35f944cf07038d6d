"""Holds under two contacts: those of a draining gel are told from those of a viscous one."""

import re

import numpy as np
import pytest

import indentfit
from indentfit.case.draining import HOLDS_DIFFER, draining
from indentfit.curve import Curve
from indentfit.hereditary import Ramp, prony
from indentfit.inference.result import ParameterEstimate
from indentfit.inference.to_model import unless_holds_differ
from indentfit.inverse.problem import inverse_problem

SPHERES = ({"shape": "sphere", "radius": 1.0}, {"shape": "sphere", "radius": 4.0})
PUNCHES = ({"shape": "cylinder", "diameter": 1.0}, {"shape": "cylinder", "diameter": 2.0})
# Hu, Zhao, Vlassak and Suo 2010: what of the change from the undrained to the drained force is left, over D t / a^2
DRAINED = {
    "sphere": lambda t: 0.491 * np.exp(-0.908 * np.sqrt(t)) + 0.509 * np.exp(-1.679 * t),
    "cylinder": lambda t: 1.304 * np.exp(-np.sqrt(t)) - 0.304 * np.exp(-0.254 * t),
}


def case_of(indenters, left, noise=0.005, ramp=0.2):
    """Two tests of a gel whose hold has lost 1 - `left(time, area)` of a third of its force."""
    rng, tests = np.random.default_rng(5), []
    for n, indenter in enumerate(indenters):
        time = np.concatenate([np.linspace(0.0, ramp, 11)[1:], ramp + np.geomspace(0.05, 200, 60)])
        depth = Ramp(0.05, ramp, 200.0).depth_at(time)
        area = 0.05 * indenter["radius"] if "radius" in indenter else indenter["diameter"] ** 2 / 4
        since = time[:, None] - ramp * (np.arange(20) + 0.5) / 20  # of steps of the ramp
        force = 10 * np.mean(np.where(since > 0, 1 / 1.5 + (1 - 1 / 1.5) * left(np.maximum(since, 0.0), area), 0.0), axis=1)
        force = force + noise * force.max() * rng.standard_normal(force.size)
        tests.append(indentfit.Test(f"press {n}", angle=0, indenter=indenter, curve=Curve(depth, force, time=time)))
    return indentfit.Case(
        sample={"shape": "disc", "diameter": 60.0, "thickness": 20.0, "base": "bonded"},
        indenter={**indenters[0], "friction": 0.0},
        material={
            "model": "neo_hookean",
            "parameters": {"mu": {"start": 2, "min": 0.1, "max": 20}},
            "relaxation": {"terms": 2},
            "bulk_ratio": 1000.0,
        },
        tests=tests,
    )


@pytest.mark.parametrize("indenters", [SPHERES, PUNCHES])
@pytest.mark.parametrize("diffusivity", [0.003, 0.01])
def test_a_draining_gel_is_told(indenters, diffusivity):
    drained = DRAINED[indenters[0]["shape"]]
    case = case_of(indenters, lambda t, area: drained(diffusivity * t / area))
    (said,) = draining(case)
    assert said in case.warnings() and "4 times as large" in said and "not like viscosity" in said


@pytest.mark.parametrize("indenters", [SPHERES, PUNCHES])
@pytest.mark.parametrize("times", [(2.0, 30.0), (0.1, 5.0), (20.0, 400.0)])
def test_a_viscous_gel_is_not(indenters, times):
    function = prony((0.5, 0.5), times)
    assert [*draining(case_of(indenters, lambda t, area: function(t) - 1.0))] == []


def test_holds_under_one_contact_say_nothing():
    drained = DRAINED["cylinder"]
    assert [*draining(case_of((PUNCHES[0], PUNCHES[0]), lambda t, area: drained(0.01 * t / area)))] == []


def test_holds_that_differ_otherwise_are_told_and_determine_no_relaxation():
    """Times of which one is eight times as long under four times the area."""
    slower = {0.05: 1.0, 0.2: 8.0}
    case = case_of(SPHERES, lambda t, area: np.exp(-t / (2.0 * slower[area])))
    (said,) = draining(case)
    assert said.startswith(HOLDS_DIFFER) and "neither one viscosity nor draining" in said
    assert 6 < float(re.search(r"times ([\d.]+) times as long", said)[1]) < 10
    known = {name: ParameterEstimate(1.0, True, verdict="determined (+-2 %)") for name in ("mu", "g1", "tau1")}
    judged = unless_holds_differ(known, inverse_problem(case), (said,))
    assert judged["mu"] == known["mu"] and all(
        "do not relax over the same times" in judged[name].verdict for name in ("g1", "tau1")
    )
    assert unless_holds_differ(known, inverse_problem(case), ()) == known
