"""A simulated rig: the raw record that a lab would measure of a known curve, for studies and examples whose truth is known.

Position: at rest before the sample, an approach, a ramp at constant velocity, a hold. Sensors: white noise, the stage's vibration
while it moves, drift of the load cell, the converter's resolution. The noise of `PHANTOM` is that seen in gelatin records of a
rig like that of Feng et al. 2017 (0.02 mN at rest, 0.55 mN of 45 Hz vibration in motion, steps of 0.006 mm and 0.024 mN).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.signal import lfilter

from indentfit.arrays import Array, Bools
from indentfit.curve import Curve
from indentfit.experiment.record import RawRecord

Relaxation = Sequence[tuple[float, float]]  # pairs of a share of the instantaneous force and a time constant, s


@dataclass(frozen=True)
class SensorNoise:
    """Errors of the sensors.

    Standard deviations are in mN and mm, `resolution` in mN (force) and mm (displacement), drift in mN/s. `vibration` is that of
    force and displacement while the stage moves, at `frequency` Hz, with the correlation `coherence` after one period.
    """

    force: float = 0.02
    displacement: float = 0.0024
    vibration: tuple[float, float] = (0.55, 0.004)
    frequency: float = 45.0
    coherence: float = 0.35
    resolution: tuple[float, float] = (0.024, 0.006)
    drift: float = 0.0


PHANTOM = SensorNoise()


@dataclass(frozen=True)
class Rig:
    """Motion of the stage: rate Hz, lengths mm, times s, velocities mm/s; `zero`: readings of the sensors at the start, mm and mN.

    The approach begins `gap` above the sample; an approach with its own velocity ends in the sample, at a hundredth of the depth.
    `adhesion` is the pull of a wet sample on the indenter close to contact, mN, over `reach` mm.
    """

    rate: float = 1000.0
    rest: float = 0.15
    gap: float = 0.3
    velocity: float = 1.0
    approach_velocity: float | None = None
    hold: float = 0.5
    adhesion: float = 0.0
    reach: float = 0.01
    zero: tuple[float, float] = (0.4, 1.7)
    noise: SensorNoise = field(default_factory=SensorNoise)

    def run(self, curve: Curve, rng: np.random.Generator, relaxation: Relaxation = ()) -> tuple[RawRecord, float]:
        """One record of a sample whose elastic curve is known. The depth of the ramp is the last displacement of the curve.

        Parameters
        ----------
        curve : Curve
        rng : numpy Generator
        relaxation : pairs of floats
            Share of the instantaneous force, and time constant in s, of each term of a Prony series.

        Returns
        -------
        RawRecord, float
            The record, and the displacement in it at contact, mm.
        """
        time, position, moving = self._motion(float(curve.displacement[-1]))
        force = _relaxing(_elastic(curve, position), relaxation, 1 / self.rate)
        force = force - self.adhesion * np.exp(-np.abs(position) / self.reach)
        noise = self.noise
        shake = _vibration(moving, noise, self.rate, rng)
        d = position + self.gap + self.zero[0] + noise.displacement * rng.standard_normal(time.size) + noise.vibration[1] * shake[1]
        f = force + self.zero[1] + noise.drift * time + noise.force * rng.standard_normal(time.size) + noise.vibration[0] * shake[0]
        d, f = (_steps(values, step) for values, step in zip((d, f), noise.resolution[::-1], strict=True))
        return RawRecord(time, d, f, name="simulated rig"), self.gap + self.zero[0]

    def _motion(self, depth: float) -> tuple[Array, Array, Bools]:
        """Time, position of the indenter (0 at contact, mm) and whether the stage moves, each (n,)."""
        slow = self.approach_velocity or self.velocity
        inside = min(0.01 * depth, depth) if self.approach_velocity else 0.0
        spans = [self.rest, (self.gap + inside) / slow, (depth - inside) / self.velocity, self.hold]
        corners = np.cumsum([0.0, *spans])
        time = np.arange(round(corners[-1] * self.rate)) / self.rate
        position = np.interp(time, corners, [-self.gap, -self.gap, inside, depth, depth])
        return time, position, (time >= corners[1]) & (time < corners[3])


def _elastic(curve: Curve, position: Array) -> Array:
    """Force of the curve at positions (n,), mm; zero above the sample."""
    d, F = np.append(0.0, curve.displacement), np.append(0.0, curve.force)
    d, F = (d[1:], F[1:]) if d[1] == 0 else (d, F)
    return PchipInterpolator(d, F)(np.clip(position, 0.0, d[-1]))


def _relaxing(elastic: Array, relaxation: Relaxation, interval: float) -> Array:
    """The force of quasi-linear viscoelasticity: the convolution of the elastic force's rate with the Prony series."""
    force = (1 - sum(share for share, _ in relaxation)) * elastic
    for share, tau in relaxation:
        decay = np.exp(-interval / tau)
        force = force + share * lfilter([np.sqrt(decay)], [1, -decay], np.diff(elastic, prepend=0.0))
    return force


def _vibration(moving: Bools, noise: SensorNoise, rate: float, rng: np.random.Generator) -> Array:
    """Two unit vibrations (2, n) that last while the stage moves: white noise drives a damped oscillation."""
    pole = noise.coherence ** (noise.frequency / rate)
    a = [1, -2 * pole * np.cos(2 * np.pi * noise.frequency / rate), pole**2]
    n, settle = moving.size, 500
    shake = lfilter([1], a, rng.standard_normal((2, n + settle)), axis=1)[:, settle:]
    spread = lfilter([1], a, np.eye(1, 5000)[0])
    return shake / np.sqrt(np.sum(spread**2)) * moving


def _steps(values: Array, resolution: float) -> Array:
    """Values rounded to whole steps of the converter."""
    return np.round(values / resolution) * resolution if resolution else values
