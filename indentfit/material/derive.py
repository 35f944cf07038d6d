"""From an energy to its compiled derivatives: SymPy differentiates, NumPy evaluates."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from indentfit.arrays import Array
from indentfit.errors import MaterialError
from indentfit.material.functions import ON_ARRAYS, Term, algebra
from indentfit.material.kinematics import INVARIANTS, REST, REST_OF_TWO, SECOND_FAMILY, invariants
from indentfit.material.parameter import Parameter
from indentfit.material.separable import Stretched, Sums, invariant_symbols, stretch_symbols
from indentfit.material.stretches import STRETCHES
from indentfit.material.trials import trial_fibres, trial_states, trial_values
from indentfit.material.words import one_line

Place = tuple[int, ...]
Entries = dict[tuple[Place, ...], Any]
"""SymPy expressions by the places of an array that each of them fills."""


@dataclass(frozen=True)
class Law:
    """What derivation needs to know of a class of material.

    Parameters
    ----------
    name : str
        The class's name, for messages.
    parameters : mapping of names to Parameter
    scale : str or None
        The parameter that the energy claims to be proportional to.
    invariants : tuple of str
        The invariants that the energy uses.
    energy : function
        psi, kPa, of the parameters' values by name and all invariants by name, principal stretches among them.
    """

    name: str
    parameters: Mapping[str, Parameter]
    scale: str | None
    invariants: tuple[str, ...]
    energy: Callable[[Mapping[str, Term], Mapping[str, Term]], Term]

    @property
    def names(self) -> tuple[str, ...]:
        """The invariants in their order: four, or seven where the law has two families of fibres."""
        return (*INVARIANTS, *SECOND_FAMILY) if has_two_families(self.invariants) else INVARIANTS

    @property
    def rest(self) -> Array:
        """Values of the invariants in the undeformed state; of two families those at right angles."""
        return REST_OF_TWO if has_two_families(self.invariants) else REST


def has_two_families(invariants: Iterable[str]) -> bool:
    """Whether an energy of these invariants has two families of fibres."""
    return not set(SECOND_FAMILY).isdisjoint(invariants)


@dataclass(frozen=True)
class Compiled:
    """An array of derivatives, as one compiled function for all of its entries that are not identically zero.

    Parameters
    ----------
    shape : tuple of int
        Shape of the array at one state.
    places : tuple
        The entry of the array that each value of the function fills, in the order of the function's values.
    function : function
        Values of the entries, at the invariants, the values of `sums` and the parameters.
        Behind its values stand the arguments of the energy's logarithms: all entries are nan where one of them is not positive,
        because the derivatives of a logarithm would go on where the energy ends.
    sums : Sums
        Sums over the principal stretches that the entries need.
    count : int
        Number of invariants, 4 or 7.
    """

    shape: tuple[int, ...]
    places: tuple[tuple[Place, ...], ...]
    function: Callable[..., Any]
    sums: Sums
    count: int = len(INVARIANTS)

    def __call__(self, I: ArrayLike, theta: Iterable[float]) -> Array:
        """The array of derivatives at invariants and values of the parameters.

        Parameters
        ----------
        I : array (4, ...) or (7, ...)
        theta : numbers
            Values of the parameters in their order, in their units.

        Returns
        -------
        array (*shape, ...)
        """
        I = np.asarray(I, float)
        if I.shape[:1] != (self.count,):
            raise ValueError(f"invariants have shape ({self.count}, ...), not {I.shape}")
        out = np.zeros((*self.shape, *I.shape[1:]))
        numbers = [np.float64(value) for value in theta]  # Python's floats would raise
        with np.errstate(all="ignore"):
            values = self.function(*I, *self.sums(I, numbers), *numbers)
            for places, value in zip(self.places, values, strict=False):  # the guards stand behind
                for place in places:
                    out[place] = value
            for argument in values[len(self.places) :]:
                out[..., ~np.asarray(argument > 0)] = np.nan
        return out


class Derived(NamedTuple):
    """The energy and its derivatives by the invariants and the parameters, as `Material` describes them."""

    psi: Compiled
    gradient: Compiled
    hessian: Compiled
    parameter_gradient: Compiled


def derive(law: Law) -> Derived:
    """The compiled derivatives of a law, after the checks that make it usable.

    Parameters
    ----------
    law : Law

    Returns
    -------
    Derived

    Raises
    ------
    MaterialError
        The energy cannot be evaluated or differentiated twice, does not depend on a parameter, is not finite or not free of
        stress at rest, or is not proportional to the parameter that claims to be its scale.
    """
    I, theta, energy = _symbolic(law)
    stretched = Stretched(energy, law.name)
    used = [(i, I[i]) for i, name in enumerate(law.names) if name in law.invariants or (i < 2 and stretched.sums)]
    n = len(law.names)
    first = {i: stretched.by_invariant(stretched.psi, x, i) for i, x in used}
    second: Entries = {((i, j), (j, i)): stretched.by_invariant(first[i], y, j) for i, _ in used for j, y in used if j >= i}
    mixed: Entries = {((k, i),): stretched.by_parameter(first[i], t) for k, t in enumerate(theta) for i, _ in used}
    gradient: Entries = {((i,),): entry for i, entry in first.items()}
    arrays: list[tuple[tuple[int, ...], Entries, int]] = [
        ((), {((),): stretched.psi}, 0),
        ((n,), gradient, 1),
        ((n, n), second, 2),
        ((len(theta), n), mixed, 1),
    ]
    derived = Derived(*(_compiled(law, stretched, (I, theta), *array) for array in arrays))
    _refuse_stress_at_rest(law, derived)
    _refuse_odd(law, derived)
    if law.scale and not proportional(law, derived, law.scale):
        raise MaterialError(f"{law.name}: {law.scale} claims to be the scale; the energy is not proportional to it")
    return derived


def _symbolic(law: Law) -> tuple[tuple[Any, ...], tuple[Any, ...], Any]:
    """Symbols of the invariants and of the parameters, and the energy in them."""
    import sympy

    every = invariant_symbols()
    I = every[: len(law.names)]
    theta = {name: sympy.Symbol(name, real=True) for name in law.parameters}
    try:
        named = dict(zip((*INVARIANTS, *SECOND_FAMILY, *STRETCHES), (*every, *stretch_symbols()), strict=True))
        psi = sympy.sympify(law.energy(theta, named)).replace(sympy.Abs, algebra().abs)
    except MaterialError:
        raise
    except Exception as error:
        message = f"{law.name}: its energy cannot be derived ({one_line(error)})"
        raise MaterialError(f"{message}; use + - * / ** and exp, log, sqrt, positive of indentfit.material") from error
    unused = [name for name, symbol in theta.items() if symbol not in psi.free_symbols]
    if unused:
        raise MaterialError(f"{law.name}: its energy does not depend on {', '.join(unused)}")
    return I, tuple(theta.values()), psi


def _compiled(
    law: Law,
    stretched: Stretched,
    known: tuple[tuple[Any, ...], tuple[Any, ...]],
    shape: tuple[int, ...],
    entries: Entries,
    order: int,
) -> Compiled:
    """The entries that are not identically zero, as one NumPy function; known: symbols of the invariants and of the parameters.

    order: how far sums over stretches are differentiated in the entries.
    """
    import sympy

    # No simplification anywhere: expressions are evaluated as differentiated, with common parts computed once.
    entries = {places: expression for places, expression in entries.items() if expression != 0}
    if any(e.has(sympy.DiracDelta, sympy.Derivative, sympy.Subs) for e in entries.values()):
        raise MaterialError(f"{law.name}: its energy cannot be differentiated twice; write switches as positive(x)")
    if any(e.has(sympy.I, sympy.nan, sympy.zoo, sympy.oo, -sympy.oo) for e in entries.values()):
        raise MaterialError(f"{law.name}: its energy or a derivative of it is not a finite real number")
    I, theta = known
    varying = {*I, *(symbol for each in stretched.sums for symbol in each.symbols)}
    guards = [log.args[0] for log in sorted(stretched.psi.atoms(sympy.log), key=str) if log.free_symbols & varying]
    results = [*entries.values(), *guards]
    more, sums = stretched.compiled(theta, results, order)
    function = sympy.lambdify((*I, *more, *theta), results, [ON_ARRAYS, "numpy"], cse=True, dummify=True)
    return Compiled(shape, tuple(entries), function, sums, len(law.names))


def _refuse_stress_at_rest(law: Law, derived: Derived) -> None:
    """An isochoric stress at rest can come from the fibre terms only: psi_4 + 2 psi_5 must vanish there, of a second family also
    psi_6 + 2 psi_7, and psi_8.

    The sums must vanish on either side of rest too: a switched term linear in I4 - 1 would make the stress jump.
    """
    sides = law.rest[:, None] + 1e-12 * np.outer([0, 0, 1, 2, 1, 2, 0][: len(law.rest)], [0, 1, -1])
    rng, finite = np.random.default_rng(0), False
    for values in [trial_values(law.parameters, rng) for _ in range(12)]:
        theta = values.values()
        gradient = derived.gradient(sides, theta)
        if not all(np.isfinite(array).all() for array in (*(compiled(law.rest, theta) for compiled in derived[1:]), gradient)):
            continue  # outside what the energy admits, e.g. the square root of a negative parameter
        stresses = {"psi_4 + 2 psi_5": gradient[2] + 2 * gradient[3]}
        if len(law.rest) > len(REST):
            stresses |= {"psi_6 + 2 psi_7": gradient[4] + 2 * gradient[5], "psi_8": gradient[6]}
        which = max(stresses, key=lambda name: float(np.max(np.abs(stresses[name]))))
        finite, stress = True, float(np.max(np.abs(stresses[which])))
        if stress > 1e-6 * np.abs(gradient).max():
            at = ", ".join(f"{name}={value:g}" for name, value in values.items())
            raise MaterialError(
                f"{law.name}: its fibres are stressed at rest: {which} must be 0 at {_rest_words(law)}, "
                f"but is {stress:.3g} kPa for {law.name}({at})"
            )
    if not finite:
        raise MaterialError(f"{law.name}: its derivatives are not finite at rest (I1 = I2 = 3, {_rest_words(law)})")


def _rest_words(law: Law) -> str:
    return "I4 = I5 = 1" if len(law.names) == len(INVARIANTS) else "I4 = I5 = I6 = I7 = 1, I8 = 0"


def _refuse_odd(law: Law, derived: Derived) -> None:
    """A direction and its opposite are the same fibres, but I8 changes its sign with one of them: the energy must be even in it."""
    if "I8" not in law.invariants:
        return
    rng = np.random.default_rng(2)
    I = _trial_invariants(law, rng)
    for theta in [trial_values(law.parameters, rng) for _ in range(3)]:
        here, there = (derived.psi(J, theta.values()) for J in (I, I * np.array([1, 1, 1, 1, 1, 1, -1.0])[:, None]))
        finite = np.isfinite(here) & np.isfinite(there)
        if np.any(np.abs(here - there)[finite] > 1e-9 * np.abs(here[finite]).max(initial=0)):
            text = "a direction and its opposite are the same fibres, so that only even powers of I8 can count; write I8**2"
            raise MaterialError(f"{law.name}: its energy changes with the sign of I8; {text}")


def _trial_invariants(law: Law, rng: "np.random.Generator") -> Array:
    """Invariants at random states."""
    F, a0 = trial_states(rng, 12)
    return invariants(F, trial_fibres(a0, rng) if has_two_families(law.invariants) else a0)


def proportional(law: Law, derived: Derived, name: str) -> bool:
    """Whether the energy is proportional to a parameter: psi(3 s) = 3 psi(s) to round-off at random states.

    Numbers decide, because a symbolic test for zero fails on some true identities.

    Parameters
    ----------
    law : Law
    derived : Derived
        The law's derivatives.
    name : str
        The parameter.
    """
    rng, compared = np.random.default_rng(1), False
    I = _trial_invariants(law, rng)
    for theta in [trial_values(law.parameters, rng) for _ in range(6)]:
        single = derived.psi(I, theta.values())
        triple = derived.psi(I, {**theta, name: 3 * theta[name]}.values())
        finite = np.isfinite(single) & np.isfinite(triple)
        compared |= bool(finite.any())
        single, triple = single[finite], triple[finite]
        if np.any(np.abs(triple / 3 - single) > 1e-10 * np.abs(single).max(initial=0)):
            return False
    return compared
