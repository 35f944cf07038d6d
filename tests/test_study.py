"""sweep and mesh-check: what they compute, that a failed point harms only itself, and that a killed study goes on."""

import contextlib
import csv
import json
import os
import signal
import sqlite3
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner
from fixtures.cases import CASES, tiny_case

from indentfit.cli import main
from indentfit.curve import Curve, write_curve
from indentfit.errors import CaseError, ConvergenceError, MeshError
from indentfit.experiment.measured import read_case
from indentfit.fem.simulate import Model
from indentfit.report.folder import LEDGER
from indentfit.runs import isolated
from indentfit.runs.forward import simulate
from indentfit.runs.ledger import Ledger
from indentfit.runs.points import setup_of
from indentfit.study import mesh_family, mesh_measurement, runs
from indentfit.study.mesh_check import mesh_check
from indentfit.study.mesh_family import estimate, own_checks, own_family
from indentfit.study.mesh_measurement import Measured, measure
from indentfit.study.runs import Execution
from indentfit.study.sweep import sweep
from indentfit.study.variations import plan_sweep, variation

pytestmark = pytest.mark.usefixtures("undrawn")  # the pictures are the subject of test_study_plots.py and test_html.py

QUICK = CASES / "quickstart" / "case.toml"
SMALL = ("mesh.elements=30", "solver.element=q1p0", "test.parallel.depth=0.1", "test.perpendicular.depth=0.1")
OPTIONS = tuple(word for one in SMALL for word in ("--set", one))


@pytest.fixture(scope="module")
def case():
    return read_case(QUICK, SMALL)


def run(*words):
    return CliRunner().invoke(main, list(map(str, words)))


KILLED = """import os, sys
from indentfit.cli import main
from indentfit.runs.ledger import Ledger
add = Ledger.add
def last(self, *run):
    add(self, *run)
    if len(self) == {number}:
        os.kill(os.getpid(), 9)
Ledger.add = last
main()
"""


def killed(number, *words):
    """A command in a process of its own, killed as soon as it has that many runs."""
    program = [sys.executable, "-P", "-c", KILLED.format(number=number), *map(str, words)]
    assert subprocess.run(program, capture_output=True, timeout=120).returncode == -signal.SIGKILL


def kept(folder):
    """The number of runs in the ledger of a study that was killed."""
    with contextlib.closing(sqlite3.connect(folder / LEDGER)) as file:
        return file.execute("SELECT count(*) FROM runs").fetchone()[0]


# ---- sweep: values -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("indenter.friction=0.2, 0.3,stick", ["0.2", "0.3", "stick"]),
        ("indenter.friction=0.2:0.5:4", ["0.2", "0.3", "0.4", "0.5"]),
        ("indenter.friction=+-20%", ["0.4", "0.6"]),
        ("material.mu=±15 %", ["0.85", "1.15"]),
        ("test.parallel.depth=+-10%", ["0.09", "0.11"]),
        ("indenter.edge_radius='50 um',0.1", ["'50 um'", "0.1"]),
        ("material.parameters={mu=1,zeta=2,phi=3},{mu=2,zeta=2,phi=3}", ["{mu=1,zeta=2,phi=3}", "{mu=2,zeta=2,phi=3}"]),
    ],
)
def test_values_are_a_list_a_range_or_percents_of_the_cases_own(case, text, values):
    assert list(variation(case, text).values) == values


@pytest.mark.parametrize(
    "text",
    ["indenter.friction", "=1", "indenter.friction=", "mesh.size=+-10%", "sample.base=+-10%", "indenter.edge_radius=+-5%",
     "material.mu=1,,2", "material.mu=a:b:3", "material.mu=1:2:1", "fit.seed=1,2"],
)  # fmt: skip
def test_a_variation_that_means_nothing_ends_with_2_in_one_line(text, tmp_path):
    done = run("sweep", QUICK, *OPTIONS, "--vary", text, "-o", tmp_path / "out")
    assert done.exit_code == 2 and len(done.stderr.splitlines()) == 1 and "--vary" in done.stderr
    assert not list(tmp_path.iterdir())


def test_every_wrong_value_is_named_before_anything_is_run(case):
    with pytest.raises(CaseError) as error:
        plan_sweep(case, ["indenter.friction=0.2,-1", "material.nu=1", "sample.base=glued"])
    assert len(error.value.faults) == 3 and all("(--vary)" in line for line in error.value.faults)


# ---- sweep: what comes out ---------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def swept(case):
    texts = ["material.mu=+-15%", "material.zeta=+-15%", "indenter.friction=0,stick"]
    return sweep(case, texts, execution=Execution(workers=1))


def point(swept, **values):
    (found,) = [p for p in swept.points if p.values == {key.replace("_", ".", 1): value for key, value in values.items()}]
    return found.tests


def test_the_case_itself_is_what_simulate_gives(case, swept):
    for test in simulate(case).tests:
        found = swept.base.tests[test.name]
        assert np.allclose(found.curve.force, test.force, rtol=1e-5)
        d = test.displacement - test.displacement.mean()
        assert found.stiffness == pytest.approx(d @ test.force / (d @ d), rel=1e-5)  # the normal equation of a line


def test_the_force_is_proportional_to_mu_so_15_percent_are_15_percent(swept):
    for value, change in (("0.85", -0.15), ("1.15", 0.15)):
        for test in point(swept, material_mu=value).values():
            assert test.force_change == pytest.approx(change, abs=1e-4)
            assert test.stiffness_change == pytest.approx(change, abs=1e-4)
    for one in swept.sensitivities:
        if one.key == "material.mu":
            assert one.elasticity == pytest.approx(1, abs=1e-3) and one.trend == "rises"
            assert one.force_span == pytest.approx(0.30, abs=1e-3)


def test_keys_are_ranked_by_what_they_do_and_words_have_no_elasticity(swept):
    keys = list(dict.fromkeys(one.key for one in swept.sensitivities))
    spans = [max(one.force_span for one in swept.sensitivities if one.key == key) for key in keys]
    assert spans == sorted(spans, reverse=True) and keys.index("material.mu") < keys.index("material.zeta")
    friction = [one for one in swept.sensitivities if one.key == "indenter.friction"]
    assert all(one.elasticity is None for one in friction)  # one of its values is 0
    across, along = (next(one for one in friction if one.test == name) for name in ("perpendicular", "parallel"))
    assert across.force_span > 3 * along.force_span  # friction matters across the fibres


def test_a_grid_has_every_combination_and_equal_points_are_run_once(case, monkeypatch):
    count = []
    real = Model.run
    monkeypatch.setattr(Model, "run", lambda self, *a, **k: count.append(a) or real(self, *a, **k))
    vary = {"material.mu": [1, 2], "material.zeta": [3]}
    found = sweep(case, vary, grid=True, execution=Execution(workers=1))
    assert [p.values for p in found.points] == [{"material.mu": mu, "material.zeta": "3"} for mu in ("1", "2")]
    assert found.points[0].tests["parallel"].force_change == 0  # it is the case itself
    assert len(count) == 2 * 2  # two tests at two points


def test_a_key_of_the_case_is_a_point_of_the_same_workers_and_changes_no_number(case):
    """Other friction, base, edge, mesh, springs and bulk modulus need no workers of their own; other depths and materials do."""
    keys = ["indenter.friction=0.2", "sample.base=bonded", "indenter.edge_radius=0.2", "mesh.elements=24", "solver.penalty=3",
            "material.kappa=30", "material.mu=2"]  # fmt: skip
    variants = [case, *(read_case(QUICK, [*SMALL, key]) for key in keys)]
    assert [list(points) for _, points in runs._groups(variants)] == [list(range(8))]
    other = ["test.parallel.depth=0.05", "material={model='neo_hookean',parameters={mu=1},bulk_ratio=1000}"]
    assert len(runs._groups([case, *(read_case(QUICK, [*SMALL, key]) for key in other)])) == 3
    together = runs.evaluate_cases(variants, Execution(workers=1))
    for key, one, found in zip(["", *keys], variants, together, strict=True):
        (alone,) = runs.evaluate_cases([one], Execution(workers=1))
        for ours, theirs, test in zip(found.forces, alone.forces, simulate(one).tests, strict=True):
            assert np.array_equal(ours, theirs), key
            assert np.allclose(ours, test.force, rtol=1e-5), key


@pytest.fixture
def fails_across(monkeypatch):
    """No equilibrium across the fibres where zeta is 9."""
    real = Model.run

    def fails(self, press, *rest):
        if press.angle == 90 and press.material.zeta == 9:
            raise ConvergenceError("the fibres <i>lock</i>", 0.05, 3, 4)
        return real(self, press, *rest)

    monkeypatch.setattr(Model, "run", fails)


def test_a_failed_point_is_shown_with_its_cause_and_the_rest_stands(fails_across, tmp_path):
    done = run("sweep", QUICK, *OPTIONS, "--vary", "material.zeta=2,9,4", "--workers", 1, "-o", tmp_path / "out")
    assert done.exit_code == 0, done.output
    assert "failed    material.zeta = 9" in done.stdout and "the fibres <i>lock</i>" in done.stdout
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    assert [point["tests"] is None for point in result["points"]] == [False, True, False]
    rows = list(csv.DictReader((tmp_path / "out" / "points.csv").open()))
    assert [row["cause"] != "" for row in rows if row["test"] == "parallel"] == [False, False, True, False]
    assert "the fibres &lt;i&gt;lock&lt;/i&gt;" in (tmp_path / "out" / "report.html").read_text()
    assert {path.name for path in tmp_path.iterdir()} == {"out"}
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert {"sweep-material-zeta.svg", "sensitivities.png", "curves.csv", "case.toml"} <= names


def test_a_sweep_in_which_nothing_converges_ends_with_3(monkeypatch, tmp_path):
    def never(*_, **__):
        raise ConvergenceError("chatter", 0.1, 1, 1)

    monkeypatch.setattr(Model, "run", never)
    done = run("sweep", QUICK, *OPTIONS, "--vary", "material.zeta=2,4", "--workers", 1, "-o", tmp_path / "out")
    assert done.exit_code == 3 and "chatter" in done.stderr


def test_a_sweep_that_was_killed_goes_on_where_it_stopped_with_the_same_numbers(tmp_path):
    words = [str(QUICK), *OPTIONS, "--vary", "material.zeta=2,4,5", "--workers", "1", "--json", "-o"]
    killed(3, "sweep", *words, tmp_path / "out")
    assert kept(tmp_path / ".out.unfinished") == 3 and not (tmp_path / "out").exists()
    resumed = run("sweep", *words, tmp_path / "out")
    assert resumed.exit_code == 0 and "resumed: 3 runs" in resumed.stderr
    whole = run("sweep", *words, tmp_path / "whole")

    def forces(done):
        return [(p["values"], {n: t["forces_mN"] for n, t in p["tests"].items()}) for p in json.loads(done.stdout)["points"]]

    assert forces(resumed) == forces(whole)
    assert {path.name for path in tmp_path.iterdir()} == {"out", "whole"}


# ---- mesh-check --------------------------------------------------------------------------------------------------


def record(elements):
    """What a mesh of so many elements would give if the force went like 70 + 6 h and the other like 28 - 2 h^2."""
    h = (160 / elements) ** (1 / 3)
    curves = [np.linspace(0.2, 1, 25) * (28 - 2 * h**2), np.linspace(0.2, 1, 25) * (70 + 6 * h)]
    counts = {"newton_iterations": 50, "factorizations": 9, "tries": 1, "penalty_error": 1e-3}
    costs = {"cpu_seconds": 0.02 * elements, "setup_seconds": 0.1, "memory": 300_000_000}
    return Measured(elements, 30 * elements, h, tuple(curves), **counts, **costs)


def measured_by(monkeypatch, call):
    """call(_, case) in the place of every process that measures a mesh."""
    monkeypatch.setattr(mesh_measurement, "isolated", call)
    monkeypatch.setattr(mesh_measurement, "beside", lambda _, case: contextlib.nullcontext(lambda: call(_, case)))


@pytest.fixture
def ideal(monkeypatch):
    """Meshes without mechanics: `record` in place of every run; returns the numbers of elements that were asked for."""
    asked = []

    def call(_, case):
        asked.append(case.mesh.elements)
        return record(case.mesh.elements)

    measured_by(monkeypatch, call)
    return asked


FAMILY = "40,80,160,320,640,1280"


def check(tmp_path, *words, name="out"):
    done = run("mesh-check", QUICK, "--elements", FAMILY, "--mesh-only", "-o", tmp_path / name, *words)
    assert done.exit_code == 0, done.output
    return done, json.loads((tmp_path / name / "result.json").read_text())


def test_a_known_approach_to_zero_size_is_found_with_its_order_and_limit(ideal, tmp_path):
    _, result = check(tmp_path)
    found = {(one["test"], one["kind"]): one for one in result["quantities"]}
    for test, order, limit in (("parallel", 2, 28), ("perpendicular", 1, 70)):
        one = found[test, "force"]
        assert one["approach"]["order"] == pytest.approx(order, abs=0.01)
        assert one["approach"]["value"] == pytest.approx(limit, rel=1e-4)
        assert one["band"][0] <= limit <= one["band"][1]
        assert one["index"]["order"] == pytest.approx(order, abs=1e-3)
    assert result["meshes"][0]["rmse_mN"].keys() == {"parallel", "perpendicular"}


def test_small_forces_of_a_mesh_check_are_told_in_their_unit_with_five_digits(monkeypatch, tmp_path):
    """Forces of 12 uN that differed by 1 % were 0.012 mN on every mesh."""

    def call(_, case):
        known = record(case.mesh.elements)
        return replace(known, forces=tuple(1e-6 * force for force in known.forces))

    measured_by(monkeypatch, call)
    done, _ = check(tmp_path)
    lines = done.stdout.splitlines()
    assert "parallel, nN" in lines[0] and "perpendicular, uN" in lines[0]  # 28 nN and 0.07 uN
    told = [float(line.split()[7]) for line in lines[1:7]]
    assert told == pytest.approx([28 - 2 * (160 / n) ** (2 / 3) for n in map(int, FAMILY.split(","))], abs=6e-4)
    assert any(line.split()[:3] == ["parallel", "force,", "nN"] and "28.000" in line for line in lines)


def test_the_verdict_is_the_coarsest_mesh_within_the_wanted_error_and_its_cost(ideal, tmp_path):
    """6 h / (70 + 6 h) is 5.1 % at h = 0.63 (640 elements), 6.4 % at 0.79 (320) and 7.9 % at 1 (160)."""
    done, result = check(tmp_path, "--error", "7")
    assert result["meshes"][result["chosen"]]["elements"] == 320
    assert "320 elements" in done.stdout.splitlines()[-2] and "6.4 s" in done.stdout.splitlines()[-2]
    done, result = check(tmp_path, "--error", "2", name="strict")
    assert result["chosen"] is None and "none of these meshes" in done.stdout


def test_a_failed_mesh_is_shown_with_its_cause_and_the_rest_stands(ideal, monkeypatch, tmp_path):
    def call(_, case):
        if case.mesh.elements == 320:
            raise isolated.Died("killed")
        return record(case.mesh.elements)

    measured_by(monkeypatch, call)
    done, result = check(tmp_path)
    assert "failed    mesh.elements=320: its process was killed" in done.stdout
    assert [one["forces"] is None for one in result["meshes"]] == [False, False, False, True, False, False]
    assert result["quantities"][0]["approach"]["value"] == pytest.approx(28, rel=1e-3)


def test_a_mesh_that_needed_a_second_try_is_shown_and_not_counted(ideal, monkeypatch, tmp_path):
    """A second try may be on another mesh: its force, here 5 % off, says nothing of the family's."""

    def call(_, case):
        found = record(case.mesh.elements)
        if case.mesh.elements != 320:
            return found
        return replace(found, tries=2, forces=tuple(1.05 * force for force in found.forces))

    measured_by(monkeypatch, call)
    done, result = check(tmp_path)
    assert "second try mesh.elements=320" in done.stdout and len(result["meshes"]) == 6
    assert [len(one["values"]) for one in result["quantities"]] == [5] * 4
    assert result["quantities"][0]["approach"]["value"] == pytest.approx(28, rel=1e-3)


def test_the_verdict_says_which_orders_are_believed(monkeypatch, tmp_path):
    """Forces like 28 - 2 h^4, an order that no singular edge has: three times the error of a first order covers the limit."""

    def call(_, case):
        found = record(case.mesh.elements)
        return replace(found, forces=(np.full(25, 28 - 2 * found.h**4), found.forces[1]))

    measured_by(monkeypatch, call)
    _, result = check(tmp_path)
    assert "Observed order of the force: 1 (perpendicular)" in result["verdict"]
    assert "4 (parallel) is not believed" in result["verdict"]
    one = next(q for q in result["quantities"] if (q["test"], q["kind"]) == ("parallel", "force"))
    assert one["approach"]["order"] is None and one["band"][0] < 28 < one["band"][1]


def test_a_killed_check_does_not_measure_again_what_it_has(ideal, monkeypatch, tmp_path):
    whole, _ = check(tmp_path, name="whole")
    del ideal[:]
    real = mesh_measurement.isolated

    def killed(function, case):
        if len(ideal) == 3:
            raise KeyboardInterrupt
        return real(function, case)

    measured_by(monkeypatch, killed)
    done = run("mesh-check", QUICK, "--elements", FAMILY, "--mesh-only", "-o", tmp_path / "out")
    assert done.exit_code == 130 and ideal == [40, 80, 160] and not (tmp_path / "out").exists()
    measured_by(monkeypatch, real)
    resumed, _ = check(tmp_path)
    assert ideal == [40, 80, 160, 320, 640, 1280]
    assert (
        resumed.stdout.replace(str(tmp_path / "out"), str(tmp_path / "whole")) == whole.stdout
        and "resumed: 6 runs" in resumed.stderr
    )


def test_changes_of_springs_steps_and_edge_are_those_of_simulate():
    """Real mechanics, by workers that share models."""
    own, other = (*SMALL, "mesh.elements=24"), {"solver.penalty": [0.1], "solver.max_step": [0.01], "indenter.edge_radius": [0.3]}
    case = read_case(QUICK, own)
    checked = mesh_check(case, ["mesh.elements=20", "mesh.elements=24"], other, execution=Execution(workers=2))
    base = [test.force[-1] for test in simulate(case, mesh_error=False).tests]
    assert [change.key for change in checked.changes] == list(other)
    for change in checked.changes:
        tests = simulate(read_case(QUICK, (*own, f"{change.key}={change.value}")), mesh_error=False).tests
        assert change.cause is None and list(change.changes) == [test.name for test in tests]
        for test, first in zip(tests, base, strict=True):
            assert change.changes[test.name] == pytest.approx(test.force[-1] / first - 1, abs=2e-5)
    assert max(map(abs, checked.changes[2].changes.values())) > 1e-3 > max(map(abs, checked.changes[0].changes.values())) > 0


@pytest.mark.campaign  # the suite's time; a killed sweep, and a killed check in the same process, are in it
def test_a_check_killed_with_9_goes_on_with_the_same_numbers(tmp_path):
    """Real processes: the check dies after its first mesh, of two tests, and the same command ends as one never killed."""
    words = [str(QUICK), *OPTIONS, "--elements", "20,40", "--mesh-only", "--json", "-o"]
    killed(2, "mesh-check", *words, tmp_path / "out")
    assert kept(tmp_path / ".out.unfinished") == 2 and not (tmp_path / "out").exists()
    resumed, whole = run("mesh-check", *words, tmp_path / "out"), run("mesh-check", *words, tmp_path / "whole")
    assert resumed.exit_code == 0 and "resumed: 2 runs" in resumed.stderr
    first, second = (json.loads(done.stdout) for done in (resumed, whole))
    assert [one["forces"] for one in first["meshes"]] == [one["forces"] for one in second["meshes"]]
    assert first["quantities"] == second["quantities"] and first["meshes"][0]["forces"]
    assert {path.name for path in tmp_path.iterdir()} == {"out", "whole"}


@pytest.mark.parametrize("words", [("--sizes", "0.02,0.5"), ("--elements", "2000000,60")])
def test_a_mesh_too_large_for_the_memory_is_refused_beforehand_with_the_estimate(ideal, tmp_path, monkeypatch, words):
    monkeypatch.setattr(mesh_family, "available_memory", lambda: 8e9)
    done = run("mesh-check", QUICK, *words, "-o", tmp_path / "out")
    assert done.exit_code == 2 and len(done.stderr.splitlines()) == 1
    assert "GB of memory, of which 8.0 GB are free; ask for a coarser mesh" in done.stderr
    assert not ideal and not list(tmp_path.iterdir())


@pytest.mark.parametrize("words", [("--sizes", "0.5"), ("--elements", "60,,80"), ("--elements", "5,60"), ("--error", "0")])
def test_a_family_that_is_none_ends_with_2(ideal, tmp_path, words):
    done = run("mesh-check", QUICK, *words, "-o", tmp_path / "out")
    assert done.exit_code == 2 and not ideal and not list(tmp_path.iterdir())


@pytest.mark.parametrize("element", ["q1p0", "q2p1"])
@pytest.mark.parametrize("elements", [100, 600])
def test_the_estimate_of_the_size_is_near_the_mesh(element, elements):
    case = read_case(QUICK, [f"mesh.elements={elements}", f"solver.element={element}"])
    about, dofs, memory = estimate(case)
    facts = Model(setup_of(case)).mesh_facts()
    assert about == facts.elements and dofs == pytest.approx(facts.dofs, rel=0.15)
    assert 320e6 < memory < 2e9


def test_a_mesh_is_measured_in_a_process_of_its_own(case):
    """Real mechanics: forces as simulate gives them, time and memory of that process alone."""
    found = isolated.isolated(measure, case)
    for force, test in zip(found.forces, simulate(case).tests, strict=True):
        assert np.allclose(force, test.force, rtol=1e-5)
    assert 0 < found.cpu_seconds < 60 and 50e6 < found.memory < 2e9
    again = isolated.isolated(measure, read_case(QUICK, [*SMALL[1:], f"mesh.size={found.h!r}"]))
    assert again.elements == found.elements and np.allclose(again.forces[0], found.forces[0], rtol=1e-9)  # h is mesh.size


def test_processes_beside_leave_the_environment_as_it_was(monkeypatch):
    """Each had one thread in its environment from its start to its end; those that began later gave "1" back."""
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    with contextlib.ExitStack() as first, contextlib.ExitStack() as second:
        one = first.enter_context(isolated.beside(os.getenv, "OMP_NUM_THREADS"))
        two = second.enter_context(isolated.beside(os.getenv, "OMP_NUM_THREADS"))
        assert "OMP_NUM_THREADS" not in os.environ
        assert one() == two() == "1"
        first.close()
    assert "OMP_NUM_THREADS" not in os.environ


def test_a_process_that_dies_is_an_event_not_an_end():
    with pytest.raises(isolated.Died):
        isolated.isolated(os._exit, 9)
    with pytest.raises(MeshError):
        isolated.isolated(_refuse)


def _refuse():
    raise MeshError("no")


def test_the_default_family_and_checks_are_around_the_case(case):
    family = [int(one.partition("=")[2]) for one in own_family(case)]
    assert len(family) >= 6 and family == sorted(family) and family[0] < estimate(case)[0] < family[-1]
    checks = own_checks(case)
    assert set(checks) == {"solver.penalty", "solver.max_step", "indenter.edge_radius"}
    assert all(len(values) == 3 for values in checks.values()) and max(checks["solver.max_step"]) < 0.1
    assert "indenter.edge_radius" not in own_checks(read_case(QUICK, [*SMALL, "indenter.friction=stick"]))


# ---- refits ------------------------------------------------------------------------------------------------------


@pytest.fixture
def gel(tmp_path):
    """A material with one parameter, which the force is proportional to, and the curve that mu = 2 kPa would give."""
    path = tiny_case(
        tmp_path,
        indenter={"shape": "cylinder", "diameter": 4.0, "width": None, "length": None},
        mesh={"elements": 40},
        test=[{"name": "punch", "angle": 0, "curve": "curve.csv"}],
        fit={"uncertain": {"mesh": 0.0}},  # the curve is one of the case's own mesh
    )
    d = [0.02, 0.04, 0.06, 0.08, 0.1]
    write_curve(tmp_path / "curve.csv", Curve(d, d))
    force = simulate(read_case(path, ["material.mu=2"])).tests[0].force
    write_curve(tmp_path / "curve.csv", Curve(d, [float(f"{f:.9g}") for f in force]))
    return path


def test_refits_find_the_parameter_that_a_stiffer_base_asks_for(gel, tmp_path):
    """A bonded base makes the sample stiffer by some factor, so the same curve asks for a mu smaller by that factor."""
    words = ["--vary", "sample.base=bonded", "--refit", "--workers", 1, "-o", tmp_path / "out"]
    done = run("sweep", gel, "--set", "material.mu={start=1,min=0.1,max=10}", *words)
    assert done.exit_code == 0, done.output
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    own, bonded = (one["parameters"]["mu"]["value"] for one in result["refits"])
    assert own == pytest.approx(2, rel=1e-3)
    forces = [p["tests"]["punch"]["forces_mN"] for p in (result["base"], *result["points"])]
    factor = np.dot(*forces) / np.dot(forces[1], forces[1])  # of the best proportional curve
    assert bonded == pytest.approx(2 * factor, rel=0.01) and factor < 0.9
    assert "sample.base = bonded" in done.stdout.split("fitted with")[1]
    assert "The parameters fitted anew" in (tmp_path / "out" / "report.html").read_text()
    assert {path.name for path in tmp_path.iterdir()} == {"out", "case.toml", "curve.csv"}


def test_what_a_fit_has_run_already_is_taken_from_its_ledger(gel, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert run("fit", gel, "--no-fields", "-o", f"{tmp_path.name}-result").exit_code == 0
    count, real = [], Model.run
    monkeypatch.setattr(Model, "run", lambda self, *a, **k: count.append(a) or real(self, *a, **k))
    done = run("sweep", gel, "--vary", "test.punch.weight=0.5", "--refit", "-o", "out")
    assert done.exit_code == 0, done.output
    assert not count and "runs taken over" in done.stderr  # the same mechanics throughout
    fitted = json.loads((tmp_path / f"{tmp_path.name}-result" / "result.json").read_text())["parameters"]["mu"]
    refits = json.loads((tmp_path / "out" / "result.json").read_text())["refits"]
    assert [one["parameters"]["mu"]["value"] for one in refits] == [fitted["value"]] * 2


def test_a_sweep_that_is_asked_to_stop_keeps_its_runs_and_says_how_to_go_on(tmp_path, monkeypatch):
    real = Ledger.add

    def last(self, *of_run):
        real(self, *of_run)
        if len(self) == 2:
            os.kill(os.getpid(), signal.SIGTERM)

    words = ["sweep", QUICK, *OPTIONS, "--vary", "material.zeta=2,4", "--workers", 1, "-o", tmp_path / "out"]
    with monkeypatch.context() as patch:
        patch.setattr(Ledger, "add", last)
        done = run(*words)
    assert done.exit_code == 128 + signal.SIGTERM
    assert "error: the sweep was stopped before its end; 2 runs are kept, the same command goes on from there" in done.stderr
    assert run(*words).exit_code == 0 and {path.name for path in tmp_path.iterdir()} == {"out"}


def test_a_refit_needs_something_to_fit(tmp_path):
    done = run("sweep", QUICK, *OPTIONS, "--vary", "sample.base=bonded", "--refit", "-o", tmp_path / "out")
    assert done.exit_code == 2 and "a fit needs a measured curve" in done.stderr


# ---- what the machine lost -----------------------------------------------------------------------------------------


def test_a_point_that_was_lost_for_want_of_memory_is_shown_but_computed_again_the_next_time(tmp_path, monkeypatch):
    def no_memory(self, unit, names=()):
        raise MemoryError

    case, path = read_case(QUICK, ["mesh.elements=24", "solver.element=q1p0", "fit.workers=1"]), tmp_path / LEDGER
    with monkeypatch.context() as patch, Ledger(path, case) as ledger:
        patch.setattr("indentfit.runs.bench.Bench.run", no_memory)
        (lost,) = runs.evaluate_cases([case], Execution(ledger=ledger))
    assert lost.forces is None and "out of memory" in lost.cause
    with Ledger(path, case) as ledger:
        assert not ledger
        (found,) = runs.evaluate_cases([case], Execution(ledger=ledger))
        assert found.cause is None and len(ledger) == 2


def test_a_mesh_check_whose_meshes_all_fail_ends_with_3_and_says_why(tmp_path):
    (tmp_path / "bad.py").write_text(
        "from indentfit.material import Material, Parameter\n\n"
        "class Bad(Material):\n    mu = Parameter('kPa', 'mu', min=0)\n\n"
        "    def energy(self, I1):\n        return self.mu * (I1 - 3)\n\n"
        "    def gradient(self, I):\n        if I.size > 40:\n            raise ValueError('two\\nlines')\n"
        "        return super().gradient(I)\n"
    )
    bad = ["--set", f"material.model={tmp_path}/bad.py:Bad", "--set", "material.parameters={mu=1}"]
    done = run("mesh-check", QUICK, *bad, "--elements", "24,30", "--mesh-only", "-o", tmp_path / "out")
    assert done.exit_code == 3
    assert "every mesh failed; the first: the material Bad failed (ValueError: two lines)" in done.stderr
