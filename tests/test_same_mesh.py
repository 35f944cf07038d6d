"""Models that serve other setups: runs that differ in friction, angle, springs or steps share a mesh, with unchanged bits."""

import numpy as np
import pytest
from fixtures.cases import CASES

from indentfit.experiment.measured import read_case
from indentfit.fem.same_mesh import served_by
from indentfit.fem.simulate import Model
from indentfit.runs import bench
from indentfit.runs.bench import Bench
from indentfit.runs.mechanics import mechanics_of
from indentfit.runs.run import RunRequest

WHITE_MATTER, SPHERE = CASES / "white_matter_2017" / "case.toml", CASES / "hydrogel_sphere" / "case.toml"
COARSE = ("mesh.elements=60",)
POINT = {"mu": 1.0, "zeta": 3.0, "phi": 1.0}
TURNED = ("test=[{name='parallel', angle=30, depth=0.2, points=5}]",)


@pytest.fixture
def made(monkeypatch):
    """The setups of the models that benches make."""
    setups, make = [], bench.ready_model
    monkeypatch.setattr(bench, "ready_model", lambda setup: (setups.append(setup), make(setup))[1])
    return setups


def request(point, names=("zeta", "friction"), **inputs):
    return RunRequest(tuple({**point, **inputs}.items()), 0, names)


def same(run, other):
    return np.array_equal(run.force, other.force) and all(
        np.array_equal(run.sensitivities[name], other.sensitivities[name]) for name in run.sensitivities
    )


def test_runs_of_other_friction_share_a_model_and_have_the_bits_of_a_model_of_their_own(made):
    mechanics = mechanics_of(read_case(WHITE_MATTER, COARSE))
    shared = Bench(mechanics)
    runs = {friction: shared.run(request(POINT, friction=friction)) for friction in (0.5, 0.0, 1.0, 0.3)}
    assert len(made) == 1
    for friction, run in runs.items():
        assert run.cause is None
        assert same(run, Bench(mechanics).run(request(POINT, friction=friction)))
    assert runs[0.0].force[-1] < 0.99 * runs[1.0].force[-1]  # (2.6 % less)
    assert shared.run(request(POINT, friction=0.5)).force.tolist() == runs[0.5].force.tolist()


def test_runs_of_other_springs_steps_and_tolerance_share_a_model_and_have_the_bits_of_a_model_of_their_own(made):
    mechanics = mechanics_of(read_case(WHITE_MATTER, COARSE))
    shared, ways = Bench(mechanics), ({}, {"penalty": 0.3}, {"max_step": 0.02}, {"tolerance": 1e-5}, {})
    keys = [{f"solver.{name}": value for name, value in way.items()} for way in ways]
    runs = [shared.run(request(POINT, ("zeta",), **changed)) for changed in keys]
    assert len(made) == 1
    for changed, run in zip(keys, runs, strict=True):
        assert run.cause is None
        assert same(run, Bench(mechanics).run(request(POINT, ("zeta",), **changed)))
    forces = [run.force[-1] for run in runs]
    assert forces[0] == forces[4] and len(set(forces)) == 4
    assert runs[2].facts["steps"] > 2 * runs[0].facts["steps"]


def test_runs_on_two_bases_make_each_model_once(made):
    shared = Bench(mechanics_of(read_case(WHITE_MATTER, COARSE)))
    bases = ("sliding", "bonded")
    first = [shared.run(request(POINT, **{"sample.base": base})) for base in bases]
    again = [shared.run(request(POINT, **{"sample.base": base})) for base in bases]
    assert len(made) == 2
    assert all(same(*pair) for pair in zip(first, again, strict=True))
    assert first[1].force[-1] > 1.1 * first[0].force[-1]


def test_a_bench_keeps_the_last_few_models_only():
    shared = Bench(mechanics_of(read_case(WHITE_MATTER, COARSE)))
    for thickness in (3.3, 3.2, 3.1, 3.0, 2.9, 2.8):
        shared.run(request(POINT, (), **{"sample.thickness": thickness}))
    assert [model.setup.sample.thickness for model in shared._models] == [3.1, 3.0, 2.9, 2.8]


@pytest.mark.parametrize(
    ("case", "overrides", "friction", "other"),
    [
        (WHITE_MATTER, COARSE, 0.5, "stick"),  # springs are others, and under a sharp edge points are tied
        (SPHERE, (), "stick", 0.5),
        (WHITE_MATTER, (*COARSE, *TURNED), 0.5, 0.0),  # a half of the sample: without friction its motion along the bar is held
    ],
)
def test_what_holds_other_points_needs_a_model_of_its_own(case, overrides, friction, other):
    mechanics = mechanics_of(read_case(case, (*overrides, f"indenter.friction={friction!r}")))
    assert served_by(Model(mechanics.setup), mechanics.changed({"indenter.friction": other}).setup) is None


def test_a_model_that_is_broken_off_is_not_used_again(made):
    slow = Bench(mechanics_of(read_case(WHITE_MATTER, COARSE)), limit=1e-9)
    runs = [slow.run(request(POINT, friction=friction)) for friction in (0.5, 0.3)]
    assert all(run.lost for run in runs)
    assert len(made) == 2


def test_an_axisymmetric_model_serves_other_friction(made):
    case = read_case(SPHERE)
    shared = Bench(mechanics_of(case))
    point = case.start_values()
    runs = [shared.run(request(point, ("friction",), friction=friction)) for friction in (0.0, 0.4)]
    assert len(made) == 1
    assert all(
        same(run, Bench(mechanics_of(case)).run(request(point, ("friction",), friction=friction)))
        for run, friction in zip(runs, (0.0, 0.4), strict=True)
    )


def test_a_run_that_needed_sharper_factors_leaves_none_to_the_next_ones():
    shared = Bench(mechanics_of(read_case(WHITE_MATTER, COARSE)))
    first = shared.run(request(POINT, friction=0.3))
    for solver in (shared._models[-1].solver, shared._models[-1].exact):
        assert solver.sharpen()
    assert same(shared.run(request(POINT, friction=0.3)), first)
