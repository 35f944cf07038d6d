"""Families of fibres that differ, parameters that they share, and fibres that spread in a plane and out of it."""

import pickle

import numpy as np
import pytest
from fixtures.cases import tiny_case
from numpy.testing import assert_allclose

from indentfit.errors import CaseError, MaterialError
from indentfit.experiment.measured import read_case
from indentfit.material import HomogeneousState, check, exchangeable, invariants, isochoric_stress, load, sharing
from indentfit.material.trials import trial_states
from indentfit.report.case_text import case_lines
from indentfit.runs.key import Inputs

HARD = 1e6  # bulk over shear modulus: closed forms are those of a constant volume
OWN = load("holzapfel_own_families")(
    c=1.0, k1=3.0, k2=2.0, dispersion=0.1, k1_second=5.0, k2_second=0.7, dispersion_second=0.05
)  # fmt: skip
PAPER = load("two_own_families")(mu=1.49, zeta=4.68, phi=0.68, zeta_second=2.0, phi_second=1.5)
SPREAD = load("holzapfel_spread")(c=1.0, k1=3.0, k2=1.5, in_plane=0.2, out_of_plane=0.42)


def solved(material, kind, families, strain, ratio=1.0):
    state = HomogeneousState(kind, "along", 1, ratio, True, families)
    return state.solve(material, HARD * material.shear_modulus, np.array([strain])).stress[0]


def states(perpendicular=True):
    rng = np.random.default_rng(5)
    F, a0 = trial_states(rng, 5)
    other = np.cross(a0, rng.standard_normal(a0.shape), axis=0)
    b0 = other / np.linalg.norm(other, axis=0)
    return F, np.stack([a0, b0 if perpendicular else (a0 + b0) / np.linalg.norm(a0 + b0, axis=0)])


@pytest.mark.quick
@pytest.mark.parametrize("name", ["holzapfel_own_families", "two_own_families", "holzapfel_spread"])
def test_the_laws_conform(name):
    assert [(known.name, known.detail) for known in check(load(name)) if not known.ok] == []


@pytest.mark.quick
def test_biaxial_stress_of_families_that_differ_is_the_closed_form():
    l1, l2 = 1.15, 1.06
    l3, c, d = 1 / (l1 * l2), 1.0, (0.1, 0.05)
    E = [d[n] * (l1**2 + l2**2 + l3**2 - 3) + (1 - 3 * d[n]) * (l - 1) for n, l in enumerate((l1**2, l2**2))]
    slope = [3.0 * E[0] * np.exp(2.0 * E[0] ** 2), 5.0 * E[1] * np.exp(0.7 * E[1] ** 2)]
    by_I1 = c / 2 + d[0] * slope[0] + d[1] * slope[1]
    expected = 2 * by_I1 * (l1**2 - l3**2) + 2 * (1 - 3 * d[0]) * slope[0] * l1**2
    assert solved(OWN, "biaxial", (0.0, 90.0), l1 - 1, (l2 - 1) / (l1 - 1)) == pytest.approx(expected, rel=1e-4)
    swapped = type(OWN)(c=1.0, k1=5.0, k2=0.7, dispersion=0.05, k1_second=3.0, k2_second=2.0, dispersion_second=0.1)
    F, fibres = states(perpendicular=False)
    assert_allclose(isochoric_stress(swapped, F, fibres[::-1]), isochoric_stress(OWN, F, fibres), rtol=1e-12, atol=1e-12)


@pytest.mark.quick
def test_shear_of_the_papers_law_with_families_that_differ_is_the_closed_form():
    g = 0.2  # fibres along 1 and along 2: mu (1 + phi) g of the first, mu phi g + 2 mu zeta g^3 of the second
    mu, _, phi, zeta_second, phi_second = PAPER.values.values()
    expected = mu * (1 + phi + phi_second) * g + 2 * mu * zeta_second * g**3
    assert solved(PAPER, "shear", (0.0, 90.0), g) == pytest.approx(expected, rel=1e-8)


@pytest.mark.quick
def test_spread_fibres_have_the_energy_of_their_structure_tensor():
    F, fibres = states()
    p, s = 0.2, 0.42
    for n in range(F.shape[-1]):
        (a, b), C = fibres[..., n], F[..., n].T @ F[..., n] * np.linalg.det(F[..., n]) ** (-2 / 3)
        normal = np.cross(a, b)
        H = 2 * s * (1 - p) * np.outer(a, a) + 2 * s * p * np.outer(b, b) + (1 - 2 * s) * np.outer(normal, normal)
        E = max(np.sum(H * C) - 1, 0.0)
        expected = (np.trace(C) - 3) / 2 + 3.0 / 3.0 * (np.exp(1.5 * E**2) - 1)
        assert SPREAD.psi(invariants(F[..., n], fibres[..., n])) == pytest.approx(expected, rel=1e-12)


@pytest.mark.quick
def test_the_structure_tensor_is_the_mean_over_a_density_of_directions():
    """In the plane a density exp(b cos 2 angle) has p = (1 - I1(b)/I0(b)) / 2, the von Mises distribution of the source."""
    b, angle = 0.9, np.linspace(0, 2 * np.pi, 2001)[:-1]
    density = np.exp(b * np.cos(2 * angle))
    p = float(np.sum(density * np.sin(angle) ** 2) / np.sum(density))
    i0, i1 = (np.mean(np.exp(b * np.cos(angle)) * np.cos(n * angle)) for n in (0, 1))
    assert p == pytest.approx((1 - i1 / i0) / 2, rel=1e-12)
    planar, l = SPREAD.replace(in_plane=p, out_of_plane=0.5), 1.2
    along = np.sum(density * (l**2 * np.cos(angle) ** 2 + np.sin(angle) ** 2 / l - 1)) / np.sum(density)  # mean of I4 - 1
    F = np.diag([l, l**-0.5, l**-0.5])
    energy = (l**2 + 2 / l - 3) / 2 + 3.0 / 3.0 * (np.exp(1.5 * along**2) - 1)
    assert planar.psi(invariants(F, np.eye(3)[:2])) == pytest.approx(energy, rel=1e-10)


@pytest.mark.quick
@pytest.mark.parametrize("d", [0.0, 0.15, 1 / 3])
def test_an_even_spread_round_the_mean_direction_is_holzapfels_dispersion(d):
    spread = SPREAD.replace(out_of_plane=(1 - d) / 2, in_plane=d / (1 - d))
    even = load("holzapfel")(c=1.0, k1=3.0, k2=1.5, dispersion=d)
    F, fibres = states()
    assert_allclose(isochoric_stress(spread, F, fibres), isochoric_stress(even, F, fibres[0]), rtol=1e-9, atol=1e-9)


# ---- shared parameters ----------------------------------------------------------------------------------------------

LAW = type(OWN)


@pytest.mark.quick
def test_a_shared_parameter_is_that_of_the_first_family():
    law = sharing(LAW, ("k2_second", "dispersion_second"))
    assert list(law.parameters) == ["c", "k1", "k2", "dispersion", "k1_second"]
    shared = law(c=1.0, k1=3.0, k2=2.0, dispersion=0.1, k1_second=5.0)
    F, fibres = states(perpendicular=False)
    plain = OWN.replace(k2_second=2.0, dispersion_second=0.1)
    assert_allclose(isochoric_stress(shared, F, fibres), isochoric_stress(plain, F, fibres), rtol=1e-13)
    I = invariants(F, fibres)
    together = plain.parameter_gradient(I)
    assert_allclose(shared.parameter_gradient(I)[2], together[2] + together[5], rtol=1e-9, atol=1e-12)  # both feel k2
    assert pickle.loads(pickle.dumps(shared)) == shared and sharing(law, ()) is law
    assert all(known.ok for known in check(law))


@pytest.mark.quick
def test_families_that_share_everything_are_alike_and_have_the_law_of_like_families():
    law = sharing(LAW, ("k1_second", "k2_second", "dispersion_second"))
    assert exchangeable(law, ()) and not exchangeable(LAW, ())
    assert exchangeable(LAW, (("k1", 1.0), ("k1_second", 1.0), ("k2", 2.0), ("k2_second", 2.0), ("dispersion", 0.1),
                              ("dispersion_second", 0.1)))  # fmt: skip
    F, fibres = states(perpendicular=False)
    like = load("holzapfel_two_families")(c=1.0, k1=3.0, k2=2.0, dispersion=0.1)
    assert_allclose(isochoric_stress(law(**like.values), F, fibres), isochoric_stress(like, F, fibres), rtol=1e-12)


@pytest.mark.quick
def test_what_cannot_be_shared_is_refused():
    with pytest.raises(MaterialError, match=r"'k2' is no parameter that two families can share; those of HolzapfelOwn.*k2_second"):
        sharing(LAW, ("k2",))
    with pytest.raises(MaterialError, match="Holzapfel has none"):
        sharing(load("holzapfel"), ("k1_second",))


def case(folder, shared=("k2_second", "dispersion_second"), overrides=(), **more):
    parameters = {**{name: value for name, value in OWN.values.items() if name not in shared}, **more}
    material = {"model": "holzapfel_own_families", "parameters": parameters, **({"shared": list(shared)} if shared else {})}
    tests = [{"name": "press", "angle": 0, "depth": 0.2, "points": 3}]
    return read_case(tiny_case(folder, test=tests, material=material), ["sample.families=[40,-40]", *overrides])


@pytest.mark.quick
def test_a_case_shares_parameters_and_says_so(tmp_path):
    known = case(tmp_path)
    assert list(known.law.parameters) == ["c", "k1", "k2", "dispersion", "k1_second"]
    assert any("k2_second" in line and "shared: that of the first family" in line for line in case_lines(known))
    other = case(tmp_path, ("k2_second",))
    assert Inputs(known).origin != Inputs(other).origin  # no stored run answers for another law


@pytest.mark.quick
@pytest.mark.parametrize(
    ("shared", "more", "text"),
    [
        (("k2_second",), {"k2_second": 3.0}, r"parameters\.k2_second.*the families share it .*; remove one of the two"),
        (("k3_second",), {}, r"material\.shared.*'k3_second' is no parameter that two families can share"),
        ((), {"k2_second": "shared"}, r"parameters\.k2_second"),
    ],
)
def test_what_is_wrong_with_shared_parameters_is_said_in_one_line(tmp_path, shared, more, text):
    with pytest.raises(CaseError, match=text) as caught:
        case(tmp_path, shared, **more)
    assert len(str(caught.value).splitlines()) == 1
