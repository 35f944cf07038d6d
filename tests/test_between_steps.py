"""Values between the equilibria of a path, and how far they are in doubt there."""

import numpy as np

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
