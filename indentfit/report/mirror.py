"""The whole sample from its quarter: mirrored in the planes of symmetry x = 0 and z = 0."""

from dataclasses import replace

import numpy as np
from skfem import ElementHex1, ElementHex2

from indentfit.arrays import Array, Ints
from indentfit.fem.fields import Fields

COMPONENTS = ("xx", "yy", "zz", "xy", "yz", "xz")  # of a stress, in the order of fem.fields
NODES = {8: ElementHex1.doflocs, 27: ElementHex2.doflocs}  # nodes of the reference element, in scikit-fem's order
SAME = 1e-7  # of the sample's extent: nodes nearer than this are merged


def whole(fields: Fields) -> Fields:
    """Fields of the whole sample. On a plane of symmetry they are the mean of both sides, so that shear stresses vanish there."""
    return _joined(_joined(fields, 0), 2)


def _joined(fields: Fields, axis: int) -> Fields:
    """Fields of a half and of its mirror image in the plane where coordinate `axis` is 0."""
    both = [fields, reflected(fields, axis)]
    nodes = np.concatenate([half.nodes for half in both])
    keys = np.round(nodes / (SAME * np.ptp(nodes, axis=0).max())).astype(np.int64)
    _, first, place, count = np.unique(keys, axis=0, return_index=True, return_inverse=True, return_counts=True)
    place = place.reshape(-1)

    def merged(name: str) -> Array:
        values = np.concatenate([getattr(half, name) for half in both])
        total = np.zeros((first.size, *values.shape[1:]))
        np.add.at(total, place, values)
        return total / count.reshape(-1, *[1] * (values.ndim - 1))

    elements = np.concatenate([fields.elements, both[1].elements + len(fields.nodes)])
    cells = {name: np.concatenate([getattr(half, name) for half in both]) for name in ("cell_stress", "volume_ratio")}
    points = {name: merged(name) for name in ("nodes", "displacement", "nodal_stress", "contact_pressure")}
    return Fields(elements=place[elements], **points, **cells)


def reflected(fields: Fields, axis: int) -> Fields:
    """Fields of the mirror image in the plane where coordinate `axis` (0 is x, 2 is z) is 0.

    Elements are numbered backwards in one direction, so that their volumes stay positive.
    """
    sign = np.ones(3)
    sign[axis] = -1
    across = np.array([-1.0 if name.count("xyz"[axis]) == 1 else 1.0 for name in COMPONENTS])
    return replace(
        fields,
        nodes=fields.nodes * sign,
        elements=fields.elements[:, _backwards(fields.elements.shape[1])],
        displacement=fields.displacement * sign,
        nodal_stress=fields.nodal_stress * across,
        cell_stress=fields.cell_stress * across,
    )


def _backwards(number: int) -> Ints:
    """Order of an element's nodes in which its first direction runs backwards."""
    places = NODES[number]
    turned = places * [-1, 1, 1] + [1, 0, 0]
    return np.array([np.flatnonzero(np.all(np.isclose(places, place), axis=1))[0] for place in turned])
