"""Discs between plates: bonded by finite elements, sliding in closed form, against independent solutions; and what a case says."""

import numpy as np
import pytest
import scipy.special
from scipy.sparse import bmat, csr_matrix, diags
from scipy.sparse.linalg import spsolve
from skfem import Basis, BilinearForm, ElementTriP1, ElementTriP2, ElementVector, MeshTri
from skfem.helpers import div, grad

from indentfit.case import Case, MaterialChoice, Test
from indentfit.errors import CaseError, NoStateError
from indentfit.fem.compression import _Disc, pressed_disc
from indentfit.material import HomogeneousState, load
from indentfit.runs.forward import simulate

GEL = load("ogden")(mu=1.3, alpha=4.0)
WHITE = load("transversely_isotropic")(mu=1.49, zeta=4.68, phi=0.68)
YEOH = load("yeoh")(c10=0.8, c20=0.3, c30=0.05)
SMALL = 1e-4


@pytest.mark.parametrize("material", [GEL, pytest.param(YEOH, marks=pytest.mark.campaign)], ids=["ogden", "yeoh"])
def test_a_disc_that_slides_on_its_plates_is_in_the_homogeneous_state(material):
    strains = np.array([0.02, 0.06])
    names = tuple(material.parameters)[:2]
    there = pressed_disc(material, 1000.0, 14.0, 3.3, strains, names, bonded=False)
    exact = HomogeneousState("uniaxial", "along", -1).solve(material, 1000.0, strains, names)
    assert there.stress == pytest.approx(exact.stress, rel=1e-8)
    for name in names:
        assert there.sensitivities[name] == pytest.approx(exact.sensitivities[name], rel=1e-7)


def incompressible_modulus(radius, height, count=24):
    """Apparent modulus over mu of a bonded disc at small strain: Taylor-Hood triangles, incompressible, half of the height."""
    side = 1 - (1 - np.linspace(0, 1, count + 1)) ** 2  # finer towards the rim of the plate
    mesh = MeshTri.init_tensor(radius * side, height / 2 * side)
    u, p = (Basis(mesh, element, intorder=4) for element in (ElementVector(ElementTriP2()), ElementTriP1()))

    @BilinearForm
    def stiffness(u, v, w):
        e, f = ((g + np.swapaxes(g, 0, 1)) / 2 for g in (grad(u), grad(v)))
        return 2 * (np.einsum("ij...,ij...", e, f) + u[0] * v[0] / w.x[0] ** 2) * w.x[0]

    @BilinearForm
    def volume(u, q, w):
        return -(div(u) + u[0] / w.x[0]) * q * w.x[0]

    A, B = stiffness.assemble(u), volume.assemble(u, p)
    axis, base, top = (u.get_dofs(where) for where in (
        lambda x: x[0] < 1e-9, lambda x: x[1] < 1e-9, lambda x: x[1] > height / 2 * (1 - 1e-9)))  # fmt: skip
    moved = top.all(["u^2"])
    held = np.unique(np.concatenate([axis.all(["u^1"]), base.all(["u^2"]), top.all()]))
    K = bmat([[A, B.T], [B, csr_matrix((p.N, p.N))]]).tocsr()
    x = np.zeros(u.N + p.N)
    x[moved] = -height / 2  # a strain of one
    free = np.setdiff1d(np.arange(x.size), held)
    x[free] = spsolve(K[free][:, free].tocsc(), -(K @ x)[free])
    return -2 * np.pi * (K @ x)[moved].sum() / (np.pi * radius**2)


@pytest.mark.parametrize(("radius", "height"), [(7.0, 14.0), (7.0, 3.3), pytest.param(7.0, 1.0, marks=pytest.mark.campaign)])
def test_the_small_strain_modulus_of_a_bonded_disc_is_that_of_incompressible_elasticity(radius, height):
    stress = pressed_disc(GEL, 2e5 * GEL.mu, 2 * radius, height, np.array([SMALL])).stress[0]
    S = radius / (2 * height)
    soft = 1 + 8 * S**2 * 3 / 2e5  # the pressure in a disc that is not quite incompressible, to first order
    exact = incompressible_modulus(radius, height)
    assert stress / SMALL / GEL.mu * soft == pytest.approx(exact, rel=3e-3)
    assert exact == pytest.approx(3 * (1 + 2 * S**2), rel=0.07)  # Gent, Lindley 1959, Proc Inst Mech Eng 173:111: an estimate


def test_a_thin_compressible_disc_is_that_of_its_pressure():
    """Chalhoub, Kelly 1990, Int J Solids Struct 26:743: p'' + p'/r - 12 mu/(kappa t^2) p = - 12 mu e/t^2 between bonded plates."""
    radius, height, kappa, mu = 10.0, 0.25, 200.0, 1.0
    a = np.sqrt(12 * mu / kappa) * radius / height
    expected = kappa * (1 - 2 * scipy.special.i1(a) / (a * scipy.special.i0(a)))
    stress = pressed_disc(load("neo_hookean")(mu=mu), kappa, 2 * radius, height, np.array([SMALL])).stress[0]
    assert stress / SMALL == pytest.approx(expected, rel=0.03)  # the theory leaves out the rim and terms of the size of mu


class Reference:
    """Half of an incompressible neo-Hookean disc (mu = 1) between bonded plates: Taylor-Hood triangles, and the nodes of the side
    pushed below the plate's plane; W = F:F/2 + (q - 1)(J - 1), with the unknown pressures q, 0 at rest."""

    SPRING, STEP = 3e3, 0.02

    def __init__(self, radius, height, count):
        self.radius, self.H = radius, height / 2
        side = 1 - (1 - np.linspace(0, 1, count + 1)) ** 1.5
        mesh = MeshTri.init_tensor(radius * side, self.H * side)
        self.u, self.p = (Basis(mesh, e, intorder=4) for e in (ElementVector(ElementTriP2()), ElementTriP1()))
        r = np.asarray(self.u.global_coordinates())[0]
        self.w = (2 * np.pi * r * self.u.dx).ravel()
        shapes = [self.u.basis[i][0] for i in range(self.u.Nbfun)]
        slopes = [[np.asarray(f.grad)[i, j] for f in shapes] for i in (0, 1) for j in (0, 1)]
        around = [np.asarray(f)[0] / r for f in shapes]
        self.D = [self.operator(self.u, values, r.shape) for values in (*slopes, around)]  # F_rr, F_ry, F_yr, F_yy, F_hoop
        self.Q = self.operator(self.p, [np.asarray(self.p.basis[i][0]) for i in range(self.p.Nbfun)], r.shape)
        axis, base, top, rim = (self.u.get_dofs(where) for where in (
            lambda x: x[0] < 1e-9, lambda x: x[1] < 1e-9, lambda x: x[1] > self.H * (1 - 1e-9),
            lambda x: x[0] > radius * (1 - 1e-9)))  # fmt: skip
        self.moved = top.all(["u^2"])
        held = np.concatenate([axis.all(["u^1"]), base.all(["u^2"]), top.all()])
        self.free = np.setdiff1d(np.arange(self.u.N + self.p.N), held)
        self.rim = np.setdiff1d(rim.all(["u^2"]), self.moved)

    @staticmethod
    def operator(basis, values, shape):
        """The matrix that takes the unknowns of a basis to values at all points of the quadrature."""
        rows = np.tile(np.arange(shape[0] * shape[1]), basis.Nbfun)
        columns = np.concatenate([np.repeat(basis.element_dofs[i], shape[1]) for i in range(basis.Nbfun)])
        return csr_matrix((np.concatenate([np.broadcast_to(v, shape).ravel() for v in values]), (rows, columns)))

    def stress(self, strains):
        """Nominal stresses at strains in rising order, over mu."""
        x, at, out = np.zeros(self.u.N + self.p.N), 0.0, []
        for target in strains:
            while at < target - 1e-12:
                at = min(at + self.STEP, target)
                x, force = self.equilibrium(x, at)
            out.append(force / (np.pi * self.radius**2))
        return np.array(out)

    def equilibrium(self, x, strain):
        n_u, w, e = self.u.N, self.w, self.SPRING * 2 * np.pi * self.radius
        start = self.u.doflocs[1, self.rim]
        for n in range(30):
            F = [d @ x[:n_u] + (i in (0, 3, 4)) for i, d in enumerate(self.D)]
            q = self.Q @ x[n_u:] - 1
            cof = [F[3] * F[4], -F[2] * F[4], -F[1] * F[4], F[0] * F[4], F[0] * F[3] - F[1] * F[2]]
            gap = start + x[self.rim] - self.H * (1 - strain)
            push = e * np.maximum(gap, 0)
            f = np.concatenate(
                [sum(d.T @ (w * (a + q * c)) for d, a, c in zip(self.D, F, cof, strict=True)), self.Q.T @ (w * (cof[4] * F[4] - 1))]
            )
            f[self.rim] += push
            if n and np.abs(f[self.free]).max() < 1e-8:
                return x, push.sum() - f[self.moved].sum()
            A = {(i, i): 1.0 for i in range(5)}
            for i, j, v in ((0, 3, F[4]), (0, 4, F[3]), (3, 4, F[0]), (1, 2, -F[4]), (1, 4, -F[2]), (2, 4, -F[1])):
                A[i, j] = A[j, i] = q * v
            K = sum(self.D[i].T @ diags(w * v) @ self.D[j] for (i, j), v in A.items())
            K = K + csr_matrix((e * (gap > 0), (self.rim, self.rim)), shape=K.shape)
            B = sum(d.T @ diags(w * c) @ self.Q for d, c in zip(self.D, cof, strict=True))
            M, change = bmat([[K, B], [B.T, None]]).tocsr(), np.zeros_like(x)
            if n == 0:
                change[self.moved] = -strain * self.H - x[self.moved]
            change[self.free] = spsolve(M[self.free][:, self.free].tocsc(), -(f + M @ change)[self.free])
            x = x + change
        raise AssertionError(f"the reference has no equilibrium at {strain}")


def test_the_force_at_large_strains_is_that_of_another_discretisation():
    strains = np.array([0.06, 0.14])
    here = pressed_disc(load("neo_hookean")(mu=1.0), 1e5, 8.0, 4.0, strains).stress
    assert here == pytest.approx(Reference(4.0, 4.0, 6).stress(strains), rel=6e-3)  # the reference's own error is 0.5 %


@pytest.mark.campaign
@pytest.mark.parametrize("height", [2.0, 4.0, 8.0])
def test_forces_up_to_30_percent_strain_are_those_of_a_finer_reference(height):
    strains = np.array([0.1, 0.2, 0.3])[: 2 if height == 2.0 else 3]
    here = pressed_disc(load("neo_hookean")(mu=1.0), 1e5, 8.0, height, strains).stress
    assert here == pytest.approx(Reference(4.0, height, 16).stress(strains), rel=3e-3)


@pytest.mark.campaign
def test_the_side_that_lies_against_the_plate_carries_a_part_of_the_force():
    strains = np.array([0.1, 0.3])
    forces = pressed_disc(GEL, 1000 * GEL.mu, 8.0, 4.0, strains).stress
    disc = _Disc(4.0, 2.0, True, 1)
    u = disc.pressed(np.zeros(disc.body.n_dofs), 0.0, 0.3, GEL, 1000 * GEL.mu)
    touch = disc.side.touch(u, 0.3, GEL.mu)
    assert 0.01 < touch.total / (np.pi * 16) / forces[1] < 0.3
    above = disc.body.points()[1] + u[1::2] - 2.0 * 0.7
    assert above.max() < 2e-3 * 2.0


@pytest.mark.campaign
@pytest.mark.parametrize("material", [GEL, YEOH, load("ogden")(mu=1.0, alpha=-4.0)], ids=["ogden", "yeoh", "ogden-"])
@pytest.mark.parametrize(("height", "deepest"), [(8.0, 0.3), (4.0, 0.3), (2.0, 0.2), (0.8, 0.1)])
def test_elements_of_half_the_size_change_the_force_little(material, height, deepest):
    strains, kappa = np.array([deepest / 3, deepest]), 1000 * material.shear_modulus
    usual, finer = (pressed_disc(material, kappa, 8.0, height, strains, finer=n).stress for n in (1, 2))
    assert finer == pytest.approx(usual, rel=3e-3)


@pytest.mark.parametrize("material", [GEL, pytest.param(YEOH, marks=pytest.mark.campaign)], ids=["ogden", "yeoh"])
def test_sensitivities_are_central_differences(material):
    strains, name, ratio = np.array([0.07]), tuple(material.parameters)[1], 1000.0
    mu = material.shear_modulus
    exact = pressed_disc(material, ratio * mu, 8.0, 3.0, strains, (name, "bulk_ratio", "friction")).sensitivities
    step = 1e-4 * material.values[name]
    low, high = (
        pressed_disc(material.replace(**{name: material.values[name] + d}), ratio * mu, 8.0, 3.0, strains).stress
        for d in (-step, step)
    )
    assert exact[name] == pytest.approx((high - low) / (2 * step), rel=1e-4)
    low, high = (pressed_disc(material, (ratio + d) * mu, 8.0, 3.0, strains).stress for d in (-20.0, 20.0))
    assert exact["bulk_ratio"] == pytest.approx((high - low) / 40, rel=2e-3)
    assert not exact["friction"].any()


@pytest.mark.campaign
def test_a_disc_whose_elements_fold_says_so():
    with pytest.raises(NoStateError, match="no equilibrium of the bonded disc was found beyond"):
        pressed_disc(GEL, 1000 * GEL.mu, 8.0, 4.0, np.array([0.7]))


# ---- cases ----------------------------------------------------------------------------------------------------------

DISC = {"kind": "compression", "length": 3.0, "diameter": 8.0, "plates": "bonded", "strain": 0.06, "points": 3}


def case(test, model="ogden", parameters=None):
    choice = MaterialChoice(model=model, parameters=parameters or GEL.values)
    return Case(material=choice, tests=[Test("press", **test)])


def test_a_case_simulates_a_bonded_and_a_sliding_disc_in_mm_and_mN():
    strains, area = np.array([0.02, 0.04, 0.06]), np.pi * 16
    bonded = simulate(case(DISC)).tests[0]
    assert bonded.displacement == pytest.approx(3.0 * strains)
    exact = pressed_disc(GEL, 1000 * GEL.mu, 8.0, 3.0, strains).stress
    assert bonded.force == pytest.approx(area * exact, rel=1e-9)
    sliding = simulate(case({**DISC, "plates": "sliding"})).tests[0]
    known = HomogeneousState("uniaxial", "along", -1).solve(GEL, 1000 * GEL.mu, strains).stress
    assert sliding.force == pytest.approx(area * known, rel=1e-12)
    assert 1.5 < bonded.force[0] / sliding.force[0] < 6


@pytest.mark.quick
@pytest.mark.parametrize(
    ("changes", "wrong"),
    [
        ({"plates": None}, r"plates: missing; say whether the disc slides"),
        ({"diameter": None}, r"diameter: missing; give the diameter of the disc"),
        ({"length": None}, r"length: missing; give the height"),
        ({"area": 50.0}, r"area = 50.*follows from the diameter"),
        ({"loading": "tension"}, r"loading.*plates compress"),
        ({"strain": 1.2}, r"strain = 1.2: must be below 1"),
        ({"length": 20.0}, r"length = 20.*at most 2 diameters.*may buckle"),
        ({"angle": 0}, r"angle = 0.*does not belong to a compression between plates"),
        ({"kind": "shear", "length": None}, r"diameter.*does not belong to a shear test"),
    ],
)
def test_what_is_wrong_with_a_disc_is_said(changes, wrong):
    test = {key: value for key, value in {**DISC, **changes}.items() if value is not None}
    with pytest.raises(CaseError, match=wrong):
        case(test)


@pytest.mark.quick
@pytest.mark.parametrize("fibres", ["along", "across"])
def test_fibres_in_a_bonded_disc_are_refused(fibres):
    with pytest.raises(CaseError, match=r"fibres in a bonded disc are not solved.*give sliding plates"):
        case({**DISC, "fibres": fibres}, "transversely_isotropic", WHITE.values)
    assert case({**DISC, "fibres": fibres, "plates": "sliding"}, "transversely_isotropic", WHITE.values)
