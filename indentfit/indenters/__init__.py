"""Shapes of rigid indenters: one class for each, which alone knows its keys, its face, what meshes need of it, and its words.

A third party's shape registers with `SHAPES.register` or in the entry-point group `indentfit.indenters`. It may use the keys of the
case's table [indenter]; another key would have to be a field of that table first. `shape` has the Protocol.

Axes: y is the axis of indentation; the indenter is centred on the axis x = z = 0, above the sample. All lengths in mm.
"""

from indentfit.indenters.distances import from_upright_punch
from indentfit.indenters.fit import WIDEST_INDENTER
from indentfit.indenters.flat import Cylinder, Strip
from indentfit.indenters.pointed import Cone, Sphere, Wedge
from indentfit.indenters.shape import SHAPES, UP, Band, Distance, IndenterShape, Rings, has_sharp_edge

__all__ = [
    "SHAPES", "UP", "WIDEST_INDENTER", "Band", "Cone", "Cylinder", "Distance", "IndenterShape", "Rings", "Sphere", "Strip", "Wedge",
    "from_upright_punch", "has_sharp_edge",
]  # fmt: skip
