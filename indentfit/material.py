"""What a material is: an energy in isochoric invariants; finding, loading, typing and checking one.

Units: kPa for energies (per reference volume), stresses and moduli. SymPy is imported when a first
energy is derived, not with this module.
"""

import ast
import contextlib
import difflib
import inspect
import keyword
import math
import operator
import re
import sys
import traceback
import types
from collections.abc import Callable, Iterable, Mapping
from contextvars import ContextVar
from dataclasses import dataclass
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np

from indentfit.errors import IndentfitError, MaterialError

INVARIANTS = ("I1", "I2", "I4", "I5")
"""Invariants of Cb = J^(-2/3) F^T F: I1 = tr Cb, I2 = (I1^2 - tr Cb^2) / 2, I4 = a0.Cb a0, I5 = a0.Cb^2 a0."""

REST = np.array([3.0, 3.0, 1.0, 1.0])
"""Their values in the undeformed state, shape (4,)."""

GROUP = "indentfit.materials"
FUNCTIONS = ("exp", "log", "sqrt", "sinh", "cosh", "tanh", "abs", "positive")

# Limits of a typed energy: far above any published energy, far below what could stall the reader.
LENGTH, NODES, DEPTH, CALLS, POWER, NUMBER = 500, 150, 60, 4, 20, 1e15


@dataclass(frozen=True)
class Parameter:
    """One constant of a material: a class-level field of a `Material`.

    unit: text ("kPa", "1"); meaning: what it does, in words; min, max: inclusive bounds or None;
    scale: the whole energy is proportional to it.
    """

    unit: str
    meaning: str
    min: float | None = None
    max: float | None = None
    scale: bool = False

    def __get__(self, instance, owner=None) -> Any:
        # An instance's own value hides this: it only answers for the class.
        if instance is not None:
            raise AttributeError("this material has not been given its values")
        return self


class Material:
    """Base class of materials: the fields are `Parameter`s, the one method `energy` is psi in kPa.

    `energy` names in its signature the invariants it uses, some of `INVARIANTS`, and is written with + - * / **
    and the functions of this module (exp, log, sqrt, positive). Its derivatives are derived from it once per class.
    Instances are frozen and can be pickled. Arrays of invariants have shape (4, ...), in the order of `INVARIANTS`.
    """

    parameters: ClassVar[dict[str, Parameter]] = {}
    scale: ClassVar[str | None] = None
    invariants: ClassVar[tuple[str, ...]] = ()
    energy: ClassVar[Callable[..., Any]]

    def __init_subclass__(cls, **options):
        super().__init_subclass__(**options)
        for name, value in vars(cls).items():
            if isinstance(value, Parameter) and hasattr(Material, name):
                raise MaterialError(f"{cls.__name__}: a parameter cannot be called {name!r}, every material has that")
        fields = {name: value for base in reversed(cls.__mro__) for name, value in vars(base).items()}
        cls.parameters = {name: value for name, value in fields.items() if isinstance(value, Parameter)}
        cls.scale = _claimed_scale(cls)
        cls.invariants = _named_invariants(cls)

    def __init__(self, **values):
        """Values of all parameters by name, in their units. Raises MaterialError for any that is not admissible."""
        _refuse_wrong_names(type(self), values)
        self.__dict__.update({n: _admissible(type(self), n, values[n]) for n in self.parameters})

    @property
    def values(self) -> dict[str, float]:
        """The parameters' values by name, in the order of their definition."""
        return {name: self.__dict__[name] for name in self.parameters}

    def replace(self, **values):
        """The same material with some values changed."""
        return type(self)(**{**self.values, **values})

    def psi(self, I) -> np.ndarray:
        """Energy, kPa, shape (...). Wild states give inf or nan."""
        return _evaluated(_derived(type(self)).psi, (), I, self.values.values())

    def gradient(self, I) -> np.ndarray:
        """d psi/dI, kPa, shape (4, ...); zero for invariants that the energy does not use."""
        return _evaluated(_derived(type(self)).gradient, (4,), I, self.values.values())

    def hessian(self, I) -> np.ndarray:
        """d2 psi/dI dI, kPa, shape (4, 4, ...), symmetric."""
        return _evaluated(_derived(type(self)).hessian, (4, 4), I, self.values.values())

    def parameter_gradient(self, I) -> np.ndarray:
        """d2 psi/(dI dtheta), kPa per unit of the parameter, shape (n_parameters, 4, ...)."""
        derived = _derived(type(self)).parameter_gradient
        return _evaluated(derived, (len(self.parameters), 4), I, self.values.values())

    @property
    def shear_modulus(self) -> float:
        """Small-strain shear modulus in the plane across the fibres, 2 (psi_1 + psi_2) at rest, kPa.

        Raises MaterialError unless it is positive.
        """
        modulus = float(2 * self.gradient(REST)[:2].sum())
        if not (modulus > 0 and math.isfinite(modulus)):
            raise MaterialError(f"{self!r} has a shear modulus of {modulus:g} kPa at rest; it must be positive")
        return modulus

    def moduli(self) -> dict[str, float]:
        """Small-strain moduli of the incompressible material, kPa: mu_across, mu_along, E_along, E_across.

        mu_across: shear in the plane across the fibres; mu_along: shear along them; E: Young's moduli.
        F = exp(e) with tr e = 0 in the invariants gives, with psi_4 + 2 psi_5 = 0 (no stress at rest),
        psi = m tr e^2 + A (a0.e a0)^2 + 4 psi_5 (|e a0|^2 - (a0.e a0)^2) to second order, where
        m = mu_across and A = 4 psi_5 + 2 psi_44 + 8 psi_45 + 8 psi_55. A fibre that only resists extension is slack
        here. Raises MaterialError unless mu_across is positive.
        """
        m, psi_5, H = self.shear_modulus, self.gradient(REST)[3], self.hessian(REST)
        A = 4 * psi_5 + 2 * H[2, 2] + 8 * H[2, 3] + 8 * H[3, 3]
        along, across = 3 * m + 2 * A, 4 * m - 2 * m**2 / (2 * m + A)  # across: free to strain along the fibre
        return {"mu_across": m, "mu_along": float(m + 2 * psi_5), "E_along": float(along), "E_across": float(across)}

    @property
    def unstable(self) -> str:
        """Which small-strain moduli are not positive, in words; nothing where the material is stable at small strain."""
        try:
            wrong = {name: value for name, value in self.moduli().items() if not value > 0}
        except MaterialError as error:
            return str(error)
        return ", ".join(f"{name} = {value:.3g} kPa" for name, value in wrong.items())

    def __setattr__(self, name, value):
        raise AttributeError(f"a material is frozen: use replace({name}=...)")

    def __eq__(self, other):
        return type(self) is type(other) and self.values == other.values

    def __hash__(self) -> int:
        return hash((type(self), *self.values.values()))

    def __repr__(self):
        return f"{type(self).__name__}({', '.join(f'{n}={v:g}' for n, v in self.values.items())})"

    def __reduce__(self):
        return _rebuilt, (vars(type(self)).get("_source", type(self)), self.values)


def _rebuilt(source, values):
    """A material unpickled: its class is importable, or (function that makes it, its arguments)."""
    return (source if isinstance(source, type) else source[0](*source[1:]))(**values)


def _claimed_scale(cls):
    scales = [name for name, parameter in cls.parameters.items() if parameter.scale]
    if len(scales) > 1:
        raise MaterialError(f"{cls.__name__}: only one parameter can be the scale, not {', '.join(scales)}")
    return scales[0] if scales else None


def _named_invariants(cls):
    if not hasattr(cls, "energy"):
        return ()
    names = tuple(inspect.signature(cls.energy).parameters)[1:]
    for name in names:
        if name not in INVARIANTS:
            raise MaterialError(f"{cls.__name__}: its energy asks for {name!r}; invariants: {', '.join(INVARIANTS)}")
    return names


def _refuse_wrong_names(cls, values):
    for name in values:
        if name not in cls.parameters:
            known = f"{', '.join(cls.parameters)}{_nearest(name, cls.parameters)}"
            raise MaterialError(f"{cls.__name__} has no parameter {name!r}; it has: {known}")
    missing = [name for name in cls.parameters if name not in values]
    if missing:
        raise MaterialError(f"{cls.__name__}: no value for {', '.join(missing)}")


def _nearest(name, known):
    close = difflib.get_close_matches(name, list(known), 1)
    return f"; did you mean {close[0]!r}?" if close else ""


def _admissible(cls, name, value):
    """The value as a float if it is a finite number within the parameter's bounds, else MaterialError."""
    parameter, where = cls.parameters[name], f"{cls.__name__}: {name}"
    if isinstance(value, (bool, str)):
        raise MaterialError(f"{where} must be a number, not {value!r}")
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError):
        raise MaterialError(f"{where} must be a number, not {value!r}") from None
    if not math.isfinite(number):
        raise MaterialError(f"{where} must be finite, not {number}")
    if parameter.min is not None and number < parameter.min:
        raise MaterialError(f"{where} = {number:g} {parameter.unit} is below its minimum {parameter.min:g}")
    if parameter.max is not None and number > parameter.max:
        raise MaterialError(f"{where} = {number:g} {parameter.unit} is above its maximum {parameter.max:g}")
    return number


# The functions of an energy ------------------------------------------------------------------------------------------


def exp(x):
    """Exponential, for energies."""
    return _algebra().exp(x)


def log(x):
    """Natural logarithm, for energies."""
    return _algebra().log(x)


def sqrt(x):
    """Square root, for energies."""
    return _algebra().sqrt(x)


def positive(x):
    """Macaulay bracket max(x, 0), for energies: the switch of fibres that resist extension only.

    Its derivative is 1 for x > 0, else 0 (also at x = 0, so at rest such a fibre is slack).
    """
    return _algebra().positive(x)


class _Algebra(NamedTuple):
    """What an energy is written in."""

    exp: Any
    log: Any
    sqrt: Any
    sinh: Any
    cosh: Any
    tanh: Any
    abs: Any
    positive: Any


@cache
def _algebra():
    import sympy

    # Functions of our own. SymPy's Abs, Max and Heaviside would put Dirac pulses into the second derivatives;
    # its sinh, cosh and tanh ask whether they are real by polynomial algebra that can take minutes.
    def function(name, derivative, **more) -> Any:
        members = {"is_real": True, "fdiff": lambda self, argindex=1: derivative(self.args[0]), **more}
        return type(name, (sympy.Function,), members)

    step = function("step", lambda x: sympy.S.Zero, is_nonnegative=True)
    known = classmethod(lambda cls, x: sympy.Max(x, 0) if x.is_Number else None)
    positive = function("positive", step, is_nonnegative=True, eval=known)
    sinh: Any = function("sinh", lambda x: cosh(x))
    cosh: Any = function("cosh", sinh)
    tanh: Any = function("tanh", lambda x: 1 - tanh(x) ** 2)

    def absolute(x):
        return positive(x) + positive(-x)

    return _Algebra(sympy.exp, sympy.log, sympy.sqrt, sinh, cosh, tanh, absolute, positive)


# From the energy to its derivatives ----------------------------------------------------------------------------------


class _Compiled(NamedTuple):
    """The entries of an array that are not identically zero: where each goes, and a function of (I, theta)."""

    places: tuple[tuple[tuple[int, ...], ...], ...]
    function: Callable[..., Any]


class _Derived(NamedTuple):
    psi: _Compiled
    gradient: _Compiled
    hessian: _Compiled
    parameter_gradient: _Compiled


def _evaluated(compiled, shape, I, theta):
    """Array of shape (*shape, ...) with the compiled entries at the invariants I, shape (4, ...)."""
    I = np.asarray(I, float)
    if I.shape[:1] != (4,):
        raise ValueError(f"invariants have shape (4, ...), not {I.shape}")
    out, theta = np.zeros((*shape, *I.shape[1:])), [np.float64(value) for value in theta]  # floats would raise
    with np.errstate(all="ignore"):
        for places, value in zip(compiled.places, compiled.function(*I, *theta), strict=True):
            for place in places:
                out[place] = value
    return out


def _derived(cls) -> _Derived:
    """The energy's derivatives, derived and compiled once per class. Raises MaterialError for what can't be used."""
    if "_derivatives" not in vars(cls):  # a subclass has its own
        cls._derivatives = _derive(cls)
    return cls._derivatives


def _derive(cls):
    I, theta, psi = _symbolic(cls)
    used = [(i, I[i]) for i, name in enumerate(INVARIANTS) if name in cls.invariants]
    first = {i: psi.diff(x) for i, x in used}
    second = {((i, j), (j, i)): first[i].diff(y) for i, _ in used for j, y in used if j >= i}
    mixed = {((k, i),): first[i].diff(t) for k, t in enumerate(theta) for i, _ in used}
    gradient = {((i,),): entry for i, entry in first.items()}
    derived = _Derived(*(_compiled(cls, (*I, *theta), e) for e in ({((),): psi}, gradient, second, mixed)))
    _refuse_stress_at_rest(cls, derived)
    if cls.scale and not _proportional(cls, derived, cls.scale):
        raise MaterialError(f"{cls.__name__}: {cls.scale} claims to be the scale; the energy is not proportional to it")
    return derived


def _symbolic(cls):
    """Symbols of the invariants and of the parameters, and the energy in them."""
    import sympy

    if not hasattr(cls, "energy"):
        raise MaterialError(f"{cls.__name__} has no method `energy`")
    I = sympy.symbols(INVARIANTS, real=True)
    theta = {name: sympy.Symbol(name, real=True) for name in cls.parameters}
    template = object.__new__(cls)
    template.__dict__.update(theta)
    try:
        named = {name: x for name, x in zip(INVARIANTS, I, strict=True) if name in cls.invariants}
        psi = sympy.sympify(template.energy(**named)).replace(sympy.Abs, _algebra().abs)
    except MaterialError:
        raise
    except Exception as error:
        message = f"{cls.__name__}: its energy cannot be derived ({_one_line(error)})"
        raise MaterialError(f"{message}; use + - * / ** and exp, log, sqrt, positive of indentfit.material") from error
    unused = [name for name, symbol in theta.items() if symbol not in psi.free_symbols]
    if unused:
        raise MaterialError(f"{cls.__name__}: its energy does not depend on {', '.join(unused)}")
    return I, tuple(theta.values()), psi


def _compiled(cls, arguments, entries):
    """The entries {places: expression} that are not identically zero, as one NumPy function."""
    import sympy

    # No simplification anywhere: expressions are evaluated as differentiated, with common parts computed once.
    entries = {places: expression for places, expression in entries.items() if expression != 0}
    if any(e.has(sympy.DiracDelta, sympy.Derivative, sympy.Subs) for e in entries.values()):
        raise MaterialError(f"{cls.__name__}: its energy cannot be differentiated twice; write switches as positive(x)")
    if any(e.has(sympy.I, sympy.nan, sympy.zoo, sympy.oo, -sympy.oo) for e in entries.values()):
        raise MaterialError(f"{cls.__name__}: its energy or a derivative of it is not a finite real number")
    numbers = {"positive": lambda x: np.maximum(x, 0.0), "step": lambda x: np.greater(x, 0.0) * 1.0}
    function = sympy.lambdify(arguments, list(entries.values()), [numbers, "numpy"], cse=True, dummify=True)
    return _Compiled(tuple(entries), function)


def _refuse_stress_at_rest(cls, derived):
    """An isochoric stress at rest can come from the fibre terms only: psi_4 + 2 psi_5 must vanish there.

    Also on either side of rest: a switched term linear in I4 - 1 would make the stress jump.
    """
    sides = REST[:, None] + 1e-12 * np.outer([0, 0, 1, 2], [0, 1, -1])
    shapes = (4,), (4, 4), (len(cls.parameters), 4)
    finite = False
    for material in _samples(cls, np.random.default_rng(0), 12):
        theta = material.values.values()
        arrays = [_evaluated(compiled, shape, REST, theta) for compiled, shape in zip(derived[1:], shapes, strict=True)]
        gradient = _evaluated(derived.gradient, (4,), sides, theta)
        if not all(np.isfinite(a).all() for a in (*arrays, gradient)):
            continue  # outside what the energy admits, e.g. the square root of a negative parameter
        finite, stress = True, np.max(np.abs(gradient[2] + 2 * gradient[3]))
        if stress > 1e-6 * np.abs(gradient).max():
            raise MaterialError(
                f"{cls.__name__}: its fibres are stressed at rest: psi_4 + 2 psi_5 must be 0 at I4 = I5 = 1, "
                f"but is {stress:.3g} kPa for {material!r}"
            )
    if not finite:
        raise MaterialError(f"{cls.__name__}: its derivatives are not finite at rest (I1 = I2 = 3, I4 = I5 = 1)")


def _proportional(cls, derived, name):
    """Whether the energy is proportional to the parameter: psi(3 s) = 3 psi(s) to round-off at random states.

    Numbers decide: a symbolic test for zero fails on some true identities.
    """
    rng, compared = np.random.default_rng(1), 0
    I = invariants(*_states(rng, 12))
    for material in _samples(cls, rng, 6):
        theta = material.values
        one = _evaluated(derived.psi, (), I, theta.values())
        three = _evaluated(derived.psi, (), I, {**theta, name: 3 * theta[name]}.values())
        finite = np.isfinite(one) & np.isfinite(three)
        compared += finite.sum()
        one, three = one[finite], three[finite]
        if np.any(np.abs(three / 3 - one) > 1e-10 * np.abs(one).max(initial=0)):
            return False
    return bool(compared)


def _samples(cls, rng, n):
    """n materials with random admissible parameters: within bounds, or over two decades from the one bound."""
    return [cls(**{name: _sampled(parameter, rng) for name, parameter in cls.parameters.items()}) for _ in range(n)]


def _sampled(parameter, rng):
    low, high, decade = parameter.min, parameter.max, 10 ** rng.uniform(-1, 1)
    if low is not None and high is not None:
        if low > 0 and high > 10 * low:
            return low * (high / low) ** rng.uniform(0.05, 0.95)
        return low + (high - low) * rng.uniform(0.05, 0.95)
    if high is not None:
        return high - decade
    return decade + (low or 0.0)


# Finding and loading -------------------------------------------------------------------------------------------------

_permit: ContextVar[Callable[[str], None]] = ContextVar("permit", default=lambda code: None)


@contextlib.contextmanager
def foreign_code(permit):
    """Context in which permit(code) is called before code that is not indentfit's own is run, or taken from memory again.

    code: where it is, in words. permit may raise MaterialError. In other processes and threads nobody is asked: what they
    run was permitted here first.
    """
    token = _permit.set(permit)
    try:
        yield
    finally:
        _permit.reset(token)


def installed() -> dict[str, type[Material] | MaterialError]:
    """All installed materials by name, ours and third parties'; a broken one is given as its error."""
    found: dict[str, type[Material] | MaterialError] = {}
    for entry in _entries():
        name = entry.name
        if name in found:
            hidden = f"material {name!r} of {entry.value} is hidden: another material has that name"
            found[f"{name} ({entry.value})"] = MaterialError(hidden)
            continue
        try:
            found[name] = _from_entry(entry)
        except MaterialError as error:
            found[name] = error
    return found


def load(name) -> type[Material]:
    """The material class of an installed name, or of "path/to/file.py:Class". Raises MaterialError.

    The file is run: it is code. It is read again when it has changed.
    """
    name = str(name)
    path, colon, class_name = name.rpartition(":")
    if colon and path.endswith(".py"):
        return _from_file(Path(path).expanduser(), class_name)
    if name.endswith(".py"):
        raise MaterialError(f"material file {name[:200]!r} needs a class: write FILE.py:MyModel")
    entries = _entries()
    for entry in entries:
        if entry.name == name:
            return _from_entry(entry)
    known = sorted({entry.name for entry in entries})
    raise MaterialError(f"no material {name[:60]!r}; installed: {', '.join(known) or 'none'}{_nearest(name, known)}")


def _entries():
    """The entry points, ours first so that no other package can take their names."""
    return sorted(entry_points(group=GROUP), key=lambda entry: (not _ours(entry), entry.name))


def _ours(entry):
    return entry.value.startswith(f"{GROUP}.")


def _from_entry(entry):
    if not _ours(entry):
        _permit.get()(f"the installed {entry.value}")
    try:
        cls = entry.load()
    except (Exception, SystemExit) as error:
        raise MaterialError(f"material {entry.name!r} ({entry.value}) cannot be loaded: {_one_line(error)}") from error
    return _checked_class(cls, f"{entry.name!r} ({entry.value})")


def _from_file(path, class_name):
    """The class from a file."""
    module = _module(path)
    if class_name not in vars(module):
        here = [n for n, c in vars(module).items() if _is_material(c) and c.__module__ == module.__name__]
        known = f"{', '.join(here) or 'none'}{_nearest(class_name, here)}"
        raise MaterialError(f"{path} has no {class_name!r}; its materials: {known}")
    cls = _checked_class(vars(module)[class_name], f"{class_name!r} in {path}")
    if cls.__module__ == module.__name__:
        cls._source = (load, f"{path.resolve()}:{class_name}")
    return cls


def _is_material(cls):
    return isinstance(cls, type) and issubclass(cls, Material) and cls is not Material


def _checked_class(cls, where):
    if not _is_material(cls):
        raise MaterialError(f"{where} is not a subclass of indentfit.material.Material")
    return cls


_modules: dict[Path, tuple[tuple[int, int], Any]] = {}


def _module(path):
    """The file's module, run once for each state of the file so that a class stays one class within a process."""
    if not path.is_file():
        raise MaterialError(f"no material file {path}")
    path, stat = path.resolve(), path.stat()
    _permit.get()(f"the Python code in {path}")
    stamp = (stat.st_mtime_ns, stat.st_size)
    if path not in _modules or _modules[path][0] != stamp:
        name = f"indentfit_material_file_{len(_modules)}_{re.sub(r'[^0-9A-Za-z]', '_', path.stem)}"
        _modules[path] = stamp, _run(path, name)
    return _modules[path][1]


def _run(path, name):
    module = types.ModuleType(name)
    module.__file__ = str(path)
    sys.modules[name] = module  # dataclasses and pickle look there
    try:
        # Compiled here, not imported: a byte-code cache cannot tell two edits within one second apart.
        exec(compile(path.read_bytes(), str(path), "exec"), vars(module))
    except (Exception, SystemExit) as error:
        del sys.modules[name]
        raise MaterialError(f"{path}, line {_line(error, path)}: {_one_line(error)}") from error
    return module


def _line(error, path):
    """The line of the file that raised."""
    if isinstance(error, SyntaxError) and error.filename == str(path):
        return error.lineno
    lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == str(path)]
    return lines[-1] if lines else "?"


def _one_line(error):
    text = " ".join(str(error).split())
    return f"{type(error).__name__}: {text[:200]}" if text else type(error).__name__


# An energy typed in a case file --------------------------------------------------------------------------------------


def typed(energy: str, parameters: Iterable[str] | Mapping[str, Parameter]) -> type[Material]:
    """The material class of an energy typed as text, kPa, such as "mu/2 * ((I1 - 3) + zeta * (I4 - 1)^2)".

    Allowed: I1, I2, I4, I5, the parameters' names, numbers, + - * / ** ^ ( ) and `FUNCTIONS`; ^ is a power.
    Nothing is executed. `parameters` are names, or names with their `Parameter`. The first parameter that the energy
    is proportional to becomes the scale. Raises MaterialError that names the piece at fault.
    """
    if not isinstance(energy, str):
        raise MaterialError(f"an energy is text, not {type(energy).__name__}")
    if isinstance(parameters, str):
        raise MaterialError(f"the parameters of a typed energy are a list of names, not the text {parameters!r}")
    if isinstance(parameters, Mapping):
        for name, parameter in parameters.items():
            if not isinstance(parameter, Parameter):
                raise MaterialError(f"the parameter {name!r} must be a Parameter(unit, meaning), not {parameter!r}")
        return _typed(energy, tuple(parameters.items()))
    return _typed(energy, tuple((name, Parameter("", "of the typed energy")) for name in parameters))


@cache
def _typed(energy, parameters):
    _refuse_parameter_names([name for name, _ in parameters])
    cls = _typed_class(energy, _parsed(energy), dict(parameters))
    derived = _derived(cls)
    if cls.scale is None:
        cls.scale = next((name for name in cls.parameters if _proportional(cls, derived, name)), None)
    cls._source = (_typed, energy, parameters)
    return cls


def _refuse_parameter_names(names):
    for name in names:
        if not (isinstance(name, str) and name.isascii() and name.isidentifier() and not name.startswith("_")):
            raise MaterialError(f"a parameter cannot be called {repr(name)[:60]}: use letters, digits and _")
        if name in INVARIANTS or name in FUNCTIONS or keyword.iskeyword(name) or hasattr(Material, name):
            raise MaterialError(f"a parameter cannot be called {name!r}: that name has a meaning already")
    if len(set(names)) < len(names):
        raise MaterialError(f"a parameter is named twice: {', '.join(names)}")
    if not names:
        raise MaterialError("a typed energy needs at least one parameter")


def _parsed(text):
    """The syntax tree of the text, within the limits of length, characters and number of nodes."""
    if len(text) > LENGTH:
        raise MaterialError(f"the energy has {len(text)} characters; at most {LENGTH} are read")
    strange = re.search(r"[^A-Za-z0-9_+\-*/^().,\s]", text) or re.search(r"[^\x00-\x7f]", text)
    if strange:
        raise MaterialError(f"the energy has {strange[0]!r} at character {strange.start() + 1}, which it cannot use")
    line = " ".join(text.split()).replace("^", "**")
    try:
        tree = ast.parse(line, mode="eval").body
    except SyntaxError as error:
        near = line[max((error.offset or 1) - 1, 0) :][:20] or line[-20:]
        raise MaterialError(f"the energy cannot be read near {near!r}: {error.msg}") from None
    except (ValueError, MemoryError, RecursionError) as error:
        raise MaterialError(f"the energy cannot be read: {_one_line(error)}") from None
    if sum(isinstance(node, ast.expr) for node in ast.walk(tree)) > NODES:
        raise MaterialError(f"the energy is too long: more than {NODES} names, numbers and operations")
    if _nested(tree, ast.expr) > DEPTH:
        raise MaterialError(f"the energy is nested more than {DEPTH} deep")
    if _nested(tree, ast.Call) > CALLS:
        raise MaterialError(f"the energy has functions nested more than {CALLS} deep")
    return tree


def _nested(node, kind):
    """How many nodes of the kind lie within each other."""
    return isinstance(node, kind) + max((_nested(child, kind) for child in ast.iter_child_nodes(node)), default=0)


def _typed_class(text, tree, parameters):
    """The class whose energy builds the tree's expression."""
    named = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}
    used = [name for name in INVARIANTS if name in named]

    def energy(self, **I):
        psi = _built(tree, {**I, **{name: getattr(self, name) for name in parameters}})
        if isinstance(psi, float) or not any(symbol in psi.free_symbols for symbol in I.values()):
            raise MaterialError(f"the energy depends on none of {', '.join(INVARIANTS)}")
        return psi

    signature = [inspect.Parameter(name, inspect.Parameter.POSITIONAL_OR_KEYWORD) for name in ("self", *used)]
    energy.__signature__ = inspect.Signature(signature)  # type: ignore[attr-defined]
    return type("TypedEnergy", (Material,), {"__doc__": f"psi = {text}", "energy": energy, **parameters})


def _built(node, symbols, power=1):
    """The node's value: a float, or a SymPy expression. power: product of the exponents around the node.

    Numbers are folded as floats at once, so that SymPy never meets an integer or a constant that could explode.
    """
    match node:
        case ast.Constant(value=int() | float() as number) if not isinstance(number, bool):
            return _number(number, node)
        case ast.Name(id=name):
            return _symbol(name, symbols)
        case ast.UnaryOp(op=ast.USub(), operand=x):
            return -_built(x, symbols, power)
        case ast.UnaryOp(op=ast.UAdd(), operand=x):
            return _built(x, symbols, power)
        case ast.BinOp(op=ast.Pow()):
            return _raised(node, symbols, power)
        case ast.BinOp(op=ast.Add() | ast.Sub() | ast.Mult() | ast.Div() as op, left=left, right=right):
            x, y = (_built(side, symbols, power) for side in (left, right))
            return _combined(node, op, x, y)
        case ast.Call(func=ast.Name(id=name), args=[x], keywords=[]) if name in FUNCTIONS:
            return _applied(node, name, _built(x, symbols, power))
        case ast.Call(func=ast.Name(id=name)) if name in FUNCTIONS:
            raise MaterialError(f"{name} takes one argument, not {_piece(node)}")
        case ast.Call(func=ast.Name(id=name)):
            known = f"{', '.join(FUNCTIONS)}{_nearest(name, FUNCTIONS)}"
            raise MaterialError(f"an energy has no function {name!r}; allowed: {known}")
    raise MaterialError(f"an energy cannot contain {_piece(node)}: only names, numbers, + - * / ** ( ) and functions")


def _symbol(name, symbols):
    if name in symbols:
        return symbols[name]
    known = [*INVARIANTS, *(n for n in symbols if n not in INVARIANTS)]
    remedy = "give it its argument" if name in FUNCTIONS else f"known: {', '.join(known)}{_nearest(name, known)}"
    raise MaterialError(f"the energy names {name!r}, which is no parameter or invariant; {remedy}")


def _raised(node, symbols, power):
    """base ** exponent; the product of nested exponents is limited, and an exponent holds no power of its own."""
    if any(isinstance(inner, ast.Pow) for inner in ast.walk(node.right)):
        raise MaterialError(f"the energy has a power in an exponent: {_piece(node)}")
    exponent = _built(node.right, symbols)
    power = power * max(2.0, abs(exponent) if isinstance(exponent, float) else 0.0)
    if power > POWER:
        raise MaterialError(f"the energy has a power, or a product of nested powers, above {POWER}: {_piece(node)}")
    return _combined(node, node.op, _built(node.left, symbols, power), exponent)


def _combined(node, op, x, y):
    """x op y, folded if both are numbers."""
    import sympy

    if isinstance(op, ast.Div) and y == 0:
        raise MaterialError(f"the energy divides by zero: {_piece(node)}")
    apply = {ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul, ast.Div: operator.truediv}
    if not isinstance(op, ast.Pow):
        return _settled(node, apply[type(op)], x, y)
    if isinstance(y, float) and not isinstance(x, float):
        # x**2 and sqrt(x) are evaluated faster than x**2.0 and x**0.5.
        y = sympy.Rational(y) if (2 * y).is_integer() else y
    return _settled(node, operator.pow, x, y)


def _applied(node, name, x):
    if isinstance(x, float):
        folded = {"abs": abs, "positive": lambda x: max(x, 0.0)}
        return _settled(node, folded.get(name) or getattr(math, name), x)
    return _settled(node, getattr(_algebra(), name), x)


def _settled(node, function, *arguments):
    """function(*arguments); a result that is a number becomes a float within limits."""
    try:
        result = function(*arguments)
        constant = isinstance(result, (int, float, complex)) or result.is_number
        return _number(float(result), node) if constant else result
    except (ArithmeticError, ValueError, TypeError, RecursionError, MemoryError):
        raise MaterialError(f"the energy has a piece with no finite real value: {_piece(node)}") from None


def _number(number, node):
    if not abs(number) <= NUMBER:
        raise MaterialError(f"the energy has a number beyond {NUMBER:g}: {_piece(node)}")
    return float(number)


def _piece(node):
    """The node as text, for messages."""
    try:
        text = ast.unparse(node)
    except (RecursionError, ValueError):
        return "this"
    return repr(text if len(text) <= 40 else f"{text[:37]}...")


# Trusting no plugin --------------------------------------------------------------------------------------------------


@contextlib.contextmanager
def blamed(kind):
    """Context in which what the code of a material class raises becomes a MaterialError that names it, unless it is our own."""
    try:
        yield
    except (IndentfitError, MemoryError):
        raise
    except (Exception, SystemExit) as error:
        if kind.__module__.partition(".")[0] == "indentfit":
            raise
        raise MaterialError(f"the material {kind.__name__} failed ({_one_line(error)}); correct it") from error


def derivatives(material, name, I):
    """material.gradient(I) or material.hessian(I) as compiled loops read it, which look at no shape: (4, ...) or (4, 4, ...).

    Raises MaterialError where a plugin gives anything else.
    """
    found = np.ascontiguousarray(getattr(material, name)(I))
    shape = (4,) * {"gradient": 1, "hessian": 2}[name] + I.shape[1:]
    if found.shape != shape or found.dtype != float:
        kind = type(material).__name__
        raise MaterialError(f"{kind}.{name} gives {found.dtype} {found.shape}, not float64 {shape}; correct the material")
    return found


# Checking ------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Check:
    """One conformance check: detail holds the measured error and its tolerance, or what went wrong."""

    name: str
    ok: bool
    detail: str


def check(material_class, seed=0) -> list[Check]:
    """The conformance kit: checks of the class at random parameters, fibre directions and deformations (det F != 1).

    Independent of the symbolic derivatives: stress, tangent and parameter derivatives are held against central
    differences of the energy. Raises nothing for a wrong material: its checks are not ok.
    """
    rng = np.random.default_rng(seed)
    name = "the energy has derivatives"
    try:
        _derived(material_class)
        materials = _samples(material_class, rng, 5)
    except Exception as error:
        return [Check(name, False, str(error) if isinstance(error, MaterialError) else _one_line(error))]
    derived = Check(name, True, f"by {', '.join((*material_class.invariants, *material_class.parameters))}")
    states = _states(rng, 6)
    return [derived, *(_check(*kind, materials, states) for kind in CHECKS)]


def _check(name, measure, tolerance, materials, states):
    try:
        error = float(np.max([measure(material, *states) for material in materials]))
    except Exception as failure:
        return Check(name, False, str(failure) if isinstance(failure, MaterialError) else _one_line(failure))
    return Check(name, bool(error <= tolerance), f"error {error:.1e}, tolerance {tolerance:.0e}")  # nan is not ok


def invariants(F, a0):
    """The isochoric invariants, shape (4, ...), of deformation gradients F, shape (3, 3, ...), and unit fibre
    directions a0, shape (3, ...)."""
    C, J = np.einsum("ki...,kj...->ij...", F, F), _det(F)
    C = C * J ** (-2 / 3)
    Ca, trace = np.einsum("ij...,j...->i...", C, a0), np.einsum("ii...->...", C)
    second = (trace**2 - np.einsum("ij...,ij...->...", C, C)) / 2
    return np.stack([trace, second, np.einsum("i...,i...->...", a0, Ca), np.einsum("i...,i...->...", Ca, Ca)])


def invariant_gradients(F, a0):
    """dI/dF of the isochoric invariants, shape (4, 3, 3, ...); F, a0 as in `invariants`."""
    J, I = _det(F), invariants(F, a0)
    C = np.einsum("ki...,kj...->ij...", F, F)
    Ca, Fa = np.einsum("ij...,j...->i...", C, a0), np.einsum("ij...,j...->i...", F, a0)
    FC, FCa = np.einsum("ij...,jk...->ik...", F, C), np.einsum("ij...,j...->i...", F, Ca)
    inverse = np.moveaxis(np.linalg.inv(np.moveaxis(F, (0, 1), (-2, -1))), (-2, -1), (1, 0))  # F^-T
    outer = lambda x, y: np.einsum("i...,j...->ij...", x, y)  # noqa: E731
    full = [2 * F, 2 * (np.einsum("ii...->...", C) * F - FC), 2 * outer(Fa, a0), 2 * (outer(Fa, Ca) + outer(FCa, a0))]
    degree = [2, 4, 2, 4]  # of the invariant in F
    return np.stack([J ** (-n / 3) * D - n / 3 * i * inverse for n, D, i in zip(degree, full, I, strict=True)])


def isochoric_stress(material, F, a0):
    """First Piola stress of the isochoric energy, kPa, shape (3, 3, ...); F, a0 as in `invariants`."""
    return np.einsum("i...,ikl...->kl...", material.gradient(invariants(F, a0)), invariant_gradients(F, a0))


def _det(F):
    return np.linalg.det(np.moveaxis(F, (0, 1), (-2, -1)))


def _states(rng, n):
    """n random deformation gradients, shape (3, 3, n), det F in 0.5..2, and unit fibre directions, shape (3, n)."""
    F: list[np.ndarray] = []
    while len(F) < n:
        trial = np.eye(3) + 0.2 * rng.standard_normal((3, 3))
        F += [trial] if 0.5 < np.linalg.det(trial) < 2 else []
    a0 = rng.standard_normal((3, n))
    return np.moveaxis(np.array(F), 0, -1), a0 / np.linalg.norm(a0, axis=0)


def _differences(function, x, h=1e-5):
    """Central differences of function by the first two axes of x, appended in front: shape (3, 3, ...)."""
    step = [(i, j, h * np.eye(3)[i][:, None] * np.eye(3)[j]) for i in range(3) for j in range(3)]
    widen = (..., *[None] * (x.ndim - 2))
    out = [(function(x + e[widen]) - function(x - e[widen])) / (2 * h) for _, _, e in step]
    return np.reshape(out, (3, 3, *np.shape(out[0])))


def _relative(a, b, size=None):
    """The largest difference against the size, by default the largest entry of b."""
    return np.max(np.abs(a - b)) / (np.max(np.abs(b)) if size is None else size)


def _stress_at_rest(material, F, a0):
    swollen = np.eye(3)[..., None] * np.linspace(0.8, 1.3, a0.shape[1])
    return np.max(np.abs(isochoric_stress(material, swollen, a0))) / material.shear_modulus


def _objectivity(material, F, a0):
    Q = np.linalg.qr(np.random.default_rng(2).standard_normal((3, 3)))[0]
    Q = Q * np.sign(np.linalg.det(Q))
    turned, P = np.einsum("ij,jk...->ik...", Q, F), isochoric_stress(material, F, a0)
    psi = [material.psi(invariants(G, a0)) for G in (turned, F)]
    stress = isochoric_stress(material, turned, a0), np.einsum("ij,jk...->ik...", Q, P)
    return max(_relative(*psi), _relative(*stress))


def _stress(material, F, a0):
    numerical = _differences(lambda G: material.psi(invariants(G, a0)), F)
    return _relative(isochoric_stress(material, F, a0), numerical)


def _tangent(material, F, a0):
    """dP/dF from the Hessian, with the kinematic part by differences of dI/dF, against differences of the stress."""
    I, D = invariants(F, a0), invariant_gradients(F, a0)
    second = _differences(lambda G: invariant_gradients(G, a0), F)
    kinematic = np.einsum("a...,klaij...->klij...", material.gradient(I), second)
    tangent = np.einsum("ab...,aij...,bkl...->klij...", material.hessian(I), D, D) + kinematic
    return _relative(tangent, _differences(lambda G: isochoric_stress(material, G, a0), F))


def _major_symmetry(material, F, a0):
    H = material.hessian(invariants(F, a0))
    A = _differences(lambda G: isochoric_stress(material, G, a0), F)
    return max(np.max(np.abs(H - np.swapaxes(H, 0, 1))), _relative(np.einsum("klij...->ijkl...", A), A))


def _parameter_derivatives(material, F, a0):
    I, errors = invariants(F, a0), [0.0]
    for name, exact in zip(material.parameters, material.parameter_gradient(I), strict=True):
        h = 1e-5 * abs(material.values[name])
        gradients = [material.replace(**{name: material.values[name] + d}).gradient(I) for d in (h, -h)]
        # Against the stress too: a parameter may act on nothing at these states (slack fibres).
        size = max(np.max(np.abs(exact)), np.max(np.abs(gradients[0])) / abs(material.values[name]))
        errors.append(_relative((gradients[0] - gradients[1]) / (2 * h), exact, size))
    return max(errors)


def _scale(material, F, a0):
    if material.scale is None:
        return 0.0
    s = _sampled(material.parameters[material.scale], np.random.default_rng(3))
    I, other, ratio = invariants(F, a0), material.replace(**{material.scale: s}), s / material.values[material.scale]
    return max(_relative(getattr(other, f)(I), ratio * getattr(material, f)(I)) for f in ("psi", "gradient"))


def _moduli_not_positive(material, F, a0):
    return max(0.0, -min(material.moduli().values()) / material.shear_modulus)


CHECKS = (
    ("zero stress at rest", _stress_at_rest, 1e-12),
    ("objectivity", _objectivity, 1e-10),
    ("stress is the derivative of the energy", _stress, 1e-7),
    ("tangent is the derivative of the stress", _tangent, 1e-6),
    ("major symmetry", _major_symmetry, 1e-6),
    ("parameter derivatives", _parameter_derivatives, 1e-7),
    ("the energy is proportional to its scale", _scale, 1e-12),
    ("positive small-strain moduli", _moduli_not_positive, 0.0),
)
