"""Displacements measured beside the force: read, seen in a solution, differentiated, and fitted."""

from dataclasses import replace

import numpy as np
import pytest

from indentfit import Case, Curve, Test, fit
from indentfit.case import Indenter, MaterialChoice, Mesh, Sample, Solver
from indentfit.case.field_tests import with_field_tests
from indentfit.case.measured_field import MeasuredField
from indentfit.displacements import MOST, Displacements, averaged, read_displacements, write_displacements
from indentfit.errors import CaseError, CurveError
from indentfit.fem.observation import Observed, rows_of
from indentfit.fem.setup import Press, Setup
from indentfit.fem.simulate import Model
from indentfit.material import load
from indentfit.outlines import beyond, beyond_change, chain
from indentfit.report.displacement_files import read_displacements as read_fitted
from indentfit.runs.mechanics import _outline_seen
from indentfit.runs.points import setup_of
from indentfit.study.mesh_check import mesh_check

THICKNESS, RADIUS = 3.0, 5.0
SYMMETRIC = {  # of each part, a linear motion that its symmetry allows
    "quarter": np.diag([0.02, -0.03, 0.01]),
    "half": np.array([[0.02, 0, 0.004], [0, -0.03, 0], [0.007, 0, 0.01]]),
    "mirror_x": np.array([[0.02, 0, 0], [0, -0.03, 0.005], [0, 0.002, 0.01]]),
    "mirror_z": np.array([[0.02, 0.004, 0], [0.006, -0.03, 0], [0, 0, 0.01]]),
    "whole": np.array([[0.02, 0.003, 0.004], [0.001, -0.03, 0.005], [0.007, 0.002, 0.01]]),
    "axisymmetric": np.diag([0.02, -0.03, 0.02]),
}


def setup(symmetry="quarter", element="q2p1", elements=60, friction=0.3, shape="strip", tolerance=1e-3, depth=0.3):
    sample = Sample(shape="disc", diameter=2 * RADIUS, thickness=THICKNESS, base="sliding")
    bar = Indenter(shape="strip", width=2, length=20, friction=friction)
    ball = Indenter(shape="sphere", diameter=4, friction=friction)
    solver = Solver(element=element, tolerance=tolerance)
    return Setup(sample, bar if shape == "strip" else ball, Mesh(elements=elements), solver, depth, symmetry)


def places(n=60, seed=0):
    """Points of the whole sample, some of them on its surface, and directions."""
    rng = np.random.default_rng(seed)
    radius, angle = RADIUS * np.sqrt(rng.random(n)) * 0.97, rng.uniform(0, 2 * np.pi, n)
    points = np.column_stack([radius * np.cos(angle), rng.random(n), radius * np.sin(angle)])
    points[:5, 1], points[5:10, 1] = 1.0, 0.0
    directions = rng.standard_normal((n, 3))
    return points, directions / np.linalg.norm(directions, axis=1)[:, None]


@pytest.mark.parametrize("symmetry", SYMMETRIC)
@pytest.mark.parametrize("element", ["q2p1", "q1p0"])
def test_a_linear_motion_is_seen_anywhere_in_the_whole_sample(symmetry, element):
    if symmetry == "axisymmetric" and element == "q1p0":
        pytest.skip("the plane has one element")
    given = setup(symmetry, element, shape="sphere" if symmetry == "axisymmetric" else "strip")
    body, A = Model(given).body, SYMMETRIC[symmetry]
    points, directions = places()
    rows = rows_of(body, None if given.in_plane else given.part, Observed.single(points, directions, np.ones(60)), THICKNESS)
    nodes = body.points()
    if symmetry == "axisymmetric":
        u = (np.diag([A[0, 0], A[1, 1]]) @ nodes).T.ravel()
    else:
        u = (A @ nodes).T.ravel()
    exact = np.sum(directions * (points * [1, THICKNESS, 1] @ A.T), axis=1)
    assert rows @ u == pytest.approx(exact, abs=1e-12)


@pytest.fixture(scope="module")
def law():
    return load("transversely_isotropic")


@pytest.mark.parametrize("shape", ["strip", "sphere"])
def test_sensitivities_of_displacements_are_derivatives(law, shape):
    symmetry = "quarter" if shape == "strip" else "axisymmetric"
    kind = law if shape == "strip" else load("mooney_rivlin")
    values = {"mu": 1.2, "zeta": 3.0, "phi": 0.8} if shape == "strip" else dict.fromkeys(kind.parameters, 1.0)
    model = Model(setup(symmetry, "q1p0" if shape == "strip" else "q2p1", shape=shape, tolerance=1e-10))
    points, directions = places(20)
    seen = Observed.single(points, directions, np.repeat([0.3, 0.17], 10))
    depths = np.linspace(0.03, 0.3, 6)

    def run(changed, kappa=1000.0, names=()):
        material = kind(**{**values, **changed})
        return model.run(Press(material, kappa * material.shear_modulus, 90, depths, "", names, observed=seen))

    names = [name for name in values if name != "mu"]
    known = run({}, names=(*names, "bulk_ratio", "offset")).seen_by
    for name in names:
        h = 1e-3 * values[name]
        central = (run({name: values[name] + h}).seen - run({name: values[name] - h}).seen) / (2 * h)
        assert known[name] == pytest.approx(central, abs=1e-4 * np.abs(central).max())
    central = (run({}, 1010.0).seen - run({}, 990.0).seen) / 20
    assert known["bulk_ratio"] == pytest.approx(central, abs=1e-3 * np.abs(central).max())


def test_a_quarter_and_the_whole_show_the_same_displacements(law):
    points, directions = places(30)
    material = law(mu=1.2, zeta=3.0, phi=0.8)
    press = Press(material, 1200.0, 90, np.array([0.1, 0.2]), observed=Observed.single(points, directions, np.full(30, 0.2)))
    quarter, whole = (Model(setup(part, "q1p0", depth=0.2, tolerance=1e-10)).run(press).seen for part in ("quarter", "whole"))
    assert np.abs(quarter).max() > 0.02
    assert whole == pytest.approx(quarter, abs=1e-6)


def test_groups_of_neighbours_are_means_of_what_is_measured_there():
    rng = np.random.default_rng(2)
    n = 3 * MOST
    points = rng.uniform(-1, 1, (n, 3))
    sd, values = rng.uniform(0.5, 2, n), rng.standard_normal(n)
    field = Displacements(points, np.tile([0.0, 1.0, 0.0], (n, 1)), values, sd, np.ones(n))
    groups = field.groups
    means, errors = averaged(field, groups)
    assert means.size == MOST
    weights = sd**-2
    assert np.sum(means / errors**2) == pytest.approx(np.sum(weights * values))  # no measurement is lost
    assert np.sum(errors**-2) == pytest.approx(np.sum(weights))
    assert max(np.ptp(points[groups == g], axis=0).max() for g in range(MOST)) < 1.0


# Files


def written(tmp_path, text):
    path = tmp_path / "side.csv"
    path.write_text(text)
    return path


def test_a_file_is_read_in_its_units_and_holes_are_left_out(tmp_path):
    field = read_displacements(
        written(tmp_path, "x_mm,y (um),z_mm,uz_um,uy_um,sd_um\n0,1500,7,120,,5\n# note\n0,1600,7,110,nan,4\n1,0,7,90,1,3\n")
    )
    assert field.values == pytest.approx([0.12, 0.11, 0.001, 0.09])
    assert field.points[0] == pytest.approx([0, 1.5, 7])
    assert field.sd == pytest.approx([0.005, 0.004, 0.003, 0.003])
    assert field.directions[-1] == pytest.approx([0, 0, 1])
    write_displacements(tmp_path / "again.csv", field)
    again = read_displacements(tmp_path / "again.csv")
    assert again.values.tolist() == field.values.tolist() and again.points.tolist() == field.points.tolist()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("x_mm,y_mm,z_mm,uz_um,strain_xx\n", "'strain_xx' is not known"),
        ("x_mm,y_mm,z_mm,uz\n", "'uz' has no unit"),
        ("x_mm,z_mm,uz_um\n", "no column y_mm, the height above the base"),
        ("x_mm,y_mm,z_mm\n", "no displacement"),
        ("r_mm,y_mm,ux_um\n", "name the displacement away from the axis ur"),
        ("x_mm,y_mm,z_mm,uz_kPa\n", "is in kPa, which cannot be converted to mm"),
        ("x_mm,y_mm,z_mm,uz_um\n0,1,7,1\n0,1,7\n", "line 3: has 3 columns, the header 4"),
        ("x_mm,y_mm,z_mm,uz_um\n0,1,7,1\n", "at least 3"),
        ("x_mm,y_mm,z_mm,uz_um,sd_um\n0,1,7,1,0\n0,1,7,1,1\n0,1,7,1,1\n", "line 2: standard deviation 0 mm must be above zero"),
    ],
)  # fmt: skip
def test_a_file_that_is_not_such_a_table_is_refused_in_a_line(tmp_path, text, said):
    with pytest.raises(CurveError) as caught:
        read_displacements(written(tmp_path, text))
    assert said in str(caught.value) and "\n" not in str(caught.value) and "side.csv" in str(caught.value)


# A gel under a sphere


def gel(field=None, method="least_squares", curve=None):
    depth = np.linspace(0.03, 0.3, 12)
    test = Test(
        "press", curve=curve or Curve(depth, depth**1.5), field=field if isinstance(field, list) else [field] if field else []
    )
    return Case(
        sample=Sample(shape="disc", diameter=2 * RADIUS, thickness=THICKNESS, base="bonded"),
        indenter=Indenter(shape="sphere", diameter=4, friction=0),
        mesh=Mesh(elements=100),
        material=MaterialChoice(model="neo_hookean", parameters={"mu": {"start": 1.0, "min": 0.2, "max": 5.0}}, bulk_ratio=1000.0),
        tests=[test],
        fit={"method": method, "uncertain": {"mesh": 0}},
    )  # fmt: skip


def surface(values, sd=0.002, depth=np.nan, n=20):
    r = np.linspace(0.2, 4.5, n)
    points = np.column_stack([r, np.full(n, THICKNESS), np.zeros(n)])
    moved = np.column_stack([np.full(n, np.nan), values, np.full(n, np.nan)])
    return Displacements.of(points, moved, sd, depth, "oct.csv")


@pytest.fixture(scope="module")
def truth():
    """Force and displacement of the surface of a gel of 2 kPa, on three times as many elements as a fit has."""
    case = gel()
    fine = replace(setup_of(case), mesh=Mesh(elements=300))
    points = surface(np.zeros(20)).points / [1, THICKNESS, 1]  # heights over the thickness
    seen = Observed.single(points, np.tile([0.0, 1.0, 0.0], (20, 1)), np.full(20, 0.3))
    law = load("neo_hookean")(mu=2.0)
    result = Model(fine).run(Press(law, case.material.bulk_modulus(2.0), 0, case.curves[0].displacement, observed=seen))
    return Curve(case.curves[0].displacement, result.force), result.seen


def noisy(truth, sign=1.0):
    """The curve with noise of 0.5 % of its end, and the field with noise of 1 um."""
    curve, seen = truth
    rng = np.random.default_rng(0)
    force = curve.force + 0.005 * curve.force[-1] * rng.standard_normal(curve.force.size)
    return Curve(curve.displacement, force), surface(sign * seen + 0.001 * rng.standard_normal(20), sd=0.001)


def test_a_fit_of_force_and_surface_finds_the_truth_and_shows_both(truth, tmp_path):
    curve, seen = noisy(truth)
    outline = Displacements.of_outline(outline_of(truth), 0.001, across="z")
    result = fit(gel([MeasuredField(file=seen), MeasuredField(file=outline, outline=True)], curve=curve))
    low, high = result.parameters["mu"].interval
    assert low < 2.0 < high and high - low < 0.1
    result.write(tmp_path / "out", fields=False)
    known, traced = read_fitted(tmp_path / "out" / "displacements.csv")
    assert np.std(traced.fitted - traced.measured) < 0.0015
    assert known.measured == pytest.approx(seen.values, abs=1e-9)
    assert np.std(known.fitted - truth[1]) < 0.001  # the surface of the other mesh
    assert "Displacements of the sample" in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")


def test_displacements_of_the_other_sign_are_no_fit(truth):
    curve, seen = noisy(truth, sign=-1.0)
    result = fit(gel(MeasuredField(file=seen), curve=curve))
    assert not result.success and "opposite sign" in result.message


@pytest.mark.parametrize(
    ("points", "said"),
    [
        (surface(-np.linspace(0.2, 0.01, 20), depth=0.4), "was seen at a depth of 0.4 mm, and the test goes to 0.3 mm"),
        (surface(np.zeros(20)), "every displacement is zero"),
        (surface(-np.linspace(0.2, 0.01, 20), sd=np.nan), "has no standard deviation (point 0)"),
        (
            replace(surface(-np.linspace(0.2, 0.01, 20)), points=1000 * surface(-np.linspace(0.2, 0.01, 20)).points),
            "outside the sample, 10 x 3 x 10 mm",
        ),
    ],
)
def test_a_field_that_cannot_be_that_of_its_test_is_refused(points, said):
    with pytest.raises(CaseError) as caught:
        gel(MeasuredField(file=points))
    assert said in str(caught.value) and "test.press.field.oct" in str(caught.value)


def test_a_search_that_does_not_weigh_squares_is_refused():
    with pytest.raises(CaseError, match="least_squares"):
        with_field_tests(gel(MeasuredField(file=surface(-np.linspace(0.2, 0.01, 20))), method="ga"))


# Outlines without material points


def test_a_circle_lies_outside_of_a_point_by_its_radius_less_the_points():
    angle = np.linspace(-0.2, np.pi + 0.2, 4000)
    nodes = 3.0 * np.column_stack([np.cos(angle), np.sin(angle)])  # counter-clockwise, as a chain goes
    points = np.array([[1.0, 2.0], [-2.5, 1.0], [0.0, 3.3]])
    assert beyond(points, nodes) == pytest.approx(3.0 - np.linalg.norm(points, axis=1), abs=1e-6)
    spread = beyond_change(points, nodes, nodes / 3.0)  # of a growing radius
    assert spread == pytest.approx(1.0, abs=1e-6)


def test_the_derivative_of_distances_is_that_of_any_motion_of_the_outline():
    rng, nodes = np.random.default_rng(5), chain(4.0, 3.0)
    move = 0.1 * np.column_stack([np.sin(nodes[:, 1]), np.cos(nodes[:, 0])])
    points = np.array([[4.3, 1.2], [4.2, 3.2], [-3.0, 3.05], [0.4, 2.9], [-4.1, 0.3], [4.1, -0.1]])
    points += 0.01 * rng.standard_normal(points.shape)
    change = beyond_change(points, nodes + move, move)
    central = (beyond(points, nodes + (1 + 1e-5) * move) - beyond(points, nodes + (1 - 1e-5) * move)) / 2e-5
    assert change == pytest.approx(central, abs=1e-7)


@pytest.mark.parametrize("shape", ["strip", "sphere"])
def test_material_points_of_the_surface_lie_on_the_outline_and_its_sensitivities_are_derivatives(law, shape):
    symmetry = "quarter" if shape == "strip" else "axisymmetric"
    kind = law if shape == "strip" else load("mooney_rivlin")
    values = {"mu": 1.2, "zeta": 3.0, "phi": 0.8} if shape == "strip" else dict.fromkeys(kind.parameters, 1.0)
    name = "phi" if shape == "strip" else next(iter(values))
    element = "q1p0" if shape == "strip" else "q2p1"
    model, depths = Model(setup(symmetry, element, shape=shape, tolerance=1e-10)), np.linspace(0.06, 0.3, 4)
    across = 0 if shape == "strip" else 2

    def run(value, observed, names=()):
        material = kind(**{**values, name: value})
        return model.run(Press(material, 1000.0 * material.shear_modulus, 90, depths, "", names, observed=observed))

    side = np.column_stack([np.full(8, RADIUS), np.linspace(0.2, 2.7, 8)])  # at the rim itself the nearer side changes
    top = np.column_stack([-np.linspace(2.2, 4.8, 6), np.full(6, THICKNESS)])
    rest, along = np.vstack([side, top]), [2 if across == 0 else 0, 1]
    points, directions = np.zeros((28, 3)), np.zeros((28, 3))
    points[:, along] = np.repeat(rest / [1, THICKNESS], 2, axis=0)
    directions[::2, along[0]] = directions[1::2, 1] = 1.0
    moved = run(values[name], Observed.single(points, directions, np.full(28, 0.3))).seen.reshape(-1, 2)
    seen = Displacements.of_outline(rest + moved, 0.005, 0.3, "xz"[across == 2]).outline_on(RADIUS, THICKNESS)
    traced = _outline_seen(seen, RADIUS, THICKNESS)
    known = run(values[name], traced, (name,))
    assert np.abs(seen.values).max() > 0.02
    assert known.seen == pytest.approx(seen.values, abs=3e-4)
    h = 1e-3 * values[name]
    central = (run(values[name] + h, traced).seen - run(values[name] - h, traced).seen) / (2 * h)
    assert known.seen_by[name] == pytest.approx(central, abs=1e-3 * np.abs(central).max())


def outline_of(truth, n=30):
    """The outline of the truth's surface beside the sphere, with errors of 1 um along both axes."""
    curve, case = truth[0], gel()
    rest = np.vstack([np.column_stack([np.linspace(1.5, 4.9, n - 10), np.full(n - 10, THICKNESS)]),
                      np.column_stack([np.full(10, RADIUS), np.linspace(0.3, 2.9, 10)])])  # fmt: skip
    points, directions = np.zeros((2 * n, 3)), np.zeros((2 * n, 3))
    points[:, :2] = np.repeat(rest / [1, THICKNESS], 2, axis=0)
    directions[::2, 0] = directions[1::2, 1] = 1.0
    seen = Observed.single(points, directions, np.full(2 * n, 0.3))
    press = Press(load("neo_hookean")(mu=2.0), case.material.bulk_modulus(2.0), 0, curve.displacement, observed=seen)
    moved = Model(replace(setup_of(case), mesh=Mesh(elements=300))).run(press).seen.reshape(-1, 2)
    return rest + moved + 0.001 * np.random.default_rng(1).standard_normal((n, 2))


@pytest.mark.campaign
def test_a_fit_of_force_and_outline_finds_the_truth_and_shows_both(truth, tmp_path):
    curve, _ = noisy(truth)
    text = "r_mm,y_um,sd_um\n" + "".join(f"{r!r},{1e3 * y!r},1\n" for r, y in outline_of(truth).tolist())
    seen = read_displacements(written(tmp_path, text), outline=True)
    result = fit(gel(MeasuredField(file=seen, outline=True), curve=curve))
    low, high = result.parameters["mu"].interval
    assert result.success and low < 2.0 < high and high - low < 0.1
    result.write(tmp_path / "out", fields=False)
    (known,) = read_fitted(tmp_path / "out" / "displacements.csv")
    assert np.std(known.fitted - known.measured) < 0.0015
    again = read_displacements(next((tmp_path / "out").rglob("*side*.csv")), outline=True)
    assert again.points == pytest.approx(seen.points, abs=1e-12) and again.round


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("z_mm,y_mm,uz_um\n", "has uz; points of an outline have no displacements"),
        ("x_mm,z_mm,y_mm\n", "has x and z; an outline has z"),
        ("y_mm,sd_um\n", "has neither; an outline has z"),
        ("z_mm,sd_um\n", "no column y_mm"),
        ("r_mm,y_mm,sd_um\n1,3,1\n-2,3,1\n3,3,1\n", "line 3: the radius is -2 mm"),
    ],
)
def test_a_file_that_is_no_outline_is_refused_in_a_line(tmp_path, text, said):
    with pytest.raises(CurveError) as caught:
        read_displacements(written(tmp_path, text), outline=True)
    assert said in str(caught.value) and "\n" not in str(caught.value) and "side.csv" in str(caught.value)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"file": Displacements.of_outline(1e3 * np.array([[1, 3], [2, 3], [3, 3]]), 0.01)}, "check the units"),
        ({"file": Displacements.of_outline([[1, 3], [2, 3], [3, 3]], np.nan)}, "has no standard deviation"),
        ({"file": Displacements.of_outline([[1, 3], [2, 3], [3, 3]], 0.1), "outline": False}, "set field.outline"),
        ({"file": surface(-np.linspace(0.2, 0.01, 20))}, "remove field.outline"),
    ],
)
def test_an_outline_that_cannot_be_that_of_its_test_is_refused(changes, said):
    with pytest.raises(CaseError) as caught:
        gel(MeasuredField(**{"outline": True, **changes}))
    assert said in str(caught.value)


def test_an_outline_in_a_plane_that_the_solution_leaves_is_refused(law):
    field = MeasuredField(file=Displacements.of_outline([[5.1, 1], [5.1, 1.5], [5.1, 2]], 0.01), outline=True)
    test = Test("press", angle=45, curve=Curve([0.1, 0.15, 0.2, 0.25, 0.3], [1.0, 1.5, 2.0, 2.5, 3.0]), field=[field])
    material = MaterialChoice(
        model="transversely_isotropic", parameters={"mu": {"start": 1, "min": 0.1, "max": 9}, "zeta": 3, "phi": 1}
    )
    with pytest.raises(CaseError, match="outline = true: lies in the plane x = 0, about which the fibres of the test are not"):
        Case(sample=setup().sample, indenter=setup().indenter, material=material, tests=[test], fit={"method": "least_squares"})


def test_a_mesh_check_tells_changes_of_the_force_beside_a_field():
    """Runs of a case with a field bring displacements behind the forces: the last number of a run is not the last force."""
    field = MeasuredField(file=surface(-np.linspace(0.2, 0.01, 20)))
    family, other = ["mesh.elements=60", "mesh.elements=80"], {"indenter.diameter": [4.4]}
    changes = [mesh_check(gel(measured), family, other).changes[0].changes["press"] for measured in (field, None)]
    assert changes[0] == changes[1]
    assert 1.1**0.5 - 1 < changes[0] < 1.1**2 - 1  # between a half-space (Hertz) and a thin bonded layer of constant volume
