"""Closed forms of curves in time, against hereditary integrals by quadrature and by partial fractions."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.signal import residue

import indentfit
from indentfit.curve import Curve
from indentfit.report.html_facts import closed_table
from indentfit.runs.closed_form import closed_forms

pytestmark = pytest.mark.quick

RAMP, HOLD, RATE = 0.5, 10.0, 0.4  # s, s, mm/s
SHARES, TIMES = (0.8, 0.5), (0.5, 5.0)  # over the long-term modulus
TIME = np.concatenate([np.linspace(0.02, RAMP, 25), RAMP + np.geomspace(0.02, HOLD, 20)])
DEPTH = RATE * np.minimum(TIME, RAMP)


def long_term(age):
    return 1 + sum(share * np.exp(-age / time) for share, time in zip(SHARES, TIMES, strict=True))


def ramped(modulus_of_age, power):
    """Forces at TIME of a contact whose elastic force is depth^power times a modulus, by quadrature."""
    slope = lambda s: power * RATE * (RATE * s) ** (power - 1)  # noqa: E731
    return np.array([quad(lambda s, t=t: modulus_of_age(t - s) * slope(s), 0, min(t, RAMP), epsabs=1e-12)[0] for t in TIME])


def case_of(force, end, relaxation, nu, time=TIME, depth=DEPTH):
    indenters = {"sphere": {"shape": "sphere", "radius": 2.5}, "punch": {"shape": "cylinder", "radius": 2.5}}
    return indentfit.Case(
        sample={"shape": "disc", "diameter": 4000.0, "thickness": 2000.0, "base": "bonded"},  # a half-space
        indenter={**indenters[end], "friction": 0.0},
        mesh={"elements": 60},
        material={
            "model": "neo_hookean", "parameters": {"mu": {"start": 2.0, "min": 0.1, "max": 20.0}}, "poisson_ratio": nu,
            "relaxation": relaxation,
        },
        tests=[indentfit.Test("press", curve=Curve(depth, force, time=time))],
    )  # fmt: skip


def form_of(case, values=None):
    return closed_forms(case, {"press": case.curves[0]}, 1.5, values or {})["press"]


@pytest.mark.parametrize(("end", "power", "factor"), [("sphere", 1.5, 16 / 3 * np.sqrt(2.5)), ("punch", 1.0, 8 * 2.5)])
def test_a_half_space_that_relaxes_gives_its_long_term_modulus(end, power, factor):
    """nu 0.5: F = 16/3 mu sqrt(R) d^1.5 under a sphere, 8 mu a d under a punch (Lee and Radok 1960)."""
    case = case_of(factor * 1.5 * ramped(long_term, power), end, {"g": SHARES, "tau": TIMES}, 0.49999)
    form = form_of(case)
    assert (form.half_space, form.layer) == (pytest.approx(1.5, rel=1e-4), pytest.approx(1.5, rel=2e-3))
    assert form.misfit < 2e-5 and (form.points, form.depth) == (15, pytest.approx(0.12))
    assert "long-term moduli with the relaxation of the fit" in form.words()
    assert "long-term moduli with the relaxation of the fit" in closed_table({"press": form})[-1].text


def test_the_instantaneous_modulus_is_that_of_the_other_base():
    """G_0 = 1.5 (1 + 0.8 + 0.5) = 3.45 kPa, with shares of it."""
    shares = [share / 2.3 for share in SHARES]
    case = case_of(8 * 2.5 * 1.5 * ramped(long_term, 1.0), "punch", {"base": "instantaneous", "g": shares, "tau": TIMES}, 0.49999)
    form = form_of(case)
    assert form.half_space == pytest.approx(3.45, rel=1e-4)
    assert "instantaneous moduli with" in form.words()


def test_the_relaxation_is_that_of_the_fit_and_not_of_the_start():
    free = {"g": [{"start": 0.1, "min": 0.0, "max": 3.0}] * 2, "tau": TIMES}
    case = case_of(8 * 2.5 * 1.5 * ramped(long_term, 1.0), "punch", free, 0.49999)
    assert form_of(case, {"mu": 1.5, "g1": 0.8, "g2": 0.5}).half_space == pytest.approx(1.5, rel=1e-4)
    assert form_of(case).half_space > 2.0


def test_the_bulk_modulus_does_not_relax():
    """nu 0.4: F = 4 a d G (3 K + G)/(3 K + 4 G) twice, with p G^ = 1 + 0.8 p/(p + 2), by partial fractions over p.

    The share of the bulk modulus is that of a spring in series, which is nearly so; with one that relaxes too, it is 4 % off.
    """
    nu, rate = 0.4, 2.0
    bulk = 2 * (1 + nu) / (3 * (1 - 2 * nu))
    g, one = np.poly1d([1.8, rate]), np.poly1d([1.0, rate])  # p G^ = g / one
    modulus = 8 * g * (3 * bulk * one + g), one * (3 * bulk * one + 4 * g)
    parts, poles, _ = residue(modulus[0].coeffs, (modulus[1] * np.poly1d([1.0, 0.0])).coeffs)  # over p: a function of the age
    whole = lambda age: 1.5 * 2.5 * float(np.real(np.sum(parts * np.exp(poles * age))))  # noqa: E731
    case = case_of(ramped(whole, 1.0), "punch", {"g": [0.8], "tau": [1 / rate]}, nu)
    form = form_of(case)
    assert form.half_space == pytest.approx(1.5, rel=5e-3)
    relaxed = case.model_copy(update={"material": case.material.model_copy(update={"poisson_ratio": 0.49999})})
    factor = (1 - nu) / 0.5  # of a half-space whose whole force relaxes
    assert abs(form_of(relaxed).half_space * factor / 1.5 - 1) > 0.02
    assert form_of(relaxed, {"bulk_ratio": bulk}).half_space == pytest.approx(1.5, rel=5e-3)  # it is fitted


def test_a_curve_that_comes_back_counts_up_to_where_it_turns():
    time = np.append(TIME, TIME[-1] + np.array([0.1, 0.2, 0.3]))
    depth = np.append(DEPTH, [0.15, 0.1, 0.05])
    force = np.append(8 * 2.5 * 1.5 * ramped(long_term, 1.0), [0.0, 0.0, 0.0])
    form = form_of(case_of(force, "punch", {"g": SHARES, "tau": TIMES}, 0.49999, time, depth))
    assert form.half_space == pytest.approx(1.5, rel=1e-4) and form.misfit < 2e-5


def test_a_simulation_in_time_has_no_closed_form():
    case = case_of(ramped(long_term, 1.0), "punch", {"g": SHARES, "tau": TIMES}, 0.49999)
    assert closed_forms(case, {"press": case.curves[0]}, 1.5) == {}
