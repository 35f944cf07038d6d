"""What a fit says about its own certainty: errors under correlated noise, profiles, single tests, uncertain inputs."""

import json
from dataclasses import replace

import numpy as np
import pytest
from fixtures.cases import coarse_case, white_matter
from fixtures.formulas import FREE, TRUTH, Formula, bent, formula, problem
from scipy.optimize import least_squares as scipys
from scipy.stats import norm
from scipy.stats import t as student

from indentfit.case import Case, Fit, Indenter, Range, Sample, Test, Uncertain
from indentfit.curve import Curve
from indentfit.elastic import poisson_ratio
from indentfit.errors import CaseError
from indentfit.experiment.measured import read_case
from indentfit.fem.mesh import quarter
from indentfit.fem.mesh_error import second, smooth
from indentfit.fem.meshing import count
from indentfit.inference import certainty, inputs, profiles
from indentfit.inference.alone import alone, scan_weights
from indentfit.inference.bootstrap import bootstrap
from indentfit.inference.fit import fit
from indentfit.inference.identifiability import identifiability, notes_of, widened
from indentfit.inference.inputs import Solution
from indentfit.inference.noise import SLAB, WHITE, Correlated, correlations, effective, errors, fewest
from indentfit.inference.result import FitResult
from indentfit.inverse import genetic, methods
from indentfit.inverse.exploration import Watched, explore
from indentfit.inverse.least_squares import least_squares
from indentfit.inverse.objective import Target
from indentfit.inverse.polish import polish
from indentfit.inverse.problem import InverseProblem, inverse_problem
from indentfit.inverse.surrogate import learn, linearised
from indentfit.layer import Layer
from indentfit.report import fields
from indentfit.report.first_screen import doubts_of, next_step
from indentfit.report.solved import Solved
from indentfit.runs.forward import Evaluation, simulate
from indentfit.runs.points import setup_of
from indentfit.runs.pool import RunPool

D = np.linspace(0.1, 1, 25)
DESIGN = np.column_stack([D, D**2])


def test_the_correction_for_the_mesh_is_smooth_along_the_depth():
    """The elements that a growing contact passes make waves in the change from mesh to mesh; on spheres, corrections with the waves
    of the coarser mesh doubled the error. What does not wave is kept to the last digit, and so is the change of a few points."""
    depth, force = np.linspace(0.05, 1, 20), np.linspace(0.05, 1, 20) ** 1.5
    change = 0.02 - 0.01 * depth + 0.001 / depth
    np.testing.assert_allclose(smooth(depth, change, force), change, rtol=1e-10)
    waves = 0.005 * (-1.0) ** np.arange(20)
    left = smooth(depth, change + waves, force) - change
    assert np.linalg.norm(left * force) < 0.2 * np.linalg.norm(waves * force)
    np.testing.assert_array_equal(smooth(depth[:5], waves[:5], force[:5]), waves[:5])
    back = np.concatenate([depth, depth[::-1]])
    np.testing.assert_array_equal(smooth(back, back, back), back)


def share_inside(noises):
    """How often 95 % intervals of a straight and a square coefficient hold their truth, over draws of noise by test."""
    inside = []
    for noise in noises:
        slopes, weights = [DESIGN] * len(noise), [1.0] * len(noise)
        theta, *_ = np.linalg.lstsq(np.concatenate(slopes), np.concatenate(noise), rcond=None)
        _, found = errors(slopes, [DESIGN @ theta - draw for draw in noise], weights)
        half = np.sqrt(np.diag(found.covar)) * student.ppf(0.975, found.freedom)
        inside.append(np.abs(theta) <= half)
    return np.mean(inside, axis=0)


def test_intervals_hold_the_truth_under_white_noise_of_different_size():
    """One test is five times as noisy as the other; 400 draws, 95 % +- 3 %."""
    rng = np.random.default_rng(0)
    noises = [(rng.standard_normal(25), 5 * rng.standard_normal(25)) for _ in range(400)]
    assert np.all(np.abs(share_inside(noises) - 0.95) < 0.03)


def test_intervals_hold_the_truth_under_correlated_noise_where_independent_ones_do_not():
    """AR(1) with 0.7 between neighbours: independent errors would hold it in about 60 %."""
    rng, root = np.random.default_rng(0), np.linalg.cholesky(correlations(25, 0.7))
    noises = [tuple(root @ rng.standard_normal(25) for _ in range(2)) for _ in range(400)]
    assert np.all(share_inside(noises) > 0.88)
    plain = []
    for noise in noises:
        theta, squares, *_ = np.linalg.lstsq(np.concatenate([DESIGN] * 2), np.concatenate(noise), rcond=None)
        covar = np.linalg.inv(2 * DESIGN.T @ DESIGN) * squares[0] / 48
        plain.append(np.abs(theta) <= 2.01 * np.sqrt(np.diag(covar)))
    assert np.all(np.mean(plain, axis=0) < 0.8)


@pytest.mark.parametrize(("rho", "least"), [(0.0, 0.915), (0.5, 0.88)])
def test_intervals_of_few_points_hold_the_truth_whether_the_noise_is_correlated_or_not(rho, least):
    """15 points decide seldom whether they are correlated: a test of that left 79 to 90 of 100 inside under 0.5. 300 draws; white
    noise within the binomial 99 % band about 95 %. Under 0.5 some 92 % are inside, as white noise is the more probable before."""
    rng, root = np.random.default_rng(0), np.linalg.cholesky(correlations(15, rho))
    depth = np.linspace(0.02, 0.3, 15)
    design, inside = np.column_stack([depth, depth**2]), []
    for _ in range(300):
        noise = root @ rng.standard_normal(15)
        theta, *_ = np.linalg.lstsq(design, noise, rcond=None)
        _, known = errors([design], [design @ theta - noise], [1.0])
        inside.append(np.abs(theta) <= np.sqrt(np.diag(known.covar)) * student.ppf(0.975, known.freedom))
    assert (np.mean(inside, axis=0) > least).all()
    assert (np.mean(inside, axis=0) < 0.982).all()


def test_few_points_say_that_they_cannot_tell_their_correlation():
    """12 points of white noise look like 12 independent ones; a mean of 12 points correlated by 0.8 is worth
    1 / mean(0.8^|i - j|) = 2.0. Forty points tell."""
    rng = np.random.default_rng(5)
    told = {}
    for n in (12, 40):
        depth, noise = np.linspace(0, 1, n + 1)[1:], rng.standard_normal(n)
        (known,), _ = errors([depth[:, None]], [depth * (depth @ noise) / (depth @ depth) - noise], [1.0])
        told[n] = known
    assert (told[12].effective_points, told[40].effective_points) == (12, 40)
    assert 1 < told[12].fewest_points < 12 / 2
    assert told[40].fewest_points > 40 / 2
    (said,) = notes_of({"press": told[12], "pull": told[40]})
    assert said.startswith(
        "the 12 points of press cannot tell whether their noise is correlated: they look like 12 independent points"
    )
    assert effective(12, 0.8) == pytest.approx(1 / np.mean(0.8 ** np.abs(np.subtract.outer(np.arange(12), np.arange(12)))))
    assert fewest(12, np.array([0.0, 0.8, 0.9]), np.array([0.5, 0.46, 0.04])) == pytest.approx(effective(12, 0.8))


def test_the_probabilities_of_correlations_are_those_of_bayes_rule_for_a_line():
    """The density of a curve under each correlation, with the line's coefficients and the logarithm of the noise integrated out:
    whitened least squares, and determinants of the covariance and of the normal matrix."""
    force, logs = np.random.default_rng(5).standard_normal(25).cumsum(), []
    theta, *_ = np.linalg.lstsq(DESIGN, force, rcond=None)
    known = Correlated.of(DESIGN, DESIGN @ theta - force, 0.3)
    for n, rho in enumerate(known.rhos):
        R = rho ** np.abs(np.subtract.outer(np.arange(25), np.arange(25)))
        L = np.linalg.cholesky(R)
        design = np.linalg.solve(L, DESIGN)
        squares = np.linalg.lstsq(design, np.linalg.solve(L, force), rcond=None)[1][0]
        volume = np.linalg.slogdet(R)[1] + np.linalg.slogdet(design.T @ design)[1]
        logs.append(np.log((1 - WHITE) / SLAB if n else WHITE) - 0.5 * volume - 23 / 2 * np.log(squares))
    shares = np.exp(np.array(logs) - max(logs))
    assert known.shares == pytest.approx(shares / shares.sum(), rel=1e-6)


def test_the_autocorrelation_found_is_that_of_the_noise():
    """Median over 200 draws, although the fit takes the smoothest part of the noise away."""
    rng, root = np.random.default_rng(1), np.linalg.cholesky(correlations(25, 0.6))
    found = []
    for _ in range(200):
        noise = root @ rng.standard_normal(25)
        theta, *_ = np.linalg.lstsq(DESIGN, noise, rcond=None)
        found.append(errors([DESIGN], [DESIGN @ theta - noise], [1.0])[0][0].autocorrelation)
    assert np.median(found) == pytest.approx(0.6, abs=0.08)


# Profiles, on a model that is linear, where they must be what the linear theory says


class Line(Formula):
    """a d + b d^2; scatter: of each force, mN; more: of a term in b^2 d, mN/mm."""

    def __init__(self, broken=lambda point: False, scatter=0.0, more=0.0):
        super().__init__(broken)
        self.scatter, self.more, self.rng = scatter, more, np.random.default_rng(1)

    def evaluation(self, point):
        if self.broken(point):
            return Evaluation(point, None, "broken here", 0.0, ({},))
        force = (point["a"] + self.more * point["b"] ** 2) * D + point["b"] * D**2
        return Evaluation(point, (force + self.scatter * self.rng.standard_normal(D.size),), None, 0.0, ({},))


def line(noise, low=-40.0, high=60.0):
    free = {name: Range(start=1, min=low, max=high) for name in "ab"}
    curve = Curve(D, 30 * D + 20 * D**2 + noise)
    return InverseProblem((Target("t", curve, 1.0),), {"a": 1.0, "b": 1.0}, free, None)


def solved(whole, pool):
    """Candidate, Identifiability and Surrogate at the least-squares solution by NumPy."""
    theta, *_ = np.linalg.lstsq(DESIGN, whole.tests[0].curve.force, rcond=None)
    parameters = dict(zip("ab", theta.tolist(), strict=True))
    places = [dict(zip("ab", place, strict=True)) for place in np.random.default_rng(0).uniform(-40, 60, (12, 2)).tolist()]
    best = whole.judge(parameters, (DESIGN @ theta,))
    known = identifiability(whole, best, (DESIGN * 100,))
    return best, known, learn(whole, pool.evaluate(places))


def test_the_profile_of_a_linear_model_is_its_students_interval():
    whole = line(np.random.default_rng(3).standard_normal(25))
    best, known, surrogate = solved(whole, Line())
    found = profiles.profiles(whole, surrogate, best, known)
    for n, name in enumerate("ab"):
        np.testing.assert_allclose(found[name].interval, known.interval[n], rtol=1e-3)
        expected = ((found[name].values - best.parameters[name]) / known.stderr[n]) ** 2
        np.testing.assert_allclose(found[name].chi2, expected, rtol=1e-3, atol=1e-3)


def test_the_bootstrap_of_a_linear_model_has_its_standard_errors():
    """400 draws: the standard deviation of a standard deviation is 3.5 %; the tolerance three of these."""
    whole = line(np.random.default_rng(3).standard_normal(25))
    best, known, surrogate = solved(whole, Line())
    found = bootstrap(whole, surrogate, best, known, 0, draws=400)
    for n, name in enumerate("ab"):
        assert found[name].stderr == pytest.approx(known.stderr[n], rel=0.11)


def test_ends_of_profiles_are_proved_by_runs():
    """The surrogate of runs with a little scatter is not sure of its ends, and all of them are run."""
    whole, pool = line(np.random.default_rng(3).standard_normal(25)), Line()
    best, known, _ = solved(whole, pool)
    surrogate = solved(whole, Line(scatter=0.3))[2]
    found = profiles.profiles(whole, surrogate, best, known)
    rows = profiles.Proving(whole, pool, surrogate, best, known).prove(found)
    for name in "ab":
        assert len(rows[name]) == 2
        for row in rows[name]:
            assert row.chi2 == pytest.approx(found[name].limit, rel=0.5)  # ends near each other share a run; the runs had scatter


def test_where_the_surrogate_is_sure_of_its_ends_one_run_proves_them():
    whole, pool = line(np.random.default_rng(3).standard_normal(25)), Line()
    best, known, surrogate = solved(whole, pool)
    found = profiles.profiles(whole, surrogate, best, known)
    spent = pool.runs
    rows = profiles.Proving(whole, pool, surrogate, best, known).prove(found)
    assert pool.runs - spent == 2  # one set of parameters
    proved = [row for pair in rows.values() for row in pair]
    assert proved
    for row in proved:
        assert row.predicted == pytest.approx(row.chi2, rel=1e-6)


def test_where_the_run_that_proves_ends_is_not_as_predicted_all_are_run():
    """The model has another term, of which the runs of the surrogate saw nothing."""
    whole, bent = line(np.random.default_rng(3).standard_normal(25)), Line(more=0.2)
    best, known, surrogate = solved(whole, Line())
    found = profiles.profiles(whole, surrogate, best, known)
    rows = profiles.Proving(whole, bent, surrogate, best, known).prove(found)
    assert bent.runs > 2
    assert all(len(pair) == 2 for pair in rows.values())


def test_a_run_that_fails_at_an_end_is_told_with_its_cause():
    whole = line(np.random.default_rng(3).standard_normal(25))
    best, known, surrogate = solved(whole, Line())
    found = profiles.profiles(whole, surrogate, best, known)
    rows = profiles.Proving(whole, Line(broken=lambda point: True), surrogate, best, known).prove(found)
    assert {row.cause for pair in rows.values() for row in pair} == {"broken here"}
    assert all(row.chi2 is None for pair in rows.values() for row in pair)


# Profiles, on the two curves of `formula`


@pytest.fixture(scope="module")
def explored():
    whole, pool = problem(bent(1, 0.05)), Watched(Formula())
    exploration = explore(whole, pool, Fit(), genetic.search)
    end = polish(whole, pool, exploration.search.best, surrogate=exploration.surrogate)
    known = identifiability(whole, end.best, end.derivatives, equation_one=True)
    return whole, pool, learn(whole, pool.known), end.best, known


def test_one_test_alone_leaves_open_what_it_does_not_see(explored):
    """Along, mu (40 + zeta / 2) is all that is seen: mu may lie between the values that zeta = 20 and zeta = 0 ask for."""
    whole, pool, surrogate, _, _ = explored
    parallel = alone(whole, pool, surrogate, 0)["parallel"]
    assert parallel.parameters["zeta"].interval == (0.0, 20.0)
    assert "not determined" in parallel.parameters["zeta"].verdict
    low, high = parallel.parameters["mu"].interval
    force = TRUTH["mu"] * (40 + 0.5 * TRUTH["zeta"])
    assert low == pytest.approx(force / 50, rel=0.02)
    assert high == pytest.approx(force / 40, rel=0.02)
    assert parallel.confirmed_rmse == pytest.approx(parallel.rmse, rel=0.02)


def test_one_test_alone_has_the_error_of_the_mesh_too():
    """Only mu is free: forces that may be wrong by 5 % make it 5 % uncertain, 1.96 of which are half of the interval."""
    whole, pool = problem(bent(1, 0.05), free={"mu": FREE["mu"]}), Watched(Formula())
    surrogate = linearised(whole, whole.judge(TRUTH, formula(**{**TRUTH, "mu": 1.0})), [np.zeros((15, 1))] * 2)
    for single in alone(whole, pool, surrogate, 0, 0.05).values():
        low, high = single.parameters["mu"].interval
        assert (high - low) / 2 == pytest.approx(norm.ppf(0.975) * 0.05 * TRUTH["mu"], rel=0.01)


def test_weights_move_the_fit_from_one_test_to_the_other(explored):
    whole, _, surrogate, best, _ = explored
    rows = scan_weights(whole, surrogate, 0)
    assert [row.weights[0] for row in rows] == [float(f"{1 - n / 10:.6g}") for n in range(11)]
    for name, better in (("parallel", -1), ("perpendicular", 1)):
        sizes = [row.rmse[name] for row in rows][1:-1]
        assert np.all(better * np.diff(sizes) <= 1e-3 * max(sizes))
    even = rows[5].parameters
    assert even["mu"] == pytest.approx(best.parameters["mu"], rel=0.005)


def test_intervals_of_profiles_cover_the_truth_as_often_as_they_say(explored):
    """100 draws of white noise on the surrogate's own curves; three standard errors of the share are 6.5 %.
    tests/campaigns/interval_coverage.py has 200 draws on the true model's."""
    whole, _, surrogate, _, _ = explored
    inside = certainty.coverage(whole, surrogate, TRUTH, [0.02 * force.max() for force in formula(**TRUTH)], 100, seed=2)
    assert np.all(np.abs(inside.mean(axis=0) - 0.95) < 0.065)


# Profiles of searches without a surrogate


@pytest.mark.parametrize("method", ["least_squares", "ga", "differential_evolution", "cma"])
def test_profiles_of_every_method_end_where_the_misfit_has_grown_to_its_limit(method):
    """Direct searches on `formula`: at each end the other parameters are fitted by SciPy, and chi2 is the limit within 10 %."""
    whole, pool = problem(bent(1, 0.05)), Watched(Formula())
    options = Fit(method=method, direct=True, uncertain=Uncertain(mesh=0), what_if=False)
    solved = methods.solve(whole, pool, options)
    optimum = solved.optimum
    spent = pool.evaluations
    found = certainty.certainty(white_matter().model_copy(update={"fit": options}), whole, pool, solved)
    known = found.known
    assert pool.evaluations - spent <= 9  # six ends, each test alone, and one more
    said = " ".join(found.notes)
    if method == "least_squares":
        assert pool.evaluations <= max(spent, 12)
        assert f"{sum(len(profile.confirmed) for profile in found.findings.profiles.values())} of their 6 ends confirmed" in said
    else:
        assert f"{pool.evaluations - spent} more sets of parameters were run" in said
    assert set(found.findings.profiles) == {"mu", "zeta", "phi"}
    roots = [np.sqrt(weight) for weight in known.weights]

    def squares(x, bounds):
        def residuals(x):
            rows = zip(roots, formula(*x), whole.tests, strict=True)
            return np.concatenate([root * (force - test.curve.force) for root, force, test in rows])

        return 2 * scipys(residuals, np.clip(x, *bounds), bounds=bounds, x_scale=[1, 10, 2]).cost

    bounds = np.array([[one.min, one.max] for one in whole.free.values()]).T
    x = [optimum.best.parameters[name] for name in whole.free]
    least = squares(x, bounds)
    for n, (name, profile) in enumerate(found.findings.profiles.items()):
        assert found.estimates[name].interval == profile.interval
        for end in profile.interval:
            if end in bounds[:, n]:
                continue
            held = bounds.copy()
            held[:, n] = end - 1e-9, end + 1e-9
            chi2 = (squares(x, held) - least) * known.errors.plain[n, n] / known.errors.covar[n, n]
            assert chi2 == pytest.approx(profile.limit, rel=0.1), (name, end)


def test_linearised_curves_have_the_profiles_and_the_bootstrap_of_linear_theory():
    """Where no surrogate is to be had; 200 draws: three standard deviations of a standard deviation are 15 %."""
    whole = line(np.random.default_rng(3).standard_normal(25))
    best, known, _ = solved(whole, Line())
    found = certainty.linear_findings(whole, best, (DESIGN * 100,), known, 0)
    for n, name in enumerate("ab"):
        np.testing.assert_allclose(found.profiles[name].interval, known.interval[n], rtol=1e-3)
        assert found.bootstrap[name].stderr == pytest.approx(known.stderr[n], rel=0.15)
    assert "linearised" in found.notes[0]


def test_linearised_curves_are_exact_in_the_scale():
    whole = problem()
    at = {**TRUTH, "mu": 2.0}
    slopes = [np.column_stack([9.9 / 2.0 * force, 0 * force, 0 * force]) for force in formula(**at)]
    surrogate = linearised(whole, whole.judge(at, formula(**{**at, "mu": 1.0})), slopes)
    for mu in (0.5, 5.0):
        forces = whole.scaled({**at, "mu": mu}, surrogate.evaluate([at])[0].forces)
        np.testing.assert_allclose(np.concatenate(forces), np.concatenate(formula(**{**at, "mu": mu})), rtol=1e-12)


# Uncertain inputs


def test_an_uncertain_input_moves_an_estimate_by_what_it_moves_the_curve(monkeypatch):
    """If the input adds d to the curve, a gives way by exactly its standard deviation, and b not at all."""
    whole = line(np.random.default_rng(3).standard_normal(25))
    best, known, _ = solved(whole, Line())
    case = coarse_white_matter({"friction": 0.5})
    monkeypatch.setattr(inputs, "input_derivatives", lambda *_: [D])
    found = inputs.shares(Solution(case, whole, Line(), best, known))
    row = found.rows["friction"]
    assert row.effect["a"] == pytest.approx(-0.5, rel=1e-9)
    assert row.effect["b"] == pytest.approx(0.0, abs=1e-9)
    total = np.hypot(known.stderr[0], 0.5)
    assert row.share["a"] == pytest.approx((0.5 / total) ** 2, rel=1e-9)
    np.testing.assert_allclose(found.covar, [[0.25, 0], [0, 0]], atol=1e-9)


def test_an_error_that_a_parameter_at_its_bound_would_take_up_widens_the_other():
    """F = a d + b d^2 with b at its bound, and an error of 0.5 d^2: with b free, a would not feel it; with b held, the regression
    of d^2 on d gives a an error of 0.5 sum d^3 / sum d^2."""
    noise = np.random.default_rng(3).standard_normal(25)
    whole = line(0.1 * noise - 0.5 * D**2)
    whole = replace(whole, free={"a": whole.free["a"], "b": Range(start=30, min=20, max=60)})
    a = float(D @ (whole.tests[0].curve.force - 20 * D**2) / (D @ D))
    best = whole.judge({"a": a, "b": 20.0}, (a * D + 20 * D**2,))
    slopes = (DESIGN * [100, 40],)
    known = widened(whole, best, identifiability(whole, best, slopes), np.diag([0.0, 0.25]))
    assert known.at_bound == ("", "lower") and known.noise[0].autocorrelation == 0
    low, high = profiles.profiles(whole, linearised(whole, best, slopes), best, known)["a"].interval
    sd = np.sqrt(known.noise[0].sigma ** 2 / (D @ D) + (0.5 * np.sum(D**3) / (D @ D)) ** 2)
    assert high - a == pytest.approx(known.quantile[0] * sd, rel=0.01)
    assert a - low >= 0.99 * (high - a)  # downwards b may leave its bound


def test_forces_that_are_wrong_as_a_whole_move_a_linear_estimate_as_much():
    """F = a d + b d^2 with all forces 2 % too large: a and b are 2 % too large; without any noise their intervals are the normal
    distribution's, since what a case states has no degrees of freedom to lose."""
    whole = line(np.zeros(25))
    best, known, _ = solved(whole, Line())
    wider, found, _ = certainty.with_inputs(Solution(coarse_white_matter({"force": 0.02}), whole, Line(), best, known))
    for n, (name, value) in enumerate((("a", 30.0), ("b", 20.0))):
        assert found.inputs["force"].effect[name] == pytest.approx(0.02 * value, rel=1e-6)
        assert found.stderr_total[name] == pytest.approx(0.02 * value, rel=1e-6)
        assert np.ptp(wider.known.interval[n]) == pytest.approx(2 * norm.ppf(0.975) * 0.02 * value, rel=1e-4)


def coarse_white_matter(uncertain, *more):
    given = {"mesh": 0, **uncertain}
    keys = ["mesh.elements=40", "solver.element=q1p0", *(f"fit.uncertain.{key}={value}" for key, value in given.items()), *more]
    return white_matter(*keys)


def at_its_start(case, pool):
    """InverseProblem of a case on the curves that it makes itself at its start values, and the Candidate there."""
    whole = inverse_problem(case)
    forces = pool.evaluate([whole.at_reference(whole.start)])[0].forces
    whole = whole.measured(whole.scaled(whole.start, forces))
    return whole, whole.judge(whole.start, forces)


def test_derivatives_by_inputs_have_the_sign_of_mechanics():
    """Across the fibres: more friction and less compressibility are stiffer; a contact later on and a thicker sample softer.
    The contact point's is the curve's own slope; all runs are the pool's."""
    case = coarse_white_matter({"friction": 0.1}, "material.mu={start=1.49,min=0.1,max=10}")
    with RunPool(case, 1) as pool:
        whole, best = at_its_start(case, pool)
        names = ("friction", "bulk_ratio", "thickness", "offset")
        by = {name: inputs.input_derivatives(case, whole, pool, best, name)[1] for name in names}
        assert pool.evaluations == 3  # at the start, with all exact ones; on two thicknesses
    assert by["friction"][-1] > 0
    assert by["bulk_ratio"][-1] > 0
    assert by["thickness"][-1] < 0
    slope = np.gradient(best.forces[1], case.outputs(case.tests[1]))
    np.testing.assert_allclose(-by["offset"][2:-1], slope[2:-1], rtol=0.03)


def test_on_another_base_the_parameters_would_be_what_a_fit_there_finds():
    """Forces are proportional to mu, the only free one: a bonded base that is stiffer by a factor would make mu smaller by it."""
    case = coarse_white_matter({"base": 0.3}, "material.mu={start=1.49,min=0.1,max=10}", "test.parallel.weight=0")
    bonded = simulate(case.model_copy(update={"sample": case.sample.model_copy(update={"base": "bonded"})})).tests[1].force
    with RunPool(case, 1) as pool:
        whole, best = at_its_start(case, pool)
        slopes = [whole.range("mu") / 1.49 * force[:, None] for force in best.forces]
        found = inputs.shares(Solution(case, whole, pool, best, identifiability(whole, best, slopes)))
    there = 1.49 * (bonded @ best.forces[1]) / (bonded @ bonded)
    assert there < 0.9 * 1.49
    assert found.rows["base"].effect["mu"] == pytest.approx(there - 1.49, rel=1e-4)
    assert found.covar[0, 0] == pytest.approx(0.3 * (there - 1.49) ** 2, rel=1e-3)  # the mean square, were it so in 30 %


def test_an_input_whose_runs_fail_is_named_and_the_others_stand():
    whole = line(np.random.default_rng(3).standard_normal(25))
    best, known, _ = solved(whole, Line())
    case = coarse_white_matter({"mesh": 1, "force": 0.02})
    found = inputs.shares(Solution(case, whole, Line(broken=lambda point: "mesh.wider" in point), best, known))
    assert found.missing == {"mesh": "broken here"}
    assert set(found.rows) == {"force"}


@pytest.mark.parametrize(("given", "odds"), [("true", 0.5), ("false", None), ("0.3", 0.3)])
def test_an_uncertain_base_is_a_probability_or_even_odds(given, odds):
    assert white_matter(f"fit.uncertain.base={given}").fit.uncertain.base == odds
    for wrong in ("1.2", "0", '"bonded"'):
        with pytest.raises(CaseError, match=r"fit\.uncertain\.base"):
            white_matter(f"fit.uncertain.base={wrong}")


def test_an_uncertainty_of_nothing_known_is_refused():
    with pytest.raises(CaseError, match="offfset"):
        coarse_white_matter({"offfset": 0.1})


# Published values


@pytest.mark.parametrize(
    ("values", "runs"),
    [({"mu": 1.9, "zeta": 5.0, "phi": 1.0}, 0), ({"mu": 1.9, "zeta": 25.0, "phi": 1.0}, 1), ({"mu": 1.9, "friction": 0.2}, 1)],
)
def test_published_values_are_run_where_the_surrogate_does_not_know_their_objective(explored, values, runs):
    """Inside of the ranges it knows it to its stated error; outside of them, and of inputs that it does not have, it does not."""
    whole, pool, surrogate, best, known = explored
    case = white_matter().model_copy(update={"fit": Fit(published=values)})
    before = pool.evaluations
    there = certainty.published_objective(Solution(case, whole, pool, best, known), surrogate)
    comparison = certainty.published_comparison(case, there, {})
    used = pool.evaluations - before
    point = {**best.parameters, **values}
    exact = whole.judge(point, pool.evaluate([whole.at_reference(point)])[0].forces).objective
    assert used == runs and (comparison.error is None) == bool(runs)
    assert comparison.objective == pytest.approx(exact, abs=3 * (comparison.error or 1e-9))
    assert (comparison.error or 0) < 0.03 * exact


def test_the_error_of_a_predicted_objective_counts_tests_as_equation_one_does(explored):
    """The second test counts a thousand times as much: an error of 25 % was stated as 0.4 %."""
    whole, _, surrogate, *_ = explored
    first, second = whole.tests
    others = replace(second, scale=1000.0), replace(second, weight=0)
    scaled, none = (replace(whole, tests=(first, other)) for other in others)
    point = {"mu": 1.9, "zeta": 5.0, "phi": 1.0}
    errors = [certainty._predicted_objective(each, surrogate, point) for each in (whole, scaled, none)]
    assert all(known is not None for known in errors)
    of_all, of_scaled, of_first = (known[1] for known in errors)
    assert of_scaled == pytest.approx(of_first + 1000 * (of_all - of_first), rel=1e-6)


# The whole, on the forward model


def test_a_fit_says_in_words_what_its_curves_determine(tmp_path):
    """Curves that the model made itself at zeta = 4: mu is determined, and published values are put in their place."""
    case = read_case(
        coarse_case(tmp_path, TRUTH), ["fit.method=ga", "fit.published={mu=3.0,zeta=4.0}", "fit.seed=1", "fit.uncertain.mesh=0"]
    )
    result = fit(case)
    assert result.success
    assert result.parameters["mu"].value == pytest.approx(1.5, rel=0.005)
    assert result.parameters["zeta"].value == pytest.approx(4.0, rel=0.02)
    assert result.nfev <= 40
    assert any(sentence.startswith("determined by these two curves") and "mu" in sentence for sentence in result.conclusions)
    assert result.published.inside["mu"] is False
    assert set(result.profiles) == {"mu", "zeta", "phi"}
    assert set(result.tests_alone) == {"parallel", "perpendicular"}
    both, one = (found.parameters["zeta"].interval for found in (result, result.tests_alone["parallel"]))
    assert np.ptp(one) > 5 * np.ptp(both)  # along the fibres, zeta hardly shows
    assert read_case(case.path, case.overrides).hash == result.case_hash


@pytest.mark.campaign
def test_friction_can_be_fitted_too(tmp_path):
    """One test across the fibres, made by the model itself with friction 0.3; only it and mu are free."""
    made = white_matter("mesh.elements=40", "solver.element=q1p0", "indenter.friction=0.3")
    keys = ["mesh.elements=40", "solver.element=q1p0", "fit.workers=1", "fit.uncertain.friction={start=0.5,min=0.1,max=0.8}"]
    whole = inverse_problem(white_matter(*keys, "material.mu={start=1,min=0.1,max=10}"))
    forces = [test.force for test in simulate(made).tests]
    assert list(whole.free) == ["mu", "friction"]
    with RunPool(white_matter(*keys), 1) as pool:
        found = least_squares(whole.measured(forces), pool, whole.start)
    assert found.best.parameters["friction"] == pytest.approx(0.3, abs=0.01)
    assert found.best.parameters["mu"] == pytest.approx(1.49, rel=0.002)


def test_an_offset_shifts_a_curve_along_its_displacements():
    """No force before contact; beyond it the curve is the other's, further left."""
    case = white_matter("mesh.elements=40", "solver.element=q1p0", "fit.workers=1")
    parameters, step = case.start_values(), case.outputs(case.tests[0])[1] - case.outputs(case.tests[0])[0]
    with RunPool(case, 1) as pool:
        plain, late = pool.evaluate([parameters, {**parameters, "offset": 2 * step}])
    assert np.all(late.forces[1][:2] == 0)
    np.testing.assert_allclose(late.forces[1][2:], plain.forces[1][:-2], rtol=2e-3)


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        (["fit.uncertain.friction=-0.1"], "above 0"),
        (["fit.uncertain.friction={start=0.5,min=-0.1,max=1}"], "at least 0"),
        (["fit.uncertain.friction=0.1", "indenter.friction=stick"], "the indenter sticks"),
        (["fit.uncertain.bulk_ratio=100", "material.kappa=1000"], "material.kappa is given"),
    ],
)
def test_uncertain_inputs_that_cannot_be_are_refused(keys, said):
    with pytest.raises(CaseError, match=said):
        white_matter(*keys)


def punch_on_a_layer(of_mesh, bonded=True, what_if=False, first=1e-4, **uncertain):
    """A flat punch on a layer that is said to be bonded, at small strain; its exact stiffness is that of an elastic layer, bonded
    or not, with a modulus of 1 kPa."""
    depths = np.linspace(first, 5e-4, 12)
    noise = 2e-4 * np.random.default_rng(0).standard_normal(depths.size)
    exact = Layer(bonded, 0.45).punch_stiffness(0.5) * depths
    return Case(
        sample=Sample(shape="disc", diameter=14.0, thickness=1.0, base="bonded"),
        indenter=Indenter(shape="cylinder", diameter=1.0, friction=0),
        material={
            "energy": "mu/2*(I1 - 3)",
            "parameters": {"mu": {"start": 1.5, "min": 0.1, "max": 10}},
            "poisson_ratio": 0.45,
        },
        mesh=of_mesh,
        tests=[Test("press", angle=0, curve=Curve(depths, exact + noise * exact[-1]))],
        fit={"workers": 1, "what_if": what_if, "uncertain": uncertain},
    )


def test_a_fit_on_the_wrong_base_says_what_the_other_one_would_give():
    """The layer slides, and its exact modulus is 1 kPa: as if it were bonded, 0.7 kPa is "determined". The first point of its curve
    is before contact."""
    result = fit(punch_on_a_layer({"elements": 60}, bonded=False, what_if=None, first=0.0))
    known, found = result.parameters["mu"], {(tried.input, tried.other): tried.parameters for tried in result.taken_as_known}
    assert known.interval[1] < 0.9 and known.verdict.startswith("determined")
    assert found["base", "sliding"]["mu"] == pytest.approx(1, rel=0.015)
    assert all(found.values())  # also friction and contact point
    exact = Layer(True, 0.45).punch_stiffness(0.5)
    for key, other in {
        ("thickness", "0.95 mm"): 0.95 * Layer(True, 0.45).punch_stiffness(0.5 / 0.95),
        ("size", "diameter 1.02 mm"): Layer(True, 0.45).punch_stiffness(0.51),
        ("bulk_ratio", "3 (Poisson's ratio 0.35)"): Layer(True, 0.35).punch_stiffness(0.5),
        ("bulk_ratio", "50 (Poisson's ratio 0.4901)"): Layer(True, poisson_ratio(50)).punch_stiffness(0.5),
    }.items():
        assert found[key]["mu"] == pytest.approx(known.value * exact / other, rel=0.006), key
    curve = result.case.curves[0]
    stiffens = 1 + 0.05 * curve.displacement / curve.displacement.max()
    softer = curve.force @ (curve.force / stiffens) / (curve.force @ curve.force)
    assert found["law", "5% too soft at the largest depth"]["mu"] == pytest.approx(softer * known.value, rel=1e-3)
    assert "[fit.discrepancy]" in next_step(result)
    assert any("base bonded" in doubt.text and "with base sliding" in doubt.text for doubt in doubts_of(result))


def test_a_fit_is_corrected_for_its_mesh_and_its_interval_holds_the_exact_modulus():
    """Hayes' exact stiffness, on a mesh of some 30 elements: without the correction the interval misses the truth."""
    bare, whole = (fit(punch_on_a_layer({"elements": 30}, **uncertain)) for uncertain in ({"mesh": 0}, {}))
    off, less = (abs(result.parameters["mu"].value - 1) for result in (bare, whole))
    assert off > 2e-3 and less < off / 2
    assert not bare.parameters["mu"].interval[0] <= 1 <= bare.parameters["mu"].interval[1]
    low, high = whole.parameters["mu"].interval
    assert low < 1 < high and high - low < 8 * off
    shares = whole.uncertain.inputs["mesh"].share["mu"], whole.uncertain.noise.share["mu"]
    assert sum(shares) == pytest.approx(1, rel=1e-9) and shares[0] > 0.5
    assert whole.parameters["mu"].limited_by == "mesh" and "elements would" in whole.parameters["mu"].verdict
    assert whole.mesh.elements < 60  # a mesh that the case states is not refined


def test_a_fit_refines_by_itself_where_the_mesh_would_be_most_of_its_interval(tmp_path, monkeypatch):
    """0.02 % noise: the finer mesh is run at the optimum, once for the only parameter, and the exact modulus is held."""
    case = punch_on_a_layer({"error": 0.002})
    result = fit(case)
    known, own = result.parameters["mu"], count(setup_of(case))
    assert result.mesh.elements > 1.4 * own
    assert any(f"the mesh of {own} elements was refined" in note for note in result.notes)
    assert result.nfev == 3 and result.uncertain.inputs["mesh"].elements == own
    low, high = known.interval
    assert low < 1 < high and known.value == pytest.approx(1, abs=1e-3) and high - low < 3e-3
    assert FitResult.from_json(json.loads(json.dumps(result.as_json()))).refined == result.refined > 1
    shown = []
    monkeypatch.setattr(Solved, "written", lambda solved, folder: shown.append(solved) or [])
    monkeypatch.setattr(fields, "write_pictures", lambda folder, tests: None)
    result.write(tmp_path / "result")
    assert [solved.model.mesh.nelements for solved in shown] == [result.mesh.elements]  # stresses are of the finest mesh too


@pytest.mark.parametrize("elements", [20, 24, 40, 180, 1500])
def test_the_second_mesh_is_another_one(elements):
    """At most three quarters of the elements, or more where there are no fewer."""
    case = white_matter(f"mesh.elements={elements}")
    own = setup_of(case)
    other = second(own).setup
    meshes = [quarter(case.sample, case.indenter, setup.mesh, case.solver.element, 0.33) for setup in (own, other)]
    here, there = (mesh.nelements for mesh in meshes)
    assert there <= 0.8 * here or there >= 1.5 * here
    assert second(own).finer == (there > here)
