"""A block so wide that its shape hardly changes the force is solved as a disc, and says so; a narrow block stays a block."""

import numpy as np
import pytest

from indentfit.case import Indenter, Mesh, Sample, Solver
from indentfit.errors import MeshError
from indentfit.fem.setup import Press
from indentfit.fem.simulate import Model
from indentfit.fem.wide_block import disc_for, setup_for
from indentfit.material import load

GEL, SPHERE = load("neo_hookean"), Indenter(shape="sphere", diameter=4.0, friction=0)


def block(side, width=None, base="bonded"):
    return Sample(shape="block", length=side, width=width or side, thickness=4.0, base=base)


def setup(sample, **mesh):
    return setup_for(sample, SPHERE, Mesh(**mesh), Solver(), GEL, 0.5)


def test_a_wide_block_is_solved_as_the_disc_of_its_area_and_says_what_its_shape_is_worth():
    wide = setup(block(40.0))
    assert wide.symmetry == "axisymmetric"
    assert wide.sample.diameter == pytest.approx(np.sqrt(4 / np.pi) * 40)
    assert "block" in wide.remark and "disc of diameter 45.14 mm" in wide.remark and "%" in wide.remark


@pytest.mark.parametrize("sides", [(8.0, 8.0), (12.0, 40.0)])
def test_a_narrow_block_stays_a_block(sides):
    assert setup(block(*sides)).symmetry == "quarter"
    with pytest.raises(MeshError, match=r"shape changes the force by up to .*%"):
        setup(block(*sides), symmetry="axisymmetric")


def test_a_quarter_can_be_asked_for_and_fibres_keep_the_block():
    assert setup(block(40.0), symmetry="quarter").symmetry == "quarter"
    fibrous = setup_for(block(40.0), SPHERE, Mesh(), Solver(), load("transversely_isotropic"), 0.5)
    assert fibrous.symmetry == "quarter" and not fibrous.remark


def test_the_stated_effect_bounds_the_difference_of_the_disc_to_bricks_of_the_block():
    """Two discretisations of one problem: coarse bricks of the block itself, and of the disc in its place."""
    narrow, punch = block(12.0, base="sliding"), Indenter(shape="cylinder", diameter=4.0, friction=0)
    stated = disc_for(narrow, punch, 0.02)
    forces = [
        Model(setup_for(sample, punch, Mesh(symmetry="quarter", elements=100), Solver(), GEL, 0.02))
        .run(Press(GEL(mu=1.0), 1000.0, 0, np.array([0.01, 0.02])))
        .force[-1]
        for sample in (narrow, stated.sample(narrow))
    ]
    assert 0.01 < stated.effect < 0.2
    assert abs(forces[1] / forces[0] - 1) < stated.effect
