"""Fields of a simulated test at its last displacement: displacement, Cauchy stress, volume ratio and contact pressure.

All of them belong to the part of the sample that is meshed (fem.symmetry), mostly the quarter x >= 0, z >= 0, and to its
undeformed nodes and elements.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from indentfit.arrays import Array, Ints
from indentfit.fem.body import Volumetric
from indentfit.fem.element import XX, XY, XZ, YY, YZ, ZZ, Solid
from indentfit.fem.equilibrium import Equilibrium
from indentfit.fem.meridian import Meridian
from indentfit.fem.result import TestResult
from indentfit.fem.simulate import Model
from indentfit.fibres import fibre_of
from indentfit.material import Material

SECTORS = 12  # of the quarter that a meridian plane sweeps for pictures and files
# The nodes of a nine-node quadrilateral, in scikit-fem's order (corners, middles of the sides, middle), that make four small ones.
QUARTERED = ((0, 4, 8, 7), (4, 1, 5, 8), (8, 5, 2, 6), (7, 8, 6, 3))
# The nodes of a brick in scikit-fem's order, among those of a small quadrilateral at one angle (0 to 3) and at the next (4 to 7).
BRICK = (6, 2, 5, 7, 1, 3, 4, 0)


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
    part : str
        The part of the sample that they belong to, a key of fem.symmetry.PARTS.
    layer : array (n_el,) or None
        Number of each element's layer, from 1 at the top; None for a sample without layers.
    """

    nodes: Array
    elements: Ints
    displacement: Array
    nodal_stress: Array
    cell_stress: Array
    volume_ratio: Array
    contact_pressure: Array
    part: str = "quarter"
    layer: Ints | None = None

    @property
    def pictured(self) -> "Fields":
        """These fields, of a whole sample those of its half z >= 0 alone, so that pictures show what is under the indenter."""
        if self.part != "whole":
            return self
        behind = self.nodes[self.elements, 2].mean(axis=1) > 0
        nodes, elements = np.unique(self.elements[behind], return_inverse=True)
        return Fields(
            nodes=self.nodes[nodes],
            elements=elements.reshape(-1, self.elements.shape[1]),
            displacement=self.displacement[nodes],
            nodal_stress=self.nodal_stress[nodes],
            cell_stress=self.cell_stress[behind],
            volume_ratio=self.volume_ratio[behind],
            contact_pressure=self.contact_pressure[nodes],
            part=self.part,
            layer=None if self.layer is None else self.layer[behind],
        )


def recover(
    model: Model, result: TestResult, material: Material, kappa: float | tuple[float, ...], equilibrium: Equilibrium | None = None
) -> Fields:
    """Fields of a test.

    Parameters
    ----------
    model : Model
        The model that ran the test; the result of a later try brings its own model.
    result : TestResult
    material : Material
    kappa : float or tuple of float, kPa
        Bulk modulus that the test was simulated with, or that of each layer.
    equilibrium : Equilibrium
        One of `result.path`; by default the last.

    Returns
    -------
    Fields
    """
    equilibrium = equilibrium or result.last
    model = result.model or model
    (body, u), fibre = model.body.unfolded(equilibrium.u), fibre_of(result.angle, result.dip, result.families)
    state = body.state(u, fibre)
    bulk = model.of_elements(kappa if isinstance(kappa, tuple) else (kappa,))
    stress = body.stress(u, state, model.placed(material), body.pressure(state, Volumetric(bulk, model.rest(material))), fibre)
    n = body.dofs.shape[2]
    fields = Fields(
        nodes=body.basis.doflocs[:, ::n].T,
        elements=_elements(body),
        displacement=u.reshape(-1, n),
        nodal_stress=nodal_stress(body, stress),
        cell_stress=cell_stress(body, stress),
        volume_ratio=state.theta[:, 0] / body.means[:, 0],
        contact_pressure=model.contact.points.nodal_mean(equilibrium.contact.pressure),
        part="quarter" if model.setup.in_plane else model.setup.symmetry,
        layer=model.layer + 1 if model.setup.sample.layer else None,
    )
    return fields if n == 3 else revolved(fields)


def pressure(stress: Array) -> Array:
    """Minus the mean of the normal stresses, compression positive; stress (..., 6)."""
    return -(stress[..., XX] + stress[..., YY] + stress[..., ZZ]) / 3


def cell_stress(body: Solid | Meridian, stress: Array) -> Array:
    """Volume means (n_el, 6) of stresses (6, n_el, n_q) at the integration points."""
    return (np.einsum("seq,eq->se", stress, body.weights) / body.volume).T


def nodal_stress(body: Solid | Meridian, stress: Array) -> Array:
    """Stresses (n_v, 6) at the nodes: means of the integration points around, by volume and nearness.

    A point's nearness to a node is 1 at the node and falls linearly to 0 at the next one in each direction of the
    element (the lumped L2 projection on trilinear cells between the nodes), so a nodal stress never exceeds those that
    it is made of.
    """
    places = body.basis.elem.elem.doflocs  # (n_n, 3) of the reference element
    points = body.basis.quadrature[0].T  # (n_q, 3)
    intervals = np.unique(places[:, 0]).size - 1
    nearness = np.prod(np.maximum(1 - intervals * np.abs(places[:, None] - points), 0), axis=2)
    nodes, n_nodes = _elements(body), body.n_dofs // body.dofs.shape[2]
    share = np.einsum("nq,eq->en", nearness, body.weights)
    total = np.einsum("nq,eq,seq->sen", nearness, body.weights, stress)
    return np.array([_sums(nodes, component, n_nodes) for component in total]).T / _sums(nodes, share, n_nodes)[:, None]


def revolved(fields: Fields) -> Fields:
    """Fields of the quarter sample x, z >= 0 that a meridian plane z = 0 of nine-node quadrilaterals sweeps, as eight-node bricks.

    Each quadrilateral gives four small ones, and each of these a brick in each of SECTORS sectors of the quarter.
    """
    quads = fields.elements[:, np.array(QUARTERED)].reshape(-1, 4)
    angles = np.linspace(0, np.pi / 2, SECTORS + 1)
    n_nodes, sectors = len(fields.nodes), np.arange(SECTORS)[:, None, None]
    first, second = quads + sectors * n_nodes, quads + (sectors + 1) * n_nodes
    bricks = np.concatenate([first, second], axis=2)[:, :, np.array(BRICK)].reshape(-1, 8)
    middles = np.repeat((angles[1:] + angles[:-1]) / 2, len(quads))
    cells = np.tile(np.repeat(fields.cell_stress, 4, axis=0), (SECTORS, 1))
    turned = [_turned(fields.nodal_stress, np.full(n_nodes, angle)) for angle in angles]
    return Fields(
        nodes=np.concatenate([_swept(fields.nodes, angle) for angle in angles]),
        elements=bricks,
        displacement=np.concatenate([_swept(fields.displacement, angle) for angle in angles]),
        nodal_stress=np.concatenate(turned),
        cell_stress=_turned(cells, middles),
        volume_ratio=np.tile(np.repeat(fields.volume_ratio, 4), SECTORS),
        contact_pressure=np.tile(fields.contact_pressure, SECTORS + 1),
        layer=None if fields.layer is None else np.tile(np.repeat(fields.layer, 4), SECTORS),
    )


def _swept(plane: Array, angle: float) -> Array:
    """Vectors (n, 3) of a plane's vectors (n, 2) turned about the axis."""
    return np.column_stack([plane[:, 0] * np.cos(angle), plane[:, 1], plane[:, 0] * np.sin(angle)])


def _turned(stress: Array, angles: Array) -> Array:
    """Stresses (n, 6) of the plane z = 0 turned about the axis by angles (n,)."""
    c, s = np.cos(angles), np.sin(angles)
    radial, axial, hoop, shear = (stress[:, component] for component in (XX, YY, ZZ, XY))
    turned = np.empty_like(stress)
    turned[:, XX], turned[:, YY], turned[:, ZZ] = radial * c**2 + hoop * s**2, axial, radial * s**2 + hoop * c**2
    turned[:, XY], turned[:, YZ], turned[:, XZ] = shear * c, shear * s, (radial - hoop) * c * s
    return turned


def _elements(body: Solid | Meridian) -> Ints:
    return body.dofs[:, :, 0] // body.dofs.shape[2]


def _sums(places: Ints, values: Array, length: int) -> Any:
    """Sums (length,) of the values that belong to each place."""
    return np.bincount(places.ravel(), weights=values.ravel(), minlength=length)
