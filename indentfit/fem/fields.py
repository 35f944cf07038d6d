"""Fields of a simulated test at its last displacement: displacement, Cauchy stress, volume ratio and contact pressure.

All of them belong to the quarter sample (x >= 0, z >= 0) and to its undeformed vertices and elements.
"""

from dataclasses import dataclass

import numpy as np
from skfem import Basis, ElementHex1, MeshHex

from indentfit.fem.element import XX, YY, ZZ, Solid
from indentfit.fem.simulate import FIBRES


@dataclass(frozen=True)
class Fields:
    """Fields on the vertices (n_v) and elements (n_el) of a mesh, mm and kPa.

    displacement (n_v, 3); stress: Cauchy, in the order xx yy zz xy yz xz, nodal (n_v, 6) and mean of each element (n_el, 6);
    volume_ratio (n_el,): J; contact_pressure (n_v,): on the undeformed area, zero outside of the footprint.
    """

    mesh: MeshHex
    displacement: np.ndarray
    nodal_stress: np.ndarray
    cell_stress: np.ndarray
    volume_ratio: np.ndarray
    contact_pressure: np.ndarray


def recover(model, result, material, kappa):
    """Fields of a TestResult that fem.simulate.Model `model` gave with a material and its bulk modulus, kPa."""
    body = model.body if type(model.body) is Solid else Solid(model.mesh, model.body.element)
    u, fibre = result.last.u, FIBRES[result.angle]
    state = body.state(u, fibre)
    stress = body.stress(u, state, material, body.pressure(state, kappa), fibre)
    return Fields(
        mesh=model.mesh,
        displacement=u[body.basis.nodal_dofs].T,
        nodal_stress=nodal_stress(body, stress),
        cell_stress=cell_stress(body, stress),
        volume_ratio=state.theta[:, 0] / body.means[:, 0],
        contact_pressure=contact_pressure(body, model.contact, result.last.touch),
    )


def pressure(stress):
    """Minus the mean of the normal stresses, compression positive; stress (..., 6)."""
    return -(stress[..., XX] + stress[..., YY] + stress[..., ZZ]) / 3


def cell_stress(body, stress):
    """Volume means (n_el, 6) of stresses (6, n_el, n_q) at the integration points."""
    return (np.einsum("seq,eq->se", stress, body.weights) / body.volume).T


def nodal_stress(body, stress):
    """Stresses (n_v, 6) at the vertices: means of the integration points around, by volume and nearness.

    The weight of a point is its volume times the vertex's trilinear shape function there (lumped L2 projection), so no
    nodal value exceeds those that it is made of.
    """
    linear = Basis(body.mesh, ElementHex1(), quadrature=body.basis.quadrature)
    shape = np.array([linear.basis[i][0].value for i in range(linear.Nbfun)])
    weights = np.broadcast_to(shape, (linear.Nbfun, *body.weights.shape)) * body.weights  # (8, n_el, n_q)
    corners = linear.element_dofs
    out = np.array([_gathered(corners, np.einsum("neq,eq->ne", weights, one), linear.N) for one in stress])
    return (out / _gathered(corners, weights.sum(axis=2), linear.N)).T[linear.nodal_dofs[0]]


def contact_pressure(body, contact, touch):
    """Contact pressure (n_v,) in kPa: that of the contact points at each vertex, mean of its facets by area."""
    at_node = contact.shape.argmax(axis=2)  # the contact points are the facets' nodes
    nodes = np.take_along_axis(contact.dofs[:, :, 0], at_node, axis=1) // 3
    n_nodes = body.n_dofs // 3
    total = _gathered(nodes, contact.weights * touch.pressure, n_nodes)
    area = _gathered(nodes, contact.weights, n_nodes)
    nodal = np.divide(total, area, out=np.zeros(n_nodes), where=area > 0)
    return nodal[body.basis.nodal_dofs[0] // 3]


def _gathered(places, values, length):
    """Sums of values by place."""
    return np.bincount(places.ravel(), weights=values.ravel(), minlength=length)
