"""Runs at the ends of profiles of a joint fit: which of them are made."""

from dataclasses import replace

import numpy as np
import pytest
from fixtures.formulas import FREE, TRUTH, Formula, formula, problem

from indentfit.inference import joint, wide_fit
from indentfit.inference.draws import drawn
from indentfit.inference.joint import ModelError
from indentfit.inference.joint_profiles import joint_profiles
from indentfit.inference.profiles import apart, near
from indentfit.inverse.exploration import Watched
from indentfit.inverse.progress import SILENT
from indentfit.inverse.wide import widened_problem

REPORT = SILENT.of_runs("")


@pytest.fixture(scope="module")
def alternative():
    """A fit to curves with 1 % noise, with its model."""
    rng = np.random.default_rng(0)
    forces = tuple(force + 0.01 * force.max() * rng.standard_normal(force.size) for force in formula(**TRUTH))
    model = Watched(Formula())
    fit = joint.joint_fit(widened_problem(problem(forces), ()), (), model, ModelError.none(2 * 15), 0)
    return wide_fit.WideAlternative("", {}, 1.0, fit, joint_profiles(fit), drawn(fit, 0, 100)), model


def run_at(alternative, ends, doubt, monkeypatch, belied=False):
    """Places that runs prove, by their parameter, and how many runs were made, where each place has a doubt over the root of the
    limit, and runs are as predicted or belie it."""
    (known, model), confirmed = alternative, wide_fit._confirmed

    def said(*given):
        end = confirmed(*given)
        return replace(end, chi2=1e3 if belied else end.predicted)

    monkeypatch.setattr(wide_fit, "_doubt", lambda _, z: doubt(z) * np.sqrt(known.paths[1].limit))
    monkeypatch.setattr(wide_fit, "_confirmed", said)
    before = len(model.known)
    proofs = wide_fit._ends_run(known, ends, model, REPORT)
    monkeypatch.undo()
    return [(proof.number, float(proof.place[1])) for proof in proofs], len(model.known) - before


def test_ends_that_are_near_each_other_share_a_run(alternative, monkeypatch):
    low, high = alternative[0].paths[1].ends()
    ends = [(1, low), (2, low + 1e-4), (0, high)]
    assert run_at(alternative, ends, lambda z: 1.0, monkeypatch) == ([(1, low[1]), (2, low[1]), (0, high[1])], 2)


def test_of_ends_that_are_predicted_surely_the_least_sure_one_is_run(alternative, monkeypatch):
    """All are run where that run was not as predicted: the jackknife was wrong."""
    low, high = alternative[0].paths[1].ends()
    ends, sure = [(1, low), (1, high)], lambda z: 0.01 + 0.01 * z[1]
    assert run_at(alternative, ends, sure, monkeypatch) == ([(1, high[1])], 1)
    assert run_at(alternative, ends, lambda z: 0.03 - sure(z), monkeypatch) == ([(1, low[1])], 1)
    assert run_at(alternative, ends, sure, monkeypatch, belied=True) == ([(1, low[1]), (1, high[1])], 2)


def test_the_doubt_of_a_prediction_is_the_error_of_the_root_of_chi2(alternative):
    """Of places all over the profiles the root of chi2 errs by three times the jackknife's error at most, or by a tenth."""
    known, model = alternative
    fit, places = known.fit, np.vstack([path.places for path in known.paths.values()])[::4]
    curves = fit.posterior.curves
    for z in places:
        run = model.evaluate([curves.problem.at_reference(curves.point(z))])[0]
        end = wide_fit._confirmed(fit, 1, z, run)
        if end.predicted > 1:
            assert abs(np.sqrt(end.chi2) - np.sqrt(end.predicted)) < max(3 * wide_fit._doubt(fit, z), 0.1)


def test_ends_where_no_coordinate_changes_a_run_share_one():
    """With the scale alone free every run is the same: a fit of one modulus ended with an error."""
    forces = formula(**TRUTH)
    model = Watched(Formula())
    fit = joint.joint_fit(widened_problem(problem(forces, free={"mu": FREE["mu"]}), ()), (), model, ModelError.none(2 * 15), 0)
    known = wide_fit.WideAlternative("", {}, 1.0, fit, joint_profiles(fit), drawn(fit, 0, 100))
    ends = [(0, end) for end in known.paths[0].ends()]
    assert len(wide_fit._ends_run(known, ends, model, REPORT)) == 2


@pytest.mark.parametrize("seed", range(20))
def test_each_end_that_needs_no_run_of_its_own_has_one_near_it(seed):
    """The nearest point was looked for without regard to the widths, by which ends are near each other."""
    rng, widths = np.random.default_rng(seed), np.array([1.0, 0.01])
    ends = [np.array([rng.uniform(0, 0.5), rng.uniform(0, 0.005)]) for _ in range(4)]
    points = apart(ends, widths)
    assert all(near(end, points, widths) is not None for end in ends)
