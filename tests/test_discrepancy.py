"""The law's own misfit as a term of a fit: its covariance, the posterior under it, and what it makes of a curve of another law."""

import json

import numpy as np
import pytest
from click.testing import CliRunner
from fixtures.cases import CASES
from scipy.linalg import cho_solve
from scipy.optimize import brentq
from scipy.stats import norm

import indentfit
from indentfit.case import Case, Fit, Indenter, MaterialChoice, Mesh, Range, Sample, Test, write_case
from indentfit.case.search import SCALES, Discrepancy
from indentfit.cli import main
from indentfit.curve import Curve
from indentfit.errors import CaseError
from indentfit.inference import joint
from indentfit.inference.bridge import over_u
from indentfit.inference.density import Density
from indentfit.inference.discrepancy import LawError, law_error
from indentfit.inference.draws import drawn
from indentfit.inference.fit import fit
from indentfit.inference.joint import ModelError
from indentfit.inference.law_misfit import LawMisfit, PosteriorDraws
from indentfit.inference.noise import SLAB, WHITE
from indentfit.inference.posterior import FINEST
from indentfit.inference.quantiles import normal_quantiles
from indentfit.inference.result import FitResult
from indentfit.inference.sampling import _starts
from indentfit.inverse.exploration import Watched
from indentfit.inverse.objective import Target
from indentfit.inverse.problem import InverseProblem
from indentfit.report.law_plot import law_misfits
from indentfit.report.prediction import prediction_lines
from indentfit.runs.forward import Evaluation
from indentfit.study.predict import PredictedTest, Prediction, _Beside, _continued, predict, strain_of

DEPTH = np.linspace(0.02, 0.4, 20)
STRAIN = np.linspace(0.004, 0.08, 20)
TRUTH = 2.0  # shear modulus of the curve of another law


class Proportional:
    """A forward model in closed form: a d^1.5."""

    runs, failures = 0, ()

    def differentiable(self):
        return frozenset()

    def evaluate(self, points, report=None, sensitivities=()):
        return [Evaluation(dict(p), (p["a"] * DEPTH**1.5,), None, 0.0, ({},)) for p in points]


def pressed(shape, depth=DEPTH, scale=0.1, length=0.5):
    sizes = {"half_angle": 70} if shape == "cone" else {"radius": 1.0} if shape == "sphere" else {"diameter": 1.0}
    curve = Curve(depth, 5 * depth**1.5)
    case = Case(
        sample=Sample(shape="disc", diameter=20.0, thickness=5.0, base="bonded"),
        indenter=Indenter(shape=shape, friction=0.0, **sizes),
        mesh=Mesh(),
        material=MaterialChoice(model="neo_hookean", parameters={"mu": Range(start=1.0, min=0.1, max=10.0)}, bulk_ratio=1000.0),
        tests=[Test("press", curve=curve)],
        fit=Fit(discrepancy=Discrepancy(scale=scale, length=length)),
    )
    return case, (Target("press", curve, 1.0),)


@pytest.mark.parametrize(("shape", "power"), [("cylinder", 1.0), ("sphere", 0.5), ("cone", 0.0)])
def test_the_misfit_grows_as_the_strains_under_the_indenter_do(shape, power):
    """Strains go as depth over contact width: d, d / d^1/2 and d / d under a flat face, a sphere and a cone."""
    error = law_error(*pressed(shape))
    relative = np.sqrt(np.diag(error.covar)) / (5 * DEPTH**1.5)
    assert relative[-1] == pytest.approx(0.1, rel=1e-6)
    assert relative == pytest.approx(0.1 * (DEPTH / 0.4) ** power, rel=1e-3)


def test_half_of_the_misfit_goes_on_and_half_is_correlated_by_a_gaussian():
    """Points half of the largest depth apart; depths in um state the same as in mm: lengths are shares of the largest depth."""
    for depth in (DEPTH, DEPTH * 1e-3):
        covar = law_error(*pressed("cylinder", depth, length=0.5)).covar
        assert covar[-1, 9] / np.sqrt(covar[-1, -1] * covar[9, 9]) == pytest.approx(0.5 + 0.5 * np.exp(-0.5), rel=1e-3)


def exact(force, roots, scales):
    """Mean and standard deviation of a, over grids of the noise's size and correlation and of the scale, each given which a is
    normal: generalised least squares of a line under their covariance."""
    design, most = DEPTH**1.5, np.abs(force).max()
    steps = np.abs(np.subtract.outer(np.arange(20), np.arange(20)))
    parts = []
    for n, rho in enumerate([0.0, *(1 - (1 - np.exp(-1 / 20)) ** ((np.arange(SLAB) + 0.5) / SLAB))]):
        for sigma in most * np.exp(np.linspace(np.log(FINEST), 0, 60)):
            for scale in scales:
                L = np.linalg.cholesky(sigma**2 * rho**steps + scale**2 * roots @ roots.T)
                weighted = cho_solve((L, True), np.column_stack([design, force]))
                known = design @ weighted[:, 0]
                mean = design @ weighted[:, 1] / known
                squares = force @ weighted[:, 1] - mean**2 * known
                prior = (1 - WHITE) / SLAB if n else WHITE
                parts.append((np.log(prior) - squares / 2 - np.log(np.diag(L)).sum() - np.log(known) / 2, mean, 1 / known))
    log, mean, variance = np.array(parts).T
    shares = np.exp(log - log.max())
    shares /= shares.sum()
    middle = shares @ mean
    return middle, np.sqrt(shares @ (variance + (mean - middle) ** 2))


@pytest.mark.parametrize("scale", [0.05, None], ids=["stated", "unknown"])
def test_the_posterior_is_that_of_generalised_least_squares(scale):
    force = 50 * DEPTH**1.5 * (1 + 0.1 * DEPTH / 0.4) + 0.05 * np.random.default_rng(2).standard_normal(20)
    problem = InverseProblem((Target("t", Curve(DEPTH, force), 1.0),), {"a": 40.0}, {"a": Range(start=40, min=0, max=200)}, None)
    roots = law_error(*pressed("cylinder")).roots * 10  # of forces ten times as large
    law = LawError(roots, scale or 0.02, None if scale else SCALES)
    known = joint.joint_fit(problem, (), Watched(Proportional()), ModelError.none(20, law), 0)
    draws = drawn(known, 0)
    density = Density(known)
    assert np.isfinite(over_u(density, _starts(density, draws, 40, np.random.default_rng(0)))).all()  # walkers of emcee begin there
    values = 200 * draws.places[:, 0]
    mean = draws.shares @ values
    middle, sd = exact(force, roots, [scale] if scale else np.linspace(*SCALES, 40))
    assert draws.enough
    assert mean == pytest.approx(middle, abs=0.1 * sd)
    assert np.sqrt(draws.shares @ (values - mean) ** 2) == pytest.approx(sd, rel=0.1)


def pulled(scale, **options):
    """A tension curve of Ogden's law with the exponent 8 (closed form), with 1 % noise, to be fitted by the neo-Hookean law."""
    stretch = 1 + STRAIN
    stress = 2 * TRUTH / 8 * (stretch**7 - stretch**-5)
    stress += 0.01 * stress.max() * np.random.default_rng(4).standard_normal(STRAIN.size)
    return Case(
        material=MaterialChoice(model="neo_hookean", parameters={"mu": Range(start=1.0, min=0.1, max=10.0)}, bulk_ratio=1e5),
        tests=[Test("pull", kind="uniaxial", loading="tension", curve=Curve(STRAIN, stress))],
        fit=Fit(discrepancy=Discrepancy(scale=scale) if scale else Discrepancy(), workers=1, **options),
    )


def test_a_curve_of_another_law_is_not_taken_for_a_wrong_modulus():
    """Without the term the neo-Hookean modulus is that of the stiffened curve, and narrow; with it the interval holds the modulus
    at small strain, and the misfit along the curve is what the two laws differ by. Of 18 such fits (20 and 60 points, noise of 0.2,
    1 and 2 %, three seeds) all hold it, and without the term none of the 12 of at least 1 %."""
    plain, with_term = fit(pulled(None)), fit(pulled("unknown"))
    low, high = plain.parameters["mu"].interval
    assert low > 1.02 * TRUTH
    low, high = with_term.parameters["mu"].interval
    assert low < TRUTH < high
    assert high - low < 0.3 * TRUTH
    assert with_term.parameters["mu"].limited_by == "misfit"
    band, stretch = with_term.law_misfit.tests["pull"], 1 + STRAIN
    difference = TRUTH * ((stretch**7 - stretch**-5) / 4 - (stretch - stretch**-2))
    assert ((difference > band.misfit_low) & (difference < band.misfit_high)).all()
    assert with_term.noise["pull"].white > 0.01  # what is left is noise
    truth = 2 * TRUTH / 8 * (stretch**7 - stretch**-5)
    inside = (truth > band.force_low) & (truth < band.force_high)
    assert inside.mean() > 0.85
    assert "as stated" not in with_term.summary()


def test_where_few_points_tell_the_noise_the_interval_is_still_that_of_the_misfit():
    """Seven points with a noise of 0.1 %, which leaves mu uncertain by less than that, in an interval ten times as wide. With the
    quantile of Student's t that seven points would have without the misfit, the share of the noise was 0.26."""
    case = pulled("unknown")
    strain = np.linspace(0.01, 0.07, 7)
    stress = 2 * TRUTH / 8 * ((1 + strain) ** 7 - (1 + strain) ** -5)
    few = Curve(strain, stress + 1e-3 * stress.max() * np.random.default_rng(0).standard_normal(7), axes=case.curves[0].axes)
    result = fit(case.model_copy(update={"curves": (few,)}))
    known = result.parameters["mu"]
    assert known.total > 0.005 * known.value
    assert result.uncertain.noise.share["mu"] < 0.05
    assert result.uncertain.inputs["discrepancy"].share["mu"] > 0.9


def test_a_curve_of_the_law_itself_has_a_small_misfit():
    case, stretch = pulled("unknown"), 1 + STRAIN
    force = TRUTH * (stretch - stretch**-2)
    force += 0.002 * force.max() * np.random.default_rng(4).standard_normal(STRAIN.size)
    result = fit(case.model_copy(update={"curves": (Curve(STRAIN, force, axes=case.curves[0].axes),)}))
    low, high = result.parameters["mu"].interval
    assert low < TRUTH < high
    assert result.law_misfit.scale < 0.02


@pytest.mark.parametrize(
    ("key", "said"),
    [
        ("fit.method=least_squares", "fit.discrepancy.scale = 0.02: the law's misfit acts in fits on surrogates; give fit.method"),
        ("fit.discrepancy.scale=2", "must be a share of the force, above 0 and below 1"),
        ("fit.discrepancy.length=0", "fit.discrepancy.length = 0: must be at least 0.05"),
    ],
)
def test_what_the_term_cannot_do_is_refused(tmp_path, key, said):
    write_case(pulled(0.02), tmp_path / "case")
    made = CliRunner().invoke(main, ["fit", str(tmp_path / "case" / "case.toml"), "--set", key])
    assert made.exit_code == 2
    assert said in " ".join(made.stderr.split())


def test_a_comparison_of_laws_refuses_the_term():
    from indentfit.study.compare import compare

    with pytest.raises(CaseError, match=r"fit.discrepancy.scale = 0.02: laws are compared by what they leave of the curves"):
        compare(pulled(0.02), ["neo_hookean", "ogden"])


def test_a_stored_result_keeps_the_bands():
    result = fit(pulled(0.1))
    stored = FitResult.from_json(json.loads(json.dumps(result.as_json())))
    assert stored.law_misfit == result.law_misfit
    assert "0.1, as stated" in stored.summary()
    panel, band = law_misfits(result).axes[0], result.law_misfit.tests["pull"]
    assert panel.lines[0].get_ydata() == pytest.approx(np.array(band.misfit))
    assert panel.get_ylabel() == "Beyond the law (kPa)"


def told(result, *sets):
    """The fitted case with some keys of its tests changed, without their curves."""
    pairs = zip(result.case.tests, sets, strict=True)
    tests = tuple(test.model_copy(update={"curve": None, "points": 8, **keys}) for test, keys in pairs)
    return result.case.model_copy(update={"tests": tests, "curves": tuple(None for _ in tests)})


def ogden(stretch):
    return 2 * TRUTH / 8 * (stretch**7 - stretch**-5)


@pytest.fixture(scope="module")
def by_another_law():
    return fit(pulled("unknown"))


def test_a_prediction_goes_on_from_the_fitted_curve(by_another_law):
    """Within the fitted strains it is the band of the result; at 0.096, a fifth beyond, it holds the force of the true law, and is
    wider. The law's own force is mu (l - l^-2)."""
    predicted = predict(by_another_law, told(by_another_law, {"strain": 0.096})).tests["pull"]
    strain, band = np.array(predicted.displacement), by_another_law.law_misfit.tests["pull"]
    truth, inner = ogden(1 + strain), strain < 0.08
    assert predicted.continued
    assert predicted.known_to == pytest.approx(0.08)
    lines = "\n".join(prediction_lines(Prediction("", {"pull": predicted}, 1, 0.0)))
    assert "beyond 0.08 no force of pull was fitted: this band is none of 95 %" in lines
    assert [line.endswith(" *") for line in lines.splitlines()[2:10]] == (strain > 0.0808).tolist()
    assert ((truth > predicted.low) & (truth < predicted.high)).all()
    force = np.interp(strain[inner], band.displacement, band.force)
    assert np.array(predicted.force)[inner] == pytest.approx(force, rel=0.01)
    widths = np.subtract(predicted.high, predicted.low)
    assert widths[-1] > 3 * widths[inner][-1]
    mu = np.mean([row[0] for row in by_another_law.law_misfit.draws.values])
    assert np.array(predicted.law) == pytest.approx(mu * ((1 + strain) - (1 + strain) ** -2), rel=2e-3)


def test_bands_are_quantiles_of_all_draws():
    """Of two normal densities, and of one that is skewed: by SciPy's root of their distribution function, and the lognormal's."""
    means, sds = np.array([[0.0], [3.0]]), np.array([[1.0], [0.2]])
    low, middle, high = (float(end[0]) for end in normal_quantiles(means, sds))
    for share, found in ((0.025, low), (0.5, middle), (0.975, high)):
        assert found == pytest.approx(
            brentq(lambda f, share=share: np.mean(norm.cdf(f, [0, 3], [1, 0.2])) - share, -9, 9), abs=1e-6
        )
    skewed = np.exp(0.5 * norm.ppf((np.arange(2000) + 0.5) / 2000))[:, None]
    low, middle, high = (float(end[0]) for end in normal_quantiles(skewed, 1e-3 * np.ones_like(skewed)))
    assert (low, middle, high) == pytest.approx(np.exp(0.5 * norm.ppf([0.025, 0.5, 0.975])), rel=5e-3)


def test_beyond_the_fitted_depth_half_of_the_misfits_go_on_and_none_is_called_95_percent():
    """A misfit that is known exactly and in proportion to the strain, 0.2 x: at twice the depth it is 0.4 where it goes on, and
    less where the half that changes bends back."""
    case, tests = pressed("cylinder")
    fitted = case.model_copy(update={"curves": (tests[0].curve,)})
    x = np.linspace(0.05, 1, 20)
    draws = PosteriorDraws(
        names=("mu",), values=((1.0,),), changes=({},), alternative=(0,), scale=(1e-6,), noise={"press": (0.0,)},
        places={"press": tuple(x)}, errors={"press": (tuple(0.2 * x),)},
    )  # fmt: skip
    deeper = case.model_copy(update={"tests": (case.tests[0].model_copy(update={"depth": 0.8, "points": 4}),), "curves": (None,)})
    beside = _Beside(LawMisfit(1e-6, None, 0.5, {}, draws), fitted, deeper, 0.0)
    misfit = _continued(
        deeper.tests[0], fitted.tests[0], np.array([0.2, 0.4, 0.6, 0.8]), beside, np.zeros(400, int), np.random.default_rng(0)
    )
    on = np.isclose(misfit[:, 3], 0.4, atol=2e-3)
    assert 0.4 < on.mean() < 0.6
    assert np.all(misfit[~on, 3] < 0.36)
    np.testing.assert_allclose(misfit[:, :2], np.tile([0.1, 0.2], (400, 1)), atol=1e-4)


def test_another_test_has_a_misfit_of_its_own_in_proportion_to_its_strains(by_another_law):
    """A stated scale of 0.1 at a strain of 0.08 is one of 0.05 at 0.04; the band is the square sum of misfit and modulus."""
    result = fit(pulled(0.1))
    for strain in (0.04, 0.08):
        predicted = predict(result, told(result, {"strain": strain, "name": "again"})).tests["again"]
        values = np.array([row[0] for row in result.law_misfit.draws.values])
        relative = np.hypot(values.std() / values.mean(), 0.1 * strain / 0.08)
        half = (predicted.high[-1] - predicted.low[-1]) / 2 / 1.96 / predicted.force[-1]
        assert not predicted.continued
        assert half == pytest.approx(relative, rel=0.15)  # of 400 draws


def test_a_sphere_of_half_the_radius_strains_the_root_of_two_times_as_much():
    case, _ = pressed("sphere")
    small = case.model_copy(update={"indenter": case.indenter.model_copy(update={"radius": 0.5})})
    ratio = strain_of(small, small.tests[0], 0.1) / strain_of(case, case.tests[0], 0.1)
    assert ratio == pytest.approx(np.sqrt(2), rel=0.1)  # the contact is not quite a parabola's


def test_a_predicted_table_says_its_units():
    """A punch of 60 um read 0.0032 and 0.003515 without any."""
    rows = {"displacement": (0.0016, 0.0032), "force": (1.7e-3, 3.515e-3), "low": (1.6e-3, 3.46e-3), "high": (1.8e-3, 3.57e-3)}
    test = PredictedTest(**rows, measured_low=(1.5e-3, 3.4e-3), measured_high=(1.9e-3, 3.6e-3), law=rows["force"], continued=True,
                         known_to=0.0016)  # fmt: skip
    _, head, first, last, amber, *_ = prediction_lines(Prediction("", {"punch": test}, 1, 0.0))
    assert head.split("  ")[0] == "displacement, um" and "force, uN" in head and "measured force, 95 %" in head
    assert first.split() == ["1.6", "1.7", "1.6", "to", "1.8", "1.5", "to", "1.9"]
    assert last.split() == ["3.2", "3.515", "3.46", "to", "3.57", "*", "3.4", "to", "3.6", "*"]
    assert "beyond 1.6 um no force of punch was fitted" in amber


def test_what_cannot_be_predicted_is_refused(by_another_law):
    with pytest.raises(CaseError, match=r"fit again with --set fit.discrepancy.scale=unknown"):
        predict(fit(pulled(None)), by_another_law.case)
    with pytest.raises(CaseError, match=r"test.pull.kind = 'shear': the fit knows the misfit of its law in uniaxial only"):
        predict(by_another_law, told(by_another_law, {"kind": "shear", "loading": None, "strain": 0.1}))


def test_the_command_predicts_a_deeper_test(tmp_path):
    write_case(pulled(0.05), tmp_path / "case")
    runner = CliRunner()
    out = tmp_path / "out"
    made = runner.invoke(main, ["fit", str(tmp_path / "case" / "case.toml"), "-o", str(out), "--no-fields"])
    assert made.exit_code == 0, made.output
    predicted = runner.invoke(main, ["predict", str(out), "--set", "test.pull.strain=0.09", "--json"])
    assert predicted.exit_code == 0, predicted.output
    assert json.loads(predicted.stdout)["tests"]["pull"]["displacement"][-1] == pytest.approx(0.09)


def test_an_empty_table_in_a_file_is_refused(tmp_path):
    """The fit would go on without the term that the table asks for."""
    text = (CASES / "hydrogel_sphere" / "case.toml").read_text()
    path = tmp_path / "case.toml"
    path.write_text(f"{text}\n[fit.discrepancy]\n")
    (tmp_path / "press.csv").write_text((CASES / "hydrogel_sphere" / "press.csv").read_text())
    with pytest.raises(CaseError, match=r"fit\.discrepancy = \{\}: the table states nothing; give scale = "):
        indentfit.read_case(path)
    assert indentfit.read_case(path, ["fit.discrepancy.length=0.4"]).fit.discrepancy.stated == "unknown"
