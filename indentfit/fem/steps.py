"""The steps of the depth with which a path is followed, by its indenter and its body."""

import numpy as np

from indentfit.fem.controls import FIRST_DEPTH, FIRST_STEPS, step_of_few
from indentfit.fem.setup import Setup
from indentfit.indenters import has_sharp_edge

FLAT_STEPS = 4  # steps to the last depth of bricks under a flat face with sharp edges
# Steps to the last depth where a contact grows with friction in the meridian plane: with the usual 8 steps forces are up to 0.3 %
# off, and 2 % at the first depths. Below a friction of SLIPPERY points slip all the same.
RUBBING_STEPS, SLIPPERY = 12, 0.05


def largest_step(setup: Setup, n_dofs: int, friction: float, last: float) -> float:
    """The largest step, mm, to a last depth, mm, of a body with so many dofs, at a coefficient of friction."""
    longest = last / RUBBING_STEPS if setup.in_plane and setup.rubs and friction > SLIPPERY else np.inf
    return setup.solver.max_step or min(longest, step_of_few(n_dofs, last))


def first_steps(setup: Setup) -> int:
    """Steps to the last depth when nothing goes wrong."""
    return FLAT_STEPS if not setup.in_plane and has_sharp_edge(setup.indenter.geometry) else FIRST_STEPS


def first_depth(setup: Setup) -> float:
    """Share of the last depth that the first step may reach at most."""
    return FIRST_DEPTH if setup.in_plane and setup.indenter.geometry.end != "flat" else np.inf
