"""Energies by principal stretches as functions of sums over them: found in a SymPy expression, and differentiated through it."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from indentfit.arrays import Array
from indentfit.errors import MaterialError
from indentfit.material.functions import ON_ARRAYS, Term
from indentfit.material.kinematics import INVARIANTS, SECOND_FAMILY
from indentfit.material.series import ON_SERIES
from indentfit.material.stretches import ROWS, STRETCHES, sums

REMEDY = "write it with sums f(l1) + f(l2) + f(l3) of a smooth f, such as l1**a + l2**a + l3**a"


@dataclass(frozen=True, eq=False)
class Sum:
    """One sum f(l1) + f(l2) + f(l3) in an energy.

    Parameters
    ----------
    function : SymPy expression
        f, in `stretch()` and the parameters.
    symbols : tuple of 6 SymPy symbols
        They stand for the sum S and for its derivatives by I1, I2, in the order of `stretches.sums`.
    """

    function: Term
    symbols: tuple[Any, ...]

    @property
    def value(self) -> Any:
        """The symbol of S."""
        return self.symbols[0]

    def slope(self, symbol: Any, i: int) -> Any:
        """The symbol of the derivative of one of this sum's symbols by I1 (i = 0) or I2 (i = 1); 0 for a fibre's invariant."""
        place = self.symbols.index(symbol)
        return self.symbols[((1, 2), (3, 4), (4, 5))[place][i]] if i < 2 else 0


@dataclass(frozen=True, eq=False)
class Sums:
    """The sums that an array of derivatives needs, as arguments of its function.

    Parameters
    ----------
    functions : tuple of functions
        f of the parameters and a stretch, as compiled Python for series.
    derivatives : int
        How far the sums are differentiated.
    """

    functions: tuple[Callable[..., Any], ...] = ()
    derivatives: int = 0

    def __call__(self, I: Array, theta: Sequence[float]) -> list[Array]:
        """Values of the symbols of each sum, up to the derivatives, at invariants I (4, ...) and parameters."""
        if not self.functions:
            return []
        bound = [lambda stretch, f=f: f(*theta, stretch) for f in self.functions]
        arrays = sums(bound, I[0].ravel(), I[1].ravel(), self.derivatives)
        return [row.reshape(I.shape[1:]) for array in arrays for row in array]


class Stretched:
    """An energy whose stretches have been replaced by sums over them, with the rules of its differentiation.

    Parameters
    ----------
    psi : SymPy expression
        In invariants, principal stretches and parameters.
    name : str
        Of the law, for messages.

    Raises
    ------
    MaterialError
        The energy is no function of sums over the stretches, or their functions are not smooth.
    """

    def __init__(self, psi: Term, name: str) -> None:
        self.sums: list[Sum] = []
        self._name = name
        self.psi = self._summed(psi) if psi.has(*stretch_symbols()) else psi

    def by_invariant(self, expression: Term, invariant: Any, i: int) -> Term:
        """The derivative by the invariant of index i, through the sums too."""
        return expression.diff(invariant) + sum(
            expression.diff(symbol) * each.slope(symbol, i) for each in self.sums for symbol in each.symbols[:3]
        )

    def by_parameter(self, expression: Term, parameter: Any) -> Term:
        """The derivative by a parameter, through the sums too, which gain the sums of their functions' derivatives."""
        total = expression.diff(parameter)
        for each in list(self.sums):
            slopes = [expression.diff(symbol) for symbol in each.symbols[:3]]
            change = each.function.diff(parameter)
            if change != 0 and any(slope != 0 for slope in slopes):
                total += sum(slope * symbol for slope, symbol in zip(slopes, self._sum(change).symbols, strict=False))
        return total

    def compiled(self, theta: Iterable[Any], expressions: Sequence[Any], derivatives: int) -> tuple[list[Any], Sums]:
        """The symbols of the sums in the expressions, as further arguments of their function, and what computes their values."""
        import sympy

        present = set().union(*(e.free_symbols for e in expressions)) if expressions else set()
        used = [each for each in self.sums if present & set(each.symbols)]
        arguments = [symbol for each in used for symbol in each.symbols[: ROWS[derivatives]]]
        variables = [*theta, stretch()]
        functions = [sympy.lambdify(variables, each.function, [ON_SERIES, "math"], cse=True, dummify=True) for each in used]
        return arguments, Sums(tuple(functions), derivatives)

    def _summed(self, term: Term) -> Term:
        """The term with sums in place of stretches."""
        term = _reduced(term)
        here = _stretches_in(term)
        if not here:
            return term
        if term.is_Add:
            return self._grouped(term.args)
        if len(here) == 1:
            raise self._asymmetric(term)
        return term.func(*(self._summed(part) for part in (_factors(term) if term.is_Mul else term.args)))

    def _grouped(self, parts: Iterable[Term]) -> Term:
        """A sum of terms: those in one stretch each belong together, and become Sums times their common factors."""
        by_stretch: dict[Any, dict[Term, Term]] = {symbol: {} for symbol in stretch_symbols()}
        total: Term = 0
        for part in map(_reduced, parts):
            here = _stretches_in(part)
            if len(here) != 1:
                total += self._summed(part)
                continue
            symbol = here.pop()
            factor, function = part.as_independent(symbol, as_Add=False)
            function = function.subs(symbol, stretch())
            by_stretch[symbol][function] = by_stretch[symbol].get(function, 0) + factor
        first, *others = by_stretch.values()
        if not all(_equal(first, other) for other in others):
            raise self._asymmetric(sum(factor * function for function, factor in first.items()))
        return total + sum(factor * self._sum(function).value for function, factor in first.items())

    def _asymmetric(self, term: Term) -> MaterialError:
        piece = str(term).replace("stretch", STRETCHES[0])
        return MaterialError(f"{self._name}: its energy is not symmetric in {', '.join(STRETCHES)}, near {piece[:60]}; {REMEDY}")

    def _sum(self, function: Term) -> Sum:
        """The Sum of a function of one stretch, made once for each function."""
        import sympy

        for each in self.sums:
            if each.function == function:
                return each
        if function.free_symbols & set(invariant_symbols()):
            raise MaterialError(f"{self._name}: its energy joins a principal stretch and an invariant in one function; {REMEDY}")
        switches = {f.func.__name__ for f in function.atoms(sympy.Function)} & {
            "positive",
            "step",
            "Heaviside",
            "Max",
            "Min",
            "Abs",
        }
        if switches:
            raise MaterialError(
                f"{self._name}: its energy switches ({', '.join(sorted(switches))}) on a principal stretch; {REMEDY}"
            )
        made = Sum(function, tuple(sympy.Symbol(f"S{len(self.sums)}_{place}", real=True) for place in range(6)))
        self.sums.append(made)
        return made


def stretch_symbols() -> tuple[Any, ...]:
    """SymPy's symbols of the three stretches: positive, so that powers of products are products of powers."""
    import sympy

    return tuple(sympy.symbols(STRETCHES, positive=True))


def invariant_symbols() -> tuple[Any, ...]:
    """SymPy's symbols of the invariants, those of a second family of fibres behind the others."""
    import sympy

    return tuple(sympy.symbols((*INVARIANTS, *SECOND_FAMILY), real=True))


def stretch() -> Any:
    """The symbol of a stretch in the function of a Sum."""
    import sympy

    return sympy.Symbol("stretch", positive=True)


def _stretches_in(term: Term) -> set[Any]:
    return term.free_symbols & set(stretch_symbols()) if hasattr(term, "free_symbols") else set()


def _factors(product: Term) -> list[Term]:
    """The factors of a product, those in one stretch as a single one, because l1 l2 l3 = 1."""
    single = [factor for factor in product.args if len(_stretches_in(factor)) == 1]
    others = [factor for factor in product.args if len(_stretches_in(factor)) != 1]
    return [product.func(*single), *others]


def _reduced(term: Term) -> Term:
    """A term in one stretch or none, where l1 l2 l3 = 1 allows that: (l1 l2)^a is l3^-a."""
    if len(_stretches_in(term)) < 2 or term.is_Add:
        return term
    for symbol in stretch_symbols():
        first, second = (other for other in stretch_symbols() if other != symbol)
        shorter = term.subs(symbol, 1 / (first * second))
        if len(_stretches_in(shorter)) < 2:
            return shorter
    return term


def _equal(first: dict[Term, Term], other: dict[Term, Term]) -> bool:
    """Whether two sums of functions times factors are one, as written or by values at numbers that are nothing special."""
    if first == other:
        return True
    import sympy

    a, b = (sum(factor * function for function, factor in each.items()) for each in (first, other))
    free = sorted((sympy.sympify(a) - b).free_symbols, key=str)
    values = sympy.lambdify(free, [a, b], [ON_ARRAYS, "numpy"], cse=True, dummify=True)
    with np.errstate(all="ignore"):
        for start in (0.731, 0.877, 1.129):
            x, y = values(*(np.float64(start + 0.0917 * place) for place in range(len(free))))
            if not (np.isfinite(x) and abs(x - y) <= 1e-11 * abs(x)):
                return False
    return True
