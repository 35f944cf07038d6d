"""Fields of a simulated test at its last displacement: displacement, Cauchy stress, volume ratio and contact pressure.

All of them belong to the quarter sample (x >= 0, z >= 0) and to its undeformed nodes and elements.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from indentfit.arrays import Array, Ints
from indentfit.fem.contact import ContactFace
from indentfit.fem.contact_state import ContactState
from indentfit.fem.element import XX, YY, ZZ, Solid
from indentfit.fem.equilibrium import Equilibrium
from indentfit.fem.result import TestResult
from indentfit.fem.simulate import FIBRES, Model
from indentfit.material import Material


@dataclass(frozen=True)
class Fields:
    """Fields on nodes (n_v, 3), mm, and elements (n_el, 8 or 27) of nodes in scikit-fem's order; mm and kPa.

    Attributes
    ----------
    displacement : array (n_v, 3), mm
    nodal_stress, cell_stress : arrays (n_v, 6) and (n_el, 6), kPa
        Cauchy stresses xx yy zz xy yz xz at the nodes, and their means over the elements.
    volume_ratio : array (n_el,)
        J.
    contact_pressure : array (n_v,), kPa
        Pressure on the undeformed area; zero where the sample does not touch the indenter.
    """

    nodes: Array
    elements: Ints
    displacement: Array
    nodal_stress: Array
    cell_stress: Array
    volume_ratio: Array
    contact_pressure: Array


def recover(model: Model, result: TestResult, material: Material, kappa: float, equilibrium: Equilibrium | None = None) -> Fields:
    """Fields of a test.

    Parameters
    ----------
    model : Model
        The model that ran the test; the result of a later try brings its own model.
    result : TestResult
    material : Material
    kappa : float, kPa
        Bulk modulus that the test was simulated with.
    equilibrium : Equilibrium
        One of `result.path`; by default the last.

    Returns
    -------
    Fields
    """
    equilibrium = equilibrium or result.last
    model = result.model or model
    body, u, fibre = model.body, equilibrium.u, FIBRES[result.angle]
    state = body.state(u, fibre)
    stress = body.stress(u, state, material, body.pressure(state, kappa), fibre)
    return Fields(
        nodes=body.basis.doflocs[:, ::3].T,
        elements=_elements(body),
        displacement=u.reshape(-1, 3),
        nodal_stress=nodal_stress(body, stress),
        cell_stress=cell_stress(body, stress),
        volume_ratio=state.theta[:, 0] / body.means[:, 0],
        contact_pressure=contact_pressure(body, model.contact, equilibrium.contact),
    )


def pressure(stress: Array) -> Array:
    """Minus the mean of the normal stresses, compression positive; stress (..., 6)."""
    return -(stress[..., XX] + stress[..., YY] + stress[..., ZZ]) / 3


def cell_stress(body: Solid, stress: Array) -> Array:
    """Volume means (n_el, 6) of stresses (6, n_el, n_q) at the integration points."""
    return (np.einsum("seq,eq->se", stress, body.weights) / body.volume).T


def nodal_stress(body: Solid, stress: Array) -> Array:
    """Stresses (n_v, 6) at the nodes: means of the integration points around, by volume and nearness.

    A point's nearness to a node is 1 at the node and falls linearly to 0 at the next one in each direction of the
    element (the lumped L2 projection on trilinear cells between the nodes), so a nodal stress never exceeds those that
    it is made of.
    """
    places = body.basis.elem.elem.doflocs  # (n_n, 3) of the reference element
    points = body.basis.quadrature[0].T  # (n_q, 3)
    intervals = np.unique(places[:, 0]).size - 1
    nearness = np.prod(np.maximum(1 - intervals * np.abs(places[:, None] - points), 0), axis=2)
    nodes, n_nodes = _elements(body), body.n_dofs // 3
    share = np.einsum("nq,eq->en", nearness, body.weights)
    total = np.einsum("nq,eq,seq->sen", nearness, body.weights, stress)
    return np.array([_sums(nodes, component, n_nodes) for component in total]).T / _sums(nodes, share, n_nodes)[:, None]


def contact_pressure(body: Solid, face: ContactFace, contact: ContactState) -> Array:
    """Contact pressure (n_v,) in kPa: the pressures of the contact points at each node, averaged by area."""
    nodes, n_nodes = face.dofs[:, :, 0] // 3, body.n_dofs // 3
    total = _sums(nodes, face.weights * contact.pressure, n_nodes)
    area = _sums(nodes, face.weights, n_nodes)
    return np.divide(total, area, out=np.zeros(n_nodes), where=area > 0)


def _elements(body: Solid) -> Ints:
    return body.dofs[:, :, 0] // 3


def _sums(places: Ints, values: Array, length: int) -> Any:
    """Sums (length,) of the values that belong to each place."""
    return np.bincount(places.ravel(), weights=values.ravel(), minlength=length)
