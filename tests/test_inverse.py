"""The inversion: its objective, its searches and what it says about its own certainty.

Most searches here run on curves in closed form, `Formula`, where truth and derivatives are known exactly.
"""

import json
import os
import signal
from types import SimpleNamespace

import numpy as np
import pytest
from fixtures.cases import coarse_case
from fixtures.formulas import FREE, TRUTH, Formula, bent, formula, problem
from scipy.optimize import brentq, minimize
from scipy.stats import t as student

from indentfit.case import Case, Range, Test
from indentfit.curve import Curve
from indentfit.digits import quantity
from indentfit.errors import CaseError, ConvergenceError
from indentfit.experiment.measured import read_case
from indentfit.fem.simulate import Model
from indentfit.inference.fit import fit
from indentfit.inference.identifiability import identifiability
from indentfit.inference.noise import SLAB, WHITE, possible
from indentfit.inference.result import FitResult
from indentfit.inverse import genetic
from indentfit.inverse.least_squares import least_squares
from indentfit.inverse.objective import Target, best_scale, equation_one, misfit, rmse, sum_of_squares
from indentfit.inverse.polish import polish
from indentfit.inverse.problem import Candidate, InverseProblem, inverse_problem
from indentfit.inverse.settings import SearchSettings
from indentfit.runs import bench
from indentfit.runs.forward import presses_of
from indentfit.runs.mechanics import mechanics_of
from indentfit.runs.points import setup_of
from indentfit.runs.pool import RunPool
from indentfit.runs.run import RunRequest

# The objective


def test_equation_one_is_the_weighted_sum_of_rmses():
    """By hand: RMSE 2 mN of the first test (misfits 2, -2, 2, -2, 2), 1 mN of the second; 0.75 * 2 + 0.25 * 1."""
    target = Curve(np.arange(1, 6) / 10, [1, 2, 3, 4, 5])
    tests = Target("a", target, 0.75), Target("b", target, 0.25)
    forces = target.force + np.array([2, -2, 2, -2, 2]), target.force - 1
    assert [rmse(test, force) for test, force in zip(tests, forces, strict=True)] == [2.0, 1.0]
    assert equation_one(tests, forces) == 1.75
    assert sum_of_squares(tests, forces) == 3.25
    squares = sum(np.sum(misfit(test, force) ** 2) for test, force in zip(tests, forces, strict=True))
    assert squares == pytest.approx(3.25, rel=1e-14)


@pytest.mark.parametrize("weights", [(0.5, 0.5), (0.9, 0.1), (1.0, 0.0)])
def test_the_best_scale_is_the_best_of_a_fine_scan(weights):
    tests = problem(bent(), weights=weights).tests
    forces = formula(1.0, 6.0, 0.2)
    found = best_scale(tests, forces)
    scan = np.linspace(0.8, 1.2, 4001) * found
    values = [equation_one(tests, [s * f for f in forces]) for s in scan]
    assert found == pytest.approx(scan[np.argmin(values)], rel=2e-4)
    assert equation_one(tests, [found * f for f in forces]) <= min(values)


def test_the_best_scale_respects_its_bounds_and_meets_an_exact_curve():
    tests, forces = problem().tests, formula(1.0, 4.0, 0.7)
    assert best_scale(tests, forces) == pytest.approx(1.5, rel=1e-12)
    assert best_scale(tests, forces, 2.0, 3.0) == 2.0
    assert best_scale(tests, forces, 0.0, 1.0) == 1.0


def test_the_search_without_the_scale_finds_what_the_full_search_finds():
    """At every zeta, phi the best mu under equation (1) by Nelder-Mead over mu alone is that of `best_scale`."""
    whole = problem(bent())
    for zeta, phi in [(2.0, 0.3), (9.0, 3.0)]:
        best = whole.judge_best_scale({"mu": 1.0, "zeta": zeta, "phi": phi}, formula(1.0, zeta, phi))
        full = minimize(
            lambda mu, zeta=zeta, phi=phi: equation_one(whole.tests, formula(mu[0], zeta, phi)),
            [1.2], method="Nelder-Mead", options={"xatol": 1e-10, "fatol": 1e-14},
        )  # fmt: skip
        assert best.objective == pytest.approx(full.fun, rel=1e-9)
        assert best.parameters["mu"] == pytest.approx(full.x[0], rel=1e-5)


# The searches


@pytest.mark.parametrize("scale", ["mu", None])
def test_least_squares_comes_back_to_the_truth(scale):
    found = least_squares(problem(scale=scale), Formula(), problem().start)
    assert found.success
    for name, value in TRUTH.items():
        assert found.best.parameters[name] == pytest.approx(value, rel=2e-3), name


def test_the_genetic_algorithm_and_its_polish_come_back_to_the_truth():
    options = SearchSettings(12, 12, seed=1)
    found = genetic.search(problem(), Formula(), options)
    objectives = [step.objective for step in found.history]
    assert len(objectives) == 12
    assert objectives == sorted(objectives, reverse=True)
    end = polish(problem(), Formula(), found.best)
    assert end.success
    for name, value in TRUTH.items():
        assert end.best.parameters[name] == pytest.approx(value, rel=2e-3), name


def test_the_polish_ends_at_the_optimum_of_equation_one_and_not_of_the_squares():
    """The oracle is Nelder-Mead on equation (1) itself, from several places."""
    whole = problem(bent(3, 1.0))
    start = whole.judge(dict(TRUTH), formula(1.0, 4.0, 0.7))
    found = polish(whole, Formula(), start, 1e-9)

    def value(x):
        return equation_one(whole.tests, formula(*x)) if min(x) >= 0 else 1e9

    options = {"xatol": 1e-8, "fatol": 1e-12, "maxiter": 4000}
    starts = [(1.5, 4.0, 0.7), (1.2, 6.0, 2.0), (1.7, 3.0, 0.3)]
    oracle = min((minimize(value, s, method="Nelder-Mead", options=options) for s in starts), key=lambda r: r.fun)
    assert found.best.objective == pytest.approx(oracle.fun, rel=2e-4)
    squares = least_squares(whole, Formula(), TRUTH)
    assert squares.best.objective > found.best.objective
    assert squares.best.sum_of_squares < found.best.sum_of_squares


def test_an_optimum_outside_of_the_bounds_ends_at_the_bound_and_says_so():
    free = {**FREE, "zeta": Range(start=8.0, min=5.0, max=20.0)}
    whole = problem(bent(), free=free)
    for found in (
        least_squares(whole, Formula(), whole.start),
        polish(whole, Formula(), whole.judge(whole.start, formula(**{**whole.start, "mu": 1.0}))),
    ):
        assert found.best.parameters["zeta"] == pytest.approx(5.0, abs=0.005)
        known = identifiability(whole, found.best, found.derivatives)
        assert known.at_bound[1] == "lower"
        assert known.verdicts[1].startswith("at its lower bound")
        assert known.interval[1, 0] == 5.0


def test_failures_never_stop_a_search_and_are_never_its_result():
    """A third of the range does not converge, the start among it."""
    pool = Formula(broken=lambda parameters: parameters["zeta"] > 6.5)
    found = genetic.search(problem(), pool, SearchSettings(12, 10))
    assert pool.failures
    assert found.best.objective < 1.0
    assert found.best.parameters["zeta"] <= 6.5
    again = equation_one(problem().tests, formula(**found.best.parameters))
    assert found.best.objective == pytest.approx(again, rel=1e-9)


def test_least_squares_steps_around_what_fails():
    """From 5, the first full step would lead below 2.5 or above 5.5, where nothing converges."""
    free = {**FREE, "zeta": Range(start=5.4, min=0.0, max=20.0)}
    pool = Formula(broken=lambda parameters: not 2.5 < parameters["zeta"] < 5.5)
    found = least_squares(problem(free=free), pool, problem(free=free).start)
    assert found.success
    assert found.best.parameters["zeta"] == pytest.approx(4.0, rel=1e-3)


def test_a_search_that_fails_everywhere_says_why():
    pool = Formula(broken=lambda parameters: True)
    assert genetic.search(problem(), pool, SearchSettings(4, 2)).best is None
    found = least_squares(problem(), pool, problem().start)
    assert (found.best, found.success) == (None, False)
    assert "broken here" in found.message


def test_a_derivative_that_cannot_be_had_ends_the_search_with_its_best():
    pool = Formula(broken=lambda parameters: parameters["phi"] != 2.0)
    found = least_squares(problem(), pool, problem().start)
    assert not found.success
    assert found.derivatives is None
    assert found.best.parameters == {"mu": 1.0, "zeta": 8.0, "phi": 2.0}
    assert "phi" in found.message


def test_only_the_scale_free_needs_one_run():
    whole, pool = problem(free={"mu": FREE["mu"]}), Formula()
    found = genetic.search(whole, pool, SearchSettings(80, 60))
    assert found.best.parameters["mu"] == pytest.approx(1.5, rel=1e-12)
    assert pool.runs == 2


# Identifiability


def under_every_correlation(design, force):
    """The coefficients of ordinary least squares under AR(1) noise, over its correlations by Bayes' rule: half of each central
    interval of 95 %, by the mixture of Student's t, and the mean covariance."""
    n, p = design.shape
    inverse, logs, covars = np.linalg.inv(design.T @ design), [], []
    for number, rho in enumerate(possible(n)):
        R = rho ** np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
        L = np.linalg.cholesky(R)
        whitened = np.linalg.solve(L, design)
        squares = np.linalg.lstsq(whitened, np.linalg.solve(L, force), rcond=None)[1][0]
        volume = np.linalg.slogdet(R)[1] + np.linalg.slogdet(whitened.T @ whitened)[1]
        logs.append(np.log((1 - WHITE) / SLAB if number else WHITE) - volume / 2 - (n - p) / 2 * np.log(squares))
        covars.append(squares / (n - p) * inverse @ design.T @ R @ design @ inverse)
    shares = np.exp(np.array(logs) - max(logs))
    shares, sd = shares / shares.sum(), np.sqrt([np.diag(covar) for covar in covars])
    half = [brentq(lambda h, i=i: shares @ student.cdf(h / sd[:, i], n - p) - 0.975, 0.0, 100 * sd.max()) for i in range(p)]
    return np.array(half), np.tensordot(shares, covars, axes=1)


def test_errors_and_correlation_are_those_of_linear_regression():
    """One test, F = a d + b d^2 + noise: NumPy's polynomial fit is the oracle, bounds far away. White noise shows as such, but a
    correlation stays possible: the interval is by some 5 % wider than that of white noise."""
    rng = np.random.default_rng(4)
    d = np.linspace(0.1, 1, 20)
    force = 3 * d + 2 * d**2 + 0.1 * rng.standard_normal(20)
    design = np.column_stack([d, d**2])
    theta, squares = np.linalg.lstsq(design, force, rcond=None)[:2]
    half, covar = under_every_correlation(design, force)
    white = np.sqrt(np.diag(np.linalg.inv(design.T @ design)) * squares[0] / 18)
    free = {"a": Range(start=1, min=-50, max=50), "b": Range(start=1, min=-50, max=50)}
    whole = InverseProblem((Target("t", Curve(d, force), 0.3),), {"a": 1, "b": 1}, free, None)
    best = whole.judge(dict(zip("ab", theta.tolist(), strict=True)), (design @ theta,))
    known = identifiability(whole, best, (design * 100,))
    np.testing.assert_allclose(known.interval[:, 1] - theta, half, rtol=1e-5)
    np.testing.assert_allclose(known.stderr, half / 2.10092, rtol=1e-5)  # t, 18 of freedom
    np.testing.assert_allclose(known.stderr, white, rtol=0.06)
    assert known.correlation[0, 1] == pytest.approx(covar[0, 1] / np.sqrt(covar[0, 0] * covar[1, 1]), rel=1e-9)
    assert known.redchi == pytest.approx(squares[0] / 18, rel=1e-9)


def test_intervals_cover_the_truth_as_often_as_they_say():
    """95 % of 300 noise draws; the band is three standard errors of that share."""
    inside = []
    for seed in range(300):
        whole = problem(bent(seed, 0.05))
        found = least_squares(whole, Formula(), TRUTH)
        interval = identifiability(whole, found.best, found.derivatives).interval
        inside.append([low <= TRUTH[n] <= high for n, (low, high) in zip(TRUTH, interval, strict=True)])
    assert np.all(np.abs(np.mean(inside, axis=0) - 0.95) < 0.038)


def test_a_parameter_that_the_curves_do_not_see_is_not_determined_and_harms_no_other():
    d = np.linspace(0.1, 1, 20)
    free = {"a": Range(start=1, min=0, max=50), "b": Range(start=1, min=0, max=50)}
    whole = InverseProblem((Target("t", Curve(d, 3 * d + 0.01 * np.cos(40 * d)), 1.0),), {"a": 1, "b": 1}, free, None)
    best = whole.judge({"a": 3.0, "b": 7.0}, (3 * d,))
    known = identifiability(whole, best, (np.column_stack([50 * d, 0 * d]),))
    assert known.verdicts[0].startswith("determined")
    assert "not determined" in known.verdicts[1]
    assert known.interval[1].tolist() == [0.0, 50.0]
    assert 0 < known.stderr[0] < 0.01
    assert not np.isfinite(known.stderr[1])


# The workers and the true model, on a coarse mesh without friction


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("coarse")
    coarse_case(folder, TRUTH)
    return folder


@pytest.fixture
def case(folder):
    return lambda *overrides: read_case(folder / "case.toml", overrides)


def test_a_fit_comes_back_to_the_parameters_that_made_the_curves(case):
    result = fit(case())
    assert result.success
    assert result.parameters["mu"].value == pytest.approx(1.5, rel=0.002)
    assert result.parameters["zeta"].value == pytest.approx(4.0, rel=0.02)
    assert result.parameters["phi"].value == pytest.approx(0.7, rel=0.1)
    assert result.objective < 0.01
    assert result.nfev <= 40
    assert result.solver.penalty_error < 0.005
    assert result.mesh.elements > 30
    assert result.case_hash == case().hash
    assert not result.failures


def test_a_small_genetic_search_lands_near_too(case):
    result = fit(case("fit.method=ga", "fit.population=6", "fit.generations=3"))
    assert result.success
    assert result.parameters["mu"].value == pytest.approx(1.5, rel=0.01)
    assert result.parameters["zeta"].value == pytest.approx(4.0, rel=0.1)
    phases = [step.phase for step in result.history]
    assert phases[:3] == ["ga"] * 3 and set(phases[3:]) <= {"polish"}  # none where the search ended at the optimum


def test_forces_are_proportional_to_the_scale(case):
    """The search without mu rests on it: f(mu, zeta, phi) = mu f(1, zeta, phi), to the solver's tolerance."""
    whole, model = inverse_problem(case()), Model(setup_of(case()))
    assert (whole.scale, whole.searched) == ("mu", ["zeta", "phi"])
    kind = case().law
    one, two = (model.simulate(presses_of(case(), kind(mu=mu, zeta=4, phi=0.7))).tests for mu in (1.0, 3.7))
    for a, b in zip(one, two, strict=True):
        np.testing.assert_allclose(b.force, 3.7 * a.force, rtol=1e-6)


@pytest.mark.parametrize("overrides", [["material.kappa=1000"], ["material.mu=1.5"]])
def test_nothing_is_dropped_where_the_force_is_not_proportional(case, overrides):
    assert inverse_problem(case(*overrides)).scale is None


def test_any_number_of_workers_gives_the_same_forces_bit_by_bit(case):
    points = [{"mu": 1.0, "zeta": zeta, "phi": phi} for zeta, phi in [(1.0, 0.2), (15.0, 3.0), (6.0, 0.9)]]
    with RunPool(case(), 1) as alone:
        one = alone.evaluate(points)
    with RunPool(case(), 2) as pair:
        two = pair.evaluate(points[::-1])[::-1]
        again = pair.evaluate(points)
        assert pair.runs == 6  # the second time they were known
    for a, b, c in zip(one, two, again, strict=True):
        for x, y, z in zip(a.forces, b.forces, c.forces, strict=True):
            assert np.array_equal(x, y)
            assert np.array_equal(x, z)


def test_a_run_that_fails_is_recorded_with_its_cause_and_the_others_go_on(case):
    bad, good = {"mu": 1.0, "zeta": -3.0, "phi": 1.0}, {"mu": 1.0, "zeta": 3.0, "phi": 1.0}
    with RunPool(case(), 1) as pool:
        failed, fine = pool.evaluate([bad, good])
    assert failed.forces is None
    assert "zeta = -3" in failed.cause
    assert fine.forces is not None
    assert pool.failures == [failed]


def test_no_equilibrium_is_a_cause_too(case, monkeypatch):
    def never(*_, **__):
        raise ConvergenceError("the fibres buckle", 0.1, 3, 4)

    model = SimpleNamespace(run=never, body=SimpleNamespace(n_dofs=1))
    monkeypatch.setattr(bench, "ready_model", lambda setup: model)
    run = bench.Bench(mechanics_of(case())).run(RunRequest(tuple(case().start_values().items()), 0))
    assert run.force is None
    assert "the fibres buckle" in run.cause


def test_a_lost_worker_costs_time_only(case):
    points = [{"mu": 1.0, "zeta": zeta, "phi": 1.0} for zeta in (1.0, 5.0)]
    with RunPool(case(), 2) as pool:
        before = pool.evaluate(points[:1])
        os.kill(pool._workers._workers[0].process.pid, signal.SIGKILL)
        after = pool.evaluate(points)
    assert all(one.forces is not None for one in after)
    assert np.array_equal(after[0].forces[0], before[0].forces[0])


def test_a_case_with_nothing_to_fit_is_refused_before_any_run(case):
    with pytest.raises(CaseError):
        fit(case("material.mu=1", "material.zeta=1", "material.phi=1"))


def test_a_fit_that_fails_everywhere_is_a_result_without_numbers(case, monkeypatch):
    def never(self, *_, **__):
        raise ConvergenceError("the fibres buckle", 0.1, 3, 4)

    monkeypatch.setattr(Model, "run", never)
    for overrides in ([], ["fit.method=ga", "fit.population=4", "fit.generations=1"]):
        result = fit(case(*overrides))
        assert not result.success
        assert "the fibres buckle" in result.message
        assert result.objective is None
        assert result.parameters["mu"].stderr is None
        assert all("the fibres buckle" in failure.cause for failure in result.failures)


def test_a_candidate_keeps_its_parameters():
    parameters = dict(TRUTH)
    candidate = problem().judge(parameters, formula(1.0, 4.0, 0.7))
    parameters["mu"] = 9.0
    assert isinstance(candidate, Candidate)
    assert candidate.parameters["mu"] == 1.5


def test_a_result_is_read_back_from_its_json_and_is_shown_in_one_line(case):
    """Version 2, and version 0.1, whose tag was another and which a result may have been written by without later keys."""
    result = fit(case("fit.uncertain.mesh=0"))
    written = json.loads(json.dumps(result.as_json()))
    assert written["format"] == "indentfit.fit/2"
    again = FitResult.from_json(written)
    assert again.as_json() == result.as_json() and again.case is None
    old = {key: value for key, value in written.items() if key not in ("format", "rivals", "published", "summary")}
    assert FitResult.from_json(old | {"format_version": 1}).parameters == result.parameters
    with pytest.raises(ValueError, match="parameters"):
        FitResult.from_json({"format_version": 1})
    low, high = result.parameters["mu"].interval
    assert repr(again).startswith(f"FitResult('': mu = {result.parameters['mu'].value:.4g} kPa ({low:.3g} to {high:.3g}), zeta = ")
    assert repr(again).count("\n") == 0 and repr(again).endswith(f"objective {quantity(result.objective, 'mN', 3)})")
    assert f"<td>{low:.4g} to {high:.4g}</td>" in again._repr_html_()
    assert result.summary().startswith("misfit") and f"{result.nfev} sets of parameters" in again.summary()


def test_a_case_in_memory_is_fitted_as_one_from_a_file(case):
    tests = [Test(name=t.name, angle=t.angle, curve=c) for t, c in zip(case().tests, case().curves, strict=True)]
    read = case("fit.profiles=false", "fit.uncertain.mesh=0")
    tables = {name: getattr(read, name) for name in ("sample", "indenter", "mesh", "material", "solver", "fit")}
    made = Case(**tables, tests=tests)
    assert made.path is None
    there, here = fit(read), fit(made)
    assert here.parameters == there.parameters and here.objective == there.objective
    assert list(here.measured) == list(here.curves) == ["parallel", "perpendicular"]
