"""Contact: forces worked out by hand, distances and derivatives against differences, what an anchor remembers."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from indentfit.case import Indenter, Mesh, Sample
from indentfit.fem.contact import STICK, ContactFace
from indentfit.fem.contact_points import NodePoints
from indentfit.fem.contact_state import History, Springs, Stride
from indentfit.fem.element import Solid
from indentfit.fem.equations import Linearisation
from indentfit.fem.mesh import quarter
from indentfit.indenters.distances import from_ball_on_shaft, from_upright_punch

UP = np.array([0.0, 1.0, 0.0])
SPRINGS = Springs(normal=1000.0, tangential=300.0)  # kPa/mm
DEPTH = 0.02  # mm
AREA = 1.0 * 2.0  # mm^2, of the quarter footprint of a strip 2 mm wide on a block 4 mm long

STRIP, CYLINDER, SPHERE = (
    {"shape": "strip", "width": 2, "length": 4},
    {"shape": "cylinder", "diameter": 2.4},
    {"shape": "sphere", "diameter": 5},
)
INDENTERS = {
    "sharp strip": STRIP,
    "overhanging strip": STRIP | {"length": 10},
    "overhanging rounded strip": STRIP | {"length": 10, "edge_radius": 0.2},
    "rounded strip": STRIP | {"edge_radius": 0.2},
    "short rounded strip": STRIP | {"length": 2.4, "edge_radius": 0.2},
    "sharp cylinder": CYLINDER,
    "rounded cylinder": CYLINDER | {"edge_radius": 0.2},
    "sphere": SPHERE,
}
ROUNDED = [name for name in INDENTERS if name.startswith(("rounded", "short"))]
by_indenter = pytest.mark.parametrize("name", INDENTERS)


def contact_of(indenter, friction, element="q1p0", elements=200):
    """ContactFace (and its solid) of a block of 4 x 1 x 4 mm."""
    sample = Sample(shape="block", length=4, width=4, thickness=1, base="sliding")
    punch = Indenter(friction=friction, **indenter)
    solid = Solid(quarter(sample, punch, Mesh(elements=elements)), element)
    return ContactFace(NodePoints(solid, sample.thickness), punch, sample.thickness), solid


def shifted(solid, by):
    """Displacements that move the whole body by a vector, mm."""
    return np.tile(np.asarray(by, float), solid.n_dofs // 3)


def total(forces):
    return forces.reshape(-1, 3).sum(axis=0)


# ---- by hand --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("element", ["q1p0", "q2p1"])
def test_a_flat_punch_presses_with_spring_times_penetration(element):
    contact, solid = contact_of(STRIP, 0.5, element, elements=60)
    touch = contact.touch(shifted(solid, [0, 0, 0]), DEPTH, contact.rest(), SPRINGS)
    assert touch.touching.all()
    assert_allclose(touch.gap, -DEPTH, rtol=1e-12)
    assert_allclose(touch.pressure, 20.0, rtol=1e-12)  # 1000 kPa/mm * 0.02 mm
    assert_allclose(touch.friction, 0, atol=1e-12)
    assert contact.weights.sum() == pytest.approx(AREA, rel=1e-12)
    assert contact.force(touch) == pytest.approx(40.0, rel=1e-12)  # mN, on 2 mm^2
    assert_allclose(total(contact.residual(touch)), [0, 40.0, 0], atol=1e-11)  # minus the force on the body


@by_indenter
@pytest.mark.parametrize("element", ["q1p0", "q2p1"])
def test_contact_acts_on_the_nodes_that_may_touch_and_on_no_other(name, element):
    """The direct solver's factor ends in a dense matrix of these dofs: the nodes below them would make it several times larger."""
    contact, solid = contact_of(INDENTERS[name], 0.5, element)
    facets = np.concatenate([solid.mesh.boundaries[part] for part in ("footprint", "beside", "overhung")])
    assert_allclose(contact.surface, np.sort(solid.basis.get_dofs(facets).flatten()))


R, B = 7.0, 1.0  # mm, of a disc and half the width of a strip across all of it
FOOTPRINTS = {  # of a quarter: area, and its first moment from the plane z = 0
    "strip": ((B * np.sqrt(R**2 - B**2) + R**2 * np.arcsin(B / R)) / 2, (R**3 - (R**2 - B**2) ** 1.5) / 3),
    "cylinder": (np.pi / 4, 1 / 3),
}


@pytest.mark.parametrize(("shape", "expected"), FOOTPRINTS.items())
@pytest.mark.parametrize(("element", "exact"), [("q1p0", 0.03), ("q2p1", 1e-4)])
def test_areas_and_moments_of_the_nodes_are_those_of_a_footprint_on_a_disc(shape, expected, element, exact):
    """Circles are polygons to eight-node bricks, and parabolas to quadratic ones."""
    sample = Sample(shape="disc", diameter=2 * R, thickness=3.3, base="sliding")
    size = {"diameter": 2.0} if shape == "cylinder" else {"width": 2 * B, "length": 20}
    punch = Indenter(shape=shape, friction=0.5, **size)
    solid = Solid(quarter(sample, punch, Mesh(), element), element)
    contact = ContactFace(NodePoints(solid, 3.3), punch, 3.3)
    weights, X = contact.weights[contact.under], contact.X[contact.under]
    assert (weights.sum(), np.sum(weights * X[..., 2])) == pytest.approx(expected, rel=exact)


def test_pressure_takes_over_the_multiplier():
    contact, solid = contact_of(STRIP, 0.0)
    history = History(np.full(contact.weights.shape, 7.0), np.zeros_like(contact.X), contact.X, contact.X)
    touch = contact.touch(shifted(solid, [0, 0, 0]), DEPTH, history, SPRINGS)
    assert_allclose(touch.pressure, 27.0, rtol=1e-12)


def test_a_separated_point_carries_nothing():
    contact, solid = contact_of(STRIP, 0.5)
    touch = contact.touch(shifted(solid, [0.01, -0.001, 0.02]), 0.0, contact.rest(), SPRINGS)
    assert not touch.touching.any() and not touch.slipping.any()
    assert not touch.traction.any() and not touch.stiffness.any()
    assert contact.force(touch) == 0
    assert not contact.residual(touch).any()


def test_springs_of_half_the_stiffness_press_and_hold_half_as_much():
    contact, solid = contact_of(STRIP, 0.5)
    touch = contact.touch(shifted(solid, [0, 0, 0.03]), DEPTH, contact.rest(), SPRINGS.scaled(0.5))
    assert_allclose(touch.pressure, 10.0, rtol=1e-12)
    assert_allclose(touch.friction, np.broadcast_to([0, 0, 4.5], touch.friction.shape), atol=1e-11)  # of 5 kPa


def test_a_lifted_edge_opens_alone():
    """A top that slopes by 0.01 from the middle of the footprint on: only the half that is still met carries."""
    contact, solid = contact_of(STRIP, 0.0)
    u = np.zeros(solid.n_dofs)
    u[1::3] = -0.04 * solid.basis.doflocs[2, ::3]  # falls along z, from 0 to -0.04 at the edge z = 1
    touch = contact.touch(u, DEPTH, contact.rest(), SPRINGS)
    z = contact.X[..., 2]
    assert np.array_equal(touch.touching, z <= 0.5 + 1e-12)
    assert_allclose(touch.pressure, np.maximum(1000 * (0.02 - 0.04 * z), 0), atol=1e-10)


@pytest.mark.parametrize("friction", [0.5, "stick"])
def test_the_side_that_an_overhanging_strip_covers_rolls_up_against_it(friction):
    """Risen by 0.1 mm under an indenter 0.02 mm lower, what was less than 0.12 mm below the top would be inside of it."""
    contact, solid = contact_of(STRIP | {"length": 10}, friction, "q2p1")
    flush = contact.touch(shifted(solid, [0, 0, 0]), 0.0, contact.rest(), SPRINGS)
    assert contact.under.sum() < contact.under.size
    assert not contact.residual(flush).any()
    below = 1.0 - contact.X[..., 1]
    assert np.array_equal(contact.weights == 0, ~contact.under[:, None] & (below < 1e-9))  # the top's nodes carry once
    touch = contact.touch(shifted(solid, [0, 0.1, 0]), DEPTH, contact.rest(), SPRINGS)
    assert_allclose(touch.pressure, np.maximum(1000 * (0.12 - below), 0), atol=1e-9)
    assert 0 < np.sum((below > 1e-9) & touch.touching) < np.sum(below > 1e-9)
    assert contact.force(touch) == pytest.approx(np.sum(contact.weights * touch.pressure), rel=1e-12)
    x, _, z = contact.X[~contact.under].reshape(-1, 3).T
    assert_allclose(x, 2.0)
    assert z.max() == pytest.approx(1.0)


def test_a_point_that_sticks_to_a_rounded_edge_is_held_against_rolling_off():
    """A pressure p on a face of radius r turns away under a point that rolls: without more than p / r it would not be held."""
    contact, solid = contact_of(STRIP | {"edge_radius": 0.2}, 1.0)
    pressure = np.full(contact.weights.shape, 500.0)  # p / r = 2500 kPa/mm, the springs have 300
    touch = contact.touch(
        shifted(solid, [0, 0, 0]), DEPTH, History(pressure, np.zeros_like(contact.X), contact.X, contact.X), SPRINGS
    )
    round_ = touch.touching & (touch.gap > -DEPTH + 1e-9) & ~touch.slipping
    assert round_.any()
    n = touch.normal[round_]
    along = np.stack([np.zeros(len(n)), -n[:, 2], n[:, 1]], axis=-1)
    held = np.einsum("pi,pij,pj->p", along, touch.stiffness[round_], along)
    assert held.min() > 500 / 0.2


def test_a_light_touch_slides_with_f_times_p_too():
    """0.4 kPa of pressure and 0.6 kPa to stick: 0.2 kPa of friction, which turns with the pull, by 300 kPa/mm * 0.2 / 0.6."""
    contact, solid = contact_of(STRIP, 0.5)
    touch = contact.touch(shifted(solid, [0, 0, 0.002]), DEPTH / 50, contact.rest(), SPRINGS)
    assert_allclose(touch.friction, np.broadcast_to([0, 0, 0.2], touch.friction.shape), atol=1e-12)
    assert_allclose(touch.stiffness[..., 0, 0], 100.0, rtol=1e-12)
    aside = np.broadcast_to([1.0, 0, 0], contact.X.shape)
    change = contact.change(touch, SPRINGS, Springs(0.0, 0.0), 0.0, contact.no_change(), aside)
    assert_allclose(change.friction, np.broadcast_to([100.0, 0, 0], aside.shape), atol=1e-9)


@pytest.mark.parametrize("friction", [0.2, 0.5])
@pytest.mark.parametrize("direction", [[1.0, 0, 0], [0, 0, -1.0], [0.6, 0, 0.8]])
def test_sliding_friction_is_f_times_p_and_opposes_the_motion(friction, direction):
    contact, solid = contact_of(STRIP, friction)
    direction = np.array(direction)
    u = shifted(solid, 0.1 * direction)  # sticking would need 30 kPa, f p is 4 or 10
    touch = contact.touch(u, DEPTH, contact.rest(), SPRINGS)
    assert touch.slipping.all()
    assert_allclose(np.linalg.norm(touch.friction, axis=-1), friction * 20.0, rtol=1e-12)
    on_body = -total(contact.residual(touch))
    assert_allclose(on_body, -friction * 40.0 * direction - 40.0 * UP, atol=1e-10)
    assert on_body @ direction < 0


def test_below_the_limit_friction_is_elastic():
    contact, solid = contact_of(STRIP, 0.5)
    touch = contact.touch(shifted(solid, [0, 0, 0.03]), DEPTH, contact.rest(), SPRINGS)
    assert not touch.slipping.any()
    assert_allclose(touch.friction, 9.0 * np.broadcast_to([0, 0, 1.0], touch.friction.shape), atol=1e-11)  # of 10 kPa


def test_friction_takes_over_its_multiplier_and_counts_from_the_anchor():
    contact, solid = contact_of(STRIP, 0.5)
    pull = np.broadcast_to([2.0, 0, 0], contact.X.shape)
    anchor = contact.X + np.array([0, 0, 0.01])
    touch = contact.touch(shifted(solid, [0, 0, 0.02]), DEPTH, History(contact.rest().pressure, pull, anchor, contact.X), SPRINGS)
    assert_allclose(touch.friction, np.broadcast_to([2.0, 0, 3.0], pull.shape), atol=1e-11)


def test_without_friction_nothing_holds():
    contact, solid = contact_of(STRIP, 0.0)
    touch = contact.touch(shifted(solid, [0.5, 0, 0.5]), DEPTH, contact.rest(), SPRINGS)
    assert not touch.friction.any() and not touch.slipping.any()


def test_stick_under_a_sharp_edge_ties_and_may_pull():
    contact, solid = contact_of(STRIP, "stick")
    touch = contact.touch(shifted(solid, [0.4, -0.01, 0]), 0.0, contact.rest(), SPRINGS)
    assert contact.tied.all() and touch.touching.all() and not touch.slipping.any()
    assert_allclose(touch.pressure, -10.0, rtol=1e-10)
    assert_allclose(touch.friction[..., 0], 120.0, rtol=1e-12)


def test_stick_under_a_sphere_is_a_large_coefficient():
    contact, _ = contact_of(SPHERE, "stick")
    assert not contact.tied.any() and contact.friction == STICK


def test_a_sphere_presses_by_the_depth_under_its_cap():
    contact, solid = contact_of(SPHERE, 0.0)
    touch = contact.touch(shifted(solid, [0, 0, 0]), 0.1, contact.rest(), SPRINGS)
    rho = np.hypot(contact.X[..., 0], contact.X[..., 2])
    gap = np.hypot(rho, 2.5 - 0.1) - 2.5  # the top stays flat, the centre is 2.4 mm above it
    assert_allclose(touch.pressure, np.maximum(-1000 * gap, 0), atol=1e-9)
    assert not touch.touching.all() and touch.touching.any()
    expected = np.sum(contact.weights * touch.pressure * 2.4 / np.hypot(rho, 2.4))
    assert contact.force(touch) == pytest.approx(expected, rel=1e-12)


# ---- what a step leaves behind --------------------------------------------------------------------------------------


def test_a_sticking_point_keeps_its_anchor():
    contact, solid = contact_of(STRIP, 0.5)
    touch = contact.touch(shifted(solid, [0, 0, 0.03]), DEPTH, contact.rest(), SPRINGS)
    after = touch.advanced()
    assert_allclose(after.anchor, contact.X)
    assert_allclose(after.pressure, touch.pressure)
    assert_allclose(after.friction, touch.friction)


def test_a_slipping_point_is_anchored_where_it_is():
    contact, solid = contact_of(STRIP, 0.5)
    u = shifted(solid, [0, 0, 0.1])
    after = contact.touch(u, DEPTH, contact.rest(), SPRINGS).advanced()
    assert_allclose(after.anchor - contact.X, np.broadcast_to([0, DEPTH, 0.1], contact.X.shape), atol=1e-14)
    unmoved = contact.touch(u, DEPTH, after, SPRINGS)  # without more motion it holds the friction that it slid with
    assert_allclose(unmoved.friction[..., 2], 10.0, rtol=1e-12)
    back = contact.touch(shifted(solid, [0, 0, 0.09]), DEPTH, after, SPRINGS)  # moved back, it sticks with less
    assert not back.slipping.any()
    assert_allclose(back.friction[..., 2], 10.0 - 3.0, rtol=1e-12)


def test_a_point_that_does_not_touch_forgets():
    contact, solid = contact_of(STRIP, 0.5)
    away = shifted(solid, [0.3, -0.1, 0.2])
    pull = History(np.ones(contact.weights.shape), np.ones_like(contact.X), contact.X, contact.X)
    after = contact.touch(away, 0.0, pull, SPRINGS).advanced()
    assert not after.pressure.any() and not after.friction.any()
    assert_allclose(after.anchor - contact.X, np.broadcast_to([0.3, -0.1, 0.2], contact.X.shape), atol=1e-14)


def test_a_point_that_comes_to_touch_is_anchored_where_it_touches():
    """The gap is 0.01 mm, and closes by 0.02 mm in a step while the point moves by 0.04 mm along the face: half of that is free."""
    contact, solid = contact_of(STRIP, 0.5)
    history = replace(contact.rest(), start=contact.X + np.array([0, -0.03, -0.02]))
    before = contact.touch(shifted(solid, [0, -0.01, 0.02]), 0.0, history, SPRINGS)
    after = before.advanced(stride=Stride(0.01, 0.01))
    assert_allclose(after.anchor - contact.X, np.broadcast_to([0, 0, 0.04], contact.X.shape), atol=1e-14)
    assert_allclose(after.start, before.place)
    further = before.advanced(stride=Stride(0.02, 0.01))  # a step of twice the length touches at the same place
    assert_allclose(further.anchor, after.anchor, atol=1e-14)


def test_multipliers_follow_the_rate_of_the_tractions():
    """Pressed by 5 kPa and pulled by 3 kPa along z per 0.01 mm of depth, sticking; then the same half as far."""
    contact, solid = contact_of(STRIP, 0.5)
    touch = contact.touch(shifted(solid, [0, 0, 0.03]), DEPTH, contact.rest(), SPRINGS)
    rate = np.broadcast_to([0, 500.0, 300.0], contact.X.shape)  # of T - p n, n downwards
    after = touch.advanced(rate, Stride(0.005))
    assert_allclose(after.pressure, 20.0 + 2.5, rtol=1e-12)
    assert_allclose(after.friction, np.broadcast_to([0, 0, 9.0 + 1.5], contact.X.shape), atol=1e-11)
    assert not touch.advanced(-10 * rate, Stride(0.005)).pressure.any()  # it cannot come to pull


# ---- what the springs withhold ----------------------------------------------------------------------------------------

RATE = np.array([0, 500.0, 300.0])  # kPa per mm of depth, of T - p n with n downwards


def withheld(contact, solid, by, history=None, depth=DEPTH):
    touch = contact.touch(shifted(solid, by), depth, history or contact.rest(), SPRINGS)
    return touch, contact.penalty_error(touch, np.broadcast_to(RATE, contact.X.shape), SPRINGS)


def test_springs_withhold_their_give_times_the_rate_of_the_traction():
    """Pressed in by 0.02 mm and held back by 0.03 mm: 2 mm^2 * (0.02 mm * 500 + 0.03 mm * 300 kPa/mm)."""
    _, error = withheld(*contact_of(STRIP, 0.5), [0, 0, 0.03])
    assert error == pytest.approx(AREA * (10 + 9), rel=1e-12)


def test_a_multiplier_gives_nothing():
    """It carries 7 of 27 kPa, and 2 of the friction: what gives is the springs' share alone."""
    contact, solid = contact_of(STRIP, 0.5)
    history = History(np.full(contact.weights.shape, 7.0), np.broadcast_to([2.0, 0, 0], contact.X.shape), contact.X, contact.X)
    touch, error = withheld(contact, solid, [0, 0, 0.03], history)
    assert not touch.slipping.any()
    assert error == pytest.approx(AREA * (10 + 9), rel=1e-12)


def test_a_slipping_point_withholds_no_friction_and_an_open_one_nothing():
    contact, solid = contact_of(STRIP, 0.5)
    touch, error = withheld(contact, solid, [0, 0, 0.1])
    assert touch.slipping.all() and error == pytest.approx(AREA * 10, rel=1e-12)
    history = History(np.full(contact.weights.shape, 5.0), np.ones_like(contact.X), contact.X, contact.X)
    assert withheld(contact, solid, [0, -0.1, 0], history)[1] == 0


# ---- distances ------------------------------------------------------------------------------------------------------


def samples(indenter, n=400):
    """Points around and slightly inside an indenter whose lowest point is at y = 1."""
    rng = np.random.default_rng(0)
    x = rng.uniform([-2, 0.4, -2], [2, 1.3, 2], (n, 3))
    return x[np.abs(indenter.geometry.distance(x, 1.0)[0]) < 0.6]


@pytest.mark.parametrize("name", [*ROUNDED, "sphere"])
def test_distance_has_a_unit_gradient_and_the_right_derivatives(name):
    indenter, h = Indenter(friction=0, **INDENTERS[name]), 1e-6
    x = samples(indenter)
    r = indenter.edge_radius  # points above the rounding's centre, inside the flat face, have no unique nearest face
    x = x[x[:, 1] < 1.0 + r] if r else x
    _, n, H = indenter.geometry.distance(x, 1.0)
    assert_allclose(np.linalg.norm(n, axis=1), 1, rtol=1e-12)
    ahead, behind = ([indenter.geometry.distance(x + s * h * e, 1.0) for e in np.eye(3)] for s in (1, -1))
    slopes = np.stack([(a[0] - b[0]) / (2 * h) for a, b in zip(ahead, behind, strict=True)], axis=-1)
    turns = np.stack([(a[1] - b[1]) / (2 * h) for a, b in zip(ahead, behind, strict=True)], axis=-1)
    assert_allclose(slopes, n, atol=1e-8)
    assert_allclose(turns, H, atol=1e-6 * max(1.0, np.max(np.abs(H))))
    assert np.max(np.abs(H)) > 0.1


@pytest.mark.parametrize("name", ROUNDED)
def test_distance_of_a_rounded_punch_by_hand(name):
    """Radius 0.2: the flat face, the middle of the rounding at 45 deg, and the side above it."""
    indenter = Indenter(friction=0, **INDENTERS[name])
    edge = 1.0 if indenter.shape == "strip" else 1.2
    away = 0.5 * np.sqrt(0.5)
    points = [[0, 0.7, 0], [0, 1.2 - away, edge - 0.2 + away], [0, 1.5, edge + 0.3], [0, 0.7, edge - 0.3]]
    gap, n, _ = indenter.geometry.distance(np.array(points), 1.0)
    assert_allclose(gap, [0.3, 0.3, 0.3, 0.3], rtol=1e-12)
    assert_allclose(n, [-UP, [0, -np.sqrt(0.5), np.sqrt(0.5)], [0, 0, 1], -UP], atol=1e-12)


def test_distance_at_the_corner_of_a_short_rounded_strip_is_a_spheres():
    indenter = Indenter(friction=0, **INDENTERS["short rounded strip"])
    gap, n, H = indenter.geometry.distance(np.array([[1.0 + 0.4, 1.2 - 0.2, 0.8 + 0.4]]), 1.0)
    assert gap[0] == pytest.approx(0.6 - 0.2)
    assert_allclose(n[0], np.array([2, -1, 2]) / 3, rtol=1e-12)
    assert_allclose(H[0], (np.eye(3) - np.outer(n[0], n[0])) / 0.6, atol=1e-12)


def test_distance_from_an_upright_punch_by_hand_and_its_derivatives():
    """Radius 0.5, face at 1: below the face, beside the wall, and inside near the wall and near the face."""
    points = np.array([[0.0, 0.8, 0.3], [0.6, 1.5, 0.8], [0.48, 1.1, 0.0], [0.0, 1.01, 0.2]])
    gap, n, H = from_upright_punch(0.5, points, 1.0)
    assert_allclose(gap, [0.2, 0.5, -0.02, -0.01], rtol=1e-12)
    assert_allclose(n, [-UP, [0.6, 0, 0.8], [1, 0, 0], -UP], atol=1e-12)
    h = 1e-6
    ahead, behind = ([from_upright_punch(0.5, points + s * h * e, 1.0) for e in np.eye(3)] for s in (1, -1))
    slopes = np.stack([(a.gap - b.gap) / (2 * h) for a, b in zip(ahead, behind, strict=True)], axis=-1)
    turns = np.stack([(a.normal - b.normal) / (2 * h) for a, b in zip(ahead, behind, strict=True)], axis=-1)
    assert_allclose(slopes, n, atol=1e-8)
    assert_allclose(turns, H, atol=1e-6)


def test_distance_from_a_sphere_by_hand():
    indenter = Indenter(friction=0, **SPHERE)
    gap, n, H = indenter.geometry.distance(np.array([[0, 0.6, 0], [3.0, 3.5, 4.0], [0, 1.1, 0]]), 1.0)
    assert_allclose(gap, [0.4, 2.5, -0.1], rtol=1e-12)
    assert_allclose(n, [-UP, [0.6, 0, 0.8], -UP], atol=1e-12)
    assert_allclose(H[0], np.diag([1, 0, 1]) / 2.9, atol=1e-12)


# ---- derivatives ----------------------------------------------------------------------------------------------------


def mixed_state(name, friction):
    """A random state in which points are open, stick and slip: (contact, solid, function of (u, depth), u, depth)."""
    contact, solid = contact_of(INDENTERS[name], friction, elements=400)
    rng = np.random.default_rng(1)
    depth = 0.15 if name == "sphere" else DEPTH
    u = rng.uniform(-1, 1, solid.n_dofs) * np.tile([0.03, 0.06, 0.03], solid.n_dofs // 3)
    shape = contact.weights.shape
    pressure, friction = rng.uniform(0, 20, shape), rng.uniform(-4, 4, (*shape, 3))
    history = History(pressure, friction, *(contact.X + rng.uniform(-0.01, 0.01, (2, *shape, 3))))

    def touch(u, depth=depth):
        return contact.touch(u, depth, history, SPRINGS)

    return contact, solid, touch, u, depth


@pytest.mark.parametrize("friction", [0.0, 0.5, "stick"])
@by_indenter
def test_traction_is_differentiated_exactly(name, friction):
    """D against differences, point by point, with open, sticking and slipping points together."""
    _, solid, touch, u, _ = mixed_state(name, friction)
    here, h = touch(u), 1e-6
    if friction == 0.5:
        assert here.touching.any() and not here.touching.all()
        assert here.slipping.any() and (here.touching & ~here.slipping).any()
    ahead, behind = ([touch(u + s * h * shifted(solid, e)) for e in np.eye(3)] for s in (1, -1))
    for other in (*ahead, *behind):  # no point changes its state within the difference
        assert np.array_equal(other.touching, here.touching) and np.array_equal(other.slipping, here.slipping)
    D = np.stack([(a.traction - b.traction) / (2 * h) for a, b in zip(ahead, behind, strict=True)], axis=-1)
    assert np.max(np.abs(here.stiffness - D)) < 1e-7 * np.max(np.abs(D))


@pytest.mark.parametrize("name", ["rounded strip", "rounded cylinder", "sphere"])
def test_contact_tangent_and_depth_derivatives_are_those_of_its_forces(name):
    contact, solid, touch, u, depth = mixed_state(name, 0.5)
    here, h = touch(u), 1e-7
    v = np.random.default_rng(2).uniform(-1, 1, solid.n_dofs)
    values = np.zeros(solid.indices.size)
    dense = contact.add_tangent(here, values)
    assert_allclose(dense, solid.matrix(values).toarray()[np.ix_(contact.surface, contact.surface)], rtol=1e-12, atol=1e-9)
    change = (contact.residual(touch(u + h * v)) - contact.residual(touch(u - h * v))) / (2 * h)
    assert np.max(np.abs(solid.matrix(values) @ v - change)) < 1e-6 * np.max(np.abs(change))
    deeper, higher = touch(u, depth + h), touch(u, depth - h)
    by_depth = (contact.residual(deeper) - contact.residual(higher)) / (2 * h)
    assert np.max(np.abs(contact.by_depth(here) - by_depth)) < 1e-6 * np.max(np.abs(by_depth))
    deeper, higher = touch(u + h * v, depth + h), touch(u - h * v, depth - h)
    rate = (deeper.traction - higher.traction) / (2 * h)
    assert np.max(np.abs(contact.rate(here, v) - rate)) < 1e-6 * np.max(np.abs(rate))
    stiffness = (contact.force(deeper) - contact.force(higher)) / (2 * h)
    assert contact.total(contact.rate(here, v)) == pytest.approx(stiffness, rel=1e-6)


@pytest.mark.parametrize("friction", [0.0, 0.5, "stick"])
@by_indenter
def test_a_touch_and_its_history_change_as_differences_say(name, friction):
    """By springs, the coefficient of friction, the history, the places and the rate at once, in random directions."""
    contact, _, touch, u, depth = mixed_state(name, friction)
    here, coefficient, h, stride = touch(u), contact.friction, 1e-6, Stride(0.01, 0.02)
    rng = np.random.default_rng(3)
    more, slippery = Springs(50.0, -20.0), 0.1 if friction == 0.5 else 0.0
    aside = History(*(rng.uniform(-size, size, a.shape) for a, size in zip(fields(here.history), (5, 2, 0.01, 0.01), strict=True)))
    moved, rate, turn = 0.02 * rng.uniform(-1, 1, u.size), *rng.uniform(-2000, 2000, (2, *contact.X.shape))

    def at(s):
        contact.friction = coefficient + s * slippery
        history = History(*(a + s * b for a, b in zip(fields(here.history), fields(aside), strict=True)))
        springs = Springs(SPRINGS.normal + s * more.normal, SPRINGS.tangential + s * more.tangential)
        there = contact.touch(u + s * moved, depth, history, springs)
        assert np.array_equal(there.touching, here.touching) and np.array_equal(there.slipping, here.slipping)
        return there, there.advanced(rate + s * turn, stride)

    (ahead, later), (behind, earlier) = at(h), at(-h)
    contact.friction = coefficient
    change = contact.change(here, SPRINGS, more, slippery, aside, contact.field(moved))
    for field in ("place", "normal", "pressure", "friction", "traction"):
        expected = (getattr(ahead, field) - getattr(behind, field)) / (2 * h)
        assert_allclose(getattr(change, field), expected, atol=1e-6 * max(1.0, np.max(np.abs(expected))), err_msg=field)
    after = change.advanced(here, rate, turn, stride)
    assert contact.tied.all() or not np.all(here.advanced(rate, stride).pressure)  # some cannot come to pull
    for derivative, a, b in zip(fields(after), fields(later), fields(earlier), strict=True):
        expected = (a - b) / (2 * h)
        assert_allclose(derivative, expected, atol=1e-6 * max(1.0, np.max(np.abs(expected))))


@pytest.mark.parametrize("friction", [0.0, 0.5, "stick"])
@by_indenter
def test_the_tangent_at_rest_changes_with_the_springs_as_differences_say(name, friction):
    """It is linear in the springs, so that a difference of any size is exact."""
    contact, solid = contact_of(INDENTERS[name], friction)
    springs = [Springs(SPRINGS.normal + s * 70.0, SPRINGS.tangential - s * 30.0) for s in (1, 0, -1)]
    more, rest, less = (contact.touch(np.zeros(solid.n_dofs), 0.0, contact.rest(), stiffness) for stiffness in springs)
    assert rest.touching.any()
    assert_allclose(contact.stiffness_change(rest, Springs(70.0, -30.0)), (more.stiffness - less.stiffness) / 2, atol=1e-9)


def fields(history):
    return history.pressure, history.friction, history.anchor, history.start


@by_indenter
def test_force_is_the_sum_of_the_nodal_forces(name):
    contact, _, touch, u, _ = mixed_state(name, 0.5)
    here = touch(u)
    assert total(contact.residual(here))[1] == pytest.approx(contact.force(here), rel=1e-12)


@by_indenter
def test_friction_lies_in_the_face_and_within_its_limit(name):
    _, _, touch, u, _ = mixed_state(name, 0.5)
    here = touch(u)
    assert np.max(np.abs(np.einsum("fqi,fqi->fq", here.friction, here.normal))) < 1e-12
    assert np.all(np.linalg.norm(here.friction, axis=-1) <= 0.5 * here.pressure * (1 + 1e-12))
    assert np.all(here.pressure >= 0)


@pytest.mark.filterwarnings("error")
def test_a_residual_without_contact_is_an_infinite_share_of_the_contact_force():
    for force, share in ((0.0, np.inf), (4.0, 0.5)):
        here = SimpleNamespace(unbalanced=np.float64(2.0), contact_force=np.float64(force))
        assert Linearisation.share.fget(here) == share


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_the_middle_of_a_ball_has_no_normal_and_no_warning():
    """An iterate may stray there: it is refused, since its forces are no numbers, and a user reads nothing of it."""
    found = from_ball_on_shaft(2.0, np.array([[0.0, 2.0, 0.0], [0.0, 0.0, 0.0]]), 0.0)
    assert np.isnan(found.normal[0]).all() and found.normal[1].tolist() == [0.0, -1.0, 0.0]
    assert found.gap.tolist() == [-2.0, 0.0]
