"""Second-order Taylor arithmetic in the invariants: derivatives of an energy at one state, without SymPy.

A jet is the value of a term of an energy at one state, with its gradient and Hessian by the invariants. Sums, products, quotients,
powers and functions of jets are jets, by the chain rule. An energy evaluated on jets therefore gives its own first and second
derivatives, to round-off. SymPy derives the same derivatives at all states, but its import alone takes half a second.
Source: Griewank, Walther 2008, Evaluating Derivatives, 2nd ed., chapter 13.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from numbers import Real
from typing import Any

import numpy as np

from indentfit.arrays import Array
from indentfit.material.kinematics import INVARIANTS, REST, REST_OF_TWO, SECOND_FAMILY
from indentfit.material.stretches import STRETCHES


@dataclass(frozen=True, eq=False, slots=True)
class Jet:
    """A term of an energy at one state: its value, gradient (n,) and Hessian (n, n) by the invariants and principal stretches.

    The result of an operation without a finite value is nan or inf; an operation that jets do not know raises TypeError.
    """

    value: np.float64
    gradient: Array
    hessian: Array

    __array_ufunc__ = None  # a NumPy number leaves arithmetic with a jet to the jet

    def chained(self, f: float, first: float, second: float) -> "Jet":
        """A function of this jet, from the function's value f, first and second derivative at this jet's value."""
        outer = np.outer(self.gradient, self.gradient)
        return Jet(np.float64(f), first * self.gradient, first * self.hessian + second * outer)

    @property
    def constant(self) -> bool:
        """Whether the term depends on no invariant."""
        return not (self.gradient.any() or self.hessian.any())

    def __add__(self, other: Any) -> "Jet":
        if isinstance(other, Jet):
            return Jet(self.value + other.value, self.gradient + other.gradient, self.hessian + other.hessian)
        if isinstance(other, Real):
            return Jet(self.value + float(other), self.gradient, self.hessian)
        return NotImplemented

    def __mul__(self, other: Any) -> "Jet":
        if isinstance(other, Jet):
            mixed = np.outer(self.gradient, other.gradient)
            hessian = self.value * other.hessian + other.value * self.hessian + mixed + mixed.T
            return Jet(self.value * other.value, self.value * other.gradient + other.value * self.gradient, hessian)
        if isinstance(other, Real):
            factor = np.float64(other)
            return Jet(factor * self.value, factor * self.gradient, factor * self.hessian)
        return NotImplemented

    __radd__, __rmul__ = __add__, __mul__

    def __neg__(self) -> "Jet":
        return Jet(-self.value, -self.gradient, -self.hessian)

    def __pos__(self) -> "Jet":
        return self

    def __abs__(self) -> "Jet":
        return self.chained(abs(self.value), np.sign(self.value), 0.0)

    def __sub__(self, other: Any) -> "Jet":
        return self + -other if isinstance(other, (Jet, Real)) else NotImplemented

    def __rsub__(self, other: Any) -> "Jet":
        return -self + other

    def __truediv__(self, other: Any) -> "Jet":
        if isinstance(other, Jet):
            return self * _reciprocal(other)
        if isinstance(other, Real):
            divisor = np.float64(other)
            return Jet(self.value / divisor, self.gradient / divisor, self.hessian / divisor)
        return NotImplemented

    def __rtruediv__(self, other: Any) -> "Jet":
        return _reciprocal(self) * other

    def __pow__(self, other: Any) -> "Jet":
        if isinstance(other, Jet):
            return _power(self, other.value) if other.constant else exponential(other * logarithm(self))
        return _number_power(self, np.float64(other)) if isinstance(other, Real) else NotImplemented

    def __rpow__(self, other: Any) -> "Jet":
        return exponential(self * np.log(np.float64(other))) if isinstance(other, Real) else NotImplemented


def _reciprocal(x: Jet) -> Jet:
    return x.chained(1 / x.value, -1 / x.value**2, 2 / x.value**3)


def _power(x: Jet, n: np.float64) -> Jet:
    """x to a power that is a parameter, as SymPy differentiates it: the derivatives are nan at x = 0."""
    f = x.value**n
    return x.chained(f, n * f / x.value, n * (n - 1) * f / x.value**2)


def _number_power(x: Jet, n: np.float64) -> Jet:
    """x to a power that the energy gives as a number."""
    first = n * x.value ** (n - 1) if n else 0.0
    second = n * (n - 1) * x.value ** (n - 2) if n * (n - 1) else 0.0  # 0 at x = 0 too, where 0 * inf would be nan
    return x.chained(x.value**n, first, second)


def exponential(x: Jet) -> Jet:
    """exp(x)."""
    f = np.exp(x.value)
    return x.chained(f, f, f)


def logarithm(x: Jet) -> Jet:
    """log(x)."""
    return x.chained(np.log(x.value), 1 / x.value, -1 / x.value**2)


def square_root(x: Jet) -> Jet:
    """sqrt(x)."""
    f = np.sqrt(x.value)
    return x.chained(f, 1 / (2 * f), -1 / (4 * f * x.value))


def hyperbolic_sine(x: Jet) -> Jet:
    """sinh(x)."""
    return x.chained(np.sinh(x.value), np.cosh(x.value), np.sinh(x.value))


def hyperbolic_cosine(x: Jet) -> Jet:
    """cosh(x)."""
    return x.chained(np.cosh(x.value), np.sinh(x.value), np.cosh(x.value))


def hyperbolic_tangent(x: Jet) -> Jet:
    """tanh(x)."""
    f = np.tanh(x.value)
    return x.chained(f, 1 - f**2, -2 * f * (1 - f**2))


def exponential_integral(x: Jet) -> Jet:
    """Ei(x)."""
    slope = np.exp(x.value) / x.value
    return x.chained(np.float64(ei(float(x.value))), slope, slope * (1 - 1 / x.value))


def ei(x: float) -> float:
    """The exponential integral Ei of a number x > 0, by its series, whose terms are all positive; without SciPy, whose import would
    slow down the reading of a case."""
    total, term, k = np.euler_gamma + math.log(x), 1.0, 0
    while term > 1e-17 * abs(total) or k < x:
        k += 1
        term *= x / k
        total += term / k
    return total


def positive_part(x: Jet) -> Jet:
    """max(x, 0), with the derivative 1 for x > 0, else 0."""
    return x.chained(max(x.value, np.float64(0)), float(x.value > 0), 0.0)


def at_rest(
    energy: Callable[[Mapping[str, Any], Mapping[str, Any]], Any], parameters: Mapping[str, float], two: bool = False
) -> Jet | None:
    """The energy and its derivatives by the four invariants in the undeformed state, or by the seven.

    Parameters
    ----------
    energy : function
        psi, kPa, of the parameters' values by name and the invariants by name.
    parameters : mapping
        Values of the parameters, in their units.
    two : bool
        Whether the law has two families of fibres, here at right angles.

    Returns
    -------
    Jet or None
        For a law by principal stretches, what small strains see of them stands in psi_1, and second derivatives by I1 and I2 are
        nan.
        None where the energy raises an exception, uses an operation that jets do not know, or is not finite. SymPy's derivatives
        decide there.
    """
    invariants, rest_values = ((*INVARIANTS, *SECOND_FAMILY), REST_OF_TWO) if two else (INVARIANTS, REST)
    names, values = (*invariants, *STRETCHES), (*rest_values, 1.0, 1.0, 1.0)
    flat, units = np.zeros((len(names),) * 2), np.eye(len(names))
    theta = {name: Jet(np.float64(value), flat[0], flat) for name, value in parameters.items()}
    rest = {name: Jet(np.float64(x), unit, flat) for name, x, unit in zip(names, values, units, strict=True)}
    try:
        with np.errstate(all="ignore"):
            psi = energy(theta, rest)
    except Exception:
        return None
    return _by_invariants(psi, len(invariants)) if isinstance(psi, Jet) and _finite(psi) else None


def value_at(
    energy: Callable[[Mapping[str, Any], Mapping[str, Any]], Any], parameters: Mapping[str, float], named: Mapping[str, float]
) -> float | None:
    """The energy, kPa, at values of the parameters and of all invariants and stretches by name; None where jets cannot tell it."""
    flat = np.zeros(1), np.zeros((1, 1))
    theta, I = ({name: Jet(np.float64(x), *flat) for name, x in each.items()} for each in (parameters, named))
    try:
        with np.errstate(all="ignore"):
            psi = energy(theta, I)
    except Exception:
        return None
    return float(psi.value) if isinstance(psi, Jet) and np.isfinite(psi.value) else None


def _by_invariants(psi: Jet, n: int) -> Jet:
    """The jet by the n invariants, of one by invariants and stretches.

    With psi_l, psi_ll and psi_lm the derivatives by one stretch and by two, psi = (psi_l + psi_ll - psi_lm) / 2 tr e^2 to second
    order in isochoric strains e; a law by I1 has psi = 2 psi_1 tr e^2 (see `Material.moduli`).
    """
    gradient, hessian = psi.gradient[:n].copy(), psi.hessian[:n, :n].copy()
    slopes, bends = psi.gradient[n:], psi.hessian[n:, n:]
    if slopes.any() or bends.any():
        gradient[0] += (slopes[0] + bends[0, 0] - bends[0, 1]) / 4
        hessian[:2] = hessian[:, :2] = np.nan
    return Jet(psi.value, gradient, hessian)


def _finite(psi: Jet) -> bool:
    return bool(np.isfinite(psi.value) and np.isfinite(psi.gradient).all() and np.isfinite(psi.hessian).all())
