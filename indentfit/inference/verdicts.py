"""Verdicts in words: how well each parameter is determined, what limits it, and what the curves of a fit determine together."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from indentfit.arrays import Array
from indentfit.case import Range
from indentfit.case.doubts import CurveDoubt
from indentfit.case.ranges import RangeOfAngle
from indentfit.digits import quantity
from indentfit.inference.agreement import TestPrediction
from indentfit.inference.limits import Limit
from indentfit.inference.plain import span
from indentfit.inference.result import ParameterEstimate, PublishedComparison, TestAlone

DETERMINED = 0.2  # half an interval over the value
WEAKLY = 2 / 3  # half an interval over its middle: a factor of five between its ends
IN_DOUBT = "not determined: the recording of {tests} is in doubt"
UNPROVED = "not determined: the search did not end at a proved optimum"
REACHED = 0.05  # of an interval's width, from a bound: half a normal density has its 2.5 % quantile at 0.014 of the interval
KINDS = ("determined", "weakly determined", "at a bound", "not determined")


def verdict(value: float, interval: Sequence[float] | Array, bounds: Range, at_bound: str, limit: Limit = Limit()) -> str:  # noqa: B008
    """How well a parameter is determined, and what limits it, in words.

    A parameter at its bound is never determined: the interval ends at the bound because the search does, and not because of the
    curves.

    Parameters
    ----------
    value : float
    interval : (low, high)
        95 % interval, within the bounds.
    bounds : Range
    at_bound : "lower", "upper" or ""
    limit : Limit
        What makes the interval as wide as it is.

    Returns
    -------
    str
    """
    low, high = interval
    half = max(value - low, high - value)
    size = bounds.scale or abs(value)
    share = half / size if size else np.inf
    cure = limit.cure(DETERMINED / share) if np.isfinite(share) and share > 0 else ""
    within = f"any value in {low:.3g}-{high:.3g} fits within {limit.words}{f'; {cure}' if cure else ''}"
    if at_bound:
        place = f"at its {at_bound} bound ({bounds.min if at_bound == 'lower' else bounds.max:g})"
        if low <= bounds.min and high >= bounds.max:
            return f"{place}; not determined by these curves: {within}"
        again = "; directions go on beyond it: move the range" if isinstance(bounds, RangeOfAngle) else ""
        return f"{place}: {beyond(interval, at_bound)}{again}"
    if low <= bounds.min and high >= bounds.max:
        return f"not determined by these curves: {within}"
    limited = f"; limited by {limit.words}{f': {cure}' if cure else ''}"
    if share <= DETERMINED:
        return f"determined (+-{f'{half:.2g} degrees' if bounds.scale else f'{_percent(share)} %'}){limited}"
    if high - low <= WEAKLY * (2 * bounds.scale if bounds.scale else abs(high + low)):
        return f"weakly determined: {span((low, high))}{limited}"
    return f"not determined by these curves: {within}"


def reached(at_bound: str, value: float, interval: Sequence[float] | Array, bounds: Range) -> str:
    """The bound near which a value lies, where its interval comes to that bound too; "" where it does not.

    In a range that is thousands of times as wide as an interval, all of the interval is near the bound by the range's size.

    Parameters
    ----------
    at_bound : "lower", "upper" or ""
    value : float
    interval : (low, high)
        95 % interval, within the bounds.
    bounds : Range

    Returns
    -------
    str
    """
    low, high = min(interval[0], value), max(interval[1], value)
    apart = low - bounds.min if at_bound == "lower" else bounds.max - high
    return at_bound if at_bound and not apart > REACHED * (high - low) else ""


def beyond(interval: Sequence[float] | Array, at_bound: str) -> str:
    """What is known of a parameter at its bound: the end of its interval on the other side."""
    return f"at most {interval[1]:.3g}" if at_bound == "lower" else f"at least {interval[0]:.3g}"


def conclusions(estimates: Mapping[str, ParameterEstimate], curves: int, published: PublishedComparison | None) -> tuple[str, ...]:
    """Sentences on the parameters that the curves determine, with intervals, on the others, and on published values."""
    kinds: dict[str, list[str]] = {kind: [] for kind in KINDS}
    for name, known in estimates.items():
        if known.interval is not None:
            kinds[kind_of(known)].append(f"{name} ({span(known.interval)})")
    number = {1: "this curve", 2: "these two curves"}.get(curves, f"these {curves} curves")
    sentences = [
        f"{kind} {'for' if 'bound' in kind else 'by'} {number}: {', '.join(names)}" for kind, names in kinds.items() if names
    ]
    return (*sentences, _of_published(published)) if published else tuple(sentences)


def contradictions(predicted: Mapping[str, TestPrediction]) -> tuple[str, ...]:
    """A sentence on the tests that contradict the others; none where no test does."""
    wrong = {name: known for name, known in predicted.items() if known.contradicts}
    if not wrong:
        return ()
    words = ", ".join(
        f"{name} is {_off(known.off)} what the others predict (p at most {known.p:.2g})" for name, known in wrong.items()
    )
    return (f"the tests contradict each other: {words}",)


def against_each_other(
    estimates: Mapping[str, ParameterEstimate], predicted: Mapping[str, TestPrediction], alone: Mapping[str, TestAlone]
) -> dict[str, ParameterEstimate]:
    """Estimates with the verdicts that follow where tests contradict each other: then no parameter is determined, whatever its
    interval, because the interval is that of a compromise which none of the tests supports."""
    if not any(known.contradicts for known in predicted.values()):
        return dict(estimates)
    return {name: _of_compromise(name, known, alone) for name, known in estimates.items()}


def unless_proved(estimates: Mapping[str, ParameterEstimate], proved: bool) -> dict[str, ParameterEstimate]:
    """Estimates with the verdicts that follow where the search did not end at a proved optimum: then no parameter is determined,
    because the interval lies about a place that may be no optimum."""
    return {name: known if proved else _unproved(known) for name, known in estimates.items()}


def unless_in_doubt(estimates: Mapping[str, ParameterEstimate], doubts: Iterable[CurveDoubt]) -> dict[str, ParameterEstimate]:
    """Estimates with the verdicts that follow where curves show a preload or adhesion, which no law here has: then no parameter is
    determined, because what the fit makes of such a curve is in no interval."""
    tests = ", ".join(dict.fromkeys(doubt.test for doubt in doubts))
    return {name: _in_doubt(known, tests) if tests else known for name, known in estimates.items()}


def alone_unless_in_doubt(alone: Mapping[str, TestAlone], doubts: Iterable[CurveDoubt]) -> dict[str, TestAlone]:
    """Fits to single tests with such verdicts."""
    verdicts = {doubt.test: IN_DOUBT.format(tests=doubt.test) for doubt in doubts}
    return {test: _with_verdict(known, verdicts[test]) if test in verdicts else known for test, known in alone.items()}


def _in_doubt(known: ParameterEstimate, tests: str) -> ParameterEstimate:
    if known.interval is None or kind_of(known) == "not determined":
        return known
    low, high = known.interval
    said = f"{IN_DOUBT.format(tests=tests)} (taken as it is: {low:.3g} to {high:.3g})"
    return replace(known, verdict=said, limited_by="recording")


def alone_unless_proved(alone: Mapping[str, TestAlone], proved: bool) -> dict[str, TestAlone]:
    """Fits to single tests with such verdicts."""
    return {test: known if proved else _with_verdict(known, UNPROVED) for test, known in alone.items()}


def _with_verdict(alone: TestAlone, said: str) -> TestAlone:
    return replace(alone, parameters={name: replace(row, verdict=said) for name, row in alone.parameters.items()})


def _unproved(known: ParameterEstimate) -> ParameterEstimate:
    if known.interval is None:
        return known
    low, high = known.interval
    return replace(known, verdict=f"{UNPROVED} (about the best place so far: {low:.3g} to {high:.3g})", limited_by="search")


def _of_compromise(name: str, known: ParameterEstimate, alone: Mapping[str, TestAlone]) -> ParameterEstimate:
    if kind_of(known) == "not determined":
        return known
    spans = {test: fitted.parameters[name].interval for test, fitted in alone.items() if name in fitted.parameters}
    words = ", ".join(f"{low:.3g} to {high:.3g} by {test}" for test, (low, high) in spans.items())
    said = f"not determined: the tests contradict each other{f' (alone: {words})' if words else ''}"
    return replace(known, verdict=said, limited_by="tests")


def _off(share: float) -> str:
    return f"{abs(share):.0%} {'above' if share > 0 else 'below'}"


def kind_of(known: ParameterEstimate) -> str:
    """The kind of a verdict, one of KINDS."""
    said = known.verdict or ""
    if said.startswith("at its"):
        return "not determined" if "not determined" in said else "at a bound"
    return next((kind for kind in KINDS if said.startswith(kind)), "not determined")


def _by(kind: str) -> str:
    return f"{kind} for" if kind == "at a bound" else f"{kind} by"


def _of_published(published: PublishedComparison) -> str:
    words = [
        f"{name} = {published.parameters[name]:g} {'inside' if inside else 'outside'}" for name, inside in published.inside.items()
    ]
    value, error = published.objective, published.error
    off = f" +- {max(error / value, 1e-3):.1%} (by the surrogate)" if value and error is not None else ""
    objective = f"; together their objective is {quantity(value, 'mN')}{off}" if value is not None else ""
    return f"published values and the 95 % intervals: {', '.join(words)}{objective}"


def _percent(share: float) -> str:
    return f"{100 * share:.2g}" if share >= 0.001 else "0.1 or less"
