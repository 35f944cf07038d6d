"""The functions that energies are written with: each takes a number, a jet or a SymPy expression, and gives the same kind.

SymPy is imported when a first energy is derived, not with this module.
"""

import math
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from indentfit.material.jets import (
    Jet,
    ei,
    exponential,
    exponential_integral,
    hyperbolic_cosine,
    hyperbolic_sine,
    hyperbolic_tangent,
    logarithm,
    positive_part,
    square_root,
)

Term = Any
"""A term of an energy: a number, a `Jet` or a SymPy expression, which carries no types."""

FUNCTIONS = ("exp", "log", "sqrt", "sinh", "cosh", "tanh", "abs", "positive")
"""Names of the functions that a typed energy may use."""


def exp(x: Term) -> Term:
    """Exponential, for energies."""
    return applied("exp", x)


def log(x: Term) -> Term:
    """Natural logarithm, for energies."""
    return applied("log", x)


def sqrt(x: Term) -> Term:
    """Square root, for energies."""
    return applied("sqrt", x)


def expi(x: Term) -> Term:
    """Exponential integral Ei, whose derivative is exp(x) / x, of x > 0, for energies: the toe of fibres that straighten."""
    return applied("expi", x)


def positive(x: Term) -> Term:
    """Macaulay bracket max(x, 0), for energies: the switch of fibres that resist extension only.

    Its derivative is 1 for x > 0, else 0 (also at x = 0, so at rest such a fibre is slack).
    """
    return applied("positive", x)


def applied(name: str, x: Term) -> Term:
    """The function of that name, one of `FUNCTIONS`, of a term.

    Parameters
    ----------
    name : str
    x : number, Jet or SymPy expression

    Returns
    -------
    float, Jet or SymPy expression, as x is

    Raises
    ------
    ArithmeticError, ValueError
        The function has no finite real value at a number.
    """
    if isinstance(x, Jet):
        return ON_JETS[name](x)
    if isinstance(x, (int, float)):
        return ON_NUMBERS[name](float(x))
    return getattr(algebra(), name)(x)


def _positive_part(x: float) -> float:
    return max(x, 0.0)


def _expi(x: Any) -> Any:
    """Ei of arrays; SciPy is imported here, because reading a case needs none of it."""
    from scipy import special

    return special.expi(x)


ON_NUMBERS: dict[str, Callable[[float], float]] = {
    "exp": math.exp,
    "log": math.log,
    "sqrt": math.sqrt,
    "sinh": math.sinh,
    "cosh": math.cosh,
    "tanh": math.tanh,
    "abs": abs,
    "expi": ei,
    "positive": _positive_part,
}

ON_JETS: dict[str, Callable[[Jet], Jet]] = {
    "exp": exponential,
    "log": logarithm,
    "sqrt": square_root,
    "sinh": hyperbolic_sine,
    "cosh": hyperbolic_cosine,
    "tanh": hyperbolic_tangent,
    "abs": abs,
    "expi": exponential_integral,
    "positive": positive_part,
}

ON_ARRAYS: dict[str, Callable[[Any], Any]] = {
    "positive": lambda x: np.maximum(x, 0.0),
    "step": lambda x: np.greater(x, 0.0) * 1.0,
    "expi": _expi,
}
"""The NumPy code of those of our SymPy functions that NumPy does not have, for compiled derivatives."""


class Algebra(NamedTuple):
    """The functions of SymPy expressions."""

    exp: Any
    log: Any
    sqrt: Any
    sinh: Any
    cosh: Any
    tanh: Any
    abs: Any
    positive: Any
    expi: Any


@cache
def algebra() -> Algebra:
    """The functions of SymPy expressions, made when they are first used."""
    import sympy

    # Functions of our own. SymPy's Abs, Max and Heaviside would put Dirac pulses into the second derivatives;
    # its sinh, cosh and tanh ask whether they are real by polynomial algebra that can take minutes.
    def function(name: str, derivative: Callable[[Any], Any], **more: Any) -> Any:
        members = {"is_real": True, "fdiff": lambda self, argindex=1: derivative(self.args[0]), **more}
        return type(name, (sympy.Function,), members)

    step = function("step", lambda x: sympy.S.Zero, is_nonnegative=True)
    known = classmethod(lambda cls, x: sympy.Max(x, 0) if x.is_Number else None)
    positive = function("positive", step, is_nonnegative=True, eval=known)
    sinh: Any = function("sinh", lambda x: cosh(x))
    cosh: Any = function("cosh", sinh)
    tanh: Any = function("tanh", lambda x: 1 - tanh(x) ** 2)

    def absolute(x: Any) -> Any:
        return positive(x) + positive(-x)

    expi: Any = function("expi", lambda x: sympy.exp(x) / x)
    return Algebra(sympy.exp, sympy.log, sympy.sqrt, sinh, cosh, tanh, absolute, positive, expi)
