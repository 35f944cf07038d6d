"""Two families of fibres: the compiled loop against plain forms, laws against closed forms, symmetries, and what a case says."""

import numpy as np
import pytest
from fixtures.cases import CASES, tiny_case
from numpy.testing import assert_allclose
from skfem import MeshHex

from indentfit.case import Indenter, Mesh, Sample, Solver
from indentfit.errors import CaseError, MaterialError
from indentfit.experiment.measured import read_case
from indentfit.fem import element
from indentfit.fem.element import Solid
from indentfit.fem.forms import FormSolid
from indentfit.fem.setup import Press, Setup
from indentfit.fem.simulate import Model
from indentfit.fibres import directions, kept_by_two
from indentfit.material import HomogeneousState, exchangeable, isochoric_stress, load, typed
from indentfit.runs.forward import simulate
from indentfit.runs.points import setup_of

PAIR = np.array([[2.0, 1.0, -2.0], [-1.0, 4.0, 8.0]]) / np.array([[3.0], [9.0]])
RIGHT = np.array([[2.0, 1.0, -2.0], [1.0, 2.0, 2.0]]) / 3
COUPLED = typed("mu/2*(I1 - 3) + a*I8^2 + b*(I6 - 1)^2", ["mu", "a", "b"])
PAPER = load("two_families")(mu=1.49, zeta=4.68, phi=0.68, second=0.5)
CORNEA = load("holzapfel_two_families")(c=1.0, k1=3.0, k2=2.0, dispersion=0.1)
FUNG = load("fung_orthotropic")(c=0.7, m1=1.0, m2=0.5, m3=0.8, s1=6.0, s2=2.0, coupling=0.4)
LIGAMENT = {"c": 20.0, "c3": 30.0, "c4": 40.0, "c5": 5000.0, "straight": 1.05}
MATERIALS = {
    "paper": (PAPER, PAIR),
    "cornea": (CORNEA, PAIR),
    "fung": (FUNG, RIGHT),
    "coupled": (COUPLED(mu=1.0, a=0.7, b=0.3), RIGHT),
}
DEPTHS = np.array([0.15, 0.3])


@pytest.fixture(params=MATERIALS)
def law(request):
    return MATERIALS[request.param]


def skewed_bricks():
    mesh = MeshHex.init_tensor([0, 0.6, 1], [0, 1], [0, 0.8])
    return MeshHex(mesh.p + 0.06 * np.random.default_rng(1).uniform(-1, 1, mesh.p.shape), mesh.t)


def random_state(solid, material, fibres):
    rng = np.random.default_rng(2)
    u = 0.05 * rng.uniform(-1, 1, solid.n_dofs) * (1.0 if solid.element == "q1p0" else 0.5)
    state, kappa = solid.state(u, fibres), 20 * material.shear_modulus
    assert state.valid
    pressure = solid.pressure(state, kappa)
    return u, state, pressure + 0.3 * np.max(np.abs(pressure)) * rng.standard_normal(pressure.shape), kappa


def largest(a, b):
    return np.max(np.abs(a - b)) / np.max(np.abs(b))


@pytest.mark.parametrize("kind", ["q1p0", "q2p1"])
def test_compiled_loop_and_plain_forms_agree_entry_by_entry(kind, law):
    material, fibres = law
    compiled, plain = Solid(skewed_bricks(), kind), FormSolid(skewed_bricks(), kind)
    u, state, pressure, kappa = random_state(compiled, material, fibres)
    same = plain.state(u, fibres)
    assert_allclose(same.I, state.I, rtol=1e-12, atol=1e-14)
    forces, values = compiled.tangent(u, state, material, pressure, kappa, fibres)
    same_forces, same_values = plain.tangent(u, same, material, pressure, kappa, fibres)
    assert largest(same_forces, forces) < 1e-12
    assert largest(same_values, values) < 1e-12
    for method in ("residual", "stress"):
        a, b = (getattr(solid, method)(u, state, material, pressure, fibres) for solid in (plain, compiled))
        assert largest(a, b) < 1e-12


@pytest.mark.parametrize("name", ["kinematics", "tangent", "residual", "cauchy"])
def test_the_loop_means_the_same_as_python(name, monkeypatch):
    solid, (material, fibres) = Solid(skewed_bricks()), MATERIALS["coupled"]
    u, state, pressure, kappa = random_state(solid, material, fibres)
    run = {
        "kinematics": lambda: solid.state(u, fibres).I,
        "tangent": lambda: solid.tangent(u, state, material, pressure, kappa, fibres)[1],
        "residual": lambda: solid.residual(u, state, material, pressure, fibres),
        "cauchy": lambda: solid.stress(u, state, material, pressure, fibres),
    }[name]
    compiled = run()
    for step, function in vars(element).copy().items():
        if hasattr(function, "py_func"):
            monkeypatch.setattr(element, step, function.py_func)
    monkeypatch.setattr(element, "on_stack", np.empty)
    loops = solid._loops(7)
    monkeypatch.setattr(loops, name, getattr(loops, name).py_func)
    assert largest(run(), compiled) < 1e-12


def test_tangent_is_the_derivative_of_the_residual(law):
    material, fibres = law
    solid = Solid(skewed_bricks())
    u, state, pressure, kappa = random_state(solid, material, fibres)
    v, h = np.random.default_rng(3).uniform(-1, 1, solid.n_dofs), 1e-6

    def forces(u):
        return solid.residual(u, solid.state(u, fibres), material, pressure, fibres)

    B = solid.dilatation_map(u)
    expected = (forces(u + h * v) - forces(u - h * v)) / (2 * h)
    np.add.at(expected, solid.dofs, kappa * np.einsum("em,emni->eni", np.einsum("emni,eni->em", B, v[solid.dofs]), B))
    _, values = solid.tangent(u, state, material, pressure, kappa, fibres)
    assert largest(solid.matrix(values) @ v, expected) < 1e-7


# ---- laws against closed forms by hand: incompressible, Cauchy stresses ----------------------------------------------

HARD = 1e6  # bulk over shear modulus: closed forms are those of a constant volume


def state(kind, families, ratio=1.0, fibres="along", sign=1):
    return HomogeneousState(kind, fibres, sign, ratio, True, families)


def solved(material, state, strain):
    return state.solve(material, HARD * material.shear_modulus, np.array([strain])).stress[0]


@pytest.mark.quick
@pytest.mark.parametrize("half_angle", [20.0, 45.0, 70.0])
def test_biaxial_stress_of_two_dispersed_families_is_the_closed_form(half_angle):
    l1, l2, (c, k1, k2, d) = 1.15, 1.06, CORNEA.values.values()
    l3, c2, s2 = 1 / (l1 * l2), np.cos(np.radians(half_angle)) ** 2, np.sin(np.radians(half_angle)) ** 2
    E = d * (l1**2 + l2**2 + l3**2 - 3) + (1 - 3 * d) * (l1**2 * c2 + l2**2 * s2 - 1)
    slope = k1 * E * np.exp(k2 * E**2)  # of each family by its E
    by_I1, by_I4 = c / 2 + 2 * d * slope, 2 * (1 - 3 * d) * slope
    expected = 2 * by_I1 * (l1**2 - l3**2) + 2 * by_I4 * l1**2 * c2
    families = (half_angle, -half_angle)
    assert solved(CORNEA, state("biaxial", families, (l2 - 1) / (l1 - 1)), l1 - 1) == pytest.approx(expected, rel=1e-4)


@pytest.mark.quick
def test_biaxial_stress_of_the_papers_law_with_two_families_is_the_closed_form():
    l1, l2, (mu, zeta, phi, second) = 1.1, 1.04, PAPER.values.values()
    l3 = 1 / (l1 * l2)
    expected = mu * (l1**2 - l3**2) + mu * zeta * 2 * (l1**2 - 1) * l1**2  # along the first; I5 - I4^2 = 0 on an axis
    assert phi and second
    assert solved(PAPER, state("biaxial", (0.0, 90.0), 0.4), 0.1) == pytest.approx(expected, rel=1e-4)
    across = mu * (l1**2 - l3**2) + mu * zeta * second * 2 * (l1**2 - 1) * l1**2  # the second family along axis 1
    assert solved(PAPER, state("biaxial", (90.0, 0.0), 0.4), 0.1) == pytest.approx(across, rel=1e-4)


@pytest.mark.quick
def test_shear_stress_of_the_papers_law_with_families_at_any_angles_is_the_derivative_of_the_energy():
    mu, zeta, phi, second = PAPER.values.values()

    def psi(g, angles=(25.0, -50.0)):
        C, energy = np.array([[1, g, 0], [g, 1 + g * g, 0], [0, 0, 1]]), g * g
        for share, angle in zip((1.0, second), np.radians(angles), strict=True):
            a = np.array([np.cos(angle), np.sin(angle), 0])
            energy += share * (zeta * (a @ C @ a - 1) ** 2 + phi * (a @ C @ C @ a - (a @ C @ a) ** 2))
        return mu / 2 * energy

    expected = (psi(0.2 + 1e-5) - psi(0.2 - 1e-5)) / 2e-5
    assert solved(PAPER, state("shear", (25.0, -50.0)), 0.2) == pytest.approx(expected, rel=1e-8)
    turned = state("shear", (-65.0, 40.0), fibres="across")  # the same directions: from axis 2, which is at 90, in the same sense
    assert solved(PAPER, turned, 0.2) == pytest.approx(expected, rel=1e-8)


@pytest.mark.quick
def test_biaxial_stress_of_fungs_law_is_the_closed_form():
    (l1, l2), (c, m1, m2, m3, s1, s2, r) = (1.2, 1.1), FUNG.values.values()
    l3 = 1 / (l1 * l2)
    E1, E2, E3 = (l1**2 - 1) / 2, (l2**2 - 1) / 2, (l3**2 - 1) / 2
    coupled = r * np.sqrt(s1 * s2)
    Q = 2 * (m1 * E1**2 + m2 * E2**2 + m3 * E3**2) + s1 * E1**2 + s2 * E2**2 + 2 * coupled * E1 * E2
    by_E1, by_E3 = 4 * m1 * E1 + 2 * s1 * E1 + 2 * coupled * E2, 4 * m3 * E3
    expected = c / 2 * np.exp(Q) * (by_E1 * l1**2 - by_E3 * l3**2)
    assert solved(FUNG, state("biaxial", (0.0, 90.0), 0.5), 0.2) == pytest.approx(expected, rel=1e-4)


@pytest.mark.quick
def test_fungs_small_strain_moduli_are_those_of_its_parameters():
    c, m1, m2, m3, s1, s2, r = FUNG.values.values()
    K = c * np.array([[2 * m1 + s1, r * np.sqrt(s1 * s2), 0], [r * np.sqrt(s1 * s2), 2 * m2 + s2, 0], [0, 0, 2 * m3]])
    traceless = np.array([[1.0, 0], [-1, 1], [0, -1]])  # the energy e.K e / 2 of strains along the axes, their sum zero
    for name, axis in (("E_first", 0), ("E_second", 1), ("E_normal", 2)):
        A, b = traceless.T @ K @ traceless, traceless[axis]
        assert FUNG.moduli()[name] == pytest.approx(1 / (b @ np.linalg.solve(A, b)), rel=1e-9)
    F = np.eye(3)
    F[0, 1] = 1e-5
    axes = np.eye(3)[:2, :, None]
    assert isochoric_stress(FUNG, F[..., None], axes)[0, 1, 0] / 1e-5 == pytest.approx(c * (m1 + m2) / 2, rel=1e-6)


@pytest.mark.quick
@pytest.mark.parametrize("stretch", [0.9, 1.02, 1.05, 1.12])
def test_uniaxial_stress_of_a_ligament_is_that_of_slack_crimped_and_straight_fibres(stretch):
    ligament = load("weiss")(**LIGAMENT)
    c, c3, c4, c5, straight = LIGAMENT.values()
    toe = c3 * (np.exp(c4 * (min(max(stretch, 1.0), straight) - 1)) - 1)
    expected = c * (stretch**2 - 1 / stretch) + toe + c5 * max(stretch - straight, 0.0)
    along = HomogeneousState("uniaxial", "along", 1 if stretch > 1 else -1, 1.0, True)
    strain = abs(stretch - 1)
    got = along.solve(ligament, HARD * c, np.array([strain])).stress[0] * along.sign
    assert got == pytest.approx(expected, rel=2e-4)


@pytest.mark.quick
def test_the_ligament_has_the_energy_that_is_the_integral_of_its_stress():
    ligament = load("weiss")(**LIGAMENT)
    _, c3, c4, c5, straight = LIGAMENT.values()
    x = np.linspace(1, 1.1, 20001)
    stress = np.where(x < straight, c3 * (np.exp(c4 * (x - 1)) - 1), c3 * (np.exp(c4 * (straight - 1)) - 1) + c5 * (x - straight))
    expected = np.sum((stress[1:] / x[1:] + stress[:-1] / x[:-1]) / 2) * (x[1] - x[0])
    assert ligament.psi(np.array([3.0, 3, 1.1**2, 1.1**4])) == pytest.approx(expected, rel=1e-6)


# ---- symmetry and equilibrium ---------------------------------------------------------------------------------------


@pytest.mark.quick
@pytest.mark.parametrize(
    ("families", "alike", "part"),
    [
        (((30, 0), (-30, 0)), True, "quarter"), (((30, 0), (-30, 0)), False, "half"), (((0, 0), (90, 0)), False, "quarter"),
        (((30, 0), (-20, 0)), True, "half"), (((30, 20), (-30, 20)), True, "mirror_z"), (((0, 20), (0, -20)), True, "quarter"),
        (((90, 20), (0, 0)), False, "mirror_x"), (((30, 20), (210, 20)), True, "half"), (((10, 20), (40, 0)), True, "whole"),
    ],
)  # fmt: skip
def test_two_families_keep_the_symmetry_that_their_images_keep(families, alike, part):
    fibres = directions(0.0, 0.0, families)

    def lines(vectors):
        return [np.round(np.outer(v, v), 9).tolist() for v in vectors]

    same = []
    for signs in ((-1, 1, 1), (1, 1, -1), (-1, 1, -1)):
        before, after = lines(fibres), lines(fibres * signs)
        same.append(sorted(before) == sorted(after) if alike else before == after)
    by_images = {(1, 1, 1): "quarter", (1, 0, 0): "mirror_x", (0, 1, 0): "mirror_z", (0, 0, 1): "half", (0, 0, 0): "whole"}
    assert kept_by_two(fibres, alike) == part == by_images[tuple(map(int, same))]


@pytest.mark.quick
def test_families_change_places_where_their_parameters_are_the_same():
    law = type(PAPER)
    assert exchangeable(law, (("second", 1.0),))
    assert not exchangeable(law, ()) and not exchangeable(law, (("second", 2.0),))
    assert exchangeable(type(CORNEA), ()) and not exchangeable(type(FUNG), ())
    assert exchangeable(typed("mu/2*(I1-3) + a*((I4-1)^2 + (I6-1)^2) + b*I8^2", ["mu", "a", "b"]), ())


def model_of(symmetry, depth=0.3, **indenter):
    table = Indenter(**(indenter or {"shape": "strip", "width": 2, "length": 20}), friction=0.4)
    sample = Sample(shape="disc", diameter=14, thickness=3.3, base="sliding")
    solver = Solver(element="q1p0", tolerance=1e-8, max_step=0.0825)
    return Model(Setup(sample, table, Mesh(elements=24), solver, depth, symmetry))


@pytest.fixture(scope="module")
def models():
    return {symmetry: model_of(symmetry) for symmetry in ("quarter", "half", "mirror_z", "whole")}


def forces(model, material, families, angle=0.0, sensitivities=()):
    kappa = 1000 * material.shear_modulus
    result = model.run(Press(material, kappa, angle, DEPTHS, sensitivities=sensitivities, families=families))
    return result if sensitivities else result.force


@pytest.mark.parametrize(  # fibres that may be slack: the last digits of a force depend on how the path came to its depth
    ("material", "tolerance"), [(PAPER.replace(second=1.0), 1e-6), (CORNEA, 1e-4)], ids=["paper", "cornea"]
)
def test_two_families_at_opposite_angles_press_alike_in_the_quarter_the_half_and_the_whole(models, material, tolerance):
    families = ((35.0, 0.0), (-35.0, 0.0))
    quarter = forces(models["quarter"], material, families)
    for part in ("half", "whole"):
        assert_allclose(forces(models[part], material, families), quarter, rtol=tolerance)
    unlike = PAPER.replace(second=0.3)
    assert abs(forces(models["half"], unlike, families)[-1] / forces(models["quarter"], unlike, families)[-1] - 1) > 1e-3


def test_mirror_images_of_two_unlike_families_press_alike_and_dipping_ones_halve_the_whole(models):
    here, there = (forces(models["half"], PAPER, ((a, 0.0), (b, 0.0))) for a, b in ((25, -60), (-25, 60)))
    assert_allclose(here, there, rtol=1e-6)
    families = ((30.0, 25.0), (-30.0, 25.0))
    alike = PAPER.replace(second=1.0)
    assert_allclose(forces(models["mirror_z"], alike, families), forces(models["whole"], alike, families), rtol=1e-6)


def test_a_second_family_without_stiffness_is_not_there_and_two_along_one_line_add_up(models):
    paper = load("transversely_isotropic")(mu=1.49, zeta=4.68, phi=0.68)
    alone = models["half"].run(Press(paper, 1490.0, 40, DEPTHS)).force
    assert_allclose(forces(models["half"], PAPER.replace(second=0.0), ((40.0, 0.0), (-75.0, 0.0))), alone, rtol=1e-6)
    half = PAPER.replace(zeta=2.34, phi=0.34, second=1.0)
    assert_allclose(forces(models["half"], half, ((10.0, 0.0), (10.0, 0.0)), angle=30.0), alone, rtol=1e-6)


def test_a_round_indenter_on_a_disc_has_the_same_force_at_every_angle_of_two_families():
    model = model_of("half", shape="cylinder", diameter=4, edge_radius=0.5)
    values = [forces(model, PAPER, ((0.0, 0.0), (50.0, 0.0)), angle)[-1] for angle in (0.0, 25.0, 60.0)]
    assert np.ptp(values) / values[0] < 1e-2  # the mesh of 24 elements knows directions


def test_sensitivities_with_two_families_are_central_differences(models):
    families, names = ((20.0, 0.0), (-50.0, 0.0)), ("zeta", "second", "fibre_angle")
    exact = forces(models["half"], PAPER, families, 10.0, names).sensitivities
    for name in names:
        step = 0.05 if name == "fibre_angle" else 1e-3 * PAPER.values[name]
        changed = [
            (PAPER, 10.0 + d) if name == "fibre_angle" else (PAPER.replace(**{name: PAPER.values[name] + d}), 10.0)
            for d in (-step, step)
        ]
        low, high = (forces(models["half"], material, families, angle) for material, angle in changed)
        assert_allclose(exact[name], (high - low) / (2 * step), rtol=1e-4, atol=1e-6 * high[-1])


# ---- cases ----------------------------------------------------------------------------------------------------------

VALUES = {"model": "two_families", "bulk_ratio": 1000.0, "parameters": PAPER.values}


def case(folder, overrides=(), test=None, material=VALUES, **tables):
    tests = test or [{"name": "press", "angle": 0, "depth": 0.2, "points": 3}]
    return read_case(tiny_case(folder, test=tests, material=material, **tables), list(overrides))


@pytest.mark.quick
def test_the_part_that_is_solved_is_chosen_by_both_families_and_their_parameters(tmp_path):
    def part(*overrides):
        return setup_of(case(tmp_path, ["sample.families=[40,-40]", *overrides])).symmetry

    assert part() == "half"
    assert part("material.parameters.second=1") == "quarter"
    assert part("material.parameters.second=1", "sample.fibre_angle=10") == "half"
    assert part("sample.family_dips=[10,0]") == "whole"
    free = {"start": 1.0, "min": 0.0, "max": 3.0}
    parameters = {**PAPER.values, "second": free}
    assert setup_of(case(tmp_path, ["sample.families=[40,-40]"], material={**VALUES, "parameters": parameters})).symmetry == "half"


def test_a_case_simulates_two_families_and_tells_them_in_words(tmp_path):
    result = simulate(case(tmp_path, ["sample.families=[40,-40]", "sample.fibre_angle=5"]), mesh_error=False).tests[0]
    assert result.families == ((40.0, 0.0), (-40.0, 0.0)) and result.angle == 5
    assert result.direction == "5°, families at 40° and -40° from there"
    turned = simulate(case(tmp_path, ["sample.families=[45,-35]"]), mesh_error=False).tests[0]
    assert_allclose(turned.force, result.force, rtol=1e-9)


ONE = {"model": "transversely_isotropic", "parameters": {"mu": 1.0, "zeta": 1.0, "phi": 1.0}}
STRETCHED = [{"name": "pull", "kind": "uniaxial", "fibres": "along", "loading": "tension", "strain": 0.1}]
FUNGS = {"model": "fung_orthotropic", "parameters": FUNG.values}
GIVEN = "sample.families=[40,-40]"


@pytest.mark.quick
@pytest.mark.parametrize(
    ("overrides", "tables", "text"),
    [
        ([], {}, r"sample\.families: missing; the material has two families of fibres"),
        ([GIVEN], {"material": ONE}, r"sample\.families.*one family of fibres; remove the key"),
        (["sample.families=[40,-140]"], {}, r"sample\.families.*run in the same direction"),
        ([GIVEN], {"material": FUNGS}, r"sample\.families.*right angles, and these are 80 degrees apart"),
        (["sample.families=[40]"], {}, r"sample\.families.*must be two numbers"),
        (["sample.families=[40,400]"], {}, r"sample\.families.*must be two numbers from -180 to 180"),
        ([GIVEN, "sample.family_dips=[0,95]"], {}, r"sample\.family_dips.*from -90 to 90"),
        ([GIVEN, "test.press.dip=10"], {}, r"test\.press\.dip.*give sample\.family_dips"),
        ([GIVEN, "test.press.families=[1,2]"], {}, r"test\.press\.families.*give sample\.families"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_two_families_is_said_in_one_line(tmp_path, overrides, tables, text):
    with pytest.raises(CaseError, match=text) as caught:
        case(tmp_path, overrides, **tables)
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.quick
@pytest.mark.parametrize(
    ("families", "material", "text"),
    [
        (None, VALUES, r"test\.pull\.families: missing; the material has two families"),
        ([20, -50], VALUES, r"test\.pull\.families.*would shear the specimen"),
        ([20, -20], VALUES, r"test\.pull\.families.*would shear the specimen"),  # the families differ in stiffness
        ([20, -20], ONE, r"test\.pull\.families.*one family of fibres"),
    ],
)
def test_a_specimen_that_would_shear_is_refused(families, material, text):
    from indentfit.case import Case

    test = {**STRETCHED[0], **({"families": families} if families else {})}
    with pytest.raises(CaseError, match=text):
        Case(material=material, tests=[test])
    alike = {**VALUES, "parameters": {**PAPER.values, "second": 1.0}}
    assert Case(material=alike, tests=[{**STRETCHED[0], "families": [20, -20]}])


@pytest.mark.quick
def test_an_energy_that_changes_with_the_sign_of_a_direction_or_is_stressed_at_rest_is_refused():
    with pytest.raises(MaterialError, match=r"sign of I8.*even powers"):
        typed("mu/2*(I1 - 3) + a*I8^3*I4", ["mu", "a"])
    with pytest.raises(MaterialError, match=r"stressed at rest: psi_6 \+ 2 psi_7 must be 0 at I4 = I5 = I6 = I7 = 1, I8 = 0"):
        typed("mu/2*(I1 - 3) + a*(I6 - 1)", ["mu", "a"])


@pytest.mark.parametrize(("name", "truth"), [("tendon", {"c": 2880.0, "c3": 570.0}), ("cornea", {"c": 60.0, "k1": 20.0})])
def test_the_shipped_curves_are_those_of_their_truth(name, truth):
    shipped = read_case(CASES / name / "case.toml")
    assert {setup_of(piece).symmetry for piece in shipped.pieces} == {"quarter"}
    for test, curve in zip(
        simulate(shipped, {**shipped.start_values(), **truth}, mesh_error=False).tests, shipped.curves, strict=True
    ):
        assert 0.002 < np.std(test.force - curve.force) / curve.force.max() < 0.009  # the noise is 0.5 %
