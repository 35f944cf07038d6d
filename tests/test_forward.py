"""What the paper says about friction and parameters, and that the forward model stands what a search will ask of it."""

import pickle
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fixtures.cases import white_matter
from threadpoolctl import threadpool_info

from indentfit.errors import ConvergenceError, OutOfTime
from indentfit.fem import deadline, path
from indentfit.fem import simulate as simulation
from indentfit.fem.controls import Controls
from indentfit.fem.deadline import Deadline
from indentfit.fem.facts import SolveFacts, said_of_tries
from indentfit.fem.newton import Newton
from indentfit.fem.setup import Press
from indentfit.fem.simulate import USUAL, Model, _threads
from indentfit.inference.fit import fit
from indentfit.report.text import simulation_lines
from indentfit.runs.forward import presses_of, simulate
from indentfit.runs.points import setup_of

sys.path.insert(0, str(Path(__file__).parent / "campaigns"))
import robustness

COARSE = ("mesh.elements=60",)
# of the robustness campaign: sharp and sliding, round and bonded, round and sliding, sharp and bonded; half of them at 90 degrees
SAMPLE = [0, 7, 9, *(pytest.param(n, marks=pytest.mark.campaign) for n in (2, 4, 5, 6, 8, 13, 14))]
DEPTHS = np.array([0.11, 0.22, 0.33])


def test_friction_stiffens_only_the_perpendicular_test(run):
    rough, smooth = (
        [run(*COARSE, f"indenter.friction={f}", angle=angle, depths=DEPTHS).force[-1] for angle in (0, 90)] for f in (0.5, 0.2)
    )
    assert smooth[0] == pytest.approx(rough[0], rel=0.01)
    assert smooth[1] < rough[1] * 0.995


@pytest.mark.campaign
def test_mu_matters_more_than_zeta_and_zeta_more_than_phi_and_most_at_90_degrees(run):
    def change(angle):
        base = {"mu": 1.49, "zeta": 4.68, "phi": 0.68}
        forces = {}
        for name in base:
            ends = [base | {name: base[name] * share} for share in (0.85, 1.15)]
            texts = ["material.parameters={" + ",".join(f"{k}={v}" for k, v in end.items()) + "}" for end in ends]
            low, high = (run(*COARSE, text, angle=angle, depths=DEPTHS).force[-1] for text in texts)
            forces[name] = high - low
        return forces

    along, across = change(0), change(90)
    assert across["mu"] > across["zeta"] > across["phi"] > 0
    assert all(across[name] > along[name] for name in across)


def test_the_force_is_linear_in_the_scale_parameter(run):
    exact = *COARSE, "solver.tolerance=1e-8"  # at the usual one forces are within 2e-9, as round-off decides
    one, three = (
        run(*exact, f"material.parameters={{mu={mu},zeta=4.68,phi=0.68}}", angle=90, depths=DEPTHS).force for mu in (1.0, 3.0)
    )
    assert three == pytest.approx(3 * one, rel=1e-10)


@pytest.mark.campaign
def test_softer_contact_springs_change_the_force_by_less_than_half_a_percent(run):
    usual, stiff = (run(*COARSE, f"solver.penalty={p}", angle=90, depths=DEPTHS) for p in (1, 10))
    assert usual.force == pytest.approx(stiff.force, rel=0.005)
    assert abs(usual.facts.penalty_error) < 0.005


def test_more_load_steps_change_the_curve_by_less_than_a_third_of_a_percent(run):
    usual, many = (run(*COARSE, f"solver.max_step={step}", angle=90, depths=DEPTHS) for step in (1.0, 0.015))
    assert many.facts.steps >= 22
    assert usual.force == pytest.approx(many.force, rel=0.003)


def test_hard_steps_get_no_shorter_than_a_hundredth_of_the_depth(run, monkeypatch):
    """Else a path on which every step is hard would come nearer and nearer to a depth, and never there."""
    usual = path._step

    def hard(*of_step):
        there, _, equations = usual(*of_step)
        return there, path.HARD, equations

    monkeypatch.setattr(path, "_step", hard)
    found = run("mesh.elements=20", angle=0, depths=DEPTHS)
    assert found.facts.steps <= 1 / path.SMALLEST_STEP
    assert found.path[-1].depth == DEPTHS[-1]


def test_a_later_try_is_a_mesh_of_half_the_elements_and_the_result_says_so(monkeypatch):
    case = white_matter("mesh.elements=60")
    usual, model = Model._run, Model(setup_of(case))
    tried = []

    def fails_but_on_coarser_meshes(self, attempt, *of_run):
        tried.append((attempt.springs, self.rim, self.mesh.nelements))
        if self.mesh.nelements > 0.7 * model.mesh.nelements:
            raise ConvergenceError("a corner folds up", 0.1)
        return usual(self, attempt, *of_run)

    monkeypatch.setattr(Model, "_run", fails_but_on_coarser_meshes)
    material = case.law(mu=1.49, zeta=4.68, phi=0.68)
    press = Press(material, 1490.0, 0, np.array([0.1]))
    announced = []
    found = model.run(press, lambda share, tries=1: announced.append((share, tries)))
    assert announced[:2] == [(0.0, 2), (0.0, 3)] and announced[-1] == (1.0, 3)  # when a try begins, not when it ends
    assert len(set(tried)) == len(tried) == found.facts.tries == 3
    assert found.facts.elements == found.model.mesh.nelements < 0.7 * model.mesh.nelements
    (said,) = said_of_tries([("parallel", found.facts), ("perpendicular", SolveFacts())])
    assert f"'parallel' was solved at try 3, on a mesh of {found.model.mesh.nelements} elements" in said
    assert "a corner folds up" in said
    lines = list(simulation_lines(model.simulate(presses_of(case, material)), case, material))
    assert sum(line.startswith("note      test 'p") for line in lines) == 2
    assert found.force == pytest.approx(usual(model, USUAL, press, Controls(1e-6)).force, rel=0.05)


class Clock:
    """Processor time that moves on by a second at each look, from a look on."""

    def __init__(self, runs_from):
        self.looks, self.runs_from = 0, runs_from

    def __call__(self):
        self.looks += 1
        return float(max(self.looks - self.runs_from, 0))


@pytest.mark.parametrize("runs_from", [1, 5, 15, 30])
def test_a_run_beyond_its_deadline_ends_at_once_and_is_not_tried_again(runs_from, monkeypatch):
    """Wherever the time is over: on the path, in Newton's iteration, in GMRES. The next look at the clock is the last one."""
    case = white_matter("mesh.elements=20")
    model, tried = Model(setup_of(case)), []
    usual, clock = Model._run, Clock(runs_from)
    monkeypatch.setattr(Model, "_run", lambda self, *of_run: tried.append(1) or usual(self, *of_run))
    monkeypatch.setattr(deadline.time, "process_time", clock)
    (press, _) = presses_of(case, case.law(mu=1.49, zeta=4.68, phi=0.68))
    with pytest.raises(OutOfTime, match=r"not solved within 1\.5 s of processor time"):
        model.run(press, deadline=Deadline(1.5))
    assert len(tried) == 1 and clock.looks == runs_from + 2  # 1 s is within the limit, 2 s are not


def test_a_run_out_of_time_says_how_far_it_came_or_why_its_first_try_failed(monkeypatch):
    case = white_matter("mesh.elements=20")
    model, usual = Model(setup_of(case)), path._step
    (press, _) = presses_of(case, case.law(mu=1.49, zeta=4.68, phi=0.68))

    def late(newton, increment, here, relax):
        if here.depth > 0:
            raise OutOfTime(9.0)
        return usual(newton, increment, here, relax)

    monkeypatch.setattr(path, "_step", late)
    with pytest.raises(OutOfTime, match=r"within 9 s of processor time: the curve was known to 0\.0825 mm of 0\.33 mm") as caught:
        model.run(press)
    assert pickle.loads(pickle.dumps(caught.value)).cause == caught.value.cause

    def folds(self, *of_run):
        clock.looks = 10**9
        raise ConvergenceError("the rim folds", 0.2, 3, 4)

    clock = Clock(10)
    monkeypatch.setattr(deadline.time, "process_time", clock)
    monkeypatch.setattr(Model, "_run", folds)
    with pytest.raises(OutOfTime, match=r"processor time: the first try failed, and others took too long: .*the rim folds"):
        model.run(press, deadline=Deadline(1.5))


def test_relaxation_looks_at_the_deadline(monkeypatch):
    """A fold that only relaxation gets over, with a clock that stands still until it begins."""
    case = white_matter("mesh.elements=20")
    model, clock = Model(setup_of(case)), Clock(10**9)
    usual = path.relaxed

    def relaxed(*words):
        clock.runs_from = clock.looks
        return usual(*words)

    def never(self, increment, at, most=0, rests=None):
        raise ConvergenceError("no equilibrium by Newton's iteration", increment.depth)

    monkeypatch.setattr(path, "relaxed", relaxed)
    monkeypatch.setattr(Newton, "equilibrium", never)
    monkeypatch.setattr(path, "SHORT", 2.0)  # every step may be relaxed
    monkeypatch.setattr(deadline.time, "process_time", clock)
    (press, _) = presses_of(case, case.law(mu=1.49, zeta=4.68, phi=0.68))
    with pytest.raises(OutOfTime):
        model.run(press, deadline=Deadline(4.5))
    assert clock.looks == clock.runs_from + 5


@pytest.fixture(scope="module")
def under_way():
    """A model under way, its press and loading, the equilibrium where it is, and the increment of its next step."""
    case = white_matter("mesh.elements=20")
    model = Model(setup_of(case))
    (press, _) = presses_of(case, case.law(mu=1.49, zeta=4.68, phi=0.68))
    here = model.run(press).path[1]
    return model, here, path._increment(model.equations, model._loading(press, here.springs), here, here.depth + 0.02, 0.01)


def test_a_tangent_that_is_nearly_singular_leads_no_step(under_way):
    """A motion of 37 mm per mm of depth led to forces of 1e18 mN, from which 80 iterations found no way back."""
    _, here, increment = under_way
    assert np.array_equal(path._predicted(increment, here).u, here.u + (increment.depth - here.depth) * here.motion)
    wild = here.motion.copy()
    wild[np.abs(wild).argmax()] *= 37
    led = path._predicted(increment, replace(here, motion=wild)).u
    assert np.array_equal(led, here.u + (increment.depth - here.depth) * here.course)


def test_a_relaxation_takes_stiffer_dampers_where_a_damped_tangent_is_singular(under_way, monkeypatch):
    model, here, increment = under_way
    newton, usual, damped = model._newton(Controls(1e-6)), model.solver.renew, []

    def renew(tangent):
        damped.append(tangent.factorised.diagonal().sum())
        if len(damped) == 1:
            raise ConvergenceError("the linear system could not be solved (singular tangent)")
        usual(tangent)

    monkeypatch.setattr(model.solver, "renew", renew)
    there, _ = path.relaxed(newton, increment, here.at)
    assert damped[1] > damped[0]
    assert there.force == pytest.approx(newton.equilibrium(increment, here.at)[0].force, rel=1e-4)


def test_a_fine_mesh_that_takes_too_many_iterations_is_given_up_for_one_with_a_wider_rim(run, monkeypatch):
    """A strip on 992 bonded bricks, with fibres across it, followed one small fold of the rim after the other; with a rim four
    times as wide, in shorter steps, there are none. Here any iteration is one too many."""
    usual = run(*COARSE, "solver.linear='superlu'", angle=0, depths=DEPTHS)
    monkeypatch.setattr(simulation, "FINE", 0)
    monkeypatch.setattr(simulation, "FINE_ITERATIONS", 0)
    again = run(*COARSE, "solver.linear='superlu'", angle=0, depths=DEPTHS)
    assert (usual.facts.tries, again.facts.tries) == (1, 2)
    assert "iterations led no further" in again.facts.first_failure
    assert again.facts.steps == 3 * usual.facts.steps
    assert again.force == pytest.approx(usual.force, rel=0.01)


def test_a_deadline_that_is_far_changes_nothing(run):
    case = white_matter("mesh.elements=20")
    model = Model(setup_of(case))
    (press, _) = presses_of(case, case.law(mu=1.49, zeta=4.68, phi=0.68))
    assert np.array_equal(model.run(press).force, model.run(press, deadline=Deadline(1e6)).force)


def test_a_fit_says_that_its_optimum_was_not_solved_at_the_first_try(monkeypatch):
    usual = Model._run

    def fails_at_first(self, attempt, *of_run):
        if self.rim == 1:
            raise ConvergenceError("a corner folds up", 0.1)
        return usual(self, attempt, *of_run)

    monkeypatch.setattr(Model, "_run", fails_at_first)
    keys = "fit.workers=1", "fit.method=least_squares", "fit.starts=1", "fit.profiles=false", "fit.uncertain.mesh=0"
    fixed = "material.parameters={mu={start=1,min=0.1,max=10},zeta=4.68,phi=0.68}"
    notes = fit(white_matter("mesh.elements=30", *keys, fixed)).notes
    assert sum("was solved at try 2" in note and "a corner folds up" in note for note in notes) == 2


def test_multigrid_and_a_direct_solver_give_the_same_curve(run):
    curves = [
        run(
            "solver.element='q1p0'",
            "mesh.elements=300",
            "solver.tolerance=1e-8",
            f"solver.linear='{kind}'",
            angle=90,
            depths=DEPTHS,
        ).force
        for kind in ("pyamg", "superlu")
    ]
    assert curves[0] == pytest.approx(curves[1], rel=1e-6)


@pytest.mark.parametrize("index", SAMPLE)
def test_a_sample_of_the_robustness_campaign_is_solved(index):
    """Points of `campaigns/robustness.py` on a coarse mesh; the campaign itself runs all of them on the default one."""
    outcome = robustness.run((index, robustness.sample_points(100)[index], list(COARSE)))
    assert outcome["force_mN"] is not None, outcome["cause"]
    assert np.all(np.diff(outcome["force_mN"]) > 0)


@pytest.mark.parametrize("number", [143, 210])
def test_a_corner_that_is_held_does_not_fold(number):
    """Points of the campaign on its own mesh. 143 sticks to an edge of 0.05 mm, which soft springs let it roll off; 210's sample
    rolls up against the overhanging strip. Both folded, and were solved by later tries alone, before the contact held them."""
    found = robustness.run((number, robustness.all_points()[number], []))
    assert found["cause"] is None and found["facts"]["tries"] == 1
    assert found["facts"]["loose_steps"] == 0
    assert np.all(np.diff(found["force_mN"]) > 0)


def test_twenty_percent_strain_at_the_papers_optimum_is_solved(run):
    for angle in (0, 90):
        force = run(*COARSE, angle=angle, depths=np.array([0.33, 0.66])).force
        assert force[1] > 2 * force[0]


def test_a_bonded_base_and_a_full_case_give_one_result_for_each_test():
    simulation = simulate(white_matter(*COARSE, "sample.base=bonded"))
    assert [test.name for test in simulation.tests] == ["parallel", "perpendicular"]
    assert simulation.tests[1].force[-1] > 1.5 * simulation.tests[0].force[-1]


@pytest.mark.parametrize(("n_dofs", "everything"), [(5_000, True), (100_000, False)])
def test_threads_of_the_libraries(n_dofs, everything):
    """One on small meshes; on large ones the solver's may be more, but not those of NumPy's OpenBLAS beside them."""
    with _threads(n_dofs):
        pools = threadpool_info()
    blas = [pool for pool in pools if pool["internal_api"] == "openblas"]
    if not blas:
        pytest.skip("NumPy is not built on OpenBLAS here")
    assert all(pool["num_threads"] == 1 for pool in (pools if everything else blas))
    own = {pool["filepath"]: pool["num_threads"] for pool in threadpool_info()}
    assert everything or all(pool["num_threads"] == own[pool["filepath"]] for pool in pools if pool not in blas)


def test_stiff_fibres_across_the_bar_are_followed_without_cutbacks():
    """At the search's bound of zeta the side of the sample comes to touch the bar; points anchored where they touch snapped there,
    with 27 factorisations for 9."""
    across = simulate(white_matter("material.parameters.zeta=20", "material.parameters.phi=0")).tests[1].facts
    assert across.cutbacks == 0 and across.tries == 1
    assert across.factorizations < 15
