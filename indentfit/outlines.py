"""Outlines of a deformed sample: points on its edge in a picture or a section, which are no material points.

The outline is that of the section through the axis, in the plane x = 0 or z = 0: the chain of both sides and the top between them,
w being the coordinate along the section (z or x) and y the height. A point P that was seen on the deformed outline is compared with
the outline of a solution along the outline's normal n at its foot x: the outline lies n . (x - P) outside of P.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from indentfit.arrays import Array, Ints

ON_SIDE, ON_TOP = 81, 241  # points of the chain on a side, closer together at its ends, and on the top


def chain(half_width: float, thickness: float) -> Array:
    """Points (k, 2) of the undeformed outline as (w, y), mm: up one side, along the top, and down the other side.

    Parameters
    ----------
    half_width : float, mm
        Of the section.
    thickness : float, mm
    """
    up = thickness * (1 - np.cos(np.linspace(0, np.pi, ON_SIDE))) / 2
    along = np.linspace(half_width, -half_width, ON_TOP)[1:-1]
    w = np.concatenate([np.full(ON_SIDE, half_width), along, np.full(ON_SIDE, -half_width)])
    return np.column_stack([w, np.concatenate([up, np.full(along.size, thickness), up[::-1]])])


@dataclass(frozen=True, eq=False)
class Feet:
    """The nearest points of a chain to points (m, 2).

    Attributes
    ----------
    edges : array (m,)
        The number of the edge between two points of the chain.
    shares : array (m,)
        The place of the foot along the edge, 0 to 1.
    places, normals : arrays (m, 2)
        The foot, mm, and the edge's normal, which points outwards.
    """

    edges: Ints
    shares: Array
    places: Array
    normals: Array


def feet_of(points: Array, nodes: Array) -> Feet:
    """The Feet of points (m, 2) on a chain of nodes (k, 2), mm."""
    start, along = nodes[:-1], np.diff(nodes, axis=0)
    squared = np.maximum(np.sum(along**2, axis=1), 1e-300)
    shares = np.clip(np.einsum("mej,ej->me", points[:, None] - start, along) / squared, 0.0, 1.0)
    away = np.linalg.norm(start + shares[..., None] * along - points[:, None], axis=2)
    edges = np.argmin(away, axis=1)
    share = shares[np.arange(len(points)), edges]
    normals = np.column_stack([along[edges, 1], -along[edges, 0]]) / np.sqrt(squared[edges])[:, None]
    return Feet(edges, share, start[edges] + share[:, None] * along[edges], normals)


def beyond(points: Array, nodes: Array) -> Array:
    """How far the outline (k, 2) lies outside of points (m, 2), along its normals, mm, (m,)."""
    feet = feet_of(points, nodes)
    return np.asarray(np.sum(feet.normals * (feet.places - points), axis=1))


def beyond_change(points: Array, nodes: Array, change: Array) -> Array:
    """Derivative (m,) of `beyond`, where that of the nodes is `change` (k, 2).

    The foot's motion along the edge does not count: there the distance is least, or the foot stays in a node.
    """
    feet, along = feet_of(points, nodes), np.diff(nodes, axis=0)
    moved = change[feet.edges] + feet.shares[:, None] * np.diff(change, axis=0)[feet.edges]
    length = np.linalg.norm(along[feet.edges], axis=1)[:, None]
    tangent = along[feet.edges] / length
    turn = np.diff(change, axis=0)[feet.edges] / length
    turn = turn - tangent * np.sum(tangent * turn, axis=1)[:, None]
    normal_change = np.column_stack([turn[:, 1], -turn[:, 0]])
    return np.asarray(np.sum(feet.normals * moved, axis=1) + np.sum(normal_change * (feet.places - points), axis=1))


@dataclass(frozen=True, eq=False)
class Trace:
    """From displacements of a chain's points to distances of points that were seen on the deformed outline.

    Parameters
    ----------
    nodes : array (k, 2), mm
        The undeformed chain.
    places : array (m, 2), mm
        The points that were seen.
    pictures : array (m,)
        The number of the picture in which each was seen: the chain is seen once for each picture, one after the other.
    starts : array (m,), mm
        How far each point lies outside of the undeformed outline.
    groups, shares : arrays (m,)
        The group of points to which each belongs, and its share in the mean of that group.
    """

    nodes: Array
    places: Array
    pictures: Ints
    starts: Array
    groups: Ints
    shares: Array

    @property
    def key(self) -> bytes:
        """What decides which distances are seen."""
        parts = (self.nodes, self.places, self.pictures, self.starts, self.groups, self.shares)
        return b"".join(np.ascontiguousarray(part).tobytes() for part in parts)

    def apparent(self, moved: Array) -> Array:
        """Apparent motions (g,) of the outline, mm, of displacements (pictures * k * 2,) of its points: what was measured, and the
        distance by which the outline lies outside of it."""
        rows = self.starts.copy()
        for number, nodes in enumerate(self.nodes + self._split(moved)):
            own = self.pictures == number
            rows[own] += beyond(self.places[own], nodes)
        return np.asarray(np.bincount(self.groups, self.shares * rows))

    def change(self, moved: Array, change: Array) -> Array:
        """Derivative (g,) of `apparent`, from that of the displacements (pictures * k * 2,)."""
        rows = np.zeros(len(self.places))
        for number, (nodes, by) in enumerate(zip(self.nodes + self._split(moved), self._split(change), strict=True)):
            own = self.pictures == number
            rows[own] = beyond_change(self.places[own], nodes, by)
        return np.asarray(np.bincount(self.groups, self.shares * rows))

    def _split(self, values: Array) -> Array:
        return values.reshape(-1, *self.nodes.shape)
