"""Records that were zeroed after contact: depth and force count from a preload, and the curve has lost its first part.

Under a sphere or a cone such a curve rises from its first point as steeply as a curve does that is deep in contact already. Where
the residuals of a fit are systematic, the computed curve F is tried in the form F(d + lost) - F(lost), times a factor.
"""

from collections.abc import Collection, Iterator

import numpy as np

from indentfit.arrays import Array
from indentfit.case import Case
from indentfit.digits import quantity
from indentfit.inverse.objective import Target, rmse
from indentfit.inverse.problem import InverseProblem

LOST = np.linspace(0.0, 0.4, 41)  # depths that may be lost, over the deepest
LARGE = 0.01  # RMSE over the largest force from which a misfit is worth a reason
BETTER = 0.5  # largest residuals beside those without a loss
FEWEST = 6  # points that must be left
ZEROED = "the residuals look like those of a record that was zeroed after contact, or of a law that softens: "


def zeroed_late(case: Case, problem: InverseProblem, forces: Collection[Array], systematic: Collection[str]) -> Iterator[str]:
    """A sentence on the tests whose residuals are those of a record that was zeroed after contact.

    Parameters
    ----------
    case : Case
    problem : InverseProblem
    forces : collection of arrays (n,), mN
        The computed curve of each test.
    systematic : collection of str
        The tests whose residuals are systematic.
    """
    if problem.segmented:
        return
    for test, target, force in zip(case.tests, problem.tests, forces, strict=True):
        grows = test.kind == "indentation" and case.indenter_of(test).geometry.end != "flat"
        if not grows or target.name not in systematic or rmse(target, force) <= LARGE * np.abs(target.curve.force).max():
            continue
        lost, left = _lost(target, force)
        if lost:
            yield (
                f"{ZEROED}if the first {quantity(lost, 'mm', 2)} or so of {test.name} were lost, {left:.0%} of its residuals "
                "would be left; check where its displacement and force were zeroed"
            )


def _lost(target: Target, force: Array) -> tuple[float, float]:
    """The depth that is lost, mm, and the residuals that are left, over those without a loss at the same points; 0 and 1 where a
    loss explains little."""
    depth, measured = target.curve.displacement, target.curve.force
    if depth[0] < 0 or np.any(np.diff(depth) <= 0):
        return 0.0, 1.0
    known = np.concatenate([[0.0], depth[depth > 0]]), np.concatenate([[0.0], force[depth > 0]])
    best, least = 0.0, 1.0
    for lost in LOST[1:] * depth[-1]:
        rows = depth + lost <= depth[-1]
        if rows.sum() < FEWEST:
            break
        moved = np.interp(depth[rows] + lost, *known) - np.interp(lost, *known)
        left = _residual(measured[rows], moved) / max(_residual(measured[rows], force[rows]), 1e-300)
        if left < least:
            best, least = float(lost), left
    return (best, least) if least <= BETTER else (0.0, 1.0)


def _residual(measured: Array, force: Array) -> float:
    """Norm of what is left of measured forces beside a computed curve times the best factor."""
    factor = float(measured @ force) / max(float(force @ force), 1e-300)
    return float(np.linalg.norm(measured - factor * force))
