"""Draws of the posterior: against densities that are known, and the intervals that they make."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from fixtures.line import DEPTH, DESIGN, Line
from scipy.optimize import brentq
from scipy.stats import norm, truncnorm
from scipy.stats import t as student

from indentfit.case import Range
from indentfit.case.priors import Prior
from indentfit.curve import Curve
from indentfit.inference import annealed, draws, joint
from indentfit.inference.density import ALIKE, SLAB, WHITE, Density, alike
from indentfit.inference.draws import Draws, drawn, pieces
from indentfit.inference.joint import ModelError
from indentfit.inference.joint_profiles import joint_profiles
from indentfit.inference.posterior import FINEST
from indentfit.inference.wide_fit import WideAlternative, WideFit, pieces_of, reaching, without_slits
from indentfit.inverse.exploration import Watched
from indentfit.inverse.objective import Target
from indentfit.inverse.problem import InverseProblem
from indentfit.inverse.wide import UncertainInput, widened_problem
from indentfit.runs.forward import Evaluation

NOISE, GAIN = 0.3, 0.03
T23 = 2.0687  # 97.5 % quantile of Student's t of 23 degrees of freedom


class Off(Line):
    """The same, off by a part of a curve's largest force (root mean square) in the shape of b's own share."""

    def __init__(self, share):
        self.share = share

    def evaluate(self, points, report=None, sensitivities=()):
        shape = DESIGN[:, 1] / np.sqrt(np.mean(DESIGN[:, 1] ** 2))
        exact = super().evaluate(points)
        return [replace(known, forces=(known.forces[0] + self.share * np.abs(known.forces[0]).max() * shape,)) for known in exact]


class Twice(Line):
    """Two tests, both a d."""

    def evaluate(self, points, report=None, sensitivities=()):
        exact = super().evaluate([{**point, "b": 0.0} for point in points])
        return [replace(known, parameters=dict(point), forces=2 * known.forces) for point, known in zip(points, exact, strict=True)]


def measured(a=90.0, b=60.0):
    return DESIGN @ [a, b] + NOISE * np.random.default_rng(3).standard_normal(25)


def fitted(force, inputs=(), most=200.0):
    free = {name: Range(start=50, min=0, max=most) for name in "ab"}
    problem = InverseProblem((Target("t", Curve(DEPTH, force), 1.0),), {"a": 50.0, "b": 50.0}, free, None)
    return joint.joint_fit(widened_problem(problem, inputs), inputs, Watched(Line()), ModelError.none(25), 0)


@pytest.fixture(scope="module")
def line():
    fit = fitted(measured())
    return fit, drawn(fit, 0)


def regression(force):
    """Least squares of a and b, the inverse of the normal matrix, and the sum of squares."""
    theta, squares, *_ = np.linalg.lstsq(DESIGN, force, rcond=None)
    return theta, np.linalg.inv(DESIGN.T @ DESIGN), float(squares[0])


def test_the_intervals_are_those_of_linear_regression(line):
    """With a flat prior of a, b and log sigma, each is Student's t of 23 degrees of freedom about least squares. Two seeds differ
    by what 3,000 effective draws leave: some 3 % of a standard error in the mean, and 7 % at each end."""
    fit, known = line
    theta, inverse, squares = regression(measured())
    assert known.enough
    for draw in (known, drawn(fit, 5)):
        for n in range(2):
            error = np.sqrt(inverse[n, n] * squares / 23)
            low, high = (200 * end for end in draw.interval(n))
            assert (low, high) == pytest.approx((theta[n] - T23 * error, theta[n] + T23 * error), abs=0.3 * error)
            assert high - low == pytest.approx(2 * T23 * error, rel=0.06)


def test_ranges_that_are_far_wider_than_the_interval_leave_it_as_it_is():
    """A newcomer's bead had a range up to 10,000 kPa, a modulus of 0.68 kPa, and an interval that ended at its own value: draws
    began 100 ranges of the interval away, and profiles were walked in steps as wide as the interval."""
    theta, inverse, squares = regression(measured())
    fit = fitted(measured(), most=2e7)
    known, paths = drawn(fit, 0), joint_profiles(fit)
    assert known.enough
    for n in range(2):
        error = np.sqrt(inverse[n, n] * squares / 23)
        expected = pytest.approx((theta[n] - T23 * error, theta[n] + T23 * error), abs=0.3 * error)
        assert tuple(2e7 * end for end in known.interval(n)) == expected
        assert tuple(2e7 * end for end in paths[n].interval) == expected


def test_an_optimum_is_proved_to_the_waves_of_computed_curves(monkeypatch):
    """A newcomer's bead, a curve without any noise, was "not proved": runs were asked to agree better with their prediction than
    they do from place to place."""
    fit = fitted(DESIGN @ [90.0, 60.0])
    monkeypatch.setattr(joint, "RIGHT", 0.01)  # as if the curves told the parameters thirty times as well
    right = [joint.proved(fit, Watched(Off(share)))[0].right for share in (0.9 * FINEST, 1.1 * FINEST)]
    assert right == [True, False]


def test_the_same_seed_gives_the_same_draws(line):
    np.testing.assert_array_equal(drawn(line[0], 0).shares, line[1].shares)


def test_the_evidence_is_that_of_linear_regression_under_every_correlation(line):
    """Under each correlation of the noise the curve and the design are whitened, the integral over a and b is that of a normal
    density, and that over log sigma is done here on a grid. White noise has the prior probability WHITE; the others, SLAB steps to
    exp(-1 / 25), even in the logarithm of 1 - rho, share the rest. The bounds of the ranges are many standard errors away."""
    most, u = measured().max(), np.linspace(0, 1, 20001)
    sigma, logs = np.exp(np.log(FINEST * most) + u * -np.log(FINEST)), []
    for n, rho in enumerate([0.0, *(1 - (1 - np.exp(-1 / 25)) ** ((np.arange(SLAB) + 0.5) / SLAB))]):
        L = np.linalg.cholesky(rho ** np.abs(np.subtract.outer(np.arange(25), np.arange(25))))
        design, force = np.linalg.solve(L, DESIGN), np.linalg.solve(L, measured())
        squares = np.linalg.lstsq(design, force, rcond=None)[1][0]
        volume = np.log(2 * np.pi * sigma**2) - 0.5 * np.linalg.slogdet(design.T @ design)[1] - np.log(np.diag(L)).sum()
        logs.append(np.log((1 - WHITE) / SLAB if n else WHITE) - 25 * np.log(sigma) - squares / (2 * sigma**2) + volume)
    exact = np.log(np.trapezoid(np.exp(np.array(logs) - np.max(logs)).sum(axis=0), u)) + np.max(logs) - 2 * np.log(200)
    assert line[1].log_evidence == pytest.approx(exact, abs=0.1)
    few = [drawn(line[0], seed, 400).log_evidence for seed in range(1, 4)]  # those of the particles' levels are up to 1 off
    np.testing.assert_allclose(few, exact, atol=0.1)


def test_an_uncertain_gain_widens_the_interval_by_its_own_share():
    prior = Prior.about(0.0, GAIN)
    fit = fitted(measured(), (UncertainInput("force", "", 0, prior, 0.0, *prior.bounds()),))
    known, (theta, inverse, squares) = drawn(fit, 0), regression(measured())
    half = 1.96 * np.hypot(np.sqrt(inverse[0, 0] * squares / 21), GAIN * theta[0])
    low, high = (200 * end for end in known.interval(0))
    assert high - low == pytest.approx(2 * half, rel=0.07)


def test_a_parameter_at_its_bound_has_an_interval_that_begins_there():
    """b is 0: the density is that of Student's t right of 0, and the smallest set that holds 95 % of it begins at 0 itself."""
    force = DESIGN @ [90, 0] + NOISE * np.random.default_rng(4).standard_normal(25)
    theta, inverse, squares = regression(force)
    known = student(23, theta[1], np.sqrt(inverse[1, 1] * squares / 23))
    end = known.ppf(known.cdf(0) + 0.95 * known.sf(0))
    assert known.pdf(end) < known.pdf(0)
    low, high = drawn(fitted(force), 0).interval(1)
    assert low == 0.0
    assert 200 * high == pytest.approx(end, rel=0.07)


def test_the_density_with_errors_of_the_model_is_that_of_their_covariance(line):
    """A smooth error of 1 % of the forces, against the logarithm of a normal density of 25 forces, at places where sigma and the
    correlation differ; only differences between places count. Correlated noise keeps 1 / sqrt(1 + s^2) of its correlations between
    what is at right angles to the design and a direction of the design that is known s times as well by the curve as by the range
    (`inference.explained`), whose variance is 1/12, as that of an even density."""
    fit, _ = line
    smooth = 0.01**2 * np.exp(-(np.subtract.outer(DEPTH, DEPTH) ** 2) / 0.02) * np.outer(measured(), measured())
    noise = replace(fit.posterior.noise, model=smooth)
    density = Density(replace(fit, posterior=replace(fit.posterior, noise=noise)))
    least, step = 1 - np.exp(-1 / 25), (1 - WHITE) / SLAB
    places = np.array([[0.45, 0.3, 0.6, 0.1], [0.44, 0.31, 0.8, 0.1], [0.4, 0.5, 0.5, WHITE + 2.4 * step], [0.4, 0.5, 0.5, 0.999]])
    logs = []
    for place, rho in zip(places, [0.0, 0.0, 1 - least ** (2.5 / SLAB), 1 - least ** (1 - 0.5 / SLAB)], strict=True):
        sigma = density.sigma(place)[0]
        turn, known, _ = np.linalg.svd(DESIGN * 200 / np.sqrt(12) / fit.posterior.noise.sigma[0])
        angles = np.append(np.arctan(known), np.zeros(23))
        turned = turn.T @ rho ** np.abs(np.subtract.outer(np.arange(25), np.arange(25))) @ turn
        turned *= np.cos(np.subtract.outer(angles, angles))
        covar = smooth + sigma**2 * turn @ turned @ turn.T
        left = DESIGN @ (200 * place[:2]) - measured()
        logs.append(-0.5 * (left @ np.linalg.solve(covar, left) + np.linalg.slogdet(covar)[1]))
    assert density(places) - density(places)[0] == pytest.approx(np.array(logs) - logs[0], rel=1e-3, abs=1e-3)


def test_noises_of_tests_are_alike_before_the_curves_speak():
    """Of three tests each noise is white with the probability WHITE; that of a second one depends on the first."""
    kinds = np.array(list(itertools.product(range(SLAB + 1), repeat=3)))
    alone = np.where(kinds > 0, (1 - WHITE) / SLAB, WHITE).prod(axis=1)
    share = alone * np.exp(alike(kinds == 0))
    white = kinds == 0
    assert share.sum() == pytest.approx(1)
    for n in range(3):
        assert share @ white[:, n] == pytest.approx(WHITE)
    both = share @ (white[:, 0] & white[:, 1])
    assert both == pytest.approx(ALIKE * WHITE + (1 - ALIKE) * WHITE**2)
    np.testing.assert_allclose(alike(white[:, :1]), 0, atol=1e-12)


def test_a_noise_that_looks_white_is_less_surely_so_beside_a_correlated_one():
    """Two tests, both a d; the noise of the second is the same white one in both fits, that of the first is surely white or not.
    The odds of the second's are 0.85 to 0.15 and 0.05 to 0.95 before its curve speaks: 107 times apart, if a stays where it is."""
    rng, shares = np.random.default_rng(5), []
    white = NOISE * rng.standard_normal(25)
    for other in (NOISE * rng.standard_normal(25), 2 * NOISE * np.sin(30 * DEPTH)):
        tests = [Target(name, Curve(DEPTH, 90 * DEPTH + noise), 0.5) for name, noise in zip("tu", (other, white), strict=True)]
        free = {"a": Range(start=50, min=0, max=200)}
        problem = InverseProblem(tuple(tests), {"a": 50.0}, free, None)
        fit = joint.joint_fit(widened_problem(problem, ()), (), Watched(Twice()), ModelError.none(50), 0)
        known = drawn(fit, 0)
        shares.append(known.shares @ (Density(fit).rho(known.places)[:, 1] > 0))
    first, second = (share / (1 - share) for share in shares)
    assert shares[0] < 0.05
    assert 30 < second / first < 300


# Sets of draws


def normal(mean, sd, n=20_000):
    """Draws that are a normal density: its quantiles."""
    values = norm.ppf((np.arange(n) + 0.5) / n, mean, sd)[:, None]
    return Draws(values, np.full(n, 1 / n), float(n), 0.0)


def test_the_smallest_set_of_a_mixture():
    """Two normal densities of equal width, 0.7 and 0.3: by the density at which 95 % are inside, by SciPy."""

    def inside(level):
        reach = [0.02 * np.sqrt(max(-2 * np.log(level / share), 0)) for share in (0.7, 0.3)]
        return sum(share * (2 * norm.cdf(r / 0.02) - 1) for share, r in zip((0.7, 0.3), reach, strict=True)) - 0.95

    level = brentq(inside, 1e-4, 0.29)
    reach = [0.02 * np.sqrt(-2 * np.log(level / share)) for share in (0.7, 0.3)]
    found = pieces([normal(0.3, 0.02), normal(0.7, 0.02)], [0.7, 0.3], 0)
    np.testing.assert_allclose(found, [(0.3 - reach[0], 0.3 + reach[0]), (0.7 - reach[1], 0.7 + reach[1])], atol=1.5e-3)


def test_weights_count_and_a_flat_density_is_one_piece():
    rng = np.random.default_rng(1)
    flat = rng.random((3000, 1))
    (found,) = pieces([Draws(flat, np.full(3000, 1 / 3000), 3000.0, 0.0)], [1.0], 0)
    assert 0.94 < found[1] - found[0] <= 1  # many sets hold 95 % of it: the gaps between the draws' own are no gaps
    shares = norm.pdf(flat[:, 0], 0.5, 0.1)
    shares /= shares.sum()
    (found,) = pieces([Draws(flat, shares, float(1 / np.sum(shares**2)), 0.0)], [1.0], 0)
    assert found == pytest.approx((0.304, 0.696), abs=0.02)


def test_a_set_that_reaches_into_a_flat_tail_holds_no_more_than_its_share():
    """0.9 even between 0.4 and 0.45, and a tail of 0.1 even between 0.45 and 1: the smallest set reaches half into the tail,
    to 0.725. Draws make dips in the tail; joined at the level of the cells alone, sets held 96.5 % in the mean, 95.6 % now."""
    held = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        values = np.where(rng.random(2500) < 0.9, rng.uniform(0.4, 0.45, 2500), rng.uniform(0.45, 1, 2500))[:, None]
        parts = pieces([Draws(values, np.full(2500, 1 / 2500), 2500.0, 0.0)], [1.0], 0)
        held.append(np.mean(np.any([(values >= low) & (values <= high) for low, high in parts], axis=0)))
    assert 0.945 < np.mean(held) < 0.96


def test_an_interval_follows_a_far_wider_profile_by_little(line):
    fit, known = line
    paths = {0: replace(joint_profiles(fit, [0])[0], interval=(0.0, 1.0))}
    ((low, high),) = pieces_of([WideAlternative("case", {}, 1.0, fit, paths, known)], 0)
    own = known.interval(0)
    assert high - low == pytest.approx(1.28 * (own[1] - own[0]), rel=1e-6)


def test_too_few_effective_draws_leave_the_interval_to_the_profile(line):
    fit, known = line
    paths = joint_profiles(fit)
    whole = fit.posterior.curves.problem
    many, few = (
        WideFit(whole, (WideAlternative("case", {}, 1.0, fit, paths, each),), fit.error, None)
        for each in (known, replace(known, effective=draws.ENOUGH - 1))
    )
    assert many.by_draws
    assert not few.by_draws
    np.testing.assert_allclose(few.pieces(0), 200 * np.array([paths[0].interval]), rtol=1e-9)
    (own,), (reported,) = 200 * np.array([known.interval(0)]), many.pieces(0)
    assert reported[0] <= own[0] < own[1] <= reported[1]
    assert reported[1] - reported[0] < 1.05 * (own[1] - own[0])  # the density is nearly normal: profiles allow no more


def test_a_truth_where_a_prior_ends_is_inside():
    """The curve is (1 - s) a d with a share s that is uniform between 0 and 0.2, and a = 90 where s is 0: the posterior of a is
    uniform between 90 and 112.5 but for the noise, its 95 % set leaves out the end or not, by chance, and the profile holds it.
    A set of 95 % of it is at least 21.375 wide."""
    force = 90 * DEPTH + 0.05 * np.random.default_rng(2).standard_normal(25)
    prior = Prior(uniform=(-0.2, 0.0))
    free = {"a": Range(start=100, min=0, max=200)}
    problem = InverseProblem((Target("t", Curve(DEPTH, force), 1.0),), {"a": 100.0, "b": 0.0}, free, None)
    inputs = (UncertainInput("force", "", 0, prior, 0.0, *prior.bounds()),)
    fit = joint.joint_fit(widened_problem(problem, inputs), inputs, Watched(Line()), ModelError.none(25), 0)
    known = WideAlternative("case", {}, 1.0, fit, joint_profiles(fit), drawn(fit, 0))
    ((low, high),) = WideFit(problem, (known,), fit.error, None).pieces(0)
    assert low < 90
    assert 90 + 21.375 < high < 114


def test_few_runs_leave_the_surrogate_an_error_of_any_smooth_shape(line):
    """Three errors of 1 % that rise in proportion to the depth: the next error has the variance of Student's t whose scale three
    runs and three supposed ones tell, 6 / 4 of theirs, and may have a shape that none of them had; many runs leave it alone."""
    rise = 0.01 * (DEPTH / DEPTH[-1])
    error = replace(line[0].error, surrogate=np.outer(rise, rise), runs=3.0)
    problem = line[0].posterior.curves.problem
    covar = joint.next_error(error, problem)
    assert np.trace(covar) == pytest.approx(6 / 4 * rise @ rise)
    assert np.linalg.eigvalsh(np.outer(rise, rise))[-2] == pytest.approx(0, abs=1e-12)
    assert np.linalg.eigvalsh(covar)[-2] > 0.1 * np.linalg.eigvalsh(covar)[-1]
    many = joint.next_error(replace(error, runs=1e6), problem)
    np.testing.assert_allclose(many, np.outer(rise, rise), atol=1e-9)


def test_the_interval_reaches_to_the_optimum():
    assert reaching([(0.1, 0.2), (0.5, 0.6)], 0.45) == ((0.1, 0.2), (0.45, 0.6))
    assert reaching([(0.1, 0.2)], 0.15) == ((0.1, 0.2),)


def test_narrow_gaps_between_pieces_are_filled_and_wide_ones_kept():
    """A fit once gave 1.180-1.216 or 1.218-1.219 or 1.221-1.225 for one parameter."""
    assert without_slits([(1.180, 1.216), (1.218, 1.219), (1.221, 1.225)]) == ((1.180, 1.225),)
    assert without_slits([(0.5, 0.6), (0.1, 0.2)]) == ((0.1, 0.2), (0.5, 0.6))


class Bent:
    """mu (0.2 + b)^2 d: one curve tells a bent line of mu and b, as it does of a modulus and an unknown friction."""

    runs, failures = 0, ()

    def differentiable(self):
        return frozenset()

    def evaluate(self, points, report=None, sensitivities=()):
        self.runs += len(points)
        return [Evaluation(dict(p), (p["mu"] * (0.2 + p["b"]) ** 2 * DEPTH,), None, 0.0, ({},)) for p in points]


def bent_fit(name, prior, unit=""):
    """A joint fit of mu, the scale, and b, with an uncertain input of the test."""
    force = 90 * 0.7**2 * DEPTH + 0.02 * np.random.default_rng(8).standard_normal(25)
    free = {"mu": Range(start=60, min=0, max=1000), "b": Range(start=0.5, min=0, max=1)}
    inputs = (UncertainInput(name, "", 0, prior, 0.0, *prior.bounds(), unit),)
    problem = InverseProblem((Target("t", Curve(DEPTH, force), 1.0),), {"mu": 60.0, "b": 0.5}, free, "mu")
    return joint.joint_fit(widened_problem(problem, inputs), inputs, Watched(Bent()), ModelError.none(25), 0)


@pytest.fixture(scope="module")
def bent():
    """The contact point is uncertain by 0.003 mm."""
    return bent_fit("offset", Prior.about(0.0, 0.003), "mm")


def test_draws_follow_a_bent_line_from_end_to_end(bent):
    """The marginal density of b under white noise, by quadrature over mu, the contact point and the noise's size. The line goes
    from end to end of b's range while mu falls from 1000 to 30, and is as thin as the noise of 0.1 %."""
    known, density = [drawn(bent, seed) for seed in range(2)], Density(bent)
    b, off, sigma = np.linspace(0.0125, 0.9875, 40), np.linspace(0.2, 0.8, 7), np.linspace(0.3, 0.7, 9)
    logs = []
    for middle in b:
        best = 90 * 0.7**2 / (0.2 + middle) ** 2 / 1000
        mu = best * np.linspace(0.97, 1.03, 25)
        grid = np.array([(m, middle, o, s, WHITE / 2) for m, o, s in itertools.product(mu, off, sigma)])
        values = density(grid)
        logs.append(np.log(np.sum(np.exp(values - values.max()))) + values.max() + np.log(best))
    shares = np.exp(np.array(logs) - max(logs))
    exact = np.interp([0.1, 0.5, 0.9], np.cumsum(shares) / shares.sum(), b + 0.0125)
    whites = [of_seed.places[of_seed.places[:, -1] < WHITE] for of_seed in known]
    assert all(of_seed.enough for of_seed in known)
    assert np.mean([np.quantile(white[:, 1], [0.1, 0.5, 0.9]) for white in whites], axis=0) == pytest.approx(exact, abs=0.03)


def test_slopes_by_scale_and_contact_point_are_those_of_the_curves(bent):
    density = Density(bent)
    z = np.array([[0.05, 0.6, 0.5], [0.2, 0.1, 0.55]])
    shapes = density.shapes(z)[0]
    forces, slopes = density.moved_with_slopes(shapes, z)
    assert density.linear == [0, 2]
    np.testing.assert_allclose(forces, density.forces(z)[0], rtol=1e-12)
    for k, n in enumerate(density.linear):
        step = np.where(np.arange(3) == n, 1e-4, 0.0)
        expected = (density.forces(z + step)[0] - density.forces(z - step)[0]) / 2e-4
        np.testing.assert_allclose(slopes[:, k], expected, atol=2e-3 * np.abs(expected).max())


@pytest.mark.parametrize("prior", [Prior(uniform=(-0.2, 0.0)), Prior.about(0.0, 0.06)])
def test_a_gain_leaves_the_scale_its_range(prior):
    """Scale and gain do the same to a curve. As the noise vanishes, the density of mu and b is that of the gain at which the curve
    is met, over mu (0.2 + b)^2. Drawn one after the other within their ranges, they left particles where they were."""
    known = drawn(bent_fit("force", prior), 0)
    mu, b = np.linspace(0.5, 999.5, 1000)[:, None], np.linspace(0.0005, 0.9995, 1000)
    met = mu * (0.2 + b) ** 2
    gain = 90 * 0.7**2 / met - 1
    shares = _density(prior, gain) / met
    exact = np.interp([0.1, 0.5, 0.9], np.cumsum(shares.sum(axis=1)) / shares.sum(), mu[:, 0])
    assert known.enough
    assert np.quantile(known.places[:, 0], [0.1, 0.5, 0.9]) == pytest.approx(exact / 1000, rel=0.15)


def _density(prior, gain):
    return ((gain > -0.2) & (gain < 0)).astype(float) if prior.spread is None else np.exp(-0.5 * (gain / prior.spread) ** 2)


def test_particles_that_do_not_move_are_too_few_draws():
    places = np.random.default_rng(0).random((300, 3))
    assert annealed._distinct(np.tile(places, (12, 1))) == pytest.approx(300)
    assert annealed._distinct(np.tile(places[:1], (12_000, 1))) == pytest.approx(1)


@pytest.mark.parametrize("middle", [-0.3, -0.1, 0.4, 1.2])
def test_truncated_normal_draws_keep_their_density_far_from_the_range(middle):
    """Ends that are 30 sizes from the middle had no digits left."""
    centre, root = np.full((2000, 1), middle), np.full((2000, 1, 1), 0.01)
    x = annealed._truncated(centre, root, np.random.default_rng(0))
    known = truncnorm(-middle / 0.01, (1 - middle) / 0.01, middle, 0.01)
    np.testing.assert_allclose(annealed._log_truncated(x, centre, root), known.logpdf(x[:, 0]), rtol=1e-6)
    assert np.mean(x) == pytest.approx(known.mean(), abs=4 * known.std() / np.sqrt(2000))


def test_a_scale_of_zero_has_the_slope_of_the_shapes(bent):
    density, z = Density(bent), np.array([[0.0, 0.6, 0.5]])
    shapes = density.shapes(z)[0]
    np.testing.assert_allclose(
        density.moved_with_slopes(shapes, z)[1][0, 0], density.forces(np.array([[1.0, 0.6, 0.5]]))[0][0], rtol=1e-12
    )


class Hertzian:
    """mu d^1.5 (1 + b d) from the depth that the contact point leaves: a late contact point bends the curve."""

    runs, failures = 0, ()
    depth = np.linspace(0.06, 1.2, 20)

    def differentiable(self):
        return frozenset()

    def evaluate(self, points, report=None, sensitivities=()):
        self.runs += len(points)
        return [Evaluation(dict(p), (self.force(**p),), None, 0.0, ({},)) for p in points]

    @classmethod
    def force(cls, mu, b, late=0.0):
        d = np.maximum(cls.depth - late, 0.0)
        return mu * d**1.5 * (1 + b * d)


@pytest.mark.parametrize("late", [0.056, -0.045])
def test_a_contact_point_far_from_its_prior_leaves_no_particle_behind(late):
    """The slopes by the contact point were those at its centre: a few particles, far from what the others drew, never moved again,
    and 2 of 13 spheres over unknown rigs had 3 to 114 effective draws."""
    rng, prior = np.random.default_rng(4), Prior.about(0.0, 0.036)
    force = Hertzian.force(90, 0.3, late)
    force = force + 0.001 * force.max() * rng.standard_normal(20)
    free = {"mu": Range(start=60, min=0, max=400), "b": Range(start=0.5, min=0, max=1)}
    inputs = (UncertainInput("offset", "", 0, prior, 0.0, *prior.bounds(), "mm"),)
    problem = InverseProblem((Target("t", Curve(Hertzian.depth, force), 1.0),), {"mu": 60.0, "b": 0.5}, free, "mu")
    fit = joint.joint_fit(widened_problem(problem, inputs), inputs, Watched(Hertzian()), ModelError.none(20), 0)
    known = [drawn(fit, seed) for seed in range(3)]
    assert all(each.enough for each in known)
    evidences = [each.log_evidence for each in known]
    assert max(evidences) - min(evidences) < 0.5
