"""The solid: the compiled loop against plain forms, differences, closed forms and Abaqus; one element and patches."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import brentq
from skfem import Basis, BilinearForm, ElementHex0, MeshHex
from skfem.helpers import ddot, grad

from indentfit.case import Case, Indenter, MaterialChoice, Mesh, Sample, Solver, Test
from indentfit.fem import element, forms
from indentfit.fem.element import Solid
from indentfit.fem.forms import FormSolid
from indentfit.fem.mesh import quarter
from indentfit.material import invariants, isochoric_stress, load
from indentfit.runs.forward import simulate

E1, E2, E3 = np.eye(3)
SKEW = np.array([2.0, 1.0, -2.0]) / 3
MU, ZETA, PHI = 1.49, 4.68, 0.68  # the source paper's optimum
WHITE_MATTER = load("transversely_isotropic")(mu=MU, zeta=ZETA, phi=PHI)
MATERIALS = (
    WHITE_MATTER,
    load("neo_hookean")(mu=MU),
    load("mooney_rivlin")(c10=1.0, c01=0.7),
    load("holzapfel")(c=1.0, k1=3.0, k2=2.0, dispersion=0.1),
    load("ogden")(mu=1.2, alpha=-5.0),
)
ELEMENTS = ("q1p0", "q2p1")
by_name = pytest.mark.parametrize("material", MATERIALS, ids=lambda material: type(material).__name__)
by_element = pytest.mark.parametrize("kind", ELEMENTS)


def distorted(n=2, amount=0.07):
    """A unit cube of n^3 bricks whose inner nodes are moved, by the same random amounts every time."""
    mesh = MeshHex.init_tensor(*[np.linspace(0, 1, n + 1)] * 3)
    inner = np.setdiff1d(np.arange(mesh.p.shape[1]), mesh.boundary_nodes())
    mesh.p[:, inner] += amount * np.random.default_rng(0).uniform(-1, 1, (3, inner.size))
    return MeshHex(mesh.p, mesh.t)


def skewed_bricks():
    """Two bricks without a right angle."""
    mesh = MeshHex.init_tensor([0, 0.6, 1], [0, 1], [0, 0.8])
    return MeshHex(mesh.p + 0.06 * np.random.default_rng(1).uniform(-1, 1, mesh.p.shape), mesh.t)


def random_state(solid, material, bulk_ratio=20.0, size=0.05):
    """(u, state, pressure, kappa): a wild but valid displacement, and pressures that don't follow from it."""
    rng = np.random.default_rng(2)
    u = size * rng.uniform(-1, 1, solid.n_dofs) * (1.0 if solid.element == "q1p0" else 0.5)
    state, kappa = solid.state(u, SKEW), bulk_ratio * material.shear_modulus
    assert state.valid
    pressure = solid.pressure(state, kappa)
    return u, state, pressure + 0.3 * np.max(np.abs(pressure)) * rng.standard_normal(pressure.shape), kappa


def moved(solid, F):
    """Displacements of the homogeneous deformation x = F X."""
    X = solid.basis.doflocs[:, ::3]
    return ((F - np.eye(3)) @ X).T.ravel()


def cauchy(material, F, fibre, kappa):
    """Cauchy stress of a homogeneous deformation, by the chain rule in F."""
    P = isochoric_stress(material, F[..., None], fibre[:, None])[..., 0]
    return P @ F.T / np.linalg.det(F) + kappa * (np.linalg.det(F) - 1) * np.eye(3)


def as_components(sigma):
    return np.array([sigma[0, 0], sigma[1, 1], sigma[2, 2], sigma[0, 1], sigma[1, 2], sigma[0, 2]])


def largest(a, b):
    return np.max(np.abs(a - b)) / np.max(np.abs(b))


# ---- the compiled loop is the plain forms, entry by entry -----------------------------------------------------------


@by_element
@by_name
def test_compiled_loop_and_plain_forms_agree_entry_by_entry(kind, material):
    mesh = skewed_bricks()
    compiled, plain = Solid(mesh, kind), FormSolid(mesh, kind)
    u, state, pressure, kappa = random_state(compiled, material)
    same = plain.state(u, SKEW)
    assert_allclose(same.I, state.I, rtol=1e-12)
    assert_allclose(same.theta, state.theta, rtol=1e-12, atol=1e-14)
    assert same.valid
    forces, values = compiled.tangent(u, state, material, pressure, kappa, SKEW)
    same_forces, same_values = plain.tangent(u, same, material, pressure, kappa, SKEW)
    assert largest(same_forces, forces) < 1e-12
    assert largest(same_values, values) < 1e-12
    for solid_method in ("residual", "stress"):
        a, b = (getattr(solid, solid_method)(u, state, material, pressure, SKEW) for solid in (plain, compiled))
        assert largest(a, b) < 1e-12
    assert largest(plain.dilatation_map(u), compiled.dilatation_map(u)) < 1e-12


@pytest.mark.parametrize("name", ["kinematics", "tangent", "residual", "cauchy", "dilatation_map"])
def test_the_loop_means_the_same_as_python(name, monkeypatch):
    """Compiled with fast-math or read by Python: the same numbers, so no compiler option changes the mechanics."""
    solid, material = Solid(skewed_bricks()), WHITE_MATTER
    u, state, pressure, kappa = random_state(solid, material)
    run = {
        "kinematics": lambda: solid.state(u, SKEW).I,
        "tangent": lambda: solid.tangent(u, state, material, pressure, kappa, SKEW)[1],
        "residual": lambda: solid.residual(u, state, material, pressure, SKEW),
        "cauchy": lambda: solid.stress(u, state, material, pressure, SKEW),
        "dilatation_map": lambda: solid.dilatation_map(u),
    }[name]
    compiled = run()
    for step, function in vars(element).copy().items():
        if hasattr(function, "py_func"):
            monkeypatch.setattr(element, step, function.py_func)
    monkeypatch.setattr(element, "on_stack", np.empty)
    loops = solid._loops(4)
    monkeypatch.setattr(loops, name, getattr(loops, name).py_func)
    assert largest(run(), compiled) < 1e-12


@pytest.mark.parametrize(("kind", "elements"), [("q1p0", 600), ("q2p1", 120)])
def test_any_number_of_threads_gives_the_same_bits(kind, elements):
    sample = Sample(shape="disc", diameter=14, thickness=3.3, base="sliding")
    solid = Solid(quarter(sample, Indenter(shape="strip", width=2, length=20, friction=0.5), Mesh(elements=elements)), kind)
    u, state, pressure, kappa = random_state(solid, WHITE_MATTER)
    found = []
    for solid._threads in (1, 2, 3, 3, 3):
        there = solid.state(u, SKEW)
        loops = (solid.residual(u, state, WHITE_MATTER, pressure, SKEW), solid.dilatation_map(u))
        found.append((there.I, there.theta, *solid.tangent(u, state, WHITE_MATTER, pressure, kappa, SKEW), *loops))
    assert all(np.array_equal(a, b) for other in found[1:] for a, b in zip(found[0], other, strict=True))
    for group in solid._groups:  # what is added up at once has no node in common
        nodes = [set(solid.dofs[elements].ravel()) for elements in group]
        assert sum(map(len, nodes)) == len(set().union(*nodes))
    ranges = [elements for group in solid._groups for elements in group]
    assert sorted(np.concatenate(ranges)) == list(range(solid.mesh.nelements))


def test_an_inverted_element_is_not_valid():
    mesh = skewed_bricks()
    for solid in (Solid(mesh), FormSolid(mesh)):
        u = moved(solid, np.diag([-0.5, 1.0, 1.0]))
        assert not solid.state(u, E1).valid
        u[:] = np.nan
        assert not solid.state(u, E1).valid


def test_a_whole_case_runs_on_the_plain_forms():
    def force(assembly):
        case = Case(
            sample=Sample(shape="block", length=6, width=6, thickness=3.3, base="sliding"),
            indenter=Indenter(shape="strip", width=2, length=20, friction=0.5),
            mesh=Mesh(elements=20),
            material=MaterialChoice(
                model="transversely_isotropic", parameters={"mu": MU, "zeta": ZETA, "phi": PHI}, bulk_ratio=1000.0
            ),
            tests=(Test(name="perpendicular", angle=90, depth=0.1, points=2),),
            solver=Solver(assembly=assembly, tolerance=1e-9),
        )
        return simulate(case, mesh_error=False).tests[0].force

    assert_allclose(force("forms"), force("compiled"), rtol=1e-8)


# ---- the tangent ----------------------------------------------------------------------------------------------------


@by_element
@by_name
def test_tangent_is_the_derivative_of_the_residual(kind, material):
    """At fixed iterated pressures the residual's derivative, plus what the pressures that follow from u add."""
    solid = Solid(skewed_bricks(), kind)
    u, state, pressure, kappa = random_state(solid, material)
    v, h = np.random.default_rng(3).uniform(-1, 1, solid.n_dofs), 1e-6

    def forces(u):
        return solid.residual(u, solid.state(u, SKEW), material, pressure, SKEW)

    B = solid.dilatation_map(u)
    expected = (forces(u + h * v) - forces(u - h * v)) / (2 * h)
    changes = np.einsum("emni,eni->em", B, v[solid.dofs])
    np.add.at(expected, solid.dofs, kappa * np.einsum("em,emni->eni", changes, B))
    _, values = solid.tangent(u, state, material, pressure, kappa, SKEW)
    assert largest(solid.matrix(values) @ v, expected) < 1e-7


@by_element
def test_tangent_returns_the_forces_of_the_pressure_that_follows_from_u(kind):
    solid, material = Solid(skewed_bricks(), kind), WHITE_MATTER
    u, state, pressure, kappa = random_state(solid, material)
    forces, _ = solid.tangent(u, state, material, pressure, kappa, SKEW)
    follows = solid.pressure(state, kappa)
    assert largest(forces, solid.residual(u, state, material, follows, SKEW)) < 1e-13


@by_element
@by_name
def test_tangent_is_symmetric_and_forces_balance(kind, material):
    solid = Solid(skewed_bricks(), kind)
    u, state, pressure, kappa = random_state(solid, material)
    forces, values = solid.tangent(u, state, material, pressure, kappa, SKEW)
    K = solid.matrix(values).toarray()
    assert largest(K, K.T) < 1e-14
    x = solid.basis.doflocs[:, ::3].T + u.reshape(-1, 3)
    assert np.max(np.abs(forces.reshape(-1, 3).sum(axis=0))) < 1e-13 * np.abs(forces).sum()
    assert np.max(np.abs(np.cross(x, forces.reshape(-1, 3)).sum(axis=0))) < 1e-13 * np.abs(forces).sum()


def test_condensed_tangent_is_the_schur_complement_of_the_mixed_forms():
    """The pressure as an own unknown of scikit-fem's constant element, eliminated by dense linear algebra."""
    solid, material = FormSolid(skewed_bricks()), WHITE_MATTER
    u, state, _, kappa = random_state(solid, material)
    pressure = solid.pressure(state, kappa)
    _, values = solid.tangent(u, state, material, pressure, kappa, SKEW)
    constant = solid.basis.with_element(ElementHex0())
    F = np.eye(3)[..., None, None] + grad(solid.basis.interpolate(u))
    first = material.gradient(state.I).reshape(4, *solid.weights.shape)
    second = material.hessian(state.I).reshape(4, 4, *solid.weights.shape)
    p = (pressure[:, 0] / np.sqrt(solid.volume))[:, None] * np.ones_like(solid.weights)
    A = forms.stiffness.assemble(solid.basis, A=forms.moduli(F, SKEW, first, second, p)).toarray()
    coupling = BilinearForm(lambda u, q, w: q * ddot(w.cofactor, grad(u)))
    B = coupling.assemble(solid.basis, constant, cofactor=forms.cofactor(F)).toarray()
    M = BilinearForm(lambda p, q, w: p * q).assemble(constant).toarray()
    assert largest(solid.matrix(values).toarray(), A + kappa * B.T @ np.linalg.solve(M, B)) < 1e-12


# ---- objectivity and patches ----------------------------------------------------------------------------------------


def rotation(seed=4):
    Q = np.linalg.qr(np.random.default_rng(seed).standard_normal((3, 3)))[0]
    return Q * np.sign(np.linalg.det(Q))


@by_element
@by_name
def test_a_rotated_body_is_free_of_forces(kind, material):
    solid, kappa = Solid(skewed_bricks(), kind), 1000 * material.shear_modulus
    u = moved(solid, rotation())
    state = solid.state(u, SKEW)
    forces = solid.residual(u, state, material, solid.pressure(state, kappa), SKEW)
    assert np.max(np.abs(forces)) < 1e-12 * kappa


@by_element
@by_name
def test_forces_and_stresses_turn_with_the_body(kind, material):
    solid, Q = Solid(skewed_bricks(), kind), rotation()
    u, state, pressure, _ = random_state(solid, material)
    X = solid.basis.doflocs[:, ::3].T
    turned = ((X + u.reshape(-1, 3)) @ Q.T - X).ravel()
    forces = solid.residual(u, state, material, pressure, SKEW).reshape(-1, 3)
    again = solid.state(turned, SKEW)
    assert largest(solid.residual(turned, again, material, pressure, SKEW).reshape(-1, 3), forces @ Q.T) < 1e-12
    sigma, places = solid.stress(u, state, material, pressure, SKEW), [[0, 3, 5], [3, 1, 4], [5, 4, 2]]
    expected = np.einsum("ik,kl...,jl->ij...", Q, sigma[places], Q)
    assert largest(solid.stress(turned, again, material, pressure, SKEW)[places], expected) < 1e-12


@by_element
@by_name
@pytest.mark.parametrize("build", [Solid, FormSolid])
def test_patch_a_homogeneous_deformation_gives_a_homogeneous_stress(build, kind, material):
    n = 2 if build is Solid or kind == "q1p0" else 1
    solid, kappa = build(distorted(n), kind), 50 * material.shear_modulus
    F = np.array([[1.10, 0.15, 0.0], [-0.05, 0.95, 0.1], [0.05, 0.0, 1.02]])
    u = moved(solid, F)
    state = solid.state(u, SKEW)
    pressure = solid.pressure(state, kappa)
    assert_allclose(state.I, np.repeat(invariants(F[..., None], SKEW[:, None]), state.I.shape[1], axis=1), rtol=1e-11)
    stress = solid.stress(u, state, material, pressure, SKEW)
    expected = as_components(cauchy(material, F, SKEW, kappa))
    assert np.max(np.abs(stress - expected[:, None, None])) < 1e-11 * np.max(np.abs(expected))
    forces = solid.residual(u, state, material, pressure, SKEW)
    inner = np.setdiff1d(np.arange(solid.n_dofs), solid.basis.get_dofs().all())
    assert np.max(np.abs(forces[inner]), initial=0) < 1e-12 * np.max(np.abs(forces))


@by_element
def test_the_pressure_modes_are_orthonormal_and_the_volume_is_exact(kind):
    solid = Solid(distorted(), kind)
    assert solid.volume.sum() == pytest.approx(1.0, rel=1e-12)
    products = np.einsum("ekq,elq,eq->ekl", solid.modes, solid.modes, solid.weights)
    assert_allclose(products, np.broadcast_to(np.eye(solid.modes.shape[1]), products.shape), atol=1e-12)


def test_the_pattern_is_sorted_with_its_diagonal():
    solid = Solid(distorted(), "q1p0")
    matrix = solid.matrix(np.ones(solid.indices.size))
    assert matrix.has_canonical_format
    assert matrix.diagonal().all()
    assert np.all(matrix.toarray() == matrix.toarray().T)


# ---- one element ----------------------------------------------------------------------------------------------------


def pulled(material, kappa, stretch, fibre, axis=0, kind="q1p0"):
    """Cauchy stress (6,) of one brick stretched along an axis with free sides, by Newton on its displacements."""
    solid = Solid(MeshHex(), kind)
    X, u = solid.basis.doflocs, np.zeros(solid.n_dofs)
    component = np.arange(solid.n_dofs) % 3
    along = X[component, np.arange(solid.n_dofs)]
    held = (along == 0) | ((component == axis) & (along == 1))
    pulling, free = (component == axis) & (along == 1), np.flatnonzero(~held)
    state = solid.state(u, fibre)
    pressure = solid.pressure(state, kappa)
    for step in np.linspace(0, stretch - 1, 6)[1:]:
        u[pulling] = step
        for _ in range(30):
            state = solid.state(u, fibre)
            forces, values = solid.tangent(u, state, material, pressure, kappa, fibre)
            du = np.zeros_like(u)
            du[free] = np.linalg.solve(solid.matrix(values).toarray()[np.ix_(free, free)], -forces[free])
            change = kappa * np.einsum("emni,eni->em", solid.dilatation_map(u), du[solid.dofs])
            u, pressure = u + du, solid.pressure(state, kappa) + change
            if np.max(np.abs(du)) < 1e-12:
                break
        else:
            raise AssertionError("Newton did not converge on one element")
    stress = solid.stress(u, solid.state(u, fibre), material, pressure, fibre).reshape(6, -1)
    assert_allclose(stress, stress[:, :1] * np.ones(stress.shape[1]), atol=1e-7 * np.max(np.abs(stress)))
    assert np.max(np.abs(np.delete(stress[:, 0], axis))) < 1e-7 * abs(stress[axis, 0])
    return stress[:, 0]


@by_element
@pytest.mark.parametrize(
    ("stretch", "stress"),
    [(1.01, 20.58), (1.05, 106.0), (1.10, 218.8), (1.20, 460.9), (1.30, 719.6), (1.40, 990.7), (1.50, 1272.0)],
)
def test_one_element_along_the_fibre_meets_abaqus(kind, stretch, stress):
    """The authors' own output for C3D8H with their user material, to the figures printed."""
    material = load("transversely_isotropic")(mu=13.0, zeta=50.0, phi=1.0)
    assert pulled(material, 1000.0, stretch, E1, kind=kind)[0] == pytest.approx(stress, rel=1e-3)


@pytest.mark.parametrize(
    ("fibre", "stretch", "stress"),
    [
        (E1, 0.9, -2.59301), (E1, 1.1, 3.97295), (E1, 1.2, 9.66127),
        (E2, 0.9, -0.59645), (E2, 1.1, 0.55154), (E2, 1.2, 1.08001),
        (E3, 0.9, -0.59645), (E3, 1.1, 0.55154), (E3, 1.2, 1.08001),
    ],
)  # fmt: skip
def test_one_element_at_a_bulk_ratio_of_1000(fibre, stretch, stress):
    assert pulled(WHITE_MATTER, 1000 * MU, stretch, fibre)[0] == pytest.approx(stress, abs=6e-6)


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("stretch", [0.9, 1.1, 1.2])
def test_one_incompressible_element_along_the_fibre_meets_the_closed_form(axis, stretch):
    closed = MU * (stretch**2 - 1 / stretch) + 2 * MU * ZETA * stretch**2 * (stretch**2 - 1)
    stress = pulled(WHITE_MATTER, 1e7 * MU, stretch, np.eye(3)[axis], axis)
    assert stress[axis] == pytest.approx(closed, rel=1e-5)


@by_element
@pytest.mark.parametrize(("stretch", "stress"), [(0.9, -0.59662), (1.1, 0.55185), (1.2, 1.08078)])
def test_one_incompressible_element_across_the_fibre_meets_the_closed_form(kind, stretch, stress):
    def balance(q):  # the stress along the fibre is zero where its stretch is q
        return MU * (q**2 - 1 / (stretch * q) ** 2) + 2 * MU * ZETA * q**2 * (q**2 - 1)

    q = brentq(balance, 0.5, 1.5, xtol=1e-14)
    closed = MU * (stretch**2 - 1 / (stretch * q) ** 2)
    assert closed == pytest.approx(stress, abs=6e-6)
    assert pulled(WHITE_MATTER, 1e7 * MU, stretch, E2, kind=kind)[0] == pytest.approx(closed, rel=1e-5)


@by_element
@pytest.mark.parametrize("g", [0.01, 0.2, 0.5])
@pytest.mark.parametrize(
    ("fibre", "closed"),
    [
        (E1, lambda g: MU * (1 + PHI) * g),
        (E2, lambda g: MU * (1 + PHI) * g + 2 * MU * ZETA * g**3),
        (E3, lambda g: MU * g),
    ],
)
@pytest.mark.parametrize("bulk_ratio", [10.0, 1000.0])
def test_one_element_in_simple_shear_meets_the_closed_form(kind, fibre, closed, g, bulk_ratio):
    solid, kappa = Solid(MeshHex(), kind), bulk_ratio * MU
    u = moved(solid, np.eye(3) + g * np.outer(E1, E2))
    state = solid.state(u, fibre)
    shear = solid.stress(u, state, WHITE_MATTER, solid.pressure(state, kappa), fibre)[3]
    assert_allclose(shear, closed(g), rtol=1e-12)


def test_the_brick_does_not_lock():
    """A clamped beam bends as easily at kappa/mu = 1e6 as at 100, to 3 %."""
    mesh = MeshHex.init_tensor(np.linspace(0, 8, 9), np.linspace(0, 1, 5), [0, 1])
    solid, material = Solid(mesh), load("neo_hookean")(mu=1.0)
    u = np.zeros(solid.n_dofs)
    X = solid.basis.doflocs[:, ::3]
    free = np.flatnonzero(np.repeat(X[0] > 0, 3))
    load_ = np.zeros(solid.n_dofs)
    load_[1::3][X[0] == 8] = 1.0

    def give(kappa):
        state = solid.state(u, E1)
        K = solid.matrix(solid.tangent(u, state, material, solid.pressure(state, kappa), kappa, E1)[1]).toarray()
        return load_[free] @ np.linalg.solve(K[np.ix_(free, free)], load_[free])

    assert give(1e6) == pytest.approx(give(100.0), rel=0.03)


def test_bases_are_scikit_fems():
    solid = Solid(skewed_bricks())
    assert isinstance(solid.basis, Basis)
    assert_allclose(solid.volume.sum(), Basis(skewed_bricks(), ElementHex0(), intorder=4).dx.sum(), rtol=1e-12)
