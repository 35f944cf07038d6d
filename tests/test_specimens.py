"""Tests without an indenter: shear, uniaxial and biaxial curves in a case, from the keys to the result."""

import html
import json
import re
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from indentfit.axes import Axes
from indentfit.case import Case, Indenter, MaterialChoice, Mesh, Range, Sample, Test, write_case
from indentfit.cli import main
from indentfit.curve import Curve, read_curve
from indentfit.errors import CaseError, CurveError
from indentfit.experiment.measured import read_case
from indentfit.inference.fit import fit
from indentfit.inverse.problem import inverse_problem
from indentfit.material import load
from indentfit.runs.bench import Bench
from indentfit.runs.forward import simulate
from indentfit.runs.key import Inputs
from indentfit.runs.mechanics import mechanics_of
from indentfit.runs.run import RunRequest

TRUTH = {"mu": 1.49, "zeta": 4.68, "phi": 0.68}
WHITE = "transversely_isotropic"
FREE = {
    "mu": Range(start=1.0, min=0.1, max=5.0),
    "zeta": Range(start=3.0, min=0.0, max=20.0),
    "phi": Range(start=1.0, min=0.0, max=5.0),
}
PULL = {"kind": "uniaxial", "loading": "tension", "fibres": "along"}
SHEARS = [
    Test("along", kind="shear", fibres="along", strain=0.2, points=8),
    Test("across", kind="shear", fibres="normal", strain=0.2, points=8),
]
BAR = {
    "sample": Sample(shape="disc", diameter=14.0, thickness=3.3, base="sliding"),
    "indenter": Indenter(shape="strip", width=2.0, length=20.0, friction=0.5),
    "mesh": Mesh(elements=30),
}


def case_of(tests, parameters=TRUTH, **tables):
    return Case(material=MaterialChoice(model=WHITE, parameters=parameters, bulk_ratio=1000.0), tests=tests, **tables)


def along(stretch, mu, zeta, phi):
    """Nominal stress along the fibres of an incompressible material (closed form of small print: phi has no effect)."""
    return (mu * (stretch**2 - 1 / stretch) + 2 * mu * zeta * stretch**2 * (stretch**2 - 1)) / stretch


def test_simulated_curves_are_closed_forms_in_the_units_of_the_test():
    case = case_of([*SHEARS, Test("pull", **PULL, strain=0.2, points=4, area=50.0, length=8.0)])
    result = simulate(case)
    g = np.arange(1, 9) * 0.2 / 8
    assert result.curves["along"].force == pytest.approx(1.49 * 1.68 * g, rel=1e-10)
    assert result.curves["across"].force == pytest.approx(1.49 * g, rel=1e-10)
    pull = result.curves["pull"]
    assert pull.displacement == pytest.approx(8.0 * 0.2 * np.arange(1, 5) / 4)
    assert pull.force == pytest.approx(50.0 * along(1 + pull.displacement / 8.0, **TRUTH), rel=1e-2)  # incompressible to 1 %
    assert (pull.shown, result.curves["along"].shown) == (Axes(), Axes("strain", "stress"))
    assert result.mesh.elements == 0


def test_json_and_texts_speak_of_strain_and_stress():
    result = simulate(case_of(SHEARS))
    test = result.as_json()["tests"][0]
    assert test["strain"][-1] == pytest.approx(0.2)
    assert test["stress_kPa"][-1] == pytest.approx(1.49 * 1.68 * 0.2)
    assert not {"displacement_mm", "force_mN"} & set(test)
    text = result.summary()
    assert "strain  stress, kPa" in text
    assert not re.search(r"\bmm\b|\bmN\b|elements", text.replace("finite elements", ""))


def test_a_fit_of_shear_and_tension_finds_the_truth(tmp_path):
    """No indenter at all: three curves with 1 % noise give three parameters, and every report names strains and stresses."""
    tests = [*SHEARS, Test("pull", **PULL, strain=0.2, points=12, area=100.0, length=10.0)]
    rng, curves = np.random.default_rng(1), simulate(case_of(tests)).curves
    noisy = []
    for curve in curves.values():
        noise = 0.01 * curve.force[-1] * np.ones(curve.force.size)
        stated = 3 * noise if curve.shown.up == "stress" else None  # known no better than that
        noisy.append(Curve(curve.displacement, curve.force + noise * rng.standard_normal(noise.size), sd=stated))
    measured = [
        test.model_copy(update={"strain": None, "points": 25, "curve": curve}) for test, curve in zip(tests, noisy, strict=True)
    ]
    measured = [
        Test(**{key: value for key, value in dict(test).items() if value is not None and key not in ("points", "dip")})
        for test in measured
    ]
    result = fit(case_of(measured, FREE))
    assert result.success
    for name, truth in TRUTH.items():
        known = result.parameters[name]
        assert known.value == pytest.approx(truth, rel=0.05), name
        assert known.interval[0] < truth < known.interval[1], name
        assert known.verdict.startswith("determined"), name
    assert {known.input for known in result.taken_as_known} == {"bulk_ratio", "force", "law"}
    assert all(0 < known.p <= 1 for known in result.predicted.values())
    result.write(tmp_path / "result")
    page = (tmp_path / "result" / "report.html").read_text(encoding="utf-8")
    assert "at a strain of 0.2" in page
    assert len(re.findall(r"[\d.]+ k?Pa</td>", page)) >= 2  # RMSEs of the two stresses
    words = " ".join(html.unescape(re.sub("<[^>]+>", "", page)).split())
    assert re.search(r"tests. RMSEs: [\d.]+ kPa", words) and "Singular value (kPa)" in words and "Objective (mN)" not in words
    figure = result.plot()
    assert {"Strain", "Displacement (mm)"} <= {axes.get_xlabel() for axes in figure.axes}
    assert {"Stress (kPa)", "Force (mN)"} <= {axes.get_ylabel() for axes in figure.axes}
    header = (tmp_path / "result" / "curves.csv").read_text().splitlines()[0]
    assert header == "test,displacement_mm,force_mN,measured_force_mN,strain,stress_kPa,measured_stress_kPa"
    assert "kPa" in result.summary().split("objective")[1].split("\n")[0]


def test_an_indentation_has_the_same_runs_beside_a_shear_test():
    """Ledger keys and forces of indentations do not change when other tests join them, and the shear test has no mesh."""
    press = Test("press", angle=0, depth=0.1, points=3)
    alone, mixed = case_of([press], **BAR), case_of([SHEARS[0], press], **BAR)
    keys = [Inputs(case).hash(Inputs(case).of(TRUTH, press)) for case in (alone, mixed)]
    assert keys[0] == keys[1]
    assert Inputs(mixed).hash(Inputs(mixed).of(TRUTH, SHEARS[0])) not in keys
    point = tuple(TRUTH.items())
    runs = [Bench(mechanics_of(case)).run(RunRequest(point, n, ("zeta",))) for n, case in enumerate((alone, mixed))]
    assert np.array_equal(runs[0].force, runs[1].force)
    assert np.array_equal(runs[0].sensitivities["zeta"], runs[1].sensitivities["zeta"])
    shear = Bench(mechanics_of(mixed)).run(
        RunRequest((*point, ("sample.base", "bonded"), ("offset", 0.01)), 0, ("phi", "friction"))
    )
    assert shear.force == pytest.approx(1.49 * 1.68 * mixed.outputs(mixed.tests[0]))  # neither base nor offset changes it
    assert shear.sensitivities["phi"] == pytest.approx(1.49 * mixed.outputs(mixed.tests[0]))
    assert not shear.sensitivities["friction"].any()


def test_residuals_of_different_kinds_are_compared_by_their_share():
    """A stress of 0.5 kPa must not vanish beside a force of 30 mN: equal relative misfits count equally."""
    curves = [Curve(np.arange(1, 7) / 20, 5.0 * np.arange(1, 7)), Curve(np.arange(1, 7) / 30, 0.08 * np.arange(1, 7))]
    tests = [Test("press", angle=0, curve=curves[0]), Test("shear", kind="shear", fibres="along", curve=curves[1])]
    problem = inverse_problem(case_of(tests, FREE, **BAR))
    exact = [curve.force for curve in curves]
    parts = [
        problem.judge(TRUTH, [force * (1.1 if n == k else 1) / problem.factor(TRUTH) for k, force in enumerate(exact)])
        for n in (0, 1)
    ]
    assert parts[0].objective == pytest.approx(parts[1].objective)
    assert parts[0].sum_of_squares == pytest.approx(parts[1].sum_of_squares)


CSV = {
    "displacement_um,force_N": ("0,0\n100,0.1\n200,0.2\n300,0.3\n400,0.4\n", [0, 0.1, 0.2, 0.3, 0.4], [0, 100, 200, 300, 400]),
    "strain (%),stress_Pa": ("0,0\n-1,-100\n-2,-200\n-3,-300\n-4,-400\n", [0, 0.01, 0.02, 0.03, 0.04], [0, 0.1, 0.2, 0.3, 0.4]),
    "stretch;stress_kPa": ("1;0\n0,99;-1\n0,98;-2\n0,97;-3\n0,96;-4\n", [0, 0.01, 0.02, 0.03, 0.04], [0, 1, 2, 3, 4]),
}


@pytest.mark.parametrize("header", CSV)
def test_a_curve_of_a_compression_is_read_in_any_unit_and_sign(tmp_path, header):
    rows, across, up = CSV[header]
    (tmp_path / "c.csv").write_text(f"{header}\n{rows}")
    curve = read_curve(tmp_path / "c.csv", "compression")
    assert curve.displacement == pytest.approx(across)
    assert curve.force == pytest.approx(up)


@pytest.mark.parametrize("loading", ["tension", "shear"])
def test_a_compression_is_not_read_as_a_tension(tmp_path, loading):
    (tmp_path / "c.csv").write_text("stretch,stress_kPa\n1,0\n0.99,-1\n0.98,-2\n0.97,-3\n0.96,-4\n")
    with pytest.raises(CurveError, match=r"line 6: strain -0\.04: none is positive"):
        read_curve(tmp_path / "c.csv", loading)


def test_stretches_above_one_are_no_compression(tmp_path):
    (tmp_path / "c.csv").write_text("stretch,stress_kPa\n1,0\n1.01,1\n1.02,2\n1.03,3\n1.04,4\n")
    with pytest.raises(CurveError, match="none is positive"):
        read_curve(tmp_path / "c.csv", "compression")


HEAD = """[material]
model = "transversely_isotropic"
bulk_ratio = 1000
[material.parameters]
mu = 1.49
zeta = 4.68
phi = 0.68
"""
FORCES = "displacement_mm,force_mN\n0.1,1\n0.2,2\n0.3,3\n0.4,4\n0.5,5\n"
STRESSES = "strain,stress_kPa\n0.1,1\n0.2,2\n0.3,3\n0.4,4\n0.5,5\n"
BAD = {
    "an indenter that nothing needs": (
        '[indenter]\nshape = "strip"\nwidth = 2\nlength = 20\nfriction = 0.5\n',
        "",
        "",
        "indenter: no test is an indentation",
    ),
    "no fibres": ("", "", 'kind = "shear"\nstrain = 0.1\n', "test.a.fibres: missing; the material has fibres"),
    "an angle": (
        "",
        "",
        'kind = "shear"\nfibres = "along"\nangle = 0\nstrain = 0.1\n',
        "test.a.angle = 0: does not belong to a shear",
    ),
    "no loading": ("", "", 'kind = "uniaxial"\nfibres = "along"\nstrain = 0.1\n', "test.a.loading: missing; a uniaxial test is in"),
    "a stretch below 0": (
        "",
        "",
        'kind = "uniaxial"\nfibres = "along"\nloading = "compression"\nstrain = 1.2\n',
        "test.a.strain = 1.2: must be below 1 in compression",
    ),
    "no area": (
        "",
        FORCES,
        'kind = "shear"\nfibres = "along"\nlength = 3\ncurve = "c.csv"\n',
        "test.a.area: missing; the curve shows f",
    ),
    "no length": (
        "",
        FORCES,
        'kind = "shear"\nfibres = "along"\narea = 3\ncurve = "c.csv"\n',
        "test.a.length: missing; the curve shows",
    ),
    "an area of a stress": (
        "",
        STRESSES,
        'kind = "shear"\nfibres = "along"\narea = 3\ncurve = "c.csv"\n',
        "test.a.area = 3.0: has no effect: the curve shows stresses",
    ),
    "a depth": (
        "",
        "",
        'kind = "shear"\nfibres = "along"\ndepth = 0.1\n',
        "test.a.depth = 0.1: does not belong to a shear test; give",
    ),
    "normal in a uniaxial test": (
        "",
        "",
        'kind = "uniaxial"\nfibres = "normal"\nloading = "tension"\nstrain = 0.1\n',
        "test.a.fibres = \"normal\": must be 'along' or 'across'",
    ),
    "no sample": ("", "", "angle = 0\ndepth = 0.1\n", "sample: missing; add a table [sample]"),
    "strain of an indentation": ("", "", "angle = 0\nstrain = 0.1\n", "test.a.strain = 0.1: does not belong to an indentation"),
    "relaxation": (
        "[material.relaxation]\ng = [0.3]\ntau = [2]\n",
        "",
        'kind = "shear"\nfibres = "along"\nstrain = 0.1\n',
        'test.a.kind = "shear": is not solved for a material that relaxes',
    ),
    "friction of nothing": (
        "[fit.uncertain]\nfriction = 0.1\n",
        "",
        'kind = "shear"\nfibres = "along"\nstrain = 0.1\n',
        "fit.uncertain.friction",
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_a_wrong_key_is_refused_in_one_line(tmp_path, name):
    table, curve, keys, said = BAD[name]
    (tmp_path / "c.csv").write_text(curve)
    keys = keys or 'kind = "shear"\nfibres = "along"\nstrain = 0.1\n'
    (tmp_path / "case.toml").write_text(f'{HEAD}{table}[[test]]\nname = "a"\n{keys}')
    with pytest.raises(CaseError) as refused:
        read_case(tmp_path / "case.toml")
    assert any(said in fault for fault in refused.value.faults), refused.value.faults


def test_a_case_made_of_values_is_written_and_read_the_same(tmp_path):
    curve = Curve(np.arange(1, 6) / 10, np.arange(1, 6) / 5)
    case = case_of([Test("press", kind="uniaxial", loading="compression", fibres="across", curve=curve)])
    written = read_case(write_case(case, tmp_path / "case"))
    assert written.hash == case.hash
    assert written.curves[0].shown == Axes("strain", "stress")
    assert (tmp_path / "case" / "curves" / "press.csv").read_text().startswith("strain,stress_kPa\n0.1,0.2\n")


def test_commands_on_a_specimen_alone(tmp_path):
    def said(*arguments):
        answer = CliRunner().invoke(main, list(map(str, arguments)))
        assert answer.exit_code == 0, answer.output
        return answer.output

    (tmp_path / "case.toml").write_text(f'{HEAD}[[test]]\nname = "a"\nkind = "shear"\nfibres = "along"\nstrain = 0.1\n')
    words = said("validate", tmp_path / "case.toml")
    assert "simple shear, fibres along, 25 points to a strain of 0.1" in words
    assert "indenter" not in words
    said("simulate", tmp_path / "case.toml", "-o", tmp_path / "result")
    stored = json.loads((tmp_path / "result" / "simulation.json").read_text())
    assert stored["tests"][0]["stress_kPa"][-1] == pytest.approx(1.49 * 1.68 * 0.1)
    said("report", tmp_path / "result")
    page = (tmp_path / "result" / "report.html").read_text(encoding="utf-8")
    assert "Last stress of each test" in page
    assert "Indenter:" not in page


def test_a_law_without_fibres_needs_no_direction():
    neo = Case(
        material=MaterialChoice(model="neo_hookean", parameters={"mu": 2.0}, bulk_ratio=1000.0),
        tests=[Test("s", kind="shear", strain=0.1, points=2)],
    )
    assert simulate(neo).curves["s"].force == pytest.approx([0.1, 0.2])
    assert load("neo_hookean")(mu=2.0).shear_modulus == 2.0


@pytest.mark.campaign
def test_two_shear_stiffnesses_fix_the_phi_of_white_matter():
    """Known to 5 %, they alone give phi + 1 to sqrt(2) 5 %; with the force curves its standard error is at most 0.09 (1 + phi)."""
    case = read_case(Path(__file__).parents[1] / "cases" / "white_matter_shear" / "case.toml", ["mesh.elements=30"])
    phi = fit(case).parameters["phi"]
    assert phi.total <= 0.09 * (1 + phi.value)
    assert phi.interval[0] < 0.68 < phi.interval[1]
