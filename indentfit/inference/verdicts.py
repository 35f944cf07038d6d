"""Verdicts in words: how well each parameter is determined, and which parameters the curves of a fit determine together."""

from collections.abc import Mapping, Sequence

import numpy as np

from indentfit.arrays import Array
from indentfit.case import Range
from indentfit.inference.result import ParameterEstimate, PublishedComparison

DETERMINED = 0.2  # half an interval over the value
WEAKLY = 2 / 3  # half an interval over its middle: a factor of five between its ends
KINDS = ("determined", "weakly determined", "not determined")


def verdict(value: float, interval: Sequence[float] | Array, bounds: Range, at_bound: str) -> str:
    """How well a parameter is determined, in words.

    Parameters
    ----------
    value : float
    interval : (low, high)
        95 % interval, within the bounds.
    bounds : Range
    at_bound : "lower", "upper" or ""

    Returns
    -------
    str
    """
    place = f"at its {at_bound} bound; " if at_bound else ""
    low, high = interval
    within = f"any value in {low:.3g}-{high:.3g} fits within the noise"
    if low <= bounds.min and high >= bounds.max:
        return f"{place}not determined by these curves: {within}"
    half = max(value - low, high - value)
    share = half / abs(value) if value else np.inf
    if at_bound and not share <= DETERMINED:
        return f"{place}the curves ask for a value beyond it, or leave it open: {within}"
    if share <= DETERMINED:
        return f"{place}determined (+-{_percent(share)} %)"
    if high - low <= WEAKLY * abs(high + low):
        return f"weakly determined: {low:.3g} to {high:.3g}"
    return f"not determined by these curves: {within}"


def conclusions(estimates: Mapping[str, ParameterEstimate], curves: int, published: PublishedComparison | None) -> tuple[str, ...]:
    """Sentences on the parameters that the curves determine, with intervals, on the others, and on published values."""
    kinds: dict[str, list[str]] = {kind: [] for kind in KINDS}
    for name, known in estimates.items():
        if known.interval is not None:
            low, high = known.interval
            kinds[_kind(known.verdict or "")].append(f"{name} ({low:.3g} to {high:.3g})")
    number = {1: "this curve", 2: "these two curves"}.get(curves, f"these {curves} curves")
    sentences = [f"{kind} by {number}: {', '.join(names)}" for kind, names in kinds.items() if names]
    return (*sentences, _of_published(published)) if published else tuple(sentences)


def _kind(said: str) -> str:
    words = said.rpartition("; ")[2] if "bound" in said else said
    return next((kind for kind in KINDS if words.startswith(kind)), "not determined")


def _of_published(published: PublishedComparison) -> str:
    words = [
        f"{name} = {published.parameters[name]:g} {'inside' if inside else 'outside'}" for name, inside in published.inside.items()
    ]
    value = published.objective
    objective = f"; together their objective is {value:.4g} mN" if value is not None else ""
    return f"published values and the 95 % intervals: {', '.join(words)}{objective}"


def _percent(share: float) -> str:
    return f"{100 * share:.2g}" if share >= 0.001 else "0.1 or less"
