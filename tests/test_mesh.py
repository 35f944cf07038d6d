"""Quarter samples: exact volumes, sound elements, mesh lines on the footprint's edge, as many elements as asked."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from skfem import Basis, ElementHex1, ElementHex2, FacetBasis, MeshHex

from indentfit.case import Indenter, Mesh, Sample
from indentfit.errors import MeshError
from indentfit.fem.bricks import extrude, merge, quadratic
from indentfit.fem.grading import Grading, graded
from indentfit.fem.mesh import quarter
from indentfit.fem.mesh import size as mesh_size
from indentfit.fem.plane import transfinite

THICKNESS = 3.3
SAMPLES = {
    "disc": {"shape": "disc", "diameter": 14},
    "block": {"shape": "block", "length": 14, "width": 14},
    "oblong block": {"shape": "block", "length": 20, "width": 12},
}
INDENTERS = {
    "strip": {"shape": "strip", "width": 2, "length": 20},
    "short strip": {"shape": "strip", "width": 2, "length": 6},
    "rounded strip": {"shape": "strip", "width": 2, "length": 20, "edge_radius": 0.1},
    "cylinder": {"shape": "cylinder", "diameter": 3},
    "rounded cylinder": {"shape": "cylinder", "diameter": 3, "edge_radius": 0.1},
    "sphere": {"shape": "sphere", "diameter": 4},
}
PAIRS = [(sample, indenter) for sample in SAMPLES for indenter in INDENTERS]
by_pair = pytest.mark.parametrize(("sample", "indenter"), PAIRS)


def sample_of(name, **changes):
    return Sample(**{**SAMPLES[name], "thickness": THICKNESS, "base": "sliding", **changes})


def indenter_of(name, **changes):
    return Indenter(**{**INDENTERS[name], "friction": 0.5, **changes})


def mesh_of(sample, indenter, **asked):
    return quarter(sample_of(sample), indenter_of(indenter), Mesh(**asked))


def volume(mesh):
    return Basis(mesh, ElementHex1(), intorder=2).dx.sum()


def area(mesh, boundary):
    return FacetBasis(mesh, ElementHex1(), facets=mesh.boundaries[boundary], intorder=2).dx.sum()


def corners(mesh, facets):
    """Points (3, 4, n) of facets."""
    return mesh.p[:, mesh.facets[:, facets]]


def plane_angles(mesh):
    """Angles (4, n) in degrees of the top facets in the (x, z) plane, above 180 where one is not convex."""
    p = corners(mesh, mesh.boundaries["top"])[[0, 2]]
    before, after = np.roll(p, 1, axis=1) - p, np.roll(p, -1, axis=1) - p
    cross, dot = after[0] * before[1] - after[1] * before[0], np.sum(after * before, axis=0)
    x, z = p
    clockwise = np.sum(x * np.roll(z, -1, axis=0) - np.roll(x, -1, axis=0) * z, axis=0) < 0
    return np.degrees(np.arctan2(np.where(clockwise, -cross, cross), dot)) % 360


def jacobians(mesh):
    """Jacobian determinants (n, 8) at the elements' corners, in scikit-fem's numbering."""
    basis = Basis(mesh, ElementHex1(), quadrature=(ElementHex1.refdom.p, np.full(8, 1 / 8)))
    return basis.mapping.detDF(basis.X)


# ---- geometry -------------------------------------------------------------------------------------------------------


@by_pair
def test_volume_is_that_of_a_quarter_sample(sample, indenter):
    """Exact for blocks; a disc's side is a polygon: each chord of the angle a loses the share 1 - sin(a)/a."""
    mesh, body = mesh_of(sample, indenter, elements=1500), sample_of(sample)
    if body.shape == "block":
        assert volume(mesh) == pytest.approx(body.length * body.width / 4 * THICKNESS, rel=1e-12)
        return
    exact = np.pi / 4 * (body.diameter / 2) ** 2 * THICKNESS
    x, y, z = mesh.p
    rim = (np.hypot(x, z) > body.diameter / 2 * (1 - 1e-9)) & (y == THICKNESS)
    a = np.diff(np.sort(np.arctan2(z[rim], x[rim])))
    assert a.sum() == pytest.approx(np.pi / 2, rel=1e-9)
    assert volume(mesh) == pytest.approx(exact * np.sum(np.sin(a)) / (np.pi / 2), rel=1e-9)
    assert exact * 0.985 < volume(mesh) < exact


@by_pair
def test_quadratic_bricks_fill_the_quarter_sample(sample, indenter):
    """A parabola through three points of an arc of the angle a leaves about a^4 / 500 of its sector: under 1e-3 to 45 deg."""
    mesh, body = quarter(sample_of(sample), indenter_of(indenter), Mesh(), "q2p1"), sample_of(sample)
    plane = np.pi / 4 * body.diameter**2 if body.shape == "disc" else body.length * body.width
    basis = Basis(mesh, ElementHex2(), intorder=6)
    assert basis.dx.min() > 0
    assert basis.dx.sum() == pytest.approx(plane / 4 * THICKNESS, rel=1e-3 if body.shape == "disc" else 1e-12)


def test_all_nodes_of_a_round_side_and_a_round_footprint_are_on_their_circles():
    mesh = quarter(sample_of("disc"), indenter_of("cylinder"), Mesh(), "q2p1")
    basis = Basis(mesh, ElementHex2(), intorder=2)
    named = np.concatenate([mesh.boundaries[name] for name in ("top", "base", "x0", "z0")])
    side = np.setdiff1d(mesh.boundary_facets(), named)
    x, _, z = mesh.p[:, basis.get_dofs(side).flatten()]
    assert_allclose(np.hypot(x, z), 7.0, rtol=1e-12)
    x, _, z = mesh.p[:, basis.get_dofs(mesh.boundaries["footprint"]).flatten()]
    angles = np.arctan2(z, x)[np.isclose(np.hypot(x, z), 1.5, rtol=1e-12)]
    assert np.hypot(x, z).max() < 1.5 * (1 + 1e-12) and angles.size >= 9


@pytest.mark.parametrize(("closest", "below"), [(0.0, 0.03), (0.04, 0.04), (0.2, 0.05)])
def test_first_nodes_of_a_side_that_may_roll_up_are_near_the_top_but_not_too_near(closest, below):
    """A layer of 0.1 mm: at 0.3 of it, or as far below as is asked, but never beyond its middle; others are in the middle."""
    plane = merge([np.array(np.meshgrid([0.0, 1.0, 2.0], [0.0, 1.0], indexing="ij"))])
    straight = extrude(plane, np.array([0.0, 0.9, 1.0]))
    rolls = straight.facets_satisfying(lambda p: p[0] > 1.99)
    mesh = quadratic(straight, rolls=rolls, closest=closest)
    side = mesh.p[0] == 2
    assert_allclose(np.unique(np.round(mesh.p[1, side], 12)), [0, 0.45, 0.9, 1 - below, 1])
    assert_allclose(np.unique(np.round(mesh.p[1, mesh.p[0] < 1.2], 12)), [0, 0.45, 0.9, 0.95, 1])
    assert_allclose(np.unique(np.round(mesh.p[0], 12)), [0, 0.5, 1, 1.5, 2])


@by_pair
@pytest.mark.parametrize("elements", [400, 3000])
def test_elements_are_sound(sample, indenter, elements):
    """All Jacobians of one sign, at the corners too; no sharp, no flat angle."""
    mesh = mesh_of(sample, indenter, elements=elements)
    signs = np.sign(jacobians(mesh))
    assert np.all(signs == signs[0, 0])
    angles = plane_angles(mesh)
    assert_allclose(angles.sum(axis=0), 360, rtol=1e-9)
    assert angles.min() > 25
    assert angles.max() < 160


@by_pair
def test_no_two_nodes_share_a_place_and_every_node_is_used(sample, indenter):
    mesh = mesh_of(sample, indenter, elements=400)
    assert np.unique(mesh.t).size == mesh.p.shape[1]
    keys = np.round(mesh.p / 1e-7).astype(int)
    assert np.unique(keys, axis=1).shape[1] == mesh.p.shape[1]
    inner = np.setdiff1d(np.arange(mesh.facets.shape[1]), mesh.boundary_facets())
    assert np.all(mesh.f2t[1, inner] >= 0)
    named = np.concatenate([mesh.boundaries[name] for name in ("top", "base", "x0", "z0")])
    x, _, z = np.mean(corners(mesh, np.setdiff1d(mesh.boundary_facets(), named)), axis=1)
    body = sample_of(sample)  # all else is the free side: no crack between two patches
    if body.shape == "disc":
        assert np.all(np.hypot(x, z) > 0.97 * body.diameter / 2)
    else:
        assert np.all((x > body.length / 2 * (1 - 1e-9)) | (z > body.width / 2 * (1 - 1e-9)))


@by_pair
def test_boundaries_are_where_their_names_say(sample, indenter):
    mesh, body = mesh_of(sample, indenter, elements=400), sample_of(sample)
    assert set(mesh.boundaries) >= {"top", "base", "x0", "z0", "footprint"}
    for name, axis, place in (("top", 1, THICKNESS), ("base", 1, 0.0), ("x0", 0, 0.0), ("z0", 2, 0.0)):
        assert_allclose(corners(mesh, mesh.boundaries[name])[axis], place, atol=1e-12)
    assert set(mesh.boundaries["footprint"]) <= set(mesh.boundaries["top"])
    assert area(mesh, "top") == pytest.approx(volume(mesh) / THICKNESS, rel=1e-12)
    assert area(mesh, "base") == pytest.approx(area(mesh, "top"), rel=1e-12)
    x, z = body.geometry.outline.extent
    assert area(mesh, "x0") == pytest.approx(z / 2 * THICKNESS, rel=1e-9)
    assert area(mesh, "z0") == pytest.approx(x / 2 * THICKNESS, rel=1e-9)


@pytest.mark.parametrize("sample", SAMPLES)
@pytest.mark.parametrize("indenter", ["strip", "cylinder"])
@pytest.mark.parametrize("elements", [200, 1500])
def test_mesh_lines_lie_on_the_edge_of_the_footprint(sample, indenter, elements):
    """No facet straddles a sharp edge: those of the footprint end on it, the others begin there."""
    mesh, punch = mesh_of(sample, indenter, elements=elements), indenter_of(indenter)
    top, footprint = mesh.boundaries["top"], mesh.boundaries["footprint"]

    def reach(facets):
        x, _, z = corners(mesh, facets)
        return z if punch.shape == "strip" else np.hypot(x, z)

    assert reach(footprint).max() == pytest.approx(punch.geometry.half_width, rel=1e-9)
    assert reach(np.setdiff1d(top, footprint)).min() == pytest.approx(punch.geometry.half_width, rel=1e-9)


@pytest.mark.parametrize("sample", ["block", "oblong block"])
@pytest.mark.parametrize("indenter", ["strip", "short strip"])
def test_footprint_of_a_strip_on_a_block_has_its_exact_area(sample, indenter):
    mesh, punch = mesh_of(sample, indenter, elements=400), indenter_of(indenter)
    length = min(punch.length, sample_of(sample).length)
    assert area(mesh, "footprint") == pytest.approx(length * punch.width / 4, rel=1e-9)


def test_footprint_of_a_strip_on_a_disc_reaches_the_rim():
    """Area of the disc within |z| < b: b sqrt(R^2 - b^2) + R^2 asin(b / R), half of it in x > 0, z > 0."""
    R, b = 7.0, 1.0
    exact = (b * np.sqrt(R**2 - b**2) + R**2 * np.arcsin(b / R)) / 2
    assert area(mesh_of("disc", "strip", elements=1500), "footprint") == pytest.approx(exact, rel=1e-3)


@by_pair
def test_the_overhung_side_is_below_a_strip_that_is_longer_than_the_sample(sample, indenter):
    mesh, punch, body = mesh_of(sample, indenter, elements=1500), indenter_of(indenter), sample_of(sample)
    overhung = mesh.boundaries["overhung"]
    assert bool(len(overhung)) == (punch.shape == "strip" and punch.length > body.geometry.outline.extent[0])
    if len(overhung):
        x, y, z = corners(mesh, overhung)
        reach = np.hypot(x, z) if body.shape == "disc" else x
        assert_allclose(reach, body.geometry.outline.extent[0] / 2, rtol=1e-9)
        assert z.mean(axis=0).max() <= punch.geometry.half_width + punch.edge_radius / 2
        assert y.max() == pytest.approx(THICKNESS)
        assert 0.1 * THICKNESS * (1 - 1e-9) <= THICKNESS - y.min() < 0.3 * THICKNESS  # about the depth, in whole elements


def test_a_short_strip_on_a_disc_has_a_mesh_line_at_its_end():
    mesh = mesh_of("disc", "short strip", elements=1500)
    x, _, z = corners(mesh, mesh.boundaries["footprint"])
    assert x.max() == pytest.approx(3.0, rel=1e-9) and z.max() == pytest.approx(1.0, rel=1e-9)
    assert area(mesh, "footprint") == pytest.approx(3.0, rel=1e-9)


def test_elements_are_smallest_at_the_edge_and_at_the_top():
    mesh = mesh_of("block", "strip", elements=1500)
    y, z = (np.unique(np.round(mesh.p[axis], 9)) for axis in (1, 2))
    assert np.argmin(np.abs(z - 1.0)) in (np.argmin(np.diff(z)), np.argmin(np.diff(z)) + 1)
    assert np.all(np.diff(np.diff(y)) < 1e-8)  # y is rounded to 1e-9
    assert np.diff(z).max() > 2 * np.diff(z).min()


@pytest.mark.parametrize(("sample", "coarsest"), [("disc", 1.8), ("block", 1.3)])  # with 2 elements under half of the indenter
def test_widths_at_the_singular_edges_follow_the_size_without_jumps(sample, coarsest):
    """Local exponents d ln(width) / d ln(size) on both sides of the indenter's edge, at the top, at the rim: between 1 and 2.5
    at every size, whatever the numbers of elements do (one more of three elements alone would be a jump by a quarter)."""
    sizes, widths = np.geomspace(0.7, coarsest, 25), []
    for size in sizes:
        x, y, z = mesh_of(sample, "strip", size=size).p
        across, along, layers = (np.unique(np.round(line, 9)) for line in (z[x < 1e-9], x[z < 1e-9], y))
        edge = np.argmin(np.abs(across - 1))
        widths.append([*np.diff(across)[edge - 1 : edge + 1], np.diff(along)[-1], np.diff(layers)[-1]])
    exponents = np.diff(np.log(widths), axis=0) / np.diff(np.log(sizes))[:, None]
    assert exponents.min() > 0.9 and exponents.max() < 2.5


def test_the_base_mesh_at_its_own_size_is_the_default_mesh():
    """Each direction's own rounded-up number of elements: 4 along, 3 and 4 across, 4 layers; and the same by its size."""
    sample, indenter = sample_of("disc"), indenter_of("strip")
    base = quarter(sample, indenter, Mesh(), "q2p1")
    x, y, z = base.p[:, np.unique(base.t)]
    assert [np.unique(np.round(line, 9)).size - 1 for line in (x[z < 1e-9], z[x < 1e-9], y)] == [4, 3 + 4 + 3, 4]
    again = quarter(sample, indenter, Mesh(size=mesh_size(sample, indenter, Mesh(), "q2p1")), "q2p1")
    assert_allclose(again.p, base.p, atol=1e-12)


@pytest.mark.parametrize("element", ["q1p0", "q2p1"])
def test_nodes_at_a_sharp_edge_get_no_closer_than_elements_fold(element):
    """At the largest depth of 0.6 mm, a strip's corner folds up with nodes closer than 0.6 / 16 mm; far from it a finer mesh is
    finer."""
    sizes = [0.3, 0.2, 0.15] if element == "q1p0" else [0.4, 0.27, 0.2]
    meshes = [quarter(sample_of("disc"), indenter_of("strip"), Mesh(size=size), element, 0.6) for size in sizes]
    for mesh in meshes:
        across, layers = (np.unique(np.round(line, 9)) for line in (mesh.p[2][mesh.p[0] < 1e-9], mesh.p[1]))
        edge = np.argmin(np.abs(across - 1))
        assert min(*np.diff(across)[edge - 1 : edge + 1], np.diff(layers)[-1]) > 0.6 / 16
    assert meshes[2].nelements > 3 * meshes[0].nelements


@pytest.mark.parametrize("size", [0.5, 1.0, 2.0])
def test_mesh_lines_lie_within_a_small_edge_radius(size):
    mesh = mesh_of("disc", "rounded strip", size=size)
    z = np.unique(np.round(mesh.p[2][mesh.p[0] == 0], 9))
    assert np.sum((z > 0.9) & (z <= 1.0)) >= 2


# ---- how many -------------------------------------------------------------------------------------------------------


@by_pair
@pytest.mark.parametrize("elements", [400, 1500, 6000])
def test_as_many_elements_as_asked(sample, indenter, elements):
    assert mesh_of(sample, indenter, elements=elements).nelements == pytest.approx(elements, rel=0.15)


@pytest.mark.parametrize("sample", SAMPLES)
@pytest.mark.parametrize("indenter", ["strip", "short strip"])
def test_half_the_size_is_many_more_elements(sample, indenter):
    coarse, fine = (mesh_of(sample, indenter, size=size).nelements for size in (1.0, 0.5))
    assert 5 * coarse <= fine <= 12 * coarse


def test_the_default_mesh_is_that_of_no_keys():
    assert mesh_of("disc", "strip").nelements == mesh_of("disc", "strip", elements=1500).nelements


# ---- refusals -------------------------------------------------------------------------------------------------------


def test_a_strip_as_wide_as_its_disc_is_refused():
    with pytest.raises(MeshError, match="too wide to mesh on a disc"):
        quarter(sample_of("disc"), indenter_of("strip", width=13), Mesh(elements=400))


@pytest.mark.parametrize("sample", SAMPLES)
def test_a_cylinder_without_room_is_refused(sample):
    with pytest.raises(MeshError, match="room"):
        quarter(sample_of(sample), indenter_of("cylinder", diameter=14), Mesh(elements=400))


# ---- the pieces -----------------------------------------------------------------------------------------------------


def test_graded_positions_start_fine_and_end_exactly():
    nodes = graded(1.0, 7.0, Grading(size=1.0, edge=0.1, slope=0.8, rim=0.3), at=1.0)
    assert nodes[0] == 1.0 and nodes[-1] == 7.0
    steps = np.diff(nodes)
    assert np.all(np.diff(steps) > -1e-9)
    assert 0.08 < steps[0] < 0.2 and 0.8 < steps[-1] < 1.01


def test_transfinite_keeps_straight_quadrilaterals_bilinear():
    s, t = np.linspace(0, 1, 5) ** 1.5, np.linspace(0, 1, 4) ** 2
    a, b, c, d = np.array([[0, 0], [2, 0.2], [0.1, 1], [2.5, 1.7]], float)

    def line(p, q, shares):
        return p[:, None] + (q - p)[:, None] * shares

    grid = transfinite(line(a, b, s), line(c, d, s), line(a, c, t), line(b, d, t))
    S, T = s[:, None], t[None, :]
    exact = [(1 - S) * ((1 - T) * a[i] + T * c[i]) + S * ((1 - T) * b[i] + T * d[i]) for i in range(2)]
    assert_allclose(grid, exact, atol=1e-12)


def test_merge_and_extrude_make_one_block_of_two_patches():
    left = np.array(np.meshgrid([0.0, 1.0], [0.0, 0.5, 1.0], indexing="ij"))
    right = left[:, ::-1] + np.array([1.0, 0.0])[:, None, None]  # the other way round
    mesh = extrude(merge([left, right]), np.array([0.0, 1.0, 3.0]))
    assert isinstance(mesh, MeshHex)
    assert mesh.nelements == 8 and mesh.p.shape[1] == 27
    assert volume(mesh) == pytest.approx(6.0, rel=1e-12)
    assert np.unique(np.sign(jacobians(mesh))).size == 1
