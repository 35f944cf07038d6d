"""Result folders, figures and field files: whole or not at all, true to the mechanics, and readable by others."""

import csv
import importlib.metadata
import itertools
import json
import math
import os
import re
import shlex
import warnings
from dataclasses import replace
from types import SimpleNamespace

import meshio
import numpy as np
import pytest
from fixtures.cases import CASES, white_matter
from skfem import ElementHex1, ElementHex2
from skfem.io.meshio import HEX_MAPPING

from indentfit.curve import Curve
from indentfit.errors import OutputError
from indentfit.experiment.measured import read_case
from indentfit.fem.element import XX, XY, YY, ZZ
from indentfit.fem.fields import cell_stress, nodal_stress, recover
from indentfit.fem.setup import Press
from indentfit.fem.simulate import Model
from indentfit.fibres import direction
from indentfit.inference.per_sample import PerSample, SampleFit, parameter_spread
from indentfit.inference.result import ParameterEstimate, Profile
from indentfit.report.folder import copy_case, json_text, refuse_existing, result_folder, write_curves
from indentfit.report.html import write_report
from indentfit.report.mirror import whole
from indentfit.report.per_sample import sample_lines
from indentfit.report.plots import force_displacement, residual
from indentfit.report.solved import Solved
from indentfit.report.vtu import fibre_gradients, file_names, write_vtu
from indentfit.runs.forward import simulate
from indentfit.runs.points import setup_of

QUARTERS = 4  # of a sample

# ---- fields ------------------------------------------------------------------------------------------------------

ELEMENTS = ("q1p0", "q2p1")
# VTK's file formats: edges of a brick by its corners, then faces, in the order of their middle nodes
EDGES = ((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7))
FACES = ((0, 3, 7, 4), (1, 2, 6, 5), (0, 1, 5, 4), (3, 2, 6, 7), (0, 1, 2, 3), (4, 5, 6, 7))
ANGLE, DEPTH = 90, 0.1


@pytest.fixture(scope="module", params=ELEMENTS)
def pressed(request):
    """A model, its result at DEPTH with friction under the sharp strip, material and bulk modulus."""
    case = white_matter("mesh.elements=80", f"solver.element={request.param}")
    material = case.law(**case.start_values())
    kappa = case.material.bulk_modulus(material.shear_modulus)
    model = Model(setup_of(case))
    return model, model.run(Press(material, kappa, ANGLE, np.array([DEPTH]))), material, kappa


@pytest.fixture(scope="module")
def file(pressed, tmp_path_factory):
    """The VTU file of `pressed`, read back by meshio."""
    path = tmp_path_factory.mktemp("vtu") / "pressed.vtu"
    model, result, material, kappa = pressed
    write_vtu(path, recover(model, result, material, kappa))
    return meshio.read(path)


def corners(file):
    return file.points[file.cells[0].data[:, :8]]


def volumes(x):
    """Volumes (n,) of bricks with corners x (n, 8, 3) in VTK's order, as six tetrahedra around the diagonal 0-6."""
    ring = ((1, 2), (2, 3), (3, 7), (7, 4), (4, 5), (5, 1))
    d = x - x[:, :1]
    return sum(np.einsum("ei,ei->e", d[:, 6], np.cross(d[:, a], d[:, b])) for a, b in ring) / 6


def test_every_brick_of_the_file_has_a_positive_volume_and_they_fill_the_quarter(file):
    found, (x, _, z) = volumes(corners(file)), corners(file).reshape(-1, 3).T
    assert found.min() > 0
    rim = np.unique(np.round(np.arctan2(z, x)[np.isclose(np.hypot(x, z), 7)], 9))  # with straight lines between the corners
    assert found.sum() == pytest.approx(3.3 * 7**2 / 2 * np.sin(np.diff(rim)).sum(), rel=1e-6)


def test_middle_nodes_stand_where_vtk_expects_them(file):
    cells = file.cells[0].data
    if cells.shape[1] == 8:
        assert file.cells[0].type == "hexahedron"
        return
    assert file.cells[0].type == "hexahedron27"
    x, middle = corners(file), file.points[cells[:, 8:]]
    ends = x[:, np.array(EDGES)]  # (n, 12, 2, 3)
    along = ends[:, :, 1] - ends[:, :, 0]
    share = np.sum((middle[:, :12] - ends[:, :, 0]) * along, axis=2) / np.sum(along**2, axis=2)
    off = np.linalg.norm(middle[:, :12] - ends[:, :, 0] - share[..., None] * along, axis=2)
    assert share.min() > 0.29 and share.max() < 0.71 and np.all(off < 0.2 * np.linalg.norm(along, axis=2))
    for number, face in enumerate(FACES):  # and on faces where their edges put them
        edges = [EDGES.index(pair) for pair in edges_of(face)]
        at = middle[:, edges].sum(axis=1) / 2 - x[:, list(face)].mean(axis=1)
        assert np.allclose(middle[:, 12 + number], at, atol=1e-9)
    at = middle[:, 12:18].sum(axis=1) / 2 - middle[:, :12].sum(axis=1) / 4 + x.mean(axis=1)
    assert np.allclose(middle[:, 18], at, atol=1e-9)


def test_the_contact_pressure_of_the_file_adds_up_to_the_force(file, pressed):
    _, result, _, _ = pressed
    top = np.isclose(file.points[:, 1], 3.3)
    under = top & (file.points[:, 2] <= 1 + 1e-9)
    pressure = file.point_data["contact_pressure_kPa"]
    assert not pressure[~under].any() and pressure[under].min() >= 0
    assert QUARTERS * integral_over_top(file, pressure, 1.0) == pytest.approx(result.force[-1], rel=0.01)


def integral_over_top(file, values, half_width):
    """Integral over the facets of the top with |z| <= half_width: area times the rule of trapezoids, or Simpson's."""
    total = 0.0
    for cell in file.cells[0].data:
        for number, face in enumerate(FACES):
            nodes = cell[list(face)]
            x = file.points[nodes]
            if not np.allclose(x[:, 1], 3.3) or np.abs(x[:, 2]).max() > half_width + 1e-9:
                continue
            area = np.linalg.norm(np.cross(x[2] - x[0], x[3] - x[1])) / 2
            mean = values[nodes].mean()
            if cell.size == 27:
                edges = [cell[8 + EDGES.index(pair)] for pair in edges_of(face)]
                mean = mean / 9 + 4 / 9 * values[edges].mean() + 4 / 9 * values[cell[20 + number]]
            total += area * mean
    return total


def edges_of(face):
    pairs = ({a, b} for a, b in zip(face, (*face[1:], face[0]), strict=True))
    return [next(edge for edge in EDGES if set(edge) == pair) for pair in pairs]


def test_the_footprint_has_moved_down_by_the_depth_and_the_base_not_at_all(file):
    u, x = file.point_data["displacement_mm"], file.points
    footprint = np.isclose(x[:, 1], 3.3) & (x[:, 2] <= 1 + 1e-9)
    pressed_on = footprint & (file.point_data["contact_pressure_kPa"] > 0)
    assert pressed_on.sum() > 0.8 * footprint.sum()
    assert np.allclose(u[pressed_on, 1], -DEPTH, atol=0.02 * DEPTH)  # the contact springs give way a little
    assert not u[x[:, 1] < 1e-9, 1].any() and not u[x[:, 0] < 1e-9, 0].any() and not u[x[:, 2] < 1e-9, 2].any()


def test_each_layer_of_the_sample_carries_the_force(file, pressed):
    """The stress sigma_yy times volume over thickness of a layer is the force, to the order of the strain of 3 %."""
    _, result, _, _ = pressed
    y = corners(file)[..., 1]
    stress, volume = file.cell_data["cauchy_stress_kPa"][0][:, YY], volumes(corners(file))
    for low in np.unique(np.round(y.min(axis=1), 9)):
        layer = np.isclose(y.min(axis=1), low)
        thickness = np.ptp(y[layer])
        carried = -QUARTERS * np.sum(stress[layer] * volume[layer]) / thickness
        assert carried == pytest.approx(result.force[-1], rel=0.05)


def test_pressure_is_minus_the_mean_normal_stress_and_the_tissue_keeps_its_volume(file, pressed):
    *_, kappa = pressed
    for where in (file.point_data, {key: value[0] for key, value in file.cell_data.items()}):
        stress = where["cauchy_stress_kPa"]
        assert np.allclose(where["pressure_kPa"], -stress[:, [XX, YY, ZZ]].sum(axis=1) / 3)
    J = file.cell_data["J"][0]
    assert np.allclose(kappa * (J - 1), -file.cell_data["pressure_kPa"][0], rtol=1e-6, atol=1e-9 * kappa)
    assert np.abs(J - 1).max() < 0.02


def test_a_uniform_stress_stays_uniform_at_nodes_and_in_elements(pressed):
    """Simple shear gamma of x along y with the fibre along x: s12 = mu (1 + phi) gamma."""
    model, _, material, kappa = pressed
    body, gamma = model.body, 0.1
    u = np.zeros((body.n_dofs // 3, 3))
    u[:, 0] = gamma * body.basis.doflocs[1, ::3]
    fibre = np.array([1.0, 0.0, 0.0])
    state = body.state(u.ravel(), fibre)
    stress = body.stress(u.ravel(), state, material, body.pressure(state, kappa), fibre)
    for recovered in (nodal_stress(body, stress), cell_stress(body, stress)):
        assert np.allclose(recovered[:, XY], 1.49 * 1.68 * gamma, rtol=1e-9)
        assert np.allclose(recovered, recovered[0], atol=1e-9)


# ---- the whole sample --------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def whole_file(pressed, tmp_path_factory):
    path = tmp_path_factory.mktemp("whole") / "pressed.vtu"
    model, result, material, kappa = pressed
    write_vtu(path, whole(recover(model, result, material, kappa)))
    return meshio.read(path)


def test_the_whole_sample_is_four_quarters_in_one_piece(file, whole_file):
    assert volumes(corners(whole_file)).min() > 0
    assert volumes(corners(whole_file)).sum() == pytest.approx(4 * volumes(corners(file)).sum(), rel=1e-12)
    cells = whole_file.cells[0].data
    assert cells.shape == (4 * len(file.cells[0].data), file.cells[0].data.shape[1])
    on_planes = [np.isclose(file.points[:, axis], 0).sum() for axis in (0, 2)]
    on_both = np.sum(np.isclose(file.points[:, 0], 0) & np.isclose(file.points[:, 2], 0))
    assert len(whole_file.points) == 4 * len(file.points) - 2 * sum(on_planes) + on_both
    assert np.array_equal(np.unique(cells), np.arange(len(whole_file.points)))


def test_fields_of_the_whole_sample_are_those_of_the_quarter_mirrored(file, whole_file):
    """At (-x, y, z): u_x, s_xy and s_xz change sign, all else stays; on x = 0 itself those are zero."""
    points = {tuple(np.round(p, 6) + 0.0): n for n, p in enumerate(whole_file.points)}
    signs = {"displacement_mm": [-1, 1, 1], "cauchy_stress_kPa": [1, 1, 1, -1, 1, -1]}
    x, _, z = file.points.T
    inner = np.flatnonzero((x > 1e-6) & (z > 1e-6))
    there = [points[tuple(np.round(p * [-1, 1, 1], 6) + 0.0)] for p in file.points[inner]]
    middle = np.isclose(whole_file.points[:, 0], 0)
    for name, sign in signs.items():
        assert np.allclose(whole_file.point_data[name][there], file.point_data[name][inner] * sign, atol=1e-12)
        assert np.allclose(whole_file.point_data[name][middle][:, np.array(sign) < 0], 0, atol=1e-12)


def test_the_contact_pressure_of_the_whole_sample_adds_up_to_the_full_force(whole_file, pressed):
    _, result, _, _ = pressed
    pressure = whole_file.point_data["contact_pressure_kPa"]
    assert integral_over_top(whole_file, pressure, 1.0) == pytest.approx(result.force[-1], rel=0.01)


def test_names_of_files_are_safe_and_differ_even_where_case_does_not_count():
    names = ["parallel", "Parallel", "0°/a b", "0 a:b", "..", "", "con", "nul.x", "a-2", "a", "A"]
    found = file_names(names)
    assert len({one.lower() for one in found}) == len(names)
    assert all(re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._-]*", one) for one in found)
    assert found[0] == "parallel" and not {"con", "nul.x"} & set(found)


# ---- the folder --------------------------------------------------------------------------------------------------


def test_a_folder_appears_whole_or_not_at_all(tmp_path):
    with result_folder(tmp_path / "out") as folder:
        assert folder.parent == tmp_path and not (tmp_path / "out").exists()
        (folder / "result.json").write_text("{}")
    assert [path.name for path in tmp_path.iterdir()] == ["out"]
    with pytest.raises(ZeroDivisionError), result_folder(tmp_path / "broken") as folder:
        (folder / "result.json").write_text("{")
        raise ZeroDivisionError
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_an_existing_folder_is_refused_with_the_remedy_and_replaced_only_when_asked(tmp_path):
    old = tmp_path / "out"
    old.mkdir()
    (old / "result.json").write_text("old")
    with pytest.raises(OutputError, match=r"out: the folder exists.*--overwrite"), result_folder(old):
        pass
    with pytest.raises(KeyboardInterrupt), result_folder(old, overwrite=True):
        raise KeyboardInterrupt
    assert (old / "result.json").read_text() == "old"
    with result_folder(old, overwrite=True) as folder:
        assert (old / "result.json").read_text() == "old"
        (folder / "result.json").write_text("new")
    assert [path.name for path in tmp_path.iterdir()] == ["out"]
    assert (old / "result.json").read_text() == "new"


def test_overwrite_never_takes_away_a_folder_that_is_not_a_result(tmp_path):
    (tmp_path / "thesis.tex").write_text("years of work")
    with pytest.raises(OutputError, match="not a result folder"):
        refuse_existing(tmp_path, overwrite=True)
    (tmp_path / "empty").mkdir()
    refuse_existing(tmp_path / "empty", overwrite=True)


def test_a_folder_that_comes_into_being_meanwhile_is_kept(tmp_path):
    out = tmp_path / "out"
    with pytest.raises(OutputError, match="exists"), result_folder(out):
        out.mkdir()
        (out / "other.txt").write_text("of another run")
    assert (out / "other.txt").exists() and len(list(tmp_path.iterdir())) == 1


def test_what_cannot_be_written_is_refused_in_one_line(tmp_path):
    (tmp_path / "file").write_text("")
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    bad = ("file", "no/such/parent", "file/below", "x" * 300, "nul\0", "loop")
    for name in bad:
        with pytest.raises(OutputError) as error:
            refuse_existing(tmp_path / name, overwrite=True)
        assert "\n" not in str(error.value) and ("choose" in str(error.value))


def test_a_read_only_parent_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(os, "access", lambda *_: False)  # root, who may run the tests, can write everywhere
    with pytest.raises(OutputError, match="read-only"):
        refuse_existing(tmp_path / "out")


def test_a_full_disk_is_the_users_error_and_leaves_nothing(tmp_path):
    with pytest.raises(OutputError, match="No space left"), result_folder(tmp_path / "out"):
        raise OSError(28, "No space left on device")
    assert not list(tmp_path.iterdir())


def test_json_is_strict():
    value = {"a": np.float64(1.5), "b": np.arange(2), "c": [math.nan, -math.inf], "d": (None, True, np.int64(3))}
    expected = {"a": 1.5, "b": [0, 1], "c": [None, None], "d": [None, True, 3]}
    assert json.loads(json_text(value)) == expected


def test_curves_are_written_with_all_their_digits(tmp_path):
    curve = Curve([0.1, 0.2], [1 / 3, 2 / 3])
    write_curves(tmp_path / "curves.csv", {'a, "b"': curve, "c": curve}, {"c": Curve([0.1, 0.2], [1.0, 2.0])})
    rows = list(csv.reader((tmp_path / "curves.csv").open()))
    assert rows[0] == ["test", "displacement_mm", "force_mN", "measured_force_mN"]
    assert [row[0] for row in rows[1:]] == ['a, "b"'] * 2 + ["c"] * 2
    assert float(rows[1][2]) == 1 / 3 and [row[3] for row in rows[1:]] == ["", "", "1.0", "2.0"]


# ---- the copy of the case ----------------------------------------------------------------------------------------


def test_a_copied_case_is_verbatim_and_the_same_case(tmp_path):
    case = read_case(CASES / "white_matter_2017" / "case.toml")
    assert copy_case(case, tmp_path) == ()
    assert (tmp_path / "case.toml").read_bytes() == case.path.read_bytes()
    assert read_case(tmp_path / "case.toml").hash == case.hash
    assert not (tmp_path / "run_again.txt").exists()


def test_a_copied_case_runs_again_wherever_its_files_were(tmp_path):
    """Curves from outside, of the same name, and one in the place of a file of the result; a plugin; an override."""
    home, out = tmp_path / "lab" / "case", tmp_path / "out"
    text = (CASES / "white_matter_2017" / "case.toml").read_text()
    for place in ("lab/a.csv", "lab/case/curves.csv", "lab/case/sub/a.csv"):
        (tmp_path / place).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / place).write_bytes((CASES / "white_matter_2017/curves/parallel.csv").read_bytes())
    text = text.replace("curves/parallel.csv", "../a.csv").replace("curves/perpendicular.csv", "curves.csv")
    for name, curve in {"third one": str(home / "sub" / "a.csv"), "fourth": "sub/a.csv"}.items():
        text += f'[[test]]\nname = "{name}"\nangle = 0\ncurve = {json.dumps(curve)}\nweight = 0.1\n'
    (tmp_path / "lab" / "plugin.py").write_text(
        "from indentfit.materials.neo_hookean import NeoHookean as Given\nclass Mine(Given):\n    '''psi = mu/2 (I1b - 3)'''\n"
    )
    (home / "my case.toml").write_text(text)
    overrides = ["material={model='../plugin.py:Mine', parameters={mu=1}, bulk_ratio=1000}", "indenter.friction=0.2"]
    case = read_case(home / "my case.toml", overrides)
    out.mkdir()
    again, known = copy_case(case, out), case.hash
    (tmp_path / "lab").rename(tmp_path / "moved away")
    assert (out / "case.toml").read_text() == text and (out / "sub" / "a.csv").exists()
    assert not (out / "curves.csv").exists() and len(list((out / "curves").iterdir())) == 3
    assert read_case(out / "case.toml", again).hash == known
    words = shlex.split((out / "run_again.txt").read_text().splitlines()[-1])
    assert words[:3] == ["indentfit", "COMMAND", "case.toml"] and tuple(words[4::2]) == again
    assert all(path.is_relative_to(out) for path in out.rglob("*"))


# ---- figures -----------------------------------------------------------------------------------------------------


def curves(*stiffnesses, first=0.05):
    d = np.linspace(first, 0.3, 6)
    return [(f"test {n}", Curve(d, k * d)) for n, k in enumerate(stiffnesses)]


def test_a_figure_shows_both_kinds_from_the_origin_in_one_colour_for_each_test(tmp_path):
    figure = force_displacement(curves(70, 170), curves(72, 165), tmp_path / "figure")
    upper, lower = figure.axes
    lines = [line for line in upper.lines if line.get_marker() == "None"]
    marks = [line for line in upper.lines if line.get_marker() != "None"]
    assert [line.get_color() for line in lines] == [line.get_color() for line in marks]
    assert all(line.get_linestyle() == "None" for line in marks) and lines[0].get_color() != lines[1].get_color()
    assert all(line.get_xydata()[0].tolist() == [0, 0] for line in lines)
    assert upper.get_xlim()[0] == 0 and upper.get_ylim()[0] == 0
    assert "mm" in lower.get_xlabel() and "mN" in upper.get_ylabel() and "mN" in lower.get_ylabel()
    assert figure.get_size_inches()[0] * 25.4 == pytest.approx(90)


def test_the_texts_of_a_figure_do_not_overlap_or_leave_it(tmp_path):
    names = ["0° parallel", "90° perpendicular", "_$hidden$ and {strange} x_1^2", "a long name " * 5]
    given = [(name, curve) for name, (_, curve) in zip(names, curves(70, 170, 100, 200), strict=True)]
    figure = force_displacement(given, given[:2], tmp_path / "figure")
    figure.canvas.draw()
    legend = figure.legends[0]
    texts = [text for text in legend.get_texts() if text.get_text()]
    axes = figure.axes
    texts += [label for one in axes for label in (one.xaxis.label, one.yaxis.label) if label.get_text()]
    boxes = [text.get_window_extent() for text in texts] + [one.get_window_extent() for one in axes]
    assert all(figure.bbox.x0 <= box.x0 and box.x1 <= figure.bbox.x1 + 1 for box in boxes)
    assert all(figure.bbox.y0 <= box.y0 and box.y1 <= figure.bbox.y1 + 1 for box in boxes)
    assert not [1 for one, other in itertools.combinations(boxes, 2) if one.overlaps(other)]
    assert len(legend.get_texts()) == 6


def test_a_figure_without_measured_curves_has_no_residuals(tmp_path):
    figure = force_displacement([], curves(70, 170), tmp_path / "figure")
    assert len(figure.axes) == 1
    assert len({line.get_linestyle() for line in figure.axes[0].lines}) == 2  # nothing else tells them apart in grey


def test_a_residual_is_simulated_minus_measured_where_both_are():
    measured, simulated = curves(70)[0][1], Curve([0.1, 0.2], [10.0, 20.0])
    displacement, difference = residual(measured, simulated)
    assert np.allclose(displacement, [0.05, 0.1, 0.15, 0.2]) and np.allclose(difference, 30 * displacement)


def test_the_same_figure_is_the_same_file(tmp_path):
    for name in ("one", "two"):
        force_displacement(curves(70), curves(72), tmp_path / name)
    for ending in (".svg", ".png"):
        assert (tmp_path / f"one{ending}").read_bytes() == (tmp_path / f"two{ending}").read_bytes()


def test_profiles_without_a_confirmed_run_are_as_wide_as_others():
    """Markers of no runs, not clipped, would count as one at the figure's corner and push the panels together."""
    from indentfit.report import plots

    names = ("mu", "zeta", "phi")
    profile = Profile((1.0, 2.0, 3.0), (4.0, 0.0, 4.0), 3.0, (1.2, 2.8))
    known = dict.fromkeys(names, ParameterEstimate(2.0, ""))
    figure = plots.profiles(SimpleNamespace(profiles=dict.fromkeys(names, profile), parameters=known))
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # "axes sizes collapsed to zero"
        figure.canvas.draw()


def test_fits_of_samples_are_a_table_and_the_spread_of_those_that_converged():
    """mu of 1 and 2 kPa: mean 1.5, standard deviation sqrt(1/2); the third did not converge, the fourth has no fit at all."""

    def fitted(mu, success=True, stderr=0.1):
        known = ParameterEstimate(mu, "kPa", stderr=stderr)
        return SimpleNamespace(free=["mu"], parameters={"mu": known}, objective=0.25, success=success)

    fits = [
        SampleFit("a", None, fitted(1.0)), SampleFit("b", None, fitted(2.0, stderr=None)),
        SampleFit("c", None, fitted(50.0, success=False)), SampleFit("d", None, None, "the fibres buckle"),
    ]  # fmt: skip
    head, *rows, gap, spread = sample_lines(PerSample.of(fits, [fitted.sample for fitted in fits]))
    assert head.split() == ["sample", "mu", "mu_stderr", "objective_mN", "success"]
    assert [row.split(maxsplit=4) for row in rows[:3]] == [
        ["a", "1", "0.1", "0.25", "True"], ["b", "2", "unknown", "0.25", "True"], ["c", "50", "0.1", "0.25", "False"],
    ]  # fmt: skip
    assert rows[3].split(maxsplit=1) == ["d", "the fibres buckle"] and gap == ""
    assert spread == "mu        1.5 +- 0.707 (SD) kPa, 1 to 2, n = 2"
    (alone,) = list(sample_lines(PerSample.of(fits[:1], ["a"])))[3:]
    assert alone == "mu        1 kPa, 1 to 1, n = 1"
    assert parameter_spread(fits[2:]) == {}


def test_a_simulation_of_a_case_in_memory_is_said_drawn_written_and_drawn_again(tmp_path):
    """All that `simulate` of the package gives is that of its curves; the page is read from what it has written."""
    case = white_matter("mesh.elements=24", "solver.element=q1p0").model_copy(update={"path": None})
    simulated = simulate(case)
    last = {name: curve.force[-1] for name, curve in simulated.curves.items()}
    assert all(
        f"{name} {force:.4g} mN" in repr(simulated) and f"{force:.3f}" in simulated.summary() for name, force in last.items()
    )
    assert len(simulated.plot().axes) == 2  # with what is left over, since there are measured curves
    simulated.write(tmp_path / "out")
    stored = json.loads((tmp_path / "out" / "simulation.json").read_text(encoding="utf-8"))
    assert next(iter(stored.items())) == ("format", "indentfit.simulation/2")
    assert {test["name"]: test["force_mN"][-1] for test in stored["tests"]} == last
    assert all(f"{force:.5g}" in write_report(tmp_path / "out").read_text(encoding="utf-8") for force in last.values())
    assert read_case(tmp_path / "out" / "case.toml").hash == case.hash


def test_a_file_of_fields_holds_the_fibres_before_and_after_the_deformation_and_what_it_was_computed_from(pressed, tmp_path):
    """I4 of the model's own kinematics is an average of |F a0|^2 over the element, with J^(-2/3) taken out."""
    model, result, material, kappa = pressed
    result = replace(result, name="über")
    solved = Solved(model, material, kappa, [result])
    write_vtu(tmp_path / "f.vtu", solved.fields(result, False), solved.origin(result))
    file = meshio.read(tmp_path / "f.vtu")
    fibre, deformed = (file.cell_data[name][0] for name in ("fibre", "fibre_deformed"))
    assert np.allclose(fibre, direction(ANGLE, 0))
    state = model.body.state(result.last.u, direction(ANGLE, 0))
    number = len(fibre)
    isochoric = np.sqrt(state.I[2].reshape(number, -1).mean(axis=1))
    stretch = np.linalg.norm(deformed, axis=1) / file.cell_data["J"][0] ** (1 / 3)
    assert np.median(np.abs(stretch - isochoric)) < 0.003 and np.corrcoef(stretch, isochoric)[0, 1] > 0.97
    told = file.field_data
    assert told["mu_kPa"] == [material.mu] and told["zeta"] == [material.zeta] and told["kappa_kPa"] == [kappa]
    assert told["angle_deg"] == [ANGLE] and told["depth_mm"] == pytest.approx([DEPTH])
    assert bytes(told["test"].astype(np.uint8)).decode() == result.name
    assert bytes(told["indentfit"].astype(np.uint8)).decode() == importlib.metadata.version("indentfit")


@pytest.mark.parametrize("number", [8, 27])
def test_the_gradient_along_a_fibre_is_exact_for_a_linear_displacement(number):
    rng = np.random.default_rng(3)
    reference = {8: ElementHex1, 27: ElementHex2}[number].doflocs[HEX_MAPPING[:number]]
    nodes = (reference @ (np.eye(3) + 0.2 * rng.random((3, 3))))[None]
    gradient, fibre = rng.random((3, 3)), np.array([0.6, 0.0, 0.8])
    assert np.allclose(fibre_gradients(nodes, nodes @ gradient.T, fibre), gradient @ fibre)
