"""Materials whose energy is typed as text in a case: the text is parsed within limits, and never executed."""

import ast
import inspect
import keyword
import operator
import re
from collections.abc import Callable, Iterable, Mapping
from functools import cache
from typing import Any

from indentfit.errors import MaterialError
from indentfit.material.functions import FUNCTIONS, Term, applied
from indentfit.material.jets import Jet
from indentfit.material.kinematics import INVARIANTS, SECOND_FAMILY
from indentfit.material.model import Material, require_derivable
from indentfit.material.parameter import Parameter
from indentfit.material.stretches import STRETCHES
from indentfit.material.words import nearest, one_line

KNOWN = (*INVARIANTS, *SECOND_FAMILY, *STRETCHES)
# Limits of a typed energy: far above any published energy, far below what could stall the reader.
LENGTH, NODES, DEPTH, CALLS, POWER, NUMBER = 500, 150, 60, 4, 20, 1e15


def typed(energy: str, parameters: Iterable[str] | Mapping[str, Parameter]) -> type[Material]:
    """The material class of an energy typed as text, such as "mu/2 * ((I1 - 3) + zeta * (I4 - 1)^2)".

    Parameters
    ----------
    energy : str
        psi, kPa, in I1, I2, I4, I5, of a second family of fibres I6, I7, I8, the principal stretches l1, l2, l3, the parameters'
        names, numbers, + - * / ** ^ ( ) and `FUNCTIONS`; ^ is a power.
    parameters : names, or names with their `Parameter`
        The first parameter that the energy is proportional to becomes the scale.

    Returns
    -------
    class of Material
        Within one process, the same text and parameters give the same class.

    Raises
    ------
    MaterialError
        The text names something else, is beyond the limits, or is not an energy (see `require_derivable`). The message names the
        piece at fault.
    """
    if not isinstance(energy, str):
        raise MaterialError(f"an energy is text, not {type(energy).__name__}")
    if isinstance(parameters, str):
        raise MaterialError(f"the parameters of a typed energy are a list of names, not the text {parameters!r}")
    if isinstance(parameters, Mapping):
        for name, parameter in parameters.items():
            if not isinstance(parameter, Parameter):
                raise MaterialError(f"the parameter {name!r} must be a Parameter(unit, meaning), not {parameter!r}")
        return typed_class(energy, tuple(parameters.items()))
    return typed_class(energy, tuple((name, Parameter("", "of the typed energy")) for name in parameters))


@cache
def typed_class(energy: str, parameters: tuple[tuple[str, Parameter], ...]) -> type[Material]:
    """The material class of a typed energy, made once for a text and its parameters; raises MaterialError as `typed`."""
    _refuse_parameter_names([name for name, _ in parameters])
    cls = _made_class(energy, _parsed(energy), dict(parameters))
    require_derivable(cls)
    cls._source = typed_class, energy, parameters
    return cls


def _refuse_parameter_names(names: list[str]) -> None:
    for name in names:
        if not (isinstance(name, str) and name.isascii() and name.isidentifier() and not name.startswith("_")):
            raise MaterialError(f"a parameter cannot be called {repr(name)[:60]}: use letters, digits and _")
        if name in KNOWN or name in FUNCTIONS or keyword.iskeyword(name) or hasattr(Material, name):
            raise MaterialError(f"a parameter cannot be called {name!r}: that name has a meaning already")
    if len(set(names)) < len(names):
        raise MaterialError(f"a parameter is named twice: {', '.join(names)}")
    if not names:
        raise MaterialError("a typed energy needs at least one parameter")


def _parsed(text: str) -> ast.expr:
    """The syntax tree of the text, within the limits of length, characters and number of nodes."""
    if len(text) > LENGTH:
        raise MaterialError(f"the energy has {len(text)} characters; at most {LENGTH} are read")
    strange = re.search(r"[^A-Za-z0-9_+\-*/^().,\s]", text) or re.search(r"[^\x00-\x7f]", text)
    if strange:
        raise MaterialError(f"the energy has {strange[0]!r} at character {strange.start() + 1}, which it cannot use")
    tree = _tree(" ".join(text.split()).replace("^", "**"))
    if sum(isinstance(node, ast.expr) for node in ast.walk(tree)) > NODES:
        raise MaterialError(f"the energy is too long: more than {NODES} names, numbers and operations")
    if _nested(tree, ast.expr) > DEPTH:
        raise MaterialError(f"the energy is nested more than {DEPTH} deep")
    if _nested(tree, ast.Call) > CALLS:
        raise MaterialError(f"the energy has functions nested more than {CALLS} deep")
    return tree


def _tree(line: str) -> ast.expr:
    try:
        return ast.parse(line, mode="eval").body
    except SyntaxError as error:
        near = line[max((error.offset or 1) - 1, 0) :][:20] or line[-20:]
        raise MaterialError(f"the energy cannot be read near {near!r}: {error.msg}") from None
    except (ValueError, MemoryError, RecursionError) as error:
        raise MaterialError(f"the energy cannot be read: {one_line(error)}") from None


def _nested(node: ast.AST, kind: type[ast.AST]) -> int:
    """How many nodes of the kind lie within each other."""
    return isinstance(node, kind) + max((_nested(child, kind) for child in ast.iter_child_nodes(node)), default=0)


def _made_class(text: str, tree: ast.expr, parameters: Mapping[str, Parameter]) -> type[Material]:
    """The class whose energy builds the tree's expression."""
    named = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}
    used = [name for name in KNOWN if name in named]

    def energy(self: Material, **I: Term) -> Term:
        psi = _built(tree, {**I, **{name: getattr(self, name) for name in parameters}})
        if not isinstance(psi, Jet) and (isinstance(psi, float) or not any(x in psi.free_symbols for x in I.values())):
            raise MaterialError(f"the energy depends on none of {', '.join(KNOWN)}")
        return psi

    signature = [inspect.Parameter(name, inspect.Parameter.POSITIONAL_OR_KEYWORD) for name in ("self", *used)]
    energy.__signature__ = inspect.Signature(signature)  # type: ignore[attr-defined]
    return type("TypedEnergy", (Material,), {"__doc__": f"psi = {text}", "energy": energy, **parameters})


def _built(node: ast.expr, symbols: Mapping[str, Term], power: float = 1) -> Term:
    """The node's value: a float, a jet or a SymPy expression. power: product of the exponents around the node.

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
            return _combined(node, op, _built(left, symbols, power), _built(right, symbols, power))
        case ast.Call(func=ast.Name(id=name)):
            return _called(node, name, symbols, power)
    raise MaterialError(f"an energy cannot contain {_piece(node)}: only names, numbers, + - * / ** ( ) and functions")


def _symbol(name: str, symbols: Mapping[str, Term]) -> Term:
    if name in symbols:
        return symbols[name]
    known = [*KNOWN, *(n for n in symbols if n not in KNOWN)]
    remedy = "give it its argument" if name in FUNCTIONS else f"known: {', '.join(known)}{nearest(name, known)}"
    raise MaterialError(f"the energy names {name!r}, which is no parameter or invariant; {remedy}")


def _raised(node: ast.BinOp, symbols: Mapping[str, Term], power: float) -> Term:
    """base ** exponent; the product of nested exponents is limited, and an exponent holds no power of its own."""
    if any(isinstance(inner, ast.Pow) for inner in ast.walk(node.right)):
        raise MaterialError(f"the energy has a power in an exponent: {_piece(node)}")
    exponent = _built(node.right, symbols)
    power = power * max(2.0, abs(exponent) if isinstance(exponent, float) else 0.0)
    if power > POWER:
        raise MaterialError(f"the energy has a power, or a product of nested powers, above {POWER}: {_piece(node)}")
    base = _built(node.left, symbols, power)
    if isinstance(exponent, float) and not isinstance(base, (float, Jet)):
        exponent = _short(exponent)
    return _settled(node, operator.pow, base, exponent)


def _short(exponent: float) -> Term:
    """A whole or half number for SymPy: x**2 and sqrt(x) are evaluated faster than x**2.0 and x**0.5."""
    import sympy

    return sympy.Rational(exponent) if (2 * exponent).is_integer() else exponent


def _combined(node: ast.BinOp, op: ast.operator, x: Term, y: Term) -> Term:
    """x op y, folded if both are numbers."""
    if isinstance(op, ast.Div) and y == 0:
        raise MaterialError(f"the energy divides by zero: {_piece(node)}")
    apply = {ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul, ast.Div: operator.truediv}
    return _settled(node, apply[type(op)], x, y)


def _called(node: ast.Call, name: str, symbols: Mapping[str, Term], power: float) -> Term:
    """A function of one argument."""
    if name not in FUNCTIONS:
        known = f"{', '.join(FUNCTIONS)}{nearest(name, FUNCTIONS)}"
        raise MaterialError(f"an energy has no function {name!r}; allowed: {known}")
    if len(node.args) != 1 or node.keywords:
        raise MaterialError(f"{name} takes one argument, not {_piece(node)}")
    return _settled(node, applied, name, _built(node.args[0], symbols, power))


def _settled(node: ast.expr, function: Callable[..., Any], *arguments: Any) -> Term:
    """function(*arguments); a result that is a number becomes a float within limits."""
    try:
        result = function(*arguments)
        if isinstance(result, Jet):
            return result
        constant = isinstance(result, (int, float, complex)) or result.is_number
        return _number(float(result), node) if constant else result
    except (ArithmeticError, ValueError, TypeError, RecursionError, MemoryError):
        raise MaterialError(f"the energy has a piece with no finite real value: {_piece(node)}") from None


def _number(number: float, node: ast.expr) -> float:
    if not abs(number) <= NUMBER:
        raise MaterialError(f"the energy has a number beyond {NUMBER:g}: {_piece(node)}")
    return float(number)


def _piece(node: ast.expr) -> str:
    """The node as text, for messages."""
    try:
        text = ast.unparse(node)
    except (RecursionError, ValueError):
        return "this"
    return repr(text if len(text) <= 40 else f"{text[:37]}...")
