"""What a result says of the law's own misfit: its size, and bands of the curves; and the draws from which predictions follow."""

from dataclasses import dataclass
from typing import Any

from indentfit.inference.plain import Interval

Row = tuple[float, ...]


@dataclass(frozen=True)
class CurveBand:
    """One test: the law's misfit along its curve, and what the fit predicts of the force there, mN, all (n,).

    Parameters
    ----------
    displacement : mm
    misfit, misfit_low, misfit_high
        What the force exceeds that of the law by: its mean, and its 95 % band.
    force, force_low, force_high
        The force of the sample, law and misfit together: mean, and 95 % band by parameters, uncertain inputs and misfit.
    measured_low, measured_high
        The 95 % band of a measured force: with the noise of one point.
    """

    displacement: Row
    misfit: Row
    misfit_low: Row
    misfit_high: Row
    force: Row
    force_low: Row
    force_high: Row
    measured_low: Row
    measured_high: Row


@dataclass(frozen=True)
class PosteriorDraws:
    """Equally probable draws of the posterior, a row for each.

    Parameters
    ----------
    names : tuple of str
        Free parameters, and inputs that change the solution, as `runs.points` takes them.
    values : (draws, n)
    changes : tuple of dict
        What each alternative changes of the case.
    alternative : (draws,)
        The number of each draw's alternative.
    scale : (draws,)
        Of the law's misfit.
    noise : dict of test -> (draws,), mN
        Standard deviation of a measured force.
    places : dict of test -> (m,)
        Some of the test's depths, over its largest one.
    errors : dict of test -> (draws, m)
        The law's misfit there, relative to the force.
    """

    names: tuple[str, ...]
    values: tuple[Row, ...]
    changes: tuple[dict[str, Any], ...]
    alternative: tuple[int, ...]
    scale: Row
    noise: dict[str, Row]
    places: dict[str, Row]
    errors: dict[str, tuple[Row, ...]]


@dataclass(frozen=True)
class LawMisfit:
    """The law's misfit as a term of the fit.

    Parameters
    ----------
    scale : float
        Its standard deviation at the largest depth, over the force there; of an unknown scale, the median.
    interval : (low, high) or None
        95 % interval of an unknown scale; None where the case states it.
    length : float
        Over the largest depth.
    tests : dict of test -> CurveBand
    draws : PosteriorDraws
    """

    scale: float
    interval: Interval | None
    length: float
    tests: dict[str, CurveBand]
    draws: PosteriorDraws
