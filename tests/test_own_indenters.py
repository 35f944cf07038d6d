"""Tests with samples and indenters of their own: two indenters on one gel, strips of two thicknesses, in one fit."""

import numpy as np
import pytest
from fixtures.cases import TINY, straight_curve, tiny_case

from indentfit import fit, simulate, sweep
from indentfit.case import Case, Test
from indentfit.case.write import write_case
from indentfit.curve import Curve, write_curve
from indentfit.errors import CaseError
from indentfit.experiment.measured import read_case
from indentfit.layer import Layer
from indentfit.report.case_text import case_lines
from indentfit.report.fit_folder import write_fit
from indentfit.runs.bench import Bench
from indentfit.runs.key import Inputs
from indentfit.runs.mechanics import mechanics_of
from indentfit.runs.points import setup_of
from indentfit.runs.run import RunRequest

MU, NU, THICKNESS = 3.0, 0.45, 5.0
SPHERE = {"shape": "sphere", "diameter": 5.0, "friction": 0.0}
OWN = {"shape": "cylinder", "diameter": 2.0}
BALL = np.linspace(0.002, 0.02, 10)


def forces_of_layer(kind, radius, depth, thickness=THICKNESS):
    """Exact forces at small strain, mN: the integral equation of the bonded layer (Hayes 1972)."""
    layer, relative = Layer(True, NU), radius / thickness
    if kind == "sphere":
        return MU * thickness**2 * layer.sphere_force(relative, depth / thickness)
    return MU * thickness * layer.punch_stiffness(relative) * depth


def gel_case(folder, *tests, **tables):
    """The gel, pressed by a sphere in the first test and as the others say."""
    write_curve(folder / "sphere.csv", Curve(BALL, forces_of_layer("sphere", 2.5, BALL)))
    write_curve(folder / "punch.csv", Curve(BALL, forces_of_layer("punch", 1.0, BALL)))
    first = {"name": "sphere", "curve": "sphere.csv"}
    gel = {
        "sample": {"shape": "disc", "diameter": 60.0, "thickness": THICKNESS, "base": "bonded"},
        "indenter": {**SPHERE, "width": None, "length": None},
        "mesh": None,
        "solver": None,
        "material": {"model": "neo_hookean", "poisson_ratio": NU, "parameters": {"mu": {"start": 1.0, "min": 0.1, "max": 30.0}}},
        "test": [first, *tests],
        "fit": {"method": "least_squares", "workers": 1, "what_if": False},
    }
    return tiny_case(folder, **{**gel, **tables})


PUNCH = {"name": "punch", "curve": "punch.csv", "indenter": OWN}


@pytest.fixture(scope="module")
def both(tmp_path_factory):
    return read_case(gel_case(tmp_path_factory.mktemp("gel"), PUNCH))


@pytest.fixture(scope="module")
def fitted(both):
    return fit(both)


def test_a_sphere_and_a_punch_on_one_gel_give_its_modulus(fitted):
    known = fitted.parameters["mu"]
    assert known.value == pytest.approx(MU, rel=0.01)
    assert known.interval[0] <= MU <= known.interval[1] and known.interval[1] - known.interval[0] < 0.06 * MU
    assert set(fitted.rmse) == {"sphere", "punch"}
    assert "each sample, indenter and symmetry has a mesh of its own: sphere " in fitted.mesh.remark


def test_each_curve_is_that_of_a_case_of_its_own(both):
    together = simulate(both, mesh_error=False)
    pieces = {test.name: test for piece in both.pieces for test in simulate(piece, mesh_error=False).tests}
    for test in together.tests:
        np.testing.assert_array_equal(test.force, pieces[test.name].force)
    assert together.mesh.elements == sum(test.facts.elements for test in together.tests)
    assert [test.name for test in together.tests] == ["sphere", "punch"]


def test_a_run_has_the_model_of_its_test_and_a_key_of_its_own(both):
    bench, point = Bench(mechanics_of(both)), (("mu", MU),)
    runs = [bench.run(RunRequest(point, n, ("mu",))) for n in (0, 1, 0)]
    np.testing.assert_array_equal(runs[0].force, runs[2].force)
    for run, exact in zip(runs, (forces_of_layer("sphere", 2.5, BALL), forces_of_layer("punch", 1.0, BALL)), strict=False):
        np.testing.assert_allclose(run.force[3:], exact[3:], rtol=0.02)
        np.testing.assert_allclose(run.sensitivities["mu"], run.force / MU, rtol=1e-6)  # the force is linear in mu
    inputs = Inputs(both)
    keys = [inputs.of(dict(point), test) for test in both.tests]
    assert keys[0]["own"]["indenter"]["shape"] == "sphere" and keys[1]["own"]["indenter"]["shape"] == "cylinder"
    assert Inputs(both.pieces[0]).of(dict(point), both.tests[0]).keys() == keys[0].keys() - {"own"}
    with pytest.raises(ValueError, match="their own"):
        setup_of(both)


def test_the_second_mesh_of_each_test_is_stated(both):
    simulated = simulate(both)
    for test in simulated.tests:
        exact = forces_of_layer("sphere", 2.5, BALL) if test.name == "sphere" else forces_of_layer("punch", 1.0, BALL)
        scale = simulated.material.values["mu"] / MU
        assert abs(test.force[-1] - scale * exact[-1]) < 0.012 * scale * exact[-1]
        assert test.mesh_error.share(test.force) < 0.02
    assert set(simulated.closed_forms) == {"sphere", "punch"}
    assert simulated.closed_forms["punch"].formula == "flat punch"


def test_the_pages_say_the_own_indenter(both, fitted, tmp_path):
    assert "    its indenter  cylinder, diameter 2 mm, sharp edge, friction 0" in list(case_lines(both))
    write_fit(fitted, tmp_path / "result", fields=False)
    page = (tmp_path / "result" / "report.html").read_text(encoding="utf-8")
    assert "Test punch: rigid cylinder, diameter 2 mm" in page


def test_a_case_with_own_tables_is_written_and_read_again(both, tmp_path):
    again = read_case(write_case(both, tmp_path))
    assert again.hash == both.hash
    assert again.indenter_of(again.tests[1]).geometry == both.indenter_of(both.tests[1]).geometry


def test_the_own_tables_of_a_case_in_memory():
    curve = Curve(BALL, forces_of_layer("punch", 1.0, BALL))
    case = Case(
        sample={"shape": "disc", "diameter": 60.0, "thickness": THICKNESS, "base": "bonded"},
        indenter=SPHERE,
        material={"model": "neo_hookean", "parameters": {"mu": 3.0}},
        tests=[Test("punch", curve=curve, indenter=OWN), Test("thin", depth=0.1, sample={"thickness": 2.0})],
    )
    assert [case.sample_of(test).thickness for test in case.tests] == [THICKNESS, 2.0]
    assert [case.indenter_of(test).shape for test in case.tests] == ["cylinder", "sphere"]
    with pytest.raises(CaseError, match=r"test\.indenter\.diametr.*did you mean diameter"):
        Test("punch", depth=0.1, indenter={"diametr": 2.0})
    with pytest.raises(CaseError, match=r"test\.thin\.depth = 0\.1: .*half of the thickness, 0\.15 mm"):
        Case(**{**dict(case), "tests": [Test("thin", depth=0.1, sample={"thickness": 0.15})], "curves": ()})


WRONG = {
    "test.punch.indenter={ shape = 'cylinder' }": "test.punch.indenter.diameter: missing; a cylinder needs it",
    "test.punch.indenter={ diametr = 2 }": "test.punch.indenter.diametr = 2: unknown key; did you mean diameter?",
    "test.punch.indenter={ half_angle = 60 }": "test.punch.indenter.half_angle = 60.0: does not belong to a sphere",
    "test.punch.indenter={ friction = 'unknown' }": "must be known for a single test",
    "test.punch.indenter=3": "must be a table",
    "test.punch.sample={ thickness = 0.01 }": "goes 20 um deep, through the sample of 10 um",
    "test.punch.indenter={ shape = 'cylinder', diameter = 80 }": "test.punch.indenter.diameter = 80.0: ",
}


@pytest.mark.quick
@pytest.mark.parametrize("override", WRONG)
def test_a_fault_of_an_own_table_is_said_in_one_line(override, tmp_path):
    with pytest.raises(CaseError) as caught:
        read_case(gel_case(tmp_path, PUNCH), [override])
    (line,) = caught.value.faults
    assert WRONG[override] in line


@pytest.mark.quick
def test_an_override_of_an_own_key_takes_its_rivals_out(tmp_path):
    path = gel_case(tmp_path, PUNCH)
    case = read_case(path, ["test.punch.indenter.radius=1500 um"])
    assert case.indenter_of(case.tests[1]).geometry.half_width == 1.5
    case = read_case(path, ["indenter.radius=1"])  # of the case: the test keeps its own
    assert [case.indenter_of(test).geometry.half_width for test in case.tests] == [1.0, 1.0]


@pytest.mark.quick
def test_an_uncertain_input_is_that_of_the_tests_that_take_it_from_the_case(tmp_path):
    own = {**PUNCH, "sample": {"thickness": 4.0}}
    case = read_case(gel_case(tmp_path, own))
    there = mechanics_of(case).changed({"sample.thickness": 4.5, "indenter.friction": 0.2})
    assert [there.of(n).sample.thickness for n in (0, 1)] == [4.5, 4.0]
    assert [there.of(n).indenter.friction for n in (0, 1)] == [0.2, 0.2]
    both = [{"name": "a", "curve": "punch.csv", "sample": {"thickness": 4.0}}, {"name": "b", "curve": "punch.csv", **own}]
    both[1].pop("name")
    both[1]["name"] = "b"
    path = gel_case(tmp_path, test=both, fit={"uncertain": {"thickness": 0.1}})
    with pytest.raises(CaseError, match=r"fit\.uncertain\.thickness = 0\.1: every test has its own thickness"):
        read_case(path)


def test_a_strip_along_and_across_on_two_thicknesses(tmp_path):
    """The stiffness of each test is that of a case with its own thickness; a sweep of friction has both."""
    for name in ("along", "across"):
        straight_curve(tmp_path / f"{name}.csv", 3.0)
    tests = [
        {"name": "along", "angle": 0, "curve": "along.csv"},
        {"name": "across", "angle": 90, "curve": "across.csv", "sample": {"thickness": 5.0}},
    ]
    case = read_case(tiny_case(tmp_path, test=tests))
    simulated = simulate(case, {"mu": 1.0}, mesh_error=False)
    for n, thickness in ((0, TINY["sample"]["thickness"]), (1, 5.0)):
        test = {key: value for key, value in tests[n].items() if key != "sample"}
        (tmp_path / str(n)).mkdir()
        straight_curve(tmp_path / str(n) / test["curve"], 3.0)
        alone = read_case(tiny_case(tmp_path / str(n), sample={"thickness": thickness}, test=[test]))
        np.testing.assert_array_equal(simulate(alone, {"mu": 1.0}, mesh_error=False).tests[0].force, simulated.tests[n].force)
    swept = sweep(case, {"indenter.friction": [0.0, 0.3], "test.across.sample.thickness": [4.0]})
    assert [len({point.tests[name].force for point in swept.points}) for name in ("along", "across")] == [2, 3]
    (thicker,) = [row for row in swept.sensitivities if row.key == "test.across.sample.thickness" and row.test == "across"]
    assert thicker.elasticity < 0  # a thicker sample is softer
