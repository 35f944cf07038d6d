"""Sums over principal stretches: derivatives by I1 and I2 against partial fractions in 220 digits, by C against closed forms."""

import mpmath
import numpy as np
import pytest

from indentfit.material import invariant_gradients, invariants, load, typed
from indentfit.material.series import Power, Series
from indentfit.material.series import exponential as exp
from indentfit.material.series import hyperbolic_cosine as cosh
from indentfit.material.series import hyperbolic_sine as sinh
from indentfit.material.series import hyperbolic_tangent as tanh
from indentfit.material.series import logarithm as log
from indentfit.material.stretches import sums

pytestmark = pytest.mark.quick

GAPS = [0, 1e-14, 1e-10, 1e-8, 1e-6, 1e-4, 1e-3, 0.01, 0.03, 0.06, 0.1, 0.13, 0.2, 0.3, 0.5, 0.7, 1.0]


def states():
    """Squares of stretches in 220 digits, each gap between two stretches at four stretches; a third in between or far away.

    Gaps of 1e-25 stand for none: partial fractions need some."""
    rng, rows = np.random.default_rng(0), []
    for gap in GAPS:
        for l in (0.7, 1.0, 1.05, 1.3):
            for third in (None, rng.uniform(0.1, 0.9)):
                a = mpmath.mpf(l)
                b = a + mpmath.mpf(gap) + mpmath.mpf(10) ** -25
                c = 1 / (a * b) if third is None else a + mpmath.mpf(gap) * third + mpmath.mpf(10) ** -24
                J = mpmath.cbrt(a * b * c)
                rows.append([(x / J) ** 2 for x in (a, b, c)])
    return rows


def partial_fractions(z, g, slope):
    """First and second derivatives of sum f(z) by I1 and I2, g = f', from the residues at three different z."""

    def single(k):
        return sum(x**k * g(x) / mpmath.fprod(x - y for y in z if y is not x) for x in z)

    def double(k):
        total = mpmath.mpf(0)
        for x in z:
            q, r = (operation(x - y for y in z if y is not x) for operation in (mpmath.fprod, mpmath.fsum))
            total += (k * x ** (k - 1) * g(x) + x**k * slope(x)) / q**2 - 2 * x**k * g(x) * r / q**3
        return total

    return np.array([float(v) for v in (single(2), -single(1), double(4), -double(3), double(2))])


@pytest.mark.parametrize("alpha", [8.0, -8.0, 1.3, -0.5, 0.1, 20.0, -20.0, 30.0])
def test_derivatives_of_a_sum_of_powers_for_gaps_from_0_to_1(alpha):
    with mpmath.workdps(220):
        p, z = mpmath.mpf(alpha) / 2, states()
        right = np.array([partial_fractions(x, lambda s: p * s ** (p - 1), lambda s: p * (p - 1) * s ** (p - 2)) for x in z]).T
        value = np.array([float(sum(s**p for s in x)) for x in z])
        I1 = np.array([float(sum(x)) for x in z])
        I2 = np.array([float(x[0] * x[1] + x[1] * x[2] + x[2] * x[0]) for x in z])
    S = sums([lambda l: l**alpha], I1, I2, 2)[0]
    np.testing.assert_allclose(S[0], value, rtol=1e-13 * max(1, abs(alpha)))
    assert np.all(np.abs(S[1:3] - right[:2]) < 1e-10 * np.abs(right[:2]).max(axis=0))
    assert np.all(np.abs(S[3:] - right[2:]) < 1e-8 * np.abs(right[2:]).max(axis=0))
    assert np.array_equal(sums([lambda l: l**alpha], I1, I2, 1)[0], S[:3])


@pytest.mark.parametrize("alpha", [8.0, -5.0, 1.3])
def test_stress_and_tangent_by_C_are_those_of_the_principal_axes_for_gaps_from_0_to_1(alpha):
    """T_i = dW/dx_i in principal axes, and T_i, T_ij and (T_i - T_j) / (x_i - x_j) of the squares x, to 40 digits."""
    material = load("ogden")(mu=1.3, alpha=alpha)
    worst_stress = worst_tangent = 0.0
    for gap in GAPS:
        for third in (0.0, 0.4, 2.0):
            with mpmath.workdps(60):
                a = mpmath.mpf("0.93")
                l = [a, a + mpmath.mpf(gap) + mpmath.mpf(10) ** -25, a + mpmath.mpf(gap) * third + 2 * mpmath.mpf(10) ** -25]
                J = mpmath.cbrt(mpmath.fprod(l))
                x = [(s / J) ** 2 for s in l]
                exact_stress, exact_tangent = by_principal_axes(x, mpmath.mpf("1.3"), mpmath.mpf(alpha))
                F = np.diag([float(mpmath.sqrt(s)) for s in x])
            stress, tangent = by_C(material, F)
            worst_stress = max(worst_stress, np.abs(stress - exact_stress).max() / max(np.abs(exact_stress).max(), 1e-2 * 1.3))
            worst_tangent = max(worst_tangent, np.abs(tangent - exact_tangent).max() / np.abs(exact_tangent).max())
    assert worst_stress < 1e-11
    assert worst_tangent < 1e-8


def by_principal_axes(x, mu, alpha):
    """dpsi/dC, diagonal (3,), and d2psi/dC dC: normal (3, 3) and of each shear (3,), psi of x_i / (x1 x2 x3)^(1/3)."""
    c, n = 2 * mu / alpha**2, alpha / 2
    f = [c * (s / mpmath.cbrt(mpmath.fprod(x))) ** n for s in x]
    mean = sum(f) / 3
    T = [n * (f[i] - mean) / x[i] for i in range(3)]

    def second(i, j):
        share = [n * ((1 if i == k else 0) - mpmath.mpf(1) / 3) for k in range(3)]
        change = share[j] * f[j] - sum(share[k] * f[k] for k in range(3)) / 3  # x_i d/dx_i of f_j - mean
        return n * change / (x[i] * x[j]) - (T[i] / x[i] if i == j else 0)

    normal = np.array([[float(second(i, j)) for j in range(3)] for i in range(3)])
    shears = [(T[i] - T[j]) / (x[i] - x[j]) for i, j in ((0, 1), (1, 2), (0, 2))]
    return np.array([float(t) for t in T]), np.array([*normal.ravel(), *(float(s) for s in shears)])


def by_C(material, F):
    """The same from the material's gradient and Hessian by the invariants, at a diagonal F."""
    C, a0 = F @ F, np.array([1.0, 0, 0])
    I = invariants(F, a0)
    g, H = material.gradient(I), material.hessian(I)
    J23 = np.linalg.det(C) ** (-1 / 3)
    inverse = np.linalg.inv(C)
    one = np.eye(3)
    i1, i2 = np.trace(C), (np.trace(C) ** 2 - np.trace(C @ C)) / 2
    first = [J23 * (one - i1 / 3 * inverse), J23**2 * (i1 * one - C - 2 * i2 / 3 * inverse)]
    both = np.einsum("ij,kl->ijkl", one, one)
    symmetric = (np.einsum("ik,jl->ijkl", one, one) + np.einsum("il,jk->ijkl", one, one)) / 2
    turned = (np.einsum("ik,jl->ijkl", inverse, inverse) + np.einsum("il,jk->ijkl", inverse, inverse)) / 2

    def of(power, i, di, ddi):
        """d2 (det C^-power i) / dC dC."""
        s = np.linalg.det(C) ** -power
        cross = np.einsum("ij,kl->ijkl", di, inverse)
        return s * (
            ddi
            - power * (cross + np.einsum("ijkl->klij", cross))
            + i * (power**2 * np.einsum("ij,kl->ijkl", inverse, inverse) + power * turned)
        )

    second = [of(1 / 3, i1, one, 0), of(2 / 3, i2, i1 * one - C, both - symmetric)]
    stress = g[0] * first[0] + g[1] * first[1]
    tangent = g[0] * second[0] + g[1] * second[1]
    for a in range(2):
        for b in range(2):
            tangent = tangent + H[a, b] * np.einsum("ij,kl->ijkl", first[a], first[b])
    shears = [2 * tangent[i, j, i, j] for i, j in ((0, 1), (1, 2), (0, 2))]
    return np.diag(stress), np.array([*np.einsum("iijj->ij", tangent).ravel(), *shears])


def test_derivatives_by_parameters_are_finite_and_exact_at_rest_and_beside_it():
    law = load("ogden")
    for scale in (0.0, 1e-9, 1e-5, 1e-2, 0.3):
        F = np.eye(3) + scale * np.array([[0.3, 0.2, 0.0], [-0.1, 0.1, 0.4], [0.2, 0.0, -0.3]])
        I, material = invariants(F, np.array([1.0, 0, 0])), law(mu=1.3, alpha=-3.3)
        exact = material.parameter_gradient(I)
        h = 1e-3
        near, far = (law(mu=1.3, alpha=-3.3 + s).gradient(I) - law(mu=1.3, alpha=-3.3 - s).gradient(I) for s in (h, 2 * h))
        numerical = (8 * near - far) / (12 * h)  # fourth order
        np.testing.assert_allclose(exact[1], numerical, atol=1e-9)
        np.testing.assert_allclose(exact[0], material.gradient(I) / 1.3, rtol=1e-13)


def test_round_off_in_the_invariants_at_rest_does_no_harm():
    """I1 and I2 a few units of round-off beside 3 belong to no real deformation, or to gaps of 1e-8."""
    material = load("ogden")(mu=1.3, alpha=8.0)
    exact = material.gradient(np.array([3.0, 3, 1, 1])), material.hessian(np.array([3.0, 3, 1, 1]))
    for a in (-4, -1, 0, 1, 4):
        for b in (-4, 0, 4):
            I = np.array([3 + a * 2.2e-16, 3 + b * 2.2e-16, 1, 1])
            np.testing.assert_allclose(material.gradient(I), exact[0], rtol=1e-13)
            np.testing.assert_allclose(material.hessian(I), exact[1], rtol=1e-12)


def test_every_function_of_a_series_has_the_taylor_coefficients_of_mpmath():
    c, order = 1.21, 12
    l = Power(np.array([c]), 0.5, order)
    cases = {
        "exp": (exp(l * 1.3), lambda z: mpmath.exp(1.3 * mpmath.sqrt(z))),
        "log": (log(1 + l), lambda z: mpmath.log(1 + mpmath.sqrt(z))),
        "log of a power": (log(l), lambda z: mpmath.log(z) / 2),
        "sinh": (sinh(l - 1.1), lambda z: mpmath.sinh(mpmath.sqrt(z) - mpmath.mpf(1.1))),
        "cosh": (cosh(l), lambda z: mpmath.cosh(mpmath.sqrt(z))),
        "tanh": (tanh(2 * l), lambda z: mpmath.tanh(2 * mpmath.sqrt(z))),
        "power": ((1 + l) ** 1.7, lambda z: (1 + mpmath.sqrt(z)) ** 1.7),
        "whole power": ((l - 1.1) ** 3, lambda z: (mpmath.sqrt(z) - mpmath.mpf(1.1)) ** 3),
        "powers": (l**3 * l**-0.5, lambda z: z**1.25),
        "quotient": (1 / (2 + l) - l / (3 - l * l), lambda z: 1 / (2 + mpmath.sqrt(z)) - mpmath.sqrt(z) / (3 - z)),
        "exponent": (l ** (l + 0.5), lambda z: mpmath.sqrt(z) ** (mpmath.sqrt(z) + 0.5)),
        "base": (2.5**l, lambda z: mpmath.mpf(2.5) ** mpmath.sqrt(z)),
    }
    for name, (series, function) in cases.items():
        with mpmath.workdps(60):
            right = [float(t * mpmath.mpf(c) ** k) for k, t in enumerate(mpmath.taylor(function, mpmath.mpf(c), order))]
        assert isinstance(series, Series)
        np.testing.assert_allclose(series.terms[:, 0], right, rtol=1e-10, atol=1e-13, err_msg=name)


def test_energies_written_in_other_ways_are_the_same_energy():
    """Sums of products reduce by l1 l2 l3 = 1, factors may be sums themselves, and fibres may stand beside stretches."""
    pairs = [
        ("m/2*(l1^2 + l2^2 + l3^2 - 3)", "m/2*(I1 - 3)"),
        ("m/2*((l1*l2)^2 + (l2*l3)^2 + (l3*l1)^2 - 3)", "m/2*(I2 - 3)"),
        ("m/2*(l1^-2 + l2^-2 + l3^-2 - 3)*l1*l2*l3", "m/2*(I2 - 3)"),
        ("m*(l1^2 + l2^2 + l3^2 - 3)*(l1^-2 + l2^-2 + l3^-2)", "m*(I1 - 3)*I2"),
        ("m*exp(l1^2 + l2^2 + l3^2 - 3) + m*I4*I1 - m*I4*(l1^2 + l2^2 + l3^2)", "m*exp(I1 - 3)"),
        ("m*(exp(2*log(l1)) + l2^2 + tanh(l3)*l3^2/tanh(l3))", "m*I1"),
        ("m*((I2*l1)^2 + (I2*l2)^2 + (I2*l3)^2)", "m*I1*I2^2"),
    ]
    rng = np.random.default_rng(1)
    F = np.eye(3)[..., None] + 0.2 * rng.standard_normal((3, 3, 50))
    a0 = np.array([0.6, 0.8, 0.0])[:, None] + np.zeros(50)
    I = invariants(F, a0)
    assert invariant_gradients(F, a0).shape == (4, 3, 3, 50)
    for stretched, plain in pairs:
        a, b = typed(stretched, ["m"])(m=0.7), typed(plain, ["m"])(m=0.7)
        size = np.abs(b.gradient(I)).max()
        for name, apart in (("psi", 1e-13), ("gradient", 1e-11), ("hessian", 1e-9), ("parameter_gradient", 1e-11)):
            x, y = getattr(a, name)(I), getattr(b, name)(I)
            np.testing.assert_allclose(x, y, rtol=0, atol=apart * size, err_msg=f"{stretched}: {name}")


def test_the_compiled_loop_is_the_numpy_one(monkeypatch):
    rng = np.random.default_rng(2)
    size = 10 ** rng.uniform(-9, -0.5, 500)
    y = rng.standard_normal((2, 500)) * size
    z = np.exp(2 * np.array([*y, -y.sum(axis=0)]))
    I1, I2 = z.sum(axis=0), z[0] * z[1] + z[1] * z[2] + z[2] * z[0]
    functions = [lambda l: l**-7.3, lambda l: log(l) ** 2, lambda l: 2.0]
    for derivatives in (0, 1, 2):
        fast = sums(functions, I1, I2, derivatives)
        with monkeypatch.context() as context:
            context.setattr("indentfit.material.stretches.COMPILED_FROM", 10**9)
            slow = sums(functions, I1, I2, derivatives)
        np.testing.assert_allclose(fast[:, :3], slow[:, :3], rtol=1e-11, atol=1e-13)
        np.testing.assert_allclose(fast, slow, rtol=1e-9, atol=1e-12)
