"""The meshed body of a setup: bricks of a part of the sample, or its meridian plane; layers may slide, a half is tied to itself."""

from collections.abc import Sequence

import numpy as np

from indentfit.arrays import Array
from indentfit.errors import ConvergenceError
from indentfit.fem.body import Body
from indentfit.fem.contact_points import ContactPoints, EdgePoints, NodePoints
from indentfit.fem.element import Solid
from indentfit.fem.equilibrium import Equilibrium
from indentfit.fem.meridian import Meridian
from indentfit.fem.meridian_mesh import meridian_mesh
from indentfit.fem.mesh import quarter
from indentfit.fem.setup import Setup
from indentfit.fem.sliding import Sliding, with_slides
from indentfit.fem.tied import Tied

# Shares of the depth by which the faces of layers that slide may be apart at all, and by which they may be where points lie on what
# they lay on at rest (at 0.9 % a force was 1.9 % too small): beyond that the curve is solved with points that follow.
APART, APART_AT_REST = 0.02, 0.005
LIE = (
    "the faces of layers that slide lie {:.1%} of the depth apart or in each other (allowed {:.1%}): they slide too far, or the "
    "mesh is too coarse for how they bend"
)


def meshed_body(setup: Setup, rim: float, follows: str = "") -> tuple[Solid | Tied | Meridian | Sliding, ContactPoints]:
    """The meshed body as the setup asks for it, and the points at which it may touch; follows: whose points lie on what they have
    slid on, where layers slide, those of the "lower" or of the "upper" faces."""
    reach = setup.depth if follows else None
    if setup.in_plane:
        plane = Meridian(meridian_mesh(setup.sample, setup.indenter, setup.mesh, setup.depth))
        meridian = with_slides(plane, setup.sample, reach, follows)
        return meridian, EdgePoints(meridian)
    element, part = setup.solver.element, setup.part
    mesh = quarter(setup.sample, setup.indenter, setup.mesh, element, setup.depth, rim, part.grown)
    if setup.solver.assembly == "forms":
        from indentfit.fem.forms import FormSolid

        solid: Solid = FormSolid(mesh, element, part)
    else:
        solid = Solid(mesh, element, part)
    whole = with_slides(solid, setup.sample, reach, follows)
    body = Tied(whole) if part.tied else whole
    return body, NodePoints(body, setup.sample.thickness)


def apart(body: Body, u: Array) -> float:
    """How far apart the faces of layers that slide are at displacements u (n,), or how far in each other, mm; 0 without such."""
    cut = _cut(body)
    return cut.facets.apart(body.unfolded(u)[1]) if cut is not None else 0.0


def require_together(body: Body, there: Equilibrium, step: int) -> None:
    """Raise ConvergenceError where the faces of layers that slide do not lie on each other at a step."""
    off = apart(body, there.u) / there.depth if _cut(body) is not None else 0.0
    if off > APART:
        cause = f"{LIE.format(off, APART)}; give a smaller depth, or a smaller mesh.error"
        raise ConvergenceError(cause, there.depth, step)


def slid_too_far(body: Body, path: Sequence[Equilibrium]) -> ConvergenceError | None:
    """The error of a path whose faces have come farther apart than those may whose points lie on what they lay on at rest."""
    offs = [apart(body, there.u) / there.depth for there in path[1:]] if _cut(body) is not None else []
    if not offs or max(offs) <= APART_AT_REST:
        return None
    step = int(np.argmax(offs)) + 1
    return ConvergenceError(LIE.format(max(offs), APART_AT_REST), path[step].depth, step)


def _cut(body: Body) -> Sliding | None:
    """The body of all nodes whose layers slide; None without such."""
    solid = body.solid if isinstance(body, Tied) else body
    return solid if isinstance(solid, Sliding) else None
