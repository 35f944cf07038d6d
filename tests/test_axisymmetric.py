"""Solutions in the meridian plane: against exact elastic layers, another code's large strains, and the quarter model."""

import json

import numpy as np
import pytest
from fixtures.cases import SHARED

from indentfit.case import Indenter, Mesh, Sample, Solver
from indentfit.case.materials import LARGEST_BULK_RATIO
from indentfit.errors import ConvergenceError, MeshError
from indentfit.fem import path
from indentfit.fem.element import Solid
from indentfit.fem.fields import recover
from indentfit.fem.meridian import Meridian
from indentfit.fem.meridian_mesh import count_meridian, meridian_mesh
from indentfit.fem.setup import Press, Setup
from indentfit.fem.simulate import Model
from indentfit.fem.symmetry import symmetry_of
from indentfit.layer import Layer
from indentfit.material import load, typed

GEL = typed("mu / 2 * (I1 - 3)", ["mu"])(mu=1.0)
DISC = {"shape": "disc", "diameter": 12.0, "thickness": 1.0, "base": "bonded"}
SPHERE = {"shape": "sphere", "diameter": 2.0, "friction": 0}
# Exact small-strain forces on layers of thickness 1 and shear modulus 1: Fredholm equation of Hayes et al. 1972 (J Biomech 5:541),
# good to 1e-3, for paraboloids: base, nu, R, depth, force; and for flat punches: base, nu, radius, force / (radius depth)
PARABOLOIDS = [("bonded", 0.3, 0.5, 0.02, 0.008360), ("sliding", 0.45, 4, 0.02, 0.034807), ("bonded", 0.45, 4, 0.02, 0.038918)]
PUNCHES = [
    ("bonded", 0.3, 0.3, 7.61583),
    ("bonded", 0.49, 1.0, 27.32535),
    ("sliding", 0.45, 0.5, 10.95337),
    ("sliding", 0.3, 2.0, 21.30061),
]


def bulk_ratio(nu):
    return 2 * (1 + nu) / (3 * (1 - 2 * nu))


SOLVER = Solver()


def pressed(sample, indenter, depths, kappa=1000.0, symmetry="axisymmetric", sensitivities=(), material=GEL, solver=SOLVER, **mesh):
    setup = Setup(Sample(**sample), Indenter(**indenter), Mesh(**mesh), solver, float(depths[-1]), symmetry)
    return Model(setup).run(Press(material, kappa, 0, np.asarray(depths, float), sensitivities=sensitivities))


@pytest.mark.parametrize(("base", "nu", "R", "depth", "force"), PARABOLOIDS)
def test_a_shallow_sphere_meets_the_exact_elastic_layer_within_half_a_percent(base, nu, R, depth, force):
    """F R depends on depth R only, so a sphere of 100 R at depth / 100 is the paraboloid, at small strain."""
    sample = {"shape": "disc", "diameter": 20.0, "thickness": 1.0, "base": base}
    depths = np.array([0.5, 1.0]) * depth / 100
    result = pressed(sample, {"shape": "sphere", "diameter": 200 * R, "friction": 0}, depths, bulk_ratio(nu))
    assert 100 * result.force[-1] == pytest.approx(force, rel=5e-3)


def test_a_punch_far_narrower_than_its_sample_presses_as_on_a_half_space_from_the_first_depth_on():
    """Springs in proportion to 1 / thickness gave way: first forces were 0.9 % too small here, and 2.7 % at a 400th."""
    depths = np.linspace(0.005, 0.05, 10)
    sample = {"shape": "disc", "diameter": 2000.0, "thickness": 200.0, "base": "bonded"}
    result = pressed(sample, {"shape": "cylinder", "diameter": 2.0, "friction": 0}, depths, bulk_ratio(0.49))
    half_space = 4 / (1 - 0.49) * depths  # Boussinesq; the layer adds 0.6 % (Hayes et al. 1972), large strain takes 0.2 %
    np.testing.assert_allclose(result.force / half_space, 1.003, rtol=4e-3)


def test_springs_of_bricks_under_a_small_bead_are_stiff_enough_at_small_depths():
    """They are under a contact of a hundredth of the thickness as under a wide one: the first forces were 64 and 22 % too small."""
    sample = {"shape": "disc", "diameter": 400.0, "thickness": 100.0, "base": "bonded"}
    depths = np.array([1, 2, 4, 12]) * 0.1 / 12
    bead = {"shape": "sphere", "diameter": 2.0, "friction": 0}
    usual, stiff = (
        pressed(sample, bead, depths, bulk_ratio(0.49), "quarter", solver=Solver(penalty=p), elements=60).force for p in (1, 30)
    )
    np.testing.assert_allclose(usual, stiff, rtol=1e-2)


@pytest.mark.parametrize(("nu", "a"), [(0.49, 1.5), (0.4999, 2.0), (0.4999, 4.0)])
def test_a_contact_wider_than_its_bonded_layer_meets_the_exact_layer_at_every_depth(nu, a):
    """A thin layer that keeps its volume rises beside the sphere and touches it farther out: elements that were wide there, as wide
    as the layer is thick, erred by up to 0.9 %, at depths where the contact ended within one of them."""
    radius, depths = 2e3, np.linspace(0.3, 1.0, 15) * a**2 / 2e3
    sample = {"shape": "disc", "diameter": 48 * a, "thickness": 1.0, "base": "bonded"}
    result = pressed(sample, {"shape": "sphere", "diameter": 2 * radius, "friction": 0}, depths, bulk_ratio(nu))
    np.testing.assert_allclose(result.force, Layer(True, nu).sphere_force(radius, depths), rtol=3e-3)


@pytest.mark.parametrize(("base", "nu", "a", "force"), PUNCHES)
def test_a_shallow_flat_punch_meets_the_exact_elastic_layer_within_half_a_percent(base, nu, a, force):
    sample = {"shape": "disc", "diameter": 2 * max(12 * a, 10.0), "thickness": 1.0, "base": base}
    result = pressed(sample, {"shape": "cylinder", "diameter": 2 * a, "friction": 0}, np.array([5e-4, 1e-3]) * a, bulk_ratio(nu))
    assert result.force[-1] / (1e-3 * a * a) == pytest.approx(force, rel=5e-3)


@pytest.mark.skipif(not (SHARED / "oracles").is_dir(), reason="../shared/oracles is not here")
@pytest.mark.parametrize("name", ["axi_sphere_R1_bonded", "axi_sphere_R1_bonded_nu0.3"])
def test_a_sphere_to_40_percent_meets_another_code_within_one_percent(name):
    oracle = json.loads((SHARED / "oracles" / f"{name}.json").read_text())
    result = pressed(DISC, SPHERE, oracle["displacement_mm"], oracle["inputs"]["material"]["bulk_ratio"])
    force = np.array(oracle["force_mN"])
    assert np.abs(result.force / force - 1).max() < 0.01
    assert np.abs(result.force / force - 1)[1:].max() < 0.004


@pytest.mark.parametrize(
    ("indenter", "base", "depth", "apart"),
    [
        pytest.param(SPHERE, "sliding", 0.2, 0.01, marks=pytest.mark.campaign),
        ({**SPHERE, "friction": 0.5}, "bonded", 0.2, 0.01),
        ({"shape": "cylinder", "diameter": 1.0, "friction": 0, "edge_radius": 0.2}, "bonded", 0.05, 0.015),
    ],
    ids=["sphere, sliding", "sphere, rough, bonded", "rounded punch"],
)  # fmt: skip
def test_the_meridian_and_the_quarter_of_the_same_sample_agree(indenter, base, depth, apart):
    """Two discretisations of one problem. The bricks' contact ends at nodes: under a rounded edge that costs them 1 %."""
    sample = {**DISC, "diameter": 8.0, "base": base}
    plane = pressed(sample, indenter, [depth / 2, depth])
    bricks = pressed(sample, indenter, [depth / 2, depth], symmetry="quarter", elements=250)
    assert plane.force[-1] == pytest.approx(bricks.force[-1], rel=apart)


@pytest.mark.parametrize("steps", [24, 48])
def test_a_sphere_that_sticks_has_one_force_whatever_its_steps(steps):
    """Points at the contact's end chattered: 100 to 160 iterations, and retries. The force is near that of a friction of 1, and on
    this mesh follows the place of the contact's end within its elements by 0.3 %."""
    sticks, few = {**SPHERE, "friction": "stick"}, {"elements": 72}
    usual = pressed(DISC, {**SPHERE, "friction": 1.0}, [0.1, 0.2], **few)
    short = pressed(DISC, sticks, [0.1, 0.2], solver=Solver(max_step=0.2 / steps), **few)
    assert short.force == pytest.approx(usual.force, rel=4e-3)
    assert short.facts.newton_iterations < 20 and short.facts.cutbacks == 0 and short.facts.tries == 1


def test_sensitivities_are_the_derivatives_of_the_force():
    rough = {**SPHERE, "friction": 0.2}
    names = ("mu", "friction", "bulk_ratio", "offset")
    exact = Solver(tolerance=1e-8)  # differences show what Newton's iteration leaves
    result = pressed(DISC, rough, [0.05, 0.1], 50.0, sensitivities=names, solver=exact, elements=60)
    by = {name: result.sensitivities[name][-1] for name in names}
    assert by["mu"] == pytest.approx(result.force[-1], rel=1e-6)  # the force is linear in mu, and mu is 1

    def force(friction=0.2, kappa=50.0):
        return pressed(DISC, {**rough, "friction": friction}, [0.05, 0.1], kappa, solver=exact, elements=60).force[-1]

    # The force jumps by 1e-5 of itself where a point passes from stick to slip: a small difference of friction meets no such jump.
    assert by["friction"] == pytest.approx((force(0.20002) - force(0.19998)) / 4e-5, rel=1e-3)
    assert by["bulk_ratio"] == pytest.approx((force(kappa=50.05) - force(kappa=49.95)) / 0.1, rel=1e-4)


@pytest.mark.parametrize("kappa", [500.0, LARGEST_BULK_RATIO])
def test_a_curve_in_the_plane_solves_the_contact_on_the_factor_of_the_step_before(kappa):
    """Newton's iteration alone took 50 iterations, each with a factor of its own, and twice the time."""
    pytest.importorskip("pypardiso")
    facts = pressed({**DISC, "diameter": 8.0}, SPHERE, [0.1, 0.2], kappa).facts
    assert facts.newton_iterations < 20 and facts.factorizations < 30 and facts.krylov_iterations <= 12 * facts.steps


def test_the_force_under_a_rough_sphere_hardly_depends_on_the_steps():
    """Points that came to touch rubbed from the start of their step on: 8 steps made the force 1.5 % too large."""
    rough, depths = {**SPHERE, "friction": "stick"}, [0.15, 0.3]
    few, many = (pressed(DISC, rough, depths, solver=Solver(max_step=0.3 / n)) for n in (8, 32))
    assert few.facts.steps < 12 < many.facts.steps
    assert few.force == pytest.approx(many.force, rel=5e-3)


def test_the_tangent_is_the_derivative_of_the_residual():
    body = Meridian(meridian_mesh(Sample(**DISC), Indenter(**SPHERE), Mesh(elements=30), 0.2))
    rng, fibre = np.random.default_rng(0), np.array([0.0, 1.0, 0.0])
    law = load("holzapfel")(c=1.0, k1=2.0, k2=0.5, dispersion=0.1)
    u, du = 0.01 * rng.standard_normal(body.n_dofs), rng.standard_normal(body.n_dofs)

    def forces(u):
        state = body.state(u, fibre)
        return body.residual(u, state, law, body.pressure(state, 20.0), fibre)

    state = body.state(u, fibre)
    at_rest, values = body.tangent(u, state, law, body.pressure(state, 20.0), 20.0, fibre)
    assert np.allclose(at_rest, forces(u), rtol=1e-10, atol=1e-12)
    step = 1e-6
    slope = (forces(u + step * du) - forces(u - step * du)) / (2 * step)
    assert np.linalg.norm(body.matrix(values) @ du - slope) < 1e-6 * np.linalg.norm(slope)


def test_a_stretched_cylinder_has_the_closed_form_stress():
    """Uniaxial stretch of an incompressible neo-Hookean cylinder: sigma = mu (l^2 - 1/l), the sides free."""
    sample, stretch = {**DISC, "diameter": 2.0}, 1.2
    body = Meridian(meridian_mesh(Sample(**sample), Indenter(**{**SPHERE, "diameter": 0.5}), Mesh(elements=30), 0.1))
    X = body.basis.doflocs
    u = np.zeros(body.n_dofs)
    radial, axial = np.arange(0, body.n_dofs, 2), np.arange(1, body.n_dofs, 2)
    u[radial], u[axial] = X[0, radial] * (stretch**-0.5 - 1), X[1, axial] * (stretch - 1)
    fibre = np.array([0.0, 1.0, 0.0])
    state = body.state(u, fibre)
    stress = body.stress(u, state, GEL, np.zeros_like(body.means), fibre)
    assert np.allclose(stress[1] - stress[0], stretch**2 - 1 / stretch, rtol=1e-9)
    assert np.allclose(stress[2], stress[0], atol=1e-12)
    assert body.volume.sum() == pytest.approx(np.pi, rel=1e-9)


def test_fields_are_those_of_a_quarter_and_balance_the_force():
    """The contact pressure over the revolved surface carries the indenter's force."""
    result = pressed(DISC, SPHERE, [0.1, 0.2])
    fields = recover(result.model, result, GEL, 1000.0)
    assert fields.elements.shape[1] == 8
    solid = Solid(_mesh_of(fields))
    assert solid.volume.min() > -1e-12
    assert solid.volume.sum() == pytest.approx(np.pi * 36 / 4, rel=0.01)
    near = np.argmin(np.linalg.norm(fields.nodes - [0, 1, 0], axis=1))
    assert fields.displacement[near, 1] == pytest.approx(-0.2, abs=2e-3)
    assert fields.nodal_stress[near, 1] == pytest.approx(-fields.contact_pressure[near], rel=0.2)


ROUGH_PUNCH = {"shape": "cylinder", "diameter": 1.0, "friction": "stick"}


def test_the_force_under_a_sharp_edge_that_sticks_does_not_depend_on_the_steps_and_no_surface_is_inside_the_punch():
    """Without the wall above the edge the surface passed into the punch, and 8, 12 and 24 steps led to forces 3 % apart."""
    depths = np.array([0.1, 0.2, 0.3])
    few, many = (pressed(DISC, ROUGH_PUNCH, depths, solver=Solver(max_step=0.3 / n), error=0.03) for n in (9, 15))
    assert few.facts.steps < many.facts.steps and few.facts.tries == many.facts.tries == 1
    assert few.force == pytest.approx(many.force, rel=2e-3)
    for result in (few, many):
        contact, under = result.last.contact, result.model.contact.under
        beside = contact.place[~under]  # in the punch's frame, whose face is at the sample's height
        inside = (beside[..., 0] < 0.5) & (beside[..., 1] > 1)
        assert contact.touching[~under].any()
        assert np.max(0.5 - beside[..., 0], where=inside, initial=0.0) < 1e-3


def test_no_surface_is_inside_a_rounded_punch_that_goes_thirty_edge_radii_deep():
    """The surface beside the edge folded up into the punch: meshes of 24 to 160 elements had forces of 0.19 to 0.26 mN where they
    had any, with a stated error of 3 %."""
    sample, depths = {"shape": "disc", "diameter": 2.0, "thickness": 1.0, "base": "sliding"}, np.array([0.1, 0.2, 0.32])
    punch = {"shape": "cylinder", "diameter": 0.22, "edge_radius": 0.0105, "friction": 0.94}
    coarse, fine = (pressed(sample, punch, depths, 7.457, elements=elements) for elements in (80, 104))
    assert coarse.facts.tries == fine.facts.tries == 1
    assert coarse.force == pytest.approx(fine.force, rel=1e-2)
    for result in (coarse, fine):
        contact = result.last.contact
        assert contact.touching[~result.model.contact.under].any()
        top = result.model.body.mesh.boundaries["top"]
        nodes = np.unique(result.model.body.mesh.facets[:, top])
        r, y = (result.model.body.mesh.p + result.last.u[result.model.body.basis.nodal_dofs])[:, nodes]
        above = y > 1 - depths[-1] + 0.0105  # beside the wall
        assert (r[above] > 0.11 - 1e-3).all()


def test_sensitivities_are_exact_where_the_surface_lies_against_the_wall():
    exact = Solver(tolerance=1e-8, max_step=0.025)
    names, depths = ("mu", "bulk_ratio"), [0.1, 0.2]

    def solved(kappa=50.0, sensitivities=()):
        return pressed(DISC, ROUGH_PUNCH, depths, kappa, solver=exact, error=0.03, sensitivities=sensitivities)

    result = solved(sensitivities=names)
    assert result.last.contact.touching[~result.model.contact.under].any()
    assert result.sensitivities["mu"][-1] == pytest.approx(result.force[-1], rel=1e-5)  # the force is linear in mu, and mu is 1
    difference = (solved(50.05).force[-1] - solved(49.95).force[-1]) / 0.1
    assert result.sensitivities["bulk_ratio"][-1] == pytest.approx(difference, rel=1e-3)


def test_a_punch_that_goes_half_of_its_radius_deep_softens_and_no_mesh_does_that():
    """A brain slice under a punch of 0.15 thicknesses that sticks: a straight curve fits a larger modulus than the layer's.

    At the first depth the layer's exact stiffness holds; frictionless and sticking punches have the same at nu = 0.5, nearly.
    """
    sample, punch = {"shape": "disc", "diameter": 6.0, "thickness": 1.0, "base": "bonded"}, {"shape": "cylinder", "diameter": 0.3}
    depths = np.array([0.0008, 0.04, 0.08])
    exact = Layer(True, 0.4995).punch_stiffness(0.15)
    curves = [pressed(sample, {**punch, "friction": "stick"}, depths, error=error).force for error in (0.01, 0.03)]
    stiffnesses = curves / (depths * exact)
    assert stiffnesses[:, 0] == pytest.approx(1, abs=3e-3)
    assert (stiffnesses[:, 2] < 0.97).all() and (np.diff(stiffnesses, axis=1) < 0).all()
    assert curves[0] == pytest.approx(curves[1], rel=0.01)


def test_the_mesh_round_a_sharp_edge_fills_the_plane_and_sweeps_the_sample():
    """Rings of quadrilaterals about the corner, in a block of the graded rest: no gap, no overlap, none turned over."""
    punch = {"shape": "cylinder", "diameter": 1.0, "friction": "stick"}
    for error in (0.003, 0.01, 0.05):
        mesh = meridian_mesh(Sample(**DISC), Indenter(**punch), Mesh(error=error), 0.1)
        assert count_meridian(Sample(**DISC), Indenter(**punch), Mesh(error=error), 0.1) == mesh.nelements
        assert Meridian(mesh).volume.sum() == pytest.approx(np.pi * 36, rel=1e-12)
        inside = mesh.facets.shape[1] - mesh.boundary_facets().size
        assert 2 * inside + mesh.boundary_facets().size == 4 * mesh.nelements
        assert mesh.p[0, mesh.facets[:, mesh.boundaries["footprint"]]].max() == 0.5
    result = pressed({**DISC, "diameter": 3.0}, punch, [0.01, 0.02], error=0.05)
    solid = Solid(_mesh_of(recover(result.model, result, GEL, 1000.0)))
    assert solid.volume.min() > 0
    assert solid.volume.sum() == pytest.approx(np.pi * 1.5**2 / 4, rel=0.01)


def _mesh_of(fields):
    from skfem import MeshHex

    return MeshHex(fields.nodes.T, fields.elements.T)


@pytest.mark.parametrize("elements", [40, 125, 600])
def test_the_number_of_elements_is_about_the_one_that_is_asked_for(elements):
    sample, indenter, mesh = Sample(**DISC), Indenter(**SPHERE), Mesh(elements=elements)
    number = count_meridian(sample, indenter, mesh, 0.2)
    assert number == pytest.approx(elements, rel=0.35)
    assert meridian_mesh(sample, indenter, mesh, 0.2).nelements == number


def test_what_is_not_round_is_solved_as_a_quarter_and_asking_for_more_says_why():
    gel, fibrous = type(GEL), load("transversely_isotropic")
    sphere, disc, block = Indenter(**SPHERE), Sample(**DISC), Sample(shape="block", length=8, width=8, thickness=1, base="bonded")
    strip = Indenter(shape="strip", width=2, length=20, friction=0)
    assert symmetry_of(disc, sphere, Mesh(), Solver(), gel) == "axisymmetric"
    assert symmetry_of(disc, sphere, Mesh(symmetry="quarter"), Solver(), gel) == "quarter"
    assert symmetry_of(disc, sphere, Mesh(), Solver(element="q1p0"), gel) == "quarter"
    for parts, why in (((block, sphere, gel), "sample"), ((disc, strip, gel), "indenter"), ((disc, sphere, fibrous), "fibres")):
        sample, indenter, law = parts
        assert symmetry_of(sample, indenter, Mesh(), Solver(), law) == "quarter"
        with pytest.raises(MeshError, match=why):
            symmetry_of(sample, indenter, Mesh(symmetry="axisymmetric"), Solver(), law)


@pytest.mark.skipif(not (SHARED / "oracles").is_dir(), reason="../shared/oracles is not here")
def test_an_ogden_gel_of_exponent_8_meets_another_code_within_one_percent():
    oracle = json.loads((SHARED / "oracles" / "axi_sphere_R1_bonded_ogden8.json").read_text())
    material = load("ogden")(mu=1.0, alpha=8.0)
    result = pressed(DISC, SPHERE, oracle["displacement_mm"], material=material)
    error, own = np.abs(result.force / np.array(oracle["force_mN"]) - 1), np.array(oracle["error_percent_each"]) / 100
    assert np.all(error < 0.01 + own)
    assert error[1:].max() < 0.004


def test_ogden_of_exponent_2_is_the_neo_hookean_gel_and_its_sensitivities_are_derivatives():
    depths = [0.1, 0.2]
    ogden = load("ogden")(mu=1.0, alpha=2.0)
    result = pressed(DISC, SPHERE, depths, material=ogden, sensitivities=("mu", "alpha"), elements=60)
    assert result.force == pytest.approx(pressed(DISC, SPHERE, depths, elements=60).force, rel=1e-9)
    up, down = (pressed(DISC, SPHERE, depths, material=ogden.replace(alpha=2.0 + h), elements=60).force for h in (0.01, -0.01))
    assert result.sensitivities["alpha"] == pytest.approx((up - down) / 0.02, rel=2e-3)


def test_a_gent_gel_never_gives_a_force_beyond_its_locking_stretch():
    """The steps shrink towards the end of the energy; what is solved is stiffer than the neo-Hookean gel, and no force is wrong."""
    result = pressed(DISC, SPHERE, [0.1, 0.2], material=load("gent")(mu=1.0, Jm=0.5), elements=60)
    soft = pressed(DISC, SPHERE, [0.1, 0.2], elements=60)
    assert np.all(result.force > soft.force)
    assert result.model.body.state(result.last.u, np.array([0.0, 1.0, 0.0])).I[0].max() < 3.5


# ---- depth, and what is left of a curve that ends early ----------------------------------------------------------------


@pytest.mark.parametrize(("R", "friction", "base"), [(0.1, 0.0, "bonded"), (0.3, 0.5, "bonded"), (3.0, 0.0, "sliding")])
def test_a_sphere_goes_to_half_of_the_thickness_and_beyond_its_radius_at_the_first_try(R, friction, base):
    """The springs of a small contact were too soft for its curvature: most such cases failed, the others took minutes."""
    depth = min(0.5, 1.2 * R)
    sample = {"shape": "disc", "diameter": max(6.0, 5 * R), "thickness": 1.0, "base": base}
    result = pressed(sample, {"shape": "sphere", "diameter": 2 * R, "friction": friction}, np.linspace(depth / 10, depth, 10))
    assert result.facts.tries == 1 and result.facts.newton_iterations < 300
    assert (np.diff(result.force) > 0).all() and abs(result.facts.penalty_error) < 2e-3


def test_springs_that_grow_with_the_pressure_keep_the_surface_of_bricks_from_waving_under_a_deep_sphere():
    """Under springs of one stiffness the surface began to wave, node by node, at 37 % depth, and the solution found no end."""
    sample, sphere = {**DISC, "diameter": 2.25}, {"shape": "sphere", "diameter": 1.0, "friction": 0}
    plane = pressed(sample, sphere, [0.24, 0.48], 100.0)
    bricks = pressed(sample, sphere, [0.24, 0.48], 100.0, symmetry="quarter", elements=112)
    assert bricks.facts.tries == 1 and bricks.facts.newton_iterations < 150
    assert bricks.force == pytest.approx(plane.force, rel=0.015)


def test_a_blunt_cone_on_a_thick_layer_meets_sneddon_within_half_a_percent():
    """Sneddon 1965, incompressible half-space: F = 2 / pi E / (1 - nu^2) tan(half_angle) d^2, with E / (1 - nu^2) = 4 mu.

    The thickness, 42 times the contact's radius, adds 0.1 to 0.2 % with a sliding base. The blunt tip, of a 40th of the contact's
    radius, would be a sharp one's at 3e-4 of the depth less.
    """
    depth, angle = 0.002, 80
    contact = 2 / np.pi * depth * np.tan(np.radians(angle))
    sample = {"shape": "disc", "diameter": 1.0, "thickness": 42 * contact, "base": "sliding"}
    result = pressed(sample, {"shape": "cone", "half_angle": angle, "friction": 0}, [depth / 2, depth], 1000.0)
    assert result.force[-1] == pytest.approx(2 / np.pi * 4 * np.tan(np.radians(angle)) * depth**2, rel=5e-3)


@pytest.mark.skipif(not (SHARED / "oracles").is_dir(), reason="../shared/oracles is not here")
def test_a_cone_with_a_tip_meets_another_code_within_one_percent():
    oracle = json.loads((SHARED / "oracles" / "axi_cone60_bonded.json").read_text())
    result = pressed(DISC, oracle["inputs"]["indenter"], oracle["displacement_mm"])
    allowed = 0.01 + np.array(oracle["error_percent_each"]) / 100
    assert (np.abs(result.force / np.array(oracle["force_mN"]) - 1) < allowed).all()
    assert result.facts.tries == 1


def test_a_press_that_fails_half_way_keeps_its_curve_so_far(monkeypatch):
    whole = pressed(DISC, SPHERE, np.linspace(0.02, 0.2, 10), elements=60)
    step = path._step

    def fails_beyond(newton, increment, here, relax):
        if increment.depth > 0.11:
            raise ConvergenceError("folded", increment.depth)
        return step(newton, increment, here, relax)

    monkeypatch.setattr(path, "_step", fails_beyond)
    with pytest.raises(ConvergenceError, match="folded") as failure:
        pressed(DISC, SPHERE, np.linspace(0.02, 0.2, 10), elements=60)
    part = failure.value.part
    assert 0.1 <= part.displacement[-1] <= 0.11 and "folded" in part.unfinished
    assert part.force[:4] == pytest.approx(whole.force[:4], rel=2e-3)


def test_second_tries_end_with_their_time(monkeypatch):
    """The first try's error is raised, not that of the deadline, unless the run's own deadline has passed."""
    fails = ConvergenceError("folded", 0.1)

    def never(*_):
        raise fails

    monkeypatch.setattr("indentfit.fem.simulate.indent", never)
    monkeypatch.setattr("indentfit.fem.simulate.AGAIN_SECONDS", 0.0)
    with pytest.raises(ConvergenceError, match="folded"):
        pressed(DISC, SPHERE, [0.1], elements=30)
