"""Second-order Taylor arithmetic: moduli without SymPy, against SymPy's own derivatives."""

import subprocess
import sys
import time

import numpy as np
import pytest
import sympy

from indentfit.errors import MaterialError
from indentfit.material import INVARIANTS, REST, Material, Parameter, exp, installed, load, log, positive, shipped, sqrt, typed
from indentfit.material.functions import applied
from indentfit.material.jets import Jet, at_rest
from indentfit.material.kinematics import REST_OF_TWO
from indentfit.material.model import law_of, require_derivable
from indentfit.material.trials import trial_values

pytestmark = pytest.mark.quick

FIRST = ("holzapfel", "mooney_rivlin", "neo_hookean", "transversely_isotropic")
STRETCHES = {"l1", "l2", "l3"}
TYPED = {
    "mu/2 * ((I1 - 3) + zeta*(I4 - 1)^2 + phi*(I5 - I4^2))": {"mu": 1.49, "zeta": 4.68, "phi": 0.68},
    "c/2*(I1-3) + k1/(2*k2)*(exp(k2*positive(I4-1)^2) - 1)": {"c": 1.1, "k1": 2.0, "k2": 0.7},
    "c10*(I1-3) + c01*(I2-3) + c20*(I1-3)**2": {"c10": 1.0, "c01": 0.4, "c20": -0.2},
    "-a*log(1 - (I1-3)/(50 + b))": {"a": 3.0, "b": 20.0},
    "m*(I1-3) + k*(cosh(I4-1) - 1) + n*(sinh(I4-1) - tanh(I4-1))": {"m": 1.0, "k": 2.0, "n": 0.5},
    "m*(I1-3) + k*(I4 - 2*sqrt(I4)) + k*(I4^-1.5 + 1.5*I4)": {"m": 1.0, "k": 0.3},
    "+m*(I1**p - 3**p) - -k*(I5 - I4**2)/2e0": {"m": 1.0, "k": 0.3, "p": 1.3},
    "m*(I1-3)/I2*3 + k*abs(I4 - 0.5)^3 + 0.75*k*(1 - I4)": {"m": 1.3, "k": 0.9},
    "m*(I2-3)*sqrt(I1) + k*(exp(I4 - 1) - log(I4) - 2*I4 + 2*I4)*0 + k*(I4-1)^2": {"m": 1.3, "k": 0.9},
    "m*tanh(I1-3) + k*(2^I4 - log(2)*2*I4)": {"m": 0.8, "k": 0.4},
    "m*(I1/3)^(I2/3) + k*cosh(I5 - I4^2) + k*(I5-I4^2)^2": {"m": 0.8, "k": 1.4},
    "m*(I1-3) + k*sinh(I4 - 1)^2 + k*(I5 - 2*I4)^2 - 2*k*(2*I4 - I5)": {"m": 0.8, "k": 0.4},
    "2*m/a^2*(l1^a + l2^a + l3^a - 3) + n*(I1 - 3) + k*(I4 - 1)^2 + k*(I5 - I4^2)": {"m": 1.1, "a": -3.7, "n": 0.2, "k": 0.8},
    "m*(exp(k*(log(l1)^2 + log(l2)^2 + log(l3)^2)) - 1)/k + n*((l1*l2)^-1 + (l2*l3)^-1 + (l3*l1)^-1)*I4^0": {
        "m": 1,
        "k": 2,
        "n": 3,
    },
    "m/(1 - (I1 - 3)/j) + k*positive(1 - I4)^2 + k*positive(I1 - 2)": {"m": 0.8, "k": 0.4, "j": 30.0},
}


def assert_same(material):
    """The derivatives of two independent derivations, and the moduli from each."""
    law, theta = law_of(type(material)), material.values
    jet, derived = at_rest(law.energy, theta, material.two_families), require_derivable(type(material))
    rest = REST_OF_TWO if material.two_families else REST
    assert jet is not None
    size = max(np.abs(jet.gradient).max(), np.nanmax(np.abs(jet.hessian)))
    np.testing.assert_allclose(jet.value, derived.psi(rest, theta.values()), rtol=1e-12, atol=1e-14)
    gradient, hessian = derived.gradient(rest, theta.values()), derived.hessian(rest, theta.values())
    if STRETCHES & set(material.invariants):  # of stretches a jet knows what small strains see
        assert np.isnan(jet.hessian[:2]).all()
        assert jet.gradient[:2].sum() == pytest.approx(gradient[:2].sum(), rel=1e-12)
        np.testing.assert_allclose(jet.gradient[2:], gradient[2:], rtol=1e-12, atol=1e-14 * size)
        np.testing.assert_allclose(jet.hessian[2:, 2:], hessian[2:, 2:], rtol=1e-12, atol=1e-14 * size)
    else:
        np.testing.assert_allclose(jet.gradient, gradient, rtol=1e-12, atol=1e-14 * size)
        np.testing.assert_allclose(jet.hessian, hessian, rtol=1e-12, atol=1e-14 * size)
    assert moduli_by(jet, material) == pytest.approx(moduli_by(None, material), rel=1e-12)


def moduli_by(jet, material):
    """The moduli from a jet, or from SymPy's derivatives for None."""
    other = type(material)(**material.values)
    other.__dict__["_rest"] = jet
    return other.moduli()


@pytest.mark.parametrize("name", sorted(installed()))
def test_moduli_of_an_installed_law_are_those_of_its_symbolic_derivatives(name):
    law, rng = load(name), np.random.default_rng(0)
    for _ in range(20):
        material = law(**trial_values(law.parameters, rng))
        assert_same(material)
        assert not shipped(law) or material._rest is not None
        if name in FIRST:
            assert material.moduli() == moduli_by(None, material)  # bit for bit: results of 0.1 had SymPy's, and a search amplifies


@pytest.mark.parametrize(("text", "values"), TYPED.items())
def test_moduli_of_a_typed_energy_are_those_of_its_symbolic_derivatives(text, values):
    assert_same(typed(text, list(values))(**values))


@pytest.mark.parametrize("name", ["exp", "log", "sqrt", "sinh", "cosh", "tanh", "abs", "positive"])
@pytest.mark.parametrize("at", [0.7, 2.3])
def test_a_function_of_a_jet_has_the_derivatives_that_sympy_finds(name, at):
    def energy(values, I):
        return values["a"] * applied(name, I["I1"] * I["I4"] / I["I2"] - values["b"])

    x, jet = sympy.symbols(INVARIANTS, real=True), at_rest(energy, {"a": 1.7, "b": 1 - at})
    psi = energy({"a": 1.7, "b": 1 - at}, dict(zip(INVARIANTS, x, strict=True)))
    point = dict(zip(x, REST, strict=True))
    own = {"positive": lambda v: max(v, 0.0), "step": lambda v: float(v > 0)}

    def value(expression):
        return sympy.lambdify(x, expression, [own, "math"])(*point.values())

    assert jet.value == pytest.approx(value(psi), rel=1e-13)
    assert jet.gradient == pytest.approx([value(psi.diff(a)) for a in x], rel=1e-12, abs=1e-14)
    assert jet.hessian == pytest.approx(np.array([[value(psi.diff(a, b)) for a in x] for b in x]), rel=1e-12, abs=1e-13)


def test_a_switch_has_no_slope_at_its_edge_and_below():
    for at, slope in ((-0.5, 0.0), (0.0, 0.0), (0.5, 1.0)):
        jet = positive(Jet(np.float64(at), np.eye(4)[0], np.zeros((4, 4))))
        assert (jet.value, jet.gradient[0], jet.hessian[0, 0]) == (max(at, 0.0), slope, 0.0)


class ByComparison(Material):
    """Neither a symbol nor a jet can be compared with a number."""

    mu = Parameter("kPa", "shear modulus", min=0)

    def energy(self, I1):
        return self.mu * (I1 - 3) if I1 > 2 else 0


class ByNumPy(ByComparison):
    def energy(self, I1):
        return self.mu * np.expm1(I1 - 3)


class Crashing(ByComparison):
    def energy(self, I1):
        return self.mu * (I1 - 3) / [][0]


class Negative(ByComparison):
    def energy(self, I1):
        return -self.mu * (I1 - 3)


class Forgetful(ByComparison):
    def energy(self, I1):
        return log(I1 - 3)


class Unfinished(Material):
    mu = Parameter("kPa", "shear modulus", min=0)


@pytest.mark.parametrize("cls", [ByComparison, ByNumPy, Crashing, Forgetful, Unfinished])
@pytest.mark.parametrize("module", ["indentfit.materials.broken", "a_labs_own"])
def test_a_law_that_cannot_be_derived_has_no_moduli_either_for_the_same_reason(cls, module, monkeypatch):
    monkeypatch.setattr(cls, "__module__", module)
    messages = []
    for ask in (lambda: require_derivable(cls), cls(mu=1).moduli, lambda: cls(mu=1).shear_modulus):
        with pytest.raises(MaterialError) as error:
            ask()
        messages.append(str(error.value))
    assert len(set(messages)) == 1 and "\n" not in messages[0]
    assert cls(mu=1).unstable == messages[0]


def test_a_law_without_positive_stiffness_is_refused_by_jets(monkeypatch):
    monkeypatch.setattr(Negative, "__module__", "indentfit.materials.negative")
    with pytest.raises(MaterialError, match=r"Negative\(mu=1\) has a shear modulus of -2 kPa at rest; it must be positive"):
        Negative(mu=1).moduli()


class BySymPyOnly(ByComparison):
    """sympy.atan is no function of jets."""

    def energy(self, I1):
        return self.mu * sympy.atan(I1 - 3)


class ByNumbers(ByComparison):
    def energy(self, I1, I4):
        slope = float(exp(log(4)) / sqrt(16)) + np.float64(2) * 0  # numbers of NumPy and Python among the jets
        return (
            np.float64(slope) * self.mu * (I1 - 3) ** 1 * (I4 - 1) ** 0
            + (1 - abs(1 - I4)) * 0
            + (2 - (1 - I4)) ** 0 / 1
            + 2 / +I4 * np.int64(0)
        )


def test_a_law_that_jets_cannot_evaluate_is_left_to_sympy(monkeypatch):
    monkeypatch.setattr(BySymPyOnly, "__module__", "indentfit.materials.by_sympy_only")
    assert BySymPyOnly(mu=2)._rest is None
    assert BySymPyOnly(mu=2).shear_modulus == pytest.approx(4, rel=1e-14)


def test_numbers_of_every_kind_can_stand_among_the_jets():
    assert_same(ByNumbers(mu=2))
    assert ByNumbers(mu=2).shear_modulus == pytest.approx(4, rel=1e-14)


def test_moduli_of_an_installed_law_wait_for_no_sympy_and_cost_little():
    code = (
        "import sys, time\n"
        "from indentfit.material import load\n"
        "material = load('holzapfel')(c=1, k1=2, k2=3, dispersion=0.1)\n"
        "material.moduli(), material.unstable\n"
        "assert not {'sympy', 'scipy'} & set(sys.modules)\n"
        "print(time.process_time())"
    )
    done = subprocess.run([sys.executable, "-P", "-c", code], capture_output=True, text=True, check=True)
    assert float(done.stdout) < 0.5


def test_a_modulus_that_is_asked_for_again_is_not_computed_again():
    """The solver asks for the shear modulus in its loops."""
    material = load("holzapfel")(c=1, k1=2, k2=3, dispersion=0.1)
    _ = material.shear_modulus
    start = time.process_time()
    for _ in range(1000):
        _ = material.shear_modulus
    assert time.process_time() - start < 0.1
