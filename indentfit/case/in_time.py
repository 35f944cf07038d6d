"""The motions of the tests of a case in time, and the relaxation that their records can tell."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from indentfit.arrays import Array, Ints
from indentfit.case.relaxation import Relaxation, Window
from indentfit.curve import Curve
from indentfit.hereditary import Ramp
from indentfit.motion import SHORTEST_STEP, Load, Motion

if TYPE_CHECKING:
    from indentfit.case.tables import Test
    from indentfit.case.whole import Case

SEGMENTS = ("ramp", "hold", "retraction")
FEWEST = 5  # points of a segment
CORNER = 1e-6  # of the ramp's duration: rounding of its end
GRID = 25  # depths at which the elastic force of a test is known that has times


def timed(curve: Curve, rate: float | None) -> Curve:
    """A curve with times: its own, or those of a ramp at a constant rate, mm/s."""
    if curve.time is not None or rate is None:
        return curve
    time = curve.displacement / rate
    return Curve(curve.displacement, curve.force, curve.notes, curve.contact, curve.sd, time)


def motion_of(test: Test, curve: Curve | None) -> tuple[Motion, Array] | None:
    """The motion of a test, and the times since contact at which its force is measured, (n,) s; None where neither times nor a rate
    tell it, or where it follows from a force that is held. A test with a depth has no measured force: its times are the ends of
    ramp and hold."""
    if curve is not None and curve.time is not None:
        return Motion.measured(curve.time, curve.displacement, curve.force if test.control == "force" else None)
    if test.control == "force":
        return None
    depth = curve.deepest if curve is not None else test.depth
    rate = test.rate_to(depth) if depth else None
    if depth is None or rate is None:
        return None
    motion = Motion.ramped(Ramp(depth, depth / rate, test.hold or 0.0))
    return motion, (curve.displacement / rate if curve is not None else motion.time[1:])


def load_of(test: Test, curve: Curve | None) -> Load | None:
    """The force on the indenter over time in a test whose rig holds the force; None for another test."""
    if test.control != "force":
        return None
    if curve is not None and curve.time is not None:
        _, times = Motion.measured(curve.time, curve.displacement, curve.force)
        return Load.measured(times, curve.force)
    assert test.force is not None and test.ramp is not None  # faults of the case see to that
    return Load.ramped(test.force, test.ramp, test.hold or 0.0)


def segments_of(motion: Motion, times: Array) -> dict[str, Ints]:
    """The segments of a test in time. Noise and misfit have a size of their own in each: a ramp whose shape the law cannot follow
    would otherwise hide what a long hold tells.

    Parameters
    ----------
    motion : Motion
    times : array (n,), s
        Times of the measured points since contact.

    Returns
    -------
    dict of name -> array of numbers
        A segment of fewer than FEWEST points belongs to the one before it, or after it.
    """
    arrived, turned = motion.ramp.seconds * (1 + CORNER), float(motion.time[motion.turn]) + SHORTEST_STEP
    number = (times > arrived).astype(int) + (times > max(turned, arrived)).astype(int)
    for n in (2, 1):
        if 0 < np.count_nonzero(number == n) < FEWEST:
            number[number == n] = n - 1
    if 0 < np.count_nonzero(number == 0) < FEWEST:
        number[number == 0] = 1
    return {name: np.flatnonzero(number == n) for n, name in enumerate(SEGMENTS) if (number == n).any()}


def ramps_of(case: Case) -> dict[str, Ramp]:
    """The ramp and the hold of each test of a case that has a motion in time."""
    motions = ((test.name, motion_of(test, curve)) for test, curve in zip(case.tests, case.curves, strict=True))
    return {name: known[0].ramp for name, known in motions if known is not None}


def window_of(ramps: list[Ramp]) -> Window:
    """The times of relaxation that records with these ramps can see."""
    ramp, hold = min(known.seconds for known in ramps), max(known.hold for known in ramps)
    longest = max(hold, max(known.seconds for known in ramps))
    shortest = ramp if hold > 3 * ramp else 0.1 * ramp
    return Window(shortest, longest, ramp, hold)


def relaxation_of(case: Case) -> Relaxation | None:
    """The relaxation of the material, with the terms that the tool places; None where the material does not relax."""
    relaxation = case.material.relaxation
    ramps = list(ramps_of(case).values()) if relaxation is not None and relaxation.terms else []
    return relaxation.placed(window_of(ramps)) if relaxation is not None and ramps else relaxation
