"""`indentfit simulate`: stdout is the result, stderr the rest, and a folder holds what it took to get there."""

import csv
import io
import json
import math
import sys
import threading
import xml.etree.ElementTree as ET

import meshio
import numpy as np
import pytest
from click.testing import CliRunner
from fixtures.cases import CASES, straight_curve, tiny_case

from indentfit.cli import main, progress
from indentfit.curve import Curve, write_curve
from indentfit.errors import ConvergenceError, Stopped
from indentfit.experiment.measured import read_case
from indentfit.fem.simulate import Model
from indentfit.report.shown import surface
from indentfit.report.vtu import _with_components
from indentfit.runs.forward import simulate
from indentfit.runs.points import setup_of

CASE = CASES / "white_matter_2017" / "case.toml"
COARSE = ("--set", "mesh.elements=60", "--set", "solver.element=q1p0")
DEPTHS = ("--set", "test.parallel.depth=0.06", "--set", "test.perpendicular.depth=0.05")


def run(*words):
    return CliRunner().invoke(main, ["simulate", *map(str, words)])


def never(*_):
    raise AssertionError("computed before the input was checked")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A result folder with fields, and what was printed."""
    path = tmp_path_factory.mktemp("simulate") / "out"
    return path, run(CASE, *COARSE, "-o", path, "--vtu")


def test_json_has_the_stable_keys_and_nothing_else_is_on_stdout():
    done = run(CASE, *COARSE, *DEPTHS, "--set", "material.bulk_ratio=50", "--json")
    assert done.exit_code == 0, done.stderr
    found = json.loads(done.stdout)
    keys = ["format", "indentfit", "title", "case_hash", "parameters", "tests", "mesh", "solver", "moduli", "closed_forms"]
    assert list(found) == keys
    assert (found["moduli"], found["closed_forms"]) == ({}, {})  # the material has fibres
    for test in found["tests"]:
        assert {"name", "angle", "displacement_mm", "force_mN"} <= set(test)
        assert len(test["displacement_mm"]) == len(test["force_mN"]) == 25
        assert np.all(np.diff(test["force_mN"]) > 0)
    assert [(test["name"], test["angle"]) for test in found["tests"]] == [("parallel", 0), ("perpendicular", 90)]
    assert {"elements", "dofs"} <= set(found["mesh"])
    assert {"newton_iterations", "factorizations", "steps", "wall_seconds", "linear"} <= set(found["solver"])
    assert found["solver"]["linear"] in ("pardiso", "superlu", "pyamg")
    assert "warning: kappa" in done.stderr


def test_the_table_has_a_line_for_each_displacement_and_facts_in_words(folder):
    _, done = folder
    assert done.exit_code == 0, done.stderr
    table = [line.split() for line in done.stdout.splitlines() if line.startswith("        0.")]
    forces = np.array(table, dtype=float)
    assert forces.shape == (25, 3) and forces[-1, 0] == 0.33
    facts = ("bricks", "smallest element", "Newton iterations", "penalty error", "edge slip")
    for words in ("mu = 1 kPa (start value)", *facts):
        assert words in done.stdout
    assert "%" in done.stdout.split("edge slip")[1]


def test_tests_of_different_depth_have_tables_of_their_own():
    done = run(CASE, *COARSE, *DEPTHS)
    assert done.stdout.count("force, mN") == 2 and "0.0600" in done.stdout and "0.0500" in done.stdout


def test_the_folder_holds_numbers_curves_figure_fields_and_the_case(folder):
    path, _ = folder
    names = {file.relative_to(path).as_posix() for file in path.rglob("*") if file.is_file()}
    assert names == {
        "simulation.json", "curves.csv", "force_displacement.svg", "force_displacement.png",
        "case.toml", "run_again.txt", "curves/parallel.csv", "curves/perpendicular.csv",
        "fields/parallel.vtu", "fields/perpendicular.vtu", "report.html", "fields/pictures.json", "fields/displacement.png",
        *(f"fields/stress-{component}.png" for component in ("xx", "yy", "zz", "xy", "yz", "xz")),
    }  # fmt: skip
    written = json.loads((path / "simulation.json").read_text())
    case = read_case(path / "case.toml", written["overrides"])
    assert case.hash == written["case_hash"] and written["parameters"] == {"mu": 1, "zeta": 3, "phi": 1}
    again = simulate(case)
    rows = list(csv.DictReader((path / "curves.csv").open()))
    assert list(rows[0]) == ["test", "displacement_mm", "force_mN"]
    for test, stored in zip(again.tests, written["tests"], strict=True):
        mine = [row for row in rows if row["test"] == test.name]
        assert np.allclose([float(row["force_mN"]) for row in mine], test.force, rtol=1e-6)
        assert [float(row["force_mN"]) for row in mine] == stored["force_mN"]
    assert meshio.read(path / "fields/parallel.vtu").cells[0].data.shape[0] == written["mesh"]["elements"]


def test_an_existing_folder_is_refused_before_anything_is_computed(folder, monkeypatch):
    path, _ = folder
    monkeypatch.setattr("indentfit.runs.pieces.Model", never)
    done = run(CASE, "-o", path)
    assert done.exit_code == 2 and "--overwrite" in done.stderr and len(done.stderr.splitlines()) == 1


@pytest.mark.parametrize("option", ["--vtu", "--series", "--whole", "--overwrite"])
def test_what_needs_a_folder_asks_for_one(option, monkeypatch):
    monkeypatch.setattr("indentfit.runs.pieces.Model", never)
    done = run(CASE, option)
    assert done.exit_code == 2 and "-o DIR" in done.stderr


def test_a_run_that_does_not_converge_ends_with_3_in_one_line_and_leaves_no_folder(tmp_path, monkeypatch):
    def fails(*_):
        raise ConvergenceError("test 'parallel': chatter", 0.12, 4, 18)

    monkeypatch.setattr(Model, "simulate", fails)
    done = run(CASE, *COARSE, "-o", tmp_path / "out")
    assert done.exit_code == 3 and done.stdout == "" and not list(tmp_path.iterdir())
    assert done.stderr == "error: no equilibrium at 0.12 mm (step 4, iteration 18): test 'parallel': chatter\n"


# ---- progress ----------------------------------------------------------------------------------------------------


def test_without_a_terminal_progress_is_a_line_now_and_then(capsys, monkeypatch):
    clock = iter([0.0, 3.0, 20.0, 22.0, 200.0])
    monkeypatch.setattr(progress.time, "monotonic", lambda: next(clock))
    lines = progress._Lines("fit", 10)
    for done, note in ((1, "early"), (2, "objective 0.9 mN"), (3, "too soon"), (5, "")):
        lines.step(done, note)
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.splitlines() == [
        "fit: 20% after 20 s, about 80 s left; objective 0.9 mN",
        "fit: 50% after 3 min, about 3 min left",
    ]


def test_a_long_part_of_the_work_is_said_again_with_its_time(capsys, monkeypatch):
    clock = iter([0.0, 3.0, 6.0, 7.0, 8.0, 13.0, 19.0])
    monkeypatch.setattr(progress.time, "monotonic", lambda: next(clock))
    lines = progress._Lines("fit", 1)
    lines.tick(), lines.tick()
    lines.step(0.5, "exploring 7 of 18")
    lines.tick(), lines.tick(), lines.tick()
    assert capsys.readouterr().err.splitlines() == [
        "fit: preparing for 6 s",
        "fit: 50% after 13 s, about 13 s left; exploring 7 of 18 for 6 s",
        "fit: 50% after 19 s, about 19 s left; exploring 7 of 18 for 12 s",
    ]


def test_the_thread_of_the_progress_ticks_and_ends(monkeypatch):
    ticked = threading.Event()
    monkeypatch.setattr(progress, "TICK", 0.001)
    with progress._ticking(ticked.set):
        assert ticked.wait(60)
    assert not [thread for thread in threading.enumerate() if thread.name == "indentfit-progress"]


def terminal_for(monkeypatch):
    """A terminal in the place of stderr, which keeps what is written; no fixture, since pytest sets stderr anew before the test."""

    class Terminal(io.StringIO):
        def isatty(self):
            return True

    written = Terminal()
    monkeypatch.setattr(sys, "stderr", written)
    monkeypatch.setenv("TERM", "xterm")
    return written


def test_on_a_terminal_a_command_says_that_it_is_at_work_where_it_shows_no_bar(monkeypatch):
    terminal = terminal_for(monkeypatch)
    monkeypatch.setattr(progress, "INTERVAL", 0.0)
    monkeypatch.setattr(progress, "TICK", 3600.0)  # the test ticks
    with progress.waiting("fit"):
        (lines,) = progress._waiting
        lines.tick()
        with progress.progress("fit", total=2):
            before = terminal.getvalue()
            lines.tick()
            assert "fit: " not in terminal.getvalue().removeprefix(before)
        lines.tick()
    assert terminal.getvalue().startswith("fit: preparing for 0 s\n") and "fit: finishing for 0 s\n" in terminal.getvalue()
    assert not progress._waiting


@pytest.mark.parametrize("total", [0, math.inf])
def test_progress_without_a_known_total_does_not_fail(total, monkeypatch, capsys):
    monkeypatch.setattr(progress, "INTERVAL", 0.0)
    with progress.progress("fit", total=total) as step:
        step(0)
        step(3, "note")
    assert "fit: " in capsys.readouterr().err


def test_on_a_terminal_progress_is_a_bar_on_stderr(monkeypatch, capsys):
    terminal = terminal_for(monkeypatch)
    with progress.progress("fit", total=2) as step:
        step(1, "objective [0.9] mN")
        print("the result")
    assert capsys.readouterr().out == "the result\n"
    assert "fit" in terminal.getvalue() and "50%" in terminal.getvalue() and "objective [0.9] mN" in terminal.getvalue()


# ---- pictures and the series -------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def series(tmp_path_factory):
    """A result folder with a series of fields, on quadratic bricks."""
    path = tmp_path_factory.mktemp("series") / "out"
    done = run(CASE, "--set", "mesh.elements=60", *DEPTHS, "--series", "-o", path)
    assert done.exit_code == 0, done.stderr
    return path


def entries(path):
    """Displacement and file of each entry of a PVD collection."""
    found = ET.parse(path).getroot().findall("./Collection/DataSet")
    return [(float(one.get("timestep")), path.parent / one.get("file")) for one in found]


def test_a_series_goes_from_the_untouched_sample_to_the_last_displacement(series):
    for name, depth in (("parallel", 0.06), ("perpendicular", 0.05)):
        steps = entries(series / "fields" / f"{name}.pvd")
        assert [d for d, _ in steps] == sorted({d for d, _ in steps})
        assert steps[0][0] == 0 and steps[-1][0] == pytest.approx(depth)
        last, alone = meshio.read(steps[-1][1]), meshio.read(series / "fields" / f"{name}.vtu")
        assert np.array_equal(last.point_data["displacement_mm"], alone.point_data["displacement_mm"])
        for d, file in steps:  # the footprint sinks with the indenter
            mesh = meshio.read(file)
            pressed = mesh.point_data["contact_pressure_kPa"] > 0
            sunk = -mesh.point_data["displacement_mm"][pressed, 1]
            assert not d or np.median(sunk) == pytest.approx(d, rel=0.02)


def test_pyvista_reads_the_file_and_its_contact_pressure_adds_up_to_the_force(series):
    pyvista = pytest.importorskip("pyvista")
    written = json.loads((series / "simulation.json").read_text())
    for test in written["tests"]:
        mesh = pyvista.read(series / "fields" / f"{test['name']}.vtu")
        top = mesh.extract_surface(algorithm="dataset_surface", nonlinear_subdivision=3)
        middle = top.cell_centers().points
        footprint = top.extract_cells((middle[:, 1] > 3.3 - 1e-6) & (middle[:, 2] < 1))
        force = 4 * footprint.integrate_data()["contact_pressure_kPa"][0]
        assert force == pytest.approx(test["force_mN"][-1], rel=0.01)
    steps = entries(series / "fields" / "parallel.pvd")
    reader = pyvista.get_reader(series / "fields" / "parallel.pvd")
    assert reader.time_values == pytest.approx([d for d, _ in steps])
    reader.set_active_time_value(reader.time_values[-1])
    assert np.array_equal(reader.read()[0]["displacement_mm"], meshio.read(steps[-1][1]).point_data["displacement_mm"])


def test_the_whole_sample_is_drawn_and_written_when_asked(tmp_path):
    done = run(CASE, "--set", "mesh.elements=40", *DEPTHS, "--whole", "-o", tmp_path / "out")
    assert done.exit_code == 0, done.stderr
    mesh = meshio.read(tmp_path / "out" / "fields" / "perpendicular.vtu")
    assert mesh.points.min(axis=0) == pytest.approx([-7, 0, -7]) and mesh.points.max(axis=0) == pytest.approx([7, 3.3, 7])
    assert len(mesh.cells[0].data) == 4 * json.loads((tmp_path / "out" / "simulation.json").read_text())["mesh"]["elements"]
    page = (tmp_path / "out" / "report.html").read_text()
    assert "deformed whole sample" in page and "deformed quarter sample" not in page


def test_the_peaks_are_those_of_the_file(series):
    listed = json.loads((series / "fields" / "pictures.json").read_text())
    for table in listed["peaks"]:
        stress = meshio.read(series / "fields" / f"{table['test']}.vtu").point_data["cauchy_stress_kPa"]
        for row, values in zip(table["rows"], stress.T, strict=True):
            assert (row["largest"], row["smallest"]) == pytest.approx((values.max(), values.min()))
            assert row["magnitude"] == pytest.approx(np.abs(values).max())
            share = np.mean(np.abs(values) > row["usual"])
            assert share == pytest.approx(0.01, abs=0.002)
        shears = {row["component"]: row["magnitude"] for row in table["rows"][3:]}
        assert f"largest shear stress is {max(shears, key=shears.get)} " in table["words"]


@pytest.mark.parametrize("element", ["q1p0", "q2p1"])
def test_the_drawn_surface_is_closed_and_holds_the_volume(element):
    """The divergence theorem: areas of a closed surface add up to zero, and x . area to three times the volume."""
    case = read_case(CASE, ["mesh.elements=60", f"solver.element={element}"])
    body = Model(setup_of(case)).body
    x = body.basis.doflocs[:, ::3].T
    quads = surface(body.dofs[:, :, 0] // 3)
    a, b, c, d = (x[quads[:, n]] for n in range(4))
    area = np.cross(c - a, d - b) / 2
    middle = (a + b + c + d) / 4
    outwards = area * np.sign(np.einsum("ij,ij->i", area, middle - x.mean(axis=0)))[:, None]
    assert np.allclose(outwards.sum(axis=0), 0, atol=1e-9)
    rim = np.unique(np.round(np.arctan2(x[:, 2], x[:, 0])[np.isclose(np.hypot(x[:, 0], x[:, 2]), 7)], 9))
    drawn = 3.3 * 7**2 / 2 * np.sin(np.diff(rim)).sum()  # straight from node to node
    assert np.einsum("ij,ij->", outwards, middle) / 3 == pytest.approx(drawn, rel=1e-6)


# ---- curves that end early ---------------------------------------------------------------------------------------------


def _ends(monkeypatch, error):
    """A path that ends with an error at 60 % of the last depth, whatever is tried."""
    from indentfit.fem import path

    step = path._step

    def ends(newton, increment, here, relax):
        if increment.depth > 0.2:
            raise error(increment.depth)
        return step(newton, increment, here, relax)

    monkeypatch.setattr(path, "_step", ends)
    monkeypatch.setattr("indentfit.fem.simulate.SECOND_TRIES", ())


def test_a_curve_that_ends_early_is_printed_and_written_as_far_as_it_goes(tmp_path, monkeypatch):
    _ends(monkeypatch, lambda depth: ConvergenceError("folded", depth))
    done = run(CASE, *COARSE, "-o", tmp_path / "out")
    assert done.exit_code == 3 and "error: no equilibrium" in done.stderr and "folded" in done.stderr
    assert "the curve of test 'parallel' ends at 0.2" in done.stdout or "the curve of test 'parallel' ends at 0.1" in done.stdout
    (test,) = json.loads((tmp_path / "out" / "simulation.json").read_text())["tests"]
    assert 0.1 < test["displacement_mm"][-1] <= 0.2 and "folded" in test["unfinished"]
    assert (tmp_path / "out" / "report.html").exists()


def test_a_stopped_simulation_keeps_its_curve_so_far(monkeypatch):
    _ends(monkeypatch, lambda _: Stopped("stopped as asked", 2))
    done = run(CASE, *COARSE, "--json")
    assert done.exit_code == 130 and "stopped as asked" in done.stderr
    assert json.loads(done.stdout)["tests"][0]["unfinished"] == "stopped as asked"


def test_the_measured_curve_stands_beside_the_simulated_one(tmp_path):
    """A force of 3 mN/mm, and one three times the model's own: 2/3 of the largest measured force is missed, in the root mean square
    as the curve's own root mean square says."""
    straight_curve(tmp_path / "parallel.csv", 3.0)
    path = tiny_case(tmp_path)
    alone = json.loads(run(path, "--json").stdout)["tests"][0]
    own = Curve(alone["displacement_mm"], [3 * force for force in alone["force_mN"]])
    write_curve(tmp_path / "parallel.csv", own)
    done = run(path, "-o", tmp_path / "folder")
    expected = 2 / 3 * np.sqrt(np.mean(own.force**2)) / own.force.max()
    assert f"misfit    parallel {100 * expected:.3g} %" in done.stdout
    stored = json.loads((tmp_path / "folder" / "simulation.json").read_text())
    assert stored["misfits"]["parallel"] == pytest.approx(expected, rel=1e-9)
    assert stored["measured"]["parallel"]["force_mN"] == own.force.tolist()
    page = (tmp_path / "folder" / "report.html").read_text()
    assert "Markers: the measured curves" in page and f"misses the measured forces by {100 * expected:.3g} %" in page.replace(
        "\u00a0", " "
    )


def test_components_of_fields_have_names_and_the_file_is_read_as_before(tmp_path):
    mesh = meshio.Mesh(
        [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]],
        [("tetra", [[0, 1, 2, 3]])],
        point_data={"cauchy_stress_kPa": np.arange(24.0).reshape(4, 6), "displacement_mm": np.ones((4, 3))},
    )
    meshio.write(tmp_path / "f.vtu", mesh)
    text = _with_components((tmp_path / "f.vtu").read_text())
    (tmp_path / "f.vtu").write_text(text)
    arrays = {array.get("Name"): array for array in ET.fromstring(text).iter("DataArray")}
    assert [arrays["cauchy_stress_kPa"].get(f"ComponentName{n}") for n in range(6)] == ["xx", "yy", "zz", "xy", "yz", "xz"]
    assert arrays["displacement_mm"].get("ComponentName1") == "y"
    assert (meshio.read(tmp_path / "f.vtu").point_data["cauchy_stress_kPa"] == np.arange(24.0).reshape(4, 6)).all()
