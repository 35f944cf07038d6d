"""Uncertain inputs as coordinates of a fit: priors, the density over parameters and inputs, profiles, and mixtures."""

import html
import itertools
import json
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from fixtures.cases import SHARED, straight_curve, tiny_case, white_matter
from fixtures.formulas import FREE, TRUTH, formula, problem
from scipy.optimize import brentq
from scipy.stats import norm

from indentfit.case import Range
from indentfit.case.priors import Prior
from indentfit.curve import Curve, write_curve
from indentfit.errors import CaseError
from indentfit.experiment.measured import read_case
from indentfit.inference import joint, joint_consistency, mixture, wide_fit
from indentfit.inference.draws import drawn
from indentfit.inference.fit import fit
from indentfit.inference.inputs import Solution
from indentfit.inference.joint import ModelError
from indentfit.inference.joint_consistency import joint_predictions
from indentfit.inference.joint_profiles import JointPath, JointWalk, joint_profiles
from indentfit.inference.many_places import ManyPlaces, chi2_at, least_chi2
from indentfit.inference.posterior import Climber, Shift
from indentfit.inference.result import FitResult, ParameterEstimate
from indentfit.inference.shares import WhatIf
from indentfit.inference.what_if import fitted_again, taken_as_known, warnings_of, what_ifs
from indentfit.inverse import polynomials
from indentfit.inverse.course import Proof
from indentfit.inverse.exploration import Watched
from indentfit.inverse.objective import Target
from indentfit.inverse.problem import InverseProblem
from indentfit.inverse.progress import SILENT
from indentfit.inverse.surrogate import learn
from indentfit.inverse.wide import UncertainInput, alternatives, uncertain_inputs, widened_problem
from indentfit.report.fit_folder import write_fit
from indentfit.runs.forward import Evaluation, simulate

DEPTH = np.linspace(0.0132, 0.33, 25)
UNIFORM = Prior(uniform=(0, 1))


# Priors


@pytest.mark.parametrize(
    ("stated", "coordinate", "sd"),
    [
        ({"normal": [0.5, 0.1]}, 0.5, 0.1),
        ({"log_normal": [1000, 2]}, np.log(1000), 1000 * np.log(2)),
        ({"uniform": [0, 1]}, 0.5, 1 / np.sqrt(12)),
        ({"log_uniform": [20, 5000]}, np.log(np.sqrt(20 * 5000)), None),
    ],
)
def test_a_prior_has_the_centre_and_the_spread_of_its_distribution(stated, coordinate, sd):
    prior = Prior(**stated)
    assert prior.center == pytest.approx(coordinate)
    assert sd is None or prior.sd == pytest.approx(sd)
    low, high = (prior.coordinate(bound) for bound in prior.bounds())
    grid = np.linspace(low, high, 20001)
    density = np.exp([prior.log_density(x) for x in grid])
    assert np.trapezoid(density, grid) == pytest.approx(1, abs=1e-4)


@pytest.mark.parametrize(
    ("key", "said"),
    [
        ("friction={uniform=[1,0]}", "its first number must be below its second"),
        ("friction={uniform=[-1,1]}", "its first number must be at least 0"),
        ("friction={uniform=[0,1],normal=[0,1]}", "give one of normal"),
        ("offset={normal=[0,-1]}", "its standard deviation must be above 0"),
        ("size={start=2,min=1,max=3}", "must be a standard deviation or a prior"),
        ("friction={values=[0.3]}", "give 2 to 4 different values"),
        ("friction={values=[-0.1,0.3]}", "its first number must be at least 0"),
        ("offset={values=[0,0.01]}", "a list of alternatives is for friction, bulk_ratio, thickness and size"),
    ],
)
def test_a_prior_that_cannot_be_is_refused(key, said):
    with pytest.raises(CaseError, match=said):
        white_matter(f"fit.uncertain.{key}")


def test_a_list_of_alternatives_is_fitted_value_by_value_and_with_each_base():
    case = white_matter("fit.uncertain.friction={values=[0,0.5]}", "fit.uncertain.thickness={values=['3200 um',3.3]}")
    assert uncertain_inputs(case) == ()
    known = alternatives(case)
    assert [share for _, _, share in known] == [0.25] * 4
    assert known[0] == ("friction = 0.5, thickness = 3.3", {}, 0.25)  # the case itself
    assert ("friction = 0.0, thickness = 3.2", {"indenter.friction": 0.0, "sample.thickness": 3.2}, 0.25) in known
    both = alternatives(white_matter("fit.uncertain.friction={values=[0,0.5]}", "fit.uncertain.base=0.2"))
    assert {name: share for name, _, share in both}["base = bonded, friction = 0.0"] == pytest.approx(0.1)


def test_every_kind_of_input_becomes_a_coordinate_in_its_place():
    """A number is the standard deviation about the case's value; offset and gain belong to each test, and change no run."""
    case = white_matter(
        "fit.uncertain.friction={uniform=[0,1]}",
        "fit.uncertain.bulk_ratio={log_uniform=[20,5000]}",
        "fit.uncertain.thickness=0.1",
        'fit.uncertain.size={normal=[2,"20 um"]}',
        'fit.uncertain.offset={normal=[0,"10 um"]}',
        "fit.uncertain.force=0.02",
    )
    inputs = uncertain_inputs(case)
    assert [known.point for known in inputs] == ["friction", "bulk_ratio", "thickness", "indenter.width", "", "", "", ""]
    assert [known.test for known in inputs] == [None] * 4 + [0, 1, 0, 1]
    assert [known.prior.numbers for known in inputs[2:5]] == [(3.3, 0.1), (2.0, 0.02), (0.0, 0.01)]
    assert (inputs[2].low, inputs[2].high) == (pytest.approx(3.0), pytest.approx(3.6))


def test_a_cone_without_a_shaft_has_no_size_that_could_be_uncertain():
    """Every fit of a cone ended as a bug: the name of its missing size was taken apart."""
    cone = "indenter={shape='cone',half_angle=60,tip_radius=0.1,friction=0.3}"
    assert [known.point for known in uncertain_inputs(white_matter(cone, "fit.uncertain.thickness=0.1"))] == ["thickness"]
    assert len(alternatives(white_matter(cone))) == 1
    for size in ("0.1", "{values=[1,2]}"):
        with pytest.raises(CaseError, match=r"fit.uncertain.size = .*: the cone has no width or diameter that could be uncertain"):
            white_matter(cone, f"fit.uncertain.size={size}")


# Warps


def test_the_warps_of_inputs_are_what_they_say():
    """The reciprocal is linear in 1 / kappa, the clip is proportional below its place and flat above, and both can be inverted."""
    betas, u = np.array([-249.0, -0.4]), np.linspace(0, 1, 101)[:, None] * np.ones(2)
    t = polynomials.warp(u, betas)
    np.testing.assert_allclose(polynomials.unwarp(t, betas), u, atol=1e-9)
    inverse = 1 / (20 + 4980 * u[:, 0])
    line = np.polynomial.Polynomial.fit(inverse, t[:, 0], 1)
    np.testing.assert_allclose(line(inverse), t[:, 0], atol=1e-9)
    assert t[20, 1] == pytest.approx(-1 + 2 * 0.5, abs=0.01)  # half of the place where it ends
    assert t[80, 1] > 0.99
    step = 1e-6
    ahead = (polynomials.warp(u + step, betas) - polynomials.warp(u - step, betas)) / (2 * step)
    np.testing.assert_allclose(polynomials.stretch(u, betas), ahead, rtol=1e-4, atol=1e-6)


# The contact point


@pytest.mark.parametrize("offset", [0.02, -0.02])
@pytest.mark.parametrize("power", [1.0, 1.5, 2.0])
def test_a_shifted_curve_is_the_curve_of_the_shifted_depth(offset, power):
    """Punches, spheres and stiffening curves, past the last point too: to 2e-4 of the largest force."""
    moved, slope = Shift.of(DEPTH).by(offset)
    force = 30 * DEPTH**power
    exact = 30 * np.maximum(DEPTH - offset, 0) ** power
    assert np.abs(moved @ force - exact).max() < 2e-4 * force.max()
    ahead, behind = (30 * np.maximum(DEPTH - offset + step, 0) ** power for step in (-1e-6, 1e-6))
    inside = DEPTH - offset > 1e-3
    assert np.abs(slope @ force - (ahead - behind) / 2e-6)[inside].max() < 0.02 * np.abs(np.gradient(force, DEPTH)).max()


# Fits, on curves in closed form


class Press:
    """A forward model in closed form whose curve across the fibres grows with friction until the contact sticks."""

    def __init__(self):
        self.runs, self.failures = 0, []

    def differentiable(self):
        return frozenset()

    def evaluate(self, points, report=None, sensitivities=()):
        self.runs += 2 * len(points)
        return [Evaluation(dict(point), self.forces(**point), None, 0.0, ({}, {})) for point in points]

    @staticmethod
    def forces(mu, zeta, phi, friction=0.5, **_):
        along, across = formula(mu, zeta, phi)
        grown = friction / (1 + (friction / 0.4) ** 6) ** (1 / 6)
        return along, across * (1 + 0.9 * grown)


def friction_input(prior=UNIFORM):
    return UncertainInput("friction", "friction", None, prior, 0.5, *prior.bounds(0.0))


def of_test(name, n, sd):
    prior = Prior.about(0.0, sd)
    return UncertainInput(name, "", n, prior, 0.0, *prior.bounds())


def noisy(forces, noise, seed):
    rng = np.random.default_rng(seed)
    return tuple(force + noise * force.max() * rng.standard_normal(force.size) for force in forces)


def straight(forces, inputs=()):
    """An inverse problem of one curve a d + b d^2, and its joint fit."""

    class Line(Press):
        @staticmethod
        def forces(a, b, **_):
            return (a * DEPTH + b * DEPTH**2,)

    free = {name: Range(start=50, min=0, max=200) for name in "ab"}
    whole = InverseProblem((Target("t", Curve(DEPTH, forces), 1.0),), {"a": 50.0, "b": 50.0}, free, None)
    return joint.joint_fit(widened_problem(whole, inputs), inputs, Watched(Line()), ModelError.none(25), 0)


def test_without_inputs_the_intervals_are_those_of_linear_regression():
    rng = np.random.default_rng(3)
    design = np.column_stack([DEPTH, DEPTH**2])
    forces = design @ [90, 60] + 0.3 * rng.standard_normal(25)
    found = straight(forces)
    theta, squares, *_ = np.linalg.lstsq(design, forces, rcond=None)
    covar = np.linalg.inv(design.T @ design) * squares[0] / 23
    paths = joint_profiles(found)
    for n in range(2):
        assert 200 * found.mode.z[n] == pytest.approx(theta[n], rel=1e-4)
        half = np.sqrt(covar[n, n]) * 2.0687  # Student's t of 23 degrees of freedom
        assert 200 * np.array(paths[n].interval) == pytest.approx([theta[n] - half, theta[n] + half], rel=2e-2)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_smooth_noise_has_a_size_that_belongs_to_its_correlation(seed):
    """By restricted likelihood the squares of whitened residuals add up to the points less the parameters, 25 - 2, and the noise of
    0.3 mN with an autocorrelation of 0.7 is found to a factor of 2."""
    rng = np.random.default_rng(seed)
    root = np.linalg.cholesky(0.7 ** np.abs(np.subtract.outer(np.arange(25), np.arange(25))))
    found = straight(np.column_stack([DEPTH, DEPTH**2]) @ [90, 60] + 0.3 * root @ rng.standard_normal(25))
    assert found.mode.chi2 == pytest.approx(23, rel=0.1)
    assert 0.15 < found.posterior.noise.sigma[0] < 0.6


def test_a_gain_widens_a_parameter_by_its_own_share():
    """With (1 + gain) a d and a gain of 3 %, the standard error of a is sqrt(noise^2 + (3 % a)^2)."""
    rng = np.random.default_rng(3)
    design = np.column_stack([DEPTH, DEPTH**2])
    forces = design @ [90, 60] + 0.1 * rng.standard_normal(25)
    plain, wide = straight(forces), straight(forces, (of_test("force", 0, 0.03),))
    noise = 200 * np.sqrt(plain.mode.covar[0, 0])
    assert 200 * np.sqrt(wide.mode.covar[0, 0]) == pytest.approx(np.hypot(noise, 0.03 * 90), rel=0.03)
    low, high = 200 * np.array(joint_profiles(wide)[0].interval)
    assert high - low == pytest.approx(2 * wide.quantiles[0] * np.hypot(noise, 2.7), rel=0.06)


def pressed(friction, inputs, noise=0.01, seed=0):
    """The joint fit of the two curves of `Press` at TRUTH and a friction that the fit does not know."""
    forces = noisy(Press.forces(**TRUTH, friction=friction), noise, seed)
    whole = widened_problem(problem(forces), inputs)
    size = sum(force.size for force in forces)
    return joint.joint_fit(whole, inputs, Watched(Press()), ModelError.none(size), 0)


@pytest.mark.parametrize("friction", [0.0, 0.2, 0.9])
def test_a_friction_that_nobody_knows_is_inside_and_so_are_the_parameters(friction):
    """A fit that takes friction 0.5 for granted is wrong by a third in zeta where the truth is 0. With the prior, chi2 of the
    profile at each truth is below the 99.9 % quantile."""
    inputs = (friction_input(), of_test("offset", 0, 0.005), of_test("offset", 1, 0.005))
    found = pressed(friction, inputs)
    truth = [(TRUTH[name] - FREE[name].min) / (FREE[name].max - FREE[name].min) for name in TRUTH] + [friction]
    for n, unit in enumerate(truth):
        assert JointWalk(found, n).chi2(unit) < 10.83
    low, high = 20 * np.array(JointWalk(found, 1).profile().interval)
    assert high - low < 9  # not merely the whole range of 20


LOGARITHMIC = Prior(log_uniform=(0.05, 1.0))


@pytest.mark.parametrize("prior", [UNIFORM, LOGARITHMIC])
def test_curves_and_searches_at_many_places_are_those_at_each(prior):
    inputs = (friction_input(prior), of_test("offset", 0, 0.005), of_test("force", 1, 0.03))
    found = pressed(0.4, inputs)
    curves, climber, many = found.posterior.curves, Climber(found.posterior), ManyPlaces(found.posterior.curves)
    z = np.random.default_rng(1).uniform(0.1, 0.9, (6, curves.size))
    forces, slopes = (np.array(rows) for rows in zip(*map(curves.at, z), strict=True))
    np.testing.assert_allclose(many.forces(z), forces, rtol=1e-12)
    np.testing.assert_allclose(many.slopes(z), slopes, rtol=0, atol=1e-11 * np.abs(slopes).max())
    np.testing.assert_allclose(chi2_at(climber, z), [np.sum(climber.residuals(place)[0] ** 2) for place in z], rtol=1e-9)
    starts = np.tile(found.mode.z, (3, 1))
    measured = curves.measured() * np.array([[1.0], [1.02], [0.95]])
    singly = []
    for row in measured:
        climber.y = row[climber.rows]
        singly.append(climber.climb(found.mode.z)[1])
    np.testing.assert_allclose(least_chi2(climber, starts, measured[:, climber.rows]), singly, atol=5e-3)


def test_an_optimum_that_the_runs_at_ends_move_is_proved_where_it_is_now(monkeypatch):
    """A typed Fung law ended as "not proved": the runs at the ends of its profiles moved the optimum, and no run followed."""
    model = Watched(Press())
    whole = widened_problem(problem(noisy(Press.forces(**TRUTH), 0.01, 0)), ())
    found = joint.joint_fit(whole, (), model, ModelError.none(2 * 15), 0)
    elsewhere = replace(found, proofs=(Proof({**found.proofs[-1].parameters, "zeta": 15.0}, 0.0, 1.0),))
    assert found.reached and not elsewhere.reached
    monkeypatch.setattr(wide_fit, "_again", lambda *_: elsewhere)
    paths = joint_profiles(found)
    known = wide_fit.WideAlternative("", {}, 1.0, found, paths, drawn(found, 0))
    fit = wide_fit._ends_proved(known, [(1, paths[1].ends()[0])], model, 0, SILENT).fit
    assert fit.reached and len(fit.proofs) > 1
    assert fit.proofs[-1].parameters["zeta"] == pytest.approx(20 * fit.mode.z[1], rel=0.1)


def test_an_optimum_is_beaten_by_a_run_that_is_much_nearer_to_the_points():
    """Ogden's law as a file had the value of 0.5 % of misfit, where runs of the same search had 0.1 % and the best place 0.02 %."""
    fit = straight(np.column_stack([DEPTH, DEPTH**2]) @ [90, 60] + 0.3 * np.random.default_rng(3).standard_normal(25))
    elsewhere = replace(fit, mode=replace(fit.mode, z=fit.mode.z + np.array([0.05, 0.0])))
    assert not joint.beaten(fit) and joint.beaten(elsewhere)


class Stiffer(Press):
    """(1 + stiffness) a d + b d^2, where stiffness is an input that a list names."""

    @staticmethod
    def forces(a, b, stiffness=0.0, **_):
        return ((1 + stiffness) * a * DEPTH + b * DEPTH**2,)


@pytest.mark.parametrize("stiffness", [0.5, 1.0])
def test_alternatives_of_an_input_do_not_share_their_runs(stiffness):
    """With runs of both of two values that are not the case's own in one surrogate, a came out as 0."""
    force = np.column_stack([DEPTH, DEPTH**2]) @ [90, 60] + 0.3 * np.random.default_rng(3).standard_normal(25)
    free = {name: Range(start=50, min=0, max=200) for name in "ab"}
    model = Watched(Stiffer())
    for value in (1.5 - stiffness, stiffness):
        start = {"a": 50.0, "b": 50.0, "stiffness": value}
        whole = widened_problem(InverseProblem((Target("t", Curve(DEPTH, force), 1.0),), start, free, None), ())
        fit = joint.joint_fit(whole, (), model, ModelError.none(25), 0)
    assert fit.reached and fit.surrogate.error < 1e-6
    assert 200 * fit.mode.z[0] == pytest.approx(90 / (1 + stiffness), rel=0.03)


# Tests against each other


class Pair(Press):
    """Two tests of one sample, a d + b d^2 each."""

    @staticmethod
    def forces(a, b, **_):
        return (a * DEPTH + b * DEPTH**2,) * 2


def predicted(share):
    """What `joint_predictions` says of two curves with gains of 3 %, the second of which is stiffer by a share."""
    rng = np.random.default_rng(5)
    forces = [factor * Pair.forces(90, 60)[0] + 0.3 * rng.standard_normal(25) for factor in (1, 1 + share)]
    tests = tuple(Target(name, Curve(DEPTH, force), 0.5) for name, force in zip("st", forces, strict=True))
    inputs = (of_test("force", 0, 0.03), of_test("force", 1, 0.03))
    free = {name: Range(start=50, min=0, max=200) for name in "ab"}
    whole = widened_problem(InverseProblem(tests, {"a": 50.0, "b": 50.0}, free, None), inputs)
    found = joint.joint_fit(whole, inputs, Watched(Pair()), ModelError.none(50), 0)
    alone = [joint.fitted(whole, inputs, found.surrogate, found.error, 0, [k == n for k in range(2)]) for n in range(2)]
    return joint_predictions(found, alone, 0)


def test_tests_contradict_each_other_beyond_their_own_gains():
    """Two gains of 3 % differ by 4.2 %: a second curve may be 6 % stiffer, and cannot be 30 % stiffer."""
    assert not any(known.contradicts for known in predicted(0.06).values())
    found = predicted(0.3)
    assert all(known.contradicts for known in found.values())
    assert found["t"].off == pytest.approx(0.3, abs=0.06)
    assert found["s"].off == pytest.approx(1 / 1.3 - 1, abs=0.06)


def test_tests_contradict_each_other_also_where_derivatives_at_the_optimum_show_nothing_that_they_share(monkeypatch):
    """White matter with unknown friction: one line asked for half of the other's mu, and p was 1, since at the optimum (phi
    at its bound, friction 1) the tests saw one and two directions and both together three."""
    ranks = itertools.cycle([1, 2, 3])
    monkeypatch.setattr(joint_consistency, "_rank", lambda _: next(ranks))
    assert not any(known.contradicts for known in predicted(0.06).values())
    assert all(known.contradicts for known in predicted(0.3).values())


# Mixtures


def normal_path(mean, sd):
    units = np.linspace(max(mean - 5 * sd, 0), min(mean + 5 * sd, 1), 801)
    chi2 = ((units - mean) / sd) ** 2
    return JointPath(units, chi2, 1.959964**2, (mean - 1.96 * sd, mean + 1.96 * sd), units[:, None])


def test_the_interval_of_a_mixture_is_the_smallest_set_of_95_percent():
    """Two normal densities of equal width, 0.7 and 0.3: by the density at which 95 % are inside, by SciPy."""
    shares = np.array([0.7, 0.3])

    def inside(level):
        reach = [0.02 * np.sqrt(max(-2 * np.log(level / share), 0)) for share in shares]
        return sum(share * (2 * norm.cdf(r / 0.02) - 1) for share, r in zip(shares, reach, strict=True)) - 0.95

    level = brentq(inside, 1e-4, 0.29)
    reach = [0.02 * np.sqrt(-2 * np.log(level / share)) for share in shares]
    found = mixture.pieces([normal_path(0.3, 0.02), normal_path(0.7, 0.02)], shares)
    np.testing.assert_allclose(found, [(0.3 - reach[0], 0.3 + reach[0]), (0.7 - reach[1], 0.7 + reach[1])], atol=5e-4)


def test_overlapping_alternatives_are_one_piece_and_a_certain_one_stands_alone():
    paths = [normal_path(0.5, 0.05), normal_path(0.55, 0.05)]
    assert len(mixture.pieces(paths, np.array([0.5, 0.5]))) == 1
    assert mixture.pieces(paths, np.array([0.995, 0.005])) == (paths[0].interval,)


def test_probabilities_follow_from_prior_and_evidence():
    assert mixture.probabilities([0.2, 0.8], [np.log(6.0), np.log(1.0)]) == pytest.approx([0.6, 0.4])


# A whole fit


@pytest.fixture(scope="module")
def unknown_base(tmp_path_factory):
    """The fit of mu = 1.5 from one curve that the forward model made on a bonded base, where the case knows neither base nor
    friction, with 0.5 % noise on a very coarse mesh."""
    folder = tmp_path_factory.mktemp("unknown")
    path = tiny_case(
        folder,
        sample={"base": "bonded"},
        test=[{"name": "parallel", "angle": 0, "depth": 0.3, "points": 12}],
        material={"model": "neo_hookean", "parameters": {"mu": 1.5}},
    )
    made = simulate(read_case(path)).tests[0]
    force = noisy([made.force], 0.005, 0)[0]
    write_curve(folder / "parallel.csv", Curve(made.displacement, force))
    unknown = {"base": "unknown"}, {"friction": "unknown"}
    tiny_case(folder, sample=unknown[0], indenter=unknown[1], fit={"method": "ga", "uncertain": {"mesh": 0.0}})
    return fit(read_case(path))


def test_a_base_that_nobody_knows_gives_both_answers_and_holds_the_truth(unknown_base):
    """On one curve of a gel the base and mu are exchangeable: the force is 45 % larger on a bonded base, so both are answers."""
    mu = unknown_base.parameters["mu"]
    assert any(low <= 1.5 <= high for low, high in mu.pieces or (mu.interval,))
    found = {tried.name: tried for tried in unknown_base.uncertain.alternatives}
    assert sum(tried.probability for tried in found.values()) == pytest.approx(1)
    low, high = found["base = bonded"].intervals["mu"]
    assert low <= 1.5 <= high
    assert found["base = sliding"].parameters["mu"] > 1.8
    assert not mu.verdict.startswith("determined") or low <= mu.value <= high


def test_standard_errors_are_those_of_the_draws(unknown_base):
    """An interval of 95 % is 2 to 6 deviations wide. The linearisation at the optimum said 15 times half of an interval where an
    input sat at the end of its prior."""
    for name in unknown_base.free:
        known = unknown_base.parameters[name]
        low, high = known.interval
        assert known.stderr <= known.stderr_total and 2 < (high - low) / known.stderr_total < 6


def test_the_result_of_uncertain_inputs_is_written_and_read_back(unknown_base):
    again = FitResult.from_json(json.loads(json.dumps(unknown_base.as_json())))
    assert again.uncertain == unknown_base.uncertain
    text = unknown_base.summary()
    assert "base = bonded, probability" in text
    assert "friction (prior 0 to 1; fitted" in text


def test_the_methods_of_a_joint_fit_are_those_of_a_joint_fit(unknown_base, tmp_path):
    """Not profile likelihoods at a known friction, which the paragraph named until a newcomer's case showed it."""
    write_fit(unknown_base, tmp_path / "out", fields=False)
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    methods = " ".join(html.unescape(re.sub("<[^>]+>", "", page[page.index("Methods, ready to paste</h2>") :])).split())
    assert "a joint search over the parameters and friction" in methods
    assert "friction, 0 to 1" in methods and "base = bonded, probability" in methods
    assert "smallest sets that hold 95 % of the posterior" in methods
    assert "profile likelihood" not in methods


def unproved(tmp_path, monkeypatch, **fitted):
    """The result of a fit to one curve whose optimum no run proves: a prediction never counts as right, a search always moves."""
    monkeypatch.setattr(joint, "RIGHT", 0.0)
    monkeypatch.setattr(joint, "FINEST", 0.0)
    monkeypatch.setattr("indentfit.inference.wide_fit.LIMIT", 1)
    monkeypatch.setattr("indentfit.inverse.polish.STEPS", 0)
    monkeypatch.setattr("indentfit.inverse.least_squares.EVALUATIONS", 0)
    straight_curve(tmp_path / "parallel.csv", 30)
    return fit(read_case(tiny_case(tmp_path, fit=fitted)))


@pytest.mark.parametrize(
    "fitted",
    [
        {"method": "least_squares"},
        {"method": "ga"},
        {"method": "ga", "uncertain": {"friction": {"uniform": [0, 1]}, "mesh": 0.0}},
        {"method": "ga", "uncertain": {"base": 0.5, "mesh": 0.0}},
        {"method": "ga", "uncertain": {"offset": 0.01}},
    ],
)
def test_no_parameter_is_determined_where_no_run_proves_the_optimum(fitted, tmp_path, monkeypatch):
    found = unproved(tmp_path, monkeypatch, **fitted)
    mu = found.parameters["mu"]
    assert not found.success
    assert mu.verdict is not None and mu.verdict.startswith("not determined: the search did not end at a proved optimum")
    assert mu.limited_by == "search"
    assert not [said for said in found.conclusions if said.startswith(("determined", "weakly"))]
    assert not [line for line in found.summary().splitlines() if "mu" in line and " determined (" in line]


@pytest.mark.skipif(not (SHARED / "strangers").exists(), reason="the strangers' cases are not here")
def test_a_curve_without_noise_does_not_tell_a_friction_by_the_waves_of_the_computed_curves(tmp_path):
    """The curve is Hayes' exact one (bonded layer, no friction, nu = 0.3) for mu = 200 kPa, and friction 1 would give 194."""
    case = SHARED / "strangers" / "cartilage_punch" / "case.toml"
    found = fit(read_case(case, ["indenter.friction=unknown", "fit.workers=1"]))
    low, high = found.parameters["mu"].interval
    assert found.success
    assert 193 < low < 195.5 and 199.5 < high < 203
    assert found.parameters["mu"].limited_by == "friction"
    assert found.uncertain.inputs["friction"].interval == pytest.approx((0, 1))


# What a case takes as known


def test_an_input_taken_as_known_has_the_parameters_of_its_other_value():
    """Curves that are exact at mu = 1.5, and whose model has 20 % less force at the other friction: there mu is 1.5 / 0.8, exactly,
    since the force is proportional to mu."""
    whole = problem(noisy(formula(**TRUTH), 1e-4, 0))
    model = Watched(Softer())
    places = [{**TRUTH, "zeta": zeta, "phi": phi, "mu": 1.0} for zeta in np.linspace(0, 20, 8) for phi in np.linspace(0, 5, 6)]
    surrogate = learn(whole, model.evaluate(places))
    best = whole.judge(TRUTH, formula(**{**TRUTH, "mu": 1.0}))
    known = SimpleNamespace(weights=[1.0, 1.0])
    case = white_matter()
    solution = Solution(case, whole, model, best, known)
    found = {tried.input: tried for tried in what_ifs(solution, fitted_again(solution, surrogate), ran=True)}
    assert found["friction"].parameters["mu"] == pytest.approx(1.5 / 0.8, rel=2e-3)
    assert found["friction"].parameters["zeta"] == pytest.approx(4, rel=0.02)
    assert found["base"].parameters["mu"] == pytest.approx(1.5, rel=2e-3)
    assert found["offset"].parameters["mu"] > 1.52  # a later contact asks for a stiffer material
    mu = ParameterEstimate(1.5, "kPa", interval=(1.45, 1.55), verdict="determined (+-3 %); limited by the noise")
    (said,) = warnings_of(tuple(found.values()), {"mu": mu})
    assert said.startswith("taken as known are friction 0.5, force as measured, offset 0 mm, and")
    assert f"mu {found['friction'].parameters['mu']:.3g} with friction 0.2" in said and "base" not in said
    (alone,) = warnings_of((found["base"], found["friction"]), {"mu": mu})
    assert alone.startswith("taken as known is friction 0.5, and") and f"mu {found['friction'].parameters['mu']:.3g}" in alone


def test_of_many_inputs_taken_as_known_those_that_move_most_are_named():
    mu = ParameterEstimate(1.5, "kPa", interval=(1.45, 1.55), verdict="determined (+-3 %); limited by the noise")
    moved = {"friction": 1.56, "base": 2.0, "thickness": 1.2, "offset": 1.7, "force": 1.58, "law": 1.5}
    known = tuple(WhatIf(name, "here", f"there {name}", {"mu": value}) for name, value in moved.items())
    (said,) = warnings_of(known, {"mu": mu})
    assert "mu 2 with base there base; mu 1.2 with thickness there thickness; mu 1.7 with offset there offset, outside" in said
    assert said.endswith("; 2 more inputs would do so, listed below") and "friction" not in said and "law" not in said
    twice = WhatIf("base", "here", "elsewhere", {"mu": 1.57})  # an input that is named already
    (said,) = warnings_of((*known[:4], twice), {"mu": mu})
    assert said.endswith("; 1 more input would do so, listed below")
    assert warnings_of((*known[1:4], twice), {"mu": mu}).__next__().endswith("outside of the intervals")


def test_a_bulk_ratio_taken_as_known_is_told_in_the_word_of_the_case(tmp_path):
    straight_curve(tmp_path / "parallel.csv", 30)
    gel = read_case(tiny_case(tmp_path, material={"poisson_ratio": 0.45}))
    below, above = (tried for tried in taken_as_known(gel) if tried.input == "bulk_ratio")
    assert (below.taken, below.other) == ("9.66667 (Poisson's ratio 0.45)", "3 (Poisson's ratio 0.35)")
    assert (above.taken, above.other) == (below.taken, "50 (Poisson's ratio 0.4901)")


@pytest.mark.parametrize("ratio, others", [(0.0, ["0.1"]), (0.3, ["0.2", "0.4"]), (0.48, ["0.4995"]), (0.5, ["0.4901"])])
def test_poisson_ratios_that_are_tried_are_neighbours_of_one_that_is_far_from_incompressible(tmp_path, ratio, others):
    straight_curve(tmp_path / "parallel.csv", 30)
    gel = read_case(tiny_case(tmp_path, material={"poisson_ratio": ratio}))
    tried = [known.other for known in taken_as_known(gel) if known.input == "bulk_ratio"]
    assert [words.rpartition(" ")[2].rstrip(")") for words in tried] == others


def test_a_fit_over_an_unknown_friction_says_what_the_other_base_would_give(tmp_path):
    """A fit that states the other base, and the friction that was found, is the oracle."""
    straight_curve(tmp_path / "parallel.csv", 30)
    friction = {"friction": {"uniform": [0, 1]}}
    here = fit(read_case(tiny_case(tmp_path, fit={"method": "ga", "uncertain": {**friction, "mesh": 0.0}})))
    stated = ["sample.base=bonded", f"indenter.friction={here.uncertain.at['friction']}"]
    there = fit(read_case(tiny_case(tmp_path, fit={"method": "ga", "uncertain": {"mesh": 0.0}}), stated))
    tried = {known.input: known for known in here.taken_as_known}
    assert set(tried) == {"base", "bulk_ratio", "thickness", "size", "force", "offset", "law"}
    assert tried["base"].parameters["mu"] == pytest.approx(there.parameters["mu"].value, rel=0.03)
    assert any("base sliding" in said and "bonded" in said for said in here.conclusions)


class Softer(Press):
    """`formula`, with 20 % less force at the other friction."""

    @staticmethod
    def forces(mu, zeta, phi, **changes):
        return tuple((0.8 if "indenter.friction" in changes else 1.0) * force for force in formula(mu, zeta, phi))
