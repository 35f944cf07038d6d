"""Cones, wedges and deep spheres: distances against sampled outlines, keys and words, contact sizes by published formulas."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from indentfit.case import Indenter
from indentfit.errors import CaseError

BOTTOM = 1.0
SHAPES = {
    "sphere": {"shape": "sphere", "diameter": 1.6},
    "cone": {"shape": "cone", "half_angle": 60, "tip_radius": 0.4},
    "cone on a shaft": {"shape": "cone", "half_angle": 50, "tip_radius": 0.3, "diameter": 1.4},
    "sharp cone": {"shape": "cone", "half_angle": 70},
    "wedge": {"shape": "wedge", "half_angle": 60, "tip_radius": 0.4, "length": 20},
    "wedge on a bar": {"shape": "wedge", "half_angle": 50, "tip_radius": 0.3, "length": 20, "width": 1.4},
}
by_shape = pytest.mark.parametrize("name", SHAPES)


def shape_of(name):
    return Indenter(friction=0, **SHAPES[name]).geometry


def outline(keys, n=400_001):
    """Points (n, 2) of half of an outline, (distance from the axis, height), from its definition and not from the code."""
    if keys["shape"] == "sphere":
        R = keys["diameter"] / 2
        turn = np.linspace(0, np.pi / 2, n)
        ball = np.column_stack([R * np.sin(turn), R * (1 - np.cos(turn))])
        return np.concatenate([ball, np.column_stack([np.full(n, R), np.linspace(R, R + 6, n)])])
    t, angle = keys.get("tip_radius", 0.0), np.radians(keys["half_angle"])
    turn = np.linspace(0, np.pi / 2 - angle, n)  # of the normal away from straight down, until it is normal to the flank
    tip = np.column_stack([t * np.sin(turn), t * (1 - np.cos(turn))])
    end = keys.get("diameter", keys.get("width", 12.0)) / 2
    across = np.linspace(tip[-1, 0], end, n)
    flank = np.column_stack([across, tip[-1, 1] + (across - tip[-1, 0]) / np.tan(angle)])
    return np.concatenate([tip, flank, np.column_stack([np.full(n, end), flank[-1, 1] + np.linspace(0, 6, n)])])


def points_around(name, n=60):
    """Points (n, 3) around an indenter and slightly inside of it, none at the sharp tip, which has no normal."""
    x = np.random.default_rng(3).uniform([-1.2, BOTTOM - 0.3, -1.2], [1.2, BOTTOM + 1.5, 1.2], (30 * n, 3))
    across = np.abs(x[:, 2]) if name.startswith("wedge") else np.hypot(x[:, 0], x[:, 2])
    gap = shape_of(name).distance(x, BOTTOM).gap
    return x[(gap > -0.15) & (gap < 0.5) & (across > 0.2) & (x[:, 1] > BOTTOM + (0.2 if name == "sharp cone" else -1))][:n]


@by_shape
def test_the_distance_is_that_of_the_nearest_of_many_points_of_the_outline(name):
    x, line = points_around(name), outline(SHAPES[name])
    assert len(x) == 60
    across = np.abs(x[:, 2]) if name.startswith("wedge") else np.hypot(x[:, 0], x[:, 2])
    for place, gap in zip(np.column_stack([across, x[:, 1] - BOTTOM]), shape_of(name).distance(x, BOTTOM).gap, strict=True):
        inside = place[0] < np.interp(place[1], line[:, 1], line[:, 0], left=-1.0)
        nearest = np.hypot(*(line - place).T).min()
        assert gap == pytest.approx(-nearest if inside else nearest, abs=3e-5)


@by_shape
def test_the_distance_has_a_unit_gradient_and_the_right_derivatives(name):
    shape, x, h = shape_of(name), points_around(name), 1e-6
    _, n, H = shape.distance(x, BOTTOM)
    assert_allclose(np.linalg.norm(n, axis=1), 1, rtol=1e-12)
    ahead, behind = ([shape.distance(x + s * h * e, BOTTOM) for e in np.eye(3)] for s in (1, -1))
    slopes = np.stack([(a.gap - b.gap) / (2 * h) for a, b in zip(ahead, behind, strict=True)], axis=-1)
    turns = np.stack([(a.normal - b.normal) / (2 * h) for a, b in zip(ahead, behind, strict=True)], axis=-1)
    assert_allclose(slopes, n, atol=1e-7)
    assert_allclose(turns, H, atol=1e-5)


@by_shape
def test_a_point_on_the_axis_sees_the_tip_straight_above(name):
    gap, n, _ = shape_of(name).distance(np.array([[0.0, BOTTOM - 0.2, 0.0], [0.3, BOTTOM - 0.2, 0.0]])[:1], BOTTOM)
    assert_allclose(n, [[0.0, -1.0, 0.0]], atol=1e-12)
    assert gap[0] == pytest.approx(0.2 * np.sin(np.radians(70)) if name == "sharp cone" else 0.2, rel=1e-12)


def test_a_cone_blends_into_its_tip_and_into_its_shaft_without_a_step():
    """Half-angle 60 and tip radius 0.4: the ball is the face up to a radius of 0.4 cos 60 = 0.2 mm, at 0.4 (1 - sin 60) mm."""
    shape = Indenter(shape="cone", half_angle=60, tip_radius=0.4, friction=0).geometry
    place = np.array([0.2, BOTTOM + 0.4 * (1 - np.sin(np.pi / 3)), 0.0])
    out = np.array([np.cos(np.pi / 3), -np.sin(np.pi / 3), 0.0])
    gap, n, _ = shape.distance(place + np.array([[-1e-9], [0.0], [1e-9]]) * [1, 0, 0] + 0.1 * out, BOTTOM)
    assert_allclose(gap, 0.1, atol=1e-8)
    assert_allclose(n, [out] * 3, atol=1e-7)


@pytest.mark.parametrize(("half_angle", "depth"), [(60, 0.3), (80, 0.01)])
def test_the_contact_of_a_sharp_cone_is_sneddons(half_angle, depth):
    """Sneddon 1965: depth = pi / 2 a cot(half_angle)."""
    contact = Indenter(shape="cone", half_angle=half_angle, friction=0).geometry.partition(depth)
    assert contact.radius == pytest.approx(2 / np.pi * depth * np.tan(np.radians(half_angle)), rel=1e-9)


def test_the_contact_of_a_blunt_cone_begins_as_hertz_and_ends_as_sneddon():
    shape = Indenter(shape="cone", half_angle=70, tip_radius=1.0, friction=0).geometry
    assert shape.partition(0.01).radius == pytest.approx(0.1, rel=1e-9)  # below the blend, at 0.34 mm
    assert shape.partition(500.0).radius == pytest.approx(2 / np.pi * 500 * np.tan(np.radians(70)), rel=2e-3)
    blend = np.cos(np.radians(70))
    around = [shape.partition(blend**2 * (1 + e)).radius for e in (-1e-6, 1e-6)]
    assert_allclose(around, blend, rtol=1e-5)


WRONG = {
    r"indenter\.half_angle: missing; a cone needs it: angle between the axis": {"shape": "cone"},
    r"indenter\.half_angle = 90.*must be below 90": {"shape": "cone", "half_angle": 90},
    r"indenter\.edge_radius = 0\.1: does not belong to a cone": {"shape": "cone", "half_angle": 60, "edge_radius": 0.1},
    r"indenter\.tip_radius = 0\.1: does not belong to a sphere": {"shape": "sphere", "diameter": 2, "tip_radius": 0.1},
    r"indenter\.length: missing; a wedge needs it": {"shape": "wedge", "half_angle": 60},
    r"indenter\.tip_radius = 2.*the tip alone is 2 mm wide": {"shape": "cone", "half_angle": 60, "tip_radius": 2, "diameter": 1.5},
}


@pytest.mark.parametrize(("text", "keys"), WRONG.items())
def test_keys_that_do_not_agree_are_refused(text, keys):
    with pytest.raises(CaseError, match=text):
        Indenter(friction=0, **keys)


TOO_WIDE = [
    (
        "sphere, wide",
        {"shape": "sphere", "diameter": 60},
        0.5,
        "the imprint at 0.5 mm is 10.9087 mm wide, too wide for",
    ),
    ("cone, wide", {"shape": "cone", "half_angle": 85}, 0.5, "the imprint at 0.5 mm is 11.4301 mm wide"),
    ("cone, short", {"shape": "cone", "half_angle": 45, "diameter": 0.6}, 0.5, "the flank ends 0.3 mm above the tip"),
    ("wedge, short", {"shape": "wedge", "half_angle": 45, "length": 4}, 0.5, "make it longer than the sample, 12 mm along x"),
]


@pytest.mark.parametrize(("keys", "depth", "text"), [row[1:] for row in TOO_WIDE], ids=[row[0] for row in TOO_WIDE])
def test_an_indenter_that_does_not_fit_on_the_sample_says_why(keys, depth, text):
    faults = list(Indenter(friction=0, **keys).geometry.faults_on((12.0, 12.0), depth))
    assert len(faults) == 1 and text in faults[0][1]


def test_a_sphere_may_sink_in_beyond_its_radius():
    assert not list(Indenter(shape="sphere", diameter=1, friction=0).geometry.faults_on((12.0, 12.0), 1.7))


def test_words_name_angle_tip_and_shaft():
    assert shape_of("cone on a shaft").words() == "cone, half-angle 50 degrees, tip radius 0.3 mm, diameter 1.4 mm"
    assert shape_of("sharp cone").words() == "cone, half-angle 70 degrees, sharp tip"
    assert shape_of("wedge on a bar").words() == "wedge, 20 mm long (x), half-angle 50 degrees, tip radius 0.3 mm, width 1.4 mm (z)"
