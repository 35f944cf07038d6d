"""Joint fits of curves that the law does not follow: they keep to the points, as fits whose inputs are known do."""

from dataclasses import replace

import numpy as np
import pytest
from fixtures.line import DEPTH, DESIGN, Line
from scipy.stats import t as student

from indentfit.case import Range
from indentfit.curve import Curve
from indentfit.inference import joint
from indentfit.inference.draws import drawn
from indentfit.inference.explained import Explained, explained
from indentfit.inference.joint import ModelError
from indentfit.inference.noise import errors
from indentfit.inference.posterior import Mode
from indentfit.inference.wide_fit import WideAlternative, _logs_by_residuals, by_residuals, weighed_alternatives
from indentfit.inverse.exploration import Watched
from indentfit.inverse.objective import Target
from indentfit.inverse.problem import InverseProblem
from indentfit.inverse.wide import widened_problem

APART = np.abs(np.subtract.outer(np.arange(25), np.arange(25)))


def fitted(force, free=("a", "b")):
    ranges = {name: Range(start=50, min=0, max=200) for name in free}
    problem = InverseProblem((Target("t", Curve(DEPTH, force), 1.0),), {"a": 50.0, "b": 0.0}, ranges, None)
    return joint.joint_fit(widened_problem(problem, ()), (), Watched(Line()), ModelError.none(25), 0)


def wave(ends):
    """A smooth misfit of some 1 % of the largest force, as low at the first point as at the last one or not."""
    u = DEPTH / DEPTH[-1]
    return 0.4 * (np.sin(np.pi * u) if ends else u**3) + 0.003 * np.random.default_rng(2).standard_normal(25)


@pytest.mark.parametrize("ends", [True, False])
def test_a_smooth_misfit_leaves_the_fit_at_the_least_squares_and_its_interval_as_wide_as_a_plain_one(ends):
    """A record whose misfit was a hump was fitted through both ends of it, with twice the RMSE of the best fit, and the interval
    left out the plain fit at a stated friction: likelihood of AR(1) noise hears the steps between points, and not their level. The
    plain errors are those of least squares under the noise that the residuals show."""
    force = 90 * DEPTH + wave(ends)
    slopes = DESIGN[:, :1]
    best = float(np.linalg.lstsq(slopes, force, rcond=None)[0][0])
    _, plain = errors([slopes], [slopes[:, 0] * best - force], [1.0])
    half = student.ppf(0.975, plain.freedom[0]) * np.sqrt(plain.covar[0, 0])
    fit = fitted(force, ("a",))
    assert 200 * fit.mode.z[0] == pytest.approx(best, abs=0.02 * half)
    low, high = (200 * end for end in drawn(fit, 0).interval(0))
    assert (low + high) / 2 == pytest.approx(best, abs=0.15 * half)
    assert high - low == pytest.approx(2 * half, rel=0.15)


def alternative(name, force):
    fit = fitted(force, ("a",))
    return WideAlternative(name, {}, 0.5, fit, {}, drawn(fit, 0, 100))


def test_smooth_residuals_tell_alternatives_by_their_size_and_little():
    """A sliding base with residuals of 0.15 and 0.46 mN had the probability 1e-17 beside a bonded one with 0.41 and 0.60 mN,
    since smooth residuals make their own covariance. A misfit that is k times as large, as one of n independent points, makes the
    odds k^-n; the 25 points of a misfit of one hump are 1 to 3."""
    near, far = alternative("near", 90 * DEPTH + wave(True)), alternative("far", 90 * DEPTH + 3 * wave(True))
    assert all(known.fit.posterior.noise.smooth is not None for known in (near, far))
    best, other = weighed_alternatives([far, near])
    assert best.name == "near"
    assert 3 < best.probability / other.probability < 27


def test_smooth_residuals_beside_white_ones_count_as_many_points():
    """An alternative that the curve follows to its noise is certain beside one that leaves ten times as much, smooth."""
    white = alternative("white", 90 * DEPTH + 0.03 * np.random.default_rng(1).standard_normal(25))
    best, _ = weighed_alternatives([alternative("smooth", 90 * DEPTH + wave(True)), white])
    assert best.name == "white" and best.probability > 0.999


def test_an_evidence_for_what_is_twice_as_far_from_the_points_counts_no_more():
    """A wrong base with a misfit of 57 % had the probability 1 beside the right one with 1 %: a stranger's fit ended as no fit."""
    white = [30.0 * DEPTH + size * np.random.default_rng(1).standard_normal(25) for size in (0.03, 0.3)]
    near, far = (alternative(name, force) for name, force in zip(("near", "far"), white, strict=True))
    favoured = replace(far, draws=replace(far.draws, log_evidence=near.draws.log_evidence + 50))
    assert weighed_alternatives([favoured, near])[0].name == "near"


def test_an_alternative_is_no_worse_for_the_doubt_of_its_own_mesh():
    """At 0.1 % noise 3 of 60 spheres lost their bonded base, whose residuals were white and smaller, but whose mesh errs more."""
    white, smooth = (fitted(90 * DEPTH + force, ("a",)) for force in (wave(True) / 100, wave(True)))
    assert white.posterior.noise.smooth is None and smooth.posterior.noise.smooth is not None
    noise = white.posterior.noise
    doubted = replace(white, posterior=replace(white.posterior, noise=replace(noise, model=noise.model + 0.2**2 * np.eye(25))))
    first, second = _logs_by_residuals([white, doubted])
    assert first == pytest.approx(second)
    pair = [WideAlternative(name, {}, 0.5, fit, {}, drawn(fit, 0, 200)) for name, fit in (("white", doubted), ("smooth", smooth))]
    evidences = [replace(known.draws, log_evidence=log, effective=1000.0) for known, log in zip(pair, (64.2, 57.1), strict=True)]
    pair = [replace(known, draws=draws) for known, draws in zip(pair, evidences, strict=True)]
    assert not by_residuals(pair)
    first, second = weighed_alternatives(pair)
    assert first.name == "white" and first.probability > 0.99


def test_white_residuals_add_nothing():
    force = DESIGN @ [90, 60] + 0.3 * np.random.default_rng(3).standard_normal(25)
    assert fitted(force).posterior.noise.smooth is None


def test_noise_that_coordinates_explain_is_independent_of_all_other_noise():
    """Of correlated noise the variances stay in both parts, and generalised least squares is least squares; white noise stays."""
    known = explained(DESIGN * 1e9, np.eye(2))
    noise = known.apart(0.9**APART)
    plane = np.linalg.qr(DESIGN)[0]
    beside = np.linalg.qr(plane, mode="complete")[0][:, 2:]
    np.testing.assert_allclose(plane.T @ noise @ beside, 0, atol=1e-7)
    for part in (plane, beside):
        np.testing.assert_allclose(part.T @ noise @ part, part.T @ 0.9**APART @ part, atol=1e-7)
    general = np.linalg.solve(DESIGN.T @ np.linalg.solve(noise, DESIGN), DESIGN.T @ np.linalg.inv(noise))
    np.testing.assert_allclose(general, np.linalg.pinv(DESIGN), atol=1e-6 * np.abs(general).max())
    np.testing.assert_allclose(known.apart(np.eye(25)), np.eye(25), atol=1e-9)


def test_what_is_known_without_the_test_stays_correlated_with_the_rest():
    """Directions of which the test tells half, or nothing: the covariance stays one, with the same variance in each direction."""
    known = explained(DESIGN * [3.0, 1e-9], np.eye(2))
    assert known.shares[1] == pytest.approx(0, abs=1e-9)
    noise = known.apart(0.9**APART)
    assert np.linalg.eigvalsh(noise).min() > 0
    for direction in known.directions.T:
        assert direction @ noise @ direction == pytest.approx(direction @ 0.9**APART @ direction)
    np.testing.assert_array_equal(Explained.none(25).apart(0.9**APART), 0.9**APART)


def test_of_nearly_equal_places_the_value_is_that_of_the_least_squares():
    """White matter with unknown friction: tests that contradict each other leave their levels nearly free; a place whose chi2 was
    0.6 better lay 1.8 times as far from the points. A place that is better by more than AS_GOOD stays."""
    force = 90 * DEPTH + wave(True)
    best = float(np.linalg.lstsq(DESIGN[:, :1], force, rcond=None)[0][0])
    fit = fitted(force, ("a",))
    assert fit.posterior.noise.smooth is not None
    off = fit.mode.z + 0.02
    for better, first in ((0.6, best), (1.1 * joint.AS_GOOD, 200 * off[0])):
        modes = joint._nearest_first(fit.posterior, [Mode(off, fit.mode.chi2 - better, fit.mode.covar)])
        assert 200 * modes[0].z[0] == pytest.approx(first, rel=1e-3)
