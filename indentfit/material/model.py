"""What a material is: named parameters and an energy in isochoric invariants.

Units: kPa for energies (per reference volume), stresses and moduli. SymPy is imported when a first energy is derived, not with this
module; the moduli of the laws that indentfit ships need no derivation.
"""

import inspect
import math
from collections.abc import Callable, Mapping
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from indentfit.arrays import Array
from indentfit.errors import MaterialError
from indentfit.material.derive import Derived, Law, derive, has_two_families, proportional
from indentfit.material.functions import Term
from indentfit.material.jets import Jet, at_rest, value_at
from indentfit.material.kinematics import INVARIANTS, REST, REST_OF_TWO, SECOND_FAMILY, determinant, invariants
from indentfit.material.parameter import Parameter
from indentfit.material.small_strain import moduli_of_two, young
from indentfit.material.stretches import STRETCHES
from indentfit.material.trials import trial_fibres, trial_states, trial_values
from indentfit.material.words import nearest

FIRST_FAMILY = ("I4", "I5")
TRIALS = 20  # states in which families of fibres change places
GROUP = "indentfit.materials"
"""Package of the laws that indentfit ships, and entry-point group that packages register their materials in."""


class Material:
    """Base class of materials: the fields are `Parameter`s, the one method `energy` is psi in kPa.

    `energy` names in its signature the invariants that it uses, some of `INVARIANTS`, `SECOND_FAMILY` and `STRETCHES`, and is
    written with + - * / ** and the functions of this package (exp, log, sqrt, positive). Principal stretches l1, l2, l3 come in
    sums over them, such as l1**a + l2**a + l3**a. The derivatives are derived from the energy once per class; those by I1 and I2
    contain the stretches' share, because isochoric stretches are functions of I1 and I2.
    Instances are frozen and can be pickled. Arrays of invariants have shape (4, ...), in the order of `INVARIANTS`; where the
    energy uses an invariant of a second family of fibres, (7, ...), with `SECOND_FAMILY` behind. A class whose formula holds for
    families at right angles only says `perpendicular = True`; one that uses I8 need not say so.

    Parameters
    ----------
    **values : float
        Values of all parameters by name, in their units.

    Raises
    ------
    MaterialError
        A value is missing, unknown or not admissible.
    """

    parameters: ClassVar[dict[str, Parameter]] = {}
    scale: ClassVar[str | None] = None
    invariants: ClassVar[tuple[str, ...]] = ()
    two_families: ClassVar[bool] = False
    perpendicular: ClassVar[bool] = False
    energy: ClassVar[Callable[..., Any]]
    _derivatives: ClassVar[Derived]  # made by `require_derivable`
    _source: ClassVar[tuple[Any, ...]]  # where a pickle finds a class that cannot be imported: a function and its arguments

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        for name, value in vars(cls).items():
            if isinstance(value, Parameter) and hasattr(Material, name):
                raise MaterialError(f"{cls.__name__}: a parameter cannot be called {name!r}, every material has that")
        fields = {name: value for base in reversed(cls.__mro__) for name, value in vars(base).items()}
        cls.parameters = {name: value for name, value in fields.items() if isinstance(value, Parameter)}
        cls.scale = _claimed_scale(cls)
        cls.invariants = _named_invariants(cls)
        cls.two_families = has_two_families(cls.invariants)
        cls.perpendicular = cls.perpendicular or "I8" in cls.invariants

    def __init__(self, **values: Any) -> None:
        cls = type(self)
        _refuse_wrong_names(cls, values)
        self.__dict__.update({n: p.admitted(values[n], f"{cls.__name__}: {n}") for n, p in cls.parameters.items()})

    @property
    def values(self) -> dict[str, float]:
        """The parameters' values by name, in the order of their definition."""
        return {name: self.__dict__[name] for name in self.parameters}

    def replace(self, **values: Any) -> Self:
        """The same material with some values changed; raises MaterialError as the class does."""
        return type(self)(**{**self.values, **values})

    def psi(self, I: ArrayLike) -> Array:
        """Energy psi.

        Parameters
        ----------
        I : array (4, ...)
            Invariants. Wild states give inf or nan.

        Returns
        -------
        array (...), kPa

        Raises
        ------
        MaterialError
            The energy cannot be used, as `require_derivable` says.
        """
        return require_derivable(type(self)).psi(I, self.values.values())

    def gradient(self, I: ArrayLike) -> Array:
        """First derivatives d psi/dI; zero for invariants that the energy does not use.

        Parameters
        ----------
        I : array (4, ...)
            Invariants.

        Returns
        -------
        array (4, ...), kPa

        Raises
        ------
        MaterialError
            As `psi` does.
        """
        return require_derivable(type(self)).gradient(I, self.values.values())

    def hessian(self, I: ArrayLike) -> Array:
        """Second derivatives d2 psi/dI dI, symmetric.

        Parameters
        ----------
        I : array (4, ...)
            Invariants.

        Returns
        -------
        array (4, 4, ...), kPa

        Raises
        ------
        MaterialError
            As `psi` does.
        """
        return require_derivable(type(self)).hessian(I, self.values.values())

    def parameter_gradient(self, I: ArrayLike) -> Array:
        """Derivatives d2 psi/(dI dtheta) by invariants and parameters.

        Parameters
        ----------
        I : array (4, ...)
            Invariants.

        Returns
        -------
        array (n_parameters, 4, ...), kPa per unit of the parameter

        Raises
        ------
        MaterialError
            As `psi` does.
        """
        return require_derivable(type(self)).parameter_gradient(I, self.values.values())

    @property
    def rest(self) -> Array:
        """Values of the invariants in the undeformed state, (4,) or (7,); two families are at right angles there."""
        return REST_OF_TWO if self.two_families else REST

    @property
    def shear_modulus(self) -> float:
        """Small-strain shear modulus in the plane across the fibres, 2 (psi_1 + psi_2) at rest, kPa.

        Raises
        ------
        MaterialError
            The modulus is not positive, or the energy cannot be used.
        """
        gradient = self._rest.gradient if self._rest else self.gradient(self.rest)
        modulus = float(2 * gradient[:2].sum())
        if not math.isfinite(modulus):
            raise MaterialError(f"{self!r} has no finite shear modulus at rest: its formula divides by zero, or has no value there")
        if not modulus > 0:
            raise MaterialError(f"{self!r} has a shear modulus of {modulus:g} kPa at rest; it must be positive")
        return modulus

    def moduli(self) -> dict[str, float]:
        """Small-strain moduli of the incompressible material.

        F = exp(e) with tr e = 0 in the invariants gives, with psi_4 + 2 psi_5 = 0 (no stress at rest),
        psi = m tr e^2 + A (a0.e a0)^2 + 4 psi_5 (|e a0|^2 - (a0.e a0)^2) to second order, where
        m = mu_across and A = 4 psi_5 + 2 psi_44 + 8 psi_45 + 8 psi_55. A fibre that only resists extension is slack
        here.

        Returns
        -------
        dict of str to float, kPa
            mu_across: shear in the plane across the fibres; mu_along: shear along the fibres; E_along, E_across: Young's moduli.
            Of two families, at right angles here: mu, shear without fibres, and Young's moduli E_first, E_second and E_normal.

        Raises
        ------
        MaterialError
                mu_across is not positive, or the energy cannot be used.
        """
        m, rest = self.shear_modulus, self._rest
        if self.two_families:
            return moduli_of_two(m, *self.derivatives_at_rest)
        psi_5, H = (rest.gradient[3], rest.hessian) if rest else (self.gradient(REST)[3], self.hessian(REST))
        A = 4 * psi_5 + 2 * H[2, 2] + 8 * H[2, 3] + 8 * H[3, 3]
        along, across = 3 * m + 2 * A, 4 * m - 2 * m**2 / (2 * m + A)  # across: free to strain along the fibre
        return {"mu_across": m, "mu_along": float(m + 2 * psi_5), "E_along": float(along), "E_across": float(across)}

    @property
    def derivatives_at_rest(self) -> tuple[Array, Array]:
        """First and second derivatives of the energy by the invariants in the undeformed state, kPa."""
        rest = self._rest
        return (rest.gradient, rest.hessian) if rest else (self.gradient(self.rest), self.hessian(self.rest))

    def young_modulus(self, fibres: Array, axis: Array) -> float:
        """Young's modulus at small strain along an axis (3,), kPa, with directions of the fibres (3,) or (2, 3)."""
        return young(self.shear_modulus, *self.derivatives_at_rest, fibres, axis)

    @property
    def unstable(self) -> str:
        """The small-strain moduli that are not positive, in words; empty where the material is stable at small strain."""
        try:
            wrong = {name: value for name, value in self.moduli().items() if not value > 0}
        except MaterialError as error:
            return str(error)
        return ", ".join(f"{name} = {value:.3g} kPa" for name, value in wrong.items())

    @cached_property
    def _rest(self) -> Jet | None:
        """The derivatives at rest of a law that indentfit ships, without SymPy; None where `gradient` and `hessian` must be asked.

        Other laws are derived when a case is read, so jets would save no time there. Jets would also change the last bits of the
        moduli of a law with functions, and a search amplifies round-off until its results change visibly.
        """
        return at_rest(law_of(type(self)).energy, self.values, self.two_families) if shipped(type(self)) else None

    def __setattr__(self, name: str, value: Any) -> None:
        raise AttributeError(f"a material is frozen: use replace({name}=...)")

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other) and isinstance(other, Material) and self.values == other.values

    def __hash__(self) -> int:
        return hash((type(self), *self.values.values()))

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join(f'{n}={v:g}' for n, v in self.values.items())})"

    def __reduce__(self) -> tuple[Any, ...]:
        return _rebuilt, (vars(type(self)).get("_source", type(self)), self.values)


def _rebuilt(source: Any, values: Mapping[str, float]) -> Material:
    """A material from its pickle; `source` is the class, or a function that makes the class, with the function's arguments."""
    return (source if isinstance(source, type) else source[0](*source[1:]))(**values)


def _claimed_scale(cls: type[Material]) -> str | None:
    scales = [name for name, parameter in cls.parameters.items() if parameter.scale]
    if len(scales) > 1:
        raise MaterialError(f"{cls.__name__}: only one parameter can be the scale, not {', '.join(scales)}")
    return scales[0] if scales else None


def _named_invariants(cls: type[Material]) -> tuple[str, ...]:
    if not hasattr(cls, "energy"):
        return ()
    names = tuple(inspect.signature(cls.energy).parameters)[1:]
    for name in names:
        if name not in (*INVARIANTS, *SECOND_FAMILY, *STRETCHES):
            known = ", ".join((*INVARIANTS, *SECOND_FAMILY, *STRETCHES))
            raise MaterialError(f"{cls.__name__}: its energy asks for {name!r}; invariants: {known}")
    return names


def _refuse_wrong_names(cls: type[Material], values: Mapping[str, Any]) -> None:
    for name in values:
        if name not in cls.parameters:
            known = f"{', '.join(cls.parameters)}{nearest(name, cls.parameters)}"
            raise MaterialError(f"{cls.__name__} has no parameter {name!r}; it has: {known}")
    missing = [name for name in cls.parameters if name not in values]
    if missing:
        raise MaterialError(f"{cls.__name__}: no value for {', '.join(missing)}")


def shipped(cls: type[Material]) -> bool:
    """Whether indentfit ships the law: the tests derive such a law, and compare its moduli by jets with those by SymPy."""
    return cls.__module__.startswith(f"{GROUP}.")


def require_derivable(cls: type[Material]) -> Derived:
    """The energy's compiled derivatives, derived and checked once per class.

    Reading a case calls this function for laws that are not indentfit's own, so that a wrong law is refused before any solve. The
    first parameter that the energy of such a law is proportional to becomes its scale, where it states none.

    Parameters
    ----------
    cls : class of Material

    Returns
    -------
    Derived

    Raises
    ------
    MaterialError
        The class has no energy, or its energy cannot be used, as `derive` says.
    """
    if "_derivatives" not in vars(cls):  # a subclass has its own
        if not hasattr(cls, "energy"):
            raise MaterialError(f"{cls.__name__} has no method `energy`")
        law = law_of(cls)
        cls._derivatives = derived = derive(law)
        if cls.scale is None and not shipped(cls):
            cls.scale = next((name for name in cls.parameters if proportional(law, derived, name)), None)
    return cls._derivatives


def exchangeable(cls: type[Material], fixed: tuple[tuple[str, float], ...]) -> bool:
    """Whether the two families of fibres of a law can change places: psi(a0, b0) = psi(b0, a0) at random states and values.

    Parameters
    ----------
    cls : class of Material
    fixed : tuple of (name, value)
        Parameters that have these values; the others have any.
    """
    rng = np.random.default_rng(3)
    compared, energy = False, law_of(cls).energy
    F, a0 = trial_states(rng, TRIALS)  # states of a body: invariants at random would leave fibres slack that states can pull
    fibres = trial_fibres(a0, rng, cls.perpendicular)
    stretches = np.linalg.svd(np.moveaxis(F / np.cbrt(determinant(F)), -1, 0), compute_uv=False).T
    both = [np.vstack([invariants(F, pair), stretches]).T for pair in (fibres, fibres[::-1])]
    for states in zip(*both, strict=True):
        theta = {**trial_values(cls.parameters, rng), **dict(fixed)}
        named = (dict(zip((*INVARIANTS, *SECOND_FAMILY, *STRETCHES), state, strict=True)) for state in states)
        values = [value_at(energy, theta, I) for I in named]
        if values[0] is None or values[1] is None:
            continue
        compared = True
        if abs(values[0] - values[1]) > 1e-9 * abs(values[0]):
            return False
    return compared


def law_of(cls: type[Material]) -> Law:
    """What `derive` needs to know of the class."""

    def energy(values: Mapping[str, Term], named: Mapping[str, Term]) -> Term:
        """psi of terms instead of numbers; `__init__` would refuse terms."""
        template = object.__new__(cls)
        template.__dict__.update(values)
        return template.energy(**{name: named[name] for name in cls.invariants})

    return Law(cls.__name__, cls.parameters, cls.scale, cls.invariants, energy)
