"""A solved test as pictures show it: the visible surface of the deformed sample with its fibres and its indenter."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from skfem.io.meshio import HEX_MAPPING

from indentfit.arrays import Array, Ints
from indentfit.fem.fields import Fields
from indentfit.fibre_map import FibreMap
from indentfit.fibres import Families, Fibre, words
from indentfit.indenters.shape import IndenterShape
from indentfit.report.indenter_outline import Outline, outline

SIDES = {"quarter": (), "half": (0,), "mirror_x": (2,), "mirror_z": (0,), "whole": (0,)}  # axes of which pictures show both sides
EYE = np.array([-0.70, 0.62, -1.0])  # from the sample towards the eye
LINES = 9  # of fibres on the top of the sample
# Edges by their corners and faces by theirs, in VTK's order of the nodes of a 27-node brick
EDGES = ((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7))
FACES = ((0, 3, 7, 4), (1, 2, 6, 5), (0, 1, 5, 4), (3, 2, 6, 7), (0, 1, 2, 3), (4, 5, 6, 7))


@dataclass(frozen=True, eq=False)
class Shown:
    """A test as pictures show it.

    Parameters
    ----------
    name : str
    angle, dip : float, degrees
        Direction of the fibres.
    fields : Fields
    indenter : IndenterShape or None
        The indenter that is drawn, at the depth of the fields, mm; None leaves it out.
    depth : float
    fibre : array (3,), (2, 3), FibreMap or None
        Direction of the fibres in the undeformed sample, of one family or of two.
    cut : bool
        Whether half of a whole sample is left out, so that one sees what is under the indenter.
    families : Families or None
        Angles and dips of two families of fibres.
    """

    name: str
    angle: float
    fields: Fields
    indenter: IndenterShape | None = None
    depth: float = 0.0
    fibre: Fibre | None = None
    dip: float = 0.0
    cut: bool = True
    families: Families | FibreMap | None = None

    @property
    def words(self) -> str:
        """The test's name, with the direction of its fibres where it has any."""
        return self.name if self.fibre is None else f"{self.name} ({words(self.angle, self.dip, self.families)})"

    @cached_property
    def drawn(self) -> Fields:
        """The fields that are drawn."""
        return self.fields.pictured if self.cut else self.fields

    @cached_property
    def view(self) -> "View":
        """The sample as the eye sees it, the same for the pictures of all components."""
        return _view(self)


@dataclass(frozen=True, eq=False)
class View:
    """The visible surface of a deformed sample, the far parts first.

    Parameters
    ----------
    flat : array (n, 2), mm
        Nodes in the plane of the picture.
    triangles : array (t, 3) of nodes
    edges : array (q, 5, 2), mm
        Outlines of the faces of the elements.
    fibres : list of arrays (m, 2), mm
    indenter : Outline or None
    seen_as : array (3, 2)
        What the picture shows of x, y and z: to the right and up.
    """

    flat: Array
    triangles: Ints
    edges: Array
    fibres: list[Array]
    indenter: Outline | None
    seen_as: Array


def _view(test: Shown) -> View:
    fields = test.drawn
    x = fields.nodes + fields.displacement
    quads = surface(fields.elements)
    towards = EYE / np.linalg.norm(EYE)
    right = np.cross([0.0, 1.0, 0.0], towards)
    right /= np.linalg.norm(right)
    seen_as = np.column_stack([right, np.cross(towards, right)])
    middle = x[quads].mean(axis=1)
    normal = _normals(x, quads) * _outwards(fields.nodes, quads)[:, None]
    seen = normal @ towards > 1e-12
    quads = quads[seen][np.argsort(middle[seen] @ towards)]
    flat = x @ seen_as
    triangles = np.stack([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]], axis=1).reshape(-1, 3)
    fibres = [] if test.fibre is None or isinstance(test.fibre, FibreMap) else list(np.atleast_2d(test.fibre))
    lines = [line @ seen_as for fibre in fibres for line in _fibres(fields, fibre)]
    indenter = None if test.indenter is None else outline(test.indenter, test.depth, fields.nodes, SIDES[fields.part])
    return View(flat, triangles, flat[quads[:, [0, 1, 2, 3, 0]]], lines, indenter, seen_as)


def surface(elements: Ints) -> Ints:
    """Quads (m, 4) of nodes, turned outwards, that cover the boundary of bricks (n, 8 or 27) in scikit-fem's order.

    A face of a 27-node brick gives four.
    """
    cells = elements[:, HEX_MAPPING[: elements.shape[1]]]
    corners = np.concatenate([cells[:, list(face)] for face in FACES])
    centre = np.tile(np.arange(len(cells)), 6)
    _, first, count = np.unique(np.sort(corners, axis=1), axis=0, return_index=True, return_counts=True)
    outer = np.sort(first[count == 1])
    if elements.shape[1] == 8:
        return corners[outer]
    quads = []
    for place in outer:
        number, cell = place // len(cells), cells[centre[place]]
        face = FACES[number]
        middle = [8 + _edge(face[n], face[(n + 1) % 4]) for n in range(4)]
        for n in range(4):
            quads.append(cell[[face[n], middle[n], 20 + number, middle[n - 1]]])
    return np.array(quads)


def _edge(a: int, b: int) -> int:
    return next(n for n, edge in enumerate(EDGES) if set(edge) == {a, b})


def _fibres(fields: Fields, fibre: Array) -> list[Array]:
    """Lines (n, 3) on the deformed top along the fibres, at equal distances; nothing for fibres that do not lie in the top."""
    from matplotlib.tri import LinearTriInterpolator, Triangulation  # where a picture is drawn only

    nodes = fields.nodes
    top = nodes[:, 1] > nodes[:, 1].max() - 1e-6 * np.ptp(nodes[:, 1])
    quads = surface(fields.elements)
    quads = quads[top[quads].all(axis=1)]
    plane = nodes[:, [0, 2]]
    along = np.array([fibre[0], fibre[2]])
    if np.linalg.norm(along) < 1e-6 or not quads.size:
        return []
    along /= np.linalg.norm(along)
    across = np.array([-along[1], along[0]])
    triangles = Triangulation(plane[:, 0], plane[:, 1], np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]))
    moved = [LinearTriInterpolator(triangles, values) for values in (nodes + fields.displacement).T]
    (first, last), (low, high) = ((np.min(plane[top] @ way), np.max(plane[top] @ way)) for way in (along, across))
    steps = np.linspace(first, last, 120)[:, None] * along
    lines = []
    for place in np.linspace(low, high, LINES + 2)[1:-1]:
        line = np.column_stack([by(*(steps + place * across).T).filled(np.nan) for by in moved])
        lines.append(line[np.isfinite(line[:, 0])])
    return [line for line in lines if len(line) > 1]


def _normals(x: Array, quads: Ints) -> Array:
    a, b, c, d = (x[quads[:, n]] for n in range(4))
    return np.cross(c - a, d - b)


def _outwards(nodes: Array, quads: Ints) -> Array:
    """1 or -1, the sign with which a quad's normal points out of the undeformed sample, which is convex (a deformed one is not)."""
    from_middle = nodes[quads].mean(axis=1) - nodes.mean(axis=0)
    return np.sign(np.einsum("ij,ij->i", _normals(nodes, quads), from_middle))
