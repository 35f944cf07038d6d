"""The first screen of a fit: no value for a parameter at its bound, doubts in red and amber, and what to do next."""

from dataclasses import replace

import numpy as np
import pytest
from fixtures.cases import white_matter

from indentfit.case.doubts import doubts
from indentfit.case.draining import HOLDS_DIFFER
from indentfit.curve import Curve
from indentfit.inference.agreement import CurveMisfit, TestPrediction
from indentfit.inference.result import AloneEstimate, CurveNoise, FitResult, ParameterEstimate, RivalOptimum
from indentfit.inference.shares import InputShare, UncertainInputs, WhatIf
from indentfit.inverse.course import Proof, SurrogateFacts
from indentfit.inverse.sharp_edges import LEFT_OUT
from indentfit.report.case_text import case_lines
from indentfit.report.first_screen import alone_words, doubts_of, next_step, pieces_words, value_words
from indentfit.report.html_fit import fit_page
from indentfit.report.page import render
from indentfit.report.schema import CaseFacts, Stored, case_json
from indentfit.report.text import fit_lines

pytestmark = pytest.mark.quick
GOOD = ParameterEstimate(
    1.5, "kPa", start=1, min=0.1, max=10, stderr=0.01, interval=(1.45, 1.55), verdict="determined (+-3 %)", limited_by="noise"
)
ZERO = replace(GOOD, value=0.0, unit="1", min=0, max=5, interval=(0, 0.4), limited_by="bound")
AT_MOST = replace(ZERO, at_bound="lower", verdict="at its lower bound (0): at most 0.4")
AT_LEAST = replace(AT_MOST, value=5.0, at_bound="upper", interval=(2.2, 5), verdict="at its upper bound (5): at least 2.2")
ANY = replace(AT_LEAST, interval=(0, 5), verdict="at its upper bound (5); not determined by these curves: any value fits")
WEAK = replace(GOOD, interval=(0.8, 2.4), verdict="weakly determined: 0.8 to 2.4; limited by the noise")


def fitted(**parameters):
    """A result with these free parameters."""
    return FitResult(
        method="ga", seed=0, success=True, message="converged", parameters=parameters, free=tuple(parameters), objective=0.1,
        sum_of_squares=0.01, rmse={"press": 0.1}, misfit={"press": CurveMisfit(0.03, 0.999)},
    )  # fmt: skip


def test_a_parameter_at_its_bound_has_no_value():
    assert value_words(GOOD) == "1.500"
    assert value_words(AT_MOST) == "< 0.4"
    assert value_words(AT_LEAST) == "> 2.2"
    assert value_words(ANY) == "any, 0 to 5"


def row_of(result, name):
    return next(line for line in fit_lines(result) if line.startswith(f"{name} "))


def test_the_table_of_the_terminal_gives_the_end_of_the_interval_in_place_of_the_bound():
    result = fitted(mu=GOOD, phi=AT_LEAST, zeta=AT_MOST)
    assert row_of(result, "mu").split()[1] == "1.500"
    assert row_of(result, "phi").split()[1:3] == [">", "2.2"] and " 5.0" not in row_of(result, "phi")
    assert row_of(result, "zeta").split()[1:3] == ["<", "0.4"]


@pytest.mark.parametrize(("size", "unit", "shown"), [(1.0, "mN", "mN"), (1e-3, "uN", "µN"), (1e-6, "nN", "nN")])
def test_misfits_are_told_in_the_unit_of_the_forces(size, unit, shown, tmp_path):
    """A fit of forces a million times smaller says the same numbers, of nN in place of mN."""
    surrogate = SurrogateFacts(6, 0, 2, None, (Proof({"mu": 1.0}, 0.002 * size, 0.03 * size),), True)
    result = replace(
        fitted(mu=GOOD, phi=WEAK),
        objective=0.1 * size,
        sum_of_squares=0.01 * size**2,
        rmse={"press": 0.1 * size},
        surrogate=surrogate,
        singular_values=(3 * size, 0.2 * size),
        directions=((1.0, 0.0), (0.0, 1.0)),
        rivals=(RivalOptimum({"mu": 2.0, "phi": 1.0}, 0.3 * size),),
        curves={"press": Curve([0.1, 0.2], [1.5 * size, 3.0 * size])},
    )
    said = {line.split()[0]: line for line in fit_lines(result) if line}
    assert said["objective"].startswith(f"objective 0.1 {unit}, equation") and f"(press 0.1 {unit})" in said["objective"]
    assert f" 0.01 {unit}^2" in said["squares"] and f"3 : 0.2 {unit};" in said["singular"]
    assert f"off by 0.002 {unit} at a run not seen before (allowed 0.03)" in said["surrogate"]
    assert said["rival"].endswith(f"objective 0.3 {unit}")
    page = render(fit_page(Stored(tmp_path, result, None, (), None, {}), result))
    assert f"RMSEs: 0.1 {shown}. Weighted sum of their squares: 0.01 {shown}²" in page and f"RMSE ({shown})" in page
    assert f"Objective ({shown})" in page and f"Singular value ({shown})" in page


def test_an_interval_in_two_pieces_is_shown_as_two_on_page_and_terminal(tmp_path):
    result = fitted(mu=replace(GOOD, interval=(1.1, 2.2), pieces=((1.1, 1.3), (2.0, 2.2))))
    assert "1.100 to 1.300 or 2.000 to 2.200" in row_of(result, "mu")
    assert "1.100 to 1.300 or 2.000 to 2.200" in render(fit_page(Stored(tmp_path, result, None, (), None, {}), result))
    assert any("in 2 pieces" in doubt.text for doubt in doubts_of(result))


@pytest.mark.parametrize(
    ("change", "red", "said", "then"),
    [
        ({"no_fit": "forces may be in newtons"}, True, "no fit: forces may be in newtons", "units"),
        ({"success": False, "message": "no progress"}, True, "did not converge: no progress", "--method ga"),
        ({"predicted": {"press": TestPrediction(0.001, 0.4)}}, True, "press is 40% above what the others predict", "repeat press"),
        ({"noise": {"press": CurveNoise(0.1, 0.9, 3, 25, 0.001)}}, False, "systematic", "indentfit compare"),
        ({"conclusions": (f"{HOLDS_DIFFER}a, b",)}, False, "holds differ", "fit each test alone"),
    ],
)
def test_what_is_wrong_with_a_whole_result_is_red_or_amber_with_its_next_step(change, red, said, then):
    result = replace(fitted(mu=GOOD), **change)
    (doubt,) = doubts_of(result)
    assert doubt.red == red and said in doubt.text
    assert then in next_step(result)


def test_a_note_on_a_test_begins_with_its_name_as_it_is(tmp_path):
    result = fitted(mu=GOOD)
    name = next(iter(result.rmse))
    noted = replace(result, notes=(f"{name}: seen", "few points"))
    page = render(fit_page(Stored(tmp_path, noted, None, (), None, {}), noted))
    assert name[0].islower() and f">{name}: seen." in page and ">Few points." in page


def test_laws_of_a_fit_in_time_are_not_sent_to_a_comparison_that_refuses_holds():
    noise = {"press (hold)": CurveNoise(0.1, 0.9, 3, 25, 0.001)}
    result = fitted(mu=GOOD)
    then = next_step(replace(result, noise=noise, misfit={"press (hold)": next(iter(result.misfit.values()))}))
    assert "another law or another relaxation" in then and "indentfit compare" not in then


def test_a_preload_is_mended_before_another_law_is_tried():
    depth = np.linspace(0, 0.4, 20)
    curve = Curve(depth, 30 * depth**1.5 + 3)
    misfit = {"noise": {"press": CurveNoise(0.1, 0.9, 3, 25, 0.001)}}
    preloaded = replace(fitted(mu=GOOD), recording=tuple(doubts("press", curve)), **misfit)
    assert "force at zero displacement is 3 mN" in next(doubts_of(preloaded)).text
    assert next_step(preloaded).startswith("mend press first") and "uncertain.offset" in next_step(preloaded)
    recorded = replace(preloaded, recording=tuple(doubts("press", curve, recorded=True)))
    assert "[record] contact" in next_step(recorded) and "[record] zero" in next_step(recorded)
    assert FitResult.from_json(preloaded.as_json()).recording == preloaded.recording
    assert "nothing is missing" in next_step(replace(preloaded, noise={}))  # known, and the fit follows


def test_residuals_that_are_smaller_than_the_error_of_the_mesh_say_nothing_against_the_law():
    smooth = {"noise": {"press": CurveNoise(0.1, 0.9, 3, 25, 0.001)}}  # the misfit is 3 %
    coarse, fine = (UncertainInputs({"mesh": InputShare("0.01", sd)}) for sd in (0.04, 0.01))
    assert not list(doubts_of(replace(fitted(mu=GOOD), uncertain=coarse, **smooth)))
    assert "compare" not in next_step(replace(fitted(mu=GOOD), uncertain=coarse, **smooth))
    assert "systematic" in next(doubts_of(replace(fitted(mu=GOOD), uncertain=fine, **smooth))).text


def test_points_that_were_not_fitted_are_said_in_amber():
    (doubt,) = doubts_of(replace(fitted(mu=GOOD), conclusions=(f"{LEFT_OUT}press to 0.1 mm, its first 5 of 20 points",)))
    assert not doubt.red and "first 5 of 20 points" in doubt.text


def test_the_next_step_is_that_of_what_limits_the_parameters():
    assert "design" in next_step(fitted(mu=WEAK)) and "mu" in next_step(fitted(mu=WEAK))
    mesh = replace(
        WEAK, limited_by="mesh", verdict="weakly determined: limited by the error of the mesh: about 1,200 elements would"
    )
    assert "mesh.elements = 1200" in next_step(fitted(mu=mesh))
    assert "contact point" in next_step(fitted(mu=replace(WEAK, limited_by="offset")))
    assert "dominates the error of mu" in next(iter(doubts_of(fitted(mu=mesh)))).text
    assert "may be 0" in next_step(fitted(mu=GOOD, phi=AT_MOST))
    assert "max = 5" in next_step(fitted(mu=GOOD, phi=AT_LEAST))
    assert next_step(fitted(mu=GOOD)).startswith("nothing is missing") and not list(doubts_of(fitted(mu=GOOD)))


def test_a_law_that_misses_a_little_is_answered_by_its_misfit_as_a_term():
    """Residuals that are systematic by 1 % of the force send to no other law, but they are not nothing: seen of a gel whose law was
    8 % off at the largest depth, mu 1.007 to 1.099 for 1, "nothing is missing"."""
    law = WhatIf("law", "neo_hookean", "5% too soft at the largest depth", {"mu": 1.52})
    result = replace(fitted(mu=GOOD), misfit={"press": CurveMisfit(0.01, 0.999)}, taken_as_known=(law,))
    assert next_step(result).startswith("nothing is missing") and "fit.discrepancy" not in next_step(result)
    moved = replace(result, taken_as_known=(replace(law, parameters={"mu": 1.42}),))
    assert next_step(moved).startswith("nothing is missing") and "fit.discrepancy" in next_step(moved)
    smooth = {"press": CurveNoise(0.1, 0.9, 3, 25, 0.001)}
    assert next_step(replace(result, noise=smooth)).startswith("fit again with the law's own misfit as a term: [fit.discrepancy]")
    assert "fit.discrepancy" not in next_step(replace(result, noise=smooth, taken_as_known=()))  # which the case has already


def test_the_page_sets_doubts_off_in_red_and_amber(tmp_path):
    result = replace(fitted(mu=GOOD, phi=AT_LEAST), predicted={"press": TestPrediction(0.001, -0.4)})
    page = render(fit_page(Stored(tmp_path, result, None, (), None, {}), result))
    assert '<p class="warning">Red: the tests contradict each other' in page
    assert '<p class="warning amber">Amber: φ sits at its upper bound (5)' in page
    assert "&gt; 2.2" in page and "Next: repeat press" in page


@pytest.mark.parametrize(
    ("verdict", "said"),
    [
        ("determined (+-2 %)", "4.99"),
        ("at its upper bound (5): at least 2.2", "> 2.2"),
        ("at its lower bound (0): at most 5", "< 5"),
        ("at its upper bound (5); not determined by these curves: any value fits", "any value"),
    ],
)
def test_a_bound_is_no_value_of_a_test_alone_either(verdict, said):
    assert alone_words(AloneEstimate(4.99, (2.2, 5.0), verdict)) == said


def test_an_uncertain_input_is_not_told_as_a_known_one():
    """Of an unknown friction or base, the value of single runs is shown with the prior that the fit goes over."""
    case = white_matter('indenter.friction="unknown"', 'sample.base="unknown"', "fit.uncertain.thickness=0.1")
    facts = CaseFacts.from_json(case_json(case))
    assert facts.indenter.endswith("; friction uncertain (0 to 1)")
    assert "coefficient" not in facts.indenter  # a value beside it would be told as known
    assert "; base uncertain (the other one with probability 0.5)" in facts.sample
    assert facts.sample.endswith("; thickness uncertain (standard deviation 0.1)")
    said = "\n".join(case_lines(case))
    assert "uncertain friction: 0 to 1" in said and "uncertain base: the other one with probability 0.5" in said
    known = white_matter()
    assert "uncertain" not in CaseFacts.from_json(case_json(known)).indenter + "\n".join(case_lines(known))


def test_a_value_that_is_fixed_has_no_interval():
    """The page of a gel called the interval of its Poisson's ratio unknown."""
    assert pieces_words(ParameterEstimate(0.4995, "", fixed=True)) == "fixed"


@pytest.mark.parametrize(
    ("points", "fewest", "limited_by", "told"),
    [(12, 12.0, "noise", True), (18, 5.0, "noise", True), (18, 18.0, "noise", False), (25, 5.0, "noise", False),
     (12, 5.0, "friction", False)],
)  # fmt: skip
def test_few_points_that_cannot_tell_how_correlated_their_noise_is_make_a_result_amber(points, fewest, limited_by, told):
    """Fits of 12 points under a correlation of 0.8 held the truth in 85 to 90 %, and one in eight said nothing of it."""
    noise = CurveNoise(0.1, 0.0, float(points), points, fewest_points=fewest)
    result = replace(fitted(mu=replace(GOOD, limited_by=limited_by)), noise={"press": noise})
    said = [doubt.text for doubt in doubts_of(result) if "noise is correlated" in doubt.text]
    assert len(said) == told
    assert all(text.startswith(f"the {points} points of press are too few to tell") for text in said)


def test_smooth_residuals_of_few_points_are_told_as_misfit_alone():
    noise = CurveNoise(0.1, 0.9, 2.0, 12, white=0.001, fewest_points=1.0)
    texts = [doubt.text for doubt in doubts_of(replace(fitted(mu=GOOD), noise={"press": noise}))]
    assert any("systematic" in text for text in texts)
    assert not any("too few" in text for text in texts)
