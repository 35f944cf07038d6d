"""The element loops, compiled by two processes at once where none of their compiled code is stored yet.

Numba compiles the tangent as long as all other loops together, and within one process only one function after the other. Here a
process of its own compiles the tangent and stores it, while this one compiles the others. Where that process fails, the tangent is
compiled at its first call, as always.
"""

import functools
from types import SimpleNamespace
from typing import Any

import numpy as np
from skfem import MeshHex, MeshQuad

from indentfit.arrays import Array
from indentfit.compiled import is_stored
from indentfit.fem.body import BodyState
from indentfit.fem.element import Solid, loops_of
from indentfit.fem.meridian import LOOPS, Meridian
from indentfit.fem.setup import Setup
from indentfit.fem.symmetry import PARTS
from indentfit.machine import python_beside

PLANE = "plane"  # the meridian plane, in the place of an element's name
GEL: Any = SimpleNamespace(  # mu / 2 (I1 - 3): a law would import SymPy
    gradient=lambda I: np.multiply.outer([0.5, 0, 0, 0], np.ones(I.shape[1:])), hessian=lambda I: np.zeros((4, *I.shape))
)


def compile_ahead(setup: Setup) -> None:
    """Compile the loops that a setup needs, where their compiled code is not stored yet."""
    if setup.solver.assembly == "compiled":
        _compile(PLANE if setup.in_plane else setup.solver.element)


@functools.cache
def _compile(kind: str) -> None:
    if is_stored(LOOPS.tangent if kind == PLANE else loops_of(kind).tangent):
        return
    with python_beside(f"from {__name__} import compile_tangent; compile_tangent({kind!r})"):
        body, rest, fibre = _small(kind)
        state = body.state(rest, fibre)
        pressure = np.zeros(state.theta.shape)
        body.residual(rest, state, GEL, pressure, fibre)
        body.dilatation_map(rest)
        body.stress(rest, state, GEL, pressure, fibre)


def compile_tangent(kind: str) -> None:
    """Compile the tangent of the meridian plane, or of bricks of an element.

    Parameters
    ----------
    kind : str
        PLANE, or a key of ELEMENTS.
    """
    body, rest, fibre = _small(kind)
    theta = np.zeros(body.means.shape)
    invariants = np.repeat([[3.0], [3.0], [1.0], [1.0]], body.weights.size, axis=1)
    body.tangent(rest, BodyState(invariants, theta, True), GEL, theta, 1.0, fibre)


def _small(kind: str) -> tuple[Any, Array, Array]:
    """A body of a few elements, its displacements at rest, and fibres."""
    body = Meridian(MeshQuad().refined()) if kind == PLANE else Solid(MeshHex().refined(), kind, PARTS["quarter"])
    return body, np.zeros(body.n_dofs), np.array([0.0, 1.0, 0.0])
