"""Half of a sample whose other half is the same turned by 180 degrees about the axis y, as a body.

The half z >= 0 ends at the cut face z = 0. A node of this face at (-x, y, 0) is the turned image of the node at (x, y, 0), and
moves by (-u_x, u_y, -u_z) where that moves by u. Its displacements are no unknowns: with u_all = T u, T of entries 0, 1 and -1, the
body of all nodes (`element.Solid`, or that of the forms) gives forces Tᵀ f and a tangent Tᵀ K T. On the axis a node is its own
image, so that u_x = u_z = 0 there.
"""

import copy

import numpy as np
import scipy.sparse as sp
from scipy.spatial import cKDTree

from indentfit.arrays import Array, Bools, Ints
from indentfit.errors import MeshError
from indentfit.fem.body import BodyState, Bulk, Volumetric
from indentfit.fem.element import Solid, sparsity
from indentfit.fem.sliding import Sliding
from indentfit.fibres import Fibre
from indentfit.material import Material

TURN = np.array([-1.0, 1.0, -1.0])  # a turn by 180 degrees about y
SAME = 1e-7  # of the sample's extent: how far the image of a node may be from a node


class Tied:
    """A Body: the half z >= 0 of a sample, tied to itself on its cut face.

    Parameters
    ----------
    solid : Solid or Sliding
        The half with all of its nodes; its mesh has the boundary z0.

    Attributes
    ----------
    dofs : array (n_el, n_n, 3)
        Numbers of the unknowns that move the elements' nodes.
    signs : array (n_el, n_n, 3)
        Signs with which they do.
    """

    def __init__(self, solid: Solid | Sliding) -> None:
        self.solid, self.mesh, self.element, self.basis = solid, solid.mesh, solid.element, solid.basis
        self.copies, self.volume, self.means, self.weights = solid.copies, solid.volume, solid.means, solid.weights
        self.nodes = solid.nodes
        image = _images(solid)
        own = image == np.arange(image.size)
        number = np.cumsum(own) - 1  # of the nodes that are no images, among themselves
        self._node, self._own = number[image], np.flatnonzero(own)
        signs = np.where(own[:, None], 1.0, TURN)
        self._sign, self._dof = signs.ravel(), (3 * self._node[:, None] + np.arange(3)).ravel()
        self._signs = signs
        self._number_dofs()
        cells = np.concatenate([solid.nodes, solid.coupled]) if isinstance(solid, Sliding) else solid.nodes
        self.indptr, self.indices, self.positions = sparsity(self._node[cells], self._own.size, 3)
        self._gather = _Gather.of(solid, self)

    def _number_dofs(self) -> None:
        """The unknowns that move the elements' nodes, with their signs."""
        cells = self.solid.dofs[:, :, 0] // 3
        self.signs, self.dofs = np.ascontiguousarray(self._signs[cells]), self._dof[self.solid.dofs].astype(np.int32)

    def sliding_on(self, u: Array) -> "Tied":
        """This body with each point of a lower face on what it lies on at displacements u (n,); itself where points do not
        follow."""
        solid = self.solid.sliding_on(self.all_of(u)) if isinstance(self.solid, Sliding) else self.solid
        if solid is self.solid:
            return self
        other = copy.copy(self)
        other.solid = solid
        other._number_dofs()
        return other

    def slid_forces(self, u: Array, led: Array, change: Array, kappa: Bulk) -> Array:
        """As `Sliding.slid_forces`."""
        assert isinstance(self.solid, Sliding)
        return self._summed(self.solid.slid_forces(self.all_of(u), self.all_of(led), self.all_of(change), kappa))

    @property
    def n_dofs(self) -> int:
        return 3 * self._own.size

    def points(self) -> Array:
        """Points (3, n_v) of the nodes that have unknowns, mm."""
        return self.solid.points()[:, self._own]

    def held(self, base: str, motions: frozenset[str] = frozenset(), ends: bool = False) -> Ints:
        """Dofs held at zero: those of the base, those on the axis, and those that hold a rigid turn."""
        x, _, z = self.points()
        axis = 3 * np.flatnonzero(np.hypot(x, z) < SAME * np.ptp(x))
        return np.unique(np.concatenate([self._dof[self.solid.held(base, motions, ends)], axis, axis + 2]))

    def unfolded(self, u: Array) -> tuple[Solid, Array]:
        """The body of all nodes, and its displacements, of the unknowns u (n,)."""
        solid = self.solid.solid if isinstance(self.solid, Sliding) else self.solid
        assert isinstance(solid, Solid)
        return solid, self.all_of(u)

    def corners(self, u: Array) -> tuple[Array, Array]:
        return self.solid.corners(self.all_of(u))

    def state(self, u: Array, fibre: Fibre) -> BodyState:
        return self.solid.state(self.all_of(u), fibre)

    def pressure(self, state: BodyState, kappa: Bulk | Volumetric) -> Array:
        return self.solid.pressure(state, kappa)

    def residual(self, u: Array, state: BodyState, material: Material, pressure: Array, fibre: Fibre) -> Array:
        return self._summed(self.solid.residual(self.all_of(u), state, material, pressure, fibre))

    def forces(self, u: Array, gradient: Array, pressure: Array, fibre: Fibre) -> Array:
        return self._summed(self.solid.forces(self.all_of(u), gradient, pressure, fibre))

    def tangent(
        self,
        u: Array,
        state: BodyState,
        material: Material,
        pressure: Array,
        kappa: Bulk | Volumetric,
        fibre: Fibre,
        bulk: Bulk | None = None,
    ) -> tuple[Array, Array]:
        forces, values = self.solid.tangent(self.all_of(u), state, material, pressure, kappa, fibre, bulk)
        return self._summed(forces), self._gather(values)

    def dilatation_map(self, u: Array) -> Array:
        return self.solid.dilatation_map(self.all_of(u)) * self.signs[:, None]

    def stress(self, u: Array, state: BodyState, material: Material, pressure: Array, fibre: Fibre) -> Array:
        return self.solid.stress(self.all_of(u), state, material, pressure, fibre)

    def deformation(self, u: Array) -> Array:
        return self.solid.deformation(self.all_of(u))

    def prestress(self, S: Array) -> tuple[Array, Array]:
        forces, values = self.solid.prestress(S)
        return self._summed(forces), self._gather(values)

    def matrix(self, values: Array) -> sp.csr_matrix:
        return sp.csr_matrix((values, self.indices, self.indptr), shape=(self.n_dofs,) * 2, copy=False)

    def all_of(self, u: Array) -> Array:
        """The displacements of all nodes, T u, of the unknowns u (n,)."""
        return self._sign * u[self._dof]

    def _summed(self, forces: Array) -> Array:
        """Tᵀ f."""
        return np.bincount(self._dof, self._sign * forces, self.n_dofs).astype(float, copy=False)


class _Gather:
    """CSR values of K -> those of Tᵀ K T: most are copied to their places, those of images are added with their signs."""

    def __init__(self, size: int, places: Ints, signs: Array, moved: Bools) -> None:
        self._size, self._kept, self._moved = size, np.flatnonzero(~moved), np.flatnonzero(moved)
        self._to, self._onto, self._signs = places[self._kept], places[self._moved], signs[self._moved]

    @classmethod
    def of(cls, solid: Solid | Sliding, tied: Tied) -> "_Gather":
        rows = np.repeat(np.arange(solid.n_dofs), np.diff(solid.indptr))
        images = tied._sign < 0
        images = np.repeat(images.reshape(-1, 3).any(axis=1), 3)
        row, column = tied._dof[rows].astype(np.int64), tied._dof[solid.indices]
        keys = np.repeat(np.arange(tied.n_dofs, dtype=np.int64), np.diff(tied.indptr)) * tied.n_dofs + tied.indices
        places = np.searchsorted(keys, row * tied.n_dofs + column)
        return cls(keys.size, places, tied._sign[rows] * tied._sign[solid.indices], images[rows] | images[solid.indices])

    def __call__(self, values: Array) -> Array:
        gathered = np.zeros(self._size)
        gathered[self._to] = values[self._kept]
        np.add.at(gathered, self._onto, self._signs * values[self._moved])
        return gathered


def _images(solid: Solid | Sliding) -> Ints:
    """For each node the node of which it is the turned image; itself where it is none."""
    points, image = solid.points(), np.arange(solid.n_dofs // 3)
    extent = np.ptp(points, axis=1).max()
    cut = np.flatnonzero(np.abs(points[2]) < SAME * extent)
    turned = cut[points[0, cut] < -SAME * extent]
    side = _mean_heights(solid)  # layers that slide have nodes at the same place, of elements above and below
    away, nearest = cKDTree(np.vstack([points, side])[:, cut].T).query(np.vstack([TURN[:, None] * points, side])[:, turned].T)
    if turned.size and away.max() > SAME * extent:
        raise MeshError("the mesh of the half sample is not symmetric on its cut face")
    image[turned] = cut[nearest]
    return image


def _mean_heights(solid: Solid | Sliding) -> Array:
    """The mean height (n_v,), mm, of the elements around each node."""
    nodes = solid.nodes.ravel()
    heights = np.repeat(solid.points()[1, solid.nodes].mean(axis=1), solid.nodes.shape[1])
    return np.bincount(nodes, heights) / np.bincount(nodes)
