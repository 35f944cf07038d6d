"""The contact point of a record that begins in contact, extrapolated by the law of the indenter from the first forces.

The force's zero is known, of the sensor or as stated; the law is that of `contact_point.POWERS`: F = a (d - d0)^m + b (d - d0)^n.
The interval holds the scatter of the fit, and how far d0 moves where the law is fitted to half of the stretch, where it has one
power only, and, if the end of the indenter is not known, under the other ends; and 1 % of the distance of the extrapolation.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.stats import norm

from indentfit.arrays import Array
from indentfit.experiment.contact_point import CONFIDENCE, ContactPoint
from indentfit.experiment.loading import Ramp
from indentfit.experiment.noise import covariance, noise_in
from indentfit.experiment.piecewise import GRID, POWERS, solved

SHARE = 0.6  # of the largest force: the law is fitted to the samples below
MOST_SAMPLES = 1500  # of a fit
TRUST = 0.01  # share of the distance over which the law is extrapolated that is in doubt: no end is its ideal
FURTHEST = 1.5  # the contact point is searched so many depths before the first sample


def extrapolated_contact(ramp: Ramp, zero: float, indenter: str | None) -> ContactPoint:
    """The `ContactPoint` that the law of the indenter gives to a record that begins in contact.

    Parameters
    ----------
    ramp : Ramp
    zero : float, mN
        The force without contact.
    indenter : str or None
        "flat" or "sphere"; None where it is not known.

    Returns
    -------
    ContactPoint
        Its displacement may lie before the first sample.
    """
    displacement, force = _stretch(ramp, zero)
    ends = [indenter] if indenter else list(POWERS)
    fits = [_Law(displacement, force, POWERS[end]) for end in ends]
    best = min(fits, key=_misfit_of)
    half = displacement <= np.median(displacement)
    others = [law.place for law in fits]
    for end in ends:
        others += [_Law(displacement, force, POWERS[end][:1]).place, _Law(displacement[half], force[half], POWERS[end]).place]
    spread = best.spread(others) + TRUST * max(float(displacement.min()) - best.place, 0.0)
    statistic = float(norm.ppf((1 + CONFIDENCE) / 2)) * best.stderr
    inside = np.flatnonzero(ramp.displacement[: ramp.high] < best.place)
    index = int(inside[-1]) + 1 if inside.size else 0
    stretch = (float(displacement.min()), float(displacement.max()))
    return ContactPoint(
        best.place, float(np.hypot(statistic, spread)), index, zero, 0.0, best.noise, "extrapolated", stretch=stretch
    )


def _stretch(ramp: Ramp, zero: float) -> tuple[Array, Array]:
    """Displacement, mm, and force above zero, mN, of the loading below a share of the peak, thinned by block means."""
    end = ramp.stop
    above = np.flatnonzero(ramp.force[:end] - zero >= SHARE * (ramp.force[:end].max() - zero))
    end = max(int(above[0]) if above.size else end, min(20, end))
    thin = max(1, end // MOST_SAMPLES)
    count = end // thin * thin
    channels = (ramp.record.displacement[:count], ramp.record.force[:count] - zero)
    displacement, force = (channel.reshape(-1, thin).mean(axis=1) for channel in channels)
    return displacement, force


class _Law:
    """A law of powers fitted to displacement (n,), mm, and force (n,), mN, with the contact point free."""

    def __init__(self, displacement: Array, force: Array, powers: tuple[float, ...]) -> None:
        self.displacement, self.force, self.powers = displacement, force, powers
        first, depth = float(displacement.min()), max(float(np.ptp(displacement)), 1e-12)
        places = first + depth * np.concatenate([-np.geomspace(FURTHEST, 1e-4, GRID), np.linspace(0, 0.1, 8)])
        best = int(np.argmin([self._misfit(place) for place in places]))
        bounds = places[max(best - 1, 0)], places[min(best + 1, places.size - 1)]
        self.place = float(minimize_scalar(self._misfit, bounds=bounds, method="bounded", options={"xatol": 1e-7 * depth}).x)
        self.misfit = self._misfit(self.place)
        self.noise = float(np.sqrt(self.misfit / displacement.size))

    @property
    def stderr(self) -> float:
        """Standard error of the contact point, mm, with noise that is correlated."""
        terms = self._terms(self.place)
        coefficients = solved(terms, self.force)
        beyond = np.maximum(self.displacement - self.place, 0.0)
        slope = sum(m * c * beyond ** (m - 1) for m, c in zip(self.powers, coefficients, strict=True))
        jacobian = np.column_stack([terms, -np.asarray(slope)])
        return float(np.sqrt(max(covariance(jacobian, noise_in(self.force - terms @ coefficients))[-1, -1], 0.0)))

    def spread(self, others: list[float]) -> float:
        """How far other fits put the contact point from this one, mm."""
        return float(np.max(np.abs(np.array(others) - self.place)))

    def _terms(self, place: float) -> Array:
        beyond = np.maximum(self.displacement - place, 0.0)
        return np.column_stack([beyond**m for m in self.powers])

    def _misfit(self, place: float) -> float:
        terms = self._terms(place)
        residual = self.force - terms @ solved(terms, self.force)
        return float(residual @ residual)


def _misfit_of(law: _Law) -> float:
    return law.misfit
