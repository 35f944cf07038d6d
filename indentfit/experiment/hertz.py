"""The Hertz modulus of a record under a sphere: F = 4/3 E* sqrt(R) (d - d0)^1.5, with the contact point d0 fitted too.

E* = E / (1 - nu^2) is the modulus of indentation. Theory: a smooth rigid sphere on a half-space that is elastic, small depths
(a depth above a tenth of the radius or of the thickness is beyond it, and the modulus is then a number to compare records by).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar

from indentfit.arrays import Array
from indentfit.experiment.noise import covariance, noise_in

MOST_SAMPLES = 2000
CONFIDENCE = 1.96  # standard errors of a 95 % interval
REACH = 0.15  # share of the depth within which d0 is searched about the contact point


@dataclass(frozen=True)
class Hertz:
    """The Hertz modulus of a loading.

    Attributes
    ----------
    modulus : float, kPa
        E* = E / (1 - nu^2).
    interval : float, kPa
        Half of its 95 % interval; of the scatter of the samples alone.
    contact : float, mm
        d0, from the contact point of the record.
    radius : float, mm
    rmse : float, mN
        Root mean square misfit.
    """

    modulus: float
    interval: float
    contact: float
    radius: float
    rmse: float


def hertz_modulus(displacement: Array, force: Array, radius: float) -> Hertz:
    """The `Hertz` modulus of samples.

    Parameters
    ----------
    displacement, force : array (n,), mm and mN
        Samples of the approach and the loading, counted from the contact point and from the force's zero.
    radius : float, mm

    Returns
    -------
    Hertz
    """
    thin = max(1, displacement.size // MOST_SAMPLES)
    count = displacement.size // thin * thin
    d, f = (values[:count].reshape(-1, thin).mean(axis=1) for values in (displacement, force))
    reach = REACH * float(d.max())

    def misfit(place: float) -> float:
        term = np.maximum(d - place, 0.0) ** 1.5
        return float(np.sum((f - term * (term @ f) / (term @ term)) ** 2))

    place = float(minimize_scalar(misfit, bounds=(-reach, reach), method="bounded", options={"xatol": 1e-6 * reach}).x)
    beyond = np.maximum(d - place, 0.0)
    term = beyond**1.5
    stiffness = float(term @ f / (term @ term))
    residual = f - stiffness * term
    spread = covariance(np.column_stack([term, -1.5 * stiffness * np.sqrt(beyond)]), noise_in(residual))[0, 0]
    share = 0.75 / float(np.sqrt(radius))
    interval = CONFIDENCE * share * float(np.sqrt(max(spread, 0.0)))
    return Hertz(share * stiffness, interval, place, radius, float(np.sqrt(np.mean(residual**2))))
