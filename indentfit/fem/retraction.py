"""Retraction of the indenter in the viscoelastic model: the contact shrinks, and its stresses go on to relax.

A step back is a step of `viscous` with falling depth. The tractions' rates of the loading do not continue at the turn: the first
step back starts from the tractions as they are, the next ones follow their rates in the retraction. Points that are left behind do
not touch again. The path ends where little of the force is left, since an equilibrium's residual is measured by it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from indentfit.arrays import Array
from indentfit.errors import ConvergenceError, IndentfitError
from indentfit.fem import path as elastic
from indentfit.fem.contact_state import Stride
from indentfit.fem.equations import Equations, Increment, Loading
from indentfit.fem.newton import Newton
from indentfit.fem.viscous import Moment, in_step, press_in_time
from indentfit.hereditary import Ramp, RelaxationFunction
from indentfit.motion import Motion

STEPS, LEAST = 12, 0.02  # steps of equal depths, and the share of the force at the turn at which they end
SMALLEST = 1 / 16  # of such a step


@dataclass(frozen=True, eq=False)
class Retraction:
    """The way back of an indenter after a ramp and a hold.

    Parameters
    ----------
    motion : Motion
        The whole motion: ramp, hold, and the way back.
    turn : float, s
        The time at which the way back begins.
    """

    motion: Motion
    turn: float

    @classmethod
    def after(cls, ramp: Ramp, motion: Motion) -> Retraction | None:
        """That of a measured motion, after the ramp and hold that stand for its loading; None where it does not go back."""
        if not motion.retracts:
            return None
        since = motion.time[motion.turn + 1 :] - motion.time[motion.turn]
        back = np.minimum.accumulate(np.minimum(motion.depth[motion.turn + 1 :], ramp.depth))
        ahead = Motion.ramped(ramp)
        whole = Motion(np.append(ahead.time, ramp.end + since), np.append(ahead.depth, back))
        return cls(whole, ramp.end)

    def depth_at(self, time: Array) -> Array:
        """Depths, mm, at times (...), s."""
        return np.asarray(np.interp(time, self.motion.time, self.motion.depth))

    def times(self, number: int, end: float) -> Array:
        """Times (n,), s, after the turn up to an end: at depths that fall in equal steps."""
        dense = np.linspace(self.turn, end, 2000)
        depth = self.depth_at(dense)
        levels = np.linspace(depth[0], depth[-1], number + 1)[1:-1]
        return np.unique(np.append(np.interp(-levels, -depth, dense), end))


def press_and_retract(
    equations: Equations,
    loading: Loading,
    newton: Newton,
    ramp: Ramp,
    relaxation: RelaxationFunction,
    retraction: Retraction,
    end: float,
) -> list[Moment]:
    """Moments from the untouched sample to the end of the hold, and of the retraction up to a time, or as far as it is solved.

    Parameters
    ----------
    equations, loading, newton, ramp, relaxation
        As of `viscous.press_in_time`, which raises the same errors.
    retraction : Retraction
    end : float, s

    Returns
    -------
    list of Moment
    """
    moments = press_in_time(equations, loading, newton, ramp, relaxation)
    loading = replace(loading, springs=moments[-1].at.springs, directions=())
    moments[-1] = moments[-1].at_corner()
    for there in retraction.times(STEPS, end):
        try:
            _go_back(moments, float(there), equations, loading, newton, retraction)
        except ConvergenceError:
            break  # what is solved is given, with the time to which it goes
        except IndentfitError as error:
            error.part = tuple(moments)
            raise
    return moments


def _go_back(
    moments: list[Moment], end: float, equations: Equations, loading: Loading, newton: Newton, retraction: Retraction
) -> None:
    """Add moments up to a time. Raises ConvergenceError where even a short step fails."""
    whole = step = end - moments[-1].time
    failed = False
    while moments[-1].time < end * (1 - 1e-12):
        newton.controls.deadline.check()
        here = moments[-1]
        dt = min(step, end - here.time)
        try:
            depth = float(retraction.depth_at(np.array(here.time + dt)))
            moments.append(_step(here, dt, depth, retraction.motion.deepest, equations, loading, newton, failed))
        except ConvergenceError as error:
            step, failed = dt / 2, True
            elastic._cut_back(newton, step < SMALLEST * whole, here.at.depth, error)
            continue
        newton.work.steps += 1
        failed = False


def _step(
    here: Moment, dt: float, depth: float, deepest: float, equations: Equations, loading: Loading, newton: Newton, relax: bool
) -> Moment:
    """The moment after a step of time that goes back to a depth, mm; at rest at a depth it is one of a hold."""
    if depth >= here.at.depth:
        return in_step(here, dt, here.at.depth, elastic.LEASH * deepest, equations, loading, newton, relax)
    now, leash = here.stiffened(equations, loading, dt), elastic.LEASH * deepest
    back = here.at.step < 0  # as the step before
    history = here.at.contact.advanced(here.at.rate if back else None, Stride(depth - here.at.depth, here.at.step, False))
    there, *_ = elastic._step(newton, Increment(equations, now, depth, history, (), leash), here.at, relax)
    there = elastic._augmented(equations, now, newton, there, leash)
    before = here.at if back else replace(here.at, step=0.0)
    return here.after(dt, there.since(before, equations.face, ()), equations, loading)
