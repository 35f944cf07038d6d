"""Curves of a design with their derivatives, and what becomes of them in time where the material relaxes.

The elastic forces of a test and their derivatives are known on a grid of depths. Hereditary integrals map both to any ramp and
hold, and give the derivatives by the parameters of the relaxation: other rates and holds need no run.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from indentfit.arrays import Array
from indentfit.case import Case
from indentfit.case.in_time import motion_of
from indentfit.case.relaxation import Relaxation
from indentfit.hereditary import Ramp
from indentfit.indenters import IndenterShape
from indentfit.motion import Motion
from indentfit.runs.relaxing import kernel_for

RAMP_POINTS, HOLD_POINTS, EARLIEST = 24, 24, 0.1  # of a ramp and of a hold; the hold's first time over the ramp's duration
SPEEDS = (10.0, 1.0, 0.1)  # times the case's own
LONG = (3.0, 10.0)  # holds, over the longest time of relaxation


@dataclass(frozen=True, eq=False)
class Curves:
    """Forces of a test (n,), mN, and their derivatives (n, p), mN per unit of a parameter, at depths (n,), mm."""

    depths: Array
    forces: Array
    slopes: Array
    shape: IndenterShape | None = field(default=None, repr=False)

    def information(self, noise: float | Array) -> Array:
        """Fisher's information (p, p) of forces with white noise, mN, of one size or of one for each point."""
        rows = self.slopes / np.reshape(noise, (-1, 1))
        return np.asarray(rows.T @ rows)

    def to(self, depth: float, points: int) -> Curves:
        """Some points up to a depth, mm, in nearly equal steps."""
        rows = np.linspace(0, np.count_nonzero(self.depths <= depth * (1 + 1e-9)) - 1, points).round().astype(int)
        return replace(self, depths=self.depths[rows], forces=self.forces[rows], slopes=self.slopes[rows])


@dataclass(frozen=True, eq=False)
class InTime:
    """How the tests of a case go in time.

    Parameters
    ----------
    relaxation : Relaxation
    values : dict of name -> value
        The parameters of the relaxation.
    motions : tuple of (Motion, array of times)
        Of the case's own tests.
    rate : float, mm/s
        Of the first test's ramp.
    hold : float, s
        The longest hold.
    """

    relaxation: Relaxation
    values: dict[str, float]
    motions: tuple[tuple[Motion, Array], ...]
    rate: float
    hold: float

    @classmethod
    def of(cls, case: Case, given: Mapping[str, float]) -> InTime | None:
        """That of a case; None where its material does not relax."""
        relaxation = case.relaxation
        if relaxation is None:
            return None
        motions = []
        for test, curve in zip(case.tests, case.curves, strict=True):
            known = motion_of(test, curve)
            assert known is not None  # faults of the case see to that
            motions.append(known if curve is not None else (known[0], _times(known[0].ramp)))
        first, hold = motions[0][0].ramp, max(motion.ramp.hold for motion, _ in motions)
        return cls(relaxation, relaxation.at(given).numbers, tuple(motions), first.depth / first.seconds, hold)

    def own(self, curves: Sequence[Curves]) -> list[Curves]:
        """The curves of the case's own tests, in their own times, from the elastic ones."""
        pairs = zip(curves, self.motions, strict=True)
        return [self._mapped(curve, motion, times) for curve, (motion, times) in pairs]

    def ramped(self, curve: Curves, ramp: Ramp) -> Curves:
        """The curve of a ramp and a hold, from elastic ones on a grid that goes at least as deep."""
        return self._mapped(curve, Motion.ramped(ramp), _times(ramp))

    def ramps(self, depth: float) -> Iterator[Ramp]:
        """Ramps to a depth, mm, of other durations, each with holds of several."""
        slowest = max((value for name, value in self.values.items() if name.startswith("tau")), default=self.hold)
        holds = sorted({self.hold, *(float(f"{factor * slowest:.2g}") for factor in LONG)})
        for speed in SPEEDS:
            for hold in holds:
                yield Ramp(depth, depth / (speed * self.rate), hold)

    def _mapped(self, curve: Curves, motion: Motion, times: Array) -> Curves:
        assert curve.shape is not None  # materials that relax have indentations only
        kernel = kernel_for(self.relaxation, curve.shape, float(curve.depths[-1]), motion, times)
        (forces,) = kernel.forces([curve.forces], self.values)
        (slopes,) = kernel.forces([curve.slopes.T], self.values)
        (own,) = kernel.slopes([curve.forces], self.values, kernel.free)
        return replace(curve, depths=times, forces=forces, slopes=np.column_stack([slopes.T, *(own[name] for name in kernel.free)]))


def _times(ramp: Ramp) -> Array:
    """Times (n,), s, of the points of a ramp and a hold."""
    rise = ramp.seconds * np.arange(1, RAMP_POINTS + 1) / RAMP_POINTS
    if not ramp.hold:
        return rise
    return np.concatenate(
        [rise, ramp.seconds + np.geomspace(min(EARLIEST * ramp.seconds, 0.1 * ramp.hold), ramp.hold, HOLD_POINTS)]
    )
