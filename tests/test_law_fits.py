"""Fits of laws without fibres come back to the truth: an Ogden gel under a sphere, from a curve of a finer mesh with noise."""

import warnings

import numpy as np
import pytest

from indentfit import Case, Curve, Indenter, MaterialChoice, Mesh, Sample, Test, fit, simulate
from indentfit.case.search import Fit

MU, ALPHA = 1.5, 6.0
GEL = {
    "sample": Sample(shape="disc", diameter=12.0, thickness=1.0, base="bonded"),
    "indenter": Indenter(shape="sphere", diameter=2.0, friction=0),
}


def ogden(**parameters):
    return MaterialChoice(model="ogden", parameters=parameters, bulk_ratio=1000.0)


@pytest.mark.campaign
def test_mu_and_alpha_of_an_ogden_gel_come_back_within_their_intervals_and_5_percent():
    truth = Case(**GEL, material=ogden(mu=MU, alpha=ALPHA), mesh=Mesh(error=0.002), tests=[Test("press", depth=0.3, points=100)])
    curve = simulate(truth).tests[0].curve
    noise = 0.01 * curve.force.max() * np.random.default_rng(5).standard_normal(100)
    free = ogden(mu={"start": 1, "min": 0.1, "max": 10}, alpha={"start": 2, "min": 1, "max": 30})
    case = Case(
        **GEL, material=free, tests=[Test("press", curve=Curve(curve.displacement, curve.force + noise))], fit=Fit(workers=1)
    )
    result = fit(case)
    for name, value in (("mu", MU), ("alpha", ALPHA)):
        fitted = result.parameters[name]
        low, high = fitted.interval
        assert low < value < high
        assert fitted.value == pytest.approx(value, rel=0.05)
        assert "determined" in fitted.verdict


def test_a_law_that_stiffens_steeply_warns_of_no_overflow():
    """Wild iterates of the exponential have residuals beyond the largest number; they are refused without NumPy's warning."""
    steep = MaterialChoice(model="demiray_fung", parameters={"mu": 2.0, "b": 30.0}, poisson_ratio=0.49)
    gel = {"sample": Sample(shape="disc", diameter=12.0, thickness=4.0, base="bonded"), "mesh": Mesh(elements=40)}
    case = Case(
        **gel, indenter=Indenter(shape="sphere", diameter=4.0, friction=0), material=steep, tests=[Test("press", depth=1.6)]
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert np.all(np.diff(simulate(case).tests[0].force) > 0)
