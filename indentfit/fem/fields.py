"""Fields of a simulated test at its last displacement: displacement, Cauchy stress, volume ratio and contact pressure.

All of them belong to the quarter sample (x >= 0, z >= 0) and to its undeformed nodes and elements.
"""

from dataclasses import dataclass

import numpy as np

from indentfit.fem.element import XX, YY, ZZ
from indentfit.fem.simulate import FIBRES


@dataclass(frozen=True)
class Fields:
    """Fields on nodes (n_v, 3), mm, and elements (n_el, 8 or 27) of nodes in scikit-fem's order; mm and kPa.

    displacement (n_v, 3); nodal_stress (n_v, 6), and cell_stress (n_el, 6), its mean: Cauchy, xx yy zz xy yz xz;
    volume_ratio (n_el,): J; contact_pressure (n_v,): on the undeformed area, zero where nothing touches.
    """

    nodes: np.ndarray
    elements: np.ndarray
    displacement: np.ndarray
    nodal_stress: np.ndarray
    cell_stress: np.ndarray
    volume_ratio: np.ndarray
    contact_pressure: np.ndarray


def recover(model, result, material, kappa, equilibrium=None):
    """Fields of a TestResult that fem.simulate.Model `model` gave with a material and its bulk modulus, kPa.

    equilibrium: one of result.path; by default the last.
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


def pressure(stress):
    """Minus the mean of the normal stresses, compression positive; stress (..., 6)."""
    return -(stress[..., XX] + stress[..., YY] + stress[..., ZZ]) / 3


def cell_stress(body, stress):
    """Volume means (n_el, 6) of stresses (6, n_el, n_q) at the integration points."""
    return (np.einsum("seq,eq->se", stress, body.weights) / body.volume).T


def nodal_stress(body, stress):
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
    return np.array([_sums(nodes, one, n_nodes) for one in total]).T / _sums(nodes, share, n_nodes)[:, None]


def contact_pressure(body, contact, touch):
    """Contact pressure (n_v,) in kPa: that of the contact points at each node, mean of its facets by area."""
    nodes, n_nodes = contact.dofs[:, :, 0] // 3, body.n_dofs // 3
    total = _sums(nodes, contact.weights * touch.pressure, n_nodes)
    area = _sums(nodes, contact.weights, n_nodes)
    return np.divide(total, area, out=np.zeros(n_nodes), where=area > 0)


def _elements(body):
    return body.dofs[:, :, 0] // 3


def _sums(places, values, length):
    """Sums (length,) of the values that belong to each place."""
    return np.bincount(places.ravel(), weights=values.ravel(), minlength=length)
