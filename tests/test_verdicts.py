"""Verdicts by their causes: noise, mesh, inputs, misfit, bounds; and a misfit so gross that there is no fit."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner
from fixtures.cases import CASES, tiny_case, white_matter
from fixtures.formulas import DEPTH, TRUTH, Formula, formula, problem

from indentfit.case import Range
from indentfit.case.doubts import doubts
from indentfit.cli import main
from indentfit.curve import Curve, read_curve, write_curve
from indentfit.experiment.measured import read_case
from indentfit.inference.fit import _no_fit
from indentfit.inference.identifiability import _at_bound
from indentfit.inference.limits import Limit, MeshSize, limits
from indentfit.inference.misfit import misfits, no_fit
from indentfit.inference.noise import correlations, whiteness
from indentfit.inference.result import AloneEstimate, CurveNoise, ParameterEstimate, TestAlone
from indentfit.inference.shares import InputShare, NoiseShare, UncertainInputs
from indentfit.inference.verdicts import alone_unless_in_doubt, kind_of, reached, unless_in_doubt, verdict

MESH = Limit("mesh", 0.9, MeshSize(1000, 1 / 3))


@pytest.mark.parametrize(
    ("value", "interval", "at_bound", "limit", "said"),
    [
        (2.0, (1.94, 2.06), "", Limit(), "determined (+-3 %); limited by the noise"),
        (2.0, (1.0, 3.0), "", Limit("friction"), "weakly determined: 1.00 to 3.00; limited by the error of the friction"),
        (0.2, (0.0, 0.7), "", Limit(), "not determined by these curves: any value in 0-0.7 fits within the noise"),
        (2.0, (0.0, 5.0), "", Limit("misfit"), "not determined by these curves: "
                                               "any value in 0-5 fits within the misfit of the law"),
        (0.0, (0.0, 0.1), "lower", Limit(), "at its lower bound (0): at most 0.1"),
        (5.0, (4.9, 5.0), "upper", Limit(), "at its upper bound (5): at least 4.9"),
        (0.0, (0.0, 5.0), "lower", Limit(), "at its lower bound (0); not determined by these curves: "
                                            "any value in 0-5 fits within the noise"),
        # The half-width is 50 % where 20 % is wanted: of the variance 0.16 may stay, 0.1 of it without any mesh, so that the mesh's
        # own 0.9 becomes 0.06: its standard error 0.258 of what it was, by 1 / 0.258^3 = 58.1 times as many elements.
        (2.0, (1.0, 3.0), "", MESH, "weakly determined: 1.00 to 3.00; limited by the error of the mesh: "
                                    "about 58,000 elements would determine it"),
        (2.0, (1.9, 2.1), "", MESH, "determined (+-5 %); limited by the error of the mesh: about 8,000 elements would halve that"),
    ],
)  # fmt: skip
def test_a_verdict_says_in_words_how_well_and_what_limits(value, interval, at_bound, limit, said):
    assert verdict(value, interval, Range(start=1, min=0, max=5), at_bound, limit) == said


def shares(**given):
    rows = {name: InputShare(0.5, 0.1, {}, {"mu": share}) for name, share in given.items()}
    return UncertainInputs(rows, NoiseShare({"mu": 1 - sum(given.values())}), {"mu": 1.0})


WHITE, SMOOTH = CurveNoise(0.1, 0.0, 20, 20, 0.5), CurveNoise(0.1, 0.9, 3, 20, 0.001)


@pytest.mark.parametrize(
    ("inputs", "noise", "cause"),
    [
        ({}, WHITE, "noise"),
        ({}, SMOOTH, "misfit"),
        ({}, replace(SMOOTH, stated=0.5), "noise"),  # a stranger's curve: residuals of 0.04 %, stated to 2 %, blamed the law
        ({"mesh": 0.9}, WHITE, "mesh"),
        ({"mesh": 0.4}, WHITE, "noise"),
        ({"mesh": 0.3, "friction": 0.31}, WHITE, "friction"),  # the noise has 39 %, most of all, but does not dominate
        ({"mesh": 0.3, "friction": 0.31}, SMOOTH, "misfit"),
    ],
)
def test_the_cause_is_the_largest_source_and_noise_only_where_it_dominates(inputs, noise, cause):
    found = limits(shares(**inputs), {"t": noise}, ["mu"], MeshSize(100, 0.5))["mu"]
    assert found.cause == cause
    assert (found.mesh is not None) == (cause == "mesh")


def test_independent_noise_is_called_smooth_in_one_case_of_a_hundred():
    """Probabilities of independent noise are uniform: 400 draws behind a fit of three parameters, below 0.1 in 10 % +- 4.5 %."""
    rng, D = np.random.default_rng(0), np.vander(np.linspace(0, 1, 20), 3)
    M = np.eye(20) - D @ np.linalg.pinv(D)
    p = np.array([whiteness(M, M @ rng.standard_normal(20)) for _ in range(400)])
    assert abs(np.mean(p < 0.1) - 0.1) < 0.045
    assert np.mean(p < 0.01) < 0.03
    smooth = np.linalg.cholesky(correlations(20, 0.9))
    assert np.median([whiteness(M, M @ smooth @ rng.standard_normal(20)) for _ in range(50)]) < 0.1


# A misfit so gross that there is no fit


def judged(measured, **values):
    whole = problem(measured)
    return whole, whole.judge({**TRUTH, **values}, formula(**{**TRUTH, **values, "mu": 1.0}))


RUNS = Formula().evaluate([{**TRUTH, "mu": 1.0}, {"mu": 1.0, "zeta": 8.0, "phi": 2.0}])


def test_the_misfit_of_a_test_is_relative_to_its_largest_force():
    along, across = formula(**TRUTH)
    error = np.where(np.arange(15) % 2, 1.0, -1.0) * 0.03 * along.max()
    whole, best = judged((along + error, across))
    found = misfits(whole, best)
    assert found["parallel"].relative == pytest.approx(0.03 * along.max() / (along + error).max(), rel=1e-9)
    assert found["parallel"].r2 == pytest.approx(np.corrcoef(along, along + error)[0, 1] ** 2, abs=0.01)
    assert found["perpendicular"].relative < 1e-12
    assert no_fit(whole, best, RUNS) is None


@pytest.mark.parametrize(
    ("factor", "mu", "unit"), [(1e-3, 0.1, "newtons"), (1e3, 10.0, "micronewtons"), (1e-6, 0.1, "kilonewtons")]
)
def test_forces_in_another_unit_are_no_fit_and_the_unit_is_named(factor, mu, unit):
    """At the bound of mu that is nearest to the curves; in the right unit mu is 1.5."""
    measured = tuple(factor * force for force in formula(**TRUTH))
    whole, best = judged(measured, mu=mu)
    said = no_fit(whole, best, RUNS)
    assert f"at mu = 1.5: they may be in {unit};" in said


def test_grams_force_are_named_where_they_bring_the_scale_back():
    measured = tuple(force / 9.80665 for force in formula(**{**TRUTH, "mu": 0.5}))
    whole, best = judged(measured, mu=0.1)
    assert "grams-force" in no_fit(whole, best, RUNS)
    assert "multiplied by 9.807" in no_fit(whole, best, RUNS)


@pytest.mark.parametrize(
    ("factors", "name", "words"),
    [
        ((1.0, 1e-3), "perpendicular", "multiplied by 1000 would be near those that parallel asks for: they may be in newtons"),
        ((1e-3, 1.0), "parallel", "multiplied by 1000 would be near those that perpendicular asks for: they may be in newtons"),
        ((1e3, 1.0), "parallel", "divided by 1000 would be near those that perpendicular asks for: they may be in micronewtons"),
        (
            (1.0, 1 / 9.80665),
            "perpendicular",
            "multiplied by 9.807 would be near those that parallel asks for: they may be in grams",
        ),
    ],
)
def test_one_curve_of_two_in_another_unit_is_named(factors, name, words):
    measured = tuple(factor * force for factor, force in zip(factors, formula(**TRUTH), strict=True))
    whole, best = judged(measured)
    assert f"the forces of {name} {words}" in no_fit(whole, best, RUNS)


@pytest.mark.parametrize("turned", [(), ("fit.uncertain.fibre_angle={start=0,min=-45,max=45}",)])
def test_where_no_unit_explains_the_curves_a_wrong_direction_of_the_fibres_is_named(turned):
    """Curves of a bar at 0, 45 and 90 degrees, evaluated as if at 45, 90 and 135, ended as "no fit" without a word of the angle."""
    along, across = formula(**TRUTH)
    whole, best = judged((along, across / 5))
    said = _no_fit(white_matter(*turned), whole, best, SimpleNamespace(known=RUNS))
    assert ("another direction of the fibres (fit.uncertain.fibre_angle" in said) != bool(turned)
    assert "signs and units of the curve's columns" in said


def test_two_curves_that_differ_by_no_unit_s_factor_are_not_said_to_be_in_other_units():
    along, across = formula(**TRUTH)
    for factor in (40, 5):
        whole, best = judged((along, across / factor))
        assert "they may be in" not in no_fit(whole, best, RUNS)


def test_a_curve_that_bends_the_other_way_is_no_fit():
    largest = [force.max() for force in formula(**TRUTH)]
    soft = tuple(force * (1 - np.exp(-DEPTH / 0.02)) for force in largest)
    whole, best = judged(soft)
    said = no_fit(whole, best, RUNS)
    assert "softens where the law stiffens" in said
    assert "units" not in said


# What a curve shows before any solve


def test_a_preload_and_adhesion_are_seen_in_the_curve_itself():
    d = np.linspace(0, 0.2, 21)
    assert "preload" in next(doubts("t", Curve(d, (d + 0.05) ** 1.5))).seen
    assert "preload" in next(doubts("t", Curve(d[1:], (d[1:] + 0.05) ** 1.5))).seen  # without the point at zero
    said = str(next(doubts("t", Curve(d, d**1.5 - 0.006 * np.exp(-d / 0.02)))))
    assert "adhesion" in said and "down to -6 uN" in said
    assert not list(doubts("t", Curve(d, d**1.5)))
    assert not list(doubts("t", Curve(d[1:], d[1:] ** 3)))


def test_an_earlier_contact_that_the_record_leaves_open_is_no_preload():
    """Contact 0.05 mm earlier: within twice a standard deviation of 0.03 mm the fit knows it, beyond twice 0.02 mm it does not."""
    d = np.linspace(0, 0.2, 21)
    known, early = (Curve(d, 10 * (d + 0.05), contact=sd) for sd in (0.03, 0.02))
    assert not list(doubts("t", known, recorded=True))
    assert "preload" in next(doubts("t", early, recorded=True)).seen


def test_noise_is_no_preload_nor_adhesion():
    """1 and 5 % of noise on 20 points, straight and Hertzian: in 400 curves at most 1 %."""
    rng, d = np.random.default_rng(0), np.linspace(0.05, 1, 20)
    curves = [Curve(d, d**p + noise * rng.standard_normal(20)) for p in (1, 1.5) for noise in (0.01, 0.05) for _ in range(100)]
    assert sum(bool(list(doubts("t", curve))) for curve in curves) <= 4


def test_shipped_curves_raise_no_doubts():
    curves = [*CASES.glob("*/curves/*.csv"), CASES / "own_material" / "curve.csv"]
    curves = [path for path in curves if "displacement_mm" in path.read_text()]  # of indentations
    assert len(curves) >= 7
    assert not [said for path in curves for said in doubts(path.stem, read_curve(path))]


@pytest.fixture
def gel(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tiny_case(tmp_path, fit={"method": "ga"})


def test_newtons_under_a_header_of_millinewtons_end_with_4(gel, tmp_path):
    depth = np.linspace(0.05, 0.25, 6)
    write_curve(tmp_path / "parallel.csv", Curve(depth, 0.07 * depth))
    done = CliRunner().invoke(main, ["fit", str(gel), "-o", "r", "--no-fields"])
    assert done.exit_code == 4
    assert "no fit" in done.stderr and "newtons" in done.stderr
    assert "noise" not in done.stderr
    assert "determined: the model cannot follow" in done.stdout


def test_validate_and_fit_warn_of_a_preload_first(gel, tmp_path):
    depth = np.linspace(0, 0.25, 8)
    write_curve(tmp_path / "parallel.csv", Curve(depth, 5 + 70 * depth))
    for command in (["validate", str(gel)], ["fit", str(gel), "-o", "r", "--no-fields"]):
        assert "preload" in CliRunner().invoke(main, command).stderr
    assert any("preload" in warning for warning in read_case(gel).warnings())


@pytest.mark.parametrize(
    ("value", "stderr", "least", "most", "said"),
    [
        (3.0, 0.04, 0.003, 3336.0, ""),  # 75 standard errors, and three decades, above the bound of a wide range
        (3.0, 0.04, 0.0, 1e4, ""),
        (0.004, 0.04, 0.003, 3336.0, "lower"),
        (0.0, 1e-9, 0.0, 20.0, "lower"),
        (0.01, 0.2, 0.0, 20.0, "lower"),
        (20.0, 0.2, 0.0, 20.0, "upper"),
        (0.01, np.nan, 0.0, 20.0, "lower"),
    ],
)
def test_a_value_known_well_and_clear_of_the_end_of_a_wide_range_is_at_no_bound(value, stderr, least, most, said):
    assert _at_bound(value, stderr, Range(start=(least + most) / 2, min=least, max=most)) == said


@pytest.mark.parametrize(
    ("near", "value", "interval", "said"),
    [
        ("lower", 0.226, (0.095, 0.402), ""),  # near 0.01 by the size of a range to 10,000, but the curves exclude 0.01
        ("lower", 0.012, (0.01, 0.402), "lower"),
        ("lower", 0.02, (0.02, 0.402), "lower"),  # ends of sampled densities come near a bound without reaching it
        ("lower", 0.01, (0.01, 0.01), "lower"),
        ("upper", 9999.0, (2000.0, 1e4), "upper"),
        ("upper", 9995.0, (9994.0, 9996.0), ""),
        ("", 0.226, (0.01, 0.402), ""),
    ],
)
def test_a_parameter_is_at_a_bound_only_where_its_interval_comes_to_it(near, value, interval, said):
    assert reached(near, value, interval, Range(start=10, min=0.01, max=1e4)) == said


def test_a_curve_with_a_preload_determines_nothing_whatever_its_interval():
    depth = np.linspace(0, 0.4, 20)
    known = ParameterEstimate(
        2.0, "kPa", interval=(1.9, 2.1), verdict="determined (+-5 %); limited by the noise", limited_by="noise"
    )
    preload = list(doubts("press", Curve(depth, 30 * depth**1.5 + 3)))
    doubted = unless_in_doubt({"mu": known}, preload)["mu"]
    assert kind_of(doubted) == "not determined" and "press" in doubted.verdict and "1.9 to 2.1" in doubted.verdict
    assert unless_in_doubt({"mu": known}, [])["mu"] is known
    row = AloneEstimate(2.0, (1.9, 2.1), known.verdict)
    alone = {name: TestAlone(0.1, None, {"mu": row}) for name in ("press", "other")}
    judged = alone_unless_in_doubt(alone, preload)
    assert judged["press"].parameters["mu"].verdict.startswith("not determined") and judged["other"] is alone["other"]
