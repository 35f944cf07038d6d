"""Samples with layers: the mechanics, against one material, Hankel's transform, and central differences."""

import numpy as np
import pytest
from fixtures.two_layers import Layers

from indentfit.case.tables import Indenter, Layer, Mesh, Sample, Solver
from indentfit.fem.fields import recover
from indentfit.fem.mesh_error import with_mesh_errors
from indentfit.fem.setup import Press, Setup
from indentfit.fem.simulate import Model
from indentfit.material import layered, load

GEL, OGDEN = load("neo_hookean"), load("ogden")
TWO = layered({"top": GEL, "low": GEL})
RATIO = 1000.0
NU = (3 * RATIO - 2) / (2 * (3 * RATIO + 1))
BALL, STRIP = Indenter(shape="sphere", radius=2.0, friction=0.3), Indenter(shape="strip", width=1.0, length=20.0, friction=0.5)


def sample(upper=1.0, lower=2.0, **keys):
    layers = [
        Layer(name=name, thickness=h, model="neo_hookean", parameters={"mu": 1.0}) for name, h in (("top", upper), ("low", lower))
    ]
    shape = {"shape": "disc", "diameter": 20.0} | keys
    return Sample(**shape, thickness=upper + lower, base="bonded", layer=layers)


def model(piece, indenter, depth=0.2, symmetry="axisymmetric", mesh=None, **solver):
    return Model(Setup(piece, indenter, mesh or Mesh(), Solver(**solver), depth, symmetry))


def press(top, low, depth=0.2, points=4, **keys):
    return Press(
        TWO(**{"top.mu": top, "low.mu": low}), (RATIO * top, RATIO * low), 0, np.linspace(depth / points, depth, points), **keys
    )


@pytest.mark.parametrize(
    ("symmetry", "indenter", "element"),
    [("axisymmetric", BALL, "q2p1"), ("quarter", STRIP, "q2p1"), ("half", STRIP, "q1p0"), ("whole", BALL, "q1p0")],
)
def test_two_layers_of_the_same_material_are_one(symmetry, indenter, element):
    mesh = Mesh(elements=40) if symmetry != "axisymmetric" else Mesh(elements=120)
    made = model(sample(0.5, 2.5), indenter, symmetry=symmetry, mesh=mesh, element=element)
    one = made.run(Press(GEL(mu=1.3), 1300.0, 0, np.array([0.1, 0.2])))
    two = made.run(press(1.3, 1.3, points=2))
    assert two.force == pytest.approx(one.force, rel=1e-6)


def test_a_soft_layer_on_a_stiff_one_tends_to_a_layer_on_a_rigid_base():
    """The difference is that of the stiff layer's own compliance, in proportion to the ratio of the moduli."""
    alone = Sample(shape="disc", diameter=20.0, thickness=1.0, base="bonded")
    rigid = model(alone, BALL, mesh=Mesh(error=0.003)).run(Press(GEL(mu=1.0), RATIO, 0, np.array([0.1, 0.2]))).force[-1]
    off = [
        1 - model(sample(), BALL, mesh=Mesh(error=0.003)).run(press(1.0, k, points=2)).force[-1] / rigid for k in (1e1, 1e2, 1e4)
    ]
    assert off[0] > 5 * off[1] > 0
    assert abs(off[2]) < 2e-3


@pytest.mark.parametrize(
    ("top", "low"), [(1.0, 1.0), (10.0, 1.0), (1.0, 10.0), (100.0, 1.0), (1.0, 100.0)], ids=lambda mu: f"{mu:g}"
)
@pytest.mark.parametrize(("shape", "size", "upper"), [("cylinder", 1.0, 1.0), ("sphere", 2.0, 1.0), ("sphere", 8.0, 0.5)])
def test_small_depths_are_those_of_hankels_transform(shape, size, upper, top, low):
    """Within 1 % on the default mesh, and within the error that the mesh states (with 0.4 % for the finite depth of the ball)."""
    lower, depth = 2.0, 2e-4 if shape == "cylinder" else 0.003 * size
    piece = sample(upper, lower, diameter=80.0)
    setup = Setup(piece, Indenter(shape=shape, radius=size, friction=0.0), Mesh(), Solver(), depth, "axisymmetric")
    asked = press(top, low, depth, points=4, name="press")
    result = with_mesh_errors(Model(setup).simulate([asked]), setup, [asked]).tests[0]
    exact = Layers((upper, lower), (top, low), (NU, NU))
    right = exact.punch(size) * depth if shape == "cylinder" else exact.sphere(size, depth)
    assert result.force[-1] == pytest.approx(right, rel=0.01)
    assert abs(result.force[-1] - right) <= result.mesh_error.band[-1] + (0.004 if shape == "sphere" else 0) * right


def test_hankels_transform_of_one_layer_is_that_of_hayes():
    """Hayes et al. 1972, J Biomech 5:541: F = 4 G a w k / (1 - nu) on a bonded layer, nu = 0.45."""
    for a, k in ((0.2, 1.252), (0.4, 1.599), (1.0, 3.091), (2.0, 6.421)):
        assert Layers((0.3, 0.7), (1.0, 1.0), (0.45, 0.45)).punch(a) * 0.55 / 4 / a == pytest.approx(k, abs=2e-3)


@pytest.mark.parametrize(("symmetry", "indenter"), [("axisymmetric", BALL), ("quarter", STRIP)])
def test_sensitivities_are_those_of_central_differences(symmetry, indenter):
    laws = layered({"top": OGDEN, "low": GEL})
    values, step = {"top.mu": 5.0, "top.alpha": 6.0, "low.mu": 1.0}, 1e-5
    kappas = lambda at: (RATIO * at["top.mu"], 50 * at["low.mu"])  # noqa: E731
    mesh = Mesh(elements=120) if symmetry == "axisymmetric" else Mesh(elements=40)
    made = model(sample(), indenter, symmetry=symmetry, mesh=mesh, tolerance=1e-8)

    def run(at, kappas, **keys):
        return made.run(Press(laws(**at), kappas, 0, np.array([0.1, 0.2]), **keys))

    exact = run(values, kappas(values), sensitivities=(*values, "bulk_ratio")).sensitivities
    for name, value in values.items():
        low, high = ({**values, name: value * (1 + sign * step)} for sign in (-1, 1))
        slope = (run(high, kappas(high)).force - run(low, kappas(low)).force) / (2 * step * value)
        assert exact[name][-1] == pytest.approx(slope[-1], rel=1e-4)
    scale = sum(exact[name][-1] * values[name] for name in ("top.mu", "low.mu"))
    assert scale == pytest.approx(run(values, kappas(values)).force[-1], rel=1e-6)  # the force is linear in both moduli together


def test_bricks_agree_with_the_meridian_plane():
    """A disc under a flat cylinder, a stiff layer on a soft one; the default bricks err by 1 %."""
    punch = Indenter(shape="cylinder", radius=1.5, edge_radius=0.3, friction=0.0)
    piece = sample(1.0, 2.0, diameter=12.0)
    plane = model(piece, punch).run(press(5.0, 1.0, points=2)).force
    bricks = model(piece, punch, symmetry="quarter").run(press(5.0, 1.0, points=2)).force
    assert bricks == pytest.approx(plane, rel=0.015)


def test_fields_know_their_layer():
    made = model(sample(), BALL, mesh=Mesh(elements=120))
    result = made.run(press(100.0, 1.0, points=2))
    fields = recover(made, result, TWO(**{"top.mu": 100.0, "low.mu": 1.0}), (100e3, 1e3))
    heights = fields.nodes[fields.elements, 1].mean(axis=1)
    assert set(fields.layer) == {1, 2}
    assert np.array_equal(fields.layer == 1, heights > 2.0)
    stress = np.abs(fields.cell_stress[:, 0])
    assert stress[fields.layer == 1].max() > 10 * stress[fields.layer == 2].max()
