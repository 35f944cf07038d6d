"""Taylor series in one variable, at many points at once: a function of one principal stretch around a centre.

The variable is z, the square of a stretch, around centres c: z = c (1 + u). A series holds the coefficients of powers of u. Sums,
products, quotients, powers and functions of series are series, by the recurrences of their coefficients.
Source: Griewank, Walther 2008, Evaluating Derivatives, 2nd ed., section 13.2.
"""

from functools import cached_property
from typing import Any

import numpy as np

from indentfit.arrays import Array


class Series:
    """Coefficients (order + 1, n) of powers of u at n points. A value that is not finite is nan or inf, and no exception."""

    __array_ufunc__ = None  # a NumPy number leaves arithmetic with a series to the series

    def __init__(self, terms: Array) -> None:
        self._terms = terms

    @property
    def terms(self) -> Array:
        """The coefficients, (order + 1, n)."""
        return self._terms

    def __add__(self, other: Any) -> "Series":
        if isinstance(other, Series):
            return Series(self.terms + other.terms)
        terms = self.terms.copy()
        terms[0] += other
        return Series(terms)

    def __mul__(self, other: Any) -> "Series":
        if not isinstance(other, Series):
            return Series(self.terms * other)
        a, b = self.terms, other.terms
        return Series(np.array([_dot(a[: k + 1], b[k::-1]) for k in range(len(a))]))

    __radd__, __rmul__ = __add__, __mul__

    def __neg__(self) -> "Series":
        return Series(-self.terms)

    def __sub__(self, other: Any) -> "Series":
        return self + -other

    def __rsub__(self, other: Any) -> "Series":
        return -self + other

    def __truediv__(self, other: Any) -> "Series":
        return self * other**-1.0

    def __rtruediv__(self, other: Any) -> "Series":
        return self**-1.0 * other

    def __pow__(self, exponent: Any) -> "Series":
        if isinstance(exponent, Series):
            return exponential(exponent * logarithm(self))
        if exponent == int(exponent) and 0 <= exponent <= 64:
            return _whole_power(self, int(exponent))
        a, k = self.terms, np.arange(len(self.terms))[:, None]
        power = np.empty_like(a)
        power[0] = a[0] ** exponent
        for n in range(1, len(a)):
            power[n] = _dot(((exponent + 1) * k[1 : n + 1] - n) * a[1 : n + 1], power[n - 1 :: -1]) / (n * a[0])
        return Series(power)

    def __rpow__(self, base: Any) -> "Series":
        return exponential(self * np.log(np.float64(base)))


class Power(Series):
    """z ** exponent around centres c (n,): powers and products of such series need no recurrence of their terms.

    Parameters
    ----------
    centre : array (n,)
    exponent : float
    order : int
        Highest power of u.
    """

    def __init__(self, centre: Array, exponent: float, order: int) -> None:
        self.centre, self.exponent, self.order = centre, exponent, order

    @cached_property
    def terms(self) -> Array:  # type: ignore[override]
        n = np.arange(1, self.order + 1)
        binomials = np.concatenate([[1.0], np.cumprod((self.exponent - n + 1) / n)])
        return binomials[:, None] * self.centre**self.exponent

    def __mul__(self, other: Any) -> Series:
        if isinstance(other, Power) and other.centre is self.centre:
            return Power(self.centre, self.exponent + other.exponent, self.order)
        return super().__mul__(other)

    __rmul__ = __mul__

    def __pow__(self, exponent: Any) -> Series:
        return (
            super().__pow__(exponent) if isinstance(exponent, Series) else Power(self.centre, self.exponent * exponent, self.order)
        )

    def logarithm(self) -> Series:
        """exponent log z."""
        n = np.arange(1, self.order + 1)
        terms = np.empty((self.order + 1, self.centre.size))
        terms[0] = np.log(self.centre)
        terms[1:] = (-((-1.0) ** n) / n)[:, None]
        return Series(self.exponent * terms)


def exponential(x: Any) -> Any:
    """exp(x)."""
    if not isinstance(x, Series):
        return np.exp(x)
    slopes = _slopes(x)
    terms = np.empty_like(slopes)
    terms[0] = np.exp(x.terms[0])
    for n in range(1, len(terms)):
        terms[n] = _dot(slopes[1 : n + 1], terms[n - 1 :: -1]) / n
    return Series(terms)


def logarithm(x: Any) -> Any:
    """log(x)."""
    if not isinstance(x, Series):
        return np.log(x)
    if isinstance(x, Power):
        return x.logarithm()
    a = x.terms
    terms, slopes = np.zeros_like(a), np.zeros_like(a)
    terms[0] = np.log(a[0])
    for n in range(1, len(a)):
        terms[n] = (a[n] - _dot(slopes[1:n], a[n - 1 : 0 : -1]) / n) / a[0]
        slopes[n] = n * terms[n]
    return Series(terms)


def square_root(x: Any) -> Any:
    """sqrt(x)."""
    return x**0.5


def hyperbolic_sine(x: Any) -> Any:
    """sinh(x)."""
    return _hyperbolic(x)[0] if isinstance(x, Series) else np.sinh(x)


def hyperbolic_cosine(x: Any) -> Any:
    """cosh(x)."""
    return _hyperbolic(x)[1] if isinstance(x, Series) else np.cosh(x)


def hyperbolic_tangent(x: Any) -> Any:
    """tanh(x)."""
    if not isinstance(x, Series):
        return np.tanh(x)
    slopes = _slopes(x)
    terms, square = np.empty_like(slopes), np.empty_like(slopes)  # square: 1 - tanh^2
    terms[0] = np.tanh(x.terms[0])
    square[0] = 1 - terms[0] ** 2
    for n in range(1, len(terms)):
        terms[n] = _dot(slopes[1 : n + 1], square[n - 1 :: -1]) / n
        square[n] = -_dot(terms[: n + 1], terms[n::-1])
    return Series(terms)


ON_SERIES = {
    "exp": exponential,
    "log": logarithm,
    "sqrt": square_root,
    "sinh": hyperbolic_sine,
    "cosh": hyperbolic_cosine,
    "tanh": hyperbolic_tangent,
}
"""The functions of energies, by name, for series and numbers; switches have no series."""


def _hyperbolic(x: Series) -> tuple[Series, Series]:
    slopes = _slopes(x)
    sine, cosine = np.empty_like(slopes), np.empty_like(slopes)
    sine[0], cosine[0] = np.sinh(x.terms[0]), np.cosh(x.terms[0])
    for n in range(1, len(slopes)):
        sine[n] = _dot(slopes[1 : n + 1], cosine[n - 1 :: -1]) / n
        cosine[n] = _dot(slopes[1 : n + 1], sine[n - 1 :: -1]) / n
    return Series(sine), Series(cosine)


def _whole_power(x: Series, exponent: int) -> Series:
    """A power without division, also of a series that is zero at its centre."""
    result = Series(np.zeros_like(x.terms)) + 1.0
    while exponent:
        result = result * x if exponent & 1 else result
        exponent >>= 1
        x = x * x if exponent else x
    return result


def _slopes(x: Series) -> Array:
    """Coefficients times their power of u, shifted so that coefficient n stands at n."""
    return np.arange(len(x.terms))[:, None] * x.terms


def _dot(a: Array, b: Array) -> Array:
    return np.einsum("kn,kn->n", a, b)
