"""The angle of a sample's fibres as an input that is stated or fitted: its sensitivity, its recovery, and what is said of it."""

import numpy as np
import pytest
from fixtures.cases import MU, PHI, ZETA, tiny_case

from indentfit import fit
from indentfit.case import Indenter, Mesh, Sample, Solver
from indentfit.case.ranges import RangeOfAngle
from indentfit.curve import Curve, write_curve
from indentfit.errors import CaseError
from indentfit.experiment.measured import read_case
from indentfit.fem.setup import Press, Setup
from indentfit.fem.simulate import Model
from indentfit.inference.verdicts import verdict
from indentfit.material import load
from indentfit.runs.forward import simulate
from indentfit.study import design as designs
from indentfit.study import further
from indentfit.study.further import angles_of

PAPER = load("transversely_isotropic")(mu=1.49, zeta=4.68, phi=0.68)
FIBRES = {"model": "transversely_isotropic", "parameters": PAPER.values}
FREE = {"model": "transversely_isotropic", "parameters": {"mu": MU, "zeta": ZETA, "phi": PHI}}
DEPTHS = np.array([0.15, 0.33])
RANGE = {"start": 0.0, "min": -45.0, "max": 45.0}
TRUE = 12.0


def model_of(symmetry, friction, **indenter):
    table = Indenter(**(indenter or {"shape": "strip", "width": 2, "length": 20}), friction=friction)
    sample = Sample(shape="disc", diameter=14, thickness=3.3, base="sliding")
    solver = Solver(element="q1p0", tolerance=1e-8, max_step=0.0825)
    return Model(Setup(sample, table, Mesh(elements=24), solver, DEPTHS[-1], symmetry))


def pressed(model, angle, dip=0.0, sensitivities=()):
    return model.run(Press(PAPER, 1000 * PAPER.mu, angle, DEPTHS, sensitivities=sensitivities, dip=dip))


@pytest.mark.parametrize(
    ("symmetry", "angle", "dip", "friction", "indenter"),
    [
        ("half", 35, 0, "stick", {}),
        ("half", 20, 0, 0.3, {"shape": "strip", "width": 2, "length": 8}),
        ("whole", 60, 25, "stick", {}),
        ("half", 50, 0, 0.2, {"shape": "cylinder", "diameter": 4, "edge_radius": 0.5}),
    ],
    ids=["sticking", "slipping", "dipping", "rounded"],
)
def test_the_sensitivity_to_the_angle_is_that_of_central_differences(symmetry, angle, dip, friction, indenter):
    model, step = model_of(symmetry, friction, **indenter), 0.05
    exact = pressed(model, angle, dip, ("fibre_angle", "zeta"))
    low, high = (pressed(model, angle + change, dip).force for change in (-step, step))
    size = np.abs(exact.force).max() / 45  # a slope that matters; that under a round indenter is nearly zero
    np.testing.assert_allclose(exact.sensitivities["fibre_angle"], (high - low) / (2 * step), rtol=1e-4, atol=1e-4 * size)


def test_a_quarter_has_no_slope_by_the_angle_as_the_half_there_has_none():
    for symmetry in ("quarter", "half"):
        result = pressed(model_of(symmetry, "stick"), 90, sensitivities=("fibre_angle",))
        np.testing.assert_allclose(result.sensitivities["fibre_angle"], 0, atol=1e-6 * result.force[-1])


def angled(folder, angles, material=FIBRES, curves=False, **tables):
    own = [{"curve": f"t{angle}.csv"} if curves else {"depth": 0.3, "points": 8} for angle in angles]
    tests = [{"name": f"t{angle}", "angle": angle, **test} for angle, test in zip(angles, own, strict=True)]
    return tiny_case(folder, test=tests, indenter={"friction": "stick"}, material=material, **tables)


@pytest.mark.quick
def test_a_turned_sample_is_one_whose_tests_have_other_angles(tmp_path):
    turned = simulate(read_case(angled(tmp_path, [5, 170]), ["sample.fibre_angle=25"]), mesh_error=False)
    stated = simulate(read_case(angled(tmp_path, [30, 15])), mesh_error=False)
    for here, there in zip(turned.tests, stated.tests, strict=True):
        assert here.angle == there.angle
        np.testing.assert_allclose(here.force, there.force, rtol=1e-12)


def test_a_fit_finds_the_angle_by_which_a_sample_is_turned(tmp_path):
    angles = [0, 45, 90]
    rng = np.random.default_rng(3)
    for test in simulate(read_case(angled(tmp_path, angles), [f"sample.fibre_angle={TRUE}"]), mesh_error=False).tests:
        noisy = test.force + 0.05 * rng.standard_normal(test.force.size)
        write_curve(tmp_path / f"{test.name}.csv", Curve(test.displacement, noisy))
    path = angled(tmp_path, angles, FREE, True, fit={"uncertain": {"mesh": 0.0, "fibre_angle": RANGE}})
    result = fit(read_case(path))
    known = result.parameters["fibre_angle"]
    low, high = known.interval
    assert low < TRUE < high and high - low < 3
    assert known.unit == "degrees" and "determined (+-" in known.verdict and "degrees" in known.verdict
    for name, true in PAPER.values.items():
        assert result.parameters[name].interval[0] < true < result.parameters[name].interval[1]


@pytest.mark.quick
def test_an_angle_is_judged_by_degrees_and_not_by_its_own_size():
    bounds = RangeOfAngle(**RANGE)
    assert verdict(0.1, (-0.9, 1.1), bounds, "").startswith("determined (+-1 degrees)")
    assert verdict(0.1, (-20, 20), bounds, "").startswith("weakly determined")
    assert verdict(0.1, (-40, 40), bounds, "").startswith("not determined")
    assert "directions go on beyond it: move the range" in verdict(45, (43, 45), bounds, "upper")


@pytest.mark.quick
def test_angles_that_no_curve_can_tell_apart_are_warned_of(tmp_path):
    def warned(*angles):
        path = angled(tmp_path, angles, fit={"uncertain": {"fibre_angle": RANGE}})
        return [line for line in read_case(path).warnings() if "fibre_angle" in line]

    assert "an angle and its opposite fit equally well" in warned(0, 90)[0]
    assert not warned(0, 45, 90)


@pytest.mark.quick
def test_design_tries_an_oblique_bar_where_the_direction_of_the_fibres_matters(tmp_path):
    def tried(*angles, **fitting):
        return angles_of(read_case(angled(tmp_path, angles, **fitting)))

    assert tried(0, 90) == (0, 90)
    assert tried(0, 30) == tried(0, 90, fit={"uncertain": {"fibre_angle": RANGE}}) == (0, 90, 45)
    assert tried(0, material={"model": "neo_hookean", "parameters": {"mu": 1.0}}) == (0,)


@pytest.mark.quick
@pytest.mark.parametrize(
    ("material", "value", "text"),
    [
        (FIBRES, {"start": 0, "min": -100, "max": 90}, "at most 180 degrees above min"),
        (FIBRES, 5.0, "the angle is fitted"),
        ({"model": "neo_hookean", "parameters": {"mu": 1.0}}, RANGE, "the material has no fibres"),
    ],
)
def test_a_range_of_the_angle_that_means_nothing_is_refused_in_one_line(tmp_path, material, value, text):
    with pytest.raises(CaseError, match=rf"fit\.uncertain\.fibre_angle.*{text}"):
        read_case(angled(tmp_path, [0, 45], material, fit={"uncertain": {"fibre_angle": value}}))


def test_design_does_not_take_the_angle_that_a_fit_finds_for_known(tmp_path, monkeypatch):
    monkeypatch.setattr(further, "_variants", lambda case: [("", case)])
    monkeypatch.setattr(further, "_specimens", lambda case: [])
    fitting = {"uncertain": {"fibre_angle": RANGE, "mesh": 0.0}}
    turning = designs.design(read_case(angled(tmp_path, [0, 90], FREE, fit=fitting)), PAPER.values)
    known = designs.design(read_case(angled(tmp_path, [0, 90], FREE)), PAPER.values)
    assert turning.parameters["fibre_angle"] == 0 and set(turning.stderr) == {*PAPER.values, "fibre_angle"}
    assert all(turning.stderr[name] >= 0.999 * known.stderr[name] for name in known.stderr)
    assert turning.stderr["fibre_angle"] == pytest.approx(90 / np.sqrt(12), rel=1e-3)  # that of the range: no test tells the angle
    least = {angle: min(t.stderr["fibre_angle"] for t in turning.candidates if t.angle == angle) for angle in (0, 45, 90)}
    assert least[45] < 0.2 * min(least[0], least[90])  # along and across the fibres the force does not change with their angle
