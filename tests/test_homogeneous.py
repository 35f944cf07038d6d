"""Homogeneous states against closed forms, another code, and differences."""

import importlib
import sys
import types

import numpy as np
import pytest
from scipy.optimize import brentq

from indentfit.errors import NoStateError
from indentfit.material import HomogeneousState, load, typed

WHITE = {"mu": 1.49, "zeta": 4.68, "phi": 0.68}
STRAINS = np.array([0.02, 0.1, 0.2])


def white_matter():
    return load("transversely_isotropic")(**WHITE)


def cauchy(F, a0, kappa, mu, zeta, phi):
    """The Cauchy stress as the source paper's authors write it, by tensors."""
    J = np.linalg.det(F)
    Fb = J ** (-1 / 3) * F
    Cb = Fb.T @ Fb
    I4, aa = a0 @ Cb @ a0, np.outer(a0, a0)
    Sb = mu * (np.eye(3) + 2 * zeta * (I4 - 1) * aa + phi * (np.outer(a0, Cb @ a0) + np.outer(Cb @ a0, a0) - 2 * I4 * aa))
    tau = Fb @ Sb @ Fb.T
    return (tau - np.trace(tau) / 3 * np.eye(3)) / J + kappa * (J - 1) * np.eye(3)


def along_fibres(stretch, kappa):
    """Uniaxial Cauchy stress along the fibres, its lateral stretch by a scalar equation."""

    def stresses(lateral):
        return cauchy(np.diag([stretch, lateral, lateral]), np.array([1.0, 0, 0]), kappa, **WHITE)

    lateral = brentq(lambda q: stresses(q)[1, 1], 0.5 * stretch**-0.5, 1.5 * stretch**-0.5, xtol=1e-16, rtol=1e-15)
    return stresses(lateral)[0, 0]


def equibiaxial_across_the_plane(stretch, kappa):
    """Equibiaxial Cauchy stress, fibres normal to the plane."""

    def stresses(normal):
        return cauchy(np.diag([stretch, stretch, normal]), np.array([0, 0, 1.0]), kappa, **WHITE)

    normal = brentq(lambda q: stresses(q)[2, 2], 0.5 / stretch**2, 1.5 / stretch**2, xtol=1e-16, rtol=1e-15)
    return stresses(normal)[0, 0]


@pytest.mark.parametrize("sign", [1, -1])
def test_uniaxial_and_biaxial_stresses_are_those_of_scalar_equations(sign):
    kappa = 1000 * WHITE["mu"]
    for state, truth in (
        (HomogeneousState("uniaxial", "along", sign, cauchy=True), along_fibres),
        (HomogeneousState("biaxial", "normal", sign, cauchy=True), equibiaxial_across_the_plane),
    ):
        exact = [sign * truth(1 + sign * strain, kappa) for strain in STRAINS]
        assert state.solve(white_matter(), kappa, STRAINS).stress == pytest.approx(exact, rel=1e-8)


@pytest.mark.parametrize("bulk", [20.0, 1000.0])
def test_across_the_fibres_no_stress_acts_on_either_free_side(bulk):
    """Two unknown stretches: those of the state are read off the volume and checked by the tensors' formula."""
    kappa = bulk * WHITE["mu"]
    state = HomogeneousState("uniaxial", "across", cauchy=True)
    nominal = HomogeneousState("uniaxial", "across").solve(white_matter(), kappa, STRAINS).stress
    true = state.solve(white_matter(), kappa, STRAINS).stress
    for strain, P, s in zip(STRAINS, nominal, true, strict=True):
        area = P / s  # product of the free stretches
        a0 = np.array([0.0, 1.0, 0.0])

        def lateral(q, area=area, strain=strain, a0=a0):
            return cauchy(np.diag([1 + strain, q, area / q]), a0, kappa, **WHITE)

        q = brentq(lambda q: lateral(q)[1, 1] - lateral(q)[2, 2], 0.7, 1.2, xtol=1e-16, rtol=1e-15)
        assert lateral(q)[0, 0] == pytest.approx(s, rel=1e-8)
        assert abs(lateral(q)[1, 1]) < 1e-8 * s


def test_simple_shear_is_exact_at_any_bulk_modulus():
    g, (mu, zeta, phi) = STRAINS, WHITE.values()
    exact = {"along": mu * (1 + phi) * g, "across": mu * (1 + phi) * g + 2 * mu * zeta * g**3, "normal": mu * g}
    for kappa in (10.0, 1e5):
        for fibres, stress in exact.items():
            assert HomogeneousState("shear", fibres).solve(white_matter(), kappa, g).stress == pytest.approx(stress, rel=1e-12)


def test_published_one_element_output():
    """Abaqus C3D8H along the fibres, as the law's authors give it: at this low kappa the volume grows by up to 42 %."""
    stretch = np.array([1.01, 1.05, 1.10, 1.20, 1.30, 1.40, 1.50])
    material = load("transversely_isotropic")(mu=13, zeta=50, phi=1)
    stress = HomogeneousState("uniaxial", "along", cauchy=True).solve(material, 1000.0, stretch - 1).stress
    assert stress == pytest.approx([20.58, 106.0, 218.8, 460.9, 719.6, 990.7, 1272], rel=4e-4)


INCOMPRESSIBLE = 1e7  # bulk over shear modulus: at 2e5, compression changes the stresses of a law that stiffens by 1e-4
LAWS = {  # law -> our values, the parts that pymecht adds up, and its values
    "mooney_rivlin": ({"c10": 0.5, "c01": 0.2}, ("mr",), {"c1_0": 0.5, "c2_0": 0.2}),
    "gent": ({"mu": 1.3, "Jm": 5.0}, ("Gent",), {"mu_0": 1.3, "Jm_0": 5.0}),
    "yeoh": ({"c10": 0.5, "c20": -0.1, "c30": 0.7}, ("yeoh",), {"c1_0": 0.5, "c2_0": -0.1, "c3_0": 0.7, "c4_0": 0.0}),
    "transversely_isotropic": (WHITE | {"phi": 0.0}, ("nh", "polyI4"), {"mu_0": 1.49, "d1_1": 0, "d2_1": 1.49 * 2.34, "d3_1": 0}),
    "holzapfel": (
        {"c": 1.2, "k1": 3.0, "k2": 4.0, "dispersion": 0.1},
        ("nh", "GOH"),
        {"mu_0": 1.2, "k1_1": 3.0, "k2_1": 4.0, "k3_1": 0.1},
    ),
}


@pytest.fixture
def pymecht(monkeypatch):
    """pymecht (MIT), as `pip install --no-deps pymecht` gives it: the two packages that only its random sampling needs, one of them
    with CUDA, stand in `sys.modules` without content where they are missing."""
    for name, word in (("torch", ""), ("torch.quasirandom", "SobolEngine"), ("pyDOE", "lhs")):
        try:
            importlib.import_module(name)
        except ImportError:
            monkeypatch.setitem(sys.modules, name, types.SimpleNamespace(**{word: None} if word else {}))
    return pytest.importorskip("pymecht")


def their_law(pymecht, name, axis):
    _, parts, values = LAWS[name]
    model = pymecht.MatModel(*(getattr(pymecht, part)() if part in ("Gent", "GOH") else part for part in parts))
    for part in model.models[1:]:
        part.fiber_dirs = [np.eye(3)[axis]]
    return model, values


@pytest.mark.parametrize("name", LAWS)
def test_pymecht_has_the_same_stresses(name, pymecht):
    """Nominal stresses of pymecht, which is exactly incompressible. The largest difference seen was 2.3e-6 (1.1.3)."""
    material = load(name)(**LAWS[name][0])
    model, values = their_law(pymecht, name, 0)
    for kind, sample in (("uniaxial", pymecht.UniaxialExtension), ("biaxial", pymecht.PlanarBiaxialExtension)):
        experiment = sample(model, "stretch", "1pk")
        known = experiment.parameters
        for key, value in values.items():
            known.set(key, value)
        for sign in (1, -1):
            ours = HomogeneousState(kind, "along", sign).solve(material, INCOMPRESSIBLE * material.shear_modulus, STRAINS).stress
            stretch = 1 + sign * STRAINS
            answers = experiment.disp_controlled(stretch if kind == "uniaxial" else np.column_stack([stretch, stretch]), known)
            assert sign * ours == pytest.approx([np.ravel(answer)[0] for answer in answers], rel=1e-4)


@pytest.mark.parametrize("name", LAWS)
def test_pymecht_has_the_same_shear(name, pymecht):
    """Simple shear keeps the volume, so that the stress is that of pymecht's deformation gradient at any bulk modulus."""
    material = load(name)(**LAWS[name][0])
    shears = [np.eye(3) + g * np.outer([1, 0, 0], [0, 1, 0]) for g in STRAINS]
    for axis, fibres in enumerate(("along", "across", "normal")):
        model, values = their_law(pymecht, name, axis)
        known = model.parameters
        for key, value in values.items():
            known.set(key, value)
        ours = HomogeneousState("shear", fibres).solve(material, INCOMPRESSIBLE * material.shear_modulus, STRAINS).stress
        assert ours == pytest.approx([model.stress(F, known, "1pk")[0, 1] for F in shears], rel=1e-8)


STATES = [
    HomogeneousState("uniaxial", "along"),
    HomogeneousState("uniaxial", "across", -1, cauchy=True),
    HomogeneousState("biaxial", "along", 1, 0.0, True),
    HomogeneousState("biaxial", "across", 1, 0.5),
    HomogeneousState("shear", "across"),
]


@pytest.mark.parametrize("state", STATES, ids=[f"{state.kind} {state.fibres}" for state in STATES])
def test_sensitivities_are_central_differences(state):
    material, ratio, h = white_matter(), 50.0, 1e-5
    size = np.abs(state.solve(material, ratio * material.shear_modulus, STRAINS).stress)
    given = state.solve(material, ratio * material.shear_modulus, STRAINS, (*WHITE, "bulk_ratio", "friction", "offset"))

    def at(name, change):
        ratio_there = ratio * (1 + change) if name == "bulk_ratio" else ratio
        there = material if name == "bulk_ratio" else material.replace(**{name: WHITE[name] * (1 + change)})
        return state.solve(there, ratio_there * there.shear_modulus, STRAINS).stress

    for name in (*WHITE, "bulk_ratio"):
        difference = (at(name, h) - at(name, -h)) / (2 * h)  # by the relative change of the name
        value = ratio if name == "bulk_ratio" else WHITE[name]
        assert np.abs(value * given.sensitivities[name] - difference).max() < 1e-6 * size.max(), name
    assert not given.sensitivities["friction"].any()
    assert not given.sensitivities["offset"].any()


def test_typed_laws_of_principal_stretches_have_states():
    ogden = typed("2*mu/a**2*(l1**a + l2**a + l3**a - 3)", ["mu", "a"])(mu=1.0, a=4.0)
    kappa = 1e5
    stress = HomogeneousState("uniaxial", cauchy=True).solve(ogden, kappa, STRAINS).stress
    stretch = 1 + STRAINS
    assert stress == pytest.approx(2 / 4 * (stretch**4 - stretch**-2), rel=1e-3)  # incompressible closed form


def test_a_law_that_locks_before_the_strain_says_so():
    gent = load("gent")
    material = gent(**dict(zip(gent.parameters, (1.0, 0.05), strict=True)))
    with pytest.raises(NoStateError, match=r"at a stretch of 1\.5 the law has no stable state"):
        HomogeneousState("uniaxial").solve(material, 1000.0, np.array([0.1, 0.5]))
