"""Samples of the posterior: against a density that is known, beside the profiles, and as files."""

import sys

import numpy as np
import pytest
from fixtures.line import DEPTH, DESIGN, Line

pytest.importorskip("emcee")
h5netcdf = pytest.importorskip("h5netcdf")

from fixtures.cases import straight_curve, tiny_case  # noqa: E402

from indentfit.case import Range  # noqa: E402
from indentfit.case.priors import Prior  # noqa: E402
from indentfit.curve import Curve  # noqa: E402
from indentfit.errors import CaseError  # noqa: E402
from indentfit.experiment.measured import read_case  # noqa: E402
from indentfit.inference import joint, sampling  # noqa: E402
from indentfit.inference.density import SLAB, WHITE  # noqa: E402
from indentfit.inference.fit import fit  # noqa: E402
from indentfit.inference.joint import ModelError  # noqa: E402
from indentfit.inference.joint_profiles import joint_profiles  # noqa: E402
from indentfit.inverse.exploration import Watched  # noqa: E402
from indentfit.inverse.objective import Target  # noqa: E402
from indentfit.inverse.problem import InverseProblem  # noqa: E402
from indentfit.inverse.wide import UncertainInput, widened_problem  # noqa: E402
from indentfit.report.posterior_files import corner, write_netcdf  # noqa: E402

NOISE, GAIN = 0.3, 0.03


@pytest.fixture(scope="module")
def force():
    return DESIGN @ [90, 60] + NOISE * np.random.default_rng(3).standard_normal(25)


def fitted(force, inputs=()):
    free = {name: Range(start=50, min=0, max=200) for name in "ab"}
    problem = InverseProblem((Target("t", Curve(DEPTH, force), 1.0),), {"a": 50.0, "b": 50.0}, free, None)
    return joint.joint_fit(widened_problem(problem, inputs), inputs, Watched(Line()), ModelError.none(25), 0)


@pytest.fixture(scope="module")
def plain(force):
    fit = fitted(force)
    return fit, sampling.sampled([fit], [1.0], ["case"], 0)


def regression(force, n=20_000):
    """Draws (n, 2) of a and b with a flat prior of a, b and log sigma: under each correlation of the noise Student's t of 23
    degrees of freedom about generalised least squares, and these in proportion to their evidence and prior probability."""
    rng, logs, draws = np.random.default_rng(0), [], []
    for k, rho in enumerate([0.0, *(1 - (1 - np.exp(-1 / 25)) ** ((np.arange(SLAB) + 0.5) / SLAB))]):
        L = np.linalg.cholesky(rho ** np.abs(np.subtract.outer(np.arange(25), np.arange(25))))
        design = np.linalg.solve(L, DESIGN)
        theta, squares, *_ = np.linalg.lstsq(design, np.linalg.solve(L, force), rcond=None)
        inverse = np.linalg.inv(design.T @ design)
        volume = 0.5 * np.linalg.slogdet(inverse)[1] - np.log(np.diag(L)).sum()
        logs.append(np.log((1 - WHITE) / SLAB if k else WHITE) + volume - 23 / 2 * np.log(squares[0]))
        spread = np.sqrt(squares[0] / rng.chisquare(23, n))[:, None]
        draws.append(theta + spread * rng.standard_normal((n, 2)) @ np.linalg.cholesky(inverse).T)
    shares = np.exp(np.array(logs) - max(logs))
    return np.array(draws)[rng.choice(len(logs), n, p=shares / shares.sum()), np.arange(n)]


def test_the_samples_are_those_of_linear_regression(force, plain):
    """The error of the mean and of the ends of 5,000 correlated draws is a few per cent of a standard error."""
    samples, expected = plain[1], regression(force)
    assert samples.long_enough
    for n, name in enumerate("ab"):
        error = expected[:, n].std()
        assert samples.of(name).mean() == pytest.approx(expected[:, n].mean(), abs=0.15 * error)
        assert samples.of(name).std() == pytest.approx(error, rel=0.08)
        assert samples.interval(name) == pytest.approx(sampling.shortest(expected[:, n]), abs=0.35 * error)


def test_profiles_agree_with_the_samples(plain):
    """Their ends lie close together, and no profile is more than 1.3 times as wide, here and where a gain is uncertain."""
    fit, samples = plain
    paths = joint_profiles(fit)
    facts = sampling.facts_of_samples(samples, {name: tuple(200 * np.array(paths[n].interval)) for n, name in enumerate("ab")})
    assert all(0.9 < ratio < 1.3 for ratio in facts.wider.values())


def test_an_uncertain_gain_widens_the_samples_by_its_own_share(force):
    prior = Prior.about(0.0, GAIN)
    fit = fitted(force, (UncertainInput("force", "", 0, prior, 0.0, *prior.bounds()),))
    samples = sampling.sampled([fit], [1.0], ["case"], 0)
    assert samples.names == ("a", "b", "force (t)")
    squares = np.linalg.lstsq(DESIGN, force, rcond=None)[1]
    noise = np.sqrt(np.linalg.inv(DESIGN.T @ DESIGN)[0, 0] * squares[0] / 21)
    assert samples.of("a").std() == pytest.approx(np.hypot(noise, GAIN * 90), rel=0.12)
    assert samples.of("force (t)").std() == pytest.approx(GAIN, rel=0.12)


def test_alternatives_are_drawn_by_their_probabilities(plain, monkeypatch):
    fit, _ = plain
    monkeypatch.setattr(sampling, "STEPS", 100)
    monkeypatch.setattr(sampling, "MOST_STEPS", 100)
    samples = sampling.sampled([fit, fit], [0.8, 0.2], ["one", "two"], 0)
    assert np.mean(samples.alternative == 1) == pytest.approx(0.2, abs=0.02)


def test_the_files_hold_the_samples(plain, force, tmp_path):
    """The layout of ArviZ: groups with the dimensions chain and draw, and names that Python allows."""
    samples = plain[1]
    write_netcdf(samples, {"t": Curve(DEPTH, force)}, tmp_path / "posterior.nc")
    with h5netcdf.File(tmp_path / "posterior.nc") as file:
        assert set(file.groups) == {"posterior", "sample_stats", "observed_data"}
        known = file["posterior/a"]
        assert known.dimensions == ("chain", "draw")
        np.testing.assert_array_equal(known[...], samples.values[..., 0])
        np.testing.assert_array_equal(file["sample_stats/lp"][...], samples.log_density)
        np.testing.assert_array_equal(file["observed_data/force_t"][...], force)
    figure = corner(samples, tmp_path / "posterior")
    assert len(figure.axes) == 4
    assert (tmp_path / "posterior.png").stat().st_size > 5000


def test_a_case_that_asks_for_samples_without_the_sampler_is_told_at_once(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "emcee", None)
    straight_curve(tmp_path / "parallel.csv", 60)
    path = tiny_case(tmp_path, fit={"posterior": True})
    with pytest.raises(CaseError, match=r"pip install 'indentfit\[posterior\]'"):
        fit(read_case(path))
