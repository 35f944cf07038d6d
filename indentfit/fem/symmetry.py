"""Which symmetry a case is solved with: in the meridian plane where everything is round, else the least part of the sample that its
fibres allow: a quarter, a half, or the whole."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

from indentfit.case.tables import Indenter, Mesh, Sample, Solver
from indentfit.errors import MeshError
from indentfit.fibres import PART_WORDS, Kept, part_for
from indentfit.indenters import Rings
from indentfit.material import STRETCHES, Material
from indentfit.samples import Circle

Symmetry = Literal["axisymmetric"] | Kept
ISOTROPIC = {"I1", "I2", *STRETCHES}


@dataclass(frozen=True)
class Part:
    """A part of the sample that is meshed with bricks. It is grown from the quarter x, z >= 0.

    Parameters
    ----------
    copies : int
        How many such parts the whole sample is made of.
    grown : tuple of axes
        Axes (0 is x, 2 is z) along which the quarter's mirror images are added.
    planes : tuple of str
        Boundaries of the mesh that are mirror planes.
    motions : frozenset of str
        Rigid motions over a sliding base that the part's symmetry leaves free: along "x", along "z", and the "turn" about y.
    tied : bool
        Whether the cut face z = 0 is tied to itself (fem.tied).
    words : str
    """

    copies: int
    grown: tuple[int, ...]
    planes: tuple[str, ...]
    motions: frozenset[str]
    tied: bool
    words: str


PARTS: dict[str, Part] = {
    "quarter": Part(4, (), ("x0", "z0"), frozenset(), False, PART_WORDS["quarter"]),
    "half": Part(2, (0,), (), frozenset({"turn"}), True, PART_WORDS["half"]),
    "mirror_x": Part(2, (2,), ("x0",), frozenset({"z"}), False, PART_WORDS["mirror_x"]),
    "mirror_z": Part(2, (0,), ("z0",), frozenset({"x"}), False, PART_WORDS["mirror_z"]),
    "whole": Part(1, (0, 2), (), frozenset({"x", "z", "turn"}), False, PART_WORDS["whole"]),
}


def symmetry_of(
    sample: Sample, indenter: Indenter, mesh: Mesh, solver: Solver, law: type[Material], fibres: Iterable[Kept] = ()
) -> Symmetry:
    """The symmetry that a case asks for, or for "auto" the most that it has.

    Parameters
    ----------
    sample, indenter, mesh, solver : tables of a case
    law : class of the material
    fibres : symmetries that the fibres of the tests keep

    Raises
    ------
    MeshError
        The case asks for an axisymmetric solution, a quarter or a half and has not that symmetry; the text says why.
    """
    part = part_for(fibres, mesh.symmetry)
    if mesh.symmetry in PARTS:
        return part
    broken = _broken_by(sample, indenter, solver, law)
    if broken and mesh.symmetry == "axisymmetric":
        raise MeshError(f'mesh.symmetry = "axisymmetric": {broken}; leave the key out, or write "quarter"')
    return part if broken else "axisymmetric"


def held_motions(part: Part, indenter: Indenter, sample: Sample) -> frozenset[str]:
    """The rigid motions of a part that must be held, because neither symmetry nor base nor friction holds them; where layers slide,
    those of the top layer.

    Without friction the indenter presses along its normals only: their forces along x and z, and their moment about y, vanish, so
    that nothing is carried where a motion is held. A round contact begins in a point, whose friction holds no turn. Layers that
    slide are turned and pushed by the dent of their faces, so that a motion of theirs cannot be held.

    Raises
    ------
    MeshError
        A layer that slides has no place at first: neither symmetry nor the indenter's friction, nor the base, gives it one.
    """
    if sample.base == "bonded" and not sample.slides:
        return frozenset()
    free = part.motions if indenter.friction == 0 else part.motions & {"turn"}
    round_contact = isinstance(indenter.geometry.partition(0.0), Rings)
    held = free if indenter.friction == 0 or round_contact else frozenset()
    floating = len(sample.slides) > (sample.base == "bonded") and part.motions
    if sample.slides and (held or floating):
        raise MeshError(
            f'interface = "sliding": a layer has no place at first where the {part.words} is solved, for nothing but friction '
            "under a bar holds the top one, and nothing one that slides on both sides; give fibres along and across, where a "
            'quarter is solved, a bar with friction on two layers of which the lower one is bonded to the base, or "bonded" here'
        )
    return held


def _broken_by(sample: Sample, indenter: Indenter, solver: Solver, law: type[Material]) -> str:
    """What breaks the symmetry about the axis, in words; nothing where it holds."""
    if not isinstance(sample.geometry.outline, Circle):
        return "the sample is not round"
    if not isinstance(indenter.geometry.partition(0.0), Rings):
        return "the indenter is not round"
    if fibres := set(law.invariants) - ISOTROPIC:
        return f"the material has fibres across the axis ({', '.join(sorted(fibres))})"
    if solver.element != "q2p1" or solver.assembly != "compiled":
        return "an axisymmetric solution takes the element q2p1 and the compiled assembly"
    return ""
