"""Energies typed in a case file: what they mean, what they must not do."""

import pickle
import time

import numpy as np
import pytest

from indentfit.errors import MaterialError
from indentfit.material import INVARIANTS, Parameter, check, load, typed

WHITE_MATTER = "mu/2 * ((I1 - 3) + zeta*(I4 - 1)^2 + phi*(I5 - I4^2))"
FUNCTIONS = {name: getattr(np, name) for name in ("exp", "log", "sqrt", "sinh", "cosh", "tanh", "abs")}
FUNCTIONS["positive"] = lambda x: np.maximum(x, 0)


@pytest.fixture
def points():
    """Invariants of random deformations, shape (4, 40)."""
    rng = np.random.default_rng(0)
    F = np.eye(3) + 0.2 * rng.standard_normal((40, 3, 3))
    C = np.swapaxes(F, 1, 2) @ F
    C /= np.cbrt(np.linalg.det(C))[:, None, None]
    trace = np.trace(C, axis1=1, axis2=2)
    return np.array([trace, (trace**2 - np.sum(C * C, axis=(1, 2))) / 2, C[:, 0, 0], (C @ C)[:, 0, 0]])


def by_python(text, I, values):
    """The text's own value, by Python and NumPy: an oracle that shares nothing with the reader."""
    names = dict(zip(INVARIANTS, I, strict=True)) | values | FUNCTIONS
    return eval(text.replace("^", "**"), {"__builtins__": {}}, names) + np.zeros(I.shape[1:])


@pytest.mark.parametrize(
    ("text", "values"),
    [
        (WHITE_MATTER, {"mu": 1.49, "zeta": 4.68, "phi": 0.68}),
        ("c/2*(I1-3) + k1/(2*k2)*(exp(k2*positive(I4-1)^2) - 1)", {"c": 1.1, "k1": 2.0, "k2": 0.7}),
        ("c10*(I1-3) + c01*(I2-3) + c20*(I1-3)**2", {"c10": 1.0, "c01": 0.4, "c20": -0.2}),
        ("-a*log(1 - (I1-3)/(50 + b))", {"a": 3.0, "b": 20.0}),
        ("m*(I1-3) + k*(cosh(I4-1) - 1) + n*(sinh(I4-1) - tanh(I4-1))", {"m": 1.0, "k": 2.0, "n": 0.5}),
        ("m*(I1-3) + k*abs(sqrt(I4) - 1)^3 + k*I4^-1.5 + 1.5*k*sqrt(I5)/1.0", {"m": 1.0, "k": 0.3}),
        ("+m*(I1**p - 3**p) - -k*(I5 - I4**2)/2e0", {"m": 1.0, "k": 0.3, "p": 1.3}),
    ],
)
def test_a_typed_energy_has_the_numerical_derivatives_of_its_text(text, values, points):
    cls = typed(text, list(values))
    material = cls(**values)
    np.testing.assert_allclose(material.psi(points), by_python(text, points, values), rtol=1e-12, atol=1e-13)
    h, gradient, hessian = 1e-4, material.gradient(points), material.hessian(points)
    for i in range(4):
        d = h * np.eye(4)[i][:, None]
        up, down = (by_python(text, points + s * d, values) for s in (1, -1))
        np.testing.assert_allclose(gradient[i], (up - down) / (2 * h), rtol=1e-6, atol=1e-6)
        up, down = (material.gradient(points + s * d) for s in (1, -1))
        np.testing.assert_allclose(hessian[i], (up - down) / (2 * h), rtol=1e-5, atol=1e-5)
    for k, name in enumerate(values):
        up, down = (cls(**values | {name: values[name] + s * h}).gradient(points) for s in (1, -1))
        np.testing.assert_allclose(material.parameter_gradient(points)[k], (up - down) / (2 * h), rtol=1e-5, atol=1e-6)


def test_white_matter_typed_is_the_installed_white_matter(points):
    values = {"mu": 1.49, "zeta": 4.68, "phi": 0.68}
    written, shipped = typed(WHITE_MATTER, list(values))(**values), load("transversely_isotropic")(**values)
    for name in ("psi", "gradient", "hessian", "parameter_gradient"):
        np.testing.assert_allclose(getattr(written, name)(points), getattr(shipped, name)(points), rtol=1e-13, atol=1e-13)
    assert written.moduli() == pytest.approx(shipped.moduli(), rel=1e-13)
    assert all(c.ok for c in check(type(written)))


def test_the_scale_of_a_typed_energy_is_found():
    assert typed(WHITE_MATTER, ["zeta", "phi", "mu"]).scale == "mu"
    assert typed("c10*(I1-3) + c01*(I2-3)", ["c10", "c01"]).scale is None


def test_a_typed_energy_can_have_units_and_bounds():
    cls = typed("mu/2*(I1-3)", {"mu": Parameter("kPa", "shear modulus", min=0.1, max=5)})
    with pytest.raises(MaterialError, match="mu = 6 kPa is above its maximum 5"):
        cls(mu=6)


def test_a_typed_energy_is_one_class_in_a_process_and_survives_pickling():
    cls = typed(WHITE_MATTER, ("mu", "zeta", "phi"))
    material = pickle.loads(pickle.dumps(cls(mu=1, zeta=2, phi=3)))
    assert type(material) is cls is typed(WHITE_MATTER, ["mu", "zeta", "phi"])
    assert material.values == {"mu": 1.0, "zeta": 2.0, "phi": 3.0}


HOSTILE = {
    "__import__('os').system('true')": '"\'" at character 12',
    "__import__(I1)": "no function '__import__'",
    "I1.__class__": "I1.__class__",
    "().__class__.__bases__": "__bases__",
    "mu*exp.__globals__": "exp.__globals__",
    "9**9**9": "power in an exponent",
    "mu*I1^9^9": "power in an exponent",
    "((((2*I1)^20)^20)^20)*mu": "above 20",
    "mu*(I1-3)^2000000": "above 20",
    "mu*" + "(" * 150 + "I1" + ")" * 150 + "*" * 3: "cannot be read",
    "(" * 240 + "I1" + ")" * 240: "cannot be read",
    "-" * 400 + "I1": "more than 150",
    "-" * 100 + "I1*mu": "nested more than 60",
    "+".join(["mu*I1"] * 60): "more than 150",
    "mu*" + "exp(" * 9 + "I1" + ")" * 9: "functions nested more than 4",
    "mu*(I1-3)+" * 60 + "mu": "at most 500",
    "lambda I1: I1": "':'",
    "lambda": "cannot be read",
    "mu if I1 else 0": "mu if I1 else 0",
    "I1 and mu": "I1 and mu",
    "I1 < mu": "'<'",
    "'mu*I1'": '"\'"',
    "f'{mu}'": '"\'"',
    "[mu*I1]": r"'\['",
    "mu*I1 # + zeta": "'#'",
    "mu:=I1": "':'",
    "mu*I1; mu": "';'",
    "mu*(I1-3), mu": "cannot contain",
    "mu//I1": "mu // I1",
    "mu*\u0399\uff11": "at character 4",
    "\u03bc*(I1-3)": "at character 1",
    "mu*(I\u2081-3)": "at character 6",
    "mu*(I1\u22123)": "at character 7",
    "1j*mu*I1": "1j",
    "mu*True*I1": "True",
    "9" * 400 + "*mu*I1": r"beyond 1e\+15",
    "1e999*mu*I1": r"beyond 1e\+15",
    "mu*I1*exp(exp(99))": r"beyond 1e\+15",
    "mu*I1*exp(exp(I1-I1+1e14))": "no finite real value",
    "mu*I1/(2-2)": "divides by zero",
    "mu*I1*sqrt(-1)": "no finite real value",
    "mu*I1*(-8)^0.5": "no finite real value",
    "mu*eval(I1)": "no function 'eval'",
    "mu*exp(I1, mu)": "one argument",
    "mu*exp": "give it its argument",
    "mu*I3": "names 'I3'",
    "mu*(I1-3) + nu": "names 'nu'",
    "": "cannot be read",
    "mu": "none of I1",
    "mu*(I1-I1)": "none of I1",
    "I1-3": "does not depend on mu",
    "mu*(I4-1)": "stressed at rest",
    "mu*(I1-3) + mu*positive(I4-1)": "stressed at rest",
    "mu*(I5-1)": "stressed at rest",
    "mu*(I1-3)^0.5": "not finite at rest",
}


@pytest.mark.parametrize(("text", "message"), HOSTILE.items(), ids=[f"{t[:24]!a}" for t in HOSTILE])
def test_a_hostile_or_wrong_text_is_refused_at_once_naming_the_piece(text, message):
    typed("m*(I1-3)", ["m"])  # the import of SymPy isn't the text's
    start = time.process_time()  # of this process: a busy machine's clock says nothing about the text
    with pytest.raises(MaterialError, match=message) as error:
        typed(text, ["mu"])
    assert time.process_time() - start < 0.1
    assert "\n" not in str(error.value) and len(str(error.value)) < 250


@pytest.mark.parametrize("name", ["I4", "exp", "positive", "psi", "values", "lambda", "_a", "1a", "\u03bc", "a b", "", 3])
def test_a_parameter_name_that_has_a_meaning_or_is_no_name_is_refused(name):
    with pytest.raises(MaterialError, match="cannot be called"):
        typed("mu*(I1-3)", ["mu", name])


def test_parameters_are_a_list_of_different_names():
    for parameters, message in (("mu", "list of names"), (["mu", "mu"], "twice"), ([], "at least one")):
        with pytest.raises(MaterialError, match=message):
            typed("mu*(I1-3)", parameters)
    with pytest.raises(MaterialError, match=r"'mu' must be a Parameter"):
        typed("mu*(I1-3)", {"mu": 1.0})
    with pytest.raises(MaterialError, match="is text"):
        typed(3, ["mu"])


AT_THE_LIMITS = {  # the last that is read, the first that isn't, and what is said of it
    "characters": ("mu*(I1-3)" + " " * 491, "mu*(I1-3)" + " " * 492, "has 501 characters; at most 500"),
    "nodes": ("mu*(I1-3)" + "+mu*I1" * 35 + "+-mu*I1", "mu*(I1-3)" + "+mu*I1" * 34 + "+-mu*I1" * 2 + "+mu", "more than 150"),
    "depth": ("-" * 58 + "I1*mu", "-" * 60 + "I1*mu", "nested more than 60"),
    "functions": ("mu*exp(exp(exp(exp(I1-3))))", "mu*exp(exp(exp(exp(exp(I1-3)))))", "functions nested more than 4"),
    "powers": ("mu*((I1-2)^10)^2", "mu*((I1-2)^10)^3", "above 20"),
    "numbers": ("1e15*mu*(I1-3)", "1.1e15*mu*(I1-3)", r"beyond 1e\+15"),
}


@pytest.mark.parametrize("which", AT_THE_LIMITS)
def test_the_limits_lie_where_they_are_said_to_lie(which):
    read, refused, said = AT_THE_LIMITS[which]
    assert typed(read, ["mu"]).scale == "mu"
    with pytest.raises(MaterialError, match=said):
        typed(refused, ["mu"])


def test_an_unknown_name_in_an_energy_is_answered_with_all_that_are_known():
    with pytest.raises(
        MaterialError, match=r"names 'x', which is no parameter or invariant; known: I1, I2, I4, I5, I6, I7, I8, l1, l2, l3, mu, k$"
    ):
        typed("mu*(I1-3) + x", ["mu", "k"])
