"""The whole sample from a part of it: its mirror images in the planes of symmetry x = 0 and z = 0, or its turned image."""

from dataclasses import replace

import numpy as np
from skfem import ElementHex1, ElementHex2

from indentfit.arrays import Array, Ints
from indentfit.fem.fields import Fields

COMPONENTS = ("xx", "yy", "zz", "xy", "yz", "xz")  # of a stress, in the order of fem.fields
NODES = {8: ElementHex1.doflocs, 27: ElementHex2.doflocs}  # nodes of the reference element, in scikit-fem's order
SAME = 1e-7  # of the sample's extent: nodes nearer than this are merged
IMAGES = {"quarter": ((0,), (2,)), "mirror_x": ((0,),), "mirror_z": ((2,),), "half": ((0, 2),), "whole": ()}
"""Part of the sample -> the images that complete it, one after the other; an image changes the signs of these coordinates."""


def whole(fields: Fields) -> Fields:
    """Fields of the whole sample. On a plane of symmetry they are the mean of both sides, so that shear stresses vanish there."""
    for axes in IMAGES[fields.part]:
        fields = _joined(fields, axes)
    return replace(fields, part="whole")


def _joined(fields: Fields, axes: tuple[int, ...]) -> Fields:
    """Fields of a part and of its image."""
    both = [fields, image(fields, axes)]
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
    return Fields(
        nodes=merged("nodes"),
        elements=place[elements],
        displacement=merged("displacement"),
        nodal_stress=merged("nodal_stress"),
        cell_stress=np.concatenate([part.cell_stress for part in both]),
        volume_ratio=np.concatenate([part.volume_ratio for part in both]),
        contact_pressure=merged("contact_pressure"),
        layer=None if fields.layer is None else np.tile(fields.layer, 2),
    )


def image(fields: Fields, axes: tuple[int, ...]) -> Fields:
    """Fields of the image in which the coordinates `axes` (0 is x, 2 is z) have other signs: one is a mirror image, both a turn.

    Elements of a mirror image are numbered backwards in one direction, so that their volumes stay positive.
    """
    sign = np.ones(3)
    sign[list(axes)] = -1
    across = np.array([sign["xyz".index(first)] * sign["xyz".index(second)] for first, second in map(tuple, COMPONENTS)])
    order = _backwards(fields.elements.shape[1]) if len(axes) == 1 else np.arange(fields.elements.shape[1])
    return replace(
        fields,
        nodes=fields.nodes * sign,
        elements=fields.elements[:, order],
        displacement=fields.displacement * sign,
        nodal_stress=fields.nodal_stress * across,
        cell_stress=fields.cell_stress * across,
    )


def _backwards(number: int) -> Ints:
    """Order of an element's nodes in which its first direction runs backwards."""
    places = NODES[number]
    turned = places * [-1, 1, 1] + [1, 0, 0]
    return np.array([np.flatnonzero(np.all(np.isclose(places, place), axis=1))[0] for place in turned])
