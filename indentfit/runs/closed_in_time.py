"""Closed forms of curves in time: hereditary integrals of the elastic forces of a half-space or a layer.

Lee and Radok 1960, J Appl Mech 27:438: under a sphere the integral is exact at small strain while the contact does not shrink.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from indentfit import elastic
from indentfit.arrays import Array
from indentfit.case import Case, Test
from indentfit.case.in_time import motion_of
from indentfit.curve import Curve
from indentfit.motion import SHORTEST_STEP
from indentfit.runs.closed_form import BULK, Elastic, Over
from indentfit.runs.relaxing import MATTERS, BulkShares, kernel_for

SLIGHTLY = 1e-3  # of the bulk modulus, for differences


def over_time(case: Case, test: Test, curve: Curve, relaxed: Mapping[str, Any]) -> Over:
    """Forces at the times of a curve up to where the indenter turns back, by the hereditary integral of elastic forces.

    Parameters
    ----------
    case : Case
    test : Test
    curve : Curve
        It has times, or its test a rate.
    relaxed : mapping of name -> value
        The parameters of the relaxation, among others; the start values stand for those that it does not name.

    Returns
    -------
    function of elastic forces and Poisson's ratio
        The bulk modulus does not relax: its share of the elastic force at the deepest point is kept.
    """
    known, relaxation = motion_of(test, curve), case.relaxation
    assert known is not None and relaxation is not None
    motion, times = known
    times = times[times <= motion.time[motion.turn] + SHORTEST_STEP]
    kernel = kernel_for(relaxation, case.indenter_of(test).geometry, curve.deepest, motion, times)

    def over(of: Elastic, nu: float) -> Array:
        ratio = elastic.bulk_ratio(nu) if nu < 0.5 else np.inf
        bulk = BulkShares(ratio, (_bulk_share(of, curve.deepest, ratio),)) if ratio < MATTERS else None
        return replace(kernel, bulk=bulk).forces([of(kernel.depths[0], nu)], {**relaxed, BULK: ratio})[0]

    return over


def _bulk_share(of: Elastic, depth: float, ratio: float) -> float:
    """d ln F / d ln kappa of an elastic force at a depth, mm."""
    low, high = (of(np.array([depth]), elastic.poisson_ratio(ratio * factor))[0] for factor in (1 - SLIGHTLY, 1 + SLIGHTLY))
    return float(np.log(high / low) / np.log((1 + SLIGHTLY) / (1 - SLIGHTLY)))
