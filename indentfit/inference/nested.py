"""The evidence of a law by nested sampling on its surrogate, by dynesty (Speagle 2020, MNRAS 493:3132).

Nested sampling (Skilling 2006, Bayesian Anal 1:833) integrates the density from its outside inwards, over shells of known volume.
It needs no Gaussian, and so it checks the integral of `evidence`, which begins at the places of largest density.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from indentfit.arrays import Array
from indentfit.errors import CaseError
from indentfit.inference.evidence import Density
from indentfit.inference.law_curves import LawCurves
from indentfit.inference.residual_noise import UnknownNoise

LIVE, FEWEST = 100, 400  # live points for each coordinate, and at least: the standard error of the log evidence is near 0.1
LEFT = 0.01  # of the log evidence, at which sampling ends
NOWHERE = -1e300  # log density where the mechanics failed: dynesty wants a number
NEEDS = "compare --nested: dynesty is not installed; pip install 'indentfit[nested]', or leave the option out"


@dataclass(frozen=True)
class NestedEvidence:
    """The log evidence, its standard error by the sampler's own estimate, and the number of densities that were computed."""

    log: float
    error: float
    calls: int


def require_dynesty() -> Any:
    """The module dynesty. Raises CaseError where it is not installed."""
    try:
        import dynesty
    except ImportError:
        raise CaseError([NEEDS]) from None
    return dynesty


def nested_evidence(curves: LawCurves, noise: UnknownNoise, seed: int) -> NestedEvidence:
    """The evidence of a law under one alternative, by nested sampling.

    Parameters
    ----------
    curves : LawCurves
    noise : UnknownNoise
    seed : int

    Returns
    -------
    NestedEvidence

    Raises
    ------
    CaseError
        dynesty is not installed.
    """
    dynesty, density, size = require_dynesty(), Density(curves, noise), curves.size

    def log(z: Array) -> float:
        value = float(density.log(z[None])[0])
        return value if np.isfinite(value) else NOWHERE

    sampler = dynesty.NestedSampler(log, _same, size, nlive=max(FEWEST, LIVE * size), rstate=np.random.default_rng(seed))
    sampler.run_nested(dlogz=LEFT, print_progress=False)
    results = sampler.results
    return NestedEvidence(float(results.logz[-1]), float(results.logzerr[-1]), int(np.sum(results.ncall)))


def _same(unit: Array) -> Array:
    """Places are in units of the ranges, over which parameters are uniform; the density has the priors of inputs in it."""
    return unit
