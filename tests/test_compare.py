"""Laws against each other: evidences have known values, a choice abstains where it should, and the command compares laws."""

import json
import sys

import numpy as np
import pytest
from click.testing import CliRunner
from fixtures.cases import tiny_case
from scipy.integrate import quad
from scipy.stats import multivariate_normal

from indentfit.case import Case, Range
from indentfit.cli import main
from indentfit.curve import Curve, write_curve
from indentfit.errors import CaseError
from indentfit.experiment.measured import read_case
from indentfit.inference.evidence import evidence, under_another_noise
from indentfit.inference.law_choice import Weighed, choose
from indentfit.inference.law_curves import PlainCurves
from indentfit.inference.nested import nested_evidence
from indentfit.inference.noise import correlations
from indentfit.inference.out_of_sample import DEPTH, parts_left_out
from indentfit.inference.residual_noise import CORRELATIONS, LARGEST, SIZES, SMALLEST, smoothed, unknown_noise
from indentfit.inference.wide_fit import widens
from indentfit.inverse.objective import Target
from indentfit.inverse.problem import InverseProblem, inverse_problem
from indentfit.material import load, typed
from indentfit.report.schema import read_result
from indentfit.runs.forward import simulate
from indentfit.study.compare import compare
from indentfit.study.law_ranges import law_case, laws_asked, moduli_of, usual_range

DEPTHS = np.linspace(0.1, 1, 6)
quick = pytest.mark.quick


def line(slope=2.0, noise=0.05, seed=3):
    """The problem of a straight line through the origin, whose slope mu is uniform between 1 and 4."""
    force = slope * DEPTHS + noise * np.random.default_rng(seed).standard_normal(DEPTHS.size)
    bounds = Range(start=2, min=1, max=4)
    return InverseProblem((Target("press", Curve(DEPTHS, force), 1.0),), {"mu": 2.0}, {"mu": bounds}, "mu", 2.0)


@quick
def test_the_density_of_residuals_is_the_mixture_of_normal_densities_over_size_and_smoothness_of_the_noise():
    problem = line()
    residuals = np.array([0.1, -0.05, 0.02, 0.0, 0.04, -0.1])
    force = problem.tests[0].curve.force
    smooth = np.exp(-0.5 * (np.subtract.outer(DEPTHS, DEPTHS) / 0.5) ** 2)
    mesh = 0.02**2 * np.outer(smoothed(DEPTHS, force), smoothed(DEPTHS, force)) * smooth
    densities = [
        multivariate_normal(np.zeros(6), sigma**2 * correlations(6, rho) + mesh).pdf(residuals)
        for rho in CORRELATIONS
        for sigma in np.geomspace(SMALLEST, LARGEST, SIZES) * force.max()
    ]
    noise = unknown_noise(problem, 0.02)
    assert noise.log_likelihood((force + residuals)[None])[0] == pytest.approx(np.log(np.mean(densities)), rel=1e-9)


@quick
def test_an_uncertain_input_that_is_no_coordinate_widens_the_noise():
    problem, move = line(), 0.1 * DEPTHS
    residuals, force = 0.9 * move, problem.tests[0].curve.force
    densities = [
        multivariate_normal(np.zeros(6), sigma**2 * correlations(6, rho) + np.outer(move, move)).pdf(residuals)
        for rho in CORRELATIONS
        for sigma in np.geomspace(SMALLEST, LARGEST, SIZES) * force.max()
    ]
    noise = unknown_noise(problem, 0.0, moves=[[move]])
    assert noise.log_likelihood((force + residuals)[None])[0] == pytest.approx(np.log(np.mean(densities)), rel=1e-6)


@quick
def test_laws_with_uncertain_inputs_are_searched_on_a_surrogate_with_the_inputs_as_coordinates(tmp_path):
    write_curve(tmp_path / "parallel.csv", Curve([0.05, 0.1, 0.15, 0.2, 0.25], [1.0, 2.0, 3.1, 4.2, 5.3]))
    plain = read_case(tiny_case(tmp_path))
    uncertain = read_case(tiny_case(tmp_path), ["fit.uncertain.friction={uniform=[0,1]}"])
    for law in ("neo_hookean", "ogden"):
        assert not law_case(plain, law, 1.0, {}).fit.profiles
        there = law_case(uncertain, law, 1.0, {})
        assert there.fit.profiles and there.fit.method == "ga" and widens(there, inverse_problem(there))


@quick
def test_an_error_of_the_mesh_explains_no_law_without_stiffness():
    problem = line()
    likelihood = unknown_noise(problem, 0.3).log_likelihood(np.outer([0.01, 1.0], 2.0 * DEPTHS))
    assert likelihood[1] > likelihood[0] + 3


@quick
def test_the_evidence_of_a_line_is_the_integral_over_its_slope():
    problem = line()
    noise, shape = unknown_noise(problem, 0.0), 2.0 * DEPTHS
    curves = PlainCurves(problem, None, shape, np.array([0.3]))

    def density(mu):
        return np.exp(noise.log_likelihood((mu / 2 * shape)[None])[0])

    right = quad(density, 1, 4, points=(1.9, 2.0, 2.1), limit=200)[0] / 3
    assert evidence(curves, noise, 0).log == pytest.approx(np.log(right), abs=0.03)


@quick
def test_the_evidence_without_the_error_of_the_mesh_comes_from_the_same_draws(monkeypatch):
    """The integral over the slope without the mesh, from draws with 5 % of it; and where draws would be too few, from new ones."""
    problem = line()
    with_mesh, exact = unknown_noise(problem, 0.05), unknown_noise(problem, 0.0)
    curves = PlainCurves(problem, None, 2.0 * DEPTHS, np.array([0.3]))

    def density(mu):
        return np.exp(exact.log_likelihood((mu * DEPTHS)[None])[0])

    right = np.log(quad(density, 1, 4, points=(1.9, 2.0, 2.1), limit=200)[0] / 3)
    known = evidence(curves, with_mesh, 0)
    assert abs(known.log - right) > 0.1
    for enough in (10, 1e9):
        monkeypatch.setattr("indentfit.inference.evidence.STILL_ENOUGH", enough)
        assert under_another_noise(known, curves, with_mesh, exact, 0) == pytest.approx(right, abs=0.03)


@quick
def test_a_range_ten_times_as_wide_costs_log_10_of_the_evidence():
    narrow = line()
    wide = InverseProblem(narrow.tests, narrow.start, {"mu": Range(start=2, min=0.5, max=30.5)}, "mu", 2.0)
    logs = [
        evidence(PlainCurves(each, None, 2.0 * DEPTHS, np.array([0.3])), unknown_noise(each, 0.0), 0).log for each in (narrow, wide)
    ]
    assert logs[0] - logs[1] == pytest.approx(np.log(10), abs=0.05)


class Idle(PlainCurves):
    """A line with a further coordinate, uniform over its range, on which nothing depends."""

    @property
    def size(self):
        return 2

    def log_prior(self, places):
        return np.where((places[:, 1] >= 0) & (places[:, 1] <= 1), super().log_prior(places[:, :1]), -np.inf)

    def scaled(self, places, target, weights):
        return np.column_stack([super().scaled(places[:, :1], target, weights), places[:, 1]])


@quick
def test_a_range_of_millions_beside_a_coordinate_that_is_open_costs_its_logarithm():
    """Standard deviations of 1e-8 and 0.3: such a covariance counted as singular, and `compare` ended as a bug."""
    narrow = line()
    wide = InverseProblem(narrow.tests, narrow.start, {"mu": Range(start=2, min=1, max=3e6 + 1)}, "mu", 2.0)
    whole = evidence(PlainCurves(narrow, None, 2.0 * DEPTHS, np.array([0.3])), unknown_noise(narrow, 0.0), 0).log
    idle = Idle(wide, None, 2.0 * DEPTHS, np.array([3e-7, 0.5]))
    assert whole - evidence(idle, unknown_noise(wide, 0.0), 0).log == pytest.approx(np.log(1e6), abs=0.1)


@quick
@pytest.mark.parametrize(
    ("given", "high"),
    [
        ({"mu": {"start": 2.0, "min": 0.01, "max": 1e4}}, 10.0),  # as `init` writes it; the curves ask for 2 kPa
        ({"young": {"start": 5.8, "min": 0.029, "max": 29000.0}}, 10.0),
        ({"mu": {"start": 2.0, "min": 1.0, "max": 4.0}}, 4.0),
        ({"mu": {"start": 200.0, "min": 100.0, "max": 1e4}}, 1e4),
    ],
)
def test_a_modulus_of_the_case_has_no_wider_range_than_those_of_other_laws(given, high, tmp_path):
    """Of a sharp punch and a curve that both follow alike, Ogden's law was preferred 566 to 1, for its narrower range."""
    write_curve(tmp_path / "parallel.csv", Curve([0.05, 0.1, 0.15, 0.2, 0.25], [1.0, 2.0, 3.1, 4.2, 5.3]))
    case = read_case(tiny_case(tmp_path, material={"poisson_ratio": 0.45, "parameters": given}))
    own = law_case(case, "neo_hookean", 2.0, {})
    assert own.free["mu"].max == pytest.approx(high)
    assert law_case(case, "ogden", 2.0, {}).free["mu"].max == 10.0
    kept = law_case(case, "neo_hookean", 2.0, {next(iter(given)): Range(start=2.9, min=0.01, max=5000.0)})
    assert kept.free["mu"].max == pytest.approx(5000 / 2.9 if "young" in given else 5000)


@quick
def test_the_deep_third_and_each_test_are_left_out():
    one = line()
    two = InverseProblem((*one.tests, Target("second", one.tests[0].curve, 1.0)), one.start, one.free, "mu", 2.0)
    parts = {name: (fitted, predicted) for name, fitted, predicted in parts_left_out(two)}
    assert list(parts) == [DEPTH, "press", "second"]
    fitted, predicted = parts[DEPTH]
    assert DEPTHS[fitted[0]].max() <= 2 / 3 < DEPTHS[predicted[0]].min()
    assert parts["press"][0][0].size == 0 and parts["press"][0][1].size == 6
    assert parts["press"][1][0].size == 6 and parts["press"][1][1].size == 0
    assert [name for name, _, _ in parts_left_out(one)] == [DEPTH]


@quick
def test_a_law_is_preferred_only_where_its_evidence_is_clearly_above_the_next():
    assert choose({"a": Weighed(-10, -10), "b": Weighed(-13.5, -13)}).preferred == "a"
    close = choose({"a": Weighed(-10, -10), "b": Weighed(-12.5, -12), "c": Weighed(-30, -30)})
    assert close.preferred is None and close.rivals == ("a", "b")
    assert "cannot tell a and b apart" in close.sentence and "mesh" not in close.sentence
    assert (
        "the simplest of them is b" in choose({"a": Weighed(-10, -10, parameters=3), "b": Weighed(-12, -12, parameters=1)}).sentence
    )
    by_mesh = choose({"a": Weighed(-10, -20), "b": Weighed(-10.5, -12)})
    assert (
        by_mesh.preferred is None and "the error of the mesh could explain" in by_mesh.sentence and "b by 8.0" in by_mesh.sentence
    )


@quick
def test_no_law_is_preferred_where_none_follows_the_curves_and_systematic_residuals_are_said():
    gross = choose({"a": Weighed(-10, -10, misfit=0.3), "b": Weighed(-50, -50, misfit=0.4)})
    assert gross.preferred is None and "none of these laws follows the curves" in gross.sentence and "30%" in gross.sentence
    assert "not listed" in choose({"a": Weighed(0, 0, systematic=True), "b": Weighed(-9, -9)}).sentence


@quick
def test_laws_are_separated_by_commas_outside_of_brackets():
    assert laws_asked("neo_hookean, mine.py:Mine,mu/2*(I1-3) ,f(a,b)") == ["neo_hookean", "mine.py:Mine", "mu/2*(I1-3)", "f(a,b)"]


@quick
def test_moduli_are_the_fewest_parameters_to_which_a_typed_energy_is_proportional_together():
    assert moduli_of(typed("mu/2*(I1-3)+mu*zeta*(I4-1)^2", ("mu", "zeta"))) == {"mu"}
    assert moduli_of(typed("a*(I1-3)+b*(I2-3)+a*c*(I1-3)^2", ("a", "b", "c"))) == {"a", "b"}
    assert moduli_of(load("holzapfel")) == {"c", "k1"}


@quick
@pytest.mark.parametrize("name", ["neo_hookean", "ogden", "ogden3", "holzapfel", "gent", "polynomial", "yeoh", "arruda_boyce"])
def test_automatic_ranges_are_admissible_and_moduli_follow_the_curves(name):
    law = load(name)
    for parameter, known in law.parameters.items():
        soft, stiff = (usual_range(law, parameter, modulus) for modulus in (1e-3, 1e3))
        for bounds in (soft, stiff):
            assert known.admitted(bounds.min, "min") < known.admitted(bounds.max, "max")
        assert (stiff.max == pytest.approx(1e6 * soft.max, rel=1e-5)) == (known.unit == "kPa")


@pytest.fixture(scope="module")
def gel(tmp_path_factory):
    """A tiny case whose curve a neo-Hookean gel of 2 kPa has made, with 1 % noise."""
    folder = tmp_path_factory.mktemp("gel")
    punch = {"shape": "cylinder", "width": None, "length": None, "diameter": 4.0}
    path = tiny_case(folder, indenter=punch, fit={"uncertain": {"mesh": 0.0}})
    curve = simulate(read_case(path, ["test.parallel.depth=0.4", "test.parallel.points=15"]), {"mu": 2.0}).tests[0].curve
    noise = 0.01 * curve.force.max() * np.random.default_rng(1).standard_normal(curve.force.size)
    write_curve(folder / "parallel.csv", Curve(curve.displacement, curve.force + noise))
    return path


def test_the_command_compares_laws_and_report_reads_its_folder(gel, tmp_path):
    asked = ["compare", str(gel), "--materials", "neo_hookean,demiray_fung,3*mu*(I2-3)", "-o", str(tmp_path / "laws")]
    done = CliRunner().invoke(main, asked)
    assert done.exit_code == 0, done.output
    value = json.loads((tmp_path / "laws" / "result.json").read_text())
    assert value["format"] == "indentfit.comparison/2"
    fitted = {law["law"]: law for law in value["laws"]}
    # the shear modulus of the curves is that of the gel; that of the typed energy is 6 mu
    assert value["modulus_kPa"] == pytest.approx(2.0, rel=0.02)
    assert fitted["neo_hookean"]["parameters"]["mu"]["value"] == pytest.approx(2.0, rel=0.02)
    assert fitted["3*mu*(I2-3)"]["parameters"]["mu"]["value"] == pytest.approx(2.0 / 6, rel=0.1)
    assert value["preferred"] in (None, "neo_hookean") and "neo_hookean" in value["rivals"]
    assert sum(law["probability"] for law in value["laws"]) == pytest.approx(1)
    assert fitted["neo_hookean"]["left_out"]["deep third"] < 0.03
    stored = read_result(tmp_path / "laws").result
    assert json.loads(json.dumps(stored.as_json())) == {name: value[name] for name in stored.as_json()}
    (tmp_path / "laws" / "report.html").unlink()
    assert CliRunner().invoke(main, ["report", str(tmp_path / "laws")]).exit_code == 0
    page = (tmp_path / "laws" / "report.html").read_text()
    assert "Log evidence" in page and "demiray_fung" in page


@pytest.mark.parametrize(
    ("materials", "said"),
    [
        (["neo_hookean"], "at least two"),
        (["neo_hookean", "no_such_law"], "law 'no_such_law'"),
        (["neo_hookean", "mu/2*(I1-3"], "cannot be read"),
    ],
)
def test_wrong_laws_are_refused_before_anything_is_solved(gel, materials, said):
    with pytest.raises(CaseError, match="(?s)" + said.replace("(", r"\(")):
        compare(read_case(gel), materials)


def test_a_range_of_an_unknown_law_or_parameter_is_refused(gel):
    case: Case = read_case(gel)
    bounds = Range(start=2, min=1, max=3)
    with pytest.raises(CaseError, match="not among the laws"):
        compare(case, ["neo_hookean", "ogden"], {"gent": {"Jm": bounds}})
    with pytest.raises(CaseError, match="no parameter 'Jm'"):
        compare(case, ["neo_hookean", "ogden"], {"ogden": {"Jm": bounds}})


class Bell:
    """Curves and noise in one, whose density is a normal one in units of the ranges: its integral is known."""

    size, sds, centre, top = 2, np.array([0.02, 0.05]), np.array([0.4, 0.7]), 3.0

    def log_prior(self, places):
        return np.zeros(len(places))

    def forces(self, places):
        return places

    def log_likelihood(self, places):
        return self.top - 0.5 * (((places - self.centre) / self.sds) ** 2).sum(axis=1)


@quick
def test_nested_sampling_finds_the_integral_of_a_normal_density(monkeypatch):
    """log (2 pi s1 s2) + top, within three standard errors, and the stated one is that of so few points."""
    pytest.importorskip("dynesty")
    monkeypatch.setattr("indentfit.inference.nested.FEWEST", 60)
    monkeypatch.setattr("indentfit.inference.nested.LIVE", 30)
    found = nested_evidence(Bell(), Bell(), 1)
    right = np.log(2 * np.pi * Bell.sds.prod()) + Bell.top
    assert abs(found.log - right) < 3 * found.error and 0.1 < found.error < 0.5


@pytest.mark.campaign
def test_nested_sampling_agrees_with_the_integral_over_a_slope_and_with_laplaces_method():
    pytest.importorskip("dynesty")
    problem = line()
    noise, curves = unknown_noise(problem, 0.0), PlainCurves(problem, None, 2.0 * DEPTHS, np.array([0.3]))

    def density(mu):
        return np.exp(noise.log_likelihood((mu * DEPTHS)[None])[0])

    right = np.log(quad(density, 1, 4, points=(1.9, 2.0, 2.1), limit=200)[0] / 3)
    found = nested_evidence(curves, noise, 0)
    assert found.error < 0.12 and abs(found.log - right) < 3 * found.error
    assert abs(found.log - evidence(curves, noise, 0).log) < 3 * found.error


@quick
def test_nested_sampling_without_dynesty_is_refused_in_one_line_before_any_run(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "dynesty", None)
    write_curve(tmp_path / "parallel.csv", Curve([0.05, 0.1, 0.15, 0.2, 0.25], [1.0, 2.0, 3.1, 4.2, 5.3]))
    asked = ["compare", str(tiny_case(tmp_path)), "--materials", "neo_hookean,ogden", "--nested", "-o", str(tmp_path / "laws")]
    done = CliRunner().invoke(main, asked)
    assert done.exit_code == 2 and "pip install 'indentfit[nested]'" in done.output and not (tmp_path / "laws").exists()
