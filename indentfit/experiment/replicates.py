"""Statistics of replicates: stiffness per direction, the ratio of directions, tests of their difference, mean curves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats

from indentfit.curve import Curve
from indentfit.experiment.stiffness import Line, Parabola, linear_fit, quadratic_fit

CONFIDENCE = 0.95
OUTLYING = 3.5  # modified z-score (Iglewicz and Hoaglin 1993, How to Detect and Handle Outliers)


@dataclass(frozen=True)
class Spread:
    """Of n values: mean, standard deviation, standard error, 95 % interval of the mean (Student's t), median, names of outliers.

    Outliers, by the modified z-score, are named only: they are part of every number here.
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
    """Mean force (n,) and its standard deviation (n,), mN, of `count` curves at common displacements (n,), mm, with fits through
    contact.
    """

    displacement: np.ndarray
    force: np.ndarray
    sd: np.ndarray
    count: int
    line: Line
    parabola: Parabola

    def target(self, kind):
        """`Curve` to be fitted: the "mean" itself, its "linear" fit through contact, or its "quadratic" one (Feng et al. 2017)."""
        d = self.displacement
        slope = float(d @ self.force / (d @ d))
        quadratic = (self.parabola.curvature * d + self.parabola.slope) * d
        return Curve(d, {"mean": self.force, "linear": slope * d, "quadratic": quadratic}[kind])


@dataclass(frozen=True)
class Statistics:
    """stiffness: direction -> Spread, mN/mm; ratio: Spread of the per-sample 90 / 0; differences: tests between directions."""

    stiffness: dict[int, Spread]
    ratio: Spread | None
    differences: tuple[Difference, ...]


def statistics(outcomes):
    """`Statistics` of the stiffness (slope of the linear fit, mN/mm) of a list of Outcomes; those with a problem do not count."""
    values = stiffness_by_direction(outcomes)
    spreads = {direction: spread(named) for direction, named in values.items()}
    if not {0, 90} <= set(values):
        return Statistics(spreads, None, ())
    both = [sample for sample in values[0] if sample in values[90]]
    ratio = spread({sample: values[90][sample] / values[0][sample] for sample in both}) if both else None
    return Statistics(spreads, ratio, tuple(_differences(values, both)))


def stiffness_by_direction(outcomes):
    """direction -> sample -> stiffness, mN/mm, directions rising."""
    values: dict[int, dict[str, float]] = {}
    for one in sorted(
        (one for one in outcomes if one.processed and one.entry.direction is not None), key=lambda one: one.entry.direction
    ):
        values.setdefault(one.entry.direction, {})[one.entry.sample] = one.processed.line.slope
    return values


def spread(named):
    """`Spread` of values by name."""
    values = np.array(list(named.values()))
    n, mean = values.size, float(values.mean())
    sd = float(values.std(ddof=1)) if n > 1 else float("nan")
    stderr = sd / np.sqrt(n)
    reach = stats.t.ppf((1 + CONFIDENCE) / 2, n - 1) * stderr if n > 1 else float("nan")
    return Spread(n, mean, sd, float(stderr), (float(mean - reach), float(mean + reach)), float(np.median(values)), outliers(named))


def outliers(named):
    """Names of the values whose modified z-score exceeds 3.5; of fewer than four values none can be told."""
    values = np.array(list(named.values()))
    deviation = stats.median_abs_deviation(values, scale="normal")
    if values.size < 4 or not deviation > 0:
        return ()
    scores = np.abs(values - np.median(values)) / deviation
    return tuple(name for name, score in zip(named, scores, strict=True) if score > OUTLYING)


def _differences(values, both):
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


def _test(name, result, n):
    interval = result.confidence_interval(CONFIDENCE)
    return Difference(name, float(result.statistic), float(result.pvalue), n, (float(interval.low), float(interval.high)))


def mean_curves(outcomes, points=25):
    """direction -> `MeanCurve`: means at equal displacements from contact, to the least depth of the direction's records."""
    found = {}
    for direction in stiffness_by_direction(outcomes):
        group = [one.processed for one in outcomes if one.processed and one.entry.direction == direction]
        depth = min(one.curve.displacement[-1] for one in group)
        at = depth * np.arange(1, points + 1) / points
        forces = np.array([_force_at(one, at) for one in group])
        sd = forces.std(axis=0, ddof=1) if len(group) > 1 else np.zeros(points)
        mean = forces.mean(axis=0)
        found[direction] = MeanCurve(at, mean, sd, len(group), linear_fit(at, mean), quadratic_fit(at, mean))
    return found


def _force_at(processed, displacement):
    curve = processed.curve
    return np.interp(displacement, np.append(0.0, curve.displacement), np.append(0.0, curve.force))
