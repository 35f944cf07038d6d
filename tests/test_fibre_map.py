"""Directions of fibres on points: the mean between them, their symmetry, bodies and models that have them, and what a case says."""

import json

import numpy as np
import pytest
from fixtures.cases import tiny_case
from numpy.testing import assert_allclose
from skfem import MeshHex

from indentfit.case import Case, Indenter, Mesh, Sample, Solver, write_case
from indentfit.errors import CaseError, CurveError
from indentfit.experiment.measured import changed_case, read_case
from indentfit.fem.element import Solid
from indentfit.fem.forms import FormSolid
from indentfit.fem.setup import Press, Setup
from indentfit.fem.simulate import Model
from indentfit.fibre_map import FibreMap, read_fibre_map, write_fibre_map
from indentfit.fibres import direction, kept_by_map
from indentfit.material import load
from indentfit.runs.forward import simulate
from indentfit.runs.key import Inputs
from indentfit.runs.points import setup_of

PAPER = load("transversely_isotropic")(mu=1.49, zeta=4.68, phi=0.68)
DEPTHS = np.array([0.15, 0.3])


def field(function, size=7, half=6.8, heights=None):
    """A map on a grid of points in the circle, of the angles (degrees) that the function gives of x and z."""
    along = np.linspace(-half, half, size)
    x, z = (part.ravel() for part in np.meshgrid(along, along))
    x, z = (part[np.hypot(x, z) < 6.9] for part in (x, z))
    levels = [np.nan] if heights is None else heights
    points = np.concatenate([np.column_stack([x, np.full(x.size, y), z]) for y in levels])
    angle = np.radians(np.concatenate([np.broadcast_to(function(x, y, z), x.shape) for y in levels]))
    return FibreMap(points, np.column_stack([np.cos(angle), 0 * angle, np.sin(angle)]))


FAN = field(lambda x, y, z: 30 + 4 * x - 3 * z)


def lines(vectors):
    return np.einsum("in,jn->nij", vectors, vectors)


# ---- between the points ---------------------------------------------------------------------------------------------


@pytest.mark.quick
def test_a_map_has_its_points_directions_there_and_those_of_all_where_all_are_the_same():
    at_points = np.nan_to_num(FAN.points).T
    assert_allclose(lines(FAN.at(at_points)), lines(FAN.directions.T), atol=1e-6)
    rng = np.random.default_rng(1)
    same = FibreMap(rng.uniform(-5, 5, (40, 3)), np.tile(direction(35, 20), (40, 1)) * rng.choice([-1, 1], 40)[:, None])
    assert_allclose(lines(same.at(rng.uniform(-7, 7, (3, 50)))), lines(np.tile(direction(35, 20), (50, 1)).T), atol=1e-12)


@pytest.mark.quick
def test_the_sign_of_a_direction_changes_nothing():
    rng = np.random.default_rng(2)
    places = rng.uniform(-6, 6, (3, 60))
    other = FibreMap(FAN.points, FAN.directions * rng.choice([-1, 1], len(FAN.points))[:, None])
    assert_allclose(lines(other.at(places)), lines(FAN.at(places)), atol=1e-12)


@pytest.mark.quick
def test_between_points_the_direction_changes_smoothly_as_the_field_does():
    places = np.random.default_rng(3).uniform(-3.5, 3.5, (3, 200))
    fine = field(lambda x, y, z: 30 + 4 * x - 3 * z, size=15)
    vectors, exact = fine.at(places), 30 + 4 * places[0] - 3 * places[2]
    angle = np.degrees(np.arctan2(vectors[2], vectors[0]))
    assert np.abs((angle - exact + 90) % 180 - 90).max() < 5 / 4  # a quarter of the turn between neighbours
    path = np.array([np.linspace(-5, 5, 4001), np.zeros(4001), np.full(4001, 0.37)])
    steps = np.abs(np.diff(lines(FAN.at(path)), axis=0)).max()
    assert steps < 3e-3  # no jump where a neighbour is replaced by another


@pytest.mark.quick
def test_a_turned_map_is_the_sample_turned():
    turned, places = FAN.turned(25.0), np.random.default_rng(4).uniform(-4, 4, (3, 30))
    c, s = np.cos(np.radians(25)), np.sin(np.radians(25))
    R = np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]])  # takes x to the direction of 25 degrees
    assert_allclose(R @ [1, 0, 0], direction(25), atol=1e-12)
    assert_allclose(lines(turned.at(R @ places)), lines(R @ FAN.at(places)), atol=1e-9)


@pytest.mark.quick
@pytest.mark.parametrize(
    ("function", "part"),
    [
        (lambda x, y, z: 0 * x, "quarter"), (lambda x, y, z: 90 + 0 * x, "quarter"), (lambda x, y, z: 30 + 0 * x, "half"),
        (lambda x, y, z: np.degrees(np.arctan2(z, x)), "quarter"), (lambda x, y, z: 5 * z, "mirror_z"),
        (lambda x, y, z: 5 * x, "mirror_x"), (lambda x, y, z: 20 + x * z, "half"), (lambda x, y, z: 20 + 4 * x, "whole"),
    ],
)  # fmt: skip
def test_the_symmetry_of_a_map_is_noticed(function, part):
    """Angles in the plane: 5 z is odd in z, so its mirror image in z = 0 is itself; 5 x likewise in x = 0."""
    size = 8  # an even number: no point lies in the middle, where the radial field has no direction
    assert kept_by_map(field(function, size)) == part


# ---- bodies and models ----------------------------------------------------------------------------------------------


def largest(a, b):
    return np.max(np.abs(a - b)) / np.max(np.abs(b))


@pytest.mark.parametrize("kind", ["q1p0", "q2p1"])
def test_compiled_loop_and_plain_forms_agree_entry_by_entry_on_a_map(kind):
    mesh = MeshHex.init_tensor([0, 0.6, 1], [0, 1], [0, 0.8])
    mesh = MeshHex(mesh.p + 0.06 * np.random.default_rng(1).uniform(-1, 1, mesh.p.shape), mesh.t)
    compiled, plain = Solid(mesh, kind), FormSolid(mesh, kind)
    rng = np.random.default_rng(2)
    vectors = rng.standard_normal((12, 3))
    fibres = FibreMap(rng.uniform(0, 1, (12, 3)), vectors / np.linalg.norm(vectors, axis=1)[:, None])
    u, kappa = 0.025 * rng.uniform(-1, 1, compiled.n_dofs), 20.0
    state = compiled.state(u, fibres)
    same, pressure = plain.state(u, fibres), compiled.pressure(state, kappa)
    assert_allclose(same.I, state.I, rtol=1e-12, atol=1e-14)
    forces, values = compiled.tangent(u, state, PAPER, pressure, kappa, fibres)
    same_forces, same_values = plain.tangent(u, same, PAPER, pressure, kappa, fibres)
    assert largest(same_forces, forces) < 1e-12 and largest(same_values, values) < 1e-12
    for method in ("residual", "stress"):
        a, b = (getattr(solid, method)(u, state, PAPER, pressure, fibres) for solid in (plain, compiled))
        assert largest(a, b) < 1e-12


@pytest.fixture(scope="module")
def models():
    indenter = Indenter(shape="strip", width=2, length=20, friction=0.4)
    sample = Sample(shape="disc", diameter=14, thickness=3.3, base="sliding")
    solver = Solver(element="q1p0", tolerance=1e-8, max_step=0.0825)
    return {part: Model(Setup(sample, indenter, Mesh(elements=24), solver, 0.3, part)) for part in ("quarter", "half", "whole")}


def press(model, fibres, angle=0.0, sensitivities=(), material=PAPER):
    result = model.run(Press(material, 1490.0, angle, DEPTHS, sensitivities=sensitivities, families=fibres))
    return result if sensitivities else result.force


def test_a_map_of_one_direction_presses_as_this_direction_does(models):
    uniform = models["half"].run(Press(PAPER, 1490.0, 40.0, DEPTHS)).force
    assert_allclose(press(models["half"], field(lambda x, y, z: 40 + 0 * x)), uniform, rtol=1e-8)
    assert_allclose(press(models["half"], field(lambda x, y, z: 15 + 0 * x), 25.0), uniform, rtol=1e-8)


def test_a_map_presses_alike_in_the_whole_and_its_part_and_as_its_images_do(models):
    woven = field(lambda x, y, z: 3 * x * z)
    assert kept_by_map(woven) == "quarter"
    # points that hardly slip tell the parts apart: 6e-5 at the first depth, 3e-6 at the last
    assert_allclose(press(models["whole"], woven), press(models["quarter"], woven), rtol=2e-4)
    here = press(models["whole"], FAN)
    assert_allclose(press(models["whole"], FAN.turned(180)), here, rtol=2e-4)
    mirrored = FibreMap(FAN.points * [1, 1, -1], FAN.directions * [1, 1, -1])
    assert_allclose(press(models["whole"], mirrored), here, rtol=2e-4)
    assert abs(press(models["whole"], FAN, 50.0)[-1] / here[-1] - 1) > 0.02  # the strip feels how the sample lies


def test_fibres_that_turn_through_the_depth_lie_between_those_along_and_across(models):
    turning = field(lambda x, y, z: 0 * x + 90 * y / 3.3, heights=(0.0, 1.1, 2.2, 3.3))
    along, across = (models["quarter"].run(Press(PAPER, 1490.0, angle, DEPTHS)).force[-1] for angle in (0.0, 90.0))
    assert along < press(models["half"], turning)[-1] < across


def test_sensitivities_on_a_map_are_central_differences(models):
    names = ("zeta", "fibre_angle")
    exact = press(models["half"], field(lambda x, y, z: 30 + x * z), 10.0, names).sensitivities
    for name in names:
        step = 0.05 if name == "fibre_angle" else 1e-3 * PAPER.zeta
        changed = [
            (10.0 + d, PAPER) if name == "fibre_angle" else (10.0, PAPER.replace(zeta=PAPER.zeta + d)) for d in (-step, step)
        ]
        low, high = (press(models["half"], field(lambda x, y, z: 30 + x * z), angle, (), law) for angle, law in changed)
        assert_allclose(exact[name], (high - low) / (2 * step), rtol=1e-4, atol=1e-6 * high[-1])


# ---- files and cases ------------------------------------------------------------------------------------------------


def rows(header, function=lambda x, z: 30 + 4 * x, scale=1.0, turn=1.0):
    grid = [(x, z) for x in np.linspace(-6, 6, 7) for z in np.linspace(-6, 6, 7) if np.hypot(x, z) < 6.9]
    return header + "\n" + "".join(f"{x * scale:.10g},{z * scale:.10g},{function(x, z) * turn:.12g}\n" for x, z in grid)


@pytest.mark.quick
def test_units_of_a_file_are_converted_and_a_written_map_is_read_as_it_was(tmp_path):
    (tmp_path / "a.csv").write_text("# from imaging\n" + rows("x_mm,z_mm,angle_deg"))
    first = read_fibre_map(tmp_path / "a.csv")
    assert not first.deep and len(first.points) == 37
    scaled = rows("x_um,z_um,angle_rad", scale=1000.0, turn=np.pi / 180)
    (tmp_path / "c.csv").write_text(scaled)
    third = read_fibre_map(tmp_path / "c.csv")
    assert_allclose(np.nan_to_num(third.points), np.nan_to_num(first.points), atol=1e-9)
    assert_allclose(third.directions, first.directions, atol=1e-10)
    write_fibre_map(tmp_path / "d.csv", first)
    assert read_fibre_map(tmp_path / "d.csv") == first
    deep = field(lambda x, y, z: 10 * y + x, heights=(0.1, 3.0))
    write_fibre_map(tmp_path / "e.csv", deep)
    assert read_fibre_map(tmp_path / "e.csv") == deep


@pytest.mark.quick
@pytest.mark.parametrize(
    ("text", "wrong"),
    [
        ("", "the file is empty"),
        ("x_mm,z_mm\n1,2\n", "no direction; give a column angle_deg"),
        ("x,z_mm,angle_deg\n1,2,3\n", "column 'x' has no unit; write x_mm or x_um"),
        ("x_mm,z_mm,angle\n1,2,3\n", "write angle_deg or angle_rad"),
        ("x_mm,z_mm,angle_mm\n1,2,3\n", "cannot be converted to degree"),
        ("x_mm,z_mm,theta_deg\n1,2,3\n", "column 'theta_deg' is not known"),
        ("x_mm,angle_deg\n1,2\n", "no column z_mm"),
        ("x_mm,z_mm,angle_deg,ax\n1,2,3,4\n", "angles and components"),
        ("x_mm,z_mm,ax_mm,az\n1,2,3,4\n", "components of a direction have none"),
        ("x_mm,z_mm,angle_deg\n1,2,3\n", "1 points; directions of fibres need at least 3"),
        ("x_mm,z_mm,angle_deg\n1,2,3\n1,3,3\n1,2,8\n", "line 4: another line has the same point"),
        ("x_mm,z_mm,ax,az\n1,2,3,1\n1,3,0,0\n1,4,0,1\n", r"line 3: the direction \(0, 0, 0\) is none"),
        ("x_mm,z_mm,angle_deg\n1,2,here\n", "line 2: 'here' is not a number"),
    ],
)
def test_what_is_wrong_with_a_file_is_said_in_one_line(tmp_path, text, wrong):
    (tmp_path / "f.csv").write_text(text)
    with pytest.raises(CurveError, match=wrong) as caught:
        read_fibre_map(tmp_path / "f.csv")
    assert len(str(caught.value).splitlines()) == 1


VALUES = {"model": "transversely_isotropic", "parameters": PAPER.values}
GIVEN = 'sample.directions="fibres.csv"'


def case(folder, overrides=(GIVEN,), text=None, material=VALUES, **tables):
    (folder / "fibres.csv").write_text(rows("x_mm,z_mm,angle_deg") if text is None else text)
    tests = [{"name": "press", "angle": 0, "depth": 0.2, "points": 3}]
    return read_case(tiny_case(folder, test=tests, material=material, **tables), list(overrides))


def test_a_case_simulates_a_map_and_tells_it(tmp_path):
    known = case(tmp_path)
    assert setup_of(known).symmetry == "whole"
    result = simulate(known, mesh_error=False).tests[0]
    assert result.direction == "0°, 37 directions of fibres.csv"
    plain = case(tmp_path, ())
    assert known.hash != plain.hash and Inputs(known).origin != Inputs(plain).origin
    turned = case(tmp_path, text=rows("x_mm,z_mm,angle_deg", lambda x, z: 31 + 4 * x))
    assert known.hash != turned.hash and Inputs(known).origin != Inputs(turned).origin  # the numbers count, not the file's name


@pytest.mark.quick
def test_a_case_with_a_map_is_changed_written_and_read_again(tmp_path):
    known = case(tmp_path)
    assert changed_case(known, ["test.press.angle=20"]).sample.directions == known.sample.directions
    write_case(known, tmp_path / "out")
    again = read_case(tmp_path / "out" / "case.toml")
    assert again.hash == known.hash and again.sample.directions == known.sample.directions
    in_memory = Case(sample=known.sample, indenter=known.indenter, material=known.material, tests=known.tests, mesh=known.mesh)
    assert changed_case(in_memory, ["test.press.angle=20"]).sample.directions == known.sample.directions
    assert json.loads(in_memory.model_dump_json())["sample"]["directions"] == known.sample.directions.as_lists()


TWO = {"model": "two_families", "parameters": {"mu": 1.0, "zeta": 1.0, "phi": 1.0, "second": 1.0}}
BLOCK = {"sample": {"shape": "block", "diameter": None, "length": 14, "width": 14, "thickness": 3.3, "base": "sliding"}}


@pytest.mark.quick
@pytest.mark.parametrize(
    ("options", "wrong"),
    [
        ({"material": {"model": "neo_hookean", "parameters": {"mu": 1.0}}}, r"sample\.directions.*has no fibres; remove the key"),
        ({"material": TWO, "overrides": [GIVEN, "sample.families=[40,-40]"]}, r"sample\.directions.*takes no file of directions"),
        ({"overrides": [GIVEN, "test.press.dip=5"]}, r"test\.press\.dip.*states the dips"),
        ({"overrides": [GIVEN, "test.press.angle=30"], **BLOCK}, r"test\.press\.angle.*would turn the block"),
        ({"overrides": ['sample.directions="no.csv"']}, r"sample\.directions.*no such file"),
        ({"text": rows("x_cm,z_cm,angle_deg")}, r"sample\.directions.*outside the sample.*check the units"),
        ({"text": rows("x_um,z_um,angle_deg")}, r"sample\.directions.*has no point within .* check the units"),
        ({"text": rows("x_mm,z_mm,angle_deg", lambda x, z: 90.0 * (round(x / 2 + z / 2) % 2))}, r"run across each other"),
        ({"text": "x_mm,z_mm,angle_deg\n"}, r"sample\.directions.*0 points"),
    ],
)
def test_what_is_wrong_with_a_map_in_a_case_is_said_in_one_line(tmp_path, options, wrong):
    with pytest.raises(CaseError, match=wrong) as caught:
        case(tmp_path, **options)
    assert len(str(caught.value).splitlines()) == 1
