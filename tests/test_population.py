"""Samples as one population: means and spreads without noise, against closed forms; and the command on synthetic samples."""

import csv
import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner
from fixtures.cases import tiny_case
from scipy.integrate import trapezoid
from scipy.stats import norm, t

from indentfit.cli import main
from indentfit.curve import Curve, write_curve
from indentfit.errors import RecordError
from indentfit.experiment.measured import read_case
from indentfit.experiment.specimens import read_groups
from indentfit.inference.population import USUAL, WIDEST, Predicted, SampleDraws, hierarchy, pooled_sd
from indentfit.inference.sample_density import SampleDensity
from indentfit.report.population import contrast_rows, words
from indentfit.report.schema import read_result
from indentfit.runs.forward import simulate


def samples_of(logs, error, groups=None):
    """Samples whose curves determine the logarithm of one parameter with a normal error."""
    found = []
    for n, log in enumerate(logs):
        values = np.exp(log + error * norm.ppf((np.arange(4000) + 0.5) / 4000))[:, None]
        shares = values[:, 0] / values.sum()  # draws that are even in the logarithm: uniform in the value they weigh as the value
        found.append(SampleDraws.of(f"s{n}", groups[n] if groups else "all", values, shares, n))
    return found


def spread_logs(number, sd, seed=0):
    """Numbers with exactly this mean 0 and standard deviation."""
    logs = np.random.default_rng(seed).standard_normal(number)
    return sd * (logs - logs.mean()) / logs.std(ddof=1)


def test_without_noise_the_interval_of_the_mean_is_that_of_students_t_and_the_spread_is_the_plain_one():
    found = hierarchy(samples_of(np.log(2.0) + spread_logs(12, 0.2), 1e-3), {"mu": "kPa"}, {}, "all", 0).parameters["mu"]
    half = t.ppf(0.975, 10) * 0.2 * np.sqrt(11 / 10) / np.sqrt(12)  # uniform in the spread: one degree less than n - 1
    assert found.mean["all"].value == pytest.approx(2.0 * np.exp(0.02), rel=0.01)
    assert np.log(found.mean["all"].interval[1] / found.mean["all"].interval[0]) == pytest.approx(2 * half, rel=0.1)
    assert found.sd.value == pytest.approx(0.2, rel=0.1)
    assert found.sd.interval[0] < 0.17 and 0.28 < found.sd.interval[1] < 0.42


def exact_ends(groups, error):
    """95 % ends of each group's mean and of the spread by quadrature over the standard deviation, given which the means are normal:
    means normal about the mean of all logarithms with WIDEST, standard deviations half normal with USUAL and at most WIDEST."""
    sds, centre, ends = np.geomspace(1e-5, WIDEST, 20001), np.mean(np.concatenate(groups)), (0.025, 0.975)
    variance, logs, given = sds**2 + error**2, np.log(sds) - 0.5 * (sds / USUAL) ** 2, []
    for group in groups:
        precision = len(group) / variance + 1 / WIDEST**2
        mean = (np.sum(group) / variance + centre / WIDEST**2) / precision
        squares = np.sum(np.square(group)) / variance + (centre / WIDEST) ** 2 - mean**2 * precision
        logs = logs - 0.5 * (len(group) * np.log(variance) + np.log(precision) + squares)
        given.append((mean + sds**2 / 2, precision**-0.5))
    shares = np.exp(logs - logs.max())
    shares, x = shares / shares.sum(), np.linspace(-8, 20, 1401)
    means = [np.exp(np.interp(ends, [shares @ norm.cdf(at, *pair) for at in x], x)) for pair in given]
    return means, np.interp(ends, np.cumsum(shares), np.sqrt(np.expm1(sds**2)))


@pytest.mark.parametrize(
    "groups",
    [
        [[-0.26, 0.0, 0.26]],
        [[-0.26, -0.09, 0.09, 0.26]],
        [[-0.26, 0.0, 0.26], [0.4, 0.7, 0.95]],
        [[-0.3, 0.0, 0.2], [0.6], [1.0, 1.2]],
    ],
)
def test_few_samples_have_the_intervals_of_a_quadrature(groups):
    names = [str(n) for n, group in enumerate(groups) for _ in group]
    known = hierarchy(samples_of(np.concatenate(groups), 0.02, names), {"mu": "kPa"}, {}, "0", 0).parameters["mu"]
    means, spread = exact_ends(groups, 0.02)
    assert known.sd.interval == pytest.approx(spread, rel=0.05)
    for group, mean in zip(known.mean.values(), means, strict=True):
        assert group.interval == pytest.approx(mean, rel=0.05)


def test_noise_is_not_counted_as_variability():
    """Samples that differ by no more than their own noise have hardly a spread, whatever the plain standard deviation is."""
    logs = spread_logs(12, 0.2)
    noisy = hierarchy(samples_of(logs, 0.2), {"mu": "kPa"}, {}, "all", 0).parameters["mu"].sd
    assert pooled_sd(np.exp(logs), ["all"] * 12) == pytest.approx(0.2, rel=0.1)
    assert noisy.interval[0] < 0.02 and noisy.value < 0.12
    partly = hierarchy(samples_of(logs, 0.12), {"mu": "kPa"}, {}, "all", 0).parameters["mu"].sd
    assert partly.value == pytest.approx(0.16, abs=0.03)  # sqrt(0.2^2 - 0.12^2)


def test_samples_that_say_little_are_drawn_to_the_mean():
    logs = np.append(spread_logs(11, 0.05), 0.5)
    samples = samples_of(logs[:11], 0.01) + samples_of([0.5], 0.5)
    shrunken = hierarchy(
        [*samples[:11], SampleDraws("far", "all", samples[11].logs, samples[11].weights)], {"mu": "kPa"}, {}, "all", 0
    )
    assert abs(np.log(shrunken.shrunken["far"]["mu"].value)) < 0.1
    assert shrunken.shrunken["s3"]["mu"].value == pytest.approx(np.exp(logs[3]), rel=0.01)


def test_groups_have_means_of_their_own_and_a_contrast_with_the_reference():
    logs = np.concatenate([spread_logs(8, 0.2), np.log(1.8) + spread_logs(8, 0.2, 1)])
    groups = ["control"] * 8 + ["treated"] * 8
    found = hierarchy(samples_of(logs, 0.02, groups), {"mu": "kPa"}, {}, "control", 0)
    (contrast,) = found.contrasts
    assert (contrast.group, contrast.reference) == ("treated", "control")
    assert contrast.ratio.value == pytest.approx(1.8, rel=0.03) and contrast.above > 0.99
    assert contrast.ratio.interval[0] < 1.8 < contrast.ratio.interval[1]
    assert found.parameters["mu"].sd.value == pytest.approx(0.2, rel=0.15)


def test_an_error_that_all_samples_share_widens_the_mean_and_not_the_spread():
    samples = samples_of(spread_logs(12, 0.05), 0.01)
    alone, shared = (hierarchy(samples, {"mu": "kPa"}, {"mu": sd}, "all", 0).parameters["mu"] for sd in (0.0, 0.1))
    width = [np.log(known.mean["all"].interval[1] / known.mean["all"].interval[0]) for known in (alone, shared)]
    assert width[1] == pytest.approx(np.hypot(width[0], 2 * 1.96 * 0.1), rel=0.1)
    assert shared.sd == alone.sd


def test_an_error_that_all_samples_share_is_in_the_interval_of_each_sample():
    """The samples' own curves are exact, so that the shared error of 10 % is all that is left."""
    shrunken = hierarchy(samples_of(spread_logs(12, 0.3), 1e-3), {"mu": "kPa"}, {"mu": 0.1}, "all", 0).shrunken
    widths = [np.log(known["mu"].interval[1] / known["mu"].interval[0]) for known in shrunken.values()]
    assert widths == pytest.approx([2 * 1.96 * 0.1] * 12, rel=0.1)


class Straight:
    """Curves of a law of one parameter between 0 and 10: the forces are the parameter and 1."""

    names, size, scanned, moves = ("mu",), 1, 2048, ()

    def forces(self, places):
        return np.column_stack([10 * places[:, 0], np.ones(len(places))])

    def log_prior(self, places):
        return np.where((places[:, 0] >= 0) & (places[:, 0] <= 1), 0.0, -np.inf)

    def scaled(self, places, target, weights):
        return places

    def values(self, places):
        return 10 * places

    def start(self):
        return np.full(1, 0.5)


class Gaussian:
    """Noise of a known size, of the first force."""

    def __init__(self, measured, sigma):
        self.measured, self.sigma = np.array([measured, 1.0]), sigma
        self.tests = (SimpleNamespace(rows=np.arange(2)),)

    def log_likelihood(self, forces):
        return -0.5 * ((forces[:, 0] - self.measured[0]) / self.sigma) ** 2

    def whiteners(self, force):
        return [(np.arange(2), np.eye(2) / self.sigma)]


@pytest.mark.parametrize("mean, sd", [(0.5, 0.02), (0.0, 0.3)])
def test_draws_of_a_sample_tell_how_probable_its_curves_are_in_a_population(mean, sd):
    """Of a population far narrower than what the sample's curves say; a quadrature of likelihood times density is the oracle."""
    own = SampleDensity.of("s", "all", [(1.0, Straight(), Gaussian(1.0, 0.8))], 0)
    logs = np.linspace(-8, np.log(10), 20001)

    def exact(mean, sd):
        return trapezoid(np.exp(-0.5 * ((np.exp(logs) - 1.0) / 0.8) ** 2) * norm.pdf(logs, mean, sd), logs)

    def by_draws(drawn, mean, sd):
        return drawn.weights @ norm.pdf(drawn.logs[:, 0], mean, sd)

    drawn = own.under(Predicted(np.array([[mean]]), np.array([[sd]])))
    known = by_draws(drawn, mean, sd) / by_draws(drawn, mean + sd, sd)
    assert known == pytest.approx(exact(mean, sd) / exact(mean + sd, sd), rel=0.03)
    assert np.sum(np.abs(drawn.logs[:, 0] - mean) < 2 * sd) > 400


class Leaning(Straight):
    """The same with an uncertain input, normal about the middle of its range, which makes the force up to a half larger."""

    size = 2

    def forces(self, places):
        return np.column_stack([10 * places[:, 0] * (0.75 + 0.5 * places[:, 1]), np.ones(len(places))])

    def log_prior(self, places):
        inside = np.all((places >= 0) & (places <= 1), axis=1)
        return np.where(inside, norm.logpdf(places[:, 1], 0.5, 0.2), -np.inf)

    def values(self, places):
        return 10 * places[:, :1]

    def start(self):
        return np.full(2, 0.5)


def test_uncertain_inputs_of_a_sample_are_integrated_out_where_the_population_is():
    """A quadrature over parameter and input is the oracle."""
    own = SampleDensity.of("s", "all", [(1.0, Leaning(), Gaussian(2.0, 0.1))], 0)
    logs, inputs = np.linspace(-1, 2, 1501), np.linspace(0, 1, 401)
    curves = np.exp(logs)[:, None] * (0.75 + 0.5 * inputs)
    likely = trapezoid(np.exp(-0.5 * ((curves - 2.0) / 0.1) ** 2) * norm.pdf(inputs, 0.5, 0.2), inputs, axis=1)
    drawn = own.under(Predicted(np.array([[0.8]]), np.array([[0.05]])))
    exact = [trapezoid(likely * norm.pdf(logs, mean, 0.05), logs) for mean in (0.8, 0.75)]
    known = [drawn.weights @ norm.pdf(drawn.logs[:, 0], mean, 0.05) for mean in (0.8, 0.75)]
    assert known[0] / known[1] == pytest.approx(exact[0] / exact[1], rel=0.05)
    first = own.draws()
    assert np.average(first.logs[:, 0], weights=first.weights) == pytest.approx(
        trapezoid(likely * logs, logs) / trapezoid(likely, logs), abs=0.02
    )


def test_curves_that_do_not_tell_a_parameter_from_0_leave_a_population_with_ends():
    """A quadrature over mean, standard deviation and each sample's logarithm is the oracle; the likelihood is flat towards 0."""
    own = [SampleDensity.of(str(n), "all", [(1.0, Straight(), Gaussian(0.1, 0.3))], n) for n in range(4)]
    drawn = [density.draws() for density in own]
    joint = hierarchy(drawn, {"mu": "kPa"}, {}, "all", 0, lambda there: [density.under(there["all"]) for density in own])
    logs, means, sds = np.linspace(-30, 2, 1601), np.linspace(-16, 8, 161), np.geomspace(0.05, WIDEST, 40)
    centre, likely = np.mean([sample.logs.mean() for sample in drawn]), np.exp(-0.5 * ((np.exp(logs) - 0.1) / 0.3) ** 2)
    each = np.array([trapezoid(likely * norm.pdf(logs, means[:, None], sd), logs, axis=1) for sd in sds])
    density = each**4 * norm.pdf(means, centre, WIDEST) * (sds * np.exp(-0.5 * (sds / USUAL) ** 2))[:, None]
    natural, shares = np.exp(means + 0.5 * sds[:, None] ** 2).ravel(), density.ravel() / density.sum()
    order = np.argsort(natural)
    exact = np.interp((0.025, 0.975), np.cumsum(shares[order]), natural[order])
    assert np.log(joint.parameters["mu"].mean["all"].interval) == pytest.approx(np.log(exact), abs=0.5)  # a sixth of WIDEST


def test_groups_are_read_from_a_column_and_faults_are_named(tmp_path):
    path = tmp_path / "manifest.csv"
    path.write_text("sample,treatment\na,control\na,control\nb,treated\n")
    assert read_groups(path, "treatment") == {"a": "control", "b": "treated"}
    with pytest.raises(RecordError, match="no column 'region'"):
        read_groups(path, "region")
    path.write_text("sample,treatment\na,control\na,treated\n")
    with pytest.raises(RecordError, match="'a' is in two groups"):
        read_groups(path, "treatment")


def test_the_command_fits_samples_as_one_population(tmp_path):
    """Six gels, three of them treated: the force is in proportion to mu, so one run makes all curves."""
    punch = {"shape": "cylinder", "width": None, "length": None, "diameter": 4.0}
    path = tiny_case(tmp_path, indenter=punch, fit={"uncertain": {"mesh": 0.0}})
    curve = simulate(read_case(path, ["test.parallel.depth=0.4", "test.parallel.points=12"]), {"mu": 1.0}).tests[0].curve
    rng, moduli = np.random.default_rng(1), [2.0, 2.4, 1.7, 4.0, 3.4, 4.8]
    with open(tmp_path / "replicates.csv", "w", newline="") as file:
        table = csv.writer(file)
        table.writerow(["sample", "curve", "thickness_mm", "diameter_mm", "treatment"])
        for n, mu in enumerate(moduli):
            force = mu * curve.force + 0.02 * mu * rng.standard_normal(12)
            write_curve(tmp_path / f"s{n}.csv", Curve(curve.displacement, force))
            table.writerow([f"s{n}", f"s{n}.csv", "3.3", "14", "none" if n < 3 else "treated"])
    write_curve(tmp_path / "parallel.csv", Curve(curve.displacement, 3 * curve.force))
    out = tmp_path / "out"
    done = CliRunner().invoke(main, ["fit", str(path), "--population", "--group", "treatment", "-o", str(out)])
    assert done.exit_code == 0, done.output
    value = json.loads((out / "result.json").read_text())
    assert value["format"] == "indentfit.population/2" and value["reference"] == "none"
    (contrast,) = value["population"]["contrasts"]
    assert contrast["ratio"]["interval"][0] < 2.0 < contrast["ratio"]["interval"][1] and contrast["above"] > 0.95
    mean = value["population"]["parameters"]["mu"]["mean"]["none"]
    assert mean["interval"][0] < 2.0 < mean["interval"][1]
    assert value["population"]["shrunken"]["s4"]["mu"]["value"] == pytest.approx(3.4, rel=0.05)
    assert (
        len(value["per_sample"]["samples"]) == 6 and (out / "population.png").is_file() and (out / "s0" / "report.html").is_file()
    )
    stored = read_result(out).result
    assert json.loads(json.dumps(stored.as_json())) | {key: value[key] for key in ("versions", "written")} == value
    weak = [
        replace(known, parameters={"mu": replace(known.parameters["mu"], verdict="not determined by these curves: any value")})
        for known in stored.per_sample.samples
    ]
    unsure = replace(stored, per_sample=replace(stored.per_sample, samples=tuple(weak)))
    assert "mu is determined in 0 of 6 samples" in unsure.summary() and "is determined in" not in stored.summary()
    assert "not determined" in unsure.summary().splitlines()[1] and unsure.as_json()["not_determined"] == ["mu"]
    row = ["mu", "treated / none"]
    assert contrast_rows(unsure)[1] == [*row, "not determined", "not determined"]
    assert contrast_rows(stored)[1] == [*row, words(stored.hierarchy.contrasts[0].ratio), f"{contrast['above']:.3g}"]
    unsure.plot()
    few = replace(stored, hierarchy=replace(stored.hierarchy, effective=40.0)).summary()
    assert "rests on 40 effective draws" in few and "effective" not in stored.summary()
    assert CliRunner().invoke(main, ["report", str(out)]).exit_code == 0
    assert "treated / none" in (out / "report.html").read_text()
