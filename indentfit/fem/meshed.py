"""The meshed body of a setup: bricks of a part of the sample, or its meridian plane; layers may slide, a half is tied to itself."""

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

APART = 0.02  # of the depth: how far apart the faces of layers that slide may be, by the mesh and by the pairing of their points


def meshed_body(setup: Setup, rim: float, follows: bool = False) -> tuple[Solid | Tied | Meridian | Sliding, ContactPoints]:
    """The meshed body as the setup asks for it, and the points at which it may touch; follows: whether points of layers that slide
    lie on what they have slid on, not on what they lay on at rest."""
    reach = setup.depth if follows else None
    if setup.in_plane:
        plane = Meridian(meridian_mesh(setup.sample, setup.indenter, setup.mesh, setup.depth))
        meridian = with_slides(plane, setup.sample, reach)
        return meridian, EdgePoints(meridian)
    element, part = setup.solver.element, setup.part
    mesh = quarter(setup.sample, setup.indenter, setup.mesh, element, setup.depth, rim, part.grown)
    if setup.solver.assembly == "forms":
        from indentfit.fem.forms import FormSolid

        solid: Solid = FormSolid(mesh, element, part)
    else:
        solid = Solid(mesh, element, part)
    whole = with_slides(solid, setup.sample, reach)
    body = Tied(whole) if part.tied else whole
    return body, NodePoints(body, setup.sample.thickness)


def apart(body: Body, u: Array) -> float:
    """How far apart the faces of layers that slide are at displacements u (n,), or how far in each other, mm; 0 without such."""
    cut = (
        getattr(body, "solid", body) if not isinstance(body, Sliding) else body
    )  # of a half that is tied to itself: all of its nodes
    return cut.facets.apart(body.unfolded(u)[1]) if isinstance(cut, Sliding) else 0.0


def require_together(body: Body, there: Equilibrium, step: int) -> None:
    """Raise ConvergenceError where the faces of layers that slide do not lie on each other at a step."""
    off = apart(body, there.u) / there.depth if isinstance(body, Sliding | Tied) else 0.0
    if off > APART:
        cause = (
            f"the faces of layers that slide lie {off:.1%} of the depth apart or in each other (allowed {APART:.0%}): they slide "
            "too far, or the mesh is too coarse for how they bend; give a smaller depth, or a smaller mesh.error"
        )
        raise ConvergenceError(cause, there.depth, step)
