"""Isotropic laws that people use, against the closed forms of their textbooks: incompressible, Cauchy stresses in kPa."""

from pathlib import Path

import numpy as np
import pytest

from indentfit import read_case
from indentfit.case.laws import isotropic_moduli
from indentfit.errors import MaterialError
from indentfit.material import check, isochoric_stress, load, typed

pytestmark = pytest.mark.quick

LAWS = {
    "ogden": {"mu": 1.3, "alpha": -3.7},
    "ogden2": {"mu1": 0.9, "alpha1": 8.0, "mu2": -0.2, "alpha2": -2.5},
    "ogden3": {"mu1": 0.9, "alpha1": 1.3, "mu2": 0.4, "alpha2": 5.0, "mu3": 0.1, "alpha3": -2.0},
    "yeoh": {"c10": 0.8, "c20": -0.1, "c30": 0.05},
    "gent": {"mu": 1.3, "Jm": 8.0},
    "demiray_fung": {"mu": 1.3, "b": 2.1},
    "arruda_boyce": {"mu": 1.3, "lambda_m": 1.7},
    "polynomial": {"c10": 0.5, "c01": 0.2, "c20": 0.1, "c11": -0.03, "c02": 0.07},
}
SHEAR_MODULUS = {
    "ogden": lambda v: v["mu"],
    "ogden2": lambda v: v["mu1"] + v["mu2"],
    "ogden3": lambda v: v["mu1"] + v["mu2"] + v["mu3"],
    "yeoh": lambda v: 2 * v["c10"],
    "gent": lambda v: v["mu"],
    "demiray_fung": lambda v: v["mu"],
    "arruda_boyce": lambda v: v["mu"] * (
        1 + 3 / (5 * v["lambda_m"] ** 2) + 99 / (175 * v["lambda_m"] ** 4) + 513 / (875 * v["lambda_m"] ** 6)
        + 42039 / (67375 * v["lambda_m"] ** 8)
    ),
    "polynomial": lambda v: 2 * (v["c10"] + v["c01"]),
}  # fmt: skip


def slopes(name, v, I1, I2):
    """dpsi/dI1 and dpsi/dI2 by hand."""
    x, y = I1 - 3, I2 - 3
    match name:
        case "yeoh":
            return v["c10"] + 2 * v["c20"] * x + 3 * v["c30"] * x**2, 0.0
        case "gent":
            return v["mu"] / 2 * v["Jm"] / (v["Jm"] - x), 0.0
        case "demiray_fung":
            return v["mu"] / 2 * np.exp(v["b"] * x), 0.0
        case "arruda_boyce":
            L = v["lambda_m"] ** 2
            terms = (1 / 2, I1 / (10 * L), 11 * I1**2 / (350 * L**2), 19 * I1**3 / (1750 * L**3), 519 * I1**4 / (134750 * L**4))
            return v["mu"] * sum(terms), 0.0
        case "polynomial":
            return v["c10"] + 2 * v["c20"] * x + v["c11"] * y, v["c01"] + v["c11"] * x + 2 * v["c02"] * y


def terms(v):
    """(mu, alpha) of each term of an Ogden law."""
    return [(v[f"mu{i}"], v[f"alpha{i}"]) for i in ("", 1, 2, 3) if f"mu{i}" in v]


def uniaxial(name, v, l):
    if name.startswith("ogden"):
        return sum(2 * mu / a * (l**a - l ** (-a / 2)) for mu, a in terms(v))
    first, second = slopes(name, v, l**2 + 2 / l, 2 * l + 1 / l**2)
    return 2 * (l**2 - 1 / l) * (first + second / l)


def equibiaxial(name, v, l):
    if name.startswith("ogden"):
        return sum(2 * mu / a * (l**a - l ** (-2 * a)) for mu, a in terms(v))
    first, second = slopes(name, v, 2 * l**2 + l**-4, l**4 + 2 / l**2)
    return 2 * (l**2 - l**-4) * (first + l**2 * second)


def simple_shear(name, v, g):
    if name.startswith("ogden"):  # stretches l, 1 and 1/l with g = l - 1/l
        l = g / 2 + np.sqrt(1 + g**2 / 4)
        return sum(2 * mu / a * (l**a - l**-a) / (l + 1 / l) for mu, a in terms(v))
    return 2 * g * sum(slopes(name, v, 3 + g**2, 3 + g**2))


def cauchy(material, F):
    a0 = np.array([0.6, 0.0, 0.8])
    return isochoric_stress(material, F, a0) @ F.T


FORMS = pytest.mark.parametrize("form", ["plugin", "typed"])
TYPED = {
    "ogden": "2*mu/alpha^2*(l1^alpha+l2^alpha+l3^alpha-3)",
    "yeoh": "c10*(I1-3)+c20*(I1-3)^2+c30*(I1-3)^3",
    "gent": "-mu*Jm/2*log(1-(I1-3)/Jm)",
    "demiray_fung": "mu/(2*b)*(exp(b*(I1-3))-1)",
    "polynomial": "c10*(I1-3)+c01*(I2-3)+c20*(I1-3)^2+c11*(I1-3)*(I2-3)+c02*(I2-3)^2",
}


@pytest.fixture(params=LAWS)
def law(request):
    return request.param, LAWS[request.param], load(request.param)(**LAWS[request.param])


def test_uniaxial_and_equibiaxial_stress(law):
    name, values, material = law
    for l in (0.6, 0.9, 1 - 1e-7, 1 + 1e-4, 1.1, 1.4):
        small = {"abs": 1e-14 / abs(l - 1) if abs(l - 1) < 1e-3 else 0}  # the stress of a strain e cannot be better than eps / e
        for F, form in ((np.diag([l, l**-0.5, l**-0.5]), uniaxial), (np.diag([l, l, l**-2]), equibiaxial)):
            s = cauchy(material, F)
            right = form(name, values, l)
            assert s[0, 0] - s[2, 2] == pytest.approx(right, rel=1e-11 + small["abs"])
            np.testing.assert_allclose(s - np.diag(np.diag(s)), 0, atol=1e-14)


def test_shear_stress(law):
    name, values, material = law
    for g in (1e-5, 0.01, 0.3, 1.0):
        F = np.eye(3)
        F[0, 1] = g
        assert cauchy(material, F)[0, 1] == pytest.approx(simple_shear(name, values, g), rel=1e-10)


def test_moduli_at_rest(law):
    name, values, material = law
    mu = SHEAR_MODULUS[name](values)
    assert material.shear_modulus == pytest.approx(mu, rel=1e-13)
    expected = {"mu_across": mu, "mu_along": mu, "E_along": 3 * mu, "E_across": 3 * mu}
    assert material.moduli() == pytest.approx(expected, rel=1e-13)


def test_the_conformance_kit_accepts_the_law(law):
    assert [row for row in check(type(law[2])) if not row.ok] == []


@pytest.mark.parametrize("name", TYPED)
def test_a_typed_law_is_the_plugin_to_round_off(name):
    values = LAWS[name]
    plugin, written = load(name)(**values), typed(TYPED[name], list(values))(**values)
    rng = np.random.default_rng(0)
    F = np.eye(3)[..., None] + 0.15 * rng.standard_normal((3, 3, 200))
    a0 = np.array([1.0, 0, 0])[:, None] + np.zeros(200)
    s, t = (isochoric_stress(m, F, a0) for m in (plugin, written))
    np.testing.assert_allclose(s, t, rtol=0, atol=1e-13 * np.abs(s).max())


def test_ogden_of_exponent_2_is_neo_hookean_and_a_half_and_half_is_mooney_rivlin():
    neo, ogden = load("neo_hookean")(mu=1.3), load("ogden")(mu=1.3, alpha=2.0)
    mooney, two = load("mooney_rivlin")(c10=0.4, c01=0.3), load("ogden2")(mu1=0.8, alpha1=2.0, mu2=0.6, alpha2=-2.0)
    rng = np.random.default_rng(0)
    F = np.eye(3) + 0.2 * rng.standard_normal((3, 3))
    for a, b in ((neo, ogden), (mooney, two)):
        np.testing.assert_allclose(cauchy(a, F), cauchy(b, F), rtol=1e-12, atol=1e-13)


def test_arruda_boyce_follows_the_inverse_langevin_function_to_half_of_its_locking_stretch():
    """Stress mu / 3 lambda_m L^-1(l / lambda_m) / l (b - I1 / 3), the exact chain."""
    material = load("arruda_boyce")(mu=1.0, lambda_m=3.0)

    def inverse_langevin(y):
        low, high = 1e-9, 50.0
        for _ in range(200):
            x = (low + high) / 2
            low, high = (x, high) if 1 / np.tanh(x) - 1 / x < y else (low, x)
        return x

    for l in (1.2, 1.8):
        chain = np.sqrt((l**2 + 2 / l) / 3)
        exact = 3.0 / 3 * inverse_langevin(chain / 3.0) / chain * (l**2 - 1 / l)
        s = cauchy(material, np.diag([l, l**-0.5, l**-0.5]))
        assert s[0, 0] - s[1, 1] == pytest.approx(exact, rel=2e-3)


def test_gent_has_no_stress_beyond_its_locking_stretch():
    """The derivative of log(x) goes on at x < 0, where it would be a stress of the wrong sign."""
    for law in (load("gent"), typed(TYPED["gent"], ["mu", "Jm"])):
        material = law(mu=1.0, Jm=0.5)
        inside, beyond = np.array([3.4, 3.3, 1, 1]), np.array([3.6, 3.4, 1, 1])
        assert np.isfinite(material.gradient(inside)).all() and np.isfinite(material.hessian(inside)).all()
        assert np.isnan(material.gradient(beyond)).all() and np.isnan(material.hessian(beyond)).all()
        assert np.isnan(material.parameter_gradient(beyond)).all()


@pytest.mark.parametrize(
    ("energy", "says"),
    [
        ("m*l1^2", "not symmetric in l1, l2, l3"),
        ("m*(l1^2 + l2^2)", "not symmetric"),
        ("m*(l1^2 + l2^2 + 2*l3^2)", "not symmetric"),
        ("m*(positive(l1-1)^2 + positive(l2-1)^2 + positive(l3-1)^2)", "switches"),
        ("m*(l1^I1 + l2^I1 + l3^I1)", "joins a principal stretch and an invariant"),
        ("m*(exp(exp(exp(exp(l1)))) + l2 + l3)", "not symmetric"),
        ("m*(l1 + l2)*(l2 + l3)*(l3 + l1)", "not symmetric"),
        ("m*(l4 - 1)", "known: I1, I2, I4, I5, I6, I7, I8, l1, l2, l3, m"),
    ],
)
def test_an_energy_that_cannot_be_used_is_refused_with_the_reason(energy, says):
    with pytest.raises(MaterialError, match=says):
        typed(energy, ["m"])


def test_a_parameter_cannot_be_called_like_a_stretch():
    with pytest.raises(MaterialError, match="'l1': that name has a meaning already"):
        typed("l1*(I1 - 3)", ["l1"])


def test_the_shear_modulus_has_a_name_of_its_own_where_the_law_has_another_mu():
    """Arruda and Boyce 1993: G = mu (1 + 3 / (5 L^2) + 99 / (175 L^4) + ...), L = lambda_m; a list that has two values
    for mu says nothing."""
    case = read_case(
        Path(__file__).parent.parent / "cases" / "hydrogel_sphere" / "case.toml",
        ["material={model='arruda_boyce',poisson_ratio=0.5,parameters={mu=20,lambda_m=2}}"],
    )
    moduli = isotropic_moduli(case.material, case.law, case.start_values())
    series = 1 + 3 / (5 * 4) + 99 / (175 * 16) + 513 / (875 * 64) + 42039 / (67375 * 256)
    assert moduli == pytest.approx({"G": 20 * series, "E": 60 * series, "nu": 0.5}, rel=1e-4)
