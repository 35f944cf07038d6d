"""The error of the force by the mesh: estimated for each curve by a second mesh.

The forces F of a mesh, and G of a mesh whose elements are RATIO times as wide, approach the same limit, so that |F - G| measures
the error of F. Its rate differs between contacts, and the end of a contact that grows passes the elements one by one, so that F -
G may be small by chance at one depth. The band that is stated is therefore FACTOR times the largest |F - G| so far along the
curve, and at least FLOOR of the force. Where no mesh with clearly fewer elements can be had, G is that of a finer mesh, which
lies nearer: the band is then RATIO^ORDER times as wide. Bricks hold a growing contact by its nodes: there the band is at least
NODES times the squared width of the elements at the contact's edge over that of the contact at each depth, which is much at the
first depths.

At large strain the sample's surface folds in at a sharp edge of the meridian plane under which the sample slips: only the footprint
may touch such an edge, so that the surface beside the footprint comes to lie inside the punch, mesh by mesh, and the force is too
small. Punches with small edge radii show by how much: their forces are the same on all meshes, and approach a limit as the radius
falls. At a depth of half of the radius, on a neo-Hookean gel of 7 radii without friction, that limit is 9 % below the straight line
of small strain, while a sharp edge has 12 to 13 %. There the band is at least that of FOLDS, a power of the depth over the
indenter's half-width (or over the thickness, where that is less). Where the sample sticks, the surface beside the edge comes to lie
against the punch's wall, on which it slips freely, and the force approaches its limit slower than the elements at the edge get
narrower. FOLDS holds that, and friction on the wall.

The steps of the depth err too where a contact grows with friction. In the meridian plane they cost up to 0.3 % of the last force
and 1 % of the first ones, and the second solution takes longer ones, so that |F - G| shows that error. Bricks state STEPS times
the squared friction (1 at most) times the contact's half-width over the thickness and the number of steps.

The constants were chosen so that the band holds the error in 95 % of contacts whose exact forces, or forces on much finer meshes,
are known (tests/campaigns/mesh_error.py, tests/test_references.py); those of eight-node bricks are the theory's, an error in
proportion to the size.

Forces between the steps, and under a sphere before the first one, continue those of the steps, on all meshes alike. There the band
is at least the distance between two ways to continue them (interpolation.Interpolant.doubt).
"""

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from indentfit.arrays import Array
from indentfit.case.tables import Mesh
from indentfit.errors import ConvergenceError
from indentfit.fem.controls import FIRST_STEPS, Report
from indentfit.fem.interpolation import POWERS as GROWS
from indentfit.fem.interpolation import Interpolant
from indentfit.fem.meridian_mesh import ROUND, width_at_corner
from indentfit.fem.meshing import count, resized, size, widths_within
from indentfit.fem.result import ForceError, Simulation, TestResult
from indentfit.fem.setup import Press, Setup
from indentfit.fem.simulate import Model
from indentfit.indenters import Band, Rings, has_sharp_edge

RATIO = {"axisymmetric": 2.0, "quarter": 1.4}
FACTOR = {("axisymmetric", "q2p1"): 1.0, ("quarter", "q2p1"): 1.0, ("quarter", "q1p0"): 2.5}
STRIP = 2.0  # more under strips and wedges, whose change falls short of the error: narrow strips, and another code's curves
# More in the meridian plane under a sharp edge that sticks: elements twice as wide at the corner change forces by 0.7 to 0.8 of
# their error, at the first of the depths.
STICKS = 1.5
ORDER = {"q2p1": 1.5, "q1p0": 1.0}
SHARP_ORDER = 1.0  # of the meridian plane under a sharp edge, where the stress grows as one over the root of the distance
REMAINS = 0.5  # standard deviation of what the correction of a curve leaves, over the correction
LEAST = 1e-3  # its least value, of the force
SMOOTHLY = 0.3  # of the depth: length over which what remains keeps its sign
FEWER = 0.75  # share of the elements that a coarser mesh may have at most
# Of bands where a second try took a coarser mesh, because the usual one folded. Of 57 curves of strips at folds, on 60 bricks in
# place of 124 or 145, six differ from those of the usual mesh by more than the band, under edges of 0.05 mm, by up to 2.4 of it.
AFTER_RETRY = 2.5
FLOOR = {("axisymmetric", "q2p1"): 2e-3, ("quarter", "q2p1"): 5e-3, ("quarter", "q1p0"): 1e-2}  # of the force
NODES = {Rings: 0.15, Band: 1.6}  # spheres and wedges on bricks, against the meridian plane and against finer bricks
POINTED = 0.05  # cones in the meridian plane, whose contact is narrower than an element at the first depths
# Of bricks, for a depth of the punch's radius: beside the plane those of an edge of a tenth to a thirtieth of the radius are 0.9 to
# 1.2 % too stiff at 0.8 radii and 1.5 and 1.6 % at one, where two meshes differ by 0.3 to 0.8 %.
EDGE_ON_BRICKS = 0.015
# Of bricks as wide at a rounded edge as the punch's radius, while the depth is at most half of the edge's radius, and less in
# proportion to one over the depth from there on: the contact ends somewhere in an element of the edge. Seven punches with edges of
# a tenth to two fifths of their radius err by 0.4 to 1.04 times the width at the worst of five depths, beside the plane; with 112
# to 144 elements, two to five times as wide, by up to 7.8 % too.
ROUNDED_ON_BRICKS, ROUNDED_MOST = 1.1, 0.09
# In the plane under a sharp edge that sticks, for elements there as wide as the radius (or the thickness, where that is less):
# against meshes of 740 to 920 elements those of 0.03 to 0.1 err by 0.09 to 0.12 times this width at the first depths.
CORNER = 0.13
EDGE = 0.005  # for each time that elements along a rounded edge in the plane are wider than usual: against meshes of 700 elements
FOLDS = {  # factor, power, and largest share of the force
    # Curves of six meshes on layers of 0.5 to 3 punch radii. Punches with an edge of a tenth of the radius have forces that are
    # larger by 15 % without friction, and by 24 % at a friction of 0.3, where the depth is 1.5 radii; one with
    # an edge of a fourteenth has a force that is larger by 36 % at a friction of 1 and 3.6 radii.
    "free": (0.5, 2.0, 0.4),
    # Another code's curve (axi_punch_a0.5_stick_bonded), which knows no wall above the edge: without it the finest mesh meets that
    # curve within 0.2 %, with it the surface cannot pass into the punch, and the force is 0.9 % larger at 0.54 radii. A wall that
    # sticks adds 0.5 %.
    "stick": (0.03, 1.0, 0.01),
    # Bricks have no wall there and are coarser at the edge: default ones lie up to 2.0 % above that curve, at 0.36 radii. Under a
    # punch as wide as the layer is thick they lie up to 2.3 % above the plane at 0.2 radii, on half of that layer 3.8 % at 0.24
    # thicknesses, and 144 coarse ones 4.1 % at 0.4 radii.
    "stick on bricks": (0.2, 1.0, 0.06),
}
POWERS = (-1, 0, 1)  # of the depth: what a correction, relative to the force, is made of
DEEPER = 1 + 1e-9  # round-off
STEPS = 0.12  # measured on spheres of 1 to 10 thicknesses, friction 0.3 and 1 (tests/test_mesh_error.py holds one)
COARSER_STEPS = 3.0
FOLDING = (
    "at this depth the surface folds in at the sharp edge, so that the computed force may be too small; "
    "state the edge's radius, indenter.edge_radius"
)


InTime = Callable[[TestResult, Press], TestResult]  # a solved press to the same with its force over time


def with_mesh_errors(
    simulation: Simulation,
    setup: Setup,
    presses: Sequence[Press],
    progress: Callable[..., None] | None = None,
    in_time: InTime | None = None,
) -> Simulation:
    """A simulation whose tests state the error of their forces by the mesh.

    Parameters
    ----------
    simulation : Simulation
    setup, presses
        Those of the simulation.
    progress : called with (name of a test, share of the second solution that is done), and `tries` as `Model.simulate` does
    in_time : function, or None
        How forces over time are solved, where the material relaxes.

    Returns
    -------
    Simulation
        A test whose second solution fails has the cause in place of its error.
    """
    tests: list[TestResult] = []
    models: dict[int, tuple[Setup, Model, SecondMesh]] = {}  # by the number of elements: a test may have needed a coarser mesh
    for press, test in zip(presses, simulation.tests, strict=True):
        if test.facts.elements not in models:
            own = _as_solved(setup, test.facts.elements)
            other = second(own) if own is setup else second(own).less_sure(AFTER_RETRY)
            models[test.facts.elements] = own, Model(other.setup), other
        own, model, mesh = models[test.facts.elements]
        report = functools.partial(progress, press.name) if progress else None
        tests.append(_with_error(test, _solved_again(model, press, test, report), mesh, press, own, in_time))
    return replace(simulation, tests=tuple(tests))


def _as_solved(setup: Setup, elements: int) -> Setup:
    """The setup with the mesh on which a test was solved: that of a second try may be coarser than the setup's own."""
    if elements >= FEWER * count(setup):
        return setup
    return replace(setup, mesh=Mesh(symmetry=setup.mesh.symmetry, elements=round(elements / setup.quarters)))


def _solved_again(model: Model, press: Press, test: TestResult, progress: Report | None) -> TestResult | str:
    """A test by the model of a second mesh, or why that tells nothing."""
    try:
        other = model.run(replace(press, sensitivities=(), observed=None), progress)
    except ConvergenceError as error:
        return f"the second mesh for its estimate was not solved: {error}"
    if other.facts.tries > 1 and FEWER < other.facts.elements / test.facts.elements < 1 / FEWER:
        return f"the second mesh for its estimate was solved with {other.facts.elements} elements only, which is no other mesh"
    return other


def _with_error(
    test: TestResult, other: TestResult | str, mesh: "SecondMesh", press: Press, setup: Setup, in_time: InTime | None
) -> TestResult:
    """A test with the errors of its force, and of its force over time, that the same test on a second mesh tells."""
    curve = test.in_time
    if isinstance(other, str):
        return replace(test, mesh_error=other, in_time=curve and replace(curve, by_mesh=other))
    error = force_error(test, other, mesh, setup)
    if in_time is not None and curve is not None and curve.difference is not None:
        shares = np.divide(error.band, test.force, out=np.zeros_like(error.band), where=test.force > 0)
        least = curve.counted(curve.time, np.interp(curve.displacement, test.displacement, shares))
        curve = curve.with_second(in_time(other, press), mesh.factor, least)
    return replace(test, mesh_error=error, in_time=curve)


@dataclass(frozen=True)
class SecondMesh:
    """A second mesh of a setup, and what its forces G tell of the forces F of the setup's own mesh.

    Parameters
    ----------
    setup : Setup
        The setup with the second mesh.
    factor : float
        The band of F over the largest |F - G|.
    growth : float
        The error of G over that of F.
    """

    setup: Setup
    factor: float
    growth: float

    def less_sure(self, times: float) -> "SecondMesh":
        """The same mesh with a band that is so many times as wide."""
        return replace(self, factor=times * self.factor)

    @property
    def gain(self) -> float:
        """F + gain (G - F) is the force that both meshes approach."""
        return 1 / (1 - self.growth)

    @property
    def finer(self) -> bool:
        """Whether the second mesh is the finer one."""
        return self.growth < 1

    @property
    def beyond(self) -> float:
        """The part of `gain` that is extrapolated beyond the finer mesh."""
        return self.gain - 1 if self.finer else self.gain


def second(setup: Setup) -> SecondMesh:
    """The second mesh of the estimate: coarser, or finer where no mesh with clearly fewer elements can be had."""
    longer = _with_longer_steps(setup)
    coarse = resized(longer, RATIO[setup.grown_from])
    if count(coarse) <= FEWER * count(setup):
        return compared(setup, coarse)
    return compared(setup, resized(longer, 1 / RATIO[setup.grown_from]))


def compared(setup: Setup, other: Setup) -> SecondMesh:
    """Another mesh of a setup as its second mesh."""
    element = setup.solver.element
    growth = (size(other) / size(setup)) ** (SHARP_ORDER if _sharp_in_plane(setup) else ORDER[element])
    factor = FACTOR[setup.grown_from, element]
    if element == "q2p1" and isinstance(setup.indenter.geometry.partition(setup.depth), Band):
        factor *= STRIP
    if _sharp_in_plane(setup) and _kind_of_edge(setup) == "stick":
        factor *= STICKS
    return SecondMesh(other, factor if growth > 1 else factor / growth, growth)


def _with_longer_steps(setup: Setup) -> Setup:
    """The setup with longer steps, where the force in the meridian plane depends on them."""
    if not setup.in_plane or not setup.rubs:
        return setup
    longest = COARSER_STEPS * setup.solver.max_step if setup.solver.max_step else setup.depth / FIRST_STEPS
    return replace(setup, solver=setup.solver.model_copy(update={"max_step": longest}))


def force_error(test: TestResult, other: TestResult, mesh: SecondMesh, setup: Setup) -> ForceError:
    """The stated error of a test's forces, from those of the second mesh."""
    change = mesh.factor * np.maximum.accumulate(np.abs(other.force - test.force))
    shape = setup.block[1].effect if setup.block else 0.0
    floor = FLOOR[setup.grown_from, setup.solver.element] + shape
    least = floor + _few_nodes(setup, test.displacement) + _long_steps(setup, test) + _coarse_edge(setup, test.displacement)
    folds = _folds(setup, test.displacement)
    band = np.maximum.accumulate(np.maximum(change, np.maximum(least, folds) * np.abs(test.force)))
    band = np.maximum(band, _between_steps(test, setup) * np.abs(test.force))
    remark = FOLDING if folded(setup, test.displacement) else ""
    relative = np.divide(other.force - test.force, test.force, out=np.zeros_like(test.force), where=test.force != 0)
    correction = corrected(test.displacement, relative, test.force, mesh)
    left = np.sqrt(np.diag(left_by_correction([test.displacement], [relative], mesh)[0]))
    return ForceError(band, other.facts.elements, remark, correction, left)


def _between_steps(test: TestResult, setup: Setup) -> Array:
    """Share (n,) by which the forces may err between the steps and before the first one, which continue those of the steps."""
    forces = [point.whole_force for point in test.path]
    depths = [point.depth for point in test.path]
    return Interpolant(depths, forces, GROWS[setup.indenter.geometry.end]).doubt(test.displacement)


def corrected(depth: Array, change: Array, force: Array, other: SecondMesh) -> Array:
    """The relative correction (n,) of a curve whose forces (n,) change by shares (n,) on another mesh; none where it goes deeper
    than meshes say enough."""
    if depth.max() > unfolded_depth(other.setup) * DEEPER:
        return 0.0 * change
    return other.gain * smooth(depth, change, force)


def smooth(depth: Array, change: Array, force: Array) -> Array:
    """The part of relative changes of forces that is made of POWERS of the depth, all (n,); all of it where points are few, or the
    depth does not only grow."""
    if depth.size < 2 * len(POWERS) or depth[0] <= 0 or np.any(np.diff(depth) <= 0):
        return change
    powers = (depth[:, None] / depth[-1]) ** np.array(POWERS, dtype=float)
    return np.asarray(powers @ np.linalg.lstsq(powers * force[:, None], change * force, rcond=None)[0])


def folded(setup: Setup, depths: Array) -> bool:
    """Whether the surface folds in at a sharp edge so much, at some of the depths (n,), that other meshes say little."""
    floor = FLOOR[setup.grown_from, setup.solver.element]
    return setup.indenter.friction != "stick" and bool(_folds(setup, depths).max() > 2 * floor)


def unfolded_depth(setup: Setup) -> float:
    """The depth, mm, up to which a sharp edge that folds in errs by no more than the error that the mesh is made for."""
    factor, power, most = FOLDS[_kind_of_edge(setup)]
    if not _sharp_in_plane(setup) or most <= setup.mesh.wanted_error:
        return float("inf")
    return _width_of_folds(setup) * float((setup.mesh.wanted_error / factor) ** (1 / power))


def left_by_correction(depths: Sequence[Array], changes: Sequence[Array], other: SecondMesh) -> list[Array]:
    """Covariance of what the correction F + gain (G - F) leaves of the errors of curves, relative to their forces.

    It leaves all of the error by a sharp edge that folds in, whose band is two standard deviations wide.

    Parameters
    ----------
    depths : sequence of arrays (n,), mm
    changes : sequence of arrays (n,)
        (G - F) / F of each curve.
    other : SecondMesh

    Returns
    -------
    list of arrays (n, n)
    """
    worst = max(float(np.sqrt(np.mean((other.beyond * change) ** 2))) for change in changes)
    sd = max(REMAINS * worst, LEAST * min(other.growth, 1.0))
    sds = [np.hypot(sd, _folds(other.setup, depth) / 2) for depth in depths]
    return [np.outer(own, own) * _smooth(depth) for own, depth in zip(sds, depths, strict=True)]


def _smooth(depth: Array) -> Array:
    """Correlation (n, n) of what remains at depths (n,)."""
    return np.asarray(np.exp(-0.5 * (np.subtract.outer(depth, depth) / (SMOOTHLY * depth.max())) ** 2), dtype=float)


def _few_nodes(setup: Setup, depths: Array) -> Array:
    """The least relative error (n,) under a contact that grows from nothing: at small depths it meets few nodes of bricks,
    and a cone in the meridian plane less than an element."""
    shape = setup.indenter.geometry
    if shape.edge_radius is not None or (setup.in_plane and shape.end != "cone"):
        return np.zeros(len(depths))
    contacts = [shape.partition(float(depth)) for depth in depths]
    factors = np.array([POINTED if setup.in_plane else NODES[type(contact)] for contact in contacts])
    half_widths = np.array([contact.half_width for contact in contacts])
    return np.minimum(factors * (widths_within(setup, half_widths) / half_widths) ** 2, 1.0)


def _coarse_edge(setup: Setup, depths: Array) -> Array:
    """The least relative error (n,) by the width of the elements under a punch's sharp edge in the meridian plane that sticks, and
    under a rounded edge: in the meridian plane with fewer than the usual elements along
    it, where the end of the contact lies somewhere in an element, on two coarse meshes alike by chance; on bricks at all depths."""
    shape = setup.indenter.geometry
    if _sharp_in_plane(setup) and _kind_of_edge(setup) == "stick":
        width = width_at_corner(setup.sample, setup.indenter, setup.mesh, setup.depth)
        return np.full(len(depths), CORNER * width)
    if not shape.edge_radius or not isinstance(shape.partition(setup.depth), Rings):
        return np.zeros(len(depths))
    if setup.in_plane:
        return np.full(len(depths), EDGE * max(size(setup) * ROUND / shape.edge_radius - 1, 0.0))
    width = float(widths_within(setup, np.array([shape.half_width]))[0])
    shallow = np.minimum(1.0, shape.edge_radius / (2 * np.maximum(depths, 1e-300)))
    narrow = min(ROUNDED_ON_BRICKS * width / shape.half_width, ROUNDED_MOST)
    return np.maximum(EDGE_ON_BRICKS * depths / shape.half_width, narrow * shallow)


def _long_steps(setup: Setup, test: TestResult) -> float:
    """The relative error of bricks' force by the length of the steps."""
    if setup.in_plane or not setup.rubs:
        return 0.0
    indenter = setup.indenter
    friction = 1.0 if indenter.friction == "stick" else min(float(indenter.friction), 1.0)
    contact = indenter.geometry.partition(setup.depth).half_width
    return STEPS * friction**2 * contact / setup.sample.thickness / test.facts.steps


def _sharp_in_plane(setup: Setup) -> bool:
    return setup.in_plane and has_sharp_edge(setup.indenter.geometry)


def _folds(setup: Setup, depths: Array) -> Array:
    """The least relative error (n,) of the force by a sharp edge, at depths (n,)."""
    if not (_sharp_in_plane(setup) or _sticks_on_bricks(setup)):
        return np.zeros(len(depths))
    factor, power, most = FOLDS["stick on bricks" if _sticks_on_bricks(setup) else _kind_of_edge(setup)]
    return np.minimum(factor * (depths / _width_of_folds(setup)) ** power, most)


def _sticks_on_bricks(setup: Setup) -> bool:
    """Whether bricks lie under a round punch with a sharp edge that sticks."""
    return setup.ties_round and not setup.in_plane


def _kind_of_edge(setup: Setup) -> str:
    return "stick" if setup.indenter.friction == "stick" else "free"


def _width_of_folds(setup: Setup) -> float:
    """The length, mm, over which the depth is counted for folds."""
    return float(min(setup.indenter.geometry.half_width, setup.sample.top_thickness))
