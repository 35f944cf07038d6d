"""The surrogate and the searches on it: exact where it must be, honest about its error, and right about the optimum."""

from dataclasses import replace

import numpy as np
import pytest
from fixtures.formulas import DEPTH, FREE, TRUTH, Formula, bent, formula, problem
from scipy.optimize import minimize

from indentfit.case import Fit, Range
from indentfit.curve import Curve
from indentfit.inverse import evolution, genetic, methods, polynomials
from indentfit.inverse.exploration import Watched, explore
from indentfit.inverse.least_squares import least_squares, multi_start
from indentfit.inverse.objective import Target, equation_one
from indentfit.inverse.polish import polish
from indentfit.inverse.polynomials import design_points
from indentfit.inverse.problem import InverseProblem
from indentfit.inverse.progress import SILENT
from indentfit.inverse.stretching import otherwise_stretched
from indentfit.inverse.surrogate import fit_polynomial, learn
from indentfit.runs.forward import Evaluation

SEARCHES = {"ga": genetic.search, "differential_evolution": evolution.differential_evolution, "cma": evolution.cma}


def smooth(zeta, phi):
    """A curve that no polynomial of this file meets exactly, and that has derivatives everywhere."""
    return DEPTH * (10 + 8 * np.log1p(0.7 * zeta) + np.sqrt(1 + phi) + 0.3 * phi / (2 + zeta))


def one_test(curve, *names):
    free = {name: FREE[name] for name in names}
    return InverseProblem((Target("t", Curve(DEPTH, curve), 1.0),), {name: TRUTH[name] for name in names}, free, None)


def runs(function, places, slopes=False):
    """Evaluations of a function of zeta and phi at places in units of the ranges."""
    found = []
    for u, v in places:
        point = {"zeta": 20 * u, "phi": 5 * v}
        if not slopes:
            found.append(Evaluation(point, (function(**point),), None, 0.0, ({},)))
            continue
        sides = {name: [function(**{**point, name: point[name] + h}) for h in (1e-6, -1e-6)] for name in point}
        by_name = {name: (a - b) / 2e-6 for name, (a, b) in sides.items()}
        found.append(Evaluation(point, (function(**point),), None, 0.0, ({},), (by_name,)))
    return found


def error(found, function):
    places = np.random.default_rng(5).random((300, 2))
    true = np.array([function(20 * u, 5 * v) for u, v in places])
    return np.sqrt(np.mean((found.curves(places) - true) ** 2))


def test_a_polynomial_is_met_exactly():
    def cubic(zeta, phi):
        return DEPTH * (1 + zeta + 0.1 * zeta * phi - 0.02 * phi**2 * zeta + 0.001 * zeta**3)

    found = learn(one_test(cubic(4.0, 0.7), "zeta", "phi"), runs(cubic, design_points(2, False, 0)))
    assert found.degree == 3
    assert error(found, cubic) < 1e-9 * cubic(20.0, 5.0).max()
    assert found.error < 1e-6


def test_its_slopes_are_the_differences_of_its_curves():
    found = learn(one_test(smooth(4.0, 0.7), "zeta", "phi"), runs(smooth, design_points(2, False, 0)))
    places, h = np.random.default_rng(1).random((5, 2)) * 0.9 + 0.05, 1e-6
    for k in range(2):
        step = h * np.eye(2)[k]
        differences = (found.curves(places + step) - found.curves(places - step)) / (2 * h)
        np.testing.assert_allclose(found.slopes(places)[:, k], differences, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("slopes", [False, True])
def test_the_error_it_states_is_that_of_leaving_each_run_out(slopes, monkeypatch):
    """The oracle fits again without each run."""
    monkeypatch.setattr(polynomials, "SPARE", 1.0)
    whole = one_test(smooth(4.0, 0.7), "zeta", "phi")
    found = learn(whole, runs(smooth, design_points(2, slopes, 0, 3), slopes))
    errors = []
    for n, left in enumerate(found.training):
        rest = found.training[:n] + found.training[n + 1 :]
        again = fit_polynomial(rest, found.fitted.betas, found.degree)
        predicted = polynomials.values(left.place[None], found.fitted.betas, found.degree) @ again.coefficients
        errors.append(np.sqrt(np.sum((predicted[0] - left.curves) ** 2)) * left.weight)
    points = found.training[0].curves.size
    assert found.error == pytest.approx(np.sqrt(np.mean(np.square(errors)) / points), rel=1e-6)


def test_a_widened_problem_stretches_a_range_by_the_runs_near_its_optimum():
    """Curves that go by the reciprocal of a parameter, as those of a limit of stretch, leave nothing right by the usual stretch."""

    def reciprocal(zeta, phi):
        return DEPTH * (1 + 0.5 / (0.02 + zeta) + 0.1 * phi)

    def linear(zeta, phi):
        return DEPTH * (1 + 0.3 * zeta + 0.1 * phi)

    near = np.random.default_rng(3).uniform((0.2, 0.1), (0.35, 0.3), (9, 2))
    places = np.vstack([design_points(2, True, 0), near])
    for function, better in ((reciprocal, True), (linear, False)):
        whole = replace(one_test(function(5.0, 0.7), "zeta", "phi"), warps={"phi": 0.0})
        known_runs = runs(function, places, slopes=True)
        usual = learn(whole, known_runs)
        other = otherwise_stretched(usual, known_runs)
        there = np.random.default_rng(4).uniform((0.2, 0.1), (0.35, 0.3), (50, 2))
        true = np.array([function(20 * u, 5 * v) for u, v in there])
        off, then = (np.abs(known.curves(there) - true).max() for known in (usual, other))
        assert (other.problem.warps.get("zeta", 10.0) > 10.0) == better and other.problem.warps["phi"] == 0.0
        assert then < 0.1 * off if better else then <= off


def test_sensitivities_save_runs():
    """With them, fewer runs are as good: on the same places they make the error less than half."""
    whole = one_test(smooth(4.0, 0.7), "zeta", "phi")
    places = design_points(2, True, 0)
    assert len(places) < 0.75 * len(design_points(2, False, 0))
    plain, enhanced = (learn(whole, runs(smooth, places, slopes)) for slopes in (False, True))
    assert error(enhanced, smooth) < 0.5 * error(plain, smooth)


def test_the_first_runs_determine_a_polynomial_better_than_random_ones():
    def determinant(places):
        A = polynomials.values(places, np.full(2, polynomials.USUAL_BETA), 3)
        return np.linalg.slogdet(A.T @ A)[1]

    chosen = design_points(2, False, 0)
    random = [np.random.default_rng(seed).random(chosen.shape) for seed in range(50)]
    assert determinant(chosen) > max(determinant(places) for places in random) + 3


def test_where_the_nearest_run_failed_it_says_nothing():
    whole = one_test(smooth(4.0, 0.7), "zeta", "phi")
    places = design_points(2, False, 0)
    evaluations = runs(smooth, places)
    broken = [Evaluation({"zeta": 20.0, "phi": phi}, None, "broken", 0.0, ()) for phi in (0.0, 2.5, 5.0)]
    good = [one for one in evaluations if one.parameters["zeta"] < 19]
    found = learn(whole, good + broken)
    inside, outside = found.evaluate([{"zeta": 1.0, "phi": 1.0}, {"zeta": 19.9, "phi": 5.0}])
    assert inside.forces is not None
    assert outside.forces is None


@pytest.mark.parametrize("method", SEARCHES)
def test_a_search_on_the_surrogate_ends_at_the_true_optimum(method):
    """The oracle is Nelder-Mead on equation (1) of the true curves; at most 25 sets of parameters are run."""
    whole, pool = problem(bent(1, 0.3)), Watched(Formula())
    explored = explore(whole, pool, Fit(), SEARCHES[method], SILENT)
    end = polish(whole, pool, explored.search.best, surrogate=explored.surrogate)
    oracle = minimize(
        lambda x: equation_one(whole.tests, formula(*x)) if min(x) >= 0 else 1e9,
        [1.5, 4.0, 0.7], method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-12, "maxiter": 4000},
    )  # fmt: skip
    assert explored.facts.reached
    assert pool.runs / 2 <= 25
    assert end.best.objective <= oracle.fun * (1 + 1e-4)
    assert end.best.parameters["mu"] == pytest.approx(oracle.x[0], rel=0.005)
    assert end.best.parameters["zeta"] == pytest.approx(oracle.x[1], rel=0.02)


def test_the_surrogate_finds_what_the_direct_search_finds():
    whole = problem(bent(2, 0.3))
    ends = []
    for direct in (False, True):
        pool = Watched(Formula())
        options = Fit(population=20, generations=25, direct=True) if direct else Fit()
        solved = methods.global_search(whole, pool, options, SILENT)
        assert ("surrogate" in solved.said) != direct
        ends.append((solved.optimum.best, pool.runs))
    (learnt, cheap), (slow, dear) = ends
    assert cheap < dear / 10
    assert learnt.objective <= slow.objective * (1 + 1e-4)
    assert learnt.parameters["mu"] == pytest.approx(slow.parameters["mu"], rel=0.005)
    assert learnt.parameters["zeta"] == pytest.approx(slow.parameters["zeta"], rel=0.02)


class Sloped(Formula):
    """Two curves of zeta and phi with their sensitivities."""

    def differentiable(self):
        return frozenset({"zeta", "phi"})

    def evaluation(self, point):
        zeta, phi = point["zeta"], point["phi"]
        along, across = DEPTH * (10 + 0.3 * zeta) * (1 + phi * DEPTH), DEPTH * (10 + 8 * np.log1p(0.7 * zeta) + phi)
        of_along = {"zeta": 0.3 * DEPTH * (1 + phi * DEPTH), "phi": DEPTH**2 * (10 + 0.3 * zeta)}
        of_across = {"zeta": DEPTH * 5.6 / (1 + 0.7 * zeta), "phi": DEPTH}
        return Evaluation(point, (along, across), None, 0.0, ({}, {}), (of_along, of_across))


@pytest.mark.parametrize(("truth", "runs_there"), [({"zeta": 2.0, "phi": 0.7}, False), ({"zeta": 19.0, "phi": 4.5}, True)])
def test_the_stiffest_corner_is_run_only_where_the_curves_may_lie(truth, runs_there):
    """The corner costs most (its fibres fold on the way); either way the search ends at the truth."""
    pool, free = Watched(Sloped()), {name: FREE[name] for name in truth}
    explored = explore(problem(Sloped().evaluation(truth).forces, None, free), pool, Fit(), genetic.search, SILENT)
    corners = [known for known in pool.known if (known.parameters["zeta"], known.parameters["phi"]) == (20.0, 5.0)]
    assert bool(corners) == runs_there
    for name, value in truth.items():
        assert explored.search.best.parameters[name] == pytest.approx(value, rel=0.02)


def test_runs_on_another_mesh_are_no_best_run():
    """Made beside the search for the error of the mesh, a run that lay nearer to the curves became the optimum."""
    whole, pool = problem(bent(1, 0.3)), Watched(Formula())

    def on_another_mesh(parameters):
        exact = tuple(test.curve.force for test in whole.tests)
        pool.known.append(Evaluation({**parameters, "mesh.wider": 1.4}, exact, None, 0.0, ({}, {})))

    explored = explore(whole, pool, Fit(), genetic.search, SILENT, on_another_mesh)
    assert sum("mesh.wider" in known.parameters for known in pool.known) == 1
    assert "mesh.wider" not in explored.search.best.parameters
    assert explored.search.best.objective > 0.01


def test_a_rival_is_another_optimum_than_the_best():
    whole, pool = problem(bent(1, 0.3)), Watched(Formula())
    explored = explore(whole, pool, Fit(), genetic.search, SILENT)
    best = whole.units(explored.search.best.parameters)
    assert all(np.abs(whole.units(rival.parameters) - best).max() > 0.05 for rival in explored.rivals)


def test_what_was_held_out_was_not_known():
    """The errors stated are those of predictions: the run of each is no run of the first ones."""
    whole, pool = problem(bent(1, 0.3)), Watched(Formula())
    explored = explore(whole, pool, Fit(), genetic.search, SILENT)
    first = {(e.parameters["zeta"], e.parameters["phi"]) for e in pool.known[:13]}
    for proof in explored.facts.held_out:
        assert (proof.parameters["zeta"], proof.parameters["phi"]) not in first
    last = explored.facts.held_out[-1]
    assert last.error <= last.allowed and last.right


def test_regions_that_fail_do_not_stop_it_and_are_never_its_result():
    pool = Watched(Formula(broken=lambda parameters: parameters["zeta"] > 9 and parameters["phi"] < 2))
    explored = explore(problem(), pool, Fit(), genetic.search, SILENT)
    assert pool.failures
    assert explored.search.best.parameters["zeta"] == pytest.approx(4.0, rel=0.05)
    assert explored.facts.failed == len({(e.parameters["zeta"], e.parameters["phi"]) for e in pool.failures})


def test_many_parameters_are_searched_without_a_surrogate_and_it_is_said():
    """Five coefficients of a polynomial in the depth: linear, so least squares must find them exactly."""
    names, truth = "abcde", [1.0, 2.0, 0.5, 3.0, 1.5]
    powers = np.array([(DEPTH / DEPTH[-1]) ** n for n in range(1, 6)])

    class Linear(Formula):
        def evaluation(self, point):
            return Evaluation(point, (np.array([point[name] for name in names]) @ powers,), None, 0.0, ({},))

    free = {name: Range(start=1.0, min=0.0, max=5.0) for name in names}
    whole = InverseProblem((Target("t", Curve(DEPTH, truth @ powers), 1.0),), dict.fromkeys(names, 1.0), free, None)
    solved = methods.global_search(whole, Watched(Linear()), Fit(), SILENT)
    assert "5 free parameters are many for a surrogate: least squares" in solved.said
    for name, value in zip(names, truth, strict=True):
        assert solved.optimum.best.parameters[name] == pytest.approx(value, abs=1e-3)


def test_several_starts_leave_a_local_optimum_that_one_start_is_caught_in():
    class Wavy(Formula):
        def evaluation(self, point):
            force = DEPTH * (30 + 10 * np.cos(1.2 * point["zeta"]) + point["zeta"])
            return Evaluation(point, (force,), None, 0.0, ({},))

    free = {"zeta": Range(start=2.5, min=0.0, max=20.0)}
    target = DEPTH * (30 + 10 * np.cos(1.2 * 15.8) + 15.8)
    whole = InverseProblem((Target("t", Curve(DEPTH, target), 1.0),), {"zeta": 2.5}, free, None)
    caught = least_squares(whole, Wavy(), whole.start)
    starts = [{"zeta": zeta} for zeta in (2.5, 7.0, 12.0, 16.5)]
    found = multi_start(whole, Wavy(), starts, 2)
    assert caught.best.sum_of_squares > 1e-3
    assert found.best.parameters["zeta"] == pytest.approx(15.8, abs=0.02)


def test_least_squares_with_sensitivities_needs_few_runs():
    """At most twelve sets of parameters, starts included."""

    class Derivable(Formula):
        def differentiable(self):
            return frozenset(TRUTH)

        def evaluate(self, points, report=None, sensitivities=()):
            evaluations = super().evaluate(points)
            return [self.with_slopes(one, sensitivities) for one in evaluations] if sensitivities else evaluations

        def with_slopes(self, one, names):
            point, by_test = one.parameters, [{}, {}]
            for name in names:
                ends = [formula(**{**point, name: point[name] + h}) for h in (1e-6, -1e-6)]
                for test in range(2):
                    by_test[test][name] = (ends[0][test] - ends[1][test]) / 2e-6
            return Evaluation(point, one.forces, None, 0.0, ({}, {}), tuple(by_test))

    pool = Derivable()
    optimum = methods.local_search(problem(bent(1, 0.1)), pool, Fit(), SILENT).optimum
    slow = methods.local_search(problem(bent(1, 0.1)), Formula(), Fit(), SILENT).optimum
    assert optimum.success
    assert len({step.runs for step in optimum.history}) + 4 <= 12
    assert optimum.best.sum_of_squares <= slow.best.sum_of_squares * (1 + 1e-6)
