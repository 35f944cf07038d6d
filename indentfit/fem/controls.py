"""Settings with which a path is followed, and the count of the work that it took."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from indentfit.fem.deadline import NEVER, Deadline

FIRST_STEPS = 8  # that a growing contact needs
# Share of the depth at which the first step ends where a contact grows in the meridian plane. The forces before it continue those
# of the steps: with a first step of an eighth those of a layer of a twentieth of the sphere's radius were 30 % too small.
FIRST_DEPTH = 1 / 32
FEW, STEPS_OF_FEW = 150, 120  # unknowns; steps to the last depth, with which one element follows its closed forms within 1e-6


class Report(Protocol):
    """A function that is told how far a path has come."""

    def __call__(self, share: float, tries: int = 1) -> None:
        """The share of the last depth that is done, by the first try or by a later one."""
        ...


@dataclass(frozen=True)
class Controls:
    """Settings with which a path is followed.

    Parameters
    ----------
    tolerance : float
        Residual at equilibrium, relative to the contact forces.
    max_step : float, mm
        Largest step of the depth.
    first_steps : int
        Steps to the last depth when nothing goes wrong.
    first_depth : float
        Share of the last depth that the first step may reach at most. Where it fails, the usual first step is taken in its place.
    deadline : Deadline
        Checked once in every iteration.
    progress : Report, or function of the share alone
        Called after each step, and when a second try begins.
    most_iterations : float
        No step begins after so many iterations of Newton's.
    """

    tolerance: float
    max_step: float = np.inf
    first_steps: int = FIRST_STEPS
    first_depth: float = np.inf
    deadline: Deadline = NEVER
    progress: Callable[..., None] | None = None
    most_iterations: float = np.inf


def step_of_few(unknowns: int, depth: float) -> float:
    """The largest step, mm, to a depth of a model with so few unknowns that many steps cost nothing; infinite for others."""
    return depth / STEPS_OF_FEW if unknowns < FEW else np.inf


@dataclass
class Work:
    """The work of one run, counted while it goes on.

    Attributes
    ----------
    steps, cutbacks : int
        Steps of the depth, and how often a step was repeated with half its length.
    iterations : int
        Iterations of Newton's method.
    loose_steps : int
        Loose steps (see fem/relaxation.py).
    largest_residual : float
        The largest residual of the loose steps, over the contact forces.
    """

    steps: int = 0
    cutbacks: int = 0
    iterations: int = 0
    loose_steps: int = 0
    largest_residual: float = 0.0
