"""Relaxation: steps of time by both iterations, when the motion is given up, and forces of loose steps."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from fixtures.cases import white_matter

from indentfit.errors import ConvergenceError
from indentfit.fem import contact_first, path, relaxation
from indentfit.fem.controls import Controls
from indentfit.fem.equations import Iterate
from indentfit.fem.facts import SolveFacts, said_of_paths
from indentfit.fem.relaxation import FAR, IDLE, LOOSE, SOON, _Mover, _Rest
from indentfit.fem.simulate import Model
from indentfit.runs.forward import presses_of
from indentfit.runs.points import setup_of


@pytest.fixture(scope="module")
def under_way():
    """A model under way, an equilibrium of its path, and the increment of the next step."""
    case = white_matter("mesh.elements=20")
    model = Model(setup_of(case))
    (press, _) = presses_of(case, case.law(mu=1.49, zeta=4.68, phi=0.68))
    here = model.run(press).path[1]
    return model, here, path._increment(model.equations, model._loading(press, here.springs), here, here.depth + 0.02, 0.01)


def moved(under_way, damping=10.0, **changes):
    """One step of time with a Mover, some of whose own attributes are changed."""
    model, here, increment = under_way
    newton = model._newton(Controls(1e-8))
    mover = _Mover(newton)
    for name, value in changes.items():
        setattr(mover, name, value)
    return mover.moved(increment.linearised(here.at), damping), mover


def test_a_step_of_time_is_that_of_newtons_iteration_whichever_way_it_is_solved(under_way, monkeypatch):
    monkeypatch.setattr(relaxation, "EASED_FIRST", 1e-7)
    monkeypatch.setattr(relaxation, "EASED", 1e-7)
    quick, mover = moved(under_way)
    slow, newtons = moved(under_way, _goes_around=False)
    far = np.abs(slow.at.u - under_way[1].u).max()
    assert mover.effort < 1 < newtons.effort  # it took no iteration of Newton's
    assert np.abs(quick.at.u - slow.at.u).max() < 1e-4 * far
    assert quick.contact.traction == pytest.approx(slow.contact.traction, abs=1e-3 * np.abs(slow.contact.traction).max())


def test_stiffer_dampers_let_the_body_move_less(under_way):
    """The residual at the start over the dampers is the motion, where they are much stiffer than the body."""
    _, here, increment = under_way
    start, fixed = increment.linearised(here.at), increment.equations.fixed
    coefficients = 1e8 * increment.loading.material.shear_modulus * fixed.sizes
    motion, _ = moved(under_way, 1e8)
    expected = -fixed.freed(start.residual / coefficients)
    assert motion.at.u - here.at.u == pytest.approx(expected, abs=1e-3 * np.abs(expected).max())


def test_newtons_iteration_steps_in_once_the_body_has_moved(under_way, monkeypatch):
    """Before that, stiffer dampers are found sooner than its eight iterations fail."""
    monkeypatch.setattr(relaxation, "approached", lambda *_: None)
    assert moved(under_way)[0] is None
    assert moved(under_way, _has_moved=True)[0] is not None


def test_a_library_that_cannot_go_around_the_contact_makes_no_factor_in_vain(monkeypatch):
    case = white_matter("mesh.elements=20", "solver.linear='superlu'")
    model = Model(setup_of(case))
    (press, _) = presses_of(case, case.law(mu=1.49, zeta=4.68, phi=0.68))
    here = model.run(press).path[1]
    increment = path._increment(model.equations, model._loading(press, here.springs), here, here.depth + 0.02, 0.01)
    newton = model._newton(Controls(1e-6))
    renewed, usual = [], model.solver.renew
    monkeypatch.setattr(model.solver, "renew", lambda tangent: (renewed.append(tangent), usual(tangent)))
    there, _ = path.relaxed(newton, increment, here.at)
    assert len(renewed) == 1
    assert there.force == pytest.approx(newton.equilibrium(increment, here.at)[0].force, rel=1e-4)


def test_a_step_that_leads_far_away_is_shortened(under_way, monkeypatch):
    """Steps a hundred times too long, which the leash does not hold: a quarter or less of them has to do."""
    model, here, increment = under_way
    increment, controls = replace(increment, leash=1e3), Controls(1e-2)
    usual, long = contact_first._change, []

    def too_long(*words):
        change = usual(*words)
        if long:
            return change
        long.append(change)
        return Iterate(12 * change.u, 12 * change.pressure)

    monkeypatch.setattr(contact_first, "_change", too_long)
    model._newton(controls)
    model.solver.renew(increment.linearised(here.at).tangent)
    assert contact_first.approached(increment, here.at, model.solver, controls) is None
    long.clear()
    near = contact_first.approached(increment, here.at, model.solver, controls, (0.25, 0.06))
    assert near.here.unbalanced <= 1e-2 * near.here.contact_force


def rest(share, since=0.0):
    return _Rest(share, None, None, since)


def state(share):
    return SimpleNamespace(share=share, increment=None, at=None)


def test_a_state_that_the_motion_has_left_is_no_rest():
    """Before a snap the residual is small too."""
    assert rest(LOOSE / 10).or_better(state(LOOSE), 7.0).share == LOOSE
    assert rest(LOOSE / 3).or_better(state(LOOSE), 7.0).share == LOOSE / 3
    assert rest(LOOSE).or_better(state(LOOSE / 2), 7.0).since == 7.0
    assert rest(LOOSE, 3.0).or_better(state(0.9 * LOOSE), 7.0).since == 3.0  # hardly nearer


def test_a_motion_is_given_up_far_from_rest_and_where_it_stays():
    assert rest(2 * FAR).gives_up(2 * FAR, SOON + 1)
    assert not rest(2 * FAR).gives_up(2 * FAR, SOON - 1)
    assert not rest(FAR / 2).gives_up(FAR / 2, SOON + 1)
    assert rest(LOOSE / 2).gives_up(LOOSE / 2, IDLE + 1)
    assert not rest(LOOSE / 2, since=10.0).gives_up(LOOSE / 2, IDLE + 1)  # it was still coming nearer
    assert not rest(LOOSE / 2).gives_up(2 * LOOSE, IDLE + 1)  # it is on its way somewhere


def test_the_residual_adds_nothing_to_a_force_by_a_motion_that_is_wild(under_way):
    """Of a fold whose force was 231.4 mN, a residual of a thousandth made 248.5: points moved by 130 mm per mm of depth."""
    here = replace(under_way[1], residual_error=17.0, withheld=0.5)
    assert here.whole_force == here.force + 17.5
    wild = replace(here, motion=130 * here.motion)
    assert wild.wild
    assert wild.whole_force == here.force + 0.5
    assert replace(wild, course=130 * here.course).whole_force == here.force + 17.5  # the path itself goes there


def test_loose_steps_are_told_in_words():
    loose = SolveFacts(loose_steps=2, largest_residual=1.1e-3, residual_error=0.0737)
    (sentence,) = said_of_paths([("along", SolveFacts()), ("across", loose)])
    assert sentence == (
        "test 'across': 2 steps are loose: accepted with up to 0.11% of the contact force unbalanced, "
        "by which a force may err by 7.37%"
    )


def test_a_relaxation_that_cannot_move_fails_with_its_residual(under_way, monkeypatch):
    model, here, increment = under_way
    monkeypatch.setattr(_Mover, "moved", lambda self, *_: None)
    with pytest.raises(ConvergenceError, match="residual still"):
        path.relaxed(model._newton(Controls(1e-6)), increment, here.at)
