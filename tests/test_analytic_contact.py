"""The forward model against closed and semi-analytic contact solutions (physics.md 3 and 4)."""

import numpy as np
import pytest
from fixtures.cases import ISOTROPIC
from fixtures.strips import long_strip, stiffness_per_length


def ratio(poisson):
    """kappa/mu of a Poisson's ratio; 1000 stands for incompressible."""
    return 1000 if poisson == 0.5 else 2 * (1 + poisson) / (3 * (1 - 2 * poisson))


HAYES = [
    ("bonded", 0.45, [1.252, 1.599, 2.033, 2.535, 3.091]),
    ("bonded", 0.5, [1.281, 1.684, 2.213, 2.860, 3.619]),
    ("sliding", 0.5, [1.171, 1.385, 1.635, 1.909, 2.199]),
]
CYLINDERS = [
    pytest.param(base, poisson, a, factor, marks=[] if a in (0.2, 1.0) else pytest.mark.campaign)
    for base, poisson, factors in HAYES
    for a, factor in zip((0.2, 0.4, 0.6, 0.8, 1.0), factors, strict=True)
]


@pytest.mark.parametrize(("base", "poisson", "a", "factor"), CYLINDERS)
def test_a_flat_cylinder_on_a_layer_is_as_stiff_as_hayes_found(stiffness, base, poisson, a, factor):
    k = stiffness(
        ISOTROPIC,
        f"material.bulk_ratio={ratio(poisson)}",
        f"sample={{shape='disc',diameter={2 * (a + 6)},thickness=1.0,base='{base}'}}",
        f"indenter={{shape='cylinder',diameter={2 * a},friction=0.0}}",
        "mesh.elements=1000",
        "test=[{name='run',angle=0,depth=0.01}]",
    )
    assert k == pytest.approx(4 * a * factor / (1 - poisson), rel=0.02)


STRIPS = [
    ("sliding", 0.5, {0.1: 2.372, 0.2: 3.188, 0.303: 3.976, 0.5: 5.482, 1.0: 9.423, 2.0: 17.417}),
    ("bonded", 0.5, {0.1: 3.096, 0.2: 4.602, 0.303: 6.308, 0.5: 10.252, 1.0: 24.865, 2.0: 77.90}),
    ("sliding", 0.45, {0.303: 3.614}),
    ("bonded", 0.45, {0.303: 4.935}),
]


@pytest.mark.parametrize(("base", "poisson", "factors"), STRIPS)
def test_a_long_strip_presses_a_layer_in_plane_strain_within_half_a_percent_on_the_default_mesh(
    plane_strain, base, poisson, factors
):
    """F / (G w) at half-widths over the thickness; seen: at most 0.36 %, under the narrowest strip."""
    bulk_ratio = 1e4 if poisson == 0.5 else ratio(poisson)
    for a, factor in factors.items():
        assert stiffness_per_length(long_strip(base, a), bulk_ratio) == pytest.approx(factor, rel=5e-3)


def test_a_sphere_on_a_deep_sample_follows_hertz(run):
    """F = 16/3 mu sqrt(R) d^1.5 / (2 (1 - nu)) * ... = 16/3 mu R^0.5 d^1.5 for nu = 0.5, contact radius 5 % of the sample."""
    R, d = 4.0, np.array([0.005, 0.0075, 0.01])
    result = run(
        ISOTROPIC,
        "sample={shape='disc',diameter=20.0,thickness=10.0,base='sliding'}",
        f"indenter={{shape='sphere',diameter={2 * R},friction=0.0}}",
        "mesh.elements=400",
        f"test=[{{name='run',angle=0,depth={d[-1]}}}]",
        angle=0,
        depths=d,
    )
    assert result.force == pytest.approx(16 / 3 * np.sqrt(R) * d**1.5, rel=0.03)


WHITE_MATTER = [
    ("sliding", "0.0", 79.1, 129.0),
    ("sliding", "stick", 81.1, 177.5),
    ("bonded", "0.0", 113.1, 193.3),
    ("bonded", "stick", 117.7, 264.3),
]


@pytest.mark.parametrize(("base", "friction", "k0", "k90"), WHITE_MATTER)
def test_white_matter_has_its_small_strain_stiffnesses(stiffness, base, friction, k0, k90):
    keys = (f"sample.base={base}", f"indenter.friction={friction}")
    assert stiffness(*keys, angle=0) == pytest.approx(k0, rel=0.03)
    assert stiffness(*keys, angle=90) == pytest.approx(k90, rel=0.03)
