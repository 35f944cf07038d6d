"""Statistics of replicates: stiffness per direction, the ratio of directions, tests of their difference, mean curves."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy import stats

from indentfit.arrays import Array
from indentfit.curve import Curve
from indentfit.experiment.outcomes import Outcome, usable
from indentfit.experiment.processed import ProcessedRecord
from indentfit.experiment.stiffness import Line, Parabola, linear_fit, quadratic_fit

CONFIDENCE = 0.95
OUTLYING = 3.5  # modified z-score (Iglewicz and Hoaglin 1993, How to Detect and Handle Outliers)


@dataclass(frozen=True)
class Spread:
    """Moments of n values: mean, standard deviation, standard error, 95 % interval of the mean (Student's t) and median.

    `outliers` holds the names of values with a large modified z-score. All moments include the outliers.
    """

    n: int
    mean: float
    sd: float
    stderr: float
    interval: tuple[float, float]
    median: float
    outliers: tuple[str, ...]


@dataclass(frozen=True)
class Difference:
    """One test of whether two directions differ: name, statistic, p-value, n of each, and 95 % interval of the difference."""

    test: str
    statistic: float
    p: float
    n: tuple[int, int]
    interval: tuple[float, float] | None = None


@dataclass(frozen=True, eq=False)
class MeanCurve:
    """The mean of `count` curves at common displacements.

    Attributes
    ----------
    displacement : array (n,), mm
    force, sd : array (n,), mN
        Mean force and its standard deviation.
    line, parabola : Line, Parabola
        Fits to the mean.
    """

    displacement: Array
    force: Array
    sd: Array
    count: int
    line: Line
    parabola: Parabola

    def target(self, kind: str) -> Curve:
        """The curve for a fit: the "mean" itself, or its "linear" or "quadratic" fit through contact (as Feng et al. 2017)."""
        d = self.displacement
        slope = float(d @ self.force / (d @ d))
        quadratic = (self.parabola.curvature * d + self.parabola.slope) * d
        return Curve(d, {"mean": self.force, "linear": slope * d, "quadratic": quadratic}[kind])


@dataclass(frozen=True)
class Statistics:
    """Statistics of the stiffness of replicates.

    Attributes
    ----------
    stiffness : dict
        Direction -> Spread, mN/mm.
    ratio : Spread or None
        Spread of each sample's stiffness at 90 degrees over that at 0 degrees.
    differences : tuple of Difference
        Tests of whether the two directions differ.
    """

    stiffness: dict[int, Spread]
    ratio: Spread | None
    differences: tuple[Difference, ...]


Named = dict[str, float]  # name of a sample -> a value


def statistics(outcomes: Sequence[Outcome]) -> Statistics:
    """Statistics of the stiffness, the slope of the linear fit in mN/mm; outcomes without record or direction are ignored."""
    values = stiffness_by_direction(outcomes)
    spreads = {direction: spread(named) for direction, named in values.items()}
    if not {0, 90} <= set(values):
        return Statistics(spreads, None, ())
    both = [sample for sample in values[0] if sample in values[90]]
    ratio = spread({sample: values[90][sample] / values[0][sample] for sample in both}) if both else None
    return Statistics(spreads, ratio, tuple(_differences(values, both)))


def stiffness_by_direction(outcomes: Sequence[Outcome]) -> dict[int, Named]:
    """Direction -> sample -> stiffness, mN/mm, with the directions in rising order."""
    directions = {outcome.entry.group for outcome in usable(outcomes)}
    return {
        direction: {outcome.entry.sample: outcome.processed.line.slope for outcome in usable(outcomes, direction)}
        for direction in sorted(direction for direction in directions if direction is not None)
    }


def spread(named: Named) -> Spread:
    """The `Spread` of named values."""
    values = np.array(list(named.values()))
    n, mean = values.size, float(values.mean())
    sd = float(values.std(ddof=1)) if n > 1 else float("nan")
    stderr = sd / np.sqrt(n)
    reach = stats.t.ppf((1 + CONFIDENCE) / 2, n - 1) * stderr if n > 1 else float("nan")
    return Spread(n, mean, sd, float(stderr), (float(mean - reach), float(mean + reach)), float(np.median(values)), outliers(named))


def outliers(named: Named) -> tuple[str, ...]:
    """Names of the values whose modified z-score exceeds 3.5; fewer than four values have no outliers."""
    values = np.array(list(named.values()))
    deviation = stats.median_abs_deviation(values, scale="normal")
    if values.size < 4 or not deviation > 0:
        return ()
    scores = np.abs(values - np.median(values)) / deviation
    return tuple(name for name, score in zip(named, scores, strict=True) if score > OUTLYING)


def _differences(values: dict[int, Named], both: list[str]) -> Iterator[Difference]:
    """Paired t and signed ranks on the samples measured in both directions; Student's (as the paper) and Welch's t on all."""
    pairs = [np.array([values[direction][sample] for sample in both]) for direction in (90, 0)]
    every = [np.array(list(values[direction].values())) for direction in (90, 0)]
    n = (len(both), len(both))
    if len(both) > 1:
        yield _test("paired t-test", stats.ttest_rel(*pairs), n)
        signed = stats.wilcoxon(*pairs)
        yield Difference("Wilcoxon signed-rank test", float(signed.statistic), float(signed.pvalue), n)
    if min(map(len, every)) > 1:
        n = (len(every[0]), len(every[1]))
        yield _test("unpaired t-test (Student, equal variances)", stats.ttest_ind(*every), n)
        yield _test("unpaired t-test (Welch)", stats.ttest_ind(*every, equal_var=False), n)


class _TTest(Protocol):
    """What SciPy's t-tests return."""

    statistic: float
    pvalue: float

    def confidence_interval(self, confidence_level: float) -> _Interval: ...


class _Interval(Protocol):
    low: float
    high: float


def _test(name: str, result: _TTest, n: tuple[int, int]) -> Difference:
    interval = result.confidence_interval(CONFIDENCE)
    return Difference(name, float(result.statistic), float(result.pvalue), n, (float(interval.low), float(interval.high)))


def mean_curves(outcomes: Sequence[Outcome], points: int = 25) -> dict[int, MeanCurve]:
    """Direction -> `MeanCurve`: means at equal displacements from contact, to the least depth of the direction's records."""
    groups = {direction: usable(outcomes, direction) for direction in stiffness_by_direction(outcomes)}
    return {direction: _mean_curve([outcome.processed for outcome in group], points) for direction, group in groups.items()}


def _mean_curve(records: list[ProcessedRecord], points: int) -> MeanCurve:
    depth = min(record.curve.displacement[-1] for record in records)
    at = depth * np.arange(1, points + 1) / points
    forces = np.array([_force_at(record.curve, at) for record in records])
    sd = forces.std(axis=0, ddof=1) if len(records) > 1 else np.zeros(points)
    mean = forces.mean(axis=0)
    return MeanCurve(at, mean, sd, len(records), linear_fit(at, mean), quadratic_fit(at, mean))


def _force_at(curve: Curve, displacement: Array) -> Array:
    return np.interp(displacement, np.append(0.0, curve.displacement), np.append(0.0, curve.force))
