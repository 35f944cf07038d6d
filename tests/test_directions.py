"""Fibres at any angle and dip: the part of the sample that is solved, its ties and constraints, against other parts and codes."""

import json

import numpy as np
import pytest
from click.testing import CliRunner
from fixtures.cases import SHARED, tiny_case

from indentfit.case import Indenter, Mesh, Sample, Solver
from indentfit.cli import main
from indentfit.errors import CaseError, MeshError
from indentfit.experiment.measured import read_case
from indentfit.fem.equations import Iterate
from indentfit.fem.fields import recover
from indentfit.fem.setup import Press, Setup
from indentfit.fem.simulate import Model
from indentfit.fem.symmetry import symmetry_of
from indentfit.fibres import direction, kept
from indentfit.material import load
from indentfit.report.mirror import whole
from indentfit.runs.forward import simulate
from indentfit.runs.key import Inputs
from indentfit.runs.points import setup_of

LAW = load("transversely_isotropic")
PAPER = LAW(mu=1.49, zeta=4.68, phi=0.68)
DISC = Sample(shape="disc", diameter=14, thickness=3.3, base="sliding")
BLOCK = Sample(shape="block", length=14, width=14, thickness=3.3, base="sliding")
STRIP = {"shape": "strip", "width": 2, "length": 20, "edge_radius": 0}
SOLVER = Solver()
DEPTHS = np.array([0.15, 0.33])
FIBRES = {"model": "transversely_isotropic", "parameters": PAPER.values}


def model_of(symmetry, sample=DISC, friction=0.5, elements=24, solver=SOLVER, **indenter):
    table = Indenter(**(indenter or STRIP), friction=friction)
    return Model(Setup(sample, table, Mesh(elements=elements) if elements else Mesh(), solver, DEPTHS[-1], symmetry))


def pressed(model, angle, dip=0.0, depths=DEPTHS, sensitivities=()):
    return model.run(Press(PAPER, 1000 * PAPER.mu, angle, depths, "press", sensitivities, dip=dip))


@pytest.fixture(scope="module")
def models():
    """Models of the disc under the strip with friction 0.5, by their symmetry."""
    return {symmetry: model_of(symmetry) for symmetry in ("quarter", "half", "mirror_x", "mirror_z", "whole")}


@pytest.mark.quick
@pytest.mark.parametrize(
    ("angle", "dip", "part"),
    [(0, 0, "quarter"), (90, 0, "quarter"), (30, 90, "quarter"), (90, -90, "quarter"), (30, 0, "half"), (179.5, 0, "half"),
     (0, 45, "mirror_z"), (90, -20, "mirror_x"), (30, 45, "whole")],
)  # fmt: skip
def test_fibres_keep_the_symmetry_that_their_mirror_images_keep(angle, dip, part):
    a0 = direction(angle, dip)
    same = [abs(abs((a0 * signs) @ a0) - 1) < 1e-12 for signs in ((-1, 1, 1), (1, 1, -1), (-1, 1, -1))]
    by_images = {(1, 1, 1): "quarter", (1, 0, 0): "mirror_x", (0, 1, 0): "mirror_z", (0, 0, 1): "half", (0, 0, 0): "whole"}
    assert np.linalg.norm(a0) == pytest.approx(1, rel=1e-15)
    assert kept(angle, dip) == part == by_images[tuple(same)]


@pytest.mark.quick
def test_the_symmetry_is_the_least_that_every_direction_keeps_and_a_wish_for_more_is_refused():
    strip = Indenter(**STRIP, friction=0.5)

    def chosen(fibres, **mesh):
        return symmetry_of(DISC, strip, Mesh(**mesh), Solver(), LAW, fibres)

    assert chosen({"quarter"}) == "quarter"
    assert chosen({"quarter", "mirror_x"}) == "mirror_x"
    assert chosen({"half", "mirror_x"}) == "whole"
    assert chosen({"quarter"}, symmetry="half") == "half"
    assert chosen({"half"}, symmetry="whole") == "whole"
    with pytest.raises(MeshError, match=r'mesh.symmetry = "quarter": fibres neither along nor across'):
        chosen({"half"}, symmetry="quarter")
    with pytest.raises(MeshError, match=r'mesh.symmetry = "half": fibres that dip'):
        chosen({"whole"}, symmetry="half")


@pytest.mark.parametrize(
    ("angle", "parts"), [(0, ("half", "whole")), (90, ("half", "mirror_x", "mirror_z", "whole"))], ids=["along", "across"]
)
def test_fibres_along_and_across_give_the_forces_of_the_quarter_on_every_part(models, angle, parts):
    quarter = pressed(models["quarter"], angle, sensitivities=("zeta", "friction"))
    for part in parts:
        other = pressed(models[part], angle, sensitivities=("zeta", "friction") if part == "half" else ())
        np.testing.assert_allclose(other.force, quarter.force, rtol=1e-4, err_msg=part)
        for name, slope in (other.sensitivities or {}).items():
            np.testing.assert_allclose(slope, quarter.sensitivities[name], rtol=1e-3, err_msg=f"{part}, {name}")


def test_the_half_tied_to_itself_is_half_of_the_whole_and_its_completed_fields_are_those_of_the_whole(models):
    half, all_of_it = (pressed(models[part], 35) for part in ("half", "whole"))
    np.testing.assert_allclose(half.force, all_of_it.force, rtol=1e-4)
    completed, own = (whole(recover(models[p], test, PAPER, 1000 * PAPER.mu)) for p, test in (("half", half), ("whole", all_of_it)))
    order, other = (np.lexsort(np.round(fields.nodes, 7).T) for fields in (completed, own))
    np.testing.assert_allclose(completed.nodes[order], own.nodes[other], atol=1e-9)
    np.testing.assert_allclose(completed.displacement[order], own.displacement[other], atol=2e-3 * DEPTHS[-1])
    inside = np.abs(own.nodes[other][:, 2]) > 1e-9  # on the cut face a half's stresses are means of fewer elements
    stresses = completed.nodal_stress[order][inside], own.nodal_stress[other][inside]
    np.testing.assert_allclose(*stresses, atol=2e-2 * np.abs(stresses[1]).max())


def test_an_angle_and_its_mirror_image_give_the_same_force_and_dipping_halves_that_of_the_whole(models):
    np.testing.assert_allclose(pressed(models["half"], 145).force, pressed(models["half"], 35).force, rtol=1e-4)
    down, up = pressed(models["mirror_z"], 0, -40), pressed(models["mirror_z"], 0, 40)
    np.testing.assert_allclose(down.force, up.force, rtol=1e-4)
    np.testing.assert_allclose(pressed(models["whole"], 0, 40).force, up.force, rtol=1e-4)
    np.testing.assert_allclose(pressed(models["quarter"], 30, 90).force, pressed(models["quarter"], 90, 90).force, rtol=1e-12)


@pytest.mark.parametrize(("part", "angle", "dip"), [("half", 35, 0), ("mirror_z", 0, 40), ("mirror_x", 90, 40), ("whole", 35, 40)])
def test_what_holds_the_rigid_motions_without_friction_carries_nothing(part, angle, dip):
    model = model_of(part, friction=0.0)
    result = pressed(model, angle, dip)
    bonded = model.body.held("sliding")  # by symmetry and base, without the rigid motions
    holding = np.setdiff1d(model.fixed.dofs, bonded)
    assert holding.size == len(model.setup.part.motions)
    end = result.last
    at = Iterate(end.u, end.pressure)
    state = model.body.state(at.u, direction(angle, dip))
    forces = model.body.residual(at.u, state, PAPER, at.pressure, direction(angle, dip)) + model.contact.residual(end.contact)
    assert np.abs(forces[holding]).max() < 1e-4 * end.force


def test_a_round_indenter_on_a_disc_has_the_same_force_at_every_angle_of_the_fibres():
    gauge = {"shape": "cylinder", "diameter": 4, "edge_radius": 0}
    along = pressed(model_of("quarter", elements=60, **gauge), 0).force
    turned = model_of("half", elements=60, **gauge)
    for angle in (20, 45):
        np.testing.assert_allclose(pressed(turned, angle).force, along, rtol=1e-3, err_msg=f"{angle} degrees")


@pytest.mark.parametrize(("angle", "dip"), [(30, 0), (45, 0), (0, 45)])
def test_oblique_and_dipping_fibres_meet_another_code_on_the_default_mesh(angle, dip):
    """NGSolve, whole block under a sticking strip; its own error is a percent."""
    path = SHARED / "oracles" / f"angle_{angle}_dip_{dip}.json"
    if not path.exists():
        pytest.skip("the curve of the other code is not here")
    known = json.loads(path.read_text(encoding="utf-8"))
    model = model_of(kept(angle, dip), BLOCK, "stick", elements=None)
    force = pressed(model, angle, dip, np.array(known["displacement_mm"][1:])).force
    np.testing.assert_allclose(force, known["force_mN"][1:], rtol=0.01 + known["error_percent"] / 100)


def test_multigrid_agrees_with_the_direct_solver_on_the_tied_half():
    forces = [
        pressed(model_of("half", solver=Solver(element="q1p0", linear=linear)), 35, depths=DEPTHS[:1]).force
        for linear in ("auto", "pyamg")
    ]
    np.testing.assert_allclose(forces[1], forces[0], rtol=1e-4)


def test_the_tangent_of_the_tied_half_is_the_derivative_of_its_forces_and_that_of_the_readable_forms():
    fibre, kappa = direction(35), 100.0
    body, forms = (model_of("half", solver=Solver(element="q1p0", assembly=kind)).body for kind in ("compiled", "forms"))
    rng = np.random.default_rng(0)
    u, du = (scale * rng.standard_normal(body.n_dofs) for scale in (1e-2, 1e-5))

    def forces(u):
        state = body.state(u, fibre)
        return body.residual(u, state, PAPER, body.pressure(state, kappa), fibre)

    state = body.state(u, fibre)
    own, values = body.tangent(u, state, PAPER, body.pressure(state, kappa), kappa, fibre)
    np.testing.assert_allclose(own, forces(u), atol=1e-12)
    change = (forces(u + du) - forces(u - du)) / 2
    np.testing.assert_allclose(body.matrix(values) @ du, change, atol=1e-6 * np.abs(change).max())
    readable, same = forms.tangent(u, forms.state(u, fibre), PAPER, body.pressure(state, kappa), kappa, fibre)
    np.testing.assert_allclose(readable, own, atol=1e-9 * np.abs(own).max())
    np.testing.assert_allclose(same, values, atol=1e-9 * np.abs(values).max())
    swell = body.dilatation_map(u)
    by_map = np.einsum("emni,eni->em", swell, du[body.dofs])
    by_states = (body.state(u + du, fibre).theta - body.state(u - du, fibre).theta) / 2
    np.testing.assert_allclose(by_map, by_states, atol=1e-6 * np.abs(by_states).max())


def angled(folder, *tests, **tables):
    rows = [{"name": f"t{n}", "depth": 0.2, "points": 4, **test} for n, test in enumerate(tests)]
    parts = {"material": FIBRES, "indenter": {"friction": 0.5}, **tables}
    return tiny_case(folder, test=rows, **parts)


def test_tests_at_several_angles_are_solved_each_on_the_least_part_and_validate_says_which(tmp_path):
    path = angled(tmp_path, {"angle": 0}, {"angle": 45}, {"angle": 90, "dip": 30})
    case = read_case(path)
    assert [setup_of(piece).symmetry for piece in case.pieces] == ["quarter", "half", "mirror_x"]
    said = CliRunner().invoke(main, ["validate", str(path)]).output
    assert "symmetry  t0: quarter sample" in said and "t2: 90 degrees, dipping 30 degrees" in said
    assert "symmetry  t1: half sample, tied to itself by a turn of 180 degrees" in said
    result = simulate(case, mesh_error=False)
    assert [test.direction for test in result.tests] == ["0°", "45°", "90°, dipping 30°"]
    assert "t1 36 elements, half sample" in result.mesh.remark and result.mesh.elements == 18 + 36 + 36
    whole_of_it = simulate(read_case(path, ["mesh.symmetry=whole"]), mesh_error=False)
    for own, other in zip(result.tests, whole_of_it.tests, strict=True):
        np.testing.assert_allclose(own.force, other.force, rtol=2e-4)


@pytest.mark.quick
def test_a_run_is_stored_by_dip_and_by_the_depth_of_the_mesh_that_its_test_shares(tmp_path):
    def hashes(*tests):
        case = read_case(angled(tmp_path, *tests))
        inputs = Inputs(case)
        return [inputs.hash(inputs.of(case.start_values(), test)) for test in case.tests]

    flat, dipping = hashes({"angle": 45}, {"angle": 45, "dip": 20})
    assert flat != dipping
    alone = hashes({"angle": 45}, {"angle": 0, "depth": 0.3})[0]
    beside_a_deeper_one = hashes({"angle": 45}, {"angle": 60, "depth": 0.3})[0]
    assert alone != beside_a_deeper_one  # the half's mesh is made for 0.2 mm in one case, for 0.3 mm in the other


@pytest.mark.quick
@pytest.mark.parametrize(
    ("key", "value", "text"),
    [("angle", 180, "must be at least 0 and below 180"), ("angle", True, "below 180"), ("dip", 91, "must be from -90 to 90")],
)
def test_a_direction_out_of_range_is_refused_in_one_line(tmp_path, key, value, text):
    with pytest.raises(CaseError, match=rf"test\.t0\.{key} = .*{text}"):
        read_case(angled(tmp_path, {"angle": 0, key: value}))
