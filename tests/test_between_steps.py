"""Values between the equilibria of a path, and how far they are in doubt there."""

import numpy as np
import pytest

from indentfit.fem.interpolation import Interpolant

DEPTHS = np.linspace(0, 1, 9)
BETWEEN = np.linspace(0.45, 0.99, 40)


def steep(depth):
    """A force that grows like an exponential, as those of Demiray's law do."""
    return np.exp(12 * depth) - 1


def test_a_first_force_that_is_not_positive_leaves_the_later_ones_their_doubt():
    """It said once that the whole curve was certain: logarithms were taken of all forces or of none."""
    forces = steep(DEPTHS)
    usual = Interpolant(DEPTHS, forces).doubt(BETWEEN)
    forces[1] = -1e-3 * forces[2]
    late = Interpolant(DEPTHS, forces)
    doubt = late.doubt(BETWEEN)
    assert usual.max() > 0.01 and doubt.max() > 0.8 * usual.max()
    error = np.abs(late(BETWEEN) / steep(BETWEEN) - 1)
    assert np.all(doubt >= 0.5 * error) and error.max() > 0.01
    early = np.array([0.15, 0.2, 0.24])
    assert np.all(late.doubt(early) == 1) and np.abs(late(early) / steep(early) - 1).max() > 0.3


def test_a_path_of_few_steps_goes_on_in_shorter_ones_where_a_step_fails(run):
    """Four steps were halved once, and then went on at full length through a fold of the sharp edge: a loose step, and a force that
    was 2.5 % too small."""
    deep = ("material.parameters={mu=1.49,zeta=4.68,phi=0.68}", "indenter.friction=0.5", "indenter.edge_radius=0")
    depths = np.linspace(0.66 / 25, 0.66, 25)
    few, many = run(*deep, angle=0, depths=depths), run(*deep, "solver.max_step=0.0825", angle=0, depths=depths)
    assert few.facts.cutbacks and not few.facts.loose_steps
    assert few.facts.tries == many.facts.tries == 1
    assert few.force[4:] == pytest.approx(many.force[4:], rel=5e-3)
    assert few.force[-1] == pytest.approx(many.force[-1], rel=1e-3)
